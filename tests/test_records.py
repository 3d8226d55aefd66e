"""Runs on disk: the same bits however a run is cut, broken off or taken up again."""

from __future__ import annotations

import copy
import errno
import gc
import json
import multiprocessing
import os
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tbsa
from tbsa.errors import InputError
from tbsa.model import records, simulation
from tbsa.model.scene import (
    Floor,
    Free,
    PlacedTile,
    Record,
    Run,
    Solver,
    fingerprint,
    load,
)
from tbsa.model.simulation import Simulation

ROOT = Path(__file__).parents[1]
UNICYCLE = '[drive]\nkind = "unicycle"\nforce = 0.1\ntorque = 3e-3\nfrequency = 0.5\n'
SHAKING = '[drive]\nkind = "shaking"\nforce = 0.1\nfrequency = 0.5\n'
DRIVES = {"unicycle": UNICYCLE, "shaking": SHAKING}
SCENE = """
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
[floor]
[record]
interval = 0.5
checkpoint = 1.0
[run]
duration = 3.0
seed = 3
"""
FILES = ("records.npy", "checkpoint.npz", "layout.npz", "scene.toml")


@pytest.fixture(params=DRIVES)
def scene(request, tmp_path):
    """A crowded little reactor, 31 tiles, 3 s, under each of the paper's drives."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE + DRIVES[request.param])
    return load(path)


@pytest.fixture
def whole(scene, tmp_path):
    """The folder of the uninterrupted run of the scene."""
    assert records.run(scene, tmp_path / "whole").finished
    return tmp_path / "whole"


def lasting(scene, seconds):
    return replace(scene, run=Run(seconds, scene.run.seed))


def same(folder, whole):
    """Names of the files that differ; those of a run are all there."""
    return [name for name in FILES
            if (folder / name).read_bytes() != (whole / name).read_bytes()]


def interrupted(scene, folder, at, monkeypatch, resume=False):
    """Run with a Ctrl-C at the first look after `at` s; looks come every few substeps."""
    monkeypatch.setattr(records, "GLANCE", 1e-5)

    def press(running, recorded):
        if running.time >= at:
            os.kill(os.getpid(), signal.SIGINT)

    outcome = records.run(scene, folder, resume=resume, progress=press)
    monkeypatch.undo()
    return outcome


def test_tiles_move_collide_and_bond_in_these_runs(scene, whole):
    run = tbsa.read_run(whole)
    free = ~run.layout.seed
    assert np.hypot(run.x[-1] - run.x[0], run.y[-1] - run.y[0])[free].min() > 1e-4
    counts = json.loads((whole / "run.json").read_text())["counts"]
    assert counts["impacts"] > 100
    assert max(tbsa.assembly(scene, run.layout, *places).bonds
               for places in zip(run.x, run.y, run.angle, strict=True)) > 3


# ---------------------------------------------------------------------------------------------
# The same bits.


def test_the_same_run_twice_gives_the_same_files(scene, whole, tmp_path):
    records.run(scene, tmp_path / "again")
    assert same(tmp_path / "again", whole) == []


def test_the_same_run_in_another_process_gives_the_same_files(scene, whole, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "tbsa.work.cli", "run", scene.file, "--out", tmp_path / "other",
         "--quiet"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert same(tmp_path / "other", whole) == []
    assert "3 s simulated" in done.stdout


def test_another_seed_gives_another_run(scene, whole, tmp_path):
    records.run(replace(scene, run=Run(3.0, 6)), tmp_path / "other")
    assert same(tmp_path / "other", whole) == list(FILES)


def test_how_a_run_is_cut_into_calls_does_not_matter(scene, whole, tmp_path, monkeypatch):
    step, cut = Simulation(scene), random.Random(1)
    end = round(3.0 / scene.solver.step)
    while step.steps < end:
        step.advance(min(cut.randint(1, 60), end - step.steps))
    run = tbsa.read_run(whole)
    for name in records.FIELDS:
        np.testing.assert_array_equal(getattr(step, name), getattr(run, name)[-1])
    monkeypatch.setattr(records, "GLANCE", 0.0)  # one step a call
    records.run(scene, tmp_path / "fine")
    assert same(tmp_path / "fine", whole) == []


def test_steps_at_rest_are_counted_however_a_run_is_cut_into_calls(scene, tmp_path, monkeypatch):
    """How long calls are is a matter of time; of many steps that change nothing one is done."""
    still = replace(scene, drive=None, magnet=None)
    assert records.run(still, tmp_path / "whole").simulation.counts.still[0] > 0
    monkeypatch.setattr(records, "GLANCE", 0.0)  # one step a call
    assert records.run(still, tmp_path / "fine").simulation.counts.still[0] == 0
    assert same(tmp_path / "fine", tmp_path / "whole") == []


def test_a_simulation_goes_forward_only_and_to_an_end(scene):
    step = Simulation(scene)
    for seconds in (-0.1, float("nan"), float("inf"), 1e308, 10**400):
        with pytest.raises(InputError, match=r"seconds: .* must be a number from 0 s"):
            step.run(seconds)
    with pytest.raises(InputError, match="steps: -1 must be a whole number from 0"):
        step.advance(-1)
    for text in ("1", b"1", None):
        with pytest.raises(TypeError):
            step.run(text)
    step.advance(0)
    assert step.steps == 0


def test_a_record_holds_the_state_at_its_time(scene, whole):
    run, step = tbsa.read_run(whole), Simulation(scene)
    np.testing.assert_array_equal(run.time, [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    for k in range(7):
        for name in records.FIELDS:
            np.testing.assert_array_equal(getattr(run, name)[k], getattr(step, name))
        step.run(0.5)


# ---------------------------------------------------------------------------------------------
# Broken off and taken up again.


def test_killed_from_outside_and_resumed_a_run_ends_in_the_same_bits(scene, tmp_path):
    scene = lasting(scene, 60.0)
    folder = tmp_path / "killed"
    child = subprocess.Popen(
        [sys.executable, "-m", "tbsa.work.cli", "run", scene.file, "--duration", "60",
         "--out", folder, "--quiet"], cwd=ROOT)
    begin = time.monotonic()
    while child.poll() is None and time.monotonic() - begin < 300.0:
        try:
            if tbsa.read_run(folder).time[-1] > 5.0:
                break
        except InputError:  # not begun
            pass
        time.sleep(0.01)
    child.kill()
    assert child.wait() == -signal.SIGKILL, "it ended before it was killed"
    assert 5.0 < tbsa.read_run(folder).time[-1] < 60.0
    assert records.run(scene, folder, resume=True).finished
    records.run(scene, tmp_path / "whole")
    assert same(folder, tmp_path / "whole") == []


def _killed_at(scene, folder, resume, call):
    """In a process of its own: SIGKILL instead of the call-th synchronising or replacing."""
    left = call

    def deadly(function):
        def instead(*arguments):
            nonlocal left
            left -= 1
            if left <= 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments)
        return instead

    os.fsync, os.replace = deadly(os.fsync), deadly(os.replace)
    records.run(scene, folder, resume=resume)


def test_killed_again_and_again_while_it_writes_it_still_ends_in_the_same_bits(
        scene, whole, tmp_path):
    folder, at, kills = tmp_path / "killed", random.Random(2), 0
    fork = multiprocessing.get_context("fork")
    for _ in range(8):
        if folder.exists() and not (folder / "run.json").exists():
            shutil.rmtree(folder)  # killed before it was a run
        resume = folder.exists()
        child = fork.Process(target=_killed_at, args=(scene, folder, resume, at.randint(8, 24)))
        child.start()
        child.join()
        kills += child.exitcode == -signal.SIGKILL
    assert kills >= 3
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


@pytest.mark.parametrize("at", [0.01, 0.5, 1.23, 2.0, 2.99])
def test_ctrl_c_saves_and_the_resumed_run_ends_in_the_same_bits(
        scene, whole, tmp_path, monkeypatch, at):
    folder = tmp_path / "stopped"
    outcome = interrupted(scene, folder, at, monkeypatch)
    assert not outcome.finished
    assert at <= outcome.simulation.time < 3.0
    info = json.loads((folder / "run.json").read_text())
    assert not info["finished"]
    assert info["time"] == outcome.simulation.time
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


def test_ctrl_c_twice_in_a_row_breaks_off_and_leaves_the_last_checkpoint(
        scene, whole, tmp_path):
    def press(running, recorded):
        if running.time > 1.2:
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    # A job in the background of a shell begins with Ctrl-C ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            records.run(scene, tmp_path / "stopped", progress=press)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert json.loads((tmp_path / "stopped" / "run.json").read_text())["time"] == 1.0
    assert records.run(scene, tmp_path / "stopped", resume=True).finished
    assert same(tmp_path / "stopped", whole) == []


def test_stopped_many_times_it_ends_in_the_same_bits(scene, whole, tmp_path, monkeypatch):
    folder, resume = tmp_path / "stopped", False
    for at in (0.2, 0.9, 0.95, 1.5, 2.6):
        assert not interrupted(scene, folder, at, monkeypatch, resume).finished
        resume = True
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


@pytest.mark.parametrize("first", [1.0, 1.5, 1.7])
def test_a_run_made_longer_equals_the_longer_run(scene, whole, tmp_path, first):
    folder = tmp_path / "longer"
    records.run(lasting(scene, first), folder)
    assert tbsa.read_run(folder).time[-1] == pytest.approx(first, abs=1e-12)
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


def test_an_end_between_record_times_is_recorded(scene, tmp_path):
    records.run(lasting(scene, 1.7), tmp_path / "short")
    np.testing.assert_allclose(tbsa.read_run(tmp_path / "short").time, [0, 0.5, 1, 1.5, 1.7])
    before = (tmp_path / "short" / "records.npy").read_bytes()
    records.run(lasting(scene, 1.7), tmp_path / "short", resume=True)
    assert (tmp_path / "short" / "records.npy").read_bytes() == before


def test_a_finished_run_resumed_stays_as_it_is(scene, whole):
    before = [(whole / name).read_bytes() for name in FILES]
    assert records.run(scene, whole, resume=True).finished
    assert [(whole / name).read_bytes() for name in FILES] == before


def test_a_disk_that_fills_up_costs_no_more_than_the_last_checkpoint(
        scene, whole, tmp_path, monkeypatch):
    folder, left = tmp_path / "full", 11
    sync = os.fsync

    def full(descriptor):
        nonlocal left
        left -= 1
        if left <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        records.run(scene, folder)
    monkeypatch.undo()
    assert 0.0 < json.loads((folder / "run.json").read_text())["time"] < 3.0
    assert sorted(path.name for path in folder.iterdir()) == sorted([*FILES, "run.json"])
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


def test_the_start_is_read_from_the_folder_not_placed_anew(
        scene, whole, tmp_path, monkeypatch):
    interrupted(scene, tmp_path / "stopped", 1.2, monkeypatch)
    monkeypatch.delattr(simulation, "initial_layout")
    assert records.run(scene, tmp_path / "stopped", resume=True).finished
    assert same(tmp_path / "stopped", whole) == []


def test_an_entry_cut_off_by_a_kill_is_not_read_and_is_overwritten(scene, tmp_path):
    folder, whole = tmp_path / "cut", tmp_path / "whole"
    records.run(lasting(scene, 2.0), folder)
    records.run(scene, whole)
    with open(folder / "records.npy", "ab") as file:
        file.write(b"\x7f" * 300)
    assert tbsa.read_run(folder).time.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    records.run(scene, folder, resume=True)
    assert same(folder, whole) == []


def test_records_beyond_the_checkpoint_are_written_again(scene, whole, tmp_path):
    folder, shorter = tmp_path / "behind", tmp_path / "shorter"
    records.run(lasting(scene, 1.0), folder)
    shutil.copy(whole / "records.npy", folder)
    assert records.run(lasting(scene, 2.0), folder, resume=True).finished
    records.run(lasting(scene, 2.0), shorter)
    assert same(folder, shorter) == []


@pytest.mark.parametrize(("zeros", "words"), [
    (4000, "time: is damaged"), (0, "is damaged: mmap length is greater than file size")])
def test_what_a_power_cut_leaves_behind_the_checkpoint_is_written_again(
        scene, whole, tmp_path, zeros, words):
    """The header of records.npy may reach the disk before the records do, which then are zeros, or
    before the length of the file does."""
    folder = tmp_path / "cut"
    records.run(lasting(scene, 1.0), folder)
    data = (whole / "records.npy").read_bytes()
    (folder / "records.npy").write_bytes(data[:-4000] + bytes(zeros))
    with pytest.raises(InputError, match=rf"records\.npy: {words}"):
        tbsa.read_run(folder)
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


@pytest.mark.parametrize("end", [1, 3000])
def test_records_that_the_checkpoint_has_seen_must_be_there(scene, whole, tmp_path, end):
    """Of a file that is cut within them nothing is taken for granted, nor is it touched."""
    folder = shutil.copytree(whole, tmp_path / "short")
    data = (folder / "records.npy").read_bytes()[:-end]
    (folder / "records.npy").write_bytes(data)
    with pytest.raises(InputError, match=r"records\.npy: is damaged"):
        records.run(lasting(scene, 4.0), folder, resume=True)
    assert (folder / "records.npy").read_bytes() == data


READER = """
import sys
import tbsa
run = tbsa.read_run(sys.argv[1])
print(len(run.time), flush=True)
sys.stdin.readline()
print(run.x[:].sum(), flush=True)
"""


def test_who_reads_records_is_not_killed_when_the_run_goes_on(scene, whole, tmp_path, monkeypatch):
    """A page of a mapped file that is no longer there is a SIGBUS."""
    folder = tmp_path / "behind"
    records.run(lasting(scene, 1.0), folder)
    shutil.copy(whole / "records.npy", folder)  # as a kill leaves it
    inode = (folder / "records.npy").stat().st_ino
    with subprocess.Popen([sys.executable, "-c", READER, folder], cwd=ROOT, text=True,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE) as reader:
        assert reader.stdout.readline() == "7\n"
        assert not interrupted(scene, folder, 1.2, monkeypatch, resume=True).finished
        assert len(tbsa.read_run(folder).time) == 3  # what the header says
        out, _ = reader.communicate("go on\n")
    assert reader.returncode == 0
    assert float(out) == tbsa.read_run(whole).x[:].sum()
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []
    assert (folder / "records.npy").stat().st_ino == inode  # that of the lock


def test_what_cannot_be_opened_is_not_called_damaged(whole):
    for name in ("checkpoint.npz", "records.npy", "layout.npz", "run.json"):
        (whole / name).rename(whole / "aside")
        (whole / name).symlink_to(name)
        with pytest.raises(InputError, match=rf"{name}: cannot be read: Too many levels"):
            records.run(load(whole / "scene.toml"), whole, resume=True)
        (whole / "aside").rename(whole / name)


@pytest.mark.parametrize("resume", [False, True])
def test_a_full_disk_at_the_first_bytes_names_the_file(scene, whole, tmp_path, monkeypatch, resume):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(records._Writer, "_header", full)
    folder = whole if resume else tmp_path / "new"
    with pytest.raises(OSError, match=r"No space left on device: '.*records\.npy'"):
        records.run(lasting(scene, 4.0), folder, resume=resume)


# ---------------------------------------------------------------------------------------------
# What a folder holds.


def test_the_numbers_of_a_run(scene, whole):
    info = json.loads((whole / "run.json").read_text())
    assert info["version"] == tbsa.__version__
    assert info["fingerprint"] == fingerprint(scene)
    assert info["finished"] is True
    assert info["time"] == 3.0
    assert 0.0 < info["wall"] < 120.0
    counts = info["counts"]
    assert counts["steps"] == 3 * 480
    assert sum(counts["overlap"]) == 8 * 4 * counts["steps"]  # all the time, in eighths of h
    assert counts["steps"] < counts["substeps"] < 8 * 4 * counts["steps"]
    assert 0 < counts["lists"] < counts["substeps"]
    assert counts["passes"] >= counts["substeps"]
    assert counts["unconverged"] <= counts["substeps"]
    assert 0.0 <= counts["deepest"] < 0.1 * scene.material.width


def test_wall_time_and_counts_add_up_over_a_break(scene, whole, tmp_path, monkeypatch):
    folder = tmp_path / "stopped"
    first = interrupted(scene, folder, 1.2, monkeypatch)
    saved = json.loads((folder / "run.json").read_text())
    records.run(scene, folder, resume=True)
    info = json.loads((folder / "run.json").read_text())
    assert info["wall"] > saved["wall"]
    assert saved["wall"] <= first.wall
    once = json.loads((whole / "run.json").read_text())["counts"]
    for name in records.OF_PROCESS:
        info["counts"][name] = once[name]
    assert info["counts"] == once


def test_the_end_of_a_run_is_a_time_that_is_recorded_though_its_step_is_rounded(scene):
    """4800 steps of 0.0020833333333 s are 0.16 ns less than 10 s."""
    step = 0.0020833333333
    each = replace(scene, solver=Solver(step=step))
    layout = tbsa.initial_layout(each)
    run = records.Records(each, layout, np.array([0.0, 4800 * step]), *6 * [layout.x])
    assert run.time[-1] < 10.0 - 1e-10
    assert run.at(10.0) == 1
    assert run.at(-0.001) == 0
    assert list(run.chosen(None, 10.0, 1)) == [0, 1]
    with pytest.raises(InputError, match=r"10\.002 is not .* holds 0 to 9\.99999999984 s"):
        run.at(10.002)


def test_progress_is_told_of_every_record(scene, tmp_path):
    told = []
    records.run(scene, tmp_path / "run", progress=lambda s, new: told.append((s.time, new)))
    times = [moment for moment, _ in told]
    assert times == sorted(times)
    assert [moment for moment, new in told if new] == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]


def test_progress_can_end_the_run_which_is_saved(scene, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(records, "GLANCE", 1e-5)
    folder = tmp_path / "ended"
    outcome = records.run(scene, folder, progress=lambda running, _: running.time >= 1.3)
    assert not outcome.finished
    assert 1.3 <= outcome.simulation.time < 3.0
    assert json.loads((folder / "run.json").read_text())["time"] == outcome.simulation.time
    assert records.run(scene, folder, resume=True).finished
    assert same(folder, whole) == []


def test_the_scene_in_the_folder_is_complete(scene, whole):
    copy = load(whole / "scene.toml")
    assert replace(copy, file="") == replace(scene, file="")


def test_a_new_run_does_not_touch_a_folder_with_anything_in_it(scene, tmp_path):
    before = (tmp_path / "scene.toml").read_bytes()  # one that would be overwritten
    with pytest.raises(InputError, match="must be a new or an empty folder"):
        records.run(scene, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]
    assert (tmp_path / "scene.toml").read_bytes() == before


def test_another_interval_of_records_cannot_be_resumed(scene, whole):
    before = [(whole / name).read_bytes() for name in FILES]
    for interval in (0.25, 1.0):
        other = replace(lasting(scene, 4.0), record=Record(interval, 1.0))
        with pytest.raises(InputError, match=rf"record\.interval: {interval} s must stay 0\.5 s"):
            records.run(other, whole, resume=True)
    assert [(whole / name).read_bytes() for name in FILES] == before


@pytest.mark.parametrize("noted", [True, False])
@pytest.mark.parametrize("interval", [0.25, 1.0, 2.0])
def test_another_interval_costs_no_records_where_the_checkpoint_has_seen_but_one(
        scene, tmp_path, monkeypatch, interval, noted):
    """Also where the folder's own scene has been edited, and in a folder that has it there only."""
    folder = tmp_path / "run"
    scene = replace(scene, record=Record(0.5, 2.0))
    interrupted(scene, folder, 0.1, monkeypatch)
    early = [(folder / name).read_bytes() for name in ("checkpoint.npz", "run.json")]
    assert not interrupted(scene, folder, 1.6, monkeypatch, resume=True).finished
    for name, data in zip(("checkpoint.npz", "run.json"), early, strict=True):
        (folder / name).write_bytes(data)  # as a kill at 1.6 s leaves them
    other = replace(scene, record=Record(interval, 2.0))
    if noted:
        (folder / "scene.toml").write_text(tbsa.dumps(other))
    else:
        info = json.loads((folder / "run.json").read_text())
        info.pop("interval", None)
        (folder / "run.json").write_text(json.dumps(info))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert len(tbsa.read_run(folder).time) == 4
    with pytest.raises(InputError, match=r"record\.interval: .* must stay 0\.5 s"):
        records.run(other, folder, resume=True)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert records.run(scene, folder, resume=True).finished


DRIVE = """
def push(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    for i in range(x.size):
        fx[i] += p[0] * family[i]
"""


def test_a_run_with_a_drive_of_ones_own_stands_on_its_own(tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    (home / "push.py").write_text(DRIVE)
    (home / "scene.toml").write_text(
        SCENE + '[drive]\nkind = "user"\nmodule = "push.py"\nfunction = "push"\n'
        "parameters = [0.1]\n")
    scene = load(home / "scene.toml")
    records.run(scene, tmp_path / "whole")
    assert not interrupted(scene, tmp_path / "stopped", 1.2, monkeypatch).finished
    shutil.rmtree(home)
    again = load(tmp_path / "stopped" / "scene.toml")
    assert records.run(again, tmp_path / "stopped", resume=True).finished
    assert same(tmp_path / "stopped", tmp_path / "whole") == []
    run = tbsa.read_run(tmp_path / "whole")
    assert run.x[-1].std() > 0.0
    (tmp_path / "whole" / "drive.py").write_text(DRIVE.replace("fx[i] +=", "fy[i] +="))
    with pytest.raises(InputError, match="was changed after the run"):
        tbsa.read_run(tmp_path / "whole")


def test_a_drive_edited_during_its_run_does_not_change_what_the_run_is(tmp_path):
    (tmp_path / "push.py").write_text(DRIVE)
    path = tmp_path / "scene.toml"
    path.write_text(SCENE + '[drive]\nkind = "user"\nmodule = "push.py"\nfunction = "push"\n'
                    "parameters = [0.1]\n")
    records.run(load(path), tmp_path / "run",
                progress=lambda *_: (tmp_path / "push.py").unlink(missing_ok=True))
    assert tbsa.read_run(tmp_path / "run").time[-1] == 3.0


def driven(folder, source, parameters="[0.1]", function="push"):
    """A scene with a drive of this source, read."""
    (folder / "push.py").write_text(source)
    path = folder / "scene.toml"
    path.write_text(SCENE + f'[drive]\nkind = "user"\nmodule = "push.py"\n'
                    f'function = "{function}"\nparameters = {parameters}\n')
    return load(path)


@pytest.mark.parametrize(("line", "words"), [
    ("    if t > 0.1:\n        raise ValueError('boo\\nhoo')\n", r"ValueError \(boo hoo\)"),
    ("    if t > 0.1:\n        raise ValueError(t)\n", r"ValueError \(0.1"),
    ("    if t > 0.1:\n        raise ValueError('\x1b[31mred')\n", r"ValueError \(\\x1b\[31mred\)"),
    ("    fx[:] = x[:3]\n", "ValueError"),
    ("    assert t < 0.1\n", "AssertionError"),
    ("    fx[0] += p[5]\n", "IndexError"),
    ("    fx[x.size] += 1.0\n", "IndexError")])
def test_a_drive_that_raises_ends_the_run(tmp_path, capfd, line, words):
    with pytest.raises(simulation.SimulationError, match=f"the drive raised {words}"):
        tbsa.run(driven(tmp_path, DRIVE + line), tmp_path / "run")
    assert capfd.readouterr().err == ""
    assert not json.loads((tmp_path / "run" / "run.json").read_text())["finished"]


def test_what_a_drive_raises_ends_the_run_of_its_own_thread_and_no_other(tmp_path):
    scenes = [driven(tmp_path, DRIVE + "    if t > p[1]:\n        raise ValueError('boo')\n",
                     parameters=f"[0.1, {last}]") for last in (0.5, 1e9)]
    hook = sys.unraisablehook

    def outcome(scene):
        s = simulation.Simulation(scene)
        try:
            for _ in range(40):
                s.run(0.05)
        except simulation.SimulationError as error:
            return str(error)
        return "done"

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(outcome, scenes * 10))
    assert all("the drive raised ValueError (boo)" in each for each in found[::2])
    assert found[1::2] == ["done"] * 10
    assert sys.unraisablehook is hook


def test_what_has_ended_with_an_error_says_so_and_does_not_go_on(tmp_path):
    s = Simulation(driven(tmp_path, DRIVE + "    if t > 0.1:\n        raise ValueError('boo')\n"))
    with pytest.raises(simulation.SimulationError, match=r"raised .* between t = 0.0 s and "):
        s.run(1.0)
    assert s.steps == s.counts.steps[0]
    with pytest.raises(simulation.SimulationError, match="has ended before: the drive raised"):
        s.advance(1)


class Untidy:
    """Raises when it is collected, which is nobody's business but its own."""

    def __init__(self):
        self.itself = self

    def __del__(self):
        raise ValueError("not of a drive")


@pytest.mark.parametrize("of_user", [True, False])
def test_what_others_leave_for_the_hook_does_not_end_a_run(tmp_path, monkeypatch, of_user):
    seen = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: seen.append(str(what.exc_value)))
    source = DRIVE + "    if t < 0.0:\n        raise ValueError('boo')\n"
    scene = driven(tmp_path, source) if of_user else tbsa.parse(SCENE)
    s = Simulation(scene, threads=2)

    def advance(*loads):
        Untidy()
        gc.collect()
        return core(*loads)

    core = s._advance
    s._advance = advance
    s.advance(3)
    assert seen == ["not of a drive"]


def test_an_interrupted_call_leaves_time_and_state_together():
    s, whole = (Simulation(tbsa.parse(SCENE)) for _ in range(2))
    core = s._advance

    def advance(*loads):
        core(*loads)
        raise KeyboardInterrupt

    s._advance = advance
    with pytest.raises(KeyboardInterrupt):
        s.advance(7)
    assert (s.steps, s.counts.steps[0]) == (7, 7)
    s._advance = core
    s.advance(3)
    whole.advance(10)
    assert np.array_equal(s.x, whole.x)


def test_an_interrupt_is_not_kept_waiting_for_all_steps(monkeypatch):
    monkeypatch.setattr(simulation, "PART", 100)
    s, whole = (Simulation(tbsa.parse(SCENE)) for _ in range(2))
    core, parts = s._advance, []

    def advance(*loads):
        parts.append(loads[10])
        return core(*loads)

    s._advance = advance
    s.advance(10)
    assert parts == [3, 3, 3, 1]  # of 31 tiles
    monkeypatch.undo()
    whole.advance(10)
    assert np.array_equal(s.x, whole.x)


def test_short_calls_come_to_the_same_time_as_a_long_one():
    s, whole = (Simulation(tbsa.parse(SCENE)) for _ in range(2))
    for _ in range(1000):
        s.run(1e-3)
    whole.run(1.0)
    assert s.time == whole.time == 1.0
    assert np.array_equal(s.x, whole.x)


def test_a_drive_may_give_held_tiles_what_is_no_number(tmp_path):
    """As a force towards the origin does where a tile of the seed is."""
    source = DRIVE.replace("fx[i] += p[0] * family[i]",
                           "fx[i] -= p[0] * x[i] / (x[i] * x[i] + y[i] * y[i]) ** 0.5")
    s = Simulation(driven(tmp_path, source))
    s.run(0.2)
    assert (s.x[s.layout.held] == s.layout.x[s.layout.held]).all()
    assert np.isfinite(s.x).all()


def test_a_drive_is_not_refused_for_its_name(tmp_path):
    source = DRIVE.replace("push", "random_state")
    Simulation(driven(tmp_path, source, function="random_state")).advance(1)
    with pytest.raises(InputError, match="must not use random numbers"):
        Simulation(driven(tmp_path, "import random\n" + DRIVE + "    fx[0] += random.random()\n"))


@pytest.mark.parametrize(("name", "change", "words"), [
    ("y", lambda y: y[:1], "must be an array of 31 numbers"),
    ("type", lambda t: t[:1], "must be an array of 31 whole numbers"),
    ("type", lambda t: t + 5, "must be from 0 to 1, of the scene's types"),
    ("type", lambda t: t - 1, "must be from 0 to 1, of the scene's types"),
    ("held", lambda held: held[:1], "must be an array of 31 truth values"),
    ("angle", lambda angle: list(angle), "must be an array of 31 numbers"),
    ("angle", lambda angle: angle - 1e17, r"must be from -1e\+09 to 1e\+09 rad"),
    ("vx", lambda vx: vx + np.nan, "nan must be finite numbers")])
def test_a_layout_that_does_not_fit_is_refused(name, change, words):
    scene = tbsa.parse(SCENE)
    layout = Simulation(scene).layout
    wrong = replace(layout, **{name: change(getattr(layout, name))})
    with pytest.raises(InputError, match=rf"^layout\.{name}: (?!np\.).*{words}"):
        Simulation(scene, wrong)


@pytest.mark.parametrize(("place", "words"), [
    ((5.0, 0.0), r"\(5.0, 0.0\) of tile 30 must lie inside the reactor"),
    (None, r"of tiles 29 and 30 are all but one: they overlap by more than 0.75 widths")])
def test_a_layout_with_a_tile_where_none_can_be_is_refused(place, words):
    scene = tbsa.parse(SCENE)
    layout = Simulation(scene).layout
    x, y = layout.x.copy(), layout.y.copy()
    x[30], y[30] = place or (x[29] + 1e-3, y[29])
    with pytest.raises(InputError, match=rf"^layout\.x, layout\.y: .*{words}"):
        Simulation(scene, replace(layout, x=x, y=y))


def test_a_thread_that_does_not_start_is_told_of(monkeypatch):
    s = Simulation(tbsa.parse(SCENE), threads=2)

    def start(_):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(RuntimeError, match="can't start new thread"):
        s.advance(1)


def test_the_tile_that_is_too_fast_for_its_neighbours_is_named():
    scene = tbsa.parse('''
[[tiles.type]]
name = "tile"
colour = "grey"
glues = [0, 0, 0, 0]
[[free.tile]]
type = "tile"
position = [0.0, 0.0]
velocity = [90.0, 0.0]
[[free.tile]]
type = "tile"
position = [0.2, 0.0]
[[free.tile]]
type = "tile"
position = [500.0, 0.0]
velocity = [400.0, 0.0]
''')
    with pytest.raises(simulation.SimulationError, match=r"a tile goes at 90 m/s .* at t = 0\.0 s"):
        Simulation(scene).advance(1)


def test_a_drive_that_is_no_number_is_told_of_as_that(tmp_path):
    scene = driven(tmp_path, DRIVE + "    if t > 0.0051:\n        fx[:] = t * 1e308 * 1e308 * 0\n")
    with pytest.raises(simulation.SimulationError, match="stopped being finite"):
        Simulation(scene).run(1.0)


@pytest.mark.parametrize("law", [None, "separate", "coupled", "exact"])
@pytest.mark.parametrize("line", ["fx[0] += p[0] * p[0] * 0.0", "fx[0] += p[0] * p[0]",
                                  "torque[0] += p[0] * p[0] * 0.0"])
def test_a_drive_that_is_no_number_for_a_moment_is_told_of_though_its_tile_is_alone(
        tmp_path, line, law):
    """What rests is at rest, and what has no place is not."""
    nothing = DRIVE.replace("p[0]", "0.0")
    crowd = driven(tmp_path, nothing + f"    if 0.1 < t < 0.11:\n        {line}\n", [1e200])
    scene = replace(crowd, seed=None, reactor=None, magnet=None, floor=law and Floor(law),
                    free=Free(tiles=(PlacedTile(crowd.types[0].name, (0.0, 0.0)),)))
    with pytest.raises(simulation.SimulationError, match="stopped being finite"):
        Simulation(scene).run(1.0)


@pytest.mark.parametrize("what", ["fx[:] = t * 1e308 * 1e308 * 0", "raise ValueError('boo')"])
@pytest.mark.parametrize("steps", [1, 7, 1000])
def test_the_times_of_an_error_are_those_between_which_it_came(tmp_path, what, steps):
    s = Simulation(driven(tmp_path, DRIVE + f"    if t > 0.25:\n        {what}\n"))
    with pytest.raises(simulation.SimulationError) as caught:  # noqa: PT012
        while True:
            last = s.time
            s.advance(steps)
    found = re.search(r" between t = (\S+) s and (\S+) s", str(caught.value))
    begin, end = float(found[1]), float(found[2])
    # Forces are found at a quarter and at three quarters of a step.
    assert begin == last <= 0.25 < end - 0.25 * s.h
    assert end <= last + (steps + 0.5) * s.h
    assert caught.value.reason == str(caught.value).replace(found[0], "")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.reason) == (str(caught.value), caught.value.reason)


def test_a_simulation_is_not_copied(scene):
    """A copy would share its arrays; other parts of a run are copied."""
    s = Simulation(scene)
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="make another of its scene"):
            copied(s)
    for whole in (s.scene, s.layout):
        assert pickle.dumps(copy.deepcopy(whole)) == pickle.dumps(whole)


def test_times_are_numbers_of_any_kind(scene):
    """Also of half the precision; the time that a call comes short by is kept as a float64."""
    one, other = Simulation(scene), Simulation(scene)
    one.run(0.5)
    one.run(float(np.float32(0.1)))
    other.run(np.float16(0.5))
    other.run(np.float32(0.1))
    assert other.steps == one.steps > 0
    assert type(other._rest) is float
    Simulation(replace(scene, drive=None), replace(one.layout, held=one.layout.x < 9.0)).run(
        np.float16(1000.0))


def test_what_is_no_scene_and_no_run_is_told(tmp_path):
    for call in (tbsa.initial_layout, tbsa.dumps, tbsa.draw):
        with pytest.raises(TypeError, match="scene must be a Scene, not str"):
            call(*["a.toml", None, [], [], []][:5 if call is tbsa.draw else 1])
    for call, name in ((tbsa.view, "a.html"), (tbsa.movie, "a.gif"), (tbsa.export, "a.gsd")):
        with pytest.raises(TypeError, match=r"records must be Records, not \w+: tbsa\.read_run"):
            call(tmp_path, tmp_path / name)


def test_a_drive_has_exactly_its_parameters(tmp_path):
    source = DRIVE.replace("fx[i] += p[0] * family[i]", "fx[i] += p.size + p.sum()")
    for parameters, force in (([], 0.0), ([2.0], 3.0), ([1.0, 2.0], 5.0)):
        s = Simulation(driven(tmp_path, source, parameters))
        fx = np.zeros(31)
        s.engine(0.0, s.parameters, *np.zeros((8, 31)), fx, np.zeros(31), np.zeros(31))
        assert set(fx.tolist()) == {force}


def test_an_edited_drive_takes_effect_whatever_its_time_and_length(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    forces = []
    for factor in (1, 2, 3):
        scene = driven(tmp_path, DRIVE.replace("p[0] *", f"{factor} * p[0] *"))
        os.utime(tmp_path / "push.py", (1e9, 1e9))
        s = Simulation(scene)
        fx = np.zeros(31)
        s.engine(0.0, s.parameters, *np.zeros((6, 31)), np.ones(31), np.zeros(31), fx,
                 np.zeros(31), np.zeros(31))
        forces.append(fx[0])
    assert forces == pytest.approx([0.1, 0.2, 0.3])
    assert not (tmp_path / "__pycache__").exists()


@pytest.mark.parametrize(("source", "words"), [
    (DRIVE + "    yield\n", "not one that yields"),
    (DRIVE + "push = (lambda g: lambda *args: g(*args))(push)\n", "takes them as .args"),
    (DRIVE + "import sys\nsys.exit(0)\n", "SystemExit: 0"),
    (DRIVE + "raise GeneratorExit\n", "GeneratorExit"),
    (DRIVE + "raise ValueError('two\\nlines')\n", r"ValueError: two\\nlines"),
    (DRIVE.replace("family[i]", "famly[i]"), "famly"),
    (DRIVE + "push = 3\n", "'push' must be a function, .* and is of type int"),
    (DRIVE + "import functools\npush = functools.lru_cache(push)\n", "or what wraps it"),
    ("b = bytearray(3)\n" + DRIVE + "    fx[0] += b[0]\n",
     "it uses a bytearray of its module; what a drive takes"),
    ("b = {1: 2}\n" + DRIVE + "    fx[0] += b[1]\n", "b is a dict; what a drive takes")])
def test_what_is_no_drive_is_refused_in_one_line_before_anything_is_written(
        tmp_path, source, words):
    with pytest.raises(InputError, match=words) as caught:
        tbsa.run(driven(tmp_path, source), tmp_path / "run")
    assert len(str(caught.value).splitlines()) == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("line", "words"), [
    ("fx[0] += plain(t)", r"'plain' is a function that is not comp.* @numba\.njit \(line 10\)"),
    ("fx[0] += calls(t)", r"'plain' is a function that is not comp.* @numba\.njit \(line 5\)"),
    ("return 1.0", r"it must not return anything: it adds to fx, fy and torque \(line 10\)"),
    ("return fx", "it must not return anything"),
    ("fx[0] += 'a'", r"Numba has no iadd\(float64, Literal\[str\]\(a\)\) \(line 10\)"),
    ("fx['a'] += 1.0", r"Numba has no getitem\(array\(float64, 1d, C\), .*\) \(line 10\)"),
    ("fx[0] += time.sleep(1)", r"Unknown attribute 'sleep' .* \(line 10\)"),
    ("yes = [] if t > 1 else 'a'", r"Cannot unify .*, defined at push\.py \(10\)")])
def test_what_numba_cannot_compile_is_told_in_one_line_with_its_place(tmp_path, line, words):
    source = ("import time\nfrom numba import njit\nplain = lambda a: a\n@njit\n"
              f"def calls(a): return plain(a)\n{DRIVE.lstrip()}    if t > 1.0:\n        {line}\n")
    with pytest.raises(InputError, match=words) as caught:
        Simulation(driven(tmp_path, source))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("lines", "words"), [
    (("print(t)", "print('a')", "show(t)"), "print"),
    (("fx[0] += np.random.random()", "fx[0] += random.random()"), "use random numbers"),
    ([f"{name}[0] += 1.0" for name in
      ("p", "x", "y", "angle", "vx", "vy", "omega", "family", "forward")], "write into"),
    (("x[:] = 0.0", "x += 1.0", "x.fill(0.0)", "x.sort()", "np.sin(x, x)", "write(p)",
      "other = p; other[0] = 1.0", "other = x[1:]; other[0] = 1.0"), "write into"),
    (("vx.flat[6] = 1.0", "family.flat[0] = 5.0", "for a in np.nditer(x): a[()] = 1.0",
      "np.dot(np.zeros((x.size, x.size)), x, vx)"), "use")])
def test_a_drive_that_a_run_cannot_bear_is_refused_before_it_runs(tmp_path, lines, words):
    """What it wrote elsewhere would be in no checkpoint, and what prints would do so for ever."""
    helpers = ("import random\nimport numpy as np\nfrom numba import njit\n@njit\n"
               "def show(a):\n    print(a)\n@njit\ndef write(a):\n    a[0] = 1.0\n")
    for line in lines:
        scene = driven(tmp_path, f"{helpers}{DRIVE}    if t > 1.0:\n        {line}\n")
        with pytest.raises(InputError, match=f"drive.function: .* must not {words}") as caught:
            tbsa.run(scene, tmp_path / "run")
        assert len(str(caught.value).splitlines()) == 1, line
        assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("line", "name"), [
    ("fx = fx + p[0] * family", "fx"), ("fy: float = 0.1", "fy"), ("vx, torque = x, y", "torque"),
    ("for fx in x: fx += p[0]", "fx"), ("if t > 1.0:\n        fx, fy = x, y", "fx")])
def test_a_drive_whose_forces_would_be_lost_is_refused(tmp_path, line, name):
    """Python's arguments are names: what is bound to one is not seen by who has called."""
    scene = driven(tmp_path, f"{DRIVE}    {line}\n")
    with pytest.raises(InputError, match=rf"must add to {name}, as by .*\(line [56]\)"):
        tbsa.run(scene, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_drive_may_add_to_whole_arrays_and_use_names_of_its_own(tmp_path):
    head = DRIVE.partition("    for")[0]
    scene = driven(tmp_path, f"{head}    f = lambda fx: 2.0 * fx\n    fx += f(p[0])\n"
                             "    fy -= p[0] * family\n    torque[:] = 0.0\n")
    s = Simulation(scene)
    fx, fy = np.zeros((2, 31))
    s.engine(0.0, s.parameters, *np.zeros((6, 31)), np.ones(31), np.zeros(31), fx, fy,
             np.zeros(31))
    assert fx == pytest.approx(0.2)
    assert fy == pytest.approx(-0.1)


@pytest.mark.parametrize("body", [
    "a.flat[0] += 1.0", "for b in np.nditer(a): b[()] = 1.0", "deeper(a)",
    "np.fill_diagonal(np.expand_dims(a, 0), 1.0)"])
@pytest.mark.parametrize("option", [pytest.param("", marks=pytest.mark.slow), "(cache=True)"])
def test_a_drives_helper_may_not_write_either(tmp_path, body, option):
    helpers = (f"import numpy as np\nfrom numba import njit\n@njit{option}\ndef deeper(a):\n"
               f"    a.flat[0] += 1.0\n@njit{option}\ndef write(a):\n    {body}\n")
    scene = driven(tmp_path, f"{helpers}{DRIVE}    write(vx)\n")
    for _ in range(2):  # the second time from the helper's own cache, if it has one
        with pytest.raises(InputError, match=r"drive.function: .* must not use"):
            tbsa.run(scene, tmp_path / "run")
        assert not (tmp_path / "run").exists()


def test_a_drive_that_is_edited_while_it_is_compiled_is_no_run(tmp_path, monkeypatch):
    scene, make = driven(tmp_path, DRIVE), records.Simulation

    def late(*arguments, **options):
        simulation = make(*arguments, **options)
        (tmp_path / "push.py").write_text(DRIVE + "# edited\n")
        return simulation

    monkeypatch.setattr(records, "Simulation", late)
    with pytest.raises(InputError, match=r"drive\.module: was changed while it was compiled"):
        tbsa.run(scene, tmp_path / "run")
    assert not (tmp_path / "run" / "run.json").exists()
    monkeypatch.setattr(records, "Simulation", make)
    assert tbsa.run(scene, tmp_path / "run").finished


def test_what_is_left_of_a_run_may_be_begun_again_from_its_own_folder(tmp_path, monkeypatch):
    scene, folder, write = driven(tmp_path, DRIVE), tmp_path / "run", records._write_arrays

    def killed(path, arrays):
        if path.name == "checkpoint.npz":
            raise KeyboardInterrupt
        write(path, arrays)

    monkeypatch.setattr(records, "_write_arrays", killed)
    with pytest.raises(KeyboardInterrupt):
        tbsa.run(scene, folder)
    assert (folder / "drive.py").exists()
    monkeypatch.setattr(records, "_write_arrays", write)
    assert tbsa.run(load(folder / "scene.toml"), folder).finished
    assert (folder / "drive.py").read_text() == DRIVE


def test_a_drive_that_is_gone_is_bad_input(tmp_path, monkeypatch):
    driven(tmp_path, DRIVE)
    monkeypatch.chdir(tmp_path)
    scene = load("scene.toml")
    scene.validate()
    monkeypatch.chdir("/")
    with pytest.raises(InputError, match=r"drive.module: 'push.py' cannot be read any more"):
        tbsa.run(scene, tmp_path / "run")


def test_a_forked_child_does_not_keep_its_parents_locks(tmp_path):
    """As a worker of a pool that outlives its parent."""
    read, write = os.pipe()
    with records.locked(tmp_path / "lock"):
        child = os.fork()
        if child == 0:  # waits until the lock has been tried
            os.close(write)
            os.read(read, 1)
            os._exit(0)
    try:
        with records.locked(tmp_path / "lock", wait=5.0) as alone:
            assert alone
    finally:
        os.close(write)
        os.waitpid(child, 0)
        os.close(read)


def test_a_drive_that_goes_back_to_python_is_told_so(tmp_path):
    back = "numba.objmode():\n            print(t)\n"
    for source in (f"import numba\n{DRIVE}    with {back}",
                   f"import numba\n@numba.njit\ndef show(t):\n    with {back}{DRIVE}    show(t)\n"):
        with pytest.raises(InputError, match=r"drive.function: .* must not go back to Python"):
            Simulation(driven(tmp_path, source))


def test_a_drive_may_use_whole_arrays_and_helpers_of_its_own(tmp_path):
    source = ("import numpy as np\nfrom numba import njit\n@njit\ndef add(a, b):\n"
              "    a += b\n" + DRIVE + "    add(fx, p[0] * np.sin(x))\n")
    for line in ("", "    fy[:] -= p[0] * y\n    torque += 1e-6 * np.hypot(vx, vy)\n",
                 "    fx.flat[2] = 0.1\n    fy += 1e-3 * np.dot(np.zeros((x.size, x.size)), x)\n"):
        Simulation(driven(tmp_path, source + line)).run(0.1)


def test_a_drive_need_not_be_called_py(tmp_path):
    scene = driven(tmp_path, DRIVE)
    (tmp_path / "push.py").rename(tmp_path / "push")
    scene = replace(scene, drive=replace(scene.drive, module="push"))
    assert Simulation(scene).parameters.tolist() == [0.1]


# ---------------------------------------------------------------------------------------------
# Killed before the first checkpoint.


def test_what_a_kill_before_the_first_checkpoint_leaves_is_no_obstacle(scene, whole, tmp_path):
    folder = tmp_path / "begun"
    folder.mkdir()
    (folder / "records.npy").touch()
    (folder / ".layout.npz.4711").write_bytes(b"half")
    shutil.copy(whole / "scene.toml", folder)
    records.run(scene, folder)
    assert same(folder, whole) == []
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        path.name for path in whole.iterdir())


def test_what_a_killed_process_was_writing_goes_when_the_run_goes_on(
        scene, whole, tmp_path, monkeypatch):
    """That of the run's own files, and only where nobody else can be writing them."""
    folder = tmp_path / "run"
    interrupted(scene, folder, 1.2, monkeypatch)
    own = [folder / f".{name}.4711" for name in records.REPLACED]
    others = [folder / name for name in (".metrics.csv.4711", ".run.json.swp", ".run.json.4711.png",
                                         ".4711", "run.json.4711", ".notes")]
    for path in (*own, *others):
        path.write_bytes(b"half")
    with pytest.raises(InputError, match=r"must stay 0\.5 s"):  # where it cannot, all stays
        records.run(replace(scene, record=Record(0.25, 1.0)), folder, resume=True)
    with monkeypatch.context() as patch:
        patch.setattr(records, "_flock", lambda _: None)
        assert not interrupted(scene, folder, 1.4, patch, resume=True).finished
    assert all(path.exists() for path in (*own, *others))
    assert records.run(scene, folder, resume=True).finished
    assert [path for path in own if path.exists()] == []
    assert all(path.read_bytes() == b"half" for path in others)
    assert same(folder, whole) == []


@pytest.mark.parametrize("name", ["notes.txt", ".notes.txt.12", "metrics.csv"])
def test_with_anything_else_beside_it_is_left_alone(scene, tmp_path, name):
    folder = tmp_path / "begun"
    folder.mkdir()
    (folder / "records.npy").touch()
    (folder / name).write_text("mine")
    with pytest.raises(InputError, match="must be a new or an empty folder"):
        records.run(scene, folder)
    assert (folder / name).read_text() == "mine"


def test_records_of_a_run_that_lost_its_run_json_are_left_alone(scene, whole):
    (whole / "run.json").unlink()
    before = (whole / "records.npy").read_bytes()
    with pytest.raises(InputError, match="must be a new or an empty folder"):
        records.run(scene, whole)
    assert (whole / "records.npy").read_bytes() == before


# ---------------------------------------------------------------------------------------------
# Writing a file.


@pytest.mark.parametrize("broken", ["open", "fsync", "replace"])
def test_a_file_that_cannot_be_written_stays_as_it_was(tmp_path, monkeypatch, broken):
    path = tmp_path / "table.csv"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    if broken == "open":
        class Full:
            """A file on a full disk."""

            def __init__(self, name, mode):
                self.file = open(name, mode)  # noqa: SIM115

            def __enter__(self):
                return self

            def __exit__(self, *_):
                self.file.close()

            write = fail

        monkeypatch.setattr(records, "open", Full, raising=False)
    else:
        monkeypatch.setattr(os, broken, fail)
    with pytest.raises(OSError, match="No space left"):
        records.write_atomically(path, b"new")
    monkeypatch.undo()
    assert path.read_bytes() == b"old"
    assert [each.name for each in tmp_path.iterdir()] == ["table.csv"]
    records.write_atomically(path, b"new")
    assert path.read_bytes() == b"new"


# ---------------------------------------------------------------------------------------------
# At full size.


@pytest.mark.slow
@pytest.mark.parametrize("name", ["self_stabilizing", "shaking"])
def test_the_papers_runs_killed_and_resumed_end_in_the_same_bits(name, tmp_path):
    """591 tiles, 60 s with a checkpoint every 20 s, killed after the first one."""
    source = load(ROOT / "paper_runs" / f"{name}.toml")
    config = tmp_path / "scene.toml"
    config.write_text(tbsa.dumps(replace(source, run=Run(60.0, 1), record=Record(10.0, 20.0))))
    scene, folder = load(config), tmp_path / "killed"
    child = subprocess.Popen([sys.executable, "-m", "tbsa.work.cli", "run", config, "--out", folder,
                              "--quiet"], cwd=ROOT)
    begin = time.monotonic()
    while child.poll() is None and time.monotonic() - begin < 600.0:
        info = folder / "run.json"
        if info.exists() and json.loads(info.read_text())["time"] >= 20.0:
            break
        time.sleep(0.1)
    child.kill()
    assert child.wait() == -signal.SIGKILL, "it ended before it was killed"
    assert records.run(scene, folder, resume=True).finished
    records.run(scene, tmp_path / "whole")
    assert same(folder, tmp_path / "whole") == []
    run = tbsa.read_run(folder)
    assert np.isfinite(run.x).all()
    assert np.hypot(run.x, run.y).max() < scene.reactor.radius
