"""The terms of tile-based self-assembly (the paper's figure of its terminology).

The assembly is a scene: the ground truth gives the tiles, and which of them are errors, which
site is a hole and where bonds are is what the package's metrics find.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import tbsa
from figures._shapes import BLACK, PAPER, arrow, canvas, note, stage, tile
from figures.style import BLUE
from tbsa.model.scene import Scene
from tbsa.model.tiles import ground_truth
from tbsa.work.draw import BOND, ERROR
from tbsa.work.metrics import EDGE_ANGLE

DATA: tuple[Path, ...] = ()
ARM = 4
PRESENT = ((1, 1), (2, 1), (3, 1), (4, 1), (1, 2), (3, 2), (1, 3), (2, 3), (1, 4))
OPEN = (3, 3)  # the site that a tile is about to take
STRAY = (4, 2)  # a tile of another kind, held by one of its glues
FREE = (4.25, 4.3, -0.2)  # the tile that is about to join: column, row, angle (rad)


def scene() -> Scene:
    """The paper's tiles on an L-shaped seed, one of a stray kind, and one that is about to join."""
    w, t = PAPER.material.width, PAPER.temperature
    kinds = [{"name": k.name, "glues": list(k.glues), "colour": k.colour} for k in PAPER.types]
    kinds.append({"name": "stray", "glues": [3, 3, 1, 3], "colour": ERROR})
    seed = {"shape": "L", "arm": ARM}
    truth = ground_truth(tbsa.parse({"temperature": t, "tiles": {"type": kinds}, "seed": seed}))
    tiles = [{"type": kinds[truth.types[site]]["name"], "position": [w * site[0], w * site[1]]}
             for site in PRESENT]
    tiles.append({"type": "stray", "position": [w * STRAY[0], w * STRAY[1]]})
    tiles.append({"type": kinds[truth.types[OPEN]]["name"], "position": [w * FREE[0], w * FREE[1]],
                  "angle": FREE[2]})
    return tbsa.parse({"temperature": t, "tiles": {"type": kinds}, "seed": seed, "magnet": {},
                       "free": {"tile": tiles}})


def make() -> Figure:
    """A tile and its parts, and an assembly."""
    fig = canvas(2.3)
    _parts(stage(fig, (0.0, 0.0, 1.2, 2.3), 0.6, (-1.0, -2.3), "a a tile"))
    _assembly(stage(fig, (1.22, 0.0, 2.28, 2.3), 0.355, (-0.65, -0.8), "b an assembly"))
    return fig


def _parts(ax: Axes) -> None:
    tile(ax, BLACK, 0.0, 0.0, glues="NESW", heading=True)
    note(ax, "edge", (-0.6, 0.86), (-0.33, 0.5))
    note(ax, "heading", (0.5, 0.86), (0.06, 0.1))
    note(ax, "magnet", (-0.5, -0.86), (-0.05, -0.46))
    note(ax, "glue", (0.55, -0.86), (0.1, -0.33))
    note(ax, f"Glues g and \N{MINUS SIGN}g match.\nTemperature {PAPER.temperature}: a tile\n"
         f"joins where at least\n{PAPER.temperature} glues match.", (0.0, -1.6))


def _assembly(ax: Axes) -> None:
    shown = scene()
    layout = tbsa.initial_layout(shown)
    found = tbsa.assembly(shown, layout, layout.x, layout.y, layout.angle)
    w = shown.material.width
    x, y = layout.x / w, layout.y / w
    # The glues that meet at the open site and at the stray tile.
    labelled = {OPEN: "", (2, 3): "E", (3, 2): "NE", STRAY: "SW", (4, 1): "N"}
    for i, kind in enumerate(layout.type):
        at = round(float(x[i])), round(float(y[i]))
        glues = "SW" if not (found.attached[i] or found.seed[i]) else labelled.get(at, "")
        tile(ax, shown.types[kind], x[i], y[i], float(layout.angle[i]), seed=bool(found.seed[i]),
             glues=glues, size=6.5)
    for a, edge, _, _ in found.bonded:
        out = layout.angle[a] + EDGE_ANGLE[edge]
        cx, cy = x[a] + 0.5 * np.cos(out), y[a] + 0.5 * np.sin(out)
        dx, dy = 0.11 * np.cos(out), 0.11 * np.sin(out)
        ax.plot([cx - dx, cx + dx], [cy - dy, cy + dy], color="white", lw=3.4, zorder=3,
                solid_capstyle="butt")
        ax.plot([cx - dx, cx + dx], [cy - dy, cy + dy], color=BOND, lw=2.2, zorder=3,
                solid_capstyle="butt")
    ax.add_patch(Rectangle((OPEN[0] - 0.47, OPEN[1] - 0.47), 0.94, 0.94, fill=False, ls=(0, (3, 2)),
                           lw=0.9, edgecolor=BLUE, zorder=1.5))
    way = np.subtract(OPEN, FREE[:2])
    arrow(ax, FREE[:2] + 0.42 * way, 0.5 * way, BLUE)
    for column, row in found.hole_sites:
        note(ax, "hole", (float(column), float(row)))
    for i in np.flatnonzero(found.erroneous):
        note(ax, "error", (x[i] + 0.62, y[i]), ha="left")
    note(ax, "seed", (ARM + 0.62, 0.0), ha="left")
    note(ax, "bond", (ARM + 0.62, 1.0), (ARM + 0.03, 0.55), ha="left")
    note(ax, "binding\nplace", (OPEN[0] + 0.56, OPEN[1] - 0.08), ha="left")
    note(ax, "free\ntile", (FREE[0] + 0.75, FREE[1]), ha="left")
    note(ax, "assembly", (2.35, 4.3), (2.15, 3.25))
