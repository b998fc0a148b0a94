"""A Fieldtrace scene of the shapes of a scene that Mitsuba 3 loaded, in a variant of LLVM.

Meshes of any kind (ply, obj, cube, rectangle, ...) and instances of shape groups are taken as they are. Spheres, disks
and cylinders become meshes that lie within them, by at most 7.5e-5 of their radius. Anything else is a NotImplementedError
that names it. The scene is read once: what is changed in it later is not seen.
"""

import collections
import re

import drjit as dr
import mitsuba as mi
import numpy as np

import fieldtrace

SEGMENTS = 256  # of a circle: cos(pi / 256) = 1 - 7.5e-5


def _grid_triangles(rows, columns):
    """Of a grid of rows x columns quads, whose columns close up."""
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    return np.concatenate([np.stack([a, a + columns, b], -1), np.stack([b, a + columns, b + columns], -1)]).reshape(-1, 3)


def _circle(segments=SEGMENTS):
    angles = 2 * np.pi * np.arange(segments) / segments
    return np.cos(angles), np.sin(angles)


def _unit_sphere():
    theta = np.pi * np.arange(SEGMENTS // 2 + 1) / (SEGMENTS // 2)
    x, y = _circle()
    ring, z = np.sin(theta)[:, None], np.cos(theta)[:, None]
    positions = np.stack([ring * x, ring * y, np.broadcast_to(z, (len(theta), SEGMENTS))], -1).reshape(-1, 3)
    return positions, _grid_triangles(SEGMENTS // 2, SEGMENTS)


def _unit_disk():
    x, y = _circle()
    positions = np.concatenate([[[0, 0, 0]], np.stack([x, y, 0 * x], -1)])
    i = np.arange(SEGMENTS)
    return positions, np.stack([0 * i, 1 + i, 1 + (i + 1) % SEGMENTS], -1)


def _unit_cylinder():
    x, y = _circle()
    positions = np.concatenate([np.stack([x, y, 0 * x], -1), np.stack([x, y, 0 * x + 1], -1)])
    return positions, _grid_triangles(1, SEGMENTS)


UNIT_SHAPES = {"Sphere": _unit_sphere, "Disk": _unit_disk, "Cylinder": _unit_cylinder}


def _matrix(transform):
    return np.array(transform.matrix, np.float64).reshape(4, 4)


def _mesh(shape):
    """Positions and triangles: in the world, or the space of a shape group."""
    kind = shape.class_name()
    parameters = mi.traverse(shape)
    if shape.is_mesh():
        positions = shape.vertex_positions_buffer().numpy().reshape(-1, 3)
        return positions, shape.faces_buffer().numpy().reshape(-1, 3)
    if kind not in UNIT_SHAPES:
        raise NotImplementedError(f"shape {shape.id()!r}: Fieldtrace has no {kind}")
    positions, triangles = UNIT_SHAPES[kind]()
    matrix = _matrix(parameters["to_world"])
    return positions @ matrix[:3, :3].T + matrix[:3, 3], triangles


def _registry_id(shape):
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def _groups(scene):
    """Name of a shape group -> its shapes. Instances do not show theirs, but the parameters of the scene do."""
    roots = {_registry_id(shape) for shape in scene.shapes()}
    groups = collections.defaultdict(dict)
    for key, entry in mi.traverse(scene).properties.items():
        shape = entry[2]
        if isinstance(shape, mi.Shape) and _registry_id(shape) not in roots:
            groups[key.split(".")[0]][_registry_id(shape)] = shape
    return groups


class Converted:
    """The scene, committed, and which of its instances a hit of Mitsuba's lies on."""

    def __init__(self, scene, **settings):
        self.scene = fieldtrace.Scene()
        self.scene.set(**settings)
        first, offset = {}, {}  # by Mitsuba's numbers of shapes
        groups, meshes = None, {}
        for shape in scene.shapes():
            number = _registry_id(shape)
            if shape.class_name() != "Instance":
                first[number] = self.scene.add_instance(self.scene.add_mesh(*_mesh(shape)))
                continue
            groups = _groups(scene) if groups is None else groups
            named = re.search(r'name = "([^"]*)"', str(shape))
            name = named.group(1) if named else ""
            if name not in groups:
                raise NotImplementedError(f"instance {shape.id()!r}: its shape group {name!r} is not found; give it an id")
            if name not in meshes:
                meshes[name] = [self.scene.add_mesh(*_mesh(of)) for of in groups[name].values()]
                offset.update({of: i for i, of in enumerate(groups[name])})
            to_world = _matrix(mi.traverse(shape)["to_world"])
            numbers = [self.scene.add_instance(mesh, to_world) for mesh in meshes[name]]
            first[number] = numbers[0]
        self.scene.commit()
        size = max([*first, *offset]) + 1
        table = np.zeros((2, size), np.uint32)
        for row, numbers in zip(table, (first, offset)):
            row[list(numbers)] = list(numbers.values())
        self._first, self._offset = mi.UInt32(table[0]), mi.UInt32(table[1])

    def instance_of(self, si, active):
        """The instance that a surface interaction lies on: mi.UInt32. Undefined where not active."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        instance = dr.reinterpret_array(mi.UInt32, si.instance)
        outer = dr.select(instance == 0, shape, instance)
        return dr.gather(mi.UInt32, self._first, outer, active) + dr.gather(mi.UInt32, self._offset, shape, active)
