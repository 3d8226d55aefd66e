"""Drives as engines: state, parameters and time in; forces and torques out.

Every engine, the paper's and a user's own, has the one signature `ENGINE`:

    engine(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque)

``t`` time in s; ``p`` the parameters (float64, 1-D); then, one entry a tile: position (m),
angle (rad), velocity (m/s), spin (rad/s), ``family`` (a_i = omega_i: +1, -1 or 0),
``forward`` (rad, from the tile's +x to its forward edge).  The engine *adds* to ``fx``, ``fy``
(N) and ``torque`` (N m); what it adds to held tiles has no effect.  It is called twice a step
(once, if the number of substeps is odd), with the places at the middle of either half and the
velocities at its beginning.  It is passed to the core as a
first-class function, so a new engine never recompiles the core.  One of the user's own that
raises, or leaves the bounds of an array by an index, ends the run with an error; one that prints,
uses random numbers or writes into anything but ``fx``, ``fy`` and ``torque`` is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types

from tbsa.kernels.geometry import cos_sin
from tbsa.kernels.jit import callback

_scalar = types.float64
_array = types.Array(types.float64, 1, "C")
_input = types.Array(types.float64, 1, "C", readonly=True)
ENGINE = types.void(_scalar, *[_array] * 12)
# What a user's drive wrote elsewhere would be in no checkpoint.
GUARDED = types.void(_scalar, *[_input] * 9, *[_array] * 3)


@cache
def engine(function: Callable[..., None]) -> Any:
    """Compile `function` (see the module's text) for use as a drive; once a process."""
    return callback(ENGINE, function, GUARDED)


def no_drive(t: float, p: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
             vx: np.ndarray, vy: np.ndarray, omega: np.ndarray, family: np.ndarray,
             forward: np.ndarray, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """No drive."""
    return  # Numba looks for a statement, where it notes lines for debuggers


def unicycle(t: float, p: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
             vx: np.ndarray, vy: np.ndarray, omega: np.ndarray, family: np.ndarray,
             forward: np.ndarray, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """F = u a_i F_mag along the forward edge, T = u omega_i T_mag, u = sin(2 pi f t).

    p = (F_mag, T_mag, f).  Paper, section "Tile drive".
    """
    u = math.sin(2.0 * math.pi * p[2] * t)
    force, turn = u * p[0], u * p[1]
    for i in range(x.size):
        cos, sin = cos_sin(angle[i] + forward[i])
        fx[i] += family[i] * force * cos
        fy[i] += family[i] * force * sin
        torque[i] += family[i] * turn


def shaking(t: float, p: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
            vx: np.ndarray, vy: np.ndarray, omega: np.ndarray, family: np.ndarray,
            forward: np.ndarray, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """F = F_mag [sin(2 pi f t), cos(2 pi f t)] on every tile; p = (F_mag, T_mag = 0, f).

    Paper, equation of the shaking-based motion model.
    """
    phase = 2.0 * math.pi * p[2] * t
    gx, gy = p[0] * math.sin(phase), p[0] * math.cos(phase)
    for i in range(x.size):
        fx[i] += gx
        fy[i] += gy


def constant(t: float, p: np.ndarray, x: np.ndarray, y: np.ndarray, angle: np.ndarray,
             vx: np.ndarray, vy: np.ndarray, omega: np.ndarray, family: np.ndarray,
             forward: np.ndarray, fx: np.ndarray, fy: np.ndarray, torque: np.ndarray) -> None:
    """The same load on every tile; p = (F_x, F_y, T)."""
    for i in range(x.size):
        fx[i] += p[0]
        fy[i] += p[1]
        torque[i] += p[2]
