"""Do versions agree?  The beginning of the campaign, done again, against the runs that are kept.

    python -m paper_runs.again

For each drive, over the time that the runs of both have: the size at its end, and in its last third
the mean size, holes, errors and tiles off the lattice.  Each with Welch's 95 % interval of the
difference: the same seeds give the same layout, but what becomes of it after seconds is chance.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from paper_runs.intervals import difference, mean
from paper_runs.tables import against_plan, command, curves, done, given, load, markdown
from tbsa.work.cli import code_of

CAMPAIGN = "campaign"  # the folder of what is kept, beside that of the runs done again
MEASURES = ("size", "holes", "errors", "off_lattice")
HEAD = ("drive", "runs", "what", "before", "again", "again less before", "contains 0")


def ended(folder: Path) -> pd.DataFrame:
    """The runs of a folder that are done, with the version that did them."""
    return given(done(folder), folder, "version")


def compare(folder: Path, before: Path) -> list[Sequence[object]]:
    """The rows of the table."""
    rows: list[Sequence[object]] = []
    ours, theirs = ended(folder), ended(before)
    for drive in dict.fromkeys(ours["drive"]):
        arms = [(home, table[table["drive"] == drive])
                for home, table in ((before, theirs), (folder, ours))]
        runs = " and ".join(str(len(mine)) for _, mine in arms)
        if not all(len(mine) for _, mine in arms):
            rows.append((drive, runs, "one of both has none", *["–"] * 4))
            continue
        for name in MEASURES:
            found = [curves(home, mine, name) for home, mine in arms]
            end = min(times[-1] for times, _ in found)
            if name == "size":
                rows.append((drive, runs, f"attached tiles at {end:g} s", *judged(*(
                    values[:, times <= end][:, -1] for times, values in found))))
            late = [values[:, (times > 2.0 / 3.0 * end) & (times <= end)].mean(axis=1)
                    for times, values in found]
            what = {"size": "attached tiles", "off_lattice": "off the lattice"}.get(name, name)
            rows.append((drive, runs, f"{what}, mean of the last third", *judged(*late)))
    return rows


def judged(before: np.ndarray, again: np.ndarray) -> Sequence[object]:
    """Both means, their difference, and whether it may be chance."""
    off = difference(again, before)
    return (mean(before), mean(again), off,
            "–" if np.isnan(off.low) else "yes" if off.low <= 0.0 <= off.high else "no")


def report(folder: Path, plan: Path) -> str:
    """The comparison in Markdown."""
    before = folder.parent / CAMPAIGN
    state, _, _ = against_plan(plan, load(folder))
    versions = [", ".join(map(str, sorted(set(ended(each)["version"])))) or "–"
                for each in (before, folder)]
    return "\n".join(["# The beginning of the campaign, done again", "", *state, "",
                      f"Before: tbsa {versions[0]}; again: tbsa {versions[1]}.", "",
                      *markdown(HEAD, compare(folder, before)), ""])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    return command("again", "The beginning of the campaign against what is kept of it.", "again",
                   report, argv)


if __name__ == "__main__":
    sys.exit(code_of(main))
