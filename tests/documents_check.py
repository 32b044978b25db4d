#!/usr/bin/env python3
"""Checks that the documents speak of what is there: tests and kinds of fault that pages name,
relative links, and paths in backquotes that begin with a folder of ours."""

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


def chaos_kinds():
    """The faults that tests/e2e/chaos knows: one function each, of the farm and a random generator."""
    text = (ROOT / "tests/e2e/chaos/kinds.py").read_text()
    return set(re.findall(r"^def (\w+)\(farm, rng", text, re.M))


def main():
    wrong = []
    known = test_names()
    for page in ("docs/course.md", "docs/numerics.md", "docs/reliability.md",
                 "docs/security.md"):
        for name in re.findall(r"`(\w+\.[A-Z]\w+)`", (ROOT / page).read_text()):
            if name not in known:
                wrong.append(f"{page}: no test is called {name}")
    kinds = chaos_kinds()
    page = "docs/reliability.md"
    for names in re.findall(r"chaos: ((?:`\w+`(?:, )?)+)", (ROOT / page).read_text()):
        for name in re.findall(r"\w+", names):
            if name not in kinds:
                wrong.append(f"{page}: chaos has no kind {name}")
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
