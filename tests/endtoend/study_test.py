#!/usr/bin/env python3
"""`lmc study`, `lmc fit-attenuation` and the audit of `lmc bake`, as a user meets them. Counts and errors are judged, never times."""
import argparse, csv, html.parser, json, math, pathlib, re, signal, subprocess, sys, tempfile, time, unittest
import xml.etree.ElementTree as xml

LMC = SOURCE = None
SMALL = ['--map-size', '64', '--no-audit']


def lmc(*args, check=0):
    run = subprocess.run([LMC, *map(str, args)], capture_output=True, text=True)
    if check is not None and run.returncode != check:
        raise AssertionError(f'lmc {" ".join(map(str, args))}: exit code {run.returncode}, not {check}\n{run.stderr}')
    return run


def sample(name):
    return SOURCE / 'samples' / name


def slope(points):
    """Of log y over log x, by least squares."""
    logs = [(math.log(x), math.log(y)) for x, y in points]
    mx, my = (sum(c) / len(logs) for c in zip(*logs))
    return sum((x - mx) * (y - my) for x, y in logs) / sum((x - mx) ** 2 for x, _ in logs)


class Page(html.parser.HTMLParser):
    """Balance of tags, and what the page would have to fetch."""
    VOID = {'meta', 'link', 'img', 'br'}

    def __init__(self):
        super().__init__()
        self.open, self.fetched, self.pictures = [], [], 0

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ('src', 'href') and not value.startswith('data:'):
                self.fetched.append(value)
        self.pictures += tag == 'img'

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, tag


class Study(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.out = pathlib.Path(cls.folder.name, 'study')
        cls.args = ['study', sample('cornell.glb'), '-o', cls.out, *SMALL, '--ladder', '8,4,2', '--make-reference', '--reference-error', '2%',
                    '--reference-texels', '200']
        cls.run_ = lmc(*cls.args, '--json')
        cls.study = json.loads(cls.run_.stdout)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_every_rung_casts_more_rays_and_states_less_error(self):
        rungs = self.study['rungs']
        self.assertEqual([r['promised'] for r in rungs], [0.08, 0.04, 0.02])
        for coarse, fine in zip(rungs, rungs[1:]):
            self.assertGreater(fine['rays'], coarse['rays'])
            self.assertLess(fine['bound95'], coarse['bound95'])
            self.assertLess(fine['estimate'], coarse['estimate'])

    def test_a_rung_is_a_bake_with_that_goal(self):
        with tempfile.TemporaryDirectory() as out:
            lmc('bake', sample('cornell.glb'), '-o', out, *SMALL, '--max-error', '4%', '--progress', 'none')
            alone = json.loads(pathlib.Path(out, 'report.json').read_text())
            self.assertEqual(self.study['rungs'][1]['rays'], alone['rays']['total'])
            self.assertEqual((self.out / 'rungs/4/lightmap.exr').read_bytes(), pathlib.Path(out, 'lightmap.exr').read_bytes())

    def test_files_agree_with_each_other(self):
        self.assertEqual(json.loads((self.out / 'study.json').read_text()), self.study)
        with (self.out / 'study.csv').open() as file:
            rows = list(csv.DictReader(file))
        for row, rung in zip(rows, self.study['rungs'], strict=True):
            self.assertEqual(int(row['rays']), rung['rays'])
            self.assertEqual(float(row['estimate']), rung['estimate'])
            self.assertEqual(float(row['true_error']), rung['true']['net'])
        cost = [(r['true']['net'], r['rays']) for r in self.study['rungs']]
        self.assertAlmostEqual(self.study['fit']['rays']['exponent'], slope(cost), places=6)

    def test_true_error_keeps_the_promise(self):
        for rung in self.study['rungs']:
            # What 200 texels of the reference leave open is taken off.
            self.assertLess(rung['true']['interval'][0], rung['promised'])
            self.assertLessEqual(rung['true']['reference_noise'], 0.02)

    def test_page_and_plot_stand_by_themselves(self):
        page = Page()
        page.feed((self.out / 'study.html').read_text())
        self.assertEqual(page.open, [])
        self.assertEqual(page.fetched, [])
        self.assertGreaterEqual(page.pictures, 3 * 3)
        svg = xml.parse(self.out / 'study.svg').getroot()
        text = ' '.join(t.text or '' for t in svg.iter('{http://www.w3.org/2000/svg}text'))
        for word in ('exponent', 'draft', 'level', '8 %', '2 %'):
            self.assertIn(word, text)
        # Every place of the plot lies on it.
        for circle in svg.iter('{http://www.w3.org/2000/svg}circle'):
            self.assertTrue(0 < float(circle.get('cx')) < float(svg.get('width')) and 0 < float(circle.get('cy')) < float(svg.get('height')))
        for name in ('study.html', 'study.json', 'study.csv', 'reference.json'):
            self.assertNotIn(str(self.out.parent), (self.out / name).read_text())

    def test_finished_rungs_are_kept_and_missing_ones_made(self):
        again = lmc(*self.args)
        self.assertEqual(again.stderr.count('kept'), 4)  # the reference and three rungs
        before = (self.out / 'rungs/2/rung.json').read_text()
        (self.out / 'rungs/4/lightmap.exr').write_bytes(b'cut short')
        mended = lmc(*self.args)
        self.assertEqual(mended.stderr.count('kept'), 3)
        self.assertEqual((self.out / 'rungs/2/rung.json').read_text(), before)
        rungs = json.loads((self.out / 'study.json').read_text())['rungs']
        for r, first in zip(rungs, self.study['rungs'], strict=True):
            self.assertEqual((r['rays'], r['estimate'], r['true']), (first['rays'], first['estimate'], first['true']))

    def test_a_given_reference_is_used(self):
        with tempfile.TemporaryDirectory() as folder:
            # The finest rung as the truth of itself: no difference, and none of the noise of texels is taken out of 0.
            run = lmc('study', sample('cornell.glb'), '-o', folder, *SMALL, '--ladder', '8,2', '--reference', self.out / 'rungs/2/lightmap.exr',
                      '--json')
            rungs = json.loads(run.stdout)['rungs']
            self.assertEqual(rungs[1]['true']['rms'], 0.0)
            self.assertGreater(rungs[0]['true']['rms'], 0.0)
            self.assertEqual(rungs[1]['true']['texels'], json.loads((self.out / 'rungs/2/report.json').read_text())['texels']['covered'])


class StopAndGoOn(unittest.TestCase):
    def test_a_study_that_was_stopped_goes_on(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder, 'study')
            args = ['study', sample('two_rooms.glb'), '-o', out, *SMALL, '--ladder', '8,0.3']
            process = subprocess.Popen([LMC, *map(str, args)], stderr=subprocess.PIPE, text=True)
            first = out / 'rungs/8/rung.json'
            for _ in range(6000):
                if first.exists() or process.poll() is not None:
                    break
                time.sleep(0.05)
            process.send_signal(signal.SIGTERM)
            said = process.communicate()[1]
            self.assertEqual(process.returncode, 143, said)
            self.assertTrue(first.exists())
            self.assertFalse((out / 'rungs/0.3/rung.json').exists())
            args[-1] = '8,4'
            self.assertEqual(lmc(*args).stderr.count('kept'), 1)
            self.assertEqual(len(json.loads((out / 'study.json').read_text())['rungs']), 2)


class Knobs(unittest.TestCase):
    def ladder(self, knob, rungs, *more):
        with tempfile.TemporaryDirectory() as out:
            run = lmc('study', sample('cornell.glb'), '-o', out, *SMALL, '--vary', knob, '--ladder', rungs, '--json', *more)
            self.assertTrue(pathlib.Path(out, 'study.html').exists())
            return json.loads(run.stdout)['rungs']

    def test_more_rays_less_noise(self):
        rungs = self.ladder('rays', '8,32,128')
        for a, b in zip(rungs, rungs[1:]):
            self.assertGreater(b['rays'], a['rays'])
            self.assertLess(b['noise'], a['noise'])

    def test_smaller_patches_less_error_of_patches(self):
        rungs = self.ladder('patches', '2,1,0.5')
        self.assertLess(rungs[-1]['patches'], rungs[0]['patches'])

    def test_more_passes_less_light_left_out(self):
        rungs = self.ladder('passes', '1,2,4')
        tails = [r['bounce_tail'] for r in rungs]
        self.assertEqual(tails, sorted(tails, reverse=True))
        self.assertLess(tails[-1], tails[0])

    def test_openness_comes_nearer_to_its_reference(self):
        rungs = self.ladder('ao', '8,1', '--make-reference', '--reference-error', '1%', '--reference-texels', '100')
        self.assertGreater(rungs[1]['rays'], rungs[0]['rays'])
        self.assertLess(rungs[1]['true']['rms'], rungs[0]['true']['rms'])


class Complaints(unittest.TestCase):
    def test_wrong_use(self):
        for args in (['--ladder', '2,4'], ['--ladder', 'x'], ['--ladder', '4,4'], ['--vary', 'rays', '--ladder', '1.5'],
                     ['--reference', 'a.exr', '--make-reference']):
            with tempfile.TemporaryDirectory() as out:
                lmc('study', sample('cornell.glb'), '-o', out, *args, check=1)
                self.assertEqual(list(pathlib.Path(out).iterdir()), [])

    def test_broken_input_keeps_its_exit_code(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder, 'out')
            lmc('study', pathlib.Path(folder, 'none.glb'), '-o', out, check=2)
            broken = pathlib.Path(folder, 'broken.glb')
            broken.write_bytes(b'glTF')
            lmc('study', broken, '-o', out, check=3)


class FitAttenuation(unittest.TestCase):
    def test_a_table_made_from_known_constants_is_recovered(self):
        with tempfile.TemporaryDirectory() as folder:
            table = pathlib.Path(folder, 'lamp.csv')
            at = lambda d: (1 - (d / 6) ** 3) / (1 + 0.5 * d + 0.25 * d * d)
            table.write_text('# distance, value\n' + '\n'.join(f'{0.1 * i:.3f}, {at(0.1 * i):.9f}' for i in range(61)))
            a = json.loads(lmc('fit-attenuation', '--range', 6, '--falloff', table, '--json').stdout)
            # The table is rounded to nine digits; near the range, where values are below 1 % of the mean, that is 1e-7 of what counts.
            for name, value in (('constant', 1), ('linear', 0.5), ('quadratic', 0.25), ('power', 3), ('range', 6)):
                self.assertAlmostEqual(a['attenuation'][name], value, delta=1e-3)
            self.assertLess(a['error']['rms'], 1e-5)

    def test_kinds_and_complaints(self):
        for kind in ('inverse-square', 'inverse-square-window', 'inverse', 'smooth', 'smoothstep', 'linear', 'suggested'):
            fit = json.loads(lmc('fit-attenuation', '--range', 10, '--falloff', kind, '--json').stdout)
            self.assertTrue(0 <= fit['error']['rms'] <= fit['error']['largest'], kind)
            self.assertEqual(fit['attenuation']['range'], 10)
        self.assertLess(json.loads(lmc('fit-attenuation', '--range', 10, '--falloff', 'suggested', '--json').stdout)['error']['rms'], 1e-6)
        lmc('fit-attenuation', '--range', 10, '--falloff', 'nothing-of-the-kind', check=1)
        lmc('fit-attenuation', '--range', -1, '--falloff', 'smooth', check=1)
        with tempfile.TemporaryDirectory() as folder:
            table = pathlib.Path(folder, 'bad.csv')
            table.write_text('1 2\n3\n')
            self.assertIn('line 2', lmc('fit-attenuation', '--range', 10, '--falloff', table, check=3).stderr)


class Audit(unittest.TestCase):
    def audited(self, *more):
        with tempfile.TemporaryDirectory() as out:
            lmc('bake', sample('cornell.glb'), '-o', out, '--map-size', '64', '--progress', 'none', '--effects', '-ao', *more, check=None)
            return json.loads(pathlib.Path(out, 'report.json').read_text()), pathlib.Path(out, 'lightmap.exr').read_bytes()

    def test_it_is_at_most_a_quarter_of_the_rays_and_changes_no_map(self):
        report, with_ = self.audited('--max-error', '1%')
        audit = report['error']['audit']
        self.assertLessEqual(audit['rays'], 0.25 * (report['rays']['total'] - audit['rays']))
        self.assertGreater(audit['rays'], 0.1 * (report['rays']['total'] - audit['rays']))
        self.assertEqual(audit['rays'], report['rays']['audit'])
        self.assertEqual(sum(c['texels'] for c in audit['classes'].values()), report['texels']['covered'])
        self.assertFalse(audit['contradicts'])
        without, map_ = self.audited('--max-error', '1%', '--no-audit')
        self.assertNotIn('audit', without['error'])
        self.assertEqual(with_, map_)
        self.assertEqual(without['error']['bound95'], report['error']['bound95'])

    def test_it_is_on_by_itself_below_two_percent(self):
        self.assertIn('audit', self.audited('--max-error', '1.9%')[0]['error'])
        self.assertNotIn('audit', self.audited('--max-error', '2%')[0]['error'])
        self.assertIn('audit', self.audited('--max-error', '4%', '--audit')[0]['error'])

    def test_threads_change_nothing(self):
        one, many = (self.audited('--max-error', '1%', '-j', n)[0]['error'] for n in ('1', '3'))
        self.assertEqual(one, many)

    def test_worst_places_are_named(self):
        report = self.audited('--max-error', '4%')[0]
        worst = report['error']['worst']
        self.assertEqual([w['stated_lx'] for w in worst], sorted((w['stated_lx'] for w in worst), reverse=True))
        self.assertGreater(len(worst), 2)
        self.assertTrue(all(0 <= w['x'] < 64 and 0 <= w['y'] < 64 and w['object'].startswith('/') for w in worst))


class InTime(unittest.TestCase):
    LEAST = r'takes ([0-9.]+) s at least'

    def bake(self, folder, name, *args, check=0):
        out = pathlib.Path(folder, name)
        said = lmc('bake', sample('cornell.glb'), '-o', out, '--map-size', '64', '--progress', 'none', *args, check=check).stderr
        return json.loads((out / 'report.json').read_text()), {p.name: p.read_bytes() for p in out.iterdir() if p.name != 'report.json'}, said

    def test_a_bake_with_what_a_timed_one_states_gives_the_same_bytes(self):
        with tempfile.TemporaryDirectory() as folder:
            _, _, short = self.bake(folder, 'short', '--time', '0.001s', check=5)
            least = float(re.search(self.LEAST, short)[1])
            timed, files, _ = self.bake(folder, 'timed', '--time', f'{max(3.0, 4.0 * least)}s')  # however slow program and machine are
            again, same, _ = self.bake(folder, 'again', *timed['time']['same_bytes_by'].split(), '--no-audit', check=None)
            self.assertEqual(files, same)
            self.assertEqual(timed['rays'], again['rays'])
            self.assertEqual(timed['error'], again['error'])
            # At the finest goal nothing more is asked for; else rounds fill the time.
            self.assertTrue(timed['error']['gather_rounds'] > 0 or timed['error']['goal'] <= 0.005)

    def test_rounds_cast_more_and_state_less(self):
        with tempfile.TemporaryDirectory() as folder:
            reports = [self.bake(folder, str(n), '--max-error', '8%', '--gather-rounds', n, '--effects=-ao')[0] for n in (0, 10, 20)]
            for a, b in zip(reports, reports[1:]):
                self.assertGreater(b['rays']['gather'], a['rays']['gather'])
                self.assertLess(b['error']['noise'], a['error']['noise'])

    def test_too_short_a_time_names_the_least(self):
        with tempfile.TemporaryDirectory() as folder:
            _, files, said = self.bake(folder, 'short', '--time', '0.001s', check=5)
            self.assertIn('lightmap.exr', files)
            self.assertRegex(said, self.LEAST + '.*LMC_TIME')

    def test_wrong_use(self):
        for args in (['--time', 'soon'], ['--time', '0s'], ['--time', '9s', '--max-error', '2%'], ['--time', '9s', '--audit']):
            lmc('bake', sample('cornell.glb'), '-o', '/nowhere', *args, check=1)


def main():
    global LMC, SOURCE
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--source-dir', required=True, type=pathlib.Path)
    a, rest = ap.parse_known_args()
    LMC, SOURCE = a.lmc, a.source_dir
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)


if __name__ == '__main__':
    main()
