#!/usr/bin/env python3
"""lmc shade and lmc check-shader as a user meets them.

    shade_test.py --lmc BUILD/bin/lmc --dump BUILD/tests/bin/exr_dump --osmesa-without-gl BUILD/tests/bin/libosmesa_without_gl.so --source-dir SOURCE
                  [unittest's own arguments]
"""
import argparse
import array
import json
import math
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

OPTIONS = None
EXPOSURE = 0.75
# Half floats keep 11 bits: the map's texels and the picture's pixels are each off by 1/2048 at most. The promise is 0.5 %.
PROMISE = 0.005


def lmc(*arguments, code=0, **more):
    done = subprocess.run([OPTIONS.lmc, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=600, **more)
    if code is not None and done.returncode != code:
        raise AssertionError(f'exit code {done.returncode}, not {code}: {done.stderr}')
    return done


def read_exr(path):
    raw = subprocess.run([OPTIONS.dump, str(path), 'R', 'G', 'B'], check=True, capture_output=True).stdout
    end = raw.index(b'\n')
    w, h = map(int, raw[:end].split())
    data = array.array('f', raw[end + 1:])
    return w, h, [data[c * w * h:(c + 1) * w * h] for c in range(3)]


class Level:
    """Triangles of a baked level.glb in the world: corners, map UVs, albedo. Its nodes have no transforms but translations."""

    def __init__(self, path):
        data = pathlib.Path(path).read_bytes()
        size = struct.unpack_from('<I', data, 12)[0]
        self.json = json.loads(data[20:20 + size])
        self.binary = data[28 + size:]
        self.triangles = []
        for node in self.json['nodes']:
            lightmap = node.get('extras', {}).get('lmc', {}).get('lightmap')
            if 'mesh' not in node or lightmap is None:
                continue
            assert not {'rotation', 'scale', 'matrix'} & set(node), 'this reader knows translations alone'
            move = node.get('translation', [0, 0, 0])
            for p in self.json['meshes'][node['mesh']]['primitives']:
                at = [[a + b for a, b in zip(v, move)] for v in self.accessor(p['attributes']['POSITION'])]
                uv = self.accessor(p['attributes'][f"TEXCOORD_{lightmap['texCoord']}"])
                pbr = self.json['materials'][p['material']]['pbrMetallicRoughness']
                albedo = [c * (1 - pbr.get('metallicFactor', 1)) for c in pbr['baseColorFactor'][:3]]
                emits = any(self.json['materials'][p['material']].get('emissiveFactor', [0]))
                index = [i[0] for i in self.accessor(p['indices'])]
                for t in range(0, len(index), 3):
                    corners = index[t:t + 3]
                    self.triangles.append(([at[c] for c in corners], [uv[c] for c in corners], albedo, emits))

    def accessor(self, number):
        a = self.json['accessors'][number]
        view = self.json['bufferViews'][a['bufferView']]
        code = {5121: 'B', 5123: 'H', 5125: 'I', 5126: 'f'}[a['componentType']]
        count = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}[a['type']]
        stride = view.get('byteStride', struct.calcsize(code) * count)
        start = view.get('byteOffset', 0) + a.get('byteOffset', 0)
        return [struct.unpack_from(f'<{count}{code}', self.binary, start + i * stride) for i in range(a['count'])]

    def hit(self, origin, direction):
        """The nearest front face: (map uv, albedo, emits, smallest weight of a corner), or None."""
        best = None
        for corners, uv, albedo, emits in self.triangles:
            e1, e2 = minus(corners[1], corners[0]), minus(corners[2], corners[0])
            p = cross(direction, e2)
            det = dot(e1, p)
            if det <= 0:        # a back
                continue
            s = minus(origin, corners[0])
            b1 = dot(s, p) / det
            q = cross(s, e1)
            b2, t = dot(direction, q) / det, dot(e2, q) / det
            if b1 < 0 or b2 < 0 or b1 + b2 > 1 or t <= 0 or (best and t >= best[0]):
                continue
            weights = (1 - b1 - b2, b1, b2)
            best = (t, [sum(w * u[k] for w, u in zip(weights, uv)) for k in range(2)], albedo, emits, min(weights))
        return best and best[1:]


def minus(a, b): return [x - y for x, y in zip(a, b)]
def dot(a, b): return sum(x * y for x, y in zip(a, b))
def cross(a, b): return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
def unit(a): return [x / math.sqrt(dot(a, a)) for x in a]


def bilinear(image, uv):
    w, h, channels = image
    x, y = uv[0] * w - 0.5, uv[1] * h - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    at = lambda c, i, j: c[min(max(j, 0), h - 1) * w + min(max(i, 0), w - 1)]
    return [(1 - fy) * ((1 - fx) * at(c, x0, y0) + fx * at(c, x0 + 1, y0)) + fy * ((1 - fx) * at(c, x0, y0 + 1) + fx * at(c, x0 + 1, y0 + 1))
            for c in channels]


class Case(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder, True)

    def sample(self, name):
        return os.path.join(OPTIONS.source_dir, 'samples', name)

    def bake(self, name):
        out = self.folder / 'out'
        lmc('bake', self.sample(name), '-o', out, '--preset', 'draft', '--progress', 'none')
        return out

    def shaders(self, **changes):
        """A folder with copies of shaders: name with __ for / and the dot -> (text, its replacement)."""
        mine = self.folder / 'mine'
        for name, (old, new) in changes.items():
            path = name.replace('__', '/').replace('_dot_', '.')
            text = pathlib.Path(OPTIONS.source_dir, 'shaders', path).read_text()
            self.assertIn(old, text)
            (mine / path).parent.mkdir(parents=True, exist_ok=True)
            (mine / path).write_text(text.replace(old, new))
        return mine


class Shade(Case):
    def pixels_are_albedo_times_e_over_pi(self, name, eye, target, fov):
        out = self.bake(name)
        w, h = 60, 44
        picture = self.folder / 'picture.exr'
        lmc('shade', out, '-o', picture, '--camera', ','.join(map(str, [*eye, *target, fov])), '--width', w, '--height', h, '--exposure', EXPOSURE)
        got, light, level = read_exr(picture), read_exr(out / 'lightmap.exr'), Level(out / 'level.glb')
        back = unit(minus(eye, target))
        right = unit(cross([0, 1, 0], back))
        up = cross(back, right)
        half = math.tan(math.radians(fov) / 2)
        seen = 0
        for y in range(h):
            for x in range(w):
                sx, sy = (2 * (x + 0.5) / w - 1) * half * w / h, (1 - 2 * (y + 0.5) / h) * half
                hit = level.hit(list(eye), [sx * right[k] + sy * up[k] - back[k] for k in range(3)])
                if not hit or hit[2] or hit[3] < 1e-3:      # nothing, a lamp, or an edge whose side is a matter of rounding
                    continue
                seen += 1
                e = bilinear(light, hit[0])
                for c in range(3):
                    want, is_ = hit[1][c] * e[c] / math.pi * EXPOSURE, got[2][c][y * w + x]
                    self.assertLessEqual(abs(is_ - want), PROMISE * want + 1e-6, f'{name}, pixel {x},{y}, channel {c}: {is_} for {want}')
        self.assertGreater(seen, w * h / 2)

    def test_cornell(self):
        self.pixels_are_albedo_times_e_over_pi('cornell.glb', (2.7, 2.8, 12.0), (2.8, 2.6, -2.8), 30)

    def test_two_rooms(self):
        self.pixels_are_albedo_times_e_over_pi('two_rooms.glb', (0.5, 2.0, 3.2), (3.4, 0.6, 0.6), 70)

    def test_every_view_draws_as_png_and_exr_and_the_oracle_agrees(self):
        out = self.bake('textured.gltf')
        views = ('final', 'radiance', 'diffuse', 'ao', 'specular', 'power', 'normal', 'depth', 'lightmap', 'emission', 'ambient', 'diffuse-light',
                 'specular-light')
        for view in views:
            pictures = [self.folder / f'{view}{k}.png' for k in range(2)]
            for picture, how in zip(pictures, ([], ['--oracle'])):
                lmc('shade', out, '-o', picture, '--view', view, '--width', 48, '--height', 36, '--exposure', '0.3', *how)
            figures = json.loads(lmc('compare', *pictures, '--json').stdout)
            means = [c['mean'] for c in figures['channels']]
            self.assertLess(max(means), 1e-3, f'{view}: {figures}')
            lmc('shade', out, '-o', self.folder / 'x.exr', '--view', view, '--width', 8, '--height', 6)

    def test_the_same_bytes_every_time(self):
        pictures = [self.folder / f'{k}.png' for k in range(2)]
        for picture in pictures:
            lmc('shade', self.sample('court.glb'), '-o', picture, '--width', 96, '--height', 64)
        self.assertEqual(pictures[0].read_bytes(), pictures[1].read_bytes())

    def test_without_osmesa_it_ends_with_4_and_bakes_and_draws_in_cpp_all_the_same(self):
        nothing = dict(os.environ, LMC_OSMESA='libNoSuchOSMesa.so.8')
        self.assert_no_picture(nothing, 'libNoSuchOSMesa.so.8')
        lmc('bake', self.sample('furnace.glb'), '-o', self.folder / 'out', '--preset', 'draft', '--progress', 'none', env=nothing)
        lmc('shade', self.folder / 'out', '-o', self.folder / 'x.png', '--oracle', '--width', 16, '--height', 12, env=nothing)

    def test_an_osmesa_without_functions_or_without_gl_3_3_is_none(self):
        # Found as the loader finds any library; a display is not asked for.
        bare = {name: value for name, value in os.environ.items() if name not in ('DISPLAY', 'WAYLAND_DISPLAY', 'XDG_RUNTIME_DIR')}
        for library, words in ((OPTIONS.osmesa_without_gl, 'gives no GL 3.3 core context'), ('libm.so.6', 'has no OSMesaCreateContextAttribs')):
            self.assert_no_picture(dict(bare, LMC_OSMESA=library), words)
        path = self.folder / 'libraries'
        path.mkdir()
        (path / 'libOSMesa.so.8').symlink_to(OPTIONS.osmesa_without_gl)
        without = dict(bare, LD_LIBRARY_PATH=f'{path}:{os.environ.get("LD_LIBRARY_PATH", "")}')
        self.assert_no_picture(without, 'gives no GL 3.3 core context')
        for out, env in (('with', os.environ), ('without', without)):
            lmc('bake', self.sample('furnace.glb'), '-o', self.folder / out, '--preset', 'draft', '--progress', 'none', env=env)
        for name in ('lightmap.exr', 'ao.exr', 'level.glb', 'level.lmc.json'):
            self.assertEqual((self.folder / 'with' / name).read_bytes(), (self.folder / 'without' / name).read_bytes(), name)

    def assert_no_picture(self, env, words):
        done = lmc('shade', self.sample('court.glb'), '-o', self.folder / 'x.png', code=4, env=env)
        self.assertIn(words, done.stderr)
        self.assertIn('libosmesa6', done.stderr)
        self.assertIn('[LMC_OSMESA]', done.stderr)
        self.assertFalse((self.folder / 'x.png').exists())

    def test_wrong_wishes_are_refused(self):
        lmc('shade', self.sample('court.glb'), '-o', self.folder / 'x.jpg', code=1)
        lmc('shade', self.sample('court.glb'), '-o', self.folder / 'x.png', '--camera', '1,2,3', code=1)
        lmc('shade', self.sample('court.glb'), '-o', self.folder / 'x.png', '--view', 'beautiful', code=1)
        lmc('shade', self.folder / 'nowhere', '-o', self.folder / 'x.png', code=2)


class CheckShader(Case):
    def test_a_copy_is_the_same(self):
        mine = self.shaders(deferred__point_dot_frag=('//', '//'))
        picture = self.folder / 'difference.png'
        done = lmc('check-shader', '--shader-dir', mine, self.sample('two_rooms.glb'), '-o', picture)
        self.assertIn('point', done.stdout)
        self.assertFalse(picture.exists())

    def test_a_fault_is_named_measured_and_shown_on_a_baked_level(self):
        out = self.bake('two_rooms.glb')
        mine = self.shaders(deferred__lightmap_dot_frag=('s.illuminance * kInvPi', 's.illuminance'))
        picture = self.folder / 'difference.png'
        done = lmc('check-shader', '--shader-dir', mine, out, '-o', picture, '--json', code=7)
        report = json.loads(done.stdout)
        self.assertFalse(report['same'])
        self.assertEqual([p['pass'] for p in report['passes']], ['lightmap'])
        self.assertEqual(report['passes'][0]['fault']['name'], 'pi')
        self.assertEqual(picture.read_bytes()[:8], b'\x89PNG\r\n\x1a\n')
        done = lmc('check-shader', '--shader-dir', mine, out, '-o', picture, code=7)
        self.assertIn('1/pi is missing', done.stdout)
        lmc('check-shader', '--shader-dir', mine, out, '-o', picture, '--max-diff', '1000')

    def test_an_error_of_the_compiler_names_file_and_line(self):
        mine = self.shaders(deferred__spot_dot_frag=('float distance = length', 'float distance = lenght'))
        done = lmc('check-shader', '--shader-dir', mine, self.sample('two_rooms.glb'), code=3)
        text = (mine / 'deferred/spot.frag').read_text().splitlines()
        line = 1 + next(i for i, l in enumerate(text) if 'lenght' in l)
        self.assertIn(f'{mine}/deferred/spot.frag:{line}: error:', done.stderr)
        self.assertIn('lenght', done.stderr)

    def test_a_folder_that_replaces_nothing_is_refused(self):
        (self.folder / 'mine').mkdir()
        (self.folder / 'mine' / 'readme.txt').write_text('nothing')
        (self.folder / 'mine' / 'pointlight.frag').write_text('void main() {}')
        done = lmc('check-shader', '--shader-dir', self.folder / 'mine', self.sample('two_rooms.glb'), code=1)
        self.assertIn('pointlight.frag: warning:', done.stderr)
        lmc('check-shader', '--shader-dir', self.folder / 'nowhere', self.sample('two_rooms.glb'), code=2)


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    for name in ('--lmc', '--dump', '--osmesa-without-gl', '--source-dir'):
        parser.add_argument(name, required=True)
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.lmc, OPTIONS.dump, OPTIONS.osmesa_without_gl, OPTIONS.source_dir = (
        os.path.abspath(p) for p in (OPTIONS.lmc, OPTIONS.dump, OPTIONS.osmesa_without_gl, OPTIONS.source_dir))
    unittest.main(argv=[sys.argv[0]] + rest)
