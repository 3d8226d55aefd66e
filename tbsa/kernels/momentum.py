"""Passes with momentum: each goes on from a point beyond where the last one ended.

Gauss-Seidel hands a load on from contact to contact; what many rows carry in common, as the load
of a long row of tiles does, settles so in a tenth of the passes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tbsa.kernels.arrays import copy
from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.crew import Crew
from tbsa.kernels.jit import YES, ZERO, U, apart, inline, lane, rolled
from tbsa.kernels.manifold import push
from tbsa.kernels.rows import (
    BASE,
    BLOCK,
    COLOURS,
    COUNT,
    HIT,
    IDLE,
    K00,
    K11,
    KTT,
    LANES,
    MU,
    NEAR_ROWS,
    PN0,
    PN1,
    PT,
    VN0,
    VN1,
    WARM0,
    WARM1,
    WARMT,
    WIDE,
    Rows,
    bodies_of,
    lane_of,
)
from tbsa.kernels.sweeps import (
    LITTLE,
    MANY,
    gather,
    gather_row,
    part_of,
    queue,
    queue_changed,
    row_change,
    scatter,
    scatter_row,
    solve_partly,
    solve_row,
    sweep_rows,
)

# Passes before the impulses have momentum, all of them forward, and passes at the limit that have
# none any more: a solve that is broken off must not end on its way.
PLAIN, LAST_PLAIN = 4, 4
# Momentum ends where it has begun anew more often than this in a row without a pass that did less
# than this part of the least one: friction above 0.9 may couple what it pulls to and fro, and
# passes go on in a circle.
OFTEN, NEARER = 4, 0.9
# Impulses at the beginning of a pass, and at the end of the one before: fields that a solve has no
# other use for.
FROM0, FROM1, FROMT = WARM0, WARM1, WARMT
PAST0, PAST1, PASTT = VN0, VN1, HIT
SOLVED = 2  # on the list of this pass, in ``queued``; 1: of the next; 3: of both


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
def sweep_on(rows: Rows, size: int, k: Numbers, v: Bodies, little: float, part: float) -> Any:
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
        change = row_change(r, i, k, solve_row(rows, q, k.per_mass, v) if part == 1.0
                            else solve_partly(rows, q, k.per_mass, part, v))
        more, further = slope(r, i)
        square += more
        onward += further
        worst = max(worst, change)
        if change <= little:
            continue
        t = bodies_of(q)
        m = queue(rows, v, body[t], m)
        m = queue(rows, v, body[t + LANES], m)
    return m, worst, square, onward


@lane
def set_past(r: np.ndarray, k: int) -> None:
    """The last pass left the row of lane k where it is."""
    r[k + PAST0], r[k + PAST1], r[k + PASTT] = r[k + PN0], r[k + PN1], r[k + PT]


@inline
def go_on_queue(rows: Rows, size: int, m: int, beta: float, k: Numbers, v: Bodies,
                little: float) -> int:
    """The rows of this list that are on the next one, too, go on; returns the length of that."""
    body, now, queued = rows.body, rows.now, rows.queued
    vx, vy, w = v.vx, v.vy, v.w
    for j in range(size):
        q = now[j]
        i = gather_row(rows, q, vx, vy, w)
        change = row_change(rows.field, i, k, go_on(
            rows.field, i, beta if queued[q] > SOLVED else 0.0, k.per_mass))
        scatter_row(rows, q, vx, vy, w)
        if change <= little:
            continue
        t = bodies_of(q)
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


@rolled
def begin_lanes(r: np.ndarray, o: int, fresh: bool) -> None:
    """Note the impulses of the block at `o` before a pass, and if it is the first one with
    momentum, as those of the pass before as well."""
    for i in range(LANES):
        k = o + i
        q0, q1, qt = r[k + PN0], r[k + PN1], r[k + PT]
        r[k + FROM0], r[k + FROM1], r[k + FROMT] = q0, q1, qt
        r[k + PAST0] = q0 if fresh else r[k + PAST0]
        r[k + PAST1] = q1 if fresh else r[k + PAST1]
        r[k + PASTT] = qt if fresh else r[k + PASTT]


@inline
def begin_blocks(rows: Rows, fresh: bool) -> None:
    """`begin_lanes` of all blocks in which something touches; the others have no impulses."""
    for block in range(rows.first[COLOURS]):
        if rows.single[block] != IDLE:
            begin_lanes(rows.field, U(block) * BLOCK, fresh)


@inline
def slope_blocks(rows: Rows) -> Any:
    """`slope`, summed over all rows."""
    r = rows.field
    square, onward = 0.0, 0.0
    for block in range(rows.first[COLOURS]):
        if rows.single[block] == IDLE:
            continue
        o = U(block) * BLOCK
        for i in range(LANES):
            more, further = slope(r, o + i)
            square += more
            onward += further
    return square, onward


@rolled
def go_on_lanes(r: np.ndarray, o: int, beta: float, per_mass: float) -> None:
    """`go_on` for the lanes of the block at `o`."""
    for i in range(LANES):
        go_on(r, o + i, beta, per_mass)


@inline
def go_on_blocks(rows: Rows, beta: float, per_mass: float, v: Bodies) -> None:
    """All rows go on."""
    r, vx, vy, w = rows.field, v.vx, v.vy, v.w
    far = rows.first[NEAR_ROWS]  # blocks, that may share tiles
    for block in range(far, rows.first[COLOURS]):
        if rows.single[block] != IDLE:
            gather(rows, block, vx, vy, w)
            go_on_lanes(r, U(block) * BLOCK, beta, per_mass)
            scatter(rows, block, vx, vy, w)
    for q in range(WIDE * far):
        if r[lane_of(q) + COUNT] != 0.0:
            go_on(r, gather_row(rows, q, vx, vy, w), beta, per_mass)
            scatter_row(rows, q, vx, vy, w)


@apart
def hasten(rows: Rows, m: int, k: Numbers, v: Bodies, whole: bool, size: int, crew: Crew) -> int:
    """Go on with `relax` where there is no floor friction: with momentum.

    It grows from pass to pass, and begins anew where it has gone too far, or where a pass did more
    than the one before (the restarts of O'Donoghue and Candes 2015), until that is in vain
    (`OFTEN`).  A solve has ended with a pass after a plain one.
    """
    now, queued = rows.now, rows.queued
    tolerance, little = k.tolerance, LITTLE * k.tolerance
    done, fresh = -1 - k.passes, YES
    age, before, beta, vain, least = ZERO, math.inf, 0.0, ZERO, math.inf
    for j in range(size):
        set_past(rows.field, lane_of(now[j]))
    for p in range(PLAIN, k.passes):
        rows.effort[0] += m
        if whole:
            for j in range(size):
                queued[now[j]] = 0
            begin_blocks(rows, fresh)
            many, worst = sweep_rows(rows, k, v, YES, crew)
            square, onward = slope_blocks(rows)
            whole = ((k.skip_converged == 0 or MANY * many > rows.first[COLOURS])
                     and part_of(k, vain > OFTEN) == 1.0)
            found = ZERO if whole else queue_changed(rows, k.n, ZERO, v, little)
            size = ZERO
        else:
            rows.effort[1] += m - size
            found, worst, square, onward = sweep_on(rows, size, k, v, little,
                                                    part_of(k, vain > OFTEN))
        settled = worst <= tolerance and beta == 0.0
        age = age + 1 if onward >= 0.0 and square <= before else ZERO
        before = square
        if age == 0 and vain <= OFTEN:
            vain = vain + 1 if square > NEARER * least else ZERO
            least = min(least, square)
        age = age if vain <= OFTEN else ZERO
        beta = age / (age + 3.0) if worst > tolerance and p + 1 + LAST_PLAIN < k.passes else 0.0
        fresh = beta == 0.0
        if whole and not fresh:
            go_on_blocks(rows, beta, k.per_mass, v)
        elif not whole:
            listed = size > 0
            if listed and not fresh:
                found = go_on_queue(rows, size, found, beta, k, v, little)
            next_queue(rows, size, found, fresh)
            size = found
            whole = (listed and size > rows.first[COLOURS]
                     and part_of(k, vain > OFTEN) == 1.0)
            fresh = fresh or whole  # what was not on the list has no past
        if settled:
            done = p + 1
            break
    for j in range(size):
        queued[now[j]] = 0
    return done
