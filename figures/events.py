"""Tiles that leave the assembly, over time and by how many leave at once; beyond the paper.

"At once" is between two records, 10 s apart; what leaves and comes back between them is not seen.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from figures._data import CAMPAIGN, DRIVES, LOOKS, Missing, done, needed
from figures.style import figure
from paper_runs.tables import curves

DATA = (CAMPAIGN / "table.csv", CAMPAIGN / "curves.csv")
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
BINS = 18  # of time, over which tiles are counted


def make() -> Figure:
    """Above: losses against time; below: how many of the lost tiles left in a loss of that size."""
    folder = DATA[0].parent
    table = done(folder)
    table = needed(table[table["group"].isin(DRIVES)], "a run that is done")
    fig = figure(4.2)
    above, below = fig.subplots(2, 1)
    for drive, label in DRIVES.items():
        rows = table[table["group"] == drive]
        if rows.empty:
            continue
        colour, dash, _ = LOOKS[drive]
        time, left = curves(folder, rows, "left")
        _, size = curves(folder, rows, "size")
        if len(time) < 2:
            raise Missing(f"curves of {drive} of more than one time")
        rate, edges = lost(time, left, size)
        above.stairs(rate, edges, color=colour, linestyle=dash, lw=1.2, label=label,
                     baseline=None)
        number, share = losses(left)
        # Of n tiles or more: what a loss's own size still has, the next number has not.
        below.step([1.0, *number, number[-1]], [share[0], *share, 0.0], where="pre",
                   color=colour, linestyle=dash)
    end = float(table["duration"].max())
    above.set(xlabel="time (s)", ylabel="tiles lost in 100 s,\n% of the assembly", xlim=(0, end),
              ylim=(0, None))
    most = below.dataLim.x1
    below.set(xlabel="tiles that leave at once", xscale="log", ylim=(0, 100),
              xlim=(1, max(1.1 * most, 2.0)),
              ylabel="lost tiles that left with\nat least as many (%)")
    ticks = [each for each in TICKS if each <= max(most, 2.0)]
    below.set_xticks(ticks, [str(each) for each in ticks])
    below.minorticks_off()
    for ax in (above, below):
        ax.spines[["top", "right"]].set_visible(False)
    fig.legend(loc="outside upper center", ncols=2)
    return fig


def lost(time: np.ndarray, left: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tiles lost in 100 s, in per cent of the assembly that could lose them; edges of the bins.

    Over all runs of one drive: `left` and `size` are [n, k] at times [k] (s).
    """
    edges = np.linspace(0.0, float(time[-1]), min(BINS, len(time) - 1) + 1)
    which = np.clip(np.searchsorted(edges, time[1:], side="left") - 1, 0, len(edges) - 2)
    steps = np.diff(time)
    gone, exposed = (np.bincount(which, weights, len(edges) - 1) for weights in (
        left[:, 1:].sum(axis=0), (size[:, :-1] * steps).sum(axis=0)))
    return 1e4 * gone / np.where(exposed > 0, exposed, np.nan), edges


def losses(left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of tiles that left at once, and what share (%) of all left with as many or more."""
    counted = pd.Series(left[left > 0]).value_counts().sort_index()
    tiles = counted.index.to_numpy(dtype=float) * counted.to_numpy()
    if not len(tiles):
        return np.ones(1), np.zeros(1)
    return counted.index.to_numpy(dtype=float), 100.0 * tiles[::-1].cumsum()[::-1] / tiles.sum()
