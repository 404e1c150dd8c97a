#!/usr/bin/env python3
"""Every shader passes glslangValidator as GLSL 330 core and, with the prologue of docs/shaders.md, as GLSL ES 300; every file of common/
says what it needs and gives. Left out where glslangValidator is not installed."""
import pathlib, re, shutil, subprocess, sys, tempfile

root = pathlib.Path(sys.argv[1]) / 'shaders'
PROLOGUES = {
    '330 core': '#version 330 core\n',
    '300 es': '#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;\n',
}


def body(path):
    return re.sub(r'^#include "(.*)"$', lambda m: body(root / m.group(1)), path.read_text(), flags=re.M)


bad = []
for path in sorted(root.glob('common/*.glsl')):
    text = path.read_text()
    if not text.startswith('// Needs: ') or '// Gives: ' not in text:
        bad.append(f'{path.name}: its head does not say "Needs:" and "Gives:"')
shaders = sorted([*root.glob('deferred/*.vert'), *root.glob('deferred/*.frag')])
if len(shaders) < 12:
    bad.append(f'only {len(shaders)} shaders found in {root}')
if '#version' in ''.join(p.read_text() for p in root.glob('*/*')):
    bad.append('a shader has a #version of its own: the loader says it')
prologue = (root.parent / 'docs' / 'shaders.md').read_text()
if PROLOGUES['300 es'] not in prologue:
    bad.append('docs/shaders.md does not show the prologue of GLSL ES 300 that is tested here')
if shutil.which('glslangValidator') is None:
    print('\n'.join(bad) or 'left out: glslangValidator is not installed')
    sys.exit(1 if bad else 77)
with tempfile.TemporaryDirectory() as folder:
    for path in shaders:
        for profile, prologue in PROLOGUES.items():
            copy = pathlib.Path(folder, path.name)
            copy.write_text(prologue + body(path))
            done = subprocess.run(['glslangValidator', str(copy)], capture_output=True, text=True)
            if done.returncode != 0:
                bad.append(f'{path.name}, {profile}: {done.stdout}')
print('\n'.join(bad) or f'{len(shaders)} shaders pass in {len(PROLOGUES)} profiles')
sys.exit(1 if bad else 0)
