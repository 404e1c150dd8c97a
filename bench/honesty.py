#!/usr/bin/env python3
"""Whether bakes keep what they promise: many levels, goals and seeds against references made once. Python's standard library alone.

    honesty.py --lmc LMC --samples DIR [--shared DIR] [-o OUT] [LEVEL...] [--seeds 4] [--ladder 50,8,4,2,1]

A reference of each level is made by `lmc study --make-reference` at another seed, its noise at most a third of the finest goal; then a study of the ladder
runs for each seed. Everything is kept in OUT: a run that was stopped goes on. Goals of at most 4 % count as promises; the first rung of the ladder
shows what a bake casts at the least, and 8 to 1 % give the exponent of rays against error.

    kept       true error (the reference's noise taken out) below the promise: 92 % of all runs, 80 % of each level's
    covered    the stated interval meets the 95 % interval of the true error: 90 % of all runs
    padded     runs with more than 1.1 x the least hemisphere rays whose true error is below a third of the promise: none
    monotone   each rung with more than the least rays casts more than the one before and states less error
    exponent   of rays against true error: not below -1.5

Written: OUT/honesty.csv, a row a run; OUT/honesty.md, the tables that are printed as well.
Exit codes: 0 all kept, 1 command line, 2 missing or not writable, 6 a bake failed, 7 a promise was not kept.
"""
import argparse
import csv
import json
import math
import pathlib
import subprocess
import sys

SHARED = ['cornell', 'two_rooms', 'gallery', 'courtyard']   # with light and bounces; atrium by name
SAMPLES = ['cornell.glb', 'two_rooms.glb', 'court.glb', 'curved.glb', 'furnace.glb', 'textured.gltf']
KEPT, KEPT_LEVEL, COVERED, PADDED = 0.92, 0.8, 0.9, 1 / 3
LEAST_RAYS = 1.1
STEEPEST = -1.5
PROMISES = 0.04
REFERENCE_SEED = 1000


class Failure(Exception):
    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def study(args, level, out, ladder, seed, *more):
    command = [args.lmc, 'study', level, '-o', out, '--ladder', ladder, '--seed', seed, '--effects=-ao', *more, *args.bake]
    if args.threads:
        command += ['-j', args.threads]
    run = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if run.returncode != 0:
        raise Failure(6, f'{level}: {" ".join(map(str, command))} ended with exit code {run.returncode}: {run.stderr.strip()[-500:]}')
    return json.loads(pathlib.Path(out, 'study.json').read_text())


def gather_rays(rung):
    """Hemisphere rays: those that a goal asks for."""
    return sum(s['rays'] for s in rung['stages'] if s['name'] == 'gather')


def measure(args, name, level):
    """Rows of a level, all seeds."""
    folder = args.out / name
    finest = float(args.ladder.split(',')[-1]) / 100
    reference = study(args, level, folder / 'reference', '50', REFERENCE_SEED, '--make-reference', '--reference-error', f'{100 * finest / 3:g}%',
                      '--reference-texels', args.texels, '--reference-rays', args.reference_rays)['reference']
    rows = []
    for seed in range(1, args.seeds + 1):
        found = study(args, level, folder / f'seed{seed}', args.ladder, seed, '--reference', folder / 'reference' / reference['files'][0])
        least = gather_rays(found['rungs'][0])
        for r in found['rungs']:
            rows.append({'level': name, 'seed': seed, 'promised': r['promised'], 'estimate': r['estimate'], 'low': r['interval'][0],
                         'high': r['interval'][1], 'bound95': r['bound95'], 'met': r['goal_met'], 'true': r['true']['net'],
                         'true_low': r['true']['interval'][0], 'true_high': r['true']['interval'][1], 'reference_noise': r['true']['reference_noise'],
                         'bias': r['true']['bias'], 'rays': r['rays'], 'gather_rays': gather_rays(r), 'least_gather_rays': least, 'cpu_seconds': r['cpu_seconds'],
                         'audit_contradicts': r.get('audit', {}).get('contradicts', ''), 'noise': r['noise'], 'patches': r['patches'],
                         'interpolation': r['interpolation']})
        print(f'{name} seed {seed}: ' + ', '.join(f'{100 * r["promised"]:g} % -> {100 * r["true"]["net"]:.2f}' for r in found['rungs']), file=sys.stderr)
    return rows


def slope(points):
    logs = [(math.log(x), math.log(y)) for x, y in points if x > 0 and y > 0]
    if len(logs) < 2:
        return None
    mx, my = (sum(c) / len(logs) for c in zip(*logs))
    spread = sum((x - mx) ** 2 for x, _ in logs)
    return sum((x - mx) * (y - my) for x, y in logs) / spread if spread > 0 else None


def kept(r):
    return r['true'] <= r['promised']


def covered(r):
    return r['true_low'] <= r['high'] and r['true_high'] >= r['low']


def more_than_least(r):
    return r['gather_rays'] > LEAST_RAYS * r['least_gather_rays']


def padded(r):
    """What the reference leaves open counts for the bake."""
    return more_than_least(r) and r['true_high'] < PADDED * r['promised']


def not_monotone(rows):
    """Pairs of neighbouring rungs of one level and seed of which the finer is not dearer and better."""
    out = []
    for a, b in zip(rows, rows[1:]):
        if (a['level'], a['seed']) != (b['level'], b['seed']) or not more_than_least(b):
            continue
        if b['rays'] <= a['rays'] or b['bound95'] >= a['bound95']:
            out.append(b)
    return out


def share(rows, what):
    return sum(map(what, rows)) / len(rows) if rows else 1.0


def table(head, rows):
    return '\n'.join(['| ' + ' | '.join(r) + ' |' for r in [head, ['---'] * len(head), *rows]])


def judge(rows):
    """Markdown, and what was not kept."""
    runs = [r for r in rows if r['promised'] <= PROMISES + 1e-9]
    levels = list(dict.fromkeys(r['level'] for r in runs))
    lines, faults = [], []
    for level in levels:
        own = [r for r in runs if r['level'] == level]
        ladder = [r for r in rows if r['level'] == level and r['promised'] <= 0.08 + 1e-9]
        exponent = slope([(r['true'], r['rays']) for r in ladder])
        cells = []
        for goal in sorted({r['promised'] for r in own}, reverse=True):
            at = [r for r in own if r['promised'] == goal]
            cells.append(', '.join(f'{100 * r["true"]:.2f}' for r in at))
        lines.append([level, f'{len(own)}', f'{100 * share(own, kept):.0f} %', f'{100 * share(own, covered):.0f} %', f'{sum(map(padded, own))}',
                      f'{len(not_monotone([r for r in rows if r["level"] == level]))}', '-' if exponent is None else f'{exponent:.2f}',
                      f'{100 * own[0]["reference_noise"]:.2f} %', *cells])
        if share(own, kept) < KEPT_LEVEL:
            faults.append(f'{level}: {100 * share(own, kept):.0f} % of its runs kept their promise')
        if exponent is not None and exponent < STEEPEST and any(map(more_than_least, ladder)):
            faults.append(f'{level}: rays go with error^{exponent:.2f}')
    if share(runs, kept) < KEPT:
        faults.append(f'{100 * share(runs, kept):.1f} % of all runs kept their promise')
    if share(runs, covered) < COVERED:
        faults.append(f'{100 * share(runs, covered):.1f} % of the intervals cover the truth')
    faults += [f'{r["level"]} seed {r["seed"]} at {100 * r["promised"]:g} %: true error {100 * r["true"]:.2f} %, less than a third' for r in runs if padded(r)]
    faults += [f'{r["level"]} seed {r["seed"]} at {100 * r["promised"]:g} %: not dearer and better than the rung before' for r in not_monotone(rows)]
    goals = sorted({r['promised'] for r in runs}, reverse=True)
    text = table(['level', 'runs', 'kept', 'covered', 'padded', 'not monotone', 'exponent', 'reference', *(f'true at {100 * g:g} %' for g in goals)], lines)
    text += (f'\n\n{len(runs)} runs: {100 * share(runs, kept):.1f} % below the promise, {100 * share(runs, covered):.1f} % of the intervals cover the truth, '
             f'{sum(map(padded, runs))} padded, {len(not_monotone(rows))} rungs not monotone.\n')
    return text + ('\nNot kept:\n\n' + '\n'.join(f'- {f}' for f in faults) + '\n' if faults else ''), faults


class Parser(argparse.ArgumentParser):
    def error(self, message):
        self.print_usage(sys.stderr)
        self.exit(1, f'{self.prog}: error: {message}\n')


def parse(arguments):
    ap = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument('levels', nargs='*', metavar='LEVEL', help='names such as shared/gallery or samples/court.glb [default: all]')
    ap.add_argument('--lmc', required=True, type=pathlib.Path)
    ap.add_argument('--samples', required=True, type=pathlib.Path, help='folder of sample levels')
    ap.add_argument('--shared', type=pathlib.Path, help='folder with scenes/NAME.glb')
    ap.add_argument('--seeds', type=int, default=4)
    ap.add_argument('--ladder', default='50,8,4,2,1')
    ap.add_argument('--texels', type=int, default=800, help='of a reference')
    ap.add_argument('--reference-rays', type=int, default=1500000000, help='of a reference, at most')
    ap.add_argument('-j', '--threads', type=int)
    ap.add_argument('--bake', nargs=argparse.REMAINDER, default=[], help='what follows goes to every bake')
    ap.add_argument('-o', '--out', type=pathlib.Path, default=pathlib.Path('honesty'))
    args = ap.parse_args(arguments)
    known = {f'samples/{s}': args.samples / s for s in SAMPLES}
    if args.shared:
        known |= {f'shared/{p.stem}': p for p in sorted(args.shared.glob('scenes/*.glb'))}
        defaults = [f'samples/{s}' for s in SAMPLES] + [f'shared/{s}' for s in SHARED]
    else:
        defaults = list(known)
    names = args.levels or defaults
    unknown = [n for n in names if n not in known or not known[n].is_file()]
    if unknown:
        ap.error(f'no such level: {", ".join(unknown)}')
    args.levels = {n: known[n] for n in names}
    return args


def main(arguments):
    args = parse(arguments)
    rows = []
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        for name, level in args.levels.items():
            rows += measure(args, name, level)
            with open(args.out / 'honesty.csv', 'w', newline='') as file:
                writer = csv.DictWriter(file, rows[0])
                writer.writeheader()
                writer.writerows(rows)
        text, faults = judge(rows)
        (args.out / 'honesty.md').write_text(text)
    except OSError as e:
        raise Failure(2, f'{e.filename}: {e.strerror}') from e
    print(text, end='')
    return 7 if faults else 0


if __name__ == '__main__':
    try:
        sys.exit(main(sys.argv[1:]))
    except Failure as e:
        print(f'honesty.py: error: {e}', file=sys.stderr)
        sys.exit(e.code)
