"""Scenes for farm tests and the quick start."""

import math

from maker.gltf import Gltf
from maker.looks import glass, metal, mosaic, plain, png
from maker.meshes import joined, quad, rounded, sphere, torus
from maker.settings import camera, room


def quickstart():
    """The scene of deploy/quickstart.sh: a box with a mosaic floor, a glass ball, metal rings."""
    gltf = Gltf()
    texture = gltf.texture(png(128, 128, mosaic))
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    floor = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": texture}, "metallicFactor": 0, "roughnessFactor": 0.35}})
    room(gltf, floor)
    clear = gltf.add("materials", glass([0.75, 0.95, 0.85]))
    gold = gltf.add("materials", metal(1.0, 0.72, 0.32, 0.18))
    steel = gltf.add("materials", metal(0.62, 0.63, 0.65, 0.45))
    gltf.node(mesh=gltf.mesh(sphere(0.62, 32), clear), translation=[0.85, 0.63, 0.75])
    gltf.node(mesh=gltf.mesh(torus(0.72, 0.2, 28), gold), translation=[-0.75, 0.93, -0.35],
              rotation=rounded(0.64, 0.18, 0.05, math.sqrt(1 - 0.64**2 - 0.18**2 - 0.05**2)))
    gltf.node(mesh=gltf.mesh(sphere(0.36, 20), steel), translation=[-0.85, 0.36, 0.95])
    camera(gltf, (0, 1.62, 6.6), (0, 1.36, 0), 0.62)
    return gltf


def same_bits():
    """The scene of the same-bits tests: many features, few triangles."""
    gltf = Gltf()
    stripes = gltf.texture(png(16, 16, lambda x, y: (230, 200, 40) if (x // 4) % 2 else (40, 60, 160)))
    holes = gltf.texture(png(16, 16, lambda x, y: (90, 200, 90, 255 if (x // 4 + y // 4) % 2 else 60)))
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume",
             "KHR_lights_punctual")
    floor = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": stripes}, "metallicFactor": 0, "roughnessFactor": 0.3}})
    room(gltf, floor)
    leaf = {"baseColorTexture": {"index": holes}, "metallicFactor": 0, "roughnessFactor": 0.8}
    mask = gltf.add("materials", {"pbrMetallicRoughness": leaf, "alphaMode": "MASK",
                                  "alphaCutoff": 0.5, "doubleSided": True})
    blend = gltf.add("materials", {"pbrMetallicRoughness": leaf, "alphaMode": "BLEND",
                                   "doubleSided": True})
    ball = gltf.mesh(sphere(0.5, 8), gltf.add("materials", glass([0.9, 0.6, 0.6])))
    ring = gltf.mesh(torus(0.5, 0.2, 6), gltf.add("materials", metal(0.9, 0.9, 0.8, 0.25)))
    gltf.node(mesh=ball, translation=[0.9, 0.55, 0.6])
    gltf.node(mesh=ring, translation=[-0.8, 1.0, -0.4], rotation=[0.6, 0, 0, 0.8])
    moving = gltf.node(mesh=ring, translation=[0.2, 0.4, 1.1], scale=[0.5, -0.5, 0.5])
    gltf.node(mesh=gltf.mesh(quad((-1.6, 0.2, 1.2), (1, 0, 0.2), (0, 1, 0)), mask))
    gltf.node(mesh=gltf.mesh(quad((0.1, 1.4, 0.2), (1, 0, 0.2), (0, 1, 0)), blend))
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 12, "color": [0.6, 0.8, 1]}]}}
    gltf.node(translation=[1.2, 2.4, 1.4], extensions={"KHR_lights_punctual": {"light": 0}})
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    places = gltf.floats([[0.2, 0.4, 1.1], [-0.6, 0.9, 1.1]], "VEC3", target=None)
    gltf.add("animations", {"name": "hop",
                            "samplers": [{"input": times, "output": places}],
                            "channels": [{"sampler": 0,
                                          "target": {"node": moving, "path": "translation"}}]})
    camera(gltf, (0, 1.62, 6.6), (0, 1.36, 0), 0.62)
    return gltf


def lit_square():
    """A minimal lit scene for farm tests: one diffuse square under one area light."""
    gltf = Gltf()
    grey = gltf.add("materials", plain(0.5, 0.5, 0.5))
    gltf.node(mesh=gltf.mesh(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), grey))
    gltf.use("KHR_lights_punctual")
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 3}]}}
    gltf.node(translation=[0, 1, 0], extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0, 3, 0.001), (0, 0, 0), 0.9)
    return gltf


def missing_texture():
    """lit_square with a missing texture file: rejected before the first unit."""
    gltf = lit_square()
    image = gltf.add("images", {"uri": "not-here.png"})
    texture = gltf.add("textures", {"source": image})
    gltf.doc["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
    return gltf


def stadium():
    """The "teapot in a stadium" (here a ring): a dense object of 1 m in a field of 400 m, as one
    mesh, which a uniform grid handles badly. For `inspect --accelerators`."""
    gltf = Gltf()
    grey = gltf.add("materials", plain(0.6, 0.6, 0.55))
    ring = torus(0.5, 0.2, 24)
    ring = ([rounded(x, y + 0.5, z) for x, y, z in ring[0]], *ring[1:])
    stands = [quad((-200, 0, 200), (400, 0, 0), (0, 0, -400)),
              quad((-200, 0, -200), (400, 0, 0), (0, 90, -60)),
              quad((200, 0, 200), (-400, 0, 0), (0, 90, 60)),
              quad((200, 0, -200), (0, 0, 400), (60, 90, 0)),
              quad((-200, 0, 200), (0, 0, -400), (-60, 90, 0))]
    gltf.node(mesh=gltf.mesh(joined(ring, *stands), grey))
    gltf.use("KHR_lights_punctual")
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 100000}]}}
    gltf.node(translation=[20, 60, 30], extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0, 1.6, 3), (0, 0.5, 0), 0.7)
    return gltf


def hidden_room():
    """A room full of rings behind a wall, and one ring in front of it, as one mesh: most triangles
    are never seen. For `inspect --accelerators`."""
    gltf = Gltf()
    grey = gltf.add("materials", plain(0.6, 0.6, 0.55))
    ring = torus(0.35, 0.14, 7)
    rings = [([rounded(x + i, y + j, z - k) for x, y, z in ring[0]], *ring[1:])
             for i, j, k in [(0, 0.5, -1.5)] + [(i, j, k) for i in (-2, -1, 0, 1, 2)
                                                for j in (0.5, 1.5) for k in (0.6, 1.6)]]
    walls = [quad((-3, 0, 3), (6, 0, 0), (0, 0, -6)), quad((-3, 0, 0), (6, 0, 0), (0, 2.5, 0)),
             quad((-3, 0, 3), (0, 0, -6), (0, 2.5, 0)), quad((3, 0, -3), (0, 0, 6), (0, 2.5, 0))]
    gltf.node(mesh=gltf.mesh(joined(*rings, *walls), grey))
    gltf.use("KHR_lights_punctual")
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 8}]}}
    gltf.node(translation=[1, 2.3, 2.5], extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0, 1.4, 4.5), (0, 1, 0), 0.8)
    return gltf
