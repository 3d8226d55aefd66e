"""Broad phase: a cell list, and from it a list of near pairs that many substeps share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tbsa.kernels.jit import U, copy, inline, kernel


class Pairs(NamedTuple):
    """Pairs (a < b) nearer than reach + margin of a + margin of b, in the order of a, then b.

    The pairs of tile a are ``other[start[a]:start[a + 1]]``.  The order depends on the tile
    numbers alone, and a pair beyond the reach contributes nothing, so results do not depend
    on when the list was last built.
    """

    start: np.ndarray  # int64[n + 1]
    other: np.ndarray  # int64[capacity]
    x: np.ndarray  # float64[n], where the tiles were
    y: np.ndarray
    margin: np.ndarray  # float64[n], m, how far each may go from there; -1: never built


def empty_pairs(n: int, capacity: int) -> Pairs:
    """Space for the pairs of `n` tiles."""
    return Pairs(
        np.zeros(n + 1, np.int64), np.zeros(capacity, np.int64), np.zeros(n), np.zeros(n),
        np.full(n, -1.0),
    )


@inline
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


@kernel
def build_pairs(pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray, mobile: np.ndarray,
                reach: float, margin: np.ndarray) -> int:
    """List every pair nearer than the reach and both margins with at least one mobile tile.

    Returns the number of pairs found; where that exceeds the capacity the list is of no use and
    the caller grows it.  -1: a position is not finite.
    """
    start, other = pairs.start, pairs.other
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
    first = np.zeros(nx * ny + 1, np.int64)
    at = np.empty(n, np.int64)
    for i in range(n):
        at[i] = int((x[i] - x0) / cell) + nx * int((y[i] - y0) / cell)
        first[at[i] + 1] += 1
    for k in range(nx * ny):
        first[k + 1] += first[k]
    fill = first[:-1].copy()
    inside = np.empty(n, np.int64)
    for i in range(n):
        inside[fill[at[i]]] = i
        fill[at[i]] += 1

    found, room = 0, other.size
    for a in range(n):
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
    start[n] = found
    if found > other.size:
        pairs.margin[:] = -1.0
        return found
    copy(margin, pairs.margin, n)
    copy(x, pairs.x, n)
    copy(y, pairs.y, n)
    return found
