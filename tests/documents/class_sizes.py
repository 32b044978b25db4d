#!/usr/bin/env python3
"""Fails if a class of the server has more than 20 public methods, or more than 500 lines in the
source files that define its members. Usage: class_sizes.py [ROOT]

Reads the headers under server/. A method counts once, however many overloads it has; constructors,
destructors, operators and nested types do not count. A source file counts for the class of which it
defines most members, with all its lines.
"""

import re
import sys
from collections import Counter
from pathlib import Path

MAX_METHODS = 20
MAX_LINES = 500
EXCEPTIONS = {}


def without_comments(text):
    """Returns C++ without comments and without what strings contain."""
    return re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"',
                  lambda match: '""' if match[0][0] == '"' else "", text, flags=re.S)


def end_of_block(text, start):
    """Returns the position after the brace that closes the one at `start`."""
    depth = 0
    for i in range(start, len(text)):
        depth += {"{": 1, "}": -1}.get(text[i], 0)
        if depth == 0:
            return i + 1
    return len(text)


def classes(text):
    """Yields kind, name and body of each class and struct, nested ones with their outer name."""
    pattern = re.compile(r"(?<!enum )\b(class|struct)\s+(?:[A-Z_]+\s+)?(\w+)\s*(?:final\s*)?(?::[^;{(]*)?\{")
    position = 0
    while match := pattern.search(text, position):
        if re.search(r"\benum\s*$", text[:match.start()]):
            position = match.end()
            continue
        end = end_of_block(text, match.end() - 1)
        body = text[match.end():end - 1]
        yield match[1], match[2], body
        for kind, name, inner in classes(body):
            yield kind, f"{match[2]}::{name}", inner
        position = end


def declarations(kind, body):
    """Yields the public declarations of a class, without bodies of functions and nested types."""
    access = "public" if kind == "struct" else "private"
    flat, i = "", 0
    while i < len(body):  # a block becomes the end of its declaration
        if body[i] == "{":
            i = end_of_block(body, i)
            flat += ";"
        else:
            flat += body[i]
            i += 1
    for part in re.split(r"\b(public|protected|private)\s*:(?!:)", flat):
        if part in ("public", "protected", "private"):
            access = part
        elif access == "public":
            yield from part.split(";")


def methods(kind, name, body):
    """Returns the names of the public methods."""
    found = set()
    for declaration in declarations(kind, body):
        text = " ".join(re.sub(r"\b[A-Z][A-Z_]+\([^()]*\)", "", declaration).split())
        if re.match(r"(using|typedef|friend|enum|class|struct|template <[^>]*> (class|struct))\b", text):
            continue
        if "operator" in text or "= delete" in text:
            continue
        before = re.sub(r"<[^<>]*(<[^<>]*(<[^<>]*>[^<>]*)*>[^<>]*)*>", "", text)
        match = re.match(r"[^(=]*?(~?\w+) ?\(", before)
        if match and match[1].lstrip("~") != name.split("::")[-1]:
            found.add(match[1])
    return found


def line_counts(root):
    """Returns class -> lines of the source files that define its members."""
    lines = Counter()
    for path in sorted((root / "server").rglob("*.cpp")):
        text = path.read_text()
        owners = Counter(re.findall(r"^[\w:<>,&* ]*?\b([A-Z]\w*)::~?\w+\(", without_comments(text), re.M))
        if owners:
            lines[owners.most_common(1)[0][0]] += text.count("\n")
    return lines


def faults(root, exceptions):
    """Returns a line for each class that is too large, and for each exception without need."""
    found, excused = [], set()
    lines = line_counts(root)
    for path in sorted((root / "server").rglob("*.h")):
        for kind, name, body in classes(without_comments(path.read_text())):
            count = len(methods(kind, name, body))
            wrong = []
            if count > MAX_METHODS:
                wrong.append(f"{count} public methods, at most {MAX_METHODS} are allowed")
            if "::" not in name and lines[name] > MAX_LINES:
                wrong.append(f"{lines[name]} lines of source, at most {MAX_LINES} are allowed")
            if wrong and name in exceptions:
                excused.add(name)
            else:
                found += [f"{path.relative_to(root)}: {name} has {text}" for text in wrong]
    found += [f"{name} needs no exception" for name in sorted(set(exceptions) - excused)]
    return found


def main():
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[2]
    found = faults(root, EXCEPTIONS)
    print("\n".join(found) or "no class of the server is too large")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
