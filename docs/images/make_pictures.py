#!/usr/bin/env python3
"""Draws the pictures of docs/shaders.md again: make_pictures.py BUILD/bin/lmc. Nothing but Python's standard library."""
import json, math, pathlib, struct, subprocess, sys, tempfile, zlib

HERE = pathlib.Path(__file__).resolve().parent
SAMPLES = HERE.parent.parent / 'samples'
SIZE = ('--width', '300', '--height', '200')


def chunk(tag, data): return struct.pack('>I', len(data)) + tag + data + struct.pack('>I', zlib.crc32(tag + data))


def write_png(path, width, rows, grey=False):
    """Rows of bytes, RGB or grey; each row goes out as its difference from the row above, which packs best."""
    filtered, above = b'', bytes(len(rows[0]))
    for row in rows:
        filtered += b'\2' + bytes((a - b) & 255 for a, b in zip(row, above))
        above = row
    header = struct.pack('>IIBBBBB', width, len(rows), 8, 0 if grey else 2, 0, 0, 0)
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(filtered, 9)) + chunk(b'IEND', b''))


def read_png(path):
    """Width and rows of an RGB picture as lmc writes it."""
    data, at, packed, width = path.read_bytes(), 8, b'', 0
    while at < len(data):
        size, tag = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        at += 12 + size
        if tag == b'IHDR':
            width = struct.unpack('>I', body[:4])[0]
        if tag == b'IDAT':
            packed += body
    raw, stride, rows = zlib.decompress(packed), 3 * width, []
    above = bytearray(stride)
    for start in range(0, len(raw), stride + 1):
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + stride])
        for x in range(stride):
            left, up, corner = (row[x - 3] if x >= 3 else 0), above[x], (above[x - 3] if x >= 3 else 0)
            guess = left + up - corner
            paeth = min((left, up, corner), key=lambda v: abs(guess - v))
            row[x] = (row[x] + (0, left, up, (left + up) // 2, paeth)[kind]) & 255
        rows.append(bytes(row))
        above = row
    return width, rows


def beside(path, pictures):
    read = [read_png(p) for p in pictures]
    gap = bytes([255] * 12)
    write_png(path, sum(w for w, _ in read) + 4 * (len(read) - 1), [gap.join(rows[y] for _, rows in read) for y in range(len(read[0][1]))])
    print(path.name, path.stat().st_size)


def edit_glb(source, target, change):
    data = source.read_bytes()
    size = struct.unpack_from('<I', data, 12)[0]
    doc = json.loads(data[20:20 + size])
    change(doc)
    text = json.dumps(doc).encode()
    text += b' ' * (-len(text) % 4)
    rest = data[20 + size:]
    target.write_bytes(struct.pack('<4sIII4s', b'glTF', 2, 20 + len(text) + len(rest), len(text), b'JSON') + text + rest)


def glossy(doc):
    """Specular surfaces and a global ambient, which the samples have not."""
    for m in doc['materials']:
        m['pbrMetallicRoughness']['roughnessFactor'] = 0.3
        m.setdefault('extensions', {})['KHR_materials_specular'] = {'specularColorFactor': [6, 6, 6]}
    doc['scenes'][0].setdefault('extras', {}).setdefault('lmc', {})['ambient'] = [0.7, 0.8, 1.0]


def dome_heights(side=128, domes=3):
    rows = []
    for y in range(side):
        row = bytearray()
        for x in range(side):
            u, v = ((c + 0.5) / side * domes % 1.0 - 0.5 for c in (x, y))
            row.append(round(255 * math.sqrt(max(0.0, 1.0 - (u * u + v * v) / 0.14))))
        rows.append(bytes(row))
    return rows


def bumpy_panels(folder, lmc):
    """Two squares with one normal map, side by side; U of the right one runs to the left."""
    write_png(folder / 'heights.png', 128, dome_heights(), grey=True)
    subprocess.run([lmc, 'normals', '--from', folder / 'heights.png', '--scale', '0.12', '-o', folder / 'normals.png'], check=True, capture_output=True)
    quad = lambda x: [(x, 0, 0), (x + 1, 0, 0), (x + 1, 1, 0), (x, 1, 0)]
    floats = lambda values: b''.join(struct.pack(f'<{len(v)}f', *v) for v in values)
    parts = [floats(quad(0)), floats(quad(1.06)), floats([(0, 0, 1)] * 4), floats([(0, 1), (1, 1), (1, 0), (0, 0)]),
             floats([(1, 1), (0, 1), (0, 0), (1, 0)]), struct.pack('<6H', 0, 1, 2, 0, 2, 3)]
    views, at = [], 0
    for p in parts:
        views.append({'buffer': 0, 'byteOffset': at, 'byteLength': len(p)})
        at += len(p)
    (folder / 'panels.bin').write_bytes(b''.join(parts))
    accessor = lambda view, kind, count=4, code=5126: {'bufferView': view, 'componentType': code, 'count': count, 'type': kind}
    mesh = lambda position, uv: {'primitives': [{'attributes': {'POSITION': position, 'NORMAL': 2, 'TEXCOORD_0': uv}, 'indices': 5, 'material': 0}]}
    doc = {'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0, 1, 2]}], 'extensionsUsed': ['KHR_lights_punctual'],
           'nodes': [{'mesh': 0}, {'mesh': 1}, {'rotation': [-0.35, -0.25, 0.0, 0.9], 'extensions': {'KHR_lights_punctual': {'light': 0}}}],
           'meshes': [mesh(0, 3), mesh(1, 4)], 'buffers': [{'byteLength': at, 'uri': 'panels.bin'}], 'bufferViews': views,
           'accessors': [accessor(0, 'VEC3'), accessor(1, 'VEC3'), accessor(2, 'VEC3'), accessor(3, 'VEC2'), accessor(4, 'VEC2'), accessor(5, 'SCALAR', 6, 5123)],
           'images': [{'uri': 'normals.png'}], 'textures': [{'source': 0}],
           'materials': [{'normalTexture': {'index': 0}, 'pbrMetallicRoughness': {'baseColorFactor': [0.75, 0.7, 0.6, 1], 'metallicFactor': 0, 'roughnessFactor': 0.5}}],
           'extensions': {'KHR_lights_punctual': {'lights': [{'type': 'directional', 'intensity': 3.0}]}}}
    doc['nodes'][2]['rotation'] = [c / math.sqrt(sum(v * v for v in doc['nodes'][2]['rotation'])) for c in doc['nodes'][2]['rotation']]
    for k, corners in ((0, quad(0)), (1, quad(1.06))):
        doc['accessors'][k].update(min=[min(c[i] for c in corners) for i in range(3)], max=[max(c[i] for c in corners) for i in range(3)])
    (folder / 'panels.gltf').write_text(json.dumps(doc))
    return folder / 'panels.gltf'


def main():
    lmc = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)

        def shade(level, picture, *how):
            subprocess.run([lmc, 'shade', level, '-o', folder / picture, *SIZE, *map(str, how)], check=True, capture_output=True)
            return folder / picture

        edit_glb(SAMPLES / 'curved.glb', folder / 'glossy.glb', glossy)
        baked = folder / 'baked'
        subprocess.run([lmc, 'bake', folder / 'glossy.glb', '-o', baked, '--preset', 'level', '--progress', 'none'], check=True, capture_output=True)
        at = ('--exposure', 0.12)
        beside(HERE / 'shade_light_map.png', [shade(baked, 'a.png', *at, '--no-light-map', '--ao', 'off'), shade(baked, 'b.png', '--exposure', 0.08, '--view', 'lightmap'),
                                              shade(baked, 'c.png', *at)])
        ambient = ('--no-light-map', '--view', 'final', '--exposure', 1.0)
        edit_glb(folder / 'glossy.glb', folder / 'ambient.glb', lambda doc: doc['extensions']['KHR_lights_punctual']['lights'][0].update(intensity=1e-3))
        bake_ao = folder / 'ao'
        subprocess.run([lmc, 'bake', folder / 'ambient.glb', '-o', bake_ao, '--preset', 'draft', '--ao-distance', '0.7', '--progress', 'none'], check=True, capture_output=True)
        beside(HERE / 'shade_ao.png', [shade(bake_ao, f'{kind}.png', *ambient, '--ao', kind) for kind in ('off', 'baked', 'screen')])
        panels, camera = bumpy_panels(folder, lmc), ('--camera', '1.03,0.5,1.75,1.03,0.5,0,46', '--exposure', 1.3)
        beside(HERE / 'shade_normal_map.png', [shade(panels, 'd.png', *camera, '--no-normal-maps'), shade(panels, 'e.png', *camera)])
        beside(HERE / 'shade_determinant.png', [shade(panels, 'f.png', *camera, '--ignore-determinant'), shade(panels, 'g.png', *camera)])


if __name__ == '__main__':
    main()
