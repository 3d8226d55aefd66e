"""Size of the assembly against the drive's frequency, both drives; beyond the paper."""

from __future__ import annotations

from matplotlib.figure import Figure

from figures._data import BARS, BEYOND, DRIVES, LOOKS, done, means, needed, points, seconds
from figures.style import figure
from paper_runs.paper import SELF, SHAKING
from paper_runs.tables import given

DATA = (BEYOND / "table.csv",)
PAPER = {SELF: 0.1, SHAKING: 0.33}  # Hz


def make() -> Figure:
    """Means over the seeds, bars from the smallest to the largest run; the paper's are marked."""
    table = done(DATA[0].parent)
    table = table[(table["group"] == "frequency") & table["drive"].isin(DRIVES)]
    table = needed(table, "a run of the group frequency, of one of the paper's scenes")
    table = given(table, DATA[0].parent, "drive.frequency")
    fig = figure(2.6)
    ax = fig.add_subplot(xscale="log", xlabel="frequency of the drive (Hz)",
                         ylabel=f"attached tiles after {seconds(table)} s")
    for drive, label in DRIVES.items():
        rows = table[table["drive"] == drive]
        if not rows.empty:
            points(ax, means(rows, "drive.frequency"), drive, label)
    ax.set_ylim(0.0, max(1.18 * float(table["size"].max()), 1.0))
    for drive, frequency in PAPER.items():
        ax.annotate("paper", (frequency, 0.0), (frequency, 0.98), color=LOOKS[drive][0],
                    xycoords="data", textcoords=("data", "axes fraction"), fontsize=7, ha="center",
                    va="top", zorder=0,
                    arrowprops={"arrowstyle": "-", "lw": 0.6, "linestyle": ":",
                                "color": LOOKS[drive][0], "shrinkA": 1, "shrinkB": 0})
    ax.set_xticks(sorted(set(table["drive.frequency"])),
                  [f"{each:g}" for each in sorted(set(table["drive.frequency"]))])
    ax.minorticks_off()
    ax.spines[["top", "right"]].set_visible(False)
    fig.legend(loc="outside upper center", ncols=2, title=BARS, title_fontsize=7)
    return fig
