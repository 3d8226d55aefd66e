"""What a scene is to `advance`: what moves, what is fixed, scratch, and what is counted."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.bodies import Bodies
from tbsa.kernels.crew import Crew, nobody
from tbsa.kernels.hits import Scratch
from tbsa.kernels.jit import inline, lane
from tbsa.kernels.magnets import MagnetPairs
from tbsa.kernels.neighbours import Pairs
from tbsa.kernels.rows import Impulses, Rows

# Error words of `advance`.
OK, MORE_PAIRS, MORE_ROWS, MORE_MAGNETS, NOT_FINITE, TOO_FAST, TOO_MANY = range(7)


class State(NamedTuple):
    """What moves; arrays of length n + 1, the last entry being the ground."""

    x: np.ndarray  # m
    y: np.ndarray
    angle: np.ndarray  # rad
    vx: np.ndarray  # m/s
    vy: np.ndarray
    omega: np.ndarray  # rad/s
    # int64[3], of the last substep: passes, the next one foreseen (h/8, 0 at first), hits
    last: np.ndarray
    # What the last substep has foreseen to hit only after its end: int64[n + 1], how many tiles,
    # and which; float64[6 n], their x, y, angle, vx, vy, omega, as now, and as the next step begins
    early: np.ndarray
    seen: np.ndarray
    goes: np.ndarray
    impulses: Impulses


class Tiles(NamedTuple):
    """What each tile is; fixed in a run."""

    mobile: np.ndarray  # float64[n + 1]: 1, or 0 for held tiles and the ground
    glues: np.ndarray  # int64[4 n], N, E, S, W
    family: np.ndarray  # float64[n]
    forward: np.ndarray  # float64[n], rad from the tile's +x to its forward edge


class Work(NamedTuple):
    """Scratch, rebuilt at will: nothing in it outlives a call of `advance` but the lists of pairs,
    which tell where they were made."""

    pairs: Pairs
    rows: Rows
    bodies: Bodies
    shift: Bodies
    scratch: Scratch
    c: np.ndarray  # cos and sin of the angles
    s: np.ndarray
    turned: np.ndarray  # rad, the angles that these are of; not a number where they may be others
    far: np.ndarray  # m, how far the corners may come in a step
    way: np.ndarray  # m, how far the centres may
    x0: np.ndarray  # m, rad, where the tiles were when the rows were found
    y0: np.ndarray
    angle0: np.ndarray
    pace: np.ndarray  # m/s, of the centres
    speed: np.ndarray  # m/s, of the corners
    need: np.ndarray  # m, how far they may go before the list of magnets is found anew: centres
    turning: np.ndarray  # m, ... and magnets
    margin: np.ndarray  # m, how far the centres may go before the list of pairs is
    midx: np.ndarray  # m, rad, where the tiles are at the middle of the half
    midy: np.ndarray
    mid_angle: np.ndarray
    mid_c: np.ndarray  # ... and cos and sin of the angles there, where there are magnets
    mid_s: np.ndarray
    mid_turned: np.ndarray  # rad, the angles that these are of
    fx: np.ndarray
    fy: np.ndarray
    torque: np.ndarray
    pullx: np.ndarray  # N, those of magnets alone
    pully: np.ndarray
    lagx: np.ndarray  # m s, how far the tiles have been, in this half, from its middle's places
    lagy: np.ndarray
    magnets: MagnetPairs
    crew: Crew


@lane
def by_itself(w: Work) -> Work:
    """The same, with nobody to help."""
    return Work(w.pairs, w.rows, w.bodies, w.shift, w.scratch, w.c, w.s, w.turned, w.far, w.way,
                w.x0, w.y0, w.angle0, w.pace, w.speed, w.need, w.turning, w.margin, w.midx, w.midy,
                w.mid_angle, w.mid_c, w.mid_s, w.mid_turned, w.fx, w.fy, w.torque, w.pullx, w.pully,
                w.lagx, w.lagy, w.magnets, nobody(w.crew))


class Counts(NamedTuple):
    """What the run has done so far; part of a checkpoint."""

    steps: np.ndarray  # int64[1]
    substeps: np.ndarray
    still: np.ndarray  # steps that were not done, as they would have changed nothing, but counted
    joined: np.ndarray  # substeps saved by joining them
    lists: np.ndarray  # pair lists built
    surprises: np.ndarray  # times rows were added or found again within a step
    magnet_lists: np.ndarray  # lists of magnet pairs built
    magnet_pairs: np.ndarray  # magnet pairs whose force was found, summed over evaluations
    rows: np.ndarray  # manifolds solved, summed over substeps
    passes: np.ndarray  # solver passes
    solves: np.ndarray  # manifolds to be solved, summed over passes
    unsolved: np.ndarray  # of these left out, as they had converged, or in flight
    unconverged: np.ndarray  # substeps whose solve, or an impact, ended at the limit of passes
    impacts: np.ndarray  # points that hit
    projections: np.ndarray  # substeps with overlap beyond the slop
    overlap: np.ndarray  # time (h/8) by deepest overlap: <= 0.01, 0.1, 0.5, 2, more % of w
    deepest: np.ndarray  # float64[1], m


def empty_counts() -> Counts:
    """All zero."""
    return Counts(*(np.zeros(5 if f == "overlap" else 1,
                             np.float64 if f == "deepest" else np.int64)
                    for f in Counts._fields))


@inline
def note_overlap(overlap: float, width: float, ticks: int, counts: Counts) -> None:
    """Count the eighths of a substep under its deepest overlap (m)."""
    counts.deepest[0] = max(counts.deepest[0], overlap)
    share = overlap / width
    counts.overlap[0 if share <= 1e-4 else 1 if share <= 1e-3 else 2 if share <= 5e-3
                   else 3 if share <= 2e-2 else 4] += ticks


@inline
def so_far(rows: Rows, counts: Counts) -> Any:
    """What a step adds to, but for the work on lists, which is that of a process."""
    deep, effort = counts.overlap, rows.effort
    return (deep[0], deep[1], deep[2], deep[3], deep[4], effort[0], effort[1], counts.substeps[0],
            counts.joined[0], counts.surprises[0], counts.rows[0], counts.passes[0],
            counts.unconverged[0], counts.impacts[0], counts.projections[0])


@inline
def note_still(steps: int, begun: Any, rows: Rows, counts: Counts) -> None:
    """Count steps like the last one, which has `begun` so, as if they were done: how many are not
    depends on how a run is cut into calls."""
    counts.steps[0] += steps
    counts.still[0] += steps
    now = so_far(rows, counts)
    for i in range(5):
        counts.overlap[i] += steps * (now[i] - begun[i])
    for i in range(2):
        rows.effort[i] += steps * (now[i + 5] - begun[i + 5])
    for i, number in enumerate((counts.substeps, counts.joined, counts.surprises, counts.rows,
                                counts.passes, counts.unconverged, counts.impacts,
                                counts.projections)):
        number[0] += steps * (now[i + 7] - begun[i + 7])
