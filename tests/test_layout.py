"""Starting layouts: where the tiles are, and that random ones are placed fairly."""

from __future__ import annotations

import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbsa.errors import InputError
from tbsa.model import layout as module
from tbsa.model.layout import Layout, check, initial_layout, stream
from tbsa.model.scene import Free, Reactor, Run, load, parse
from tbsa.model.squares import depth, inside, near

PAPER = load(Path(__file__).parents[1] / "paper_runs" / "shaking.toml")
WIDTH = PAPER.material.width
angles = st.floats(-7.0, 7.0)


def free(counts, reactor=PAPER.reactor, seed=1, cells=None):
    """The paper's scene with other free tiles."""
    return replace(PAPER, free=Free(tuple(counts.items())), reactor=reactor, seed=cells,
                   run=Run(1.0, seed))


def arrays(layout):
    return [getattr(layout, f.name) for f in fields(Layout)]


def corners(x, y, angle, width=WIDTH):
    """Reference: corners as complex numbers, one row a square."""
    at = 0.5 * width * np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
    return (np.atleast_1d(x) + 1j * np.atleast_1d(y))[:, None] + np.outer(
        np.exp(1j * np.atleast_1d(angle)), at)


def clipped_area(one, other):
    """Reference: area that two convex polygons (complex corners, ccw) share, by clipping."""
    for a, b in zip(one, np.roll(one, -1), strict=True):
        side = ((b - a).conjugate() * (other - a)).imag  # positive: inside this edge
        kept = []
        for k in range(len(other)):
            p, q, s, t = other[k - 1], other[k], side[k - 1], side[k]
            if s * t < 0:
                kept.append(p + (q - p) * s / (s - t))
            if t >= 0:
                kept.append(q)
        other = np.array(kept)
        if len(other) < 3:
            return 0.0
    return 0.5 * float((other.conjugate() * np.roll(other, -1)).imag.sum())


# --- the geometry underneath -------------------------------------------------------------------


@given(st.floats(-1.6, 1.6), st.floats(-1.6, 1.6), angles, angles)
@settings(deadline=None, max_examples=300)
def test_squares_overlap_by_the_axes_exactly_when_they_share_area(dx, dy, a, b):
    deep = depth(1.0, np.array([dx]), np.array([dy]), np.array([a]), np.array([b]))[0]
    area = clipped_area(corners(0.0, 0.0, a, 1.0)[0], corners(dx, dy, b, 1.0)[0])
    if abs(deep) > 1e-6:
        assert (area > 0.0) == (deep > 0.0)


def test_the_depth_of_aligned_squares_is_how_far_to_push_them_apart():
    zero = np.zeros(4)
    found = depth(2.0, np.array([1.5, 2.0, 2.5, 1.0]), np.array([0.0, 0.0, 0.0, 1.8]), zero, zero)
    assert found == pytest.approx([0.5, 0.0, -0.5, 0.2])


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), angles)
@settings(deadline=None)
def test_a_square_is_inside_when_its_four_corners_are(x, y, angle):
    at = corners(x, y, angle, 0.5)[0]
    for reactor, outside in ((Reactor("circle", radius=0.9), np.abs(at).max() - 0.9),
                             (Reactor("rectangle", width=1.6, height=1.0),
                              max(np.abs(at.real).max() - 0.8, np.abs(at.imag).max() - 0.5))):
        if abs(outside) > 1e-8:
            found = inside(reactor, 0.5, np.array([x]), np.array([y]), np.array([angle]))
            assert found[0] == (outside < 0)


@given(st.integers(0, 2**32), st.integers(0, 30), st.integers(0, 30), st.floats(0.05, 2.0))
@settings(deadline=None)
def test_near_finds_every_close_pair_once_and_in_order(seed, n, m, distance):
    rng = np.random.default_rng(seed)
    xa, ya, xb, yb = (rng.uniform(-1, 1, k) for k in (n, n, m, m))
    apart = np.hypot(xa[:, None] - xb, ya[:, None] - yb)
    found = list(zip(*(v.tolist() for v in near(xa, ya, xb, yb, distance)), strict=True))
    assert found == [tuple(pair) for pair in np.argwhere(apart <= distance).tolist()]


# --- seed and explicit tiles -------------------------------------------------------------------


def test_seed_tiles_come_first_then_explicit_then_random_ones():
    scene = parse(
        '[tiles]\nset = "chessboard"\n[reactor]\nshape = "circle"\nradius = 0.3\n'
        '[seed]\nshape = "cells"\ncells = [[1, 0, "white"], [0, 0, "black"]]\n'
        "centre = [0.1, 0.02]\nangle = 1.5707963267948966\n"
        "[free]\ncounts = {white = 2, black = 1}\n"
        '[[free.tile]]\ntype = "white"\nposition = [-0.1, 0.05]\nangle = 0.5\n'
        "velocity = [0.1, -0.2]\nspin = 3.0\n"
        '[[free.tile]]\ntype = "black"\nposition = [-0.1, -0.05]\nheld = true\n')
    layout = initial_layout(scene)
    assert layout.type.tolist() == [1, 0, 1, 0, 1, 1, 0]
    assert layout.seed.tolist() == [True] * 2 + [False] * 5
    assert layout.held.tolist() == [True] * 2 + [False, True] + [False] * 3
    assert layout.x[:4] == pytest.approx([0.1, 0.1, -0.1, -0.1])
    assert layout.y[:4] == pytest.approx([0.05, 0.02, 0.05, -0.05])
    assert layout.angle[:4].tolist() == [1.5707963267948966] * 2 + [0.5, 0.0]
    assert layout.vx.tolist() == [0, 0, 0.1, 0, 0, 0, 0]
    assert layout.vy.tolist() == [0, 0, -0.2, 0, 0, 0, 0]
    assert layout.omega.tolist() == [0, 0, 3.0, 0, 0, 0, 0]


def test_a_layout_without_a_tile_is_refused():
    scene = parse({"tiles": {"set": "chessboard"}, "free": {"tile": [
        {"type": "black", "position": [0.0, 0.0]}]}})
    layout = initial_layout(scene)
    check(layout, scene)
    none = Layout(**{name: each[:0] for name, each in vars(layout).items()})
    with pytest.raises(InputError, match="layout: must hold at least one tile"):
        check(none, scene)


def test_the_arrays_are_one_dimensional_contiguous_and_of_plain_types():
    layout = initial_layout(PAPER)
    assert [a.dtype for a in arrays(layout)] == [np.float64] * 6 + [np.int64] + [np.bool_] * 2
    assert all(a.shape == (591,) and a.flags.c_contiguous for a in arrays(layout))


# --- random tiles ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_the_paper_start_has_no_overlap_and_nobody_outside(seed):
    layout = initial_layout(replace(PAPER, run=Run(1.0, seed)))
    assert np.bincount(layout.type[41:]).tolist() == [275, 275]
    assert layout.held.sum() == layout.seed.sum() == layout.seed[:41].sum() == 41
    shape = corners(layout.x, layout.y, layout.angle)
    assert np.abs(shape).max() <= 0.6
    apart = np.hypot(*(np.subtract.outer(v, v) for v in (layout.x, layout.y)))
    close = np.argwhere(np.triu(apart < 1.5 * WIDTH, 1))
    assert len(close) > 500
    shared = [clipped_area(shape[i], shape[j]) for i, j in close]
    assert max(shared) <= 1e-12 * WIDTH**2


def test_in_a_rectangle_tiles_fill_the_whole_of_it():
    reactor = Reactor("rectangle", width=0.9, height=0.5)
    layout = initial_layout(free({"black": 150}, reactor))
    shape = corners(layout.x, layout.y, layout.angle)
    assert 0.44 < np.abs(shape.real).max() <= 0.45
    assert 0.24 < np.abs(shape.imag).max() <= 0.25


def test_positions_are_uniform_in_the_disc_and_angles_over_the_circle():
    reactor = Reactor("circle", radius=1.0)
    x, y, angle = np.concatenate([
        arrays(initial_layout(free({"black": 20}, reactor, seed)))[:3] for seed in range(60)], 1)
    room = 1.0 - WIDTH / np.sqrt(2)  # whatever the angle, no further out than this is forbidden
    area = np.hypot(x, y) ** 2 / room**2
    for uniform in (area[area < 1] / 1.0, (np.arctan2(y, x) / (2 * np.pi)) % 1,
                    angle / (2 * np.pi)):
        count = np.histogram(uniform, 10, (0, 1))[0]
        expected = len(uniform) / 10
        assert ((count - expected) ** 2 / expected).sum() < 33.7  # chi square, 9 d.o.f., 1e-4
    assert angle.min() >= 0.0
    assert angle.max() < 2 * np.pi


def test_no_type_is_left_with_the_gaps():
    # the crowded end of the sequence must go to both types alike: mean distance to the nearest
    # neighbour, over 30 starts, within four standard errors
    difference = []
    for seed in range(30):
        layout = initial_layout(free({"black": 60, "white": 60}, Reactor("circle", radius=0.29),
                                     seed))
        apart = np.hypot(*(np.subtract.outer(v, v) for v in (layout.x, layout.y)))
        nearest = np.where(apart > 0, apart, 1.0).min(1)
        difference.append(nearest[:60].mean() - nearest[60:].mean())
    assert abs(np.mean(difference)) < 4 * np.std(difference) / np.sqrt(30)


def test_the_same_seed_gives_the_same_start_and_another_seed_another():
    first, again = (arrays(initial_layout(PAPER)) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    other = initial_layout(replace(PAPER, run=Run(1.0, 2)))
    assert not np.any(other.x[41:] == first[0][41:])


def test_accepting_in_batches_is_accepting_one_after_another():
    layout = initial_layout(free({"black": 40}, Reactor("circle", radius=0.2)))
    numbers = stream(1, "layout")
    sequence = numbers.permutation(40)
    x, y, angle = np.empty(0), np.empty(0), np.empty(0)
    while len(x) < 40:
        u, v, w = numbers.random(3)
        r, phi, turn = 0.2 * np.sqrt(u), 2 * np.pi * v, 2 * np.pi * w
        p, q = r * np.cos(phi), r * np.sin(phi)
        if (np.abs(corners(p, q, turn)).max() <= 0.2
                and not (depth(WIDTH, x - p, y - q, np.full(len(x), turn), angle) > 0).any()):
            x, y, angle = np.append(x, p), np.append(y, q), np.append(angle, turn)
    assert layout.x[sequence] == pytest.approx(x, abs=1e-15)
    assert layout.y[sequence] == pytest.approx(y, abs=1e-15)
    assert layout.angle[sequence] == pytest.approx(angle, abs=1e-15)


def test_named_streams_are_reproducible_and_independent():
    assert stream(1, "layout").random() == stream(1, "layout").random()
    values = [stream(seed, name).random() for seed in (1, 2) for name in ("layout", "drive")]
    assert len(set(values)) == 4


# --- too many ------------------------------------------------------------------------------------


def test_tiles_of_more_area_than_is_left_are_refused_at_once():
    start = time.perf_counter()
    with pytest.raises(InputError) as caught:
        initial_layout(free({"black": 10**6}, cells=PAPER.seed))
    assert time.perf_counter() - start < 2.0
    assert caught.value.field == "free"
    assert "1000000 random tiles must fit into the reactor" in str(caught.value)
    assert "the area left is that of 1215 tiles" in str(caught.value)  # 1256.6 - 41


def test_tiles_that_find_no_place_at_random_are_refused_with_the_number_placed(monkeypatch):
    monkeypatch.setattr(module, "TRIALS", (20_000, 100))
    with pytest.raises(InputError) as caught:
        initial_layout(free({"black": 400, "white": 400}, cells=PAPER.seed))
    message = str(caught.value)
    placed = int(message.split("reactor: ")[1].split()[0])
    assert 400 < placed < 650
    assert "would cover 0.67 of the reactor, and random placement ends near 0.5" in message


def test_a_channel_too_narrow_to_turn_in_is_not_called_full():
    channel = Reactor("rectangle", width=1.0, height=WIDTH)
    with pytest.raises(InputError, match="or earlier where walls leave tiles no room to turn"):
        initial_layout(free({"black": 1}, channel))


def test_the_paper_start_and_ten_thousand_tiles_take_moments():
    start = time.perf_counter()
    initial_layout(PAPER)
    assert time.perf_counter() - start < 2.0
    start = time.perf_counter()
    many = initial_layout(free({"black": 10_000}, Reactor("circle", radius=2.55)))  # 44 %
    assert time.perf_counter() - start < 15.0
    assert len(many.x) == 10_000


def test_a_large_crowd_is_numbered_by_place(monkeypatch):
    """The same tiles, each with its type and angle; random ones that are near have near numbers."""
    scene = parse(
        '[tiles]\nset = "chessboard"\n[seed]\nshape = "cross"\narm = 1\n[free]\nnumber = 300\n'
        '[reactor]\nshape = "circle"\nradius = 0.5\n')
    plain = initial_layout(scene)
    monkeypatch.setattr(module, "CROWD", 200)
    sorted_ = initial_layout(scene)

    def tiles(layout):
        return sorted(zip(layout.x, layout.y, layout.angle, layout.type, strict=True))

    def steps(layout):
        return np.median(np.hypot(np.diff(layout.x[5:]), np.diff(layout.y[5:])))

    assert tiles(plain) == tiles(sorted_)
    assert (plain.x[:5] == sorted_.x[:5]).all()
    assert steps(sorted_) < 0.25 * steps(plain)
