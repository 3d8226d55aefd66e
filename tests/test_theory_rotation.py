"""The truths of the reference scenes against brute force: snaps, rigid rotations, the unicycle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from theory import magnets, motion, rotation, snap, unicycle
from theory.floor import MEAN_DISTANCE, ellipsoid_wrench, engine_torque, max_torque
from theory.snap import Body, closing, meet, separation

WIDTH, MASS, MU, GRAVITY = 0.03, 0.016, 0.25, 9.81
INERTIA = MASS * WIDTH**2 / 6.0
LAW = magnets.Law(cutoff=0.03, switch=0.1)
FIRST = (1, 2, 1, 2), (-1, -2, -1, -2)
SECOND = (2, 2, -1, -1), (1, 1, -2, -2)
HELD = Body(math.inf, math.inf)
FLOOR = MU * MASS * GRAVITY


def dry(torque):
    return Body(MASS, INERTIA, FLOOR, torque, 0.8, 0.5)


EASY, HARD = dry(max_torque(MU, MASS, WIDTH)), dry(engine_torque(MU, MASS, WIDTH))
SMOOTH = Body(MASS, INERTIA)


def pull(gap, glues, b, **options):
    """Tile b, free and at rest, at a gap to the right of a held one."""
    start = [(0, 0, 0), (WIDTH + gap, 0, 0)]
    return meet(start, np.zeros((2, 3)), (HELD, b), glues, LAW, **options)


# Two tiles that snap.


def test_a_frictionless_snap_turns_the_magnets_energy_into_speed():
    """m v^2/2 = U(start) - U(contact), for the pair that comes straight."""
    end = pull(0.01, FIRST, SMOOTH)
    fall = (magnets.pair_energy((0, 0, 0), FIRST[0], (WIDTH + 0.01, 0, 0), FIRST[1], LAW)
            - magnets.pair_energy((0, 0, 0), FIRST[0], (WIDTH, 0, 0), FIRST[1], LAW))
    assert (end.kind, end.tilt) == ("contact", 0.0)
    assert 0.5 * MASS * end.speed**2 == pytest.approx(fall, rel=1e-10)


def test_a_frictionless_snap_that_turns_keeps_its_energy_too():
    end = pull(0.01, SECOND, SMOOTH)
    poses = [tuple(map(float, pose)) for pose in end.poses]
    fall = (magnets.pair_energy((0, 0, 0), SECOND[0], (WIDTH + 0.01, 0, 0), SECOND[1], LAW)
            - magnets.pair_energy(poses[0], SECOND[0], poses[1], SECOND[1], LAW))
    vx, vy, omega = end.twists[1]
    assert abs(end.tilt) > 0.1
    assert 0.5 * MASS * (vx**2 + vy**2) + 0.5 * INERTIA * omega**2 == pytest.approx(fall, rel=1e-9)


def test_two_free_tiles_meet_in_the_middle_as_one_of_half_the_mass():
    """Relative motion has the mass m/2: sqrt(2) times the speed, in 1/sqrt(2) of the time."""
    one = pull(0.01, FIRST, SMOOTH)
    two = meet([(0, 0, 0), (WIDTH + 0.01, 0, 0)], np.zeros((2, 3)), (SMOOTH, SMOOTH), FIRST, LAW)
    assert two.speed == pytest.approx(math.sqrt(2.0) * one.speed, rel=1e-9)
    assert two.time == pytest.approx(one.time / math.sqrt(2.0), rel=1e-9)
    assert two.poses[:, 0].sum() == pytest.approx(WIDTH + 0.01, abs=1e-12)


def test_the_four_snaps_end_as_they_must():
    """On a corner; flush; not at all, at a gap of 0.83 cm; and flush without a floor."""
    corner = pull(0.01, SECOND, EASY)
    assert (corner.kind, abs(corner.tilt) > 0.01) == ("contact", True)
    flush = pull(0.003, FIRST, HARD)
    assert (flush.kind, flush.tilt) == ("contact", 0.0)
    creep = pull(0.01, FIRST, HARD)
    assert creep.kind == "rest"
    assert creep.gap == pytest.approx(0.0083, abs=1e-4)
    assert pull(0.01, FIRST, Body(MASS, INERTIA, 0.0, 0.0, 0.8, 0.5)).kind == "contact"


@pytest.mark.parametrize(("gap", "glues", "b"), [(0.01, SECOND, EASY), (0.003, FIRST, HARD),
                                                 (0.01, FIRST, HARD)])
def test_a_snap_does_not_depend_on_the_tolerance(gap, glues, b):
    loose, tight = (pull(gap, glues, b, tolerance=tolerance) for tolerance in (1e-11, 1e-13))
    assert loose.time == pytest.approx(tight.time, rel=1e-8)
    assert loose.speed == pytest.approx(tight.speed, rel=1e-8, abs=1e-12)
    assert loose.gap == pytest.approx(tight.gap, rel=1e-8, abs=1e-12)


def test_a_dry_snap_is_what_tiny_steps_give():
    """Semi-implicit Euler with the friction clamped, 3e4 steps, to its first order."""
    h, x, y, angle, vx, vy, omega = 4e-6, WIDTH + 0.01, 0.0, 0.0, 0.0, 0.0, 0.0
    end = pull(0.01, SECOND, EASY)
    for _ in range(round(end.time / h)):
        fx, fy, _, torque = magnets.pair_force((0, 0, 0), SECOND[0], (x, y, angle), SECOND[1], LAW)
        ux, uy = vx + h * (fx / MASS - 0.8 * vx), vy + h * (fy / MASS - 0.8 * vy)
        w = omega + h * (torque / INERTIA - 0.5 * omega)
        speed = math.hypot(ux, uy)
        keep = max(0.0, 1.0 - h * FLOOR / MASS / speed) if speed else 0.0
        vx, vy = keep * ux, keep * uy
        omega = math.copysign(max(0.0, abs(w) - h * EASY.friction_torque / INERTIA), w)
        x, y, angle = x + h * vx, y + h * vy, angle + h * omega
    assert (x, y, angle) == pytest.approx(tuple(end.poses[1]), abs=1e-4 * WIDTH)
    assert (vx, vy) == pytest.approx(tuple(end.twists[1, :2]), abs=1e-3)


@pytest.mark.parametrize("held", [False, True])
def test_a_smooth_tile_that_comes_from_out_of_reach_is_moved_and_turned(held):
    """One lies still, the other flies past without a spin: nothing pulls before they are near."""
    start = np.array([(0.0, 0.0, 0.3), (-0.07, 0.046, -0.2)])
    twists = np.array([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)])
    bodies = (HELD if held else SMOOTH, SMOOTH)
    end = meet(start, twists, bodies, SECOND, LAW, until=0.3)
    assert abs(end.twists[1, 2]) > 0.5

    def energy(poses, twists):
        moving = twists[1:] if held else twists
        kinetic = 0.5 * (moving**2 @ [MASS, MASS, INERTIA]).sum()
        return kinetic + magnets.pair_energy(tuple(poses[0]), SECOND[0], tuple(poses[1]),
                                             SECOND[1], LAW)

    assert energy(end.poses, end.twists) == pytest.approx(energy(start, twists), rel=1e-9)
    if not held:
        assert end.twists[:, :2].sum(axis=0) == pytest.approx([0.5, 0.0], abs=1e-12)
        spin = [MASS * (p[:, 0] * t[:, 1] - p[:, 1] * t[:, 0]).sum() + INERTIA * t[:, 2].sum()
                for p, t in ((start, twists), (end.poses, end.twists))]
        assert spin[1] == pytest.approx(spin[0], rel=1e-9)


def test_two_dry_tiles_meet_as_tiny_steps_have_it():
    """One comes, stops, and is pulled on; both begin to slide where the pull passes their bound."""
    poses = np.array([(0.0, 0.0, 0.0), (0.04, 0.0, 0.0)])
    twists = np.array([(0.0, 0.0, 0.0), (-0.14, 0.02, 0.0)])
    end = meet(poses, twists, (HARD, HARD), FIRST, LAW, until=0.5)
    assert (end.kind, end.tilt) == ("contact", 0.0)
    assert end.twists[0, 0] > 0.05
    h = 1e-5
    for _ in range(round(end.time / h)):
        fx, fy, *torques = magnets.pair_force(tuple(poses[0]), FIRST[0], tuple(poses[1]), FIRST[1],
                                              LAW)
        assert np.abs(torques).max() < HARD.friction_torque  # neither turns
        twists[:, :2] += h * (np.outer((-1, 1), (fx, fy)) / MASS - 0.8 * twists[:, :2])
        speed = np.hypot(*twists[:, :2].T)[:, None]
        twists[:, :2] *= np.maximum(0.0, 1.0 - h * FLOOR / MASS / np.maximum(speed, 1e-300))
        poses = poses + h * twists
    assert poses == pytest.approx(end.poses, abs=2e-4 * WIDTH)
    assert twists == pytest.approx(end.twists, abs=1e-3)


@pytest.mark.parametrize(("start", "twist"), [
    # Pulled off its place for a moment, by a tile that passes: the slide starts and ends slowly.
    ((0.04176070197765168, 0.005366294337029186, 0.11520919059811047),
     (-1.2238036140408362, -0.08949897600381287, -43.947443830672526)),
    # Stops turning where the magnets just exceed the floor, and then no longer do.
    ((0.03688842386392337, -0.00032582003448390975, -0.2510387149405384),
     (-0.0129471323587518, -0.10593019558204918, -11.81518264693759))])
def test_what_starts_to_move_at_its_bound_and_stops_again_goes_on(start, twist):
    end = meet([(0, 0, 0), start], [(0, 0, 0), twist], (HARD, HARD), FIRST, LAW, until=0.5)
    assert end.kind == "contact"
    assert end.gap == pytest.approx(0.0, abs=1e-12)


def test_a_slide_that_starts_slowly_gets_on():
    """Its end as a start is known to the rounding of the time at which it is found."""
    weak = Body(0.016, INERTIA, 0.01, 1e-5, 0.8, 0.5)
    heavy = Body(0.032, INERTIA * 2.0)
    end = meet([(0, 0, 0), (-0.003, 0.031, 0)], np.zeros((2, 3)), (weak, heavy),
               ((1, 2, 1, 2), (-1, -2, -1, -2)), LAW)
    assert end.kind == "contact"
    assert end.gap == pytest.approx(0.0, abs=1e-12)
    start = (0.030893117074231632, -0.005469992086352729, 0.0)
    end = meet([(0, 0, 0), start], np.zeros((2, 3)), (weak, weak),
               ((1, 2, 1, 2), (-1, -2, -1, -2)), LAW)
    assert end.kind in ("contact", "rest")


def test_a_motion_that_does_not_get_on_is_an_error(monkeypatch):
    monkeypatch.setattr(snap, "PIECES", 1)
    with pytest.raises(RuntimeError, match="does not get on from t = 0"):
        pull(0.01, FIRST, HARD)


@pytest.mark.parametrize(("start", "twist"), [
    ((0.045, 0.0, 0.3), (-0.3, 0.0, 0.0)),
    ((0.033272947538383654, -0.015470519123147843, 1.0731653777729342), (0.0, 0.0, 0.0))])
def test_a_sharp_cut_off_is_a_narrow_switch_where_a_load_jumps_past_the_floor_s_bound(start, twist):
    met = [meet([(0, 0, 0), start], [(0, 0, 0), twist], (HARD, HARD), FIRST,
                magnets.Law(cutoff=0.03, switch=switch)) for switch in (0.0, 1e-4)]
    assert [found.kind for found in met] == ["contact", "contact"]
    assert met[0].time == pytest.approx(met[1].time, rel=1e-3)


@pytest.mark.parametrize(("x", "vx", "spin", "time"), [
    (0.036, 0, 100, 0.00643501), (0.0345, 0, 300, 0.00126915), (0.036, 0, 300, 0.00214500),
    (0.1, -20, 0, 0.0035)])
def test_fast_tiles_meet_though_they_would_part_again_at_once(x, vx, spin, time):
    """Without magnets, so that times are those of a corner on a circle, and of a straight way."""
    if spin:  # the corner reaches the face where cos of what is left to turn is this
        reach = (x - 0.5 * WIDTH) / (math.sqrt(0.5) * WIDTH)
        assert (0.25 * math.pi - math.acos(reach)) / spin == pytest.approx(time, rel=1e-5)
    end = meet([(0, 0, 0), (x, 0, 0)], [(0, 0, 0), (vx, 0, spin)], (SMOOTH, SMOOTH),
               ((0,) * 4, (0,) * 4), LAW, until=0.5)
    assert end.kind == "contact"
    assert end.time == pytest.approx(time, rel=1e-5)
    assert end.gap == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("twist", "angle", "kind"), [((0, 0, 30), 0.0, "spin"),
                                                      ((0, -50, 0), 0.25 * math.pi, "slide")])
def test_a_corner_that_passes_a_face_touches_it_or_not_to_a_billionth_of_a_metre(twist, angle,
                                                                                 kind):
    """A square on its way past another, or turning beside it, that comes nearer by a corner."""
    near = WIDTH * (0.5 + math.sqrt(0.5))
    for deep, expected in ((1e-9, "contact"), (-1e-9, "time")):
        start = (near - deep, 0.1 * (kind == "slide"), angle)
        end = meet([(0, 0, 0), start], [(0, 0, 0), twist], (SMOOTH, SMOOTH), ((0,) * 4, (0,) * 4),
                   LAW, until=0.05)
        assert end.kind == expected


def test_the_gap_of_two_squares_is_that_of_the_nearest_corner_and_face():
    gap, normal, corners = separation((0, 0, 0), (0.05, 0, 0.25 * math.pi), WIDTH)
    assert gap == pytest.approx(0.05 - WIDTH * (0.5 + math.sqrt(0.5)))
    assert normal == pytest.approx(1.0)
    assert corners[0] == pytest.approx(0.05 - WIDTH * math.sqrt(0.5))
    assert separation((0, 0, 0), (0.02, 0, 0), WIDTH)[0] == pytest.approx(-0.01)


def test_the_closing_speed_is_the_rate_at_which_the_gap_shrinks():
    poses = np.array([(0.0, 0.0, 0.3), (0.045, 0.01, -0.5)])
    twists = np.array([(0.1, -0.2, 3.0), (-0.3, 0.1, -5.0)])
    h = 1e-7
    gaps = [separation(*(poses + side * h * twists), WIDTH)[0] for side in (-1, 1)]
    rate = (gaps[0] - gaps[1]) / (2 * h)
    assert closing(poses, twists, WIDTH)[0] == pytest.approx(rate, rel=1e-6)


# Rigid rotations.


@pytest.mark.parametrize("mu", [0.0, 0.1, 0.25])
def test_a_tile_along_the_wall_obeys_newtons_law_at_both_corners(mu):
    """Forces and moment about the tile's own centre from the two corner forces."""
    radius = 0.2
    slide = rotation.wall_slide(radius, WIDTH, MASS, mu)
    d, spin = slide.distance, 1.7
    force, moment = 0j, 0.0
    for size, side in ((slide.leading, 1), (slide.trailing, -1)):
        corner = complex(d + 0.5 * WIDTH, side * 0.5 * WIDTH)
        assert abs(corner) == pytest.approx(radius, rel=1e-14)
        out = corner / radius
        push = size * spin**2 * (-out - mu * 1j * out)
        force += push
        moment += ((corner - d).conjugate() * push).imag
    change = -slide.rate * spin**2
    assert force.real == pytest.approx(-MASS * d * spin**2, rel=1e-12)
    assert force.imag == pytest.approx(MASS * d * change, rel=1e-12, abs=1e-15)
    assert moment == pytest.approx(INERTIA * change, rel=1e-9, abs=1e-15)
    assert slide.turned(spin, 1e-6) == pytest.approx(spin * 1e-6, rel=1e-5)
    assert (slide.turned(spin, 1 + 1e-6) - slide.turned(spin, 1 - 1e-6)) / 2e-6 == pytest.approx(
        slide.spin(spin, 1.0), rel=1e-7)


def test_a_tile_that_would_tip_along_the_wall_is_refused():
    with pytest.raises(ValueError, match="leaves the wall"):
        rotation.wall_slide(0.2, WIDTH, MASS, 3.0)


@pytest.mark.parametrize("radius", [0.014, 0.018, 0.0212, math.nan])
def test_a_circle_in_which_the_square_does_not_fit_has_no_seat_for_it(radius):
    """At 0.018 m two corners could be on it, but the other two would be beyond."""
    for refused in (lambda: rotation.seat(radius, WIDTH),
                    lambda: rotation.wall_rest(radius, WIDTH, 1.0),
                    lambda: rotation.wall_slide(radius, WIDTH, MASS, 0.25)):
        with pytest.raises(ValueError, match="at least half the diagonal"):
            refused()
    assert rotation.seat(math.sqrt(0.5) * WIDTH, WIDTH) == pytest.approx(0.0, abs=1e-12)


def test_along_the_wall_the_other_way_round_is_the_mirror_image():
    slide = rotation.wall_slide(0.2, WIDTH, MASS, 0.25)
    assert slide.turned(-2.0, 30.0) == -slide.turned(2.0, 30.0)
    assert slide.spin(-2.0, 30.0) == -slide.spin(2.0, 30.0)


def test_without_a_load_a_tilted_tile_stays():
    assert rotation.rocking_fall(0.0, MASS, WIDTH, 0.1) == (math.inf, 0.0)


@pytest.mark.parametrize("gap", [0.0, 1e-11])
@pytest.mark.parametrize("bodies", [(SMOOTH, SMOOTH), (HELD, SMOOTH), (HELD, EASY), (EASY, EASY)])
def test_tiles_that_touch_and_approach_are_in_contact(bodies, gap):
    start, twists = [(0, 0, 0), (WIDTH + gap, 0, 0)], [(0, 0, 0), (-1, 0, 0)]
    found = meet(start, twists, bodies, FIRST, LAW, until=0.01)
    assert (found.kind, found.time) == ("contact", pytest.approx(0.0, abs=1e-10))
    assert found.speed == pytest.approx(1.0, rel=1e-6)
    assert found.gap == pytest.approx(gap, abs=1e-10)


def test_tiles_that_touch_meet_where_they_attract_and_not_where_they_part():
    start = [(0, 0, 0), (WIDTH, 0, 0)]
    still = meet(start, np.zeros((2, 3)), (SMOOTH, SMOOTH), FIRST, LAW, until=0.01)
    assert (still.kind, still.time, still.speed) == ("contact", 0.0, 0.0)
    apart = meet(start, [(0, 0, 0), (1, 0, 0)], (SMOOTH, SMOOTH), FIRST, LAW, until=1e-3)
    assert apart.kind == "time"
    assert apart.gap > 9e-4


def test_tiles_that_overlap_are_refused():
    with pytest.raises(ValueError, match=r"overlap at the start, by 0\.01 m"):
        meet([(0, 0, 0), (WIDTH - 0.01, 0, 0)], np.zeros((2, 3)), (SMOOTH, SMOOTH), FIRST, LAW)


def test_what_two_tiles_cannot_meet_with_is_refused():
    """A held tile that had a twist stayed where it was, but hit with that speed."""
    start, still = [(0, 0, 0), (0.033, 0, 0)], np.zeros((2, 3))
    for body, twist in ((HELD, (0.1, 0, 0)), (HELD, (0, 0, 5.0)),
                        (Body(math.inf, INERTIA), (0, 0, 0))):
        with pytest.raises(ValueError, match="a tile of infinite mass is held"):
            meet(start, [twist, (0, 0, 0)], (body, HARD), FIRST, LAW)
    for name, value in (("alpha", math.nan), ("width", 0.0), ("beta", -0.001)):
        with pytest.raises(ValueError, match=f"{name} must be"):
            meet(start, still, (HELD, HARD), FIRST, LAW._replace(**{name: value}))
    with pytest.raises(ValueError, match="tolerance must be positive and finite, not 0"):
        meet(start, still, (HELD, HARD), FIRST, LAW, tolerance=0.0)


def test_a_row_flies_apart_at_the_spins_of_the_paper_s_magnets():
    """23.38 and 16.53 rad/s at the default cut-off, 29.13 and 20.60 with mating magnets alone."""
    for cutoff, spins in ((0.03, (23.38, 16.53)), (0.02, (29.13, 20.60))):
        bond = magnets.bond_force(*FIRST, magnets.Law(cutoff=cutoff, switch=0.1))
        for tiles, spin in zip((2, 3), spins, strict=True):
            assert rotation.critical_spin(bond, MASS, WIDTH, tiles) == pytest.approx(spin, abs=5e-3)
    with pytest.raises(ValueError, match="2 or 3"):
        rotation.critical_spin(bond, MASS, WIDTH, 4)
    with pytest.raises(ValueError, match="the bond must be at least 0"):
        rotation.critical_spin(-bond, MASS, WIDTH, 2)


def test_a_rocking_fall_is_the_pendulum_about_the_corner():
    load, tilt = 0.005, 0.2
    arm, inertia = WIDTH * math.sqrt(0.5), 2.0 / 3.0 * MASS * WIDTH**2

    def flat(t, z):
        return z[0]

    flat.terminal = True
    brute = solve_ivp(lambda t, z: (z[1], -load * arm / inertia * math.sin(0.25 * math.pi - z[0])),
                      (0.0, 5.0), (tilt, 0.0), "DOP853", events=flat, rtol=1e-12, atol=1e-14)
    fall = rotation.rocking_fall(load, MASS, WIDTH, tilt)
    assert fall.time == pytest.approx(brute.t[-1], rel=1e-9)
    assert fall.spin == pytest.approx(-brute.y[1, -1], rel=1e-9)


@pytest.mark.parametrize(("load", "tilt"), [(-1.0, 0.1), (math.nan, 0.1), (math.inf, 0.1),
                                            (1.0, -0.1), (1.0, 0.25 * math.pi), (1.0, math.nan)])
def test_a_fall_needs_a_load_that_presses_and_a_tilt_below_the_edge(load, tilt):
    with pytest.raises(ValueError, match=r"the (load|tilt) must be"):
        rotation.rocking_fall(load, MASS, WIDTH, tilt)


@pytest.mark.filterwarnings("error")
def test_the_time_of_a_fall_from_near_the_edge_grows_as_a_logarithm_at_any_size():
    """Near pi/4 the fall is that of an inverted pendulum: e-folds of its arm's rate."""
    for width, load in ((1e-3, 1e-5), (0.03, 0.005), (1.0, 10.0)):
        rate = math.sqrt(load * width * math.sqrt(0.5) / (2.0 / 3.0 * MASS * width**2))
        times = [rotation.rocking_fall(load, MASS, width, 0.25 * math.pi - off).time
                 for off in (1e-3, 1e-4, 1e-6)]
        assert np.diff(times) * rate == pytest.approx([math.log(10.0), math.log(100.0)], rel=1e-5)


def test_a_rocking_square_keeps_a_quarter_of_its_spin_where_it_sticks():
    """Housner from mu = 3/5 on; below it slips, and below 1/3 it ends flat."""
    for mu in (0.6, 1.0):
        hit = rotation.rocking_impact(2.0, MASS, WIDTH, mu)
        assert (hit.spin, hit.slip) == pytest.approx((0.5, 0.0), abs=1e-12)
    slips = rotation.rocking_impact(2.0, MASS, WIDTH, 0.45)
    assert slips.mode == "sliding"
    assert 0.0 < slips.spin < 0.5
    assert slips.slip < 0.0
    assert rotation.rocking_impact(2.0, MASS, WIDTH, 1 / 3).spin == pytest.approx(0.0, abs=1e-12)


def test_a_flat_landing_keeps_both_corners_down_within_their_cones():
    """Impulses of both corners, from the momentum it loses, press and rub at their limit."""
    mu, spin, half = 0.25, 2.0, 0.5 * WIDTH
    flat = rotation.rocking_impact(spin, MASS, WIDTH, mu)
    normal = MASS * half * spin
    tangential = MASS * (flat.slip + half * spin)
    assert tangential == pytest.approx(mu * normal)
    # about the centre: -half N1 + half N2 + half T = I (0 - spin), N1 + N2 = normal
    difference = (INERTIA * spin + half * tangential) / half
    new, old = 0.5 * (normal + difference), 0.5 * (normal - difference)
    assert new > old > 0.0


# The unicycle.


def test_the_coupled_tile_obeys_its_equation_of_motion():
    """Central differences of the velocity against drive, floor and damping, where it slides."""
    torque, h = 1e-4, 1e-4
    times = np.array([[t - h, t, t + h] for t in (1.5, 2.5, 3.5)]).ravel()
    z = unicycle.coupled_tile(times, mass=MASS, width=WIDTH, force=0.075, torque=torque,
                              frequency=0.1, mu=MU, linear_damping=0.8, angular_damping=0.5)
    for k in range(1, times.size, 3):
        u, heading = math.sin(0.2 * math.pi * times[k]), z[k, 2] + 0.5 * math.pi
        drag = ellipsoid_wrench(*z[k, 3:], WIDTH)
        rate = (z[k + 1, 3:] - z[k - 1, 3:]) / (2 * h)
        expected = [(u * 0.075 * math.cos(heading) + FLOOR * drag[0]) / MASS - 0.8 * z[k, 3],
                    (u * 0.075 * math.sin(heading) + FLOOR * drag[1]) / MASS - 0.8 * z[k, 4],
                    (u * torque + FLOOR * drag[2]) / INERTIA - 0.5 * z[k, 5]]
        assert rate == pytest.approx(expected, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(("force", "frequency", "mu", "damping"), [
    (0.075, 0.1, MU, 0.8),  # stops, and waits for the drive
    (0.3, 3.0, 0.05, 5.0), (0.1, 3.0, MU, 0.8)])  # turns round without a rest
def test_the_coupled_tile_without_torque_goes_straight_as_the_other_law_says(force, frequency, mu,
                                                                             damping):
    times = np.linspace(0.0, 3.0 / frequency, 61)
    common = {"mass": MASS, "force": force, "torque": 0.0, "frequency": frequency,
              "linear_damping": damping}
    z = unicycle.coupled_tile(times, width=WIDTH, mu=mu, **common)
    truth = motion.driven_tile(times, inertia=INERTIA, friction_force=mu * MASS * GRAVITY,
                               friction_torque=1.0, **common)
    assert np.abs(truth[:, 1]).max() > WIDTH
    assert np.abs(z - truth).max() < 1e-9


def test_a_load_inside_the_limit_surface_moves_nothing():
    z = unicycle.coupled_tile([5.0, 10.0], mass=MASS, width=WIDTH, force=0.8 * FLOOR,
                              torque=0.59 * MEAN_DISTANCE * WIDTH * FLOOR, frequency=0.1, mu=MU)
    assert (z == 0.0).all()


def test_the_fit_finds_the_parameters_of_a_true_unicycle():
    times = np.linspace(0.0, 20.0, 401)
    path = unicycle.kinematic(times, 0.8, 0.8, 2.5, 0.1)
    angle = path[:, 2] - 0.5 * math.pi
    fit = unicycle.fit(times, path[:, 0], path[:, 1], angle, 0.1)
    assert (fit.a, fit.omega) == pytest.approx((0.8, 2.5), rel=1e-4)
    assert (fit.path, fit.heading) == pytest.approx((0.0, 0.0), abs=1e-9)
    velocity = np.gradient(path[:, :2], times, axis=0)
    assert unicycle.along(angle, *velocity.T) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("begin", [2.5, 11.0])
def test_a_fit_to_a_record_that_begins_later_is_that_of_the_path_from_there(begin):
    times = np.linspace(begin, begin + 20.0, 401)
    x, y, phi = unicycle.kinematic(times, 0.8, 0.8, 2.5, 0.1).T
    fit = unicycle.fit(times, x - x[0], y - y[0], phi - 0.5 * math.pi, 0.1)
    assert (fit.a, fit.omega) == pytest.approx((0.8, 2.5), rel=1e-9)
    assert (fit.path, fit.heading) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(("omega", "frequency"), [(50.0, 0.1), (5.0, 60.0), (1e-9, 0.1)])
def test_a_long_record_of_a_true_unicycle_is_one(omega, frequency):
    times = np.linspace(0.0, 3600.0, 3617)
    path = unicycle.kinematic(times, 0.05, 0.05, omega, frequency)
    fit = unicycle.fit(times, path[:, 0], path[:, 1], path[:, 2] - 0.5 * math.pi, frequency)
    assert (fit.a, fit.omega) == pytest.approx((0.05, omega), rel=1e-6)
    assert fit.path < 1e-12
    few = np.linspace(0.0, 1.0, 100_001)
    path = unicycle.kinematic(few, 1.0, 2.0, omega, frequency)
    u = np.sin(2.0 * math.pi * frequency * few)
    for place, share, way in zip(path[:, :2].T, (1.0, 2.0), (np.cos, np.sin), strict=True):
        assert np.trapezoid(share * u * way(path[:, 2]), few) == pytest.approx(place[-1], abs=2e-6)


@pytest.mark.parametrize("there", [1.0, 100.0])
def test_where_standing_still_would_do_as_well_all_is_unexplained(there):
    """A tile that goes to and fro across its heading, however long its path."""
    times, none = np.linspace(0.0, 20.0, 401), np.zeros(401)
    x = 0.1 * (1.0 - np.cos(0.2 * math.pi * there * times))
    fit = unicycle.fit(times, x, none, none, 0.1)
    assert fit.a == pytest.approx(0.0, abs=1e-12)
    assert fit.path == pytest.approx(1.0)
    assert unicycle.along(none, np.gradient(x, times), none) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("torque", "path", "heading", "along"), [
    pytest.param(3e-5, 0.753, 0.028, 0.577, marks=pytest.mark.slow), (1e-4, 0.712, 0.015, 0.479),
    pytest.param(3e-4, 0.735, 0.010, 0.357, marks=pytest.mark.slow)])
def test_the_coupled_floor_makes_a_tile_turn_as_a_unicycle_and_not_go_as_one(
        torque, path, heading, along):
    times = np.linspace(0.0, 20.0, 401)
    z = unicycle.coupled_tile(times, mass=MASS, width=WIDTH, force=0.075, torque=torque,
                              frequency=0.1, mu=MU, linear_damping=0.8, angular_damping=0.5)
    fit = unicycle.fit(times, *z[:, :3].T, 0.1)
    assert (fit.path, fit.heading) == pytest.approx((path, heading), abs=1e-3)
    assert unicycle.along(*z[:, 2:5].T) == pytest.approx(along, abs=1e-3)


TILE = {"mass": MASS, "width": WIDTH, "force": 0.075, "torque": 1e-4, "frequency": 0.5, "mu": MU}


@pytest.mark.parametrize("none", [{"frequency": 0.0}, {"family": 0}, {"frequency": 0.0, "mu": 0.0},
                                  {"force": 0.0, "torque": 0.0, "gravity": 0.0}])
def test_a_tile_without_a_drive_stays(none):
    assert not unicycle.coupled_tile([0.0, 1.0, 2.0], **(TILE | none)).any()


@pytest.mark.parametrize("times", [[7.0], pytest.param([5.0], marks=pytest.mark.slow),
                                   pytest.param([0.0, 10.0, 20.0], marks=pytest.mark.slow)])
def test_times_at_which_the_tile_rests_may_be_all_that_is_asked(times):
    """No time is in the slides that end at 4.6 and 9.6 s and so on."""
    slow = TILE | {"frequency": 0.1}
    (*_, end) = unicycle.coupled_tile(times, **slow)
    whole = unicycle.coupled_tile(np.linspace(0.0, times[-1], 101), **slow)
    assert end == pytest.approx(whole[-1], abs=1e-9)


def test_a_tile_on_the_coupled_floor_moves_no_faster_as_it_starts_than_soon_after():
    """Times between the bound and the integrator's first, which starts a microsecond later."""
    start = math.asin(FLOOR / 0.075) / math.pi
    times = start + np.array([-1e-6, 0.3e-6, 0.9e-6, 1.5e-6, 1e-5])
    speed = unicycle.coupled_tile(times, **(TILE | {"torque": 0.0}))[:, 4]
    assert speed[0] == 0.0
    assert np.all(np.diff(speed) > 0.0)


@pytest.mark.parametrize("change", [
    {"force": -0.075}, pytest.param({"torque": -1e-4}, marks=pytest.mark.slow)])
def test_a_coupled_drive_of_either_sign_drives(change):
    """Backward is forward of a tile that faces the other way; a turn the other way, in a mirror."""
    times = [0.9, 1.7, 4.3]
    there = unicycle.coupled_tile(times, **(TILE | change))
    if "force" in change:
        same = unicycle.coupled_tile(times, **TILE, forward=-0.5 * math.pi)
    else:
        same = unicycle.coupled_tile(times, **TILE) * [-1, 1, -1, -1, 1, -1]
    assert there == pytest.approx(same, abs=1e-8)
    assert np.abs(there[-1, :3]).min() > 1e-3


def test_what_the_unicycle_is_not_defined_for_is_refused():
    with pytest.raises(ValueError, match=r"frequency must be at least 0 and finite, not -0\.5"):
        unicycle.coupled_tile([1.0], **(TILE | {"frequency": -0.5}))
    for name, value in (("mu", -0.25), ("mass", -0.016), ("gravity", -9.81), ("force", math.nan)):
        with pytest.raises(ValueError, match=f"{name} must be .* not {value}"):
            unicycle.coupled_tile([1.0], **(TILE | {name: value}))
    for times in ([2.0, 1.0], [-1.0, 1.0], [math.nan], [math.inf], [[0.0, 1.0]]):
        for of in (lambda t: unicycle.coupled_tile(t, **TILE),
                   lambda t: unicycle.kinematic(t, 1.0, 1.0, 1.0, 0.5)):
            with pytest.raises(ValueError, match="times must"):
                of(times)
    assert unicycle.kinematic([], 1.0, 1.0, 1.0, 0.5).shape == (0, 3)


@pytest.mark.parametrize("none", [{"mu": 0.0}, {"gravity": 0.0}])
def test_a_driven_tile_without_friction_is_only_accelerated(none):
    """m v = F (1 - cos(rate t))/rate along the heading, which stays without a torque."""
    times, rate = np.linspace(0.0, 4.0, 9), math.pi
    z = unicycle.coupled_tile(times, **(TILE | none | {"torque": 0.0}))
    assert z[:, 4] == pytest.approx(0.075 / MASS * (1.0 - np.cos(rate * times)) / rate, abs=1e-9)
    assert z[:, 1] == pytest.approx(
        0.075 / MASS * (times - np.sin(rate * times) / rate) / rate, abs=1e-9)
    z = unicycle.coupled_tile(times, **(TILE | none))
    assert z[:, 5] == pytest.approx(1e-4 / INERTIA * (1.0 - np.cos(rate * times)) / rate, abs=1e-7)


@pytest.mark.parametrize("forward", [0.0, 0.5 * math.pi])
def test_the_fit_of_a_tile_at_rest_is_no_motion(forward):
    times, none = np.linspace(0.0, 2.0, 21), np.zeros(21)
    assert unicycle.fit(times, none, none, none, 0.5, forward) == (0.0,) * 4


def test_at_frequency_zero_a_unicycle_stays_and_explains_nothing():
    """As :func:`coupled_tile`: sin 0 drives nothing."""
    times = np.linspace(0.0, 2.0, 21)
    path = unicycle.kinematic(times, 1.0, 1.0, 1.0, 0.0)
    np.testing.assert_array_equal(path, np.tile([0.0, 0.0, 0.5 * math.pi], (21, 1)))
    assert unicycle.fit(times, times, times, times, 0.0) == (0.0, 0.0, 1.0, 1.0)


@pytest.mark.parametrize("mu", [MU, 0.0])
def test_times_of_a_coupled_tile_increase_from_zero(mu):
    assert unicycle.coupled_tile([], **(TILE | {"mu": mu})).shape == (0, 6)
    for times in ([3.0, 1.0], [-1.0, 1.0], [0.0, math.nan]):
        with pytest.raises(ValueError, match="must increase, from 0"):
            unicycle.coupled_tile(times, **(TILE | {"mu": mu}))
