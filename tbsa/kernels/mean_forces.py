"""Magnet forces on tiles that turn far while these forces act: the mean of their way.

Forces are found for the middle of half a step and act through all of it.  A tile that turns by a
right angle from one middle to the next shows the same four magnets each time, as if it did not
turn, and gets the energy of several bonds from what it passes.  The forces between such a tile and
its neighbours are therefore taken at several places of the way that both go, evenly in time, and
their mean acts: its work is the difference of the energies at both ends, as that of the true force.
"""

from __future__ import annotations

import math

import numpy as np

from tbsa.kernels.bodies import Bodies
from tbsa.kernels.geometry import cos_sin
from tbsa.kernels.jit import ZERO, U, inline, lane
from tbsa.kernels.magnets import FEW, WAY, MagnetLaw, MagnetPairs, switch

# How far (rad) a tile turns at most from one place to the next, up to MOST_PLACES of them.
FAR = 0.15
MOST_PLACES = 64
# Where the magnets of what turns further are for all the others meanwhile (m, times its number).
AWAY = 1e6
QUARTER = 0.5 * math.pi
# Pairs of magnets are worked on so many at a time, a field of all of them next to each other: from
# the centre of a's tile to that of b's, and how much further that is at the next place (m); the
# arms of both magnets (m), cosines and sines of how far they turn; the polarity times alpha
# (N m^2); the number of places; and the sums of the force on a (N) and of both torques (N m).
(DX, DY, UX, UY, AX, AY, BX, BY, TURN_AC, TURN_AS, TURN_BC, TURN_BS, STRENGTH, PLACES, FX, FY, TA,
 TB) = (U(field) for field in range(0, WAY, FEW))


@lane
def turns_far(w: float, time: float) -> bool:
    """Whether a tile of this spin (rad/s) turns too far in this time (s) for one place."""
    return abs(w) * time > FAR


@lane
def put_away(near: MagnetPairs, w: np.ndarray, time: float, begin: int, end: int) -> None:
    """Put the magnets of those of these tiles that turn far out of reach of all others."""
    away = near.away
    for i in range(U(begin), U(end)):
        away[i] = AWAY * (1.0 + i) if turns_far(w[i], time) else 0.0


@inline
def any_turns_far(n: int, w: np.ndarray, time: float) -> bool:
    """Whether any of n tiles does."""
    fastest = 0.0
    for i in range(U(n)):
        fastest = max(fastest, abs(w[i]))
    return bool(turns_far(fastest, time))


@inline
def add_mean_forces(law: MagnetLaw, near: MagnetPairs, time: float, x: np.ndarray, y: np.ndarray,
                    angle: np.ndarray, v: Bodies, fx: np.ndarray, fy: np.ndarray,
                    torque: np.ndarray) -> None:
    """Add the mean forces (N, N m) in this time (s) from now of all listed pairs with a tile that
    turns far in it, as their tiles go from x, y, angle."""
    p, q, away, fast = near.p, near.q, near.away, near.fast
    size = ZERO
    for i in range(near.size[0]):
        # Written in any case and kept by moving on, as no branch can be foreseen.
        fast[size] = i
        size += 1 if away[U(p[i]) >> U(2)] + away[U(q[i]) >> U(2)] > 0.0 else 0
        if size == FEW:
            add_means(law, near, size, time, x, y, angle, v, fx, fy, torque)
            size = ZERO
    add_means(law, near, size, time, x, y, angle, v, fx, fy, torque)


@inline
def add_means(law: MagnetLaw, near: MagnetPairs, size: int, time: float, x: np.ndarray,
              y: np.ndarray, angle: np.ndarray, v: Bodies, fx: np.ndarray, fy: np.ndarray,
              torque: np.ndarray) -> None:
    """The same of as many pairs, those noted in ``fast``."""
    p, q, fast, r, strength = near.p, near.q, near.fast, near.ways, near.strength
    vx, vy, w, most = v.vx, v.vy, v.w, ZERO
    for k in range(U(size)):
        i = U(fast[k])
        a, b = U(p[i]) >> U(2), U(q[i]) >> U(2)
        places = min(math.ceil(max(abs(w[a]), abs(w[b])) * time / FAR), MOST_PLACES)
        most, part = max(most, places), time / places
        ux, uy, turn_a, turn_b = (part * (vx[b] - vx[a]), part * (vy[b] - vy[a]), part * w[a],
                                  part * w[b])
        r[k + DX], r[k + DY] = x[b] - x[a] + 0.5 * ux, y[b] - y[a] + 0.5 * uy
        r[k + UX], r[k + UY] = ux, uy
        # Angles, at first: N is a quarter turn ahead of the tile's, E at it, S and W behind.
        r[k + AX] = angle[a] + 0.5 * turn_a + QUARTER * (1.0 - (p[i] & 3))
        r[k + BX] = angle[b] + 0.5 * turn_b + QUARTER * (1.0 - (q[i] & 3))
        r[k + TURN_AC], r[k + TURN_BC] = turn_a, turn_b
        r[k + STRENGTH], r[k + PLACES] = strength[i], places
        r[k + FX] = r[k + FY] = r[k + TA] = r[k + TB] = 0.0
    for k in range(U(size)):
        ca, sa = cos_sin(r[k + AX])
        cb, sb = cos_sin(r[k + BX])
        r[k + AX], r[k + AY] = law.offset * ca, law.offset * sa
        r[k + BX], r[k + BY] = law.offset * cb, law.offset * sb
        r[k + TURN_AC], r[k + TURN_AS] = cos_sin(r[k + TURN_AC])
        r[k + TURN_BC], r[k + TURN_BS] = cos_sin(r[k + TURN_BC])
    fade, beta, per_fade = law.fade, law.beta, 1.0 / max(law.cutoff - law.fade, 1e-300)
    for place in range(most):
        for k in range(U(size)):
            ax, ay, bx, by = r[k + AX], r[k + AY], r[k + BX], r[k + BY]
            rx, ry = r[k + DX] + bx - ax, r[k + DY] + by - ay
            d = math.sqrt(rx * rx + ry * ry)
            f = r[k + STRENGTH] * switch((d - fade) * per_fade)
            f /= max(d, 1e-300) * (d + beta) * (d + beta)
            f = f if place < r[k + PLACES] else 0.0
            r[k + FX] += f * rx
            r[k + FY] += f * ry
            r[k + TA] += f * (ax * ry - ay * rx)
            r[k + TB] -= f * (bx * ry - by * rx)
            r[k + DX] += r[k + UX]
            r[k + DY] += r[k + UY]
            c, s = r[k + TURN_AC], r[k + TURN_AS]
            r[k + AX], r[k + AY] = c * ax - s * ay, s * ax + c * ay
            c, s = r[k + TURN_BC], r[k + TURN_BS]
            r[k + BX], r[k + BY] = c * bx - s * by, s * bx + c * by
    for k in range(U(size)):
        i = U(fast[k])
        a, b, share = U(p[i]) >> U(2), U(q[i]) >> U(2), 1.0 / r[k + PLACES]
        fx[a] += share * r[k + FX]
        fy[a] += share * r[k + FY]
        torque[a] += share * r[k + TA]
        fx[b] -= share * r[k + FX]
        fy[b] -= share * r[k + FY]
        torque[b] += share * r[k + TB]
