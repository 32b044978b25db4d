#!/usr/bin/env python3
"""Writes the test scenes: tests/scenes/*.gltf, each one file with data URIs.

    make_scenes.py            writes them
    make_scenes.py --check    exits with 1 if a file differs from what would be written

The bytes do not depend on the machine: coordinates are rounded to six decimals, which hides
differences in the last bit of sin().
"""

import sys
from pathlib import Path

from maker.cameras import lens, motion, moving_lamp, screens
from maker.course import course
from maker.farm import hidden_room, lit_square, missing_texture, quickstart, same_bits, stadium
from maker.landscapes import fog, planes, terrain
from maker.solids import blobs, csg, lamps, shapes
from maker.surfaces import materials, nested, optics, textures
from maker.volumes import flame, underwater

FOLDER = Path(__file__).resolve().parent


def main():
    check = "--check" in sys.argv[1:]
    stale = []
    for make in (quickstart, same_bits, materials, lit_square, missing_texture, stadium, hidden_room,
                 lens, screens, textures, optics, nested, shapes, csg, blobs, lamps, fog, flame,
                 underwater, motion, moving_lamp, terrain, course, planes):
        path = FOLDER / f"{make.__name__}.gltf"
        text = make().text()
        if check:
            if not path.exists() or path.read_text() != text:
                stale.append(path.name)
        else:
            path.write_text(text)
            print(f"{path.name}: {len(text)} bytes")
    if stale:
        sys.exit(f"make_scenes.py: not what this script writes: {', '.join(stale)}")


if __name__ == "__main__":
    main()
