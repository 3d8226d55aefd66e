"""Forces that detach an assembly (the paper's figure of that name), and how they grow with it.

A block in the corner of an L-shaped seed is held by the glues of two sides and pushed by the
drive of all its tiles; it stays while the sum of both lies in the third quadrant.  Drive and
magnets are those of the paper's scene, the argument is that of ``theory.scaling``: mating magnets
alone, no friction, and the worst phase of a load that rotates.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from figures._shapes import HELD, PAPER, arrow, balance, bonds, canvas, law, note, stage, tile
from figures.style import BLUE, ORANGE
from tbsa.work.draw import BOND
from theory.magnets import force
from theory.scaling import READINGS, leaves_quadrant, net_glue_force, worst_angle
from theory.stability import imbalance_of_block, imbalance_of_turns, net_force, shaking
from theory.statics import block

DATA: tuple[Path, ...] = ()
assert PAPER.drive is not None
LOAD = float(PAPER.drive.force)  # N, on every tile
GLUE = force(2.0 * law().inset, law())  # N, of one bond
PHASE = worst_angle(0.0)  # rad, of the shaken load
LIMIT = next(r for r in READINGS if r.name == "quadrant").bound(GLUE, LOAD, 0.0, 0.0)
SIZES = (2, max(4, int(LIMIT) + 1))  # blocks that are drawn: one that is held, one that is not
ARROW = 0.12  # N, of a tile's force as long as a tile is wide
UNIT = 1.4 / (SIZES[1] + 1)  # in, a tile's width
INCH = 1.3  # N, of a net force as long as an inch
LARGEST, MOST = round(3.0 * LIMIT), 3.6 * LIMIT * GLUE  # side of a block, N: the diagram's ends


def net_tile_force(n: int) -> np.ndarray:
    """On a shaken n x n block (N)."""
    a, b = shaking(block(n), LOAD)
    return net_force(math.cos(PHASE) * a + math.sin(PHASE) * b)


def make() -> Figure:
    """Two shaken blocks, the sums of their forces, and the forces against the block's side."""
    fig = canvas(4.8)
    for letter, n, left, width in zip("ab", SIZES, (0.0, 1.3), (1.3, 2.2), strict=True):
        fate = "detaches" if leaves_quadrant(net_tile_force(n), net_glue_force(n, GLUE)) else "held"
        title = f"{letter} {n} \N{MULTIPLICATION SIGN} {n} tiles: {fate}"
        top = stage(fig, (left, 3.13, width, 1.67), UNIT, (-1.75, -1.6), title)
        _block(top, n)
        if n == SIZES[0]:
            for text, y, colour in ((f"$F$ = {LOAD:g} N", 1.5 + 0.25 / UNIT, ORANGE),
                                    (f"$F_\\mathrm{{g}}$ = {GLUE:.3f} N", 1.5 + 0.12 / UNIT, BOND)):
                note(top, text, (0.0, y), colour=colour)
        middle = (1.25 + 0.5 * n) * UNIT
        balance(stage(fig, (left, 2.1, width, 1.1), 1.0, (-middle, -0.85)), net_tile_force(n),
                net_glue_force(n, GLUE), INCH, ORANGE,
                (-0.4 - 0.1 * n, -0.8, np.hypot(*net_tile_force(n)) / INCH + 0.25, 0.15))
    _scaling(fig.add_axes((0.125, 0.085, 0.855, 0.31)))
    return fig


def _block(ax: Axes, n: int) -> None:
    tiles = block(n)
    push = LOAD / ARROW * np.array([math.cos(PHASE), math.sin(PHASE)])
    for site, held, colour in zip(tiles.site, tiles.held, tiles.colour(), strict=True):
        tile(ax, PAPER.types[colour], *site, magnets=False, seed=bool(held))
        if not held:
            arrow(ax, site - 0.5 * push, push, ORANGE, 1.1, 6.0, halo=False)
    bonds(ax, n)


def _scaling(ax: Axes) -> None:
    n, whole = np.linspace(0.0, LARGEST, 121), np.arange(1, LARGEST + 1)
    ax.axvspan(0.0, LIMIT, color=HELD, lw=0)
    ax.plot(n, n**2 * LOAD, color=ORANGE, linestyle=(0, (4, 1.5)))
    ax.plot(n, n * GLUE, color=BOND)
    spread = [imbalance_of_turns(k * k // 2, (k * k + 1) // 2, 0.5)[1] * LOAD for k in whole]
    ax.plot(whole, spread, color=BLUE, linestyle=":")
    ax.plot(whole, [imbalance_of_block(k) * LOAD for k in whole], "o", color=BLUE, markersize=3.5,
            clip_on=False, zorder=4)
    for letter, side in zip("ab", SIZES, strict=True):
        net = float(np.linalg.norm(net_tile_force(side)))
        ax.plot([side], [net], "s", color=ORANGE, markersize=3.5)
        note(ax, letter, (side + 0.028 * LARGEST, net - 0.01 * MOST), weight="bold", size=8)
    ax.set(xlim=(0, LARGEST), ylim=(0, MOST), xlabel="side $n_\\mathrm{s}$ of the block (tiles)",
           ylabel="net force along an axis (N)")
    ax.spines[["top", "right"]].set_visible(False)
    ax.annotate("c", (0.0, 1.0), (3, -2), xycoords="axes fraction", textcoords="offset points",
                fontsize=8, weight="bold", va="top")
    note(ax, f"shaken: held up to\n$F_\\mathrm{{g}}/F$ = {LIMIT:.1f} tiles",
         (0.5 * LIMIT, 0.75 * MOST))
    note(ax, "shaken: $n_\\mathrm{s}^2F$",  # on the left of its curve
         (math.sqrt(0.86 * MOST / LOAD) - 0.02 * LARGEST, 0.91 * MOST), colour=ORANGE, ha="right")
    for text, at, colour in (
            ("bonds: $n_\\mathrm{s}F_\\mathrm{g}$", (0.8, 0.81), BOND),
            ("two families,\nrandom half turns: $n_\\mathrm{s}F$", (0.82, 0.41), BLUE),
            ("headings alike: 0 or $F$", (0.83, 0.1), BLUE)):
        note(ax, text, (at[0] * LARGEST, at[1] * MOST), colour=colour)
