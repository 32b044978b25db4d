"""Scenes with terrain and participating media."""

import math

from maker.gltf import Gltf
from maker.looks import glass, metal, plain, png, solid
from maker.meshes import joined, quad, rounded
from maker.settings import camera, look_at, sky, sun, turned

ALPINE = ((0, (0.06, 0.085, 0.035)), (0.4, (0.1, 0.12, 0.055)), (0.56, (0.22, 0.18, 0.13)),
          (0.8, (0.3, 0.26, 0.23)), (0.86, (0.75, 0.77, 0.82)), (1, (0.88, 0.89, 0.92)))
MEADOW = ((0.3, (0.16, 0.2, 0.06)), (0.5, (0.22, 0.28, 0.08)), (0.7, (0.36, 0.34, 0.14)))


def terrain():
    """Models on a table: blocks of mountains (with detail that depends on the camera distance),
    hills and dunes."""
    gltf = Gltf()
    place = (-22, 17, 9)
    sun(gltf, place, radius=1.3, strength=750)
    sky(gltf, place, radius=40, strength=1.6)
    wood = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorFactor": [0.2, 0.12, 0.075, 1], "metallicFactor": 0, "roughnessFactor": 0.35}})
    gltf.node(mesh=gltf.mesh(quad((-30, 0, 30), (60, 0, 0), (0, 0, -60)), wood))
    eye, place = (0, 4.2, 13), (0, 0.4, -1.4)
    gltf.node(translation=list(place), extensions=gltf.terrain(
        "ridged", plain(1, 1, 1), [9, 4.2], ALPINE, scale=0.4, height=2.3, depth=0.4, seed=31,
        octaves=9, gain=0.42, detail={"from": rounded(*(e - p for e, p in zip(eye, place))), "angle": 0.0015}))
    gltf.node(translation=[-2.4, 0.3, 2.9], extensions=gltf.terrain(
        "fbm", plain(1, 1, 1), [4.1, 2.6], MEADOW, scale=0.7, height=1.3, depth=0.3, seed=5,
        octaves=8))
    gltf.node(translation=[2.4, 0.3, 2.9], extensions=gltf.terrain(
        "waves", plain(0.66, 0.46, 0.26), [4.1, 2.6], scale=0.4, height=0.7, depth=0.3, octaves=4,
        gain=0.35, offset=[0.1, 0.2]))
    camera(gltf, eye, (0, 0.7, 0), 0.5)
    return gltf


def planes():
    """Infinite planes: tiled ground with a basin, water that fills it, a box with a slanted cut and
    an octahedron of eight half-spaces."""
    gltf = Gltf()
    gltf.use("KHR_lights_punctual", "KHR_materials_transmission", "KHR_materials_volume",
             "KHR_materials_ior", "KHR_texture_transform")
    tiles = gltf.texture(png(64, 64, lambda x, y: (
        (190, 186, 176) if (x < 32) == (y < 32) else (70, 78, 90))))
    ground = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": tiles, "extensions": {
            "KHR_texture_transform": {"scale": [0.5, 0.5]}}},
        "metallicFactor": 0, "roughnessFactor": 0.7}})
    basin = gltf.add("materials", plain(0.75, 0.7, 0.6))
    water = glass([0.25, 0.75, 0.8])
    water["extensions"]["KHR_materials_ior"]["ior"] = 1.333
    ivory = gltf.add("materials", plain(0.8, 0.75, 0.6))
    red = gltf.add("materials", plain(0.7, 0.1, 0.08))
    gold = gltf.add("materials", metal(0.95, 0.75, 0.35, 0.2))
    gltf.doc["scenes"][0]["nodes"] += [
        gltf.csg("subtraction", gltf.shape("plane", ground), gltf.shape(
            "ellipsoid", basin, {"translation": [1.6, 0, 1.2]}, radii=[2.2, 1.2, 1.4])),
        gltf.csg("intersection", gltf.shape("box", ivory, size=[1.4, 2, 1.4]),
                 gltf.shape("plane", red, {"translation": [0, 0.2, 0],
                                           "rotation": turned((1, 0, 0), 40)[0]}),
                 translation=[-2.2, 1, -1.5], rotation=turned((0, 1, 0), 25)[0]),
        gltf.csg("intersection", *(gltf.shape("plane", gold, {
            "translation": rounded(*(0.55 * s / math.sqrt(3) for s in normal)),
            # The rotation that takes (0, 1, 0) to the normal.
            "rotation": rounded(normal[2] / 2 ** 0.5 * math.sin(angle / 2), 0,
                                -normal[0] / 2 ** 0.5 * math.sin(angle / 2), math.cos(angle / 2))})
            for normal in ((x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1))
            for angle in (math.acos(normal[1] / math.sqrt(3)),)), translation=[-0.5, 0.96, 2.2])]
    gltf.node(**gltf.shape("plane", gltf.add("materials", water), {"translation": [0, -0.25, 0]}))
    gltf.node(**gltf.shape("sphere", gold, {"translation": [3.4, 0.9, -3]}, radius=0.9))
    gltf.doc["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "directional", "intensity": 4, "color": [1, 0.93, 0.8]}]}}
    gltf.node(rotation=look_at((-4, 3.4, 1.2), (0, 0, 0)),
              extensions={"KHR_lights_punctual": {"light": 0}})
    camera(gltf, (0.3, 2.6, 8.5), (0.3, 1, 0), 0.62)
    return gltf


def fog():
    """Light shafts in fog; a cloud and smoke, each in its own body; milk in glass; a tumbler whose
    water overlaps its wall (priorities)."""
    gltf = Gltf()
    gltf.use("TESSERA_medium", "TESSERA_material", "TESSERA_texture", "KHR_lights_punctual",
             "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior")

    def even(scattering, absorption=(0, 0, 0), **more):
        return {"scattering": list(scattering), "absorption": list(absorption), **more}
    gltf.doc["scenes"][0]["extensions"] = {"TESSERA_medium": even(
        (0.035, 0.037, 0.04), anisotropy=0.55, center=[0, 1, 0], radius=6.2)}

    def filled(medium):
        return gltf.add("materials", {"name": "not seen itself",
                                      "extensions": {"TESSERA_medium": medium}})
    stone = gltf.add("materials", plain(0.45, 0.42, 0.38))
    wall = gltf.add("materials", plain(0.3, 0.3, 0.32))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, 6), (14, 0, 0), (0, 0, -11)), stone))
    gltf.node(mesh=gltf.mesh(quad((-7, 0, -5), (14, 0, 0), (0, 6, 0)), wall))
    # Boards with gaps, a light behind them and a panel beside the camera, both outside the fog,
    # because in-scattered radiance near a light is unbounded.
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
    # A cloud: turbulence in a ball.
    clumps = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "fbm", "scale": [2.6, 2.6, 2.6], "octaves": 4, "seed": 5, "ramp": [
            {"at": 0.46, "color": [0, 0, 0, 1]}, {"at": 0.7, "color": [1, 1, 1, 1]}]}}})
    gltf.node(**gltf.shape("sphere", filled(even(
        (14, 14, 14), anisotropy=0.3, density={"texture": clumps})),
        {"translation": [-0.25, 1.75, -0.6]}, radius=0.85))
    # Smoke: a plume on a small density grid.
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
    # A glass ball with milk.
    milk = gltf.add("materials", solid(1.35, 0, even((9, 8.6, 7.6), (0.02, 0.06, 0.2),
                                                     anisotropy=0.6)))
    gltf.node(**gltf.shape("sphere", milk, {"translation": [-1.75, 0.5, 0.7]}, radius=0.5))
    # A tumbler with water that overlaps the wall and the bottom by 5 mm.
    glassy = gltf.add("materials", solid(1.5, 2))
    water = gltf.add("materials", solid(1.333, 1, even((0.1, 0.2, 0.2), (2.4, 0.5, 0.25))))
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
