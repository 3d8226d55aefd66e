"""A scene: everything that a run depends on, as frozen dataclasses.

A scene is read from TOML (:func:`load`) or built in Python; either way
:meth:`Scene.validate` passes before it is run.  SI units throughout.
Edges are in the order N, E, S, W; angles are counter-clockwise from +x; at angle 0 the
E edge of a tile faces +x and its N edge +y.

The file has three parts: the dataclasses, the rules that their values keep to, and TOML.
Reading only brings values into shape; every judgement of a value is a rule, so that a scene
built in Python is held to the same ones.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
import json
import math
import os
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NoReturn, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np

from tbsa.errors import InputError, at_most
from tbsa.model.squares import area, depth, inside, lattice, near

EDGES = ("N", "E", "S", "W")
EDGE_ANGLE = {"N": math.pi / 2, "E": 0.0, "S": -math.pi / 2, "W": math.pi}
"""From a tile's +x to each edge, rad."""


@dataclass(frozen=True)
class TileType:
    """One kind of tile: ``glues`` (N, E, S, W; 0 is no magnet, +g attracts -g)."""

    name: str
    glues: tuple[int, int, int, int]
    colour: str
    family: int = 1  # a_i and omega_i of the drive: +1, -1, or 0 for an undriven tile
    forward: str = "N"  # the edge that the drive pushes towards


@dataclass(frozen=True)
class Material:
    """The tile's body and its contacts: the paper's Table I."""

    width: float = 0.03  # m
    mass: float = 0.016  # kg
    friction: float = 0.25  # tile-tile
    restitution: float = 0.2  # tile-tile
    linear_damping: float = 0.8  # 1/s
    angular_damping: float = 0.5  # 1/s
    restitution_threshold: float = 0.01  # m/s; slower impacts are plastic


@dataclass(frozen=True)
class Seed:
    """Held tiles on a square lattice, cell (0, 0) at ``centre``, turned by ``angle``."""

    cells: tuple[tuple[int, int, str], ...]  # (column, row, tile type)
    centre: tuple[float, float] = (0.0, 0.0)  # m
    angle: float = 0.0  # rad


@dataclass(frozen=True)
class Reactor:
    """The wall: a circle of ``radius``, or a rectangle of ``width`` x ``height``, at the origin."""

    shape: str  # "circle" | "rectangle"
    radius: float = 0.0  # m
    width: float = 0.0  # m
    height: float = 0.0  # m
    friction: float = 0.25  # tile-wall
    restitution: float = 0.2  # tile-wall


@dataclass(frozen=True)
class PlacedTile:
    """One tile placed explicitly."""

    type: str
    position: tuple[float, float]  # m, of its centre
    angle: float = 0.0  # rad
    velocity: tuple[float, float] = (0.0, 0.0)  # m/s
    spin: float = 0.0  # rad/s
    held: bool = False  # never moves


@dataclass(frozen=True)
class Free:
    """The tiles beside the seed: ``counts`` placed at random, and ``tiles`` placed explicitly."""

    counts: tuple[tuple[str, int], ...] = ()  # (tile type, number) placed at random, no overlap
    tiles: tuple[PlacedTile, ...] = ()


@dataclass(frozen=True)
class Magnet:
    """F = alpha / (r + beta)^2 between magnets ``inset`` inside the edges, cut at ``cutoff``."""

    alpha: float = 1.8e-5  # N m^2
    beta: float = 6.4e-3  # m
    inset: float = 1.5e-3  # m inside each edge
    cutoff: float = 0.03  # m between magnets; no force beyond
    switch: float = 0.1  # the last fraction of the cut-off, over which the force fades out
    mismatch: int = -1  # p of two glues that do not attract: -1 repel, 0 no force


@dataclass(frozen=True)
class Drive:
    """The engine that moves the free tiles."""

    kind: str  # "unicycle" | "shaking" | "constant" | "user"
    force: float | tuple[float, float] = 0.0  # N; F_mag, or the vector of a constant load
    torque: float = 0.0  # N m; T_mag
    frequency: float = 0.0  # Hz
    module: str = ""  # user: a Python file, relative to the scene's file
    function: str = ""  # user: the engine's name in it
    parameters: tuple[float, ...] = ()  # user: handed to the engine


@dataclass(frozen=True)
class Floor:
    """Dry friction between tile and floor."""

    law: str = "separate"  # "separate" | "coupled" | "exact"
    linear: float = 0.25  # coefficient: force over weight
    angular: float = 0.25  # coefficient of the torque, see `floor_limits`; separate only
    angular_reading: str = "engine"  # "engine" | "uniform-pressure"; separate only
    gravity: float = 9.81  # m/s^2


@dataclass(frozen=True)
class Solver:
    """Time step and tolerances."""

    step: float = 1 / 480  # s: forces are found twice a step
    substeps: int = 4  # per step: contacts are solved once a substep
    tolerance: float = 1e-5  # m/s: a pass that changes no contact velocity by more ends the solve
    passes: int = 40  # at most, a substep
    at_rest: float = 1.0  # part of the tolerance for slow tiles; faster ones get half their speed
    keep_lists: bool = True  # of near pairs, while nobody comes too far; off: found every step
    skip_converged: bool = True  # rows that no longer change; off: every pass solves all
    join_substeps: bool = True  # up to eight, where a scene is calm; off: never longer ones
    skip_still: bool = True  # steps in which nothing changes any more; off: they are done


@dataclass(frozen=True)
class Record:
    """What is written, and when."""

    interval: float = 10.0  # s between records
    checkpoint: float = 100.0  # s between checkpoints, a whole number of intervals


@dataclass(frozen=True)
class Run:
    """How long, and from which seed of the random numbers."""

    duration: float = 3600.0  # s
    seed: int = 1


@dataclass(frozen=True)
class Scene:
    """A scene.  A part that is ``None`` is not there and costs nothing."""

    types: tuple[TileType, ...]
    material: Material = field(default_factory=Material)
    seed: Seed | None = None
    reactor: Reactor | None = None
    free: Free = field(default_factory=Free)
    magnet: Magnet | None = None
    drive: Drive | None = None
    floor: Floor | None = None
    solver: Solver = field(default_factory=Solver)
    record: Record = field(default_factory=Record)
    run: Run = field(default_factory=Run)
    temperature: int = 2  # of the abstract growth that gives the ground truth
    title: str = ""
    file: str = ""  # where it was read from

    def validate(self) -> None:
        """Check every value and how the values fit together.

        Raises
        ------
        InputError
            At the first value that is not allowed; it names file, field, value and what is.
        """
        self._valid  # noqa: B018  (looked for once, as tens of thousands of tiles take a second)

    @cached_property
    def _valid(self) -> bool:
        if not isinstance(self.file, str):  # any path: its bytes need be no UTF-8
            raise InputError("must be a string", field="file", value=self.file)
        _check_structure(self, "", self)
        for name, part in _parts(self):
            _check_part(self, name, part)
        _check_names(self)
        _check_magnet_and_tile(self)
        _check_times(self)
        _check_places(self)
        _check_growth(self)
        if self.drive is not None and self.drive.kind == "user":
            _check_engine(self)
        return True


SETS: dict[str, tuple[TileType, ...]] = {
    "chessboard": (
        TileType("black", (+1, +2, +1, +2), "black", +1),
        TileType("white", (-1, -2, -1, -2), "white", -1),
    ),
    "chessboard-oriented": (
        TileType("black", (+2, +2, -1, -1), "black", +1),
        TileType("white", (+1, +1, -2, -2), "white", -1),
    ),
}
"""The two readings of the paper's chessboard tile set; families move in opposite directions."""


# ---------------------------------------------------------------------------------------------
# Rules.  A rule says what is wrong with a value, or "" when nothing is.

Rule = Callable[[Any], str]
F = TypeVar("F", bound=Callable[..., Any])


def _number(
    low: float, high: float, unit: str = "", *, above: bool = False, below: bool = False
) -> Rule:
    """A number from `low` to `high`; `above`, `below`: the end itself is not allowed."""
    span = f"{'above' if above else 'from'} {low:g} {'to below' if below else 'to'} {high:g}"
    message = f"must be a number {span} {unit}".rstrip()

    def rule(value: Any) -> str:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return message
        fits = (low < value if above else low <= value) and (
            value < high if below else value <= high)  # false for NaN
        return "" if fits else message

    return rule


def _integer(low: int, high: int) -> Rule:
    message = f"must be an integer from {low} to {high}"

    def rule(value: Any) -> str:
        right = isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
        return "" if right else message

    return rule


def _one_of(*allowed: Any) -> Rule:
    names = ", ".join(json.dumps(name, ensure_ascii=False) for name in allowed)

    def rule(value: Any) -> str:
        # NumPy's text is Python's; of numbers, true is not 1.
        right = isinstance(value, str) or type(value) in {type(name) for name in allowed}
        if right and value in allowed:
            return ""
        return f"must be one of {names}{_suggestion(value, allowed)}"

    return rule


def _text(*, empty: bool = False) -> Rule:
    def rule(value: Any) -> str:
        if not isinstance(value, str) or not (value.strip() or empty):
            return "must be a string" if empty else "must be a string that is not empty"
        surrogate = any("\ud800" <= letter <= "\udfff" for letter in value)
        return "must be text that UTF-8 can hold" if surrogate else ""

    return rule


def _boolean(value: Any) -> str:
    return "" if isinstance(value, bool) else "must be true or false"


def _list(rule: Rule, length: int | None, what: str) -> Rule:
    """A tuple (in TOML an array) of `length` values; None for any length."""

    def check(value: Any) -> str:
        if not isinstance(value, tuple) or (length is not None and len(value) != length):
            return f"must be {what}"
        wrong = next((message for message in map(rule, value) if message), "")
        return wrong and f"must be {what}; each {wrong}"

    return check


_position = _list(_number(-1e4, 1e4, "m"), 2, "two numbers [x, y] in m")
_angle = _number(-2 * math.pi, 2 * math.pi, "rad")  # catches degrees
_friction = _number(0, 10)
_restitution = _number(0, 1)
_length = _number(1e-5, 1e4, "m")
LONGEST_RUN = 1e9  # s
_force = _number(0, 1e6, "N")
_any_force = _list(_number(-1e6, 1e6, "N"), 2, "two numbers [fx, fy] in N")
_LARGEST_INTEGER = 2**63 - 1

RULES: dict[type, dict[str, Rule]] = {
    TileType: {
        "name": _text(),
        "glues": _list(_integer(-1000, 1000), 4, "four integers, the glues of N, E, S, W"),
        "colour": _text(),
        "family": _one_of(-1, 0, 1),
        "forward": _one_of(*EDGES),
    },
    Material: {
        "width": _number(1e-5, 10, "m"),
        "mass": _number(1e-9, 1e4, "kg"),
        "friction": _friction,
        "restitution": _restitution,
        "linear_damping": _number(0, 1e6, "1/s"),
        "angular_damping": _number(0, 1e6, "1/s"),
        "restitution_threshold": _number(0, 1e3, "m/s"),
    },
    Seed: {
        "cells": lambda cells: "" if isinstance(cells, tuple) and cells
        else "must be an array of at least one cell [column, row, type]",
        "centre": _position,
        "angle": _angle,
    },
    Reactor: {
        "shape": _one_of("circle", "rectangle"),
        "radius": _length,
        "width": _length,
        "height": _length,
        "friction": _friction,
        "restitution": _restitution,
    },
    PlacedTile: {
        "type": _text(),
        "position": _position,
        "angle": _angle,
        "velocity": _list(_number(-1e3, 1e3, "m/s"), 2, "two numbers [vx, vy] in m/s"),
        "spin": _number(-1e4, 1e4, "rad/s"),
        "held": _boolean,
    },
    Magnet: {
        "alpha": _number(0, 1e4, "N m^2", above=True),
        "beta": _number(0, 10, "m"),
        "inset": _number(0, 10, "m"),
        "cutoff": _number(0, 10, "m", above=True),
        "switch": _number(0, 1, above=True, below=True),
        "mismatch": _one_of(-1, 0),
    },
    Drive: {
        "kind": _one_of("unicycle", "shaking", "constant", "user"),
        "force": lambda force: (_any_force if isinstance(force, tuple) else _force)(force),
        "torque": _number(-1e6, 1e6, "N m"),
        "frequency": _number(0, 1e4, "Hz"),
        "module": _text(),
        "function": _text(),
        "parameters": _list(_number(-1e300, 1e300), None, "an array of numbers"),
    },
    Floor: {
        "law": _one_of("separate", "coupled", "exact"),
        "linear": _friction,
        "angular": _friction,
        "angular_reading": _one_of("engine", "uniform-pressure"),
        "gravity": _number(0, 1e3, "m/s^2"),
    },
    Solver: {
        "step": _number(0, 0.1, "s", above=True),
        "substeps": _integer(1, 1000),
        "tolerance": _number(0, 1, "m/s", above=True),
        "passes": _integer(1, 100_000),
        "at_rest": _number(0, 1, "", above=True),
        "keep_lists": _boolean,
        "skip_converged": _boolean,
        "join_substeps": _boolean,
        "skip_still": _boolean,
    },
    Record: {
        "interval": _number(0, 1e9, "s", above=True),
        "checkpoint": _number(0, 1e9, "s", above=True),
    },
    Run: {
        "duration": _number(0, LONGEST_RUN, "s", above=True),
        "seed": _integer(0, _LARGEST_INTEGER),
    },
}
_SCENE_RULES: dict[str, Rule] = {"temperature": _integer(1, 4), "title": _text(empty=True)}

KINDS: dict[type, tuple[str, dict[str, tuple[str, ...]]]] = {
    Reactor: ("shape", {"circle": ("radius",), "rectangle": ("width", "height")}),
    Drive: ("kind", {
        "unicycle": ("force", "torque", "frequency"),
        "shaking": ("force", "frequency"),
        "constant": ("force", "torque"),
        "user": ("module", "function", "parameters"),
    }),
    Floor: ("law", {"separate": ("angular", "angular_reading"), "coupled": (), "exact": ()}),
}
"""Of each part that comes in kinds: the field that tells the kind, and the fields of each."""


def _once(function: F) -> F:
    """Once for the same arguments: a plan has many scenes, of the same classes."""
    return cast(F, cache(function))


@_once
def _fields_of(cls: type, kind: Any = None) -> tuple[str, ...]:
    """The fields of a part, of the given kind if it comes in kinds."""
    names = tuple(f.name for f in fields(cls))
    if cls not in KINDS:
        return names
    kinds = KINDS[cls][1]
    foreign = {name for own in kinds.values() for name in own} - set(kinds.get(kind, ()))
    return tuple(name for name in names if name not in foreign)


def _parts(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Every part of a scene that is there, under its name in TOML."""
    for i, tile_type in enumerate(scene.types):
        yield f"tiles.type[{i}]", tile_type
    for name in ("material", "seed", "reactor", "magnet", "drive", "floor", "solver", "record",
                 "run"):
        if (part := getattr(scene, name)) is not None:
            yield name, part
    for i, tile in enumerate(scene.free.tiles):
        yield f"free.tile[{i}]", tile


def _fail(scene: Scene, name: str, value: Any, message: str) -> NoReturn:
    raise InputError(message + _kind(value), file=scene.file or None, field=name,
                     value=_as_toml(value))


def _as_toml(value: Any) -> Any:
    """A value with arrays for tuples."""
    return [_as_toml(each) for each in value] if isinstance(value, tuple) else value


def _kind(value: Any) -> str:
    """What may be all that is wrong with a value that looks as it must."""
    each = value if isinstance(value, tuple | list) else (value,)
    foreign = any(isinstance(one, np.generic | np.ndarray) and not isinstance(one, float | str)
                  for one in each)
    return ", of Python's own type, not NumPy's" if foreign else ""


def check_is_scene(scene: object) -> None:
    """It is a scene, and not the name of its file.

    Raises
    ------
    TypeError
        Where it is not.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, not {type(scene).__name__}: tbsa.load reads one "
                        "from a file")


_hints = _once(get_type_hints)


def _check_structure(scene: Scene, path: str, part: Any) -> None:
    """The parts of a scene built in Python are of their annotated types; values have rules."""
    for name, kind in _hints(type(part)).items():
        value = getattr(part, name)
        _check_type(scene, path + name, value, kind)
        if is_dataclass(value) and type(value) not in RULES:
            _check_structure(scene, f"{path}{name}.", value)


def _check_type(scene: Scene, path: str, value: Any, kind: Any) -> None:
    inner = get_args(kind)
    if get_origin(kind) is tuple:
        if not isinstance(value, tuple) or (inner[-1] is not ... and len(value) != len(inner)):
            _fail(scene, path, value, f"must be {_in_words(kind)}")
        for i, item in enumerate(value):
            _check_type(scene, f"{path}[{i}]", item, inner[0] if inner[-1] is ... else inner[i])
    elif any(map(is_dataclass, types := inner or (kind,))) and type(value) not in types:
        _fail(scene, path, value, f"must be {_in_words(kind)}")


def _in_words(kind: Any) -> str:
    """A type as it is asked for: a Seed or None, a tuple of tuples (str, int)."""
    inner = get_args(kind)
    if get_origin(kind) is not tuple:
        return " or ".join("None" if each is type(None) else f"a {each.__name__}"
                           for each in inner or (kind,))
    if inner[-1] is ...:
        return "a tuple of " + _in_words(inner[0]).removeprefix("a ").replace("tuple", "tuples")
    return f"a tuple ({', '.join(each.__name__ for each in inner)})"


def _check_part(scene: Scene, path: str, part: Any) -> None:
    cls = type(part)
    if cls in KINDS:  # a kind comes first: which other fields are there depends on it
        key = KINDS[cls][0]
        if message := RULES[cls][key](getattr(part, key)):
            _fail(scene, f"{path}.{key}", getattr(part, key), message)
    kind = getattr(part, KINDS[cls][0]) if cls in KINDS else None
    own = _fields_of(cls, kind)
    for f in fields(cls):
        value = getattr(part, f.name)
        if f.name not in own:
            # Of an array the comparison is no truth value.
            if isinstance(value, np.ndarray) or value != f.default:
                _fail(scene, f"{path}.{f.name}", value,
                      f'does not belong to {KINDS[cls][0]} "{kind}"; leave it out')
        elif message := RULES[cls][f.name](value):
            _fail(scene, f"{path}.{f.name}", value, message)
    if cls is Drive and isinstance(part.force, tuple) != (kind == "constant"):
        _fail(scene, f"{path}.force", part.force, _any_force(None) if kind == "constant"
              else _force(None))


def _check_names(scene: Scene) -> None:
    """Top-level values, tile types and everything that names them."""
    for key, rule in _SCENE_RULES.items():
        if message := rule(getattr(scene, key)):
            _fail(scene, key, getattr(scene, key), message)
    names = [tile_type.name for tile_type in scene.types]
    if not names:
        _fail(scene, "tiles.type", [], "must hold at least one tile type")
    for i, name in enumerate(names):
        if name in names[:i]:
            _fail(scene, f"tiles.type[{i}].name", name, "must be the only type of that name")
    known = _one_of(*names)

    cells = scene.seed.cells if scene.seed else ()
    column_or_row, taken = _integer(-1_000_000, 1_000_000), set()
    for i, cell in enumerate(cells):
        path = f"seed.cells[{i}]"
        if not isinstance(cell, tuple) or len(cell) != 3:
            _fail(scene, path, cell, "must be a cell [column, row, type]")
        for what, value, rule in zip(("column", "row", "type"), cell,
                                     (column_or_row, column_or_row, known), strict=True):
            if message := rule(value):
                _fail(scene, path, value, f"({what}) {message}")
        if cell[:2] in taken:
            _fail(scene, path, cell, "must be the only cell at its column and row")
        taken.add(cell[:2])

    for i, tile in enumerate(scene.free.tiles):
        if message := known(tile.type):
            _fail(scene, f"free.tile[{i}].type", tile.type, message)
        if tile.held and (any(tile.velocity) or tile.spin):
            _fail(scene, f"free.tile[{i}].held", tile.held,
                  "must be false for a tile with a velocity or spin: held tiles never move")
    counted = [name for name, _ in scene.free.counts]
    for name, number in scene.free.counts:
        if message := known(name):
            _fail(scene, "free.counts", name, message)
        if message := _integer(0, 10_000_000)(number):
            _fail(scene, f"free.counts.{name}", number, message)
        if counted.count(name) > 1:
            _fail(scene, "free.counts", name, "must be counted once")
    random = sum(number for _, number in scene.free.counts)
    if random and scene.reactor is None:
        # In the file it may be number or counts.
        _fail(scene, "free", random, "random tiles must be left out without a [reactor]: they are "
              "placed inside its wall")
    if not (cells or scene.free.tiles or random):
        _fail(scene, "free", 0, "tiles in the scene; must be at least one, in [seed] or [free]")


def _check_magnet_and_tile(scene: Scene) -> None:
    """Tile and magnet, as far as one value bounds another."""
    width, mass, magnet, reactor = (
        scene.material.width, scene.material.mass, scene.magnet, scene.reactor)
    per_area = _number(0.01, 1e4, "kg/m^2")
    if message := per_area(mass / width**2):  # a mass in g or a width in cm or mm
        _fail(scene, "material.mass", mass, f"(kg) is {mass / width**2:.4g} kg/m^2 on a tile "
              f"{width:g} m wide; mass / width^2 {message}")
    if magnet is not None:
        if not magnet.inset < 0.5 * width:
            _fail(scene, "magnet.inset", magnet.inset,
                  f"must be a number from 0 to below half the tile width, {0.5 * width:g} m")
        if not magnet.cutoff > 2 * magnet.inset:
            _fail(scene, "magnet.cutoff", magnet.cutoff,
                  f"must be a number above the distance of bonded magnets, 2 magnet.inset = "
                  f"{2 * magnet.inset:g} m")
        if magnet.beta == 0 and magnet.inset == 0:
            _fail(scene, "magnet.beta", magnet.beta,
                  "must be above 0 m unless magnet.inset is: the force at contact is infinite")
        _check_bonds(scene, magnet)
    if reactor is not None and not inside(
            reactor, width, np.zeros(1), np.zeros(1), np.zeros(1)).all():
        key = "radius" if reactor.shape == "circle" else (
            "width" if reactor.width < width else "height")
        least = width / math.sqrt(2) if key == "radius" else width
        value, shown = getattr(reactor, key), f"{least:g}"
        if f"{value:g}" == shown:
            shown = repr(least)
        _fail(scene, f"reactor.{key}", value,
              f"must be at least {shown} m, to hold one tile {width:g} m wide")


# Of a bond: the square of what its vibration turns by (rad) between two looks at the forces, at
# most.  Leapfrog is unstable above 4.  Pairs and blocks with friction 0.05 and 0.25, knocked at
# 0.05 to 0.4 m/s, held at 4 where they do at a 32nd of the step, and most were torn at 6 and above.
# A smooth block's fastest vibration has twice the square of a pair's: some flew apart at rest at
# 3.9.  Friction takes what the forces give, up to ROUGH: of crowds of eight that snap together 9 of
# 588 then gain more than 0.3 of the energy of a bond with a friction of 0 to 0.1, and 16 of 196
# with 0.25; with 0.05 and 3.9, 13 of 30 do.
SMOOTH, STIFF, ROUGH = 2.0, 4.0, 0.2
# Below this share of the width it is the inset that is too small: magnets that are all but in one
# place pull in a direction made of the solver's overlap.
FLAT = 0.01


def _check_bonds(scene: Scene, magnet: Magnet) -> None:
    """Bonded magnets are far enough apart, and forces found often enough, for their pull to have a
    direction.

    A pair that slides by d is pulled back by F d / r at a distance r of its magnets.
    """
    width, mass, p = scene.material.width, scene.material.mass, between_forces(scene)
    r, arm = 2.0 * magnet.inset, 0.5 * width - magnet.inset
    pull = magnet.alpha / (r + magnet.beta) ** 2
    turn = pull * p * p * 2.0 * (1.0 / mass + 6.0 * arm * arm / (mass * width**2))
    mu = scene.material.friction
    most = r * (SMOOTH + (STIFF - SMOOTH) * min(mu / ROUGH, 1.0))
    if turn <= most:
        return
    if magnet.inset < FLAT * width:
        _fail(scene, "magnet.inset", magnet.inset,
              f"must be at least {FLAT * width:g} m, {FLAT:.0%} of the width, with magnets and a "
              f"solver.step like these: bonded magnets are 2 inset apart and pull with {pull:.3g} "
              f"N, which changes its direction faster than every {p:.3g} s")
    step = scene.solver.step
    _fail(scene, "solver.step", step,
          f"must be at most {at_most(step * math.sqrt(most / turn), 3)} s with magnets"
          f" like these{'' if mu >= ROUGH else f' and a friction of {mu:g}'}: bonds "
          f"vibrate, and forces are found every {p:.3g} s, "
          f"{'twice a step' if p < step else 'once a step, as the number of substeps is odd'}")


SAMPLES = 8  # of a drive, at least, in a period
SHORTEST = 1e-9  # s, step
DAMPED = 0.5  # how often a velocity falls to a part 1/e, at most, from force to force: 1 % of error


def between_forces(scene: Scene) -> float:
    """Time between the instants at which forces are found (s): twice a step, or once if the
    number of substeps is odd."""
    return scene.solver.step / (2 if scene.solver.substeps % 2 == 0 else 1)


def _check_times(scene: Scene) -> None:
    """Records fall on whole steps, checkpoints on records; steps resolve the drive."""
    step, drive = scene.solver.step, scene.drive
    if step < SHORTEST:
        _fail(scene, "solver.step", step, f"must be at least {SHORTEST:g} s: shorter steps would "
              "be lost in the rounding of the time")
    if round(scene.run.duration / step) < 1:
        _fail(scene, "run.duration", scene.run.duration,
              f"must be more than half of solver.step = {step!r} s: a run lasts whole steps")
    for name, value, unit, part in (
            ("record.interval", scene.record.interval, "solver.step", scene.solver.step),
            ("record.checkpoint", scene.record.checkpoint, "record.interval",
             scene.record.interval)):
        number = round(value / part)
        if number < 1 or abs(number * part - value) > 1e-9 * value:
            _fail(scene, name, value, f"must be a whole multiple of {unit} = {part!r} s")
    for name in ("linear_damping", "angular_damping"):
        value = getattr(scene.material, name)
        if value * between_forces(scene) > DAMPED:
            _fail(scene, f"material.{name}", value,
                  f"must be at most {at_most(DAMPED / between_forces(scene))} 1/s, as forces are "
                  f"found every {between_forces(scene):.3g} s; use a shorter solver.step")
    if drive is not None and drive.kind in ("unicycle", "shaking"):
        most = 1.0 / (SAMPLES * between_forces(scene))
        if drive.frequency > most * (1.0 + 1e-9):
            _fail(scene, "drive.frequency", drive.frequency,
                  f"must be at most {at_most(most)} Hz, as the drive is looked at every "
                  f"{between_forces(scene):.3g} s and {SAMPLES} times a period at least; "
                  "use a shorter solver.step")


def _check_places(scene: Scene) -> None:
    """The seed and the tiles placed explicitly are inside the reactor and do not overlap."""
    width, seed, tiles = scene.material.width, scene.seed, scene.free.tiles
    cells = seed.cells if seed else ()
    names = ["seed"] * len(cells) + [f"free.tile[{i}].position" for i in range(len(tiles))]
    values: list[Any] = [*cells, *(tile.position for tile in tiles)]
    at = np.array([(*tile.position, tile.angle) for tile in tiles], float).reshape(-1, 3)
    x, y, angle = at.T
    if seed is not None:
        u, v = lattice(seed, width, [c[0] for c in cells], [c[1] for c in cells])
        x, y = np.append(u, x), np.append(v, y)
        angle = np.append(np.full(len(cells), float(seed.angle)), angle)
    for i in np.flatnonzero(~inside(scene.reactor, width, x, y, angle))[:1]:
        assert scene.reactor is not None
        size = (f"radius {scene.reactor.radius:g} m" if scene.reactor.shape == "circle"
                else f"{scene.reactor.width:g} m x {scene.reactor.height:g} m")
        _fail(scene, names[i], values[i],
              f"must be wholly inside the reactor ({scene.reactor.shape}, {size}), "
              f"as a tile {width:g} m wide; it is centred at ({x[i]:g}, {y[i]:g}) m")
    i, j = near(x[len(cells):], y[len(cells):], x, y, math.sqrt(2) * width)
    i += len(cells)
    deep = depth(width, x[j] - x[i], y[j] - y[i], angle[i], angle[j])
    for k in np.flatnonzero((j < i) & (deep > 1e-6 * width))[:1]:
        other = f"seed cell {cells[j[k]]}" if j[k] < len(cells) else names[j[k]].split(".pos")[0]
        _fail(scene, names[i[k]], values[i[k]],
              f"must not overlap {other}; it does by {deep[k]:.3g} m (touching is allowed)")


MOST_SITES = 10_000_000  # that a ground truth may have to grow on
LONGEST = 256  # sites, of a chain of tiles that leads away from its seed


def growth_box(seed: Seed, margin: int) -> tuple[int, int, int, int]:
    """The first and last column, first and last row of a seed with a margin on every side."""
    columns, rows = [cell[0] for cell in seed.cells], [cell[1] for cell in seed.cells]
    return min(columns) - margin, max(columns) + margin, min(rows) - margin, max(rows) + margin


def growth_margin(scene: Scene) -> int:
    """How far beyond its seed a pattern without a reactor may grow, in sites.

    As far as a chain of all tiles, up to `LONGEST`; not at all where tiles need two neighbours.
    """
    seed = len(scene.seed.cells) if scene.seed else 0
    return min(tile_count(scene) - seed, LONGEST) if scene.temperature == 1 else 0


def _check_growth(scene: Scene) -> None:
    """The ground truth, which the metrics need, is not too large to be grown."""
    seed, reactor, single = scene.seed, scene.reactor, scene.temperature == 1
    if seed is None:
        return
    left, right, low, high = growth_box(seed, growth_margin(scene))
    sites = float((right - left + 1) * (high - low + 1))
    if reactor is not None:
        wall = area(reactor) / scene.material.width**2
        sites = wall if single else min(sites, wall)
    if sites <= MOST_SITES:
        return
    many = f"{sites:.3g} sites to grow on, more than {MOST_SITES:.0e}"
    if reactor is not None and single:
        key = "radius" if reactor.shape == "circle" else (
            "width" if reactor.width >= reactor.height else "height")
        _fail(scene, f"reactor.{key}", getattr(reactor, key),
              f"must be less at temperature 1: the reactor has {many}")
    raise InputError(f"must lie closer together, or in a smaller [reactor]: their box has {many}",
                     file=scene.file or None, field="seed.cells")


def tile_count(scene: Scene) -> int:
    """Number of tiles, held and free."""
    return ((len(scene.seed.cells) if scene.seed else 0) + len(scene.free.tiles)
            + sum(number for _, number in scene.free.counts))


def engine_path(scene: Scene) -> Path:
    """The Python file of a user's own drive: ``drive.module``, relative to the scene's file."""
    assert scene.drive is not None
    return Path(scene.file).parent / scene.drive.module


def engine_source(scene: Scene) -> bytes:
    """The bytes of that file.

    Raises
    ------
    OSError
        Where it cannot be read, is a pipe or a device, or is longer than `LARGEST`.
    """
    path = engine_path(scene)
    if not stat.S_ISREG(mode := path.stat().st_mode) and not stat.S_ISDIR(mode):
        raise OSError("it is a pipe or a device")
    with open(path, "rb") as stream:
        source = stream.read(LARGEST + 1)
    if len(source) > LARGEST:
        raise OSError(f"it is longer than {LARGEST} bytes")
    return source


def _check_engine(scene: Scene) -> None:
    """The user's engine is there; its module is read, not run."""
    assert scene.drive is not None
    module, function = scene.drive.module, scene.drive.function
    tree = ast.Module([], [])
    try:
        tree = ast.parse(engine_source(scene))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        _fail(scene, "drive.module", module,
              f"must be a Python file, its path relative to the scene's file: {reason}")
    except SyntaxError as error:
        _fail(scene, "drive.module", module,
              f"must be a Python file: {error.msg}"
              + (f" (line {error.lineno})" if error.lineno is not None else ""))
    except (MemoryError, RecursionError):  # of the parser's own stack
        _fail(scene, "drive.module", module, "must be a Python file: it is nested too deeply")
    defined = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    if not function.isidentifier() or function not in defined:
        _fail(scene, "drive.function", function, "must be a function defined in drive.module: "
              f"{', '.join(defined) or 'it has none'}{_suggestion(function, defined)}")


# ---------------------------------------------------------------------------------------------
# TOML.


def load(path: str | Path, *, seed: int | None = None, duration: float | None = None) -> Scene:
    """Read a scene from a TOML file.

    Parameters
    ----------
    path
        The file.
    seed, duration
        Take the place of ``run.seed`` and ``run.duration`` (s) when given; NumPy's numbers will do.

    Raises
    ------
    InputError
        When the file cannot be read, is not TOML, or holds a value that is not allowed.
    """
    path = os.fsdecode(path)
    return of_run(parse(read_toml(path), path), seed, duration)


def of_run(scene: Scene, seed: int | None, duration: float | None) -> Scene:
    """The scene with another ``run.seed`` and ``run.duration`` (s), where they are given."""
    if seed is None and duration is None:
        return scene
    given: dict[str, Any] = {"seed": seed, "duration": duration}
    run = replace(scene.run, **{
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in given.items() if value is not None})
    scene = replace(scene, run=run)
    scene.validate()
    return scene


def read_toml(path: str | Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises
    ------
    InputError
        When the file cannot be read or is not TOML.
    """
    return _tables(read_text(path, "TOML"), str(path))


LARGEST = 2**28  # bytes of a text file: more than a million tiles with a line for every field


def read_text(path: str | Path, kind: str) -> str:
    """The text of a file of some kind, ``"TOML"`` or ``"CSV"``.

    Raises
    ------
    InputError
        When it cannot be read, is longer than `LARGEST`, or is not UTF-8.
    """
    file = str(path)
    try:
        with open(path, "rb") as stream:  # perhaps a pipe, or a device without end
            data = stream.read(LARGEST + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"must be a {kind} file that can be read: {reason}", file=file) from None
    if len(data) > LARGEST:
        raise InputError(f"must be a {kind} file of at most {LARGEST} bytes", file=file)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"must be a {kind} file in UTF-8: {error.reason} at byte {error.start}",
                         file=file) from None


def _tables(text: str, file: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except ValueError as error:  # a number of thousands of digits, too
        raise InputError(f"must be valid TOML: {error}", file=file or None) from None
    except RecursionError:
        raise InputError("must be valid TOML: it is nested too deeply", file=file or None) from None


def parse(source: str | Mapping[str, Any], file: str = "") -> Scene:
    """Make a scene from TOML text, or from the tables that it would give.

    Parameters
    ----------
    source
        The text, or a mapping as `tomllib` returns it.
    file
        The name to be used in messages; ``drive.module`` is relative to its folder.

    Raises
    ------
    InputError
        When it is neither, or the text is not TOML, or holds a value that is not allowed.
    """
    if isinstance(source, str):
        source = _tables(source, file)
    if not isinstance(source, Mapping):
        raise InputError("must be TOML text (str), or a mapping of the tables that it would give",
                         file=file or None, field="source", value=source)
    scene = _Reader(file).scene(source)
    scene.validate()
    return scene


def dumps(scene: Scene) -> str:
    """The scene as complete TOML; `parse` gives the same scene again, apart from `file`.

    Raises
    ------
    TypeError
        Where it is no scene.
    """
    check_is_scene(scene)
    lines = [f"title = {_toml(scene.title)}", f"temperature = {_toml(scene.temperature)}"]
    parts = list(_parts(scene))
    if scene.free.counts:  # before the array of tables that belongs to it
        at = next((i for i, (name, _) in enumerate(parts) if name.startswith("free")), len(parts))
        parts.insert(at, ("free", scene.free))
    for name, part in parts:
        head, _, index = name.partition("[")
        lines += ["", f"[[{head}]]" if index else f"[{head}]"]
        if isinstance(part, Free):
            lines.append(f"counts = {_toml(dict(part.counts))}")
            continue
        if isinstance(part, Seed):
            lines.append('shape = "cells"')
        lines += [f"{name} = {value}" for name, value in entries(part).items()]
    return "\n".join(lines) + "\n"


def entries(part: Any) -> dict[str, str]:
    """The fields of a part, those of its kind if it comes in kinds, and their values as TOML."""
    cls = type(part)
    kind = getattr(part, KINDS[cls][0]) if cls in KINDS else None
    own = _fields_of(cls, kind)
    return {f.name: _toml(_coerce(f.type, value) if "float" in str(f.type) else value)
            for f in fields(cls) if f.name in own for value in [getattr(part, f.name)]}


def canonical(scene: Scene) -> bytes:
    """The scene for a hash: without fields that came later than others where they change nothing,
    so that scenes of before have the same."""
    text = dumps(scene)
    for line in ("at_rest = 1.0", "skip_still = true"):
        text = text.replace(f"\n{line}\n", "\n", 1)
    return text.encode()


def fingerprint(scene: Scene) -> str:
    """SHA-256 (hex) of everything that the trajectory depends on.

    Left out are ``title``, ``file``, ``record``, ``run.duration``, ``solver.skip_still``, the
    colours and the temperature (that of the ground truth, not of the tiles).  Of a user's own drive
    the bytes of the module count, not its path; nor do files that it reads and modules that it
    imports, which is why it has to stand alone.
    """
    drive, module = scene.drive, b""
    if drive is not None and drive.kind == "user":
        try:
            module = engine_source(scene)
        except OSError as error:  # it was there when the scene was validated
            raise InputError(f"cannot be read any more, as {engine_path(scene)}: "
                             f"{error.strerror or error}; a relative path counts from the folder "
                             "that the process is in now", file=scene.file or None,
                             field="drive.module", value=drive.module) from None
        drive = replace(drive, module="")
    bare = replace(
        scene, title="", file="", temperature=2, record=Record(), drive=drive,
        run=replace(scene.run, duration=1.0), solver=replace(scene.solver, skip_still=True),
        types=tuple(replace(tile_type, colour="") for tile_type in scene.types))
    return hashlib.sha256(canonical(bare) + b"\0" + module).hexdigest()


_quoted = json.JSONEncoder(ensure_ascii=False).encode


def _toml(value: Any) -> str:
    """A value as TOML; `repr` of a float is the shortest text that reads back to its last bit."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, str):
        return _quoted(value).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml(k)} = {_toml(v)}" for k, v in value.items()) + "}"
    return "[" + ", ".join(map(_toml, value)) + "]"


def _coerce(kind: Any, value: Any) -> Any:
    """Arrays to tuples, and integers to floats where the field (its annotation) has floats."""
    if isinstance(value, list | tuple):
        return tuple(_coerce(kind, item) for item in value)
    if "float" in str(kind) and isinstance(value, int) and not isinstance(value, bool):
        return float(value) if abs(value) < 2**1000 else value
    return value


def _suggestion(value: Any, allowed: Iterable[Any]) -> str:
    names = [name for name in allowed if isinstance(name, str)]
    close = difflib.get_close_matches(value, names, 1) if isinstance(value, str) else []
    return f'; did you mean "{close[0]}"?' if close else ""


class _Reader:
    """Brings the tables of a TOML file into the shape of a scene."""

    parts: Mapping[str, type] = {
        "material": Material, "reactor": Reactor, "magnet": Magnet, "drive": Drive,
        "floor": Floor, "solver": Solver, "record": Record, "run": Run}
    tables: Mapping[str, tuple[str, ...]] = {
        "tiles": ("set", "type"),
        "seed": ("shape", "arm", "types", "cells", "centre", "angle"),
        "free": ("counts", "number", "tile"),
        **{name: tuple(f.name for f in fields(cls)) for name, cls in parts.items()}}
    required = ("force", "frequency", "module", "function", "radius", "width", "height")
    """Have defaults only because other kinds of the part lack them."""

    def __init__(self, file: str) -> None:
        self.file = file

    def fail(self, name: str, value: Any, message: str) -> NoReturn:
        raise InputError(message + _kind(value), file=self.file or None, field=name, value=value)

    def missing(self, name: str, message: str) -> NoReturn:
        raise InputError(message, file=self.file or None, field=name)

    def scene(self, data: Mapping[str, Any]) -> Scene:
        self.keys("", data, (*_SCENE_RULES, *self.tables))
        for name in self.tables:
            if name in data:
                self.table(name, data[name])
        if "tiles" not in data:
            self.missing("tiles", 'is missing; must be a table, for example set = "chessboard"')
        types = self.types(data["tiles"])
        given: dict[str, Any] = {
            name: self.part(name, data[name], cls)
            for name, cls in self.parts.items() if name in data}
        for name in _SCENE_RULES:
            if name in data:
                given[name] = data[name]
        if "seed" in data:
            given["seed"] = self.seed(data["seed"], types)
        if "free" in data:
            given["free"] = self.free(data["free"], types)
        return Scene(types, **given, file=self.file)

    def table(self, name: str, value: Any) -> None:
        if not isinstance(value, Mapping):
            hint = "; the seed of the random numbers is run.seed" if name == "seed" else ""
            self.fail(name, value, f"must be a table{hint}")

    def tables_of(self, name: str, value: Any) -> list[Mapping[str, Any]]:
        if not isinstance(value, list | tuple):
            self.fail(name, value, f"must be an array of tables, [[{name}]]")
        for i, item in enumerate(value):
            self.table(f"{name}[{i}]", item)
        return list(value)

    def keys(self, path: str, table: Mapping[str, Any], allowed: Iterable[str]) -> None:
        allowed = tuple(allowed)
        for key in table:
            if key in allowed:
                continue
            hint = _suggestion(key, allowed)
            homes = [f"in [{name}]" for name, names in self.tables.items() if key in names]
            if key in _SCENE_RULES:
                homes.append("at the top of the file, before any table")
            if not hint and homes:
                hint = f"; it belongs {' or '.join(homes)}"
            self.fail(f"{path}.{key}" if path else str(key), table[key],
                      f"is under an unknown key; allowed here: {', '.join(allowed)}{hint}")

    def part(self, path: str, table: Mapping[str, Any], cls: type) -> Any:
        """A dataclass from its table; None when its kind is "none"."""
        names = tuple(f.name for f in fields(cls))
        self.keys(path, table, names)
        own = names
        if cls in KINDS:
            key, kinds = KINDS[cls]
            default = next(f.default for f in fields(cls) if f.name == key)
            kind = table.get(key, default)
            if kind is MISSING:
                self.missing(f"{path}.{key}", f"is missing; must be one of "
                             f"{', '.join(map(_toml, kinds))} or \"none\"")
            if message := _one_of(*kinds, "none")(kind):
                self.fail(f"{path}.{key}", kind, message)
            own = (key,) if kind == "none" else _fields_of(cls, kind)
            for name in table:
                if name not in own:
                    self.fail(f"{path}.{name}", table[name],
                              f"does not belong to {key} {_toml(kind)}, which has "
                              f"{', '.join(own)}")
            if kind == "none":
                return None
        for f in fields(cls):
            needed = f.default is MISSING or (cls in KINDS and f.name in self.required)
            if needed and f.name in own and f.name not in table:
                self.missing(f"{path}.{f.name}", f"is missing; {RULES[cls][f.name](None)}")
        return cls(**{f.name: _coerce(f.type, table[f.name])
                      for f in fields(cls) if f.name in table})

    def types(self, table: Mapping[str, Any]) -> tuple[TileType, ...]:
        self.keys("tiles", table, self.tables["tiles"])
        if ("set" in table) == ("type" in table):
            self.missing("tiles", "must have either set, one of "
                         f"{', '.join(map(_toml, SETS))}, or [[tiles.type]], and not both")
        if "set" in table:
            if message := _one_of(*SETS)(table["set"]):
                self.fail("tiles.set", table["set"], message)
            return SETS[table["set"]]
        types = tuple(self.part(f"tiles.type[{i}]", item, TileType)
                      for i, item in enumerate(self.tables_of("tiles.type", table["type"])))
        if not types:
            self.fail("tiles.type", [], "must hold at least one tile type")
        for i, each in enumerate(types):  # by which seed and free tiles are counted
            if message := RULES[TileType]["name"](each.name):
                self.fail(f"tiles.type[{i}].name", _as_toml(each.name), message)
        return types

    def seed(self, table: Mapping[str, Any], types: tuple[TileType, ...]) -> Seed:
        self.keys("seed", table, self.tables["seed"])
        if "shape" not in table:
            self.missing("seed.shape", 'is missing; must be one of "cross", "L", "cells"')
        shape = table["shape"]
        if message := _one_of("cross", "L", "cells")(shape):
            self.fail("seed.shape", shape, message)
        own = ("cells",) if shape == "cells" else ("arm", "types")
        for name in table:
            if name in ("cells", "arm", "types") and name not in own:
                self.fail(f"seed.{name}", table[name], f"does not belong to shape {_toml(shape)}, "
                          f"which has {', '.join(own)}, centre, angle")
        if own[0] not in table:
            self.missing(f"seed.{own[0]}", "is missing; must be " + (
                "an array of cells [column, row, type]" if shape == "cells" else
                "an integer, the number of tiles in an arm"))
        cells = _coerce("", table["cells"]) if shape == "cells" else self.arms(table, types)
        rest = {f.name: _coerce(f.type, table[f.name])
                for f in fields(Seed) if f.name in table and f.name != "cells"}
        return Seed(cells, **rest)

    def arms(
        self, table: Mapping[str, Any], types: tuple[TileType, ...]
    ) -> tuple[tuple[int, int, str], ...]:
        """Cells of a cross or an L: centre or corner first, then outwards arm by arm."""
        arm, known = table["arm"], [tile_type.name for tile_type in types]
        if message := _integer(1, 1000)(arm):
            self.fail("seed.arm", arm, message)
        pair = table.get("types", (known * 2)[:2] if len(known) == 1 else known[:2])
        if message := _list(_one_of(*known), 2, "two tile types, for even and odd column + row")(
                _coerce("", pair)):
            self.fail("seed.types", pair, message)
        arms = ((1, 0), (0, 1)) + (((-1, 0), (0, -1)) if table["shape"] == "cross" else ())
        sites = [(0, 0), *((k * c, k * r) for c, r in arms for k in range(1, arm + 1))]
        return tuple((c, r, pair[(c + r) % 2]) for c, r in sites)

    def free(self, table: Mapping[str, Any], types: tuple[TileType, ...]) -> Free:
        self.keys("free", table, self.tables["free"])
        counts = table.get("counts", {})
        self.table("free.counts", counts)
        if "number" in table:
            number = table["number"]
            if "counts" in table:
                self.fail("free.number", number, "must be left out where free.counts is given")
            if message := _integer(0, 10_000_000)(number):
                self.fail("free.number", number, message)
            if number % len(types):
                self.fail("free.number", number, f"must be a whole multiple of {len(types)}, "
                          "the number of tile types, which get equal parts")
            counts = {tile_type.name: number // len(types) for tile_type in types}
        tiles = self.tables_of("free.tile", table.get("tile", []))
        return Free(tuple(counts.items()), tuple(
            self.part(f"free.tile[{i}]", item, PlacedTile) for i, item in enumerate(tiles)))
