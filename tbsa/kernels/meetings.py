"""When and where two bodies meet that both fly on, along their arcs.

A row tells of the corners that are nearest now, and how their gaps go.  What would close one of
these if it went straight may pass on its arc, and what turns fast may hit with other corners: time
goes on by as much as no corner surely needs to reach the face that keeps the bodies apart.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.geometry import (
    BLUNT,
    CIRCLE,
    circle_corner,
    corner_arm,
    cos_sin,
    square_square,
    wall_square,
)
from tbsa.kernels.hits import SAME, TOUCHING, Scratch
from tbsa.kernels.jit import U, inline, lane
from tbsa.kernels.rows import (
    BEND0,
    BEND1,
    GAP0,
    GAP1,
    HIT,
    K00,
    K11,
    LANES,
    VN0,
    VN1,
    WANT0,
    WANT1,
    WARM0,
    WARM1,
    Rows,
    bodies_of,
    lane_of,
    wall_code,
)

# Two points of a manifold whose gaps differ by less hit together.
FLUSH = 1e-6
# Error of a gap for each metre of where its tiles are: some units in the last place.
ROUNDING = 2e-15
# How a point that is about to hit meets the other body: what is more, holds.
ALONE, TOGETHER, LATER, SLOW = 0, 1, 2, 3
# Steps of the search for a meeting; the last few of them are as good as Newton's.
SEARCH = 60
# Where its steps would get ever shorter, they are no shorter than this part of the substep.
SOON = 2.0 / SEARCH


@inline
def safe(gap: float, rate: float, curve: float) -> float:
    """How long a gap surely stays open, or gets no less where it is closed (s): one of this rate
    (m/s), with a second derivative of no less than minus `curve`."""
    room = 2.0 * max(gap, 0.0)
    d = math.sqrt(rate * rate + curve * room)
    return room / (d - rate) if rate < 0.0 else (rate + d) / max(curve, 1e-300)


@inline
def until_touch(k: Numbers, dx: float, dy: float, ux: float, uy: float, face: float, spin: float,
                c: float, s: float, nx: float, ny: float, side: float, stopped: float,
                left: float, least: float, again: float) -> float:
    """How long no corner of a square surely reaches the face that keeps it apart (s; inf where none
    does in what is `left`).

    Corners that rest there are not waited for; one that is near and leaves, faster than `stopped`
    (m/s, negative), is looked at again `SOON`, by when it can be back by next to nothing; one that
    is there, no further than `least` (m), and has not hit, after a time `again`.

    From a to b the way is d, the relative velocity u, and the normal n; `side` is 1 where the face
    is a's and -1 where it is b's.  The face turns with `face`, the other square, now at c, s, with
    `spin` (rad/s).
    """
    half = 0.5 * k.width
    radius = math.sqrt(2.0) * half
    speed = math.sqrt(ux * ux + uy * uy)
    far = math.sqrt(dx * dx + dy * dy) + speed * k.h + radius
    curve = (face * face * far + 2.0 * abs(face) * (speed + radius * abs(spin))
             + spin * spin * radius)
    near, slow = TOUCHING * k.width, k.threshold + k.tolerance
    step, soon = math.inf, left
    for q in range(4):  # from the face's centre, in axes that turn with it
        rx, ry = corner_arm(q, half, c, s)
        px, py = side * dx + rx, side * dy + ry
        qx, qy = side * ux - spin * ry + face * py, side * uy + spin * rx - face * px
        gap, vn = side * (nx * px + ny * py) - half, side * (nx * qx + ny * qy)
        bend = side * (nx * (face * face * px - spin * spin * rx + 2.0 * face * qy)
                       + ny * (face * face * py - spin * spin * ry - 2.0 * face * qx))
        if ((gap > near or abs(vn) > slow or k.h * bend < -slow)
                and max(gap, 0.0) + soon * (vn - 0.5 * curve * soon) <= 0.0):  # sooner, perhaps
            ahead = safe(gap, vn, curve)
            ahead = max(ahead, SOON * k.h) if gap < near and vn > stopped else ahead
            step = min(step, max(ahead, again) if gap <= least else ahead)
            soon = min(soon, step)
    return step


@inline
def fast(k: Numbers, vn: float, gain: float, part: float) -> bool:
    """Whether a point, with `part` of its gain besides, hits: bounces slower than what forces give
    in a substep are not told from a contact."""
    return gain == 0.0 or vn + part * gain < -max(k.threshold, abs(gain))


@lane
def glances(k: Numbers, dx: float, dy: float, ca: float, sa: float, cb: float, sb: float,
            nx: float, ny: float, vn: float, vt: float, of_a: bool, slow: float) -> bool:
    """Whether a corner that meets a face only passes it: across a face of its own square the two
    are as good as apart, and do not come nearer there, or no faster than `slow`.

    What slides with a corner over the joint of two tiles, by rounding below their faces, comes at
    the second one's corner with the face beside.  `vn` and `vt` are velocities of b's point
    against a's, along the normal and a quarter turn from it.
    """
    half, blunt = 0.5 * k.width, BLUNT * k.width
    c, s = (cb if of_a else ca), (sb if of_a else sa)
    side = -1.0 if of_a else 1.0  # from the corner's square to that of the face
    reach = half * (1.0 + abs(ca * cb + sa * sb) + abs(ca * sb - sa * cb))
    ux, uy = side * (vn * nx - vt * ny), side * (vn * ny + vt * nx)
    away, aside = side * (c * dx + s * dy), side * (c * dy - s * dx)
    out, off = (c * ux + s * uy), (c * uy - s * ux)
    return bool((abs(away) - reach >= -blunt and (out if away >= 0.0 else -out) >= -slow)
                or (abs(aside) - reach >= -blunt and (off if aside >= 0.0 else -off) >= -slow))


@lane
def rocks_off(r: np.ndarray, i: int, k: Numbers, turn: float, time: float) -> float:
    """How fast a point of the row in lane i that was pressed may leave after a time (s) along its
    arc, and be in contact: by how its bodies turn (rad/s), but no faster than what it was pressed
    with gives (m/s)."""
    return float(min(turn * turn * k.width * (time + 0.5 * k.h),
                     r[i + K00] * r[i + WARM0] + r[i + K11] * r[i + WARM1]))


@lane
def meeting(rows: Rows, row: int, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray,
            y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, h: float,
            begin: float) -> Any:
    """When and where the bodies of a row that hits meet, both flying on; not before `begin` (s).

    The row tells of the face that is nearest now, going on at its present rates; here the bodies
    go along their arcs, and another face may come between.  Time goes on by as much as no corner
    surely needs to reach the face that keeps the bodies apart (conservative advancement, of
    second order), up to the meeting, or the end of the substep, of length `h` (s).  What is slower
    than the gain of a substep does not hit.  Returns ``(how, (time, n_x, n_y, an, bn, at, bt,
    of_a))``, time in s from now, and whether the face is one of a's; how: ALONE one point meets,
    TOGETHER two, or one and another that rests there, LATER nothing in this substep, SLOW nothing
    that the solve is not to stop.
    """
    r, body = rows.field, rows.body
    i, t = lane_of(row), bodies_of(row)
    a, b = U(body[t]), U(body[t + LANES])
    vx, vy, w, half = v.vx, v.vy, v.w, 0.5 * k.width
    wall, code = b == U(k.n), wall_code(r, i)
    ux, uy = vx[b] - vx[a], vy[b] - vy[a]
    radius = math.sqrt(2.0) * half
    fastest = math.sqrt(ux * ux + uy * uy) + radius * (abs(w[a]) + abs(w[b]))
    near, slow = TOUCHING * k.width, k.threshold + k.tolerance
    gx, gy, ga, gb = (z.gainx[b] - z.gainx[a], z.gainy[b] - z.gainy[a], z.gainw[a], z.gainw[b])
    an, bn, at, bt, of_a, how = 0.0, 0.0, 0.0, 0.0, False, LATER
    # Before its last impact a tile was elsewhere; and what that has stopped does not hit again.
    time, surmised = max(begin, max(z.since[a], z.since[b])), r[i + HIT] < 0.0
    stopped = -(slow + 1e-3 * fastest) if surmised else -1e-9 * fastest
    ca, sa = c[a], s[a]
    cb, sb = (1.0, 0.0) if wall else (c[b], s[b])
    for _ in range(SEARCH):
        part = time / h - 0.5
        if time * w[a] != 0.0:
            ca, sa = cos_sin(angle[a] + time * w[a])
        xa, ya = x[a] + time * vx[a], y[a] + time * vy[a]
        # As near as the places themselves are known.
        least = max(1e-12 * k.h * fastest, ROUNDING * (abs(xa) + abs(ya) + k.width))
        if wall and k.wall == CIRCLE:
            rx, ry = corner_arm(code, half, ca, sa)
            gap, nx, ny = circle_corner(xa + rx, ya + ry, k.wall_x)
            an, bn, at, bt = rx * ny - ry * nx, 0.0, rx * nx + ry * ny, 0.0
            vn = -nx * vx[a] - ny * vy[a] - an * w[a]
            if gap <= least and vn < stopped:
                if fast(k, vn, nx * gx + ny * gy - an * ga, part):
                    return ALONE, (time, nx, ny, an, bn, at, bt, of_a)
                how = SLOW
            step = safe(gap, vn, w[a] * w[a] * radius + 2.0 * fastest * fastest / k.wall_x)
            step = min(step, 0.25 * k.wall_x / fastest)
            time += max(step, SOON * k.h) if gap <= least else step
            if time > k.h:
                break
            continue
        if time * w[b] != 0.0:
            cb, sb = cos_sin(angle[b] + time * w[b])
        dx, dy = x[b] + time * vx[b] - xa, y[b] + time * vy[b] - ya
        if wall:
            dx, dy = wall_square(k, code, xa, ya)
        count, nx, ny, _, gap0, an0, bn0, _, gap1, an1, bn1, at, bt, _, of_a = square_square(
            dx, dy, ca, sa, cb, sb, k.width, k.width, wall)
        along = nx * ux + ny * uy
        vn0, vn1 = along + bn0 * w[b] - an0 * w[a], along + bn1 * w[b] - an1 * w[a]
        # What is found by another formula below has other rounding.
        first = gap0 <= 4.0 * least and vn0 < stopped
        second = gap1 <= 4.0 * least and vn1 < stopped
        there, gain = first or second, nx * gx + ny * gy
        first = first and fast(k, vn0, gain + bn0 * gb - an0 * ga, part)
        second = second and fast(k, vn1, gain + bn1 * gb - an1 * ga, part)
        if count != 0.0 and (first or second):
            an, bn = (an1, bn1) if second else (an0, bn0)
            other, vn = (gap0, vn0) if second else (gap1, vn1)
            # A corner that leaves is not in contact, though near yet and slower than a bounce; but
            # one that was pressed leaves along its arc as nothing has pressed it on the way.
            leaves = k.tolerance + (rocks_off(r, i, k, abs(w[a]) + abs(w[b]), time)
                                    if z.since[a] + z.since[b] == 0.0 else 0.0)
            if count == 2.0 and ((first and second) or abs(gap1 - gap0) < FLUSH * k.width
                                 or (other < near and -slow <= vn <= leaves)):
                return TOGETHER, (time, nx, ny, an, bn, at, bt, of_a)
            # What slides over a joint is borne up to there; while it passes by both corners, and
            # is blunt to them, forces bring it nearer, which is no approach.
            falls = 1.0 + BLUNT * k.width / (k.h * fastest)
            closing = (vn1 if second else vn0) - falls * (gain + bn * gb - an * ga)
            across = (nx * (uy - falls * gy) - ny * (ux - falls * gx)
                      + bt * (w[b] - falls * gb) - at * (w[a] - falls * ga))
            if wall or not glances(k, dx, dy, ca, sa, cb, sb, nx, ny, closing, across, of_a, slow):
                return ALONE, (time, nx, ny, an, bn, at, bt, of_a)
            time += BLUNT * k.width / fastest
            if time > k.h:
                break
            continue
        how = SLOW if there and count != 0.0 else how
        again = (SOON if there else SAME) * k.h
        time += until_touch(
            k, dx, dy, ux, uy, w[a] if of_a else w[b], w[b] if of_a else w[a],
            cb if of_a else ca, sb if of_a else sa, nx, ny, 1.0 if of_a else -1.0, stopped,
            k.h - time, least, again if count != 0.0 else BLUNT * k.width / fastest)
        if time > k.h:
            break
    return how, (time, nx, ny, an, bn, at, bt, of_a)


@inline
def fly_on(r: np.ndarray, i: int, h: float) -> None:
    """The row in lane i, that would hit if its tiles went straight, does not within h, as they
    turn: nothing is to slow it down before it does."""
    hit = r[i + HIT]
    if hit == 1.0 or hit == 3.0 or hit == -2.0:
        r[i + WANT0] = max(r[i + WANT0], -r[i + VN0])
        r[i + BEND0] = max(r[i + BEND0], -(r[i + GAP0] / h + r[i + VN0]) / h)
    if hit >= 2.0 or hit == -2.0:
        r[i + WANT1] = max(r[i + WANT1], -r[i + VN1])
        r[i + BEND1] = max(r[i + BEND1], -(r[i + GAP1] / h + r[i + VN1]) / h)
    r[i + HIT] = 0.0
