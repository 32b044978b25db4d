"""The compared scenes, and the changes to their glTF files after which both renderers do the same work.

Cycles and glTF specify different dielectrics, normal maps and spots, and the multiple scattering of rough
metals is approximated in different ways. The files handed to both renderers therefore have Lambert surfaces
in place of dielectrics (specularFactor 0), metals of roughness 0.2 at most, no normal maps, and points in
place of spots. Textures, emitters, smooth glass and everything else stay.
"""

import dataclasses
import json
import struct

JSON_CHUNK = 0x4E4F534A
ROUGHEST_METAL = 0.2


@dataclasses.dataclass(frozen=True)
class Scene:
    file: str  # below the folder of scenes
    reference_spp: int  # of all images of the reference together
    depth: int  # scattering events of a path
    sky: object = None  # None, a file below the folder of scenes, or a radiance


VENICE = "env/venice_sunset_1k.hdr"
GIVEN = {  # in a folder that the caller names
    "cornell_diffuse": Scene("cm_cornell_diffuse/cm_cornell_diffuse.glb", 2048, 9),
    "cornell_glass": Scene("cm_cornell_glass/cm_cornell_glass.glb", 8192, 17),
    "interior_window": Scene("cm_interior_window/cm_interior_window.glb", 8192, 9, (1, 1.2, 1.5)),
    "manylights200": Scene("cm_manylights200/cm_manylights200.glb", 8192, 9),
    "punctual": Scene("cm_punctual/cm_punctual.glb", 2048, 9),
    "alpha": Scene("cm_alpha/cm_alpha.glb", 4096, 9),
    "spheres_grid": Scene("cm_spheres_grid/cm_spheres_grid.glb", 4096, 9, VENICE),
    "bunnies1024": Scene("cm_bunnies1024/cm_bunnies1024.glb", 2048, 9, VENICE),
    "damaged_helmet": Scene("DamagedHelmet/DamagedHelmet.glb", 4096, 9, VENICE),
    "venus": Scene("VkVenus/venus.gltf", 4096, 9, VENICE),
    "knight": Scene("KnightGT/chr_knight.glb", 4096, 9, VENICE),
    "duck": Scene("Duck/Duck.glb", 4096, 9, (1, 1.2, 1.5)),
}
WHITE = (1, 1, 1)
OWN = {  # written by own_scenes.py
    "furnace": Scene("furnace.gltf", 1024, 9, WHITE),
    "cornell": Scene("cornell.gltf", 2048, 9),
    "penumbra": Scene("penumbra.gltf", 1024, 9),
    "small_lamp": Scene("small_lamp.gltf", 1024, 9),
    "many_lamps": Scene("many_lamps.gltf", 1024, 9),
    "points": Scene("points.gltf", 2048, 9),
    "foliage": Scene("foliage.gltf", 1024, 9),
    "checker": Scene("checker.gltf", 1024, 9, WHITE),
    "glossy": Scene("glossy.gltf", 2048, 9),
    "glint": Scene("glint.gltf", 2048, 9),
    "window": Scene("window.gltf", 4096, 9, WHITE),
    "caustic": Scene("caustic.gltf", 4096, 17),
    "window_sky": Scene("window_sky.gltf", 8192, 9, "sky.hdr"),
    "quickstart": Scene("quickstart.gltf", 4096, 17),
    "glass_box": Scene("glass_box.gltf", 4096, 17),
    "sky_balls": Scene("sky_balls.gltf", 1024, 9, "sky.hdr"),
    "mosaic_room": Scene("mosaic_room.gltf", 1024, 9),
    "focus": Scene("focus.gltf", 1024, 9),
    "lamp_rooms": Scene("lamp_rooms.gltf", 4096, 9),
}
SCENES = GIVEN | OWN


def has_transmission(material):
    return "KHR_materials_transmission" in material.get("extensions", {})


def same_work(gltf):
    """Changes a glTF document as the head of this file says."""
    for material in gltf.get("materials", []):
        material.pop("normalTexture", None)
        material.pop("occlusionTexture", None)
        if not has_transmission(material):
            material.setdefault("extensions", {})["KHR_materials_specular"] = {"specularFactor": 0}
            factors = material.setdefault("pbrMetallicRoughness", {})
            factors["roughnessFactor"] = min(factors.get("roughnessFactor", 1), ROUGHEST_METAL)
    lights = gltf.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    for light in lights:
        if light.pop("spot", None) is not None:
            light["type"] = "point"
    used = gltf.setdefault("extensionsUsed", [])
    if "KHR_materials_specular" not in used:
        used.append("KHR_materials_specular")
    return gltf


def read(data):
    """Returns the JSON of a .gltf or .glb, and the chunks after it (None for a .gltf)."""
    if data[:4] != b"glTF":
        return json.loads(data), None
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def written(gltf, chunks):
    text = json.dumps(gltf).encode()
    if chunks is None:
        return text
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(chunks), len(text), JSON_CHUNK)
    return head + text + chunks


def prepare(source, folder):
    """Writes the changed scene into a new folder, with links to the other files; returns its path."""
    folder.mkdir()
    for other in source.parent.iterdir():
        if other != source:
            (folder / other.name).symlink_to(other)
    target = folder / source.name
    gltf, chunks = read(source.read_bytes())
    target.write_bytes(written(same_work(gltf), chunks))
    return target
