"""Broad phase: a cell list, and from it a list of near pairs that many substeps share."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import copy, lean, set_all
from tbsa.kernels.crew import LEAST_TILES, LINE, PAIRS, Crew, collect, give, share
from tbsa.kernels.jit import ZERO, U, apart, inline, kernel, lane, rolled

# Cells, up to which they are told apart; and tiles that one has in the cells of all, itself among
# them, in the mean, with which these are too crowded.
FARTHEST, CROWDED = 1e9, 8


class Pairs(NamedTuple):
    """Pairs (a < b) nearer than reach + margin of a + margin of b, in the order of a, then b.

    The pairs of tile a are ``other[start[a]:start[a + 1]]``.  The order depends on the tile
    numbers alone, and a pair beyond the reach contributes nothing, so results do not depend
    on when the list was last built.
    """

    start: np.ndarray  # int64[n + 1]
    other: np.ndarray  # int64[room]
    room: int
    x: np.ndarray  # float64[n], where the tiles were
    y: np.ndarray
    fromx: np.ndarray  # float64[n], where those were then, or later, whose pairs are as of later
    fromy: np.ndarray
    margin: np.ndarray  # float64[n], m, how far each may go from there; -1: never built
    late: np.ndarray  # int64[n + 1], whether that is later; and how many there are
    again: np.ndarray  # int64[n], which they are
    more: np.ndarray  # int64[n], scratch
    first: np.ndarray  # int64[cells + 1], where the tiles of every cell begin in ...
    inside: np.ndarray  # int64[n]
    corner: np.ndarray  # float64[3], m, the least x and y of the tiles, and the size of a cell
    # int64[4], how many along x and along y, and the last one of each: where that is beyond, they
    # come again after so many, a power of two
    cells: np.ndarray


def empty_pairs(n: int, capacity: int) -> Pairs:
    """Space for the pairs of `n` tiles."""
    return Pairs(
        np.zeros(n + 1, np.int64), np.zeros(capacity, np.int64), capacity, np.zeros(n),
        np.zeros(n), np.zeros(n), np.zeros(n), np.full(n, -1.0), np.zeros(n + 1, np.int64),
        np.zeros(n, np.int64), np.zeros(n, np.int64),
        np.zeros(int(2.0 * n**0.5 + 4.0) ** 2 + 1, np.int64),
        np.zeros(n, np.int64), np.zeros(3), np.zeros(4, np.int64),
    )


@lane
def cell_of(way: float, cell: float) -> int:
    """The number of the cell so far (m) from the first."""
    return int(min(max(way / cell, 0.0), FARTHEST))


@lane
def span(way: float, far: float, cell: float, cells: int, last: int) -> Any:
    """Which of so many cells are within `far` (m) of a place so far from the first: the first of
    them, how many from there on, and how many more from number 0 on."""
    low, high = cell_of(way - far, cell), min(cell_of(way + far, cell), last)
    if cells > last:  # none comes again
        return low, max(high - low + 1, 0), 0
    number = min(high - low + 1, cells)
    first = low & (cells - 1) if number < cells else 0
    here = min(number, cells - first)
    return first, max(here, 0), max(number - here, 0)


@rolled
def stale(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, far: np.ndarray) -> int:
    """How many tiles, in ``more``, may come to where they have pairs that are not on the list, if
    they go as `far` as this from here (m)."""
    px, py, margin, more = pairs.fromx, pairs.fromy, pairs.margin, pairs.more
    some = 0
    for i in range(U(n)):
        dx, dy = x[i] - px[i], y[i] - py[i]
        room = margin[i] - far[i]  # comparisons so that what is not a number is stale
        more[i] = 0 if (room >= 0.0) & (dx * dx + dy * dy <= room * room) else 1
        some += more[i]
    return some


@inline
def fill_cells(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray) -> int:
    """Put the tiles into their cells; returns in how much company they are, in sum."""
    first, inside, cells = pairs.first, pairs.inside, pairs.cells
    x0, y0, cell = pairs.corner[0], pairs.corner[1], pairs.corner[2]
    nx, all_cells = cells[0], cells[0] * cells[1]
    again_x = cells[0] - 1 if cells[0] <= cells[2] else ~ZERO
    again_y = cells[1] - 1 if cells[1] <= cells[3] else ~ZERO
    # Counted one cell on, so that filling moves every start to its place.
    for k in range(all_cells + 1):
        first[k] = 0
    for i in range(n):
        at = (cell_of(x[i] - x0, cell) & again_x) + nx * (cell_of(y[i] - y0, cell) & again_y)
        if at + 2 <= all_cells:
            first[at + 2] += 1
    for k in range(2, all_cells + 1):
        first[k] += first[k - 1]
    for i in range(n):
        at = (cell_of(x[i] - x0, cell) & again_x) + nx * (cell_of(y[i] - y0, cell) & again_y)
        inside[first[at + 1]] = i
        first[at + 1] += 1
    company = 0
    for k in range(all_cells):
        company += (first[k + 1] - first[k]) * (first[k + 1] - first[k])
    return company


@inline
def list_pairs(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
               reach: float, margin: np.ndarray, crew: Crew) -> int:
    """List every pair nearer than the reach and both margins with at least one mobile tile.

    Returns the number of pairs found; where that exceeds the capacity the list is of no use and
    the caller grows it.  -1: a position is not finite.
    """
    start, other, cells = pairs.start, pairs.other, pairs.cells
    room = pairs.room
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    widest = 0.0
    for i in range(n):
        widest = max(widest, margin[i])
        if not (np.isfinite(x[i]) and np.isfinite(y[i]) and np.isfinite(margin[i])):
            return -1
        x0, x1, y0, y1 = min(x0, x[i]), max(x1, x[i]), min(y0, y[i]), max(y1, y[i])
    # Cells of half the distance that most tiles need; wider where tiles are scattered far apart,
    # so that there are never more than a few cells a tile.  Where these are crowded, as a few tiles
    # are far from the others, narrow ones that come again and again, as on a floor rolled up.
    cell = max(0.5 * reach, max(x1 - x0, y1 - y0) / (2.0 * np.sqrt(n) + 2.0))
    pairs.corner[0], pairs.corner[1], pairs.corner[2] = x0, y0, cell
    last_x, last_y = cell_of(x1 - x0, cell), cell_of(y1 - y0, cell)
    cells[0], cells[1], cells[2], cells[3] = last_x + 1, last_y + 1, last_x, last_y
    company = fill_cells(pairs, n, x, y)
    if cell > 0.5 * reach and company > CROWDED * n:
        cell = 0.5 * reach
        last_x, last_y = cell_of(x1 - x0, cell), cell_of(y1 - y0, cell)
        nx = ny = 1
        while nx * ny <= 2 * n and (nx <= last_x or ny <= last_y):
            more = nx <= last_x and (nx <= ny or ny > last_y)
            nx, ny = nx * (2 if more else 1), ny * (1 if more else 2)
        pairs.corner[2] = cell
        cells[0], cells[1], cells[2], cells[3] = nx, ny, last_x, last_y
        fill_cells(pairs, n, x, y)

    crew.numbers[0], crew.numbers[1] = reach, widest
    _, end = give(crew, PAIRS, ZERO, n, LEAST_TILES)
    threads = crew.size if end < n else 1
    found: Any = pairs_from(pairs, x, y, mobile, reach, margin, widest, ZERO, end, ZERO,
                            place_of(room, end, n))
    collect(crew)
    # Of a list that is full the last one may have been written over by one that is not kept.
    fits = found < place_of(room, end, n)
    for helper in range(1, threads):
        a, end = share(crew, helper, ZERO, n)
        at, more = place_of(room, a, n), crew.found[helper * LINE]
        fits = fits and more < place_of(room, end, n) - at
        if fits:
            close_up(other, at, found, more)
            for i in range(U(a), U(end)):
                start[i] += found - at
        found += more
    start[n] = found
    if not fits:
        set_all(pairs.margin, n, -1.0)
        return int(max(found, room + 1))
    copy(margin, pairs.margin, n)
    copy(x, pairs.x, n)
    copy(y, pairs.y, n)
    copy(x, pairs.fromx, n)
    copy(y, pairs.fromy, n)
    set_all(pairs.late, n + 1, ZERO)
    return int(found)


@apart
def list_again(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
               reach: float, margin: np.ndarray) -> int:
    """List the pairs that the `stale` tiles have, with these margins, besides those on the list.

    The others stay as they are: they are found by the cells that they were put in, or, if they have
    been listed again since, looked through.  Returns the number of all pairs, -1 where they do not
    fit or a place is not finite.
    """
    start, other, late, again, near = pairs.start, pairs.other, pairs.late, pairs.again, pairs.more
    px, py, room, old = pairs.fromx, pairs.fromy, pairs.room, start[n]
    widest, new = 0.0, ZERO
    for i in range(n):
        if pairs.more[i] != 0:
            if late[i] == 0:
                again[late[n]] = i
                late[n] += 1
            late[i] = 2  # now
            px[i], py[i], pairs.margin[i] = x[i], y[i], margin[i]
            if not math.isfinite(x[i] + y[i] + margin[i]):
                return -1
        widest = max(widest, pairs.margin[i])
    size = late[n]
    for j in range(size):
        a = again[j]
        if late[a] != 2:
            continue
        far = reach + margin[a]
        found = near_place(pairs, px[a], py[a], far + widest, near)
        for p in range(found + size):
            b = near[p] if p < found else again[p - found]
            # Of two that are listed again now, by the first of them.
            if b == a or (p < found and late[b] != 0) or (late[b] == 2 and b < a):
                continue
            dx, dy, room_ab = px[b] - px[a], py[b] - py[a], far + pairs.margin[b]
            low, high = min(a, b), max(a, b)
            if (dx * dx + dy * dy >= room_ab * room_ab or mobile[a] + mobile[b] == 0.0
                    or is_listed(pairs, low, high)):
                continue
            new += 1
            if old + 2 * new > room:
                return -1
            other[room - new] = low * n + high  # out of the way
    insert_pairs(pairs, n, new)
    for j in range(size):
        late[again[j]] = 1
    return int(start[n])


@inline
def is_listed(pairs: Pairs, a: int, b: int) -> bool:
    """Whether the pair a < b is on the list."""
    for k in range(pairs.start[a], pairs.start[a + 1]):
        if pairs.other[k] >= b:
            return bool(pairs.other[k] == b)
    return False


@inline
def insert_pairs(pairs: Pairs, n: int, new: int) -> None:
    """Put the pairs at the end of the space, as a n + b, where they belong on the list."""
    start, other, more, room = pairs.start, pairs.other, pairs.more, pairs.room
    set_all(more, n, ZERO)
    for j in range(room - new, room):
        more[other[j] // n] += 1
    left, end = new, start[n]
    start[n] += new
    for a in range(n - 1, -1, -1):  # from the last one down, to where nothing is new
        if left == 0:
            break
        left -= more[a]
        for k in range(end - 1, start[a] - 1, -1):
            other[k + left] = other[k]
        end = start[a]
        start[a] += left
    for j in range(room - new, room):
        a, b = other[j] // n, other[j] % n
        k = start[a + 1] - more[a]
        more[a] -= 1
        while k > start[a] and other[k - 1] > b:
            other[k] = other[k - 1]
            k -= 1
        other[k] = b


@kernel
def build_pairs(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
                reach: float, margin: np.ndarray, crew: Crew) -> int:
    """`list_pairs`, for Python."""
    return int(list_pairs(lean(pairs), n, lean(x), lean(y), lean(mobile), reach, lean(margin),
                          lean(crew)))


@inline
def close_up(numbers: np.ndarray, begin: int, to: int, n: int) -> None:
    """Move n numbers to a place before them."""
    for i in range(U(n)):
        numbers[U(to) + i] = numbers[U(begin) + i]


@lane
def place_of(room: int, tile: int, n: int) -> int:
    """Where the pairs of a tile may begin if the tiles before it are another thread's: all tiles of
    a large crowd have about as many, as they are numbered along a curve (`model/layout.py`)."""
    return room * tile // n


@lane
def pairs_from(pairs: Pairs, x: np.ndarray, y: np.ndarray, mobile: np.ndarray, reach: float,
               margin: np.ndarray, widest: float, begin: int, last: int, at: int,
               room: int) -> int:
    """List the pairs of these tiles from place `at` to `room`; returns how many they are."""
    start, other, first, inside = pairs.start, pairs.other, pairs.first, pairs.inside
    x0, y0, cell, cells = pairs.corner[0], pairs.corner[1], pairs.corner[2], pairs.cells
    nx, ny = cells[0], cells[1]
    found = at
    for a in range(begin, last):
        start[a] = found
        xa, ya, held, far = x[a], y[a], mobile[a] == 0.0, reach + margin[a]
        column, columns, again = span(xa - x0, far + widest, cell, nx, cells[2])
        row, rows, more = span(ya - y0, far + widest, cell, ny, cells[3])
        for r in range(row, row + rows + more):
            of_row = nx * (r if r < ny else r - ny)
            for turn in range(1 if again == 0 else 2):
                low, high = (column, column + columns) if turn == 0 else (0, again)
                for k in range(first[of_row + low], first[of_row + high]):
                    t = U(inside[k])
                    dx, dy = x[t] - xa, y[t] - ya
                    # Written in any case and kept by moving on, as no branch can be foreseen.
                    other[U(min(found, room - 1))] = inside[k]
                    room_ab = far + margin[t]
                    found += ((inside[k] > a) & (dx * dx + dy * dy < room_ab * room_ab)
                              & (not (held & (mobile[t] == 0.0))))
        for k in range(start[a] + 1, min(found, room)):  # in order
            b, j = other[k], k
            while j > start[a] and other[j - 1] > b:
                other[j] = other[j - 1]
                j -= 1
            other[j] = b
    return found - at


@inline
def first_of(pairs: Pairs, n: int, part: int, parts: int) -> int:
    """The first tile of one of so many parts that have about as many pairs each."""
    start = pairs.start
    low, high, sought = 0, n, start[n] * part // parts
    if part == parts:
        return n
    while low < high:
        mid = (low + high) // 2
        if start[mid] < sought:
            low = mid + 1
        else:
            high = mid
    return low


@inline
def near_place(pairs: Pairs, x: float, y: float, far: float, found: np.ndarray) -> int:
    """List, into `found`, the tiles that were in the cells within `far` (m) of a place when the
    pairs were listed; returns how many."""
    first, inside = pairs.first, pairs.inside
    x0, y0, cell, cells = pairs.corner[0], pairs.corner[1], pairs.corner[2], pairs.cells
    nx, ny = cells[0], cells[1]
    m = 0
    if nx == 0 or not math.isfinite(x + y + far):
        return m
    column, columns, again = span(x - x0, far, cell, nx, cells[2])
    row, rows, more = span(y - y0, far, cell, ny, cells[3])
    for r in range(row, row + rows + more):
        of_row = nx * (r if r < ny else r - ny)
        for turn in range(1 if again == 0 else 2):
            low, high = (column, column + columns) if turn == 0 else (0, again)
            for k in range(first[of_row + low], first[of_row + high]):
                found[m] = inside[k]
                m += 1
    return m
