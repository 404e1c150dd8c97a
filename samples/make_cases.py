#!/usr/bin/env python3
"""Writes the reference cases of samples/cases (schema lmc-analytic/1) for `lmc verify`. Needs mpmath (Debian: python3-mpmath).

    make_cases.py            write the files
    make_cases.py --check    make them again and compare; exit code 1 when one differs

Every value comes from a closed form or a quadrature at 60 digits; none of it uses code or numbers of lmc."""
import argparse
import json
import os
import sys

try:
    import mpmath
    from mpmath import acos, asin, atan, atan2, cos, exp, log, mp, mpf, pi, quad, sin, sqrt, tan
except ImportError:
    print('left out: no mpmath (Debian: python3-mpmath)')
    sys.exit(77)

mp.dps = 60
HERE = os.path.dirname(os.path.abspath(__file__))
DIGITS = 20
families = {}

CLOSED = {'double_rel': 1e-11, 'double_abs': 1e-15}
FAR = {'double_rel': 1e-9, 'double_abs': 0}
AREA = {'double_rel': 1e-9, 'double_abs': 1e-15}


def text(x):
    return mpmath.nstr(mpf(x), DIGITS, strip_zeros=True, min_fixed=-5, max_fixed=20)


def case(family, name, kind, geometry, values, derived, tol=None):
    """values: {name: value} or {name: (value, tolerances)}."""
    cases = families.setdefault(family, [])
    out = []
    for n, v in values.items():
        v, t = v if isinstance(v, tuple) else (v, tol)
        out.append({'name': n, 'value': text(v), 'unit': '1', 'tol': t})
    cases.append({'id': f'{family}.{len(cases)}', 'name': name, 'kind': kind, 'geometry': geometry, 'values': out, 'derived': derived})


# ---- vectors of decimal strings and of mpf ------------------------------------------------------------------------------

def vec(p): return [mpf(c) for c in p]
def sub(a, b): return [x - y for x, y in zip(a, b)]
def dot(a, b): return sum(x * y for x, y in zip(a, b))
def cross(a, b): return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
def norm(a): return sqrt(dot(a, a))
def unit(a): return [x / norm(a) for x in a]
def strings(polygon): return [[str(c) for c in p] for p in polygon]


def clip(polygon, p, n):
    out = []
    for a, b in zip(polygon, polygon[1:] + polygon[:1]):
        da, db = dot(sub(a, p), n), dot(sub(b, p), n)
        if da >= 0:
            out.append(a)
        if (da > 0 > db) or (da < 0 < db):
            out.append([x + (y - x) * da / (da - db) for x, y in zip(a, b)])
    return out


def lambert(p, n, polygon):
    """Element to polygon by the sum over edges; at 60 digits nothing is lost far away."""
    polygon = clip([vec(c) for c in polygon], p, n)
    total = mpf(0)
    for a, b in zip(polygon, polygon[1:] + polygon[:1]):
        a, b = sub(a, p), sub(b, p)
        c = cross(a, b)
        if norm(c) > 0:
            total += atan2(norm(c), dot(a, b)) * dot(n, c) / norm(c)
    return max(mpf(0), -total / (2 * pi))


def newell(polygon):
    p = [vec(c) for c in polygon]
    n = [mpf(0)] * 3
    for a, b in zip(p[1:-1], p[2:]):
        n = [x + y for x, y in zip(n, cross(sub(a, p[0]), sub(b, p[0])))]
    return n


def area(polygon): return norm(newell(polygon)) / 2


def parallel(x1, y1, x2, y2, h):
    """A1 F12 of parallel rectangles by inclusion and exclusion (Howell C-13)."""
    def g(x, y):
        a, b = sqrt(x * x + h * h), sqrt(y * y + h * h)
        r = mpf(0)
        if x or y:
            r += y * a * atan(y / a) + x * b * atan(x / b)
        return (r - h * h / 2 * log(x * x + y * y + h * h)) / (2 * pi)
    total = mpf(0)
    for i, a in enumerate(x1):
        for j, b in enumerate(x2):
            for k, c in enumerate(y1):
                for m, d in enumerate(y2):
                    total += (-1) ** (i + j + k + m) * g(a - b, c - d)
    return total


def contour(p, q):
    """A1 F12 by the double contour integral, inner edges in closed form, outer ones by tanh-sinh."""
    p, q = [vec(c) for c in p], [vec(c) for c in q]
    total = mpf(0)
    for a, b in zip(p, p[1:] + p[:1]):
        la = norm(sub(b, a))
        da = unit(sub(b, a))
        for c, d in zip(q, q[1:] + q[:1]):
            ld = norm(sub(d, c))
            dd = unit(sub(d, c))
            k = dot(da, dd)
            if abs(k) < mpf(10) ** -50:
                continue

            def inner(t):
                r = [x + t * y - z for x, y, z in zip(a, da, c)]
                s = dot(r, dd)
                h = sqrt(max(mpf(0), dot(r, r) - s * s))

                def f(x):
                    r2 = x * x + h * h
                    return (x * log(r2) / 2 if r2 > 0 else mpf(0)) - x + (h * atan2(x, h) if h > 0 else mpf(0))
                return f(s) - f(s - ld)
            total += k * quad(inner, mpmath.linspace(0, la, 5))
    return total / (2 * pi)


# ---- form factors -------------------------------------------------------------------------------------------------------

def element_cases():
    f = 'own.element'
    o, up = vec((0, 0, 0)), vec((0, 0, 1))

    def add(name, polygon, tol=CLOSED, n=up, p=o):
        geometry = {'element': {'p': [text(x) for x in p], 'n': [text(x) for x in n]}, 'polygon': strings(polygon)}
        case(f, name, 'form_factor/element_polygon', geometry, {'F': lambert(p, n, polygon)}, "Lambert's sum at 60 digits", tol)

    add('a wall 1e-6 before the element', [('0.000001', 0, 1), ('0.000001', 1, 1), ('0.000001', 1, 0), ('0.000001', 0, 0)])
    add('1e-7 under a square', [(-1, 1, '1e-7'), (1, 1, '1e-7'), (1, -1, '1e-7'), (-1, -1, '1e-7')])
    add('a square at 1e7, oblique', [(9000000, 1, 10000000), (9000001, 1, 10000000), (9000001, 0, 10000000), (9000000, 0, 10000000)], FAR)
    add('a triangle at 100, near the horizon', [(100, 0, '0.02'), (100, '0.5', '0.01'), (100, '0.25', '0.5')][::-1], {'double_rel': 1e-9, 'double_abs': 0})
    add('a triangle, two corners far below the horizon', [(2, -1, '-50'), (2, 0, '0.5'), (2, 1, '-70')])
    add('a sliver of 1e-6', [(-1, '0.5', 1), (1, '0.5', 1), (1, '0.499999', 1), (-1, '0.499999', 1)], {'double_rel': 1e-9, 'double_abs': 0})
    add('concave, seen askew', [(0, 0, 1), (2, 0, 1), (2, -1, 1), (-1, -1, 1), (-1, 2, 1), (0, 2, 1)], n=unit(vec((1, 2, 5))))

    def disc(name, c, r, n, tol=CLOSED):
        # Contour integral over the arc above the element's horizon and the chord on it (which adds nothing: there n.(r x dr) = 0).
        n = unit(vec(n))
        c = vec(c)
        r = mpf(r)

        def integrand(t):
            x = [c[0] + r * cos(t), c[1] + r * sin(t), c[2]]
            return dot(n, cross(x, [-r * sin(t), r * cos(t), mpf(0)])) / dot(x, x)
        middle, slope = atan2(n[1], n[0]), sqrt(n[0] ** 2 + n[1] ** 2)
        e = dot(n, c)
        half = pi if e >= slope * r else acos(-e / (slope * r))
        total = quad(integrand, mpmath.linspace(middle - half, middle + half, 33)) / (2 * pi)
        if half < pi:  # the chord lies in the element's plane
            a, b = ([c[0] + r * cos(middle + s * half), c[1] + r * sin(middle + s * half), c[2]] for s in (1, -1))
            k = cross(a, b)
            total += atan2(norm(k), dot(a, b)) * dot(n, k) / norm(k) / (2 * pi)
        case(f, name, 'form_factor/element_disc',
             {'element': {'p': ['0', '0', '0'], 'n': [text(x) for x in n]}, 'disc': {'centre': [text(x) for x in c], 'normal': ['0', '0', '-1'], 'radius': text(r)}},
             {'F': total}, 'contour integral by tanh-sinh at 60 digits', tol)

    disc('disc askew, above the horizon', ('0.3', '-0.2', 1), '0.5', (0, '0.6', '0.8'))
    disc('disc cut by the horizon', (2, '0.5', '0.7'), '1.5', ('-0.6', 0, '0.8'))
    disc('under the rim of a disc at 0.001', (1, 0, '0.001'), 1, (0, 0, 1))
    disc('far disc, askew', (30000, 0, 40000), 1, (0, '0.28', '0.96'), FAR)

    def sphere(degrees, h, tol=CLOSED):
        a, h = mpf(degrees) * pi / 180, mpf(h)
        x, c, s = sqrt(h * h - 1), cos(a), sin(a)
        if mpf(degrees) <= 90 and c >= 1 / h:
            value = c / h ** 2
        else:
            y = -x * c / s
            value = (c * acos(y) - x * s * sqrt(1 - y * y)) / (pi * h * h) + atan(s * sqrt(1 - y * y) / x) / pi
        case(f, f'sphere at {h} radii, {degrees} degrees off the normal', 'form_factor/element_sphere',
             {'angle_deg': str(degrees), 'distance': text(h), 'radius': '1'}, {'F': value}, 'closed form at 60 digits', tol)

    sphere(80, '1.0001')
    sphere('89.9', 500, FAR)
    sphere(90, 100000, FAR)
    sphere(119, 2)
    sphere(33, '7.5')


def pair_cases():
    f = 'own.pair'

    def add(name, p, q, exchange, derived, tol=AREA):
        case(f, name, 'form_factor/polygon_polygon', {'from': strings(p), 'to': strings(q)},
             {'F12': exchange / area(p), 'F21': exchange / area(q)}, derived, tol)

    def flat(x0, x1, y0, y1, z, up):
        q = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        return q if up else q[::-1]

    def facing(name, x1, y1, x2, y2, h, tol=AREA):
        ex = parallel([mpf(a) for a in x1], [mpf(a) for a in y1], [mpf(a) for a in x2], [mpf(a) for a in y2], mpf(h))
        add(name, flat(*x1, *y1, '0', True), flat(*x2, *y2, h, False), ex, 'closed form at 60 digits', tol)

    facing('gap of 1e-7', ('0', '1'), ('0', '1'), ('0', '1'), ('0', '1'), '1e-7')
    facing('passing each other at 1e-5', ('0', '1'), ('0', '1'), ('1', '2'), ('0', '1'), '1e-5')
    facing('at 1e7', ('0', '1'), ('0', '1'), ('3', '5'), ('0', '1'), '1e7', FAR)
    facing('sliver of 1e-6 below a square', ('0', '1'), ('0', '1e-6'), ('0', '1'), ('0', '1'), '1', {'double_rel': 1e-9, 'double_abs': 0})
    facing('two slivers across each other', ('0', '1e-5'), ('-1', '1'), ('-1', '1'), ('0', '1e-5'), '0.25', {'double_rel': 1e-9, 'double_abs': 0})
    p, q = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [('0.5', '1.5', '0.75'), (2, '0.25', '1.5'), ('0.25', '0.25', 1)]
    add('two general triangles', p, q, contour(p, q), 'contour integral by tanh-sinh')
    p, q = [(0, 0, 0), ('0.0001', 0, 0), (0, 1, 0)], [(0, 0, 0), (0, 1, 0), (0, 0, 1)]
    add('sliver triangle at the foot of a wall', p, q, contour(p, q), 'contour integral by tanh-sinh')
    for degrees, w1, w2 in (('1', '1', '1'), ('179', '1', '1'), ('120', '3', '0.01')):
        a = mpf(degrees) * pi / 180
        p = [(0, 0, 0), (w1, 0, 0), (w1, 2, 0), (0, 2, 0)]
        far = (mpf(w2) * cos(a), mpf(w2) * sin(a))
        q = [(0, 0, 0), (0, 2, 0), (far[0], 2, far[1]), (far[0], 0, far[1])]
        ex = contour(p, q)
        case(f, f'rectangles hinged at {degrees} degrees', 'form_factor/hinged_rectangles',
             {'width1': w1, 'width2': w2, 'edge': '2', 'angle_deg': degrees}, {'F12': ex / area(p), 'F21': ex / area(q)},
             'contour integral by tanh-sinh', {'double_rel': 1e-8, 'double_abs': 1e-15})
    for r1, r2, d in (('1', '1', '1e-6'), ('2', '0.001', '3'), ('1', '2', '1e5')):
        R1, R2 = mpf(r1) / mpf(d), mpf(r2) / mpf(d)
        s = 1 + (1 + R2 ** 2) / R1 ** 2
        v = (s - sqrt(s * s - 4 * (R2 / R1) ** 2)) / 2
        case(f, f'coaxial discs {r1}, {r2} at {d}', 'form_factor/coaxial_discs', {'r1': r1, 'r2': r2, 'distance': d},
             {'F12': v, 'F21': v * (R1 / R2) ** 2}, 'closed form at 60 digits', {'double_rel': 1e-11})

    def occluded(name, edge, share=None):
        # A half plane x >= edge half-way up: from x one sees the part of the other square below 2 edge - x.
        whole = parallel([mpf('-0.5'), mpf('0.5')], [mpf('-0.5'), mpf('0.5')], [mpf('-0.5'), mpf('0.5')], [mpf('-0.5'), mpf('0.5')], mpf(1))
        e = mpf(edge)
        if share is None:
            mp.dps = 20

            def seen(x, y):
                end = min(mpf('0.5'), 2 * e - x)
                return lambert([x, y, mpf(0)], vec((0, 0, 1)), flat('-0.5', end, '-0.5', '0.5', 1, False)) if end > mpf('-0.5') else mpf(0)
            kink = 2 * e - mpf('0.5')
            knots = [mpf('-0.5')] + ([kink] if -0.5 < kink < 0.5 else []) + [mpf('0.5')]
            share = quad(lambda x: quad(lambda y: seen(x, y), [mpf('-0.5'), mpf('0.5')], maxdegree=4), knots, maxdegree=4) / whole
            share = mpf(mpmath.nstr(share, 9))
            mp.dps = 60
        tol = {'double_rel': 1e-7, 'solver_rel': 0.01}
        square = {'x': ['-0.5', '0.5'], 'y': ['-0.5', '0.5']}
        case(f, name, 'form_factor/occluded_rectangles',
             {'from': {**square, 'z': '0', 'normal': '+z'}, 'to': {**square, 'z': '1', 'normal': '-z'},
              'blocker': {'x': [edge, '3'], 'y': ['-3', '3'], 'z': '0.5'}},
             {'F12': (share * whole, tol), 'F12_unoccluded': (whole, CLOSED), 'visible_share': (share, tol)},
             "Lambert's sum to the part that is seen, by quadrature")

    occluded('half plane at 0.2', '0.2')
    occluded('half plane that leaves little', '-0.4')
    occluded('half plane through the middle: one half by symmetry', '0', mpf(1) / 2)
    occluded('half plane that leaves nothing', '-0.5', mpf(0))


# ---- light --------------------------------------------------------------------------------------------------------------

def light_cases():
    f = 'own.light'
    tight = {'double_rel': 1e-12, 'double_abs': 1e-15}

    def att(c, l, q, d, window=None):
        g = {'constant': c, 'linear': l, 'quadratic': q, 'distance': d}
        v = 1 / (mpf(c) + mpf(l) * mpf(d) + mpf(q) * mpf(d) ** 2)
        if window:
            g['window'] = dict(zip(('range', 'power'), window))
            v *= max(mpf(0), min(mpf(1), 1 - (mpf(d) / mpf(window[0])) ** mpf(window[1])))
        case(f, 'attenuation', 'attenuation', g, {'attenuation': v}, 'by the formula', {'double_rel': 1e-13, 'double_abs': 1e-16})

    att('1', '0.4', '0.04', '2500')
    att('0.001', '0', '7', '0.003', ('0.5', '2.5'))
    att('1', '0', '0', '9', ('8', '4'))
    case(f, 'all coefficients zero', 'attenuation/guard', {'constant': '0', 'linear': '0', 'quadratic': '0', 'distance': '2'}, {}, 'finite')

    def element(p, n): return {'p': list(p), 'n': list(n)}
    at = element(('0', '0', '0'), ('0', '0', '1'))
    d = sqrt(mpf(3) ** 2 + mpf('0.7') ** 2)
    case(f, 'point light low above the plane', 'irradiance/point', {'intensity': '123.4', 'position': ['3', '0', '0.7'], 'element': at},
         {'E': mpf('123.4') * mpf('0.7') / d ** 3}, 'inverse square', tight)
    v = mpf('50') / (1 + mpf('0.25') * d + mpf('0.0625') * d * d) * mpf('0.7') / d * (1 - (d / 8) ** 3)
    case(f, 'classic light', 'irradiance/point_attenuated',
         {'intensity': '50', 'position': ['3', '0', '0.7'], 'constant': '1', 'linear': '0.25', 'quadratic': '0.0625', 'element': at,
          'window': {'range': '8', 'power': '3'}}, {'E': v}, 'by the formula', tight)

    def texel(x0, x1, y0, y1, h):
        def s(x, y): return atan(x * y / (h * sqrt(x * x + y * y + h * h)))
        x0, x1, y0, y1 = (mpf(a) for a in (x0, x1, y0, y1))
        return (s(x1, y1) - s(x0, y1) - s(x1, y0) + s(x0, y0)) / ((x1 - x0) * (y1 - y0))
    for x, y, h in ((('200', '201'), ('-3', '-2'), '1e-4'), (('-1e-3', '1e-3'), ('0', '1e-3'), '50')):
        cx, cy = (mpf(x[0]) + mpf(x[1])) / 2, (mpf(y[0]) + mpf(y[1])) / 2
        case(f, 'texel mean', 'irradiance/point_texel_mean',
             {'intensity': '3', 'position': ['0', '0', h], 'texel': {'x': list(x), 'y': list(y), 'z': '0', 'n': ['0', '0', '1']}},
             {'E_mean': 3 * texel(*x, *y, mpf(h)), 'E_centre': 3 * mpf(h) / sqrt(cx * cx + cy * cy + mpf(h) ** 2) ** 3},
             'solid angle at 60 digits', {'double_rel': 1e-11})

    def spot(inner, outer, x, h):
        i, o, x, h = (mpf(a) for a in (inner, outer, x, h))
        d = sqrt(x * x + h * h)
        w = max(mpf('0.001'), cos(i) - cos(o))
        cone = max(mpf(0), min(mpf(1), (h / d - cos(o)) / w)) ** 2
        ramp = min(w, 1 - cos(o))
        case(f, f'spot {inner} to {outer}', 'irradiance/spot',
             {'intensity': '70', 'position': [text(x), '0', text(h)], 'direction': ['0', '0', '-1'], 'inner_cone': inner, 'outer_cone': outer, 'element': at},
             {'E': 70 * cone * h / d ** 3, 'flux': 70 * 2 * pi * (ramp ** 3 / (3 * w * w) + 1 - cos(o) - ramp)}, 'by the formula', {'double_rel': 1e-11, 'double_abs': 1e-15})
    spot('0.01', '0.02', '0.05', '4')
    spot('0.3', '1.2', '3', '2')

    case(f, 'grazing sun', 'irradiance/directional', {'normal_irradiance': '80000', 'angle_deg': '89.9999'},
         {'E': 80000 * cos(mpf('89.9999') * pi / 180)}, 'cosine', {'double_rel': 1e-10})
    for offset in ('-0.99', '0.3'):
        a = mpf('0.2665') * pi / 180
        t = mpf(offset) * tan(a)
        s = sin(a)
        k = t / sqrt(1 + t * t)
        knot = sqrt((s * s - k * k) / (1 - k * k))
        width = quad(lambda y: max(mpf(0), min(sqrt(s * s - y * y), k * sqrt(1 - y * y)) + sqrt(s * s - y * y)), [-s, -knot, 0, knot, s])
        case(f, f'sun beside an edge at {offset} of its radius', 'irradiance/sun_edge', {'angular_radius_deg': '0.2665', 'edge_offset': offset},
             {'visible_fraction': width / (pi * s * s)}, 'quadrature over the projected disc', {'double_rel': 1e-9})
    case(f, 'sphere', 'irradiance/sphere', {'centre': ['3', '0', '4'], 'radius': '2', 'radiosity': '7', 'element': at},
         {'E': 7 * mpf('0.8') * mpf(4) / 25}, 'cosine times (R/d)^2', tight)
    case(f, 'disc on the axis', 'irradiance/disc', {'centre': ['0', '0', '0.001'], 'normal': ['0', '0', '-1'], 'radius': '2', 'radiosity': '7', 'element': at},
         {'E': 7 * mpf(4) / (4 + mpf('1e-6'))}, 'R^2/(R^2 + h^2)', tight)
    up, o = vec((0, 0, 1)), vec((0, 0, 0))
    tri = [(5, '-1', '0.5'), (4, '0.5', '-1'), (6, 1, 2)]
    if lambert(o, up, tri) == 0:
        tri = tri[::-1]
    case(f, 'triangle through the horizon', 'irradiance/polygon', {'polygon': strings(tri), 'radiosity': '50', 'element': at},
         {'E': 50 * lambert(o, up, tri)}, "Lambert's sum", CLOSED)

    solver = {'double_rel': 1e-11, 'solver_rel': 0.01}
    xs = ['-0.3', '0.05', '0.35']
    # A half plane x >= 0 half-way up hides what lies beyond -x on a panel of half side 0.5 at 2.
    panel = lambda end: [('-0.5', '0.5', 2), (end, '0.5', 2), (end, '-0.5', 2), ('-0.5', '-0.5', 2)]
    case(f, 'penumbra', 'irradiance/penumbra_half_plane',
         {'panel_half_side': '0.5', 'panel_height': '2', 'radiosity': '3', 'blocker': {'z': '1', 'x_min': '0'}, 'x': xs, 'element_n': ['0', '0', '1']},
         {f'E[{i}]': 3 * lambert([mpf(x), mpf(0), mpf(0)], up, panel(min(mpf('0.5'), -mpf(x)))) for i, x in enumerate(xs)},
         "Lambert's sum over what is seen", solver)
    # A blocker of half side 0.1 at a quarter of the height throws a shadow of half side 0.4 about -3 x on the panel.
    xs = ['0', '0.05', '1']

    def blocked(x):
        x = mpf(x)
        lo, hi = max(mpf(-1), -3 * x - mpf('0.4')), min(mpf(1), -3 * x + mpf('0.4'))
        whole = lambert([x, mpf(0), mpf(0)], up, [(-1, 1, 4), (1, 1, 4), (1, -1, 4), (-1, -1, 4)])
        return whole - (lambert([x, mpf(0), mpf(0)], up, [(lo, '0.4', 4), (hi, '0.4', 4), (hi, '-0.4', 4), (lo, '-0.4', 4)]) if hi > lo else 0)
    case(f, 'small blocker low above the floor', 'irradiance/panel_blocker',
         {'panel_half_side': '1', 'panel_height': '4', 'blocker_half_side': '0.1', 'blocker_height': '1', 'radiosity': '2', 'x': xs, 'element_n': ['0', '0', '1']},
         {f'E[{i}]': 2 * blocked(x) for i, x in enumerate(xs)}, "Lambert's sum less the shadow", solver)


def sky_radiance(kind, g):
    if kind == 'uniform':
        return mpf(1)
    if kind == 'Moon-Spencer':
        return (1 + 2 * sin(g)) / 3
    return (1 + 4 * exp(-mpf('0.7') / sin(g))) / (1 + 4 * exp(-mpf('0.7'))) if g > 0 else 1 / (1 + 4 * exp(-mpf('0.7')))


def sky_cases():
    f = 'own.sky'
    mp.dps = 25

    def tilted(kind, degrees):
        t = mpf(degrees) * pi / 180

        def ring(g):
            a, b = sin(g) * cos(t), cos(g) * sin(t)
            p = pi if a >= b else mpf(0) if a <= -b else acos(-a / b)
            return sky_radiance(kind, g) * cos(g) * 2 * (p * a + sin(p) * b)
        knots = sorted({mpf(0), min(t, pi - t), pi / 2})
        return quad(ring, knots)
    for kind, degrees in (('uniform', '137'), ('Moon-Spencer', '30'), ('Moon-Spencer', '120'), ('CIE type 1', '45'), ('CIE type 1', '0')):
        case(f, f'{kind} sky on a surface tilted by {degrees} degrees', 'irradiance/sky', {'sky': kind, 'zenith_radiance': '2', 'tilt_deg': degrees},
             {'E': 2 * tilted(kind, degrees)}, 'quadrature over elevations', {'double_rel': 1e-10})
    up, p = vec((0, 0, 1)), vec(('0.5', '0.3', 0))
    opening = [(0, 3, 2), (3, 3, 2), (3, 0, 2), (0, 0, 2)]
    values = {'E/Eh uniform': lambert(p, up, opening)}
    for kind in ('Moon-Spencer', 'CIE type 1'):
        def seen(x, y):
            r2 = (x - p[0]) ** 2 + (y - p[1]) ** 2 + 4
            return sky_radiance(kind, asin(2 / sqrt(r2))) * 4 / r2 ** 2
        values[f'E/Eh {kind}'] = quad(seen, [0, p[0], 3], [0, p[1], 3]) / tilted(kind, '0')
    case(f, 'roof opening', 'cie/roof_opening', {'room': ['3', '3', '2'], 'opening': strings(opening), 'point': ['0.5', '0.3', '0']}, values,
         'quadrature over the opening', {'double_rel': 1e-10})
    mp.dps = 60
    window = [(0, -1, '0.5'), (0, 2, '0.5'), (0, 2, 2), (0, -1, 2)]
    q, n = vec((2, 0, 1)), unit(vec((-1, 0, 0)))
    sky, ground = lambert(q, n, clip([vec(c) for c in window], q, up)), lambert(q, n, clip([vec(c) for c in window], q, [-c for c in up]))
    case(f, 'facade opening, element that faces it', 'cie/facade_opening', {'window': strings(window), 'point': ['2', '0', '1'], 'normal': ['-1', '0', '0']},
         {'E/Eh uniform sky, black ground': sky, 'E/Eh uniform sky, endless ground of albedo 0.45': sky + mpf('0.45') * ground}, "Lambert's sum", CLOSED)
    o = vec((2, 0, 0))
    slope = tan(mpf(35) * pi / 180)
    above = clip([vec(c) for c in window], o, [slope, mpf(0), mpf(1)])
    case(f, 'mask up to 35 degrees', 'cie/mask', {'window': strings(window), 'point': ['2', '0', '0'], 'mask_elevation_deg': '35'},
         {'E/Eh uniform': (lambert(o, up, above), {'double_rel': 1e-11, 'solver_rel': 0.01})}, "Lambert's sum over what is seen")


# ---- enclosures ---------------------------------------------------------------------------------------------------------

def solve(factors, emission, albedo):
    n = len(emission)
    a = mpmath.matrix(n, n)
    for i in range(n):
        for j in range(n):
            a[i, j] = (1 if i == j else 0) - albedo[i] * factors[i][j]
    return list(mpmath.lu_solve(a, mpmath.matrix(emission)))


def enclosure_cases():
    f = 'own.enclosure'
    solver = {'double_rel': 1e-12, 'solver_rel': 0.005}
    tight = {'double_rel': 1e-12}
    for albedo in ('0.3', '0.999'):
        v = 1 / (1 - mpf(albedo))
        terms = 1
        while mpf(albedo) ** terms > mpf('1e-3'):
            terms += 1
        case(f, f'white furnace, albedo {albedo}', 'enclosure/furnace', {'albedo': albedo, 'emission': '1'},
             {'B': (v, solver), 'H': (v, solver), 'series_terms_to_1e-3': (mpf(terms), {'double_rel': 0})}, 'E/(1 - rho)')
    parts = [('0.001', '1000', '0.2'), ('0.499', '0', '0.999'), ('0.5', '0', '0.97')]
    e = sum(mpf(s) * mpf(m) for s, m, _ in parts)
    r = sum(mpf(s) * mpf(a) for s, _, a in parts)
    h = e / (1 - r)
    case(f, 'integrating sphere', 'enclosure/integrating_sphere', {'parts': [dict(zip(('area_share', 'emission', 'albedo'), p)) for p in parts]},
         {'H': h, **{f'B[{i}]': mpf(m) + mpf(a) * h for i, (_, m, a) in enumerate(parts)}}, '<E>/(1 - <rho>)', tight)
    for kind, k in (('concentric_spheres', 2), ('coaxial_cylinders', 1)):
        q = (1 / mpf('1.00001')) ** k
        b = solve([[0, 1], [q, 1 - q]], [mpf(1), mpf('0.5')], [mpf('0.999'), mpf('0.9')])
        case(f, kind.replace('_', ' '), f'enclosure/{kind}', {'r1': '1', 'r2': '1.00001', 'emission': ['1', '0.5'], 'albedo': ['0.999', '0.9']},
             {'B1': b[0], 'B2': b[1], 'F21': q, 'F22': 1 - q}, '2 x 2 system', tight)
    b = solve([[0, 1], [1, 0]], [mpf(1), mpf(0)], [mpf('0.9999'), mpf('0.9998')])
    case(f, 'endless plates, nearly white', 'enclosure/infinite_plates', {'emission': ['1', '0'], 'albedo': ['0.9999', '0.9998']}, {'B1': b[0], 'B2': b[1]},
         '2 x 2 system', tight)
    case(f, 'energy balance', 'enclosure/identity', {'scene': 'any closed scene'}, {'sum A (1-rho) H over sum A E': (mpf(1), {'double_rel': 1e-12, 'solver_rel': 0.01})}, 'energy')

    a, b, c = mpf(2), mpf(3), mpf('0.1')

    def opposite(x, y, z): return parallel([mpf(0), x], [mpf(0), y], [mpf(0), x], [mpf(0), y], z)
    ex = {(0, 1): opposite(a, b, c), (2, 3): opposite(b, c, a), (4, 5): opposite(a, c, b)}
    areas = [a * b, a * b, b * c, b * c, a * c, a * c]
    # Rows sum to the areas and faces that lie opposite each other are alike: three unknown pairs, three equations.
    xy, xz, yz = areas[0] - ex[0, 1], areas[2] - ex[2, 3], areas[4] - ex[4, 5]
    zx, zy, xy2 = (xy + xz - yz) / 4, (xy - xz + yz) / 4, (xz + yz - xy) / 4

    def exchange(i, j):
        if i // 2 == j // 2:
            return ex[min(i, j), max(i, j)] if i != j else mpf(0)
        return {(0, 1): zx, (0, 2): zy, (1, 2): xy2}[tuple(sorted((i // 2, j // 2)))]
    factors = [[exchange(i, j) / areas[i] for j in range(6)] for i in range(6)]
    emission, albedo = ['0', '2', '0', '0', '1', '0'], ['0.999', '0.9', '0.5', '0.99', '0.2', '0.8']
    sol = solve(factors, [mpf(x) for x in emission], [mpf(x) for x in albedo])
    case(f, 'thin box, six zones', 'enclosure/zonal_box',
         {'size': ['2', '3', '0.1'], 'faces': ['z=0', 'z=c', 'x=0', 'x=a', 'y=0', 'y=b'], 'emission': emission, 'albedo': albedo},
         {**{f'B[{i}]': sol[i] for i in range(6)}, 'F01': factors[0][1], 'F02': factors[0][2], 'F24': factors[2][4]},
         'closed forms of opposite faces, the others by closure', {'double_rel': 1e-11})

    # Two endless strips: Nystroem with 40 Gauss nodes, kernel g^2/(2 (g^2 + x^2)^(3/2)).
    w, g, rho = mpf(1), mpf('0.5'), [mpf('0.9'), mpf('0.6')]
    mp.dps = 30
    nodes = mpmath.calculus.quadrature.GaussLegendre(mp).calc_nodes(5, 120)
    nodes = [((x + 1) * w / 2, y * w / 2) for x, y in nodes]
    n = len(nodes)
    def kernel(x, y): return g * g / (2 * (g * g + (x - y) ** 2) ** mpf('1.5'))
    m = mpmath.matrix(2 * n, 2 * n)
    for i in range(n):
        m[i, i] = m[n + i, n + i] = mpf(1)
        for j in range(n):
            k = kernel(nodes[i][0], nodes[j][0]) * nodes[j][1]
            m[i, n + j], m[n + i, j] = -rho[0] * k, -rho[1] * k
    rad = list(mpmath.lu_solve(m, mpmath.matrix([mpf(1)] * n + [mpf(0)] * n)))
    def seen(x, part): return sum(kernel(x, nodes[j][0]) * nodes[j][1] * rad[part * n + j] for j in range(n))
    def mean(part): return sum(nodes[i][1] * seen(nodes[i][0], 1 - part) for i in range(n)) / w
    two = {'double_rel': 1e-12, 'solver_rel': 0.005}
    case(f, 'endless strips', 'enclosure/strips2d', {'width': '1', 'gap': '0.5', 'emission': ['1', '0'], 'albedo': ['0.9', '0.6']},
         {k: mpf(mpmath.nstr(v, 15)) for k, v in {'H1_mean': mean(0), 'H2_mean': mean(1), 'H1_middle': seen(w / 2, 1), 'H1_edge': seen(mpf(0), 1), 'H2_edge': seen(mpf(0), 0)}.items()},
         'Nystroem, Gauss-Legendre', two)
    mp.dps = 60
    # A black corner: direct light alone, Hottel's strings and the sine rule.
    t, w1, w2 = mpf(30) * pi / 180, mpf(1), mpf(3)
    far = sqrt(w1 ** 2 + w2 ** 2 - 2 * w1 * w2 * cos(t))

    def onto(share):  # H at a place of side 2: (cos of the angle to the corner's side less that to the far end)/2, angles from the surface
        s = share * w2
        r = sqrt(s * s + w1 * w1 - 2 * s * w1 * cos(t))
        return (1 + (w1 * cos(t) - s) / r) / 2
    case(f, 'black corner of 30 degrees', 'enclosure/corner2d', {'width1': '1', 'width2': '3', 'angle_deg': '30', 'emission': ['1', '0'], 'albedo': ['0', '0']},
         {'H2_mean': (w1 + w2 - far) / (2 * w2), 'H2_at_1%': onto(mpf('0.01')), 'H2_at_50%': onto(mpf('0.5')), 'H2_at_100%': onto(mpf(1)), 'H1_mean': mpf(0)},
         'crossed strings', two)
    case(f, 'tube whose sides are alike', 'enclosure/tube2d', {'side': '2', 'sides': ['bottom', 'right', 'top', 'left'], 'emission': ['1'] * 4, 'albedo': ['0.95'] * 4},
         {'H_mean[0]': mpf(20), 'H_middle[3]': mpf(20)}, 'E/(1 - rho)', two)
    square = [(0, 1, '0.3'), (1, 1, '0.3'), (1, 0, '0.3'), (0, 0, '0.3')]
    up = vec((0, 0, 1))
    direct = {'double_rel': 1e-11, 'solver_rel': 0.01}
    case(f, 'black plates', 'enclosure/square_plates', {'side': '1', 'gap': '0.3', 'emission': ['0', '1'], 'albedo': ['0', '0']},
         {'H1_mean': opposite(mpf(1), mpf(1), mpf('0.3')), 'H1_centre': lambert(vec(('0.5', '0.5', 0)), up, square), 'H1_corner': lambert(vec((0, 0, 0)), up, square),
          'H2_mean': mpf(0)}, 'closed forms', direct)
    faces = ['z=0', 'z=1', 'x=0', 'x=1', 'y=0', 'y=1']
    op = opposite(mpf(1), mpf(1), mpf(1))
    ceiling = [(0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]
    case(f, 'black cube under a bright ceiling', 'enclosure/true_cube', {'side': '1', 'faces': faces, 'albedo': ['0'] * 6, 'emission': ['0', '1', '0', '0', '0', '0']},
         {'H_mean[0]': op, 'H_mean[3]': (1 - op) / 4, 'H_mean[1]': mpf(0), 'H_centre[0]': lambert(vec(('0.5', '0.5', 0)), up, ceiling),
          'H_centre[2]': lambert(vec((0, '0.5', '0.5')), vec((1, 0, 0)), ceiling)}, 'closed forms', direct)
    case(f, 'cube whose walls are alike', 'enclosure/true_cube', {'side': '1', 'faces': faces, 'albedo': ['0.98'] * 6, 'emission': ['1'] * 6},
         {'H_mean[0]': mpf(50), 'H_centre[5]': mpf(50)}, 'E/(1 - rho)', direct)


def room_cases():
    f = 'own.room'
    up = vec((0, 0, 1))
    solver = {'double_rel': 1e-11, 'solver_rel': 0.01}

    def exchange(x, y, room):  # opening in the ceiling to the floor
        return parallel([mpf(c) for c in x], [mpf(c) for c in y], [mpf(0), mpf(room[0])], [mpf(0), mpf(room[1])], mpf(room[2]))
    room, x, y = ('5', '5', '0.5'), ('2', '3'), ('2', '3')
    floor = exchange(x, y, room)
    case(f, 'flux through a roof opening of a low room', 'cie/flux_conservation', {'room': list(room), 'opening_in_ceiling': {'x': list(x), 'y': list(y)}, 'sky': 'uniform', 'albedo': '0'},
         {'F(opening->floor)': floor, **{f'F(opening->{s})': (1 - floor) / 4 for s in ('x=0', 'x=a', 'y=0', 'y=b')}, 'sum': mpf(1)}, 'closed form and symmetry', {'double_rel': 1e-10})
    panel = [(-1, 1, 2), (1, 1, 2), (1, -1, 2), (-1, -1, 2)]
    case(f, 'panel, far floor point', 'cie/area_source', {'panel': strings(panel), 'point': ['40', '0', '0'], 'radiosity': '5'}, {'E': 5 * lambert(vec((40, 0, 0)), up, panel)},
         "Lambert's sum", {'double_rel': 1e-10})
    plate = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    n, p = vec((-1, 0, 0)), vec(('1.001', '0.2', '0.001'))
    case(f, 'plate, upright element at its rim', 'cie/diffuse_plate', {'plate': strings(plate), 'element': {'p': ['1.001', '0.2', '0.001'], 'n': ['-1', '0', '0']}},
         {'E/(rho E_plate)': lambert(p, n, plate)}, "Lambert's sum", {'double_rel': 1e-10})
    # A screen at x = 2 up to 0.5, element at (3, 0, 1): what is seen ends where the line over its edge meets the plate, at x = 1.
    plate = [(-1, -2, 0), ('1.5', -2, 0), ('1.5', 2, 0), (-1, 2, 0)]
    seen = [(-1, -2, 0), (1, -2, 0), (1, 2, 0), (-1, 2, 0)]
    case(f, 'plate behind a screen', 'cie/plate_screen', {'plate': strings(plate), 'screen': {'plane': 'x=2', 'z': ['0', '0.5']}, 'element': {'p': ['3', '0', '1'], 'n': ['-1', '0', '0']}},
         {'E/(rho E_plate)': lambert(vec((3, 0, 1)), n, seen)}, "Lambert's sum over what is seen", solver)
    for albedo in ('0.6', '0.99'):
        direct = mpf(3000) / (6 * 25)
        case(f, f'point source in a cube of albedo {albedo}', 'cie/interreflection', {'side': '5', 'flux': '3000', 'albedo': albedo},
             {'E_indirect_mean': direct * mpf(albedo) / (1 - mpf(albedo)), 'E_total_mean': direct / (1 - mpf(albedo))}, 'energy balance', {'double_rel': 1e-12, 'solver_rel': 0.01})
    case(f, 'its direct light near a corner', 'cie/interreflection_direct', {'side': '5', 'flux': '3000', 'point_on_face': ['2.5', '2.4']},
         {'E_direct': 3000 / (4 * pi) * mpf('2.5') / sqrt(2 * mpf('2.5') ** 2 + mpf('2.4') ** 2) ** 3}, 'inverse square', {'double_rel': 1e-12})
    # A box of the Cornell kind, in metres, z forwards, with a lamp in the plane of its ceiling.
    lamp = [('1.25', 2, '0.8'), ('1.25', 2, '1.2'), ('0.75', 2, '1.2'), ('0.75', 2, '0.8')]
    quads = {'floor': [(2, 0, 0), (0, 0, 0), (0, 0, 2), (2, 0, 2)], 'light': lamp, 'ceiling': [(2, 2, 0), (2, 2, 2), (0, 2, 2), (0, 2, 0)],
             'back_wall': [(2, 0, 2), (0, 0, 2), (0, 2, 2), (2, 2, 2)], 'right_wall_green': [(0, 0, 2), (0, 0, 0), (0, 2, 0), (0, 2, 2)],
             'left_wall_red': [(2, 0, 0), (2, 0, 2), ('2.01', 2, 2), (2, 2, 0)]}
    u, v = [mpf(0), mpf(0), mpf(2)], [mpf('0.01'), mpf(2), mpf(2)]
    off = abs(dot([mpf(0), mpf(2), mpf(0)], unit(cross(u, sub(v, u)))))
    single = {'double_rel': 1e-11, 'float_rel': 1e-5}
    case(f, 'a box of the Cornell kind', 'data/cornell', {'unit': 'm', 'quads': {k: strings(q) for k, q in quads.items()}},
         {'area_light': area(lamp), 'left_wall_4th_vertex_off_plane': off,
          'F_light at floor_centre (1,0,1), box without blocks': lambert(vec((1, 0, 1)), vec((0, 1, 0)), lamp),
          'F_light at back_wall_centre (1,1,2), box without blocks': lambert(vec((1, 1, 2)), vec((0, 0, -1)), lamp)}, "Lambert's sum", single)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument('--check', action='store_true')
    a = ap.parse_args()
    for make in (element_cases, pair_cases, light_cases, sky_cases, enclosure_cases, room_cases):
        make()
    wrong = 0
    for family, cases in families.items():
        document = {'schema': 'lmc-analytic/1', 'family': family, 'about': 'Written by samples/make_cases.py; change the script, not this file.', 'cases': cases}
        made = json.dumps(document, indent=1) + '\n'
        path = os.path.join(HERE, 'cases', family.replace('own.', '') + '.json')
        if a.check:
            with open(path) as file:
                same = file.read() == made
            print(f'{path}: {"same" if same else "DIFFERS"}')
            wrong += not same
        else:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, 'w') as file:
                file.write(made)
            print(f'{path}: {len(cases)} cases')
    return 1 if wrong else 0


if __name__ == '__main__':
    sys.exit(main())
