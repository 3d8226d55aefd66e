"""Magnet forces: F = p alpha / (r + beta)^2, faded out smoothly before the cut-off.

The switch S(u) = 1 - 10 u^3 + 15 u^4 - 6 u^5 runs from 1 to 0 over the last part of the cut-off;
force and first two derivatives are continuous there, so nothing jumps and energy is kept.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tbsa.kernels.jit import inline
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
    if r >= law.cutoff:
        return 0.0
    force = law.alpha / ((r + law.beta) * (r + law.beta))
    if r > law.fade:
        u = (r - law.fade) / (law.cutoff - law.fade)
        force *= 1.0 - u * u * u * (10.0 + u * (6.0 * u - 15.0))
    return force


@inline
def polarity(glue_a: int, glue_b: int, mismatch: float) -> float:
    """p: +1 where g meets -g, 0 without a magnet, else `mismatch`."""
    if glue_a == 0 or glue_b == 0:
        return 0.0
    return 1.0 if glue_a == -glue_b else mismatch


@inline
def add_magnet_forces(law: MagnetLaw, pairs: Pairs, n: int, glues: np.ndarray, x: np.ndarray,
                      y: np.ndarray, c: np.ndarray, s: np.ndarray, mx: np.ndarray,
                      my: np.ndarray, fx: np.ndarray, fy: np.ndarray,
                      torque: np.ndarray) -> None:
    """Add the forces on all tiles, applied at the magnets, to `fx`, `fy` (N), `torque` (N m).

    `glues` are the labels of magnet 4 i + edge (N, E, S, W); `mx`, `my` are scratch of that
    length for the magnets' places seen from the tiles' centres.
    """
    start, other = pairs.start, pairs.other
    d = law.offset
    for i in range(n):
        cd, sd = c[i] * d, s[i] * d
        mx[4 * i], my[4 * i] = -sd, cd
        mx[4 * i + 1], my[4 * i + 1] = cd, sd
        mx[4 * i + 2], my[4 * i + 2] = sd, -cd
        mx[4 * i + 3], my[4 * i + 3] = -cd, -sd
    cut2 = law.cutoff * law.cutoff
    far = law.cutoff + 2.0 * d
    near = law.cutoff + d  # a magnet of a further from centre b than this meets none of b's
    for a in range(n):
        for k in range(start[a], start[a + 1]):
            b = other[k]
            dx, dy = x[b] - x[a], y[b] - y[a]
            if dx * dx + dy * dy >= far * far:
                continue
            for p in range(4 * a, 4 * a + 4):
                ux, uy = dx - mx[p], dy - my[p]
                if ux * ux + uy * uy >= near * near:
                    continue
                for q in range(4 * b, 4 * b + 4):
                    rx, ry = ux + mx[q], uy + my[q]
                    r2 = rx * rx + ry * ry
                    if r2 >= cut2:
                        continue
                    sign = polarity(glues[p], glues[q], law.mismatch)
                    if sign == 0.0:
                        continue
                    r = math.sqrt(r2)
                    if r == 0.0:
                        continue  # no direction; overlap of two magnets is resolved by contact
                    f = sign * magnet_force(r, law) / r
                    gx, gy = f * rx, f * ry
                    fx[a] += gx
                    fy[a] += gy
                    torque[a] += mx[p] * gy - my[p] * gx
                    fx[b] -= gx
                    fy[b] -= gy
                    torque[b] -= mx[q] * gy - my[q] * gx
