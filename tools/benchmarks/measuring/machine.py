"""Describes the platform of a measurement: processor, memory, system, compiler, libraries, commit."""

import os
import pathlib
import platform
import re
import subprocess


def _first_match(path, pattern):
    try:
        found = re.search(pattern, pathlib.Path(path).read_text(encoding="utf-8", errors="replace"), re.MULTILINE)
    except OSError:
        return None
    return found.group(1).strip() if found else None


def _said(words, cwd=None):
    try:
        return subprocess.run(words, capture_output=True, text=True, timeout=60, cwd=cwd, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


def _embree_version(program):
    """Version from the name of the shared library that the program is linked to."""
    linked = re.search(r"(\S*libembree\S*) => (\S+)", _said(["ldd", str(program)]) or "")
    if not linked:
        return None
    found = re.search(r"so\.(\d+(?:\.\d+)*)$", str(pathlib.Path(linked.group(2)).resolve()))
    return found.group(1) if found else linked.group(1)


def describe(program, root):
    """A dict of the machine and the versions; unknown entries are None."""
    memory = _first_match("/proc/meminfo", r"^MemTotal:\s+(\d+) kB")
    changed = _said(["git", "status", "--porcelain", "--untracked-files=no"], root)
    return {
        "cpu": _first_match("/proc/cpuinfo", r"^model name\s*:\s*(.*)$") or platform.processor() or platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_bytes": int(memory) * 1024 if memory else None,
        "system": _first_match("/etc/os-release", r'^PRETTY_NAME="?([^"\n]*)') or platform.platform(),
        "compiler": (_said(["c++", "--version"]) or "").split("\n")[0] or None,
        "embree": _embree_version(program),
        "commit": _said(["git", "rev-parse", "--short=12", "HEAD"], root),
        "commit_is_changed": bool(changed),
        "load_before": os.getloadavg()[0],
    }
