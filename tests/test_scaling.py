"""The paper's scaling argument: what its steps give, and what would give the printed root."""

import math
import signal
import subprocess
import sys
from pathlib import Path

import derivation
import numpy as np
import pytest
from derivation import PRINTED, F_g, printed_steps, readings, slipping_load, slips
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy import simplify, sqrt
from sympy.parsing.sympy_parser import (
    convert_xor,
    implicit_multiplication,
    parse_expr,
    standard_transformations,
)

from theory import command, scaling, statics
from theory.magnets import Law, force

BOND = force(0.003, Law())
MU, FLOOR = 0.25, 0.25 * 0.016 * 9.81
DEGREE = math.pi / 180.0
SIMULATOR = Law(cutoff=0.03, switch=0.1)
ROOT = Path(__file__).parents[1]
SYMBOLS = (F_g, derivation.F, derivation.mu, derivation.R)


# The derivation.


def test_the_printed_norms_bound_n_by_twice_the_ratio_and_not_by_its_root():
    force_ratio = printed_steps()
    assert simplify(force_ratio - PRINTED**2) == 0
    assert simplify(force_ratio - PRINTED) != 0


def test_the_printed_root_bounds_the_root_of_n():
    assert simplify(sqrt(printed_steps()) - PRINTED) == 0


def test_two_slips_would_each_give_the_printed_root():
    found = slips()
    assert set(found) == {"n lost in the norm of F_ng", "sqrt(n) read as n"}
    for root in found.values():
        assert simplify(root - PRINTED) == 0


def test_the_printed_root_has_the_right_unit():
    """So that a check of units does not find it."""
    unit = PRINTED.subs({F_g: derivation.m * derivation.a})  # a force over a force
    assert unit.free_symbols == set()


def test_every_reading_is_the_size_at_which_its_condition_is_met():
    values = dict(zip(SYMBOLS, (0.2037, 0.075, 0.25, 0.0392), strict=True))
    symbolic = readings()
    assert set(symbolic) == {each.name for each in scaling.READINGS} - {"printed"}
    for reading in scaling.READINGS[1:]:
        expected = float(symbolic[reading.name].subs(values))
        ours = reading.bound(*values.values())
        assert ours == pytest.approx(expected, rel=1e-12), reading.name


def test_the_formulas_in_the_table_are_those_of_the_derivation():
    symbolic = readings()
    for reading in scaling.READINGS[1:]:
        formula = parse_expr(reading.formula, {each.name: each for each in SYMBOLS},
                             (*standard_transformations, convert_xor, implicit_multiplication))
        assert simplify(formula - symbolic[reading.name]) == 0, reading.name


def test_the_balance_of_a_sliding_block_gives_the_load_at_which_it_slips():
    for k in (1, 3, 10):
        values = {F_g: BOND, derivation.mu: MU, derivation.R: FLOOR, derivation.n: k}
        value = float(slipping_load().subs(values))
        assert value == pytest.approx(scaling.slip_onset(0.0, k, BOND, MU, FLOOR), rel=1e-12)


# The steps as functions.


def test_the_printed_glue_force_has_another_norm_and_the_other_sign():
    printed = scaling.net_glue_force_printed(5, BOND)
    ours = scaling.net_glue_force(5, BOND)
    assert np.linalg.norm(printed) == pytest.approx(10 * BOND, rel=1e-12)
    assert np.linalg.norm(ours) == pytest.approx(math.sqrt(2.0) * 5 * BOND, rel=1e-12)
    assert printed @ ours < 0.0


def test_net_tile_force_is_the_sum_over_all_tiles():
    each = np.tile([0.016 * 2.0, -0.016 * 3.0], (49, 1))
    assert scaling.net_force(each) == pytest.approx(scaling.net_tile_force(7, 0.016, [2.0, -3.0]))


@given(st.floats(0.0, 2.0 * math.pi), st.integers(1, 12), st.floats(0.01, 0.3))
@settings(deadline=None)
def test_the_quadrant_condition_is_the_frictionless_critical_load(angle, size, load):
    limit = scaling.critical_load(angle, size, BOND)
    assume(abs(load / limit - 1.0) > 1e-6)
    pull = scaling.net_tile_force(size, 1.0, [load * math.cos(angle), load * math.sin(angle)])
    assert scaling.leaves_quadrant(pull, scaling.net_glue_force(size, BOND)) == (load > limit)


def test_norm_and_quadrant_agree_on_the_diagonal_and_the_norm_errs_on_the_axis():
    glue = scaling.net_glue_force(4, BOND)
    for angle, agree in ((45.0, True), (0.0, False)):
        way = np.array([math.cos(angle * DEGREE), math.sin(angle * DEGREE)])
        load = 1.001 * scaling.critical_load(angle * DEGREE, 4, BOND) * way
        pull = scaling.net_tile_force(4, 1.0, load)
        assert scaling.leaves_quadrant(pull, glue)
        assert scaling.exceeds_norm(pull, glue) == agree


# Loads of a block.


def test_critical_loads_are_those_of_the_formulas():
    for k in (1, 2, 4, 10):
        g = BOND / k
        for mu, floor, axis, diagonal in (
                (0.0, 0.0, g, math.sqrt(2.0) * g),
                (MU, 0.0, (1.0 + MU) * g, math.sqrt(2.0) * g),
                (MU, FLOOR, (1.0 + MU) * g + FLOOR * math.hypot(1.0, MU),
                 math.sqrt(2.0) * g + FLOOR)):
            assert scaling.critical_load(0.0, k, BOND, mu, floor) == pytest.approx(axis, rel=1e-12)
            assert scaling.critical_load(45 * DEGREE, k, BOND, mu, floor) == pytest.approx(
                diagonal, rel=1e-12)


def test_at_22_degrees_a_large_block_lifts_off_before_its_state_of_rest_ends():
    onset = scaling.slip_onset(22.5 * DEGREE, 10, BOND, MU, FLOOR)
    assert onset == pytest.approx(0.0643, abs=5e-5)
    assert scaling.critical_load(22.5 * DEGREE, 10, BOND, MU, FLOOR) == pytest.approx(
        0.0646, abs=5e-5)
    pull = onset * np.array([math.cos(22.5 * DEGREE), math.sin(22.5 * DEGREE)]) - BOND / 10
    assert np.hypot(*pull) == pytest.approx(FLOOR, rel=1e-9)
    assert pull.min() >= 0.0


def test_slip_on_the_axis_is_along_the_wall():
    assert scaling.slip_onset(0.0, 2, BOND, MU, FLOOR) == pytest.approx(0.1666, abs=5e-5)


@given(st.floats(0.0, 0.5 * math.pi), st.integers(1, 12), st.floats(0.0, 0.9),
       st.floats(0.0, 0.1))
@settings(deadline=None, max_examples=300)
def test_slip_begins_no_later_than_rest_ends_and_no_earlier_than_without_floor(
        angle, size, mu, floor):
    rest = scaling.critical_load(angle, size, BOND, mu, floor)
    onset = scaling.slip_onset(angle, size, BOND, mu, floor)
    assert onset <= rest * (1.0 + 1e-9)
    assert onset >= scaling.critical_load(angle, size, BOND, mu) * (1.0 - 1e-9)
    if floor == 0.0:
        assert onset == pytest.approx(rest, rel=1e-9)


@given(st.floats(0.0, 0.5 * math.pi), st.integers(1, 12), st.floats(0.0, 0.9),
       st.floats(0.0, 0.1))
@settings(deadline=None)
def test_no_direction_is_worse_than_atan_mu_off_an_axis(angle, size, mu, floor):
    worst = scaling.critical_load(scaling.worst_angle(mu), size, BOND, mu, floor)
    assert worst == pytest.approx((1.0 + mu) * BOND / size / math.hypot(1.0, mu) + floor, rel=1e-12)
    assert scaling.critical_load(angle, size, BOND, mu, floor) >= worst * (1.0 - 1e-12)


def test_a_load_into_the_corner_is_always_borne():
    assert scaling.critical_load(225 * DEGREE, 3, BOND) == math.inf
    assert scaling.slip_onset(225 * DEGREE, 3, BOND) == math.inf


# The readings.


def test_each_bound_is_where_its_load_is_critical():
    load = 0.06
    angles = {"diagonal": 45.0, "quadrant": 0.0, "tile friction, axis": 0.0,
              "tile friction, rotating": math.atan(MU) / DEGREE,
              "floor friction, axis, rest": 0.0,
              "floor friction, rotating, rest": math.atan(MU) / DEGREE,
              "floor friction, diagonal": 45.0}
    found = {each.name: each.bound(BOND, load, MU, FLOOR) for each in scaling.READINGS}
    for name, angle in angles.items():
        mu = MU if "friction" in name else 0.0
        floor = FLOOR if "floor" in name else 0.0
        assert scaling.critical_load(angle * DEGREE, found[name], BOND, mu, floor) == pytest.approx(
            load, rel=1e-9), name
    assert scaling.slip_onset(0.0, found["floor friction, axis, slip"], BOND, MU,
                              FLOOR) == pytest.approx(load, rel=1e-9)


def test_a_load_within_the_floor_friction_has_no_bound():
    for each in scaling.READINGS:
        bound = each.bound(BOND, 0.9 * FLOOR, MU, FLOOR)
        assert math.isinf(bound) == each.name.startswith("floor")


def test_without_a_load_nothing_detaches():
    for each in scaling.READINGS:
        assert each.bound(BOND, 0.0, MU, FLOOR) == math.inf
        assert scaling.bound_all_pairs(each, 0.0, MU, FLOOR, SIMULATOR) == math.inf


@pytest.mark.parametrize(("glues", "expected"), [
    (statics.CHESSBOARD, (0.1024, 0.0880, 0.0808, 0.0765)),
    (statics.ORIENTED, (0.1156, 0.1012, 0.0940, 0.0897))])
def test_bonds_of_a_block_with_all_pairs(glues, expected):
    for k, value in zip((1, 2, 4, 10), expected, strict=True):
        assert scaling.seed_bond(k, SIMULATOR, glues) == pytest.approx(value, abs=5e-5)
        tiles = statics.block(k, glues)
        pull = statics.magnet_wrench(tiles, SIMULATOR, mating=False)[tiles.free].sum(axis=0)
        assert -pull[:2] / k == pytest.approx([scaling.seed_bond(k, SIMULATOR, glues)] * 2,
                                              rel=1e-9)


# Sides of which every second bond is another: whites without one of their magnets.
BY_TURNS = [((1, 2, 1, 2), (-1, -2, -1, 0)), ((1, 2, 1, 2), (-1, 0, -1, -2))]


@pytest.mark.parametrize("glues", BY_TURNS)
def test_bonds_of_a_block_whose_tiles_differ_by_turns(glues):
    for k in (1, 2, 3, 4, 5, 8):
        tiles = statics.block(k, glues)
        pull = statics.magnet_wrench(tiles, SIMULATOR, mating=False)[tiles.free, 0].sum()
        assert scaling.seed_bond(k, SIMULATOR, glues) == pytest.approx(-pull / k, abs=1e-12)
    between = 0.5 * (3 * scaling.seed_bond(3, SIMULATOR, glues)
                     + 4 * scaling.seed_bond(4, SIMULATOR, glues))
    assert 3.5 * scaling.seed_bond(3.5, SIMULATOR, glues) == pytest.approx(between)


@pytest.mark.parametrize("glues", BY_TURNS)
@pytest.mark.parametrize("load", [0.04, 0.075, 0.3])
def test_the_least_size_that_such_bonds_do_not_hold_is_the_bound(glues, load):
    for each in scaling.READINGS:
        def beyond(n, each=each):
            bond = max(scaling.seed_bond(n, SIMULATOR, glues), 0.0)
            return n - each.bound(bond, load, MU, FLOOR)

        size = scaling.bound_all_pairs(each, load, MU, FLOOR, SIMULATOR, glues)
        if 0.0 < size < math.inf:
            assert beyond(size) == pytest.approx(0.0, abs=1e-6 * max(size, 1.0))
            assert all(beyond(n) < 0.0 for n in range(1, math.ceil(min(size, 200.0))))


@pytest.mark.parametrize("load", ["inf", "nan", "0", "-1", "1e-13", "1e13"])
def test_a_load_without_an_answer_is_refused(load, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["scaling", "--load", load])
    with pytest.raises(SystemExit) as left:
        scaling.main()
    assert left.value.code == 2
    assert "the load must be from 1e-12 to 1e+12 N" in capsys.readouterr().err


@pytest.mark.parametrize("load", [1e-12, 1e-9, 1e9, 1e12])
def test_far_loads_have_their_bounds(load, monkeypatch, capsys):
    law, floor = Law(cutoff=0.03, switch=0.1), scaling.max_force(0.25, 0.016)
    for reading in scaling.READINGS:
        n = scaling.bound_all_pairs(reading, load, 0.25, floor, law)
        if math.isfinite(n):
            assert n == pytest.approx(
                reading.bound(scaling.seed_bond(n, law), load, 0.25, floor), rel=1e-9)
    monkeypatch.setattr("sys.argv", ["scaling", "--load", str(load)])
    scaling.main()
    assert " 0.00" not in capsys.readouterr().out


def test_a_bound_with_all_pairs_is_met_by_the_bonds_of_its_size():
    for each in scaling.READINGS:
        size = scaling.bound_all_pairs(each, 0.075, MU, FLOOR, SIMULATOR)
        bond = scaling.seed_bond(size, SIMULATOR)
        assert each.bound(bond, 0.075, MU, FLOOR) == pytest.approx(size, rel=1e-9)
        assert size < each.bound(BOND, 0.075, MU, FLOOR)


def test_a_seed_that_pushes_holds_no_block():
    """Of tiles of 1 mm with the paper's beta all magnets are as good as in one place."""
    small, like = Law(width=1e-3, inset=5e-5, cutoff=1e-3, switch=0.1), ((1, 1, 1, 1),) * 2
    assert scaling.seed_bond(1, small) < 0.0
    for each in scaling.READINGS:
        assert scaling.bound_all_pairs(each, 0.075, MU, FLOOR, small) < 1.0
        assert scaling.bound_all_pairs(each, 0.075, MU, FLOOR, Law(cutoff=0.01), like) == 0.0
    assert scaling.report(0.075, law=small)


@pytest.mark.parametrize("width", [0.01, 0.03, 0.05])
@pytest.mark.parametrize("cutoff", [0.5, 0.7])
def test_a_bound_of_bonds_that_are_all_alike_is_that_of_one(width, cutoff):
    """Within so short a cut-off only magnets that mate pull, and of no block is a bond another."""
    for inset in (0.02, 0.05, 0.1):
        law = Law(beta=0.2 * width, width=width, inset=inset * width, cutoff=cutoff * width,
                  switch=0.1)
        bond = force(2.0 * law.inset, law)
        for each in scaling.READINGS:
            for load in (0.1 * bond, 0.7 * bond, 3.0 * bond):
                assert scaling.bound_all_pairs(each, load, MU, 0.0, law) == pytest.approx(
                    each.bound(bond, load, MU, 0.0), rel=1e-9)


def test_a_bound_is_beyond_a_single_tile_that_is_held():
    """The bonds of two by two are more than twice as strong as that of one."""
    glues = ((1, 1, -1, 0), (-1, -1, -1, -1))
    bonds = [scaling.seed_bond(n, SIMULATOR, glues) for n in (1, 2)]
    assert 0.0 < 2.0 * bonds[0] < bonds[1]
    for each in scaling.READINGS:
        assert scaling.bound_all_pairs(each, 0.2 * bonds[0], MU, 0.0, SIMULATOR, glues) > 1.0


def test_bonds_with_pairs_beyond_a_tile_width_are_refused():
    """Tiles next but one then pull as well, which the blocks of one and two cannot tell."""
    far = Law(cutoff=0.04, switch=0.1)
    for refused in (lambda: scaling.seed_bond(3, far), lambda: scaling.seed_bond(3, Law()),
                    lambda: scaling.bound_all_pairs(scaling.READINGS[4], 0.075, MU, FLOOR, far),
                    lambda: scaling.report(0.075, law=far)):
        with pytest.raises(ValueError, match="cut-off must be at most one tile width"):
            refused()


@pytest.mark.parametrize("wrong", [{"mu": 1.0}, {"mu": -0.1}, {"mu": math.nan}, {"bond": -0.1},
                                   {"n": 0}, {"floor": -0.1}])
def test_a_critical_load_is_of_a_bond_that_holds_and_a_friction_below_one(wrong):
    with pytest.raises(ValueError, match="must be"):
        scaling.critical_load(0.3, **({"n": 3, "bond": 0.2, "mu": 0.25, "floor": 0.04} | wrong))


def test_the_report_has_every_reading_with_its_assumption():
    text = scaling.report(0.075)
    for each in scaling.READINGS:
        line = next(line for line in text.splitlines() if line.startswith(each.name + " "))
        assert f"{each.bound(BOND, 0.075, MU, FLOOR):.2f}" in line
        assert each.formula in line
        assert each.assumes in text


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan])
def test_a_block_without_size_neither_slips_nor_detaches(size):
    for load in (scaling.slip_onset, scaling.critical_load):
        with pytest.raises(ValueError, match="the size must be positive"):
            load(0.0, size, BOND)
    with pytest.raises(ValueError, match="the size must be positive"):
        scaling.seed_bond(size, Law())


@pytest.mark.parametrize("numbers", [(math.nan,), (-1.0,), (BOND, -0.1), (BOND, MU, math.nan)])
def test_a_block_does_not_slip_under_bonds_and_friction_that_are_none(numbers):
    with pytest.raises(ValueError, match="bond, mu and floor at least 0"):
        scaling.slip_onset(0.0, 2, *numbers)


def test_ctrl_c_ends_a_report_without_a_word(capsys):
    with pytest.raises(SystemExit) as ended:
        command(lambda: signal.raise_signal(signal.SIGINT))
    assert (ended.value.code, *capsys.readouterr()) == (130, "", "")


def test_a_report_that_cannot_be_written_is_told_by_the_exit_code(unwritable):
    place, words = unwritable
    found = subprocess.run([sys.executable, "-m", "theory.scaling"], cwd=ROOT, stdout=place,
                           stderr=subprocess.PIPE, text=True, check=False)
    assert found.returncode == 1
    assert words in found.stderr
    assert len(found.stderr.splitlines()) == bool(words)
