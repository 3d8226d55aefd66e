"""Size of the assembly against the force and the torque of the drive."""

from __future__ import annotations

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures._data import CALIBRATION, done
from figures.style import figure

DATA = (CALIBRATION / "table.csv",)
FLOORS = {"separate": "separate floor friction", "coupled": "coupled floor friction"}
COLOURS = matplotlib.colormaps["Blues"].resampled(256)


def make() -> Figure:
    """A panel a law of floor friction: the torques from below, and shaking under them."""
    table = done(DATA[0].parent)
    unicycle = table[table["group"] == "map-unicycle"]
    shaking = table[table["group"] == "map-shaking"]
    largest = float(pd.concat([unicycle, shaking])["size"].max())
    laws = [law for law in FLOORS if law in set(unicycle["floor.law"])]
    fig = figure(1.0 + 1.75 * len(laws))
    axes = fig.subplots(len(laws), 1, sharex=True, squeeze=False)[:, 0]
    for ax, law in zip(axes, laws, strict=True):
        grid = _means(unicycle[unicycle["floor.law"] == law], "drive.torque")
        shaken = _means(shaking[shaking["floor.law"] == law], "floor.law")
        shaken = shaken.reindex(columns=grid.columns)
        _cells(ax, grid.to_numpy(), 0.0, largest)
        _cells(ax, shaken.to_numpy(), -1.3, largest)
        ax.set_yticks([-1.3, *range(len(grid))],
                      ["shaking", *(f"{torque:g}" for torque in grid.index)])
        ax.set_xticks(range(grid.shape[1]), [f"{force:g}" for force in grid.columns])
        ax.set(xlim=(-0.5, grid.shape[1] - 0.5), ylim=(-1.8, len(grid) - 0.5),
               ylabel="$T_{mag}$ (N m)")
        ax.set_title(FLOORS[law], fontsize=8)
        ax.tick_params(length=0)
        ax.spines[:].set_visible(False)
    axes[-1].set_xlabel("$F_{mag}$ (N)")
    seconds = sorted(set(unicycle["duration"]))
    fig.supylabel(f"attached tiles after {', '.join(f'{each:g}' for each in seconds)} s",
                  fontsize=8)
    return fig


def _means(rows: pd.DataFrame, down: str) -> pd.DataFrame:
    """Mean size over the seeds, by `down` and force."""
    return rows.pivot_table(values="size", index=down, columns="drive.force", aggfunc="mean")


def _cells(ax: Axes, values: np.ndarray, bottom: float, largest: float) -> None:
    """Coloured cells with their numbers; the lowest row is centred at `bottom`."""
    rows, columns = values.shape
    ax.pcolormesh(np.arange(columns + 1) - 0.5, bottom - 0.5 + np.arange(rows + 1),
                  np.ma.masked_invalid(values), cmap=COLOURS, vmin=0.0,
                  vmax=max(1.15 * largest, 1.0), edgecolors="white", linewidth=0.6)
    for (row, column), value in np.ndenumerate(values):
        known = not np.isnan(value)
        dark = known and value > 0.6 * largest
        ax.text(column, bottom + row, f"{value:.0f}" if known else "–", ha="center", va="center",
                fontsize=7, color="white" if dark else "#202020")
