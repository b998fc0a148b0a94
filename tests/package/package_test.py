#!/usr/bin/env python3
"""Installs a build into an empty prefix, and builds and runs outside programs there that see nothing else.

    package_test.py BUILD

Checks also that the shared library shows ft* alone, and that pkg-config finds the package. Exit code 1 at the first
failure.
"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

import api_pages

HERE = pathlib.Path(__file__).resolve().parent
DOCUMENTS = HERE.parents[1] / "docs/api"
EXAMPLES = HERE.parents[1] / "examples"
EXAMPLE = re.compile(r"^```c\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run(*command, **options):
    result = subprocess.run([str(c) for c in command], text=True, capture_output=True, **options)
    if result.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {result.returncode}\n{result.stdout}{result.stderr}")
    return result.stdout


def check_symbols(library):
    shown = [line.split()[-1].split("@")[0] for line in run("nm", "-D", "--defined-only", library).splitlines()]
    foreign = [name for name in shown if not name.startswith("ft") and not name.startswith("FIELDTRACE_")]
    if foreign or len(shown) < 30:
        sys.exit(f"{library} shows {foreign or shown}")


def check_picture(path):
    """Light, penumbrae and the background: many shades, some black."""
    shades = set(path.read_bytes()[-3 * 192 * 128:])
    if len(shades) < 100 or 0 not in shades:
        sys.exit(f"{path} has {len(shades)} shades")


def main():
    build = pathlib.Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        prefix = folder / "prefix"
        run("cmake", "--install", build, "--prefix", prefix)
        check_symbols(prefix / "lib/libfieldtrace.so")
        for name, programs in (("consumer_c", ["consumer", "consumer_static"]), ("consumer_cpp", ["consumer"])):
            run("cmake", "-S", HERE / name, "-B", folder / name, f"-DCMAKE_PREFIX_PATH={prefix}")
            run("cmake", "--build", folder / name)
            for program in programs:
                files = [folder / "field.vdb"] if name == "consumer_c" else []
                print(run(folder / name / program, *files), end="")
        environment = {**os.environ, "PKG_CONFIG_PATH": str(prefix / "lib/pkgconfig")}
        flags = run("pkg-config", "--cflags", "--libs", "fieldtrace", env=environment).split()
        run("cc", "-std=c99", HERE / "consumer_c/main.c", "-o", folder / "by_pkg_config", *flags)
        beside = {**os.environ, "LD_LIBRARY_PATH": str(prefix / "lib")}
        run(folder / "by_pkg_config", env=beside)
        # The examples of the documents: whole programs of the first page, fragments of the others.
        headers = [prefix / "include/fieldtrace" / name for name in ("fieldtrace.h", "fieldtrace_embree.h")]
        faults, fragments = api_pages.faults_and_program(headers, DOCUMENTS)
        if faults:
            sys.exit("\n".join(faults))
        examples = EXAMPLE.findall((DOCUMENTS / "README.md").read_text())
        if not examples:
            sys.exit(f"{DOCUMENTS} has no examples")
        for text in [*examples, fragments]:
            (folder / "example.c").write_text(text)
            run("cc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", folder / "example.c", "-o",
                folder / "example", *flags, "-lembree3")
            run(folder / "example", env=beside, cwd=folder)
        run("c++", "-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", EXAMPLES / "embree_renderer.cpp", "-o",
            folder / "embree_renderer", *flags, "-lembree3")
        run(folder / "embree_renderer", env=beside, cwd=folder)
        check_picture(folder / "embree_renderer.ppm")
        print("package: all is well")


if __name__ == "__main__":
    main()
