"""What counts as assembled, wrong and missing."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from twins_metrics import twin

from tbsa.errors import InputError
from tbsa.model.layout import Layout, initial_layout
from tbsa.model.scene import SETS, Free, Magnet, PlacedTile, Scene, Seed, TileType
from tbsa.model.tiles import check, ground_truth, mirrored
from tbsa.work import metrics

W = 0.03
QUARTER = math.pi / 2
CHESS, ORIENTED = SETS["chessboard"], SETS["chessboard-oriented"]
IMPOSTOR = TileType("impostor", (0, 0, 0, -2), "red")  # binds east of a black tile, by one glue
BLOCK = [(c, r) for c in (1, 2, 3) for r in (1, 2, 3)]


def colour(column, row):
    return ("black", "white")[(column + row) % 2]


def corner(arm=3):
    """An L of one centre tile and two arms, which bounds the first quadrant."""
    cells = [(k, 0) for k in range(arm + 1)] + [(0, k) for k in range(1, arm + 1)]
    return tuple((c, r, colour(c, r)) for c, r in cells)


def at(column, row, kind=None, turns=0, dx=0.0, dy=0.0, askew=0.0, held=False):
    """A tile at a site; `dx`, `dy` in tile widths, `turns` of a quarter."""
    return PlacedTile(kind or colour(column, row), ((column + dx) * W, (row + dy) * W),
                      turns * QUARTER + askew, held=held)


def scene_of(tiles, types=CHESS, seed=None):
    return Scene(types=types, seed=seed or Seed(corner()), free=Free(tiles=tuple(tiles)),
                 magnet=Magnet())


def measure(scene):
    layout = initial_layout(scene)
    return metrics.assembly(scene, layout, layout.x, layout.y, layout.angle)


def row(found):
    """The row without what the examples do not look at."""
    return {name: value for name, value in found.row().items() if value != 0}


# --- examples with known answers ---------------------------------------------------------------

def test_an_errorless_block_in_a_quadrant():
    found = measure(scene_of(at(*site) for site in BLOCK))
    assert row(found) == {
        "size": 9, "total": 16, "size_contact": 9, "directed": True,
        "bonds": 18, "bonds_assembly": 18,  # 12 within the block and 6 to the seed
    }
    assert found.errors == found.holes == 0
    assert found.on_lattice.sum() == 9
    assert sorted(map(tuple, found.site[found.attached])) == BLOCK


def test_bonds_within_the_seed_do_not_count():
    found = measure(scene_of([at(9, 9)]))
    assert (found.size, found.total, found.bonds) == (0, 7, 0)


def test_percentages_of_an_assembly_without_tiles_are_not_numbers():
    found = measure(scene_of([at(9, 9)])).row()
    assert math.isnan(found["errors_percent"])
    assert math.isnan(found["holes_percent"])


def test_a_hole_is_an_empty_cell_with_four_occupied_neighbours():
    found = measure(scene_of(at(*site) for site in BLOCK if site != (2, 2)))
    assert found.holes == 1
    assert found.hole_sites.tolist() == [[2, 2]]
    assert found.row()["holes_percent"] == pytest.approx(100 / 8)
    assert found.bonds == 14


def test_tiles_of_the_seed_enclose_holes_too():
    found = measure(scene_of(at(*site) for site in BLOCK if site != (1, 1)))
    assert found.hole_sites.tolist() == [[1, 1]]


def test_an_empty_cell_at_the_rim_is_no_hole():
    found = measure(scene_of(at(*site) for site in BLOCK if site not in [(3, 2), (3, 3)]))
    assert found.size == 7
    assert found.holes == 0


def test_a_tile_that_fills_a_cell_without_a_bond_leaves_it_a_hole():
    tiles = [at(*site, turns=int(site == (2, 2))) for site in BLOCK]
    found = measure(scene_of(tiles))  # a quarter turn is repelled at every edge
    assert (found.size, found.holes) == (8, 1)
    assert found.size + 1 == found.row()["size_contact"]


def test_two_holes_are_found_in_a_turned_and_moved_frame():
    seed = Seed(corner(7), centre=(0.1, -0.2), angle=0.7)
    scene = scene_of([], seed=seed)
    sites = [(c, r) for c in range(1, 8) for r in range(1, 8) if (c, r) not in [(3, 5), (5, 2)]]
    turn = np.exp(0.7j)
    z = [complex(0.1, -0.2) + W * complex(*site) * turn for site in sites]
    tiles = [PlacedTile(colour(*site), (p.real, p.imag), 0.7)
             for site, p in zip(sites, z, strict=True)]
    found = measure(replace(scene, free=Free(tiles=tuple(tiles))))
    assert found.hole_sites.tolist() == [[3, 5], [5, 2]]
    assert (found.size, found.errors) == (47, 0)


def test_a_tile_of_the_wrong_colour_is_an_error():
    types = (*CHESS, IMPOSTOR)
    tiles = [at(1, 1), at(2, 1, "impostor"), at(1, 2)]
    found = measure(scene_of(tiles, types))
    assert found.directed
    assert (found.size, found.errors) == (3, 1)
    assert found.erroneous.tolist() == [False] * 7 + [False, True, False]
    assert found.row()["errors_percent"] == pytest.approx(100 / 3)
    assert found.row()["wrongly_turned"] == 0


def test_another_type_of_the_right_colour_is_no_error():
    types = (*CHESS, replace(IMPOSTOR, colour="white"))
    found = measure(scene_of([at(1, 1), at(2, 1, "impostor"), at(1, 2)], types))
    assert (found.size, found.errors) == (3, 0)


def test_colours_are_compared_as_they_look():
    black, white = CHESS
    types = (black, replace(white, colour="white"), replace(white, name="twin", colour="#FFFFFF"),
             replace(IMPOSTOR, colour="none"))
    found = measure(scene_of([at(1, 1), at(2, 1, "twin"), at(1, 2)], types))
    assert found.directed
    assert (found.size, found.errors) == (3, 0)
    assert not any(each.wanted == each.offered or {each.wanted, each.offered} == {"white", "twin"}
                   for each in check(types, ground_truth(scene_of([], types))))
    found = measure(scene_of([at(1, 1), at(2, 1, "impostor")], types))  # "none" is no black
    assert (found.size, found.errors) == (2, 1)


def test_a_half_turn_is_right_for_a_tile_of_that_symmetry():
    found = measure(scene_of(at(*site, turns=2) for site in BLOCK))
    assert (found.size, found.wrongly_turned.sum()) == (9, 0)


@pytest.mark.parametrize("turns", [-3, -1, 1, 3, 5])
def test_a_quarter_turned_tile_of_the_oriented_set_is_wrongly_turned_and_no_error(turns):
    tiles = [at(*site, turns=turns if site == (2, 2) else 4) for site in BLOCK]
    found = measure(scene_of(tiles, ORIENTED))
    assert (found.size, found.errors, found.holes) == (9, 0, 0)
    assert found.wrongly_turned.sum() == 1
    assert found.bonds == 16  # it keeps two of its four


def test_a_half_turned_tile_without_that_symmetry_is_wrongly_turned():
    lame = TileType("lame", (-1, 0, -1, -2), "white")  # E has no magnet
    tiles = [at(1, 1), at(2, 1, "lame", turns=2)]
    found = measure(scene_of(tiles, (*CHESS, lame)))
    assert (found.size, found.wrongly_turned.sum()) == (2, 1)
    found = measure(scene_of([at(1, 1), at(2, 1, "lame")], (*CHESS, lame)))
    assert (found.size, found.wrongly_turned.sum()) == (2, 0)


def test_a_tile_pressed_against_the_assembly_touches_but_is_not_attached():
    found = measure(scene_of([at(1, 1), at(2, 1, "black")]))
    assert found.size == 1
    assert found.row()["size_contact"] == 2
    assert found.errors == 0


def test_a_chain_of_contacts_passes_through_tiles_that_are_not_bonded():
    found = measure(scene_of([at(1, 1), at(2, 1, "black", dy=0.4), at(3, 1, "white", dy=0.4)]))
    assert (found.size, found.row()["size_contact"]) == (1, 3)
    assert found.largest_free_cluster == 2


def test_a_detached_cluster_is_free_whatever_its_size():
    tiles = [at(c + 20, r, dx=0.3) for c in (0, 1) for r in (0, 1)] + [at(1, 1)]
    found = measure(scene_of(tiles))
    assert found.largest_free_cluster == 4
    assert found.size == 1
    assert (found.bonds, found.row()["bonds_assembly"]) == (6, 2)


def test_a_cluster_of_one_is_the_least_and_none_is_left_when_all_are_attached():
    assert measure(scene_of([at(1, 1), at(9, 9)])).largest_free_cluster == 1
    assert measure(scene_of([at(1, 1)])).largest_free_cluster == 0


def test_a_tile_beyond_the_ground_truth_is_outside_and_no_error():
    found = measure(scene_of([at(-1, 0)]))
    assert row(found) == {"size": 1, "total": 8, "size_contact": 1, "outside": 1, "bonds": 1,
                          "bonds_assembly": 1, "directed": True}


def test_small_slips_add_up_to_a_tile_off_the_lattice():
    tiles = [at(k + 3, 0, dy=0.08 * k) for k in range(1, 5)]
    found = measure(scene_of(tiles))
    assert found.size == 4
    assert found.off_lattice.tolist() == [False] * 7 + [False, False, False, True]
    assert found.outside.sum() == 3  # a tile off the lattice has no site


def test_a_tile_that_a_bent_chain_has_turned_is_off_the_lattice():
    tiles, z = [], 3.0
    for k in range(1, 4):  # each 0.09 rad further round, and as far back as its bond allows
        z += (np.exp(0.09j * (k - 1)) + np.exp(0.09j * k)) / 2 - 0.08j
        dx, dy = z.real - 3 - k, z.imag
        assert math.hypot(dx, dy) < metrics.ON_SITE
        tiles.append(at(3 + k, 0, dx=dx, dy=dy, askew=0.09 * k))
    found = measure(scene_of(tiles))
    assert found.size == 3
    assert found.off_lattice.tolist() == [False] * 7 + [False, False, True]


def test_a_tile_off_the_lattice_has_no_right_turn_to_differ_from():
    hook = TileType("hook", (-1, -2, -1, 0), "white")  # E faces west after a half turn
    tiles = [at(4, 0, dy=0.09), at(5, 0, dy=0.18), at(6, 0, dy=0.24), at(7, 0, "hook", 2, dy=0.3)]
    found = measure(scene_of(tiles, (*CHESS, hook)))
    assert found.off_lattice.tolist() == [False] * 10 + [True]
    assert found.wrongly_turned.sum() == 0
    on = measure(scene_of([*tiles[:3], at(7, 0, "hook", 2, dy=0.24)], (*CHESS, hook)))
    assert on.wrongly_turned.sum() == 1


def test_a_tile_set_that_is_not_directed_counts_mismatches_instead():
    twin_of_white = replace(CHESS[1], name="grey", colour="grey")
    stranger = TileType("stranger", (-3, 3, 3, -2), "blue")
    types = (*CHESS, twin_of_white, stranger)
    tiles = [at(1, 1), at(2, 1, "stranger"), at(1, 2, "grey"), at(2, 2)]
    found = measure(scene_of(tiles, types))
    assert not found.directed
    assert found.wrong_colour.sum() == found.outside.sum() == 0
    # The stranger is bonded to its west and clashes with the seed below and the tile above.
    assert found.erroneous.tolist() == [False] * 7 + [False, True, False, True]
    assert found.errors == found.row()["mismatched"] == 2
    assert np.isnan([found.row()["wrong_colour"], found.row()["outside"]]).all()


def test_two_families_of_one_colour_have_one_ground_truth():
    stranger = TileType("stranger", (5, 6, 7, -2), "red")
    tiles = [at(1, 1, "stranger"), at(1, 2), at(0, 3)]
    back = replace(CHESS[1], name="back", family=-1)
    one, two = (row(measure(scene_of(tiles, types))) for types in (
        (*CHESS, stranger), (*CHESS, stranger, back)))
    assert one == two


def test_without_magnets_nothing_is_bonded_whatever_the_glues():
    scene = scene_of([at(c, r, "black") for c, r in BLOCK])
    found = measure(replace(scene, magnet=None))
    assert (found.size, found.bonds, found.mismatched.sum()) == (0, 0, 0)
    assert row(found)["size_contact"] == 9
    assert measure(scene).size > 0


def test_an_edge_without_a_magnet_is_no_mismatch():
    found = measure(scene_of([at(1, 1), at(2, 1, "impostor")], (*CHESS, IMPOSTOR)))
    assert found.mismatched.sum() == 0


def test_a_scene_without_a_seed_has_no_assembly():
    scene = replace(scene_of([at(0, 0), at(1, 0), at(5, 0)]), seed=None)
    found = measure(scene)
    assert row(found).keys() == {"errors_percent", "holes_percent", "largest_free_cluster",
                                 "bonds", "directed"}
    assert (found.largest_free_cluster, found.bonds) == (2, 1)


def test_held_tiles_are_not_the_seed():
    scene = replace(scene_of([at(0, 0, held=True), at(1, 0)]), seed=None)
    found = measure(scene)
    assert (found.size, found.total, found.largest_free_cluster) == (0, 0, 2)


# --- tolerances --------------------------------------------------------------------------------

@pytest.mark.parametrize(
    ("change", "bonded"),
    [
        ({"dx": 0.95 * metrics.CLOSE}, True),
        ({"dx": 1.05 * metrics.CLOSE}, False),
        ({"dy": -0.95 * metrics.CLOSE}, True),
        ({"dy": 1.05 * metrics.CLOSE}, False),
        ({"askew": 0.95 * metrics.ALIGNED}, True),
        ({"askew": -1.05 * metrics.ALIGNED}, False),
    ],
)
def test_bonds_end_at_their_tolerances(change, bonded):
    assert measure(scene_of([at(4, 0, **change)])).size == bonded


def touches(dx, dy, askew):
    """Contact with the end tile of the seed's arm, of a tile on the arm's axis."""
    return measure(scene_of([at(3, 0, dx=dx, dy=dy, askew=askew)])).row()["size_contact"] == 1


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_contact_ends_at_its_tolerance(factor):
    gap, near = factor * metrics.TOUCHING, factor < 1
    assert touches(1 + gap, 0.6, 0.0) is near  # face to face
    assert touches(0.5 + gap + math.sqrt(0.5), 0.1, math.pi / 4) is near  # corner to face
    step = 1 + gap * math.sqrt(0.5)
    assert touches(step, step, 0.0) is near  # corner to corner


def test_crossed_squares_are_in_contact_though_no_corner_is_inside():
    lone = Seed(((0, 0, "black"),))
    found = measure(scene_of([at(0, 0, dx=0.01, askew=math.pi / 4)], seed=lone))
    assert found.touching.tolist() == [False, True]


# --- against the twin --------------------------------------------------------------------------

@st.composite
def records(draw):
    """A scene and a record of it: a lattice with gaps, wrong tiles, slips, and loose tiles."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    glues = rng.integers(-2, 3, (3, 4)).tolist()
    wild = tuple(TileType(name, tuple(g), colour) for name, g, colour in
                 zip(("black", "white", "third"), glues, ("black", "white", "black"), strict=True))
    types = draw(st.sampled_from([CHESS, ORIENTED, wild, (*CHESS, IMPOSTOR),
                                  (*ORIENTED, replace(ORIENTED[0], name="third", colour="red"))]))
    arm, filled = draw(st.integers(1, 3)), draw(st.sampled_from([0.3, 0.7, 1.0]))
    slip = draw(st.sampled_from([0.0, 0.01, 0.06]))
    seed = Seed(corner(arm), tuple(rng.uniform(-1, 1, 2)), rng.uniform(-4, 4))
    if draw(st.integers(0, 9)) == 0:
        seed = None
    names = [kind.name for kind in types]
    frame = seed or Seed((), (0.2, 0.1), 0.4)
    x, y, angle, index = [], [], [], []
    for c, r, name in frame.cells:
        x, y, angle, index = [*x, c], [*y, r], [*angle, 0.0], [*index, names.index(name)]
    taken = {(c, r) for c, r, _ in frame.cells}
    for c in range(-2, 5):
        for r in range(-2, 5):
            if (c, r) not in taken and rng.random() < filled:
                wrong = rng.random() < 0.15
                x.append(c + rng.normal(0, slip))
                y.append(r + rng.normal(0, slip))
                angle.append(QUARTER * rng.choice([0, 2, 4, rng.integers(-9, 9)])
                             + rng.normal(0, slip))
                index.append(rng.integers(len(types)) if wrong else (c + r) % 2)
    for _ in range(draw(st.integers(0, 12))):  # loose tiles, some upon others
        x.append(rng.uniform(-4, 8))
        y.append(rng.uniform(-4, 8))
        angle.append(rng.uniform(-7, 7))
        index.append(rng.integers(len(types)))
    z = np.exp(1j * frame.angle) * W * (np.array(x) + 1j * np.array(y)) + complex(*frame.centre)
    held = np.arange(len(x)) < len(frame.cells)
    scene = Scene(types=types, seed=seed, magnet=Magnet())
    zero = np.zeros(len(x))
    return scene, Layout(z.real, z.imag, np.array(angle) + frame.angle, zero, zero, zero,
                         np.array(index, np.int64), held, held)


def assess(scene, layout):
    return metrics.assembly(scene, layout, layout.x, layout.y, layout.angle)


@settings(deadline=None, max_examples=120)
@given(records())
def test_the_metrics_agree_with_their_twin(record):
    scene, layout = record
    found = assess(scene, layout)
    expected, sets, holes = twin(scene, layout, layout.x, layout.y, layout.angle)
    np.testing.assert_equal(found.row(), expected)
    for name, tiles in sets.items():
        assert set(np.flatnonzero(getattr(found, name)).tolist()) == tiles, name
    assert set(map(tuple, found.hole_sites.tolist())) == holes
    assert metrics.size(scene, layout, layout.x, layout.y, layout.angle) == expected["size"]


@settings(deadline=None, max_examples=30)
@given(records(), st.floats(-7, 7), st.floats(-3, 3), st.floats(-3, 3))
def test_rotating_and_moving_the_whole_scene_changes_nothing(record, turn, dx, dy):
    scene, layout = record
    z = (layout.x + 1j * layout.y) * np.exp(1j * turn) + complex(dx, dy)
    moved = replace(layout, x=z.real, y=z.imag, angle=layout.angle + turn)
    seed = scene.seed
    if seed is not None:
        centre = complex(*seed.centre) * np.exp(1j * turn) + complex(dx, dy)
        seed = replace(seed, centre=(centre.real, centre.imag), angle=seed.angle + turn)
    np.testing.assert_equal(assess(replace(scene, seed=seed), moved).row(),
                            assess(scene, layout).row())


@settings(deadline=None, max_examples=30)
@given(records())
def test_the_mirrored_scene_with_mirrored_labels_measures_the_same(record):
    scene, layout = record
    seed = scene.seed
    if seed is not None:
        cells = tuple((-c, r, name) for c, r, name in seed.cells)
        seed = Seed(cells, (-seed.centre[0], seed.centre[1]), -seed.angle)
    image = replace(scene, types=tuple(map(mirrored, scene.types)), seed=seed)
    np.testing.assert_equal(
        assess(image, replace(layout, x=-layout.x, angle=-layout.angle)).row(),
        assess(scene, layout).row())


@settings(deadline=None, max_examples=30)
@given(records(), st.randoms(use_true_random=False))
def test_renumbering_the_tiles_renumbers_the_results(record, random):
    scene, layout = record
    order = list(range(len(layout.x)))
    random.shuffle(order)
    shuffled = Layout(**{name: each[order] for name, each in vars(layout).items()})
    before, after = assess(scene, layout), assess(scene, shuffled)
    np.testing.assert_equal(after.row(), before.row())
    np.testing.assert_equal(after.erroneous, before.erroneous[order])
    np.testing.assert_equal(after.attached, before.attached[order])


# --- the table ---------------------------------------------------------------------------------

def test_the_table_has_one_row_a_record_with_the_time_in_front():
    scene = scene_of(at(*site) for site in BLOCK)
    layout = initial_layout(scene)
    gone = layout.x + 9.0 * (np.arange(len(layout.x)) > 12)  # three tiles carried away
    x = np.stack([layout.x, gone])
    y, angle = np.tile(layout.y, (2, 1)), np.tile(layout.angle, (2, 1))
    frame = metrics.table(scene, layout, np.array([0.0, 10.0]), x, y, angle)
    assert list(frame["time"]) == [0.0, 10.0]
    assert list(frame["size"]) == [9, 6]
    assert frame.columns[0] == "time"
    for k in range(2):
        expected = metrics.assembly(scene, layout, x[k], y[k], angle[k]).row()
        assert frame.iloc[k].drop(["time", "joined", "left"]).to_dict() == expected
    assert list(frame["joined"]) == [0, 0]
    assert list(frame["left"]) == [0, 3]


def test_events_are_counted_tile_by_tile_between_records():
    attached = np.array([[1, 1, 0, 0], [1, 0, 1, 1], [1, 0, 1, 1], [0, 0, 0, 0]], dtype=bool)
    joined, left = metrics.events(attached)
    assert joined.tolist() == [0, 2, 0, 0]
    assert left.tolist() == [0, 1, 0, 3]
    assert (np.diff(attached.sum(axis=1)) == (joined - left)[1:]).all()
    assert [each.tolist() for each in metrics.events(attached[:0])] == [[], []]


def test_a_table_of_no_records_still_has_its_columns():
    scene = scene_of([at(1, 1)])
    layout = initial_layout(scene)
    empty = np.zeros((0, len(layout.x)))
    frame = metrics.table(scene, layout, np.zeros(0), empty, empty, empty)
    assert len(frame) == 0
    assert {"time", "size", "errors_percent", "holes_percent"} <= set(frame.columns)


def test_a_given_ground_truth_is_the_one_compared_with():
    scene = scene_of(at(*site) for site in BLOCK)
    layout = initial_layout(scene)
    truth = ground_truth(scene)
    swapped = replace(truth, types={site: 1 - k for site, k in truth.types.items()})
    record = layout.x, layout.y, layout.angle
    assert metrics.assembly(scene, layout, *record, truth).errors == 0
    assert metrics.assembly(scene, layout, *record, swapped).errors == 9


def test_arrays_that_do_not_fit_are_refused():
    scene = scene_of([at(1, 1)])
    layout = initial_layout(scene)
    x, y, angle = layout.x, layout.y, layout.angle
    with pytest.raises(InputError, match=r"record\.y.*\(7,\).*\(8,\)"):
        metrics.assembly(scene, layout, x, y[1:], angle)
    with pytest.raises(InputError, match=r"record\.angle.*finite"):
        metrics.size(scene, layout, x, y, angle * np.nan)
    with pytest.raises(InputError, match=r"record\.x: .*must be from -3e\+07 to 3e\+07"):
        metrics.assembly(scene, layout, x + 1e300, y, angle)
    with pytest.raises(InputError, match=r"record\.angle: .*must be from -1e\+09 to 1e\+09"):
        metrics.assembly(scene, layout, x, y, angle + 1e30)
    with pytest.raises(InputError, match="n = 8 tiles"):
        metrics.table(scene, layout, np.zeros(2), x[None], y[None], angle[None])
    with pytest.raises(InputError, match=r"record\.x: .*complex128.* array of numbers"):
        metrics.assembly(scene, layout, x * 1j, y, angle)
    with pytest.raises(InputError, match=r"table\.time.*finite"):
        metrics.table(scene, layout, [np.nan], x[None], y[None], angle[None])
    with pytest.raises(InputError, match=r"table\.x: .*complex128.* array of numbers"):
        metrics.table(scene, layout, [0.0], x[None] * 1j, y[None], angle[None])
    with pytest.raises(InputError, match=r"table\.x: .*list.* array of numbers"):
        metrics.table(scene, layout, np.zeros(2), [x, x[1:]], [y, y], [angle, angle])
    with pytest.raises(TypeError, match=r"scene must be a Scene, not str: tbsa\.load"):
        metrics.assembly("scene.toml", layout, x, y, angle)
    with pytest.raises(TypeError, match="layout must be a Layout, not tuple"):
        metrics.assembly(scene, (x, y, angle), x, y, angle)


def test_a_layout_of_another_scene_is_refused():
    scene = scene_of([at(1, 1)])
    layout = initial_layout(scene)
    foreign = replace(layout, type=layout.type + 5)
    for measure in (metrics.assembly, metrics.size):
        with pytest.raises(InputError, match=r"layout\.type: .* must be from 0 to 1"):
            measure(scene, foreign, layout.x, layout.y, layout.angle)


def test_importing_the_metrics_does_not_import_pandas_or_matplotlib():
    code = ("import sys, tbsa.work.metrics\n"
            "sys.exit(bool({'pandas', 'matplotlib'} & set(sys.modules)))")
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
