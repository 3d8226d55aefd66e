"""Contact rows: every manifold that may matter in this step, in blocks that vectorise.

A row is one manifold.  Eight rows without a common mobile tile make a block, blocks of one
colour have no common tile either, and a field of a block is eight neighbouring numbers (its
lanes): a loop over the lanes is plain vector code, and the solve of a block is that of its rows
one after the other.  Which rows there are is found once a step; where they touch, every substep.

Body index n is the ground (the wall); it never moves.  Rows are kept in the order of a, then b,
then corner, and coloured in that order; both depend on tile numbers alone, whatever the age of
the pair list.  A row that found no colour, or is found late, in the middle of a step, is alone in
a block and solved by itself.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import columns, copy, set_all
from tbsa.kernels.crew import LEAST_ROOM, LINE, ROWS, Crew, collect, give, share
from tbsa.kernels.geometry import arc, bends, circle_corner, cos_sin, square_square
from tbsa.kernels.jit import ZERO, U, inline, lane
from tbsa.kernels.neighbours import Pairs, close_up, first_of, near_place

CIRCLE, RECTANGLE = 1, 2

# Two tiles have a row in this step if they can come as near as this fraction of the width, at
# their speeds and under the forces at its beginning.
NEAR = 0.05
# A point is part of a manifold if it is nearer than it can close at its speed within the
# substep, and this fraction of the width: forces and impacts may speed it up.
SPARE = 0.02
# A square's diagonal (widths), rounded up.
DIAGONAL = 1.41422
# The solve leaves a point with this velocity alone (m/s): there is none.
NEVER = 1e30

LANES = U(8)
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
    "k00", "k01", "k11", "ktt",    # 1/kg, see `weigh`
    "i00", "i11", "itt", "idet",   # kg, kg^2
    "vn0", "vn1",                  # m/s, normal velocities, < 0 approaching
    "hit",                         # 1, 2: the point that hits in this substep; 3: both
    "mu", "e",                     # friction, restitution
    "ax", "ay", "aw",              # scratch: of body a, and b (velocities)
    "bx", "by", "bw",
)
(COUNT, PN0, PN1, PT, BASE, MA, MB, CHANGE, NX, NY, AT, BT, AN0, BN0, AN1, BN1, GAP0, GAP1, ID0,
 ID1, WARM0, WARM1, WARMT, BEND0, BEND1, WANT0, WANT1, K00, K01, K11, KTT, I00, I11, ITT, IDET,
 VN0, VN1, HIT, MU, E, AX, AY, AW, BX, BY, BW) = (U(i) * LANES for i in range(len(FIELDS)))
ZEROED = CHANGE + LANES  # numbers of a block, its first, that a new row needs to be zero
BLOCK = U(len(FIELDS)) * LANES  # numbers of a block
BODIES = U(2) * LANES  # body indices of a block: those of a, then those of b

CHUNK = 8  # blocks that are worked on together
# Colours of pairs; then those of walls, of which a tile has eight rows at most; then the rows
# that are alone.
PAIR_COLOURS, WALL_COLOURS = 47, 8
PAIR_BITS = 2**PAIR_COLOURS - 1
ALONE = PAIR_COLOURS + WALL_COLOURS
COLOURS = ALONE + 1


class Rows(NamedTuple):
    """The rows of a step, and the blocks they are kept in."""

    a: np.ndarray  # int64, the rows in the order found
    b: np.ndarray  # int64, n for the wall
    corner: np.ndarray  # int64, of a at the wall, twice, and the side of a rectangle; 0 for pairs
    slot: np.ndarray  # int64, where its lane begins in `field`
    field: np.ndarray  # float64[blocks * BLOCK]
    body: np.ndarray  # int64[blocks * BODIES]
    first: np.ndarray  # int64[COLOURS + 1], first block of every colour
    single: np.ndarray  # int64, one a block: rows of a single point in it
    hits: np.ndarray  # int64, one a block: points that hit; then rows that changed, or are deep
    active: np.ndarray  # int64, one a block: scratch
    queued: np.ndarray  # int64, eight a block: 1 if the row is on the list of a pass, or never
    # to be, as it is not in contact ...
    now: np.ndarray  # int64, eight a block: the list of this pass, each row as 8 block + lane
    then: np.ndarray  # int64, eight a block: ... of the next
    new_a: np.ndarray  # int64, as a, b and corner: the rows of the next step
    new_b: np.ndarray
    new_corner: np.ndarray
    start: np.ndarray  # int64[n + 2], where the rows of every body begin in ...
    of: np.ndarray  # int64, the rows of every mobile tile, each as 8 block + lane
    island: np.ndarray  # int64[n + 1], the first of the mobile tiles that a tile's rows lead to
    used: np.ndarray  # int64[n + 1], scratch: colours of a tile, as bits
    fill: np.ndarray  # int64[COLOURS], scratch
    colours: np.ndarray  # int64[ALONE], the colours in use, in order, without the last
    size: np.ndarray  # int64[2], rows, and colours in use
    effort: np.ndarray  # int64[2], rows in all passes of this call, and those left out


class Impulses(NamedTuple):
    """The impulses at the end of the last step: part of the state and of a checkpoint."""

    size: np.ndarray  # int64[1]
    a: np.ndarray  # int64
    b: np.ndarray  # int64
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
    whole = ([capacity] * 4, [COLOURS + 1], [blocks] * 3 + [8 * blocks] * 3, [capacity] * 3,
             [n + 2, 2 * capacity])
    lists = [[np.zeros(size, np.int64) for size in sizes] for sizes in whole]
    return Rows._make([
        *lists[0], field[shift : shift + blocks * int(BLOCK)],
        np.zeros(blocks * int(BODIES), np.int64), *lists[1], *lists[2], *lists[3], *lists[4],
        np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64), np.zeros(COLOURS, np.int64),
        np.zeros(ALONE, np.int64),
        np.zeros(2, np.int64), np.zeros(2, np.int64)])


def empty_impulses(capacity: int) -> Impulses:
    """Space for the impulses of `capacity` manifolds; none stored."""
    whole = {"a", "b", "id0", "id1"}
    return Impulses(np.zeros(1, np.int64), *columns(
        capacity, [int if f in whole else float for f in Impulses._fields[1:]]))


@lane
def pair_gap(dx: float, dy: float, ca: float, sa: float, cb: float, sb: float,
             half: float) -> float:
    """Largest gap of two squares across a face of one of them (m); they are this far apart."""
    cos, sin = ca * cb + sa * sb, ca * sb - sa * cb
    on_a = max(abs(dx * ca + dy * sa), abs(dy * ca - dx * sa))
    on_b = max(abs(dx * cb + dy * sb), abs(dy * cb - dx * sb))
    return max(on_a, on_b) - half * (1.0 + abs(cos) + abs(sin))


@lane
def off_wall(wall: int, wall_x: float, wall_y: float, x: float, y: float, reach: float) -> bool:
    """Whether nothing within this reach of a place meets the wall."""
    near = wall_x - reach
    inside = (near > 0.0) & (x * x + y * y < near * near)
    between = (abs(x) + reach < wall_x) & (abs(y) + reach < wall_y)
    return inside if wall == CIRCLE else between


@inline
def find_rows(rows: Rows, pairs: Pairs, n: int, width: float, wall: int,
              wall_x: float, wall_y: float, x: np.ndarray, y: np.ndarray, c: np.ndarray,
              s: np.ndarray, mobile: np.ndarray, way: np.ndarray, far: np.ndarray,
              spare: int, crew: Crew) -> Any:
    """List what may touch in this step, in which the tiles' centres go as far as `way` and their
    corners as `far` as this (m).

    Returns the number of new rows, -1 where they do not fit, whether they are others than the
    rows that there are, and their deepest overlap (m).
    """
    # Space is left for what else the middle of a step may bring.
    room = rows.a.size - spare * (rows.a.size // 5)
    at, end = give(crew, ROWS, ZERO, room, LEAST_ROOM)
    m, overlap = rows_from(rows, pairs, n, width, wall, wall_x, wall_y, x, y, c, s, mobile, way,
                           far, ZERO, crew.size if end < room else 1, at, end)
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
def rows_from(rows: Rows, pairs: Pairs, n: int, width: float, wall: int, wall_x: float,
              wall_y: float, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
              mobile: np.ndarray, way: np.ndarray, far: np.ndarray, me: int, threads: int,
              at: int, end: int) -> Any:
    """The rows of one of so many shares of the tiles, from place `at` to `end` of the new ones.

    Returns the number of them, -1 where they do not fit, and their deepest overlap (m).
    """
    start, other = pairs.start, pairs.other
    na, nb, new_corner = rows.new_a, rows.new_b, rows.new_corner
    m, half, deepest = at, 0.5 * width, 0.0
    for a in range(first_of(pairs, n, me, threads), first_of(pairs, n, me + 1, threads)):
        way_a, far_a = way[a], far[a]
        for k in range(start[a], start[a + 1]):
            b = U(other[k])
            dx, dy = x[b] - x[a], y[b] - y[a]
            margin = far_a + far[b]
            reach = DIAGONAL * width + way_a + way[b]
            if dx * dx + dy * dy > reach * reach:
                continue
            gap = pair_gap(dx, dy, c[a], s[a], c[b], s[b], half)
            if gap > margin:
                continue
            if m == end:
                return -1, 0.0
            deepest = min(deepest, gap)
            na[m], nb[m], new_corner[m] = a, other[k], 0
            m += 1
        if wall == 0 or mobile[a] == 0.0 or off_wall(wall, wall_x, wall_y, x[a], y[a],
                                                     0.5 * DIAGONAL * width + way_a):
            continue
        for code in range(8):
            gap = corner_gap(wall, code, wall_x, wall_y, x[a], y[a], c[a], s[a], half)
            if gap > far_a:
                continue
            if m == end:
                return -1, 0.0
            deepest = min(deepest, gap)
            na[m], nb[m], new_corner[m] = a, n, code
            m += 1
    return m - at, -deepest


@inline
def add_rows(rows: Rows, pairs: Pairs, n: int, width: float, wall: int, wall_x: float,
             wall_y: float, x: np.ndarray, y: np.ndarray, angle: np.ndarray, c: np.ndarray,
             s: np.ndarray, mobile: np.ndarray, marked: np.ndarray, im: float, mu: float,
             e: float, mu_wall: float, e_wall: float, way: np.ndarray, far: np.ndarray,
             widest: float) -> int:
    """Rows that the marked tiles have besides those that there are.

    These tiles will come further, `way` and `far` (m), than was assumed at the beginning of the
    step; all others not.  No tile will be further than `widest` (m) from where it was when the
    pairs were listed.  Returns the number of new rows, -1 where they do not fit.
    """
    near, half = rows.used, 0.5 * width
    m, found = rows.size[0], ZERO
    most = min(rows.a.size - m, rows.single.size - rows.first[COLOURS])
    for a in range(n):
        if marked[a] == 0:
            continue
        c[a], s[a] = cos_sin(angle[a])
        for j in range(near_place(pairs, x[a], y[a], DIAGONAL * width + way[a] + widest, near)):
            b = U(near[j])
            dx, dy = x[b] - x[a], y[b] - y[a]
            reach = DIAGONAL * width + way[a] + way[b]
            # Two that are marked are found by the first of them.
            if (near[j] == a or (marked[b] != 0 and near[j] < a)
                    or dx * dx + dy * dy > reach * reach):
                continue
            c[b], s[b] = cos_sin(angle[b])
            if (pair_gap(dx, dy, c[a], s[a], c[b], s[b], half) > far[a] + far[b]
                    or has_row(rows, a, near[j], n, ZERO)):
                continue
            if found == most:
                return -1
            insert(rows, found, min(a, near[j]), max(a, near[j]), ZERO)
            found += 1
        if wall == 0 or off_wall(wall, wall_x, wall_y, x[a], y[a],
                                 0.5 * DIAGONAL * width + way[a]):
            continue
        for code in range(8):
            gap = corner_gap(wall, code, wall_x, wall_y, x[a], y[a], c[a], s[a], half)
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
        fill_lane(rows, U(slot[to]), (block + j) * int(BODIES), a, b, n, mobile, im, mu, e,
                  mu_wall, e_wall)
        if b == n:
            field[U(slot[to]) + ID0], field[U(slot[to]) + ID1] = code, code
        j -= 1
    index_rows(rows, m + found, n, mobile)
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
    """Whether there is a row of a mobile tile a and b, at this corner if b is the wall."""
    body, of = rows.body, rows.of
    for p in range(rows.start[a], rows.start[a + 1]):
        t = U(of[p] // 8) * BODIES + U(of[p] % 8)
        if (((body[t] == a and body[t + LANES] == b) or (body[t] == b and body[t + LANES] == a))
                and (b < n or rows.field[U(of[p] // 8) * BLOCK + U(of[p] % 8) + ID1] == code)):
            return True
    return False


@lane
def corner_arm(q: int, half: float, c: float, s: float) -> Any:
    """From a tile's centre to its corner q, counter-clockwise from that between E and N."""
    ex = half if (q == 0) | (q == 3) else -half
    ey = half if q < 2 else -half
    return c * ex - s * ey, s * ex + c * ey


@lane
def corner_gap(wall: int, code: int, wall_x: float, wall_y: float, x: float, y: float, c: float,
               s: float, half: float) -> float:
    """Gap of a tile's corner to a side of the wall, both told by a code (m).

    The corner is code / 2, and the side of a rectangle code % 2; a circle has but one, side 0.
    """
    rx, ry = corner_arm(code // 2, half, c, s)
    gap, _, _ = wall_gap(wall, code % 2, wall_x, wall_y, x + rx, y + ry)
    return math.inf if (wall == CIRCLE) & (code % 2 == 1) else gap


@lane
def wall_gap(wall: int, side: int, wall_x: float, wall_y: float, px: float, py: float) -> Any:
    """Gap of a point to the wall, and the normal outwards."""
    gap, nx, ny = circle_corner(px, py, wall_x)
    east, north = 1.0 if px > 0.0 else -1.0, 1.0 if py > 0.0 else -1.0
    round_wall = wall == CIRCLE
    gap = gap if round_wall else (wall_x - abs(px) if side == 0 else wall_y - abs(py))
    nx = nx if round_wall else (east if side == 0 else 0.0)
    ny = ny if round_wall else (0.0 if side == 0 else north)
    return gap, nx, ny


@inline
def colour_rows(rows: Rows, m: int, n: int, mobile: np.ndarray, im: float, mu: float, e: float,
                mu_wall: float, e_wall: float) -> bool:
    """Take the m new rows, and give them their places in the blocks, empty of impulses.

    Greedily, in order: a row takes the first colour that none of its mobile tiles has.  Returns
    whether the blocks are enough, with some to spare for rows that are found late.
    """
    used, fill, first, slot = rows.used, rows.fill, rows.first, rows.slot
    ra, rb = rows.a, rows.b
    rows.size[0] = m
    copy(rows.new_a, ra, m)
    copy(rows.new_b, rb, m)
    copy(rows.new_corner, rows.corner, m)
    set_all(used, ZERO)
    set_all(fill, ZERO)
    for i in range(m):
        a, b = ra[i], rb[i]
        colour = 0
        if b == n:
            colour = PAIR_COLOURS + used[a] // (PAIR_BITS + 1)
            used[a] += PAIR_BITS + 1
        else:
            taken = (used[a] | used[b]) & PAIR_BITS
            while taken & 1:
                taken >>= 1
                colour += 1
            if colour < PAIR_COLOURS:
                used[a] |= (1 if mobile[a] != 0.0 else 0) << colour
                used[b] |= (1 if mobile[b] != 0.0 else 0) << colour
            else:
                colour = ALONE
        slot[i] = colour
        fill[colour] += 1
    first[0], in_use = 0, 0
    for q in range(COLOURS):
        first[q + 1] = first[q] + (fill[q] if q == ALONE else (fill[q] + 7) // 8)
        if fill[q] > 0 and q < ALONE:
            rows.colours[in_use] = q
            in_use += 1
        fill[q] = 0
    rows.size[1] = in_use
    if first[COLOURS] > 3 * rows.single.size // 4:
        return False
    for block in range(first[COLOURS]):
        # `place_pairs` writes every other field of every lane, `place_walls` does not.
        empty_block(rows, block, n, ZEROED if block < first[PAIR_COLOURS] else BLOCK)
    for i in range(m):
        q = slot[i]
        block, at = first[q] + fill[q] // 8, fill[q] % 8
        if q == ALONE:
            block, at = first[q] + fill[q], 0
        fill[q] += 1
        slot[i] = block * int(BLOCK) + at
        fill_lane(rows, U(slot[i]), block * int(BODIES) + at, ra[i], rb[i], n, mobile, im, mu, e,
                  mu_wall, e_wall)
    index_rows(rows, m, n, mobile)
    return True


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
def fill_lane(rows: Rows, k: int, t: int, a: int, b: int, n: int, mobile: np.ndarray, im: float,
              mu: float, e: float, mu_wall: float, e_wall: float) -> None:
    """Put the row of a and b into lane k of the fields, and t of the bodies."""
    field, body = rows.field, rows.body
    i, j = U(k), U(t)
    body[j], body[j + LANES] = a, b
    field[i + MA], field[i + MB] = im * mobile[a], im * mobile[b]
    field[i + MU], field[i + E] = (mu_wall, e_wall) if b == n else (mu, e)
    field[i + ID0], field[i + ID1] = -2.0, -2.0


@inline
def index_rows(rows: Rows, m: int, n: int, mobile: np.ndarray) -> None:
    """List the rows of every mobile tile, in order, and find what hangs together through them."""
    ra, rb, slot, start, of, fill = rows.a, rows.b, rows.slot, rows.start, rows.of, rows.used
    island = rows.island
    set_all(start, ZERO)
    for i in range(m):
        start[U(ra[i]) + U(1)] += 1
        start[U(rb[i]) + U(1)] += 1
    for i in range(n):
        start[i + 1] = start[i] + (start[i + 1] if mobile[i] != 0.0 else 0)
        fill[i] = start[i]
    for i in range(m):
        a, b, k = U(ra[i]), U(rb[i]), U(slot[i])
        row = int(k // BLOCK * U(8) + k % BLOCK)
        if mobile[a] != 0.0:
            of[fill[a]] = row
            fill[a] += 1
        if mobile[b] != 0.0:  # the ground is not
            of[fill[b]] = row
            fill[b] += 1
    for i in range(n + 1):
        island[i] = i
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
def look(rows: Rows, block: int, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
         vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """Places and velocities of the bodies of a block of pairs, into its lanes."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    for i in range(LANES):  # gather
        a, b = U(body[t + i]), U(body[t + LANES + i])
        r[o + K00 + i], r[o + K01 + i] = c[a], s[a]
        r[o + K11 + i], r[o + KTT + i] = c[b], s[b]
        r[o + I00 + i], r[o + I11 + i] = x[b] - x[a], y[b] - y[a]
        r[o + AX + i], r[o + AY + i], r[o + AW + i] = vx[a], vy[a], w[a]
        r[o + BX + i], r[o + BY + i], r[o + BW + i] = vx[b], vy[b], w[b]


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


@inline
def place_pairs(rows: Rows, block: int, width: float, h: float) -> None:
    """Where the pairs of a block touch; every point keeps its impulse, a new point has none."""
    r, per_h2 = rows.field, 1.0 / (h * h)
    o = U(block) * BLOCK
    lone = 0
    for i in range(LANES):
        vx_ab, vy_ab = r[o + BX + i] - r[o + AX + i], r[o + BY + i] - r[o + AY + i]
        way = h * (math.sqrt(vx_ab * vx_ab + vy_ab * vy_ab)
                   + 0.7072 * width * (abs(r[o + AW + i]) + abs(r[o + BW + i])))
        count, nx, ny, id0, gap0, an0, bn0, id1, gap1, an1, bn1, at, bt, miss, of_a = square_square(
            r[o + I00 + i], r[o + I11 + i], r[o + K00 + i], r[o + K01 + i], r[o + K11 + i],
            r[o + KTT + i], width, SPARE * width + way)
        wa, wb = r[o + AW + i], r[o + BW + i]
        bend0, bend1 = bends(
            width, gap0, gap1, at - bt, bn0 - an0, -bn0 if of_a else an0, -bn1 if of_a else an1,
            h * (nx * vx_ab + ny * vy_ab), h * (nx * vy_ab - ny * vx_ab), h * (wa if of_a else wb),
            h * (wb - wa if of_a else wa - wb))
        r[o + BEND0 + i], r[o + BEND1 + i] = per_h2 * bend0, per_h2 * bend1
        r[o + HIT + i] = 1.0 if (miss > 0.0) & (miss < way) else 0.0
        count = 0.0 if r[o + MA + i] + r[o + MB + i] == 0.0 else count  # an empty lane
        id1 = -1.0 if count < 1.5 else id1
        was0, was1, q0, q1 = r[o + ID0 + i], r[o + ID1 + i], r[o + PN0 + i], r[o + PN1 + i]
        p0 = q0 if id0 == was0 else (q1 if id0 == was1 else 0.0)
        p1 = q1 if id1 == was1 else (q0 if id1 == was0 else 0.0)
        p0 = 0.0 if count == 0.0 else p0
        p1 = 0.0 if count < 1.5 else p1
        pt = 0.0 if (p0 == 0.0) & (p1 == 0.0) else r[o + PT + i]
        r[o + COUNT + i], r[o + NX + i], r[o + NY + i] = count, nx, ny
        r[o + ID0 + i], r[o + GAP0 + i] = id0, gap0
        r[o + AN0 + i], r[o + BN0 + i] = an0, bn0
        r[o + ID1 + i], r[o + GAP1 + i] = id1, gap1
        r[o + AN1 + i], r[o + BN1 + i] = an1, bn1
        r[o + AT + i], r[o + BT + i] = at, bt
        r[o + PN0 + i], r[o + PN1 + i], r[o + PT + i] = p0, p1, pt
        r[o + WARM0 + i], r[o + WARM1 + i], r[o + WARMT + i] = p0, p1, pt
        lone += 1 if count == 1.0 else 0
    rows.single[block] = lone


@inline
def passing(rows: Rows, block: int) -> int:
    """Rows of a block whose tiles pass each other, but may meet within the substep."""
    r = rows.field
    o = U(block) * BLOCK
    some = 0
    for i in range(LANES):  # a loop of its own, or that of `place_pairs` would not vectorise
        some += 1 if r[o + HIT + i] != 0.0 else 0
    return some


@inline
def foresee(rows: Rows, block: int, width: float, h: float) -> None:
    """Corners that now pass each other, at the sides of a face, but will meet within h.

    Where both tiles are in h/4, h/2, ... tells; the row gets the first manifold that overlaps,
    its arms led back to the tiles' present centres and its gaps to the present time.
    """
    r = rows.field
    o = U(block) * BLOCK
    for i in range(LANES):
        k = o + i
        if r[k + HIT] == 0.0:
            continue
        for quarter in range(1, 5):
            t = 0.25 * quarter * h
            ux, uy, wa, wb = r[k + BX] - r[k + AX], r[k + BY] - r[k + AY], r[k + AW], r[k + BW]
            ca, sa = cos_sin(t * wa)
            cb, sb = cos_sin(t * wb)
            count, nx, ny, id0, gap0, an0, bn0, id1, gap1, an1, bn1, at, bt, _, _ = square_square(
                r[k + I00] + t * ux, r[k + I11] + t * uy,
                ca * r[k + K00] - sa * r[k + K01], sa * r[k + K00] + ca * r[k + K01],
                cb * r[k + K11] - sb * r[k + KTT], sb * r[k + K11] + cb * r[k + KTT],
                width, SPARE * width)
            if count == 0.0 or min(gap0, gap1) > 0.0:
                continue
            ax, ay, bx, by = t * r[k + AX], t * r[k + AY], t * r[k + BX], t * r[k + BY]
            across_a, across_b = ax * ny - ay * nx, bx * ny - by * nx
            an0, an1, bn0, bn1 = an0 + across_a, an1 + across_a, bn0 + across_b, bn1 + across_b
            along = nx * ux + ny * uy
            r[k + COUNT], r[k + NX], r[k + NY] = count, nx, ny
            r[k + ID0], r[k + GAP0] = id0, gap0 - t * (along + bn0 * wb - an0 * wa)
            r[k + ID1], r[k + GAP1] = id1 if count == 2.0 else -1.0, gap1 - t * (
                along + bn1 * wb - an1 * wa)
            r[k + AN0], r[k + BN0], r[k + AN1], r[k + BN1] = an0, bn0, an1, bn1
            r[k + AT], r[k + BT] = at + ax * nx + ay * ny, bt + bx * nx + by * ny
            r[k + BEND0] = r[k + BEND1] = 0.0  # the manifold is that of the way's end
            rows.single[block] += 1 if count == 1.0 else 0
            break


@inline
def place_walls(rows: Rows, block: int, n: int, width: float, h: float, wall: int, wall_x: float,
                wall_y: float, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
                vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """Where the corners of a block touch the wall."""
    r, body = rows.field, rows.body
    o, t = U(block) * BLOCK, U(block) * BODIES
    rows.single[block] = 8
    for i in range(LANES):
        a = U(body[t + i])
        if a == U(n):
            continue
        q = int(r[o + ID1 + i])
        rx, ry = corner_arm(q // 2, 0.5 * width, c[a], s[a])
        gap, nx, ny = wall_gap(wall, q % 2, wall_x, wall_y, x[a] + rx, y[a] + ry)
        margin = SPARE * width + h * (math.sqrt(vx[a] * vx[a] + vy[a] * vy[a])
                                      + 0.7072 * width * abs(w[a]))
        count = 1.0 if gap <= margin else 0.0
        r[o + COUNT + i], r[o + NX + i], r[o + NY + i] = count, nx, ny
        r[o + GAP0 + i], r[o + GAP1 + i] = gap, gap
        r[o + AN0 + i], r[o + BN0 + i] = rx * ny - ry * nx, 0.0
        r[o + AN1 + i], r[o + BN1 + i] = r[o + AN0 + i], 0.0
        r[o + AT + i], r[o + BT + i] = rx * nx + ry * ny, 0.0
        up, over = arc(h * w[a])
        fx, fy = h * (vx[a] - w[a] * ry), h * (vy[a] + w[a] * rx)
        later, _, _ = wall_gap(wall, q % 2, wall_x, wall_y, x[a] + rx + fx - up * rx + over * ry,
                               y[a] + ry + fy - up * ry - over * rx)
        r[o + BEND0 + i] = r[o + BEND1 + i] = (later - gap + nx * fx + ny * fy) / (h * h)
        r[o + PN0 + i] *= count
        r[o + PT + i] *= count if r[o + PN0 + i] != 0.0 else 0.0
        r[o + WARM0 + i], r[o + WARM1 + i], r[o + WARMT + i] = r[o + PN0 + i], 0.0, r[o + PT + i]
        r[o + AX + i], r[o + AY + i], r[o + AW + i] = vx[a], vy[a], w[a]


@inline
def place_block(rows: Rows, block: int, n: int, width: float, h: float, wall: int, wall_x: float,
                wall_y: float, x: np.ndarray, y: np.ndarray, c: np.ndarray, s: np.ndarray,
                vx: np.ndarray, vy: np.ndarray, w: np.ndarray) -> None:
    """Where the rows of any one block touch now."""
    if rows.body[U(block) * BODIES + LANES] == n:
        place_walls(rows, block, n, width, h, wall, wall_x, wall_y, x, y, c, s, vx, vy, w)
        return
    look(rows, block, x, y, c, s, vx, vy, w)
    place_pairs(rows, block, width, h)
    if passing(rows, block) > 0:
        foresee(rows, block, width, h)


@inline
def weigh_block(rows: Rows, block: int, h: float, per_mass: float, threshold: float) -> int:
    """Effective masses of a block's rows and what closes; returns the points that hit.

    k00, k11: velocity change of a point for a unit impulse there; k01: ... at the other point,
    or in a row of one point by a unit of friction; ktt: the same for friction; i: inverses, and
    idet that of the 2 x 2 problem, not a number where it has none.  `per_mass` is m/I.  A point
    hits if it closes within h, faster than the threshold, and has not been in contact: points
    that are pressed together approach by what the last solve left, and leave it to the next.
    """
    r, per_h = rows.field, 1.0 / h
    o = U(block) * BLOCK
    some = 0
    for i in range(LANES):
        ma, mb = r[o + MA + i], r[o + MB + i]
        an0, bn0, an1, bn1 = r[o + AN0 + i], r[o + BN0 + i], r[o + AN1 + i], r[o + BN1 + i]
        at, bt, count = r[o + AT + i], r[o + BT + i], r[o + COUNT + i]
        wa, wb, nx, ny = r[o + AW + i], r[o + BW + i], r[o + NX + i], r[o + NY + i]
        linear, ia, ib = ma + mb, per_mass * ma, per_mass * mb
        k00 = linear + ia * an0 * an0 + ib * bn0 * bn0
        k11 = linear + ia * an1 * an1 + ib * bn1 * bn1
        ktt = linear + ia * at * at + ib * bt * bt
        one, two = count == 1.0, count == 2.0  # neither: a row that is not in contact
        an, bn = (at if one else an1), (bt if one else bn1)
        k01 = (0.0 if one else linear) + ia * an0 * an + ib * bn0 * bn
        both = k00 * (ktt if one else k11)
        det = both - k01 * k01
        r[o + K00 + i], r[o + K01 + i], r[o + K11 + i], r[o + KTT + i] = k00, k01, k11, ktt
        r[o + I00 + i] = 1.0 / k00 if k00 > 0.0 else 0.0
        r[o + I11 + i] = 1.0 / k11 if k11 > 0.0 else 0.0
        r[o + ITT + i] = 1.0 / ktt if ktt > 0.0 else 0.0
        r[o + IDET + i] = 1.0 / det if det > 1e-9 * both else np.nan
        along = (nx * (r[o + BX + i] - r[o + AX + i]) + ny * (r[o + BY + i] - r[o + AY + i]))
        vn0, vn1 = along + bn0 * wb - an0 * wa, along + bn1 * wb - an1 * wa
        r[o + VN0 + i], r[o + VN1 + i] = vn0, vn1
        gap0, gap1 = r[o + GAP0 + i], r[o + GAP1 + i]
        none = count == 0.0
        bend0 = mirrored(h * r[o + BEND0 + i], vn0)
        bend1 = mirrored(h * r[o + BEND1 + i], vn1)
        r[o + BEND0 + i], r[o + BEND1 + i] = per_h * bend0, per_h * bend1
        r[o + WANT0 + i] = NEVER if none else want(per_h * gap0, bend0)
        r[o + WANT1 + i] = NEVER if none else want(per_h * gap1, bend1)
        hit0 = ((count > 0.5) & (vn0 < -threshold) & (gap0 + h * (vn0 + bend0) < 0.0)
                & (r[o + WARM0 + i] == 0.0))
        hit1 = (two & (vn1 < -threshold) & (gap1 + h * (vn1 + bend1) < 0.0)
                & (r[o + WARM1 + i] == 0.0))
        r[o + HIT + i] = (1.0 if hit0 else 0.0) + (2.0 if hit1 else 0.0)
        some += (1 if hit0 else 0) + (1 if hit1 else 0)
    rows.hits[block] = some
    queued, first = rows.queued, U(block) * LANES
    for i in range(LANES):
        queued[first + i] = 1 if r[o + COUNT + i] == 0.0 else 0
    return some


@inline
def deepest_gap(rows: Rows, block: int) -> float:
    """Deepest overlap of the rows of a block that are in contact, as a gap < 0; else 0 (m)."""
    r = rows.field
    o = U(block) * BLOCK
    deepest = 0.0
    for i in range(LANES):
        gap = min(r[o + GAP0 + i], r[o + GAP1 + i])
        deepest = min(deepest, gap if r[o + COUNT + i] != 0.0 else 0.0)
    return deepest


@inline
def place_rows(rows: Rows, n: int, width: float, h: float, wall: int, wall_x: float,
               wall_y: float, per_mass: float, threshold: float, x: np.ndarray, y: np.ndarray,
               c: np.ndarray, s: np.ndarray, vx: np.ndarray, vy: np.ndarray, w: np.ndarray,
               begin: int, last: int) -> Any:
    """Where the rows of these blocks touch now, and what they weigh: `place_block` and
    `weigh_block`.

    CHUNK blocks at a time: they stay in the first-level cache from one loop to the next, and what
    `look` has written is not read before it has got there.  Returns the number of points that hit,
    and the deepest overlap (m).
    """
    struck, deepest, pairs = 0, 0.0, rows.first[PAIR_COLOURS]
    for start in range(begin, last, CHUNK):
        end = min(start + CHUNK, last)
        if end <= pairs:
            for block in range(start, end):
                look(rows, block, x, y, c, s, vx, vy, w)
            for block in range(start, end):
                place_pairs(rows, block, width, h)
            for block in range(start, end):
                if passing(rows, block) > 0:
                    foresee(rows, block, width, h)
        else:
            for block in range(start, end):
                place_block(rows, block, n, width, h, wall, wall_x, wall_y, x, y, c, s, vx, vy, w)
        for block in range(start, end):
            struck += weigh_block(rows, block, h, per_mass, threshold)
            deepest = min(deepest, deepest_gap(rows, block))
    return struck, -deepest


@inline
def recall(rows: Rows, m: int, n: int, old: Impulses) -> None:
    """Give the rows the impulses that their manifolds had at the end of the last step."""
    ra, rb, corner, slot, r = rows.a, rows.b, rows.corner, rows.slot, rows.field
    oa, ob, oid0, oid1 = old.a, old.b, old.id0, old.id1
    opn0, opn1, opt = old.pn0, old.pn1, old.pt
    j, size = 0, old.size[0]
    for i in range(m):
        a, b, k, wall = ra[i], rb[i], U(slot[i]), rb[i] == n
        if wall:  # its one id is fixed, and known to `place_rows`
            r[k + ID0], r[k + ID1] = float(corner[i]), float(corner[i])
        while j < size and (oa[j] < a or (oa[j] == a and (
                ob[j] < b or (wall and ob[j] == b and oid0[j] < corner[i])))):
            j += 1
        if j == size or oa[j] != a or ob[j] != b or (wall and oid0[j] != corner[i]):
            continue
        r[k + PN0], r[k + PN1], r[k + PT] = opn0[j], opn1[j], opt[j]
        if not wall:
            r[k + ID0], r[k + ID1] = float(oid0[j]), float(oid1[j])


@inline
def remember(rows: Rows, m: int, n: int, store: Impulses) -> None:
    """Store the impulses of the rows that carry any."""
    ra, rb, slot, r = rows.a, rows.b, rows.slot, rows.field
    sa, sb, sid0, sid1 = store.a, store.b, store.id0, store.id1
    spn0, spn1, spt = store.pn0, store.pn1, store.pt
    j = 0
    for i in range(m):
        k = U(slot[i])
        if r[k + PN0] == 0.0 and r[k + PN1] == 0.0:
            continue
        sa[j], sb[j], sid0[j] = ra[i], rb[i], int(r[k + ID0])
        sid1[j] = -1 if rb[i] == n else int(r[k + ID1])
        spn0[j], spn1[j], spt[j] = r[k + PN0], r[k + PN1], r[k + PT]
        j += 1
    store.size[0] = j
