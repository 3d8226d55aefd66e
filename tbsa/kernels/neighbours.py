"""Broad phase: a cell list, and from it a list of near pairs that many substeps share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tbsa.kernels.arrays import copy, lean, set_all
from tbsa.kernels.crew import LEAST_TILES, LINE, PAIRS, Crew, collect, give, share
from tbsa.kernels.jit import ZERO, U, inline, kernel, lane, rolled


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
    margin: np.ndarray  # float64[n], m, how far each may go from there; -1: never built
    first: np.ndarray  # int64[cells + 1], where the tiles of every cell begin in ...
    inside: np.ndarray  # int64[n]
    corner: np.ndarray  # float64[3], m, the least x and y of the tiles, and the size of a cell
    cells: np.ndarray  # int64[2], along x and along y


def empty_pairs(n: int, capacity: int) -> Pairs:
    """Space for the pairs of `n` tiles."""
    return Pairs(
        np.zeros(n + 1, np.int64), np.zeros(capacity, np.int64), capacity, np.zeros(n),
        np.zeros(n), np.full(n, -1.0), np.zeros(int(2.0 * n**0.5 + 4.0) ** 2 + 1, np.int64),
        np.zeros(n, np.int64), np.zeros(3), np.zeros(2, np.int64),
    )


@rolled
def stale(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, far: np.ndarray) -> bool:
    """Whether a tile that goes as `far` as this from here (m) may come to where it has pairs
    that are not on the list."""
    px, py, margin = pairs.x, pairs.y, pairs.margin
    some = 0
    for i in range(U(n)):
        dx, dy = x[i] - px[i], y[i] - py[i]
        room = margin[i] - far[i]  # comparisons so that what is not a number is stale
        some += 0 if (room >= 0.0) & (dx * dx + dy * dy <= room * room) else 1
    return some > 0


@inline
def list_pairs(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
               reach: float, margin: np.ndarray, crew: Crew) -> int:
    """List every pair nearer than the reach and both margins with at least one mobile tile.

    Returns the number of pairs found; where that exceeds the capacity the list is of no use and
    the caller grows it.  -1: a position is not finite.
    """
    start, other, first, inside = pairs.start, pairs.other, pairs.first, pairs.inside
    room = pairs.room
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    widest = 0.0
    for i in range(n):
        widest = max(widest, margin[i])
        if not (np.isfinite(x[i]) and np.isfinite(y[i]) and np.isfinite(margin[i])):
            return -1
        x0, x1, y0, y1 = min(x0, x[i]), max(x1, x[i]), min(y0, y[i]), max(y1, y[i])
    # Cells of half the distance that most tiles need; wider where tiles are scattered far apart,
    # so that there are never more than a few cells a tile.
    cell = max(0.5 * reach, max(x1 - x0, y1 - y0) / (2.0 * np.sqrt(n) + 2.0))
    nx, ny = int((x1 - x0) / cell) + 1, int((y1 - y0) / cell) + 1
    pairs.corner[0], pairs.corner[1], pairs.corner[2] = x0, y0, cell
    pairs.cells[0], pairs.cells[1] = nx, ny
    # Counted one cell on, so that filling moves every start to its place.
    for k in range(nx * ny + 1):
        first[k] = 0
    for i in range(n):
        at = int((x[i] - x0) / cell) + nx * int((y[i] - y0) / cell)
        if at + 2 <= nx * ny:
            first[at + 2] += 1
    for k in range(2, nx * ny + 1):
        first[k] += first[k - 1]
    for i in range(n):
        at = int((x[i] - x0) / cell) + nx * int((y[i] - y0) / cell)
        inside[first[at + 1]] = i
        first[at + 1] += 1

    crew.numbers[0], crew.numbers[1] = reach, widest
    _, end = give(crew, PAIRS, ZERO, n, LEAST_TILES)
    threads = crew.size if end < n else 1
    found: Any = pairs_from(pairs, n, x, y, mobile, reach, margin, widest, ZERO, end, ZERO,
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
    return int(found)


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
def pairs_from(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
               reach: float, margin: np.ndarray, widest: float, begin: int, last: int, at: int,
               room: int) -> int:
    """List the pairs of these tiles from place `at` to `room`; returns how many they are."""
    start, other, first, inside = pairs.start, pairs.other, pairs.first, pairs.inside
    x0, y0, cell = pairs.corner[0], pairs.corner[1], pairs.corner[2]
    nx, ny = pairs.cells[0], pairs.cells[1]
    found = at
    for a in range(begin, last):
        start[a] = found
        xa, ya, held, far = x[a], y[a], mobile[a] == 0.0, reach + margin[a]
        left = int(max(xa - x0 - far - widest, 0.0) / cell)
        right = int(min((xa - x0 + far + widest) / cell, nx - 1.0))
        for r in range(int(max(ya - y0 - far - widest, 0.0) / cell),
                       int(min((ya - y0 + far + widest) / cell, ny - 1.0)) + 1):
            for k in range(first[left + nx * r], first[right + nx * r + 1]):
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
    x0, y0, cell = pairs.corner[0], pairs.corner[1], pairs.corner[2]
    nx, ny = pairs.cells[0], pairs.cells[1]
    m = 0
    if nx == 0:
        return m
    left, right = max((x - far - x0) / cell, 0.0), min((x + far - x0) / cell, nx - 1.0)
    low, high = max((y - far - y0) / cell, 0.0), min((y + far - y0) / cell, ny - 1.0)
    if not (left <= right and low <= high):  # beyond them all, or not a number
        return m
    for row in range(int(low), int(high) + 1):
        for k in range(first[int(left) + nx * row], first[int(right) + nx * row + 1]):
            found[m] = inside[k]
            m += 1
    return m
