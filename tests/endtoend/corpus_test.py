#!/usr/bin/env python3
"""Broken, hostile and odd levels: no crash, no hang, strict cases refused, good ones accepted (left out where ../shared is not there).

    corpus_test.py --lmc BUILD/bin/lmc --dump BUILD/tests/bin/exr_dump --shared SHARED [--shim LIBRARY] [--sanitized] [--threads N] [--only TEXT]

Rules: SHARED/corpus/README.md. Levels go through `lmc bake FILE -o OUT --map-size 64 --preset draft -j N`, EXR files through `lmc compare F F`,
other pictures through a good level whose base-colour texture they become. Of cases about paths no run may open what lies outside of the
level's folder and OUT; for that --shim (support/fault_shim.c) lists what is opened."""
import argparse, array, concurrent.futures, json, os, pathlib, re, resource, signal, subprocess, sys, tempfile, threading, time

SECONDS, SECONDS_LOAD = 5, 60
PEAK_BYTES = 1 << 30
SANITIZER_FACTOR = 12   # of time; memory is not judged there
WAITING = 6             # a hang is told by the processor's time, so that a busy machine makes none; one that waits for nothing, by the clock
CHANNELS = {'lightmap': ['R', 'G', 'B', 'direct.R', 'direct.G', 'direct.B', 'indirect.R', 'indirect.G', 'indirect.B', 'stderr.R', 'stderr.G', 'stderr.B'],
            'ao': ['Y', 'uniform.Y', 'stderr.Y']}
ABOUT_THE_SYSTEM = [pathlib.Path('/proc'), pathlib.Path('/sys')]   # memory in use, processors
WARNED = re.compile(r': warning: .*\[[A-Z0-9_]+\]$', re.M)


class Finished:
    """One run of a program: exit code, stderr, CPU seconds, peak memory."""

    def __init__(self, command, folder, cpu_seconds, env=None):
        with tempfile.TemporaryFile() as stderr:
            self.waited_too_long = False
            started = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr, env=env,
                                       preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (cpu_seconds, cpu_seconds + 1)))
            timer = threading.Timer(WAITING * cpu_seconds, self.give_up, [started])
            timer.start()
            _, status, usage = os.wait4(started.pid, 0)
            started.returncode = self.code = os.waitstatus_to_exitcode(status)
            timer.cancel()
            stderr.seek(0)
            self.stderr = stderr.read().decode('utf-8', 'replace')
        self.cpu = usage.ru_utime + usage.ru_stime
        self.peak = usage.ru_maxrss * 1024

    def give_up(self, process):
        self.waited_too_long = True
        process.kill()


def level_with_picture(root, picture, folder):
    """The control level beside its own base-colour texture: the picture."""
    doc = json.loads((root / 'generated/control/room_texture.gltf').read_text())
    doc['images'] = [{'uri': 'picture' + picture.suffix}]
    doc['textures'] = [{'source': 0}]
    for material in doc['materials']:
        material['pbrMetallicRoughness'] = {'baseColorTexture': {'index': 0}, 'metallicFactor': 0}
    (folder / ('picture' + picture.suffix)).write_bytes(picture.read_bytes())
    level = folder / 'level.gltf'
    level.write_text(json.dumps(doc))
    return level


def not_finite(dump, out):
    """The first map that holds a value which is no number, or nothing."""
    for file in sorted(out.glob('*.exr')):
        data = subprocess.run([dump, str(file), *CHANNELS[file.name.split('.')[0]]], capture_output=True, check=True).stdout
        values = array.array('f', data[data.index(b'\n') + 1:])
        # x - x is 0 for every number and NaN for infinities and NaN.
        if any(x - x != 0.0 for x in values):
            return file.name
    return None


def opened_outside(list_of_opened, *folders):
    """The first file of the list that is neither in one of the folders nor one of the system's that says how it is doing."""
    for line in list_of_opened.read_text(errors='surrogateescape').splitlines():
        if not any(pathlib.Path(line).is_relative_to(f.resolve()) for f in (*folders, *ABOUT_THE_SYSTEM)):
            return line
    return None


class Judge:
    def __init__(self, options, root):
        self.options, self.root = options, root
        self.factor = SANITIZER_FACTOR if options.sanitized else 1

    def command(self, case, folder):
        """Command line, the name that a refusal must hold, and the output folder (None for pictures)."""
        file, kind = self.root / case['file'], case['kind']
        if kind == 'image/exr':
            return [self.options.lmc, 'compare', str(file), str(file)], file.name, None
        level = level_with_picture(self.root, file, folder) if kind.startswith('image/') else file
        out = folder / 'out'
        return ([self.options.lmc, 'bake', str(level), '-o', str(out), '--map-size', '64', '--preset', 'draft', '-j', str(self.options.threads),
                 '--progress', 'none'], level.name, out)

    def __call__(self, case):
        started = time.monotonic()
        with tempfile.TemporaryDirectory(prefix='lmc-corpus-') as folder:
            got, why, run = self.judge(case, pathlib.Path(folder))
        return got, why, run, time.monotonic() - started

    def judge(self, case, folder):
        command, name, out = self.command(case, folder)
        limit = (SECONDS_LOAD if 'load' in case.get('tags', []) else SECONDS) * self.factor
        there = {f.name for f in folder.iterdir()}
        opened = folder / 'opened' if self.options.shim and 'path' in case.get('tags', []) else None
        env = dict(os.environ, LD_PRELOAD=self.options.shim, LMC_OPENED=str(opened)) if opened else None
        run = Finished(command, folder, limit, env)
        if opened:
            if not opened.exists():
                return 'shim', 'nothing was listed', run
            if outside := opened_outside(opened, self.root / pathlib.Path(case['file']).parent, folder):
                return 'opened', f'{outside}, outside of its folder', run
            opened.unlink()
        tail = run.stderr[-400:]
        if run.waited_too_long or run.code == -signal.SIGXCPU:
            return 'hang', f'no end after {run.cpu:.1f} CPU s', run
        if run.code < 0 or run.code >= 128 or run.code == 9 or 'Sanitizer' in run.stderr or 'runtime error' in run.stderr:
            return 'crash', f'exit {run.code}: {tail}', run
        if not self.options.sanitized and run.peak > PEAK_BYTES:
            return 'memory', f'{run.peak >> 20} MiB', run
        if stray := {f.name for f in folder.iterdir()} - there - {'out'}:
            return 'stray file', str(stray), run
        if run.code != 0:
            errors = [line for line in run.stderr.splitlines() if ' error: ' in line]
            # Control characters of names are escaped, so that such a name is not there as it is.
            if len(errors) != 1 or (name[:8] not in errors[0] and '\\x' not in errors[0]):
                return 'bad refusal', tail, run
            if not re.search(r'\[[A-Z0-9_]+\]$', errors[0]) and run.code != 2:
                return 'bad refusal', 'no code: ' + tail, run
            if out and out.exists() and any(out.iterdir()):
                return 'bad refusal', 'refused, but left output behind', run
            return 'refuse', errors[0], run
        if out and (file := not_finite(self.options.dump, out)):
            return 'not finite', file, run
        return ('warn' if WARNED.search(run.stderr) else 'valid'), tail, run


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument('--lmc', required=True)
    ap.add_argument('--dump', required=True)
    ap.add_argument('--shared', required=True)
    ap.add_argument('--shim', help='lists what is opened (left out by sanitized runs)')
    ap.add_argument('--sanitized', action='store_true', help='the program is slow, and its memory is not its own')
    ap.add_argument('--threads', type=int, default=1, help='of each bake')
    ap.add_argument('--only', default='', help='cases whose file holds this')
    ap.add_argument('--classes', help='write file and class of each case, for comparing runs')
    a = ap.parse_args()
    a.lmc, a.dump, a.shim = os.path.abspath(a.lmc), os.path.abspath(a.dump), a.shim and os.path.abspath(a.shim)
    root = pathlib.Path(a.shared, 'corpus', 'bad_gltf').resolve()
    if not root.is_dir():
        print('left out: no corpus beside the project')
        return 77
    cases = [c for c in json.loads((root / 'index.json').read_text())['cases'] if a.only in c['file']]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(Judge(a, root), cases))
    strict = strict_right = valid = valid_right = right = 0
    bad = []
    grave = False
    for case, (got, why, _, _) in zip(cases, results):
        allowed = [case['expected'], *case.get('also_ok', [])]
        fits = got in allowed
        right += fits
        if allowed == ['refuse']:
            strict += 1
            strict_right += got == 'refuse'
        if case['expected'] == 'valid':
            valid += 1
            valid_right += got == 'valid' or fits
        grave = grave or got not in ('refuse', 'warn', 'valid')
        if not fits:
            bad.append(f'{case["file"]}: {got}, wanted {"/".join(allowed)}: {why}')
    print('\n'.join(bad))
    if a.classes:
        pathlib.Path(a.classes).write_text(''.join(f'{c["file"]} {got}\n' for c, (got, *_) in zip(cases, results)))
    longest = max(range(len(cases)), key=lambda i: results[i][2].cpu)
    largest = max(range(len(cases)), key=lambda i: results[i][2].peak)
    print(f'{right} of {len(cases)} in class, strict refusals {strict_right} of {strict}, valid {valid_right} of {valid}; '
          f'longest {results[longest][2].cpu:.2f} CPU s ({cases[longest]["file"]}), largest {results[largest][2].peak >> 20} MiB ({cases[largest]["file"]})')
    return 1 if grave or strict_right < strict or valid_right < valid or right < 0.98 * len(cases) else 0


sys.exit(main())
