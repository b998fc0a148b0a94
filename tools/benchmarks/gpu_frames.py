#!/usr/bin/env python3
"""Times whole frames answered by a GPU beside the same machine's CPU, with fields baked before.

    gpu_frames.py --device NAME [--program build/release/bin/fieldtrace] [--work DIR] [--repeats 5]
        [--resolution 1024] [--scenes NAME ...] [--options OPTIONS] --output FILE.json

NAME: of `fieldtrace render --device`. Of each scene, in turn: Monte Carlo, the hybrid on the CPU, the hybrid on the GPU.
Both hybrid pictures must be equal, bit for bit. The file holds the medians of the stages in seconds and each device's
counts; a table is printed. Exit codes: 0 all pictures are equal and the GPU answered; 1 not; 2 wrong use.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

SCENES = {
    "bunny over a floor": ("bunny_floor.xml", "--spp 4 --light-samples 16", 1),
    "three objects, three lights": ("three_objects.xml", "--spp 4 --light-samples 16", 1),
    "three objects, 16 x 1": ("three_objects.xml", "--spp 16 --light-samples 1", 1),
    "sky": ("sky.xml", "--spp 16", 1),
    "ambient occlusion": ("three_objects.xml", "--spp 4 --light-samples 16 --aov ao", 1),
    "glossy floor": ("glossy_floor.xml", "--light-samples 4 --lobe-samples 256", 0.5),
}
METHODS = {
    "monte carlo": "--method montecarlo --light-estimator adaptive",
    "cpu": "--method hybrid --device cpu",
    "gpu": "--method hybrid --device {device}",
}


def make_meshes(program, work):
    """Writes the meshes of three_objects.xml; returns the options that name them."""
    shapes = {
        "shape1": "supershape --m 7 --n1 0.6 --n2 1.2 --n3 1.2 --m-lat 3 --n1-lat 1.2 --n2-lat 1.6 --n3-lat 1.6",
        "shape2": "supershape --m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10",
        "knot": "knot --along 512 --around 24",
    }
    options = []
    for name, arguments in shapes.items():
        path = work / f"{name}.ply"
        subprocess.run([program, "mesh", *arguments.split(), "-o", path], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        options += ["-D", f"{name}={path}"]
    return {"three_objects.xml": options}


def frame_seconds(stats):
    """Seconds of a frame: all but what reads, builds and writes."""
    time = stats["time"]
    return time["total"] - time["load"] - time["build"] - time["write"]


def render(program, device, scene, options, method, work):
    picture, stats = work / f"{method}.exr", work / "stats.json"
    subprocess.run([program, "render", ROOT / "scenes" / scene, "-o", picture, "--float32", "--quiet", "--stats", stats,
                    *METHODS[method].format(device=device).split(), *options], check=True)
    return json.loads(stats.read_text(encoding="utf-8"))


def pixel_bytes(path):
    """What an EXR file holds beyond its header, whose attributes tell how it was made, and its table of offsets."""
    data = path.read_bytes()
    at = 8  # magic number and version
    while data[at]:
        at = data.index(b"\0", data.index(b"\0", at) + 1) + 1  # name and type
        at += 4 + int.from_bytes(data[at:at + 4], "little")
    return data[int.from_bytes(data[at + 1:at + 9], "little"):]


def is_equal(work):
    """Whether all layers of the two pictures are the same, bit for bit."""
    return pixel_bytes(work / "cpu.exr") == pixel_bytes(work / "gpu.exr")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", required=True)
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/bin/fieldtrace")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("gpu_frames"))
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--resolution", type=int, default=1024)
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--options", default="", help="further options of fieldtrace, for all renders")
    parser.add_argument("--output", type=pathlib.Path, required=True)
    arguments = parser.parse_args()
    device = arguments.device
    program, work = arguments.program.resolve(), arguments.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    meshes = make_meshes(program, work)
    report, fine = {}, True
    print(f"{'scene':28} {'frame: MC':>10} {'CPU':>8} {'GPU':>8}   {'secondary: CPU':>14} {'GPU':>8}  blocks GPU, CPU")
    for name in arguments.scenes:
        scene, options, scale = SCENES[name]
        options = [*options.split(), *arguments.options.split(), *meshes.get(scene, []), "-D",
                   f"resolution={int(arguments.resolution * scale)}"]
        cache = ["--field-cache", work / f"cache_{scene}"]
        runs = {method: [] for method in METHODS}
        render(program, device, scene, [*options, *cache], "cpu", work)
        for _ in range(arguments.repeats):
            for method, of in runs.items():
                with_cache = options if method == "monte carlo" else [*options, *cache]
                of.append(render(program, device, scene, with_cache, method, work))
        equal = is_equal(work)
        row = report[name] = {"options": " ".join(map(str, options)), "equal": equal, "by": {}}
        for method, of in runs.items():
            stages = {stage: statistics.median(s["time"][stage] for s in of) for stage in of[0]["time"]}
            row["by"][method] = {"frame": statistics.median(map(frame_seconds, of)), "time": stages,
                                 "device": of[-1]["device"], "lookups": of[-1]["lookups"], "rays": of[-1]["rays"],
                                 "field": of[-1]["field"], "threads": of[-1]["threads"]}
        by = row["by"]
        answered = by["gpu"]["device"]
        fine = fine and equal and answered["name"] == device and answered["blocks"] > 0
        print(f"{name:28} {by['monte carlo']['frame']:10.3f} {by['cpu']['frame']:8.3f} {by['gpu']['frame']:8.3f}   "
              f"{by['cpu']['time']['secondary']:14.3f} {by['gpu']['time']['secondary']:8.3f}  {answered['blocks']}, "
              f"{answered['blocks_cpu']}{'' if equal else '  NOT EQUAL'}", flush=True)
        arguments.output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
