"""Rigid rotations with an exact answer: along a round wall, of a bonded row, of a rocking tile."""

from __future__ import annotations

import math
from typing import NamedTuple

from scipy.integrate import quad

from theory.impact import inverse_inertia, routh
from theory.motion import demand


class WallSlide(NamedTuple):
    """A tile that slides along a circular wall with two corners on it, either way round."""

    distance: float  # m, of its centre from that of the circle
    rate: float  # k of dOmega/dt = -k Omega^2, 1
    leading: float  # N s^2: normal force at the corner ahead per Omega^2
    trailing: float  # N s^2: the same at the corner behind

    def turned(self, spin: float, time: float) -> float:
        """Angle about the circle's centre after `time` (s) from Omega = `spin` (rad/s)."""
        x = self.rate * abs(spin) * time
        return math.copysign(math.log1p(x) / self.rate, spin) if self.rate > 0.0 else spin * time

    def spin(self, spin: float, time: float) -> float:
        """Omega after `time` (s)."""
        return spin / (1.0 + self.rate * abs(spin) * time)


def seat(radius: float, width: float) -> float:
    """Distance (m) from the circle's centre of a square with two corners on the circle.

    Raises
    ------
    ValueError
        The circle is narrower than the square.
    """
    least = math.sqrt(0.5) * width
    if not radius >= (1.0 - 1e-12) * least:
        raise ValueError(f"a radius of {radius} m must be at least half the diagonal of the tile, "
                         f"{least:g} m")
    return max(math.sqrt(radius * radius - 0.25 * width * width) - 0.5 * width, 0.0)


def wall_slide(radius: float, width: float, mass: float, mu: float) -> WallSlide:
    """A square that turns about the circle's centre, held on the wall by its own inertia.

    With d the distance of the centres, a the angle between the tile's axis and a corner, S and D
    the sum and difference (ahead - behind) of the normal forces, I' = I + m d^2 and friction mu
    times each, the balances of radial force, of tangential force and of moment are

        m d Omega^2 = S cos a - mu D sin a,
        m d dOmega/dt = -D sin a - mu S cos a,
        I' dOmega/dt = -mu R S,

    so that Omega' = -k Omega^2: Omega = Omega0/(1 + k Omega0 t), angle = ln(1 + k Omega0 t)/k.

    Raises
    ------
    ValueError
        The circle is narrower than the square; or a corner would have to pull: the motion is
        another one.  A width or mass that is not positive, or a friction below 0.
    """
    demand({"width": width, "mass": mass}, at_least_0={"mu": mu}, finite={})
    d = seat(radius, width)
    cos, sin = (d + 0.5 * width) / radius, 0.5 * width / radius
    share = mass * d * radius / (mass * width * width / 6.0 + mass * d * d)
    slant = mu * (share - cos) / sin  # D/S
    total = mass * d / (cos - mu * sin * slant)
    rate = mu * radius * total / (mass * width * width / 6.0 + mass * d * d)
    slide = WallSlide(d, rate, 0.5 * total * (1.0 + slant), 0.5 * total * (1.0 - slant))
    if min(slide.leading, slide.trailing) < 0.0:
        raise ValueError(f"with a friction of {mu} and a radius of {radius} m a corner leaves the "
                         "wall")
    return slide


def wall_rest(radius: float, width: float, load: float) -> float:
    """Normal force (N) at either corner of a tile that a radial load presses on a smooth wall.

    Raises
    ------
    ValueError
        The circle is narrower than the square.
    """
    return 0.5 * load * radius / (seat(radius, width) + 0.5 * width)


def critical_spin(bond: float, mass: float, width: float, tiles: int) -> float:
    """Spin (rad/s) at which a bonded row of 2 or 3 tiles flies apart; `bond` in N.

    The bond holds a tile on its circle: m omega^2 w/2 = F of a pair, m omega^2 w = F of three.

    Raises
    ------
    ValueError
        Another number of tiles, a bond that pushes, or a mass or width that is not positive.
    """
    if tiles not in (2, 3):
        raise ValueError("a row of 2 or 3 tiles")
    if not (bond >= 0.0 and mass > 0.0 and width > 0.0):
        raise ValueError(f"the bond must be at least 0 and mass and width positive, not {bond:g} N,"
                         f" {mass:g} kg and {width:g} m")
    return math.sqrt(bond / (mass * width * (0.5 if tiles == 2 else 1.0)))


class Fall(NamedTuple):
    """A square that rocks about one corner until it lies flat."""

    time: float  # s, from rest at the tilt
    spin: float  # rad/s, as it lands


def rocking_fall(load: float, mass: float, width: float, tilt: float) -> Fall:
    """From rest at `tilt` (rad, 0 to below pi/4) under a force `load` (N) on its centre.

    The corner sticks and 1/2 (2/3 m w^2) omega^2 = F w/2 (cos t0 + sin t0 - cos t - sin t).
    Without a load it stays: the time is infinite.

    Raises
    ------
    ValueError
        A load that lifts, or a tilt from which it does not fall; a mass or width that is not
        positive.
    """
    demand({"mass": mass, "width": width}, at_least_0={}, finite={})
    if not 0.0 <= load < math.inf:
        raise ValueError(f"the load must be finite and at least 0, not {load} N")
    if not 0.0 <= tilt < 0.25 * math.pi:
        raise ValueError(f"the tilt must be from 0 to below pi/4, not {tilt} rad")
    if load == 0.0:
        return Fall(math.inf, 0.0)
    inertia = 2.0 / 3.0 * mass * width * width

    def spin(fallen: float) -> float:
        # cos t0 + sin t0 - cos t - sin t, without the difference of what is nearly equal
        drop = 2.0 * math.sqrt(2.0) * math.sin(0.5 * fallen) * math.sin(
            0.25 * math.pi - tilt + 0.5 * fallen)
        return math.sqrt(load * width * drop / inertia)

    time = quad(lambda u: 2.0 * u / spin(u * u), 0.0, math.sqrt(tilt), epsabs=0.0,
                epsrel=1e-12)[0]
    return Fall(float(time), spin(tilt))


class Rock(NamedTuple):
    """The first impact of a rocking square with the new corner."""

    spin: float  # rad/s after it
    slip: float  # m/s of the new corner along the ground after it, towards the old corner
    mode: str


def rocking_impact(spin: float, mass: float, width: float, mu: float) -> Rock:
    """A square that turned about one corner lands flat on a plane, e = 0.

    `spin` > 0 (rad/s).  From mu = 1/3 on the old corner leaves and the new one alone is hit, by
    Routh's process: it sticks from mu = 3/5 on (Housner: omega+ = omega-/4) and slips below.

    Below 1/3 Routh's impulse at the new corner would press the old one into the ground, and both
    are hit: with P = m omega w/2 in sum and P1 - P2 = m w omega (1/3 + mu/2) the tile ends flat
    and slides on at (1 - mu) omega w/2.

    Raises
    ------
    ValueError
        A spin, mass or width that is not positive, or a friction below 0.
    """
    demand({"spin": spin, "mass": mass, "width": width}, at_least_0={"mu": mu}, finite={})
    # Counter-clockwise about the right corner; the left one lands.  The normal points up and
    # the tangent, a quarter turn on, to the left.
    inertia, half = mass * width * width / 6.0, 0.5 * width
    if mu < 1.0 / 3.0:
        return Rock(0.0, -(1.0 - mu) * half * spin, "flat")
    b1, b2, b3 = inverse_inertia(math.inf, math.inf, (0.0, 0.0), mass, inertia, (half, -half))
    hit = routh(-spin * width, 0.0, b1, b2, b3, mu, 0.0)
    vx = -half * spin - hit.tangential / mass
    after = spin - half * (hit.normal + hit.tangential) / inertia
    return Rock(after, vx + half * after, hit.mode)
