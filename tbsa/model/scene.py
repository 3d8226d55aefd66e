"""A scene: everything that a run depends on, as frozen dataclasses.

A scene is read from TOML (:func:`load`) or built in Python; either way
:meth:`Scene.validate` has passed before anything else sees it.  SI units throughout.
Edges are in the order N, E, S, W; angles are counter-clockwise from +x; at angle 0 the
E edge of a tile faces +x and its N edge +y.
"""

from __future__ import annotations

from dataclasses import dataclass, field

EDGES = ("N", "E", "S", "W")


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

    width: float = 0.03
    mass: float = 0.016
    friction: float = 0.25  # tile-tile
    restitution: float = 0.2  # tile-tile
    linear_damping: float = 0.8  # 1/s
    angular_damping: float = 0.5  # 1/s
    restitution_threshold: float = 0.01  # m/s; slower impacts are plastic


@dataclass(frozen=True)
class Seed:
    """Held tiles on a square lattice, cell (0, 0) at ``centre``, turned by ``angle``."""

    cells: tuple[tuple[int, int, str], ...]  # (column, row, tile type)
    centre: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0


@dataclass(frozen=True)
class Reactor:
    """The wall: a circle of ``radius``, or a rectangle of ``width`` x ``height``, at the origin."""

    shape: str  # "circle" | "rectangle"
    radius: float = 0.0
    width: float = 0.0
    height: float = 0.0
    friction: float = 0.25
    restitution: float = 0.2


@dataclass(frozen=True)
class PlacedTile:
    """One tile placed explicitly."""

    type: str
    position: tuple[float, float]
    angle: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    spin: float = 0.0
    held: bool = False


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
    linear: float = 0.25
    angular: float = 0.25  # separate only
    angular_reading: str = "engine"  # "engine" | "uniform-pressure"; separate only
    gravity: float = 9.81  # m/s^2


@dataclass(frozen=True)
class Solver:
    """Time step and tolerances."""

    step: float = 1 / 120  # s
    substeps: int = 4  # per step
    tolerance: float = 1e-7  # m/s: a pass that changes no contact velocity by more ends the solve
    passes: int = 50  # at most, a substep


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
    """A validated scene.  A part that is ``None`` is not there and costs nothing."""

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
