"""Scenes with materials and procedural textures."""

import math

from maker.gltf import Gltf
from maker.looks import glass, metal, plain, png, solid
from maker.meshes import quad, rounded, sphere, torus
from maker.settings import camera, room


def materials():
    """One object for each extension that adds a layer or a lobe to the material."""
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


def textures():
    """A panel for each pattern of TESSERA_texture, and a ball with noise as a bump map."""
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


def optics():
    """Above, metals by index of refraction; below, rough diffuse beside Lambert and exact Fresnel
    beside Schlick."""
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


def nested():
    """Nested solids in front of an emissive board: water that overlaps its tumbler, water with an
    air gap around it, a bubble in a glass ball, a diamond ball in a water ball."""
    gltf = Gltf()
    gltf.use("TESSERA_material", "TESSERA_medium", "KHR_materials_transmission",
             "KHR_materials_volume", "KHR_materials_ior", "KHR_materials_emissive_strength")
    stripes = gltf.texture(png(64, 32, lambda x, y: (
        (235, 226, 205) if (x // 4 + y // 4) % 2 else (60, 96, 128))))
    board = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 1, 1],
                                        emissiveTexture={"index": stripes}, extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 1.6}}))
    gltf.node(mesh=gltf.mesh(quad((-3, 0, -1.6), (6, 0, 0), (0, 3, 0)), board))
    table = gltf.add("materials", plain(0.4, 0.38, 0.36))
    gltf.node(mesh=gltf.mesh(quad((-3, 0, 3), (6, 0, 0), (0, 0, -4.6)), table))
    panel = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.95, 0.9], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 5}}))
    gltf.node(mesh=gltf.mesh(quad((-2, 3.2, -0.5), (4, 0, 0), (0, 0, 3)), panel))
    glassy = gltf.add("materials", solid(1.5, 3))
    water = gltf.add("materials", solid(1.333, 2, {"absorption": [1.6, 0.35, 0.2]}))
    air = gltf.add("materials", solid(1.0, 4))
    diamond = gltf.add("materials", solid(2.42, 5))

    def tumbler(x, reach):
        gltf.doc["scenes"][0]["nodes"].append(gltf.csg(
            "subtraction",
            gltf.shape("cylinder", glassy, {"translation": [0, 0.5, 0]}, radius=0.34, height=1),
            gltf.shape("cylinder", glassy, {"translation": [0, 0.58, 0]}, radius=0.3, height=1),
            translation=[x, 0.001, 0]))
        low, high = 0.081 - reach, 0.75
        gltf.node(**gltf.shape(
            "cylinder", water, {"translation": rounded(x, (low + high) / 2, 0)},
            radius=rounded(0.3 + reach)[0], height=rounded(high - low)[0]))
    tumbler(-1.2, 0.005)
    tumbler(-0.4, -0.003)
    for x, outer, inner in ((0.45, glassy, air), (1.25, water, diamond)):
        gltf.node(**gltf.shape("sphere", outer, {"translation": [x, 0.36, 0.1]}, radius=0.36))
        gltf.node(**gltf.shape("sphere", inner, {"translation": [x, 0.4, 0.1]}, radius=0.2))
    camera(gltf, (0, 0.95, 4.6), (0, 0.52, 0), 0.39)
    return gltf
