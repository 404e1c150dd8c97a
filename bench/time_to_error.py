#!/usr/bin/env python3
"""CPU seconds that lmc takes to reach a TRUE error, scene by scene. Python's standard library alone.

    time_to_error.py --lmc LMC --shared DIR [SCENE...] [--max-error 8,4,2,1,0.5] [--baseline OTHER_LMC] [--python PYTHON] [-o PREFIX]

DIR holds scenes/SCENE.glb, references/SCENE.npz and tools/compare_lightmap.py; without a SCENE all levels that have a reference are baked.
Every level is baked at each --max-error. True error: root mean square against the reference's texel means, over the reference's mean, with the
reference's own noise taken out (rel_rmse_net of the comparison's `box`). The time to a target lies on the line, in logarithms, between the two
rungs around it: nothing is extrapolated. CPU seconds are the report's: user and system time of all stages, without the writing of files.
Neighbours on the machine make them larger, never smaller: of --repeat bakes, which are the same but for their time, the cheapest counts.

Written: PREFIX.csv, a row a bake, as the bakes end; PREFIX.md, the tables that are printed as well.
Exit codes: 0 done, 1 command line, 2 missing, unreadable or not writable, 6 a bake or a comparison failed.
"""
import argparse
import csv
import itertools
import json
import math
import os
import pathlib
import re
import subprocess
import sys
import tempfile

LADDER = [0.08, 0.04, 0.02, 0.01, 0.005]   # errors asked for
TARGETS = [0.04, 0.02, 0.01, 0.005]        # true errors whose price is wanted
LEAST_SPAN = 2.0                           # a slope over a smaller factor of error shows noise
GOAL_MISSED = 5                            # exit code of lmc: the maps are written
COLUMNS = ['scene', 'program', 'max_error', 'cpu_seconds', 'rays', 'estimate', 'bound95', 'goal_met', 'true_error', 'bias', 'reference_noise']


class Failure(Exception):
    """Something the caller can mend, and the exit code that says which kind."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def cost_at(target, points):
    """CPU seconds at a true error from points (true error, CPU seconds) in the ladder's order, and '', 'at most' or 'not reached'.

    'at most': the first rung is better than the target already; the seconds are those of the cheapest rung that is."""
    if points[0][0] <= target:
        return min(t for e, t in points if e <= target), 'at most'
    for (e0, t0), (e1, t1) in itertools.pairwise(points):
        if e0 > target >= e1 > 0.0:
            share = math.log(e0 / target) / math.log(e0 / e1)
            return t0 * (t1 / t0) ** share, ''
    return None, 'not reached'


def exponent(points):
    """Slope of log CPU seconds over log true error by least squares; None where the errors span too little."""
    logs = [(math.log(e), math.log(t)) for e, t in points if e > 0.0]
    if len(logs) < 2 or max(x for x, _ in logs) - min(x for x, _ in logs) < math.log(LEAST_SPAN):
        return None
    mx, my = (sum(c) / len(logs) for c in zip(*logs))
    return sum((x - mx) * (y - my) for x, y in logs) / sum((x - mx) ** 2 for x, _ in logs)


def run(command):
    try:
        return subprocess.run([str(c) for c in command], capture_output=True, text=True)
    except OSError as e:
        raise Failure(2, f'{command[0]}: {e.strerror}') from e


def files(shared, scene):
    """The level and its reference."""
    return shared / 'scenes' / f'{scene}.glb', shared / 'references' / f'{scene}.npz'


def measure(lmc, scene, goal, args):
    """Bakes once and compares; a row of the CSV without its program."""
    with tempfile.TemporaryDirectory() as out:
        threads = ['-j', args.threads] if args.threads else []
        level, reference = files(args.shared, scene)
        baked = run([lmc, 'bake', level, '-o', out, '--max-error', f'{100 * goal:g}%', '--progress', 'none', *threads])
        if baked.returncode not in (0, GOAL_MISSED):
            raise Failure(6, f'{scene} at {100 * goal:g} %: {lmc} ended with exit code {baked.returncode}: {baked.stderr.strip()}')
        report = json.loads(pathlib.Path(out, 'report.json').read_text())
        compared = run([args.python, args.compare, pathlib.Path(out, 'lightmap.exr'), reference, '--scale', report['maps'][0]['scale'], '--json'])
    if compared.returncode != 0:
        raise Failure(6, f'{scene}: {args.python} {args.compare} failed (it needs numpy and OpenEXR, see --python): {compared.stderr.strip()}')
    figures = json.loads(compared.stdout)
    if 'box' not in figures:
        raise Failure(6, f'{reference}: holds no texel means')
    if figures['nan_inf']:
        raise Failure(6, f'{scene} at {100 * goal:g} %: {figures["nan_inf"]} texels are not finite')
    box, error = figures['box'], report['error']
    return {'scene': scene, 'max_error': goal, 'cpu_seconds': report['cpu_seconds'], 'rays': report['rays']['total'], 'estimate': error['estimate'],
            'bound95': error['bound95'], 'goal_met': error['goal_met'], 'true_error': box['rel_rmse_net'], 'bias': box['bias'],
            'reference_noise': box['ref_noise']}


def cheapest(rows):
    """Of the repetitions of a bake the one of least CPU seconds, in the order of the first ones."""
    best = {}
    for r in rows:
        key = r['scene'], r['program'], r['max_error']
        if key not in best or r['cpu_seconds'] < best[key]['cpu_seconds']:
            best[key] = r
    return list(best.values())


def percent(x):
    return f'{100 * x:.2f} %'


def table(head, rows):
    return '\n'.join(['| ' + ' | '.join(r) + ' |' for r in [head, ['---'] * len(head), *rows]])


def report_text(rows, programs, scenes):
    """Markdown: time to error, ratios where there are two programs, and what was measured."""
    points = {(s, p): [(r['true_error'], r['cpu_seconds']) for r in rows if (r['scene'], r['program']) == (s, p)] for s in scenes for p in programs}
    reach, ratios = [], []
    for scene in scenes:
        costs = {}
        for program in programs:
            costs[program] = [cost_at(t, points[scene, program]) for t in TARGETS]
            slope = exponent(points[scene, program])
            reach.append([scene, program, *(how if t is None else f'{how} {t:.2f}'.strip() for t, how in costs[program]),
                          '-' if slope is None else f'{slope:.2f}'])
        if len(programs) == 2:
            pairs = zip(*(costs[p] for p in programs))
            ratios.append([scene, *(f'{a / b:.2f}' if not how_a and not how_b else '-' for (a, how_a), (b, how_b) in pairs)])
    targets = [f'{100 * t:g} %' for t in TARGETS]
    parts = ['CPU seconds to a true error:', table(['scene', 'program', *targets, 'exponent'], reach)]
    if ratios:
        parts += [f'CPU seconds of {programs[0]} over {programs[1]} at the same true error:', table(['scene', *targets], ratios)]
    measured = [[r['scene'], r['program'], f'{100 * r["max_error"]:g} %', f'{r["cpu_seconds"]:.2f}', f'{r["rays"]:,}', percent(r['estimate']),
                 percent(r['bound95']) + ('' if r['goal_met'] else ' (missed)'), percent(r['true_error'])] for r in rows]
    parts += ['Bakes:', table(['scene', 'program', 'asked', 'CPU s', 'rays', 'estimate', 'bound', 'true error'], measured)]
    return '\n\n'.join(parts) + '\n'


def machine():
    """Processor and cores as the tables name them."""
    try:
        found = re.search(r'^model name\s*:\s*(.+)$', pathlib.Path('/proc/cpuinfo').read_text(), re.MULTILINE)
    except OSError:
        found = None
    return f'{found[1] if found else "unknown processor"}, {os.cpu_count()} cores'


def version(lmc):
    said = run([lmc, '--version'])
    if said.returncode != 0:
        raise Failure(2, f'{lmc} --version ended with exit code {said.returncode}')
    return said.stdout.strip()


def percentages(text):
    values = [float(t.strip().rstrip('%')) / 100 for t in text.split(',')]
    if not all(0 < v < 1 for v in values) or any(a <= b for a, b in itertools.pairwise(values)):
        raise argparse.ArgumentTypeError('falling percentages between 0 and 100, such as 8,4,2')
    return values


def positive(text):
    n = int(text)
    if n < 1:
        raise argparse.ArgumentTypeError('a number above 0')
    return n


class Parser(argparse.ArgumentParser):
    def error(self, message):
        self.print_usage(sys.stderr)
        self.exit(1, f'{self.prog}: error: {message}\n')


def parse(arguments):
    ap = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument('scenes', nargs='*', metavar='SCENE', help='names, without folder and .glb [default: all that have a reference]')
    ap.add_argument('--lmc', required=True, type=pathlib.Path, help='the program')
    ap.add_argument('--baseline', type=pathlib.Path, help='a second program, baked with in turn; ratios are printed')
    ap.add_argument('--shared', required=True, type=pathlib.Path, help='folder of scenes, references and tools')
    ap.add_argument('--compare', type=pathlib.Path, help='compare_lightmap.py [default: the one in tools of --shared]')
    ap.add_argument('--python', default=sys.executable, help='interpreter for it, with numpy and OpenEXR [default: this one]')
    ap.add_argument('--max-error', type=percentages, default=LADDER, help='errors to ask for, in percent [default: 8,4,2,1,0.5]')
    ap.add_argument('--repeat', type=positive, default=1, metavar='N', help='bakes of the same kind, the cheapest of which counts [default: 1]')
    ap.add_argument('-j', '--threads', type=positive, metavar='N', help='threads of a bake [default: all]')
    ap.add_argument('-o', '--out', default='time_to_error', metavar='PREFIX', help='of the files written [default: time_to_error]')
    args = ap.parse_args(arguments)
    args.compare = args.compare or args.shared / 'tools' / 'compare_lightmap.py'
    with_reference = sorted(p.stem for p in args.shared.glob('references/*.npz') if files(args.shared, p.stem)[0].is_file())
    args.scenes = list(dict.fromkeys(args.scenes)) or with_reference
    return args


def check(args):
    """Complains before the first bake about what would stop a later one."""
    if not args.scenes:
        raise Failure(2, f'{args.shared}: no scenes/NAME.glb with references/NAME.npz')
    for path in [args.compare, *(path for scene in args.scenes for path in files(args.shared, scene))]:
        if not path.is_file():
            raise Failure(2, f'{path}: not there')


def main(arguments):
    args = parse(arguments)
    check(args)
    programs = {'lmc': args.lmc.absolute(), **({'baseline': args.baseline.absolute()} if args.baseline else {})}
    head = f'{machine()}; ' + ', '.join(f'{name}: {version(path)}' for name, path in programs.items())
    rows = []
    try:
        with open(f'{args.out}.csv', 'w', newline='') as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            for scene, goal, _, (name, path) in itertools.product(args.scenes, args.max_error, range(args.repeat), programs.items()):
                row = {**measure(path, scene, goal, args), 'program': name}
                rows.append(row)
                writer.writerow(row)
                file.flush()
                print(f'{scene} {name} {100 * goal:g} %: {row["cpu_seconds"]:.2f} CPU s, true error {percent(row["true_error"])}', file=sys.stderr)
        result = f'{head}\n\n{report_text(cheapest(rows), list(programs), args.scenes)}'
        pathlib.Path(f'{args.out}.md').write_text(result)
    except OSError as e:
        raise Failure(2, f'{e.filename}: {e.strerror}') from e
    print(result, end='')


if __name__ == '__main__':
    try:
        main(sys.argv[1:])
    except Failure as e:
        print(f'time_to_error.py: error: {e}', file=sys.stderr)
        sys.exit(e.code)
