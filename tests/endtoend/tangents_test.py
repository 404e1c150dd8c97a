#!/usr/bin/env python3
"""lmc tangents: written where a normal map calls for them, vertices split, the rest of the file kept. With --shared: NormalTangentMirrorTest against
the tangents that it comes with."""
import argparse, base64, json, math, pathlib, struct, subprocess, sys, tempfile


def read_glb(file):
    b = file.read_bytes()
    length = struct.unpack_from('<I', b, 12)[0]
    return json.loads(b[20:20 + length]), b[28 + length:]


def read(doc, data, accessor):
    a = doc['accessors'][accessor]
    v = doc['bufferViews'][a['bufferView']]
    n = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}[a['type']]
    kind, size = {5126: ('f', 4), 5125: ('I', 4), 5123: ('H', 2), 5121: ('B', 1)}[a['componentType']]
    start, stride = v.get('byteOffset', 0) + a.get('byteOffset', 0), v.get('byteStride', n * size)
    return [struct.unpack_from(f'<{n}{kind}', data, start + i * stride) for i in range(a['count'])]


def corners(doc, data, primitive, name):
    values = read(doc, data, primitive['attributes'][name])
    return [values[i[0]] for i in read(doc, data, primitive['indices'])]


def sheet():
    """Two squares side by side that share an edge; U grows towards it from both: the right one is mirrored. Normals +Z, V down."""
    positions = [(x, y, 0) for y in (1, 0) for x in (0, 1, 2)]
    uvs = [(1 - abs(x - 1), 1 - y) for y in (1, 0) for x in (0, 1, 2)]
    triangles = [(0, 3, 1), (1, 3, 4), (1, 4, 2), (2, 4, 5)]
    parts = [struct.pack('<18f', *sum(positions, ())), struct.pack('<18f', *(0, 0, 1) * 6), struct.pack('<12f', *sum(uvs, ())),
             struct.pack('<12H', *sum(triangles, ()))]
    views, data = [], b''
    for p in parts:
        views.append({'buffer': 0, 'byteOffset': len(data), 'byteLength': len(p)})
        data += p
    kinds = [(5126, 6, 'VEC3'), (5126, 6, 'VEC3'), (5126, 6, 'VEC2'), (5123, 12, 'SCALAR')]
    attributes = {'POSITION': 0, 'NORMAL': 1, 'TEXCOORD_0': 2}
    png = base64.b64decode('iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==')
    return {
        'asset': {'version': '2.0', 'extras': {'kept': [1, 2]}}, 'scene': 0, 'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0, 'name': 'sheet'}],
        'extensionsUsed': ['VENDOR_unknown'], 'extensions': {'VENDOR_unknown': {'value': 7}},
        'meshes': [{'primitives': [{'attributes': attributes, 'indices': 3, 'material': 0, 'extras': {'own': True}},
                                   {'attributes': attributes, 'indices': 3, 'material': 1}]}],
        'materials': [{'normalTexture': {'index': 0}}, {'name': 'plain'}], 'textures': [{'source': 0}],
        'images': [{'uri': 'data:image/png;base64,' + base64.b64encode(png).decode()}],
        'accessors': [{'bufferView': i, 'componentType': c, 'count': n, 'type': t, **({'min': [0, 0, 0], 'max': [2, 1, 0]} if i == 0 else {})}
                      for i, (c, n, t) in enumerate(kinds)],
        'bufferViews': views, 'buffers': [{'byteLength': len(data), 'uri': 'data:application/octet-stream;base64,' + base64.b64encode(data).decode()}],
    }


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--shared')
    a = ap.parse_args()
    bad = []

    def expect(what, holds, more=''):
        if not holds:
            bad.append(f'{what} {more}')

    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder, 'out.glb')

        def run(file, *args):
            return subprocess.run([a.lmc, 'tangents', str(file), '-o', str(out), *args], capture_output=True, text=True)

        if a.shared:
            model = pathlib.Path(a.shared, 'assets', 'NormalTangentMirrorTest')
            files = sorted(model.glob('**/*.glb'))
            if not files:
                print('left out: no NormalTangentMirrorTest beside the project')
                return 77
            stored_doc, stored_data = read_glb(files[0])
            r = run(files[0], '--regenerate')
            expect('exit code', r.returncode == 0, r.stderr)
            doc, data = read_glb(out)
            angles, signs, count = [], 0, 0
            for mesh, stored_mesh in zip(doc['meshes'], stored_doc['meshes']):
                for p, q in zip(mesh['primitives'], stored_mesh['primitives']):
                    if 'TANGENT' not in q['attributes']:
                        continue
                    for mine, theirs in zip(corners(doc, data, p, 'TANGENT'), corners(stored_doc, stored_data, q, 'TANGENT')):
                        # Not by the cosine: 0.02 degrees off, it is 6e-8 below 1, less than the length of a float vector is off.
                        m, t = mine[:3], theirs[:3]
                        cross = [m[1] * t[2] - m[2] * t[1], m[2] * t[0] - m[0] * t[2], m[0] * t[1] - m[1] * t[0]]
                        angles.append(math.degrees(math.atan2(math.hypot(*cross), sum(x * y for x, y in zip(m, t)))))
                        signs += mine[3] != theirs[3]
            angles.sort()
            print(f'{len(angles)} corners, p99 {angles[len(angles) * 99 // 100]:.4f} degrees, {signs} determinants differ')
            expect('angle', angles[len(angles) * 99 // 100] < 0.02)
            expect('determinants', signs == 0)
        else:
            source = pathlib.Path(folder, 'in.gltf')
            source.write_text(json.dumps(sheet()))
            r = run(source, '--json')
            expect('exit code', r.returncode == 0, r.stderr)
            report = json.loads(r.stdout)
            first, second = report['primitives']
            expect('computed and skipped', first['result'] == 'computed' and second['result'] == 'skipped' and 'normal map' in second['why'], r.stdout)
            expect('the mirror line is split', (first['vertices_before'], first['vertices_after']) == (6, 8), r.stdout)
            doc, data = read_glb(out)
            p = doc['meshes'][0]['primitives'][0]
            places, tangents = corners(doc, data, p, 'POSITION'), corners(doc, data, p, 'TANGENT')
            for i, (place, tangent) in enumerate(zip(places, tangents)):
                left = i < 6
                expect('tangent', tangent == ((1, 0, 0, 1) if left else (-1, 0, 0, -1)), f'{i} {place} {tangent}')
            expect('triangles as they were', places == corners(doc, data, doc['meshes'][0]['primitives'][1], 'POSITION'))
            expect('unknown things stay', doc['extensions'] == {'VENDOR_unknown': {'value': 7}} and doc['asset']['extras'] == {'kept': [1, 2]} and
                   p['extras']['own'] is True and p['extras']['lmc']['tangents']['green'] == 'up' and doc['nodes'][0]['name'] == 'sheet')
            expect('nothing is written where nothing calls for it', 'TANGENT' not in doc['meshes'][0]['primitives'][1]['attributes'])
            first_bytes = out.read_bytes()
            run(source, '-j', '1')
            expect('same bytes for other threads', out.read_bytes() == first_bytes)
            run(source, '--green', 'down')
            doc, data = read_glb(out)
            p = doc['meshes'][0]['primitives'][0]
            expect('green down', [t[3] for t in corners(doc, data, p, 'TANGENT')] == [-1] * 6 + [1] * 6 and p['extras']['lmc']['tangents']['green'] == 'down')
            made = pathlib.Path(folder, 'made.glb')
            made.write_bytes(first_bytes)
            r = run(made)
            expect('supplied ones are kept', '1 kept' in r.stdout and not r.stderr, r.stdout + r.stderr)
            r = run(made, '--all', '--regenerate')
            expect('--all', '2 computed' in r.stdout, r.stdout)
            expect('no file', run(pathlib.Path(folder, 'nowhere.glb')).returncode == 2)
            expect('no such way', run(source, '--green', 'left').returncode == 1)
    print('\n'.join(bad) or 'all as it should be')
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
