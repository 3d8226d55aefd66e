"""Magnet forces: F = p alpha / (r + beta)^2, faded out smoothly before the cut-off.

The switch S(u) = 1 - 10 u^3 + 15 u^4 - 6 u^5 runs from 1 to 0 over the last part of the cut-off;
force and first two derivatives are continuous there, so nothing jumps and energy is kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tbsa.kernels.jit import inline, kernel
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
    """Scratch: where the tiles' magnets are, and the pairs of magnets within the cut-off."""

    mx: np.ndarray  # float64[4 n], m, seen from the tiles' centres
    my: np.ndarray
    pair: np.ndarray  # int64, magnets p, q of a pair as p << 32 | q
    rx: np.ndarray  # m, from p to q
    ry: np.ndarray
    f: np.ndarray  # N/m, force over distance, > 0 attracts


def empty_magnet_pairs(n: int, capacity: int) -> MagnetPairs:
    """Space for `n` tiles and 16 magnet pairs for each of `capacity` tile pairs."""
    return MagnetPairs(np.zeros(4 * n), np.zeros(4 * n),
                       np.zeros(16 * capacity, np.int64),
                       *(np.zeros(16 * capacity) for _ in range(3)))


@inline
def find_magnet_pairs(law: MagnetLaw, pairs: Pairs, n: int, x: np.ndarray, y: np.ndarray,
                      c: np.ndarray, s: np.ndarray, near: MagnetPairs) -> int:
    """List the magnet pairs within the cut-off, in the order of the tile pairs."""
    start, other = pairs.start, pairs.other
    mx, my, listed, list_x, list_y, _ = near
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
            dx, dy = x[b] - x[a], y[b] - y[a]
            if dx * dx + dy * dy >= far * far:
                continue
            for i in range(4):
                ux, uy = dx - mx[4 * a + i], dy - my[4 * a + i]
                for j in range(4):
                    # Every pair is written, and kept by moving on: a branch that goes either
                    # way at random costs more than the write.
                    rx, ry = ux + mx[4 * b + j], uy + my[4 * b + j]
                    listed[m] = (4 * a + i) << 32 | (4 * b + j)
                    list_x[m], list_y[m] = rx, ry
                    m += rx * rx + ry * ry < cut2
    return m


@inline
def add_magnet_forces(law: MagnetLaw, near: MagnetPairs, m: int, glues: np.ndarray,
                      fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """Add the forces of `m` listed pairs, applied at the magnets, to the tiles' (N, N m).

    `glues` are the labels of magnet 4 i + edge (N, E, S, W).
    """
    mx, my, listed, rx, ry, f = near
    for i in range(m):  # apart from the next loop, so that it vectorises
        r = math.sqrt(rx[i] * rx[i] + ry[i] * ry[i])
        # Two magnets in one place have no direction; contact pushes such tiles apart.
        f[i] = magnet_force(r, law) / max(r, 1e-300)
    for i in range(m):
        p, q = listed[i] >> 32, listed[i] & 0xFFFFFFFF
        a, b = p >> 2, q >> 2
        g = f[i] * polarity(glues[p], glues[q], law.mismatch)
        gx, gy = g * rx[i], g * ry[i]
        fx[a] += gx
        fy[a] += gy
        torque[a] += mx[p] * gy - my[p] * gx
        fx[b] -= gx
        fy[b] -= gy
        torque[b] -= mx[q] * gy - my[q] * gx


@kernel
def magnet_forces(law: MagnetLaw, pairs: Pairs, glues: np.ndarray, x: np.ndarray, y: np.ndarray,
                  angle: np.ndarray, near: MagnetPairs, fx: np.ndarray, fy: np.ndarray,
                  torque: np.ndarray) -> None:
    """Add the forces of all magnets on the tiles at x, y, angle; `pairs` must be up to date."""
    m = find_magnet_pairs(law, pairs, x.size, x, y, np.cos(angle), np.sin(angle), near)
    add_magnet_forces(law, near, m, glues, fx, fy, torque)
