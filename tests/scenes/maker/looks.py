"""Materials, and PNG files written without a library."""

import math
import struct
import zlib


def png(width, height, rgb):
    """An 8-bit PNG of rgb(x, y), without a library."""
    rows = b"".join(b"\0" + bytes(c for x in range(width) for c in rgb(x, y)) for y in range(height))

    def chunk(kind, payload):
        return (struct.pack(">I", len(payload)) + kind + payload +
                struct.pack(">I", zlib.crc32(kind + payload)))
    return (b"\x89PNG\r\n\x1a\n" +
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2 if len(rgb(0, 0)) == 3 else 6,
                                       0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def mosaic(x, y):
    """A mosaic: 16 x 16 stones of 8 x 8 pixels with joints between them."""
    if x % 8 == 0 or y % 8 == 0:
        return (58, 54, 50)
    column, row = x // 8, y // 8
    ring = int(math.sqrt((column - 7.5) ** 2 + (row - 7.5) ** 2))
    base = [(196, 88, 56), (222, 202, 164), (46, 92, 122), (222, 202, 164), (150, 160, 110)][ring % 5]
    shade = 0.82 + 0.18 * ((column * 7 + row * 13 + column * row * 3) % 11) / 10
    return tuple(int(value * shade) for value in base)


def plain(red, green, blue, **more):
    return {"pbrMetallicRoughness": {"baseColorFactor": [red, green, blue, 1],
                                     "metallicFactor": 0, "roughnessFactor": 1}, **more}


def metal(red, green, blue, roughness):
    return {"pbrMetallicRoughness": {"baseColorFactor": [red, green, blue, 1],
                                     "metallicFactor": 1, "roughnessFactor": roughness}}


def glass(tint):
    return {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0},
            "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
                           "KHR_materials_ior": {"ior": 1.5},
                           "KHR_materials_volume": {"thicknessFactor": 1,
                                                    "attenuationDistance": 1,
                                                    "attenuationColor": tint}}}


def solid(ior, priority, medium=None):
    """A material for the contents of a body, clear except for its medium; `priority` decides overlaps."""
    look = plain(1, 1, 1)
    look["pbrMetallicRoughness"]["roughnessFactor"] = 0
    look["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": 1},
                          "KHR_materials_volume": {"thicknessFactor": 1},
                          "KHR_materials_ior": {"ior": ior},
                          "TESSERA_material": {"priority": priority}}
    if medium:
        look["extensions"]["TESSERA_medium"] = medium
    return look
