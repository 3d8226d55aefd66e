"""Do the statistics depend on the step?  Sizes at the step against those at half of it.

    python -m paper_runs.step_study

For each drive: the difference of the mean sizes with Welch's 95 % interval, which should contain 0
and be narrower than 10 % of the mean to either side.  A run's size is that of its last record, and
beside it the mean over its last third: a shaken assembly loses in half a minute as many tiles as it
has (`python -m figures events`), so that the mean takes a tenth of the runs that a moment does.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from paper_runs.intervals import Estimate, difference, mean, number
from paper_runs.tables import against_plan, command, given, last_third, load, markdown
from tbsa.work.cli import code_of

STEP = "solver.step"
NARROW = 10.0  # per cent of the mean, to either side
LEAST = 12  # seeds of each step
MEASURES = {"at the end": "size", "mean of the last third": "late"}
HEAD = ("drive", "size", "step (s)", "runs", "mean (95 %)", "standard deviation")
VERDICT = ("drive", "size", "half the step less the step", "% of the mean (95 %)", "contains 0",
           f"half width at most {NARROW:g} %", "seeds for that width",
           f"wholly within ±{NARROW:g} %")


def study(table: pd.DataFrame, late: Sequence[float]) -> tuple[list[Sequence[object]],
                                                               list[Sequence[object]]]:
    """Rows of both tables, from the runs that are done and their mean sizes over the last third."""
    sizes, verdicts = [], []
    table = table.assign(late=late)
    for drive in dict.fromkeys(table["drive"]):
        mine = table[table["drive"] == drive]
        steps = sorted(set(mine[STEP]), reverse=True)
        for what, column in MEASURES.items():
            arms = [mine[mine[STEP] == step][column] for step in steps]
            for step, arm in zip(steps, arms, strict=True):
                sizes.append((drive, what, f"{step:.3g} (1/{1 / step:.0f})", len(arm), mean(arm),
                              number(float(arm.std())) if len(arm) > 1 else "–"))
            if len(arms) != 2:
                verdicts.append((drive, what, f"needs two steps, has {len(arms)}", *["–"] * 5))
                continue
            middle = 0.5 * (arms[0].mean() + arms[1].mean())
            off = difference(arms[1], arms[0])
            part = off.scaled(100.0 / middle) if middle else off
            verdicts.append((drive, what, off, part, *judged(part)))
    return sizes, verdicts


def judged(part: Estimate) -> tuple[str, str, str, str]:
    """Whether the difference (per cent) contains 0, is narrow, and the seeds that it would take;
    and whether a difference of as much is excluded.

    The width falls with the square root of the number of seeds.
    """
    if math.isnan(part.low):
        return "–", "–", "–", "–"
    half = 0.5 * (part.high - part.low)
    wanted = max(math.ceil(part.n * (half / NARROW) ** 2), LEAST)
    enough = "" if part.n >= LEAST else f", of {part.n} seeds only"
    return ("yes" if part.low <= 0.0 <= part.high else "no",
            f"{'yes' if half <= NARROW else 'no'} (±{number(half)}){enough}", str(wanted),
            "yes" if part.low >= -NARROW and part.high <= NARROW else "no")


def report(folder: Path, plan: Path) -> str:
    """The study in Markdown."""
    table = load(folder)
    state, _, _ = against_plan(plan, table)
    ended = given(table[table["status"] == "done"], folder, STEP)
    sizes, verdicts = study(ended, last_third(folder, ended))
    times = ", ".join(f"{each:g}" for each in sorted(set(ended["duration"])))
    return "\n".join(["# Sizes and the step", "", *state, "",
                      f"Attached tiles in runs of {times or '–'} s.", "",
                      *markdown(HEAD, sizes), "", *markdown(VERDICT, verdicts), ""])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return command("step_study", "Sizes at the step and at half of it.", "step", report, argv)


if __name__ == "__main__":
    sys.exit(code_of(main))
