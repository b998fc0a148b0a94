#!/usr/bin/env python3
"""Runs tools/benchmarks/random_frames.py on tiny pictures, and checks its scenes and gains. Timings are not judged."""

import argparse
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools/benchmarks"))

import random_frames
from measuring import random_scenes

PROGRAM = None


class RandomFrames(unittest.TestCase):
    def test_scenes_are_the_same_each_time(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            make = lambda kind, seed: random_scenes.make(kind, seed, folder, lambda words: f"{words}.ply", (40, 30))
            for kind in random_scenes.KINDS:
                self.assertEqual(make(kind, 3), make(kind, 3))
                self.assertNotEqual(make(kind, 3), make(kind, 4))

    def test_gains_are_at_equal_error(self):
        # Half the error is worth 2^(4/3) of time; the better estimator counts.
        found = {"Monte Carlo": (1.0, 0.02), "adaptive": (4.0, 0.02), "cold": (1.0, 0.02), "warm": (1.0, 0.01)}
        gains = random_frames.gains(found)
        self.assertAlmostEqual(gains["cold / Monte Carlo"], 1.0)
        self.assertAlmostEqual(gains["warm / Monte Carlo"], 2.0 ** (4.0 / 3.0))
        self.assertEqual(random_frames.numbers("1-3,7"), [1, 2, 3, 7])

    def test_camera_samples_count_beside_light_samples(self):
        self.assertEqual(random_frames.splits("1-2,4x16"), [(1, 1), (2, 1), (4, 16)])
        found = {"Monte Carlo": (1.0, 0.02), "adaptive": (1.0, 0.02), "camera samples": (1.0, 0.01),
                 "cold": (1.0, 0.02), "warm": (1.0, 0.01)}
        self.assertAlmostEqual(random_frames.gains(found)["warm / Monte Carlo"], 1.0)

    def test_renders_every_kind(self):
        with tempfile.TemporaryDirectory() as folder:
            for kind in random_scenes.KINDS:
                words = ["--kind", kind, "--scenes", "1", "--size", "32x24", "--samples", "2,1x2", "--repeats", "1",
                         "--reference-spp", "8", "--program", PROGRAM, "--work", folder]
                done = subprocess.run([sys.executable, random_frames.__file__, *words], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertIn(f"{kind} 1, 2 samples: Monte Carlo ", done.stdout)
                self.assertRegex(done.stdout, r"2 samples, warm / Monte Carlo: \d")
                self.assertIn(f"{kind} 1, 1 x 2 samples: Monte Carlo ", done.stdout)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", required=True)
    arguments, rest = parser.parse_known_args()
    PROGRAM = arguments.program
    unittest.main(argv=[sys.argv[0], *rest])
