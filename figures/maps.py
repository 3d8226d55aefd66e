"""Size of the assembly against the force and the torque of the drive."""

from __future__ import annotations

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import tbsa
from figures._data import CALIBRATION, done, needed, runs
from figures.style import ORANGE, figure
from paper_runs.tables import HERE, given

DATA = (CALIBRATION / "table.csv",)
GROUPS = ("map-unicycle", "map-shaking")
FLOORS = {"separate": "separate floor friction", "coupled": "coupled floor friction"}
COLOURS = matplotlib.colormaps["Blues"].resampled(256)


def make() -> Figure:
    """A panel a law of floor friction: the torques from below, and shaking under them.

    The force and torque of the paper's scenes here are framed, or the torques between which
    theirs is, and the frame is named below.
    """
    folder = DATA[0].parent
    table = done(folder)
    table = given(table[table["group"].isin(GROUPS)], folder, "floor.law", "drive.force")
    unicycle = given(table[table["group"] == GROUPS[0]], folder, "drive.torque")
    shaking = table[table["group"] == GROUPS[1]]
    scene = tbsa.load(HERE / "self_stabilizing.toml")
    chosen = scene.floor.law, scene.drive.force, scene.drive.torque
    largest = float(pd.concat([unicycle, shaking])["size"].max())
    forces = sorted(set(table["drive.force"]))  # the panels share their columns
    needed(unicycle[unicycle["floor.law"].isin(FLOORS)], "a run of the group map-unicycle")
    laws = [law for law in FLOORS if law in set(unicycle["floor.law"])]
    fig = figure(1.3 + 1.75 * len(laws))
    axes = fig.subplots(len(laws), 1, sharex=True, squeeze=False)[:, 0]
    for ax, law in zip(axes, laws, strict=True):
        grid = _means(unicycle[unicycle["floor.law"] == law], "drive.torque")
        shaken = _means(shaking[shaking["floor.law"] == law], "floor.law")
        grid, shaken = grid.reindex(columns=forces), shaken.reindex(columns=forces)
        _cells(ax, grid.to_numpy(), 0.0, largest)
        _cells(ax, shaken.to_numpy(), -1.3, largest)
        ax.set_yticks([-1.3, *range(len(grid))],
                      ["shaking", *(f"{1e3 * torque:g}" for torque in grid.index)])
        ax.set_xticks(range(grid.shape[1]), [f"{1e3 * force:g}" for force in grid.columns])
        ax.set(xlim=(-0.5, grid.shape[1] - 0.5), ylim=(-1.8, len(grid) - 0.5),
               ylabel="$T_{mag}$ (mN m)")
        torques = grid.index.to_numpy()
        if chosen[0] == law and chosen[1] in grid.columns and (
                torques[0] <= chosen[2] <= torques[-1]):
            column, low = grid.columns.get_loc(chosen[1]), int((torques <= chosen[2]).sum()) - 1
            high = int((torques < chosen[2]).sum())
            for bottom, top in ((low, high), (-1.3, -1.3)):
                frame = Rectangle((column - 0.48, bottom - 0.46), 0.96, top - bottom + 0.92,
                                  fill=False, edgecolor=ORANGE, linewidth=1.4, zorder=3)
                ax.add_patch(frame)
            between = ", between two rows" if low < high else ""
            fig.legend([frame], [f"force of the paper's scenes here, {1e3 * chosen[1]:g} mN;\n"
                                 f"self-stabilizing: {1e3 * chosen[2]:g} mN m{between}"],
                       loc="outside lower center", handlelength=1.2, handleheight=1.2)
        ax.set_title(FLOORS[law], fontsize=8)
        ax.tick_params(length=0)
        ax.spines[:].set_visible(False)
    axes[-1].set_xlabel("$F_{mag}$ (mN)")
    seconds = sorted(set(unicycle["duration"]))
    counts = pd.concat([each.groupby([*by, "floor.law", "drive.force"]).size() for each, by in
                        ((unicycle, ["drive.torque"]), (shaking, []))])
    fig.supylabel(f"attached tiles after {', '.join(f'{each:g}' for each in seconds)} s, "
                  f"{runs(counts)}", fontsize=8)
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
