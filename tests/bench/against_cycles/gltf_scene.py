"""Reads the part of glTF that the scenes for Mitsuba and LuxCore use: triangles with normals, Lambert surfaces,
metals, smooth solid glass with Beer's law, emitters, points, directional lights and a perspective camera.

Anything else raises Unsupported, so that no comparison drops a feature silently.
"""

import dataclasses
import json
import math
import struct

import numpy

COMPONENTS = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Unsupported(Exception):
    """The file uses a feature that this reader does not know."""


@dataclasses.dataclass(frozen=True)
class Surface:
    kind: str  # "diffuse", "metal" or "glass"
    color: tuple = (1.0, 1.0, 1.0)
    roughness: float = 0.0
    ior: float = 1.5
    absorption: tuple = (0.0, 0.0, 0.0)  # per unit of length
    emission: tuple = (0.0, 0.0, 0.0)  # radiance from the front


@dataclasses.dataclass(frozen=True)
class Shape:
    """Triangles in world space."""

    positions: numpy.ndarray  # n x 3
    normals: numpy.ndarray  # n x 3
    triangles: numpy.ndarray  # m x 3
    surface: Surface


@dataclasses.dataclass(frozen=True)
class Light:
    kind: str  # "point" (color in W/sr) or "directional" (color in W/m2)
    color: tuple
    position: numpy.ndarray
    direction: numpy.ndarray  # of the light's travel


@dataclasses.dataclass(frozen=True)
class Scene:
    shapes: list
    lights: list
    camera: numpy.ndarray  # camera to world, 4 x 4; looks along -z
    yfov: float


def rotation(quaternion):
    x, y, z, w = quaternion
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def matrix(node):
    """Returns the transform of a node to its parent."""
    if "matrix" in node:
        return numpy.array(node["matrix"], float).reshape(4, 4).T
    made = numpy.eye(4)
    made[:3, :3] = rotation(node.get("rotation", (0, 0, 0, 1))) * numpy.array(node.get("scale", (1, 1, 1)), float)
    made[:3, 3] = node.get("translation", (0, 0, 0))
    return made


def surface_of(material):
    """Returns the Surface of a glTF material as scenes.py leaves it."""
    known = {"specular", "transmission", "volume", "ior", "emissive_strength"}
    extensions = {name.removeprefix("KHR_materials_"): value for name, value in material.get("extensions", {}).items()}
    factors = dict(material.get("pbrMetallicRoughness", {}))
    textured = any(name.endswith("Texture") for name in (*material, *factors))
    if textured or not set(extensions) <= known or material.get("alphaMode", "OPAQUE") != "OPAQUE":
        raise Unsupported(f"material {material.get('name')}")
    color, roughness = tuple(factors.get("baseColorFactor", (1, 1, 1, 1))[:3]), factors.get("roughnessFactor", 1)
    strength = extensions.get("emissive_strength", {}).get("emissiveStrength", 1)
    emission = tuple(strength * e for e in material.get("emissiveFactor", (0, 0, 0)))
    if max(emission) > 0 and material.get("doubleSided"):
        raise Unsupported("emitter with two sides")
    metallic = factors.get("metallicFactor", 1)
    if extensions.get("transmission", {}).get("transmissionFactor", 0) == 1 and metallic == 0 and roughness == 0:
        volume = extensions.get("volume", {})
        if volume.get("thicknessFactor", 0) == 0 or color != (1, 1, 1):
            raise Unsupported("thin or coloured glass")
        distance = volume.get("attenuationDistance", math.inf)
        absorption = tuple(-math.log(c) / distance for c in volume.get("attenuationColor", (1, 1, 1)))
        return Surface("glass", ior=extensions.get("ior", {}).get("ior", 1.5), absorption=absorption)
    if metallic == 1:
        return Surface("metal", color, roughness, emission=emission)
    if metallic == 0 and extensions.get("specular", {}).get("specularFactor", 1) == 0:
        return Surface("diffuse", color, emission=emission)
    raise Unsupported(f"material {material.get('name')}")


class Reader:
    def __init__(self, data):
        if data[:4] != b"glTF":
            raise Unsupported("only .glb is read")
        (length,) = struct.unpack_from("<I", data, 12)
        self.gltf = json.loads(data[20 : 20 + length])
        self.binary = data[28 + length :]
        self.scene = Scene([], [], None, 0)

    def array(self, index):
        accessor = self.gltf["accessors"][index]
        if "sparse" in accessor or accessor.get("normalized"):
            raise Unsupported("sparse or normalized accessor")
        view = self.gltf["bufferViews"][accessor["bufferView"]]
        if "byteStride" in view or view["buffer"] != 0:
            raise Unsupported("interleaved or second buffer")
        width = WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        values = numpy.frombuffer(self.binary, COMPONENTS[accessor["componentType"]], accessor["count"] * width, start)
        return values.reshape(-1, width)

    def add_mesh(self, mesh, world):
        mirrored = numpy.linalg.det(world[:3, :3]) < 0
        for primitive in mesh["primitives"]:
            if primitive.get("mode", 4) != 4 or "targets" in primitive or "indices" not in primitive:
                raise Unsupported("primitive")
            positions = self.array(primitive["attributes"]["POSITION"]) @ world[:3, :3].T + world[:3, 3]
            normals = self.array(primitive["attributes"]["NORMAL"]) @ numpy.linalg.inv(world[:3, :3])
            normals /= numpy.linalg.norm(normals, axis=1, keepdims=True)
            triangles = self.array(primitive["indices"]).reshape(-1, 3)
            material = self.gltf["materials"][primitive["material"]]
            self.scene.shapes.append(Shape(positions, normals, triangles[:, ::-1] if mirrored else triangles,
                                           surface_of(material)))

    def add_light(self, light, world):
        if light["type"] not in ("point", "directional") or "range" in light:
            raise Unsupported("light")
        color = tuple(light.get("intensity", 1) * c for c in light.get("color", (1, 1, 1)))
        direction = -world[:3, 2] / numpy.linalg.norm(world[:3, 2])
        self.scene.lights.append(Light(light["type"], color, world[:3, 3], direction))

    def visit(self, index, parent):
        node = self.gltf["nodes"][index]
        world = parent @ matrix(node)
        if "mesh" in node:
            self.add_mesh(self.gltf["meshes"][node["mesh"]], world)
        if "KHR_lights_punctual" in node.get("extensions", {}):
            lights = self.gltf["extensions"]["KHR_lights_punctual"]["lights"]
            self.add_light(lights[node["extensions"]["KHR_lights_punctual"]["light"]], world)
        if "camera" in node and self.scene.camera is None:
            yfov = self.gltf["cameras"][node["camera"]]["perspective"]["yfov"]
            self.scene = dataclasses.replace(self.scene, camera=world, yfov=yfov)
        for child in node.get("children", []):
            self.visit(child, world)


def read(data):
    """Returns the Scene of the bytes of a .glb."""
    reader = Reader(data)
    for root in reader.gltf["scenes"][reader.gltf.get("scene", 0)]["nodes"]:
        reader.visit(root, numpy.eye(4))
    if reader.scene.camera is None:
        raise Unsupported("no camera")
    return reader.scene


def ply(shape):
    """Returns the bytes of a PLY file."""
    head = f"""ply
format binary_little_endian 1.0
element vertex {len(shape.positions)}
{"".join(f"property float {name}" + chr(10) for name in ("x", "y", "z", "nx", "ny", "nz"))}\
element face {len(shape.triangles)}
property list uchar int vertex_indices
end_header
"""
    vertices = numpy.hstack([shape.positions, shape.normals]).astype("<f4")
    faces = numpy.empty(len(shape.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, shape.triangles
    return head.encode() + vertices.tobytes() + faces.tobytes()
