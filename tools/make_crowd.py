#!/usr/bin/env python3
"""Generates the files that scenes/crowd.xml includes: meshes, and instances of them scattered over the floor.

    tools/make_crowd.py [--program build/release/bin/fieldtrace] [-o crowd] [--instances 10000] [--seed 1]
        [--mesh "knot --along 1562 --around 32" ...]

writes crowd/object_0.ply, crowd/object_1.ply ... and crowd/instances.xml: ten default meshes, or those given by --mesh
as arguments of `fieldtrace mesh`. The same arguments give the same files. Meshes are referenced by absolute paths,
because Mitsuba resolves relative ones against the main scene file, not the included one.
"""

import argparse
import math
import pathlib
import random
import subprocess
import sys
from xml.sax.saxutils import quoteattr

# About 8,000 triangles each, all within the unit sphere.
OBJECTS = [
    "supershape --m 6 --around 96 --along 42",
    "supershape --m 7 --n1 0.6 --n2 1.2 --n3 1.2 --m-lat 3 --n1-lat 1.2 --n2-lat 1.6 --n3-lat 1.6 --around 96 --along 42",
    "supershape --m 5 --n1 0.4 --n2 1.7 --n3 1.7 --m-lat 4 --n1-lat 10 --n2-lat 10 --n3-lat 10 --around 96 --along 42",
    "supershape --m 3 --n1 4 --n2 10 --n3 10 --around 96 --along 42",
    "hyperboloid --around 96 --along 42",
    "hyperboloid --waist 0.15 --rim 0.5 --around 96 --along 42",
    "knot --along 256 --around 16",
    "knot --p 2 --q 5 --tube 0.07 --along 256 --around 16",
    "knot --p 3 --q 2 --tube 0.07 --along 256 --around 16",
    "sphere --radius 0.8 --around 96 --along 42",
]
HALF_WIDTH = 50.0  # of the filled square, as in scenes/crowd.xml
COLOURS = ["ochre", "slate", "moss"]


def make_meshes(program, folder, objects):
    for i, words in enumerate(objects):
        subprocess.run([program, "mesh", *words.split(), "-o", str(folder / f"object_{i}.ply")], check=True)


def write_instances(path, count, seed, objects):
    rng = random.Random(seed)
    # One instance per cell of a square grid, away from the cell's border, so that none covers another entirely.
    columns = max(math.ceil(math.sqrt(count)), 1)
    cell = 2.0 * HALF_WIDTH / columns
    with open(path, "w", encoding="utf-8") as out:
        out.write('<?xml version="1.0" encoding="utf-8"?>\n<scene version="3.0.0">\n')
        for i in range(objects):
            mesh = quoteattr(str(path.resolve().parent / f"object_{i}.ply"))
            out.write(f'  <shape type="shapegroup" id="group_{i}"><shape type="ply">'
                      f'<string name="filename" value={mesh}/><ref id="{COLOURS[i % len(COLOURS)]}"/>'
                      f"</shape></shape>\n")
        for n in range(count):
            x = (n % columns + rng.uniform(0.3, 0.7)) * cell - HALF_WIDTH
            z = (n // columns + rng.uniform(0.3, 0.7)) * cell - HALF_WIDTH
            size = cell * rng.uniform(0.25, 0.6)
            axis = [rng.uniform(-1.0, 1.0) for _ in range(3)]
            length = math.hypot(*axis)  # Mitsuba assumes unit axes
            axis = [a / length for a in axis]
            out.write(f'  <shape type="instance"><transform name="to_world">'
                      f'<rotate value="{axis[0]:.7f} {axis[1]:.7f} {axis[2]:.7f}" angle="{rng.uniform(0, 360):.3f}"/>'
                      f'<scale value="{size:.5f}"/><translate x="{x:.5f}" y="{size:.5f}" z="{z:.5f}"/></transform>'
                      f'<ref id="group_{rng.randrange(objects)}"/></shape>\n')
        out.write("</scene>\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="build/release/bin/fieldtrace")
    parser.add_argument("-o", dest="folder", default="crowd", type=pathlib.Path)
    parser.add_argument("--instances", default=10000, type=int)
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--mesh", action="append", metavar="WORDS", help="may be repeated (default: ten meshes)")
    arguments = parser.parse_args()
    if arguments.instances < 1:
        sys.exit(f"make_crowd: --instances is {arguments.instances}; it must be 1 or more")
    objects = arguments.mesh or OBJECTS
    arguments.folder.mkdir(parents=True, exist_ok=True)
    try:
        make_meshes(arguments.program, arguments.folder, objects)
    except FileNotFoundError:
        sys.exit(f"make_crowd: {arguments.program} is missing; build it (tools/build.sh) or name it with --program")
    except subprocess.CalledProcessError as e:
        sys.exit(f"make_crowd: {e.cmd[0]} failed; see its message above")
    write_instances(arguments.folder / "instances.xml", arguments.instances, arguments.seed, len(objects))


if __name__ == "__main__":
    main()
