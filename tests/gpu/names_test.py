#!/usr/bin/env python3
"""Fails if a file names CUDA, its compiler or its maker outside gpu/, its tests, the documents and the build's own files.

names_test.py ROOT
"""
import pathlib
import re
import sys

NAMES = re.compile(r"cuda|nvcc|nvidia", re.IGNORECASE)
FOLDERS = ["core", "examples", "field", "fieldtrace", "hybrid", "python", "scenes", "tests", "tools", "cmake"]
# Of the build: the switch, and the preset. Of the tools: the command for machines with such a GPU, and the one that
# turns the switch off.
ALLOWED = ["CMakeLists.txt", "CMakePresets.json", "pyproject.toml", "tools/gpu_check.sh", "tools/tidy.sh"]


def lines_with_names(path):
    text = path.read_bytes().decode("utf-8", "replace")
    return [number for number, line in enumerate(text.splitlines(), 1) if NAMES.search(line)]


def main():
    root = pathlib.Path(sys.argv[1])
    files = [p for p in root.iterdir() if p.is_file() and p.suffix != ".md"]
    for folder in FOLDERS:
        files += [p for p in (root / folder).rglob("*") if p.is_file()]
    wrong, looked_at = [], 0
    for path in files:
        name = path.relative_to(root).as_posix()
        if name.startswith("tests/gpu/") or name in ALLOWED or "__pycache__" in name:
            continue
        looked_at += 1
        wrong += [f"{name}:{number}: only gpu may name CUDA" for number in lines_with_names(path)]
    # What is allowed needs to be: so the search finds something, and the list stays short.
    wrong += [f"{name}: does not name CUDA and need not be allowed to" for name in ALLOWED
              if not lines_with_names(root / name)]
    if looked_at < 500:
        wrong.append(f"only {looked_at} files found")
    print("\n".join(wrong) or f"{looked_at} files")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
