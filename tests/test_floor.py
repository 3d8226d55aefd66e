"""Floor friction: the kernels against the limit sets they stand for."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import simulate, tile
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from twins import ellipsoid_impulse

from tbsa.kernels.floor import (
    COUPLED,
    EXACT,
    SEPARATE,
    STEPS,
    TORQUE,
    _normal,
    floor_impulse,
    friction_of,
    impulse_of_turn,
    interval,
    square_friction,
    turns,
)
from tbsa.model.scene import Floor
from theory import floor as truth

MASS, WIDTH, MU, STEP = 0.016, 0.03, 0.25, 1 / 480
INERTIA = MASS * WIDTH**2 / 6.0
FORCE = truth.max_force(MU, MASS)
MOMENT = truth.max_torque(MU, MASS, WIDTH)
R, Q = FORCE * STEP, MOMENT * STEP
M = np.array([MASS, MASS, INERTIA])
SCALE = np.array([R, R, R * WIDTH])
LAWS = (SEPARATE, COUPLED, EXACT)

quick = settings(deadline=None, max_examples=200)
unit = st.floats(-1.0, 1.0).map(lambda x: round(x, 6))
twists = st.tuples(unit, unit, unit, st.floats(-4.0, 1.0), st.floats(-2.0, 3.0)).map(
    lambda t: np.array([t[0] * 10 ** t[3], t[1] * 10 ** t[3], t[2] * 10 ** t[4]]))
angles = st.floats(-4.0, 4.0)


def impulse(law, start, trial, angle=0.0, m=MASS, inertia=INERTIA, r=R, q=Q):
    return np.array(floor_impulse(law, *map(float, start), *map(float, trial), m, inertia, r, q,
                                  math.cos(angle), math.sin(angle))[:3])


def turned(vector, angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


def surface(law, twist, angle=0.0, r=R, q=Q):
    """The impulse on the limit surface that opposes a twist; independent of the kernels."""
    if law == SEPARATE:
        speed = math.hypot(twist[0], twist[1])
        linear = [-r * twist[0] / speed, -r * twist[1] / speed] if speed > 0.0 else [0.0, 0.0]
        return np.array([*linear, -q * np.sign(twist[2])])
    if law == COUPLED:
        fx, fy, torque = truth.ellipsoid_wrench(*twist, q / (r * truth.MEAN_DISTANCE))
    else:
        body = turned(twist, -angle)
        fx, fy, torque = turned(truth.wrench(*body, q / (r * truth.MEAN_DISTANCE)), angle)
    return r * np.array([fx, fy, torque])


# The limits of the law.


def test_bounds_of_force_and_torque():
    assert pytest.approx(0.382598, abs=5e-7) == truth.MEAN_DISTANCE
    assert pytest.approx(truth.MEAN_DISTANCE, rel=1e-15) == TORQUE
    assert pytest.approx(0.03924) == FORCE
    assert pytest.approx(4.50e-4, rel=1e-3) == MOMENT
    assert truth.engine_torque(MU, MASS, WIDTH) == pytest.approx(6.80e-4, rel=1e-3)
    engine = MU * MASS * 9.81 * math.sqrt(2.0 * INERTIA / MASS)
    assert truth.engine_torque(MU, MASS, WIDTH) == pytest.approx(engine)


def test_mean_distance_is_the_integral_of_the_distance_over_the_unit_square():
    x, g = np.polynomial.legendre.leggauss(200)
    quarter = np.hypot(*np.meshgrid(0.25 * (x + 1.0), 0.25 * (x + 1.0)))
    assert pytest.approx(0.25 * g @ quarter @ g, rel=1e-6) == truth.MEAN_DISTANCE


@pytest.mark.parametrize("wrench", [truth.wrench, truth.ellipsoid_wrench])
def test_pure_sliding_and_pure_turning(wrench):
    assert wrench(0.2, 0.0, 0.0, WIDTH) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    turning = (0.0, 0.0, truth.MEAN_DISTANCE * WIDTH)
    assert wrench(0.0, 0.0, -3.0, WIDTH) == pytest.approx(turning, abs=1e-9)
    with pytest.raises(ValueError, match="at rest"):
        wrench(0.0, 0.0, 0.0, WIDTH)


def test_closed_form_of_the_exact_law_is_the_quadrature():
    rng = np.random.default_rng(1)
    spread = [rng.normal(size=3) * 10 ** rng.uniform(-3, 1, 3) for _ in range(150)]
    inside = [np.array([*rng.uniform(-0.6, 0.6, 2), s]) for s in (1.0, -1.0) for _ in range(50)]
    edges = [np.array(v) for v in ((0.5, 0.5, 1.0), (0.5, 0.0, 1.0), (-0.5, 0.2, -1.0),
                                   (0.0, 0.0, 1.0), (1.0, 0.3, 0.0), (0.0, 0.5, 1.0))]
    for v in spread + inside + edges:
        closed = -np.array(square_friction(*v)[1:4])
        assert closed == pytest.approx(truth.wrench(*v, 1.0), abs=5e-9)


@given(twists)
@quick
def test_exact_law_has_the_derivatives_it_says(v):
    v = v * np.array([1.0, 1.0, WIDTH])
    if np.linalg.norm(v) == 0.0:
        return
    v = v / np.linalg.norm(v)
    if math.hypot(v[0], v[1]) > 20.0 * abs(v[2]) or abs(v[2]) < 0.02:
        v[2] += 0.1
    h, *rest = square_friction(*v)
    gradient, second = np.array(rest[:3]), np.array(rest[3:])[[0, 1, 3, 1, 2, 4, 3, 4, 5]]
    d = 1e-5
    ahead = np.array([square_friction(*(v + d * k)) for k in np.eye(3)])
    back = np.array([square_friction(*(v - d * k)) for k in np.eye(3)])
    assert gradient @ v == pytest.approx(h, rel=1e-12)
    assert gradient == pytest.approx((ahead[:, 0] - back[:, 0]) / (2 * d), abs=1e-8)
    # the second derivatives have a logarithmic kink where the tile turns about its own rim
    numeric = (ahead[:, 1:4] - back[:, 1:4]) / (2 * d)
    assert second.reshape(3, 3) == pytest.approx(numeric, abs=2e-3)
    assert np.linalg.eigvalsh(second.reshape(3, 3)).min() > -1e-9


def test_ellipsoid_is_near_the_exact_law():
    """Greatest distances: limit surface 7 %, force 0.13 F_max, torque 0.17 T_max."""
    surface_gap, force_gap, torque_gap = [], [], []
    for heading in np.linspace(0.0, math.pi / 4, 10):
        for ratio in np.linspace(0.02, math.pi / 2, 40):
            twist = (math.cos(ratio) * math.cos(heading), math.cos(ratio) * math.sin(heading),
                     2.0 * math.sin(ratio))
            f = np.array(truth.wrench(*twist, 1.0))
            e = np.array(truth.ellipsoid_wrench(*twist, 1.0))
            surface_gap.append(1.0 - math.hypot(f[0], f[1], f[2] / truth.MEAN_DISTANCE))
            force_gap.append(math.hypot(f[0] - e[0], f[1] - e[1]))
            torque_gap.append(abs(f[2] - e[2]) / truth.MEAN_DISTANCE)
    assert 0.06 < max(surface_gap) <= 0.07
    assert min(surface_gap) > -1e-9  # the exact set lies inside the ellipsoid
    assert 0.11 < max(force_gap) <= 0.13
    assert 0.15 < max(torque_gap) <= 0.17


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, math.pi / 2.0))
@settings(deadline=None, max_examples=8)
def test_the_share_of_a_load_is_the_most_that_any_twist_makes_of_it(across, twist, mix):
    """Against all twists, in closed form; other directions lie between these two."""
    def most(angle):
        load = np.array([force * math.cos(angle), force * math.sin(angle), torque])

        def ratio(n):
            return -(n @ load) / square_friction(*n)[0]

        return -minimize(ratio, load / [1.0, 1.0, TORQUE**2], method="Nelder-Mead",
                         options={"xatol": 1e-8, "fatol": 1e-12}).fun

    force, torque = math.cos(mix), TORQUE * math.sin(mix)
    low, high = (truth.share(force, torque, angle) for angle in (0.0, math.pi / 4.0))
    assert low == pytest.approx(most(0.0), rel=1e-7)
    assert high == pytest.approx(most(math.pi / 4.0), rel=1e-7)
    assert low - 1e-7 <= most(across * math.pi / 4.0) <= high + 1e-7
    assert 1.0 - 1e-9 <= low <= high + 1e-9 <= 1.0 / 0.9337 + 1e-9
    assert truth.share(-force, -torque, 0.0) == low
    twisted = math.cos(twist), 0.0, math.sin(twist) / TORQUE
    on = truth.wrench(*twisted, 1.0)  # what friction can give, and no more
    assert truth.share(on[0], on[2], 0.0) == pytest.approx(1.0, abs=1e-8)


# Stopping.


@pytest.mark.parametrize("law", LAWS)
@given(direction=twists, start=twists, angle=angles, part=st.floats(0.0, 0.9999))
@quick
def test_a_tile_inside_its_limit_set_stops_exactly(law, direction, start, angle, part):
    if not np.any(direction):
        direction = np.array([1.0, 0.0, 0.0])
    trial = -part * surface(law, direction, angle) / M
    if law == SEPARATE:  # other torques within the bound: see the next test
        start = start.copy()
        start[2] = np.clip(start[2], trial[2] - 0.999 * Q / INERTIA, trial[2] + 0.999 * Q / INERTIA)
    p = impulse(law, start, trial, angle)
    assert tuple(p) == (-MASS * trial[0], -MASS * trial[1], -INERTIA * trial[2])


def spin_by_events(w, given, bound):
    """Spin after a substep with the impulse `given` of other torques and friction of `bound`."""
    left = 1.0
    while left > 0.0:
        if w == 0.0 and abs(given) <= bound:
            return 0.0
        way = math.copysign(1.0, given if w == 0.0 else w)
        rate = (given - way * bound) / INERTIA
        until = -w / rate if w * rate < 0.0 else math.inf
        if until >= left:
            return w + rate * left
        w, left = 0.0, left - until
    return w


@given(start=st.floats(-30.0, 30.0), given=st.floats(-6.0, 6.0))
@quick
def test_a_spin_slides_stops_and_reverses_as_its_equation_of_motion_says(start, given):
    """Separate bounds, a constant torque of `given` times the bound."""
    w = start * Q / INERTIA
    p = impulse(SEPARATE, (0.0, 0.0, w), (0.0, 0.0, w + given * Q / INERTIA))
    end = spin_by_events(w, given * Q, Q)
    assert w + (given * Q + p[2]) / INERTIA == pytest.approx(end, abs=1e-12 * 40 * Q / INERTIA)


@pytest.mark.parametrize("law", LAWS)
@given(direction=twists, angle=angles)
@quick
def test_a_tile_just_outside_its_limit_set_slides_on(law, direction, angle):
    if not np.any(direction):
        direction = np.array([1.0, 0.0, 0.0])
    trial = -1.0001 * surface(law, direction, angle) / M
    end = trial + impulse(law, trial, trial, angle) / M
    assert np.any(np.abs(end) * M > 1e-5 * SCALE)


def test_sliding_and_turning_stop_apart_under_separate_bounds():
    slow, fast = 0.5 * R / MASS, 3.0 * Q / INERTIA
    p = impulse(SEPARATE, (slow, 0.0, fast), (slow, 0.0, fast))
    assert tuple(p) == (-MASS * slow, 0.0, -Q)
    slow, fast = 0.5 * Q / INERTIA, 3.0 * R / MASS
    p = impulse(SEPARATE, (0.0, -fast, slow), (0.0, -fast, slow))
    assert tuple(p) == (0.0, R, -INERTIA * slow)


@pytest.mark.parametrize("law", [COUPLED, EXACT])
def test_a_sliding_tile_is_easy_to_turn(law):
    v, w = 20.0 * R / MASS, 0.5 * Q / INERTIA
    held = impulse(law, (0.0, 0.0, w), (0.0, 0.0, w))
    sliding = impulse(law, (v, 0.0, w), (v, 0.0, w))
    assert abs(sliding[2]) < 0.3 * abs(held[2])


@given(start=twists, trial=twists, size=st.floats(-3.0, 1.0), load=st.floats(-4.0, 2.0))
@quick
def test_four_steps_lead_to_the_impulse_of_the_coupled_law(start, trial, size, load):
    width, r = WIDTH * 10**size, R * 10**load
    inertia, q = MASS * width**2 / 6.0, TORQUE * r * width
    p = impulse(COUPLED, start, trial, 0.0, MASS, inertia, r, q)
    known = ellipsoid_impulse(start, trial, MASS, inertia, r, q)
    assert np.all(np.abs(p - known) <= 1e-13 * np.array([r, r, q]))


# Sliding: the impulse of maximum dissipation for the mean twist.


@pytest.mark.parametrize("law", LAWS)
@given(start=twists, trial=twists, angle=angles)
@quick
def test_impulse_is_the_law_at_the_mean_twist(law, start, trial, angle):
    p = impulse(law, start, trial, angle)
    if np.array_equal(p, -M * trial):
        return
    mean = start + trial + p / M
    scale = np.abs(start) + np.abs(trial) + SCALE / M
    if law == SEPARATE:  # the spin: see above
        linear = np.array_equal(p[:2], -M[:2] * trial[:2])
        if not linear and np.linalg.norm(mean[:2]) > 1e-9 * scale[0]:
            assert p[:2] == pytest.approx(surface(law, mean)[:2], abs=1e-6 * R)
        return
    if np.all(np.abs(mean) <= 1e-9 * scale):
        return  # no mean motion: anything inside the set; see the test below
    largest = max(np.abs(mean) * np.array([1.0, 1.0, WIDTH]))
    # The direction of a small mean twist is known only as well as it is told from rounding.
    loose = 1e-7 + 1e-8 * max(np.abs(start) * [1, 1, WIDTH] + np.abs(trial) * [1, 1, WIDTH]
                              + R / MASS) / largest
    assert np.abs(p - surface(law, mean, angle)) / SCALE == pytest.approx(0.0, abs=loose)


@pytest.mark.parametrize("law", LAWS)
@given(start=twists, trial=twists, angle=angles)
@quick
def test_impulse_never_leaves_the_limit_set(law, start, trial, angle):
    p = impulse(law, start, trial, angle)
    for probe in (start + trial, -p / M, np.array([1.0, 0.3, 20.0])):
        if np.any(probe):  # no impulse of the set opposes the probe more
            assert p @ probe >= surface(law, probe, angle) @ probe * (1.0 + 1e-8) - 1e-25


@pytest.mark.parametrize("law", LAWS)
@given(start=twists, trial=twists, angle=angles)
@quick
def test_a_sliding_tile_is_never_pushed_on_by_its_friction(law, start, trial, angle):
    p = impulse(law, start, trial, angle)
    end = trial + p / M
    slides = (p != -M * trial) if law == SEPARATE else np.full(3, np.any(p != -M * trial))
    linear, angular = slides[0] or slides[1], slides[2]
    if law == SEPARATE:  # one that turns round is slowed, then slowed again
        angular = angular and start[2] * end[2] >= 0.0
    part = np.array([linear, linear, angular])
    work = p * (start + end) * part
    room = 1e-12 * np.abs(p) @ (np.abs(start) + np.abs(trial) + np.abs(p) / M)
    assert work.sum() <= room


@pytest.mark.parametrize("law", LAWS)
def test_a_twist_that_reverses_within_the_bounds_has_no_mean_and_keeps_its_size(law):
    trial = np.array([2.0 * R / MASS, 0.0, 2.0 * Q / INERTIA])
    start = -0.9 * trial
    p = impulse(law, start, trial, 0.3)
    of = slice(2) if law == SEPARATE else slice(3)
    assert p[of] == pytest.approx(-(M * (start + trial))[of], rel=1e-12)
    assert (trial + p / M)[of] == pytest.approx(-start[of], rel=1e-12)


def sliding_cases(count):
    rng = np.random.default_rng(3)
    size = np.array([R / MASS, R / MASS, Q / INERTIA])
    for _ in range(count):
        trial = rng.normal(size=3)
        trial *= rng.uniform(1.5, 4.0) / np.linalg.norm(trial) * size
        yield trial + 0.3 * rng.normal(size=3) * size, trial


def test_coupled_impulse_is_the_projection_that_a_general_minimiser_finds():
    bound = np.array([R, R, Q])
    for start, trial in sliding_cases(20):
        b = M * (start + trial) / bound  # in units of the bounds, the set is the unit ball
        metric = bound**2 / M
        metric = metric / metric.max()
        best = minimize(lambda q, b=b, g=metric: 0.5 * (q + b) @ (g * (q + b)),
                        -b / np.linalg.norm(b), jac=lambda q, b=b, g=metric: g * (q + b),
                        constraints={"type": "ineq", "fun": lambda q: 1.0 - q @ q},
                        method="SLSQP", options={"ftol": 1e-14, "maxiter": 500})
        p = impulse(COUPLED, start, trial) / bound
        assert np.linalg.norm(p) == pytest.approx(1.0, abs=1e-13)
        assert p == pytest.approx(best.x, abs=2e-5)


def test_exact_impulse_is_the_minimum_of_the_dual_problem():
    """M (u - s), where u minimises 1/2 (u - s) M (u - s) + H(u), H by quadrature."""
    angle = 0.7
    for start, trial in sliding_cases(4):
        s = turned(start + trial, -angle) * np.array([1.0, 1.0, WIDTH]) * MASS / R
        g = np.array([1.0, 1.0, 1.0 / 6.0])

        def dual(u, s=s, g=g):
            f = np.array(truth.wrench(*u, 1.0))
            return 0.5 * (u - s) @ (g * (u - s)) - f @ u, g * (u - s) - f

        best = minimize(dual, s, jac=True, method="BFGS", options={"gtol": 1e-9})
        p = turned(impulse(EXACT, start, trial, angle), -angle) / SCALE
        assert p == pytest.approx(g * (best.x - s), abs=1e-7)


def test_exact_law_converges_inside_outside_and_at_the_edge_of_its_set():
    rng = np.random.default_rng(4)
    needed = []
    for far in (-0.06, -1e-6, -1e-8, 1e-8, 1e-6, 1e-2, 1.0, 100.0):
        for _ in range(60):
            twist = rng.normal(size=3) * 10.0 ** rng.uniform(-2, 2, 3)
            b = (1.0 + far) * np.array(square_friction(*twist)[1:4])
            m, inertia = 1.0, TORQUE**2
            if far > 0.0:
                m, inertia = 10.0 ** rng.uniform(-2, 2, 2)
            k, *p, steps = _normal(*b, m, inertia, b[0], b[1], b[2] / TORQUE**2, False)
            assert (k > 0.0) == (far > 0.0)
            needed.append(steps)
            if far > 0.0:  # the nearest point is no farther than where b comes from
                scale = np.sqrt(1.0 / np.array([m, m, inertia]))
                gap, size = np.linalg.norm((b - p) * scale), np.linalg.norm(b * scale)
                assert gap <= size * (far / (1.0 + far) + 1e-8)
    assert max(needed) <= STEPS
    assert np.median(needed) <= 6


@given(radii=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
       masses=st.tuples(st.floats(-6, 6), st.floats(-6, 6)),
       start=twists, trial=twists, law=st.sampled_from((SEPARATE, COUPLED)))
@settings(deadline=None, max_examples=500)
def test_every_magnitude_is_solved_to_rounding(radii, masses, start, trial, law):
    (r, q), (m, inertia) = (10.0**k for k in radii), (10.0**k for k in masses)
    q = q if law == SEPARATE else TORQUE * r * math.sqrt(6.0 * inertia / m)  # a square's
    p = impulse(law, start, trial, 0.0, m, inertia, r, q)
    mass = np.array([m, m, inertia])
    linear, angular = math.hypot(p[0], p[1]) / r, abs(p[2]) / q
    assert (max(linear, angular) if law == SEPARATE else math.hypot(linear, angular)) <= 1 + 1e-12
    if law == COUPLED and np.any(p != -mass * trial) and np.any(p != -mass * (start + trial)):
        assert math.hypot(linear, angular) == pytest.approx(1.0, abs=1e-12)
        # p and the twist it opposes, along the normal of the ellipsoid
        twist = start + trial + p / mass
        noise = 1e-11 * (np.abs(start) + np.abs(trial) + np.abs(p) / mass)
        normal = -p / np.array([r * r, r * r, q * q])
        k = (twist @ p) / (normal @ p)
        slack = np.max(noise * np.abs(p)) / abs(normal @ p)
        assert np.all(np.abs(twist - k * normal) <= noise + slack * np.abs(normal))


@pytest.mark.parametrize(("r", "q"), [(0.0, Q), (R, 0.0), (0.0, 0.0)])
def test_a_bound_of_zero_leaves_the_other_alone(r, q):
    trial = np.array([3.0 * R / MASS, 0.0, 3.0 * Q / INERTIA])
    p = impulse(SEPARATE, trial, trial, 0.0, r=r, q=q)
    assert p == pytest.approx((-r, 0.0, -q), rel=1e-14, abs=0.0)
    assert tuple(impulse(SEPARATE, np.zeros(3), np.zeros(3), 0.0, r=r, q=q)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("floor", [
    Floor("separate", linear=0.0, angular=0.0), Floor("coupled", linear=0.0),
    Floor("exact", linear=0.0)], ids=lambda floor: floor.law)
def test_a_floor_without_friction_is_none(floor):
    s = simulate([tile(vx=0.2, spin=3.0)], floor=floor)
    s.run(1.0)
    assert (s.vx[0], s.omega[0]) == (0.2, 3.0)


@pytest.mark.parametrize(("law", "turn"), [(SEPARATE, 0.83), (COUPLED, 0.83), (EXACT, 0.83)])
@given(start=twists, trial=twists, angle=angles)
@quick
def test_turning_everything_turns_the_impulse(law, turn, start, trial, angle):
    p = impulse(law, start, trial, angle)
    q = impulse(law, turned(start, turn), turned(trial, turn), angle + turn)
    size = SCALE + np.abs(M * (start + trial)) * 1e-3
    assert turned(p, turn) / size == pytest.approx(q / size, abs=1e-5)


@given(start=twists, trial=twists, angle=angles)
@quick
def test_the_exact_law_has_the_symmetry_of_the_square(start, trial, angle):
    p = impulse(EXACT, start, trial, angle)
    quarter = impulse(EXACT, start, trial, angle + 0.5 * math.pi)
    mirror = np.array([1.0, -1.0, -1.0])
    mirrored = mirror * impulse(EXACT, mirror * start, mirror * trial, -angle)
    assert quarter / SCALE == pytest.approx(p / SCALE, abs=1e-5)
    assert mirrored / SCALE == pytest.approx(p / SCALE, abs=1e-5)


# Sliding in time.


def slide(law, twist, angle, time, count):
    h = time / count
    for _ in range(count):
        angle += 0.5 * h * twist[2]
        twist = twist + impulse(law, twist, twist, angle, r=FORCE * h, q=MOMENT * h) / M
        angle += 0.5 * h * twist[2]
    return np.array([*twist, angle])


@pytest.mark.parametrize(("law", "wrench"),
                         [(COUPLED, truth.ellipsoid_wrench), (EXACT, truth.wrench)])
def test_free_sliding_is_of_second_order_in_the_step(law, wrench):
    start, time = np.array([0.3, 0.1, 25.0]), 0.08

    def rates(t, y):
        f = turned(np.array(wrench(*turned(y[:3], -y[3]), WIDTH)), y[3])
        return [*(FORCE * f / M), y[2]]

    end = solve_ivp(rates, (0.0, time), [*start, 0.2], rtol=1e-9, atol=1e-11).y[:, -1]
    assert math.hypot(end[0], end[1]) > 0.05  # still sliding
    coarse, fine = (np.linalg.norm((slide(law, start, 0.2, time, n) - end) * [1, 1, 0.03, 0.03])
                    for n in (8, 16))
    assert coarse > 1e-6
    assert 1.8 < math.log2(coarse / fine) < 2.2


@pytest.mark.parametrize("law", [COUPLED, EXACT])
def test_a_tile_that_slides_and_turns_stops_doing_both_at_once(law):
    twist, h = np.array([0.05, 0.0, 5.0]), 1e-4
    moving = []
    for _ in range(600):
        p = impulse(law, twist, twist, 0.0, r=FORCE * h, q=MOMENT * h)
        stopped = np.array_equal(p, -M * twist)
        twist = np.zeros(3) if stopped else twist + p / M
        moving.append((twist[0] != 0.0, twist[2] != 0.0))
    assert moving[0] == (True, True)
    assert moving[-1] == (False, False)
    assert not any(a != b for a, b in moving)


# What goes on, and what turns round.


def going_on(law, twist, angle):
    return np.array(friction_of(law, *twist, MASS, INERTIA, R, Q, math.cos(angle),
                                math.sin(angle)))


@pytest.mark.parametrize("law", LAWS)
def test_friction_of_a_tile_that_goes_on_is_that_of_a_fast_one(law):
    """The impulse at the mean twist, where that changes by a thousandth in the substep."""
    rng, unit = np.random.default_rng(5), np.array([R / MASS, R / MASS, Q / INERTIA])
    for _ in range(20):
        twist, angle = 1e3 * (1.0 + rng.random(3)) * rng.choice([-1, 1], 3) * unit, rng.normal()
        expected = impulse(law, twist, twist, angle)
        off = (going_on(law, twist, angle) - expected) / np.array([R, R, Q])
        assert np.abs(off).max() < 2e-3


@pytest.mark.parametrize("law", LAWS)
def test_friction_of_what_is_all_but_at_rest_is_in_proportion(law):
    """A direction that is made of rounding is none."""
    twist = np.array([R / MASS, -R / MASS, Q / INERTIA])
    p = going_on(law, 1e-3 * twist, 0.3)
    assert going_on(law, 1e-9 * twist, 0.3) == pytest.approx(1e-6 * p, rel=1e-9)
    assert np.abs(p / np.array([R, R, Q])).max() < 0.1
    assert not going_on(law, np.zeros(3), 0.3).any()


def turned_round(law, start, trial, angle=0.3):
    cos, sin = math.cos(angle), math.sin(angle)
    *p, stops, halts = impulse_of_turn(law, *start, *trial, MASS, INERTIA, R, Q, cos, sin)
    return np.array(p), stops, halts


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("spin", [False, True])
def test_on_a_line_a_turn_is_exact(law, spin):
    """As of the spin of a tile on separate friction, which is one-dimensional."""
    bound, m = (Q, INERTIA) if spin else (R, MASS)
    axis = np.array([0.0, 0.0, 1.0]) if spin else np.array([0.6, 0.8, 0.0])
    for v0, v in ((0.5, -2.0), (0.9, -0.2), (2.0, 0.5), (0.3, -0.8), (1.5, -7.0)):
        start, trial = v0 * bound / m * axis, v * bound / m * axis
        p, stops, halts = turned_round(law, start, trial)
        expected, rests = interval(v0 * bound / m, v * bound / m, m, bound)
        assert p @ axis == pytest.approx(expected, rel=1e-9)
        assert np.abs(p - (p @ axis) * axis)[:2].max() < 1e-9 * R
        assert (halts if spin else stops) == rests


@pytest.mark.parametrize("law", LAWS)
def test_a_turn_is_what_many_short_substeps_make_of_it(law):
    """Within a few per cent of the bound, where one mean twist for all of it is off by most."""
    rng, unit = np.random.default_rng(6), np.array([R / MASS, R / MASS, Q / INERTIA])
    for _ in range(12):
        start, load = 0.5 * rng.normal(size=3) * unit, rng.normal(size=3)
        load *= rng.uniform(2.0, 4.0) / np.linalg.norm(load) * unit
        start -= 0.2 * load
        v, n = start.copy(), 2000
        for _ in range(n):
            cos, sin = math.cos(0.3), math.sin(0.3)
            p = np.array(floor_impulse(law, *v, *(v + load / n), MASS, INERTIA, R / n, Q / n, cos,
                                       sin)[:3])
            v = v + load / n + p / M
        found = start + load + turned_round(law, start, start + load)[0] / M
        assert np.abs((found - v) / unit).max() < 0.12


@pytest.mark.parametrize("law", LAWS)
def test_what_turns_round_is_told_from_what_does_not(law):
    unit = np.array([R / MASS, R / MASS, 0.0])
    for start, trial, stopped, expected in (
            ((3.0, 0.0), (2.0, 0.0), False, False),  # slides on
            ((1.0, 0.0), (0.5, 0.0), True, False),  # stops
            ((0.0, 0.0), (0.9, 0.0), True, False),  # rests
            ((0.5, 0.0), (-0.9, 0.0), False, True),  # turns
            ((1.5, 0.0), (0.2, 0.0), True, True)):  # is pushed back by more than friction
        assert bool(turns(law, *(np.array([*start, 0.0]) * unit), *(np.array([*trial, 0.0]) * unit),
                          MASS, INERTIA, R, Q, stopped)) == expected
