"""Tile sets: glues, abstract growth and the traps of a set."""

from __future__ import annotations

import cmath
import random
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbsa.model.scene import SETS, TileType, load, parse
from tbsa.model.tiles import (
    STEPS,
    Growth,
    attracts,
    check,
    ground_truth,
    grow,
    mirrored,
    rotated,
    strength,
    symmetry,
)

PAPER = load(Path(__file__).parents[1] / "paper_runs" / "self_stabilizing.toml")
CHESSBOARD, ORIENTED = SETS["chessboard"], SETS["chessboard-oriented"]
glues = st.tuples(*[st.integers(-3, 3)] * 4)
everywhere = dict.fromkeys(product(range(-60, 61), repeat=2))


def tile(name, *glues):
    return TileType(name, glues, name)


# --- glues and symmetry ------------------------------------------------------------------------


def test_a_glue_attracts_its_opposite_only_and_no_magnet_attracts_nothing():
    assert attracts(2, -2)
    assert attracts(-2, 2)
    assert not any(attracts(a, b) for a, b in ((2, 2), (1, -2), (0, 0), (0, 1)))


def test_after_a_quarter_turn_counter_clockwise_the_east_edge_faces_north():
    assert rotated((1, 2, 3, 4), 1) == (2, 3, 4, 1)
    assert rotated((1, 2, 3, 4), -1) == (4, 1, 2, 3)


@given(glues, st.integers(-9, 9), st.integers(-9, 9))
def test_turns_add_up_and_four_are_none(g, j, k):
    assert rotated(rotated(g, j), k) == rotated(g, j + k)
    assert rotated(g, 4) == g


@given(glues, st.sampled_from("NESW"))
def test_a_mirror_swaps_east_and_west_and_undoes_itself(g, forward):
    original = TileType("a", g, "red", 1, forward)
    image = mirrored(original)
    assert image.glues == (g[0], g[3], g[2], g[1])
    assert mirrored(image) == original
    assert rotated(image.glues, 1) == mirrored(tile("a", *rotated(g, -1))).glues


@given(glues)
def test_symmetry_is_the_smallest_turn_that_shows_the_same_glues(g):
    turns = symmetry(tile("a", *g))
    assert [k for k in range(4) if rotated(g, k) == g] == list(range(0, 4, turns))


def test_the_first_chessboard_set_looks_the_same_after_a_half_turn_the_second_never():
    assert [symmetry(kind) for kind in CHESSBOARD] == [2, 2]
    assert [symmetry(kind) for kind in ORIENTED] == [4, 4]


@pytest.mark.parametrize("types", SETS.values(), ids=SETS.keys())
def test_in_a_chessboard_unlike_neighbours_bond_at_every_edge_and_like_ones_at_none(types):
    black, white = types
    for edge, step in enumerate(STEPS):
        for a, b in product(types, repeat=2):
            bond = attracts(a.glues[edge], b.glues[(edge + 2) % 4])
            assert bond == (a is not b), (step, a.name, b.name)
    assert len({abs(glue) for glue in black.glues}) == 2
    assert (black.family, white.family) == (1, -1)


# --- growth ------------------------------------------------------------------------------------


@pytest.mark.parametrize("types", SETS.values(), ids=SETS.keys())
def test_the_paper_seed_grows_to_four_quadrants_of_ten_by_ten_of_a_chessboard(types):
    truth = ground_truth(replace(PAPER, types=types))
    assert truth.directed
    assert set(truth.types) == set(product(range(-10, 11), repeat=2))
    assert all(kind == (c + r) % 2 for (c, r), kind in truth.types.items())
    assert len(truth.types) - len(truth.seed) == 400


def test_growth_stays_where_the_whole_tile_is_inside_the_reactor():
    small = replace(PAPER.reactor, radius=0.4)
    truth = ground_truth(replace(PAPER, reactor=small))
    assert len(truth.types) < 441
    inside = {(c, r) for c, r in product(range(-10, 11), repeat=2)
              if ((abs(c) + 0.5) ** 2 + (abs(r) + 0.5) ** 2) * 0.03**2 <= 0.4**2}
    assert set(truth.types) == inside


def test_the_sites_are_those_of_the_seeds_turned_lattice():
    scene = parse('[tiles]\nset = "chessboard"\n[reactor]\nshape = "circle"\nradius = 0.3\n'
                  '[seed]\nshape = "L"\narm = 10\ncentre = [-0.1, -0.1]\nangle = 0.3\n')

    def fits(column, row):
        return all(abs(-0.1 - 0.1j + 0.03 * cmath.exp(0.3j) * complex(column + a, row + b)) <= 0.3
                   for a, b in product((-0.5, 0.5), repeat=2))

    grown = {(c, r) for c, r, _ in scene.seed.cells}
    while new := {(c, r) for c, r in product(range(1, 11), repeat=2)
                  if {(c - 1, r), (c, r - 1)} <= grown and fits(c, r)} - grown:
        grown |= new
    assert len(grown) < 121
    assert set(ground_truth(scene).types) == grown


def test_without_a_reactor_growth_ends_where_a_chain_of_all_tiles_would():
    column = tile("column", 1, 0, -1, 0)
    scene = parse({"tiles": {"type": [{"name": "column", "glues": list(column.glues),
                                       "colour": "red"}]},
                   "temperature": 1,
                   "seed": {"shape": "cells", "cells": [[0, 0, "column"]]},
                   "free": {"tile": [{"type": "column", "position": [1, k]} for k in range(3)]}})
    assert set(ground_truth(scene).types) == {(0, row) for row in range(-3, 4)}  # three free tiles


def test_without_a_seed_nothing_grows():
    assert ground_truth(replace(PAPER, seed=None)) == Growth({})


def test_at_temperature_two_a_single_bond_is_not_enough():
    lone = [(0, 0, "black")]
    assert len(grow(CHESSBOARD, lone, everywhere, 2).types) == 1
    assert len(grow(CHESSBOARD, lone, {(0, 0), (1, 0), (1, 1)}, 1).types) == 3


def xor_set():
    """Sierpinski's triangle (Winfree 1998): a tile hands on the exclusive or of S and W."""
    rules = [tile(f"{s}{w}", 1 + (s ^ w), 3 + (s ^ w), -1 - s, -3 - w)
             for s, w in product((0, 1), repeat=2)]
    return [*rules, tile("east", 2, 9, 0, -9), tile("north", 9, 4, -9, 0),
            tile("corner", 9, 9, 0, 0)]


def xor_seed(n):
    return ([(0, 0, "corner")] + [(k, 0, "east") for k in range(1, n + 1)]
            + [(0, k, "north") for k in range(1, n + 1)])


def test_the_exclusive_or_set_grows_pascals_triangle_modulo_two_and_is_directed():
    n = 15
    types = xor_set()
    growth = grow(types, xor_seed(n), set(product(range(n + 1), repeat=2)))
    value = {(c, r): 1 for c, r in product(range(n + 1), repeat=2) if c * r == 0}
    for c, r in product(range(1, n + 1), repeat=2):
        value[c, r] = value[c - 1, r] ^ value[c, r - 1]
        assert types[growth.types[c, r]].name == f"{value[c, r - 1]}{value[c - 1, r]}"
    assert growth.directed


def test_two_types_with_the_same_glues_and_another_colour_are_not_directed():
    grey = replace(CHESSBOARD[0], name="grey", colour="grey")
    growth = grow((*CHESSBOARD, grey), [(0, 0, "black"), (1, 0, "white"), (0, 1, "white")],
                  {(1, 1)})
    assert growth.types[1, 1] == 0
    assert not growth.directed
    assert growth.conflict.site == (1, 1)
    assert growth.conflict.types == (0, 2)


def test_a_site_reached_from_two_sides_by_different_types_is_not_directed():
    # "a" comes from the west, "b" from the east; whoever is first keeps the middle.
    types = [tile("west", 0, 1, 0, 0), tile("east", 0, 0, 0, 2), tile("a", 0, 0, 0, -1),
             tile("b", 0, -2, 0, 0)]
    growth = grow(types, [(-1, 0, "west"), (1, 0, "east")], {(0, 0)}, 1)
    assert growth.conflict.site == (0, 0)
    assert growth.conflict.types == (2, 3)


def test_a_type_that_would_fit_only_neighbours_that_came_later_is_no_conflict():
    # row 0 grows eastwards from the seed; "back" fits the east side of "next" only once
    # "next" is there, and "next" needs "first".
    types = [tile("seed", 0, 1, 0, 0), tile("first", 0, 2, 0, -1), tile("next", 0, 0, 0, -2),
             tile("back", 0, 2, 0, 7)]
    growth = grow(types, [(0, 0, "seed")], {(1, 0), (2, 0)}, 1)
    assert growth.types == {(0, 0): 0, (1, 0): 1, (2, 0): 2}
    assert strength(types, growth.types, (1, 0), 3) == 1
    assert growth.directed


def all_ends(types, seed, sites, temperature):
    """Reference: every assembly in which some order of attachments can end."""
    open_ends, seen, ends = [seed], {frozenset(seed.items())}, set()
    while open_ends:
        assembly = open_ends.pop()
        more = [(site, i) for site in sites if site not in assembly for i in range(len(types))
                if strength(types, assembly, site, i) >= temperature]
        if not more:
            ends.add(frozenset(assembly.items()))
        for site, i in more:
            larger = {**assembly, site: i}
            key = frozenset(larger.items())
            if key not in seen:
                seen.add(key)
                open_ends.append(larger)
    return ends


few = st.sampled_from([1, 2]).flatmap(
    lambda most: st.lists(st.tuples(*[st.integers(-most, most)] * 4), min_size=2, max_size=4))


@given(few, st.sampled_from([1, 1, 2]), st.integers(1, 3))
@settings(deadline=None, max_examples=150)
def test_directed_means_that_every_order_of_attachments_ends_alike(sets, temperature, columns):
    types = [tile(str(i), *g) for i, g in enumerate(sets)]
    sites = set(product(range(columns), range(2)))
    seed = [(0, 0, "0"), (columns - 1, 1, "1")]
    growth = grow(types, seed, sites, temperature)
    ends = all_ends(types, {(c, r): int(name) for c, r, name in seed}, sites, temperature)
    assert frozenset(growth.types.items()) in ends
    assert growth.directed == (len(ends) == 1)
    if not growth.directed:
        kinds = {dict(end).get(growth.conflict.site) for end in ends}
        assert set(growth.conflict.types) <= kinds
        assert len(growth.conflict.types) >= 2


def test_types_that_differ_in_family_or_forward_edge_alone_are_one_pattern():
    back = replace(CHESSBOARD[0], name="back", family=-1, forward="S")
    seed = [(0, 0, "black"), (1, 0, "white"), (0, 1, "white")]
    growth = grow((*CHESSBOARD, back), seed, {(1, 1)})
    assert growth.directed
    assert growth.types[1, 1] == 0
    wrong = check((*CHESSBOARD, back), growth)
    assert [(trap.wanted, trap.offered) for trap in wrong] == [
        (trap.wanted, trap.offered) for trap in check(CHESSBOARD, growth)]


def test_tiles_that_compute_grow_in_a_moment_and_are_known_to_be_directed():
    """Nearly every site could take another type, if its neighbours could be there without it."""
    n = 60
    start = time.perf_counter()
    growth = grow(xor_set(), xor_seed(n), set(product(range(n + 1), repeat=2)))
    assert time.perf_counter() - start < 5.0  # a growth for each site takes 18 s
    assert len(growth.types) == (n + 1) ** 2
    assert growth.directed


def took(work):
    """The least time (s) of three."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def test_what_computes_takes_time_in_proportion_to_its_sites():
    """With a set of sites for each site in doubt, a site took four times as long among so many."""
    def a_site(n):
        where = set(product(range(n + 1), repeat=2))
        growth = grow(xor_set(), xor_seed(n), where)
        assert len(growth.types) == len(where)
        assert growth.directed
        return took(lambda: grow(xor_set(), xor_seed(n), where)) / len(where)

    assert a_site(180) < 2.5 * a_site(45)


def test_hundreds_of_types_are_not_all_tried_at_each_site():
    """800 that bind nowhere took more than a hundred times as long as the seven that do."""
    n = 24
    where = set(product(range(n + 1), repeat=2))
    others = [tile(f"{k}-{rule.name}", *(glue + (10 * k if glue > 0 else -10 * k)
                                         for glue in rule.glues))
              for k in range(1, 200) for rule in xor_set()[:4]]
    growths = {}

    def traps(types):
        growths[len(types)] = grow(types, xor_seed(n), where)
        return check(types, growths[len(types)])

    few, many = xor_set(), (*others, *xor_set())
    assert traps(many) == traps(few)
    assert growths[len(many)].directed
    assert len(growths[len(many)].types) == len(where)
    assert took(lambda: traps(many)) < 30 * took(lambda: traps(few))


def test_traps_of_a_type_a_site_take_time_in_proportion_to_what_matches():
    """All types were tried in all turns at every site: 97 times as long for thrice the side."""

    def addressed(n):
        """Tiles of which each has one place, in a square with n sites a side."""
        def glue(c, r, odd):
            return 2 * (n * c + r) + odd if c >= 0 <= r else 0

        types = [tile(f"{c} {r}", glue(c, r, 1), glue(c, r, 2), -glue(c, r - 1, 1),
                      -glue(c - 1, r, 2)) for c, r in product(range(n), repeat=2)]
        where = set(product(range(n), repeat=2))
        return types, grow(types, [(c, r, f"{c} {r}") for c, r in where if 0 in (c, r)], where)

    small, large = addressed(8), addressed(24)
    assert len(large[1].types) == 24 * 24
    assert large[1].directed
    assert check(*large) == []
    assert took(lambda: check(*large)) < 45 * took(lambda: check(*small))


def test_a_hundred_by_a_hundred_sites_grow_in_a_moment():
    seed = [(k, 0, CHESSBOARD[k % 2].name) for k in range(100)]
    seed += [(0, k, CHESSBOARD[k % 2].name) for k in range(1, 100)]
    start = time.perf_counter()
    growth = grow(CHESSBOARD, seed, lambda site: True)
    assert time.perf_counter() - start < 5.0  # a rescan after every tile takes minutes
    assert set(growth.types) == set(product(range(100), repeat=2))
    assert growth.directed


# --- traps -------------------------------------------------------------------------------------


def test_the_first_chessboard_set_has_no_partial_match_at_all():
    assert check(CHESSBOARD, ground_truth(PAPER)) == []


def test_the_second_set_holds_the_right_colour_turned_by_a_quarter_at_two_opposite_edges():
    found = check(ORIENTED, ground_truth(replace(PAPER, types=ORIENTED)))
    inner = [row for row in found if row.matches + row.mismatches == 4]
    assert {(row.wanted, row.offered, row.turns) for row in inner} == {
        ("black", "black", 1), ("black", "black", 3), ("white", "white", 1), ("white", "white", 3)}
    assert all((row.matches, row.arrangement) == (2, "opposite") for row in inner)
    assert sum(row.sites for row in inner) == 2 * 4 * 9 * 9
    assert {row.arrangement for row in found} == {"opposite", "single"}


def test_a_wrong_type_at_two_adjacent_edges_comes_first_in_the_list():
    other = tile("other", 5, 5, 1, 2)  # the black tile's S and W glues, and no use else
    found = check((*CHESSBOARD, other), grow(CHESSBOARD, PAPER.seed.cells, everywhere))
    first = found[0]
    assert (first.wanted, first.offered, first.turns) == ("black", "other", 0)
    assert (first.matches, first.arrangement) == (2, "adjacent")
    assert first.mismatches <= found[1].mismatches


def test_a_type_that_can_stand_in_for_another_matches_at_all_four():
    grey = replace(CHESSBOARD[0], name="grey", colour="grey")
    growth = grow(CHESSBOARD, PAPER.seed.cells, everywhere)
    found = check((*CHESSBOARD, grey), growth)
    assert (found[0].wanted, found[0].offered, found[0].matches, found[0].arrangement) == (
        "black", "grey", 4, "all four")
    assert found[0].mismatches == 0


def test_an_edge_without_a_magnet_is_no_mismatch():
    types = [tile("a", 1, 1, -1, -1), tile("b", 0, 0, -1, 0)]
    growth = grow(types[:1], [(0, 0, "a"), (1, 0, "a"), (0, 1, "a")], {(1, 1)})
    rows = [row for row in check(types, growth) if row.offered == "b"]
    assert [(row.turns, row.matches, row.mismatches) for row in rows] == [(0, 1, 0), (3, 1, 0)]


@given(st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=20)
def test_the_order_of_the_seed_makes_no_difference(shuffler: random.Random):
    cells = list(PAPER.seed.cells)
    shuffler.shuffle(cells)
    assert grow(CHESSBOARD, cells, everywhere) == ground_truth(PAPER)
