#!/usr/bin/env python3
"""Draws before, after, reference and error maps of denoising side by side.

    docs/gallery/denoise.py OUT.png SCENE… [--spp N (16)] [--reference-spp N (1024)] [--size WxH (240x180)]
                            [--bin DIR (build/dev/bin)] [-- RENDER OPTIONS]

One row for each scene. Columns: raw, denoised, reference, and ten times the difference from the reference of raw and denoised.
"""

import argparse
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def paeth(a, b, c):
    p = a + b - c
    near = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))
    return near[2]


def read_png(path):
    """Width and rows of an 8-bit RGBA PNG, as bytes."""
    data, at, packed = path.read_bytes(), 8, b""
    width = height = 0
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b"IHDR":
            width, height = struct.unpack(">II", body[:8])
        elif kind == b"IDAT":
            packed += body
        at += 12 + size
    raw, stride = zlib.decompress(packed), 4 * width
    rows, above = [], bytes(stride)
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            left = row[i - 4] if i >= 4 else 0
            corner = above[i - 4] if i >= 4 else 0
            row[i] = (row[i] + (0, left, above[i], (left + above[i]) // 2,
                                paeth(left, above[i], corner))[kind]) & 255
        rows.append(bytes(row))
        above = row
    return width, rows


def write_png(path, width, rows):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    header = struct.pack(">IIBBBBB", width, len(rows), 8, 6, 0, 0, 0)
    packed = zlib.compress(b"".join(b"\0" + row for row in rows), 9)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", packed) +
                     chunk(b"IEND", b""))


def difference(rows, reference):
    """Ten times the difference of codes."""
    return [bytes(255 if i % 4 == 3 else min(255, 10 * abs(a - b))
                  for i, (a, b) in enumerate(zip(row, other)))
            for row, other in zip(rows, reference)]


def row_of(options, extra, scene):
    """Width of an image, and the rows of pixels of a scene's five images."""
    images = []
    with tempfile.TemporaryDirectory() as folder:
        for name, samples in (("raw", ["--spp", str(options.spp)]),
                              ("denoised", ["--spp", str(options.spp), "--denoise"]),
                              ("reference", ["--spp", str(options.reference_spp), "--seed", "9"])):
            file = Path(folder) / f"{name}.png"
            subprocess.run([options.bin / "tessera", "render", scene, "-o", file, "--size",
                            options.size, *samples, *extra], check=True)
            width, rows = read_png(file)
            images.append(rows)
    images += [difference(images[0], images[2]), difference(images[1], images[2])]
    return width, [b"".join(rows) for rows in zip(*images)]


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--reference-spp", type=int, default=1024)
    parser.add_argument("--size", default="240x180")
    parser.add_argument("--bin", type=Path, default=ROOT / "build/dev/bin")
    at = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    options, extra = parser.parse_args(sys.argv[1:at]), sys.argv[at + 1:]
    results = [row_of(options, extra, scene) for scene in options.scenes]
    write_png(options.output, 5 * results[0][0], sum((rows for _, rows in results), []))


if __name__ == "__main__":
    main()
