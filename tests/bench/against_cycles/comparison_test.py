#!/usr/bin/python3
"""Tests of comparison.py and scenes.py."""

import unittest

import numpy

import comparison
import scenes


def noisy(mean, deviation, seed, count=8):
    random = numpy.random.default_rng(seed)
    return [numpy.full((72, 96, 3), mean) + random.normal(0, deviation, (72, 96, 3)) for _ in range(count)]


class CrossingTest(unittest.TestCase):
    def test_interpolates_on_logarithmic_scales(self):
        self.assertAlmostEqual(comparison.crossing([(1, 1.0), (100, 0.01)], 0.1), 10)

    def test_takes_the_piece_that_crosses(self):
        curve = [(1, 8.0), (2, 4.0), (4, 2.0), (8, 1.0)]
        self.assertAlmostEqual(comparison.crossing(curve, 2.0), 4)

    def test_extrapolates_nothing(self):
        self.assertIsNone(comparison.crossing([(4, 0.009), (16, 0.002)], 0.01))
        self.assertIsNone(comparison.crossing([(4, 0.5), (16, 0.1)], 0.01))
        self.assertIsNone(comparison.crossing([(4, 0.5), (16, -0.1)], 0.01))


class AgreementTest(unittest.TestCase):
    def test_equal_images_with_noise_agree(self):
        agreed = 0
        for seed in range(10):
            agreed += comparison.agreement(noisy(1, 0.5, 2 * seed), noisy(1, 0.5, 2 * seed + 1)).comparable
        self.assertGreaterEqual(agreed, 9)

    def test_difference_of_the_means_of_two_percent_is_found(self):
        found = comparison.agreement(noisy(1, 0.01, 1), noisy(1.02, 0.01, 2))
        self.assertAlmostEqual(found.mean_ratio, 1.02, places=3)
        self.assertFalse(found.comparable)

    def test_few_different_blocks_are_found(self):
        ours, theirs = noisy(1, 0.1, 1), noisy(1, 0.1, 2)
        for image in theirs:
            image[:16, :32] += 0.1  # 8 of 108 blocks; the mean changes by 0.7 %
        found = comparison.agreement(ours, theirs)
        self.assertGreaterEqual(found.differing, 8)
        self.assertLess(abs(found.mean_ratio - 1), 0.01)
        self.assertFalse(found.comparable)


class IntervalTest(unittest.TestCase):
    def test_contains_the_ratio(self):
        random = numpy.random.default_rng(1)
        curve = lambda scale: [(n, list(scale / n * random.normal(1, 0.1, 16))) for n in (1, 4, 16, 64, 256)]
        low, high = comparison.ratio_interval(curve(3.0), curve(1.0), 0.02)
        self.assertLess(low, 3)
        self.assertGreater(high, 3)
        self.assertLess(high / low, 1.3)

    def test_slope_of_independent_samples(self):
        self.assertAlmostEqual(comparison.slope([(1, 2.0), (10, 0.2), (100, 0.02)]), -1)


class ReferenceTest(unittest.TestCase):
    def test_error_is_that_of_the_image_alone(self):
        reference = comparison.Reference(noisy(1, 0.03, 1, count=16))
        errors = [reference.error_of(image) for image in noisy(1, 0.03, 2, count=16)]
        # 16 x 20,736 squares of normal numbers: a standard error of 0.25 %.
        self.assertAlmostEqual(sum(errors) / 16, 0.03**2 / 1.01, delta=1e-5)


class SameWorkTest(unittest.TestCase):
    def test_dielectrics_become_lambert_and_glass_stays(self):
        glass = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}
        gltf = scenes.same_work({"materials": [{"normalTexture": {"index": 0}}, dict(glass)]})
        self.assertEqual(gltf["materials"][0], {"extensions": {"KHR_materials_specular": {"specularFactor": 0}},
                                                "pbrMetallicRoughness": {"roughnessFactor": 0.2}})
        self.assertEqual(gltf["materials"][1], glass)

    def test_spots_become_points(self):
        light = {"type": "spot", "intensity": 3, "spot": {"outerConeAngle": 0.4}}
        gltf = scenes.same_work({"extensions": {"KHR_lights_punctual": {"lights": [light]}}})
        self.assertEqual(gltf["extensions"]["KHR_lights_punctual"]["lights"], [{"type": "point", "intensity": 3}])

    def test_glb_keeps_its_binary_chunk(self):
        data = scenes.written({"asset": {"version": "2.0"}}, b"\4\0\0\0BIN\0data")
        self.assertEqual(scenes.read(data), ({"asset": {"version": "2.0"}}, b"\4\0\0\0BIN\0data"))


if __name__ == "__main__":
    unittest.main()
