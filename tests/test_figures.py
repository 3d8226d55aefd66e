"""The figures that read a campaign's data, from a tiny campaign; and what keeps such data small."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_campaign import SCENE, SHAKING

import tbsa
from figures import growth, maps, snapshots, style
from figures.__main__ import main
from paper_runs.keep import main as keep

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


def test_what_is_missing_is_said_and_the_rest_is_made(there, capsys, monkeypatch):
    monkeypatch.setattr(growth, "DATA", (style.OUTPUT / "nowhere" / "table.csv",))
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


def test_growth_draws_mean_and_deviation_of_each_drive_and_the_papers_ends(there, data):
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


def test_snapshots_show_both_drives_from_begin_to_end(there, data):
    with style.look():
        axes = snapshots.make().axes
    titles = [ax.get_title().splitlines()[-1] for ax in axes]
    for column, group in enumerate(("self-stabilizing", "shaking")):
        run = tbsa.read_run(snapshots.first_run(data, group))
        assert run.scene.run.seed == 4  # the first of the group in the campaign's order
        for row in (0, 3):
            k = -1 if row else 0
            size = tbsa.assembly(run.scene, run.layout, run.x[k], run.y[k], run.angle[k]).size
            assert titles[2 * row + column] == f"{run.time[k]:g} s: {size} tiles"


def test_snapshots_need_a_run_that_was_kept(data):
    with pytest.raises(FileNotFoundError, match="no run of map-shaking is kept"):
        snapshots.first_run(data, "map-shaking")


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
