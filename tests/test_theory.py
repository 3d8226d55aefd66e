"""The closed forms of theory/ against brute force, and the kernels of impact against them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from tbsa.kernels.routh import routh as kernel_routh
from theory import (
    fit,
    floor,
    impact,
    magnets,
    motion,
    permanent,
    rotation,
    scaling,
    snap,
    stability,
)

# Motion.


def brute_stop(v0, deceleration, damping, steps=200_000):
    """Time and distance of dv/dt = -a - c v by the midpoint rule over v from v0 to 0."""
    v = (np.arange(steps) + 0.5) * v0 / steps
    rate = 1.0 / (deceleration + damping * v)
    return np.sum(rate) * v0 / steps, np.sum(v * rate) * v0 / steps


@pytest.mark.parametrize("damping", [0.0, 1e-9, 0.1, 0.39, 0.41, 0.8, 50.0])
def test_sliding_stop_is_the_integral_of_the_equation_of_motion(damping):
    brute = brute_stop(0.3, 0.25 * 9.81, damping)
    assert motion.sliding_stop(0.3, 0.25, damping) == pytest.approx(brute, rel=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1e-7, 0.5, 20.0])
def test_spin_stop_is_the_integral_of_the_equation_of_motion(damping):
    brute = brute_stop(30.0, 4.5e-4 / 2.4e-6, damping)
    assert motion.spin_stop(30.0, 4.5e-4, 2.4e-6, damping) == pytest.approx(brute, rel=1e-9)


def test_stops_follow_the_published_formulas():
    v0, mu, c, a = 0.4, 0.25, 0.8, 0.25 * 9.81
    log = math.log(1.0 + c * v0 / a)
    assert motion.sliding_stop(v0, mu, c) == pytest.approx(
        (log / c, v0 / c - a / c**2 * log), rel=1e-12)
    assert motion.sliding_stop(v0, mu) == pytest.approx((v0 / a, v0**2 / (2.0 * a)), rel=1e-15)
    assert motion.spin_stop(8.0, 2.0, 0.5) == pytest.approx((2.0, 8.0), rel=1e-15)
    assert motion.sliding_stop(0.0, mu, c) == (0.0, 0.0)
    # Without friction damping alone slows it down, or nothing.
    assert motion.sliding_stop(v0, 0.0, c) == (math.inf, pytest.approx(v0 / c))
    assert motion.sliding_stop(v0, 1e-13, c)[1] == pytest.approx(v0 / c)
    assert motion.spin_stop(8.0, 0.0, 0.5) == (math.inf, math.inf)
    assert motion.sliding_stop(0.0, 0.0, c) == (0.0, 0.0)


def test_stops_of_what_there_is_not_are_refused():
    for call, words in ((lambda: motion.sliding_stop(math.inf, 0.25), "speed must be at least 0"),
                        (lambda: motion.sliding_stop(0.1, -0.25), "friction must be at least 0"),
                        (lambda: motion.spin_stop(1.0, 0.0, 0.0), "inertia must be positive")):
        with pytest.raises(ValueError, match=words):
            call()


def test_stops_are_smooth_where_the_formula_for_little_damping_takes_over():
    c = 0.05 * (0.25 * 9.81) / 0.4  # x = c v0/(mu g) = 0.05
    below, above = (motion.sliding_stop(0.4, 0.25, c * k)[1] for k in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, rel=1e-10)


@given(st.floats(0.1, 10), st.floats(-2, 2), st.floats(0.1, 10), st.floats(-2, 2),
       st.floats(0, 1))
@settings(deadline=None)
def test_head_on_impact_keeps_momentum_and_returns_e(ma, va, mb, vb, e):
    ua, ub = motion.head_on(ma, va, mb, vb, e)
    assert ma * ua + mb * ub == pytest.approx(ma * va + mb * vb, abs=1e-12)
    assert ub - ua == pytest.approx(-e * (vb - va), abs=1e-12)


TILE = {"mass": 0.016, "inertia": 0.016 * 9e-4 / 6.0, "force": 0.075, "torque": 6e-4,
        "frequency": 0.1, "friction_force": 0.03924, "friction_torque": 4.5e-4,
        "linear_damping": 0.8, "angular_damping": 0.5}


def one_way(load, bound, inertia, damping, frequency):
    """First half period of I v' = load sin(2 pi f t) - bound - c I v from rest, in closed form.

    Returns the times of start and stop, and velocity and distance as functions of time.
    """
    w, a, b, c = 2.0 * math.pi * frequency, load / inertia, bound / inertia, damping
    t0 = math.asin(bound / load) / w

    def forced(t):
        return a * (c * math.sin(w * t) - w * math.cos(w * t)) / (c * c + w * w) - b / c

    def velocity(t):
        return forced(t) - forced(t0) * math.exp(-c * (t - t0))

    stop = brentq(velocity, 0.25 / frequency, 0.75 / frequency, xtol=1e-14)

    def distance(t):
        return quad(velocity, t0, t, epsabs=1e-13, epsrel=1e-13)[0]

    return t0, stop, velocity, distance


def test_driven_tile_without_torque_goes_straight_and_sticks_at_both_ends():
    t0, stop, velocity, distance = one_way(0.075, 0.03924, 0.016, 0.8, 0.1)
    times = np.array([0.5 * t0, t0 + 0.1, 2.5, stop - 0.05, stop + 1e-4, 5.4])
    states = motion.driven_tile(times, **{**TILE, "torque": 0.0}, forward=0.3)
    heading = np.array([math.cos(0.3), math.sin(0.3)])
    assert np.all(states[0] == 0.0)
    for t, state in zip(times[1:4], states[1:4], strict=True):
        assert state[3:5] == pytest.approx(velocity(t) * heading, abs=1e-10)
        assert state[:2] == pytest.approx(distance(t) * heading, abs=1e-10)
    assert np.all(states[4:, 3:] == 0.0)
    assert states[4:, :2] == pytest.approx(np.tile(distance(stop) * heading, (2, 1)), abs=1e-10)
    assert np.all(states[:, 2] == 0.0)


@pytest.mark.parametrize("family", [1, -1])
def test_driven_tile_without_force_turns_and_sticks_at_both_ends(family):
    t0, stop, velocity, distance = one_way(6e-4, 4.5e-4, TILE["inertia"], 0.5, 0.1)
    times = np.array([0.9 * t0, t0 + 0.2, 2.5, stop - 0.05, stop + 1e-4, 5.2])
    states = motion.driven_tile(times, **{**TILE, "force": 0.0}, family=family)
    assert np.all(states[0] == 0.0)
    for t, state in zip(times[1:4], states[1:4], strict=True):
        assert state[5] == pytest.approx(family * velocity(t), rel=1e-10)
        assert state[2] == pytest.approx(family * distance(t), rel=1e-10)
    assert np.all(states[4:, 5] == 0.0)
    assert states[4:, 2] == pytest.approx(np.full(2, family * distance(stop)), rel=1e-10)
    assert np.all(states[:, [0, 1, 3, 4]] == 0.0)


def test_driven_tile_that_slides_and_turns_obeys_its_equations_of_motion():
    d, middle = 2e-4, np.array([1.5, 2.0, 3.1, 6.4, 8.3, 13.0])
    times = (middle[:, None] + d * np.array([-1.0, 0.0, 1.0])).ravel()
    before, at, after = motion.driven_tile(times, **TILE).reshape(-1, 3, 6).transpose(1, 0, 2)
    rate = (after - before) / (2.0 * d)
    u = np.sin(2.0 * math.pi * 0.1 * middle)
    heading = at[:, 2] + 0.5 * math.pi
    v = at[:, 3:5]
    speed = np.hypot(*v.T)[:, None]
    assert speed.min() > 0.01
    drive = u[:, None] * 0.075 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    expected = (drive - 0.03924 * v / speed) / 0.016 - 0.8 * v
    assert rate[:, :2] == pytest.approx(v, abs=1e-5)
    # v turns with the heading, tens of rad/s: d^2 v'''/6
    assert rate[:, 3:5] == pytest.approx(expected, abs=2e-4)
    turning = np.abs(at[:, 5]) > 0.0
    assert turning.sum() >= 3
    spin = (u * 6e-4 - np.sign(at[:, 5]) * 4.5e-4) / TILE["inertia"] - 0.5 * at[:, 5]
    assert rate[turning, 5] == pytest.approx(spin[turning], abs=1e-4)
    assert rate[:, 2] == pytest.approx(at[:, 5], abs=1e-5)


def test_driven_tile_turns_back_over_a_period():
    states = motion.driven_tile([5.2, 10.2, 15.2, 20.2], **TILE)
    assert abs(states[0, 2]) > 50.0
    assert states[[1, 3], 2] == pytest.approx(0.0, abs=1e-9)
    assert states[2] == pytest.approx([*(states[0, :3] + [*states[1, :2], 0.0]), 0, 0, 0], abs=1e-9)


def test_driven_tile_without_drive_stops_as_the_closed_forms_say():
    quiet = {**TILE, "force": 0.0, "torque": 0.0}
    time, way = motion.sliding_stop(0.3, 0.25, 0.8)
    time2, angle = motion.spin_stop(20.0, 4.5e-4, TILE["inertia"], 0.5)
    start = (0.1, 0.2, 0.3, 0.18, -0.24, -20.0)
    mid, end = motion.driven_tile([0.5 * min(time, time2), 1.0], **quiet, start=start)
    assert end == pytest.approx([0.1 + 0.6 * way, 0.2 - 0.8 * way, 0.3 - angle, 0, 0, 0], abs=1e-10)
    assert math.hypot(mid[3], mid[4]) > 0.1
    resting = motion.driven_tile([1.0, 7.0], **quiet)
    assert np.all(resting == 0.0)


def test_driven_tile_without_floor_friction_is_the_closed_form():
    free = {**TILE, "friction_force": 0.0, "friction_torque": 0.0, "torque": 0.0}
    w, c, a = 0.2 * math.pi, 0.8, 0.075 / 0.016
    for t, state in zip([1.0, 7.0], motion.driven_tile([1.0, 7.0], **free), strict=True):
        v = a * (c * math.sin(w * t) - w * math.cos(w * t) + w * math.exp(-c * t)) / (c * c + w * w)
        assert state[3:5] == pytest.approx([0.0, v], abs=1e-9)


HARD = {**TILE, "friction_torque": 6.797e-4}


def lab_frame(t, y, torque, resting):
    """Rates of a sliding tile under HARD, written down once more, in the lab's frame."""
    u, heading = math.sin(0.2 * math.pi * t), y[2] + 0.5 * math.pi
    speed = math.hypot(y[3], y[4])
    ax, ay = ((u * 0.075 * unit - 0.03924 * v / speed) / 0.016 - 0.8 * v
              for unit, v in ((math.cos(heading), y[3]), (math.sin(heading), y[4])))
    alpha = (u * torque - math.copysign(6.797e-4, y[5])) / HARD["inertia"] - 0.5 * y[5]
    return [y[3], y[4], y[5], ax, ay, 0.0 if resting else alpha]


@pytest.mark.parametrize(("torque", "begin", "end", "resting"), [
    (7e-4, 10.877, 12.1, True),  # 0.6 ms after a slip began
    (7e-4, 12.2, 13.0, False),
    (7e-4, 14.0, 14.9, True),
    (3e-3, 0.9, 1.1, False),
    (3e-3, 2.5, 2.51, False),  # 2 turns
])
def test_driven_tile_goes_as_an_explicit_method_in_the_lab_frame_does(torque, begin, end, resting):
    states = motion.driven_tile([begin, end], **{**HARD, "torque": torque},
                                start=(0, 0, 0.3, 0, 0, 0))
    assert (states[0, 5] == 0.0) == resting
    expected = solve_ivp(lab_frame, (begin, end), states[0], method="DOP853", rtol=1e-13,
                         atol=1e-15, args=(torque, resting)).y[:, -1]
    size = np.abs(states).max(axis=0)
    assert np.abs(states[1] - expected)[:2] == pytest.approx(0.0, abs=1e-11 * size[:2].max())
    assert states[1, 2] == pytest.approx(expected[2], rel=1e-11)
    assert np.abs(states[1] - expected)[3:5] == pytest.approx(0.0, abs=1e-11 * size[3:5].max())
    assert states[1, 5] == pytest.approx(expected[5], rel=1e-11)


@pytest.mark.parametrize("times", [[3.0, 1.0], [-1.0, 1.0], [0.0, math.nan], [0.0, math.inf]])
def test_times_of_a_driven_tile_increase_from_zero(times):
    with pytest.raises(ValueError, match="must increase, from 0"):
        motion.driven_tile(times, **TILE)


@pytest.mark.parametrize("stop", [
    lambda: motion.sliding_stop(-0.1, 0.25), lambda: motion.sliding_stop(0.1, -0.25),
    lambda: motion.sliding_stop(0.1, 0.25, -1.0), lambda: motion.sliding_stop(math.nan, 0.25),
    lambda: motion.spin_stop(-1.0, 1e-3, 1e-6), lambda: motion.spin_stop(1.0, -1e-3, 1e-6)])
def test_a_stop_is_of_a_speed_and_a_friction_from_zero(stop):
    with pytest.raises(ValueError, match="must be at least 0"):
        stop()


def test_a_drive_of_either_sign_drives():
    """Backward is forward of a tile that faces the other way; a turn the other way, in a mirror."""
    times = [2.0, 4.0, 9.0, 17.0]
    forth = motion.driven_tile(times, **TILE)
    assert np.all(np.abs(forth[-1, :3]) > 0.01)
    back = motion.driven_tile(times, **{**TILE, "force": -TILE["force"]})
    assert back == pytest.approx(motion.driven_tile(times, **TILE, forward=-0.5 * math.pi),
                                 rel=1e-9, abs=1e-12)
    both = motion.driven_tile(
        times, **{**TILE, "force": -TILE["force"], "torque": -TILE["torque"]})
    assert np.array_equal(both, motion.driven_tile(times, **TILE, family=-1))
    turned = motion.driven_tile(times, **{**TILE, "torque": -TILE["torque"]})
    assert turned == pytest.approx(forth * [-1, 1, -1, -1, 1, -1], rel=1e-9, abs=1e-12)


def test_a_frequency_below_zero_is_refused_and_at_zero_nothing_is_driven():
    with pytest.raises(ValueError, match=r"frequency must be at least 0 and finite, not -0\.1"):
        motion.driven_tile([1.0], **{**TILE, "frequency": -0.1})
    assert not motion.driven_tile([1.0], **{**TILE, "frequency": 0.0}).any()


@pytest.mark.parametrize(("name", "value", "allowed"), [
    ("force", math.nan, "a number"), ("torque", math.inf, "a number"), ("mass", 0.0, "positive"),
    ("friction_force", -0.1, "at least 0"), ("friction_torque", math.nan, "at least 0"),
    ("linear_damping", math.nan, "at least 0"), ("family", math.nan, "a number")])
def test_a_driven_tile_of_what_is_no_number_is_refused(name, value, allowed):
    with pytest.raises(ValueError, match=f"{name} must be {allowed} and finite, not {value}"):
        motion.driven_tile([1.0], **{**TILE, name: value})


@pytest.mark.parametrize("start", [(0, 0, math.nan, 0, 0, 0), (0, 0, 0), (0,) * 7])
def test_a_driven_tile_starts_from_six_numbers(start):
    with pytest.raises(ValueError, match="start must be six finite numbers"):
        motion.driven_tile([1.0], **TILE, start=start)


def test_a_stop_in_what_all_but_only_damps():
    assert motion.sliding_stop(1.0, 1e-160, 0.8)[1] == pytest.approx(1.0 / 0.8, rel=1e-12)


LAW = magnets.Law(cutoff=0.03, switch=0.1)
QUADRANT = next(each for each in scaling.READINGS if each.name == "quadrant")


@pytest.mark.parametrize(("call", "words"), [
    (lambda: scaling.critical_load(math.nan, 2, 0.2), "angle must be finite"),
    (lambda: scaling.slip_onset(math.inf, 2, 0.2), "angle must be finite"),
    (lambda: scaling.bound_all_pairs(QUADRANT, math.nan, 0.25, 0.0, LAW), "must be numbers"),
    (lambda: scaling.report(0.07, mu=math.nan), "must be numbers"),
    (lambda: permanent.coaxial_cylinders(0.01, 0.005, math.inf), "positive and finite"),
    (lambda: permanent.coaxial_cuboids(math.inf, 0.005, 0.003), "must be finite"),
    (lambda: permanent.parallel_cuboids([0, 0, math.nan], [1e-3] * 3, [1e-3] * 3),
     "must be finite"),
    (lambda: snap.meet([[0, 0, 0], [0.034, 0, 0]], np.zeros((2, 3)),
                       [snap.Body(0.016, 2.4e-6, -0.1)] * 2, [(1, 2, 1, 2)] * 2, LAW),
     "friction_force must be at least 0"),
    (lambda: snap.meet([[0, 0, 0], [0.034, 0, 0]], np.zeros((2, 3)),
                       [snap.Body(0.0, 2.4e-6)] * 2, [(1, 2, 1, 2)] * 2, LAW),
     "mass must be positive"),
    (lambda: rotation.wall_slide(0.6, 0.03, 0.016, math.nan), "mu must be at least 0"),
    (lambda: rotation.wall_slide(0.6, -0.03, 0.016, 0.25), "width must be positive"),
    (lambda: rotation.rocking_fall(0.1, -1.0, 0.03, 0.3), "mass must be positive"),
    (lambda: rotation.rocking_impact(-1.0, 0.016, 0.03, 0.1), "spin must be positive"),
    (lambda: stability.half_turn_holds(1.5, 0.2, 0.1), "n must be whole"),
    (lambda: stability.half_turn_holds(2, math.inf, math.inf), "n must be whole"),
    (lambda: fit.runs_test([math.nan, 1.0, -1.0]), "must be numbers")])
def test_what_no_number_comes_of_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_driven_tile_leaves_rest_along_the_force():
    """A slip starts at 10.8763 s and goes straight until the torque turns the tile at 12.1 s."""
    t0, _, velocity, _ = one_way(0.075, 0.03924, 0.016, 0.8, 0.1)
    times = 10.0 + t0 + np.array([-1e-6, 1e-5, 1e-3, 0.1, 1.0])
    still, *states = motion.driven_tile(times, **{**HARD, "torque": 7e-4},
                                        start=(0, 0, 0.3, 0, 0, 0))
    assert np.all(still[3:] == 0.0)
    heading = still[2] + 0.5 * math.pi
    for t, state in zip(times[1:] - 10.0, states, strict=True):
        expected = velocity(t) * np.array([math.cos(heading), math.sin(heading)])
        assert state[3:5] == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_driven_tile_that_spins_fast_circles():
    """At steady speed v the drive F holds friction, damping and m omega v in balance."""
    state = motion.driven_tile([2.5], **{**HARD, "torque": 3e-3})[0]
    speed = math.hypot(state[3], state[4])
    assert state[5] > 700.0
    assert math.hypot(0.03924, 0.016 * state[5] * speed) == pytest.approx(0.075, rel=1e-3)


def test_spin_that_the_drive_turns_back_does_not_rest():
    """The drive exceeds its bound where the spin passes zero: the next half goes on at once."""
    def rates(t, y, sign):
        alpha = (math.sin(0.2 * math.pi * t) * 3e-3 - sign * 6.797e-4) / HARD["inertia"]
        return [y[1], alpha - 0.5 * y[1]]

    def stop(t, y, sign):
        return y[1]

    stop.terminal, stop.direction = True, -1.0
    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    t0 = math.asin(6.797e-4 / 3e-3) / (0.2 * math.pi)
    first = solve_ivp(rates, (t0, 10.0), [0.0, 0.0], args=(1.0,), events=stop, **options)
    back = first.t[-1]
    assert 5.0 < back < 9.0
    last = solve_ivp(rates, (back, 9.5), [first.y[0, -1], 0.0], args=(-1.0,), **options)
    states = motion.driven_tile([back - 1e-6, back + 1e-6, 9.5], **{**HARD, "torque": 3e-3})
    assert states[0, 5] > 0.0 > states[1, 5]
    assert states[2, [2, 5]] == pytest.approx(last.y[:, -1], rel=1e-10)


def test_slide_that_the_drive_turns_back_does_not_rest():
    fast = {**TILE, "torque": 0.0, "frequency": 1.0, "linear_damping": 0.0}
    w, a, b, v0 = 2.0 * math.pi, 0.075 / 0.016, 0.03924 / 0.016, -0.5

    def velocity(t, sign, begin=0.0, v=0.0):
        return v + a * (math.cos(w * begin) - math.cos(w * t)) / w - sign * b * (t - begin)

    stop = brentq(velocity, 0.1, 0.25, args=(-1.0, 0.0, v0), xtol=1e-15)
    assert a * math.sin(w * stop) > b
    times = np.array([0.1, stop - 1e-6, stop + 1e-6, 0.3])
    states = motion.driven_tile(times, **fast, forward=0.0, start=(0, 0, 0, v0, 0, 0))
    expected = [velocity(t, -1.0, 0.0, v0) if t < stop else velocity(t, 1.0, stop) for t in times]
    assert states[:, 3] == pytest.approx(expected, abs=1e-13)
    assert np.all(states[:, 4] == 0.0)


@pytest.mark.parametrize("excess", [1e-14, 1e-11, 1e-7, 1e-4])
def test_drive_that_hardly_exceeds_friction_hardly_moves_the_tile(excess):
    weak = {**TILE, "force": 0.03924 * (1.0 + excess), "torque": 3e-3}
    states = motion.driven_tile([2.5, 5.0, 20.0], **weak)
    assert np.all(states[1, 3:5] == 0.0)
    reach = 3.0 * 2.4525 * excess * (math.sqrt(8.0 * excess) / (0.2 * math.pi)) ** 2
    assert np.abs(states[:, :2]).max() <= reach


@pytest.mark.parametrize("torque", [7e-4, 3e-3])
@pytest.mark.parametrize("start", [(0, 0, 0.3, 0, 0, 0), (0, 0, 0.3, 0.2, -0.3, 30.0)])
def test_driven_tile_does_not_depend_on_the_tolerance(monkeypatch, torque, start):
    times = np.arange(1.0, 21.0)
    sharp = motion.driven_tile(times, **{**HARD, "torque": torque}, start=start)
    monkeypatch.setattr(motion, "TOLERANCE", 1e-9)
    monkeypatch.setattr(motion, "FIRST", 3e-3)
    blunt = motion.driven_tile(times, **{**HARD, "torque": torque}, start=start)
    assert not np.array_equal(sharp, blunt)
    size = np.abs(sharp).max(axis=0)
    size[:2], size[3:5] = size[:2].max(), size[3:5].max()
    assert np.abs(sharp - blunt).max(axis=0) == pytest.approx(0.0, abs=1e-10 * size.min())


# Impact.

MODES = ("sliding", "C-sticking", "R-sticking", "C-reversed", "R-reversed")


def random_contacts(count, seed):
    """vn, vt, B1, B2, B3, mu, e of contacts of two squares; all modes are among them."""
    rng = np.random.default_rng(seed)
    cases = []
    for _ in range(count):
        mass_a = math.inf if rng.random() < 0.3 else 10 ** rng.uniform(-1, 1)
        arms = rng.uniform(-1.0, 1.0, (2, 2))
        b = impact.inverse_inertia(mass_a, mass_a / 6.0, tuple(arms[0]), 1.0, 1.0 / 12.0,
                                   tuple(arms[1]))
        angle = rng.uniform(-0.5 * math.pi, 0.5 * math.pi)
        cases.append((-math.cos(angle), math.sin(angle), *b, 10 ** rng.uniform(-2, 0.5),
                      rng.choice([0.0, 0.2, rng.random(), 1.0])))
    return np.array(cases)


def brute_impacts(cases, steps=30_000):
    """Darboux-Keller: both velocities over the normal impulse, in tiny steps of it.

    In each step the tangential impulse is the one that would stop the slip, held inside the
    cone.  Vectorised over the cases; errors of the order of one step.
    """
    vn, vt, b1, b2, b3, mu, e = cases.T
    step = np.hypot(vn, vt) / np.linalg.eigvalsh(
        np.stack([np.stack([b1, -b3], -1), np.stack([-b3, b2], -1)], -2))[:, 0] / steps * 4.0
    un, ut = vn.copy(), vt.copy()
    pn, pt, end = np.zeros_like(vn), np.zeros_like(vn), np.full_like(vn, np.inf)
    while True:
        going = pn < end
        if not going.any():
            return pn, pt, step
        dn = np.where(going, step, 0.0)
        dt = np.clip(-(ut - b3 * dn) / b1, -mu * dn, mu * dn)
        un, ut = un + b2 * dn - b3 * dt, ut + b1 * dt - b3 * dn
        pn, pt = pn + dn, pt + dt
        end = np.where((un >= 0.0) & np.isinf(end), (1.0 + e) * pn, end)


def test_impact_is_what_tiny_steps_of_the_normal_impulse_give():
    cases = random_contacts(400, seed=5)
    results = [impact.routh(*case) for case in cases]
    pn, pt, step = brute_impacts(cases)
    counts = {mode: sum(r.mode == mode for r in results) for mode in MODES}
    assert min(counts.values()) >= 3, counts
    assert np.abs(pn - [r.normal for r in results]) / step == pytest.approx(0.0, abs=12.0)
    assert np.abs(pt - [r.tangential for r in results]) / step == pytest.approx(0.0, abs=40.0)
    assert (pn / step).max() > 5000.0  # so the steps are tiny


def test_impact_that_starts_without_slip_sticks_or_slides_as_brute_force_says():
    cases = random_contacts(200, seed=6)
    cases[:, 1] = 0.0
    results = [impact.routh(*case) for case in cases]
    pn, pt, step = brute_impacts(cases)
    assert {r.mode for r in results} == {"sliding", "C-sticking"}
    assert np.abs(pn - [r.normal for r in results]) / step == pytest.approx(0.0, abs=12.0)
    assert np.abs(pt - [r.tangential for r in results]) / step == pytest.approx(0.0, abs=40.0)


def test_impact_of_a_disc_follows_the_textbook():
    """A disc of mass 1 and radius 1 on a fixed floor: B1 = 3, B2 = 1, B3 = 0."""
    mass, inertia = 1.0, 0.5
    b = impact.inverse_inertia(math.inf, math.inf, (0.0, 0.0), mass, inertia, (0.0, -1.0))
    assert b == pytest.approx((3.0, 1.0, 0.0))
    slides = impact.routh(-1.0, 9.0, *b, 0.25, 0.5)
    assert slides == impact.Impact(1.5, -0.375, "sliding")
    sticks = impact.routh(-1.0, 0.6, *b, 0.25, 0.5)
    assert sticks == impact.Impact(1.5, pytest.approx(-0.2), "C-sticking")
    late = impact.routh(-1.0, 0.9, *b, 0.25, 0.5)
    assert late == impact.Impact(1.5, pytest.approx(-0.3), "R-sticking")


def test_bodies_that_separate_or_only_touch_have_no_impact():
    assert impact.routh(1e-9, 1.0, 3.0, 1.0, 0.5, 0.5, 0.5) == (0.0, 0.0, "none")
    assert impact.routh(0.0, 1.0, 3.0, 1.0, 0.5, 0.5, 0.5) == (0.0, 0.0, "none")
    assert impact.routh(0.0, 0.0, 3.0, 1.0, 0.5, 0.5, 0.5) == (0.0, 0.0, "none")
    assert kernel_routh(1e-9, 1.0, 1.0, 3.0, 0.5, 0.5, 0.5) == (0.0, 0.0)
    assert kernel_routh(0.0, 1.0, 1.0, 3.0, 0.5, 0.5, 0.5) == (0.0, 0.0)
    assert kernel_routh(0.0, 0.0, 1.0, 3.0, 0.5, 0.5, 0.5) == (0.0, 0.0)


def test_sliding_that_presses_the_bodies_together_makes_a_tangential_impact():
    # b2 + s mu b3 < 0: the normal velocity falls as the normal impulse grows
    case = (0.0, 1.0, 4.0, 1.0, -1.5, 1.0, 0.5)
    result = impact.routh(*case)
    assert result.normal > 0.0
    assert result.mode in {"C-sticking", "C-reversed"}
    assert kernel_routh(0.0, 1.0, 1.0, 4.0, 1.5, 1.0, 0.5) == pytest.approx(result[:2])
    nudged = np.array([(-1e-9, *case[1:])])
    pn, pt, step = brute_impacts(nudged)
    assert [pn[0], pt[0]] == pytest.approx(list(result[:2]), abs=40.0 * step[0])


coefficient = st.floats(0.0, 1.0)
inertias = st.tuples(st.floats(0.2, 5.0), st.floats(0.2, 5.0), st.floats(-0.99, 0.99)).map(
    lambda t: (t[0], t[1], t[2] * math.sqrt(t[0] * t[1])))


@given(vn=st.floats(-2.0, -1e-3), vt=st.floats(-2.0, 2.0), b=inertias, mu=st.floats(0.0, 3.0),
       e=coefficient)
@settings(deadline=None, max_examples=500)
def test_impact_keeps_the_cone_separates_and_never_gains_energy(vn, vt, b, mu, e):
    pn, pt, _ = impact.routh(vn, vt, *b, mu, e)
    assert pn > 0.0
    assert abs(pt) <= mu * pn * (1.0 + 1e-12) + 1e-15
    after = vn + b[1] * pn - b[2] * pt
    assert after >= -1e-12 * (1.0 + b[1] * pn)
    if e == 0.0:
        assert after == pytest.approx(0.0, abs=1e-12 * (1.0 + b[1] * pn))
    size = abs(vn * pn) + abs(vt * pt) + b[1] * pn * pn
    assert impact.energy_change(vn, vt, *b, pn, pt) <= 1e-12 * size


def test_kernel_of_the_impact_is_the_theory_to_rounding():
    cases = random_contacts(3000, seed=7)
    cases[::10, 1] = 0.0
    seen = set()
    for vn, vt, b1, b2, b3, mu, e in cases:
        pn, pt, mode = impact.routh(vn, vt, b1, b2, b3, mu, e)
        seen.add(mode)
        got = kernel_routh(vn, vt, b2, b1, -b3, mu, e)
        assert np.abs(np.array(got) - [pn, pt]) == pytest.approx(0.0, abs=1e-12 * pn)
    assert seen == set(MODES)


# Magnets.

FIRST = ((1, 2, 1, 2), (-1, -2, -1, -2))
SECOND = ((2, 2, -1, -1), (1, 1, -2, -2))
BARE = magnets.Law()
FADED = magnets.Law(cutoff=0.03, switch=0.1)


def test_magnets_at_one_point_but_for_rounding_do_not_push_each_other():
    law, glues = magnets.Law(inset=0.0, cutoff=0.01), ((1, 2, 1, 2), (-1, -2, -1, -2))
    for site in range(30):
        a, b = ((law.width * k, 0.0, 0.0) for k in (site, site + 1))
        assert magnets.pair_force(a, glues[0], b, glues[1], law) == (0.0, 0.0, 0.0, 0.0)


def test_force_and_energy_of_the_paper_s_fit():
    assert magnets.force(0.003, BARE) == pytest.approx(0.2037, abs=5e-5)
    assert magnets.force(0.03, BARE) == pytest.approx(0.0136, abs=5e-5)
    assert magnets.energy(0.003, BARE) == pytest.approx(-1.91e-3, abs=5e-6)


@pytest.mark.parametrize(("glues", "cutoff", "expected"), [
    (FIRST, 0.02, 0.2037), (SECOND, 0.02, 0.2037),  # mating magnets alone
    (FIRST, 0.029, 0.1312), (SECOND, 0.029, 0.2037),  # every pair but the outer ones
    (FIRST, 0.0300001, 0.1855), (SECOND, 0.0300001, 0.1494),  # with the outer ones, 3 cm apart
])
def test_bond_force_of_a_flush_pair(glues, cutoff, expected):
    law = magnets.Law(cutoff=cutoff)
    assert magnets.bond_force(*glues, law) == pytest.approx(expected, abs=5e-5)
    assert magnets.bond_force(*glues[::-1], law) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize(("glues", "expected"), [(FIRST, 0.1312), (SECOND, 0.2037)])
def test_the_default_switch_leaves_a_flush_bond_as_it_is(glues, expected):
    assert magnets.bond_force(*glues, FADED) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("glues", [FIRST, SECOND])
def test_like_tiles_repel_and_mismatch_zero_does_not(glues):
    for tile in glues:
        near = BARE._replace(cutoff=0.02)
        assert magnets.bond_force(tile, tile, near) <= 0.0
        assert magnets.bond_force(tile, tile, near._replace(mismatch=0.0)) >= 0.0
    assert magnets.bond_force(FIRST[0], FIRST[0], BARE._replace(cutoff=0.02)) == pytest.approx(
        -0.2037, abs=5e-5)
    assert magnets.bond_force((0, 0, 0, 0), glues[1], BARE) == 0.0


def test_switch_goes_from_one_to_zero_with_two_continuous_derivatives():
    assert magnets.fade(0.027, FADED) == 1.0
    assert magnets.fade(0.0285, FADED) == pytest.approx(0.5)
    assert magnets.fade(0.03, FADED) == 0.0
    values = [magnets.fade(r, FADED) for r in np.linspace(0.026, 0.031, 501)]
    assert all(a >= b for a, b in pairwise(values))
    d = 1e-5
    for end in (0.027, 0.03):
        slopes = np.diff([magnets.fade(end + k * d, FADED) for k in (-1, 0, 1)]) / d
        assert slopes * 0.003 == pytest.approx(0.0, abs=1e-3)
        assert np.diff(slopes) / d * 0.003**2 == pytest.approx(0.0, abs=0.25)


@pytest.mark.parametrize("law", [BARE, BARE._replace(cutoff=0.03), FADED])
def test_force_is_the_slope_of_the_energy(law):
    for r in (0.003, 0.01, 0.0265, 0.0275, 0.0285, 0.0295):
        d = 1e-6
        slope = (magnets.energy(r + d, law) - magnets.energy(r - d, law)) / (2.0 * d)
        assert magnets.force(r, law) == pytest.approx(slope, rel=1e-5)
    assert magnets.energy(0.031, FADED) == 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("beta", [0.0, 6.4e-3])
@pytest.mark.parametrize("switch", [1e-6, 0.1, 1.0])
@pytest.mark.parametrize("width", [1e-3, 0.03, 1.0])
def test_the_energy_of_magnets_of_any_size_is_the_integral_of_their_force(width, switch, beta):
    law = magnets.Law(1.8e-5 * width, beta, width, 0.05 * width, width, switch)
    points, weights = np.polynomial.legendre.leggauss(20)
    for r in np.array([1e-9, 1e-3, 0.1, 0.95, 0.999, 1.0 - 1e-6, 1.0 - 1e-9]) * width:
        ends = sorted({r, max(r, width * (1.0 - switch)), width})
        panels = np.concatenate([np.geomspace(a, b, 200) for a, b in pairwise(ends)])
        brute = 0.0
        for a, b in pairwise(panels):
            at = 0.5 * (a + b) + 0.5 * (b - a) * points
            brute -= 0.5 * (b - a) * sum(weights * [magnets.force(each, law) for each in at])
        assert magnets.energy(r, law) == pytest.approx(brute, rel=1e-6, abs=0.0)


def test_without_a_cut_off_there_is_no_switch():
    law = BARE._replace(switch=0.1)
    for r in (0.003, 0.3):
        assert magnets.force(r, law) == magnets.force(r, BARE)
        assert magnets.energy(r, law) == magnets.energy(r, BARE)


@given(x=st.floats(0.02, 0.05), y=st.floats(-0.03, 0.03), a=st.floats(-3, 3), b=st.floats(-3, 3))
@settings(deadline=None, max_examples=50)
def test_forces_and_torques_of_a_pair_are_the_slopes_of_its_energy(x, y, a, b):
    d = 1e-6

    def slope(da=0.0, db=0.0, dx=0.0, dy=0.0):
        up, down = (magnets.pair_energy((0.0, 0.0, a + k * da), SECOND[0],
                                        (x + k * dx, y + k * dy, b + k * db), SECOND[1], FADED)
                    for k in (d, -d))
        return (up - down) / (2.0 * d)

    fx, fy, ta, tb = magnets.pair_force((0.0, 0.0, a), SECOND[0], (x, y, b), SECOND[1], FADED)
    places = (magnets.magnet_positions((0.0, 0.0, a), FADED),
              magnets.magnet_positions((x, y, b), FADED))
    if min(math.dist(p, q) for p in places[0] for q in places[1]) < 1e-3:
        return  # magnets nearly on each other: tiles would overlap
    assert [fx, fy] == pytest.approx([-slope(dx=1.0), -slope(dy=1.0)], abs=1e-6)
    assert [ta, tb] == pytest.approx([-slope(da=1.0), -slope(db=1.0)], abs=1e-8)
    assert ta + tb + x * fy - y * fx == pytest.approx(0.0, abs=1e-15)


def test_the_two_readings_of_the_angular_coefficient_are_half_as_large_again():
    ratio = floor.engine_torque(0.25, 0.016, 0.03) / floor.max_torque(0.25, 0.016, 0.03)
    assert ratio == pytest.approx(1.0 / math.sqrt(3.0) / floor.MEAN_DISTANCE)
