"""Motion of one tile without contacts, and a head-on impact: closed forms and a reference.

Floor friction here has separate bounds for force and torque; damping is dv/dt = -c v.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import roots_jacobi

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# A slide is over when its time to go at the present deceleration is below this (s; for t > 1 s,
# as a part of t).
REST = 1e-12
# Of the largest speed in a step: the last two Legendre coefficients of the velocity.
TOLERANCE = 1e-12
# Length of the first step of a slide (s); it shrinks as needed.
FIRST = 1e-2
# Nodes of Radau IIA collocation.
STAGES = 14


def _radau(stages: int) -> tuple[Reals, Reals, Reals]:
    """Nodes in (-1, 1], the integrals from -1 to them, values at -1 and nodes -> Legendre."""
    nodes = np.append(roots_jacobi(stages - 1, 1.0, 0.0)[0], 1.0)
    integrals = legendre.legval(nodes, legendre.legint(np.eye(stages), lbnd=-1.0)).T
    matrix = integrals @ np.linalg.inv(legendre.legvander(nodes, stages - 1))
    fit = np.linalg.inv(legendre.legvander(np.append(-1.0, nodes), stages))
    return nodes, matrix, fit


NODES, INTEGRALS, FIT = _radau(STAGES)
GAUSS = legendre.leggauss(16)


def demand(positive: dict[str, float], *, at_least_0: dict[str, float],
           finite: dict[str, float]) -> None:
    """Refuse what is not positive, below 0, or not finite, by its name.

    Raises
    ------
    ValueError
        It says which is, and what is allowed.
    """
    for name, value in (positive | at_least_0 | finite).items():
        if (not math.isfinite(value) or (name in positive and value <= 0.0)
                or (name in at_least_0 and value < 0.0)):
            what = ("positive" if name in positive else
                    "at least 0" if name in at_least_0 else "a number")
            raise ValueError(f"{name} must be {what} and finite, not {value}")


def increasing(times: ArrayLike) -> Reals:
    """Times (s) as an array, shape (k,).

    Raises
    ------
    ValueError
        They do not increase from 0, or are not finite.
    """
    instants = np.asarray(times, dtype=np.float64)
    if instants.ndim != 1:
        raise ValueError("times must be numbers in a row")
    if not np.all(np.diff(instants, prepend=0.0) >= 0.0) or not np.all(np.isfinite(instants)):
        raise ValueError("times must increase, from 0, and be finite")
    return instants


def _stop(v0: float, deceleration: float, damping: float) -> tuple[float, float]:
    """Time and distance of dv/dt = -a - c v from v0 >= 0 to rest, stable for every c v0/a.

    With x = c v0/a: t = (v0/a) ln(1 + x)/x and d = (v0^2/a)(x - ln(1 + x))/x^2.  Without friction
    it never stops, and comes as far as v0/c.
    """
    for name, value in (("speed", v0), ("friction", deceleration), ("damping", damping)):
        if not 0.0 <= value < math.inf:
            raise ValueError(f"the {name} must be at least 0 and finite, not {value}")
    if deceleration == 0.0:
        return (math.inf, v0 / damping if damping else math.inf) if v0 else (0.0, 0.0)
    x = damping * v0 / deceleration
    time = math.log1p(x) / x if x > 0.0 else 1.0
    if x > 0.05:
        distance = (1.0 - math.log1p(x) / x) / x
    else:
        distance = sum((-x) ** k / (k + 2) for k in range(14))
    return time * v0 / deceleration, distance * v0 * v0 / deceleration


def sliding_stop(v0: float, mu: float, damping: float = 0.0,
                 gravity: float = 9.81) -> tuple[float, float]:
    """Time and distance until friction and damping stop a tile that slides at `v0` >= 0.

    m dv/dt = -mu m g - c m v gives

        t = ln(1 + c v0/(mu g))/c,    d = v0/c - (mu g/c^2) ln(1 + c v0/(mu g)),

    and, for c -> 0, t = v0/(mu g), d = v0^2/(2 mu g).

    Raises
    ------
    ValueError
        A negative speed, friction or damping.
    """
    return _stop(v0, mu * gravity, damping)


def spin_stop(omega0: float, torque: float, inertia: float,
              damping: float = 0.0) -> tuple[float, float]:
    """Time and angle until a friction torque and damping stop a tile that spins at `omega0` >= 0.

    I domega/dt = -T - c I omega gives

        t = ln(1 + c I omega0/T)/c,    angle = omega0/c - (T/(I c^2)) ln(1 + c I omega0/T),

    and, for c -> 0, t = I omega0/T, angle = I omega0^2/(2 T).

    Raises
    ------
    ValueError
        A negative speed, friction or damping, or an inertia that is not positive.
    """
    if not inertia > 0.0:
        raise ValueError(f"the inertia must be positive, not {inertia}")
    return _stop(omega0, torque / inertia, damping)


def head_on(mass_a: float, va: float, mass_b: float, vb: float, e: float) -> tuple[float, float]:
    """Velocities after a head-on impact of two bodies on a line.

    Momentum is kept and the relative velocity turns into -e times itself:

        va' = va + (1 + e) m_b/(m_a + m_b) (vb - va),
        vb' = vb - (1 + e) m_a/(m_a + m_b) (vb - va).
    """
    change = (1.0 + e) * (vb - va) / (mass_a + mass_b)
    return va + mass_b * change, vb - mass_a * change


class _Turn(NamedTuple):
    """Turning from `start` on: domega/dt = push sin(rate t) - drag - damping omega."""

    start: float
    angle: float
    spin: float
    push: float
    drag: float
    damping: float
    rate: float

    def at(self, t: ArrayLike) -> tuple[Reals, Reals]:
        """Angle and spin at t >= start, in closed form."""
        s = np.asarray(t, dtype=np.float64) - self.start
        x = self.damping * s
        fade = np.exp(-x)
        once = -np.expm1(-x) / self.damping if self.damping > 0.0 else s
        # (x - 1 + e^-x)/x^2; its difference loses digits at a small x.
        small = sum((-x) ** k / math.factorial(k + 2) for k in range(10))
        large = (x + np.expm1(-x)) / np.where(x > 0.1, x * x, 1.0)
        twice = s * s * np.where(x > 0.1, large, small)
        spin = self.spin * fade - self.drag * once
        angle = self.angle + self.spin * once - self.drag * twice
        if self.push != 0.0 and self.rate > 0.0:
            factor = self.push * cmath.exp(1j * self.rate * self.start)
            factor /= complex(self.damping, self.rate)
            wave = np.exp(1j * self.rate * s)
            spin = spin + (factor * (wave - fade)).imag
            angle = angle + (factor * ((wave - 1.0) / (1j * self.rate) - once)).imag
        return angle, spin


def _exceeds(load: float, bound: float) -> bool:
    """Whether a load passes its bound by more than rounding."""
    return load > bound * (1.0 + 1e-12)


def _next_start(t: float, load: float, bound: float, rate: float) -> float:
    """First time from `t` on at which |sin(rate t) load| exceeds `bound`; inf if there is none."""
    if not _exceeds(abs(load), bound) or rate == 0.0:
        return math.inf
    rise = math.asin(bound / abs(load))
    half = math.floor(rate * t / math.pi)
    phase = rate * t - half * math.pi
    if phase >= math.pi - rise - 1e-12:  # the rest is rounding
        half, phase = half + 1, 0.0
    return t if phase >= rise else max(t, (half * math.pi + rise) / rate)


def _turns(last: float, angle: float, spin: float, load: float, bound: float, rate: float,
           damping: float) -> list[_Turn]:
    """Turning and rest up to the time `last`; `load` and `bound` per inertia (1/s^2).

    e^(ct) omega is monotone between the times at which the drive crosses the bound, so that
    omega comes to rest at most once between two of them and no stop can be missed.
    """
    turns: list[_Turn] = []
    edges = [last]
    if _exceeds(abs(load), bound) and rate > 0.0:
        rise = math.asin(bound / abs(load))
        halves = np.arange(math.ceil(rate * last / math.pi) + 1) * math.pi
        crossings = np.sort(np.append(halves + rise, halves + math.pi - rise)) / rate
        edges = [*crossings[crossings < last].tolist(), last]
    now = 0.0
    while now <= last:
        if spin == 0.0:
            start = _next_start(now, load, bound, rate)
            if start > now:
                turns.append(_Turn(now, angle, 0.0, 0.0, 0.0, 0.0, rate))
                now = start
                continue
        sign = math.copysign(1.0, spin if spin != 0.0 else load * math.sin(rate * now))
        turn = _Turn(now, angle, spin, load, sign * bound, damping, rate)
        turns.append(turn)
        if bound == 0.0:
            break
        before, rests, stop = now, spin == 0.0, math.inf
        for edge in edges:
            if edge <= now:
                continue
            if sign * turn.at(edge)[1] <= 0.0:
                # A turn that ends where it starts is rounding: the drive hardly passes its bound.
                stop = edge if rests and before == now else brentq(
                    lambda t, turn=turn: float(turn.at(t)[1]), before, edge, xtol=1e-15)
                break
            before = edge
        if stop < math.inf:
            angle, spin = float(turn.at(stop)[0]), 0.0
        now = stop
    return turns


def _collocate(h: float, w: complex, push: Reals, spin: Reals, bound: float,
               damping: float) -> Complexes | None:
    """Velocities at the nodes of a step `h` from `w`, or None if Newton's method fails.

    dw/dt = push - bound w/|w| - (damping + i spin) w at every node.  The first node lies
    after the start: nothing is asked for the direction of a tile that starts from rest.
    """
    weights = 0.5 * h * INTEGRALS
    n = push.size
    rounding = 1e-15 * h * (bound + float(np.max(np.abs(push))))
    if w == 0.0:
        values = weights @ (push - math.copysign(bound, push[0])) + 0j
        if np.any(values.real * push[0] <= 0.0):
            return None
    else:
        values = np.full(n, w)
    matrix = np.empty((2, n, 2, n))
    for _ in range(12):
        speed = np.maximum(np.abs(values), 1e-300)
        along = values / speed
        drag = bound / speed
        rates = push - bound * along - (damping + 1j * spin) * values
        miss = w + weights @ rates - values
        cos, sin = along.real, along.imag
        matrix[0, :, 0] = weights * (drag * sin * sin + damping)
        matrix[0, :, 1] = weights * (-drag * sin * cos - spin)
        matrix[1, :, 0] = weights * (-drag * sin * cos + spin)
        matrix[1, :, 1] = weights * (drag * cos * cos + damping)
        system = matrix.reshape(2 * n, 2 * n)
        system.flat[:: 2 * n + 1] += 1.0
        change = np.linalg.solve(system, np.append(miss.real, miss.imag))
        step = change[:n] + 1j * change[n:]
        values = values + step
        if not np.all(np.isfinite(values)):
            return None
        if np.all(np.abs(step) <= 1e-8 * np.abs(values) + rounding):  # the next would be 1e-16
            return values
    return None


def driven_tile(times: ArrayLike, *, mass: float, inertia: float, force: float, torque: float,
                frequency: float, friction_force: float, friction_torque: float,
                linear_damping: float = 0.0, angular_damping: float = 0.0,
                forward: float = 0.5 * math.pi, family: int = 1,
                start: Sequence[float] = (0.0,) * 6) -> NDArray[np.float64]:
    """A tile under the unicycle drive, on a floor with separate friction bounds.

    The force is u(t) a F_mag along the heading angle + `forward` and the torque u(t) a T_mag,
    u = sin(2 pi f t), a = `family`.  Sliding and turning stick and slip by themselves: each
    starts where the drive exceeds its bound and ends where the velocity has come to rest, and
    starts again at once where the drive exceeds its bound there.

    Turning does not depend on sliding and has a closed form.  Sliding is solved in the frame of
    the heading, where a fast spin is no oscillation, v = w e^(i (angle + forward)),

        dw/dt = a u F_mag/m - (F_floor/m) w/|w| - (c + i omega) w,

    by Radau IIA collocation of order 27.  It is implicit: the direction of a slow tile follows
    the force at the rate F_mag/(m |w|), which has no upper limit near rest.  Steps end where the
    turning starts or stops, and shrink geometrically towards a stop.

    Parameters
    ----------
    times : array_like, shape (k,)
        s, increasing, from 0.
    mass, inertia : float
        kg, kg m^2.
    force, torque, frequency : float
        F_mag (N), T_mag (N m), of either sign; f (Hz), at 0 of which nothing is driven.
    friction_force, friction_torque : float
        Bounds of the floor's friction (N, N m).
    linear_damping, angular_damping : float
        1/s.
    forward : float
        From the tile's +x to the edge that the drive pushes towards (rad).
    family : int
        +1 or -1.
    start : sequence of 6 floats
        x, y, angle, vx, vy, omega at time 0.

    Returns
    -------
    ndarray, shape (k, 6)
        x, y, angle, vx, vy, omega at `times`, to about 1e-11 of the largest of each; a
        fast spin adds the rounding of its angle, 2e-16 of its largest (rad), to the directions.

    Raises
    ------
    ValueError
        Times that do not increase from 0; a mass or inertia that is not positive, a frequency,
        friction or damping below 0, or what is not finite.
    RuntimeError
        No step of the integrator is short enough.
    """
    instants = increasing(times)
    demand({"mass": mass, "inertia": inertia},
           at_least_0={"frequency": frequency, "friction_force": friction_force,
                       "friction_torque": friction_torque, "linear_damping": linear_damping,
                       "angular_damping": angular_damping},
           finite={"force": force, "torque": torque, "forward": forward, "family": family})
    if np.shape(start) != (6,) or not np.isfinite(start).all():
        raise ValueError(f"start must be six finite numbers, not {start}")
    last = float(instants[-1]) if instants.size else 0.0
    rate = 2.0 * math.pi * frequency
    load, bound = family * force / mass, friction_force / mass
    turns = _turns(last, start[2], start[5], family * torque / inertia, friction_torque / inertia,
                   rate, angular_damping)

    def heading(turn: _Turn, t: ArrayLike) -> Complexes:
        return np.asarray(np.exp(1j * (turn.at(t)[0] + forward)))

    def way(turn: _Turn, coefficients: Complexes, begin: float, h: float, end: float) -> complex:
        """Integral of the velocity of the step of length `h` from `begin` to `end`."""
        fastest = np.max(np.abs(turn.at(np.linspace(begin, end, 5))[1]))
        panels = 1 + int(fastest * (end - begin) / 5.0)
        size = (end - begin) / panels
        s = (np.arange(panels)[:, None] + 0.5 * (GAUSS[0] + 1.0)) * size
        velocity = legendre.legval(2.0 * s / h - 1.0, coefficients) * heading(turn, begin + s)
        return complex(0.5 * size * np.sum(velocity @ GAUSS[1]))

    result = np.empty((instants.size, 6))
    done, k, now, h = 0, 0, 0.0, FIRST

    def note(turn: _Turn, t: float, place: complex, velocity: complex) -> None:
        angle, spin = turn.at(t)
        result[done] = place.real, place.imag, angle, velocity.real, velocity.imag, spin

    z = complex(start[0], start[1])
    w = complex(start[3], start[4]) / complex(heading(turns[0], 0.0))
    while done < instants.size:
        while k + 1 < len(turns) and turns[k + 1].start <= now:
            k += 1
        turn = turns[k]
        border = turns[k + 1].start if k + 1 < len(turns) else math.inf
        if w == 0.0:
            begin = _next_start(now, load, bound, rate)
            if begin > now:
                now = min(begin, border)
                while done < instants.size and instants[done] <= now:
                    note(turn, instants[done], z, 0j)
                    done += 1
                continue
        if instants[done] <= now:
            note(turn, now, z, w * complex(heading(turn, now)))
            done += 1
            continue

        # One step, short of the stop (a singular point) and of where the turning changes.
        if w != 0.0 and bound > 0.0:
            slowing = (bound + linear_damping * abs(w)
                       - math.sin(rate * now) * load * w.real / abs(w))
            togo = abs(w) / slowing if slowing > 0.0 else math.inf
            if togo < REST * max(1.0, now):
                now, w, h = now + togo, 0j, FIRST
                continue
            h = min(h, 0.7 * togo)
        # Rounding of the acceleration, that of the time in the drive included.
        noise = 1e-15 * (abs(load) + bound) * (1.0 + rate * now)
        while True:
            h = min(h, border - now, last - now)
            if now + h <= now:
                raise RuntimeError(f"no step is short enough at t = {now} s")
            t = now + 0.5 * h * (NODES + 1.0)
            values = _collocate(h, w, load * np.sin(rate * t), turn.at(t)[1], bound,
                                linear_damping)
            if values is None:
                h *= 0.3
                continue
            coefficients = FIT @ np.append(w, values)
            allowed = TOLERANCE * float(np.max(np.abs(values))) + noise * h + 1e-300
            error = float(np.sum(np.abs(coefficients[-2:]))) / allowed
            if error <= 1.0:
                break
            h *= max(0.2, 0.8 * error ** (-1.0 / STAGES))
        end = border if h == border - now else last if h == last - now else now + h
        while done < instants.size and instants[done] <= end:
            time = float(instants[done])
            velocity = complex(legendre.legval(2.0 * (time - now) / h - 1.0, coefficients))
            note(turn, time, z + way(turn, coefficients, now, h, time),
                 velocity * complex(heading(turn, time)))
            done += 1
        z += way(turn, coefficients, now, h, end)
        now, w = end, complex(values[-1])
        h *= min(3.0, 0.8 * max(error, 1e-30) ** (-1.0 / STAGES))
    return result
