"""Exact forces between two uniformly magnetised permanent magnets.

A uniform magnetisation along z is two sheets of magnetic charge, +J on the upper and -J on the
lower face (J: polarisation, T), and two charges q_a, q_b (Wb) a distance r apart push each other
by q_a q_b/(4 pi mu_0 r^2).  Ideal magnets: no demagnetisation, no saturation, no play.
"""

from __future__ import annotations

from itertools import product
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.constants import mu_0
from scipy.special import ellipe, ellipkm1

Floats = NDArray[np.float64]

BLOCK = 1024  # gaps at a time, whose integrands stay in the cache
FAR = 2.5  # distance of cuboids in their diagonals from which on they are multipoles


def discs(gap: ArrayLike) -> Floats:
    """S(g) of two coaxial equal discs of charge, their gap g in radii: F = pi R^2 J^2 S/mu_0.

    S = integral of J_1(q)^2 exp(-g q)/q over q from 0 to infinity; 1/2 at g = 0, 1/(4 g^2) far
    away.  Near in complete elliptic integrals (Vokoun et al., J. Magn. Magn. Mater. 321 (2009)
    3758); far by the midpoint rule on a form without cancellation, whose error falls
    exponentially with the number of points.  To 1e-14 of S.
    """
    g = np.ravel(np.asarray(gap, float))
    s, near = np.empty_like(g), g < 1
    close = np.maximum(g[near], 1e-100)
    p = np.hypot(2.0, close)
    s[near] = 0.5 - close * p / (2 * np.pi) * (ellipkm1((close / p) ** 2) - ellipe((2 / p) ** 2))
    t = (np.arange(24) + 0.5) * (np.pi / 48)
    across, share = 4 * np.sin(t) ** 2, np.sin(2 * t) ** 2
    distant = np.flatnonzero(~near)
    for begin in range(0, distant.size, BLOCK):
        which = distant[begin:begin + BLOCK]
        far = g[which, None]
        reach = np.sqrt(far * far + across)  # np.hypot takes several times as long
        s[which] = np.mean(share / (reach * (reach + far)), axis=-1)
    return s.reshape(np.shape(gap))


def coaxial_cylinders(distance: ArrayLike, radius: float, height: float | tuple[float, float],
                      polarisation: float = 1.3) -> Floats:
    """Attraction of two coaxial cylinders of equal radius, magnetised alike along their axis (N).

    Parameters
    ----------
    distance
        Of the centres (m), any shape; at least the mean of the heights.
    radius, height
        m; `height` may be a pair.
    polarisation
        J of both (T), the remanence of an ideal magnet.

    Returns
    -------
    ndarray
        Of the shape of `distance`; magnets turned against each other repel by as much.

    Raises
    ------
    ValueError
        Where the cylinders would overlap, a radius that is not positive, a negative height, or
        an infinite one.
    """
    heights = np.asarray(height, float)
    if not 0.0 < radius < np.inf or not np.all((heights >= 0.0) & (heights < np.inf)):
        raise ValueError(f"radius and height must be positive and finite, not {radius} and "
                         f"{height} m")
    h = np.broadcast_to(np.asarray(height, float), 2)
    gap = np.asarray(distance, float) - h.mean()
    if np.any(gap < -1e-12 * h.mean()):
        raise ValueError(f"distance must be at least the mean height, {h.mean():g} m")
    gap = np.maximum(gap, 0.0)
    ends = np.array([0.0, h[0], h[1], h.sum()])  # from pole to pole, beyond the gap
    s = discs((gap[..., None] + ends) / radius) @ np.array([1.0, -1.0, -1.0, 1.0])
    return np.asarray(np.pi * radius**2 * polarisation**2 / mu_0 * s)


def parallel_cuboids(distance: ArrayLike, size_a: ArrayLike, size_b: ArrayLike,
                     polarisation: float = 1.3) -> Floats:
    """Force of cuboid a on cuboid b, edges parallel, both magnetised along +z (N).

    Parameters
    ----------
    distance
        From the centre of a to that of b (m), shape (..., 3).
    size_a, size_b
        Edges along x, y and z (m), shape (3,).
    polarisation
        J of both (T).

    Returns
    -------
    ndarray
        Fx, Fy, Fz of the shape of `distance`; attracted along z is negative.  The sum of 27
        to 64 terms cancels: relative error about 1e-16 (distance/size)^6.

    Raises
    ------
    ValueError
        Where the cuboids would overlap, an edge is negative, or what is not finite.

    Notes
    -----
    Akoun and Yonnet, IEEE Trans. Magn. 20 (1984) 1962.
    """
    d = np.asarray(distance, float)
    half_a, half_b = 0.5 * np.asarray(size_a, float), 0.5 * np.asarray(size_b, float)
    if not (np.all(half_a >= 0.0) and np.all(half_b >= 0.0)):
        raise ValueError("edges must be at least 0")
    if not (np.isfinite(d).all() and np.isfinite(half_a).all() and np.isfinite(half_b).all()):
        raise ValueError("distance and edges must be finite")
    if np.any(np.all(np.abs(d) < (1.0 - 1e-12) * (half_a + half_b), axis=-1)):
        raise ValueError("cuboids must not overlap: along one axis their centres must be at least "
                         "the mean of their edges apart")
    ways, weight = zip(*(_corners(a, b) for a, b in zip(half_a, half_b, strict=True)), strict=True)
    corner = d[..., None, :] + np.array(list(product(*ways)))
    u, v, w = np.moveaxis(corner, -1, 0)
    r = np.sqrt(u * u + v * v + w * w)
    log_u, log_v = _log(r, u, v * v + w * w), _log(r, v, u * u + w * w)
    # atan(u v/(r w)).  It jumps where two faces touch: the bodies then are on either side.
    touch = np.abs(w) <= 1e-12 * (half_a[2] + half_b[2])
    side = np.where(touch, d[..., 2, None], w) < 0
    angle = np.arctan2(np.where(side, -u, u) * v, r * np.where(touch, 0.0, np.abs(w)))
    parts = np.stack((
        0.5 * (v * v - w * w) * log_u + u * v * log_v + v * w * angle + 0.5 * r * u,
        0.5 * (u * u - w * w) * log_v + u * v * log_u + u * w * angle + 0.5 * r * v,
        -u * w * log_u - v * w * log_v + u * v * angle - r * w))
    total = np.moveaxis(parts @ np.prod(list(product(*weight)), axis=1), 0, -1)
    return np.asarray(polarisation**2 / (4 * np.pi * mu_0) * total)


def coaxial_cuboids(distance: ArrayLike, side: float, height: float,
                    polarisation: float = 1.3) -> Floats:
    """Attraction of two equal cuboids of square section, magnetised alike along their axis (N).

    :func:`parallel_cuboids` of bodies on one axis, in a seventh of the time: of its 27 places
    of corners those that are mirror images are one, which leaves 9.

    Parameters
    ----------
    distance
        Of the centres (m), any shape; at least the height.
    side, height
        m.
    polarisation
        J of both (T).

    Returns
    -------
    ndarray
        Of the shape of `distance`.  To some 1e-10 of the force for heights of a tenth of the side
        to ten sides, and to some 1e-6 for a thousandth and a hundred: near magnets are sums that
        cancel.  Far ones, whose sums would have no digit left, are multipoles.

    Raises
    ------
    ValueError
        Where the cuboids would overlap, a side that is not positive, a negative height, or what
        is not finite.
    """
    if not 0.0 < side < np.inf or not 0.0 <= height < np.inf:
        raise ValueError(f"side and height must be positive and finite, not {side} and {height} m")
    d = np.asarray(distance, float)[..., None]
    if not np.isfinite(d).all():
        raise ValueError("distance must be finite")
    if np.any(d < (1.0 - 1e-12) * height):
        raise ValueError(f"distance must be at least the height, {height:g} m")
    far = d[..., 0] > FAR * np.hypot(np.sqrt(2.0) * side, height)
    if np.any(far):
        force = np.empty(far.shape)
        force[far] = _far_cuboids(d[far, 0], side, height, polarisation)
        force[~far] = coaxial_cuboids(d[~far, 0], side, height, polarisation)
        return force
    # The sums over the places (0, 0), (0, side) and (side, side) across the axis.
    w = np.maximum(d + height * np.array([0.0, 1.0, -1.0]), 0.0)
    near, far = np.sqrt(side**2 + w * w), np.sqrt(2 * side**2 + w * w)
    apart = np.where(w > 0.0, w, 1.0)  # what is multiplied by it is 0 where it is
    one = side * w * np.log((near + side) / apart) - near * w
    two = (2 * side * w * np.log((far + side) / near) - far * w
           + side**2 * np.arctan2(side**2, far * w))
    total = (2.0 * one - two + w * w) @ np.array([2.0, -1.0, -1.0])
    return np.asarray(polarisation**2 / (np.pi * mu_0) * total)


def _far_cuboids(distance: Floats, side: float, height: float, polarisation: float) -> Floats:
    """:func:`coaxial_cuboids` by `MULTIPOLES`, to rounding."""
    size = 2.0 * side**2 + height**2
    order, k = np.indices(MULTIPOLES.shape)
    share = MULTIPOLES * (side**2 / size) ** k * (height**2 / size) ** np.maximum(order - k, 0)
    total = np.polynomial.polynomial.polyval(size / distance**2, np.sum(share, axis=1))
    return np.asarray(polarisation**2 * (side / distance) ** 4 * height**2 / (4 * np.pi * mu_0)
                      * total)


def _multipoles(number: int) -> Floats:
    """What side^2k height^(l - 2k), l = 0, 2, ..., adds to the force of coaxial cuboids, over d^l.

    Two places in one edge and in another are apart by s, and the force between them is that of two
    dipoles on one axis: (l + 1)(l + 2)(l + 3) s^l P_l/d^(l + 4), P_l of the angle of s to the axis.
    Over all places s^2n of an edge of 1 has the mean 2/((2 n + 1)(2 n + 2)).
    """
    mean = [1.0 / ((2 * n + 1) * (n + 1)) for n in range(number)]
    made = np.zeros((number, number))
    for half in range(number):
        order = 2 * half
        for k in range(half + 1):
            across = sum(comb(k, i) * mean[i] * mean[k - i] for i in range(k + 1))
            ways = factorial(order) / (4**k * factorial(k) ** 2 * factorial(order - 2 * k))
            made[half, k] = ((order + 1) * (order + 2) * (order + 3) * (-1) ** k * ways * across
                             * mean[half - k])
    return made


MULTIPOLES = _multipoles(20)


def _corners(half_a: float, half_b: float) -> tuple[Floats, Floats]:
    """From the ends of an edge to those of another of one centre, and with which sign each counts;
    what is in one place is one, three of four where the edges are equal."""
    ways, of = np.unique([half_b - half_a, half_a - half_b, half_a + half_b, -half_a - half_b],
                         return_inverse=True)
    return ways, np.bincount(of, [1.0, 1.0, -1.0, -1.0]).astype(np.float64)


def _log(r: Any, u: Any, rest: Any) -> Any:
    """log(r - u) with r^2 = u^2 + rest, without cancellation; 0 where its factors vanish too."""
    value = np.where(u > 0, rest / np.where(u > 0, r + u, 1.0), r - u)
    return np.log(np.where(value > 0, value, 1.0))
