"""Pictures of a record: the tiles, the bonds, the reactor, and what has assembled.

Everything is drawn through matplotlib's objects, never through pyplot, so that a picture needs
no display and leaves no state behind.  A file appears under its name only when it is complete.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import is_color_like, to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.textpath import TextPath
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D, AffineDeltaTransform

from tbsa.errors import InputError
from tbsa.model.layout import Layout
from tbsa.model.records import check_may_be_written, write_atomically
from tbsa.model.scene import EDGES, Scene, check_is_scene
from tbsa.model.squares import lattice
from tbsa.model.tiles import Growth
from tbsa.work.metrics import (
    CORNERS,
    EDGE_ANGLE,
    Assembly,
    Floats,
    Mask,
    assembly,
    number_of,
    truth_of,
)

if TYPE_CHECKING:
    import pandas as pd

CM = 100.0  # the axes are in centimetres
FORMATS = (".png", ".svg", ".pdf")
DPI = 200

FLOOR = "#dededc"
FADE = 0.58  # how far the colour of a tile outside the assembly fades towards the floor's
EDGE = "#202020"
OUTLINES = "#9a9a98", "#3c3c3c"  # of tiles outside the assembly, and of its own
BOND = "#0a7d3b"
ERROR = "#d62728"
LINES = (("#0b5fa5", "-"), ("#d9730d", "--"), ("#5b8c2a", "-."), ("#8a4a9e", ":"))
MOST = len(LINES) ** 2  # curves that can be told apart: each colour with each dash


MARKS = {  # colour and shape in the legend of what is marked
    "error": (ERROR, "x"),
    "hole": (ERROR, "s"),
    "wrongly turned": ("#e08214", "o"),
    "off the lattice": ("#7b3294", "D"),
    "outside the pattern": ("#2166ac", "^"),
}
# Places of a legend, neither with tiles: below all, and below the label of the x axis.
OUTSIDE: dict[str, Any] = {"loc": "outside lower center", "frameon": False}
BELOW: dict[str, Any] = {
    "loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.4,
    "columnspacing": 0.9, "handlelength": 1.0, "handletextpad": 0.4, "fontsize": "small",
    "frameon": False}
LEGEND_ROW = 0.2  # in, of `OUTSIDE`
ROOM = 1.15  # width of title and legend, in given axes' own: beside them may be others, 0.2 further
SMALLEST = 6.0  # pt, of such a title


class Snapshot(NamedTuple):
    """One record, as :func:`sheet` and :func:`summary_figure` take it: m, rad and s."""

    layout: Layout
    x: Floats
    y: Floats
    angle: Floats
    time: float | None = None


def draw(
    scene: Scene,
    layout: Layout,
    x: Floats,
    y: Floats,
    angle: Floats,
    *,
    path: str | Path | None = None,
    time: float | None = None,
    ax: Axes | None = None,
    glues: bool = False,
    bonds: bool = True,
    headings: bool = True,
    metrics: bool = True,
    truth: Growth | None = None,
) -> Figure:
    """Draw one record, into a file if `path` is given.

    Tiles of the seed carry a dot, tiles of the assembly are drawn in full colour with a dark
    outline, all others are faded.  Erroneous tiles are crossed; tiles that are wrongly turned,
    off the lattice or outside the ground truth carry a mark of their own; holes are framed.

    Parameters
    ----------
    x, y, angle
        Positions (m) and angles (rad), float64[n] in the layout's order.
    path
        A file ending in one of `FORMATS`; replaced in one go when the picture is complete.
    time
        Of the record (s), for the title.
    ax
        Draw into these axes, instead of a figure of its own.
    glues, bonds, headings, metrics
        Draw glue labels; a bar across every bond; a triangle towards the forward edge of every
        driven tile; the assembly, its errors and its metrics (without, all tiles look alike).
    truth
        As in :func:`tbsa.work.metrics.assembly`.

    Raises
    ------
    InputError
        A colour that matplotlib does not know, a path of another ending or in no folder.
    """
    check_is_scene(scene)
    file = None if path is None else target(path)
    tall = 7.3 + 5.9 * (aspect(scene, x, y) - 1.0)
    own = Figure(figsize=(7.0, tall), layout="constrained") if ax is None else None
    panel = own.add_subplot() if own is not None else ax
    assert panel is not None
    record = Snapshot(layout, x, y, angle, time)
    count = _panel(panel, scene, record, glues, bonds, headings, metrics, truth)
    figure = panel.get_figure(root=True)
    assert figure is not None
    if own is not None:
        rows = _legend(own, figure, count, True, OUTSIDE)
        own.set_figheight(tall + LEGEND_ROW * max(rows - 1, 0))
        _settle(own)
    else:
        slot = panel.get_position(original=True).transformed(panel.figure.transSubfigure)
        room, wide = ROOM * slot.width, panel.title.get_window_extent().width
        if wide > room:
            size = float(panel.title.get_fontsize()) * room / wide
            panel.title.set_fontsize(max(SMALLEST, size))
        _legend(panel, figure, count, True, BELOW, room)
    if file is not None:
        _save(figure, file)
    return figure


def sheet(
    scene: Scene,
    panels: Sequence[Snapshot],
    path: str | Path | None = None,
    *,
    glues: bool = False,
    bonds: bool = False,
    headings: bool = False,
    metrics: bool = True,
) -> Figure:
    """Draw snapshots of one run side by side, at most four in a row.

    Parameters
    ----------
    panels
        The records, in the order of the panels.
    path, glues, bonds, headings, metrics
        As in :func:`draw`; bonds and headings are too small to be read in most sheets.

    Raises
    ------
    InputError
        As :func:`draw`; or there are no panels.
    """
    file = None if path is None else target(path)
    if not panels:
        raise InputError("must have at least one snapshot", field="panels", value=list(panels))
    columns = min(len(panels), 3 if len(panels) in (3, 5, 6, 9) else 4)
    rows = -(-len(panels) // columns)
    tallest = max(aspect(scene, panel.x, panel.y) for panel in panels)
    tall = (4.0 + 3.1 * (tallest - 1.0)) * rows + 0.4
    figure = Figure(figsize=(3.6 * columns, tall), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flat
    marked: dict[str, int] = {}
    truth = truth_of(scene)
    for k, panel in enumerate(panels):
        marked |= _panel(axes[k], scene, panel, glues, bonds, headings, metrics, truth)
        below, left = k + columns >= len(panels), k % columns == 0  # no other panel there
        axes[k].tick_params(labelbottom=below, labelleft=left)
        axes[k].set(xlabel="x (cm)" if below else "", ylabel="y (cm)" if left else "")
        axes[k].xaxis.set_major_locator(MaxNLocator(7, steps=(1, 2, 5, 10), prune="both"))
        axes[k].set_title(axes[k].get_title(), fontsize="medium")
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    _legend(figure, figure, marked, False, OUTSIDE)
    _settle(figure)
    if file is not None:
        _save(figure, file)
    return figure


def summary_figure(
    tables: Mapping[str, pd.DataFrame],
    snapshots: Mapping[str, tuple[Scene, Snapshot]],
    path: str | Path | None = None,
) -> Figure:
    """Runs compared: their snapshots above size, errors and holes against time.

    Parameters
    ----------
    tables
        Of :func:`tbsa.work.metrics.table`, by the name of the run.
    snapshots
        A scene and a record of it, by the name of the run; runs without one are only plotted.

    Raises
    ------
    InputError
        As :func:`draw`; or there are no tables, more than `MOST`, or a snapshot of a run without a
        table.
    """
    file = None if path is None else target(path)
    if not tables or not set(snapshots) <= set(tables):
        raise InputError(
            f"must name runs that have a table: {', '.join(tables) or 'there is none'}",
            field="snapshots",
            value=list(snapshots),
        )
    if len(tables) > MOST:
        raise InputError(f"must be at most {MOST}, or curves look alike", field="tables",
                         value=len(tables))
    figure = Figure(figsize=(11.0, 9.2 if snapshots else 3.4), layout="constrained")
    below: Figure | SubFigure = figure
    if snapshots:
        top, below = figure.subfigures(2, 1, height_ratios=(1.9, 1.0), squeeze=False).flat
        above = top.subplots(1, len(snapshots), squeeze=False).flat
        marked: dict[str, int] = {}
        for ax, (name, (scene, record)) in zip(above, snapshots.items(), strict=True):
            marked |= _panel(ax, scene, record, False, False, False, True)
            ax.set_title(", ".join(filter(None, (name, ax.get_title()))))
        _legend(top, figure, marked, False, OUTSIDE)
    axes = below.subplots(1, 3)
    for k, (name, rows) in enumerate(tables.items()):
        again, of = divmod(k, len(LINES))
        hue, dash = LINES[of][0], LINES[(of + again) % len(LINES)][1]
        for ax, column in zip(axes, ("size", "errors_percent", "holes_percent"), strict=True):
            # Unclipped: a curve along zero would lose half its width to the axis.
            ax.plot(rows["time"], rows[column], color=hue, linestyle=dash, label=name,
                    clip_on=False, zorder=3)
    end = max((float(rows["time"].max()) for rows in tables.values() if len(rows)), default=0.0)
    what = ("attached tiles", "errors (% of attached)", "holes (% of attached)")
    for ax, label in zip(axes, what, strict=True):
        ax.set(xlabel="time (s)", ylabel=label, xlim=(0.0, max(end, 1e-9)))
        ax.set_ylim(bottom=0.0, top=max(ax.get_ylim()[1], 1.0))
        ax.grid(color="#d8d8d8", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    # Curves and names, as a legend looks for itself only for labels without a leading underscore.
    below.legend(axes[0].get_lines(), list(tables), ncols=4, **OUTSIDE)
    _settle(figure)
    if file is not None:
        _save(figure, file)
    return figure


def _panel(
    ax: Axes,
    scene: Scene,
    record: Snapshot,
    glues: bool,
    bonds: bool,
    headings: bool,
    metrics: bool,
    truth: Growth | None = None,
) -> dict[str, int]:
    """One record in one pair of axes; how many there are of each of `MARKS` that occurs."""
    layout, time = record.layout, record.time
    colour = colours(scene)[layout.type]
    found = assembly(scene, layout, record.x, record.y, record.angle, truth)
    x, y, angle = (np.asarray(each, dtype=np.float64) for each in record[1:4])
    member = found.attached | found.seed if metrics else np.ones_like(found.seed)

    _reactor(ax, scene)
    shown = np.where(member[:, None], colour, faded(colour))
    marks = ink(shown)
    _tiles(ax, scene, x, y, angle, shown, member)
    if headings:
        driven = np.array([kind.family != 0 for kind in scene.types])[layout.type] & ~layout.held
        size = 0.7 if glues else 1.0
        _headings(ax, scene, layout, x, y, angle, driven, marks, size)
    if glues:
        _labels(ax, scene, layout, x, y, angle, marks)
    if bonds:
        _bonds(ax, scene, x, y, angle, found, reach=0.06 if glues else 0.15)
    _dots(ax, scene, x, y, found.seed, marks)
    frame(ax, scene, x, y)
    ax.set_title(_title(scene, found, time, metrics))
    return _marks(ax, scene, x, y, found) if metrics else {}


def check_colours(scene: Scene) -> None:
    """The colours of the tile types can be drawn; a run does without.

    Raises
    ------
    InputError
        Where one cannot.
    """
    for k, kind in enumerate(scene.types):
        if not is_color_like(kind.colour) or kind.colour.lower() == "none":
            raise InputError(
                f"is not a colour that can be drawn (tile type {kind.name!r}): must be a name "
                "such as 'black', 'white' or 'tab:blue', or '#rrggbb'",
                file=scene.file or None,
                field=f"tiles.type[{k}].colour",
                value=kind.colour,
            )


def colours(scene: Scene) -> Floats:
    """float64[types, 3]: red, green and blue of every tile type."""
    check_colours(scene)
    return np.array([to_rgb(kind.colour) for kind in scene.types])


def palette(scene: Scene) -> Floats:
    """Every colour that a picture of a scene may have, float64[n, 3], apart from the shades
    between two of them."""
    own = colours(scene)
    shown = np.concatenate([own, faded(own)])
    names = "white", FLOOR, EDGE, BOND, *OUTLINES, *(colour for colour, _ in MARKS.values())
    every = np.concatenate([shown, ink(shown), [to_rgb(name) for name in names]])
    return np.unique(every, axis=0)


def faded(colour: Floats) -> Floats:
    """Colours mixed with the floor's."""
    return (1.0 - FADE) * colour + FADE * np.array(to_rgb(FLOOR))


def ink(colour: Floats) -> Floats:
    """Dark or light, float64[n, 3], what shows on such colours, by their brightness (BT.709)."""
    bright = colour @ np.array([0.2126, 0.7152, 0.0722]) > 0.4
    return np.where(bright[:, None], to_rgb(EDGE), to_rgb("#f4f4f4"))


def _stamp(
    ax: Axes,
    scene: Scene,
    shape: Floats,
    x: Floats,
    y: Floats,
    angle: Floats,
    colour: Any,
    *,
    zorder: float = 2.0,
    name: str = "",
) -> None:
    """Fill one shape, float64[p, 2] in tile widths, at every position (m) and angle (rad).

    All marks are such shapes, not lines and markers in points: they scale with the tiles.
    """
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    px, py = scene.material.width * shape.T
    points = np.stack([x[:, None] + px * cos - py * sin, y[:, None] + px * sin + py * cos], axis=-1)
    marks = PolyCollection(list(CM * points), facecolors=colour, edgecolors="none", zorder=zorder)
    marks.set_gid(name or None)
    marks.set_snap(False)  # edges rounded to pixels would make equal marks look different
    ax.add_collection(marks, autolim=False)


def _tiles(
    ax: Axes, scene: Scene, x: Floats, y: Floats, angle: Floats, colour: Floats, member: Mask
) -> None:
    """Squares with an outline that shows white tiles on white and black ones on black."""
    parts = zip((~member, member), OUTLINES, (0.03, 0.05), strict=True)
    for tiles, outline, thickness in parts:
        pose = x[tiles], y[tiles], angle[tiles]
        _stamp(ax, scene, CORNERS, *pose, outline)
        _stamp(ax, scene, (1.0 - 2.0 * thickness) * CORNERS, *pose, colour[tiles], name="tiles")


def _headings(
    ax: Axes,
    scene: Scene,
    layout: Layout,
    x: Floats,
    y: Floats,
    angle: Floats,
    tiles: Mask,
    ink: Floats,
    size: float,
) -> None:
    """A triangle towards the forward edge of the given tiles, so slim that its tip is plain."""
    forward = EDGE_ANGLE[[EDGES.index(kind.forward) for kind in scene.types]][layout.type]
    triangle = size * np.array([[0.28, 0.0], [-0.16, 0.13], [-0.16, -0.13]])
    heading = (angle + forward)[tiles]
    _stamp(ax, scene, triangle, x[tiles], y[tiles], heading, ink[tiles], name="headings")


def _dots(ax: Axes, scene: Scene, x: Floats, y: Floats, seed: Mask, ink: Floats) -> None:
    """A dot on every tile of the seed."""
    _stamp(ax, scene, _polygon(24, 0.17), x[seed], y[seed], np.zeros(seed.sum()), ink[seed])


def _bonds(
    ax: Axes, scene: Scene, x: Floats, y: Floats, angle: Floats, found: Assembly, reach: float
) -> None:
    """A short bar across every bonded pair of edges, `reach` tile widths into either tile."""
    a, edge_a, b, edge_b = found.bonded.T
    half = 0.5 * scene.material.width
    ends = []
    for tile, edge in ((a, edge_a), (b, edge_b)):
        outward = angle[tile] + EDGE_ANGLE[edge]
        ends.append((x[tile] + half * np.cos(outward), y[tile] + half * np.sin(outward)))
    (xa, ya), (xb, yb) = ends
    across = angle[a] + EDGE_ANGLE[edge_a]
    middle = 0.5 * (xa + xb), 0.5 * (ya + yb), across
    for rim, colour in ((0.02, "white"), (0.0, BOND)):
        bar = 2.0 * CORNERS * [reach + rim, 0.05 + rim]
        _stamp(ax, scene, bar, *middle, colour, zorder=3.0, name="bonds")


def _labels(
    ax: Axes, scene: Scene, layout: Layout, x: Floats, y: Floats, angle: Floats, ink: Floats
) -> None:
    """The glue of every magnet inside its edge, upright, one collection a label."""
    width = scene.material.width
    glue = np.array([kind.glues for kind in scene.types])[layout.type]
    outward = angle[:, None] + EDGE_ANGLE
    px = x[:, None] + 0.32 * width * np.cos(outward)
    py = y[:, None] + 0.32 * width * np.sin(outward)
    for value in np.unique(glue[glue != 0]).tolist():
        text = f"{value:+d}".replace("-", "\N{MINUS SIGN}")
        label = TextPath((0.0, 0.0), text, size=1.0, prop=FontProperties(weight="bold"))
        box = label.get_extents()
        centre = -0.5 * (box.p0 + box.p1)
        size = min(0.17, 0.27 / box.width)  # or long ones would run under the dot and beyond
        to_size = Affine2D().translate(*centre).scale(size * CM * width)
        tile, edge = np.nonzero(glue == value)
        marks = PathCollection(
            [to_size.transform_path(label)],
            offsets=CM * np.stack([px[tile, edge], py[tile, edge]], axis=-1),
            offset_transform=ax.transData,
            transform=AffineDeltaTransform(ax.transData),  # type: ignore[arg-type]
            facecolors=ink[tile],
            edgecolors="none",
            zorder=3.5,
        )
        ax.add_collection(marks, autolim=False)


def _marks(ax: Axes, scene: Scene, x: Floats, y: Floats, found: Assembly) -> dict[str, int]:
    """Mark what is wrong, told apart by shape; how many there are of each mark."""
    rims = (0.02, "white"), (0.0, "")  # a tile may have the colour of its mark

    def rings(corners: int, turned: float) -> list[tuple[Floats, float, str]]:
        return [(_ring(corners, 0.42 + rim / np.cos(np.pi / corners), 0.1 + 2.0 * rim), turned,
                 colour) for rim, colour in rims]

    shapes = {
        "error": (found.erroneous, [
            (2.0 * CORNERS * [0.42 + rim, 0.07 + rim], turned, colour)
            for rim, colour in rims for turned in (np.pi / 4, -np.pi / 4)]),
        "wrongly turned": (found.wrongly_turned, rings(32, 0.0)),
        "off the lattice": (found.off_lattice, rings(4, 0.0)),
        "outside the pattern": (found.outside, rings(3, np.pi / 2)),
    }
    count = {name: int(tiles.sum()) for name, (tiles, _) in shapes.items()} | {"hole": found.holes}
    for name, (tiles, parts) in shapes.items():
        for shape, turned, colour in parts:
            angle = np.full(count[name], turned)
            _stamp(ax, scene, shape, x[tiles], y[tiles], angle, colour or MARKS[name][0],
                   zorder=4.0)
    if scene.seed is not None:
        at = lattice(scene.seed, scene.material.width, *found.hole_sites.T)
        angle = np.full(found.holes, scene.seed.angle + np.pi / 4)
        square = _ring(4, 0.45 * np.sqrt(2.0), 0.14)  # bold, as the cells of a sheet are small
        _stamp(ax, scene, square, *at, angle, MARKS["hole"][0], zorder=4.0)
    return {name: count[name] for name in MARKS if count[name]}


def _legend(
    owner: Axes | Figure | SubFigure, figure: Figure, count: dict[str, int], numbers: bool,
    place: Mapping[str, Any], room: float = np.inf,
) -> int:
    """Name the marks that occur, in as few rows as fit into the figure and the room (pixels); how
    many rows."""
    handles, wide = _handles(count, numbers), figure.bbox.width
    for rows in range(1, len(handles) + 1):
        legend = owner.legend(handles=handles, ncols=-(-len(handles) // rows), **place)
        box = legend.get_window_extent()
        fits = 0.01 * wide <= box.x0 <= box.x1 <= 0.99 * wide and box.width <= room
        if rows == len(handles) or fits:
            return rows
        legend.remove()
    return 0


def _settle(figure: Figure) -> None:
    """Lay a figure out as it stays: axes of a given shape need more than one pass, and with the
    single one of a first drawing titles and legends may run out of the picture."""
    for _ in range(2):
        figure.draw_without_rendering()


def _handles(count: dict[str, int], numbers: bool) -> list[Line2D]:
    """Legend entries of the marks that occur."""
    return [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=MARKS[name][1],
            markerfacecolor="none",
            markeredgecolor=MARKS[name][0],
            markeredgewidth=1.5,
            label=f"{name} ({number})" if numbers else name,
        )
        for name, number in count.items()
    ]


def _polygon(corners: int, radius: float) -> Floats:
    """A regular polygon with a corner on +x."""
    around = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    return radius * np.stack([np.cos(around), np.sin(around)], axis=-1)


def _ring(corners: int, radius: float = 0.42, thickness: float = 0.1) -> Floats:
    """A regular polygon's outline, as one shape that goes round outside and back inside."""
    outer = _polygon(corners, radius)
    inner = _polygon(corners, radius - thickness / np.cos(np.pi / corners))
    return np.concatenate([outer, outer[:1], inner[:1], inner[::-1]])


def _reactor(ax: Axes, scene: Scene) -> None:
    """The floor and the wall."""
    wall = scene.reactor
    look: dict[str, Any] = {"facecolor": FLOOR, "edgecolor": EDGE, "linewidth": 1.8, "zorder": 0.5}
    if wall is None:
        ax.set_facecolor(FLOOR)
    elif wall.shape == "circle":
        ax.add_patch(Circle((0.0, 0.0), CM * wall.radius, **look))
    else:
        w, h = CM * wall.width, CM * wall.height
        ax.add_patch(Rectangle((-0.5 * w, -0.5 * h), w, h, **look))


def extent(scene: Scene, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Least and greatest x and y (cm) of the reactor, or of the tiles if there is none."""
    wall = scene.reactor
    if wall is None:
        margin = CM * scene.material.width
        low = CM * np.array([x.min(initial=np.inf), y.min(initial=np.inf)]) - margin
        return low, CM * np.array([x.max(initial=-np.inf), y.max(initial=-np.inf)]) + margin
    half = [wall.radius] * 2 if wall.shape == "circle" else [wall.width / 2, wall.height / 2]
    high = 1.02 * CM * np.array(half)
    return -high, high


def aspect(scene: Scene, x: Floats, y: Floats) -> float:
    """Height over width of it, within what makes a picture: more leaves room at the sides."""
    low, high = extent(scene, x, y)
    wide, tall = high - low
    return float(np.clip(tall / wide, 0.3, 2.0))


def frame(ax: Axes, scene: Scene, x: Floats, y: Floats) -> None:
    """Equal axes in cm around it."""
    low, high = extent(scene, x, y)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set(xlabel="x (cm)", ylabel="y (cm)")


def _title(scene: Scene, found: Assembly, time: float | None, metrics: bool) -> str:
    """Time and metrics."""
    parts = []
    if metrics and scene.seed is not None:
        parts.append(f"{number_of(found.size, 'tile')} attached")
        if found.size:
            parts.append(f"errors {found.percent(found.errors):.1f} %")
            parts.append(f"holes {found.percent(found.holes):.1f} %")
    clock = [] if time is None else [f"t = {time:.10g} s"]
    return "\n".join([*clock, ", ".join(parts)] if parts else clock)


def target(path: str | Path, formats: tuple[str, ...] = FORMATS) -> Path:
    """The path of a picture, or of another file, checked before any work is done."""
    path = Path(path)
    if path.suffix.lower() not in formats:
        raise InputError(f"must end in {', '.join(formats)}", field="path", value=str(path))
    check_may_be_written(path, "path")
    return path


def _save(figure: Figure, path: Path) -> None:
    """Write a picture, all of it or nothing.

    The same picture gives the same bytes: no date, and ids in SVG that are not random.
    """
    kind = path.suffix.lower().removeprefix(".")
    undated: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    picture = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "tbsa"}):
        figure.savefig(picture, format=kind, dpi=DPI, metadata=undated[kind])
    write_atomically(path, picture.getvalue())
