"""Two tiles that their magnets pull together: the motion up to contact or rest, by events.

Dry friction of the floor has separate bounds for force and torque; damping is dv/dt = -c v.
The motion is cut where a tile starts or stops to slide or to turn, so that every piece is
smooth up to the magnets' switch (two continuous derivatives) and an adaptive method of order 8
follows it to 1e-10.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from theory.magnets import Glues, Law, Pose, pair_force

Reals = NDArray[np.float64]

# Left to a stop, and gone after a start, of a slide, where its direction is singular (s).
REST = 1e-10
# Of the integrator, relative; and absolute in m, rad, m/s and rad/s.
TOLERANCE, SMALLEST = 1e-12, 1e-15
# Two corners of a face are equally near within this part of the width.
LEVEL = 1e-9


class Body(NamedTuple):
    """A tile and what the floor does to it; `mass` and `inertia` may be infinite (held)."""

    mass: float  # kg
    inertia: float  # kg m^2
    friction_force: float = 0.0  # N
    friction_torque: float = 0.0  # N m
    linear_damping: float = 0.0  # 1/s
    angular_damping: float = 0.0  # 1/s


class Meeting(NamedTuple):
    """How the motion of two tiles ends."""

    kind: str  # "contact", "rest" or "time"
    time: float  # s
    poses: Reals  # (2, 3): x, y, angle
    twists: Reals  # (2, 3): vx, vy, omega
    speed: float  # m/s, with which the nearest points approach along the normal
    slip: float  # m/s, of b's point against a's along the tangent, +90 degrees from the normal
    gap: float  # m, between the tiles
    tilt: float  # rad, of the two faces against each other: 0 where they are parallel


def separation(pose_a: Sequence[float] | Reals, pose_b: Sequence[float] | Reals,
               width: float) -> tuple[float, complex, list[complex]]:
    """Gap between two equal squares, the normal from a to b, and the nearest corner or corners.

    The gap is the largest distance by which one of the eight face normals tells the squares
    apart; negative where they overlap.  Corners are those of the square that does not own the
    normal: one, or the two of a face that is parallel.
    """
    half = 0.5 * width
    centres = complex(pose_a[0], pose_a[1]), complex(pose_b[0], pose_b[1])
    turns = [np.exp(1j * pose[2]) for pose in (pose_a, pose_b)]
    corners = [[z + turn * half * complex(u, v) for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
               for z, turn in zip(centres, turns, strict=True)]
    best: tuple[float, complex, list[complex]] = (-math.inf, 0j, [])
    for own, other in ((0, 1), (1, 0)):
        for quarter in (1, 1j, -1, -1j):
            normal = turns[own] * quarter
            heights = [((p - centres[own]) * normal.conjugate()).real - half
                       for p in corners[other]]
            if min(heights) > best[0]:
                order = sorted(range(4), key=heights.__getitem__)
                nearest = [i for i in order if heights[i] <= heights[order[0]] + LEVEL * width]
                best = (min(heights), complex(normal if own == 0 else -normal),
                        [complex(corners[other][i]) for i in nearest])
    return best


def gap_of(z: Reals, width: float) -> float:
    """Gap (m) between the two tiles of a flat state."""
    q = z.reshape(2, 2, 3)[0]
    return separation(q[0], q[1], width)[0]


def closing(poses: Reals, twists: Reals, width: float) -> tuple[float, float]:
    """Speeds (m/s) of approach along the normal and of slip along the tangent, b against a."""
    _, normal, points = separation(poses[0], poses[1], width)
    speeds = []
    for p in points:
        v = [complex(t[0], t[1]) + 1j * t[2] * (p - complex(q[0], q[1]))
             for q, t in zip(poses, twists, strict=True)]
        speeds.append((v[1] - v[0]) * normal.conjugate())
    hit = min(speeds, key=lambda speed: speed.real)
    return -hit.real, hit.imag


class _Part:
    """Forces on both tiles, and the rates of a piece of the motion in which the modes hold."""

    def __init__(self, bodies: Sequence[Body], glues: Sequence[Glues], law: Law) -> None:
        self.bodies, self.glues, self.law = bodies, glues, law
        self.slides, self.turns = [False, False], [0.0, 0.0]

    def loads(self, q: Reals) -> list[tuple[complex, float]]:
        a, b = (tuple(map(float, pose)) for pose in q)
        fx, fy, torque_a, torque_b = pair_force(_pose(a), self.glues[0], _pose(b), self.glues[1],
                                                self.law)
        return [(complex(-fx, -fy), torque_a), (complex(fx, fy), torque_b)]

    def rates(self, t: float, z: Reals) -> Reals:
        q, v = z.reshape(2, 2, 3)
        out = np.zeros((2, 2, 3))
        out[0] = v
        for i, (force, torque) in enumerate(self.loads(q)):
            body, velocity = self.bodies[i], complex(v[i, 0], v[i, 1])
            if self.slides[i]:
                force -= body.friction_force * velocity / abs(velocity) if velocity else 0.0
                rate = force / body.mass - body.linear_damping * velocity
                out[1, i, :2] = rate.real, rate.imag
            else:
                out[0, i, :2] = 0.0
            if self.turns[i]:
                torque -= self.turns[i] * body.friction_torque
                out[1, i, 2] = torque / body.inertia - body.angular_damping * v[i, 2]
            else:
                out[0, i, 2] = 0.0
        return out.ravel()

    def events(self, width: float) -> list[Callable[[float, Reals], float]]:
        """Contact first; then for each tile what ends its mode of sliding and of turning."""
        found = [lambda t, z: gap_of(z, width)]
        for i, body in enumerate(self.bodies):
            if math.isinf(body.mass):
                continue

            def slide(t: float, z: Reals, i: int = i, body: Body = body) -> float:
                q, v = z.reshape(2, 2, 3)
                force = self.loads(q)[i][0]
                if not self.slides[i]:
                    return body.friction_force - abs(force)
                velocity = complex(v[i, 0], v[i, 1])
                if not velocity:
                    return 0.0
                along = (force * velocity.conjugate()).real / abs(velocity)
                slowing = (body.friction_force - along) / body.mass
                return abs(velocity) - max(slowing, 0.0) * REST

            def turn(t: float, z: Reals, i: int = i, body: Body = body) -> float:
                q, v = z.reshape(2, 2, 3)
                if self.turns[i]:
                    return float(self.turns[i] * v[i, 2])
                return body.friction_torque - abs(self.loads(q)[i][1])

            if body.friction_force > 0.0:
                found.append(slide)
            if body.friction_torque > 0.0:
                found.append(turn)
        for event in found:
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return found


def _pose(values: tuple[float, ...]) -> Pose:
    return values[0], values[1], values[2]


def meet(poses: Sequence[Sequence[float]], twists: Sequence[Sequence[float]],
         bodies: Sequence[Body], glues: Sequence[Glues], law: Law, *,
         until: float = 10.0, tolerance: float = TOLERANCE) -> Meeting:
    """Follow two tiles until they touch, rest, or the time is over.

    Parameters
    ----------
    poses, twists
        x, y, angle and vx, vy, omega of the two tiles at time 0 (m, rad, m/s, rad/s).
    bodies
        The two tiles; one may be held (infinite mass and inertia).
    glues
        Labels of the N, E, S, W edges of each.
    law
        Magnets, with the width of the tiles.
    until : float
        s.
    tolerance : float
        Relative tolerance of the integrator.

    Raises
    ------
    ValueError
        The tiles overlap at the start.
    RuntimeError
        The integrator fails.
    """
    part, width = _Part(bodies, glues, law), law.width
    z = np.array([poses, twists], dtype=np.float64).reshape(2, 2, 3)
    if (gap := gap_of(z, width)) < -LEVEL * width:
        raise ValueError(f"the tiles overlap at the start, by {-gap:g} m")
    now = 0.0
    while now < until:
        kick = _modes(part, z)
        if not any(part.slides) and not any(part.turns):
            return _meeting("rest", now, z, width)
        soon = z[1] + REST * part.rates(now, _with_direction(part, z)).reshape(2, 2, 3)[1]
        approach = closing(z[0], soon, width)[0]
        if approach > 0.0 and gap_of(z, width) <= REST * approach:  # no event would see it
            return _meeting("contact", now, z, width)
        if kick > 0.0:  # past the singular start of a slide, along its force
            z[0] += kick * z[1]
            z[1], now = soon, now + kick
        events = part.events(width)
        found: Any = solve_ivp(part.rates, (now, until), z.ravel(), "DOP853", events=events,
                               rtol=tolerance, atol=SMALLEST, max_step=0.01)
        if found.status < 0:
            raise RuntimeError(found.message)
        now, z = float(found.t[-1]), found.y[:, -1].reshape(2, 2, 3).copy()
        if found.status == 1 and found.t_events[0].size:
            return _meeting("contact", now, z, width)
    return _meeting("time", now, z, width)


def _modes(part: _Part, z: Reals) -> float:
    """Set who slides and turns from here on; returns REST where a slide starts from rest."""
    start = 0.0
    for i, (force, torque) in enumerate(part.loads(z[0])):
        body, v = part.bodies[i], z[1, i]
        speed = math.hypot(v[0], v[1])
        grip, hold = body.friction_force * (1.0 + 1e-12), body.friction_torque * (1.0 + 1e-12)
        if math.isinf(body.mass):
            continue
        if part.slides[i] and body.friction_force > 0.0:
            slowing = (body.friction_force - (force * complex(v[0], -v[1])).real
                       / max(speed, 1e-300)) / body.mass
            if slowing > 0.0 and speed <= 2.0 * slowing * REST:
                v[:2] = speed = 0.0
        if part.turns[i] and abs(v[2]) < 1e-13 * max(1.0, abs(torque) / body.inertia):
            v[2] = 0.0
        # An event at a bound leaves the load there up to rounding: it is about to pass.
        passes = abs(abs(force) - body.friction_force) <= 1e-9 * body.friction_force
        part.slides[i] = speed > 0.0 or abs(force) > grip or (
            passes and body.friction_force > 0.0 and not part.slides[i])
        if part.slides[i] and speed == 0.0:
            start = REST
        passes = abs(abs(torque) - body.friction_torque) <= 1e-9 * body.friction_torque
        if v[2] != 0.0:
            part.turns[i] = math.copysign(1.0, v[2])
        elif abs(torque) > hold or (passes and body.friction_torque > 0.0
                                    and not part.turns[i]):
            part.turns[i] = math.copysign(1.0, torque)
        else:
            part.turns[i] = 0.0
    return start


def _with_direction(part: _Part, z: Reals) -> Reals:
    """The state with a tiny velocity along the force where a slide starts from rest."""
    seen = z.copy()
    for i, (force, _) in enumerate(part.loads(z[0])):
        if part.slides[i] and not z[1, i, :2].any() and abs(force) > 0.0:
            seen[1, i, :2] = 1e-30 * force.real / abs(force), 1e-30 * force.imag / abs(force)
    return seen.ravel()


def _meeting(kind: str, time: float, z: Reals, width: float) -> Meeting:
    gap, _, _ = separation(z[0, 0], z[0, 1], width)
    speed, slip = closing(z[0], z[1], width)
    tilt = (z[0, 1, 2] - z[0, 0, 2] + 0.25 * math.pi) % (0.5 * math.pi) - 0.25 * math.pi
    return Meeting(kind, time, z[0].copy(), z[1].copy(), speed, slip, gap, float(tilt))
