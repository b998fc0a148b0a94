"""The results as compressed JSON and as a Markdown table. Files are written under a temporary name and renamed."""

import dataclasses
import gzip
import json
import math
import os

JSON_NAME, TABLE_NAME = "measure.json.gz", "measure.md"


def write_atomically(path, data):
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    temporary.write_bytes(data)
    os.replace(temporary, path)


def write(folder, head, results):
    """Writes both reports to `folder`, replacing those of the previous run."""
    # mtime=0: equal results give identical files.
    compressed = gzip.compress(as_json(head, results).encode("utf-8"), mtime=0)
    write_atomically(folder / JSON_NAME, compressed)
    write_atomically(folder / TABLE_NAME, as_markdown(head, results).encode("utf-8"))


def why_not_published(head, results):
    """The reason not to publish these results as the latest ones, or None."""
    if head["settings"]["quick"]:
        return "a quick run measures nothing"
    if head["machine"]["commit"] is None or head["machine"]["commit_is_changed"]:
        return "the figures would name no commit: commit the working tree's changes, build, and measure again"
    failed = [row.name for row, _, _, error in results if error]
    return f"failed: {', '.join(failed)}" if failed else None


def publish(folder, target):
    """Copies the JSON of `folder` to `target`."""
    write_atomically(target, (folder / JSON_NAME).read_bytes())


def as_json(head, results):
    """`head`: machine and settings; `results`: (Row, RowResult or None, seconds, error text or None)."""
    rows = []
    for row, result, seconds, error in results:
        entry = {"number": row.number, "name": row.name, "title": row.title(), "seconds": seconds, "error": error,
                 "skipped": result.skipped if result else None, "notes": result.notes if result else [], "figures": []}
        for figure in result.figures if result else []:
            entry["figures"].append({**dataclasses.asdict(figure), "met": figure.met()})
        rows.append(entry)
    # default=str: paths; allow_nan=False: a NaN figure is a fault, not a result.
    return json.dumps({**head, "rows": rows}, indent=1, default=str, allow_nan=False) + "\n"


def number(value):
    """Three significant digits, without an exponent if that stays readable."""
    if value is None:
        return "not reached"
    if value == 0 or not math.isfinite(value):
        return str(value)
    digits = max(2 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{digits}f}" if digits <= 7 else f"{value:.2e}"


def with_unit(text, unit):
    return text if not unit or text == "not reached" else f"{text} {unit}"


def table(results):
    lines = ["| row | figure | target | measured | met |", "|---|---|---|---|---|"]
    for row, result, _, error in results:
        label = f"{row.number} {row.name}"
        if error:
            lines.append(f"| {label} | failed, see below | | | |")
        elif result.skipped:
            lines.append(f"| {label} | left out: {result.skipped} | | | |")
        for figure in result.figures if result else []:
            target = with_unit(f"{figure.relation} {figure.target:g}", figure.unit) if figure.target is not None else ""
            met = {True: "yes", False: "**no**", None: ""}[figure.met()]
            measured = with_unit(number(figure.measured), figure.unit)
            lines.append(f"| {label} | {figure.what} | {target} | {measured} | {met} |")
    return lines


def median_lines(value, path=()):
    """One line for each summary (median, least, most) and each plain number of the details."""
    if isinstance(value, dict):
        if "median" in value:
            spread = f"{number(value['median'])} ({number(value['least'])} to {number(value['most'])})"
            return [f"  - {' / '.join(path)}: {spread}"]
        return [line for key, inner in value.items() for line in median_lines(inner, (*path, str(key)))]
    if isinstance(value, float):
        return [f"  - {' / '.join(path)}: {number(value)}"]
    if isinstance(value, (int, str)) and path[-1] != "command":
        return [f"  - {' / '.join(path)}: {value}"]
    return []


def details(results):
    lines, shown = [], []
    for row, result, seconds, error in results:
        lines += ["", f"### {row.number} {row.name}", "", f"{row.title()} Measured in {seconds:.0f} s."]
        if error:
            lines += ["", f"Failed: {error}"]
        for note in result.notes if result else []:
            lines += ["", note]
        for figure in result.figures if result else []:
            # Rows may share a measurement, which is listed once.
            if not figure.details or any(figure.details is d for d in shown):
                continue
            shown.append(figure.details)
            command = figure.details.get("command")
            lines += ["", f"- {figure.what}" + (f"; last command: `{command}`" if command else "")]
            lines += median_lines(figure.details)
    return lines


def as_markdown(head, results):
    m = head["machine"]
    s = head["settings"]
    changed = " with changes that are not committed" if m["commit_is_changed"] else ""
    peer = f"Mitsuba {s['peer_version']}" if s["peer_version"] else f"no Mitsuba ({s['peer_missing']})"
    quick = " **A quick run at a reduced size: its figures only show that the rows work.**" if s["quick"] else ""
    lines = [f"# Benchmark of {head['date']}", "",
             f"Machine: {m['cores']} cores of {m['cpu']}, {m['isa']}, {(m['memory_bytes'] or 0) / 2**30:.0f} GiB, "
             f"{m['system']}, {m['compiler']}, Embree {m['embree']}, {peer}; {head['version']}, commit {m['commit']}"
             f"{changed}. Load average {m['load_before']:.1f} before, {m['load_after']:.1f} after. "
             f"Medians of {s['repeats']} repeats, methods in turn.{quick}",
             "", f"Command: `{head['command']}`. What the rows mean: docs/benchmarks/README.md.", ""]
    lines += table(results)
    lines += ["", "## Details", "", "Seconds, medians with the least and the most of the repeats, unless the name says "
              f"otherwise. Everything, each repeat included, is in {JSON_NAME}."]
    return "\n".join(lines + details(results)) + "\n"
