"""The command ``tbsa fit``: a magnet model fitted to measurements, as text, picture and scene.

The fit itself is :mod:`theory.fit`; here are units, files and words.
"""

from __future__ import annotations

import io
import math
import re
from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from tbsa.errors import InputError
from tbsa.model.scene import Magnet, Scene, load, parse
from tbsa.work.measurements import LEAST, LENGTHS, Measurements, must_fall, quantity
from theory import fit as fitting
from theory.fit import Fit, Interval, Model
from theory.magnets import Law, fade

EXACT = ("cylinder", "cuboid")
LAW = fitting.models()["law"]  # of the distance between the magnets' centres
ROUNDING = 1e-9  # of a distance
WIDEST = 10.0  # m, the largest material.width of a scene


class Result(NamedTuple):
    """What :func:`fit` finds: one model in full, and all of them for comparison."""

    measured: Measurements  # the points in range
    of: int  # points in the file
    kind: str  # "gap" | "centre"
    inset: float | None  # m; None where distances are between centres and it was not given
    main: Fit
    method: str
    intervals: Mapping[str, Interval]
    others: Mapping[str, Fit | str]  # all models by name; a text says why there is no fit


def fit(
    measured: Measurements,
    model: str = "law",
    *,
    distance: str | None = None,
    inset: str | None = None,
    within: str | None = None,
    fixed: Sequence[str] = (),
    bounds: Sequence[str] = (),
    loss: str = "linear",
    absolute: bool = False,
    unweighted: bool = False,
    method: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Result:
    """Fit a model to measurements, and the others for comparison.

    Lengths and bounds are given as on the command line, as text with a unit.

    Parameters
    ----------
    measured
        From :func:`tbsa.work.measurements.read`.
    model
        ``"law"``, ``"power"``, ``"cylinder"`` or ``"cuboid"``.
    distance
        ``"gap"`` or ``"centre"``, needed where the header has just ``distance``.
    inset
        How deep the magnets' centres lie behind the surfaces that a gap is measured between,
        e.g. ``"1.5mm"``; needed for a gap.  Without it a scene keeps its own.
    within
        Distances to use, e.g. ``"0.5cm:2cm"``; either end may be left out.
    fixed, bounds
        ``"height=5mm"``, ``"beta=0:2cm"``; they hold for every model with that parameter.
    loss, absolute
        As :func:`theory.fit.fit`.
    unweighted
        Leave the uncertainties out.
    method
        Of the intervals, as :func:`theory.fit.interval`; by default ``"profile"``, and
        ``"normal"`` for a robust loss.
    progress
        Called with the number of fits done and of all; the intervals count as one.

    Raises
    ------
    InputError
        For a value that is not allowed, or a model that cannot be fitted.
    """
    file = measured.file
    for field, value, allowed in (("--model", model, tuple(fitting.models())),
                                  ("--loss", loss, tuple(fitting.LOSSES))):
        if value not in allowed:
            raise InputError(f"must be one of {', '.join(allowed)}", field=field, value=value)
    if distance is not None and measured.kind not in ("distance", distance):
        raise InputError(f"must be {measured.kind}, as the header of {file} says",
                         field="--distance", value=distance)
    kind = distance or measured.kind
    if kind == "distance":
        raise InputError("is missing; must be gap (between the surfaces) or centre (between the "
                         f"magnets' centres): the header of {file} leaves it open",
                         field="--distance")
    if inset is None and kind == "gap":
        raise InputError("is missing; must be how deep the magnets' centres lie behind the "
                         "surfaces that the gap is measured between, for example 1.5mm; 0mm fits "
                         "the gap itself", field="--inset")
    depth = None if inset is None else quantity(inset, "m", "--inset")
    if depth is not None and not 0 <= depth <= 10:
        raise InputError("must be a length from 0 to 10 m", field="--inset", value=inset)
    if absolute and (unweighted or measured.sd is None):
        raise InputError("must be left out where no uncertainties are used",
                         field="--absolute")
    if unweighted:
        measured = measured._replace(sd=None)
    of = measured.distance.size
    if within is not None:
        measured = _within(measured, within)
    must_fall(measured)
    nearest = math.inf if kind == "gap" else float(measured.distance.min())
    made = fitting.models(kind, depth or 0.0, nearest)
    known, limits = _settings(fixed, bounds, made)

    def one(each: Model) -> Fit:
        return fitting.fit(
            each, measured.distance, measured.force, measured.sd,
            fixed={name: value for name, value in known.items() if name in each.names},
            bounds={name: value for name, value in limits.items() if name in each.names},
            loss=loss, absolute=absolute)

    def note(done: int) -> None:
        if progress is not None:
            progress(done, len(made) + 1)

    note(0)
    try:
        main = one(made[model])
    except ValueError as error:
        raise InputError(f"cannot be fitted: {error}", file=file, field="--model",
                         value=model) from None
    note(1)
    method = method or ("profile" if loss == "linear" else "normal")
    try:
        intervals = fitting.intervals(main, method)
    except ValueError as error:
        raise InputError(f"cannot be had: {error}", field="--interval", value=method) from None
    note(2)
    others: dict[str, Fit | str] = {model: main}
    for name, each in made.items():
        if name == model:
            continue
        try:
            others[name] = one(each)
        except ValueError as error:
            others[name] = str(error)
        note(1 + len(others))
    others = {name: others[name] for name in made}
    return Result(measured, of, kind, depth, main, method, intervals, others)


def _within(measured: Measurements, within: str) -> Measurements:
    """The points in a range of distances."""
    low, colon, high = within.partition(":")
    if not colon:
        raise InputError("must be two distances, LOW:HIGH, of which one may be left out, for "
                         "example 0.5cm:2cm or 5mm:", field="--range", value=within)
    a = quantity(low, "m", "--range") if low.strip() else -math.inf
    b = quantity(high, "m", "--range") if high.strip() else math.inf
    # 7mm and 0.7cm are the same distance, though not to the last bit.
    a, b = a - ROUNDING * abs(a), b + ROUNDING * abs(b)
    use = (measured.distance >= a) & (measured.distance <= b)
    if np.unique(measured.distance[use]).size < LEAST:
        far, scale = measured.distance.max(), LENGTHS[measured.unit]
        raise InputError(
            f"leaves {use.sum()} of {use.size} points; must leave at least {LEAST}, at as many "
            f"distances, of {measured.distance.min() / scale:g} to {far / scale:g} "
            f"{measured.unit}", field="--range", value=within)
    return measured._replace(distance=measured.distance[use], force=measured.force[use],
                             sd=None if measured.sd is None else measured.sd[use])


def _settings(
    fixed: Sequence[str], bounds: Sequence[str], made: Mapping[str, Model]
) -> tuple[dict[str, float], dict[str, tuple[float | None, float | None]]]:
    """Fixed values and bounds by the parameter's name, SI."""
    every = {p.name: p for model in made.values() for p in model.parameters}
    known: dict[str, float] = {}
    limits: dict[str, tuple[float | None, float | None]] = {}
    for option, texts in (("--fix", fixed), ("--bound", bounds)):
        for text in texts:
            name, sign, rest = (part.strip() for part in text.partition("="))
            if not sign or name not in every:
                form = "NAME=VALUE" if option == "--fix" else "NAME=LOW:HIGH"
                raise InputError(f"must be {form}, the name one of {', '.join(every)}",
                                 field=option, value=text)
            if name in known or name in limits:
                raise InputError(f"must be the only --fix or --bound of {name}", field=option,
                                 value=text)
            parameter = every[name]
            parts = [rest] if option == "--fix" else rest.split(":")
            if option == "--bound" and len(parts) != 2:
                raise InputError("must be NAME=LOW:HIGH, of which one may be left out",
                                 field=option, value=text)
            numbers = [quantity(part, parameter.unit, f"{option} {name}") if part.strip()
                       or option == "--fix" else None for part in parts]
            if numbers == [0.0] and name in {model.names[0] for model in made.values()}:
                raise InputError("must be above 0, or there is no force", field=option, value=text)
            for number in numbers:
                if number is not None and not parameter.low <= number <= parameter.high:
                    raise InputError(f"must be from {parameter.low:g} to {parameter.high:g} "
                                     f"{parameter.unit}".rstrip(), field=option, value=text)
            if option == "--fix":
                assert numbers[0] is not None
                known[name] = numbers[0]
            else:
                low, high = numbers
                least = parameter.low if low is None else low
                if not least < (parameter.high if high is None else high):
                    raise InputError("must be in rising order, LOW:HIGH", field=option, value=text)
                limits[name] = (low, high)
    return known, limits


# ---------------------------------------------------------------------------------------------
# Words.


def describe(result: Result) -> str:
    """The fit in words and numbers; lengths in the unit of the file."""
    main, measured = result.main, result.measured
    unit, size = measured.unit, LENGTHS[measured.unit]
    near, far = (float(end) / size for end in (measured.distance.min(), measured.distance.max()))
    count = f"{main.force.size} points" if main.force.size == result.of else (
        f"{main.force.size} of {result.of} points")
    if result.inset is not None and result.kind == "gap":
        where = f"r = gap + 2 x {1e3 * result.inset:g} mm between the magnets' centres"
        if main.model.name in EXACT:
            where = "faces flush with the surfaces: centre distance = gap + height"
    else:
        where = "r between the magnets' centres, as measured"
    kind = {"gap": "gap", "centre": "centre distance"}[result.kind]
    weighted = "not weighted" if main.sd is None else "weighted by 1/sd^2"
    inside = main.inside
    scaled = ("sd taken at its word" if main.absolute
              else f"errors from the scatter, {inside.scale:.3g} "
                   f"{'N' if main.sd is None else 'sd'}")
    correlation = inside.correlation[np.triu_indices(int(inside.free.sum()), 1)]
    lines = [
        f"{measured.file}: {count}, {kind} {near:.4g} to {far:.4g} {unit}",
        where,
        "",
        f"F = {main.model.formula}" if main.model.name not in EXACT else main.model.formula,
        *_indent(_table(["", "value", "error", "95 %", "unit"], _values(result))),
        f"  {weighted}, {main.loss} loss, {result.method} intervals; {scaled}",
        *(["  intervals of a robust loss are approximate: with two outliers among twelve points "
           "some 70 to 95 % hold the truth"] if main.loss != "linear" else []),
        *([f"  correlation {', '.join(f'{c:.3f}' for c in correlation)}"]
          if correlation.size and np.isfinite(correlation).all() else []),
        "",
        *_goodness(result),
        "",
        *_comparison(result),
    ]
    warnings = fitting.doubts(main, result.intervals) + _local(result)
    return "\n".join([*lines, *([""] if warnings else []), *(f"warning: {w}" for w in warnings)])


def _shown(parameter: str, unit: str) -> tuple[str, float]:
    """The unit in which a parameter is printed, given the file's unit of length, and its size."""
    if parameter == "N m^2":
        return ("N m^2" if unit == "m" else f"N {unit}^2"), LENGTHS[unit] ** 2
    return (unit, LENGTHS[unit]) if parameter == "m" else (parameter, 1.0)


def _values(result: Result) -> list[list[str]]:
    """Rows of the main fit's parameters."""
    rows, main, inside = [], result.main, result.main.inside
    for k, parameter in enumerate(main.model.parameters):
        unit, size = _shown(parameter.unit, result.measured.unit)
        value, error = main.values[k] / size, inside.errors[k] / size
        if main.free[k]:
            low, high = (end / size for end in result.intervals[parameter.name])
            shown = _rounded(error, error) if inside.free[k] else "at bound"
            error = error if inside.free[k] else 0.25 * (high - low)  # as many digits of the ends
            rows.append([parameter.name, _rounded(value, error), shown,
                         f"{_rounded(low, error)} to {_rounded(high, error)}", unit])
        else:
            rows.append([parameter.name, f"{value:g}", "fixed", "", unit])
    return rows


def _rounded(value: float, error: float) -> str:
    """A value to two digits of its error, and to 2 to 9 of its own, whatever the unit."""
    if not (math.isfinite(error) and error > 0):
        return f"{value:.3g}"
    sizes = [size for size in (abs(value), error) if size >= 0.01 * error]
    digits = 1 - math.floor(math.log10(min(sizes)))
    if value == 0:
        return f"{value:.{digits if 0 < digits <= 6 else 0}f}"
    leading = math.floor(math.log10(abs(value)))
    digits = min(digits, 8 - leading)
    if digits > 6 and leading < -4:  # a long row of zeros
        return f"{value:.{max(digits + leading, 1)}e}"
    return f"{round(value, digits):.{max(digits, 0)}f}"


def _goodness(result: Result) -> list[str]:
    """Chi^2, runs, and the halves."""
    main = result.main
    runs, distances = fitting.runs(main), np.unique(main.distance).size
    worst = int(np.argmax(np.abs(main.weight * main.residuals)))
    unit, size = result.measured.unit, LENGTHS[result.measured.unit]
    rms = math.sqrt(float(np.mean(main.residuals**2)))
    lines = [f"rms residual {rms:.3g} N; largest {main.residuals[worst]:+.3g} N"
             + (f" ({(main.weight * main.residuals)[worst]:+.1f} sd)" if main.sd is not None
                else "") + f" at {result.measured.distance[worst] / size:.4g} {unit}"]
    if main.sd is not None:
        lines.append(f"chi2/dof {main.chi2 / main.dof:.3g} with {main.dof} degrees of freedom "
                     f"({_probability(main.p_value)})")
    means = f", of means at {distances} distances" if distances < main.force.size else ""
    lines.append(f"runs of one sign{means}: {runs.runs}, by chance {runs.expected:.1f} "
                 f"({_probability(runs.p_value)}; conservative, as a fit adds runs)")
    both = fitting.halves(main)
    if both is not None:
        rows = []
        for name, half in (("all", main), ("near half", both.near), ("far half", both.far)):
            d = half.distance / size
            row = [name, f"{d.min():.4g} to {d.max():.4g} {unit}"]
            for k in np.flatnonzero(main.free):
                part = _shown(main.model.parameters[k].unit, unit)[1]
                error = half.inside.errors[k] / part
                row.append(f"{_rounded(half.values[k] / part, error)} "
                           + ("at bound" if half.at_bound[k] else f"± {_rounded(error, error)}"))
            rows.append(row)
        names = [name for name, free in zip(main.model.names, main.free, strict=True) if free]
        lines += ["", "by range", *_indent(_table(["", result.kind, *names], rows)),
                  "  one set of parameters for both halves: "
                  f"{_probability(both.p_value)} (Chow's test)"]
    return lines


def _comparison(result: Result) -> list[str]:
    """Models against each other."""
    fits = {name: each for name, each in result.others.items() if isinstance(each, Fit)}
    criteria = {name: each.aicc for name, each in fits.items()}
    finite = {name: c for name, c in criteria.items() if math.isfinite(c)}
    share = dict(zip(finite, fitting.weights(list(finite.values())), strict=True)) if finite else {}
    least = min(finite.values(), default=math.nan)
    rows, notes = [], []
    for name, each in result.others.items():
        if isinstance(each, str):
            notes.append(f"  {name}: not fitted, {each}")
            continue
        values = []
        for k, parameter in enumerate(each.model.parameters):
            unit, size = _shown(parameter.unit, result.measured.unit)
            values.append(f"{parameter.name} {each.values[k] / size:.4g} {unit}".rstrip()
                          + " (at bound)" * bool(each.at_bound[k]))
        known = name in finite
        rows.append([name, f"{math.sqrt(float(np.mean(each.residuals**2))):.3g}",
                     f"{each.chi2 / each.dof:.3g}" if each.sd is not None else "-",
                     f"{finite[name] - least:.1f}" if known else "-",
                     f"{share[name]:.3f}" if known else "-", ", ".join(values)])
    head = ["model", "rms (N)", "chi2/dof", "dAICc", "weight", "parameters"]
    return ["models", *_indent(_table(head, rows)), *notes]


def _local(result: Result) -> list[str]:
    """What the goodness of fit says against the model."""
    main, found = result.main, []
    runs, both = fitting.runs(main), fitting.halves(main)
    # Of a robust fit outliers do not count; the median of normal ones has an error of 1.17/sqrt(n).
    if main.sd is not None and (
            main.p_value < 0.01 if main.loss == "linear"
            else main.scatter > 1.0 + 2.33 * 1.17 / math.sqrt(main.force.size)):
        found.append(f"the curve misses the points by {main.scatter:.3g} times their uncertainty")
    if main.absolute and main.p_value > 0.99:
        found.append("the points lie nearer to the curve than their uncertainties let expect, by "
                     f"{math.sqrt(main.chi2 / main.dof):.3g} of these: they are too large, and so "
                     "are the errors; leave --absolute out")
    if runs.p_value < 0.05:
        found.append("the residuals have a pattern: the curve has another shape than the "
                     "measured force")
    if both is not None and both.p_value < 0.05:
        found.append(f"the {main.model.name} model is local: near and far halves ask for different "
                     "parameters; fit the range of use (--range)")
    if main.loss == "linear":
        # Where a rival's search had to end at a bound, its points speak for no such magnet.
        rivals = {name: each.aicc for name, each in result.others.items()
                  if isinstance(each, Fit) and math.isfinite(each.aicc)
                  and (each is main or not each.at_bound.any())}
        best = min(rivals, key=lambda name: rivals[name], default=main.model.name)
        if main.model.name in rivals and rivals[main.model.name] - rivals[best] > 10:
            found.append(f"the {best} model describes these points far better "
                         f"(AICc lower by {rivals[main.model.name] - rivals[best]:.1f})")
    return found


def _probability(p: float) -> str:
    return "p < 1e-300" if p < 1e-300 else f"p = {p:.2g}"


def _indent(lines: Iterable[str]) -> list[str]:
    return ["  " + line for line in lines]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Plain text: the first and the last column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    last = len(head) - 1
    return ["  ".join(cell.ljust(width) if k in (0, last) else cell.rjust(width)
                      for k, (cell, width) in enumerate(zip(row, widths, strict=True))).rstrip()
            for row in (head, *rows)]


# ---------------------------------------------------------------------------------------------
# A picture.

LOOK: Any = {"font.size": 9, "legend.frameon": False, "lines.linewidth": 1.4,
                        "axes.spines.top": False, "axes.spines.right": False}
COLOURS = {"law": "#0b5fa5", "power": "#d9730d", "cylinder": "#5b8c2a", "cuboid": "#8a4a9e"}
DASHES = {"law": "-", "power": "--", "cylinder": "-.", "cuboid": ":"}


def picture(result: Result) -> bytes:
    """Points, the fitted curves and the residuals, as PNG."""
    main, measured = result.main, result.measured
    size = LENGTHS[measured.unit]
    d = np.linspace(measured.distance.min(), measured.distance.max(), 300)
    with matplotlib.rc_context(LOOK):
        figure = Figure(figsize=(5.5, 5.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        top.errorbar(measured.distance / size, measured.force, measured.sd, fmt="o", ms=3.5,
                     color="#202020", capsize=2, lw=1, zorder=3, label="measured")
        for name, each in result.others.items():
            if isinstance(each, Fit):
                alone = name == main.model.name
                top.plot(d / size, each.predict(d), DASHES[name], color=COLOURS[name], label=name,
                         lw=1.6 if alone else 0.9, zorder=2 if alone else 1)
        top.set(ylabel="force (N)", ylim=(0 if measured.force.min() >= 0 else None, None))
        top.legend()
        residuals = main.residuals * main.weight
        bars = None if main.sd is None else np.ones_like(residuals)
        bottom.axhline(0, color="#7a7a7a", lw=0.8)
        bottom.errorbar(measured.distance / size, residuals, bars, fmt="o", ms=3.5, capsize=2,
                        lw=1, color=COLOURS[main.model.name])
        kind = {"gap": "gap", "centre": "distance of the centres"}[result.kind]
        bottom.set(xlabel=f"{kind} ({measured.unit})",
                   ylabel=f"residual of {main.model.name} ({'N' if bars is None else 'sd'})")
        figure.align_ylabels()
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=200)
    return buffer.getvalue()


# ---------------------------------------------------------------------------------------------
# The scene's section.


def section(result: Result) -> str:
    """The ``[magnet]`` section of a fitted law, as a scene reads it.

    Raises
    ------
    InputError
        Where a scene would not take the values, or the model is not the law.
    """
    text = "\n".join(["[magnet]", *_lines(result).values()]) + "\n"
    inset = result.inset or 0.0
    if not inset < 0.5 * WIDEST:
        raise InputError(f"must be below {0.5 * WIDEST:g} m, half the width of a scene's widest "
                         "tile", field="--inset", value=f"{inset:g} m")
    width = min(max(0.03, 4 * inset), WIDEST)
    # A strong magnet asks a scene for a short step, which is not the fit's to choose.
    parse(f'[tiles]\nset = "chessboard"\n[material]\nwidth = {width!r}\nmass = {20 * width**2!r}\n'
          f'[[free.tile]]\ntype = "black"\nposition = [0.0, 0.0]\n[solver]\nstep = 1e-7\n{text}')
    return text


def is_section(path: Path) -> bool:
    """Whether a file is there and is, as it stands, a section that a fit has written."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False
    return re.fullmatch(r"\[magnet\]\nalpha = \S+  # N m\^2; .+\nbeta = \S+  # m; .+\n"
                        r"(inset = \S+  # m\n)?", text) is not None


def fading(result: Result, scene: Scene | None = None) -> str:
    """What a scene's cut-off, or the default one, takes from the fitted law where tiles are bonded.

    A scene's force fades out over the last part of its cut-off: one sentence where bonded magnets
    are that far apart, and an empty text where they feel the fitted force.
    """
    magnet = (scene.magnet if scene is not None else None) or Magnet()
    contact = 2 * (magnet.inset if result.inset is None else result.inset)
    left = fade(contact, Law(cutoff=magnet.cutoff, switch=magnet.switch))
    if left in (0.0, 1.0):  # without any force a scene is refused
        return ""
    force = float(LAW.force(np.array(contact), *result.main.values))
    return (f"bonded magnets, {1e3 * contact:g} mm apart, pull with {left * force:.4g} N, "
            f"{100 * (1 - left):.2g} % less than the fitted {force:.4g} N: forces fade out in the "
            f"last {magnet.switch:g} of magnet.cutoff = {1e3 * magnet.cutoff:g} mm; make it longer")


def _lines(result: Result) -> dict[str, str]:
    """The lines of the section that the fit knows."""
    main, size = result.main, LENGTHS[result.measured.unit]
    if main.model.name != "law":
        raise InputError("must be law, the one force that a scene has", field="--model",
                         value=main.model.name)
    near, far = (float(end) / size for end in (main.distance.min(), main.distance.max()))
    error = ["at its bound" if bound else f"+- {e:.2g}" if free else "fixed" for e, free, bound
             in zip(main.inside.errors, main.free, main.at_bound, strict=True)]
    span = f"{result.kind} {near:.4g} to {far:.4g} {result.measured.unit}"
    alpha, beta = (float(f"{value:.6g}") for value in main.values)
    lines = {"alpha": f"alpha = {alpha!r}  # N m^2; {error[0]}, fitted over {span}",
             "beta": f"beta = {beta!r}  # m; {error[1]}"}
    if result.inset is not None:
        lines["inset"] = f"inset = {float(f'{result.inset:.6g}')!r}  # m"
    return lines


def into(path: Path, result: Result) -> bytes:
    """A scene's file with alpha and beta of its ``[magnet]`` section replaced by the fit's, and
    inset, if the fit has one.

    Every other line stays as it is, to its ending; a scene without the section gets one at its
    end.

    Raises
    ------
    InputError
        Where the file is not a scene, or would not be one with these values.
    """
    new = _lines(result)
    before = load(path)
    data = path.read_bytes()
    mark = BOM_UTF8 if data.startswith(BOM_UTF8) else b""
    text = data.removeprefix(mark).decode()
    lines = text.split("\n")
    plain = _without_strings(text).split("\n")
    heads = [k for k, line in enumerate(plain) if re.match(r"\s*\[", line)]
    start = next((k for k in heads if re.match(r"\s*\[\s*magnet\s*\]", plain[k])), None)
    wrong = InputError("must be a table of its own, [magnet], to be replaced by the fit",
                       file=str(path), field="magnet")

    def ended(added: Iterable[str], like: str) -> list[str]:
        return [line + "\r" * like.endswith("\r") for line in added]

    if start is None:
        if before.magnet is not None:
            raise wrong
        if not lines[-1]:
            del lines[-1]
        elif lines[0].endswith("\r"):
            lines[-1] += "\r"
        lines += [*ended(["", "[magnet]", *new.values()], lines[0]), ""]
    else:
        end = next((k for k in heads if k > start), len(lines))
        missing = dict(new)
        for k in range(start + 1, end):
            key = plain[k].partition("=")[0].strip().strip("\"'")
            if key in missing:
                lines[k:k + 1] = ended([missing.pop(key)], lines[k])
        if start == len(lines) - 1 and missing:  # the head ends the file, without a newline
            lines.append("")
        lines[start + 1:start + 1] = ended(missing.values(), lines[start])
    made = "\n".join(lines)
    after = parse(made, str(path))
    values: dict[str, Any] = {name: float(line.split()[2]) for name, line in new.items()}
    magnet = replace(before.magnet or Magnet(), **values)
    if after != replace(before, magnet=magnet):
        raise wrong
    return mark + made.encode()


STRINGS = re.compile(  # of TOML, and comments; those of several lines have a name
    r'''#[^\n]*|(?P<many>"""(?:\\.|[^\\])*?"{3,5}|\'{3}.*?\'{3,5})'''
    r'''|"(?:\\.|[^"\\\n])*"|'[^'\n]*\'''', re.DOTALL)


def _without_strings(text: str) -> str:
    """A TOML file line by line, with nothing in its strings of several lines."""
    return STRINGS.sub(lambda found: re.sub(r"[^\n]", "_", found[0]) if found["many"]
                       else found[0], text)
