#!/usr/bin/env python3
"""Renders objects that are hard for fields by both methods, and prints the fields' errors as a table.

    tools/benchmarks/stress_report.py [--program build/release/bin/fieldtrace] [-o stress] [--only NAME ...]
                           [--light-samples 1024] [--resolution 256] [-- OPTIONS OF render]

Generates the meshes and STRESS/NAME.xml for scenes/stress.xml, renders each object under lights of 4 and 20 degrees by
Monte Carlo and by fields with the same samples, and prints one Markdown row for each: RMSE, worst 16 x 16 block, traced
share of the rays near an object, baked and traced rays relative to Monte Carlo's, and the share of wrong certified
answers by verdict and by the shading point's object (the occluder itself or another). Monte Carlo images are cached.
"""

import argparse
import json
import pathlib
import subprocess
import sys

BUNNY = "/usr/share/glmark2/models/bunny.obj"
# Name: the objects over the floor, as (words of `fieldtrace mesh` or a file, transform), and whether they are solid.
UP = '<rotate x="1" angle="-90"/>'
OBJECTS = {
    "supershape": ([("supershape", '<translate y="1"/>')], True),
    "knot": ([("knot", '<rotate x="1" angle="-60"/><translate y="1"/>')], True),
    "bunny": ([(BUNNY, '<translate y="1"/>')], True),
    "crossed": ([("knot", '<rotate x="1" angle="-60"/><translate y="1"/>'),
                 ("supershape --m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10",
                  '<scale value="0.8"/><translate x="0.2" y="0.9"/>')], True),
    "comb": ([("comb", '<rotate y="1" angle="30"/><translate y="0.6"/>')], False),
    "globe": ([("globe", UP + '<translate y="1"/>')], False),
    "hairs": ([("hairs", '<translate y="1"/>')], False),
    "sheet": ([("sheet", '<rotate x="1" angle="-60"/><translate y="0.8"/>')], False),
    "holes": ([("holes", UP + '<translate y="1"/>')], False),
    "fan": ([("fan --slivers 2000 --aspect 0.002", '<rotate z="1" angle="50"/><translate y="0.9"/>')], False),
    "hyperboloid": ([("hyperboloid", UP + '<translate y="0.8"/>')], False),
}
LIGHTS = {4: ("0.16", "2800"), 20: ("0.72", "138")}  # radius and radiance: the same flux


def make_objects(program, folder, name):
    shapes = []
    for i, (words, transform) in enumerate(OBJECTS[name][0]):
        mesh = pathlib.Path(words)
        if not mesh.is_absolute():
            mesh = (folder / f"{name}_{i}.ply").resolve()
            if not mesh.exists():
                subprocess.run([program, "mesh", *words.split(), "-o", str(mesh)], check=True,
                               stderr=subprocess.DEVNULL)
        elif not mesh.exists():
            sys.exit(f"stress_report: {mesh} is missing; install glmark2-data")
        shapes.append(f'  <shape type="{mesh.suffix[1:]}"><string name="filename" value="{mesh}"/>'
                      f'<transform name="to_world">{transform}</transform><ref id="clay"/></shape>\n')
    path = (folder / f"{name}.xml").resolve()
    path.write_text('<scene version="3.0.0">\n' + "".join(shapes) + "</scene>\n", encoding="utf-8")
    return path


def render(arguments, objects, light, out, more):
    scene = pathlib.Path(__file__).resolve().parents[2] / "scenes" / "stress.xml"
    # Renamed only on success: a truncated image must not be reused.
    unfinished, stats = out.with_suffix(".tmp"), out.with_suffix(".json")
    radius, radiance = LIGHTS[light]
    subprocess.run([arguments.program, "render", str(scene), "-o", str(out), "--stats", str(unfinished), "--quiet",
                    "--spp", "1", "--light-samples", str(arguments.light_samples), "-D", f"objects={objects}",
                    "-D", f"light_radius={radius}", "-D", f"radiance={radiance}",
                    "-D", f"resolution={arguments.resolution}", *more], check=True)
    unfinished.replace(stats)
    return json.loads(stats.read_text())


def percent(part, whole):
    return f"{100.0 * part / whole:.3g}" if whole else "-"


def report(arguments, name, light):
    folder = arguments.folder
    objects = make_objects(arguments.program, folder, name)
    stem = f"{name}_{light}_{arguments.light_samples}_{arguments.resolution}"
    exact, fields = folder / f"{stem}_exact.exr", folder / f"{stem}_fields.exr"
    if not exact.with_suffix(".json").exists():
        render(arguments, objects, light, exact, ["--method", "montecarlo"])
    carlo = json.loads(exact.with_suffix(".json").read_text())
    s = render(arguments, objects, light, fields, ["--check", *arguments.options])
    compared = subprocess.run([arguments.program, "compare", "--json", str(fields), str(exact)], check=True,
                              capture_output=True, text=True)
    d = json.loads(compared.stdout)
    check = s["check"]
    kinds = [check[verdict][place] for verdict in ("clear", "blocked") for place in ("other", "own")]
    wrong = [percent(kind["wrong"], kind["answers"]) for kind in kinds]
    print(f"| {name} | {light} | {s['field']['directions']} x {s['field']['plane']} | {d['rmse']:.5f} "
          f"| {d['worst_block']['rmse']:.4f} | {100 * s['exact_fraction']:.1f} "
          f"| {s['bake']['rays'] / 1e6:.2f} + {s['rays']['exact'] / 1e6:.2f} / {carlo['rays']['exact'] / 1e6:.2f} "
          f"| {percent(check['wrong'], check['answers'])} | {' / '.join(wrong)} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="build/release/bin/fieldtrace")
    parser.add_argument("-o", dest="folder", default="stress", type=pathlib.Path)
    parser.add_argument("--only", nargs="+", choices=list(OBJECTS), default=list(OBJECTS))
    parser.add_argument("--light-samples", default=1024, type=int)
    parser.add_argument("--resolution", default=256, type=int)
    parser.add_argument("options", nargs="*", help="further options of render, after --")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    print("| object | light | D x N | RMSE | worst block | exact % | million rays: bake + exact / Monte Carlo "
          "| wrong % | clear other / own, blocked other / own |\n" + "|---" * 9 + "|", flush=True)
    try:
        for name in arguments.only:
            for light in LIGHTS:
                report(arguments, name, light)
    except FileNotFoundError:
        sys.exit(f"stress_report: {arguments.program} is missing; build it (tools/build.sh) or name it with --program")
    except subprocess.CalledProcessError as e:
        sys.exit(f"stress_report: {e.cmd[0]} {e.cmd[1]} failed; see its message above")


if __name__ == "__main__":
    main()
