#!/usr/bin/env python3
"""Compares the Monte Carlo renderer with Mitsuba 3 on scene files that both can read.

Both programs render every scene with several seeds. The spread over the seeds gives the noise of each mean, and the
test fails if the programs differ by more: by over 0.1 % plus three standard errors in the image's mean, or over 1 %
plus five standard errors in a block of 16 x 16 pixels. On failure both images and their difference are left in the
output folder.

Needs the Python package `mitsuba`; without it the test is skipped (exit code 77).
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import tempfile

SKIPPED = 77
BLOCK = 16
# Relative tolerance beyond noise, and the number of standard errors that count as noise (more for the many blocks).
MEAN_TOLERANCE, MEAN_SIGMAS = 0.001, 3.0
BLOCK_TOLERANCE, BLOCK_SIGMAS = 0.01, 5.0
FLOOR = 0.01  # of the image's mean: darker blocks are compared relative to this

try:
    import mitsuba as mi
    import numpy as np
except ImportError:
    print("skipped: the Python package 'mitsuba' is not installed")
    sys.exit(SKIPPED)


MAKE_REFLECTIONS = pathlib.Path(__file__).resolve().parents[2] / "tools" / "make_reflections.sh"


def with_meshes(scene, program, folder):
    """The scene, or a copy of it beside the meshes that it refers to in ../reflections."""
    if "../reflections/" not in scene.read_text():
        return scene
    if not (folder / "reflections").exists():
        subprocess.run([MAKE_REFLECTIONS, program, folder / "reflections"], check=True, stdout=subprocess.DEVNULL)
    (folder / "scenes").mkdir(exist_ok=True)
    return pathlib.Path(shutil.copy(scene, folder / "scenes"))


def render_ours(program, scene, arguments, seed, folder):
    path = folder / f"ours_{seed}.exr"
    command = [program, "render", str(scene), "-o", str(path), "--method", "montecarlo", "--quiet",
               "--spp", str(arguments.spp), "--seed", str(seed), "--light-samples", str(arguments.light_samples),
               "--lobe-samples", str(arguments.lobe_samples), "-D", f"resolution={arguments.resolution}"]
    subprocess.run(command, check=True)
    bitmap = mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32)
    return np.array(bitmap, dtype=np.float64)


def render_theirs(scene, arguments, seed):
    loaded = mi.load_file(str(scene), resolution=str(arguments.resolution))
    return np.array(mi.render(loaded, seed=seed, spp=arguments.spp), dtype=np.float64)[:, :, :3]


def blocks(picture):
    height, width, _ = picture.shape
    cut = picture[:height // BLOCK * BLOCK, :width // BLOCK * BLOCK].mean(axis=2)
    return cut.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))


def mean_and_variance(values):
    """The mean over the seeds, and the variance of that mean."""
    values = np.stack(values)
    return values.mean(axis=0), values.var(axis=0, ddof=1) / len(values)


def compare(ours, theirs):
    """Returns the relative difference of the means, its noise and excess over noise, and the worst block's excess and
    index."""
    mean_a, variance_a = mean_and_variance([p.mean() for p in ours])
    mean_b, variance_b = mean_and_variance([p.mean() for p in theirs])
    excess_mean = max(abs(mean_a - mean_b) - MEAN_SIGMAS * np.sqrt(variance_a + variance_b), 0.0) / mean_b

    block_a, noise_a = mean_and_variance([blocks(p) for p in ours])
    block_b, noise_b = mean_and_variance([blocks(p) for p in theirs])
    # A variance from a few seeds is itself uncertain: half of it comes from the image's average.
    noise = noise_a + noise_b
    noise = 0.5 * (noise + noise.mean())
    excess = np.maximum(np.abs(block_a - block_b) - BLOCK_SIGMAS * np.sqrt(noise), 0.0)
    excess /= np.maximum(block_b, FLOOR * mean_b)
    worst = np.unravel_index(np.argmax(excess), excess.shape)
    difference = mean_a / mean_b - 1.0
    noise_of_mean = np.sqrt(variance_a + variance_b) / mean_b
    return difference, noise_of_mean, excess_mean, excess[worst], worst


def save(folder, name, ours, theirs):
    folder.mkdir(parents=True, exist_ok=True)
    a, b = np.mean(ours, axis=0), np.mean(theirs, axis=0)
    for suffix, picture in (("ours", a), ("mitsuba", b), ("difference", a - b)):
        mi.Bitmap(picture.astype(np.float32)).write(str(folder / f"{name}_{suffix}.exr"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", required=True, help="the command line program")
    parser.add_argument("--output", type=pathlib.Path, default=pathlib.Path("peer"),
                        help="folder for pictures on failure")
    parser.add_argument("--seeds", type=int, default=5, help="renders per program and scene (at least 2)")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--light-samples", type=int, default=2)
    parser.add_argument("--lobe-samples", type=int, default=1)
    parser.add_argument("--resolution", type=int, default=128)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    arguments = parser.parse_args()

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    failed = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        for named in arguments.scenes:
            scene = with_meshes(named, arguments.program, folder)
            ours = [render_ours(arguments.program, scene, arguments, seed, folder)
                    for seed in range(1, arguments.seeds + 1)]
            theirs = [render_theirs(scene, arguments, seed) for seed in range(101, 101 + arguments.seeds)]
            difference, noise, excess_mean, excess_block, worst = compare(ours, theirs)
            good = excess_mean < MEAN_TOLERANCE and excess_block < BLOCK_TOLERANCE
            print(f"{'ok    ' if good else 'FAILED'} {scene.stem:32s} mean {100 * difference:+.3f} % "
                  f"(standard error {100 * noise:.3f} %), beyond noise: mean {100 * excess_mean:.2f} %, "
                  f"worst block {tuple(int(i) for i in worst)} {100 * excess_block:.2f} %", flush=True)
            if not good:
                failed.append(scene.stem)
                save(arguments.output, scene.stem, ours, theirs)
    if failed:
        print(f"{len(failed)} of {len(arguments.scenes)} scenes disagree; pictures are in {arguments.output}")
        return 1
    print(f"all {len(arguments.scenes)} scenes agree")
    return 0


if __name__ == "__main__":
    sys.exit(main())
