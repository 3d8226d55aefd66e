"""Size, errors and holes of the assembly against time, over all runs of both drives.

The mean over the runs of each drive, with their standard deviation, and the values that the
paper reports for the end (Section V, Results).
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from figures._data import CAMPAIGN, DRIVES, LOOKS, done, needed
from figures.style import BLUE, figure
from paper_runs.paper import DURATION, END, SELF
from paper_runs.tables import records

DATA = (CAMPAIGN / "table.csv", CAMPAIGN / "curves.csv")
BEGUN = 60.0  # s: from then on the panels hold the bands
PANELS = {  # column: label, and the paper's end values
    column: (label, {drive: END[drive][name].value for drive in DRIVES})
    for column, label, name in (("size", "attached tiles", "size"),
                                ("errors_percent", "errors (%)", "errors"),
                                ("holes_percent", "holes (%)", "holes"))}


def make() -> Figure:
    """Three panels above each other; the marks at 3600 s are the paper's."""
    folder = DATA[0].parent
    runs = done(folder)
    runs = needed(runs[runs["group"].isin(DRIVES)], "a run that is done")
    curves = records(folder, runs, *PANELS).merge(runs[["run", "group"]], on="run")
    fig = figure(4.6)
    axes = fig.subplots(3, 1, sharex=True, height_ratios=(1.6, 1, 1))
    end = float(curves["time"].max())
    compared = end >= DURATION  # what the paper reports is of the end of its runs
    handles, marks, top = [], [], dict.fromkeys(axes, 0.0)
    for drive, label in DRIVES.items():
        colour, dash, mark = LOOKS[drive]
        rows = curves[curves["group"] == drive]
        number = rows["run"].nunique()
        if not number:
            continue
        for ax, (column, (_, reported)) in zip(axes, PANELS.items(), strict=True):
            # Of the per cent only runs with an attached tile count: none has none of it.
            at = rows.groupby("time")[column].agg(["mean", "std"]).dropna(subset=["mean"])
            time, mean, spread = at.index.to_numpy(), at["mean"], at["std"].fillna(0.0)
            ax.fill_between(time, np.maximum(mean - spread, 0.0), mean + spread, color=colour,
                            alpha=0.18, lw=0)
            # The first few tiles are many per cent each: they do not set the scale.
            later = time >= min(BEGUN, 0.05 * end)
            ends = [reported[drive]] if compared else []
            top[ax] = max(top[ax], float((mean + spread)[later].max()), *ends)
            # Unclipped: a curve along zero would lose half its width to the axis.
            line, = ax.plot(time, mean, color=colour, linestyle=dash, zorder=3)
            line.set_clip_on(bool(mean.max() > top[ax]))
            for value in ends:
                ax.plot([DURATION], [value], mark, markersize=4.5, markerfacecolor="white",
                        markeredgecolor=colour, markeredgewidth=1.1, clip_on=False, zorder=5)
        handles.append(Line2D([], [], color=colour, linestyle=dash,
                              label=f"{label} ({number} run{'s' * (number != 1)})"))
        if compared:
            marks.append(Line2D([], [], color=colour, linestyle="", marker=mark, markersize=4.5,
                                markerfacecolor="white", label=f"paper, at {DURATION:g} s"))
    for ax, (what, _) in zip(axes, PANELS.values(), strict=True):
        ax.set(ylabel=what, xlim=(0.0, end))
        high = ax.get_ylim()[1], 160.0 if compared else 0.0
        ax.set_ylim(0.0, max(high if ax is axes[0] else (1.05 * top[ax], 2.0)))
        ax.spines[["top", "right"]].set_visible(False)
    if compared:
        most = END[SELF]["size"].value  # "more than 130"
        axes[0].annotate("", (DURATION, most + 0.14 * axes[0].get_ylim()[1]), (DURATION, most),
                         annotation_clip=False, zorder=4,
                         arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.1})
    axes[-1].set_xlabel("time (s)")
    fig.align_ylabels(list(axes))
    fig.legend(handles=[*handles, *marks], ncols=2, loc="outside upper center",
               title="means over the runs; bands: one standard deviation to either side",
               title_fontsize=7)
    return fig
