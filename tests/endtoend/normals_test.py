#!/usr/bin/env python3
"""lmc normals: a ramp of heights becomes a slope, and what cannot be done is refused in words."""
import argparse, json, pathlib, struct, subprocess, sys, tempfile, zlib


def write_png(file, width, height, grey):
    def chunk(kind, data): return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
    rows = b''.join(b'\0' + bytes(grey(x, y) for x in range(width)) for y in range(height))
    file.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)) +
                     chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    a = ap.parse_args()
    bad = []

    def expect(what, holds, more=''):
        if not holds:
            bad.append(f'{what} {more}')

    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        height, out = folder / 'height.png', folder / 'out.png'
        write_png(height, 16, 16, lambda x, y: 16 * y)  # rises along V, which is down: y points against it

        def run(*args):
            return subprocess.run([a.lmc, 'normals', *map(str, args), '-o', str(out)], capture_output=True, text=True)

        def channels():
            """Smallest and largest of red, green and blue."""
            r = subprocess.run([a.lmc, 'compare', str(out), str(out), '--json'], capture_output=True, text=True)
            return {c['channel']: c['mean_of_a'] for c in json.loads(r.stdout)['channels']}

        r = run('--from', height, '--wrap', 'clamp', '--scale', '0.5', '--json')
        expect('exit code', r.returncode == 0, r.stderr)
        report = json.loads(r.stdout)
        expect('what is in it is said', report['green'] == 'up' and report['filter'] == 'central' and report['wrap'] == 'clamp', r.stdout)
        up = channels()
        run('--from', height, '--wrap', 'clamp', '--scale', '0.5', '--green', 'down', '--bits', '16')
        down = channels()
        greens = sorted(up)[1] if 'G' not in up else 'G'
        expect('a rise along V tilts the normal up', up[greens] > down[greens], f'{up} {down}')
        expect('no mesh', run('--from', height, '--to', 'object').returncode == 1)
        expect('no map', run('--from', 'object', '--mesh', height).returncode == 1)
        expect('no file', run('--from', folder / 'nowhere.png').returncode == 2)
        (folder / 'no.png').write_bytes(b'nothing')
        expect('no picture', run('--from', folder / 'no.png').returncode == 3)
    print('\n'.join(bad) or 'all as it should be')
    return 1 if bad else 0


sys.exit(main())
