"""Magnet forces: F = p alpha / (r + beta)^2, faded out smoothly before the cut-off.

The switch S(u) = 1 - 10 u^3 + 15 u^4 - 6 u^5 runs from 1 to 0 over the last part of the cut-off;
force and first two derivatives are continuous there, so nothing jumps and energy is kept.

Forces are those of the middle of the time that they act for; where two tiles turn far in it as seen
from each other, their mean is put in place of these (`mean_forces.py`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns, copy, lean
from tbsa.kernels.crew import (
    LEAST_PAIRS,
    LEAST_ROOM,
    LEAST_TILES,
    LINE,
    LIST,
    PULL,
    REACT,
    TOTAL,
    Crew,
    collect,
    give,
    share,
)
from tbsa.kernels.jit import ZERO, U, inline, kernel, lane, rolled
from tbsa.kernels.neighbours import Pairs, first_of

CHUNK = 512  # pairs that are worked on together, in the first-level cache
PORTION = 64 * CHUNK  # pairs that threads share, for some tens of microseconds each
FEW, WAY = 64, 18 * 64  # pairs that are where tiles turn far, and numbers of these
# Lists reach further by this (fraction), as they are made in single precision, which is enough and
# twice as fast, and as magnets of a block may be as far apart as the cut-off, by default a tile's
# width: rounding is not to decide whether a list has them.
SINGLE = 1e-6


class MagnetLaw(NamedTuple):
    """Numbers of the force law; `cutoff` 0 where the scene has no magnets."""

    alpha: float  # N m^2
    beta: float  # m
    offset: float  # m from the tile's centre to a magnet
    cutoff: float  # m
    fade: float  # m, where the switch begins
    mismatch: float  # p of two glues that do not attract


@lane
def switch(u: float) -> float:
    """S(u) above, 1 for u <= 0 and 0 for u >= 1."""
    u = min(max(u, 0.0), 1.0)
    return 1.0 - u * u * u * (10.0 + u * (6.0 * u - 15.0))


@lane
def pull_of(strength: float, r: float, fade: float, per_fade: float, beta: float) -> float:
    """Force of two magnets over their distance r (N/m); two in one place have no direction, and
    contact pushes such tiles apart."""
    f = strength * switch((r - fade) * per_fade)
    return float(f / (max(r, 1e-300) * (r + beta) * (r + beta)))


@lane
def polarity(glue_a: int, glue_b: int, mismatch: float) -> float:
    """p: +1 where g meets -g, 0 without a magnet, else `mismatch`."""
    p = 1.0 if glue_a == -glue_b else mismatch
    return p if glue_a * glue_b != 0 else 0.0


class MagnetPairs(NamedTuple):
    """Magnet pairs that may be in reach of each other, and forces on magnets.

    Magnet 4 i + edge (N, E, S, W) belongs to tile i.  A pair beyond the cut-off adds nothing,
    and pairs are in the order of their tiles, whatever the age of the list.
    """

    a: np.ndarray  # int32, tile pairs whose magnets may be in reach, a < b
    b: np.ndarray
    which: np.ndarray  # int32, their magnet pairs that may be, as bits 4 edge of a + edge of b
    dx: np.ndarray  # float32[CHUNK], m, scratch of each thread: from a to b
    dy: np.ndarray
    r2: np.ndarray  # m^2, square of the distance at which their magnets are listed
    ca: np.ndarray  # m, the magnets' arms
    sa: np.ndarray
    cb: np.ndarray
    sb: np.ndarray
    p: np.ndarray  # int32[room], magnets of a and of b
    q: np.ndarray
    strength: np.ndarray  # float64[room], N m^2, polarity times alpha
    room: int
    size: np.ndarray  # int64[1], magnet pairs
    turns: np.ndarray  # int64[n], scratch: 1 for tiles that turn far
    some: np.ndarray  # int32[CHUNK], ... pairs of these, out of as many
    far: np.ndarray  # int32[FEW], ... some of those that turn far as seen from each other
    ways: np.ndarray  # float64[WAY], ... and how they go, by fields of FEW (mean_forces.py)
    x: np.ndarray  # float64[n], m, rad, where the tiles were when they were listed
    y: np.ndarray
    angle: np.ndarray
    way: np.ndarray  # float64[n], m, how far the centre of each may go
    margin: np.ndarray  # float64[n], m, ... and its magnets; -1: never listed
    hx: np.ndarray  # float64[CHUNK or PORTION], scratch: from p to q (m), then force on p (N)
    hy: np.ndarray
    ax: np.ndarray  # float64[4 n], m, magnets as seen from the tiles' centres
    ay: np.ndarray
    m: np.ndarray  # float64[8 n], m, where they are: x and y by turns, which are read together
    # float64[8 n], N, forces on them, likewise; of several threads, of which each adds a component,
    # all x before all y, or they would write to the same lines of the cache by turns
    g: np.ndarray


def empty_magnet_pairs(n: int, pairs: int, capacity: int, threads: int = 1) -> MagnetPairs:
    """Space for `pairs` pairs of `n` tiles and `capacity` pairs of their magnets; none listed."""
    part = columns(CHUNK * threads, [np.float32] * 7)
    hx, hy = columns(CHUNK if threads == 1 else PORTION, [float] * 2)
    # Half as wide as other whole numbers: these are the longest lists of a large scene.
    lists = [np.zeros(size, np.int32) for size in [pairs] * 3 + [capacity] * 2]
    near = MagnetPairs._make([
        *lists[:3], *part, *lists[3:], np.zeros(capacity), capacity,
        np.zeros(1, np.int64), np.zeros(n, np.int64), np.zeros(CHUNK, np.int32),
        np.zeros(FEW, np.int32), np.zeros(WAY), *columns(n, [float] * 5),
        hx, hy, *columns(4 * n, [float] * 2), *columns(8 * n, [float] * 2)])
    near.margin[:] = -1.0
    return near


# How many of four bits are set.
NUMBER = np.array([bin(bits).count("1") for bits in range(16)])


@lane
def four(ux: float, uy: float, cd: float, sd: float, r2: float) -> int:
    """Which magnets of a tile are near a point, as bits; u leads from there to its centre."""
    north = (ux - sd) * (ux - sd) + (uy + cd) * (uy + cd) < r2
    east = (ux + cd) * (ux + cd) + (uy + sd) * (uy + sd) < r2
    south = (ux + sd) * (ux + sd) + (uy - cd) * (uy - cd) < r2
    west = (ux - cd) * (ux - cd) + (uy - sd) * (uy - sd) < r2
    return ((1 if north else 0) | (2 if east else 0) | (4 if south else 0) | (8 if west else 0))


@rolled
def magnets_stale(near: MagnetPairs, n: int, offset: float, x: np.ndarray, y: np.ndarray,
                  angle: np.ndarray, way: np.ndarray, far: np.ndarray) -> bool:
    """Whether a tile needs a new list whose centre goes so far from here, and its magnets (m)."""
    px, py, was, centre, margin = near.x, near.y, near.angle, near.way, near.margin
    some = 0
    for i in range(U(n)):
        dx, dy, turned = x[i] - px[i], y[i] - py[i], offset * abs(angle[i] - was[i])
        room = min(margin[i] - far[i] - turned, centre[i] - way[i])
        some += 0 if (room >= 0.0) & (dx * dx + dy * dy <= room * room) else 1
    return some > 0


@rolled
def place_magnets(near: MagnetPairs, offset: float, x: np.ndarray, y: np.ndarray,
                  c: np.ndarray, s: np.ndarray, begin: int, end: int) -> None:
    """Where the magnets of these tiles are: N, E, S, W of every one.  No forces on them yet."""
    ax, ay, m, g = near.ax, near.ay, near.m, near.g
    for i in range(U(8) * U(begin), U(8) * U(end)):
        g[i] = 0.0
    for i in range(U(begin), U(end)):
        k, cd, sd = U(4) * i, c[i] * offset, s[i] * offset
        ax[k], ay[k] = -sd, cd
        ax[k + U(1)], ay[k + U(1)] = cd, sd
        ax[k + U(2)], ay[k + U(2)] = sd, -cd
        ax[k + U(3)], ay[k + U(3)] = -cd, -sd
        k *= U(2)
        m[k], m[k + U(1)] = x[i] - sd, y[i] + cd
        m[k + U(2)], m[k + U(3)] = x[i] + cd, y[i] + sd
        m[k + U(4)], m[k + U(5)] = x[i] + sd, y[i] - cd
        m[k + U(6)], m[k + U(7)] = x[i] - cd, y[i] - sd


@inline
def list_magnets(law: MagnetLaw, pairs: Pairs, n: int, glues: np.ndarray, x: np.ndarray,
                 y: np.ndarray, angle: np.ndarray, c: np.ndarray, s: np.ndarray,
                 way: np.ndarray, margin: np.ndarray, near: MagnetPairs, crew: Crew) -> int:
    """List the magnet pairs nearer than the cut-off and both margins (m).

    `way` are the margins of the centres: turning does not bring magnets nearer than these do.

    Returns the number of them; where that exceeds the capacity the list is of no use.
    """
    room = near.room
    at, end = give(crew, LIST, ZERO, room, LEAST_ROOM)
    total, m = magnets_from(law, pairs, n, glues, x, y, c, s, way, margin, near, ZERO,
                            crew.size if end < room else 1, at, end)
    collect(crew)
    for other in range(1, crew.size if end < room else 1):
        more, kept = crew.found[other * LINE], crew.found[other * LINE + 1]
        at, _ = share(crew, other, ZERO, room)
        total += more
        if total <= room:
            for i in range(U(kept)):
                to, by = U(m) + i, U(at) + i
                near.p[to], near.q[to], near.strength[to] = (near.p[by], near.q[by],
                                                             near.strength[by])
        m += kept
    near.size[0] = m
    copy(x, near.x, n)
    copy(y, near.y, n)
    copy(angle, near.angle, n)
    copy(way, near.way, n)
    copy(margin, near.margin, n)
    return int(total)


@lane
def magnets_from(law: MagnetLaw, pairs: Pairs, n: int, glues: np.ndarray, x: np.ndarray,
                 y: np.ndarray, c: np.ndarray, s: np.ndarray, way: np.ndarray,
                 margin: np.ndarray, near: MagnetPairs, me: int, threads: int, at: int,
                 end: int) -> Any:
    """List the magnet pairs of one of so many shares of the tiles, from place `at` to `end`.

    Returns the number of them, and of those with a force; where that exceeds the capacity of the
    whole list the list is of no use.
    """
    start, other = pairs.start, pairs.other
    of_a, of_b, which, mp, mq, strength = near.a, near.b, near.which, near.p, near.q, near.strength
    d, first, last = law.offset, first_of(pairs, n, me, threads), first_of(pairs, n, me + 1,
                                                                          threads)
    more = 1.0 + SINGLE
    begin: Any = U(start[first])  # no share has more pairs of tiles than are on their list
    found: Any = begin
    for a in range(first, last):
        for k in range(start[a], start[a + 1]):
            b = U(other[k])
            rx, ry = x[b] - x[a], y[b] - y[a]
            reach = more * (law.cutoff + 2.0 * d + way[a] + way[b])
            # Written in any case and kept by moving on, as no branch can be foreseen.
            of_a[found], of_b[found] = a, other[k]
            found += U(rx * rx + ry * ry < reach * reach)
    dx, dy, r2, ca, sa, cb, sb = near.dx, near.dy, near.r2, near.ca, near.sa, near.cb, near.sb
    h = U(me) * U(CHUNK)
    for start_of_part in range(begin, found, CHUNK):
        o, part = U(start_of_part), min(found - U(start_of_part), U(CHUNK))
        for i in range(part):
            u, ta, tb = h + i, U(of_a[o + i]), U(of_b[o + i])
            dx[u], dy[u] = x[tb] - x[ta], y[tb] - y[ta]
            reach = more * (law.cutoff + margin[ta] + margin[tb]) + 4.0 * SINGLE * d
            r2[u] = reach * reach
            ca[u], sa[u], cb[u], sb[u] = d * c[ta], d * s[ta], d * c[tb], d * s[tb]
        for i in range(part):  # without branches, on its own: it vectorises, and takes an eighth
            u = h + i
            which[o + i] = (four(dx[u] + sa[u], dy[u] - ca[u], cb[u], sb[u], r2[u])
                            | four(dx[u] - ca[u], dy[u] - sa[u], cb[u], sb[u], r2[u]) << 4
                            | four(dx[u] - sa[u], dy[u] + ca[u], cb[u], sb[u], r2[u]) << 8
                            | four(dx[u] + ca[u], dy[u] + sa[u], cb[u], sb[u], r2[u]) << 12)
    total = 0
    for k in range(begin, found):
        bits = which[k]
        total += (NUMBER[U(bits & 15)] + NUMBER[U(bits >> 4 & 15)] + NUMBER[U(bits >> 8 & 15)]
                  + NUMBER[U(bits >> 12)])
    if total + 16 > end - at:
        return total + 16 + near.room - (end - at), 0
    m: Any = U(at)
    for k in range(begin, found):
        p, q, bits = 4 * of_a[k], 4 * of_b[k], which[k]
        for i in range(4):
            row = bits >> 4 * i & 15
            if row != 0:
                for j in range(4):
                    mp[m], mq[m] = p + i, q + j
                    m += U(row >> j & 1)
    for i in range(U(at), m):
        strength[i] = law.alpha * polarity(glues[U(mp[i])], glues[U(mq[i])], law.mismatch)
    if law.mismatch == 0.0:
        listed, m = m, U(at)
        for i in range(U(at), listed):
            mp[m], mq[m], strength[m] = mp[i], mq[i], strength[i]
            m += U(strength[i] != 0.0)
    return int(total), int(m) - at


@lane
def pull(law: MagnetLaw, near: MagnetPairs, portion: int, begin: int, end: int) -> None:
    """The forces of these magnet pairs, into scratch that begins with pair `portion`."""
    mp, mq, strength, hx, hy = near.p, near.q, near.strength, near.hx, near.hy
    m, fade, beta = near.m, law.fade, law.beta
    per_fade = 1.0 / max(law.cutoff - fade, 1e-300)
    for start in range(begin, end, CHUNK):
        o, h, part = U(start), U(start - portion), U(min(end - start, CHUNK))
        for i in range(part):
            p, q = U(2) * U(mp[o + i]), U(2) * U(mq[o + i])
            hx[h + i], hy[h + i] = m[q] - m[p], m[q + U(1)] - m[p + U(1)]
        for i in range(part):  # on its own, so that it vectorises: 1.2 ns a pair instead of 3.5
            rx, ry = hx[h + i], hy[h + i]
            f = pull_of(strength[o + i], math.sqrt(rx * rx + ry * ry), fade, per_fade, beta)
            hx[h + i], hy[h + i] = f * rx, f * ry


@lane
def react(near: MagnetPairs, n: int, alone: bool, begin: int, end: int, along_x: bool,
          along_y: bool) -> None:
    """Add the forces of these magnet pairs to those on both magnets, or one component of them.

    Always in the order of the pairs: of two threads each takes a component.
    """
    mp, mq, hx, hy, g = near.p, near.q, near.hx, near.hy, near.g
    o, part = U(begin), U(end - begin)
    if alone:  # both at once, as they stand together
        for i in range(part):
            p, q, fx, fy = U(2) * U(mp[o + i]), U(2) * U(mq[o + i]), hx[i], hy[i]
            px, py = g[p] + fx, g[p + U(1)] + fy
            g[p], g[p + U(1)] = px, py
            qx, qy = g[q] - fx, g[q + U(1)] - fy
            g[q], g[q + U(1)] = qx, qy
        return
    if along_x:
        for i in range(part):
            g[U(mp[o + i])] += hx[i]
            g[U(mq[o + i])] -= hx[i]
    if along_y:
        y = U(4) * U(n)
        for i in range(part):
            g[y + U(mp[o + i])] += hy[i]
            g[y + U(mq[o + i])] -= hy[i]


@lane
def sum_of(near: MagnetPairs, i: int, x: int, y: int, step: int) -> Any:
    """Force on tile i (N) and torque (N m) of the forces on its magnets, whose components begin at
    these places and are as far apart."""
    ax, ay, g, k = near.ax, near.ay, near.g, U(4) * i
    x1, x2, x3 = x + step, x + U(2) * step, x + U(3) * step
    y1, y2, y3 = y + step, y + U(2) * step, y + U(3) * step
    t = ax[k] * g[y] - ay[k] * g[x]
    t += ax[k + U(1)] * g[y1] - ay[k + U(1)] * g[x1]
    t += ax[k + U(2)] * g[y2] - ay[k + U(2)] * g[x2]
    t += ax[k + U(3)] * g[y3] - ay[k + U(3)] * g[x3]
    return (g[x] + g[x1]) + (g[x2] + g[x3]), (g[y] + g[y1]) + (g[y2] + g[y3]), t


@rolled
def add_up(near: MagnetPairs, n: int, alone: bool, fx: np.ndarray, fy: np.ndarray,
           torque: np.ndarray, begin: int, end: int) -> None:
    """Add the forces on the magnets of these tiles, which one thread has put there `alone` or two
    by components, to those on the tiles."""
    if alone:
        for i in range(U(begin), U(end)):
            px, py, t = sum_of(near, i, U(8) * i, U(8) * i + U(1), U(2))
            fx[i] += px
            fy[i] += py
            torque[i] += t
        return
    for i in range(U(begin), U(end)):
        px, py, t = sum_of(near, i, U(4) * i, U(4) * (U(n) + i), U(1))
        fx[i] += px
        fy[i] += py
        torque[i] += t


@inline
def add_magnet_forces(law: MagnetLaw, n: int, near: MagnetPairs, fx: np.ndarray, fy: np.ndarray,
                      torque: np.ndarray, crew: Crew) -> None:
    """Add the forces of all listed pairs, applied at the magnets, to the tiles' (N, N m)."""
    size, at_once = near.size[0], CHUNK if crew.size == 1 else PORTION
    for portion in range(0, size, at_once):
        last = min(portion + at_once, size)
        begin, end = give(crew, PULL, portion, last, LEAST_PAIRS)
        pull(law, near, portion, begin, end)
        collect(crew)
        give(crew, REACT, portion, last, LEAST_PAIRS)
        react(near, n, crew.size == 1, portion, last, True, end == last)
        collect(crew)
    begin, end = give(crew, TOTAL, ZERO, n, LEAST_TILES)
    add_up(near, n, crew.size == 1, fx, fy, torque, begin, end)
    collect(crew)


@kernel
def magnet_forces(law: MagnetLaw, pairs: Pairs, glues: np.ndarray, x: np.ndarray, y: np.ndarray,
                  angle: np.ndarray, c: np.ndarray, s: np.ndarray, margin: np.ndarray,
                  near: MagnetPairs, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray,
                  crew: Crew) -> int:
    """Add the forces of all magnets on the tiles at x, y, angle (of cosine c and sine s); `pairs`
    must be up to date, and `margin` is how far (m) the list of magnets is to reach further.

    Returns the number of magnet pairs; where that exceeds the capacity nothing was added.
    """
    n = x.size
    pairs, near, crew, glues = lean(pairs), lean(near), lean(crew), lean(glues)
    x, y, angle, c, s, margin = lean(x), lean(y), lean(angle), lean(c), lean(s), lean(margin)
    fx, fy, torque = lean(fx), lean(fy), lean(torque)
    m = list_magnets(law, pairs, n, glues, x, y, angle, c, s, margin, margin, near, crew)
    if m <= near.room:
        place_magnets(near, law.offset, x, y, c, s, 0, n)
        add_magnet_forces(law, n, near, fx, fy, torque, crew)
    return int(m)
