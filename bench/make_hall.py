#!/usr/bin/env python3
"""Writes a hall of 40 x 20 x 6 m with columns and many lights: what a light tree is for. Python's standard library alone.

    make_hall.py OUT.glb --lamps 500           point lights on a grid under the ceiling
    make_hall.py OUT.glb --lamps 500 --range 8 --hall 100 50 4      lamps that reach no farther than 8 m, in a hall of that size
    make_hall.py OUT.glb --panels 5000         emissive squares of two triangles each, as large in all as any other number of them
The light in the hall is the same for every number: lamps share 20,000 cd, panels 8 m^2 of 2,000 cd/m^2.
"""
import argparse
import json
import math
import struct

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument('out')
parser.add_argument('--lamps', type=int, default=0)
parser.add_argument('--panels', type=int, default=0)
parser.add_argument('--range', type=float, default=0.0, help='of each lamp [m]; 0: endless')
parser.add_argument('--hall', type=float, nargs=3, default=[40.0, 20.0, 6.0], metavar=('W', 'D', 'H'), help='[m]')
args = parser.parse_args()

W, D, H = args.hall
MAP = 512
DENSITY = 7.0 * math.sqrt(40.0 * 20.0 / (W * D))  # texels per metre
GAP = 4


class Shelf:
    """Rows of rectangles in the map."""

    def __init__(self):
        self.x, self.y, self.row = GAP, GAP, 0

    def place(self, w, h):
        w, h = max(2, math.ceil(w * DENSITY)), max(2, math.ceil(h * DENSITY))
        if self.x + w + GAP > MAP:
            self.x, self.y, self.row = GAP, self.y + self.row + GAP, 0
        at = (self.x, self.y, w, h)
        self.x, self.row = self.x + w + GAP, max(self.row, h)
        assert self.y + h + GAP <= MAP, 'the map is too small'
        return at


def length(v):
    return math.sqrt(sum(x * x for x in v))


def quad(mesh, corner, u, v, shelf=None):
    n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    n = tuple(x / length(n) for x in n)
    x, y, w, h = shelf.place(length(u), length(v)) if shelf else (0, 0, 0, 0)
    base = len(mesh['position'])
    for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)):
        mesh['position'].append(tuple(c + s * a + t * b for c, a, b in zip(corner, u, v)))
        mesh['normal'].append(n)
        mesh['uv'].append(((x + s * w) / MAP, (y + t * h) / MAP))
    mesh['index'] += [base, base + 1, base + 2, base, base + 2, base + 3]


def box(mesh, lo, hi, shelf, inward=False, sides='xXzZyY'):
    s = [b - a for a, b in zip(lo, hi)]
    faces = {
        'x': (lo, (0, 0, s[2]), (0, s[1], 0)), 'X': ((hi[0], lo[1], hi[2]), (0, 0, -s[2]), (0, s[1], 0)),
        'z': ((hi[0], lo[1], lo[2]), (-s[0], 0, 0), (0, s[1], 0)), 'Z': ((lo[0], lo[1], hi[2]), (s[0], 0, 0), (0, s[1], 0)),
        'y': (lo, (s[0], 0, 0), (0, 0, s[2])), 'Y': ((lo[0], hi[1], hi[2]), (s[0], 0, 0), (0, 0, -s[2])),
    }
    for k in sides:
        c, u, v = faces[k]
        quad(mesh, c, v, u, shelf) if inward else quad(mesh, c, u, v, shelf)


def empty():
    return {'position': [], 'normal': [], 'uv': [], 'index': []}


shelf = Shelf()
hall, columns, panels = empty(), empty(), empty()
box(hall, (0, 0, 0), (W, H, D), shelf, inward=True)
COLUMNS = [(W * (5.0 + 6.0 * i) / 40.0, D * z) for i in range(6) for z in (0.3, 0.7)]
for x, z in COLUMNS:
    box(columns, (x - 0.4, 0, z - 0.4), (x + 0.4, H, z + 0.4), shelf, sides='xXzZ')


def grid(n):
    nx = max(1, round(math.sqrt(n * W / D)))
    nz = math.ceil(n / nx)
    return [((i + 0.5) * W / nx, (j + 0.5) * D / nz) for j in range(nz) for i in range(nx)][:n]


lights, nodes = [], []
for k, (x, z) in enumerate(grid(args.lamps)):
    lights.append({'type': 'point', 'color': [1, 1, 1], 'intensity': 20000.0 / args.lamps})
    if args.range > 0.0:
        lights[-1]['range'] = args.range
    nodes.append({'name': f'lamp{k}', 'translation': [x, H - 0.5, z], 'extensions': {'KHR_lights_punctual': {'light': k}}})
free = [(x, z) for x, z in grid(args.panels) if all(max(abs(x - cx), abs(z - cz)) > 0.8 for cx, cz in COLUMNS)]
side = math.sqrt(8.0 / max(1, len(free)))
for x, z in free:
    quad(panels, (x - side / 2, H - 0.4, z - side / 2), (side, 0, 0), (0, 0, side))

blob, views, accessors, meshes = bytearray(), [], [], []


def accessor(data, code, component, kind, bounds=False):
    flat = [c for d in data for c in (d if isinstance(d, tuple) else (d,))]
    views.append({'buffer': 0, 'byteOffset': len(blob), 'byteLength': struct.calcsize(f'<{len(flat)}{code}')})
    blob.extend(struct.pack(f'<{len(flat)}{code}', *flat))
    a = {'bufferView': len(views) - 1, 'componentType': component, 'count': len(data), 'type': kind}
    if bounds:
        rounded = [struct.unpack('<3f', struct.pack('<3f', *d)) for d in data]
        a['min'], a['max'] = [min(c) for c in zip(*rounded)], [max(c) for c in zip(*rounded)]
    accessors.append(a)
    return len(accessors) - 1


def node(name, mesh, material, **extras):
    if not mesh['index']:
        return
    attributes = {'POSITION': accessor(mesh['position'], 'f', 5126, 'VEC3', True), 'NORMAL': accessor(mesh['normal'], 'f', 5126, 'VEC3'),
                  'TEXCOORD_1': accessor(mesh['uv'], 'f', 5126, 'VEC2')}
    if extras:
        del attributes['TEXCOORD_1']
    meshes.append({'primitives': [{'attributes': attributes, 'indices': accessor(mesh['index'], 'I', 5125, 'SCALAR'), 'material': material}]})
    nodes.append({'name': name, 'mesh': len(meshes) - 1, **({'extras': {'lmc': extras}} if extras else {})})


node('hall', hall, 0)
node('columns', columns, 0)
node('panels', panels, 1, receive=False)
gltf = {
    'asset': {'version': '2.0', 'generator': 'make_hall.py'}, 'scene': 0,
    'scenes': [{'nodes': list(range(len(nodes))), 'extras': {'lmc': {'lightmap': {'resolution': MAP}}}}], 'nodes': nodes, 'meshes': meshes,
    'materials': [{'name': 'wall', 'pbrMetallicRoughness': {'baseColorFactor': [0.5, 0.5, 0.5, 1], 'metallicFactor': 0}},
                  {'name': 'panel', 'pbrMetallicRoughness': {'baseColorFactor': [0, 0, 0, 1], 'metallicFactor': 0}, 'emissiveFactor': [1, 1, 1],
                   'extensions': {'KHR_materials_emissive_strength': {'emissiveStrength': 2000.0}}}],
    'accessors': accessors, 'bufferViews': views, 'buffers': [{'byteLength': len(blob)}],
    'extensionsUsed': ['KHR_materials_emissive_strength'],
}
if lights:
    gltf['extensions'] = {'KHR_lights_punctual': {'lights': lights}}
    gltf['extensionsUsed'].append('KHR_lights_punctual')
text = json.dumps(gltf).encode()
text += b' ' * (-len(text) % 4)
blob += b'\0' * (-len(blob) % 4)
with open(args.out, 'wb') as f:
    f.write(struct.pack('<4sII', b'glTF', 2, 12 + 8 + len(text) + 8 + len(blob)))
    f.write(struct.pack('<I4s', len(text), b'JSON') + text + struct.pack('<I4s', len(blob), b'BIN\0') + blob)
