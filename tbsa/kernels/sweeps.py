"""Passes: over all blocks of rows and the floor below all tiles, or over those on a list.

A row is on the list of the next pass if a tile of it has been moved by more than a little, so that
converged parts of a scene drop out.  What is little depends on how fast the tiles are, as where
differential equations are solved with a relative and an absolute tolerance: changes of velocities
are noted as if they were those of fast tiles, which have the whole tolerance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tbsa.kernels.bodies import Bodies, Numbers
from tbsa.kernels.crew import (
    APPLY,
    FLOOR,
    LEAST_BLOCKS,
    LEAST_TILES,
    LINE,
    SWEEP,
    Crew,
    collect,
    give,
)
from tbsa.kernels.floor import (
    SEPARATE,
    FloorLaw,
    floor_impulse,
    impulse_of_turn,
    turns,
)
from tbsa.kernels.jit import ZERO, U, apart, inline, lane, rolled
from tbsa.kernels.manifold import push, solve_lanes
from tbsa.kernels.rows import (
    AW,
    AX,
    AY,
    BLOCK,
    BODIES,
    BW,
    BX,
    BY,
    CHANGE,
    CHUNK,
    COLOURS,
    COUNT,
    FAR_ROWS,
    IDLE,
    LANES,
    LONE_ROWS,
    PN0,
    PN1,
    PT,
    WIDE,
    Rows,
    bodies_of,
    lane_of,
)

# A row is solved again if its tiles have been moved by more than this part of the tolerance: each
# has several rows, and each of them leaves something.
LITTLE = 0.5
# Of the speed of its tiles a row may be left this part; the tolerance at most, and what tiles at
# rest have at least.
LEFT = 0.5
# In place of a change: a row has moved the tile by little since its floor has been solved.
STALE = 1e30
# Friction above which two contacts that slide on one tile may go to and fro, after how many passes
# of a solve that is looked for, and what part of its change a row then makes.
GRIPS, LONG, PART = 0.6, 12, 0.65
MANY = 16 // WIDE  # rows that are woken by one that has changed, for a block in the time of a row


@lane
def as_fast(k: Numbers, change: float, speed: float) -> float:
    """A change of a velocity (m/s) as it counts, for a tile of this speed (m/s): none where it is
    little, else the tolerance, or more than that; nobody asks by how much."""
    left = min(max(k.at_rest * k.tolerance, LEFT * speed), k.tolerance)
    much = k.tolerance if change <= left else 2.0 * k.tolerance
    return 0.0 if change <= LITTLE * left else much


@lane
def speed_of(vx: float, vy: float, w: float, width: float) -> float:
    """Speed of a tile (m/s), by its larger part: along x, along y, or of the middle of an edge."""
    return float(max(max(abs(vx), abs(vy)), 0.5 * width * abs(w)))


@lane
def row_change(r: np.ndarray, i: int, k: Numbers, change: float) -> float:
    """`as_fast` for a change of the row of lane i, after the faster one of its tiles."""
    if k.at_rest >= 1.0:  # all tiles are the same: a quarter of the time of a pass
        return change
    return float(as_fast(k, change, max(speed_of(r[i + AX], r[i + AY], r[i + AW], k.width),
                                        speed_of(r[i + BX], r[i + BY], r[i + BW], k.width))))


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


@inline
def gather_row(rows: Rows, q: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> Any:
    """The velocities of the bodies of row q, into its lane, which it returns."""
    r, body = rows.field, rows.body
    i, t = lane_of(q), bodies_of(q)
    a, b = U(body[t]), U(body[t + LANES])
    r[i + AX], r[i + AY], r[i + AW] = vx[a], vy[a], w[a]
    r[i + BX], r[i + BY], r[i + BW] = vx[b], vy[b], w[b]
    return i


@inline
def scatter_row(rows: Rows, q: int, vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """And back."""
    r, body = rows.field, rows.body
    i, t = lane_of(q), bodies_of(q)
    a, b = U(body[t]), U(body[t + LANES])
    vx[a], vy[a], w[a] = r[i + AX], r[i + AY], r[i + AW]
    vx[b], vy[b], w[b] = r[i + BX], r[i + BY], r[i + BW]


@inline
def solve_row(rows: Rows, q: int, per_mass: float, v: Bodies) -> float:
    """Solve row q alone; returns by how much (m/s) it changed."""
    r, vx, vy, w = rows.field, v.vx, v.vy, v.w
    i = gather_row(rows, q, vx, vy, w)
    if r[i + COUNT] > 1.5:  # most are: what one point alone needs is 3 % of the shaken scene's time
        solve_lanes(r, i, U(1), per_mass, False)
    else:
        solve_lanes(r, i, U(1), per_mass, True)
    scatter_row(rows, q, vx, vy, w)
    return float(r[i + CHANGE])


@apart
def solve_partly(rows: Rows, q: int, per_mass: float, part: float, v: Bodies) -> float:
    """`solve_row`, of whose change only this part is made."""
    r, vx, vy, w = rows.field, v.vx, v.vy, v.w
    i = gather_row(rows, q, vx, vy, w)
    q0, q1, qt, rest = r[i + PN0], r[i + PN1], r[i + PT], 1.0 - part
    solve_lanes(r, i, U(1), per_mass, True)
    d0, d1, dt = rest * (q0 - r[i + PN0]), rest * (q1 - r[i + PN1]), rest * (qt - r[i + PT])
    push(r, i, per_mass, d0, d1, dt)
    r[i + PN0], r[i + PN1], r[i + PT] = r[i + PN0] + d0, r[i + PN1] + d1, r[i + PT] + dt
    scatter_row(rows, q, vx, vy, w)
    return float(r[i + CHANGE])


@rolled
def push_block(r: np.ndarray, o: int, per_mass: float) -> None:
    """Apply the impulses that the rows of the block at `o` carry, in its lanes."""
    for i in range(LANES):
        k = o + i
        push(r, k, per_mass, r[k + PN0], r[k + PN1], r[k + PT])


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
            push_block(r, U(active[j]) * BLOCK, per_mass)
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
    for colour in (FAR_ROWS, LONE_ROWS):
        for q in range(WIDE * first[colour], WIDE * first[colour + 1]):
            k = lane_of(q)
            if r[k + PN0] != 0.0 or r[k + PN1] != 0.0:
                gather_row(rows, q, vx, vy, w)
                push(r, k, per_mass, r[k + PN0], r[k + PN1], r[k + PT])
                scatter_row(rows, q, vx, vy, w)


@rolled
def note_changes(r: np.ndarray, o: int, k: Numbers) -> int:
    """After the solve of the block at `o`, its rows' changes (m/s) as they count; how many of them
    are more than a little."""
    little, some = LITTLE * k.tolerance, 0
    for i in range(LANES):
        r[o + CHANGE + i] = row_change(r, o + i, k, r[o + CHANGE + i])
        some += 1 if r[o + CHANGE + i] > little else 0
    return some


@lane
def tally(rows: Rows, block: int, k: Numbers, worst: float) -> Any:
    """How many rows of a block that has been solved have changed by more than a little, noted in
    ``hits``, and the largest change (m/s) of theirs and `worst`."""
    r, o = rows.field, U(block) * BLOCK
    some = note_changes(r, o, k)
    for i in range(LANES):
        worst = max(worst, r[o + CHANGE + i])
    rows.hits[block] = some
    return some, worst


@lane
def sweep_blocks(rows: Rows, k: Numbers, v: Bodies, begin: int, last: int) -> Any:
    """Solve these blocks of one colour; ``change`` says by how much (m/s) each row did.

    Returns how many rows have changed by more than a little, and the largest change (m/s): counted
    while they are in the first-level cache.
    """
    r, single, active = rows.field, rows.single, rows.active
    vx, vy, w, per_mass = v.vx, v.vy, v.w, k.per_mass
    many, worst = 0, 0.0
    for start in range(begin, last, CHUNK):
        m = start
        for block in range(start, min(start + CHUNK, last)):
            active[m] = block
            m += 1 if single[block] != IDLE else 0
        for j in range(start, m):
            gather(rows, active[j], vx, vy, w)
        for j in range(start, m):
            if single[active[j]] == 0:
                solve_lanes(r, U(active[j]) * BLOCK, LANES, per_mass, False)
            else:
                solve_lanes(r, U(active[j]) * BLOCK, LANES, per_mass, True)
        for j in range(start, m):
            scatter(rows, active[j], vx, vy, w)
        for j in range(start, m):
            some, worst = tally(rows, active[j], k, worst)
            many += some
    return many, worst


@inline
def sweep_rows(rows: Rows, k: Numbers, v: Bodies, forward: bool, crew: Crew) -> Any:
    """One pass over all blocks; returns how many rows have changed by more than a little, and the
    largest change (m/s)."""
    first, colours, in_use = rows.first, rows.colours, rows.size[1]
    many, worst = (ZERO, 0.0) if forward else sweep_alone(rows, k, v)
    for j in range(in_use):
        colour = colours[j if forward else in_use - 1 - j]
        end = first[colour + 1]
        mine, last = give(crew, SWEEP, first[colour], end, LEAST_BLOCKS)
        some, most = sweep_blocks(rows, k, v, mine, last)
        collect(crew)
        many, worst = many + some, max(worst, most)
        for other in range(1, crew.size if last < end else 1):
            many += crew.found[other * LINE]
            worst = max(worst, crew.deepest[other * LINE])
    if forward:
        some, most = sweep_alone(rows, k, v)
        many, worst = many + some, max(worst, most)
    return many, worst


@inline
def sweep_alone(rows: Rows, k: Numbers, v: Bodies) -> Any:
    """Solve the far rows that touch, and those that are alone in their blocks, likewise."""
    r, first = rows.field, rows.first
    many, worst = ZERO, 0.0
    for colour in (FAR_ROWS, LONE_ROWS):
        for block in range(first[colour], first[colour + 1]):
            if rows.single[block] == IDLE:
                continue
            for q in range(WIDE * block, WIDE * (block + 1)):
                if r[lane_of(q) + COUNT] != 0.0:
                    solve_row(rows, q, k.per_mass, v)
                else:
                    r[lane_of(q) + CHANGE] = 0.0
            some, worst = tally(rows, block, k, worst)
            many += some
    return many, worst


@inline
def sweep_floor(floor: FloorLaw, k: Numbers, c: np.ndarray, s: np.ndarray, v: Bodies,
                crew: Crew) -> None:
    """Solve the floor's impulse of every tile."""
    begin, end = give(crew, FLOOR, k.front, k.n, LEAST_TILES)
    floor_tiles(floor, k, c, s, v, begin, end)
    collect(crew)


@lane
def tile_change(k: Numbers, vx: float, vy: float, w: float, ux: float, uy: float,
                uw: float) -> float:
    """By how much the floor has changed the velocity of a tile (m/s), as it counts."""
    change = max(max(abs(ux - vx), abs(uy - vy)), k.width * abs(uw - w))
    if k.at_rest >= 1.0:
        return change
    return float(as_fast(k, change, speed_of(ux, uy, uw, k.width)))


@lane
def floor_below(law: int, i: int, floor: FloorLaw, k: Numbers, c: np.ndarray, s: np.ndarray,
                v: Bodies) -> float:
    """Solve the floor's impulse of tile i; returns by how much (m/s) it changed, as it counts.

    A tile that the floor stops is at rest exactly, not to rounding.
    """
    im, ii = k.im, k.ii
    vx, vy, w = v.vx[i], v.vy[i], v.w[i]
    tx, ty, tw = vx - im * v.floorx[i], vy - im * v.floory[i], w - ii * v.floort[i]
    px, py, pt, stops, halts = floor_impulse(
        law, v.startx[i], v.starty[i], v.startw[i], tx, ty, tw, 1.0 / im, 1.0 / ii,
        floor.force * k.h, floor.torque * k.h, c[i], s[i])
    ux, uy = (0.0 if stops else tx + im * px), (0.0 if stops else ty + im * py)
    uw = 0.0 if halts else tw + ii * pt
    v.floorx[i], v.floory[i], v.floort[i] = px, py, pt
    v.vx[i], v.vy[i], v.w[i] = ux, uy, uw
    return float(tile_change(k, vx, vy, w, ux, uy, uw))


@rolled
def floor_tiles(floor: FloorLaw, k: Numbers, c: np.ndarray, s: np.ndarray, v: Bodies, begin: int,
                end: int) -> None:
    """Solve the floor's impulse of these tiles; ``change`` (m/s) says by how much it did, as it
    counts."""
    change, first, last = v.change, U(begin), U(end)
    if floor.law == SEPARATE:
        for i in range(first, last):
            change[i] = floor_below(SEPARATE, i, floor, k, c, s, v)
    else:
        for i in range(first, last):
            change[i] = floor_below(floor.law, i, floor, k, c, s, v)


@inline
def sweep_stale(floor: FloorLaw, k: Numbers, c: np.ndarray, s: np.ndarray, v: Bodies) -> None:
    """Solve the floor's impulse of the tiles that a pass over a list has moved since, last, so that
    what the floor holds is at rest exactly."""
    for i in range(U(k.front), U(k.n)):
        if v.change[i] == STALE:
            floor_below(floor.law, i, floor, k, c, s, v)


@inline
def turn_round(rows: Rows, floor: FloorLaw, k: Numbers, c: np.ndarray, s: np.ndarray,
               v: Bodies) -> None:
    """Solve the floor's impulse anew of the tiles without rows that turn round in the substep."""
    im, ii, start = k.im, k.ii, rows.start
    m, inertia, R, Q = 1.0 / im, 1.0 / ii, floor.force * k.h, floor.torque * k.h
    for i in range(U(k.front), U(k.n)):
        if start[i] != start[i + U(1)]:
            continue
        tx, ty, tw = (v.vx[i] - im * v.floorx[i], v.vy[i] - im * v.floory[i],
                      v.w[i] - ii * v.floort[i])
        stops = (v.vx[i] == 0.0) & (v.vy[i] == 0.0)
        if not turns(floor.law, v.startx[i], v.starty[i], v.startw[i], tx, ty, tw, m, inertia, R, Q,
                     stops):
            continue
        px, py, pt, stops, halts = impulse_of_turn(
            floor.law, v.startx[i], v.starty[i], v.startw[i], tx, ty, tw, m, inertia, R, Q, c[i],
            s[i])
        v.floorx[i], v.floory[i], v.floort[i] = px, py, pt
        v.vx[i], v.vy[i] = (0.0 if stops else tx + im * px), (0.0 if stops else ty + im * py)
        v.w[i] = 0.0 if halts else tw + ii * pt


@inline
def queue(rows: Rows, v: Bodies, tile: int, m: int) -> int:
    """Put the rows of a tile that are in contact, if they are not there yet, on the list of the
    next pass."""
    if v.mobile[tile] == 0.0:
        return m
    of, then, queued = rows.of, rows.then, rows.queued
    for p in range(rows.start[tile], rows.start[tile + 1]):
        q = U(of[p])
        # Written in any case and kept by moving on, as no branch can be foreseen.
        then[m] = of[p]
        m += 1 - (queued[q] & 1)
        queued[q] |= 1
    return m


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
def part_of(k: Numbers, late: bool) -> float:
    """What part of a row's change a pass makes, `late` in a solve.

    Of two contacts that slide on the same tile with a friction above GRIPS, each may undo more of
    what the other has done than that did.
    """
    return PART if late and max(k.mu, k.mu_wall) > GRIPS else 1.0


@inline
def sweep_queue(rows: Rows, size: int, k: Numbers, floor: FloorLaw, c: np.ndarray, s: np.ndarray,
                v: Bodies, little: float, part: float) -> Any:
    """One pass over the `size` rows on the list, and the floor below the tiles that they move.
    Of the change of each row this `part` is made.

    All rows are solved before the first of them is asked whether it has changed, and so are all
    floors: a processor begins with the next one while it waits for this one, as long as there is
    nothing to guess.
    Friction and normal impulses alternate in a manifold of two points: if it has changed it is on
    the next list, too, and so is one of which a part is left.  Floors below what has been moved by
    little are left for the end, see `sweep_stale`.  Returns the length of the next list, and the
    largest change (m/s) of a row.
    """
    body, now, queued, changes = rows.body, rows.now, rows.queued, rows.changes
    moved, stirred, change = v.moved, v.stirred, v.change
    m, tiles = ZERO, 0
    worst = 0.0
    for j in range(size):
        q = now[j]
        change_of = (solve_row(rows, q, k.per_mass, v) if part == 1.0
                     else solve_partly(rows, q, k.per_mass, part, v))
        changes[j] = row_change(rows.field, lane_of(q), k, change_of)
        worst = max(worst, changes[j])
    for j in range(size):
        q = now[j]
        queued[q] = 0
        t = bodies_of(q)
        if changes[j] <= little:
            change[body[t]] = change[body[t + LANES]] = STALE
            continue
        alone = rows.field[lane_of(q) + COUNT] < 1.5 and part == 1.0
        queued[q] = 1 if alone else 0
        for tile in (body[t], body[t + LANES]):
            stirred[tiles] = tile
            tiles += 1 - moved[tile]
            moved[tile] = 1
            m = queue(rows, v, tile, m)
        queued[q] = 0 if alone else queued[q]
    for j in range(tiles):
        moved[stirred[j]] = 0
    if floor.law != 0:
        for j in range(tiles):  # the ground's is as good as any number
            i = U(stirred[j])
            change[i] = floor_below(floor.law, i, floor, k, c, s, v) if i < U(k.n) else 0.0
        for j in range(tiles):
            if change[stirred[j]] > little:
                m = queue(rows, v, stirred[j], m)
    return m, worst
