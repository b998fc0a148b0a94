#!/usr/bin/env python3
"""Benchmarks Fieldtrace: whole frames by both methods, against Mitsuba where that is installed, and single look-ups.
Writes measure.json.gz and measure.md, a table with targets, to the output folder; --publish also replaces
docs/benchmarks/latest-measure.json.gz, the only run kept in the repository.

Rows, targets and methods: docs/benchmarks/README.md. Exit codes: 0 done (whether or not targets are met), 1 a row
failed (the others are written) or nothing was published, 2 wrong usage.
"""

import argparse
import datetime
import os
import pathlib
import shlex
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from measuring import machine, report
from measuring.context import ROOT, Context
from measuring.peer import Peer, find_peer
from measuring.programs import BenchmarkError, Programs
from measuring.rows import ROWS, choose

ATTACHMENT = ROOT / "docs/benchmarks/latest-measure.json.gz"


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog="rows: " + ", ".join(f"{r.number} {r.name}" for r in ROWS))
    parser.add_argument("--program", type=pathlib.Path, default=ROOT / "build/release/bin/fieldtrace",
                        help="the command line program; the benchmark programs lie beside it")
    parser.add_argument("--repeats", type=int, metavar="N", help="of every timing (default: 5, quick: 2)")
    parser.add_argument("--rows", default="", metavar="LIST", help="names or numbers with commas (default: all)")
    parser.add_argument("--quick", action="store_true", help="tiny pictures: shows that rows work, measures nothing")
    parser.add_argument("--resolution", type=int, metavar="N", help="of all pictures (default: each row's own)")
    parser.add_argument("--tolerance", type=float, metavar="T", help="of the hybrid in rows 3 to 6 (default: its own)")
    parser.add_argument("--peer-python", metavar="PATH", help="a Python with mitsuba and numpy")
    parser.add_argument("--meshes", type=pathlib.Path, default=Context.meshes, metavar="FILE.json",
                        help="meshes of the row `converged`")
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "build/measure",
                        help="folder for meshes, references and caches; references are kept between runs")
    parser.add_argument("--output", type=pathlib.Path, default=ROOT / "build/measure", metavar="DIR",
                        help="folder for the two files")
    parser.add_argument("--publish", action="store_true", help=f"replaces {ATTACHMENT.relative_to(ROOT)} as well")
    arguments = parser.parse_args(words)
    if arguments.publish and arguments.quick:
        parser.error("--publish: a quick run measures nothing; leave out --quick")
    try:
        arguments.rows = choose([w for w in arguments.rows.split(",") if w])
    except KeyError as e:
        parser.error(f"--rows: there is no row {e}; rows are " + ", ".join(r.name for r in ROWS))
    if arguments.repeats is None:
        arguments.repeats = 2 if arguments.quick else 5
    for name, least in (("repeats", 1), ("resolution", 16)):
        value = getattr(arguments, name)
        if value is not None and value < least:
            parser.error(f"--{name} is {value}; it must be {least} or more")
    if arguments.tolerance is not None and not 0.0 <= arguments.tolerance <= 1.0:
        parser.error(f"--tolerance is {arguments.tolerance}; it must lie between 0 and 1")
    return arguments


def measure(rows, context, keep):
    """Measures the rows one by one and calls keep(results) after each; a failing row does not stop the others."""
    results = []
    for row in rows:
        context.log(f"{row.number} {row.name}: {row.title()}")
        begin, result, error = time.monotonic(), None, None
        try:
            result = row.measure(context)
        except BenchmarkError as e:
            error = str(e)
            context.log(f"  failed: {error}")
        results.append((row, result, time.monotonic() - begin, error))
        for figure in result.figures if result else []:
            met = {True: "met", False: "not met", None: ""}[figure.met()]
            context.log(f"  {figure.what}: {report.with_unit(report.number(figure.measured), figure.unit)} {met}")
        if result and result.skipped:
            context.log(f"  left out: {result.skipped}")
        keep(results)
    return results


def peer_version(python):
    """Version of the package, found by loading the smallest scene in the variant without further dependencies."""
    with Peer(python, "scalar_rgb", ROOT / "scenes/bunny_two_lights.xml", (("resolution", 16),)) as peer:
        return peer.version


def main(words):
    arguments = parse(words)
    arguments.output.mkdir(parents=True, exist_ok=True)
    programs = Programs(arguments.program.resolve(), arguments.work.resolve())
    programs.drop_caches()
    log = lambda text: print(text, file=sys.stderr, flush=True)
    missing = find_peer(arguments.peer_python)
    if arguments.peer_python and missing:
        raise BenchmarkError(f"--peer-python: {missing}")
    version = None if missing else peer_version(arguments.peer_python)
    context = Context(programs, arguments.repeats, arguments.quick, arguments.tolerance, arguments.resolution,
                      arguments.peer_python, missing, version, arguments.meshes.resolve(), log)
    now = datetime.datetime.now()
    head = {"date": now.isoformat(timespec="seconds"), "command": shlex.join(["tools/benchmarks/measure.py", *words]),
            "version": programs.version(), "machine": machine.describe(programs.program, ROOT),
            "settings": {"repeats": context.repeats, "quick": context.quick, "resolution": context.resolution,
                         "tolerance": context.tolerance,
                         "peer_version": context.peer_version, "peer_missing": missing}}
    head["machine"]["isa"] = programs.render(context.shot("bunny_floor.xml", 16))["isa"]
    if arguments.publish and (reason := report.why_not_published(head, [])):
        raise BenchmarkError(f"--publish: {reason}")

    def keep(results):
        """Writes both reports so far: an interrupted run keeps its finished rows."""
        head["machine"]["load_after"] = os.getloadavg()[0]
        report.write(arguments.output, head, results)

    results = measure(arguments.rows, context, keep)
    programs.drop_caches()
    for name in (report.JSON_NAME, report.TABLE_NAME):
        print(arguments.output / name)
    if arguments.publish:
        if reason := report.why_not_published(head, results):
            log(f"not published: {reason}")
        else:
            report.publish(arguments.output, ATTACHMENT)
            print(ATTACHMENT)
    return 1 if any(error for *_, error in results) else 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except BenchmarkError as e:
        sys.exit(f"measure: {e}")
