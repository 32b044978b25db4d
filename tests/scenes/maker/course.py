"""The gallery scene, which combines most features."""

from maker.gltf import Gltf
from maker.looks import glass, metal, plain
from maker.meshes import joined, quad, rounded
from maker.settings import sky, sun

EYE, TARGET = (0.3, 1.75, 7.4), (0.05, 1.3, 0)
SUN = (-50, 36, 40)


def course():
    """A marble terrace over a valley in mist: CSG, glass, blobs, metals, terrain, a lens."""
    gltf = Gltf()
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume",
             "KHR_materials_emissive_strength", "TESSERA_material", "TESSERA_camera",
             "TESSERA_texture", "TESSERA_medium")
    terrace(gltf)
    sculptures(gltf)
    valley(gltf)
    sun(gltf, SUN, radius=4.4, strength=250)
    sky(gltf, SUN, radius=100, strength=1.5)
    gltf.node(camera=gltf.add("cameras", {
        "type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.05},
        "extensions": {"TESSERA_camera": {
            "lookAt": {"position": list(EYE), "target": list(TARGET)},
            "lens": {"fNumber": 2, "focusDistance": 6.5, "sensorHeight": 0.036, "blades": 7}}}}))
    return gltf


def marble(gltf, dark, light, seed, roughness, scale=(0.9, 0.9, 0.5)):
    """A marble texture with veins of `dark` in `light`."""
    veins = [(0, dark), (0.18, [0.3 * d + 0.7 * w for d, w in zip(dark, light)]), (1, light)]
    texture = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "marble", "space": "world", "scale": list(scale), "distortion": 2.4,
        "octaves": 7, "seed": seed, "ramp": [{"at": at, "color": rounded(*color, 1)}
                                             for at, color in veins]}}})
    return gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": texture}, "metallicFactor": 0, "roughnessFactor": roughness}})


def conductor(gltf, name, roughness):
    look = metal(1, 1, 1, roughness)
    look["extensions"] = {"TESSERA_material": {"conductor": {"metal": name}}}
    return gltf.add("materials", look)


def terrace(gltf):
    """A floor of two marbles with a balustrade of hyperboloids."""
    white = marble(gltf, (0.3, 0.29, 0.3), (0.82, 0.79, 0.74), 4, 0.16)
    green = marble(gltf, (0.42, 0.45, 0.38), (0.035, 0.06, 0.05), 9, 0.13, (0.7, 0.7, 1.1))
    side = 0.9
    for which, material in enumerate((white, green)):
        gltf.node(mesh=gltf.mesh(joined(*(
            quad((column * side, 0, 2 - row * side), (side, 0, 0), (0, 0, -side))
            for column in range(-8, 8) for row in range(-6, 6) if (column + row) % 2 == which)),
            material))
    stone = marble(gltf, (0.5, 0.47, 0.42), (0.78, 0.73, 0.65), 2, 0.5, (1.2, 1.2, 1.2))
    gltf.node(**gltf.shape("box", stone, {"translation": [0, -0.302, 0.9]}, size=[16, 0.6, 11]))
    z = -3.75
    for y, height, depth in ((0.07, 0.14, 0.34), (0.72, 0.12, 0.36)):
        gltf.node(**gltf.shape("box", stone, {"translation": [0, y, z]}, size=[16, height, depth]))
    for k in range(-9, 10):
        gltf.node(**gltf.shape("hyperboloid", stone, {"translation": rounded(0.42 * k, 0.4, z)},
                               waist=0.055, radius=0.12, height=0.54))


def sculptures(gltf):
    # Ivory: the intersection of a cube and a ball, minus three rods.
    ivory = gltf.add("materials", plain(0.8, 0.72, 0.56))
    gltf.doc["materials"][ivory]["pbrMetallicRoughness"]["roughnessFactor"] = 0.3
    red = gltf.add("materials", plain(0.5, 0.05, 0.04))

    def rod(**node):
        return gltf.shape("cylinder", red, node, radius=0.33, height=3)
    carved = gltf.csg(
        "subtraction",
        gltf.csg("intersection", gltf.shape("box", ivory, {}, size=[1.2, 1.2, 1.2]),
                 gltf.shape("sphere", ivory, {}, radius=0.8)),
        gltf.csg("union", rod(), rod(rotation=[0, 0, 0.7071068, 0.7071068]),
                 rod(rotation=[0.7071068, 0, 0, 0.7071068])),
        translation=[-1.75, 0.601, 0.3], rotation=[0, 0.2588190, 0, 0.9659258])
    gltf.doc["scenes"][0]["nodes"].append(carved)

    # A torus of glass, tinted by Beer's law.
    teal = glass([0.1, 0.62, 0.55])
    teal["extensions"]["KHR_materials_volume"]["attenuationDistance"] = 0.4
    gltf.node(**gltf.shape("torus", gltf.add("materials", teal), {
        "translation": [0.12, 0.801, 0.75],
        "rotation": rounded(0.6829, 0.1830, -0.1830, 0.6829)}, radius=0.58, tube=0.22))

    # Copper blobs on the floor.
    drops = [((0, 0.02, 0), (0.8, 0.3, 0.8), 1), ((0, 0.4, 0), 0.5, 1), ((0.1, 0.78, 0), 0.46, 1),
             ((-0.02, 1.16, 0.05), 0.42, 1), ((0.08, 1.5, 0), 0.36, 1), ((0.42, 0.95, 0.1), 0.32, 1),
             ((-0.36, 0.72, 0.12), 0.32, 1), ((0.08, 1.95, 0.02), 0.24, 1)]
    gltf.node(**gltf.blobs(conductor(gltf, "copper", 0.2), *drops, translation=[1.85, 0, 0.1]))

    for name, roughness, radius, x, z in (("gold", 0.1, 0.32, -0.72, 2.0),
                                          ("silver", 0.28, 0.22, 0.98, 2.2),
                                          ("iron", 0.4, 0.16, -1.5, 2.3)):
        gltf.node(**gltf.shape("sphere", conductor(gltf, name, roughness),
                               {"translation": [x, radius, z]}, radius=radius))


ROCK = ((0, (0.15, 0.18, 0.08)), (0.5, (0.2, 0.21, 0.11)), (0.64, (0.27, 0.23, 0.18)),
        (0.76, (0.33, 0.29, 0.26)), (0.82, (0.7, 0.72, 0.76)), (1, (0.84, 0.85, 0.88)))


def valley(gltf):
    """Mountains with detail that depends on the camera distance, and mist in the valleys."""
    place = (0, -6, -36)
    gltf.node(translation=list(place), extensions=gltf.terrain(
        "ridged", plain(1, 1, 1), [96, 56], ROCK, scale=0.06, height=12, seed=5, octaves=8, gain=0.45,
        detail={"from": rounded(*(e - p for e, p in zip(EYE, place))), "angle": 0.0025}))
    mist = gltf.add("materials", {"name": "mist", "extensions": {"TESSERA_medium": {
        "scattering": [0.055, 0.057, 0.061], "absorption": [0, 0, 0], "anisotropy": 0.5}}})
    gltf.node(**gltf.shape("ellipsoid", mist, {"translation": [0, -6.5, -36]},
                           radii=[58, 8.5, 31]))
