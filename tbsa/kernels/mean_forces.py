"""Magnet forces between tiles that turn far, as seen from each other, while these forces act.

Forces are found for the middle of half a step and act through all of it.  A tile that turns by a
right angle from one middle to the next shows the same four magnets each time, as if it did not
turn, and gets the energy of several bonds from what it passes.  The forces between such tiles are
therefore taken at several places of the way that both go, evenly in time, and their mean acts: its
work is the difference of the energies at both ends, as that of the true force.

Tiles that turn as one, as those of a block do, see nothing of it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies
from tbsa.kernels.geometry import cos_sin
from tbsa.kernels.jit import ZERO, U, inline, lane, rolled
from tbsa.kernels.magnets import CHUNK, FEW, WAY, MagnetLaw, MagnetPairs, pull_of

# How far (rad) a tile turns at most from one place to the next, up to MOST_PLACES of them.
FAR = 0.15
MOST_PLACES = 64
QUARTER = 0.5 * math.pi
# Pairs of magnets are worked on so many at a time, a field of all of them next to each other: from
# the centre of a's tile to that of b's, and how much further that is at the next place (m); the
# arms of both magnets (m), cosines and sines of how far they turn; the polarity times alpha
# (N m^2); the number of places; and the sums of the force on a (N) and of both torques (N m).
(DX, DY, UX, UY, AX, AY, BX, BY, TURN_AC, TURN_AS, TURN_BC, TURN_BS, STRENGTH, PLACES, FX, FY, TA,
 TB) = (U(field) for field in range(0, WAY, FEW))


@rolled
def any_turns_far(n: int, w: np.ndarray, time: float, turns: np.ndarray) -> bool:
    """Which of n tiles turn so far in this time (s) that one place may not tell of it, as 1 in
    `turns`; whether any does."""
    some = 0
    for i in range(U(n)):
        turns[i] = 1 if abs(w[i]) * time > FAR else 0
        some |= turns[i]
    return some != 0


@lane
def places_of(x: np.ndarray, y: np.ndarray, v: Bodies, time: float, a: int, b: int) -> float:
    """At how many places of their way in this time (s) the forces of two tiles are to be taken.

    How far they turn counts from the line of their centres, which turns with tiles that turn as
    one.
    """
    w = v.w
    dx, dy = x[b] - x[a], y[b] - y[a]
    line = ((dx * (v.vy[b] - v.vy[a]) - dy * (v.vx[b] - v.vx[a]))
            / max(dx * dx + dy * dy, 1e-300))
    turn = max(abs(w[a] - line), abs(w[b] - line)) * time
    return float(min(max(math.ceil(turn / FAR), 1), MOST_PLACES))


@lane
def reach_of(law: MagnetLaw, x: np.ndarray, y: np.ndarray, v: Bodies, half: float, a: int,
             b: int) -> Any:
    """From centre to centre of two tiles (m) a time `half` (s) from now; and up to which squares of
    distances (m^2) a magnet of a from the centre of b, and one of b from that of a, is then within
    reach of any magnet of the other tile, at some time between now and as long after.

    That other magnet is somewhere on its circle, and this one has not gone far along its own.
    """
    ux, uy = v.vx[b] - v.vx[a], v.vy[b] - v.vy[a]
    reach = law.cutoff + law.offset + half * math.sqrt(ux * ux + uy * uy)
    of_a = reach + law.offset * min(half * abs(v.w[a]), 2.0)
    of_b = reach + law.offset * min(half * abs(v.w[b]), 2.0)
    return x[b] - x[a] + half * ux, y[b] - y[a] + half * uy, of_a * of_a, of_b * of_b


@inline
def add_mean_forces(law: MagnetLaw, near: MagnetPairs, time: float, x: np.ndarray, y: np.ndarray,
                    angle: np.ndarray, v: Bodies, fx: np.ndarray, fy: np.ndarray,
                    torque: np.ndarray) -> None:
    """Put the mean forces (N, N m) in this time (s) from now in place of those in its middle,
    between tiles that turn far in it, as `any_turns_far` has told, and go from x, y, angle."""
    p, q, some, far, turns, places_at = near.p, near.q, near.some, near.far, near.turns, near.ways
    ax, ay = near.ax, near.ay
    size, last_a, last_b, places, dx, dy, of_a, of_b = ZERO, U(0), U(0), 1.0, 0.0, 0.0, 0.0, 0.0
    for start in range(0, near.size[0], CHUNK):
        o, found = U(start), U(0)
        for i in range(U(min(near.size[0] - start, CHUNK))):
            # Written in any case and kept by moving on, as no branch can be foreseen.
            some[found] = o + i
            found += U(turns[U(p[o + i]) >> U(2)] | turns[U(q[o + i]) >> U(2)])
        for j in range(found):
            pair = U(some[j])
            a, b = U(p[pair]) >> U(2), U(q[pair]) >> U(2)
            if a != last_a or b != last_b:  # all pairs of magnets of two tiles stand together
                places, last_a, last_b = places_of(x, y, v, time, a, b), a, b
                dx, dy, of_a, of_b = reach_of(law, x, y, v, 0.5 * time, a, b)
            far[size], places_at[U(size) + PLACES] = pair, places
            # From the magnet of a to the centre of b, and from the centre of a to the magnet of b.
            px, py, qx, qy = (dx - ax[U(p[pair])], dy - ay[U(p[pair])], dx + ax[U(q[pair])],
                              dy + ay[U(q[pair])])
            meet = (px * px + py * py < of_a) & (qx * qx + qy * qy < of_b)
            size += 1 if (places > 1.0) & meet else 0
            if size == FEW:
                exchange(law, near, size, time, x, y, angle, v, fx, fy, torque)
                size = ZERO
    if size > 0:
        exchange(law, near, size, time, x, y, angle, v, fx, fy, torque)


@inline
def exchange(law: MagnetLaw, near: MagnetPairs, size: int, time: float, x: np.ndarray,
             y: np.ndarray, angle: np.ndarray, v: Bodies, fx: np.ndarray, fy: np.ndarray,
             torque: np.ndarray) -> None:
    """The same for as many pairs of magnets, those noted in ``far``."""
    p, q, far, r, strength = near.p, near.q, near.far, near.ways, near.strength
    ax, ay, m, vx, vy, w = near.ax, near.ay, near.m, v.vx, v.vy, v.w
    fade, beta, per_fade = law.fade, law.beta, 1.0 / max(law.cutoff - law.fade, 1e-300)
    most = 0.0
    for k in range(U(size)):
        i = U(far[k])
        a, b, places = U(p[i]) >> U(2), U(q[i]) >> U(2), r[k + PLACES]
        most, part = max(most, places), time / places
        ux, uy, turn_a, turn_b = (part * (vx[b] - vx[a]), part * (vy[b] - vy[a]), part * w[a],
                                  part * w[b])
        r[k + DX], r[k + DY] = x[b] - x[a] + 0.5 * ux, y[b] - y[a] + 0.5 * uy
        r[k + UX], r[k + UY] = ux, uy
        # Angles, at first: N is a quarter turn ahead of the tile's, E at it, S and W behind.
        r[k + AX] = angle[a] + 0.5 * turn_a + QUARTER * (1.0 - (p[i] & 3))
        r[k + BX] = angle[b] + 0.5 * turn_b + QUARTER * (1.0 - (q[i] & 3))
        r[k + TURN_AC], r[k + TURN_BC] = turn_a, turn_b
        r[k + STRENGTH] = strength[i]
        # The middle: where it is, and the arms, for the sums to begin with.
        at, to = U(2) * U(p[i]), U(2) * U(q[i])
        r[k + FX], r[k + FY] = m[to] - m[at], m[to + U(1)] - m[at + U(1)]
        r[k + TA], r[k + TB] = (ax[U(p[i])] * r[k + FY] - ay[U(p[i])] * r[k + FX],
                                ax[U(q[i])] * r[k + FY] - ay[U(q[i])] * r[k + FX])
    for k in range(U(size)):
        ca, sa = cos_sin(r[k + AX])
        cb, sb = cos_sin(r[k + BX])
        r[k + AX], r[k + AY] = law.offset * ca, law.offset * sa
        r[k + BX], r[k + BY] = law.offset * cb, law.offset * sb
        r[k + TURN_AC], r[k + TURN_AS] = cos_sin(r[k + TURN_AC])
        r[k + TURN_BC], r[k + TURN_BS] = cos_sin(r[k + TURN_BC])
        rx, ry = r[k + FX], r[k + FY]
        f = r[k + PLACES] * pull_of(r[k + STRENGTH], math.sqrt(rx * rx + ry * ry), fade, per_fade,
                                    beta)
        r[k + FX], r[k + FY], r[k + TA], r[k + TB] = (-f * rx, -f * ry, -f * r[k + TA],
                                                      f * r[k + TB])
    for place in range(int(most)):
        for k in range(U(size)):
            ax_k, ay_k, bx, by = r[k + AX], r[k + AY], r[k + BX], r[k + BY]
            rx, ry = r[k + DX] + bx - ax_k, r[k + DY] + by - ay_k
            f = pull_of(r[k + STRENGTH], math.sqrt(rx * rx + ry * ry), fade, per_fade, beta)
            f = f if place < r[k + PLACES] else 0.0
            r[k + FX] += f * rx
            r[k + FY] += f * ry
            r[k + TA] += f * (ax_k * ry - ay_k * rx)
            r[k + TB] -= f * (bx * ry - by * rx)
            r[k + DX] += r[k + UX]
            r[k + DY] += r[k + UY]
            c, s = r[k + TURN_AC], r[k + TURN_AS]
            r[k + AX], r[k + AY] = c * ax_k - s * ay_k, s * ax_k + c * ay_k
            c, s = r[k + TURN_BC], r[k + TURN_BS]
            r[k + BX], r[k + BY] = c * bx - s * by, s * bx + c * by
    for k in range(U(size)):
        i = U(far[k])
        a, b, share = U(p[i]) >> U(2), U(q[i]) >> U(2), 1.0 / r[k + PLACES]
        fx[a] += share * r[k + FX]
        fy[a] += share * r[k + FY]
        torque[a] += share * r[k + TA]
        fx[b] -= share * r[k + FX]
        fy[b] -= share * r[k + FY]
        torque[b] += share * r[k + TB]
