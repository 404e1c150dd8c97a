#!/usr/bin/env python3
"""Writes the figures of docs/accuracy.md: `lmc study` on every sample, and what precision costs. Python's standard library alone.

    accuracy_curves.py --lmc LMC --samples DIR --docs DIR --work DIR [--precision PRECISION_BENCH] [LEVEL...] [-- STUDY OPTIONS]

Studies are kept in --work, so that a run that was stopped goes on. What stands between the markers of docs/accuracy.md is replaced; a plot a level goes to
docs/images/accuracy_LEVEL.svg. Exit codes: 0 done, 1 command line, 2 missing or not writable, 6 a study failed.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys

LEVELS = ['cornell.glb', 'two_rooms.glb', 'court.glb', 'curved.glb', 'textured.gltf', 'furnace.glb']
BEGIN, END = '<!-- {} begin -->', '<!-- {} end -->'


class Failure(Exception):
    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def run(command):
    try:
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    except OSError as e:
        raise Failure(2, f'{command[0]}: {e.strerror}') from e
    if done.returncode != 0:
        raise Failure(6, f'{" ".join(map(str, command))} ended with exit code {done.returncode}: {done.stderr.strip()[-500:]}')
    return done.stdout


def percent(x):
    return f'{100 * x:.2f}'


def section(name, study, options):
    """Plot and table of a level."""
    rows = ['| asked | estimate, interval | true | CPU s | rays | memory |', '|---|---|---|---|---|---|']
    for r in study['rungs']:
        truth = percent(r['true']['net']) if 'true' in r else '-'
        rows.append(f'| {100 * r["promised"]:g} % | {percent(r["estimate"])}, {percent(r["interval"][0])} to {percent(r["interval"][1])} | {truth} | '
                    f'{r["cpu_seconds"]:.2f} | {r["rays"]:,} | {r["peak_memory_bytes"] / 1e6:.0f} MB |')
    fits = ', '.join(f'{"CPU seconds" if what == "cpu_seconds" else what} with error^{fit["exponent"]:.2f}' for what, fit in study.get('fit', {}).items())
    reference = study['reference']
    about = f'Reference: {reference["texels"]} texels, {reference["paths_a_texel"]:,.0f} paths each, noise {percent(reference["noise"])} %. {fits[:1].upper() + fits[1:]}.'
    return f'### {name}\n\n![{name}](images/accuracy_{name}.svg)\n\n' + '\n'.join(rows) + f'\n\n{about}\n'


def replaced(text, marker, body):
    begin, end = BEGIN.format(marker), END.format(marker)
    if begin not in text or end not in text:
        raise Failure(2, f'no markers of {marker}')
    return text[:text.index(begin) + len(begin)] + '\n\n' + body.strip() + '\n\n' + text[text.index(end):]


def machine():
    found = re.search(r'^model name\s*:\s*(.+)$', pathlib.Path('/proc/cpuinfo').read_text(), re.MULTILINE)
    return f'{found[1] if found else "unknown processor"}, {os.cpu_count()} cores'


class Parser(argparse.ArgumentParser):
    def error(self, message):
        self.print_usage(sys.stderr)
        self.exit(1, f'{self.prog}: error: {message}\n')


def main(arguments):
    options = []
    if '--' in arguments:
        at = arguments.index('--')
        arguments, options = arguments[:at], arguments[at + 1:]
    ap = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument('levels', nargs='*', metavar='LEVEL', default=LEVELS)
    ap.add_argument('--lmc', required=True, type=pathlib.Path)
    ap.add_argument('--samples', required=True, type=pathlib.Path)
    ap.add_argument('--docs', required=True, type=pathlib.Path)
    ap.add_argument('--work', required=True, type=pathlib.Path)
    ap.add_argument('--precision', type=pathlib.Path, help='the benchmark precision_bench')
    args = ap.parse_args(arguments)
    page = args.docs / 'accuracy.md'
    try:
        text = page.read_text()
        sections = []
        for level in args.levels:
            name = level.split('.')[0]
            out = args.work / name
            run([args.lmc, 'study', args.samples / level, '-o', out, '--make-reference', *options])
            sections.append(section(name, json.loads((out / 'study.json').read_text()), options))
            (args.docs / 'images' / f'accuracy_{name}.svg').write_text((out / 'study.svg').read_text())
            print(name, file=sys.stderr)
        said = f'lmc study LEVEL -o OUT --make-reference {" ".join(options)}'.strip()
        text = replaced(text, 'curves', f'Machine: {machine()}, shared with other work. Each: `{said}`.\n\n' + '\n'.join(sections))
        if args.precision:
            text = replaced(text, 'precision', run([args.precision]))
        page.write_text(text)
    except OSError as e:
        raise Failure(2, f'{e.filename}: {e.strerror}') from e


if __name__ == '__main__':
    try:
        main(sys.argv[1:])
    except Failure as e:
        print(f'accuracy_curves.py: error: {e}', file=sys.stderr)
        sys.exit(e.code)
