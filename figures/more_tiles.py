"""Growth when more tiles are available: 1000 and 2000 beside the paper's 550; beyond the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from figures._data import CAMPAIGN, DRIVES, LOOKS, MORE_TILES, done, needed, runs
from figures.style import GREY, figure
from paper_runs.tables import curves, given

DATA = (MORE_TILES / "table.csv", MORE_TILES / "curves.csv")
PAPER = 550
COUNTS = ["free.counts.black", "free.counts.white"]
LINES: dict[int, Any] = {PAPER: (0, (1, 1.2)), 1000: (0, (4, 1.5)), 2000: "-"}


def make() -> Figure:
    """A panel a drive: mean size against time for each number of free tiles, and its range."""
    folder = DATA[0].parent
    table = given(needed(done(folder), "a run that is done"), folder, *COUNTS)
    table = table.assign(free=table[COUNTS].sum(axis=1).astype(int))
    parts: list[tuple[int, Path, pd.DataFrame]] = [
        (number, folder, rows) for number, rows in table.groupby("free")]
    if all((CAMPAIGN / path.name).exists() for path in DATA) and len(rows := done(CAMPAIGN)):
        parts.insert(0, (PAPER, CAMPAIGN, rows))
    fig = figure(3.8)
    axes = fig.subplots(len(DRIVES), 1, sharex=True, height_ratios=(1.7, 1))
    for ax, (drive, label) in zip(axes, DRIVES.items(), strict=True):
        for number, source, rows in parts:
            mine = rows[rows["group"] == drive]
            if mine.empty:
                continue
            time, sizes = curves(source, mine, "size")
            colour, dash = LOOKS[drive][0], LINES.get(number, "-.")
            ax.fill_between(time, sizes.min(axis=0), sizes.max(axis=0), color=colour, alpha=0.13,
                            lw=0)
            ax.plot(time, sizes.mean(axis=0), color=colour, linestyle=dash)
        ax.set(ylabel="attached tiles", ylim=(0.0, None))
        ax.set_xlim(0.0, max(float(rows["duration"].max()) for _, _, rows in parts))
        ax.set_title(label, fontsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time (s)")
    fig.align_ylabels(list(axes))
    fig.legend(handles=[Line2D([], [], color=GREY, linestyle=LINES.get(number, "-."),
                               label=f"{number} free tiles, {runs(rows.groupby('group').size())}")
                        for number, _, rows in parts], loc="outside upper center")
    return fig
