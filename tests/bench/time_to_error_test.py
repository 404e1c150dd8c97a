#!/usr/bin/env python3
"""bench/time_to_error.py: times between rungs, exponents, and refusals before any bake."""
import math, pathlib, subprocess, sys, tempfile, unittest

BENCH = pathlib.Path(__file__).resolve().parents[2] / 'bench'
sys.dont_write_bytecode = True
sys.path.insert(0, str(BENCH))
import time_to_error as tte

SQUARE_LAW = [(e, 3e-4 / e ** 2) for e in (0.08, 0.03, 0.012, 0.006)]


def exit_code(*arguments):
    return subprocess.run([sys.executable, BENCH / 'time_to_error.py', *map(str, arguments)], capture_output=True, text=True).returncode


class TimeToError(unittest.TestCase):
    def test_a_power_law_is_interpolated_exactly(self):
        for target in (0.04, 0.02, 0.01):
            seconds, how = tte.cost_at(target, SQUARE_LAW)
            self.assertTrue(math.isclose(seconds, 3e-4 / target ** 2, rel_tol=1e-9))   # rounding of a few logarithms
            self.assertEqual(how, '')

    def test_nothing_is_extrapolated(self):
        self.assertEqual(tte.cost_at(0.005, SQUARE_LAW), (None, 'not reached'))
        self.assertEqual(tte.cost_at(0.1, SQUARE_LAW), (SQUARE_LAW[0][1], 'at most'))

    def test_the_cheapest_rung_bounds_what_all_rungs_beat(self):
        self.assertEqual(tte.cost_at(0.04, [(0.02, 7.0), (0.019, 3.0), (0.01, 9.0)]), (3.0, 'at most'))

    def test_the_exponent_of_a_power_law_is_its_own(self):
        self.assertTrue(math.isclose(tte.exponent(SQUARE_LAW), -2.0, rel_tol=1e-9))

    def test_errors_that_hardly_differ_have_no_exponent(self):
        self.assertIsNone(tte.exponent([(0.005, 0.07), (0.003, 0.06)]))
        self.assertIsNone(tte.exponent([(0.0, 0.01), (0.0, 0.01)]))

    def test_the_cheapest_repetition_counts(self):
        def row(program, max_error, cpu_seconds):
            return {'scene': 'hall', 'program': program, 'max_error': max_error, 'cpu_seconds': cpu_seconds}

        kept = tte.cheapest([row('lmc', 0.08, 3.0), row('baseline', 0.08, 1.0), row('lmc', 0.08, 2.0), row('lmc', 0.04, 5.0)])
        self.assertEqual(kept, [row('lmc', 0.08, 2.0), row('baseline', 0.08, 1.0), row('lmc', 0.04, 5.0)])

    def test_a_broken_command_line_ends_with_1(self):
        for broken in ('2,4', '0', 'two', '200'):
            self.assertEqual(exit_code('--lmc', 'lmc', '--shared', '.', '--max-error', broken), 1, broken)
        self.assertEqual(exit_code('--shared', '.'), 1)
        self.assertEqual(exit_code('--lmc', 'lmc', '--shared', '.', '--repeat', '0'), 1)

    def test_a_missing_file_ends_with_2(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(exit_code('--lmc', 'lmc', '--shared', folder), 2)
            self.assertEqual(exit_code('--lmc', 'lmc', '--shared', folder, 'hall'), 2)


if __name__ == '__main__':
    unittest.main()
