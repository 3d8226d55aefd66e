"""Impacts: Poisson's law with Coulomb friction in both phases.

A point that hits alone (its bodies touch nothing else) is solved exactly by Routh's process.
Points that hit together, and what touches their bodies, are solved in two phases (Pfeiffer and
Glocker, "Multibody dynamics with unilateral contacts", 1996): compression, an inelastic contact
problem with friction; then decompression, in which every point gives back at least e times its
normal impulse of compression, with friction of its own bound mu times its own impulse.  Such a
pair of problems may gain energy where friction couples points; the decompression of an island
is then shortened until its kinetic energy does not rise.

Impacts are those of the velocities that tiles have when they meet.  Forces, floor, and the walls
and held tiles that bear it first give a tile its gain of the substep (`draw`), so that it goes the
way that it would without the impact; when it hits, it has the part of the gain that goes with that
time (`share`).  Afterwards the gain is taken back, as the contact solve gives it again.  What lies
on tiles that move has no gain of forces.

What would hit if it went on at its present rates, but does not on its arc, is let go; and what
turns fast may hit with other corners than its row tells of.  Whatever hits in a substep does so in
the order of time, each impact telling what comes next; what does not hit before its end is left to
go on (`fly_on`), and hits in the next one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns, set_all
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.contacts import (
    GRAZED,
    NEVER,
    NOTED,
    RESTS,
    SPARE,
    SWEPT,
    never_queue,
    place_row,
    weigh,
)
from tbsa.kernels.floor import NONE, FloorLaw, floor_impulse, friction_of
from tbsa.kernels.geometry import (
    BLUNT,
    CIRCLE,
    circle_corner,
    corner_arm,
    cos_sin,
    square_square,
    wall_square,
)
from tbsa.kernels.jit import ZERO, U, apart, inline, lane
from tbsa.kernels.projection import clears
from tbsa.kernels.queue import Queue, empty_queue, put, take
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
    BODIES,
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
    lane_of,
    root,
    wall_code,
)
from tbsa.kernels.sweeps import solve_row

# Points nearer than this fraction of the width take part in an impact of their tiles, at most.
TOUCHING = 1e-3
# Two points of a manifold whose gaps differ by less hit together.
FLUSH = 1e-6
# Error of a gap for each metre of where its tiles are: some units in the last place.
ROUNDING = 2e-15
# How a point that is about to hit meets the other body: what is more, holds.
ALONE, TOGETHER, LATER, SLOW = 0, 1, 2, 3
# Steps of the search for a meeting; the last few of them are Newton's.
SEARCH = 60
# Where its steps would get ever shorter, they are no shorter than this part of the substep.
SOON = 2.0 / SEARCH
# Hits of one tile at times that differ by less than this part of the substep are one.
SAME = 1e-3
# Tiles that come no further than this fraction of the width until they hit are left where they are.
NOWHERE = 1e-5
# A solve of impacts leaves this part of the fastest approach, though no less than a tolerance, and
# no more than so many; among what hits, this one.
SPREAD, ROUGH, FINE = 0.05, 10.0, 1e-4
# What was pressed, and is yet, has no further gap than this (widths) at the time of an impact.
BARELY = 1e-4
# It has as many passes at least, as nothing gives back what it leaves; n tiles in a row need n^2.
AT_LEAST = 1000
# What was pressed comes off if it goes faster than this part of the fastest corner of its tiles, as
# one is seen from the other.
OFF = 0.01
# What was pressed hits if it comes faster than this part of that, and than a solve leaves it.
PARTED = 0.05
# What bears a tile is found up to this part of what forces give it in the substep.
BORNE = 1e-3
# What is thrown may hit again in the same substep, so many times; then the solve stops it.
OFTEN = 60
# In ``points``: an impact of this substep has left a row together, if none that came after it.
LISTED = 4


class Scratch(NamedTuple):
    """Scratch of the impacts, by rows (WIDE block + lane) and by bodies."""

    queue: Queue  # the rows that hit, by when in the substep (s)
    known: np.ndarray  # int64, 0, or how a row takes part: 1 waiting, 2 to be solved
    rows: np.ndarray  # int64, the rows that take part
    time: np.ndarray  # s, when in the substep the impact reaches a row
    in_it: np.ndarray  # int64[n], whether a tile takes part
    tiles: np.ndarray  # int64, the tiles that do
    pace: np.ndarray  # m/s, the fastest approach of what has reached it
    struck: np.ndarray  # int64, how often one has hit
    island: np.ndarray  # int64, union-find over them
    ux: np.ndarray  # velocities before a phase
    uy: np.ndarray
    uw: np.ndarray
    most: np.ndarray  # J, energy that an island may have
    energy: np.ndarray
    mixed: np.ndarray
    since: np.ndarray  # s, from when in the substep a tile has gone as it goes now
    when: np.ndarray  # s, how far in the substep a tile of an impact has flown on
    part: np.ndarray  # the share of its gain that it has there
    gainx: np.ndarray  # m/s, what forces and floor give a tile in the substep
    gainy: np.ndarray
    gainw: np.ndarray  # rad/s
    owedx: np.ndarray  # m/s, what it is to get besides when all that hits has hit
    owedy: np.ndarray
    owedw: np.ndarray  # rad/s
    drawn: np.ndarray  # int64, whether it has been asked for that
    leans: np.ndarray  # int64, and lies on a tile that moves, so that forces are no part of it
    pulled: np.ndarray  # int64, the tiles that have
    left: np.ndarray  # int64, the rows that an impact of this substep has left together
    points: np.ndarray  # int64, and which of their points: 1, 2 or 3, and LISTED; 0 of all others
    thrown: np.ndarray  # int64, the rows that an impact of this substep throws on, though pressed
    lost0: np.ndarray  # N s, what their points bore until then; 0 of all others
    lost1: np.ndarray
    lostt: np.ndarray  # N s, and their friction
    was0: np.ndarray  # the feature ids of these points
    was1: np.ndarray
    size: np.ndarray  # int64[6], rows and tiles that take part, tiles that are asked, rows `left`
    # and `thrown`; 1 if an impact of this substep has ended at the limit of its passes


def empty_scratch(n: int, blocks: int) -> Scratch:
    """Scratch of `n` tiles and of `blocks` blocks of rows."""
    whole = {"in_it", "tiles", "struck", "island", "drawn", "leans", "pulled"}
    parts = [empty_queue(WIDE * blocks), *columns(WIDE * blocks, [int, int, float])]
    of_tiles = Scratch._fields[4:Scratch._fields.index("left")]
    parts += columns(n + 1, [int if f in whole else float for f in of_tiles])
    parts += columns(WIDE * blocks, [int, int, int, float, float, float, float, float])
    return Scratch._make([*parts, np.zeros(6, np.int64)])


class Loads(NamedTuple):
    """What acts on the tiles during a substep."""

    h: float  # s, its length
    gain: float  # m, how much further two tiles may come through it than as they go
    fx: np.ndarray  # N
    fy: np.ndarray
    torque: np.ndarray  # N m
    floor: FloorLaw
    end: float  # s, from its middle; inf where nobody looks at the tiles then
    slow: float  # what damping leaves of velocities until then
    slow_spin: float
    early: np.ndarray  # int64[n + 1], how many tiles hit only after that, and which; and ...
    seen: np.ndarray  # float64[6 n], their x, y, angle, vx, vy and omega at the end (SI units)


@inline
def note_seen(loads: Loads, i: int, x: float, y: float, angle: float, vx: float, vy: float,
              w: float) -> None:
    """Note where tile i is at the end of the substep, going like this from its middle on."""
    early, seen, end, m = loads.early, loads.seen, loads.end, loads.early[0]
    early[0], early[m + 1] = m + 1, i
    ux, uy, uw = loads.slow * vx, loads.slow * vy, loads.slow_spin * w
    for f, number in enumerate((x + end * ux, y + end * uy, angle + end * uw, ux, uy, uw)):
        seen[6 * m + f] = number


@apart
def note_early(loads: Loads, v: Bodies, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
               i: int) -> None:
    """Note where tile i will be at the end of the substep, as it hits only after that, if it is
    for the first time: an impact puts it to where its new velocity comes from, within what it
    hits."""
    for j in range(loads.early[0]):
        if loads.early[j + 1] == i:
            return
    note_seen(loads, i, x[i], y[i], angle[i], v.vx[i], v.vy[i], v.w[i])


@inline
def note_before(loads: Loads, v: Bodies, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
                i: int) -> None:
    """Note that tile i goes on as before the solve, if it does for the first time."""
    if v.mobile[i] != 0.0 and v.moved[i] == 0:
        v.moved[i] = 1
        note_seen(loads, i, x[i], y[i], angle[i], v.startx[i], v.starty[i], v.startw[i])


@apart
def spread_early(rows: Rows, k: Numbers, loads: Loads, v: Bodies, u: Bodies, x: np.ndarray,
                 y: np.ndarray, angle: np.ndarray) -> None:
    """Note as well what the tiles that hit after the end have pressed on in the solve, from where
    they go then: it goes on as it did, so that momentum is that of one moment.

    Without forces, so does all that hangs together with one, if contacts have done work on the
    rest: they have not on all of it (`u`: velocities before the solve).
    """
    early, moved, r, body, island, work = (loads.early, v.moved, rows.field, rows.body,
                                           rows.island, v.change)
    set_all(moved, k.n + 1, ZERO)
    for j in range(early[0]):
        moved[early[j + 1]] = 1
    j = 0
    while j < early[0]:
        j += 1
        for p in range(rows.start[early[j]], rows.start[early[j] + 1]):
            at, t = lane_of(rows.of[p]), U(rows.of[p] // WIDE) * BODIES + U(rows.of[p] % WIDE)
            if r[at + PN0] != 0.0 or r[at + PN1] != 0.0 or r[at + PT] != 0.0:
                note_before(loads, v, x, y, angle, body[t])
                note_before(loads, v, x, y, angle, body[t + LANES])
    if loads.gain > 0.0:
        return
    set_all(work, k.n + 1, 0.0)
    for i in range(k.n):
        if v.mobile[i] != 0.0 and moved[i] == 0:
            work[island[i]] += (
                k.mass * ((v.vx[i] - u.vx[i]) * (v.vx[i] + u.vx[i])
                          + (v.vy[i] - u.vy[i]) * (v.vy[i] + u.vy[i]))
                + k.inertia * (v.w[i] - u.w[i]) * (v.w[i] + u.w[i]))
    for j in range(early[0]):
        i = island[early[j + 1]]
        work[i] = math.inf if work[i] > 0.0 else work[i]
    for i in range(k.n):
        if work[island[i]] == math.inf:
            note_before(loads, v, x, y, angle, i)


@apart
def forget_early(rows: Rows, n: int, loads: Loads, shift: Bodies) -> None:
    """Take back the notes of what hangs together with one that projection has moved, as that has
    changed its velocities, too; where forces act, they are moved along."""
    early, seen, island, moved = loads.early, loads.seen, rows.island, shift.moved
    if loads.gain > 0.0:
        for j in range(early[0]):
            i = early[j + 1]
            for f, way in enumerate((shift.vx[i], shift.vy[i], shift.w[i])):
                seen[6 * j + f] += way
        return
    set_all(moved, n + 1, ZERO)
    for j in range(1, early[0] + 1):
        i = early[j]
        if shift.vx[i] != 0.0 or shift.vy[i] != 0.0 or shift.w[i] != 0.0:
            moved[island[i]] = 1
    m = 0
    for j in range(early[0]):
        early[m + 1] = early[j + 1]
        for f in range(6):
            seen[6 * m + f] = seen[6 * j + f]
        m += 1 - moved[island[early[j + 1]]]
    early[0] = m


@lane
def approach(r: np.ndarray, at: int, v: Bodies, a: int, b: int) -> Any:
    """Normal velocities of the points of a row of bodies a and b (m/s), < 0 where they come."""
    along = r[at + NX] * (v.vx[b] - v.vx[a]) + r[at + NY] * (v.vy[b] - v.vy[a])
    return (along + r[at + BN0] * v.w[b] - r[at + AN0] * v.w[a],
            along + r[at + BN1] * v.w[b] - r[at + AN1] * v.w[a])


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
        at, t = lane_of(rows.of[p]), U(rows.of[p] // WIDE) * BODIES + U(rows.of[p] % WIDE)
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
            at, t = lane_of(rows.of[p]), U(rows.of[p] // WIDE) * BODIES + U(rows.of[p] % WIDE)
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
    if most == 0.0:
        return False
    among, held = lies_on(rows, k, v, i, slow, part)
    if among:
        return True
    vx, vy, w = v.vx[i], v.vy[i], v.w[i]
    borne = comes_off(k, k.threshold, corner_speed(k, v, i))
    v.vx[i], v.vy[i], v.w[i] = vx + ux, vy + uy, w + uw
    if held:
        bear(rows, k, v, i, vx, vy, w, borne, BORNE * most)
    return False


@lane
def draw(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray,
         s: np.ndarray, i: int) -> None:
    """Give tile i, once, what forces, floor and what bears it give it in the substep if it meets
    nothing."""
    if v.mobile[i] == 0.0 or z.drawn[i] != 0:
        return
    z.drawn[i] = 1
    z.pulled[z.size[2]] = i
    z.size[2] += 1
    h, floor, im, ii, vx, vy, w = loads.h, loads.floor, k.im, k.ii, v.vx[i], v.vy[i], v.w[i]
    z.leans[i] = 1 if load(rows, k, loads, v, i, math.inf, 0.0) else 0
    tx, ty, tw = v.vx[i], v.vy[i], v.w[i]
    if floor.law != NONE:
        px, py, pt, stops, halts = floor_impulse(
            floor.law, vx, vy, w, tx, ty, tw, 1.0 / im, 1.0 / ii, floor.force * h,
            floor.torque * h, c[i], s[i])
        tx, ty = (0.0 if stops else tx + im * px), (0.0 if stops else ty + im * py)
        tw = 0.0 if halts else tw + ii * pt
    z.gainx[i], z.gainy[i], z.gainw[i] = tx - vx, ty - vy, tw - w
    v.vx[i], v.vy[i], v.w[i] = tx, ty, tw


@inline
def redraw(rows: Rows, k: Numbers, loads: Loads, v: Bodies, z: Scratch, c: np.ndarray,
           s: np.ndarray, i: int, part: float) -> None:
    """The gain of tile i as it goes after an impact, of which it then has this `part` besides:
    friction with the floor is against its new way, and what bore it may have come off.

    What lay on tiles that move, and comes off, has had no part of what forces give it, and is owed
    the whole of it: to take a part from it alone would change the momentum of all.
    """
    h, floor, im, ii, vx, vy, w = loads.h, loads.floor, k.im, k.ii, v.vx[i], v.vy[i], v.w[i]
    if v.mobile[i] == 0.0 or loads.gain == 0.0:  # without forces and floor there is none
        return
    px, py, pt = 0.0, 0.0, 0.0
    if floor.law != NONE:
        px, py, pt = friction_of(floor.law, vx, vy, w, 1.0 / im, 1.0 / ii, floor.force * h,
                                 floor.torque * h, c[i], s[i])
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
def meeting(rows: Rows, block: int, lane: int, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray,
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
    i, t = U(block) * BLOCK + U(lane), U(block) * BODIES + U(lane)
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
            across = nx * uy - ny * ux + bt * w[b] - at * w[a]
            if wall or not glances(k, dx, dy, ca, sa, cb, sb, nx, ny,
                                   vn1 if second else vn0, across, of_a, slow):
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
    i, t = lane_of(row), U(row // WIDE) * BODIES + U(row % WIDE)
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


@inline
def leave_on_arc(rows: Rows, row: int, an: float, bn: float, bend: float, k: Numbers) -> None:
    """The point of a row with these lever arms has been stopped, and leaves along its arc, by
    `bend` (m/s^2): where its tiles now are it has yet to come, which is not to be stopped again."""
    r, at = rows.field, lane_of(row)
    off0 = abs(r[at + AN0] - an) + abs(r[at + BN0] - bn)
    off1 = abs(r[at + AN1] - an) + abs(r[at + BN1] - bn) if r[at + COUNT] == 2.0 else math.inf
    if r[at + COUNT] == 0.0 or min(off0, off1) > SWEPT * k.width:
        return
    if off0 <= off1:
        r[at + WANT0], r[at + BEND0] = max(r[at + WANT0], -r[at + VN0]), bend
    else:
        r[at + WANT1], r[at + BEND1] = max(r[at + WANT1], -r[at + VN1]), bend


@inline
def leave(z: Scratch, row: int, points: int) -> None:
    """Put a row on the list of what impacts of this substep have left together, by these points."""
    if z.points[row] == 0:
        z.left[z.size[3]] = row
        z.size[3] += 1
    z.points[row] |= points | LISTED


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
    yet: where its tiles now are they have not turned further than is told as `SWEPT`."""
    r, at = rows.field, lane_of(row)
    off0 = abs(r[at + AN0] - an) + abs(r[at + BN0] - bn)
    off1 = abs(r[at + AN1] - an) + abs(r[at + BN1] - bn) if r[at + COUNT] == 2.0 else math.inf
    if r[at + COUNT] == 0.0 or min(off0, off1) > SWEPT * k.width:
        return
    leave(z, row, 1 if off0 <= off1 else 2)
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
        at, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
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
    r, at, t = rows.field, lane_of(row), U(row // WIDE) * BODIES + U(row % WIDE)
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


@inline
def corner_speed(k: Numbers, v: Bodies, i: int) -> float:
    """What no corner of a tile is faster than (m/s)."""
    return float(math.sqrt(v.vx[i] * v.vx[i] + v.vy[i] * v.vy[i])
                 + 0.7072 * k.width * abs(v.w[i]))


@inline
def pair_speed(k: Numbers, v: Bodies, a: int, b: int) -> float:
    """What no corner of two bodies is faster than, as seen from the other one (m/s)."""
    ux, uy = v.vx[b] - v.vx[a], v.vy[b] - v.vy[a]
    return float(math.sqrt(ux * ux + uy * uy)
                 + 0.7072 * k.width * (abs(v.w[a]) + abs(v.w[b])))


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
def enter(rows: Rows, q: int, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray,
          y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads,
          begun: float) -> None:
    """Let row q take part in the impact, at its time: without impulses, and its gap may close if it
    hits.

    Its tiles fly on to where they then are, unless neither comes anywhere by then.
    """
    r, body, mobile, time = rows.field, rows.body, v.mobile, z.time[q]
    at, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
    z.rows[z.size[0]] = q
    z.size[0] += 1
    moved, flies = False, time * max(corner_speed(k, v, body[t]), corner_speed(
        k, v, body[t + LANES])) > NOWHERE * k.width
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
        moved |= z.when[i] > 0.0
    hit = r[at + HIT]
    if moved:
        place_again(rows, q, k, k.threshold, 0.0, v, x, y, c, s)
    if r[at + COUNT] != 0.0:
        gap0, gap1 = r[at + GAP0], r[at + GAP1] if r[at + COUNT] == 2.0 else math.inf
        left = max(k.h - time, SAME * k.h) if moved else k.h
        nearest = max(min(gap0, gap1), 0.0) if hit > 0.0 else 0.0
        touch = touching(r, at, k)
        r[at + WANT0] = may_close(gap0, nearest, touch, left, k.width)
        r[at + WANT1] = may_close(gap1, nearest, touch, left, k.width)
        r[at + WANTT] = 0.0
    r[at + HIT] = hit
    r[at + PN0] = r[at + PN1] = r[at + PT] = r[at + BASE] = 0.0


@inline
def nearest_in(rows: Rows, q: int, k: Numbers, v: Bodies, z: Scratch, time: float) -> float:
    """The gap (m) of the nearer point of row q at the time of an impact (s): as its tiles go; or as
    it is, of one that was pressed, and leaves no faster than its arc takes it off, if nothing has
    hit its tiles in this substep, and they do not turn fast: what presses it goes on."""
    r, body, t = rows.field, rows.body, U(q // WIDE) * BODIES + U(q % WIDE)
    at, turn, hit = lane_of(q), 0.0, False
    gap: float = gap_in(r, at + GAP0, time)
    if r[at + COUNT] == 2.0:
        gap = min(gap, gap_in(r, at + GAP1, time))
    if gap <= NOWHERE * k.width or gap > BARELY * k.width:
        return gap
    for i in (body[t], body[t + LANES]):
        if v.mobile[i] != 0.0:
            turn += abs(z.uw[i] if z.in_it[i] != 0 else v.w[i])  # without the impact
            hit |= z.since[i] != 0.0
    if hit or k.h * turn > SWEPT:
        return gap
    leaves = k.tolerance + rocks_off(r, at, k, turn, time)
    if r[at + WARM0] > 0.0 and r[at + VN0] <= leaves:
        gap = min(gap, r[at + GAP0])
    if r[at + WARM1] > 0.0 and r[at + VN1] <= leaves:
        gap = min(gap, r[at + GAP1])
    return gap


@lane
def left_of(k: Numbers, pace: float) -> float:
    """What a solve leaves of an impact that has come as fast as this (m/s)."""
    return min(ROUGH * k.tolerance, max(k.tolerance, SPREAD * pace))


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
            known[q] = 1
            change = solve_row(rows, q, k.per_mass, v)
            if p == 0:
                change = max(change, r[lane_of(q) + BASE] * r[lane_of(q) + K00])
            t = U(q // WIDE) * BODIES + U(q % WIDE)
            fastest = max(pace[body[t]], pace[body[t + LANES]])
            rough = left_of(k, fastest)
            if change <= min(rough, FINE * max(fastest, k.tolerance)):
                continue
            for tile in (body[t], body[t + LANES]):
                if mobile[tile] == 0.0:
                    continue
                pace[tile] = fastest
                for o in range(start[tile], start[tile + 1]):
                    other = of[o]
                    i = lane_of(other)
                    if known[other] == 2 or r[i + COUNT] == 0.0:
                        continue
                    if change <= rough and (known[other] == 0 or r[i + HIT] == 0.0):
                        continue
                    if known[other] == 0:
                        gap = nearest_in(rows, other, k, v, z, z.time[q])
                        if gap > touching(r, i, k) and z.points[other] & 3 == 0:
                            continue  # what is thrown at it hits it in the next round
                        z.time[other] = z.time[q]
                        enter(rows, other, k, v, z, x, y, angle, c, s, loads, begun)
                    known[other] = 2
                    then[m] = other
                    m += 1
        if m == 0:
            break
        for j in range(m):
            now[j] = then[j]
        size = m
    z.size[5] |= 1 if m > 0 else 0
    for j in range(size):
        known[now[j]] = 1


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
        i, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
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
def company(rows: Rows, tile: int, row: int, k: Numbers, z: Scratch) -> int:
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
        gap = min(r[i + GAP0] if first and (pressed or r[i + VN0] <= slow) else math.inf,
                  r[i + GAP1] if second and (pressed or r[i + VN1] <= slow) else math.inf)
        if left != 0 or gap < touching(r, i, k):
            return TOGETHER
    return ALONE


@inline
def beside(rows: Rows, row: int, k: Numbers, mobile: np.ndarray, z: Scratch) -> bool:
    """Whether a tile of a row that may hit does so with another row at the same time: what comes to
    lie across the joint of two tiles hits one of these with next to no width."""
    t = U(row // WIDE) * BODIES + U(row % WIDE)
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
    block, lane, body = row // WIDE, row % WIDE, rows.body
    t = U(block) * BODIES + U(lane)
    a, b = U(body[t]), U(body[t + LANES])
    draw(rows, k, loads, v, z, c, s, a)
    draw(rows, k, loads, v, z, c, s, b)
    how, meet = meeting(rows, block, lane, k, v, z, x, y, angle, c, s, loads.h, 0.0)
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
        at, t = lane_of(row), U(row // WIDE) * BODIES + U(row % WIDE)
        a, b, hit = body[t], body[t + LANES], r[at + HIT]
        if hit == 0.0:  # no longer, after another impact
            continue
        if max(z.struck[a] * mobile[a], z.struck[b] * mobile[b]) >= OFTEN:
            r[at + HIT] = 0.0
            continue
        if row != known or points + size > 0:  # its tiles may go otherwise than they did
            how, meet = meeting(rows, row // WIDE, row % WIDE, k, v, z, x, y, angle, c, s, loads.h,
                                queue.time[row])
            known = row
        if how >= LATER or (hit < 0.0 and beside(rows, row, k, mobile, z)):
            fly_on(r, at, k.h)
            continue
        z.struck[a] += 1
        z.struck[b] += 1
        for tile in (a, b):
            how = max(how, company(rows, tile, row, k, z) if mobile[tile] != 0.0 else ALONE)
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
        at, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
        a, b = U(body[t]), U(body[t + LANES])
        vn0, vn1 = approach(r, at, v, a, b)
        e, spin, left = r[at + E], abs(v.w[a]) + abs(v.w[b]), z.time[q] - k.h
        back = ((1 if is_back(k, e, vn0, left * r[at + BEND0], spin) else 0)
                + (2 if is_back(k, e, vn1, left * r[at + BEND1], spin) else 0))
        stay = (1 if vn0 <= slow else 0) + (2 if vn1 <= slow else 0)
        if stay != 0 and (k.h * spin > SWEPT or clears(
                rows, q, k, v, x, y, c, s, k.h * v.w[a], k.h * v.w[b], k.h, NOWHERE * k.width)):
            stay = 0
        z.points[q] &= stay | back | LISTED


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
def together(rows: Rows, k: Numbers, v: Bodies, z: Scratch, x: np.ndarray, y: np.ndarray,
             angle: np.ndarray, c: np.ndarray, s: np.ndarray, loads: Loads, begun: float,
             size: int) -> None:
    """Impulses of the `size` rows in ``rows.now``, that hit together, the first of them at the time
    `begun` (s), and of what they reach."""
    r, body = rows.field, rows.body
    z.size[0] = z.size[1] = 0
    for j in range(size):
        q = rows.now[j]
        at, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
        pace = max(-r[at + VN0], -r[at + VN1] if r[at + COUNT] == 2.0 else 0.0)
        enter(rows, q, k, v, z, x, y, angle, c, s, loads, begun)
        z.known[q] = 2
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
    size = ZERO
    for j in range(z.size[0]):
        q = z.rows[j]
        at, t = lane_of(q), U(q // WIDE) * BODIES + U(q % WIDE)
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
            z.known[q] = 2
            rows.now[size] = q
            size += 1
    if size > 0:
        before = z.size[1]
        settle(rows, k, v, z, x, y, angle, c, s, loads, begun, size)
        for j in range(before, z.size[1]):  # tiles that only this phase has reached
            i = z.tiles[j]
            z.most[i] = 0.5 * (k.mass * (z.ux[i] * z.ux[i] + z.uy[i] * z.uy[i])
                               + k.inertia * z.uw[i] * z.uw[i])
        limit_energy(rows, k, v, z)

    leave_together(rows, k, v, z, x, y, c, s)
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
        for p in range(rows.start[i], rows.start[i + 1]):
            at = lane_of(rows.of[p])
            if r[at + COUNT] != 0.0:  # bends were those of other spins
                r[at + BEND0] = r[at + BEND1] = r[at + WANTT] = 0.0
                r[at + WANT0] = max(r[at + GAP0], 0.0) / k.h
                r[at + WANT1] = max(r[at + GAP1], 0.0) / k.h
    for j in range(z.size[1]):  # and back
        i, time = z.tiles[j], z.when[z.tiles[j]]
        redraw(rows, k, loads, v, z, c, s, i, z.part[i])
        share(v, z, i, -z.part[i])
        if time > 0.0:
            x[i] -= time * v.vx[i]
            y[i] -= time * v.vy[i]
            angle[i] -= time * v.w[i]
            c[i], s[i] = cos_sin(angle[i])
            z.since[i] = time
    # They hit next what is near, or what they are fast enough for, as they go now.
    far = SPARE * k.width
    for j in range(z.size[1]):
        i = z.tiles[j]
        every = z.when[i] > 0.0 or k.h * corner_speed(k, v, i) > far
        for p in range(rows.start[i], rows.start[i + 1]):
            q = rows.of[p]
            t = U(q // WIDE) * BODIES + U(q % WIDE)
            other = body[t + LANES] if body[t] == i else body[t]
            at = lane_of(q)
            if z.in_it[other] != 2 and (every or r[at + GAP0] < far or r[at + COUNT] != 0.0
                                        or r[at + HIT] != 0.0):
                look_again(rows, q, k, k.threshold + left_of(k, z.pace[i]), loads, v, z, x, y,
                           angle, c, s)
        z.in_it[i] = 2  # its rows are done
    for j in range(z.size[1]):
        z.in_it[z.tiles[j]] = 0
