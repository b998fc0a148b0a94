#!/usr/bin/env python3
"""Runs tools/benchmarks/measure.py on a few rows at a tiny size and checks its output; checks the searches and figures
on known numbers. Timings are not judged."""

import argparse
import gzip
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
MEASURE = ROOT / "tools/benchmarks/measure.py"
sys.path.insert(0, str(MEASURE.parent))

from measuring import report, whole_frames, search, timing
from measuring.context import AT_LEAST, AT_MOST, Figure, RowResult
from measuring.rows import ROWS, choose

PROGRAM = None


def run(*words):
    return subprocess.run([sys.executable, MEASURE, "--program", PROGRAM, *words], capture_output=True, text=True)


class Search(unittest.TestCase):
    def test_finds_the_fewest_from_both_sides(self):
        error_of = lambda n: 1.0 / n
        for start in (1, 64, 4096):
            found, errors = search.fewest(error_of, 1.0 / 40, start)
            self.assertEqual(found, 48)
            self.assertGreater(errors[32], 1.0 / 40)

    def test_says_when_the_error_stops_falling(self):
        counts = []

        def error_of(n):
            counts.append(n)
            return 0.5 + 0.01 / n

        self.assertIsNone(search.fewest(error_of, 0.1, 8)[0])
        self.assertLess(max(counts), 100)

    def test_staircase_finds_the_quickest_pair(self):
        # The aim takes 4 camera samples and 100 light samples in all; a camera sample costs as much as three of these.
        measure = lambda s, m: (0.0 if s * m >= 100 and s >= 4 else 1.0, 3.0 * s + s * m)
        best = search.staircase(measure, 0.5, 512, 64)[0]
        self.assertEqual((best["spp"], best["light_samples"]), (4, 32))
        self.assertEqual(search.staircase(lambda s, m: (1.0, 1.0), 0.5, 8, 8), [])


class WholeFrames(unittest.TestCase):
    def test_time_lies_between_the_steps_around_the_error(self):
        # Noise alone: the error falls with the root of the samples, time is in proportion to them.
        points = [(1.0 / math.sqrt(n), 0.1 * n) for n in (8, 16)]
        self.assertAlmostEqual(whole_frames.time_to(1.0 / math.sqrt(11.0), points), 1.1)
        self.assertEqual(whole_frames.time_to(0.5, [(0.2, 3.0)]), 3.0)  # the first step reaches it

    def test_steps_around_the_aim(self):
        errors = {n: 1.0 / n for n in (1, 2, 4, 8, 16)}
        self.assertEqual(whole_frames.around_aim(0.2, errors, 8), [4, 8])
        self.assertEqual(whole_frames.around_aim(2.0, errors, 1), [1])

    def test_figures_compare_with_the_better_of_each(self):
        seconds = {0.01: {name: timing.summary([value]) for name, value in
                          (("Monte Carlo", 6.0), ("Monte Carlo, adaptive", 4.0), ("cold", 3.0), ("warm", 2.0),
                           ("Mitsuba path:2", 10.0), ("Mitsuba denoised:2", 1.0))}}
        frame = whole_frames.Frame("frame", None, {0.01: (3.0, None)})
        figures = whole_frames.figures_of(frame, seconds)
        self.assertEqual([f.measured for f in figures], [2.0, 4.0 / 3.0, 5.0, 0.5])
        self.assertEqual([f.met() for f in figures], [False, None, None, None])


class Figures(unittest.TestCase):
    def test_met(self):
        self.assertTrue(Figure("a", 2.0, AT_LEAST, 2.0).met())
        self.assertFalse(Figure("a", 1.9, AT_LEAST, 2.0).met())
        self.assertTrue(Figure("a", 1.9, AT_MOST, 2.0).met())
        self.assertFalse(Figure("a", None, AT_MOST, 2.0).met())
        self.assertIsNone(Figure("a", 1.0).met())

    def test_ratio_is_of_medians(self):
        a, b = timing.summary([1.0, 9.0, 3.0]), timing.summary([2.0, 1.0, 1.5])
        self.assertEqual(timing.ratio(a, b)["value"], 2.0)

    def test_in_turn(self):
        order = []
        timing.in_turn({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
        self.assertEqual(order, ["a", "b", "a", "b"])

    def test_table_is_honest(self):
        result = RowResult([Figure("slow", 1.0, AT_LEAST, 4.0, "x"), Figure("never", None, AT_LEAST, 4.0, "x")])
        lines = report.table([(ROWS[0], result, 1.0, None)])
        self.assertIn("**no**", lines[2])
        self.assertIn("not reached | **no**", lines[3])
        self.assertIn("failed", report.table([(ROWS[0], None, 1.0, "why")])[2])

    def test_only_whole_runs_of_a_commit_are_published(self):
        head = {"settings": {"quick": False}, "machine": {"commit": "abc", "commit_is_changed": False}}
        good, failed = (ROWS[0], RowResult([]), 1.0, None), (ROWS[1], None, 1.0, "why")
        self.assertIsNone(report.why_not_published(head, [good]))
        self.assertIn(ROWS[1].name, report.why_not_published(head, [good, failed]))
        changed = {"commit": "abc", "commit_is_changed": True}
        self.assertIn("commit", report.why_not_published({**head, "machine": changed}, [good]))
        self.assertIn("quick", report.why_not_published({**head, "settings": {"quick": True}}, [good]))

    def test_published_is_what_was_written_last(self):
        machine = {"cores": 1, "cpu": "c", "isa": "i", "memory_bytes": 0, "system": "s", "compiler": "g", "embree": "3",
                   "commit": "abc", "commit_is_changed": False, "load_before": 0.0, "load_after": 0.0}
        settings = {"quick": False, "repeats": 1, "peer_version": None, "peer_missing": "none"}
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            target = folder / "latest.json.gz"
            for what in ("earlier", "later"):
                head = {"date": "d", "command": "m", "version": "v", "machine": machine, "settings": settings}
                report.write(folder, head, [(ROWS[0], RowResult([Figure(what, 1.0)]), 1.0, None)])
                report.publish(folder, target)
            rows = json.loads(gzip.decompress(target.read_bytes()))["rows"]
            self.assertEqual([figure["what"] for figure in rows[0]["figures"]], ["later"])
            self.assertEqual(sorted(path.name for path in folder.iterdir()),
                             ["latest.json.gz", "measure.json.gz", "measure.md"])

    def test_rows_have_numbers_names_and_titles(self):
        self.assertEqual([row.number for row in ROWS], list(range(len(ROWS))))
        self.assertEqual(len({row.name for row in ROWS}), len(ROWS))
        self.assertTrue(all(row.title() for row in ROWS))
        self.assertEqual([row.name for row in choose(["cells", "1"])], ["lookups", "cells"])


class Command(unittest.TestCase):
    def test_writes_json_and_table(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            out = folder / "out"
            done = run("--quick", "--repeats", "2", "--resolution", "32", "--work", folder / "work", "--output", out,
                       "--rows", "ceiling,secondary-warm,baseline,cells,whole-lights,whole-skies,targets,occlusion")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(sorted(path.name for path in out.iterdir()), ["measure.json.gz", "measure.md"])
            result = json.loads(gzip.decompress((out / "measure.json.gz").read_bytes()))
            rows = {row["name"]: row for row in result["rows"]}
            self.assertEqual(list(rows), ["ceiling", "secondary-warm", "baseline", "cells", "whole-lights", "whole-skies",
                                          "targets", "occlusion"])
            # No peer is configured: its row is skipped, and marked as such.
            self.assertEqual(rows["baseline"]["figures"], [])
            self.assertIn("--peer-python", rows["baseline"]["skipped"])
            for name in ("ceiling", "secondary-warm", "cells", "whole-lights", "whole-skies", "targets", "occlusion"):
                self.assertIsNone(rows[name]["error"])
                self.assertTrue(rows[name]["figures"])
                for figure in rows[name]["figures"]:
                    if figure["measured"] is not None:
                        self.assertTrue(math.isfinite(figure["measured"]) and figure["measured"] > 0.0, figure)
            monte_carlo = rows["secondary-warm"]["figures"][0]["details"]["monte_carlo"]
            self.assertGreater(monte_carlo["rmse"], 0.0)
            self.assertEqual(len(monte_carlo["secondary"]["values"]), 2)
            cells = rows["cells"]["figures"][0]
            field = cells["details"]["field"]
            self.assertEqual((field["directions"], field["plane"]), (64, 128))
            self.assertAlmostEqual(cells["measured"], 100.0 * field["cells_baked"] / field["cells_full"])
            free = rows["ceiling"]["figures"][0]["details"]["secondary"]
            self.assertLess(free["free"]["median"], free["monte_carlo"]["median"])
            self.assertTrue(result["machine"]["cpu"] and result["machine"]["isa"] and result["settings"]["quick"])
            table = (out / "measure.md").read_text(encoding="utf-8")
            self.assertIn("| 3 secondary-warm | light of 4 degrees | at least 15 x |", table)
            self.assertIn("A quick run", table)

    def test_wrong_use(self):
        self.assertEqual(run("--rows", "nonsense").returncode, 2)
        self.assertEqual(run("--repeats", "0").returncode, 2)
        self.assertEqual(run("--quick", "--publish").returncode, 2)

    def test_missing_program(self):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run([sys.executable, MEASURE, "--program", f"{folder}/none", "--output", folder, "--work",
                                   f"{folder}/work"], capture_output=True, text=True)
            self.assertEqual(done.returncode, 1)
            self.assertIn("is missing; build it", done.stderr)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", required=True)
    arguments, rest = parser.parse_known_args()
    PROGRAM = arguments.program
    unittest.main(argv=[sys.argv[0], *rest])
