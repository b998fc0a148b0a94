#!/usr/bin/env python3
"""Prints the rows of the two tables in README.md: seconds of Monte Carlo and of fields, cold and warm.

    tools/benchmarks/readme_figures.py [--program build/release/bin/fieldtrace] [--repeats 5] [--work build/readme]
                                       [--only NAME ...]

Each row is rendered by Monte Carlo, by fields with an empty cache (cold), and by fields with the cache filled by that
(warm), interleaved; medians of `time.total` and, in brackets, of `time.secondary` (shadow and glossy rays). Nothing
else should run on the machine; the load average before and after is printed.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess

FLOOR = "scenes/bunny_floor.xml --spp 1 --light-samples 64"
# Name: arguments of `render`; {work} is the folder of generated meshes.
CASES = {
    "many samples a point": FLOOR,
    "close-up": "scenes/bunny_closeup.xml --spp 1 --light-samples 64",
    "wide light": FLOOR + " -D light_radius=0.8",
    "2 M triangles": FLOOR + " -D format=ply -D mesh={work}/knot.ply",
    "4 x 16 samples": "scenes/bunny_floor.xml --spp 4 --light-samples 16",
    "few samples, two lights": "scenes/demo.xml",
    "wires": "scenes/stress.xml --light-samples 64 -D objects={work}/globe.xml",
    "crowd": "scenes/crowd.xml --light-samples 16 -D crowd={work}/instances.xml",
    "glossy rays": "scenes/glossy_floor.xml --light-samples 4 --lobe-samples 16",
}
SHAPES = {
    "shape1": "--m 7 --n1 0.6 --n2 1.2 --n3 1.2 --m-lat 3 --n1-lat 1.2 --n2-lat 1.6 --n3-lat 1.6",
    "shape2": "--m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10",
}


def run(*command):
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def make_meshes(program, work):
    work.mkdir(parents=True, exist_ok=True)
    run(program, "mesh", "knot", "--along", 31250, "--around", 32, "-o", work / "knot.ply")
    for name, words in SHAPES.items():
        run(program, "mesh", "supershape", "-o", work / f"{name}.ply", *words.split())
    tools = pathlib.Path(__file__).resolve().parent.parent
    stress = next(tools.rglob("stress_report.py"))
    run("python3", stress, "--program", program, "-o", work, "--only", "globe", "--light-samples", 1, "--resolution", 8)
    run("python3", tools / "make_crowd.py", "--program", program, "-o", work)


def seconds(program, arguments, work):
    stats = work / "stats.json"
    run(program, "render", *arguments, "-o", work / "picture.exr", "--stats", stats)
    time = json.loads(stats.read_text())["time"]
    return time["total"], time["secondary"]


def measure(program, arguments, work, repeats):
    methods = {"Monte Carlo": ["--method", "montecarlo", "--light-estimator", "adaptive"]}
    methods["cold"] = methods["warm"] = ["--field-cache", str(work / "cache")]
    found = {method: [] for method in methods}
    for _ in range(repeats):
        shutil.rmtree(work / "cache", ignore_errors=True)
        for method, options in methods.items():
            found[method].append(seconds(program, arguments + options, work))
    return [tuple(statistics.median(column) for column in zip(*times)) for times in found.values()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="build/release/bin/fieldtrace")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/readme"))
    parser.add_argument("--only", nargs="*", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    work = options.work.resolve()
    make_meshes(options.program, work)
    print("load average", *(f"{load:.1f}" for load in os.getloadavg()))
    print("| | Monte Carlo | fields, cold | fields, warm |\n|---|---|---|---|")
    for name in options.only:
        arguments = CASES[name].format(work=work).split()
        if name == "few samples, two lights":
            arguments += [word for shape in SHAPES for word in ("-D", f"{shape}={work / shape}.ply")]
        measured = measure(options.program, arguments, work, options.repeats)
        cells = [re.sub(r"\b0\.", ".", f"{total:.2f} ({secondary:.2f})") for total, secondary in measured]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("load average", *(f"{load:.1f}" for load in os.getloadavg()))


if __name__ == "__main__":
    main()
