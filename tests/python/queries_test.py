"""What the package answers, against rays traced by numpy."""

import os
import pathlib
import re
import tempfile
import unittest

import numpy as np

import fieldtrace
from fieldtrace import Hit, Light, Occlusion, Scene
from shapes import brute_force, rays, sheet, torus

SOURCE = pathlib.Path(os.environ["FIELDTRACE_SOURCE"])
TURNED = np.array([[0, -1.5, 0, 0.3], [1.2, 0, 0, -0.2], [0, 0.1, 0.8, 0.5]])


def two_tori(**settings):
    """A scene, and its triangles in the world."""
    positions, triangles = torus()
    scene = Scene()
    scene.set(directions=32, plane=64, **settings)
    mesh = scene.add_mesh(positions, triangles)
    scene.add_instance(mesh)
    scene.add_instance(mesh, TURNED)
    scene.commit()
    moved = positions @ TURNED[:, :3].T + TURNED[:, 3]
    return scene, np.concatenate([positions[triangles], moved[triangles]])


class Occluded(unittest.TestCase):
    def test_exact_rays_are_those_of_brute_force(self):
        scene, triangles = two_tori(tolerance=0)
        origins, directions = rays(2000, 1)
        t, _, doubtful = brute_force(triangles, origins, directions)
        self.assertLess(doubtful.mean(), 0.1)
        hidden = scene.occluded(origins, directions)
        self.assertEqual(hidden.dtype, np.bool_)
        np.testing.assert_array_equal(hidden[~doubtful], np.isfinite(t[~doubtful]))
        self.assertGreater(hidden.mean(), 0.1)
        self.assertLess(hidden.mean(), 0.9)
        # Ends before and behind the nearest hits.
        for factor, expected in ((0.999, False), (1.001, True)):
            ends = np.where(np.isfinite(t), factor * t, 1).astype(np.float32)
            which = ~doubtful & np.isfinite(t)
            np.testing.assert_array_equal(scene.occluded(origins, directions, ends)[which], expected)

    def test_certified_answers_are_the_same(self):
        scene, _ = two_tori()
        scene.bake()
        origins, directions = rays(20000, 2)
        certified = scene.occluded_certified(origins, directions, 1)
        decided = certified != Occlusion.UNDECIDED
        self.assertGreater(decided.mean(), 0.2)
        self.assertLess(decided.mean(), 1)
        hidden = scene.occluded(origins, directions, 1)
        np.testing.assert_array_equal(hidden[decided], certified[decided] == Occlusion.BLOCKED)
        self.assertGreater(scene.get("certified_occlusion"), 0.2)

    def test_no_ray_and_left_instances(self):
        scene = Scene()
        scene.add_instance(scene.add_mesh(*sheet()))
        scene.commit()
        down = [0, -1, 0]
        self.assertTrue(scene.occluded([0.3, 1, 0.1], down))
        self.assertFalse(scene.occluded([0.3, 1, 0.1], down, -1))
        self.assertFalse(scene.occluded([0.3, 1, 0.1], down, from_instances=0))
        self.assertTrue(scene.occluded([0.3, 1, 0.1], down, from_instances=fieldtrace.NO_INSTANCE))


class Nearest(unittest.TestCase):
    def test_meshes_without_fields_are_those_of_brute_force(self):
        positions, triangles = torus(12, 8)  # 192 triangles: no field
        scene = Scene()
        instance = scene.add_instance(scene.add_mesh(positions, triangles), TURNED)
        scene.commit()
        corners = (positions @ TURNED[:, :3].T + TURNED[:, 3])[triangles]
        origins, directions = rays(2000, 3)
        t, which, doubtful = brute_force(corners, origins, directions)
        hits = scene.nearest(origins, directions)
        sure = ~doubtful
        np.testing.assert_array_equal(hits.status[sure] == Hit.HIT, np.isfinite(t[sure]))
        sure &= hits.status == Hit.HIT
        np.testing.assert_allclose(hits.t[sure], t[sure], rtol=1e-4)
        np.testing.assert_array_equal(hits.triangles[sure], which[sure])
        np.testing.assert_array_equal(hits.instances[sure], instance)
        a, b, c = (corners[which[sure], k] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals *= -np.sign(np.einsum("ij,ij->i", normals, directions[sure]))[:, None]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        np.testing.assert_allclose(hits.normals[sure], normals, atol=1e-4)
        missed = hits.status == Hit.MISS
        self.assertTrue(np.isinf(hits.t[missed]).all() and (hits.instances[missed] == fieldtrace.NO_INSTANCE).all())
        beyond = scene.nearest(origins[sure], directions[sure], 0.999 * t[sure])
        np.testing.assert_array_equal(beyond.t[beyond.status == Hit.HIT] < 0.999 * t[sure][beyond.status == Hit.HIT], True)

    def test_hits_of_fields_face_the_ray(self):
        scene, _ = two_tori()
        scene.bake()
        origins, directions = rays(5000, 4)
        hits = scene.nearest(origins, directions, max_error=0.2)
        found = hits.status == Hit.HIT
        self.assertGreater(found.sum(), 50)
        np.testing.assert_allclose(np.linalg.norm(hits.normals[found], axis=1), 1, atol=1e-5)
        self.assertTrue((np.einsum("ij,ij->i", hits.normals, directions)[found] <= 0).all())


class Visibility(unittest.TestCase):
    def test_half_a_lamp_is_hidden(self):
        scene = Scene()
        scene.add_instance(scene.add_mesh(*sheet(y=0, half=5)))
        lid = scene.add_mesh([[0, 1, -5], [0, 1, 5], [5, 1, 5], [5, 1, -5]], [[0, 1, 2], [0, 2, 3]])
        scene.add_instance(lid)
        scene.commit()
        lamp = Light.rectangle([0, 4, 0], [0.5, 0, 0], [0, 0, 0.5])
        disk = Light.disk([0, 4, 0], [0.5, 0, 0], [0, 0, 0.5])
        ball = Light.sphere([0, 4, 0], 0.5)
        points = [[0, 0, 0], [-4, 0, 0], [3, 0, 0]]
        for certain_of in (None, 0):
            seen = scene.light_visibility(points, [0, 1, 0], [lamp, disk, ball], from_instances=certain_of)
            self.assertEqual(seen.shares.shape, (3, 3))
            np.testing.assert_allclose(seen.shares, [[0.5] * 3, [1] * 3, [0] * 3], atol=1e-6)
        alone = scene.light_visibility(points, [0, 1, 0], lamp)
        self.assertEqual(alone.shares.shape, (3,))
        # From behind, below the horizon, and no lights at all.
        self.assertEqual(scene.light_visibility([-4, 5, 0], [0, -1, 0], lamp).shares, 0)
        self.assertEqual(scene.light_visibility([-4, 0, 0], [0, -1, 0], lamp).shares, 0)
        self.assertEqual(scene.light_visibility(points, [0, 1, 0], []).shares.shape, (3, 0))

    def test_sky(self):
        scene = Scene()
        floor = scene.add_instance(scene.add_mesh(*sheet(half=50)))
        scene.add_instance(scene.add_mesh(*torus()), [[1, 0, 0, 0], [0, 0, 1, 1], [0, -1, 0, 0]])
        scene.set(directions=32, plane=64)
        scene.commit()
        seen = scene.sky_visibility([[40, 0, 40], [1, 0, 0]], [0, 1, 0], floor)
        self.assertGreater(seen.shares[0], 0.99)
        # Brute force: cosine-weighted directions at the point under the tube.
        random = np.random.default_rng(5)
        z, phi = np.sqrt(random.uniform(size=4000)), random.uniform(0, 2 * np.pi, 4000)
        r = np.sqrt(1 - z * z)
        free = ~scene.occluded([1, 0, 0], np.stack([r * np.cos(phi), z, r * np.sin(phi)], -1), from_instances=floor)
        error = np.sqrt(free.mean() * (1 - free.mean()) / free.size)
        # Five standard errors of the rays, and what docs/limits.md says of skies.
        self.assertLess(abs(seen.shares[1] - free.mean()), 5 * error + 0.01)
        self.assertLess(seen.shares[1], 0.9)


class Scenes(unittest.TestCase):
    def test_moved_instances(self):
        scene = Scene()
        moved = scene.add_instance(scene.add_mesh(*sheet()))
        scene.commit()
        self.assertTrue(scene.occluded([0.1, 1, 0.2], [0, -1, 0]))
        scene.set_transform(moved, [[1, 0, 0, 9], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        scene.commit()
        self.assertFalse(scene.occluded([0.1, 1, 0.2], [0, -1, 0]))
        self.assertTrue(scene.occluded([9.1, 1, 0.2], [0, -1, 0]))

    def test_fields_are_kept_in_files(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "täst.vdb"
            scene, _ = two_tori()
            scene.bake()
            baked = scene.get_mesh(0, "cells_baked")
            self.assertGreater(baked, 0)
            scene.save_field(0, file)
            other, _ = two_tori()
            self.assertEqual(other.get_mesh(0, "cells_baked"), 0)
            other.load_field(0, str(file))
            self.assertEqual(other.get("cells_baked"), baked)
            self.assertEqual(other.get("cells_full"), scene.get("cells_full"))

    def test_bake_is_whole(self):
        scene = Scene()
        scene.set(directions=32, plane=64)
        scene.add_instance(scene.add_mesh(*torus(16, 10)))
        scene.commit()
        told = []
        scene.bake(told.append)
        baked = scene.get("cells_baked")
        self.assertGreaterEqual(baked, scene.get("cells_full"))
        self.assertTrue(0 < scene.get("cells_certified") < baked)
        scene.occluded(*rays(20000, 7))
        scene.nearest(*rays(20000, 7))
        self.assertEqual(scene.get("cells_baked"), baked)  # nothing was left to bake
        self.assertEqual(told, sorted(told))
        self.assertEqual(told[-1], 1)

    def test_pictures(self):
        # A floor of reflectance .5 under a sky of radiance 2 sends .5 x 2; the sky itself 2.
        scene = Scene()
        scene.add_instance(scene.add_mesh(*sheet(half=100)))
        scene.set_reflectance(0, 0.5)
        scene.set_sky([2, 2, 1])
        scene.set_camera([0, 2, 5], [0, 2, 0], fov=60, width=20, height=10)
        scene.set(spp=64, seed=3)
        scene.commit()
        picture = scene.render()
        self.assertEqual(picture.shape, (10, 20, 3))
        np.testing.assert_allclose(picture[0], np.broadcast_to([2, 2, 1], (20, 3)), rtol=1e-6)
        np.testing.assert_allclose(picture[-1], np.broadcast_to([1, 1, 0.5], (20, 3)), rtol=0.05)
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "picture.png"
            scene.render_to_file(file)
            self.assertEqual(file.read_bytes()[1:4], b"PNG")

    def test_lamps(self):
        scene = Scene()
        scene.add_instance(scene.add_mesh(*sheet()))
        scene.set_radiance(0, [3, 2, 1])
        scene.set_camera([0, 5, 0], [0, 0, 0], up=[0, 0, 1], fov=10, width=4, height=4)
        scene.set(spp=4)
        scene.commit()
        np.testing.assert_allclose(scene.render()[2, 2], [3, 2, 1], rtol=1e-6)

    def test_scene_files(self):
        file = SOURCE / "scenes/rectangle_light_box.xml"
        small = fieldtrace.render(file, spp=4, max_depth=2)
        self.assertEqual(small.ndim, 3)
        self.assertGreater(small.mean(), 0)
        # Monte Carlo's is another picture.
        exact = fieldtrace.render(str(file), spp=4, max_depth=2, montecarlo=1)
        self.assertFalse(np.array_equal(small, exact))
        np.testing.assert_array_equal(small, fieldtrace.render(file, spp=4, max_depth=2, threads=1))
        with tempfile.TemporaryDirectory() as folder:
            self.assertIsNone(fieldtrace.render(file, pathlib.Path(folder) / "a.exr", spp=1))
            self.assertTrue((pathlib.Path(folder) / "a.exr").stat().st_size > 0)
        self.assertEqual(fieldtrace.load_scene(file).origin.shape, (3,))


class Interface(unittest.TestCase):
    def test_every_function_of_the_header_is_used(self):
        header = (SOURCE / "fieldtrace/fieldtrace.h").read_text()
        used = "".join(file.read_text() for file in (SOURCE / "python").glob("*.cpp"))
        used += (SOURCE / "fieldtrace/fieldtrace.hpp").read_text()
        functions = set(re.findall(r"^FT_API \w+ (ft\w+)\(", header, re.M))
        self.assertGreater(len(functions), 30)
        # Errors are asked for, not told.
        unused = {name for name in functions if not re.search(rf"\b{name}\b", used)} - {"ftSetDeviceErrorCallback"}
        self.assertEqual(unused, set())


if __name__ == "__main__":
    unittest.main()
