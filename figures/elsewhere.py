"""A square reactor with an L-shaped seed, and stripes, of both drives; beyond the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

import tbsa
from figures._data import BEYOND, DRIVES
from figures._records import name_marks, show
from figures.style import figure
from paper_runs.tables import load

GROUPS = {"square": "L-shaped seed", "stripes": "stripes"}
DATA = (BEYOND / "table.csv", *(BEYOND / "runs" / group for group in GROUPS))


def make() -> Figure:
    """A row a pattern, a column a drive: the last record of a run."""
    folder = DATA[0].parent
    table = load(folder)
    fig = figure(4.1)
    axes = fig.subplots(len(GROUPS), len(DRIVES), squeeze=False)
    marked: set[str] = set()
    for row, (group, what) in zip(axes, GROUPS.items(), strict=True):
        for ax, (drive, label) in zip(row, DRIVES.items(), strict=True):
            ax.set_axis_off()
            rows = table[(table["group"] == group) & (table["drive"] == drive)]
            run = _kept(rows, folder)
            if run is None:
                ax.set_title(f"{what}, {label}:\nno run is kept", fontsize=7)
                continue
            found, marks = show(ax, run, -1)
            marked |= marks
            ax.set_title(f"{what}, {label}\n{run.time[-1]:g} s: {found.size} tiles, "
                         f"{found.errors} wrong, {found.holes} hole{'s' * (found.holes != 1)}",
                         fontsize=7, pad=2)
    name_marks(fig, marked)
    return fig


def _kept(rows: pd.DataFrame, folder: Path) -> Any:
    """The first run whose records are kept."""
    for run in rows["run"]:
        if (folder / "runs" / run / "records.npy").exists():
            return tbsa.read_run(folder / "runs" / run)
    return None
