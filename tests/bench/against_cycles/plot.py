"""Error against CPU time as SVG, on logarithmic scales."""

import math
import statistics

import comparison

WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM = 520, 340, 62, 34, 24, 44
COLORS = ["#1f6fb4", "#d1661f", "#8a8a2a", "#7d4b9e"]


class Axis:
    def __init__(self, values, start, end):
        self.low = math.floor(math.log10(min(values)))
        self.high = max(math.ceil(math.log10(max(values))), self.low + 1)
        self.start, self.end = start, end

    def at(self, value):
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.start + min(max(share, 0), 1) * (self.end - self.start)

    def ticks(self):
        return [10.0**k for k in range(self.low, self.high + 1)]


def label(value):
    return f"{value:g}"


def frame(x, y, title, goal):
    parts = [f'<text x="{LEFT}" y="20" font-size="14">{title}</text>']
    for tick in x.ticks():
        parts.append(f'<path d="M{x.at(tick):.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>'
                     f'<text x="{x.at(tick):.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">{label(tick)}</text>')
    for tick in y.ticks():
        parts.append(f'<path d="M{LEFT} {y.at(tick):.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>'
                     f'<text x="{LEFT - 5}" y="{y.at(tick) + 4:.1f}" text-anchor="end">{label(tick)}</text>')
    parts.append(f'<path d="M{LEFT} {y.at(goal):.1f}H{WIDTH - RIGHT}" stroke="#555" stroke-dasharray="4 3"/>')
    parts.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 10}" text-anchor="middle">'
                 "CPU seconds per megapixel, one thread</text>")
    parts.append(f'<text transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" '
                 'text-anchor="middle">relMSE</text>')
    return parts


def curves(row, goal):
    """Returns the SVG of one scene: mean error of each renderer with its 95 % band."""
    lines = []
    for name, entry in row["renderers"].items():
        points = [(x, statistics.mean(errors), comparison.band(errors)) for x, errors in entry["curve"]]
        lines.append((name, entry["slope"], [p for p in points if p[1] > 0]))
    x = Axis([p[0] for _, _, points in lines for p in points], LEFT, WIDTH - RIGHT)
    y = Axis([p[1] for _, _, points in lines for p in points] + [goal], HEIGHT - BOTTOM, TOP)
    parts = frame(x, y, row["scene"].replace("_", " "), goal)
    floor = 10.0**y.low
    for k, (name, slope, points) in enumerate(lines):
        upper = [f"{x.at(p[0]):.1f} {y.at(max(p[2][1], floor)):.1f}" for p in points]
        lower = [f"{x.at(p[0]):.1f} {y.at(max(p[2][0], floor)):.1f}" for p in reversed(points)]
        middle = [f"{x.at(p[0]):.1f} {y.at(p[1]):.1f}" for p in points]
        color = COLORS[k % len(COLORS)]
        parts.append(f'<path d="M{"L".join(upper + lower)}Z" fill="{color}" fill-opacity="0.2"/>')
        parts.append(f'<path d="M{"L".join(middle)}" fill="none" stroke="{color}" stroke-width="1.6"/>')
        text = name if slope is None else f"{name}, slope {slope:.2f}"
        parts.append(f'<text x="{WIDTH - RIGHT - 6}" y="{TOP + 16 + 15 * k}" text-anchor="end" fill="{color}">'
                     f"{text}</text>")
    body = "\n".join(parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" '
            f'font-size="11"><rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>\n{body}\n</svg>\n')
