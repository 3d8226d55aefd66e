"""What accuracy costs on a scene of one's own: the command ``tbsa bench``."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tbsa.errors import InputError, at_least
from tbsa.model.layout import Layout
from tbsa.model.scene import SHORTEST, Scene, Solver, entries
from tbsa.model.simulation import Simulation, SimulationError
from tbsa.model.squares import depth, near
from tbsa.work.report import aligned

SHARES = (4.0, 2.0, 1.0, 0.5, 0.25)  # of the scene's step
EFFORTS = ((10.0, 1), (1.0, 1), (0.1, 10))  # of the scene's tolerance, and of its passes
REPEATS, SHORT = 5, 0.05  # of a trial that takes less than so long (s): the least time counts
ALIKE = 1.1  # what costs no more than so many times as much costs the same
STILL = 1e-9  # widths; what moves less is at rest
FINEST, LEAST = 8, 1e-3  # of the shortest step and of the scene's tolerance, for the run that the
# others are held against: what its solves leave grows in a crowd as what theirs do
LOOKS = 32  # at the overlap, in a trial
LONGEST = 1 / 30  # s, step
TRIED = ("step", "substeps", "tolerance", "passes")  # what a table of trials has


@dataclass(frozen=True)
class Trial:
    """One setting, and what it did.

    Attributes
    ----------
    solver
        The setting.
    deviation : float
        Root mean square distance of the points of the free tiles, at the end, from where the run
        with the finest setting has them (widths); with the turn, as an angle times w/sqrt(6).
    overlap : float
        Deepest overlap of two tiles, one of them free, at any look, beyond what the two had where
        the trial begins (widths).
    cost : float
        Wall time for a second of simulated time (s).
    """

    solver: Solver
    deviation: float
    overlap: float
    cost: float

    @property
    def error(self) -> float:
        """The larger of deviation and overlap (widths)."""
        return max(self.deviation, self.overlap)


def bench(scene: Scene, *, horizon: float = 0.25, after: float = 1.0,
          progress: Callable[[int, int], None] | None = None) -> list[Trial]:
    """Try settings of the solver on a scene.

    The scene runs for `after` (s) as it is.  From there every setting goes on for `horizon` (s)
    and is compared with one of an eighth of the shortest step and a thousandth of the tolerance.
    Motion with many contacts is chaotic: a longer horizon would tell how chaotic it is, not how
    exact the solver.

    Parameters
    ----------
    scene
        A validated scene.
    horizon, after : float
        s; at least one of the longest steps tried, and not negative.  Both are taken to the
        nearest whole number of those steps, so that all trials begin and end at the same time.
    progress
        Called with the number of trials done and of all.

    Returns
    -------
    list of Trial
        In the order of cost.

    Raises
    ------
    InputError
        `horizon` or `after` is not allowed, or no free tile moves in between.
    SimulationError
        The scene cannot be followed with the finest setting.
    """
    h = scene.solver.step
    steps = [share * h for share in SHARES if share <= 1.0 or share * h <= LONGEST]
    steps = [step for step in steps if _takes(scene, replace(scene.solver, step=step))]
    longest = max(steps)
    if not longest <= horizon <= 1e6:
        raise InputError(f"must be a number from {at_least(longest)} to 1e+06 s", field="horizon",
                         value=horizon)
    if not 0.0 <= after <= 1e9:
        raise InputError("must be a number from 0 to 1e+09 s", field="after", value=after)
    horizon, after = (longest * round(each / longest) for each in (horizon, after))
    first = Simulation(scene)
    first.run(after)
    start, begun = layout_of(first), first.time

    settings = [replace(scene.solver, step=step,
                        tolerance=min(float(f"{factor * scene.solver.tolerance:.12g}"), 1.0),
                        passes=min(more * scene.solver.passes, 100_000))
                for step in steps for factor, more in EFFORTS]
    settings = [each for each in dict.fromkeys(settings) if _takes(scene, each)]
    finest = replace(scene.solver, step=min(steps) / FINEST,
                     tolerance=LEAST * scene.solver.tolerance,
                     passes=min(100 * scene.solver.passes, 100_000))
    if not _takes(scene, finest):
        name = "step" if finest.step < SHORTEST else "tolerance"
        raise InputError("is too small to be compared with a finer one, of "
                         f"{getattr(finest, name):g}", file=scene.file or None,
                         field=f"solver.{name}", value=getattr(scene.solver, name))
    total = len(settings) + 1
    truth, _, _ = _run(scene, finest, start, begun, horizon, 0)
    free, size = ~start.held, scene.material.width
    way = np.sqrt(((truth - _places(first)) ** 2).sum(axis=0))[free]
    if not (way > STILL * size).any():
        raise InputError(f"s: no free tile moves from there to {begun + horizon:g} s, so that "
                         "nothing can be compared; choose another time, or a longer horizon",
                         field="after", value=after)
    if progress is not None:
        progress(1, total)
    trials = []
    for k, solver in enumerate(settings, 2):
        try:
            found, overlap, cost = _run(scene, solver, start, begun, horizon)
        except SimulationError:
            continue  # too coarse for this scene
        miss = ((found - truth) ** 2).sum(axis=0)[free]
        deviation = float(np.sqrt(miss.mean())) if miss.size else 0.0
        trials.append(Trial(solver, deviation / size, overlap, cost))
        if progress is not None:
            progress(k, total)
    return sorted(trials, key=lambda trial: trial.cost)


def recommend(trials: Sequence[Trial], wanted: float) -> Trial | None:
    """The cheapest trial with an error of at most `wanted` (widths); None if there is none.

    Of those that cost as much within a tenth, which a clock does not tell apart, the most exact.
    """
    good = [trial for trial in trials if trial.error <= wanted]
    least = min((trial.cost for trial in good), default=0.0)
    return min((trial for trial in good if trial.cost <= ALIKE * least),
               key=lambda trial: trial.error, default=None)


def describe(trials: Sequence[Trial], wanted: float) -> str:
    """The trials as a table, and the recommended settings as the ``[solver]`` of a scene."""
    chosen = recommend(trials, wanted)
    rows = [(f"{1 / trial.solver.step:.4g}", f"{trial.solver.substeps}",
             f"{trial.solver.tolerance:.1e}", f"{trial.solver.passes}",
             f"{trial.deviation:.1e}", f"{trial.overlap:.1e}", f"{trial.cost:.2e}",
             "<" if trial is chosen else "") for trial in trials]
    table = aligned(("1/step", "substeps", "tolerance", "passes", "deviation w", "overlap w",
                     "s for 1 s", ""), rows)
    if not trials:
        return "the scene cannot be followed with any of these settings but the finest"
    if chosen is None:
        least = min(trial.error for trial in trials)
        return "\n".join([*table, f"no setting has an error of {wanted:g} of a width; the least "
                          f"is {least:.2g}"])
    usual = entries(Solver())
    return "\n".join([
        *table, f"the cheapest with an error of at most {wanted:g} of a width:", "", "[solver]",
        *(f"{name} = {value}" for name, value in entries(chosen.solver).items()
          if name in TRIED or value != usual[name])])


def _takes(scene: Scene, solver: Solver) -> bool:
    """Whether the scene is valid with a setting: its records must fall on whole steps."""
    try:
        replace(scene, solver=solver).validate()
    except InputError:
        return False
    return True


def layout_of(simulation: Simulation) -> Layout:
    """Where the tiles are now, as a start."""
    s = simulation
    return replace(s.layout, x=s.x.copy(), y=s.y.copy(), angle=s.angle.copy(), vx=s.vx.copy(),
                   vy=s.vy.copy(), omega=s.omega.copy())


def _places(s: Simulation) -> NDArray[np.float64]:
    """Centres and turns, shape (3, n) (m): a turn moves the points of a tile by w/sqrt(6) a radian,
    in root mean square."""
    return np.stack([s.x, s.y, s.angle * s.scene.material.width / np.sqrt(6.0)])


def _run(scene: Scene, solver: Solver, start: Layout, begun: float, horizon: float,
         repeats: int = REPEATS) -> tuple[NDArray[np.float64], float, float]:
    """Places at the end, shape (3, n) (m); deepest overlap (widths); s of wall for one s."""
    s = _begin(scene, solver, start, begun)
    steps, deepest, spent, done = round(horizon / s.h), 0.0, 0.0, 0
    for look in range(1, LOOKS + 1):
        now = round(steps * look / LOOKS)
        if now == done:
            continue
        clock = time.perf_counter()
        s.advance(now - done)
        spent += time.perf_counter() - clock
        done = now
        deepest = max(deepest, _overlap(s, start))
    if spent <= SHORT:  # the calls may take longer than what is done in them
        spent = min([_spent(_begin(scene, solver, start, begun), steps) for _ in range(repeats)],
                    default=spent)
    return _places(s), deepest, spent / horizon


def _begin(scene: Scene, solver: Solver, start: Layout, begun: float) -> Simulation:
    """A simulation that goes on from there."""
    s = Simulation(replace(scene, solver=solver), start)
    s.steps = round(begun / s.h)  # the drive goes on where it was
    return s


def _spent(s: Simulation, steps: int) -> float:
    """Wall time of so many steps in one call (s), after a first one: the first call of a simulation
    looks at the types of all arrays."""
    s.advance(1)
    clock = time.perf_counter()
    s.advance(steps)
    return time.perf_counter() - clock


def _overlap(s: Simulation, start: Layout) -> float:
    """Deepest overlap of two tiles, one of them free, beyond what they had at the start (widths).

    What the scene's own solver has left there, below the slop, no other one takes back.
    """
    width = s.scene.material.width
    i, j = near(s.x, s.y, s.x, s.y, np.sqrt(2.0) * width)
    keep = (i < j) & ~(s.layout.held[i] & s.layout.held[j])
    i, j = i[keep], j[keep]
    if not i.size:
        return 0.0
    now, before = (depth(width, each.x[j] - each.x[i], each.y[j] - each.y[i], each.angle[i],
                         each.angle[j]) for each in (s, start))
    return max(0.0, float((now - np.maximum(before, 0.0)).max()) / width)
