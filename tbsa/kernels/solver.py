"""The contact solve: projected Gauss-Seidel over manifolds and floor patches.

For every contact point, with ``vn`` the relative normal velocity at the end of the substep:

    vn + want >= 0,   pn >= 0,   pn (vn + want) = 0      (no penetration; want = gap / h)
    |pt| <= mu pn,    pt against the relative tangential velocity   (Coulomb)

A manifold of one point is solved exactly for both impulses; one of two points exactly for both
normal impulses, in turn with its one friction impulse.  Friction with the floor is a bounded
impulse of each tile (see `floor.py`) and is solved in the same sweep.  A row is solved again only
if one of its bodies has been moved by more than the tolerance since: converged parts of the
scene drop out of further passes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.contacts import Rows
from tbsa.kernels.floor import SEPARATE, floor_impulse, interval
from tbsa.kernels.jit import U, columns, inline

# Overlap that is left alone (fraction of the width).  The velocity solve does not press points
# together, so overlap comes from the curvature of fast rotations and from unconverged passes.
SLOP = 1e-3


class Numbers(NamedTuple):
    """The scalars of a scene that its contacts need."""

    n: int  # tiles
    width: float  # m
    h: float  # s, the substep
    mass: float  # kg
    inertia: float  # kg m^2
    linear_damping: float  # 1/s
    angular_damping: float  # 1/s
    mu: float  # friction, tile-tile
    mu_wall: float
    e: float  # restitution, tile-tile
    e_wall: float
    threshold: float  # m/s, slower impacts are plastic
    tolerance: float  # m/s
    passes: int
    wall: int  # 0 none, 1 circle, 2 rectangle
    wall_x: float  # m, radius or half the width
    wall_y: float  # m, half the height


class FloorLaw(NamedTuple):
    """Numbers of the floor; `law` 0 where the scene has no floor friction."""

    law: int  # 1 separate, 2 coupled, 3 exact; see floor.py
    force: float  # N, F_max
    torque: float  # N m, T_max


class Bodies(NamedTuple):
    """Velocities of the tiles and, last, of the ground, and what the solve notes of each."""

    vx: np.ndarray
    vy: np.ndarray
    w: np.ndarray
    mobile: np.ndarray  # 1.0, or 0.0 for held tiles and the ground
    startx: np.ndarray  # velocity at the start of the substep
    starty: np.ndarray
    startw: np.ndarray
    floorx: np.ndarray  # floor impulse of this substep
    floory: np.ndarray
    floort: np.ndarray
    lastx: np.ndarray  # velocity when the floor was last solved
    lasty: np.ndarray
    moved: np.ndarray  # int64, when a contact last changed the velocity
    swept: np.ndarray  # int64, when the floor was last solved


def empty_bodies(n: int) -> Bodies:
    """Bodies of `n` tiles and the ground."""
    whole = {"moved", "swept"}
    return Bodies(*columns(n + 1, [int if f in whole else float for f in Bodies._fields]))


@inline
def prepare(rows: Rows, m: int, im: float, ii: float, mobile: np.ndarray) -> None:
    """Inverse effective masses of `m` rows, for tiles of inverse mass `im` and inertia `ii`."""
    ra, rb, at, bt, count = rows.a, rows.b, rows.at, rows.bt, rows.points
    an0, bn0, an1, bn1 = rows.an0, rows.bn0, rows.an1, rows.bn1
    k00, k01, k11, ktt = rows.k00, rows.k01, rows.k11, rows.ktt
    i00, i11, itt, idet = rows.i00, rows.i11, rows.itt, rows.idet
    for i in range(m):
        ma, mb = mobile[U(ra[i])], mobile[U(rb[i])]
        linear, ia, ib = im * (ma + mb), ii * ma, ii * mb
        k00[i] = linear + ia * an0[i] * an0[i] + ib * bn0[i] * bn0[i]
        k11[i] = linear + ia * an1[i] * an1[i] + ib * bn1[i] * bn1[i]
        ktt[i] = linear + ia * at[i] * at[i] + ib * bt[i] * bt[i]
        normal = linear + ia * an0[i] * an1[i] + ib * bn0[i] * bn1[i]
        friction = ia * an0[i] * at[i] + ib * bn0[i] * bt[i]
        two = count[i] == 2
        k01[i] = normal if two else friction
        both = k00[i] * (k11[i] if two else ktt[i])
        det = both - k01[i] * k01[i]
        idet[i] = 1.0 / det if det > 1e-9 * both else np.nan
        i00[i], i11[i], itt[i] = 1.0 / k00[i], 1.0 / k11[i], 1.0 / ktt[i]


@inline
def approach(rows: Rows, m: int, v: Bodies) -> None:
    """Normal velocities of all points into ``rows.vn0``, ``rows.vn1``."""
    ra, rb, nx, ny, an0, bn0, an1, bn1 = (rows.a, rows.b, rows.nx, rows.ny, rows.an0, rows.bn0,
                                          rows.an1, rows.bn1)
    vn0, vn1 = rows.vn0, rows.vn1
    vx, vy, w = v.vx, v.vy, v.w
    for i in range(m):
        a, b = U(ra[i]), U(rb[i])
        along = nx[i] * (vx[b] - vx[a]) + ny[i] * (vy[b] - vy[a])
        vn0[i] = along + bn0[i] * w[b] - an0[i] * w[a]
        vn1[i] = along + bn1[i] * w[b] - an1[i] * w[a]


@inline
def apply_impulses(rows: Rows, m: int, im: float, ii: float, v: Bodies) -> None:
    """Apply the impulses that the rows carry."""
    ra, rb, nx, ny, at, bt = rows.a, rows.b, rows.nx, rows.ny, rows.at, rows.bt
    an0, bn0, an1, bn1 = rows.an0, rows.bn0, rows.an1, rows.bn1
    pn0, pn1, pt = rows.pn0, rows.pn1, rows.pt
    vx, vy, w, mobile = v.vx, v.vy, v.w, v.mobile
    for i in range(m):
        p0, p1, t = pn0[i], pn1[i], pt[i]
        if p0 == 0.0 and p1 == 0.0 and t == 0.0:
            continue
        a, b = U(ra[i]), U(rb[i])
        px, py = nx[i] * (p0 + p1) - ny[i] * t, ny[i] * (p0 + p1) + nx[i] * t
        ma, mb = mobile[a] * im, mobile[b] * im
        vx[a] -= ma * px
        vy[a] -= ma * py
        w[a] -= mobile[a] * ii * (an0[i] * p0 + an1[i] * p1 + at[i] * t)
        vx[b] += mb * px
        vy[b] += mb * py
        w[b] += mobile[b] * ii * (bn0[i] * p0 + bn1[i] * p1 + bt[i] * t)


@inline
def one_point(vn: float, vt: float, knn: float, ktt: float, knt: float, itt: float, idet: float,
              mu: float, base: float) -> Any:
    """Impulses (pn, pt) of one contact from the velocities without them (vn with its want).

    Open, stick or slide, whichever is consistent; `base` widens the friction bound to
    mu (base + pn).  Written without branches: which case comes is as good as random, and a
    wrong guess of the processor costs more than all of them.
    """
    # Open: no further normal impulse, friction alone on what is there already.
    loose = min(max(-vt * itt, -mu * base), mu * base)
    is_open = vn + knt * loose >= 0.0
    pn = (knt * vt - ktt * vn) * idet
    pt = (knt * vn - knn * vt) * idet
    sticks = (pn >= 0.0) & (abs(pt) <= mu * (base + pn))
    # Sliding, against the direction that sticking would have had to hold.
    side = 1.0 if pt > 0.0 else -1.0
    grip = knn + side * mu * knt
    jams = grip <= 1e-6 * knn  # Painleve: friction would press without end; hold instead
    slid = -(vn + side * mu * knt * base) / (1.0 if jams else grip)
    slid = max(pn if jams else slid, 0.0)
    closed_n = pn if sticks else slid
    closed_t = pt if sticks else side * mu * (base + slid)
    return (0.0 if is_open else closed_n), (loose if is_open else closed_t)


@inline
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


@inline
def sweep_rows(rows: Rows, m: int, ground: int, mu: float, mu_wall: float, im: float, ii: float,
               v: Bodies, tolerance: float, clock: int) -> tuple[float, int]:
    """One pass over the rows whose bodies have moved since they were last solved.

    Returns the largest contact velocity that a row changed, and the clock.
    """
    ra, rb, count, nx, ny, at, bt = (rows.a, rows.b, rows.points, rows.nx, rows.ny, rows.at,
                                     rows.bt)
    ran0, rbn0, ran1, rbn1 = rows.an0, rows.bn0, rows.an1, rows.bn1
    pn0, pn1, pt, base = rows.pn0, rows.pn1, rows.pt, rows.base
    want0, want1, seen = rows.want0, rows.want1, rows.seen
    rk00, rk01, rk11, rktt = rows.k00, rows.k01, rows.k11, rows.ktt
    ri00, ri11, ritt, ridet = rows.i00, rows.i11, rows.itt, rows.idet
    vx, vy, w, mobile, moved = v.vx, v.vy, v.w, v.mobile, v.moved
    worst = 0.0
    for i in range(m):
        a, b, wall = U(ra[i]), U(rb[i]), rb[i] == ground
        if (moved[a] <= seen[i]) & (moved[b] <= seen[i]):
            continue
        clock += 1
        two = count[i] == 2
        c, s, an0, bn0 = nx[i], ny[i], ran0[i], rbn0[i]
        dvx, dvy, wa, wb = vx[b] - vx[a], vy[b] - vy[a], w[a], w[b]
        ma, mb = mobile[a], mobile[b]
        q0, q1, qt, k00, k01, ktt = pn0[i], pn1[i], pt[i], rk00[i], rk01[i], rktt[i]
        friction = mu_wall if wall else mu
        vt = c * dvy - s * dvx + bt[i] * wb - at[i] * wa
        along = c * dvx + s * dvy
        u0 = along + bn0 * wb - an0 * wa + want0[i]
        if two:
            an1, bn1, k11 = ran1[i], rbn1[i], rk11[i]
            bound = friction * (base[i] + q0 + q1)
            t = min(max(qt - vt * ritt[i], -bound), bound)
            # What this friction does to the normal velocities, through the lever arms.
            ta, tb = ii * ma * at[i] * (t - qt), ii * mb * bt[i] * (t - qt)
            u0 += bn0 * tb + an0 * ta
            u1 = along + bn1 * (wb + tb) - an1 * (wa - ta) + want1[i]
            p0, p1 = two_points(u0 - k00 * q0 - k01 * q1, u1 - k01 * q0 - k11 * q1, k01, ri00[i],
                                ri11[i], k00, k11, ridet[i])
            d0, d1 = p0 - q0, p1 - q1
            turn_a, turn_b = an0 * d0 + an1 * d1, bn0 * d0 + bn1 * d1
            change = max(abs(d0) * k00, abs(d1) * k11)
            dn = d0 + d1
            pn1[i] = p1
        else:
            p0, t = one_point(u0 - k00 * q0 - k01 * qt, vt - k01 * q0 - ktt * qt, k00, ktt, k01,
                              ritt[i], ridet[i], friction, base[i])
            dn = p0 - q0
            turn_a, turn_b = an0 * dn, bn0 * dn
            change = abs(dn) * k00
        dt = t - qt
        change = max(change, abs(dt) * ktt)
        pn0[i], pt[i] = p0, t
        px, py = c * dn - s * dt, s * dn + c * dt
        vx[a] -= ma * im * px
        vy[a] -= ma * im * py
        w[a] -= ma * ii * (turn_a + at[i] * dt)
        vx[b] += mb * im * px
        vy[b] += mb * im * py
        w[b] += mb * ii * (turn_b + bt[i] * dt)
        large = change > tolerance
        # The friction and normal impulses of two points alternate: look at them again.
        seen[i] = clock - 1 if large & two else clock
        moved[a] = clock if large else moved[a]
        moved[b] = clock if large & (not wall) else moved[b]
        worst = max(worst, change)
    return worst, clock


@inline
def sweep_floor(floor: FloorLaw, k: Numbers, im: float, ii: float, c: np.ndarray,
                s: np.ndarray, v: Bodies, clock: int, everyone: bool, tolerance: float) -> None:
    """Solve the floor's impulse of every tile, or of those for which it may have changed.

    The friction of a tile that slides fast hardly depends on what its contacts do to it: the
    impulse R along s = start + end turns by R |change of v| / (m |s|).  Where that is below the
    tolerance, a pass in between solves its spin alone.
    """
    bound, turn = floor.force * k.h, floor.torque * k.h
    mass, inertia = 1.0 / im, 1.0 / ii
    separate = floor.law == SEPARATE
    slow = 2.0 * bound * im
    stiff = (slow / tolerance) ** 2
    vx, vy, w, mobile, moved, swept = v.vx, v.vy, v.w, v.mobile, v.moved, v.swept
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort, lastx, lasty = v.floorx, v.floory, v.floort, v.lastx, v.lasty
    for i in range(k.n):
        if mobile[i] == 0.0:
            continue
        if not everyone and moved[i] <= swept[i]:
            continue
        if separate and not everyone:
            dx, dy = vx[i] - lastx[i], vy[i] - lasty[i]
            fast = (startx[i] + vx[i]) ** 2 + (starty[i] + vy[i]) ** 2
            # Beyond 4 R/m the tile is sure to slide.
            if fast > 4.0 * slow * slow and fast > (dx * dx + dy * dy) * stiff:
                tw = w[i] - ii * floort[i]
                floort[i] = interval(startw[i], tw, inertia, turn)
                uw = 0.0 if floort[i] == -inertia * tw else tw + ii * floort[i]
                swept[i] = clock
                if k.width * abs(uw - w[i]) > tolerance:
                    moved[i] = clock
                w[i] = uw
                continue
        swept[i] = clock
        tx, ty, tw = vx[i] - im * floorx[i], vy[i] - im * floory[i], w[i] - ii * floort[i]
        px, py, pw = floor_impulse(floor.law, startx[i], starty[i], startw[i], tx, ty, tw, mass,
                                   inertia, bound, turn, c[i], s[i])
        floorx[i], floory[i], floort[i] = px, py, pw
        # A tile that the floor stops is at rest exactly, not to rounding.
        stopped = px == -mass * tx and py == -mass * ty
        ux = 0.0 if stopped else tx + im * px
        uy = 0.0 if stopped else ty + im * py
        uw = 0.0 if pw == -inertia * tw else tw + ii * pw
        change = max(abs(ux - vx[i]), abs(uy - vy[i]), k.width * abs(uw - w[i]))
        vx[i], vy[i], w[i], lastx[i], lasty[i] = ux, uy, uw, ux, uy
        if change > tolerance:
            moved[i] = clock


@inline
def relax(rows: Rows, m: int, k: Numbers, floor: FloorLaw, im: float, ii: float, c: np.ndarray,
          s: np.ndarray, v: Bodies, tolerance: float) -> int:
    """Gauss-Seidel passes until none changes a contact velocity by more than `tolerance`.

    The impulses that the rows carry must already have been applied.  Rows marked -1 in
    ``rows.seen`` are solved at least once, those marked 0 only once a neighbour has moved.
    Returns the number of passes, or -1 - passes where the limit was reached first.
    """
    clock = 1
    v.moved[:] = 0
    v.swept[:] = 0
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, clock, True, tolerance)
    done = -1 - k.passes
    for p in range(k.passes):
        worst, clock = sweep_rows(rows, m, k.n, k.mu, k.mu_wall, im, ii, v, tolerance, clock)
        if worst <= tolerance:
            done = p + 1
            break
        if floor.law != 0:
            clock += 1
            sweep_floor(floor, k, im, ii, c, s, v, clock, False, tolerance)
    if floor.law != 0:  # last, so that what the floor holds is at rest exactly
        sweep_floor(floor, k, im, ii, c, s, v, clock + 1, True, tolerance)
    return done


@inline
def limit_work(rows: Rows, m: int, k: Numbers, floor: FloorLaw, im: float, ii: float,
               c: np.ndarray, s: np.ndarray, v: Bodies, u: Bodies, tolerance: float) -> None:
    """Scale the contact impulses down where, together, they would do work.

    A solved contact problem only takes energy from the velocities `u` that it began with; one
    that was broken off, above all one begun with the impulses of a substep before whose load
    has gone, may add some.  The work, impulses times mean velocity, is a parabola in the scale.
    """
    vx, vy, w, ux, uy, uw = v.vx, v.vy, v.w, u.vx, u.vy, u.w
    floorx, floory, floort = v.floorx, v.floory, v.floort
    square, mixed = 0.0, 0.0
    for i in range(k.n):
        gx, gy, gw = im * floorx[i], im * floory[i], ii * floort[i]
        dx, dy, dw = vx[i] - gx - ux[i], vy[i] - gy - uy[i], w[i] - gw - uw[i]
        square += 0.5 * (k.mass * (dx * dx + dy * dy) + k.inertia * dw * dw)
        mixed += (k.mass * (dx * (ux[i] + 0.5 * gx) + dy * (uy[i] + 0.5 * gy))
                  + k.inertia * dw * (uw[i] + 0.5 * gw))
    if square + mixed <= 1e-14 * square:
        return
    scale = max(-mixed / square, 0.0)
    for i in range(k.n):
        vx[i] = ux[i] + scale * (vx[i] - im * floorx[i] - ux[i])
        vy[i] = uy[i] + scale * (vy[i] - im * floory[i] - uy[i])
        w[i] = uw[i] + scale * (w[i] - ii * floort[i] - uw[i])
    floorx[:] = 0.0
    floory[:] = 0.0
    floort[:] = 0.0
    for i in range(m):
        rows.pn0[i] *= scale
        rows.pn1[i] *= scale
        rows.pt[i] *= scale
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, 1, True, tolerance)


@inline
def project(rows: Rows, m: int, k: Numbers, im: float, ii: float, v: Bodies, shift: Bodies,
            x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> bool:
    """Move deeply overlapping tiles apart; returns whether there were any.

    The velocity solve does not push apart what overlaps, so that it never adds energy; a
    solved scene does not need this.  Points overlapping by more than a slop are moved a fifth
    of the way back, never further than 2 % of the width in a substep, and other points may not
    be closed by it.  One pass: what is left is there again in the next substep.
    """
    slop, most, small = SLOP * k.width, 0.02 * k.width, 1e-5 * k.width
    gap0, gap1, count, want0, want1 = rows.gap0, rows.gap1, rows.points, rows.want0, rows.want1
    vn0, vn1, seen = rows.vn0, rows.vn1, rows.seen
    approach(rows, m, v)
    deep = False
    for i in range(m):
        g0, g1 = gap0[i] + k.h * vn0[i] + slop, gap1[i] + k.h * vn1[i] + slop
        if count[i] == 1:
            g1 = g0
        want0[i] = g0 if g0 > 0.0 else max(0.2 * g0, -most)
        want1[i] = g1 if g1 > 0.0 else max(0.2 * g1, -most)
        seen[i] = -1 if g0 < 0.0 or g1 < 0.0 else 0
        deep = deep or seen[i] == -1
    if not deep:
        return False
    shift.vx[:] = 0.0
    shift.vy[:] = 0.0
    shift.w[:] = 0.0
    shift.moved[:] = 0
    shift.mobile[:] = v.mobile
    rows.pn0[:m] = 0.0
    rows.pn1[:m] = 0.0
    rows.pt[:m] = 0.0
    rows.base[:m] = 0.0
    sweep_rows(rows, m, k.n, 0.0, 0.0, im, ii, shift, small, 1)

    # As a skater's spin slows when the arms go out: two free tiles that are moved apart by q
    # along n keep their angular momentum by losing of their tangential velocity, and only lose.
    ra, rb, nx, ny, pn0, pn1 = rows.a, rows.b, rows.nx, rows.ny, rows.pn0, rows.pn1
    vx, vy, mobile = v.vx, v.vy, v.mobile
    for i in range(m):
        q = im * (pn0[i] + pn1[i])
        if q == 0.0:
            continue
        a, b = ra[i], rb[i]
        ma, mb = mobile[a], mobile[b]
        x[a] -= ma * q * nx[i]
        y[a] -= ma * q * ny[i]
        x[b] += mb * q * nx[i]
        y[b] += mb * q * ny[i]
        if ma * mb != 0.0:
            apart = nx[i] * (x[b] - x[a]) + ny[i] * (y[b] - y[a])
            slip = nx[i] * (vy[b] - vy[a]) - ny[i] * (vx[b] - vx[a])
            lost = min(q / apart, 0.5) * slip
            vx[a] -= lost * ny[i]
            vy[a] += lost * nx[i]
            vx[b] += lost * ny[i]
            vy[b] -= lost * nx[i]
    angle += shift.w
    return True
