#!/usr/bin/env python3
"""Whole frames of scenes made at random: what fields gain over Monte Carlo at equal error.

    tools/benchmarks/random_frames.py [--kind sky|bounces|room|lamps] [--scenes 1-8] [--samples 1,4,16,4x16]
                                      [--targets E,E] [--other PROGRAM] [--repeats 3] [--work build/random]

One line a scene and number of samples: seconds and RMSE of Monte Carlo (the better of its two estimators, and of as
many camera samples of one light sample where 4x16 asks for 4 of 16) and of fields with a cache (warm) and without
(cold), and the gains: the time Monte Carlo takes to the same error over that of fields, its error falling as
samples^-3/4. The references' noise is taken out of RMSEs by using two of them. Floors in
the open reflect about 1 under skies, .25 under lamps. With --targets, pictures to an error are compared instead. With
--other, the gain of this program over another one follows, for each method. The last lines are geometric means.

Seconds are of whole frames but for loading the scene, building BVHs and writing the picture, in turns; medians.
References are kept in the work folder. Nothing else should run on the machine.
"""

import argparse
import math
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from measuring import random_scenes
from measuring.context import ROOT
from measuring.programs import ADAPTIVE, BenchmarkError, Programs, Shot, frame_seconds
from measuring.rows_target import Truth
from measuring.timing import in_turn


MONTE_CARLO = ("Monte Carlo", "adaptive", "camera samples")


def numbers(text):
    found = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def errors(text):
    return [float(part) for part in text.split(",")]


def splits(text):
    """Camera samples, and light samples of each: 1-3,4x16 is [(1, 1), (2, 1), (3, 1), (4, 16)]."""
    found = []
    for part in text.split(","):
        camera, _, light = part.partition("x")
        found += [(n, int(light or 1)) for n in numbers(camera)]
    return found


def size(text):
    width, height = text.split("x")
    return int(width), int(height)


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/bin/fieldtrace")
    parser.add_argument("--other", type=pathlib.Path, metavar="PROGRAM", help="a program to compare with")
    parser.add_argument("--kind", choices=random_scenes.KINDS, default="sky")
    parser.add_argument("--scenes", type=numbers, default=numbers("1-8"), metavar="LIST", help="as 1-8 or 3,5")
    parser.add_argument("--samples", type=splits, default=splits("1,4,16,64"), metavar="LIST",
                        help="camera samples; 4x16: of 16 light samples each")
    parser.add_argument("--targets", type=errors, metavar="LIST", help="errors to render to, instead of --samples")
    parser.add_argument("--repeats", type=int, default=3, metavar="N")
    parser.add_argument("--reference-spp", type=int, default=1024, metavar="N")
    parser.add_argument("--size", type=size, default=(400, 320), metavar="WxH")
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "build/random")
    return parser.parse_args(words)


class Scene:
    """A scene and its references, which are kept whatever the program: both methods agree but for their noise."""

    def __init__(self, programs, arguments, seed):
        self.name = f"{arguments.kind} {seed}"
        text = random_scenes.make(arguments.kind, seed, programs.work, lambda words: programs.mesh("mesh", words),
                                  arguments.size)
        self.path = programs.scene(self.name, text)
        self.programs = programs
        self.truth = Truth(programs, Shot(self.path), arguments.reference_spp, of_any_version=True)


def ways_of(programs, others, shot):
    """{name: (programs, shot, whether warm)}: the ways to make one picture."""
    fields = shot.with_(method="hybrid")
    found = {}
    for suffix, p in (("", programs), (" of the other", others)):
        if p:
            found |= {"Monte Carlo" + suffix: (p, shot, False),
                      "adaptive" + suffix: (p, shot.with_(options=(*shot.options, *ADAPTIVE)), False),
                      "cold" + suffix: (p, fields, False), "warm" + suffix: (p, fields, True)}
            if shot.light_samples > 1:
                split = shot.with_(spp=shot.spp * shot.light_samples, light_samples=1)
                found["camera samples" + suffix] = (p, split, False)
    return found


def measure(scene, ways, repeats):
    """{name: (median seconds, error, which is at least 1e-6)}."""
    picture = scene.programs.work / "picture.exr"

    def job(p, shot, warm, to=None):
        return lambda: frame_seconds(p.render(shot, picture=to, cache=p.cache_for(shot) if warm else None))

    found = {}
    for name, (p, shot, warm) in ways.items():
        job(p, shot, warm, picture)()
        found[name] = max(scene.truth.error(picture), 1e-6)
    times = in_turn({name: job(*way) for name, way in ways.items()}, repeats)
    return {name: (statistics.median(times[name]), found[name]) for name in ways}


def work(point):
    """What a way takes: its time at an error of 1."""
    seconds, error = point
    return seconds * error ** (4.0 / 3.0)


def gains(found):
    """{what: gain}."""
    result = {}
    for suffix in ("", " of the other"):
        if "warm" + suffix in found:
            best = min(work(found[name + suffix]) for name in MONTE_CARLO if name + suffix in found)
            for start in ("warm", "cold"):
                result[f"{start}{suffix} / Monte Carlo{suffix}"] = best / work(found[start + suffix])
    for name in (*MONTE_CARLO, "cold", "warm"):
        if f"{name} of the other" in found:
            result[f"{name} / that of the other"] = work(found[f"{name} of the other"]) / work(found[name])
    return result


def main(words):
    arguments = parse(words)
    programs = Programs(arguments.program.resolve(), arguments.work.resolve())
    others = Programs(arguments.other.resolve(), arguments.work.resolve() / "other") if arguments.other else None
    for p in filter(None, (programs, others)):
        p.drop_caches()
    collected = {}
    for seed in arguments.scenes:
        scene = Scene(programs, arguments, seed)
        steps = ([(f"to {t:g}", Shot(scene.path, spp=4096, options=("--target-error", f"{t:.9g}")))
                  for t in arguments.targets] if arguments.targets else
                 [(f"{n} samples" if light == 1 else f"{n} x {light} samples",
                   Shot(scene.path, spp=n, light_samples=light)) for n, light in arguments.samples])
        for step, shot in steps:
            found = measure(scene, ways_of(programs, others, shot), arguments.repeats)
            print(f"{scene.name}, {step}: " + ", ".join(f"{n} {s:.3f} s {e:.4f}" for n, (s, e) in found.items()))
            gained = gains(found)
            print("  gains " + ", ".join(f"{what} {gain:.2f}" for what, gain in gained.items()), flush=True)
            for what, gain in gained.items():
                collected.setdefault((step, what), []).append(gain)
        for p in filter(None, (programs, others)):
            p.drop_caches()
    for (step, what), values in collected.items():
        mean = math.exp(sum(map(math.log, values)) / len(values))
        print(f"{step}, {what}: {mean:.2f} (least {min(values):.2f}, most {max(values):.2f})")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except BenchmarkError as e:
        sys.exit(f"random_frames: {e}")
