"""Checked by mypy, never run: what is ignored here must be an error."""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import fieldtrace

scene = fieldtrace.Scene(threads=2)
assert_type(scene.add_mesh(np.zeros((3, 3)), [[0, 1, 2]]), int)
assert_type(scene.occluded([0, 0, 0], [0, 0, 1], tmax=1.0), NDArray[np.bool_])
assert_type(scene.occluded_certified([0, 0, 0], [0, 0, 1]), NDArray[np.uint8])
hits = scene.nearest(np.zeros((2, 3), np.float32), (0, 0, 1))
assert_type(hits.t, NDArray[np.float32])
assert_type(hits.instances, NDArray[np.uint32])
seen = scene.light_visibility([0, 0, 0], [0, 0, 1], fieldtrace.Light.sphere([0, 0, 2], 1))
assert_type(seen.shares, NDArray[np.float32])
assert_type(scene.render(), NDArray[np.float32])
assert_type(fieldtrace.load_scene("a.xml"), fieldtrace.Scene)
assert_type(fieldtrace.render("a.xml", spp=16), NDArray[np.float32])
assert_type(fieldtrace.render("a.xml", "a.exr", spp=16), None)
scene.bake(progress=lambda share: print(f"{share:.0%}"))
try:
    scene.commit()
except fieldtrace.Error as error:
    assert_type(error.code, fieldtrace.ErrorCode)

scene.occlude([0, 0, 0], [0, 0, 1])  # type: ignore[attr-defined]
scene.occluded([0, 0, 0])  # type: ignore[call-arg]
scene.set_camera([0, 0, 0], [0, 0, 1], width="wide")  # type: ignore[arg-type]
fieldtrace.load_scene(1)  # type: ignore[arg-type]
