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
from matplotlib.patches import Rectangle

from figures._shapes import PAPER, arrow, canvas, law, note, spin, stage, tile
from figures.style import BLUE
from tbsa.work.draw import BOND
from theory.magnets import force
from theory.scaling import net_glue_force
from theory.stability import case, net_force

DATA: tuple[Path, ...] = ()
assert PAPER.drive is not None
LOAD, TORQUE = float(PAPER.drive.force), float(PAPER.drive.torque)  # N, N m at u = 1
GLUE = force(2.0 * law().inset, law())  # N, of one bond
SIDE = 4
ARROW = 0.13  # N, of a tile's force as long as a tile is wide
INCH = 2.6  # N, of a net force as long as an inch
UNIT = 0.315  # in, a tile's width
DRAW = 5  # of the half turns, a seed of random numbers


def make() -> Figure:
    """A block with its headings alike, and one with half turns at random."""
    fig = canvas(2.6)
    for letter, name, title, left in (("a", "chessboard", "headings alike", 0.0),
                                      ("b", "random half turns", "random half turns", 1.75)):
        _, (load,) = found = case(name, SIDE, LOAD, TORQUE, rng=np.random.default_rng(DRAW))
        ax = stage(fig, (left, 0.0, 1.75, 2.6), UNIT, (-1.65, -3.05), f"{letter} {title}")
        _block(ax, *found)
    return fig


def _block(ax: Axes, tiles, loads) -> None:
    (load,) = loads
    for site, held, colour, (_, fy, turn) in zip(tiles.site, tiles.held, tiles.colour(), load, strict=True):
        kind = PAPER.types[colour]
        turned = not held and fy * kind.family < 0.0
        tile(ax, kind, *site, np.pi * turned, magnets=False, seed=bool(held))
        if not held:
            spin(ax, tuple(site), turn, BLUE, 0.36, 200.0, 140.0, 0.8, 4.0)
            arrow(ax, site - (0, 0.5 * fy / ARROW), (0.0, fy / ARROW), BLUE, 1.3, 6.0, halo=False)
