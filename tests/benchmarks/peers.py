"""The reference scenes through the engines that a Python user would otherwise take.

    pip install -e ".[bench]"
    python -m tests.benchmarks.peers              every scene but larger blocks, half an hour
    python -m tests.benchmarks.peers slide row-10
    python -m tests.benchmarks.peers --saved      the table of the saved results

Box2D 2.3.10 (PyPI ``box2d``) and Pymunk 7.3, each over steps and its own iterations.  Their run
time is taken as engine alone (inside its step) and with the Python that a user has to write:
magnets, drive, damping.  Ours alone is the compiled function that does all steps, called once, less
what a call for no step takes; our steps begin at 1/10 s.  A machine's clock can change by half
between the sweeps of ours and of theirs: both are timed again, in turn, and the best time counts.

Floor friction is what their manuals offer: friction joints; pivot and gear joints with a bounded
force.  Settings that help them are chosen: Box2D's skin is taken off the tiles, at two scales of
length; Pymunk's slop is 1e-4 of a width.

Prints, for every scene, our speed at their error and their error at our run time over ours; unless
scenes are named, writes ``tests/benchmarks/results/peers.json``, which ``python -m figures pareto``
draws.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from figures.pareto import newest
from tbsa.model.layout import initial_layout
from tbsa.model.scene import Scene
from tbsa.model.simulation import Simulation, floor_limits
from tbsa.work.report import aligned
from tests.benchmarks.accuracy import RESULTS, Row, clock, save, sweep
from tests.benchmarks.invariants import drive_loads, glues_of, law_of
from tests.benchmarks.ramp import ramp
from tests.benchmarks.scenes import Reference, at_step, references
from theory.magnets import fade

Floats = NDArray[np.float64]
SEGMENTS = 720  # of a round wall, which these engines have not got
ROUNDS = 2  # after the sweeps
LEFT_OUT = {"coupled": "no friction that couples sliding and turning"}


class Magnets:
    """Forces of all magnets in NumPy, as a user would write them."""

    def __init__(self, scene: Scene, kinds: NDArray[np.int64]) -> None:
        magnet = scene.magnet
        self.labels = glues_of(scene, kinds).ravel()
        self.on = magnet is not None and bool(self.labels.any())
        if magnet is None or not self.on:
            return
        self.alpha, self.beta, self.cutoff = magnet.alpha, magnet.beta, magnet.cutoff
        self.mismatch, self.switch = float(magnet.mismatch), magnet.switch
        self.offset = 0.5 * scene.material.width - magnet.inset
        near = 0.95 * magnet.cutoff
        assert math.isclose(fade(near, law_of(magnet, scene.material.width)),
                            self.fade(np.array([near]))[0], rel_tol=1e-12)

    def fade(self, r: Floats) -> Floats:
        """The switch at the cut-off."""
        begin = (1.0 - self.switch) * self.cutoff
        u = np.clip((r - begin) / (self.cutoff - begin), 0.0, 1.0)
        return 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    def __call__(self, x: Floats, y: Floats, angle: Floats) -> tuple[Floats, Floats, Floats]:
        """Forces and torques on every tile (N, N, N m)."""
        n = x.size
        if not self.on:
            return np.zeros(n), np.zeros(n), np.zeros(n)
        turn = angle[:, None] + 0.5 * math.pi * np.array([1, 0, -1, 2])
        arms = self.offset * np.stack([np.cos(turn), np.sin(turn)], axis=-1).reshape(-1, 2)
        places = np.repeat(np.stack([x, y], axis=1), 4, axis=0) + arms
        if n == 2:
            i, j = np.divmod(np.arange(16), 4)
            j = j + 4
        else:
            i, j = cKDTree(places).query_pairs(self.cutoff, output_type="ndarray").T
            other = i // 4 != j // 4
            i, j = i[other], j[other]
        a, b = self.labels[i], self.labels[j]
        p = np.where((a == 0) | (b == 0), 0.0, np.where(a == -b, 1.0, self.mismatch))
        d = places[j] - places[i]
        r = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-12)
        pull = (p * self.fade(r) * self.alpha / (r + self.beta) ** 2 / r)[:, None] * d
        torque_i = arms[i, 0] * pull[:, 1] - arms[i, 1] * pull[:, 0]
        torque_j = arms[j, 0] * pull[:, 1] - arms[j, 1] * pull[:, 0]
        i, j = i // 4, j // 4
        count = np.bincount
        return (count(i, pull[:, 0], n) - count(j, pull[:, 0], n),
                count(i, pull[:, 1], n) - count(j, pull[:, 1], n),
                count(i, torque_i, n) - count(j, torque_j, n))


class Peer:
    """What both engines share: the loads, and the arrays that a measure reads."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.layout = scene, initial_layout(scene)
        self.h = scene.solver.step / scene.solver.substeps
        self.n, self.done, self.engine_time = self.layout.x.size, 0, 0.0
        self.magnets = Magnets(scene, self.layout.type)
        self.loaded = self.magnets.on or scene.drive is not None
        self.free = np.flatnonzero(~self.layout.held)

    def advance(self, substeps: int) -> None:
        """Apply the loads and step, again and again."""
        for _ in range(substeps):
            if self.loaded:
                self.apply(*self.loads())
            start = time.perf_counter()
            self.step()
            self.engine_time += time.perf_counter() - start
            self.after()
            self.done += 1

    def loads(self) -> tuple[Floats, Floats, Floats]:
        """Magnets and drive (N, N, N m)."""
        x, y, angle = self.places()
        fx, fy, torque = self.magnets(x, y, angle)
        drive, now = self.scene.drive, (self.done + 0.5) * self.h
        if drive is None:
            return fx, fy, torque
        if drive.kind == "user":
            empty = np.zeros(self.n)
            ramp(now, drive.parameters, x, y, angle, empty, empty, empty, empty, empty, fx, fy,
                 torque)
            return fx, fy, torque
        push = drive_loads(self.scene, self.layout.type, now, angle)
        return fx + push[0], fy + push[1], torque + push[2]

    def places(self) -> tuple[Floats, Floats, Floats]:
        """x, y, angle of all tiles (m, rad)."""
        raise RuntimeError("an engine has places")

    def twists(self) -> tuple[Floats, Floats, Floats]:
        """vx, vy, omega of all tiles (m/s, rad/s)."""
        raise RuntimeError("an engine has twists")

    def apply(self, fx: Floats, fy: Floats, torque: Floats) -> None:
        """Hand the loads to the engine."""

    def step(self) -> None:
        """One step of the engine."""

    def after(self) -> None:
        """What Python does after a step."""

    x = property(lambda self: self.places()[0])
    y = property(lambda self: self.places()[1])
    angle = property(lambda self: self.places()[2])
    vx = property(lambda self: self.twists()[0])
    vy = property(lambda self: self.twists()[1])
    omega = property(lambda self: self.twists()[2])


class Box2D(Peer):
    """Box2D with lengths times `scale`, and its velocity and position iterations."""

    def __init__(self, scene: Scene, scale: float, velocity: int, position: int) -> None:
        import Box2D as b2

        super().__init__(scene)
        self.scale, self.velocity, self.position = scale, velocity, position
        body, wall, layout = scene.material, scene.reactor, self.layout
        self.world = world = b2.b2World(gravity=(0, 0), doSleep=False)
        # Shapes have a skin, and rest half a slop deep in each other's.
        skin = b2.b2_polygonRadius - 0.5 * b2.b2_linearSlop
        half = 0.5 * body.width * scale - skin
        density = body.mass / (2.0 * half) ** 2
        ground = world.CreateStaticBody()
        force, torque = floor_limits(scene)
        self.bodies = []
        for i in range(self.n):
            fixture = b2.b2FixtureDef(shape=b2.b2PolygonShape(box=(half, half)), density=density,
                                      friction=body.friction, restitution=body.restitution)
            make = world.CreateStaticBody if layout.held[i] else world.CreateDynamicBody
            each = make(position=(layout.x[i] * scale, layout.y[i] * scale),
                        angle=layout.angle[i], fixtures=fixture)
            if not layout.held[i]:
                each.mass, each.inertia = body.mass, body.mass * (body.width * scale) ** 2 / 6.0
                each.linearVelocity = layout.vx[i] * scale, layout.vy[i] * scale
                each.angularVelocity = layout.omega[i]
                each.linearDamping, each.angularDamping = (body.linear_damping,
                                                           body.angular_damping)
                each.bullet = True
                if scene.floor is not None:
                    world.CreateFrictionJoint(bodyA=ground, bodyB=each, anchor=each.position,
                                              maxForce=force * scale,
                                              maxTorque=torque * scale * scale)
            self.bodies.append(each)
        self.moving = [self.bodies[i] for i in self.free]
        if wall is not None:
            friction = wall.friction**2 / body.friction if body.friction > 0.0 else 0.0
            if wall.shape == "circle":
                reach = wall.radius * scale + skin
                turn = np.linspace(0.0, 2.0 * math.pi, SEGMENTS + 1)
                corners = [(reach * math.cos(t), reach * math.sin(t)) for t in turn]
            else:
                u, v = 0.5 * wall.width * scale + skin, 0.5 * wall.height * scale + skin
                corners = [(u, v), (-u, v), (-u, -v), (u, -v), (u, v)]
            for a, b in pairwise(corners):
                ground.CreateEdgeFixture(vertices=[a, b], friction=friction,
                                         restitution=wall.restitution)

    def places(self) -> tuple[Floats, Floats, Floats]:
        values = np.array([(*b.position, b.angle) for b in self.bodies], float)
        return values[:, 0] / self.scale, values[:, 1] / self.scale, values[:, 2]

    def twists(self) -> tuple[Floats, Floats, Floats]:
        values = np.array([(*b.linearVelocity, b.angularVelocity) for b in self.bodies], float)
        return values[:, 0] / self.scale, values[:, 1] / self.scale, values[:, 2]

    def apply(self, fx: Floats, fy: Floats, torque: Floats) -> None:
        fx, fy, torque = fx * self.scale, fy * self.scale, torque * self.scale**2
        for i, body in zip(self.free.tolist(), self.moving, strict=True):
            body.ApplyForceToCenter((fx[i], fy[i]), True)
            body.ApplyTorque(torque[i], True)

    def step(self) -> None:
        self.world.Step(self.h, self.velocity, self.position)


class Pymunk(Peer):
    """Pymunk (Chipmunk) in centimetres, with its iterations."""

    def __init__(self, scene: Scene, iterations: int) -> None:
        import pymunk

        super().__init__(scene)
        self.scale = scale = 100.0
        body, wall, layout = scene.material, scene.reactor, self.layout
        self.space = space = pymunk.Space()
        space.iterations = iterations
        space.collision_slop = 1e-4 * body.width * scale
        force, torque = floor_limits(scene)
        friction, bounce = math.sqrt(body.friction), math.sqrt(body.restitution)
        half = 0.5 * body.width * scale
        box = [(-half, -half), (half, -half), (half, half), (-half, half)]
        self.bodies = []
        for i in range(self.n):
            if layout.held[i]:
                each = pymunk.Body(body_type=pymunk.Body.STATIC)
            else:
                each = pymunk.Body(body.mass, body.mass * (body.width * scale) ** 2 / 6.0)
                each.velocity = layout.vx[i] * scale, layout.vy[i] * scale
                each.angular_velocity = layout.omega[i]
            each.position, each.angle = (layout.x[i] * scale, layout.y[i] * scale), layout.angle[i]
            shape = pymunk.Poly(each, box)
            shape.friction, shape.elasticity = friction, bounce
            space.add(each, shape)
            if not layout.held[i] and scene.floor is not None:
                pivot = pymunk.PivotJoint(space.static_body, each, each.position, (0, 0))
                gear = pymunk.GearJoint(space.static_body, each, 0.0, 1.0)
                pivot.max_bias = gear.max_bias = 0.0
                pivot.max_force, gear.max_force = force * scale, torque * scale * scale
                space.add(pivot, gear)
            self.bodies.append(each)
        self.moving = [self.bodies[i] for i in self.free]
        if wall is not None:
            if wall.shape == "circle":
                turn = np.linspace(0.0, 2.0 * math.pi, SEGMENTS + 1)
                corners = [(wall.radius * scale * math.cos(t), wall.radius * scale * math.sin(t))
                           for t in turn]
            else:
                u, v = 0.5 * wall.width * scale, 0.5 * wall.height * scale
                corners = [(u, v), (-u, v), (-u, -v), (u, -v), (u, v)]
            for a, b in pairwise(corners):
                segment = pymunk.Segment(space.static_body, a, b, 0.0)
                segment.friction = wall.friction / friction if friction > 0.0 else 0.0
                segment.elasticity = wall.restitution / bounce if bounce > 0.0 else 0.0
                space.add(segment)
        self.damping = (math.exp(-body.linear_damping * self.h),
                        math.exp(-body.angular_damping * self.h))

    def places(self) -> tuple[Floats, Floats, Floats]:
        values = np.array([(*b.position, b.angle) for b in self.bodies], float)
        return values[:, 0] / self.scale, values[:, 1] / self.scale, values[:, 2]

    def twists(self) -> tuple[Floats, Floats, Floats]:
        values = np.array([(*b.velocity, b.angular_velocity) for b in self.bodies], float)
        return values[:, 0] / self.scale, values[:, 1] / self.scale, values[:, 2]

    def apply(self, fx: Floats, fy: Floats, torque: Floats) -> None:
        fx, fy, torque = fx * self.scale, fy * self.scale, torque * self.scale**2
        for i, body in zip(self.free.tolist(), self.moving, strict=True):
            body.force, body.torque = (fx[i], fy[i]), torque[i]

    def step(self) -> None:
        self.space.step(self.h)

    def after(self) -> None:
        linear, angular = self.damping
        if linear != 1.0 or angular != 1.0:
            for body in self.moving:
                body.velocity *= linear
                body.angular_velocity *= angular


Settings = tuple[str, Callable[[Scene], Peer]]


def settings() -> list[Settings]:
    """Every peer with every choice of its iterations and of Box2D's scale."""
    found: list[Settings] = []
    for scale in (100.0, 1000.0):
        for velocity, position in ((8, 3), (50, 20)):
            def box2d(scene: Scene, scale: float = scale, velocity: int = velocity,
                      position: int = position) -> Peer:
                return Box2D(scene, scale, velocity, position)

            found.append((f"box2d, {scale:g} units/m, {velocity} and {position} iterations",
                          box2d))
    for iterations in (10, 100):
        def pymunk(scene: Scene, iterations: int = iterations) -> Peer:
            return Pymunk(scene, iterations)

        found.append((f"pymunk, {iterations} iterations", pymunk))
    return found


def engine_clock(make: Callable[[Scene], Peer], scene: Scene, seconds: float, *,
                 least: float = 0.05) -> tuple[float, float]:
    """Wall time (s) inside the engine and in all, of the best of a few runs."""
    best, spent = (math.inf, math.inf), 0.0
    while spent < least:
        s = make(scene)
        start = time.perf_counter()
        s.advance(round(seconds / s.h))
        took = time.perf_counter() - start
        best = min(best[0], s.engine_time), min(best[1], took)
        spent += max(took, 1e-3)
    return best


def peer_sweep(reference: Reference) -> list[Row]:
    """Errors and run times of both engines on one scene."""
    rows = []
    for name, make in settings():
        for h in reference.steps:
            scene = at_step(reference.scene, h, substeps=1)
            try:
                errors = reference.measure(make, scene)
                error = float(errors[reference.quantity])
            except (ValueError, FloatingPointError, RuntimeError):
                error = math.inf  # thrown about so far that the truth cannot go on from there
            alone, whole = engine_clock(make, scene, reference.duration)
            rows.append({"scene": reference.name, "engine": name, "step": h,
                         "error": error if math.isfinite(error) else 1e9, "alone": alone,
                         "seconds": whole, "simulated": reference.duration})
    return rows


def clock_again(reference: Reference, rows: Sequence[Row], *, least: float = 0.02) -> None:
    """Take the run times of these rows once more and keep the better ones."""
    make = dict(settings())
    for row in rows:
        if row["engine"] == "tbsa":
            scene = at_step(reference.scene, row["step"], substeps=row["substeps"],
                            tolerance=row["tolerance"], passes=row["passes"])
            times = clock(scene, reference.duration, least=least)
        else:
            scene = at_step(reference.scene, row["step"], substeps=1)
            times = engine_clock(make[row["engine"]], scene, reference.duration, least=least)
        row["alone"] = min(row["alone"], times[0])
        row["seconds"] = min(row["seconds"], times[1])


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those (time, error) that no other beats in both, by time."""
    best: list[tuple[float, float]] = []
    for point in sorted(points):
        if not best or point[1] < best[-1][1]:
            best.append(point)
    return best


def compare(ours: Sequence[tuple[float, float]], theirs: Sequence[tuple[float, float]],
            floor: float = 1e-12) -> tuple[float, float, float]:
    """Our speed at their error, least and at their least error; their error at our time, least.

    Over the settings of theirs that no other of theirs beats; ratios above 1 are ours to the
    good.  An error below `floor` is as good as none.  0 where nothing of ours is as exact, or
    as fast.
    """
    speed, error, last = math.inf, math.inf, 0.0
    for seconds, miss in front([(t, max(e, floor)) for t, e in theirs]):
        as_exact = [t for t, e in ours if max(e, floor) <= miss]
        last = seconds / min(as_exact) if as_exact else 0.0  # the front ends at the least error
        as_fast = [max(e, floor) for t, e in ours if t <= seconds]
        speed, error = min(speed, last), min(error, miss / min(as_fast) if as_fast else 0.0)
    return speed, last, error


def lines_of(reference: Reference, ours: Sequence[Row], theirs: Sequence[Row]) -> list[list[str]]:
    """A line for each peer: both ratios, engine alone and with its Python."""
    least = min(row["errors"][reference.quantity] for row in ours)
    target = reference.targets[reference.quantity]
    at_target = [row["errors"][reference.quantity] for row in ours
                 if abs(row["step"] - 1 / 480) < 1e-9 and row["substeps"] == 4]
    met = bool(at_target) and at_target[0] <= target
    lines = []
    for engine in ("box2d", "pymunk"):
        rows = [row for row in theirs if row["engine"].startswith(engine)]
        best = min(row["error"] for row in rows)
        cells = [reference.name, engine, f"{least:.1e}", f"{best:.1e}"]
        verdict = True
        for clock_name in ("alone", "seconds"):
            mine = [(row[clock_name], row["errors"][reference.quantity]) for row in ours]
            speed, last, error = compare(mine, [(row[clock_name], row["error"]) for row in rows])
            cells += [f"{speed:.3g}", f"{last:.3g}", f"{error:.3g}"]
            if clock_name == "alone":
                verdict = speed >= 5.0 and (error >= 100.0 or met)
        lines.append([*cells, "yes" if met else "no", "yes" if verdict else "NO"])
    return lines


HEAD = ("scene", "engine", "our least error", "theirs", "speed at equal error, least",
        "at their least", "error at equal time, least", "with its Python: speed", "at their least",
        "error", "ours meets its target", "reached")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns 1 where a comparison is lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.peers",
                                     description="The reference scenes in Box2D and Pymunk.")
    parser.add_argument("scene", nargs="*", help="reference scenes (default: all)")
    parser.add_argument("--saved", action="store_true", help="the table of the saved results")
    arguments = parser.parse_args(argv)
    blocks = {"block-2-0", "block-2-22.5-friction", "block-2-45-friction-floor"}
    chosen = [each for each in references() if each.name not in LEFT_OUT
              and (not each.name.startswith("block-2-") or each.name in blocks)]
    if arguments.scene:
        chosen = [each for each in chosen if each.name in arguments.scene]
    Simulation(chosen[0].scene).advance(1)  # compiled before anything is timed
    rows: list[Row] = []
    lines = []
    saved = newest(RESULTS / "peers.json") if arguments.saved else []
    for each in chosen:
        if arguments.saved:
            mine = [row for row in saved if row["scene"] == each.name]
            ours = [row for row in mine if row["engine"] == "tbsa"]
            theirs = [row for row in mine if row["engine"] != "tbsa"]
        else:
            ours, theirs = sweep(each), peer_sweep(each)
            for _ in range(ROUNDS):
                clock_again(each, ours)
                clock_again(each, theirs)
        rows += [*ours, *theirs]
        lines += lines_of(each, ours, theirs)
        print("  ".join(lines[-2]), "|", "  ".join(lines[-1]), file=sys.stderr, flush=True)
    print("\n".join(aligned(HEAD, lines)))
    for name, why in LEFT_OUT.items():
        print(f"{name}: not in the peers: {why}")
    lost = sum(line[-1] == "NO" for line in lines)
    print(f"{len(lines) - lost} of {len(lines)} comparisons reached")
    if not arguments.scene and not arguments.saved:
        print(f"written to {save('peers', rows)}")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
