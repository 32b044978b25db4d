"""Scenes with emissive and absorbing media."""

import math

from maker.gltf import Gltf
from maker.looks import metal, plain, png, solid
from maker.meshes import quad, rounded
from maker.settings import camera, sky, turned


def gas(gltf, emission, **more):
    """A material whose surface encloses a glowing medium and is itself invisible."""
    gltf.use("TESSERA_medium")
    return gltf.add("materials", {"name": "glowing gas", "extensions": {"TESSERA_medium": {
        "emission": list(emission), **more}}})


def flame():
    """A fire in a bowl in front of a wall with neon tubes; nothing else emits light."""
    gltf = Gltf()
    gltf.use("TESSERA_texture", "TESSERA_material")
    stone = gltf.add("materials", plain(0.5, 0.47, 0.44))
    wall = gltf.add("materials", plain(0.62, 0.6, 0.62))
    floor = gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorFactor": [0.22, 0.2, 0.2, 1], "metallicFactor": 0, "roughnessFactor": 0.28}})
    gltf.node(mesh=gltf.mesh(quad((-6, 0, 5), (12, 0, 0), (0, 0, -7)), floor))
    gltf.node(mesh=gltf.mesh(quad((-6, 0, -2), (12, 0, 0), (0, 5, 0)), wall))
    fire(gltf, stone)
    neon(gltf)
    copper = metal(1, 1, 1, 0.25)
    copper["extensions"] = {"TESSERA_material": {"conductor": {"metal": "copper"}}}
    gltf.node(**gltf.shape("sphere", gltf.add("materials", copper),
                           {"translation": [-1.05, 0.3, 0.35]}, radius=0.3))
    gltf.node(**gltf.shape("cone", gltf.add("materials", plain(0.75, 0.73, 0.7)),
                           {"translation": [1.05, 0.45, 0.15]}, radius=0.26, height=0.9))
    camera(gltf, (0, 1.15, 5), (0, 0.98, 0), 0.5)
    return gltf


def fire(gltf, stone):
    """A bowl on a foot, with a flame: blobs filled with the pattern `fire`."""
    gltf.node(**gltf.shape("hyperboloid", stone, {"translation": [0, 0.2, 0]},
                           waist=0.1, radius=0.24, height=0.4))
    bowl = gltf.csg(
        "subtraction",
        gltf.shape("paraboloid", stone, {"translation": [0, 0.5, 0]}, radius=0.46, height=0.24),
        gltf.shape("paraboloid", stone, {"translation": [0, 0.55, 0]}, radius=0.43, height=0.24))
    gltf.doc["scenes"][0]["nodes"].append(bowl)
    tongues = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "fire", "scale": [3.2, 0.78, 3.2], "offset": [0.3, 0, 0.7], "octaves": 4,
        "distortion": 1.5, "seed": 3, "dimensions": 4, "time": 0.4, "ramp": [
            {"at": 0.12, "color": [0, 0, 0, 1]}, {"at": 0.7, "color": [1, 1, 1, 1]}]}}})
    burning = gas(gltf, (24, 6.6, 1.1), density={"texture": tongues}, absorption=[0.3, 0.5, 0.8])
    gltf.node(**gltf.blobs(
        burning, ((0, 0.1, 0), (0.62, 0.3, 0.62), 1), ((0, 0.35, 0), (0.5, 0.5, 0.5), 1),
        ((-0.06, 0.7, 0), (0.36, 0.5, 0.36), 1), ((0.03, 1.05, 0), (0.22, 0.5, 0.22), 1),
        ((0.24, 0.5, 0.05), (0.2, 0.45, 0.2), 1), ((-0.28, 0.45, 0.05), (0.18, 0.4, 0.18), 1),
        translation=[0, 0.6, 0]))


def neon(gltf):
    """A ring and a bar of clear glowing gas on the wall."""
    blue, pink = gas(gltf, (4, 24, 60)), gas(gltf, (60, 4.6, 31))
    quarter = turned((1, 0, 0), 90)[0]
    gltf.node(**gltf.shape("torus", blue, {"translation": [0, 1.5, -1.85], "rotation": quarter},
                           radius=1.05, tube=0.02))
    for x in (-1.75, 1.75):
        gltf.node(**gltf.shape("cylinder", pink, {"translation": [x, 1.2, -1.85]},
                               radius=0.02, height=1.6))


def underwater():
    """A camera in a pool, whose lamps are in the water: Beer's law turns white balls green and then
    blue with distance. The surface mirrors the pool where reflection is total."""
    gltf = Gltf()
    gltf.use("TESSERA_medium", "TESSERA_material", "TESSERA_texture",
             "KHR_materials_transmission", "KHR_materials_volume", "KHR_materials_ior",
             "KHR_materials_emissive_strength")
    sky(gltf, (-20, 8, -60), radius=200, strength=2)
    ripples = gltf.add("textures", {"extensions": {"TESSERA_texture": {
        "pattern": "fbm", "scale": [1.1, 1.1, 1.1], "octaves": 2, "bumpHeight": 0.07, "seed": 8}}})
    water = solid(1.333, 0, {"absorption": [0.24, 0.05, 0.036]})
    water["normalTexture"] = {"index": ripples}
    gltf.node(**gltf.shape("box", gltf.add("materials", water), {"translation": [0, -1.5, -6]},
                           size=[5.6, 3, 19]))
    pool(gltf)
    ball = gltf.add("materials", plain(0.85, 0.85, 0.85))
    for k in range(5):
        x, y = (-0.9, 0.75, -0.5, 0.9, 0)[k], (-1.5, -1.85, -1.1, -1.4, -1.6)[k]
        gltf.node(**gltf.shape("sphere", ball, {"translation": rounded(x, y, 0.6 - 2.4 * k)},
                               radius=0.36))
    camera(gltf, (0.2, -1.2, 3), (0, -1.25, -3), 0.8)
    return gltf


def pool(gltf):
    """A floor and walls with tiles, lamps and a ladder, 5 x 2.5 x 17 m below y = 0."""
    image = gltf.texture(png(64, 64, tiles))
    tiled = gltf.add("materials", plain(1, 1, 1))
    gltf.doc["materials"][tiled]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": image}
    wide, deep, near, far = 2.5, -2.5, 3.2, -14
    for shape in (quad((-wide, deep, near), (2 * wide, 0, 0), (0, 0, far - near), 1),
                  quad((-wide, deep, far), (2 * wide, 0, 0), (0, 2.7, 0), 1),
                  quad((-wide, deep, near), (0, 0, far - near), (0, 2.7, 0), 1),
                  quad((wide, deep, far), (0, 0, near - far), (0, 2.7, 0), 1),
                  quad((wide, deep, near), (-2 * wide, 0, 0), (0, 2.7, 0), 1)):
        corners, normals, uvs, triangles = shape
        u, v = size_of(corners)
        uvs = [rounded(a * u, b * v) for a, b in uvs]
        gltf.node(mesh=gltf.mesh((corners, normals, uvs, triangles), tiled))
    lamp = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.9, 0.75], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 130}}))
    steel = gltf.add("materials", metal(0.8, 0.8, 0.82, 0.2))
    for side in (-1, 1):
        turn = turned((0, 0, 1), -90 * side)[0]
        for k in range(4):
            at = rounded(side * (wide - 0.02), -1.25, 1 - 4 * k)
            gltf.node(**gltf.shape("disc", lamp, {"translation": at, "rotation": [
                turn[0], turn[1], -turn[2], turn[3]]}, radius=0.16))
            gltf.node(**gltf.shape("torus", steel, {"translation": at, "rotation": turn},
                                   radius=0.18, tube=0.03))
    for x in (-0.3, 0.3):
        gltf.node(**gltf.shape("cylinder", steel, {"translation": rounded(-wide + 0.15, -0.7, x - 4)},
                               radius=0.025, height=2))
    for k in range(5):
        gltf.node(**gltf.shape("cylinder", steel, {
            "translation": rounded(-wide + 0.15, -0.4 - 0.28 * k, -4),
            "rotation": turned((1, 0, 0), 90)[0]}, radius=0.02, height=0.6))


def size_of(corners):
    """Lengths of the edges of a quad, in metres."""
    return [math.dist(corners[0], corners[1]), math.dist(corners[0], corners[3])]


def tiles(x, y):
    """Four by four tiles per metre."""
    if x % 16 < 1 or y % 16 < 1:
        return (150, 150, 145)
    shade = 0.9 + 0.1 * ((x // 16 * 7 + y // 16 * 5 + x // 16 * (y // 16) * 3) % 6) / 5
    return tuple(int(shade * c) for c in (222, 232, 236))
