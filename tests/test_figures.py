"""Figures: schematics, those that read a tiny campaign's data, and what keeps such data small."""

from __future__ import annotations

import math
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from test_campaign import SCENE, SHAKING

import tbsa
from figures import __main__ as command
from figures import (
    _shapes,
    architecture,
    detachment,
    elsewhere,
    growth,
    maps,
    margin,
    reactor,
    snapshots,
    speed,
    style,
    terminology,
    tile_magnets,
    two_families,
)
from figures.__main__ import SCRIPTS, main
from figures._records import first_run
from paper_runs.keep import main as keep
from tbsa.model.tiles import ground_truth, strength
from theory.scaling import net_glue_force
from theory.stability import case, net_force

CAMPAIGN = """
seeds = [4, 2]
[[group]]
name = "self-stabilizing"
scene = "scene.toml"
[[group]]
name = "shaking"
scene = "shaking.toml"
[[group]]
name = "map-unicycle"
scene = "scene.toml"
[group.grid]
"floor.law" = ["separate", "coupled"]
"drive.force" = [0.06, 0.1]
"drive.torque" = [3e-3]
"record.checkpoint" = [4.0]
"run.duration" = [2.0]
[[group]]
name = "map-shaking"
scene = "shaking.toml"
set = {"run.duration" = 2.0, "drive.force" = 0.1}
grid = {"floor.law" = ["separate", "coupled"]}
"""
SCHEMATICS = ("architecture", "bristle_drive", "detachment", "reactor", "terminology",
              "tile_magnets", "tile_set", "two_families")
GROUPS = ("--group", "self-stabilizing", "--group", "shaking")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A campaign's folder, and what was kept of it."""
    home = tmp_path_factory.mktemp("data")
    (home / "scene.toml").write_text(SCENE)
    (home / "shaking.toml").write_text(SHAKING)
    (home / "campaign.toml").write_text(CAMPAIGN)
    with ThreadPoolExecutor(1) as pool:
        assert tbsa.campaign(home / "campaign.toml", home / "out", executor=pool).done == 16
    assert keep([str(home / "out"), str(home / "kept"), *GROUPS, "--records", "3"]) == 0
    return home / "kept"


@pytest.fixture
def there(data, tmp_path, monkeypatch):
    """The figures read the kept data and write to a folder of the test's."""
    monkeypatch.setattr(style, "OUTPUT", tmp_path)
    for script in (growth, snapshots, maps):
        names = [Path(path).name for path in script.DATA]
        monkeypatch.setattr(script, "DATA", tuple(
            data / "runs" / name if name in ("self-stabilizing", "shaking") else data / name
            for name in names))
    return tmp_path


def test_all_are_made_as_vectors_and_as_pixels(there, capsys):
    assert main(["growth", "snapshots", "maps"]) == 0
    for name in ("growth", "snapshots", "maps"):
        assert (there / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        assert b"/Subtype /Image" not in (there / f"{name}.pdf").read_bytes()
        assert (there / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out.count("\n") == 3


def test_the_same_data_give_the_same_bytes(there):
    main(["growth"])
    before = (there / "growth.pdf").read_bytes()
    main(["growth"])
    assert (there / "growth.pdf").read_bytes() == before


def test_a_figure_that_cannot_be_written_whole_stays_as_it_was(tmp_path, monkeypatch, capsys):
    """As on a disk that gets full."""
    def half(self, path, **_):
        Path(path).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(style, "OUTPUT", tmp_path)
    (tmp_path / "tile_set.pdf").write_bytes(b"old")
    monkeypatch.setattr(Figure, "savefig", half)
    assert main(["tile_set"]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"tile_set.pdf": b"old"}


def test_sources_are_read_whatever_the_encoding_of_the_system(monkeypatch):
    read = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda path, encoding="ascii": read(path, encoding))
    with style.look():
        architecture.make()


@pytest.mark.parametrize("scripts", [["growth", "maps", "tile_set"],
                                     pytest.param(SCRIPTS, marks=pytest.mark.slow)])
def test_what_is_missing_is_said_and_the_rest_is_made(there, capsys, monkeypatch, scripts):
    monkeypatch.setattr(command, "SCRIPTS", scripts)
    monkeypatch.setattr(growth, "DATA", (style.OUTPUT / "nowhere" / "table.csv",))
    monkeypatch.setattr(margin, "RECORDS", 2)  # of all it takes minutes
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"growth: left out, needs {style.OUTPUT}/nowhere/table.csv" in lines
    assert any(line.startswith("maps: ") and line.endswith("maps.png") for line in lines)
    assert main(["growth"]) == 1
    assert main(["growht"]) == 2


def test_every_figure_fits_a_column(there):
    for script in (growth, snapshots, maps):
        with style.look():
            width, height = script.make().get_size_inches()
        assert width == style.COLUMN
        assert height < 9.5


def test_growth_draws_mean_and_deviation_of_each_drive_and_the_papers_ends(there, data,
                                                                            monkeypatch):
    monkeypatch.setattr(growth, "DURATION", 4.0)
    curves, table = pd.read_csv(data / "curves.csv"), pd.read_csv(data / "table.csv")
    with style.look():
        axes = growth.make().axes
    for k, (group, reported) in enumerate({"self-stabilizing": 130.0, "shaking": 35.0}.items()):
        runs = curves[curves["run"].isin(table[table["group"] == group]["run"])]
        sizes = runs.pivot_table(values="size", index="time", columns="run")
        assert sizes.shape == (5, 2)
        curve, mark = axes[0].lines[2 * k], axes[0].lines[2 * k + 1]
        np.testing.assert_array_equal(curve.get_xdata(), sizes.index)
        np.testing.assert_allclose(curve.get_ydata(), sizes.mean(axis=1), rtol=1e-15)
        assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (4.0, reported)
        band = axes[0].collections[k].get_paths()[0].vertices[:, 1]
        top = (sizes.mean(axis=1) + sizes.std(axis=1)).max()
        assert band.max() == pytest.approx(top, rel=1e-15)
        assert band.min() >= 0.0
    assert [ax.lines[1].get_ydata()[0] for ax in axes] == [130.0, 0.0, 1.5]
    assert [ax.lines[3].get_ydata()[0] for ax in axes] == [35.0, 0.5, 0.0]


@pytest.mark.filterwarnings("error")
def test_growth_of_shorter_runs_is_not_compared_with_the_papers(there):
    with style.look():
        drawn = growth.make()
        drawn.draw_without_rendering()  # laid out
    for ax in drawn.axes:
        assert len(ax.lines) == 2
        assert ax.get_xlim() == (0.0, 4.0)
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert len(labels) == 2
    assert not any("paper" in label for label in labels)
    assert drawn.axes[0].get_ylim()[1] < 100.0
    assert not drawn.axes[0].texts


@pytest.mark.skipif(not all(path.exists() for path in growth.DATA), reason="needs the data")
def test_growth_holds_its_bands_after_the_first_minute():
    """Before that the first few tiles are many per cent each."""
    with style.look():
        axes = growth.make().axes
    for ax in axes:
        for band in ax.collections:
            time, height = band.get_paths()[0].vertices.T
            assert height[time >= 60.0].max() <= ax.get_ylim()[1]


def test_snapshots_show_both_drives_from_begin_to_end(there, data):
    with style.look():
        axes = snapshots.make().axes
    titles = [ax.get_title().splitlines()[-1] for ax in axes]
    for column, group in enumerate(("self-stabilizing", "shaking")):
        run = tbsa.read_run(first_run(data, group))
        assert run.scene.run.seed == 4  # the first of the group in the campaign's order
        for row in (0, 3):
            k = -1 if row else 0
            size = tbsa.assembly(run.scene, run.layout, run.x[k], run.y[k], run.angle[k]).size
            tiles = f"{size} tile{'s' * (size != 1)}"
            assert titles[2 * row + column] == f"{run.time[k]:g} s: {tiles}"


def test_margins_are_those_of_the_run_of_each_drive_that_is_kept(there, data, monkeypatch):
    monkeypatch.setattr(margin, "DATA", snapshots.DATA)
    monkeypatch.setattr(margin, "margins", lambda folder: drawn.append(folder) or found)
    drawn, found = [], pd.DataFrame({"size": [3], "tiles": [1.0], "no_torque": [1.0],
                                     "body": [2.0]})
    assert len(margin.make().axes) == 2
    assert drawn == [first_run(data, group) for group in ("shaking", "self-stabilizing")]


def test_margins_of_a_run_without_an_attached_tile_leave_the_other_panel_its_place(
        there, data, monkeypatch):
    def place():
        with style.look():
            fig = margin.make()
            fig.draw_without_rendering()
        return [ax.get_position().bounds for ax in fig.axes]

    found = pd.DataFrame({"size": [3], "tiles": [1.0], "no_torque": [1.0], "body": [2.0]})
    monkeypatch.setattr(margin, "DATA", snapshots.DATA)
    monkeypatch.setattr(margin, "margins", lambda folder: found)
    full = place()
    some = iter([found.iloc[:0], found])
    monkeypatch.setattr(margin, "margins", lambda folder: next(some))
    np.testing.assert_allclose(place(), full, atol=0.02)


def test_snapshots_need_a_run_that_was_kept(data):
    with pytest.raises(FileNotFoundError, match="no run of map-shaking is kept"):
        first_run(data, "map-shaking")


def test_of_one_drive_there_are_no_snapshots_and_that_is_said(there, tmp_path, capsys, monkeypatch):
    (tmp_path / "shaking").mkdir()
    table, *_ = snapshots.DATA
    (tmp_path / "table.csv").write_text("".join(
        line for line in table.read_text().splitlines(keepends=True)
        if not line.startswith("shaking/")))
    monkeypatch.setattr(snapshots, "DATA", (tmp_path / "table.csv", tmp_path / "shaking"))
    assert main(["snapshots", "maps"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("snapshots: left out, needs records: no run of ")
    assert lines[1].endswith("maps.png")


def test_damaged_records_are_said(there, data, tmp_path, capsys, monkeypatch):
    shutil.copytree(data, tmp_path / "kept")
    for path in (tmp_path / "kept").glob("runs/*/*/records.npy"):
        path.write_bytes(b"")
    monkeypatch.setattr(snapshots, "DATA", (tmp_path / "kept" / "table.csv",))
    assert main(["snapshots"]) == 1
    out = capsys.readouterr().out
    assert out.startswith("snapshots: left out, needs data that can be read: ")
    assert out.count("\n") == 1


def test_maps_say_what_is_framed(there, monkeypatch):
    """In units in which no label runs into the next."""
    paper = tbsa.load(maps.HERE / "self_stabilizing.toml")
    chosen = replace(paper, drive=replace(paper.drive, force=0.06, torque=3e-3))
    with style.look():
        assert maps.make().legends == []  # the paper's torque is none of these
        monkeypatch.setattr(maps.tbsa, "load", lambda _: chosen)
        figure = maps.make()
    ((text,),) = [legend.get_texts() for legend in figure.legends]
    assert text.get_text() == "force of the paper's scenes here, 60 mN;\nself-stabilizing: 3 mN m"
    assert [tick.get_text() for tick in figure.axes[-1].get_xticklabels()] == ["60", "100"]


def test_maps_print_the_mean_size_in_every_cell(there, data):
    table = pd.read_csv(data / "table.csv")
    with style.look():
        figure = maps.make()
    for ax, law in zip(figure.axes, ("separate", "coupled"), strict=True):
        rows = table[table["floor.law"] == law]
        cells = {text.get_position(): text.get_text() for text in ax.texts}
        for column, force in enumerate((0.06, 0.1)):
            for row, torque in enumerate((3e-3,)):
                point = rows[(rows["drive.force"] == force) & (rows["drive.torque"] == torque)]
                assert len(point) == 2
                assert cells[column, row] == f"{point['size'].mean():.0f}"
        shaken = rows[rows["group"] == "map-shaking"]["size"].mean()
        assert cells[1, -1.3] == f"{shaken:.0f}"
        assert cells[0, -1.3] == "–"  # not computed


@pytest.mark.skipif(not all(path.exists() for path in elsewhere.DATA), reason="needs the data")
def test_the_marks_of_a_figure_are_named_once_for_all_its_panels():
    with style.look():
        figure = elsewhere.make()
    assert [text.get_text() for legend in figure.legends for text in legend.get_texts()] == [
        "hole", "outside the pattern"]
    assert not any(ax.get_legend() for ax in figure.axes)


def test_what_is_kept_is_a_campaigns_folder_with_fewer_records(data):
    whole = data.parent / "out"
    for name in ("table.csv", "curves.csv", "wall.csv"):
        assert (data / name).read_bytes() == (whole / name).read_bytes()
    kept = sorted(path.parent.relative_to(data) for path in data.glob("runs/*/*/records.npy"))
    assert [path.parts[1] for path in kept] == ["self-stabilizing", "shaking"]
    for path in kept:
        few, all_of_them = tbsa.read_run(data / path), tbsa.read_run(whole / path)
        assert few.time.tolist() == [0.0, 2.0, 4.0]
        np.testing.assert_array_equal(few.x, all_of_them.x[[0, 2, 4]])


def test_what_cannot_be_kept_is_refused(data, tmp_path, capsys):
    whole = str(data.parent / "out")
    for arguments, words in (
            ([whole, str(tmp_path / "a"), "--group", "none"], "'none' has no run that is done"),
            ([str(tmp_path), str(tmp_path / "a")], "table.csv"),
            ([whole, str(tmp_path / "a"), "--records", "1"], "1 must be at least 2")):
        assert keep(arguments) == 2
        assert words in capsys.readouterr().err


def drawn(figure, monkeypatch):
    """Every text that a renderer draws, with its box in pixels (left, low, right, high)."""
    found = {}
    draw = Text.draw

    def watched(text, renderer, *rest, **options):
        draw(text, renderer, *rest, **options)
        if text.get_visible() and text.get_text().strip():
            # Of the text alone: an annotation's own extent has its line in it.
            found[text] = Text.get_window_extent(text, renderer).extents

    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", watched)
        FigureCanvasAgg(figure).draw()
    return found


def faults(figure, monkeypatch):
    """Texts too small to be read, out of the frame, or over each other."""
    boxes = drawn(figure, monkeypatch)
    right, high = figure.bbox.size
    small = [text.get_text() for text in boxes if text.get_fontsize() < 6.5]
    outside = [text.get_text() for text, (x0, y0, x1, y1) in boxes.items()
               if min(x0, y0, right - x1, high - y1) < -0.5]
    over = [(a.get_text(), b.get_text()) for (a, p), (b, q) in combinations(boxes.items(), 2)
            if min(p[2], q[2]) - max(p[0], q[0]) > 0.5 and min(p[3], q[3]) - max(p[1], q[1]) > 0.5]
    return small, outside, over


def crossed(figure, monkeypatch):
    """Texts that a line of their axes passes through; of their height the middle half counts."""
    figure.set_dpi(style.LOOK["savefig.dpi"])  # letters are wider on coarse pixels
    found = []
    for text, box in drawn(figure, monkeypatch).items():
        if text.axes is None:
            continue
        inner = Bbox.from_extents(box).padded(0.0, -0.25 * (box[3] - box[1]))
        found += [text.get_text() for line in text.axes.lines
                  if line.get_path().transformed(line.get_transform()).intersects_bbox(
                      inner, filled=False)]
    return found


def test_faults_of_a_figure_are_found(monkeypatch):
    figure = Figure(figsize=(2, 1))
    for x, y, text, size in ((0.1, 0.5, "left", 8), (0.15, 0.55, "right", 8), (0.95, 0.1, "out", 8),
                             (0.5, 0.1, "tiny", 5)):
        figure.text(x, y, text, fontsize=size)
    figure.text(0.1, 0.5, "hidden", visible=False)
    assert faults(figure, monkeypatch) == (["tiny"], ["out"], [("left", "right")])


@pytest.mark.parametrize("name", SCHEMATICS)
def test_a_schematic_needs_no_data_and_can_be_read(name, tmp_path, monkeypatch):
    script = import_module(f"figures.{name}")
    assert script.DATA == ()
    assert name in SCRIPTS
    monkeypatch.setattr(style, "OUTPUT", tmp_path)
    assert main([name]) == 0
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    pdf = (tmp_path / f"{name}.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/Subtype /Image" not in pdf
    assert main([name]) == 0
    assert (tmp_path / f"{name}.pdf").read_bytes() == pdf
    with style.look():
        figure = script.make()
        assert faults(figure, monkeypatch) == ([], [], [])
        if name in ("architecture", "detachment"):  # texts among lines
            assert crossed(figure, monkeypatch) == []
    assert figure.get_size_inches()[0] == style.COLUMN


@pytest.mark.parametrize("name", ["growth", "maps", "snapshots", "magnet_force"])
def test_a_figure_of_data_can_be_read(name, there, monkeypatch):
    with style.look():
        assert faults(import_module(f"figures.{name}").make(), monkeypatch) == ([], [], [])


def test_the_architecture_has_every_module_and_line(monkeypatch):
    root = Path(architecture.__file__).parents[1]
    stems = sorted(path.stem for folder in ("tbsa", "theory")
                   for path in (root / folder).rglob("*.py") if not path.stem.startswith("_"))
    with style.look():
        texts = [text.get_text() for text in drawn(architecture.make(), monkeypatch)]
    for name in ("work", "model", "kernels", "tbsa", "theory"):
        texts.remove(name)
    assert sorted(text for text in texts if text in stems) == stems
    graph = architecture.imports(architecture.modules())
    assert "tbsa.kernels.advance" in graph["tbsa.model.simulation"]
    assert "tbsa.model.scene" not in graph["tbsa.model.squares"]  # for type checks only
    for name, path in architecture.modules().items():  # plain imports, by a second reader
        for line in re.findall(r"^from ((?:tbsa|theory)\.[\w.]+) import", path.read_text(), re.M):
            assert line in graph[name] or line in ("tbsa.kernels", "tbsa.work")
    few = architecture.reduced(graph)
    assert sum(map(len, few.values())) < sum(map(len, graph.values()))
    assert architecture.below(few) == architecture.below(graph)


def test_the_architecture_tells_who_imports_by_colours_and_heads():
    graph = architecture.reduced(architecture.imports(architecture.modules()))
    with style.look():
        (ax,) = architecture.make().axes
    shared = {name for name in graph if architecture.storey(name) == "tbsa"}
    arrows = [(name, other) for name, needs in graph.items() for other in needs - shared]
    wanted = sorted(architecture.LINES[architecture.storey(name)] for name, _ in arrows)
    assert sorted(line.get_color() for line in ax.lines) == wanted
    heads = [patch for patch in ax.patches if type(patch) is Polygon]
    assert sorted(to_hex(head.get_facecolor()) for head in heads) == wanted
    tips = {tuple(line.get_xydata()[-1].round(6)) for line in ax.lines}
    assert {tuple(head.get_xy()[0].round(6)) for head in heads} == tips


def test_the_architecture_refuses_an_import_that_goes_up():
    graph = {"tbsa.kernels.a": {"tbsa.model.b"}, "tbsa.model.b": set()}
    with pytest.raises(ValueError, match=r"tbsa\.kernels\.a imports tbsa\.model\.b"):
        architecture.refuse_upward(graph, ["work", "model", "kernels"])
    with pytest.raises(ValueError, match="does not say"):
        architecture.storeys("no word of it")


def test_the_terms_mean_what_the_metrics_count():
    scene = terminology.scene()
    layout = tbsa.initial_layout(scene)
    found = tbsa.assembly(scene, layout, layout.x, layout.y, layout.angle)
    assert (found.errors, found.holes) == (1, 1)
    assert found.size == len(terminology.PRESENT) + 1
    assert not found.attached[-1]  # the tile that is about to join
    sites = {(c, r): [kind.name for kind in scene.types].index(name)
             for c, r, name in scene.seed.cells}
    truth = ground_truth(scene).types
    sites |= {site: truth[site] for site in terminology.PRESENT}
    kind = truth[terminology.OPEN]
    assert strength(scene.types, sites, terminology.OPEN, kind) == scene.temperature
    assert layout.type[-1] == kind
    assert strength(scene.types, sites, terminology.STRAY, 2) == 1


def test_the_shaken_blocks_are_held_and_detach_as_the_bound_says():
    small, large = detachment.SIZES
    assert small < detachment.LIMIT < large
    for n in detachment.SIZES:
        np.testing.assert_allclose(np.linalg.norm(detachment.net_tile_force(n)),
                                   n * n * _shapes.PAPER.drive.force)
    with style.look():
        titles = [text.get_text() for ax in detachment.make().axes for text in ax.texts]
    assert {f"{small} × {small} tiles: held", f"{large} × {large} tiles: detaches"} <= set(titles)


def test_two_families_cancel_or_leave_one_standard_deviation():
    n, force = two_families.SIDE, two_families.LOAD
    _, (load,) = case("chessboard", n, force)
    assert np.hypot(*net_force(load)) < 1e-12
    _, (load,) = two_families.half_turns()
    np.testing.assert_allclose(net_force(load), (0.0, n * force), atol=1e-12)


def test_the_sum_is_named_beside_the_arrow_of_the_glue(monkeypatch):
    with style.look():
        figure = two_families.make()
    figure.set_dpi(style.LOOK["savefig.dpi"])
    ((text, box),) = [(text, box) for text, box in drawn(figure, monkeypatch).items()
                      if text.get_text() == "sum"]
    tip = net_glue_force(two_families.SIDE, two_families.GLUE) / two_families.INCH
    head = Bbox.from_extents(box).padded(figure.dpi / 72.0)  # 1 pt about it
    assert not head.contains(*text.axes.transData.transform(tip))


def test_the_force_at_the_corner_is_the_simulators():
    """Theory draws it; the kernels give the same."""
    w, paper = _shapes.PAPER.material.width, _shapes.PAPER
    at = w * (1.0 + tile_magnets.GAP)
    cells = [[c, r, kind.name] for c, r, kind in tile_magnets.SEED]
    for turn, sign in ((0.0, -1.0), (0.5 * math.pi, 1.0)):
        scene = tbsa.parse({
            "tiles": {"set": "chessboard"}, "seed": {"shape": "cells", "cells": cells},
            "free": {"tile": [{"type": "black", "position": [at, at], "angle": turn}]}})
        simulation = tbsa.Simulation(replace(scene, magnet=paper.magnet))
        fx, fy, _ = simulation.magnet_forces()
        np.testing.assert_allclose(tile_magnets.force_on(turn), (fx[-1], fy[-1]), rtol=1e-9)
        assert sign * fx[-1] > 0.05


def test_the_reactor_has_equal_families_and_a_held_cross():
    scene = reactor.scene()
    layout = tbsa.initial_layout(scene)
    free = layout.type[~layout.held]
    assert np.bincount(free).tolist() == [reactor.NUMBER // 2] * 2
    assert layout.held.sum() == 4 * reactor.ARM + 1


def test_all_sizes_are_inside_the_picture_of_speed(monkeypatch):
    """Both scenes share an axis, and the second may take longer than any of the first."""
    def rows(scene, cost):
        return [{"part": "sizes", "scene": scene, "setting": "fixed", "skips": "on",
                 "tiles": tiles, "median": cost * tiles**0.2} for tiles in (550, 2200, 100_000)]

    results = {"rows": [*rows("unicycle", 1e-7), *rows("shaking", 9e-7)]}
    monkeypatch.setattr(speed, "results", lambda _: results)
    monkeypatch.setattr(speed, "speeds", lambda ax, _: None)
    first, second, *_ = speed.make().axes
    low, high = second.get_ylim()
    drawn = [y for ax in (first, second) for line in ax.lines for y in line.get_ydata()]
    assert len(drawn) == 6
    assert low < min(drawn) < max(drawn) < high
