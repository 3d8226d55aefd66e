"""Rows: every manifold that may matter in this step, in blocks that vectorise.

A row is one manifold.  WIDE rows without a common mobile tile make a block, blocks of one
colour have no common tile either, and a field of a block is as many neighbouring numbers (its
lanes): a loop over the lanes is plain vector code, and the solve of a block is that of its rows
one after the other.  Far pairs, which mostly do not touch, stand in blocks of their own, whatever
their tiles are: they are placed like the others, and what touches is solved one by one.  Which
rows there are is found once a step; where they touch, every substep (`contacts.py`).

Body index n is the ground (the wall); it never moves.  Rows are kept in the order of a, then b,
then corner, and coloured in that order; both depend on tile numbers alone, whatever the age of
the pair list.  A row that found no colour, or is found late, in the middle of a step, is alone in
a block and solved by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns, copy, set_all
from tbsa.kernels.bodies import Numbers
from tbsa.kernels.crew import (
    CLEAR,
    FILL,
    HANG,
    KEEP,
    LEAST_BLOCKS,
    LEAST_ROOM,
    LEAST_TILES,
    LINE,
    RECALL,
    ROWS,
    Crew,
    collect,
    give,
    share,
)
from tbsa.kernels.geometry import BLUNT, RECTANGLE, cos_sin, gap_to_wall, off_wall, pair_gap
from tbsa.kernels.jit import ZERO, U, inline, lane
from tbsa.kernels.neighbours import Pairs, close_up, first_of, near_place

# Two tiles have a row in this step if they can come as near as this fraction of the width, at
# their speeds and under the forces at its beginning.
NEAR = 0.05
# A square's diagonal (widths), rounded up.
DIAGONAL = 1.41422
# Rows of a block.  Eight are as fast where there are hundreds of tiles, and a quarter slower where
# there are two.
WIDE = 4
LANES = U(WIDE)
FIELDS = (
    "count",                       # points: 0, 1 or 2
    "pn0", "pn1",                  # N s, normal impulses, >= 0
    "pt",                          # N s, friction impulse of the manifold
    "base",                        # N s, normal impulse applied before that friction counts on
    "ma", "mb",                    # 1/kg, inverse masses
    "change",                      # m/s, by which a solve changed a contact velocity
    "nx", "ny",                    # normal, from a to b
    "at", "bt",                    # m, r . n from a and from b: the lever arms of friction
    "an0", "bn0", "an1", "bn1",    # m, r x n: the lever arms of the normal impulses
    "gap0", "gap1",                # m
    "id0", "id1",                  # feature ids of the points
    "warm0", "warm1", "warmt",     # N s, the impulses at the end of the last substep
    "bend0", "bend1",              # m/s^2, what the gap gains along the arc, over h^2; see `bends`
    "want0", "want1",              # m/s, the solve makes vn >= -want
    "wantt",                       # m/s, ... and friction stops vt at -want; see `weigh`
    "k00", "k01", "k11", "ktt",    # 1/kg, see `weigh`
    "i00", "i11", "itt", "idet",   # kg, kg^2
    "vn0", "vn1",                  # m/s, normal velocities, < 0 approaching
    "hit",                         # 1, 2: the point that hits in this substep; 3: both;
                                   # -1: perhaps; -2: unless it leaves the face before
    "mu", "e",                     # friction, restitution
    "ax", "ay", "aw",              # scratch: of body a, and b (velocities)
    "bx", "by", "bw",
)
(COUNT, PN0, PN1, PT, BASE, MA, MB, CHANGE, NX, NY, AT, BT, AN0, BN0, AN1, BN1, GAP0, GAP1, ID0,
 ID1, WARM0, WARM1, WARMT, BEND0, BEND1, WANT0, WANT1, WANTT, K00, K01, K11, KTT, I00, I11, ITT,
 IDET, VN0, VN1, HIT, MU, E, AX, AY, AW, BX, BY, BW) = (U(i) * LANES for i in range(len(FIELDS)))
ZEROED = CHANGE + LANES  # numbers of a block, its first, that a new row needs to be zero
BLOCK = U(len(FIELDS)) * LANES  # numbers of a block
BODIES = U(2) * LANES  # body indices of a block: those of a, then those of b
CHUNK = 8  # blocks that are worked on together
IDLE = -1
# Pairs that are further apart than this fraction of the width when a step begins are kept by
# themselves: most of them are not in contact all the step long, and their blocks are left out of
# the solve.
FAR = 0.02
# The far pairs, whose blocks may share tiles; colours of near pairs, and of walls, of which a tile
# has four rows at most; then the rows that are alone.
FAR_ROWS, NEAR_ROWS, NEAR_COLOURS, WALL_COLOURS = 0, 1, 16, 4
WALLS = NEAR_ROWS + NEAR_COLOURS
NEAR_BITS = 2**NEAR_COLOURS - 1
# The first of eight bits that is not set; 8 where all are.  There are two times eight colours.
FREE = np.array([((bits + 1) & ~bits).bit_length() - 1 for bits in range(256)])
LONE_ROWS = WALLS + WALL_COLOURS
COLOURS = LONE_ROWS + 1
# Of the numbers in ``size``: rows that were added within a step, the substep (h/8) that the
# impulses are for, 0 where there are no rows yet, how many rows there can be, -1 with a wall, and
# how many tiles are in ``between``.
LATE, SCALED, ALL, BETWEEN, SIZES = 2, 3, 4, 5, 6
# Points of a tile between held bodies that are looked at, two a row.
POINTS = 16


# Impulses that differ by less than this part are the same, but for rounding.
EQUAL = 1e-13


class Rows(NamedTuple):
    """The rows of a step, and the blocks they are kept in."""

    room: int  # rows that there is space for
    blocks: int  # ... and blocks
    a: np.ndarray  # int64[room], the rows in the order found
    b: np.ndarray  # int64, n for the wall
    corner: np.ndarray  # int64, of a at a round wall, or the side of a rectangle; 1: far pair
    slot: np.ndarray  # int64, where its lane begins in `field`
    field: np.ndarray  # float64[blocks * BLOCK]
    body: np.ndarray  # int64[blocks * BODIES]
    first: np.ndarray  # int64[COLOURS + 1], first block of every colour
    single: np.ndarray  # int64, one a block: rows of a single point in it; IDLE if none touches
    hits: np.ndarray  # int64, one a block: rows that hit; then rows that changed, or are deep
    live: np.ndarray  # int64, one a block: rows that a solve may have something to do for
    active: np.ndarray  # int64, one a block: scratch
    queued: np.ndarray  # int64, WIDE a block: 1 if the row is on the list of a pass, or never
    # to be, as it is not in contact ...
    now: np.ndarray  # int64, WIDE a block: the list of this pass, each row as WIDE block + lane
    then: np.ndarray  # int64, WIDE a block: ... of the next
    changes: np.ndarray  # m/s, WIDE a block: by how much a pass changed the rows on the list; in a
    # projection whether it moved them
    new_a: np.ndarray  # int64, as a, b and corner: the rows of the next step
    new_b: np.ndarray
    new_corner: np.ndarray
    start: np.ndarray  # int64[n + 2], where the rows of every body begin in ...
    of: np.ndarray  # int64, the rows of every mobile tile, each as WIDE block + lane
    between: np.ndarray  # int64[n + 1], the mobile tiles that are near more than one held body
    lanes: np.ndarray  # int64[POINTS / 2] and float64[4 POINTS], scratch of these (squeeze.py)
    points: np.ndarray
    island: np.ndarray  # int64[n + 1], the first of the mobile tiles that a tile's rows lead to
    used: np.ndarray  # int64[n + 1], scratch: colours of a tile, as bits
    fill: np.ndarray  # int64[COLOURS], scratch
    colours: np.ndarray  # int64[LONE_ROWS], those of the colours that are in use, in order
    size: np.ndarray  # int64[SIZES], rows, colours in use, and LATE, SCALED, ALL and BETWEEN
    effort: np.ndarray  # int64[2], rows in all passes of this call, and those left out


class Impulses(NamedTuple):
    """The impulses at the end of the last step: part of the state and of a checkpoint."""

    size: np.ndarray  # int64[1]
    a: np.ndarray  # int64
    b: np.ndarray  # int64, n to n + 3 for the wall, by `wall_code`
    id0: np.ndarray  # int64
    id1: np.ndarray  # int64, -1 for a manifold of one point
    pn0: np.ndarray
    pn1: np.ndarray
    pt: np.ndarray


def empty_rows(n: int, capacity: int) -> Rows:
    """Space for `capacity` rows of `n` tiles."""
    blocks = capacity // int(LANES) + capacity // 16 + 2 * COLOURS
    field = np.zeros(blocks * int(BLOCK) + 8)
    shift = -(field.ctypes.data // 8) % 8  # a block begins with a cache line
    whole = ([capacity] * 4, [COLOURS + 1], [blocks] * 4 + [WIDE * blocks + 1] * 3, [capacity] * 3,
             [n + 2, 2 * capacity])
    lists = [[np.zeros(size, np.int64) for size in sizes] for sizes in whole]
    return Rows._make([
        capacity, blocks, *lists[0], field[shift : shift + blocks * int(BLOCK)],
        np.zeros(blocks * int(BODIES), np.int64), *lists[1], *lists[2], np.zeros(WIDE * blocks),
        *lists[3], *lists[4],
        np.zeros(n + 1, np.int64), np.zeros(POINTS // 2, np.int64), np.zeros(4 * POINTS),
        np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64), np.zeros(COLOURS, np.int64),
        np.zeros(LONE_ROWS, np.int64),
        np.zeros(SIZES, np.int64), np.zeros(2, np.int64)])


def empty_impulses(capacity: int) -> Impulses:
    """Space for the impulses of `capacity` manifolds; none stored."""
    whole = {"a", "b", "id0", "id1"}
    return Impulses(np.zeros(1, np.int64), *columns(
        capacity, [int if f in whole else float for f in Impulses._fields[1:]]))


@inline
def find_rows(rows: Rows, pairs: Pairs, k: Numbers, x: np.ndarray, y: np.ndarray, c: np.ndarray,
              s: np.ndarray, mobile: np.ndarray, way: np.ndarray, far: np.ndarray, spare: int,
              crew: Crew) -> Any:
    """List what may touch in this step, in which the tiles' centres go as far as `way` and their
    corners as `far` as this (m).

    Returns the number of new rows, -1 where they do not fit, whether they are others than the
    rows that there are, and their deepest overlap (m).
    """
    # Space is left for what else the middle of a step may bring.
    room = rows.room - spare * (rows.room // 5)
    at, end = give(crew, ROWS, ZERO, room, LEAST_ROOM)
    m, overlap = rows_from(rows, pairs, k, x, y, c, s, mobile, way, far, ZERO,
                           crew.size if end < room else 1, at, end)
    collect(crew)
    for other in range(1, crew.size if end < room else 1):
        more = crew.found[other * LINE]
        at, _ = share(crew, other, ZERO, room)
        overlap = max(overlap, crew.deepest[other * LINE])
        if m < 0 or more < 0:
            m = -1
        else:
            close_up(rows.new_a, at, m, more)
            close_up(rows.new_b, at, m, more)
            close_up(rows.new_corner, at, m, more)
            m += more
    return m, m != rows.size[0] or not same_rows(rows, m), overlap


@inline
def same_rows(rows: Rows, m: int) -> bool:
    """Whether the first m new rows are the rows that there are."""
    ra, rb, corner, na, nb, new_corner = (rows.a, rows.b, rows.corner, rows.new_a, rows.new_b,
                                          rows.new_corner)
    others = 0
    for i in range(U(m)):
        others |= (ra[i] ^ na[i]) | (rb[i] ^ nb[i]) | (corner[i] ^ new_corner[i])
    return others == 0


@lane
def rows_from(rows: Rows, pairs: Pairs, k: Numbers, x: np.ndarray, y: np.ndarray, c: np.ndarray,
              s: np.ndarray, mobile: np.ndarray, way: np.ndarray, far: np.ndarray, me: int,
              threads: int, at: int, end: int) -> Any:
    """The rows of one of so many shares of the tiles, from place `at` to `end` of the new ones.

    Returns the number of them, -1 where they do not fit, and their deepest overlap (m).
    """
    start, other = pairs.start, pairs.other
    na, nb, new_corner = rows.new_a, rows.new_b, rows.new_corner
    m, half, diagonal, deepest = at, 0.5 * k.width, DIAGONAL * k.width, 0.0
    for a in range(first_of(pairs, k.n, me, threads), first_of(pairs, k.n, me + 1, threads)):
        way_a, far_a = way[a], far[a]
        if m + start[a + 1] - start[a] > end:
            return -1, 0.0
        # Written in any case and kept by moving on, as no branch can be foreseen.
        near = m
        for p in range(start[a], start[a + 1]):
            b = U(other[p])
            dx, dy = x[b] - x[a], y[b] - y[a]
            reach = diagonal + way_a + way[b]
            nb[near] = other[p]
            near += 1 if dx * dx + dy * dy <= reach * reach else 0
        for p in range(m, near):
            b = U(nb[p])
            gap, aside = pair_gap(x[b] - x[a], y[b] - y[a], c[a], s[a], c[b], s[b], half)
            deepest = min(deepest, gap)
            na[m], nb[m], new_corner[m] = a, nb[p], far_pair(gap, aside, k.width)
            m += 1 if gap <= far_a + far[b] else 0
        if k.wall == 0 or mobile[a] == 0.0 or off_wall(k, x[a], y[a], 0.5 * diagonal + way_a):
            continue
        for code in range(4):
            gap = gap_to_wall(k, code, x[a], y[a], c[a], s[a])
            if gap > far_a:
                continue
            if m == end:
                return -1, 0.0
            deepest = min(deepest, gap)
            na[m], nb[m], new_corner[m] = a, k.n, code
            m += 1
    return m - at, -deepest


@lane
def far_pair(gap: float, aside: float, width: float) -> int:
    """1 for a pair that is kept with the far ones; see `pair_gap`."""
    return 1 if (gap > FAR * width) | (aside > -BLUNT * width) else 0


@inline
def add_rows(rows: Rows, pairs: Pairs, k: Numbers, x: np.ndarray, y: np.ndarray,
             angle: np.ndarray, c: np.ndarray, s: np.ndarray, mobile: np.ndarray,
             marked: np.ndarray, way: np.ndarray, far: np.ndarray, widest: float) -> int:
    """Rows that the marked tiles have besides those that there are.

    These tiles will come further, `way` and `far` (m), than was assumed at the beginning of the
    step; all others not.  No tile will be further than `widest` (m) from where it was when the
    pairs were listed.  Returns the number of new rows, -1 where they do not fit.
    """
    near, n, half, diagonal = rows.used, k.n, 0.5 * k.width, DIAGONAL * k.width
    m, found = rows.size[0], ZERO
    most = min(rows.room - m, rows.blocks - rows.first[COLOURS])
    for a in range(n):
        if marked[a] == 0:
            continue
        c[a], s[a] = cos_sin(angle[a])
        for j in range(near_place(pairs, x[a], y[a], diagonal + way[a] + widest, near)):
            b = U(near[j])
            dx, dy = x[b] - x[a], y[b] - y[a]
            reach = diagonal + way[a] + way[b]
            # Two that are marked are found by the first of them.
            if (near[j] == a or (marked[b] != 0 and near[j] < a)
                    or dx * dx + dy * dy > reach * reach):
                continue
            c[b], s[b] = cos_sin(angle[b])
            gap, aside = pair_gap(dx, dy, c[a], s[a], c[b], s[b], half)
            if gap > far[a] + far[b] or has_row(rows, a, near[j], n, ZERO):
                continue
            if found == most:
                return -1
            insert(rows, found, min(a, near[j]), max(a, near[j]), far_pair(gap, aside, k.width))
            found += 1
        if k.wall == 0 or off_wall(k, x[a], y[a], 0.5 * diagonal + way[a]):
            continue
        for code in range(4):
            gap = gap_to_wall(k, code, x[a], y[a], c[a], s[a])
            if gap > far[a] or has_row(rows, a, n, n, code):
                continue
            if found == most:
                return -1
            insert(rows, found, a, n, code)
            found += 1
    if found == 0:
        return 0

    # Among the rows that there are, from the last one down; each in a block of its own.
    ra, rb, corner, slot = rows.a, rows.b, rows.corner, rows.slot
    na, nb, new_corner, field = rows.new_a, rows.new_b, rows.new_corner, rows.field
    block = rows.first[COLOURS]
    rows.first[COLOURS] += found
    rows.size[0] = m + found
    rows.size[LATE] += found
    i, j = m - 1, found - 1
    for to in range(m + found - 1, -1, -1):
        if j < 0:
            break
        if i >= 0 and earlier(na[j], nb[j], new_corner[j], ra[i], rb[i], corner[i]):
            ra[to], rb[to], corner[to], slot[to] = ra[i], rb[i], corner[i], slot[i]
            i -= 1
            continue
        a, b, code = na[j], nb[j], new_corner[j]
        ra[to], rb[to], corner[to], slot[to] = a, b, code, (block + j) * int(BLOCK)
        empty_block(rows, block + j, n, BLOCK)
        fill_lane(rows, U(slot[to]), U(block + j) * BODIES, a, b, k, mobile)
        if b == n:
            field[U(slot[to]) + ID0], field[U(slot[to]) + ID1] = 2.0 * code, -1.0
        j -= 1
    index_rows(rows, m + found, k, mobile)
    join_islands(rows.island, na, nb, found, n, mobile)
    return int(found)


@lane
def earlier(a: int, b: int, code: int, other_a: int, other_b: int, other_code: int) -> bool:
    """Whether a row is before another one in the order of rows."""
    return (a < other_a) | ((a == other_a) & ((b < other_b)
                                              | ((b == other_b) & (code < other_code))))


@inline
def insert(rows: Rows, found: int, a: int, b: int, code: int) -> None:
    """Put a row in its place among the new ones, of which there are so many."""
    na, nb, new_corner = rows.new_a, rows.new_b, rows.new_corner
    j = found
    while j > 0 and earlier(a, b, code, na[j - 1], nb[j - 1], new_corner[j - 1]):
        na[j], nb[j], new_corner[j] = na[j - 1], nb[j - 1], new_corner[j - 1]
        j -= 1
    na[j], nb[j], new_corner[j] = a, b, code


@inline
def has_row(rows: Rows, a: int, b: int, n: int, code: int) -> bool:
    """Whether there is a row of a mobile tile a and b, with this code if b is the wall."""
    body, of = rows.body, rows.of
    for p in range(rows.start[a], rows.start[a + 1]):
        t = bodies_of(of[p])
        if (((body[t] == a and body[t + LANES] == b) or (body[t] == b and body[t + LANES] == a))
                and (b < n or wall_code(rows.field, U(of[p] // WIDE) * BLOCK + U(of[p] % WIDE))
                     == code)):
            return True
    return False


@inline
def lane_of(q: int) -> Any:
    """Where the lane of row q (WIDE block + lane) begins."""
    return U(q // WIDE) * BLOCK + U(q % WIDE)


@inline
def bodies_of(q: int) -> Any:
    """Where the bodies of row q stand: that of a here, that of b LANES later."""
    return U(q // WIDE) * BODIES + U(q % WIDE)


@lane
def wall_code(r: np.ndarray, i: int) -> int:
    """Which corner or side (see `gap_to_wall`) the row of a wall in lane i is of: a part of all the
    ids that its points have."""
    return int(r[i + ID0]) // 2 % 4


@inline
def colour_rows(rows: Rows, m: int, k: Numbers, mobile: np.ndarray, crew: Crew) -> bool:
    """Take the m new rows, and give them their places in the blocks, empty of impulses.

    Greedily, in order: a near row takes the first colour that none of its mobile tiles has. Returns
    whether the blocks are enough, with some to spare for rows that are found late.
    """
    used, fill, first, slot = rows.used, rows.fill, rows.first, rows.slot
    ra, rb = rows.a, rows.b
    rows.size[0], rows.size[LATE] = m, ZERO
    copy(rows.new_a, ra, m)
    copy(rows.new_b, rb, m)
    copy(rows.new_corner, rows.corner, m)
    _, end = give(crew, HANG, ZERO, m, LEAST_TILES)  # while this one chooses colours
    set_all(used, k.n + 1, ZERO)
    set_all(fill, np.int64(COLOURS), ZERO)
    last = -1
    for i in range(m):
        a, b = ra[i], rb[i]
        colour = 0
        if b == k.n:
            colour = WALLS + used[a] // (NEAR_BITS + 1)
            used[a] += NEAR_BITS + 1
        elif rows.corner[i] != 0:
            colour = FAR_ROWS
        else:
            taken = used[a] | used[b]
            colour = (FREE[U(taken & 255)] if taken & 255 != 255
                      else 8 + FREE[U(taken >> 8 & 255)])
            if colour < NEAR_COLOURS:
                used[a] |= (1 if mobile[a] != 0.0 else 0) << colour
                used[b] |= (1 if mobile[b] != 0.0 else 0) << colour
                colour += NEAR_ROWS
            else:
                colour = LONE_ROWS
        slot[i] = colour
        fill[colour] += 1
        last = max(last, colour)
    blocks, in_use = ZERO, 0
    for q in range(last + 1):
        first[q] = blocks
        blocks += fill[q] if q == LONE_ROWS else int(U(fill[q] + WIDE - 1) // LANES)
        if fill[q] > 0 and q != FAR_ROWS and q != LONE_ROWS:
            rows.colours[in_use] = q
            in_use += 1
        fill[q] = 0
    for q in range(last + 1, COLOURS + 1):
        first[q] = blocks
    rows.size[1] = in_use
    enough = first[COLOURS] <= 3 * rows.blocks // 4
    for i in range(m if enough else 0):
        q = slot[i]
        block, at = first[q] + fill[q] // WIDE, fill[q] % WIDE
        if q == LONE_ROWS:
            block, at = first[q] + fill[q], 0
        fill[q] += 1
        slot[i] = block * int(BLOCK) + at
    collect(crew)
    if end == m:
        find_islands(rows, m, k.n, mobile)
    if not enough:
        return False
    begin, end = give(crew, CLEAR, ZERO, first[COLOURS], LEAST_BLOCKS)
    clear_blocks(rows, k.n, begin, end)
    collect(crew)
    begin, end = give(crew, FILL, ZERO, m, LEAST_TILES)
    fill_lanes(rows, k, mobile, begin, end)
    collect(crew)
    index_rows(rows, m, k, mobile)
    return True


@lane
def clear_blocks(rows: Rows, n: int, begin: int, end: int) -> None:
    """Make these blocks empty, in the fields that are read before they are written."""
    for block in range(begin, end):
        # `place_pairs` writes every other field of every lane, `place_walls` does not.
        empty_block(rows, block, n, ZEROED if block < rows.first[WALLS] else BLOCK)


@lane
def fill_lanes(rows: Rows, k: Numbers, mobile: np.ndarray, begin: int, end: int) -> None:
    """Put these rows into their lanes."""
    ra, rb, slot = rows.a, rows.b, rows.slot
    for i in range(begin, end):
        at = U(slot[i])
        t = at // BLOCK * BODIES + at % BLOCK
        fill_lane(rows, at, t, ra[i], rb[i], k, mobile)


@inline
def empty_block(rows: Rows, block: int, n: int, fields: int) -> None:
    """A block without rows; the first `fields` numbers of it are zero."""
    field, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    for j in range(U(fields)):
        field[o + j] = 0.0
    for j in range(BODIES):
        body[t + j] = n


@inline
def fill_lane(rows: Rows, at: int, t: int, a: int, b: int, k: Numbers, mobile: np.ndarray) -> None:
    """Put the row of a and b into the lane that begins here in the fields, and at t the bodies."""
    field, body = rows.field, rows.body
    i, j = U(at), U(t)
    body[j], body[j + LANES] = a, b
    field[i + MA], field[i + MB] = k.im * mobile[a], k.im * mobile[b]
    field[i + MU], field[i + E] = (k.mu_wall, k.e_wall) if b == k.n else (k.mu, k.e)
    field[i + ID0], field[i + ID1] = -2.0, -2.0


@inline
def index_rows(rows: Rows, m: int, k: Numbers, mobile: np.ndarray) -> None:
    """List the rows of every mobile tile, in order, and the tiles that may be between held ones."""
    ra, rb, slot, start, of, fill = rows.a, rows.b, rows.slot, rows.start, rows.of, rows.used
    held, between, corner, some = rows.used, rows.between, rows.corner, ZERO
    set_all(start, k.n + 2, ZERO)
    for i in range(m):
        start[U(ra[i]) + U(1)] += 1
        start[U(rb[i]) + U(1)] += 1
    for i in range(k.n):
        start[i + 1] = start[i] + (start[i + 1] if mobile[i] != 0.0 else 0)
        fill[i] = start[i]
    for i in range(m):
        a, b, o = U(ra[i]), U(rb[i]), U(slot[i])
        row = int(o // BLOCK * LANES + o % BLOCK)
        if mobile[a] != 0.0:
            of[fill[a]] = row
            fill[a] += 1
        if mobile[b] != 0.0:  # the ground is not
            of[fill[b]] = row
            fill[b] += 1
    set_all(held, k.n + 1, ZERO)
    for i in range(m):
        a, b = ra[i], rb[i]
        # Neither a round wall presses from two sides, nor what passes corner to corner.
        faces = ((k.wall == RECTANGLE if b == k.n else corner[i] == 0)
                 & (mobile[a] * mobile[b] == 0.0))
        tile = a if mobile[a] != 0.0 else b
        held[tile] += 1 if faces else 0
        between[some] = tile
        some += 1 if faces & (held[tile] == 2) else 0
    rows.size[BETWEEN] = some


@lane
def find_islands(rows: Rows, m: int, n: int, mobile: np.ndarray) -> None:
    """Find what hangs together through the rows."""
    island = rows.island
    for i in range(n + 1):
        island[i] = i
    join_islands(island, rows.a, rows.b, m, n, mobile)


@lane
def join_islands(island: np.ndarray, ra: np.ndarray, rb: np.ndarray, m: int, n: int,
                 mobile: np.ndarray) -> None:
    """Make one of the islands that these m rows lead from one to the other."""
    for i in range(m):
        if mobile[ra[i]] * mobile[rb[i]] != 0.0:
            p, q = root(island, ra[i]), root(island, rb[i])
            island[max(p, q)] = min(p, q)
    for i in range(n):
        island[i] = island[island[i]]


@inline
def root(parent: np.ndarray, i: int) -> int:
    """The first tile of the island that a tile is part of."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inline
def recall_all(rows: Rows, m: int, n: int, old: Impulses, crew: Crew) -> None:
    """Give the m rows the impulses that their manifolds had at the end of the last step."""
    begin, end = give(crew, RECALL, ZERO, m, LEAST_TILES)
    recall(rows, n, old, begin, end)
    collect(crew)


@lane
def other_of(rows: Rows, i: int, n: int) -> int:
    """What row i has besides its first tile, as `Impulses` names it."""
    b = rows.b[i]
    return int(b + rows.corner[i] if b == n else b)


@lane
def recall(rows: Rows, n: int, old: Impulses, begin: int, end: int) -> None:
    """The same for these rows."""
    ra, corner, slot, r = rows.a, rows.corner, rows.slot, rows.field
    oa, ob, oid0, oid1 = old.a, old.b, old.id0, old.id1
    opn0, opn1, opt = old.pn0, old.pn1, old.pt
    size = old.size[0]
    j, high = ZERO, (size if begin > 0 else ZERO)
    while j < high:  # the first that may be of these rows
        middle = (j + high) // 2
        if oa[middle] < ra[begin]:
            j = middle + 1
        else:
            high = middle
    for i in range(begin, end):
        a, b, k = ra[i], other_of(rows, i, n), U(slot[i])
        if b >= n:
            r[k + ID0], r[k + ID1] = 2.0 * corner[i], -1.0
        while j < size and (oa[j] < a or (oa[j] == a and ob[j] < b)):
            j += 1  # such a row is no longer there
        if j == size:
            continue
        known = (oa[j] == a) & (ob[j] == b)
        r[k + PN0] = opn0[j] if known else r[k + PN0]
        r[k + PN1] = opn1[j] if known else r[k + PN1]
        r[k + PT] = opt[j] if known else r[k + PT]
        r[k + ID0] = float(oid0[j]) if known else r[k + ID0]
        r[k + ID1] = float(oid1[j]) if known else r[k + ID1]
        j += 1 if known else 0


@inline
def remember_all(rows: Rows, m: int, n: int, store: Impulses, crew: Crew) -> None:
    """Store the impulses of those of the m rows that carry any."""
    begin, end = give(crew, KEEP, ZERO, m, LEAST_TILES)
    j = remember(rows, n, store, begin, end)
    collect(crew)
    for other in range(1, crew.size if end < m else 1):
        more, (at, _) = crew.found[other * LINE], share(crew, other, ZERO, m)
        for whole in (store.a, store.b, store.id0, store.id1):
            close_up(whole, at, j, more)
        for number in (store.pn0, store.pn1, store.pt):
            close_up(number, at, j, more)
        j += more
    store.size[0] = j


@lane
def remember(rows: Rows, n: int, store: Impulses, begin: int, end: int) -> int:
    """The same for these rows, from place `begin` of the store on; returns how many do."""
    ra, slot, r = rows.a, rows.slot, rows.field
    sa, sb, sid0, sid1 = store.a, store.b, store.id0, store.id1
    spn0, spn1, spt = store.pn0, store.pn1, store.pt
    j = begin
    for i in range(begin, end):
        k = U(slot[i])
        sa[j], sb[j] = ra[i], other_of(rows, i, n)
        sid0[j], sid1[j] = int(r[k + ID0]), int(r[k + ID1])
        spn0[j], spn1[j], spt[j] = r[k + PN0], r[k + PN1], r[k + PT]
        j += 1 if (r[k + PN0] != 0.0) | (r[k + PN1] != 0.0) else 0
    return j - begin


@lane
def about_the_same(rows: Rows, m: int, n: int, store: Impulses) -> bool:
    """Whether `remember` would store what is in the store, but for rounding of the largest."""
    slot, r = rows.slot, rows.field
    j, size, largest = ZERO, store.size[0], 0.0
    for i in range(size):
        largest = max(largest, store.pn0[i] + store.pn1[i])
    least = EQUAL * largest
    for i in range(m):
        k = U(slot[i])
        if r[k + PN0] == 0.0 and r[k + PN1] == 0.0:
            continue
        if not (j < size and store.a[j] == rows.a[i] and store.b[j] == other_of(rows, i, n)
                and store.id0[j] == int(r[k + ID0]) and store.id1[j] == int(r[k + ID1])):
            return False
        if (abs(store.pn0[j] - r[k + PN0]) > least or abs(store.pn1[j] - r[k + PN1]) > least
                or abs(store.pt[j] - r[k + PT]) > least):
            return False
        j += 1
    return bool(j == size)
