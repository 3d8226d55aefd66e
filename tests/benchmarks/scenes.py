"""Reference scenes: each a scene that can be run, with an exact truth and a measure of error.

    python -m tests.benchmarks.scenes FOLDER

writes every scene as a TOML file for ``tbsa run``.  A measure drives anything that has the
arrays and the ``advance`` of :class:`tbsa.Simulation` (see :class:`Engine`), so that other
engines are held to the same truths.  Errors are relative, or in widths of a tile.
"""

from __future__ import annotations

import argparse
import cmath
import math
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tbsa.model.scene import (
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
)
from tbsa.model.simulation import floor_limits
from tests.benchmarks.invariants import law_of
from theory import impact, magnets, motion, rotation, scaling, unicycle
from theory.snap import Body, Meeting, closing, meet, separation

HERE = Path(__file__).parent
WIDTH, MASS, GRAVITY, MU = 0.03, 0.016, 9.81, 0.25
INERTIA = MASS * WIDTH**2 / 6.0
BOND = 1.8e-5 / (2 * 1.5e-3 + 6.4e-3) ** 2  # N, two mating magnets in contact
GREY = (TileType("tile", (0, 0, 0, 0), "grey"),)
MATING = Magnet(cutoff=0.02)  # shorter than any distance of magnets that do not mate
STEPS = tuple(1 / n for n in (60, 120, 240, 480, 960, 1920, 3840))


class Engine(Protocol):
    """What a measure needs of a simulation."""

    h: float
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]
    vx: NDArray[np.float64]
    vy: NDArray[np.float64]
    omega: NDArray[np.float64]

    def advance(self, steps: int) -> None: ...


Make = Callable[[Scene], Engine]
Errors = dict[str, float]


@dataclass(frozen=True)
class Reference:
    """One scene, its truth and what may be asked of it at a step of 1/480 s."""

    name: str
    title: str
    scene: Scene
    duration: float  # s of simulated time that are timed
    measure: Callable[[Make, Scene], Errors]
    targets: dict[str, float]  # the first is the one that is plotted
    steps: tuple[float, ...] = STEPS
    slow: bool = False
    ordered: bool = False  # the order of convergence is asked for, >= 1.9

    @property
    def quantity(self) -> str:
        """The error that is plotted and compared with other engines."""
        return next(iter(self.targets))


def at_step(scene: Scene, h: float, **changes: Any) -> Scene:
    """The scene at a step of `h` (s) and other changes of its solver."""
    solver = replace(scene.solver, step=h, **changes)
    return replace(scene, solver=solver)


def go(engine: Engine, seconds: float) -> None:
    """Advance by a time (s) that is a whole number of steps."""
    engine.advance(round(seconds / engine.h))


def tile(x: float, y: float, angle: float = 0.0, vx: float = 0.0, vy: float = 0.0,
         spin: float = 0.0, *, kind: str = "tile", held: bool = False) -> PlacedTile:
    """A placed tile."""
    return PlacedTile(kind, (float(x), float(y)), float(angle), (float(vx), float(vy)),
                      float(spin), held)


def body(**changes: float) -> Material:
    """The paper's tile without damping and without a threshold of restitution."""
    return Material(**({"linear_damping": 0.0, "angular_damping": 0.0,
                        "restitution_threshold": 0.0} | changes))


def build(title: str, tiles: Sequence[PlacedTile], **parts: Any) -> Scene:
    """A scene at the default settings of the solver."""
    duration = parts.pop("duration", 1.0)
    parts = {"types": GREY, "material": body()} | parts
    return Scene(free=Free((), tuple(tiles)), title=title, solver=Solver(),
                 record=Record(0.1, 1.0), run=Run(duration), **parts)


def state(engine: Engine) -> NDArray[np.float64]:
    """Copy of x, y, angle, vx, vy, omega, shape (6, n)."""
    e = engine
    return np.array([e.x, e.y, e.angle, e.vx, e.vy, e.omega])


def gained(engine: Engine, before: NDArray[np.float64]) -> float:
    """By what part the kinetic energy is above that of velocities `before`; 0 where it is not."""
    weights = np.array([[MASS], [MASS], [INERTIA]])
    start, now = ((weights * v**2).sum() for v in (before, state(engine)[3:]))
    return float(max(0.0, now / start - 1.0))


def relative(found: float, truth: float) -> float:
    """|found/truth - 1|."""
    return abs(found - truth) / abs(truth)


# One tile without contacts.

DAMPED = body(linear_damping=0.8, angular_damping=0.5)


def slide() -> Reference:
    """A tile that slides to its stop."""
    truth = motion.sliding_stop(0.3, MU, 0.8)[1]
    scene = build("Sliding stop", [tile(0, 0, 0.2, 0.3 * math.cos(0.4), 0.3 * math.sin(0.4))],
                  material=DAMPED, floor=Floor())

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        go(s, 0.5)
        return {"distance": relative(math.hypot(s.x[0], s.y[0]), truth)}

    return Reference("slide", "sliding stop", scene, 0.5, measure, {"distance": 1e-4},
                     ordered=True)


def spin() -> Reference:
    """A tile that spins to its stop."""
    scene = build("Spin stop", [tile(0, 0, 0.3, spin=20.0)], material=DAMPED, floor=Floor())
    truth = motion.spin_stop(20.0, floor_limits(scene)[1], INERTIA, 0.5)[1]

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        go(s, 0.5)
        return {"angle": relative(s.angle[0] - 0.3, truth)}

    return Reference("spin", "spin stop", scene, 0.5, measure, {"angle": 1e-4}, ordered=True)


def _path_error(make: Make, scene: Scene, times: NDArray[np.float64],
                truth: NDArray[np.float64]) -> Errors:
    """Largest error of place and heading over the motion's size, at whole seconds."""
    reach = np.abs(truth).max(axis=0)
    s, found = make(scene), []
    for _ in times:
        go(s, 1.0)
        found.append(state(s)[:3, 0])
    miss = np.abs(np.array(found) - truth[:, :3])
    return {"path": float(miss[:, :2].max() / reach[:2].max()),
            "heading": float(miss[:, 2].max() / reach[2])}


def driven() -> Reference:
    """The unicycle drive for 20 s on separate friction: sticking and slipping."""
    times = np.arange(1.0, 21.0)
    scene = build("Driven tile, separate friction", [tile(0, 0)], floor=Floor(),
                  material=Material(restitution_threshold=0.0), duration=20.0,
                  drive=Drive("unicycle", 0.075, 7.5e-4, 0.1))
    force, torque = floor_limits(scene)
    truth = motion.driven_tile(
        times, mass=MASS, inertia=INERTIA, force=0.075, torque=7.5e-4, frequency=0.1,
        friction_force=force, friction_torque=torque, linear_damping=0.8, angular_damping=0.5)
    return Reference("driven", "driven tile, separate floor", scene, 20.0,
                     lambda make, scene: _path_error(make, scene, times, truth),
                     {"path": 1e-4, "heading": 1e-4}, ordered=True)


COUPLED = {"mass": MASS, "width": WIDTH, "force": 0.075, "torque": 1e-4, "frequency": 0.1,
           "mu": MU, "linear_damping": 0.8, "angular_damping": 0.5}


def coupled() -> Reference:
    """The same on coupled friction, one bound for sliding and turning."""
    times = np.arange(1.0, 21.0)
    truth = cache(lambda: unicycle.coupled_tile(times, **COUPLED))  # takes seconds
    scene = build("Driven tile, coupled friction", [tile(0, 0)], floor=Floor("coupled"),
                  material=Material(restitution_threshold=0.0), duration=20.0,
                  drive=Drive("unicycle", 0.075, 1e-4, 0.1))
    return Reference("coupled", "driven tile, coupled floor", scene, 20.0,
                     lambda make, scene: _path_error(make, scene, times, truth()),
                     {"path": 1e-3, "heading": 1e-3})


# Two tiles and their magnets.


def _meet(scene: Scene, poses: Any, twists: Any) -> Meeting:
    """The exact motion of the scene's two tiles, the first of which is held."""
    assert scene.magnet is not None
    glues = {kind.name: kind.glues for kind in scene.types}
    free = Body(MASS, INERTIA, *floor_limits(scene), scene.material.linear_damping,
                scene.material.angular_damping)
    return meet(poses, twists, (Body(math.inf, math.inf), free),
                [glues[each.type] for each in scene.free.tiles], law_of(scene.magnet))


def last_free(engine: Engine, seconds: float) -> NDArray[np.float64]:
    """The state of two tiles before the substep in which they hit, or that at the end.

    They speed up until they hit: what takes of their energy is the impact.
    """
    before, most = state(engine), 0.0
    for _ in range(round(seconds / engine.h)):
        engine.advance(1)
        now = state(engine)
        energy = float((now[3:5] ** 2).sum() + WIDTH**2 / 6.0 * (now[5] ** 2).sum())
        if energy < 0.999 * most and most > 4e-4:
            return before
        before, most = now, max(energy, most)
    return before


def snap(name: str, kind: str, gap: float, floor: Floor | None) -> Reference:
    """A free tile at rest before a held one; both turned alike."""
    pair = SETS[kind]
    scene = build(f"Snap: {kind}, gap {100 * gap:g} cm, {'dry floor' if floor else 'no floor'}",
                  [tile(0, 0, kind="black", held=True), tile(WIDTH + gap, 0, kind="white")],
                  types=pair, magnet=Magnet(), floor=floor, material=DAMPED)
    truth = _meet(scene, [(0, 0, 0), (WIDTH + gap, 0, 0)], np.zeros((2, 3)))

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        if truth.kind == "rest":
            go(s, 2.0)
            now = state(s)
            found = separation(now[:3, 0], now[:3, 1], WIDTH)[0]
            return {"gap": abs(found - truth.gap) / (gap - truth.gap)}
        now = last_free(s, math.ceil(1.5 * truth.time * 60) / 60)
        # The impact that this state leads to: followed exactly over less than a substep.
        if separation(now[:3, 0], now[:3, 1], WIDTH)[0] > 0.0:
            end = _meet(scene, now[:3].T, now[3:].T)
            speed, tilt = end.speed, end.tilt
        else:
            speed, tilt = closing(now[:3].T, now[3:].T, WIDTH)[0], now[2, 1] - now[2, 0]
        errors = {"speed": relative(speed, truth.speed)}
        if truth.tilt != 0.0:
            errors["tilt"] = relative(tilt, truth.tilt)
        return errors

    targets = {"gap": 1e-2} if truth.kind == "rest" else {"speed": 5e-4}
    return Reference(name, scene.title, scene, 0.25, measure, targets)


def snaps() -> list[Reference]:
    """The four cases: on a corner, flush, not at all, and without a floor."""
    # A square under uniform pressure turns more easily than the engine's reading has it: with
    # that one this pair would not turn on its way.
    easy = Floor(angular_reading="uniform-pressure")
    return [snap("snap-corner", "chessboard-oriented", 0.01, easy),
            snap("snap-flush", "chessboard", 0.003, Floor()),
            snap("snap-creep", "chessboard", 0.01, Floor()),
            snap("snap-free", "chessboard", 0.01, None)]


# Impacts.


def head_on() -> Reference:
    """Two tiles on a line."""
    scene = build("Head-on impact", [tile(0, 0, vx=0.3), tile(1.3 * WIDTH, 0, vx=-0.1)])
    truth = motion.head_on(MASS, 0.3, MASS, -0.1, scene.material.restitution)

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        before = state(s)[3:]
        go(s, 0.1)
        miss = max(abs(s.vx[0] - truth[0]), abs(s.vx[1] - truth[1]))
        return {"velocity": miss / 0.4, "energy": gained(s, before)}

    return Reference("head-on", "head-on impact", scene, 0.1, measure,
                     {"velocity": 1e-6, "energy": 1e-12})


def _corner_hit(mu: float, e: float, angle: float, v: complex,
                held: bool) -> tuple[list[PlacedTile], list[tuple[complex, float]], str]:
    """A tile that does not turn flies with its lowest corner at the N face of another.

    Returns the tiles at a gap that lasts 0.05 s, the changes of momentum (N s, N m s) of both
    by Routh's process, and its mode.
    """
    arm = cmath.rect(WIDTH * math.sqrt(0.5), angle - 0.75 * math.pi)
    point = complex(0.1 * WIDTH, 0.5 * WIDTH)
    struck = (math.inf, math.inf) if held else (MASS, INERTIA)
    # Tangent: a quarter turn from the normal +y.
    b = impact.inverse_inertia(*struck, (-point.real, point.imag), MASS, INERTIA,
                               (-arm.real, arm.imag))
    hit = impact.routh(v.imag, -v.real, *b, mu, e)
    push = complex(-hit.tangential, hit.normal)
    start = point - arm - 0.05 * v
    tiles = [tile(0, 0, held=held), tile(start.real, start.imag, angle, v.real, v.imag)]
    changes = [(sign * push, sign * (lever.conjugate() * push).imag)
               for sign, lever in ((-1, point), (1, arm))]
    return tiles, changes, hit.mode


OBLIQUE = {  # friction, restitution, angle of the nearer edge, velocity
    "sliding": (0.1, 0.8, 0.63, complex(-0.05, -0.36)),
    "C-sticking": (1.0, 0.5, 0.6, complex(-0.18, -0.12)),
    "R-sticking": (0.5, 0.8, 0.46, complex(-0.33, -0.27)),
    "C-reversed": (0.1, 0.2, 0.53, complex(0.09, -0.13)),
    "R-reversed": (0.1, 0.5, 0.59, complex(0.11, -0.11)),
}


def oblique(mode: str, held: bool) -> Reference:
    """One corner on a face, against Routh's process."""
    mu, e, angle, v = OBLIQUE[mode]
    tiles, changes, found = _corner_hit(mu, e, angle, v, held)
    if found != mode:
        raise ValueError(f"{mode} is {found}")
    scene = build(f"Oblique impact, {mode}", tiles, material=body(friction=mu, restitution=e))

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        before = state(s)[3:]
        go(s, 4 / 60)  # the other corners are still far
        change = state(s)[3:] - before
        size = abs(changes[1][0])
        return {"energy": gained(s, before), "impulse": max(
            max(abs(MASS * complex(*change[:2, i]) - changes[i][0]) / size,
                abs(INERTIA * change[2, i] - changes[i][1]) / (size * WIDTH))
            for i in ((1,) if held else (0, 1)))}

    name = f"oblique-{mode}{'-held' if held else ''}".lower()
    return Reference(name, scene.title.lower(), scene, 0.1, measure,
                     {"impulse": 1e-6, "energy": 1e-12})


def rocking_drop(mu: float = 1.0, tilt: float = 0.2) -> Reference:
    """A tilted (rad) tile falls onto its face, about a corner that sticks; Housner's first
    impact."""
    load = 0.005  # N: slow enough for a substep to see it land
    fall = rotation.rocking_fall(load, MASS, WIDTH, tilt)
    hit = rotation.rocking_impact(fall.spin, MASS, WIDTH, mu)
    wall = Reactor("rectangle", width=0.4, height=0.4, friction=mu, restitution=0.0)
    # Tilted clockwise: it stands on its right lower corner and falls counter-clockwise.
    arm = cmath.rect(WIDTH * math.sqrt(0.5), 0.75 * math.pi - tilt)
    scene = build("Rocking square", [tile(arm.real, arm.imag - 0.2, -tilt)], reactor=wall,
                  material=body(restitution=0.0), drive=Drive("constant", (0.0, -load), 0.0))

    peak = brentq(lambda t: load * WIDTH * (math.cos(t) + math.sin(t) - 1.0)
                  - 2.0 / 3.0 * MASS * (WIDTH * hit.spin) ** 2, 0.0, 0.5)

    def measure(make: Make, scene: Scene) -> Errors:
        s, most = make(scene), 0.0
        for _ in range(round(0.4 / s.h)):
            s.advance(1)
            most = max(most, float(s.omega[0]))
            if s.omega[0] < 0.7 * most and most > 0.5 * fall.spin:
                break
        # Back to where it lay flat, if it rocks on, from two steps in which nothing hits.
        s.advance(1)
        angle, later = float(s.angle[0]), float(s.omega[0])
        s.advance(1)
        slowing = (later - float(s.omega[0])) / s.h
        after = math.sqrt(max(later**2 + 2.0 * slowing * angle, 0.0)) if later > 0.0 else later
        top = angle
        for _ in range(round(0.2 / s.h)):
            s.advance(1)
            top = max(top, float(s.angle[0]))
        return {"spin": relative(after, hit.spin), "next tilt": relative(top, peak)}

    return Reference("rock-fall", "rocking square from rest", scene, 0.4, measure, {"spin": 1e-2})


def rocking_impact(mu: float) -> Reference:
    """A tile that flies as if it turned about its right corner lands on the left one."""
    spin, lead = 2.0, 0.05  # rad/s; s of free flight
    hit = rotation.rocking_impact(spin, MASS, WIDTH, mu)
    wall = Reactor("rectangle", width=0.4, height=0.4, friction=mu, restitution=0.0)
    half = 0.5 * WIDTH
    scene = build(f"Rocking impact, friction {mu:g}",
                  [tile(half * spin * lead, half - 0.2 + half * spin * lead, -spin * lead,
                        -half * spin, -half * spin, spin)],
                  reactor=wall, material=body(restitution=0.0))

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        go(s, lead + 1 / 60)  # the tile leaves the ground again, or slides on it
        after = float(s.omega[0])
        slip = float(s.vx[0]) + half * after
        size = spin * half
        return {"spin": abs(after - hit.spin) / spin, "slip": abs(slip - hit.slip) / size}

    return Reference(f"rock-{mu:g}", scene.title.lower(), scene, 0.1, measure,
                     {"spin": 1e-2, "slip": 1e-2})


# Rest under load.


def row(n: int) -> Reference:
    """n tiles, 0.075 N each, pressed against a held one; floor and magnets off."""
    load = 0.075
    scene = build(f"Pressed row of {n}", [tile(0, 0, held=True),
                                          *(tile(-i * WIDTH, 0) for i in range(1, n + 1))],
                  drive=Drive("constant", (load, 0.0), 0.0), duration=2.0)
    truth = load * np.arange(n, 0, -1)

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        go(s, 2.0)
        apart = np.hypot(np.diff(s.x), np.diff(s.y)) / WIDTH - 1.0
        errors = {"place": float(np.abs(apart).max())}
        if hasattr(s, "contact_forces"):
            forces = s.contact_forces()
            total = np.zeros(n)
            for a, b, p, q in zip(forces["a"], forces["b"], forces["normal0"],
                                  forces["normal1"], strict=True):
                if abs(int(a) - int(b)) == 1:
                    total[min(a, b)] += p + q
            errors["force"] = float(np.abs(total / truth - 1.0).max())
        return errors

    return Reference(f"row-{n}", scene.title.lower(), scene, 2.0, measure,
                     {"place": 1e-4, "force": 1e-3}, slow=n not in ROWS)


def wall_rest() -> Reference:
    """A tile that a radial load presses into a round smooth wall."""
    radius, load = 0.06, 0.05
    seat = rotation.seat(radius, WIDTH)
    truth = rotation.wall_rest(radius, WIDTH, load)
    scene = build("Rest on a round wall", [tile(0, -seat)],
                  reactor=Reactor("circle", radius, friction=0.0),
                  drive=Drive("constant", (0.0, -load), 0.0))

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        go(s, 1.0)
        errors = {"place": max(math.hypot(s.x[0], s.y[0] + seat) / WIDTH, abs(s.angle[0]))}
        if hasattr(s, "contact_forces"):
            forces = s.contact_forces()
            normal = np.concatenate([forces["normal0"], forces["normal1"][forces["points"] == 2]])
            errors["force"] = float(np.abs(normal / truth - 1.0).max()) if normal.size == 2 else 1.0
        return errors

    return Reference("wall-rest", scene.title.lower(), scene, 1.0, measure,
                     {"place": 1e-4, "force": 1e-3})


def wall_slide() -> Reference:
    """A tile that turns along a round wall, held there by its inertia, slowed by friction."""
    radius, start, seconds = 0.2, 2.0, 1.0
    truth = rotation.wall_slide(radius, WIDTH, MASS, MU)
    d = truth.distance
    scene = build("Turning along a round wall", [tile(d, 0, 0, 0, d * start, start)],
                  reactor=Reactor("circle", radius, friction=MU, restitution=0.0),
                  material=body(restitution=0.0))

    def measure(make: Make, scene: Scene) -> Errors:
        s, turned, last = make(scene), 0.0, 0.0
        steps = max(1, round(1 / 60 / s.h))  # between looks, of which a turn needs a few
        for _ in range(round(seconds / (steps * s.h))):
            s.advance(steps)
            angle = math.atan2(s.y[0], s.x[0])
            turned += (angle - last + math.pi) % (2.0 * math.pi) - math.pi
            last = angle
        return {"turned": relative(turned, truth.turned(start, seconds)),
                "spin": relative(float(s.omega[0]), truth.spin(start, seconds)),
                "distance": abs(math.hypot(s.x[0], s.y[0]) - d) / WIDTH}

    return Reference("wall-slide", scene.title.lower(), scene, 1.0, measure,
                     {"turned": 1e-2, "spin": 1e-2})


# Bonded tiles.


def _row_of(n: int, omega: float) -> list[PlacedTile]:
    places = [(i - 0.5 * (n - 1)) * WIDTH for i in range(n)]
    return [tile(x, 0, 0, 0, omega * x, omega, kind=("black", "white")[i % 2])
            for i, x in enumerate(places)]


def flying(n: int, magnet: Magnet, name: str) -> Reference:
    """A bonded pair or row of three that spins: the spin at which it flies apart."""
    bond = magnets.bond_force(SETS["chessboard"][0].glues, SETS["chessboard"][1].glues,
                              law_of(magnet))
    truth = rotation.critical_spin(bond, MASS, WIDTH, n)
    scene = build(f"Spinning row of {n}, cut-off {100 * magnet.cutoff:g} cm",
                  _row_of(n, 0.99 * truth), types=SETS["chessboard"], magnet=magnet)

    def opens(make: Make, scene: Scene, omega: float) -> bool:
        s = make(replace(scene, free=Free((), tuple(_row_of(n, omega)))))
        for _ in range(30):
            go(s, 1 / 30)
            if np.hypot(np.diff(s.x), np.diff(s.y)).max() > 1.1 * WIDTH:
                return True
        return False

    def measure(make: Make, scene: Scene) -> Errors:
        low, high = 0.5 * truth, 1.5 * truth
        for _ in range(11):  # to 5e-4
            middle = 0.5 * (low + high)
            low, high = (low, middle) if opens(make, scene, middle) else (middle, high)
        return {"spin": relative(0.5 * (low + high), truth)}

    return Reference(name, scene.title.lower(), scene, 1.0, measure, {"spin": 1e-2})


@dataclass(frozen=True)
class Block:
    """A block of n x n tiles on an L-shaped seed, and the load that pulls it off.

    Mating pairs of magnets alone.  `angle` (rad) from the normal of a wall of the seed.
    """

    n: int
    angle: float = 0.0
    friction: float = 0.0  # tile-tile
    floor: bool = False

    def bracket(self) -> tuple[float, float]:
        """Loads (N a tile) at which slip can begin, and up to which a state of rest exists."""
        case = self.angle, self.n, BOND, self.friction, MU * MASS * GRAVITY * self.floor
        rest = scaling.critical_load(*case)
        return min(scaling.slip_onset(*case), rest), rest

    def scene(self, factor: float, rate: float = 0.0) -> Scene:
        """Under `factor` times the rest load; rising from there by `rate` of it in a second."""
        n, (_, rest) = self.n, self.bracket()
        kinds = ("black", "white")
        cells = [(i, -1) for i in range(-1, n)] + [(-1, j) for j in range(n)]
        tiles = [tile(i * WIDTH, j * WIDTH, kind=kinds[(i + j) % 2])
                 for j in range(n) for i in range(n)]
        load = rest * math.cos(self.angle), rest * math.sin(self.angle)
        where = f"{math.degrees(self.angle):g} deg, friction {self.friction:g}"
        return replace(
            build(f"Block of {n} x {n}, {where}{', floor' if self.floor else ''}", tiles,
                  types=SETS["chessboard"], magnet=MATING, floor=Floor() if self.floor else None,
                  material=body(friction=self.friction),
                  drive=Drive("user", module="ramp.py", function="ramp",
                              parameters=(*load, factor, rate, 10.0))),
            seed=Seed(tuple((i, j, kinds[(i + j) % 2]) for i, j in cells)),
            file=str(HERE / "block.toml"))

    def critical(self, make: Make, scene: Scene, span: float = 0.03, rate: float = 0.01) -> float:
        """Load over the rest load at which the block goes, in the scene's solver.

        The ramp begins `span` below the bracket and ends `span` above.  The block has let go of
        a wall once a tile has moved by 0.1 % of the width.  With the load rising on that takes
        (6 x m/(dF/dt))^(1/3), which is taken off; the magnets' pull back along the other wall
        leaves an error of at most 0.4 %.  1 + span if it holds.
        """
        slip, rest = self.bracket()
        begin = slip / rest - span
        run = replace(self.scene(begin, rate), solver=scene.solver)
        s = make(run)
        held = 2 * self.n + 1
        far = 1e-3 * WIDTH
        late = (6.0 * far * MASS / (rest * rate)) ** (1 / 3)
        stride, time = max(round(1 / 120 / s.h), 1), 0.25
        go(s, time)  # the load came on at once: let it settle
        x0, y0 = s.x[held:].copy(), s.y[held:].copy()
        while begin + rate * (time - late) < 1.0 + span:
            s.advance(stride)
            time += stride * s.h
            if np.hypot(s.x[held:] - x0, s.y[held:] - y0).max() > far:
                return begin + rate * (time - late)
        return 1.0 + span


def block(n: int, angle: float = 0.0, friction: float = 0.0, floor: bool = False) -> Reference:
    """The load that pulls a block off its seed."""
    case = Block(n, math.radians(angle), friction, floor)
    slip, rest = case.bracket()

    def measure(make: Make, scene: Scene) -> Errors:
        found = case.critical(make, scene)
        return {"load": max(slip / rest - found, found - 1.0, 0.0)}

    name = f"block-{n}-{angle:g}{'-friction' if friction else ''}{'-floor' if floor else ''}"
    scene = case.scene(slip / rest - 0.03, 0.01)
    return Reference(name, scene.title.lower(), scene, 1.0, measure, {"load": 1e-2},
                     steps=tuple(1 / m for m in (120, 240, 480, 960)), slow=n > 2)


BLOCKS = [(n, angle, friction, floor) for n in range(1, 11) for angle in (0.0, 22.5, 45.0)
          for friction, floor in ((0.0, False), (MU, False), (0.0, True), (MU, True))]

ROWS = (1, 2, 5, 10, 20)


def creep(seconds: float = 600.0, n: int = 10, factor: float = 0.9) -> Reference:
    """A bonded block held at a part of its critical load."""
    case = Block(n, 0.0, MU, True)

    def measure(make: Make, scene: Scene) -> Errors:
        s = make(scene)
        begin = state(s)[:3]
        go(s, 0.5)  # the load came on at once
        settled = state(s)[:3]
        go(s, seconds)
        found = []
        for moved in (state(s)[:3] - settled, settled - begin):
            found.append(float(max(np.hypot(moved[0], moved[1]).max() / WIDTH,
                                   np.abs(moved[2]).max())))
        return {"creep": found[0], "settling": found[1]}

    slip, rest = case.bracket()
    scene = replace(case.scene(factor * slip / rest), run=Run(seconds))
    return Reference(f"creep-{seconds:g}", f"block held at {factor:g} of its load", scene,
                     min(seconds, 2.0), measure, {"creep": 1e-6}, steps=(1 / 480,), slow=True)


def larger() -> list[Reference]:
    """The rest of the rows and blocks, and the creep of 600 s."""
    return [*(row(n) for n in range(1, 21) if n not in ROWS),
            *(block(*case) for case in BLOCKS if case[0] != 2), creep()]


def references() -> list[Reference]:
    """All reference scenes but those of :func:`larger`."""
    return [slide(), spin(), driven(), coupled(), *snaps(), head_on(),
            *(oblique(mode, held) for mode in OBLIQUE for held in (False, True)),
            rocking_drop(), rocking_impact(1.0), rocking_impact(0.45), rocking_impact(0.25),
            *(row(n) for n in ROWS), wall_rest(), wall_slide(),
            flying(2, Magnet(), "flying-pair"), flying(3, Magnet(), "flying-row"),
            flying(2, MATING, "flying-pair-mating"), flying(3, MATING, "flying-row-mating"),
            *(block(2, angle, friction, floor) for _, angle, friction, floor in BLOCKS[:12]),
            creep(2.0)]


def main(argv: Sequence[str] | None = None) -> int:
    """Write every reference scene as TOML."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.scenes",
                                     description="Write every reference scene as TOML.")
    parser.add_argument("folder", type=Path, help="where to")
    out = parser.parse_args(argv).folder
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(HERE / "ramp.py", out)
    for reference in [*references(), *larger()]:
        scene = replace(reference.scene, run=Run(max(reference.duration,
                                                     reference.scene.run.duration)))
        (out / f"{reference.name}.toml").write_text(dumps(scene), encoding="utf-8")
        print(out / f"{reference.name}.toml")
    return 0


if __name__ == "__main__":
    sys.exit(main())
