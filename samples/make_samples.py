#!/usr/bin/env python3
"""Writes the sample levels of this folder and checks them. Python's standard library alone; the same bytes on every run.

    make_samples.py                        write every sample beside this file
    make_samples.py --check                check the files (and that a new run gives the same bytes); exit code 1 if a check fails
    make_samples.py --only furnace --furnace-albedo 0.9 --out DIR

How a level is made: flat faces (polygons with holes) and unrolled strips are listed with the side from which they are lit;
every vertex that lies on another face's edge is added to that edge (so there is no T-junction); each face is triangulated;
charts are packed into the light map by their exact texel footprint at the largest texel density that fits.
Units: metres, +Y up, candela, lux and cd/m^2, as docs/units.md says.
"""
import argparse
import json
import math
import os
import struct
import sys
import zlib

GAP_TEXELS = 3        # empty texels between any two charts, at the resolution that the level names
SNAP_M = 1e-6         # two points nearer than this are one
HERE = os.path.dirname(os.path.abspath(__file__))


# ---- vectors ----------------------------------------------------------------------------------------------------------

def add(a, b): return tuple(x + y for x, y in zip(a, b))
def sub(a, b): return tuple(x - y for x, y in zip(a, b))
def mul(a, s): return tuple(x * s for x in a)
def dot(a, b): return sum(x * y for x, y in zip(a, b))
def cross(a, b): return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
def length(a): return math.sqrt(dot(a, a))
def unit(a): return mul(a, 1.0 / length(a))
def key(p): return tuple(round(x / SNAP_M) for x in p)
def area2(a, b, c): return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def newell(loop):
    n = (0.0, 0.0, 0.0)
    for a, b in zip(loop, loop[1:] + loop[:1]):
        n = add(n, cross(a, b))
    return n


def quaternion(right, up, back):
    """Of the rotation whose columns are right, up, back."""
    m = [[right[i], up[i], back[i]] for i in range(3)]
    w = math.sqrt(max(0.0, 1.0 + m[0][0] + m[1][1] + m[2][2])) / 2
    x = math.copysign(math.sqrt(max(0.0, 1.0 + m[0][0] - m[1][1] - m[2][2])) / 2, m[2][1] - m[1][2])
    y = math.copysign(math.sqrt(max(0.0, 1.0 - m[0][0] + m[1][1] - m[2][2])) / 2, m[0][2] - m[2][0])
    z = math.copysign(math.sqrt(max(0.0, 1.0 - m[0][0] - m[1][1] + m[2][2])) / 2, m[1][0] - m[0][1])
    q = (x, y, z, w)
    return [round(c, 9) for c in mul(q, 1.0 / math.sqrt(dot(q, q)))]


def looking(direction):
    """Rotation of a camera or light node: -Z along direction, +Y as near to the world's up as it can be."""
    back = mul(unit(direction), -1.0)
    right = unit(cross((0.0, 1.0, 0.0), back))
    return quaternion(right, cross(back, right), back)


# ---- faces, charts, levels --------------------------------------------------------------------------------------------

class Face:
    """A flat polygon with holes, counter-clockwise from the lit side, and its place in its chart (isometric, metres)."""

    def __init__(self, loops, origin, u, v, offset=(0.0, 0.0), normal_at=None):
        self.loops, self.origin, self.u, self.v, self.offset = loops, origin, u, v, offset
        self.n = cross(u, v)
        self.normal_at = normal_at or (lambda p: self.n)

    def flat(self, p):
        d = sub(p, self.origin)
        return (dot(d, self.u) + self.offset[0], dot(d, self.v) + self.offset[1])


class BallFace(Face):
    """A quad of a ball's side: its place in the chart is by angles about the side's middle (w; u, v, w right-handed)."""

    def __init__(self, loop, centre, radius, u, v, w):
        super().__init__([loop], centre, u, v, (0.0, 0.0), lambda p: unit(sub(p, centre)))
        self.radius, self.w = radius, w

    def flat(self, p):
        d = sub(p, self.origin)
        return tuple(self.radius * math.atan2(dot(d, a), dot(d, self.w)) for a in (self.u, self.v))


class Chart:
    def __init__(self, obj):
        self.obj, self.faces, self.triangles = obj, [], []   # triangles: (face, (p, p, p))


class Level:
    def __init__(self, name, resolution, sky=None):
        self.name, self.resolution, self.sky = name, resolution, sky
        self.materials, self.charts, self.objects, self.lights, self.cameras = {}, [], [], [], []
        self.images = []            # (uri, bytes)
        self.uv0_per_metre = 1.0
        self.external = False       # .gltf with .bin and pictures beside it, not .glb

    def material(self, name, rgb, emission=None, strength=1.0, **more):
        m = {"name": name, "pbrMetallicRoughness": {"baseColorFactor": list(rgb) + [1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}}
        if emission:
            m["emissiveFactor"] = list(emission)
            if strength != 1.0:
                m["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
        for k, v in more.items():
            (m["pbrMetallicRoughness"] if k == "baseColorTexture" else m)[k] = v
        self.materials[name] = m

    def object(self, name, material):
        self.objects.append((name, material))
        return name

    def flat(self, obj, outer, toward, holes=()):
        """One flat chart; `toward` is any vector on the lit side."""
        loops = [list(outer)] + [list(h) for h in holes]
        n = unit(newell(loops[0]))
        if dot(n, toward) < 0:
            loops[0].reverse()
            n = mul(n, -1.0)
        for h in loops[1:]:
            if dot(newell(h), n) > 0:
                h.reverse()
        u = (1.0, 0.0, 0.0) if abs(n[1]) > 0.9 else unit(cross((0.0, 1.0, 0.0), n))
        v = unit(cross(n, u))
        u = cross(v, n)
        chart = Chart(obj)
        chart.faces.append(Face(loops, (0.0, 0.0, 0.0), u, v))
        self.charts.append(chart)

    def strip(self, obj, low, high, normal_at=None):
        """Rectangles low[i] low[i+1] high[i+1] high[i], unrolled into one chart. Lit side: low to high is to the left of low[i] to low[i+1]."""
        chart, s = Chart(obj), 0.0
        for a, b, c, d in zip(low, low[1:], high[1:], high):
            face = Face([[a, b, c, d]], a, unit(sub(b, a)), unit(sub(d, a)), (s, 0.0), normal_at)
            assert abs(dot(face.u, face.v)) < 1e-9
            chart.faces.append(face)
            s += length(sub(b, a))
        self.charts.append(chart)

    def folded(self, obj, a, b, c, d, toward):
        """The triangles a b c and a c d, which need not lie in one plane, unfolded about their common edge."""
        if dot(cross(sub(b, a), sub(c, a)), toward) < 0:
            b, d = d, b
        u, chart = unit(sub(c, a)), Chart(obj)
        for loop in ([a, b, c], [a, c, d]):
            n = unit(newell(loop))
            chart.faces.append(Face([loop], a, u, cross(n, u)))
        self.charts.append(chart)

    def box(self, obj, low, high, sides="xXyYzZ", holes=None):
        """Faces of a block, lit from outside; a small letter is the side at the low end of its axis."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        quads = {
            "x": [(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)], "X": [(x1, y0, z0), (x1, y0, z1), (x1, y1, z1), (x1, y1, z0)],
            "y": [(x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1)], "Y": [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)],
            "z": [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)], "Z": [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)]}
        for side in sides:
            axis, sign = "xyz".index(side.lower()), 1.0 if side.isupper() else -1.0
            toward = tuple(sign if i == axis else 0.0 for i in range(3))
            self.flat(obj, quads[side], toward, (holes or {}).get(side, ()))

    def ball(self, obj, centre, radius, n):
        """Six charts of n x n quads, the sides of a cube blown up to a ball."""
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        for i in range(3):
            for sign in (1.0, -1.0):
                u, v, w = axes[(i + 1) % 3], mul(axes[(i + 2) % 3], sign), mul(axes[i], sign)
                tangent = lambda k: math.tan(math.pi / 4 * (2 * k - n) / n)
                at = lambda j, k: add(centre, mul(unit(add(w, add(mul(u, tangent(j)), mul(v, tangent(k))))), radius))
                chart = Chart(obj)
                for j in range(n):
                    for k in range(n):
                        chart.faces.append(BallFace([at(j, k), at(j + 1, k), at(j + 1, k + 1), at(j, k + 1)], centre, radius, u, v, w))
                self.charts.append(chart)

    def light(self, name, kind, color, intensity, position=None, direction=None, **more):
        light = {"name": name, "type": kind, "color": list(color), "intensity": intensity, **more}
        node = {"name": name}
        if position:
            node["translation"] = list(position)
        if direction:
            node["rotation"] = looking(direction)
        self.lights.append((light, node))

    def camera(self, name, position, target, yfov_deg, aspect=16 / 9):
        camera = {"type": "perspective", "name": name,
                  "perspective": {"yfov": round(math.radians(yfov_deg), 9), "znear": 0.05, "zfar": 200.0, "aspectRatio": round(aspect, 9)}}
        node = {"name": name, "translation": list(position), "rotation": looking(sub(target, position))}
        self.cameras.append((camera, node))


# ---- triangles --------------------------------------------------------------------------------------------------------

def conform(level):
    """Adds to each edge the vertices of all faces that lie on it: no T-junction is left."""
    points = {}
    for chart in level.charts:
        for face in chart.faces:
            for i, loop in enumerate(face.loops):
                face.loops[i] = [points.setdefault(key(p), p) for p in loop]
    everything = list(points.values())
    for chart in level.charts:
        for face in chart.faces:
            for i, loop in enumerate(face.loops):
                out = []
                for a, b in zip(loop, loop[1:] + loop[:1]):
                    out.append(a)
                    e, on = sub(b, a), []
                    for p in everything:
                        d = sub(p, a)
                        t = dot(d, e) / dot(e, e)
                        if SNAP_M < t * length(e) < length(e) - SNAP_M and length(sub(d, mul(e, t))) < SNAP_M:
                            on.append((t, p))
                    out += [p for _, p in sorted(on)]
                face.loops[i] = out


def segments_cross(a, b, c, d):
    return area2(a, b, c) * area2(a, b, d) < 0 and area2(c, d, a) * area2(c, d, b) < 0


def on_segment(p, a, b):
    d = sub(b, a)
    return abs(area2(a, b, p)) < 1e-9 * math.sqrt(dot(d, d)) and 0 < dot(sub(p, a), d) < dot(d, d)


def without_holes(loops, xy):
    """One loop of indices into xy: each hole is joined to the outline by the shortest free bridge."""
    outline, holes = list(loops[0]), [list(h) for h in loops[1:]]
    while holes:
        edges = [(l[i - 1], l[i]) for l in [outline] + holes for i in range(len(l))]
        pairs = sorted((dot(sub(xy[a], xy[b]), sub(xy[a], xy[b])), i, h, j)
                       for i, a in enumerate(outline) for h, hole in enumerate(holes) for j, b in enumerate(hole))
        for _, i, h, j in pairs:
            a, b = xy[outline[i]], xy[holes[h][j]]
            # At a vertex that bridges have doubled, only one of its places has the hole on its inner side.
            before, after = xy[outline[i - 1]], xy[outline[(i + 1) % len(outline)]]
            convex = area2(before, a, after) > 0
            left, right = area2(a, after, b) > 0, area2(before, a, b) > 0
            if not ((left and right) if convex else (left or right)):
                continue
            if any(segments_cross(a, b, xy[c], xy[d]) for c, d in edges) or any(on_segment(p, a, b) for p in xy):
                continue
            hole = holes.pop(h)
            outline = outline[:i + 1] + hole[j:] + hole[:j + 1] + outline[i:]
            break
        else:
            raise AssertionError("no bridge to a hole")
    return outline


def triangulate(face):
    """Ears first, then flips until every inner edge is Delaunay. Uses each vertex, makes no degenerate triangle."""
    points = [p for loop in face.loops for p in loop]
    xy = [face.flat(p) for p in points]
    loops, start = [], 0
    for loop in face.loops:
        loops.append(list(range(start, start + len(loop))))
        start += len(loop)
    poly, triangles = without_holes(loops, xy), []
    while len(poly) > 3:
        best = None
        for i in range(len(poly)):
            ia, ib, ic = poly[i - 1], poly[i], poly[(i + 1) % len(poly)]
            a, b, c = xy[ia], xy[ib], xy[ic]
            if area2(a, b, c) < 1e-10:
                continue
            inside = any(q not in (a, b, c) and area2(a, b, q) > -1e-10 and area2(b, c, q) > -1e-10 and area2(c, a, q) > -1e-10
                         for q in (xy[k] for k in poly))
            if not inside:
                quality = area2(a, b, c) / max(dot(sub(p, q), sub(p, q)) for p, q in ((a, b), (b, c), (c, a)))
                if best is None or quality > best[0] + 1e-12:
                    best = (quality, i)
        assert best, "no ear"
        i = best[1]
        triangles.append((poly[i - 1], poly[i], poly[(i + 1) % len(poly)]))
        poly.pop(i)
    triangles.append(tuple(poly))
    flip_to_delaunay(triangles, xy)
    return [tuple(points[i] for i in t) for t in triangles]


def flip_to_delaunay(triangles, xy):
    changed = True
    while changed:
        changed = False
        sides = {}
        for t, tri in enumerate(triangles):
            for i in range(3):
                sides[(tri[i], tri[(i + 1) % 3])] = (t, tri[(i + 2) % 3])
        for (a, b), (t, c) in sorted(sides.items()):
            other = sides.get((b, a))
            if a > b or other is None:
                continue
            s, d = other
            if area2(xy[c], xy[a], xy[d]) < 1e-9 or area2(xy[d], xy[b], xy[c]) < 1e-9:
                continue
            angle = lambda p, q, r: math.atan2(area2(p, q, r), dot(sub(q, p), sub(r, p)))
            if angle(xy[c], xy[a], xy[b]) + angle(xy[d], xy[b], xy[a]) > math.pi + 1e-7:
                triangles[t], triangles[s] = (c, a, d), (d, b, c)
                changed = True
                break


# ---- light-map charts -------------------------------------------------------------------------------------------------

def footprint(triangles):
    """Rows (bit x set = texel x touched) of triangles given in texels; a texel touched by a border counts."""
    rows = {}
    for tri in triangles:
        ys = [p[1] for p in tri]
        for y in range(math.floor(min(ys) - 1e-4), math.floor(max(ys) + 1e-4) + 1):
            xs = []
            for a, b in zip(tri, tri[1:] + tri[:1]):
                for p in (a, b):
                    if y - 1e-4 <= p[1] <= y + 1 + 1e-4:
                        xs.append(p[0])
                for edge in (y - 1e-4, y + 1 + 1e-4):
                    if (a[1] - edge) * (b[1] - edge) < 0:
                        xs.append(a[0] + (b[0] - a[0]) * (edge - a[1]) / (b[1] - a[1]))
            if xs:
                x0, x1 = math.floor(min(xs) - 1e-4), math.floor(max(xs) + 1e-4)
                assert x0 >= -1 and y >= -1
                rows[y] = rows.get(y, 0) | (((1 << (x1 - x0 + 1)) - 1) << (x0 + 1))   # one bit of margin to the left
    return rows


def runs(bits):
    out, x = [], 0
    while bits >> x:
        if bits >> x & 1:
            start = x
            while bits >> x & 1:
                x += 1
            out.append((start, x - start))
        else:
            x += 1
    return out


def place(rows, taken, size):
    """Lowest, then leftmost place (x, y) where no run of the chart meets a taken texel; None if there is none."""
    height = max(rows) + 1
    width = max(b.bit_length() for b in rows.values())
    row_runs = {y: runs(b) for y, b in rows.items()}
    for y0 in range(1, size - 1 - height):
        blocked = 0
        for y, spans in row_runs.items():
            row = taken[y0 + y]
            if not row:
                continue
            for start, n in spans:
                grown, have = row >> start, 1
                while have < n:      # OR of row >> (start .. start + n - 1), by doubling
                    step = min(have, n - have)
                    grown |= grown >> step
                    have += step
                blocked |= grown
        free = ~blocked & ((1 << max(0, size - width - 1)) - 1) & ~1
        if free:
            return (free & -free).bit_length() - 1, y0
    return None


def shapes_of(level):
    shapes = []
    for chart in level.charts:
        flat = [tuple(face.flat(p) for p in tri) for face, tri in chart.triangles]
        xs, ys = [p[0] for t in flat for p in t], [p[1] for t in flat for p in t]
        turn = (max(ys) - min(ys)) > (max(xs) - min(xs)) + 1e-9
        # v grows downwards in a texture: the picture of a wall stands upright, or is turned by a quarter.
        to = (lambda p, x=min(xs), y=min(ys): (p[1] - y, p[0] - x)) if turn else (lambda p, x=min(xs), y=max(ys): (p[0] - x, y - p[1]))
        shapes.append((to, [tuple(to(p) for p in t) for t in flat]))
    return shapes


def pack(level):
    """Sets level.density [texels/m], chart.uv1 (face point -> light-map UV) at the largest density that fits."""
    shapes, size = shapes_of(level), level.resolution
    total = sum(abs(area2(*t)) / 2 for _, ts in shapes for t in ts)
    order = sorted(range(len(shapes)), key=lambda i: (-sum(abs(area2(*t)) for t in shapes[i][1]), i))

    def attempt(density):
        taken, where = [0] * size, {}
        for i in order:
            rows = footprint([tuple(mul(p, density) for p in t) for t in shapes[i][1]])
            rows = {y + 1: b for y, b in rows.items()}     # footprint may reach one row and column below zero
            at = place(rows, taken, size)
            if at is None:
                return None
            where[i] = (at[0] + 1, at[1] + 1)
            for y, b in rows.items():
                wide = b = b << at[0]
                for g in range(1, GAP_TEXELS + 1):
                    wide |= b << g | b >> g
                for g in range(-GAP_TEXELS, GAP_TEXELS + 1):
                    if 0 <= at[1] + y + g < size:
                        taken[at[1] + y + g] |= wide & ((1 << size) - 1)
        return where

    best, low, high = None, 0.0, math.sqrt(size * size / total)
    for _ in range(9):
        middle = (low + high) / 2
        where = attempt(middle)
        if where:
            best, low = (middle, where), middle
        else:
            high = middle
    density, where = best
    level.density = density
    for i, chart in enumerate(level.charts):
        to, (x, y) = shapes[i][0], where[i]
        chart.uv1 = lambda p, to=to, x=x, y=y: ((x + to(p)[0] * density) / size, (y + to(p)[1] * density) / size)


# ---- files ------------------------------------------------------------------------------------------------------------

def f32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0] + 0.0


def png(width, height, pixels, channels):
    """8 bit PNG, stored blocks: its bytes do not depend on the version of zlib."""
    raw = b"".join(b"\0" + bytes(c for x in range(width) for c in pixels(x, y)) for y in range(height))
    blocks = [raw[i:i + 65535] for i in range(0, len(raw), 65535)]
    data = b"\x78\x01" + b"".join(
        struct.pack("<BHH", i == len(blocks) - 1, len(b), len(b) ^ 0xffff) + b for i, b in enumerate(blocks)) + struct.pack(">I", zlib.adler32(raw))
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def build(level):
    """{file name: bytes}"""
    conform(level)
    for chart in level.charts:
        chart.triangles = [(face, tri) for face in chart.faces for tri in triangulate(face)]
    pack(level)

    binary, views, accessors = bytearray(), [], []

    def accessor(data, code, kind, target, bounds=False):
        while len(binary) % 4:
            binary.append(0)
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": 0, "target": target})
        flat = [c for item in data for c in item]
        binary.extend(struct.pack("<%d%s" % (len(flat), code), *flat))
        views[-1]["byteLength"] = len(binary) - views[-1]["byteOffset"]
        a = {"bufferView": len(views) - 1, "componentType": {"f": 5126, "H": 5123}[code], "count": len(data), "type": kind}
        if bounds:
            a["min"], a["max"] = [min(c) for c in zip(*data)], [max(c) for c in zip(*data)]
        accessors.append(a)
        return len(accessors) - 1

    names, meshes, nodes = list(level.materials), [], []
    for name, material in level.objects:
        index, corners = {}, []
        for chart_id, chart in enumerate(level.charts):
            if chart.obj != name:
                continue
            for face, tri in chart.triangles:
                for p in tri:
                    flat = face.flat(p)
                    uv0 = (flat[0] * level.uv0_per_metre, -flat[1] * level.uv0_per_metre)
                    corners.append(index.setdefault((chart_id, tuple(map(f32, p)), tuple(map(f32, face.normal_at(p))),
                                                     tuple(map(f32, uv0)), tuple(map(f32, chart.uv1(flat)))), len(index)))
        vertices = list(index)
        assert corners and len(vertices) < 65535, name
        attributes = {"POSITION": accessor([v[1] for v in vertices], "f", "VEC3", 34962, True),
                      "NORMAL": accessor([v[2] for v in vertices], "f", "VEC3", 34962),
                      "TEXCOORD_0": accessor([v[3] for v in vertices], "f", "VEC2", 34962),
                      "TEXCOORD_1": accessor([v[4] for v in vertices], "f", "VEC2", 34962)}
        indices = accessor([(c,) for c in corners], "H", "SCALAR", 34963)
        meshes.append({"name": name, "primitives": [{"attributes": attributes, "indices": indices, "material": names.index(material), "mode": 4}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1})

    doc = {"asset": {"version": "2.0", "generator": "lmc samples/make_samples.py"}, "scene": 0}
    used = []
    for i, (_, node) in enumerate(level.lights):
        nodes.append({**node, "extensions": {"KHR_lights_punctual": {"light": i}}})
    for i, (_, node) in enumerate(level.cameras):
        nodes.append({**node, "camera": i})
    lmc = {"lightmap": {"resolution": level.resolution, "padding": GAP_TEXELS, "texcoord": 1, "texels_per_metre": round(level.density, 4)}}
    if level.sky:
        lmc["sky"] = {"radiance": list(level.sky)}
    doc["scenes"] = [{"name": level.name, "nodes": list(range(len(nodes))), "extras": {"lmc": lmc}}]
    doc["nodes"], doc["meshes"], doc["materials"] = nodes, meshes, list(level.materials.values())
    if any("extensions" in m for m in level.materials.values()):
        used.append("KHR_materials_emissive_strength")
    if level.lights:
        used.append("KHR_lights_punctual")
        doc["extensions"] = {"KHR_lights_punctual": {"lights": [light for light, _ in level.lights]}}
    if used:
        doc["extensionsUsed"] = used
    doc["cameras"] = [camera for camera, _ in level.cameras]
    if level.images:
        doc["images"] = [{"name": os.path.splitext(uri)[0], "uri": uri} for uri, _ in level.images]
        doc["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]
        doc["textures"] = [{"source": i, "sampler": 0} for i in range(len(level.images))]
    doc["accessors"], doc["bufferViews"] = accessors, views
    while len(binary) % 4:
        binary.append(0)
    doc["buffers"] = [{"byteLength": len(binary)}]
    files = dict(level.images)
    if level.external:
        doc["buffers"][0]["uri"] = level.name + ".bin"
        files[level.name + ".bin"] = bytes(binary)
        files[level.name + ".gltf"] = (json.dumps(doc, indent=1) + "\n").encode()
    else:
        text = json.dumps(doc, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary)
        files[level.name + ".glb"] = struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
    return files


# ---- the levels -------------------------------------------------------------------------------------------------------

def cornell():
    """Cornell University Program of Computer Graphics, Cornell Box Data; millimetres there, centimetres as metres here (x 0.01)."""
    s = lambda *p: tuple(round(c * 0.01, 6) for c in p)
    level = Level("cornell", 256)
    level.material("white", (0.725, 0.71, 0.68))
    level.material("red", (0.63, 0.065, 0.05))
    level.material("green", (0.14, 0.45, 0.091))
    level.material("light", (0.78, 0.78, 0.78), (1.0, round(12 / 17, 9), round(4 / 17, 9)), 17.0)
    short = [(130.0, 65.0), (82.0, 225.0), (240.0, 272.0), (290.0, 114.0)]
    tall = [(423.0, 247.0), (265.0, 296.0), (314.0, 456.0), (472.0, 406.0)]
    lamp = [s(343.0, 548.8, 227.0), s(343.0, 548.8, 332.0), s(213.0, 548.8, 332.0), s(213.0, 548.8, 227.0)]
    ring = lambda plan, y: [s(x, y, z) for x, z in plan]
    obj = level.object("floor", "white")
    level.flat(obj, [s(552.8, 0.0, 0.0), s(0.0, 0.0, 0.0), s(0.0, 0.0, 559.2), s(549.6, 0.0, 559.2)], (0, 1, 0), [ring(short, 0.0), ring(tall, 0.0)])
    obj = level.object("ceiling", "white")
    level.flat(obj, [s(556.0, 548.8, 0.0), s(556.0, 548.8, 559.2), s(0.0, 548.8, 559.2), s(0.0, 548.8, 0.0)], (0, -1, 0), [lamp])
    obj = level.object("light", "light")           # fills the hole of the ceiling: nothing is coplanar with it but its neighbours
    level.flat(obj, lamp, (0, -1, 0))
    obj = level.object("back_wall", "white")
    level.flat(obj, [s(549.6, 0.0, 559.2), s(0.0, 0.0, 559.2), s(0.0, 548.8, 559.2), s(556.0, 548.8, 559.2)], (0, 0, -1))
    obj = level.object("right_wall", "green")
    level.flat(obj, [s(0.0, 0.0, 559.2), s(0.0, 0.0, 0.0), s(0.0, 548.8, 0.0), s(0.0, 548.8, 559.2)], (1, 0, 0))
    obj = level.object("left_wall", "red")         # as published its fourth corner is 3.2 mm off the plane of the others
    level.folded(obj, s(552.8, 0.0, 0.0), s(549.6, 0.0, 559.2), s(556.0, 548.8, 559.2), s(556.0, 548.8, 0.0), (-1, 0, 0))
    for name, plan, height in (("short_block", short, 165.0), ("tall_block", tall, 330.0)):
        obj = level.object(name, "white")
        level.flat(obj, ring(plan, height), (0, 1, 0))
        middle = mul(tuple(map(sum, zip(*plan))), 0.25)
        for (ax, az), (bx, bz) in zip(plan, plan[1:] + plan[:1]):
            out = ((ax + bx) / 2 - middle[0], 0.0, (az + bz) / 2 - middle[1])
            level.flat(obj, [s(ax, 0.0, az), s(bx, 0.0, bz), s(bx, height, bz), s(ax, height, az)], out)
    level.camera("camera", s(278.0, 273.0, -800.0), s(278.0, 273.0, 0.0), math.degrees(2 * math.atan(0.0125 / 0.035)), 1.0)
    return level


def two_rooms():
    level = Level("two_rooms", 256)
    level.material("plaster", (0.75, 0.73, 0.7))
    level.material("wood", (0.5, 0.34, 0.2))
    level.material("orange", (0.75, 0.38, 0.12))
    level.material("blue", (0.25, 0.4, 0.7))
    level.material("frame", (0.6, 0.58, 0.54))
    depth, height, a1, b0, b1 = 4.0, 2.6, 4.0, 4.2, 8.2          # room A: x in 0..a1, wall, room B: x in b0..b1
    d0, d1, dh = 1.4, 2.4, 2.1                                    # door: z in d0..d1, up to dh
    x0, x1, z0, z1 = 0.6, 1.4, 2.6, 3.4                           # a crate in room A
    obj = level.object("floor", "wood")
    plan = [(0.0, 0.0), (a1, 0.0), (a1, d0), (b0, d0), (b0, 0.0), (b1, 0.0), (b1, depth), (b0, depth), (b0, d1), (a1, d1), (a1, depth), (0.0, depth)]
    crate = [(x0, 0.0, z0), (x1, 0.0, z0), (x1, 0.0, z1), (x0, 0.0, z1)]
    level.flat(obj, [(x, 0.0, z) for x, z in plan], (0, 1, 0), [crate])
    obj = level.object("crate", "orange")
    level.box(obj, (x0, 0.0, z0), (x1, 0.8, z1), "xXYzZ")
    for room, near, far, end in (("a", 0.0, a1, "plaster"), ("b", b0, b1, "blue")):
        obj = level.object("ceiling_" + room, "plaster")
        level.flat(obj, [(near, height, 0.0), (far, height, 0.0), (far, height, depth), (near, height, depth)], (0, -1, 0))
        walls = level.object("walls_" + room, "plaster")
        for z, inwards in ((0.0, 1), (depth, -1)):
            level.flat(walls, [(near, 0.0, z), (far, 0.0, z), (far, height, z), (near, height, z)], (0, 0, inwards))
        door_x, end_x, inwards = (far, near, 1) if room == "a" else (near, far, -1)
        outline = [(0.0, 0.0), (d0, 0.0), (d0, dh), (d1, dh), (d1, 0.0), (depth, 0.0), (depth, height), (0.0, height)]
        level.flat(walls, [(door_x, y, z) for z, y in outline], (-inwards, 0, 0))
        obj = walls if end == "plaster" else level.object("end_wall_" + room, end)
        level.flat(obj, [(end_x, 0.0, 0.0), (end_x, 0.0, depth), (end_x, height, depth), (end_x, height, 0.0)], (inwards, 0, 0))
    obj = level.object("door_frame", "frame")
    level.flat(obj, [(a1, 0.0, d0), (b0, 0.0, d0), (b0, dh, d0), (a1, dh, d0)], (0, 0, 1))
    level.flat(obj, [(a1, 0.0, d1), (b0, 0.0, d1), (b0, dh, d1), (a1, dh, d1)], (0, 0, -1))
    level.flat(obj, [(a1, dh, d0), (b0, dh, d0), (b0, dh, d1), (a1, dh, d1)], (0, -1, 0))
    level.light("lamp", "point", (1.0, 0.9, 0.75), 60.0, (1.9, 2.2, 0.9))
    level.camera("camera", (7.6, 1.65, 3.5), (3.4, 1.05, 1.7), 58.0)
    level.camera("lamp_room", (3.6, 1.7, 3.6), (0.8, 0.7, 1.4), 62.0)
    return level


def furnace(albedo=0.5):
    """Every face emits radiance L and reflects `albedo`: E = pi L / (1 - albedo), the same at each place."""
    level = Level("furnace", 128)
    level.material("glow", (albedo, albedo, albedo), (1.0, 0.5, 0.25), 2.0)
    obj = level.object("room", "glow")
    x, y, z = 3.0, 2.4, 4.0
    level.flat(obj, [(0.0, 0.0, 0.0), (x, 0.0, 0.0), (x, 0.0, z), (0.0, 0.0, z)], (0, 1, 0))
    level.flat(obj, [(0.0, y, 0.0), (x, y, 0.0), (x, y, z), (0.0, y, z)], (0, -1, 0))
    level.flat(obj, [(0.0, 0.0, 0.0), (0.0, y, 0.0), (0.0, y, z), (0.0, 0.0, z)], (1, 0, 0))
    level.flat(obj, [(x, 0.0, 0.0), (x, y, 0.0), (x, y, z), (x, 0.0, z)], (-1, 0, 0))
    level.flat(obj, [(0.0, 0.0, 0.0), (x, 0.0, 0.0), (x, y, 0.0), (0.0, y, 0.0)], (0, 0, 1))
    level.flat(obj, [(0.0, 0.0, z), (x, 0.0, z), (x, y, z), (0.0, y, z)], (0, 0, -1))
    level.camera("camera", (2.6, 1.5, 3.6), (0.8, 1.0, 0.6), 65.0)
    return level


def circle(cx, cz, y, r, n):
    return [(cx + r * math.cos(2 * math.pi * i / n), y, cz - r * math.sin(2 * math.pi * i / n)) for i in range(n)]


def square(cx, cz, y, half):
    return [(cx - half, y, cz - half), (cx + half, y, cz - half), (cx + half, y, cz + half), (cx - half, y, cz + half)]


def column(level, obj, cx, cz, floor, spring, wall):
    """Plinth, round shaft (unrolled) and abacus; returns the outline of its foot. `wall` is the thickness of what it carries."""
    half, radius, sides, foot, head = 0.25, 0.17, 16, floor + 0.2, spring - 0.15
    level.box(obj, (cx - half, floor, cz - half), (cx + half, foot, cz + half), "xXYzZ", {"Y": [circle(cx, cz, foot, radius, sides)]})
    level.box(obj, (cx - half, head, cz - half), (cx + half, spring, cz + half), "xXyYzZ",
              {"y": [circle(cx, cz, head, radius, sides)], "Y": [square(cx, cz, spring, wall / 2)]})
    low, high = circle(cx, cz, foot, radius, sides), circle(cx, cz, head, radius, sides)
    level.strip(obj, low + low[:1], high + high[:1], lambda p: unit((p[0] - cx, 0.0, p[2] - cz)))
    return square(cx, cz, floor, half)


def court():
    """A court (x 0..8.4, z 0..6.2) with round-arched arcades to the north (-z) and the west (-x), open to sun and sky."""
    level = Level("court", 256, sky=(0.75, 1.0, 1.4))
    level.material("plaster", (0.74, 0.66, 0.54))
    level.material("stone", (0.8, 0.76, 0.68))
    level.material("sand", (0.52, 0.43, 0.31))
    level.material("tiles", (0.5, 0.27, 0.17))
    level.material("red", (0.5, 0.1, 0.07))
    level.material("white", (0.82, 0.81, 0.78))
    level.material("roof", (0.45, 0.25, 0.18))
    level.material("water", (0.04, 0.13, 0.14))
    width, depth, walk, wall = 8.4, 6.2, 2.4, 0.4       # [m] court, outer edge of the arcades, thickness of the arcade walls
    floor, spring, ceiling, top, dado, step = 0.15, 2.2, 3.4, 3.8, 1.35, 0.2
    bay, pier, segments = 1.8, 0.4, 12

    def arch(start, i):
        """Outline of an opening from `start`, left to right: (place along the wall, height)."""
        a = math.pi * i / segments
        return (start + bay / 2 * (1 - math.cos(a)), spring + bay / 2 * math.sin(a)) if 0 < i < segments else (start + bay * (i == segments), spring)

    # Along a wall s grows away from the corner; the two arcades differ in how (s, y, t) becomes a point, t = depth into the wall.
    feet = []
    columns = level.object("columns", "stone")
    for name, end, point, facing in (("north", width, lambda s, y, t: (s, y, -t), (0, 0, 1)), ("west", depth, lambda s, y, t: (-t, y, s), (1, 0, 0))):
        obj = level.object("arcade_" + name, "plaster")
        starts = [i * (bay + pier) for i in range(round((end + pier) / (bay + pier)))]
        openings = [[arch(s, i) for i in range(segments + 1)] for s in starts]
        profile = [p for o in openings for p in o]
        level.flat(obj, [point(s, y, 0.0) for s, y in profile + [(end, top), (0.0, top)]], facing)
        inner = [(-wall, floor), (0.0, floor)] + profile + [(end, ceiling), (-wall, ceiling)]
        level.flat(obj, [point(s, y, wall) for s, y in inner], mul(facing, -1))
        level.flat(obj, [point(0.0, floor, 0.0), point(0.0, floor, wall), point(0.0, spring, wall), point(0.0, spring, 0.0)],
                   sub(point(1.0, 0.0, 0.0), point(0.0, 0.0, 0.0)))
        for start, o in zip(starts, openings):
            outer, far = [point(s, y, 0.0) for s, y in o], [point(s, y, wall) for s, y in o]
            along, centre = ((1, 1, 0) if name == "north" else (0, 1, 1)), point(start + bay / 2, spring, 0.0)
            axis = lambda p, along=along, centre=centre: unit(tuple(m * (c - x) for m, c, x in zip(along, centre, p)))
            level.strip(obj, *((outer, far) if name == "west" else (far, outer)), axis)    # lit from below; the arcades mirror each other
        for start in starts[1:]:
            x, _, z = point(start - pier / 2, 0.0, wall / 2)
            feet.append(column(level, columns, x, z, floor, spring, wall))

    obj = level.object("walk", "tiles")
    plan = [(-walk, -walk), (width, -walk), (width, step), (step, step), (step, depth), (-walk, depth)]
    level.flat(obj, [(x, floor, z) for x, z in plan], (0, 1, 0), feet + [square(-wall / 2, -wall / 2, floor, wall / 2)])
    level.flat(obj, [(step, 0.0, step), (width, 0.0, step), (width, floor, step), (step, floor, step)], (0, 0, 1))
    level.flat(obj, [(step, 0.0, step), (step, 0.0, depth), (step, floor, depth), (step, floor, step)], (1, 0, 0))
    obj = level.object("ceiling", "white")
    plan = [(-walk, -walk), (width, -walk), (width, -wall), (-wall, -wall), (-wall, depth), (-walk, depth)]
    level.flat(obj, [(x, ceiling, z) for x, z in plan], (0, -1, 0))
    for name, material, y0, y1 in (("dado", "red", floor, dado), ("back_walls", "plaster", dado, ceiling)):
        obj = level.object(name, material)
        level.flat(obj, [(-walk, y0, -walk), (width, y0, -walk), (width, y1, -walk), (-walk, y1, -walk)], (0, 0, 1))
        level.flat(obj, [(-walk, y0, -walk), (-walk, y0, depth), (-walk, y1, depth), (-walk, y1, -walk)], (1, 0, 0))
    obj = level.object("outer_walls", "plaster")
    for end, point, facing in ((width, lambda s, y: (width, y, s), (-1, 0, 0)), (depth, lambda s, y: (s, y, depth), (0, 0, -1))):
        other = depth if end == width else width
        outline = [(-walk, floor), (step, floor), (step, 0.0), (other, 0.0), (other, top), (0.0, top), (0.0, spring), (-wall, spring), (-wall, ceiling), (-walk, ceiling)]
        level.flat(obj, [point(s, y) for s, y in outline], facing)
    obj = level.object("roof", "roof")
    edge = 0.3
    level.flat(obj, [(-walk - edge, top, -walk - edge), (width + edge, top, -walk - edge), (width + edge, top, depth + edge), (-walk - edge, top, depth + edge)],
               (0, 1, 0), [[(0.0, top, 0.0), (width, top, 0.0), (width, top, depth), (0.0, top, depth)]])

    cx, cz, sides, rim, level_of_water = 4.3, 3.3, 8, 0.45, 0.33
    ring = lambda y, r: circle(cx, cz, y, r, sides)
    obj = level.object("ground", "sand")
    level.flat(obj, [(step, 0.0, step), (width, 0.0, step), (width, 0.0, depth), (step, 0.0, depth)], (0, 1, 0), [ring(0.0, 0.95)])
    obj = level.object("basin", "stone")
    level.flat(obj, ring(rim, 0.95), (0, 1, 0), [ring(rim, 0.75)])
    for i in range(sides):
        for r, y0, out in ((0.95, 0.0, 1.0), (0.75, level_of_water, -1.0)):
            a, b, c, d = ring(y0, r)[i], ring(y0, r)[(i + 1) % sides], ring(rim, r)[(i + 1) % sides], ring(rim, r)[i]
            level.flat(obj, [a, b, c, d], mul(((a[0] + b[0]) / 2 - cx, 0.0, (a[2] + b[2]) / 2 - cz), out))
    obj = level.object("water", "water")
    level.flat(obj, ring(level_of_water, 0.75), (0, 1, 0))
    level.light("sun", "directional", (1.0, 0.88, 0.7), 14.0, (6.0, 8.0, 4.0), (-0.55, -0.75, -0.36))
    level.camera("camera", (7.75, 1.75, 5.6), (1.6, 1.35, 0.2), 56.0)
    level.camera("arcade", (-1.4, 1.7, 5.7), (-1.0, 1.4, -2.0), 60.0)
    return level


def textured():
    """A room with a tiled floor, a light panel whose picture says where it glows, and a lattice screen cut out by its alpha."""
    level = Level("textured", 128)
    level.external = True

    def tiles(x, y):
        joint = x % 32 < 2 or y % 32 < 2
        return (70, 66, 60) if joint else (205, 178, 130) if (x // 32 + y // 32) % 2 == 0 else (120, 44, 34)

    def panel(x, y):
        inside = 6 <= x < 58 and 6 <= y < 58 and not 28 <= x < 36
        return (255, 236, 200) if inside else (0, 0, 0)

    def lattice(x, y):
        return (110, 84, 52, 255 if (x + y) % 16 < 5 or (x - y) % 16 < 5 or min(x, y, 63 - x, 63 - y) < 2 else 0)

    level.images = [("textured_tiles.png", png(64, 64, tiles, 3)), ("textured_panel.png", png(64, 64, panel, 3)), ("textured_lattice.png", png(64, 64, lattice, 4))]
    level.material("tiles", (1.0, 1.0, 1.0), baseColorTexture={"index": 0})
    level.material("plaster", (0.75, 0.74, 0.72))
    level.material("panel", (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), 12.0, emissiveTexture={"index": 1})
    level.material("lattice", (1.0, 1.0, 1.0), baseColorTexture={"index": 2}, alphaMode="MASK", alphaCutoff=0.5, doubleSided=True)
    w, h, d = 4.0, 2.6, 3.0
    obj = level.object("floor", "tiles")
    level.flat(obj, [(0.0, 0.0, 0.0), (w, 0.0, 0.0), (w, 0.0, d), (0.0, 0.0, d)], (0, 1, 0))
    hole = [(1.0, h, 1.0), (2.0, h, 1.0), (2.0, h, 2.0), (1.0, h, 2.0)]      # whole metres: the panel's picture fits it once
    obj = level.object("ceiling", "plaster")
    level.flat(obj, [(0.0, h, 0.0), (w, h, 0.0), (w, h, d), (0.0, h, d)], (0, -1, 0), [hole])
    obj = level.object("panel", "panel")
    level.flat(obj, hole, (0, -1, 0))
    obj = level.object("walls", "plaster")
    level.flat(obj, [(0.0, 0.0, 0.0), (0.0, h, 0.0), (0.0, h, d), (0.0, 0.0, d)], (1, 0, 0))
    level.flat(obj, [(w, 0.0, 0.0), (w, h, 0.0), (w, h, d), (w, 0.0, d)], (-1, 0, 0))
    level.flat(obj, [(0.0, 0.0, 0.0), (w, 0.0, 0.0), (w, h, 0.0), (0.0, h, 0.0)], (0, 0, 1))
    level.flat(obj, [(0.0, 0.0, d), (w, 0.0, d), (w, h, d), (0.0, h, d)], (0, 0, -1))
    obj = level.object("screen", "lattice")
    level.flat(obj, [(3.0, 0.1, 0.5), (3.0, 0.1, 2.5), (3.0, 2.1, 2.5), (3.0, 2.1, 0.5)], (-1, 0, 0))
    level.light("lamp", "point", (1.0, 0.75, 0.5), 6.0, (3.7, 1.5, 1.5))
    level.camera("camera", (0.4, 1.6, 2.7), (2.8, 0.9, 1.0), 62.0)
    return level


def curved():
    """A ball of six charts and a round column of three on a square foot, in a room with a lamp: seams on smooth surfaces beside creases."""
    level = Level("curved", 256)
    level.material("plaster", (0.75, 0.73, 0.7))
    level.material("red", (0.6, 0.12, 0.08))
    level.material("white", (0.8, 0.8, 0.8))
    w, h, d, foot, top, half, radius, sides = 4.0, 2.6, 3.0, 0.2, 1.9, 0.45, 0.35, 24
    cx, cz = 2.9, 1.2
    obj = level.object("floor", "plaster")
    level.flat(obj, [(0.0, 0.0, 0.0), (w, 0.0, 0.0), (w, 0.0, d), (0.0, 0.0, d)], (0, 1, 0), [square(cx, cz, 0.0, half)])
    obj = level.object("ceiling", "plaster")
    level.flat(obj, [(0.0, h, 0.0), (w, h, 0.0), (w, h, d), (0.0, h, d)], (0, -1, 0))
    obj = level.object("walls", "plaster")
    level.flat(obj, [(0.0, 0.0, 0.0), (0.0, h, 0.0), (0.0, h, d), (0.0, 0.0, d)], (1, 0, 0))
    level.flat(obj, [(0.0, 0.0, 0.0), (w, 0.0, 0.0), (w, h, 0.0), (0.0, h, 0.0)], (0, 0, 1))
    level.flat(obj, [(0.0, 0.0, d), (w, 0.0, d), (w, h, d), (0.0, h, d)], (0, 0, -1))
    obj = level.object("red_wall", "red")
    level.flat(obj, [(w, 0.0, 0.0), (w, h, 0.0), (w, h, d), (w, 0.0, d)], (-1, 0, 0))
    obj = level.object("column", "white")
    level.box(obj, (cx - half, 0.0, cz - half), (cx + half, foot, cz + half), "xXYzZ", {"Y": [circle(cx, cz, foot, radius, sides)]})
    low, high = circle(cx, cz, foot, radius, sides), circle(cx, cz, top, radius, sides)
    for first, last in ((0, 5), (5, 16), (16, 24)):
        level.strip(obj, (low + low[:1])[first:last + 1], (high + high[:1])[first:last + 1], lambda p: unit((p[0] - cx, 0.0, p[2] - cz)))
    level.flat(obj, high, (0, 1, 0))
    obj = level.object("ball", "white")
    level.ball(obj, (1.3, 1.0, 1.3), 0.6, 8)
    level.light("lamp", "point", (1.0, 0.9, 0.75), 40.0, (1.9, 2.3, 2.4))
    level.camera("camera", (2.2, 1.55, 2.85), (1.9, 1.0, 0.9), 70.0)
    level.camera("ball", (2.0, 1.7, 2.3), (1.3, 1.05, 1.3), 60.0)
    return level


LEVELS = {"cornell": cornell, "two_rooms": two_rooms, "court": court, "curved": curved, "furnace": furnace, "textured": textured}
DENSITY_SLACK = {"curved": 0.35}   # a ball cannot be unrolled; all other charts keep lengths
# Where a level's surface ends: all other edges belong to two triangles.
OPEN_EDGES = {"cornell": lambda p: abs(p[2]) < 1e-6, "court": lambda p: min(abs(p[0] + 2.7), abs(p[0] - 8.7), abs(p[2] + 2.7), abs(p[2] - 6.5)) < 1e-5,
              "textured": lambda p: abs(p[0] - 3.0) < 1e-6}


# ---- the check --------------------------------------------------------------------------------------------------------

def read_level(path):
    """(document, triangles): each triangle is (node name, material, [3 x (position, normal, uv0, uv1)])."""
    with open(path, "rb") as f:
        data = f.read()
    if data[:4] == b"glTF":
        size = struct.unpack_from("<I", data, 12)[0]
        doc, binary = json.loads(data[20:20 + size]), data[28 + size:]
    else:
        doc = json.loads(data)
        with open(os.path.join(os.path.dirname(path), doc["buffers"][0]["uri"]), "rb") as f:
            binary = f.read()

    def values(i):
        a = doc["accessors"][i]
        view, n = doc["bufferViews"][a["bufferView"]], {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[a["type"]]
        flat = struct.unpack_from("<%d%s" % (n * a["count"], {5126: "f", 5123: "H"}[a["componentType"]]), binary, view["byteOffset"])
        return [flat[k:k + n] for k in range(0, len(flat), n)]

    triangles = []
    for node in doc["nodes"]:
        if "mesh" not in node:
            continue
        for primitive in doc["meshes"][node["mesh"]]["primitives"]:
            arrays = [values(primitive["attributes"][k]) for k in ("POSITION", "NORMAL", "TEXCOORD_0", "TEXCOORD_1")]
            indices = [i for (i,) in values(primitive["indices"])]
            for k in range(0, len(indices), 3):
                triangles.append((node["name"], doc["materials"][primitive["material"]],
                                  [tuple(a[i] for a in arrays) for i in indices[k:k + 3]]))
    return doc, triangles


def overlap(s, t, slack):
    """Do two triangles (2-D, any winding) share more than a border? Separating axes."""
    for tri in (s, t):
        for a, b in zip(tri, tri[1:] + tri[:1]):
            n = (a[1] - b[1], b[0] - a[0])
            size = math.sqrt(dot(n, n))
            p, q = [dot(n, c) / size for c in s], [dot(n, c) / size for c in t]
            if max(p) <= min(q) + slack or max(q) <= min(p) + slack:
                return False
    return True


def check_level(name, path):
    """Every problem found, in words."""
    problems = []
    doc, triangles = read_level(path)
    lightmap = doc["scenes"][0]["extras"]["lmc"]["lightmap"]
    size, density = lightmap["resolution"], lightmap["texels_per_metre"]
    if not any("camera" in n for n in doc["nodes"]):
        problems.append("no camera node")

    # Each triangle alone: range of the UVs, size, orientation, texel density.
    for obj, _, tri in triangles:
        p, n, uv = [v[0] for v in tri], [v[1] for v in tri], [v[3] for v in tri]
        face = cross(sub(p[1], p[0]), sub(p[2], p[0]))
        if length(face) < 1e-6:
            problems.append(f"{obj}: degenerate triangle at {p[0]}")
            continue
        if not all(0.0 <= c <= 1.0 for t in uv for c in t):
            problems.append(f"{obj}: TEXCOORD_1 outside of [0, 1]")
        if min(dot(unit(face), m) for m in n) < 0.9:
            problems.append(f"{obj}: face and normal disagree at {p[0]}")
        if any(abs(length(m) - 1.0) > 1e-5 for m in n):
            problems.append(f"{obj}: normal that is not unit")
        ratio = math.sqrt(abs(area2(*uv)) / length(face)) * size / density
        if abs(ratio - 1.0) > DENSITY_SLACK.get(name, 0.01):
            problems.append(f"{obj}: texel density off by {ratio:.4f} at {p[0]}")

    # Charts: triangles that share a corner and its place in the map. No overlap within, GAP_TEXELS between.
    parent = {}

    def root(k):
        while parent.setdefault(k, k) != k:
            k = parent[k]
        return k

    for _, _, tri in triangles:
        for v in tri[1:]:
            parent[root((v[0], v[3]))] = root((tri[0][0], tri[0][3]))
    charts = {}
    for _, _, tri in triangles:
        charts.setdefault(root((tri[0][0], tri[0][3])), []).append(tuple(mul(v[3], size) for v in tri))
    owner = {}
    for c, (_, tris) in enumerate(charts.items()):
        for i, s in enumerate(tris):
            if any(overlap(s, t, 1e-3) for t in tris[:i]):
                problems.append(f"overlap within chart {c}")
        for y, bits in footprint(tris).items():
            for start, n in runs(bits):
                for x in range(start - 1, start - 1 + n):
                    owner[(x, y)] = c
    for (x, y), c in owner.items():
        near = [(x + i, y + j) for j in range(-GAP_TEXELS, GAP_TEXELS + 1) for i in range(-GAP_TEXELS, GAP_TEXELS + 1)]
        if any(owner.get(k, c) != c for k in near):
            problems.append(f"charts {c} and another are nearer than {GAP_TEXELS} texels at texel ({x}, {y})")
            break

    # The surface: each edge has two triangles, none has a vertex within it, no two coplanar triangles overlap.
    place_of, edges, planes = {}, {}, {}
    for t, (_, _, tri) in enumerate(triangles):
        p = [v[0] for v in tri]
        k = [tuple(round(c * 1e5) for c in q) for q in p]
        for a, b, q in zip(k, k[1:] + k[:1], p):
            place_of[a] = q
            edges.setdefault((a, b), []).append(t)
        n = unit(cross(sub(p[1], p[0]), sub(p[2], p[0])))
        if max(n, key=abs) < 0:
            n = mul(n, -1.0)
        planes.setdefault(tuple(round(c * 200) for c in n) + (round(dot(n, p[0]) * 200),), []).append((p, n))
    for (a, b), ts in edges.items():
        if len(ts) > 1:
            problems.append(f"edge used twice in one direction at {place_of[a]}")
        is_open = OPEN_EDGES.get(name)
        if (b, a) not in edges and not (is_open and is_open(place_of[a]) and is_open(place_of[b])):
            problems.append(f"open edge {place_of[a]} {place_of[b]} of {triangles[ts[0]][0]}")
        pa, e = place_of[a], sub(place_of[b], place_of[a])
        for k, p in place_of.items():
            if k not in (a, b):
                d = sub(p, pa)
                along = dot(d, e)
                if 0 < along < dot(e, e) and length(sub(d, mul(e, along / dot(e, e)))) < 1e-5:
                    problems.append(f"T-junction at {p}")
    for same in planes.values():
        n = same[0][1]
        u = unit(cross(n, (1.0, 0.0, 0.0) if abs(n[0]) < 0.7 else (0.0, 1.0, 0.0)))
        v = cross(n, u)
        flat = [tuple((dot(q, u), dot(q, v)) for q in p) for p, _ in same]
        for i, s in enumerate(flat):
            if any(overlap(s, t, 1e-5) for t in flat[:i]):
                problems.append(f"coplanar overlap at {same[i][0][0]}")
    covered = 100.0 * len(owner) / (size * size)
    print(f"{os.path.basename(path):16} {len(triangles):5} triangles {len(charts):4} charts  {size} texels, {density:g} a metre, {covered:.0f} % touched"
          f"  {'ok' if not problems else f'{len(problems)} problems'}")
    for p in problems[:10]:
        print("  " + p)
    return problems


# ---- the program ------------------------------------------------------------------------------------------------------

def main():
    parser = argparse.ArgumentParser(description="Write or check the sample levels of lmc.")
    parser.add_argument("--out", default=HERE, metavar="DIR", help="where the files are (default: beside this script)")
    parser.add_argument("--only", default=",".join(LEVELS), metavar="NAMES", help="some of: %(default)s")
    parser.add_argument("--furnace-albedo", type=float, default=0.5, metavar="RHO", help="reflectance of the furnace room, 0 to 0.999; other than 0.5 needs --out")
    parser.add_argument("--check", action="store_true", help="write nothing: check the files that are there")
    options = parser.parse_args()
    names = options.only.split(",")
    if any(n not in LEVELS for n in names) or not 0.0 <= options.furnace_albedo <= 0.999:
        parser.error("unknown name, or an albedo outside of 0 to 0.999")
    if options.furnace_albedo != 0.5 and os.path.abspath(options.out) == HERE:
        parser.error("--furnace-albedo needs --out: the committed sample has albedo 0.5")
    failed = False
    for name in names:
        level = furnace(options.furnace_albedo) if name == "furnace" else LEVELS[name]()
        files = build(level)
        if not options.check:
            os.makedirs(options.out, exist_ok=True)
            for file, data in files.items():
                with open(os.path.join(options.out, file), "wb") as f:
                    f.write(data)
                print(os.path.join(options.out, file))
            continue
        for file, data in files.items():
            with open(os.path.join(options.out, file), "rb") as f:
                if f.read() != data:
                    print(f"{file}: differs from what this script writes")
                    failed = True
        failed |= bool(check_level(name, os.path.join(options.out, name + (".gltf" if level.external else ".glb"))))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
