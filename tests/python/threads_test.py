"""The GIL is released; threads share scenes; Ctrl-C and progress cancel."""

import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

from fieldtrace import Scene
from shapes import rays, torus

RENDER_IN_THE_BACKGROUND = """
import threading, time
from threads_test import scene_of
from shapes import torus
scene = scene_of(torus(), directions=32, plane=64)
scene.set_sky(1)
scene.set_camera([0, -3, 2], [0, 0, 0], width=64, height=64)
scene.set(spp=1_000_000)
scene.commit()
threading.Thread(target=scene.render, args=({progress},), daemon=True).start()
time.sleep(0.5)
"""


def scene_of(mesh, **settings):
    scene = Scene()
    scene.set(**settings)
    scene.add_instance(scene.add_mesh(*mesh))
    scene.commit()
    return scene


class Gil(unittest.TestCase):
    """Threads change only where the GIL is given away: a second one counts while a call runs, or does not."""

    def setUp(self):
        self.interval = sys.getswitchinterval()
        sys.setswitchinterval(1000)
        self.count, self.stop = 0, False
        self.thread = threading.Thread(target=self.work)
        self.thread.start()

    def tearDown(self):
        self.stop = True
        sys.setswitchinterval(self.interval)
        self.thread.join()

    def work(self):
        while not self.stop:
            self.count += 1
            time.sleep(1e-5)

    def counts_during(self, call, calls=20):
        for _ in range(calls):
            before = self.count
            call()
            if self.count > before:
                return True
        return False

    def test_what_holds_it(self):
        self.assertFalse(self.counts_during(lambda: sum(range(1_000_000))))

    def test_queries(self):
        scene = scene_of(torus(), directions=32, plane=64)
        o, d = rays(200_000, 1)
        normals = np.ascontiguousarray(np.broadcast_to(np.float32([0, 1, 0]), o.shape))
        of = np.zeros(len(o), np.uint32)
        few = slice(0, 20_000)
        ones = np.ones(len(o), np.float32)
        core, results = scene._core, np.empty(len(o), np.uint8)
        t, n, k, i = np.empty_like(ones), np.empty_like(o), np.empty_like(of), np.empty_like(of)
        calls = {
            "occluded": lambda: core.occluded(False, o, d, ones, None, results),
            "occluded_certified": lambda: core.occluded(True, o, d, ones, None, results),
            "nearest": lambda: core.nearest(0.1, o, d, ones, None, results, t, n, k, i),
            "sky_visibility": lambda: core.sky_visibility(o[few], normals[few], of[few], t[few], ones[few]),
            "commit": scene.commit,
        }
        for name, call in calls.items():
            with self.subTest(name):
                self.assertTrue(self.counts_during(call))

    def test_long_calls(self):
        scene = scene_of(torus(16, 10), directions=32, plane=64)
        self.assertTrue(self.counts_during(scene.bake))


class Shared(unittest.TestCase):
    def test_threads_of_one_scene_agree(self):
        exact = scene_of(torus(), tolerance=0, directions=32, plane=64)
        scene = scene_of(torus(), directions=32, plane=64)
        batches = [rays(20_000, seed) for seed in range(6)]
        expected = [exact.occluded(*batch) for batch in batches]
        found = [None] * len(batches)

        def ask(i):
            found[i] = scene.occluded(*batches[i]), exact.occluded(*batches[i])

        baker = threading.Thread(target=scene.bake)
        threads = [baker, *(threading.Thread(target=ask, args=(i,)) for i in range(len(batches)))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for i in range(len(batches)):
            np.testing.assert_array_equal(found[i][1], expected[i])
            # Fields err for some rays in a thousand, and answer from when they are baked on.
            self.assertLess(np.mean(found[i][0] != expected[i]), 1 / 500)

    def test_errors_belong_to_threads(self):
        scene = scene_of(torus(), directions=32, plane=64)
        messages = {}

        def fail(i):
            origins = np.zeros((10, 3), np.float32)
            origins[i] = np.nan
            for _ in range(50):
                try:
                    scene.occluded(origins, [0, 0, 1])
                except ValueError as error:
                    messages.setdefault(i, set()).add(str(error))

        threads = [threading.Thread(target=fail, args=(i,)) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for i in range(8):
            self.assertEqual(messages[i], {f"ray {i} has numbers that are not finite, or no direction"})


class Cancelling(unittest.TestCase):
    def slow_scene(self):
        return scene_of(torus(400, 200), directions=64, plane=256)  # a bake of minutes

    def test_interrupts(self):
        scene = self.slow_scene()

        def interrupt():
            while scene.get_mesh(0, "cells_baked") == 0:
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        with self.assertRaises(KeyboardInterrupt):
            scene.bake()
        thread.join()
        baked = scene.get("cells_baked")
        self.assertGreater(baked, 0)
        self.assertLess(baked, scene.get("cells_full"))
        scene.occluded(*rays(100, 1))  # it goes on

    def test_interrupted_pictures(self):
        scene = scene_of(torus(), directions=32, plane=64)
        scene.set_sky(1)
        scene.set_camera([0, -3, 2], [0, 0, 0], width=1000, height=1000)
        scene.set(spp=100_000)
        scene.commit()
        shares = []

        def progress(share):
            shares.append(share)
            signal.raise_signal(signal.SIGINT)

        with self.assertRaises(KeyboardInterrupt):
            scene.render(progress)
        self.assertEqual(len(shares), 1)
        self.assertLess(shares[0], 1)

    def test_renders_of_threads_that_the_program_does_not_wait_for(self):
        for progress in ("None", "print"):
            done = self.run_program(RENDER_IN_THE_BACKGROUND.format(progress=progress))
            self.assertEqual(done.returncode, 0, done.stderr)

    def test_the_library_works_while_the_program_ends(self):
        text = "import atexit\natexit.register(lambda: print(scene.occluded(*rays(9, 1)).shape, scene.render().shape))\n"
        text += "from threads_test import scene_of\nfrom shapes import rays, torus\nscene = scene_of(torus())\n"
        text += "scene.set_sky(1)\nscene.set_camera([0, -3, 2], [0, 0, 0], width=8, height=8)\nscene.commit()\n"
        done = self.run_program(text)
        self.assertEqual((done.returncode, done.stdout), (0, "(9,) (8, 8, 3)\n"), done.stderr)

    def run_program(self, text):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
        return subprocess.run([sys.executable, "-c", text], env=environment, capture_output=True, text=True, timeout=120)

    def test_bakes_beside_one_another(self):
        # The second one waits for the first, and is cancelled while it does.
        scene = self.slow_scene()
        first_began, second_ended = threading.Event(), threading.Event()
        outcome = []

        class Stop(Exception):
            pass

        def until_second_ended(share):
            first_began.set()
            if second_ended.is_set():
                raise Stop

        def first():
            try:
                scene.bake(until_second_ended)
            except Stop:
                outcome.append("stopped")

        thread = threading.Thread(target=first)
        thread.start()
        first_began.wait()
        killer = threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT))
        killer.start()
        # Ends as soon as it may begin, since it was cancelled before.
        release = threading.Timer(0.5, second_ended.set)
        release.start()
        with self.assertRaises(KeyboardInterrupt):
            scene.bake()
        thread.join()
        self.assertEqual(outcome, ["stopped"])


if __name__ == "__main__":
    unittest.main()
