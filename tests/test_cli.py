"""The command line, the README's examples, and everything that must be refused."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from malformed import MALFORMED
from numpy.lib.recfunctions import repack_fields

import tbsa
from tbsa.model import records, simulation
from tbsa.work import bench as benches
from tbsa.work import campaign as campaigns
from tbsa.work import cli, metrics
from tbsa.work.cli import code_of, main
from tbsa.work.plan import changed
from theory.floor import MEAN_DISTANCE
from theory.magnets import Law, force

ROOT = Path(__file__).parents[1]
SCENE = """
title = "A small reactor"
[tiles]
set = "chessboard"
[seed]
shape = "cross"
arm = 1
[reactor]
shape = "circle"
radius = 0.14
[free]
number = 26
[magnet]
[drive]
kind = "unicycle"
force = 0.1
torque = 3e-3
frequency = 0.5
[floor]
[record]
interval = 0.5
checkpoint = 1.0
[run]
duration = 2.0
seed = 5
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a finished run of the scene; not to be written to."""
    home = tmp_path_factory.mktemp("finished")
    (home / "scene.toml").write_text(SCENE)
    assert main(["run", str(home / "scene.toml"), "--out", str(home / "run"), "--quiet"]) == 0
    return home / "run"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to be in, with scene.toml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


@pytest.fixture
def run(here, finished):
    """A copy of the finished run, in ./run."""
    shutil.copytree(finished, here / "run")
    return here / "run"


def contents(folder):
    """Every file below a folder, with its bytes."""
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*")
            if path.is_file()}


def refused(capsys, here, *arguments):
    """The one line with which a command refuses its input, having written nothing."""
    before, folders = contents(here), sorted(here.rglob("*"))
    capsys.readouterr()
    assert main([str(argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("tbsa: ")
    assert err.count("\n") == 1, err
    assert contents(here) == before
    assert sorted(here.rglob("*")) == folders
    return err


# ---------------------------------------------------------------------------------------------
# What it does.


def test_version_and_help(capsys):
    for arguments, shown in ((["--version"], f"tbsa {tbsa.__version__}\n"),
                             (["--help"], "check"), (["run", "--help"], "--resume")):
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code == 0
        assert shown in capsys.readouterr().out
    module = [sys.executable, "-m", "tbsa", "--version"]
    assert subprocess.run(module, cwd=ROOT, capture_output=True, text=True,
                          check=True).stdout == f"tbsa {tbsa.__version__}\n"


def test_a_command_is_needed_and_its_options_are_of_their_kind(capsys):
    for arguments in ([], ["simulate"], ["run"], ["run", "a.toml", "--seed", "1.5"],
                      ["fit", "a.csv", "--inset"]):
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code == 2
        err = capsys.readouterr().err
        assert "error: " in err
        assert err.count("\n") == 1


def test_a_length_below_zero_is_a_value(capsys):
    """As -1 is; argparse alone takes it for an option."""
    points = str(ROOT / "paper_runs" / "ligo_40m_magnets.csv")
    assert main(["fit", points, "--inset", "-1mm"]) == 2
    assert capsys.readouterr().err == "tbsa: --inset: '-1mm' must be a length from 0 to 10 m\n"


def test_the_installed_command_is_this_one():
    shown = subprocess.run([sys.executable, "-m", "tbsa.work.cli", "--version"], cwd=ROOT,
                           capture_output=True, text=True, check=True).stdout
    assert shown == f"tbsa {tbsa.__version__}\n"
    assert 'tbsa = "tbsa.work.cli:main"' in (ROOT / "pyproject.toml").read_text()


def test_run_ends_with_a_summary(here, capsys):
    assert main(["run", "scene.toml", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith("2 s simulated in ")
    assert "of the seed" in out
    assert out.endswith("run in runs/scene-5\n")
    assert sorted(path.name for path in (here / "runs" / "scene-5").iterdir()) == [
        "checkpoint.npz", "layout.npz", "records.npy", "run.json", "scene.toml"]


def test_the_summary_has_the_bonds_of_the_assembly_and_not_of_all_tiles():
    """A pair that has bonded far from the seed is no part of it."""
    pair = [{"type": "black", "position": [0, 0]}, {"type": "white", "position": [0.03, 0]}]
    scene = tbsa.parse({
        "tiles": {"set": "chessboard"}, "magnet": {}, "free": {"tile": pair},
        "seed": {"shape": "cells", "cells": [[0, 0, "black"]], "centre": [0.3, 0.3]}})
    text = cli.summary(scene, tbsa.Simulation(scene), 1.0)
    assert "assembly 0 tiles and 1 of the seed, 0 wrong, 0 holes, 0 bonds" in text


@pytest.mark.parametrize(("share", "warned"), [(0.0009, False), (0.0011, True)])
def test_the_summary_warns_where_tiles_were_deep_in_each_other(share, warned):
    scene = tbsa.parse(SCENE)
    s = simulation.Simulation(scene)
    s.counts.overlap[:] = round(1e6 * (1.0 - share)), 0, 0, 0, round(1e6 * share)
    assert ("tiles are deep in each other" in cli.summary(scene, s, 1.0)) == warned


def test_the_summary_of_a_run_that_went_on_is_of_what_it_did(run, capsys):
    assert main(["run", "scene.toml", "--out", "run", "--resume", "--duration", "3.5",
                 "--quiet"]) == 0
    assert re.match(r"1\.5 s simulated in \d+\.\d s of wall time, from 2 to 3\.5 s\n",
                    capsys.readouterr().out)


def test_seed_and_duration_take_the_place_of_the_scenes(here, capsys):
    assert main(["run", "scene.toml", "--seed", "9", "--duration", "0.5", "--quiet"]) == 0
    found = tbsa.read_run("runs/scene-9")
    assert found.time.tolist() == [0.0, 0.5]
    assert found.scene.run.seed == 9


def test_ctrl_c_saves_and_says_how_to_go_on(here, finished, capsys, monkeypatch):
    monkeypatch.setattr(records, "GLANCE", 1e-5)
    monkeypatch.setattr(cli.Bar, "show", lambda bar, simulation, recorded: (
        os.kill(os.getpid(), signal.SIGINT) if simulation.time > 0.7 else None))
    # Other words than the scene's own, which the resumed run must not fall back to.
    assert main(["run", "scene.toml", "--seed", "6", "--duration", "1.5", "--out", "a run"]) == 130
    out, err = capsys.readouterr()
    assert out == ""
    stopped, command = err.splitlines()[-2:]
    assert re.fullmatch(r"stopped at \d\.\d s and saved; go on with", stopped)
    assert command == "  tbsa run 'a run/scene.toml' --out 'a run' --duration 1.5 --resume"
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert main(["run", "a run/scene.toml", "--out", "a run", "--resume", "--quiet"]) == 0
    assert main(["run", "scene.toml", "--seed", "6", "--duration", "1.5", "--out", "b",
                 "--quiet"]) == 0
    for name in ("records.npy", "checkpoint.npz", "scene.toml"):
        assert (here / "a run" / name).read_bytes() == (here / "b" / name).read_bytes()


def test_how_to_go_on_repeats_the_options_of_the_work(here, capsys, monkeypatch):
    monkeypatch.setattr(simulation, "cores", lambda: 2)
    monkeypatch.setattr(cli.Bar, "show", lambda *_: True)
    assert main(["run", "scene.toml", "--out", "a", "--threads", "2", "--quiet"]) == 130
    assert capsys.readouterr().err.endswith(
        "  tbsa run a/scene.toml --out a --threads 2 --resume\n")
    left = campaigns.Result(pd.DataFrame({"status": [], "run": [], "message": []}), 0, 0, 3)
    monkeypatch.setattr(campaigns, "campaign", lambda *_, **__: left)
    monkeypatch.setattr(cli, "_cluster", lambda _: contextlib.nullcontext())
    for options in ("--jobs 3", "--scheduler tcp://host:8786 --part 2/3"):
        assert main(["campaign", "c.toml", "--out", "b", *options.split()]) == 130
        assert capsys.readouterr().err.endswith(
            f"  tbsa campaign c.toml --out b {options} --resume\n")


def test_how_to_go_on_in_a_folder_that_begins_with_a_dash(here, capsys, monkeypatch):
    monkeypatch.setattr(cli.Bar, "show", lambda *_: True)
    assert main(["run", "scene.toml", "--out=-a", "--quiet"]) == 130
    command = "tbsa run ./-a/scene.toml --out ./-a --resume"
    assert capsys.readouterr().err.endswith(f"  {command}\n")
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert main([*command.split()[1:], "--quiet"]) == 0


def test_ctrl_c_before_the_run_begins_ends_without_a_word(here, capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(records, "run", interrupt)
    assert main(["run", "scene.toml", "--quiet"]) == 130
    assert capsys.readouterr().err == ""
    assert [path.name for path in here.iterdir()] == ["scene.toml"]


def test_ctrl_c_while_the_words_are_read_ends_without_a_word(capsys, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_parser", interrupt)
    assert main(["check", "scene.toml"]) == 130
    assert capsys.readouterr().err == ""


def test_ctrl_c_while_a_class_is_made_is_no_failed_run(capsys, monkeypatch):
    """As in the imports of a command; Python 3.11 makes a RuntimeError of it."""
    class Named:
        def __set_name__(self, *_):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(cli, "_check", lambda _: type("Owner", (), {"name": Named()}))
    assert main(["check", "scene.toml"]) == 130
    assert capsys.readouterr().err == ""


def test_ctrl_c_ends_other_commands_without_a_word(capsys):
    assert code_of(lambda: signal.raise_signal(signal.SIGINT)) == 130
    assert capsys.readouterr() == ("", "")


def test_a_scene_whose_name_leaves_no_room_for_that_of_its_run_is_told_of(here, capsys):
    long = here / f"{250 * 'n'}.toml"
    long.write_bytes((here / "scene.toml").read_bytes())
    (here / "runs").mkdir()
    assert main(["run", str(long), "--seed", str(2**63 - 1), "--quiet"]) == 2
    assert "must be a path that can be written: File name too long" in capsys.readouterr().err
    assert not list((here / "runs").iterdir())


def test_ctrl_c_while_it_compiles_does_not_wait(here, capsys, monkeypatch):
    def compiling(simulation, substeps):
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("it went on")

    monkeypatch.setattr(tbsa.Simulation, "advance", compiling)
    assert main(["run", "scene.toml", "--out", "run"]) == 130
    assert capsys.readouterr().err.splitlines()[-2:] == [
        "broken off; go on from the last checkpoint with",
        "  tbsa run run/scene.toml --out run --resume"]
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert main(["run", "run/scene.toml", "--out", "run", "--resume", "--quiet"]) == 0
    assert tbsa.read_run("run").time[-1] == 2.0


def test_the_progress_bar_shows_time_speed_and_size(here, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert main(["run", "scene.toml"]) == 0
    err = capsys.readouterr().err
    assert "0/2 s" in err
    assert "2/2 s" in err
    assert re.search(r"\d x real time, \d+ attached", err)


def test_with_stderr_closed_there_is_no_bar_and_no_word(run, here, capsys, monkeypatch):
    monkeypatch.setattr(benches, "bench", lambda *_, **__: [])
    monkeypatch.setattr(benches, "describe", lambda *_: "recommended")
    monkeypatch.setattr(sys, "stderr", None)
    assert main(["run", "scene.toml", "--out", "again"]) == 0
    assert main(["movie", "run", "--every", "4", "--size", "200"]) == 0
    assert main(["bench", "scene.toml"]) == 0
    assert "recommended" in capsys.readouterr().out
    assert main(["metrics", "nowhere"]) == 2
    assert capsys.readouterr().out == ""
    assert sys.stderr is None


def test_metrics_prints_and_writes_the_table(run, capsys):
    assert main(["metrics", "run"]) == 0
    out = capsys.readouterr().out
    written = (run / "metrics.csv").read_text().splitlines()
    assert out.split()[:3] == ["time", "size", "total"]
    assert len(written) == 1 + 5
    assert written[0].startswith("time,size,total,errors,errors_percent,holes")
    assert [line.split(",")[0] for line in written[1:]] == ["0.0", "0.5", "1.0", "1.5", "2.0"]
    assert main(["metrics", "run", "--out", "other.csv"]) == 0
    assert Path("other.csv").read_text().splitlines() == written


@pytest.mark.parametrize(("arguments", "name"), [
    ([], "run/t2.png"), (["--time", "0.6"], "run/t0.5.png"), (["--out", "now.svg"], "now.svg"),
    (["--out", "now.pdf", "--glues", "--time", "1"], "now.pdf")])
def test_draw_writes_a_picture_of_the_record_nearest_to_the_time(run, capsys, arguments, name):
    assert main(["draw", "run", *arguments]) == 0
    assert capsys.readouterr().out.endswith(f"written to {name}\n")
    assert Path(name).read_bytes()[:4] in (b"\x89PNG", b"<?xm", b"%PDF")


# ---------------------------------------------------------------------------------------------
# check


def checked(capsys, text, name="scene.toml"):
    Path(name).write_text(text)
    assert main(["check", name]) == 0
    return capsys.readouterr().out


def line_with(text, words):
    (line,) = [line for line in text.splitlines() if words in line]
    return line


def test_check_tells_what_a_scene_contains(here, capsys):
    out = checked(capsys, SCENE)
    assert out.splitlines()[:2] == ["A small reactor", "scene.toml"]
    assert "31: 5 of the seed, 26 free" in out
    assert line_with(out, "black  +1 +2").split() == [
        "black", "+1", "+2", "+1", "+2", "black", "+1", "N", "1", "13"]
    share = 100 * 31 * 0.03**2 / (np.pi * 0.14**2)
    assert f"circle, radius 0.14 m; the tiles cover {share:.1f} % of it" in out
    assert "unicycle, 0.1 N, 0.003 N m, 0.5 Hz" in out
    assert "0.03924 N and 0.0006797 N m" in out  # 0.25 m g, 0.25 m g w / sqrt(3)
    assert f"force is {0.1 / 0.03924:.3g} x the floor's: it moves a lone tile" in out
    assert f"torque is {3e-3 / 6.797e-4:.3g} x the floor's: it turns a lone tile" in out
    assert "substep 0.0005208 s (4 in 0.002083 s)" in out
    assert "0.2037 N between the two magnets of a bond" in out
    assert list(here.iterdir()) == [here / "scene.toml"]


def test_check_warns_of_a_colour_that_cannot_be_drawn(here, capsys):
    scene = SCENE.replace('set = "chessboard"', 'type = [{name = "a", glues = [1, -1, 1, -1], '
                          'colour = "blakc"}, {name = "b", glues = [-1, 1, -1, 1], '
                          'colour = "white"}]')
    out = checked(capsys, scene)
    assert "warning: tiles.type[0].colour: 'blakc' is not a colour that can be drawn" in out
    assert "warning" not in checked(capsys, scene.replace("blakc", "black"))


def test_a_title_that_the_terminal_cannot_show_is_printed_all_the_same(here):
    (here / "scene.toml").write_text(SCENE.replace("A small reactor", "Größe"), encoding="utf-8")
    found = subprocess.run([sys.executable, "-m", "tbsa.work.cli", "check", here / "scene.toml"],
                           cwd=ROOT, env=os.environ | {"PYTHONIOENCODING": "ascii"}, text=True,
                           capture_output=True, check=False)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.startswith("Gr\\xf6\\xdfe\n")


def test_check_escapes_what_a_terminal_would_obey(here, capsys):
    out = checked(capsys, SCENE.replace("A small reactor", "red \\u001b[31m\\r\\u009b2J, \u00e9"))
    assert out.startswith("red \\x1b[31m\\r\\x9b2J, \u00e9\nscene.toml\n")
    (here / "scene.toml").write_text('"\\u001b[31m" = 1\n' + SCENE)
    assert "scene.toml: \\x1b[31m: 1 is under an unknown key" in refused(
        capsys, here, "check", "scene.toml")


def test_check_keeps_a_row_a_type(here, capsys):
    """A line's end in a name or a colour is shown, and ends no line."""
    out = checked(capsys, SCENE.replace('set = "chessboard"', """type = [
        {name = "a\\nb", glues = [1, 1, -1, -1], colour = "red"},
        {name = "c", glues = [1, 1, -1, -1], colour = "green\\n"}]"""))
    assert [line.split()[0] for line in out.splitlines() if "-1 -1" in line] == ["a\\nb", "c"]


def test_check_tells_what_the_drive_cannot_do(here, capsys):
    out = checked(capsys, SCENE.replace("force = 0.1", "force = 0.03").replace("3e-3", "0.0"))
    assert "it does not move a lone tile" in out
    assert "the drive has no torque" in out


def test_check_tells_of_a_tolerance_that_lets_tiles_come_into_each_other(here, capsys):
    for tolerance, part in ((0.05, None), (0.06, "0.1 %"), (0.6, "1 %")):  # substep of 1/1920 s
        out = checked(capsys, f"{SCENE}\n[solver]\ntolerance = {tolerance}\n")
        assert ("come into each other" in out) == (part is not None)
        assert part is None or f"by {part} of their width in a substep" in out


def test_check_has_the_force_of_a_bond_that_the_cut_off_leaves(here, capsys):
    out = checked(capsys, SCENE.replace("[magnet]", "[magnet]\ncutoff = 0.0031"))
    left = force(3e-3, Law(cutoff=3.1e-3, switch=0.1))
    assert f"{left:.4g} N between the two magnets of a bond" in out


def test_check_has_no_force_of_a_bond_where_no_glue_attracts(here, capsys):
    types = "".join(f'[[tiles.type]]\nname = "{name}"\nglues = {glues}\ncolour = "red"\n'
                    for name, glues in (("a", [1, 2, 0, 1]), ("b", [3, 3, 3, 3])))
    scene = SCENE.replace('[tiles]\nset = "chessboard"\n', types)
    out = checked(capsys, scene)
    assert "no glue attracts another: tiles do not bond; what does not attract repels" in out
    assert "of a bond" not in out
    out = checked(capsys, scene.replace("[magnet]", "[magnet]\nmismatch = 0"))
    assert "tiles do not bond; what does not attract does nothing" in out
    assert "of a bond" in checked(capsys, scene.replace("3, 3]", "3, -2]"))


@pytest.mark.parametrize(("law", "drive", "words"), [
    # (F/F_max)^2 + (T/T_max)^2 = 1.37, each below 1
    ("coupled", "unicycle", "torque 0.9 x, both together 1.17 x: they move a lone tile at rest"),
    ("coupled", "constant", "together 1.17 x: they move a lone tile at rest"),
    ("coupled", "unicycle 0.8", "together 0.937 x: they do not move a lone tile at rest"),
    # On the exact set both together are 1.05 to 1.06 times what they are on the ellipsoid.
    ("exact", "unicycle 0.8", "together 0.994 x: they do not move a lone tile at rest"),
    ("exact", "unicycle 0.81", "together 1.01 x: they move a lone tile at rest"),
    ("exact", "constant 0.8036", "together 0.998 to 1 x: its angle decides whether they move a"),
    ("exact", "constant 0.7", "they do not move a lone tile at rest"),
])
def test_check_judges_force_and_torque_together_where_the_floor_has_one_bound(
        here, capsys, law, drive, words):
    kind, _, part = drive.partition(" ")
    bound = 0.25 * 0.016 * 9.81
    torque = 0.9 * float(part or 1.0) * MEAN_DISTANCE * bound * 0.03
    size = 0.75 * float(part or 1.0) * bound
    load = repr(size) if kind == "unicycle" else f"[{-0.6 * size!r}, {0.8 * size!r}]"
    start, end = SCENE.index("[drive]"), SCENE.index("[floor]")
    rest = SCENE[end:].replace("[floor]", f'[floor]\nlaw = "{law}"')
    frequency = "frequency = 0.5\n" * (kind == "unicycle")
    out = checked(capsys, f'{SCENE[:start]}[drive]\nkind = "{kind}"\nforce = {load}\n'
                  f"torque = {torque!r}\n{frequency}{rest}")
    assert words in out
    assert out.count("a lone tile at rest") == 1


@pytest.mark.parametrize(("drive", "why"), [
    ("frequency = 0.0", "the drive moves nothing: its frequency is 0"),
    ("frequency = 0.1", "the drive moves nothing: no free tile has a family")])
def test_check_says_of_a_unicycle_that_it_moves_nothing(here, capsys, drive, why):
    kinds = "".join(f'[[tiles.type]]\nname = "{name}"\nglues = {glues}\ncolour = "{name}"\n'
                    f"family = {family}\n" for name, glues, family in (
                        ("black", [1, 2, 1, 2], int("0.0" in drive)),
                        ("white", [-1, -2, -1, -2], 0)))
    start, end = SCENE.index("[drive]"), SCENE.index("[floor]")
    scene = (f'{SCENE[:start]}[drive]\nkind = "unicycle"\nforce = 0.1\ntorque = 0.001\n'
             f"{drive}\n{SCENE[end:]}").replace('[tiles]\nset = "chessboard"\n', kinds)
    out = checked(capsys, scene)
    assert why in out
    assert "a lone tile at rest" not in out


def test_check_of_a_set_without_traps(here, capsys):
    out = checked(capsys, SCENE)
    assert "directed at temperature 2: the seed grows by " in out
    assert "no wrong tile and no wrong turn could bind at a site with two neighbours" in out


def test_check_does_not_call_a_set_safe_where_nothing_grew(here, capsys):
    """A quarter turn of this tile binds to the seed by one glue, yet no site was looked at."""
    out = checked(capsys, '[[tiles.type]]\nname = "a"\nglues = [1, 1, -1, -1]\ncolour = "red"\n'
                  '[magnet]\n[seed]\nshape = "cells"\ncells = [[0, 0, "a"]]\n')
    assert "the seed grows by 0 sites" in out
    assert "no site grew at which wrong tiles and turns could be looked for" in out
    assert "no wrong tile" not in out


def test_check_lists_what_could_bind_wrongly(here, capsys):
    # Of this set the right colour binds after a quarter turn either way, at opposite edges.
    out = checked(capsys, SCENE.replace('"chessboard"', '"chessboard-oriented"')
                  .replace("arm = 1", "arm = 3")
                  .replace("radius = 0.14", "radius = 0.2"))
    head = out.splitlines().index(line_with(out, "in place of"))
    rows = [line.split() for line in out.splitlines()[head + 1 :]]
    assert all(row[0] == row[1] and row[2:4] in (["90", "deg"], ["270", "deg"]) for row in rows)
    assert {row[5] for row in rows if row[4] == "2"} == {"opposite"}
    by_one, by_two = ([row[4] for row in rows].count(number) for number in "12")
    assert min(by_one, by_two) > 0
    assert f"could bind: {by_one} by one glue, {by_two} by two or more" in out


def test_check_names_the_site_where_a_set_is_not_directed(here, capsys):
    types = "".join(f'[[tiles.type]]\nname = "{name}"\nglues = {glues}\ncolour = "{name}"\n'
                    for name, glues in (("grey", [1, 1, 0, 0]), ("red", [0, 0, -1, -1]),
                                        ("blue", [0, 0, -1, -1])))
    seed = '[seed]\nshape = "cells"\ncells = [[1, 0, "grey"], [0, 1, "grey"]]\n'
    out = checked(capsys, types + seed)
    assert "no magnets, so nothing grows" in out
    assert "directed" not in out
    out = checked(capsys, types + seed + "[magnet]\n")
    assert "not directed at temperature 2: site (column 1, row 1) can take red or blue" in out
    assert "no friction" in out


def test_check_of_a_scene_without_a_seed(here, capsys):
    out = checked(capsys, '[tiles]\nset = "chessboard"\n[[free.tile]]\ntype = "black"\n'
                  "position = [0.0, 0.0]\n")
    assert "no seed, so nothing to grow from" in out
    assert "none: the floor has no end" in out


def test_check_refuses_tiles_that_do_not_fit(here, capsys):
    (here / "scene.toml").write_text(SCENE.replace("number = 26", "number = 60"))
    line = refused(capsys, here, "check", "scene.toml")
    assert line.startswith("tbsa: scene.toml: free: 60 random tiles must fit")


# ---------------------------------------------------------------------------------------------
# What must be refused: exit code 2, one line, nothing written.


@pytest.mark.parametrize(("text", "name", "fragment"), [row[1:] for row in MALFORMED],
                         ids=[row[0] for row in MALFORMED])
def test_a_malformed_scene_is_refused(here, capsys, text, name, fragment):
    (here / "scene.toml").write_text(text)
    line = refused(capsys, here, "run", "scene.toml", "--out", "run")
    assert line.startswith(f"tbsa: scene.toml: {name}: " if name else "tbsa: scene.toml: ")
    assert fragment in line
    assert refused(capsys, here, "check", "scene.toml") == line


def test_a_typing_error_gets_a_suggestion(here, capsys):
    (here / "scene.toml").write_text(SCENE.replace("torque =", "torqe ="))
    line = refused(capsys, here, "run", "scene.toml")
    assert "drive.torqe" in line
    assert 'did you mean "torque"?' in line


def test_a_scene_that_is_no_file_is_refused(here, capsys):
    (here / "folder").mkdir()
    (here / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    for name, reason in (("missing.toml", "No such file"), ("folder", "Is a directory"),
                         ("scene.toml/x", "Not a directory"), ("bytes.toml", "in UTF-8")):
        line = refused(capsys, here, "run", name, "--out", "run")
        assert line.startswith(f"tbsa: {name}: ")
        assert reason in line


@pytest.mark.parametrize(("arguments", "words"), [
    (["--duration", "-1"], "scene.toml: run.duration, by the command line: -1.0 must be a number"),
    (["--duration", "0"], "run.duration, by the command line: 0.0 must be"),
    (["--duration", "nan"], "run.duration, by the command line: nan must be"),
    (["--duration", "inf"], "run.duration, by the command line: inf must be"),
    (["--seed", "-1"], "scene.toml: run.seed, by the command line: -1 must be an integer from 0"),
    (["--set", "drive.force=-1"], "scene.toml, changed by --set: drive.force: -1.0 must be"),
    (["--threads", "0"], "--threads: 0 must be from 1 to "),
    (["--threads", "100000"], "--threads: 100000 must be from 1 to "),
    (["--seed", str(2**63)], "run.seed, by the command line: 9223372036854775808 must be"),
    (["--out", "scene.toml"], "scene.toml: is a file, not a folder"),
    (["--out", "scene.toml/run"], "must be a folder that can be made: Not a directory"),
    (["--out", "."], "must be a new or an empty folder"),
    (["--out", "run", "--resume"], "run: is not the folder of a run: it has no run.json"),
])
def test_options_that_make_no_sense_are_refused(here, capsys, arguments, words):
    assert words in refused(capsys, here, "run", "scene.toml", "--quiet", *arguments)


@pytest.mark.parametrize("arguments", [["--duration", "long"], ["--seed", "1.5"]])
def test_options_of_the_wrong_type_are_refused(here, capsys, arguments):
    with pytest.raises(SystemExit) as end:
        main(["run", "scene.toml", *arguments])
    assert end.value.code == 2
    assert f"argument {arguments[0]}: invalid" in capsys.readouterr().err
    assert [path.name for path in here.iterdir()] == ["scene.toml"]


def test_a_run_is_not_overwritten(run, here, capsys):
    line = refused(capsys, here, "run", "scene.toml", "--out", "run")
    assert "tbsa: run: holds a run already" in line


def flipped(data, at):
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1:]


DAMAGE = {
    "cut off": lambda data: data[: len(data) // 2],
    "of length zero": lambda data: b"",
    "a flipped bit": lambda data: flipped(data, data.index(b"omega.npy") + 300),
    "a flipped bit in its directory": lambda data: data[:-30] + bytes([data[-30] ^ 8]) + data[-29:],
    "text": lambda data: b"not an archive at all",
    "an array": lambda data: (
        b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }"
        + b" " * 58 + b"\n" + bytes(8)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_checkpoint_is_refused(run, here, capsys, damage):
    path = run / "checkpoint.npz"
    path.write_bytes(DAMAGE[damage](path.read_bytes()))
    line = refused(capsys, here, "run", "scene.toml", "--duration", "3", "--out", "run",
                   "--resume")
    assert line.startswith("tbsa: run/checkpoint.npz: is damaged: ")


def test_a_checkpoint_damaged_anywhere_never_ends_in_a_traceback(run):
    path = run / "checkpoint.npz"
    whole = path.read_bytes()
    at = np.random.default_rng(1).integers(0, len(whole), 60).tolist()
    tail = range(len(whole) - 1600, len(whole), 11)  # the archive's own directory
    for k in [*range(0, 60, 2), *at, *tail]:
        path.write_bytes(whole[:k] + bytes([whole[k] ^ (1 << (k % 8))]) + whole[k + 1 :])
        # Not every byte counts: names are checked, dates are not.
        with contextlib.suppress(tbsa.InputError):
            records._read_arrays(path, ("format", "steps"))


def test_a_foreign_archive_is_no_checkpoint(run, here, capsys):
    np.savez(run / "checkpoint.npz", a=np.zeros(3))
    line = refused(capsys, here, "run", "scene.toml", "--out", "run", "--resume")
    assert "checkpoint.npz: has no 'format': not written by tbsa" in line


def changed_checkpoint(run, **changes):
    with np.load(run / "checkpoint.npz") as data:
        arrays = dict(data)
    np.savez(run / "checkpoint.npz", **(arrays | changes))


@pytest.mark.parametrize(("changes", "words"), [
    ({"format": 99}, "format: 99 must be 2"),
    ({"fingerprint": "0" * 64}, "fingerprint: '000000000000' belongs to another scene or seed"),
    ({"x": np.zeros(3)}, "must hold 31 finite numbers a field"),
    ({"omega": np.full(31, np.nan)}, "must hold 31 finite numbers a field"),
    ({"x": np.full(31, 1j)}, "must hold 31 finite numbers a field"),
    ({"x": np.full(31, "1")}, "must hold 31 finite numbers a field"),
    ({"steps": -5}, "steps: is damaged: must be 1 finite int64"),
    ({"steps": 1.5}, "steps: is damaged"), ({"steps": np.nan}, "steps: is damaged"),
    ({"steps": np.zeros(2, int)}, "steps: is damaged"),
    ({"last": np.full(3, "1")}, "last: is damaged: must be 3 finite int64"),
    ({"early": np.array([0, 0])}, "early: is damaged: must be different tiles, from 0 to "),
    ({"early": np.array([10**6])}, "early: is damaged"),
    ({"early": np.array([0.0])}, "early: is damaged"),
    ({"early": np.zeros((1, 1), int)}, "early: is damaged"),
    ({"early": np.array([1]), "goes": np.zeros(5)}, "goes: is damaged: must be 6 finite float64"),
    ({"early": np.array([1]), "goes": np.full(6, np.nan)}, "goes: is damaged"),
    ({"impulse_b": np.zeros(1, int)}, "impulse_b: is damaged"),
    ({"count_overlap": np.zeros(4, int)}, "count_overlap: is damaged: must be 5 finite int64"),
    ({"count_passes": np.full(1, "1")}, "count_passes: is damaged"),
])
def test_a_checkpoint_with_wrong_contents_is_refused(run, here, capsys, changes, words):
    changed_checkpoint(run, **changes)
    line = refused(capsys, here, "run", "scene.toml", "--duration", "3", "--out", "run",
                   "--resume")
    assert line.startswith("tbsa: run/checkpoint.npz: ")
    assert words in line


@pytest.mark.parametrize("kind", [-1, 99])
def test_a_layout_with_types_that_are_none_is_refused(run, here, capsys, kind):
    with np.load(run / "layout.npz") as data:
        arrays = dict(data)
    arrays["type"][3] = kind
    np.savez(run / "layout.npz", **arrays)
    for command in (["metrics", "run"], ["draw", "run"],
                    ["run", "scene.toml", "--out", "run", "--resume"]):
        assert "run/layout.npz: type: is damaged: types must be from 0 to 1" in refused(
            capsys, here, *command)


@pytest.mark.parametrize("time", [np.nan, np.inf, 0.0, -1.0, 1e300])
def test_records_whose_time_does_not_go_on_are_refused(run, here, capsys, time):
    data = np.load(run / "records.npy", mmap_mode="r+")
    data["time"][1] = time
    data.flush()
    assert "run/records.npy: time: is damaged: must go on from record to record" in refused(
        capsys, here, "metrics", "run")


@pytest.mark.parametrize(("name", "number", "words"), [
    ("x", np.nan, "record.x: nan must be finite numbers"),
    ("y", 1e300, "record.y: 1e+300 must be from -3e+07 to 3e+07"),
    ("angle", -np.inf, "record.angle: -inf must be finite numbers")])
@pytest.mark.parametrize("command", ["metrics", "view", "movie"])
def test_a_place_that_cannot_be_names_the_file(run, here, capsys, command, name, number, words):
    without_checksums(run)
    data = np.load(run / "records.npy", mmap_mode="r+")
    data[name][1, 3] = number
    data.flush()
    assert f"run/records.npy: {words}" in refused(capsys, here, command, "run")


def without_checksums(run):
    """Make records as those of runs of before 0.29.0."""
    data = np.load(run / "records.npy")
    np.save(run / "records.npy", repack_fields(data[[*data.dtype.names[:-1]]]))


@pytest.mark.parametrize("command", ["metrics run", "draw run --time 0.5", "movie run", "view run",
                                     "run scene.toml --duration 3 --out run --resume"])
@pytest.mark.parametrize("damage", [lambda block: bytes([block[0] ^ 16]) + block[1:],
                                    lambda block: bytes(len(block))], ids=["bit", "block"])
def test_a_record_that_is_damaged_is_told_of(run, here, capsys, command, damage):
    path, size = run / "records.npy", 16 + 48 * 31
    data = path.read_bytes()
    place = len(data) - 4 * size + 800  # in the second of five
    path.write_bytes(data[:place] + damage(data[place : place + 512]) + data[place + 512 :])
    line = refused(capsys, here, *command.split())
    assert "run/records.npy: record 1 (0.5 s): is damaged: it has another checksum" in line


def test_a_run_without_checksums_is_read_and_gone_on_with(run, here):
    shutil.copytree(run, "old")
    without_checksums(here / "old")
    for folder in ("run", "old"):
        assert main(["run", "scene.toml", "--duration", "3", "--out", folder, "--resume",
                     "--quiet"]) == 0
        assert main(["metrics", folder]) == 0
    assert Path("run/metrics.csv").read_bytes() == Path("old/metrics.csv").read_bytes()
    ours, theirs = np.load("run/records.npy"), np.load("old/records.npy")
    assert [*theirs.dtype.names, "check"] == [*ours.dtype.names]
    assert all((ours[name] == theirs[name]).all() for name in theirs.dtype.names)


def test_a_checkpoint_of_another_seed_is_refused(run, here, capsys):
    assert main(["run", "scene.toml", "--seed", "6", "--out", "other", "--quiet"]) == 0
    shutil.copy("other/checkpoint.npz", run)
    line = refused(capsys, here, "run", "scene.toml", "--out", "run", "--resume")
    assert "run/checkpoint.npz: fingerprint: " in line
    assert "belongs to another scene or seed" in line


@pytest.mark.parametrize("arguments", [["--seed", "6"], []], ids=["seed", "scene"])
def test_a_run_of_another_scene_or_seed_cannot_be_resumed(run, here, capsys, arguments):
    if not arguments:
        (here / "scene.toml").write_text(SCENE.replace("force = 0.1", "force = 0.11"))
    line = refused(capsys, here, "run", "scene.toml", "--out", "run", "--resume", *arguments)
    assert "run/run.json: fingerprint: " in line
    assert "was written for another scene or seed" in line


def test_a_run_of_another_version_is_shown_but_not_gone_on_with(run, here, capsys):
    info = json.loads((run / "run.json").read_text())
    (run / "run.json").write_text(json.dumps(info | {"version": "0.1.2"}))
    line = refused(capsys, here, "run", "scene.toml", "--out", "run", "--resume",
                   "--duration", "3")
    assert f"run/run.json: version: '0.1.2' must be {tbsa.__version__}, this version" in line
    assert "begin anew in another folder (--out)" in line
    for command in ("metrics", "draw", "view"):
        assert main([command, "run"]) == 0


def test_a_run_is_not_made_shorter(run, here, capsys):
    line = refused(capsys, here, "run", "scene.toml", "--out", "run", "--resume",
                   "--duration", "1.5")
    assert "run.duration: 1.5 s is less than the 2 s that run holds" in line


def test_what_does_not_change_the_motion_may_change_on_resume(run, here, capsys):
    (here / "scene.toml").write_text(
        SCENE.replace("A small reactor", "Another title").replace("duration = 2.0",
                                                                  "duration = 2.5"))
    assert main(["run", "scene.toml", "--out", "run", "--resume", "--quiet"]) == 0
    assert tbsa.read_run(run).time[-1] == 2.5


FOREIGN = {"free": SCENE.replace("number = 26", "number = 24"),
           "seed": SCENE.replace("seed = 5", "seed = 6")}


@pytest.mark.parametrize("kind", FOREIGN)
@pytest.mark.parametrize("name", ["records.npy", "layout.npz"])
@pytest.mark.parametrize("command", ["metrics run", "draw run",
                                     "run scene.toml --duration 3 --out run --resume"])
def test_a_file_of_another_run_is_refused(run, here, capsys, kind, name, command):
    (here / "other.toml").write_text(FOREIGN[kind])
    assert main(["run", "other.toml", "--out", "other", "--quiet"]) == 0
    shutil.copy(here / "other" / name, run)
    line = refused(capsys, here, *command.split())
    if kind == "free":
        assert f"run/{name}: does not belong to this run of 31 tiles" in line
    else:
        assert "run/records.npy: does not begin with this run's layout.npz" in line


@pytest.mark.parametrize("command", ["metrics run", "draw run",
                                     "run scene.toml --duration 3 --out run --resume"])
@pytest.mark.parametrize(("name", "data", "words"), [
    ("records.npy", b"", "is damaged"),
    ("records.npy", b"\x93NUMPY\x01\x00", "is damaged"),
    ("records.npy", None, "is missing"),
    ("layout.npz", b"PK\x03\x04", "is damaged"),
    ("layout.npz", None, "is missing"),
    ("run.json", b"", "is damaged"),
    ("run.json", b'{"format": 2', "is damaged"),
    ("run.json", b"\xff\xfe", "is damaged"),
    ("run.json", b"[]", "must be 2: not written by this version"),
    ("run.json", b'{"format": 1}', "format: 1 must be 2"),
    ("run.json", b'{"format": 2}', "fingerprint: None is damaged: must be a str"),
    ("run.json", None, "run: is not the folder of a run: it has no run.json"),
])
def test_a_damaged_run_is_refused(run, here, capsys, command, name, data, words):
    if data is None:
        (run / name).unlink()
    else:
        (run / name).write_bytes(data)
    assert words in refused(capsys, here, *command.split())


def test_records_cut_off_in_the_middle_are_refused(run, here, capsys):
    path = run / "records.npy"
    path.write_bytes(path.read_bytes()[:-100])
    for command in ("metrics run", "run scene.toml --duration 3 --out run --resume"):
        assert "run/records.npy: is damaged" in refused(capsys, here, *command.split())


def test_records_that_the_checkpoint_has_outrun_are_refused(run, here, capsys):
    assert main(["run", "scene.toml", "--duration", "1", "--out", "short", "--quiet"]) == 0
    shutil.copy("short/records.npy", run)
    line = refused(capsys, here, "run", "scene.toml", "--duration", "3", "--out", "run",
                   "--resume")
    assert "run/records.npy: must hold 5 records, one every 0.5 s" in line


def test_a_scene_edited_in_the_runs_folder_is_refused(run, here, capsys):
    path = run / "scene.toml"
    path.write_text(path.read_text().replace("force = 0.1", "force = 0.2"))
    line = refused(capsys, here, "metrics", "run")
    assert "run/scene.toml: fingerprint: " in line
    assert "was changed after the run" in line
    path.write_text("[tiles\n")
    assert "run/scene.toml: must be valid TOML" in refused(capsys, here, "draw", "run")
    path.unlink()
    assert "run/scene.toml: must be a TOML file" in refused(capsys, here, "draw", "run")


@pytest.mark.parametrize(("arguments", "words"), [
    (["draw", "run", "--time", "2.6"], "time: 2.6 is not recorded: this run holds 0 to 2 s"),
    (["draw", "run", "--time", "-1"], "time: -1.0 is not recorded"),
    (["draw", "run", "--time", "nan"], "time: nan is not recorded"),
    (["draw", "run", "--out", "now.gif"], "must end in .png, .svg, .pdf"),
    (["draw", "run", "--out", "now"], "must end in .png, .svg, .pdf"),
    (["draw", "run", "--out", "no/where.png"], "must be in a folder that exists"),
    (["draw", "run", "--time", "3"], "tbsa: --time: 3.0 is not recorded"),
    (["draw", "run", "--out", "now.gif"], "tbsa: --out: 'now.gif' must end in"),
    (["movie", "run", "--rate", "0"], "tbsa: --rate: 0.0 must be from 0.1 to 50"),
    (["movie", "run", "--from", "2", "--to", "1"], "tbsa: --to: 1.0 must not be before"),
    (["movie", "run", "--from", "99"], "tbsa: --from: 99.0 is not recorded: this run holds"),
    (["view", "run", "--to", "99"], "tbsa: --to: 99.0 is not recorded: this run holds 0 to 2 s"),
    (["metrics", "run", "--out", "run/records.npy"],
     "--out: 'run/records.npy' must be another file: it is the run's own"),
    (["metrics", "run", "--out", "run/../run/run.json"], "must be another file: it is the run's"),
    (["view", "run", "--every", "0"], "tbsa: --every: 0 must be at least 1"),
    (["metrics", "run", "--out", "no/where.csv"],
     "tbsa: --out: 'no/where.csv' must be in a folder that exists"),
    (["metrics", "run", "--out", "."], "--out: '.' must be a file, and is a folder"),
    (["metrics", "run", "--out", "/"], "--out: '/' must be a file, and is a folder"),
    (["metrics", "run", "--out", "run"], "--out: 'run' must be a file, and is a folder"),
    (["metrics", "run", "--out", "scene.toml"], "tbsa: --out: 'scene.toml' must end in .csv"),
    (["metrics", "run", "--out", 300 * "x"], "must be a path that can be written: File name too"),
    (["metrics", "run", "--out", 250 * "x"], "must be a path that can be written: File name too"),
    (["draw", "run", "--out", 300 * "x" + ".png"], "must be a path that can be written: File na"),
    (["draw", "run", "--out", 300 * "x" + "/a.png"], "must be a path that can be written: File "),
    (["run", "scene.toml", "--out", 300 * "x"], "must be a path that can be written: File name"),
    (["metrics", "."], "is not the folder of a run: it has no run.json"),
    (["metrics", "nowhere"], "nowhere: is not the folder of a run"),
    (["metrics", "scene.toml"], "scene.toml: is not the folder of a run"),
    (["draw", "."], "is not the folder of a run"),
])
def test_what_cannot_be_shown_is_refused(run, here, capsys, arguments, words):
    assert words in refused(capsys, here, *arguments)


def test_a_state_that_is_not_finite_ends_the_run_and_keeps_what_was_saved(here, capsys):
    (here / "burst.py").write_text(
        "def burst(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):\n"
        "    if t > 1.2:\n        fx[7] = 1e300 * 1e300\n")
    start = SCENE.index("[drive]")
    text = SCENE[:start] + SCENE[SCENE.index("[floor]"):]
    (here / "scene.toml").write_text(
        text + '[drive]\nkind = "user"\nmodule = "burst.py"\nfunction = "burst"\n')
    assert main(["run", "scene.toml", "--out", "run", "--quiet"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "stopped being finite" in err
    assert tbsa.read_run("run").time[-1] == 1.0


def test_a_full_disk_ends_in_one_line(here, capsys, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main(["run", "scene.toml", "--out", "run", "--quiet"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "No space left on device: 'run/layout.npz'\n" in err


def test_a_disk_that_fills_up_later_names_the_file_and_how_to_go_on(here, capsys, monkeypatch):
    write = records.write_atomically

    def full(path, data):
        if path.name == "checkpoint.npz" and path.exists():
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write(path, data)

    monkeypatch.setattr(records, "write_atomically", full)
    assert main(["run", "scene.toml", "--out", "run", "--quiet"]) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert "No space left on device: 'run/checkpoint.npz'; go on from the last chec" in first
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert main([*second.split()[1:], "--quiet"]) == 0
    assert tbsa.read_run("run").time[-1] == 2.0


@pytest.mark.parametrize("command", ["draw", "movie", "view", "export"])
def test_what_may_not_be_written_is_not_drawn(run, here, capsys, monkeypatch, command):
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "run")
    assert "must be in a folder that may be written" in refused(capsys, here, command, "run")


def test_metrics_are_printed_where_they_may_not_be_written(run, here, capsys, monkeypatch):
    before = contents(here)
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "run")
    assert main(["metrics", "run"]) == 2
    out, err = capsys.readouterr()
    assert out.split()[:3] == ["time", "size", "total"]
    assert err == "tbsa: --out: 'run/metrics.csv' must be in a folder that may be written\n"
    assert "must be in a folder that may be written" in refused(
        capsys, here, "metrics", "run", "--out", "run/other.csv")
    assert contents(here) == before
    assert main(["metrics", "run", "--out", "other.csv"]) == 0


def test_metrics_are_written_though_nobody_reads_what_is_printed(run, monkeypatch):
    """As in `tbsa metrics run | head -1`; an older table does not stay."""
    class Closed(io.StringIO):
        def write(self, _):
            raise BrokenPipeError

    (run / "metrics.csv").write_text("old")
    with monkeypatch.context() as broken:
        broken.setattr(sys, "stdout", Closed())
        assert main(["metrics", "run"]) == 1
    assert len(pd.read_csv(run / "metrics.csv")) == 5


@pytest.mark.parametrize("unbuffered", ["", pytest.param("1", marks=pytest.mark.slow)])
def test_output_that_cannot_be_written_is_told_by_the_exit_code(here, unbuffered, unwritable):
    """A buffer is written at the end only, where Python would complain and exit with 120."""
    place, words = unwritable
    for arguments, code in ((["check", "scene.toml"], 1), (["--help"], 0)):
        found = subprocess.run(
            [sys.executable, "-m", "tbsa", *arguments], cwd=here, stdout=place,
            stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered, "PYTHONPATH": str(ROOT)})
        assert found.returncode == code
        assert words in found.stderr if code else not found.stderr
        assert len(found.stderr.splitlines()) == bool(words and code)
    told = subprocess.run(
        [sys.executable, "-m", "tbsa", "check", "nowhere.toml"], cwd=here, stderr=place,
        stdout=subprocess.PIPE, text=True, check=False,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered, "PYTHONPATH": str(ROOT)})
    assert (told.returncode, told.stdout) == (2, "")  # the message is lost, the code is not


@pytest.mark.parametrize("resume", [False, True])
def test_a_run_into_a_folder_that_may_not_be_written_is_refused(
        here, finished, capsys, monkeypatch, resume):
    if resume:
        shutil.copytree(finished, here / "run")
    else:
        (here / "run").mkdir()
    arguments = ["run", "scene.toml", "--out", "run", *["--resume"] * resume]
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "run")
    assert refused(capsys, here, *arguments) == "tbsa: run: must be a folder that may be written\n"
    if resume:
        monkeypatch.setattr(os, "access", lambda path, mode: "records" not in str(path))
        assert refused(capsys, here, *arguments) == (
            "tbsa: run/records.npy: must be a file that may be written\n")


def test_a_fit_into_a_folder_that_may_not_be_written_is_refused(here, capsys, monkeypatch):
    (here / "fits").mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "fits")
    assert "tbsa: --out: 'fits' must be a folder that may be written" in refused(
        capsys, here, "fit", ROOT / "paper_runs" / "ligo_40m_magnets.csv", "--inset", "1mm",
        "--interval", "normal", "--out", "fits")


def test_paths_need_not_be_utf8(here, capsys):
    odd = os.fsdecode(b"\xff")
    Path("scene.toml").rename(f"{odd}.toml")
    assert main(["run", f"{odd}.toml", "--duration", "0.5", "--out", odd, "--quiet"]) == 0
    assert main(["run", f"{odd}.toml", "--out", odd, "--quiet", "--resume"]) == 0
    for command in ("metrics", "draw", "movie", "view"):
        assert main([command, odd]) == 0
    assert main(["check", f"{odd}/scene.toml"]) == 0
    assert {path.name for path in Path(odd).iterdir()} >= {
        "metrics.csv", "t2.png", "movie.gif", "view.html"}
    assert "must be a path that UTF-8 can hold, for gsd" in refused(capsys, here, "export", odd)
    assert main(["export", odd, "--out", "run.gsd"]) == 0


@pytest.mark.parametrize("name", ["pipe", "link"])
def test_whether_it_may_be_written_is_asked_of_what_gets_the_bytes(here, monkeypatch, name):
    os.mkfifo("pipe")
    Path("far").mkdir()
    Path("link").symlink_to("far/file")
    asked = []
    monkeypatch.setattr(os, "access", lambda path, mode: asked.append(str(path)))
    with pytest.raises(tbsa.InputError, match="that may be written"):
        records.check_may_be_written(Path(name), "--out")
    assert asked == ["pipe" if name == "pipe" else str(here / "far")]


@pytest.mark.parametrize("command", ["metrics", "draw", "movie", "view", "export"])
def test_an_output_file_that_leads_to_one_of_a_runs_own_is_refused(run, here, capsys, command):
    ending = {"metrics": "csv", "draw": "png", "movie": "mp4", "view": "html", "export": "gsd"}
    link = here / f"link.{ending[command]}"
    link.symlink_to("run/records.npy")
    assert f"tbsa: --out: '{link.name}' must be another file: it is the run's own" in refused(
        capsys, here, command, "run", "--out", link.name)


def test_files_of_a_campaign_are_not_replaced(run, here, capsys):
    (here / "campaign.json").write_text("{}")
    assert "--out: 'table.csv' must be another file: it is the campaign's own" in refused(
        capsys, here, "metrics", "run", "--out", "table.csv")
    assert main(["metrics", "run", "--out", "tables.csv"]) == 0


@pytest.mark.parametrize(("command", "ending"), [
    ("metrics", "csv"), ("draw", "svg"), ("movie", "mp4"), ("view", "html"), ("export", "gsd")])
def test_what_is_no_regular_file_stays_what_it_is(run, here, capsys, command, ending):
    """A link leads to where it did, a pipe gets what a file would."""
    plain, link, pipe = (here / f"{name}.{ending}" for name in ("plain", "link", "pipe"))
    (here / "far").mkdir()
    (here / "far" / "old").write_bytes(b"old")
    link.symlink_to("far/old")
    assert main([command, "run", "--out", plain.name]) == 0
    assert main([command, "run", "--out", link.name]) == 0
    assert link.is_symlink()
    assert (here / "far" / "old").read_bytes() == plain.read_bytes()
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        assert main([command, "run", "--out", pipe.name]) == 0
        assert reader.communicate()[0] == plain.read_bytes()
    assert pipe.is_fifo()
    assert {path.name for path in here.iterdir()} == {
        "scene.toml", "run", "far", plain.name, link.name, pipe.name}


def test_all_files_have_the_same_mode(run, here, capsys):
    for command in ("metrics", "draw", "view", "export", "movie"):
        assert main([command, "run"]) == 0
    assert {path.stat().st_mode for path in (here / "run").iterdir()} == {
        (here / "scene.toml").stat().st_mode}


@pytest.mark.parametrize("command", ["movie", "view", "export"])
def test_the_ground_truth_is_grown_once_for_all_records(run, capsys, monkeypatch, command):
    calls = []
    grow = metrics.ground_truth
    monkeypatch.setattr(metrics, "ground_truth", lambda scene: calls.append(1) or grow(scene))
    assert main([command, "run"]) == 0
    assert len(calls) == (2 if command == "movie" else 1)  # a film looks for its colours first


def test_a_table_that_cannot_be_written_is_named(run, capsys, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    for command, name in (("metrics", "metrics.csv"), ("draw", "t2.png"), ("view", "view.html")):
        assert main([command, "run"]) == 1
        err = capsys.readouterr().err
        assert f"No space left on device: 'run/{name}'" in err
        assert err.count("\n") == 1


# ---------------------------------------------------------------------------------------------
# The README.


def blocks(language):
    """The README's code blocks in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", (ROOT / "README.md").read_text(),
                      re.MULTILINE | re.DOTALL)


def test_the_readmes_own_drive_works_as_printed(here, capsys):
    for language in ("python", "toml"):
        for block in blocks(language):
            if named := re.match(r"# (\S+\.(?:py|toml))\n", block):
                (here / named[1]).write_text(block)
    assert (here / "vortex.py").exists()
    assert main(["run", "vortex.toml", "--quiet"]) == 0
    run = tbsa.read_run("runs/vortex-1")
    free = ~run.layout.seed
    round_the_centre = (run.x * run.vy - run.y * run.vx)[:, free].sum(axis=1)
    assert round_the_centre[1] > 0.0 > round_the_centre[3]  # where the force is at its largest
    assert main(["draw", "runs/vortex-1"]) == 0


def test_the_readmes_python_works_as_printed(here):
    shutil.copytree(ROOT / "paper_runs", here / "paper_runs")
    (block,) = [block for block in blocks("python") if "tbsa.load(" in block]
    names: dict[str, object] = {}
    exec(block, names)
    assert isinstance(names["simulation"], tbsa.Simulation)
    assert (here / "now.png").exists()


def test_every_command_of_the_readme_is_one_of_the_parser():
    commands = [line.strip() for block in blocks("sh") for line in block.splitlines()
                if line.strip().startswith("tbsa ")]
    assert len(commands) >= 4
    for command in commands:
        cli._parser().parse_args(command.split("#")[0].split()[1:])


def test_the_readmes_scenes_are_valid(here):
    (here / "vortex.py").write_text("def vortex(): pass\n")
    scenes = [block for block in blocks("toml") if "[[group]]" not in block]
    assert scenes
    for block in scenes:
        (here / "its.toml").write_text(block)
        tbsa.load(here / "its.toml")


def test_the_citation_and_the_package_agree_on_the_version():
    assert f"version: {tbsa.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f'version = "{tbsa.__version__}"' in (ROOT / "pyproject.toml").read_text()
    assert f"## [{tbsa.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_the_architecture_names_every_module():
    text = (ROOT / "ARCHITECTURE.md").read_text()
    for folder in ("tbsa", "theory"):
        for path in (ROOT / folder).rglob("*.py"):
            if path.name != "__init__.py":
                assert f"`{path.name}`" in text, path.name


def test_runs_are_described_in_json(run):
    assert json.loads((run / "run.json").read_text())["finished"] is True


def test_a_drive_that_cannot_be_compiled_is_bad_input(tmp_path, capsys):
    """A user's engine with the wrong arguments: one line, exit code 2, nothing written."""
    (tmp_path / "mine.py").write_text("def push(t, p):\n    pass\n")
    config = tmp_path / "scene.toml"
    config.write_text(
        '[tiles]\nset = "chessboard"\n[[free.tile]]\ntype = "black"\nposition = [0, 0]\n'
        '[drive]\nkind = "user"\nmodule = "mine.py"\nfunction = "push"\n'
        "[run]\nduration = 10\n"
    )
    out = tmp_path / "out"
    assert main(["run", str(config), "--out", str(out), "--quiet"]) == 2
    error = capsys.readouterr().err.strip()
    assert len(error.splitlines()) == 1
    for word in ("scene.toml", "drive.function", "push", "cannot be compiled as a drive"):
        assert word in error
    assert not out.exists()


# --- fields set on the command line ------------------------------------------------------------


def test_run_sets_fields_of_the_scene(tmp_path, monkeypatch, capsys):
    """A number, a word, a field of an array, and a kind whose old fields go."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(
        '[tiles]\nset = "chessboard"\n[free]\nnumber = 4\n[reactor]\nshape = "circle"\n'
        'radius = 0.15\n[floor]\n[drive]\nkind = "unicycle"\nforce = 0.05\ntorque = 1e-3\n'
        "frequency = 0.1\n[record]\ninterval = 0.05\n")
    settings = ["drive.kind=shaking", "drive.force = 0.06", "floor.law=coupled",
                "tiles.type[1].family=0", "solver.substeps=5"]
    assert cli.main(["run", "scene.toml", "--duration", "0.05", "--out", "out", "--quiet",
                     *(part for each in settings for part in ("--set", each))]) == 0
    scene = tbsa.load("out/scene.toml")
    assert (scene.drive.kind, scene.drive.force, scene.drive.torque) == ("shaking", 0.06, 0.0)
    assert (scene.floor.law, scene.types[1].family, scene.solver.substeps) == ("coupled", 0, 5)


@pytest.mark.parametrize(("text", "words"), [
    ('tiles = "chessboard"\n', "--set tiles.type[0].family: 0 cannot be set"),
    ("x = " + 5000 * "1", "scene.toml: must be "), ("x = " + 3000 * "[", "scene.toml: must be ")])
def test_a_scene_that_is_none_cannot_be_set(text, words, here, capsys):
    Path("scene.toml").write_text(text)
    assert words in refused(capsys, here, "run", "scene.toml", "--set", "tiles.type[0].family=0")


def test_a_field_is_set_once(here, capsys):
    assert "--set drive.force: '0.2' must be set once" in refused(
        capsys, here, "run", "scene.toml", "--set", "drive.force=0.1", "--set", "drive.force=0.2")


@pytest.mark.parametrize(("option", "value"), [("--duration", "5.0"), ("--seed", "7")])
def test_what_an_option_gives_is_not_set_besides(option, value, here, capsys):
    assert f"{option}: {value} must be left out where --set gives run.{option[2:]}" in refused(
        capsys, here, "run", "scene.toml", option, value, "--set", f"run.{option[2:]} = 3")


@pytest.mark.parametrize("order", [1, -1])
def test_fields_are_set_in_whatever_order_they_are_named(order, here):
    settings = ["tiles.type[0].family=0", "tiles.set=chessboard-oriented"][::order]
    scene = changed("scene.toml", settings)
    assert (scene.types[0].family, scene.types[0].glues[0]) == (0, 2)


@pytest.mark.parametrize(("setting", "words"), [
    ("drive.force", "--set: 'drive.force' must be NAME=VALUE"),
    ("=1", "--set: '=1' must be NAME=VALUE"),
    ("drive.force=0.06\ndrive.frequency=0.1", "--set drive.force: '0.06"),
    ("drive.force=much", "drive.force: 'much' must be a number from 0"),
    ("drive.forc=1", 'did you mean "force"?'),
    ("tiles.type[7].family=1", "--set tiles.type[7].family: 1 cannot be set"),
    ("solver.step=nan", "solver.step: nan must be a number above 0"),
    (f"tiles.type[{5000 * '1'}].family=1", "must be NAME=VALUE"),
    ("drive.force.x.y=1", "--set drive.force.x.y: 1 cannot be set"),
    ("tiles.set.x.y=1", "--set tiles.set.x.y: 1 cannot be set"),
    ("drive.force=" + 5000 * "1", "drive.force: '1111"),
    ("drive.force=" + 3000 * "[", "drive.force: '[[["),
    ("drive.parameters=" + 3000 * "[" + 3000 * "]", "drive.parameters: '[[["),
])
def test_a_setting_that_cannot_be_is_refused(setting, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(
        '[tiles]\nset = "chessboard"\n[free]\nnumber = 2\n[reactor]\nshape = "circle"\n'
        'radius = 0.15\n[drive]\nkind = "shaking"\nforce = 0.05\nfrequency = 0.3\n')
    assert cli.main(["run", "scene.toml", "--out", "out", "--set", setting]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not Path("out").exists()
