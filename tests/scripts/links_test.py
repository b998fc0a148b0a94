#!/usr/bin/env python3
"""Every relative link of a Markdown file must lead to a file, and its anchor to a heading; every document named in a
source file must exist. Web addresses are not checked."""

import os
import pathlib
import re
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve()
while not (ROOT / "CMakePresets.json").exists():
    ROOT = ROOT.parent

LINK = re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
DOCUMENT = re.compile(r"(?<![\w/.-])docs/[\w./-]*\.(?:md|png|svg|gz)\b")
SOURCES = {".h", ".cpp", ".cu", ".cuh", ".py", ".sh", ".cmake", ".txt", ".md", ".xml", ".json"}


def files(root):
    """All files outside build and hidden folders."""
    for folder, folders, names in os.walk(root):
        folders[:] = [f for f in folders if not f.startswith(".") and f != "build"]
        yield from (pathlib.Path(folder) / name for name in names)


def without_code(text):
    """The text with fenced blocks and `code` blanked out; line numbers are kept."""
    lines, fence = [], None
    for line in text.split("\n"):
        mark = re.match(r"\s*(```+|~~~+)", line)
        if fence is None and mark:
            fence = mark.group(1)[:3]
            lines.append("")
        elif fence is not None:
            fence = None if mark and mark.group(1).startswith(fence) else fence
            lines.append("")
        else:
            lines.append(re.sub(r"(`+)(?:(?!\1).)*\1", "", line))
    return "\n".join(lines)


def anchors(path):
    """The anchors that GitHub generates for a document's headings."""
    found, seen = set(), {}
    text = path.read_text(encoding="utf-8")
    for heading in re.findall(r"^#{1,6}\s+(.*?)\s*#*$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M):
        heading = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", heading).replace(" ", "-")
        count = seen[slug] = seen.get(slug, -1) + 1
        found.add(f"{slug}-{count}" if count else slug)
    return found


def broken_links(root):
    """FILE:LINE: TARGET: what is wrong, for each broken link."""
    complaints = []
    for path in sorted(p for p in files(root) if p.suffix == ".md"):
        text = without_code(path.read_text(encoding="utf-8"))
        for match in LINK.finditer(text):
            target = match.group(1)
            if re.match(r"[a-z][a-z0-9+.-]*:", target):
                continue
            where = f"{path.relative_to(root)}:{text.count(chr(10), 0, match.start()) + 1}: {target}: "
            name, _, anchor = target.partition("#")
            file = (path.parent / name).resolve() if name else path
            if root.resolve() not in (file, *file.parents):
                complaints.append(where + "leads out of the repository")
            elif not file.exists():
                complaints.append(where + "there is no such file")
            elif anchor and file.suffix == ".md" and anchor not in anchors(file):
                complaints.append(where + "there is no such heading")
    return complaints


def missing_documents(root):
    """FILE:LINE: NAME: for each missing document named in a source file by its path from the root."""
    complaints = []
    for path in sorted(p for p in files(root) if p.suffix in SOURCES and p.name != pathlib.Path(__file__).name):
        text = path.read_text(encoding="utf-8", errors="replace")
        for match in DOCUMENT.finditer(text):
            if not (root / match.group(0)).exists():
                line = text.count("\n", 0, match.start()) + 1
                complaints.append(f"{path.relative_to(root)}:{line}: {match.group(0)}: there is no such file")
    return complaints


class Repository(unittest.TestCase):
    def test_links_lead_somewhere(self):
        self.assertGreater(sum(path.suffix == ".md" for path in files(ROOT)), 10)
        self.assertEqual(broken_links(ROOT), [])

    def test_named_documents_exist(self):
        self.assertEqual(missing_documents(ROOT), [])


class Checks(unittest.TestCase):
    """The checks detect what they are meant to."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        (self.root / "docs").mkdir()
        (self.root / "docs/there.md").write_text("# One `two`, three\n\n## Again\n\n## Again\n", encoding="utf-8")

    def complaints(self, text):
        (self.root / "docs/page.md").write_text(text, encoding="utf-8")
        return broken_links(self.root)

    def test_good_links(self):
        self.assertEqual(self.complaints("[a](there.md) ![b](../docs/there.md#again-1) [c](there.md#one-two-three)\n"
                                         "[d](https://example.org/x) `[e](gone.md)`\n```\n[f](gone.md)\n```\n"), [])

    def test_broken_links(self):
        found = self.complaints("[a](there.md)\n[a](gone.md) [b](there.md#gone)\n[c](#gone) [d](../../etc)\n")
        self.assertEqual([c.split(": ")[0] for c in found], ["docs/page.md:2", "docs/page.md:2", "docs/page.md:3",
                                                             "docs/page.md:3"])
        self.assertIn("heading", found[1])
        self.assertIn("out of the repository", found[3])

    def test_named_documents(self):
        (self.root / "a.cpp").write_text("// docs/there.md\n// why: docs/decisions/001-gone.md.\n", encoding="utf-8")
        (self.root / "build").mkdir()
        (self.root / "build/b.cpp").write_text("// docs/gone.md\n", encoding="utf-8")
        self.assertEqual(missing_documents(self.root), ["a.cpp:2: docs/decisions/001-gone.md: there is no such file"])


if __name__ == "__main__":
    unittest.main()
