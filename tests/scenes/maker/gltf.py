"""Builder of glTF documents with meshes, textures and TESSERA extensions."""

import base64
import json
import struct

FLOAT, UNSIGNED_SHORT = 5126, 5123
VERTICES, INDICES = 34962, 34963


def append_view(data, payload, target=None):
    """Appends `payload` to the bytes `data` of a buffer, aligned, and returns its buffer view."""
    data += b"\0" * (-len(data) % 4)
    view = {"buffer": 0, "byteOffset": len(data), "byteLength": len(payload)}
    if target:
        view["target"] = target
    data += payload
    return view


class Gltf:
    """A glTF document with one buffer, to which meshes are appended."""

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
        """Appends `item` to an array of the document and returns its index."""
        self.doc.setdefault(kind, []).append(item)
        return len(self.doc[kind]) - 1

    def view(self, payload, target=None):
        return self.add("bufferViews", append_view(self.bytes, payload, target))

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
        """Adds a node with an analytic shape (TESSERA_shape); `node` holds its transform."""
        self.use("TESSERA_shape")
        return {**(node or {}), "extensions": {"TESSERA_shape": {
            "type": kind, "material": material, **dimensions}}}

    def csg(self, operation, *operands, **node):
        """Adds a node with a solid (TESSERA_csg) of existing nodes."""
        self.use("TESSERA_csg")
        children = [operand if isinstance(operand, int) else self.add("nodes", operand)
                    for operand in operands]
        return self.add("nodes", {**node, "children": children, "extensions": {
            "TESSERA_csg": {"operation": operation}}})

    def blobs(self, material, *elements, threshold=0.25, **node):
        """Adds a node with blobs (TESSERA_blobs): (center, radius or radii, strength) each."""
        self.use("TESSERA_blobs")
        return {**node, "extensions": {"TESSERA_blobs": {
            "material": material, "threshold": threshold, "elements": [
                {"center": list(center), "radii" if isinstance(size, tuple) else "radius": size,
                 "strength": strength} for center, size, strength in elements]}}}

    def terrain(self, pattern, material, size, ramp=None, **more):
        """Adds TESSERA_terrain to a node; with a ramp, `material` is coloured by height."""
        self.use("TESSERA_terrain")
        form = {"pattern": pattern, "size": list(size), "scale": 1, "offset": [0, 0], "seed": 0,
                "octaves": 8, **more}
        if ramp:  # the same pattern as a texture: u and v run over the terrain
            self.use("TESSERA_texture")
            scale = [form["scale"] * x for x in size]
            texture = self.add("textures", {"extensions": {"TESSERA_texture": {
                "pattern": pattern, "space": "uv", "dimensions": 2, "seed": form["seed"],
                "octaves": form["octaves"],
                **({"gain": form["gain"]} if "gain" in form else {}), "scale": [*scale, 1],
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
