"""A driven tile on a floor with one friction law for sliding and turning, beside a unicycle.

The law is the ellipsoid of Howe and Cutkosky (Int. J. Robotics Research 15, 1996) with the axes
of a square under uniform pressure.  The paper's kinematic model (its equation "mmodel") is

    dx/dt = u a cos phi,   dy/dt = u b sin phi,   dphi/dt = u omega,   u = sin(2 pi f t).

A unicycle has a = b: with others the motion would depend on where the x axis points.  The model
gets the heading of a driven tile, and not its path.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import Radau, solve_ivp

from theory import command
from theory.floor import MEAN_DISTANCE
from theory.motion import demand, increasing

Reals = NDArray[np.float64]

# Left to a stop, and gone after a start, where the law has no derivative (s).
REST = 1e-6


class Unicycle(NamedTuple):
    """A fit of the kinematic model with a = b, and what it leaves unexplained.

    The shares are 0 of a unicycle, and 1 if standing still would do as well.
    """

    a: float  # m/s
    omega: float  # rad/s
    path: float  # of the mean square distance from the start
    heading: float  # of the mean square turn since the start


def coupled_tile(times: ArrayLike, *, mass: float, width: float, force: float, torque: float,
                 frequency: float, mu: float, gravity: float = 9.81, linear_damping: float = 0.0,
                 angular_damping: float = 0.0, forward: float = 0.5 * math.pi,
                 family: int = 1) -> Reals:
    """A tile from rest under the unicycle drive on a floor with coupled friction.

    m dv/dt = u a F_mag e - R v/s - c m v and I domega/dt = u a T_mag - R k^2 omega/s - c' I omega
    with R = mu m g, k = 0.382598 w, s = sqrt(|v|^2 + k^2 omega^2); at rest while
    (F/R)^2 + (T/(k R))^2 <= 1.  Without friction, R = 0, it never rests.  F_mag and T_mag may have
    either sign; at frequency 0 nothing is driven.

    Returns
    -------
    ndarray, shape (n, 6)
        x, y, angle, vx, vy, omega at `times` (s, increasing from 0), to about 1e-9.

    Raises
    ------
    ValueError
        Times that do not increase from 0; a mass or width that is not positive, a frequency,
        friction, gravity or damping below 0, or what is not finite.
    RuntimeError
        The integrator fails.
    """
    instants = increasing(times)
    demand({"mass": mass, "width": width},
           at_least_0={"frequency": frequency, "mu": mu, "gravity": gravity,
                       "linear_damping": linear_damping, "angular_damping": angular_damping},
           finite={"force": force, "torque": torque, "forward": forward, "family": family})
    inertia, arm, grip = mass * width * width / 6.0, MEAN_DISTANCE * width, mu * mass * gravity
    rate = 2.0 * math.pi * frequency
    driven = abs(family) * math.hypot(force, torque / arm) if frequency else 0.0
    size = 0.0 if driven == 0.0 else driven / grip if grip else math.inf  # in units of the floor's

    def load(t: float, angle: float) -> tuple[float, float, float]:
        u = family * math.sin(rate * t)
        heading = angle + forward
        return u * force * math.cos(heading), u * force * math.sin(heading), u * torque

    def rates(t: float, z: Reals) -> Reals:
        fx, fy, moment = load(t, z[2])
        s = math.sqrt(z[3] ** 2 + z[4] ** 2 + (arm * z[5]) ** 2) or 1e-300
        drag = grip / s
        return np.array([z[3], z[4], z[5],
                         (fx - drag * z[3]) / mass - linear_damping * z[3],
                         (fy - drag * z[4]) / mass - linear_damping * z[4],
                         (moment - drag * arm * arm * z[5]) / inertia - angular_damping * z[5]])

    def jacobian(t: float, z: Reals) -> Reals:
        s = math.sqrt(z[3] ** 2 + z[4] ** 2 + (arm * z[5]) ** 2) or 1e-300
        fx, fy, _ = load(t, z[2])
        weight = np.array([1.0, 1.0, arm * arm])
        unit = weight * z[3:] / s
        body = np.array([mass, mass, inertia])
        out = np.zeros((6, 6))
        out[:3, 3:] = np.eye(3)
        out[3, 2], out[4, 2] = -fy / mass, fx / mass
        out[3:, 3:] = -grip / s * (np.diag(weight) - np.outer(unit, unit)) / body[:, None]
        out[3:, 3:] -= np.diag([linear_damping, linear_damping, angular_damping])
        return out

    def to_go(t: float, z: Reals) -> float:
        """Time (s) to a stop, if the tile goes on slowing down as it does."""
        weight = np.array([1.0, 1.0, arm * arm])
        slowing = -float(z[3:] * weight @ rates(t, z)[3:])
        return float(z[3:] ** 2 @ weight) / slowing if slowing > 0.0 else math.inf

    result = np.zeros((instants.size, 6))
    if not instants.size:
        return result
    if math.isinf(size):  # smooth
        free: Any = solve_ivp(rates, (0.0, float(instants[-1]) + 1e-9), np.zeros(6), "DOP853",
                              rtol=1e-12, atol=1e-14, max_step=0.05, dense_output=True)
        return np.asarray(free.sol(instants).T)
    z, now, done, last = np.zeros(6), 0.0, 0, float(instants[-1])
    while done < instants.size:
        u = abs(math.sin(rate * now))
        if size <= 1.0:
            begin = math.inf
        elif u * size > 1.0 + 1e-12:
            begin = now
        else:  # the drive passes the floor's bound at the next asin(1/size)
            rise, turn = math.asin(1.0 / size), math.floor(rate * now / math.pi + 1e-12)
            phase = rate * now - turn * math.pi
            begin = ((turn if phase < rise + 1e-12 else turn + 1) * math.pi + rise) / rate
        while done < instants.size and instants[done] <= begin:
            result[done], done = z, done + 1
        if done == instants.size:
            break
        now = begin
        # The start: near its bound a load moves the tile along the normal of the limit surface,
        # d with |d| = 1, and d.M d ds/dt = |load| - R.
        half = now + 0.5 * REST
        fx, fy, moment = load(half, z[2])
        normal = np.array([fx, fy, moment / (arm * arm)])
        normal /= math.hypot(normal[0], normal[1], arm * normal[2])
        excess = grip * max(abs(math.sin(rate * half)) * size - 1.0, 1e-12)
        start = z.copy()
        start[3:] = normal * excess * REST / float(normal**2 @ [mass, mass, inertia])
        while done < instants.size and instants[done] <= now + REST:
            result[done] = z
            result[done, 3:] = start[3:] * (instants[done] - now) / REST
            done += 1
        if done == instants.size:
            break
        # Where it stops is a singular point, across which no step may go.
        going = Radau(rates, now + REST, start, last + 1e-9, rtol=1e-10,
                      atol=[1e-12] * 3 + [1e-14] * 3, jac=jacobian)
        while going.status == "running" and (left := to_go(going.t, going.y)) > REST:
            going.max_step = min(0.05, 0.7 * left)
            message = going.step()
            if going.status == "failed":
                raise RuntimeError(message)
            inside = slice(done, int(np.searchsorted(instants, going.t, side="right")))
            if inside.start < inside.stop:
                result[inside] = going.dense_output()(instants[inside]).T
                done = inside.stop
        z, now = going.y.copy(), min(going.t + left, last + 1e-9)
        z[3:] = 0.0
    return result


def kinematic(times: ArrayLike, a: float, b: float, omega: float, frequency: float,
              heading: float = 0.5 * math.pi) -> Reals:
    """x, y, phi of the kinematic model from the origin at `times` (s); shape (n, 3).

    In closed form: with S the integral of u and phi = heading + omega S, x is a times the integral
    of cos phi over S, and y b times that of sin phi.

    Raises
    ------
    ValueError
        Times that do not increase from 0.
    """
    return _way(_swing(increasing(times), frequency), a, b, omega, heading)


def fit(times: ArrayLike, x: ArrayLike, y: ArrayLike, angle: ArrayLike, frequency: float,
        forward: float = 0.5 * math.pi) -> Unicycle:
    """Least squares of the kinematic model, a = b, to a path that starts at the origin.

    omega from the heading, then a from the path; both are linear.  The path may start at any time,
    the first of `times`.

    Raises
    ------
    ValueError
        Times that do not increase from 0.
    """
    instants = increasing(times)
    path = np.stack([np.asarray(q, dtype=np.float64) for q in (x, y)], axis=1)
    turned = np.asarray(angle, dtype=np.float64)
    start, turned = float(turned[0]), turned - turned[0]
    swing = _swing(instants, frequency)
    swing = swing - swing[0]
    omega, heading = _scale(swing, turned)
    unit = _way(swing, 1.0, 1.0, omega, forward + start)[:, :2]
    a, left = _scale(unit.ravel(), path.ravel())
    return Unicycle(a, omega, left, heading)


def along(angle: ArrayLike, vx: ArrayLike, vy: ArrayLike, forward: float = 0.5 * math.pi) -> float:
    """The share of the mean square velocity that is along the heading, either way.

    1 of a unicycle, 1/2 where the two have nothing to do with each other.
    """
    phi = np.asarray(angle, dtype=np.float64) + forward
    x, y = (np.asarray(v, dtype=np.float64) for v in (vx, vy))
    whole = float(x @ x + y @ y)
    return float(np.sum((x * np.cos(phi) + y * np.sin(phi)) ** 2)) / whole if whole else math.nan


def _swing(t: Reals, frequency: float) -> Reals:
    """The integral of u from 0 to `t` (s), which is 0 at frequency 0."""
    rate = 2.0 * math.pi * frequency
    return (1.0 - np.cos(rate * t)) / rate if rate else np.zeros_like(t)


def _way(swing: Reals, a: float, b: float, omega: float, heading: float) -> Reals:
    """x, y, phi where u has the integral `swing` (s) since the origin."""
    half = 0.5 * omega * swing
    chord = swing * np.sinc(half / math.pi)  # sin(half)/half, 1 at 0
    return np.stack([a * chord * np.cos(heading + half), b * chord * np.sin(heading + half),
                     heading + 2.0 * half], axis=1)


def _scale(unit: Reals, found: Reals) -> tuple[float, float]:
    """The factor of `unit` that is nearest to `found`, and the share of its square that is left."""
    length, whole = float(unit @ unit), float(found @ found)
    factor = float(unit @ found) / length if length else 0.0
    left = found - factor * unit
    return factor, float(left @ left) / whole if whole else 0.0


def main(argv: Sequence[str] | None = None) -> None:
    """Print how far the tile is a unicycle, at 0.075 N, three torques, and the paper's values."""
    argparse.ArgumentParser(prog="python -m theory.unicycle",
                            description=main.__doc__).parse_args(argv)
    times = np.linspace(0.0, 20.0, 401)
    print("T_mag (N m)  a (m/s)  omega (rad/s)  unexplained: heading    path  velocity along it")
    for torque in (3e-5, 1e-4, 3e-4):
        z = coupled_tile(times, mass=0.016, width=0.03, force=0.075, torque=torque, frequency=0.1,
                         mu=0.25, linear_damping=0.8, angular_damping=0.5)
        found = fit(times, z[:, 0], z[:, 1], z[:, 2], 0.1)
        print(f"{torque:11g}  {found.a:7.3f}  {found.omega:13.3f}  {found.heading:20.1%}  "
              f"{found.path:6.1%}  {along(z[:, 2], z[:, 3], z[:, 4]):17.1%}")


if __name__ == "__main__":
    command(main)
