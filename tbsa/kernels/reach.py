"""How far tiles may come in what is left of a step, and how short its substeps are to be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.crew import BEYOND, LEAST_TILES, LINE, PACE, Crew, collect, give
from tbsa.kernels.geometry import CIRCLE
from tbsa.kernels.jit import ZERO, U, inline, lane, rolled
from tbsa.kernels.neighbours import Pairs
from tbsa.kernels.projection import SLOP
from tbsa.kernels.rows import NEAR, Rows
from tbsa.kernels.state import Work

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
