"""The contact solve: projected Gauss-Seidel over blocks of manifolds and over floor patches.

A manifold is solved exactly (`manifold.py`); what is left to Gauss-Seidel is the coupling between
manifolds.  Friction with the floor is a bounded impulse of each tile (`floor.py`) and is solved
between the passes (`sweeps.py`).

While many rows change, passes are over all blocks; mostly that is one.  It leaves a few rows in a
hundred that change by more than half the tolerance; those, and the rows of the tiles that they
move, are solved one by one until nothing changes.  Where a few passes are not enough, and the floor
has no friction, they go on with momentum (`momentum.py`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tbsa.kernels.arrays import copy, set_all
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.crew import LEAST_TILES, LINE, SCALE, WORK, Crew, collect, give
from tbsa.kernels.floor import FloorLaw, floor_impulse
from tbsa.kernels.jit import YES, ZERO, U, apart, inline, lane, rolled
from tbsa.kernels.momentum import PLAIN, hasten
from tbsa.kernels.rows import BLOCK, COLOURS, LANES, PN0, PN1, PT, Rows, bodies_of, lane_of
from tbsa.kernels.sweeps import (
    LITTLE,
    LONG,
    MANY,
    floor_below,
    part_of,
    queue_changed,
    sweep_floor,
    sweep_queue,
    sweep_rows,
    sweep_stale,
)


@inline
def relax(rows: Rows, m: int, k: Numbers, floor: FloorLaw, c: np.ndarray, s: np.ndarray,
          v: Bodies, crew: Crew) -> int:
    """Gauss-Seidel passes until none changes a contact velocity by more than the tolerance,
    after their speed.

    The impulses that the rows carry must already have been applied.  Passes are over all blocks
    while many rows change, then over the rows on a list.  On a floor with friction they go forward
    and backward by turns, and have no momentum, which needs passes that all go the same way: with
    those a block that the floor helps to hold creeps.
    Returns the number of passes, or -1 - passes where the limit was reached first.
    """
    if floor.law != 0:
        sweep_floor(floor, k, c, s, v, crew)
    if m == 0:
        return 0
    now, queued = rows.now, rows.queued
    little = LITTLE * k.tolerance
    set_all(v.moved, k.n + 1, ZERO)
    done, whole, listed = -1 - k.passes, YES, False
    size = ZERO
    for p in range(k.passes):
        if floor.law == 0 and p == PLAIN:
            return int(hasten(rows, m, k, v, whole, size, crew))
        rows.effort[0] += m
        listed = not whole
        if whole:
            for j in range(size):
                queued[now[j]] = 0
            many, worst = sweep_rows(rows, k, v, p < PLAIN or p % 2 == 0, crew)
            if floor.law != 0:
                sweep_floor(floor, k, c, s, v, crew)
            ends = worst <= k.tolerance or p + 1 == k.passes  # then nobody asks for a list
            whole = ((k.skip_converged == 0 or MANY * many > rows.first[COLOURS])
                     and part_of(k, p + 1 >= LONG) == 1.0)
            size = 0 if whole or ends else queue_changed(rows, k.n, floor.law, v, little)
        else:
            rows.effort[1] += m - size
            size, worst = sweep_queue(rows, size, k, floor, c, s, v, little, part_of(k, p >= LONG))
            whole = size > rows.first[COLOURS] and part_of(k, p + 1 >= LONG) == 1.0
        copy(rows.then, now, size)
        if worst <= k.tolerance:
            done = p + 1
            break
    for j in range(size):
        queued[now[j]] = 0
    if floor.law != 0 and listed:
        sweep_stale(floor, k, c, s, v)
    return done


@rolled
def scale_impulses(rows: Rows, scale: float) -> None:
    """Multiply the impulses of all rows."""
    if scale == 1.0:
        return
    r = rows.field
    for block in range(rows.first[COLOURS]):
        o = U(block) * BLOCK
        for i in range(LANES):
            r[o + PN0 + i] *= scale
            r[o + PN1 + i] *= scale
            r[o + PT + i] *= scale


@lane
def work_between(k: Numbers, v: Bodies, u: Bodies, i: int, ax: float, ay: float, at: float) -> Any:
    """The work of the contacts of tile i (J), as the two terms of a parabola in their scale: along
    the mean of its velocity and of the one at which they begin, which is `u` and what an impulse
    of the floor (`ax`, `ay`, `at`; N s, N m s) makes of it."""
    gx, gy, gw = k.im * v.floorx[i], k.im * v.floory[i], k.ii * v.floort[i]
    dx, dy, dw = v.vx[i] - gx - u.vx[i], v.vy[i] - gy - u.vy[i], v.w[i] - gw - u.w[i]
    energy = 0.5 * (k.mass * (dx * dx + dy * dy) + k.inertia * dw * dw)
    power = (k.mass * (dx * (u.vx[i] + 0.5 * (gx + k.im * ax))
                       + dy * (u.vy[i] + 0.5 * (gy + k.im * ay)))
             + k.inertia * dw * (u.w[i] + 0.5 * (gw + k.ii * at)))
    return energy, power


@lane
def scale_of(energy: float, power: float) -> float:
    """By what the impulses of an island are to be scaled, for their work not to be positive."""
    return max(-power / energy, 0.0) if energy + power > 1e-14 * energy else 1.0


@rolled
def work_on(k: Numbers, v: Bodies, u: Bodies, begin: int, end: int) -> None:
    """The work that contacts do on each of these tiles from `u` on, into both ``change``."""
    for i in range(U(begin), U(end)):
        v.change[i], u.change[i] = work_between(k, v, u, i, 0.0, 0.0, 0.0)


@rolled
def find_scales(rows: Rows, v: Bodies, u: Bodies, begin: int, end: int) -> int:
    """In place of the second term, for each of these tiles that stands for an island, by what its
    impulses are to be scaled, else 1; returns how many islands work has been done on."""
    energy, power, island = v.change, u.change, rows.island
    some = 0
    for i in range(U(begin), U(end)):
        power[i] = scale_of(energy[i], power[i]) if island[i] == i else 1.0
        some += 1 if power[i] != 1.0 else 0
    return some


@apart
def really_works(k: Numbers, floor: FloorLaw, island: np.ndarray, tiles: np.ndarray, size: int,
                 c: np.ndarray, s: np.ndarray, v: Bodies, u: Bodies) -> None:
    """Of the islands that are to be scaled, which have these `size` tiles, let those alone whose
    contacts have done no work beside the floor, and put the scales of the others right.

    What the floor would do without the contacts, it does before them: a tile that it holds against
    its load does not move, and what pushes it the same way does no work.  The motion with contacts
    and the one without are least of the same convex function, where contacts are smooth, so that
    the work between them is never positive in a solved problem.
    """
    m, inertia, R, Q = 1.0 / k.im, 1.0 / k.ii, floor.force * k.h, floor.torque * k.h
    scale, energy, power = u.change, u.floorx, u.floory
    for j in range(size):
        energy[tiles[j]] = power[tiles[j]] = 0.0
    for j in range(size):
        i = U(tiles[j])
        px, py, pt, _, _ = floor_impulse(floor.law, v.startx[i], v.starty[i], v.startw[i], u.vx[i],
                                         u.vy[i], u.w[i], m, inertia, R, Q, c[i], s[i])
        some, more = work_between(k, v, u, i, px, py, pt)
        energy[island[i]] += some
        power[island[i]] += more
    for j in range(size):
        i = U(tiles[j])
        scale[i] = scale_of(energy[i], power[i]) if island[i] == i else 1.0


@inline
def limit_work(rows: Rows, k: Numbers, floor: FloorLaw, c: np.ndarray, s: np.ndarray, v: Bodies,
               u: Bodies, crew: Crew) -> None:
    """Scale the contact impulses down of what, hanging together, would be done work on.

    A solved contact problem only takes energy from the velocities `u` that it began with; one
    that was broken off, above all one begun with the impulses of a substep before whose load
    has gone, may add some.  The work, impulses times mean velocity, is a parabola in the scale.
    Where tiles have no rows with others, these have their own.
    """
    vx, vy, w, ux, uy, uw = v.vx, v.vy, v.w, u.vx, u.vy, u.w
    floorx, floory, floort, island = v.floorx, v.floory, v.floort, rows.island
    n = U(k.n)
    energy, power = v.change, u.change
    begin, end = give(crew, WORK, k.front, k.n, LEAST_TILES)
    work_on(k, v, u, begin, end)
    collect(crew)
    for i in range(U(k.front), n):  # a loop of its own: sums are in order, and do not vectorise
        first = island[i]
        if first != i:
            energy[first] += energy[i]
            power[first] += power[i]
    begin, end = give(crew, SCALE, k.front, k.n, LEAST_TILES)
    some = find_scales(rows, v, u, begin, end)
    collect(crew)
    for other in range(1, crew.size if end < k.n else 1):
        some += crew.found[other * LINE]
    if some == 0:
        return
    scale = power
    tiles, size = v.stirred, ZERO
    for i in range(U(k.front), n):
        tiles[size] = i
        size += 1 if scale[island[i]] != 1.0 else 0
    if floor.law != 0:
        really_works(k, floor, island, tiles, size, c, s, v, u)
    r, body, mobile = rows.field, rows.body, v.mobile
    for j in range(size):
        i = tiles[j]
        part = scale[island[i]]
        if part == 1.0:
            continue
        vx[i] = ux[i] + part * (vx[i] - k.im * floorx[i] - ux[i])
        vy[i] = uy[i] + part * (vy[i] - k.im * floory[i] - uy[i])
        w[i] = uw[i] + part * (w[i] - k.ii * floort[i] - uw[i])
        floorx[i] = floory[i] = floort[i] = 0.0
        if floor.law != 0:
            floor_below(floor.law, i, floor, k, c, s, v)
        for p in range(rows.start[i], rows.start[i + 1]):
            at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
            if body[t] == i or mobile[body[t]] == 0.0:  # of two tiles the first one scales it
                r[at + PN0] *= part
                r[at + PN1] *= part
                r[at + PT] *= part
