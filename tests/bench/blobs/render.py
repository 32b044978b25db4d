#!/usr/bin/env python3
"""Renders 10,000 overlapping blobs and prints how many rays a CPU second traces.

    tests/bench/blobs/render.py [--bin build/dev/bin] [--set dense|knot] [--count 10000]
                                [--size 320x240] [--spp 16] [--output blobs.exr]

`dense` is a ball of blobs of which each overlaps all others, `knot` a knotted rope of blobs of
which each overlaps a few hundred. Both are grey, lit by one lamp under a dark sky. The rays are
those of the report: camera rays, scattered rays and shadow rays.
"""

import argparse
import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests/scenes"))
from maker.gltf import Gltf  # noqa: E402
from maker.looks import plain  # noqa: E402
from maker.settings import camera  # noqa: E402


def in_cube(dice, half):
    return [dice.uniform(-half, half) for _ in range(3)]


def dense(dice, count):
    """All blobs overlap, within a ball of radius about 1."""
    return [(in_cube(dice, 0.3), 1, 1) for _ in range(count)], count / 16


def knot(dice, count):
    """A trefoil knot of about the same size."""
    elements = []
    for i in range(count):
        at = 2 * math.pi * i / count
        out = 0.55 + 0.25 * math.cos(3 * at)
        centre = (out * math.cos(2 * at), out * math.sin(2 * at), 0.3 * math.sin(3 * at))
        offset = in_cube(dice, 0.08)
        elements.append(([c + o for c, o in zip(centre, offset)], dice.uniform(0.05, 0.15), 1))
    return elements, count / 1000


def scene(kind, count):
    gltf = Gltf()
    elements, threshold = {"dense": dense, "knot": knot}[kind](random.Random(1), count)
    grey = gltf.add("materials", plain(0.5, 0.5, 0.5))
    gltf.node(**gltf.blobs(grey, *elements, threshold=threshold))
    gltf.use("KHR_materials_emissive_strength")
    lamp = gltf.add("materials", {
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
        "emissiveFactor": [1, 0.9, 0.75],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 60}}})
    gltf.node(**gltf.shape("sphere", lamp, {"translation": [3, 3.5, 2.5]}, radius=0.5))
    camera(gltf, (0, 0, 5), (0, 0, 0), 0.42)
    return gltf.text()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/dev/bin")
    parser.add_argument("--set", choices=("dense", "knot"), default="dense")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--spp", default="16")
    parser.add_argument("--output", type=pathlib.Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "blobs.gltf").write_text(scene(args.set, args.count))
        output = args.output or folder / "blobs.exr"
        subprocess.run([args.bin / "tessera", "render", folder / "blobs.gltf", "-o", output,
                        "--force", "--report", folder / "report.json", "--size", args.size,
                        "--spp", args.spp, "--aov", "traversal-cost", "--background",
                        "0.02,0.025,0.04", "--threads", "1"], check=True)
        report = json.loads((folder / "report.json").read_text())
    rays, seconds = report["accelerator"]["rays"], report["cpu_seconds"]
    print(f"{args.set}, {args.count} blobs: {rays} rays in {seconds:.2f} CPU seconds: "
          f"{rays / seconds:.0f} rays/s; loading and building {report['load_seconds']:.2f} s")


if __name__ == "__main__":
    main()
