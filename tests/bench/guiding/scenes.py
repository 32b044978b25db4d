#!/usr/bin/env python3
"""Writes the scenes of tests/bench/guiding.sh: those of tests/bench/coverage and three more.

    scenes.py FOLDER     writes FOLDER/NAME.gltf, and FOLDER/sky.hdr for window_sky
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scenes"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "coverage"))  # first: both have make_scenes
import make_scenes  # noqa: E402
from make_scenes import floor, lamp, use_glass  # noqa: E402
from maker.gltf import Gltf  # noqa: E402
from maker.looks import plain  # noqa: E402
from maker.meshes import quad, sphere  # noqa: E402
from maker.settings import camera  # noqa: E402


def door_gap():
    """A dark room; a lamp in the next room shines through the gap of 4 cm under a door."""
    gltf = Gltf()
    white = gltf.add("materials", plain(0.7, 0.7, 0.7, doubleSided=True))
    door = gltf.add("materials", plain(0.35, 0.2, 0.1, doubleSided=True))
    for origin, u, v in (((-2, 0, 3), (4, 0, 0), (0, 0, -6)), ((-2, 2.5, -3), (4, 0, 0), (0, 0, 6)),
                         ((-2, 0, -3), (0, 2.5, 0), (0, 0, 6)), ((2, 0, -3), (0, 0, 6), (0, 2.5, 0)),
                         ((-2, 0, -3), (4, 0, 0), (0, 2.5, 0)), ((-2, 0, 3), (0, 2.5, 0), (4, 0, 0)),
                         ((-2, 0, -0.5), (1.5, 0, 0), (0, 2.5, 0)),
                         ((0.5, 0, -0.5), (1.5, 0, 0), (0, 2.5, 0)),
                         ((-0.5, 2, -0.5), (1, 0, 0), (0, 0.5, 0))):
        gltf.node(mesh=gltf.mesh(quad(origin, u, v), white))
    gltf.node(mesh=gltf.mesh(quad((-0.5, 0.04, -0.5), (1, 0, 0), (0, 1.96, 0)), door))
    lamp(gltf, 40000, (0, 2.4, -1.8), 0.5)
    camera(gltf, (0.8, 1.4, 2.6), (-0.2, 0.6, -0.5), 0.9)
    return gltf


def small_sun_ball():
    """A glass ball under a lamp as small as the sun seems: its image on the floor is sharp."""
    gltf = Gltf()
    white = gltf.add("materials", plain(0.7, 0.7, 0.7))
    floor(gltf, white)
    gltf.node(mesh=gltf.mesh(quad((-4, 0, -1.5), (8, 0, 0), (0, 3, 0)), white))
    gltf.node(mesh=gltf.mesh(sphere(0.6, 24), use_glass(gltf)), translation=[0, 0.8, 0])
    lamp(gltf, 20000, (1.5, 5, 0.8), 0.05)
    camera(gltf, (0, 2.2, 4), (0, 0.4, 0), 0.7)
    return gltf


def window_sky():
    """The room of the scene window under sky.hdr, whose sun does not reach the window."""
    return make_scenes.window()


def radiance_bytes(grey):
    """A grey pixel of a Radiance file: three mantissas of 8 bits and an exponent."""
    mantissa, exponent = math.frexp(grey)
    return bytes([int(mantissa * 256)] * 3 + [exponent + 128])


def sky():
    """A Radiance file: a sky that is brighter at the horizon, black ground, and a sun of one texel, four times as
    bright as the sky together."""
    width, height = 128, 64
    sun = (int((0.5 + math.atan2(0.1, 1) / (2 * math.pi)) * width), int(math.acos(0.5) / math.pi * height))
    pixels = b""
    for row in range(height):
        elevation = math.pi / 2 - math.pi * (row + 0.5) / height
        for column in range(width):
            grey = 0 if elevation < 0 else 30 - 20 * math.sin(elevation)
            pixels += radiance_bytes(240000 if (column, row) == sun else grey)
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode() + pixels


SCENES = (*make_scenes.BATTERY, door_gap, small_sun_ball, window_sky)


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit("usage: scenes.py FOLDER")
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for make in SCENES:
        (folder / f"{make.__name__}.gltf").write_text(make().text())
    (folder / "sky.hdr").write_bytes(sky())


if __name__ == "__main__":
    main()
