"""Run time against error of the reference scenes, ours and the other engines'."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from figures._data import Missing, order, results
from figures.style import BLUE, GREY, ORANGE, figure

RESULTS = Path(__file__).parents[1] / "tests" / "benchmarks" / "results"
DATA: tuple[Path, ...] = (RESULTS / "peers.json",)
SHOWN = {  # scene: title, the quantity of its reference, and what that is
    "slide": ("sliding stop", "distance", "distance, relative"),
    "driven": ("driven tile, 20 s", "path", "path, relative"),
    "snap-flush": ("snap, flush", "speed", "impact speed, relative"),
    "oblique-c-sticking": ("oblique impact", "impulse", "impulse, relative"),
    "row-10": ("pressed row of 10", "place", "place, widths"),
    "flying-pair": ("spinning pair", "spin", "critical spin, relative"),
}
LEAST = 1e-9  # errors below are drawn there
# Told apart without their colours, too: hollow marks are larger.
ENGINES: dict[str, tuple[str, dict[str, Any]]] = {
    "tbsa": ("tbsa", {"color": BLUE, "marker": "o", "markersize": 2.5}),
    "box2d": ("Box2D", {"color": ORANGE, "marker": "s", "markersize": 2.5}),
    "pymunk": ("Pymunk", {"color": "#404040", "marker": "^", "markersize": 4.2,
                          "markerfacecolor": "none", "markeredgewidth": 0.6})}


def newest(path: Path) -> list[dict[str, Any]]:
    """Rows of the newest version in a file of results."""
    versions = results(path)
    rows: list[dict[str, Any]] = versions[max(versions, key=order)]
    return rows


def make() -> Figure:
    """A panel for each scene: kernels or engine alone, for a second of simulated time."""
    rows = newest(DATA[0])
    if not rows:
        raise Missing(f"results of the newest version in {DATA[0]}")
    fig = figure(4.6, 7.1)
    axes = fig.subplots(2, 3)
    for ax, (scene, (title, quantity, what)) in zip(axes.flat, SHOWN.items(), strict=True):
        for engine, (name, marks) in ENGINES.items():
            points = [(row["alone"] / row["simulated"],
                       row["error"] if "error" in row else row["errors"][quantity])
                      for row in rows
                      if row["scene"] == scene and row["engine"].startswith(engine)]
            points = [(t, max(e, LEAST)) for t, e in points if e < 1e3]
            if points:
                ax.loglog(*zip(*points, strict=True), linestyle="none", label=name, **marks)
        bottom, top = ax.get_ylim()
        if bottom < LEAST:
            ax.axhspan(bottom, 3.0 * LEAST, color=GREY, alpha=0.15, lw=0)
            ax.set_ylim(bottom, top)
            ax.annotate(f"{LEAST:g} and less", (1.0, 3.0 * LEAST), (-2, 1), fontsize=6, color=GREY,
                        xycoords=("axes fraction", "data"), textcoords="offset points", ha="right")
        ax.set_title(title, fontsize=8)
        ax.set(xlabel="run time for 1 s (s)", ylabel=f"error: {what}")
        ax.spines[["top", "right"]].set_visible(False)
    fig.align_ylabels()
    axes[0, 0].legend(loc="lower left")
    return fig
