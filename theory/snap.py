"""Two tiles that their magnets pull together: the motion up to contact or rest, by events.

Dry friction of the floor has separate bounds for force and torque; damping is dv/dt = -c v.
The motion is cut where a tile starts or stops to slide or to turn, so that every piece is
smooth up to the magnets' switch (two continuous derivatives) and an adaptive method of order 8
follows it to 1e-10.  Contacts are looked for within every step as well: fast tiles can meet and
part again in one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from theory.magnets import Glues, Law, Pose, pair_force
from theory.motion import demand

Reals = NDArray[np.float64]

# Left to a stop of a slide, where its direction is singular (s).
REST = 1e-10
# A slide turns to the direction of its force at a rate of F/(m |v|), which has no upper limit as
# it starts.  Slower than this time times R/m it is taken to have that direction (s).
FOLLOWS = 1e-6
# Of the integrator, relative; and absolute in m, rad, m/s and rad/s.
TOLERANCE, SMALLEST = 1e-12, 1e-15
# Added to speeds whose end is an event, so that it is not found at the start from 0 (m/s, rad/s).
NOTHING = 1e-25
HOLDS = 1.0 + 1e-12  # what a floor bears, in its bounds: a load at them is not beyond
# Two corners of a face are equally near within this part of the width.
LEVEL = 1e-9
# Way of a corner, in widths, after which its gap is looked at; shallow passes between are searched.
LOOK = 1e-3
# So many pieces of the motion that together take less than this time (s) get nowhere.
PIECES, STUCK = 30, 1e-9
# Gone by itself (s) where an event leaves all as it was: a sharp cut-off lets a load jump past its
# bound, and the event is found at the last instant before.
JUMP = 1e-11


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
        self.creeps = [False, False]  # slides, but too slow for a direction of its own

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
                along = force if self.creeps[i] else velocity
                force -= body.friction_force * along / abs(along) if along else 0.0
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
                    return HOLDS * body.friction_force - abs(force)
                velocity = complex(v[i, 0], v[i, 1])
                if self.creeps[i]:  # to rest again, or fast enough
                    along = (velocity * force.conjugate()).real / (abs(force) or 1.0)
                    return min(_slow(body) - abs(velocity), along + NOTHING)
                if not velocity:
                    return 0.0
                along = (force * velocity.conjugate()).real / abs(velocity)
                slowing = (body.friction_force - along) / body.mass
                return abs(velocity) - max(slowing, 0.0) * REST

            def turn(t: float, z: Reals, i: int = i, body: Body = body) -> float:
                q, v = z.reshape(2, 2, 3)
                if self.turns[i]:
                    return float(self.turns[i] * v[i, 2]) + NOTHING
                return HOLDS * body.friction_torque - abs(self.loads(q)[i][1])

            if body.friction_force > 0.0:
                found.append(slide)
            if body.friction_torque > 0.0:
                found.append(turn)
        for event in found:
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return found


def _slow(body: Body) -> float:
    """Speed (m/s) below which a slide that starts has the direction of its force."""
    return FOLLOWS * body.friction_force / body.mass


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
        The two tiles; one may be held (infinite mass and inertia, and no twist).
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
        The tiles overlap at the start; a held tile that moves or could turn; a mass, inertia, width
        or tolerance that is not positive, a friction, damping, time or beta below 0, or what is not
        finite but for mass, inertia and the cut-off.
    RuntimeError
        The integrator fails, or the time does not advance.
    """
    for body in bodies:
        heavy = {name: min(getattr(body, name), 1e300) for name in ("mass", "inertia")}
        demand(heavy, at_least_0={k: v for k, v in body._asdict().items() if k not in heavy},
               finite={})
    demand({"width": law.width, "tolerance": tolerance},
           at_least_0={"until": until, "beta": law.beta},
           finite={"alpha": law.alpha, "inset": law.inset, "mismatch": law.mismatch})
    if not (np.isfinite(poses).all() and np.isfinite(twists).all()):
        raise ValueError("poses and twists must be finite")
    for body, twist in zip(bodies, twists, strict=True):
        if math.isinf(body.mass) and (not math.isinf(body.inertia) or np.any(twist)):
            raise ValueError("a tile of infinite mass is held: its inertia must be infinite and "
                             f"its twist 0, not {body.inertia} kg m^2 and {twist}")
    part, width = _Part(bodies, glues, law), law.width
    z = np.array([poses, twists], dtype=np.float64).reshape(2, 2, 3)
    if (gap := gap_of(z, width)) < -LEVEL * width:
        raise ValueError(f"the tiles overlap at the start, by {-gap:g} m")
    now, starts = 0.0, [-math.inf] * PIECES
    while now < until:
        _modes(part, z)
        if not any(part.slides) and not any(part.turns):
            return _meeting("rest", now, z, width)
        soon = z[1] + REST * part.rates(now, z.ravel()).reshape(2, 2, 3)[1]
        approach = closing(z[0], soon, width)[0]
        if approach > 0.0 and gap_of(z, width) <= REST * approach:  # no event would see it
            return _meeting("contact", now, z, width)
        starts = [*starts[1:], now]
        if now - starts[0] < STUCK:
            raise RuntimeError(f"the motion does not get on from t = {now} s")
        events = part.events(width)
        found: Any = solve_ivp(part.rates, (now, until), z.ravel(), "DOP853", events=events,
                               rtol=tolerance, atol=SMALLEST, max_step=0.01, dense_output=True)
        if found.status < 0:
            raise RuntimeError(found.message)
        if (hit := _unseen(found, width)) is not None:
            return _meeting("contact", hit, found.sol(hit).reshape(2, 2, 3), width)
        now, z = float(found.t[-1]), found.y[:, -1].reshape(2, 2, 3).copy()
        if found.status == 1 and found.t_events[0].size:
            return _meeting("contact", now, z, width)
        if now == starts[-1]:
            now, z = now + JUMP, z + JUMP * part.rates(now, z.ravel()).reshape(2, 2, 3)
    return _meeting("time", now, z, width)


def _modes(part: _Part, z: Reals) -> None:
    """Set who slides and turns from here on, and at rest what has come to it."""
    for i, (force, torque) in enumerate(part.loads(z[0])):
        body, v = part.bodies[i], z[1, i]
        velocity = complex(v[0], v[1])
        if math.isinf(body.mass):
            continue
        if part.slides[i] and body.friction_force > 0.0:
            along = (force * velocity.conjugate()).real
            if part.creeps[i]:
                stops = along <= 1e-6 * _slow(body) * abs(force)
            else:
                slowing = (body.friction_force - along / max(abs(velocity), 1e-300)) / body.mass
                stops = slowing > 0.0 and abs(velocity) <= 2.0 * slowing * REST
            if stops:
                v[:2] = velocity = 0.0
        if part.turns[i] and abs(v[2]) < 1e-13 * max(1.0, abs(torque) / body.inertia):
            v[2] = 0.0
        # An event at a bound leaves the load there up to rounding: it is about to pass.
        passes = abs(abs(force) - body.friction_force) <= 1e-9 * body.friction_force
        part.slides[i] = velocity != 0.0 or abs(force) > HOLDS * body.friction_force or (
            passes and body.friction_force > 0.0 and not part.slides[i])
        part.creeps[i] = part.slides[i] and body.friction_force > 0.0 and (
            velocity == 0.0 or (part.creeps[i] and abs(velocity) < (1.0 - 1e-6) * _slow(body)))
        passes = abs(abs(torque) - body.friction_torque) <= 1e-9 * body.friction_torque
        if v[2] != 0.0:
            part.turns[i] = math.copysign(1.0, v[2])
        elif abs(torque) > HOLDS * body.friction_torque or (
                passes and body.friction_torque > 0.0 and not part.turns[i]):
            part.turns[i] = math.copysign(1.0, torque)
        else:
            part.turns[i] = 0.0
    if any(part.slides) or any(part.turns):  # where nothing rubs, no event would see a load begin
        for i, body in enumerate(part.bodies):
            if not math.isinf(body.mass):
                part.slides[i] |= body.friction_force == 0.0
                part.turns[i] = part.turns[i] or float(body.friction_torque == 0.0)


def _unseen(found: Any, width: float) -> float | None:
    """First time (s) at which the tiles of a solution meet, though they may be apart at its steps.

    No point goes faster than the sum of the centres' relative speed and of either spin times half
    the diagonal, so that nothing is missed in the time in which it could just close the gap.
    """

    def gap(t: float) -> float:
        return gap_of(found.sol(t), width)

    deep, look, half = -1e-3 * LEVEL * width, LOOK * width, math.sqrt(0.5) * width
    seen = [(float(found.t[0]), gap_of(found.y[:, 0], width))]  # times and gaps, the last three
    for k in range(1, found.t.size):
        end, rate = float(found.t[k]), 0.0
        for z in (found.y[:, side].reshape(2, 2, 3) for side in (k - 1, k)):
            across = z[1, 1] - z[1, 0]
            rate = max(rate, math.hypot(across[0], across[1])
                       + half * float(np.abs(z[1, :, 2]).sum()))
        while (now := seen[-1][0]) < end:
            ahead = max(seen[-1][1], look) / rate if rate > 0.0 else math.inf
            t = min(end, max(now + ahead, math.nextafter(now, math.inf)))
            seen = [*seen[-2:], (t, gap(t))]
            low, least = seen[-1]
            if least >= deep and len(seen) == 3 and seen[1][1] < look and (
                    seen[0][1] >= seen[1][1] <= seen[2][1]):
                pit = minimize_scalar(gap, bounds=(seen[0][0], t), method="bounded",
                                      options={"xatol": 1e-6 * (t - seen[0][0])})
                low, least = float(pit.x), float(pit.fun)
            if least < deep:
                before = max((s for s in seen if s[0] < low), default=(low, 0.0))
                return float(brentq(gap, before[0], low, xtol=1e-15)) if before[1] > 0.0 else (
                    before[0])
    return None


def _meeting(kind: str, time: float, z: Reals, width: float) -> Meeting:
    gap, _, _ = separation(z[0, 0], z[0, 1], width)
    speed, slip = closing(z[0], z[1], width)
    tilt = (z[0, 1, 2] - z[0, 0, 2] + 0.25 * math.pi) % (0.5 * math.pi) - 0.25 * math.pi
    return Meeting(kind, time, z[0].copy(), z[1].copy(), speed, slip, gap, float(tilt))
