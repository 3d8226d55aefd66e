"""A tile on a bristle drive and a vertical shaker (the paper's figure of that name).

The bristles are a sketch, as in the paper, which does not model them; what is simulated in their
place is the force and the torque of the paper's scene.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

from figures._shapes import (
    BLACK,
    PAPER,
    arrow,
    bristle_bot,
    canvas,
    note,
    spin,
    stage,
    tile,
    tint,
)
from figures.style import BLUE
from tbsa.work.draw import EDGE

DATA: tuple[Path, ...] = ()
LEAN = -0.11  # of the bristles, tile widths
assert PAPER.drive is not None
DRIVE = PAPER.drive


def make() -> Figure:
    """The tile from the side, from below, and what is simulated."""
    fig = canvas(2.08)
    _side(stage(fig, (0.0, 0.0, 1.62, 2.08), 0.8, (-1.0, -1.18), "a from the side"))
    _below(stage(fig, (1.66, 0.0, 0.9, 2.08), 0.62, (-0.72, -1.85), "b from below"))
    _model(stage(fig, (2.58, 0.0, 0.92, 2.08), 0.62, (-0.74, -1.85), "c simulated"))
    return fig


def _side(ax: Axes) -> None:
    bristle_bot(ax, BLACK, 0.0, 0.0, LEAN)
    ax.add_patch(Rectangle((-0.85, -0.09), 1.7, 0.09, facecolor="#d5d5d5", edgecolor=EDGE, lw=0.7))
    ax.add_patch(Rectangle((-0.05, -0.4), 0.1, 0.31, facecolor="#d5d5d5", edgecolor=EDGE, lw=0.7))
    ax.add_patch(FancyBboxPatch((-0.32, -0.92), 0.64, 0.52,
                                boxstyle="round,pad=0,rounding_size=0.06",
                                facecolor="#efefef", edgecolor=EDGE, lw=0.7))
    note(ax, "shaker", (0.0, -0.66))
    arrow(ax, (-0.7, -0.48), (0.0, 0.32), "#202020", 1.0, 6.0, style="<|-|>")
    note(ax, "$A\\,$sin$\\,$2π$f\\,t$", (-0.68, -0.66))
    arrow(ax, (-0.3, 0.8), (0.7, 0.0), BLUE, 1.8, 8.0)
    note(ax, "forward", (0.05, 0.93), colour=BLUE)
    note(ax, "tile", (-0.72, 0.8), (-0.3, 0.56))
    note(ax, "magnet", (0.75, 0.8), (0.47, 0.52))
    note(ax, "bristles", (0.75, 0.25), (0.34, 0.15))
    note(ax, "vibrating\nsurface", (0.68, -0.36), (0.5, -0.05))


def _below(ax: Axes) -> None:
    ax.add_patch(Rectangle((-0.5, -0.5), 1.0, 1.0, facecolor=tint(BLACK.colour), edgecolor=EDGE,
                           lw=0.7))
    # Longer strokes on one side than on the other: the tile goes ahead and turns.
    for column, lean in zip(np.linspace(-0.36, 0.36, 5), np.linspace(-0.17, -0.05, 5), strict=True):
        for row in np.linspace(-0.3, 0.42, 4):
            ax.plot([column, column], [row, row + lean], color="#303030", lw=1.0)
            ax.plot([column], [row], ".", color="#303030", markersize=2.5, markeredgewidth=0)
    arrow(ax, (-0.36, 0.58), (0.0, 0.45), BLUE, 1.4, 6.0)
    arrow(ax, (0.36, 0.58), (0.0, 0.25), BLUE, 1.4, 6.0)
    note(ax, "unequal lean:\npush and turn", (0.0, -0.86))


def _model(ax: Axes) -> None:
    tile(ax, BLACK, 0.0, 0.0, heading=True)
    arrow(ax, (0.0, 0.2), (0.0, 0.72), BLUE, 1.8, 8.0)
    spin(ax, (0.0, 0.0), 1.0, BLUE, 0.34, -150.0, 120.0)
    note(ax, "$F$", (0.18, 0.82), colour=BLUE, size=8)
    note(ax, "$T$", (0.32, -0.36), colour=BLUE, size=8)
    for k, line in enumerate(("$F = u\\,a_i\\,F_\\mathrm{mag}$",
                              "$T = u\\,\\omega_i\\,T_\\mathrm{mag}$", "$u$ = sin 2π$f\\,t$",
                              f"$f$ = {DRIVE.frequency:g} Hz")):
        note(ax, line, (0.0, -0.75 - 0.29 * k))
