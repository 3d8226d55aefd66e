"""The paper's magnets: law, energy, and what holds two tiles together.

F = alpha/(r + beta)^2 between two magnets a distance r apart, attracting where the glues are
g and -g and repelling otherwise; see the paper's section "Magnetic force model".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from scipy.integrate import quad

Glues = Sequence[int]  # labels of the N, E, S, W edges; 0: no magnet
Pose = tuple[float, float, float]  # x, y (m), angle (rad)


class Law(NamedTuple):
    """Numbers of the force law and of the tile."""

    alpha: float = 1.8e-5  # N m^2
    beta: float = 6.4e-3  # m
    width: float = 0.03  # m
    inset: float = 1.5e-3  # m, from a magnet to its edge
    cutoff: float = math.inf  # m, no force beyond
    switch: float = 0.0  # last fraction of the cut-off, over which the force fades out
    mismatch: float = -1.0  # p of glues that do not attract


def fade(r: float, law: Law) -> float:
    """The switch S = 1 - 10 u^3 + 15 u^4 - 6 u^5, u = 0...1 over the last part of the cut-off.

    S, S' and S'' are continuous.  Without a cut-off there is no switch.  With one that is sharp
    (`switch` 0) what is just at it may count or not, by rounding: the outer magnets of a bonded
    pair are a width apart.
    """
    if r >= law.cutoff:
        return 0.0
    length = 0.0 if math.isinf(law.cutoff) else law.switch * law.cutoff
    if r <= law.cutoff - length:
        return 1.0
    return _fade((law.cutoff - r) / length)


def _fade(left: float) -> float:
    """S of what is left of the switch, 1 - u: without cancellation near its end."""
    return left**3 * (10.0 - 15.0 * left + 6.0 * left * left)


def force(r: float, law: Law) -> float:
    """Size of the force between two magnets a distance r apart (N): S alpha/(r + beta)^2."""
    reach = r + law.beta
    return fade(r, law) * law.alpha / (reach * reach)


def energy(r: float, law: Law) -> float:
    """Potential energy of two attracting magnets, 0 at infinity (J); repelling: minus it.

    U(r) = -integral of F from r to infinity; without a switch, and up to where it begins,
    -alpha/(r + beta) + alpha/(end + beta).
    """
    if r >= law.cutoff:
        return 0.0
    if law.switch == 0.0 or math.isinf(law.cutoff):
        tail = 0.0 if math.isinf(law.cutoff) else law.alpha / (law.cutoff + law.beta)
        return tail - law.alpha / (r + law.beta)
    length, end = law.switch * law.cutoff, law.cutoff + law.beta
    begin = max(r, law.cutoff - length)
    # Of S over y = log(end/(r + beta)): dimensionless, and smooth however near the magnets are.
    fading = float(quad(lambda y: _fade(-math.expm1(-y) * end / length) * math.exp(y), 0.0,
                        math.log1p((law.cutoff - begin) / (begin + law.beta)), epsabs=0.0,
                        epsrel=1e-12)[0])
    return law.alpha / (begin + law.beta) - law.alpha / (r + law.beta) - fading * law.alpha / end


def polarity(glue_a: int, glue_b: int, law: Law) -> float:
    """p: 1 where the glues attract, 0 where a magnet is missing, else ``law.mismatch``."""
    if glue_a == 0 or glue_b == 0:
        return 0.0
    return 1.0 if glue_a == -glue_b else law.mismatch


def magnet_positions(pose: Pose, law: Law) -> list[tuple[float, float]]:
    """Places of a tile's N, E, S and W magnets (m)."""
    x, y, angle = pose
    d = 0.5 * law.width - law.inset
    c, s = d * math.cos(angle), d * math.sin(angle)
    return [(x - s, y + c), (x + c, y + s), (x + s, y - c), (x - c, y - s)]


def pair_force(pose_a: Pose, glues_a: Glues, pose_b: Pose, glues_b: Glues,
               law: Law) -> tuple[float, float, float, float]:
    """What the magnets of a do to b: ``(fx, fy, torque_a, torque_b)`` (N, N, N m, N m).

    Forces act at the magnets; the force on a is minus that on b, the torques are about the
    tiles' centres.  Two magnets at one point do not push each other.
    """
    fx = fy = torque_a = torque_b = 0.0
    for (ax, ay), glue_a in zip(magnet_positions(pose_a, law), glues_a, strict=True):
        for (bx, by), glue_b in zip(magnet_positions(pose_b, law), glues_b, strict=True):
            dx, dy = bx - ax, by - ay
            r = math.hypot(dx, dy)
            if r <= 1e-9 * law.width:  # but for rounding
                continue
            pull = polarity(glue_a, glue_b, law) * force(r, law) / r
            gx, gy = -pull * dx, -pull * dy
            fx, fy = fx + gx, fy + gy
            torque_b += (bx - pose_b[0]) * gy - (by - pose_b[1]) * gx
            torque_a -= (ax - pose_a[0]) * gy - (ay - pose_a[1]) * gx
    return fx, fy, torque_a, torque_b


def pair_energy(pose_a: Pose, glues_a: Glues, pose_b: Pose, glues_b: Glues, law: Law) -> float:
    """Potential energy of two tiles' magnets (J)."""
    return sum(
        polarity(glue_a, glue_b, law) * energy(math.dist(a, b), law)
        for a, glue_a in zip(magnet_positions(pose_a, law), glues_a, strict=True)
        for b, glue_b in zip(magnet_positions(pose_b, law), glues_b, strict=True)
    )


def bond_force(glues_a: Glues, glues_b: Glues, law: Law) -> float:
    """Force that holds tile b, turned like a, to the E edge of a (N; negative: repelled)."""
    return -pair_force((0.0, 0.0, 0.0), glues_a, (law.width, 0.0, 0.0), glues_b, law)[0]
