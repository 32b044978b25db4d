#!/usr/bin/python3
"""Tests of comparison.py, scenes.py, own_scenes.py and gltf_scene.py."""

import math
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

import numpy

import comparison
import gltf_scene
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


class OwnScenesTest(unittest.TestCase):
    def test_all_are_written_and_can_be_prepared(self):
        with tempfile.TemporaryDirectory() as name:
            own, changed = pathlib.Path(name) / "own", pathlib.Path(name) / "changed"
            script = pathlib.Path(scenes.__file__).with_name("own_scenes.py")
            subprocess.run([sys.executable, script, own], check=True)
            changed.mkdir()
            for scene, entry in scenes.OWN.items():
                gltf, _ = scenes.read(scenes.prepare(own / entry.file, changed / scene).read_bytes())
                self.assertIn("cameras", gltf)
                if isinstance(entry.sky, str):
                    self.assertTrue((own / entry.sky).exists())

    def test_names_of_both_sets_differ(self):
        self.assertEqual(len(scenes.SCENES), len(scenes.GIVEN) + len(scenes.OWN))


def glb(node, material=None, light=None):
    """Returns a .glb with a triangle in the plane z = 0, and a camera."""
    points = numpy.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], *[[0, 0, 1]] * 3], "<f4").tobytes()
    binary = points + numpy.array([0, 1, 2], "<u2").tobytes() + b"\0\0"
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}
    gltf = {
        "scenes": [{"nodes": [0, 1]}], "nodes": [node, {"camera": 0, "translation": [0, 0, 5]}],
        "cameras": [{"perspective": {"yfov": 0.5}}], "meshes": [{"primitives": [primitive]}],
        "materials": [material or scenes.same_work({"materials": [{"pbrMetallicRoughness": {"metallicFactor": 0}}]})[
            "materials"][0]],
        "extensions": {"KHR_lights_punctual": {"lights": [light]}},
        "bufferViews": [{"buffer": 0, "byteOffset": 36 * k} for k in range(3)],
        "accessors": [{"bufferView": k, "componentType": 5126, "count": 3, "type": "VEC3"} for k in range(2)] + [
            {"bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR"}]}
    return scenes.written(gltf, struct.pack("<II", len(binary), 0x4E4942) + binary)


class GltfSceneTest(unittest.TestCase):
    def test_triangles_are_in_world_space(self):
        half = math.sqrt(0.5)  # a quarter turn about y takes z to x
        scene = gltf_scene.read(glb({"mesh": 0, "translation": [1, 2, 3], "rotation": [0, half, 0, half],
                                     "scale": [2, 3, 4]}))
        (shape,) = scene.shapes
        numpy.testing.assert_allclose(shape.positions, [[1, 2, 3], [1, 2, 1], [1, 5, 3]], atol=1e-6)
        numpy.testing.assert_allclose(shape.normals, [[1, 0, 0]] * 3, atol=1e-6)
        numpy.testing.assert_array_equal(shape.triangles, [[0, 1, 2]])
        self.assertEqual((shape.surface.kind, shape.surface.color, scene.yfov), ("diffuse", (1, 1, 1), 0.5))
        numpy.testing.assert_array_equal(scene.camera[:3, 3], [0, 0, 5])

    def test_mirrored_triangles_keep_their_front(self):
        (shape,) = gltf_scene.read(glb({"mesh": 0, "scale": [-1, 1, 1]})).shapes
        a, b, c = shape.positions[shape.triangles[0]]
        self.assertGreater(numpy.dot(numpy.cross(b - a, c - a), shape.normals[0]), 0)

    def test_children_follow_their_parent(self):
        data, chunks = scenes.read(glb({"children": [2], "scale": [2, 2, 2]}))
        data["nodes"].append({"mesh": 0, "translation": [1, 0, 0]})
        (shape,) = gltf_scene.read(scenes.written(data, chunks)).shapes
        numpy.testing.assert_allclose(shape.positions[0], [2, 0, 0])

    def test_lights_have_colour_and_direction(self):
        light = {"type": "directional", "intensity": 2, "color": [1, 0.5, 0]}
        node = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
        (found,) = gltf_scene.read(glb(node, light=light)).lights
        self.assertEqual((found.kind, found.color, list(found.direction)), ("directional", (2, 1, 0), [0, 0, -1]))

    def test_glass_absorbs_to_its_colour_at_the_distance(self):
        extensions = {"transmission": {"transmissionFactor": 1}, "ior": {"ior": 1.4}, "volume": {
            "thicknessFactor": 1, "attenuationColor": [0.5, 1, 1], "attenuationDistance": 2}}
        surface = gltf_scene.surface_of({
            "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0},
            "extensions": {f"KHR_materials_{name}": value for name, value in extensions.items()}})
        self.assertEqual((surface.kind, surface.ior), ("glass", 1.4))
        numpy.testing.assert_allclose(numpy.exp(-2 * numpy.array(surface.absorption)), [0.5, 1, 1])

    def test_unknown_features_are_refused(self):
        plain = {"pbrMetallicRoughness": {"metallicFactor": 1}}
        self.assertEqual(gltf_scene.surface_of(plain).kind, "metal")
        for change in ({"alphaMode": "MASK"}, {"emissiveTexture": {}}, {"extensions": {"KHR_materials_sheen": {}}},
                       {"pbrMetallicRoughness": {"metallicFactor": 0}}):
            with self.assertRaises(gltf_scene.Unsupported):
                gltf_scene.surface_of(plain | change)

    def test_ply_has_vertices_and_faces(self):
        (shape,) = gltf_scene.read(glb({"mesh": 0})).shapes
        head, body = gltf_scene.ply(shape).split(b"end_header\n")
        self.assertIn(b"element vertex 3\n", head)
        self.assertEqual(numpy.frombuffer(body[:72], "<f4").reshape(3, 6)[1].tolist(), [1, 0, 0, 0, 0, 1])
        self.assertEqual(struct.unpack("<Biii", body[72:]), (3, 0, 1, 2))


if __name__ == "__main__":
    unittest.main()
