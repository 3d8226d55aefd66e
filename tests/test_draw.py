"""What a picture shows, and that it is written whole or not at all."""

import itertools
import math
import subprocess
import sys
from dataclasses import replace

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from tbsa.errors import InputError
from tbsa.model.layout import initial_layout
from tbsa.model.scene import SETS, Free, Magnet, PlacedTile, Reactor, Scene, Seed, TileType
from tbsa.work import draw as pictures
from tbsa.work.draw import Snapshot, draw, sheet, summary_figure

W = 0.03
CHESS = SETS["chessboard"]
RED, GREEN = to_rgb(pictures.ERROR), to_rgb(pictures.BOND)
SEED = Seed(((0, 0, "black"), (1, 0, "white"), (0, 1, "white")))
CIRCLE = Reactor("circle", radius=0.15)
ATTACHED = (PlacedTile("black", (W, W)), PlacedTile("black", (2 * W, 0.0)))
LOOSE = (PlacedTile("black", (-2 * W, -2 * W), math.pi / 4), PlacedTile("white", (0.0, -3 * W)))


def scene_of(tiles=ATTACHED + LOOSE, types=CHESS, seed=SEED, reactor=CIRCLE):
    return Scene(types=types, seed=seed, free=Free(tiles=tiles), reactor=reactor,
                 magnet=Magnet())


def record(scene):
    layout = initial_layout(scene)
    return scene, layout, layout.x, layout.y, layout.angle


class Picture:
    """A PNG, and the colour it has at a place given in m."""

    def __init__(self, path, scene, **options):
        figure = draw(*record(scene), path=path, **options)
        figure.set_dpi(pictures.DPI)  # the axes stay where writing the file has laid them out
        self.pixels = matplotlib.image.imread(path)[:, :, :3]
        self.axes = figure.axes[0]

    def at(self, x, y):
        u, v = self.axes.transData.transform((100 * x, 100 * y))
        return self.pixels[int(len(self.pixels) - v), int(u)]

    def count(self, colour):
        return int((np.abs(self.pixels - colour).max(axis=2) < 0.02).sum())


@pytest.fixture
def picture(tmp_path):
    return lambda scene, **options: Picture(tmp_path / "picture.png", scene, **options)


# --- what is to be seen ------------------------------------------------------------------------

def test_the_assembly_has_the_colours_of_its_types(picture):
    seen = picture(scene_of())
    off = 0.35 * W  # beside dots, triangles and bonds
    for x, y, colour in [(0, 0, 0), (1, 0, 1), (0, 1, 1), (1, 1, 0), (2, 0, 0)]:
        assert seen.at(x * W + off, y * W + off) == pytest.approx([colour] * 3, abs=0.01)


def test_tiles_outside_the_assembly_are_faded(picture):
    seen = picture(scene_of())
    floor = np.array(to_rgb(pictures.FLOOR))
    black = seen.at(-2 * W, -2 * W - 0.4 * W)
    white = seen.at(0.35 * W, -3 * W + 0.35 * W)
    assert black == pytest.approx(pictures.FADE * floor, abs=0.01)
    assert (white > floor + 0.03).all()
    assert (white < 0.98).all()


def test_without_metrics_all_tiles_have_their_own_colour_and_no_mark(picture):
    seen = picture(scene_of(), metrics=False)
    assert seen.at(-2 * W, -2 * W - 0.4 * W) == pytest.approx([0, 0, 0], abs=0.01)
    assert "attached" not in seen.axes.get_title()


def test_tiles_are_drawn_at_their_angle(picture):
    seen = picture(scene_of())
    grey = seen.at(-2 * W, -2 * W - 0.4 * W)
    assert seen.at(-2 * W, -2 * W - 0.63 * W) == pytest.approx(grey, abs=0.01)  # towards a corner
    beyond = seen.at(-2 * W - 0.42 * W, -2 * W - 0.42 * W)  # of an unturned tile's corner
    assert beyond == pytest.approx(to_rgb(pictures.FLOOR), abs=0.01)


def test_the_floor_ends_at_the_wall(picture):
    seen = picture(scene_of())
    assert seen.at(0.0, 0.14) == pytest.approx(to_rgb(pictures.FLOOR), abs=0.01)
    assert seen.at(0.15, 0.0) == pytest.approx(to_rgb(pictures.EDGE), abs=0.05)
    assert seen.at(0.13, 0.13) == pytest.approx([1, 1, 1], abs=0.01)


def test_a_rectangular_wall_is_a_rectangle(picture):
    seen = picture(scene_of(reactor=Reactor("rectangle", width=0.2, height=0.3)))
    assert seen.at(0.095, 0.145) == pytest.approx(to_rgb(pictures.FLOOR), abs=0.01)
    assert seen.at(0.1, 0.0) == pytest.approx(to_rgb(pictures.EDGE), abs=0.05)
    assert seen.axes.get_xlim() == pytest.approx((-10.2, 10.2))


@pytest.mark.parametrize(("width", "height"), [(0.4, 0.2), (0.3, 0.3), (0.2, 0.3), (1.2, 0.2)])
def test_a_picture_has_the_shape_of_the_reactor(picture, width, height):
    scene = scene_of(reactor=Reactor("rectangle", width=width, height=height))
    seen = picture(scene, time=1.0)
    frame = seen.axes.get_window_extent()
    assert frame.height / frame.width == pytest.approx(height / width, rel=1e-6)
    tall, wide, _ = seen.pixels.shape
    assert wide == 1400
    assert frame.width > 0.8 * wide
    assert tall - frame.height < 0.2 * wide or width == 1.2  # there must be room for the title
    title = seen.axes.title.get_window_extent()
    assert title.y1 <= tall


@pytest.fixture
def every_mark(monkeypatch):
    """Pictures tell of a dozen of every mark, whatever is in them."""
    monkeypatch.setattr(pictures, "_marks", lambda *_: dict.fromkeys(pictures.MARKS, 12))


@pytest.mark.parametrize("marks", [0, pytest.param(1, marks=pytest.mark.slow), 5])
@pytest.mark.parametrize("shape", [
    0.3, 0.625, 0.76, 1.0, 2.0,
    *(pytest.param(shape, marks=pytest.mark.slow) for shape in (0.4, 0.7, 0.8))])
def test_nothing_of_a_picture_is_cut_off(monkeypatch, shape, marks, tmp_path):
    names = list(pictures.MARKS)[:marks]
    monkeypatch.setattr(pictures, "_marks", lambda *_: dict.fromkeys(names, 12))
    scene = scene_of(ATTACHED[:1], reactor=Reactor("rectangle", width=0.4, height=0.4 * shape))
    seen = Picture(tmp_path / "picture.png", scene, time=60.0)
    tall, wide, _ = seen.pixels.shape
    assert seen.axes.title.get_window_extent().y1 <= tall
    for legend in seen.axes.figure.legends:
        box = legend.get_window_extent()
        assert 0.0 <= box.x0 < box.x1 <= wide
        assert 0.0 <= box.y0 < box.y1 <= seen.axes.xaxis.label.get_window_extent().y0
    assert seen.axes.get_window_extent().width > (0.8 if shape <= 1.0 else 0.6) * wide


@pytest.mark.parametrize("panels", [1, 2, 3, 4])
def test_the_legend_of_a_sheet_is_no_wider_than_it(every_mark, panels):
    scene, *rest = record(scene_of())
    figure = sheet(scene, panels * [Snapshot(*rest, 1.0)])
    box = figure.legends[0].get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width


def test_a_legend_is_no_wider_than_the_picture_if_it_can_be(every_mark):
    """It has as few rows as that takes, and is there in any case."""
    columns = []
    for wide in (20.0, 8.0, 6.0, 3.0, 1.0):
        figure = Figure(figsize=(wide, 3.0))
        draw(*record(scene_of()), ax=figure.add_axes((0.15, 0.5, 0.8, 0.4)))
        legend = figure.axes[0].get_legend()
        columns.append(legend._ncols)
        assert legend.get_window_extent().width <= figure.bbox.width or wide == 1.0
    assert columns == [5, 5, 3, 1, 1]


@pytest.mark.parametrize("layout", [None, "constrained"])
@pytest.mark.parametrize("columns", [2, 3, 4])
def test_titles_and_legends_of_neighbours_in_a_figure_stay_apart(every_mark, columns, layout):
    figure = Figure(figsize=(3.2 * columns, 4.4), layout=layout)
    for ax in figure.subplots(1, columns):
        draw(*record(scene_of()), ax=ax, time=10.0)
    for _ in range(2):
        figure.draw_without_rendering()
    for words in ([ax.title for ax in figure.axes], [ax.get_legend() for ax in figure.axes]):
        boxes = [each.get_window_extent() for each in words]
        assert all(a.x1 <= b.x0 for a, b in itertools.pairwise(boxes))
    wide = figure.bbox.width / columns
    assert all(ax.get_window_extent().width > 0.5 * wide for ax in figure.axes)
    assert all(ax.title.get_fontsize() > 6.0 for ax in figure.axes)


@pytest.mark.parametrize("reactor", [Reactor("rectangle", width=0.3, height=0.2), CIRCLE, None])
def test_the_legend_in_given_axes_covers_no_place_where_a_tile_may_be(reactor, every_mark):
    figure = Figure(figsize=(7.2, 7.2))
    ax = figure.add_axes((0.1, 0.12, 0.85, 0.8))
    draw(*record(scene_of((PlacedTile("black", (W, W)), PlacedTile("black", (2 * W, 0.0))),
                          reactor=reactor, seed=Seed(SEED.cells[:2]))), ax=ax)
    FigureCanvasAgg(figure).draw()
    box, shown = ax.get_legend().get_window_extent(), ax.get_window_extent()
    assert 0.0 < box.y0 < box.y1 < min(shown.y0, ax.xaxis.label.get_window_extent().y0)
    assert 0.0 < box.x0 < box.x1 < figure.bbox.width


def test_without_a_wall_the_axes_hold_all_tiles(picture):
    axes = picture(scene_of(reactor=None)).axes
    assert axes.get_xlim() == pytest.approx((-9.0, 9.0))
    assert axes.get_ylim() == pytest.approx((-12.0, 6.0))


def test_the_seed_carries_dots_in_the_contrary_shade(picture):
    seen = picture(scene_of())
    assert (seen.at(0.0, 0.0) > 0.9).all()
    assert (seen.at(W, 0.0) < 0.2).all()


@pytest.mark.parametrize(("forward", "dx", "dy"),
                         [("N", 0, 1), ("E", 1, 0), ("S", 0, -1), ("W", -1, 0)])
def test_a_triangle_points_to_the_forward_edge(picture, forward, dx, dy):
    kind = replace(CHESS[0], forward=forward)
    lone = (PlacedTile("black", (-2 * W, 0.0)),)
    scene = scene_of(lone, (kind, CHESS[1]))
    seen, bare = picture(scene, metrics=False), picture(scene, metrics=False, headings=False)
    shown = {side: seen.at(-2 * W + side * 0.18 * W * dx, side * 0.18 * W * dy)[0] > 0.5
             for side in (1, -1)}
    assert shown == {1: True, -1: False}
    assert bare.at(-2 * W + 0.18 * W * dx, 0.18 * W * dy) == pytest.approx([0, 0, 0], abs=0.01)


def test_bonds_are_bars_across_bonded_edges_only(picture):
    with_bonds = picture(scene_of())
    assert with_bonds.at(1.5 * W, 0.0) == pytest.approx(GREEN, abs=0.05)
    assert with_bonds.at(W, 0.5 * W) == pytest.approx(GREEN, abs=0.05)
    assert with_bonds.at(0.5 * W, 0.0) != pytest.approx(GREEN, abs=0.1)  # within the seed
    assert picture(scene_of(), bonds=False).count(GREEN) == 0 < with_bonds.count(GREEN)


def test_glue_labels_are_one_collection_a_glue(picture):
    plain, labelled = picture(scene_of()), picture(scene_of(), glues=True)
    names = [type(each).__name__ for each in labelled.axes.collections]
    assert names.count("PathCollection") == 4  # +1, -1, +2, -2
    assert (labelled.pixels != plain.pixels).any()


def test_long_glue_labels_stay_between_the_edge_and_the_dot():
    glues = (+1, -24, -100, -1000)
    kinds = (TileType("long", glues, "white"),)
    axes = draw(*record(scene_of((), kinds, Seed(((0, 0, "long"),)))), glues=True).axes[0]
    labels = [each for each in axes.collections if isinstance(each, PathCollection)]
    widths = [each.get_paths()[0].get_extents().width / (100 * W) for each in labels]
    assert len(widths) == len(glues)
    assert max(widths) < 0.28  # at 0.32 of the width from the centre; the dot's radius is 0.17
    assert min(widths) > 0.2


def test_errors_and_holes_are_marked_in_red_and_named_below(picture):
    ring = [(c, r) for c in (1, 2, 3) for r in (1, 2, 3) if (c, r) != (2, 2)]
    seed = Seed(tuple((c, 0, ("black", "white")[c % 2]) for c in range(4))
                + tuple((0, r, ("black", "white")[r % 2]) for r in range(1, 4)))
    tiles = tuple(PlacedTile(("black", "white")[(c + r) % 2], (c * W, r * W)) for c, r in ring)
    right = picture(scene_of(tiles[:3], seed=seed))
    assert right.count(RED) == 0
    holed = picture(scene_of(tiles, seed=seed))
    assert holed.count(RED) > 0
    assert "holes 12.5 %" in holed.axes.get_title()
    assert [t.get_text() for t in holed.axes.figure.legends[0].get_texts()] == ["hole (1)"]
    impostor = TileType("impostor", (0, 0, 0, -2), "white")
    wrong = replace(impostor, colour="blue")
    tiles = (PlacedTile("black", (W, W)), PlacedTile("impostor", (2 * W, W)))
    assert picture(scene_of(tiles, (*CHESS, impostor), seed)).count(RED) == 0
    seen = picture(scene_of(tiles, (*CHESS, wrong), seed))
    assert seen.at(2 * W + 0.2 * W, W + 0.2 * W) == pytest.approx(RED, abs=0.02)
    aside = 0.08 * W / math.sqrt(2.0)  # from the middle of a bar, which is red up to 0.07
    for turn in (1, -1):  # the rim of either bar, and none where they cross
        assert seen.at(2.2 * W + aside, W + turn * 0.2 * W - turn * aside) == pytest.approx(
            [1, 1, 1], abs=0.02)
    assert seen.at(2 * W, W) == pytest.approx(RED, abs=0.02)
    assert "errors 50.0 %" in seen.axes.get_title()


def test_a_hole_is_framed_all_around_as_its_legend_shows(picture):
    """Corners alone are too thin to be seen in a column of a journal."""
    ring = [(c, r) for c in (1, 2, 3) for r in (1, 2, 3) if (c, r) != (2, 2)]
    seed = Seed(tuple((c, 0, ("black", "white")[c % 2]) for c in range(4))
                + tuple((0, r, ("black", "white")[r % 2]) for r in range(1, 4)))
    seen = picture(scene_of(tuple(PlacedTile(("black", "white")[(c + r) % 2], (c * W, r * W))
                                  for c, r in ring), seed=seed))
    for way in ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (1, -1)):
        assert seen.at(*(2 * W + 0.38 * W * np.array(way))) == pytest.approx(RED, abs=0.02)
    assert seen.at(2 * W, 2 * W) == pytest.approx(to_rgb(pictures.FLOOR), abs=0.01)
    (entry,) = seen.axes.figure.legends[0].legend_handles
    assert (entry.get_marker(), entry.get_markerfacecolor()) == ("s", "none")


def test_each_kind_of_mark_has_its_own_entry(picture):
    tiles = (PlacedTile("white", (-W, 0.0)), PlacedTile("black", (W, W), math.pi / 2))
    kind = TileType("black", (1, 2, 1, 1), "black")
    seen = picture(scene_of(tiles, (kind, CHESS[1])))
    names = {t.get_text() for t in seen.axes.figure.legends[0].get_texts()}
    assert names == {"outside the pattern (1)", "wrongly turned (1)"}


def test_marks_show_on_tiles_of_their_own_colour(picture):
    """A white rim goes round them, as round the cross of an error."""
    kind = replace(CHESS[0], glues=(1, 2, 1, 1), colour=pictures.MARKS["wrongly turned"][0])
    seen = picture(scene_of((PlacedTile("black", (W, W), math.pi / 2),), (kind, CHESS[1])))
    slant = math.sqrt(0.5)
    for radius, colour in ((0.43, "white"), (0.37, kind.colour), (0.31, "white")):
        at = (1.0 + slant * radius) * W
        assert seen.at(at, at) == pytest.approx(to_rgb(colour), abs=0.02)


def test_the_title_tells_the_time_and_the_axes_are_in_centimetres(picture):
    axes = picture(scene_of(), time=3600.0).axes
    assert axes.get_title().startswith("t = 3600 s\n2 tiles attached, errors 0.0 %")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (cm)", "y (cm)")
    assert axes.get_xlim() == pytest.approx((-15.3, 15.3))


@pytest.mark.parametrize(("time", "shown"), [(12345.678, "12345.678"), (1e6, "1000000"),
                                             (0.1 + 0.2, "0.3"), (1000.0 + 1 / 480, "1000.002083")])
def test_records_that_follow_each_other_have_times_of_their_own(time, shown):
    assert draw(*record(scene_of()), time=time).axes[0].get_title().startswith(f"t = {shown} s")


def test_a_single_tile_is_one_tile_attached(picture):
    seen = picture(scene_of(ATTACHED[:1]))
    assert seen.axes.get_title().startswith("1 tile attached, errors")


def test_the_number_of_artists_does_not_grow_with_the_tiles():
    def artists(n):
        tiles = tuple(PlacedTile("white", (2 * W * k, 1.0)) for k in range(n))
        figure = draw(*record(scene_of(tiles, reactor=None)))
        return len(figure.axes[0].get_children())

    assert artists(200) == artists(1)


def test_given_axes_are_drawn_into():
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert draw(*record(scene_of()), ax=right) is figure
    assert (len(left.collections), len(right.collections) > 0) == (0, True)


def test_a_scene_without_a_seed_and_tiles_of_one_type_can_be_drawn(picture):
    seen = picture(scene_of(LOOSE, seed=None), time=1.0)
    assert seen.axes.get_title() == "t = 1 s"


# --- files -------------------------------------------------------------------------------------

@pytest.mark.parametrize(("name", "start"), [
    ("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF"), ("A.PNG", b"\x89PNG")])
def test_the_ending_decides_the_format(tmp_path, name, start):
    path = tmp_path / name
    draw(*record(scene_of()), path=path)
    data = path.read_bytes()
    assert data.startswith(start)
    assert len(data) > 5000


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_the_same_record_gives_the_same_bytes(tmp_path, ending):
    paths = [tmp_path / f"{k}.{ending}" for k in range(2)]
    for path in paths:
        draw(*record(scene_of()), path=path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_failed_picture_leaves_the_old_one_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(self, file, **options):
        file.write(b"half a picture")
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        draw(*record(scene_of()), path=path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a.gif", "a", "a.png.txt"])
def test_other_endings_are_refused_before_anything_is_drawn(tmp_path, name):
    with pytest.raises(InputError, match=r"must end in \.png, \.svg, \.pdf"):
        draw(*record(scene_of()), path=tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(InputError, match="must be in a folder that exists"):
        draw(*record(scene_of()), path=tmp_path / "no" / "a.png")


def test_a_folder_of_that_name_is_refused(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(InputError, match="must be a file, and is a folder"):
        draw(*record(scene_of()), path=tmp_path / "a.png")


@pytest.mark.parametrize("colour", ["blackish", "none", "", "#12345"])
def test_an_unknown_colour_is_refused_by_the_name_of_its_type(colour):
    types = (CHESS[0], replace(CHESS[1], colour=colour))
    with pytest.raises(InputError, match=r"types?\[1\]\.colour.*'white'.*must be .*#rrggbb"):
        draw(*record(scene_of(types=types)))


def test_drawing_needs_no_pyplot():
    code = "import sys, tbsa.work.draw\nsys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- several panels ----------------------------------------------------------------------------

def test_a_sheet_has_a_panel_for_every_snapshot(tmp_path):
    scene, *rest = record(scene_of())
    panels = [Snapshot(*rest, time) for time in (0.0, 10.0, 20.0, 30.0, 40.0)]
    figure = sheet(scene, panels, tmp_path / "sheet.png")
    titles = [ax.get_title().split("\n")[0] for ax in figure.axes if ax.axison]
    assert titles == ["t = 0 s", "t = 10 s", "t = 20 s", "t = 30 s", "t = 40 s"]
    height, width = matplotlib.image.imread(tmp_path / "sheet.png").shape[:2]
    assert width > height > 1000


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 7])
def test_each_panel_of_a_sheet_can_be_read(number):
    """It has numbers and a label where no other panel is, also above an empty place, and those of
    neighbours stay apart."""
    scene, *rest = record(scene_of())
    figure = sheet(scene, [Snapshot(*rest, float(k)) for k in range(number)])
    figure.draw_without_rendering()
    panels = [ax for ax in figure.axes if ax.axison]
    boxes = [ax.get_position() for ax in panels]
    for ax, box in zip(panels, boxes, strict=True):
        lowest = not any(abs(other.x0 - box.x0) < 0.01 and other.y0 < box.y0 for other in boxes)
        assert bool(ax.get_xlabel()) == lowest
        assert any(label.get_text() for label in ax.get_xticklabels()) == lowest
    words = [label.get_window_extent() for ax in panels for label in ax.get_xticklabels()
             if label.get_visible() and label.get_text()]
    assert not any(a.overlaps(b) for k, a in enumerate(words) for b in words[:k])


def test_the_panels_of_a_sheet_are_as_high_as_the_reactor():
    scene, *rest = record(scene_of())
    wide = replace(scene, reactor=Reactor("rectangle", width=0.8, height=0.2))
    low, high = (sheet(each, [Snapshot(*rest)] * 2).get_size_inches()[1] for each in (wide, scene))
    assert low < 0.6 * high


def test_a_sheet_without_snapshots_is_refused(tmp_path):
    with pytest.raises(InputError, match="at least one snapshot"):
        sheet(scene_of(), [], tmp_path / "sheet.png")


def test_the_summary_plots_each_run_beside_its_snapshot(tmp_path):
    time = np.arange(5.0)
    tables = {name: pd.DataFrame({"time": time, "size": k * time, "errors_percent": 0.1 * time,
                                  "holes_percent": np.full(5, np.nan)})
              for k, name in enumerate(("unicycle", "shaking"), 1)}
    scene, *rest = record(scene_of())
    snapshots = {name: (scene, Snapshot(*rest, 4.0)) for name in tables}
    figure = summary_figure(tables, snapshots, tmp_path / "summary.pdf")
    assert (tmp_path / "summary.pdf").read_bytes().startswith(b"%PDF")
    left, right, size, errors, _ = figure.axes
    assert left.get_title().startswith("unicycle, t = 4 s")
    assert right.get_title().startswith("shaking, t = 4 s")
    assert [line.get_label() for line in size.lines] == ["unicycle", "shaking"]
    assert [line.get_ydata()[-1] for line in size.lines] == [4.0, 8.0]
    assert len({line.get_linestyle() for line in errors.lines}) == 2  # told apart in grey print


def test_curves_of_a_summary_do_not_look_alike():
    rows = pd.DataFrame({name: np.arange(5.0) for name in (
        "time", "size", "errors_percent", "holes_percent")})
    size, *_ = summary_figure({f"run {k}": k * rows for k in range(16)}, {}).axes
    assert len({(line.get_color(), line.get_linestyle()) for line in size.lines}) == 16
    with pytest.raises(InputError, match="tables: 17 must be at most 16"):
        summary_figure({f"run {k}": rows for k in range(17)}, {})


def test_the_legend_of_a_summary_names_every_run():
    rows = pd.DataFrame({name: np.arange(5.0) for name in (
        "time", "size", "errors_percent", "holes_percent")})
    names = ["shaking", "_old", "_nolegend_"]
    figure = summary_figure(dict.fromkeys(names, rows), {})
    assert [text.get_text() for text in figure.legends[0].get_texts()] == names


@pytest.mark.parametrize("order", [1, -1])
def test_a_summary_has_room_for_a_run_without_rows(order):
    whole = pd.DataFrame({name: np.arange(5.0) for name in (
        "time", "size", "errors_percent", "holes_percent")})
    tables = dict([("whole", whole), ("none yet", whole[:0])][::order])
    size, *_ = summary_figure(tables, {}).axes
    assert size.get_xlim() == (0.0, 4.0)
    assert summary_figure({"none yet": whole[:0]}, {}).axes[0].get_xlim()[0] == 0.0


@pytest.mark.parametrize("runs", [2, 16])
def test_the_legend_of_a_summary_covers_no_curve(runs):
    rows = pd.DataFrame({name: np.arange(5.0) % 2 for name in (
        "time", "size", "errors_percent", "holes_percent")})
    figure = summary_figure({f"run {k}": k * rows for k in range(runs)}, {})
    figure.draw_without_rendering()
    shown = {id(legend): legend for axes in figure.axes
             for legend in (axes.get_legend(), *axes.figure.legends) if legend is not None}
    assert len(shown) == 1
    for legend in shown.values():
        box = legend.get_window_extent()
        assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)


def test_a_snapshot_of_an_unknown_run_is_refused():
    scene, *rest = record(scene_of())
    with pytest.raises(InputError, match="must name runs that have a table"):
        summary_figure({}, {"unicycle": (scene, Snapshot(*rest))})
