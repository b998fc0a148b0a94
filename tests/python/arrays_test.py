"""Which arrays are read in place, which are converted, and which are refused."""

import tracemalloc
import unittest

import numpy as np

from fieldtrace import Scene
from fieldtrace import _arrays
from shapes import rays, sheet

COUNT = 100_000


class Arrays(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scene = Scene()
        cls.scene.add_instance(cls.scene.add_mesh(*sheet()))
        cls.scene.commit()
        cls.origins, cls.directions = rays(COUNT, 1)
        cls.expected = cls.scene.occluded(cls.origins, cls.directions, 1)

    def peak(self, *arguments):
        """Bytes of arrays that a query made meanwhile, its results included."""
        tracemalloc.start()
        try:
            result = self.scene.occluded(*arguments)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        np.testing.assert_array_equal(result, self.expected)
        return peak

    def layouts(self):
        """Name -> (origins, directions, tmax) that hold the same rays in layouts that fit."""
        kind = np.dtype([("o", np.float32, 3), ("d", np.float32, 3), ("t", np.float32), ("more", np.uint8, 4)])
        records = np.zeros(COUNT, kind)
        records["o"], records["d"], records["t"] = self.origins, self.directions, 1
        wide = np.zeros((COUNT, 8), np.float32)
        wide[:, :3], wide[:, 3:6], wide[:, 6] = self.origins, self.directions, 1
        sparse = np.zeros((2, 2 * COUNT, 3), np.float32)
        sparse[0, ::2], sparse[1, ::2] = self.origins, self.directions
        fixed = self.origins.copy()
        fixed.flags.writeable = False
        ones = np.ones(COUNT, np.float32)
        return {
            "packed": (self.origins, self.directions, ones),
            "records": (records["o"], records["d"], records["t"]),
            "columns": (wide[:, :3], wide[:, 3:6], wide[:, 6]),
            "every second": (sparse[0, ::2], sparse[1, ::2], ones),
            "read-only": (fixed, self.directions, ones),
        }

    def test_layouts_that_fit_are_read_in_place(self):
        for name, arrays in self.layouts().items():
            with self.subTest(name):
                self.assertLess(self.peak(*arrays), 1.1 * COUNT)  # a byte a ray: the results

    def test_others_are_converted(self):
        by_parts = np.asfortranarray(self.origins)
        converted = {
            "float64": self.origins.astype(np.float64),
            "an array of each part": by_parts,
            "backwards": np.ascontiguousarray(self.origins[::-1])[::-1],
            "other bytes first": self.origins.astype(">f4"),
            "odd addresses": np.frombuffer(b"\0" + self.origins.tobytes(), np.uint8)[1:].view(np.float32).reshape(-1, 3),
        }
        for name, origins in converted.items():
            with self.subTest(name):
                self.assertGreaterEqual(self.peak(origins, self.directions, 1), 12 * COUNT)
        np.testing.assert_array_equal(
            self.scene.occluded(self.origins[:9].tolist(), self.directions[:9].tolist(), [1] * 9), self.expected[:9])

    def test_shapes_are_kept_and_broadcast(self):
        o, d = self.origins[:24].reshape(2, 3, 4, 3), self.directions[:24].reshape(2, 3, 4, 3)
        hidden = self.scene.occluded(o, d, np.ones((2, 3, 4), np.float32))
        np.testing.assert_array_equal(hidden, self.expected[:24].reshape(2, 3, 4))
        self.assertEqual(self.scene.nearest(o, d).normals.shape, (2, 3, 4, 3))
        single = self.scene.occluded(o[0, 0, 0], d[0, 0, 0], 1)
        self.assertEqual(single.shape, ())
        many = self.scene.occluded([0, 1, 0], np.tile([0, -1, 0], (5, 1)), np.array([0.5, 2, 0.5, 2, 2]))
        self.assertEqual(many.tolist(), [False, True, False, True, True])
        for empty in ([], np.zeros((0, 3), np.float32)):
            shaped = np.reshape(empty, (0, 3))
            self.assertEqual(self.scene.occluded(shaped, shaped).shape, (0,))

    def test_integers(self):
        for kind in (np.uint32, np.int64, np.uint8, int):
            found = self.scene.occluded([0, 1, 0], [0, -1, 0], from_instances=np.zeros((), kind))
            self.assertFalse(found)  # flat meshes do not hide rays that leave them
        self.assertFalse(np.shares_memory(_arrays.triangles([[0, 1, 2]]), np.zeros(1)))
        triangles = np.zeros((5, 4), np.uint32)[:, :3]
        self.assertTrue(np.shares_memory(_arrays.triangles(triangles), triangles))

    def test_kinds_that_are_refused(self):
        o, d = self.origins[:4], self.directions[:4]
        scene = self.scene
        calls = [
            (TypeError, r"origins: expected numbers of shape \(\.\.\., 3\), got an array of <U1", lambda: scene.occluded("x", d)),
            (TypeError, "origins: .* got an array of complex64", lambda: scene.occluded(o.astype(np.complex64), d)),
            (TypeError, "directions: .* got an array of bool", lambda: scene.occluded(o, d > 0)),
            (TypeError, "origins: .* got an array of object", lambda: scene.occluded(None, d)),
            (TypeError, "tmax: ", lambda: scene.occluded(o, d, "far")),
            (TypeError, "from_instances: .* got an array of float32", lambda: scene.occluded(o, d, 1, np.float32(0))),
            (TypeError, "triangles: expected integers", lambda: Scene().add_mesh(o, [[0.0, 1.0, 2.0]])),
            (TypeError, "mesh: expected an integer", lambda: Scene().add_instance("a")),
            (TypeError, "threads: expected an integer", lambda: Scene(1.5)),
            (TypeError, "spp: expected an integer", lambda: Scene().set(spp=1.5)),
            (TypeError, "lights: expected Light", lambda: scene.light_visibility(o, d, [1])),
            (TypeError, "from_instances: ", lambda: scene.sky_visibility(o, d, None)),
        ]
        for kind, message, call in calls:
            with self.subTest(message), self.assertRaisesRegex(kind, message):
                call()

    def test_shapes_that_are_refused(self):
        o, d = self.origins[:4], self.directions[:4]
        scene = self.scene
        calls = [
            (r"origins: .* got an array of float32 and shape \(4, 2\)", lambda: scene.occluded(o[:, :2], d)),
            (r"shapes do not go together: origins \(4, 3\), directions \(3, 3\)", lambda: scene.occluded(o, d[:3])),
            (r"tmax: .* shape \(4,\), got .* shape \(3,\)", lambda: scene.occluded(o, d, np.ones(3))),
            (r"tmax: .* shape \(4,\), got .* shape \(4, 1\)", lambda: scene.occluded(o, d, np.ones((4, 1)))),
            ("from_instances: .* within", lambda: scene.occluded(o, d, 1, -1)),
            ("from_instances: .* within", lambda: scene.occluded(o, d, 1, 2**32)),
            ("origins: ", lambda: scene.occluded([[1, 2, 3], [1, 2]], d)),
            (r"triangles: .* shape \(3,\)", lambda: Scene().add_mesh(o, [0, 1, 2])),
            (r"positions: .* shape \(3,\)", lambda: Scene().add_mesh([0, 1, 2], [[0, 1, 2]])),
            (r"transform: .* \(3, 3\)", lambda: scene.set_transform(0, np.eye(3))),
            ("transform: the last row", lambda: scene.set_transform(0, np.ones((4, 4)))),
            ("instance: expected an integer within", lambda: scene.set_transform(-1, np.eye(4))),
            ("rgb: ", lambda: scene.set_sky([1, 2])),
            ("spp: expected an integer of 64 bits", lambda: scene.set(spp=2**64)),
            ("null byte", lambda: scene.save_field(0, "a\0b")),
        ]
        for message, call in calls:
            with self.subTest(message), self.assertRaisesRegex(ValueError, message):
                call()


if __name__ == "__main__":
    unittest.main()
