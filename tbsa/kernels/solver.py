"""The contact solve: projected Gauss-Seidel over blocks of manifolds and over floor patches.

For every contact point, with ``vn`` the relative normal velocity at the end of the substep:

    vn + want >= 0,   pn >= 0,   pn (vn + want) = 0      (no penetration; want = gap / h)
    |pt| <= mu pn,    pt against the relative tangential velocity   (Coulomb)

A manifold of one point is solved exactly for both impulses; one of two points exactly for both
normal impulses, in turn with its one friction impulse.  Friction with the floor is a bounded
impulse of each tile (see `floor.py`) and is solved between the passes.  A block is solved again
only if one of its bodies has been moved by more than the tolerance since: converged parts of the
scene drop out of further passes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.contacts import (
    AN0,
    AN1,
    AT,
    AW,
    AX,
    AY,
    BASE,
    BLOCK,
    BN0,
    BN1,
    BODIES,
    BT,
    BW,
    BX,
    BY,
    CHANGE,
    COLOURS,
    COUNT,
    GAP0,
    GAP1,
    I00,
    I11,
    IDET,
    ITT,
    K00,
    K01,
    K11,
    KTT,
    LANES,
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
    Rows,
)
from tbsa.kernels.floor import SEPARATE, disc, floor_impulse, interval
from tbsa.kernels.jit import U, columns, inline, lane

# Overlap that is left alone (fraction of the width).  The velocity solve does not press points
# together, so overlap comes from the curvature of fast rotations and from unconverged passes.
SLOP = 1e-3


class Numbers(NamedTuple):
    """The scalars of a scene that its contacts need."""

    n: int  # tiles
    width: float  # m
    h: float  # s, the substep
    substeps: int  # in a step
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
    keep_lists: int  # 1, or 0: find pairs and magnet pairs anew every step
    skip_converged: int  # 1, or 0: solve every block in every pass
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
    change: np.ndarray  # by which the floor changed the velocity
    moved: np.ndarray  # int64, when the velocity was last changed by more than the tolerance


def empty_bodies(n: int) -> Bodies:
    """Bodies of `n` tiles and the ground."""
    return Bodies(*columns(n + 1, [int if f == "moved" else float for f in Bodies._fields]))


@lane
def one_point(vn: float, vt: float, knn: float, ktt: float, knt: float, itt: float, idet: float,
              mu: float, base: float) -> Any:
    """Impulses (pn, pt) of one contact from the velocities without them (vn with its want).

    Open, stick or slide, whichever is consistent; `base` widens the friction bound to
    mu (base + pn).
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


@inline
def gather(rows: Rows, block: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """The velocities of a block's bodies, into its lanes."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    for i in range(LANES):
        a, b = U(body[t + i]), U(body[t + LANES + i])
        r[o + AX + i], r[o + AY + i], r[o + AW + i] = vx[a], vy[a], w[a]
        r[o + BX + i], r[o + BY + i], r[o + BW + i] = vx[b], vy[b], w[b]


@inline
def scatter(rows: Rows, block: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """And back.  Bodies that two lanes have in common are held: their velocity stays as it is."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    for i in range(LANES):
        a, b = U(body[t + i]), U(body[t + LANES + i])
        vx[a], vy[a], w[a] = r[o + AX + i], r[o + AY + i], r[o + AW + i]
        vx[b], vy[b], w[b] = r[o + BX + i], r[o + BY + i], r[o + BW + i]


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


# The lanes' code stands in these loops themselves: LLVM unrolls a short loop over a call, and
# then makes no vectors of it.
@inline
def solve_pairs(r: np.ndarray, block: int, per_mass: float) -> None:
    """Solve a block of manifolds of two points: their friction, then their normal impulses."""
    o = U(block) * BLOCK
    for i in range(LANES):
        k = o + i
        nx, ny, wa, wb = r[k + NX], r[k + NY], r[k + AW], r[k + BW]
        dvx, dvy = r[k + BX] - r[k + AX], r[k + BY] - r[k + AY]
        an0, bn0, an1, bn1 = r[k + AN0], r[k + BN0], r[k + AN1], r[k + BN1]
        at, bt, q0, q1, qt = r[k + AT], r[k + BT], r[k + PN0], r[k + PN1], r[k + PT]
        k00, k01, k11 = r[k + K00], r[k + K01], r[k + K11]
        along = nx * dvx + ny * dvy
        vt = nx * dvy - ny * dvx + bt * wb - at * wa
        bound = r[k + MU] * (r[k + BASE] + q0 + q1)
        t = min(max(qt - vt * r[k + ITT], -bound), bound)
        # What this friction does to the normal velocities, through the lever arms.
        ta = wa - per_mass * r[k + MA] * at * (t - qt)
        tb = wb + per_mass * r[k + MB] * bt * (t - qt)
        u0 = along + bn0 * tb - an0 * ta + r[k + WANT0] - k00 * q0 - k01 * q1
        u1 = along + bn1 * tb - an1 * ta + r[k + WANT1] - k01 * q0 - k11 * q1
        p0, p1 = two_points(u0, u1, k01, r[k + I00], r[k + I11], k00, k11, r[k + IDET])
        push(r, k, per_mass, p0 - q0, p1 - q1, t - qt)
        r[k + PN0], r[k + PN1], r[k + PT] = p0, p1, t
        r[k + CHANGE] = max(max(abs(p0 - q0) * k00, abs(p1 - q1) * k11),
                            abs(t - qt) * r[k + KTT])


@inline
def solve_mixed(r: np.ndarray, first: int, lanes: int, per_mass: float) -> None:
    """Solve manifolds of one or two points: `lanes` lanes of a block from `first` on."""
    for i in range(U(lanes)):
        k = U(first) + i
        nx, ny, wa, wb = r[k + NX], r[k + NY], r[k + AW], r[k + BW]
        dvx, dvy = r[k + BX] - r[k + AX], r[k + BY] - r[k + AY]
        an0, bn0, an1, bn1 = r[k + AN0], r[k + BN0], r[k + AN1], r[k + BN1]
        at, bt, q0, q1, qt = r[k + AT], r[k + BT], r[k + PN0], r[k + PN1], r[k + PT]
        k00, k01, k11, ktt = r[k + K00], r[k + K01], r[k + K11], r[k + KTT]
        mu, base, itt, idet = r[k + MU], r[k + BASE], r[k + ITT], r[k + IDET]
        two = r[k + COUNT] > 1.5
        along = nx * dvx + ny * dvy
        vt = nx * dvy - ny * dvx + bt * wb - at * wa
        bound = mu * (base + q0 + q1)
        t2 = min(max(qt - vt * itt, -bound), bound)
        ta = wa - per_mass * r[k + MA] * at * (t2 - qt)
        tb = wb + per_mass * r[k + MB] * bt * (t2 - qt)
        u0 = along + bn0 * tb - an0 * ta + r[k + WANT0] - k00 * q0 - k01 * q1
        u1 = along + bn1 * tb - an1 * ta + r[k + WANT1] - k01 * q0 - k11 * q1
        p0, p1 = two_points(u0, u1, k01, r[k + I00], r[k + I11], k00, k11, idet)
        vn = along + bn0 * wb - an0 * wa + r[k + WANT0]
        pn, pt = one_point(vn - k00 * q0 - k01 * qt, vt - k01 * q0 - ktt * qt, k00, ktt, k01, itt,
                           idet, mu, base)
        p0, p1, t = (p0 if two else pn), (p1 if two else 0.0), (t2 if two else pt)
        push(r, k, per_mass, p0 - q0, p1 - q1, t - qt)
        r[k + PN0], r[k + PN1], r[k + PT] = p0, p1, t
        r[k + CHANGE] = max(max(abs(p0 - q0) * k00, abs(p1 - q1) * k11), abs(t - qt) * ktt)


@inline
def apply_impulses(rows: Rows, per_mass: float, v: Bodies) -> None:
    """Apply the impulses of the blocks that are marked -1 in ``rows.seen``."""
    r, first, seen, active = rows.field, rows.first, rows.seen, rows.active
    vx, vy, w = v.vx, v.vy, v.w
    for colour in range(COLOURS):
        m = 0
        for block in range(first[colour], first[colour + 1]):
            active[m] = block
            m += seen[block] == -1
        for j in range(m):
            gather(rows, active[j], vx, vy, w)
        for j in range(m):
            o = U(active[j]) * BLOCK
            for i in range(LANES):
                k = o + i
                push(r, k, per_mass, r[k + PN0], r[k + PN1], r[k + PT])
        for j in range(m):
            scatter(rows, active[j], vx, vy, w)


@inline
def sweep_rows(rows: Rows, per_mass: float, v: Bodies, tolerance: float, clock: int,
               forward: bool, skip: int) -> tuple[float, int]:
    """One pass over the blocks of which a body has moved since they were last solved.

    With `skip` 0 it is one over all blocks.

    Returns the largest contact velocity that a row changed, and the clock.
    """
    r, body, seen, single, active, first = (rows.field, rows.body, rows.seen, rows.single,
                                            rows.active, rows.first)
    vx, vy, w, moved = v.vx, v.vy, v.w, v.moved
    worst = 0.0
    for q in range(COLOURS):
        colour = q if forward else COLOURS - 1 - q
        m = 0
        for block in range(first[colour], first[colour + 1]):
            t, since = U(block) * BODIES, seen[block] if skip != 0 else -1
            some = False
            for i in range(BODIES):
                some |= moved[U(body[t + i])] > since
            active[m] = block
            m += some
        rows.effort[0] += first[colour + 1] - first[colour]
        rows.effort[1] += first[colour + 1] - first[colour] - m
        if m == 0:
            continue
        clock += 1
        for j in range(m):
            gather(rows, active[j], vx, vy, w)
        for j in range(m):
            if single[active[j]] == 0:
                solve_pairs(r, active[j], per_mass)
            else:
                solve_mixed(r, U(active[j]) * BLOCK, LANES, per_mass)
        for j in range(m):
            block = active[j]
            scatter(rows, block, vx, vy, w)
            o, t = U(block) * BLOCK, U(block) * BODIES
            seen[block] = clock
            for i in range(LANES):
                change = r[o + CHANGE + i]
                if change > tolerance:
                    # Friction and normal impulses alternate: look at them again.
                    seen[block] = clock - 1
                    moved[U(body[t + i])] = clock
                    moved[U(body[t + LANES + i])] = clock
                worst = max(worst, change)
    return worst, clock


@inline
def sweep_floor(floor: FloorLaw, k: Numbers, im: float, ii: float, c: np.ndarray,
                s: np.ndarray, v: Bodies, clock: int, tolerance: float) -> None:
    """Solve the floor's impulse of every tile."""
    bound, turn = floor.force * k.h, floor.torque * k.h
    mass, inertia = 1.0 / im, 1.0 / ii
    vx, vy, w, moved, change = v.vx, v.vy, v.w, v.moved, v.change
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    n = U(k.n)
    if floor.law == SEPARATE:
        for i in range(n):
            tx, ty, tw = vx[i] - im * floorx[i], vy[i] - im * floory[i], w[i] - ii * floort[i]
            px, py, stops = disc(startx[i], starty[i], tx, ty, mass, bound)
            pw, halts = interval(startw[i], tw, inertia, turn)
            # A tile that the floor stops is at rest exactly, not to rounding.
            ux, uy = (0.0 if stops else tx + im * px), (0.0 if stops else ty + im * py)
            uw = 0.0 if halts else tw + ii * pw
            change[i] = max(max(abs(ux - vx[i]), abs(uy - vy[i])), k.width * abs(uw - w[i]))
            floorx[i], floory[i], floort[i] = px, py, pw
            vx[i], vy[i], w[i] = ux, uy, uw
    else:
        for i in range(n):
            tx, ty, tw = vx[i] - im * floorx[i], vy[i] - im * floory[i], w[i] - ii * floort[i]
            px, py, pw = floor_impulse(floor.law, startx[i], starty[i], startw[i], tx, ty, tw,
                                       mass, inertia, bound, turn, c[i], s[i])
            stopped = px == -mass * tx and py == -mass * ty
            ux, uy = (0.0 if stopped else tx + im * px), (0.0 if stopped else ty + im * py)
            uw = 0.0 if pw == -inertia * tw else tw + ii * pw
            change[i] = max(max(abs(ux - vx[i]), abs(uy - vy[i])), k.width * abs(uw - w[i]))
            floorx[i], floory[i], floort[i] = px, py, pw
            vx[i], vy[i], w[i] = ux, uy, uw
    for i in range(n):
        moved[i] = clock if change[i] > tolerance else moved[i]


@inline
def relax(rows: Rows, m: int, k: Numbers, floor: FloorLaw, im: float, ii: float, c: np.ndarray,
          s: np.ndarray, v: Bodies, tolerance: float) -> int:
    """Gauss-Seidel passes until none changes a contact velocity by more than `tolerance`.

    The impulses that the rows carry must already have been applied.  Blocks marked -1 in
    ``rows.seen`` are solved at least once, those marked 0 only once a body of theirs has moved.
    Returns the number of passes, or -1 - passes where the limit was reached first.
    """
    clock = np.int64(1)
    v.moved[:] = 0
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, clock, tolerance)
    done = -1 - k.passes
    for p in range(k.passes):
        worst, clock = sweep_rows(rows, ii / im, v, tolerance, clock,
                                  p < 4 or p % 2 == 0, k.skip_converged)
        if worst <= tolerance:
            done = p + 1
            break
        if floor.law != 0:
            clock += 1
            sweep_floor(floor, k, im, ii, c, s, v, clock, tolerance)
    if floor.law != 0 and done > 0:  # last, so that what the floor holds is at rest exactly
        sweep_floor(floor, k, im, ii, c, s, v, clock + 1, tolerance)
    return done


@inline
def limit_work(rows: Rows, k: Numbers, floor: FloorLaw, im: float, ii: float, c: np.ndarray,
               s: np.ndarray, v: Bodies, u: Bodies, tolerance: float) -> None:
    """Scale the contact impulses down where, together, they would do work.

    A solved contact problem only takes energy from the velocities `u` that it began with; one
    that was broken off, above all one begun with the impulses of a substep before whose load
    has gone, may add some.  The work, impulses times mean velocity, is a parabola in the scale.
    """
    vx, vy, w, ux, uy, uw = v.vx, v.vy, v.w, u.vx, u.vy, u.w
    floorx, floory, floort = v.floorx, v.floory, v.floort
    n = U(k.n)
    energy, power = v.change, u.change
    for i in range(n):
        gx, gy, gw = im * floorx[i], im * floory[i], ii * floort[i]
        dx, dy, dw = vx[i] - gx - ux[i], vy[i] - gy - uy[i], w[i] - gw - uw[i]
        energy[i] = 0.5 * (k.mass * (dx * dx + dy * dy) + k.inertia * dw * dw)
        power[i] = (k.mass * (dx * (ux[i] + 0.5 * gx) + dy * (uy[i] + 0.5 * gy))
                    + k.inertia * dw * (uw[i] + 0.5 * gw))
    square, mixed = 0.0, 0.0
    for i in range(n):  # a loop of its own: sums are in order, and do not vectorise
        square += energy[i]
        mixed += power[i]
    if square + mixed <= 1e-14 * square:
        return
    scale = max(-mixed / square, 0.0)
    for i in range(n):
        vx[i] = ux[i] + scale * (vx[i] - im * floorx[i] - ux[i])
        vy[i] = uy[i] + scale * (vy[i] - im * floory[i] - uy[i])
        w[i] = uw[i] + scale * (w[i] - ii * floort[i] - uw[i])
    floorx[:] = 0.0
    floory[:] = 0.0
    floort[:] = 0.0
    r = rows.field
    for block in range(rows.first[COLOURS]):
        o = U(block) * BLOCK
        for i in range(LANES):
            r[o + PN0 + i] *= scale
            r[o + PN1 + i] *= scale
            r[o + PT + i] *= scale
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, np.int64(1), tolerance)


@inline
def ways_out(rows: Rows, block: int, k: Numbers, v: Bodies) -> bool:
    """How far the points of a block may or must move (m) into ``want``; whether any must.

    Points that will overlap by more than the slop move two fifths of the way back, never further
    than 2 % of the width; others may close their gap.
    """
    slop, most = SLOP * k.width, 0.02 * k.width
    r = rows.field
    gather(rows, block, v.vx, v.vy, v.w)
    o = U(block) * BLOCK
    some = 0
    for i in range(LANES):
        j = o + i
        wa, wb, count = r[j + AW], r[j + BW], r[j + COUNT]
        along = r[j + NX] * (r[j + BX] - r[j + AX]) + r[j + NY] * (r[j + BY] - r[j + AY])
        g0 = r[j + GAP0] + slop + k.h * (along + r[j + BN0] * wb - r[j + AN0] * wa)
        g1 = r[j + GAP1] + slop + k.h * (along + r[j + BN1] * wb - r[j + AN1] * wa)
        g0, g1 = (g0 if count > 0.5 else 1.0), (g1 if count > 1.5 else 1.0)
        r[j + WANT0] = g0 if g0 > 0.0 else max(0.4 * g0, -most)
        r[j + WANT1] = g1 if g1 > 0.0 else max(0.4 * g1, -most)
        some += 1 if (g0 < 0.0) | (g1 < 0.0) else 0
    return some > 0


@inline
def project(rows: Rows, k: Numbers, per_mass: float, v: Bodies, shift: Bodies,
            x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> bool:
    """Move deeply overlapping tiles apart; returns whether there were any.

    The velocity solve does not push apart what overlaps, so that it never adds energy; a
    solved scene does not need this.  One pass: what is left is there again in the next substep.
    """
    r, body, first, active = rows.field, rows.body, rows.first, rows.active
    vx, vy = v.vx, v.vy
    deep = 0
    # Only points that overlap, or that the solve has not come to the end with, can be deep.
    low, rough = -0.5 * SLOP * k.width, 0.5 * SLOP * k.width / k.h
    for block in range(first[COLOURS]):
        o = U(block) * BLOCK
        some = 0
        for i in range(LANES):
            j = o + i
            near = (min(r[j + GAP0], r[j + GAP1]) < low) | (r[j + CHANGE] > rough)
            some += 1 if near & (r[j + COUNT] != 0.0) else 0
        active[block] = 1 if some > 0 else 0
    for block in range(first[COLOURS]):
        if active[block] == 1 and ways_out(rows, block, k, v):
            active[block] = 2
            deep += 1
    if deep == 0:
        return False
    sx, sy, sw, moved = shift.vx, shift.vy, shift.w, shift.moved
    sx[:] = 0.0
    sy[:] = 0.0
    sw[:] = 0.0
    moved[:] = 0
    mobile = v.mobile
    for block in range(first[COLOURS]):
        o, t = U(block) * BLOCK, U(block) * BODIES
        if active[block] != 2:
            near = False
            for i in range(BODIES):
                near |= moved[U(body[t + i])] > 0
            if not near:
                continue
            if active[block] == 0:
                ways_out(rows, block, k, v)
        gather(rows, block, sx, sy, sw)
        part_points(r, block, per_mass)
        scatter(rows, block, sx, sy, sw)
        for i in range(LANES):
            q = r[o + CHANGE + i]
            if q == 0.0:
                continue
            a, b = U(body[t + i]), U(body[t + LANES + i])
            moved[a] = moved[b] = 1
            nx, ny = r[o + NX + i], r[o + NY + i]
            qa, qb = q * r[o + MA + i], q * r[o + MB + i]
            x[a] -= qa * nx
            y[a] -= qa * ny
            x[b] += qb * nx
            y[b] += qb * ny
            if mobile[a] * mobile[b] != 0.0:
                # As a skater's spin slows when the arms go out: two free tiles that are moved
                # apart along n keep their angular momentum by losing of their tangential
                # velocity, and only lose.
                apart = nx * (x[b] - x[a]) + ny * (y[b] - y[a])
                slip = nx * (vy[b] - vy[a]) - ny * (vx[b] - vx[a])
                lost = min(qa / apart, 0.5) * slip
                vx[a] -= lost * ny
                vy[a] += lost * nx
                vx[b] += lost * ny
                vy[b] -= lost * nx
    for i in range(k.n):
        angle[i] += sw[i]
    return True


@inline
def part_points(r: np.ndarray, block: int, per_mass: float) -> None:
    """Move the bodies of a block apart, as ``want`` says; the sum of both pushes in ``change``."""
    o = U(block) * BLOCK
    for i in range(LANES):
        j = o + i
        wa, wb, one = r[j + AW], r[j + BW], r[j + COUNT] < 1.5
        along = r[j + NX] * (r[j + BX] - r[j + AX]) + r[j + NY] * (r[j + BY] - r[j + AY])
        u0 = along + r[j + BN0] * wb - r[j + AN0] * wa + r[j + WANT0]
        u1 = along + r[j + BN1] * wb - r[j + AN1] * wa + r[j + WANT1]
        p0, p1 = two_points(u0, u1, r[j + K01], r[j + I00], r[j + I11], r[j + K00], r[j + K11],
                            r[j + IDET])
        p0, p1 = (max(-u0 * r[j + I00], 0.0) if one else p0), (0.0 if one else p1)
        push(r, j, per_mass, p0, p1, 0.0)
        r[j + CHANGE] = p0 + p1
