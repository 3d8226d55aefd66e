"""Contact geometry against slow twins built another way, and its symmetries."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scenes import WIDTH, contact_rows, scene, tile
from twins import cross, distance, dot, manifold, overlap_area, separations, vertices, wall_points

from tbsa.kernels.contacts import SPARE
from tbsa.kernels.geometry import BLUNT, circle_corner, square_square
from tbsa.model.layout import Layout
from tbsa.model.scene import Reactor
from tbsa.model.simulation import Simulation

many = settings(deadline=None, max_examples=400)
coordinate = st.floats(-1.5, 1.5).map(lambda u: u * WIDTH)
turns = st.floats(-4.0, 4.0)
margins = st.sampled_from([0.02 * WIDTH, 0.3 * WIDTH, 2.0 * WIDTH])
poses = st.tuples(coordinate, coordinate, turns, turns)
TINY = 1e-9 * WIDTH


def points(dx, dy, angle_a, angle_b, margin, origin=0j):
    """The kernel's manifold as ``(normal, {id: (gap, arm of a, arm of b)})``, arms as vectors."""
    found = square_square(dx, dy, math.cos(angle_a), math.sin(angle_a), math.cos(angle_b),
                          math.sin(angle_b), WIDTH, margin)
    count, nx, ny, *rest, at, bt, _, _ = found
    n = complex(nx, ny)
    result = {}
    for k in range(int(count)):
        number, gap, an, bn = rest[4 * k : 4 * k + 4]
        name = int(number)
        assert name == number
        key = (name // 8, name // 2 % 4, name % 2)
        result[key] = (gap, at * n - an * 1j * n, bt * n - bn * 1j * n)
    assert len(result) == count
    return n, result


def distinct(dx, dy, angle_a, angle_b):
    """Whether no two faces, and no two edges that look at them, compete for being nearest."""
    apart = sorted(separations(0j, angle_a, complex(dx, dy), angle_b, WIDTH))
    turn = (angle_b - angle_a) % (0.5 * math.pi)
    return apart[-1] - apart[-2] > 1e-6 * WIDTH and abs(turn - 0.25 * math.pi) > 1e-6


def flush_or_distinct(dx, dy, angle_a, angle_b):
    return angle_a == angle_b or distinct(dx, dy, angle_a, angle_b)


@many
@given(poses)
def test_the_twins_separation_is_negative_just_where_the_squares_overlap(pose):
    """Area of the clipped polygon > 0; apart, the true distance is never below the separation."""
    dx, dy, a, b = pose
    gap = max(separations(0j, a, complex(dx, dy), b, WIDTH))
    p, q = vertices(0j, a, WIDTH), vertices(complex(dx, dy), b, WIDTH)
    assume(abs(gap) > 1e-6 * WIDTH)
    assert (overlap_area(p, q) > 0.0) == (gap < 0.0)
    if gap > 0.0:
        assert distance(p, q) >= gap - TINY


@many
@given(poses, margins)
@example((0.0365625, 0.0365625, -1.21875, -3.251953125), 2.0 * WIDTH)  # a sliver of an edge
def test_the_manifold_is_the_facing_edge_clipped_to_the_reference_face(pose, margin):
    """Normal, count, ids, gaps and the points' places along the face, against the twin."""
    dx, dy, a, b = pose
    assume(distinct(*pose))
    normal, expected = manifold(0j, a, complex(dx, dy), b, WIDTH, margin)
    n, found = points(dx, dy, a, b, margin)
    every = manifold(0j, a, complex(dx, dy), b, WIDTH, 10.0 * WIDTH)[1]
    assume(all(abs(gap - margin) > TINY for gap, _ in every.values()))
    for aside in (-1e-6j * WIDTH, 1e-6j * WIDTH):  # not where rounding decides how many there are
        assume(normal is None or expected.keys() == manifold(
            0j, a, complex(dx, dy) + aside * normal, b, WIDTH, margin)[1].keys())
    assert found.keys() == expected.keys()
    if not expected:
        return
    assert abs(n - normal) < 1e-12
    for key, (gap, arm_a, _) in found.items():
        assert gap == pytest.approx(expected[key][0], abs=TINY)
        assert dot(arm_a, 1j * n) == pytest.approx(expected[key][1], abs=TINY)


@many
@given(poses, margins)
def test_both_lever_arms_lead_to_one_point_midway_between_the_surfaces(pose, margin):
    """r_a - r_b = d, or impulses would make angular momentum; all arms end within reach."""
    dx, dy, a, b = pose
    n, found = points(dx, dy, a, b, margin)
    for gap, arm_a, arm_b in found.values():
        assert abs(arm_a - arm_b - complex(dx, dy)) < 1e-12 * WIDTH
        assert gap <= margin
        assert abs(arm_a) < WIDTH * (0.5 + math.sqrt(0.5)) + margin
    if len(found) == 2:  # the two share the arms of friction, to rounding
        (g0, r0, _), (g1, r1, _) = found.values()
        assert dot(r0, n) == pytest.approx(dot(r1, n), abs=TINY)
        on_a = 0.5 * WIDTH + 0.5 * min(g0, g1)  # where it bears, if one of them is open
        on_b = dot(complex(dx, dy), n) - on_a
        assert min(abs(dot(r0, n) - on_a), abs(dot(r0, n) - on_b)) < TINY


@many
@given(poses, margins)
def test_swapping_the_tiles_turns_the_normal_and_keeps_gaps_and_points(pose, margin):
    """The id's edges change places and its end is the other one, so that both ways find it."""
    dx, dy, a, b = pose
    assume(distinct(*pose))
    n, found = points(dx, dy, a, b, margin)
    back, swapped = points(-dx, -dy, b, a, margin)
    assert {(f, e, 1 - end) for e, f, end in found} == set(swapped)
    for (e, f, end), (gap, arm_a, arm_b) in found.items():
        other = swapped[f, e, 1 - end]
        assert abs(n + back) < 1e-12
        assert other[0] == pytest.approx(gap, abs=TINY)
        assert abs(other[1] - arm_b) < TINY
        assert abs(other[2] - arm_a) < TINY


@many
@given(coordinate, coordinate, turns, st.integers(-4, 4))
def test_flush_tiles_touch_along_their_common_edge_whichever_is_the_reference(dx, dy, a, quarters):
    """Parallel squares: both points have the same gap, and lie at the ends of the overlap."""
    assume(abs(abs(dx) - abs(dy)) > 1e-6 * WIDTH)
    d = complex(dx, dy) * cmath.rect(1.0, a)
    _, found = points(d.real, d.imag, a, a + 0.5 * math.pi * quarters, 2.0 * WIDTH)
    overlap = WIDTH - min(abs(dx), abs(dy))
    assume(abs(overlap - BLUNT * WIDTH) > TINY)
    assert len(found) == (2 if overlap > BLUNT * WIDTH else 0)
    if found:
        (gap0, r0, _), (gap1, r1, _) = found.values()
        assert gap0 == pytest.approx(max(abs(dx), abs(dy)) - WIDTH, abs=TINY)
        assert gap1 == pytest.approx(gap0, abs=TINY)
        assert abs(r1 - r0) == pytest.approx(overlap, abs=TINY)


@many
@given(poses, margins, turns)
def test_turning_the_scene_turns_the_manifold(pose, margin, phi):
    dx, dy, a, b = pose
    assume(distinct(*pose))
    turn = cmath.rect(1.0, phi)
    d = complex(dx, dy) * turn
    n, found = points(dx, dy, a, b, margin)
    turned, same = points(d.real, d.imag, a + phi, b + phi, margin)
    assume(all(abs(gap - margin) > TINY for gap, *_ in [*found.values(), *same.values()]))
    assert found.keys() == same.keys()
    for key, (gap, arm_a, arm_b) in found.items():
        assert abs(turned - n * turn) < 1e-12
        assert same[key][0] == pytest.approx(gap, abs=TINY)
        assert abs(same[key][1] - arm_a * turn) < TINY
        assert abs(same[key][2] - arm_b * turn) < TINY


@many
@given(poses, margins)
def test_a_mirror_mirrors_the_manifold(pose, margin):
    """x -> -x: the edges E and W change places, and so do the ends."""
    dx, dy, a, b = pose
    assume(distinct(*pose))
    n, found = points(dx, dy, a, b, margin)
    m, other = points(-dx, dy, -a, -b, margin)
    seen = {0: 2, 1: 1, 2: 0, 3: 3}
    assert {(seen[e], seen[f], 1 - end) for e, f, end in found} == set(other)
    for (e, f, end), (gap, arm_a, arm_b) in found.items():
        gap_m, a_m, b_m = other[seen[e], seen[f], 1 - end]
        assert abs(m + n.conjugate()) < 1e-12
        assert gap_m == pytest.approx(gap, abs=TINY)
        assert abs(a_m + arm_a.conjugate()) < TINY
        assert abs(b_m + arm_b.conjugate()) < TINY


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_corners_that_overlap_by_less_than_the_blunt_width_pass_each_other(turn):
    """A tile that slides along a wall of tiles does not catch on the next joint."""
    for overlap, count in ((0.99 * BLUNT, 0), (1.01 * BLUNT, 2)):
        d = complex(1.0, 1.0 - overlap) * WIDTH * cmath.rect(1.0, turn)
        assert len(points(d.real, d.imag, turn, turn, 0.02 * WIDTH)[1]) == count


@pytest.mark.parametrize("sideways", [0.0, 0.2, -0.4])
def test_a_corner_on_a_face_is_one_point(sideways):
    """A diamond over a face touches with its lowest corner alone, at the exact gap."""
    gap = 1e-3 * WIDTH
    d = complex(0.5 * WIDTH + gap + WIDTH * math.sqrt(0.5) * math.cos(0.1), sideways * WIDTH)
    corner = d - cmath.rect(WIDTH * math.sqrt(0.5), 0.1)
    n, found = points(d.real, d.imag, 0.0, 0.25 * math.pi + 0.1, 0.02 * WIDTH)
    assert abs(n - 1.0) < 1e-12
    ((found_gap, arm, _),) = found.values()
    assert found_gap == pytest.approx(gap, abs=TINY)
    assert arm.imag == pytest.approx(corner.imag, abs=TINY)
    assert cross(arm, n) == pytest.approx(-corner.imag, abs=TINY)


@many
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.1, 10.0))
def test_a_point_is_as_far_from_a_circular_wall_as_it_is_from_the_circle(u, v, radius):
    assume(math.hypot(u, v) > 1e-9)
    gap, nx, ny = circle_corner(u * radius, v * radius, radius)
    assert gap == pytest.approx(radius * (1.0 - math.hypot(u, v)), abs=1e-14 * radius)
    assert math.hypot(nx, ny) == pytest.approx(1.0, abs=1e-15)
    assert (u * nx + v * ny) == pytest.approx(math.hypot(u, v), rel=1e-14)


def test_the_centre_of_a_circular_wall_has_some_normal():
    gap, nx, ny = circle_corner(0.0, 0.0, 0.5)
    assert gap == 0.5
    assert math.hypot(nx, ny) == 1.0


@settings(deadline=None, max_examples=60)
@given(st.floats(-math.pi, math.pi), turns, st.floats(-0.05, 0.05), st.booleans())
def test_wall_rows_are_the_corners_near_the_wall(direction, angle, depth, circle):
    """Gaps, normals and lever arms of a tile at rest, its farthest corner at the wall."""
    half = (0.1, 0.08)
    reactor = (Reactor("circle", 0.1) if circle
               else Reactor("rectangle", width=2 * half[0], height=2 * half[1]))
    shape = {"radius": 0.1} if circle else {"half": half}
    low, high = 0.0, 0.2
    for _ in range(60):  # the way to where the farthest corner is `depth` beyond the wall
        way = 0.5 * (low + high)
        z = cmath.rect(way, direction)
        gaps = [gap for _, gap, *_ in wall_points(z.real, z.imag, angle, WIDTH, 1.0, **shape)]
        low, high = (low, way) if min(gaps) < -depth * WIDTH else (way, high)
    expected = wall_points(z.real, z.imag, angle, WIDTH, SPARE * WIDTH, **shape)
    every = wall_points(z.real, z.imag, angle, WIDTH, 1.0, **shape)
    assume(all(abs(gap - SPARE * WIDTH) > TINY for _, gap, *_ in every))
    one = np.array([0.0])
    layout = Layout(one + z.real, one + z.imag, one + angle, one, one, one, np.array([0]),
                    np.array([False]), np.array([False]))
    rows = contact_rows(Simulation(scene([tile()], reactor=reactor), layout))
    assert (rows["a"] == 0).all()
    assert (rows["b"] == 1).all()  # the ground
    if circle:  # a row for each corner
        assert list(rows["id0"]) == [name for name, *_ in expected]
        assert (rows["count"] == 1).all()
        for i, (_, gap, n, arm) in enumerate(expected):
            assert rows["gap0"][i] == pytest.approx(gap, abs=TINY)
            assert complex(rows["nx"][i], rows["ny"][i]) == pytest.approx(n, abs=1e-12)
            assert rows["an0"][i] == pytest.approx(cross(arm, n), abs=TINY)
            assert rows["at"][i] == pytest.approx(dot(arm, n), abs=TINY)
            assert rows["bn0"][i] == rows["bt"][i] == 0.0
        return
    # A row for each side, in the order of the directions that they look in: W, S, E, N.
    sides = [n for n in (-1, -1j, 1, 1j) if any(other == n for _, _, other, _ in expected)]
    assert [complex(*n) for n in zip(rows["nx"], rows["ny"], strict=True)] == sides
    for i, side in enumerate(sides):
        points = sorted((cross(arm, n), gap, dot(arm, n)) for _, gap, n, arm in expected
                        if n == side)
        assert rows["count"][i] == len(points)
        found = sorted((rows[f"an{q}"][i], rows[f"gap{q}"][i]) for q in range(len(points)))
        assert np.array(found) == pytest.approx(np.array([p[:2] for p in points]), abs=TINY)
        # Friction acts midway between the wall and the nearest corner.
        _, gap, arm = min(points, key=lambda point: point[1])
        assert rows["at"][i] == pytest.approx(arm + 0.5 * gap, abs=TINY)
