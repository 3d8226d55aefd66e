"""Two families whose drives cancel (the paper's figure of forces that minimize the net force).

The block, its drive's load and the net force are those of ``theory.stability``, with the drive's
force and the magnets of the paper's scene.  The paper's tiles are the same after half a turn, so
that a tile may be bonded with its heading either way.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures._shapes import (
    PAPER,
    arrow,
    balance,
    bonds,
    canvas,
    law,
    note,
    spin,
    stage,
    tile,
    towards,
)
from figures.style import BLUE
from theory.magnets import force
from theory.scaling import net_glue_force
from theory.stability import Loads, case, imbalance_of_turns, net_force
from theory.statics import Tiles

DATA: tuple[Path, ...] = ()
assert PAPER.drive is not None
LOAD, TORQUE = float(PAPER.drive.force), float(PAPER.drive.torque)  # N, N m at u = 1
GLUE = force(2.0 * law().inset, law())  # N, of one bond
SIDE = 4
ARROW = 0.13  # N, of a tile's force as long as a tile is wide
INCH = 2.0  # N, of a net force as long as an inch
UNIT = 0.315  # in, a tile's width


def half_turns() -> tuple[Tiles, Loads]:
    """The first draw of half turns whose net force is one standard deviation, upwards."""
    spread = imbalance_of_turns(SIDE**2 // 2, SIDE**2 // 2, 0.5)[1] * LOAD
    return next(found for k in range(100) if np.isclose(net_force((
        found := case("random half turns", SIDE, LOAD, TORQUE, rng=np.random.default_rng(k))
    )[1][0])[1], spread))


def make() -> Figure:
    """A block with its headings alike, one with half turns at random, and their net forces."""
    fig = canvas(3.1)
    for name, left, (tiles, (load,)) in (
            ("a headings alike", 0.0, case("chessboard", SIDE, LOAD, TORQUE)),
            ("b random half turns", 1.78, half_turns())):
        _block(stage(fig, (left, 1.23, 1.72, 1.87), UNIT, (-1.65, -1.6), name), tiles, load)
        ax = stage(fig, (left, 0.16, 1.72, 1.05), 1.0, (-3.15 * UNIT, -0.72))
        balance(ax, net_force(load), net_glue_force(SIDE, GLUE), INCH, BLUE,
                (-0.7, -0.66, 0.6, 0.3))
    foot = stage(fig, (0.0, 0.0, 3.5, 0.2), 1.0)
    towards(foot, (0.12, 0.11), 0.0, "#202020", 0.045)
    note(foot, "heading: black pushes along it, white against it (here $u$ = 1)", (0.22, 0.1),
         ha="left")
    return fig


def _block(ax: Axes, tiles: Tiles, load: np.ndarray) -> None:
    for site, held, colour, (_, fy, turn) in zip(tiles.site, tiles.held, tiles.colour(), load,
                                                 strict=True):
        kind = PAPER.types[colour]
        turned = not held and fy * kind.family < 0.0
        tile(ax, kind, *site, np.pi * turned, magnets=False, seed=bool(held))
        if not held:
            x, y = site
            towards(ax, (x - 0.22, y), np.pi * (0.5 - turned), "#202020", 0.11)
            spin(ax, tuple(site), turn, BLUE, 0.33, -55.0, 95.0, 0.8, 4.0)
            arrow(ax, site - (0, 0.5 * fy / ARROW), (0.0, fy / ARROW), BLUE, 1.4, 6.0, halo=False)
    bonds(ax, SIDE)
