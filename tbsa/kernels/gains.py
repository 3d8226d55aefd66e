"""What forces, floor, and the walls and held tiles that bear it give a tile in the substep in which
it hits.

Impacts are those of the velocities that tiles have when they meet.  So each gets its gain of the
substep before (`draw`), to go the way that it would go without the impact; when it hits, it has the
part of the gain that goes with that time (`share`).  After an impact the gain is another one
(`redraw`).  In the end all gains are taken back, as the contact solve gives them again.

What lies on tiles that move gains what forces and its contacts gave it in the last substep, with
all that it hangs together with (`draw_along`); what an impact parts has that up to then
(`part_from`).  Where that tells nothing, it has no gain of forces.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.contacts import GRAZED, NEVER
from tbsa.kernels.floor import NONE, floor_impulse, friction_of
from tbsa.kernels.hits import (
    ALONG,
    NOWHERE,
    SPLIT,
    Loads,
    Scratch,
    approach,
    corner_speed,
    leave,
    pair_speed,
)
from tbsa.kernels.jit import U, apart, inline, lane
from tbsa.kernels.rows import (
    AN0,
    AN1,
    AT,
    BEND0,
    BEND1,
    BN0,
    BN1,
    BT,
    COUNT,
    GAP0,
    GAP1,
    K00,
    K11,
    LANES,
    NX,
    NY,
    PN0,
    PN1,
    PT,
    WANT0,
    WANT1,
    WARM0,
    WARM1,
    WARMT,
    Rows,
    bodies_of,
    lane_of,
)
from tbsa.kernels.sweeps import solve_row

# What was pressed comes off if it goes faster than this part of the fastest corner of its tiles, as
# one is seen from the other.
OFF = 0.01
# What was pressed hits if it comes faster than this part of that, and than a solve leaves it.
PARTED = 0.05
# Contacts give what they gave if this does not part what was pressed by more than this part of it.
CHANGED = 0.1
# What bears a tile is found up to this part of what forces give it in the substep.
BORNE = 1e-3


@inline
def stays_on(r: np.ndarray, at: int, v: Bodies, a: int, b: int, slow: float) -> bool:
    """Whether a point of a row of bodies a and b that was pressed does not come off, faster than
    `slow` (m/s)."""
    vn0, vn1 = approach(r, at, v, a, b)
    return bool((r[at + WARM0] > 0.0 and vn0 <= slow) or (r[at + WARM1] > 0.0 and vn1 <= slow))


@lane
def lies_on(rows: Rows, k: Numbers, v: Bodies, tile: int, slow: float, part: float) -> Any:
    """Whether a tile was pressed against one that moves, and does not come off it, faster than
    `slow` (m/s) and `part` of the fastest that one of them sees of the other; and whether it was
    against a wall or a held one."""
    r, body, mobile, held = rows.field, rows.body, v.mobile, False
    for p in range(rows.start[tile], rows.start[tile + 1]):
        at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
        a, b = U(body[t]), U(body[t + LANES])
        if r[at + WARM0] + r[at + WARM1] == 0.0:
            continue
        if mobile[a] * mobile[b] == 0.0:
            held = True
        elif stays_on(r, at, v, a, b, slow + part * pair_speed(k, v, a, b)):
            return True, held
    return False, held


@inline
def bears(warm: float, stopped: float, gap: float, vn: float, slow: float, k: Numbers) -> bool:
    """Whether a point bears what presses there: it did (`stopped`: how much, m/s), or touches.

    Not if it comes faster than `slow` (m/s), or as what hits does: its speed is for the impact.
    """
    little = GRAZED * k.tolerance
    return (vn >= -(slow if stopped > little else k.threshold + little)
            and (warm > 0.0 or gap < NOWHERE * k.width))


@lane
def comes_off(k: Numbers, threshold: float, fastest: float) -> float:
    """How fast a pressed point may come (m/s) and still be borne, if no corner of its tiles is
    faster than `fastest`, one as seen from the other: as fast as a solve leaves it."""
    return max(threshold + k.tolerance, PARTED * fastest)


@lane
def bear(rows: Rows, k: Numbers, v: Bodies, i: int, vx: float, vy: float, w: float, slow: float,
         least: float) -> None:
    """Let walls and held tiles bear tile i as they did in the substep before: as the contact solve,
    of this tile alone, to `least` (m/s).  It has gone with vx, vy, w, and what comes faster than
    `slow` (m/s) is not borne."""
    r, body, mobile = rows.field, rows.body, v.mobile
    for number in range(k.passes):
        most = 0.0
        for p in range(rows.start[i], rows.start[i + 1]):
            at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
            of_a = body[t] == i
            side = -1.0 if of_a else 1.0
            along = side * (r[at + NX] * vx + r[at + NY] * vy)
            vn0 = along + side * w * (r[at + AN0] if of_a else r[at + BN0])
            vn1 = along + side * w * (r[at + AN1] if of_a else r[at + BN1])
            first = bears(r[at + WARM0], r[at + K00] * r[at + WARM0], r[at + GAP0], vn0, slow, k)
            second = bears(r[at + WARM1], r[at + K11] * r[at + WARM1], r[at + GAP1], vn1, slow, k)
            if (r[at + COUNT] == 0.0 or mobile[body[t]] * mobile[body[t + LANES]] != 0.0
                    or not (first or second)):
                continue
            if number == 0:
                r[at + PN0] = r[at + PN1] = r[at + PT] = 0.0
            want0, want1 = r[at + WANT0], r[at + WANT1]
            r[at + WANT0], r[at + WANT1] = want0 if first else NEVER, want1 if second else NEVER
            most = max(most, solve_row(rows, rows.of[p], k.per_mass, v))
            r[at + WANT0], r[at + WANT1] = want0, want1
        if most <= least:
            break
    for p in range(rows.start[i], rows.start[i + 1]):
        at = lane_of(rows.of[p])
        r[at + PN0], r[at + PN1], r[at + PT] = r[at + WARM0], r[at + WARM1], r[at + WARMT]


@inline
def load(rows: Rows, k: Numbers, loads: Loads, v: Bodies, i: int, slow: float,
         part: float) -> bool:
    """Give tile i what forces and what bears it give it in the substep.

    Nothing, if it lies on a tile that moves, and does not come off it (see `lies_on`): what the two
    bear is not known from one of them.  Returns whether that is so.
    """
    ux, uy, uw = (loads.h * k.im * loads.fx[i], loads.h * k.im * loads.fy[i],
                  loads.h * k.ii * loads.torque[i])
    most = math.sqrt(ux * ux + uy * uy) + 0.7072 * k.width * abs(uw)
    if loads.gain == 0.0:
        return False
    among, held = lies_on(rows, k, v, i, slow, part)
    if among:
        return True
    vx, vy, w = v.vx[i], v.vy[i], v.w[i]
    borne = comes_off(k, k.threshold, corner_speed(k, v, i))
    v.vx[i], v.vy[i], v.w[i] = vx + ux, vy + uy, w + uw
    if held and most > 0.0:
        bear(rows, k, v, i, vx, vy, w, borne, BORNE * most)
    return False


@lane
def given(r: np.ndarray, at: int, of_a: bool) -> Any:
    """What a row gave its first body, or its second, in the last substep (N s, N s, N m s)."""
    p0, p1, pt, side = r[at + WARM0], r[at + WARM1], r[at + WARMT], -1.0 if of_a else 1.0
    pn = p0 + p1
    return (side * (r[at + NX] * pn - r[at + NY] * pt), side * (r[at + NY] * pn + r[at + NX] * pt),
            side * ((r[at + AN0] if of_a else r[at + BN0]) * p0
                    + (r[at + AN1] if of_a else r[at + BN1]) * p1
                    + (r[at + AT] if of_a else r[at + BT]) * pt))


@lane
def pushed(rows: Rows, q: int, i: int, k: Numbers, loads: Loads, v: Bodies, z: Scratch) -> Any:
    """How forces, and its contacts as in the last substep, speed body i up (m/s^2, rad/s^2): all
    but row q, and but what an impact has parted."""
    r, body, px, py, pw = rows.field, rows.body, 0.0, 0.0, 0.0
    if v.mobile[i] == 0.0:
        return 0.0, 0.0, 0.0
    for p in range(rows.start[i], rows.start[i + 1]):
        other = rows.of[p]
        at, t = lane_of(other), bodies_of(other)
        if (other == q or r[at + WARM0] + r[at + WARM1] == 0.0
                or z.points[other] & SPLIT != 0):
            continue
        dx, dy, dw = given(r, at, body[t] == i)
        px, py, pw = px + dx, py + dy, pw + dw
    h = loads.h
    return (k.im * (loads.fx[i] + px / h), k.im * (loads.fy[i] + py / h),
            k.ii * (loads.torque[i] + pw / h))


@lane
def brake(k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray, s: np.ndarray, i: int,
          vx: float, vy: float, w: float) -> None:
    """Let the floor brake tile i, which had these velocities before its loads, and note what it
    has gained."""
    h, floor, im, ii, tx, ty, tw = loads.h, loads.floor, k.im, k.ii, v.vx[i], v.vy[i], v.w[i]
    if floor.law != NONE:
        px, py, pt, stops, halts = floor_impulse(
            floor.law, vx, vy, w, tx, ty, tw, 1.0 / im, 1.0 / ii, floor.force * h,
            floor.torque * h, c[i], s[i])
        tx, ty = (0.0 if stops else tx + im * px), (0.0 if stops else ty + im * py)
        tw = 0.0 if halts else tw + ii * pt
    z.gainx[i], z.gainy[i], z.gainw[i] = tx - vx, ty - vy, tw - w
    v.vx[i], v.vy[i], v.w[i] = tx, ty, tw


@lane
def pull(z: Scratch, i: int) -> None:
    """Put tile i on the list of those that have drawn their gains."""
    z.drawn[i] = 1
    z.pulled[z.size[2]] = i
    z.size[2] += 1


@lane
def draw(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray,
         s: np.ndarray, i: int) -> None:
    """Give tile i, once, what forces, floor and what bears it give it in the substep if it meets
    nothing."""
    if v.mobile[i] == 0.0 or z.drawn[i] != 0:
        return
    vx, vy, w = v.vx[i], v.vy[i], v.w[i]
    pull(z, i)
    z.leans[i] = 1 if load(rows, k, loads, v, i, math.inf, 0.0) else 0
    if z.leans[i] != 0 and loads.told:
        draw_along(rows, k, loads, v, z, c, s)
    else:
        brake(k, loads, v, z, c, s, i, vx, vy, w)


@apart
def draw_along(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray,
               s: np.ndarray) -> None:
    """Give the last tile on the list what forces and contacts gave it in the last substep, and all
    that hangs together with it through what was pressed, or they would come at each other.

    Nothing but what the floor takes, if that would not keep them together: loads or contacts are
    others than they were.
    """
    r, body, first, j = rows.field, rows.body, z.size[2] - 1, z.size[2] - 1
    while j < z.size[2]:
        i = z.pulled[j]
        j += 1
        vx, vy, w = v.vx[i], v.vy[i], v.w[i]
        z.leans[i] = ALONG
        ax, ay, aw = pushed(rows, -1, i, k, loads, v, z)
        z.alongx[i], z.alongy[i], z.alongw[i] = loads.h * ax, loads.h * ay, loads.h * aw
        v.vx[i], v.vy[i], v.w[i] = vx + z.alongx[i], vy + z.alongy[i], w + z.alongw[i]
        brake(k, loads, v, z, c, s, i, vx, vy, w)
        for p in range(rows.start[i], rows.start[i + 1]):
            at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
            other = body[t + LANES] if body[t] == i else body[t]
            if (v.mobile[other] != 0.0 and z.drawn[other] == 0
                    and r[at + WARM0] + r[at + WARM1] > 0.0):
                pull(z, other)
    if stay_close(rows, k, loads, v, z, first):
        return
    for j in range(first, z.size[2]):
        i = z.pulled[j]
        share(v, z, i, -1.0)
        z.leans[i] = 1
        brake(k, loads, v, z, c, s, i, v.vx[i], v.vy[i], v.w[i])


@inline
def stay_close(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, first: int) -> bool:
    """Whether what was pressed, between tiles on the list from `first` on, stays as close as it is
    with what they gain, but for the curve of their ways."""
    r, body = rows.field, rows.body
    for j in range(first, z.size[2]):
        i = z.pulled[j]
        for p in range(rows.start[i], rows.start[i + 1]):
            at, t = lane_of(rows.of[p]), bodies_of(rows.of[p])
            a, b = U(body[t]), U(body[t + LANES])
            if a != i or v.mobile[b] == 0.0:
                continue
            along = r[at + NX] * (z.gainx[b] - z.gainx[a]) + r[at + NY] * (z.gainy[b] - z.gainy[a])
            off0 = abs(along + r[at + BN0] * z.gainw[b] - r[at + AN0] * z.gainw[a])
            off1 = abs(along + r[at + BN1] * z.gainw[b] - r[at + AN1] * z.gainw[a])
            most = 2.0 * k.tolerance + CHANGED * (r[at + K00] * r[at + WARM0]
                                                  + r[at + K11] * r[at + WARM1])
            if ((r[at + WARM0] > 0.0 and off0 > most + 2.0 * loads.h * abs(r[at + BEND0]))
                    or (r[at + WARM1] > 0.0 and off1 > most + 2.0 * loads.h * abs(r[at + BEND1]))):
                return False
    return True


@inline
def part_from(rows: Rows, k: Numbers, v: Bodies, z: Scratch, i: int, part: float) -> None:
    """Take off the gains of tile i what contacts gave it that an impact has parted, and off those
    of the tiles there: up to now they have had their share of it.

    Tiles that the impact has not reached (``in_it``) have had this `part` of it, besides.
    """
    r, body = rows.field, rows.body
    for p in range(rows.start[i], rows.start[i + 1]):
        q = rows.of[p]
        at, t = lane_of(q), bodies_of(q)
        a, b = U(body[t]), U(body[t + LANES])
        both = ((v.mobile[a] == 0.0 or z.leans[a] == ALONG)  # taken from one alone it would
                and (v.mobile[b] == 0.0 or z.leans[b] == ALONG))  # change the momentum
        bore = r[at + K00] * r[at + WARM0] + r[at + K11] * r[at + WARM1]
        if (not both or bore == 0.0 or z.points[q] & SPLIT != 0
                or stays_on(r, at, v, a, b, bore + OFF * pair_speed(k, v, a, b))):
            continue  # what leaves slower is back in this substep
        leave(z, q, SPLIT)
        for tile in (a, b):
            if v.mobile[tile] == 0.0:
                continue
            px, py, pw = given(r, at, tile == a)
            gx, gy, gw = k.im * px, k.im * py, k.ii * pw
            z.alongx[tile] -= gx
            z.alongy[tile] -= gy
            z.alongw[tile] -= gw
            if z.in_it[tile] == 0:
                z.gainx[tile] -= gx
                z.gainy[tile] -= gy
                z.gainw[tile] -= gw
                v.vx[tile] += part * gx
                v.vy[tile] += part * gy
                v.w[tile] += part * gw


@inline
def redraw(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray,
           s: np.ndarray, i: int, part: float) -> None:
    """The gain of tile i as it goes after an impact, of which it then has this `part` besides:
    friction with the floor is against its new way, and what bore it may have come off.

    What lay on tiles that move, and comes off, without a part of what forces give it, is owed
    the whole of it: to take a part from it alone would change the momentum of all.
    """
    h, floor, im, ii, vx, vy, w = loads.h, loads.floor, k.im, k.ii, v.vx[i], v.vy[i], v.w[i]
    if v.mobile[i] == 0.0 or loads.gain == 0.0:  # without forces and floor there is none
        return
    px, py, pt = 0.0, 0.0, 0.0
    if floor.law != NONE:
        px, py, pt = friction_of(floor.law, vx, vy, w, 1.0 / im, 1.0 / ii, floor.force * h,
                                 floor.torque * h, c[i], s[i])
    if z.leans[i] == ALONG:
        z.gainx[i], z.gainy[i], z.gainw[i] = (z.alongx[i] + im * px, z.alongy[i] + im * py,
                                              z.alongw[i] + ii * pt)
        return
    leans = load(rows, k, loads, v, i, 0.0 if z.leans[i] != 0 else -math.inf, OFF)
    gx, gy, gw = v.vx[i] - vx, v.vy[i] - vy, v.w[i] - w
    z.gainx[i], z.gainy[i], z.gainw[i] = gx + im * px, gy + im * py, gw + ii * pt
    v.vx[i], v.vy[i], v.w[i] = vx, vy, w
    if z.leans[i] != 0 and not leans:
        z.owedx[i] += (1.0 + part) * gx
        z.owedy[i] += (1.0 + part) * gy
        z.owedw[i] += (1.0 + part) * gw
    z.leans[i] = 1 if leans else 0


@inline
def share(v: Bodies, z: Scratch, i: int, part: float) -> None:
    """Give a body this part of its gain, besides."""
    v.vx[i] += part * z.gainx[i]
    v.vy[i] += part * z.gainy[i]
    v.w[i] += part * z.gainw[i]
