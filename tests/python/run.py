#!/usr/bin/env python3
"""The tests of the Python package.

    run.py install BUILD PACKAGES           pip installs the package, over the library of BUILD, into a new environment
    run.py test BUILD PACKAGES MODULE...    runs unittest modules of this folder there

PACKAGES is a virtual environment with what the tests need (tools/install_packages.sh --with-python); the new one sees
them. Exit code 77 if a package is missing, or anything else because of which a test is skipped; it is named.
"""

import os
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[1]
SKIPPED = 77
HINT = "tools/install_packages.sh --with-python"
NEEDED = {
    "install": ["nanobind", "numpy", "scikit_build_core"],
    "types_test": ["mypy"],
    "example_test": ["matplotlib"],
    "mitsuba_test": ["mitsuba"],
}


def require(packages, names):
    if not packages.exists():
        print(f"skipped: there is no {packages} ({HINT})")
        sys.exit(SKIPPED)
    for name in names:
        if subprocess.run([packages, "-c", f"import {name}"], capture_output=True).returncode != 0:
            print(f"skipped: the Python package {name} is not installed ({HINT})")
            sys.exit(SKIPPED)


def run(*command, **options):
    result = subprocess.run([str(c) for c in command], text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)
    if result.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {result.returncode}\n{result.stdout}")
    return result.stdout.strip()


def install(build, packages, folder):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    prefix, environment = folder / "prefix", folder / "environment"
    run("cmake", "--install", build, "--prefix", prefix)
    run(packages, "-m", "venv", "--without-pip", environment)
    site = "import sysconfig; print(sysconfig.get_paths()['platlib'])"
    pathlib.Path(run(environment / "bin/python", "-c", site), "packages.pth").write_text(run(packages, "-c", site) + "\n")
    # As on a command line, but for what it would download.
    run(packages, "-m", "pip", "--python", environment / "bin/python", "install", "--no-build-isolation", "--no-deps",
        "--no-index", SOURCE, "-C", "cmake.define.FIELDTRACE_PYTHON_ONLY=ON",
        "-C", f"cmake.define.CMAKE_PREFIX_PATH={prefix}", "-C", f"build-dir={folder}/wheel",
        env={**os.environ, "PATH": f"{packages.parent}:{os.environ['PATH']}"})
    # The package has all that it needs of it.
    shutil.rmtree(prefix / "lib")


def main():
    action, build, packages, *modules = sys.argv[1:]
    build, packages = pathlib.Path(build).resolve(), pathlib.Path(packages).resolve() / "bin/python"
    folder = build / "python"
    if action == "install":
        require(packages, NEEDED["install"])
        install(build, packages, folder)
        return
    require(packages, NEEDED["install"] + [name for module in modules for name in NEEDED.get(module, [])])
    # Not from the source tree, whose package has no extension.
    os.chdir(folder)
    os.environ.update(PYTHONPATH=str(HERE), FIELDTRACE_SOURCE=str(SOURCE), MPLBACKEND="Agg")
    os.environ["PATH"] = f"{build / 'bin'}:{os.environ['PATH']}"
    command = [folder / "environment/bin/python", "-X", "faulthandler", "-m", "unittest", "-v", *modules]
    last = ""
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        for line in process.stdout:
            print(line, end="", flush=True)
            last = line.strip() or last
    sys.exit(SKIPPED if process.returncode == 0 and "skipped=" in last else process.returncode)


if __name__ == "__main__":
    main()
