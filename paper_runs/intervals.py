"""95 % intervals over runs.

The unit is the run: tiles of one run are not independent of each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

LEVEL = 0.95
RESAMPLES = 10_000


class Estimate(NamedTuple):
    """A value and its interval; ends that are not a number where `n` is too small for one."""

    value: float
    low: float
    high: float
    n: int

    def scaled(self, factor: float) -> Estimate:
        """In another unit; `factor` is positive."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor, self.n)

    def __str__(self) -> str:
        if math.isnan(self.low):
            return number(self.value)
        return f"{number(self.value)} ({number(self.low)} to {number(self.high)})"


def number(value: float) -> str:
    """Three significant digits, or all before the point."""
    if math.isnan(value):
        return "–"
    digits = 2 if value == 0 or not math.isfinite(value) else (
        2 - math.floor(math.log10(abs(value))))
    text = f"{value:.{min(max(digits, 0), 3)}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def _known(values: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=float)
    return array[~np.isnan(array)]


def mean(values: ArrayLike) -> Estimate:
    """The mean, by Student's t; values that are not a number are left out."""
    known = _known(values)
    n = len(known)
    if n < 2:
        return Estimate(float(known[0]) if n else math.nan, math.nan, math.nan, n)
    half = float(stats.t.ppf(0.5 + LEVEL / 2, n - 1)) * known.std(ddof=1) / math.sqrt(n)
    return Estimate(float(known.mean()), float(known.mean() - half), float(known.mean() + half), n)


def difference(a: ArrayLike, b: ArrayLike) -> Estimate:
    """The mean of `a` less that of `b`, by Welch's t: unequal variances, independent samples."""
    first, second = _known(a), _known(b)
    n = min(len(first), len(second))
    value = float(first.mean() - second.mean()) if n else math.nan
    if n < 2:
        return Estimate(value, math.nan, math.nan, n)
    parts = [each.var(ddof=1) / len(each) for each in (first, second)]
    total = sum(parts)
    if total == 0.0:
        return Estimate(value, value, value, n)
    freedom = total**2 / sum(part**2 / (len(each) - 1)
                             for part, each in zip(parts, (first, second), strict=True))
    half = float(stats.t.ppf(0.5 + LEVEL / 2, freedom)) * math.sqrt(total)
    return Estimate(value, value - half, value + half, n)


def ratio(a: ArrayLike, b: ArrayLike) -> Estimate:
    """The mean of `a` over that of `b`, neither below zero, by Fieller's theorem.

    All ratios that Welch's test does not tell from ours, with the degrees of freedom at ours
    (E. C. Fieller, J. Royal Statistical Society B 16, 175, 1954).  Where the runs do not tell the
    mean of `b` from zero no ratio is too large: from 0 to infinity.
    """
    first, second = _known(a), _known(b)
    n = min(len(first), len(second))
    if n == 0 or not second.any():
        return Estimate(math.nan, math.nan, math.nan, n)
    above, below = float(first.mean()), float(second.mean())
    value = above / below
    if n < 2:
        return Estimate(value, math.nan, math.nan, n)
    parts = [float(each.var(ddof=1)) / len(each) for each in (first, second)]
    total = parts[0] + value**2 * parts[1]
    if total == 0.0:
        return Estimate(value, value, value, n)
    freedom = total**2 / (parts[0]**2 / (len(first) - 1)
                          + (value**2 * parts[1])**2 / (len(second) - 1))
    square = float(stats.t.ppf(0.5 + LEVEL / 2, freedom))**2
    bend = below**2 - square * parts[1]  # (above - r below)^2 = square (parts[0] + r^2 parts[1])
    if bend <= 0.0:
        return Estimate(value, 0.0, math.inf, n)
    half = math.sqrt(square * (bend * parts[0] + above**2 * parts[1]))
    return Estimate(value, max((above * below - half) / bend, 0.0), (above * below + half) / bend,
                    n)


def bootstrap(samples: Sequence[ArrayLike], statistic: Callable[..., float]) -> Estimate:
    """A statistic of independent samples, by percentiles over resampled runs.

    The same data give the same interval.
    """
    arrays = [np.asarray(each, dtype=float) for each in samples]
    n = min(len(each) for each in arrays)
    value = float(statistic(*arrays)) if n else math.nan
    if n < 2:
        return Estimate(value, math.nan, math.nan, n)
    random = np.random.default_rng(0)
    found = [statistic(*(each[random.integers(len(each), size=len(each))] for each in arrays))
             for _ in range(RESAMPLES)]
    low, high = np.quantile(found, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return Estimate(value, float(low), float(high), n)


def share(count: int, n: int) -> Estimate:
    """A share of `n` independent runs, by Clopper and Pearson."""
    if n == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    tail = 0.5 - LEVEL / 2
    low = float(stats.beta.ppf(tail, count, n - count + 1)) if count else 0.0
    high = float(stats.beta.ppf(1 - tail, count + 1, n - count)) if count < n else 1.0
    return Estimate(count / n, low, high, n)


def sparse(values: ArrayLike, least: float = 0.0) -> Estimate:
    """The mean over runs of what is 0 in most of them, and never below.

    A bootstrap over the runs if most of them have any.  If not, it would know of no other values
    than those few, and of none at all of zero only: then each run's value is one event of a
    compound Poisson process, with the interval of a weighted sum of such (M. P. Fay and
    E. J. Feuer, Statistics in Medicine 16, 791, 1997; for equal ones Garwood's exact one).  What
    comes together counts so as one: an event adds what it does in our runs, in the mean over what
    is counted, or `least` if that is more; where both are 0 there is no interval.  One of 95 %
    covers the truth in 95 % of cases if half a dozen runs have any, or events are alike; in 75 to
    90 % if fewer have, and some have far more than others.
    """
    known = _known(values)
    n = len(known)
    if n == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    if 2 * (known > 0).sum() > n:
        return bootstrap([known], np.mean)
    each, tail = known / n, 0.5 - LEVEL / 2
    y, v = float(each.sum()), float(each @ each)
    w = max(least / n, v / y if y else 0.0)
    if w == 0.0:
        return Estimate(y, math.nan, math.nan, n)
    low = v / (2 * y) * float(stats.chi2.ppf(tail, 2 * y**2 / v)) if y else 0.0
    above, spread = y + w, v + w**2
    high = spread / (2 * above) * float(stats.chi2.ppf(1 - tail, 2 * above**2 / spread))
    return Estimate(y, low, high, n)


def percent(counts: ArrayLike, sizes: ArrayLike, clump: float = 1.0) -> Estimate:
    """The mean over runs of a count in per cent of a size, where most counts may be 0; see
    :func:`sparse`.

    What is counted comes at least `clump` at a time: without any, the truth may be higher by that.
    Runs of size 0 have no percentage and are left out.  An interval ends at 100 %, or at the value
    if that is more.
    """
    count, size = np.asarray(counts, dtype=float), np.asarray(sizes, dtype=float)
    count, size = count[size > 0], size[size > 0]
    found = sparse(100.0 * count / size, 100.0 * clump / size.min() if len(size) else 0.0)
    return found._replace(high=min(found.high, max(100.0, found.value)))


def together(counts: ArrayLike) -> float:
    """How many are there at a time, in the mean over what is counted; 1 where nothing is."""
    count = np.asarray(counts, dtype=float)
    return float(count @ count / count.sum()) if count.any() else 1.0


def apart(a: Estimate, b: Estimate) -> Estimate:
    """The difference of two independent estimates, from their intervals, by squares.

    R. G. Newcombe, Statistics in Medicine 17, 873, 1998, method 10; for any two estimates G. Y. Zou
    and A. Donner, the same 27, 1693, 2008.  Where neither has a count, Welch's interval would have
    no width.
    """
    value = a.value - b.value
    return Estimate(value, value - math.hypot(a.value - a.low, b.high - b.value),
                    value + math.hypot(a.high - a.value, b.value - b.low), min(a.n, b.n))


def slopes(time: ArrayLike, curves: ArrayLike, begin: float, end: float) -> NDArray[np.float64]:
    """The slope of a straight line through each curve from `begin` to `end`.

    Parameters
    ----------
    time
        [k], in s.
    curves
        [n, k].

    Returns
    -------
    float64[n], a second; not a number where fewer than three times fall between.
    """
    at, values = np.asarray(time, dtype=float), np.asarray(curves, dtype=float)
    within = (at >= begin) & (at <= end)
    if within.sum() < 3:
        return np.full(len(values), math.nan)
    centred = at[within] - at[within].mean()
    return np.asarray(values[:, within] @ centred / (centred @ centred), dtype=np.float64)
