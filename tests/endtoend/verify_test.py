#!/usr/bin/env python3
"""lmc verify: the project's own cases pass, wrong ones do not, unknown ones are left out. With --shared: the cases beside the project."""
import argparse, copy, json, pathlib, struct, subprocess, sys, tempfile

MAY_BE_LEFT_OUT = ('attenuation/guard', 'ao/')


def tspace(x):
    """One triangle with U along X as a file of tangent vectors; x = what its tangents are said to be."""
    arrays = [(b'positions', 3, [0, 0, 0, 1, 0, 0, 0, 1, 0]), (b'normals', 3, [0, 0, 1] * 3), (b'texcoords', 2, [0, 0, 1, 0, 0, 1]),
              (b'indices', 1, [0, 1, 2]), (b'tangents', 4, [x, 0, 0, 1] * 3)]
    table, data, start = b'', b'', 16 + 32 * len(arrays)
    for name, components, values in arrays:
        whole = name == b'indices'
        table += struct.pack('<16sIIII', name, int(whole), components, len(values) // components, start + len(data))
        data += struct.pack(f'<{len(values)}{"I" if whole else "f"}', *values)
        data += bytes(-len(data) % 16)
    return b'TSPACE01' + struct.pack('<II', len(arrays), 0) + table + data


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--source-dir', required=True)
    ap.add_argument('--shared')
    a = ap.parse_args()
    bad = []

    def run(*args):
        return subprocess.run([a.lmc, 'verify', *map(str, args)], capture_output=True, text=True)

    def expect(what, holds, more=''):
        if not holds:
            bad.append(f'{what} {more}')

    def all_pass(files):
        r = run('--json', *files)
        cases = json.loads(r.stdout)['cases']
        for c in cases:
            left = c['result'] == 'left_out'
            valueless = left and c['why'] == 'the case states no value'
            expect(c['id'], c['result'] == 'pass' or valueless or (left and c['kind'].startswith(MAY_BE_LEFT_OUT)), json.dumps(c))
        expect('exit code', r.returncode == 0, f'{r.returncode} {r.stderr}')
        print(f'{len(files)} files, {len(cases)} cases, {sum(c["result"] == "left_out" for c in cases)} left out')

    if a.shared:
        folder = pathlib.Path(a.shared, 'references', 'analytic')
        if not folder.is_dir():
            print('left out: no analytic references beside the project')
            return 77
        all_pass(sorted(folder.glob('*.json')))
        vectors = sorted(pathlib.Path(a.shared, 'references', 'tangent').glob('*.tspace'))
        if vectors:
            all_pass(vectors)
        print('\n'.join(bad) or 'all as it should be')
        return 1 if bad else 0

    files = sorted(pathlib.Path(a.source_dir, 'samples', 'cases').glob('*.json'))
    all_pass(files)
    element = next(f for f in files if f.stem == 'element')
    document = json.loads(element.read_text())
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder, 'cases.json')

        def with_case(change):
            d = copy.deepcopy(document)
            d['cases'] = d['cases'][:1]
            change(d)
            file.write_text(json.dumps(d))
            return run('--json', file)

        def result(r): return json.loads(r.stdout)['cases'][0]['result']
        r = with_case(lambda d: d['cases'][0]['values'][0].update(value='0.3'))
        expect('a wrong value fails', r.returncode == 6 and result(r) == 'fail', r.stdout + r.stderr)
        r = with_case(lambda d: d['cases'][0].update(kind='form_factor/of_nothing'))
        expect('an unknown kind is left out', r.returncode == 0 and result(r) == 'left_out', r.stdout + r.stderr)
        r = with_case(lambda d: d['cases'][0]['values'][0].update(name='G'))
        expect('an unknown value is left out', r.returncode == 0 and result(r) == 'left_out', r.stdout + r.stderr)
        r = with_case(lambda d: d['cases'][0]['values'][0].update(tol={'solver_rel': 0.5}))
        expect('a value without a tolerance that fits is left out', result(r) == 'left_out', r.stdout + r.stderr)
        r = with_case(lambda d: d['cases'][0]['geometry']['polygon'][2].__setitem__(1, 'far'))
        expect('a broken number is named', r.returncode == 3 and '/cases/0/geometry/polygon/2/1' in r.stderr, r.stderr)
        r = with_case(lambda d: d['cases'][0].pop('geometry'))
        expect('a missing part is named', r.returncode == 3 and 'geometry' in r.stderr, r.stderr)
        r = with_case(lambda d: d.update(schema='other/9'))
        expect('another schema', r.returncode == 3 and '/schema' in r.stderr, r.stderr)
        file.write_text('{')
        expect('no JSON', run(file).returncode == 3)
        vectors = pathlib.Path(folder, 'square.tspace')
        vectors.write_bytes(tspace(1.0))
        r = run(vectors)
        expect('tangent vectors', r.returncode == 0 and '2 passed, 0 failed' in r.stdout, r.stdout + r.stderr)
        vectors.write_bytes(tspace(-1.0))
        r = run('--json', vectors)
        wrong = json.loads(r.stdout)['cases'][0]
        expect('a wrong tangent is named', r.returncode == 6 and wrong['corners'][0]['corner'] == 0, r.stdout + r.stderr)
        vectors.write_bytes(tspace(1.0)[:-8])
        r = run(vectors)
        expect('cut tangent vectors', r.returncode == 3 and 'beyond the end' in r.stderr, r.stderr)
        expect('no file', run(pathlib.Path(folder, 'nowhere.json')).returncode == 2)
        expect('no file named', run().returncode == 1)
    r = run('--only', 'own.element.1', element)
    expect('--only takes one case', r.returncode == 0 and '1 passed, 0 failed, 0 left out' in r.stdout, r.stdout)
    print('\n'.join(bad) or 'all as it should be')
    return 1 if bad else 0


sys.exit(main())
