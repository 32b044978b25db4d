"""Scenes with depth of field, camera projections and motion blur."""

import math

from maker.gltf import Gltf, VERTICES
from maker.looks import metal, mosaic, plain, png
from maker.meshes import grid, quad, rounded, sphere, torus
from maker.settings import look_at, room, turned


def lens():
    """Depth of field: balls on a table, focused on the middle one, lights far behind."""
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
    """One room, with a camera for each projection of TESSERA_camera."""
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


def motion():
    """Motion blur: a flying ball, a rotating wheel and CSG die, a flag (morph targets), a reed
    (skinning), and static and moving cameras."""
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

    tracks = []  # channels of the animation: node, path, type, keys at 0 s and 1 s

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


def moving_lamp():
    """An animation to be denoised: a small lamp and a ball cross a room, and a camera that stands and
    one that drives through it. 24 frames."""
    gltf = Gltf()
    room(gltf, gltf.add("materials", {"pbrMetallicRoughness": {
        "baseColorTexture": {"index": gltf.texture(png(64, 64, mosaic))},
        "metallicFactor": 0, "roughnessFactor": 0.6}}))
    spark = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.7, 0.35], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 220}}))
    lamp = gltf.node(mesh=gltf.mesh(sphere(0.07, 8), spark))
    clay = gltf.add("materials", plain(0.3, 0.55, 0.4))
    ball = gltf.node(mesh=gltf.mesh(sphere(0.35, 12), clay))
    gltf.node(mesh=gltf.mesh(torus(0.5, 0.16, 12), gltf.add("materials", metal(1.0, 0.72, 0.32, 0.5))),
              translation=[0.9, 0.9, -1.2], rotation=turned((1, 0, 0), 70)[0])
    eyes = []
    for name, eye in (("still", (0, 1.5, 5.6)), ("driving", (-0.5, 1.5, 5.6))):
        index = gltf.add("cameras", {"name": name, "type": "perspective",
                                     "perspective": {"yfov": 0.62, "znear": 0.01}})
        eyes.append(gltf.node(camera=index, translation=list(eye),
                              rotation=look_at(eye, (eye[0], 1.3, 0))))
    times = gltf.floats([[0.0], [1.0]], "SCALAR", bounds=True, target=None)
    samplers, channels = [], []
    for node, places in ((lamp, [[-1.6, 0.5, -1.1], [1.6, 1.5, -0.3]]),
                         (ball, [[0.9, 0.35, 0.9], [-1.1, 0.35, 0.6]]),
                         (eyes[1], [[-0.5, 1.5, 5.6], [0.5, 1.5, 5.0]])):
        samplers.append({"input": times, "output": gltf.floats(places, "VEC3", target=None)})
        channels.append({"sampler": len(samplers) - 1,
                         "target": {"node": node, "path": "translation"}})
    gltf.add("animations", {"samplers": samplers, "channels": channels})
    return gltf
