"""The stress suite: hard scenes, and what must hold in each.

    python -m tests.benchmarks.stress             every row, five minutes
    python -m tests.benchmarks.stress --fast      those of the fast tests, seconds
    python -m tests.benchmarks.stress NAME ...    some of them

A row is green if all numbers stay finite, tiles overlap each other and the wall by no more than
5 % of a width, none has passed what stands in its way, the energy of tiles and magnets rises by
no more than the drive's work (to 1 % of all that was exchanged), and a bad start is over, with
overlaps below 1 %, within the time stated.  A row that no method of this kind can follow is
marked beforehand with the limit that it breaks, and is green if it is refused with an error.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tbsa.errors import InputError
from tbsa.model.layout import Layout, initial_layout
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
)
from tbsa.model.simulation import Simulation, SimulationError
from tbsa.work.report import aligned
from tests.benchmarks.invariants import Watch

OVERLAP, ENERGY, RECOVERED = 0.05, 0.01, 0.01
W = Material().width
H = 1 / 480  # s, step unless a row has its own
GREY = (TileType("tile", (0, 0, 0, 0), "grey", 0),)
LOAD = 0.075  # N, about that of the paper's scenes
SHAKING = Drive("shaking", LOAD, 0.0, 0.33)


@dataclass(frozen=True)
class Row:
    """One hard scene."""

    name: str
    scene: Scene
    seconds: float
    layout: Layout | None = None  # where the scene's own start is not the one wanted
    recovery: float | None = None  # s, within which a bad start must be over
    limit: str = ""  # why the scene cannot be followed; "" if it can
    fast: bool = False
    every: int = 4  # steps between looks
    passed: Callable[[Simulation], bool] | None = None  # somebody is where nobody can come
    blind: bool = False  # too long to follow the drive's work: it has none, or damping wins


@dataclass(frozen=True)
class Outcome:
    """What a row did."""

    green: bool
    why: str  # "" if green
    overlap: float = 0.0  # widths
    outside: float = 0.0
    energy: float = 0.0
    wall: float = 0.0  # s


def solver(h: float = H) -> Solver:
    """Default settings at a step of `h` (s); a step has at most 0.1 s."""
    return Solver(step=h)


def tile(x: float, y: float, angle: float = 0.0, v: tuple[float, float] = (0.0, 0.0),
         spin: float = 0.0, kind: str = "tile", held: bool = False) -> PlacedTile:
    """A placed tile."""
    return PlacedTile(kind, (float(x), float(y)), float(angle), v, spin, held)


def crowd(n: int = 60, radius: float = 0.2, *, material: Material | None = None,
          magnet: Magnet | None = Magnet(), drive: Drive | None = SHAKING,  # noqa: B008
          floor: Floor | None = Floor(), h: float = H, wall: Reactor | None = None,  # noqa: B008
          tiles: Sequence[PlacedTile] = (), arm: int = 1) -> Scene:
    """A small version of the paper's scene: a seed, tiles at random, a round wall."""
    cells = [(0, 0, "black")] + [(dx * k, dy * k, ("black", "white")[k % 2])
                                 for k in range(1, arm + 1)
                                 for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return Scene(
        types=SETS["chessboard"], material=material or Material(), seed=Seed(tuple(cells)),
        reactor=wall or Reactor("circle", radius), magnet=magnet, drive=drive, floor=floor,
        free=Free((("black", n // 2), ("white", n - n // 2)), tuple(tiles)), solver=solver(h),
        record=Record(3600 * h, 3600 * h), run=Run(1.0))


def bare(tiles: Sequence[PlacedTile], *, h: float = H, material: Material | None = None,
         reactor: Reactor | None = None, types: tuple[TileType, ...] = GREY,
         **parts: Any) -> Scene:
    """Placed tiles and nothing else that is not asked for."""
    return Scene(types=types, material=material or Material(), reactor=reactor,
                 free=Free((), tuple(tiles)), solver=solver(h),
                 record=Record(3600 * h, 3600 * h), run=Run(1.0), **parts)


def packed(fraction: float, side: int, kinds: Sequence[str] = ("black", "white")
           ) -> tuple[list[PlacedTile], float]:
    """A square lattice of tiles that covers this part of a square box, and the box's width."""
    pitch = W / math.sqrt(fraction)
    places = (np.arange(side) - 0.5 * (side - 1)) * pitch
    return [tile(x, y, kind=kinds[(i + j) % 2]) for j, y in enumerate(places)
            for i, x in enumerate(places)], side * pitch


def overlapping(share: float, angle: float, n: int = 2) -> Layout:
    """A chain of n tiles, each overlapping the one before by `share` of a width along x."""
    k = np.arange(n)
    zero = np.zeros(n)
    return Layout(k * (1.0 - share) * W, zero.copy(), angle * (k % 2), zero.copy(), zero.copy(),
                  zero.copy(), np.zeros(n, np.int64), np.zeros(n, bool), np.zeros(n, bool))


def crushed(scene: Scene, share: float) -> Layout:
    """The scene's start with every free tile drawn towards the centre by a part of its way."""
    layout = initial_layout(scene)
    keep = np.where(layout.held, 1.0, 1.0 - share)
    return replace(layout, x=layout.x * keep, y=layout.y * keep)


def _scaled(width: float) -> Scene:
    """The crowd with lengths times l, and every force in proportion to the weight."""
    scale = width / W
    time_scale = math.sqrt(scale)
    body, magnet, h = Material(), Magnet(), H * time_scale
    return replace(
        crowd(h=h, wall=Reactor("circle", 0.2 * scale)),
        material=replace(body, width=width, mass=body.mass * scale**3,
                         linear_damping=body.linear_damping / time_scale,
                         angular_damping=body.angular_damping / time_scale,
                         restitution_threshold=body.restitution_threshold * time_scale),
        magnet=replace(magnet, alpha=magnet.alpha * scale**5, beta=magnet.beta * scale,
                       inset=magnet.inset * scale, cutoff=magnet.cutoff * scale),
        drive=replace(SHAKING, force=LOAD * scale**3, frequency=0.33 / time_scale),
        solver=replace(solver(h), tolerance=Solver().tolerance * time_scale))


def _limit(closing: float, h: float) -> str:
    """Why a scene in which two go at each other at such a speed (m/s) cannot be followed at steps
    of `h`; "" if it can.

    What comes nearer by more than a width in a substep can pass through one another.
    """
    travel = closing * h / Solver().substeps
    return f"a tile closes by up to {travel / W:.2f} w in a substep, > w" if travel > W else ""


def _stiff(scene: Scene) -> str:
    """Why a scene's bonds cannot be followed at its step; "" if they can.

    Leapfrog needs (w P)^2 <= 4 of a vibration of w, P between two looks at the forces.  A pair that
    slides by d is pulled back by F d/r: w^2 = 2 (F/r) (1/m + a^2/I), with the arm a of its magnets.
    """
    magnet, body, h = scene.magnet, scene.material, scene.solver.step
    assert magnet is not None
    assert scene.solver.substeps % 2 == 0  # two looks a step
    r, arm = 2.0 * magnet.inset, 0.5 * body.width - magnet.inset
    pull = magnet.alpha / (r + magnet.beta) ** 2
    turned = 2.0 * pull / r * (1.0 / body.mass + 6.0 * arm**2 / (body.mass * body.width**2)) * (
        0.5 * h) ** 2
    return f"bonds turn {math.sqrt(turned):.1f} rad between two forces, > 2" if turned > 4 else ""


def _fast_tile(speed: float, h: float, against: str) -> Row:
    """One tile at `speed` (m/s) at a wall, a held tile, or another one that comes as fast."""
    wall = Reactor("rectangle", width=1.0, height=0.4)
    tiles = {"wall": [tile(0, 0, 0.2, (speed, 0.1 * speed))],
             "held": [tile(0.3, 0, held=True), tile(0, 0.2 * W, 0.3, (speed, 0.0))],
             "other": [tile(-0.3, 0, 0.1, (speed, 0.0)), tile(0.3, 0.2 * W, 0.7, (-speed, 0.0))]}
    limit = _limit(math.hypot(speed, 0.1 * speed) if against == "wall" else
                   speed if against == "held" else 2.0 * speed, h)

    def passed(s: Simulation) -> bool:
        return bool((against == "held" and s.x[1] > 0.3) or (
            against == "other" and s.x[0] > s.x[1]))

    return Row(f"{speed:g} m/s at {against}, 1/{1 / h:.0f} s",
               bare(tiles[against], reactor=wall, h=h), 0.1, limit=limit, every=1,
               passed=passed, fast=against == "held" and h == 1 / 1920)


def _alignments() -> list[Row]:
    """Tiles that touch exactly, or meet exactly corner to corner."""
    q = 0.25 * math.pi
    d = W * math.sqrt(0.5)
    lattice = [tile(i * W, j * W, kind=("black", "white")[(i + j) % 2]) for i in range(-4, 5)
               for j in range(-4, 5)]
    scenes = {
        "corner on corner, head-on": [tile(-2 * d, 0, q, (0.3, 0)), tile(2 * d, 0, q, (-0.3, 0))],
        "corner on corner, touching": [tile(-d, 0, q), tile(d, 0, q, held=True)],
        "corners touch along a diagonal": [tile(0, 0), tile(W, W), tile(2 * W, 2 * W)],
        "corner on the middle of a face": [tile(0, 0, held=True),
                                           tile(0, 0.5 * W + 1.5 * d, q, (0, -0.3))],
        "edge on edge, head-on": [tile(-W, 0, 0, (0.3, 0)), tile(W, 0, 0, (-0.3, 0))],
        "edges in line, sliding past": [tile(-2 * W, W, 0, (0.3, 0)), tile(0, 0, held=True)],
        "half a brick": [tile(0, 0, held=True), tile(0.5 * W, W), tile(-0.5 * W, W),
                         tile(0, 2 * W)],
    }
    push = Drive("constant", (0.03, -0.06), 0.0)
    rows = [Row(f"aligned: {name}", bare(tiles, drive=push), 1.0, every=1, fast=True)
            for name, tiles in scenes.items()]
    rows.append(Row("aligned: 81 on a lattice, magnets, shaken", bare(
        lattice, types=SETS["chessboard"], magnet=Magnet(), drive=SHAKING, floor=Floor(),
        reactor=Reactor("circle", 0.25)), 2.0, fast=True))
    rows.append(Row("aligned: 81 on a lattice, pressed", bare(
        [replace(each, type="tile") for each in lattice], drive=push,
        reactor=Reactor("rectangle", width=9 * W, height=9 * W)), 2.0))
    return rows


def _counts() -> list[Row]:
    rows = []
    for n, seconds in ((1, 1.5), (2, 1.5), (10, 1.5), (10_000, 0.5), (100_000, 0.05)):
        radius = max(0.06, math.sqrt(n * W * W / (0.4 * math.pi)))
        rows.append(Row(f"{n} tiles", replace(
            crowd(n, radius, arm=1), seed=None,
            free=Free((("black", n // 2), ("white", n - n // 2)))), seconds,
            every=4 if n < 1000 else 24, fast=n <= 10))
    return rows


def rows() -> list[Row]:
    """Every row of the suite."""
    found: list[Row] = []
    unicycle = Drive("unicycle", LOAD, 3e-3, 0.1)
    for n in (30, 60, 120, 240, 480, 960, 1920, 3840):
        found.append(Row(f"step 1/{n}, shaken", crowd(h=1 / n), 2.0, every=max(1, n // 120),
                         fast=n in (30, 60, 480), limit=_stiff(crowd(h=1 / n))))
    found.append(Row("unicycle, its full torque", crowd(drive=unicycle), 3.0, fast=True))
    found.append(Row("unicycle, step 1/1920", crowd(drive=unicycle, h=1 / 1920), 5.0, every=16))
    # Times 100 a pair in contact swings at sqrt(2 F'/m) = 740 rad/s: also at a step for that.
    for factor, h in ((0.01, H), (0.1, H), (10.0, H), (100.0, H), (100.0, 1 / 1920)):
        found.append(Row(f"magnets x {factor:g}, 1/{1 / h:.0f} s",
                         crowd(magnet=Magnet(alpha=factor * Magnet().alpha), h=h), 2.0,
                         every=round(4 * H / h), fast=factor == 100.0 and h == H))
    for mu in (0.0, 0.5, 1.0, 2.0):
        found.append(Row(f"friction {mu:g} everywhere", crowd(
            material=Material(friction=mu), floor=Floor(linear=mu, angular=mu) if mu else None,
            wall=Reactor("circle", 0.2, friction=mu)), 2.0, fast=mu in (0.0, 2.0)))
    for e in (0.0, 0.5, 0.9, 1.0):
        found.append(Row(f"restitution {e:g}", crowd(
            material=Material(restitution=e), wall=Reactor("circle", 0.2, restitution=e)), 2.0,
            fast=e == 1.0))
    for factor in (0.1, 10.0, 30.0, 100.0):
        force = factor * LOAD
        # Across the reactor from rest: v = sqrt(2 F D/m).
        fastest = math.sqrt(2.0 * force / Material().mass * 0.4)
        h = next(h for h in (1 / 480, 1 / 960, 1 / 1920) if fastest * h < 0.5 * W)
        found.append(Row(f"load x {factor:g}, 1/{1 / h:.0f} s", crowd(
            drive=replace(SHAKING, force=force), h=h), 2.0, every=round(H / h) * 4,
            fast=factor == 10.0))
    fastest = math.sqrt(2.0 * 100 * LOAD / Material().mass * 4.0)
    found.append(Row("load x 100 over 4 m, 1/480 s", bare(
        [tile(-2.0, 0)], drive=Drive("constant", (100 * LOAD, 0.0), 0.0),
        reactor=Reactor("rectangle", width=4.2, height=0.2)), 1.0,
        limit=_limit(fastest, H)))
    for share in (0.1, 0.25, 0.5):
        for angle in (0.0, 0.3, 0.25 * math.pi):
            layout = overlapping(share, angle)
            found.append(Row(f"two overlap by {share:g} w, turned {angle:.1f}", bare(
                [tile(i, 0) for i in range(2)]), 2.0, layout=layout, recovery=1.0, every=1,
                fast=share == 0.5))
        found.append(Row(f"chain of 8 overlaps by {share:g} w", bare(
            [tile(i, 0) for i in range(8)]), 2.0, layout=overlapping(share, 0.0, 8),
            recovery=1.0, every=1))
    for floor in (None, Floor()):
        scene = crowd(floor=floor, drive=None, magnet=None, radius=0.25)
        found.append(Row(f"crowd drawn together by a third{', dry floor' if floor else ''}",
                         scene, 3.0, layout=crushed(scene, 0.33), recovery=2.0,
                         fast=floor is not None))
    for h in (1 / 480, 1 / 1920, 1 / 3840):
        found += [_fast_tile(50.0, h, "wall"), _fast_tile(50.0, h, "held")]
    found.append(_fast_tile(50.0, 1 / 3840, "other"))
    for fraction in (0.6, 0.8, 0.9, 0.98):
        tiles, width = packed(fraction, 10)
        found.append(Row(f"area fraction {fraction:g}, shaken", bare(
            tiles, types=SETS["chessboard"], magnet=Magnet(), floor=Floor(), drive=SHAKING,
            reactor=Reactor("rectangle", width=width, height=width)), 3.0, fast=fraction == 0.98))
    found.append(Row("random placement to its limit", crowd(70, 0.21), 2.0))
    held = [tile(0.1 * math.cos(k), 0.1 * math.sin(k), 0.7 * k, held=True, kind="black")
            for k in range(6)]
    found.append(Row("six held tiles inside a crowd", crowd(50, 0.2, tiles=held), 2.0, fast=True))
    found.append(Row("six held tiles inside a crowd, unicycle",
                     crowd(50, 0.2, tiles=held, drive=unicycle), 5.0))
    found.append(Row("pushed to the wall for 600 s", crowd(
        drive=Drive("constant", (LOAD, 0.0), 0.0)), 600.0, every=480))
    found.append(Row("pushed to a smooth wall without a floor for 60 s", crowd(
        floor=None, material=Material(friction=0.0), wall=Reactor("circle", 0.2, friction=0.0),
        drive=Drive("constant", (LOAD, 0.0), 0.0)), 60.0, every=48))
    elastic = Material(linear_damping=0.0, angular_damping=0.0, restitution=1.0, friction=0.0,
                       restitution_threshold=0.0)
    found.append(Row("1e7 steps of five elastic tiles", bare(
        [tile(0.06 * k - 0.12, 0.01 * k, 0.3 * k, (0.3 - 0.1 * k, 0.2)) for k in range(5)],
        material=elastic, reactor=Reactor("rectangle", width=0.4, height=0.2, friction=0.0,
                                          restitution=1.0)), 1e7 * H, blind=True))
    found.append(Row("1e7 steps of a loaded pair", bare(
        [tile(0, 0, kind="black", held=True), tile(W, 0, kind="white")], types=SETS["chessboard"],
        magnet=Magnet(), floor=Floor(), drive=Drive("constant", (0.1, 0.02), 0.0)), 1e7 * H,
        blind=True))
    found += _alignments()
    found += _counts()
    found += [Row("tiles of 1 mm", _scaled(1e-3), 0.4, fast=True),
              Row("tiles of 1 m", _scaled(1.0), 12.0)]
    return found


def run(row: Row) -> Outcome:
    """Run a row and judge it."""
    start = time.perf_counter()
    try:
        if row.layout is None:
            row.scene.validate()
        simulation = Simulation(row.scene, row.layout)
        watch = Watch(simulation, every=row.every)
        if row.blind:
            why = _blind(row, simulation)
            return Outcome(not why, why, watch.overlap, watch.outside, 0.0,
                           time.perf_counter() - start)
        why = ""
        if row.recovery is not None:
            why = _recover(row, watch)
        watch.advance(round(row.seconds / simulation.h) - watch.steps)
    except (InputError, SimulationError) as error:
        wall = time.perf_counter() - start
        return Outcome(bool(row.limit), "" if row.limit else f"refused: {error}", wall=wall)
    faults = [why] if why else []
    if row.limit:
        faults.append(f"not refused ({row.limit})")
    else:
        faults += _faults(watch)
        if row.passed is not None and row.passed(simulation):
            faults.append("tiles went through each other")
    return Outcome(not faults, "; ".join(faults), watch.overlap, watch.outside, watch.energy,
                   time.perf_counter() - start)


def _faults(watch: Watch) -> list[str]:
    if not watch.finite:
        return ["not finite"]
    checks: list[tuple[str, float, float]] = [
        ("overlap", watch.overlap, OVERLAP), ("outside", watch.outside, OVERLAP),
        ("energy gained", watch.energy, ENERGY)]
    return [f"{name} {value:.2g}" for name, value, most in checks if value > most]


def _recover(row: Row, watch: Watch) -> str:
    """Wait until overlaps are below 1 %; the start must not throw tiles about."""
    s, fastest = watch.simulation, 0.0
    assert row.recovery is not None
    done = math.inf
    while watch.steps * s.h < row.recovery:
        watch.advance(1)
        fastest = max(fastest, float(np.hypot(s.vx, s.vy).max()))
        watch.look()
        if watch.depths[-1] <= RECOVERED:
            done = watch.steps * s.h
            break
    left = watch.depths[-1]
    watch.restart()
    if done == math.inf:
        return f"overlap {left:.2g} after {row.recovery:g} s"
    # Nothing but the overlap was put in; half a width in 0.1 s is the most it may do.
    return f"thrown apart at {fastest:.2g} m/s" if fastest > 0.15 else ""


def _blind(row: Row, simulation: Simulation) -> str:
    """Many steps at once: energy must not rise where no drive works."""
    watch = Watch(simulation)
    first = simulation.kinetic_energy()
    chunk = 100_000
    for _ in range(round(row.seconds / simulation.h) // chunk):
        simulation.advance(chunk)
        watch.look()
        if not watch.finite:
            return "not finite"
        bound = max(first * (1.0 + 1e-6), 1e-9)
        if simulation.kinetic_energy() > bound:
            return f"kinetic energy {simulation.kinetic_energy():.3g} of {first:.3g} J"
        if watch.overlap > OVERLAP:
            return f"overlap {watch.overlap:.2g}"
        if watch.outside > OVERLAP:
            return f"outside {watch.outside:.2g}"
    return ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run rows and print the table; returns 1 where one is not green."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.stress",
                                     description="The stress suite.")
    parser.add_argument("row", nargs="*", help="rows whose name holds this (default: all)")
    parser.add_argument("--fast", action="store_true", help="only those of the fast tests")
    arguments = parser.parse_args(argv)
    chosen = [row for row in rows() if (row.fast or not arguments.fast) and (
        not arguments.row or any(part in row.name for part in arguments.row))]
    lines = []
    for row in chosen:
        outcome = run(row)
        lines.append([row.name, "green" if outcome.green else "RED", f"{100 * outcome.overlap:.2g}",
                      f"{100 * outcome.outside:.2g}", f"{outcome.energy:.1e}",
                      f"{outcome.wall:.1f}", outcome.why or row.limit])
        print("  ".join(lines[-1]), file=sys.stderr, flush=True)
    print("\n".join(aligned(("row", "", "overlap % w", "outside % w", "energy gained", "wall s",
                             "why, or the limit that it breaks"), lines)))
    red = sum(line[1] == "RED" for line in lines)
    print(f"\n{len(lines) - red} of {len(lines)} rows green, "
          f"{sum(bool(row.limit) for row in chosen)} of them marked as not representable")
    return 1 if red else 0


if __name__ == "__main__":
    sys.exit(main())
