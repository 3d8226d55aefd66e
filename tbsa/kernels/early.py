"""What is shown when somebody looks at the tiles, between two steps.

A substep deals with what hits up to the middle of the next one, and an impact puts a tile to where
its new velocity comes from.  At the end of a step, that is within what it hits, by up to half a
substep's way: there the arrays show it where it is, as it goes before the hit, and how it goes
afterwards is kept beside, for the next step.
"""

from __future__ import annotations

import math

import numpy as np

from tbsa.kernels.arrays import set_all
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.hits import Loads
from tbsa.kernels.jit import ZERO, U, apart, inline
from tbsa.kernels.rows import LANES, PN0, PN1, PT, Rows, bodies_of, lane_of
from tbsa.kernels.state import State


@inline
def note_seen(loads: Loads, i: int, x: float, y: float, angle: float, vx: float, vy: float,
              w: float) -> None:
    """Note where tile i is at the end of the substep, going like this from its middle on."""
    early, seen, end, m = loads.early, loads.seen, loads.end, loads.early[0]
    early[0], early[m + 1] = m + 1, i
    ux, uy, uw = loads.slow * vx, loads.slow * vy, loads.slow_spin * w
    for f, number in enumerate((x + end * ux, y + end * uy, angle + end * uw, ux, uy, uw)):
        seen[6 * m + f] = number


@apart
def note_early(loads: Loads, v: Bodies, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
               i: int) -> None:
    """Note where tile i will be at the end of the substep, as it hits only after that, if it is
    for the first time: an impact puts it to where its new velocity comes from, within what it
    hits."""
    for j in range(loads.early[0]):
        if loads.early[j + 1] == i:
            return
    note_seen(loads, i, x[i], y[i], angle[i], v.vx[i], v.vy[i], v.w[i])


@inline
def note_before(loads: Loads, v: Bodies, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
                i: int) -> None:
    """Note that tile i goes on as before the solve, if it does for the first time."""
    if v.mobile[i] != 0.0 and v.moved[i] == 0:
        v.moved[i] = 1
        note_seen(loads, i, x[i], y[i], angle[i], v.startx[i], v.starty[i], v.startw[i])


@apart
def spread_early(rows: Rows, k: Numbers, loads: Loads, v: Bodies, u: Bodies, x: np.ndarray,
                 y: np.ndarray, angle: np.ndarray) -> None:
    """Note as well what the tiles that hit after the end have pressed on in the solve, from where
    they go then: it goes on as it did, so that momentum is that of one moment.

    Without forces, so does all that hangs together with one, if contacts have done work on the
    rest: they have not on all of it (`u`: velocities before the solve).
    """
    early, moved, r, body, island, work = (loads.early, v.moved, rows.field, rows.body,
                                           rows.island, v.change)
    set_all(moved, k.n + 1, ZERO)
    for j in range(early[0]):
        moved[early[j + 1]] = 1
    j = 0
    while j < early[0]:
        j += 1
        for p in range(rows.start[early[j]], rows.start[early[j] + 1]):
            at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
            if r[at + PN0] != 0.0 or r[at + PN1] != 0.0 or r[at + PT] != 0.0:
                note_before(loads, v, x, y, angle, body[t])
                note_before(loads, v, x, y, angle, body[t + LANES])
    if loads.gain > 0.0:
        return
    set_all(work, k.n + 1, 0.0)
    for i in range(k.n):
        if v.mobile[i] != 0.0 and moved[i] == 0:
            work[island[i]] += (
                k.mass * ((v.vx[i] - u.vx[i]) * (v.vx[i] + u.vx[i])
                          + (v.vy[i] - u.vy[i]) * (v.vy[i] + u.vy[i]))
                + k.inertia * (v.w[i] - u.w[i]) * (v.w[i] + u.w[i]))
    for j in range(early[0]):
        i = island[early[j + 1]]
        work[i] = math.inf if work[i] > 0.0 else work[i]
    for i in range(k.n):
        if work[island[i]] == math.inf:
            note_before(loads, v, x, y, angle, i)


@apart
def forget_early(rows: Rows, n: int, loads: Loads, shift: Bodies) -> None:
    """Take back the notes of what hangs together with one that projection has moved, as that has
    changed its velocities, too; where forces act, they are moved along."""
    early, seen, island, moved = loads.early, loads.seen, rows.island, shift.moved
    if loads.gain > 0.0:
        for j in range(early[0]):
            i = early[j + 1]
            for f, way in enumerate((shift.vx[i], shift.vy[i], shift.w[i])):
                seen[6 * j + f] += way
        return
    set_all(moved, n + 1, ZERO)
    for j in range(1, early[0] + 1):
        i = early[j]
        if shift.vx[i] != 0.0 or shift.vy[i] != 0.0 or shift.w[i] != 0.0:
            moved[island[i]] = 1
    m = 0
    for j in range(early[0]):
        early[m + 1] = early[j + 1]
        for f in range(6):
            seen[6 * m + f] = seen[6 * j + f]
        m += 1 - moved[island[early[j + 1]]]
    early[0] = m


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
