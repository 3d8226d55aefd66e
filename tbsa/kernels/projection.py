"""Projection: what overlaps deeply is moved apart, without a change of velocity that adds energy.

The velocity solve does not press points apart, so that overlap comes only from the curvature of
fast rotations and from solves that end before they have converged.
"""

from __future__ import annotations

import numpy as np

from tbsa.kernels.arrays import copy, set_all
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.contacts import NOTED, RESTS, SWEPT
from tbsa.kernels.crew import DEEP, LEAST_BLOCKS, LEAST_ROWS, PART, Crew, collect, give
from tbsa.kernels.geometry import (
    CIRCLE,
    circle_corner,
    corner_arm,
    square_square,
    turned_on,
    wall_square,
)
from tbsa.kernels.jit import ZERO, U, inline, lane, rolled
from tbsa.kernels.manifold import two_points
from tbsa.kernels.rows import (
    AN0,
    AN1,
    AW,
    AX,
    AY,
    BEND0,
    BEND1,
    BLOCK,
    BN0,
    BN1,
    BW,
    BX,
    BY,
    COLOURS,
    COUNT,
    FAR_ROWS,
    GAP0,
    GAP1,
    HIT,
    I00,
    I11,
    IDET,
    IDLE,
    K00,
    K01,
    K11,
    LANES,
    LONE_ROWS,
    MA,
    MB,
    MU,
    NX,
    NY,
    PN0,
    PN1,
    PT,
    WIDE,
    E,
    Rows,
    bodies_of,
    lane_of,
    wall_code,
)
from tbsa.kernels.sweeps import queue

# Overlap that is left alone (fraction of the width).
SLOP = 1e-3
# Tolerances beyond the threshold of restitution at which a pressed point still is on its way.
FLYING = 2.0
# Passes of what takes it back, in a substep; and as many more over what is deeper, in slops, while
# that is few rows, or no more than there are blocks.  Two passes alone left jammed tiles 1 % of the
# width in each other for up to half a second.
PROJECTIONS, FURTHER, DEEPER, FEW_ROWS = 2, 18, 3.0, 64
# A list of so many rows is put in the order of the blocks, so that threads share those of a colour.
MANY_ROWS = 1024


@inline
def clears(rows: Rows, q: int, k: Numbers, v: Bodies, x: np.ndarray, y: np.ndarray, c: np.ndarray,
           s: np.ndarray, turn_a: float, turn_b: float, rest: float, left: float) -> bool:
    """Whether the bodies of row q will not overlap by more than `left` (m) after a time `rest` (s),
    and when they have turned by so much from where c and s are taken (rad).

    A row tells of how they were and went; after an impact, they have hit only when they will have
    come to where it was, and have turned meanwhile, and where they only come from another face may
    be the nearest.
    """
    r, body, half = rows.field, rows.body, 0.5 * k.width
    t = bodies_of(q)
    a, b = U(body[t]), U(body[t + LANES])
    ca, sa = turned_on(c[a], s[a], turn_a)
    xa, ya = x[a] + rest * v.vx[a], y[a] + rest * v.vy[a]
    wall, code = b == U(k.n), wall_code(r, lane_of(q))
    if wall and k.wall == CIRCLE:
        rx, ry = corner_arm(code, half, ca, sa)
        gap, _, _ = circle_corner(xa + rx, ya + ry, k.wall_x)
        return bool(gap >= -left)
    cb, sb = turned_on(c[b], s[b], turn_b)
    dx, dy = x[b] + rest * v.vx[b] - xa, y[b] + rest * v.vy[b] - ya
    if wall:
        cb, sb = 1.0, 0.0
        dx, dy = wall_square(k, code, xa, ya)
    count, _, _, _, gap0, _, _, _, gap1, _, _, _, _, _, _ = square_square(
        dx, dy, ca, sa, cb, sb, k.width, 0.0, wall)
    return bool(count == 0.0 or min(gap0, gap1) >= -left)


@inline
def part_row(rows: Rows, q: int, k: Numbers, v: Bodies, shift: Bodies, x: np.ndarray, y: np.ndarray,
             angle: np.ndarray, c: np.ndarray, s: np.ndarray, rest: float, left: float) -> bool:
    """Move the bodies of row q apart, if a point of it will overlap by more than `left` (m).

    It goes three fifths of the way back to four fifths of that, so that a point at rest is not
    at it again in each substep, and never further than 2 % of the width; the other point may close
    its gap.  Returns whether there was something to do.
    """
    slop, most = 0.8 * left, 0.02 * k.width
    spare = slop - left
    r, body, sx, sy, sw = rows.field, rows.body, shift.vx, shift.vy, shift.w
    vx, vy, w = v.vx, v.vy, v.w
    i, t = lane_of(q), bodies_of(q)
    a, b = U(body[t]), U(body[t + LANES])
    nx, ny, two = r[i + NX], r[i + NY], r[i + COUNT] > 1.5
    # Where the points will be in the next substep as they go, with what has been moved yet.
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
    if clears(rows, q, k, v, x, y, c, s, turn_a, turn_b, rest, left):
        return False
    g0 = g0 if g0 > 0.0 else max(0.6 * g0, -most)
    g1 = g1 if g1 > 0.0 else max(0.6 * g1, -most)
    if two:
        p0, p1 = two_points(g0, g1, r[i + K01], r[i + I00], r[i + I11], r[i + K00], r[i + K11],
                            r[i + IDET])
    else:
        p0, p1 = -g0 * r[i + I00], 0.0
    qa, qb = (p0 + p1) * r[i + MA], (p0 + p1) * r[i + MB]
    turn_a = -k.per_mass * r[i + MA] * (r[i + AN0] * p0 + r[i + AN1] * p1)
    turn_b = k.per_mass * r[i + MB] * (r[i + BN0] * p0 + r[i + BN1] * p1)
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


@rolled
def hold(r: np.ndarray, o: int, k: Numbers) -> None:
    """Give a point of the block at `o` that touches and stays, without restitution, an impulse, if
    it has none: it has been in contact.

    What slides along a curve comes again in the next substep.  There the solve bears it; it would
    hit, and be stopped, in every substep.
    """
    least, slow, little = RESTS * k.width, k.threshold + k.tolerance, NOTED * k.tolerance
    for i in range(LANES):
        at = o + i
        wa, wb, count = r[at + AW], r[at + BW], r[at + COUNT]
        along = r[at + NX] * (r[at + BX] - r[at + AX]) + r[at + NY] * (r[at + BY] - r[at + AY])
        v0 = along + r[at + BN0] * wb - r[at + AN0] * wa
        v1 = along + r[at + BN1] * wb - r[at + AN1] * wa
        plastic = r[at + E] == 0.0
        g0 = r[at + GAP0] + k.h * (v0 + k.h * r[at + BEND0])
        g1 = r[at + GAP1] + k.h * (v1 + k.h * r[at + BEND1])
        stays0 = (plastic & (count > 0.5) & (r[at + GAP0] < least) & (g0 < least)
                  & (abs(v0) < slow))
        stays1 = (plastic & (count > 1.5) & (r[at + GAP1] < least) & (g1 < least)
                  & (abs(v1) < slow))
        r[at + PN0] = max(r[at + PN0], little * r[at + I00]) if stays0 else r[at + PN0]
        r[at + PN1] = max(r[at + PN1], little * r[at + I11]) if stays1 else r[at + PN1]


@rolled
def find_deep(rows: Rows, k: Numbers, begin: int, last: int) -> None:
    """Mark the rows of these blocks that will overlap by more than the slop in the next substep,
    to whose middle ``k.h`` looks ahead, in ``hit``, and count them in ``hits``.

    With the velocities of each row when it was last solved, which is near enough to choose.
    A point that the solve has only kept from coming too far, as it is still on its way at more
    than what a solve leaves and its arc gives, gets rid of its impulse, and of the friction that
    this has borne: it has not been in contact, and hits in the next substep.  So does what turns
    fast, as faces that come after it have to be seen.
    """
    r, hits, low = rows.field, rows.hits, -SLOP * k.width
    away = k.h * (k.threshold + FLYING * k.tolerance)
    plastic = (k.e == 0.0) | (k.e_wall == 0.0)
    for block in range(begin, last):
        hits[block] = 0
        if rows.single[block] == IDLE:
            continue
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
            arc = k.h * k.h if k.h * (abs(wa) + abs(wb)) <= SWEPT else 0.0
            r[at + PN0] = 0.0 if r[at + GAP0] > away + arc * abs(r[at + BEND0]) else r[at + PN0]
            r[at + PN1] = 0.0 if r[at + GAP1] > away + arc * abs(r[at + BEND1]) else r[at + PN1]
            most = r[at + MU] * (r[at + PN0] + r[at + PN1])
            r[at + PT] = min(max(r[at + PT], -most), most)
            some += 1 if near else 0
        hits[block] = some
        if plastic:
            hold(r, o, k)


@lane
def part_listed(rows: Rows, k: Numbers, v: Bodies, shift: Bodies, x: np.ndarray, y: np.ndarray,
                angle: np.ndarray, c: np.ndarray, s: np.ndarray, rest: float, left: float,
                begin: int, end: int) -> None:
    """Move apart the bodies of these rows of the list; ``changes`` says where there was something
    to do."""
    now, changes = rows.now, rows.changes
    for j in range(begin, end):
        parted = part_row(rows, now[j], k, v, shift, x, y, angle, c, s, rest, left)
        changes[j] = 1.0 if parted else 0.0


@inline
def part_all(rows: Rows, size: int, k: Numbers, v: Bodies, shift: Bodies, x: np.ndarray,
             y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, rest: float,
             left: float, crew: Crew) -> None:
    """The same of all rows of the list, in its order; of a long one threads share each colour."""
    now, first = rows.now, rows.first
    crew.numbers[7], crew.numbers[8] = rest, left
    done = ZERO
    for colour in range(LONE_ROWS if size >= MANY_ROWS else 0):
        end = done
        while end < size and now[end] < WIDE * first[colour + 1]:
            end += 1
        # Far rows may have a tile in common.
        mine, last = give(crew, PART, done, end, LEAST_ROWS if colour != FAR_ROWS else end + 1)
        part_listed(rows, k, v, shift, x, y, angle, c, s, rest, left, mine, last)
        collect(crew)
        done = end
    part_listed(rows, k, v, shift, x, y, angle, c, s, rest, left, done, size)


@inline
def in_order(rows: Rows, size: int) -> None:
    """Put the list in the order of the blocks, if it is long."""
    now, queued = rows.now, rows.queued
    if size < MANY_ROWS:
        return
    for j in range(size):
        queued[now[j]] = 3  # those that are in no contact have 1, too
    m = U(0)
    for q in range(U(WIDE * rows.first[COLOURS])):
        now[m] = q
        m += U(queued[q] >> 1)


@inline
def project(rows: Rows, k: Numbers, rest: float, v: Bodies, shift: Bodies, x: np.ndarray,
            y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, crew: Crew) -> bool:
    """Move apart what will overlap deeply in the middle of the next substep, after a time `rest`
    (s); returns whether there was anything.  c and s are those of the middle of this one.

    The velocity solve does not push apart what overlaps, so that it never adds energy; a
    solved scene does not need this.  Rows one by one, from the deep ones on to those of the
    tiles that they move; what is left after some passes is there again in the next substep.
    """
    r, body, first, now, queued = rows.field, rows.body, rows.first, rows.now, rows.queued
    begin, last = give(crew, DEEP, ZERO, first[COLOURS], LEAST_BLOCKS)
    find_deep(rows, k, begin, last)
    collect(crew)
    size = ZERO
    for block in range(first[COLOURS]):
        if rows.hits[block] == 0:
            continue
        o = U(block) * BLOCK
        for i in range(LANES):
            if r[o + HIT + i] != 0.0:
                now[size] = WIDE * block + int(i)
                queued[now[size]] = 1
                size += 1
    if size == 0:
        return False
    set_all(shift.vx, k.n + 1, 0.0)
    set_all(shift.vy, k.n + 1, 0.0)
    set_all(shift.w, k.n + 1, 0.0)
    some, left = 0, SLOP * k.width
    for p in range(PROJECTIONS + FURTHER):
        m = ZERO
        left = left if p < PROJECTIONS else DEEPER * SLOP * k.width
        part_all(rows, size, k, v, shift, x, y, angle, c, s, rest, left, crew)
        for j in range(size):
            q = now[j]
            queued[q] = 0
            if rows.changes[j] != 0.0:
                t = bodies_of(q)
                m = queue(rows, v, body[t], m)
                m = queue(rows, v, body[t + LANES], m)
        some += m
        copy(rows.then, now, m)
        size = m
        if m == 0 or (p + 1 >= PROJECTIONS and m > max(FEW_ROWS, first[COLOURS])):
            break
        in_order(rows, size)
    for j in range(size):
        queued[now[j]] = 0
    return some > 0
