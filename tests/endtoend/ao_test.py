#!/usr/bin/env python3
"""Ambient occlusion through the program: files of a bake, the same bytes whatever else is baked, lmc ao in its four kinds. With --shared: against the
independent references, at two errors."""
import argparse, array, json, math, pathlib, struct, subprocess, sys, tempfile

from references_test import load_npz
from tangents_test import read, read_glb

HONEST, BOTH_SMALL = 1.5, 0.002     # stated and true error within this factor, or both below this
# error asked for -> true error allowed. References are at texels' middles; the mean over a texel is 0.0025 off them where openness curves
# (courtyard), so that sqrt(0.003^2 + 0.0025^2) = 0.004.
ALLOWED = {0.01: 0.01, 0.003: 0.004}


class Test:
    def __init__(self, a, folder):
        self.lmc, self.dump, self.samples, self.out, self.bad = a.lmc, a.dump, pathlib.Path(a.source_dir) / 'samples', pathlib.Path(folder), []

    def expect(self, right, what):
        if not right:
            self.bad.append(what)

    def run(self, *args, exit=0):
        r = subprocess.run([self.lmc, *map(str, args)], capture_output=True, text=True)
        self.expect(r.returncode == exit, f'{" ".join(map(str, args))}: exit {r.returncode}, not {exit}: {r.stderr}')
        return r

    def bake(self, name, *args, level=None, exit=0):
        self.run('bake', level or self.samples / 'court.glb', '-o', self.out / name, '--progress', 'none', '--preset', 'draft', *args, exit=exit)
        return self.out / name

    def channel(self, file, name):
        raw = subprocess.run([self.dump, str(file), name], check=True, capture_output=True).stdout
        end = raw.index(b'\n')
        return array.array('f', raw[end + 1:])

    def bakes(self):
        whole = self.bake('whole', '--bent', 'world')
        same = (whole / 'ao.exr').read_bytes()
        for name, effects in (('dark', 'ao,bent'), ('direct', '-bounce,-sky,+bent')):
            other = self.bake(name, '--effects', effects)
            self.expect((other / 'ao.exr').read_bytes() == same, f'--effects {effects}: ao.exr has other bytes than with all light')
        one = self.bake('one', '--bent', 'world', '-j', '1')
        self.expect((one / 'ao.exr').read_bytes() == same, 'one thread: other bytes')
        for f in ('ao.exr', 'ao.png'):
            listed = [x['name'] for x in json.loads((whole / 'level.lmc.json').read_text())['files']]
            self.expect(f in listed, f'{f} is not in the sidecar')
        open_ = self.channel(whole / 'ao.exr', 'Y')
        self.expect(all(0.0 <= v <= 1.0 for v in open_) and max(open_) > 0.9, 'openness is not within [0, 1], or nothing is open')
        normals = [self.channel(whole / 'ao.exr', f'bent.{c}') for c in 'RGB']
        lengths = [math.sqrt(x * x + y * y + z * z) for x, y, z in zip(*normals)]
        # halves: 2^-11 in each of three components
        self.expect(all(v == 0.0 or abs(v - 1.0) < 2e-3 for v in lengths) and max(lengths) > 0.9, 'bent normals are not unit')
        tangent = self.bake('tangent', '--bent', 'tangent', '--effects', 'ao')
        up = self.channel(tangent / 'ao.exr', 'bent.B')
        self.expect(sum(v > 0.0 for v in up) > 0.95 * sum(v != 0.0 for v in up), 'bent normals in tangent space do not point off the surface')

        doc, _ = read_glb(whole / 'level.glb')
        used = 0
        for node in doc['nodes']:
            place = node.get('extras', {}).get('lmc', {}).get('lightmap')
            for p in doc['meshes'][node['mesh']]['primitives'] if place and 'mesh' in node else []:
                texture = doc['materials'][p['material']]['occlusionTexture']
                self.expect(texture.get('texCoord', 0) == place['texCoord'] and texture.get('strength', 1) == 1, f'{node.get("name")}: occlusionTexture {texture}')
                self.expect(doc['images'][doc['textures'][texture['index']]['source']]['uri'] == 'ao.png', 'the picture is not ao.png')
                used += 1
        self.expect(used > 0, 'no material has an occlusionTexture')
        self.bake('again', '--effects', 'ao', level=whole / 'level.glb')

        plain = self.bake('without', '--effects', '-ao')
        self.expect(not (plain / 'ao.exr').exists(), '-ao writes ao.exr')
        report = json.loads((plain / 'report.json').read_text())
        self.expect(report['rays']['occlusion'] == 0 and 'ao' not in report, '-ao casts rays')
        maps = [self.channel(f / 'lightmap.exr', 'R') for f in (plain, whole)]
        self.expect(maps[0] == maps[1], 'the light map hangs on ambient occlusion')

    def closedRoom(self):
        r = self.run('bake', self.samples / 'furnace.glb', '-o', self.out / 'furnace', '--effects', 'ao', '--progress', 'lines')
        self.expect('LMC_AO_DARK' in r.stderr and '--ao-distance' in r.stderr, f'no note of a closed room: {r.stderr}')
        open_ = self.channel(self.out / 'furnace' / 'ao.exr', 'Y')
        self.expect(max(open_) == 0.0, f'a closed room is open by {max(open_)}')

    def models(self):
        model = self.samples / 'court.glb'
        report = json.loads(self.run('ao', model, '-o', self.out / 'm.exr', '--texcoord', '1', '--size', '128', '--json').stdout)
        self.expect(report['error'] <= 0.01 and report['rays'] > 0, f'lmc ao: {report}')
        flat = self.channel(self.out / 'm.exr', 'uniform.Y')
        self.expect(0.0 < max(flat) <= 1.0, 'lmc ao -o m.exr is dark')
        self.run('ao', model, '-o', self.out / 'm.png', '--texcoord', '1', '--size', '128', '--weighting', 'uniform')
        self.expect((self.out / 'm.png').read_bytes()[:4] == b'\x89PNG', 'm.png is no PNG')
        self.run('ao', model, '-o', self.out / 'm.glb', '--texcoord', '1', '--size', '128')
        doc, _ = read_glb(self.out / 'm.glb')
        self.expect(any('occlusionTexture' in m for m in doc['materials']), 'm.glb has no occlusionTexture')
        self.expect(all('uri' not in i for i in doc['images']), 'm.glb does not hold its picture')

        self.run('ao', model, '-o', self.out / 'v.glb', '--per-vertex', '--ao-distance', '2')
        doc, data = read_glb(self.out / 'v.glb')
        colours = [c for m in doc['meshes'] for p in m['primitives'] for c in read(doc, data, p['attributes']['COLOR_0'])]
        self.expect(all(0.0 <= c[0] <= 1.0 and c[0] == c[1] == c[2] for c in colours) and min(colours) < max(colours), 'COLOR_0 is not openness')
        self.run('ao', model, '-o', self.out / 'a.glb', '--per-vertex', '--attribute', '_AO')
        doc, data = read_glb(self.out / 'a.glb')
        self.expect(all(len(v) == 1 for m in doc['meshes'] for p in m['primitives'] for v in read(doc, data, p['attributes']['_AO'])), '_AO is no scalar')

    def nodes(self):
        """One node's map is darker when the rest of the level stands round it."""
        doc, _ = read_glb(self.samples / 'court.glb')
        name = next(n['name'] for n in doc['nodes'] if 'mesh' in n and 'name' in n)
        means = []
        for more in ([], ['--with-level']):
            self.run('ao', self.samples / 'court.glb', '-o', self.out / 'n.exr', '--node', name, '--texcoord', '1', '--size', '64', *more)
            v = self.channel(self.out / 'n.exr', 'Y')
            means.append(sum(v) / len(v))
        self.expect(means[1] < means[0], f'openness of {name} alone {means[0]}, in the level {means[1]}')
        self.run('ao', self.samples / 'court.glb', '-o', self.out / 'n.exr', '--node', 'nobody', exit=1)
        vertices = [json.loads(self.run('ao', self.samples / 'court.glb', '-o', self.out / 'n.glb', '--per-vertex', '--json', *more).stdout)
                    for more in ([], ['--node', name, '--with-level'])]
        self.expect(0 < vertices[1]['rays'] < 0.7 * vertices[0]['rays'], f'vertices of {name} alone take {vertices[1]["rays"]} rays, of the whole level {vertices[0]["rays"]}')

    def refusals(self):
        model = self.samples / 'court.glb'
        old = (self.out / 'm.png').read_bytes()
        for args, code in ((['-o', self.out / 'm.tga'], 1), (['-o', self.out / 'm.png', '--ao-falloff', 'linear'], 1),
                           (['-o', self.out / 'm.png', '--per-vertex'], 1), (['-o', self.out / 'v.glb', '--per-vertex', '--attribute', 'AO'], 1),
                           (['-o', model], 1)):
            r = self.run('ao', model, *args, exit=code)
            self.expect(len(r.stderr.strip().splitlines()) == 1, f'{args}: {r.stderr}')
        self.expect((self.out / 'm.png').read_bytes() == old, 'a refused run changed an old file')
        self.run('ao', self.samples / 'nothing.glb', '-o', self.out / 'm.png', exit=2)

    def references(self, shared):
        for scene, errors in (('cornell', (0.01, 0.003)), ('direct_only', (0.01, 0.003)), ('courtyard', (0.01,)), ('two_rooms', (0.01,))):
            ref = load_npz(shared / 'references' / f'{scene}.npz')
            n = len(ref['x'])
            # Where direct light changes within a texel, a reference at its middle says nothing of its mean.
            mean = sum(ref['E_direct']) / (3 * n)
            keep = []
            for i in range(n):
                off = sum(abs(ref['E_direct_box'][3 * i + c] - ref['E_direct'][3 * i + c]) for c in range(3)) / 3
                noise = math.sqrt(sum(ref['stderr_direct'][3 * i + c] ** 2 + ref['stderr_box'][3 * i + c] ** 2 for c in range(3)) / 3)
                if off <= 0.02 * abs(mean) + 4 * noise:
                    keep.append(i)
            for error in errors:
                out = self.out / f'{scene}_{error}'
                self.run('bake', shared / 'scenes' / f'{scene}.glb', '-o', out, '--effects', 'ao', '--ao-error', error, '--progress', 'none')
                report = json.loads((out / 'report.json').read_text())
                width = report['maps'][0]['width']
                for channel, name in (('Y', 'ao_cosine'), ('uniform.Y', 'ao_uniform')):
                    got = self.channel(out / 'ao.exr', channel)
                    square = sum((got[int(ref['y'][i]) * width + int(ref['x'][i])] - ref[name][i]) ** 2 - ref[name + '_stderr'][i] ** 2 for i in keep)
                    true = math.sqrt(max(0.0, square / len(keep)))
                    print(f'{scene}: --ao-error {error}: {name} {true:.4f}, stated {report["ao"]["error"]:.4f}, {report["ao"]["rays"]} rays')
                    self.expect(true <= ALLOWED[error], f'{scene}: {name} is off by {true}, {error} asked for')
                    # What is stated is the larger of both weightings' errors.
                    self.expect(true <= HONEST * max(report['ao']['error'], BOTH_SMALL / HONEST), f'{scene}: {name} is off by {true}, {report["ao"]["error"]} stated')


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--dump', required=True)
    ap.add_argument('--source-dir', required=True)
    ap.add_argument('--shared')
    a = ap.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        test = Test(a, folder)
        if a.shared:
            if not (pathlib.Path(a.shared) / 'scenes').is_dir():
                print('left out: no reference scenes beside the project')
                return 77
            test.references(pathlib.Path(a.shared))
        else:
            test.bakes()
            test.closedRoom()
            test.models()
            test.nodes()
            test.refusals()
    print('\n'.join(test.bad) or 'openness as promised')
    return 1 if test.bad else 0


if __name__ == '__main__':
    sys.exit(main())
