#!/usr/bin/env python3
"""Checks that the documents speak of what is there: tests that pages name, relative links,
and paths in backquotes that begin with a folder of ours."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = "proto|server|worker|client|tests|docs|deploy|.ci"


def test_names():
    names = set()
    for path in (ROOT / "tests").rglob("*.cpp"):
        names.update(f"{a}.{b}" for a, b in re.findall(
            r"^TEST(?:_F|_P)?\((\w+),\s*(\w+)\)", path.read_text(), re.M))
    return names


def main():
    wrong = []
    known = test_names()
    for page in ("docs/course.md", "docs/numerics.md", "docs/reliability.md",
                 "docs/security.md"):
        for name in re.findall(r"`(\w+\.[A-Z]\w+)`", (ROOT / page).read_text()):
            if name not in known:
                wrong.append(f"{page}: no test is called {name}")
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("*/README.md")]
    for page in pages:
        text = page.read_text()
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", text):
            if not (page.parent / target).exists():
                wrong.append(f"{page.relative_to(ROOT)}: no such file: {target}")
        for path in re.findall(rf"`((?:{FOLDERS})/[\w./-]*\w)`", text):
            if not (ROOT / path).exists() and not list(ROOT.glob(path + ".*")):
                wrong.append(f"{page.relative_to(ROOT)}: no such file: {path}")
    print("\n".join(wrong) or f"{len(pages)} pages speak of what is there")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
