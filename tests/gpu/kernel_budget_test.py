#!/usr/bin/env python3
"""What the kernels cost on each architecture stays within gpu/budget.json.

    kernel_budget_test.py --ptxas PTXAS --budget gpu/budget.json [--update] IN.ptx...

Registers and spills are those that ptxas reports, instructions the size of a kernel's code (16 bytes each, padding
included), loads those of global memory in its PTX: places in the code, not times that they run. Figures hold for one
release of the compiler; another one's are printed, and the test is skipped (exit code 77) unless a kernel spills.
`--update` writes what is measured.
"""
import argparse
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

INSTRUCTION_BYTES = 16  # since sm_70
SKIPPED = 77


def code_bytes(cubin):
    """Size of each kernel's code in an ELF file of 64 bits."""
    sections_at, = struct.unpack_from("<Q", cubin, 0x28)
    size, count, names_index = struct.unpack_from("<HHH", cubin, 0x3A)
    sections = [struct.unpack_from("<IIQQQQ", cubin, sections_at + i * size) for i in range(count)]
    names_at = sections[names_index][4]
    sizes = {}
    for name_offset, _, _, _, _, length in sections:
        start = names_at + name_offset
        name = cubin[start:cubin.index(b"\0", start)].decode()
        if name.startswith(".text."):
            sizes[name[len(".text."):]] = length
    return sizes


def loads_of(ptx):
    """Loads of global memory in each kernel of a PTX file: a vector counts once."""
    parts = re.split(r"\.entry\s+(\w+)", ptx)
    # Generic loads are those of a kernel's arguments by address, which lie in constant memory.
    return {name: len(re.findall(r"\bld\.global\b", body)) for name, body in zip(parts[1::2], parts[2::2])}


def measure(ptxas, path):
    """(architecture, {kernel: {what: number}})."""
    text = path.read_text(encoding="utf-8")
    architecture = re.search(r"^\.target\s+(\w+)", text, re.M).group(1)
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "kernels.cubin"
        run = subprocess.run([ptxas, "-v", "-m64", "--fmad=false", f"-arch={architecture}", path, "-o", out], check=True,
                             capture_output=True, text=True)
        sizes = code_bytes(out.read_bytes())
    loads = loads_of(text)
    kernels = {}
    for name, report in re.findall(r"entry function '(\w+)'(.*?)(?=Compiling|\Z)", run.stdout + run.stderr, re.S):
        stack, stores, spills = map(int, re.search(
            r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", report).groups())
        kernels[name] = {"registers": int(re.search(r"Used (\d+) registers", report).group(1)),
                         "instructions": sizes[name] // INSTRUCTION_BYTES, "loads": loads[name],
                         "spills": stores + spills, "stack": stack}
    return architecture, kernels


def write_budget(path, budget):
    """A line for each figure of an architecture or of a scene's kernel."""
    parts = [f'  "compiler": {json.dumps(budget["compiler"])}']
    for part in ("kernels", "look_ups"):
        groups = []
        for name, group in sorted(budget.get(part, {}).items()):
            rows = ",\n".join(f"      {json.dumps(k)}: {json.dumps(v)}" for k, v in group.items())
            groups.append(f"    {json.dumps(name)}: {{\n{rows}\n    }}")
        if groups:
            parts.append(f"  {json.dumps(part)}: {{\n" + ",\n".join(groups) + "\n  }")
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--ptxas", required=True)
    parser.add_argument("--budget", type=pathlib.Path, required=True)
    parser.add_argument("--update", action="store_true")
    parser.add_argument("ptx", type=pathlib.Path, nargs="+")
    options = parser.parse_args()
    version = subprocess.run([options.ptxas, "--version"], check=True, capture_output=True, text=True).stdout
    release = re.search(r"release (\d+\.\d+)", version).group(1)
    measured = {}
    for path in options.ptx:
        architecture, kernels = measure(options.ptxas, path)
        for name, figures in kernels.items():
            measured.setdefault(name, {})[architecture] = figures
    if options.update:
        old = json.loads(options.budget.read_text(encoding="utf-8")) if options.budget.exists() else {}
        write_budget(options.budget, {**old, "compiler": release, "kernels": measured})
        return 0
    budget = json.loads(options.budget.read_text(encoding="utf-8"))
    problems, excesses = [], []
    for name in sorted(set(measured) ^ set(budget["kernels"])):
        problems.append(f"{name}: {'not in the budget' if name in measured else 'no such kernel'}")
    for name, by_architecture in sorted(measured.items()):
        for architecture, figures in by_architecture.items():
            if figures["spills"]:
                problems.append(f"{name}, {architecture}: {figures['spills']} bytes of spills")
            allowed = budget["kernels"].get(name, {}).get(architecture)
            if allowed is None:
                excesses.append(f"{name}, {architecture}: not in the budget")
                continue
            for what in ("registers", "instructions", "loads", "stack"):
                if figures[what] > allowed[what]:
                    excesses.append(f"{name}, {architecture}: {figures[what]} {what}, {figures[what] - allowed[what]} "
                                    f"more than the budget's {allowed[what]}")
    same_compiler = release == budget["compiler"]
    for line in problems + excesses:
        print(line)
    if problems or (excesses and same_compiler):
        print("If that is meant: kernel_budget_test.py --update (docs/gpu.md)")
        return 1
    if not same_compiler:
        print(f"skipped: the budget holds for release {budget['compiler']} of the compiler, not for {release}")
        return SKIPPED
    return 0


if __name__ == "__main__":
    sys.exit(main())
