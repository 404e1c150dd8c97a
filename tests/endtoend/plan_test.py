#!/usr/bin/env python3
"""The plan through the program: for each effect a level that needs it and one that does not. What is skipped casts no ray, and the map without it
is the same as with it where it gives nothing, and within the stated bound elsewhere."""
import argparse, array, json, math, os, pathlib, subprocess, sys, tempfile

GOAL = 0.08     # the draft preset


def room(make, name, albedo=0.6, lamp=20.0, column=False, uncut=False, sky=0.0, open_top=False, panel=0.0, texels=64):
    """A room of 4 x 3 x 5 m, convex but for a column, below which the floor has a hole unless it is uncut."""
    level = make.Level(name, texels, (sky, sky, sky) if sky else None)
    level.material('wall', (albedo, albedo, albedo))
    x, y, z = 4.0, 3.0, 5.0
    walls = level.object('walls', 'wall')
    foot = [(2.6, 0.0, 3.2), (3.1, 0.0, 3.2), (3.1, 0.0, 3.7), (2.6, 0.0, 3.7)]
    level.flat(walls, [(0, 0, 0), (x, 0, 0), (x, 0, z), (0, 0, z)], (0, 1, 0), [foot] if column and not uncut else ())
    if not open_top:
        level.flat(walls, [(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)], (0, -1, 0))
    level.flat(walls, [(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)], (1, 0, 0))
    level.flat(walls, [(x, 0, 0), (x, y, 0), (x, y, z), (x, 0, z)], (-1, 0, 0))
    level.flat(walls, [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)], (0, 0, 1))
    level.flat(walls, [(0, 0, z), (x, 0, z), (x, y, z), (0, y, z)], (0, 0, -1))
    if column:
        level.box(level.object('column', 'wall'), foot[0], (3.1, 1.5, 3.7), 'xXYzZ')
    if panel > 0.0:
        level.material('glow', (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), panel)
        level.flat(level.object('panel', 'glow'), [(1, 2.9, 1), (2, 2.9, 1), (2, 2.9, 2), (1, 2.9, 2)], (0, -1, 0))
    if lamp > 0.0:
        level.light('lamp', 'point', (1.0, 1.0, 1.0), lamp, (1.2, 2.0, 1.5))
    return level


def plane(make, texels=64):
    level = make.Level('plane', texels)
    level.material('wall', (0.6, 0.6, 0.6))
    level.flat(level.object('floor', 'wall'), [(0, 0, 0), (4, 0, 0), (4, 0, 5), (0, 0, 5)], (0, 1, 0))
    level.light('lamp', 'point', (1.0, 1.0, 1.0), 20.0, (1.2, 2.0, 1.5))
    return level


def pairs_of(make, write, texels=64):
    """For each effect a level without it, where it gives nothing (True) or too little, one with it, its purposes and the reason."""
    def level(name, **how):
        return write(room(make, name, texels=texels, **how))

    lit = level('lit', column=True)
    glow = level('glow', lamp=0.0, panel=400.0)
    both = level('both', panel=400.0, column=True)
    bright_sky = level('bright_sky', sky=40.0, open_top=True, column=True)
    cast_by_bounces = ['gather', 'shoot', 'exposure']
    return [
        ('direct', True, glow, both, ['shadow'], 'no punctual lights'),
        ('shadow', True, level('empty'), lit, ['shadow'], 'nothing stands in between'),
        ('area', True, lit, level('dark', lamp=0.0, panel=400.0), ['emitter'], 'no emissive surfaces'),
        ('sky', True, lit, bright_sky, ['patch-sky'], 'no sky'),
        ('bounce', True, level('black', albedo=0.0, column=True), lit, cast_by_bounces, 'albedo 0'),
        ('ao', True, write(plane(make, texels)), lit, ['occlusion'], 'all is open'),
        ('near', True, level('pitch', albedo=0.0, column=True), lit, ['near'], 'no bounces'),
        # A lamp, an emitter, a sky, walls of so little that they fit into a quarter of the goal.
        ('direct', False, level('faint_lamp', lamp=0.2, panel=400.0, column=True), both, ['shadow'], 'too little'),
        ('area', False, level('faint_panel', panel=0.05, column=True), both, ['emitter'], 'too little'),
        ('sky', False, level('faint_sky', sky=0.01, open_top=True, column=True), bright_sky, [], 'too little'),
        ('near', False, level('dim', albedo=0.042, column=True), lit, ['near'], 'too little'),
        ('bounce', False, level('nearly_black', albedo=0.01, column=True), lit, cast_by_bounces, 'too little'),
    ]


def dressed(make, write, texels=64):
    """The room with walls of other materials, by name."""
    def red(l):
        l.material('wall', (0.6, 0.3, 0.2))

    def whole(l):
        l.materials['wall'].update(alphaMode='MASK', alphaCutoff=0.5)

    def holed(l):
        l.material('lace', (0.6, 0.6, 0.6), alphaMode='MASK', alphaCutoff=0.5)
        l.materials['lace']['pbrMetallicRoughness']['baseColorFactor'][3] = 0.25
        l.objects[[name for name, _ in l.objects].index('column')] = ('column', 'lace')

    def shiny(l):
        l.materials['wall']['pbrMetallicRoughness']['roughnessFactor'] = 0.3

    def lampless(l):
        shiny(l)
        l.lights.clear()

    def brushed(l):
        l.materials['wall'].setdefault('extensions', {})['KHR_materials_anisotropy'] = {'anisotropyStrength': 0.5}

    out = {}
    for name, change in (('grey', lambda l: None), ('red', red), ('whole', whole), ('holed', holed), ('shiny', shiny), ('lampless', lampless), ('brushed', brushed)):
        made = room(make, name, column=True, texels=texels)
        change(made)
        out[name] = write(made)
    return out


class Test:
    def __init__(self, a, folder):
        sys.path.insert(0, os.path.join(a.source_dir, 'samples'))
        import make_samples
        self.make, self.lmc, self.dump, self.out, self.bad = make_samples, a.lmc, a.dump, pathlib.Path(folder), []
        self.samples = pathlib.Path(a.source_dir, 'samples')

    def expect(self, right, what):
        if not right:
            self.bad.append(what)

    def run(self, *args, exit=0):
        r = subprocess.run([self.lmc, *map(str, args)], capture_output=True, text=True)
        self.expect(r.returncode == exit, f'{" ".join(map(str, args))}: exit {r.returncode}, not {exit}: {r.stderr}')
        return r

    def write(self, level):
        folder = self.out / level.name
        folder.mkdir(exist_ok=True)
        for name, data in self.make.build(level).items():
            (folder / name).write_bytes(data)
        return folder / (level.name + '.glb')

    def bake(self, file, name, *args):
        out = self.out / name
        self.run('bake', file, '-o', out, '--progress', 'none', '--preset', 'draft', *args)
        return out, json.loads((out / 'report.json').read_text())

    def texels(self, out):
        channels = [self.channel(out / 'lightmap.exr', c) for c in 'RGBA']
        return [t[:3] for t in zip(*channels) if t[3] == 1.0]

    def channel(self, file, name):
        raw = subprocess.run([self.dump, str(file), name], check=True, capture_output=True).stdout
        return array.array('f', raw[raw.index(b'\n') + 1:])

    def steps(self, report):
        return {s['effect']: s for s in report['plan']}

    def pair(self, effect, without, within, purposes, reason):
        """`without` does not call for the effect, `within` does. Returns the map's relative change when it is forced on."""
        skipped, report = self.bake(without, f'{effect}_skipped', '--effects', '-ao' if effect != 'ao' else 'auto')
        step = self.steps(report)[effect]
        self.expect(not step['run'] and reason in step['because'], f'{effect}: {step}')
        for p in purposes:
            self.expect(report['rays'][p] == 0, f'{effect} is skipped, and casts {report["rays"][p]} rays for {p}')
        _, needed = self.bake(within, f'{effect}_needed', '--effects', '-ao' if effect != 'ao' else 'auto')
        self.expect(self.steps(needed)[effect]['run'], f'{effect}: not simulated where it is called for: {self.steps(needed)[effect]}')
        for p in purposes:
            self.expect(needed['rays'][p] > 0, f'{effect} runs, and casts no ray for {p}')
        # Near hits are a few of a level's rays, and of two levels the other's patches or gather may take more: there the counter above says it.
        self.expect(effect == 'near' or needed['rays']['total'] > report['rays']['total'], f'{effect}: skipping it saves no rays')
        forced, on = self.bake(without, f'{effect}_forced', '--effects', f'+{effect},-ao' if effect != 'ao' else '+ao')
        a, b = self.texels(skipped), self.texels(forced)
        mean = sum(map(sum, b)) / (3 * len(b))
        change = math.sqrt(sum((p - q) ** 2 for t, u in zip(a, b) for p, q in zip(t, u)) / (3 * len(b))) / mean
        same = (skipped / 'lightmap.exr').read_bytes() == (forced / 'lightmap.exr').read_bytes()
        return change, same, step, report, on

    def exactly(self, effect, *args):
        change, same, step, _, on = self.pair(effect, *args)
        self.expect(same, f'{effect} gives nothing, and the map forced on has other bytes (by {change})')
        self.expect(self.steps(on)[effect]['run'] or 'no ' in step['because'] or 'black' in step['because'] or 'albedo' in step['because'], f'{effect} cannot be forced')

    def weakly(self, effect, *args):
        change, _, step, report, on = self.pair(effect, *args)
        self.expect(self.steps(on)[effect]['run'], f'{effect} cannot be forced')
        for p in args[2]:
            self.expect(on['rays'][p] > 0, f'{effect} is forced on, and casts no ray for {p}')
        self.expect(step['left_out'] and 0.0 < step['bound'] <= GOAL / 4, f'{effect}: {step}')
        self.expect(report['error']['left_out'] >= step['bound'], f'{effect}: its bound is not in the stated error')
        # Both maps have noise of their own: what they state of it, in squares.
        noise = math.hypot(report['error']['noise'], on['error']['noise'])
        self.expect(change <= step['bound'] + noise, f'{effect}: leaving it out changes the map by {change}, the bound says {step["bound"]} (noise {noise})')
        return change

    def pairs(self):
        for effect, exact, *args in pairs_of(self.make, self.write):
            (self.exactly if exact else self.weakly)(effect, *args)

    def manners(self):
        """Colour, holes of masked materials, highlights and screen-space occlusion: what is skipped is not done, and where it gives nothing the bytes are the same."""
        levels = dressed(self.make, self.write)
        grey = levels['grey']

        def baked(file, effects):
            out, report = self.bake(file, f'{file.stem}.{effects}', '--effects', effects)
            return out, report, self.steps(report)

        plain, _, steps = baked(grey, '-ao')
        self.expect(not steps['colour']['run'] and 'grey' in steps['colour']['because'], f'colour: {steps["colour"]}')
        self.expect(all(r == g == b for r, g, b in self.texels(plain)), 'a grey level has a colour')
        coloured, _, steps = baked(levels['red'], '-ao')
        self.expect(steps['colour']['run'], f'colour is skipped: {steps["colour"]}')
        without, _, steps = baked(levels['red'], '-ao,-colour')
        self.expect(not steps['colour']['run'], 'colour cannot be left out')
        a, b = self.texels(coloured), self.texels(without)
        self.expect(any(r > 1.1 * v for r, _, v in a), 'red walls leave no trace')
        self.expect(all(r == g == v for r, g, v in b), 'without colour there is one')
        y = [0.2126 * r + 0.7152 * g + 0.0722 * v for r, g, v in a]
        # Of each bounce the luminance of red walls under red light is more than the product of both: 0.31 of 0.6, 0.3, 0.2 by luminance, and bounces are a part.
        change = math.sqrt(sum((p - q[0]) ** 2 for p, q in zip(y, b)) / len(y)) / (sum(y) / len(y))
        self.expect(0.0 < change < 0.1, f'luminance without colour is off by {change}')

        skipped, report, steps = baked(levels['whole'], '-ao')
        self.expect(not steps['alpha']['run'] and 'hole' in steps['alpha']['because'] and report['alpha_tests'] == 0, f'alpha: {steps["alpha"]}, {report["alpha_tests"]} tests')
        forced, report, steps = baked(levels['whole'], '-ao,+alpha')
        self.expect(steps['alpha']['run'] and report['alpha_tests'] > 0, 'alpha cannot be forced')
        self.expect((skipped / 'lightmap.exr').read_bytes() == (forced / 'lightmap.exr').read_bytes(), 'whole surfaces with alpha looked at have other bytes')
        open_, report, steps = baked(levels['holed'], '-ao')
        self.expect(steps['alpha']['run'] and report['alpha_tests'] > 0, f'alpha is skipped: {steps["alpha"]}')
        closed, report, _ = baked(levels['holed'], '-ao,-alpha')
        self.expect(report['alpha_tests'] == 0, 'alpha is left out, and looked at')
        self.expect(sum(map(sum, self.texels(open_))) > 1.005 * sum(map(sum, self.texels(closed))), 'a column that is all hole hides as much as a whole one')

        for file, runs, because in ((grey, False, 'no material shines'), (levels['shiny'], True, 'shine'), (levels['lampless'], False, 'no light')):
            step = {s['effect']: s for s in json.loads(self.run('plan', file, '--json').stdout)['plan']}
            self.expect(step['specular']['run'] == runs and because in step['specular']['because'], f'{file.stem}: {step["specular"]}')
            self.expect(not step['screen-ao']['run'] and 'ambient' in step['screen-ao']['because'], f'{file.stem}: {step["screen-ao"]}')
        # A baked level whose surfaces do not shine: screen-space occlusion has nothing to darken, and is left out with a note.
        pictures = [self.out / f'shade.{how}.png' for how in ('baked', 'both')]
        for picture, how in zip(pictures, ('baked', 'both')):
            r = self.run('shade', plain, '-o', picture, '--ao', how, '--width', 64, '--height', 48)
            self.expect(('LMC_NO_AMBIENT' in r.stderr) == (how == 'both'), f'shade --ao {how}: {r.stderr}')
        self.expect(pictures[0].read_bytes() == pictures[1].read_bytes(), 'screen-space occlusion without ambient light changes the picture')

    def planes(self):
        """One plane: neither shadows nor bounces, and the same bytes with both forced on."""
        file = self.write(plane(self.make))
        out, report = self.bake(file, 'plane_auto')
        for effect in ('shadow', 'bounce', 'ao'):
            self.expect(not self.steps(report)[effect]['run'], f'one plane runs {effect}')
        forced, on = self.bake(file, 'plane_forced', '--effects', '+shadow,+bounce')
        self.expect(on['rays']['shadow'] > 0 and on['rays']['gather'] > 0, 'shadow and bounce cannot be forced')
        self.expect((out / 'lightmap.exr').read_bytes() == (forced / 'lightmap.exr').read_bytes(), 'a plane with shadows and bounces has other bytes')

    def words(self):
        """lmc plan writes nothing, agrees with the bake, and is the same for any number of threads."""
        file = self.write(room(self.make, 'words', column=True))
        before = sorted(p.name for p in file.parent.iterdir())
        text = self.run('plan', file).stdout
        for word in ('effect', 'because', 'in all:', 'pilot:', 'lamp', 'triangles cast shadows'):
            self.expect(word in text, f'lmc plan says nothing of {word}: {text}')
        plans = [json.loads(self.run('plan', file, '--json', '--preset', 'draft', '-j', j).stdout) for j in (1, 2)]

        def counts(plan):
            return [{k: v for k, v in s.items() if k != 'forecast'} for s in plan['plan']], plan['facts'], plan['forecast']['rays'], plan['forecast']['pilot']['rays']
        self.expect(counts(plans[0]) == counts(plans[1]), 'the plan hangs on the number of threads')
        self.expect(sorted(p.name for p in file.parent.iterdir()) == before, 'lmc plan writes files')
        _, report = self.bake(file, 'words_baked')
        self.expect([(s['effect'], s['run'], s['because']) for s in report['plan']] == [(s['effect'], s['run'], s['because']) for s in plans[0]['plan']],
                    'the bake follows another plan')
        for s in report['plan']:
            if 'forecast' in s:
                self.expect(s['actual']['rays'] >= 0 and s['forecast']['least_cpu_seconds'] <= s['forecast']['cpu_seconds'] <= s['forecast']['most_cpu_seconds'],
                            f'forecast of {s["effect"]}: {s}')
        told, came = report['forecast']['rays'], report['forecast']['actual']['rays']
        self.expect(0.4 * came < told < 2.5 * came, f'{told} rays foretold, {came} came')

    def explained(self):
        """One texel told apart: its parts are what the map has there, and what stands in the way has a name."""
        file = self.write(room(self.make, 'told', column=True, panel=400.0))
        out, _ = self.bake(file, 'told_plain')
        alpha = self.channel(out / 'lightmap.exr', 'A')
        covered = [i for i, a in enumerate(alpha) if a == 1.0]
        shadowed = 0
        for i in covered[::len(covered) // 12]:
            told, report = self.bake(file, 'told', '--explain', f'{i % 64},{i // 64}')
            self.expect((told / 'lightmap.exr').read_bytes() == (out / 'lightmap.exr').read_bytes(), '--explain changes the map')
            e = report['explain']
            for name, parts in (('direct', e['lamps'] + e['emitters']), ('indirect', e['surfaces'])):
                for c in range(3):
                    found, has = sum(p['illuminance'][c] for p in parts), e[name][c]
                    # 64 places and 4096 rays of its own; the draft's texel has its stated error and may be interpolated.
                    self.expect(abs(found - has) <= 4.0 * e['standard_error'][c] + 0.1 * has, f'texel {i}: {name} {has}, its parts {found}')
            for lamp in e['lamps']:
                self.expect(all(g <= u * (1.0 + 1e-9) for g, u in zip(lamp['illuminance'], lamp['unblocked'])), f'more than unblocked: {lamp}')
                shadowed += any(b['object'].startswith(('/column', '/panel')) for b in lamp['blocked_by'])
        self.expect(shadowed > 0, 'nothing stands in the way of the lamp anywhere')
        self.run('bake', file, '-o', self.out / 'none', '--explain', '64,0', '--preset', 'draft', exit=1)
        free = next(i for i, a in enumerate(alpha) if a != 1.0)
        self.run('bake', file, '-o', self.out / 'none', '--explain', f'{free % 64},{free // 64}', '--preset', 'draft', exit=1)
        self.run('bake', file, '-o', self.out / 'none', '--explain', '1', exit=1)
        self.expect(not (self.out / 'none' / 'lightmap.exr').exists(), 'a refused --explain writes a map')

    def asked(self):
        """What is done for a material, for a smooth edge, or because it is asked for: without that it is not done, and the light is the same."""
        levels = dressed(self.make, self.write)
        lit = levels['grey']
        plain, report = self.bake(lit, 'plain')
        bent, with_bent = self.bake(lit, 'bent', '--bent', 'world')
        self.expect(not self.steps(report)['bent']['run'] and 'not asked' in self.steps(report)['bent']['because'], f'bent: {self.steps(report)["bent"]}')
        self.expect(self.steps(with_bent)['bent']['run'], f'bent: {self.steps(with_bent)["bent"]}')
        self.expect(b'bent.R' not in (plain / 'ao.exr').read_bytes() and b'bent.R' in (bent / 'ao.exr').read_bytes(), 'bent normals are not what is asked for')
        self.expect(self.channel(plain / 'ao.exr', 'Y') == self.channel(bent / 'ao.exr', 'Y'), 'bent normals change the openness')

        brushed, with_tangents = self.bake(levels['brushed'], 'brushed_baked')
        self.expect(not self.steps(report)['tangents']['run'] and 'normal map' in self.steps(report)['tangents']['because'], f'tangents: {self.steps(report)["tangents"]}')
        self.expect(self.steps(with_tangents)['tangents']['run'], f'tangents: {self.steps(with_tangents)["tangents"]}')
        self.expect(b'"TANGENT"' not in (plain / 'level.glb').read_bytes() and b'"TANGENT"' in (brushed / 'level.glb').read_bytes(), 'tangents are not where they are called for')
        self.expect((plain / 'lightmap.exr').read_bytes() == (brushed / 'lightmap.exr').read_bytes(), 'tangents change the light')

        self.expect(not self.steps(report)['seams']['run'] and 'no smooth seam' in self.steps(report)['seams']['because'] and report['seams']['pairs'] == 0, f'seams: {report["seams"]}')
        curved = self.samples / 'curved.glb'
        closed, with_seams = self.bake(curved, 'closed', '--effects=-ao')
        open_, without = self.bake(curved, 'open', '--effects=-ao,-seams')
        self.expect(self.steps(with_seams)['seams']['run'] and with_seams['seams']['pairs'] > 0, f'seams: {with_seams["seams"]}')
        self.expect(not self.steps(without)['seams']['run'] and without['seams']['pairs'] == 0 and without['error']['seams'] == 0.0, f'seams left out: {without["seams"]}')
        moved = [(p, q) for t, u in zip(self.texels(closed), self.texels(open_)) for p, q in zip(t, u)]
        change = math.sqrt(sum((p - q) ** 2 for p, q in moved) / len(moved)) / (sum(p for p, _ in moved) / len(moved))
        self.expect(0.0 < change and abs(change - with_seams['error']['seams']) <= 0.01 * change + 1e-4, f'closing seams moves the map by {change}, stated {with_seams["error"]["seams"]}')

        crate = self.write(room(self.make, 'uncut', column=True, uncut=True))
        kept, without = self.bake(crate, 'rims_kept', '--effects=-ao,-bounce')
        filled, with_rims = self.bake(crate, 'rims_filled', '--effects=-ao,-bounce,+rims')
        self.expect(not self.steps(without)['rims']['run'] and 'not asked' in self.steps(without)['rims']['because'] and without['rims']['texels'] == 0, f'rims: {without["rims"]}')
        self.expect(self.steps(with_rims)['rims']['run'] and with_rims['rims']['texels'] > 0 and with_rims['rays']['exposure'] > 0, f'rims: {with_rims["rims"]}')
        moved = [(p, q) for t, u in zip(self.texels(filled), self.texels(kept)) for p, q in zip(t, u)]
        change = math.sqrt(sum((p - q) ** 2 for p, q in moved) / len(moved)) / (sum(q for _, q in moved) / len(moved))
        self.expect(change > 0.01 and abs(change - with_rims['error']['rims']) <= 0.01 * change, f'filling rims moves the map by {change}, stated {with_rims["error"]["rims"]}')
        self.expect(with_rims['error']['estimate'] == without['error']['estimate'], 'what is moved for lookups is in the stated error')

    def lightless(self):
        level = room(self.make, 'lightless', lamp=0.0)
        _, report = self.bake(self.write(level), 'lightless_baked')
        self.expect(not any(s['run'] for s in report['plan']) and report['rays']['total'] == 0, f'a level without light: {report["plan"]}')


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ('lmc', 'dump', 'source-dir'):
        parser.add_argument('--' + name, required=True)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        test = Test(a, folder)
        test.pairs()
        test.manners()
        test.planes()
        test.words()
        test.explained()
        test.asked()
        test.lightless()
    for line in test.bad:
        print('FAIL', line)
    print(f'{len(test.bad)} failed')
    return 1 if test.bad else 0


if __name__ == '__main__':
    sys.exit(main())
