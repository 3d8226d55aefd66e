"""Impacts in the simulator against Routh's process, and against what must hold for all of them.

A tile is placed so that it touches in the middle of the first substep, where contacts are found:
the velocities after that substep are those after the impact.
"""

from __future__ import annotations

import cmath
import contextlib
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenes import (
    CHESSBOARD,
    GRAVITY,
    INERTIA,
    MASS,
    MU,
    WIDTH,
    cloud,
    material,
    momentum,
    scene,
    simulate,
    state,
    tile,
)
from twins import separations

from tbsa.model.layout import initial_layout
from tbsa.model.records import load_checkpoint, save_checkpoint
from tbsa.model.scene import Drive, Floor, Magnet, Material, Reactor, Run, Solver, TileType
from tbsa.model.simulation import Simulation, SimulationError
from tests.benchmarks import stress
from tests.benchmarks.invariants import beyond_wall, deepest
from theory import impact, rotation

H = 1 / 480
TOUCH = 1e-9 * WIDTH  # m, gap at the impact
FIXED = math.inf
DIAGONAL = WIDTH * math.sqrt(0.5)


def placed(centre, angle, v, spin, **kind):
    """A tile that is at `centre`, `angle` in the middle of the first substep."""
    start = centre - 0.5 * H * v
    return tile(start.real, start.imag, angle - 0.5 * H * spin, v.real, v.imag, spin, **kind)


def dot(u, v):
    return u.real * v.real + u.imag * v.imag


def velocity_at(v, spin, arm):
    return v + 1j * spin * arm


def predict(a, b, point, normal, mu, e):
    """Routh's impact of two bodies (centre, velocity, spin, mass): ``(mode, v_a, w_a, v_b, w_b)``.

    The normal leads from a to b.
    """
    tangent = 1j * normal
    arms = [point - body[0] for body in (a, b)]
    masses = [(body[3], body[3] * WIDTH**2 / 6.0) for body in (a, b)]
    b1, b2, b3 = impact.inverse_inertia(
        *masses[0], (dot(arms[0], tangent), dot(arms[0], normal)),
        *masses[1], (dot(arms[1], tangent), dot(arms[1], normal)))
    relative = velocity_at(b[1], b[2], arms[1]) - velocity_at(a[1], a[2], arms[0])
    p = impact.routh(dot(relative, normal), dot(relative, tangent), b1, b2, b3, mu, e)
    force = p.normal * normal + p.tangential * tangent
    result = [p.mode]
    for sign, (_, v, spin, mass), arm in ((-1.0, a, arms[0]), (1.0, b, arms[1])):
        torque = (arm.conjugate() * force).imag
        result += [v + sign * force / mass, spin + sign * torque / (mass * WIDTH**2 / 6.0)]
    return result


FRICTIONS, RESTITUTIONS = (0.0, 0.05, 0.25, 1.0, 3.0), (0.0, 0.2, 0.7, 1.0)


def blows(count, rng, flattest, steepest):
    """Angle, velocity and spin of tiles that come down with a corner.

    The angle is that of the nearer edge to the surface.
    """
    for _ in range(count):
        angle = rng.uniform(flattest, steepest)
        angle = rng.choice([angle, 0.5 * math.pi - angle])
        v = cmath.rect(rng.uniform(0.05, 0.5), rng.uniform(0.0, 2.0 * math.pi))
        yield angle, v, rng.normal() * 10.0


def corner_below(angle):
    """From the centre to the lowest corner of a tile turned by 0 < angle < 90 degrees."""
    return cmath.rect(DIAGONAL, angle - 0.75 * math.pi)


def compare(s, i, v, spin, size, error=1e-7):
    """Velocity and spin to `error` of `size`, the speed at the tile's rim."""
    assert s.vx[i] == pytest.approx(v.real, abs=error * size)
    assert s.vy[i] == pytest.approx(v.imag, abs=error * size)
    assert s.omega[i] == pytest.approx(spin, abs=6.0 * error * size / WIDTH)


MODES = {"sliding", "C-sticking", "R-sticking", "C-reversed", "R-reversed"}
STRUCK = {"held": (0j, 0.0, FIXED), "free": (0.05 + 0.02j, 1.0, MASS)}  # velocity, spin, mass


def strike(kind, rng, mu, e, flattest, steepest):
    """Tiles, far apart, each hit on the N face by the lowest corner of another one.

    Returns the simulation after the impacts, and for each pair what Routh's process says and
    the speed at the rim of the tile that came.
    """
    tiles, expected = [], []
    for angle, v, spin in blows(30, rng, flattest, steepest):
        place = complex(len(tiles) * 5.0 * WIDTH, 0.0)
        arm, point = corner_below(angle), place + complex(0.1 * WIDTH, 0.5 * WIDTH)
        centre, struck = point + 1j * TOUCH - arm, (place, *STRUCK[kind])
        approach = velocity_at(v, spin, arm) - velocity_at(struck[1], struck[2], point - place)
        if approach.imag > -0.02:
            continue
        tiles.append(placed(*struck[:1], 0.0, *struck[1:3], held=kind == "held"))
        tiles.append(placed(centre, angle, v, spin))
        result = predict(struck, (centre, v, spin, MASS), point, 1j, mu, e)
        expected.append((abs(v) + abs(spin) * WIDTH, *result))
    s = simulate(tiles, body=material(friction=mu, restitution=e), checked=False)
    energy = s.kinetic_energy()
    s.advance(1)
    assert s.counts.impacts[0] == len(expected)
    assert s.kinetic_energy() <= energy * (1.0 + 1e-12)
    return s, expected


@pytest.mark.parametrize("kind", STRUCK)
def test_a_corner_on_a_tiles_face_follows_rouths_process_in_every_mode(kind):
    """Velocities and spins of both after an oblique impact to 1e-7; energy never rises."""
    modes, rng = set(), np.random.default_rng(1)
    for mu, e in product(FRICTIONS, RESTITUTIONS):
        s, expected = strike(kind, rng, mu, e, 0.4, 0.25 * math.pi)
        for i, (size, mode, v_a, w_a, v_b, w_b) in enumerate(expected):
            compare(s, 2 * i, v_a, w_a, size)
            compare(s, 2 * i + 1, v_b, w_b, size)
            modes.add(mode)
    assert modes == MODES


@pytest.mark.parametrize("kind", STRUCK)
def test_a_corner_of_an_almost_flat_tile_follows_rouths_process_too(kind):
    """With the edge's other end near as well: the friction acts at the point that hits."""
    rng = np.random.default_rng(2)
    for mu, e in product(FRICTIONS, RESTITUTIONS):
        s, expected = strike(kind, rng, mu, e, 0.2, 0.4)
        for i, (size, _, v_a, w_a, v_b, w_b) in enumerate(expected):
            compare(s, 2 * i, v_a, w_a, size)
            compare(s, 2 * i + 1, v_b, w_b, size)


@pytest.mark.parametrize("shape", ["circle", "rectangle"])
def test_a_corner_on_a_wall_follows_rouths_process_in_every_mode(shape):
    """The corner hits the wall at its lowest point; friction and restitution are the wall's."""
    modes, rng, point = set(), np.random.default_rng(3), complex(0.0, -0.1)
    for mu, e in product(FRICTIONS, RESTITUTIONS):
        reactor = (Reactor("circle", 0.1, friction=mu, restitution=e) if shape == "circle" else
                   Reactor("rectangle", width=0.2, height=0.2, friction=mu, restitution=e))
        for angle, v, spin in blows(8, rng, 0.4, 0.25 * math.pi):
            arm = corner_below(angle)
            if velocity_at(v, spin, arm).imag > -0.02:
                continue
            centre = point + 1j * TOUCH - arm
            s = simulate([placed(centre, angle, v, spin)], reactor=reactor, checked=False,
                         body=material(friction=0.7, restitution=0.5))
            energy = s.kinetic_energy()
            s.advance(1)
            assert s.counts.impacts[0] == 1
            assert s.kinetic_energy() <= energy * (1.0 + 1e-12)
            mode, after, turning, *_ = predict(
                (centre, v, spin, MASS), (0j, 0j, 0.0, FIXED), point, -1j, mu, e)
            compare(s, 0, after, turning, abs(v) + abs(spin) * WIDTH)
            modes.add(mode)
    assert modes == MODES


GROUNDS = {
    "one held tile": [tile(0, -0.5 * WIDTH, held=True)],
    "two held tiles": [tile(i * 0.5 * WIDTH, -0.5 * WIDTH, held=True) for i in (-1, 1)],
    "a straight wall": [],
}


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("mu", [0.61, 1.0, 5.0])
@pytest.mark.parametrize("ground", GROUNDS)
def test_a_rocking_square_keeps_a_quarter_of_its_spin_at_each_impact(ground, mu, side):
    """Housner: w+/w- = 1 - 3/2 sin^2(45 deg) = 1/4 for e = 0 where the new corner sticks.

    It turns about one corner and lands on the other, which needs mu >= 3/5.
    """
    held = GROUNDS[ground]
    reactor = None if held else Reactor("rectangle", width=1.0, height=1.0, friction=mu,
                                        restitution=0.0)
    spin, tilt = 2.0 * side, 1e-7 * side
    pivot = complex(side * 0.5 * WIDTH, (0.0 if held else -0.5) + 1e-12)
    arm = cmath.rect(DIAGONAL, (0.75 if side > 0 else 0.25) * math.pi - tilt)
    centre = pivot + arm
    s = simulate([*held, placed(centre, -tilt, 1j * spin * arm, spin)], reactor=reactor,
                 body=material(friction=mu, restitution=0.0), checked=False)
    s.advance(1)
    i = len(held)
    new = -complex(pivot.real, 0.5 * WIDTH)  # the corner that it lands on, from the centre
    assert s.omega[i] == pytest.approx(0.25 * spin, rel=1e-5)
    landed = velocity_at(complex(s.vx[i], s.vy[i]), s.omega[i], new)
    assert abs(landed) < 1e-5 * abs(spin) * WIDTH
    old = velocity_at(complex(s.vx[i], s.vy[i]), s.omega[i], new.conjugate() * -1.0)
    assert old.imag > 0.2 * abs(spin) * WIDTH


@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("where", ["free", "on a floor", "pressed to a wall"])
def test_an_impact_goes_through_a_row_at_the_papers_tolerance(where, e):
    """Its last tiles go as at a tolerance that is two thousand times less, to a twentieth of the
    speed of the first."""
    wall = where == "pressed to a wall"
    parts = {"body": Material(friction=0.25, restitution=e, linear_damping=0.0,
                              angular_damping=0.0)}
    if wall:
        parts |= {"reactor": Reactor("rectangle", width=0.4, height=0.4, friction=0.1),
                  "drive": Drive("constant", (0.0, -0.05))}
    elif where == "on a floor":
        parts["floor"] = Floor()
    y, found = (0.5 * WIDTH - 0.2 if wall else 0.0), []
    for solver in (RECOMMENDED, {**RECOMMENDED, "tolerance": 1e-5, "passes": 2000}):
        s = simulate([tile(i * WIDTH, y) for i in range(3)] + [tile(-1.6 * WIDTH, y, vx=0.4)],
                     **parts, **solver)
        s.run(0.1)
        found.append(state(s)[3])
    assert found[0] == pytest.approx(found[1], abs=0.02)


@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("far", [1.0, 3.0, 10.0])
def test_an_impact_goes_as_far_whatever_hits_elsewhere_at_the_same_time(far, e):
    """At a tolerance of 0.02 m/s, of rows of three that are hit at 0.3 m/s and, 5 m from there and
    at the same time, as fast as `far` (m/s), the first goes on as if it were alone."""
    def hit(speed, y):
        return [tile(-WIDTH - 0.3 * speed * H, y, vx=speed),
                *(tile(i * WIDTH, y) for i in range(3))]

    alone, both = (simulate(tiles, body=material(restitution=e, friction=MU), tolerance=0.02,
                            passes=80) for tiles in (hit(0.3, 0.0),
                                                     hit(0.3, 0.0) + hit(far, 5.0)))
    for s in (alone, both):
        s.advance(5)
    assert state(both)[:, :4] == pytest.approx(state(alone), abs=1e-3)


@pytest.mark.parametrize("steps", [1, 10])
@pytest.mark.parametrize("ground", GROUNDS)
def test_a_square_that_rocks_under_a_load_loses_what_housner_says(ground, steps):
    """It rests on one corner, which bears the load, and lands on the other, whose gap is open yet
    in the middle of the substep, as are those of a joint below: all of its edge takes part.  What
    bears the load from then on has none of it before."""
    held = GROUNDS[ground]
    reactor = None if held else Reactor("rectangle", width=1.0, height=1.0, friction=1.0,
                                        restitution=0.0)
    load, tilt = 0.005, 0.2
    fall = rotation.rocking_fall(load, MASS, WIDTH, tilt).spin
    centre = cmath.rect(DIAGONAL, 0.75 * math.pi - tilt) + complex(
        0.5 * WIDTH, 0.0 if held else -0.5)
    s = simulate([*held, tile(centre.real, centre.imag, -tilt)], reactor=reactor,
                 body=material(friction=1.0, restitution=0.0),
                 drive=Drive("constant", (0.0, -load)), step=1 / (480 * steps), substeps=4,
                 tolerance=1e-5 / steps, passes=400)
    most = top = 0.0
    while most < 0.9 * fall or s.omega[-1] > 0.7 * most:
        s.advance(1)
        most = max(most, s.omega[-1])
    assert most == pytest.approx(fall, rel=0.01)
    slowed = 0.75 * load / (MASS * WIDTH) * s.h  # at most, by the load in the step of the landing
    assert 0.99 * 0.25 * fall - slowed <= s.omega[-1] <= 1.01 * 0.25 * fall
    while s.omega[-1] > 0.0:
        s.advance(1)
        top = max(top, s.angle[-1])
    # It goes up to where the load has done the work that its spin was after the landing.
    kept = MASS * (WIDTH * 0.25 * fall)**2 / 3.0
    assert 0.5 * load * WIDTH * (math.cos(top) + math.sin(top) - 1.0) == pytest.approx(kept,
                                                                                       rel=0.01)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("mu", [0.0, 0.25, 1.0])
def test_a_flat_hit_gives_no_spin(mu, e):
    """Both ends of the edge hit at once with equal impulses."""
    s = simulate([tile(held=True), placed(complex(0, WIDTH + TOUCH), 0.0, -0.3j, 0.0)],
                 body=material(friction=mu, restitution=e))
    s.advance(1)
    assert s.counts.impacts[0] == 2
    assert s.vy[1] == pytest.approx(0.3 * e, abs=1e-12)
    assert s.omega[1] == pytest.approx(0.0, abs=1e-10)
    assert s.vx[1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("mu", [0.0, 0.25, 1.0])
def test_two_tiles_that_hit_one_from_both_sides_leave_it_at_rest(mu, e):
    """v -> -e v for both, by symmetry, whatever the order in which contacts are solved."""
    far = complex(WIDTH + TOUCH, 0.0)
    s = simulate([placed(far, 0.0, -0.3 + 0j, 0.0), tile(),
                  placed(-far, 0.0, 0.3 + 0j, 0.0)], body=material(friction=mu, restitution=e))
    s.advance(1)
    assert s.counts.impacts[0] == 4
    assert s.vx == pytest.approx([0.3 * e, 0.0, -0.3 * e], abs=1e-10)
    assert s.vy == pytest.approx(np.zeros(3), abs=1e-10)
    assert s.omega == pytest.approx(np.zeros(3), abs=1e-8)


@pytest.mark.parametrize("e", [0.0, 0.2, 1.0])
def test_a_row_that_is_hit_at_its_end_shares_the_momentum_among_all(e):
    """Compression ends at one velocity v/6 of all; each contact gives back e of its impulse.

    So v_i' = (1 + e) v/6 - e v_i: for e = 1 with no loss of energy.
    """
    row = [tile(i * WIDTH, 0.0) for i in range(5)]
    s = simulate([*row, placed(complex(-WIDTH - TOUCH, 0.0), 0.0, 0.3 + 0j, 0.0)],
                 body=material(friction=0.25, restitution=e))
    s.advance(1)
    before = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    assert s.vx == pytest.approx((1.0 + e) * 0.05 - e * before, abs=1e-9)
    assert np.abs(s.omega).max() < 1e-7


def test_an_impact_slower_than_the_threshold_is_plastic():
    """At 1 cm/s restitution ends: faster comes back as e v, slower not at all."""
    for speed, expected in ((0.0101, 0.5 * 0.0101), (0.0099, 0.0)):
        s = simulate([tile(held=True), placed(complex(0, WIDTH + TOUCH), 0.0, -1j * speed, 0.0)],
                     body=material(restitution=0.5, restitution_threshold=0.01))
        s.advance(1)
        assert s.vy[1] == pytest.approx(expected, abs=1e-6)


def test_a_load_does_not_count_as_speed_of_an_impact():
    """A pressed tile at rest stays: h F/m is far above the threshold here, and no impact."""
    s = simulate([tile(held=True), tile(0, WIDTH)], body=material(restitution=1.0),
                 drive=Drive("constant", (0.0, -10.0)))
    s.advance(100)
    assert s.counts.impacts[0] == 0
    assert s.vy[1] == pytest.approx(0.0, abs=1e-9)


def cluster(rng, n):
    """Tiles all but touching, with velocities and spins at random."""
    cells = rng.permutation(9)[:n]
    return [tile((cell % 3) * 1.012 * WIDTH + rng.uniform(-1, 1) * 2e-3 * WIDTH,
                 (cell // 3) * 1.012 * WIDTH + rng.uniform(-1, 1) * 2e-3 * WIDTH,
                 rng.uniform(-1, 1) * 3e-3, *(0.4 * rng.normal(size=2)), 5.0 * rng.normal(),
                 held=False) for cell in cells.tolist()]


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.floats(0.0, 1.0),
       st.sampled_from([0.0, 0.2, 0.7, 1.0]), st.booleans())
# What was to hit first does not; what hits next got its place and direction.
@example(4771, 5, 0.0, 0.0, False)
def test_no_cluster_gains_energy_or_momentum_in_an_impact(seed, n, mu, e, tight):
    """Kinetic energy never rises and momentum is kept, also where the solver stops early."""
    solver = {"tolerance": 1e-10, "passes": 5000} if tight else {"tolerance": 3e-4, "passes": 8}
    s = simulate(cluster(np.random.default_rng(seed), n),
                 body=material(friction=mu, restitution=e), **solver)
    for _ in range(3):
        energy, (before, _) = s.kinetic_energy(), momentum(s)
        s.advance(1)
        after, scale = momentum(s)
        assert s.kinetic_energy() <= energy * (1.0 + 1e-12)
        assert (np.abs(after - before) <= 1e-12 * scale).all()
    assert np.isfinite(state(s)).all()


@pytest.mark.parametrize("seed", [230, 1190, 1358, 2957, 3363, 4978, 5993, *range(60)])
def test_what_hits_several_times_in_a_substep_stays_outside(seed):
    """Spinning tiles hit each other with one corner after the other, and several others: in the
    order of time, each where it then is, also beside a corner that rests there or leaves.

    Neither does one come inside another, nor is momentum lost or energy gained.  The first seeds
    were 0.9 to 3.6 % of the width inside as long as a search for a meeting could end beside a
    corner that leaves, what hit together did so where it is at the beginning of the substep, or
    what came first was told by straight ways; of 6000 seeds the worst is now 0.71 %.
    """
    random = np.random.default_rng(seed)
    tiles = [replace(each, spin=float(200 * random.normal()))
             for each in cloud(int(random.integers(3, 9)), seed, 1.5)]
    s = simulate(tiles, body=material(restitution=0.2), step=1 / 480, substeps=3, tolerance=1e-5,
                 passes=200)
    energy, (before, _) = s.kinetic_energy(), momentum(s)
    s.advance(40)
    after, scale = momentum(s)
    assert s.counts.impacts[0] > 0
    assert s.counts.deepest[0] < 0.008 * WIDTH
    assert (np.abs(after - before) <= 1e-11 * scale).all()
    assert s.kinetic_energy() <= energy * (1.0 + 1e-12)


def test_impacts_scale_with_the_tile():
    """The same collision of tiles ten times as wide and as fast: velocities times ten."""
    small = [tile(0, 0, 0.2, 0.3, 0.0, 4.0), tile(0.05, 0.01, 1.1, -0.2, 0.0, -3.0)]
    large = [tile(0, 0, 0.2, 3.0, 0.0, 4.0), tile(0.5, 0.1, 1.1, -2.0, 0.0, -3.0)]
    one = simulate(small, body=material(friction=0.5, restitution=0.5))
    ten = simulate(large, body=material(friction=0.5, restitution=0.5, width=10 * WIDTH,
                                        mass=3 * MASS))
    for s in (one, ten):
        s.run(0.1)
        assert s.counts.impacts[0] > 0
    for name in ("vx", "vy"):
        assert getattr(ten, name) == pytest.approx(10.0 * getattr(one, name), abs=1e-9)
    assert ten.omega == pytest.approx(one.omega, abs=1e-8)
    assert ten.numbers.inertia == pytest.approx(300 * INERTIA)


@pytest.mark.parametrize("speed", [1.0, 2.0, 4.0, 6.0])
def test_a_tile_that_is_thrown_in_an_impact_does_not_turn_into_its_neighbour(speed):
    """Its one corner touches; the other, 2.2 % of the width away, is no point of the manifold
    while the tile is at rest.  A third tile gives it a spin that closes that gap at once."""
    turn, low = 0.022, -0.4 * WIDTH
    lean = 0.5 * WIDTH * (1.0 + math.cos(turn) + math.sin(turn))
    corner = complex(lean + 0.5 * WIDTH + 0.4 * WIDTH * turn, low)
    s = simulate([tile(held=True), placed(complex(lean, 0.0), turn, 0j, 0.0),
                  placed(corner + DIAGONAL + 0.1 * WIDTH, math.pi / 4, -speed + 0j, 0.0)],
                 body=material(friction=0.25, restitution=0.2), step=1 / 480, substeps=4,
                 tolerance=1e-3, passes=40)
    s.run(0.02 / speed)
    assert s.counts.impacts[0] > 0
    assert s.counts.deepest[0] < 5e-3 * WIDTH


# As flights end wherever they do in a substep, under loads and in company.

def knocked_off(part):
    """Leans on a wall, is hit beside its middle, and hits a third one."""
    return [tile(0, 0.5 * WIDTH - 0.2),
            tile(-(1.3 + part) * WIDTH, 1.2 * WIDTH - 0.2, vx=1.5),
            tile(1.06 * WIDTH, 0.56 * WIDTH - 0.2, 0.05)], 0.5, 0.25, 0.058


def hit_from_above(part):
    """One corner falls on a tile that lies on two."""
    return [*(tile(i * WIDTH, -WIDTH, held=True) for i in (-0.5, 0.5)), tile(0.4 * WIDTH, 0),
            tile(0.85 * WIDTH, (1.7 + part) * WIDTH, 0.3, 0, -1.5)], 0.5, 0.25, 0.05


def slid_into_a_corner(part):
    """Slides along one side of a rectangle until it hits the other one."""
    return [tile(0.1 + part * WIDTH, 0.5 * WIDTH - 0.2, vx=0.5)], 0.5, 0.1, 0.25


def pushed_in_a_row(part):
    """Slides along a wall until it hits three that lean there."""
    y = 0.5 * WIDTH - 0.2
    return [*(tile(i * WIDTH, y) for i in range(3)),
            tile(-(2.0 + part) * WIDTH, y, vx=0.5)], 0.2, 0.1, 0.2


@pytest.mark.parametrize(("what", "substeps", "most"), [
    (knocked_off, 4, 4e-3), (knocked_off, 1, 8e-3), (hit_from_above, 1, 2e-4),
    (slid_into_a_corner, 4, 1e-5), (slid_into_a_corner, 1, 2e-5), (pushed_in_a_row, 4, 4e-5),
    (pushed_in_a_row, 1, 4e-5)])
def test_what_is_hit_where_it_lies_does_not_depend_on_the_moment_in_a_substep(what, substeps, most):
    """Velocities (m/s), and places in a tenth of a second's way at them, after hits on what a load
    presses against a wall, or on what lies on two, against a 16th of the step or less."""
    for part in np.linspace(0.0, 0.3, 13):
        tiles, e, mu, time = what(part)
        found = []
        for step, tight in ((1 / 480, {"substeps": substeps, "tolerance": 1e-5, "passes": 40}),
                            (1 / 7680, {"substeps": 4, "tolerance": 1e-9, "passes": 2000})):
            s = simulate(tiles, reactor=Reactor("rectangle", width=0.4, height=0.4, friction=mu,
                                                restitution=e),
                         drive=Drive("constant", (0.0, -0.05)), step=step, **tight,
                         body=material(friction=mu, restitution=e, restitution_threshold=0.01))
            s.run(round(480 * time) / 480)
            found.append(state(s) * np.array([[10.0, 10.0, 10.0 * WIDTH, 1.0, 1.0, WIDTH]]).T)
        assert np.abs(found[1] - found[0]).max() < most


RECOMMENDED = {"step": 1 / 120, "substeps": 12, "tolerance": 2e-2, "passes": 80, "at_rest": 0.025}
DEFAULT = {"step": 1 / 480, "substeps": 4, "tolerance": 1e-5, "passes": 40}


def near_the_wall(seed):
    """Three tiles that come down on a side, almost flat."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-0.02, 0.02, 3)
    heights = 0.5 * WIDTH * (np.cos(angles) + abs(np.sin(angles))) + rng.uniform(0.0, 5e-5, 3)
    return [tile(0.06 * (i - 1), y - 0.05, angle, rng.uniform(-0.05, 0.05), -rng.uniform(0.0, 0.02),
                 rng.uniform(-1.0, 1.0))
            for i, (angle, y) in enumerate(zip(angles, heights, strict=True))]


def test_what_comes_to_rest_on_a_rough_wall_stays_out_of_it():
    """A corner that comes slower than a solve may leave it, beside one that rests: what forces give
    is borne there, and nothing of the speed that it has, which an impact takes."""
    for seed, e in product(range(40), (0.2, 0.5, 1.0)):
        s = simulate(near_the_wall(seed), **RECOMMENDED, drive=Drive("constant", (0.003, -0.02)),
                     body=material(friction=1.0, restitution=e, restitution_threshold=0.01),
                     reactor=Reactor("rectangle", width=0.2, height=0.1, friction=1.0,
                                     restitution=e))
        for _ in range(60):
            s.advance(1)
            assert beyond_wall(s.scene, s.x, s.y, s.angle) < 2e-3


def rocking_and_hit(seed):
    """Rocks down onto a side under 0.1 N, and is hit before it lands; tiles, e, mu and how long."""
    rng = np.random.default_rng(seed)
    e, mu = float(rng.choice([0.2, 0.5, 0.9])), float(rng.choice([0.0, 0.25]))
    tilt = rng.uniform(0.002, 0.02) * rng.choice([-1, 1])
    fall = rng.uniform(0.3, 1.0) * math.sqrt(5.0 * abs(tilt) * INERTIA / (0.1 * 0.5 * WIDTH))
    low = 0.5 * WIDTH * (math.cos(tilt) + abs(math.sin(tilt)))
    angle, speed = rng.uniform(-0.7, 0.7), rng.uniform(0.5, 2.0)
    high = 2.0 * low + 0.5 * WIDTH * (math.cos(angle) + abs(math.sin(angle))) + speed * fall
    return [tile(0, low + TOUCH - 0.1, tilt),
            tile(rng.uniform(-0.02, 0.02), high - 0.1, angle, rng.uniform(-0.3, 0.3), -speed)
            ], e, mu, math.floor((fall + 0.0125) * 480) / 480


def off_when_hit(seed):
    """By how much velocities (m/s) differ from those at a 32nd of the step."""
    tiles, e, mu, time = rocking_and_hit(seed)
    found = []
    for step, substeps in ((1 / 480, 4), (1 / 15360, 1)):
        s = simulate(tiles, drive=Drive("constant", (0.0, -0.1)), step=step, substeps=substeps,
                     passes=80, reactor=Reactor("rectangle", width=0.4, height=0.2, friction=mu,
                                                restitution=0.2),
                     body=material(friction=mu, restitution=e, restitution_threshold=0.01))
        s.run(time)
        found.append(np.array([s.vx, s.vy, 0.5 * WIDTH * s.omega]))
    return np.abs(found[1] - found[0]).max()


@pytest.mark.parametrize("seed", [1101, 1208, 1507, 1952, 2434, 2778, 2824, 3259])
def test_what_rests_on_one_corner_and_comes_down_with_the_other_is_hit_with_what_bears_it(seed):
    """As the other corner was to hit later, it bounced as if there were no wall, and into it."""
    assert off_when_hit(seed) < 0.01


def test_of_what_rocks_onto_a_wall_and_is_hit_few_depend_on_the_step():
    """Whether corners hit a wall together or one after the other is a matter of chance for a few; a
    third was off by more than 0.03 m/s where a tile bounced as if no wall bore it, or came back to
    it, in the same substep, as if it had been pressed all along."""
    errors = [off_when_hit(seed) for seed in range(120)]
    assert np.median(errors) < 1e-3
    assert np.mean(np.array(errors) > 0.03) < 0.12


def energy_left_of_spin(tilt, step):
    """Of a smooth tile that rocks down onto a wall about a corner, which slides, under 0.16 N: the
    part of its spin that its energy after landing stands for, and points that hit.

    It lands with F w (sin + cos - 1)/2 = J spin^2/2; both corners then press, and by Poisson's law
    it leaves with e times the spin.
    """
    load, e, radius = 0.16, 0.2, WIDTH / math.sqrt(2.0)
    at = tilt + math.pi / 4.0
    s = simulate([tile(radius * math.cos(at), radius * math.sin(at) - 0.1, tilt)], step=step,
                 substeps=4, tolerance=1e-5, drive=Drive("constant", (0.0, -load)),
                 reactor=Reactor("rectangle", width=0.8, height=0.2, friction=0.0, restitution=e),
                 body=material(friction=0.0, restitution=e, restitution_threshold=0.01))
    fall = 0.5 * WIDTH * (math.sin(tilt) + math.cos(tilt) - 1.0)
    inertia = INERTIA + MASS * WIDTH**2 / 4.0  # of sliding and turning, flat on the wall
    spin = -math.sqrt(2.0 * load * fall / inertia)
    for _ in range(round(0.2 / step)):
        before = s.omega[0]
        s.advance(1)
        if before < -2.0 and s.omega[0] > 0.5 * before and s.angle[0] < 0.02:
            break
    energy = s.kinetic_energy() + load * (s.y[0] + 0.1 - 0.5 * WIDTH)
    return math.sqrt(2.0 * energy / inertia) / -spin, int(s.counts.impacts[0])


@pytest.mark.parametrize("step", [1 / 240, 1 / 480, 1 / 1920])
def test_what_rocks_down_onto_a_wall_lands_on_both_corners_in_any_phase_of_a_step(step):
    """The corner that it rests on leaves along its arc while the tile flies on to where the other
    lands, as nothing presses it there: it was taken to be off the wall in half of the cases, and
    the tile bounced from one corner to the other, with 0.8 of the spin that is left."""
    for tilt in np.arange(0.25, 0.48, 0.02):
        left, hits = energy_left_of_spin(tilt, step)
        assert left == pytest.approx(0.2, rel=3e-3)
        assert hits == 1


@pytest.mark.parametrize("step", [1 / 480, 1 / 1920])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_a_corner_that_a_tile_rocks_on_bears_whatever_the_threshold(tolerance, step):
    """In the middle of a substep it is off the wall by what its arc takes. Where that was more than
    the tolerances let a point be that is still on its way, it lost its impulse in each substep, and
    the next hit took it for open: at a tolerance of 1e-9 m/s and 1/480 s 9 of these 10 tiles came
    off with 0.86 of that energy, and none was seen to press on the wall."""
    load, e, half, radius = 0.05, 0.5, 0.5 * WIDTH, WIDTH / math.sqrt(2.0)
    flat = INERTIA + MASS * half**2  # of sliding and turning on a corner, flat on the wall
    for tilt in (0.011, 0.017, 0.023, 0.031, 0.042):
        for spin in (-1.3, -3.7):
            at, lever = tilt + 0.25 * math.pi, half * (math.cos(tilt) - math.sin(tilt))
            s = simulate(
                [tile(half, radius * math.sin(at) - 0.1, tilt, vy=lever * spin, spin=spin)],
                step=step, substeps=4, tolerance=tolerance, join_substeps=False,
                drive=Drive("constant", (0.0, -load)), body=material(friction=0.0, restitution=e),
                reactor=Reactor("rectangle", width=0.8, height=0.2, friction=0.0, restitution=e))
            fall = load * half * (math.sin(tilt) + math.cos(tilt) - 1.0)
            lands = 0.5 * (INERTIA + MASS * lever**2) * spin**2 + fall
            s.advance(1)
            assert s.contact_forces()["normal0"].size == 1
            while s.omega[0] < 0.0:
                s.advance(1)
            left = s.kinetic_energy() + load * (s.y[0] + 0.1 - half)
            assert left == pytest.approx(e**2 * lands, rel=0.03), (tilt, spin)
            assert 0.5 * flat * s.omega[0]**2 < 1.01 * e**2 * lands


@pytest.mark.parametrize("radius", [1.0, 1.2, 1.5, 2.0])
@pytest.mark.parametrize("speed", [5.0, 14.0])
def test_a_smooth_tile_that_is_thrown_round_in_a_narrow_round_wall_stays_inside(radius, speed):
    """It comes to lie on the wall with an edge, and goes round with it. Where it turned by more
    than 0.1 rad in a substep it bounced 60 times in each, and was up to 0.07 of its width outside,
    for more than half of the time, at 14 m/s and 1.2 widths."""
    clear = (radius - 0.72) * WIDTH
    s = simulate([tile(0.9 * clear * math.cos(0.7), 0.9 * clear * math.sin(0.7), 0.9,
                       -speed * math.sin(0.7), speed * math.cos(0.7))], step=1 / 480, substeps=4,
                 reactor=Reactor("circle", radius=radius * WIDTH, friction=0.0, restitution=0.2),
                 body=material(friction=0.0, restitution=0.2, restitution_threshold=0.01),
                 tolerance=1e-5, passes=40)
    for _ in range(240):
        s.advance(1)
        assert beyond_wall(s.scene, s.x, s.y, s.angle) < 3e-3
    assert s.counts.impacts[0] < 100


NEAR_CORNERS = [  # two tiles each (x, y, angle, vx, vy, spin), and steps a second
    ((0, 0, 1.20035, 0.3406, -0.4584, -2.959),
     (-0.005103, -0.036154, 4.7591, -0.2383, 0.18, 3.389), 480),
    ((0, 0, 1.4664, 0.2942, -0.5915, -148.754),
     (-0.037261, -0.020906, 1.7276, 0.5713, -0.0481, -151.863), 480),
    ((0, 0, 3.56274, -0.8301, 0.2131, 36.2),
     (-0.045219, 0.020035, 3.97614, 0.4085, -0.9256, 111.303), 120)]


@pytest.mark.parametrize(("a", "b", "rate"), NEAR_CORNERS)
def test_what_has_hit_near_a_corner_is_not_moved_apart(a, b, rate):
    """After a hit tiles are where their new velocities come from, within each other; there another
    face may be the nearest, and its gap seems to close further. They were moved out of it, and one
    hit of smooth elastic tiles took 0.2, 1.2 and 11 % of their energy."""
    s = simulate([tile(*a), tile(*b)], body=material(friction=0.0, restitution=1.0), step=1 / rate,
                 substeps=4, tolerance=1e-5, passes=40)
    before = s.kinetic_energy()
    s.advance(2)
    assert s.counts.impacts[0] == 1
    assert s.counts.projections[0] == 0
    assert s.kinetic_energy() == pytest.approx(before, rel=1e-13)


@pytest.mark.parametrize(("force", "step"), [(1.0, 1 / 60), (5.0, 1 / 60), (5.0, 1 / 120)])
def test_a_load_that_comes_on_in_calm_presses_nothing_into_the_wall(tmp_path, force, step):
    """Substeps are joined while a tile lies still 30 um from a wall; what then pushes it brings it
    further in one of these than anything has foreseen: by up to 0.18 of its width, and the
    wall pushed it out against the load."""
    (tmp_path / "on.py").write_text(
        "def on(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):\n"
        "    if t >= p[0]:\n        fx += p[1]\n")
    gap = 3e-5
    s = simulate([tile(0.1 - 0.5 * WIDTH - gap, 0)], step=step, substeps=4, tolerance=1e-5,
                 reactor=Reactor("rectangle", width=0.2, height=0.2, friction=0.0, restitution=0.5),
                 drive=Drive("user", module=str(tmp_path / "on.py"), function="on",
                             parameters=(0.1, force)),
                 body=material(friction=0.0, restitution=0.5))
    s.run(0.1)
    for _ in range(round(0.1 / step)):
        s.advance(1)
        way = s.x[0] - (0.1 - 0.5 * WIDTH - gap)
        assert way < gap + 2e-3 * WIDTH
        assert s.kinetic_energy() <= force * way + 1e-12


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
def test_two_smooth_elastic_tiles_keep_their_energy_however_they_meet(solver):
    """Three hundred pairs that tumble into each other at 0.3 m/s: corners that will meet in the
    substep or only after it, second corners that meet before it ends.  None loses a hundredth."""
    random = np.random.default_rng(7)
    for _ in range(300):
        (angle_a, angle_b), (spin_a, spin_b) = random.uniform(-3, 3, 2), random.uniform(-15, 15, 2)
        s = simulate([tile(-WIDTH, 0, angle_a, 0.15, 0, spin_a),
                      tile(WIDTH, random.uniform(-0.8, 0.8) * WIDTH, angle_b, -0.15, 0, spin_b)],
                     body=material(friction=0.0, restitution=1.0), **solver)
        energy = s.kinetic_energy()
        s.run(0.35)
        assert energy * (1 - 1e-2) < s.kinetic_energy() < energy * (1 + 1e-12)


@pytest.mark.parametrize("fast", [0.3, 3.0])
def test_a_slow_bounce_is_not_lost_to_a_fast_one_elsewhere(fast):
    """Corners on faces, at 0.2 mm/s and, a metre away, a thousand times as fast or more."""
    def pair(x, speed):
        centre = complex(x + 0.5 * WIDTH + DIAGONAL + TOUCH, 0.002)
        return [tile(x, held=True), placed(centre, 0.25 * math.pi, complex(-speed, 0.0), 0.0)]

    s = simulate(pair(0.0, fast) + pair(1.0, 2e-4), body=material(friction=0.0, restitution=1.0))
    s.advance(1)
    assert s.vx[3] == pytest.approx(2e-4, rel=1e-6)
    assert s.vx[1] == pytest.approx(fast, rel=1e-6)


def test_two_tiles_meet_as_they_would_if_nothing_else_were_in_the_world():
    """A tile that bounces between two held ones ten metres away shares a block of rows with them:
    none of 250 pairs comes to notice."""
    random = np.random.default_rng(7)
    far = [tile(10.0, held=True), tile(10.0 + WIDTH + 7e-4, vx=2.0),
           tile(10.0 + 2 * WIDTH + 1.4e-3, held=True)]
    for _ in range(250):
        (angle_a, angle_b), (spin_a, spin_b) = random.uniform(-3, 3, 2), random.uniform(-15, 15, 2)
        pair = [tile(-WIDTH, 0, angle_a, 0.08, 0, spin_a),
                tile(WIDTH, random.uniform(-0.8, 0.8) * WIDTH, angle_b, -0.08, 0, spin_b)]
        alone, together = (simulate(tiles, body=material(friction=0.0, restitution=1.0),
                                    join_substeps=False, **RECOMMENDED)
                           for tiles in (pair, pair + far))
        for s in (alone, together):
            s.run(0.6)
        assert together.counts.impacts[0] > 500
        assert np.abs(state(together)[:, :2] - state(alone)).max() < 1e-9


@pytest.mark.parametrize("gap", [9e-4, 5e-4, 1e-4])
def test_plastic_tiles_that_are_near_do_not_touch_whatever_else_is_solved(gap):
    """A tile that spins hits one of two that lie still, so many widths apart: as in 64 shorter
    steps, whether or not something else is to be solved, far away, or everything is.

    Where it was, the two counted as pressed together, and a hit went through the gap: velocities
    were off by up to 2e-3 m/s, of 0.25.
    """
    near = [tile(), tile(WIDTH * (1.0 + gap)),
            tile(-1.35 * WIDTH, 0.55 * WIDTH, 0.3, 0.25, -0.1, 20.0)]
    pressed = [tile(40 * WIDTH, held=True), tile(41 * WIDTH, vx=-1e-9)]

    def after(tiles, parts=1, skip=True):
        s = simulate(tiles, body=material(restitution=0.0, friction=0.0), step=H / parts,
                     tolerance=1e-10, skip_converged=skip)
        s.advance(20 * parts)
        return state(s)[3:, :3] * [[1.0], [1.0], [WIDTH]]

    alone = after(near)
    assert np.abs(after(near + pressed) - alone).max() < 1e-9
    assert np.abs(after(near, skip=False) - alone).max() < 1e-9
    assert np.abs(after(near, 64) - alone).max() < 4e-4


@pytest.mark.parametrize("part", np.linspace(1.0, 1.9, 4).tolist())
def test_a_corner_that_its_arc_takes_off_the_wall_after_a_plastic_hit_is_not_in_contact(part):
    """It leaves slower than what bounces, but it leaves: what hits its tile next hits it alone.
    One of 1 mm that had left the wall by 2e-4 widths was hit as if it leant on it."""
    h = 1 / 1920
    half = 0.5 * WIDTH * (math.cos(0.5) + math.sin(0.5))
    s = simulate([tile(0.5 - half - part * h * 0.3, 0.0, 0.5, 0.3)], step=h, tolerance=1e-10,
                 body=material(restitution_threshold=0.01),
                 reactor=Reactor("rectangle", width=1.0, height=1.0, friction=0.0,
                                 restitution=0.0))
    while s.counts.impacts[0] == 0:
        s.advance(1)
    s.advance(2)  # after one it may still be as near as what touches
    assert not s.state.impulses.size[0]


@pytest.mark.parametrize("threshold", [0.0, 0.01])
@pytest.mark.parametrize("held", [False, True])
def test_a_corner_that_is_stopped_is_not_stopped_again_where_its_tile_has_been(held, threshold):
    """A plastic hit is over when its corner leaves along its arc: velocities do not depend on when
    in the substep it was."""
    reach = 0.5 * WIDTH * (math.cos(0.5) + math.sin(0.5))
    found = []
    for part in np.arange(1.0, 2.0, 0.1):
        s = simulate([tile(-reach - part * H * 0.3, 0.0, 0.5, 0.3),
                      tile(0.5 * WIDTH, 0.0, held=held)],
                     body=material(friction=0.0, restitution=0.0,
                                   restitution_threshold=threshold))
        while s.counts.impacts[0] == 0:
            s.advance(1)
        s.advance(1)
        found.append(state(s)[3:, 0] * [1.0, 1.0, 0.5 * WIDTH])
    assert np.ptp(found, axis=0).max() < 1e-9


def almost_flat(target, random, side, **solver):
    """Velocities (m/s; the spin as that of a face) after a tile has hit a target at 0.5 m/s, all
    but flat; `side` -1: all that in a mirror, seen in that mirror."""
    tilt = 10 ** random.uniform(-4, -1) * random.choice([-1, 1])
    x, y, across = random.uniform(0, 0.1 * WIDTH), *random.uniform(-0.1, 0.1, 2)
    tiles = [tile(x, side * y * WIDTH, side * tilt, 0.5, side * across)]
    wall = None
    if target == "rectangle":
        wall = Reactor("rectangle", width=0.2, height=0.2, friction=0.25, restitution=0.2)
    elif target == "circle":
        wall = Reactor("circle", 0.1, friction=0.25, restitution=0.2)
    else:
        tiles.append(tile(0.1, held=target == "held tile"))
    s = simulate(tiles, body=material(friction=0.25, restitution=0.2), reactor=wall, **solver)
    s.run(0.2)
    return np.array([s.vx[0], side * s.vy[0], side * 0.5 * WIDTH * s.omega[0]])


TARGETS = ["rectangle", "circle", "tile", "held tile"]


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("target", TARGETS)
def test_an_impact_in_a_mirror_is_the_mirror_image_of_the_impact(target, solver):
    """Tiles that come almost flat, one corner a little sooner than the other, whichever it is and
    wherever in a substep."""
    for seed in range(60):
        there, mirrored = (almost_flat(target, np.random.default_rng(seed), side, **solver)
                           for side in (1, -1))
        assert mirrored == pytest.approx(there, abs=1e-6)


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("target", TARGETS)
def test_corners_hit_one_after_the_other_however_long_the_substep(target, solver):
    """As they do in substeps so short that only one of them can hit in each."""
    for seed in range(25):
        coarse, fine = (almost_flat(target, np.random.default_rng(seed), 1, **each) for each in
                        (solver, {"step": 1 / 30720, "tolerance": 1e-9, "passes": 1000}))
        assert coarse == pytest.approx(fine, abs=3e-3)


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("e", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("mu", [0.0, 0.25])
@pytest.mark.parametrize("way", [1, 1j, -1, -1j])
@pytest.mark.parametrize("shape", ["rectangle", "circle"])
def test_a_flat_hit_on_a_wall_gives_no_spin(shape, way, mu, e, solver):
    wall = (Reactor("rectangle", width=0.4, height=0.4, friction=mu, restitution=e)
            if shape == "rectangle" else Reactor("circle", 0.2, friction=mu, restitution=e))
    v = 0.5 * way
    s = simulate([tile(vx=v.real, vy=v.imag)], body=material(friction=mu, restitution=e),
                 reactor=wall, **solver)
    s.run(0.45)
    assert abs(s.omega[0]) < 1e-3
    # On a round wall friction and restitution of the two corners are not those of a face.
    assert dot(s.vx[0] + 1j * s.vy[0], way) == pytest.approx(-0.5 * e, abs=1e-5 if (
        shape == "rectangle" or mu == 0.0 or e == 0.0) else 1e-3)


def behind(sides, e, mu):
    """A square of 0.4 m; or held tiles in place of its east side, or of its corner."""
    if sides == 0:
        return [], Reactor("rectangle", width=0.4, height=0.4, friction=mu, restitution=e)
    edge = 0.2 + 0.5 * WIDTH
    if sides == 1:
        return [tile(edge, 0.0, held=True)], None
    return [tile(*place, held=True) for i in (1, 2)
            for place in ((edge, edge - i * WIDTH), (edge - i * WIDTH, edge))], None


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
def test_a_flat_wall_is_the_face_of_a_held_tile(solver):
    """Whatever hits it leaves it as it would leave a tile."""
    rng = np.random.default_rng(11)
    for mu, e in product((0.0, 0.25, 1.0), (0.0, 0.5, 1.0)):
        for _ in range(6):
            angle, spin = rng.choice([0.0, 1e-7, rng.uniform(-3, 3)]), rng.choice([0.0, 3.0])
            flying = {"angle": angle, "vx": rng.uniform(0.3, 0.6), "spin": spin}
            after = []
            for sides in (0, 1):
                held, reactor = behind(sides, e, mu)
                s = simulate([*held, tile(0.16, **flying)], reactor=reactor,
                             body=material(friction=mu, restitution=e), **solver)
                while s.counts.impacts[0] == 0:
                    s.advance(1)
                after.append(state(s)[:, -1])
            assert after[0] == pytest.approx(after[1], abs=1e-9)


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.25, 0.6])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_what_flies_flat_into_a_corner_comes_back_the_same_way(e, mu, solver):
    """Two sides at once, of the four points of which none tells how much each bears: the tile
    leaves along the diagonal and does not turn, as out of a notch between held tiles."""
    found = []
    for sides in (0, 2):
        held, reactor = behind(sides, e, mu)
        s = simulate([*held, tile(0.175, 0.175, vx=0.3, vy=0.3)], reactor=reactor,
                     body=material(friction=mu, restitution=e), **solver)
        s.run(0.1)
        x, y, angle, vx, vy, omega = state(s)[:, -1]
        assert (angle, omega) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert (x, vx) == pytest.approx((y, vy), abs=1e-12)
        found.append(vx)
    assert found[0] == pytest.approx(found[1], abs=1e-9)
    assert found[0] <= 0.0
    if mu == 0.0:
        assert found[0] == pytest.approx(-0.3 * e, abs=1e-9)


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_a_gas_of_smooth_elastic_tiles_keeps_its_energy(solver, speed):
    """36 tiles in a smooth elastic box for five seconds: 5 % at most is lost, where several hit
    at a time or a third comes in the same substep."""
    random = np.random.default_rng(3)
    tiles = []
    for i, j in product(range(6), repeat=2):
        way, angle = random.uniform(0, 2 * math.pi), random.uniform(-3, 3)
        tiles.append(tile((i - 2.5) * 2 * WIDTH, (j - 2.5) * 2 * WIDTH, angle,
                          speed * math.cos(way), speed * math.sin(way)))
    box = 14 * WIDTH
    s = simulate(tiles, body=material(friction=0.0, restitution=1.0),
                 reactor=Reactor("rectangle", width=box, height=box, friction=0.0,
                                 restitution=1.0), **solver)
    energy = s.kinetic_energy()
    s.run(5.0)
    assert s.counts.impacts[0] > 200
    assert energy * 0.95 < s.kinetic_energy() < energy * (1 + 1e-9)


@pytest.mark.parametrize("solver", [RECOMMENDED, DEFAULT], ids=["recommended", "default"])
@pytest.mark.parametrize("held", [False, True])
def test_no_bounce_is_lost_under_a_load(solver, held):
    """A tile that falls flat comes back with e times its speed, wherever in a substep it lands:
    also if it is only the load that closes the gap at its end."""
    load, e, speed = 0.16, 0.6, 0.2  # N, none, m/s
    for drop in 0.01 + 4.13e-5 * np.arange(400):
        tiles = [tile(0, 0.5 * WIDTH + drop, vy=-speed)]
        if held:
            tiles.append(tile(0, -0.5 * WIDTH, held=True))
        # The wall is where the held tile's upper face would be.
        reactor = None if held else Reactor("rectangle", width=1.0, height=2.0, restitution=e)
        if not held:
            tiles = [tile(0, 0.5 * WIDTH + drop - 1.0, vy=-speed)]
        s = simulate(tiles, body=material(restitution=e), reactor=reactor,
                     drive=Drive("constant", (0.0, -load)), **solver)
        gravity = load / MASS
        impact_speed = math.sqrt(speed**2 + 2 * gravity * drop)
        fall = (impact_speed - speed) / gravity
        s.advance(int(fall / s.h) + 2)
        after = s.vy[0] + gravity * (s.time - fall)
        assert after == pytest.approx(e * impact_speed, rel=0.06)


def test_an_impact_does_not_depend_on_where_it_is():
    """The origin may be ten metres away; times of impacts are found as well as places are known."""
    def hit(x, y):
        s = simulate([tile(x, y, 0.3, 0.4, 0.1, 2.0), tile(x + 0.05, y + 0.01, -0.2, held=True)],
                     body=material(friction=0.3, restitution=0.5), **DEFAULT)
        s.run(0.1)
        return state(s)[3:, 0]

    here = hit(0.0, 0.0)
    assert abs(here[2] - 2.0) > 0.1
    for x, y in ((0.5, 0.2), (10.0, -3.0), (-100.0, 40.0)):
        assert hit(x, y) == pytest.approx(here, abs=1e-9 * max(abs(x), 1.0))


def test_a_corner_that_sweeps_past_hits_what_is_in_its_way():
    """A spinning tile's corner would dip 3 % of the width into a held tile and come out again, in
    one substep perhaps: it hits on its way in, at whatever angle it begins, and loses nothing."""
    for spin in (150.0, 300.0, 600.0):
        for angle in np.linspace(0.0, math.pi / 4 - 0.5, 40):
            s = simulate([tile(0, 0, held=True),
                          tile((0.5 + math.sqrt(0.5) - 0.03) * WIDTH, 0.1 * WIDTH, angle,
                               spin=spin)],
                         body=material(friction=0.0, restitution=1.0), **RECOMMENDED)
            energy = s.kinetic_energy()
            s.advance(6)
            assert s.counts.impacts[0] > 0
            assert s.counts.deepest[0] < 5e-3 * WIDTH
            assert s.kinetic_energy() == pytest.approx(energy, rel=1e-6)


def nearest(target, other, seconds):
    """How near two tiles that fly freely come within this time (m), by conservative advancement:
    each a (centre, velocity, angle, spin)."""
    fastest = sum(abs(v) + abs(spin) * DIAGONAL for _, v, _, spin in (target, other))
    time, least = 0.0, math.inf
    while time < seconds and least > 1e-6 * WIDTH:
        gap = max(separations(*(place for centre, v, angle, spin in (target, other)
                                for place in (centre + time * v, angle + time * spin)), WIDTH))
        least = min(least, gap)
        time += max(gap, 1e-6 * WIDTH) / fastest
    return least


@pytest.mark.parametrize("joined", [True, False])
@pytest.mark.parametrize(("solver", "fastest", "spin"), [(RECOMMENDED, 0.3, 30.0),
                                                         (DEFAULT, 0.5, 40.0)])
def test_a_tile_that_spins_past_another_and_does_not_touch_it_goes_on_as_it_was(
        solver, fastest, spin, joined):
    """Corners come within 3 % of the width of another tile, on arcs that a straight line would
    leave, and one face after another is the nearest."""
    rng, passes = np.random.default_rng(5), 0
    while passes < 60:
        speed, side = fastest * rng.uniform(0.2, 1.0), rng.uniform(0.8, 1.42) * WIDTH
        way = cmath.rect(1.0, rng.uniform(0.0, 2.0 * math.pi))
        other = (way * complex(0.055, rng.choice([-side, side])), -way * speed,
                 rng.uniform(0.0, 2.0 * math.pi), rng.uniform(-spin, spin))
        target = 0j, 0j, rng.uniform(-0.5, 0.5), 0.0
        seconds = 0.085 / speed
        if not 1e-4 * WIDTH < nearest(target, other, seconds) < 0.03 * WIDTH:
            continue
        passes += 1
        s = simulate([tile(angle=target[2], held=passes % 2 == 0),
                      tile(other[0].real, other[0].imag, other[2], other[1].real, other[1].imag,
                           other[3])],
                     body=material(friction=0.25, restitution=0.2, restitution_threshold=0.01),
                     **{**solver, "join_substeps": joined})
        s.run(seconds)
        assert state(s)[3:, 1] == pytest.approx([other[1].real, other[1].imag, other[3]], rel=1e-12)
        assert not state(s)[3:, 0].any()
        assert s.counts.impacts[0] == 0


@pytest.mark.parametrize("below", [0.0, 1e-12, 1e-9, 1e-6, 1e-4, 5e-4])
@pytest.mark.parametrize("substeps", [1, 4, 64])
def test_a_corner_that_slides_over_a_joint_does_not_hit_the_second_tile(below, substeps):
    """Smooth and elastic, on its lowest corner, that rounding or a solve has left below the faces
    by so many widths: in no frame of the sweep over the joint is there anything to hit."""
    held = [tile(i * WIDTH, -WIDTH, held=True) for i in (-0.5, 0.5)]
    for tilt in (0.1, 0.42, 0.7, -0.42):
        arm = cmath.rect(DIAGONAL, -math.copysign(0.25 * math.pi, tilt) - 0.5 * math.pi + tilt)
        for part in np.linspace(0.0, 1.0, 7):
            start = complex(-0.021 * WIDTH - part * 0.3 / 480, -0.5 * WIDTH) - arm
            s = simulate([*held, tile(start.real, start.imag, tilt, 0.3)], substeps=substeps,
                         body=material(friction=0.0, restitution=0.9))
            s.y[2] -= below * WIDTH
            s.advance(4)
            assert state(s)[3:, 2] == pytest.approx([0.3, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("substeps", [4, 32])
@pytest.mark.parametrize("e", [0.0, 0.2, 0.9])
def test_a_corner_that_a_load_presses_on_a_row_slides_over_its_joints_as_along_a_wall(e, substeps):
    """Without a threshold, at many angles and speeds: what the load gives in a substep, and while
    the corner is blunt to both tiles, is not an approach to the second one."""
    rng = np.random.default_rng(3)
    held = [tile(i * WIDTH, -0.5 * WIDTH, held=True) for i in range(-4, 4)]
    wall, far = Reactor("rectangle", width=100 * WIDTH, height=100 * WIDTH, friction=0.0,
                        restitution=e), 50 * WIDTH
    for tilt in np.linspace(0.3, 1.2, 12):
        corner = cmath.rect(DIAGONAL, -0.75 * math.pi + tilt)
        start, speed = -WIDTH * rng.uniform(0.1, 0.9) - corner, rng.uniform(0.3, 1.0)
        load = 0.1 * MASS * GRAVITY * rng.uniform(1.0, 4.0)  # N, in line with the corner
        parts = {"body": material(friction=0.0, restitution=e), "substeps": substeps,
                 "drive": Drive("constant", (0.0, -load), -load * corner.real),
                 "tolerance": 1e-5 / substeps}
        a = simulate([*held, tile(start.real, start.imag, tilt, speed)], **parts)
        b = simulate([tile(start.real, start.imag - far, tilt, speed)], reactor=wall, **parts)
        for s in (a, b):
            s.run(0.05)
        assert state(a)[3:, -1] == pytest.approx(state(b)[3:, -1], rel=0.01, abs=0.01 * speed)


@pytest.mark.parametrize("clearance", [0.001, 0.01, 0.03])
def test_a_tile_that_spins_along_a_wall_of_tiles_and_does_not_touch_it_goes_on_as_it_was(clearance):
    rng = np.random.default_rng(7)
    for solver in (DEFAULT, RECOMMENDED) * 10:
        spin, v, angle = rng.uniform(1.0, 60.0), rng.uniform(-0.3, 0.3), rng.uniform(0.0, 6.0)
        s = simulate([tile(0.0, -0.5 * WIDTH - DIAGONAL - clearance * WIDTH, angle, v, 0.0, spin)]
                     + [tile(i * WIDTH, held=True) for i in range(-4, 5)],
                     body=material(friction=0.3, restitution=0.3, restitution_threshold=0.01),
                     **solver)
        s.run(0.3)
        assert state(s)[3:, 0] == pytest.approx([v, 0.0, spin], rel=1e-12)
        assert s.counts.impacts[0] == 0


def test_tiles_that_spin_fast_hit_as_they_do_in_short_substeps():
    """At 300 rad/s they hit several times in a substep, and each time from where they are then;
    but for a corner on a corner, that may pass."""
    wrong = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        speed, way = rng.uniform(0.2, 1.5), cmath.rect(1.0, rng.uniform(0.0, 2.0 * math.pi))
        start, v = way * complex(0.05, rng.uniform(-0.03, 0.03)), -way * speed
        angles, spins = rng.uniform(0.0, 2.0 * math.pi, 2), rng.uniform(-300.0, 300.0, 2)
        ends = []
        for solver in (RECOMMENDED, {"step": 1 / 30720, "tolerance": 1e-9, "passes": 1000}):
            s = simulate([tile(angle=angles[0], spin=spins[0]),
                          tile(start.real, start.imag, angles[1], v.real, v.imag, spins[1])],
                         body=material(friction=0.25, restitution=0.5), **solver)
            s.run(math.ceil(0.07 / speed * 120) / 120)
            ends.append(np.concatenate([s.vx, s.vy, 0.7 * WIDTH * s.omega]))
        if np.abs(ends[0] - ends[1]).max() > 0.01:
            wrong.append(seed)
    assert len(wrong) <= 1


@pytest.mark.parametrize("seed", [180, 183, 247, 330])
def test_tiles_that_spin_fast_meet_with_any_corner(seed):
    """Also with another than was the nearest at the middle of the substep: of 600 pairs these
    four were 0.6 to 1.5 % of the width deep before they hit."""
    rng = np.random.default_rng(seed)
    speed, way = rng.uniform(0.2, 1.5), cmath.rect(1.0, rng.uniform(0.0, 2.0 * math.pi))
    start, v = way * complex(0.05, rng.uniform(-0.035, 0.035)), -way * speed
    angles = rng.uniform(0.0, 6.28, 2)
    spins = rng.uniform(200.0, 450.0, 2) * rng.choice([-1.0, 1.0], 2)
    s = simulate([tile(angle=angles[0], spin=spins[0]),
                  tile(start.real, start.imag, angles[1], v.real, v.imag, spins[1])],
                 body=Material(linear_damping=0.0, angular_damping=0.0), **RECOMMENDED)
    s.run(math.ceil(0.07 / speed * 120) / 120)
    assert s.counts.impacts[0] >= 1
    assert s.counts.deepest[0] < 1e-3 * WIDTH


@pytest.mark.parametrize("seed", [8, 81, 131, 136, 300, 346])
def test_what_a_run_begins_with_meets_as_anything_else(seed):
    """Nothing has looked ahead for the first half of the first substep: tiles that spin at 100 to
    350 rad/s within each other's reach came to be 2.6 to 4.4 % of the width deep in it."""
    rng = np.random.default_rng(seed)
    other = cmath.rect(rng.uniform(0.0305, 0.043), rng.uniform(0.0, 2.0 * math.pi))
    angles = rng.uniform(0.0, 6.28, 2)
    spins = rng.uniform(100.0, 350.0, 2) * rng.choice([-1, 1], 2)
    s = simulate([tile(angle=angles[0], spin=spins[0]),
                  tile(other.real, other.imag, angles[1], spin=spins[1])],
                 body=Material(friction=0.25, restitution=0.2, restitution_threshold=0.01),
                 **RECOMMENDED)
    s.run(1 / 120)
    assert s.counts.impacts[0] >= 1
    assert s.counts.deepest[0] < 5e-3 * WIDTH


def test_tiles_that_spin_against_each_other_do_not_sink_in():
    """Where corners run along turning faces, ever smaller bounces end in a contact that lasts:
    its faces come after it, by up to 3 % of the width in a substep."""
    deepest = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        sense, tiles = rng.choice([-1, 1]), []
        for k in range(7):  # six come together about a seventh
            way = cmath.rect(1.0, k * math.pi / 3.0)
            place = 0j if k == 6 else way * rng.uniform(0.045, 0.055)
            v = way * complex(-rng.uniform(0.3, 1.0) * (k < 6), rng.uniform(-0.1, 0.1))
            tiles.append(tile(place.real, place.imag, rng.uniform(0.0, 6.28), v.real, v.imag,
                              sense * rng.uniform(150.0, 400.0)))
        s = simulate(tiles, body=Material(friction=0.1, linear_damping=0.0, angular_damping=0.0),
                     **RECOMMENDED)
        energy = s.kinetic_energy()
        s.run(0.1)
        assert s.kinetic_energy() < energy
        deepest.append(s.counts.deepest[0] / WIDTH)
    assert max(deepest) < 7.5e-3
    assert np.mean(np.array(deepest) > 5e-3) <= 0.02


# While forces act.

PUSH = 0.05  # N, towards the wall
CORNER = {"flat": (0.0, 0.5 * WIDTH), "corner": (0.25 * math.pi, DIAGONAL)}  # angle, reach


def fall(shape, height, e, push=PUSH, **solver):
    """A smooth tile at rest, so far (m) from a wall that it is pushed against."""
    angle, reach = CORNER[shape]
    return simulate([tile(0.1 - reach - height, 0.0, angle)], body=material(friction=0.0),
                    reactor=Reactor("rectangle", width=0.2, height=1.0, friction=0.0,
                                    restitution=float(e)),
                    drive=Drive("constant", (push, 0.0)), **solver)


def energy_above(s, shape, push=PUSH):
    """Its energy (J), none where it lies at the wall."""
    return s.kinetic_energy() + push * (0.1 - CORNER[shape][1] - s.x[0])


@pytest.mark.parametrize("shape", CORNER)
@pytest.mark.parametrize(("step", "substeps"), [(1 / 480, 1), (1 / 480, 4), (1 / 120, 12)])
def test_an_elastic_tile_bounces_as_high_as_it_was_for_ever(shape, step, substeps):
    """Some twenty bounces, at any time in a substep."""
    s = fall(shape, 0.005, 1.0, step=step, substeps=substeps)
    before = energy_above(s, shape)
    s.run(2.0)
    assert s.counts.impacts[0] >= 15
    assert energy_above(s, shape) == pytest.approx(before, rel=2e-3)


@pytest.mark.parametrize("shape", CORNER)
@pytest.mark.parametrize("e", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("push", [0.05, 0.2])
def test_a_bounce_under_a_load_has_the_exact_restitution(shape, e, push):
    """From sqrt(2 E/m) to e sqrt(2 E/m), wherever in a substep it hits."""
    for height in np.linspace(0.004, 0.005, 8):
        s = fall(shape, height, e, push, substeps=4)
        before = energy_above(s, shape, push)
        s.run(1.2 * math.sqrt(2.0 * height * MASS / push))
        assert s.counts.impacts[0] > 0
        assert math.sqrt(energy_above(s, shape, push) / before) == pytest.approx(e, abs=5e-4)


@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0])
def test_what_hits_flat_and_does_not_bounce_lies_where_it_hit(speed):
    for way in np.linspace(0.01, 0.01 + speed / 480, 7):
        s = simulate([tile(0.1 - 0.5 * WIDTH - way, 0.0, 0.0, speed)], body=material(friction=0.0),
                     reactor=Reactor("rectangle", width=0.2, height=1.0, friction=0.0,
                                     restitution=0.0))
        s.run(2.0 * way / speed)
        assert s.vx[0] == pytest.approx(0.0, abs=1e-12)
        assert 0.1 - 0.5 * WIDTH - s.x[0] == pytest.approx(0.0, abs=2e-5 * WIDTH)


@pytest.mark.parametrize("passes", [1, 40])
@pytest.mark.parametrize("e", [0.2, 1.0])
def test_a_row_of_tiles_comes_off_a_wall_as_a_lone_one_however_few_passes_a_solve_has(e, passes):
    """By Poisson's law: compression stops all, and e of each impulse comes back.  (With 40 passes,
    the default, ten tiles were left with 0.00 and 0.37 of their speed.)"""
    s = simulate([tile(0.348 - (i + 0.5) * WIDTH, vx=0.5) for i in range(10)], step=H, substeps=4,
                 body=material(restitution=e), tolerance=1e-5, passes=passes,
                 reactor=Reactor("rectangle", width=0.7, height=0.5, friction=0.0,
                                 restitution=e))
    s.advance(10)
    assert s.vx == pytest.approx(-0.5 * e, rel=0.005)
    assert s.counts.unconverged[0] == 0 or passes == 1


def test_an_impact_that_ends_at_the_limit_of_its_passes_is_counted():
    """A hundred tiles in a row at a fine tolerance take more than a thousand."""
    s = simulate([tile(2.898 - (i + 0.5) * WIDTH, vx=0.5) for i in range(100)], step=H,
                 substeps=4, body=material(restitution=1.0), tolerance=1e-9,
                 reactor=Reactor("rectangle", width=5.8, height=0.5, friction=0.0,
                                 restitution=1.0))
    s.advance(10)
    assert s.counts.impacts[0] > 0
    assert s.counts.unconverged[0] > 0


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("turn", [0.0, 0.3, 0.7])
def test_a_solve_of_impacts_ends_before_its_passes_do(n, turn):
    """Without a threshold what has come at 1e-17 m/s may hit, and changes by rounding in each pass.
    (Within a part of how fast that was alone, such solves of a block were as long as they might,
    and at twice the passes it came out otherwise by up to 0.08 m/s.)"""
    ends = []
    for passes in (1000, 4000):
        block = [tile((i - 0.5 * (n - 1)) * WIDTH, (j - 0.5 * (n - 1)) * WIDTH)
                 for i in range(n) for j in range(n)]
        s = simulate([*block, tile(-(0.5 * n + 0.9) * WIDTH, 0.3 * WIDTH, turn, vx=0.5)], step=H,
                     substeps=4, body=material(restitution=1.0, friction=0.0), tolerance=1e-5,
                     passes=passes)
        s.advance(60)
        ends.append([*s.vx, *s.vy, *s.omega])
    assert ends[0] == ends[1]


@pytest.mark.parametrize("gap", [1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("solver", [{"step": 1 / 480, "substeps": 4}, {"step": 1 / 480}])
def test_in_a_row_with_gaps_the_last_one_takes_it_all(gap, solver):
    """One hit after another, all within a substep; not all at once, as where they touch."""
    s = simulate([tile(-0.1, vx=0.5), *(tile(i * (WIDTH + gap)) for i in range(4))],
                 body=material(restitution=1.0, friction=0.0), **solver)
    s.run(0.4)
    assert s.vx == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.5], abs=1e-9)


def test_a_corner_that_is_near_but_does_not_touch_takes_no_part():
    """One corner hits the round wall while another is 26 um away, half a substep from its hit."""
    s = simulate([tile(0.08180912072000873, -0.06414146611297684, 38.60987069555218 - 12 * math.pi,
                       0.19569697286568066, -0.14344242564882254, -14.667749939424269)],
                 body=material(friction=0.0),
                 reactor=Reactor("circle", radius=0.12, friction=0.0, restitution=1.0), substeps=4)
    before = s.kinetic_energy()
    s.advance(3)
    assert s.kinetic_energy() == pytest.approx(before, rel=1e-12)
    assert s.omega[0] == pytest.approx(11.40816742, rel=1e-7)


@pytest.mark.parametrize("top", [5e-4, 1e-3, 2e-3])
def test_a_corner_that_leaves_takes_no_part_in_the_next_hit(top):
    """A tile hits a wall with one corner and then the other, a third of a substep later, while a
    third corner turns away from the wall above, which it has not touched: velocities are those at a
    16th of the step, whatever the phase."""
    wall = Reactor("rectangle", width=1.4 * WIDTH, height=1.1 * WIDTH, friction=0.3,
                   restitution=0.3)
    half = 0.5 * WIDTH * (math.cos(0.002) + math.sin(0.002))
    for gap in np.linspace(0.005, 0.015, 11).tolist():
        start = tile((gap - 0.7) * WIDTH + half, (0.55 - top) * WIDTH - half, 0.002, -0.3,
                     spin=-0.8)
        coarse, fine = (simulate([start], reactor=wall, step=H / parts, substeps=4)
                        for parts in (1, 16))
        coarse.advance(2)
        fine.advance(32)
        assert coarse.counts.impacts[0] == 2
        assert state(coarse)[3:] == pytest.approx(state(fine)[3:], rel=1e-9)


def off_by_phase(tiles, late, **parts):
    """By how much (m/s) velocities after three steps differ from those at a 16th of the step, where
    these tiles begin by so much later (s) than they might, for phases of a substep."""
    off = []
    for time in np.linspace(0.0, H / 4, 9).tolist():
        begun = [replace(each, position=(each.position[0] - time * each.velocity[0],
                                         each.position[1] - time * each.velocity[1]),
                         angle=each.angle - time * each.spin) if k in late else each
                 for k, each in enumerate(tiles)]
        coarse, fine = (simulate(begun, step=H / finer, substeps=4, tolerance=1e-5, passes=40,
                                 **parts) for finer in (1, 16))
        coarse.advance(3)
        fine.advance(48)
        off.append(np.abs(state(coarse)[3:5] - state(fine)[3:5]).max())
    return np.array(off)


def off_when_a_bonded_row_hits(n, angle, spin, mu, e, threshold):
    """By how much (m/s) velocities differ from those at a 16th of the step, where a row of n tiles
    that their magnets hold, and that spins freely, hits a wall; for phases of a substep."""
    off, speed = [], 0.5
    wall = Reactor("rectangle", width=0.4, height=0.4, friction=mu, restitution=e)
    for phase in range(9):
        tiles = []
        for k in range(n):
            arm = cmath.rect((k - 0.5 * (n - 1)) * WIDTH, angle)
            x = 0.2 - 0.5 * (n + 1) * WIDTH + speed * H / 36 * phase
            tiles.append(tile(x + arm.real, arm.imag, angle, speed - spin * arm.imag,
                              spin * arm.real, spin, kind=("black", "white")[k % 2]))
        found = []
        for finer in (1, 16):
            s = simulate(tiles, types=CHESSBOARD, magnet=Magnet(), reactor=wall, step=H / finer,
                         substeps=4, tolerance=1e-6, passes=200,
                         body=material(friction=mu, restitution=e, restitution_threshold=threshold))
            s.run(0.06)
            found.append(np.array([s.vx, s.vy, 0.5 * WIDTH * s.omega]))
        off.append(np.abs(found[0] - found[1]).max())
    return off


@pytest.mark.parametrize(("n", "angle", "spin", "mu", "e", "threshold"), [
    (2, 1.2, 8.0, 0.25, 0.2, 0.01), (2, 0.8, -12.0, 0.25, 0.2, 0.01),
    (2, 1.2, -12.0, 0.25, 0.2, 0.01), (2, 1.2, -12.0, 0.0, 0.5, 0.0),
    (4, 1.2, -8.0, 0.25, 0.2, 0.01),
])
def test_a_bonded_row_that_spins_is_hit_as_one_at_any_phase_of_a_substep(n, angle, spin, mu, e,
                                                                       threshold):
    """Its arc has taken the tiles off each other by some 1e-5 of the width, until what holds them
    has acted; taken for open, they hit by turns."""
    assert max(off_when_a_bonded_row_hits(n, angle, spin, mu, e, threshold)) < 0.01


def under_loads(folder, tiles, loads, *, finer=1, **parts):
    """Tiles under constant loads each (N, N, N m), at 1/480 s and four substeps, or finer."""
    (folder / "each.py").write_text(
        "def each(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):\n"
        "    for i in range(p.size // 3):\n"
        "        fx[i] += p[3 * i]\n        fy[i] += p[3 * i + 1]\n"
        "        torque[i] += p[3 * i + 2]\n")
    return simulate(tiles, step=1 / 480 / finer, substeps=4, tolerance=1e-7, passes=400,
                    drive=Drive("user", module=str(folder / "each.py"), function="each",
                                parameters=tuple(float(f) for load in loads for f in load)),
                    **parts)


@pytest.mark.parametrize("e", [0.5, 1.0])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_row_that_its_last_tile_pushes_hits_as_fast_as_it_has_become(tmp_path, n, e):
    """A smooth row comes off a held tile at e of the speed that it then has, and slows down again:
    at any phase of a substep its mean speed is exact to second order.  A tile that lies on one that
    moves was taken to gain nothing in the substep in which it hits: off by up to 3e-3 to 9e-3 m/s
    here, of 0.34."""
    force, speed, end = 0.2, 0.3, 0.05
    a = force / (n * MASS)
    for gap in np.linspace(0.1, 0.16, 7) * WIDTH:
        s = under_loads(tmp_path, [tile(-i * WIDTH, 0.0, vx=speed) for i in range(n)]
                        + [tile(WIDTH + gap, 0.0, held=True)],
                        [(0.0, 0.0, 0.0)] * (n - 1) + [(force, 0.0, 0.0)],
                        body=material(friction=0.0, restitution=e))
        s.run(end)
        time = (math.sqrt(speed**2 + 2.0 * a * gap) - speed) / a
        left = a * (end - time) - e * (speed + a * time)
        assert s.vx[:n].mean() == pytest.approx(left, abs=2e-5)


@pytest.mark.parametrize(("e", "most"), [(0.0, 5e-4), (0.5, 2e-5), (1.0, 2e-5)])
def test_what_is_struck_off_the_tile_that_pushes_it_has_been_pushed_up_to_then(tmp_path, e, most):
    """A tile pushes another one, which a third one then strikes away: each has of the contact what
    it gives until then, against a 32nd of the step; and all momentum is there.  Before, they were
    off by 4e-3 to 1.8e-2 m/s, of 0.6."""
    force, arm = 0.2, 0.25 * WIDTH
    turn = -0.5 * force * arm  # holds against the contact, beside both centres
    loads = [(force, 0.0, turn), (0.0, 0.0, turn), (0.0, 0.0, 0.0)]
    for away in np.linspace(0.2, 0.24, 6) * WIDTH:
        ends = []
        for finer in (1, 32):
            s = under_loads(tmp_path, [tile(0.0, 0.0, vx=0.2), tile(WIDTH, 0.5 * WIDTH, vx=0.2),
                                       tile(-away, 1.05 * WIDTH, vx=0.9)], loads, finer=finer,
                            body=material(friction=0.0, restitution=e))
            s.run(7 / 480)
            ends.append(np.array([s.vx, s.vy, 0.5 * WIDTH * s.omega]))
            assert s.vx.sum() == pytest.approx(1.3 + force / MASS * s.time, rel=1e-13)
            assert s.vy.sum() == pytest.approx(0.0, abs=1e-13)
        assert s.vx[1] > s.vx[0] + 0.1  # struck off
        assert np.abs(ends[0] - ends[1]).max() < most


def test_what_a_plastic_hit_has_left_together_is_hit_as_one():
    """A tile hits another, which gives nothing back, and then a wall in the same substep, while its
    spin presses it to the other: they are hit together, as where a step lies between."""
    tiles = [tile(-0.002966, 0.014586, 4.916276, -0.271933, 0.441678, -13.14964),
             tile(-0.03729, 0.003548, 4.447782, 0.616174, 0.140142, -6.699254)]
    off = off_by_phase(tiles, (0, 1), body=material(friction=0.1, restitution=0.0,
                                                    restitution_threshold=0.01),
                       reactor=Reactor("rectangle", width=0.3, height=0.065196756, friction=0.9,
                                       restitution=1.0))
    assert off.max() < 0.01


def test_what_rocks_on_a_wall_under_a_load_is_hit_with_the_wall():
    """Its arc takes the corner off by what the load presses back: it touches when the hit comes."""
    angle = 1.673287586
    reach = 0.5 * WIDTH * (abs(math.cos(angle)) + math.sin(angle))
    tiles = [tile(-0.052287223, 0.1 - TOUCH - reach, angle, -0.22309227, 0.181474786, -13.55649),
             tile(-0.02956642, 0.049487975, 2.781003289, 0.052396477, 1.04581082)]
    off = off_by_phase(tiles, (1,), body=material(friction=0.25, restitution=0.5,
                                                  restitution_threshold=0.01),
                       reactor=Reactor("rectangle", width=0.2, height=0.2, friction=0.5,
                                       restitution=0.1),
                       drive=Drive("constant", (-0.025, 0.14)), floor=Floor(linear=0.1,
                                                                            angular=0.1))
    assert off.max() < 0.01


@pytest.mark.parametrize("offset", [*np.linspace(0.009, 0.011, 9).tolist(), 0.01014657])
def test_a_flat_hit_across_a_joint_is_one_on_a_smooth_wall(offset):
    row = [tile(0.0651, k * WIDTH, held=True) for k in range(-4, 5)]
    s = simulate([tile(0.03, offset, 0.0, 0.5, -1.0), *row],
                 body=material(friction=0.25, restitution=0.2), substeps=4)
    s.run(0.02)
    assert s.vx[0] == pytest.approx(-0.1, abs=1e-9)
    assert s.vy[0] == pytest.approx(-(1.0 - 0.25 * 1.2 * 0.5), abs=1e-9)
    assert s.omega[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("offset", [-1.2e-3, -4e-4, -1e-9, 1e-9, 4e-4, 1.2e-3])
@pytest.mark.parametrize("friction", [0.0, 0.25])
@pytest.mark.parametrize("angle", [0.3, 0.6, math.pi / 4, 1.0, 1.3])
def test_a_corner_that_comes_down_on_a_joint_hits_a_smooth_wall(angle, friction, offset):
    """Nearer to the joint than corners are blunt: it sank in between the two tiles, and hit one of
    their corners with its own face."""
    row = [tile(k * WIDTH, held=True) for k in range(3)]

    def run(place):
        s = simulate([tile(place * WIDTH + math.cos(angle + math.pi / 4) * WIDTH / math.sqrt(2.0),
                           2.0 * WIDTH, angle - math.pi / 2, vy=-0.3), *row],
                     body=material(friction=friction, restitution=0.5), substeps=4)
        s.run(0.2)
        return np.array([s.vx[0], s.vy[0], WIDTH * s.omega[0]])

    off = np.abs(run(0.5 + offset) - run(0.8))
    assert off.max() < 0.012
    assert friction > 0.0 or off[0] < 1e-9


@pytest.mark.parametrize("substeps", [2, 4])
@pytest.mark.parametrize("e", [0.9, 1.0])
def test_what_turns_as_it_is_hit_stays_with_what_it_touches(e, substeps):
    """Two smooth tiles, flat on each other, one of which hits a corner: both turn, and their faces
    press on each other as they do.  That is no further impact: each was a bounce, in every
    substep."""
    def run(step, substeps):
        s = simulate([tile(held=True), tile(0.6 * WIDTH, 1.1 * WIDTH, vy=-1.0),
                      tile(0.6 * WIDTH, 2.1 * WIDTH, vy=-1.0)],
                     body=material(friction=0.0, restitution=e, restitution_threshold=0.01),
                     step=step, substeps=substeps, tolerance=1e-9, passes=2000)
        s.run(0.025)
        return s, state(s)[:, 1:]

    s, found = run(H, substeps)
    short, truth = run(H / 16, 4)
    assert abs(truth[5]).min() > 20.0
    assert int(s.counts.impacts[0]) == int(short.counts.impacts[0]) == 2
    off = np.abs(found[3:] - truth[3:]).T @ [1.0, 1.0, WIDTH]
    assert off.max() < 1e-3


@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
def test_what_an_impact_leaves_together_hits_together_in_the_same_substep(phase):
    """An L of three, flat on each other, flies at two held tiles, which its corner and then one of
    its arms hit; in between they have turned, and still touch."""
    turn, upper, v = cmath.exp(-1.5848619j), cmath.exp(0.0256431j), -0.5226727 + 1.4059912j
    held = [tile(z.real, z.imag, -1.5848619, held=True)
            for z in (0.5 * WIDTH * turn, -0.5 * WIDTH * turn)]
    corner = WIDTH * (1.6396665 - 4.2369833j) + phase * H / 4 * v
    flying = [tile(z.real, z.imag, 0.0256431, v.real, v.imag)
              for z in (corner - 1j * WIDTH * upper, corner, corner - WIDTH * upper)]

    def run(step):
        s = simulate([*held, *flying], drive=Drive("constant", (0.02, 0.0)), step=step, substeps=4,
                     tolerance=1e-9, passes=2000,
                     body=material(friction=0.1, restitution=0.9, restitution_threshold=0.01))
        s.run(30 * H)
        return state(s)[3:, 2:]

    off = np.abs(run(H) - run(H / 16)).T @ [1.0, 1.0, WIDTH]
    assert off.max() < 0.03


@pytest.mark.parametrize("gap", [0.02, 0.06, 0.09])
def test_what_is_thrown_hits_in_the_same_substep_what_it_lay_far_from(gap):
    """A tile lies still, `gap` widths from the wall, and is hit at 5 m/s within a step."""
    for way in np.linspace(0.012, 0.016, 5):
        x = 0.2 - WIDTH * (0.5 + gap)
        s = simulate([tile(x), tile(x - WIDTH - way, vx=5.0)],
                     body=material(friction=0.0, restitution=1.0),
                     reactor=Reactor("rectangle", width=0.4, height=1.0, friction=0.0,
                                     restitution=1.0), step=1 / 120, substeps=12)
        s.run(0.025)
        assert s.counts.impacts[0] >= 2
        assert s.counts.deepest[0] < 2e-3 * WIDTH


# On a floor with friction.

LAWS = ("separate", "coupled", "exact")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("target", ["held", "wall", "free"])
@pytest.mark.parametrize("e", [0.2, 1.0])
def test_a_bounce_on_a_floor_has_the_exact_restitution(law, target, e):
    """Friction slows a tile down to its hit, and from there on, whenever in a substep that is.

    Until 0.8.0 it went on against the old way: each bounce lost mu g h to 3 mu g h, and a
    restitution of 0.2 was 0.13 to 0.19 at the speeds of the paper's scenes.
    """
    a, v0, worst = MU * GRAVITY, 0.3, []
    for step in (1 / 480, 1 / 1920):
        off = []
        for part in np.linspace(0.0, 4.0, 9):
            gap = 0.004 + part * step / 4 * v0
            tiles, share = [tile(0, 0, 0, v0, 0)], 1.0
            if target != "wall":
                tiles += [tile(WIDTH + gap, 0, held=target == "held")]
                share = 0.5 if target == "free" else 1.0
            s = simulate(tiles, body=material(restitution=e), floor=Floor(law),
                         reactor=Reactor("rectangle", width=2 * gap + WIDTH, height=1.0,
                                         restitution=e)
                         if target == "wall" else None,
                         step=step, substeps=4, tolerance=1e-10)
            hit = math.sqrt(v0 * v0 - 2 * a * gap)
            after = hit * (1.0 - share * (1.0 + e))
            s.advance(math.ceil((v0 - hit) / a / step) + 2)
            left = max(abs(after) - a * (s.time - (v0 - hit) / a), 0.0)
            off.append(abs(s.vx[0] - math.copysign(left, after)))
        worst.append(max(off))
    assert worst[0] < 5e-6  # m/s; mu g h is 1.3e-3
    assert worst[1] < worst[0] / 8 or worst[1] < 1e-12


def test_a_tile_that_lay_still_gets_its_friction_from_the_hit_on():
    a, v0, h = MU * GRAVITY, 0.3, 1 / 1920
    for part in np.linspace(0.0, 1.0, 7):
        gap = 0.004 + part * h * v0
        s = simulate([tile(0, 0, 0, v0, 0), tile(WIDTH + gap, 0)], body=material(restitution=1.0),
                     floor=Floor(), step=h, tolerance=1e-10)
        hit = math.sqrt(v0 * v0 - 2 * a * gap)
        s.advance(math.ceil((v0 - hit) / a / h) + 2)
        assert s.vx[0] == pytest.approx(0.0, abs=1e-9)
        assert s.vx[1] == pytest.approx(hit - a * (s.time - (v0 - hit) / a), abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("e", [0.2, 1.0])
def test_what_is_pressed_against_a_wall_is_slowed_down_to_its_hit_too(law, e):
    """A smooth wall bears the load, but not the floor's friction.

    Until 0.11.0 such a tile hit as fast as when the substep began, up to 1.5 mu g h too fast.
    """
    a, v0, h = MU * GRAVITY, 0.1, 1 / 1920
    for part in np.linspace(0.0, 1.0, 9):
        gap = 0.001 + part * h * v0
        s = simulate([tile(0.5 * (1.0 - WIDTH), 0, 0, 0, v0)], body=material(),
                     reactor=Reactor("rectangle", width=1.0, height=2 * gap + WIDTH,
                                     friction=0.0, restitution=e),
                     floor=Floor(law), drive=Drive("constant", (2 * MASS * GRAVITY, 0.0), 0.0),
                     step=h, tolerance=1e-10)
        hit = math.sqrt(v0 * v0 - 2 * a * gap)
        s.advance(math.ceil((v0 - hit) / a / h) + 2)
        left = max(e * hit - a * (s.time - (v0 - hit) / a), 0.0)
        assert s.vy[0] == pytest.approx(-left, abs=5e-6)  # m/s; mu g h is 1.3e-3


# In another frame.


@pytest.mark.parametrize("bonded", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_what_hits_a_row_does_not_depend_on_the_speed_of_all(n, bonded):
    """And the centre of mass goes on as it was; wherever in a substep the hit is.

    A row that touches, or one that its magnets press together, is hit off its middle.
    """
    step, e, offset = 1 / 120, 0.5, 0.004
    kinds = ["black", "white", "black"][:n] if bonded else ["plain"] * n
    types = (*CHESSBOARD, TileType("plain", (0, 0, 0, 0), "grey"))

    def after(vx, vy, part):
        gap = 0.004 + part * step / 4 * 0.3
        s = simulate([tile(0, offset, 0, 0.3 + vx, vy, kind="plain"),
                      *(tile(WIDTH + gap + i * WIDTH, 0, 0, vx, vy, kind=kind)
                        for i, kind in enumerate(kinds))],
                     types=types, magnet=Magnet() if bonded else None,
                     body=material(friction=0.25, restitution=e), step=step, substeps=4,
                     tolerance=1e-11, join_substeps=False)
        begin = np.array([s.x.mean(), s.y.mean()])
        s.advance(math.ceil(gap / 0.3 / step) + 1)
        centre = begin + s.time * np.array([0.3 / (n + 1) + vx, vy])
        assert np.array([s.x.mean(), s.y.mean()]) == pytest.approx(centre, abs=1e-12)
        return np.array([s.vx - vx, s.vy - vy, WIDTH * s.omega])

    for part in np.linspace(0.0, 1.0, 5):
        still = after(0.0, 0.0, part)
        assert np.abs(still[2]).max() > 0.003
        for frame in ((1.0, 0.0), (0.0, 1.0), (-0.3, 0.7)):
            # Among what hits together 1e-4 of the approach is left.
            assert after(*frame, part) == pytest.approx(still, abs=1e-4 * 0.3)


def on_a_line(x, v, e, half, seconds):
    """Places and velocities of equal tiles in a row between walls at -half and half, by events."""
    x, v, left = x.copy(), v.copy(), seconds
    while True:
        gaps = np.diff(x, prepend=-half - 0.5 * WIDTH, append=half + 0.5 * WIDTH) - WIDTH
        closing = -np.diff(v, prepend=0.0, append=0.0)
        when = np.where(closing > 0.0, np.maximum(gaps, 0.0) / np.maximum(closing, 1e-99), math.inf)
        first = int(when.argmin())
        if when[first] > left:
            return x + left * v, v
        x, left = x + when[first] * v, left - when[first]
        change = (1.0 + e) * closing[first]
        if first == 0:
            v[0] += change
        elif first == x.size:
            v[-1] -= change
        else:
            v[first - 1] -= 0.5 * change
            v[first] += 0.5 * change


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_what_hits_in_a_substep_does_so_in_the_order_of_time(n):
    """Tiles in a row between two walls, which go a fifth of their width a substep and hit up to ten
    times in it."""
    steps, e, rng = 4, 0.8, np.random.default_rng(n)
    for _ in range(40):
        gaps = rng.uniform(0.02, 0.2, n + 1) * WIDTH
        half = 0.5 * (gaps.sum() + n * WIDTH)
        x, v = np.cumsum(gaps[:-1] + WIDTH) - 0.5 * WIDTH - half, rng.uniform(-2.5, 2.5, n)
        order = rng.permutation(n)
        s = simulate([tile(x[i], vx=v[i]) for i in order], body=material(restitution=e),
                     reactor=Reactor("rectangle", width=2.0 * half, height=1.0, restitution=e))
        s.advance(steps)
        places, speeds = on_a_line(x, v, e, half, steps * H)
        assert s.vx == pytest.approx(speeds[order], abs=1e-9)
        assert s.x == pytest.approx(places[order], abs=1e-9 * WIDTH)
        assert s.omega == pytest.approx(np.zeros(n), abs=1e-9)


@pytest.mark.parametrize(("mu", "e", "spin"), [(0.25, 0.5, 30.0), (0.0, 1.0, 80.0)])
def test_what_flies_about_hits_in_a_substep_as_in_64_shorter_ones(mu, e, spin):
    """Nine tiles that fly and spin at random: velocities after three substeps are those of 64 times
    shorter ones, to 1e-6 m/s, but for one run in forty (contacts that last along the curve of a
    corner, and what begins within a sixteenth of a substep of a tile)."""
    finer, steps, off, hits = 64, 3, 0, 0
    for seed in range(120):
        rng = np.random.default_rng(seed)
        side = 3.0 * WIDTH
        grid = [complex(side * (i - 1), side * (j - 1)) for i in range(3) for j in range(3)]
        tiles = [tile(*(np.array([at.real, at.imag]) * 0.5 + rng.uniform(-0.05, 0.05, 2) * WIDTH),
                      rng.uniform(0.0, 2.0 * math.pi), *rng.normal(0.0, 1.0, 2),
                      rng.normal(0.0, spin)) for at in grid]
        parts = {"body": material(friction=mu, restitution=e),
                 "reactor": Reactor("circle", 0.12, friction=mu, restitution=e)}
        coarse, fine = simulate(tiles, **parts), simulate(tiles, step=H / finer, **parts)
        missed = []
        for _ in range(steps):
            coarse.advance(1)
            fine.advance(finer)
            missed.append(np.abs((state(coarse) - state(fine))[3:5]).max() > 1e-6)
        off += missed[-1] and missed[-2]
        hits += int(coarse.counts.impacts[0])
    assert hits > 120
    assert off <= 3


def test_what_comes_by_nearly_a_width_in_a_substep_hits_as_in_64_shorter_ones():
    """One tile that flies at a free or a held one: of 80 runs at most 4 differ, by 3 % at most."""
    off = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        speed = rng.uniform(0.5, 1.0) * WIDTH / H
        way = cmath.rect(1.0, rng.uniform(0.0, 2.0 * math.pi))
        at = (rng.uniform(-2.5, -1.5) + 1j * rng.uniform(-0.9, 0.9)) * WIDTH * way
        tiles = [tile(at.real, at.imag, rng.uniform(0.0, 6.0), speed * way.real, speed * way.imag,
                      rng.normal(0.0, 20.0)),
                 tile(angle=rng.uniform(0.0, 6.0), held=seed % 2 == 1)]
        parts = {"body": material(friction=0.25, restitution=0.5)}
        coarse, fine = simulate(tiles, **parts), simulate(tiles, step=H / 64, **parts)
        coarse.advance(5)
        fine.advance(5 * 64)
        assert coarse.counts.impacts[0] > 0
        apart = np.abs((state(coarse) - state(fine))[3:5]).max() / speed
        assert apart < 0.03
        off += apart > 1e-6
    assert off <= 4


@pytest.mark.parametrize("comes", [0.0, 0.4])
def test_two_tiles_that_pass_each_other_by_more_than_their_width_in_a_substep_end_the_run(comes):
    speed = WIDTH / H
    for part, passes in ((0.99, True), (1.01, False)):
        s = simulate([tile(-0.1, vx=(part - comes) * speed), tile(0.1, vx=-comes * speed)])
        with contextlib.nullcontext() if passes else pytest.raises(SimulationError, match="width"):
            s.advance(8)


@pytest.mark.parametrize("load", [0.05, 0.2, 1.0])
def test_what_a_load_presses_together_is_stopped_however_long_the_substep(load):
    """A tile that comes slower than its load makes it faster in a substep does not bounce, and does
    not pass either."""
    for gap, speed in product((0.0, 1e-3, 0.02, 0.1), (0.0, 0.02, 0.1)):
        s = simulate([tile(held=True), tile((1.0 + gap) * WIDTH, 1e-3, vx=-speed)], step=1 / 30,
                     substeps=4, body=material(restitution=0.2),
                     drive=Drive("constant", force=(-load, 0.0)))
        s.advance(15)
        assert s.counts.deepest[0] < 4e-3 * WIDTH
        assert s.x[1] == pytest.approx(WIDTH, abs=1.2e-3 * WIDTH)


@pytest.mark.parametrize(("angle", "spin"), [(0.005, -44.36), (0.02, -43.9), (0.05, -42.6)])
def test_a_hit_on_tiles_that_touch_does_not_depend_on_when_it_falls(angle, spin):
    """A tile that flies at one of two that touch, all but flat: one corner hits.  The other is
    up to 5 % of the width away, and takes no part, though it would come there in the same
    substep."""
    spins = []
    for refined, phase in product((1, 4), range(8)):
        before = phase / 8 * 5.2e-4
        s = simulate([tile(0, WIDTH / 2), tile(0, -WIDTH / 2),
                      tile(0.03344 + before * 1.2665, -0.03202 + before * 0.02, angle,
                           vx=-1.2665, vy=-0.02)],
                     step=H / refined, substeps=4,
                     body=material(friction=0, restitution=0.2, restitution_threshold=0.01))
        s.advance(2 * refined)
        spins.append(s.omega[2])
    assert spins == pytest.approx([spin] * 16, abs=0.1)


def test_a_point_that_a_manifold_has_not_got_takes_no_part():
    """Four tiles, of which three meet within a substep: the mirror image of what happens is what
    happens in a mirror.  One corner is 3 um from a face, and the other corner of that face, which
    does not touch, comes ten times as fast."""
    there = [(0.0, 0.0, 2.163343770107275, 0.0, 0.0, 0.0),
             (0.013883111175957258, -0.0288898402016089, 2.0577233705188696,
              0.046162641823349525, 0.212476064301562, -4.856694915329324),
             (0.04729135511006507, -0.045433844438970784, -1.781788373583742,
              0.02429809160000211, 0.006042788060837133, 4.207737881662381),
             (-0.006436465514675873, -0.05626023100084412, 2.2237081874823836,
              0.5998297586996894, -0.23812366780750402, -19.715216623732605)]
    ends = []
    for side in (1.0, -1.0):
        s = simulate([tile(side * x, y, side * angle, side * vx, vy, side * spin, held=i == 0)
                      for i, (x, y, angle, vx, vy, spin) in enumerate(there)],
                     step=H / 16, substeps=4, tolerance=1e-10,
                     body=material(friction=1.5, restitution=0.2, restitution_threshold=0.1))
        s.advance(32)
        ends.append(state(s) * np.array([[side], [1.0], [side]] * 2))
    assert np.abs(ends[1] - ends[0]).max() < 1e-9


def meeting_at_random(seed):
    """A tile that spins meets another one, a flat wall or a round one; body, reactor, which."""
    rng = np.random.default_rng(seed)
    e, threshold = float(rng.choice([0.02, 0.1, 0.2, 0.5, 0.8])), float(rng.choice([0.0, 0.01]))
    mu, what = float(rng.choice([0.0, 0.25, 0.6])), int(rng.integers(3))
    spin, angle, speed = rng.normal(0, 60), rng.uniform(-3, 3), rng.uniform(0.05, 1.0)
    high = -0.1 + 0.5 * WIDTH * (abs(math.cos(angle)) + abs(math.sin(angle)))
    reactor = None
    if what == 0:
        tiles = [tile(0, 0, rng.uniform(-3, 3), spin=rng.normal(0, 20)),
                 tile(0.045 + rng.uniform(0, 0.004), rng.uniform(-0.02, 0.02), angle, -speed,
                      rng.normal(0, 0.3), spin)]
    elif what == 1:
        tiles = [tile(0, high + rng.uniform(1e-4, 1e-3), angle, rng.normal(0, 0.3), -speed, spin)]
        reactor = Reactor("rectangle", width=0.6, height=0.2, friction=mu, restitution=e)
    else:
        tiles = [tile(0, high + 2e-3 + rng.uniform(1e-4, 1e-3), angle, rng.normal(0, 0.6),
                      -0.3 * speed, 0.3 * spin)]
        reactor = Reactor("circle", 0.1, friction=mu, restitution=e)
    body = material(friction=mu, restitution=e, restitution_threshold=threshold)
    return tiles, body, reactor, what


def test_what_meets_at_random_comes_off_as_in_shorter_steps():
    """Most to rounding.  What bounces for less than a substep depends on it, by a little."""
    off = [[], [], []]
    for seed in range(600):
        tiles, body, reactor, what = meeting_at_random(seed)
        found = []
        for parts in (1, 64):
            s = simulate(tiles, body=body, reactor=reactor, step=H / parts,
                         substeps=4 if parts == 1 else 1, tolerance=1e-8, passes=200)
            s.advance(16 * parts)
            found.append(np.concatenate([s.vx, s.vy, 0.5 * WIDTH * s.omega]))
        off[what].append(np.abs(found[1] - found[0]).max())
    for errors, most in zip(map(np.array, off), (5e-5, 2e-4, 5e-6), strict=True):
        assert np.median(errors) < 1e-12
        assert np.mean(errors) < most
        assert np.mean(errors > 1e-3) < 0.02


@pytest.mark.parametrize("e", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("threshold", [0.0, 1e-4])
@pytest.mark.parametrize("spin", [0.0, 2.0, -20.0])
def test_bounces_along_a_round_wall_end_in_contact(e, threshold, spin):
    """However slow bounces are: a corner that slides along the wall comes back to it, sooner each
    time.  It hit some 1,000 times a second, and every hit left it deeper, to the slop of 1e-3."""
    def slide(step, substeps):
        start = 0.15 - 0.5 * WIDTH * math.sqrt(2.0) - 1e-4
        s = simulate([tile(start, 0.0, 0.25 * math.pi, 0.02, 0.3, spin)], step=step,
                     substeps=substeps, tolerance=1e-5, passes=40,
                     body=material(friction=0.0, restitution=e, restitution_threshold=threshold),
                     reactor=Reactor("circle", 0.15, friction=0.0, restitution=e))
        out = 0.0
        for _ in range(round(1.0 / step)):
            s.advance(1)
            out = max(out, beyond_wall(s.scene, s.x, s.y, s.angle))
        return np.array([s.vx[0], s.vy[0], 0.5 * WIDTH * s.omega[0]]), out, s.counts.impacts[0]

    found, out, hits = slide(1 / 480, 4)
    fine, _, _ = slide(1 / 7680, 1)
    assert hits < 40
    assert out < 2e-4
    assert np.abs(found - fine).max() < 1e-3


def before_spinning_in(time):
    """A tile that spins into another one, by so long before (s)."""
    return [tile(x - time * vx, y - time * vy, angle - time * spin, vx, vy, spin)
            for x, y, angle, vx, vy, spin in (
                (-0.04246031895394268, -0.01008922875072182, 0.3959409297890365,
                 1.3586216231962303, -0.9807967918654902, 95.58267503851897),
                (-0.023259644392973886, -0.047581941706474486, 0.06274797359765506,
                 -0.12947619360216334, -0.06140164660529461, 15.202133492658566))]


@pytest.mark.parametrize("e", [0.02, 0.05])
@pytest.mark.parametrize("threshold", [0.0, 0.01])
def test_a_corner_that_bounces_for_less_than_a_substep_is_in_contact(e, threshold):
    """A tile spins into another one; its corner bounces once or twice, and then is borne along the
    curve of its way.  Hit once a substep, and not borne, it was off by 0.8 rad/s."""
    for before in np.linspace(0.0, 5.2e-4, 5):
        spins = []
        for step, substeps, steps in ((H, 4, 3), (H / 64, 1, 192)):
            s = simulate(before_spinning_in(before), step=step, substeps=substeps, tolerance=1e-9,
                         passes=200, body=material(friction=0.6, restitution=e,
                                                   restitution_threshold=threshold))
            s.advance(steps)
            spins.append(s.omega[0])
        assert spins[0] == pytest.approx(spins[1], abs=0.03)


@pytest.mark.parametrize("drive", [None, Drive("constant", (0.07, 0.02), 0.0)])
def test_what_turns_on_its_way_to_a_slow_touch_is_not_stopped_on_the_chord(drive):
    """Two plastic tiles of which one spins fast: after the impact one corner would hit again along
    its chord, at 1.3 m/s, and on its arc touches slowly if at all.  Whenever the impact falls in a
    substep, and whatever forces act on both alike, what has been in contact for a little longer
    has a little less spin."""
    spins = []
    for before in np.linspace(0.0, 5.2e-4, 25):
        s = simulate(before_spinning_in(before), step=H, substeps=4, tolerance=1e-9, drive=drive,
                     body=material(friction=0.6, restitution=0, restitution_threshold=0.01))
        s.advance(3)
        spins.append(s.omega[0])
    assert np.mean(spins) == pytest.approx(40.1, abs=0.1)
    assert np.abs(np.diff(spins)).max() < 0.1


@pytest.mark.parametrize(("target", "tilt", "along", "e", "threshold", "after"), [
    ("held tile", 0.0147, -0.06, 0.0, 0.0, -0.1692),
    ("held tile", 0.0147, -0.06, 0.0, 0.01, -0.1692),
    ("wall", 0.00277, 0.0229, 0.2, 0.1, -0.086)])
def test_a_tile_that_tips_over_lands_as_if_its_first_corner_had_left(target, tilt, along, e,
                                                                     threshold, after):
    """It comes tilted at 0.4 m/s: the corner that lands first goes off along its arc while the
    other comes down, slower than what bounces, and is 5e-5 of the width away by then.  Whatever the
    phase of it all in a substep."""
    speed, found = 0.4, []
    half = 0.5 * WIDTH * (math.cos(tilt) + math.sin(tilt))
    for phase in np.linspace(0.0, 0.95, 10):
        ahead = (8 + phase) / 1920
        face = -0.25  # its x
        comes = tile(face + half + speed * ahead, -along * ahead, tilt, -speed, along)
        held = [tile(face - 0.5 * WIDTH, held=True)] if target == "held tile" else []
        s = simulate([comes, *held],
                     reactor=None if held else Reactor("rectangle", width=0.5, height=2.0,
                                                       friction=0.25, restitution=e),
                     body=material(friction=0.25, restitution=e, restitution_threshold=threshold),
                     substeps=4, tolerance=1e-9, passes=3000)
        s.advance(8)
        found.append(s.vy[0] / speed)
    assert found == pytest.approx([after] * 10, abs=2e-3)


# --- where tiles are between steps ---------------------------------------------------------------


@pytest.mark.parametrize("substeps", [1, 2, 3, 8])
@pytest.mark.parametrize("speed", [0.7, 4.0])
def test_a_tile_is_on_its_way_to_a_hit_until_it_is_there(speed, substeps):
    """An elastic tile that flies to and fro between two walls, after every step: it hits them at
    any moment of one, and is neither in them nor back too soon."""
    room, start = 0.07, 0.011
    body = material(friction=0.0, restitution=1.0)
    s = simulate([tile(start, vx=speed)], body=body, step=1 / 120,
                 substeps=substeps * (8 if speed > 1.0 else 1),
                 reactor=Reactor("rectangle", width=room + WIDTH, height=0.1, friction=0.0,
                                 restitution=1.0))
    off = []
    for k in range(1, 500):
        s.advance(1)
        way = (start + 0.5 * room + speed * k / 120) % (2.0 * room)
        x, vx = (way, speed) if way < room else (2.0 * room - way, -speed)
        assert s.x[0] == pytest.approx(x - 0.5 * room, abs=1e-10)
        off.append(s.vx[0] != pytest.approx(vx, abs=1e-9))
    assert sum(off) == 0


def bouncing(seed, mu=0.1):
    """Ten elastic tiles in a round wall, with corners that go at some 5 m/s."""
    rng = np.random.default_rng(seed)
    tiles = [replace(each, velocity=tuple(rng.normal(0.0, 0.5, 2).tolist()),
                     spin=rng.normal(0.0, 150.0)) for each in cloud(10, seed)]
    return simulate(tiles, body=material(friction=mu, restitution=1.0), step=1 / 120, substeps=12,
                    tolerance=1e-9, passes=200,
                    reactor=Reactor("circle", 0.18, friction=mu, restitution=1.0))


def test_after_a_step_nothing_is_where_a_hit_to_come_will_throw_it_from():
    """What a substep has foreseen to hit only after its end would be within what it hits, by up to
    half a substep's way."""
    deep, early = [], 0
    for seed in range(6):
        s = bouncing(seed)
        for _ in range(120):
            s.advance(1)
            deep.append(max(deepest(s.x, s.y, s.angle, WIDTH),
                            beyond_wall(s.scene, s.x, s.y, s.angle)))
            early += int(s.state.early[0])
    assert early > 30
    assert max(deep) < 2e-3


def shaken_and_rough(seed):
    """Sixty rough tiles that are thrown about, and moved apart where a solve leaves overlap."""
    scene = stress.crowd(
        60, material=Material(friction=0.6, restitution=0.9), magnet=Magnet(5.4e-5, mismatch=0),
        drive=Drive("shaking", 0.15, 0.0, 1.0), floor=Floor(linear=0.05, angular=0.05),
        wall=Reactor("circle", 0.2, friction=0.0, restitution=0.2))
    return replace(scene, run=Run(1.0, seed))


def pressed_into_a_corner(seed):
    """Sixty smooth elastic tiles that a load presses into a corner of a plastic box, at the paper's
    settings: each bounce there pushes on something that is at the wall."""
    scene = stress.crowd(
        60, material=material(friction=0.0, restitution=0.9),
        drive=Drive("constant", (0.25, 0.15), 0.0), h=1 / 120,
        wall=Reactor("rectangle", width=0.5, height=0.3, friction=1.0, restitution=0.0))
    return replace(scene, seed=None, run=Run(1.0, seed),
                   solver=Solver(1 / 120, 12, 2e-2, 80, 0.025))


@pytest.mark.parametrize(("crowd", "most"), [(shaken_and_rough, 3.6e-3),
                                             (pressed_into_a_corner, 2.5e-3)])
def test_after_a_step_a_driven_crowd_is_hardly_in_itself_or_in_the_wall(crowd, most):
    """The deepest that is seen, in the mean of runs; amid substeps it is 0.2 % of the width."""
    deepest_of = []
    for seed in range(6):
        scene = crowd(seed)
        rng, layout = np.random.default_rng(seed), initial_layout(scene)
        vx, vy, omega = (~layout.held * rng.normal(0.0, spread, layout.x.size)
                         for spread in (0.5, 0.5, 10.0))
        s, deep = Simulation(scene, replace(layout, vx=vx, vy=vy, omega=omega)), 0.0
        for _ in range(round(0.6 / s.h)):
            s.advance(1)
            deep = max(deep, deepest(s.x, s.y, s.angle, WIDTH, ~layout.held),
                       beyond_wall(scene, s.x, s.y, s.angle))
        deepest_of.append(deep)
    assert np.mean(deepest_of) < most


def test_what_pressed_tiles_do_does_not_depend_on_the_speed_that_both_have():
    """Two tiles that snap, hit and come off each other again; nothing else is in the world."""
    places = np.array([[0.005344156902809388, -0.018736278801941026, 3.5066031296832727],
                       [0.005234651772599286, 0.020455661089555634, 2.9770356806268303]])
    twists = np.array([[-0.08796616184270625, 0.3355824603294419, 4.141341920357768],
                       [0.2250310649797443, 0.002080202248243908, -4.895498035052234]])
    found = []
    for common in (0.0, 1.0, 2.0):
        scene = stress.bare(
            [stress.tile(*place, (twist[0] + common, twist[1]), twist[2], kind)
             for place, twist, kind in zip(places, twists, ("black", "white"), strict=True)],
            types=stress.SETS["chessboard"], magnet=Magnet(),
            material=Material(linear_damping=0.0, angular_damping=0.0))
        s = Simulation(replace(scene, solver=Solver(1 / 480, tolerance=1e-12, passes=20_000,
                                                    join_substeps=False)))
        s.advance(75)
        found.append((s.vx - common, s.vy, s.omega))
        assert s.counts.impacts[0] == 5  # as at a 64th of the step
    assert np.abs(np.diff(found, axis=0)).max() < 1e-9


def test_a_crowd_that_is_solved_once_a_step_keeps_the_loads_that_it_bears():
    """The paper's shaking, one pass at 1/480 s: what an impact throws on something that it is
    pressed to hits that, and is pressed as before; to build the load up anew takes many passes."""
    scene, deep = stress.crowd(150, 0.33), []
    for seed in range(4):
        s = Simulation(replace(scene, run=Run(1.0, seed),
                               solver=Solver(1 / 480, 1, 2e-2, 1)))
        s.run(8.0)
        deep.append(s.counts.deepest[0] / WIDTH)
    assert np.mean(deep) < 0.07


def test_what_is_seen_between_steps_does_not_change_what_comes(tmp_path):
    """In calls of one step, or of many, or from a checkpoint amid each hit."""
    one, many, left = bouncing(3), bouncing(3), bouncing(3)
    many.advance(120)
    early = 0
    for _ in range(120):
        one.advance(1)
        if one.state.early[0] > 0:
            early += 1
            save_checkpoint(tmp_path / "checkpoint.npz", one, "mark")
            left = bouncing(3)
            load_checkpoint(tmp_path / "checkpoint.npz", left, "mark")
            assert (state(left) == state(one)).all()
        else:
            left.advance(1)
            assert (state(left) == state(one)).all()
    assert early > 3
    assert (state(one) == state(many)).all()


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("turn", [0.0, 0.1, 0.3])
def test_a_hit_on_tiles_that_magnets_press_together_keeps_momentum(turn, substeps):
    """No floor, wall, drive or damping, whatever comes off: no tile alone loses what its forces
    have given it before it was hit."""
    hits = 0
    for part, speed, e, mu in product(np.linspace(0.0, 0.3, 4), (0.3, 0.8), (0.0, 0.5), (0.1, 0.6)):
        s = simulate([tile(-0.5 * WIDTH, 0, kind="black"), tile(0.5 * WIDTH, 0, kind="white"),
                      tile(-0.2 * WIDTH, (1.35 + part) * WIDTH, turn, 0, -speed, kind="white")],
                     types=CHESSBOARD, magnet=Magnet(), step=1 / 480, substeps=substeps,
                     body=material(friction=mu, restitution=e, restitution_threshold=0.01))
        begun, _ = momentum(s)
        s.run(0.06)
        hits += s.counts.impacts[0]
        while s.state.early[0] > 0:  # what is seen before a hit lacks what bears it
            s.advance(1)
        now, scale = momentum(s)
        assert (np.abs(now - begun)[:2] <= 1e-12 * scale[:2]).all()
    assert hits > 20


def test_what_is_seen_between_steps_keeps_energy_and_momentum():
    """Those before a hit or those after it, of everything that takes part."""
    early = 0
    for seed in range(8):
        tiles = [replace(each, spin=40.0 * each.spin) for each in cloud(8, seed, 2.0)]
        s = simulate(tiles, body=material(friction=0.0, restitution=1.0), step=1 / 240, substeps=2)
        begun, scale = momentum(s)
        energy = s.kinetic_energy()
        for _ in range(40):
            s.advance(1)
            assert (np.abs(momentum(s)[0] - begun) <= 1e-12 * scale).all()
            assert s.kinetic_energy() == pytest.approx(energy, rel=1e-9)
            early += int(s.state.early[0])
    assert early > 20


def test_what_the_floor_brakes_before_it_hits_may_be_pushed_on():
    """Such a corner does not come in the substep, but not because its arc leads past: the solve
    has to stop it where its neighbours push it on.  Five tiles out of a pressed crowd."""
    now = np.array([
        (0.349347, 0.108583, 4.29833, -0.018385, 0.0381567, -0.886782),
        (0.314793, 0.104293, 1.50530, -0.022523, 0.0636577, -0.895502),
        (0.380677, 0.126480, 2.53223, -0.00732489, 0.0191305, 0.326305),
        (0.334560, 0.143954, 2.48429, 0.0, 0.0, 0.0),
        (0.380152, 0.162113, 4.61220, -0.0105992, 0.0200778, 1.49827)]).T
    for law in ("separate", "coupled", "exact"):
        crowd = scene([tile(0.1 * i - 0.2, 0) for i in range(5)],
                      body=material(friction=0.0, restitution=0.9, restitution_threshold=0.01),
                      reactor=Reactor("rectangle", width=0.8374361, height=0.3570759, friction=0.0,
                                      restitution=0.9),
                      floor=Floor(law=law, linear=2.0), tolerance=1e-5, passes=40,
                      drive=Drive("constant", (-0.1027484, 0.2818559)))
        layout = replace(initial_layout(crowd), **dict(zip(
            ("x", "y", "angle", "vx", "vy", "omega"), now, strict=True)))
        s = Simulation(crowd, layout)
        for _ in range(60):
            s.advance(1)
            assert deepest(s.x, s.y, s.angle, WIDTH) <= 1e-3  # 0.0007 as they begin


@pytest.mark.parametrize("step", [1 / 480, 1 / 1920])
def test_elastic_tiles_that_begin_close_to_each_other_exchange_their_velocities(step):
    """A row whose ends come at the middle: those of the first substep, too, hit one by one."""
    for seed in range(150):
        rng = np.random.default_rng(seed)
        gaps = 10.0 ** rng.uniform(-4.5, -3.0, 2)
        x = np.cumsum([0.0, WIDTH + gaps[0], WIDTH + gaps[1]])
        speeds = np.array([rng.uniform(0.1, 2.0), 0.0, -rng.uniform(0.1, 2.0)])
        s = simulate([tile(each, 0, vx=vx) for each, vx in zip(x, speeds, strict=True)],
                     body=material(friction=0.0, restitution=1.0), step=step, substeps=4,
                     tolerance=1e-9)
        s.run(0.05)  # equal tiles: velocities are exchanged until they are in order
        np.testing.assert_allclose(s.vx, np.sort(speeds), atol=1e-6)
