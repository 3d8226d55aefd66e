"""Campaigns: what their files mean, and that nothing is lost or done twice."""

from __future__ import annotations

import errno
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from malformed import CAMPAIGNS

import tbsa
from tbsa.errors import InputError
from tbsa.model import records
from tbsa.model.records import Busy, locked
from tbsa.model.scene import Run, fingerprint, load
from tbsa.work import campaign as module
from tbsa.work.campaign import campaign, share
from tbsa.work.cli import main
from tbsa.work.metrics import COLUMNS
from tbsa.work.plan import read_plan, seeds_of

ROOT = Path(__file__).parents[1]
COMMAND = [sys.executable, "-m", "tbsa.work.cli", "campaign"]
SCENE = """
[tiles]
set = "chessboard"
[seed]
shape = "cross"
arm = 1
[reactor]
shape = "circle"
radius = 0.09
[free]
number = 8
[magnet]
[drive]
kind = "unicycle"
force = 0.1
torque = 3e-3
frequency = 0.5
[floor]
[record]
interval = 1.0
checkpoint = 2.0
[run]
duration = 4.0
"""
SHAKING = SCENE.replace("torque = 3e-3\n", "").replace("unicycle", "shaking")
CAMPAIGN = """
title = "Small"
scene = "scene.toml"
seeds = [1, 2]
[[group]]
name = "map"
grid = {"drive.force" = [0.08, 0.1]}
[[group]]
name = "other"
scene = "shaking.toml"
seeds = [7]
set = {"run.duration" = 8.0}
"""
BURST = """
def burst(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    if p[0] < t:
        fx[7] = 1e300 * 1e300
"""
TABLES = ("table.csv", "curves.csv")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to be in, with scenes and a campaign of five runs."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    Path("shaking.toml").write_text(SHAKING)
    Path("campaign.toml").write_text(CAMPAIGN)
    return tmp_path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of the campaign, done without a break; not to be written to."""
    home = tmp_path_factory.mktemp("whole")
    (home / "scene.toml").write_text(SCENE)
    (home / "shaking.toml").write_text(SHAKING)
    (home / "campaign.toml").write_text(CAMPAIGN)
    done(home / "campaign.toml", home / "out")
    return home / "out"


def done(path, out, workers=1, **options):
    """Do a campaign in threads of this process."""
    with ThreadPoolExecutor(workers) as pool:
        return campaign(path, out, executor=pool, **options)


def planned(text):
    """The runs of a campaign's text."""
    Path("campaign.toml").write_text(text)
    return read_plan("campaign.toml")


def tables(folder):
    return [(Path(folder) / name).read_bytes() for name in TABLES]


def contents(folder):
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def until(what, seconds=60.0):
    """Wait until `what` holds."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.01)


# ---------------------------------------------------------------------------------------------
# What a file means.


def test_a_grid_gives_every_combination_times_every_seed(here):
    plan = planned('scene = "scene.toml"\nseeds = {first = 3, number = 2}\n[[group]]\nname = "a"\n'
                   'grid = {"drive.force" = [0.1, 0.2], "drive.torque" = [0, 1e-3]}\n')
    assert [(each.scene.drive.force, each.scene.drive.torque, each.scene.run.seed)
            for each in plan] == [(f, t, s) for f in (0.1, 0.2) for t in (0.0, 1e-3)
                                  for s in (3, 4)]
    assert {each.group for each in plan} == {"a"}
    assert plan[2].fields == (("drive.force", 0.1), ("drive.torque", 1e-3))


def test_the_arrays_of_a_list_are_taken_together(here):
    plan = planned('scene = "scene.toml"\nseeds = [1]\n[[group]]\nname = "a"\n'
                   'list = {"reactor.radius" = [0.1, 0.2], "free.number" = [8, 30]}\n'
                   'grid = {"magnet.mismatch" = [-1, 0]}\n')
    assert [(each.scene.reactor.radius, each.tiles, each.scene.magnet.mismatch)
            for each in plan] == [(0.1, 13, -1), (0.1, 13, 0), (0.2, 35, -1), (0.2, 35, 0)]


def test_a_group_has_several_scenes_and_its_fields_on_top_of_the_common_ones(here):
    plan = planned('scene = ["scene.toml", "shaking.toml"]\nseeds = [1]\n'
                   'set = {"run.duration" = 2.0, "drive.force" = 0.2, "magnet.mismatch" = 0}\n'
                   '[[group]]\nname = "a"\nset = {drive.force = 0.3}\n'
                   '[[group]]\nname = "b"\nscene = "shaking.toml"\nseeds = [5, 9]\n'
                   'grid = {"magnet.mismatch" = [-1]}\n')
    assert [(each.group, each.base, each.scene.drive.kind, each.scene.drive.force,
             each.scene.magnet.mismatch, each.scene.run.seed) for each in plan] == [
        ("a", "scene.toml", "unicycle", 0.3, 0, 1), ("a", "shaking.toml", "shaking", 0.3, 0, 1),
        ("b", "shaking.toml", "shaking", 0.2, -1, 5), ("b", "shaking.toml", "shaking", 0.2, -1, 9)]
    assert {each.scene.run.duration for each in plan} == {2.0}


@pytest.mark.parametrize(("fields", "what"), [
    ('"floor.law" = ["coupled"]', lambda scene: scene.floor.law == "coupled"),
    ('"drive.kind" = ["shaking"]', lambda scene: scene.drive.kind == "shaking"),
    ('"drive.kind" = ["none"]', lambda scene: scene.drive is None),
    ('"free.counts.black" = [5]', lambda scene: scene.free.counts == (("black", 5),)),
    ('"tiles.type[1].family" = [1]', lambda scene: [t.family for t in scene.types] == [1, 1]),
    ('"tiles.type[1].glues[0]" = [7]', lambda scene: scene.types[1].glues == (7, -2, -1, -2)),
    ('"tiles.set" = ["chessboard-oriented"]', lambda scene: scene.types[0].glues[0] == 2),
    ('"tiles.type" = [[{name = "grey", glues = [1, -1, 1, -1], colour = "grey"}]]',
     lambda scene: scene.types[0].name == "grey"),
    ('"reactor.shape" = ["rectangle"], "reactor.width" = [0.3], "reactor.height" = [0.2]',
     lambda scene: scene.reactor.height == 0.2),
    ('"seed.shape" = ["cells"], "seed.cells" = [[[0, 0, "black"]]]',
     lambda scene: len(scene.seed.cells) == 1),
    ('"record.checkpoint" = [4.0]', lambda scene: scene.record.checkpoint == 4.0),
])
def test_any_field_can_be_set_and_what_it_makes_meaningless_goes(here, fields, what):
    (each,) = planned('scene = "scene.toml"\nseeds = [1]\n[[group]]\nname = "a"\n'
                      f"grid = {{{fields}}}\n")
    assert what(each.scene)


@pytest.mark.parametrize(("how", "counts"), [
    ('set = {"free.counts" = {black = 10}}', (("black", 10),)),
    ('grid = {"free.counts" = [{black = 10}]}', (("black", 10),)),
    ('set = {"free.counts" = {}}', ()),
    ('set = {"free.counts.white" = 7, free.counts.black = 3}', (("white", 7), ("black", 3)))])
def test_counts_are_one_field_and_none_are_none(here, how, counts):
    (each,) = planned(f'scene = "scene.toml"\nseeds = [1]\n[[group]]\nname = "a"\n{how}\n')
    assert each.scene.free.counts == counts


@pytest.mark.parametrize("how", ['set = {"run.seed" = {}}', 'set = {"no.such" = {}}'])
def test_a_table_without_entries_is_not_passed_over(here, how):
    with pytest.raises(InputError):
        planned(f'scene = "scene.toml"\nseeds = [1]\n[[group]]\nname = "a"\n{how}\n')


def test_seeds_of_a_stream_depend_on_its_name_and_place_alone():
    long = seeds_of("growth", 50)
    assert seeds_of("growth", 8) == long[:8]
    assert len(set(long) | set(seeds_of("maps", 50))) == 100
    assert all(0 <= seed < 2**63 for seed in long)


def test_the_seeds_of_a_group_can_be_a_stream(here):
    plan = planned('scene = "scene.toml"\nseeds = {stream = "growth", number = 3}\n'
                   '[[group]]\nname = "a"\n')
    assert [each.scene.run.seed for each in plan] == seeds_of("growth", 3)


def test_shares_are_disjoint_complete_and_longest_first(here):
    plan = planned('scene = "scene.toml"\nseeds = {first = 1, number = 4}\n[[group]]\n'
                   'name = "a"\nlist = {"drive.force" = [0.1, 0.2, 0.3], '
                   '"run.duration" = [1.0, 9.0, 4.0]}\n')
    shares = [share(plan, (i, 3)) for i in (1, 2, 3)]
    assert sorted(each.name for one in shares for each in one) == sorted(
        each.name for each in plan)
    for one in shares:
        costs = [each.cost for each in one]
        assert costs == sorted(costs, reverse=True)
        assert sum(costs) < 0.5 * sum(each.cost for each in plan)


@pytest.mark.parametrize(("text", "name", "fragment"), [row[1:] for row in CAMPAIGNS],
                         ids=[row[0] for row in CAMPAIGNS])
def test_a_malformed_campaign_is_refused(here, capsys, text, name, fragment):
    Path("broken.toml").write_text(SCENE.replace("force = 0.1", "force = -1"))
    Path("campaign.toml").write_text(text)
    before = sorted(here.rglob("*"))
    assert main(["campaign", "campaign.toml", "--out", "out"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1, err
    assert err.startswith(f"tbsa: {name}: "), err
    assert fragment in err
    assert sorted(here.rglob("*")) == before


def test_what_is_set_for_all_names_the_group_whose_scene_it_does_not_suit(here, capsys):
    """The value stands at the top of the file, and what it does not go with in one group."""
    Path("campaign.toml").write_text(
        'scene = "scene.toml"\nseeds = [1]\nset = {"record.interval" = 0.5}\n'
        '[[group]]\nname = "a"\n[[group]]\nname = "b"\ngrid = {"solver.step" = [0.003]}\n')
    assert main(["campaign", "campaign.toml", "--out", "out"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("tbsa: campaign.toml: set.record.interval: 0.5 must be a whole multiple")
    assert err.endswith("(in scene.toml, for group[1])\n")


GROUP = 'scene = "scene.toml"\nseeds = [1]\n[[group]]\nname = "a"\n'
TILE = '"free.tile" = [[{type = "white", position = [0.0, 0.05]}]]'


@pytest.mark.parametrize(("top", "group", "words"), [
    ("", 'set = {"free.tile[0].angle" = 0.5}\nlist = {' + TILE + "}",
     "group[0].list.free.tile: [[{'type': 'white', 'position': [0.0, 0.05]}]] must be set once "
     "(also group[0].set.free.tile[0].angle)"),
    ('set = {"free.tile[0].angle" = 0.5}\n', "list = {" + TILE + "}",
     "must be set once (also set.free.tile[0].angle)"),
    ("", 'set = {"tiles.type[0].family" = 0, "tiles.type[00].family" = 1}', "must be set once"),
    ("", 'set = {"free.counts.black" = 1}\ngrid = {"free.counts" = [{white = 2}]}',
     "must be set once (also group[0].set.free.counts.black)"),
    ('set = {"drive.force" = 0.2}\n', 'list = {drive = [{kind = "shaking", force = 0.1}]}',
     "group[0].list.drive: [{'kind': 'shaking', 'force': 0.1}] is a whole part of the scene: "
     "name its fields one by one, such as drive.force"),
    ("", "grid = {run = [{duration = 2.0}]}", "is a whole part of the scene"),
    ("", 'grid = {seed = [{shape = "cross", arm = 1}]}', "is a whole part of the scene"),
    ("", 'grid = {tiles = [{set = "chessboard"}]}', "is a whole part of the scene"),
    ("", 'scene = "' + 300 * "x" + '"', "there is none" if os.name == "nt" else "too long"),
    ("", "set = {x = " + "1" * 5000 + "}", "campaign.toml: must be "),
    ("", "set = {x = " + "[" * 3000 + "]" * 3000 + "}", "campaign.toml: "),
    ("", 'set = {"seed.cells" = ' + "[" * 400 + "]" * 400 + "}", "campaign.toml: "),
])
def test_a_campaign_that_sets_what_cannot_be_is_refused(here, capsys, top, group, words):
    Path("campaign.toml").write_text(top + GROUP + group + "\n")
    before = contents(here)
    assert main(["campaign", "campaign.toml", "--out", "out"]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert contents(here) == before


@pytest.mark.parametrize("fields", [
    '"tiles.set" = "chessboard-oriented", "tiles.type[0].family" = 0',
    '"tiles.type[0].family" = 0, "tiles.set" = "chessboard-oriented"'])
def test_a_set_of_tiles_and_one_of_its_types_may_be_set_in_either_order(here, fields):
    (each,) = planned(f"{GROUP}set = {{{fields}}}\n")
    assert (each.scene.types[0].family, each.scene.types[0].glues[0]) == (0, 2)


def test_there_are_many_malformed_campaigns():
    assert len(CAMPAIGNS) >= 25


@pytest.mark.parametrize(("arguments", "words"), [
    (["--part", "3"], "--part: '3' must be I/N"), (["--part", "0/3"], "must be I/N"),
    (["--part", "4/3"], "must be I/N, I from 1 to N"), (["--jobs", "0"], "at least 1"),
    (["--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "must be left out with --scheduler"),
    (["--scheduler", "nowhere:nothing"], "must be the address of a dask.distributed scheduler"),
    (["--out", "campaign.toml"], "is a file, not a folder"),
    (["--out", "."], "must be a new or an empty folder, or that of a campaign"),
    (["--out", "campaign.toml/x"], "must be a folder that can be made"),
    (["--out", 300 * "x"], "too long"), (["--out", "out/" + 300 * "x"], "too long"),
])
def test_arguments_that_cannot_be_are_refused(here, capsys, arguments, words):
    before = contents(here)
    assert main(["campaign", "campaign.toml", "--out", "out", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert contents(here) == before


def test_the_readmes_campaign_is_valid(here):
    (text,) = [block for block in re.findall(
        r"^```toml\n(.*?)^```$", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
        if "[[group]]" in block]
    shutil.copytree(ROOT / "paper_runs", here / "paper_runs")
    assert len(planned(text)) == 4 * 2 * 2 + 4 * 2


def test_the_papers_campaign_is_36_seeds_of_each_drive():
    plan = read_plan(ROOT / "paper_runs" / "campaign.toml")
    assert len(plan) == 72
    assert {each.scene.run.duration for each in plan} == {3600.0}
    for drive in ("unicycle", "shaking"):
        runs = [each for each in plan if each.scene.drive.kind == drive]
        assert [each.scene.run.seed for each in runs] == list(range(1, 37))
        assert {each.tiles for each in runs} == {591}
        assert len({each.settings for each in runs}) == 1


def test_of_equally_long_runs_the_groups_take_turns():
    plan = read_plan(ROOT / "paper_runs" / "campaign.toml")
    assert [each.group for each in share(plan, (1, 1))] == ["self-stabilizing", "shaking"] * 36


@pytest.mark.parametrize("n", [2, 3, 4, 7, 8])
def test_every_share_has_its_part_of_every_group(n):
    """So that shares are about equally long, where runs of one group take longer than others."""
    plan = read_plan(ROOT / "paper_runs" / "campaign.toml")
    shares = [share(plan, (i, n)) for i in range(1, n + 1)]
    assert sorted(each.name for one in shares for each in one) == sorted(
        each.name for each in plan)
    for group in ("self-stabilizing", "shaking"):
        counts = [sum(each.group == group for each in one) for one in shares]
        assert max(counts) - min(counts) <= 1


def test_of_equally_long_runs_one_of_each_setting_comes_first():
    plan = read_plan(ROOT / "paper_runs" / "readings.toml")
    order = [each for each in share(plan, (1, 1)) if each.cost == plan[0].cost]
    samples = [(each.group, each.settings) for each in order]
    settings = len(set(samples))
    assert settings > 20
    assert len(samples) == 4 * settings
    for k in range(4):
        assert len(set(samples[k * settings : (k + 1) * settings])) == settings


# ---------------------------------------------------------------------------------------------
# What it leaves.


def test_the_runs_are_those_that_tbsa_run_makes(here, whole):
    for each in read_plan("campaign.toml"):
        folder = whole / "runs" / each.name
        records.run(each.scene, here / "alone")
        for name in ("records.npy", "checkpoint.npz", "layout.npz", "scene.toml"):
            assert (folder / name).read_bytes() == (here / "alone" / name).read_bytes()
        assert main(["metrics", str(here / "alone")]) == 0
        assert (folder / "metrics.csv").read_bytes() == (here / "alone/metrics.csv").read_bytes()
        shutil.rmtree(here / "alone")


def test_the_table_tells_what_each_run_was_and_how_it_ended(here, whole):
    plan = read_plan("campaign.toml")
    exact = dict.fromkeys(("mean_size", "deepest_percent", "passes"), str)  # to the last digit
    table = pd.read_csv(whole / "table.csv", dtype=exact)
    assert table["run"].tolist() == [each.name for each in plan]
    assert table["seed"].tolist() == [1, 2, 1, 2, 7]
    assert table["drive.force"].tolist()[:4] == [0.08, 0.08, 0.1, 0.1]
    assert set(table["status"]) == {"done"}
    assert set(table["version"]) == {tbsa.__version__}
    assert table["time"].tolist() == table["duration"].tolist() == [4.0] * 4 + [8.0]
    assert table["fingerprint"].tolist() == [fingerprint(each.scene) for each in plan]
    for row, each in zip(table.itertuples(), plan, strict=True):
        run = tbsa.read_run(whole / "runs" / each.name)
        found = tbsa.assembly(run.scene, run.layout, run.x[-1], run.y[-1], run.angle[-1])
        assert (row.size, row.bonds, row.tiles) == (found.size, found.bonds, run.layout.x.size)
        frame = tbsa.table(run.scene, run.layout, run.time, run.x, run.y, run.angle)
        assert float(row.mean_size) == pytest.approx(frame["size"].mean(), rel=1e-15)
        counts = json.loads((whole / "runs" / each.name / "run.json").read_text())["counts"]
        assert float(row.deepest_percent) == pytest.approx(100 * counts["deepest"] / 0.03,
                                                           rel=1e-15)
        assert float(row.passes) == counts["passes"] / counts["substeps"]
    assert table["size"].max() > 0


def test_the_table_has_arrays_and_tables_that_were_set_as_json(here):
    """In one form, that programs read, whatever their kind."""
    Path("campaign.toml").write_text("""
scene = "scene.toml"
seeds = [1]
[[group]]
name = "a"
set = {"run.duration" = 1.0, "seed.types" = ["white", "black"], "free.counts" = {black = 3}}
""")
    done("campaign.toml", "out")
    (row,) = pd.read_csv("out/table.csv").to_dict("records")
    assert json.loads(row["seed.types"]) == ["white", "black"]
    assert json.loads(row["free.counts"]) == {"black": 3}


def test_the_curves_hold_every_record_of_every_run(here, whole):
    curves = pd.read_csv(whole / "curves.csv")
    assert curves.groupby("run", sort=False)["time"].max().tolist() == [4.0] * 4 + [8.0]
    assert len(curves) == 4 * 5 + 9
    walls = pd.read_csv(whole / "wall.csv")
    assert (walls["wall"] > 0).all()
    assert "wall" not in pd.read_csv(whole / "table.csv")


def test_the_curves_of_a_run_do_not_depend_on_what_other_runs_have(here):
    """Wrong colours of a set that is not directed are unknown; those of others stay integers."""
    Path("one.toml").write_text(SCENE.replace('set = "chessboard"', """type = [
        {name = "a", glues = [1, 1, -1, -1], colour = "red"},
        {name = "b", glues = [1, 1, -1, -1], colour = "red"}]"""))
    Path("either.toml").write_text(Path("one.toml").read_text().replace('"red"}]', '"blue"}]'))
    groups = [f'[[group]]\nname = "{name}"\nscene = "{name}.toml"\n' for name in ("one", "either")]
    for name, number in (("alone", 1), ("both", 2)):
        Path(f"{name}.toml").write_text(
            'seeds = [1]\nset = {"run.duration" = 1.0}\n' + "".join(groups[:number]))
        done(f"{name}.toml", name)
    assert "" in pd.read_csv("both/curves.csv", dtype=str, na_filter=False)["wrong_colour"].tolist()
    rows = [[line.partition(",")[2] for line in Path(f"{name}/curves.csv").read_text().splitlines()]
            for name in ("both", "alone")]
    assert rows[0][:3] == rows[1]


def test_the_fingerprint_does_not_depend_on_the_process_or_the_folder(here):
    """It is a hash of the scene's values as text; of a drive of one's own the bytes count."""
    Path("burst.py").write_text(BURST)
    Path("scene.toml").write_text(SCENE[:SCENE.index("[drive]")] + '[drive]\nkind = "user"\n'
                                  'module = "burst.py"\nfunction = "burst"\nparameters = [9.0]\n')
    shutil.copytree(here, here / "elsewhere")
    code = ("import sys; from tbsa.model.scene import fingerprint, load; "
            "print(fingerprint(load(sys.argv[1])))")
    found = {subprocess.run(
        [sys.executable, "-c", code, here / "elsewhere" / "scene.toml"], cwd=ROOT, text=True,
        env=os.environ | {"PYTHONHASHSEED": seed, "TZ": "Asia/Tokyo", "HOSTNAME": "other"},
        capture_output=True, check=True).stdout.strip() for seed in ("1", "2")}
    assert found == {fingerprint(load("scene.toml"))}
    Path("burst.py").write_text(BURST.replace("<", "<="))
    assert fingerprint(load("scene.toml")) not in found


@pytest.mark.parametrize("jobs", [0, -1, 1.5, float("nan"), True, "2"])
def test_a_number_of_processes_is_a_whole_one(here, jobs):
    with pytest.raises(InputError, match=r"jobs: .*must be a whole number and at least 1"):
        campaign("campaign.toml", "out", jobs=jobs)
    assert not Path("out").exists()


def test_it_is_the_same_table_in_processes_and_in_threads(here, whole):
    result = campaign("campaign.toml", "out", jobs=1)
    assert (result.done, result.failed, result.left) == (5, 0, 0)
    assert tables("out") == tables(whole)
    assert result.table["run"].tolist() == pd.read_csv("out/table.csv")["run"].tolist()


def test_a_finished_campaign_resumed_stays_as_it_is(here, whole, capsys):
    shutil.copytree(whole, "out")
    before = contents("out/runs")
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 0
    assert capsys.readouterr().out == "5 runs done, 0 failed; table in out/table.csv\n"
    assert contents("out/runs") == before
    assert tables("out") == tables(whole)
    assert list(Path("out/.locks/sessions").iterdir()) == []


def test_the_longest_run_is_handed_out_first(here):
    class Noting(ThreadPoolExecutor):
        def submit(self, function, job):
            order.append(job.scene.run.duration)
            return super().submit(function, job)

    order = []
    with Noting(1) as pool:
        campaign("campaign.toml", "out", executor=pool)
    assert order == [8.0, 4.0, 4.0, 4.0, 4.0]


def test_of_runs_broken_off_the_one_with_most_left_is_handed_out_first(here, whole):
    class Noting(Executor):
        def submit(self, function, job):
            order.append(job.scene.run.seed)
            future = Future()
            future.set_result(("done", ""))
            return future

    order = []
    shutil.copytree(whole, "out")
    for path in Path("out/runs").glob("*/*/metrics.csv"):
        path.unlink()
    (other,) = Path("out/runs/other").glob("*/run.json")
    for path, at in ((other, 7.0), (next(Path("out/runs/map").glob("2-*/run.json")), 1.0)):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"time": at}))
    campaign("campaign.toml", "out", executor=Noting(), resume=True)
    assert order[:2] == [2, 7]  # 3 s of 4, 1 s of 8, and three runs that lack their metrics only


def test_a_duration_between_two_steps_is_rounded_as_the_run_rounds_it(here):
    Path("campaign.toml").write_text('scene = "scene.toml"\nset = {"run.duration" = 1.0009}\n'
                                     '[[group]]\nname = "a"\nseeds = [1]\n')
    result = done("campaign.toml", "out")
    assert (result.done, result.left) == (1, 0)
    assert result.table["time"].tolist() == pytest.approx([1.0])
    again = done("campaign.toml", "out", resume=True)
    assert (again.done, tables("out")) == (1, tables("out"))
    elsewhere = done("campaign.toml", "rest", without="out/table.csv")
    assert set(elsewhere.table["status"]) == {"elsewhere"}


def test_a_run_is_done_when_its_folder_says_so_not_its_worker(here):
    class Lying(Executor):
        def submit(self, function, job):
            future = Future()
            future.set_result(("done", ""))
            return future

    result = campaign("campaign.toml", "out", executor=Lying())
    assert (result.done, result.failed, result.left) == (0, 0, 5)
    assert set(result.table["status"]) == {"waiting"}


def test_the_bar_shows_all_runs_and_the_time_left(here, whole, capsys, monkeypatch):
    shutil.copytree(whole, "out")
    shutil.rmtree("out/runs/other")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(module, "POLL", 0.01)
    done("campaign.toml", "out", resume=True, progress=True)
    err = capsys.readouterr().err
    assert re.search(r" 66\.7 %\|", err), err  # 4 of 5 runs, two thirds of the time
    assert "5/5 runs done" in err
    assert re.search(r"\[\d\d:\d\d<(\d\d:\d\d|\?)", err)


def test_the_bar_looks_at_the_runs_once_a_second(here, whole, monkeypatch):
    shutil.copytree(whole, "out")
    plan, now, looked = read_plan("campaign.toml"), [100.0], []
    folder = module._folder
    monkeypatch.setattr(module, "_folder", lambda *of: looked.append(1) or folder(*of))
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    bar = module._Bar(Path("out"), plan, plan, True)
    all_of_them = sum(each.cost for each in plan)
    assert bar._under_way({}) == pytest.approx(all_of_them)
    for _ in range(4):
        now[0] += module.POLL
        # What has ended since the last look is not counted twice.
        assert bar._under_way({plan[0].name: ("done", "")}) == pytest.approx(
            all_of_them - plan[0].cost)
    assert len(looked) == len(plan)
    now[0] += module.POLL
    bar._under_way({})
    assert len(looked) == 2 * len(plan)


def test_no_bar_where_stderr_is_closed(here, monkeypatch):
    monkeypatch.setattr(sys, "stderr", None)
    assert done("campaign.toml", "out", progress=True).done == 5


def test_no_bar_where_it_is_not_wanted(here, capsys):
    done("campaign.toml", "out")
    assert capsys.readouterr().err == ""


# ---------------------------------------------------------------------------------------------
# Runs that fail.


@pytest.fixture
def failing(here):
    """A campaign of four runs, two of which stop being finite."""
    Path("burst.py").write_text(BURST)
    Path("campaign.toml").write_text(
        'scene = "scene.toml"\nseeds = [1, 2]\n[[group]]\nname = "a"\nset = {"drive.kind" = '
        '"user", "drive.module" = "burst.py", "drive.function" = "burst"}\n'
        'grid = {"drive.parameters" = [[2.5], [9.0]]}\n')
    return here


def test_a_run_that_fails_is_told_of_and_the_others_go_on(failing, capsys):
    assert main(["campaign", "campaign.toml", "--out", "out", "--jobs", "1"]) == 1
    out, err = capsys.readouterr()
    assert out == "2 runs done, 2 failed; table in out/table.csv\n"
    assert len(re.findall("failed: positions or velocities stopped being finite", err)) == 2
    table = pd.read_csv("out/table.csv")
    assert table["status"].tolist() == ["failed", "failed", "done", "done"]
    assert table["message"].str.contains("stopped being finite").tolist()[:2] == [True, True]
    assert table["size"].isna().tolist() == [True, True, False, False]
    before = tables("out")
    assert done("campaign.toml", "out", resume=True).failed == 2
    assert tables("out") == before
    # The share of another process keeps what is known of this one's.
    assert done("campaign.toml", "out", resume=True, part=(4, 4)).failed == 0
    assert tables("out") == before


@pytest.mark.parametrize("what", ["fx[7] = 1e300 * 1e300", "raise ValueError('boo')"])
def test_the_table_of_runs_that_fail_does_not_depend_on_how_they_were_cut(
        failing, monkeypatch, what):
    Path("burst.py").write_text(BURST.replace("fx[7] = 1e300 * 1e300", what))
    assert done("campaign.toml", "out").failed == 2
    monkeypatch.setattr(records, "GLANCE", 1e-5)
    assert done("campaign.toml", "fine").failed == 2
    assert tables("fine") == tables("out")


@pytest.mark.parametrize(("executor", "name"), [(3, "int"), (ThreadPoolExecutor, "ThreadPool")])
def test_what_is_no_executor_is_refused_before_anything_is_written(here, executor, name):
    with pytest.raises(TypeError, match=rf"must be a concurrent\.futures\.Executor.*{name}"):
        campaign("campaign.toml", "out", executor=executor)
    assert not Path("out").exists()


@pytest.mark.parametrize("part", ["1/2", (1, 2, 3), (1.0, 2), (0, 2), (3, 2), None])
def test_what_is_no_part_is_refused_before_anything_is_written(here, part):
    with pytest.raises(InputError, match=r"part: .* must be I/N, I from 1 to N"):
        campaign("campaign.toml", "out", part=part)
    assert not Path("out").exists()


def test_a_script_without_a_guard_is_told_what_it_lacks(here):
    """Each worker reads the script that began the campaign."""
    Path("script.py").write_text(
        "import tbsa\ntbsa.campaign('campaign.toml', 'out', jobs=1)\n")
    found = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True,
                           check=False)
    assert found.returncode == 1
    assert 'that must stand below if __name__ == "__main__":' in found.stderr
    assert "holds a campaign already" not in found.stderr


def test_a_folder_that_may_not_be_entered_is_told_of(here, monkeypatch):
    def may_not(self):
        if self == Path("out", "runs"):
            raise PermissionError(13, "Permission denied", str(self))
        return exists(self)

    Path("out").mkdir()
    exists = Path.exists
    monkeypatch.setattr(Path, "exists", may_not)
    monkeypatch.setattr(module, "may_be_filled", lambda place: place != Path("out"))
    with pytest.raises(InputError, match="out: must be a folder that may be written"):
        campaign("campaign.toml", "out", resume=True)


def test_what_an_executor_raises_is_a_failed_run(here):
    class Losing(ThreadPoolExecutor):
        def submit(self, function, job):
            if job.scene.run.seed != 7:
                return super().submit(function, job)
            future = Future()
            future.set_exception(RuntimeError("worker died\n3 times"))
            return future

    with Losing(1) as pool:
        result = campaign("campaign.toml", "out", executor=pool)
    assert (result.done, result.failed, result.left) == (4, 1, 0)
    assert result.table["message"].iloc[-1] == "RuntimeError: worker died 3 times"


def test_a_run_whose_worker_was_lost_after_it_was_done_is_no_failed_one(here, whole):
    """A cluster may lose sight of a worker that goes on with its run to the end."""
    class Losing(Executor):
        def submit(self, function, /, *arguments):
            function(*arguments)
            future = Future()
            future.set_exception(RuntimeError("lost"))
            return future

    result = campaign("campaign.toml", "out", executor=Losing())
    assert (result.done, result.failed, result.left) == (5, 0, 0)
    assert tables("out") == tables(whole)


def test_a_client_of_dask_is_told_what_of_it_is_an_executor(here):
    class Client:
        def submit(self, *_):
            raise AssertionError

        def get_executor(self, **_):
            raise AssertionError

    with pytest.raises(TypeError, match=r"client\.get_executor\(pure=False\)"):
        campaign("campaign.toml", "out", executor=Client())
    assert not Path("out").exists()


def with_own_drive():
    """A campaign of three runs with a drive in a file of its own; its text."""
    source = BURST[:BURST.index("    if p")] + "    fx[7] += 0.01\n"
    Path("burst.py").write_text(source)
    Path("own.toml").write_text(SCENE[:SCENE.index("[drive]")] + '[drive]\nkind = "user"\n'
                                'module = "burst.py"\nfunction = "burst"\n'
                                + SCENE[SCENE.index("[floor]"):])
    Path("campaign.toml").write_text('scene = "own.toml"\nseeds = [1, 2, 3]\n'
                                     '[[group]]\nname = "a"\n')
    return source


def test_the_drive_of_a_scene_that_is_a_link_is_beside_the_link(here):
    """As for `tbsa run`: one scene may be shared by studies with a drive each."""
    with_own_drive()
    Path("shared").mkdir()
    Path("own.toml").rename("shared/own.toml")
    Path("own.toml").symlink_to("shared/own.toml")
    assert done("campaign.toml", "out").done == 3
    Path("shared/burst.py").write_text(BURST)  # of another study
    assert done("campaign.toml", "again").done == 3
    assert tables("again") == tables("out")


def test_a_drive_that_is_edited_while_a_campaign_goes_on_ends_what_is_not_begun(here, monkeypatch):
    """Runs of what was not planned would be in folders of what was."""
    source, once = with_own_drive(), module.run

    def then_edit(*arguments, **options):
        outcome = once(*arguments, **options)
        Path("burst.py").write_text(source + "# edited\n")
        return outcome

    monkeypatch.setattr(module, "run", then_edit)
    result = done("campaign.toml", "out")
    assert (result.done, result.failed, result.left) == (1, 2, 0)
    messages = result.table["message"][result.table["status"] == "failed"]
    assert messages.str.contains("drive.module: .* was changed after the campaign was begun").all()
    Path("burst.py").write_text(source)
    monkeypatch.setattr(module, "run", once)
    assert done("campaign.toml", "out", resume=True).done == 3


def test_a_disk_that_fills_up_loses_nothing(here, whole):
    left, sync = 12, os.fsync

    def full(descriptor):
        nonlocal left
        left -= 1
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device", "/some/where")
        sync(descriptor)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space left"):  # not even for the table
            done("campaign.toml", "out")
    assert not Path("out/table.csv").exists()
    assert len(list(Path("out/runs").glob("*/*/run.json"))) >= 1
    assert done("campaign.toml", "out", resume=True).done == 5
    assert tables("out") == tables(whole)


def test_a_full_disk_is_the_message_of_the_runs_that_it_stopped(here, monkeypatch):
    write = module.write_atomically

    def full(path, data):
        if path.name == "metrics.csv":
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write(path, data)

    monkeypatch.setattr(module, "write_atomically", full)
    result = done("campaign.toml", "out")
    assert result.failed == 5
    assert set(result.table["message"]) == {"No space left on device"}


def test_a_damaged_run_is_told_of_not_done_anew(here, whole):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").iterdir()
    (victim / "checkpoint.npz").write_bytes(b"PK?")
    (victim / "run.json").write_text((victim / "run.json").read_text().replace(
        '"time": 8.0', '"time": 6.0'))
    result = done("campaign.toml", "out", resume=True)
    assert result.failed == 1
    message = result.table["message"].iloc[-1]
    assert message.startswith("checkpoint.npz: is damaged")
    assert "other" not in message  # no names of folders
    assert (victim / "checkpoint.npz").read_bytes() == b"PK?"


@pytest.mark.parametrize("data", [
    b"", b"\xff\xfe\x00", b"run;status\na;done\n", b"a,b\n1\n1,2,3\n", b"{" * 9])
def test_a_table_that_cannot_be_read_is_made_anew(here, whole, data):
    shutil.copytree(whole, "out")
    Path("out/table.csv").write_bytes(data)
    done("campaign.toml", "out", resume=True)
    assert tables("out") == tables(whole)


@pytest.mark.parametrize("damage", [
    lambda text: "", lambda text: text.splitlines()[0] + "\n", lambda text: "words\n",
    lambda text: text.replace("bonds,", "bands,"), lambda text: text.replace(",True,", ",yes,"),
    lambda text: text[:-20], lambda text: text.replace(",", ";"), lambda text: "\0",
    lambda text: text.replace(",5,", "," + "1" * 5000 + ","),
    lambda text: "".join(text.splitlines(keepends=True)[:3] + text.splitlines(keepends=True)[4:]),
    lambda text: "".join(sorted(text.splitlines(keepends=True) * 2)),
    lambda text: text[:-40] + text[-40:].replace("0", "1", 1)])
def test_metrics_that_are_damaged_are_made_anew(here, whole, damage):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").glob("*/metrics.csv")
    victim.write_text(damage(victim.read_text()))
    before = victim.with_name("records.npy").read_bytes()
    assert done("campaign.toml", "out", resume=True).done == 5
    assert tables("out") == tables(whole)
    assert victim.with_name("records.npy").read_bytes() == before


@pytest.mark.parametrize("changes", [
    {"version": None}, {"version": 1}, {"time": "0.5"}, {"time": None}, {"time": 10**400},
    {"wall": "long"}, {"counts": None}, {"counts": {}}])
def test_a_damaged_run_json_is_made_anew_or_told_of(here, whole, changes):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").glob("*/run.json")
    info = json.loads(victim.read_text()) | changes
    victim.write_text(json.dumps({name: value for name, value in info.items()
                                  if value is not None}))
    result = done("campaign.toml", "out", resume=True)
    if "wall" in changes:
        assert result.table["message"].iloc[-1].startswith(
            "run.json: wall: 'long' is damaged")
    else:
        assert tables("out") == tables(whole)


def test_the_columns_of_metrics_are_those_of_the_table(whole):
    for path in whole.glob("runs/*/*/metrics.csv"):
        assert tuple(path.read_text().splitlines()[0].split(",")) == COLUMNS


# ---------------------------------------------------------------------------------------------
# Interrupted.

LONG = """
scene = "scene.toml"
set = {"run.duration" = 80.0, "record.interval" = 2.0, "record.checkpoint" = 4.0}
[[group]]
name = "a"
seeds = {first = 1, number = 3}
[[group]]
name = "b"
scene = "shaking.toml"
seeds = {stream = "b", number = 1}
set = {"run.duration" = 40.0}
"""


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """The folder of a campaign long enough to be killed, done without a break."""
    home = tmp_path_factory.mktemp("long")
    (home / "scene.toml").write_text(SCENE)
    (home / "shaking.toml").write_text(SHAKING)
    (home / "campaign.toml").write_text(LONG)
    done(home / "campaign.toml", home / "out")
    return home / "out"


def begun(here, *arguments, **options):
    """A process that does the long campaign."""
    (here / "campaign.toml").write_text(LONG)
    return subprocess.Popen(
        [*COMMAND, here / "campaign.toml", "--out", here / "out", *arguments],
        cwd=ROOT, start_new_session=True, stderr=subprocess.PIPE, text=True, **options)


def reached(out):
    """Simulated seconds of all runs, as checkpointed (s)."""
    return sum(json.loads(path.read_text())["time"]
               for path in Path(out).glob("runs/*/*/run.json"))


def under_way(out):
    """Whether a run has been checkpointed in its middle."""
    return reached(out) > 0.0


@pytest.mark.parametrize("send", [
    os.killpg,  # as a terminal does, to the workers too
    pytest.param(os.kill, marks=pytest.mark.slow),  # as a script does
    pytest.param(lambda process, _: os.kill(process, signal.SIGTERM), marks=pytest.mark.slow),
])
def test_ctrl_c_saves_every_run_and_says_how_to_go_on(here, long, send):
    child = begun(here, "--jobs", "2")
    until(lambda: under_way("out"))
    send(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert re.search(r"stopped and saved, \d runs to go", err)
    assert err.splitlines()[-1].endswith("--resume")
    assert "Traceback" not in err
    assert "waiting" in set(pd.read_csv("out/table.csv")["status"])
    for path in Path("out/runs").glob("*/*"):
        times = np.load(path / "records.npy")["time"]
        saved = json.loads((path / "run.json").read_text())["time"]
        assert saved >= times[-1]  # saved when it stopped, not at the last checkpoint
    assert done("campaign.toml", "out", resume=True).done == 4
    assert tables("out") == tables(long)


def test_ctrl_c_twice_does_not_wait_for_whole_runs_and_says_how_to_go_on(here, long):
    child = begun(here, "--jobs", "1")
    until(lambda: under_way("out"))
    child.send_signal(signal.SIGINT)
    time.sleep(0.02)  # less than between two looks at the workers
    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    said, command = err.splitlines()[-2:]
    assert re.fullmatch(r"(broken off|stopped and saved, \d runs to go); go on with", said)
    assert command.endswith(f"campaign.toml --out {here / 'out'} --jobs 1 --resume")
    assert not list(Path("out/runs").glob("*/*/metrics.csv"))
    assert done("campaign.toml", "out", resume=True).done == 4
    assert tables("out") == tables(long)


def test_workers_of_a_killed_campaign_save_and_end(here, long):
    child = begun(here, "--jobs", "1")
    until(lambda: under_way("out"))
    child.kill()
    child.wait()
    # Its workers are in its group; when the last has gone the group has.
    until(lambda: not alive(child.pid), 20.0)
    (claim,) = Path("out/.locks/sessions").iterdir()
    assert done("campaign.toml", "out", resume=True).done == 4
    assert not claim.exists()
    assert tables("out") == tables(long)


LATE = """
import multiprocessing, os, signal, sys, time
from pathlib import Path
from tbsa.work import campaign

def worker():
    def finished(job):
        # As a run does in its last moments: it takes the signal, and is done all the same.
        signals = []
        signal.signal(signal.SIGTERM, lambda *_: signals.append(1))
        if KILLED:
            os.kill(os.getppid(), signal.SIGKILL)
            while not signals:
                time.sleep(0.01)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        return True
    campaign._run = finished
    campaign._in_pool()
    here = Path(sys.argv[1])
    here.joinpath("session").touch()
    how = campaign.work(campaign.Job(None, "", here, here / "lock", here / "session"))
    here.joinpath("lives").write_text(how[0])

child = multiprocessing.get_context("fork").Process(target=worker)
child.start()
child.join()
"""


@pytest.mark.parametrize("killed", [False, True])
def test_a_run_that_takes_the_signal_in_its_last_moments_leaves_no_worker_behind(killed, tmp_path):
    """A worker whose campaign was killed has nobody who would give it work or end it."""
    child = subprocess.Popen(
        [sys.executable, "-c", LATE.replace("KILLED", str(killed)), tmp_path],
        cwd=ROOT, start_new_session=True)
    assert child.wait() == (-signal.SIGKILL if killed else 0)
    until(lambda: not alive(child.pid), 20.0)
    assert (tmp_path / "lives").exists() != killed


def alive(group):
    """Whether a process of the group is left, zombies apart."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, of = path.read_text().rpartition(") ")[2].split()[:3]
        except OSError:
            continue
        if int(of) == group and state != "Z":
            return True
    return False


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_no_more_than_its_checkpoint(here, long):
    child = begun(here, "--jobs", "1")
    until(lambda: under_way("out"))
    os.kill(a_worker(child.pid), signal.SIGKILL)
    assert child.wait(timeout=120) == 0, child.stderr.read()
    assert tables("out") == tables(long)


def a_worker(parent):
    """The number of a process of the pool."""
    for path in Path("/proc").glob("[0-9]*/status"):
        try:
            text = path.read_text()
            words = (path.parent / "cmdline").read_text()
        except OSError:
            continue
        if f"PPid:\t{parent}\n" in text and "spawn_main" in words:
            return int(path.parent.name)
    raise AssertionError("there is none")


def killed(here, kills, numbers, pause=0.5):
    """Kill the long campaign at random moments, up to `pause` s after a checkpoint."""
    for kill in range(kills):
        before = reached("out")
        child = begun(here, "--resume", "--jobs", "2")
        if numbers.random() < 0.8:
            until(lambda before=before: reached("out") > before)
            time.sleep(numbers.uniform(0.0, pause))
        else:  # while it starts
            time.sleep(numbers.uniform(0.2, 1.5))
        assert child.poll() is None, "it ended before it was killed"
        # All its processes, or only the one that hands out the runs.
        (os.killpg if kill % 2 else os.kill)(child.pid, signal.SIGKILL)
        child.wait()


def test_killed_at_random_and_resumed_it_gives_the_same_table(here, long):
    killed(here, 2, random.Random(4), pause=0.1)
    assert 0.0 < reached("out") < 280.0
    assert done("campaign.toml", "out", resume=True).done == 4
    assert tables("out") == tables(long)


@pytest.mark.slow
def test_killed_twenty_times_at_random_it_gives_the_same_table(here, monkeypatch):
    monkeypatch.setitem(globals(), "LONG", LONG.replace("80.0", "2500.0").replace("40.0", "2000.0"))
    killed(here, 20, random.Random(5))
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 0
    done("campaign.toml", "whole")
    assert tables("out") == tables("whole")
    for each in read_plan("campaign.toml"):
        for name in ("records.npy", "checkpoint.npz", "metrics.csv", "scene.toml"):
            assert (Path("out/runs") / each.name / name).read_bytes() == (
                Path("whole/runs") / each.name / name).read_bytes()


def test_killed_before_it_was_a_run_it_begins_anew(here, whole):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").iterdir()
    for name in ("run.json", "checkpoint.npz", "metrics.csv"):
        (victim / name).unlink()
    with open(victim / "records.npy", "r+b") as file:
        file.truncate(1000)  # what a kill in the first moment leaves
    done("campaign.toml", "out", resume=True)
    assert tables("out") == tables(whole)


@pytest.mark.parametrize("name", ["runs", ".locks"])
def test_a_file_in_the_place_of_a_folder_is_told_of_first(here, whole, capsys, name):
    shutil.copytree(whole, "out")
    shutil.rmtree(f"out/{name}")
    Path("out", name).touch()
    before = tables("out")
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    assert f"out/{name}: must be a folder" in capsys.readouterr().err
    assert tables("out") == before


@pytest.mark.parametrize("name", ["table.csv", "curves.csv", "wall.csv"])
def test_a_folder_in_the_place_of_a_table_is_told_of_first(here, whole, capsys, name):
    shutil.copytree(whole, "out")
    Path("out", name).unlink()
    Path("out", name).mkdir()
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    assert f"out/{name}: must be a file, and is a folder" in capsys.readouterr().err


@pytest.mark.parametrize("duration", ["nan", "inf", "1e400", "1e308", "-5", "long", ""])
def test_a_table_whose_durations_are_none_is_refused(here, whole, capsys, duration):
    rows = (whole / "table.csv").read_text().splitlines()
    at = rows[0].split(",").index("duration")
    cells = rows[1].split(",")
    cells[at] = duration
    Path("elsewhere.csv").write_text("\n".join([rows[0], ",".join(cells), *rows[2:]]) + "\n")
    assert main(["campaign", "campaign.toml", "--out", "new", "--except", "elsewhere.csv"]) == 2
    assert "elsewhere.csv: must be the table.csv of a campaign" in capsys.readouterr().err
    assert not Path("new").exists()


def test_two_hundred_thousand_seeds_are_refused_at_once(here, capsys):
    Path("many.toml").write_text(f"""scene = "scene.toml"
seeds = {list(range(200_001))}
[[group]]
name = "a"
""")
    begin = time.monotonic()
    assert main(["campaign", "many.toml", "--out", "new"]) == 2
    assert "seeds: 200001 must have at most" in capsys.readouterr().err
    assert time.monotonic() - begin < 10.0


def test_a_run_that_has_lost_its_run_json_is_told_of_and_stays(here, whole):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").iterdir()
    (victim / "run.json").unlink()
    (victim / "notes.txt").write_text("mine")
    before = {path.name: path.read_bytes() for path in victim.iterdir()}
    result = done("campaign.toml", "out", resume=True)
    assert result.failed == 1
    assert result.table["message"].iloc[-1] == (
        "must be a new or an empty folder, or that of a run, which has a run.json")
    assert {path.name: path.read_bytes() for path in victim.iterdir()} == before


def test_killed_between_a_run_and_its_metrics_they_are_made_on_resume(here, whole):
    shutil.copytree(whole, "out")
    (victim,) = Path("out/runs/other").iterdir()
    (victim / "metrics.csv").unlink()
    before = (victim / "records.npy").read_bytes()
    done("campaign.toml", "out", resume=True)
    assert tables("out") == tables(whole)
    assert (victim / "records.npy").read_bytes() == before


# ---------------------------------------------------------------------------------------------
# Two at once.


def test_two_processes_on_one_campaign_are_refused(here, capsys):
    child = begun(here, "--jobs", "1")
    until(lambda: under_way("out"))
    os.kill(child.pid, signal.SIGSTOP)  # so that it does not end meanwhile
    (here / "more.toml").write_text(LONG + '[[group]]\nname = "more"\nseeds = [3]\n')
    try:
        for words, arguments in (
                ("holds a campaign already: go on with it (--resume)", ["campaign.toml"]),
                (f"is in use: process {child.pid} on ", ["campaign.toml", "--resume"]),
                ("is doing its runs", ["campaign.toml", "--resume", "--part", "2/3"]),
                ("is at work with another plan", ["more.toml", "--resume", "--part", "4/5"])):
            assert main(["campaign", *arguments, "--out", "out"]) == 2
            err = capsys.readouterr().err
            assert err.startswith("tbsa: out: ")
            assert err.count("\n") == 1
            assert words in err
    finally:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def test_two_processes_on_one_run_are_refused(here, capsys):
    scene = load("scene.toml")
    records.run(scene, "run")
    with locked(Path("run/records.npy")):
        before = contents("run")
        assert main(["run", "scene.toml", "--duration", "6", "--out", "run", "--resume"]) == 2
        assert capsys.readouterr().err == "tbsa: run: is in use: another process is at work on it\n"
        assert contents("run") == before
    assert records.run(replace(scene, run=Run(6.0, 1)), "run", resume=True).finished
    assert tbsa.read_run("run").time[-1] == 6.0


def test_a_run_holds_its_folder_while_it_goes_on(here):
    def another(simulation, recorded):
        with pytest.raises(Busy):
            records.run(replace(simulation.scene, run=Run(9.0, 1)), "run", resume=True)
        tried.append(recorded)

    tried = []
    assert records.run(load("scene.toml"), "run", progress=another).finished
    assert tried


def test_a_lock_is_waited_for(here):
    order = []

    def hold():
        with locked(Path("lock")):
            order.append("held")
            time.sleep(0.3)
            order.append("let go")

    holder = threading.Thread(target=hold)
    holder.start()
    until(lambda: order)
    with locked(Path("lock"), wait=10.0):
        order.append("taken")
    holder.join()
    assert order == ["held", "let go", "taken"]


def test_without_locks_a_run_goes_on_and_a_campaign_is_refused(here, capsys, monkeypatch):
    monkeypatch.setattr(records, "_flock", lambda _: None)
    assert records.run(load("scene.toml"), "run").finished
    assert main(["campaign", "campaign.toml", "--out", "out"]) == 2
    assert "must be on a file system with locks (flock)" in capsys.readouterr().err
    assert not Path("out/campaign.json").exists()


def test_shares_are_done_by_processes_of_their_own_at_the_same_time(here, long):
    child = begun(here, "--part", "1/2", "--resume", "--jobs", "1")
    until(lambda: under_way("out"))
    with pytest.raises(Busy, match="is in use"):
        done("campaign.toml", "out", resume=True, part=(1, 3))
    assert done("campaign.toml", "out", resume=True, part=(2, 2)).done == 2
    _, err = child.communicate(timeout=120)
    assert child.returncode == 0, err
    assert tables("out") == tables(long)


# ---------------------------------------------------------------------------------------------
# Another file on resume.


def test_a_file_with_more_and_longer_runs_is_gone_on_with(here, whole, tmp_path):
    shutil.copytree(whole, "out")
    more = CAMPAIGN.replace("[0.08, 0.1]", "[0.08, 0.09, 0.1]").replace("8.0", "11.0")
    Path("campaign.toml").write_text(more + '[[group]]\nname = "third"\nseeds = [3]\n')
    result = done("campaign.toml", "out", resume=True)
    assert result.done == 8
    done("campaign.toml", "anew")
    assert tables("out") == tables("anew")


def test_a_longer_run_killed_before_its_metrics_does_not_keep_the_old_ones(here, whole):
    shutil.copytree(whole, "out")
    Path("campaign.toml").write_text(CAMPAIGN.replace("8.0", "11.0"))
    (each,) = [each for each in read_plan("campaign.toml") if each.group == "other"]
    folder = Path("out/runs") / each.name
    session = here / "session"
    session.touch()
    job = module.Job(each.scene, each.mark, folder, here / "lock", session)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "read_run", _broken_off)
        assert module.work(job) == ("stopped", "")
    assert json.loads((folder / "run.json").read_text())["finished"]
    done("campaign.toml", "out", resume=True)
    assert pd.read_csv("out/table.csv")["time"].iloc[-1] == 11.0


def _broken_off(_):
    raise KeyboardInterrupt


@pytest.mark.parametrize(("old", "new", "words"), [
    ("[0.08, 0.1]", "[0.08]", "is a run of the folder, but not of this file, with its scenes and"),
    ("8.0", "6.0", "run.duration: 6.0 s is less than the 8 s"),
    ('"run.duration" = 8.0', '"run.duration" = 8.0, "record.interval" = 0.5',
     "record.interval, other colours or another temperature: these have to stay"),
    ('"run.duration" = 8.0', '"run.duration" = 8.0, "temperature" = 1',
     "these have to stay what they were"),
])
def test_a_file_that_does_not_fit_what_is_there_is_refused(here, whole, capsys, old, new, words):
    shutil.copytree(whole, "out")
    before = contents("out")
    Path("campaign.toml").write_text(CAMPAIGN.replace(old, new))
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("tbsa: campaign.toml: ")
    assert words in err
    assert contents("out") == before


@pytest.mark.parametrize(("text", "words"), [
    ("{", "is damaged"), ("[]", "is damaged"), ('{"format": 9}', "must be 1"),
    ("[" * 100_000, "is damaged"),
    ('{"format": 1, "runs": [{}]}', "is damaged"), ('{"format": 1}', "is damaged")])
def test_a_damaged_plan_is_refused(here, whole, capsys, text, words):
    shutil.copytree(whole, "out")
    Path("out/campaign.json").write_text(text)
    before = contents("out")
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    assert words in capsys.readouterr().err
    assert contents("out") == before


def test_a_plan_that_cannot_be_opened_is_not_called_damaged(here, capsys):
    Path("out/campaign.json").mkdir(parents=True)
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    assert "out/campaign.json: cannot be read: Is a directory" in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------
# In parts, in folders of their own.


def test_what_a_table_has_as_done_is_left_out(here, whole, capsys):
    rows = pd.read_csv(whole / "table.csv", dtype=str, keep_default_na=False)
    rows[rows["group"] == "map"].to_csv("kept.csv", index=False)
    assert main(["campaign", "campaign.toml", "--out", "out", "--except", "kept.csv"]) == 0
    assert capsys.readouterr().out == (
        "1 run done, 0 failed, 4 done elsewhere; table in out/table.csv\n")
    table = pd.read_csv("out/table.csv")
    assert table["status"].tolist() == ["elsewhere"] * 4 + ["done"]
    assert [path.parent.name for path in Path("out/runs").glob("*/*")] == ["other"]
    # Without the table all that the folder lacks is done, and is what it would have been.
    done("campaign.toml", "out", resume=True)
    assert tables("out") == tables(whole)


def test_nothing_is_left_to_do_where_all_is_done_elsewhere(here, whole):
    result = done("campaign.toml", "out", without=whole / "table.csv")
    assert (result.done, result.left) == (0, 0)
    assert set(result.table["status"]) == {"elsewhere"}


def test_a_run_done_elsewhere_for_a_shorter_time_is_done_here(here, whole):
    Path("campaign.toml").write_text(CAMPAIGN.replace("8.0", "11.0"))
    result = done("campaign.toml", "out", without=whole / "table.csv")
    assert result.done == 1
    assert result.table["time"].tolist()[-1] == 11.0


@pytest.mark.parametrize(("change", "words"), [
    (("[0.08, 0.1]", "[0.08]"), "run: 'map/* is done there and is no run of this campaign"),
    (("seeds = [1, 2]", 'seeds = [1, 2]\nset = {"magnet.cutoff" = 0.02}'),
     "run: 'map/* its scene has another setting now"),
    # These are in no fingerprint, but no table has them twice.
    (("seeds = [1, 2]", 'seeds = [1, 2]\nset = {"record.interval" = 0.5}'),
     "run: 'map/* was done there with another record.interval"),
    (("8.0", "7.0"), "run.duration: 7.0 s is less than the 8 s that other/* has there"),
])
def test_a_table_of_another_campaign_is_refused(here, whole, capsys, change, words):
    """Before its runs are done, and not when they are to be kept beside those."""
    Path("campaign.toml").write_text(CAMPAIGN.replace(*change))
    table = whole / "table.csv"
    assert main(["campaign", "campaign.toml", "--out", "out", "--except", str(table)]) == 2
    first, _, rest = words.partition("*")
    err = capsys.readouterr().err
    assert err.startswith(f"tbsa: {table}: {first}")
    assert rest in err
    assert not Path("out").exists()


@pytest.mark.parametrize(("text", "words"), [
    (None, "must be the table.csv of a campaign: No such file"),
    ("a,b\n1,2\n", "must be the table.csv of a campaign: KeyError 'status'"),
    ("", "must be the table.csv of a campaign: EmptyDataError"),
])
def test_what_is_no_table_is_refused(here, capsys, text, words):
    if text is not None:
        Path("kept.csv").write_text(text)
    assert main(["campaign", "campaign.toml", "--out", "out", "--except", "kept.csv"]) == 2
    assert capsys.readouterr().err.startswith(f"tbsa: kept.csv: {words}")
    assert not Path("out").exists()


def test_runs_of_another_version_do_not_count_as_done(here, whole, monkeypatch):
    monkeypatch.setattr(tbsa, "__version__", "9.9")
    with pytest.raises(InputError, match=r"version: '.*' must be 9\.9, this version"):
        done("campaign.toml", "out", without=whole / "table.csv")


def test_runs_of_another_version_are_not_gone_on_with(here, whole, capsys, monkeypatch):
    shutil.copytree(whole, "out")
    before = contents("out")
    monkeypatch.setattr(tbsa, "__version__", "9.9")
    Path("campaign.toml").write_text(CAMPAIGN + '[[group]]\nname = "third"\nseeds = [3]\n')
    assert main(["campaign", "campaign.toml", "--out", "out", "--resume"]) == 2
    err = capsys.readouterr().err
    assert re.match(r"tbsa: out/runs/map/1-\w+/run\.json: version: '.*' must be 9\.9, this", err)
    assert err.count("\n") == 1
    assert contents("out") == before


def test_the_tables_are_there_before_the_end(here, whole, monkeypatch):
    class Slow(ThreadPoolExecutor):
        def submit(self, function, job):
            def later():
                if job.scene.run.seed != 7:  # handed out first
                    until(Path("out/table.csv").exists)
                    seen.append(pd.read_csv("out/table.csv")["status"].tolist())
                return function(job)
            return super().submit(later)

    seen = []
    monkeypatch.setattr(module, "REFRESH", 0.0)
    with Slow(1) as pool:
        campaign("campaign.toml", "out", executor=pool)
    assert seen[0] == ["waiting"] * 4 + ["done"]
    assert tables("out") == tables(whole)


def test_settings_are_one_for_all_seeds_and_for_nothing_else(here):
    plan = planned(CAMPAIGN + '[[group]]\nname = "colour"\nseeds = [1]\n'
                   'set = {"tiles.type[0].colour" = "red", "drive.force" = 0.1}\n')
    settings = {each.name: each.settings for each in plan}
    assert len(set(settings.values())) == 4  # two forces, shaking, other colours
    assert plan[0].settings == plan[1].settings != plan[2].settings
    longer = planned(CAMPAIGN.replace("8.0", "9.0"))
    assert [each.settings for each in longer] == [each.settings for each in plan[:5]]


# ---------------------------------------------------------------------------------------------
# Executors.


class Inline(Executor):
    """Does it on the spot."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future


def test_any_executor_will_do(here, whole):
    assert campaign("campaign.toml", "out", executor=Inline()).done == 5
    assert tables("out") == tables(whole)


def test_ctrl_c_ends_all_that_an_executor_does_on_the_spot(here, monkeypatch):
    begun = []

    def interrupted(scene, folder, *, progress, **options):
        begun.append(folder)
        return records.run(scene, folder, **options,
                           progress=lambda *_: signal.raise_signal(signal.SIGINT))

    monkeypatch.setattr(module, "run", interrupted)
    result = campaign("campaign.toml", "out", executor=Inline())
    assert (result.done, result.failed, result.left, len(begun)) == (0, 0, 5, 1)
    monkeypatch.setattr(module, "run", records.run)
    assert campaign("campaign.toml", "out", executor=Inline(), resume=True).done == 5


def test_an_executor_of_ones_own_is_not_shut_down(here):
    with ThreadPoolExecutor(1) as pool:
        campaign("campaign.toml", "out", executor=pool)
        assert pool.submit(lambda: 1).result() == 1


def test_workers_that_always_die_end_it_with_a_message(here, monkeypatch):
    monkeypatch.setattr(module, "_in_pool", _dead)
    monkeypatch.setattr(module, "LIVES", 1)
    with pytest.raises(RuntimeError, match="workers died, the runs that are done are kept"):
        campaign("campaign.toml", "out", jobs=1)
    assert list(Path("out/.locks/sessions").iterdir()) == []
    assert set(pd.read_csv("out/table.csv")["status"]) == {"waiting"}


def _dead():
    os._exit(3)


def test_without_dask_it_says_what_to_install(here, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["campaign", "campaign.toml", "--out", "out", "--scheduler", "x:1"]) == 2
    assert "needs the package distributed: pip install 'tbsa[cluster]'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_dask_worker_killed_in_the_middle_leaves_the_same_table(here, long):
    """A scheduler and two workers on loopback, in processes of their own."""
    (here / "campaign.toml").write_text(LONG)
    dask = [sys.executable, "-m", "dask"]
    quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    at = ["--scheduler-file", str(here / "scheduler.json"), "--no-dashboard"]
    children = [subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *at],
                                 **quiet)]
    try:
        until((here / "scheduler.json").exists)
        children += [subprocess.Popen([*dask, "worker", "--nthreads", "1", "--no-nanny", *at],
                                      **quiet) for _ in range(2)]
        address = json.loads((here / "scheduler.json").read_text())["address"]
        command = subprocess.Popen(
            [*COMMAND, here / "campaign.toml", "--out", here / "out", "--scheduler", address],
            cwd=ROOT, stderr=subprocess.PIPE, text=True)
        children.append(command)
        until(lambda: under_way("out"))
        children[1].kill()
        _, err = command.communicate(timeout=120)
        assert command.returncode == 0, err
        assert children[2].poll() is None
        assert tables("out") == tables(long)
    finally:
        for child in children:
            child.kill()
            child.wait()


def test_an_error_keeps_its_words_on_the_way_between_processes():
    import pickle

    error = pickle.loads(pickle.dumps(InputError("must be 1", file="a/b.toml", field="x", value=2)))
    assert str(error) == "a/b.toml: x: 2 must be 1"
    assert error.without_file == "x: 2 must be 1"
