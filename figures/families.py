"""Size of the assembly when the families are unequal; beyond the paper."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from figures._data import BARS, BEYOND, done, means, needed, points, seconds
from figures.style import BLUE, GREY, ORANGE, figure
from paper_runs.paper import SELF
from paper_runs.tables import given

DATA = (BEYOND / "table.csv",)
BACK = ("free.counts.black-back", "free.counts.white-back")
FORTH = ("free.counts.black", "free.counts.white")
SETS = {"families": ("tiles that bind either way round (the paper's)", BLUE, "-", "o"),
        "families-oriented": ("tiles that bind one way round", ORANGE, (0, (4, 1.5)), "s")}


def make() -> Figure:
    """Against the share of the larger family; the grey mark is one family a colour."""
    folder = DATA[0].parent
    table = done(folder)
    shown = needed(table[table["group"].isin([*SETS, "colours-oriented"])],
                   "a run of unequal families that is done")
    fig = figure(2.7)
    ax = fig.add_subplot(xlabel="tiles of the larger family (%)")
    for group, (label, colour, dash, mark) in SETS.items():
        rows = given(table[table["group"] == group], folder, *FORTH, *BACK)
        if rows.empty:
            continue
        forth, back = rows[list(FORTH)].sum(axis=1), rows[list(BACK)].sum(axis=1)
        rows = rows.assign(share=(100.0 * np.maximum(forth, back) / (forth + back)).round(1))
        # Hollow squares, larger than the discs, hide none of them.
        points(ax, means(rows, "share"), SELF, label, color=colour, linestyle=dash, marker=mark,
               **({"markersize": 6, "fillstyle": "none"} if mark == "s" else {}))
    balanced = table[table["group"] == "colours-oriented"]
    if not balanced.empty:
        at = means(balanced.assign(share=50.0), "share")
        points(ax, at, SELF, "one way round, a family a colour",
               color=GREY, linestyle="", marker="^")
    ax.set(xlim=(47.0, 101.5), ylim=(0.0, max(1.08 * float(shown["size"].max()), 1.0)),
           ylabel=f"attached tiles after {seconds(shown)} s")
    ax.spines[["top", "right"]].set_visible(False)
    fig.legend(loc="outside upper center", title=BARS, title_fontsize=7)
    return fig
