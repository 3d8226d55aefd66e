"""The physical set-up (the paper's figure of it): reactor, seed, both families and their drives.

A reactor like the paper's with fewer tiles: the places are those of the package's random layout,
the forward directions the forces of its drive at u = 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import tbsa
from figures._shapes import PAPER, arrow, bristle_bot, canvas, note, signed, stage, tile
from figures.style import BLUE
from tbsa.kernels.drives import unicycle
from tbsa.model.scene import EDGE_ANGLE, Scene
from tbsa.work.draw import EDGE

DATA: tuple[Path, ...] = ()
ARM, RADIUS, NUMBER = 3, 0.2, 28  # of the seed; of the reactor (m); free tiles
LEAN = 0.11  # of the bristles, tile widths


def scene() -> Scene:
    """The paper's scene with a smaller seed and reactor."""
    small = tbsa.parse({"tiles": {"set": "chessboard"}, "seed": {"shape": "cross", "arm": ARM},
                        "reactor": {"shape": "circle", "radius": RADIUS},
                        "free": {"number": NUMBER}})
    return replace(small, types=PAPER.types, drive=PAPER.drive)


def make() -> Figure:
    """The reactor from above, and the families' drives from the side."""
    fig = canvas(2.55)
    unit = 2.3 / (2.0 * RADIUS / PAPER.material.width + 0.2)
    half = 0.5 * 2.3 / unit
    _above(stage(fig, (0.0, 0.0, 2.3, 2.55), unit, (-half, -half), "a from above"))
    for k, kind in enumerate(PAPER.types):
        ax = stage(fig, (2.4, 1.26 - 1.25 * k, 1.1, 1.29), 0.62, (-0.88, -0.5),
                   f"{'bc'[k]} {kind.name}")
        _drive(ax, k)
    return fig


def _above(ax: Axes) -> None:
    shown = scene()
    layout, w = tbsa.initial_layout(shown), shown.material.width
    ax.add_patch(Circle((0.0, 0.0), RADIUS / w, facecolor="#f0f0ee", edgecolor=EDGE, lw=1.6,
                        zorder=0.5))
    families = np.array([kind.family for kind in shown.types], float)[layout.type]
    forward = np.array([EDGE_ANGLE[kind.forward] for kind in shown.types])[layout.type]
    fx, fy, torque = np.zeros((3, len(layout.x)))
    assert shown.drive is not None
    quarter = 0.25 / shown.drive.frequency  # s, where u = 1
    unicycle(quarter, np.array([1.0, 1.0, shown.drive.frequency]), layout.x, layout.y, layout.angle,
             layout.vx, layout.vy, layout.omega, families, forward, fx, fy, torque)
    for i, kind in enumerate(layout.type):
        at = layout.x[i] / w, layout.y[i] / w
        tile(ax, shown.types[kind], *at, layout.angle[i], magnets=False, pale=not layout.held[i],
             seed=bool(layout.held[i]))
        if not layout.held[i]:
            push = 0.75 * np.array([fx[i], fy[i]])
            arrow(ax, np.array(at) - 0.5 * push, push, BLUE, 1.2, 5.0, halo=False)
    note(ax, "seed", (2.5, 0.82))
    note(ax, "reactor", (5.2, 6.0), (0.72 * RADIUS / w, 0.72 * RADIUS / w))


def _drive(ax: Axes, k: int) -> None:
    kind = PAPER.types[k]
    bristle_bot(ax, kind, 0.0, 0.0, -math.copysign(LEAN, kind.family))
    ax.add_patch(Rectangle((-0.75, -0.07), 1.5, 0.07, facecolor="#d5d5d5", edgecolor=EDGE, lw=0.7))
    arrow(ax, (-0.35 * kind.family, 0.85), (0.7 * kind.family, 0.0), BLUE, 1.8, 8.0)
    note(ax, "forward", (0.0, 1.03), colour=BLUE)
    note(ax, f"family {signed(kind.family)}", (0.0, -0.26))
