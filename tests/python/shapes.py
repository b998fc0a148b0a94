"""Meshes of the tests, and rays traced without a library."""

import numpy as np


def torus(around=48, across=24, radius=1.0, thickness=0.4):
    """Positions (n, 3) and triangles (m, 3), about the z axis."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, around, endpoint=False),
                       np.linspace(0, 2 * np.pi, across, endpoint=False), indexing="ij")
    r = radius + thickness * np.cos(v)
    positions = np.stack([r * np.cos(u), r * np.sin(u), thickness * np.sin(v)], -1).reshape(-1, 3)
    a = np.arange(around * across).reshape(around, across)
    b, c, d = np.roll(a, -1, 0), np.roll(a, (-1, -1), (0, 1)), np.roll(a, -1, 1)
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return positions.astype(np.float32), triangles.astype(np.uint32)


def sheet(y=0.0, half=1.0):
    """A square that faces up."""
    corners = [[-half, y, -half], [-half, y, half], [half, y, half], [half, y, -half]]
    return np.array(corners, np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def rays(count, seed, size=2.5):
    """Origins in a box and directions of any length."""
    random = np.random.default_rng(seed)
    origins = random.uniform(-size, size, (count, 3)).astype(np.float32)
    directions = (random.uniform(-size, size, (count, 3)) - origins).astype(np.float32)
    return origins, directions


def brute_force(triangles, origins, directions):
    """Nearest t (inf: none), its triangle, and whether another answer lies within rounding: edges, ends.

    triangles (m, 3, 3) in world space. Double precision, Moeller and Trumbore.
    """
    a, b, c = (triangles[:, k].astype(np.float64) for k in range(3))
    t = np.full(len(origins), np.inf)
    which = np.full(len(origins), -1)
    doubtful = np.zeros(len(origins), bool)
    for i, (o, d) in enumerate(zip(origins.astype(np.float64), directions.astype(np.float64))):
        p = np.cross(d, c - a)
        determinant = np.einsum("ij,ij->i", b - a, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1 / determinant
            s = o - a
            u = np.einsum("ij,ij->i", s, p) * inverse
            q = np.cross(s, b - a)
            v = q @ d * inverse
            along = np.einsum("ij,ij->i", c - a, q) * inverse
        # Distances to the edges in barycentric coordinates, and to the origin in t: single precision is 1e3 finer.
        margin = np.minimum(np.minimum(u, v), 1 - u - v)
        near = np.abs(margin) < 1e-4
        doubtful[i] = np.any(near & (along > -1e-4)) or np.any((margin > -1e-4) & (np.abs(along) < 1e-4))
        hit = (margin > 0) & (along > 0)
        if hit.any():
            which[i] = np.argmin(np.where(hit, along, np.inf))
            t[i] = along[which[i]]
    return t, which, doubtful
