#!/usr/bin/env python3
"""What a look-up costs on the rays of four pictures stays within gpu/budget.json.

    look_up_budget_test.py --budget gpu/budget.json [--update | --table] PROGRAM [ARGUMENT...]

PROGRAM: look_up_counts, whose counts are reproducible: one thread, fixed seeds. For each scene and kind of question the
budget holds a warp's instructions (of PTX), sectors of 32 bytes and bytes over the bus, a look-up, to three digits,
rounded up. `--update` writes what is measured; `--table` prints it, and the look-ups a second that three GPUs can reach
at most by it, as docs/gpu.md has them. Exit code 77: PROGRAM has no kernels to count.
"""
import argparse
import json
import math
import pathlib
import subprocess
import sys

from kernel_budget_test import write_budget

SKIPPED = 77
WHAT = ("instructions", "sectors", "bytes")
# Streaming multiprocessors, greatest clock (Hz), memory and bus (bytes/s, each way), architecture; docs/gpu.md has the
# sources.
CARDS = {
    "H100": {"sms": 132, "clock": 1.98e9, "memory": 3.35e12, "bus": 63.0e9, "architecture": "sm_90"},
    "H200": {"sms": 132, "clock": 1.98e9, "memory": 4.8e12, "bus": 63.0e9, "architecture": "sm_90"},
    "RTX 4090": {"sms": 128, "clock": 2.52e9, "memory": 1.008e12, "bus": 31.5e9, "architecture": "sm_89"},
}
SECTOR = 32
# A clock and multiprocessor: instructions of warps, sectors from L1, bytes from L2.
ISSUED, L1_SECTORS, L2_BYTES = 4, 4, 64


def rounded_up(value):
    """To three digits."""
    if value == 0:
        return 0
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / step - 1e-9) * step:.6g}")


def per_look_up(kind):
    """The budget's figures of one kind of question."""
    total = {"instructions": kind["instructions"], "sectors": kind["warp_sectors"],
             "bytes": kind["bytes_up"] + kind["bytes_down"]}
    return {what: rounded_up(total[what] / kind["lookups"]) for what in WHAT}


def ceilings(kind, card, code_ratio):
    """{what bounds: look-ups a second}. code_ratio: machine instructions for one of PTX."""
    clocks = card["sms"] * card["clock"]
    return {
        "instructions": clocks * ISSUED * kind["lookups"] / (kind["instructions"] * code_ratio),
        "L1": clocks * L1_SECTORS * kind["lookups"] / kind["request_sectors"],
        "L2": clocks * L2_BYTES * kind["lookups"] / (kind["warp_sectors"] * SECTOR),
        "memory": card["memory"] * kind["lookups"] / (kind["warp_sectors"] * SECTOR),
        "bus": card["bus"] * kind["lookups"] / max(kind["bytes_up"], kind["bytes_down"]),
    }


def print_tables(counts, budget):
    kinds = [(scene, name, kind) for scene, of in counts["scenes"].items() for name, kind in of["kinds"].items()
             if kind["lookups"] > 0]
    print("| scene | kernel | questions | look-ups | instructions | sectors, each request | sectors, each warp | bytes up "
          "| bytes down |\n" + "|---" * 9 + "|")
    for scene, name, kind in kinds:
        cells = [kind[k] / kind["lookups"] for k in ("instructions", "request_sectors", "warp_sectors", "bytes_up",
                                                     "bytes_down")]
        print(f"| {pathlib.Path(scene).stem} | `{name}` | {kind['entries']:,} | {kind['lookups']:,} | " +
              " | ".join(f"{c:.3g}" for c in cells) + " |")
    print("\n| scene | kernel | " + " | ".join(CARDS) + " |\n" + "|---" * (2 + len(CARDS)) + "|")
    for scene, name, kind in kinds:
        row = []
        for card in CARDS.values():
            machine = budget["kernels"][name][card["architecture"]]["instructions"]
            c = ceilings(kind, card, machine / counts["code"][name])
            kernel = min(("instructions", "L1", "L2"), key=c.get)
            row.append(f"{c[kernel] / 1e9:.3g} ({kernel}); {min(c[kernel], c['memory']) / 1e9:.3g}; "
                       f"{min(c[kernel], c['bus']) / 1e9:.2g}")
        print(f"| {pathlib.Path(scene).stem} | `{name}` | " + " | ".join(row) + " |")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--budget", type=pathlib.Path, required=True)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("program")
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    run = subprocess.run([options.program, *options.arguments], stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode == SKIPPED:
        print("skipped:", run.stdout.strip())
        return SKIPPED
    run.check_returncode()
    counts = json.loads(run.stdout)
    budget = json.loads(options.budget.read_text(encoding="utf-8"))
    if options.table:
        print_tables(counts, budget)
        return 0
    measured = {scene: {name: per_look_up(kind) for name, kind in of["kinds"].items() if kind["lookups"] > 0}
                for scene, of in counts["scenes"].items()}
    if options.update:
        budget["look_ups"] = measured
        write_budget(options.budget, budget)
        return 0
    excesses = []
    for scene in sorted(set(measured) | set(budget.get("look_ups", {}))):
        of, allowed_of = measured.get(scene, {}), budget.get("look_ups", {}).get(scene, {})
        for name in sorted(set(of) ^ set(allowed_of)):
            excesses.append(f"{scene}, {name}: {'not in the budget' if name in of else 'not asked any more'}")
        for name in sorted(set(of) & set(allowed_of)):
            for what in WHAT:
                if of[name][what] > allowed_of[name][what]:
                    excesses.append(f"{scene}, {name}: {of[name][what]:g} {what} a look-up, "
                                    f"{of[name][what] - allowed_of[name][what]:.3g} more than the budget's "
                                    f"{allowed_of[name][what]:g}")
    for line in excesses:
        print(line)
    if excesses:
        print("If that is meant: look_up_budget_test.py --update (docs/gpu.md)")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
