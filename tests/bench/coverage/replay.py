#!/usr/bin/env python3
"""Replays the stopping rule of contract/stopping/stopping_rule.h, and changed ones, over stored passes.

    replay.py FILE [--error E…] [--max-spp N] [--rare RATIO] [--old]

FILE is the output of tessera-bench-passes. --rare changes the ratio from which the darkest of the other
replicates is the divisor (0: never), --old takes the bound and the rule for tiles of contract 14. Prints, for each
E, the seeds with a claim, how many claims hold, and the samples. Needs NumPy.
"""

import argparse
import json
import math
from statistics import NormalDist

import numpy as np

FILL, AIM, FEW_PIXELS, BISECTIONS, FUTILE_SAMPLES = 0.97, 0.9, 30, 25, 256


class Passes:
    """The file, seed by seed."""

    def __init__(self, path):
        with open(path, "rb") as file:
            head = json.loads(file.readline())
            start = file.tell()
            self.pixels = head["width"] * head["height"]
            self.mean = np.frombuffer(file.read(24 * self.pixels)).reshape(-1, 3)
            self.variance = np.frombuffer(file.read(24 * self.pixels)).reshape(-1, 3)
            stored = file.seek(0, 2) - start - 48 * self.pixels
        self.totals = head["totals"]
        seeds = min(head["seeds"], stored // (48 * self.pixels * len(self.totals)))
        self.means = np.memmap(path, "<f4", "r", start + 48 * self.pixels,
                               (seeds, len(self.totals), self.pixels, 4, 3))
        y, x = np.divmod(np.arange(self.pixels), head["width"])
        across = -(-head["width"] // head["tile"])
        self.tile_of = y // head["tile"] * across + x // head["tile"]

    def squares(self, seed, rare):
        """Returns the estimated and the true squared error of each pixel after each pass."""
        x = np.asarray(self.means[seed], np.float64)
        m = (x[0].mean(1) @ np.array([0.2126, 0.7152, 0.0722])).mean()
        mean = x.mean(2, keepdims=True)
        others = (4 * mean - x) / 3
        if rare:
            ordered = np.sort(x, axis=2)
            darkest = np.where(x == ordered[:, :, :1], ordered[:, :, 1:2], ordered[:, :, :1])
            others = np.where(darkest * rare < others, darkest, others)
        floor = 0.01 * m * m
        estimated = ((x - mean) ** 2 / (others ** 2 + floor)).sum((2, 3)) / 12
        true = (((mean[:, :, 0] - self.mean) ** 2 - self.variance) / (self.mean ** 2 + floor)).sum(2)
        return estimated, true


class Rule:
    """Sums of tiles are arrays (pixels, Σ c, Σ c²)."""

    def __init__(self, error, totals, old):
        self.target, self.totals, self.old = error * error, totals, old
        self.last = len(totals) - 1
        self.z = NormalDist().inv_cdf(1 - 0.05 / max(1, self.last))

    def upper(self, sums):
        pixels, total, squares = sums
        mean = total / pixels
        if mean == 0:
            return 0
        deviation = self.z * math.sqrt(max(squares / pixels - mean * mean, 0) / (pixels - 1)) / mean
        return mean / 3 * (1 + 2 * deviation / (1 if self.old else max(1 - deviation / 2, 1 / 64)))

    @staticmethod
    def effective(sums):
        return sums[1] ** 2 / sums[2] if sums[2] > 0 else 0

    def scaled(self, sums, factor):
        return sums * np.array([1, factor, factor * factor])

    def is_thin(self, sums, factor=1):
        """Whether a tile is planned to continue; under the old rule it must."""
        share = sums[1] * factor / 3 > self.target / FEW_PIXELS * self.pixels
        return self.effective(sums) < FEW_PIXELS and share

    def end(self, sums, at, level):
        for last in range(at + 1, self.last):
            factor = self.totals[at] / self.totals[last]
            square = sums[1] / sums[0] / 3 * factor
            if not self.is_thin(sums, factor) and square / self.totals[last] <= level:
                return last
        return self.last

    def predict(self, frame, at, level):
        """Returns the sums of stopped and of active tiles, as predicted."""
        sums = np.zeros((2, 3))
        for tile, stop in enumerate(self.stops):
            if stop is None:
                end = self.end(frame[at][tile], at, level)
                sums[1] += self.scaled(frame[at][tile], self.totals[at] / self.totals[end])
            else:
                sums[0] += frame[stop][tile]
        return sums

    def bound(self, sums, factor=1.0):
        return self.upper(sums[0] + self.scaled(sums[1], factor))

    def bisect(self, low, high, room, bound, low_is_met):
        for _ in range(BISECTIONS):
            middle = math.sqrt(low * high)
            if (bound(middle) <= room) == low_is_met:
                low = middle
            else:
                high = middle
        return low

    def look(self, frame, at):
        def bound(level):
            return self.bound(self.predict(frame, at, level))
        active = [tile for tile, stop in enumerate(self.stops) if stop is None]
        shrunk = [(self.totals[at] / self.totals[p]) ** 2 for p in (at + 1, self.last)]
        high = shrunk[0] * max(frame[at][t][1] / frame[at][t][0] / 3 / self.totals[at] for t in active)
        stopped = self.bound(self.predict(frame, at, 0), 0)
        room, low, level = stopped + AIM * (FILL * self.target - stopped), high * shrunk[1] ** 2, 0
        if high == 0 or bound(high) <= room:
            level = high
        elif bound(low) <= room:
            level = self.bisect(low, high, room, bound, True)
        sums, scale = self.predict(frame, at, level), 1
        if self.bound(sums) < FILL * self.target:
            scale = self.bisect(1, 1024, FILL * self.target, lambda f: self.bound(sums, f), True)
        whole = sums[0] + self.scaled(sums[1], scale)
        for t in active:
            factor = scale * self.totals[at] / self.totals[self.end(frame[at][t], at, level)]
            self.others[t] = whole - self.scaled(frame[at][t], factor) if level > 0 else None

    def may_stop(self, sums, tile):
        if sums[1] == 0:
            return True
        if self.old and self.is_thin(sums) or self.others[tile] is None:
            return False
        return self.upper(self.others[tile] + sums) <= FILL * self.target

    def is_futile(self, frame, at):
        if self.old or self.totals[at] < FUTILE_SAMPLES:
            return False
        sums = sum(frame[at if stop is None else stop][t] for t, stop in enumerate(self.stops))
        left = self.totals[at] / self.totals[-1]
        return self.effective(sums) < FEW_PIXELS and self.upper(sums) * left * left > self.target

    def run(self, frame):
        """Takes the sums by pass and tile. Returns the last pass of each tile."""
        count = len(frame[0])
        self.pixels = sum(tile[0] for tile in frame[0])
        self.stops, self.others, futile = [None] * count, [None] * count, False
        for at in range(self.last + 1):
            for tile in range(count):
                if at == 0 or self.stops[tile] is not None:
                    continue
                if futile or at == self.last or self.may_stop(frame[at][tile], tile):
                    self.stops[tile] = at
            if None not in self.stops:
                break
            if at + 2 <= self.last:
                self.look(frame, at)
                futile = self.is_futile(frame, at)
        return self.stops

    def claims(self, frame):
        sums = sum(frame[stop][tile] for tile, stop in enumerate(self.stops))
        thin = any(self.is_thin(frame[stop][tile]) for tile, stop in enumerate(self.stops))
        if self.old and (thin or self.effective(sums) < FEW_PIXELS):
            return False, self.upper(sums)
        return self.upper(sums) <= self.target, self.upper(sums)


def replay(passes, squares, error, options):
    """Returns for each seed: whether there is a claim, the true square, its bound, samples per pixel."""
    totals = np.array([total for total in passes.totals if total <= options.max_spp])
    rows = []
    for estimated, true in squares:
        count = passes.tile_of.max() + 1
        frame = [np.stack([np.bincount(passes.tile_of, weights, count)
                           for weights in (np.ones_like(c), c, c * c)], 1) for c in estimated]
        rule = Rule(error, totals, options.old)
        last = np.array(rule.run(frame[:len(totals)]))[passes.tile_of]
        claim, bound = rule.claims(frame)
        square = true[last, np.arange(passes.pixels)].mean() / 3
        rows.append((claim, square, bound, totals[last].mean()))
    return np.array(rows, float)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--error", type=float, nargs="+", default=[0.05])
    parser.add_argument("--max-spp", type=int, default=1 << 20)
    parser.add_argument("--rare", type=float, default=32)
    parser.add_argument("--old", action="store_true")
    options = parser.parse_args()
    passes = Passes(options.file)
    squares = [passes.squares(seed, options.rare) for seed in range(len(passes.means))]
    for error in options.error:
        rows = replay(passes, squares, error, options)
        claims = rows[rows[:, 0] == 1]
        print(f"E {error}: {len(claims)} of {len(rows)} seeds with a claim, "
              f"{(claims[:, 1] <= claims[:, 2]).sum()} held, {rows[:, 3].mean():.1f} samples per pixel")


if __name__ == "__main__":
    main()
