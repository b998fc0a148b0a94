#!/usr/bin/env python3
"""Checks docs/constants.md and the code's constants against each other, in both directions.

    constants_test.py ROOT

Every `constexpr` constant k_... of ROOT/field and ROOT/hybrid must be listed on the page, and every constant, value,
file and decision on the page must exist. Files are found by name in any sub-folder. Exit code 1 and one line per
discrepancy.
"""

import pathlib
import re
import sys

REQUIRED = ("field", "hybrid")
SEARCHED = REQUIRED + ("core", "gpu", "tools")
SUFFIXES = (".h", ".cpp", ".cu", ".cuh")
ROW = re.compile(r"^\|(.+)\|\s*$")
CODE = re.compile(r"`([^`]+)`")


def without_comments(text):
    return re.sub(r"//[^\n]*|/\*.*?\*/", " ", text, flags=re.S)


def split_top(text, separator=","):
    """The parts of `text` between separators outside brackets and strings."""
    parts, depth, begin = [], 0, 0
    text = re.sub(r'"(?:\\.|[^"\\])*"', lambda m: '"' + "_" * (len(m[0]) - 2) + '"', text)
    for i, c in enumerate(text):
        depth += (c in "([{") - (c in ")]}")
        if c == separator and depth == 0:
            parts.append(text[begin:i])
            begin = i + 1
    return parts + [text[begin:]]


def constants_of(text):
    """Name -> initialisers of the constexpr variables k_... in a file's text."""
    found = {}
    for match in re.finditer(r"\bconstexpr\b([^;]*)", without_comments(text)):
        for part in split_top(match[1]):
            name = re.match(r"[^=({]*?\b(k_\w+)\s*(?:\[[^\]]*\]\s*)*(?:=|\{)(.*)", part, re.S)
            if name:
                found.setdefault(name[1], []).append(" ".join(name[2].split()).rstrip("}"))
    return found


def number(text):
    """The value of a numeric C++ expression; None if it is not one."""
    text = re.sub(r"\b(?:u?int\d*(?:_t)?|size_t|double|float)\(", "(", text.strip())
    text = re.sub(r"(?<=\d)'(?=\d)", "", text)
    text = re.sub(r"\b0x[0-9a-fA-F.]*p[-+]?\d+(?=[fF]?\b)", lambda m: repr(float.fromhex(m[0])), text)
    text = re.sub(r"\b(0x[0-9a-fA-F]+|\d[\d.]*(?:[eE][-+]?\d+)?)(?:[fF]|[uUlL]+)?(?!\w)", r"\1", text)
    if not re.fullmatch(r"[-+*/<>().\d\seExa-fA-F]+", text):
        return None
    try:
        return float(eval(text, {"__builtins__": {}}))
    except (SyntaxError, TypeError, NameError, ZeroDivisionError):
        return None


def tables_of(page):
    """(heading, line number, cells) of every row of the page's tables, without headers and rulers."""
    part, header = "", False
    for i, line in enumerate(page.splitlines(), 1):
        if line.startswith("## "):
            part = line[3:]
        row = ROW.match(line)
        if not row:
            header = True
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", row[1])]
        if not header and not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
            yield part, i, cells
        header = False


class Check:
    def __init__(self, root):
        self.root, self.findings = root, []
        self.files = {}  # base name -> paths
        for folder in SEARCHED:
            for path in sorted((root / folder).rglob("*")):
                if path.suffix in SUFFIXES:
                    self.files.setdefault(path.name, []).append(path)
        self.page_path = root / "docs" / "constants.md"
        self.page = self.page_path.read_text()
        self.named = set()  # (base name, constant)
        self.links = dict(re.findall(r"^\[(\d+)\]:\s*(\S+)", self.page, re.M))

    def find(self, line, what):
        self.findings.append(f"{self.page_path}:{line}: {what}")

    def text_of(self, line, cell):
        """(base name, text) of the file, or files of one name, named in a cell."""
        name = CODE.fullmatch(cell)
        paths = self.files.get(name[1], []) if name else []
        if not paths:
            self.find(line, f"{cell} is no file of {', '.join(SEARCHED)}")
            return None, ""
        return name[1], "\n".join(path.read_text() for path in paths)

    def check_decision(self, line, cell):
        number_of = re.fullmatch(r"\[(\d+)\]", cell)
        if cell == "none":
            return
        if not number_of or number_of[1] not in self.links:
            self.find(line, f"'{cell}' is neither 'none' nor a decision that the page links to")
        elif not (self.page_path.parent / self.links[number_of[1]]).is_file():
            self.find(line, f"{self.links[number_of[1]]} does not exist")

    def check_tuned(self, line, cells):
        name, value, file, unit, trades, decision = cells
        constant = CODE.fullmatch(name)
        base, text = self.text_of(line, file)
        if not base or not constant:
            return
        values = constants_of(text).get(constant[1], [])
        self.named.add((base, constant[1]))
        if not values:
            self.find(line, f"{base} has no constant {constant[1]}")
        elif number(value) is None or number(value) not in [number(v) for v in values]:
            self.find(line, f"{constant[1]} is {' or '.join(values)} in {base}, not {value}")
        if not unit or not trades:
            self.find(line, f"{constant[1]} lacks its unit or what it trades")
        self.check_decision(line, decision)

    def check_unnamed(self, line, cells):
        code, file, _, decision = cells
        base, text = self.text_of(line, file)
        wanted = " ".join(CODE.fullmatch(code)[1].split())
        if base and wanted not in " ".join(without_comments(text).split()):
            self.find(line, f"{base} does not hold: {wanted}")
        self.check_decision(line, decision)

    def check_derived(self, line, cells):
        file, names, _ = cells
        base, text = self.text_of(line, file)
        if not base:
            return
        there = constants_of(text)
        for name in CODE.findall(names):
            self.named.add((base, name))
            if name not in there:
                self.find(line, f"{base} has no constant {name}")

    def run(self):
        checks = {"1": (self.check_tuned, 6), "2": (self.check_unnamed, 4), "3": (self.check_derived, 3)}
        rows = {key: 0 for key in checks}
        for part, line, cells in tables_of(self.page):
            check, columns = checks[part[0]]
            rows[part[0]] += 1
            if len(cells) == columns:
                check(line, cells)
            else:
                self.find(line, f"{len(cells)} columns; there are {columns} in part {part[0]}")
        defined = 0
        for name, paths in self.files.items():
            for path in paths:
                if path.relative_to(self.root).parts[0] not in REQUIRED:
                    continue
                for constant in constants_of(path.read_text()):
                    defined += 1
                    if (name, constant) not in self.named:
                        self.findings.append(f"{path}: {constant} stands nowhere in docs/constants.md; add it there")
        if not defined or not all(rows.values()):
            self.findings.append(f"found {defined} constants and {rows} rows: nothing was compared")
        return defined, rows


def main():
    check = Check(pathlib.Path(sys.argv[1]).resolve())
    defined, rows = check.run()
    print("\n".join(check.findings) or f"{defined} constants in the code; rows of the page by part: {rows}")
    return 1 if check.findings else 0


if __name__ == "__main__":
    sys.exit(main())
