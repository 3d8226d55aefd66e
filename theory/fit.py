"""Nonlinear least squares of magnet models to force-distance measurements.

The models are the paper's law F = alpha/(r + beta)^2, a power law, and the exact forces of
coaxial cylinders and of cuboids (:mod:`theory.permanent`).  The law is an approximation over a
range of distances, not the force of any magnet; :func:`halves`, :func:`runs_test` and chi^2 tell
how local a fit is.  SI units; forces are sizes, positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, least_squares
from scipy.special import gammaln
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import f as f_distribution
from scipy.stats import norm
from scipy.stats import t as t_distribution

from theory.permanent import coaxial_cuboids, coaxial_cylinders

Floats = NDArray[np.float64]
Interval = tuple[float, float]

REFERENCE = 0.01  # m, where the power law's amplitude is taken
SHAPES = (0.03, 0.1, 0.3, 1.0, 3.0)  # starts of a length, in largest distances
LENGTHS = 6  # of which every two are a start of an exact magnet
VALLEY = 12  # points along the valley of a fit of two shapes
ROUGHLY, EXACTLY = 1e-3, 1e-12  # relative change of chi^2 at which a start is left, and a fit done
ENOUGH = 500  # points, or means of them, that tell starts from each other
LIMIT = 300  # evaluations of a search


class Parameter(NamedTuple):
    """A parameter of a model and the values that it may take."""

    name: str
    unit: str
    low: float
    high: float


class Model(NamedTuple):
    """A force law with parameters, of which the first is an amplitude: F ~ first^power."""

    name: str
    formula: str
    parameters: tuple[Parameter, ...]
    force: Callable[..., Floats]  # of the measured distance and the parameters
    power: int
    shapes: Callable[[float], list[tuple[float, ...]]]
    """Starts of the other parameters, given the largest distance."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)


def models(distance: str = "centre", inset: float = 0.0,
           nearest: float = math.inf) -> dict[str, Model]:
    """The models, for distances measured in a given way.

    Parameters
    ----------
    distance
        ``"centre"``: measured between the magnets' centres.  ``"gap"``: the clearance between
        the bodies that hold them.  The law and the power law then have r = gap + 2 `inset`; of
        the exact models, whose faces are taken to be flush, r = gap + height.
    inset
        From the surface that a gap is measured to, to the magnet's centre (m).
    nearest
        The smallest centre distance (m), which no height may exceed.

    Raises
    ------
    ValueError
        Where `distance` is neither.
    """
    if distance not in ("centre", "gap"):
        raise ValueError(f'distance must be "centre" or "gap", not {distance!r}')
    gap = distance == "gap"
    offset = 2 * inset if gap else 0.0
    tallest = 0.1 if gap else min(0.1, nearest)

    def law(d: Floats, alpha: float, beta: float) -> Floats:
        return alpha / (d + offset + beta) ** 2

    def power_law(d: Floats, force: float, exponent: float) -> Floats:
        return force * ((d + offset) / REFERENCE) ** -exponent

    def cylinder(d: Floats, polarisation: float, radius: float, height: float) -> Floats:
        return coaxial_cylinders(d + height if gap else d, radius, height, polarisation)

    def cuboid(d: Floats, polarisation: float, side: float, height: float) -> Floats:
        return coaxial_cuboids(d + height if gap else d, side, height, polarisation)

    def body(far: float) -> list[tuple[float, ...]]:
        # From a magnet that is small even where the points begin to one that is large even where
        # they end: of a known polarisation it may be flat and wide, and no small one leads there.
        lengths = np.geomspace(min(0.03 * far, 0.1 * nearest), min(10 * far, 0.1), LENGTHS).tolist()
        return [(a, min(h, 0.9 * tallest)) for a in lengths for h in lengths]

    polarisation = Parameter("polarisation", "T", 0.0, 2.0)
    height = Parameter("height", "m", 1e-4, tallest)
    made = (
        Model("law", "alpha / (r + beta)^2",
              (Parameter("alpha", "N m^2", 0.0, 10.0), Parameter("beta", "m", 0.0, 10.0)),
              law, 1, lambda far: [(b * far,) for b in SHAPES]),
        Model("power", "force / (r / 1 cm)^exponent",
              (Parameter("force", "N", 0.0, 1e6), Parameter("exponent", "", 0.0, 10.0)),
              power_law, 1, lambda far: [(float(n),) for n in (1, 2, 3, 4)]),
        Model("cylinder", "coaxial cylinders, exact",
              (polarisation, Parameter("radius", "m", 1e-4, 0.1), height), cylinder, 2, body),
        Model("cuboid", "cuboids of square section, exact",
              (polarisation, Parameter("side", "m", 1e-4, 0.1), height), cuboid, 2, body),
    )
    return {model.name: model for model in made}


# Parameters whose largest value is only where the search for them ends.
SEARCHED = ("alpha", "beta", "force", "exponent")

class Loss(NamedTuple):
    """A loss of the squared residual over the squared threshold, as SciPy's."""

    tuning: float  # the threshold, in scales of the residuals
    rho: Callable[[Floats], Floats]
    first: Callable[[Floats], Floats]  # rho'
    second: Callable[[Floats], Floats]  # rho''


LOSSES = {
    "linear": Loss(1.0, np.asarray, np.ones_like, np.zeros_like),
    "soft_l1": Loss(1.345, lambda z: 2 * ((1 + z) ** 0.5 - 1), lambda z: (1 + z) ** -0.5,
                    lambda z: -0.5 * (1 + z) ** -1.5),
    "huber": Loss(1.345, lambda z: np.where(z > 1, 2 * np.maximum(z, 1) ** 0.5 - 1, z),
                  lambda z: np.where(z > 1, np.maximum(z, 1) ** -0.5, 1.0),
                  lambda z: np.where(z > 1, -0.5 * np.maximum(z, 1) ** -1.5, 0.0)),
    "cauchy": Loss(2.385, np.log1p, lambda z: 1 / (1 + z), lambda z: -1 / (1 + z) ** 2),
}


@dataclass(frozen=True)
class Fit:
    """A fitted model.  Arrays over parameters are in the order of the model's parameters."""

    model: Model
    distance: Floats  # m
    force: Floats  # N
    sd: Floats | None  # N
    low: Floats
    high: Floats
    free: NDArray[np.bool_]
    loss: str
    absolute: bool  # the uncertainties are taken at their word
    values: Floats
    unit: Floats  # the size of each parameter, for steps
    threshold: float = 1.0  # of the robust loss, in uncertainties
    optima: int = 1  # different minima of the same depth that the starts led to
    stopped: bool = False  # the search ended at its limit of evaluations

    @property
    def weight(self) -> Floats:
        """1/uncertainty (1/N); 1 where none are given."""
        return np.ones_like(self.force) if self.sd is None else 1 / self.sd

    def predict(self, distance: ArrayLike) -> Floats:
        """The fitted force (N) at measured distances (m)."""
        return self.model.force(np.asarray(distance, float), *self.values)

    @property
    def residuals(self) -> Floats:
        """Measured minus fitted (N)."""
        return self.force - self.predict(self.distance)

    @property
    def chi2(self) -> float:
        """Sum of squares of the residuals in uncertainties; in N^2 where there are none."""
        return float(np.sum((self.weight * self.residuals) ** 2))

    @property
    def rounding(self) -> float:
        """The chi^2 of a curve that goes through every point, but for rounding."""
        return 1e-20 * float(np.sum((self.weight * self.force) ** 2))

    @property
    def dof(self) -> int:
        return self.force.size - int(self.free.sum())

    @property
    def p_value(self) -> float:
        """How often chi^2 would be as large if the model and the uncertainties were right."""
        return math.nan if self.sd is None else float(chi2_distribution.sf(self.chi2, self.dof))

    @property
    def scatter(self) -> float:
        """How far points lie from the curve, in uncertainties: sqrt(chi^2/dof), or of a robust
        loss by their median, for which outliers do not count."""
        return math.sqrt(self.chi2 / self.dof) if self.loss == "linear" else _median_scale(self)

    @property
    def scale(self) -> float:
        """The scatter that errors are scaled by: 1 if uncertainties are absolute."""
        return 1.0 if self.absolute else self.scatter

    @property
    def at_bound(self) -> NDArray[np.int64]:
        """-1 for a free parameter that ended at its lower bound, 1 at its upper one, else 0."""
        near = 1e-6 * np.minimum(self.unit, self.high - self.low)
        below, above = self.values - self.low <= near, self.high - self.values <= near
        return np.where(self.free, above.astype(np.int64) - below, 0)

    @property
    def inside(self) -> Fit:
        """The fit with the parameters that ended at a bound held there.

        Its errors are those of the other parameters: one at a bound has none that the scatter
        of the points could tell.
        """
        return replace(self, free=self.free & (self.at_bound == 0))

    def quantile(self, level: float) -> float:
        """Half width of an interval of that level in standard errors.

        Of Student's t, or of the normal distribution where the scatter is not estimated.
        """
        tail = 0.5 + 0.5 * level
        return float(norm.ppf(tail) if self.absolute else t_distribution.ppf(tail, self.dof))

    @property
    def jacobian(self) -> Floats:
        """Derivatives of the force by the free parameters, over the uncertainties.

        Exact by the amplitude; else central differences, of steps at which rounding does not
        count: a near cuboid's force is the sum of terms that cancel, of flat ones to 1e-7 of it.
        """
        columns, power = [], self.model.power
        for k in np.flatnonzero(self.free):
            if k == 0:
                one = self.model.force(self.distance, *_put(self.values, 0, 1.0))
                columns.append(self.weight * one * power * self.values[0] ** (power - 1))
                continue
            step = 1e-4 * max(abs(self.values[k]), 1e-3 * self.unit[k])
            ends = np.clip(self.values[k] + np.array([-step, step]), self.low[k], self.high[k])
            below, above = (self.model.force(self.distance, *_put(self.values, k, end))
                            for end in ends)
            columns.append(self.weight * (above - below) / (ends[1] - ends[0]))
        return np.stack(columns, axis=1)

    @property
    def covariance(self) -> Floats:
        """Covariance of all parameters; zero for fixed ones, infinite where they cannot be told.

        scale^2 (J^T J)^-1; for a robust loss with Huber's correction (Robust Statistics, 7.6).
        """
        cov = np.zeros((self.values.size, self.values.size))
        if not self.free.any():
            return cov
        unit = self.unit[self.free]
        _, singular, vt = np.linalg.svd(self.jacobian * unit, full_matrices=False)
        k = int(self.free.sum())
        inner = np.full((k, k), np.inf)
        if singular[-1] > 1e-9 * singular[0]:
            with np.errstate(over="ignore", invalid="ignore"):  # of forces that are next to nothing
                half = vt.T / singular * unit[:, None] * _spread(self)
                made = half @ half.T
            inner = made if np.all(np.isfinite(made)) else inner
        cov[np.ix_(self.free, self.free)] = inner
        return cov

    @property
    def errors(self) -> Floats:
        """Standard errors of the parameters."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Floats:
        """Correlation of the free parameters."""
        e = self.errors[self.free]
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance[np.ix_(self.free, self.free)] / np.outer(e, e))

    @property
    def aicc(self) -> float:
        """Akaike's criterion, corrected for few points (Burnham and Anderson 2002).

        To be compared between models of the same points, uncertainties and kind of `scale`;
        NaN for a robust loss, which has no likelihood, and infinite with too few points.  Of
        absolute uncertainties it is chi^2 + 2 k for any number of points: what is corrected is
        what the estimated scatter adds.
        """
        n, k = self.force.size, int(self.free.sum())
        if self.loss != "linear":
            return math.nan
        if self.absolute:
            return self.chi2 + 2 * k
        k += 1  # the scatter
        if n - k - 1 <= 0:
            return math.inf
        deviance = n * math.log(max(self.chi2, self.rounding) / n)
        return deviance + 2 * k + 2 * k * (k + 1) / (n - k - 1)


def fit(
    model: Model,
    distance: ArrayLike,
    force: ArrayLike,
    sd: ArrayLike | None = None,
    *,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    loss: str = "linear",
    absolute: bool = False,
    starts: int = 4,
) -> Fit:
    """Fit a model by nonlinear least squares.

    Parameters
    ----------
    model
        One of :func:`models`.
    distance, force
        Measurements (m, N), shape (n,).
    sd
        Standard deviations of the forces (N), shape (n,); the weights are 1/sd^2.
    fixed, bounds
        Parameters that are known, and limits for the others, by name; of those that are None or
        infinite the model's own.
    loss
        ``"linear"``, or ``"soft_l1"``, ``"huber"``, ``"cauchy"`` against outliers; their
        threshold follows from the median of the residuals.  Outliers can hold such a fit at a
        curve of their own: it is also started with amplitudes from medians, and the solution of
        the least scatter, by that median, is kept; of those with absolute uncertainties, whose
        threshold is known, the one of the least loss.  Of at most twice as many points as free
        parameters half are near some curve anyway, and plain least squares is the one start.
    absolute
        Take `sd` at its word.  Otherwise only its ratios count, and standard errors are scaled
        by sqrt(chi^2/dof).
    starts
        How many starts to follow to the end: of all, followed until chi^2 hardly changes, those
        that have come lowest, in different places, as chi^2 of exact magnets has several minima.
        Of 1 it is the one that begins lowest.  Each has the best amplitude for one shape of the
        curve.

    Raises
    ------
    ValueError
        No more points than free parameters, values that are not finite, distances below 0,
        uncertainties that are not positive, unknown names, a fixed value that the model's
        parameter cannot take, no start, or a model that is not finite at these distances.
    """
    d, f = np.asarray(distance, float), np.asarray(force, float)
    s = None if sd is None else np.asarray(sd, float)
    for name, array in (("distance", d), ("force", f), ("sd", s)):
        if array is not None and (array.shape != (f.size,) or not np.all(np.isfinite(array))):
            raise ValueError(f"{name} must be {f.size} finite numbers in a row")
    if np.any(d < 0):  # beyond r + beta = 0 the law is another curve, and fits
        raise ValueError(f"distance must be at least 0, not {d.min():g} m")
    if s is not None and np.any(s <= 0):
        raise ValueError("sd must be positive")
    known, given = dict(fixed or {}), dict(bounds or {})
    if loss not in LOSSES:
        raise ValueError(f"loss must be one of {', '.join(LOSSES)}, not {loss!r}")
    for name in (*known, *given):
        if name not in model.names:
            raise ValueError(f"{name} is not a parameter of {model.name}, which has "
                             f"{', '.join(model.names)}")
    if starts < 1:
        raise ValueError(f"starts must be at least 1, not {starts}")
    free = np.array([name not in known for name in model.names])
    if not free.any():
        raise ValueError("all parameters are fixed; at least one must be free")
    if f.size <= free.sum():
        raise ValueError(f"{f.size} points; {free.sum()} free parameters need at least "
                         f"{free.sum() + 1}")
    for p in model.parameters:
        if not p.low < p.high:
            raise ValueError(f"no {p.name} is left: it is at least {p.low:g} {p.unit}, and no more "
                             f"than the least centre distance, {p.high:g} {p.unit}")
    for p in model.parameters:
        if not p.low <= known.get(p.name, p.low) <= p.high:
            raise ValueError(f"{p.name} must be from {p.low:g} to {p.high:g} {p.unit}".rstrip()
                             + f", not {known[p.name]:g}")
    limits = [given.get(p.name, (None, None)) for p in model.parameters]
    low = np.array([p.low if a is None or math.isinf(a) else a
                    for p, (a, _) in zip(model.parameters, limits, strict=True)])
    high = np.array([p.high if b is None or math.isinf(b) else b
                     for p, (_, b) in zip(model.parameters, limits, strict=True)])
    for k, name in enumerate(model.names):
        if not low[k] < high[k]:
            raise ValueError(f"the bounds of {name}, {low[k]:g} and {high[k]:g}, "
                             "must be in rising order")
    zero = np.zeros(len(model.names))
    empty = Fit(model, d, f, s, low, high, free, "linear", absolute and s is not None, zero,
                np.ones_like(zero))
    nearly = [replace(empty, values=start, unit=np.maximum(np.abs(start), 1e-300))
              for start in _starts(empty, known)[:1 if starts == 1 else None]]
    if len(nearly) > starts:
        few = _means(empty)
        rough = sorted((_solve(replace(few, values=each.values, unit=each.unit), ROUGHLY)
                        for each in nearly), key=lambda each: each.chi2)
        nearly = [replace(empty, values=each.values, unit=each.unit)
                  for each in _different(rough)]
    found = [_solve(each) for each in nearly[:starts]]
    best = min(found, key=lambda each: each.chi2)
    alike = [each for each in found if each.chi2 <= best.chi2 * (1 + 1e-6)]
    best = replace(best, optima=len(_different(alike)))
    if loss == "linear":
        return best
    begun = [best]
    if f.size > 2 * free.sum():
        begun += [replace(best, values=start)
                  for start in _starts(empty, known, medians=True)[:starts]]
    robust = [_robust(each, loss) for each in begun]
    return min(robust, key=_loss if best.absolute else _median_scale)


def _means(fit: Fit) -> Fit:
    """The fit of weighted means of neighbouring points, no more than `ENOUGH`: of many points
    their chi^2 tells one start from another as well."""
    if fit.force.size <= ENOUGH:
        return fit
    which = np.empty(fit.force.size, int)
    which[np.argsort(fit.distance, kind="stable")] = np.arange(which.size) * ENOUGH // which.size
    share = (fit.weight / np.max(fit.weight)) ** 2
    total = np.bincount(which, share)
    distance, force = (np.bincount(which, share * each) / total
                       for each in (fit.distance, fit.force))
    return replace(fit, distance=distance, force=force,
                   sd=1 / (np.max(fit.weight) * np.sqrt(total)))


def _different(fits: Sequence[Fit]) -> list[Fit]:
    """Those of which some parameter differs by more than 1 % from all before."""
    kept: list[Fit] = []
    for each in fits:
        if all(np.any(np.abs(each.values - other.values)
                      > 1e-2 * np.maximum(np.abs(other.values), 0.1 * other.unit))
               for other in kept):
            kept.append(each)
    return kept


def _robust(start: Fit, loss: str) -> Fit:
    """The fit of a robust loss that a start leads to."""
    found = replace(start, loss=loss)
    for _ in range(30):  # the threshold and the fit depend on each other
        scale = 1.0 if found.absolute else _median_scale(found)
        threshold = LOSSES[loss].tuning * scale
        if scale == 0 or abs(threshold - found.threshold) <= 1e-6 * found.threshold:
            break
        found = _solve(replace(found, threshold=threshold))
    return found


def _loss(fit: Fit) -> float:
    """The sum that a robust loss makes least, in uncertainties squared."""
    z = (fit.weight * fit.residuals / fit.threshold) ** 2
    return fit.threshold**2 * float(np.sum(LOSSES[fit.loss].rho(z)))


def _starts(problem: Fit, known: Mapping[str, float], medians: bool = False) -> list[Floats]:
    """Starting values, the best first; each with the least-squares amplitude that it may have.

    What is best is judged with any amplitude: one that is known, or has narrow bounds, says which
    size a start of the right shape will grow to, not which shape is right.  With `medians` the
    amplitude, and what is best, are those of medians: half of the points may be anything.
    """
    model, weight = problem.model, problem.weight
    ranked: list[tuple[float, Floats]] = []
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for shape in model.shapes(float(np.max(problem.distance))):
            start = np.array([1.0, *shape])
            start = np.array([known.get(name, value)
                              for name, value in zip(model.names, start, strict=True)])
            inner = 1e-9 * (problem.high - problem.low)
            start = np.where(problem.free,
                             np.clip(start, problem.low + inner, problem.high - inner), start)
            unit = weight * model.force(problem.distance, 1.0, *start[1:])
            amplitude = (np.median(weight * problem.force / unit) if medians else
                         np.sum(unit * weight * problem.force) / np.sum(unit**2))
            amplitude = max(amplitude, 0.0) ** (1 / model.power)
            best = replace(problem, values=_put(start, 0, amplitude))
            miss = _median_scale(best) if medians else best.chi2
            if problem.free[0]:
                margin = min(inner[0], 1e-9 * amplitude) or inner[0]  # forces may be tiny
                start[0] = np.clip(amplitude, problem.low[0] + margin, problem.high[0] - margin)
            made = replace(problem, values=start)
            if np.isfinite([miss, made.chi2]).all() and not any(
                    np.array_equal(start, other) for _, other in ranked):
                ranked.append((miss, start))
    if not ranked:
        raise ValueError(f"{model.formula} is not finite at the measured distances")
    return [start for _, start in sorted(ranked, key=lambda each: each[0])]


def _put(values: Floats, k: Any, value: Any) -> Floats:
    changed = values.copy()
    changed[k] = value
    return changed


def _begun(problem: Fit) -> Fit:
    """As :func:`_solve`, of many points from where their means lead: most of the way for little."""
    few = _means(problem)
    return _solve(problem if few is problem else replace(problem, values=_solve(few).values))


def _solve(problem: Fit, to: float = EXACTLY) -> Fit:
    """The minimum that `problem.values` leads to.

    Where a search ends at its limit, as in the bent gorge of a point that is far more precise than
    the others, there is another one that lets this precision in by degrees.
    """
    found = _search(problem, to)
    weight = problem.weight
    most = 10 * float(np.min(weight))
    if not found.stopped or most >= np.max(weight):
        return found
    eased = found
    while most < np.max(weight):
        eased = _search(replace(eased, sd=1 / np.minimum(weight, most)), to)
        most *= 10
    return min(_search(replace(eased, sd=problem.sd), to), found, key=_loss)


def _search(problem: Fit, to: float) -> Fit:
    """The minimum that one search from `problem.values` leads to.

    Of a linear loss the best amplitude of every shape is known, and only shapes are searched for
    (variable projection, with Kaufman's Jacobian: BIT 15 (1975) 49).  Where one point is far more
    precise than the others chi^2 of both is a bent gorge, along which steps are tiny.
    """
    free, weight = problem.free.copy(), problem.weight
    solved = problem.loss == "linear" and bool(free[0]) and problem.low[0] >= 0
    free[0] &= not solved
    unit = problem.unit[free]

    def whole(x: Floats) -> Floats:
        values = _put(problem.values, free, x)
        return _put(values, 0, _amplitude(problem, values)) if solved else values

    def scales(values: Floats) -> Floats:  # that of a start may be far from the amplitude's
        return _put(problem.unit, 0, values[0]) if solved and values[0] else problem.unit

    def residuals(x: Floats) -> Any:
        if not np.all(np.isfinite(x)):  # SciPy's step from a bound may be; it then takes less
            return np.full(problem.force.size, np.nan)
        return weight * (problem.model.force(problem.distance, *whole(x * unit)) - problem.force)

    def slopes(x: Floats) -> Floats:
        at = replace(problem, values=whole(x * unit))
        columns = at.jacobian
        if solved:
            first, columns = columns[:, 0], columns[:, 1:]
            if problem.low[0] < at.values[0] < problem.high[0]:  # it follows the shape
                first = first / np.linalg.norm(first)
                columns = columns - np.outer(first, first @ columns)
        return columns * unit

    low, high = problem.low[free] / unit, problem.high[free] / unit
    start = np.clip(problem.values[free] / unit, low, high)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if not np.all(np.isfinite(residuals(start))):
            return problem
        if not free.any():
            values = whole(start)
            return replace(problem, values=values, unit=scales(values), stopped=False)
        result = least_squares(residuals, start, slopes, bounds=(low, high), x_scale="jac",
                               loss=problem.loss, f_scale=problem.threshold, ftol=to,
                               xtol=to, gtol=None, max_nfev=LIMIT)
        values = whole(result.x * unit)
        for bound in (problem.low, problem.high):  # the method only comes near them
            close = free & (np.abs(values - bound) <= 1e-9 * problem.unit)
            if close.any():
                there = whole(np.where(close, bound, values)[free])
                if np.all(np.isfinite(problem.model.force(problem.distance, *there))):
                    values = there
    # Where nothing changes chi^2 SciPy goes on, though there is nowhere to go.
    stopped = result.status == 0 and result.optimality > 0
    return replace(problem, values=values, unit=scales(values), stopped=bool(stopped))


def _amplitude(problem: Fit, values: Floats) -> float:
    """The amplitude that it may have which makes chi^2 least for the shape of `values`."""
    one = problem.weight * problem.model.force(problem.distance, *_put(values, 0, 1.0))
    best = (one @ (problem.weight * problem.force)) / (one @ one)  # NaN where forces are no numbers
    return float(np.clip(np.maximum(best, 0.0) ** (1 / problem.model.power),
                         problem.low[0], problem.high[0]))


def _median_scale(fit: Fit) -> float:
    """Scatter of the residuals in uncertainties, from their median: outliers do not count."""
    return float(1.4826 * np.median(np.abs(fit.weight * fit.residuals))
                 * math.sqrt(fit.force.size / fit.dof))


def _spread(fit: Fit) -> float:
    """What the standard errors are scaled by, in uncertainties."""
    if fit.loss == "linear":
        return fit.scale
    _, _, first, second = LOSSES[fit.loss]
    if fit.absolute:  # what residuals of unit scatter would give, not what these do
        res = np.linspace(-10.0, 10.0, 20001)
        z, share = (res / fit.threshold) ** 2, norm.pdf(res) * 1e-3
        return math.sqrt(float(np.sum(share * (res * first(z)) ** 2))) / float(
            np.sum(share * (first(z) + 2 * z * second(z))))
    res = fit.weight * fit.residuals
    z = (res / fit.threshold) ** 2
    n, k = res.size, fit.free.sum()
    slope = first(z) + 2 * z * second(z)
    mean = float(np.mean(slope))
    correction = 1 + k / n * float(np.var(slope)) / mean**2
    return float(correction * math.sqrt(np.sum((res * first(z)) ** 2) / fit.dof) / abs(mean))


# ---------------------------------------------------------------------------------------------
# Intervals.


def interval(fit: Fit, name: str, method: str = "profile", level: float = 0.95,
             number: int = 999, seed: int = 1) -> Interval:
    """Confidence interval of one parameter.

    Parameters
    ----------
    method
        ``"profile"``: the values at which the least chi^2 over the other parameters exceeds
        its minimum by (t scale)^2 (Bates and Watts, Nonlinear Regression, 1988, 6.1); needs
        loss ``"linear"``.  An end that the bounds cut off is the bound.  Where chi^2 has another
        minimum within that, the interval reaches beyond it.  ``"bootstrap"``:
        :func:`bootstrap`.  ``"normal"``: value -+ t standard errors, within the bounds; of
        `Fit.inside` for a parameter that is not at one.  Of a robust loss it is approximate.
    level, number, seed
        Probability, between 0 and 1; number and random seed of the bootstrap.

    Raises
    ------
    ValueError
        An unknown or fixed parameter, an unknown method or a level that is none; a profile or a
        bootstrap of a robust loss.
    """
    _check_name(fit, name)
    return intervals(fit, method, level, number, seed, only=name)[name]


def intervals(fit: Fit, method: str = "profile", level: float = 0.95, number: int = 999,
              seed: int = 1, *, only: str | None = None) -> dict[str, Interval]:
    """Confidence intervals of all free parameters, as :func:`interval`, or of `only` one."""
    if method not in ("profile", "bootstrap", "normal"):
        raise ValueError(f"method must be profile, bootstrap or normal, not {method!r}")
    _check_level(level)
    which = [k for k in np.flatnonzero(fit.free) if only in (None, fit.model.names[k])]
    if method == "bootstrap":
        ends = bootstrap(fit, level, number, seed)
        return {fit.model.names[k]: ends[fit.model.names[k]] for k in which}
    if method == "normal":
        return {fit.model.names[k]: _normal(fit, int(k), level) for k in which}
    if fit.loss != "linear":
        raise ValueError("a profile needs loss linear: a robust loss has no likelihood; "
                         "use normal")
    t, along = fit.quantile(level), _valley(fit)
    minima = _minima(fit, t, along)
    last = np.flatnonzero(fit.free)[-1]
    along = sorted([*along, *minima], key=lambda values: float(values[last]))
    return {fit.model.names[k]: (_profile(fit, int(k), t, -1, along, minima),
                                 _profile(fit, int(k), t, +1, along, minima)) for k in which}


def _check_name(fit: Fit, name: str) -> None:
    if name not in fit.model.names or not fit.free[fit.model.names.index(name)]:
        raise ValueError(f"{name} is not a free parameter of this fit")


def _check_level(level: float) -> None:
    if not 0 < level < 1:
        raise ValueError(f"level must be between 0 and 1, not {level}")


def _normal(fit: Fit, k: int, level: float) -> Interval:
    one = fit if fit.at_bound[k] else fit.inside
    half = one.quantile(level) * one.errors[k]
    low, high = np.clip(fit.values[k] + np.array([-half, half]), fit.low[k], fit.high[k])
    return float(low), float(high)


def profile(fit: Fit, name: str, value: float) -> float:
    """The least chi^2 over the other free parameters with one of them held at `value`.

    Raises
    ------
    ValueError
        An unknown or fixed parameter, or a value beyond its bounds.
    """
    _check_name(fit, name)
    k = fit.model.names.index(name)
    if not fit.low[k] <= value <= fit.high[k]:
        raise ValueError(f"{name} must be from {fit.low[k]:g} to {fit.high[k]:g}, not {value:g}")
    return _held(fit, k, value, _valley(fit)).chi2


def _valley(fit: Fit) -> list[Floats]:
    """Values along the valley of chi^2, in the order of the last free parameter; see :func:`_held`.

    None with less than two free shapes, of which a profile leaves one to find.  They are starts:
    of many points the valley of their means does as well.
    """
    which = np.flatnonzero(fit.free)
    if which.size - fit.free[0] < 2:
        return []
    k = which[-1]
    places = np.geomspace(max(fit.low[k], 1e-3 * fit.high[k]), fit.high[k], VALLEY)
    found = [fit.values]
    for side in (places[places > fit.values[k]], places[places < fit.values[k]][::-1]):
        last = _means(fit)
        for place in side:
            last = _solve(replace(last, values=_put(last.values, k, place),
                                  free=fit.free & (np.arange(fit.free.size) != k)))
            found.append(last.values)
    return sorted(found, key=lambda values: float(values[k]))


def _minima(fit: Fit, t: float, along: Sequence[Floats]) -> list[Floats]:
    """Minima of chi^2 that its valley leads to, of those within the threshold of a profile."""
    few = _means(fit)
    found = [_solve(replace(few, values=values)) for values in along]
    if few is not fit:
        found = [_solve(replace(fit, values=each.values)) for each in _different(found)]
    return [each.values for each in found if each.chi2 - fit.chi2 < (t * fit.scale) ** 2]


def _held(fit: Fit, k: int, value: float, along: Sequence[Floats]) -> Fit:
    """The best fit with parameter k held at `value`, whatever was looked at before.

    Its starts are where the valley has that value, or comes nearest to it: of exact magnets a
    strong and small one pulls almost as a weak and large one does, and with their polarisation held
    chi^2 has two minima, flat and wide or long and slim.
    """
    others = fit.free & (np.arange(fit.free.size) != k)
    starts = [a + (b - a) * (value - a[k]) / (b[k] - a[k]) for a, b in pairwise(along)
              if (a[k] - value) * (b[k] - value) <= 0 and a[k] != b[k]]
    starts = starts or [min([fit.values, *along], key=lambda each: abs(float(each[k]) - value))]
    held = [replace(fit, values=_put(start, k, value), free=others) for start in starts]
    if others.any():
        held = [_begun(each) for each in held]
    return min(held, key=lambda each: each.chi2 if np.isfinite(each.chi2) else math.inf)


def _profile(fit: Fit, k: int, t: float, side: int, along: Sequence[Floats],
             minima: Sequence[Floats]) -> float:
    """Where the profile of parameter k passes its threshold; the bound if it does not before.

    Beyond the last of the other `minima`: between two of them it may pass it and come back.
    Nor does it where it passes because another parameter has come to where the search for it ends:
    the data alone would let both go on.  (What magnets cannot be is another matter.)
    """
    limit = fit.low[k] if side < 0 else fit.high[k]
    allowed = (t * fit.scale) ** 2
    if allowed <= fit.rounding:
        return float(fit.values[k])

    def excess(value: float) -> float:
        with np.errstate(divide="ignore"):
            above = _held(fit, k, value, along).chi2 - fit.chi2
        if not np.isfinite(above):  # no force there, as at r + beta = 0
            return 1e3
        return math.sqrt(max(above, 0.0) / allowed) - 1

    error = fit.errors[k]
    step = t * (error if np.isfinite(error) and error > 0 else 0.1 * fit.unit[k])
    inner = outer = side * max(side * float(values[k]) for values in (fit.values, *minima))
    for _ in range(60):
        outer = inner + side * step
        outer = max(outer, limit) if side < 0 else min(outer, limit)
        if excess(outer) > 0:
            break
        if outer == limit:
            return float(limit)
        inner, step = outer, 1.6 * step
    else:
        return float(limit)
    end = float(brentq(excess, inner, outer, xtol=1e-7 * abs(outer - inner), rtol=1e-7))
    last = _held(fit, k, end, along)
    top = np.array([p.high if p.name in SEARCHED else np.inf for p in fit.model.parameters])
    stopped = (last.at_bound > 0) & (fit.at_bound <= 0) & (last.high == top)
    return float(limit) if stopped.any() else end


def bootstrap(fit: Fit, level: float = 0.95, number: int = 999,
              seed: int = 1) -> dict[str, Interval]:
    """Intervals of all free parameters by a bootstrap.

    Studentised, of the residuals: over sqrt(1 - leverage), centred, they are drawn again for every
    point, in units of its uncertainty (Davison and Hinkley, Bootstrap Methods, 1997, 6.2 and 7.3).
    Where the uncertainties are taken at their word, points are drawn from normal distributions of
    those, and errors are what they are.

    Raises
    ------
    ValueError
        A robust loss: an outlier that is drawn again is no outlier any more, as the scatter that it
        is judged by is that of the points as they are.  And where a parameter is at its bound: the
        estimates of resampled points pile up there.  A level that is none, or nothing drawn.
    """
    _check_level(level)
    if number < 1:
        raise ValueError(f"number must be at least 1, not {number}")
    if fit.loss != "linear":
        raise ValueError("a bootstrap needs loss linear: it would draw the outliers again, for any "
                         "point; use normal")
    for name, end in zip(fit.model.names, fit.at_bound, strict=True):
        if end:
            raise ValueError(f"{name} is at its bound, where the bootstrap says nothing; "
                             "use profile or normal")
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(fit.jacobian * fit.unit[fit.free])
    drawn = fit.weight * fit.residuals / np.sqrt(np.maximum(1 - np.sum(q**2, axis=1), 1e-12))
    drawn -= drawn.mean()
    mean, use = fit.predict(fit.distance), fit.free
    value, error = fit.values[use], fit.errors[use]
    pivots = []
    for _ in range(number):
        noise = rng.standard_normal(drawn.size) if fit.absolute else rng.choice(drawn, drawn.size)
        again = _solve(replace(fit, force=mean + noise / fit.weight))
        spread = error if fit.absolute else again.errors[use]
        with np.errstate(divide="ignore", invalid="ignore"):
            pivots.append((again.values[use] - value) / spread)
    ends = np.nanquantile(pivots, [0.5 + 0.5 * level, 0.5 - 0.5 * level], axis=0)
    low, high = np.clip(value - ends * error, fit.low[use], fit.high[use])
    names = [name for name, free in zip(fit.model.names, use, strict=True) if free]
    return {name: (float(low[k]), float(high[k])) for k, name in enumerate(names)}


# ---------------------------------------------------------------------------------------------
# How good a fit is.


class Runs(NamedTuple):
    """Runs of residuals of one sign, in the order of the distances."""

    runs: int
    expected: float
    p_value: float


def runs_test(residuals: ArrayLike) -> Runs:
    """How often independent residuals would have as few runs of one sign, or fewer.

    The exact distribution, given the numbers of either sign (Wald and Wolfowitz 1940); zeros are
    left out.  `residuals` are in the order of the distances.  Those of a fit change sign more often
    than independent ones, as the curve goes through the points: of them the test is conservative,
    few runs being rarer than `p_value` says.

    Raises
    ------
    ValueError
        Where one is no number.
    """
    signs = np.sign(np.asarray(residuals, float))
    if np.isnan(signs).any():
        raise ValueError("residuals must be numbers")
    signs = signs[signs != 0]
    a, b = int(np.sum(signs > 0)), int(np.sum(signs < 0))
    if a == 0 or b == 0:
        return Runs(int(signs.size > 0), float(signs.size > 0), 1.0)
    runs = 1 + int(np.sum(signs[1:] != signs[:-1]))

    r = np.arange(2, runs + 1)
    half = r // 2
    total = _log_choose(a + b, a)

    def share(k: Any, m: Any) -> Any:
        """Orders in k + 1 blocks of the one sign and m + 1 of the other, of all orders."""
        return np.exp(_log_choose(a - 1, k) + _log_choose(b - 1, m) - total)

    few = np.where(r % 2, share(half, half - 1) + share(half - 1, half),
                   2 * share(half - 1, half - 1))
    return Runs(runs, 1 + 2 * a * b / (a + b), min(1.0, float(np.sum(few))))


def runs(fit: Fit) -> Runs:
    """The runs test of a fit's residuals, of repeats at one distance of their weighted mean.

    The order of repeats means nothing, least of all that of a file that is sorted by force.
    """
    which = np.unique(fit.distance, return_inverse=True)[1]
    residuals = fit.residuals if fit.chi2 > fit.rounding else np.zeros_like(fit.force)
    return runs_test(np.bincount(which, fit.weight**2 * residuals))  # the signs of the means


def _log_choose(n: int, k: Any) -> Any:
    """log of n over k; -inf where k > n."""
    return gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)


class Halves(NamedTuple):
    """The same model fitted to the near and to the far half of the points."""

    near: Fit
    far: Fit
    p_value: float  # how often one law for both would seem as wrong by chance


def halves(fit: Fit) -> Halves | None:
    """Whether one set of parameters does for all distances: Chow's test.

    Of absolute uncertainties by chi^2, else by F.
    Points at one distance are in one half.  None where a half would have no more distances than
    parameters, and for a robust loss.
    """
    k = int(fit.free.sum())
    sides = np.array_split(np.unique(fit.distance), 2)
    if fit.loss != "linear" or min(map(len, sides)) <= k:
        return None
    parts = [np.isin(fit.distance, side) for side in sides]
    near, far = (_solve(replace(fit, distance=fit.distance[part], force=fit.force[part],
                                sd=None if fit.sd is None else fit.sd[part])) for part in parts)
    rest = near.dof + far.dof
    both = max(near.chi2 + far.chi2, fit.rounding, 1e-300)
    gain = max(fit.chi2 - both, 0.0)
    p = (chi2_distribution.sf(gain, k) if fit.absolute
         else f_distribution.sf((gain / k) / (both / rest), k, rest))
    return Halves(near, far, float(p))


def doubts(fit: Fit, intervals: Mapping[str, Interval]) -> list[str]:
    """What speaks against taking the parameters at their word: one sentence each."""
    found = []
    if fit.stopped:
        found.append(f"the search ended at its limit of {LIMIT} evaluations: other parameters may "
                     "fit better")
    if fit.optima > 1:
        found.append(f"{fit.optima} different sets of parameters fit equally well")
    inside, at_bound = fit.inside, fit.at_bound
    for k, (name, unit, least, most) in enumerate(fit.model.parameters):
        if not fit.free[k]:
            continue
        value, error = fit.values[k], inside.errors[k]
        low, high = intervals.get(name, (value, value))
        # Bounds narrower than the model's own limits were given, whatever the data say.
        above, below = high >= max(fit.high[k], most), low <= min(fit.low[k], least)
        lost = above or (k == 0 and below)
        if at_bound[k]:
            end = "lower" if at_bound[k] < 0 else "upper"
            limit = f"{value:g} {unit}".rstrip()
            found.append(f"{name} is at its {end} bound, {limit}, and has no standard error"
                         + (f"; those of the others are for {name} held there"
                            if inside.free.any() else ""))
            lost = above and below
        if not np.isfinite(error) or lost:
            found.append(f"{name} is not identified: these data do not bound it")
        elif error > 0.5 * abs(value):
            found.append(f"{name} is weakly identified: its standard error is "
                         f"{100 * error / abs(value):.0f} % of it")
    return found


def weights(criteria: Sequence[float]) -> list[float]:
    """Akaike weights of models from their criteria; NaN has none."""
    values = np.asarray(criteria, float)
    likelihood = np.exp(-0.5 * (values - np.nanmin(values)))
    return [float(w) for w in np.nan_to_num(likelihood / np.nansum(likelihood))]
