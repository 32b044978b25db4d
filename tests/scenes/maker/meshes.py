"""Procedural meshes: each is (positions, normals, uvs, triangles), as Gltf.mesh() takes them."""

import math


def rounded(*values):
    return [round(value, 6) + 0.0 for value in values]


def quad(origin, edge_u, edge_v, repeat=1):
    """A parallelogram; its front faces edge_u x edge_v."""
    normal = [edge_u[1] * edge_v[2] - edge_u[2] * edge_v[1],
              edge_u[2] * edge_v[0] - edge_u[0] * edge_v[2],
              edge_u[0] * edge_v[1] - edge_u[1] * edge_v[0]]
    length = math.sqrt(sum(x * x for x in normal))
    normal = rounded(*(x / length for x in normal))
    corners, uvs = [], []
    for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
        corners.append(rounded(*(o + u * a + v * b for o, a, b in zip(origin, edge_u, edge_v))))
        uvs.append([float(u * repeat), float((1 - v) * repeat)])
    return corners, [normal] * 4, uvs, [(0, 1, 2), (0, 2, 3)]


def grid(rows, columns, point):
    """A closed surface over (u, v) in [0,1]^2; point(u, v) gives position and normal."""
    positions, normals, uvs = [], [], []
    for row in range(rows + 1):
        for column in range(columns + 1):
            u, v = column / columns, row / rows
            position, normal = point(u, v)
            positions.append(rounded(*position))
            normals.append(rounded(*normal))
            uvs.append(rounded(u, v))
    triangles = []
    for row in range(rows):
        for column in range(columns):
            a = row * (columns + 1) + column
            b = a + columns + 1
            for triangle in ((a, a + 1, b), (a + 1, b + 1, b)):
                if len({tuple(positions[i]) for i in triangle}) == 3:  # skips degenerate triangles at the poles
                    triangles.append(triangle)
    return positions, normals, uvs, triangles


def sphere(radius, rows):
    def point(u, v):
        theta, phi = math.pi * v, 2 * math.pi * u
        normal = (math.sin(theta) * math.cos(phi), math.cos(theta),
                  -math.sin(theta) * math.sin(phi))
        return [radius * x for x in normal], normal
    return grid(rows, 2 * rows, lambda u, v: flipped(point, u, v))


def torus(major, minor, rows):
    def point(u, v):
        around, across = 2 * math.pi * u, 2 * math.pi * v
        normal = (math.cos(across) * math.cos(around), math.sin(across),
                  math.cos(across) * math.sin(around))
        centre = (major * math.cos(around), 0, major * math.sin(around))
        return [c + minor * n for c, n in zip(centre, normal)], normal
    return grid(rows, 2 * rows, lambda u, v: flipped(point, u, v))


def flipped(point, u, v):
    """Reverses v, so that triangles of grid() are counter-clockwise seen from outside."""
    return point(u, 1 - v)


def joined(*shapes):
    """Merges several meshes into one."""
    positions, normals, uvs, triangles = [], [], [], []
    for shape in shapes:
        first = len(positions)
        positions += shape[0]
        normals += shape[1]
        uvs += shape[2]
        triangles += [tuple(first + index for index in triangle) for triangle in shape[3]]
    return positions, normals, uvs, triangles
