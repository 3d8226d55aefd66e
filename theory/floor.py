"""Dry friction of a square tile that slides and turns on a floor.

Under uniform pressure every point of the tile feels a friction of mu p against its own
velocity.  Force and torque are those integrals over the square; here by quadrature, in the axes
of the tile.  Goyal, Ruina and Papadopoulos, "Planar sliding with dry friction", Wear 143, 1991.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

# Mean distance of a unit square's points from its centre: T_max/(F_max w) = 0.382598.
MEAN_DISTANCE = (math.sqrt(2.0) + math.asinh(1.0)) / 6.0


def max_force(mu: float, mass: float, gravity: float = 9.81) -> float:
    """Friction of a tile that slides without turning, mu m g (N)."""
    return mu * mass * gravity


def max_torque(mu: float, mass: float, width: float, gravity: float = 9.81) -> float:
    """Friction torque of a tile that turns on the spot, 0.382598 mu m g w (N m)."""
    return MEAN_DISTANCE * mu * mass * gravity * width


def engine_torque(c: float, mass: float, width: float, gravity: float = 9.81) -> float:
    """Friction torque c m g sqrt(2 I/m), I = m w^2/6, as Box2D's users set it (N m)."""
    return c * mass * gravity * math.sqrt(2.0 * (width * width / 6.0))


def _panels(centre: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss points and weights on [-1/2, 1/2], in panels that halve towards `centre`."""
    steps = 0.5 ** np.arange(14)
    ends = np.concatenate(([-0.5, 0.5, centre], centre - steps, centre + steps))
    ends = np.unique(np.clip(ends, -0.5, 0.5))
    points, weights = np.polynomial.legendre.leggauss(10)
    middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
    return (middle[:, None] + half[:, None] * points).ravel(), np.outer(half, weights).ravel()


def wrench(vx: float, vy: float, omega: float, width: float) -> tuple[float, float, float]:
    """Friction force and torque per mu m g of a square of side `width` under uniform pressure.

    Parameters
    ----------
    vx, vy, omega : float
        Velocity of the centre (m/s) in the axes of the square, and spin (rad/s).  Only their
        ratios matter; all zero is an error.
    width : float
        m.

    Returns
    -------
    fx, fy, torque : float
        Dimensionless, dimensionless, m; to 1e-9 and 1e-9 w.

    Raises
    ------
    ValueError
        At rest, where friction is not a function of the twist.
    """
    spin = omega * width
    size = math.hypot(vx, vy, spin)
    if size == 0.0:
        raise ValueError("a tile at rest has no friction law: vx, vy or omega must not be 0")
    vx, vy, spin = vx / size, vy / size, spin / size
    # Where the tile turns about a point near it the integrand has a kink there.
    turns = abs(spin) > 1e-6
    x, weight_x = _panels(-vy / spin if turns else 1e6)
    y, weight_y = _panels(vx / spin if turns else 1e6)
    ux, uy = (vx - spin * y)[None, :], (vy + spin * x)[:, None]
    weight = np.outer(weight_x, weight_y) / np.maximum(np.hypot(ux, uy), 1e-300)
    fx, fy = -float(np.sum(weight * ux)), -float(np.sum(weight * uy))
    torque = -float(np.sum(weight * (x[:, None] * uy - y[None, :] * ux)))
    return fx, fy, width * torque


def share(force: float, torque: float, angle: float) -> float:
    """On which multiple of the limit surface under uniform pressure a load lies; at rest up to 1.

    Parameters
    ----------
    force, torque : float
        Per mu m g and mu m g w, of any sign.
    angle : float
        Of the force, from an edge's normal (rad): 0 or pi/4.  These are the least and the greatest
        share of all directions.

    Notes
    -----
    The set of what the floor can bear is where every twist dissipates at least what the load
    would do on it, so that the share is the greatest ratio of the two.  Both directions are axes
    of symmetry of the square: the twist that decides moves along the force.
    """
    along, turning = abs(force), abs(torque)
    x, y = math.cos(angle), math.sin(angle)

    def ratio(part: float) -> float:
        v, spin = math.cos(part), math.sin(part) / MEAN_DISTANCE
        fx, fy, friction = wrench(v * x, v * y, spin, 1.0)
        return (along * v + turning * spin) / (v * (fx * x + fy * y) + spin * friction)

    return -float(minimize_scalar(ratio, bounds=(0.0, 0.5 * math.pi), method="bounded",
                                  options={"xatol": 1e-9}).fun)


def ellipsoid_wrench(vx: float, vy: float, omega: float,
                     width: float) -> tuple[float, float, float]:
    """The same on the ellipsoid with the axes of the exact law, at the same twist.

    Its dissipation is H = sqrt(vx^2 + vy^2 + (k w omega)^2), k = ``MEAN_DISTANCE``, and the
    wrench minus the gradient of H.  Howe and Cutkosky, Int. J. Robotics Research 15, 1996.
    """
    arm = MEAN_DISTANCE * width
    size = math.hypot(vx, vy, arm * omega)
    if size == 0.0:
        raise ValueError("a tile at rest has no friction law: vx, vy or omega must not be 0")
    return -vx / size, -vy / size, -arm * arm * omega / size
