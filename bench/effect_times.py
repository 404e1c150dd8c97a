#!/usr/bin/env python3
"""What each effect of the plan costs where it runs and where it is skipped: CPU seconds and rays of the pairs of levels of tests/endtoend/plan_test.py.

    effect_times.py --lmc build/release/bin/lmc [--goal 2%] [--texels 256] [--runs 5]

Each row has runs of equal kind in turn, and the least CPU seconds (user and system) of each: a level that does not call for the effect, the same with the
effect forced on, and one that calls for it. Run it on an idle machine: CPU seconds of a busy one are up to twice as many.
"""
import argparse, json, pathlib, resource, subprocess, sys, tempfile

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument('--lmc', required=True)
parser.add_argument('--goal', default='2%')
parser.add_argument('--texels', type=int, default=256, help='side of the map')
parser.add_argument('--runs', type=int, default=5)
args = parser.parse_args()

root = pathlib.Path(__file__).resolve().parent.parent
sys.path += [str(root / 'samples'), str(root / 'tests' / 'endtoend')]
import make_samples, plan_test  # noqa: E402


def timed(*command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    r = subprocess.run([args.lmc, *map(str, command)], capture_output=True, text=True)
    assert r.returncode in (0, 5), f'{command}: {r.stderr}'
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


class Bake:
    def __init__(self, level, out, *how):
        self.report_file = out / 'report.json'
        self.command = ['bake', level, '-o', out, '--max-error', args.goal, '--progress', 'none', '--no-audit', *how]

    def run(self):
        return timed(*self.command)

    def rays(self):
        return json.loads(self.report_file.read_text())['rays']['total']


class Picture:
    def __init__(self, level, out, *how):
        self.command = ['shade', level, '-o', out.with_suffix('.png'), *how]

    def run(self):
        return timed(*self.command)

    def rays(self):
        return None


def row(effect, *kinds):
    """Kinds of run in turn, so that what else the machine does meets all of them."""
    least = [float('inf')] * len(kinds)
    for _ in range(args.runs):
        for k, kind in enumerate(kinds):
            if kind:
                least[k] = min(least[k], kind.run())
    cells = ['–' if not kind else f'{t:.2f}' + ('' if kind.rays() is None else f' ({kind.rays() / 1e6:.2f} M)') for t, kind in zip(least, kinds)]
    print(f'| {effect} | ' + ' | '.join(cells) + ' |', flush=True)


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)

    def write(level):
        (folder / level.name).mkdir(exist_ok=True)
        for name, data in make_samples.build(level).items():
            (folder / level.name / name).write_bytes(data)
        return folder / level.name / f'{level.name}.glb'

    print('| effect | a level that does not call for it | the same, forced on | a level that calls for it |\n|---|---|---|---|')
    for effect, exact, without, within, _, reason in plan_test.pairs_of(make_samples, write, args.texels):
        base = '' if effect == 'ao' else ',-ao'
        row(f'{effect}: {reason}', Bake(without, folder / 'a', '--effects', 'auto' if effect == 'ao' else '-ao'), Bake(without, folder / 'b', '--effects', f'+{effect}{base}'),
            Bake(within, folder / 'c', '--effects', 'auto' if effect == 'ao' else '-ao'))
    levels = plan_test.dressed(make_samples, write, args.texels)
    grey = Bake(levels['grey'], folder / 'a', '--effects=-ao')
    row('colour: all is grey', grey, Bake(levels['grey'], folder / 'b', '--effects=-ao,+colour'), Bake(levels['red'], folder / 'c', '--effects=-ao'))
    row('alpha: no hole', Bake(levels['whole'], folder / 'a', '--effects=-ao'), Bake(levels['whole'], folder / 'b', '--effects=-ao,+alpha'), Bake(levels['holed'], folder / 'c', '--effects=-ao'))
    row('bent: not asked for', Bake(levels['grey'], folder / 'a'), None, Bake(levels['grey'], folder / 'c', '--bent', 'world'))
    row('tangents: no normal map', grey, None, Bake(levels['brushed'], folder / 'c', '--effects=-ao'))
    curved = root / 'samples' / 'curved.glb'
    row('seams (left out, run)', Bake(curved, folder / 'a', '--effects=-ao,-seams'), None, Bake(curved, folder / 'c', '--effects=-ao'))
    row('specular: nothing shines', Picture(levels['grey'], folder / 'a', '--no-light-map'), None, Picture(levels['shiny'], folder / 'c', '--no-light-map'))
    Bake(levels['grey'], folder / 'baked', '--preset', 'draft').run()
    row('screen-ao (--ao baked, both)', Picture(folder / 'baked', folder / 'a', '--ao', 'baked'), None, Picture(folder / 'baked', folder / 'c', '--ao', 'both'))
