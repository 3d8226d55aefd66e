"""Impacts: Poisson's law with Coulomb friction in both phases.

A point that hits alone (its bodies touch nothing else) is solved exactly by Routh's process.
Points that hit together, and what touches their bodies, are solved in two phases (Pfeiffer and
Glocker, "Multibody dynamics with unilateral contacts", 1996): compression, an inelastic contact
problem with friction; then decompression, in which every point gives back at least e times its
normal impulse of compression, with friction of its own bound mu times its own impulse.  Such a
pair of problems may gain energy where friction couples points; the decompression of an island
is then shortened until its kinetic energy does not rise.

Impacts are those of the velocities that tiles have when they meet (`gains.py`), on their arcs
(`meetings.py`).  Whatever hits in a substep does so in the order of time, each impact telling what
comes next; what does not hit before its end is left to go on (`fly_on`), and hits in the next one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.arrays import set_all
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.contacts import NEVER, NOTED, RESTS, SPARE, SWEPT, never_queue, place_row, weigh
from tbsa.kernels.early import note_early
from tbsa.kernels.gains import comes_off, draw, part_from, pushed, redraw, share
from tbsa.kernels.geometry import CIRCLE, cos_sin
from tbsa.kernels.hits import (
    ALONG,
    LISTED,
    NOWHERE,
    SAME,
    SPLIT,
    TOUCHING,
    Loads,
    Scratch,
    approach,
    corner_speed,
    leave,
    pair_speed,
)
from tbsa.kernels.jit import ZERO, U, inline, lane
from tbsa.kernels.meetings import ALONE, LATER, TOGETHER, fly_on, meeting, rocks_off
from tbsa.kernels.projection import clears
from tbsa.kernels.queue import put, take
from tbsa.kernels.routh import routh
from tbsa.kernels.rows import (
    AN0,
    AN1,
    BASE,
    BEND0,
    BEND1,
    BLOCK,
    BN0,
    BN1,
    COLOURS,
    COUNT,
    GAP0,
    GAP1,
    HIT,
    I00,
    I11,
    ID0,
    ID1,
    IDLE,
    K00,
    K11,
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
    WANTT,
    WARM0,
    WARM1,
    WARMT,
    WIDE,
    E,
    Rows,
    bodies_of,
    lane_of,
    root,
)
from tbsa.kernels.sweeps import solve_row

# A solve of impacts leaves this part of the fastest approach, though no less than a tolerance, and
# no more than so many; among what hits, this one.
SPREAD, ROUGH, FINE = 0.05, 10.0, 1e-4
# It has as many passes at least, as nothing gives back what it leaves; n tiles in a row need n^2.
AT_LEAST = 1000
# In ``known``: a row that takes part, as it hits or touches, or is not in contact after all; one on
# the list of the next pass; one whose gap is open at the time of the impact: it does not take part.
HITS, TOUCHES, PARTS, QUEUED, OPEN = 1, 2, 3, 4, 5
# What was pressed, and is yet, has no further gap than this (widths) at the time of an impact.
BARELY = 1e-4
# What is thrown may hit again in the same substep, so many times; then the solve stops it.
OFTEN = 60


@inline
def closing(wa: float, wb: float, vt: float, at: float, bt: float, of_a: bool,
            radius: float) -> float:
    """How a gap's rate of closing grows while both bodies fly on (m/s^2), of a point that slides
    by vt along the face, at `at` and `bt` out of it from the centres.

    A corner turns away from a face that does not turn; one that does comes after it.  `radius` is
    that of a wall about both, else infinite.
    """
    return wb * wb * bt - wa * wa * at - 2.0 * vt * (wa if of_a else wb) + vt * vt / radius


@lane
def is_back(k: Numbers, e: float, leaves: float, back: float, spin: float) -> bool:
    """Whether what bounces, and leaves as fast as this (m/s), would be back before the end of the
    substep, brought by the curve of its path, or of what it hits: it is in contact from now on.

    What leaves at `back` (m/s) comes at the end.  Bounces that get shorter and shorter end in a
    contact; hit once a substep, and back before its end, a tile sank in as it slid along a round
    wall.  What turns fast bounces on.
    """
    return bool(e > 0.0 and leaves < back and k.h * spin <= SWEPT)


@inline
def lone_impact(rows: Rows, row: int, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray,
                y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads,
                meet: Any) -> None:
    """Routh's impact at the one point of a row that hits, at its `meeting`.

    The bodies fly on to where they meet, exchange their impulses there, and go back in time with
    the velocities that they then have: what they do after the impact is exact, and no momentum
    is lost; what else they then hit is marked.

    Tiles that spin may bounce too little to stay apart for the rest of the substep: ever smaller
    bounces end in a contact that lasts along the curve of a corner.  Such a point leaves as fast,
    though no faster than it came, as brings it back at the end, or it would sink in.  What turns
    slower, and `is_back` before the end, does not bounce.
    """
    r, body = rows.field, rows.body
    i, t = lane_of(row), bodies_of(row)
    a, b = body[t], body[t + LANES]
    time, nx, ny, an, bn, at, bt, of_a = meet
    vx, vy, w, im, ii = v.vx, v.vy, v.w, k.im, k.ii
    ma, mb, part = v.mobile[a], v.mobile[b], time / loads.h - 0.5
    ax0, ay0, aw0, bx0, by0, bw0 = vx[a], vy[a], w[a], vx[b], vy[b], w[b]
    for body_index in (a, b):
        if time > loads.end and v.mobile[body_index] != 0.0:
            note_early(loads, v, x, y, angle, body_index)
    share(v, z, a, part)
    share(v, z, b, part)
    knn = im * (ma + mb) + ii * (ma * an * an + mb * bn * bn)
    ktt = im * (ma + mb) + ii * (ma * at * at + mb * bt * bt)
    knt = ii * (ma * an * at + mb * bn * bt)
    vn = nx * (vx[b] - vx[a]) + ny * (vy[b] - vy[a]) + bn * w[b] - an * w[a]
    vt = nx * (vy[b] - vy[a]) - ny * (vx[b] - vx[a]) + bt * w[b] - at * w[a]
    e, mu, round_wall = r[i + E], r[i + MU], b == k.n and k.wall == CIRCLE
    pn, pt = routh(vn, vt, knn, ktt, knt, mu, e)
    curve = closing(
        w[a] - ma * ii * (an * pn + at * pt), w[b] + mb * ii * (bn * pn + bt * pt),
        vt + knt * pn + ktt * pt, at, bt, of_a, k.wall_x if round_wall else math.inf)
    back = 0.5 * (k.h - time) * curve
    stays = is_back(k, e, -e * vn, back, abs(w[a]) + abs(w[b]))
    if stays:
        pn, pt = routh(vn, vt, knn, ktt, knt, mu, 0.0)
    elif back > max(k.threshold + k.tolerance, -e * vn) and (
            k.h * (abs(w[a]) + abs(w[b])) > SWEPT):
        pn, pt = routh(vn, vt, knn, ktt, knt, mu, max(e, min(1.0, back / -vn)))
    px, py = nx * pn - ny * pt, ny * pn + nx * pt
    turn_a, turn_b = -ma * ii * (an * pn + at * pt), mb * ii * (bn * pn + bt * pt)
    vx[a] -= ma * im * px
    vy[a] -= ma * im * py
    w[a] += turn_a
    vx[b] += mb * im * px
    vy[b] += mb * im * py
    w[b] += turn_b
    z.in_it[a] = z.in_it[b] = 1
    for body_index in (a, b):
        if v.mobile[body_index] != 0.0 and z.leans[body_index] == ALONG:
            part_from(rows, k, v, z, body_index, part)
    z.in_it[a] = z.in_it[b] = 0
    redraw(rows, k, loads, v, z, c, s, a, part)
    redraw(rows, k, loads, v, z, c, s, b, part)
    share(v, z, a, -part)
    share(v, z, b, -part)
    x[a] += time * (ax0 - vx[a])
    y[a] += time * (ay0 - vy[a])
    angle[a] += time * (aw0 - w[a])
    x[b] += time * (bx0 - vx[b])
    y[b] += time * (by0 - vy[b])
    angle[b] += time * (bw0 - w[b])
    for body_index in (a, b):
        if body_index == k.n or v.mobile[body_index] == 0.0:
            continue
        c[body_index], s[body_index] = cos_sin(angle[body_index])
        z.since[body_index] = time
    # What turns may close again, by next to nothing, where it has just been stopped.
    threshold = max(k.threshold, -1e-3 * vn)
    if stays:
        place_again(rows, row, k, threshold, loads.gain, v, x, y, c, s)
        stay_together(rows, row, an, bn, k, z)
    ahead = 1  # the row itself comes first
    for body_index in (a, b):
        if v.mobile[body_index] == 0.0:
            continue
        begin = rows.start[body_index]
        for p in range(begin - ahead, rows.start[body_index + 1]):
            if p < begin or rows.of[p] != row:
                look_again(rows, row if p < begin else rows.of[p], k, threshold, loads, v, z, x, y,
                           angle, c, s)
        ahead = 0
    if e == 0.0 and r[i + HIT] == 0.0:  # if its arc opens faster than forces close it
        gain = (nx * (z.gainx[b] - z.gainx[a]) + ny * (z.gainy[b] - z.gainy[a])
                + bn * z.gainw[b] - an * z.gainw[a])
        if k.h * curve < gain:
            leave_on_arc(rows, row, an, bn, -0.5 * curve, k)
        else:
            stay_together(rows, row, an, bn, k, z)


@lane
def point_at(r: np.ndarray, at: int, an: float, bn: float, width: float) -> int:
    """Which point of the row in the lane at `at` has about these lever arms, 1 or 2; 0 for none:
    its tiles have turned further than is told as `SWEPT`."""
    off0 = abs(r[at + AN0] - an) + abs(r[at + BN0] - bn)
    off1 = abs(r[at + AN1] - an) + abs(r[at + BN1] - bn) if r[at + COUNT] == 2.0 else math.inf
    if r[at + COUNT] == 0.0 or min(off0, off1) > SWEPT * width:
        return 0
    return 1 if off0 <= off1 else 2


@inline
def leave_on_arc(rows: Rows, row: int, an: float, bn: float, bend: float, k: Numbers) -> None:
    """The point of a row with these lever arms has been stopped, and leaves along its arc, by
    `bend` (m/s^2): where its tiles now are it has yet to come, which is not to be stopped again."""
    r, at = rows.field, lane_of(row)
    point = point_at(r, at, an, bn, k.width)
    if point == 1:
        r[at + WANT0], r[at + BEND0] = max(r[at + WANT0], -r[at + VN0]), bend
    elif point == 2:
        r[at + WANT1], r[at + BEND1] = max(r[at + WANT1], -r[at + VN1]), bend


@lane
def note_together(rows: Rows, row: int, k: Numbers, z: Scratch) -> None:
    """Give the points of a row that impacts of this substep have left together an impulse, if they
    have none: they are in contact, and do not hit.  It is what `bear` puts back, too."""
    r, at, little = rows.field, lane_of(row), NOTED * k.tolerance
    if z.points[row] & 1:
        r[at + PN0] = r[at + WARM0] = max(r[at + PN0], little * r[at + I00])
    if z.points[row] & 2:
        r[at + PN1] = r[at + WARM1] = max(r[at + PN1], little * r[at + I11])


@lane
def stay_together(rows: Rows, row: int, an: float, bn: float, k: Numbers, z: Scratch) -> None:
    """The point of a row with these lever arms is in contact from now on, if the row tells of it
    yet where its tiles now are."""
    point = point_at(rows.field, lane_of(row), an, bn, k.width)
    if point != 0:
        leave(z, row, point)
        note_together(rows, row, k, z)


@lane
def place_again(rows: Rows, row: int, k: Numbers, threshold: float, gain: float, v: Bodies,
                x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray) -> None:
    """A row from where its tiles are now, and whether it hits at their new velocities; the others
    of its block, far away perhaps, stay as they are."""
    r, block = rows.field, row // WIDE
    first, single, lives = U(block) * BLOCK, rows.single[block], False
    place_row(rows, row, k, gain, x, y, c, s, v)
    for i in range(LANES):
        if first + i == lane_of(row) or single == IDLE:  # nobody has weighed these yet
            _, live = weigh(r, first + i, k.h, k.per_mass, threshold, k.tolerance, RESTS * k.width,
                            gain)
            lives |= live
    if lives:
        rows.live[block] = 1
    hits, lone = 0, 0
    for i in range(LANES):
        hits += 1 if r[first + HIT + i] != 0.0 else 0
        lone += 1 if r[first + COUNT + i] == 1.0 else 0
    never_queue(rows, block)
    rows.hits[block], rows.single[block] = hits, single if single == LANES else lone


@lane
def let_go(r: np.ndarray, row: int, first: bool, second: bool, z: Scratch) -> None:
    """Take from pressed points of a row what they bore, so that they hit, and note it."""
    at = lane_of(row)
    if z.lost0[row] == 0.0 and z.lost1[row] == 0.0:
        z.thrown[z.size[4]] = row
        z.size[4] += 1
        z.lostt[row] = r[at + PT]
    if first:
        before = z.lost0[row] if z.was0[row] == r[at + ID0] else 0.0
        z.lost0[row], z.was0[row], r[at + PN0] = max(before, r[at + PN0]), r[at + ID0], 0.0
    if second:
        before = z.lost1[row] if z.was1[row] == r[at + ID1] else 0.0
        z.lost1[row], z.was1[row], r[at + PN1] = max(before, r[at + PN1]), r[at + ID1], 0.0


@inline
def take_up(rows: Rows, k: Numbers, v: Bodies, z: Scratch) -> None:
    """Give points that were pressed, have hit and have not bounced what they bore before: a load
    goes on after an impact, and a solve of few passes does not find it anew in a substep."""
    r, body, slow, near = rows.field, rows.body, k.threshold + k.tolerance, TOUCHING * k.width
    for j in range(z.size[4]):
        q = z.thrown[j]
        at, t = lane_of(q), bodies_of(q)
        vn0, vn1 = approach(r, at, v, U(body[t]), U(body[t + LANES]))
        if (r[at + COUNT] != 0.0 and r[at + ID0] == z.was0[q] and r[at + GAP0] < near
                and vn0 <= slow):
            r[at + PN0] = max(r[at + PN0], z.lost0[q])
        if (r[at + COUNT] == 2.0 and r[at + ID1] == z.was1[q] and r[at + GAP1] < near
                and vn1 <= slow):
            r[at + PN1] = max(r[at + PN1], z.lost1[q])
        most = r[at + MU] * (r[at + PN0] + r[at + PN1])
        r[at + PT] = min(max(z.lostt[q] if r[at + PT] == 0.0 else r[at + PT], -most), most)
        rows.live[q // WIDE] = 1
        z.lost0[q] = z.lost1[q] = 0.0
    z.size[4] = 0


@lane
def look_again(rows: Rows, row: int, k: Numbers, threshold: float, loads: Loads, v: Bodies,
               z: Scratch, x: np.ndarray, y: np.ndarray, angle: np.ndarray, c: np.ndarray,
               s: np.ndarray) -> None:
    """Whether and when a row hits after an impact of one of its tiles.

    A pressed point that it throws on, faster than a solve leaves it, hits like any other.
    """
    r, at, t = rows.field, lane_of(row), bodies_of(row)
    slow = comes_off(k, threshold, pair_speed(k, v, U(rows.body[t]), U(rows.body[t + LANES])))
    for _ in range(2):  # again without what has been let go
        place_again(rows, row, k, threshold, loads.gain, v, x, y, c, s)
        first = r[at + PN0] != 0.0 and r[at + VN0] < -slow
        second = r[at + PN1] != 0.0 and r[at + VN1] < -slow
        if not (first or second):
            break
        let_go(r, row, first, second, z)
    if r[at + HIT] != 0.0:
        expect(rows, row, k, loads, v, z, x, y, angle, c, s)


@lane
def may_close(gap: float, nearest: float, touch: float, left: float, width: float) -> float:
    """How fast a point may approach within an impact (m/s): not at all if it is as near as the
    nearest of its row that hits, or touches exactly; by its gap in what is left of the substep if
    it touches as well as a solve leaves it; else the impact is over before it comes."""
    if gap <= nearest + 2.0 * NOWHERE * width:
        return 0.0
    return gap / left if gap <= touch else NEVER


@lane
def gap_in(r: np.ndarray, gap: int, time: float) -> float:
    """A gap, in this place of the fields, after a time (s), as the row's tiles go (m)."""
    return float(r[gap] + time * (r[gap + VN0 - GAP0] + time * r[gap + BEND0 - GAP0]))


@inline
def ask_again(rows: Rows, z: Scratch, tile: int) -> None:
    """The tile goes otherwise than when rows of it were found OPEN."""
    for p in range(rows.start[tile], rows.start[tile + 1]):
        row = rows.of[p]
        z.known[row] = 0 if z.known[row] == OPEN else z.known[row]


@inline
def enter(rows: Rows, q: int, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray,
          y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads,
          begun: float) -> None:
    """Let row q take part in the impact, at its time: without impulses, and its gap may close if it
    hits.

    Its tiles fly on to where they then are, unless neither comes anywhere by then.
    """
    r, body, mobile, time = rows.field, rows.body, v.mobile, z.time[q]
    at, t = lane_of(q), bodies_of(q)
    z.rows[z.size[0]] = q
    z.size[0] += 1
    moved, flies = False, time * max(corner_speed(k, v, body[t]), corner_speed(
        k, v, body[t + LANES])) > NOWHERE * k.width
    open0, open1 = opened(rows, q, k, loads, v, z, time)
    for i in (body[t], body[t + LANES]):
        if mobile[i] == 0.0:
            continue
        if z.in_it[i] == 0:
            draw(rows, k, loads, v, z, c, s, i)
            if begun > loads.end:
                note_early(loads, v, x, y, angle, i)
            z.in_it[i] = 1
            z.pace[i] = 0.0
            z.tiles[z.size[1]] = i
            z.size[1] += 1
            z.when[i], z.part[i] = 0.0, time / loads.h - 0.5
            if flies:
                z.when[i] = time
                x[i] += time * v.vx[i]
                y[i] += time * v.vy[i]
                angle[i] += time * v.w[i]
                c[i], s[i] = cos_sin(angle[i])
            share(v, z, i, z.part[i])
            z.ux[i], z.uy[i], z.uw[i] = v.vx[i], v.vy[i], v.w[i]
            ask_again(rows, z, i)
        moved |= z.when[i] > 0.0
    hit = r[at + HIT]
    if moved:
        place_again(rows, q, k, k.threshold, 0.0, v, x, y, c, s)
    if r[at + COUNT] != 0.0:
        gap0, gap1 = r[at + GAP0], r[at + GAP1] if r[at + COUNT] == 2.0 else math.inf
        left: float = k.h
        if moved:
            gap0, gap1, left = gap0 - open0, gap1 - open1, max(k.h - time, SAME * k.h)
        nearest = max(min(gap0, gap1), 0.0) if hit > 0.0 else 0.0
        touch = touching(r, at, k)
        r[at + WANT0] = may_close(gap0, nearest, touch, left, k.width)
        r[at + WANT1] = may_close(gap1, nearest, touch, left, k.width)
        r[at + WANTT] = 0.0
    r[at + HIT] = hit
    r[at + PN0] = r[at + PN1] = r[at + PT] = r[at + BASE] = 0.0


@inline
def opened(rows: Rows, q: int, k: Numbers, loads: Loads, v: Bodies, z: Scratch, time: float) -> Any:
    """By how much (m) the points of row q are further apart at the time of an impact (s), as its
    tiles go, than they then are: those that were pressed, and leave no faster than their arc takes
    them off, are as the last solve has left them, where what presses them on is more than that.

    If nothing has hit their tiles in this substep, and these do not turn fast.
    """
    r, body, t = rows.field, rows.body, bodies_of(q)
    at, turn, hit, most = lane_of(q), 0.0, False, BARELY * k.width
    if r[at + WARM0] + r[at + WARM1] == 0.0:
        return 0.0, 0.0
    a, b = body[t], body[t + LANES]
    for i in (a, b):
        if v.mobile[i] != 0.0:
            turn += abs(z.uw[i] if z.in_it[i] != 0 else v.w[i])  # without the impact
            hit |= z.since[i] != 0.0
    if hit or k.h * turn > SWEPT:
        return 0.0, 0.0
    leaves, begun = k.tolerance + rocks_off(r, at, k, turn, time), 0.5 * k.h
    gap0, gap1 = gap_in(r, at + GAP0, time), gap_in(r, at + GAP1, time)
    first = r[at + WARM0] > 0.0 and r[at + VN0] <= leaves and gap0 <= most
    second = r[at + WARM1] > 0.0 and r[at + VN1] <= leaves and gap1 <= most
    if not (first or second):
        return 0.0, 0.0
    ax, ay, aw = pushed(rows, q, a, k, loads, v, z)
    bx, by, bw = pushed(rows, q, b, k, loads, v, z)
    press = r[at + NX] * (ax - bx) + r[at + NY] * (ay - by)
    first = first and press + r[at + AN0] * aw - r[at + BN0] * bw > 2.0 * r[at + BEND0]
    second = second and press + r[at + AN1] * aw - r[at + BN1] * bw > 2.0 * r[at + BEND1]
    was0 = r[at + GAP0] - begun * max(r[at + VN0], 0.0)
    was1 = r[at + GAP1] - begun * max(r[at + VN1], 0.0)
    return max(gap0 - was0, 0.0) if first else 0.0, max(gap1 - was1, 0.0) if second else 0.0


@inline
def nearest_in(rows: Rows, q: int, k: Numbers, loads: Loads, v: Bodies, z: Scratch,
               time: float) -> float:
    """The gap (m) of the nearer point of row q at the time of an impact (s)."""
    r, at = rows.field, lane_of(q)
    open0, open1 = opened(rows, q, k, loads, v, z, time)
    gap: float = gap_in(r, at + GAP0, time) - open0
    return min(gap, gap_in(r, at + GAP1, time) - open1) if r[at + COUNT] == 2.0 else gap


@lane
def left_of(k: Numbers, pace: float) -> float:
    """What a solve leaves of an impact that has come as fast as this (m/s)."""
    return min(ROUGH * k.tolerance, max(k.tolerance, SPREAD * pace))


@lane
def role_of(r: np.ndarray, q: int) -> int:
    """How row q takes part in an impact: HITS, TOUCHES or PARTS."""
    i = lane_of(q)
    return (HITS if r[i + HIT] != 0.0 else TOUCHES) if r[i + COUNT] != 0.0 else PARTS


@inline
def takes_part(rows: Rows, q: int, k: Numbers, loads: Loads, v: Bodies, z: Scratch) -> bool:
    """Whether row q, that an impact has come to, touches at its time, or has been left together."""
    r, i = rows.field, lane_of(q)
    if r[i + COUNT] == 0.0:
        return False
    gap = nearest_in(rows, q, k, loads, v, z, z.time[q])
    return bool(gap <= touching(r, i, k) or z.points[q] & 3 != 0)


@inline
def settle(rows: Rows, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray, y: np.ndarray,
           angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads, begun: float,
           size: int) -> None:
    """Solve the `size` rows in ``rows.now``, and on what they move, for as many passes as a solve,
    or AT_LEAST.

    Among what hits until nothing changes by more than FINE of how fast that has come (or of the
    tolerance: what has come at 1e-17 m/s may hit, and changes by rounding without an end), or what
    is left, always in the order of the rows, would turn tiles that hit a wall flat; beyond, by more
    than `left_of` that, and the contact solve that follows closes it, without restitution.  What
    rows have already got (``BASE``) has changed the velocities of their tiles, too.
    """
    r, body, start, of = rows.field, rows.body, rows.start, rows.of
    mobile, known, pace = v.mobile, z.known, z.pace
    now, then = rows.now, rows.then
    m = ZERO
    for p in range(max(k.passes, AT_LEAST)):
        m = ZERO
        for j in range(size):
            q = now[j]
            known[q] = role_of(r, q)
            change = solve_row(rows, q, k.per_mass, v)
            if p == 0:
                change = max(change, r[lane_of(q) + BASE] * r[lane_of(q) + K00])
            t = bodies_of(q)
            fastest = max(pace[body[t]], pace[body[t + LANES]])
            rough = left_of(k, fastest)
            if change <= min(rough, FINE * max(fastest, k.tolerance)):
                continue
            much, time = change > rough, z.time[q]
            for tile in (body[t], body[t + LANES]):
                if mobile[tile] == 0.0:
                    continue
                pace[tile] = fastest
                for o in range(start[tile], start[tile + 1]):
                    # Written in any case and kept by moving on, as no branch can be foreseen.
                    other = of[o]
                    how = known[other]
                    again = (how == HITS) | (much & (how == TOUCHES))
                    then[m], known[other] = other, QUEUED if again else how
                    m += 1 if again else 0
                    if much & ((how == 0) | ((how == OPEN) & (z.time[other] != time))):
                        z.time[other] = time
                        if takes_part(rows, other, k, loads, v, z):
                            enter(rows, other, k, v, z, x, y, angle, c, s, loads, begun)
                            known[other] = QUEUED
                            m += 1
                        else:  # what is thrown at it hits it in the next round
                            known[other] = OPEN
        if m == 0:
            break
        for j in range(m):
            now[j] = then[j]
        size = m
    z.size[5] |= 1 if m > 0 else 0
    for j in range(m):
        known[now[j]] = role_of(r, now[j])


@inline
def limit_energy(rows: Rows, k: Numbers, v: Bodies, z: Scratch) -> None:
    """Draw each island's velocities back towards u until its energy is no more than `most`.

    An island are tiles between which an impulse has passed.  Along that line the energy is a
    parabola, below `most` at the end u; impulses keep their place on the line, so momentum is
    kept and neither cone nor non-penetration is left.
    """
    m, inertia = k.mass, k.inertia
    vx, vy, w, mobile = v.vx, v.vy, v.w, v.mobile
    ux, uy, uw, most, energy, mixed, island = z.ux, z.uy, z.uw, z.most, z.energy, z.mixed, z.island
    r, body = rows.field, rows.body
    for j in range(z.size[1]):
        island[z.tiles[j]] = z.tiles[j]
    for j in range(z.size[0]):
        q = z.rows[j]
        i, t = lane_of(q), bodies_of(q)
        a, b = body[t], body[t + LANES]
        if mobile[a] * mobile[b] != 0.0 and (r[i + PN0] != 0.0 or r[i + PN1] != 0.0
                                             or r[i + PT] != 0.0 or r[i + BASE] != 0.0):
            p, q = root(island, a), root(island, b)
            island[max(p, q)] = min(p, q)
    for j in range(z.size[1]):
        i = z.tiles[j]
        energy[i] = mixed[i] = 0.0
        most[i] -= 0.5 * (m * (ux[i] * ux[i] + uy[i] * uy[i]) + inertia * uw[i] * uw[i])
    for j in range(z.size[1]):
        i = z.tiles[j]
        dx, dy, dw = vx[i] - ux[i], vy[i] - uy[i], w[i] - uw[i]
        p = root(island, i)
        energy[p] += 0.5 * (m * (dx * dx + dy * dy) + inertia * dw * dw)
        mixed[p] += m * (dx * ux[i] + dy * uy[i]) + inertia * dw * uw[i]
        if p != i:
            most[p] += most[i]
    for j in range(z.size[1]):
        i = z.tiles[j]
        p = root(island, i)
        room = max(most[p], 0.0)
        if energy[p] + mixed[p] <= room:  # energy s^2 + mixed s <= room at the whole way, s = 1
            continue
        d = math.sqrt(mixed[p] * mixed[p] + 4.0 * energy[p] * room)
        step = min(max((d - mixed[p]) / (2.0 * energy[p]), 0.0), 1.0)
        vx[i] = ux[i] + step * (vx[i] - ux[i])
        vy[i] = uy[i] + step * (vy[i] - uy[i])
        w[i] = uw[i] + step * (w[i] - uw[i])


@inline
def note_energy(k: Numbers, vx: np.ndarray, vy: np.ndarray, w: np.ndarray, z: Scratch) -> None:
    """The energy that each tile of the impact may have: that of these velocities."""
    for j in range(z.size[1]):
        i = z.tiles[j]
        z.most[i] = 0.5 * (k.mass * (vx[i] * vx[i] + vy[i] * vy[i]) + k.inertia * w[i] * w[i])


@inline
def touching(r: np.ndarray, i: int, k: Numbers) -> float:
    """How near the points of the row in lane i are (m) where its tiles touch: exactly, unless they
    were pressed together: then as a solve, with its tolerance, leaves them."""
    most = min(TOUCHING * k.width, 2.0 * k.tolerance * k.h)
    return max(most if r[i + WARM0] + r[i + WARM1] > 0.0 else 0.0, NOWHERE * k.width)


@inline
def company(rows: Rows, tile: int, row: int, k: Numbers, loads: Loads, v: Bodies,
            z: Scratch) -> int:
    """What else a tile meets whose `row` hits next: ALONE nothing; TOGETHER what it touches and
    does not leave, faster than a solve lets it, or hits at the same time."""
    r, time, slow = rows.field, z.queue.time, min(k.threshold, k.tolerance)
    for p in range(rows.start[tile], rows.start[tile + 1]):
        other = rows.of[p]
        i = lane_of(other)
        count, hit = r[i + COUNT], r[i + HIT]
        if other == row or (count == 0.0 and hit == 0.0):
            continue
        if hit != 0.0 and time[other] - time[row] <= SAME * k.h:
            return TOGETHER
        # What rests on one corner may be about to hit with the other one.
        first, second = (hit == 0.0 or hit == 2.0), (count == 2.0 and (hit == 0.0 or hit == 1.0))
        left = z.points[other] & ((1 if first else 0) + (2 if second else 0))
        # What an impact has thrown stands where it comes from: there a point that leaves may be in
        # the other body.
        pressed = r[i + WARM0] + r[i + WARM1] > 0.0
        open0, open1 = opened(rows, other, k, loads, v, z, 0.0)
        gap = min(r[i + GAP0] - open0 if first and (pressed or r[i + VN0] <= slow) else math.inf,
                  r[i + GAP1] - open1 if second and (pressed or r[i + VN1] <= slow) else math.inf)
        if left != 0 or gap < touching(r, i, k):
            return TOGETHER
    return ALONE


@inline
def beside(rows: Rows, row: int, k: Numbers, mobile: np.ndarray, z: Scratch) -> bool:
    """Whether a tile of a row that may hit does so with another row at the same time: what comes to
    lie across the joint of two tiles hits one of these with next to no width."""
    t = bodies_of(row)
    for tile in (rows.body[t], rows.body[t + LANES]):
        if mobile[tile] == 0.0:
            continue
        for p in range(rows.start[tile], rows.start[tile + 1]):
            other = rows.of[p]
            if (rows.field[lane_of(other) + HIT] > 0.0
                    and abs(z.queue.time[other] - z.queue.time[row]) <= SAME * k.h):
                return True
    return False


@lane
def expect(rows: Rows, row: int, k: Numbers, loads: Loads, v: Bodies, z: Scratch, x: np.ndarray,
           y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray) -> Any:
    """Queue a row that may hit, by the time at which it does; or let it go on, or to the solve.

    Returns the `meeting`.
    """
    body, t = rows.body, bodies_of(row)
    a, b = U(body[t]), U(body[t + LANES])
    draw(rows, k, loads, v, z, c, s, a)
    draw(rows, k, loads, v, z, c, s, b)
    how, meet = meeting(rows, row, k, v, z, x, y, angle, c, s, loads.h, 0.0)
    r, i, slow = rows.field, lane_of(row), max(k.threshold, loads.gain / k.h)
    leaves = r[i + HIT] == -2.0
    if how < LATER and not leaves:
        put(z.queue, row, meet[0])
        return how, meet
    # The solve stops what comes slowly all the way, and what has not left the face before; what has
    # been turning on its way to a slow meeting goes on as it does, and so does what its arc leads
    # past.  What forces and floor brake before does not: others may push it on.
    (vn0, vn1), two = approach(r, i, v, a, b), r[i + COUNT] == 2.0
    comes = vn0 < -slow or (two and vn1 < -slow)
    passes = how == LATER and (r[i + GAP0] + k.h * vn0 <= 0.0
                               or (two and r[i + GAP1] + k.h * vn1 <= 0.0))
    if (comes and passes) or (not leaves and (comes or passes)):
        fly_on(r, i, k.h)
    r[i + HIT] = 0.0
    return how, meet


@inline
def impacts(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, x: np.ndarray,
            y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray) -> int:
    """Impulses of everything that hits in this substep, as marked in ``hit``, in the order of time:
    what is thrown may hit something else, or the same tile with another corner.  Returns the number
    of points that have hit.

    The floor's dry friction is a finite force and does nothing in an impact.  Only the rows that
    an impact reaches are looked at; they are left as they were.  ``since`` says from when in the
    substep each tile goes as it does: 0, but for what an impact before has thrown.
    """
    r, body, hits, mobile, queue = rows.field, rows.body, rows.hits, v.mobile, z.queue
    points, size, begun = ZERO, ZERO, 0.0
    set_all(z.struck, k.n + 1, ZERO)
    z.size[2] = 0
    known, how, meet = -1, LATER, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    for block in range(rows.first[COLOURS]):
        if hits[block] == 0:
            continue
        for i in range(LANES):
            row = WIDE * block + int(i)
            if r[lane_of(row) + HIT] != 0.0:
                known = row
                how, meet = expect(rows, row, k, loads, v, z, x, y, angle, c, s)
    while queue.size[0] > 0 or size > 0:
        if size > 0 and (queue.size[0] == 0
                         or queue.time[queue.heap[0]] - begun > SAME * k.h):
            together(rows, k, v, z, x, y, angle, c, s, loads, begun, size)
            size = ZERO
            continue
        row = take(queue)
        at, t = lane_of(row), bodies_of(row)
        a, b, hit = body[t], body[t + LANES], r[at + HIT]
        if hit == 0.0:  # no longer, after another impact
            continue
        if max(z.struck[a] * mobile[a], z.struck[b] * mobile[b]) >= OFTEN:
            r[at + HIT] = 0.0
            continue
        if row != known or points + size > 0:  # its tiles may go otherwise than they did
            how, meet = meeting(rows, row, k, v, z, x, y, angle, c, s, loads.h, queue.time[row])
            known = row
        if how >= LATER or (hit < 0.0 and beside(rows, row, k, mobile, z)):
            fly_on(r, at, k.h)
            continue
        z.struck[a] += 1
        z.struck[b] += 1
        for tile in (a, b):
            how = max(how, company(rows, tile, row, k, loads, v, z) if mobile[tile] != 0.0
                      else ALONE)
        if how == ALONE or hit < 0.0:
            lone_impact(rows, row, k, v, z, x, y, angle, c, s, loads, meet)
            points += 1
        else:
            begun = meet[0] if size == 0 else begun
            z.time[row] = meet[0]
            rows.now[size] = row
            size += 1
            points += 2 if hit == 3.0 else 1
    for j in range(z.size[2]):
        i = z.pulled[j]
        share(v, z, i, -1.0)
        v.vx[i] += z.owedx[i]
        v.vy[i] += z.owedy[i]
        v.w[i] += z.owedw[i]
        z.gainx[i] = z.gainy[i] = z.gainw[i] = z.owedx[i] = z.owedy[i] = z.owedw[i] = 0.0
        z.drawn[i] = z.leans[i] = 0
    if z.size[4] > 0:
        take_up(rows, k, v, z)
    return int(points)


@inline
def leave_together(rows: Rows, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray, y: np.ndarray,
                   c: np.ndarray, s: np.ndarray) -> None:
    """Of the points that impacts of this substep have pressed, keep those that they have left
    together, and that press on each other as their tiles turn, and those that are back before its
    end: they touch.

    Not what turns fast: what bears it does work, and a solve does none.
    """
    r, body, slow = rows.field, rows.body, k.threshold + k.tolerance
    for j in range(z.size[0]):  # of this impact: their rows tell of now
        q = z.rows[j]
        if z.points[q] & 3 == 0:
            continue
        at, t = lane_of(q), bodies_of(q)
        a, b = U(body[t]), U(body[t + LANES])
        vn0, vn1 = approach(r, at, v, a, b)
        e, spin, left = r[at + E], abs(v.w[a]) + abs(v.w[b]), z.time[q] - k.h
        back = ((1 if is_back(k, e, vn0, left * r[at + BEND0], spin) else 0)
                + (2 if is_back(k, e, vn1, left * r[at + BEND1], spin) else 0))
        stay = (1 if vn0 <= slow else 0) + (2 if vn1 <= slow else 0)
        if stay != 0 and (k.h * spin > SWEPT or clears(
                rows, q, k, v, x, y, c, s, k.h * v.w[a], k.h * v.w[b], k.h, NOWHERE * k.width)):
            stay = 0
        z.points[q] &= stay | back | LISTED | SPLIT


@inline
def keep_together(rows: Rows, k: Numbers, z: Scratch) -> None:
    """Give what impacts of this substep have left together an impulse, if the solve has given it
    none: it has been in contact.

    What turns as it is hit comes again in the next substep, as its faces turn.  There the solve
    bears it; it would hit, and bounce, in every substep.
    """
    for j in range(z.size[3]):
        note_together(rows, z.left[j], k, z)
        z.points[z.left[j]] = 0
    z.size[3] = 0


@inline
def rebound(rows: Rows, k: Numbers, v: Bodies, z: Scratch) -> Any:
    """Give back at least e times the normal impulse of compression, where a point came fast enough
    to bounce; returns how many rows, in ``rows.now``, push by it."""
    r, body, size = rows.field, rows.body, ZERO
    for j in range(z.size[0]):
        q = z.rows[j]
        at, t = lane_of(q), bodies_of(q)
        e, p0, p1 = r[at + E], r[at + PN0], r[at + PN1]
        if p0 + p1 > 0.0:
            leave(z, q, (1 if p0 > 0.0 else 0) + (2 if p1 > 0.0 else 0))
        v0, v1, left = p0 * r[at + K00], p1 * r[at + K11], z.time[q] - k.h
        spin = abs(v.w[body[t]]) + abs(v.w[body[t + LANES]])
        arc0, arc1 = r[at + BEND0], r[at + BEND1]
        # What was in contact comes, in a substep, by what its arc gives.
        came0 = v0 + 2.0 * k.h * arc0 if r[at + WARM0] > 0.0 else v0
        came1 = v1 + 2.0 * k.h * arc1 if r[at + WARM1] > 0.0 else v1
        back0 = v0 > 0.0 and is_back(k, e, e * came0, left * arc0, spin)
        back1 = v1 > 0.0 and is_back(k, e, e * came1, left * arc1, spin)
        p0 = e * p0 if v0 > k.threshold and not back0 else 0.0
        p1 = e * p1 if v1 > k.threshold and not back1 else 0.0
        r[at + PN0] = r[at + PN1] = r[at + PT] = 0.0
        r[at + BASE] = p0 + p1
        if p0 + p1 > 0.0:
            a, b = U(body[t]), U(body[t + LANES])
            nx, ny, ma, mb = r[at + NX], r[at + NY], r[at + MA], r[at + MB]
            v.vx[a] -= ma * nx * (p0 + p1)
            v.vy[a] -= ma * ny * (p0 + p1)
            v.w[a] -= k.per_mass * ma * (r[at + AN0] * p0 + r[at + AN1] * p1)
            v.vx[b] += mb * nx * (p0 + p1)
            v.vy[b] += mb * ny * (p0 + p1)
            v.w[b] += k.per_mass * mb * (r[at + BN0] * p0 + r[at + BN1] * p1)
            z.known[q] = QUEUED
            rows.now[size] = q
            size += 1
    return size


@inline
def restore(rows: Rows, k: Numbers, z: Scratch) -> None:
    """Give the rows of an impact the impulses that they had before it, for the solve, and take from
    those of its tiles the bends of spins that they no longer have."""
    r = rows.field
    for j in range(z.size[0]):
        q = z.rows[j]
        at = lane_of(q)
        z.known[q] = 0
        rows.live[q // WIDE] = 1  # it is solved as it goes now, and may not be placed again
        r[at + PN0], r[at + PN1], r[at + PT] = r[at + WARM0], r[at + WARM1], r[at + WARMT]
        r[at + BASE] = r[at + HIT] = 0.0
        note_together(rows, q, k, z)
    for j in range(z.size[1]):
        i = z.tiles[j]
        ask_again(rows, z, i)
        for p in range(rows.start[i], rows.start[i + 1]):
            at = lane_of(rows.of[p])
            if r[at + COUNT] != 0.0:  # bends were those of other spins
                r[at + BEND0] = r[at + BEND1] = r[at + WANTT] = 0.0
                r[at + WANT0] = max(r[at + GAP0], 0.0) / k.h
                r[at + WANT1] = max(r[at + GAP1], 0.0) / k.h


@inline
def put_back(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, x: np.ndarray,
             y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray) -> None:
    """Put the tiles of an impact to where they would have begun the substep, as they go now."""
    for j in range(z.size[1]):
        i, time = z.tiles[j], z.when[z.tiles[j]]
        redraw(rows, k, loads, v, z, c, s, i, z.part[i])
        share(v, z, i, -z.part[i])
        if time > 0.0:
            x[i] -= time * v.vx[i]
            y[i] -= time * v.vy[i]
            angle[i] -= time * v.w[i]
            c[i], s[i] = cos_sin(angle[i])
            z.since[i] = time


@inline
def look_on(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, x: np.ndarray,
            y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray) -> None:
    """Queue what the tiles of an impact hit next: what is near, or what they are fast enough for,
    as they go now."""
    r, body = rows.field, rows.body
    far = SPARE * k.width
    for j in range(z.size[1]):
        i = z.tiles[j]
        every = z.when[i] > 0.0 or k.h * corner_speed(k, v, i) > far
        for p in range(rows.start[i], rows.start[i + 1]):
            q = rows.of[p]
            t = bodies_of(q)
            other = body[t + LANES] if body[t] == i else body[t]
            at = lane_of(q)
            if z.in_it[other] != 2 and (every or r[at + GAP0] < far or r[at + COUNT] != 0.0
                                        or r[at + HIT] != 0.0):
                look_again(rows, q, k, k.threshold + left_of(k, z.pace[i]), loads, v, z, x, y,
                           angle, c, s)
        z.in_it[i] = 2  # its rows are done
    for j in range(z.size[1]):
        z.in_it[z.tiles[j]] = 0


@inline
def together(rows: Rows, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray, y: np.ndarray,
             angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads, begun: float,
             size: int) -> None:
    """Impulses of the `size` rows in ``rows.now``, that hit together, the first of them at the time
    `begun` (s), and of what they reach."""
    r, body = rows.field, rows.body
    z.size[0] = z.size[1] = 0
    for j in range(size):
        q = rows.now[j]
        at, t = lane_of(q), bodies_of(q)
        pace = max(-r[at + VN0], -r[at + VN1] if r[at + COUNT] == 2.0 else 0.0)
        enter(rows, q, k, v, z, x, y, angle, c, s, loads, begun)
        z.known[q] = QUEUED
        for i in (body[t], body[t + LANES]):
            z.pace[i] = max(z.pace[i], pace) if v.mobile[i] != 0.0 else 0.0

    # Compression: an inelastic contact problem; what hits closes its gap now.
    settle(rows, k, v, z, x, y, angle, c, s, loads, begun, size)
    note_energy(k, z.ux, z.uy, z.uw, z)
    limit_energy(rows, k, v, z)

    # Decompression: at least e times the normal impulse of compression comes back.
    note_energy(k, z.ux, z.uy, z.uw, z)
    for j in range(z.size[1]):
        i = z.tiles[j]
        z.ux[i], z.uy[i], z.uw[i] = v.vx[i], v.vy[i], v.w[i]
        ask_again(rows, z, i)
    size = rebound(rows, k, v, z)
    if size > 0:
        before = z.size[1]
        settle(rows, k, v, z, x, y, angle, c, s, loads, begun, size)
        for j in range(before, z.size[1]):  # tiles that only this phase has reached
            i = z.tiles[j]
            z.most[i] = 0.5 * (k.mass * (z.ux[i] * z.ux[i] + z.uy[i] * z.uy[i])
                               + k.inertia * z.uw[i] * z.uw[i])
        limit_energy(rows, k, v, z)

    leave_together(rows, k, v, z, x, y, c, s)
    restore(rows, k, z)
    for j in range(z.size[1]):
        if z.leans[z.tiles[j]] == ALONG:
            part_from(rows, k, v, z, z.tiles[j], z.part[z.tiles[j]])
    put_back(rows, k, loads, v, z, x, y, angle, c, s)
    look_on(rows, k, loads, v, z, x, y, angle, c, s)
