"""A knot over a floor: a picture, and what Fieldtrace answers to numpy. Run it whole, or cell by cell.

    python soft_shadows.py [PICTURE.png]
"""

# %% A torus knot of 20,000 triangles, and a floor below it.
import sys

import matplotlib.pyplot as plt
import numpy as np

import fieldtrace


def torus_knot(around=400, across=25, p=2, q=3, thickness=0.25):
    """Positions and triangles of a tube along a (p, q) torus knot."""
    u = np.linspace(0, 2 * np.pi, around, endpoint=False)

    def curve(u):
        r = 1 + 0.4 * np.cos(q * u)
        return np.stack([r * np.cos(p * u), 0.5 * np.sin(q * u), r * np.sin(p * u)], -1)

    centre, step = curve(u), 1e-3
    along = curve(u + step) - curve(u - step)
    bend = curve(u + step) + curve(u - step) - 2 * centre
    binormal = np.cross(along, bend)
    binormal /= np.linalg.norm(binormal, axis=1, keepdims=True)
    normal = np.cross(binormal, along)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    v = np.linspace(0, 2 * np.pi, across, endpoint=False)[:, None]
    tube = centre[:, None] + thickness * (np.cos(v) * normal[:, None] + np.sin(v) * binormal[:, None])
    a = np.arange(around * across).reshape(around, across)
    b, c, d = np.roll(a, -1, 0), np.roll(a, (-1, -1), (0, 1)), np.roll(a, -1, 1)
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return tube.reshape(-1, 3), triangles


scene = fieldtrace.Scene()
scene.set(directions=32, plane=64)  # coarse fields
knot = scene.add_instance(scene.add_mesh(*torus_knot()))
corners = [[-4, -1, -4], [-4, -1, 4], [4, -1, 4], [4, -1, -4]]
floor = scene.add_instance(scene.add_mesh(corners, [[0, 1, 2], [0, 2, 3]]))
scene.set_reflectance(knot, (0.8, 0.4, 0.2))
scene.set_sky(1.0)
eye, width, height = np.array([0, 2.2, 4.5]), 160, 120
scene.set_camera(eye, (0, 0, 0), fov=55, width=width, height=height)
scene.set(spp=16)
scene.commit()

# %% What the floor sees of a lamp and of the sky. Points are a grid, and so are the answers.
x, z = np.meshgrid(np.linspace(-3, 3, 200), np.linspace(-3, 3, 200))
points = np.stack([x, np.full_like(x, -1), z], -1)
lamp = fieldtrace.Light.rectangle((1, 4, 1), (0.7, 0, 0), (0, 0, 0.7))  # u x v points down
of_lamp = scene.light_visibility(points, (0, 1, 0), lamp, from_instances=floor)
of_sky = scene.sky_visibility(points, (0, 1, 0), from_instances=floor)
print(f"lamp: {of_lamp.shares.mean():.1%} seen, {of_lamp.certain.mean():.1%} certified")
print(f"sky: {of_sky.shares.mean():.1%} seen, {of_sky.certain.mean():.1%} certified")

# %% Hits of camera rays, as far as fields certify them within a tenth of the distance. Fields are baked where rays come
# back to the same places; these come once, so all is baked ahead of them.
scene.bake()
forward = -eye / np.linalg.norm(eye)
right = np.cross(forward, (0, 1, 0)) / np.linalg.norm(np.cross(forward, (0, 1, 0)))
up = np.cross(right, forward)
half = np.tan(np.radians(55) / 2)
u, v = np.meshgrid(np.linspace(-half, half, width), np.linspace(half, -half, height) * height / width)
hits = scene.nearest(eye, forward + u[..., None] * right + v[..., None] * up, max_error=0.1)
undecided = hits.status == fieldtrace.Hit.UNDECIDED
print(f"{undecided.mean():.1%} of the camera rays are undecided")

# %% The picture.
picture = scene.render()
depth = np.where(hits.status == fieldtrace.Hit.HIT, hits.t, np.nan)
figure, axes = plt.subplots(2, 2, figsize=(9, 7.5), layout="constrained")
axes[0, 0].imshow(np.clip(picture, 0, 1) ** (1 / 2.2))
axes[0, 0].set_title("render(), under a sky")
axes[0, 1].imshow(depth, cmap="viridis_r")
axes[0, 1].imshow(np.ma.masked_where(~undecided, undecided), cmap="Reds", vmin=0, vmax=1)
axes[0, 1].set_title("nearest(): depth; red: undecided")
axes[1, 0].imshow(of_lamp.shares, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(-3, 3, -3, 3))
axes[1, 0].set_title("light_visibility() of the floor")
axes[1, 1].imshow(of_sky.shares, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(-3, 3, -3, 3))
axes[1, 1].set_title("sky_visibility() of the floor")
for a in axes.flat:
    a.set_xticks([]), a.set_yticks([])
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "soft_shadows.png", dpi=100)
