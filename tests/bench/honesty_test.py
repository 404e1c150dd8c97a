#!/usr/bin/env python3
"""The judge of bench/honesty.py on rows made by hand."""
import importlib.util
import pathlib
import unittest

spec = importlib.util.spec_from_file_location('honesty', pathlib.Path(__file__).parents[2] / 'bench' / 'honesty.py')
honesty = importlib.util.module_from_spec(spec)
spec.loader.exec_module(honesty)


def row(promised, true, level='a', seed=1, rays=1000, least=100, low=None, high=None, bound=None, spread=0.0):
    return {'level': level, 'seed': seed, 'promised': promised, 'true': true, 'true_low': true - spread, 'true_high': true + spread,
            'low': 0.8 * promised if low is None else low, 'high': promised if high is None else high, 'bound95': bound or promised, 'rays': rays,
            'gather_rays': rays, 'least_gather_rays': least, 'reference_noise': 0.001}


LADDER = [row(0.04, 0.035, rays=1000), row(0.02, 0.018, rays=2400), row(0.01, 0.009, rays=6000)]


class Judge(unittest.TestCase):
    def test_promises_that_are_kept_leave_no_fault(self):
        self.assertEqual(honesty.judge(LADDER)[1], [])

    def test_a_level_that_breaks_its_promises_is_named(self):
        broken = [row(r['promised'], 1.2 * r['promised'], 'b', rays=r['rays'], high=1.5 * r['promised'], bound=r['bound95']) for r in LADDER]
        faults = honesty.judge(LADDER + broken)[1]
        self.assertTrue(any(f.startswith('b: 0 %') for f in faults))
        self.assertTrue(any('50.0 % of all runs kept' in f for f in faults))

    def test_intervals_beside_the_truth_count_as_missed_unless_the_reference_leaves_it_open(self):
        self.assertFalse(honesty.covered(row(0.02, 0.01, low=0.015, high=0.02)))
        self.assertTrue(honesty.covered(row(0.02, 0.01, low=0.015, high=0.02, spread=0.006)))

    def test_padding_is_far_better_than_promised_at_a_price(self):
        self.assertTrue(honesty.padded(row(0.03, 0.005)))
        self.assertFalse(honesty.padded(row(0.03, 0.005, rays=105)))  # the least that a bake casts
        self.assertFalse(honesty.padded(row(0.03, 0.011)))

    def test_dearer_and_worse_is_not_monotone(self):
        self.assertEqual(len(honesty.not_monotone([row(0.02, 0.018, rays=2000), row(0.01, 0.009, rays=1900)])), 1)
        self.assertEqual(len(honesty.not_monotone([row(0.02, 0.018, rays=2000), row(0.01, 0.009, rays=2500, bound=0.021)])), 1)
        self.assertEqual(honesty.not_monotone([row(0.02, 0.018, seed=1), row(0.01, 0.009, seed=2, rays=500)]), [])

    def test_exponent_is_that_of_a_power(self):
        self.assertAlmostEqual(honesty.slope([(x, 5 * x**-1.7) for x in (0.08, 0.04, 0.01)]), -1.7)
        steep = [row(0.04, 0.04, rays=1000), row(0.02, 0.02, rays=4000), row(0.01, 0.01, rays=16000)]
        self.assertTrue(any('error^-2.00' in f for f in honesty.judge(steep)[1]))


if __name__ == '__main__':
    unittest.main()
