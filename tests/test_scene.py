"""Scenes: what a TOML file may say, and how a wrong one is refused."""

from __future__ import annotations

import contextlib
import copy
import datetime
import os
import re
import tomllib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from malformed import GOOD, MALFORMED, TILE, TILES

from tbsa.errors import InputError
from tbsa.model.records import run
from tbsa.model.scene import (
    LARGEST,
    RULES,
    SETS,
    Drive,
    Floor,
    Free,
    Magnet,
    Material,
    PlacedTile,
    Reactor,
    Record,
    Run,
    Scene,
    Seed,
    Solver,
    TileType,
    dumps,
    fingerprint,
    load,
    parse,
)
from tbsa.model.simulation import Simulation

PAPER_RUNS = Path(__file__).parents[1] / "paper_runs"
ENGINE = "def push(t, p, *state):\n    raise RuntimeError('never run by the check')\n"


@pytest.mark.parametrize(("section", "name", "value"), [
    ("material", "friction", value) for value in (0.0, 0.05, 0.15, 0.25)] + [
    ("magnet", "alpha", value) for value in (7e-6, 3e-5, 5.4e-5)] + [
    ("solver", "substeps", value) for value in (1, 3, 7)])
def test_a_limit_that_is_told_may_be_typed(section, name, value):
    """In fewer digits than it has, it is rounded to the side that is allowed."""
    def with_it(step, frequency=0.0, damping=0.0):
        parts = {"material": {"linear_damping": damping}, "magnet": {}, "solver": {"step": step},
                 "record": {"interval": step, "checkpoint": step},
                 "drive": {"kind": "shaking", "force": 0.1, "frequency": frequency}}
        parts[section][name] = value
        return {**tomllib.loads(GOOD), **parts}

    def told(field, data):
        with pytest.raises(InputError, match="must be at most") as refused:
            parse(data)
        assert refused.value.field == field
        return float(re.search(r"at most ([^ ]+) ", str(refused.value)).group(1))

    step = told("solver.step", with_it(0.05))
    assert parse(with_it(step)).solver.step == step
    frequency = told("drive.frequency", with_it(step, 1e4))
    damping = told("material.linear_damping", with_it(step, damping=100.0))
    parse(with_it(step, frequency, damping))


@pytest.mark.parametrize(("text", "name", "fragment"), [row[1:] for row in MALFORMED],
                         ids=[row[0] for row in MALFORMED])
def test_a_malformed_scene_is_refused_with_one_sentence(tmp_path, text, name, fragment):
    file = tmp_path / "bad.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: {name}" if name else f"{file}: ")
    assert fragment in message
    assert caught.value.field == (name or None)
    assert "\n" not in message


def test_the_table_of_malformed_scenes_differs_from_good_ones_only_in_the_error():
    parse(GOOD)
    assert len({row[0] for row in MALFORMED}) == len(MALFORMED) >= 50


def refused(path):
    with pytest.raises(InputError) as caught:
        load(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    assert "No such file" in refused(tmp_path / "missing.toml")
    assert "directory" in refused(tmp_path)
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'title = "f\xfcr"\n')
    assert "UTF-8: invalid start byte at byte 10" in refused(latin)
    with pytest.raises(InputError, match=r"a\\x00b\.toml: must be .*: embedded null byte"):
        load("a\0b.toml")
    endless = tmp_path / "endless.toml"
    with open(endless, "wb") as file:
        file.truncate(2 * LARGEST)
    assert refused(endless).endswith(f"must be a TOML file of at most {LARGEST} bytes")


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path):
    file = tmp_path / "windows.toml"
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert replace(load(file), file="") == parse(GOOD)


FULL = tomllib.loads(
    'title = "t"\n' + TILES + '[seed]\nshape = "cross"\narm = 1\ntypes = ["black", "white"]\n'
    "centre = [0.0, 0.0]\nangle = 0.0\n[reactor]\nshape = 'circle'\nradius = 0.6\nfriction = 0.1\n"
    "[free]\ncounts = {black = 1, white = 1}\n[[free.tile]]\ntype = 'black'\n"
    "position = [0.2, 0.0]\nangle = 0.0\nvelocity = [0.0, 0.0]\nspin = 0.0\nheld = true\n"
    "[magnet]\nalpha = 1e-5\nmismatch = 0\n[drive]\nkind = 'unicycle'\nforce = 0.1\n"
    "frequency = 0.1\n[floor]\nlaw = 'separate'\nangular = 0.25\n[solver]\nstep = 0.01\n"
    "substeps = 4\n[record]\ninterval = 1.0\n[run]\nseed = 1\nduration = 2.0\n"
    "[material]\nwidth = 0.03\n") | {"temperature": 2}
CELLS = {**FULL, "seed": {"shape": "cells", "cells": [[0, 0, "black"], [1, 0, "white"]]},
         "tiles": {"type": [{"name": n, "glues": [1, 2, 3, 4], "colour": n, "forward": "N"}
                            for n in ("black", "white")]}}


def leaves(table, path=()):
    """Every place in nested tables and arrays."""
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from leaves(value, (*path, key))


junk = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3),
    st.sampled_from([10**400, -10**400, "none", "cells", "L", "user", "\0", "\ud800", b"", {}, [],
                     [[]], [{}], [0, 0], [[0, 0, "black"]], {"black": 1}, {"": {}},
                     datetime.date(2022, 2, 25), 1e-5, 1e-300, 1e300]))


@given(st.sampled_from([(base, path) for base in (FULL, CELLS) for path in leaves(base)]), junk)
@settings(deadline=None, max_examples=600)
def test_whatever_stands_in_a_place_the_scene_is_good_or_refused(place, value):
    base, path = place
    data = copy.deepcopy(base)
    table = data
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    scene = None
    with contextlib.suppress(InputError):  # nothing else may be raised
        scene = parse(data, "scene.toml")
    if scene is not None:
        assert replace(parse(dumps(scene)), file=scene.file) == scene


def test_the_scenes_that_are_spoilt_above_are_good():
    assert len(parse(FULL).seed.cells) == 5
    assert len(parse(CELLS).types) == 2


# --- what is not written takes its default ---------------------------------------------------


def test_all_that_is_left_out_takes_the_default_of_its_dataclass():
    scene = parse(GOOD)
    assert scene == Scene(SETS["chessboard"], free=Free((), (PlacedTile("black", (0.0, 0.0)),)))
    assert (scene.seed, scene.reactor, scene.magnet, scene.drive, scene.floor) == (None,) * 5


def test_the_defaults_are_table_1_of_the_paper_in_si_units():
    body, floor = Material(), Floor()
    assert (body.width, body.mass) == (0.03, 0.016)
    assert (body.friction, body.restitution) == (0.25, 0.2)
    assert (body.linear_damping, body.angular_damping) == (0.8, 0.5)
    assert (floor.linear, floor.angular) == (0.25, 0.25)


def test_an_empty_table_means_the_part_is_there_with_its_defaults():
    scene = parse(GOOD + "[magnet]\n[floor]\n[material]\n[solver]\n[record]\n[run]\n")
    assert (scene.magnet, scene.floor) == (Magnet(), Floor())
    assert (scene.material, scene.solver, scene.record, scene.run) == (
        Material(), Solver(), Record(), Run())


def test_a_part_of_kind_none_is_not_there():
    none = '[reactor]\nshape = "none"\n[drive]\nkind = "none"\n[floor]\nlaw = "none"\n'
    assert parse(GOOD + none) == parse(GOOD)


def test_every_field_has_a_rule():
    for cls, rules in RULES.items():
        assert [f.name for f in fields(cls)] == list(rules)


# --- what is written is what is there ----------------------------------------------------------


def test_integers_stand_for_numbers_and_arrays_for_tuples():
    scene = parse(TILES + "[[free.tile]]\ntype = 'white'\nposition = [1, 0]\nspin = 2\n")
    tile = scene.free.tiles[0]
    assert tile == PlacedTile("white", (1.0, 0.0), spin=2.0)
    assert [type(value) for value in (*tile.position, tile.spin)] == [float] * 3


def test_a_cross_has_four_arms_of_alternating_types_and_one_centre():
    seed = parse(TILES + '[seed]\nshape = "cross"\narm = 10\n').seed
    cells = {(column, row): name for column, row, name in seed.cells}
    assert len(seed.cells) == len(cells) == 41
    assert set(cells) == {(k, 0) for k in range(-10, 11)} | {(0, k) for k in range(-10, 11)}
    assert all(name == ("black", "white")[(c + r) % 2] for (c, r), name in cells.items())


def test_an_l_has_a_corner_and_arms_along_x_and_y():
    text = '[seed]\nshape = "L"\narm = 2\ntypes = ["white", "black"]\ncentre = [1, 0]\nangle = 1\n'
    assert parse(TILES + text).seed == Seed(
        ((0, 0, "white"), (1, 0, "black"), (2, 0, "white"), (0, 1, "black"), (0, 2, "white")),
        (1.0, 0.0), 1.0)


def test_a_set_of_one_type_gives_a_seed_of_that_type():
    text = "[[tiles.type]]\nname = 'a'\nglues = [1, 1, -1, -1]\ncolour = 'red'\n"
    scene = parse(text + '[seed]\nshape = "L"\narm = 1\n')
    assert [name for _, _, name in scene.seed.cells] == ["a"] * 3


def test_a_number_of_free_tiles_is_shared_equally_by_the_types():
    reactor = '[reactor]\nshape = "rectangle"\nwidth = 1\nheight = 2\n'
    scene = parse(TILES + reactor + "[free]\nnumber = 10\n")
    assert scene.free.counts == (("black", 5), ("white", 5))
    assert scene.reactor == Reactor("rectangle", width=1.0, height=2.0)


def test_each_drive_keeps_its_own_fields():
    def drive(text):
        return parse(GOOD + "[drive]\n" + text).drive

    assert drive('kind = "unicycle"\nforce = 1\nfrequency = 0.1\ntorque = 2\n') == Drive(
        "unicycle", 1.0, 2.0, 0.1)
    assert drive('kind = "shaking"\nforce = 1\nfrequency = 0.3\n') == Drive(
        "shaking", 1.0, 0.0, 0.3)
    assert drive('kind = "constant"\nforce = [1, -2]\n') == Drive("constant", (1.0, -2.0))


def test_tiles_may_touch_each_other_the_seed_and_the_wall():
    scene = parse(TILES + '[seed]\nshape = "L"\narm = 1\n'
                  '[reactor]\nshape = "rectangle"\nwidth = 0.09\nheight = 0.09\n'
                  '[[free.tile]]\ntype = "black"\nposition = [0.03, 0.03]\n'
                  '[[free.tile]]\ntype = "white"\nposition = [-0.03, 0.03]\n')
    assert len(scene.free.tiles) == 2


def test_overlap_is_allowed_up_to_a_millionth_of_the_width_for_rounding():
    def beside(x):
        return parse(GOOD + f'[[free.tile]]\ntype = "white"\nposition = [{x}, 0.0]\n')

    beside(0.03 - 2e-8)
    with pytest.raises(InputError, match="must not overlap"):
        beside(0.03 - 4e-8)


# --- the paper's own runs --------------------------------------------------------------------


@pytest.mark.parametrize("name", ["self_stabilizing", "shaking"])
def test_the_paper_runs_have_41_seed_tiles_and_550_free_ones(name):
    scene = load(PAPER_RUNS / f"{name}.toml")
    assert len(scene.seed.cells) == 41
    assert dict(scene.free.counts) == {"black": 275, "white": 275}
    assert scene.reactor == Reactor("circle", radius=0.6)
    assert (scene.magnet, scene.floor) == (Magnet(), Floor())
    assert scene.solver == Solver(1 / 120, 12, tolerance=0.02, passes=80, at_rest=0.025)
    assert (scene.run.duration, scene.record.interval) == (3600.0, 10.0)


def test_the_paper_runs_differ_in_drive_and_title_only():
    one, other = (load(PAPER_RUNS / f"{name}.toml") for name in ("self_stabilizing", "shaking"))
    assert replace(one, drive=None, title="", file="") == replace(
        other, drive=None, title="", file="")
    assert (one.drive.frequency, other.drive.frequency) == (0.1, 0.33)
    assert one.drive.force == other.drive.force


# --- taken over from the command line ----------------------------------------------------------


def test_seed_and_duration_given_to_load_win_over_the_file():
    path = PAPER_RUNS / "shaking.toml"
    assert load(path, seed=7, duration=12.0).run == Run(12.0, 7)
    assert load(path, seed=0).run == Run(3600.0, 0)
    with pytest.raises(InputError, match=r"run.seed: -1 must be an integer from 0"):
        load(path, seed=-1)


def test_numbers_of_numpy_will_do_for_load():
    path = PAPER_RUNS / "shaking.toml"
    for seed in (np.int64(7), np.uint8(7)):
        for duration in (np.int64(12), np.float32(12.0), np.float64(12.0)):
            run = load(path, seed=seed, duration=duration).run
            assert run == Run(12.0, 7)
            assert (type(run.seed), type(run.duration)) in ((int, float), (int, int))
    with pytest.raises(InputError, match=r"run.seed: -1 must be an integer from 0"):
        load(path, seed=np.int64(-1))


@pytest.mark.parametrize("change", [
    {"run": Run(1.0, np.int64(3))}, {"material": Material(mass=np.float32(0.016))},
    {"solver": Solver(keep_lists=np.True_)}, {"magnet": Magnet(mismatch=np.int64(0))},
    {"seed": Seed(((np.int64(0), 0, "black"),))},
    {"types": (TileType("black", (np.int64(1), 0, 0, 0), "black"), SETS["chessboard"][1])}])
def test_a_number_is_not_said_to_have_to_be_what_it_is(change):
    with pytest.raises(InputError, match=r"must be .*, of Python's own type, not NumPy's$"):
        replace(parse(GOOD), **change).validate()
    with pytest.raises(InputError, match=r"free.number: .* of Python's own type, not NumPy's$"):
        parse({"tiles": {"set": "chessboard"}, "free": {"number": np.int64(4)}})


def test_the_name_of_a_file_is_no_scene(tmp_path):
    for start in (Simulation, lambda scene: run(scene, tmp_path / "run")):
        for name in ("scene.toml", Path("scene.toml"), None):
            with pytest.raises(TypeError, match=r"must be a Scene, not \w+: tbsa\.load reads one"):
                start(name)
    assert list(tmp_path.iterdir()) == []


# --- a scene built in Python keeps to the same rules ---------------------------------------------


def test_a_scene_built_in_python_is_held_to_the_same_rules():
    scene = parse(GOOD)
    for wrong, field in (
            (replace(scene, material=Material(width=-1.0)), "material.width"),
            (replace(scene, types=()), "tiles.type"),
            (replace(scene, drive=Drive("shaking", 0.1, torque=0.1, frequency=1.0)),
             "drive.torque"),
            (replace(scene, drive=Drive("shaking", 0.1, frequency=1.0, parameters=np.ones(2))),
             "drive.parameters"),
            (replace(scene, drive=Drive("constant", 0.1)), "drive.force"),
            (replace(scene, reactor=Reactor("circle", 0.6, width=1.0)), "reactor.width"),
            (replace(scene, floor=Floor("exact", angular=0.1)), "floor.angular"),
            (replace(scene, seed=Seed(())), "seed.cells"),
            (replace(scene, seed=Seed([(1, 1, "black")])), "seed.cells"),
            (replace(scene, title="\ud800"), "title"),
            (replace(scene, reactor=Reactor("circle", 0.6),
                     free=Free((("black", 1), ("black", 1)))), "free.counts")):
        with pytest.raises(InputError) as caught:
            wrong.validate()
        assert caught.value.field == field
        assert caught.value.file is None


def test_a_scene_changed_in_python_is_validated_before_it_is_run(tmp_path):
    scene = parse(GOOD)
    for change, field in (({"material": Material(mass=-0.016)}, "material.mass"),
                          ({"drive": Drive("shakin", 0.1)}, "drive.kind"),
                          ({"floor": Floor(linear=np.float32(0.25))}, "floor.linear"),
                          ({"run": Run(1.0, np.int64(3))}, "run.seed"),
                          ({"run": Run(-1.0)}, "run.duration")):
        for start in (Simulation, lambda wrong: run(wrong, tmp_path / "run")):
            with pytest.raises(InputError) as caught:
                start(replace(scene, **change))
            assert caught.value.field == field
    assert not (tmp_path / "run").exists()
    heavier = replace(scene, material=Material(mass=np.float64(0.02)))
    assert Simulation(heavier).numbers.mass == 0.02


@pytest.mark.parametrize(("changes", "field", "words"), [
    ({"free": Free({"black": 3})}, "free.counts",
     "{'black': 3} must be a tuple of tuples (str, int)"),
    ({"free": Free((("black", 3, 4),))}, "free.counts[0]", "must be a tuple (str, int)"),
    ({"free": Free(tiles=("black",))}, "free.tiles[0]", "'black' must be a PlacedTile"),
    ({"free": None}, "free", "None must be a Free"),
    ({"material": None}, "material", "None must be a Material"),
    ({"drive": Floor()}, "drive", "must be a Drive or None"),
    ({"types": ({},)}, "types[0]", "{} must be a TileType"),
    ({"types": [TileType("a", (0, 0, 0, 0), "red")]}, "types", "must be a tuple of TileType"),
    ({"run": Run}, "run", "must be a Run"),
    ({"file": Path("scene.toml")}, "file", "must be a string"),
])
def test_parts_of_the_wrong_type_are_named(changes, field, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        replace(parse(GOOD), **changes).validate()
    assert caught.value.field == field


def test_a_scene_is_read_from_text_or_tables():
    with pytest.raises(InputError, match=r"source: b'x' must be TOML text \(str\), or a mapping"):
        parse(b"x")


# --- a drive of one's own ------------------------------------------------------------------------


def test_a_message_is_one_line_even_of_a_key_of_two(tmp_path):
    with pytest.raises(InputError, match=r"a\\nb: 1 is under an unknown key") as caught:
        parse('"a\\nb" = 1\n' + GOOD)
    assert len(str(caught.value).splitlines()) == 1


def test_names_of_types_that_are_allowed_are_told_in_their_own_letters():
    text = """seed = {shape = "cells", cells = [[0, 0, "vit"]]}
[[tiles.type]]
name = "vît"
glues = [1, 1, -1, -1]
colour = "white"
"""
    with pytest.raises(InputError, match='must be one of "vît"; did you mean "vît"'):
        parse(text)


def user(folder, source=ENGINE, function="push"):
    (folder / "engine.py").write_text(source, encoding="utf-8")
    file = folder / "scene.toml"
    file.write_text(GOOD + f'[drive]\nkind = "user"\nmodule = "engine.py"\n'
                    f'function = "{function}"\nparameters = [1, 2.5]\n', encoding="utf-8")
    return file


def test_the_module_of_a_drive_is_found_beside_the_scene_and_not_run(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    scene = load(user(tmp_path, ENGINE + "raise RuntimeError('run')\n"))
    assert scene.drive == Drive("user", module="engine.py", function="push",
                                parameters=(1.0, 2.5))


@pytest.mark.parametrize(("source", "function", "fragment"), [
    (ENGINE, "pusch", "'pusch' must be a function defined in drive.module: push; did you mean"),
    (ENGINE, "push()", "'push()' must be a function defined"),
    ("push = 3\n", "push", "it has none"),
    ("def push(:\n", "push", "'engine.py' must be a Python file"),
    ("\0", "push", "'engine.py' must be a Python file"),
    (ENGINE + "a = " + 20_000 * "-" + "1\n", "push", "must be a Python file: it is nested too"),
])
def test_a_drive_that_cannot_be_found_is_refused(tmp_path, source, function, fragment):
    assert fragment in refused(user(tmp_path, source, function))


@pytest.mark.parametrize("kind", ["pipe", "device", "endless", "folder"])
def test_a_drive_is_read_from_a_file_and_not_from_what_has_no_end(tmp_path, kind):
    file, module = user(tmp_path), tmp_path / "engine.py"
    module.unlink()
    if kind == "pipe":
        os.mkfifo(module)
    elif kind == "device":
        module.symlink_to("/dev/zero")
    elif kind == "folder":
        module.mkdir()
    else:
        with open(module, "wb") as endless:
            endless.truncate(2 * LARGEST)
    words = {"endless": f"it is longer than {LARGEST} bytes", "folder": "Is a directory"}
    assert refused(file).endswith("'engine.py' must be a Python file, its path relative to the "
                                  f"scene's file: {words.get(kind, 'it is a pipe or a device')}")


# --- writing -----------------------------------------------------------------------------------

names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8).filter(str.strip)
numbers = st.floats(-1.0, 1.0)
types = st.lists(
    st.builds(TileType, names, st.tuples(*[st.integers(-9, 9)] * 4), names,
              st.sampled_from([-1, 0, 1]), st.sampled_from("NESW")),
    min_size=2, max_size=4, unique_by=lambda tile_type: tile_type.name).map(tuple)
drives = st.one_of(
    st.none(),
    st.builds(Drive, st.just("unicycle"), st.floats(0, 9), numbers, st.floats(0, 9)),
    st.builds(Drive, st.just("shaking"), st.floats(0, 9), frequency=st.floats(0, 9)),
    st.builds(Drive, st.just("constant"), st.tuples(numbers, numbers), numbers))
floors = st.one_of(
    st.none(), st.builds(Floor, st.sampled_from(["coupled", "exact"]), st.floats(0, 9)),
    st.builds(Floor, angular=st.floats(0, 9),
              angular_reading=st.sampled_from(["engine", "uniform-pressure"])))


@st.composite
def scenes(draw):
    kinds = draw(types)
    first, second = kinds[0].name, kinds[1].name
    return Scene(
        kinds, draw(st.builds(Material, friction=st.floats(0, 10), restitution=st.floats(0, 1))),
        draw(st.sampled_from([None, Seed(((0, 0, first), (0, 1, second)), (0.1, -0.1), 0.3)])),
        draw(st.sampled_from([Reactor("circle", radius=0.5), Reactor("rectangle", 0.0, 2.0, 1.0)])),
        Free(tuple((kind.name, draw(st.integers(0, 5))) for kind in kinds[::-1]),
             (PlacedTile(first, (0.4, 0.1), draw(numbers), (draw(numbers), 0.1), draw(numbers)),
              PlacedTile(second, (0.4, 0.2), held=True))),
        draw(st.one_of(st.none(), st.builds(Magnet, alpha=st.floats(1e-300, 1e-5)))),
        draw(drives), draw(floors), run=Run(draw(st.floats(1e-2, 1e9)),
                                            draw(st.integers(0, 2**63 - 1))),
        temperature=draw(st.integers(1, 4)), title=draw(st.text(st.characters(codec="utf-8"))))


@given(scenes())
@settings(deadline=None, max_examples=60)
def test_a_scene_that_is_written_reads_back_to_the_last_bit(scene):
    scene.validate()
    again = parse(dumps(scene))
    assert again == scene
    assert dumps(again) == dumps(scene)
    assert fingerprint(again) == fingerprint(scene)


def test_a_drive_of_ones_own_is_written_and_read_back(tmp_path):
    scene = load(user(tmp_path))
    assert parse(dumps(scene), scene.file) == scene


# --- the fingerprint ---------------------------------------------------------------------------


@pytest.mark.parametrize("change", [
    {"title": "another"}, {"file": "another.toml"}, {"record": Record(1.0, 2.0)},
    {"run": Run(1.0, 1)}, {"temperature": 1}, {"solver": Solver(skip_still=False)},
    {"types": tuple(replace(kind, colour="red") for kind in SETS["chessboard"])},
])
def test_what_leaves_the_trajectory_alone_leaves_the_fingerprint_alone(change):
    scene = parse(GOOD)
    assert replace(scene, **change) != scene
    assert fingerprint(replace(scene, **change)) == fingerprint(scene)


@pytest.mark.parametrize("change", [
    {"run": Run(3600.0, 2)}, {"material": Material(mass=0.017)}, {"magnet": Magnet()},
    {"floor": Floor()}, {"solver": Solver(substeps=5)}, {"reactor": Reactor("circle", 0.6)},
    {"solver": Solver(at_rest=0.5)},
    {"types": SETS["chessboard-oriented"]}, {"drive": Drive("constant", (0.1, 0.0))},
    {"free": Free((), (PlacedTile("black", (0.0, 1e-9)),))},
    {"types": tuple(replace(kind, forward="E") for kind in SETS["chessboard"])},
])
def test_what_changes_the_trajectory_changes_the_fingerprint(change):
    scene = parse(GOOD)
    assert fingerprint(replace(scene, **change)) != fingerprint(scene)


def test_a_field_that_came_later_leaves_the_fingerprint_of_older_scenes_alone():
    """As it was before there was `at_rest`: runs of that time can be gone on with."""
    scene = Scene(SETS["chessboard"], Material(),
                  free=Free((), (PlacedTile("black", (0.0, 0.0)),)))
    assert fingerprint(scene)[:16] == "94f4819d252d8497"


def test_the_fingerprint_sees_what_is_in_the_module_of_a_drive_but_not_where_it_is(tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    first = fingerprint(load(user(here)))
    assert fingerprint(load(user(there))) == first
    assert fingerprint(load(user(there, ENGINE + "# and more\n"))) != first


def test_integers_in_a_scene_built_in_python_do_not_change_the_fingerprint():
    scene = Scene(SETS["chessboard"], Material(width=1, mass=1),
                  free=Free((), (PlacedTile("black", (0, 0)),)))
    assert fingerprint(scene) == fingerprint(parse(
        TILES + TILE + "[material]\nwidth = 1.0\nmass = 1.0\n"))


def test_a_name_that_numpy_has_chosen_is_text():
    """As in all other fields; it was refused, with itself as what might be meant."""
    drive = Drive("constant", force=(1.0, 0.0))
    plain, named = (Scene(SETS["chessboard"], free=Free((("black", 1),)),
                          reactor=Reactor("circle", radius=0.2), drive=each)
                    for each in (drive, replace(drive, kind=np.str_("constant"))))
    named.validate()
    assert dumps(named) == dumps(plain)
    assert fingerprint(named) == fingerprint(plain)
