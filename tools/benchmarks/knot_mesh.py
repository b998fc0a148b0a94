"""The mesh of benchmarks in Python."""

import numpy as np


def knot(around, across):
    """A tube along a trefoil knot, of 2 x around x across triangles: positions (n, 3), float32, and triangles, uint32."""
    u = np.linspace(0, 2 * np.pi, around, endpoint=False)

    def curve(u):
        r = 1 + 0.4 * np.cos(3 * u)
        return np.stack([r * np.cos(2 * u), 0.5 * np.sin(3 * u), r * np.sin(2 * u)], -1)

    along = curve(u + 1e-3) - curve(u - 1e-3)
    binormal = np.cross(along, curve(u + 1e-3) + curve(u - 1e-3) - 2 * curve(u))
    binormal /= np.linalg.norm(binormal, axis=1, keepdims=True)
    normal = np.cross(binormal, along)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    v = np.linspace(0, 2 * np.pi, across, endpoint=False)[:, None]
    tube = curve(u)[:, None] + 0.25 * (np.cos(v) * normal[:, None] + np.sin(v) * binormal[:, None])
    a = np.arange(around * across).reshape(around, across)
    b, c, d = np.roll(a, -1, 0), np.roll(a, (-1, -1), (0, 1)), np.roll(a, -1, 1)
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return tube.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)
