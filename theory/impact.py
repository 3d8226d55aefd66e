"""One contact of two planar rigid bodies in impact, with Coulomb friction.

Routh's process in the plane of the two impulses, Poisson's restitution.  After Wang and Mason,
"Two-dimensional rigid-body collisions with friction", J. Applied Mechanics 59 (1992) 635.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Impact(NamedTuple):
    """Impulses on body b (N s) and the mode of the contact."""

    normal: float
    tangential: float
    mode: str  # none, sliding, C-sticking, R-sticking, C-reversed, R-reversed


def inverse_inertia(mass_a: float, inertia_a: float, arm_a: tuple[float, float], mass_b: float,
                    inertia_b: float, arm_b: tuple[float, float]) -> tuple[float, float, float]:
    """B1, B2, B3 of a contact; an infinite mass and inertia make a fixed body.

    `arm_a`, `arm_b` lead from the bodies' centres to the contact, in its axes (tangent,
    normal), the tangent a quarter turn counter-clockwise from the normal.  An impulse
    (Pt, Pn) on b and its opposite on a change the velocity of b's point against a's by
    dvt = B1 Pt - B3 Pn, dvn = -B3 Pt + B2 Pn.
    """
    b1 = b2 = b3 = 0.0
    for mass, inertia, (t, n) in ((mass_a, inertia_a, arm_a), (mass_b, inertia_b, arm_b)):
        b1 += 1.0 / mass + n * n / inertia
        b2 += 1.0 / mass + t * t / inertia
        b3 += n * t / inertia
    return b1, b2, b3


def routh(vn: float, vt: float, b1: float, b2: float, b3: float, mu: float, e: float) -> Impact:
    """Impulses of one impact.

    Parameters
    ----------
    vn, vt : float
        Velocity of b's point against a's before the impact (m/s); vn < 0 approaches.  vn = 0
        is a tangential impact, which only happens where sliding friction would press the
        bodies into each other.
    b1, b2, b3 : float
        Inverse inertia at the contact (1/kg), see :func:`inverse_inertia`; b1 b2 > b3^2.
    mu, e : float
        Friction coefficient and Poisson's coefficient of restitution: the normal impulse of
        restitution is e times that of compression.

    Notes
    -----
    While the contact slides in the direction s the impulse moves along Pt = -s mu Pn.  It
    meets the line of sticking vt = 0 at Pn = s vt/(mu b1 + s b3) and the line of greatest
    compression vn = 0 at Pn = -vn/(b2 + s mu b3); which comes first is told by
    Pd = (b2 + s mu b3) s vt and Pq = (mu b1 + s b3)(-vn) without dividing.  From the line of
    sticking the impulse goes on along that line where this stays inside the friction cone,
    mu > |b3|/b1, and slides in reverse otherwise.
    """
    if vn > 0.0:
        return Impact(0.0, 0.0, "none")
    # Without sliding it can only start towards where the normal impulse drives it.
    s = math.copysign(1.0, vt if vt != 0.0 else -b3)
    press = b2 + s * mu * b3
    brake = mu * b1 + s * b3
    pd, pq = press * s * vt, -brake * vn
    if vn == 0.0 and pd >= 0.0:
        return Impact(0.0, 0.0, "none")
    sticks = mu * b1 > abs(b3)

    if brake <= 0.0 or pd >= (1.0 + e) * pq:  # slides to the end
        pn = -(1.0 + e) * vn / press
        return Impact(pn, -s * mu * pn, "sliding")
    stops = s * vt / brake  # the normal impulse at which sliding stops
    if pd > pq:  # in restitution: compression was all sliding
        pn = -(1.0 + e) * vn / press
        if sticks:
            return Impact(pn, (b3 * pn - vt) / b1, "R-sticking")
        return Impact(pn, s * mu * (pn - 2.0 * stops), "R-reversed")
    if sticks:  # in compression
        pn = -(1.0 + e) * (b1 * vn + b3 * vt) / (b1 * b2 - b3 * b3)
        return Impact(pn, (b3 * pn - vt) / b1, "C-sticking")
    pn = -(1.0 + e) * (vn + 2.0 * s * mu * b3 * stops) / (b2 - s * mu * b3)
    return Impact(pn, s * mu * (pn - 2.0 * stops), "C-reversed")


def energy_change(vn: float, vt: float, b1: float, b2: float, b3: float, pn: float,
                  pt: float) -> float:
    """Change of kinetic energy by the impulses (J): P . v + P . B P/2."""
    return vn * pn + vt * pt + 0.5 * (b1 * pt * pt + b2 * pn * pn) - b3 * pn * pt
