"""Motion of one tile without contacts, and a head-on impact: closed forms and a reference.

Floor friction here has separate bounds for force and torque; damping is dv/dt = -c v.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

State = NDArray[np.float64]  # x, y, angle, vx, vy, omega

# Slower than this (m/s) a sliding tile has stopped.
REST = 1e-12


def _stop(v0: float, deceleration: float, damping: float) -> tuple[float, float]:
    """Time and distance of dv/dt = -a - c v from v0 >= 0 to rest, stable for every c v0/a.

    With x = c v0/a: t = (v0/a) ln(1 + x)/x and d = (v0^2/a)(x - ln(1 + x))/x^2.
    """
    x = damping * v0 / deceleration
    time = math.log1p(x) / x if x > 0.0 else 1.0
    if x > 0.05:
        distance = (x - math.log1p(x)) / (x * x)
    else:
        distance = sum((-x) ** k / (k + 2) for k in range(14))
    return time * v0 / deceleration, distance * v0 * v0 / deceleration


def sliding_stop(v0: float, mu: float, damping: float = 0.0,
                 gravity: float = 9.81) -> tuple[float, float]:
    """Time and distance until friction and damping stop a tile that slides at `v0` >= 0.

    m dv/dt = -mu m g - c m v gives

        t = ln(1 + c v0/(mu g))/c,    d = v0/c - (mu g/c^2) ln(1 + c v0/(mu g)),

    and, for c -> 0, t = v0/(mu g), d = v0^2/(2 mu g).
    """
    return _stop(v0, mu * gravity, damping)


def spin_stop(omega0: float, torque: float, inertia: float,
              damping: float = 0.0) -> tuple[float, float]:
    """Time and angle until a friction torque and damping stop a tile that spins at `omega0` >= 0.

    I domega/dt = -T - c I omega gives

        t = ln(1 + c I omega0/T)/c,    angle = omega0/c - (T/(I c^2)) ln(1 + c I omega0/T),

    and, for c -> 0, t = I omega0/T, angle = I omega0^2/(2 T).
    """
    return _stop(omega0, torque / inertia, damping)


def head_on(mass_a: float, va: float, mass_b: float, vb: float, e: float) -> tuple[float, float]:
    """Velocities after a head-on impact of two bodies on a line.

    Momentum is kept and the relative velocity turns into -e times itself:

        va' = va + (1 + e) m_b/(m_a + m_b) (vb - va),
        vb' = vb - (1 + e) m_a/(m_a + m_b) (vb - va).
    """
    change = (1.0 + e) * (vb - va) / (mass_a + mass_b)
    return va + mass_b * change, vb - mass_a * change


def driven_tile(times: ArrayLike, *, mass: float, inertia: float, force: float, torque: float,
                frequency: float, friction_force: float, friction_torque: float,
                linear_damping: float = 0.0, angular_damping: float = 0.0,
                forward: float = 0.5 * math.pi, family: int = 1,
                start: Sequence[float] = (0.0,) * 6) -> NDArray[np.float64]:
    """A tile under the unicycle drive, on a floor with separate friction bounds.

    The force is u(t) a F_mag along the heading angle + `forward` and the torque u(t) a T_mag,
    u = sin(2 pi f t), a = `family`.  Sliding and turning stick and slip by themselves: each
    starts where the drive exceeds its bound and ends where the velocity has come to rest.  The
    integration stops at every such event.

    Parameters
    ----------
    times : array_like, shape (k,)
        s, increasing, from 0.
    mass, inertia : float
        kg, kg m^2.
    force, torque, frequency : float
        F_mag (N), T_mag (N m), f (Hz).
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
        x, y, angle, vx, vy, omega at `times`, to about 1e-10 of the largest of each.

    Raises
    ------
    RuntimeError
        The integrator failed.
    """
    times = np.asarray(times, dtype=np.float64)
    state = np.array(start, dtype=np.float64)
    turn_rate = 2.0 * math.pi * frequency

    def drive(t: float) -> float:
        return family * math.sin(turn_rate * t)

    def heading(angle: float) -> tuple[float, float]:
        return math.cos(angle + forward), math.sin(angle + forward)

    def excess(t: float, load: float, bound: float) -> float:
        return abs(drive(t)) * load - bound if load > bound else -1.0

    def slides_at(t: float, state: State) -> bool:
        moving = math.hypot(state[3], state[4]) > REST
        return moving or excess(t, force, friction_force) > 0.0

    def turns_at(t: float, state: State) -> bool:
        return state[5] != 0.0 or excess(t, torque, friction_torque) > 0.0

    now, slides, turns = 0.0, slides_at(0.0, state), turns_at(0.0, state)
    result = np.empty((times.size, 6))
    done = 0
    while done < times.size:
        push = drive(now)
        if slides and math.hypot(state[3], state[4]) <= REST:
            # Sliding starts along the force; its direction needs some velocity.
            c, s = heading(state[2])
            sign = math.copysign(2.0 * REST, push * force)
            state[3], state[4] = sign * c, sign * s
        spin = math.copysign(1.0, state[5] if state[5] != 0.0 else push * torque)

        def rates(t: float, y: State, slides: bool = slides, turns: bool = turns,
                  spin: float = spin) -> list[float]:
            u = drive(t)
            ax = ay = alpha = 0.0
            if slides:
                c, s = heading(y[2])
                drag = friction_force / (mass * max(math.hypot(y[3], y[4]), 0.5 * REST))
                drag += linear_damping
                ax, ay = u * force * c / mass - drag * y[3], u * force * s / mass - drag * y[4]
            if turns:
                alpha = (u * torque - spin * friction_torque) / inertia - angular_damping * y[5]
            return [y[3], y[4], y[5], ax, ay, alpha]

        def linear(t: float, y: State, slides: bool = slides) -> float:
            if slides:
                return REST - math.hypot(y[3], y[4])
            return excess(t, force, friction_force)

        def angular(t: float, y: State, turns: bool = turns, spin: float = spin) -> float:
            return -spin * y[5] if turns else excess(t, torque, friction_torque)

        events: list[Callable[[float, State], float]] = [linear, angular]
        for event in events:
            event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        # Short legs, so that no pair of events hides within one step of the integrator.
        leg = now + (0.05 / frequency if frequency > 0.0 else max(times[-1] - now, 1.0))
        solution = solve_ivp(rates, (now, leg), state, method="LSODA", events=events,
                             rtol=1e-12, atol=1e-15, dense_output=True)
        if not solution.success:
            raise RuntimeError(solution.message)
        end = solution.t[-1]
        while done < times.size and times[done] <= end:
            result[done] = solution.sol(times[done]) if times[done] > now else state
            done += 1
        now, state = end, solution.y[:, -1].copy()
        if solution.t_events[0].size:
            if slides:
                state[3] = state[4] = 0.0
                slides = slides_at(now, state)
            else:
                slides = True
        if solution.t_events[1].size:
            if turns:
                state[5] = 0.0
                turns = turns_at(now, state)
            else:
                turns = True
    return result
