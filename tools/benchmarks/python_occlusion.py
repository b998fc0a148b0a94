#!/usr/bin/env python3
"""What shadow rays cost when they are asked from Python: occluded() against the same batch inside the renderer.

    python_occlusion.py --program build/release/bin/occlusion_batch [--rays N] [--pairs N] [--triangles N]

Needs the Python package, and the program, which is built with -DFIELDTRACE_BENCHMARKS=ON. The batch: rays from a floor
to points of a lamp, sorted as a picture's; a knot between them. All have baked what the rays ask for before. Seconds are
user seconds of the process that answers, in turns; a ratio is the median over pairs of turns, with its quartiles.
"renderer": batches that are filled already, by ShadowAnswerer; "library": ftOccluded() from C++; "Python": float32
arrays, packed; then others' layouts.
"""

import argparse
import pathlib
import resource
import subprocess
import tempfile

import numpy as np

import fieldtrace
from knot_mesh import knot


def rays_of_floor(count):
    random = np.random.default_rng(1)
    side = int(np.ceil(np.sqrt(count)))
    x, z = np.meshgrid(np.linspace(-2.5, 2.5, side), np.linspace(-2.5, 2.5, side))
    origins = np.stack([x, np.full_like(x, -1), z], -1).reshape(-1, 3)[:count]
    lamp = np.stack([random.uniform(0.5, 1.5, count), np.full(count, 4), random.uniform(-0.5, 0.5, count)], -1)
    return origins.astype(np.float32), (lamp - origins).astype(np.float32), np.full(count, 0.999, np.float32)


def user_seconds():
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=pathlib.Path, required=True)
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--pairs", type=int, default=21)
    parser.add_argument("--repeats", type=int, default=3, help="of the batch in a turn")
    parser.add_argument("--before", type=int, default=150, help="times that the batch is asked first, until bakes are due")
    parser.add_argument("--triangles", type=int, default=100_000)
    options = parser.parse_args()

    positions, triangles = knot(options.triangles // 100, 50)
    origins, directions, t_max = rays_of_floor(options.rays)
    scene = fieldtrace.Scene()
    scene.add_instance(scene.add_mesh(positions, triangles))
    scene.commit()
    kinds = {
        "Python": (origins, directions, t_max),
        "Python, structured": None,
        "Python, float64": tuple(a.astype(np.float64) for a in (origins, directions, t_max)),
        "Python, an array of each part": (np.asfortranarray(origins), np.asfortranarray(directions), t_max),
    }
    records = np.zeros(options.rays, [("o", np.float32, 3), ("d", np.float32, 3), ("t", np.float32)])
    records["o"], records["d"], records["t"] = origins, directions, t_max
    kinds["Python, structured"] = (records["o"], records["d"], records["t"])

    with tempfile.NamedTemporaryFile() as file:
        file.write(np.array([len(positions), len(triangles), options.rays], np.uint32).tobytes())
        for array in (positions, triangles, origins, directions, t_max):
            file.write(array.tobytes())
        file.flush()
        program = subprocess.Popen([options.program, file.name], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

        def turn(kind, repeats):
            if kind in kinds:
                begin = user_seconds()
                for _ in range(repeats):
                    blocked = scene.occluded(*kinds[kind])
                return user_seconds() - begin, int(blocked.sum())
            program.stdin.write(f"{kind} {repeats}\n")
            program.stdin.flush()
            seconds, blocked = program.stdout.readline().split()
            return float(seconds), int(blocked)

        everything = ["renderer", "library", *kinds]
        blocked = {kind: turn(kind, options.before)[1] for kind in everything}  # bakes
        if len(set(blocked.values())) != 1:
            raise SystemExit(f"answers differ: {blocked}")
        print(f"{options.rays} rays, {blocked['Python'] / options.rays:.0%} blocked, "
              f"{scene.get('certified_occlusion'):.0%} certified")
        seconds = {kind: [] for kind in everything}
        for _ in range(options.pairs):
            for kind in everything:
                seconds[kind].append(turn(kind, options.repeats)[0] / options.repeats)
        program.stdin.close()
        program.wait()
    print("| batch | user ns a ray | of renderer's (quartiles) | of library's (quartiles) |\n|---|---|---|---|")
    for kind in everything:
        cells = []
        for base in ("renderer", "library"):
            low, middle, high = np.percentile(np.array(seconds[kind]) / np.array(seconds[base]), (25, 50, 75))
            cells.append(f"{middle:.3f} ({low:.3f} to {high:.3f})")
        print(f"| {kind} | {1e9 * np.median(seconds[kind]) / options.rays:.1f} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
