"""Scenes for the benchmark and the tests, loaded by Mitsuba: name -> function(folder, resolution)."""

import pathlib

import mitsuba as mi
import numpy as np

SCENES = pathlib.Path(__file__).resolve().parents[2] / "scenes"


def knot_file(folder, around, across):
    """A PLY file of a tube along a trefoil knot, of 2 x around x across triangles."""
    file = pathlib.Path(folder) / f"knot_{around}_{across}.ply"
    if file.exists():
        return file
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
    mesh = mi.Mesh("knot", around * across, len(triangles))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = tube.astype(np.float32).ravel()
    parameters["faces"] = triangles.astype(np.uint32).ravel()
    parameters.update()
    mesh.write_ply(str(file))
    return file


def _frame(resolution, origin=(0, 2.5, 6)):
    t = mi.ScalarTransform4f
    return {
        "type": "scene",
        "camera": {
            "type": "perspective", "fov": 42, "to_world": t().look_at(origin, [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": resolution, "height": resolution, "rfilter": {"type": "box"}},
        },
        "floor": {"type": "rectangle", "to_world": t().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(5)},
    }


def _lamp(place, size):
    t = mi.ScalarTransform4f
    return {"type": "rectangle", "to_world": t().look_at(place, [0, 0, 0], [0, 0, 1]).scale(size),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [12, 11, 10]}}}


def cornell(folder, resolution):
    """No mesh of 256 triangles, so no fields."""
    description = mi.cornell_box()
    description["sensor"]["film"].update(width=resolution, height=resolution, rfilter={"type": "box"})
    return mi.load_dict(description)


def knot(folder, resolution, around=1000, across=50):
    """A knot of 100,000 triangles, by default, under a rectangle."""
    file = knot_file(folder, around, across)
    return mi.load_dict({
        **_frame(resolution),
        "lamp": _lamp([2, 4, 1], 0.8),
        "knot": {"type": "ply", "filename": str(file), "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.4, 0.2]}}},
    })


def million(folder, resolution):
    """The same of 1,000,000 triangles."""
    return knot(folder, resolution, 5000, 100)


def groups(folder, resolution):
    """Twelve instances of two shape groups, one with a ball beside the knot, under a sky and a small ball that shines."""
    t = mi.ScalarTransform4f
    file = str(knot_file(folder, 200, 20))
    scene = _frame(resolution, (0, 5, 7))
    scene["floor"]["bsdf"] = {"type": "roughconductor", "alpha": 0.4}
    scene |= {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.3}},
        "lamp": {"type": "sphere", "center": [2, 4, 2], "radius": 0.4,
                 "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 15}}},
        "both": {"type": "shapegroup", "knot": {"type": "ply", "filename": file},
                 "ball": {"type": "sphere", "radius": 0.4}},
        "alone": {"type": "shapegroup", "knot": {"type": "ply", "filename": file}},
        "column": {"type": "cylinder", "p0": [0, -1, -3], "p1": [0, 2, -3], "radius": 0.3},
        "plate": {"type": "disk", "to_world": t().translate([0, 2, -3]).rotate([1, 0, 0], -90).scale(0.8)},
    }
    for i in range(12):
        place = t().translate([1.5 * (i % 4) - 2.25, -0.5, 1.5 * (i // 4) - 1.5]).rotate([0, 1, 0], 31 * i).scale(0.45)
        scene[f"instance_{i}"] = {"type": "instance", "to_world": place,
                                  "group": {"type": "ref", "id": "alone" if i % 3 else "both"}}
    return mi.load_dict(scene)


def _of_file(name):
    return lambda folder, resolution: mi.load_file(str(SCENES / f"{name}.xml"), resolution=str(resolution))


EXAMPLES = {
    "cornell": cornell,
    "knot": knot,
    "million": million,
    "groups": groups,
    "rectangle_light_box": _of_file("rectangle_light_box"),
    "sphere_light_plane": _of_file("sphere_light_plane"),
    "point_directional_constant": _of_file("point_directional_constant"),
}
