#!/usr/bin/env python3
"""Broken, hostile and odd levels: no crash, no hang, strict cases refused, good ones accepted (left out where ../shared is not there).

Rules: ../shared/corpus/README.md. Every glTF case through `lmc bake FILE -o OUT --map-size 64 --preset draft -j 1`, EXR through `lmc compare F F`."""
import argparse, concurrent.futures, json, os, pathlib, re, resource, signal, subprocess, sys, tempfile

SECONDS, SECONDS_LOAD = 5, 60
SANITIZER_FACTOR = 12
WAITING = 6   # a hang is told by the processor's time, so that a busy machine makes none; one that waits for nothing, by the clock


def judge(lmc, root, case, factor):
    file = root / case['file']
    limit = (SECONDS_LOAD if 'load' in case.get('tags', []) else SECONDS) * factor
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder, 'out')
        exr = file.suffix.lower() == '.exr'
        command = [lmc, 'compare', str(file), str(file)] if exr else [lmc, 'bake', str(file), '-o', str(out), '--map-size', '64', '--preset', 'draft', '-j', '1', '--progress', 'none']
        try:
            run = subprocess.run(command, capture_output=True, timeout=WAITING * limit,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1)))
        except subprocess.TimeoutExpired:
            return 'hang', f'no end after {WAITING * limit} s'
        if run.returncode == -signal.SIGXCPU:
            return 'hang', f'no end after {limit} CPU s'
        stderr = run.stderr.decode('utf-8', 'replace')
        if run.returncode < 0 or run.returncode >= 128 or run.returncode == 9 or 'Sanitizer' in stderr or 'runtime error' in stderr:
            return 'crash', f'exit {run.returncode}: {stderr[-400:]}'
        if run.returncode != 0:
            lines = [l for l in stderr.splitlines() if ' error: ' in l]
            if len(lines) != 1 or (not exr and str(file.name)[:8] not in lines[0] and '\\x' not in lines[0]):
                return 'bad refusal', stderr[-400:]
            if out.exists() and any(out.iterdir()):
                return 'bad refusal', 'refused, but left output behind'
            return 'refuse', lines[0]
        return ('warn' if re.search(r': warning: .*\[[A-Z0-9_]+\]$', stderr, re.M) else 'valid'), stderr[-400:]


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--shared', required=True)
    ap.add_argument('--sanitized', action='store_true', help='the program is slow')
    a = ap.parse_args()
    root = pathlib.Path(a.shared, 'corpus', 'bad_gltf')
    if not root.is_dir():
        print('left out: no corpus beside the project')
        return 77
    cases = [c for c in json.loads((root / 'index.json').read_text())['cases'] if pathlib.Path(c['file']).suffix.lower() in ('.gltf', '.glb', '.exr')]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(lambda c: judge(a.lmc, root, c, SANITIZER_FACTOR if a.sanitized else 1), cases))
    strict = strictOk = valid = validOk = right = 0
    bad = []
    for case, (got, why) in zip(cases, results):
        allowed = [case['expected'], *case.get('also_ok', [])]
        fits = got in allowed
        right += fits
        if allowed == ['refuse']:
            strict += 1
            strictOk += got == 'refuse'
        if case['expected'] == 'valid':
            valid += 1
            validOk += fits
        if got in ('crash', 'hang', 'bad refusal') or not fits:
            bad.append(f'{case["file"]}: {got}, wanted {"/".join(allowed)}: {why}')
    print('\n'.join(bad))
    print(f'{right} of {len(cases)} in class, strict refusals {strictOk} of {strict}, valid {validOk} of {valid}')
    grave = any(': crash,' in b or ': hang,' in b or ': bad refusal,' in b for b in bad)
    return 1 if grave or strictOk < strict or validOk < valid or right < 0.98 * len(cases) else 0


sys.exit(main())
