"""Snapshots of both drives at several times (the paper's two figures of that kind)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import tbsa
from figures._data import DRIVES
from figures._records import KEPT, first_run, name_marks, show
from figures.style import figure

DATA = KEPT
ROWS = 4  # times, evenly spaced; the last is the end of the run


def make() -> Figure:
    """A column a drive, a row a time; the assembly dark, all else faded."""
    folder = DATA[0].parent
    runs = [tbsa.read_run(first_run(folder, group)) for group in DRIVES]
    fig = figure(1.72 * ROWS + 0.1)
    axes = fig.subplots(ROWS, len(runs), squeeze=False)
    marked: set[str] = set()
    for column, (run, label) in enumerate(zip(runs, DRIVES.values(), strict=True)):
        end = float(run.time[-1])
        for ax, time in zip(axes[:, column], np.linspace(0.0, end, ROWS), strict=True):
            k = run.at(float(time))
            found, marks = show(ax, run, k)
            marked |= marks
            ax.set_title(f"{run.time[k]:g} s: {found.size} tile{'s' * (found.size != 1)}",
                         fontsize=7, pad=2)
        axes[0, column].set_title(f"{label}\n{axes[0, column].get_title()}", fontsize=7, pad=2)
    name_marks(fig, marked)
    return fig
