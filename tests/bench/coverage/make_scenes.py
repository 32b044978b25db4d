#!/usr/bin/env python3
"""Writes the battery of tests/bench/coverage.sh: small scenes that are easy, hard or impossible for an
error estimate.

    make_scenes.py FOLDER     writes FOLDER/NAME.gltf and FOLDER/battery.json

battery.json lists for each scene the target error, further options, and whether it is well-behaved
(its error is spread over many pixels, and no event is rare).
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scenes"))
from maker.gltf import Gltf  # noqa: E402
from maker.looks import glass, metal, plain, png  # noqa: E402
from maker.meshes import quad, sphere  # noqa: E402
from maker.settings import camera, room  # noqa: E402


def lamp(gltf, strength, centre, side):
    """A square area light that emits downwards."""
    gltf.use("KHR_materials_emissive_strength")
    material = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 1, 1], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": strength}}))
    x, y, z = centre
    half = side / 2
    gltf.node(mesh=gltf.mesh(quad((x - half, y, z - half), (side, 0, 0), (0, 0, side)), material))


def floor(gltf, material, size=4):
    gltf.node(mesh=gltf.mesh(quad((-size, 0, size), (2 * size, 0, 0), (0, 0, -2 * size)), material))


def use_glass(gltf, tint=(1, 1, 1)):
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    return gltf.add("materials", glass(list(tint)))


def furnace():
    """A grey ball in a white environment: all paths carry about the same radiance."""
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(sphere(1, 24), gltf.add("materials", plain(0.6, 0.5, 0.4))))
    floor(gltf, gltf.add("materials", plain(0.5, 0.5, 0.5)))
    camera(gltf, (0, 1.5, 4), (0, 0.2, 0), 0.8)
    return gltf


def cornell():
    gltf = Gltf()
    room(gltf, gltf.add("materials", plain(0.7, 0.7, 0.7)))
    grey = gltf.add("materials", plain(0.7, 0.7, 0.7))
    gltf.node(mesh=gltf.mesh(sphere(0.6, 16), grey), translation=[-0.8, 0.6, -0.4])
    gltf.node(mesh=gltf.mesh(sphere(0.5, 16), grey), translation=[0.8, 0.5, 0.5])
    camera(gltf, (0, 1.5, 6.6), (0, 1.5, 0), 0.55)
    return gltf


def penumbra():
    """A ball between a large area light and a floor."""
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.6, 0.6, 0.6)))
    gltf.node(mesh=gltf.mesh(sphere(0.6, 16), gltf.add("materials", plain(0.5, 0.2, 0.2))),
              translation=[0, 1, 0])
    lamp(gltf, 8, (0, 3, 0), 2)
    camera(gltf, (0, 2.6, 4), (0, 0.6, 0), 0.7)
    return gltf


def small_lamp():
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.6, 0.6, 0.6)))
    gltf.node(mesh=gltf.mesh(sphere(0.6, 16), gltf.add("materials", plain(0.3, 0.5, 0.3))),
              translation=[0, 0.6, 0])
    lamp(gltf, 800, (1, 3, 1), 0.2)
    camera(gltf, (0, 2.6, 4), (0, 0.5, 0), 0.7)
    return gltf


def glossy():
    """Rough metal over a rough metal floor: light reflected by two lobes."""
    gltf = Gltf()
    floor(gltf, gltf.add("materials", metal(0.8, 0.8, 0.8, 0.4)))
    for x, roughness in ((-1.1, 0.25), (0, 0.45), (1.1, 0.7)):
        gltf.node(mesh=gltf.mesh(sphere(0.5, 16), gltf.add("materials", metal(0.9, 0.6, 0.3, roughness))),
                  translation=[x, 0.5, 0])
    lamp(gltf, 10, (0, 3, 0), 2)
    camera(gltf, (0, 1.8, 4), (0, 0.4, 0), 0.7)
    return gltf


def many_lamps():
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.6, 0.6, 0.6)))
    gltf.node(mesh=gltf.mesh(sphere(0.7, 16), gltf.add("materials", plain(0.6, 0.6, 0.5))),
              translation=[0, 0.7, 0])
    for i in range(36):
        lamp(gltf, 20 + 5 * (i % 7), (-2.5 + i % 6, 1.6 + 0.2 * (i % 3), -2.5 + i // 6), 0.12)
    camera(gltf, (0, 2.6, 4), (0, 0.5, 0), 0.8)
    return gltf


def points():
    """Three point lights: all noise comes from indirect light."""
    gltf = cornell()
    gltf.use("KHR_lights_punctual")
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 10}, {"type": "spot", "intensity": 30}]}}
    for place, light in (((-1, 2, 1), 0), ((1, 1, 1.5), 0)):
        gltf.node(translation=list(place), extensions={"KHR_lights_punctual": {"light": light}})
    return gltf


def foliage():
    """Rows of leaves with holes in front of an area light."""
    gltf = Gltf()
    holes = gltf.texture(png(16, 16, lambda x, y: (70, 150, 60, 255 if (x // 2 + y // 2) % 2 else 0)))
    leaf = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": holes}, "metallicFactor": 0}, "alphaMode": "MASK",
        "doubleSided": True})
    floor(gltf, gltf.add("materials", plain(0.5, 0.45, 0.4)))
    for row in range(4):
        gltf.node(mesh=gltf.mesh(quad((-1.5, 0, -1 + 0.6 * row), (3, 0, 0), (0, 1.2, 0), 3), leaf))
    lamp(gltf, 12, (0, 3, 0), 2)
    camera(gltf, (1, 2.2, 4), (0, 0.6, 0), 0.7)
    return gltf


def checker():
    """A fine pattern up to the horizon: noise from edges within pixels."""
    gltf = Gltf()
    fine = gltf.texture(png(64, 64, lambda x, y: (230, 230, 230) if (x + y) % 2 else (20, 20, 20)))
    floor_material = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": fine}, "metallicFactor": 0, "roughnessFactor": 1}})
    gltf.node(mesh=gltf.mesh(quad((-20, 0, 4), (40, 0, 0), (0, 0, -40), 20), floor_material))
    camera(gltf, (0, 1, 4), (0, 0.4, 0), 0.8)
    return gltf


def window():
    """A room lit through a hole by a bright environment, which most paths do not find."""
    gltf = Gltf()
    white = gltf.add("materials", plain(0.7, 0.7, 0.7, doubleSided=True))
    for origin, u, v in (((-2, 0, 2), (4, 0, 0), (0, 0, -4)), ((-2, 3, -2), (4, 0, 0), (0, 0, 4)),
                         ((-2, 0, -2), (4, 0, 0), (0, 3, 0)), ((2, 0, -2), (0, 0, 4), (0, 3, 0)),
                         ((2, 0, 2), (-4, 0, 0), (0, 3, 0)), ((-2, 0, 2), (0, 0, -4), (0, 1, 0)),
                         ((-2, 2, 2), (0, 0, -4), (0, 1, 0)), ((-2, 1, 2), (0, 0, -1.5), (0, 1, 0)),
                         ((-2, 1, -0.5), (0, 0, -1.5), (0, 1, 0))):
        gltf.node(mesh=gltf.mesh(quad(origin, u, v), white))
    camera(gltf, (0.5, 1.4, 1.9), (0, 1.2, -2), 1.0)
    return gltf


def caustic():
    """A glass ball under a small area light: only BSDF sampling finds the caustic."""
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.6, 0.6, 0.6)))
    gltf.node(mesh=gltf.mesh(sphere(0.7, 24), use_glass(gltf)), translation=[0, 0.9, 0])
    lamp(gltf, 200, (0.8, 3, 0), 0.4)
    camera(gltf, (0, 2.6, 4), (0, 0.4, 0), 0.7)
    return gltf


def caged_lamp():
    """A tiny area light inside a glass ball lights a room: all light is a rare event."""
    gltf = Gltf()
    white = gltf.add("materials", plain(0.7, 0.7, 0.7))
    floor(gltf, white)
    gltf.node(mesh=gltf.mesh(quad((-4, 0, -2), (8, 0, 0), (0, 4, 0)), white))
    lamp(gltf, 20000, (0, 1.4, 0), 0.04)
    gltf.node(mesh=gltf.mesh(sphere(0.5, 24), use_glass(gltf)), translation=[0, 1.4, 0])
    lamp(gltf, 1, (0, 4, 1), 2)  # and a little light that is easy to sample
    camera(gltf, (0, 2.2, 5), (0, 0.8, 0), 0.8)
    return gltf


def glint():
    """A small bright area light, reflected by mirror balls: fireflies in an easy scene."""
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.5, 0.5, 0.5)))
    mirror = gltf.mesh(sphere(0.4, 24), gltf.add("materials", metal(0.95, 0.95, 0.95, 0)))
    for x in (-1, 0, 1):
        gltf.node(mesh=mirror, translation=[x, 0.4, 0])
    lamp(gltf, 3000, (0.5, 2.5, 1), 0.05)
    lamp(gltf, 6, (0, 3, -0.5), 2)
    camera(gltf, (0, 1.8, 4), (0, 0.3, 0), 0.7)
    return gltf


def lens():
    """A thin lens that shows small lamps far behind as bright discs on a dark ground."""
    gltf = Gltf()
    gltf.use("TESSERA_camera")
    floor(gltf, gltf.add("materials", plain(0.35, 0.22, 0.14)))
    for k, color in enumerate(((0.8, 0.2, 0.15), (0.85, 0.65, 0.2), (0.25, 0.6, 0.3))):
        gltf.node(mesh=gltf.mesh(sphere(0.35, 24), gltf.add("materials", plain(*color))),
                  translation=[-0.9 + 0.8 * k, 0.35, 1.4 - 1.5 * k])
    gltf.node(mesh=gltf.mesh(quad((-6, -1, -6), (12, 0, 0), (0, 6, 0)),
                             gltf.add("materials", plain(0.02, 0.02, 0.04))))
    ball = gltf.mesh(sphere(0.05, 8), gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.8, 0.5], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 60}})))
    for k in range(5):
        gltf.node(mesh=ball, translation=[-2.4 + 1.2 * k, 1.2 + 0.4 * (k % 2), -5])
    lamp(gltf, 20, (0.5, 3.5, 1), 1)
    camera(gltf, (0, 1.1, 5), (0, 0.6, 0), 0.5)
    gltf.doc["cameras"][0]["extensions"] = {"TESSERA_camera": {
        "lens": {"fNumber": 0.4, "sensorHeight": 0.05, "focusDistance": 4.9}}}
    return gltf


def motion_blur():
    """A ball and a small lamp that move while the shutter is open."""
    gltf = Gltf()
    gltf.use("TESSERA_camera", "KHR_materials_emissive_strength")
    grey = gltf.add("materials", plain(0.5, 0.5, 0.5))
    floor(gltf, grey)
    gltf.node(mesh=gltf.mesh(quad((-4, 0, -2), (8, 0, 0), (0, 4, 0)), grey))
    spark = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.7, 0.35], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 200}}))
    tracks = ((gltf.node(mesh=gltf.mesh(sphere(0.06, 8), spark)), [[-1, 0.9, 0.4], [0.2, 1.3, 0.4]]),
              (gltf.node(mesh=gltf.mesh(sphere(0.4, 24), gltf.add("materials", plain(0.7, 0.3, 0.2)))),
               [[0.9, 0.4, 0.3], [0.3, 0.4, 0.3]]))
    lamp(gltf, 6, (0, 3, -0.5), 1)
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    samplers = [{"input": times, "output": gltf.floats(places, "VEC3", target=None)} for _, places in tracks]
    channels = [{"sampler": k, "target": {"node": node, "path": "translation"}}
                for k, (node, _) in enumerate(tracks)]
    gltf.add("animations", {"samplers": samplers, "channels": channels})
    camera(gltf, (0, 1.8, 4), (0, 0.5, 0), 0.7)
    gltf.doc["cameras"][0]["extensions"] = {"TESSERA_camera": {"shutter": {"open": 0, "close": 1}}}
    return gltf


# scene: target error, well-behaved, further options
BATTERY = {
    furnace: (0.06, True, []),
    cornell: (0.15, True, []),
    penumbra: (0.08, True, []),
    small_lamp: (0.08, True, []),
    many_lamps: (0.15, True, []),
    checker: (0.1, True, []),
    foliage: (0.15, True, []),
    points: (0.1, True, ["--max-depth", "3"]),
    glossy: (0.1, True, []),
    motion_blur: (0.15, False, []),
    lens: (0.2, False, ["--max-spp", "1024", "--reference-spp", "16384"]),
    glint: (0.2, False, ["--max-spp", "256"]),
    caustic: (0.3, False, ["--max-spp", "256", "--reference-spp", "16384"]),
    caged_lamp: (0.5, False, ["--max-spp", "256", "--reference-spp", "16384"]),
    window: (0.4, False, ["--max-spp", "512", "--reference-spp", "16384"]),
}


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit("usage: make_scenes.py FOLDER")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    battery = []
    for make, (error, is_well_behaved, options) in BATTERY.items():
        (folder / f"{make.__name__}.gltf").write_text(make().text())
        battery.append({"scene": make.__name__, "error": error,
                        "well_behaved": is_well_behaved, "options": options})
    (folder / "battery.json").write_text(json.dumps(battery, indent=1) + "\n")


if __name__ == "__main__":
    main()
