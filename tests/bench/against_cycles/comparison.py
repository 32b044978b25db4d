"""Statistics of the comparison with Cycles. Unit tests: comparison_test.py.

relMSE = mean of (x - r)^2 / (r^2 + 0.01) over pixels and channels.
"""

import dataclasses
import math
import statistics

import numpy

LARGEST_MEAN_DIFFERENCE = 0.01
BLOCK_LEVEL = 0.01  # of the t-test of one block
CHANCE_LEVEL = 0.01  # of the test whether as many blocks differ by chance


def rel_mse(squares, reference):
    return float((squares / (reference**2 + 0.01)).mean())


class Reference:
    """The mean of images with different seeds, and its own relMSE, estimated from their spread."""

    def __init__(self, images):
        stack = numpy.array(images)
        self.images = images
        self.mean = stack.mean(0)
        self.rel_mse = rel_mse(stack.var(0, ddof=1) / len(images), self.mean)

    def error_of(self, image):
        """Returns the relMSE of an image, without the part of the reference. May be negative."""
        return rel_mse((image - self.mean) ** 2, self.mean) - self.rel_mse


def student_tail(t, freedom):
    """Returns P(|T| > t)."""
    theta = math.atan(t / math.sqrt(freedom))
    steps = 400
    width = (math.pi / 2 - theta) / steps
    angles = theta + (numpy.arange(steps) + 0.5) * width
    scale = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2)) / math.sqrt(math.pi)
    return 2 * scale * float((numpy.cos(angles) ** (freedom - 1)).sum()) * width


def binomial_tail(count, trials, chance):
    """Returns P(X >= count)."""
    return 1 - sum(math.comb(trials, k) * chance**k * (1 - chance) ** (trials - k) for k in range(count))


def blocks(image):
    """Returns means over 8 x 8 pixels and the channels."""
    height, width, _ = image.shape
    return image.mean(2).reshape(height // 8, 8, width // 8, 8).mean((1, 3)).ravel()


@dataclasses.dataclass(frozen=True)
class Agreement:
    """Whether two renderers make the same image."""

    mean_ratio: float  # theirs / ours
    block_count: int
    differing: int  # blocks whose means differ by Welch's t-test at BLOCK_LEVEL

    @property
    def comparable(self):
        by_chance = binomial_tail(self.differing, self.block_count, BLOCK_LEVEL) >= CHANCE_LEVEL
        return abs(self.mean_ratio - 1) <= LARGEST_MEAN_DIFFERENCE and by_chance


def agreement(ours, theirs):
    """Compares two lists of images."""
    a, b = (numpy.array([blocks(image) for image in images]) for images in (ours, theirs))
    va, vb = a.var(0, ddof=1) / len(a), b.var(0, ddof=1) / len(b)
    differing = 0
    for k in range(a.shape[1]):
        v = va[k] + vb[k]
        difference = abs(a[:, k].mean() - b[:, k].mean())
        if v == 0:
            differing += difference > 1e-6
            continue
        freedom = v**2 / (va[k] ** 2 / (len(a) - 1) + vb[k] ** 2 / (len(b) - 1))
        differing += student_tail(difference / math.sqrt(v), freedom) < BLOCK_LEVEL
    return Agreement(float(numpy.mean(theirs) / numpy.mean(ours)), a.shape[1], int(differing))


def crossing(curve, goal):
    """Returns the x at which a curve of (x, error) falls to `goal`, or None.

    Between two points the curve is a straight line on logarithmic scales. Nothing is extrapolated: a curve
    that begins at or below the goal, or never reaches it, gives None.
    """
    for (x0, e0), (x1, e1) in zip(curve, curve[1:]):
        if e0 > goal >= e1:
            if e1 <= 0:  # no more than the error of the reference
                return None
            return x0 * (x1 / x0) ** (math.log(e0 / goal) / math.log(e0 / e1))
    return None


def means(samples):
    """Returns the curve (x, mean error) of a curve (x, errors of seeds)."""
    return [(x, statistics.mean(errors)) for x, errors in samples]


def resampled(samples, random):
    """Returns a bootstrap sample of the seeds at each point."""
    return [(x, random.choice(errors, len(errors))) for x, errors in samples]


def ratio_interval(theirs, ours, goal, rounds=1000, level=0.95):
    """Returns bounds of crossing(theirs) / crossing(ours) by a bootstrap over seeds, or None."""
    random = numpy.random.default_rng(1)
    found = []
    for _ in range(rounds):
        ends = [crossing(means(resampled(samples, random)), goal) for samples in (theirs, ours)]
        if None not in ends:
            found.append(ends[0] / ends[1])
    if len(found) < 0.9 * rounds:
        return None
    tail = (1 - level) / 2
    return tuple(float(q) for q in numpy.quantile(found, [tail, 1 - tail]))


def band(errors, level=0.95):
    """Returns bounds of the mean of `errors` by a bootstrap."""
    random = numpy.random.default_rng(1)
    found = [random.choice(errors, len(errors)).mean() for _ in range(1000)]
    tail = (1 - level) / 2
    return tuple(float(q) for q in numpy.quantile(found, [tail, 1 - tail]))


def slope(curve):
    """Returns the least-squares slope of log(error) over log(x); -1 for independent samples."""
    points = [(math.log(x), math.log(e)) for x, e in curve if e > 0]
    if len(points) < 2:
        return None
    return float(numpy.polyfit(*zip(*points), 1)[0])


def geometric_mean(values):
    return math.exp(statistics.mean(math.log(v) for v in values))
