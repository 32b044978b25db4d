#!/usr/bin/env python3
"""Writes the project's own scenes: tests/scenes/*.gltf, each one file with data URIs.

    make_scenes.py            writes them
    make_scenes.py --check    exits with 1 if a file differs from what would be written

Only arithmetic decides the bytes: coordinates are rounded to six decimals, so that the last bit
of a machine's sin() does not show.
"""

import base64
import json
import math
import struct
import sys
import zlib
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
FLOAT, UNSIGNED_SHORT = 5126, 5123
VERTICES, INDICES = 34962, 34963


class Gltf:
    """A glTF document with one buffer that grows as meshes are added."""

    def __init__(self):
        self.bytes = bytearray()
        self.doc = {
            "asset": {"version": "2.0", "generator": "Tessera tests/scenes/make_scenes.py"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "materials": [],
            "accessors": [],
            "bufferViews": [],
            "buffers": [],
        }

    def add(self, kind, item):
        """Appends to one of the document's arrays and returns the index."""
        self.doc.setdefault(kind, []).append(item)
        return len(self.doc[kind]) - 1

    def view(self, payload, target=None):
        while len(self.bytes) % 4:
            self.bytes.append(0)
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(payload)}
        if target:
            view["target"] = target
        self.bytes += payload
        return self.add("bufferViews", view)

    def floats(self, rows, kind, bounds=False, target=VERTICES):
        flat = [value for row in rows for value in row]
        packed = struct.pack(f"<{len(flat)}f", *flat)
        accessor = {"bufferView": self.view(packed, target), "componentType": FLOAT,
                    "count": len(rows), "type": kind}
        if bounds:
            exact = struct.unpack(f"<{len(flat)}f", packed)
            width = len(rows[0])
            accessor["min"] = [min(exact[k::width]) for k in range(width)]
            accessor["max"] = [max(exact[k::width]) for k in range(width)]
        return self.add("accessors", accessor)

    def mesh(self, shape, material):
        """Adds a mesh of one primitive; `shape` is what quad(), sphere() and torus() return."""
        positions, normals, uvs, triangles = shape
        flat = [index for triangle in triangles for index in triangle]
        primitive = {
            "attributes": {"POSITION": self.floats(positions, "VEC3", bounds=True),
                           "NORMAL": self.floats(normals, "VEC3"),
                           "TEXCOORD_0": self.floats(uvs, "VEC2")},
            "indices": self.add("accessors", {
                "bufferView": self.view(struct.pack(f"<{len(flat)}H", *flat), INDICES),
                "componentType": UNSIGNED_SHORT, "count": len(flat), "type": "SCALAR"}),
            "material": material,
        }
        return self.add("meshes", {"primitives": [primitive]})

    def node(self, **item):
        index = self.add("nodes", item)
        self.doc["scenes"][0]["nodes"].append(index)
        return index

    def texture(self, png):
        uri = "data:image/png;base64," + base64.b64encode(png).decode()
        image = self.add("images", {"uri": uri})
        return self.add("textures", {"source": image})

    def shape(self, kind, material, node=None, **dimensions):
        """A node with an analytic shape (TESSERA_shape); `node` has its transform."""
        self.use("TESSERA_shape")
        return {**(node or {}), "extensions": {"TESSERA_shape": {
            "type": kind, "material": material, **dimensions}}}

    def csg(self, operation, *operands, **node):
        """Adds a node with a solid (TESSERA_csg) of nodes that are already made."""
        self.use("TESSERA_csg")
        children = [operand if isinstance(operand, int) else self.add("nodes", operand)
                    for operand in operands]
        return self.add("nodes", {**node, "children": children, "extensions": {
            "TESSERA_csg": {"operation": operation}}})

    def blobs(self, material, *elements, threshold=0.25, **node):
        """A node with blobs (TESSERA_blobs): (center, radius or radii, strength) each."""
        self.use("TESSERA_blobs")
        return {**node, "extensions": {"TESSERA_blobs": {
            "material": material, "threshold": threshold, "elements": [
                {"center": list(center), "radii" if isinstance(size, tuple) else "radius": size,
                 "strength": strength} for center, size, strength in elements]}}}

    def terrain(self, pattern, material, size, ramp=None, **more):
        """A node's TESSERA_terrain; with a ramp, `material` is coloured by height."""
        self.use("TESSERA_terrain")
        form = {"pattern": pattern, "size": list(size), "scale": 1, "offset": [0, 0], "seed": 0,
                "octaves": 8, **more}
        if ramp:  # the same pattern as a texture: u and v run over the terrain
            self.use("TESSERA_texture")
            scale = [form["scale"] * x for x in size]
            texture = self.add("textures", {"extensions": {"TESSERA_texture": {
                "pattern": pattern, "space": "uv", "dimensions": 2, "seed": form["seed"],
                "octaves": form["octaves"], "scale": [*scale, 1],
                "offset": [*(o - s / 2 for o, s in zip(form["offset"], scale)), 0],
                "ramp": [{"at": at, "color": [*color, 1]} for at, color in ramp]}}})
            material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
        return {"TESSERA_terrain": {**form, "material": self.add("materials", material)}}

    def use(self, *extensions):
        self.doc["extensionsUsed"] = sorted({*self.doc.get("extensionsUsed", []), *extensions})

    def text(self):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.bytes).decode()
        if self.bytes:
            self.doc["buffers"] = [{"uri": uri, "byteLength": len(self.bytes)}]
        return json.dumps({k: v for k, v in self.doc.items() if v or k == "scene"}, indent=1) + "\n"


def rounded(*values):
    return [round(value, 6) + 0.0 for value in values]


def quad(origin, edge_u, edge_v, repeat=1):
    """A parallelogram; front side towards edge_u x edge_v."""
    normal = [edge_u[1] * edge_v[2] - edge_u[2] * edge_v[1],
              edge_u[2] * edge_v[0] - edge_u[0] * edge_v[2],
              edge_u[0] * edge_v[1] - edge_u[1] * edge_v[0]]
    length = math.sqrt(sum(x * x for x in normal))
    normal = rounded(*(x / length for x in normal))
    corners, uvs = [], []
    for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
        corners.append(rounded(*(o + u * a + v * b for o, a, b in zip(origin, edge_u, edge_v))))
        uvs.append([float(u * repeat), float((1 - v) * repeat)])
    return corners, [normal] * 4, uvs, [(0, 1, 2), (0, 2, 3)]


def grid(rows, columns, point):
    """A closed surface over (u, v) in [0,1]^2; point(u, v) gives position and normal."""
    positions, normals, uvs = [], [], []
    for row in range(rows + 1):
        for column in range(columns + 1):
            u, v = column / columns, row / rows
            position, normal = point(u, v)
            positions.append(rounded(*position))
            normals.append(rounded(*normal))
            uvs.append(rounded(u, v))
    triangles = []
    for row in range(rows):
        for column in range(columns):
            a = row * (columns + 1) + column
            b = a + columns + 1
            for triangle in ((a, a + 1, b), (a + 1, b + 1, b)):
                if len({tuple(positions[i]) for i in triangle}) == 3:  # none of no area at the poles
                    triangles.append(triangle)
    return positions, normals, uvs, triangles


def sphere(radius, rows):
    def point(u, v):
        theta, phi = math.pi * v, 2 * math.pi * u
        normal = (math.sin(theta) * math.cos(phi), math.cos(theta),
                  -math.sin(theta) * math.sin(phi))
        return [radius * x for x in normal], normal
    return grid(rows, 2 * rows, lambda u, v: flipped(point, u, v))


def torus(major, minor, rows):
    def point(u, v):
        around, across = 2 * math.pi * u, 2 * math.pi * v
        normal = (math.cos(across) * math.cos(around), math.sin(across),
                  math.cos(across) * math.sin(around))
        centre = (major * math.cos(around), 0, major * math.sin(around))
        return [c + minor * n for c, n in zip(centre, normal)], normal
    return grid(rows, 2 * rows, lambda u, v: flipped(point, u, v))


def flipped(point, u, v):
    """Runs v the other way, so that grid()'s triangles wind counter-clockwise seen from outside."""
    return point(u, 1 - v)


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
    """A floor of tesserae: 16 x 16 small stones of 8 x 8 pixels with joints between them."""
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


def look_at(eye, target):
    """Rotation quaternion (x, y, z, w) of a camera that looks from eye to target, up near +Y."""
    back = [e - t for e, t in zip(eye, target)]
    length = math.sqrt(sum(x * x for x in back))
    back = [x / length for x in back]
    yaw = math.atan2(back[0], back[2])
    pitch = -math.asin(back[1])
    sy, cy, sp, cp = math.sin(yaw / 2), math.cos(yaw / 2), math.sin(pitch / 2), math.cos(pitch / 2)
    return rounded(cy * sp, sy * cp, -sy * sp, cy * cp)


def room(gltf, floor):
    """Five walls of a box 4 x 3 x 4 m, open towards +Z, and a lamp of 1.2 x 1.2 m under its ceiling."""
    white = gltf.add("materials", plain(0.75, 0.73, 0.7))
    red = gltf.add("materials", plain(0.62, 0.12, 0.08))
    blue = gltf.add("materials", plain(0.1, 0.2, 0.5))
    gltf.use("KHR_materials_emissive_strength")
    lamp = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.86, 0.66], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 16}}))
    for shape, material in (
            (quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), floor),
            (quad((-2, 3, -2), (4, 0, 0), (0, 0, 4)), white),
            (quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)), white),
            (quad((-2, 0, 2), (0, 0, -4), (0, 3, 0)), red),
            (quad((2, 0, -2), (0, 0, 4), (0, 3, 0)), blue),
            (quad((-0.6, 2.99, -0.6), (1.2, 0, 0), (0, 0, 1.2)), lamp)):
        gltf.node(mesh=gltf.mesh(shape, material))


def camera(gltf, eye, target, yfov):
    index = gltf.add("cameras", {"type": "perspective",
                                 "perspective": {"yfov": yfov, "znear": 0.01}})
    gltf.node(camera=index, translation=list(eye), rotation=look_at(eye, target))


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
    """What same-bits tests render: many features, few triangles."""
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


def materials():
    """One thing for each extension that adds a layer or a lobe to the material."""
    gltf = Gltf()
    floor = gltf.add("materials", plain(0.4, 0.4, 0.42))
    room(gltf, floor)

    def made_of(extension, content, base):
        gltf.use(extension)
        return gltf.add("materials", {**base, "extensions": {**base.get("extensions", {}),
                                                             extension: content}})

    lacquer = made_of("KHR_materials_clearcoat", {"clearcoatFactor": 1},
                      {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.02, 0.02, 1],
                                                "metallicFactor": 0.5, "roughnessFactor": 0.6}})
    brushed = made_of("KHR_materials_anisotropy", {"anisotropyStrength": 0.8},
                      metal(0.8, 0.78, 0.75, 0.25))
    velvet = made_of("KHR_materials_sheen",
                     {"sheenColorFactor": [0.9, 0.5, 0.6], "sheenRoughnessFactor": 0.35},
                     plain(0.1, 0.01, 0.04))
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    crystal = made_of("KHR_materials_dispersion", {"dispersion": 2}, glass([1, 1, 1]))
    oil = made_of("KHR_materials_iridescence",
                  {"iridescenceFactor": 1, "iridescenceIor": 1.5,
                   "iridescenceThicknessMaximum": 420}, metal(0.5, 0.5, 0.5, 0.15))
    paper = made_of("KHR_materials_diffuse_transmission",
                    {"diffuseTransmissionFactor": 0.6,
                     "diffuseTransmissionColorFactor": [1, 0.8, 0.45]},
                    plain(0.9, 0.85, 0.7, doubleSided=True))
    ball = sphere(0.5, 24)
    for material, place in ((lacquer, (-1.3, 0.5, 0.1)), (velvet, (0, 0.5, 0.1)),
                            (oil, (1.3, 0.5, 0.1)), (crystal, (0.75, 0.5, 1.2))):
        gltf.node(mesh=gltf.mesh(ball, material), translation=list(place))
    gltf.node(mesh=gltf.mesh(torus(0.4, 0.2, 24), brushed), translation=[-0.7, 0.25, 1.2])
    gltf.node(mesh=gltf.mesh(quad((-1.2, 1.3, -0.9), (2.4, 0, 0), (0, 1.3, 0.3)), paper))
    bulb = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.9, 0.8], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 30}}))
    gltf.node(mesh=gltf.mesh(sphere(0.12, 12), bulb), translation=[0, 1.9, -1.5])
    camera(gltf, (0, 1.62, 6.6), (0, 1.2, 0), 0.6)
    return gltf


def lit_square():
    """The smallest scene with a light: one diffuse square under one lamp, for tests of the farm."""
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
    """lit_square with a texture that is not there: refused before the first unit."""
    gltf = lit_square()
    image = gltf.add("images", {"uri": "not-here.png"})
    texture = gltf.add("textures", {"source": image})
    gltf.doc["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": texture}
    return gltf


def joined(*shapes):
    """Several shapes as one."""
    positions, normals, uvs, triangles = [], [], [], []
    for shape in shapes:
        first = len(positions)
        positions += shape[0]
        normals += shape[1]
        uvs += shape[2]
        triangles += [tuple(first + index for index in triangle) for triangle in shape[3]]
    return positions, normals, uvs, triangles


def stadium():
    """The "teapot in a stadium" (a ring, here): a dense mesh of a metre in a field of 400 m, one
    mesh of both, which a uniform grid cannot tell apart. For `inspect --accelerators`."""
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


def lens():
    """Depth of field: balls on a table, focused on the middle one, lamps far behind."""
    gltf = Gltf()
    gltf.use("TESSERA_camera")
    wood = gltf.add("materials", plain(0.35, 0.22, 0.14))
    night = gltf.add("materials", plain(0.02, 0.02, 0.04))
    gltf.node(mesh=gltf.mesh(quad((-6, 0, 3), (12, 0, 0), (0, 0, -14)), wood))
    gltf.node(mesh=gltf.mesh(quad((-9, -1, -11), (18, 0, 0), (0, 9, 0)), night))
    colors = ((0.8, 0.2, 0.15), (0.85, 0.65, 0.2), (0.25, 0.6, 0.3), (0.2, 0.35, 0.75))
    balls = [gltf.mesh(sphere(0.35, 16), gltf.add("materials", plain(*color))) for color in colors]
    focus = None
    for k, ball in enumerate(balls):
        place = rounded(-1.05 + 0.7 * k, 0.35, 1.6 - 1.5 * k)
        index = gltf.node(mesh=ball, translation=place)
        focus = index if k == 1 else focus
    lamp = gltf.mesh(sphere(0.05, 8), gltf.add("materials", {
        "emissiveFactor": [1, 0.8, 0.5],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 60}}}))
    gltf.use("KHR_materials_emissive_strength", "KHR_lights_punctual")
    for k in range(9):
        gltf.node(mesh=lamp, translation=rounded(-4 + k, 1.1 + 0.9 * ((k * 5) % 3), -9 - (k % 2)))
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 90}]}}
    gltf.node(translation=[2, 5, 4], extensions={"KHR_lights_punctual": {"light": 0}})
    camera = gltf.add("cameras", {
        "type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.01},
        "extensions": {"TESSERA_camera": {
            "lookAt": {"position": [0, 1.1, 5], "target": [0, 0.5, 0]},
            "lens": {"fNumber": 0.3, "sensorHeight": 0.05, "focusNode": focus, "blades": 6,
                     "rim": {"distance": 0.2, "radius": 0.19}}}}})
    gltf.node(camera=camera)
    return gltf


def screens():
    """One room, seen by a camera of each projection of TESSERA_camera."""
    gltf = Gltf()
    gltf.use("TESSERA_camera")
    room(gltf, gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": gltf.texture(png(64, 64, mosaic))},
        "metallicFactor": 0, "roughnessFactor": 0.5}}))
    gltf.node(mesh=gltf.mesh(quad((2, 0, 2), (-4, 0, 0), (0, 3, 0)),
                             gltf.add("materials", plain(0.3, 0.45, 0.3))))
    gold = gltf.add("materials", metal(1.0, 0.72, 0.32, 0.6))
    clay = gltf.add("materials", plain(0.7, 0.3, 0.2))
    gltf.node(mesh=gltf.mesh(torus(0.5, 0.16, 12), gold), translation=[-1, 1, -1])
    ball = gltf.mesh(sphere(0.4, 12), clay)
    for x, z in ((1, -1), (1.2, 1.2), (-1.2, 1.3)):
        gltf.node(mesh=ball, translation=[x, 0.4, z])
    plane = {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.01}}
    flat = {"type": "orthographic",
            "orthographic": {"xmag": 1.9, "ymag": 1.5, "znear": 0.01, "zfar": 20}}
    middle = {"position": [0, 1.3, 0], "target": [0, 1.3, -1]}
    back = {"position": [0, 1.3, 1.9], "target": [0, 1.3, -1]}
    for name, base, says in (
            ("spherical", plane, {"projection": "spherical", "lookAt": middle}),
            ("cylindrical", plane, {"projection": "cylindrical", "verticalAngle": 1.7,
                                    "lookAt": middle}),
            ("equidistant", plane, {"projection": "equidistant", "lookAt": back}),
            ("equisolid", plane, {"projection": "equisolid", "angle": 5.2, "lookAt": middle}),
            ("off-axis", plane, {"lookAt": back, "frustum": {
                "left": -0.8, "right": 0.8, "bottom": -0.35, "top": 0.75, "near": 0.8}}),
            ("oblique", flat, {"direction": [0.35, -0.35, -1], "lookAt": {
                "position": [0, 1.5, 1.99], "target": [0, 1.5, -1]}})):
        index = gltf.add("cameras", {"name": name, **base, "extensions": {"TESSERA_camera": says}})
        gltf.node(camera=index)
    return gltf


def textures():
    """A panel for each pattern of TESSERA_texture, and a ball with a bump of noise."""
    gltf = Gltf()
    gltf.use("TESSERA_texture", "KHR_lights_punctual", "KHR_animation_pointer")
    patterns = (
        ("noise", {"scale": [6, 6, 6]}),
        ("fbm", {"scale": [3, 3, 3]}),
        ("turbulence", {"scale": [3, 3, 3]}),
        ("ridged", {"scale": [3, 3, 3]}),
        ("marble", {"scale": [2, 2, 2], "distortion": 1.5, "ramp": [
            {"at": 0, "color": [0.12, 0.1, 0.1, 1]}, {"at": 0.25, "color": [0.55, 0.5, 0.48, 1]},
            {"at": 1, "color": [0.9, 0.88, 0.85, 1]}]}),
        ("wood", {"scale": [8, 2, 8], "distortion": 0.4, "octaves": 3, "ramp": [
            {"at": 0, "color": [0.2, 0.08, 0.03, 1]}, {"at": 1, "color": [0.6, 0.35, 0.15, 1]}]}),
        ("clouds", {"scale": [2, 2, 2], "ramp": [
            {"at": 0, "color": [0.12, 0.3, 0.7, 1]}, {"at": 1, "color": [0.95, 0.95, 0.95, 1]}]}),
        ("wornMetal", {"scale": [3, 3, 3], "ramp": [
            {"at": 0, "color": [0.35, 0.12, 0.05, 1]}, {"at": 1, "color": [0.75, 0.75, 0.78, 1]}]}),
        ("fire", {"scale": [1, 1, 1], "distortion": 2, "dimensions": 4, "time": 0, "ramp": [
            {"at": 0, "color": [0, 0, 0, 1]}, {"at": 0.35, "color": [0.5, 0.02, 0, 1]},
            {"at": 0.7, "color": [1, 0.45, 0.02, 1]}, {"at": 1, "color": [1, 0.95, 0.6, 1]}]}),
    )
    for k, (pattern, more) in enumerate(patterns):
        texture = gltf.add("textures", {"extensions": {"TESSERA_texture": {
            "pattern": pattern, "seed": k, **more}}})
        info = {"index": texture}
        look = {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.6}}
        if pattern == "fire":
            fire = texture
            look.update(emissiveFactor=[1, 1, 1], emissiveTexture=info)
            look["pbrMetallicRoughness"]["baseColorFactor"] = [0, 0, 0, 1]
        else:
            look["pbrMetallicRoughness"]["baseColorTexture"] = info
        panel = gltf.mesh(quad((-0.48, 0, 0), (0.96, 0, 0), (0, 0.96, 0)), gltf.add("materials", look))
        gltf.node(mesh=panel, translation=rounded(-2 + k % 5, 1.02 if k < 5 else 0, 0))
    bump = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "turbulence", "scale": [5, 5, 5], "octaves": 4, "bumpHeight": 0.06}}})
    orange = gltf.add("materials", {
        "pbrMetallicRoughness": {"baseColorFactor": [0.85, 0.35, 0.08, 1], "metallicFactor": 0,
                                 "roughnessFactor": 0.35},
        "normalTexture": {"index": bump}})
    gltf.node(mesh=gltf.mesh(sphere(0.45, 32), orange), translation=[2, 0.48, 0])
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    moments = gltf.floats([[0.0], [1.0]], "SCALAR", target=None)
    gltf.add("animations", {
        "name": "burn", "samplers": [{"input": times, "output": moments}],
        "channels": [{"sampler": 0, "target": {"path": "pointer", "extensions": {
            "KHR_animation_pointer": {
                "pointer": f"/textures/{fire}/extensions/TESSERA_texture/time"}}}}]})
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "directional", "intensity": 3.14}]}}
    gltf.node(rotation=rounded(-0.22, 0.17, 0, math.sqrt(1 - 0.22**2 - 0.17**2)),
              extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0, 1, 5), (0, 1, 0), 0.44)
    return gltf


def shapes():
    """Every analytic shape once; a sphere is the lamp."""
    gltf = Gltf()
    stones = gltf.texture(png(128, 128, mosaic))
    floor = gltf.add("materials", plain(0.5, 0.5, 0.52))
    room(gltf, floor)
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    tiled = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": stones}, "metallicFactor": 0, "roughnessFactor": 0.5}})
    gold = gltf.add("materials", metal(0.95, 0.75, 0.35, 0.2))
    green = gltf.add("materials", plain(0.2, 0.5, 0.25, doubleSided=True))
    blue = gltf.add("materials", glass([0.6, 0.75, 0.95]))
    bulb = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.9, 0.8], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 40}}))
    for kind, material, place, dimensions in (
            ("sphere", tiled, (-1.45, 0.4, 0.2), {"radius": 0.4}),
            ("ellipsoid", gold, (-0.5, 0.3, 0.2), {"radii": [0.45, 0.3, 0.25]}),
            ("box", tiled, (0.45, 0.3, 0.2), {"size": [0.6, 0.6, 0.6]}),
            ("cylinder", tiled, (1.4, 0.4, 0.2), {"radius": 0.3, "height": 0.8}),
            ("torus", blue, (-1.2, 0.13, 1.3), {"radius": 0.3, "tube": 0.13}),
            ("cone", gold, (-0.4, 0.3, 1.3), {"radius": 0.25, "height": 0.6}),
            ("paraboloid", green, (0.4, 0.2, 1.3),
             {"radius": 0.3, "height": 0.4, "capped": False}),
            ("sphere", blue, (1.15, 0.3, 1.3), {"radius": 0.3}),
            ("hyperboloid", green, (-1.3, 1.5, -1.2),
             {"waist": 0.2, "radius": 0.4, "height": 1, "capped": False}),
            ("two-sheet-hyperboloid", gold, (-0.2, 1.5, -1.2),
             {"gap": 0.2, "radius": 0.4, "height": 1}),
            ("quadric", tiled, (0.9, 1.5, -1.2),
             {"coefficients": [1, 0, -1, 0, 0, 0, 0, -0.5, 0, 0], "min": [-0.4, -0.5, -0.4],
              "max": [0.4, 0.3, 0.4]}),
            ("sphere", bulb, (1.6, 2.2, -1), {"radius": 0.12})):
        gltf.node(**gltf.shape(kind, material, {"translation": list(place)}, **dimensions))
    gltf.node(**gltf.shape("disc", gold, {"translation": [-1.2, 0.9, -1.9],
                                          "rotation": [0.7071068, 0, 0, 0.7071068]}, radius=0.35))
    gltf.node(**gltf.shape("rectangle", tiled, {"translation": [1.2, 0.9, -1.9],
                                                "rotation": [0.7071068, 0, 0, 0.7071068]},
                           size=[0.8, 0.6]))
    camera(gltf, (0, 1.62, 6.6), (0, 1.2, 0), 0.6)
    return gltf


def csg():
    """Solids by union, intersection, subtraction and xor; a lens, a die, a mesh that is cut."""
    gltf = Gltf()
    floor = gltf.add("materials", plain(0.5, 0.5, 0.52))
    room(gltf, floor)
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume")
    red = gltf.add("materials", plain(0.7, 0.1, 0.08))
    ivory = gltf.add("materials", plain(0.8, 0.75, 0.6))
    gold = gltf.add("materials", metal(0.95, 0.75, 0.35, 0.2))
    sea = gltf.add("materials", glass([0.5, 0.85, 0.8]))

    def ball(radius, material, x, y, z):
        return gltf.shape("sphere", material, {"translation": [x, y, z]}, radius=radius)

    def block(size, material, **node):
        return gltf.shape("box", material, node, size=size)

    def rod(radius, height, material, **node):
        return gltf.shape("cylinder", material, node, radius=radius, height=height)

    on_side = [0, 0, 0.7071068, 0.7071068]
    to_front = [0.7071068, 0, 0, 0.7071068]
    roots = [
        # A lens: what two balls share.
        gltf.csg("intersection", ball(0.8, sea, 0, 0, 0.65), ball(0.8, sea, 0, 0, -0.65),
                 translation=[0.9, 0.55, 1.2]),
        # A rounded cube with three holes, and another surface in them.
        gltf.csg("subtraction",
                 gltf.csg("intersection", block([0.9, 0.9, 0.9], ivory), ball(0.6, ivory, 0, 0, 0)),
                 gltf.csg("union", rod(0.25, 2, red), rod(0.25, 2, red, rotation=on_side),
                          rod(0.25, 2, red, rotation=to_front)),
                 translation=[-0.9, 0.47, 0.2], rotation=[0, 0.3007058, 0, 0.953717]),
        # Faces that coincide: two blocks as one.
        gltf.csg("union", block([0.5, 0.4, 0.4], sea), block([0.5, 0.4, 0.4], sea,
                                                             translation=[0, 0.4, 0]),
                 translation=[1.4, 0.22, -0.6]),
        # Inside one of two only.
        gltf.csg("xor", block([0.6, 0.5, 0.4], gold), ball(0.36, red, 0.2, 0.15, 0.1),
                 translation=[0.25, 0.27, -0.4]),
        # A closed mesh, cut by a shape.
        gltf.csg("subtraction", {"mesh": gltf.mesh(torus(0.4, 0.18, 24), gold)},
                 block([0.5, 1, 0.5], red, translation=[0.35, 0, 0.35]),
                 translation=[-0.5, 0.2, 1.3]),
    ]
    gltf.doc["scenes"][0]["nodes"] += roots
    camera(gltf, (0, 1.62, 6.6), (0, 1.0, 0), 0.55)
    return gltf


def blobs():
    """Blobs that melt together, one with dents, in glass, cut by a box; one of them moves."""
    gltf = Gltf()
    room(gltf, gltf.add("materials", plain(0.5, 0.5, 0.52)))
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume",
             "KHR_animation_pointer")
    clay = gltf.add("materials", plain(0.75, 0.32, 0.18))
    gold = gltf.add("materials", metal(0.95, 0.75, 0.35, 0.15))
    sea = gltf.add("materials", glass([0.5, 0.85, 0.8]))
    ivory = gltf.add("materials", plain(0.8, 0.75, 0.6))
    green = gltf.add("materials", plain(0.2, 0.5, 0.25))
    # The neck of two, narrower from left to right until it parts.
    for k, apart in enumerate((1.2, 1.45, 1.58, 1.64)):
        half = apart * 0.35 / 2
        gltf.node(**gltf.blobs(clay, ((0, -half, 0), 0.35, 1), ((0, half, 0), 0.35, 1),
                               translation=rounded(-1.5 + k, 1.55, -1.2)))
    # A foot and a body of drops.
    drops = [((0, 0.06, 0), (0.8, 0.22, 0.6), 1)]
    for k in range(7):
        angle = k * 2.4
        drops.append((rounded(0.09 * k * math.cos(angle) * 0.6, 0.2 + 0.11 * k,
                              0.09 * k * math.sin(angle) * 0.6), round(0.36 - 0.022 * k, 3), 1))
    body = gltf.node(**gltf.blobs(green, *drops, translation=[-1.15, 0.08, 0.1]))
    # One ball, with dents.
    dents = [((0, 0, 0), 0.8, 1.5)]
    for k in range(12):
        y = 1 - (2 * k + 1) / 12
        r = math.sqrt(1 - y * y)
        dents.append((rounded(0.6 * r * math.cos(2.4 * k), 0.6 * y, 0.6 * r * math.sin(2.4 * k)),
                      0.24, -0.7))
    gltf.node(**gltf.blobs(gold, *dents, translation=[0.2, 0.62, 0.1]))
    gltf.node(**gltf.blobs(sea, ((-0.22, 0, 0), 0.42, 1), ((0.22, 0, 0.05), 0.42, 1),
                           ((0, 0.3, 0), 0.36, 1), translation=[-0.45, 0.31, 1.4]))
    # A part cut out, to show that it has an inside.
    half = gltf.csg(
        "subtraction",
        gltf.blobs(clay, ((-0.3, 0, 0), 0.6, 1), ((0.3, 0, 0), 0.6, 1), ((0, 0.35, 0), 0.5, 1)),
        gltf.shape("box", ivory, {"translation": [0.5, 0.55, 0.5]}, size=[1, 1, 1]),
        translation=[1.25, 0.42, 0.4], rotation=[0, -0.1305262, 0, 0.9914449])
    gltf.doc["scenes"][0]["nodes"].append(half)
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    moments = gltf.floats([drops[-1][0], [0.5, 1.2, 0]], "VEC3", target=None)
    gltf.add("animations", {
        "name": "let go", "samplers": [{"input": times, "output": moments}],
        "channels": [{"sampler": 0, "target": {"path": "pointer", "extensions": {
            "KHR_animation_pointer": {"pointer":
                f"/nodes/{body}/extensions/TESSERA_blobs/elements/{len(drops) - 1}/center"}}}}]})
    camera(gltf, (0, 1.62, 6.6), (0, 1.0, 0), 0.55)
    return gltf


ALPINE = ((0, (0.09, 0.11, 0.05)), (0.2, (0.16, 0.16, 0.08)), (0.34, (0.27, 0.23, 0.18)),
          (0.5, (0.34, 0.31, 0.29)), (0.56, (0.85, 0.87, 0.92)), (1, (0.95, 0.96, 1)))


def terrain():
    """Mountains, a cut block of hills, dunes; their detail is what the camera resolves."""
    gltf = Gltf()
    gltf.use("KHR_lights_punctual")
    eye, angle = (0, 3.2, 9), 0.003
    rock = plain(1, 1, 1)
    gltf.node(translation=[0, -0.6, -9], extensions=gltf.terrain(
        "ridged", rock, [26, 18], ALPINE, scale=0.2, height=5.2, seed=11, octaves=9,
        detail={"from": [eye[0], eye[1] + 0.6, eye[2] + 9], "angle": angle}))
    gltf.node(translation=[-2.1, 0.6, 4], rotation=[0, 0.2588190, 0, 0.9659258],
              extensions=gltf.terrain("fbm", plain(0.36, 0.42, 0.2), [2.2, 2.2], scale=0.9,
                                      height=1.3, depth=0.25, seed=5, octaves=7))
    gltf.node(translation=[2.1, 0.6, 4], rotation=[0, -0.2588190, 0, 0.9659258],
              extensions=gltf.terrain("waves", plain(0.72, 0.55, 0.34), [2.2, 2.2], scale=0.5,
                                      height=0.5, depth=0.25, octaves=3, gain=0.35,
                                      offset=[0.1, 0.2]))
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "directional", "intensity": 4, "color": [1, 0.86, 0.68]}]}}
    gltf.node(rotation=look_at((-5, 4, 4), (0, 0, 0)),
              extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, eye, (0, 1.35, 0), 0.55)
    return gltf


def optics():
    """Metals by their index above; rough diffuse beside Lambert's and exact beside Schlick below."""
    gltf = Gltf()
    gltf.use("TESSERA_material", "KHR_lights_punctual")
    room(gltf, gltf.add("materials", plain(0.4, 0.4, 0.42)))

    def ball(x, y, look, **optics):
        look["extensions"] = {"TESSERA_material": optics}
        gltf.node(mesh=gltf.mesh(sphere(0.34, 16), gltf.add("materials", look)),
                  translation=rounded(x, y, 0.4))
    for k, metal_name in enumerate(("gold", "silver", "copper", "aluminium", "iron")):
        ball(-1.5 + 0.75 * k, 1.5, metal(1, 1, 1, 0.2), conductor={"metal": metal_name})
    for k, rough in enumerate((0, 0.5, 1)):
        ball(-1.5 + 0.75 * k, 0.6, plain(0.75, 0.6, 0.5), diffuseRoughness=rough)
    for k, fresnel in enumerate(("schlick", "exact")):
        look = plain(0.05, 0.1, 0.3)
        look["pbrMetallicRoughness"]["roughnessFactor"] = 0.05
        ball(0.75 + 0.75 * k, 0.6, look, fresnel=fresnel)
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 40}]}}
    gltf.node(translation=[0.3, 1.5, 5], extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0, 1.3, 5.6), (0, 1.1, 0), 0.5)
    return gltf


def fog():
    """Shafts of light in fog; a cloud and smoke in bodies of their own; milk in glass; a tumbler
    whose water reaches into its wall, by priority."""
    gltf = Gltf()
    gltf.use("TESSERA_medium", "TESSERA_material", "TESSERA_texture", "KHR_lights_punctual",
             "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior")

    def even(scattering, absorption=(0, 0, 0), **more):
        return {"scattering": list(scattering), "absorption": list(absorption), **more}
    gltf.doc["scenes"][0]["extensions"] = {"TESSERA_medium": even(
        (0.035, 0.037, 0.04), anisotropy=0.55, center=[0, 1, 0], radius=6.2)}

    def solid(ior, priority, medium=None):
        look = plain(1, 1, 1)
        look["pbrMetallicRoughness"]["roughnessFactor"] = 0
        look["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": 1},
                              "KHR_materials_volume": {"thicknessFactor": 1},
                              "KHR_materials_ior": {"ior": ior},
                              "TESSERA_material": {"priority": priority}}
        if medium:
            look["extensions"]["TESSERA_medium"] = medium
        return gltf.add("materials", look)

    def filled(medium):
        return gltf.add("materials", {"name": "not seen itself",
                                      "extensions": {"TESSERA_medium": medium}})
    stone = gltf.add("materials", plain(0.45, 0.42, 0.38))
    wall = gltf.add("materials", plain(0.3, 0.3, 0.32))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, 6), (14, 0, 0), (0, 0, -11)), stone))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, -5), (14, 0, 0), (0, 6, 0)), wall))
    # Boards with gaps between, a lamp behind them, a panel beside the camera: both outside the fog,
    # where rays that pass near a lamp would be bright without bound.
    slats = [quad((-2.3 + 0.62 * k, 4.2, -2.6), (0.42, 0, 0), (0, 0, 3.2)) for k in range(8)]
    gltf.node(mesh=gltf.mesh(joined(*slats), wall))
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "spot", "intensity": 1500, "color": [1, 0.86, 0.66],
         "spot": {"innerConeAngle": 0.3, "outerConeAngle": 0.5}}]}}
    gltf.node(translation=[0.3, 7.9, -2.3], rotation=rounded(-0.6755902, 0, 0, 0.7372773),
              extensions={"KHR_lights_punctual": {"light": 0}})
    panel = gltf.add("materials", {"emissiveFactor": [0.62, 0.8, 1], "extensions": {
        "KHR_materials_emissive_strength": {"emissiveStrength": 7}}})
    gltf.use("KHR_materials_emissive_strength")
    gltf.node(mesh=gltf.mesh(quad((-5.5, 0.3, 5.2), (-2, 0, -3.4), (0, 3.4, 0)), panel))
    # A cloud: clumps of turbulence in a ball.
    clumps = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "fbm", "scale": [2.6, 2.6, 2.6], "octaves": 4, "seed": 5, "ramp": [
            {"at": 0.46, "color": [0, 0, 0, 1]}, {"at": 0.7, "color": [1, 1, 1, 1]}]}}})
    gltf.node(**gltf.shape("sphere", filled(even(
        (14, 14, 14), anisotropy=0.3, density={"texture": clumps})),
        {"translation": [-0.25, 1.75, -0.6]}, radius=0.85))
    # Smoke: a plume on a small lattice.
    size = (9, 13, 9)
    values = []
    for z in range(size[2]):
        for y in range(size[1]):
            for x in range(size[0]):
                height = y / (size[1] - 1)
                lean = 0.25 * math.sin(5 * height)
                r = math.hypot(x / 4 - 1 - lean, z / 4 - 1 - lean / 2)
                wide = 0.25 + 0.45 * height
                dense = max(0.0, 1 - (r / wide) ** 2) * min(1, 6 * height) * (1 - height)
                values.append(rounded(dense))
    lattice = gltf.floats(values, "SCALAR", target=None)
    gltf.node(**gltf.shape("box", filled(even(
        (9, 9, 9), (2, 2.2, 2.6), density={"grid": {"accessor": lattice, "size": list(size),
                                                  "min": [-0.5, -1, -0.5], "max": [0.5, 1, 0.5]}})),
        {"translation": [1.45, 1.01, -1.6]}, size=[1, 2, 1]))
    # Milk in a ball of glass.
    milk = solid(1.35, 0, even((9, 8.6, 7.6), (0.02, 0.06, 0.2), anisotropy=0.6))
    gltf.node(**gltf.shape("sphere", milk, {"translation": [-1.75, 0.5, 0.7]}, radius=0.5))
    # A tumbler of water that reaches 5 mm into the wall and the bottom.
    glassy = solid(1.5, 2)
    water = solid(1.333, 1, even((0.1, 0.2, 0.2), (2.4, 0.5, 0.25)))
    tumbler = gltf.csg(
        "subtraction",
        gltf.shape("cylinder", glassy, {"translation": [0, 0.5, 0]}, radius=0.36, height=1),
        gltf.shape("cylinder", glassy, {"translation": [0, 0.58, 0]}, radius=0.31, height=1),
        translation=[0.75, 0.001, 1.3])
    gltf.doc["scenes"][0]["nodes"].append(tumbler)
    gltf.node(**gltf.shape("cylinder", water, {"translation": [0.75, 0.376, 1.3]}, radius=0.315,
                           height=0.6))
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    denser = gltf.floats([[0.035, 0.037, 0.04], [0.12, 0.12, 0.12]], "VEC3", target=None)
    gltf.add("animations", {
        "name": "thicken", "samplers": [{"input": times, "output": denser}],
        "channels": [{"sampler": 0, "target": {"path": "pointer", "extensions": {
            "KHR_animation_pointer": {
                "pointer": "/scenes/0/extensions/TESSERA_medium/scattering"}}}}]})
    gltf.use("KHR_animation_pointer")
    camera(gltf, (0.2, 1.5, 6.2), (0.1, 1.25, 0), 0.62)
    return gltf


def turned(axis, *degrees):
    """Rotation quaternions about an axis."""
    return [rounded(*(math.sin(math.radians(d) / 2) * x for x in axis),
                    math.cos(math.radians(d) / 2)) for d in degrees]


def motion():
    """What a shutter blurs: a ball that flies, a wheel and a cut die that turn, a flag that changes
    (morph targets), a reed that bends (a skin), and cameras that stand and that move."""
    gltf = Gltf()
    gltf.use("TESSERA_camera", "KHR_materials_emissive_strength")
    grey = gltf.add("materials", plain(0.55, 0.55, 0.52))
    lamp = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.95, 0.85], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 12}}))
    spark = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.5, 0.15], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 40}}))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, 3), (14, 0, 0), (0, 0, -5)), grey))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, -1.5), (14, 0, 0), (0, 5, 0)), grey))
    gltf.node(mesh=gltf.mesh(quad((-1.5, 4, 0), (3, 0, 0), (0, 0, 2)), lamp))

    tracks = []  # of the one animation: node, path, type, keys at 0 s and 1 s

    def moves(node, path, *keys):
        tracks.append((node, path, {3: "VEC3", 4: "VEC4", 1: "SCALAR"}[len(keys[0])], keys))
        return node

    red = gltf.add("materials", plain(0.75, 0.12, 0.08))
    moves(gltf.node(mesh=gltf.mesh(sphere(0.28, 12), red)), "translation",
          [-3.1, 0.28, 1.4], [-0.1, 0.28, 1.4])
    steel = gltf.add("materials", metal(0.6, 0.62, 0.65, 0.3))
    spokes = [gltf.add("nodes", gltf.shape("cylinder", steel, {"rotation": turn},
                                           radius=0.04, height=1.2))
              for turn in turned((0, 0, 1), 0, 60, 120)]
    rim = gltf.add("nodes", {"mesh": gltf.mesh(torus(0.62, 0.07, 12), steel),
                             "rotation": turned((1, 0, 0), 90)[0]})
    glow = gltf.add("nodes", {"mesh": gltf.mesh(sphere(0.05, 6), spark), "translation": [0, 0.8, 0]})
    wheel = gltf.node(translation=[0.2, 0.9, -0.6], children=[rim, glow, *spokes])
    moves(wheel, "rotation", *turned((0, 0, 1), 0, 90, 180, 270, 360))
    gold = gltf.add("materials", metal(1.0, 0.72, 0.32, 0.35))
    die = gltf.csg("subtraction", gltf.shape("box", gold, size=[0.7, 0.7, 0.7]),
                   gltf.shape("sphere", red, radius=0.45), translation=[1.7, 0.65, 0.9])
    gltf.doc["scenes"][0]["nodes"].append(die)
    moves(die, "rotation", *turned((0, 1, 0), 0, 60, 120))

    def flag(u, v):
        return (1.1 * u, 0.7 * v, 0.12 * math.sin(2 * math.pi * u)), (0, 0, 1)

    cloth = gltf.add("materials", plain(0.1, 0.3, 0.65, doubleSided=True))
    rows = grid(6, 12, flag)
    mesh = gltf.mesh(rows, cloth)
    targets = [{"POSITION": gltf.floats([rounded(0, 0, -0.3 * math.sin(2 * math.pi * p[0]) + shift)
                                         for p in rows[0]], "VEC3", bounds=True)}
               for shift in (0, 0.25)]
    gltf.doc["meshes"][mesh]["primitives"][0]["targets"] = targets
    gltf.doc["meshes"][mesh]["weights"] = [0, 0]
    banner = gltf.node(mesh=mesh, translation=[-2.3, 1.5, 0])

    def reed(u, v):
        angle = 2 * math.pi * u
        normal = (math.cos(angle), 0, -math.sin(angle))
        return (0.07 * normal[0], 1.5 * v, 0.07 * normal[2]), normal

    green = gltf.add("materials", plain(0.15, 0.5, 0.12))
    rows = grid(12, 8, reed)
    mesh = gltf.mesh(rows, green)
    attributes = gltf.doc["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["WEIGHTS_0"] = gltf.floats(
        [rounded(1 - p[1] / 1.5, p[1] / 1.5, 0, 0) for p in rows[0]], "VEC4")
    attributes["JOINTS_0"] = gltf.add("accessors", {
        "bufferView": gltf.view(bytes([0, 1, 0, 0]) * len(rows[0]), VERTICES),
        "componentType": 5121, "count": len(rows[0]), "type": "VEC4"})
    root = gltf.node(translation=[2.6, 0, -0.3])
    tip = gltf.add("nodes", {})
    gltf.doc["nodes"][root]["children"] = [tip]
    moves(tip, "rotation", *turned((0, 0, 1), -50, 50))
    gltf.node(mesh=mesh, skin=gltf.add("skins", {"joints": [root, tip]}))

    samplers, channels = [], []
    for node, path, kind, keys in tracks:
        times = [[k / (len(keys) - 1)] for k in range(len(keys))]
        samplers.append({"input": gltf.floats(times, "SCALAR", bounds=True, target=None),
                         "output": gltf.floats(keys, kind, target=None)})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})

    shutter = {"shutter": {"open": -0.1, "close": 0.1}}
    view = {"lookAt": {"position": [0, 1.6, 6.5], "target": [0, 1.1, 0]}}
    lens = {"type": "perspective", "perspective": {"yfov": 0.55, "znear": 0.01}}
    gltf.node(name="still", camera=gltf.add("cameras", {
        **lens, "extensions": {"TESSERA_camera": {**view, **shutter}}}))
    panning = gltf.node(name="panning", camera=gltf.add("cameras", {
        **lens, "extensions": {"TESSERA_camera": {**view, **shutter}}}))
    for node, path, kind, keys, times in (
            (panning, "translation", "VEC3", [[-1.5, 0, 0], [1.5, 0, 0]], [[0.0], [1.0]]),
            (banner, "weights", "SCALAR", [[0.0], [0.0], [1.0], [1.0]], [[0.0], [1.0]])):
        samplers.append({"input": gltf.floats(times, "SCALAR", bounds=True, target=None),
                         "output": gltf.floats(keys, kind, target=None)})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": path}})
    gltf.add("animations", {"name": "all of it", "samplers": samplers, "channels": channels})
    return gltf


def main():
    check = "--check" in sys.argv[1:]
    stale = []
    for make in (quickstart, same_bits, materials, lit_square, missing_texture, stadium, lens,
                 screens, textures, optics, shapes, csg, blobs, fog, motion, terrain):
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
