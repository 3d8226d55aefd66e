"""Contacts: where the tiles of every row touch, and what its points weigh.

A point is kept by its gap (m, negative where it overlaps), the normal from a to b, and the lever
arms of one common place about both centres.  The solve is told by ``want`` how fast it may
approach, and by the effective masses ``k`` what an impulse does there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.geometry import (
    BLUNT,
    CIRCLE,
    arc,
    bends,
    circle_corner,
    corner_arm,
    pair_gap,
    square_square,
    wall_square,
)
from tbsa.kernels.jit import U, inline, lane, rolled
from tbsa.kernels.rows import (
    AN0,
    AN1,
    AT,
    AW,
    AX,
    AY,
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
    CHUNK,
    COUNT,
    GAP0,
    GAP1,
    HIT,
    I00,
    I11,
    ID0,
    ID1,
    IDET,
    IDLE,
    ITT,
    K00,
    K01,
    K11,
    KTT,
    LANES,
    MA,
    MB,
    NEAR_ROWS,
    NX,
    NY,
    PN0,
    PN1,
    PT,
    VN0,
    VN1,
    WALLS,
    WANT0,
    WANT1,
    WANTT,
    WARM0,
    WARM1,
    WARMT,
    WIDE,
    E,
    Rows,
    bodies_of,
    lane_of,
    wall_code,
)

# A point is part of a manifold if it is nearer than it can close at its speed within the substep,
# and this fraction of the width, or as far as forces may bring it: they and impacts speed it up.
SPARE = 0.02
# Tiles that turn further than this in a substep together (rad) may meet with other corners than
# the nearest now: that is asked for (`meeting` in meetings.py), as for corners that pass each
# other.
SWEPT = 0.1
# So is what comes nearer by more than this (widths) as it goes along a sloping edge.
SLOPING = 1e-3
# What has been stopped by no more than this part of the tolerance was not pressed together.
GRAZED = 1e-3
# ... and what touches, and does not press, is given this, as a note that it has been in contact.
NOTED = 2.0 * GRAZED
# Nearer than this (widths), what gives nothing back and neither comes nor goes is in contact.
RESTS = 1e-5
# The solve leaves a point with this velocity alone (m/s): there is none.
NEVER = 1e30


@lane
def look_at(r: np.ndarray, body: np.ndarray, at: int, t: int, x: np.ndarray, y: np.ndarray,
            c: np.ndarray, s: np.ndarray, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """Places and velocities of the bodies of a pair, into its lane."""
    a, b = U(body[t]), U(body[t + LANES])
    r[at + K00], r[at + K01] = c[a], s[a]
    r[at + K11], r[at + KTT] = c[b], s[b]
    r[at + I00], r[at + I11] = x[b] - x[a], y[b] - y[a]
    r[at + AX], r[at + AY], r[at + AW] = vx[a], vy[a], w[a]
    r[at + BX], r[at + BY], r[at + BW] = vx[b], vy[b], w[b]


@lane
def look_at_side(r: np.ndarray, body: np.ndarray, at: int, t: int, k: Numbers, x: np.ndarray,
                 y: np.ndarray) -> None:
    """After `look_at`, of a row with a side of a rectangle: there stands a square."""
    a = U(body[t])
    r[at + I00], r[at + I11] = wall_square(k, wall_code(r, at), x[a], y[a])
    r[at + K11], r[at + KTT] = 1.0, 0.0


@inline
def look(rows: Rows, block: int, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
         vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """Places and velocities of the bodies of a block of pairs, into its lanes."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    for i in range(LANES):
        look_at(r, body, o + i, t + i, x, y, c, s, vx, vy, w)


@lane
def mirrored(bend: float, vn: float) -> float:
    """The bend (m/s, of a substep) that counts for a point whose velocity is vn.

    Where a contact lasts along a curve, its velocity is +bend as it comes and -bend as it goes,
    so that its impulse does no work.  Beyond vn that would be a push, or leave to come further
    than it will when an impact has taken the spin that the bend is from.
    """
    return max(min(bend, vn), 0.0) + min(max(bend, vn), 0.0)


@lane
def want(gap: float, bend: float) -> float:
    """How fast a point may approach for its gap just to close in the substep; all in m/s.

    Overlap is not pressed apart, but what the bend gives is taken for it first.
    """
    return max(gap + max(bend, 0.0), 0.0) + min(bend, 0.0)


@lane
def place_pair(r: np.ndarray, at: int, width: float, h: float, gain: float, wall: bool) -> float:
    """Where the pair in the lane at `at` touches, or a tile and a side of the `wall`; every point
    keeps its impulse, a new point has none.  Returns the number of its points."""
    per_h2, spare = 1.0 / (h * h), max(SPARE * width, gain)
    vx_ab, vy_ab = r[at + BX] - r[at + AX], r[at + BY] - r[at + AY]
    way = h * (math.sqrt(vx_ab * vx_ab + vy_ab * vy_ab)
               + 0.7072 * width * (abs(r[at + AW]) + abs(r[at + BW])))
    count, nx, ny, id0, gap0, an0, bn0, id1, gap1, an1, bn1, ta, tb, miss, of_a = square_square(
        r[at + I00], r[at + I11], r[at + K00], r[at + K01], r[at + K11],
        r[at + KTT], width, spare + way, wall)
    wa, wb = r[at + AW], r[at + BW]
    bend0, bend1, slide = bends(
        width, gap0, gap1, ta - tb, bn0 - an0, -bn0 if of_a else an0, -bn1 if of_a else an1,
        h * (nx * vx_ab + ny * vy_ab), h * (nx * vy_ab - ny * vx_ab), h * (wa if of_a else wb),
        h * (wb - wa if of_a else wa - wb))
    r[at + BEND0], r[at + BEND1] = per_h2 * bend0, per_h2 * bend1
    r[at + WANTT] = per_h2 * slide
    # As seen from a, which turns: what goes round with it stays where it is.
    mx, my = r[at + I00] + 0.5 * h * vx_ab, r[at + I11] + 0.5 * h * vy_ab
    ux, uy = vx_ab + wa * my, vy_ab - wa * mx
    past = max(abs(ux), abs(uy)) + 0.7072 * width * abs(wb - wa)
    swept = ((count > 0.5) & (min(gap0, gap1) < way) & (h * (abs(wa) + abs(wb)) > SWEPT)
             & (h * past > 0.7072 * SWEPT * width))
    # At the end of a face an edge slopes on to a corner beside it, that comes to lie over it;
    # what is near is left to the solve, in which that changes little.
    ca, sa, cb, sb = r[at + K00], r[at + K01], r[at + K11], r[at + KTT]
    cos, sin = abs(ca * cb + sa * sb), abs(ca * sb - sa * cb)
    deeper = min(cos, sin) / max(cos, sin) * abs(
        h * (nx * vy_ab - ny * vx_ab + tb * wb - ta * wa))
    along = h * (nx * vx_ab + ny * vy_ab)
    ends0 = (abs(an0 if of_a else bn0) > 0.4999 * width) & (not wall)
    ends1 = (abs(an1 if of_a else bn1) > 0.4999 * width) & (not wall)
    below = ((ends0 & (gap0 + along + h * (bn0 * wb - an0 * wa) < deeper))
             | (ends1 & (gap1 + along + h * (bn1 * wb - an1 * wa) < deeper)))
    swept |= ((count > 0.5) & (min(gap0, gap1) > SPARE * width)
              & (deeper > SLOPING * width) & below)
    swept |= (miss > 0.0) & (miss < way)
    # A corner that comes to the end of a face may have left it when the gap would close.
    leaves = (count > 0.5) & (miss > -way) & (min(gap0, gap1) < way)
    r[at + HIT] = 1.0 if swept else (2.0 if leaves else 0.0)
    count = 0.0 if r[at + MA] + r[at + MB] == 0.0 else count  # an empty lane
    id1 = -1.0 if count < 1.5 else id1
    was0, was1, q0, q1 = r[at + ID0], r[at + ID1], r[at + PN0], r[at + PN1]
    p0 = q0 if id0 == was0 else (q1 if id0 == was1 else 0.0)
    p1 = q1 if id1 == was1 else (q0 if id1 == was0 else 0.0)
    p0 = 0.0 if count == 0.0 else p0
    p1 = 0.0 if count < 1.5 else p1
    pt = 0.0 if (p0 == 0.0) & (p1 == 0.0) else r[at + PT]
    r[at + COUNT], r[at + NX], r[at + NY] = count, nx, ny
    r[at + ID0], r[at + GAP0] = id0, gap0
    r[at + AN0], r[at + BN0] = an0, bn0
    r[at + ID1], r[at + GAP1] = id1, gap1
    r[at + AN1], r[at + BN1] = an1, bn1
    r[at + AT], r[at + BT] = ta, tb
    r[at + PN0], r[at + PN1], r[at + PT] = p0, p1, pt
    r[at + WARM0], r[at + WARM1], r[at + WARMT] = p0, p1, pt
    return count


@rolled
def place_pairs(rows: Rows, block: int, width: float, h: float, gain: float, wall: bool) -> None:
    """Where the pairs of a block touch, or tiles and sides of the `wall`."""
    r, o = rows.field, U(block) * BLOCK
    lone, some = 0, 0
    for i in range(LANES):
        count = place_pair(r, o + i, width, h, gain, wall)
        lone += 1 if count == 1.0 else 0
        some += 1 if (count != 0.0) | (r[o + HIT + i] != 0.0) else 0
    rows.single[block] = lone if some > 0 else IDLE


@rolled
def out_of_reach(rows: Rows, block: int, width: float, h: float, gain: float) -> bool:
    """Whether no pair of a block touches or may hit: each is too far apart, or its corners pass
    each other.  `place_pairs` would find the same, with more work."""
    r, spare = rows.field, max(SPARE * width, gain)
    o = U(block) * BLOCK
    some = 0
    for i in range(LANES):
        vx_ab, vy_ab = r[o + BX + i] - r[o + AX + i], r[o + BY + i] - r[o + AY + i]
        way = h * (math.sqrt(vx_ab * vx_ab + vy_ab * vy_ab)
                   + 0.7072 * width * (abs(r[o + AW + i]) + abs(r[o + BW + i])))
        gap, aside = pair_gap(r[o + I00 + i], r[o + I11 + i], r[o + K00 + i], r[o + K01 + i],
                              r[o + K11 + i], r[o + KTT + i], 0.5 * width)
        apart = (gap > spare + way) | (aside > way - BLUNT * width)
        empty = r[o + MA + i] + r[o + MB + i] == 0.0
        some += 0 if apart | empty else 1
        r[o + GAP0 + i] = r[o + GAP1 + i] = gap
    return some == 0


@inline
def leave_out(rows: Rows, block: int) -> None:
    """No row of this block is in contact."""
    r, o = rows.field, U(block) * BLOCK
    for i in range(LANES):
        r[o + COUNT + i] = r[o + HIT + i] = r[o + PN0 + i] = r[o + PN1 + i] = r[o + PT + i] = 0.0
        r[o + WARM0 + i] = r[o + WARM1 + i] = r[o + WARMT + i] = 0.0
    rows.single[block] = IDLE


@inline
def put_aside(rows: Rows, block: int) -> None:
    """What `weigh_block` says of a block in which nothing touches or may hit."""
    queued, first = rows.queued, U(block) * LANES
    rows.hits[block] = rows.live[block] = 0
    for i in range(LANES):
        queued[first + i] = 1


@lane
def place_corner(r: np.ndarray, at: int, a: int, k: Numbers, gain: float, x: np.ndarray,
                 y: np.ndarray, c: np.ndarray, s: np.ndarray, v: Bodies) -> None:
    """Where a corner of tile a touches a round wall, into its lane."""
    vx, vy, w, h = v.vx, v.vy, v.w, k.h
    spare = max(SPARE * k.width, gain)
    rx, ry = corner_arm(wall_code(r, at), 0.5 * k.width, c[a], s[a])
    gap, nx, ny = circle_corner(x[a] + rx, y[a] + ry, k.wall_x)
    margin = spare + h * (math.sqrt(vx[a] * vx[a] + vy[a] * vy[a])
                          + 0.7072 * k.width * abs(w[a]))
    count = 1.0 if gap <= margin else 0.0
    swept = (gap < margin - spare) & (h * abs(w[a]) > SWEPT)
    r[at + HIT] = 1.0 if swept else 0.0
    r[at + COUNT], r[at + NX], r[at + NY] = count, nx, ny
    r[at + GAP0], r[at + GAP1] = gap, gap
    r[at + AN0], r[at + BN0] = rx * ny - ry * nx, 0.0
    r[at + AN1], r[at + BN1] = r[at + AN0], 0.0
    r[at + AT], r[at + BT] = rx * nx + ry * ny, 0.0
    up, over = arc(h * w[a])
    fx, fy = h * (vx[a] - w[a] * ry), h * (vy[a] + w[a] * rx)
    arcx, arcy = over * ry - up * rx, -over * rx - up * ry
    later, _, _ = circle_corner(x[a] + rx + fx + arcx, y[a] + ry + fy + arcy, k.wall_x)
    r[at + BEND0] = r[at + BEND1] = (later - gap + nx * fx + ny * fy) / (h * h)
    r[at + WANTT] = (ny * arcx - nx * arcy) / (h * h)
    r[at + PN0] *= count
    r[at + PT] *= count if r[at + PN0] != 0.0 else 0.0
    r[at + WARM0], r[at + WARM1], r[at + WARMT] = r[at + PN0], 0.0, r[at + PT]
    r[at + AX], r[at + AY], r[at + AW] = vx[a], vy[a], w[a]


@inline
def place_walls(rows: Rows, block: int, k: Numbers, gain: float, x: np.ndarray, y: np.ndarray,
                c: np.ndarray, s: np.ndarray, v: Bodies) -> None:
    """Where the corners of a block touch a round wall."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    rows.single[block] = WIDE
    for i in range(LANES):
        a = U(body[t + i])
        r[o + HIT + i] = 0.0
        if a != U(k.n):
            place_corner(r, o + i, a, k, gain, x, y, c, s, v)


@inline
def place_block(rows: Rows, block: int, k: Numbers, gain: float, x: np.ndarray, y: np.ndarray,
                c: np.ndarray, s: np.ndarray, v: Bodies) -> None:
    """Where the rows of any one block touch now."""
    r, body, o, t = rows.field, rows.body, U(block) * BLOCK, U(block) * BODIES
    wall = body[t + LANES] == k.n
    if wall and k.wall == CIRCLE:
        place_walls(rows, block, k, gain, x, y, c, s, v)
        return
    look(rows, block, x, y, c, s, v.vx, v.vy, v.w)
    if wall:
        for i in range(LANES):
            look_at_side(r, body, o + i, t + i, k, x, y)
    place_pairs(rows, block, k.width, k.h, gain, wall)


@lane
def place_row(rows: Rows, row: int, k: Numbers, gain: float, x: np.ndarray, y: np.ndarray,
              c: np.ndarray, s: np.ndarray, v: Bodies) -> None:
    """Where one row touches now."""
    r, body = rows.field, rows.body
    at, t = lane_of(row), bodies_of(row)
    wall = body[t + LANES] == k.n
    if wall and k.wall == CIRCLE:
        place_corner(r, at, U(body[t]), k, gain, x, y, c, s, v)
        return
    look_at(r, body, at, t, x, y, c, s, v.vx, v.vy, v.w)
    if wall:
        look_at_side(r, body, at, t, k, x, y)
    place_pair(r, at, k.width, k.h, gain, wall)


@lane
def weigh(r: np.ndarray, at: int, h: float, per_mass: float, threshold: float, tolerance: float,
          near: float, gain: float) -> Any:
    """Effective masses of the row in the lane at `at`, and what closes.

    Returns whether a point may hit, and whether the row is live.

    k00, k11: velocity change of a point for a unit impulse there; k01: ... at the other point,
    or in a row of one point by a unit of friction; ktt: the same for friction; i: inverses, and
    idet that of the 2 x 2 problem, not a number where it has none.  `per_mass` is m/I.  A point
    may hit if it comes within `gain` (m), what forces add to its way, of closing within h, faster
    than the threshold, and has not been in contact: points that are pressed together approach by
    what the last solve left, and leave it to the next.  What was let go on to hit may have got an
    impulse of rounding.

    A row is live if one of its points has an impulse, or may close within h, forces and all, or
    gives nothing back and may rest there, nearer than `near` (m), so that it is to get one (`hold`
    in projection.py): where none is, a solve changes nothing.
    """
    per_h, least = 1.0 / h, GRAZED * tolerance
    slow = threshold + tolerance + per_h * gain
    ma, mb = r[at + MA], r[at + MB]
    an0, bn0, an1, bn1 = r[at + AN0], r[at + BN0], r[at + AN1], r[at + BN1]
    ta, tb, count = r[at + AT], r[at + BT], r[at + COUNT]
    wa, wb, nx, ny = r[at + AW], r[at + BW], r[at + NX], r[at + NY]
    linear, ia, ib = ma + mb, per_mass * ma, per_mass * mb
    k00 = linear + ia * an0 * an0 + ib * bn0 * bn0
    k11 = linear + ia * an1 * an1 + ib * bn1 * bn1
    ktt = linear + ia * ta * ta + ib * tb * tb
    one, two = count == 1.0, count == 2.0  # neither: a row that is not in contact
    an, bn = (ta if one else an1), (tb if one else bn1)
    k01 = (0.0 if one else linear) + ia * an0 * an + ib * bn0 * bn
    both = k00 * (ktt if one else k11)
    det = both - k01 * k01
    r[at + K00], r[at + K01], r[at + K11], r[at + KTT] = k00, k01, k11, ktt
    r[at + I00] = 1.0 / k00 if k00 > 0.0 else 0.0
    r[at + I11] = 1.0 / k11 if k11 > 0.0 else 0.0
    r[at + ITT] = 1.0 / ktt if ktt > 0.0 else 0.0
    r[at + IDET] = 1.0 / det if det > 1e-9 * both else np.nan
    along = (nx * (r[at + BX] - r[at + AX]) + ny * (r[at + BY] - r[at + AY]))
    vn0, vn1 = along + bn0 * wb - an0 * wa, along + bn1 * wb - an1 * wa
    r[at + VN0], r[at + VN1] = vn0, vn1
    gap0, gap1 = r[at + GAP0], r[at + GAP1]
    none = count == 0.0
    arc0, arc1 = h * r[at + BEND0], h * r[at + BEND1]
    bend0, bend1 = mirrored(arc0, vn0), mirrored(arc1, vn1)
    r[at + BEND0], r[at + BEND1] = per_h * bend0, per_h * bend1
    r[at + WANT0] = NEVER if none else want(per_h * gap0, bend0)
    r[at + WANT1] = NEVER if none else want(per_h * gap1, bend1)
    vt = (nx * (r[at + BY] - r[at + AY]) - ny * (r[at + BX] - r[at + AX])
          + tb * wb - ta * wa)
    # Of two points one that bears alone.  What lies flat on another does not swing on it, but turns
    # with it as one: along chords they slide by (spin h)^3 / 6 of their distance.
    swings = one | (two & ((r[at + WARM0] > 0.0) != (r[at + WARM1] > 0.0)))
    spin = max(min(wa, wb), 0.0) + min(max(wa, wb), 0.0)
    slides = spin * spin * spin * h * h * (ta - tb) * (1.0 / 6.0)
    r[at + WANTT] = mirrored(h * r[at + WANTT], vt) if swings else slides if two else 0.0
    closes0 = (count > 0.5) & (gap0 + h * (vn0 + bend0) <= gain)
    closes1 = two & (gap1 + h * (vn1 + bend1) <= gain)
    pressed = (r[at + WARM0] > 0.0) | (r[at + WARM1] > 0.0)
    rests = (r[at + E] == 0.0) & (count > 0.5) & (
        ((gap0 < near) & (abs(vn0) < slow)) | (two & (gap1 < near) & (abs(vn1) < slow)))
    # What leaves now may come back within h, along its arc.
    back0 = ((count > 0.5) & (vn0 > 0.0) & (gap0 + h * (vn0 + arc0) <= 0.0)
             & (vn0 + 2.0 * arc0 < -threshold))
    back1 = (two & (vn1 > 0.0) & (gap1 + h * (vn1 + arc1) <= 0.0)
             & (vn1 + 2.0 * arc1 < -threshold))
    bounces = r[at + E] > 0.0
    hit0 = ((closes0 & (vn0 < -threshold)) | (back0 & bounces)) & (k00 * r[at + WARM0] <= least)
    hit1 = ((closes1 & (vn1 < -threshold)) | (back1 & bounces)) & (k11 * r[at + WARM1] <= least)
    perhaps = ((r[at + HIT] != 0.0) & (k00 * r[at + WARM0] <= least)
               & (k11 * r[at + WARM1] <= least))
    hit = (1.0 if hit0 else 0.0) + (2.0 if hit1 else 0.0)
    r[at + HIT] = -r[at + HIT] if perhaps & (hit == 0.0) else hit
    return perhaps | hit0 | hit1, closes0 | closes1 | pressed | rests


@lane
def never_queue(rows: Rows, block: int) -> None:
    """What is not in contact is never on the list of a pass."""
    r, o, queued, first = rows.field, U(block) * BLOCK, rows.queued, U(block) * LANES
    for i in range(LANES):
        queued[first + i] = 1 if r[o + COUNT + i] == 0.0 else 0


@rolled
def weigh_block(rows: Rows, block: int, h: float, per_mass: float, threshold: float,
                tolerance: float, near: float, gain: float) -> int:
    """`weigh` the rows of a block; returns how many may hit."""
    r, o = rows.field, U(block) * BLOCK
    some, live = 0, 0
    for i in range(LANES):
        hits, lives = weigh(r, o + i, h, per_mass, threshold, tolerance, near, gain)
        some += 1 if hits else 0
        live += 1 if lives else 0
    rows.hits[block], rows.live[block] = some, live
    never_queue(rows, block)
    return some


@rolled
def any_deeper(r: np.ndarray, o: int, deepest: float) -> bool:
    """Whether a row of the block at `o` is in contact, and deeper than this gap (m)."""
    some = 0
    for i in range(LANES):
        deeper = (r[o + GAP0 + i] < deepest) | (r[o + GAP1 + i] < deepest)
        some += 1 if deeper & (r[o + COUNT + i] != 0.0) else 0
    return some > 0


@lane
def deepest_gap(rows: Rows, block: int, deepest: float) -> float:
    """The least gap (m, < 0 where there is overlap) of the rows of a block that are in contact, or
    this one where none is less, as in most blocks."""
    r, o = rows.field, U(block) * BLOCK
    if any_deeper(r, o, deepest):
        for i in range(LANES):
            gap = min(r[o + GAP0 + i], r[o + GAP1 + i])
            deepest = min(deepest, gap if r[o + COUNT + i] != 0.0 else 0.0)
    return deepest


@inline
def place_rows(rows: Rows, k: Numbers, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
               v: Bodies, gain: float, begin: int, last: int) -> Any:
    """Where the rows of these blocks touch now, and what they weigh: `place_block` and
    `weigh_block`.

    CHUNK blocks at a time: they stay in the first-level cache from one loop to the next, and what
    `look` has written is not read before it has got there.  Returns the number of points that may
    hit, and the deepest overlap (m).
    """
    struck, deepest, per_mass = 0, 0.0, k.per_mass
    far, pairs = rows.first[NEAR_ROWS], rows.first[WALLS]
    far = far if far > 1 else 0  # a single block takes as long to ask as it saves
    vx, vy, w = v.vx, v.vy, v.w
    for start in range(begin, last, CHUNK):
        end = min(start + CHUNK, last)
        if end <= pairs:
            for block in range(start, end):
                look(rows, block, x, y, c, s, vx, vy, w)
            for block in range(start, end):
                if block < far and out_of_reach(rows, block, k.width, k.h, gain):
                    leave_out(rows, block)
                else:
                    place_pairs(rows, block, k.width, k.h, gain, False)
        else:
            for block in range(start, end):
                place_block(rows, block, k, gain, x, y, c, s, v)
        for block in range(start, end):
            if rows.single[block] == IDLE:
                put_aside(rows, block)
                continue
            struck += weigh_block(rows, block, k.h, per_mass, k.threshold, k.tolerance,
                                  RESTS * k.width, gain)
            deepest = deepest_gap(rows, block, deepest)
    return struck, -deepest
