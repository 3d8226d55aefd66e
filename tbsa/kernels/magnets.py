"""Magnet forces: F = p alpha / (r + beta)^2, faded out smoothly before the cut-off.

The switch S(u) = 1 - 10 u^3 + 15 u^4 - 6 u^5 runs from 1 to 0 over the last part of the cut-off;
force and first two derivatives are continuous there, so nothing jumps and energy is kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tbsa.kernels.jit import U, columns, inline, kernel
from tbsa.kernels.neighbours import Pairs


class MagnetLaw(NamedTuple):
    """Numbers of the force law; `cutoff` 0 where the scene has no magnets."""

    alpha: float  # N m^2
    beta: float  # m
    offset: float  # m from the tile's centre to a magnet
    cutoff: float  # m
    fade: float  # m, where the switch begins
    mismatch: float  # p of two glues that do not attract


@inline
def magnet_force(r: float, law: MagnetLaw) -> float:
    """Size of the force between two magnets a distance r apart (N), before its sign p."""
    u = min(max((r - law.fade) / (law.cutoff - law.fade), 0.0), 1.0)
    switch = 1.0 - u * u * u * (10.0 + u * (6.0 * u - 15.0))
    return switch * law.alpha / ((r + law.beta) * (r + law.beta))


@inline
def polarity(glue_a: int, glue_b: int, mismatch: float) -> float:
    """p: +1 where g meets -g, 0 without a magnet, else `mismatch`."""
    p = 1.0 if glue_a == -glue_b else mismatch
    return p if glue_a * glue_b != 0 else 0.0


class MagnetPairs(NamedTuple):
    """Scratch: where the tiles' magnets are, magnet pairs in reach, and forces of tile pairs."""

    mx: np.ndarray  # float64[4 n], m, seen from the tiles' centres
    my: np.ndarray
    listed: np.ndarray  # int64, a magnet pair p, q as p << 32 | q
    f: np.ndarray  # N/m, force over distance, > 0 attracts
    rx: np.ndarray  # m, from p to q
    ry: np.ndarray
    last: np.ndarray  # int64, where the magnet pairs of every tile pair end
    fx: np.ndarray  # N, force on a of every tile pair
    fy: np.ndarray
    ta: np.ndarray  # N m, torques of every tile pair on a and b
    tb: np.ndarray


def empty_magnet_pairs(n: int, capacity: int) -> MagnetPairs:
    """Space for `n` tiles and `capacity` tile pairs."""
    return MagnetPairs(np.zeros(4 * n), np.zeros(4 * n),
                       *columns(16 * capacity + 1, [int, float, float, float]),
                       *columns(capacity, [int] + [float] * 4))


@inline
def find_magnet_pairs(law: MagnetLaw, pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray,
                      c: np.ndarray, s: np.ndarray, still: np.ndarray,
                      near: MagnetPairs) -> int:
    """List the magnet pairs within the cut-off, in the order of the tile pairs.

    Tile pairs of which both are `still` (where they were when their force was last computed)
    are left out: their force is known, to the bit.
    """
    start, other = pairs.start, pairs.other
    mx, my, listed, last = near.mx, near.my, near.listed, near.last
    d = law.offset
    for i in range(n):
        cd, sd = c[i] * d, s[i] * d
        mx[4 * i], my[4 * i] = -sd, cd
        mx[4 * i + 1], my[4 * i + 1] = cd, sd
        mx[4 * i + 2], my[4 * i + 2] = sd, -cd
        mx[4 * i + 3], my[4 * i + 3] = -cd, -sd
    cut2 = law.cutoff * law.cutoff
    far = law.cutoff + 2.0 * d
    m = 0
    for a in range(n):
        for k in range(start[a], start[a + 1]):
            b = other[k]
            dx, dy = x[U(b)] - x[a], y[U(b)] - y[a]
            if not (still[a] & still[U(b)]) and dx * dx + dy * dy < far * far:
                for i in range(4):
                    ux, uy = dx - mx[4 * a + i], dy - my[4 * a + i]
                    for j in range(4):
                        # Every pair is written, and kept by moving on: a branch that goes
                        # either way at random costs more than the write.
                        rx, ry = ux + mx[U(4 * b + j)], uy + my[U(4 * b + j)]
                        listed[U(m)] = (4 * a + i) << 32 | (4 * b + j)
                        m += rx * rx + ry * ry < cut2
            last[k] = m
    return m


@inline
def add_magnet_forces(law: MagnetLaw, pairs: Pairs, n: int, near: MagnetPairs, m: int,
                      glues: np.ndarray, x: np.ndarray, y: np.ndarray, still: np.ndarray,
                      fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """Add the forces of all pairs, applied at the magnets, to the tiles' (N, N m).

    `glues` are the labels of magnet 4 i + edge (N, E, S, W); `m` magnet pairs are listed.
    """
    mx, my, listed, f, rx, ry, last, pfx, pfy, pta, ptb = near
    for i in range(m):
        p, q = U(listed[i] >> 32), U(listed[i] & 0xFFFFFFFF)
        of_p, of_q = U(listed[i] >> 34), U((listed[i] & 0xFFFFFFFF) >> 2)  # their tiles
        rx[i] = x[of_q] - x[of_p] + mx[q] - mx[p]
        ry[i] = y[of_q] - y[of_p] + my[q] - my[p]
    for i in range(m):  # a loop of its own, so that it vectorises
        r = math.sqrt(rx[i] * rx[i] + ry[i] * ry[i])
        # Two magnets in one place have no direction; contact pushes such tiles apart.
        f[i] = magnet_force(r, law) / max(r, 1e-300)
    start, other = pairs.start, pairs.other
    i = 0
    for a in range(n):
        for k in range(start[a], start[a + 1]):
            t = U(other[k])
            if not (still[a] & still[t]):
                gx, gy, ga, gb = 0.0, 0.0, 0.0, 0.0
                while i < last[k]:
                    p, q = U(listed[i] >> 32), U(listed[i] & 0xFFFFFFFF)
                    g = f[i] * polarity(glues[p], glues[q], law.mismatch)
                    hx, hy = g * rx[i], g * ry[i]
                    gx += hx
                    gy += hy
                    ga += mx[p] * hy - my[p] * hx
                    gb -= mx[q] * hy - my[q] * hx
                    i += 1
                pfx[k], pfy[k], pta[k], ptb[k] = gx, gy, ga, gb
            fx[a] += pfx[k]
            fy[a] += pfy[k]
            torque[a] += pta[k]
            fx[t] -= pfx[k]
            fy[t] -= pfy[k]
            torque[t] += ptb[k]


@kernel
def magnet_forces(law: MagnetLaw, pairs: Pairs, glues: np.ndarray, x: np.ndarray, y: np.ndarray,
                  angle: np.ndarray, near: MagnetPairs, fx: np.ndarray, fy: np.ndarray,
                  torque: np.ndarray) -> None:
    """Add the forces of all magnets on the tiles at x, y, angle; `pairs` must be up to date."""
    n = x.size
    moved = np.zeros(n, np.bool_)
    m = find_magnet_pairs(law, pairs, n, x, y, np.cos(angle), np.sin(angle), moved, near)
    add_magnet_forces(law, pairs, n, near, m, glues, x, y, moved, fx, fy, torque)
