"""One manifold: the impulses that its two tiles give each other.

For every contact point, with ``vn`` the relative normal velocity at the end of the substep:

    vn + want >= 0,   pn >= 0,   pn (vn + want) = 0      (no penetration; want = gap / h,
                                                        and what it gains along an arc)
    |pt| <= mu pn,    pt against the relative tangential velocity   (Coulomb; and what it slides
                                                        along an arc)

A manifold of one point is solved exactly for both impulses; one of two points exactly for both
normal impulses, in turn with its one friction impulse.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tbsa.kernels.jit import U, lane
from tbsa.kernels.rows import (
    AN0,
    AN1,
    AT,
    AW,
    AX,
    AY,
    BASE,
    BN0,
    BN1,
    BT,
    BW,
    BX,
    BY,
    CHANGE,
    COUNT,
    I00,
    I11,
    IDET,
    ITT,
    K00,
    K01,
    K11,
    KTT,
    MA,
    MB,
    MU,
    NX,
    NY,
    PN0,
    PN1,
    PT,
    WANT0,
    WANT1,
    WANTT,
)


@lane
def one_point(vn: float, vt: float, knn: float, ktt: float, knt: float, itt: float, idet: float,
              mu: float, base: float) -> Any:
    """Impulses (pn, pt) of one contact from the velocities without them (vn with its want).

    Open, stick or slide, whichever is consistent; `base` widens the friction bound to
    mu (base + pn).  Both ways of sliding are worked out before it is known which it is: what a
    row waits for is the way from its velocities to its impulses.
    """
    # Open: no further normal impulse, friction alone on what is there already.
    loose = min(max(-vt * itt, -mu * base), mu * base)
    is_open = vn + knt * loose >= 0.0
    pn = (knt * vt - ktt * vn) * idet
    pt = (knt * vn - knn * vt) * idet
    sticks = (pn >= 0.0) & (abs(pt) <= mu * (base + pn))
    # Sliding, against the direction that sticking would have had to hold.
    forward = pt > 0.0
    least, pull = 1e-6 * knn, mu * knt * base
    grip, grip_back = knn + mu * knt, knn - mu * knt
    # Painleve: friction would press without end; hold instead
    jams = grip <= least if forward else grip_back <= least
    slid_on = (vn + pull) * (-1.0 / max(grip, least))
    slid_back = (vn - pull) * (-1.0 / max(grip_back, least))
    slid = max(pn if jams else (slid_on if forward else slid_back), 0.0)
    rubs = mu * (base + slid)
    closed_n = pn if sticks else slid
    closed_t = pt if sticks else (rubs if forward else -rubs)
    return (0.0 if is_open else closed_n), (loose if is_open else closed_t)


@lane
def two_points(u0: float, u1: float, k01: float, i00: float, i11: float, k00: float, k11: float,
               idet: float) -> Any:
    """Normal impulses of two points from their velocities without them: exact, by cases.

    Both press, or only the first and the second does not close, or only the second.  `idet` is
    not a number for two points in one place, so that the first case drops out.
    """
    both0, both1 = (k01 * u1 - k11 * u0) * idet, (k01 * u0 - k00 * u1) * idet
    first, second = max(-u0 * i00, 0.0), max(-u1 * i11, 0.0)
    both = (both0 >= 0.0) & (both1 >= 0.0)
    alone = u1 + k01 * first >= 0.0
    p0 = both0 if both else (first if alone else 0.0)
    p1 = both1 if both else (0.0 if alone else second)
    return p0, p1


@lane
def push(r: np.ndarray, k: int, per_mass: float, d0: float, d1: float, dt: float) -> None:
    """Give the bodies of lane k the normal impulses d0, d1 and the friction impulse dt."""
    nx, ny, ma, mb = r[k + NX], r[k + NY], r[k + MA], r[k + MB]
    px, py = nx * (d0 + d1) - ny * dt, ny * (d0 + d1) + nx * dt
    r[k + AX] -= ma * px
    r[k + AY] -= ma * py
    r[k + AW] -= per_mass * ma * (r[k + AN0] * d0 + r[k + AN1] * d1 + r[k + AT] * dt)
    r[k + BX] += mb * px
    r[k + BY] += mb * py
    r[k + BW] += per_mass * mb * (r[k + BN0] * d0 + r[k + BN1] * d1 + r[k + BT] * dt)


# The lanes' code stands in this loop itself: LLVM unrolls a short loop over a call, and then makes
# no vectors of it.
@lane
def solve_lanes(r: np.ndarray, first: int, lanes: int, per_mass: float, lone: bool) -> None:
    """Solve the manifolds of `lanes` lanes of a block, from `first` on: of two points friction,
    then both normal impulses; of one point all at once.

    Without `lone` there is none of one point, and its impulses are not worked out; those of two are
    the same to the bit either way.
    """
    for i in range(U(lanes)):
        k = U(first) + i
        nx, ny, wa, wb = r[k + NX], r[k + NY], r[k + AW], r[k + BW]
        dvx, dvy = r[k + BX] - r[k + AX], r[k + BY] - r[k + AY]
        an0, bn0, an1, bn1 = r[k + AN0], r[k + BN0], r[k + AN1], r[k + BN1]
        at, bt, q0, q1, qt = r[k + AT], r[k + BT], r[k + PN0], r[k + PN1], r[k + PT]
        k00, k01, k11, ktt = r[k + K00], r[k + K01], r[k + K11], r[k + KTT]
        mu, base, itt, idet = r[k + MU], r[k + BASE], r[k + ITT], r[k + IDET]
        two = (not lone) | (r[k + COUNT] > 1.5)
        along = nx * dvx + ny * dvy
        vt = (nx * dvy - ny * dvx) + (bt * wb - at * wa) + r[k + WANTT]
        vn0, vn1 = along + (bn0 * wb - an0 * wa), along + (bn1 * wb - an1 * wa)
        bound = mu * (base + q0 + q1)
        t2 = min(max(qt - vt * itt, -bound), bound)
        # What this friction does to the normal velocities, through the lever arms.
        ga, gb = per_mass * r[k + MA] * at, per_mass * r[k + MB] * bt
        u0 = ((vn0 + (r[k + WANT0] - (k00 * q0 + k01 * q1)))
              + (ga * an0 + gb * bn0) * (t2 - qt))
        u1 = ((vn1 + (r[k + WANT1] - (k01 * q0 + k11 * q1)))
              + (ga * an1 + gb * bn1) * (t2 - qt))
        p0, p1 = two_points(u0, u1, k01, r[k + I00], r[k + I11], k00, k11, idet)
        pn, pt = 0.0, 0.0
        if lone:
            pn, pt = one_point(vn0 + (r[k + WANT0] - (k00 * q0 + k01 * qt)),
                               vt - (k01 * q0 + ktt * qt), k00, ktt, k01, itt, idet, mu, base)
        p0, p1, t = (p0 if two else pn), (p1 if two else 0.0), (t2 if two else pt)
        push(r, k, per_mass, p0 - q0, p1 - q1, t - qt)
        r[k + PN0], r[k + PN1], r[k + PT] = p0, p1, t
        r[k + CHANGE] = max(max(abs(p0 - q0) * k00, abs(p1 - q1) * k11), abs(t - qt) * ktt)
