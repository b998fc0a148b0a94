"""Scenes made at random, of four kinds, so that nothing is tuned to a scene that somebody chose.

The same kind and number always give the same scene. Objects are of about unit size, on or over a floor at y = 0, or in
the air. Skies are of mean radiance 2.
"""

import math
import random

from . import frame_scenes

# What `fieldtrace mesh` makes, as arguments.
MESHES = ("knot", "knot --p 3 --q 4 --along 1024", "supershape", "supershape --m 5 --n1 0.4 --n2 1.7 --n3 1.7",
          "supershape --m 7 --n1 0.6 --n2 1.2 --n3 1.2", "hyperboloid", "sphere", "cube", "comb", "globe", "hairs",
          "holes")
KINDS = ("sky", "bounces", "room", "lamps")
HORIZONS, ZENITHS, GROUNDS = (1.0, 3.0, 30.0), (0.2, 1.0, 1.0), (0.02, 0.2, 0.5)


def rgbe(colour):
    largest = max(colour)
    if largest < 1e-30:
        return bytes(4)
    exponent = math.frexp(largest)[1]
    return bytes([*(min(255, int(c * 256.0 / 2.0**exponent)) for c in colour), exponent + 128])


def write_sky(path, pick, width=256):
    """An environment map of mean radiance 1: a bright or even horizon, a ground, none to two suns or broad spots."""
    height = width // 2
    horizon, zenith, ground = pick.choice(HORIZONS), pick.choice(ZENITHS), pick.choice(GROUNDS)
    sharpness = pick.choice((2.0, 8.0, 30.0))
    spots = []  # direction, angular radius, radiance
    for _ in range(pick.choice((0, 1, 1, 2))):
        elevation, azimuth = math.radians(pick.uniform(10.0, 80.0)), pick.uniform(0.0, 2.0 * math.pi)
        radius = math.radians(pick.choice((1.5, 3.0, 8.0, 20.0)))
        d = (math.cos(elevation) * math.sin(azimuth), math.sin(elevation), math.cos(elevation) * math.cos(azimuth))
        spots.append((d, math.cos(radius), pick.uniform(0.5, 3.0) / (1.0 - math.cos(radius))))
    rows, total, weights = [], 0.0, 0.0
    for y in range(height):
        theta = math.pi * (y + 0.5) / height
        weight, row = math.sin(theta), []
        for x in range(width):
            phi = 2.0 * math.pi * (x + 0.5) / width
            d = (math.sin(phi) * weight, math.cos(theta), -math.cos(phi) * weight)
            value = ground if d[1] < 0.0 else zenith + horizon * math.exp(-sharpness * d[1])
            value += sum(r for s, cosine, r in spots if sum(a * b for a, b in zip(s, d)) > cosine)
            row.append(value)
            total, weights = total + weight * value, weights + weight
        rows.append(row)
    scale = weights / total
    tint = [pick.uniform(0.8, 1.0) for _ in range(3)]
    data = b"".join(rgbe([scale * v * t for t in tint]) for row in rows for v in row)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    path.write_bytes(head + data)


def placed(pick, on_floor, spread):
    """A transform that turns, squashes and sometimes mirrors an object of unit radius, and its place."""
    scale = pick.uniform(0.3, 0.9)
    squash = [scale * pick.uniform(0.5, 1.3) if pick.random() < 0.4 else scale for _ in range(3)]
    if pick.random() < 0.2:
        squash[0] = -squash[0]
    reach = max(abs(s) for s in squash)
    x, z = pick.uniform(-spread, spread), pick.uniform(-spread, spread)
    y = reach * pick.uniform(0.55, 1.0) if on_floor else pick.uniform(-0.6, 1.2)
    turned = "".join(frame_scenes.rotate(axis, pick.uniform(0, 360)) for axis in ("x", "y", "z") if pick.random() < 0.6)
    return f'<scale x="{squash[0]}" y="{squash[1]}" z="{squash[2]}"/>{turned}{frame_scenes.translate(x, y, z)}'


def material(pick, glossy_share):
    colour = ", ".join(f"{pick.uniform(0.2, 0.8):.3f}" for _ in range(3))
    if pick.random() < glossy_share:
        return (f'<bsdf type="twosided"><bsdf type="roughplastic">'
                f'<float name="alpha" value="{pick.choice((0.1, 0.2, 0.4))}"/>'
                f'<rgb name="diffuse_reflectance" value="{colour}"/></bsdf></bsdf>')
    return frame_scenes.material(colour)


def thing(path, transform, look):
    return (f'<shape type="ply"><string name="filename" value="{path}"/>'
            f'<transform name="to_world">{transform}</transform>{look}</shape>')


def square(transform, inner):
    return f'<shape type="rectangle"><transform name="to_world">{transform}</transform>{inner}</shape>'


def lamps(pick, count):
    """Spheres and squares above the objects, turned to the middle; together they light the floor as FLOOR says."""
    lights = []
    for _ in range(count):
        azimuth, height = pick.uniform(0.0, 2.0 * math.pi), pick.uniform(2.5, 6.0)
        across = pick.uniform(1.0, 5.0)
        place = (across * math.cos(azimuth), height, across * math.sin(azimuth))
        degrees, share = math.exp(pick.uniform(math.log(1.0), math.log(40.0))), pick.uniform(0.5, 2.0) / count
        kind = pick.choice((frame_scenes.rectangle_light, frame_scenes.sphere_light))
        lights.append(kind(degrees, place, share))
    return lights


def room(pick, look):
    """The walls of a box of 4 x 3 x 4, open in front, and on the right, above or nowhere else."""
    half, height = 2.0, 3.0
    walls = [frame_scenes.rotate("x", -90) + f'<scale value="{half}"/>',
             f'<scale x="{half}" y="{height / 2}"/>' + frame_scenes.translate(0, height / 2, -half),
             f'<scale x="{half}" y="{height / 2}"/>' + frame_scenes.rotate("y", 90)
             + frame_scenes.translate(-half, height / 2, 0)]
    right = (f'<scale x="{half}" y="{height / 2}"/>' + frame_scenes.rotate("y", -90)
             + frame_scenes.translate(half, height / 2, 0))
    ceiling = frame_scenes.rotate("x", 90) + f'<scale value="{half}"/>' + frame_scenes.translate(0, height, 0)
    left_out = pick.choice((0, 1, 2))
    walls += [w for i, w in enumerate((right, ceiling)) if i != left_out]
    return [square(w, look(0.0)) for w in walls]


def make(kind, seed, folder, mesh_of, size=(400, 320)):
    """The text of scene `seed` of a kind. `mesh_of(words)`: the path of a mesh; the sky is written into `folder`."""
    pick = random.Random(f"{kind} {seed}")
    look = lambda glossy_share: material(pick, glossy_share)
    glossy = pick.choice((0.0, 0.0, 0.3))
    shapes, lights = [], []
    closed = kind == "room"
    on_floor = closed or pick.random() < 0.8
    if closed:
        shapes += room(pick, look)
    elif on_floor:
        shapes.append(square(frame_scenes.rotate("x", -90) + '<scale value="10"/>', look(0.0)))
        for angle in pick.sample((0, 90, 180), pick.choice((0, 0, 1, 2)) if kind == "bounces" else 0):
            shapes.append(square('<scale value="3"/>' + frame_scenes.translate(0, 1.5, -2.2)
                                 + frame_scenes.rotate("y", angle), look(0.0)))
    for _ in range(pick.choice((1, 2, 3, 5, 8))):
        shapes.append(thing(mesh_of(pick.choice(MESHES)), placed(pick, on_floor, 1.2 if closed else 1.8), look(glossy)))
    if kind == "lamps":
        lights += lamps(pick, pick.choice((1, 1, 2, 3, 6)))
    else:
        if pick.random() < 0.25:
            lights.append(frame_scenes.constant_sky())
        else:
            sky = folder / f"sky-{kind}-{seed}.hdr"
            write_sky(sky, pick)
            lights.append(frame_scenes.mapped_sky(sky, 1.0 / frame_scenes.REFLECTANCE))
        if pick.random() < 0.2:
            lights += lamps(pick, 1)
    depth = 2 if kind in ("sky", "lamps") else pick.choice((3, 3, 4, 6, -1))
    azimuth = pick.uniform(-0.6, 0.6) if closed or kind == "bounces" else pick.uniform(-math.pi, math.pi)
    away, height = pick.uniform(5.0, 8.0), pick.uniform(0.8, 4.0)
    origin = frame_scenes.vector((away * math.sin(azimuth), height, away * math.cos(azimuth)))
    return frame_scenes.scene(shapes, lights, size[0], height=size[1], origin=origin, target="0, 0.7, 0",
                              max_depth=depth, fov=pick.choice((30, 40, 50)))
