"""Small invalid glTF files, each of which breaks one rule of the specification."""

import base64
import copy
import json
import struct
import zlib

from maker.gltf import append_view

BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
VERTICES, INDICES = 34962, 34963
REMOVED = object()


def data_uri(payload, kind="application/octet-stream"):
    return f"data:{kind};base64," + base64.b64encode(payload).decode()


def chunk(kind, payload):
    return struct.pack(">I", len(payload)) + kind + payload + struct.pack(
        ">I", zlib.crc32(kind + payload))


def png(width=1, height=1, extra=b"", header=True):
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    rows = zlib.compress(b"\0" + b"\0" * width) if width == 1 else b""
    return (b"\x89PNG\r\n\x1a\n" + (head if header else b"") + extra + chunk(b"IDAT", rows)
            + chunk(b"IEND", b""))


def jpeg(channels=3, length=11):
    frame = struct.pack(">HBHHB", length, 8, 2, 2, channels) + b"\0" * 9
    return b"\xff\xd8\xff\xe0\x00\x10JFIF\0" + b"\0" * 9 + b"\xff\xc0" + frame


def webp(flags=0):
    return (b"RIFF" + struct.pack("<I", 22) + b"WEBPVP8X" + struct.pack("<I", 10)
            + struct.pack("<I", flags) + b"\x01\0\0\x01\0\0")


class Doc:
    """A valid document: a textured, skinned triangle with a morph target, animated."""

    def __init__(self):
        self.bytes = bytearray()
        self.doc = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
            "nodes": [{"mesh": 0, "skin": 0}, {"children": [2]}, {"camera": 0}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
            "meshes": [{"primitives": [{"attributes": {}, "material": 0, "targets": [{}]}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                           "normalTexture": {"index": 0}}],
            "textures": [{"source": 0, "sampler": 0}], "samplers": [{}],
            "images": [{"uri": data_uri(png(), "image/png")}],
            "skins": [{"joints": [1, 2]}], "accessors": [], "bufferViews": [], "buffers": [],
            "animations": [{"channels": [], "samplers": []}]}
        attributes = self.doc["meshes"][0]["primitives"][0]["attributes"]
        corners = [0, 0, 0, 1, 0, 0, 0, 1, 0]
        attributes["POSITION"] = self.floats("VEC3", corners, VERTICES, bounds=True)
        attributes["NORMAL"] = self.floats("VEC3", [0, 0, 1] * 3, VERTICES)
        attributes["TANGENT"] = self.floats("VEC4", [1, 0, 0, 1] * 3, VERTICES)
        attributes["TEXCOORD_0"] = self.floats("VEC2", [0, 0, 1, 0, 0, 1], VERTICES)
        attributes["COLOR_0"] = self.floats("VEC3", [0.5] * 9, VERTICES)
        attributes["JOINTS_0"] = self.ints("VEC4", "B", [0, 1, 0, 0] * 3, VERTICES)
        attributes["WEIGHTS_0"] = self.floats("VEC4", [0.5, 0.5, 0, 0] * 3, VERTICES)
        primitive = self.doc["meshes"][0]["primitives"][0]
        primitive["indices"] = self.ints("SCALAR", "H", [0, 1, 2], INDICES)
        primitive["targets"][0]["POSITION"] = self.floats("VEC3", corners, VERTICES, bounds=True)
        unit = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
        self.doc["skins"][0]["inverseBindMatrices"] = self.floats("MAT4", unit * 2)
        times = self.floats("SCALAR", [0, 1], bounds=True)
        for path, kind, values in (("translation", "VEC3", [0] * 6),
                                   ("rotation", "VEC4", [0, 0, 0, 1] * 2)):
            self.animate(1, path, times, self.floats(kind, values))
        self.animate(0, "weights", times, self.floats("SCALAR", [0, 1]))

    def animate(self, node, path, times, values, **sampler):
        animation = self.doc["animations"][0]
        animation["samplers"].append({"input": times, "output": values, **sampler})
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1,
                                      "target": {"node": node, "path": path}})

    def accessor(self, kind, component, payload, count, target=None):
        self.doc["bufferViews"].append(append_view(self.bytes, payload, target))
        self.doc["accessors"].append({"bufferView": len(self.doc["bufferViews"]) - 1,
                                      "componentType": component, "count": count, "type": kind})
        return len(self.doc["accessors"]) - 1

    def floats(self, kind, values, target=None, bounds=False):
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        index = self.accessor(kind, FLOAT, struct.pack(f"<{len(values)}f", *values),
                              len(values) // width, target)
        if bounds:
            self.doc["accessors"][index]["min"] = [min(values[k::width]) for k in range(width)]
            self.doc["accessors"][index]["max"] = [max(values[k::width]) for k in range(width)]
        return index

    def ints(self, kind, code, values, target=None):
        width = {"SCALAR": 1, "VEC4": 4, "VEC3": 3, "VEC2": 2}[kind]
        component = {"b": BYTE, "B": UBYTE, "h": SHORT, "H": USHORT, "I": UINT}[code]
        return self.accessor(kind, component, struct.pack(f"<{len(values)}{code}", *values),
                             len(values) // width, target)

    def parent_of(self, path):
        steps = path.split("/")
        at = self.doc
        for step, following in zip(steps, steps[1:]):
            if isinstance(at, list):
                at = at[int(step)]
            else:
                at = at.setdefault(step, [] if following.isdigit() else {})
        return at, (int(steps[-1]) if isinstance(at, list) else steps[-1])

    def set(self, path, value):
        holder, key = self.parent_of(path)
        if value is REMOVED:
            del holder[key]
        elif isinstance(holder, list) and key == len(holder):
            holder.append(value)
        else:
            holder[key] = value

    def use(self, *extensions, required=False):
        self.doc.setdefault("extensionsUsed", []).extend(extensions)
        if required:
            self.doc["extensionsRequired"] = list(extensions)

    def finished(self):
        doc = copy.deepcopy(self.doc)
        if not doc["buffers"]:
            doc["buffers"] = [{"byteLength": len(self.bytes), "uri": data_uri(bytes(self.bytes))}]
        return doc

    def glb(self, **changes):
        """A GLB; `changes` replace parts of its layout."""
        doc = copy.deepcopy(self.doc)
        doc["buffers"] = [{"byteLength": len(self.bytes), **changes.get("buffer", {})}]
        text = json.dumps(doc).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.bytes) + b"\0" * (-len(self.bytes) % 4)
        chunks = changes.get("chunks", lambda j, b: [(b"JSON", j), (b"BIN\0", b)])(text, binary)
        body = b"".join(struct.pack("<I", len(p) + changes.get("grow", {}).get(k, 0)) + k + p
                        for k, p in chunks) + changes.get("tail", b"")
        length = 12 + len(body) + changes.get("length", 0)
        return changes.get("magic", b"glTF") + struct.pack(
            "<II", changes.get("version", 2), length) + body


# Edits of the valid document: name, then pairs of a path and a value.
PRIMITIVE = "meshes/0/primitives/0"
EDITS = {
    "valid": (),
    "array_length": ("nodes/1/translation", [1, 2]),
    "array_type": ("nodes/1/translation", [1, 2, "3"]),
    "duplicate_children": ("nodes/1/children", [2, 2]),
    "empty_children": ("nodes/1/children", []),
    "empty_nodes": ("nodes", []),
    "negative_index": ("scene", -1),
    "image_without_source": ("images/0", {}),
    "version_pattern": ("asset/version", "two"),
    "type_mismatch": ("materials/0/doubleSided", "yes"),
    "null_property": ("materials/0/doubleSided", None),
    "no_asset": ("asset", REMOVED),
    "no_version": ("asset/version", REMOVED),
    "unexpected_property": ("materials/0/shiny", True),
    "required_without_used": ("extensionsRequired", ["KHR_materials_unlit"]),
    "skin_without_mesh": ("nodes/0/mesh", REMOVED),
    "stride_multiple": ("bufferViews/0/byteStride", 13),
    "unknown_filter": ("samplers/0/magFilter", 1),
    "unknown_alpha_mode": ("materials/0/alphaMode", "GLASS"),
    "metallic_range": ("materials/0/pbrMetallicRoughness/metallicFactor", 7),
    "emissive_range": ("materials/0/emissiveFactor", [50, 0, 0]),
    "normalized_float": ("accessors/0/normalized", True),
    "offset_alignment": ("accessors/0/byteOffset", 2),
    "offset_without_view": ("accessors/0/bufferView", REMOVED, "accessors/0/byteOffset", 0),
    "matrix_alignment": ("accessors/9/byteOffset", 2),
    "total_offset_alignment": ("bufferViews/0/byteOffset", 2),
    "min_version": ("asset/minVersion", "2.1"),
    "major_version": ("asset/version", "3.0"),
    "minor_version": ("asset/version", "2.1"),
    "stride_of_indices": ("bufferViews/7/byteStride", 4),
    "stride_above_length": ("bufferViews/0/byteStride", 252),
    "magnification_negative": ("cameras/0", {"type": "orthographic", "orthographic": {
        "xmag": -1, "ymag": 1, "zfar": 2, "znear": 1}}),
    "magnification_zero": ("cameras/0", {"type": "orthographic", "orthographic": {
        "xmag": 1, "ymag": 0, "zfar": 2, "znear": 1}}),
    "yfov_above_pi": ("cameras/0/perspective/yfov", 3.2),
    "zfar_below_znear": ("cameras/0/perspective/zfar", 0.5),
    "aspect_ratio_negative": ("cameras/0/perspective/aspectRatio", -1),
    "camera_of_both_types": ("cameras/0/orthographic", {"xmag": 1, "ymag": 1, "zfar": 2,
                                                        "znear": 1}),
    "extension_name": ("extensionsUsed", ["vendor-thing"]),
    "integer_bounds": ("accessors/7/max", [70000]),
    "cutoff_without_mask": ("materials/0/alphaCutoff", 0.5),
    "cutoff_negative": ("materials/0/alphaMode", "MASK", "materials/0/alphaCutoff", -1),
    "mesh_weights_count": ("meshes/0/weights", [1, 2]),
    "unequal_targets": ("meshes/0/primitives/1", {"attributes": {"POSITION": 0}}),
    "attribute_gap": (f"{PRIMITIVE}/attributes/TEXCOORD_2", 3),
    "attribute_name": (f"{PRIMITIVE}/attributes/COLOUR", 4),
    "application_attribute": (f"{PRIMITIVE}/attributes/_AGE", 3),
    "joints_without_weights": (f"{PRIMITIVE}/attributes/WEIGHTS_0", REMOVED),
    "no_position": (f"{PRIMITIVE}/attributes/POSITION", REMOVED),
    "tangent_without_normal": (f"{PRIMITIVE}/attributes/NORMAL", REMOVED),
    "node_empty": ("nodes/3", {}, "scenes/0/nodes", [0, 1, 3]),
    "matrix_identity": ("nodes/2/matrix", [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "matrix_sheared": ("nodes/2/matrix", [1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "matrix_mirrored": ("nodes/2/matrix", [-2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]),
    "matrix_turned": ("nodes/2/matrix", [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "matrix_projective": ("nodes/2/matrix", [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "matrix_and_scale": ("nodes/2/matrix", [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
                         "nodes/2/scale", [1, 1, 1]),
    "skinned_transform": ("nodes/0/translation", [1, 0, 0]),
    "skinned_child": ("nodes/1/children", [2, 0], "scenes/0/nodes", [1]),
    "joints_in_another_scene": ("scenes/1", {"nodes": [0]}),
    "extras_not_object": ("materials/0/extras", 5),
    "absolute_uri": ("images/0/uri", "https://example.invalid/image.png"),
    "uri_scheme": ("images/0/uri", ":image.png"),
    "data_uri_damaged": ("images/0/uri", "data:image/png;base64,?"),
    "data_uri_empty_parameter": ("images/0/uri", data_uri(png(), "image/png;")),
    "data_uri_parameter": ("images/0/uri", data_uri(png(), "image/png;charset=utf-8")),
    "data_uri_type_without_slash": ("images/0/uri", data_uri(png(), "png")),
    "missing_image": ("images/0/uri", "missing.png"),
    "data_of_other_type": ("images/0/uri", data_uri(png(), "image/jpeg")),
    "buffer_media_type": ("images/0/uri", data_uri(png(), "image/png"),
                          "buffers/0", {"byteLength": 4, "uri": "data:text/plain;base64,AAAAAA=="}),
    "rotation_not_unit": ("nodes/2/rotation", [0, 0, 0, 0.9]),
    "no_common_root": ("nodes/1/children", REMOVED, "scenes/0/nodes", [0, 1, 2]),
    "skeleton_below": ("skins/0/skeleton", 2),
    "skeleton_unresolved": ("skins/0/skeleton", 99),
    "unused_required": ("extensionsUsed", ["KHR_materials_unlit"],
                        "extensionsRequired", ["KHR_materials_ior"]),
    "small_stride": ("bufferViews/1/byteStride", 8),
    "accessor_too_long": ("accessors/0/count", 4),
    "accessor_offset_too_long": ("accessors/0/byteOffset", 400),
    "usage_override": (f"{PRIMITIVE}/indices", 0),
    "animated_matrix": ("nodes/1/matrix", [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "animated_skin": ("animations/0/channels/0/target/node", 0),
    "weights_without_morphs": (f"{PRIMITIVE}/targets", REMOVED),
    "duplicate_targets": ("animations/0/channels/3", {"sampler": 0, "target": {
        "node": 1, "path": "translation"}}),
    "animation_stride": ("bufferViews/10/byteStride", 4),
    "times_without_bounds": ("accessors/10/min", REMOVED),
    "cubic_with_one_key": ("accessors/10/count", 1, "accessors/10/max", [0],
                           "animations/0/samplers/0/interpolation", "CUBICSPLINE"),
    "output_count": ("accessors/11/count", 1),
    "output_format": ("animations/0/samplers/0/output", 12),
    "unknown_path": ("animations/0/channels/0/target/path", "colour"),
    "sampler_unresolved": ("animations/0/channels/0/sampler", 9),
    "animation_sampler_unused": ("animations/0/channels/2", REMOVED),
    "target_missing": ("bufferViews/0/target", REMOVED),
    "target_override": ("bufferViews/0/target", INDICES),
    "view_too_long": ("bufferViews/0/byteLength", 100000),
    "view_offset_too_long": ("bufferViews/0/byteOffset", 100000),
    "inverse_binds_count": ("accessors/9/count", 1),
    "inverse_binds_format": ("skins/0/inverseBindMatrices", 4),
    "inverse_binds_stride": ("bufferViews/9/byteStride", 64),
    "attribute_unaligned": ("accessors/5/byteOffset", 1, "accessors/5/count", 2),
    "attribute_format": (f"{PRIMITIVE}/attributes/NORMAL", 5),
    "unequal_count": ("accessors/1/count", 2),
    "shared_view": ("accessors/1/bufferView", 0),
    "generated_tangents": (f"{PRIMITIVE}/attributes/TANGENT", REMOVED),
    "tangent_unused": ("materials/0/normalTexture", REMOVED),
    "incompatible_mode": ("accessors/7/count", 2),
    "lines_incompatible": (f"{PRIMITIVE}/mode", 1),
    "mode_range": (f"{PRIMITIVE}/mode", 7),
    "indices_format": ("accessors/7/componentType", SHORT),
    "target_without_base": (f"{PRIMITIVE}/targets/0/COLOR_1", 4),
    "target_count": ("accessors/8/count", 2),
    "position_without_bounds": ("accessors/0/min", REMOVED),
    "too_few_texcoords": ("materials/0/normalTexture/texCoord", 3),
    "texcoord_unused": (f"{PRIMITIVE}/attributes/TEXCOORD_1", 3),
    "node_loop": ("nodes/3", {"children": [4]}, "nodes/4", {"children": [3]}),
    "joints_in_a_loop": ("nodes/3", {"children": [4]}, "nodes/4", {"children": [3]},
                         "skins/0/joints", [3, 4]),
    "joints_beside_a_loop": ("nodes/3", {"children": [4]}, "nodes/4", {"children": [3]},
                             "skins/0/joints", [1, 4]),
    "two_parents": ("nodes/3", {"children": [2]}, "scenes/0/nodes", [0, 1, 3]),
    "mesh_without_skin": ("nodes/0/skin", REMOVED),
    "skin_without_joints": (f"{PRIMITIVE}/attributes/JOINTS_0", REMOVED,
                            f"{PRIMITIVE}/attributes/WEIGHTS_0", REMOVED),
    "node_weights_count": ("nodes/0/weights", [1, 2]),
    "mesh_weights_unused": ("meshes/0/weights", [0], "nodes/0/weights", [1]),
    "scene_non_root": ("scenes/0/nodes", [0, 1, 2]),
    "undeclared_extension": ("materials/0/extensions", {"KHR_materials_unlit": {}}),
    "unresolved_mesh": ("nodes/0/mesh", 9),
    "unresolved_accessor": (f"{PRIMITIVE}/attributes/NORMAL", 99),
    "unresolved_texture": ("materials/0/occlusionTexture", {"index": 99}),
    "unresolved_scene": ("scene", 5),
    "unsupported_extension": ("extensionsUsed", ["VENDOR_thing"]),
    "object_unused": ("materials/1", {"name": "spare"}),
    "minimum_mismatch": ("accessors/0/min", [-1, 0, 0]),
    "element_below_minimum": ("accessors/0/min", [0.5, 0, 0]),
    "maximum_mismatch": ("accessors/0/max", [2, 1, 0]),
    "element_above_maximum": ("accessors/0/max", [0.5, 1, 0]),
    "buffer_too_short": ("buffers/0", {"byteLength": 8, "uri": data_uri(b"\0" * 4)}),
    "joints_out_of_range": ("skins/0/joints", [1]),
    "image_truncated": ("images/0/uri", data_uri(png()[:24], "image/png")),
    "image_not_square_pixels": ("images/0/uri", data_uri(png(extra=chunk(
        b"pHYs", struct.pack(">IIB", 1, 2, 0))), "image/png")),
    "image_gamma": ("images/0/uri", data_uri(png(extra=chunk(
        b"gAMA", struct.pack(">I", 50000))), "image/png")),
    "image_size": ("images/0/uri", data_uri(png(3, 5), "image/png")),
    "image_jpeg": ("images/0/uri", data_uri(jpeg(), "image/jpeg")),
    "image_jpeg_channels": ("images/0/uri", data_uri(jpeg(4), "image/jpeg")),
    "image_webp": ("images/0/uri", data_uri(webp(), "image/webp")),
    "image_declared_type": ("images/0/mimeType", "image/jpeg"),
    "image_unrecognised": ("images/0/uri", "picture.bin"),
}

# Accessors with other values: name, accessor, format of the values, values.
VALUES = {
    "normal_not_unit": (1, "f", [0, 0, 2] * 3),
    "tangent_sign": (2, "f", [1, 0, 0, 0] * 3),
    "tangent_not_unit": (2, "f", [2, 0, 0, 1] * 3),
    "colour_not_clamped": (4, "f", [1.5] * 9),
    "float_not_finite": (3, "f", [float("nan"), 0, float("inf"), 0, 0, 1]),
    "joint_repeated": (5, "B", [1, 1, 0, 0] * 3),
    "joint_beyond": (5, "B", [0, 9, 0, 0] * 3),
    "joint_without_weight": (5, "B", [0, 1, 1, 0] * 3),
    "weight_negative": (6, "f", [1.5, -0.5, 0, 0] * 3),
    "weights_not_normalised": (6, "f", [0.5, 0.4, 0, 0] * 3),
    "index_beyond": (7, "H", [0, 1, 3]),
    "index_restart": (7, "H", [0, 1, 65535]),
    "triangle_degenerate": (7, "H", [0, 1, 1]),
    "inverse_bind_row": (9, "f", [1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] * 2),
    "time_negative": (10, "f", [-1, 1]),
    "times_decrease": (10, "f", [1, 0]),
    "quaternion_not_unit": (12, "f", [0, 0, 0, 2] * 2),
}

# Extensions of the material: name, extension and its object.
MATERIAL_EXTENSIONS = {
    "anisotropy_texcoord": ("anisotropy", {"anisotropyTexture": {"index": 0, "texCoord": 1}}),
    "clearcoat_texcoord": ("clearcoat", {"clearcoatNormalTexture": {"index": 0, "texCoord": 1}}),
    "clearcoat_range": ("clearcoat", {"clearcoatFactor": 2}),
    "clearcoat_misspelt": ("clearcoat", {"clearCoatFactor": 1}),
    "dispersion_alone": ("dispersion", {"dispersion": 1}),
    "emissive_strength_zero": ("emissive_strength", {"emissiveStrength": 2}),
    "ior_below_1": ("ior", {"ior": 0.5}),
    "ior_0": ("ior", {"ior": 0}),
    "iridescence_minimum": ("iridescence", {"iridescenceThicknessMinimum": 5}),
    "iridescence_equal": ("iridescence", {"iridescenceThicknessMinimum": 400,
                                          "iridescenceThicknessTexture": {"index": 0}}),
    "sheen_texture": ("sheen", {"sheenColorTexture": {"index": 7}}),
    "specular_range": ("specular", {"specularFactor": 2, "specularColorFactor": [1, 1, 4]}),
    "transmission_range": ("transmission", {"transmissionFactor": -1}),
    "volume_alone": ("volume", {"thicknessFactor": 1}),
    "specular_glossiness": ("pbrSpecularGlossiness", {"glossinessFactor": 5}),
}


def extension_cases():
    """Cases of extensions that need more than one object."""
    for name, (extension, value) in MATERIAL_EXTENSIONS.items():
        made = Doc()
        made.use(f"KHR_materials_{extension}")
        made.set(f"materials/0/extensions/KHR_materials_{extension}", value)
        yield name, made

    def start(*extensions, **options):
        made = Doc()
        made.use(*extensions, **options)
        return made

    made = start("KHR_materials_volume", "KHR_materials_transmission")
    made.set("materials/0/doubleSided", True)
    made.set("materials/0/extensions", {"KHR_materials_volume": {"thicknessFactor": 1},
                                        "KHR_materials_transmission": {}})
    yield "volume_double_sided", made
    made = start("KHR_materials_unlit", "KHR_materials_ior")
    made.set("materials/0/extensions", {"KHR_materials_unlit": {}, "KHR_materials_ior": {}})
    yield "unlit_and_ior", made
    made = start("KHR_materials_unlit")
    made.set("nodes/1/extensions", {"KHR_materials_unlit": {}})
    yield "extension_misplaced", made
    made = start("KHR_materials_unlit", "KHR_materials_unlit")
    yield "extension_twice", made
    yield "quantization_optional", start("KHR_mesh_quantization")
    made = start("KHR_mesh_quantization", required=True)
    made.set("meshes/0/primitives/0/attributes/NORMAL",
             made.accessor("VEC3", BYTE, b"\0\0\x7f\0" * 3, 3, VERTICES))
    made.set(f"accessors/{len(made.doc['accessors']) - 1}/normalized", True)
    made.set(f"bufferViews/{len(made.doc['bufferViews']) - 1}/byteStride", 4)
    yield "quantization", made
    made = start("KHR_texture_transform")
    made.set("materials/0/normalTexture/extensions/KHR_texture_transform",
             {"texCoord": 2, "offset": [1]})
    yield "texture_transform", made

    lights = [{"type": "spot", "spot": {"innerConeAngle": 1, "outerConeAngle": 0.5}},
              {"type": "directional", "range": 5, "spot": {}}, {"type": "point", "color": [2, 1, 1]},
              {"type": "spot"}]
    made = start("KHR_lights_punctual")
    made.set("extensions/KHR_lights_punctual", {"lights": lights})
    for i, light in enumerate((0, 1, 9)):
        made.set(f"nodes/{i}/extensions/KHR_lights_punctual", {"light": light})
    yield "lights", made
    made = start("KHR_lights_punctual")
    made.set("nodes/1/extensions/KHR_lights_punctual", {"light": 0})
    yield "light_without_lights", made

    made = start("KHR_materials_variants")
    made.set("extensions/KHR_materials_variants", {"variants": [{"name": "a"}, {"name": "b"}, {}]})
    made.set("meshes/0/primitives/0/extensions/KHR_materials_variants",
             {"mappings": [{"material": 0, "variants": [0, 1]}, {"material": 9, "variants": [0, 7]}]})
    yield "variants", made
    made = start("KHR_materials_variants")
    made.set("meshes/0/primitives/0/extensions/KHR_materials_variants",
             {"mappings": [{"material": 0, "variants": [0]}]})
    yield "variants_without_list", made

    made = start("KHR_animation_pointer")
    made.set("animations/0/channels/0/target/extensions/KHR_animation_pointer",
             {"pointer": "materials/0"})
    yield "animation_pointer", made
    made = start("KHR_animation_pointer")
    made.set("animations/0/channels/0/target", {"path": "pointer", "extensions": {
        "KHR_animation_pointer": {"pointer": "/nodes/2/translation"}}})
    yield "animation_pointer_valid", made
    made = start("EXT_texture_webp")
    made.set("images/1", {"uri": data_uri(webp(2), "image/webp")})
    made.set("textures/0/extensions/EXT_texture_webp", {"source": 0})
    made.set("textures/1", {"source": 1})
    yield "texture_webp", made


def structure_cases():
    """Cases that change the structure of the document."""
    made = Doc()
    made.floats("VEC3", [0, 0, 0])
    sparse = {"count": 2, "indices": {"bufferView": 0, "componentType": UBYTE},
              "values": {"bufferView": 1}}
    made.doc["accessors"][1]["sparse"] = sparse
    yield "sparse_views", made
    for name, indices in (("sparse_beyond", b"\0\x05"), ("sparse_order", b"\1\0")):
        made = Doc()
        views = [made.accessor("SCALAR", UBYTE, payload, 1)
                 for payload in (indices, struct.pack("<6f", *[0, 0, 1] * 2))]
        del made.doc["accessors"][-2:]
        made.doc["accessors"][1]["sparse"] = {
            "count": 2, "indices": {"bufferView": views[0], "componentType": UBYTE},
            "values": {"bufferView": views[1]}}
        yield name, made
    made = copy.deepcopy(made)
    made.doc["accessors"][1]["sparse"]["count"] = 4
    yield "sparse_count", made
    made = Doc()
    made.doc["accessors"][3] |= {"componentType": UINT}
    made.doc["meshes"][0]["primitives"][0]["attributes"] |= {"_ID": 3}
    yield "attribute_unsigned_int", made
    made = Doc()
    made.doc["animations"][0]["samplers"][0]["input"] = 11
    yield "input_format", made
    made = Doc()
    image = made.accessor("SCALAR", UBYTE, png(), 1)
    made.doc["accessors"].pop()
    made.doc["bufferViews"][image]["byteStride"] = 4
    made.doc["images"][0] = {"bufferView": image, "mimeType": "image/jpeg"}
    yield "image_in_view", made
    made = copy.deepcopy(made)
    del made.doc["images"][0]["mimeType"]
    yield "image_in_view_without_type", made
    made = Doc()
    made.doc["materials"][0] = {"extensions": {"KHR_materials_anisotropy": {
        "anisotropyTexture": {"index": 0}}}}
    del made.doc["meshes"][0]["primitives"][0]["attributes"]["TANGENT"]
    made.use("KHR_materials_anisotropy")
    yield "no_tangent_space", made


GLBS = {
    "glb": {},
    "glb_magic": {"magic": b"glTG"},
    "glb_version": {"version": 3},
    "glb_length_long": {"length": 4},
    "glb_length_short": {"length": -8},
    "glb_extra": {"tail": b"\0" * 8, "length": -8},
    "glb_bin_too_long": {"grow": {b"BIN\0": 64}},
    "glb_bin_unaligned": {"chunks": lambda j, b: [(b"JSON", j), (b"BIN\0", b + b"\0")]},
    "glb_bin_padding": {"chunks": lambda j, b: [(b"JSON", j), (b"BIN\0", b + b"\0" * 8)]},
    "glb_without_bin": {"chunks": lambda j, b: [(b"JSON", j)]},
    "glb_bin_first": {"chunks": lambda j, b: [(b"BIN\0", b), (b"JSON", j)]},
    "glb_bin_third": {"chunks": lambda j, b: [(b"JSON", j), (b"XTRA", b), (b"BIN\0", b)]},
    "glb_bin_twice": {"chunks": lambda j, b: [(b"JSON", j), (b"BIN\0", b), (b"BIN\0", b)]},
    "glb_bin_empty": {"chunks": lambda j, b: [(b"JSON", j), (b"BIN\0", b""), (b"XTRA", b)]},
    "glb_json_twice": {"chunks": lambda j, b: [(b"JSON", j), (b"JSON", j), (b"BIN\0", b)]},
    "glb_json_empty": {"chunks": lambda j, b: [(b"JSON", b""), (b"BIN\0", b)]},
    "glb_json_empty_last": {"chunks": lambda j, b: [(b"JSON", b"")]},
    "glb_bin_first_json_empty": {"chunks": lambda j, b: [(b"BIN\0", b), (b"JSON", b"")]},
    "glb_uri": {"buffer": {"uri": "elsewhere.bin"}},
    "glb_data_uri": {"buffer": {"uri": data_uri(b"\0" * 4)}},
}

# Files whose text is no valid document.
TEXTS = {
    "json_truncated": '{"asset": {"version": "2.0"}',
    "json_array": ' [1]',
    "json_repeated_key": '{"asset": {"version": "1.0"}, "asset": {"version": "2.0"}}',
    "json_byte_order_mark": '\ufeff{"asset": {"version": "2.0"}}',
}


def cases():
    """All cases: name and the bytes of a file."""
    for name, edits in EDITS.items():
        made = Doc()
        for path, value in zip(edits[::2], edits[1::2]):
            made.set(path, value)
        yield name, json.dumps(made.finished()).encode()
    for name, (accessor, code, values) in VALUES.items():
        made = Doc()
        at = made.doc["bufferViews"][accessor]["byteOffset"]
        payload = struct.pack(f"<{len(values)}{code}", *values)
        made.bytes[at:at + len(payload)] = payload
        yield name, json.dumps(made.finished()).encode()
    for name, made in (*extension_cases(), *structure_cases()):
        yield name, json.dumps(made.finished()).encode()
    for name, changes in GLBS.items():
        yield name, Doc().glb(**changes)
    yield "glb_header", Doc().glb()[:10]
    yield "glb_chunk_header", Doc().glb()[:16]
    yield "glb_only_header", b"glTF" + struct.pack("<II", 2, 12)
    for name, text in TEXTS.items():
        yield name, text.encode()


def mutations():
    """Variants of documents with all kinds of objects: every member is left out, and replaced by
    values of each type."""
    values = (None, -1, 1.5, 99, "text", [], [-1], {}, {"unknown": 0}, True)

    def walk(holder):
        for key in (list(holder) if isinstance(holder, dict) else range(len(holder))):
            original = holder[key]
            for value in values:
                holder[key] = value
                yield
            if isinstance(holder, dict):
                del holder[key]
                yield
            holder[key] = original
            if isinstance(original, (dict, list)):
                yield from walk(original)

    made = [Doc()] + [doc for name, doc in extension_cases()
                      if name in ("lights", "variants", "texture_transform", "volume_double_sided",
                                  "animation_pointer_valid")]
    for number, each in enumerate(made):
        document = each.finished()
        roots = document if number == 0 else {key: document[key] for key in (
            "extensions", "materials", "meshes", "animations") if key in document}
        for step, _ in enumerate(walk(roots)):
            yield f"mutation_{number}_{step}", json.dumps({**document, **roots}).encode()
