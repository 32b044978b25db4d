"""Memory shared with a program of the test: settings that it reads and counters that it writes."""

import mmap
import pathlib
import struct


class Control:
    """FIELDS of a subclass are its 64-bit integers, in the program's order, initially 0."""
    FIELDS = ()

    def __init__(self, path):
        object.__setattr__(self, "path", str(path))
        pathlib.Path(path).write_bytes(bytes(8 * len(self.FIELDS)))
        with open(path, "r+b") as file:
            object.__setattr__(self, "memory", mmap.mmap(file.fileno(), 0))

    def __getattr__(self, name):
        return struct.unpack_from("q", self.memory, 8 * self.FIELDS.index(name))[0]

    def __setattr__(self, name, value):
        struct.pack_into("q", self.memory, 8 * self.FIELDS.index(name), value)
