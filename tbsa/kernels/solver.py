"""The contact solve: projected Gauss-Seidel over blocks of manifolds and over floor patches.

For every contact point, with ``vn`` the relative normal velocity at the end of the substep:

    vn + want >= 0,   pn >= 0,   pn (vn + want) = 0      (no penetration; want = gap / h,
                                                        and what it gains along an arc)
    |pt| <= mu pn,    pt against the relative tangential velocity   (Coulomb)

A manifold of one point is solved exactly for both impulses; one of two points exactly for both
normal impulses, in turn with its one friction impulse.  Friction with the floor is a bounded
impulse of each tile (see `floor.py`) and is solved between the passes.

While many rows change, passes are over all blocks; mostly that is one.  It leaves a few rows in a
hundred that change by more than half the tolerance; those, and the rows of the tiles that they
move, are solved one by one until nothing changes: converged parts of the scene drop out of further
passes.  Where a few passes are not enough, each goes on from a point beyond where the last one
ended (`go_on`): what many rows carry in common, as the load of a long row of tiles does, settles
in a tenth of the passes (`hasten`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns, copy, set_all
from tbsa.kernels.contacts import (
    ALONE,
    AN0,
    AN1,
    AT,
    AW,
    AX,
    AY,
    BASE,
    BEND0,
    BEND1,
    BLOCK,
    BN0,
    BN1,
    BODIES,
    BT,
    BW,
    BX,
    BY,
    CHANGE,
    CHUNK,
    COLOURS,
    COUNT,
    GAP0,
    GAP1,
    HIT,
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
    VN0,
    VN1,
    WANT0,
    WANT1,
    WARM0,
    WARM1,
    WARMT,
    Rows,
)
from tbsa.kernels.crew import (
    APPLY,
    DEEP,
    FLOOR,
    LEAST_BLOCKS,
    LEAST_TILES,
    LINE,
    SWEEP,
    TALLY,
    WORK,
    Crew,
    collect,
    give,
)
from tbsa.kernels.floor import COUPLED, SEPARATE, FloorLaw, coupled, exact, separate
from tbsa.kernels.jit import ZERO, U, apart, inline, lane

# Overlap that is left alone (fraction of the width).  The velocity solve does not press points
# together, so overlap comes from the curvature of fast rotations and from unconverged passes.
SLOP = 1e-3
# A row is solved again if its tiles have been moved by more than this part of the tolerance: each
# has several rows, and each of them leaves something.
LITTLE = 0.5
MANY = 2  # rows that are woken by one that has changed, for a block in the time of a row
# Passes before the impulses have momentum, all of them forward, and passes at the limit that have
# none any more: a solve that is broken off must not end on its way.
PLAIN, LAST_PLAIN = 4, 4
# Impulses at the beginning of a pass, and at the end of the one before: fields that a solve has no
# other use for.
FROM0, FROM1, FROMT = WARM0, WARM1, WARMT
PAST0, PAST1, PASTT = VN0, VN1, HIT
SOLVED = 2  # on the list of this pass, in ``queued``; 1: of the next; 3: of both
# Tolerances beyond the threshold of restitution at which a pressed point still is on its way.
FLYING = 2.0
# Passes of what takes it back, in a substep; and as many more over what is deeper, in slops, while
# that is few rows, or no more than there are blocks.  Two passes alone left jammed tiles 1 % of the
# width in each other for up to half a second.
PROJECTIONS, FURTHER, DEEPER, FEW_ROWS = 2, 18, 3.0, 64


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
    skip_converged: int  # 1, or 0: solve every row in every pass
    join_substeps: int  # 1, or 0: never a longer one than h
    driven: int  # 1, or 0: nothing drives the tiles
    wall: int  # 0 none, 1 circle, 2 rectangle
    wall_x: float  # m, radius or half the width
    wall_y: float  # m, half the height


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
    moved: np.ndarray  # int64, scratch: whether something has moved it


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
@lane
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


@lane
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
def lane_of(q: int) -> Any:
    """Where the lane of row q (8 block + lane) begins."""
    return U(q // 8) * BLOCK + U(q % 8)


@inline
def gather_row(rows: Rows, q: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> Any:
    """The velocities of the bodies of row q (8 block + lane), into its lane, which it returns."""
    r, body = rows.field, rows.body
    i, t = lane_of(q), U(q // 8) * BODIES + U(q % 8)
    a, b = U(body[t]), U(body[t + LANES])
    r[i + AX], r[i + AY], r[i + AW] = vx[a], vy[a], w[a]
    r[i + BX], r[i + BY], r[i + BW] = vx[b], vy[b], w[b]
    return i


@inline
def scatter_row(rows: Rows, q: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """And back."""
    r, body = rows.field, rows.body
    i, t = lane_of(q), U(q // 8) * BODIES + U(q % 8)
    a, b = U(body[t]), U(body[t + LANES])
    vx[a], vy[a], w[a] = r[i + AX], r[i + AY], r[i + AW]
    vx[b], vy[b], w[b] = r[i + BX], r[i + BY], r[i + BW]


@inline
def solve_row(rows: Rows, q: int, per_mass: float, v: Bodies) -> float:
    """Solve row q alone; returns by how much (m/s) it changed."""
    r, vx, vy, w = rows.field, v.vx, v.vy, v.w
    i = gather_row(rows, q, vx, vy, w)
    solve_mixed(r, i, U(1), per_mass)
    scatter_row(rows, q, vx, vy, w)
    return float(r[i + CHANGE])


@lane
def apply_blocks(rows: Rows, per_mass: float, v: Bodies, begin: int, last: int) -> None:
    """Apply the impulses that the rows of these blocks of one colour carry."""
    r, active = rows.field, rows.active
    vx, vy, w = v.vx, v.vy, v.w
    for start in range(begin, last, CHUNK):
        m = start  # scratch of the chunk's own, as another thread may be at another chunk
        for block in range(start, min(start + CHUNK, last)):
            o = U(block) * BLOCK
            some = 0
            for i in range(LANES):
                some += 1 if (r[o + PN0 + i] != 0.0) | (r[o + PN1 + i] != 0.0) else 0
            active[m] = block
            m += 1 if some > 0 else 0
        for j in range(start, m):
            gather(rows, active[j], vx, vy, w)
        for j in range(start, m):
            o = U(active[j]) * BLOCK
            for i in range(LANES):
                k = o + i
                push(r, k, per_mass, r[k + PN0], r[k + PN1], r[k + PT])
        for j in range(start, m):
            scatter(rows, active[j], vx, vy, w)


@inline
def apply_impulses(rows: Rows, per_mass: float, v: Bodies, crew: Crew) -> None:
    """Apply the impulses that the rows carry."""
    r, first, colours = rows.field, rows.first, rows.colours
    vx, vy, w = v.vx, v.vy, v.w
    for j in range(rows.size[1]):
        colour = colours[j]
        mine, last = give(crew, APPLY, first[colour], first[colour + 1], LEAST_BLOCKS)
        apply_blocks(rows, per_mass, v, mine, last)
        collect(crew)
    for block in range(first[ALONE], first[COLOURS]):
        k = gather_row(rows, 8 * block, vx, vy, w)
        push(r, k, per_mass, r[k + PN0], r[k + PN1], r[k + PT])
        scatter_row(rows, 8 * block, vx, vy, w)


@lane
def sweep_blocks(rows: Rows, per_mass: float, v: Bodies, begin: int, last: int) -> None:
    """Solve these blocks of one colour; ``change`` says by how much (m/s) each row did."""
    r, single = rows.field, rows.single
    vx, vy, w = v.vx, v.vy, v.w
    for start in range(begin, last, CHUNK):
        end = min(start + CHUNK, last)
        for block in range(start, end):
            gather(rows, block, vx, vy, w)
        for block in range(start, end):
            if single[block] == 0:
                solve_pairs(r, block, per_mass)
            else:
                solve_mixed(r, U(block) * BLOCK, LANES, per_mass)
        for block in range(start, end):
            scatter(rows, block, vx, vy, w)


@inline
def sweep_rows(rows: Rows, per_mass: float, v: Bodies, forward: bool, crew: Crew) -> None:
    """One pass over all blocks."""
    first, colours, in_use = rows.first, rows.colours, rows.size[1]
    if not forward:
        sweep_alone(rows, per_mass, v)
    for j in range(in_use):
        colour = colours[j if forward else in_use - 1 - j]
        mine, last = give(crew, SWEEP, first[colour], first[colour + 1], LEAST_BLOCKS)
        sweep_blocks(rows, per_mass, v, mine, last)
        collect(crew)
    if forward:
        sweep_alone(rows, per_mass, v)


@inline
def sweep_alone(rows: Rows, per_mass: float, v: Bodies) -> None:
    """Solve the rows that are alone in their blocks."""
    for block in range(rows.first[ALONE], rows.first[COLOURS]):
        solve_row(rows, 8 * block, per_mass, v)


@inline
def sweep_floor(floor: FloorLaw, k: Numbers, im: float, ii: float, c: np.ndarray,
                s: np.ndarray, v: Bodies, crew: Crew) -> None:
    """Solve the floor's impulse of every tile."""
    begin, end = give(crew, FLOOR, ZERO, k.n, LEAST_TILES)
    floor_tiles(floor, k, im, ii, c, s, v, begin, end)
    collect(crew)


@inline
def floor_tiles(floor: FloorLaw, k: Numbers, im: float, ii: float, c: np.ndarray,
                s: np.ndarray, v: Bodies, begin: int, end: int) -> None:
    """Solve the floor's impulse of these tiles; ``change`` (m/s) says by how much it did."""
    bound, turn = floor.force * k.h, floor.torque * k.h
    mass, inertia = 1.0 / im, 1.0 / ii
    vx, vy, w, change = v.vx, v.vy, v.w, v.change
    startx, starty, startw = v.startx, v.starty, v.startw
    floorx, floory, floort = v.floorx, v.floory, v.floort
    first, last = U(begin), U(end)
    if floor.law == SEPARATE:
        for i in range(first, last):
            px, py, pw, ux, uy, uw = separate(
                startx[i], starty[i], startw[i], vx[i], vy[i], w[i], floorx[i], floory[i],
                floort[i], im, ii, mass, inertia, bound, turn)
            change[i] = max(max(abs(ux - vx[i]), abs(uy - vy[i])), k.width * abs(uw - w[i]))
            floorx[i], floory[i], floort[i] = px, py, pw
            vx[i], vy[i], w[i] = ux, uy, uw
    elif floor.law == COUPLED:
        for i in range(first, last):
            px, py, pw, ux, uy, uw = coupled(
                startx[i], starty[i], startw[i], vx[i], vy[i], w[i], floorx[i], floory[i],
                floort[i], im, ii, mass, inertia, bound, turn)
            change[i] = max(max(abs(ux - vx[i]), abs(uy - vy[i])), k.width * abs(uw - w[i]))
            floorx[i], floory[i], floort[i] = px, py, pw
            vx[i], vy[i], w[i] = ux, uy, uw
    else:
        for i in range(first, last):
            px, py, pw, ux, uy, uw = exact(
                startx[i], starty[i], startw[i], vx[i], vy[i], w[i], floorx[i], floory[i],
                floort[i], im, ii, mass, inertia, bound, turn, c[i], s[i])
            change[i] = max(max(abs(ux - vx[i]), abs(uy - vy[i])), k.width * abs(uw - w[i]))
            floorx[i], floory[i], floort[i] = px, py, pw
            vx[i], vy[i], w[i] = ux, uy, uw


@inline
def floor_alone(i: int, floor: FloorLaw, k: Numbers, im: float, ii: float, c: np.ndarray,
                s: np.ndarray, v: Bodies) -> float:
    """Solve the floor's impulse of tile i; returns by how much (m/s) it changed."""
    bound, turn = floor.force * k.h, floor.torque * k.h
    vx, vy, w = v.vx[i], v.vy[i], v.w[i]
    if floor.law == SEPARATE:
        px, py, pw, ux, uy, uw = separate(
            v.startx[i], v.starty[i], v.startw[i], vx, vy, w, v.floorx[i], v.floory[i],
            v.floort[i], im, ii, 1.0 / im, 1.0 / ii, bound, turn)
    elif floor.law == COUPLED:
        px, py, pw, ux, uy, uw = coupled(
            v.startx[i], v.starty[i], v.startw[i], vx, vy, w, v.floorx[i], v.floory[i],
            v.floort[i], im, ii, 1.0 / im, 1.0 / ii, bound, turn)
    else:
        px, py, pw, ux, uy, uw = exact(
            v.startx[i], v.starty[i], v.startw[i], vx, vy, w, v.floorx[i], v.floory[i],
            v.floort[i], im, ii, 1.0 / im, 1.0 / ii, bound, turn, c[i], s[i])
    v.floorx[i], v.floory[i], v.floort[i] = px, py, pw
    v.vx[i], v.vy[i], v.w[i] = ux, uy, uw
    return float(max(max(abs(ux - vx), abs(uy - vy)), k.width * abs(uw - w)))


@inline
def queue(rows: Rows, v: Bodies, tile: int, m: int) -> int:
    """Put the rows of a tile that are in contact, if they are not there yet, on the list of the
    next pass."""
    if v.mobile[tile] == 0.0:
        return m
    of, then, queued = rows.of, rows.then, rows.queued
    for p in range(rows.start[tile], rows.start[tile + 1]):
        q = of[p]
        if queued[q] % 2 == 0:
            queued[q] += 1
            then[m] = q
            m += 1
    return m


@lane
def changed(rows: Rows, little: float, begin: int, last: int) -> Any:
    """After a pass over all rows, how many of these blocks have changed by more than a little,
    noted for each in ``hits``, and the largest change (m/s)."""
    r, hits = rows.field, rows.hits
    many, worst = 0, 0.0
    for block in range(begin, last):
        o = U(block) * BLOCK
        some = 0
        for i in range(LANES):
            some += 1 if r[o + CHANGE + i] > little else 0
            worst = max(worst, r[o + CHANGE + i])
        hits[block] = some
        many += some
    return many, worst


@inline
def count_changed(rows: Rows, little: float, crew: Crew) -> Any:
    """The same of all rows."""
    blocks = rows.first[COLOURS]
    begin, last = give(crew, TALLY, ZERO, blocks, LEAST_BLOCKS)
    many, worst = changed(rows, little, begin, last)
    collect(crew)
    for other in range(1, crew.size if last < blocks else 1):
        many += crew.found[other * LINE]
        worst = max(worst, crew.deepest[other * LINE])
    return many, worst


@inline
def queue_changed(rows: Rows, n: int, floor: int, v: Bodies, little: float) -> int:
    """After a pass over all rows and the floor, list what is to be solved again."""
    r, body, change = rows.field, rows.body, v.change
    m = ZERO
    for block in range(rows.first[COLOURS]):
        if rows.hits[block] == 0:
            continue
        o, t = U(block) * BLOCK, U(block) * BODIES
        for i in range(LANES):
            if r[o + CHANGE + i] > little:
                m = queue(rows, v, body[t + i], m)
                m = queue(rows, v, body[t + LANES + i], m)
    for i in range(n if floor != 0 else 0):
        if change[i] > little:
            m = queue(rows, v, i, m)
    return int(m)


@inline
def sweep_queue(rows: Rows, size: int, k: Numbers, floor: FloorLaw, im: float, ii: float,
                c: np.ndarray, s: np.ndarray, v: Bodies, little: float) -> Any:
    """One pass over the `size` rows on the list, and the floor below the tiles that they move.

    Friction and normal impulses alternate: a row that has changed is on the next list, too.
    Returns the length of that, and the largest change (m/s) of a row.
    """
    body, now, queued, moved = rows.body, rows.now, rows.queued, v.moved
    m = ZERO
    worst = 0.0
    for j in range(size):
        q = now[j]
        queued[q] = 0
        change = solve_row(rows, q, ii / im, v)
        worst = max(worst, change)
        if change <= little:
            continue
        t = U(q // 8) * BODIES + U(q % 8)
        for tile in (body[t], body[t + LANES]):
            moved[tile] = 1
            m = queue(rows, v, tile, m)
    for j in range(size):
        t = U(now[j] // 8) * BODIES + U(now[j] % 8)
        for tile in (body[t], body[t + LANES]):
            if moved[tile] == 0:
                continue
            moved[tile] = 0
            if (floor.law != 0 and tile < k.n
                    and floor_alone(tile, floor, k, im, ii, c, s, v) > little):
                m = queue(rows, v, tile, m)
    return m, worst


@lane
def slope(r: np.ndarray, k: int) -> Any:
    """What this pass did to the row of lane k: the square of its change, in the norm of the energy
    (J), and the product with the way from the last pass to this one, which is negative where the
    momentum has gone too far."""
    q0, q1, qt = r[k + PN0], r[k + PN1], r[k + PT]
    d0, d1, dt = q0 - r[k + FROM0], q1 - r[k + FROM1], qt - r[k + FROMT]
    d0k, d1k, dtk = r[k + K00] * d0, r[k + K11] * d1, r[k + KTT] * dt
    return (d0k * d0 + d1k * d1 + dtk * dt,
            d0k * (q0 - r[k + PAST0]) + d1k * (q1 - r[k + PAST1]) + dtk * (qt - r[k + PASTT]))


@lane
def go_on(r: np.ndarray, k: int, beta: float, per_mass: float) -> float:
    """Take the impulses of lane k beyond where this pass has brought them, by `beta` times the way
    from where the last one had; they stay in their bounds.  Returns by how much (m/s) that changes
    the row.

    The momentum of Nesterov (1983), as Mazhar et al. (2015) have it for contacts, from one pass of
    Gauss-Seidel to the next instead of from one gradient step to the next.
    """
    q0, q1, qt = r[k + PN0], r[k + PN1], r[k + PT]
    p0 = max(q0 + beta * (q0 - r[k + PAST0]), 0.0)
    p1 = max(q1 + beta * (q1 - r[k + PAST1]), 0.0)
    bound = r[k + MU] * (r[k + BASE] + p0 + p1)
    pt = min(max(qt + beta * (qt - r[k + PASTT]), -bound), bound)
    push(r, k, per_mass, p0 - q0, p1 - q1, pt - qt)
    r[k + PN0], r[k + PN1], r[k + PT] = p0, p1, pt
    r[k + PAST0], r[k + PAST1], r[k + PASTT] = q0, q1, qt
    return float(max(max(abs(p0 - q0) * r[k + K00], abs(p1 - q1) * r[k + K11]),
                     abs(pt - qt) * r[k + KTT]))


@inline
def sweep_on(rows: Rows, size: int, per_mass: float, v: Bodies, little: float) -> Any:
    """One pass over the `size` rows on the list, as `sweep_queue`, without a floor.

    Returns the length of the next list, the largest change (m/s) of a row, and how the pass went:
    the two sums of `slope`.
    """
    r, body, now, queued = rows.field, rows.body, rows.now, rows.queued
    m = ZERO
    worst, square, onward = 0.0, 0.0, 0.0
    for j in range(size):
        q = now[j]
        i = lane_of(q)
        queued[q] = SOLVED
        r[i + FROM0], r[i + FROM1], r[i + FROMT] = r[i + PN0], r[i + PN1], r[i + PT]
        change = solve_row(rows, q, per_mass, v)
        more, further = slope(r, i)
        square += more
        onward += further
        worst = max(worst, change)
        if change <= little:
            continue
        t = U(q // 8) * BODIES + U(q % 8)
        m = queue(rows, v, body[t], m)
        m = queue(rows, v, body[t + LANES], m)
    return m, worst, square, onward


@lane
def set_past(r: np.ndarray, k: int) -> None:
    """The last pass left the row of lane k where it is."""
    r[k + PAST0], r[k + PAST1], r[k + PASTT] = r[k + PN0], r[k + PN1], r[k + PT]


@inline
def go_on_queue(rows: Rows, size: int, m: int, beta: float, per_mass: float, v: Bodies,
                little: float) -> int:
    """The rows of this list that are on the next one, too, go on; returns the length of that."""
    body, now, queued = rows.body, rows.now, rows.queued
    vx, vy, w = v.vx, v.vy, v.w
    for j in range(size):
        q = now[j]
        i = gather_row(rows, q, vx, vy, w)
        change = go_on(rows.field, i, beta if queued[q] > SOLVED else 0.0, per_mass)
        scatter_row(rows, q, vx, vy, w)
        if change <= little:
            continue
        t = U(q // 8) * BODIES + U(q % 8)
        m = queue(rows, v, body[t], m)
        m = queue(rows, v, body[t + LANES], m)
    return m


@inline
def next_queue(rows: Rows, size: int, m: int, fresh: bool) -> None:
    """The next list, of length m, takes the place of this one; what was not on this one, or all if
    nothing has gone on, has no past."""
    r, now, then, queued = rows.field, rows.now, rows.then, rows.queued
    for j in range(m):
        q = then[j]
        if fresh or queued[q] < SOLVED:
            set_past(r, lane_of(q))
    for j in range(size):
        queued[now[j]] -= SOLVED
    copy(then, now, m)


@inline
def begin_blocks(rows: Rows, fresh: bool) -> None:
    """Note the impulses of all rows before a pass, and if it is the first one with momentum, as
    those of the pass before as well."""
    r = rows.field
    for block in range(rows.first[COLOURS]):
        o = U(block) * BLOCK
        for i in range(LANES):
            k = o + i
            q0, q1, qt = r[k + PN0], r[k + PN1], r[k + PT]
            r[k + FROM0], r[k + FROM1], r[k + FROMT] = q0, q1, qt
            r[k + PAST0] = q0 if fresh else r[k + PAST0]
            r[k + PAST1] = q1 if fresh else r[k + PAST1]
            r[k + PASTT] = qt if fresh else r[k + PASTT]


@inline
def slope_blocks(rows: Rows) -> Any:
    """`slope`, summed over all rows."""
    r = rows.field
    square, onward = 0.0, 0.0
    for block in range(rows.first[COLOURS]):
        o = U(block) * BLOCK
        for i in range(LANES):
            more, further = slope(r, o + i)
            square += more
            onward += further
    return square, onward


@inline
def go_on_blocks(rows: Rows, beta: float, per_mass: float, v: Bodies) -> None:
    """All rows go on."""
    r, vx, vy, w = rows.field, v.vx, v.vy, v.w
    for block in range(rows.first[COLOURS]):
        gather(rows, block, vx, vy, w)
        o = U(block) * BLOCK
        for i in range(LANES):
            go_on(r, o + i, beta, per_mass)
        scatter(rows, block, vx, vy, w)


@apart
def hasten(rows: Rows, m: int, k: Numbers, per_mass: float, v: Bodies, tolerance: float,
           whole: bool, size: int, crew: Crew) -> int:
    """Go on with `relax` where there is no floor friction: with momentum.

    It grows from pass to pass, and begins anew where it has gone too far, or where a pass did more
    than the one before (the restarts of O'Donoghue and Candes 2015).  A solve has ended with a
    pass after a plain one.
    """
    now, queued = rows.now, rows.queued
    little = LITTLE * tolerance
    done, fresh = -1 - k.passes, True
    age, before, beta = ZERO, math.inf, 0.0
    for j in range(size):
        set_past(rows.field, lane_of(now[j]))
    for p in range(PLAIN, k.passes):
        rows.effort[0] += m
        if whole:
            for j in range(size):
                queued[now[j]] = 0
            begin_blocks(rows, fresh)
            sweep_rows(rows, per_mass, v, True, crew)
            many, worst = count_changed(rows, little, crew)
            square, onward = slope_blocks(rows)
            whole = k.skip_converged == 0 or MANY * many > rows.first[COLOURS]
            found = ZERO if whole else queue_changed(rows, k.n, ZERO, v, little)
            size = ZERO
        else:
            rows.effort[1] += m - size
            found, worst, square, onward = sweep_on(rows, size, per_mass, v, little)
        settled = worst <= tolerance and beta == 0.0
        age = age + 1 if onward >= 0.0 and square <= before else ZERO
        before = square
        beta = age / (age + 3.0) if worst > tolerance and p + 1 + LAST_PLAIN < k.passes else 0.0
        fresh = beta == 0.0
        if whole and not fresh:
            go_on_blocks(rows, beta, per_mass, v)
        elif not whole:
            listed = size > 0
            if listed and not fresh:
                found = go_on_queue(rows, size, found, beta, per_mass, v, little)
            next_queue(rows, size, found, fresh)
            size = found
            whole = listed and size > rows.first[COLOURS]
            fresh = fresh or whole  # what was not on the list has no past
        if settled:
            done = p + 1
            break
    for j in range(size):
        queued[now[j]] = 0
    return done


@inline
def relax(rows: Rows, m: int, k: Numbers, floor: FloorLaw, im: float, ii: float, c: np.ndarray,
          s: np.ndarray, v: Bodies, tolerance: float, crew: Crew) -> int:
    """Gauss-Seidel passes until none changes a contact velocity by more than `tolerance`.

    The impulses that the rows carry must already have been applied.  Passes are over all blocks
    while many rows change, then over the rows on a list.  On a floor with friction they go forward
    and backward by turns, and have no momentum, which needs passes that all go the same way: with
    those a block that the floor helps to hold creeps.
    Returns the number of passes, or -1 - passes where the limit was reached first.
    """
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, crew)
    if m == 0:
        return 0
    now, queued = rows.now, rows.queued
    little = LITTLE * tolerance
    set_all(v.moved, ZERO)
    done, whole = -1 - k.passes, True
    size = ZERO
    for p in range(k.passes):
        if floor.law == 0 and p == PLAIN:
            return int(hasten(rows, m, k, ii / im, v, tolerance, whole, size, crew))
        rows.effort[0] += m
        if whole:
            for j in range(size):
                queued[now[j]] = 0
            sweep_rows(rows, ii / im, v, p < PLAIN or p % 2 == 0, crew)
            if floor.law != 0:
                sweep_floor(floor, k, im, ii, c, s, v, crew)
            many, worst = count_changed(rows, little, crew)
            whole = k.skip_converged == 0 or MANY * many > rows.first[COLOURS]
            size = 0 if whole else queue_changed(rows, k.n, floor.law, v, little)
        else:
            rows.effort[1] += m - size
            size, worst = sweep_queue(rows, size, k, floor, im, ii, c, s, v, little)
            whole = size > rows.first[COLOURS]
        copy(rows.then, now, size)
        if worst <= tolerance:
            done = p + 1
            break
    for j in range(size):
        queued[now[j]] = 0
    if floor.law != 0:  # last, so that what the floor holds is at rest exactly
        sweep_floor(floor, k, im, ii, c, s, v, crew)
    return done


@inline
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
def work_on(k: Numbers, im: float, ii: float, v: Bodies, u: Bodies, begin: int,
            end: int) -> None:
    """The work that contacts do on each of these tiles, as the two terms of a parabola in their
    scale (J), into both ``change``."""
    vx, vy, w, ux, uy, uw = v.vx, v.vy, v.w, u.vx, u.vy, u.w
    floorx, floory, floort, energy, power = v.floorx, v.floory, v.floort, v.change, u.change
    for i in range(U(begin), U(end)):
        gx, gy, gw = im * floorx[i], im * floory[i], ii * floort[i]
        dx, dy, dw = vx[i] - gx - ux[i], vy[i] - gy - uy[i], w[i] - gw - uw[i]
        energy[i] = 0.5 * (k.mass * (dx * dx + dy * dy) + k.inertia * dw * dw)
        power[i] = (k.mass * (dx * (ux[i] + 0.5 * gx) + dy * (uy[i] + 0.5 * gy))
                    + k.inertia * dw * (uw[i] + 0.5 * gw))


@inline
def limit_work(rows: Rows, k: Numbers, floor: FloorLaw, im: float, ii: float, c: np.ndarray,
               s: np.ndarray, v: Bodies, u: Bodies, crew: Crew) -> None:
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
    begin, end = give(crew, WORK, ZERO, k.n, LEAST_TILES)
    work_on(k, im, ii, v, u, begin, end)
    collect(crew)
    for i in range(n):  # a loop of its own: sums are in order, and do not vectorise
        first = island[i]
        if first != i:
            energy[first] += energy[i]
            power[first] += power[i]
    some, scale = 0, power
    for i in range(n):
        works = (island[i] == i) & (energy[i] + power[i] > 1e-14 * energy[i])
        scale[i] = max(-power[i] / energy[i], 0.0) if works else 1.0
        some += 1 if works else 0
    if some == 0:
        return
    scale[n] = 1.0
    for i in range(n):
        part = scale[island[i]]
        if part == 1.0:
            continue
        vx[i] = ux[i] + part * (vx[i] - im * floorx[i] - ux[i])
        vy[i] = uy[i] + part * (vy[i] - im * floory[i] - uy[i])
        w[i] = uw[i] + part * (w[i] - ii * floort[i] - uw[i])
        floorx[i] = floory[i] = floort[i] = 0.0
    r, body, mobile = rows.field, rows.body, v.mobile
    for block in range(rows.first[COLOURS]):
        o, t = U(block) * BLOCK, U(block) * BODIES
        for i in range(LANES):
            a, b = body[t + i], body[t + LANES + i]
            part = scale[island[a if mobile[a] != 0.0 else b]]
            r[o + PN0 + i] *= part
            r[o + PN1 + i] *= part
            r[o + PT + i] *= part
    if floor.law != 0:
        sweep_floor(floor, k, im, ii, c, s, v, crew)


@inline
def part_row(rows: Rows, q: int, k: Numbers, per_mass: float, v: Bodies, shift: Bodies,
             x: np.ndarray, y: np.ndarray, angle: np.ndarray, left: float) -> bool:
    """Move the bodies of row q apart, if a point of it will overlap by more than `left` (m).

    It goes three fifths of the way back to four fifths of that, so that a point at rest is not
    at it again in each substep, and never further than 2 % of the width; the other point may close
    its gap.  Returns whether there was something to do.
    """
    slop, most = 0.8 * left, 0.02 * k.width
    spare = slop - left
    r, body, sx, sy, sw = rows.field, rows.body, shift.vx, shift.vy, shift.w
    vx, vy, w = v.vx, v.vy, v.w
    i, t = lane_of(q), U(q // 8) * BODIES + U(q % 8)
    a, b = U(body[t]), U(body[t + LANES])
    nx, ny, two = r[i + NX], r[i + NY], r[i + COUNT] > 1.5
    # Where the points will be after a substep at these velocities, with what has been moved yet.
    turn_a, turn_b = k.h * w[a] + sw[a], k.h * w[b] + sw[b]
    along = (nx * (k.h * (vx[b] - vx[a]) + sx[b] - sx[a])
             + ny * (k.h * (vy[b] - vy[a]) + sy[b] - sy[a]))
    h2 = k.h * k.h
    g0 = (r[i + GAP0] + h2 * r[i + BEND0] + slop + along + r[i + BN0] * turn_b
          - r[i + AN0] * turn_a)
    g1 = (r[i + GAP1] + h2 * r[i + BEND1] + slop + along + r[i + BN1] * turn_b
          - r[i + AN1] * turn_a)
    if g0 >= spare and (g1 >= spare or not two):
        return False
    g0 = g0 if g0 > 0.0 else max(0.6 * g0, -most)
    g1 = g1 if g1 > 0.0 else max(0.6 * g1, -most)
    if two:
        p0, p1 = two_points(g0, g1, r[i + K01], r[i + I00], r[i + I11], r[i + K00], r[i + K11],
                            r[i + IDET])
    else:
        p0, p1 = -g0 * r[i + I00], 0.0
    qa, qb = (p0 + p1) * r[i + MA], (p0 + p1) * r[i + MB]
    turn_a = -per_mass * r[i + MA] * (r[i + AN0] * p0 + r[i + AN1] * p1)
    turn_b = per_mass * r[i + MB] * (r[i + BN0] * p0 + r[i + BN1] * p1)
    sx[a] -= qa * nx
    sy[a] -= qa * ny
    sw[a] += turn_a
    sx[b] += qb * nx
    sy[b] += qb * ny
    sw[b] += turn_b
    x[a] -= qa * nx
    y[a] -= qa * ny
    angle[a] += turn_a
    x[b] += qb * nx
    y[b] += qb * ny
    angle[b] += turn_b
    if qa * qb != 0.0:
        # As a skater's spin slows when the arms go out: two free tiles that are moved apart
        # along n keep their angular momentum by losing of their tangential velocity, and only
        # lose.
        apart = nx * (x[b] - x[a]) + ny * (y[b] - y[a])
        slip = nx * (vy[b] - vy[a]) - ny * (vx[b] - vx[a])
        lost = min(qa / apart, 0.5) * slip
        vx[a] -= lost * ny
        vy[a] += lost * nx
        vx[b] += lost * ny
        vy[b] -= lost * nx
    return True


@lane
def find_deep(rows: Rows, k: Numbers, begin: int, last: int) -> None:
    """Mark the rows of these blocks that will overlap by more than the slop after a substep, in
    ``hit``, and count them in ``hits``.

    With the velocities of each row when it was last solved, which is near enough to choose.
    A point that the solve has only kept from coming too far, as it is still on its way at more
    than what a solve leaves, gets rid of its impulse: it has not been in contact, and hits in the
    next substep.
    """
    r, hits, low = rows.field, rows.hits, -SLOP * k.width
    away = k.h * (k.threshold + FLYING * k.tolerance)
    for block in range(begin, last):
        o = U(block) * BLOCK
        some = 0
        for i in range(LANES):
            at = o + i
            wa, wb, count = r[at + AW], r[at + BW], r[at + COUNT]
            along = r[at + NX] * (r[at + BX] - r[at + AX]) + r[at + NY] * (r[at + BY] - r[at + AY])
            g0 = r[at + GAP0] + k.h * (along + k.h * r[at + BEND0] + r[at + BN0] * wb
                                       - r[at + AN0] * wa)
            g1 = r[at + GAP1] + k.h * (along + k.h * r[at + BEND1] + r[at + BN1] * wb
                                       - r[at + AN1] * wa)
            near = ((g0 < low) & (count > 0.5)) | ((g1 < low) & (count > 1.5))
            r[at + HIT] = 1.0 if near else 0.0
            r[at + PN0] = 0.0 if r[at + GAP0] > away else r[at + PN0]
            r[at + PN1] = 0.0 if r[at + GAP1] > away else r[at + PN1]
            some += 1 if near else 0
        hits[block] = some


@inline
def project(rows: Rows, k: Numbers, per_mass: float, v: Bodies, shift: Bodies,
            x: np.ndarray, y: np.ndarray, angle: np.ndarray, crew: Crew) -> bool:
    """Move deeply overlapping tiles apart; returns whether there were any.

    The velocity solve does not push apart what overlaps, so that it never adds energy; a
    solved scene does not need this.  Rows one by one, from the deep ones on to those of the
    tiles that they move; what is left after some passes is there again in the next substep.
    """
    r, body, first, now, queued = rows.field, rows.body, rows.first, rows.now, rows.queued
    begin, last = give(crew, DEEP, ZERO, first[COLOURS], LEAST_BLOCKS)
    find_deep(rows, k, begin, last)
    collect(crew)
    size = 0
    for block in range(first[COLOURS]):
        if rows.hits[block] == 0:
            continue
        o = U(block) * BLOCK
        for i in range(LANES):
            if r[o + HIT + i] != 0.0:
                now[size] = 8 * block + int(i)
                queued[now[size]] = 1
                size += 1
    if size == 0:
        return False
    set_all(shift.vx, 0.0)
    set_all(shift.vy, 0.0)
    set_all(shift.w, 0.0)
    some, left = 0, SLOP * k.width
    for p in range(PROJECTIONS + FURTHER):
        m = ZERO
        left = left if p < PROJECTIONS else DEEPER * SLOP * k.width
        for j in range(size):
            q = now[j]
            queued[q] = 0
            if part_row(rows, q, k, per_mass, v, shift, x, y, angle, left):
                t = U(q // 8) * BODIES + U(q % 8)
                m = queue(rows, v, body[t], m)
                m = queue(rows, v, body[t + LANES], m)
        some += m
        copy(rows.then, now, m)
        size = m
        if m == 0 or (p + 1 >= PROJECTIONS and m > max(FEW_ROWS, first[COLOURS])):
            break
    for j in range(size):
        queued[now[j]] = 0
    return some > 0
