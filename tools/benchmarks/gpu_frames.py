#!/usr/bin/env python3
"""Times whole frames answered by a GPU beside the same machine's CPU, with fields baked before.

    gpu_frames.py --device NAME [--program build/release/bin/fieldtrace] [--work DIR] [--repeats 5]
        [--resolution 1024] [--scenes NAME ...] [--options OPTIONS] --output FILE.json

NAME: of `fieldtrace render --device`. Of each scene, in turn: Monte Carlo, the hybrid on the CPU, the hybrid on the
GPU. Both hybrid pictures must be equal, bit for bit. The file holds the medians of the stages in seconds and each
device's counts; a table is printed. Exit codes: 0 all pictures are equal and the GPU answered; 1 not; 2 wrong use.
"""

import argparse
import json
import pathlib
import sys

from measuring.context import Context
from measuring.programs import Programs, frame_seconds
from measuring.timing import in_turn, summary

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Scene, samples of `Shot`, further options, and the share of the resolution.
SCENES = {
    "bunny over a floor": ("bunny_floor.xml", {"spp": 4, "light_samples": 16}, (), 1),
    "three objects, three lights": ("three_objects.xml", {"spp": 4, "light_samples": 16}, (), 1),
    "three objects, 16 x 1": ("three_objects.xml", {"spp": 16}, (), 1),
    "sky": ("sky.xml", {"spp": 16}, (), 1),
    "ambient occlusion": ("three_objects.xml", {"spp": 4, "light_samples": 16}, ("--aov", "ao"), 1),
    "glossy floor": ("glossy_floor.xml", {"light_samples": 4}, ("--lobe-samples", "256"), 0.5),
}


def pixel_bytes(path):
    """What an EXR file holds beyond its header, whose attributes tell how it was made, and its table of offsets."""
    data = path.read_bytes()
    at = 8  # magic number and version
    while data[at]:
        at = data.index(b"\0", data.index(b"\0", at) + 1) + 1  # name and type
        at += 4 + int.from_bytes(data[at:at + 4], "little")
    return data[int.from_bytes(data[at + 1:at + 9], "little"):]


def measure(context, device, shot):
    """Medians of the stages of one scene by each method, with the counts of its last render."""
    programs = context.programs
    monte_carlo = shot.with_(options=(*shot.options, "--light-estimator", "adaptive"))
    cpu, gpu = (shot.with_(method="hybrid", options=(*shot.options, "--device", name)) for name in ("cpu", device))
    cache = programs.cache_for(cpu)
    pictures = {name: programs.work / f"{name}.exr" for name in ("cpu", "gpu")}
    runs = in_turn({"monte carlo": lambda: programs.render(monte_carlo),
                    "cpu": lambda: programs.render(cpu, pictures["cpu"], cache),
                    "gpu": lambda: programs.render(gpu, pictures["gpu"], cache)}, context.repeats)
    by = {}
    for method, of in runs.items():
        stages = {stage: summary(s["time"][stage] for s in of)["median"] for stage in of[0]["time"]}
        by[method] = {"frame": summary(map(frame_seconds, of))["median"], "time": stages,
                      **{key: of[-1][key] for key in ("device", "lookups", "rays", "field", "threads")}}
    # Bit for bit, in all layers.
    equal = pixel_bytes(pictures["cpu"]) == pixel_bytes(pictures["gpu"])
    return {"options": " ".join(gpu.words()), "equal": equal, "by": by}


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
    context = Context(Programs(arguments.program.resolve(), arguments.work.resolve()), arguments.repeats, quick=False)
    context.programs.drop_caches()
    report, fine = {}, True
    print(f"{'scene':28} {'frame: MC':>10} {'CPU':>8} {'GPU':>8}   {'secondary: CPU':>14} {'GPU':>8}  blocks GPU, CPU")
    for name in arguments.scenes:
        scene, samples, options, scale = SCENES[name]
        defines = context.three_objects() if scene == "three_objects.xml" else ()
        shot = context.shot(scene, int(arguments.resolution * scale), defines,
                            options=(*options, *arguments.options.split()), **samples)
        row = report[name] = measure(context, device, shot)
        by = row["by"]
        answered = by["gpu"]["device"]
        fine = fine and row["equal"] and answered["name"] == device and answered["blocks"] > 0
        print(f"{name:28} {by['monte carlo']['frame']:10.3f} {by['cpu']['frame']:8.3f} {by['gpu']['frame']:8.3f}   "
              f"{by['cpu']['time']['secondary']:14.3f} {by['gpu']['time']['secondary']:8.3f}  {answered['blocks']}, "
              f"{answered['blocks_cpu']}{'' if row['equal'] else '  NOT EQUAL'}", flush=True)
        arguments.output.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
