#!/usr/bin/env python3
"""Writes the invalid scenes of maker/invalid.py into a folder.

    make_invalid.py DIR       one file for each case
    make_invalid.py DIR N     every N-th mutation of valid documents
"""

import sys
from pathlib import Path

from maker.invalid import cases, mutations


def write(entries, folder):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "picture.bin").write_bytes(b"\0" * 20)
    for name, data in entries:
        kind = "glb" if data[:1] == b"g" else "gltf"
        (folder / f"{name}.{kind}").write_bytes(data)


def main():
    folder = Path(sys.argv[1])
    if len(sys.argv) == 2:
        write(cases(), folder)
    else:
        step = int(sys.argv[2])
        write((each for i, each in enumerate(mutations()) if i % step == 0), folder)


if __name__ == "__main__":
    main()
