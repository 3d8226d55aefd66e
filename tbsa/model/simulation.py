"""A running simulation: a scene, its state, and the calls that advance it."""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import math
import operator
import os
import re
import sys
import threading
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Never, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from tbsa.errors import InputError, printable
from tbsa.kernels import advance as core
from tbsa.kernels import drives
from tbsa.kernels.arrays import columns
from tbsa.kernels.bodies import Numbers, empty_bodies
from tbsa.kernels.crew import empty_crew
from tbsa.kernels.floor import COUPLED, EXACT, NONE, SEPARATE, TORQUE, FloorLaw
from tbsa.kernels.geometry import CIRCLE, RECTANGLE
from tbsa.kernels.hits import NOWHERE, empty_scratch
from tbsa.kernels.jit import config, entry
from tbsa.kernels.magnets import MagnetLaw, empty_magnet_pairs, magnet_forces
from tbsa.kernels.neighbours import build_pairs, empty_pairs
from tbsa.kernels.reach import TICKS
from tbsa.kernels.rows import DIAGONAL, empty_impulses, empty_rows
from tbsa.kernels.state import (
    MORE_MAGNETS,
    MORE_PAIRS,
    MORE_ROWS,
    OK,
    TOO_FAST,
    TOO_MANY,
    State,
    Tiles,
    Work,
    empty_counts,
)
from tbsa.model.layout import Layout, check_start, initial_layout
from tbsa.model.scene import EDGE_ANGLE, Scene, check_is_scene, engine_path, engine_source
from tbsa.model.squares import depth, inside, near

Floats = NDArray[np.float64]

PART = 1_000_000  # steps times tiles, done in one call of the kernels: what Ctrl-C waits for

NOTHING: Any = contextlib.nullcontext()  # a call for one small step is mostly what Python does


class SimulationError(RuntimeError):
    """The state stopped being finite, contacts outgrew their space, or the drive raised: what the
    simulation has come to is not to be trusted, and it does not go on.

    `reason` is the message without the times that depend on how a run was cut into calls.
    """

    def __init__(self, message: str, reason: str = "") -> None:
        super().__init__(message)
        self.reason = reason or message


def floor_limits(scene: Scene) -> tuple[float, float]:
    """Largest friction force (N) and torque (N m) of the floor on one tile; 0, 0 without a floor.

    The torque of separate friction is read as the engine of the paper does, c m g sqrt(2 I/m),
    or as c times that of a square under uniform pressure; the other laws are one friction law
    with the linear coefficient.
    """
    floor, body = scene.floor, scene.material
    if floor is None:
        return 0.0, 0.0
    weight = body.mass * floor.gravity
    force = floor.linear * weight
    if floor.law != "separate":
        return force, TORQUE * force * body.width
    if floor.angular_reading == "engine":
        return force, floor.angular * weight * body.width / math.sqrt(3.0)
    return force, floor.angular * weight * TORQUE * body.width


def steady(scene: Scene) -> bool:
    """Whether the loads on a tile depend on where it is alone, and not on time or velocity."""
    return scene.drive is None or scene.drive.kind == "constant"


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _clashes(scene: Scene, layout: Layout) -> bool:
    """Whether tiles come into each other or the wall before anything has looked ahead.

    That is in the first half of the first substep, at the velocities that they begin with, and by
    more than an impact takes for touching; a run then begins with an eighth of a substep, and looks
    ahead at once.
    """
    body, half = scene.material, 0.5 * scene.solver.step / scene.solver.substeps
    moves = np.where(layout.held, 0.0, half)
    swept = moves * (np.hypot(layout.vx, layout.vy)
                     + math.sqrt(0.5) * body.width * np.abs(layout.omega))
    most, least = float(swept.max(initial=0.0)), NOWHERE * body.width
    if 2.0 * most <= least:
        return False
    reach = math.sqrt(2.0) * body.width + 2.0 * min(most, body.width)  # faster ones are refused
    i, j = near(layout.x, layout.y, layout.x, layout.y, reach)
    i, j = i[i < j], j[i < j]
    deepest = np.full(i.size, least)
    for part in np.linspace(0.0, 1.0, 9):  # what passes by a corner, too
        x, y, angle = (layout.x + part * moves * layout.vx, layout.y + part * moves * layout.vy,
                       layout.angle + part * moves * layout.omega)
        deep = depth(body.width, x[j] - x[i], y[j] - y[i], angle[i], angle[j])
        if part == 0.0:
            deepest = np.maximum(deepest, deep)
        elif ((deep > deepest).any()
              or not inside(scene.reactor, body.width, x, y, angle, least).all()):
            return True
    return False


class Simulation:
    """One run of a scene.

    Parameters
    ----------
    scene
        The scene, which is validated: it may have been changed since it was read.
    layout
        Where the tiles start; by default that of the scene and its seed of random numbers.
    threads
        Threads that share the work, which pays from some thousands of tiles on; more than there
        are cores wait for each other.  They do not change a bit of what comes out.

    Attributes
    ----------
    scene, layout
        As given.
    h
        Length of a step (s).
    steps
        Number of steps done.
    state
        Arrays of length n + 1 (the last entry is the ground), see
        :class:`tbsa.kernels.state.State`.
    counts
        What the run has done so far, see :class:`tbsa.kernels.state.Counts`.

    Raises
    ------
    InputError
        Where the scene is not valid, its random tiles do not fit, the layout is not one to begin
        with, `threads` is no whole number from 1, or a user's drive cannot be compiled.
    TypeError
        Where there is no scene, or what is given as a layout is none.

    Notes
    -----
    The same scene gives the same bits on one CPU type and set of package versions, however the
    run is cut into calls.

    Places and velocities are views, to be read.  To go on from others make another simulation,
    with another layout: what flies at something near is then seen in time, and what is held stays.
    Its time begins at 0, and so does a drive that depends on time: set `steps` to those that were
    done by then (``round(time / simulation.h)``), and the drive goes on where it was.
    """

    def __init__(self, scene: Scene, layout: Layout | None = None, *, threads: int = 1) -> None:
        check_is_scene(scene)
        try:
            number = operator.index(threads)
        except TypeError:
            number = 0
        if number < 1:
            raise InputError("must be a whole number, at least 1", field="threads", value=threads)
        scene.validate()
        self._threads = 1 if config.DISABLE_JIT else number  # interpreted ones go by turns
        self.scene = scene
        if layout is not None:
            check_start(layout, scene)
        self.layout = layout = initial_layout(scene) if layout is None else layout
        n = layout.x.size
        body, magnet, wall = scene.material, scene.magnet, scene.reactor
        self.steps = 0
        self.h = scene.solver.step
        ground = np.zeros(1)
        self._capacity = {MORE_PAIRS: 10 * n + 128, MORE_ROWS: 5 * n + 128,
                          MORE_MAGNETS: 30 * n + 400}
        free = np.where(layout.held, 0.0, 1.0)
        x, y, angle, vx, vy, omega = (
            np.concatenate([np.asarray(values, float), ground])
            # An angle is not -0: whether its sine is there already is asked by comparing it.
            for values in (layout.x, layout.y, layout.angle + 0.0, layout.vx * free,
                           layout.vy * free, layout.omega * free)
        )
        self.state = State(x, y, angle, vx, vy, omega,
                           np.array([scene.solver.passes,  # as if it had not been calm
                                     0 if _clashes(scene, layout) else TICKS, 0]),
                           np.zeros(n + 1, np.int64), np.zeros(6 * n), np.zeros(6 * n),
                           empty_impulses(self._capacity[MORE_ROWS]))
        types = scene.types
        self.tiles = Tiles(
            np.concatenate([free, ground]),
            np.array([types[t].glues for t in layout.type], np.int64).reshape(-1),
            np.array([types[t].family for t in layout.type], float),
            np.array([EDGE_ANGLE[types[t].forward] for t in layout.type], float),
        )
        wall_friction, wall_restitution = (wall.friction, wall.restitution) if wall else (0.0, 0.0)
        circle = wall is not None and wall.shape == "circle"
        inertia = body.mass * body.width**2 / 6.0
        # Every float a float: another type would be another signature, compiled anew.
        self.numbers = Numbers(
            n=n, front=int(np.argmin(np.append(layout.held, False))),
            width=float(body.width), h=self.h / scene.solver.substeps,
            substeps=int(scene.solver.substeps),
            mass=float(body.mass),
            inertia=float(inertia), im=1.0 / body.mass, ii=1.0 / inertia,
            per_mass=1.0 / inertia / (1.0 / body.mass),
            linear_damping=float(body.linear_damping),
            angular_damping=float(body.angular_damping),
            mu=float(body.friction), mu_wall=float(wall_friction), e=float(body.restitution),
            e_wall=float(wall_restitution), threshold=float(body.restitution_threshold),
            tolerance=float(scene.solver.tolerance),
            at_rest=float(scene.solver.at_rest), passes=int(scene.solver.passes),
            keep_lists=int(scene.solver.keep_lists),
            skip_converged=int(scene.solver.skip_converged),
            join_substeps=int(scene.solver.join_substeps),
            skip_still=int(scene.solver.skip_still and steady(scene)),
            driven=0 if scene.drive is None else 2 if scene.drive.kind == "user" else 1,
            wall=0 if wall is None else CIRCLE if circle else RECTANGLE,
            wall_x=0.0 if wall is None else float(wall.radius if circle else 0.5 * wall.width),
            wall_y=0.0 if wall is None or circle else 0.5 * wall.height,
        )
        law = {"separate": SEPARATE, "coupled": COUPLED, "exact": EXACT}
        limits = [float(limit) for limit in floor_limits(scene)]
        # A floor without friction is as good as none; so is one whose squares would be 0.
        rough = scene.floor is not None and max(limits) > 1e-100
        self.floor = FloorLaw(law[scene.floor.law] if scene.floor and rough else NONE, *limits)
        if magnet is None or not self.tiles.glues.any():
            self.magnets = MagnetLaw(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
        else:
            self.magnets = MagnetLaw(*(float(number) for number in (
                magnet.alpha, magnet.beta, 0.5 * body.width - magnet.inset, magnet.cutoff,
                magnet.cutoff * (1.0 - magnet.switch), magnet.mismatch,
            )))
        self.engine, self.parameters = _engine(scene)
        # A lone tile has no pairs, and then there is no list to keep.
        reach = max(DIAGONAL * body.width, self.magnets.cutoff + 2.0 * self.magnets.offset)
        self._reach = 1.001 * reach if n > 1 else 0.0
        self.counts = empty_counts()
        self._work = self._space()
        self._advance = core.advance if self._threads == 1 else core.advance_together
        self._ended = ""  # why it cannot go on
        self._rest = 0.0  # s, by which calls of `run` have come short

    def __reduce_ex__(self, protocol: SupportsIndex) -> Never:
        """A copy would share its arrays with this one, and not its count of steps."""
        raise TypeError("a Simulation cannot be copied or pickled: make another of its scene, with "
                        "a layout of where its tiles are")

    def _space(self) -> Work:
        n, pairs = self.numbers.n, self._capacity[MORE_PAIRS]
        scratch = columns(n + 1, [float] * 26)
        rows = empty_rows(n, self._capacity[MORE_ROWS])
        magnetic = self.magnets.cutoff > 0.0
        return Work._make([
            empty_pairs(n, pairs), rows, empty_bodies(n), empty_bodies(n),
            empty_scratch(n, rows.active.size), *scratch,
            empty_magnet_pairs(n, pairs if magnetic else 0,
                               self._capacity[MORE_MAGNETS] if magnetic else 0,
                               self._threads),
            empty_crew(self._threads),
        ])

    @contextlib.contextmanager
    def _helped(self) -> Iterator[None]:
        """With further threads at hand for `advance`."""
        crew, loads = self._work.crew, (self.state, self.tiles, self.numbers, self.magnets,
                                        self.floor, self._work)
        helpers: list[threading.Thread] = []
        core.dismiss(crew)
        core.help_out(1, int(crew.job[0]) - 1, *loads)  # leaves at once: it is compiled now
        job = int(crew.job[0])
        try:
            for me in range(1, self._threads):
                helper = threading.Thread(target=core.help_out, args=(me, job, *loads))
                helper.start()
                helpers.append(helper)
            yield
        finally:
            core.dismiss(crew)
            for helper in helpers:
                helper.join()

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        return self.steps * self.h

    @property
    def x(self) -> Floats:
        """Centres, x (m), float64[n]; a view."""
        return self.state.x[:-1]

    @property
    def y(self) -> Floats:
        """Centres, y (m), float64[n]; a view."""
        return self.state.y[:-1]

    @property
    def angle(self) -> Floats:
        """Angles (rad, counter-clockwise), float64[n]; a view, not reduced to one turn."""
        return self.state.angle[:-1]

    @property
    def vx(self) -> Floats:
        """Velocities, x (m/s), float64[n]; a view."""
        return self.state.vx[:-1]

    @property
    def vy(self) -> Floats:
        """Velocities, y (m/s), float64[n]; a view."""
        return self.state.vy[:-1]

    @property
    def omega(self) -> Floats:
        """Spins (rad/s), float64[n]; a view."""
        return self.state.omega[:-1]

    def advance(self, steps: int) -> None:
        """Advance by a number of steps, each of ``scene.solver.substeps`` substeps.

        Raises
        ------
        TypeError
            Where `steps` is not a whole number.
        InputError
            Where it is negative.
        SimulationError
            Where a position or velocity is no longer a finite number, a tile would go
            further than its width past what it may touch in a substep, or the user's drive
            raises; and in every call after that.
        """
        left = operator.index(steps)
        if left < 0:
            raise InputError("must be a whole number from 0", field="steps", value=steps)
        if self._ended:
            raise SimulationError(f"has ended before: {self._ended}")
        of_user = self.scene.drive is not None and self.scene.drive.kind == "user"
        while left > 0:
            begun, before = self.time, int(self.counts.steps[0])
            part = min(left, max(PART // self.numbers.n, 1))
            try:
                with (_raised() if of_user else NOTHING as raised,
                      self._helped() if self._threads > 1 else NOTHING):
                    error, done = self._advance(
                        self.state, self.tiles, self.numbers, self.magnets, self.floor,
                        self.engine, self.parameters, self._work, self.counts, self.steps, part,
                        self._reach)
            finally:  # also when it is interrupted
                self.steps += int(self.counts.steps[0]) - before
            self._advance = entry(self._advance)  # the types are the same in every call
            left -= done
            if error in self._capacity and not raised:
                self._grow(error)
            elif raised or error != OK:
                # Its last step is not done where it was broken off.
                end = self.time + (self.h if done < part else 0.0)
                self._ended = self._why(error, raised, f" between t = {begun} s and {end} s")
                raise SimulationError(self._ended, self._why(error, raised, ""))

    def _why(self, error: int, raised: list[BaseException] | None, between: str) -> str:
        """Why a call of `advance` is the last one; `between` which times is part of the text."""
        if raised:
            return (f"the drive raised {type(raised[0]).__name__} "
                    f"({printable(' '.join(str(raised[0]).split()))}){between}")
        if error == TOO_FAST:
            rows, v = self._work.rows, self.state
            a, b = rows.a[: rows.size[0]], rows.b[: rows.size[0]]
            speed = float(np.hypot(v.vx[b] - v.vx[a], v.vy[b] - v.vy[a]).max())
            return (f"a tile goes at {speed:.3g} m/s past what it may touch at t = {self.time} s, "
                    f"further than its width in a substep of {self.numbers.h:.3g} s; use shorter "
                    "steps")
        if error == TOO_MANY:
            return (f"at t = {self.time} s tiles come together so fast that pairs multiply within "
                    f"a step of {self.h:.3g} s; use shorter steps")
        drive = self.scene.drive
        whose = " or what the drive gives is no number" * (
            drive is not None and drive.kind == "user")
        return (f"positions or velocities stopped being finite{between}; the load is too large "
                f"for a substep of {self.numbers.h:.3g} s{whose}")

    def run(self, seconds: float) -> None:
        """Advance by a time (s), to the nearest step; what that leaves, the next call adds.

        Raises
        ------
        TypeError
            Where the time is no number.
        InputError
            Where it is negative or not finite; and what :meth:`advance` raises.
        """
        # Whole numbers may be beyond all floats, and so may a number of steps.
        with contextlib.suppress(OverflowError):
            seconds = float(+seconds)  # text has no sign
        if not 0.0 <= seconds <= 0.5 * self.h * sys.float_info.max:
            raise InputError("must be a number from 0 s", field="seconds", value=seconds)
        steps = round((seconds + self._rest) / self.h)
        self._rest += seconds - steps * self.h
        self.advance(steps)

    def _grow(self, what: int) -> None:
        """Twice the space for what an error word of `advance` says there is not enough of."""
        self._capacity[what] *= 2
        del self._work  # first, or both are there at a time
        self._work = self._space()
        if what != MORE_ROWS:
            return
        old, new = self.state.impulses, empty_impulses(self._capacity[what])
        used = int(old.size[0])
        new.size[0] = used
        for a, b in zip(old[1:], new[1:], strict=True):
            b[:used] = a[:used]  # no more: memory that nobody touches costs nothing
        self.state = self.state._replace(impulses=new)

    def magnet_forces(self) -> tuple[Floats, Floats, Floats]:
        """Forces (N, x and y) and torques (N m) of the magnets on every tile, float64[n] each.

        Held tiles are among them, with what they do to each other, though it moves nothing.
        """
        n = self.numbers.n
        fx, fy, torque, all_free = np.zeros(n), np.zeros(n), np.zeros(n), np.ones(n + 1)
        if self.magnets.cutoff > 0.0 and n > 1:
            alone, none, angle = empty_crew(1), np.zeros(n), self.angle
            while build_pairs(self._work.pairs, n, self.x, self.y, all_free, self._reach,
                              none, alone) > self._work.pairs.other.size:
                self._grow(MORE_PAIRS)
            while magnet_forces(self.magnets, self._work.pairs, self.tiles.glues, self.x, self.y,
                                angle, np.cos(angle), np.sin(angle), none, self._work.magnets,
                                fx, fy, torque, alone) > self._work.magnets.p.size:
                self._grow(MORE_MAGNETS)
                build_pairs(self._work.pairs, n, self.x, self.y, all_free, self._reach, none,
                            alone)
            self._work.magnets.margin[:] = -1.0  # held tiles are among them: not for `advance`
        return fx, fy, torque

    def contact_forces(self) -> dict[str, NDArray[Any]]:
        """Contact forces of the last substep, one entry a manifold that carries any.

        What rests, slides or is pressed has them; an impact has an impulse and no force, and is
        not among them, nor is what slows a point that is on its way to one.

        Returns
        -------
        dict
            Arrays of one length: ``a``, ``b`` (tile numbers, a < b; b = n for the wall),
            ``points`` (1 or 2), ``normal0``, ``normal1`` (N, >= 0, at the two points),
            ``friction`` (N, on b, along a quarter turn counter-clockwise from the normal that
            leads from a to b).
        """
        store = self.state.impulses
        k = slice(0, int(store.size[0]))
        return {
            "a": store.a[k].copy(), "b": np.minimum(store.b[k], self.numbers.n),
            "points": np.where(store.id1[k] < 0, 1, 2),
            "normal0": store.pn0[k] / self.numbers.h,
            "normal1": store.pn1[k] / self.numbers.h,
            "friction": store.pt[k] / self.numbers.h,
        }

    def kinetic_energy(self) -> float:
        """Sum of m v^2 / 2 + I omega^2 / 2 over all tiles (J)."""
        k = self.numbers
        return float(
            0.5 * k.mass * (self.vx @ self.vx + self.vy @ self.vy)
            + 0.5 * k.inertia * (self.omega @ self.omega)
        )


def _engine(scene: Scene) -> tuple[Any, Floats]:
    """The compiled drive of a scene and its parameters."""
    drive = scene.drive
    if drive is None:
        return drives.engine(drives.no_drive), np.zeros(1)
    if drive.kind == "user":
        function = _user_function(scene)
        try:
            return drives.engine(function), _guarded(drive.parameters)
        except Exception as error:
            raise InputError(
                "cannot be compiled as a drive (see tbsa.kernels.drives): "
                f"{_reason(error, engine_path(scene))}",
                file=scene.file, field="drive.function", value=drive.function,
            ) from error
    if drive.kind == "constant":
        assert isinstance(drive.force, tuple)
        return drives.engine(drives.constant), np.array([*drive.force, drive.torque], float)
    function = {"unicycle": drives.unicycle, "shaking": drives.shaking}[drive.kind]
    return drives.engine(function), np.array([drive.force, drive.torque, drive.frequency], float)


def _guarded(parameters: tuple[float, ...]) -> Floats:
    """An array of these, beyond whose end is what no force may be made of."""
    return np.array([*parameters, *[math.nan] * 8], float)[: len(parameters)]


CONSTANTS = ("what a drive takes from its module must be a number, a text, a tuple of these, a "
             "NumPy array or a jitted function, and is a constant")


def _reason(error: Exception, path: Path) -> str:
    """What is wrong with the drive of this file, and in which line, of a message of many lines
    whose first may say in which pass it was."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error)).replace(str(path), path.name)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith("Failed in nopython mode")]
    reason = (telling or lines or [type(error).__name__])[0]
    if helper := re.match(r"Untyped global name (.+?): .* <class 'function'>", reason):
        reason = (f"{helper[1]} is a function that is not compiled: those that a drive calls must "
                  "be jitted, with @numba.njit")
    elif found := re.match(r"<numba\S+OverloadSelector object at \w+>, \((\w[\w ]*)", reason):
        reason = f"it uses a {found[1]} of its module; {CONSTANTS}"
    elif found := (re.match(r"Untyped global name '(\w+)': .* <class '(?:\w+\.)*(\w+)'>", reason)
                   or re.match(r"(?=The use of a .*?'(\w+)' in globals)The use of a "
                               r"(?:reflected )?(\w+)", reason)):
        reason = f"{found[1]} is a {found[2]}; {CONSTANTS}"
    elif re.match(r"No conversion from .* to none for '\$\w*return_", reason):
        reason = "it must not return anything: it adds to fx, fy and torque"
    elif reason == "must be builtin_function_or_method":  # Numba's word for it
        reason = "it must not go back to Python, as with objmode"
    elif reason.endswith("for signature:"):
        calls = [line.removeprefix(">>> ") for line in lines if line.startswith(">>> ")]
        reason = f"Numba has no {', '.join(calls[:1])}"
    place = re.search(rf'^File ".*{re.escape(path.name)}", line (\d+):', text, re.MULTILINE)
    return reason if place is None else f"{reason} (line {place[1]})"


def _user_function(scene: Scene) -> Callable[..., None]:
    """The function of a user's drive, from the bytes that the fingerprint is made of: Python's
    import might take compiled ones of an earlier version."""
    drive = scene.drive
    assert drive is not None
    path = engine_path(scene)
    try:
        function = _function(path, engine_source(scene), drive.function)
    except (Exception, SystemExit, GeneratorExit) as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(f"cannot be used as a drive: {reason}", file=scene.file,
                         field="drive.module", value=drive.module) from error
    if not hasattr(function, "__code__"):  # methods and jitted functions have it, too
        raise InputError("must be a function, as its module leaves it, and is of type "
                         f"{type(function).__name__}: take away what stands in its place, or what "
                         "wraps it", file=scene.file, field="drive.function",
                         value=drive.function)
    if function.__code__.co_flags & inspect.CO_VARARGS:
        raise InputError("must name each of its arguments, and takes them as *args: take away the "
                         "decorator that wraps it, if there is one", file=scene.file,
                         field="drive.function", value=drive.function)
    if inspect.isgeneratorfunction(function):
        raise InputError("must be a function that returns, not one that yields", file=scene.file,
                         field="drive.function", value=drive.function)
    if (lost := _lost(engine_source(scene), drive.function)) is not None:
        raise InputError(f"must add to {lost.id}, as by {lost.id}[:] += or {lost.id}[i] +=, and "
                         "gives the name to something else, whose forces may be lost "
                         f"(line {lost.lineno})",
                         file=scene.file, field="drive.function", value=drive.function)
    return function


def _lost(source: bytes, name: str) -> ast.Name | None:
    """Where a drive makes another array of fx, fy or torque, as by ``fx = fx + force``: only what
    is added to those that it was given is ever seen."""
    for drive in reversed(ast.parse(source).body):
        if isinstance(drive, ast.FunctionDef) and drive.name == name:
            results = [each.arg for each in (*drive.args.posonlyargs, *drive.args.args)][10:]
            return next((each for each in _bound(drive) if each.id in results), None)
    return None


def _bound(node: ast.AST) -> Iterator[ast.Name]:
    """The names that a function binds, but not by ``+=``, which adds to an array in its place."""
    for each in ast.iter_child_nodes(node):
        if isinstance(each, ast.Name):
            if isinstance(each.ctx, ast.Store) and not isinstance(node, ast.AugAssign):
                yield each
        elif not isinstance(each, ast.FunctionDef | ast.Lambda):  # have names of their own
            yield from _bound(each)


@functools.cache
def _function(path: Path, source: bytes, name: str) -> Callable[..., None]:
    """A function of a module of this source; the same one each time, so that it is compiled once
    a process."""
    module = types.ModuleType(f"tbsa_drive_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    exec(compile(source, path, "exec"), module.__dict__)
    function: Callable[..., None] = getattr(module, name)
    return function


class _Inside:
    """How many calls of `advance` are under way, in all threads, and the hook that was there."""

    number = 0
    hook: Callable[[Any], object] = sys.unraisablehook
    lock = threading.Lock()
    here = threading.local()  # what the drive has raised in the call of this thread


def _note(what: Any) -> None:
    found: list[BaseException] | None = getattr(_Inside.here, "found", None)
    if found is None or not isinstance(what.object, str):  # not of a drive, which Numba names
        _Inside.hook(what)
    else:
        found.append(what.exc_value or what.exc_type())


@contextlib.contextmanager
def _raised() -> Iterator[list[BaseException]]:
    """What a compiled drive raises meanwhile in this thread: it cannot be passed on through the
    kernels, and would only be printed."""
    found: list[BaseException] = []
    with _Inside.lock:
        if _Inside.number == 0:
            _Inside.hook, sys.unraisablehook = sys.unraisablehook, _note
        _Inside.number += 1
    _Inside.here.found = found
    try:
        yield found
    finally:
        _Inside.here.found = None
        with _Inside.lock:
            _Inside.number -= 1
            if _Inside.number == 0:
                sys.unraisablehook = _Inside.hook
