"""Many steps without coming back to Python.

One step of length H, of second order in free flight, has two halves (one part, where the number of
substeps is odd), each of length P:

    lists   near pairs of magnets, for the middle of the half (kept while nobody has moved too far)
    forces  magnets and drive, at x + P/2 v: the middle of the half; where tiles turn far
            as seen from each other, the mean of their way      (magnets.py, mean_forces.py)

after the forces of the first half, once a step:

    lists   near pairs of tiles, likewise
    rows    which tiles may touch in this step, at their speeds and under these forces; and
            after an impact what a tile may touch besides that it has thrown

and the substeps of a half, of length h:

    drift   x += h/2 v                                      to the middle of the substep
    damp    v *= exp(-h/2 c)
    rows    where they touch                                (contacts.py)
    impacts what hits in this substep, as fast as it then is (impacts.py)
    kick    v += h F/m; at the end of a half what magnets have added to the angular momentum, as
            contacts have brought tiles elsewhere than to the middle's places, is taken back
    solve   contacts and floor friction at the velocity level (solver.py)
    damp    v *= exp(-h/2 c)
    drift   x += h/2 v
    project deep overlap out of the positions, if any       (projection.py)

A substep is h, or h/2, h/4 or h/8 where a tile that may touch another spins fast: rows foresee the
arc of what goes on turning, but not what an impact makes of it.  It is longer, up to 8 h within a
half, where the scene is calm: next to nothing overlaps, and tiles that may touch are slow.

A free tile goes as if a half were one substep, so that the forces, which change slowly, are
found twice a step; contacts converge better, and spinning tiles meet more exactly, in more and
shorter substeps than in more passes.  The state at the end of a step, with the contact impulses,
is all that the next one needs.  What hits only after that is shown where it is until then, and how
it goes is kept beside (`look_back`, `foresee`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import copy, lean, set_all, whole
from tbsa.kernels.bodies import Bodies, Numbers, with_substep
from tbsa.kernels.contacts import place_rows
from tbsa.kernels.crew import (
    AHEAD,
    APPLY,
    ASSUME,
    BACK,
    BEGIN,
    BEYOND,
    CLEAR,
    DEEP,
    END,
    FILL,
    FLOOR,
    HANG,
    KEEP,
    KICK,
    LEAST_BLOCKS,
    LEAST_TILES,
    LEAVE,
    LINE,
    LIST,
    PACE,
    PAIRS,
    PART,
    PLACE,
    PULL,
    REACT,
    RECALL,
    ROWS,
    SCALE,
    SWEEP,
    TOTAL,
    WORK,
    Crew,
    collect,
    give,
    nobody,
    share,
    store,
    wait_for,
)
from tbsa.kernels.floor import EXACT, FloorLaw
from tbsa.kernels.geometry import CIRCLE, cos_sin
from tbsa.kernels.impacts import Loads, Scratch, forget_early, impacts, keep_together, spread_early
from tbsa.kernels.jit import NO, YES, ZERO, U, inline, kernel, lane, rolled, solo
from tbsa.kernels.magnets import (
    MagnetLaw,
    MagnetPairs,
    add_magnet_forces,
    add_up,
    list_magnets,
    magnets_from,
    magnets_stale,
    place_magnets,
    pull,
    react,
)
from tbsa.kernels.mean_forces import add_mean_forces, any_turns_far
from tbsa.kernels.neighbours import Pairs, list_pairs, pairs_from, place_of, stale
from tbsa.kernels.projection import SLOP, find_deep, part_listed, project
from tbsa.kernels.rows import (
    ALL,
    BETWEEN,
    COLOURS,
    LATE,
    NEAR,
    SCALED,
    SIZES,
    Impulses,
    Rows,
    about_the_same,
    add_rows,
    clear_blocks,
    colour_rows,
    fill_lanes,
    find_islands,
    find_rows,
    recall,
    recall_all,
    remember,
    remember_all,
    rows_from,
)
from tbsa.kernels.solver import find_scales, limit_work, relax, scale_impulses, work_on
from tbsa.kernels.squeeze import ease
from tbsa.kernels.sweeps import (
    apply_blocks,
    apply_impulses,
    floor_tiles,
    sweep_blocks,
    turn_round,
)

# Error words of `advance`.
OK, MORE_PAIRS, MORE_ROWS, MORE_MAGNETS, NOT_FINITE, TOO_FAST, TOO_MANY = range(7)

# Two tiles that may touch turn, in root of the sum of squares, no further than this in a substep
# (rad), or as far as an eighth of the substep allows.  Rows foresee the arc of what goes on
# turning (geometry.py); what an impact or a solve turns otherwise comes nearer, or less near, by up
# to 0.7 w times half the square of this.
TURN = 0.4
TICKS = 8
# ... and a corner goes no further round a round wall than this (rad).
ROUND = 0.06
# Substeps are joined, up to JOINED of them, where the last solve took FEW passes, nothing overlaps
# by more than CALM (widths), and no tiles that may touch go further past each other (widths), or
# turn further (rad), than this in what they are joined to.
JOINED, FEW, CALM, CALM_WAY, CALM_TURN = 8, 8, 1.2 * SLOP, 0.01, 0.2
# ... and where forces may come on from one moment to the next none would bring a point further than
# this (widths).
SUDDEN = 0.03

# Where no tile goes further than this in a step (widths), all are at rest.
STILL = 1e-15

# How long lists last: steps that a tile can go on at its speed and some way more (widths) before
# its pairs are found anew; a fast one fewer, no further than this (widths), but a step for magnets.
# A longer list is older and has more on it that is out of reach.
# Of up to so many tiles all pairs are few.
PAIR_STEPS, PAIR_ROOM, PAIR_MOST, PAIR_FEW = 8.0, 0.35, 0.5, 8
MAGNET_STEPS, MAGNET_ROOM, MAGNET_MOST = 5.0, 0.02, 0.1
# Up to one tile in so many that comes further than assumed, and in the substep of an impact so many
# of a small scene, has its rows added; for more, all rows are found anew.
FEW_TILES = 8
# What an impact throws may hit, in the same substep, what it had no row with, so many times.
THROWN = 4


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


@rolled
def kick(k: Numbers, h: float, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray, v: Bodies,
         kicked: Bodies, noted: bool, begin: int, end: int) -> None:
    """Give every mobile one of these tiles the impulse of the forces; where a solve follows, with
    a note of its velocity at the start of the substep, and when it has been kicked."""
    fm, fi = h / k.mass, h / k.inertia
    vx, vy, w, mobile = v.vx, v.vy, v.w, v.mobile
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    kx, ky, kw = kicked.vx, kicked.vy, kicked.w
    first, last = U(begin), U(end)
    for i in range(first, last if noted else first):
        startx[i], starty[i], startw[i] = vx[i], vy[i], w[i]
        floorx[i] = floory[i] = floort[i] = 0.0
    for i in range(first, last):
        free = mobile[i] != 0.0  # of held tiles a drive may make what is no number
        vx[i] += fm * fx[i] if free else 0.0
        vy[i] += fm * fy[i] if free else 0.0
        w[i] += fi * torque[i] if free else 0.0
    for i in range(first, last if noted else first):
        kx[i], ky[i], kw[i] = vx[i], vy[i], w[i]


@rolled
def note_lag(k: Numbers, h: float, x: np.ndarray, y: np.ndarray, work: Work) -> None:
    """Add up how far tiles are from where the forces of the half were found for, times h (m s)."""
    midx, midy, lagx, lagy = work.midx, work.midy, work.lagx, work.lagy
    for i in range(U(k.front), U(k.n)):
        lagx[i] += h * (x[i] - midx[i])
        lagy[i] += h * (y[i] - midy[i])


@inline
def balance(k: Numbers, work: Work) -> None:
    """At the end of a half, take from spins what magnets have added to the angular momentum of what
    hangs together, as their forces have acted from elsewhere than they were found for.

    There the sum of x cross F and of torques is none.  What flies straight is there in the mean;
    contacts and impacts bring tiles elsewhere, which share it by the square of their lag.
    """
    lagx, lagy, pullx, pully, island = (work.lagx, work.lagy, work.pullx, work.pully,
                                        work.rows.island)
    w, kicked, excess, weight = work.bodies.w, work.shift.w, work.bodies.change, work.shift.change
    first, last = U(k.front), U(k.n)
    for i in range(first, last):
        excess[i] = lagx[i] * pully[i] - lagy[i] * pullx[i]
        weight[i] = lagx[i] * lagx[i] + lagy[i] * lagy[i]
    for i in range(first, last):
        if island[i] != i:
            excess[island[i]] += excess[i]
            weight[island[i]] += weight[i]
    for i in range(first, last):
        lag2, of = lagx[i] * lagx[i] + lagy[i] * lagy[i], U(island[i])
        w[i] -= k.ii * excess[of] * (lag2 / max(weight[of], 1e-300))
        kicked[i] = w[i]


@inline
def stopping(start: float, trial: float, bound: float) -> float:
    """Fraction of a substep that a sliding tile moves before friction stops it.

    `start` is the speed (times mass) at its beginning, `trial` what it would be at its end
    without friction, in the same direction; `bound` the friction impulse of a whole substep.
    """
    slowing = bound - (trial - start)
    return min(start / slowing, 1.0) if slowing > 0.0 else 1.0


@rolled
def find_stopped(k: Numbers, v: Bodies, v0: Bodies, begin: int, end: int) -> int:
    """Mark in ``moved`` which of these tiles friction has stopped without any contact: 1 its way,
    2 its turn.  `v0` are the velocities before the solve.  Returns whether there are any."""
    vx, vy, w, moved = v.vx, v.vy, v.w, v.moved
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    some = 0
    for i in range(U(begin), U(end)):
        # Contacts have done nothing to it: the floor alone takes what it had before the solve.
        tx, ty, tw = v0.vx[i], v0.vy[i], v0.w[i]
        free = ((abs(floorx[i] * k.im + tx) <= 1e-12 * abs(tx))
                & (abs(floory[i] * k.im + ty) <= 1e-12 * abs(ty)))
        alone = abs(floort[i] * k.ii + tw) <= 1e-12 * abs(tw)
        stopped = (vx[i] == 0.0) & (vy[i] == 0.0) & ((startx[i] != 0.0) | (starty[i] != 0.0))
        halted = (w[i] == 0.0) & (startw[i] != 0.0)
        moved[i] = (1 if stopped & free else 0) + (2 if halted & alone else 0)
        some |= moved[i]
    return some


@inline
def drift_back(k: Numbers, floor: FloorLaw, v0: Bodies, v: Bodies, x: np.ndarray, y: np.ndarray,
               angle: np.ndarray, crew: Crew) -> None:
    """Take back what a tile without contact drifted after friction had stopped it.

    The first half of the drift went h/2 v; a tile that stops after the fraction f of the
    substep goes f h/2 v.  Without this a stop is off by up to a h^2 / 2.
    """
    im, ii, moved = k.im, k.ii, v.moved
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    begin, end = give(crew, BACK, k.front, k.n, LEAST_TILES)
    some = find_stopped(k, v, v0, begin, end)
    collect(crew)
    for other in range(1, crew.size if end < k.n else 1):
        some |= crew.found[other * LINE]
    if some == 0:
        return
    for i in range(U(k.front), U(k.n)):
        if moved[i] == 0:
            continue
        ux, uy, uw = startx[i], starty[i], startw[i]
        if moved[i] & 1:
            speed = math.sqrt(ux * ux + uy * uy)
            trial = -(floorx[i] * ux + floory[i] * uy) / speed
            rest = 1.0 - stopping(speed / im, trial, floor.force * k.h)
            x[i] -= 0.5 * k.h * rest * ux
            y[i] -= 0.5 * k.h * rest * uy
        if moved[i] & 2:
            trial = -floort[i] if uw > 0.0 else floort[i]
            rest = 1.0 - stopping(abs(uw) / ii, trial, floor.torque * k.h)
            angle[i] -= 0.5 * k.h * rest * uw


@rolled
def turn(begin: int, end: int, angle: np.ndarray, turned: np.ndarray, c: np.ndarray,
         s: np.ndarray) -> None:
    """Cosine and sine of the angles of these tiles, unless they are there: from the first on that
    has `turned` since they were taken."""
    first, last = U(begin), U(end)
    while first < last and angle[first] == turned[first]:
        first += U(1)
    for i in range(first, last):
        c[i], s[i] = cos_sin(angle[i])
        turned[i] = angle[i]


@rolled
def turn_again(begin: int, end: int, known: bool, angle: np.ndarray, work: Work) -> None:
    """Cosine and sine of the angles of these tiles, or if they are known those of the middle of
    the half."""
    if known:
        for i in range(U(begin), U(end)):
            work.c[i], work.s[i], work.turned[i] = work.mid_c[i], work.mid_s[i], angle[i]
    else:
        turn(begin, end, angle, work.turned, work.c, work.s)


@rolled
def drift(begin: int, end: int, h: float, v: Bodies, x: np.ndarray, y: np.ndarray,
          angle: np.ndarray) -> None:
    """Move these tiles for a time h."""
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(begin), U(end)):
        x[i] += h * vx[i]
        y[i] += h * vy[i]
        angle[i] += h * w[i]


@lane
def at_all(number: float) -> float:
    """A velocity, or 0 for what damping has left of one so small that it is next to no number:
    processors take ten times as long for those."""
    return 0.0 if abs(number) <= 1e-150 else number  # what is no number stays


@rolled
def damp(begin: int, end: int, linear: float, angular: float, v: Bodies) -> None:
    """Slow these tiles down by these factors, if they do."""
    if linear == 1.0 and angular == 1.0:
        return
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(begin), U(end)):
        vx[i] = at_all(linear * vx[i])
        vy[i] = at_all(linear * vy[i])
        w[i] = at_all(angular * w[i])


@rolled
def assume(k: Numbers, left: float, everyone: bool, x: np.ndarray, y: np.ndarray,
           angle: np.ndarray, work: Work, begin: int, end: int) -> None:
    """How far centre and corners of each of these tiles, or of those marked in ``moved``, may come
    from here in the rest of a step, of this length (s), under its forces, and some more.

    The last substep looks ahead to the middle of the next one, which is in the next step.

    A tile that spins stays within its circumscribed circle: its pairs are found by the way of
    the centre alone.
    """
    v, way, far, x0, y0, angle0 = work.bodies, work.way, work.far, work.x0, work.y0, work.angle0
    vx, vy, w, mobile, marked = v.vx, v.vy, v.w, v.mobile, v.moved
    fx, fy, torque = work.fx, work.fy, work.torque
    corner, h = 0.7072 * k.width, left + 0.5 * k.h
    fm, fi = 0.5 * h / k.mass, 0.5 * h * corner / k.inertia
    more = 0.5 * NEAR * k.width
    for i in range(U(begin), U(end)):
        anew = everyone | (marked[i] != 0)
        x0[i] = x[i] if anew else x0[i]
        y0[i] = y[i] if anew else y0[i]
        angle0[i] = angle[i] if anew else angle0[i]
        pace = math.sqrt(vx[i] * vx[i] + vy[i] * vy[i])
        free = mobile[i] != 0.0
        gain = fm * math.sqrt(fx[i] * fx[i] + fy[i] * fy[i]) if free else 0.0
        centre = h * (pace + gain) + more
        corners = centre + h * corner * abs(w[i]) + (h * fi * abs(torque[i]) if free else 0.0)
        way[i] = centre if anew else way[i]
        far[i] = corners if anew else far[i]


@inline
def beyond(k: Numbers, left: float, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
           work: Work) -> int:
    """Mark in ``moved`` the tiles that will come further in the rest of a step, of this length (s),
    than was assumed: such as lay still, perhaps, and have been hit.  Returns how many there are."""
    crew = work.crew
    crew.numbers[5] = left
    begin, end = give(crew, BEYOND, ZERO, k.n, LEAST_TILES)
    some = mark_beyond(k, left, x, y, angle, work, begin, end)
    collect(crew)
    for other in range(1, crew.size if end < k.n else 1):
        some += crew.found[other * LINE]
    return int(some)


@rolled
def mark_beyond(k: Numbers, left: float, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
                work: Work, begin: int, end: int) -> int:
    """The same for these tiles."""
    v, way, far, x0, y0, angle0 = work.bodies, work.way, work.far, work.x0, work.y0, work.angle0
    vx, vy, w, marked = v.vx, v.vy, v.w, v.moved
    corner, time = 0.7072 * k.width, left + 0.5 * k.h
    some = 0
    for i in range(U(begin), U(end)):
        dx, dy, turned = x[i] - x0[i], y[i] - y0[i], abs(angle[i] - angle0[i])
        centre = (math.sqrt(dx * dx + dy * dy)
                  + time * math.sqrt(vx[i] * vx[i] + vy[i] * vy[i]))
        corners = centre + corner * (turned + time * abs(w[i]))
        marked[i] = 1 if (centre > way[i]) | (corners > far[i]) else 0
        some += marked[i]
    return some


@inline
def widest(n: int, x: np.ndarray, y: np.ndarray, pairs: Pairs, way: np.ndarray) -> float:
    """How far any tile may come from where it was when the pairs were listed (m)."""
    px, py = pairs.x, pairs.y
    most = 0.0
    for i in range(U(n)):
        dx, dy = x[i] - px[i], y[i] - py[i]
        most = max(most, math.sqrt(dx * dx + dy * dy) + way[i])
    return most


@lane
def fastest(k: Numbers, rows: Rows, x: np.ndarray, y: np.ndarray, v: Bodies, begin: int,
            end: int) -> Any:
    """Of the tiles of these rows, the squares of how fast two turn, in root of the sum of squares,
    and go past each other, at most; that without what goes along a round wall, which counts as
    a turn (1/s^2, m^2/s^2)."""
    vx, vy, w, ra, rb = v.vx, v.vy, v.w, rows.a, rows.b
    turn2, past2, all2, longest = 0.0, 0.0, 0.0, JOINED * k.h
    round2 = (TURN / (ROUND * k.wall_x))**2 if k.wall == CIRCLE else 0.0
    for i in range(U(begin), U(end)):
        a, b = U(ra[i]), U(rb[i])
        dx, dy = vx[b] - vx[a], vy[b] - vy[a]
        speed2 = dx * dx + dy * dy
        all2 = max(all2, speed2)
        if b == U(k.n) and k.wall == CIRCLE:  # along it tiles slide as they are, but for its bend
            corner = math.sqrt(speed2) + 0.7072 * k.width * abs(w[a])
            turn2 = max(turn2, round2 * corner * corner)
            towards = abs(x[a] * dx + y[a] * dy) + longest * speed2
            speed2 = min(speed2, towards * towards / max(x[a] * x[a] + y[a] * y[a], 1e-300))
        past2 = max(past2, speed2)
        turn2 = max(turn2, w[a] * w[a] + w[b] * w[b])
    return turn2, past2, all2


@inline
def ticks_at(k: Numbers, rows: Rows, x: np.ndarray, y: np.ndarray, v: Bodies, calm: bool,
             crew: Crew) -> int:
    """Length of the next substeps, in eighths of h, after the tiles that have rows; 0 where two
    would go further past each other than their width in one of length h."""
    begin, end = give(crew, PACE, ZERO, rows.size[0], LEAST_TILES)
    turn2, past2, all2 = fastest(k, rows, x, y, v, begin, end)
    collect(crew)
    for other in range(1, crew.size if end < rows.size[0] else 1):
        turn2 = max(turn2, crew.deepest[other * LINE])
        past2 = max(past2, crew.deepest[other * LINE + 1])
        all2 = max(all2, crew.deepest[other * LINE + 2])
    if k.h * math.sqrt(all2) > k.width:
        return 0
    turn, past = math.sqrt(turn2), math.sqrt(past2)
    ticks = TICKS * JOINED if calm and k.join_substeps != 0 else TICKS
    while ticks > TICKS and (ticks * k.h * turn > CALM_TURN * TICKS
                             or ticks * k.h * past > CALM_WAY * k.width * TICKS):
        ticks >>= 1
    while ticks > 1 and ticks * k.h * turn > TURN * TICKS:
        ticks >>= 1
    return ticks


@inline
def fits(found: int, ahead: int, capacity: int) -> bool:
    """Whether a list has space; at the beginning of a step also for some more in its middle."""
    return found + ahead * (found // 4 + 64) <= capacity


@inline
def find_pairs(k: Numbers, reach: float, tiles: Tiles, x: np.ndarray, y: np.ndarray,
               need: np.ndarray, ahead: int, work: Work, counts: Counts) -> int:
    """Bring the pair list up to date, if a tile that goes as `need` (m) may come too far.

    A list has a margin for every tile, after its speed, so that a single fast one does not make
    it long or short-lived for all.  In the middle of a step (`ahead` 0) there are no margins, so
    that the list fits in where a longer one has.  Returns an error word.
    """
    margin, pairs, vx, vy = work.margin, work.pairs, work.bodies.vx, work.bodies.vy
    if ahead * k.keep_lists == ahead and not stale(pairs, k.n, x, y, need):
        return OK
    most = PAIR_MOST * k.width * max(1.0, PAIR_FEW / k.n)
    for i in range(U(k.n)):
        pace = math.sqrt(vx[i] * vx[i] + vy[i] * vy[i])
        way = min(PAIR_STEPS * k.substeps * k.h * pace, most)
        margin[i] = max(PAIR_ROOM * k.width + way, 1.5 * need[i]) if ahead > 0 else need[i]
    found = list_pairs(pairs, k.n, x, y, tiles.mobile, reach, margin, work.crew)
    counts.lists[0] += 1
    if found < 0:
        return NOT_FINITE
    return OK if fits(found, ahead, pairs.room) else MORE_PAIRS


@inline
def find_magnets(k: Numbers, half: float, reach: float, tiles: Tiles, law: MagnetLaw,
                 x: np.ndarray, y: np.ndarray, angle: np.ndarray, turns_far: bool, ahead: int,
                 work: Work, counts: Counts) -> int:
    """Bring the list of magnet pairs up to date for the places at a time `half` from now, or where
    `turns_far` says that a tile does, up to twice that time.

    So no pair within the cut-off is ever missing, whatever the age of the list.  Returns an
    error word.
    """
    need, turning, pace, speed, near = (work.need, work.turning, work.pace, work.speed,
                                        work.magnets)
    vx, vy, w = work.bodies.vx, work.bodies.vy, work.bodies.w
    until = 2.0 * half if turns_far else half
    for i in range(U(k.n)):
        pace[i] = math.sqrt(vx[i] * vx[i] + vy[i] * vy[i])
        speed[i] = pace[i] + 0.7072 * k.width * abs(w[i])
        need[i], turning[i] = until * pace[i], until * speed[i]
    if (ahead * k.keep_lists == ahead
            and not magnets_stale(near, k.n, law.offset, x, y, angle, need, turning)):
        return OK
    if ahead > 0:
        more, most, time = MAGNET_ROOM * k.width, MAGNET_MOST * k.width, k.substeps * k.h
        for i in range(U(k.n)):
            centre, corners = time * pace[i], time * speed[i]
            need[i] += more + max(centre, min(MAGNET_STEPS * centre, most))
            turning[i] += more + max(corners, min(MAGNET_STEPS * corners, most))
    error = find_pairs(k, reach, tiles, x, y, need, ahead, work, counts)
    if error != OK:
        return int(error)
    if work.pairs.start[k.n] > 0:
        turn(ZERO, k.n, angle, work.turned, work.c, work.s)
    counts.magnet_lists[0] += 1
    found = list_magnets(law, work.pairs, k.n, tiles.glues, x, y, angle, work.c, work.s, need,
                         turning, near, work.crew)
    return OK if fits(found, ahead, near.room) else MORE_MAGNETS


@rolled
def look_ahead(half: float, law: MagnetLaw, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
               work: Work, begin: int, end: int) -> None:
    """Where these tiles and their magnets will be in a time `half`."""
    v, fx, fy, torque = work.bodies, work.fx, work.fy, work.torque
    midx, midy, mid_angle = work.midx, work.midy, work.mid_angle
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(begin), U(end)):
        midx[i], midy[i] = x[i] + half * vx[i], y[i] + half * vy[i]
        mid_angle[i] = angle[i] + half * w[i]
        fx[i] = fy[i] = torque[i] = 0.0
    if law.cutoff > 0.0 and work.magnets.size[0] > 0:
        turn(begin, end, mid_angle, work.mid_turned, work.mid_c, work.mid_s)
        place_magnets(work.magnets, law.offset, midx, midy, work.mid_c, work.mid_s, begin, end)


@lane
def place_all(k: Numbers, ahead: float, gain: float, x: np.ndarray, y: np.ndarray, work: Work,
              begin: int, end: int) -> Any:
    """Where the rows of these blocks touch; see `place_rows`."""
    return place_rows(work.rows, with_substep(k, ahead), x, y, work.c, work.s, work.bodies, gain,
                      begin, end)


@inline
def strongest(k: Numbers, floor: FloorLaw, work: Work, loaded: bool) -> float:
    """What forces, if there are any, and floor speed no point of a tile up by more than (m/s^2)."""
    mobile, fx, fy, torque = work.bodies.mobile, work.fx, work.fy, work.torque
    corner, most = 0.7072 * k.width, 0.0
    for i in range(U(k.front), U(k.n) if loaded else U(k.front)):
        pull = (k.im * math.sqrt(fx[i] * fx[i] + fy[i] * fy[i])
                + k.ii * corner * abs(torque[i]))
        most = max(most, pull if mobile[i] != 0.0 else 0.0)
    return most + k.im * floor.force + k.ii * corner * floor.torque


@inline
def find_forces(t: float, k: Numbers, half: float, tiles: Tiles, law: MagnetLaw, drive: Any,
                parameters: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
                turns_far: bool, loaded: bool, work: Work) -> bool:
    """Forces and torques of magnets and drive a time `half` after the tiles are at x, y; where
    `turns_far` says that a tile does, the mean of the magnets' over twice that time.

    Returns whether any may be other than zero, as `loaded` says of those that are there.
    """
    magnetic = law.cutoff > 0.0 and work.magnets.size[0] > 0
    if not (loaded or magnetic or k.driven != 0):
        return False
    n = k.n
    v, fx, fy, torque, crew = work.bodies, work.fx, work.fy, work.torque, work.crew
    midx, midy, mid_angle = work.midx, work.midy, work.mid_angle
    vx, vy, w = v.vx, v.vy, v.w
    crew.numbers[0] = half
    begin, end = give(crew, AHEAD, ZERO, n, LEAST_TILES)
    look_ahead(half, law, x, y, angle, work, begin, end)
    collect(crew)
    if magnetic:
        add_magnet_forces(law, n, work.magnets, fx, fy, torque, crew)
        if turns_far:
            add_mean_forces(law, work.magnets, 2.0 * half, x, y, angle, v, fx, fy, torque)
        copy(fx, work.pullx, n)
        copy(fy, work.pully, n)
        set_all(work.lagx, n, 0.0)
        set_all(work.lagy, n, 0.0)
    if k.driven != 0:
        drive(t, parameters, whole(midx, n), whole(midy, n), whole(mid_angle, n), whole(vx, n),
              whole(vy, n), whole(w, n), whole(tiles.family, n), whole(tiles.forward, n),
              whole(fx, n), whole(fy, n), whole(torque, n))
    return bool(magnetic or k.driven != 0)


@inline
def scale_to(rows: Rows, ticks: int) -> None:
    """Make the impulses of all rows those of a substep of so many eighths of h."""
    before = rows.size[SCALED]
    if before > 0 and ticks != before:
        scale_impulses(rows, ticks / before)
        rows.size[SCALED] = ticks


@lane
def update_rows(k: Numbers, reach: float, left: int, further: int, tiles: Tiles, state: State,
                work: Work, counts: Counts) -> Any:
    """Bring the rows up to date for the rest of a step, of so many eighths of h, in which so many
    tiles, marked in ``moved``, come further than was assumed.

    Returns an error word, and the deepest overlap, where all rows have been found anew; else -1.
    """
    n, x, y, angle, v, rows = k.n, state.x, state.y, state.angle, work.bodies, work.rows
    c, s, far, way, crew = work.c, work.s, work.far, work.way, work.crew
    first = left == k.substeps * TICKS
    few = not first and further <= n // FEW_TILES
    rest = left * (k.h / TICKS)
    if few:
        set_all(work.turned, n + 1, math.nan)  # `add_rows` takes cosines of what it looks at
        assume(k, rest, NO, x, y, angle, work, ZERO, n)
    else:
        crew.numbers[5] = rest
        low, high = give(crew, ASSUME, ZERO, n, LEAST_TILES)
        assume(k, rest, YES, x, y, angle, work, low, high)
        collect(crew)
    if few and add_rows(rows, work.pairs, k, x, y, angle, c, s, v.mobile, v.moved, way, far,
                        widest(n, x, y, work.pairs, way)) >= 0:
        return OK, -1.0
    ahead = np.int64(1) if first else ZERO
    if reach > 0.0:
        error = find_pairs(k, reach, tiles, x, y, way, ahead, work, counts)
        if error != OK:
            return error, -1.0
    if work.pairs.start[n] > 0 or k.wall != 0:  # else nobody asks
        turn(ZERO, n, angle, work.turned, c, s)
    found, others, overlap = find_rows(rows, work.pairs, k, x, y, c, s, tiles.mobile, way, far,
                                       ahead, crew)
    if found < 0:
        return MORE_ROWS, -1.0
    # As if rows had not been there before: a run may go on from here.
    known = rows.size[SCALED] > 0
    if others or not known or (first and rows.size[LATE] > 0):
        ticks = rows.size[SCALED] if known else np.int64(TICKS)
        keep_impulses(k, rows, state, crew)
        if not colour_rows(rows, found, k, v.mobile, crew):
            rows.size[SCALED] = 0
            return MORE_ROWS, -1.0
        recall_all(rows, found, n, state.impulses, crew)
        rows.size[SCALED] = TICKS
        scale_to(rows, ticks)
    return OK, overlap


@inline
def keep_impulses(k: Numbers, rows: Rows, state: State, crew: Crew) -> None:
    """Note the impulses of the rows, if there are any, in the state, as those of a whole h."""
    if rows.size[SCALED] > 0:
        scale_to(rows, np.int64(TICKS))
        remember_all(rows, rows.size[0], k.n, state.impulses, crew)


@inline
def damping(k: Numbers) -> Any:
    """What damping leaves of velocities and spins in half a substep."""
    linear, angular = 0.5 * k.h * k.linear_damping, 0.5 * k.h * k.angular_damping
    return (math.exp(-linear) if linear != 0.0 else 1.0,
            math.exp(-angular) if angular != 0.0 else 1.0)


@inline
def count_all(k: Numbers, mobile: np.ndarray) -> int:
    """How many rows there can be where no wall is, else -1."""
    free = 0
    for i in range(U(k.n)):
        free += 1 if mobile[i] != 0.0 else 0
    return free * (2 * k.n - free - 1) // 2 if k.wall == 0 else -1


@inline
def all_known(rows: Rows) -> bool:
    """Whether every pair that there is has its row: nothing else can be hit."""
    return bool(rows.size[0] == rows.size[ALL])


@inline
def add_thrown(k: Numbers, time: float, state: State, work: Work, counts: Counts) -> bool:
    """Rows that tiles need which an impact has thrown further than was assumed for the rest of the
    step, of this length (s); whether there are any that they had not got.

    Where they are many, or do not fit, all rows are found anew after the substep.
    """
    n, x, y, angle, v = k.n, state.x, state.y, state.angle, work.bodies
    if all_known(work.rows):
        return False
    further = beyond(k, time, x, y, angle, work)
    if further == 0 or further > max(n // FEW_TILES, FEW_TILES):
        return False
    assume(k, time, NO, x, y, angle, work, ZERO, n)
    found = add_rows(work.rows, work.pairs, k, x, y, angle, work.c, work.s, v.mobile, v.moved,
                     work.way, work.far, widest(n, x, y, work.pairs, work.way))
    counts.surprises[0] += 1
    for i in range(n if found < 0 else 0):  # still beyond what is assumed, after the substep
        work.way[i] = -1.0 if v.moved[i] != 0 else work.way[i]
    return bool(found > 0)


@inline
def hit(k: Numbers, ahead: float, left: float, loads: Loads, state: State, work: Work,
        counts: Counts) -> int:
    """Impacts from the middle of a substep on, over a time `ahead` (s), with `left` (s) of the step
    still to go; returns how many points have hit.

    What has been thrown may reach within the substep what it was too slow for: it gets the rows
    that it has not got, and what hits there follows, so many times at most.
    """
    rows, v, x, y, c, s = work.rows, work.bodies, state.x, state.y, work.c, work.s
    ka, points = with_substep(k, ahead), 0
    set_all(work.scratch.since, k.n + 1, 0.0)
    set_all(work.turned, k.n + 1, math.nan)  # impacts move tiles, and take cosines there
    for _ in range(THROWN):
        points += impacts(rows, ka, loads, v, work.scratch, x, y, state.angle, c, s)
        blocks = rows.first[COLOURS]
        if not add_thrown(k, left, state, work, counts):
            break
        struck, _ = place_rows(rows, ka, x, y, c, s, v, loads.gain, blocks, rows.first[COLOURS])
        if struck == 0:
            break
    return points


@inline
def any_live(rows: Rows) -> bool:
    """Whether a solve may have anything to do: what flies past each other needs none."""
    live, some = rows.live, 0
    for block in range(U(rows.first[COLOURS])):
        some |= live[block]
    return some != 0


@inline
def hardly_moves(k: Numbers, v: Bodies) -> bool:
    """Whether no tile goes further than `STILL` in a step; mostly the first ones say no."""
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(U(k.front), U(k.n)):
        pace = abs(vx[i]) + abs(vy[i]) + k.width * abs(w[i])
        if not k.substeps * k.h * pace <= STILL * k.width:  # what is no number moves
            return False
    return True


@lane
def settle(k: Numbers, state: State, v: Bodies, place: Bodies) -> None:
    """Take away what is left of velocities, which is rounding, and note where the tiles are."""
    set_all(v.vx, k.n + 1, 0.0)
    set_all(v.vy, k.n + 1, 0.0)
    set_all(v.w, k.n + 1, 0.0)
    copy(state.x, place.startx, k.n)
    copy(state.y, place.starty, k.n)
    copy(state.angle, place.startw, k.n)


@lane
def stays(k: Numbers, state: State, work: Work) -> bool:
    """Whether no tile has gone further than `STILL` from where it was noted, or is about to, and
    impulses are those noted, but for rounding; if so, puts all back, or roundings would add up."""
    v, place, rows, least = work.bodies, work.shift, work.rows, STILL * k.width
    for i in range(U(k.n)):
        if not (abs(state.x[i] - place.startx[i]) <= least
                and abs(state.y[i] - place.starty[i]) <= least
                and k.width * abs(state.angle[i] - place.startw[i]) <= least):
            return False
    if not (hardly_moves(k, v) and about_the_same(rows, rows.size[0], k.n, state.impulses)):
        return False
    copy(place.startx, state.x, k.n)
    copy(place.starty, state.y, k.n)
    copy(place.startw, state.angle, k.n)
    recall(rows, k.n, state.impulses, ZERO, rows.size[0])
    return True


@lane  # or it is handed some hundred arguments, of a tile or two as well
def substep(k: Numbers, kh: Numbers, ticks: int, middle: float, known: bool, ends: bool,
            ahead: float, left: float, seen: bool, pull: float, slow: float, slow_spin: float,
            floor: FloorLaw, state: State, work: Work, counts: Counts) -> float:
    """A substep of length kh.h, so many eighths of k.h, from whose `middle` (s from its beginning)
    a time `ahead` counts for what may touch; with `left` (s) of the step to go when it begins, and
    nothing sped up by more than `pull` (m/s^2).  `known`: there, angles are those of the middle of
    the half, which `ends` with it.  `seen`: the tiles are looked at when it ends.

    Damping leaves `slow` and `slow_spin` of velocities in half of it.  Returns the deepest overlap
    (m).
    """
    n, h, x, y, angle, last = k.n, kh.h, state.x, state.y, state.angle, state.last
    v, rows, c, s, before, crew = (work.bodies, work.rows, work.c, work.s, work.shift,
                                   work.crew)
    m, overlap = rows.size[0], 0.0
    numbers = crew.numbers
    gain = 2.0 * pull * h * ahead
    numbers[0], numbers[1], numbers[2], numbers[3], numbers[4] = h, ahead, slow, slow_spin, gain
    numbers[6], numbers[9] = middle, known
    work.scratch.size[5] = 0
    counts.substeps[0] += 1
    counts.joined[0] += max(ticks // TICKS - 1, 0)
    counts.rows[0] += m

    low, high = give(crew, BEGIN, k.front, n, LEAST_TILES)
    drift(low, high, middle, v, x, y, angle)
    damp(low, high, slow, slow_spin, v)
    if m > 0 or floor.law == EXACT:
        turn_again(low, high, known, angle, work)
    collect(crew)

    loads = Loads(h, gain, work.fx, work.fy, work.torque, floor, h - middle if seen else math.inf,
                  slow, slow_spin, state.early, state.seen)
    if m > 0:
        blocks = rows.first[COLOURS]
        low, high = give(crew, PLACE, ZERO, blocks, LEAST_BLOCKS)
        struck, overlap = place_all(k, ahead, gain, x, y, work, low, high)
        collect(crew)
        for other in range(1, crew.size if high < blocks else 1):
            struck += crew.found[other * LINE]
            overlap = max(overlap, crew.deepest[other * LINE])
        note_overlap(overlap, k.width, ticks, counts)
        last[2] = 0
        if struck > 0:
            last[2] = hit(k, ahead, left - middle, loads, state, work, counts)
            counts.impacts[0] += last[2]
            counts.unconverged[0] += work.scratch.size[5]
            m = rows.size[0]
    else:
        counts.overlap[0] += ticks
        last[2] = 0

    low, high = give(crew, KICK, k.front, n + 1, LEAST_TILES)
    kick(k, h, work.fx, work.fy, work.torque, v, before, m > 0 or floor.law != 0, low, high)
    collect(crew)
    if work.magnets.size[0] > 0 and not (known and last[2] == 0):
        note_lag(k, h, x, y, work)  # of the whole half, though rows may come in its middle
        if ends and m > 0:
            balance(k, work)
    live = m > 0 and (k.skip_converged == 0 or any_live(rows))
    last[0] = 0
    rows.effort[0] += 0 if live else m
    rows.effort[1] += 0 if live else m
    if live or floor.law != 0:
        if live:
            if rows.size[BETWEEN] > 0:
                ease(rows, k, v)
            apply_impulses(rows, k.per_mass, v, crew)
        passes = relax(rows, m if live else ZERO, kh, floor, c, s, v, crew)
        last[0] = passes if passes >= 0 else -1 - passes
        counts.unconverged[0] += 1 - work.scratch.size[5] if passes < 0 else 0
        counts.passes[0] += last[0]
        if live:
            limit_work(rows, kh, floor, c, s, v, before, crew)
        if floor.law != 0:
            turn_round(rows, floor, kh, c, s, v)
            drift_back(kh, floor, before, v, x, y, angle, crew)

    if state.early[0] > 0:
        spread_early(rows, k, loads, v, before, x, y, angle)
    low, high = give(crew, END, k.front, n, LEAST_TILES)
    damp(low, high, slow, slow_spin, v)
    drift(low, high, h - middle, v, x, y, angle)
    collect(crew)
    if live and project(rows, with_substep(k, ahead), ahead - (h - middle), v, work.shift, x, y,
                         angle, c, s, crew):
        counts.projections[0] += 1
        if state.early[0] > 0:
            forget_early(rows, k.n, loads, work.shift)
    if work.scratch.size[3] > 0:
        keep_together(rows, k, work.scratch)
    return overlap


@inline
def look_back(state: State) -> None:
    """Put the tiles that hit only after now to where they are, and keep how they go then."""
    early, seen, goes = state.early, state.seen, state.goes
    for j in range(early[0]):
        i = U(early[j + 1])
        for f, numbers in enumerate((state.x, state.y, state.angle, state.vx, state.vy,
                                     state.omega)):
            goes[6 * j + f], numbers[i] = numbers[i], seen[6 * j + f]


@inline
def foresee(state: State) -> None:
    """Put the tiles that `look_back` has put to where they are back to how they go, unless
    somebody else has moved them meanwhile."""
    early, seen, goes = state.early, state.seen, state.goes
    for j in range(early[0]):
        i, o = U(early[j + 1]), 6 * j
        if (state.x[i] == seen[o] and state.y[i] == seen[o + 1] and state.angle[i] == seen[o + 2]
                and state.vx[i] == seen[o + 3] and state.vy[i] == seen[o + 4]
                and state.omega[i] == seen[o + 5]):
            for f, numbers in enumerate((state.x, state.y, state.angle, state.vx, state.vy,
                                         state.omega)):
                numbers[i] = goes[o + f]
    early[0] = 0


@lane
def go_on(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
          drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
          begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance by `steps` steps; the run has `begun` with so many.

    Returns the error word and the steps done; on MORE_PAIRS, MORE_ROWS and MORE_MAGNETS the state
    is that before the step that failed, and the caller goes on with more space.  TOO_MANY: pairs
    have multiplied within a step.
    """
    n, x, y, angle, last, v, rows = (k.n, state.x, state.y, state.angle, state.last, work.bodies,
                                     work.rows)
    foresee(state)
    copy(state.vx, v.vx, n + 1)
    copy(state.vy, v.vy, n + 1)
    copy(state.omega, v.w, n + 1)
    copy(tiles.mobile, v.mobile, n + 1)
    vx, vy, w = v.vx, v.vy, v.w
    contacts, magnetic = reach > 0.0 or k.wall != 0, magnets.cutoff > 0.0 and reach > 0.0
    parts, all_ticks, tick = (2 if k.substeps % 2 == 0 else 1), k.substeps * TICKS, k.h / TICKS
    part_length = k.substeps * k.h / parts
    set_all(work.turned, n + 1, math.nan)
    set_all(work.mid_turned, n + 1, math.nan)
    set_all(rows.first, np.int64(COLOURS + 1), ZERO)
    set_all(rows.size, np.int64(SIZES), ZERO)
    rows.size[ALL] = count_all(k, v.mobile)
    rows.effort[0] = rows.effort[1] = 0
    error, done, wanted, overlap = OK, 0, TICKS, 0.0
    fresh = last[1] == 0  # nothing has looked ahead yet
    loaded, counted = YES, so_far(rows, counts)  # loaded by what was there before
    promised = max(last[1], 1)
    kh = with_substep(k, k.h)
    slow, slow_spin = damping(kh)
    for step in range(steps):
        # A step depends on the state alone: one that leaves it as it is need not be done again.
        rests = not fresh and hardly_moves(k, v)
        if rests:
            settle(k, state, v, work.shift)
            keep_impulses(k, rows, state, work.crew)
            counted = so_far(rows, counts)
        before = (promised, last[0], last[2])
        left = all_ticks
        further: Any = np.int64(n if contacts else 0)  # tiles that come further than assumed
        late = rows.size[LATE]
        for part in range(parts):
            turns_far = magnetic and any_turns_far(n, w, part_length, work.magnets.turns)
            if magnetic:
                error = find_magnets(k, 0.5 * part_length, reach, tiles, magnets, x, y, angle,
                                     turns_far, np.int64(1) if part == 0 else ZERO, work, counts)
                if error != OK:
                    break
            loaded = find_forces(
                (begun + step) * (k.substeps * k.h) + (part + 0.5) * part_length, k,
                0.5 * part_length, tiles, magnets, drive, drive_parameters, x, y, angle, turns_far,
                loaded, work)
            counts.magnet_pairs[0] += work.magnets.size[0]
            hardest: float = -1.0  # not asked for yet
            most: Any = all_ticks
            end = left - all_ticks // parts
            while left > end:
                if further > 0:
                    error, found = update_rows(k, reach, left, further, tiles, state, work, counts)
                    overlap = found if found >= 0.0 else overlap
                # Where there can be no other rows, nobody asks who comes further than assumed.
                others = further > 0 or rows.size[LATE] > late
                if others or (all_known(rows) and rows.size[0] > 0):
                    if error != OK:
                        break
                    pace = ticks_at(k, rows, x, y, v,
                                    last[0] <= FEW and overlap <= CALM * k.width, work.crew)
                    if pace == 0:
                        error = TOO_FAST
                        break
                    wanted = pace if others or last[2] > 0 else min(wanted, pace)
                if hardest < 0.0 and rows.size[0] > 0:
                    hardest = strongest(k, floor, work, loaded)
                    way = hardest * tick * tick if k.driven > 1 else 0.0  # in an eighth of h
                    while most > TICKS and way * most * most > SUDDEN * k.width:
                        most = max(most >> 1, np.int64(TICKS))
                # What has just hit is where it is to be only after the time that was foreseen.
                ticks = min(promised, left - end)
                ticks = ticks if last[2] > 0 else min(min(wanted, most), ticks)
                rest = left - end - ticks
                promised = min(min(wanted, most), rest if rest > 0 else all_ticks // parts)
                scale_to(rows, ticks)
                if ticks * tick != kh.h:
                    kh = with_substep(k, ticks * tick)
                    slow, slow_spin = damping(kh)
                # From the middle of this substep to that of the next; the first looks at once.
                middle = 0.0 if fresh else 0.5 * ticks * tick
                ahead = (ticks + 0.5 * promised) * tick - middle
                fresh = False
                late = rows.size[LATE]
                known = (left - end == all_ticks // parts and middle == 0.5 * part_length
                         and magnetic and work.magnets.size[0] > 0)
                overlap = substep(k, kh, ticks, middle, known, left - ticks == end, ahead,
                                  left * tick, step + 1 == steps and left == ticks, hardest, slow,
                                  slow_spin, floor, state, work, counts)
                wanted = min(wanted, TICKS) if overlap > CALM * k.width else wanted
                wanted >>= 1 if last[0] > FEW and wanted > TICKS else 0
                left -= ticks
                missing = contacts and left > 0 and not all_known(rows)
                further = beyond(k, left * tick, x, y, angle, work) if missing else 0
                counts.surprises[0] += 1 if further > 0 else 0
            if error != OK:
                break
        if error != OK:
            if left < all_ticks and error != TOO_FAST:
                return TOO_MANY if error != NOT_FINITE else NOT_FINITE, done
            break
        # A call may end here, and the next begins like this; to scale by 6 and back is not exact.
        scale_to(rows, np.int64(TICKS))
        done += 1
        counts.steps[0] += 1
        if (rests and stays(k, state, work) and k.skip_still != 0
                and promised == before[0] and last[0] == before[1] and last[2] == before[2]):
            note_still(steps - done, counted, rows, counts)
            done = steps
            break
    last[1] = 0 if fresh else promised  # of a first step that lacked space it is still to come
    keep_impulses(k, rows, state, work.crew)
    copy(vx, state.vx, n + 1)
    copy(vy, state.vy, n + 1)
    copy(w, state.omega, n + 1)
    look_back(state)
    counts.solves[0] += rows.effort[0]
    counts.unsolved[0] += rows.effort[1]
    for i in range(n):
        if not (np.isfinite(vx[i]) and np.isfinite(vy[i]) and np.isfinite(w[i])):
            error = NOT_FINITE
    return error, done


@solo
def advance(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
            drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
            begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance a scene in one thread, see `go_on`."""
    state, tiles, work, counts = lean(state), lean(tiles), lean(work), lean(counts)
    error, done = go_on(state, tiles, k, magnets, floor, drive, drive_parameters,
                        by_itself(work), counts, begun, steps, reach)
    return error, done


@kernel
def advance_together(state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw, floor: FloorLaw,
                     drive: Any, drive_parameters: np.ndarray, work: Work, counts: Counts,
                     begun: int, steps: int, reach: float) -> tuple[int, int]:
    """Advance a scene as thread 0 of its crew, see `go_on`; the others run `help_out`."""
    state, tiles, work, counts = lean(state), lean(tiles), lean(work), lean(counts)
    error, done = go_on(state, tiles, k, magnets, floor, drive, drive_parameters, work, counts,
                        begun, steps, reach)
    return error, done


@kernel
def help_out(me: int, job: int, state: State, tiles: Tiles, k: Numbers, magnets: MagnetLaw,
             floor: FloorLaw, work: Work) -> None:
    """Thread `me` > 0 of a crew: do shares of what thread 0 gives out after job number `job`,
    until it is told to leave."""
    state, tiles, work = lean(state), lean(tiles), lean(work)
    x, y, angle, v, rows, crew = (state.x, state.y, state.angle, work.bodies, work.rows,
                                  work.crew)
    while True:
        job += 1
        wait_for(crew.job, 0, job)
        what = crew.what[0]
        if what == LEAVE:
            return
        h, ahead_time, slow, slow_spin, gain = (crew.numbers[0], crew.numbers[1],
                                                crew.numbers[2], crew.numbers[3],
                                                crew.numbers[4])
        first, last = share(crew, me, crew.what[1], crew.what[2])
        if what == PAIRS:
            crew.found[me * LINE] = pairs_from(
                work.pairs, k.n, x, y, tiles.mobile, crew.numbers[0], work.margin,
                crew.numbers[1], first, last, place_of(work.pairs.room, first, k.n),
                place_of(work.pairs.room, last, k.n))
        elif what == BEGIN:
            drift(first, last, crew.numbers[6], v, x, y, angle)
            damp(first, last, slow, slow_spin, v)
            turn_again(first, last, crew.numbers[9] != 0.0, angle, work)
        elif what == PLACE:
            struck, deepest = place_all(k, ahead_time, gain, x, y, work, first, last)
            crew.found[me * LINE], crew.deepest[me * LINE] = struck, deepest
        elif what == KICK:
            kick(k, h, work.fx, work.fy, work.torque, v, work.shift, True, first, last)
        elif what == APPLY:
            apply_blocks(rows, k.per_mass, v, first, last)
        elif what == SWEEP:
            crew.found[me * LINE], crew.deepest[me * LINE] = sweep_blocks(
                rows, with_substep(k, h), v, first, last)
        elif what == FLOOR:
            floor_tiles(floor, with_substep(k, h), work.c, work.s, v, first, last)
        elif what == WORK:
            work_on(k, v, work.shift, first, last)
        elif what == SCALE:
            crew.found[me * LINE] = find_scales(rows, v, work.shift, first, last)
        elif what == BACK:
            crew.found[me * LINE] = find_stopped(k, v, work.shift, first, last)
        elif what == DEEP:
            find_deep(rows, with_substep(k, ahead_time), first, last)
        elif what == PART:
            part_listed(rows, with_substep(k, ahead_time), v, work.shift, x, y, angle, work.c,
                        work.s, crew.numbers[7], crew.numbers[8], first, last)
        elif what == END:
            damp(first, last, slow, slow_spin, v)
            drift(first, last, h - crew.numbers[6], v, x, y, angle)
        elif what == LIST:
            pairs, left = magnets_from(
                magnets, work.pairs, k.n, tiles.glues, x, y, work.c, work.s, work.need,
                work.turning, work.magnets, me, crew.size, first, last)
            crew.found[me * LINE], crew.found[me * LINE + 1] = pairs, left
        elif what == ASSUME:
            assume(k, crew.numbers[5], YES, x, y, angle, work, first, last)
        elif what == BEYOND:
            crew.found[me * LINE] = mark_beyond(k, crew.numbers[5], x, y, angle, work, first, last)
        elif what == PACE:
            turn2, past2, all2 = fastest(k, rows, x, y, v, first, last)
            crew.deepest[me * LINE], crew.deepest[me * LINE + 1] = turn2, past2
            crew.deepest[me * LINE + 2] = all2
        elif what == KEEP:
            crew.found[me * LINE] = remember(rows, k.n, state.impulses, first, last)
        elif what == CLEAR:
            clear_blocks(rows, k.n, first, last)
        elif what == HANG:
            if me == 1:
                find_islands(rows, crew.what[2], k.n, tiles.mobile)
        elif what == FILL:
            fill_lanes(rows, k, tiles.mobile, first, last)
        elif what == RECALL:
            recall(rows, k.n, state.impulses, first, last)
        elif what == ROWS:
            m, deepest = rows_from(rows, work.pairs, k, x, y, work.c, work.s, tiles.mobile,
                                   work.way, work.far, me, crew.size, first, last)
            crew.found[me * LINE], crew.deepest[me * LINE] = m, deepest
        elif what == AHEAD:
            look_ahead(h, magnets, x, y, angle, work, first, last)
        elif what == PULL:
            pull(magnets, work.magnets, crew.what[1], first, last)
        elif what == REACT:
            react(work.magnets, crew.what[1], crew.what[2], False, me == 1)
        elif what == TOTAL:
            add_up(work.magnets, work.fx, work.fy, work.torque, first, last)
        store(crew.done, me * LINE, job)


@kernel
def dismiss(crew: Crew) -> None:
    """Let the helpers of a crew leave."""
    crew = lean(crew)
    crew.what[0] = LEAVE
    store(crew.job, 0, crew.job[0] + 1)
