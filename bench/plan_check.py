#!/usr/bin/env python3
"""How right the plan was: forecasts against what came, and bounds against what leaving an effect out does to the map.

    plan_check.py --lmc build/release/bin/lmc --dump build/release/tests/bin/exr_dump LEVELS...      [--goal 2%] [--bounds]
"""
import argparse, array, json, math, pathlib, subprocess, tempfile

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument('levels', nargs='+', type=pathlib.Path)
parser.add_argument('--lmc', required=True)
parser.add_argument('--dump', required=True)
parser.add_argument('--goal', default='2%')
parser.add_argument('--bounds', action='store_true', help='also bake without each effect that runs')
args = parser.parse_args()


def bake(level, out, *more):
    r = subprocess.run([args.lmc, 'bake', str(level), '-o', str(out), '--max-error', args.goal, '--progress', 'none', *more], capture_output=True, text=True)
    assert r.returncode in (0, 5), r.stderr
    return json.loads((out / 'report.json').read_text())


def texels(folder):
    channels = []
    for file in sorted(folder.glob('lightmap*.exr')):
        planes = []
        for c in 'RGBA':
            raw = subprocess.run([args.dump, str(file), c], check=True, capture_output=True).stdout
            planes.append(array.array('f', raw[raw.index(b'\n') + 1:]))
        channels += [t[:3] for t in zip(*planes) if t[3] == 1.0]
    return channels


with tempfile.TemporaryDirectory() as folder:
    for level in args.levels:
        out = pathlib.Path(folder) / level.stem
        report = bake(level, out)
        f = report['forecast']
        told, came = f['cpu_seconds'], f['actual']['cpu_seconds']
        inside = f['least_cpu_seconds'] <= came <= f['most_cpu_seconds']
        right = abs(told - came) <= 0.5 or 1 / 1.3 <= told / came <= 1.3
        print(f"{level.stem:14} foretold {told:7.2f} CPU s ({f['least_cpu_seconds']:.2f} to {f['most_cpu_seconds']:.2f}), came {came:7.2f}, ratio {told / max(came, 1e-9):.2f}"
              f"{'' if right else ' OFF'}{'' if inside else ' OUTSIDE'}; rays {f['rays'] / 1e6:.1f} M, came {f['actual']['rays'] / 1e6:.1f} M;"
              f" pilot {100 * f.get('pilot', {}).get('cpu_seconds', 0) / max(came, 1e-9):.1f} %", flush=True)
        if not args.bounds:
            continue
        whole = texels(out)
        mean = sum(map(sum, whole)) / max(1, 3 * len(whole))
        for step in report['plan']:
            if not step['run'] or 'bound' not in step:
                continue
            name = step['effect']
            without = pathlib.Path(folder) / f'{level.stem}.{name}'
            less = bake(level, without, '--effects=-ao,-' + name)
            other = texels(without)
            change = math.sqrt(sum((p - q) ** 2 for t, u in zip(whole, other) for p, q in zip(t, u)) / (3 * len(whole))) / mean
            noise = report['error']['estimate']
            print(f"    without {name:8} the map changes by {100 * change:7.2f} %, bound {100 * step['bound']:7.2f} %{'' if change <= step['bound'] + noise else ' ABOVE'}", flush=True)
