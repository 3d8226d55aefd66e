"""The paper's figures of merit against ours, from the data that were kept of the campaign.

    python -m paper_runs.merit
    python -m paper_runs.merit --data paper_runs/data/campaign --out paper_runs/merit.md

Ours stand with 95 % intervals over runs.  A figure is reached if the whole interval lies in the
range that the printed value stands for (``paper_runs.paper``), not reached if it lies outside,
and open if it reaches across.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from paper_runs import paper
from paper_runs.intervals import (
    Estimate,
    apart,
    difference,
    mean,
    number,
    percent,
    ratio,
    share,
    slopes,
    sparse,
    together,
)
from paper_runs.paper import DURATION, END, RUNS, SELF, SHAKING, Figure
from paper_runs.tables import (
    against_plan,
    command,
    curves,
    last_third,
    load,
    markdown,
    records,
    walls,
)
from tbsa.work.cli import code_of

Drives = dict[str, pd.DataFrame]  # the runs of each drive that are done
HEAD = ("figure of merit", "paper", "stands for", "ours (95 %)", "runs", "reached?")
RULES = f"""Intervals are over runs. Sizes and gains: Student's t; their differences, and that of
errors over time: Welch's; the ratio of sizes: Fieller's. Errors and holes are means over runs of
per cent of each run's size, by bootstrap over runs if most have any. If not, what a run has
counts as one event of a compound Poisson process, as several errors can come at once; runs without
any bound it by events of as many as there are together in our records (errors), or of one (holes).
Such an interval of 95 % holds the truth in about 95 % if half a dozen runs have any, and in 75 to
90 % if fewer have and some have far more than others; where no run ever has any there is none of
errors over time. Differences of errors and holes at the end: Newcombe's, from the intervals of the
two. The share of runs that have any at their end stands below, with its exact binomial interval.
What is above or below a number is not equal to it.

*Gain*: what the slope of size over the last third of the run, a straight line through each run's
records, adds in that third, in per cent of the drive's mean end size. One threshold holds for both
drives: an assembly that gains more than {paper.STEADY:g} % grows, one within {paper.STEADY:g} % has
reached its limit. The paper shows curves and no number; the threshold is ours. *Decreasing rate*:
the gain is below that of the second third. *Errors over time*: per cent of the size at each record,
and the mean over the records of a run.

An error is a tile of the wrong colour on a site of the ground truth. Attached tiles that are off
the lattice, or on it where the ground truth has no tile, count in the size and cannot be errors;
the paper does not say what it did with such. Both stand below, and what the errors would be if all
tiles off the lattice were counted as such."""


def rows(folder: Path, drives: Drives) -> list[tuple[str, Figure, Estimate, str]]:
    """What is measured, what the paper reports, ours, and the unit."""
    found = []
    gains = {drive: growth(folder, table) for drive, table in drives.items()}
    clump = clumps(folder, drives)
    last = {drive: {"errors": percent(table["errors"], table["size"], clump),
                    "holes": percent(table["holes"], table["size"])}
            for drive, table in drives.items()}
    for drive, table in drives.items():
        found += [
            (f"{drive}: attached tiles at the end", END[drive]["size"], mean(table["size"]), ""),
            (f"{drive}: errors at the end", END[drive]["errors"], last[drive]["errors"], "%"),
            (f"{drive}: holes at the end", END[drive]["holes"], last[drive]["holes"], "%")]
        limit = paper.GROWING if drive == SELF else paper.SATURATED
        found.append((f"{drive}: gain over the last third", limit, mean(gains[drive].last), "%"))
        if drive == SELF:
            found.append((f"{drive}: gain, last third less second", paper.SLOWING,
                          mean(gains[drive].last - gains[drive].second), "points"))
    ours, theirs = drives[SELF], drives[SHAKING]
    least = END[SELF]["size"].value / END[SHAKING]["size"].value
    found += [
        ("size, self-stabilizing over shaking", Figure(f"more than {least:.1f}", least, least,
                                                       math.inf),
         ratio(ours["size"], theirs["size"]), ""),
        ("gain over the last third, self-stabilizing less shaking", paper.MORE,
         difference(gains[SELF].last, gains[SHAKING].last), "points"),
        ("errors at the end, self-stabilizing less shaking", paper.LESS,
         apart(last[SELF]["errors"], last[SHAKING]["errors"]), "points"),
        ("errors over time, self-stabilizing less shaking", paper.LESS,
         at_any_time(*(over_time(folder, each) for each in (ours, theirs))), "points"),
        ("holes at the end, self-stabilizing less shaking", paper.MORE,
         apart(last[SELF]["holes"], last[SHAKING]["holes"]), "points")]
    return found


class Growth(NamedTuple):
    """Of every run what the slope of a third adds in it, in per cent of the mean end size."""

    slope: np.ndarray  # of size in the last third, tiles/s
    second: np.ndarray  # gain in the second third, per cent
    last: np.ndarray


def growth(folder: Path, table: pd.DataFrame) -> Growth:
    """The slope and the gains of some runs of one drive."""
    if table.empty:
        nothing = np.zeros(0)
        return Growth(nothing, nothing, nothing)
    time, sizes = curves(folder, table, "size")
    end = float(time[-1])
    early = slopes(time, sizes, end / 3, 2 * end / 3)
    late = slopes(time, sizes, 2 * end / 3, end)
    size = float(table["size"].mean())
    unit = 100.0 * end / 3 / size if size else math.nan
    return Growth(late, unit * early, unit * late)


def at_any_time(ours: np.ndarray, theirs: np.ndarray) -> Estimate:
    """The difference of errors over time; without an interval where no run has any."""
    found = difference(ours, theirs)
    return found if ours.any() or theirs.any() else found._replace(low=math.nan, high=math.nan)


def errors(folder: Path, table: pd.DataFrame) -> np.ndarray:
    """How many errors there are in each record of these runs."""
    if table.empty:
        return np.zeros(0)
    return records(folder, table, "errors")["errors"].to_numpy(dtype=float)


def clumps(folder: Path, drives: Drives) -> float:
    """How many errors come together, in the mean over those of all records of both drives."""
    return together(np.concatenate([errors(folder, table) for table in drives.values()]))


def over_time(folder: Path, table: pd.DataFrame) -> np.ndarray:
    """Errors of every run in per cent, the mean over its records with an attached tile."""
    if table.empty:
        return np.zeros(0)
    found = records(folder, table, "errors_percent").groupby("run")["errors_percent"].mean()
    return found.reindex(table["run"]).to_numpy(dtype=float)


def _beside(folder: Path, drives: Drives) -> list[str]:
    """What stands beside the paper's figures."""
    lines = []
    for drive, table in drives.items():
        if table.empty:
            continue
        n = len(table)
        line = [drive, f"{number(table['size'].std())}" if n > 1 else "–",
                f"{table['size'].min():.0f} to {table['size'].max():.0f}",
                mean(last_third(folder, table)),
                mean(1000.0 * growth(folder, table).slope), sparse(over_time(folder, table))]
        line += [str(share(int((table[name] > 0).sum()), n).scaled(100.0))
                 for name in ("errors", "holes")]
        line += [number(float(table[name].mean())) if name in table else "–"
                 for name in ("total", "size_contact", "wrongly_turned", "off_lattice", "outside")]
        line.append(percent(table["errors"] + table["off_lattice"], table["size"])
                    if "off_lattice" in table else "–")
        lines.append(line)
    return markdown(("at the end", "size, standard deviation", "size, from to",
                     "size, mean of the last third (95 %)",
                     "slope of the last third, tiles in 1000 s (95 %)", "errors over time, %",
                     "% of runs with an error", "% of runs with a hole", "with the seed",
                     "by contact", "wrongly turned", "off the lattice", "outside the pattern",
                     "errors and tiles off the lattice, %"), lines)


def _walls(folder: Path, drives: Drives) -> list[str]:
    wall = {drive: walls(folder).reindex(table["run"]).dropna() for drive, table in drives.items()}
    total = sum(float(each.sum()) for each in wall.values()) / 3600.0
    if not total:
        return []
    parts = ", ".join(
        f"{drive} {each.sum() / 3600.0:.2f} h ({each.sum() / 36.0 / total:.0f} %; half of its runs "
        f"took less than {each.median() / 60.0:.1f} min)" for drive, each in wall.items()
        if len(each))
    return ["", f"Wall time of the runs, one core each: {total:.2f} h, which is {total / 2:.2f} h "
            f"on 2 cores: {parts}. A run that was stopped for a while on a busy machine counts "
            "that time, too."]


def report(folder: Path, plan: Path) -> str:
    """The table of figures of merit, in Markdown."""
    table = load(folder)
    state, _, foreign = against_plan(plan, table)
    ended = table[table["status"] == "done"]
    drives = {drive: ended[ended["group"] == drive] for drive in (SELF, SHAKING)}
    lines = ["# The paper's figures of merit", "", *state]
    short = [float(time) for each in drives.values() for time in each["duration"]
             if time != DURATION]
    if short:
        runs = sum(map(len, drives.values()))
        lines += ["", f"**{len(short)} of {runs} runs end at "
                  f"{', '.join(f'{each:g}' for each in sorted(set(short)))} s, the paper's at "
                  f"{DURATION:g} s: no figure counts as reached or not.**"]
    elif foreign:
        lines += ["", f"**{foreign} runs are not of {plan.name}: no figure counts as reached or "
                  "not.**"]
    elif any(len(each) < RUNS for each in drives.values()):
        lines += ["", f"The paper has {RUNS} runs of each drive: this is preliminary."]
    lines += ["", *markdown(HEAD, [
        (what, figure.text, _range(figure), f"{ours} {unit}".strip(), ours.n,
         "–" if short or foreign else figure.verdict(ours))
        for what, figure, ours, unit in rows(folder, drives)])]
    many = (f"In the records of both drives {clumps(folder, drives):.3g} errors are there at a "
            "time, in the mean over all errors."
            if any(errors(folder, table).any() for table in drives.values())
            else "There is no error in any record of either drive.")
    return "\n".join([*lines, "", RULES, "", many, "", *_beside(folder, drives),
                      *_walls(folder, drives), ""])


def _range(figure: Figure) -> str:
    if math.isinf(figure.high):
        return f"above {figure.low:.3g}"
    if math.isinf(figure.low):
        return f"below {figure.high:.3g}"
    return f"{figure.low:.3g} to {figure.high:.3g}".replace("-", "−")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return command("merit", "The paper's figures of merit against ours.", "campaign", report, argv)


if __name__ == "__main__":
    sys.exit(code_of(main))
