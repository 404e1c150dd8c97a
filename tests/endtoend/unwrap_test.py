#!/usr/bin/env python3
"""lmc unwrap, info and attach, and bakes of levels without map UVs, judged from outside: the GLB is read by this script, overlaps are decided in
whole numbers, and every model of ../shared/assets (left out where it is not there) is unwrapped and baked under a constant sky."""
import argparse, base64, json, pathlib, struct, subprocess, sys, tempfile, unittest
from collections import defaultdict

OPTIONS = None
GRID = 1 << 23                      # map UVs are whole numbers of these parts
TYPES = {5120: 'b', 5121: 'B', 5122: 'h', 5123: 'H', 5125: 'I', 5126: 'f'}
COUNTS = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}
SECONDS = 5000   # ctest's own limit is shorter, but for sanitizers


def lmc(*arguments, code=0):
    done = subprocess.run([OPTIONS.lmc, *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=SECONDS)
    if done.returncode != code:
        raise AssertionError(f'exit {done.returncode}, wanted {code}: {arguments}\n{done.stderr[-1500:]}')
    return done


def read_glb(path):
    data = pathlib.Path(path).read_bytes()
    size = struct.unpack_from('<I', data, 12)[0]
    return json.loads(data[20:20 + size]), data[28 + size:]


def write_glb(path, doc, rest):
    text = json.dumps(doc).encode()
    text += b' ' * (-len(text) % 4)
    body = struct.pack('<I4s', len(rest), b'BIN\0') + rest if rest else b''
    pathlib.Path(path).write_bytes(struct.pack('<4sIII4s', b'glTF', 2, 20 + len(text) + len(body), len(text), b'JSON') + text + body)


def elements(doc, rest, index):
    a = doc['accessors'][index]
    n = COUNTS[a['type']]
    view = doc['bufferViews'][a['bufferView']]
    size = struct.calcsize(TYPES[a['componentType']])
    stride = view.get('byteStride', n * size)
    start = view.get('byteOffset', 0) + a.get('byteOffset', 0)
    form = '<' + str(n) + TYPES[a['componentType']]
    return [struct.unpack_from(form, rest, start + i * stride) for i in range(a['count'])]


def map_triangles(path):
    """(map, three places in whole numbers) of all triangles that have a place in a map, and how many nodes have one."""
    doc, rest = read_glb(path)
    out, nodes = [], 0
    for node in doc['nodes']:
        extras = node.get('extras')
        mark = extras.get('lmc', {}).get('lightmap') if isinstance(extras, dict) else None
        if not mark or 'mesh' not in node:
            continue
        nodes += 1
        for p in doc['meshes'][node['mesh']]['primitives']:
            if p.get('mode', 4) != 4:
                continue
            uv = elements(doc, rest, p['attributes'][f'TEXCOORD_{mark["texCoord"]}'])
            places = []
            for u, v in uv:
                x, y = u * GRID, v * GRID
                assert x == int(x) and y == int(y) and 0 <= x <= GRID and 0 <= y <= GRID, (u, v)
                places.append((int(x), int(y)))
            index = [i[0] for i in elements(doc, rest, p['indices'])]
            for k in range(0, len(index) - 2, 3):
                out.append((mark.get('map', 0), tuple(places[i] for i in index[k:k + 3])))
    return out, nodes


def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def apart(s, t):
    """An edge of s, which runs counter-clockwise, has all of t on its other side."""
    return any(all(turn(s[k], s[(k + 1) % 3], q) <= 0 for q in t) for k in range(3))


def faults(triangles):
    """Triangles that lie on their backs, and pairs of them with inner points in common: exact, by cells of a grid."""
    flipped, cells, seen, overlaps = 0, defaultdict(list), set(), 0
    placed = []
    for m, t in triangles:
        area = turn(*t)
        flipped += area < 0
        if area > 0:
            placed.append((m, t))
    side = GRID // max(8, min(512, int(len(placed) ** 0.5)))
    for i, (m, t) in enumerate(placed):
        xs, ys = [p[0] for p in t], [p[1] for p in t]
        for x in range(min(xs) // side, (max(xs) - 1) // side + 1):
            for y in range(min(ys) // side, (max(ys) - 1) // side + 1):
                for j in cells[m, x, y]:
                    if (j, i) in seen:
                        continue
                    o = placed[j][1]
                    if max(p[0] for p in o) <= min(xs) or min(p[0] for p in o) >= max(xs) or max(p[1] for p in o) <= min(ys) or min(p[1] for p in o) >= max(ys):
                        continue
                    seen.add((j, i))
                    overlaps += not apart(t, o) and not apart(o, t)
                cells[m, x, y].append(i)
    return flipped, overlaps


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix='lmc-unwrap-')
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def sample(self, name):
        return pathlib.Path(OPTIONS.source_dir, 'samples', name)

    def bare(self, name):
        """The sample without TEXCOORD_1."""
        doc, rest = read_glb(self.sample(name))
        for mesh in doc['meshes']:
            for p in mesh['primitives']:
                del p['attributes']['TEXCOORD_1']
        write_glb(self.folder / 'bare.glb', doc, rest)
        return self.folder / 'bare.glb'


class Unwrap(Case):
    def test_a_level_without_map_uvs_gets_them(self):
        done = lmc('unwrap', self.bare('two_rooms.glb'), '-o', self.folder / 'new.glb', '--json')
        report = json.loads(done.stdout)
        triangles, nodes = map_triangles(self.folder / 'new.glb')
        self.assertEqual(faults(triangles), (0, 0))
        self.assertGreater(nodes, 0)
        self.assertEqual({o['uv'] for o in report['objects']}, {'made'})
        self.assertEqual(len(triangles), sum(o['triangles'] for o in report['objects']))

    def test_what_is_sound_is_kept(self):
        report = json.loads(lmc('unwrap', self.sample('two_rooms.glb'), '-o', self.folder / 'kept.glb', '--json').stdout)
        self.assertEqual({o['uv'] for o in report['objects']}, {'kept'})
        before, rest = read_glb(self.sample('two_rooms.glb'))
        after, rest_after = read_glb(self.folder / 'kept.glb')
        self.assertEqual(before['meshes'], after['meshes'])
        self.assertEqual(before['accessors'], after['accessors'])
        self.assertEqual(rest, rest_after[:len(rest)])

    def test_unwrapped_levels_are_sound(self):
        lmc('unwrap', self.bare('court.glb'), '-o', self.folder / 'new.glb')
        report = json.loads(lmc('info', self.folder / 'new.glb', '--json').stdout)
        self.assertEqual(report['faults'], 0, report)
        again = json.loads(lmc('unwrap', self.folder / 'new.glb', '-o', self.folder / 'again.glb', '--json').stdout)
        self.assertEqual({o['uv'] for o in again['objects']}, {'kept'})

    def test_text_says_what_the_glb_says(self):
        level = self.bare('two_rooms.glb')
        for name in ('new.glb', 'new.gltf'):
            lmc('unwrap', level, '-o', self.folder / name)
        tables = [json.loads(lmc('info', self.folder / name, '--json').stdout) for name in ('new.glb', 'new.gltf')]
        self.assertEqual(tables[0], tables[1])
        doc = json.loads((self.folder / 'new.gltf').read_text())
        self.assertEqual(base64.b64decode(doc['buffers'][0]['uri'].split(',')[1])[:doc['buffers'][0]['byteLength']],
                         read_glb(self.folder / 'new.glb')[1][:doc['buffers'][0]['byteLength']])

    def test_the_same_bytes_for_any_number_of_threads(self):
        level = self.bare('curved.glb')
        outs = []
        for threads in (1, 2, 5):
            lmc('unwrap', level, '-o', self.folder / 'new.glb', '-j', threads)
            outs.append((self.folder / 'new.glb').read_bytes())
        self.assertTrue(outs[0] == outs[1] == outs[2])

    def test_several_maps(self):
        out = self.folder / 'out'
        lmc('bake', self.bare('two_rooms.glb'), '-o', out, '--preset', 'draft', '--map-size', '64', '--texels-per-metre', '12', '--max-maps', '20')
        sidecar = json.loads((out / 'level.lmc.json').read_text())
        self.assertGreater(len(sidecar['maps']), 1)
        for k, m in enumerate(sidecar['maps']):
            self.assertEqual(m['file'], f'lightmap.{k:03}.exr')
            self.assertTrue((out / m['file']).is_file())
        triangles, _ = map_triangles(out / 'level.glb')
        self.assertEqual(faults(triangles), (0, 0))
        self.assertEqual({m for m, _ in triangles}, set(range(len(sidecar['maps']))))
        lmc('shade', out, '-o', self.folder / 'picture.png', '--width', '64', '--height', '48')
        lmc('bake', self.bare('two_rooms.glb'), '-o', self.folder / 'few', '--map-size', '64', '--texels-per-metre', '200', '--max-maps', '2', code=8)
        self.assertFalse((self.folder / 'few').exists())

    def test_the_input_is_not_overwritten(self):
        level = self.bare('two_rooms.glb')
        before = level.read_bytes()
        lmc('unwrap', level, '-o', level, code=1)
        self.assertEqual(level.read_bytes(), before)


class Info(Case):
    def test_a_table_and_pictures(self):
        done = lmc('info', self.sample('two_rooms.glb'), '--pictures', self.folder / 'pictures')
        self.assertIn('texels/m', done.stdout)
        for name in ('charts.png', 'density.png'):
            self.assertTrue((self.folder / 'pictures' / name).read_bytes().startswith(b'\x89PNG'))

    def test_faults_are_named_object_by_object(self):
        doc, rest = read_glb(self.sample('furnace.glb'))
        for mesh in doc['meshes']:
            for p in mesh['primitives']:
                p['attributes']['TEXCOORD_1'] = p['attributes']['TEXCOORD_0']   # tiles of a metre
        write_glb(self.folder / 'tiled.glb', doc, rest)
        report = json.loads(lmc('info', self.folder / 'tiled.glb', '--json').stdout)
        self.assertEqual(report['faults'], len(report['objects']))
        self.assertTrue(all('outside [0, 1]' in o['fault'] and o['object'] in o['fault'] for o in report['objects']))


class Attach(Case):
    def test_maps_come_to_a_level_that_was_rewritten(self):
        out = self.folder / 'out'
        lmc('bake', self.bare('two_rooms.glb'), '-o', out, '--preset', 'draft')
        # Nodes without names, in another order, without any second set: matched by where their surfaces are.
        doc, rest = read_glb(self.folder / 'bare.glb')
        doc['scenes'][0]['nodes'].reverse()
        for node in doc['nodes']:
            node.pop('name', None)
        write_glb(self.folder / 'rewritten.glb', doc, rest)
        lmc('attach', self.folder / 'rewritten.glb', out, '-o', self.folder / 'lit.glb')
        places = [sorted(map_triangles(p)[0]) for p in (out / 'level.glb', self.folder / 'lit.glb')]
        self.assertEqual(len(places[0]), len(places[1]))
        worst = max(abs(a - b) for s, t in zip(*places) for p, q in zip(sorted(s[1]), sorted(t[1])) for a, b in zip(p, q))
        self.assertLess(worst, GRID / 256 / 50)   # a fiftieth of a texel of a map of 256

    def test_what_cannot_be_matched_is_named(self):
        out = self.folder / 'out'
        lmc('bake', self.sample('furnace.glb'), '-o', out, '--preset', 'draft')
        done = lmc('attach', self.sample('court.glb'), out, '-o', self.folder / 'lit.glb', code=5)
        self.assertIn('gets no light map', done.stderr)


class Assets(Case):
    """Every model unwraps without a flipped triangle or an overlap, and bakes under a constant sky."""

    def test_all(self):
        folder = pathlib.Path(OPTIONS.shared, 'assets')
        if not folder.is_dir():
            self.skipTest('no assets beside the project')
        bad, stretch = [], []
        for model in sorted([*folder.glob('*/*.gltf'), *folder.glob('*/*.glb')]):
            try:
                # Of a million triangles one fill of the map is enough: the exact check is slow here.
                report = json.loads(lmc('unwrap', model, '-o', self.folder / 'new.glb', '--uv', 'new', '--map-size', '512', '--json').stdout)
                stretch.append((report['mean_stretch'], report['charts_placed']))
                if sum(o['triangles'] for o in report['objects']) < 20000:
                    found = faults(map_triangles(self.folder / 'new.glb')[0])
                    if found != (0, 0):
                        bad.append(f'{model.name}: {found[0]} flipped, {found[1]} overlaps')
                if sum(o['triangles'] for o in report['objects']) < 200000:
                    lmc('bake', model, '-o', self.folder / 'out', '--sky', '1,1,1', '--preset', 'draft', '--map-size', '256', '--ao-error', '0.1')
            except AssertionError as e:
                bad.append(f'{model.name}: {e}')
        self.assertEqual(bad, [])
        self.assertLessEqual(sum(s * n for s, n in stretch) / sum(n for _, n in stretch), 1.2)


if __name__ == '__main__':
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--source-dir', required=True)
    ap.add_argument('--shared', default='')
    OPTIONS, left = ap.parse_known_args()
    unittest.main(argv=[sys.argv[0], *left])
