"""Scenes with shapes, CSG solids and blobs."""

import math

from maker.gltf import Gltf
from maker.looks import glass, metal, mosaic, plain, png
from maker.meshes import quad, rounded, torus
from maker.settings import camera, room


def shapes():
    """Every analytic shape once; the light is a sphere."""
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
    """CSG by union, intersection, subtraction and xor: a lens, a die, a cut mesh."""
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
        # A lens: the intersection of two balls.
        gltf.csg("intersection", ball(0.8, sea, 0, 0, 0.65), ball(0.8, sea, 0, 0, -0.65),
                 translation=[0.9, 0.55, 1.2]),
        # A rounded cube with three holes of another material.
        gltf.csg("subtraction",
                 gltf.csg("intersection", block([0.9, 0.9, 0.9], ivory), ball(0.6, ivory, 0, 0, 0)),
                 gltf.csg("union", rod(0.25, 2, red), rod(0.25, 2, red, rotation=on_side),
                          rod(0.25, 2, red, rotation=to_front)),
                 translation=[-0.9, 0.47, 0.2], rotation=[0, 0.3007058, 0, 0.953717]),
        # Coincident faces: the union of two blocks.
        gltf.csg("union", block([0.5, 0.4, 0.4], sea), block([0.5, 0.4, 0.4], sea,
                                                             translation=[0, 0.4, 0]),
                 translation=[1.4, 0.22, -0.6]),
        # Inside exactly one of two.
        gltf.csg("xor", block([0.6, 0.5, 0.4], gold), ball(0.36, red, 0.2, 0.15, 0.1),
                 translation=[0.25, 0.27, -0.4]),
        # A closed mesh minus a shape.
        gltf.csg("subtraction", {"mesh": gltf.mesh(torus(0.4, 0.18, 24), gold)},
                 block([0.5, 1, 0.5], red, translation=[0.35, 0, 0.35]),
                 translation=[-0.5, 0.2, 1.3]),
    ]
    gltf.doc["scenes"][0]["nodes"] += roots
    camera(gltf, (0, 1.62, 6.6), (0, 1.0, 0), 0.55)
    return gltf


def blobs():
    """Merging blobs: one with dents, one of glass, one cut by a box, one moving."""
    gltf = Gltf()
    room(gltf, gltf.add("materials", plain(0.5, 0.5, 0.52)))
    gltf.use("KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume",
             "KHR_animation_pointer")
    clay = gltf.add("materials", plain(0.75, 0.32, 0.18))
    gold = gltf.add("materials", metal(0.95, 0.75, 0.35, 0.15))
    sea = gltf.add("materials", glass([0.5, 0.85, 0.8]))
    ivory = gltf.add("materials", plain(0.8, 0.75, 0.6))
    green = gltf.add("materials", plain(0.2, 0.5, 0.25))
    # Two blobs whose neck narrows from left to right until they separate.
    for k, apart in enumerate((1.2, 1.45, 1.58, 1.64)):
        half = apart * 0.35 / 2
        gltf.node(**gltf.blobs(clay, ((0, -half, 0), 0.35, 1), ((0, half, 0), 0.35, 1),
                               translation=rounded(-1.5 + k, 1.55, -1.2)))
    # A foot and a body made of drops.
    drops = [((0, 0.06, 0), (0.8, 0.22, 0.6), 1)]
    for k in range(7):
        angle = k * 2.4
        drops.append((rounded(0.09 * k * math.cos(angle) * 0.6, 0.2 + 0.11 * k,
                              0.09 * k * math.sin(angle) * 0.6), round(0.36 - 0.022 * k, 3), 1))
    body = gltf.node(**gltf.blobs(green, *drops, translation=[-1.15, 0.08, 0.1]))
    # A ball with dents.
    dents = [((0, 0, 0), 0.8, 1.5)]
    for k in range(12):
        y = 1 - (2 * k + 1) / 12
        r = math.sqrt(1 - y * y)
        dents.append((rounded(0.6 * r * math.cos(2.4 * k), 0.6 * y, 0.6 * r * math.sin(2.4 * k)),
                      0.24, -0.7))
    gltf.node(**gltf.blobs(gold, *dents, translation=[0.2, 0.62, 0.1]))
    gltf.node(**gltf.blobs(sea, ((-0.22, 0, 0), 0.42, 1), ((0.22, 0, 0.05), 0.42, 1),
                           ((0, 0.3, 0), 0.36, 1), translation=[-0.45, 0.31, 1.4]))
    # A blob with a part cut out, which shows its inside.
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


def lamps():
    """Area lights, each in a niche with a post and a ball: a ball, a disc, a rectangle, a thin
    upright tube, a cone."""
    gltf = Gltf()
    gltf.use("KHR_materials_emissive_strength")
    plaster = gltf.add("materials", plain(0.72, 0.7, 0.66))
    clay = gltf.add("materials", plain(0.7, 0.35, 0.2))
    steel = gltf.add("materials", metal(0.85, 0.85, 0.87, 0.25))
    gltf.node(mesh=gltf.mesh(quad((-3.1, 0, 2), (6.2, 0, 0), (0, 0, -3.2)), plaster))
    gltf.node(mesh=gltf.mesh(quad((-3.1, 0, -1.2), (6.2, 0, 0), (0, 2.2, 0)), plaster))
    for k in range(6):
        gltf.node(**gltf.shape("box", plaster, {"translation": rounded(-3 + 1.2 * k, 1.1, -0.4)},
                               size=[0.08, 2.2, 1.6]))

    def glow(color, strength):
        return gltf.add("materials", plain(0, 0, 0, emissiveFactor=list(color), extensions={
            "KHR_materials_emissive_strength": {"emissiveStrength": strength}}))
    down = [1, 0, 0, 0]  # half a turn about x
    for k, (kind, color, strength, node, dimensions) in enumerate((
            ("sphere", (1, 0.8, 0.55), 60, {"translation": [0, 1.75, -0.35]}, {"radius": 0.1}),
            ("disc", (0.75, 0.85, 1), 20, {"translation": [0, 1.9, -0.5], "rotation": down},
             {"radius": 0.3}),
            ("rectangle", (1, 0.95, 0.85), 24,
             {"translation": [0, 1.9, -0.5], "rotation": down}, {"size": [0.9, 0.15]}),
            ("cylinder", (0.35, 0.8, 1), 70, {"translation": [-0.38, 1.05, -0.75]},
             {"radius": 0.012, "height": 1.8}),
            ("cone", (1, 0.6, 0.5), 45, {"translation": [0.05, 1.65, -0.45]},
             {"radius": 0.07, "height": 0.8}))):
        x = -2.4 + 1.2 * k
        node["translation"] = rounded(x + node["translation"][0], *node["translation"][1:])
        gltf.node(**gltf.shape(kind, glow(color, strength), node, **dimensions))
        gltf.node(**gltf.shape("cylinder", clay, {"translation": rounded(x - 0.1, 0.4, -0.35)},
                               radius=0.07, height=0.8))
        gltf.node(**gltf.shape("sphere", steel, {"translation": rounded(x + 0.22, 0.18, 0)},
                               radius=0.18))
    camera(gltf, (0, 1.3, 6.4), (0, 1.03, 0), 0.42)
    return gltf
