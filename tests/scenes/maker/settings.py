"""Elements shared by scenes: a room, a sky and camera orientations."""

import math

from maker.looks import plain, png
from maker.meshes import grid, quad, rounded


def look_at(eye, target):
    """Rotation quaternion (x, y, z, w) of a camera that looks from eye to target, up near +Y."""
    back = [e - t for e, t in zip(eye, target)]
    length = math.sqrt(sum(x * x for x in back))
    back = [x / length for x in back]
    yaw = math.atan2(back[0], back[2])
    pitch = -math.asin(back[1])
    sy, cy, sp, cp = math.sin(yaw / 2), math.cos(yaw / 2), math.sin(pitch / 2), math.cos(pitch / 2)
    return rounded(cy * sp, sy * cp, -sy * sp, cy * cp)


def turned(axis, *degrees):
    """Rotation quaternions about an axis."""
    return [rounded(*(math.sin(math.radians(d) / 2) * x for x in axis),
                    math.cos(math.radians(d) / 2)) for d in degrees]


def room(gltf, floor):
    """Five walls of a box 4 x 3 x 4 m, open towards +Z, with an area light of 1.2 x 1.2 m under its ceiling."""
    white = gltf.add("materials", plain(0.75, 0.73, 0.7))
    red = gltf.add("materials", plain(0.62, 0.12, 0.08))
    blue = gltf.add("materials", plain(0.1, 0.2, 0.5))
    gltf.use("KHR_materials_emissive_strength")
    lamp = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.86, 0.66], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": 16}}))
    for shape, material in (
            (quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), floor),
            (quad((-2, 3, -2), (4, 0, 0), (0, 0, 4)), white),
            (quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)), white),
            (quad((-2, 0, 2), (0, 0, -4), (0, 3, 0)), red),
            (quad((2, 0, -2), (0, 0, 4), (0, 3, 0)), blue),
            (quad((-0.6, 2.99, -0.6), (1.2, 0, 0), (0, 0, 1.2)), lamp)):
        gltf.node(mesh=gltf.mesh(shape, material))


def camera(gltf, eye, target, yfov):
    index = gltf.add("cameras", {"type": "perspective",
                                 "perspective": {"yfov": yfov, "znear": 0.01}})
    gltf.node(camera=index, translation=list(eye), rotation=look_at(eye, target))


def evening(toward, up):
    """Colour of the sky, `up` from horizon (0) to zenith (1); `toward` is the cosine of the
    azimuth relative to the sun."""
    rim = (1 - up) ** 5
    glow = (0.5 + 0.5 * toward) ** 3 * (1 - up) ** 2
    color = (0.1 + 0.38 * rim + 0.55 * glow, 0.2 + 0.32 * rim + 0.3 * glow,
             0.42 + 0.2 * rim + 0.04 * glow)
    return tuple(min(255, round(255 * (1.055 * c ** (1 / 2.4) - 0.055))) for c in color)


def sky(gltf, sun, radius, strength):
    """An emissive dome like an evening sky, with the sun at `sun`."""
    gltf.use("KHR_materials_emissive_strength")
    to_sun = math.atan2(sun[2], sun[0])
    picture = gltf.texture(png(128, 32, lambda x, y: evening(
        math.cos(2 * math.pi * (x + 0.5) / 128 - to_sun), 1 - (y + 0.5) / 32)))
    air = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 1, 1],
                                      emissiveTexture={"index": picture}, extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": strength}}))

    def dome(u, v):  # v from the rim, a little below the horizon, to the zenith
        phi, theta = 2 * math.pi * u, math.pi * (0.5 * v - 0.03 * (1 - v))
        out = (math.cos(theta) * math.cos(phi), math.sin(theta), math.cos(theta) * math.sin(phi))
        return [radius * x for x in out], [-x for x in out]
    positions, normals, uvs, triangles = grid(6, 24, dome)
    gltf.node(mesh=gltf.mesh((positions, normals, [rounded(u, 1 - v) for u, v in uvs], triangles),
                             air))


def sun(gltf, place, radius, strength):
    """A low sun, as a ball inside the dome, because the dome would block a directional light."""
    gltf.use("KHR_materials_emissive_strength")
    glow = gltf.add("materials", plain(0, 0, 0, emissiveFactor=[1, 0.76, 0.5], extensions={
        "KHR_materials_emissive_strength": {"emissiveStrength": strength}}))
    gltf.node(**gltf.shape("sphere", glow, {"translation": list(place)}, radius=radius))
