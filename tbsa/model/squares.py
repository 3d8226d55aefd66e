"""Equal squares in numpy, for checking and placing many tiles at once.

The kernels have their own, scalar geometry; this one is for scenes and layouts, where no
compiled code is needed.  Arrays broadcast; lengths in m, angles in rad.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from tbsa.model.scene import Reactor, Seed

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def lattice(
    seed: Seed, width: float, columns: ArrayLike, rows: ArrayLike
) -> tuple[Floats, Floats]:
    """Centres (x, y) of the sites of the seed's lattice, in m."""
    u, v = width * np.asarray(columns, float), width * np.asarray(rows, float)
    c, s = np.cos(seed.angle), np.sin(seed.angle)
    return seed.centre[0] + c * u - s * v, seed.centre[1] + s * u + c * v


def inside(
    reactor: Reactor | None, width: float, x: Floats, y: Floats, angle: Floats,
    tolerance: float = 1e-9,
) -> NDArray[np.bool_]:
    """Whether all four corners of each square are inside the reactor, within `tolerance` (m)."""
    c, s, half = np.cos(angle), np.sin(angle), 0.5 * width
    if reactor is None:
        return np.ones(np.broadcast(x, y, angle).shape, np.bool_)
    if reactor.shape == "circle":  # the farthest corner, seen in the square's own axes
        corner = np.hypot(np.abs(c * x + s * y) + half, np.abs(c * y - s * x) + half)
        return np.asarray(corner <= reactor.radius + tolerance)
    reach = half * (np.abs(c) + np.abs(s)) - tolerance
    fits_x = np.abs(x) + reach <= 0.5 * reactor.width
    return np.asarray(fits_x & (np.abs(y) + reach <= 0.5 * reactor.height))


def area(reactor: Reactor) -> float:
    """Area inside the wall (m^2)."""
    if reactor.shape == "circle":
        return math.pi * reactor.radius**2
    return reactor.width * reactor.height


def depth(width: float, dx: Floats, dy: Floats, angle_a: Floats, angle_b: Floats) -> Floats:
    """How deep two squares overlap, in m; negative when a gap separates them.

    Separating axes: the least overlap of the squares' shadows over the four edge normals.
    (`dx`, `dy`) is the vector between the centres.
    """
    turn = angle_b - angle_a
    shadows = 0.5 * width * (1.0 + np.abs(np.cos(turn)) + np.abs(np.sin(turn)))
    gap = np.zeros_like(shadows)
    for angle in (angle_a, angle_b):
        c, s = np.cos(angle), np.sin(angle)
        gap = np.maximum(gap, np.maximum(np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)))
    return np.asarray(shadows - gap)


def near(
    xa: Floats, ya: Floats, xb: Floats, yb: Floats, distance: float
) -> tuple[Integers, Integers]:
    """Pairs (i, j) of points a[i], b[j] no farther apart than `distance`, sorted by i, then j.

    Cells of side `distance`; the points b are sorted by cell, so that three neighbouring cells
    of a row are one slice.
    """
    empty = np.empty(0, np.int64)
    if not (len(xa) and len(xb)):
        return empty, empty
    left, low = min(xa.min(), xb.min()), min(ya.min(), yb.min())
    cells = [np.floor((v - o) / distance).astype(np.int64) + 1
             for v, o in ((xa, left), (ya, low), (xb, left), (yb, low))]
    column_a, row_a, column_b, row_b = cells
    columns = 2 + max(column_a.max(), column_b.max())
    key_b = row_b * columns + column_b
    order = np.argsort(key_b, kind="stable")
    key_b = key_b[order]
    found_a, found_b = [], []
    for row in (-1, 0, 1):
        middle = (row_a + row) * columns + column_a
        start = np.searchsorted(key_b, middle - 1, "left")
        count = np.searchsorted(key_b, middle + 1, "right") - start
        first = np.repeat(start - np.cumsum(count) + count, count)
        found_a.append(np.repeat(np.arange(len(xa)), count))
        found_b.append(order[first + np.arange(count.sum())])
    i, j = np.concatenate(found_a), np.concatenate(found_b)
    close = np.hypot(xa[i] - xb[j], ya[i] - yb[j]) <= distance
    i, j = i[close], j[close]
    order = np.lexsort((j, i))
    return i[order], j[order]
