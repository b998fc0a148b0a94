"""Who owns what, and for how long."""

import copy
import gc
import importlib.metadata
import os
import pathlib
import pickle
import resource
import shutil
import subprocess
import sys
import tempfile
import unittest
import weakref

import numpy as np

import fieldtrace
from fieldtrace import Scene
from shapes import rays, sheet, torus


MAKE_FIELD = """
import sys
from fieldtrace import Scene
from shapes import torus
scene = Scene(threads=2)
scene.set(directions=32, plane=64)
scene.add_instance(scene.add_mesh(*torus()))
scene.commit()
scene.bake()
scene.save_field(0, sys.argv[1])
"""


def resident():
    """Bytes of memory of this process."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


class Lifetime(unittest.TestCase):
    def scene(self, mesh=sheet):
        scene = Scene(threads=2)
        scene.set(directions=32, plane=64)
        scene.add_instance(scene.add_mesh(*mesh()))
        scene.commit()
        return scene

    def test_results_outlive_scenes(self):
        scene = self.scene()
        reference = weakref.ref(scene)
        origins, directions = rays(5000, 1)
        hidden, hits = scene.occluded(origins, directions), scene.nearest(origins, directions)
        expected = hidden.copy(), hits.t.copy()
        del scene
        gc.collect()
        self.assertIsNone(reference())
        self.scene(torus).occluded(origins, directions)  # would overwrite what was freed
        np.testing.assert_array_equal(hidden, expected[0])
        np.testing.assert_array_equal(hits.t, expected[1])
        hidden[:] = True  # they are the caller's

    def test_meshes_are_copied(self):
        positions, triangles = sheet()
        scene = Scene()
        scene.add_instance(scene.add_mesh(positions, triangles))
        positions[:] = 100
        del positions, triangles
        scene.commit()
        self.assertTrue(scene.occluded([0.1, 1, 0.2], [0, -1, 0]))

    def test_references_are_returned(self):
        scene = self.scene()
        arrays = [*rays(100, 2), np.ones(100, np.float32), np.zeros(100, np.uint32)]
        told = [].append
        held = (*arrays, scene, told)
        before = [sys.getrefcount(o) for o in held]
        for _ in range(50):
            scene.occluded(*arrays)
            scene.nearest(*arrays)
            scene.bake(told)
            with self.assertRaises(fieldtrace.Error):
                scene.occluded(arrays[0], np.zeros((100, 3), np.float32))
        self.assertEqual([sys.getrefcount(o) for o in held], before)

    def test_nothing_is_left_behind(self):
        big = torus(200, 100)  # 40,000 triangles: more than 700 kB each
        origins, directions = rays(500, 3)

        def once():
            scene = Scene(threads=2)
            scene.set(directions=32, plane=64, tolerance=0)
            scene.add_instance(scene.add_mesh(*big))
            scene.commit()
            scene.occluded(origins, directions)

        for _ in range(5):
            once()
        before, times = resident(), 60
        for _ in range(times):
            once()
        kept = resident() - before
        self.assertLess(kept, times * (big[0].nbytes + big[1].nbytes) / 2)

    def test_no_copies_of_scenes(self):
        scene = self.scene()
        for call in (pickle.dumps, copy.copy, copy.deepcopy):
            with self.subTest(call.__name__), self.assertRaisesRegex(TypeError, "cannot be pickled or copied"):
                call(scene)

    def test_modules_are_those_beside_the_library(self):
        # What lies beside the interpreter may be of another version.
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            python = root / "bin/python"
            python.parent.mkdir()
            shutil.copy(os.path.realpath(sys.executable), python)
            others = root / "lib/fieldtrace"
            others.mkdir(parents=True)
            (others / "libfieldtrace_vdb.so").write_text("of another version", encoding="ascii")
            paths = os.pathsep.join([str(pathlib.Path(__file__).parent), *sys.path])
            options = {"env": {**os.environ, "PYTHONHOME": sys.base_prefix, "PYTHONPATH": paths},
                       "capture_output": True, "text": True, "timeout": 120}
            if subprocess.run([python, "-c", ""], **options).returncode != 0:
                self.skipTest("a copy of this interpreter does not find its library")
            done = subprocess.run([python, "-c", MAKE_FIELD, root / "field.vdb"], **options)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertTrue((root / "field.vdb").is_file())

    def test_version(self):
        self.assertEqual(fieldtrace.__version__, importlib.metadata.version("fieldtrace"))

    def test_public_names(self):
        for name in fieldtrace.__all__:
            self.assertTrue(hasattr(fieldtrace, name), name)
        undocumented = [n for n, f in vars(Scene).items() if callable(f) and n[0] != "_" and not f.__doc__]
        self.assertEqual(undocumented, [])


if __name__ == "__main__":
    unittest.main()
