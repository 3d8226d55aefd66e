"""Growth when more tiles are available: 1000 and 2000 beside the paper's 550; beyond the paper."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from figures._data import CAMPAIGN, DRIVES, LOOKS, MORE_TILES, done, needed
from figures.style import GREY, figure
from paper_runs.tables import curves, given

DATA = (MORE_TILES / "table.csv", MORE_TILES / "curves.csv")
LINES: tuple[Any, ...] = ((0, (1, 1.2)), (0, (4, 1.5)), "-", "-.", (0, (8, 1.5, 1, 1.5, 1, 1.5)))
FEW = 5  # runs, up to which each has a line of its own instead of a band for all


def make() -> Figure:
    """A panel a drive: mean size against time for each number of free tiles, and its runs."""
    folder = DATA[0].parent
    parts = by_number(folder, needed(done(folder), "a run that is done"))
    if all((CAMPAIGN / path.name).exists() for path in DATA) and len(rows := done(CAMPAIGN)):
        parts = by_number(CAMPAIGN, rows) + parts
    numbers = sorted({number for number, _, _ in parts})
    lines = dict(zip(numbers, cycle(LINES), strict=False))
    fig = figure(4.2)
    axes = fig.subplots(len(DRIVES), 1, sharex=True, height_ratios=(1.7, 1))
    for ax, (drive, label) in zip(axes, DRIVES.items(), strict=True):
        colour = LOOKS[drive][0]
        for number, source, rows in parts:
            mine = rows[rows["group"] == drive]
            if mine.empty:
                continue
            time, sizes = curves(source, mine, "size")
            dash, n = lines[number], len(mine)
            if n > FEW:
                ax.fill_between(time, sizes.min(axis=0), sizes.max(axis=0), color=colour,
                                alpha=0.15, lw=0)
            elif n > 1:
                ax.add_collection(LineCollection(
                    [list(zip(time, each, strict=True)) for each in sizes], colors=colour,
                    linestyles=[dash], linewidths=0.5, alpha=0.6))
            mean = sizes.mean(axis=0)
            ax.plot(time, mean, color=colour, linestyle=dash)
            ax.annotate(f"{number} ({n} run{'s' * (n > 1)})", (time[-1], mean[-1]), (3, 0),
                        textcoords="offset points", fontsize=7, va="center", annotation_clip=False)
        ax.set(ylabel="attached tiles", ylim=(0.0, None))
        ax.set_xlim(0.0, max(float(rows["duration"].max()) for _, _, rows in parts))
        ax.set_title(label, fontsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time (s)")
    fig.align_ylabels(list(axes))
    fig.legend(handles=[Line2D([], [], color=GREY, linestyle=lines[number],
                               label=f"{number} free tiles") for number, _, _ in parts]
               + [Line2D([], [], color=GREY, label="thick: mean"),
                  Line2D([], [], color=GREY, linewidth=0.5, label="thin: a run"),
                  Patch(color=GREY, alpha=0.3, lw=0, label="smallest to largest run")],
               loc="outside upper center", ncols=2)
    return fig


def by_number(folder: Path, table: pd.DataFrame) -> list[tuple[int, Path, pd.DataFrame]]:
    """The runs of a folder, by how many tiles they have beside the seed."""
    table = given(table, folder, "tiles", "total", "size")
    free = (table["tiles"] - (table["total"] - table["size"])).astype(int)
    return [(number, folder, rows) for number, rows in table.groupby(free)]
