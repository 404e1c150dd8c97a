#!/usr/bin/env python3
"""Bakes the benchmark's scenes and compares with their independent references (left out where ../shared is not there).

True error: sqrt(mean (E - Eref)^2 - noise^2 of the reference) / mean(Eref), texel mean ("box"), over reference texels and channels."""
import argparse, array, io, json, math, pathlib, struct, subprocess, sys, tempfile, zipfile

GOAL = 0.02                     # the default of lmc bake
HONEST = 1.5                    # estimate and truth within this factor ...
BOTH_SMALL = 0.003              # ... or both below this


def load_npz(path):
    """Arrays of an .npz as flat lists with their shapes."""
    out = {}
    with zipfile.ZipFile(path) as z:
        for name in z.namelist():
            b = z.read(name)
            size = struct.unpack('<H', b[8:10])[0] if b[6] == 1 else struct.unpack('<I', b[8:12])[0]
            start = (10 if b[6] == 1 else 12) + size
            header = eval(b[start - size:start].decode('latin1'), {'__builtins__': {}}, {'True': True, 'False': False})
            code = {'f4': 'f', 'f8': 'd', 'i4': 'i', 'i8': 'q', 'u4': 'I', 'i2': 'h', 'u2': 'H', 'b1': 'b'}.get(header['descr'][-2:])
            if code and not header['fortran_order']:
                out[name[:-4]] = array.array(code, b[start:])
    return out


def read_map(dump, path):
    raw = subprocess.run([dump, str(path), 'R', 'G', 'B'], check=True, capture_output=True).stdout
    end = raw.index(b'\n')
    w, h = map(int, raw[:end].split())
    data = array.array('f', raw[end + 1:])
    return w, h, [data[c * w * h:(c + 1) * w * h] for c in range(3)]


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--dump', required=True)
    ap.add_argument('--shared', required=True)
    ap.add_argument('--scenes', default='cornell,two_rooms,courtyard,direct_only,lightless')
    a = ap.parse_args()
    shared = pathlib.Path(a.shared)
    if not (shared / 'scenes').is_dir():
        print('left out: no reference scenes beside the project')
        return 77
    failed = []
    for scene in a.scenes.split(','):
        with tempfile.TemporaryDirectory() as out:
            run = subprocess.run([a.lmc, 'bake', str(shared / 'scenes' / f'{scene}.glb'), '-o', out, '--progress', 'none'], capture_output=True, text=True)
            if run.returncode != 0:
                failed.append(f'{scene}: exit {run.returncode}: {run.stderr}')
                continue
            report = json.loads(pathlib.Path(out, 'report.json').read_text())
            w, h, rgb = read_map(a.dump, pathlib.Path(out, 'lightmap.exr'))
        ref = load_npz(shared / 'references' / f'{scene}.npz')
        if any(not math.isfinite(v) for c in rgb for v in c):
            failed.append(f'{scene}: a texel is not finite')
        n = len(ref['x'])
        se2 = noise2 = bias = mean = 0.0
        for i in range(n):
            at = int(ref['y'][i]) * w + int(ref['x'][i])
            for c in range(3):
                e, r = rgb[c][at], ref['E_total_box'][3 * i + c]
                se2 += (e - r) ** 2
                noise2 += ref['stderr_box'][3 * i + c] ** 2
                bias += e - r
                mean += r
        estimate = report['error']['estimate']
        if mean == 0.0:
            ok = se2 == 0.0 and report['rays']['total'] == 0
            print(f'{scene}: dark, {report["rays"]["total"]} rays, squared error {se2}')
        else:
            mean /= 3 * n
            error = math.sqrt(max(0.0, se2 / (3 * n) - noise2 / (3 * n))) / mean
            bias = bias / (3 * n) / mean
            honest = max(error, estimate) <= BOTH_SMALL or 1 / HONEST <= estimate / error <= HONEST
            ok = error <= GOAL and abs(bias) <= 0.01 and honest and report['energy']['balance'] <= 0.005
            print(f'{scene}: true error {100 * error:.2f} %, estimate {100 * estimate:.2f} %, bias {100 * bias:+.2f} %, {report["rays"]["total"]} rays')
        if not ok:
            failed.append(scene)
    print('failed: ' + '; '.join(failed) if failed else 'all scenes inside their limits')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
