"""Exact forces of permanent magnets: against magpylib's fields, brute force and superposition."""

import math
from time import perf_counter

import magpylib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.constants import mu_0
from scipy.integrate import quad
from scipy.special import j1

from theory.permanent import coaxial_cuboids, coaxial_cylinders, discs, parallel_cuboids

J = 1.3  # T
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(40)


# Values of the literature and of an independent package.


@pytest.mark.parametrize(("height", "newton"), [((0.04, 0.04), 265.537), ((0.02, 0.01), 18.953)])
def test_coaxial_cylinders_have_the_quoted_forces(height, newton):
    assert coaxial_cylinders(0.05, 0.02, height, J) == pytest.approx(newton, abs=5e-4)


def test_two_cubes_have_the_quoted_force():
    force = parallel_cuboids([0, 0, 0.1], [0.04] * 3, [0.04] * 3, J)
    assert force == pytest.approx([0, 0, -25.681], abs=5e-4)


@pytest.mark.parametrize(("distance", "radius", "height"), [
    (0.05, 0.02, (0.04, 0.04)), (0.05, 0.02, (0.02, 0.01)), (0.012, 0.0015, (0.003, 0.003)),
    (0.0045, 0.002, (0.003, 0.004)), (0.1, 0.01, (0.002, 0.05))])
def test_cylinders_agree_with_magpylib(distance, radius, height):
    """The field of one over the charged faces of the other."""
    source = magpylib.magnet.Cylinder(polarization=(0, 0, J), dimension=(2 * radius, height[0]))
    rho = 0.5 * radius * (1 + POINTS)
    force = 0.0
    for sign in (1, -1):
        z = distance + 0.5 * sign * height[1]
        field = source.getB(np.stack([rho, 0 * rho, 0 * rho + z], axis=1))[:, 2]
        force += sign * J / mu_0 * np.sum(0.5 * radius * WEIGHTS * 2 * np.pi * rho * field)
    assert coaxial_cylinders(distance, radius, height, J) == pytest.approx(-force, rel=1e-6)


@pytest.mark.parametrize("distance", [(0, 0, 0.1), (0.01, -0.02, 0.06), (0.05, 0.0, 0.01),
                                      (0.0, 0.03, 0.045), (-0.06, -0.05, -0.03)])
@pytest.mark.parametrize("sizes", [((0.04,) * 3, (0.04,) * 3),
                                   ((0.04, 0.03, 0.02), (0.02, 0.02, 0.015))])
def test_cuboids_agree_with_magpylib(distance, sizes):
    source = magpylib.magnet.Cuboid(polarization=(0, 0, J), dimension=sizes[0])
    a, b, c = sizes[1]
    x, y = np.meshgrid(distance[0] + 0.5 * a * POINTS, distance[1] + 0.5 * b * POINTS)
    weight = 0.25 * a * b * np.outer(WEIGHTS, WEIGHTS)
    force = np.zeros(3)
    for sign in (1, -1):
        at = np.stack([x, y, np.full_like(x, distance[2] + 0.5 * sign * c)], axis=-1)
        force += sign * J / mu_0 * np.einsum("ijk,ij->k", source.getB(at), weight)
    made = parallel_cuboids(distance, *sizes, J)
    assert made == pytest.approx(force, rel=1e-6, abs=1e-7 * np.linalg.norm(force))


# What must hold of any such force.


@pytest.mark.parametrize("gap", [0.05, 0.3, 0.99, 1.01, 2.5, 8.0])
def test_two_discs_are_the_integral_over_bessel_functions(gap):
    brute = quad(lambda q: j1(q) ** 2 * math.exp(-gap * q) / q, 0, 40 / gap, limit=2000,
                 epsabs=1e-14, epsrel=1e-12)[0]
    assert discs(gap) == pytest.approx(brute, rel=1e-10)


def test_the_two_ways_to_compute_discs_meet():
    assert discs(1 - 1e-13) == pytest.approx(discs(1.0), rel=1e-12)
    assert discs(0.0) == 0.5
    assert discs(1e6) == pytest.approx(0.25e-12, rel=1e-10)


def test_many_discs_are_as_each_alone():
    gap = np.random.default_rng(1).uniform(0.0, 3.0, (1500, 2))
    together = discs(gap)
    assert together.shape == gap.shape
    assert np.array_equal(together[::100].ravel(), [float(discs(g)) for g in gap[::100].ravel()])
    assert discs(0.5).shape == ()
    assert discs(np.zeros((0, 4))).shape == (0, 4)


def test_distant_discs_take_no_more_than_some_times_what_near_ones_do():
    def least(gap):
        times = []
        for _ in range(20):
            begun = perf_counter()
            discs(gap)
            times.append(perf_counter() - begun)
        return min(times)

    near = np.linspace(0.01, 0.99, 20_000)
    assert least(near + 2) < 8 * least(near)


def test_long_cylinders_in_contact_pull_like_two_charged_plates():
    """Maxwell's pressure J^2/(2 mu_0) over the area."""
    assert coaxial_cylinders(10.0, 0.001, 10.0, J) == pytest.approx(
        np.pi * 0.001**2 * J**2 / (2 * mu_0), rel=1e-6)


def test_far_magnets_are_dipoles():
    """F = 3 mu_0 m^2/(2 pi z^4), m = J V/mu_0."""
    size, z = 0.005, np.array([0.15, 0.3])
    dipoles = 3 * (J * size**3) ** 2 / (2 * np.pi * mu_0 * z**4)
    at = np.stack([0 * z, 0 * z, z], axis=-1)
    assert -parallel_cuboids(at, [size] * 3, [size] * 3, J)[:, 2] == pytest.approx(
        dipoles, rel=1e-3)
    assert coaxial_cylinders(z, size / 2, size, J) == pytest.approx(
        dipoles * (np.pi / 4) ** 2, rel=2e-3)


lengths = st.floats(1e-3, 0.05)


@given(lengths, lengths, lengths, st.floats(0, 0.1), st.floats(0.1, 0.9))
@settings(deadline=None, max_examples=100)
def test_a_cylinder_pulls_as_its_two_parts_do(radius, a, b, gap, part):
    z = gap + 0.5 * (a + b)
    lower, upper = part * b, (1 - part) * b
    whole = coaxial_cylinders(z, radius, (a, b))
    cut = (coaxial_cylinders(gap + 0.5 * (a + lower), radius, (a, lower))
           + coaxial_cylinders(gap + lower + 0.5 * (a + upper), radius, (a, upper)))
    assert whole == pytest.approx(cut, rel=1e-9, abs=1e-9)
    assert whole == pytest.approx(coaxial_cylinders(z, radius, (b, a)), rel=1e-12)


@given(st.tuples(lengths, lengths, lengths), st.tuples(lengths, lengths, lengths),
       st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0, 0.1)),
       st.floats(0.1, 0.9), st.integers(0, 2))
@settings(deadline=None, max_examples=100)
def test_a_cuboid_pushes_as_its_two_parts_do(a, b, apart, part, axis):
    a, b = np.array(a), np.array(b)
    at = np.array([*apart[:2], apart[2] + 0.5 * (a[2] + b[2])])
    whole = parallel_cuboids(at, a, b)
    cut = np.zeros(3)
    for share, side in ((part, -1), (1 - part, +1)):
        piece, place = b.copy(), at.copy()
        piece[axis] *= share
        place[axis] += 0.5 * side * (1 - share) * b[axis]
        cut += parallel_cuboids(place, a, piece)
    assert whole == pytest.approx(cut, abs=1e-8 + 1e-7 * np.linalg.norm(whole))
    assert parallel_cuboids(-at, b, a) == pytest.approx(
        -whole, abs=1e-9 + 1e-9 * np.linalg.norm(whole))  # action and reaction


@given(st.tuples(lengths, lengths, lengths), st.integers(0, 2))
@settings(deadline=None, max_examples=50)
def test_equal_cuboids_push_as_ones_that_hardly_differ(size, axis):
    """Where edges are equal, corners that lie in one place are taken as one."""
    other = np.array(size)
    other[axis] *= 1.0 + 1e-9
    at = np.array([0.3, -0.2, 1.5]) * size
    force = parallel_cuboids(at, size, size)
    assert parallel_cuboids(at, size, other) == pytest.approx(
        force, abs=1e-7 * np.linalg.norm(force))


# Faces closer than 1e-12 of the size count as touching in one of the two.
@given(lengths, lengths, st.just(0.0) | st.floats(1e-9, 3.0))
@settings(deadline=None, max_examples=100)
def test_equal_cuboids_on_one_axis_are_the_same_by_both_ways(side, height, gap):
    z = height + gap * np.array([[0.0, 0.5, 1.0]]) * (side + height)
    size, at = (side, side, height), np.stack((0 * z, 0 * z, z), axis=-1)
    force = coaxial_cuboids(z, side, height, J)
    assert force.shape == z.shape
    # Both are sums of terms that cancel.
    terms = J**2 / (np.pi * mu_0) * (np.max(z) + side + height) ** 2
    assert force == pytest.approx(-parallel_cuboids(at, size, size, J)[..., 2], abs=1e-14 * terms)


@pytest.mark.parametrize("height", [1e-4, 1e-3, 1e-2])
def test_far_cuboids_keep_their_digits(height):
    """Against the mean force of two dipoles in any two of their places, which does not cancel."""
    side = 1e-3
    diagonal = math.hypot(math.sqrt(2) * side, height)
    z = diagonal * np.array([2.0, 2.4, 2.6, 5.0, 30.0, 1e3, 1e5])
    node, weight = np.polynomial.legendre.leggauss(16)
    node, weight = 0.5 * (node + 1), 0.5 * weight * (1 - node)  # of differences of places
    t, of_t = np.append(node, -node), np.append(weight, weight) / 2
    u, v, w = side * node[:, None, None], side * node[:, None], height * t
    way = z[:, None, None, None] + w
    r = np.sqrt(u * u + v * v + way * way)
    share = weight[:, None, None] * weight[:, None] * of_t
    mean = np.sum(share * (15 * way**3 / r**7 - 9 * way / r**5), axis=(1, 2, 3))
    moment = J * side**2 * height
    assert coaxial_cuboids(z, side, height, J) == pytest.approx(
        moment**2 / (4 * math.pi * mu_0) * mean, rel=1e-8, abs=0.0)


def test_a_cube_and_a_cylinder_of_one_area_pull_alike():
    side, radius = 0.01, 0.01 / math.sqrt(math.pi)
    cube = -parallel_cuboids([0, 0, 0.03], [side] * 3, [side] * 3)[2]
    assert coaxial_cylinders(0.03, radius, side) == pytest.approx(cube, rel=0.01)


def test_arrays_keep_their_shape_and_force_falls_with_distance():
    z = np.linspace(0.01, 0.1, 12)
    force = coaxial_cylinders(z.reshape(3, 4), 0.004, 0.01)
    assert force.shape == (3, 4)
    assert np.all(np.diff(force.ravel()) < 0)
    at = np.full((2, 5, 3), 0.1)
    assert parallel_cuboids(at, [0.01] * 3, [0.02] * 3).shape == at.shape


def test_force_goes_with_the_square_of_the_polarisation():
    assert coaxial_cylinders(0.02, 0.005, 0.01, 1.4) == pytest.approx(
        4 * coaxial_cylinders(0.02, 0.005, 0.01, 0.7), rel=1e-14)


@pytest.mark.parametrize(("radius", "height"), [(-1e-3, 2e-3), (0.0, 2e-3), (1e-3, -2e-3),
                                                (1e-3, (2e-3, -1e-3)), (float("nan"), 2e-3)])
def test_cylinders_of_no_size_are_refused(radius, height):
    with pytest.raises(ValueError, match="radius and height must be positive"):
        coaxial_cylinders(0.01, radius, height)


def test_cuboids_that_overlap_are_refused_and_those_that_touch_are_not():
    size = (2e-3, 2e-3, 4e-3)
    for inside in ((0.0, 0.0, 3.9e-3), (1.9e-3, 0.0, 0.0), (1e-3, -1e-3, -1e-3)):
        for distance in (inside, [inside, (0.0, 0.0, 1.0)]):
            with pytest.raises(ValueError, match="must not overlap"):
                parallel_cuboids(distance, size, size)
    for beside in ((0.0, 0.0, 4e-3), (2e-3, 0.0, 0.0), (1e-3, -2e-3, 1e-3)):
        assert np.all(np.isfinite(parallel_cuboids(beside, size, size)))
    with pytest.raises(ValueError, match="edges must be at least 0"):
        parallel_cuboids((0.0, 0.0, 0.01), size, (2e-3, -2e-3, 4e-3))


@pytest.mark.parametrize(("side", "height"), [(0.0, 2e-3), (-1e-3, 2e-3), (1e-3, -1e-3)])
def test_cuboids_on_one_axis_of_no_size_are_refused(side, height):
    with pytest.raises(ValueError, match="side and height must be positive"):
        coaxial_cuboids(0.01, side, height)


def test_cuboids_on_one_axis_that_overlap_are_refused():
    with pytest.raises(ValueError, match=r"at least the height, 0\.01 m"):
        coaxial_cuboids([0.02, 0.009], 0.005, 0.01)
    assert coaxial_cuboids(0.1 + 0.01 - 0.1, 0.005, 0.01) > 0.0  # touching, but for rounding


def test_cylinders_that_overlap_are_refused():
    with pytest.raises(ValueError, match="at least the mean height"):
        coaxial_cylinders(0.009, 0.005, 0.01)


@pytest.mark.parametrize("height", [0.007, 0.011, 0.013, 0.1])
def test_cuboids_in_contact_pull_as_just_before(height):
    for z, side in ((height, 1), (-height, -1), (0.1 + height - 0.1, 1)):  # the last is rounded
        touching = parallel_cuboids([0.001, 0, z], [0.01, 0.01, height], [0.01, 0.01, height])
        near = parallel_cuboids([0.001, 0, z + side * 1e-9], [0.01, 0.01, height],
                                [0.01, 0.01, height])
        assert touching == pytest.approx(near, rel=1e-5, abs=1e-6)
