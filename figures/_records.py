"""Records of runs that are kept, as small pictures with a common legend."""

from __future__ import annotations

from collections.abc import Iterable

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import tbsa
from tbsa.model.records import Records
from tbsa.work.draw import MARKS
from tbsa.work.metrics import Assembly


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
