"""Scenes for the benchmark and the tests, loaded by Mitsuba: name -> function(folder, resolution)."""

import pathlib
import sys

import mitsuba as mi

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools/benchmarks"))
import knot_mesh


def knot_file(folder, around, across):
    """A PLY file of a tube along a trefoil knot, of 2 x around x across triangles."""
    file = pathlib.Path(folder) / f"knot_{around}_{across}.ply"
    if file.exists():
        return file
    positions, triangles = knot_mesh.knot(around, across)
    mesh = mi.Mesh("knot", len(positions), len(triangles))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = positions.ravel()
    parameters["faces"] = triangles.ravel()
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
        "knot": {"type": "ply", "filename": str(file),
                 "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.4, 0.2]}}},
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
    return lambda folder, resolution: mi.load_file(str(ROOT / f"scenes/{name}.xml"), resolution=str(resolution))


EXAMPLES = {
    "cornell": cornell,
    "knot": knot,
    "million": million,
    "groups": groups,
    "rectangle_light_box": _of_file("rectangle_light_box"),
    "sphere_light_plane": _of_file("sphere_light_plane"),
    "point_directional_constant": _of_file("point_directional_constant"),
}
