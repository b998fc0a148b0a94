"""Pictures of tools/mitsuba/fieldtrace_direct.py are those of Mitsuba's own direct integrator, within the noise.

Each integrator renders with seeds of its own. If both make the same pictures on average, then it does not matter which
one made which: the largest difference of block means, in standard errors, is compared with that of random divisions of
all pictures in two (a permutation test). No bound is chosen but the level at which it fails.
"""

import glob
import os
import pathlib
import sys
import tempfile
import unittest

import numpy as np

for library in sorted(glob.glob("/usr/lib/*/libLLVM-1[5-9].so")):
    os.environ["DRJIT_LIBLLVM_PATH"] = library  # the newest; none has the name that Mitsuba looks for
import drjit as dr
import mitsuba as mi
from fieldtrace import _arrays

SEEDS, BLOCK, RESOLUTION, SPP = 10, 8, 64, 16
PERMUTATIONS, LEVEL = 2000, 0.001  # of each test


def setUpModule():
    try:
        mi.set_variant("llvm_ad_rgb")
        mi.Float(1) + 1
    except (ImportError, RuntimeError) as error:
        raise unittest.SkipTest(f"Mitsuba's variant llvm_ad_rgb does not start: {error}")
    sys.path.insert(0, str(pathlib.Path(os.environ["FIELDTRACE_SOURCE"]) / "tools/mitsuba"))
    mi.set_log_level(mi.LogLevel.Error)


def pictures(scene, integrator, seeds):
    integrator = mi.load_dict(integrator)
    return np.array([np.array(mi.render(scene, integrator=integrator, spp=SPP, seed=seed)) for seed in seeds])


def blocks(images):
    """(n, height, width, 3) -> (n, blocks), and the means of whole pictures as one more."""
    n, height, width, _ = images.shape
    cut = images.mean(axis=3).reshape(n, height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(2, 4)).reshape(n, -1)
    return np.concatenate([cut, cut.mean(axis=1, keepdims=True)], axis=1).astype(np.float64)


def largest(a, b):
    """The largest difference in standard errors. Blocks without noise count where they differ, by rounding excepted."""
    noise = np.sqrt(a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b))
    rounding = 16 * np.finfo(np.float32).eps * np.abs(a).max(axis=0)
    return np.max(np.abs(a.mean(axis=0) - b.mean(axis=0)) / np.maximum(noise, rounding + 1e-30))


def p_value(a, b):
    """Of the hypothesis that the pictures of a and b have one distribution."""
    both, random = np.concatenate([blocks(a), blocks(b)]), np.random.default_rng(1)
    found = largest(both[: len(a)], both[len(a) :])
    at_least = 0
    for _ in range(PERMUTATIONS):
        order = random.permutation(len(both))
        at_least += largest(both[order[: len(a)]], both[order[len(a) :]]) >= found
    return (at_least + 1) / (PERMUTATIONS + 1)


class Direct(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        import example_scenes
        import fieldtrace_direct  # registers itself

        cls.module = fieldtrace_direct
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.scenes = example_scenes.EXAMPLES

    def load(self, name):
        return self.scenes[name](self.folder.name, RESOLUTION)

    def test_pictures_agree(self):
        cases = [(name, {}) for name in self.scenes if name != "million"]
        cases += [("knot", {"emitter_samples": 2, "bsdf_samples": 0}), ("groups", {"hide_emitters": True})]
        for name, options in cases:
            with self.subTest(name, **options):
                scene = self.load(name)
                theirs = pictures(scene, {"type": "direct", **options}, range(SEEDS))
                ours = pictures(scene, {"type": "fieldtrace_direct", "directions": 32, "plane": 128, **options},
                                range(100, 100 + SEEDS))
                p = p_value(ours, theirs)
                print(f"{name} {options}: p {p:.4f}, means {ours.mean():.5f} {theirs.mean():.5f}", flush=True)
                self.assertGreater(p, LEVEL)

    def test_what_it_would_find(self):
        """Light that is 1 % too bright; a shadow that is missing."""
        scene = self.load("knot")
        theirs = pictures(scene, {"type": "direct"}, range(SEEDS))
        others = pictures(scene, {"type": "direct"}, range(100, 100 + SEEDS))
        self.assertGreater(p_value(others, theirs), LEVEL)
        self.assertLessEqual(p_value(1.01 * others, theirs), LEVEL)
        integrator = mi.load_dict({"type": "fieldtrace_direct"})
        shapes = [shape.id() for shape in scene.shapes()]
        fields = integrator.convert(scene).scene
        fields.set_transform(shapes.index("knot"), np.eye(4) + 1000 * np.eye(4, k=3))
        fields.commit()
        unshadowed = np.array([np.array(mi.render(scene, integrator=integrator, spp=SPP, seed=100 + seed))
                               for seed in range(SEEDS)])
        self.assertLessEqual(p_value(unshadowed, theirs), LEVEL)

    def test_same_samples_same_pictures(self):
        """But for rounding; and, of the exact rays of Fieldtrace, but for those that graze an edge."""
        for name in ("cornell", "knot", "groups"):
            scene = self.load(name)
            (theirs,) = pictures(scene, {"type": "direct"}, [7])
            (same,) = pictures(scene, {"type": "fieldtrace_direct", "shadows": "mitsuba"}, [7])
            np.testing.assert_allclose(same, theirs, rtol=1e-3, atol=1e-4)
            (ours,) = pictures(scene, {"type": "fieldtrace_direct", "tolerance": 0.0}, [7])
            differ = (np.abs(ours - theirs) > 1e-3 * (1 + theirs)).any(axis=2)
            print(f"{name}: {differ.sum()} of {differ.size} pixels differ", flush=True)
            self.assertLess(differ.mean(), 0.001)


class Conversion(unittest.TestCase):
    def converted(self, **shapes):
        from fieldtrace_scene import Converted

        self.scene = mi.load_dict({"type": "scene", **shapes})
        return Converted(self.scene, tolerance=0.0)

    def hits(self, count=2000):
        """Rays from all around to near the middle: (Mitsuba's interactions, origins, directions)."""
        random = np.random.default_rng(2)
        origins = random.normal(size=(count, 3))
        origins *= 10 / np.linalg.norm(origins, axis=1, keepdims=True)
        directions = random.uniform(-1.5, 1.5, (count, 3)) - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        o, d = (np.float32(x) for x in (origins, directions))
        si = self.scene.ray_intersect(mi.Ray3f(mi.Point3f(o.T), mi.Vector3f(d.T)))
        return si, o, d

    def test_shapes_and_instances(self):
        from fieldtrace_scene import Converted

        t = mi.ScalarTransform4f
        converted = self.converted(
            ball={"type": "sphere", "center": [1, 0, 0], "radius": 0.4},
            tube={"type": "cylinder", "p0": [-1, -1, 0], "p1": [-1, 0, 1], "radius": 0.3},
            plate={"type": "disk", "to_world": t().translate([0, 1, 0]).rotate([1, 0, 0], 70).scale([0.6, 0.8, 1])},
            square={"type": "rectangle", "to_world": t().translate([0, -1, -1]).rotate([0, 1, 0], 20).scale(0.5)},
            first={"type": "shapegroup", "b": {"type": "cube"}, "s": {"type": "sphere", "center": [1.5, 0, 0]}},
            second={"type": "shapegroup", "c": {"type": "cylinder"}},
            i1={"type": "instance", "to_world": t().translate([0, 0, 1]).rotate([1, 2, 3], 40).scale(0.2),
                "g": {"type": "ref", "id": "first"}},
            i2={"type": "instance", "to_world": t().scale([0.3, 0.1, 0.2]), "g": {"type": "ref", "id": "first"}},
            i3={"type": "instance", "to_world": t().translate([0.5, 0.8, -0.8]).scale(0.3),
                "g": {"type": "ref", "id": "second"}},
        )
        self.assertEqual(converted.scene.get("instances"), 4 + 2 + 2 + 1)
        self.assertEqual(converted.scene.get("meshes"), 4 + 2 + 1)
        si, o, d = self.hits()
        hit = np.array(si.is_valid())
        blocked = converted.scene.occluded(o, d)
        # Rays that pass a round shape within 1e-4 of its size see the mesh within it.
        self.assertLess(np.mean(hit != blocked), 0.002)
        # Which instance: rays end just behind the hit, and are hidden by the instance that is named.
        named = np.array(converted.instance_of(si, si.is_valid()))
        both = hit & blocked
        self.assertEqual(set(named[both]), set(range(9)))
        for i in range(9):
            alone = Converted(self.scene, tolerance=0.0)
            for k in range(9):
                if k != i:
                    alone.scene.set_transform(k, np.eye(4) + 100 * np.eye(4, k=3))
            alone.scene.commit()
            mine = both & (named == i)
            ends = np.array(si.t)[mine] * (1 + 1e-3)
            self.assertGreater(alone.scene.occluded(o[mine], d[mine], ends).mean(), 0.99)

    def test_what_is_not_supported_is_named(self):
        with self.assertRaisesRegex(NotImplementedError, "'wire': Fieldtrace has no BSplineCurve"):
            with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
                file.write("".join(f"{i} 0 0 0.1\n" for i in range(6)))
                file.flush()
                self.converted(wire={"type": "bsplinecurve", "filename": file.name})

    def test_nothing_is_copied(self):
        rays = mi.Point3f(np.random.default_rng(1).uniform(size=(3, 1000)).astype(np.float32))
        packed = dr.ravel(rays)
        array = packed.numpy()
        self.assertEqual(array.ctypes.data, packed.numpy().ctypes.data)
        self.assertTrue(np.shares_memory(_arrays.flat_rows(array.reshape(-1, 3), (1000,)), array))
        np.testing.assert_array_equal(array.reshape(-1, 3), np.array(rays).T)


if __name__ == "__main__":
    unittest.main()
