"""The simulator against closed forms and conservation laws, at a substep of 1/480 s.

The solver's tolerance is far below its default (see scenes.py) unless a test says otherwise.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest
from scenes import (
    CHESSBOARD,
    GRAVITY,
    INERTIA,
    MASS,
    MU,
    SLIDING,
    WIDTH,
    cloud,
    corners,
    material,
    momentum,
    scene,
    simulate,
    state,
    tile,
    turned,
)

from tbsa.errors import InputError
from tbsa.kernels import advance as core
from tbsa.kernels.bodies import Numbers
from tbsa.model.scene import (
    Drive,
    Floor,
    Free,
    Magnet,
    Material,
    Reactor,
    Record,
    Run,
    Scene,
    Solver,
    TileType,
)
from tbsa.model.simulation import Simulation, floor_limits
from tests.benchmarks.invariants import MagnetEnergy, glues_of
from theory import magnets, motion, rotation
from theory.floor import engine_torque, max_torque

DEFAULT = {name: getattr(Solver(), name) for name in ("step", "substeps", "tolerance", "passes")}
FEW = DEFAULT | {"passes": 2}  # as engines for games have it
LAWS = ("separate", "coupled", "exact")


def run_until_still(simulation):
    """Time at the end of the first substep after which nothing moves any more (s)."""
    for _ in range(10_000):
        simulation.advance(1)
        if not state(simulation)[3:].any():
            return simulation.time
    raise AssertionError("it never stops")


def slide(law, damping, step=1 / 120, v0=0.3):
    """Stop of a tile that slides 23 degrees off +x on the floor."""
    s = simulate([tile(0, 0, 0.2, v0 * math.cos(0.4), v0 * math.sin(0.4))], floor=Floor(law),
                 body=material(linear_damping=damping, angular_damping=damping), step=step)
    return s, run_until_still(s)


# Floor friction.


@pytest.mark.parametrize("law", LAWS)
def test_a_sliding_tile_stops_after_v0_over_mu_g_and_half_of_v0_squared_over_mu_g(law):
    """t = v0/(mu g), d = v0^2/(2 mu g), to rounding: deceleration is constant."""
    s, time = slide(law, 0.0)
    t, d = 0.3 / (MU * GRAVITY), 0.3**2 / (2.0 * MU * GRAVITY)
    assert (t, d) == pytest.approx(motion.sliding_stop(0.3, MU), rel=1e-12)
    assert t <= time < t + 1.01 * s.h
    assert (s.x[0], s.y[0]) == pytest.approx((d * math.cos(0.4), d * math.sin(0.4)), abs=1e-15)
    assert s.angle[0] == 0.2


@pytest.mark.parametrize("law", LAWS)
def test_a_damped_sliding_tile_stops_with_an_error_of_second_order(law):
    """t = ln(1 + c v0/(mu g))/c, d = v0/c - (mu g/c^2) ln(1 + c v0/(mu g)), c = 0.8 1/s."""
    c, rate = 0.8, MU * GRAVITY
    t = math.log(1.0 + c * 0.3 / rate) / c
    d = 0.3 / c - rate / c**2 * math.log(1.0 + c * 0.3 / rate)
    assert (t, d) == pytest.approx(motion.sliding_stop(0.3, MU, c), rel=1e-9)
    errors = []
    for step in (1 / 240, 1 / 480, 1 / 960):
        s, time = slide(law, c, step)
        assert t - 1e-3 * s.h <= time < t + 1.01 * s.h
        errors.append(abs(math.hypot(s.x[0], s.y[0]) - d))
        assert math.atan2(s.y[0], s.x[0]) == pytest.approx(0.4, abs=1e-12)
    assert errors[1] < 1e-5 * d
    assert errors[0] / errors[1] > 2**1.9
    assert errors[1] / errors[2] > 2**1.9


@pytest.mark.parametrize("damping", [0.0, 0.5])
@pytest.mark.parametrize(("reading", "torque"), [
    ("engine", engine_torque(0.25, MASS, WIDTH)),
    ("uniform-pressure", max_torque(0.25, MASS, WIDTH)),
])
def test_a_spinning_tile_stops_after_the_closed_forms(reading, torque, damping):
    """t = ln(1 + c I w0/T)/c and angle = w0/c - T/(I c^2) ln(1 + c I w0/T); c = 0: I w0^2/2T."""
    s = simulate([tile(0.1, 0.2, 0.3, spin=20.0)], floor=Floor(angular_reading=reading),
                 body=material(angular_damping=damping))
    time = run_until_still(s)
    t, angle = motion.spin_stop(20.0, torque, INERTIA, damping)
    assert t - 1e-3 * s.h <= time < t + 1.01 * s.h
    assert s.angle[0] - 0.3 == pytest.approx(angle, rel=1e-5 if damping else 1e-12)
    assert (s.x[0], s.y[0]) == (0.1, 0.2)


@pytest.mark.parametrize(("law", "nothing"), [
    *((law, {"gravity": 0.0}) for law in LAWS), ("separate", {"linear": 0.0, "angular": 0.0}),
    ("coupled", {"linear": 0.0}), ("exact", {"linear": 0.0}), ("coupled", {"gravity": 1e-310})])
def test_a_floor_without_friction_is_as_none_to_the_bit(law, nothing):
    tiles = [tile(0.0, 0.0, 0.1, 0.2, 0.05, 3.0), tile(0.032, 0.001, 0.2, -0.1)]
    on, off = (simulate(tiles, floor=floor, drive=Drive("constant", (0.01, 0.02), 1e-5))
               for floor in (Floor(law, **nothing), None))
    for s in (on, off):
        s.run(0.5)
    assert (state(on) == state(off)).all()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("share", [0.5, 0.999])
def test_a_load_within_the_floors_friction_moves_nothing_by_a_single_bit(law, share):
    """|F| < mu m g: at rest for ever."""
    load = share * SLIDING
    s = simulate([tile(0.1, 0.2, 0.3)], floor=Floor(law),
                 drive=Drive("constant", (load * math.cos(0.7), load * math.sin(0.7))))
    before = state(s)
    s.run(5.0)
    assert (state(s) == before).all()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("share", [1.001, 1.5])
def test_a_load_beyond_the_floors_friction_accelerates_by_what_is_beyond(law, share):
    """v = (F - mu m g) t/m."""
    load = share * SLIDING
    s = simulate([tile(0.1, 0.2, 0.3)], floor=Floor(law),
                 drive=Drive("constant", (load * math.cos(0.7), load * math.sin(0.7))))
    s.run(1.0)
    v = (load - SLIDING) / MASS
    assert (s.vx[0], s.vy[0]) == pytest.approx((v * math.cos(0.7), v * math.sin(0.7)), rel=1e-9)
    assert s.omega[0] == 0.0


@pytest.mark.parametrize("solver", [DEFAULT, FEW], ids=["default", "few passes"])
@pytest.mark.parametrize("law", LAWS)
def test_touching_tiles_at_rest_stay_at_rest_to_the_bit_and_press_nobody(law, solver):
    """Every tile of a block of 3 x 3 is held by the floor under it."""
    block = [tile(i * WIDTH, j * WIDTH) for i in range(3) for j in range(3)]
    s = simulate(block, floor=Floor(law), drive=Drive("constant", (0.9 * SLIDING, 0.3 * SLIDING)),
                 **solver)
    before = state(s)
    s.run(2.0)
    assert (state(s) == before).all()
    assert s.contact_forces()["a"].size == 0


@pytest.mark.parametrize("seed", [45, 98, 175, 206])
def test_reported_friction_stays_in_the_cone_while_a_tile_lands_flat(seed):
    """One corner is down while the other is still on its way."""
    rng = np.random.default_rng(seed)
    s = simulate([tile(held=True),
                  tile(0.0305, rng.uniform(-0.01, 0.01), rng.uniform(-0.02, 0.02),
                       -rng.uniform(0.05, 0.3), rng.uniform(-0.5, 0.5), rng.uniform(-3.0, 3.0))],
                 body=material(friction=0.5, restitution_threshold=0.01), tolerance=1e-9)
    touched = 0
    for _ in range(60):
        s.advance(1)
        contact = s.contact_forces()
        touched += contact["a"].size
        assert (np.abs(contact["friction"]) <= 0.5 * (contact["normal0"] + contact["normal1"])
                * (1.0 + 1e-12)).all()
    assert touched > 0


def test_a_row_that_is_pushed_less_than_its_floor_friction_in_sum_stays():
    """A driven tile alone would slide; with three others in front of it, it does not.

    Its push of up to 2 mu m g is passed on: the floor under each takes mu m g.
    """
    push = TileType("push", (0, 0, 0, 0), "red", 1, "E")
    idle = TileType("tile", (0, 0, 0, 0), "grey", 0)
    tiles = [tile(0, 0, kind="push"), *(tile(i * WIDTH, 0) for i in (1, 2, 3))]
    force = 1.999 * SLIDING
    s = simulate(tiles, types=(push, idle), floor=Floor(angular=0.25),
                 drive=Drive("unicycle", force, 0.0, 0.25))  # peak after 1 s
    before = state(s)
    s.run(1.9)
    assert np.abs(state(s)[:3] - before[:3]).max() < 1e-6 * WIDTH
    assert np.abs(state(s)[3:]).max() < 1e-9


# One driven tile.


@pytest.mark.parametrize("torque", [7.5e-4, 7e-4])
def test_a_driven_tile_sticks_and_slips_as_the_equations_of_motion_say(torque):
    """Two periods of the unicycle drive; the error stays below 12 h^2 (h in s).

    It is relative to the largest coordinate and speed, angle and spin of the motion.
    """
    kind = (TileType("tile", (0, 0, 0, 0), "grey"),)
    body = Material(restitution_threshold=0.0)
    times = np.arange(1.0, 21.0)
    truth = scale = None
    for step in (1 / 60, 1 / 120, 1 / 240, 1 / 480):
        s = simulate([tile()], types=kind, floor=Floor(), body=body, step=step,
                     drive=Drive("unicycle", 0.075, torque, 0.1))
        if truth is None:
            force, moment = floor_limits(s.scene)
            truth = motion.driven_tile(
                times, mass=MASS, inertia=INERTIA, force=0.075, torque=torque, frequency=0.1,
                friction_force=force, friction_torque=moment,
                linear_damping=body.linear_damping, angular_damping=body.angular_damping)
            reach = np.abs(truth).max(axis=0)
            scale = np.array([reach[:2].max(), reach[:2].max(), reach[2],
                              reach[3:5].max(), reach[3:5].max(), reach[5]])
            assert reach[2] > 2.0  # it turns
            assert (truth[:, 3:] == 0.0).all(axis=1).sum() >= 2  # and rests in between
        found = []
        for _ in times:
            s.run(1.0)
            found.append(state(s)[:, 0])
        assert (np.abs(np.array(found) - truth) / scale).max() < 12.0 * s.h**2


# Impacts along a line.


@pytest.mark.parametrize("turn", [0.0, 0.5])
@pytest.mark.parametrize("e", [0.0, 0.2, 1.0])
def test_two_tiles_hit_head_on_with_exact_restitution(e, turn):
    """v_b' - v_a' = -e (v_b - v_a) with momentum kept, to 1e-12."""
    va, vb = turned(0.3, 0.0, turn), turned(-0.1, 0.0, turn)
    at = turned(1.01 * WIDTH, 0.0, turn)
    s = simulate([tile(0, 0, turn, *va), tile(*at, turn, *vb)],
                 body=material(restitution=e), tolerance=1e-15)
    s.run(0.05)
    ua, ub = motion.head_on(MASS, 0.3, MASS, -0.1, e)
    expected = [*turned(ua, 0.0, turn), *turned(ub, 0.0, turn)]
    assert [s.vx[0], s.vy[0], s.vx[1], s.vy[1]] == pytest.approx(expected, abs=1e-12)
    assert np.abs(s.omega).max() < 1e-11


@pytest.mark.parametrize("tilt", [0.002, 0.01, 0.03])
def test_a_tile_tips_about_the_corner_that_bears_it(tilt):
    """It sticks with one corner on the face of a held one; the other point of the manifold is open,
    and the lever arm of friction is that of the corner: alpha = (r x F)/(I + m w^2/2)."""
    c, n, half = math.cos(tilt), math.sin(-tilt), 0.5 * WIDTH
    rx, ry = -half * c + half * n, -half * n - half * c
    s = simulate([tile(0.05 + rx, half + ry, -tilt), tile(0.05 + half, half, held=True)],
                 body=material(friction=2.0), drive=Drive("constant", (0.1, 0.12)), step=1 / 3840)
    s.advance(2)
    expected = (rx * 0.12 - ry * 0.1) / (INERTIA + 0.5 * MASS * WIDTH**2)
    assert s.omega[0] / s.time == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("e", [0.0, 0.2, 1.0])
def test_a_tile_bounces_off_a_held_one_with_exact_restitution(e):
    """v' = -e v."""
    s = simulate([tile(held=True), tile(0, 1.01 * WIDTH, 0.5 * math.pi, 0.0, -0.3)],
                 body=material(restitution=e), tolerance=1e-15)
    s.run(0.05)
    assert (s.vx[1], s.vy[1]) == pytest.approx((0.0, 0.3 * e), abs=1e-12)
    assert abs(s.omega[1]) < 1e-11
    assert s.y[0] == s.vy[0] == 0.0


WALLS = {
    "face on a straight wall": (Reactor("rectangle", width=0.1, height=0.1), 0.0),
    "corner on a straight wall": (Reactor("rectangle", width=0.1, height=0.1), 0.25 * math.pi),
    "two corners on a circle": (Reactor("circle", 0.05), 0.0),
    "one corner on a circle": (Reactor("circle", 0.05), 0.25 * math.pi),
}


@pytest.mark.parametrize("e", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("case", WALLS)
def test_a_tile_bounces_off_a_wall_with_exact_restitution(case, e):
    """v' = -e v, also for two corners at once, on a circle without friction."""
    reactor, angle = WALLS[case]
    reactor = replace(reactor, restitution=e, friction=0.0 if "two corners" in case else 0.25)
    s = simulate([tile(0.02, 0.0, angle, 0.3)], reactor=reactor, tolerance=1e-15)
    s.run(0.08)
    assert s.counts.impacts[0] > 0
    assert (s.vx[0], s.vy[0]) == pytest.approx((-0.3 * e, 0.0), abs=1e-12)
    assert abs(s.omega[0]) < 1e-10


# Bonds.


@pytest.mark.parametrize(("cutoff", "force"), [(0.03, 0.1312), (0.02, 0.2037)])
def test_a_bond_holds_below_its_force_and_opens_above(cutoff, force):
    """Held black, white pulled off along the normal from where it is flush; no floor.

    0.1312 N with every pair of magnets nearer than 3 cm, 0.2037 N with the mating pair alone.
    """
    law = magnets.Law(cutoff=cutoff, switch=0.1)
    bond = magnets.bond_force(CHESSBOARD[0].glues, CHESSBOARD[1].glues, law)
    assert bond == pytest.approx(force, abs=1e-4)
    for share in (0.995, 1.005):
        s = simulate([tile(held=True, kind="black"), tile(WIDTH, 0, kind="white")],
                     types=CHESSBOARD, magnet=Magnet(cutoff=cutoff),
                     drive=Drive("constant", (share * bond, 0.0)))
        s.run(2.0)
        if share < 1.0:
            contact = s.contact_forces()
            assert s.x[1] == pytest.approx(WIDTH, abs=1e-9 * WIDTH)
            assert contact["normal0"] + contact["normal1"] == pytest.approx(
                (1.0 - share) * bond, rel=1e-6)
        else:
            assert s.x[1] > 10.0 * WIDTH


# Conservation.

CLOUDS = [(n, mu, e, seed) for n in (2, 5, 10, 20, 50) for mu in (0.0, 0.25, 1.0)
          for e in (0.0, 0.2, 1.0) for seed in (1, 2)]


def test_collisions_keep_momentum_and_never_raise_the_kinetic_energy():
    """Sum of m v and of m r x v + I omega, to 1e-12 of the sums of their sizes.

    2 to 50 tiles thrown together, half a second, looked at after every substep.  It holds where
    tiles are moved out of a deep overlap, too (`solver.project`), and there are such substeps.
    """
    wrong, projections = [], 0
    for case in CLOUDS:
        n, mu, e, seed = case
        s = simulate(cloud(n, seed), body=material(friction=mu, restitution=e),
                     tolerance=1e-9, passes=2000)
        (before, _), energy = momentum(s), s.kinetic_energy()
        change, rise = np.zeros(3), 0.0
        for _ in range(240):
            s.advance(1)
            now, scale = momentum(s)
            change = np.maximum(change, np.abs(now - before) / scale)
            rise = max(rise, s.kinetic_energy() / energy - 1.0)
            energy = s.kinetic_energy()
        assert s.counts.impacts[0] > 0
        projections += s.counts.projections[0]
        if change.max() > 1e-12 or rise > 1e-12:
            wrong.append((*case, *change, rise))
    assert projections > 100
    assert not wrong, f"{len(wrong)} of {len(CLOUDS)} (n, mu, e, seed, ...): {wrong}"


@pytest.mark.parametrize("load", [0.0, 0.075])
def test_what_overlaps_is_moved_apart_within_some_substeps(load):
    """Twelve tiles in a row against a held one, each 1 % of its width inside the next, pressed or
    not: all are below 0.5 % within 15 substeps, though only the last can give way."""
    s = simulate([tile(held=True), *(tile(0.99 * WIDTH * (i + 1)) for i in range(12))],
                 drive=Drive("constant", (-load, 0.0)), step=1 / 1440, tolerance=2e-2, passes=40,
                 checked=False)
    deepest = []
    for _ in range(120):
        s.advance(1)
        deepest.append(1.0 - np.diff(s.x).min() / WIDTH)
    assert max(deepest) < 0.02
    assert max(deepest[15:]) < 0.005


TUMBLERS = (TileType("a", (1, 1, 2, 2), "black"), TileType("b", (-1, -1, -2, -2), "white"))
FAR = {"cutoff": 0.09, "switch": 0.3}


def total_energy(s):
    """Kinetic energy and that of the magnets (J)."""
    law = magnets.Law(**FAR)
    a, b = zip(s.x, s.y, s.angle, strict=True)
    return s.kinetic_energy() + magnets.pair_energy(a, TUMBLERS[0].glues, b, TUMBLERS[1].glues,
                                                    law)


def test_two_tiles_in_orbit_keep_kinetic_and_magnet_energy_to_second_order():
    """Drift of kinetic energy + sum of U(r) below 1e-4 of the energy, and 4 times less at h/2."""
    drift = []
    for step in (1 / 480, 1 / 960, 1 / 1920):
        s = simulate([tile(-0.028, 0, 0.1, 0, -0.35, 0.5, kind="a"),
                      tile(0.028, 0, -0.2, 0, 0.35, -1.0, kind="b")],
                     types=TUMBLERS, magnet=Magnet(**FAR), step=step, substeps=1)
        energies = [total_energy(s)]
        potential = [energies[0] - s.kinetic_energy()]
        for _ in range(480):
            s.run(1 / 480)
            energies.append(total_energy(s))
            potential.append(energies[-1] - s.kinetic_energy())
        assert s.counts.impacts[0] == 0
        assert np.ptp(potential) > 1e-4  # J: there is something to be exchanged
        drift.append(np.abs(np.array(energies) - energies[0]).max())
    assert drift[0] < 1e-4 * energies[0]
    assert 3.5 < drift[0] / drift[1] < 4.5
    assert 3.5 < drift[1] / drift[2] < 4.5


@pytest.mark.parametrize("spin", [60.0, 120.0, 240.0, 300.0, 120.0 * math.pi, 754.0, 1508.0])
def test_what_spins_past_others_gets_no_energy_from_them(spin):
    """A tile flies past a held one, 1.6 widths from centre to centre, at the paper's step, in half
    of which it turns by a right angle at 120 pi rad/s.

    What spins that fast feels the mean of the others' magnets, and is as fast afterwards: to 2 % of
    the energy of a bond.  With the forces of the middle alone it was 60 % at 300 rad/s, and ten
    times that energy at 754.
    """
    law = magnets.Law()
    bond = -magnets.pair_energy((0.0, 0.0, 0.0), CHESSBOARD[0].glues, (WIDTH, 0.0, 0.0),
                                CHESSBOARD[1].glues, law)
    for angle in np.arange(8) * math.pi / 16:
        s = simulate([tile(held=True, kind="black"),
                      tile(-4 * WIDTH, 1.6 * WIDTH, angle, 0.4, 0.0, spin, kind="white")],
                     types=CHESSBOARD, magnet=Magnet(), step=1 / 120, substeps=12)
        before = s.kinetic_energy()
        s.advance(72)
        assert s.x[1] > 3.9 * WIDTH
        assert s.counts.impacts[0] == 0
        assert s.kinetic_energy() == pytest.approx(before, abs=0.02 * bond)


# Contacts along an arc.


def test_bonded_tiles_that_turn_as_one_stay_together_and_keep_their_spin():
    """No floor, no damping; 20 rad/s, of the 23 that their bond bears; one substep of 1/480 s.

    A row that took the chord for the arc would leave a gap of (h spin)^2 / 2, 9e-4 of the width,
    in the middle of the substep, where contacts are.
    """
    spin = 20.0
    s = simulate([tile(-0.5 * WIDTH, 0, vy=-0.5 * WIDTH * spin, spin=spin, kind="black"),
                  tile(0.5 * WIDTH, 0, vy=0.5 * WIDTH * spin, spin=spin, kind="white")],
                 types=CHESSBOARD, magnet=Magnet(), body=material(restitution_threshold=0.05))
    (before, _), energy = momentum(s), s.kinetic_energy()
    for _ in range(480):
        s.advance(1)
        x, y = s.x - s.vx / 960, s.y - s.vy / 960
        apart = math.hypot(x[1] - x[0], y[1] - y[0]) / WIDTH - 1.0
        assert abs(apart) < 3e-4
        assert s.omega == pytest.approx([spin, spin], rel=5e-4)
    now, scale = momentum(s)
    assert np.abs(now - before).max() < 1e-12 * scale[2]
    assert s.kinetic_energy() == pytest.approx(energy, rel=3e-4)


PAPERS = {"step": 1 / 120, "substeps": 12, "tolerance": 2e-2, "passes": 80, "at_rest": 0.025}


@pytest.mark.parametrize("settings", [DEFAULT, PAPERS, DEFAULT | {"substeps": 3}], ids=str)
@pytest.mark.parametrize(("columns", "rows"), [(2, 1), (2, 2), (3, 1)])
@pytest.mark.parametrize("spin", [5.0, 10.0])
def test_bonded_tiles_that_turn_keep_their_angular_momentum(settings, columns, rows, spin):
    """No floor, no damping, five seconds; forces last for half a step, in which contacts bend the
    way of each tile.

    To 1e-12.  As forces acted where they had been found, a pair at 10 rad/s had 1.11 of it after
    100 s at the paper's settings, and 1.24 of its energy.
    """
    places = [(0.03 * (i - 0.5 * (columns - 1)), 0.03 * (j - 0.5 * (rows - 1)), "bwb"[(i + j) % 2])
              for i in range(columns) for j in range(rows)]
    s = simulate([tile(x, y, 0.0, -spin * y, spin * x, spin, kind={"b": "black", "w": "white"}[of])
                  for x, y, of in places], types=CHESSBOARD, magnet=Magnet(),
                 body=material(restitution_threshold=0.01), **settings)
    (before, _), energy = momentum(s), s.kinetic_energy()
    s.run(5.0)
    now, scale = momentum(s)
    assert s.counts.impacts[0] == 0
    assert np.abs(now - before).max() < 1e-12 * scale[2]
    assert s.kinetic_energy() == pytest.approx(energy, rel=1e-4)


@pytest.mark.parametrize(("substep", "slip"), [(1 / 480, 1e-6), (1 / 960, 1e-7), (1 / 1920, 1e-8)])
def test_static_friction_holds_what_turns_as_one(substep, slip):
    """A bonded pair at 10 rad/s, nothing else: it has no load along its faces, and slips by less
    than this (widths a second), to third order; with mu = 10 as well.

    Along chords it slipped by spin^3 h^2 / 6, 9e-4 at 1/480 s, up to 1 % of the width.
    """
    for mu in (MU, 10.0):
        s = simulate([tile(side * 0.5 * WIDTH, 0, vy=side * 5.0 * WIDTH, spin=10.0, kind=kind)
                      for side, kind in ((-1, "black"), (1, "white"))], types=CHESSBOARD,
                     magnet=Magnet(), body=material(friction=mu, restitution_threshold=0.01),
                     step=2.0 * substep, substeps=2, join_substeps=False)
        s.run(4.0)
        c, n = math.cos(s.angle[0]), math.sin(s.angle[0])
        slide = (c * (s.y[1] - s.y[0]) - n * (s.x[1] - s.x[0])) / WIDTH
        assert abs(slide) < 4.0 * slip


def test_a_bonded_pair_gets_the_angular_momentum_of_its_drive_and_no_other():
    """A torque spins it up, at the paper's settings, to 1e-12: forces of a drive act at centres."""
    torque = 1e-4
    s = simulate([tile(-0.5 * WIDTH, 0, kind="black"), tile(0.5 * WIDTH, 0, kind="white")],
                 types=CHESSBOARD, magnet=Magnet(), drive=Drive("constant", (0.02, 0.0), torque),
                 **PAPERS)
    s.run(0.4)
    (*_, spin), scale = momentum(s)
    assert s.counts.impacts[0] == 0
    assert spin == pytest.approx(0.8 * torque, abs=1e-12 * scale[2])


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("settings", [DEFAULT, DEFAULT | {"tolerance": 1e-10, "passes": 5000}])
@pytest.mark.parametrize(("friction", "play"), [(0.5, 0.02), (0.9, 0.01), (0.95, 0.02)])
def test_a_tile_that_a_torque_wedges_in_a_channel_slows_down_as_friction_has_it(
        friction, play, settings, held):
    """2 mu T / (m w (cos d - sin d)) with the tilt d that fills the channel, wider by `play`.

    Strong friction couples both corners to and fro.  Passes with momentum went in a circle there,
    for as many as they had, and the tile slowed down by up to 1.4 times as much.
    """
    tilt, low = 0.1, 0.0  # cos d + sin d = 1 + play, by halving
    for _ in range(60):
        middle = 0.5 * (low + tilt)
        below = math.cos(middle) + math.sin(middle) < 1.0 + play
        low, tilt = (middle, tilt) if below else (low, middle)
    torque = 2e-4
    tiles, wall = [tile(-0.02, 0.0, tilt, 0.3)], Reactor(
        "rectangle", width=2.0, height=WIDTH * (1.0 + play), friction=friction, restitution=0.0)
    if held:
        tiles += [tile(i * WIDTH, side * WIDTH * (1.0 + 0.5 * play), held=True)
                  for i in range(-4, 5) for side in (1, -1)]
    s = simulate(tiles, reactor=None if held else wall, drive=Drive("constant", (0.0, 0.0), torque),
                 body=material(friction=friction, restitution=0.0, restitution_threshold=0.01),
                 **settings)
    s.run(0.02)
    lever = WIDTH * (math.cos(tilt) - math.sin(tilt))
    assert 0.3 - s.vx[0] == pytest.approx(2.0 * friction * torque / lever / MASS * s.time, rel=5e-3)


@pytest.mark.parametrize("rate", [5.0, 20.0])
def test_a_tile_that_slides_along_a_round_smooth_wall_keeps_its_speed(rate):
    """On two corners, round a wall of 6 cm, for a second; one substep of 1/480 s.

    Where the wall is its tangent for a substep, a second takes 5 and 43 % of the energy.
    """
    radius = 0.06
    seat = rotation.seat(radius, WIDTH)
    s = simulate([tile(0, -seat, vx=rate * seat, spin=rate)],
                 reactor=Reactor("circle", radius, friction=0.0),
                 body=material(restitution_threshold=0.05))
    energy = s.kinetic_energy()
    s.run(1.0)
    assert s.kinetic_energy() <= energy * (1.0 + 1e-12)
    assert s.kinetic_energy() > energy * (1.0 - 0.01)
    assert np.hypot(*corners(s)[0].T).max() < radius + 1e-3 * WIDTH


@pytest.mark.parametrize("tolerance", [1e-12, 1e-5, 1e-1])
def test_a_plastic_tile_slides_along_a_round_wall_without_hitting_it(tolerance):
    """No friction and no threshold, two corners at the wall: it goes round as one with its seat,
    to second order.

    If what comes again along the arc in every substep is stopped as an impact, it loses 0.7 % of
    its spin in 0.4 s at 1/480 s, and half of that at half the step.
    """
    radius, rate = 0.2, 5.0
    seat = math.sqrt(radius**2 - 0.25 * WIDTH**2) - 0.5 * WIDTH
    lost = []
    for step in (1 / 240, 1 / 480, 1 / 960):
        s = simulate([tile(0, -seat, vx=rate * seat, spin=rate)], step=step,
                     tolerance=tolerance, body=material(restitution=0.0),
                     reactor=Reactor("circle", radius, friction=0.0, restitution=0.0))
        s.run(0.4)
        assert s.counts.impacts[0] <= 8  # of the beginning
        lost.append(abs(s.omega[0] / rate - 1.0))
    assert lost[1] < 3e-4
    assert lost[2] < 0.1 * lost[0]


# Contact forces at rest.


@pytest.mark.parametrize("turn", [0.0, math.pi / 6])
@pytest.mark.parametrize("solver", [{}, DEFAULT], ids=["tight", "default"])
def test_a_pressed_row_carries_the_sum_of_the_loads_behind_each_contact(turn, solver):
    """Ten tiles, 0.075 N each, against a held one: contact k carries (11 - k) 0.075 N.

    They overlap by less than 1e-4 of the width.
    """
    u = np.array([math.cos(turn), math.sin(turn)])
    tiles = [tile(0, 0, turn, held=True), *(tile(*(-i * WIDTH * u), turn) for i in range(1, 11))]
    s = simulate(tiles, drive=Drive("constant", tuple(0.075 * u)), **solver)
    s.run(2.0)
    contact = s.contact_forces()
    order = np.argsort(contact["a"])
    force = (contact["normal0"] + contact["normal1"])[order]
    assert (contact["a"][order] == np.arange(10)).all()
    assert force == pytest.approx(0.075 * np.arange(10, 0, -1), rel=1e-3)
    # One that presses at one end more than at the other would turn.
    assert contact["normal0"] == pytest.approx(contact["normal1"], rel=1e-3)
    along = s.x * u[0] + s.y * u[1]
    assert np.abs(-np.diff(along) - WIDTH).max() < 1e-4 * WIDTH
    assert np.abs(s.x * u[1] - s.y * u[0]).max() < 1e-6 * WIDTH
    assert np.abs(state(s)[3:]).max() < 1e-9


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("skip", [True, False], ids=["list", "blocks"])
def test_what_a_long_row_carries_settles_in_few_passes(substeps, skip):
    """Twenty tiles pressed against a held one, from no impulses to 1e-9 m/s, in the first step.

    A contact hands its load on to the next: passes without momentum need some 4,700.
    """
    s = simulate([tile(0, 0, held=True), *(tile(-i * WIDTH, 0) for i in range(1, 21))],
                 drive=Drive("constant", (0.075, 0.0), 0.0), step=1 / 480, substeps=substeps,
                 tolerance=1e-9, passes=5000, skip_converged=skip)
    s.advance(1)
    assert s.counts.passes[0] < 400
    assert s.counts.unconverged[0] == 0
    contact = s.contact_forces()
    force = (contact["normal0"] + contact["normal1"])[np.argsort(contact["a"])]
    assert force == pytest.approx(0.075 * np.arange(20, 0, -1), rel=1e-5)


@pytest.mark.parametrize("passes", [12, 20, 40])  # momentum acts between the 6th and the last four
def test_a_solve_that_is_broken_off_presses_only_and_does_no_work(passes):
    """Thirty tiles fly into a held one, with too few passes to solve that: impulses that have
    momentum still press, and energy still falls."""
    flying = (tile(-1.0001 * i * WIDTH, 0.05 * WIDTH * (i % 3), vx=0.5) for i in range(1, 31))
    s = simulate([tile(0, 0, held=True), *flying],
                 drive=Drive("constant", (0.02, 0.0), 0.0), step=1 / 480, substeps=1,
                 tolerance=1e-9, passes=passes)
    put_in = energy = s.kinetic_energy()
    for _ in range(60):
        x = s.x.copy()
        s.advance(1)
        put_in += 0.02 * float((s.x - x)[1:].sum())
        contact = s.contact_forces()
        assert (contact["normal0"] >= 0.0).all()
        assert (contact["normal1"] >= 0.0).all()
        assert s.kinetic_energy() <= put_in + 1e-9 * energy
    assert s.counts.unconverged[0] > 0


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_a_tile_that_rests_in_a_circular_wall_is_in_balance(angle):
    """The wall's forces at two corners add up to the load, their torque to nothing."""
    radius, load = 0.06, np.array([0.0, -0.05])
    s = simulate([tile(0, 0, angle)], reactor=Reactor("circle", radius),
                 drive=Drive("constant", tuple(load)),
                 body=material(linear_damping=5.0, angular_damping=5.0,
                               restitution_threshold=0.01))
    s.run(4.0)
    assert np.abs(state(s)[3:]).max() < 1e-12
    points = corners(s)[0]
    points = points[np.argsort(np.hypot(*points.T))[2:]]
    assert np.hypot(*points.T) == pytest.approx(radius, abs=1e-6 * WIDTH)
    contact = s.contact_forces()
    assert (contact["b"] == 1).all()
    assert len(contact["b"]) == 2
    assert (np.abs(contact["friction"]) <= 0.25 * contact["normal0"] * (1 + 1e-12)).all()
    best = []
    for order in ([0, 1], [1, 0]):  # which corner is which is not told
        n = points[order] / radius
        t = np.stack([-n[:, 1], n[:, 0]], axis=1)
        # normal from tile to wall; the wall's impulse on the tile is the opposite
        push = -(contact["normal0"][:, None] * n + contact["friction"][:, None] * t)
        arm = points[order] - [s.x[0], s.y[0]]
        torque = (arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]).sum()
        best.append(np.abs([*(push.sum(axis=0) + load), torque / WIDTH]).max())
    assert min(best) < 1e-9


# Walls and held tiles in a crowd.


@pytest.mark.parametrize("reactor", [Reactor("circle", 0.2),
                                     Reactor("rectangle", width=0.4, height=0.3)],
                         ids=lambda reactor: reactor.shape)
@pytest.mark.parametrize("solver", [DEFAULT, FEW], ids=["default", "few passes"])
def test_a_shaken_crowd_stays_inside_its_wall_and_the_seed_where_it_is(reactor, solver):
    """60 tiles, shaken at 1 Hz for 5 s: no corner more than 0.5 % of a width beyond the wall."""
    chosen = scene([tile(held=True), tile(WIDTH, 0, held=True)], reactor=reactor, floor=Floor(),
                   drive=Drive("shaking", 0.1, 0.0, 1.0), body=Material(), **solver)
    chosen = replace(chosen, free=replace(chosen.free, counts=(("tile", 58),)))
    s = Simulation(chosen)
    seed = state(s)[:, :2]
    beyond = -1.0
    for _ in range(240):
        s.advance(10)
        p = corners(s).reshape(-1, 2)
        if reactor.shape == "circle":
            beyond = max(beyond, np.hypot(*p.T).max() - reactor.radius)
        else:
            beyond = max(beyond, np.abs(p[:, 0]).max() - 0.5 * reactor.width,
                         np.abs(p[:, 1]).max() - 0.5 * reactor.height)
    assert s.counts.impacts[0] > 1000
    assert beyond < 0.005 * WIDTH
    assert (state(s)[:, :2] == seed).all()


# Drives.

SPRINGS = """
def spring(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    for i in range(x.size):
        fx[i] -= p[0] * x[i]
        fy[i] -= p[0] * y[i]


def wind(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    for i in range(x.size):
        fx[i] += p[0] * t
        torque[i] += p[1]
"""


def with_engine(folder, function, parameters, tiles):
    (folder / "springs.py").write_text(SPRINGS)
    drive = Drive("user", module="springs.py", function=function, parameters=parameters)
    return simulate(tiles, drive=drive, file=str(folder / "scene.toml"))


@pytest.mark.parametrize("ground", ["straight wall", "round wall", "held tile"])
def test_a_tile_that_swings_about_a_corner_that_sticks_keeps_its_energy(ground):
    """It rises against a load as high as its energy lets it, to second order.

    Friction that stops the corner on its chord only, and not on its arc, does work: by then it was
    1e-4 of its tilt too high, and half of that at half the step.
    """
    load, spin, tilt = 0.005, 1.5, 0.15
    inertia = 2.0 / 3.0 * MASS * WIDTH**2  # about the corner
    arm = cmath.rect(math.sqrt(0.5) * WIDTH, 0.75 * math.pi - tilt)  # from there to the centre
    rise = spin**2 * inertia / (load * WIDTH) + math.cos(tilt) + math.sin(tilt)
    highest = 0.25 * math.pi - math.acos(rise / math.sqrt(2.0))
    walls = {"straight wall": Reactor("rectangle", width=0.4, height=0.4, friction=1.0),
             "round wall": Reactor("circle", 0.2, friction=1.0)}
    held = [tile(0.2 * WIDTH, -0.2 - 0.5 * WIDTH, held=True)] if ground == "held tile" else []
    v = -1j * spin * arm

    def reached(step):
        s = simulate([*held, tile(arm.real, arm.imag - 0.2 + 1e-12, -tilt, v.real, v.imag, -spin)],
                     reactor=walls.get(ground), body=material(restitution=0.0, friction=1.0),
                     drive=Drive("constant", (0.0, -load)), step=step, substeps=4, tolerance=1e-9,
                     passes=400)
        tilts = []
        for _ in range(round(0.5 / step)):
            s.advance(1)
            tilts.append(-float(s.angle[len(held)]))
        k = int(np.argmax(tilts))
        a, b, c = tilts[k - 1:k + 2]  # the top of the parabola
        return b + (c - a) ** 2 / (8.0 * (2.0 * b - a - c))

    off = [abs(reached(step) / highest - 1.0) for step in (1 / 240, 1 / 480, 1 / 960)]
    assert off[1] < 1e-5
    assert math.log2(off[0] / off[2]) / 2.0 > 1.9


def test_a_users_spring_makes_a_tile_swing(tmp_path):
    """x = x0 cos(w t), y = (vy0/w) sin(w t), w = sqrt(k/m), to (w h)^2 of its size."""
    k = 0.4
    s = with_engine(tmp_path, "spring", (k,), [tile(0.1, 0.0, 0.2, 0.0, 0.3)])
    w = math.sqrt(k / MASS)
    for _ in range(12):
        s.run(0.25)
        assert s.x[0] == pytest.approx(0.1 * math.cos(w * s.time), abs=0.1 * (w * s.h) ** 2)
        assert s.y[0] == pytest.approx(0.3 / w * math.sin(w * s.time), abs=0.1 * (w * s.h) ** 2)
    assert s.angle[0] == 0.2


def test_another_users_drive_does_not_recompile_the_core(tmp_path):
    """v = a t^2/2 and omega = T t/I under a load that grows; no new signature."""
    with_engine(tmp_path, "spring", (1.0,), [tile()]).run(0.1)
    compiled = len(core.advance.signatures)
    s = with_engine(tmp_path, "wind", (0.2, 1e-6), [tile()])
    s.run(1.0)
    assert s.vx[0] == pytest.approx(0.5 * 0.2 / MASS, rel=1e-9)
    assert s.omega[0] == pytest.approx(1e-6 / INERTIA, rel=1e-9)
    assert len(core.advance.signatures) == compiled


def test_steps_are_whole_numbers():
    """Half a step is an error, not none and not one; any kind of whole number will do."""
    s = simulate([tile(vx=0.1)])
    for steps in (1.5, 2.0, "3"):
        with pytest.raises(TypeError):
            s.advance(steps)
    s.advance(np.int32(2))
    s.advance(2)
    assert s.steps == 4


def test_whole_numbers_in_a_scene_do_not_recompile_the_core():
    """A friction of 1 is the float 1.0 by the time that the core sees it."""
    s = simulate([tile(0, 0), tile(1, 0)], floor=Floor(linear=1, angular=0, gravity=10),
                 body=Material(friction=0, restitution=1, mass=1, width=1, linear_damping=0),
                 reactor=Reactor("rectangle", width=10, height=8, friction=1, restitution=0),
                 tolerance=1)
    for name, kind in get_type_hints(Numbers).items():
        assert type(getattr(s.numbers, name)) is kind, name
    assert isinstance(s.floor.force, float)
    assert isinstance(s.floor.torque, float)


# What is not there yet when a substep or a step begins.


def test_a_corner_that_comes_in_from_the_side_is_stopped_at_the_face():
    """At the middle of the substep before, the tile is still beside it; unforeseen, nothing hits
    in this substep."""
    h, vx, vy = 1 / 480, -2.0, -0.6
    s = simulate([tile(0.0, 0.0, held=True),
                  tile(WIDTH + 4e-4 - 0.5 * h * vx, WIDTH + 2e-4 - 0.5 * h * vy, vx=vx, vy=vy)],
                 body=material(friction=0.0, restitution=0.5), step=h)
    s.advance(1)
    assert s.counts.impacts[0] >= 1
    assert s.vy[1] > vy
    s.advance(3)
    assert s.counts.deepest[0] < 5e-3 * WIDTH


@pytest.mark.parametrize("substeps", [8, 9])
def test_a_tile_that_is_shot_at_the_wall_within_a_step_is_stopped_by_it(substeps):
    """It lies still when the step begins in which another tile hits it, more than a substep's way
    from the wall, and less than a step's."""
    inner, wall = 0.1 - 0.5 * WIDTH, Reactor("rectangle", width=0.2, height=0.2)
    s = simulate([tile(inner - 0.005), tile(inner - 0.005 - WIDTH - 0.004, vx=2.0)], reactor=wall,
                 body=material(restitution=0.5), step=1 / 60, substeps=substeps)
    for _ in range(6):
        s.advance(1)
        assert s.x[0] < inner + 1e-4 * WIDTH
    assert s.counts.surprises[0] >= 1
    assert s.counts.deepest[0] < 1e-3 * WIDTH
    assert s.vx[0] < 0.0


@pytest.mark.parametrize(("law", "bound"), [(None, 0.1), *((law, 0.02) for law in LAWS)])
def test_what_rubs_elsewhere_does_not_pay_for_work_done_here(law, bound):
    """A row of twenty tiles is pressed against a held one, and the load ends: it stays, whether or
    not a tile rubs along others seven metres away, and whether or not the floor has friction.
    Contacts do no work in sum, wherever they hang together."""
    turn = -math.pi / 4
    along = np.array([math.cos(turn), math.sin(turn)])

    def released(far):
        tiles = [tile(0, 0, turn, held=True),
                 *(tile(*(-(i + 1) * WIDTH * along), turn) for i in range(20))]
        if far:
            tiles += [tile(5 + i * WIDTH, 5, held=True) for i in range(40)]
            tiles += [tile(5 + 0.3 * WIDTH, 5 + WIDTH, vx=2.0)]
        s = simulate(tiles, body=material(friction=0.5), step=1 / 120, substeps=12,
                     tolerance=2e-2, passes=40, drive=Drive("constant", tuple(0.5 * along)),
                     floor=Floor(law) if law else None)
        s.run(0.25)
        s.parameters[:] = 0.0
        s.run(0.5)
        way = state(s)[:2, 1:21] + np.outer(along, WIDTH * np.arange(1, 21))
        return np.abs(way).max() / WIDTH

    assert released(far=False) < bound
    assert released(far=True) < bound


@pytest.mark.parametrize("body", [
    material(friction=0.0, restitution=0.0, restitution_threshold=0.01), Material()])
@pytest.mark.parametrize("step", [1 / 60, 1 / 480])
@pytest.mark.parametrize(("tolerance", "passes", "turns"), [(1e-3, 100, 0.02), (1e-6, 4000, 3e-5)])
def test_a_contact_that_pushes_the_way_the_load_does_holds_what_floor_and_it_can_hold(
        body, step, tolerance, passes, turns):
    """The floor holds the load (0.6 of its friction) and the neighbour a tenth of the torque, 0.13
    widths off the centre: with that it presses 0.29 of the floor's friction more, the same way,
    which the floor holds, too.  None of them does work, and the tile is at rest as soon as a solve
    has found that."""
    s = simulate([tile(0, 0), tile(WIDTH, 0.37 * WIDTH, held=True)], body=body, step=step,
                 floor=Floor(angular_reading="uniform-pressure"), tolerance=tolerance,
                 passes=passes,
                 drive=Drive("constant", (-0.6 * SLIDING, 0.0), 1.1 * max_torque(MU, MASS, WIDTH)))
    s.run(0.5)
    assert abs(s.angle[0]) < turns
    before = state(s)
    s.run(2.0)
    assert (state(s) == before).all()


@pytest.mark.parametrize(("width", "weights", "speed", "friction"), [
    (0.03, 5.0, 1.0, 0.25), (0.03, 5.0, 2.0, 0.25), (0.02, 3.0, 1.0, 0.25), (0.01, 5.0, 0.5, 0.25),
    (0.005, 1.0, 0.5, 0.0)])
@pytest.mark.parametrize("backwards", [False, True])
def test_what_is_pressed_on_a_row_of_tiles_does_not_catch_on_its_joints(width, weights, speed,
                                                                       friction, backwards):
    """By so many times its weight, and pushed on as hard as friction holds it back; whatever the
    order in which the row is numbered, at the paper's tolerance, which lets it sink in a little and
    bears its friction to a few per cent only."""
    mass, cells = MASS * (width / WIDTH)**2, range(-2, 60)
    load = weights * mass * 9.81
    s = simulate([*(tile(i * width, 0, held=True) for i in (cells[::-1] if backwards else cells)),
                  tile(0, width, vx=speed)],
                 body=material(width=width, mass=mass, friction=friction, restitution=0.2,
                               restitution_threshold=0.01),
                 drive=Drive("constant", (friction * load, -load)), step=1 / 120, substeps=12,
                 tolerance=2e-2, at_rest=0.025, passes=80)
    while s.x[-1] < 50 * width:
        s.advance(1)
        assert abs(s.angle[-1]) < 0.01
    gained = s.vx[-1] - speed
    assert -0.01 * speed < gained < 0.03 * friction * load / mass * s.time + 1e-3 * speed


@pytest.mark.parametrize("law", ["separate", "coupled", "exact"])
@pytest.mark.parametrize("ratio", [1.2, 2.0, 5.0])
@pytest.mark.parametrize("substeps", [1, 4])
def test_a_tile_that_its_load_turns_round_comes_back_as_fast_as_it_is_to(law, ratio, substeps):
    """As a block that slides up a slope, stops, and comes down: exactly, at every step."""
    load, v0 = ratio * SLIDING, 0.11
    up, down = (load + SLIDING) / MASS, (load - SLIDING) / MASS
    for step in (1 / 60, 1 / 117, 1 / 480):
        s = simulate([tile(0, 0, 0.3, v0, 0)], floor=Floor(law), step=step, substeps=substeps,
                     drive=Drive("constant", (-load, 0.0)))
        while s.time < v0 / up + 2.5 * step:
            s.advance(1)
        back = s.time - v0 / up
        assert s.vx[0] == pytest.approx(-down * back, abs=1e-12)
        assert s.x[0] == pytest.approx(v0**2 / up / 2 - down * back**2 / 2,
                                       abs=up * (step / substeps)**2)
        assert abs(s.vy[0]) + WIDTH * abs(s.omega[0]) < 1e-12


@pytest.mark.parametrize(("friction", "step", "knock"), [
    (0.25, 1 / 35, 0.1), (0.05, 1 / 43.9, 0.1), (1e-3, 1 / 49, 0.0), (0.0, 1 / 49, 0.0)])
def test_bonds_hold_at_the_longest_step_that_is_allowed(friction, step, knock):
    """Blocks of nine with the paper's magnets, without a floor, knocked at random or, if smooth, at
    rest: leapfrog still follows how their bonds vibrate."""
    with pytest.raises(InputError, match="bonds vibrate"):
        simulate([tile(kind="black")], types=CHESSBOARD, magnet=Magnet(), step=1.03 * step,
                 substeps=4, body=Material(friction=friction))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        s = simulate([tile(i * WIDTH, j * WIDTH, 0.0, *(knock * rng.normal(size=2)),
                           60.0 * knock * rng.normal(), kind=("black", "white")[(i + j) % 2])
                      for i in range(3) for j in range(3)], types=CHESSBOARD, magnet=Magnet(),
                     step=step, substeps=4, tolerance=1e-5, passes=200,
                     body=Material(friction=friction))
        s.run(5.0)
        assert np.hypot(s.x - s.x.mean(), s.y - s.y.mean()).max() < 2.0 * WIDTH


@pytest.mark.parametrize("friction", [
    0.0, *(pytest.param(friction, marks=pytest.mark.slow) for friction in (0.05, 0.1)), 0.25])
def test_what_snaps_together_at_the_longest_step_seldom_gains_energy(friction):
    """Eight loose tiles in a round wall, without a floor, a drive or damping: friction and impacts
    take energy, and what leapfrog gives at times is mostly less than 0.3 of that of a bond. A
    friction of 0.05 damps too little for the step that one of 0.25 allows: it was above 0.3 in 13
    of 30 such crowds; at the longest one in 1 of these 120 (of more, in 16 of 196 with 0.25 and in
    9 of 588 with less)."""
    step = 0.0288 * math.sqrt(min(0.5 + 2.5 * friction, 1.0))
    bond = -magnets.pair_energy((0.0, 0.0, 0.0), CHESSBOARD[0].glues, (WIDTH, 0.0, 0.0),
                                CHESSBOARD[1].glues, magnets.Law(cutoff=0.03, switch=0.1))
    gains = []
    for seed in range(100, 130):
        crowd = Scene(types=CHESSBOARD, magnet=Magnet(), reactor=Reactor("circle", radius=0.08),
                      material=material(friction=friction, restitution=0.5,
                                        restitution_threshold=0.01),
                      free=Free((("black", 4), ("white", 4))), solver=Solver(step=step),
                      record=Record(step, step), run=Run(1.0, seed=seed))
        with pytest.raises(InputError, match="bonds vibrate"):
            replace(crowd, solver=Solver(step=1.03 * step),
                    record=Record(1.03 * step, 1.03 * step)).validate()
        s = Simulation(crowd)
        magnetic, energy = MagnetEnergy(crowd, glues_of(crowd, s.layout.type)), []
        for _ in range(100):
            s.advance(1)
            energy.append(s.kinetic_energy() + magnetic(s.x, s.y, s.angle))
        gains.append((energy - np.minimum.accumulate(energy)).max() / bond)
    assert sorted(gains)[-2] < 0.3
    assert max(gains) < 0.5


def leaning(phi, spin, load, friction):
    """A tile that slides with one corner on a floor y = 0 and one on a wall x = 0, and its edge
    between them at an angle phi to the floor, which changes at `spin`.

    Its angular acceleration, both normal forces (N), and the 2 x 2 matrix and the vector of the
    normal accelerations that they make and meet; all sliding is at `friction` against the motion.
    """
    c, s, half, side = math.cos(phi), math.sin(phi), 0.5 * WIDTH, math.copysign(1.0, spin)
    x = half * (c + s)  # = y
    floor, wall = np.array([WIDTH * c - x, -x]), np.array([-x, WIDTH * s - x])
    push_a, push_b = np.array([friction * side, 1.0]), np.array([1.0, -friction * side])
    cross = [arm[0] * push[1] - arm[1] * push[0] for arm, push in ((floor, push_a), (wall, push_b))]
    gains = np.array([[*(push / MASS), turn / INERTIA]
                      for push, turn in zip((push_a, push_b), cross, strict=True)])
    rates = np.array([[0.0, 1.0, floor[0]], [1.0, 0.0, -wall[1]]])
    free = np.array([load[0] / MASS, load[1] / MASS, load[2] / INERTIA])
    meets = rates @ free - spin**2 * np.array([floor[1], wall[0]])
    matrix = rates @ gains.T
    normal = np.linalg.solve(matrix, -meets)
    return -(free + normal @ gains)[2], normal, matrix, meets


def slides_on_both(phi, spin, load, friction):
    """Whether that is the one way in which it can go on: no other set of contacts is consistent."""
    _, normal, matrix, meets = leaning(phi, spin, load, friction)
    alone = [(-meets[i] / matrix[i, i], i) for i in range(2)]
    others = [force > 0.0 and meets[1 - i] + matrix[1 - i, i] * force > 0.0 for force, i in alone]
    return bool((normal > 4e-3).all() and not any(others) and not (meets >= 0.0).all())


@pytest.mark.parametrize("floor", [None, Floor(law="coupled", linear=1e-4)])
@pytest.mark.parametrize("friction", [0.25, 0.65, 0.8, 0.95])
def test_a_tile_that_slides_on_two_rough_contacts_goes_as_both_tell(friction, floor):
    """Each may undo more of what the other has done than that did: passes went in a circle."""
    rng, size, cases, wrong = np.random.default_rng(5), 0.4, 0, 0
    while cases < 40:
        phi, spin = rng.uniform(0.1, 1.45), rng.choice([-1.0, 1.0]) * rng.uniform(2.0, 6.0)
        load = (0.157 * rng.uniform(-1.2, 0.3), -0.157 * rng.uniform(0.3, 1.2),
                1e-3 * rng.uniform(-1.0, 1.0))
        h = 1 / 480
        gained, ways = 0.0, []
        for _ in range(3):  # by the middle of the step, which depends on what is gained by then
            ways += [(phi + 0.5 * h * (spin + 0.25 * gained), spin + 0.5 * gained)]
            gained = h * leaning(*ways[-1], load, friction)[0]
        ways += [(phi, spin), (phi + h * (spin + 0.5 * gained), spin + gained)]
        if not all(0.1 < angle < 1.45 and spin * pace > 0.0
                   and slides_on_both(angle, pace, load, friction) for angle, pace in ways):
            continue
        cases += 1
        at = 0.5 * WIDTH * (math.cos(phi) + math.sin(phi)) - 0.5 * size
        pace = 0.5 * WIDTH * (math.cos(phi) - math.sin(phi)) * spin
        s = simulate([tile(at, at, -phi, pace, pace, -spin)], body=material(
            friction=friction, restitution=0.0, restitution_threshold=0.01), floor=floor,
                     reactor=Reactor("rectangle", width=size, height=size, friction=friction,
                                     restitution=0.0),
                     drive=Drive("constant", load[:2], load[2]), substeps=4, step=h,
                     tolerance=1e-5, passes=40)
        s.advance(1)
        wrong += abs(-s.omega[0] - spin - gained) > 0.05 * abs(gained)
    assert wrong <= 1


SIDES = ("wall", "held tiles")
SOLVERS = {"default": DEFAULT, "paper": {"step": 1 / 120, "substeps": 12, "tolerance": 2e-2,
                                         "passes": 80, "at_rest": 0.025}}


def in_a_channel(sides, force, solver, *, friction=MU, torque=0.0, speed=0.0):
    """A tile in a channel that is exactly as wide as it is, between walls or rows of held tiles."""
    held = [tile((k - 17) * WIDTH, side * WIDTH, held=True) for k in range(36) for side in (-1, 1)]
    wall = Reactor("rectangle", width=2.0, height=WIDTH, friction=friction, restitution=0.0)
    return simulate([tile(-0.4, 0.0, vx=speed), *(held if sides == "held tiles" else [])],
                    body=material(friction=friction, restitution=0.0, restitution_threshold=0.01),
                    reactor=wall if sides == "wall" else None,
                    drive=Drive("constant", force, torque=torque), **SOLVERS[solver])


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("friction", [0.05, 0.25, 0.6])
def test_a_tile_in_a_channel_is_braked_by_what_presses_it_to_one_side(friction, solver, sides):
    """Not by what its two sides might give each other through it: as in a channel that is wider by
    however little.  Where the load ends it goes on as it is."""
    load = 0.05
    s = in_a_channel(sides, (0.0, -load), solver, friction=friction, speed=1.0)
    s.run(0.1)
    slower = friction * load / MASS * 0.1
    assert 1.0 - s.vx[0] == pytest.approx(slower, rel=0.1)
    s.parameters[1] = 0.0
    s.run(0.05)
    speed = s.vx[0]
    assert 1.0 - speed == pytest.approx(slower, rel=0.15)
    s.run(0.2)
    assert s.vx[0] == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("push", [0.003, 0.03])
def test_a_tile_that_was_pressed_in_a_channel_can_be_pushed_along_it(push, sides):
    s = in_a_channel(sides, (0.0, -0.1), "default")
    s.run(0.1)
    s.parameters[:2] = push, 0.0
    s.run(0.2)
    assert s.vx[0] == pytest.approx(push / MASS * 0.2, rel=0.02)
    forces = s.contact_forces()
    assert (forces["normal0"] + forces["normal1"]).sum() < 1e-3 * push  # N


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("push", [0.0, 0.3])
def test_a_tile_that_a_torque_wedges_in_a_channel_rests_to_the_bit(push, solver, sides):
    """Under `push` times what the friction of the two corners holds that bear the torque."""
    torque = 1e-3
    s = in_a_channel(sides, (push * 2.0 * MU * torque / WIDTH, 0.0), solver, torque=torque)
    s.run(1.0)
    before = state(s)[:3].copy()
    s.run(5.0)
    assert (state(s)[:3] == before).all()
