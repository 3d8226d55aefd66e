"""What the schematics are drawn with: tiles, magnets, arrows and notes, in tile widths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon, Rectangle
from matplotlib.patheffects import Stroke
from matplotlib.text import Annotation
from matplotlib.transforms import Affine2D

import tbsa
from figures.style import COLUMN, figure
from tbsa.model.scene import Scene, TileType
from tbsa.work.draw import BOND, EDGE
from tbsa.work.draw import ink as ink_on
from tbsa.work.metrics import CORNERS, EDGE_ANGLE
from theory.magnets import Law

PAPER = tbsa.load(Path(__file__).parents[1] / "paper_runs" / "self_stabilizing.toml")
BLACK, WHITE = PAPER.types
LABEL = 7.0  # pt
MAGNET = "#aab4bd"
FAINT = "#8c8c8c"  # lines that point and measure
HELD = "#e2efe6"  # behind what is held
Point = tuple[float, float]


def law(scene: Scene = PAPER) -> Law:
    """The scene's magnets as theory takes them."""
    magnet = scene.magnet
    assert magnet is not None
    return Law(magnet.alpha, magnet.beta, scene.material.width, magnet.inset, magnet.cutoff,
               magnet.switch, magnet.mismatch)


def canvas(height: float) -> Figure:
    """A figure of a column's width whose stages are placed by hand."""
    fig = figure(height, COLUMN)
    fig.set_layout_engine("none")
    return fig


def stage(fig: Figure, box: tuple[float, float, float, float], unit: float,
          origin: Point = (0.0, 0.0), name: str = "") -> Axes:
    """Axes without a frame; `box` is left, bottom, width, height, and `unit` a tile's width (in).

    `origin` is the place, in tile widths, of the lower left corner; `name` is that of the panel.
    """
    left, bottom, width, height = box
    w, h = fig.get_size_inches()
    ax = fig.add_axes((left / w, bottom / h, width / w, height / h))
    ax.set(xlim=(origin[0], origin[0] + width / unit), ylim=(origin[1], origin[1] + height / unit))
    ax.set_axis_off()
    if name:
        letter, _, title = name.partition(" ")
        ax.annotate(letter, (0.0, 1.0), (2, -2), xycoords="axes fraction", fontsize=8,
                    textcoords="offset points", weight="bold", va="top")
        ax.annotate(title, (0.0, 1.0), (12, -2), xycoords="axes fraction", fontsize=8,
                    textcoords="offset points", va="top")
    return ax


def tint(colour: str, pale: bool = True) -> tuple[float, float, float]:
    """The colour of a tile; pale where arrows and labels are to be read on it."""
    r, g, b = (0.18 * part + 0.82 for part in to_rgb(colour)) if pale else to_rgb(colour)
    return r, g, b


def ink(colour: tuple[float, float, float]) -> str:
    """What is read on a colour: nearly black or nearly white."""
    return to_hex(ink_on(np.array([colour]))[0])


def tile(ax: Axes, kind: TileType, x: float, y: float, angle: float = 0.0, *, pale: bool = True,
         seed: bool = False, heading: bool = False, magnets: bool = True, glues: str = "",
         size: float = LABEL, zorder: float = 2.0) -> None:
    """A tile at its place in tile widths and its angle in rad.

    Parameters
    ----------
    seed, heading, magnets
        A dot; a triangle towards the forward edge; the magnets, inset as in the paper's scene.
    glues
        The edges, out of "NESW", whose glues are printed.
    size
        Of the printed glues (pt).
    """
    place = Affine2D().rotate(angle).translate(x, y)
    face = tint(kind.colour, pale)
    outline = ink(face)
    fig = ax.get_figure(root=True)
    assert fig is not None
    across = 72.0 * ax.get_position().width * fig.get_figwidth()  # pt
    unit = across / float(np.ptp(ax.get_xlim()))
    half = size / unit * np.array([0.62, 0.38])  # of a label

    def fill(shape: Any, colour: Any, edge: str = "none", lw: float = 0.0) -> None:
        ax.add_patch(Polygon(place.transform(np.asarray(shape)), closed=True, facecolor=colour,
                             edgecolor=edge, linewidth=lw, zorder=zorder))

    fill(CORNERS, face, EDGE, min(0.7, 0.04 * unit))
    assert PAPER.magnet is not None
    inset = PAPER.magnet.inset / PAPER.material.width
    for glue, outward, edge in zip(kind.glues, EDGE_ANGLE, "NESW", strict=True):
        out, along = np.array([math.cos(outward), math.sin(outward)]), np.array(
            [-math.sin(outward), math.cos(outward)])
        if magnets and glue:
            fill((0.5 - inset) * out + 2.0 * CORNERS @ np.array([inset * out, 0.1 * along]),
                 MAGNET, EDGE, 0.4)
        if edge in glues:
            facing = np.abs(Affine2D().rotate(angle).transform(out))
            px, py = place.transform((0.47 - 2.0 * inset - facing @ half) * out)
            ax.text(px, py, signed(glue), fontsize=size, color=outline, ha="center",
                    va="center_baseline", zorder=zorder + 0.2)
    if heading:
        towards(ax, (x, y), angle + EDGE_ANGLE["NESW".index(kind.forward)], outline, zorder=zorder)
    if seed:
        ax.add_patch(Circle((x, y), 0.12, color=outline, linewidth=0, zorder=zorder))


def towards(ax: Axes, at: Point, angle: float, colour: str, size: float = 0.15,
            zorder: float = 3.0) -> None:
    """A triangle that points along a heading (rad)."""
    corners = size * np.array([[1.0, 0.0], [-0.67, 0.83], [-0.67, -0.83]])
    ax.add_patch(Polygon(Affine2D().rotate(angle).translate(*at).transform(corners),
                         facecolor=colour, linewidth=0, zorder=zorder))


def signed(glue: int) -> str:
    """A glue's label, with a true minus sign."""
    return f"{glue:+d}".replace("-", "\N{MINUS SIGN}")


def arrow(ax: Axes, start: Sequence[float], vector: Sequence[float], colour: str,
          lw: float = 1.2, head: float = 7.0, style: str = "-|>", halo: bool = True,
          zorder: float = 4.0) -> None:
    """An arrow from `start` by `vector`, with a white rim that parts it from what is below."""
    (x, y), (dx, dy) = start, vector
    for rim in (True, False) if halo else (False,):
        shaft = FancyArrowPatch(
            (x, y), (x + dx, y + dy), arrowstyle=style, mutation_scale=head,
            color="white" if rim else colour, linewidth=lw, shrinkA=0, shrinkB=0,
            joinstyle="miter", capstyle="butt", zorder=zorder)
        if rim:
            shaft.set_path_effects([Stroke(linewidth=lw + 1.6, foreground="white")])
        ax.add_patch(shaft)


def spin(ax: Axes, centre: Point, sense: float, colour: str, radius: float = 0.3,
         first: float = 30.0, sweep: float = 250.0, lw: float = 1.0, head: float = 5.0) -> None:
    """A round arrow, counter-clockwise where `sense` is positive; angles in degrees."""
    ends = np.radians([first, first + sweep] if sense > 0 else [first + sweep, first])
    ax.add_patch(Arc(centre, 2 * radius, 2 * radius, theta1=first, theta2=first + sweep,
                     color=colour, linewidth=lw, zorder=4.0))
    tip = np.array(centre) + radius * np.array([np.cos(ends[1]), np.sin(ends[1])])
    ahead = math.copysign(1.0, sense) * np.array([-np.sin(ends[1]), np.cos(ends[1])])
    arrow(ax, tip - 0.01 * ahead, 0.12 * ahead, colour, lw, head, halo=False)


def note(ax: Axes, text: str, at: Point, to: Point | None = None, *, size: float = LABEL,
         colour: str = "#202020", ha: str = "center", va: str = "center",
         **look: Any) -> Annotation:
    """Text at a place, with a thin line to what it names."""
    line = {"arrowstyle": "-", "color": FAINT, "lw": 0.6, "shrinkA": 1.0, "shrinkB": 0.0}
    return ax.annotate(text, at if to is None else to, at, fontsize=size, color=colour, ha=ha,
                       va=va, arrowprops=None if to is None else line, annotation_clip=False,
                       zorder=6.0, linespacing=1.15, **look)


def bonds(ax: Axes, n: int) -> None:
    """The bonds of an n x n block, its first tile at (0, 0), with the two sides of its seed."""
    for k in range(n):
        for at, size in (((-0.62, k - 0.05), (0.24, 0.1)), ((k - 0.05, -0.62), (0.1, 0.24))):
            ax.add_patch(Rectangle(at, *size, facecolor=BOND, edgecolor="white", lw=0.6, zorder=3))


def balance(ax: Axes, push: Any, glue: Any, inch: float, colour: str,
            box: tuple[float, float, float, float]) -> None:
    """Net tile force and net glue force (N) from one point, and their sum.

    `inch` is the force that is drawn an inch long in axes whose unit is an inch; `box` is the
    left, low, right and high end of the axes.  The third quadrant is shaded.
    """
    left, low, right, high = box
    ax.add_patch(Rectangle((left, low), -left, -low, color=HELD, lw=0, zorder=0))
    ax.plot((left, right), (0.0, 0.0), color=FAINT, lw=0.6, zorder=1)
    ax.plot((0.0, 0.0), (low, high), color=FAINT, lw=0.6, zorder=1)
    push, glue = np.asarray(push) / inch, np.asarray(glue) / inch
    arrow(ax, (0, 0), glue, BOND, 1.8, 8.0)
    if np.hypot(*push) < 1e-9:
        note(ax, "$F_\\mathrm{nt}$ = 0", (0.07, 0.1), size=8, colour=colour, ha="left")
    else:
        arrow(ax, (0, 0), push, colour, 1.8, 8.0)
        arrow(ax, (0, 0), push + glue, "black", 1.8, 8.0)
        upright = abs(push[1]) > abs(push[0])
        note(ax, "$F_\\mathrm{nt}$", tuple(push + ((0.13, 0.02) if upright else (0.02, 0.1))),
             size=8, colour=colour)
        note(ax, "sum", tuple((push + glue) * (1.0 + 0.17 / np.hypot(*(push + glue)))), size=8)
    across = np.array([-glue[1], glue[0]]) / np.hypot(*glue)  # away from the sum
    side = 0.13 if across @ push <= 0.0 else -0.13
    note(ax, "$F_\\mathrm{ng}$", tuple(0.6 * glue + side * across), size=8, colour=BOND)


def extent(ax: Axes, a: Point, b: Point, text: str, at: Point, **look: Any) -> None:
    """A length from a to b, with short bars at its ends, and what it is."""
    ax.annotate("", b, a, arrowprops={"arrowstyle": "|-|,widthA=0.25,widthB=0.25", "lw": 0.6,
                                      "color": FAINT, "shrinkA": 0, "shrinkB": 0},
                annotation_clip=False, zorder=5.0)
    note(ax, text, at, **look)


def bristle_bot(ax: Axes, kind: TileType, x: float, y: float, lean: float) -> None:
    """A tile on its bristle drive, from the side, on a floor at height y.

    The feet of the bristles are `lean` tile widths off their roots; vibration moves the tile away
    from where they point.
    """
    assert PAPER.magnet is not None
    inset = PAPER.magnet.inset / PAPER.material.width
    for root in np.linspace(-0.34, 0.34, 7):
        ax.plot([x + root, x + root + lean], [y + 0.3, y], color="#404040", lw=1.0, zorder=2.5,
                solid_capstyle="round")
    face = tint(kind.colour)
    ax.add_patch(Rectangle((x - 0.44, y + 0.28), 0.88, 0.1, facecolor="#7a7a7a", edgecolor=EDGE,
                           lw=0.6, zorder=3))
    ax.add_patch(Rectangle((x - 0.5, y + 0.38), 1.0, 0.26, facecolor=face, edgecolor=EDGE, lw=0.7,
                           zorder=3))
    for left in (x - 0.5, x + 0.5 - 2.0 * inset):
        ax.add_patch(Rectangle((left, y + 0.45), 2.0 * inset, 0.12, facecolor=MAGNET,
                               edgecolor=EDGE, lw=0.4, zorder=3.1))
