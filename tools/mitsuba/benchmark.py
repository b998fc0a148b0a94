#!/usr/bin/env python3
"""What Mitsuba's direct integrator gains or loses by Fieldtrace's shadow rays.

    benchmark.py [--pairs N] [--resolution PIXELS] [--spp N] [--emitter-samples N] SCENE...

Scenes are those of example_scenes.py. Seconds are user seconds of this process, all threads, of renders by `direct` and
by `fieldtrace_direct` in turns; a row's ratio is the median over the pairs (below 1: Fieldtrace gains), with its
quartiles. "cold" is the first render, which converts the scene and bakes what is asked for; both have compiled their
kernels before. "exact": Fieldtrace with tolerance 0; "Mitsuba": the same Python code with Mitsuba's shadow rays.

Both draw the same samples, so that the difference of two pictures is what the fields did: "error" is its RMSE, and
"noise" that of one picture of `direct`, both over the mean.
"""

import argparse
import glob
import os
import pathlib
import resource
import sys
import tempfile
import time

import numpy as np

for library in sorted(glob.glob("/usr/lib/*/libLLVM-1[5-9].so"), reverse=True):  # the newest
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", library)
import fieldtrace
import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
sys.path.append(str(pathlib.Path(__file__).resolve().parent))
import example_scenes
import fieldtrace_direct  # registers itself


def user_seconds():
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


class Timed:
    """Renders and adds up what it takes."""

    def __init__(self, scene, spp, **description):
        self.scene, self.spp, self.integrator = scene, spp, mi.load_dict(description)

    def render(self, seed):
        """(picture, user seconds, seconds)"""
        user, wall = user_seconds(), time.perf_counter()
        picture = np.array(mi.render(self.scene, integrator=self.integrator, spp=self.spp, seed=seed))
        return picture.astype(np.float64), user_seconds() - user, time.perf_counter() - wall


def rmse(a, b):
    return np.sqrt(np.mean((a - b) ** 2))


def asking(timed, seed):
    """Of a render: user seconds within Scene.occluded(), its rays, and the share of them that fields or bounds decided."""
    scene = timed.integrator.converted.scene
    seconds, rays, undecided = 0.0, 0, 0

    class Counting:
        def occluded(self, origins, directions, tmax, left):
            nonlocal seconds, rays, undecided
            user = user_seconds()
            result = scene.occluded(origins, directions, tmax, left)
            seconds += user_seconds() - user
            rays += int((tmax >= 0).sum())
            certified = scene.occluded_certified(origins, directions, tmax, left)
            undecided += int((certified == fieldtrace.Occlusion.UNDECIDED).sum())
            return result

    timed.integrator.converted.scene = Counting()
    timed.render(seed)
    timed.integrator.converted.scene = scene
    return seconds, rays, 1 - undecided / max(rays, 1)


def measure(name, options):
    with tempfile.TemporaryDirectory() as folder:
        scene = example_scenes.EXAMPLES[name](folder, options.resolution)
        small = example_scenes.EXAMPLES[name](folder, 16)
    samples = {"emitter_samples": options.emitter_samples, "bsdf_samples": options.bsdf_samples}
    kinds = {
        "direct": {"type": "direct"},
        "fields": {"type": "fieldtrace_direct", "directions": options.directions, "plane": options.plane},
        "exact": {"type": "fieldtrace_direct", "tolerance": 0.0},
        "Mitsuba": {"type": "fieldtrace_direct", "shadows": "mitsuba"},
    }
    timed = {}
    for kind, description in kinds.items():
        # Kernels are compiled by another scene of the same kind.
        Timed(small, options.spp, **description, **samples).render(0)
        timed[kind] = Timed(scene, options.spp, **description, **samples)
    _, cold_direct, _ = timed["direct"].render(0)
    _, cold, _ = timed["fields"].render(0)
    timed["exact"].render(0), timed["Mitsuba"].render(0)
    ratios = {kind: [] for kind in kinds}
    walls, users, errors, pictures = [], [], [], []
    for seed in range(1, options.pairs + 1):
        picture, base, base_wall = timed["direct"].render(seed)
        pictures.append(picture)
        users.append(base)
        for kind in ("fields", "exact", "Mitsuba"):
            other, user, wall = timed[kind].render(seed)
            ratios[kind].append(user / base)
            if kind == "fields":
                errors.append(rmse(other, picture))
                walls.append(wall / base_wall)
    mean = np.mean(pictures)
    noise = np.mean([rmse(a, b) for a, b in zip(pictures, pictures[1:])]) / np.sqrt(2)
    seconds, rays, certified = asking(timed["fields"], 1)
    exact_seconds, *_ = asking(timed["exact"], 1)
    low, middle, high = np.percentile(ratios["fields"], (25, 50, 75))
    print(f"| {name} | {np.median(users):.2f} | {middle:.2f} ({low:.2f} to {high:.2f}) | {np.median(walls):.2f} | "
          f"{cold / cold_direct:.1f} | {np.median(ratios['exact']):.2f} | {np.median(ratios['Mitsuba']):.2f} | "
          f"{1e9 * seconds / max(rays, 1):.0f} / {1e9 * exact_seconds / max(rays, 1):.0f} | "
          f"{certified:.0%} | {np.mean(errors) / mean:.1e} | {noise / mean:.1e} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=7)
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--emitter-samples", type=int, default=1)
    parser.add_argument("--bsdf-samples", type=int, default=1)
    parser.add_argument("--directions", type=int, default=64)
    parser.add_argument("--plane", type=int, default=128)
    parser.add_argument("scenes", nargs="+", choices=sorted(example_scenes.EXAMPLES), metavar="SCENE")
    options = parser.parse_args()
    mi.set_log_level(mi.LogLevel.Error)
    print("| scene | direct: user s | fields: ratio (quartiles) | in wall time | cold | exact | Mitsuba | ns a ray: fields / "
          "exact | certified | error | noise |")
    print("|" + "---|" * 11)
    for name in options.scenes:
        measure(name, options)


if __name__ == "__main__":
    main()
