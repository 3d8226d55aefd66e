"""Speed: cost over the number of tiles, and what the targets of speed have come to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from figures._data import Missing, order, results
from figures.style import BLUE, GREY, ORANGE, figure

RESULTS = Path(__file__).parents[1] / "tests" / "benchmarks" / "results"
SETTINGS = {"fixed": ("1/480 s, one pass", BLUE, "o"),
            "recommended": ("as in the scene's file", ORANGE, "s")}
ENGINES = {"box2d": "Box2D", "pymunk": "Pymunk"}


def newest(folder: Path) -> Path:
    """The results of the newest version in a folder."""
    return next(iter(by_version(folder)), folder / "speed-VERSION.json")


def by_version(folder: Path) -> list[Path]:
    """The results of all versions, the newest first."""
    return sorted(folder.glob("speed-*.json"), key=lambda path: order(path.name), reverse=True)


def sizes_of(folder: Path) -> tuple[list[dict[str, Any]], str]:
    """The rows over the number of tiles of the newest version that has any, and which it is."""
    for path in by_version(folder):
        rows = [row for row in results(path).get("rows", []) if row["part"] == "sizes"]
        if rows:
            return rows, path.stem.removeprefix("speed-")
    return [], ""


DATA: tuple[Path, ...] = (newest(RESULTS),)


def make() -> Figure:
    """Time per tile and substep, of each scene, and how many times as fast as other engines."""
    rows = results(DATA[0]).get("rows")
    if not rows:
        raise Missing(f"rows in {DATA[0]}")
    sizes, version = sizes_of(DATA[0].parent)
    scenes = sorted({row["scene"] for row in sizes}, reverse=True) or [""]
    fig = figure(3.0, 7.1)
    *lefts, right = fig.subplots(1, len(scenes) + 1, width_ratios=[1.0] * len(scenes) + [1.25])
    for ax, scene in zip(lefts, scenes, strict=True):
        if ax is not lefts[0]:
            ax.sharey(lefts[0])  # first: the limits of both come from all that is drawn
        cost(ax, [row for row in sizes if row["scene"] == scene])
        ax.set_title(f"{scene} ({version})" if scene else "", fontsize=7)
    for ax in lefts[1:]:
        ax.set_ylabel("")
    speeds(right, rows)
    right.set_title(DATA[0].stem.removeprefix("speed-"), fontsize=7)
    for ax in (*lefts, right):
        ax.spines[["top", "right"]].set_visible(False)
    fig.legend(*lefts[0].get_legend_handles_labels(), loc="outside upper center", ncols=4,
               fontsize=6, handlelength=4.0, columnspacing=1.2)
    return fig


def cost(ax: Axes, rows: list[dict[str, Any]]) -> None:
    """CPU time per tile and substep over the number of tiles."""
    for name, (label, colour, marker) in SETTINGS.items():
        for skips, style in (("on", "-"), ("off", "--")):
            line = sorted((row["tiles"], 1e9 * row["median"]) for row in rows
                          if row["setting"] == name and row["skips"] == skips)
            if line:
                ax.plot(*zip(*line, strict=True), style + marker, color=colour, markersize=3,
                        label=label + (", skips off" if skips == "off" else ""))
    ax.set(xscale="log", yscale="log")
    sizes = sorted({row["tiles"] for row in rows})
    ax.set_xticks(sizes, [f"{size:,}" for size in sizes], rotation=30)
    ax.xaxis.set_minor_locator(NullLocator())
    ticks = [200, 500, 1000, 2000, 5000]
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_yticks(ticks, [f"{tick:,}" for tick in ticks])
    ax.set(xlabel="free tiles", ylabel="CPU time a tile and substep (ns)")


def speeds(ax: Axes, rows: list[dict[str, Any]]) -> None:
    """Simulated seconds per CPU second over those of another engine, for each scene."""
    peers = {(row["scene"], row["engine"]): row["median"] for row in rows
             if row["part"] == "peers"}
    ours = {(row["scene"], row["skips"], row["setting"]): row["median"] for row in rows
            if row["part"] == "paper"}
    places = [(scene, skips, engine) for scene, engine in sorted(peers, key=lambda key: key[1])
              for skips in ("on", "off") if any(key[:2] == (scene, skips) for key in ours)]
    switched = any(skips == "off" for _, skips, _ in places)
    for y, (scene, skips, engine) in enumerate(places):
        for k, (name, (label, colour, _)) in enumerate(SETTINGS.items()):
            if (scene, skips, name) not in ours:
                continue
            value = peers[scene, engine] / ours[scene, skips, name]
            ax.barh(y + 0.21 * (2 * k - 1), value, 0.36, color=colour,
                    label=label if y == 0 else None)
            ax.annotate(f"{value:.2g}", (max(value, 1.0), y + 0.21 * (2 * k - 1)), (2, 0),
                        textcoords="offset points", va="center_baseline", fontsize=6, zorder=3)
    ax.axvline(1.0, color=GREY, linewidth=0.8, zorder=1)
    ax.set_yticks(range(len(places)), [
        f"{scene}{f', skips {skips}' if switched else ''}, {ENGINES[engine]}"
        for scene, skips, engine in places])
    ax.invert_yaxis()
    ax.margins(x=0.12)
    ax.set_xlabel("times as fast (ours with magnets)", loc="right")
