"""A campaign's file: many scenes and seeds, read and validated before anything runs.

    title = "..."
    scene = "shaking.toml"           # or an array; relative to this file
    seeds = {first = 1, number = 36} # or an array, or {stream = "name", number = 36}
    set = {"run.duration" = 300.0}   # fields of the scene, by dotted name

    [[group]]
    name = "force"
    grid = {"drive.force" = [0.06, 0.09], "drive.frequency" = [0.1, 0.3]}  # every combination
    list = {"reactor.radius" = [0.6, 0.8], "free.number" = [550, 980]}     # taken together

``scene``, ``seeds`` and ``set`` at the top hold for every group that does not have its own; of
``set`` the group's fields come on top.  A group's runs are its scenes, times the entries of its
list, times its grid, times its seeds.  A field is set once, and not beside a part of it; a part of
the scene (``drive``) is set field by field.
"""

from __future__ import annotations

import copy
import hashlib
import itertools
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tbsa.errors import InputError
from tbsa.model.scene import (
    KINDS,
    RULES,
    SETS,
    Record,
    Run,
    Scene,
    canonical,
    fingerprint,
    parse,
    read_toml,
    tile_count,
)

LARGEST = 100_000  # runs of a campaign
SHARED = ("scene", "seeds", "set")
GROUP = ("name", *SHARED, "grid", "list")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
FIELD = re.compile(r"([^.\[\]]+)((?:\[\d{1,9}\])*)")
PARTS = {"Reactor": "reactor", "Drive": "drive", "Floor": "floor"}
# Fields that stand for one another: setting one drops the others from the base scene.
INSTEAD = {"tiles.set": ("type",), "tiles.type": ("set",), "free.number": ("counts",),
           "free.counts": ("number",), "seed.cells": ("arm", "types"), "seed.arm": ("cells",)}
PARTS_OF_A_SCENE = {  # by name: one of its fields
    "tiles": "tiles.set", "seed": "seed.arm", "free": "free.number", "run": "run.duration",
    "record": "record.interval", "drive": "drive.force", "reactor": "reactor.radius",
    "magnet": "magnet.alpha", "floor": "floor.linear", "material": "material.mass",
    "solver": "solver.substeps"}
Fields = dict[str, Any]


@dataclass(frozen=True)
class Planned:
    """One run of a campaign."""

    group: str
    base: str  # the base scene, as the file names it
    fields: tuple[tuple[str, Any], ...]  # what the file sets, by dotted name
    scene: Scene

    @cached_property
    def mark(self) -> str:
        """The fingerprint: a hash of all that the motion depends on, the same on every host."""
        return fingerprint(self.scene)

    @property
    def name(self) -> str:
        """Where the run is, below the folder ``runs``."""
        return f"{self.group}/{self.scene.run.seed}-{self.mark[:12]}"

    @property
    def kept(self) -> str:
        """A hash of all that may not change while the run's folder is there.

        Free to change are the title, the checkpoints, and the duration, which may grow.
        """
        return _digest(self.mark, self.scene)

    @cached_property
    def settings(self) -> str:
        """As `kept`, for whatever seed: the same for runs that are samples of one thing."""
        scene = replace(self.scene, run=replace(self.scene.run, seed=1))
        return _digest(fingerprint(scene), scene)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return tile_count(self.scene)

    @property
    def cost(self) -> float:
        """What the run takes, in tiles times substeps."""
        solver = self.scene.solver
        return self.tiles * self.scene.run.duration / solver.step * solver.substeps


def _digest(mark: str, scene: Scene) -> str:
    """A hash of the fingerprint, colours, temperature and interval of records."""
    bare = replace(scene, title="", run=replace(scene.run, duration=1.0),
                   record=Record(scene.record.interval, scene.record.interval))
    return hashlib.sha256(mark.encode() + b" " + canonical(bare)).hexdigest()[:16]


def seeds_of(stream: str, number: int) -> list[int]:
    """The first seeds of a named stream.

    Streams of different names have nothing in common, and a longer stream begins as a shorter.
    """
    key = np.frombuffer(hashlib.sha256(stream.encode()).digest(), "<u4").tolist()
    parent = np.random.SeedSequence(key)
    return [int(child.generate_state(1, np.uint64)[0] >> np.uint64(1))
            for child in parent.spawn(number)]


def read_plan(path: str | Path) -> list[Planned]:
    """Every run of a campaign's file, in its order, each with its scene validated.

    Raises
    ------
    InputError
        When the file, a scene that it names, or a value that it sets is not allowed.
    """
    try:
        return _Reader(Path(path)).runs()
    except RecursionError:
        raise InputError("is nested too deeply", file=str(path)) from None


def changed(path: str | Path, settings: Sequence[str]) -> Scene:
    """The scene of a file with some fields set, as ``tbsa run --set drive.force=0.06`` does.

    Parameters
    ----------
    path
        The scene's file.
    settings
        ``NAME=VALUE`` each: the dotted name of a field, and its value as in TOML; a word that is
        no value in TOML is a string.

    Raises
    ------
    InputError
        Where a setting is not of this form, names no field, or gives a value that is not allowed.
    """
    tables, fields = read_toml(path), {}
    for text in settings:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not sign or not all(FIELD.fullmatch(part) for part in name.split(".")):
            raise InputError("must be NAME=VALUE with the dotted name of a field of the scene, "
                             "such as drive.force=0.06", field="--set", value=text)
        if name in fields:
            raise InputError("must be set once", field=f"--set {name}", value=value)
        try:
            found = tomllib.loads(f"value = {value}")
        except (ValueError, RecursionError):
            found = {"value": value}
        if len(found) > 1:
            raise InputError("must be one value", field=f"--set {name}", value=value)
        fields[name] = found["value"]

    def fail(name: str) -> NoReturn:
        raise InputError(f"cannot be set: {path} has no place for it", field=f"--set {name}",
                         value=fields[name])

    _set(tables, fields, fail)
    try:
        return parse(tables, str(path))
    except RecursionError:
        raise InputError("is nested too deeply", file=str(path)) from None
    except InputError as error:
        raise error.of(f"{path}, changed by --set") from None


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path, self.file = path, str(path)
        self.bases: dict[str, dict[str, Any]] = {}

    def fail(self, field: str, message: str, *value: Any) -> NoReturn:
        if value:
            raise InputError(message, file=self.file, field=field, value=value[0])
        raise InputError(message, file=self.file, field=field)

    def runs(self) -> list[Planned]:
        data = read_toml(self.path)
        self.keys("", data, ("title", *SHARED, "group"))
        if not isinstance(data.get("title", ""), str):
            self.fail("title", "must be a string", data["title"])
        groups = data.get("group")
        if groups is None:
            self.fail("group", "is missing; must be at least one [[group]]")
        if not isinstance(groups, list) or not groups:
            self.fail("group", "must be an array of tables, at least one [[group]]", groups)
        plan: list[Planned] = []
        names: set[str] = set()
        for i, group in enumerate(groups):
            where = f"group[{i}]"
            if not isinstance(group, Mapping):
                self.fail(where, "must be a table", group)
            self.keys(where, group, GROUP)
            if "name" not in group:
                self.fail(f"{where}.name", "is missing; must be a name for the group's folder")
            name = group["name"]
            if not isinstance(name, str) or not NAME.fullmatch(name):
                self.fail(f"{where}.name", "must be 1 to 64 letters, digits, _ . -, the first a "
                          "letter or digit: it is a folder's name", name)
            if name.lower() in names:
                self.fail(f"{where}.name", "must be the only group of that name", name)
            names.add(name.lower())
            plan += self.group(where, name, data, group, LARGEST - len(plan))
        return plan

    def keys(self, where: str, table: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
        for key in table:
            if key not in allowed:
                self.fail(f"{where}.{key}" if where else key,
                          f"is under an unknown key; allowed here: {', '.join(allowed)}; fields of "
                          "the scene go into set, grid or list", table[key])

    def group(self, where: str, name: str, top: Mapping[str, Any], group: Mapping[str, Any],
              room: int) -> list[Planned]:
        def at(key: str) -> str:
            return f"{where}.{key}" if key in group else key

        shared = {**{key: top[key] for key in SHARED if key in top}, **group}
        for key in ("scene", "seeds"):
            if key not in shared:
                self.fail(f"{where}.{key}", f"is missing, here and at the top of the file; "
                          f"{SCENES if key == 'scene' else SEEDS}")
        scenes = self.scenes(at("scene"), shared["scene"])
        seeds = self.seeds(at("seeds"), shared["seeds"])
        home: dict[str, str] = {}  # of every field: where the file sets it
        fixed = self.fields("set", top.get("set", {}), home)
        own: dict[str, str] = {}
        group_fields = self.fields(f"{where}.set", group.get("set", {}), own)
        fixed |= group_fields
        grid = self.arrays(f"{where}.grid", group.get("grid", {}), own)
        rows = self.arrays(f"{where}.list", group.get("list", {}), own)
        lengths = {key: len(values) for key, values in rows.items()}
        if len(set(lengths.values())) > 1:
            self.fail(f"{where}.list", "must be arrays of one length, taken together; they have "
                      + ", ".join(f"{key} {length}" for key, length in lengths.items()))
        given = group_fields | grid | rows
        for field, place in own.items():
            self.once(place, field, given[field],
                      {other: there for other, there in home.items() if other != field})
        for key in ("run.seed", "title"):
            if key in home | own:
                self.fail((home | own)[key], "must be left out: " + (
                    "the seeds of a group are its seeds" if key == "run.seed"
                    else "the runs of a campaign keep their scene's"))
        number = len(scenes) * len(seeds) * max([1, *lengths.values()])
        for values in grid.values():
            number *= len(values)
        if number > room:
            self.fail(where, f"runs; a campaign must have at most {LARGEST}", number)

        plan: list[Planned] = []
        known: dict[str, str] = {}
        for base in scenes:
            for listed, combined in itertools.product(_zipped(rows), _products(grid)):
                fields = fixed | listed | combined
                scene = self.scene(where, base, fields, home | own)
                for seed in seeds:
                    planned = Planned(name, base, tuple(fields.items()),
                                      replace(scene, run=Run(scene.run.duration, seed)))
                    words = ", ".join([base, *(f"{key} = {fields[key]!r}"
                                               for key in (*rows, *grid)), f"seed {seed}"])
                    if planned.mark in known:
                        self.fail(where, f"moves as another run of the group ({known[planned.mark]}"
                                  "); each must differ in its seed or its scene", words)
                    known[planned.mark] = words
                    plan.append(planned)
        return plan

    def scenes(self, where: str, value: Any) -> list[str]:
        names = [value] if isinstance(value, str) else value
        if not isinstance(names, list) or not names or not all(
                isinstance(name, str) and name for name in names):
            self.fail(where, SCENES, value)
        for name in names:
            if names.count(name) > 1:
                self.fail(where, "must be named once", name)
            if name in self.bases:
                continue
            path, reason = self.path.parent / name, "there is none"
            try:
                found = path.is_file()
            except OSError as error:  # a name too long, a folder that may not be read
                found, reason = False, str(error.strerror)
            if not found:
                self.fail(where, "must be the file of a scene, its path relative to this file; "
                          f"{reason}", name)
            tables = read_toml(path)
            parse(tables, str(path))  # so that what is wrong with it is said of it
            self.bases[name] = tables
        return names

    def seeds(self, where: str, value: Any) -> list[int]:
        rule = RULES[Run]["seed"]
        if isinstance(value, Mapping) and set(value) in ({"first", "number"},
                                                         {"stream", "number"}):
            number = value["number"]
            if type(number) is not int or not 1 <= number <= LARGEST:
                self.fail(f"{where}.number", f"must be an integer from 1 to {LARGEST}", number)
            if "stream" in value:
                stream = value["stream"]
                if not isinstance(stream, str) or not stream.strip():
                    self.fail(f"{where}.stream", "must be a string that is not empty", stream)
                return seeds_of(stream, number)
            if message := rule(value["first"]):
                self.fail(f"{where}.first", message, value["first"])
            if message := rule(value["first"] + number - 1):
                self.fail(where, f"(first + number - 1) {message}",
                          value["first"] + number - 1)
            return list(range(value["first"], value["first"] + number))
        if not isinstance(value, list) or not value:
            self.fail(where, SEEDS, value)
        if len(value) > LARGEST:
            self.fail(where, f"must have at most {LARGEST} seeds", len(value))
        there = set()
        for i, seed in enumerate(value):
            if message := rule(seed):
                self.fail(f"{where}[{i}]", message, seed)
            if seed in there:
                self.fail(f"{where}[{i}]", "must be there once", seed)
            there.add(seed)
        return value

    def fields(self, where: str, table: Any, home: dict[str, str]) -> Fields:
        """The fields that a table sets, by dotted name; `home` is told where each is."""
        found: Fields = {}
        if not isinstance(table, Mapping):
            self.fail(where, 'must be a table of fields of the scene, '
                      'such as {"drive.force" = 0.1}', table)
        for name, value in _flat(table):
            if not all(FIELD.fullmatch(part) for part in name.split(".")):
                self.fail(f"{where}.{name}", "must be under the dotted name of a field of the "
                          "scene, such as drive.force or tiles.type[0].family", value)
            if name in PARTS_OF_A_SCENE:
                self.fail(f"{where}.{name}", "is a whole part of the scene: name its fields one by "
                          f"one, such as {PARTS_OF_A_SCENE[name]}", value)
            self.once(f"{where}.{name}", name, value,
                      home | {other: f"{where}.{other}" for other in found})
            found[name] = value
        home |= {name: f"{where}.{name}" for name in found}
        return found

    def once(self, where: str, name: str, value: Any, home: Mapping[str, str]) -> None:
        """A field that is set; `home`: where others are, that may be neither it nor in it."""
        for other, place in home.items():
            if _within(name, other) or _within(other, name):
                also = "" if place == where else f" (also {place})"
                self.fail(where, f"must be set once{also}", value)

    def arrays(self, where: str, table: Any, home: dict[str, str]) -> Fields:
        found = self.fields(where, table, home)
        for name, values in found.items():
            if not isinstance(values, list) or not values:
                self.fail(f"{where}.{name}", "must be an array of at least one value", values)
        return found

    def scene(self, where: str, base: str, fields: Fields, home: Mapping[str, str]) -> Scene:
        """A base scene with its fields set, validated."""
        tables = copy.deepcopy(self.bases[base])
        _set(tables, fields, lambda name: self.fail(
            home[name], f"cannot be set: {base} has no place for it", fields[name]))
        try:
            return parse(tables, str(self.path.parent / base))
        except InputError as error:
            field = error.field or ""
            for name in fields:
                if field == name or field.startswith((f"{name}[", f"{name}.")):
                    of = "" if home[name].startswith(f"{where}.") else f", for {where}"
                    self.fail(home[name] + field.removeprefix(name),
                              f"{error.message} (in {base}{of})",
                              getattr(error, "value", fields[name]))
            self.fail(where, f"does not make a scene of {base}: {error.without_file}")


SCENES = "must be the path of a scene's file, or an array of them"
SEEDS = ('must be an array of integers, {first = 1, number = 36}, or '
         '{stream = "a name", number = 36}')


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values: {"drive.force" = 1} and {drive = {force = 1}} say the same.

    A table without entries is a value, and so is that of "free.counts" under this name; what is
    written as free.counts.black, with or without quotes, is that count alone.
    """
    for key, value in table.items():
        if isinstance(value, Mapping) and value and key != "free.counts":
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


def _products(grid: Fields) -> list[Fields]:
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def _zipped(rows: Fields) -> list[Fields]:
    return [dict(zip(rows, values, strict=True))
            for values in zip(*rows.values(), strict=True)] or [{}]


def _within(name: str, other: str) -> bool:
    """Whether a field is another or a part of it: "free.tile[0].angle" of "free.tile"."""
    steps, start = _steps(name), _steps(other)
    return steps[:len(start)] == start


def _set(tables: dict[str, Any], fields: Fields, fail: Callable[[str], NoReturn]) -> None:
    """Set fields of a scene's tables, in whatever order they were named; `fail`: one cannot be."""
    # The set of tiles first, whose types another field may change; a field before its parts.
    for name in sorted(fields, key=lambda name: (name != "tiles.set", len(_steps(name)))):
        try:
            _assign(tables, name, fields[name])
        except (LookupError, TypeError):
            fail(name)
    for name in fields:
        _drop(tables, name, fields)


def _steps(name: str) -> list[str | int]:
    """Keys and indices of a dotted name."""
    steps: list[str | int] = []
    for part in name.split("."):
        match = FIELD.fullmatch(part)
        assert match is not None
        steps += [match[1], *(int(i) for i in re.findall(r"\d+", match[2]))]
    return steps


def _assign(tables: dict[str, Any], name: str, value: Any) -> None:
    """Set a field of a scene's tables; tables that are not there are made, items are not."""
    steps, tiles = _steps(name), tables.get("tiles")
    place: Any = tables
    if name.startswith("tiles.type[") and isinstance(tiles, dict) and tiles.get("set") in SETS:
        tiles["type"] = [asdict(kind) | {"glues": list(kind.glues)}  # any of which may be set
                         for kind in SETS[tiles.pop("set")]]
    for step, following in itertools.pairwise(steps):
        if isinstance(step, str) and isinstance(following, str):
            if not isinstance(place, dict):
                raise TypeError
            place.setdefault(step, {})
        place = place[step]
    if isinstance(steps[-1], int):
        place[steps[-1]]  # there already
    elif not isinstance(place, dict):
        raise TypeError
    place[steps[-1]] = value


def _drop(tables: dict[str, Any], name: str, fields: Fields) -> None:
    """Leave out of a base scene what a field that was set makes meaningless."""
    part, _, key = name.partition(".")
    foreign: set[str] = set(INSTEAD.get(_top(name), ()))
    for cls, (kind, kinds) in KINDS.items():
        if (part, key) == (PARTS[cls.__name__], kind):
            own = kinds.get(fields[name], ()) if isinstance(fields[name], str) else ()
            foreign |= {each for names in kinds.values() for each in names} - set(own)
            if fields[name] == "none":
                foreign |= set(tables[part]) - {kind}
    table, given = tables.get(part), {_top(other) for other in fields}
    for each in foreign:
        if isinstance(table, dict) and f"{part}.{each}" not in given:
            table.pop(each, None)


def _top(name: str) -> str:
    """The part of a scene and its field: "free.counts" of "free.counts.black"."""
    return ".".join(name.partition("[")[0].split(".")[:2])
