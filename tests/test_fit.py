"""The fit of magnet models: theory/fit.py, the command `tbsa fit`, and what it refuses."""

import errno
import itertools
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.constants import mu_0
from scipy.optimize import brentq, curve_fit, least_squares, minimize_scalar

import tbsa
from tbsa.errors import InputError
from tbsa.model.scene import LARGEST
from tbsa.work import cli
from tbsa.work import fit as work
from tbsa.work.cli import main
from tbsa.work.measurements import quantity, read
from theory import fit as fitting
from theory.fit import (
    bootstrap,
    doubts,
    fit,
    halves,
    interval,
    intervals,
    models,
    profile,
    runs_test,
)
from theory.magnets import Law
from theory.magnets import force as magnet_force
from theory.permanent import coaxial_cylinders, parallel_cuboids

ROOT = Path(__file__).parents[1]
LIGO = ROOT / "paper_runs" / "ligo_40m_magnets.csv"
ALPHA, BETA = 1.8e-5, 6.4e-3
LAW = models()["law"]
R = np.linspace(3e-3, 30e-3, 15)
TRUE = LAW.force(R, ALPHA, BETA)


def ligo(above, weighted):
    """The law fitted to the LIGO data beyond a distance (cm)."""
    data = read(LIGO)
    use = data.distance > above / 100
    return fit(LAW, data.distance[use], data.force[use], data.sd[use] if weighted else None)


# ---------------------------------------------------------------------------------------------
# The real data.


@pytest.mark.parametrize(("above", "weighted", "alpha", "beta"), [
    (0.5, False, (3.68, 0.46), (0.543, 0.084)),
    (1.0, False, (2.07, 0.14), (0.086, 0.043)),
    (0.5, True, (2.29, 0.20), (0.165, 0.060)),
])
def test_the_ligo_data_give_the_quoted_fits(above, weighted, alpha, beta):
    """Values and standard errors in N cm^2 and cm, to their last digit."""
    found = ligo(above, weighted)
    assert found.values * [1e4, 100] == pytest.approx([alpha[0], beta[0]], abs=[5e-3, 5e-4][0])
    assert 100 * found.values[1] == pytest.approx(beta[0], abs=5e-4)
    assert 1e4 * found.errors[0] == pytest.approx(alpha[1], abs=5e-3)
    assert 100 * found.errors[1] == pytest.approx(beta[1], abs=5e-4)
    if weighted:
        assert found.chi2 / found.dof == pytest.approx(142, abs=0.5)


def test_the_ligo_data_are_those_of_the_source():
    data = read(LIGO)
    assert data.kind == "gap"
    assert data.distance.size == 17
    assert (data.distance[[0, 7, 16]] == pytest.approx([0, 0.0101, 0.0231]))
    assert (data.force[[0, 7, 16]] == pytest.approx([2.95, 1.69, 0.301]))
    assert (data.sd[[0, 7, 16]] == pytest.approx([0.105, 0.00559, 0.0073]))
    assert np.sum(data.force) == pytest.approx(27.827)
    assert np.sum(data.sd) == pytest.approx(0.49321)


def test_the_law_is_only_local_on_the_ligo_data():
    """Chi^2, the signs of the residuals and the two halves all say so."""
    found = ligo(0.5, True)
    assert found.p_value < 1e-100
    assert runs_test(found.residuals).p_value < 0.01
    parts = halves(found)
    assert parts.p_value < 0.01
    assert parts.near.values[0] > 1.5 * parts.far.values[0]


def test_exact_magnets_describe_the_ligo_data_better_than_the_law():
    data = read(LIGO)
    use = data.distance > 0.005
    made = models("gap")
    law, cylinder = (fit(made[name], data.distance[use], data.force[use], data.sd[use])
                     for name in ("law", "cylinder"))
    assert cylinder.aicc < law.aicc - 10
    assert cylinder.chi2 / cylinder.dof > 10  # and still not within their uncertainty


def test_no_ideal_cylinder_gives_the_papers_pair():
    """Fits of the law, r the gap or the centre distance, to cylinders of 2 to 12 mm."""
    misses = []
    for diameter, height in itertools.product(np.arange(2, 13, 2) * 1e-3, repeat=2):
        for r in (np.linspace(0, 0.03, 20), np.linspace(height, 0.03, 20)):
            z = r + height if r[0] == 0 else r
            found = fit(LAW, r, coaxial_cylinders(z, diameter / 2, height, 1.3), starts=1)
            misses.append(np.max(np.abs(found.values / [ALPHA, BETA] - 1)))
    assert min(misses) > 0.35


# ---------------------------------------------------------------------------------------------
# Least squares.


@pytest.mark.parametrize("name", ["law", "power", "cylinder", "cuboid"])
@pytest.mark.parametrize("kind", ["centre", "gap"])
def test_exact_forces_give_their_parameters_back(name, kind):
    values = {"law": (ALPHA, BETA), "power": (0.4, 2.7), "cylinder": (1.2, 4e-3, 6e-3),
              "cuboid": (0.9, 6e-3, 5e-3)}[name]
    model = models(kind, 1.5e-3, 8e-3)[name]
    d = np.linspace(8e-3, 40e-3, 20)
    found = fit(model, d, model.force(d, *values))
    assert found.values == pytest.approx(values, rel=1e-3)
    assert np.max(np.abs(found.residuals)) < 1e-6 * found.force[0]


def charged_faces(z, side, height, polarisation):
    """Attraction (N) of two cuboids whose centres are z (m, shape [n]) apart: their charged faces,
    point by point (Gauss), which cancels far less than a sum of integrals."""
    x, w = np.polynomial.legendre.leggauss(6)
    across = 0.25 * side**2 * (x[:, None] - x) ** 2  # between two points along x, or along y
    share = np.multiply.outer(np.outer(w, w), np.outer(w, w)) / 16
    square = across[:, :, None, None] + across
    def push(gap):
        return np.array([np.sum(share * g / (square + g**2) ** 1.5) for g in gap])
    total = 2 * push(z) - push(z - height) - push(z + height)
    return -total * (polarisation * side**2) ** 2 / (4 * np.pi * mu_0)


@pytest.mark.slow
def test_fits_of_small_cuboids_are_those_of_forces_without_rounding():
    """Of magnets of 1 mm at up to 6 cm the force is rounded to 5e-6 of it."""
    model = models("gap")["cuboid"]
    exact = model._replace(force=lambda d, polarisation, side, height: charged_faces(
        d + height, side, height, polarisation))
    near, far = np.linspace(1e-3, 15e-3, 8), np.linspace(2e-3, 35e-3, 12)
    assert model.force(near, 1.2, 1.5e-3, 2e-3) == pytest.approx(
        exact.force(near, 1.2, 1.5e-3, 2e-3), rel=1e-6)
    for d, side, height in ((far, 1.5e-3, 2e-3), (far, 1e-3, 1e-3), (1.7 * far, 1e-3, 1e-3)):
        true = exact.force(d, 1.2, side, height)
        for seed in range(2):
            force = true * (1 + 0.02 * np.random.default_rng(seed).standard_normal(d.size))
            found, best = (fit(each, d, force, 0.02 * true, fixed={"polarisation": 1.2}, starts=2)
                           for each in (model, exact))
            assert found.chi2 == pytest.approx(best.chi2, rel=1e-2)
            assert np.all(np.abs(found.values - best.values) <= 0.05 * best.errors)


def test_gap_and_centre_distance_differ_by_the_inset_or_the_height():
    gap, centre = models("gap", 1.5e-3), models("centre")
    assert gap["law"].force(R, ALPHA, BETA) == pytest.approx(
        centre["law"].force(R + 3e-3, ALPHA, BETA))
    assert gap["power"].force(R, 1.0, 2.0) == pytest.approx(
        centre["power"].force(R + 3e-3, 1.0, 2.0))
    assert gap["cylinder"].force(R, 1.3, 2e-3, 5e-3) == pytest.approx(
        coaxial_cylinders(R + 5e-3, 2e-3, 5e-3, 1.3))
    at = np.stack([0 * R, 0 * R, R + 5e-3], axis=-1)
    assert gap["cuboid"].force(R, 1.3, 4e-3, 5e-3) == pytest.approx(
        -parallel_cuboids(at, [4e-3, 4e-3, 5e-3], [4e-3, 4e-3, 5e-3], 1.3)[:, 2])
    with pytest.raises(ValueError, match="must be"):
        models("edge")


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("absolute", [False, True])
def test_values_and_covariance_are_those_of_scipys_curve_fit(weighted, absolute):
    rng = np.random.default_rng(3)
    sd = 0.02 * TRUE + 1e-3
    force = TRUE + sd * rng.standard_normal(R.size)
    found = fit(LAW, R, force, sd if weighted else None, absolute=absolute)
    values, covariance = curve_fit(
        LAW.force, R, force, p0=(1e-5, 5e-3), sigma=sd if weighted else None,
        absolute_sigma=absolute and weighted, method="trf", x_scale=(1e-5, 1e-3), xtol=1e-12,
        ftol=1e-12)
    assert found.values == pytest.approx(values, rel=1e-5)
    assert found.covariance == pytest.approx(covariance, rel=1e-3)
    assert found.correlation[0, 1] == pytest.approx(
        covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-3)


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "huber", "cauchy"])
def test_only_the_ratios_of_the_uncertainties_count_unless_they_are_absolute(loss):
    rng = np.random.default_rng(4)
    force = TRUE * (1 + 0.02 * rng.standard_normal(R.size))
    one, ten = (fit(LAW, R, force, k * 0.02 * TRUE, loss=loss) for k in (1, 10))
    assert ten.errors == pytest.approx(one.errors, rel=1e-6)
    one, ten = (fit(LAW, R, force, k * 0.02 * TRUE, loss=loss, absolute=True) for k in (1, 10))
    rel = 1e-6 if loss == "linear" else 0.1  # the threshold is in uncertainties, the optimum moves
    assert ten.errors == pytest.approx(10 * one.errors, rel=rel)
    if loss == "linear":
        ends = [bootstrap(each, number=200)["alpha"] for each in (one, ten)]
        assert np.ptp(ends[1]) == pytest.approx(10 * np.ptp(ends[0]), rel=0.35)


def test_absolute_errors_of_a_robust_loss_are_wider_by_its_efficiency():
    """For normal residuals Huber's estimate at 1.345 sd is 95 % as efficient as least squares."""
    linear, huber = (fit(LAW, R, TRUE + 1e-9 * np.sin(1e4 * R), 0.02 * TRUE, loss=loss,
                         absolute=True) for loss in ("linear", "huber"))
    assert (linear.errors / huber.errors) ** 2 == pytest.approx(0.95, abs=1e-3)


@pytest.mark.parametrize("loss", ["soft_l1", "huber", "cauchy"])
def test_a_robust_loss_makes_little_of_an_outlier(loss):
    rng = np.random.default_rng(5)
    force = TRUE + 1e-3 * rng.standard_normal(R.size)
    clean = fit(LAW, R, force)
    force[5] += 0.1
    plain, robust = fit(LAW, R, force), fit(LAW, R, force, loss=loss)
    assert np.all(np.abs(robust.values - clean.values) < 1.5 * clean.errors)
    assert np.all(np.abs(robust.values - clean.values) < 0.3 * np.abs(plain.values - clean.values))
    assert np.all(robust.errors < 0.5 * plain.errors)
    assert np.isnan(robust.aicc)
    for method in ("profile", "bootstrap"):
        with pytest.raises(ValueError, match=f"a {method} needs loss linear: .*; use normal"):
            interval(robust, "alpha", method)


# Twelve points of the law at gaps of 1 to 20 mm, 2 % of scatter, of which two were then multiplied.
SPOILT = {
    "cauchy": [0.52335, 0.12296, 0.092177, 0.072562, 0.061701, 0.046847, 0.04141,
               0.035971, 0.030287, 0.026967, 0.06889, 0.020774],
    "huber": [1.7086, 0.12661, 0.092734, 0.074251, 0.058355, 0.49472, 0.042493,
              0.035523, 0.03034, 0.025987, 0.023679, 0.021157],
    "soft_l1": [1.7165, 0.12609, 0.092998, 0.074121, 0.060841, 0.048704, 0.043245,
                0.034858, 0.030259, 0.025271, 0.024226, 0.062567],
}


@pytest.mark.parametrize("loss", SPOILT)
def test_two_outliers_do_not_hold_a_robust_fit_at_a_curve_of_their_own(loss):
    """From the plain fit alone it goes to where the other points seem scattered, and stays."""
    d = np.linspace(1e-3, 20e-3, 12)
    model = models("gap", 1.5e-3)["law"]
    sd = 0.02 * model.force(d, ALPHA, BETA)
    found = fit(model, d, SPOILT[loss], sd, loss=loss)
    assert found.values == pytest.approx([ALPHA, BETA], rel=0.15)


def test_of_two_robust_fits_the_one_of_the_least_scatter_is_kept(monkeypatch):
    """Of absolute uncertainties, whose threshold is known, the one of the least loss."""
    d = np.linspace(1e-3, 20e-3, 12)
    model = models("gap", 1.5e-3)["law"]
    sd = 0.02 * model.force(d, ALPHA, BETA)
    begun = fitting._robust
    for absolute, size in ((False, lambda each: each.scale), (True, fitting._loss)):
        found = []
        monkeypatch.setattr(fitting, "_robust",
                            lambda *given, found=found: found.append(begun(*given)) or found[-1])
        kept = fit(model, d, SPOILT["cauchy"], sd, loss="cauchy", absolute=absolute)
        sizes = [size(each) for each in found]
        assert absolute or max(sizes) > 5 * min(sizes)
        assert size(kept) == min(sizes)


def test_the_losses_are_scipys():
    """rho, and its derivatives by finite differences, against what least_squares makes least."""
    z = np.array([1e-3, 0.2, 0.9, 1.1, 5.0, 200.0])
    for name, loss in fitting.LOSSES.items():
        cost = [least_squares(lambda _, each=each: [each], [0.0], loss=name, max_nfev=1).cost
                for each in np.sqrt(z)]
        assert loss.rho(z) == pytest.approx(2 * np.array(cost), rel=1e-12)
        h = 1e-5 * z
        assert loss.first(z) == pytest.approx((loss.rho(z + h) - loss.rho(z - h)) / (2 * h),
                                              rel=1e-6)
        assert loss.second(z) == pytest.approx((loss.first(z + h) - loss.first(z - h)) / (2 * h),
                                               rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("loss", ["soft_l1", "cauchy"])
def test_standard_errors_of_a_robust_loss_are_the_scatter_of_its_fits(loss):
    rng = np.random.default_rng(6)
    found = [fit(LAW, R, TRUE + 2e-3 * rng.standard_t(3, R.size), loss=loss, starts=1)
             for _ in range(60)]
    scatter = np.std([each.values for each in found], axis=0)
    mean = np.median([each.errors for each in found], axis=0)
    assert np.all((mean / scatter > 0.7) & (mean / scatter < 1.4))


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e3])
def test_the_size_of_the_forces_does_not_matter(scale):
    force = TRUE * (1.0 + 0.02 * np.random.default_rng(3).standard_normal(R.size))
    whole, scaled = fit(LAW, R, force), fit(LAW, R, scale * force)
    assert scaled.values / [scale, 1.0] == pytest.approx(whole.values, rel=1e-5)
    assert scaled.errors / [scale, 1.0] == pytest.approx(whole.errors, rel=1e-4)
    assert len(doubts(scaled, {})) == len(doubts(whole, {}))


def test_bounds_and_fixed_values_hold():
    free = fit(LAW, R, TRUE)
    assert free.values == pytest.approx([ALPHA, BETA], rel=1e-6)
    bound = fit(LAW, R, TRUE, bounds={"beta": (None, 5e-3)})
    assert bound.values[1] == pytest.approx(5e-3, rel=1e-6)
    assert any("upper bound" in doubt for doubt in doubts(bound, {}))
    fixed = fit(LAW, R, TRUE, fixed={"beta": 5e-3})
    assert fixed.values[1] == 5e-3
    assert fixed.errors[1] == 0
    assert fixed.dof == R.size - 1
    weight = 1 / (R + 5e-3) ** 2
    assert fixed.values[0] == pytest.approx(np.sum(weight * TRUE) / np.sum(weight**2), rel=1e-9)


@pytest.mark.parametrize("most", [5e-3, 1e-15])
def test_errors_beside_a_parameter_at_its_bound_are_those_with_it_held_there(most):
    """However narrow the bounds are, which says nothing about what the points tell apart."""
    bound = fit(LAW, R, TRUE, bounds={"beta": (0.0, most)})
    held = fit(LAW, R, TRUE, fixed={"beta": most})
    assert bound.at_bound.tolist() == [0, 1]
    assert bound.inside.errors == pytest.approx(held.errors, rel=1e-6)
    assert interval(bound, "alpha", "normal") == pytest.approx(
        interval(held, "alpha", "normal"), rel=1e-6)
    low, high = interval(bound, "beta", "normal")
    assert 0 <= low < high == most
    (doubt,) = doubts(bound, {})
    assert doubt.startswith(f"beta is at its upper bound, {most:g} m, and has no standard error; ")


def test_a_parameter_that_a_bound_cuts_off_is_not_called_unbounded_by_the_data():
    bound = fit(LAW, R, TRUE, bounds={"beta": (None, 5e-3)})
    ends = {name: interval(bound, name) for name in ("alpha", "beta")}
    assert 0 < ends["beta"][0] < ends["beta"][1] == 5e-3
    assert not any("identified" in doubt for doubt in doubts(bound, ends))


def test_an_amplitude_that_its_bounds_cut_off_is_not_called_unbounded_by_the_data():
    force = TRUE * (1 + 0.03 * np.random.default_rng(3).standard_normal(R.size))
    free = fit(LAW, R, force)
    low, high = free.values[0] + np.array([-0.5, 0.5]) * free.errors[0]
    for bounds in ((low, None), (None, high), (low, high)):
        bound = fit(LAW, R, force, bounds={"alpha": bounds})
        ends = intervals(bound)
        assert any(end in bounds for end in ends["alpha"])
        assert doubts(bound, ends) == doubts(free, intervals(free)) == []


def test_a_fit_with_every_parameter_at_its_bound_has_no_errors():
    found = fit(LAW, R, TRUE, bounds={"alpha": (None, ALPHA / 9), "beta": (BETA / 9, None)})
    assert found.at_bound.tolist() == [1, -1]
    assert found.inside.errors.tolist() == [0, 0]
    ends = {name: interval(found, name, "normal") for name in ("alpha", "beta")}
    assert sum("bound, " in doubt for doubt in doubts(found, ends)) == 2


def waves(*shapes):
    """A model with many minima, and the shapes to start from."""
    return fitting.Model(
        "waves", "a (2 + sin(k d))",
        (fitting.Parameter("a", "N", 0, 10), fitting.Parameter("k", "", -100, 100)),
        lambda d, a, k: a * (2 + np.sin(k * d)), 1, lambda _: [(k,) for k in shapes])


def test_several_starts_find_what_one_misses(monkeypatch):
    best_first = fitting._starts
    monkeypatch.setattr(fitting, "_starts", lambda *given: best_first(*given)[::-1])
    d = np.linspace(0.0, 1.0, 30)
    model = waves(3.0, 10.0, 22.0, 40.0)
    force = model.force(d, 0.7, 23.0)
    assert fit(model, d, force, starts=4).values == pytest.approx([0.7, 23.0])
    assert fit(model, d, force, starts=1).chi2 > 1


@pytest.mark.parametrize("settings", [{"fixed": {"polarisation": 1.3}},
                                      {"bounds": {"polarisation": (1.3, 1.3 + 1e-9)}}])
@pytest.mark.parametrize("name", ["cylinder", "cuboid"])
def test_a_known_amplitude_leaves_the_best_starts_among_those_that_are_followed(name, settings):
    """Points that only flat and wide magnets come near: with 1.3 T no start of theirs does."""
    made = models("gap", 1.5e-3)
    d = np.linspace(1e-3, 25e-3, 12)
    force = made["law"].force(d, ALPHA, 9e-3)
    few, all_of_them = (fit(made[name], d, force, 0.02 * force, starts=starts, **settings)
                        for starts in (4, 16))
    assert few.chi2 == pytest.approx(all_of_them.chi2, rel=1e-6)
    assert few.values[1] > 100 * few.values[2]


FAR = np.array([[20, 36.25, 0.72], [23.33, 19.48, 0.4], [27.22, 10.61, 0.22], [31.75, 5.659, 0.12],
                [37.03, 3.26, 0.066], [43.2, 1.833, 0.036], [50.4, 0.9726, 0.019],
                [58.79, 0.5328, 0.011], [68.58, 0.2916, 0.0057], [80, 0.152, 0.0031]]) * 1e-3


def test_many_points_are_fitted_as_few_are():
    """Starts are compared by means of neighbours; what is followed to the end is all points."""
    rng = np.random.default_rng(6)
    d = rng.uniform(4e-3, 30e-3, 3 * fitting.ENOUGH)
    made = models("gap")
    true = made["cylinder"].force(d, 1.2, 4e-3, 3e-3)
    sd = true * rng.uniform(0.01, 0.1, d.size)
    force = true + sd * rng.standard_normal(d.size)
    for name in ("cylinder", "power"):
        found = fit(made[name], d, force, sd)
        assert found.force.size == d.size
        assert found.chi2 <= (1 + 1e-9) * min(
            fit(made[name], d, force, sd, starts=1).chi2,
            fitting._solve(replace(found, values=found.values * 1.05)).chi2)
    means = fitting._means(found)
    assert means.force.size == fitting.ENOUGH
    assert np.sum(means.weight**2) == pytest.approx(np.sum(found.weight**2))
    assert means.chi2 < found.chi2
    assert fitting._means(means) is means


def test_the_least_of_several_minima_is_found():
    """Points that a strong small cuboid fits to 14.39, a weak large one better."""
    made = models("centre", 0.0, 0.02)
    found = fit(made["cuboid"], *FAR.T)
    assert found.chi2 == pytest.approx(10.8473, abs=1e-3)
    assert found.values == pytest.approx([0.019167, 0.018460, 0.019635], rel=1e-3)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow)
                                          for k in (2, 3))])
@pytest.mark.parametrize("name", ["cylinder", "cuboid"])
def test_more_starts_lead_to_nothing_better(name, seed):
    rng, model = np.random.default_rng(seed), models("centre", 0.0, 0.02)[name]
    true = rng.uniform((0.5, 2e-3, 1e-3), (1.5, 1e-2, 1e-2))
    force = model.force(FAR[:, 0], *true)
    points = FAR[:, 0], force * (1.0 + 0.02 * rng.standard_normal(force.size)), 0.02 * force
    assert fit(model, *points).chi2 <= fit(model, *points, starts=16).chi2 * (1 + 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_small_magnets_are_found_by_points_that_go_far(seed):
    """As well as where their size is known, but for a valley that is flat to 1e-3 of chi^2."""
    d = np.geomspace(0.048, 1.22, 21)
    model = models("centre", 0.0, d[0])["cuboid"]
    force = model.force(d, 0.57, 7.3e-3, 2.5e-3)
    force = force + 3e-7 * np.random.default_rng(seed).standard_normal(d.size)
    small = fit(model, d, force, bounds={"side": (3e-3, 15e-3)})
    assert fit(model, d, force).chi2 <= small.chi2 * (1 + 2e-3)


# Cylinders of 1.2 T, 8 mm wide and 5 mm high, of which the first point is the most precise.
STIFF = np.array([[0, 20.34533], [1e-3, 10.84659], [2e-3, 6.95578], [3e-3, 4.69825],
                  [5e-3, 2.35177], [8e-3, 0.95681], [12e-3, 0.34945], [20e-3, 0.06740]])
PRECISE = [2e-5, 2e-7, 2e-9]


def stiff(precise):
    """Distances, forces and their uncertainties, 0.02 N but for the first."""
    return *STIFF.T, np.array([precise] + 7 * [0.02])


@pytest.mark.parametrize("ratio", [1, 1e3, 3e4, 1e5, 1e7])
@pytest.mark.parametrize("where", [0, 4])
def test_one_precise_point_does_not_keep_the_law_from_its_least_chi2(where, ratio):
    """Against the least over beta alone, each with its best alpha."""
    d, sd = STIFF[:, 0], np.full(8, 5e-3)
    sd[where] /= ratio
    force = LAW.force(d, ALPHA, 9.4e-3) + sd * np.random.default_rng(1).standard_normal(8)

    def chi2(beta):
        one = 1 / (d + beta) ** 2 / sd
        return np.sum((one * (one @ (force / sd)) / (one @ one) - force / sd) ** 2)

    found = fit(LAW, d, force, sd)
    best = minimize_scalar(chi2, bounds=(6e-3, 14e-3), method="bounded", options={"xatol": 1e-12})
    assert found.chi2 == pytest.approx(best.fun, rel=1e-6)
    assert found.values[1] == pytest.approx(best.x, rel=1e-5)
    assert not any("limit" in doubt for doubt in doubts(found, {}))


@pytest.mark.slow
@pytest.mark.parametrize("precise", PRECISE)
def test_one_precise_point_does_not_keep_cylinders_from_their_least_chi2(precise):
    """However precise it is: the curve goes through it, and the others say where else."""
    model = models("gap")["cylinder"]
    found = fit(model, *stiff(precise), absolute=True)
    assert found.chi2 == pytest.approx(1.304, abs=1e-3)
    assert found.values == pytest.approx([1.1967, 4.130e-3, 4.592e-3], rel=3e-4)
    ends = intervals(found)
    assert doubts(found, ends) == []
    assert ends["polarisation"] == pytest.approx((1.1910, 1.2029), abs=2e-4)


@pytest.mark.parametrize("precise", PRECISE)
@pytest.mark.parametrize("polarisation", [1.19, pytest.param(1.2, marks=pytest.mark.slow)])
def test_nor_does_it_where_their_polarisation_is_known(polarisation, precise):
    """Against the least over the radius alone, with the height of which the curve goes through it:
    no amplitude is free that could be left out of the search."""
    model, (d, force, sd) = models("gap")["cylinder"], stiff(precise)

    def through(radius):
        return brentq(lambda height: model.force(d[:1], polarisation, radius, height)[0] - force[0],
                      1e-4, 0.1, xtol=1e-16, rtol=1e-14)

    def chi2(radius):
        miss = (model.force(d, polarisation, radius, through(radius)) - force) / sd
        return np.sum(miss[1:] ** 2)

    best = minimize_scalar(chi2, bounds=(3.8e-3, 4.6e-3), method="bounded",
                           options={"xatol": 1e-11})
    found = fit(model, d, force, sd, fixed={"polarisation": polarisation}, absolute=True)
    assert found.chi2 == pytest.approx(best.fun, rel=1e-5)
    assert found.values[1:] == pytest.approx([best.x, through(best.x)], rel=1e-4)
    assert not any("limit" in doubt for doubt in doubts(found, {}))


@pytest.mark.parametrize("loss", ["linear", "huber"])
def test_a_search_that_ends_at_its_limit_is_told_of(monkeypatch, loss):
    force = TRUE * (1 + 0.02 * np.random.default_rng(2).standard_normal(R.size))
    assert not any("limit" in doubt for doubt in doubts(fit(LAW, R, force, loss=loss), {}))
    monkeypatch.setattr(fitting, "LIMIT", 1)
    said = doubts(fit(LAW, R, force, loss=loss), {})
    assert said[0].startswith("the search ended at its limit of 1 evaluations")


@pytest.mark.parametrize("top", [5e-3, 7e-3])
@pytest.mark.parametrize(("name", "across", "height"), [
    ("cylinder", 25e-3, 3e-3), ("cylinder", 40e-3, 2e-3), ("cylinder", 60e-3, 2e-3),
    ("cuboid", 40e-3, 2e-3), ("cuboid", 60e-3, 2e-3)])
def test_magnets_far_wider_than_the_points_go_are_found(name, across, height, top):
    """Of a known polarisation no search from a small one leads to them.  The least chi^2 is below
    that of the truth, which is 5.96."""
    model, d = models("gap")[name], np.linspace(1e-3, top, 12)
    force = model.force(d, 1.2, across, height)
    sd = np.full(12, 0.01 * force[0])
    noise = np.random.default_rng(0).standard_normal(12)
    found = fit(model, d, force + sd * noise, sd, fixed={"polarisation": 1.2})
    assert found.chi2 < np.sum(noise**2)


def test_a_profile_of_a_known_polarisation_reaches_beyond_its_other_minimum():
    """Cuboids of 10 mm that are slim fit, and flat ones of 13.5 mm; between them chi^2 passes."""
    model, d = models("gap")["cuboid"], np.linspace(1e-3, 7e-3, 12)
    force = model.force(d, 1.2, 10e-3, 20e-3)
    sd = np.full(12, 0.01 * force[0])
    found = fit(model, d, force + sd * np.random.default_rng(0).standard_normal(12), sd,
                fixed={"polarisation": 1.2})
    allowed = (found.quantile(0.95) * found.scale) ** 2
    low, high = interval(found, "side")
    assert [profile(found, "side", side) - found.chi2 < allowed
            for side in (10e-3, 11.5e-3, 13.5e-3)] == [True, False, True]
    assert low < found.values[1] < 11.5e-3 < 13.5e-3 < high
    assert profile(found, "side", high) - found.chi2 == pytest.approx(allowed, rel=1e-3)


def test_a_bound_without_an_end_is_none():
    made = models()["law"]
    force = made.force(R, ALPHA, BETA)
    assert fit(made, R, force, bounds={"beta": (0.0, np.inf), "alpha": (-np.inf, np.inf)}
               ).values == pytest.approx([ALPHA, BETA], rel=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("options", [{"fixed": {"alpha": 1e-170}},
                                     {"bounds": {"alpha": (1e-300, 1e-290)}}])
def test_a_force_that_is_next_to_nothing_tells_no_errors(options):
    made = models()["law"]
    found = fit(made, R, made.force(R, ALPHA, BETA), **options)
    assert not np.isfinite(found.errors[1])


def test_a_profile_of_what_is_no_parameter_or_beyond_its_bounds_is_an_error():
    made = models()["law"]
    found = fit(made, R, made.force(R, ALPHA, BETA), fixed={"alpha": ALPHA})
    for name, value, words in (("nope", 0.01, "nope is not a free parameter"),
                               ("alpha", ALPHA, "alpha is not a free parameter"),
                               ("beta", -1.0, "beta must be from 0 to 10, not -1")):
        with pytest.raises(ValueError, match=words):
            profile(found, name, value)


def test_parameters_that_fit_equally_well_are_counted():
    model = waves(-5.0, 5.0)
    even = model._replace(force=lambda d, a, k: a * (2 + np.cos(k * d)))
    d = np.linspace(0.0, 1.0, 30)
    found = fit(even, d, even.force(d, 0.7, 5.5) + 0.01 * np.sin(40 * d))
    assert found.optima == 2
    assert doubts(found, {})[0].startswith("2 different sets of parameters")


def test_what_cannot_be_fitted_is_an_error():
    for arguments, options, message in (
            ((LAW, R[:2], TRUE[:2]), {}, "2 points"),
            ((LAW, R[:5], TRUE), {}, "distance must be 15 finite numbers"),
            ((LAW, R, TRUE * np.nan), {}, "force must be 15 finite numbers"),
            ((LAW, -R, TRUE), {}, "distance must be at least 0, not -"),
            ((LAW, R, TRUE, TRUE * 0), {}, "sd must be positive"),
            ((LAW, R, TRUE), {"fixed": {"alpha": 1, "beta": 1}}, "at least one must be free"),
            ((LAW, R, TRUE), {"fixed": {"gamma": 1}}, "not a parameter of law"),
            ((LAW, R, TRUE), {"bounds": {"beta": (1, 0)}}, "rising order"),
            ((LAW, R, TRUE), {"fixed": {"beta": -1e-3}}, "beta must be from 0 to 10 m, not -0.001"),
            ((LAW, R, TRUE), {"fixed": {"alpha": np.nan}}, "alpha must be from"),
            ((models("gap")["cylinder"], R, TRUE), {"fixed": {"radius": 0.2}}, "radius must be"),
            ((LAW, R, TRUE), {"starts": 0}, "starts must be at least 1, not 0"),
            ((LAW, R, TRUE), {"loss": "absolute"}, "loss must be one of"),
            ((models("centre", nearest=0.0)["cuboid"], R, TRUE), {}, "no height is left"),
            ((models()["power"], [0.0, 1.0, 2.0], [3.0, 2.0, 1.0]), {}, "not finite")):
        with pytest.raises(ValueError, match=message):
            fit(*arguments, **options)
    found = fit(LAW, R, TRUE, fixed={"beta": BETA})
    with pytest.raises(ValueError, match="not a free parameter"):
        interval(found, "beta")
    with pytest.raises(ValueError, match="method must be"):
        interval(found, "alpha", "guess")
    for level in (0.0, 1.0, -0.5, 95.0, np.nan):
        for method in ("profile", "bootstrap", "normal"):
            with pytest.raises(ValueError, match="level must be between 0 and 1"):
                interval(found, "alpha", method, level)
        with pytest.raises(ValueError, match="level must be between 0 and 1"):
            bootstrap(found, level)
    with pytest.raises(ValueError, match="number must be at least 1"):
        bootstrap(found, number=0)


# ---------------------------------------------------------------------------------------------
# Intervals.


def test_the_profile_of_a_linear_parameter_is_the_normal_interval():
    rng = np.random.default_rng(7)
    found = fit(LAW, R, TRUE + 1e-3 * rng.standard_normal(R.size), fixed={"beta": BETA})
    assert interval(found, "alpha") == pytest.approx(interval(found, "alpha", "normal"), rel=1e-5)


def test_at_the_ends_of_a_profile_chi2_has_risen_by_its_threshold():
    found = ligo(0.5, True)
    for name in ("alpha", "beta"):
        for end in interval(found, name):
            rise = profile(found, name, end) - found.chi2
            assert rise == pytest.approx((found.quantile(0.95) * found.scale) ** 2, rel=1e-4)


# Magnets at gaps of 0.5 to 20 mm, 1 % of scatter.
GAPS = np.linspace(0.5e-3, 20e-3, 8)
CUBOIDS = np.array([17.385, 5.3907, 2.2423, 1.1073, 0.59604, 0.32867, 0.19946, 0.13013])
CYLINDERS = np.array([26.373, 12.077, 6.5343, 3.8708, 2.3664, 1.5311, 1.027, 0.70889])


@pytest.mark.parametrize(("name", "force"), [
    ("cuboid", CUBOIDS), pytest.param("cylinder", CYLINDERS, marks=pytest.mark.slow),
    pytest.param("cuboid", CYLINDERS, marks=pytest.mark.slow)])
def test_a_profile_is_the_least_chi2_whatever_lies_between(name, force):
    """With its polarisation held a magnet may be flat and wide or long and slim: two minima."""
    model = models("gap")[name]
    found = fit(model, GAPS, force, 0.01 * force)
    allowed = (found.quantile(0.95) * found.scale) ** 2
    for parameter, ends in intervals(found).items():
        for end in ends:
            best = fit(model, GAPS, force, 0.01 * force, fixed={parameter: end}, starts=16)
            assert profile(found, parameter, end) == pytest.approx(best.chi2, abs=1e-3 * allowed)
            assert best.chi2 - found.chi2 == pytest.approx(allowed, rel=1e-3)


def test_the_profile_of_a_polarisation_ends_in_the_other_of_its_two_valleys():
    """Flat and wide magnets of up to 0.92 T fit; long and slim ones end at 0.875 T."""
    found = fit(models("gap")["cylinder"], GAPS, CYLINDERS, 0.01 * CYLINDERS)
    assert interval(found, "polarisation") == pytest.approx((0.841, 0.923), abs=1e-3)


def test_a_profile_reaches_beyond_another_minimum():
    """A cuboid of 19 mm and 0.32 T and one of 10.5 mm fit; what lies between does not."""
    model = models("gap")["cuboid"]
    truth = dict(zip(model.names, (0.3237, 19.06e-3, 4.644e-3), strict=True))
    gaps = 1e-3 * np.array([0.331, 0.360, 0.961, 1.274, 1.339, 1.403, 3.252, 5.024, 8.291, 17.01,
                            18.43, 20.40])
    noise = [-1.11, -0.38, 0.87, 0.49, 0.23, 0.67, 0.95, -0.86, -1.23, -1.15, 1.86, -1.05]
    force = model.force(gaps, *truth.values())
    found = fit(model, gaps, force * (1 + 0.02 * np.array(noise)), 0.02 * force)
    allowed = (found.quantile(0.95) * found.scale) ** 2
    assert found.values[1] < 12e-3
    assert profile(found, "side", 15e-3) - found.chi2 > allowed
    for name, (low, high) in intervals(found).items():
        assert profile(found, name, truth[name]) - found.chi2 < allowed
        assert low < truth[name] < high


def test_a_profile_does_not_depend_on_what_was_looked_at_before():
    found = fit(models("gap")["cuboid"], GAPS, CUBOIDS, 0.01 * CUBOIDS)
    places = np.linspace(1.15, 1.6, 7)
    up = [profile(found, "polarisation", place) for place in places]
    assert [profile(found, "polarisation", place) for place in places[::-1]] == up[::-1]
    assert intervals(found)["height"] == interval(found, "height")


def test_a_profile_of_many_points_goes_most_of_its_way_with_their_means(monkeypatch):
    asked = [0]

    def force(d, *values):
        asked[0] += d.size
        return plain.force(d, *values)

    plain = models("gap")["cuboid"]
    z = np.linspace(2e-3, 30e-3, 3000)
    true = plain.force(z, 1.2, 5e-3, 4e-3)
    noise = np.random.default_rng(1).standard_normal(z.size)
    found = fit(plain._replace(force=force), z, true * (1 + 0.02 * noise), 0.02 * true)
    ends, costs = [], []
    for enough in (500, z.size):
        monkeypatch.setattr(fitting, "ENOUGH", enough)
        asked[0] = 0
        ends.append(interval(found, "side"))
        costs.append(asked[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)
    assert costs[0] < 0.7 * costs[1]


def test_a_profile_that_runs_along_a_bound_has_its_ends():
    """Of scattered points, where the solver's step from a bound is no number."""
    force = np.array([2.211, 0.215, 0.07226, 0.02091, 0.008878, 0.005595, 0.002319, 0.001491])
    found = fit(models("gap")["cuboid"], GAPS, force, 0.1 * force)
    for k, (low, high) in enumerate(intervals(found).values()):
        assert found.low[k] <= low < found.values[k] <= high <= found.high[k]


def test_all_intervals_are_made_at_once(here, monkeypatch):
    """One bootstrap has those of all parameters, and is the same for each."""
    data, calls = read("good.csv"), []
    found = fit(models("gap", 1.5e-3)["law"], data.distance, data.force, data.sd)
    assert intervals(found, "bootstrap", number=50) == bootstrap(found, number=50)
    assert intervals(found, "normal", only="beta") == {"beta": interval(found, "beta", "normal")}
    once = fitting.bootstrap
    monkeypatch.setattr(fitting, "bootstrap", lambda *given: calls.append(given) or once(*given))
    result = work.fit(data, inset="1.5mm", method="bootstrap")
    assert sorted(result.intervals) == ["alpha", "beta"]
    assert len(calls) == 1


def test_a_profile_ends_at_the_bound_that_cuts_it_off():
    low, high = interval(ligo(1.0, False), "beta")
    assert low == 0
    assert 0.1e-2 < high < 0.3e-2


def test_bootstrap_and_profile_agree_on_good_data():
    rng = np.random.default_rng(8)
    found = fit(LAW, R, TRUE + 1e-3 * rng.standard_normal(R.size))
    ends = bootstrap(found, number=300)
    for name in ("alpha", "beta"):
        low, high = interval(found, name)
        assert ends[name] == pytest.approx((low, high), abs=0.3 * (high - low))
    assert bootstrap(found, number=20, seed=1) == bootstrap(found, number=20, seed=1)


def test_points_on_the_law_give_an_interval_without_width():
    found = fit(LAW, R, TRUE)
    low, high = interval(found, "beta")
    assert high - low < 1e-6 * BETA


def test_an_end_where_another_parameter_is_at_the_models_own_limit_is_none():
    """Three points allow any beta: where alpha is at 10 N m^2 only the search ends."""
    rng = np.random.default_rng(3)
    found = fit(LAW, R[:3], TRUE[:3] * (1 + 0.02 * rng.standard_normal(3)))
    ends = {name: interval(found, name) for name in ("alpha", "beta")}
    assert ends["alpha"][1] == 10.0
    assert ends["beta"][1] == 10.0
    said = " ".join(doubts(found, ends))
    assert "alpha is not identified" in said
    assert "beta is not identified" in said


@pytest.mark.parametrize(("height", "seed"), [(3e-3, 2), (4.98e-3, 2)])
def test_what_magnets_cannot_be_is_a_true_end(height, seed):
    """No more than 2 T, and no higher than the nearest centres are apart: the others' intervals are
    those with either bound."""
    model = models("centre", nearest=5e-3)["cylinder"]
    z = np.linspace(5e-3, 40e-3, 15)
    true = model.force(z, 1.2, 5e-3, height)
    noise = np.random.default_rng(seed).standard_normal(15)
    found = fit(model, z, true * (1 + 0.01 * noise), 0.01 * true)
    low, high = interval(found, "radius")
    assert 4.7e-3 < low < 5e-3
    assert 5e-3 < high < 5.4e-3


NOISE = {  # the noise, whether it is known, and whether it is taken at its word
    "scaled": (0.03 * TRUE, True, False),
    "absolute": (0.03 * TRUE, True, True),
    "unweighted": (np.full(R.size, 3e-3), False, False),
}


def synthetic(case, number, seed):
    """Fits of as many synthetic sets of 15 points."""
    sd, known, absolute = NOISE[case]
    rng = np.random.default_rng(seed)
    for _ in range(number):
        yield fit(LAW, R, TRUE + sd * rng.standard_normal(R.size), sd if known else None,
                  absolute=absolute, starts=1)


@pytest.mark.parametrize("case", NOISE)
def test_intervals_cover_the_truth_in_some_95_of_100_sets(case):
    """A profile interval holds the truth where chi^2 there is below the threshold."""
    number, held = 150, np.zeros(2)
    for found in synthetic(case, number, 11):
        allowed = (found.quantile(0.95) * found.scale) ** 2
        held += [profile(found, name, true) - found.chi2 <= allowed
                 for name, true in (("alpha", ALPHA), ("beta", BETA))]
    assert np.all((held / number >= 0.9) & (held / number <= 0.99))


@pytest.mark.slow
@pytest.mark.parametrize("case", NOISE)
def test_intervals_cover_the_truth_in_93_to_97_of_100_sets(case):
    number, held = 1000, np.zeros(2)
    for found in synthetic(case, number, 12):
        ends = (interval(found, "alpha"), interval(found, "beta"))
        held += [low <= true <= high
                 for (low, high), true in zip(ends, (ALPHA, BETA), strict=True)]
    assert np.all((held / number >= 0.93) & (held / number <= 0.97)), held / number


@pytest.mark.slow
def test_bootstrap_intervals_cover_the_truth_in_some_95_of_100_sets():
    number, held = 300, np.zeros(2)
    for found in synthetic("scaled", number, 13):
        ends = bootstrap(found, number=199).values()
        held += [low <= true <= high
                 for (low, high), true in zip(ends, (ALPHA, BETA), strict=True)]
    assert np.all((held / number >= 0.92) & (held / number <= 0.98)), held / number


# ---------------------------------------------------------------------------------------------
# Goodness of fit.


def test_the_runs_test_counts_all_orders():
    """Against every order of five positive and four negative residuals."""
    orders = [[1 if k in up else -1 for k in range(9)]
              for up in itertools.combinations(range(9), 5)]
    counts = np.array([1 + sum(a != b for a, b in itertools.pairwise(order)) for order in orders])
    for order, count in zip(orders[::7], counts[::7], strict=True):
        found = runs_test(order)
        assert found.runs == count
        assert found.expected == pytest.approx(counts.mean())
        assert found.p_value == pytest.approx(np.mean(counts <= count))
    assert runs_test([1.0, 2.0, 3.0]).p_value == 1.0
    assert runs_test(np.resize([1.0, -1.0], 5000)).p_value == pytest.approx(1.0)


def test_the_runs_test_is_conservative_of_the_residuals_of_a_fit():
    """A curve through the points adds changes of sign: few runs are rarer than by chance."""
    p = np.array([runs_test(found.residuals).p_value for found in synthetic("scaled", 200, 21)])
    for level in (0.05, 0.1, 0.2, 0.5):
        assert np.mean(p <= level) < 0.8 * level


def test_the_order_of_repeats_in_a_file_makes_no_runs(here, capsys):
    """Sorted by distance and then by force, each distance would be two runs of its own."""
    rng = np.random.default_rng(3)
    d = np.repeat(np.linspace(1.0, 20.0, 8), 6)
    sd = 0.02 * LAW.force(1e-3 * d, ALPHA, BETA)
    force = LAW.force(1e-3 * d, ALPHA, BETA) + sd * rng.standard_normal(d.size)
    said = set()
    for order in (np.arange(d.size), np.lexsort((force, d)), np.lexsort((-force, d))):
        write(here / "repeats.csv", d[order], force[order], sd[order],
              head=("centre (mm)", "force (N)", "sd (N)"))
        assert run("repeats.csv") == 0
        out = capsys.readouterr().out
        said.add(re.search(r"runs of one sign, of means at 8 distances: .*", out)[0])
        assert "residuals have a pattern" not in out
    assert len(said) == 1


def test_the_runs_of_repeats_are_those_of_their_weighted_means():
    """At every distance one point far off, of little weight, on the other side of the curve."""
    sign = np.resize([1.0, 1.0, -1.0], R.size)
    near, far = TRUE * (1 + 0.01 * sign), TRUE * (1 - 0.03 * sign)
    found = fit(LAW, [*R, *R], [*near, *far], [*(0.01 * TRUE), *(0.1 * TRUE)])
    assert fitting.runs(found) == runs_test(found.residuals[:R.size])
    even = fit(LAW, [*R, *R], [*near, *far])
    assert fitting.runs(even) == runs_test(even.residuals[:R.size] + even.residuals[R.size:])


def test_aicc_prefers_the_model_that_made_the_points():
    rng = np.random.default_rng(9)
    d = np.linspace(4e-3, 30e-3, 25)
    made = models("gap")
    for name, values in (("law", (ALPHA, BETA)), ("power", (0.05, 1.5)),
                         ("cylinder", (1.2, 2e-3, 3e-3))):
        true = made[name].force(d, *values)
        force = true * (1 + 0.005 * rng.standard_normal(d.size))
        found = {rival: fit(made[rival], d, force, 0.005 * true)
                 for rival in ("law", "power", "cylinder")}
        assert min(found, key=lambda rival: found[rival].aicc) == name


@pytest.mark.parametrize("number", [4, 6])
def test_of_known_uncertainties_akaikes_criterion_needs_no_correction(number):
    """chi^2 of new points is what it estimates: 2 k more than that of the fitted ones."""
    rng, trials = np.random.default_rng(11), 150
    sd, more = 0.01 * TRUE[:number], 0.0
    for _ in range(trials):
        found, new = (fit(LAW, R[:number], TRUE[:number] + sd * rng.standard_normal(number), sd,
                          absolute=True, starts=1) for _ in range(2))
        fresh = np.sum(((new.force - found.predict(found.distance)) / sd) ** 2)
        more += (fresh - found.aicc) / trials
    assert abs(more) < 1.2  # four standard errors; with the correction -12 and -4


def test_the_rounding_of_exact_points_says_nothing_against_a_model():
    for seed in range(12):
        rng = np.random.default_rng(seed)
        d = np.sort(rng.uniform(1e-3, 20e-3, 9))
        found = fit(models("gap")["law"], d, 1.8e-5 / (d + rng.uniform(1e-3, 1e-2)) ** 2)
        assert fitting.runs(found).p_value == 1.0
        assert halves(found).p_value == 1.0
    made = models("gap", 3e-3)  # at beta = 0 they are one
    square = [fit(made[name], d, 1.8e-5 / (d + 6e-3) ** 2) for name in ("law", "power")]
    assert square[0].aicc == pytest.approx(square[1].aicc, abs=1e-9)


def test_of_known_uncertainties_the_halves_are_told_apart_by_chi_squared():
    """Of six points two are left over, whose scatter says next to nothing."""
    d = np.array([1.0, 3.0, 5.0, 11.0, 15.0, 20.0]) * 1e-3
    force = np.where(d < 7e-3, 1.0, 1.1) * LAW.force(d, ALPHA, BETA)
    force *= 1 + 0.005 * np.array([1, -2, 1, 1, -2, 1])
    found = fit(LAW, d, force, 0.01 * force, absolute=True)
    both = halves(found)
    gain = found.chi2 - both.near.chi2 - both.far.chi2
    assert both.p_value == pytest.approx(math.exp(-0.5 * gain))  # chi^2 of two parameters
    assert both.p_value < 1e-4 < 0.05 < halves(replace(found, absolute=False)).p_value


def test_aicc_is_burnham_and_andersons():
    rng = np.random.default_rng(10)
    sd = 0.01 * TRUE
    force = TRUE + sd * rng.standard_normal(R.size)
    known, plain = fit(LAW, R, force, sd, absolute=True), fit(LAW, R, force)
    assert known.aicc == pytest.approx(known.chi2 + 4)  # nothing is estimated but the parameters
    assert plain.aicc == pytest.approx(15 * np.log(plain.chi2 / 15) + 6 + 24 / 11)
    assert fit(LAW, R[:4], force[:4]).aicc == np.inf
    few = fit(LAW, R[:4], force[:4], sd[:4], absolute=True)
    assert few.aicc == pytest.approx(few.chi2 + 4)
    assert fitting.weights([0.0, 2.0, np.nan]) == pytest.approx(
        [1 / (1 + np.exp(-1)), np.exp(-1) / (1 + np.exp(-1)), 0.0])


def test_the_halves_of_points_on_the_law_agree():
    p = [halves(found).p_value for found in synthetic("scaled", 60, 14)]
    assert 0 < np.mean(np.array(p) < 0.2) < 0.4
    assert halves(fit(LAW, R[:4], TRUE[:4] * [1, 1.1, 1, 1.1])) is None


def test_repeats_of_a_distance_are_in_one_half():
    rng = np.random.default_rng(17)
    d = np.repeat(R[:14:2], 5)  # 35 points: half of them end within a distance
    found = fit(LAW, d, LAW.force(d, ALPHA, BETA) + 1e-3 * rng.standard_normal(d.size))
    both = halves(found)
    assert np.unique(both.near.distance) == pytest.approx(R[:8:2])
    assert np.unique(both.far.distance) == pytest.approx(R[8:14:2])
    assert both.near.distance.size + both.far.distance.size == d.size


def test_parameters_that_the_points_do_not_tell_apart_are_named():
    """Far away only J^2 R^4 h^2 of a cylinder counts; near one distance only alpha/(r + beta)^2."""
    rng = np.random.default_rng(15)
    model = models("gap")["cylinder"]
    d = np.linspace(0.05, 0.1, 12)
    force = model.force(d, 1.2, 2e-3, 3e-3) * (1 + 0.02 * rng.standard_normal(d.size))
    found = fit(model, d, force)
    assert any("identified" in doubt for doubt in doubts(found, intervals(found)))
    d = np.linspace(0.01, 0.0101, 12)
    force = LAW.force(d, ALPHA, BETA) * (1 + 0.02 * rng.standard_normal(d.size))
    found = fit(LAW, d, force)
    ends = {name: interval(found, name) for name in ("alpha", "beta")}
    assert any("beta is" in doubt and "identified" in doubt for doubt in doubts(found, ends))
    good = fit(LAW, R, TRUE * (1 + 0.01 * rng.standard_normal(R.size)))
    assert doubts(good, {name: interval(good, name) for name in ("alpha", "beta")}) == []


# ---------------------------------------------------------------------------------------------
# The command.


def write(path, d, force, sd=None, head=("gap (mm)", "force (N)", "sd (N)")):
    columns = [d, force] if sd is None else [d, force, sd]
    lines = [",".join(head[:len(columns)])]
    lines += [",".join(repr(float(v)) for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


FITS = {}


def fitted_once(model, d, force, sd, **options):
    """As `fit`; what many tests fit in the same way, good.csv above all, is fitted once."""
    values = [np.clip(np.full(len(model.parameters), 0.01 * k),
                      *np.transpose([(p.low, p.high) for p in model.parameters])) for k in (1, 3)]
    with np.errstate(all="ignore"):
        forces = [model.force(d, *each).tobytes() for each in values]
    key = (model.name, model.parameters, *forces, str(model.shapes(float(d.max()))),
           d.tobytes(), force.tobytes(), sd if sd is None else sd.tobytes(), str(options))
    if key not in FITS:
        FITS[key] = fit(model, d, force, sd, **options)
    return FITS[key]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty folder to be in, with good.csv: the paper's law with a little noise."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fitting, "fit", fitted_once)
    rng = np.random.default_rng(16)
    force = LAW.force(R, ALPHA, BETA) * (1 + 0.01 * rng.standard_normal(R.size))
    write(tmp_path / "good.csv", 1000 * R - 3, force, 0.01 * force)
    return tmp_path


def run(*arguments):
    return main(["fit", *map(str, arguments)])


def test_the_command_prints_the_fit_and_writes_section_and_picture(here, capsys):
    assert run("good.csv", "--inset", "1.5mm") == 0
    out, err = capsys.readouterr()
    assert err == ""
    for words in ("15 points, gap 0 to 27 mm", "r = gap + 2 x 1.5 mm", "F = alpha / (r + beta)^2",
                  "alpha", "N mm^2", "chi2/dof", "runs of one sign", "near half", "cylinder",
                  "; conservative, as a fit adds runs)",
                  "dAICc", "written: fits/good-law/magnet.toml, fits/good-law/fit.png"):
        assert words in out
    assert "warning" not in out
    assert sorted(path.name for path in (here / "fits" / "good-law").iterdir()) == [
        "fit.png", "magnet.toml"]
    assert imread(here / "fits" / "good-law" / "fit.png").shape[:2] == (1000, 1100)
    assert max(map(len, out.splitlines())) < 120


def test_how_far_the_fits_are_is_told(here):
    shown = []
    work.fit(read("good.csv"), "power", inset="1.5mm",
             progress=lambda done, total: shown.append((done, total)))
    assert shown == [(done, 5) for done in range(6)]  # four models, and the intervals of one


def test_the_picture_shows_negative_forces(here, monkeypatch):
    figures = []
    monkeypatch.setattr(work, "Figure", lambda **how: figures.append(Figure(**how)) or figures[-1])
    force = LAW.force(R, ALPHA, BETA)
    for lowest in (force[-1], -0.1 * force[0]):
        write(here / "some.csv", 1000 * R - 3, [*force[:-1], lowest])
        work.picture(work.fit(read("some.csv"), inset="1.5mm"))
    assert figures[0].axes[0].get_ylim()[0] == 0.0
    assert figures[1].axes[0].get_ylim()[0] < -0.1 * force[0]


def test_the_written_section_is_one_that_a_scene_reads(here):
    assert run("good.csv", "--inset", "1.5mm") == 0
    text = (here / "fits" / "good-law" / "magnet.toml").read_text()
    scene = tbsa.parse('[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n' + text)
    data = read("good.csv")
    found = fit(models("gap", 1.5e-3)["law"], data.distance, data.force, data.sd)
    assert (scene.magnet.alpha, scene.magnet.beta) == pytest.approx(found.values, rel=1e-5)
    assert scene.magnet.inset == 1.5e-3
    assert scene.magnet.alpha == pytest.approx(ALPHA, rel=0.05)


def test_a_scene_gets_the_fitted_magnet_and_keeps_every_other_line(here):
    text = (ROOT / "paper_runs" / "shaking.toml").read_text()
    (here / "scene.toml").write_text(text)
    before = tbsa.load("scene.toml")
    assert run("good.csv", "--inset", "1mm", "--scene", "scene.toml") == 0
    after = tbsa.load("scene.toml")
    assert after.magnet.inset == 1e-3
    assert after.magnet.alpha == pytest.approx(ALPHA, rel=0.1)
    assert after.magnet.alpha != ALPHA
    assert replace(after, magnet=before.magnet) == before
    changed = [(old, new) for old, new in zip(
        text.splitlines(), (here / "scene.toml").read_text().splitlines(), strict=True)
        if old != new]
    assert [old.split()[0] for old, _ in changed] == ["alpha", "beta", "inset"]


def test_distances_of_centres_leave_the_inset_alone_unless_it_is_given(here):
    write(here / "centre.csv", 1000 * R, LAW.force(R, ALPHA, BETA),
          head=("centre (mm)", "force (N)"))
    text = (ROOT / "paper_runs" / "shaking.toml").read_text()
    given = re.sub(r"(?m)^inset = \S+", "inset = 2.25e-3", text)
    assert given != text
    for options, inset in (([], 2.25e-3), (["--inset", "1mm"], 1e-3)):
        (here / "scene.toml").write_text(given)
        assert run("centre.csv", "--scene", "scene.toml", *options) == 0
        assert tbsa.load("scene.toml").magnet.inset == inset
        section = (here / "fits" / "centre-law" / "magnet.toml").read_text()
        assert ("inset" in section) == bool(options)


@pytest.mark.parametrize("section", ["", "[magnet]\n", "[magnet]\nmismatch = 0  # nothing\n"])
def test_a_scene_without_the_values_gets_them(here, section):
    scene = f'[tiles]\nset = "chessboard"\n{section}[seed]\nshape = "L"\narm = 2\n'
    (here / "scene.toml").write_text(scene.replace("\n", "\r\n"), newline="")
    assert run("good.csv", "--inset", "1.5mm", "--scene", "scene.toml") == 0
    magnet = tbsa.load("scene.toml").magnet
    assert magnet.alpha == pytest.approx(ALPHA, rel=0.05)
    assert magnet.mismatch == (0 if "mismatch" in section else -1)
    assert b"\n" not in (here / "scene.toml").read_bytes().replace(b"\r\n", b"")


def test_a_write_that_breaks_off_leaves_the_scene_as_it_was(here, monkeypatch, capsys):
    text = (ROOT / "paper_runs" / "shaking.toml").read_text()
    (here / "scene.toml").write_text(text)

    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", broken)
    assert run("good.csv", "--inset", "1mm", "--scene", "scene.toml") == 1
    assert "No space left" in capsys.readouterr().err
    assert (here / "scene.toml").read_text() == text
    assert [path.name for path in here.rglob("*") if path.is_file()
            and path.name not in ("scene.toml", "good.csv")] == []


def test_a_scene_is_written_last(here, capsys):
    text = '[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n'
    (here / "scene.toml").write_text(text)
    err = refused(capsys, here, "good.csv", "--inset", "1mm", "--scene", "scene.toml",
                  "--out", "good.csv/x")
    assert "--out: 'good.csv/x' must be a folder that can be made" in err
    (here / "fits" / "fit.png").mkdir(parents=True)  # a folder where a file is to be
    err = refused(capsys, here, "good.csv", "--inset", "1mm", "--scene", "scene.toml",
                  "--out", "fits")
    assert "--out: 'fits/fit.png' must be a file, and is a folder" in err
    assert [path.name for path in (here / "fits").iterdir()] == ["fit.png"]
    assert (here / "scene.toml").read_text() == text


def test_a_fit_shows_its_result_though_its_picture_cannot_be_written(here, capsys, monkeypatch):
    from tbsa.model import records

    def full(path, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(records, "write_atomically", full)
    assert run("good.csv", "--inset", "1.5mm") == 1
    assert "alpha" in capsys.readouterr().out


def test_a_scene_that_may_not_be_written_is_refused(here, capsys):
    (here / "scene.toml").write_text('[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n')
    (here / "scene.toml").chmod(0o444)
    assert "scene.toml: --scene: must be a file that may be written" in refused(
        capsys, here, "good.csv", "--inset", "1mm", "--scene", "scene.toml")


def test_a_scene_keeps_its_mode_its_link_and_its_byte_order_mark(here):
    (here / "own").mkdir()
    scene = here / "own" / "scene.toml"
    scene.write_bytes(b'\xef\xbb\xbf[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n')
    scene.chmod(0o640)
    (here / "scene.toml").symlink_to("own/scene.toml")
    assert run("good.csv", "--inset", "1mm", "--scene", "scene.toml") == 0
    assert (here / "scene.toml").is_symlink()
    assert scene.stat().st_mode & 0o777 == 0o640
    assert scene.read_bytes().startswith(b"\xef\xbb\xbf[tiles]\n")
    assert tbsa.load(scene).magnet.inset == 1e-3


@pytest.mark.parametrize("text", [
    'title = """\n[magnet]\nalpha = 1"""\n# \'\'\' [magnet]\n[tiles]\nset = "chessboard"\n',
    "title = '''a\n[magnet]\n'''\n[tiles]\nset = 'chessboard'\n[magnet]\nalpha = 1e-4",
    'title = "\\"#"\r\n[tiles]\r\nset = "chessboard"\n[magnet]\nbeta = 0.001\r\nmismatch = 0\n',
    '[tiles]\nset = "chessboard"\n[magnet]'])
def test_lines_that_are_not_of_the_section_stay_as_they_are(here, text):
    text = '[seed]\nshape = "L"\narm = 2\n' + text if text[0] == "[" else text.replace(
        "[tiles]", "seed = {shape = 'L', arm = 2}\n[tiles]")
    (here / "scene.toml").write_bytes(text.encode())
    before = tbsa.load("scene.toml")
    assert run("good.csv", "--inset", "1mm", "--scene", "scene.toml") == 0
    after = tbsa.load("scene.toml")
    assert after.magnet.inset == 1e-3
    assert replace(after, magnet=before.magnet) == before
    made = iter((here / "scene.toml").read_bytes().decode().split("\n"))
    old = [line for line in text.split("\n") if line and "alpha = 1e" not in line
           and "beta" not in line]
    assert all(line in made for line in old)  # in this order, others between


@pytest.mark.parametrize(("mm", "cm"), [("7mm:", "0.7cm:"), (":7mm", ":0.7cm")])
def test_a_range_is_the_same_in_every_unit(here, capsys, mm, cm):
    write(here / "cm.csv", [0.5, 0.6, 0.7, 0.8, 0.9], [5.0, 4.0, 3.2, 2.7, 2.2],
          head=("gap (cm)", "force (N)"))
    for within in (mm, cm):
        assert run("cm.csv", "--inset", "1mm", "--range", within) == 0
        assert "3 of 5 points" in capsys.readouterr().out


def test_the_ligo_data_on_the_command_line(here, capsys):
    assert run(LIGO, "--inset", "0mm", "--range", "0.5cm:", "--unweighted") == 0
    out = capsys.readouterr().out
    assert "13 of 17 points" in out
    assert re.search(r"alpha +3\.68 +0\.46 .* N cm\^2", out)
    assert re.search(r"beta +0\.543 +0\.084 .* cm", out)
    assert run(LIGO, "--inset", "0mm", "--range", "0.5cm:") == 0
    out = capsys.readouterr().out
    assert re.search(r"alpha +2\.29 +0\.20 .* N cm\^2", out)
    assert re.search(r"beta +0\.165 +0\.060 .* cm", out)
    assert "chi2/dof 142" in out
    assert "warning: the law model is local" in out
    assert "warning: the residuals have a pattern" in out
    assert "warning: the cylinder model describes these points far better" in out


def test_the_readme_shows_what_the_command_prints(tmp_path, monkeypatch, capsys):
    command, shown = re.search(r"```sh\ntbsa (fit .*)\n```\n\n```text\n(.*?)```",
                               (ROOT / "README.md").read_text(), re.DOTALL).groups()
    monkeypatch.chdir(ROOT)
    assert main([*command.split(), "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith(shown)


SIZES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6,
         "N": 1.0, "mN": 1e-3, "g": 9.80665e-3, "gf": 9.80665e-3, "kgf": 9.80665}


@given(st.sampled_from([*SIZES][:6]), st.sampled_from([*SIZES][6:]),
       st.sampled_from([*SIZES][6:]), st.sampled_from(["{} ({})", "{} [{}]", "{}_{}"]),
       st.permutations([0, 1, 2]))
@settings(deadline=None, max_examples=40)
def test_units_brackets_and_order_of_columns_do_not_matter(tmp_path_factory, length, force, sd,
                                                          form, order):
    columns = [R / SIZES[length], TRUE / SIZES[force], 0.01 * TRUE / SIZES[sd]]
    head = [form.format("centre", length), form.format("Force", force), form.format("sd", sd)]
    path = tmp_path_factory.mktemp("units") / "data.csv"
    write(path, *(columns[k] for k in order), head=[head[k] for k in order])
    data = read(path)
    assert data.kind == "centre"
    assert data.distance == pytest.approx(R, rel=1e-12)
    assert data.force == pytest.approx(TRUE, rel=1e-12)
    assert data.sd == pytest.approx(0.01 * TRUE, rel=1e-12)


def test_comments_blank_lines_a_byte_order_mark_and_quotes_are_read(here):
    (here / "odd.csv").write_bytes(
        b'\xef\xbb\xbf# magnets, measured today\r\n\r\n"centre distance (mm)", force (mN)\r\n'
        b' 3 , 200\r\n"5",150\r\n# a remark\r\n9, 1e2\r\n\r\n')
    data = read("odd.csv")
    assert data.distance == pytest.approx([3e-3, 5e-3, 9e-3])
    assert data.force == pytest.approx([0.2, 0.15, 0.1])
    assert data.sd is None


def test_the_commas_that_a_spreadsheet_leaves_are_no_columns(here, capsys):
    rows = "gap (mm),force (N),,\n1,0.3,,\n2,0.2,,\n,,,\n3,0.1,,\n"
    (here / "padded.csv").write_text(rows)
    data = read("padded.csv")
    assert data.distance == pytest.approx([1e-3, 2e-3, 3e-3])
    assert data.force == pytest.approx([0.3, 0.2, 0.1])
    for bad, said in ((rows.replace("0.2,,", "0.2,1,"), "line 3: must have 2 values"),
                      (rows.replace("0.2,,", "0.2,"), "line 3: must have 2 values"),
                      (rows.replace("0.2,,", ",,"), "line 3, force: '' must be a number"),
                      (rows.replace("(N),,", "(N)"), "line 2: must have 2 values")):
        (here / "bad.csv").write_text(bad)
        assert said in refused(capsys, here, "bad.csv", "--inset", "0mm")


def test_a_column_called_distance_needs_to_be_told(here, capsys):
    write(here / "d.csv", 1000 * R, TRUE, head=("distance (mm)", "force (N)"))
    assert run("d.csv") == 2
    assert "--distance: is missing; must be gap" in capsys.readouterr().err
    assert run("d.csv", "--distance", "centre", "--out", "a") == 0
    assert "r between the magnets' centres" in capsys.readouterr().out
    assert run("d.csv", "--distance", "gap", "--inset", "1mm", "--out", "b") == 0
    alpha, beta = (re.search(rf"{name} = (\S+)", (here / folder / "magnet.toml").read_text())[1]
                   for name, folder in (("beta", "a"), ("beta", "b")))
    assert float(alpha) - float(beta) == pytest.approx(2e-3, rel=1e-4)


def test_known_dimensions_go_to_every_model_that_has_them(here, capsys):
    model = models("gap")["cylinder"]
    write(here / "c.csv", 1000 * R, model.force(R, 1.21, 2e-3, 3e-3))
    assert run("c.csv", "--inset", "1.5mm", "--model", "cylinder", "--fix", "height=3mm",
               "--fix", "radius=2mm") == 0
    out = capsys.readouterr().out
    assert "fixed" in out
    assert re.search(r"polarisation +1\.21 ", out)
    assert re.search(r"cuboid .* height 3 mm", out)
    assert not (here / "fits" / "c-cylinder" / "magnet.toml").exists()


@pytest.mark.parametrize(("value", "error", "shown"), [
    (2.2918, 0.2034, "2.29"), (0.16512, 0.0604, "0.165"), (18.0562, 0.1446, "18.06"),
    (1.80562e-5, 1.446e-7, "1.806e-05"), (1.8e-5, 1.446e-7, "1.800e-05"),
    (1.446e-7, 1.446e-7, "1.4e-07"), (6.3941e-3, 2.84e-6, "0.0063941"),
    (18056223.0, 144607.0, "18060000"), (6423.4, 53.2, "6423"), (0.0, 2.85e-6, "0"),
    (-1.2e-9, 2.85e-6, "-1.2e-09"), (0.0, 0.06, "0.000"), (17.97812, 3e-12, "17.9781200"),
    (3.14159, 0.0, "3.14"), (3.14159, np.inf, "3.14")])
def test_a_number_is_printed_to_two_digits_of_its_error(value, error, shown):
    assert work._rounded(value, error) == shown


def test_a_fit_is_printed_with_as_many_digits_in_every_unit(here, capsys):
    force = LAW.force(R, ALPHA, BETA)
    force *= 1 + 3e-4 * np.random.default_rng(3).standard_normal(R.size)
    found = {}
    for unit in ("um", "mm", "cm", "m"):
        size = SIZES[unit]
        write(here / f"{unit}.csv", R / size, force, head=(f"centre ({unit})", "force (N)"))
        assert run(f"{unit}.csv") == 0
        out = capsys.readouterr().out
        for name, scale in (("alpha", size**2), ("beta", size)):
            row = re.search(rf"{name} +(\S+) +(\S+) +(\S+) to (\S+) ", out).groups()
            found.setdefault(name, []).append(np.array(row, float) * scale)
    for rows in found.values():
        error = rows[0][1]
        assert np.ptp(rows, axis=0) == pytest.approx(0, abs=0.05 * error)


@pytest.mark.parametrize("options", [
    ["--loss", "huber", "--range", ":2cm"], ["--absolute", "--bound", "beta=:1cm"],
    ["--interval", "bootstrap", "--fix", "beta=6.4mm"], ["--model", "power", "--unweighted"]])
def test_every_option_gives_a_fit(here, capsys, options):
    assert run("good.csv", "--inset", "1.5mm", *options) == 0
    assert re.search(r"(alpha|force) +[\d.]+ +[\d.]+ +[\d.]+ to [\d.]+", capsys.readouterr().out)


def test_outliers_of_a_robust_fit_do_not_say_that_it_misses_its_points(here, capsys):
    """That all points are less exact than their uncertainties does."""
    noise = np.random.default_rng(5).standard_normal(R.size)
    force, sd = LAW.force(R, ALPHA, BETA), 0.01 * LAW.force(R, ALPHA, BETA)
    wrong = np.where(np.isin(np.arange(R.size), (3, 11)), 1.4, 1.0)
    for name, measured in (("few", (force + sd * noise) * wrong), ("all", force + 4 * sd * noise)):
        write(here / f"{name}.csv", 1000 * R, measured, sd,
              head=("centre (mm)", "force (N)", "sd (N)"))
        assert run(f"{name}.csv", "--loss", "huber") == 0
        assert ("misses the points" in capsys.readouterr().out) == (name == "all")
    assert run("few.csv") == 0
    assert "misses the points" in capsys.readouterr().out


def test_intervals_of_a_robust_loss_are_said_to_be_approximate(here, capsys):
    assert run("good.csv", "--inset", "1.5mm") == 0
    assert "approximate" not in capsys.readouterr().out
    assert run("good.csv", "--inset", "1.5mm", "--loss", "huber") == 0
    out = capsys.readouterr().out
    assert "intervals of a robust loss are approximate: " in out
    assert "some 70 to 95 % hold the truth" in out


def test_a_model_or_a_loss_that_there_is_not_is_named(here):
    for options, message in (({"model": "sphere"}, "--model: 'sphere' must be one of law, power, "
                              "cylinder, cuboid"),
                             ({"loss": "abs"}, "--loss: 'abs' must be one of linear, soft_l1, ")):
        with pytest.raises(InputError, match=re.escape(message)):
            work.fit(read("good.csv"), inset="1.5mm", **options)


def test_an_inset_that_no_scene_takes_is_named(here, capsys):
    assert run("good.csv", "--inset", "9m") == 0
    out = capsys.readouterr().out
    assert "a scene does not take this law: --inset: '9 m' must be below 5 m, half the width" in out
    assert run("good.csv", "--inset", "4.9m") == 0
    assert "material.width" not in out + capsys.readouterr().out


def test_uncertainties_that_are_too_large_are_doubted_where_they_are_taken_at_their_word(
        here, capsys):
    good = read("good.csv")
    write(here / "wide.csv", 1000 * good.distance, good.force, 50 * good.sd)
    assert run("wide.csv", "--inset", "1.5mm") == 0
    assert "warning" not in capsys.readouterr().out
    assert run("wide.csv", "--inset", "1.5mm", "--absolute") == 0
    assert re.search(r"warning: the points lie nearer to the curve than their uncertainties let "
                     r"expect, by 0\.0\d+ of these: they are too large", capsys.readouterr().out)


def test_a_rival_whose_search_ended_at_a_bound_is_marked_and_not_recommended(here, capsys):
    """Magnets of 200 mm: heights are searched to 100 mm."""
    d = np.linspace(2, 30, 15)
    force = models("gap")["cylinder"].force(1e-3 * d, 1.2, 8e-3, 0.2)
    write(here / "long.csv", d, force * (1 + 0.01 * np.sin(70 * d)), 0.01 * force)
    assert run("long.csv", "--inset", "1.5mm") == 0
    out = capsys.readouterr().out
    rows = {line.split()[0]: line for line in out.split("models\n")[1].splitlines() if line}
    assert float(rows["law"].split()[3]) > 10 > float(rows["cylinder"].split()[3])
    for name in ("cylinder", "cuboid"):
        assert rows[name].endswith("height 100 mm (at bound)")
        assert f"the {name} model describes" not in out


def test_a_cut_off_that_takes_force_from_bonded_magnets_is_told_with_the_number(here, capsys):
    scene = '[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n[magnet]\n'
    for cutoff, less in (("3.1e-3", "81 %"), ("3.2e-3", "28 %"), ("3.4e-3", "")):
        (here / "scene.toml").write_text(f"{scene}cutoff = {cutoff}\n")
        assert run("good.csv", "--inset", "1.5mm", "--scene", "scene.toml") == 0
        out = capsys.readouterr().out
        assert ("warning: scene.toml: bonded magnets, 3 mm apart, pull with " in out) == bool(less)
        assert f", {less} less than the fitted 0.2" in out or not less
    write(here / "deep.csv", [1, 2, 3, 5, 8], [5, 4.6, 4.2, 3.7, 3])
    assert run("deep.csv", "--inset", "14mm") == 0
    out = capsys.readouterr().out
    assert "warning: a scene: bonded magnets, 28 mm apart, pull with" in out
    contact = float(re.search(r"pull with (\S+) N", out)[1])
    section = tbsa.parse('[tiles]\nset = "chessboard"\n[material]\nwidth = 0.06\nmass = 0.1\n'
                         '[[free.tile]]\ntype = "black"\nposition = [0.0, 0.0]\n'
                         + (here / "fits/deep-law/magnet.toml").read_text()).magnet
    law = Law(section.alpha, section.beta, cutoff=section.cutoff, switch=section.switch)
    assert magnet_force(2 * section.inset, law) == pytest.approx(contact, rel=1e-3)


def test_a_parameter_at_its_bound_is_named_in_all_that_is_written(here, capsys):
    assert run("good.csv", "--inset", "1.5mm", "--bound", "beta=0:1e-12mm") == 0
    out = capsys.readouterr().out
    assert re.search(r"beta +1\.00e-12 +at bound +0 to 1\.00e-12 +mm", out)
    assert re.search(r"near half .* 1e-12 at bound", out)
    assert "warning: beta is at its upper bound, 1e-15 m, and has no standard error; those" in out
    assert "inf" not in out
    assert "nan" not in out
    assert run("good.csv", "--inset", "1.5mm", "--bound", "beta=0:1mm", "--interval",
               "bootstrap") == 2
    assert "--interval: 'bootstrap' cannot be had: beta is at its bound" in capsys.readouterr().err
    assert "# m; at its bound\n" in (here / "fits/good-law/magnet.toml").read_text()


def test_a_law_that_no_scene_takes_is_fitted_but_not_written(here, capsys):
    """Repulsion at no distance must be finite: beta = 0 needs an inset."""
    write(here / "square.csv", [10, 20, 30, 40], [4.0, 1.0, 0.44, 0.25])
    assert run("square.csv", "--inset", "0mm", "--fix", "beta=0") == 0
    assert "warning: a scene does not take this law" in capsys.readouterr().out
    assert not (here / "fits" / "square-law" / "magnet.toml").exists()


def test_an_earlier_section_does_not_outlive_a_fit_that_has_none(here):
    write(here / "square.csv", [10, 20, 30, 40], [4.0, 1.0, 0.44, 0.25])
    assert run("square.csv", "--inset", "1mm", "--fix", "beta=0") == 0
    assert (here / "fits" / "square-law" / "magnet.toml").exists()
    assert run("square.csv", "--inset", "0mm", "--fix", "beta=0") == 0
    assert not (here / "fits" / "square-law" / "magnet.toml").exists()


@pytest.mark.parametrize("text", ["# mine\n", "[magnet]\nalpha = 1e-5\nbeta = 6e-3\n", ""])
def test_a_section_that_no_fit_has_written_stays(here, text):
    (here / "fits").mkdir()
    (here / "fits" / "magnet.toml").write_text(text)
    assert run("good.csv", "--inset", "1mm", "--model", "power", "--out", "fits") == 0
    assert (here / "fits" / "magnet.toml").read_text() == text


def test_the_python_functions_do_what_the_command_does(here, capsys):
    assert run("good.csv", "--inset", "1.5mm") == 0
    shown = capsys.readouterr().out
    result = work.fit(read("good.csv"), inset="1.5mm")
    assert work.describe(result) in shown
    assert work.section(result) == (here / "fits" / "good-law" / "magnet.toml").read_text()


# ---------------------------------------------------------------------------------------------
# What is refused.


def contents(folder):
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def refused(capsys, here, *arguments):
    """The one line with which the command refuses its input, having written nothing."""
    before = contents(here)
    capsys.readouterr()
    assert run(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("tbsa: ")
    assert err.count("\n") == 1, err
    assert contents(here) == before
    return err


H = "gap (mm),force (N),sd (N)\n"
ROWS = "1,3,0.1\n2,2,0.1\n3,1,0.1\n"
BAD = [  # (name, bytes of the file, what the message must say)
    ("an empty file", b"", "is empty; must be a header like  gap (mm),force (N),sd (N)"),
    ("only comments", b"# nothing\n\n", "is empty"),
    ("a wrong header", b"x,y\n1,2\n", "line 1: 'x' must be a header like"),
    ("no header", b"1,3\n2,2\n3,1\n", "line 1: '1' must be a header like"),
    ("no force", b"gap (mm),sd (N)\n1,2\n", "line 1: 'gap (mm),sd (N)' must be a header like"),
    ("two kinds of distance", b"gap (mm),centre (mm),force (N)\n1,2,3\n", "must be a header like"),
    ("no units", b"gap,force\n1,2\n", "line 1: 'gap' must have its unit, one of mm, cm, m"),
    ("one unit missing", b"gap (mm),force\n1,2\n", "'force' must have its unit, one of N, mN, g"),
    ("an unknown unit", b"gap (in),force (N)\n1,2\n", "'gap (in)' must have its unit"),
    ("a unit of another kind", b"gap (N),force (mm)\n1,2\n", "'gap (N)' must have its unit"),
    ("a column twice", b"gap (mm),force (N),force (mN)\n1,2,3\n",
     "'force (mN)' must be the only column of force"),
    ("semicolons", b"gap (mm);force (N)\n1,5;2\n", "must be separated by commas"),
    ("tabs", b"gap (mm)\tforce (N)\n1\t2\n", "must be separated by commas"),
    ("semicolons in the rows", (H + "1;3;0.1\n").encode(), "line 2: must have 3 values"),
    ("decimal commas", b"gap (mm),force (N)\n1,5,2\n",
     "line 2: must have 2 values, as the header has columns; it has 3; use a decimal point"),
    ("a short row", (H + ROWS + "4,1\n").encode(), "line 5: must have 3 values, as the header"),
    ("words", (H + ROWS + "four,1,0.1\n").encode(),
     "line 5, gap: 'four' must be a number from 0 to 10000 mm"),
    ("NaN", (H + ROWS + "4,nan,0.1\n").encode(), "line 5, force: 'nan' must be a number"),
    ("infinity", (H + ROWS + "inf,1,0.1\n").encode(), "line 5, gap: 'inf' must be a number"),
    ("an empty cell", (H + ROWS + "4,,0.1\n").encode(), "line 5, force: '' must be a number"),
    ("underscores", (H + ROWS + "1_0,1,0.1\n").encode(), "line 5, gap: '1_0' must be a number"),
    ("a negative distance", (H + "-1,4,0.1\n" + ROWS).encode(),
     "line 2, gap: '-1' must be a number from 0"),
    ("a force beyond all", b"gap (um),force (kgf)\n1,3\n2,2\n3,1e6\n",
     "line 4, force: '1e6' must be a number from -101972 to 101972 kgf"),
    ("a distance of the moon", b"gap (m),force (N)\n1,3\n2,2\n384400000,1\n",
     "line 4, gap: '384400000' must be a number from 0 to 10 m"),
    ("no uncertainty", (H + ROWS + "4,1,0\n").encode(),
     "line 5, sd: '0' must be a number from 1e-12"),
    ("a negative uncertainty", (H + ROWS + "4,1,-1\n").encode(), "sd: '-1' must be a number from"),
    ("a certainty", (H + "4,1,1e-300\n").encode(), "sd: '1e-300' must be a number from 1e-12"),
    ("no force", b"gap (mm),force (N)\n1,3e-200\n2,2e-200\n3,1e-200\n",
     "N in mean and median; must be"),
    ("no points", H.encode(), "rows: 0 points; must be at least 3"),
    ("two points", (H + "1,3,1\n2,2,1\n").encode(), "rows: 2 points; must be at least 3"),
    ("two distances", (H + "1,3,1\n2,2,1\n2,1,1\n").encode(),
     "gap: 2 different values; must be at least 3"),
    ("constant force", (H + "1,2,1\n2,2,1\n3,2,1\n").encode(),
     "force: 2.0 N at every distance; must fall"),
    ("forces with a sign", b"gap (mm),force (N)\n1,-3\n2,-2\n3,-1\n",
     "force: -2.0 N in mean and median; must be at least"),
    ("a force that rises", b"gap (mm),force (N)\n1,1\n2,2\n3,3\n4,4\n", "must fall"),
    ("a picture", b"\x89PNG\r\n\x1a\n\x00\x00", "must be a CSV file in UTF-8"),
    ("zeros", b"\x00" * 50, "must be a CSV file: it holds a NUL"),
    ("UTF-16", "gap (mm),force (N)\n".encode("utf-16"), "must be a CSV file in UTF-8"),
    ("an open quote", (H + '"1,3,0.1\n').encode(), "line 2: '\"1,3,0.1' must be comma-separated"),
    ("too many points", (H + "1,2,3\n" * 10_001).encode(), "10001 points; must be at most 10000"),
]


@pytest.mark.parametrize("options", [["--loss", "huber"], ["--range", ":20mm"]])
def test_one_wrong_point_does_not_stand_in_the_way_of_what_leaves_it_out(here, capsys, options):
    write(here / "outlier.csv", np.append(1000 * R[:9], 30.0), np.append(LAW.force(
        R[:9] + 3e-3, ALPHA, BETA), 5.0))
    assert run("outlier.csv", "--inset", "1.5mm", *options) == 0
    assert re.search(r"alpha +18(\.0+)? .*N mm\^2", capsys.readouterr().out)


def test_a_far_field_of_zeros_is_fitted(here, capsys):
    write(here / "zeros.csv", [1, 2, 3, 5, 10, 20, 40, 60, 80], [1, 0.6, 0.4, 0.15, 0, 0, 0, 0, 0])
    assert run("zeros.csv", "--inset", "1.5mm") == 0
    capsys.readouterr()


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow)
                                       for k in range(1, 5))])
def test_a_far_field_of_noise_is_fitted(here, capsys, seed):
    d = np.append(np.linspace(1, 8, 5), np.linspace(25, 80, 20))
    noise = 2e-3 * np.random.default_rng(seed).standard_normal(25)
    write(here / "noise.csv", d, np.exp(-d / 2.5) + noise)
    assert run("noise.csv", "--inset", "1.5mm") == 0
    capsys.readouterr()


def test_forces_must_fall_over_the_range_that_is_fitted(here, capsys):
    write(here / "peak.csv", [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0], [1, 2, 3, 2, 1, 0.5, 0.2])
    assert run("peak.csv", "--inset", "1.5mm") == 0
    capsys.readouterr()
    assert "peak.csv: force: 1.0 is the correlation of the ranks" in refused(
        capsys, here, "peak.csv", "--inset", "1.5mm", "--range", ":3mm")


@pytest.mark.parametrize(("content", "message"), [bad[1:] for bad in BAD],
                         ids=[bad[0] for bad in BAD])
def test_a_bad_file_is_one_clear_error(here, capsys, content, message):
    (here / "bad.csv").write_bytes(content)
    err = refused(capsys, here, "bad.csv", "--inset", "1.5mm")
    assert "bad.csv: " in err
    assert message in err


def test_a_file_that_cannot_be_read_is_one_clear_error(here, capsys):
    assert "absent.csv: must be a CSV file that can be read: No such file" in refused(
        capsys, here, "absent.csv", "--inset", "0mm")
    (here / "folder").mkdir()
    assert "Is a directory" in refused(capsys, here, "folder", "--inset", "0mm")
    with open(here / "long.csv", "wb") as file:
        file.truncate(2 * LARGEST)
    with pytest.raises(InputError, match="must be a CSV file of at most"):
        read(here / "long.csv")


@pytest.mark.parametrize(("options", "message"), [
    ([], "--inset: is missing; must be how deep the magnets' centres lie"),
    (["--inset", "1.5"], "--inset: '1.5' must be a number with its unit, mm, cm, m"),
    (["--inset", "deep"], "--inset: 'deep' must be a number with its unit"),
    (["--inset=-1mm"], "--inset: '-1mm' must be a length from 0"),
    (["--inset", "1mm", "--distance", "centre"], "--distance: 'centre' must be gap, as the header"),
    (["--inset", "1mm", "--range", "5mm"], "--range: '5mm' must be two distances, LOW:HIGH"),
    (["--inset", "1mm", "--range", "5:8"], "--range: '5' must be a number with its unit"),
    (["--inset", "1mm", "--range", "26mm:"], "--range: '26mm:' leaves 1 of 15 points"),
    (["--inset", "1mm", "--range", "9mm:1mm"], "leaves 0 of 15 points"),
    (["--inset", "1mm", "--fix", "gamma=1mm"], "--fix: 'gamma=1mm' must be NAME=VALUE"),
    (["--inset", "1mm", "--fix", "beta"], "must be NAME=VALUE, the name one of alpha, beta"),
    (["--inset", "1mm", "--fix", "beta=5"], "--fix beta: '5' must be a number with its unit"),
    (["--inset", "1mm", "--fix", "beta=-5mm"], "must be from 0 to 10 m"),
    (["--inset", "1mm", "--fix", "alpha=0Ncm2"], "'alpha=0Ncm2' must be above 0, or there is no f"),
    (["--inset", "1mm", "--fix", "alpha=nanNm2"], "must be a number with its unit"),
    (["--inset", "1mm", "--fix", "beta=1mm", "--bound", "beta=:2mm"], "the only --fix or --bound"),
    (["--inset", "1mm", "--fix", "beta=1mm", "--fix", "alpha=1Nmm2"], "cannot be fitted: all"),
    (["--inset", "1mm", "--bound", "beta=1mm"], "must be NAME=LOW:HIGH"),
    (["--inset", "1mm", "--bound", "beta=2mm:1mm"], "must be in rising order"),
    (["--inset", "0mm", "--model", "power"], "--model: 'power' cannot be fitted"),
    (["--inset", "1mm", "--loss", "huber", "--interval", "profile"], "--interval: 'profile'"),
    (["--inset", "1mm", "--loss", "cauchy", "--interval", "bootstrap"],
     "--interval: 'bootstrap' cannot be had: a bootstrap needs loss linear"),
    (["--inset", "1mm", "--unweighted", "--fix", "exponent=two"], "'two' must be a number"),
    (["--inset", "1mm", "--out", "good.csv"], "--out: 'good.csv' must be a folder"),
    (["--inset", "1mm", "--scene", "absent.toml"], "absent.toml: must be a TOML file"),
    (["--inset", "1mm", "--scene", "run/scene.toml"], "--scene: 'run/scene.toml' must be another "
     "file: it is the run's own"),
    (["--inset", "1mm", "--scene", "good.csv"], "good.csv: must be valid TOML"),
    (["--inset", "16mm", "--scene", "scene.toml"], "magnet.inset: 0.016 must be a number from 0"),
    (["--inset", "1mm", "--scene", "inline.toml"], "magnet: must be a table of its own"),
    (["--inset", "1mm", "--model", "power", "--scene", "scene.toml"], "--model: 'power' must be"),
])
def test_a_bad_option_is_one_clear_error(here, capsys, options, message):
    scene = '[tiles]\nset = "chessboard"\n[seed]\nshape = "L"\narm = 2\n'
    (here / "scene.toml").write_text(scene)
    (here / "inline.toml").write_text("magnet = {mismatch = 0}\n" + scene)
    (here / "run").mkdir()
    (here / "run" / "scene.toml").write_text(scene)
    (here / "run" / "run.json").write_text("{}")
    assert message in refused(capsys, here, "good.csv", *options)


def test_words_that_are_not_options_are_refused_with_the_choices(here, capsys):
    for options in (["--model", "dipole"], ["--loss", "l1"], ["--unweighted", "--absolute"]):
        with pytest.raises(SystemExit) as end:
            run("good.csv", "--inset", "1mm", *options)
        assert end.value.code == 2
    assert "not allowed with" in capsys.readouterr().err


def test_uncertainties_that_are_not_there_cannot_be_absolute(here, capsys):
    write(here / "bare.csv", 1000 * R, TRUE)
    assert "--absolute: must be left out" in refused(
        capsys, here, "bare.csv", "--inset", "1mm", "--absolute")


@given(st.floats(1e-6, 1e3), st.sampled_from([*SIZES][:6]), st.sampled_from(["", " "]))
@settings(deadline=None, max_examples=50)
def test_a_quantity_is_its_number_times_its_unit(number, unit, space):
    assert quantity(f"{number!r}{space}{unit}", "m", "--x") == pytest.approx(number * SIZES[unit])
    assert quantity("0", "m", "--x") == 0


def test_the_command_is_listed(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    assert "fit a magnet model" in capsys.readouterr().out
