#!/usr/bin/env python3
"""Writes the project's own scenes of the comparison: some of tests/bench/coverage and tests/bench/guiding, the
quick start, and five more.

    own_scenes.py FOLDER     writes FOLDER/NAME.gltf for each scene, and FOLDER/sky.hdr
"""

import sys
from pathlib import Path
from random import Random

TESTS = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(TESTS / "bench/guiding"))
import scenes as guiding_scenes  # noqa: E402
import make_scenes  # noqa: E402
from make_scenes import floor, lamp, use_glass  # noqa: E402
from maker.farm import quickstart  # noqa: E402
from maker.gltf import Gltf  # noqa: E402
from maker.looks import metal, mosaic, plain, png  # noqa: E402
from maker.meshes import quad, sphere  # noqa: E402
from maker.settings import camera, room  # noqa: E402


def glass_box():
    """A Cornell box with a glass ball and a ball of rough metal."""
    gltf = Gltf()
    room(gltf, gltf.add("materials", plain(0.7, 0.7, 0.7)))
    gltf.node(mesh=gltf.mesh(sphere(0.7, 48), use_glass(gltf, (0.8, 0.95, 0.9))), translation=[0.8, 0.71, 0.6])
    gltf.node(mesh=gltf.mesh(sphere(0.6, 48), gltf.add("materials", metal(0.9, 0.7, 0.4, 0.2))),
              translation=[-0.8, 0.61, -0.4])
    camera(gltf, (0, 1.5, 6.6), (0, 1.5, 0), 0.55)
    return gltf


def sky_balls():
    """Rows of Lambert and metal balls under sky.hdr, whose sun casts hard shadows."""
    gltf = Gltf()
    floor(gltf, gltf.add("materials", plain(0.5, 0.5, 0.5)))
    for row in range(3):
        for column in range(5):
            look = plain(0.2 + 0.15 * column, 0.5, 0.3) if row != 1 else metal(0.9, 0.8, 0.6, 0.2 - 0.04 * column)
            gltf.node(mesh=gltf.mesh(sphere(0.3, 48), gltf.add("materials", look)),
                      translation=[-1.6 + 0.8 * column, 0.31, 0.8 - 0.8 * row])
    camera(gltf, (0, 2.2, 4), (0, 0.2, 0), 0.7)
    return gltf


def mosaic_room():
    """A room with textured walls and balls, lit by its lamp."""
    gltf = Gltf()
    tiles = gltf.texture(png(128, 128, mosaic))
    room(gltf, gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": tiles}, "metallicFactor": 0, "roughnessFactor": 1}}))
    for x, z in ((-1, -0.6), (0.9, 0.3)):
        gltf.node(mesh=gltf.mesh(sphere(0.6, 48), gltf.add("materials", {"pbrMetallicRoughness": {
            "baseColorTexture": {"index": tiles}, "metallicFactor": 0, "roughnessFactor": 1}})),
            translation=[x, 0.6, z])
    camera(gltf, (0, 1.5, 6.6), (0, 1.5, 0), 0.55)
    return gltf


def focus():
    """Balls in front of an emissive board, of which a thin lens shows only the second sharply."""
    gltf = Gltf()
    gltf.use("TESSERA_camera", "KHR_materials_emissive_strength")
    floor(gltf, gltf.add("materials", plain(0.4, 0.4, 0.4)), 6)
    stripes = gltf.texture(png(64, 32, lambda x, y: (235, 226, 205) if (x // 8 + y // 8) % 2 else (20, 40, 60)))
    board = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 1, 1], emissiveTexture={"index": stripes},
                                        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 3}}))
    gltf.node(mesh=gltf.mesh(quad((-4, 0, -4), (8, 0, 0), (0, 4, 0)), board))
    lamp(gltf, 8, (0, 4, 1), 2)
    for k, color in enumerate(((0.8, 0.2, 0.15), (0.85, 0.65, 0.2), (0.25, 0.6, 0.3), (0.2, 0.35, 0.75))):
        gltf.node(mesh=gltf.mesh(sphere(0.35, 48), gltf.add("materials", plain(*color))),
                  translation=[-1.05 + 0.7 * k, 0.35, 1.6 - 1.5 * k])
    camera(gltf, (0, 1.1, 5), (0, 0.5, 0), 0.5)
    gltf.doc["cameras"][0]["extensions"] = {"TESSERA_camera": {
        "lens": {"fNumber": 0.3, "sensorHeight": 0.05, "focusDistance": 4.9}}}
    return gltf


def lamp_rooms():
    """350 lamps in 25 rooms of 4 x 4 m with doors, seen from the room in the middle."""
    gltf = Gltf()
    random = Random(350)
    white = gltf.add("materials", plain(0.7, 0.68, 0.65))
    ball = gltf.mesh(sphere(0.5, 24), gltf.add("materials", plain(0.6, 0.3, 0.2)))
    for y, up in ((0, -1), (3, 1)):  # floor and ceiling
        gltf.node(mesh=gltf.mesh(quad((-10, y, -10 * up), (20, 0, 0), (0, 0, 20 * up)), white))
    for k in range(6):
        at = -10 + 4 * k
        doors = range(5) if 0 < k < 5 else ()
        ends = [-10] + [x for room in doors for x in (-8.5 + 4 * room, -7.5 + 4 * room)] + [10]
        for start, end in zip(ends[::2], ends[1::2]):
            gltf.node(mesh=gltf.mesh(quad((start, 0, at), (end - start, 0, 0), (0, 3, 0)), white))
            gltf.node(mesh=gltf.mesh(quad((at, 0, start), (0, 0, end - start), (0, 3, 0)), white))
    for room in range(25):
        x, z = -8 + 4 * (room % 5), -8 + 4 * (room // 5)
        gltf.node(mesh=ball, translation=[x + random.uniform(-1, 1), 0.5, z + random.uniform(-1.2, -0.6)])
        for _ in range(14):
            lamp(gltf, random.uniform(5, 50), (x + random.uniform(-1.8, 1.8), random.uniform(2, 2.9),
                                                         z + random.uniform(-1.8, 1.8)), 0.12)
    camera(gltf, (0.2, 1.5, 1.9), (0, 1.2, -2), 0.9)
    return gltf


OWN = (make_scenes.furnace, make_scenes.cornell, make_scenes.penumbra, make_scenes.small_lamp, make_scenes.many_lamps,
       make_scenes.points, make_scenes.foliage, make_scenes.checker, make_scenes.glossy, make_scenes.glint,
       make_scenes.window, make_scenes.caustic, guiding_scenes.window_sky, quickstart, glass_box, sky_balls, mosaic_room,
       focus, lamp_rooms)


def write(folder):
    for make in OWN:
        (folder / f"{make.__name__}.gltf").write_text(make().text())
    (folder / "sky.hdr").write_bytes(guiding_scenes.sky())


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit("usage: own_scenes.py FOLDER")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    write(folder)


if __name__ == "__main__":
    main()
