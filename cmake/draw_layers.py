#!/usr/bin/env python3
"""Draws docs/explanation/layers.svg from the CMake targets of a build directory.

  cmake/draw_layers.py BUILD_DIR           writes the picture (needs graphviz)
  cmake/draw_layers.py BUILD_DIR --check   fails if the picture shows other folders or links

A box is a folder, a line means "links", down to the lower layer. Lines that follow from others are
left out. Each target is named after its folder: tessera_worker_gltf_file is worker/gltf/file.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs/explanation/layers.svg"
PROGRAMS = {"tessera": "tessera", "tessera-server": "tessera-server",
            "tessera-worker": "tessera-worker", "tessera-webhook": "tessera-webhook"}
COLORS = {"client": "#dbe9f6", "server": "#e3f1dc", "worker": "#fbe5d0", "webhook": "#dbe9f6"}


def folders():
    """Returns target name -> directory for every directory with a layer."""
    found = {}
    for lists in ROOT.glob("*/**/CMakeLists.txt"):
        folder = lists.parent.relative_to(ROOT)
        if folder.parts[0] in ("build", "tests"):
            continue
        for name in re.findall(r"tessera_layer\(\s*(\w+)", lists.read_text()):
            found["tessera_" + name] = folder.as_posix() if name == "_".join(folder.parts) else (
                name.replace("_", "/", 1))
    found["tessera_proto"] = "proto"
    return found


def links(build):
    """Returns edges between directories, as pairs (user, used), from CMake's graph."""
    with tempfile.TemporaryDirectory() as scratch:
        dot = Path(scratch) / "targets.dot"
        subprocess.run(["cmake", f"--graphviz={dot}", str(build)], check=True, capture_output=True)
        text = dot.read_text()
    names = dict(re.findall(r'"(node\d+)" \[ label = "([^"\\]+)', text))
    known = {**folders(), **PROGRAMS}
    edges = set()
    for a, b in re.findall(r'"(node\d+)" -> "(node\d+)"', text):
        user, used = known.get(names.get(a)), known.get(names.get(b))
        if user and used and user != used:
            edges.add((user, used))
    return edges


def drawn_name(folder):
    """Returns the box that shows a directory: at most two levels, so that the picture stays readable."""
    return "/".join(folder.split("/")[:2])


def reduced(edges):
    """Removes the edges that follow from others (transitive reduction)."""
    below = {}
    for a, b in edges:
        below.setdefault(a, set()).add(b)

    def reaches(a, b, skip):
        return any(c == b or reaches(c, b, None) for c in below.get(a, ()) if c != skip)
    return {(a, b) for a, b in edges if not reaches(a, b, b)}


def check_acyclic(edges):
    below = {}
    for a, b in edges:
        below.setdefault(a, set()).add(b)
    state = {}

    def visit(node):
        if state.get(node) == 1:
            sys.exit(f"layers: {node} links itself through others")
        if state.get(node) == 2:
            return
        state[node] = 1
        for other in below.get(node, ()):
            visit(other)
        state[node] = 2
    for node in list(below):
        visit(node)


def picture_edges(build):
    edges = links(build)
    if len(edges) < 50:
        sys.exit(f"layers: only {len(edges)} links between folders in {build}")
    check_acyclic(edges)
    drawn = {(drawn_name(a), drawn_name(b)) for a, b in edges}
    drawn = {(a, b) for a, b in drawn if a != b}
    check_acyclic(drawn)
    return sorted(reduced(drawn))


def draw(edges):
    lines = ["digraph layers {", "rankdir=TB; nodesep=0.25; ranksep=0.45;",
             'node [shape=box, style="filled,rounded", fontname="Helvetica", fontsize=11, height=0.3,'
             ' color="#777777"]; edge [color="#888888", arrowsize=0.6];']
    for name in sorted({n for e in edges for n in e}):
        top = name.split("/")[0]
        color = "#ffffff" if name in PROGRAMS.values() else COLORS.get(top, "#eeeeee")
        lines.append(f'"{name}" [fillcolor="{color}"];')
    lines += [f'"{a}" -> "{b}";' for a, b in edges] + ["}"]
    svg = subprocess.run(["dot", "-Tsvg"], input="\n".join(lines), text=True, check=True,
                         capture_output=True).stdout
    return svg.replace("</svg>", f"<!-- layers: {json.dumps(edges)} -->\n</svg>")


def main():
    build = Path(sys.argv[1])
    edges = picture_edges(build)
    if sys.argv[2:] != ["--check"]:
        PICTURE.write_text(draw(edges))
        print(f"layers: {PICTURE.relative_to(ROOT)} has {len(edges)} links")
        return
    shown = re.search(r"<!-- layers: (.*) -->", PICTURE.read_text())
    old = {tuple(e) for e in json.loads(shown.group(1))}
    wrong = [f"the picture lacks {a} -> {b}" for a, b in edges if (a, b) not in old]
    wrong += [f"the picture shows {a} -> {b}, which no target links" for a, b in old - set(edges)]
    if wrong:
        sys.exit("layers: " + "\nlayers: ".join(wrong) + "\nlayers: run cmake/draw_layers.py BUILD_DIR")
    print(f"layers: {len(edges)} links are drawn as they are")


if __name__ == "__main__":
    main()
