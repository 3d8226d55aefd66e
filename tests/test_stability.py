"""The self-stabilizing argument: how families cancel, and the margins that this leaves."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tbsa
from figures import margin as figure
from tbsa.model.scene import Drive, Floor, Magnet, PlacedTile, Scene
from tbsa.model.tiles import ground_truth, rotated
from theory import magnets, scaling, stability, statics
from theory.magnets import Law
from theory.stability import Numbers
from theory.statics import block, chessboard, l_seed

BOND = magnets.force(0.003, Law())
FORCE, TORQUE = 0.075, 3e-3
MATING = Numbers(law=Law(), mating=True)
BARE = MATING._replace(mu=0.0, floor=(0.0, 0.0))
W = 0.03
ROW = [(i, -1) for i in range(-3, 4)]


def drawn(number, draw):
    """Mean and standard deviation of `number` draws, each with its standard error."""
    rng = np.random.default_rng(1)
    values = np.array([draw(rng) for _ in range(number)])
    spread = values.std()
    return values.mean(), spread, spread / math.sqrt(number), spread / math.sqrt(2.0 * number)


# How well two families cancel: exact, and drawn at random.


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_a_perfect_chessboard_has_an_imbalance_of_one_tile_at_most(n):
    tiles = block(n)
    colour = tiles.colour()[tiles.free]
    assert (colour == 0).sum() - (colour == 1).sum() == stability.imbalance_of_block(n)


CASES = {
    "occupation": (stability.imbalance_of_occupation(30, 20, 0.7),
                   lambda rng: (rng.random(30) < 0.7).sum() - (rng.random(20) < 0.7).sum()),
    "choice": (stability.imbalance_of_choice(30, 20, 13),
               lambda rng: rng.choice([1] * 30 + [-1] * 20, 13, replace=False).sum()),
    "families": (stability.imbalance_of_families(50, 0.6),
                 lambda rng: np.where(rng.random(50) < 0.6, 1, -1).sum()),
    "turns": (stability.imbalance_of_turns(30, 20, 0.2),
              lambda rng: (np.array([1] * 30 + [-1] * 20)
                           * np.where(rng.random(50) < 0.2, -1, 1)).sum()),
}


@pytest.mark.parametrize("name", CASES)
def test_mean_and_spread_of_the_imbalance_are_those_of_samples(name):
    (mean, spread), draw = CASES[name]
    found, width, error_of_mean, error_of_width = drawn(4000, draw)
    assert found == pytest.approx(mean, abs=4.0 * error_of_mean)
    assert width == pytest.approx(spread, abs=4.0 * error_of_width)


def test_limits_of_the_imbalance():
    assert stability.imbalance_of_occupation(30, 20, 1.0) == (10.0, 0.0)
    assert stability.imbalance_of_choice(30, 20, 50) == pytest.approx((10.0, 0.0))
    assert stability.imbalance_of_families(400) == (0.0, 20.0)  # the square root
    assert stability.imbalance_of_turns(30, 20, 0.0) == (10.0, 0.0)
    assert stability.imbalance_of_turns(30, 20, 0.5) == pytest.approx((0.0, math.sqrt(50.0)))


@pytest.mark.parametrize("refused", [
    lambda: stability.imbalance_of_occupation(3, 3, 1.2),
    lambda: stability.imbalance_of_occupation(-3, 3, 0.5),
    lambda: stability.imbalance_of_choice(3, 3, 9), lambda: stability.imbalance_of_choice(3, 3, -1),
    lambda: stability.imbalance_of_choice(-3, 6, 2),
    lambda: stability.imbalance_of_families(5, -0.1), lambda: stability.imbalance_of_families(-5),
    lambda: stability.imbalance_of_turns(3, 3, math.nan)])
def test_an_imbalance_is_of_tiles_that_there_can_be(refused):
    with pytest.raises(ValueError, match=r"must be|do not fit"):
        refused()


def test_with_random_half_turns_net_force_and_glue_grow_alike():
    """So that size neither helps nor harms: the probability to hold has a limit below 1."""
    limit = math.erf(BOND / FORCE / math.sqrt(2.0))
    assert 0.99 < limit < 0.995
    assert stability.half_turn_holds(2, BOND, FORCE) == 1.0  # the net force is at most 4 F
    far = [stability.half_turn_holds(n, BOND, FORCE) for n in (200, 201)]
    assert np.mean(far) == pytest.approx(limit, abs=2e-3)
    # With the force of a row by all pairs, three in ten blocks are not held, whatever their size.
    assert stability.half_turn_holds(400, 0.0765, FORCE) == pytest.approx(0.69, abs=0.01)


def test_the_probability_that_half_turns_hold_is_that_of_samples():
    rng = np.random.default_rng(2)
    for n, bond in ((4, 0.1), (7, 0.15)):
        net = FORCE * np.abs(rng.choice([-1, 1], (20_000, n * n)).sum(axis=1))
        assert np.mean(net <= n * bond) == pytest.approx(
            stability.half_turn_holds(n, bond, FORCE), abs=0.015)


def test_a_force_just_borne_is_borne_however_it_is_rounded():
    for n, bond, load in ((3, 0.3, 0.1), (3, 3.0, 1.0), (7, 0.7, 0.1), (7, 7.0, 1.0)):
        assert stability.half_turn_holds(n, bond, load) == 1.0  # the net force is at most n^2 F
    assert stability.half_turn_holds(3, BOND, 1e-300) == 1.0
    assert stability.half_turn_holds(3, 0.0, 0.0) == 1.0
    # A seed that pushes holds nothing but by chance: as one without glue.
    assert stability.half_turn_holds(2, -0.1, FORCE) == stability.half_turn_holds(2, 0.0, FORCE)


@pytest.mark.parametrize("field", ["--force", "--torque"])
@pytest.mark.parametrize("value", ["nan", "inf", "0", "1e-300"])
def test_a_drive_without_an_answer_is_refused(field, value, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["stability", field, value, "--sizes", "1", "--samples", "1"])
    with pytest.raises(SystemExit) as left:
        stability.main()
    assert left.value.code == 2
    assert f"{field} must be from 1e-12 to 1e+12, not {float(value):g}" in capsys.readouterr().err


# Loads.


def test_families_push_in_opposite_directions_and_held_tiles_do_not():
    tiles, (load,) = stability.case("chessboard", 2, FORCE, TORQUE)
    assert stability.net_force(load) == pytest.approx([0.0, 0.0], abs=1e-15)
    first = load[np.flatnonzero((tiles.site == (0, 0)).all(axis=1))[0]]
    assert first == pytest.approx([0.0, FORCE, TORQUE], abs=1e-15)
    assert not load[tiles.held].any()


def test_tiles_of_a_randomly_occupied_block_hang_together_with_the_seed():
    n = 8
    counts = []
    for seed in range(30):
        tiles, (load,) = stability.case("random occupation", n, FORCE,
                                        rng=np.random.default_rng(seed))
        whole = chessboard(map(tuple, tiles.site.tolist()), [(-9, -9)])
        assert len(set(stability.groups(whole)[:-1])) == 1  # all in one piece, seed and tiles
        imbalance = stability.net_force(load)[1] / FORCE
        colour = tiles.colour()[tiles.free]
        assert imbalance == pytest.approx((colour == 0).sum() - (colour == 1).sum())
        counts.append(len(tiles.free))
    assert 0.7 * n * n < np.mean(counts) <= 0.82 * n * n


def test_an_unknown_case_is_refused():
    with pytest.raises(ValueError, match="cases are"):
        stability.case("lonely", 2, FORCE)


# Margins.


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_margin_of_a_shaken_block_is_its_critical_load_over_the_drive(n):
    tiles, loads = stability.case("shaken", n, FORCE)
    for numbers in (BARE, MATING):
        expected = scaling.critical_load(scaling.worst_angle(numbers.mu), n, BOND, numbers.mu,
                                         numbers.floor[0]) / FORCE
        found = stability.margin(tiles, loads, numbers)
        assert found.tiles == pytest.approx(expected, rel=3e-4)
        assert found.body == pytest.approx(expected, rel=3e-4)
        assert found.net == pytest.approx(n * n * FORCE, rel=1e-12)


def test_a_shaken_block_loses_its_margin_with_size_and_a_chessboard_of_families_keeps_it():
    """As one body the chessboard is held however strong the drive; its weakest tile does not
    know how large the block is."""
    shaken, families = [], []
    for n in (2, 4, 6):
        shaken.append(stability.margin(*stability.case("shaken", n, FORCE)))
        families.append(stability.margin(*stability.case("chessboard", n, FORCE)))
    assert shaken[0].tiles > 1.4 * shaken[1].tiles > 1.4 * shaken[2].tiles
    assert [each.body for each in families] == [math.inf] * 3
    assert [each.tiles for each in families] == pytest.approx([families[0].tiles] * 3, rel=1e-3)
    assert families[0].tiles > shaken[0].tiles


def test_the_torque_lowers_the_margin_of_a_chessboard():
    """The paper has it that the torques do nothing, as their sum is zero."""
    calm, turning = (stability.margin(*stability.case("chessboard", 4, FORCE, torque)).tiles
                     for torque in (0.0, TORQUE))
    assert turning < 0.6 * calm


def test_unequal_families_pull_with_the_area_and_are_held_by_the_floor_all_the_same():
    rng = np.random.default_rng(5)
    tiles, (load,) = stability.case("unequal families", 8, FORCE, unequal=0.9, rng=rng)
    mean, spread = stability.imbalance_of_families(64, 0.9)
    net = abs(stability.net_force(load)[1])
    assert net == pytest.approx(mean * FORCE, abs=4.0 * spread * FORCE)
    found = stability.margin(tiles, (load,), BARE)
    # One side pulls n bonds open; frictionless, and the load is on an axis.
    assert found.body == pytest.approx(8 * BOND / net, rel=1e-6)
    assert stability.margin(tiles, (load,), MATING).body > found.body


def test_of_a_reversing_drive_the_worse_sign_counts():
    tiles = chessboard([(0, 0)], [(0, -1)])
    load = statics.uniform(tiles, 0.0, -FORCE)  # presses, pulls when it reverses
    found = stability.margin(tiles, (load,), MATING)
    assert found.tiles == pytest.approx((BOND + MATING.floor[0]) / FORCE, rel=1e-4)
    assert found.phase == pytest.approx(math.pi)
    assert stability.margin(tiles, (0.0 * load,), MATING).tiles == math.inf


def test_groups_are_free_tiles_that_share_edges():
    tiles = chessboard([(1, 1), (2, 1), (-1, 1), (1, -1)], [(0, 0), (1, 0), (0, 1), (-1, 0)])
    group = stability.groups(tiles)
    assert group[0] == group[1]
    assert len(set(group[[0, 2, 3]])) == 3


def test_the_body_of_a_margin_is_the_largest_group():
    tiles = chessboard([(0, 0), (0, 1), (0, 2), (5, 0)], [(0, -1), (5, -1)])
    load = statics.uniform(tiles, 0.0, FORCE)
    load[3] *= 10.0
    found = stability.margin(tiles, (load,), BARE)
    assert found.body == pytest.approx(BOND / (3 * FORCE), rel=1e-6)
    assert found.tiles == pytest.approx(BOND / (10 * FORCE), rel=1e-6)
    assert found.net == pytest.approx(3 * FORCE)


def test_the_body_of_a_margin_does_not_need_the_other_groups_to_rest():
    """A lone tile that its neighbour repels, five sites away, has no state of rest itself."""
    tiles = chessboard([(0, 0), (0, 1), (0, 2), (5, 0)], [(0, -1), (5, -1)])
    glues = tiles.glues.copy()
    glues[3] *= -1
    load = statics.uniform(tiles, 0.0, FORCE)
    found = stability.margin(statics.Tiles(tiles.site, glues, tiles.held), (load,), BARE)
    assert found.tiles == 0.0
    assert found.body == pytest.approx(BOND / (3 * FORCE), rel=1e-6)


@given(st.lists(st.integers(0, 3), min_size=3, max_size=3))
@settings(deadline=None, max_examples=20)
def test_recorded_tiles_show_their_glues_as_turned(turns):
    glues = [(1, 2, 3, 4), (-1, 0, -3, 7)]
    tiles = stability.recorded([[0, 0], [1, 0], [2, 5]], [0, 1, 0], turns, [True, False, False],
                               glues)
    for facing, kind, turn in zip(tiles.glues, (0, 1, 0), turns, strict=True):
        assert tuple(facing) == rotated(glues[kind], turn)


@pytest.mark.parametrize(("kind", "turns", "words"), [
    ([-1], [0], "kind must be from 0 to 1"), ([2], [0], "kind must be from 0 to 1"),
    ([0], [0.5], "must be whole numbers")])
def test_what_is_no_recorded_tile_is_refused(kind, turns, words):
    with pytest.raises(ValueError, match=words):
        stability.recorded([[0, 0]], kind, turns, [True], [(1, 2, 3, 4), (-1, 0, -3, 7)])


@pytest.mark.parametrize("numbers", [(0, 0.2, 0.07), (-2, 0.2, 0.07), (2, math.nan, 0.07),
                                     (2, 0.2, math.nan), (2, 0.2, -0.07)])
def test_a_probability_of_no_block_is_refused(numbers):
    with pytest.raises(ValueError, match="n must be whole and at least 1, the bond a number and"):
        stability.half_turn_holds(*numbers)


# Torques.


def test_the_default_torque_peels_a_tile_on_a_straight_row():
    """One bond: F_bond w/2 and the floor's torque; and the floor's force on the tile's middle."""
    tiles = chessboard([(0, 0)], ROW)
    numbers = Numbers()
    row = 0.0736028
    bare = numbers._replace(floor=(0.0, 0.0))
    no_force = numbers._replace(floor=(0.0, numbers.floor[1]))
    for each in (bare, no_force, numbers):
        assert stability.critical_torque(tiles, numbers=each) == pytest.approx(
            stability.bond_torque(row, W, each.floor), rel=3e-4)
        assert stability.critical_torque(tiles, numbers=each) < TORQUE
    # The paper's F_g would hold it.
    assert stability.critical_torque(tiles, numbers=MATING) > TORQUE
    assert stability.bond_torque(BOND, W, MATING.floor) == pytest.approx(
        stability.critical_torque(tiles, numbers=MATING), rel=3e-4)


def test_a_tile_with_more_neighbours_bears_more_torque():
    n = 4
    tiles = block(n)
    one = stability.critical_torque(chessboard([(0, 0)], ROW))
    corner, middle = (stability.critical_torque(tiles, (tiles.site == site).all(axis=1))
                      for site in ((n - 1, n - 1), (n // 2, n // 2)))
    assert 2.0 * one < corner
    assert 2.0 * corner < middle
    # All at once are borne as far as the weakest of them: size does not matter.
    assert stability.critical_torque(tiles) == pytest.approx(corner, rel=1e-3)


def test_a_force_takes_its_share_of_the_torque():
    tiles = chessboard([(0, 0)], ROW)
    free, pushed = (stability.critical_torque(tiles, force=force) for force in (0.0, FORCE))
    assert 0.0 < pushed < free
    assert stability.critical_torque(tiles, force=1.0) == 0.0


def test_no_torque_is_left_to_a_force_that_is_not_borne_without_it():
    """Two tiles on a held one: the outer one, pushed off sideways, is held with some torque."""
    tiles = chessboard([(0, 0), (1, 0)], [(2, 0)])
    outer = (tiles.site == (0, 0)).all(axis=1)
    numbers = MATING._replace(mu=0.5, floor=(0.0, 0.0))
    law, mating, mu, floor = numbers
    exact = statics.Statics(tiles, law, mating=mating, mu=mu, floor=floor)
    push, turn = (np.outer(outer, wrench) for wrench in ((0.0, 0.08, 0.0), (0.0, 0.0, 1.0)))
    assert not exact.bears(push)
    assert exact.rest(turn, dead=push).factor > 0.0
    assert stability.critical_torque(tiles, outer, numbers, 0.08) == 0.0
    assert stability.critical_torque(tiles, outer, numbers, 0.05) > 0.0


def test_the_tables_have_every_case_and_position():
    text = stability.sizes_table([1, 2], FORCE, TORQUE, 2, MATING)
    assert all(text.count(name) >= 2 for name in stability.CASES)
    shaken = next(line for line in text.splitlines() if line.startswith("shaken"))
    assert f"{stability.margin(*stability.case('shaken', 1, FORCE), MATING).tiles:.3f}" in shaken
    for force in (1e-12, 1e12):  # columns stay apart
        line = stability.sizes_table([2], force, TORQUE, 1, MATING).splitlines()[1]
        assert len([float(each) for each in line[24:].split()]) == 5
    text = stability.torque_table([2], FORCE, MATING)
    assert f"{stability.critical_torque(block(2), numbers=MATING):.3e}" in text


# Recorded runs.


@pytest.fixture
def run(tmp_path):
    """Folder of a short run: an L-shaped seed, a 2 x 2 block, one tile turned, one far away."""
    def make(drive, **changes):
        types = tbsa.model.scene.SETS["chessboard"]
        seed = tbsa.model.scene.Seed(tuple((c, r, types[(c + r) % 2].name) for c, r in l_seed(3)),
                                     (0.01, -0.02), 0.3)
        def place(column, row, turn=0.0):
            x, y = W * column, W * row
            c, s = math.cos(0.3), math.sin(0.3)
            return PlacedTile(types[(column + row) % 2].name,
                              (0.01 + c * x - s * y, -0.02 + s * x + c * y), 0.3 + turn)
        free = (place(0, 0), place(1, 0), place(0, 1, math.pi), place(1, 1), place(8, 8))
        scene = Scene(types=types, seed=seed, free=tbsa.model.scene.Free((), free),
                      magnet=Magnet(), floor=Floor(), drive=drive,
                      record=tbsa.model.scene.Record(0.1, 0.1),
                      run=tbsa.model.scene.Run(0.2))
        scene = replace(scene, **changes)
        scene.validate()
        tbsa.run(scene, tmp_path / drive.kind)
        return tmp_path / drive.kind
    return make


def test_an_assembly_is_read_from_a_record_in_the_seeds_frame(run):
    records = tbsa.read_run(run(Drive("shaking", force=0.01, frequency=0.33)))
    tiles, family, heading = figure.attached(records, 0, ground_truth(records.scene))
    assert set(map(tuple, tiles.site[tiles.free].tolist())) == {(0, 0), (1, 0), (0, 1), (1, 1)}
    assert set(map(tuple, tiles.site[tiles.held].tolist())) == set(l_seed(3))
    for site, sign, angle in zip(tiles.site, family, heading, strict=True):
        assert sign == (1.0 if site.sum() % 2 == 0 else -1.0)
        turned = math.pi if tuple(site) == (0, 1) else 0.0
        assert angle == pytest.approx(0.5 * math.pi + turned)
    for site, facing in zip(tiles.site, tiles.glues, strict=True):
        assert tuple(facing) == statics.CHESSBOARD[site.sum() % 2]


def test_margins_of_a_run_are_those_of_its_assembly(run):
    shaken = figure.margins(run(Drive("shaking", force=0.01, frequency=0.33)), 2)
    assert (shaken["size"] == 4).all()
    tiles = block(2)
    tiles = chessboard(map(tuple, tiles.site[tiles.free].tolist()), l_seed(3))
    expected = stability.margin(tiles, stability.shaking(tiles, 0.01))
    assert shaken["tiles"].to_numpy() == pytest.approx([expected.tiles] * 2, rel=1e-3)
    assert shaken["body"].to_numpy() == pytest.approx([expected.body] * 2, rel=1e-3)
    steered = figure.margins(run(Drive("unicycle", force=0.01, torque=3e-4, frequency=0.1)), 2)
    assert (steered["tiles"] < 0.9 * steered["no_torque"]).all()
    assert steered["net"].to_numpy() == pytest.approx([0.02, 0.02])  # the turned tile's share


def test_margins_off_the_scale_are_drawn_at_its_ends_and_hollow(run, monkeypatch):
    found = pd.DataFrame({"size": [1, 2, 3, 4], "tiles": [0.0, 0.01, math.inf, 2.0],
                          "body": [1, 2, 3.0, 4.0]})
    monkeypatch.setattr(figure, "margins", lambda folder: found)
    drawn = figure.make([run(Drive("shaking", force=0.01, frequency=0.33))])
    (ax,) = drawn.axes
    line = next(line for line in ax.lines if line.get_label() == "tile by tile")
    assert line.get_ydata() == pytest.approx([math.nan] * 3 + [2.0], nan_ok=True)
    (hollow,) = (line for line in ax.lines if line.get_markerfacecolor() == "white")
    assert hollow.get_xdata().tolist() == [1, 2, 3]
    assert hollow.get_ydata() == pytest.approx([*ax.get_ylim()[:1] * 2, ax.get_ylim()[1]])
    assert drawn.get_supxlabel() == "hollow: above 30, or below 0.1"


def test_the_figure_has_a_panel_for_each_run(run):
    folders = [run(Drive("shaking", force=0.01, frequency=0.33)),
               run(Drive("unicycle", force=0.01, torque=1e-4, frequency=0.1))]
    panels = figure.make(folders).axes
    assert [ax.get_title() for ax in panels] == ["shaking", "self-stabilizing"]
    assert [len(ax.get_legend().get_texts()) for ax in panels] == [2, 3]


def test_a_run_with_another_drive_or_no_magnets_has_no_margin(run):
    with pytest.raises(tbsa.InputError, match=r"drive\.kind"):
        figure.margins(run(Drive("constant", force=(0.001, 0.0))))
    with pytest.raises(tbsa.InputError, match="magnet"):
        figure.margins(run(Drive("shaking", force=0.001, frequency=0.3), magnet=None))


@pytest.mark.parametrize("law", ["coupled", "exact"])
def test_a_floor_of_which_the_statics_have_no_bound_has_no_margin(run, law):
    """One bound on force and torque together holds less than the two apart would."""
    with pytest.raises(tbsa.InputError, match=r"floor\.law"):
        figure.margins(run(Drive("shaking", force=0.001, frequency=0.3), floor=Floor(law)))
