#!/usr/bin/env python3
"""Writes a level of many triangles and many maps: two fields of hilly panels that face each other, with lamps between. Python's standard
library alone; the same bytes on every run.

    make_load.py OUT.glb                                            1 M triangles on 16 panels, for 16 maps of 1024 x 1024
    make_load.py OUT.glb --triangles 10000000 --maps 64 --side 4096

Each panel is a node of its own whose UVs fill a map, and which says that the map is its own. With --unplaced no node says so, as most tools
leave it: lmc then finds them a place (more than 16 maps ask for --max-maps).
"""
import argparse
import array
import json
import math
import struct
import sys

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument('out')
parser.add_argument('--triangles', type=int, default=1_000_000, help='at least so many, a little more')
parser.add_argument('--maps', type=int, default=16)
parser.add_argument('--side', type=int, default=1024, help='of a map [texels]')
parser.add_argument('--lamps', type=int, default=8)
parser.add_argument('--fill', type=float, default=1.0, help="share of a map's side that its panel takes")
parser.add_argument('--baked', type=int, help='so many of the panels have a map, the others only cast shadows [default: all]')
parser.add_argument('--unplaced', action='store_true')
args = parser.parse_args()

PANEL_M = 8.0    # side of a panel
HEIGHT_M = 5.0   # between the fields
HILL_M = 0.6     # of a hill
RANGE_M = 10.0   # of a lamp: each place is lit by some
MARGIN = 4.0 / args.side
PACKED = 0.94    # of a map's side that a panel takes at the density named: two do not fit, one surely does

quads = math.ceil(math.sqrt(args.triangles / (2.0 * args.maps)))  # along a panel's side
across = math.ceil(math.sqrt(args.maps / 2.0))


def place(k):
    """Row, column and which field (0 below, 1 above) of a panel."""
    return k // 2 // across, k // 2 % across, k % 2


def hills(k):
    """Height and slope along one axis at each line of the grid: the surface is a product of both axes' waves."""
    wave = 2.0 * math.pi / PANEL_M
    lines = []
    for i in range(quads + 1):
        x = PANEL_M * i / quads
        a, b = (1 + k % 3) * wave, (2 + k % 5) * wave
        lines.append((x, math.sin(a * x) + 0.3 * math.sin(b * x), a * math.cos(a * x) + 0.3 * b * math.cos(b * x)))
    return lines


blob, views, accessors, meshes, nodes, lights = bytearray(), [], [], [], [], []


def accessor(data, component, kind, size, **more):
    if sys.byteorder == 'big':
        data.byteswap()
    views.append({'buffer': 0, 'byteOffset': len(blob), 'byteLength': len(data) * data.itemsize})
    blob.extend(data.tobytes())
    accessors.append({'bufferView': len(views) - 1, 'componentType': component, 'count': len(data) // size, 'type': kind, **more})
    return len(accessors) - 1


indices = array.array('I')
for j in range(quads):
    for i in range(quads):
        a = j * (quads + 1) + i
        b, c, d = a + 1, a + quads + 1, a + quads + 2
        indices.extend((a, c, b, b, c, d))
INDICES = accessor(indices, 5125, 'SCALAR', 1)

uvs = array.array('f')
for j in range(quads + 1):
    v = MARGIN + (args.fill - 2.0 * MARGIN) * j / quads
    for i in range(quads + 1):
        uvs.extend((MARGIN + (args.fill - 2.0 * MARGIN) * i / quads, v))
UVS = accessor(uvs, 5126, 'VEC2', 2)

for k in range(args.maps):
    positions, normals = array.array('f'), array.array('f')
    lines = hills(k)
    low = high = 0.0
    for z, hz, sz in lines:
        for x, hx, sx in lines:
            y = 0.5 * HILL_M * hx * hz
            nx, nz = -0.5 * HILL_M * sx * hz, -0.5 * HILL_M * hx * sz
            n = 1.0 / math.sqrt(nx * nx + 1.0 + nz * nz)
            positions.extend((x, y, z))
            normals.extend((nx * n, n, nz * n))
            low, high = min(low, y), max(high, y)
    bounds = [struct.unpack('<f', struct.pack('<f', v))[0] for v in (low, high, PANEL_M)]
    attributes = {'POSITION': accessor(positions, 5126, 'VEC3', 3, min=[0.0, bounds[0], 0.0], max=[bounds[2], bounds[1], bounds[2]]),
                  'NORMAL': accessor(normals, 5126, 'VEC3', 3), 'TEXCOORD_1': UVS}
    meshes.append({'primitives': [{'attributes': attributes, 'indices': INDICES, 'material': k % 3}]})
    row, column, field = place(k)
    node = {'name': f'panel{k}', 'mesh': k, 'translation': [PANEL_M * column, 0.0, PANEL_M * row]}
    if args.baked is not None and k >= args.baked:
        node['extras'] = {'lmc': {'receive': False}}
    elif not args.unplaced:
        node['extras'] = {'lmc': {'lightmap': {'texCoord': 1, 'map': k}}}
    if field == 1:  # upside down: turned about x, it lies towards -z of its place
        node.update({'translation': [PANEL_M * column, HEIGHT_M, PANEL_M * (row + 1)], 'rotation': [1.0, 0.0, 0.0, 0.0]})
    nodes.append(node)

rows = math.ceil(args.maps / 2 / across)
for k in range(args.lamps):
    x, z = PANEL_M * across * ((k * 0.618034) % 1.0), PANEL_M * rows * (k + 0.5) / args.lamps
    lights.append({'type': 'point', 'color': [1, 0.9, 0.8], 'intensity': 600.0, 'range': RANGE_M})
    nodes.append({'name': f'lamp{k}', 'translation': [x, 0.5 * HEIGHT_M, z], 'extensions': {'KHR_lights_punctual': {'light': k}}})

gltf = {
    'asset': {'version': '2.0', 'generator': 'make_load.py'}, 'scene': 0,
    'scenes': [{'nodes': list(range(len(nodes))),
                'extras': {'lmc': {'lightmap': {'resolution': args.side, 'texels_per_metre': PACKED * args.side / PANEL_M}}}}],
    'nodes': nodes, 'meshes': meshes,
    'materials': [{'name': name, 'pbrMetallicRoughness': {'baseColorFactor': [*rgb, 1.0], 'metallicFactor': 0.0}}
                  for name, rgb in (('clay', (0.6, 0.4, 0.3)), ('chalk', (0.7, 0.7, 0.7)), ('moss', (0.3, 0.5, 0.3)))],
    'accessors': accessors, 'bufferViews': views, 'buffers': [{'byteLength': len(blob)}],
    'extensions': {'KHR_lights_punctual': {'lights': lights}}, 'extensionsUsed': ['KHR_lights_punctual'],
}
text = json.dumps(gltf, separators=(',', ':')).encode()
text += b' ' * (-len(text) % 4)
blob.extend(b'\0' * (-len(blob) % 4))
with open(args.out, 'wb') as out:
    out.write(struct.pack('<4sIIII4s', b'glTF', 2, 12 + 8 + len(text) + 8 + len(blob), len(text), 0, b'')[:12])
    out.write(struct.pack('<I4s', len(text), b'JSON') + text)
    out.write(struct.pack('<I4s', len(blob), b'BIN\0'))
    out.write(blob)
print(f'{args.maps * quads * quads * 2} triangles, {args.maps} panels')
