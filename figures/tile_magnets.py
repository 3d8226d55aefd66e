"""Where the magnets are in a tile, and what they do (the paper's figure of their placement).

Lengths, glues and the force law are those of the paper's scene; the forces on a tile near a seed
are sums over all pairs of magnets, by ``theory.magnets``.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures._shapes import BLACK, WHITE, arrow, canvas, extent, law, note, stage, tile
from figures.style import ORANGE
from tbsa.work.draw import BOND
from theory.magnets import force, magnet_positions, pair_force, polarity

DATA: tuple[Path, ...] = ()
LAW = law()
SEED = ((0, 0, BLACK), (1, 0, WHITE), (0, 1, WHITE))  # the corner of an L-shaped seed
GAP = 0.2  # of the tile that is about to join, tile widths
ARROW = 0.21  # N, of a force as long as a tile is wide


def force_on(turn: float) -> np.ndarray:
    """Force of the corner's magnets on a tile that is turned (N)."""
    w = LAW.width
    place = w * (1.0 + GAP), w * (1.0 + GAP), turn
    return np.sum([pair_force((w * c, w * r, 0.0), kind.glues, place, BLACK.glues, LAW)[:2]
                   for c, r, kind in SEED], axis=0)


def make() -> Figure:
    """A tile's lengths, a bonded pair's forces, and a tile at a corner, rightly turned or not."""
    fig = canvas(3.45)
    _lengths(stage(fig, (0.0, 1.75, 1.45, 1.7), 0.8, (-0.85, -0.95), "a a tile"))
    _pair(stage(fig, (1.5, 1.75, 2.0, 1.7), 0.8, (-0.65, -0.95), "b a bonded pair"))
    for name, left, turn in (("c matching glues pull", 0.0, 0.0),
                             ("d a quarter turn: push", 1.75, 0.5 * math.pi)):
        _corner(stage(fig, (left, 0.0, 1.75, 1.78), 0.56, (-0.62, -0.6), name), turn)
    return fig


def _lengths(ax: Axes) -> None:
    """The width, and how deep a magnet lies."""
    tile(ax, BLACK, 0.0, 0.0, glues="NESW")
    w = LAW.width
    extent(ax, (-0.5, -0.62), (0.5, -0.62), _cm(w), (0.0, -0.76))
    x, y = magnet_positions((0.0, 0.0, 0.0), LAW)[0]
    ax.plot([x / w], [y / w], ".", color="#202020", markersize=2.5)
    note(ax, f"{_cm(LAW.inset)} from the edge", (0.1, 0.72), (x / w, y / w))


def _pair(ax: Axes) -> None:
    """The pair of magnets that mates, and one of those beside it."""
    tile(ax, BLACK, 0.0, 0.0, glues="NESW")
    tile(ax, WHITE, 1.0, 0.0, glues="NESW")
    ours = magnet_positions((0.0, 0.0, 0.0), LAW)
    theirs = magnet_positions((LAW.width, 0.0, 0.0), LAW)
    for a, b, at in ((1, 3, (0.5, -0.76)), (0, 3, (0.5, 0.72))):
        sign = polarity(BLACK.glues[a], WHITE.glues[b], LAW)
        r = math.dist(ours[a], theirs[b])
        ends = np.array([ours[a], theirs[b]]) / LAW.width
        colour, dash = (BOND, "-") if sign > 0.0 else (ORANGE, (0, (3, 1.5)))
        ax.plot(*ends.T, color=colour, lw=1.6, linestyle=dash, zorder=3)
        note(ax, f"{'pull' if sign > 0.0 else 'push'}: {_cm(r)}, {force(r, LAW):.3f} N", at,
             tuple(ends.mean(axis=0)), colour=colour)


def _corner(ax: Axes, turn: float) -> None:
    """The force on a tile near the corner."""
    facing = {(1, 0): "N", (0, 1): "E"}
    for column, row, kind in SEED:
        tile(ax, kind, column, row, seed=True, glues=facing.get((column, row), ""))
    at = 1.0 + GAP
    tile(ax, BLACK, at, at, turn, glues="NESW")
    total = force_on(turn)
    colour = BOND if total[0] < 0.0 else ORANGE
    arrow(ax, (at, at), total / ARROW, colour, 1.6, 7.0, halo=False)  # between the labels
    note(ax, f"{np.hypot(*total):.3f} N", (at + 0.58, at), colour=colour, ha="left")


def _cm(length: float) -> str:
    return f"{100.0 * length:.3g} cm"
