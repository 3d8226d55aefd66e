"""The kernels: pair lists, magnets, symmetries, bitwise promises, and how they are compiled."""

from __future__ import annotations

import cmath
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from llvmlite.binding import Linkage
from numba.core.errors import TypingError
from scenes import (
    CHESSBOARD,
    INERTIA,
    MASS,
    SLIDING,
    WIDTH,
    cloud,
    material,
    moving_rows,
    scene,
    simulate,
    state,
    tile,
    turned,
)
from twins import all_magnet_forces, near_pairs, separations

import tbsa
from tbsa.errors import InputError
from tbsa.kernels import advance as core
from tbsa.kernels import jit
from tbsa.kernels.arrays import copy, lean, set_all, whole
from tbsa.kernels.bodies import Numbers, empty_bodies
from tbsa.kernels.contacts import look, out_of_reach, place_block
from tbsa.kernels.crew import empty_crew
from tbsa.kernels.geometry import BLUNT, CIRCLE, RECTANGLE
from tbsa.kernels.jit import kernel
from tbsa.kernels.neighbours import build_pairs, empty_pairs, list_again, near_place, stale
from tbsa.kernels.queue import empty_queue, put, take
from tbsa.kernels.rows import (
    BLOCK,
    BODIES,
    COUNT,
    FAR,
    HIT,
    ID0,
    IDLE,
    LANES,
    LONE_ROWS,
    MA,
    MB,
    NEAR_COLOURS,
    WIDE,
    add_rows,
    colour_rows,
    empty_impulses,
    empty_rows,
    find_rows,
    recall,
)
from tbsa.kernels.state import MORE_MAGNETS, MORE_PAIRS, MORE_ROWS
from tbsa.model.layout import Layout
from tbsa.model.records import OF_PROCESS
from tbsa.model.scene import Drive, Floor, Free, Magnet, Material, Reactor, Run, Seed, TileType
from tbsa.model.simulation import Simulation, SimulationError
from tbsa.model.tiles import mirrored
from tests.benchmarks.invariants import beyond_wall
from theory import magnets

PACKAGE = Path(tbsa.__file__).parent
DEFAULT = {"substeps": 4, "tolerance": 3e-4, "passes": 2}  # the paper runs'


# Pair lists.


def listed(x, y, mobile, reach, margin, capacity=4096):
    """The pairs in the kernel's order, and the number it reports."""
    n = len(x)
    pairs = empty_pairs(n, capacity)
    found = build_pairs(pairs, n, np.array(x, float), np.array(y, float),
                        np.array(mobile, float), reach, np.broadcast_to(margin, n).copy(),
                        empty_crew(1))
    if found < 0 or found > capacity:
        return None, found, pairs
    return [(a, int(b)) for a in range(n)
            for b in pairs.other[pairs.start[a] : pairs.start[a + 1]]], found, pairs


PLACES = {
    "spread": lambda rng, n: rng.uniform(-0.3, 0.3, (2, n)),
    "clustered": lambda rng, n: rng.choice([-0.2, 0.0, 0.25], (2, n)) + rng.normal(0, 0.02, (2, n)),
    "a long row": lambda rng, n: np.array([np.sort(rng.uniform(0, 3, n)), np.full(n, 0.1)]),
    "far apart": lambda rng, n: rng.uniform(-1e4, 1e4, (2, n)),
    "two far clusters": lambda rng, n: rng.normal(0, 0.03, (2, n)) + np.where(
        rng.random(n) < 0.5, 0.0, 5e3),
    "a stray": lambda rng, n: rng.normal(0, 0.1, (2, n)) + (np.arange(n) == 0) * 1e12,
    "one place": lambda rng, n: np.full((2, n), 0.4),
    "on the edges of cells": lambda rng, n: rng.integers(-6, 7, (2, n)) * 0.03125,
}


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(sorted(PLACES)), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_the_pair_list_is_every_near_pair_in_order(places, n, seed):
    """Against the comparison of all pairs; every tile has a margin, held pairs are left out."""
    rng = np.random.default_rng(seed)
    x, y = PLACES[places](rng, n)
    mobile = rng.random(n) < 0.7
    margin = rng.choice([0.0, 0.005, 0.03], n)
    found, number, pairs = listed(x, y, mobile, 0.05, margin)
    assert found == near_pairs(x, y, mobile, 0.05, margin)
    assert number == len(found)
    assert (pairs.margin == margin).all()
    assert (pairs.x == x).all()


@kernel
def listed_again(pairs, n, x, y, mobile, reach, margin, far):
    pairs = lean(pairs)
    late = stale(pairs, n, lean(x), lean(y), lean(far))
    return late, list_again(pairs, n, lean(x), lean(y), lean(mobile), reach, lean(margin))


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(sorted(PLACES)), st.integers(2, 60), st.integers(0, 2**32 - 1))
def test_what_has_come_too_far_is_listed_again_beside_the_others(places, n, seed):
    """By turns some tiles leave their margins, a little or for quite another place, and get new
    ones: the list has every pair that is near where its tiles count from, in order, and once."""
    rng = np.random.default_rng(seed)
    x, y = PLACES[places](rng, n)
    mobile = (rng.random(n) < 0.7).astype(float)
    margin, reach = rng.choice([0.01, 0.03], n), 0.05
    _, _, pairs = listed(x, y, mobile, reach, margin)
    fromx, fromy = x.copy(), y.copy()
    for _ in range(4):
        moved = rng.random(n) < 0.2
        x[moved] += rng.normal(0.0, 0.1, moved.sum())
        y[moved] += rng.normal(0.0, 0.1, moved.sum())
        if rng.random() < 0.3:
            x[moved], y[moved] = rng.choice(fromx), rng.choice(fromy)
        need, new = rng.choice([0.0, 0.005], n), rng.choice([0.01, 0.03, 0.1], n)
        late = np.hypot(x - fromx, y - fromy) > margin - need
        fromx[late], fromy[late], margin[late] = x[late], y[late], new[late]
        number, found = listed_again(pairs, n, x, y, mobile, reach, new, need)
        assert number == late.sum()
        pairs_of = [(a, int(b)) for a in range(n)
                    for b in pairs.other[pairs.start[a] : pairs.start[a + 1]]]
        assert found == len(pairs_of) == pairs.start[n]
        assert pairs_of == sorted(set(pairs_of))
        assert set(near_pairs(fromx, fromy, mobile, reach, margin)) <= set(pairs_of)
        assert all(a < b and mobile[a] + mobile[b] > 0.0 for a, b in pairs_of)
        assert (pairs.margin == margin).all()


def test_what_is_listed_again_needs_space_and_a_place():
    x, y, mobile = np.arange(40) * 0.1, np.zeros(40), np.ones(40)
    room = np.full(40, 0.005)
    for capacity, place, enough in ((4, 0.25, True), (3, 0.25, False), (4, np.nan, False)):
        _, _, pairs = listed(x, y, mobile, 0.06, 0.0, capacity=capacity)
        now = x.copy()
        now[30] = place
        late, found = listed_again(pairs, 40, now, y, mobile, 0.06, room, np.zeros(40))
        assert late == 1
        assert found == (2 if enough else -1)  # with tiles 2 and 3


@pytest.mark.parametrize("far", [0.0, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("lost", [1, 1000])
def test_cells_are_not_crowded_as_some_tiles_are_far_away(lost, far):
    """Else all tiles near each other were compared with all, eight times as long with 3000."""
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0.0, 2.0, (2, 2000))
    x[:lost] += far
    found, _, pairs = listed(x, y, np.ones(2000), 0.05, 0.01, capacity=40000)
    cells = pairs.cells[0] * pairs.cells[1]
    assert np.diff(pairs.first[: cells + 1]).max() < 30
    assert pairs.first[cells] == 2000
    apart = np.hypot(x[:, None] - x, y[:, None] - y) < 0.07
    assert [list(pair) for pair in found] == np.argwhere(np.triu(apart, 1)).tolist()
    near = np.empty(2000, np.int64)
    for i in rng.integers(0, 2000, 20):
        m = near_tiles(pairs, x[i], y[i], 0.07, near)
        assert set(np.flatnonzero(apart[i])) <= set(near[:m])
        assert len(set(near[:m])) == m


@kernel
def near_tiles(pairs, x, y, far, found):
    return near_place(lean(pairs), x, y, far, lean(found))


def test_what_damping_leaves_of_velocities_is_nothing_in_the_end():
    """Not the smallest numbers there are, for which processors take ten times as long."""
    s = Simulation(scene([tile(vx=1e-140, vy=1.0, spin=-1e-148)], step=0.1,
                         body=material(linear_damping=5.0, angular_damping=5.0),
                         drive=Drive("constant", (0.0, 0.01))))
    s.advance(100)  # by e^-50
    assert s.vy[0] > 0.0
    assert s.vx[0] == 0.0
    assert s.omega[0] == 0.0


def test_a_pair_list_that_does_not_fit_says_how_much_it_needs_and_is_not_used():
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, 0.05, (2, 30))
    _, number, pairs = listed(x, y, np.ones(30), 0.05, 0.01, capacity=16)
    assert number == len(near_pairs(x, y, np.ones(30), 0.05, np.full(30, 0.01))) > 16
    assert (pairs.margin == -1.0).all()  # never built


def test_a_pair_list_is_whole_or_does_not_fit_however_much_space_it_has():
    """Exactly as much as it needs, too: candidates beyond the last pair are not kept."""
    rng, full = np.random.default_rng(5), 0
    x, y = rng.uniform(0, 0.3, (2, 30))
    pairs = near_pairs(x, y, np.ones(30), 0.05, np.full(30, 0.01))
    for capacity in range(1, len(pairs) + 3):
        found, number, _ = listed(x, y, np.ones(30), 0.05, 0.01, capacity)
        assert found == (pairs if number <= capacity else None)
        full += found is not None
    assert full > 0


# Rows.


@jit.kernel
def find_then_add(rows, pairs, k, x, y, angle, c, s, mobile, marked, way, far, way2, far2, widest,
                  crew):
    """Rows of the ways `way` and `far`; then those that the marked tiles have besides, whose ways
    are longer.  Returns how many of each."""
    crew = lean(crew)
    m, _, _ = find_rows(rows, pairs, k, x, y, c, s, mobile, way, far, 1, crew)
    colour_rows(rows, m, k, mobile, crew)
    recall(rows, k.n, NO_IMPULSES, 0, m)
    return m, add_rows(rows, pairs, k, x, y, angle, c, s, mobile, marked, way2, far2, widest)


def numbers(n, wall=0, size=0.0):
    """Of n tiles of 1 kg, and a wall."""
    inertia = WIDTH**2 / 6.0
    return Numbers(n, 0, WIDTH, 1e-3, 1, 1.0, inertia, 1.0, 1.0 / inertia, 1.0 / inertia, 0.0, 0.0,
                   0.5, 0.5, 0.5, 0.5, 0.01, 1e-3, 1.0, 1, 1, 1, 1, 1, 0, wall, size, size)


NO_IMPULSES, ALONE_CREW = empty_impulses(1), empty_crew(1)


def may_touch(x, y, angle, mobile, wall, size, way, far):
    """The rows that there should be, by comparing all tiles: (a, b, corner); for pairs whether they
    are kept with the far ones."""
    found, n = set(), len(x)
    for a, b in itertools.combinations(range(n), 2):
        apart = separations(complex(x[a], y[a]), angle[a], complex(x[b], y[b]), angle[b], WIDTH)
        gap, face = max(apart), apart.index(max(apart))
        aside = max(apart[4 * (face // 4) + (face + turn) % 4] for turn in (1, 3))
        if ((mobile[a] or mobile[b]) and gap <= far[a] + far[b]
                and math.hypot(x[b] - x[a], y[b] - y[a]) <= 1.41422 * WIDTH + way[a] + way[b]):
            found.add((a, b, int(gap > FAR * WIDTH or aside > -BLUNT * WIDTH)))
    for a in np.flatnonzero(mobile) if wall else ():
        out = math.hypot(x[a], y[a]) if wall == CIRCLE else max(abs(x[a]), abs(y[a]))
        if out + 0.70711 * WIDTH + way[a] < size:
            continue
        corners = [x[a] + 1j * y[a] + cmath.rect(math.sqrt(0.5) * WIDTH,
                                                 angle[a] + (2 * q + 1) * math.pi / 4)
                   for q in range(4)]
        gaps = ([size - abs(corner) for corner in corners] if wall == CIRCLE else
                [size - max((corner / outwards).real for corner in corners)
                 for outwards in (-1, -1j, 1, 1j)])  # its west, south, east and north side
        found |= {(int(a), n, code) for code, gap in enumerate(gaps) if gap <= far[a]}
    return found


@settings(deadline=None, max_examples=150)
@given(st.sampled_from([0, CIRCLE, RECTANGLE]), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_rows_that_are_added_within_a_step_are_those_that_a_new_search_finds(wall, n, seed):
    """Whatever the age of the pair list; and every row is in its place, once, and in order."""
    rng = np.random.default_rng(seed)
    size = 0.2
    old_x, old_y = rng.uniform(-0.15, 0.15, (2, n))
    x, y = old_x + rng.uniform(-0.02, 0.02, n), old_y + rng.uniform(-0.02, 0.02, n)
    angle, mobile = rng.uniform(0, 2 * math.pi, n), np.append(rng.random(n) < 0.7, False) * 1.0
    way = rng.uniform(0.0, 0.01, n)
    far = way + rng.uniform(0.0, 0.01, n)
    marked = np.append((rng.random(n) < 0.3) & (mobile[:n] > 0.0), False).astype(np.int64)
    longer = np.where(marked[:n] > 0, rng.uniform(0.0, 0.08, n), 0.0)
    pairs, rows = empty_pairs(n, 4096), empty_rows(n, 4096)
    build_pairs(pairs, n, old_x, old_y, mobile, 0.0425, np.full(n, 0.04), ALONE_CREW)
    widest = float((np.hypot(x - old_x, y - old_y) + way + longer).max())
    c, s = np.append(np.cos(angle), 1.0), np.append(np.sin(angle), 0.0)
    m, added = find_then_add(rows, pairs, numbers(n, wall, size), x, y, angle, c, s, mobile, marked,
                             way, far, way + longer, far + longer, widest, ALONE_CREW)

    before = may_touch(x, y, angle, mobile[:n], wall, size, way, far)
    after = may_touch(x, y, angle, mobile[:n], wall, size, way + longer, far + longer)
    found = list(zip(*(part[: m + added].tolist() for part in (rows.a, rows.b, rows.corner)),
                     strict=True))
    assert m == len(before)
    assert found == sorted(after)
    assert rows.size[0] == m + added
    assert np.diff(rows.first)[LONE_ROWS] == added
    of = {i: [] for i in range(n)}
    for (a, b, corner), slot in zip(found, rows.slot.tolist(), strict=False):
        block, lane = divmod(slot, int(BLOCK))
        assert rows.body[block * int(BODIES) + lane] == a
        assert rows.body[block * int(BODIES) + int(LANES) + lane] == b
        assert rows.field[slot + int(ID0)] == (2.0 * corner if b == n else -2.0)
        for i in (a, b):
            if mobile[i] > 0.0:
                of[i].append(WIDE * block + lane)
    for i in range(n):
        assert rows.of[rows.start[i] : rows.start[i + 1]].tolist() == of[i]


def test_blocks_in_which_nothing_touches_are_left_out_until_something_does():
    """Both pairs are far ones when the step begins; one of them hits in the middle of it."""
    gap = 2.0 * FAR * WIDTH
    apart, hit = (simulate([tile(0, 0, vx=speed), tile(WIDTH + gap, 0)], step=1 / 120, substeps=12,
                           body=material(restitution=0.5)) for speed in (0.0, 0.3))
    for s in (apart, hit):
        s.advance(1)
        assert s._work.rows.size[0] == 1
    assert apart._work.rows.single[0] == IDLE
    assert hit._work.rows.single[0] != IDLE
    assert hit.state.vx[:2] == pytest.approx([0.075, 0.225], rel=1e-12)


def test_corners_that_pass_each_other_are_left_out_until_one_comes_over_the_other():
    """What slides from beside a held tile onto its top, pressed down, tips over its corner; the two
    are kept with the far pairs when the step begins."""
    fallen = 0.5 * 0.01 / MASS / 120**2
    for speed, carried in ((0.0, False), (-0.3, True)):
        s = simulate([tile(held=True), tile(WIDTH, WIDTH, vx=speed)], step=1 / 120, substeps=12,
                     body=material(friction=0.0), drive=Drive("constant", force=(0.0, -0.01)))
        s.advance(1)
        assert s._work.rows.corner[0] == 1
        assert (s._work.rows.single[0] == IDLE) != carried
        turn = s.angle[1]  # of the held tile's corner, as seen from the other one
        height = (0.5 * WIDTH - s.y[1]) * math.cos(turn) - (0.5 * WIDTH - s.x[1]) * math.sin(turn)
        inside = (0.5 * WIDTH + height) / fallen
        assert inside == pytest.approx(0.0 if carried else 1.0, abs=0.02)


@jit.kernel
def reach_and_place(rows, k, gain, x, y, c, s, v):
    """Whether the pairs of the first block are out of reach; and places them."""
    rows, v = lean(rows), lean(v)
    look(rows, 0, x, y, c, s, v.vx, v.vy, v.w)
    apart = out_of_reach(rows, 0, k.width, k.h, gain)
    place_block(rows, 0, k, gain, x, y, c, s, v)
    return apart


def test_pairs_that_are_out_of_reach_neither_touch_nor_may_hit():
    """Of two tiles about as far apart as matters, at any angle or corner to corner, and fast or
    slow; and most of those that do neither are found to be out of reach."""
    rng, rows, v, k = np.random.default_rng(11), empty_rows(2, 16), empty_bodies(2), numbers(2)
    rows.body[:] = 2
    rows.body[0], rows.body[int(LANES)] = 0, 1
    rows.field[int(MA)] = rows.field[int(MB)] = 1.0
    touch = free = left_out = 0
    for _ in range(6000):
        fast = 10.0 ** rng.uniform(-4, 2)
        v.vx[:2], v.vy[:2], v.w[:2] = fast * 0.03 * rng.normal(size=(3, 2)) * [[1], [1], [50]]
        corners = rng.random() < 0.5
        angle = np.append(rng.normal(0.0, 1e-3 if corners else 2.0, 2), 0.0)
        place = (complex(*(WIDTH * (1 + rng.normal(0, 2e-3, 2)))) if corners
                 else WIDTH * rng.uniform(0.9, 1.6) * np.exp(1j * rng.uniform(0, 7)))
        x, y = np.array([0, place.real, 0]), np.array([0, place.imag, 0])
        apart = reach_and_place(rows, k, 10.0 ** rng.uniform(-7, -3), x, y, np.cos(angle),
                                np.sin(angle), v)
        open_ = rows.field[int(COUNT)] == 0.0 and rows.field[int(HIT)] == 0.0
        assert open_ or not apart
        touch, free, left_out = touch + (not open_), free + open_, left_out + apart
    assert touch > 1000
    assert left_out > 0.8 * free > 1000


def test_where_all_pairs_have_rows_an_impact_is_the_same_as_beside_a_tile_far_away():
    """Nobody looks for what else it may hit."""
    pair = [tile(0, 0, vx=0.4, spin=20.0), tile(1.3 * WIDTH, 0.4 * WIDTH, 0.3, spin=-30.0)]
    alone, beside = (simulate([*pair, *more], step=1 / 60, substeps=4,
                              body=material(restitution=0.5, friction=0.3))
                     for more in ([], [tile(10.0, held=True)]))
    for s in (alone, beside):
        s.advance(12)
    assert alone.counts.impacts[0] > 0
    assert alone.counts.surprises[0] == 0 < beside.counts.surprises[0]
    for name in ("x", "y", "angle", "vx", "vy", "omega"):
        assert (getattr(alone, name)[:2] == getattr(beside, name)[:2]).all()


def test_rows_that_do_not_fit_are_not_added():
    pairs, rows, n = empty_pairs(30, 4096), empty_rows(30, 40), 30
    x, y, zero = np.repeat(np.arange(6) * 0.031, 5), np.tile(np.arange(5) * 0.031, 6), np.zeros(30)
    build_pairs(pairs, n, x, y, np.ones(n + 1), 0.0425, np.full(n, 0.04), ALONE_CREW)
    marked, c, s = np.ones(n + 1, np.int64), np.ones(n + 1), np.zeros(n + 1)
    assert find_then_add(rows, pairs, numbers(n), x, y, zero, c, s, np.ones(n + 1), marked, zero,
                         zero, zero + 0.2, zero + 0.2, 0.2, ALONE_CREW) == (0, -1)
    assert rows.size[0] == 0
    assert np.diff(rows.first)[LONE_ROWS] == 0


def test_a_tile_that_may_touch_more_others_than_there_are_colours_is_carried_by_what_it_touches():
    """It slides fast along the top of a held block, whose lower tiles come first."""
    block = [tile(WIDTH * i, -WIDTH * j, held=True) for j in range(6, -1, -1)
             for i in range(-12, 13)]
    s = simulate([*block, tile(-0.15, WIDTH, vx=5.0)], step=1 / 30, substeps=32,
                 body=material(friction=0.0), drive=Drive("constant", force=(0.0, -0.5)))
    s.advance(1)
    forces = s.contact_forces()
    assert s._work.rows.size[0] > 2 * NEAR_COLOURS
    assert forces["normal0"].sum() + forces["normal1"].sum() == pytest.approx(0.5, rel=1e-9)
    assert abs(s.y[-1] - WIDTH) < 1e-9 * WIDTH


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_place_that_is_no_number_is_reported(bad):
    assert listed([0.0, bad], [0.0, 0.0], [1, 1], 0.05, 0.01)[1] == -1
    s = simulate([tile(), tile(0.1)])
    s.x[1] = bad
    with pytest.raises(SimulationError, match="finite"):
        s.advance(1)


def grid():
    """64 tiles of which every pair is within the magnets' reach; their list starts too small."""
    return scene([tile(0.045 * i, 0.045 * j, 0.3 * i - 0.2 * j, kind="black" if (i + j) % 2 else
                       "white") for i in range(8) for j in range(8)],
                 types=CHESSBOARD, magnet=Magnet(cutoff=0.5), body=Material(), **DEFAULT)


def spacious(scene):
    """A simulation with space for all that the scene may need, from the beginning."""
    s = Simulation(scene)
    for what in (MORE_PAIRS, MORE_ROWS, MORE_MAGNETS) * 3:
        s._grow(what)
    return s


def test_lists_that_grow_in_a_run_make_no_difference():
    small, large = Simulation(grid()), spacious(grid())
    before = small._work
    for s in (small, large):
        s.advance(3)
    assert before.pairs.room < 64 * 63 // 2 <= small._work.pairs.room
    assert before.magnets.room < 8 * 64 * 63 < small._work.magnets.room
    assert (state(small) == state(large)).all()
    assert (small.state.impulses.size == large.state.impulses.size).all()


def test_a_list_that_grows_for_the_forces_makes_no_difference():
    s, large = Simulation(grid()), spacious(grid())
    assert (np.array(s.magnet_forces()) == np.array(large.magnet_forces())).all()


# Bits.


def with_solver(scene, **options):
    return replace(scene, solver=replace(scene.solver, **options))


def crowd(seed=3):
    chosen = scene([tile(held=True, kind="black"), tile(WIDTH, 0, held=True, kind="white")],
                   types=CHESSBOARD, magnet=Magnet(), reactor=Reactor("circle", 0.16),
                   floor=Floor(), drive=Drive("unicycle", 0.1, 1e-3, 2.0), body=Material(),
                   **DEFAULT)
    return replace(chosen, free=replace(chosen.free, counts=(("black", 14), ("white", 14))),
                   run=replace(chosen.run, seed=seed))


def test_the_same_scene_gives_the_same_bits_however_it_is_cut_into_calls():
    whole, cut = Simulation(crowd()), Simulation(crowd())
    whole.advance(600)
    done, rng = 0, np.random.default_rng(1)
    while done < 600:
        part = min(int(rng.integers(1, 40)), 600 - done)
        cut.advance(part)
        done += part
    assert whole.counts.impacts[0] > 100
    assert (state(whole) == state(cut)).all()
    for a, b in zip(whole.state.impulses, cut.state.impulses, strict=True):
        assert (a[: int(whole.state.impulses.size[0])] == b[: int(whole.state.impulses.size[0])]
                ).all()


def field_of_tiles(side, law="separate", wall="rectangle", apart=1.003, **options):
    """A close lattice of so many rows and columns, shaken, whose tiles fly about a little."""
    rng, space = np.random.default_rng(4), apart * WIDTH
    tiles = []
    for i, j in itertools.product(range(side), repeat=2):
        held = (i + 7 * j) % 97 == 0
        motion = [0.0] * 4 if held else rng.normal(0.0, [1e-3, 0.1, 0.1, 1.0])
        tiles.append(tile(*(space * (np.array([i, j]) - 0.5 * (side - 1))), *motion, held=held,
                          kind="black" if (i + j) % 2 else "white"))
    width = space * side + 0.2 * WIDTH
    reactor = (Reactor("rectangle", width=width, height=width) if wall == "rectangle"
               else Reactor("circle", 0.75 * width))
    return scene(tiles, types=CHESSBOARD, magnet=Magnet(), reactor=reactor, floor=Floor(law=law),
                 drive=Drive("shaking", 0.1, 0.0, 2.0), body=Material(), **DEFAULT | options)


@pytest.mark.parametrize("substeps", [4, 12])
def test_what_a_row_is_left_with_by_one_step_is_not_read_in_the_next(substeps):
    """Nor are the weights of blocks in which nothing touches, which nobody works out unless one of
    their rows is hit in the middle of a substep."""
    chosen = field_of_tiles(10, apart=1.04, step=1 / 120, substeps=substeps, tolerance=2e-2,
                            passes=40)
    plain, littered = Simulation(chosen), Simulation(chosen)
    for _ in range(150):
        littered._work.rows.field[:] = -7.7
        for s in (plain, littered):
            s.advance(1)
    assert plain.counts.impacts[0] > 1000
    assert (state(plain) == state(littered)).all()


@pytest.mark.parametrize(("side", "threads", "options"), [
    (56, 2, {}), (56, 3, {"wall": "circle"}), (50, 2, {"law": "coupled"}),
    (50, 2, {"law": "exact"}), (50, 2, {"passes": 20, "at_rest": 0.1}), (7, 2, {"passes": 20}),
    # Overlaps: long lists of what is to be projected.
    pytest.param(50, 3, {"apart": 0.995, "checked": False}, marks=pytest.mark.slow)])
def test_threads_do_not_change_a_bit(side, threads, options):
    """As many tiles as they share, and as few as one of them does alone."""
    chosen = field_of_tiles(side, **options)
    alone, shared = Simulation(chosen), Simulation(chosen, threads=threads)
    for s in (alone, shared):
        s.advance(3)
        s.advance(2)
    assert (shared._work.crew.job[0] > 300) == (side > 40)
    assert alone.counts.impacts[0] > 10
    assert alone.counts.projections[0] > 0 or side < 40
    assert (state(alone) == state(shared)).all()
    for a, b in zip(alone.counts, shared.counts, strict=True):
        assert (a == b).all()
    size = int(alone.state.impulses.size[0])
    assert size > side
    for a, b in zip(alone.state.impulses, shared.state.impulses, strict=True):
        assert (a[:size] == b[:size]).all()


def test_a_first_step_that_lacks_space_is_begun_again_as_it_was():
    """Tiles that fly at each other from nearby, which are looked at before anything moves."""
    close = scene([tile(1.05 * WIDTH * i, vx=3.0 * (-1) ** i) for i in range(40)])
    roomy, narrow = Simulation(close), Simulation(close)
    assert roomy.state.last[1] == 0
    narrow._capacity = dict.fromkeys(narrow._capacity, 8)
    narrow._work = narrow._space()
    for s in (roomy, narrow):
        s.advance(3)
    assert min(narrow._capacity[MORE_PAIRS], narrow._capacity[MORE_ROWS]) > 8
    assert roomy.counts.impacts[0] > 20
    assert (state(roomy) == state(narrow)).all()


def test_threads_whose_lists_outgrow_their_space_change_no_bit_either():
    chosen = field_of_tiles(40)
    alone, shared = Simulation(chosen), Simulation(chosen, threads=2)
    shared._capacity = dict.fromkeys(shared._capacity, 2000)
    shared._work = shared._space()
    for s in (alone, shared):
        s.advance(2)
    assert min(shared._capacity.values()) > 2000
    assert (state(alone) == state(shared)).all()


def test_no_thread_is_left_behind_where_a_run_cannot_go_on():
    before = threading.active_count()
    s = Simulation(field_of_tiles(50), threads=2)
    s.vx[7] = math.nan
    with pytest.raises(SimulationError, match="finite"):
        s.advance(2)
    assert threading.active_count() == before
    for wrong in (0, 1.0, "1", np.int64(0)):
        with pytest.raises(InputError, match="at least 1"):
            Simulation(grid(), threads=wrong)
    assert Simulation(grid(), threads=np.int64(1))._threads == 1


def test_results_do_not_depend_on_when_the_pair_list_was_built():
    rarely, always = Simulation(crowd()), Simulation(crowd())
    rarely.advance(400)
    for _ in range(400):
        always._work.pairs.margin[:] = -1.0
        always.advance(1)
    assert always.counts.lists[0] == 400 > 2 * rarely.counts.lists[0]
    assert (state(rarely) == state(always)).all()


def test_one_fast_tile_does_not_have_the_pairs_of_all_listed_again():
    """It flies past 90 others, 18 widths in a second."""
    still = [tile(0.08 * i, 0.08 * j) for i in range(10) for j in range(9)]
    fast = scene([*still, tile(-0.1, 0.04, vx=0.55)])
    kept, anew = Simulation(fast), Simulation(with_solver(fast, keep_lists=False))
    for s in (kept, anew):
        s.run(1.0)
    assert kept.counts.lists[0] == 1
    assert kept._work.pairs.late[91] == 1
    assert (state(kept) == state(anew)).all()


def test_lists_kept_or_found_every_step_give_the_same_bits():
    kept, anew = Simulation(crowd()), Simulation(with_solver(crowd(), keep_lists=False))
    for s in (kept, anew):
        s.advance(400)
    assert anew.counts.magnet_lists[0] == 400 > 2 * kept.counts.magnet_lists[0]
    assert (state(kept) == state(anew)).all()


def test_lists_outlast_a_call_but_not_that_tiles_are_moved_in_between():
    """Who steps one by one, as a controller in Python does, pays for no list more; nothing of a
    list of other places is used, nor of one that has been made to tell forces."""
    at_once, one_by_one, anew = (Simulation(with_solver(crowd(), keep_lists=keep))
                                 for keep in (True, True, False))
    for s in (at_once, anew):
        s.advance(200)
    for _ in range(200):
        one_by_one.advance(1)
    assert one_by_one.counts.magnet_lists[0] == at_once.counts.magnet_lists[0] < 150
    for _ in range(20):
        for s in (at_once, one_by_one, anew):
            s.x[[2, 9]], s.y[[2, 9]], s.angle[[2, 9]] = s.x[[9, 2]], s.y[[9, 2]], s.angle[[9, 2]]
        one_by_one.magnet_forces()
        for s in (at_once, one_by_one, anew):
            s.advance(1)
        assert (state(one_by_one) == state(at_once)).all()
        assert (state(anew) == state(at_once)).all()


def test_magnets_as_far_from_each_other_as_the_cutoff_do_not_depend_on_the_age_of_lists():
    """A bonded block, whose parallel edges are, to rounding, the cut-off apart, while other tiles
    hit each other and need new lists in the middle of a step; listed anew in each, or not."""
    rng = np.random.default_rng(1)
    for _ in range(40):
        angle = rng.uniform(-3.0, 3.0)
        tiles = [tile(*turned((i - 1) * WIDTH, (j - 0.5) * WIDTH, angle), angle,
                      kind=("black", "white")[(i + j) % 2]) for i in range(3) for j in range(2)]
        tiles += [tile(0.5 + 2 * WIDTH * i, 0.01 * rng.normal(), rng.uniform(-3.0, 3.0),
                       -i * rng.uniform(0.0, 1.5), spin=3.0 * rng.normal(), kind="white")
                  for i in range(3)]
        anew, kept = (
            simulate(tiles, types=CHESSBOARD, body=material(friction=0.3, restitution=0.5),
                     magnet=Magnet(cutoff=WIDTH), step=1 / 240, substeps=4, tolerance=1e-9,
                     passes=200, keep_lists=keep) for keep in (False, True))
        for _ in range(10):
            anew.advance(5)
            kept.advance(5)
            assert (state(anew) == state(kept)).all()


@pytest.mark.parametrize(("switch", "counter", "tolerance"), [
    ("skip_converged", "unsolved", 1e-7), ("join_substeps", "joined", 1e-5)])
def test_what_has_converged_or_is_calm_may_be_left_out(switch, counter, tolerance):
    """Sixteen tiles in a corner, without a floor and without impacts, under a load that turns by 7
    degrees in a second: with every row solved in every pass or not, and with every substep or not,
    places and velocities after a quarter of a second are the same but for what the tolerance
    leaves.

    In half of all such windows velocities differ by less than one tolerance, in three of four by
    less than two.  The others are those in which a tile that begins to slip does so a moment
    earlier or later: there they differ by as much as it slips."""
    def pile(**options):
        tiles = [tile(0.0305 * i, 0.0305 * j, 0.02 * i) for i in range(4) for j in range(4)]
        return Simulation(with_solver(scene(
            tiles, reactor=Reactor("rectangle", width=0.24, height=0.24), substeps=4,
            drive=Drive("shaking", 0.06, 0.0, 0.02), tolerance=tolerance, passes=100,
            body=material(friction=0.25, linear_damping=1.0, angular_damping=1.0,
                          restitution_threshold=1.0)), **options))

    first = {"join_substeps": switch == "join_substeps"}
    left_out, plain = pile(**first), pile(**first | {switch: False})
    left_out.run(6.0)
    ways, velocities = [], []
    for _ in range(72):
        for a, b in zip(plain.state[:7], left_out.state[:7], strict=True):
            a[:] = b
        for a, b in zip(plain.state.impulses, left_out.state.impulses, strict=True):
            a[:] = b
        plain.steps = left_out.steps
        for s in (left_out, plain):
            s.run(0.25)
        gap = np.abs(state(left_out) - state(plain))
        ways.append(gap[:2].max())
        velocities.append(gap[3:5].max())
    assert getattr(left_out.counts, counter)[0] > 480 > 0 == getattr(plain.counts, counter)[0]
    assert np.median(velocities) < tolerance
    assert np.quantile(velocities, 0.75) < 2 * tolerance
    assert np.quantile(ways, 0.75) < 2 * tolerance * 0.25


def at_rest_soon(what, **options):
    """Scenes that come to rest; loads are there, and go on."""
    parts = {"body": Material(), "step": 1 / 120, "substeps": 12, "tolerance": 2e-2, "passes": 80}
    pair = [tile(0.0, held=True, kind="black"), tile(0.0395, 0.001, 0.05, kind="white")]
    if what == "bonded":
        return scene(pair, types=CHESSBOARD, magnet=Magnet(), floor=Floor(),
                     **parts | options)
    if what == "bonded, without floor":  # at rest but for rounding, which moves nothing any more
        return scene(pair, types=CHESSBOARD, magnet=Magnet(), **parts | {"substeps": 8} | options)
    if what == "pressed":
        tiles = [tile(0.0305 * i + 0.001, 0.0303 * j, 0.02 * i) for i in range(3) for j in range(2)]
        return scene(tiles, reactor=Reactor("rectangle", width=0.17, height=0.1), floor=Floor(),
                     drive=Drive("constant", (0.06, -0.05), 2e-4), **parts | options)
    return scene([tile(vx=0.3, spin=9.0), tile(0.2, vy=-0.5)], floor=Floor(law=what),
                 **parts | options)


@pytest.mark.parametrize("what", ["bonded", "bonded, without floor", "pressed", "separate",
                                  "coupled", "exact"])
def test_a_step_that_changes_nothing_is_not_done_again(what):
    """To the bit, wherever a run is cut, and it is counted: the counters of a run, too, do not
    depend on how it is cut."""
    resting, plain, cut = (Simulation(at_rest_soon(what, skip_still=skip))
                           for skip in (True, False, True))
    for s in (resting, plain):
        s.advance(3000)
    for steps in (1, 2, 7, 190, 800, 2000):
        cut.advance(steps)
    for s in (plain, cut):
        for mine, other in zip(resting.state[:7], s.state[:7], strict=True):
            assert mine.tobytes() == other.tobytes()
        size = resting.state.impulses.size[0]
        for mine, other in zip(resting.state.impulses[1:], s.state.impulses[1:], strict=True):
            assert size == s.state.impulses.size[0]
            assert mine[:size].tobytes() == other[:size].tobytes()
        assert s.counts.steps[0] == s.steps == 3000
        for name in set(s.counts._fields) - set(OF_PROCESS):
            assert (getattr(s.counts, name) == getattr(resting.counts, name)).all(), name
    assert resting.counts.still[0] > 2000 > plain.counts.still[0] == 0
    assert 2000 < cut.counts.still[0] < resting.counts.still[0]


def test_what_is_at_rest_under_a_load_that_depends_on_time_is_asked_again(tmp_path):
    """A tile that nothing moves for a second, then a push."""
    (tmp_path / "late.py").write_text("""
def late(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    if t > 1.0:
        fx += p[0]
""")
    push = Drive("user", module="late.py", function="late", parameters=(1.1 * SLIDING,))
    s = simulate([tile(), tile(0.1)], floor=Floor(), step=1 / 120, drive=push,
                 file=str(tmp_path / "scene.toml"))
    s.run(1.0)
    assert not s.vx.any()
    s.run(0.5)
    assert s.vx == pytest.approx([0.5 * 0.1 * SLIDING / MASS] * 2, rel=1e-9)
    assert s.counts.still[0] == 0


@pytest.mark.parametrize(("parts", "rounding"), [
    ({}, 0.0), ({"drive": Drive("shaking", 0.02, 0.0, 1.0)}, 0.0),
    ({"floor": Floor(linear=0.05, angular=0.05)}, 0.0),
    # Solved twice a substep or once, what couples sliding and turning has other rounding.
    ({"floor": Floor(law="coupled", linear=0.05)}, 1e-15)])
def test_what_flies_past_each_other_is_not_solved(parts, rounding):
    """Ten tiles that fly and bounce in a round wall for a quarter of a second, all of them near
    others: most substeps need no solve, and are the same without it."""
    runs = [simulate(cloud(10, 1, 1.0), step=1 / 240, substeps=2, tolerance=1e-5, passes=40,
                     body=material(restitution=0.9, friction=0.2),
                     reactor=Reactor("circle", radius=0.35), skip_converged=skip, **parts)
            for skip in (True, False)]
    for s in runs:
        s.advance(60)
    left_out, plain = (s.counts for s in runs)
    assert np.abs(state(runs[0]) - state(runs[1])).max() <= rounding
    assert left_out.impacts[0] == plain.impacts[0] > 20
    assert left_out.rows[0] == plain.rows[0]
    assert left_out.unsolved[0] > 0.5 * left_out.solves[0] > 0 == plain.unsolved[0]
    assert left_out.passes[0] < 0.4 * plain.passes[0]


@pytest.mark.parametrize(("gap", "speed", "spin", "number"), [
    (1e-4, 0.0, 0.0, 2), (1e-4, 0.06, 0.0, 2), (1e-4, 0.10, 0.0, 4), (1e-4, 0.6, 0.0, 16),
    (0.20, 0.0, 40.0, 2), (0.20, 0.0, 60.0, 4), (0.25, 0.0, 340.0, 16),
    (-0.5e-3, 0.0, 0.0, 2), (-2e-3, 0.0, 0.0, 16)])
def test_substeps_are_joined_where_tiles_are_slow_and_do_not_overlap(gap, speed, spin, number):
    """Two halves of eight substeps of 1/1920 s: all eight as one, where in them no tile goes
    further past another than 1 % of the width and turns no further than 0.2 rad, else fewer.
    Both tiles go, but as they go together that does not count."""
    s = simulate([tile(0, 0, vy=0.3), tile((1.0 + gap) * WIDTH, 0, vy=0.3 + speed, spin=spin)],
                 step=1 / 120, substeps=16, tolerance=1e-5, checked=False)
    s.state.last[:2] = 1, 64  # as if it had been solved before
    s.advance(1)
    assert s.counts.substeps[0] == number
    assert s.counts.joined[0] == 16 - number


def test_substeps_are_joined_only_after_a_quick_solve():
    s = simulate([tile(0, 0), tile(1.0001 * WIDTH, 0)], step=1 / 120, substeps=16, passes=50)
    for passes, number in ((9, 16), (1, 2)):
        s.state.last[:2] = passes, 64
        s.counts.substeps[0] = 0
        s.advance(1)
        assert s.counts.substeps[0] == number

@pytest.mark.parametrize(("promised", "number"), [(64, 2), (16, 3), (8, 3)])
def test_a_substep_is_no_longer_than_the_solve_before_it_foresaw(promised, number):
    s = simulate([tile(0, 0), tile(1.0001 * WIDTH, 0)], step=1 / 120, substeps=16)
    s.state.last[:2] = 1, promised
    s.advance(1)
    assert s.counts.substeps[0] == number
    assert s.state.last[1] == 64


def test_what_flies_at_a_wall_keeps_substeps_short():
    """A tile flies at the wall, wherever it is when substeps are first joined."""
    for k in range(25):
        s = simulate([tile(0.2 + 1e-3 * k, 0.0, math.pi / 4, vx=1.3)], step=1 / 120, substeps=16,
                     reactor=Reactor("circle", 0.26), body=material(restitution=0.2))
        for _ in range(6):
            s.state.last[0] = 1  # its solves are quick; what they have promised stays
            s.advance(1)
        assert s.counts.impacts[0] == 1
        assert s.counts.joined[0] > 0
        assert s.counts.deepest[0] < 1e-4 * WIDTH


@pytest.mark.parametrize(("distance", "spin", "more"), [
    (1.1, 80.0, 1), (1.1, 300.0, 2), (1.1, 700.0, 4), (1.1, 1600.0, 8), (3.0, 3200.0, 1)])
def test_substeps_are_shorter_where_a_tile_that_may_touch_another_spins_fast(distance, spin, more):
    """No such tile turns further than 0.4 rad in one, or an eighth of it; a free one does."""
    s = simulate([tile(0, 0, -spin / 960, spin=spin), tile(distance * WIDTH, 0)],
                 step=1 / 480, substeps=1, checked=False)  # room in the middle of the substep
    s.advance(1)
    assert s.counts.substeps[0] == more


@pytest.mark.parametrize(("hit", "number"), [(0, 2), (3, 1)])
def test_a_substep_after_an_impact_is_as_long_as_was_foreseen(hit, number):
    """What has been hit is where it is to be only at the end of that time; before, on its way back
    through the impact, it may be inside another tile."""
    s = simulate([tile(0, 0, -300 / 960, spin=300.0), tile(1.1 * WIDTH, 0)],
                 step=1 / 480, substeps=1, checked=False)
    s.state.last[:] = 1, 8, hit
    s.advance(1)
    assert s.counts.substeps[0] == number


@pytest.mark.parametrize(("spins", "more"), [
    ((180.0, 0.0), 1), ((180.0, 180.0), 2), ((-120.0, 120.0), 1), ((-150.0, 150.0), 2)])
def test_two_spinning_tiles_count_together(spins, more):
    """By the root of the sum of squares: 192 rad/s turn by 0.4 rad in 1/480 s."""
    s = simulate([tile(0, 0, spin=spins[0]), tile(1.35 * WIDTH, 0, spin=spins[1])],
                 step=1 / 480, substeps=1)
    s.advance(1)
    assert s.counts.impacts[0] == 0
    assert s.counts.substeps[0] == more


def test_shorter_substeps_do_not_depend_on_how_a_run_is_cut():
    def spinning():
        tiles = [tile(1.2 * WIDTH * i, 1.2 * WIDTH * j, 0.1 * i, spin=220.0 * (i - j))
                 for i in range(5) for j in range(5)]
        return simulate(tiles, drive=Drive("unicycle", 0.06, 4e-3, 1.0), body=Material(),
                        reactor=Reactor("circle", 0.25), step=1 / 240, substeps=2)

    whole, cut = spinning(), spinning()
    whole.advance(200)
    for steps in (1, 2, 3, 94, 100):
        cut.advance(steps)
    assert whole.counts.substeps[0] > 1.2 * 400
    assert (state(whole) == state(cut)).all()
    assert whole.counts.substeps[0] == cut.counts.substeps[0]


@pytest.mark.parametrize(("radius", "x", "speed"), [
    (0.0222, 0.0, 0.3), (0.025, 0.002, 0.3), (0.03, 0.004, 0.5), (0.035, 0.004, 0.5)])
def test_joined_substeps_do_not_carry_a_tile_out_of_a_narrow_round_reactor(radius, x, speed):
    """In the middle a tile that flies across the wall's normal flies along it a moment later."""
    s = simulate([tile(x, vy=speed, spin=5.0)], body=material(friction=0.0, restitution=1.0),
                 reactor=Reactor("circle", radius, friction=0.0, restitution=1.0),
                 step=1 / 120, substeps=16, tolerance=1e-5, passes=80)
    for _ in range(240):
        s.advance(1)
        assert beyond_wall(s.scene, s.x, s.y, s.angle) < 0.01


@pytest.mark.parametrize("substeps", [3, 5, 6, 8, 10, 12])
def test_joined_substeps_do_not_depend_on_how_a_run_is_cut(substeps):
    """Nor where a step, or half of it, is not a power of two times a substep: impulses are scaled
    by 6 and back then, which is not exact."""
    cells = tuple((i, j, ("black", "white")[(i + j) % 2]) for i, j in
                  [(0, 0), (1, 0), (2, 0), (-1, 0), (-2, 0), (0, 1), (0, 2), (0, -1), (0, -2)])
    calm = replace(
        scene([tile(0.1, 0.1, kind="black")], types=CHESSBOARD, magnet=Magnet(), floor=Floor(),
              reactor=Reactor("circle", 0.2), drive=Drive("unicycle", 0.07, 1.65e-3, 0.33),
              body=Material(), step=1 / 120, substeps=substeps, tolerance=2e-2, passes=40),
        seed=Seed(cells), free=Free((("black", 20), ("white", 20))), run=Run(seed=7))
    whole, cut = Simulation(calm), Simulation(calm)
    whole.advance(3600)
    for _ in range(360):
        cut.advance(10)
    assert whole.counts.joined[0] > 100
    assert (state(whole) == state(cut)).all()


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.06]))
def test_the_gap_after_a_substep_is_foreseen_along_the_arc(seed, radius):
    """Points of two tiles, or of one at a round wall, that fly on without a contact.

    gap + h vn + h^2 bend is the gap of the same face and point after h, by rotating both, to
    1e-6 of the width; where the bend is not that of an arc that the point comes in along, it is
    cut to what vn mirrors.
    """
    rng = np.random.default_rng(seed)
    h, spins = 1 / 480, rng.uniform(-150.0, 150.0, 2)
    v = rng.uniform(-0.5, 0.5, (2, 2))
    angle = rng.uniform(-4.0, 4.0, 2)
    place = rng.uniform(0.0, 2.0 * math.pi)
    distance = radius - 0.75 * WIDTH if radius else rng.uniform(1.05, 1.35) * WIDTH
    tiles = [tile(0, 0, angle[0], *v[0], spins[0]),
             tile(distance * math.cos(place), distance * math.sin(place), angle[1], *v[1],
                  spins[1])]
    s = simulate(tiles[1:] if radius else tiles, step=h, substeps=1, checked=False,
                 reactor=Reactor("circle", radius) if radius else None)
    s.advance(1)
    assume(s.counts.substeps[0] == 1 and s.counts.impacts[0] + s.counts.projections[0] == 0)
    rows = moving_rows(s)
    # Where the tiles were when the rows were placed: half a substep before the end.
    z = s.x + 1j * s.y - 0.5 * h * (s.vx + 1j * s.vy)
    u, spin, half = s.vx + 1j * s.vy, s.omega, 0.5 * WIDTH
    for k in range(len(rows["a"])):
        n = complex(rows["nx"][k], rows["ny"][k])
        a, b = rows["a"][k], rows["b"][k]
        for i in range(int(rows["count"][k])):
            gap, vn, bend = (rows[f"{name}{i}"][k] for name in ("gap", "vn", "bend"))
            if radius:
                r = n * (rows["at"][k] - 1j * rows[f"an{i}"][k])
                later = radius - abs(z[a] + h * u[a] + r * cmath.rect(1.0, h * spin[a]))
            else:
                turn = np.exp(-1j * (s.angle - 0.5 * h * spin))
                d = z[b] - z[a]
                on_a, on_b = (max(abs(q.real), abs(q.imag)) for q in (d * turn[a], d * turn[b]))
                face, other, out, p = ((a, b, n, -rows[f"bn{i}"][k]) if on_a >= on_b
                                       else (b, a, -n, rows[f"an{i}"][k]))
                d = z[other] - z[face]
                r = out * complex(half + gap - (d * out.conjugate()).real, p)
                way = d + h * (u[other] - u[face]) + r * cmath.rect(1.0, h * spin[other])
                later = (way * (out * cmath.rect(1.0, h * spin[face])).conjugate()).real - half
            expected = (later - gap) / h - vn
            mirror = min(abs(expected), abs(vn)) * (expected * vn > 0.0) * np.sign(expected)
            if gap + h * (vn + mirror) < 0.0:
                continue  # what only passes by, and is let go on
            assert h * h * bend == pytest.approx(h * mirror, abs=1e-6 * WIDTH)


def test_looking_at_a_simulation_does_not_change_it():
    seen, left = Simulation(crowd()), Simulation(crowd())
    for _ in range(20):
        seen.advance(10)
        seen.magnet_forces()
        seen.contact_forces()
        seen.kinetic_energy()
    left.advance(200)
    assert (state(seen) == state(left)).all()


# Magnets.

SETS = {
    "chessboard": (CHESSBOARD, -1),
    "no force without a match": (CHESSBOARD, 0),
    "edges without magnets": ((TileType("a", (1, 0, -2, 3), "red"),
                               TileType("b", (0, -1, 2, 0), "blue")), -1),
    "no magnets on one type": ((TileType("a", (0, 0, 0, 0), "red"),
                                TileType("b", (1, -1, 2, -2), "blue")), 0),
}


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(sorted(SETS)), st.integers(2, 9), st.sampled_from([0.02, 0.03, 0.07]),
       st.integers(0, 2**32 - 1))
@example("no magnets on one type", 7, 0.02, 80781815)  # a pair just within the cut-off
def test_magnet_forces_are_the_sum_over_all_pairs_of_magnets(name, n, cutoff, seed):
    """Force and torque about the centre of every tile, tiles anywhere (overlap, too), to 1e-12."""
    types, mismatch = SETS[name]
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.06, 0.06, (2, n))
    angle, kind = rng.uniform(-7.0, 7.0, n), rng.integers(0, len(types), n)
    chosen = scene([tile(0.1 * i, 0, kind=types[0].name) for i in range(n)], types=types,
                   magnet=Magnet(cutoff=cutoff, mismatch=mismatch))
    zero, no = np.zeros(n), np.zeros(n, bool)
    s = Simulation(chosen, Layout(0.1 * np.arange(n), zero, angle, zero, zero, zero, kind, no, no))
    s.x[:], s.y[:] = x, y
    law = magnets.Law(cutoff=cutoff, switch=0.1, mismatch=mismatch)
    expected = np.array(all_magnet_forces(x, y, angle, [types[k].glues for k in kind], law,
                                          magnets.pair_force)).T
    # Near the cut-off the rounding of a distance counts by the way over which the force fades.
    rounding = np.spacing(0.12) / (law.switch * cutoff) * magnets.force(
        cutoff, law._replace(cutoff=math.inf))
    assert np.array(s.magnet_forces()) == pytest.approx(
        expected, abs=1e-12 * np.abs(expected).max() + rounding)


@pytest.mark.parametrize("cutoff", [1e-4, 0.003, 0.03])
def test_no_pair_of_magnets_within_the_cutoff_is_missing(cutoff):
    """Two that are nearer than it by a millionth of it, 300 times.  Lists are made in single
    precision, which rounds the more of a cut-off the smaller that is beside the tile."""
    chosen = scene([tile(3 * i * WIDTH, 0, kind="black") for i in range(2)], types=CHESSBOARD,
                   magnet=Magnet(cutoff=cutoff, inset=0.4 * cutoff), step=1e-6)
    s, d, random = Simulation(chosen), 0.5 * WIDTH - 0.4 * cutoff, np.random.default_rng(1)
    near = s._work.magnets
    for _ in range(300):
        s.angle[:] = random.uniform(-7.0, 7.0, 2)
        edges = random.integers(0, 4, 2)
        arms = d * np.exp(1j * (s.angle + 0.5 * np.pi * (1 - edges)))
        apart = (1.0 - 1e-6) * cutoff * np.exp(1j * random.uniform(0.0, 2.0 * np.pi))
        s.x[:], s.y[:] = (0.0, (arms[0] + apart - arms[1]).real), (
            0.0, (arms[0] + apart - arms[1]).imag)
        s.magnet_forces()
        listed = slice(near.size[0])
        assert (edges[0], 4 + edges[1]) in set(zip(near.p[listed], near.q[listed], strict=True))


@pytest.mark.parametrize("cutoff", [0.03, 0.07])
@pytest.mark.parametrize("step", [1 / 30, 1 / 240])
def test_the_forces_on_what_turns_far_are_the_mean_of_its_way(cutoff, step):
    """Of every pair of tiles at so many places, evenly in time, that none of the two turns by more
    than 0.15 rad from one to the next, as they go at the beginning; of what turns less in all, in
    the middle alone.  Nine tiles that do not touch, one held, half a turn in a step and less and
    more; more than 64 places in one case.  After one step."""
    rng = np.random.default_rng(5)
    x, y = 1.9 * WIDTH * (np.indices((3, 3)).reshape(2, -1) + rng.uniform(-0.1, 0.1, (2, 9)))
    angle, vx, vy = rng.uniform(-7.0, 7.0, 9), *(0.2 / 240 / step * rng.normal(size=(2, 9)))
    spin = np.array([0.0, 0.1, -0.3, 1.0, -3.2, 7.0, 12.0, 0.0, 0.14]) / step
    kinds = rng.integers(0, 2, 9)
    tiles = [tile(*each[:6], kind=CHESSBOARD[k].name, held=i == 7) for i, (*each, k) in enumerate(
        zip(x, y, angle, vx, vy, np.where(np.arange(9) == 7, 0.0, spin), kinds, strict=True))]
    tiles[7] = replace(tiles[7], velocity=(0.0, 0.0))
    s = simulate(tiles, types=CHESSBOARD, magnet=Magnet(cutoff=cutoff), step=step,
                 body=material(mass=500 * MASS))  # so that they come no nearer
    x, y, angle, vx, vy, spin = state(s)
    law = magnets.Law(cutoff=cutoff, switch=0.1)
    expected = np.zeros((3, 9))
    for a, b in itertools.combinations(range(9), 2):
        d, u = (complex(p[b] - p[a], q[b] - q[a]) for p, q in ((x, y), (vx, vy)))
        line = (d.conjugate() * u).imag / abs(d) ** 2
        turns = [abs(spin[i] - of) * step for i in (a, b) for of in (line, 0.0)]
        places = 1 if max(turns[1::2]) <= 0.15 else min(max(
            math.ceil(max(turns[::2]) / 0.15), 1), 64)
        for t in (np.arange(places) + 0.5) * step / places:
            pose_a, pose_b = ((x[i] + t * vx[i], y[i] + t * vy[i], angle[i] + t * spin[i])
                              for i in (a, b))
            fx, fy, torque_a, torque_b = magnets.pair_force(
                pose_a, CHESSBOARD[kinds[a]].glues, pose_b, CHESSBOARD[kinds[b]].glues, law)
            expected[:, a] += np.array([-fx, -fy, torque_a]) / places
            expected[:, b] += np.array([fx, fy, torque_b]) / places
    expected[:, 7] = 0.0
    s.advance(1)
    assert s.counts.impacts[0] == 0
    found = (state(s)[3:] - (vx, vy, spin)) / step * 500 * np.array([[MASS], [MASS], [INERTIA]])
    size = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) / size).max() < 1e-9  # of the differences of velocities


def test_tiles_that_turn_as_one_have_the_forces_of_the_middle():
    """Two at 40 rad/s about their common centre, for 1/120 s: 0.33 rad."""
    spin, step = 40.0, 1 / 120
    s = simulate([tile(-WIDTH, 0, 0.3, vy=-WIDTH * spin, spin=spin, kind="black"),
                  tile(WIDTH, 0, 0.3, vy=WIDTH * spin, spin=spin, kind="white")],
                 types=CHESSBOARD, magnet=Magnet(cutoff=0.07), step=step)
    x, y, angle, vx, vy, _ = state(s)
    s.advance(1)
    t = 0.5 * step
    poses = [(x[i] + t * vx[i], y[i] + t * vy[i], angle[i] + t * spin) for i in (0, 1)]
    fx, fy, *torques = magnets.pair_force(poses[0], CHESSBOARD[0].glues, poses[1],
                                          CHESSBOARD[1].glues, magnets.Law(cutoff=0.07))
    assert MASS * (s.vx - vx) / step == pytest.approx([-fx, fx], rel=1e-9)
    assert MASS * (s.vy - vy) / step == pytest.approx([-fy, fy], rel=1e-9)
    assert INERTIA * (s.omega - spin) / step == pytest.approx(torques, rel=1e-9)


def test_magnet_forces_are_those_on_held_tiles_too():
    """A bond within the seed is one, though it moves nothing."""
    bonded = [tile(0, 0, kind="black"), tile(WIDTH, 0, kind="white"), tile(0.2, 0, kind="black")]
    free, held = (np.array(simulate([replace(each, held=fixed) for each in bonded],
                                    types=CHESSBOARD, magnet=Magnet()).magnet_forces())
                  for fixed in (False, True))
    assert free[0][0] > 0.1
    assert (held == free).all()


def test_magnets_push_no_scene_as_a_whole():
    """Forces add up to nothing, and torques about the origin, too."""
    s = Simulation(crowd())
    fx, fy, torque = s.magnet_forces()
    assert np.abs(fx).max() > 1e-3
    size = np.hypot(fx, fy).sum()
    assert abs(fx.sum()) < 1e-14 * size
    assert abs(fy.sum()) < 1e-14 * size
    assert abs((s.x * fy - s.y * fx + torque).sum()) < 1e-14 * size


# Symmetry of whole scenes.

# All its solves converge.  With the last tile's spin at 2 or 3 rad/s floor and contacts take turns
# in one of them, which then ends where the passes do.
GROUP = [  # x, y, angle, vx, vy, spin, type
    (-0.035, 0.001, 0.1, 0.2, 0.0, 1.0, "black"), (0.0, -0.002, -0.2, 0.0, 0.02, -2.0, "white"),
    (0.002, 0.036, 0.3, -0.02, -0.3, 0.5, "black"), (0.038, 0.004, 0.0, -0.25, 0.03, 0.0, "white"),
    (0.001, -0.04, 1.0, 0.05, 0.2, 1.5, "black"),
]


def play(group, types=CHESSBOARD, torque=2e-4, law="coupled"):
    """A fifth of a second of five tiles that collide and bond inside a wall."""
    s = simulate([tile(*values[:6], kind=values[6]) for values in group], types=types,
                 magnet=Magnet(), reactor=Reactor("circle", 0.075), floor=Floor(law) if law !=
                 "separate" else Floor(angular=0.03), drive=Drive("unicycle", 0.06, torque, 1.0),
                 body=material(linear_damping=0.8, angular_damping=0.5), tolerance=1e-12,
                 passes=20_000, substeps=4, join_substeps=False)
    s.run(0.2)
    assert s.counts.impacts[0] >= 5
    assert s.counts.unconverged[0] == 0
    return state(s)


LAWS = ("separate", "coupled", "exact")


def agree(found, expected):
    """Lengths in widths, angles in rad, speeds in m/s, spins in rad/s, all to 1e-6."""
    scale = np.array([WIDTH, WIDTH, 1.0, 1.0, 1.0, 10.0])[:, None]
    assert np.abs((found - expected) / scale).max() < 1e-6


@pytest.mark.parametrize("law", LAWS)
def test_a_turned_scene_goes_the_same_way(law):
    phi = 0.7
    group = [(*turned(x, y, phi), a + phi, *turned(vx, vy, phi), w, kind)
             for x, y, a, vx, vy, w, kind in GROUP]
    x, y, a, vx, vy, w = play(GROUP, law=law)
    agree(play(group, law=law), np.array([*turned(x, y, phi), a + phi, *turned(vx, vy, phi), w]))


@pytest.mark.parametrize("law", LAWS)
def test_a_mirrored_scene_goes_the_mirrored_way(law):
    """x -> -x: angles, spins and the drive's torque change sign, E and W change places."""
    types = tuple(mirrored(kind) for kind in CHESSBOARD)
    group = [(-x, y, -a, -vx, vy, -w, kind) for x, y, a, vx, vy, w, kind in GROUP]
    x, y, a, vx, vy, w = play(GROUP, law=law)
    agree(play(group, types, -2e-4, law=law), np.array([-x, y, -a, -vx, vy, -w]))


@pytest.mark.parametrize("law", LAWS)
def test_tiles_in_another_order_go_the_same_way(law):
    order = [3, 0, 4, 2, 1]
    agree(play([GROUP[i] for i in order], law=law), play(GROUP, law=law)[:, order])


# Compilation.


def python(code, folder, **environment):
    """What a fresh Python prints as JSON, `folder` first on its path."""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=600,
        env=os.environ | {"PYTHONPATH": str(folder)} | environment)
    assert result.returncode == 0, result.stderr[-3000:]
    return json.loads(result.stdout)


def test_the_hash_sees_every_change_of_a_kernels_source(tmp_path):
    folder = tmp_path / "kernels"
    shutil.copytree(PACKAGE / "kernels", folder, ignore=shutil.ignore_patterns("__pycache__"))
    assert jit.source_hash(folder) == jit.source_hash()
    seen = {jit.source_hash()}
    for path in sorted(folder.glob("*.py")):
        text = path.read_text()
        path.write_text(text + "\n# changed\n")
        seen.add(jit.source_hash(folder))
        path.write_text(text)
    (folder / "one_more.py").write_text("")
    seen.add(jit.source_hash(folder))
    assert len(seen) == len(list(folder.glob("*.py"))) + 1
    (folder / "one_more.py").unlink()
    (folder / "geometry.py").rename(folder / "shape.py")
    assert jit.source_hash(folder) not in seen


BOND = """
import json
from tbsa.model.scene import SETS, Free, Magnet, PlacedTile, Scene
from tbsa.model.simulation import Simulation
tiles = (PlacedTile("black", (0.0, 0.0)), PlacedTile("white", (0.03, 0.0)))
s = Simulation(Scene(types=SETS["chessboard"], free=Free((), tiles), magnet=Magnet()))
print(json.dumps([list(part) for part in s.magnet_forces()]))
"""


def test_a_changed_helper_takes_effect_although_kernels_are_cached(tmp_path):
    """Doubling the force in a helper doubles what the cached kernel of its caller returns."""
    shutil.copytree(PACKAGE, tmp_path / "tbsa", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"TBSA_CACHE_DIR": str(tmp_path / "cache")}
    before = np.array(python(BOND, tmp_path, **environment))
    helper = tmp_path / "tbsa" / "kernels" / "magnets.py"
    text = helper.read_text()
    changed = text.replace("f = strength * switch(", "f = 2.0 * strength * switch(")
    assert changed != text
    helper.write_text(changed)
    after = np.array(python(BOND, tmp_path, **environment))
    assert before[0, 0] == pytest.approx(0.1312, abs=1e-4)
    assert after == pytest.approx(2.0 * before, rel=1e-14)
    assert len(list((tmp_path / "cache" / "tbsa").iterdir())) == 2


SMALL = """
import json
from tbsa.model.scene import *
from tbsa.model.simulation import Simulation
tiles = (PlacedTile("black", (0.001, 0.002), 0.1, (0.1, -0.05), 2.0),
         PlacedTile("white", (0.0331, 0.0), -0.05, (-0.3, 0.1), 1.0),
         PlacedTile("black", (0.034, 0.034), 0.0, held=True))
s = Simulation(Scene(types=SETS["chessboard"], free=Free((), tiles), magnet=Magnet(),
                     floor=Floor(LAW), reactor=Reactor("circle", 0.07),
                     drive=Drive("shaking", 0.3, 0.0, 3.0), solver=Solver(at_rest=0.1)))
s.advance(20)
values = [list(map(float, part)) for part in (s.x, s.y, s.angle, s.vx, s.vy, s.omega)]
print(json.dumps([values, int(s.counts.impacts[0]), int(s.counts.rows[0])]))
"""


def test_the_kernels_without_the_compiler_give_the_same_numbers(tmp_path):
    """Three tiles, magnets, floor, wall and collisions: the same to 1e-12 as plain Python, which
    needs nothing that was compiled before."""
    root = PACKAGE.parent
    for law in ('"separate"', '"exact"'):
        code = SMALL.replace("LAW", law)
        fast, impacts, rows = python(code, root)
        slow, *same = python(code, root, NUMBA_DISABLE_JIT="1", TBSA_CACHE_DIR=str(tmp_path))
        assert same == [impacts, rows]
        assert impacts > 0
        assert np.array(slow) == pytest.approx(np.array(fast), rel=1e-12, abs=1e-14)


# What hits next.


def through_a_queue(queue, rows, times):
    """Put these rows to these times in turn, a time < 0 standing for the next one to be taken; then
    take all that are left.  In the order in which they came."""
    came = np.empty(0, np.int64)
    for i in range(rows.size):
        if times[i] >= 0.0:
            put(queue, rows[i], times[i])
        elif queue.size[0] > 0:
            came = np.append(came, take(queue))
    while queue.size[0] > 0:
        came = np.append(came, take(queue))
    return came


@pytest.mark.parametrize("seed", range(20))
def test_rows_leave_the_queue_by_their_last_time_and_number(seed):
    """Against a dictionary that is searched; many times are equal, many rows put again."""
    rng = np.random.default_rng(seed)
    rows, times = rng.integers(0, 30, 400), rng.integers(-4, 12, 400) / 8.0
    queue, waiting, expected = empty_queue(30), {}, []

    def following():
        row = min(waiting, key=lambda each: (waiting[each], each))
        expected.append(row)
        del waiting[row]

    for row, at in zip(rows.tolist(), times.tolist(), strict=True):
        if at >= 0.0:
            waiting[row] = at
        elif waiting:
            following()
    while waiting:
        following()
    assert len(expected) > 100
    assert jit.njit(through_a_queue)(queue, rows, times).tolist() == expected
    assert not queue.place.any()


# Helpers and arrays.


class Inner(NamedTuple):
    number: np.ndarray
    single: np.ndarray


class Outer(NamedTuple):
    width: float
    place: np.ndarray
    inner: Inner


def shuffle(given: Any, plain: Any, n: int) -> Any:
    given, plain = lean(lean(given)), lean(plain)
    inner = given.inner
    for i in range(n):
        inner.number[i] += i
        inner.single[i] = 2 * inner.number[i]
    copy(given.place, plain, 3)
    set_all(given.place, 3, given.width)
    return inner.number[0] + inner.number[n - 1], whole(plain, 2).sum()


@pytest.mark.parametrize("function", [shuffle, jit.njit(shuffle)])
def test_kernels_see_the_arrays_that_they_are_given(function):
    """In tuples of tuples, of all kinds of numbers; nothing is copied, nothing else is touched."""
    room = np.arange(12.0)
    given = Outer(0.5, room[2:6], Inner(np.arange(5, dtype=np.int64), np.zeros(5, np.int32)))
    plain = np.full(4, -1.0)
    if function is shuffle:  # without the compiler `lean` is nothing
        function = type(shuffle)(shuffle.__code__, {
            **globals(), "lean": lambda value: value, "whole": lambda array, n: array[:n],
            "copy": copy.py_func, "set_all": set_all.py_func})
    ends, total = function(given, plain, 5)
    assert list(given.inner.number) == [0, 2, 4, 6, 8]
    assert list(given.inner.single) == [0, 4, 8, 12, 16]
    assert list(plain) == [2.0, 3.0, 4.0, -1.0]
    assert list(room) == [0.0, 1.0, 0.5, 0.5, 0.5, 5.0, *range(6, 12)]
    assert (ends, total) == (8, 5.0)


@pytest.mark.parametrize("array", [np.zeros(6)[::2], np.zeros((2, 2))])
def test_arrays_with_gaps_and_tables_do_not_get_into_kernels(array):
    with pytest.raises(TypingError, match="is not an array of one dimension without gaps"):
        jit.njit(lambda given: lean(given)[0])(array)


def test_what_a_kernel_keeps_to_itself_has_a_name_of_its_own():
    """There a helper has lost the arguments that are of no use; LLVM's linker takes the first
    function of a name that it has seen, and would call it for the whole one."""
    simulate([tile(vx=0.1)]).advance(1)
    (kernel,) = core.advance.overloads.values()
    module = kernel.library._get_module_for_linking()
    hidden = [each.name for each in module.functions if each.linkage == Linkage.internal]
    assert len(hidden) > 5
    assert all(name.startswith("advance.") for name in hidden)


def test_no_two_arrays_of_a_simulation_share_memory():
    """The compiler of `advance` is told so (`jit.solo`)."""
    s = Simulation(field_of_tiles(50))
    s.advance(10)
    found = []

    def visit(value):
        if isinstance(value, np.ndarray):
            begin = value.__array_interface__["data"][0]
            found.append((begin, begin + value.nbytes))
        elif isinstance(value, tuple):
            for each in value:
                visit(each)

    visit((s.state, s.tiles, s._work, s.counts, s.parameters))
    assert len(found) > 150
    places = sorted(place for place in found if place[1] > place[0])
    assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(places))
