#!/usr/bin/env python3
"""Measures how the cost of a ray grows and draws it.

    tests/bench/accel/growth.py [--bin build/bench/bin] [--folder docs/notes] [--depth]

Runs `tessera-bench-accel --growth`, which prints the table, and plots on logarithmic axes: in
cost-growth.svg nanoseconds per ray against the number of triangles and against depth complexity,
in depth-complexity.svg the work and time of rays and of a z-buffer against depth complexity.
`--depth` makes the second only. The SVGs follow the reader's light or dark colour scheme.
"""

import argparse
import json
import math
import pathlib
import subprocess
import tempfile

WIDTH, HEIGHT, LEFT, TOP, PLOT_WIDTH, PLOT_HEIGHT, GAP = 960, 400, 60, 40, 360, 290, 110
STYLE = """
    .frame, .grid { fill: none; stroke: #8884; } .frame { stroke: #888; }
    text { font: 13px sans-serif; fill: #222; } .title { font-weight: bold; }
    .c0 { stroke: #1f6fb4; fill: #1f6fb4; } .c1 { stroke: #c4501b; fill: #c4501b; }
    .c2 { stroke: #2a8a4a; fill: #2a8a4a; } .guide { stroke: #999; stroke-dasharray: 3 4; }
    polyline, .guide { fill: none; stroke-width: 2; } .guide { stroke-width: 1; }
    text.c0, text.c1, text.c2 { stroke: none; }
    @media (prefers-color-scheme: dark) {
      text { fill: #ddd; }
      .c0 { stroke: #6db3f2; fill: #6db3f2; } .c1 { stroke: #f0955c; fill: #f0955c; }
      .c2 { stroke: #6ccf8c; fill: #6ccf8c; } }
"""


def power(exponent):
    return {0: "1", 1: "10"}.get(exponent, f"10<tspan dy='-5' font-size='9'>{exponent}</tspan>")


class Plot:
    """One log-log plot with its left edge at `left`."""

    def __init__(self, left, title, x_label, xs, ys):
        self.left = left
        self.x0, self.x1 = math.floor(math.log10(min(xs))), math.ceil(math.log10(max(xs)))
        self.y0, self.y1 = math.floor(math.log10(min(ys))), math.ceil(math.log10(max(ys)))
        bottom, middle = TOP + PLOT_HEIGHT, left + PLOT_WIDTH / 2
        self.parts = [
            f'<text class="title" x="{middle}" y="{TOP - 14}" text-anchor="middle">{title}</text>',
            f'<text x="{middle}" y="{bottom + 38}" text-anchor="middle">{x_label}</text>']
        for e in range(self.x0, self.x1 + 1):
            x = self.at(10.0 ** e, 1)[0]
            self.parts.append(f'<path class="grid" d="M{x:.1f} {TOP}V{bottom}"/>'
                              f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{power(e)}</text>')
        for e in range(self.y0, self.y1 + 1):
            y = self.at(1, 10.0 ** e)[1]
            self.parts.append(f'<path class="grid" d="M{left} {y:.1f}h{PLOT_WIDTH}"/>'
                              f'<text x="{left - 8}" y="{y + 4:.1f}" text-anchor="end">{power(e)}</text>')
        self.parts.append(
            f'<rect class="frame" x="{left}" y="{TOP}" width="{PLOT_WIDTH}" height="{PLOT_HEIGHT}"/>')

    def at(self, x, y):
        across = (math.log10(x) - self.x0) / (self.x1 - self.x0)
        up = (math.log10(y) - self.y0) / (self.y1 - self.y0)
        return self.left + PLOT_WIDTH * across, TOP + PLOT_HEIGHT * (1 - up)

    def line(self, colour, label, points):
        places = [self.at(x, y) for x, y in points]
        self.parts.append(f'<polyline class="c{colour}" style="fill:none" points="'
                          + " ".join(f"{x:.1f},{y:.1f}" for x, y in places) + '"/>')
        self.parts += [f'<circle class="c{colour}" cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in places]
        x, y = self.left + 14, TOP + 22 + 20 * colour
        self.parts.append(f'<path class="c{colour}" style="stroke-width:2" d="M{x} {y - 5}h22"/>'
                          f'<text class="c{colour}" x="{x + 30}" y="{y}">{label}</text>')


def svg(*plots):
    parts = [part for plot in plots for part in plot.parts]
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">\n'
            f"<style>{STYLE}</style>\n" + "\n".join(parts) + "\n</svg>\n")


def against_layers(left, title, layers, kinds):
    """A plot of some columns of the rows against their depth complexity."""
    plot = Plot(left, title, "depth complexity", [row["layers"] for row in layers],
                [row[key] for row in layers for key, _ in kinds])
    for colour, (key, label) in enumerate(kinds):
        plot.line(colour, label, [(row["layers"], row[key]) for row in layers])
    return plot


RIGHT = LEFT + PLOT_WIDTH + GAP


def draw_growth(figures):
    triangles, layers = figures["triangles"], figures["depth_complexity"]
    kinds = [("bounce_ns", "scattered"), ("camera_ns", "camera, single rays"),
             ("camera_packets_ns", "camera, in packets")]
    left = Plot(LEFT, "nanoseconds per ray, terrain", "triangles",
                [row["triangles"] for row in triangles],
                [row[key] for row in triangles for key, _ in kinds])
    for colour, (key, label) in enumerate(kinds):
        left.line(colour, label, [(row["triangles"], row[key]) for row in triangles])
    return svg(left, against_layers(RIGHT, "nanoseconds per ray, parallel layers", layers,
                                    [("hierarchy_ns", "BVH"), ("brute_force_ns", "brute force")]))


def draw_depth(figures):
    layers = [dict(row, visits=row["nodes_per_ray"] + row["triangles_per_ray"])
              for row in figures["depth_complexity"]]
    return svg(against_layers(LEFT, "work per pixel", layers,
                              [("visits", "BVH: nodes and triangles of a ray"),
                               ("fragments_per_pixel", "z-buffer: fragments")]),
               against_layers(RIGHT, "nanoseconds per pixel", layers,
                              [("hierarchy_ns", "BVH: a ray"), ("z_buffer_ns", "z-buffer")]))


def main():
    root = pathlib.Path(__file__).resolve().parents[3]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bin", type=pathlib.Path, default=root / "build/bench/bin")
    parser.add_argument("--folder", type=pathlib.Path, default=root / "docs/notes")
    parser.add_argument("--depth", action="store_true")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table = pathlib.Path(folder) / "growth.json"
        command = [args.bin / "tessera-bench-accel", "--depth" if args.depth else "--growth",
                   "--json", table]
        subprocess.run(command + (["--quick"] if args.quick else []), check=True)
        figures = json.loads(table.read_text())
    if not args.depth:
        (args.folder / "cost-growth.svg").write_text(draw_growth(figures))
    (args.folder / "depth-complexity.svg").write_text(draw_depth(figures))


if __name__ == "__main__":
    main()
