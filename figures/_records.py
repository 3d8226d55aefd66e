"""Runs that are kept, and their records as small pictures with a common legend."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import tbsa
from figures._data import CAMPAIGN, DRIVES, Missing
from paper_runs.tables import load
from tbsa.model.records import Records
from tbsa.work.draw import MARKS
from tbsa.work.metrics import Assembly

# A table, and of each drive a run with some of its records.
KEPT = (CAMPAIGN / "table.csv", *(CAMPAIGN / "runs" / group for group in DRIVES))


def show(ax: Axes, run: Records, k: int) -> tuple[Assembly, set[str]]:
    """Draw a record without its axes; its assembly, and the marks that occur."""
    record = run.layout, run.x[k], run.y[k], run.angle[k]
    tbsa.draw(run.scene, *record, ax=ax, bonds=False, headings=False)
    marked: set[str] = set()
    if legend := ax.get_legend():
        marked = {name for name in MARKS for text in legend.get_texts() if name in text.get_text()}
        legend.remove()
    ax.set_axis_off()
    return tbsa.assembly(run.scene, *record), marked


def name_marks(fig: Figure, marked: Iterable[str]) -> None:
    """Name the marks that occur, below all."""
    names = [name for name in MARKS if name in set(marked)]
    if names:
        fig.legend(handles=[
            Line2D([], [], linestyle="", marker=MARKS[name][1], color=MARKS[name][0],
                   markerfacecolor="none", markersize=4, label=name) for name in names],
            loc="outside lower center", ncols=3)


def first_run(folder: Path, group: str) -> Path:
    """The first run of a group whose records are kept.

    Raises
    ------
    Missing
        Where none is.
    """
    table = load(folder)
    for run in table[table["group"] == group]["run"]:
        if (folder / "runs" / run / "records.npy").exists():
            return folder / "runs" / run
    raise Missing(f"records: no run of {group} is kept in {folder}")
