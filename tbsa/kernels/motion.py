"""How tiles go without contacts: kicked by forces, damped, drifting, and stopped by the floor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.crew import BACK, LEAST_TILES, LINE, Crew, collect, give
from tbsa.kernels.floor import FloorLaw
from tbsa.kernels.geometry import cos_sin
from tbsa.kernels.jit import U, inline, lane, rolled
from tbsa.kernels.state import Work


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
    processors take several times as long for those."""
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


@inline
def damping(k: Numbers) -> Any:
    """What damping leaves of velocities and spins in half a substep."""
    linear, angular = 0.5 * k.h * k.linear_damping, 0.5 * k.h * k.angular_damping
    return (math.exp(-linear) if linear != 0.0 else 1.0,
            math.exp(-angular) if angular != 0.0 else 1.0)
