"""The law of cell averaging against brute force, closed forms, a table and simulation."""

from dataclasses import replace

import numpy as np
import pytest
from mpmath import binomial, mp, mpf
from scipy.optimize import brentq

from dechirp.core.errors import InvalidSetting
from dechirp.processing.cfar.base import Cells, MapNoise, TrainingWindow
from dechirp.processing.spectrum import Transform
from dechirp.theory.cfar import cell_averaging_factor
from dechirp.theory.cfar_correlated_cells import CorrelatedWindow, correlated_factor


def by_eigenvalues(box, a, n_summed):
    """False-alarm probability of a factor a N, from the eigenvalues of the whole ring."""
    covariance = np.kron(box.range_covariance, box.velocity_covariance)
    weights = np.full((len(box.range_covariance), len(box.velocity_covariance)), -a)
    weights[box.guard_range, box.guard_velocity] = 0
    weights[box.cell_under_test] = 1
    used = np.flatnonzero(weights)
    # Those of R A, R the covariance and A the weights, are those of B* A B with R = B B*.
    spread, turned = np.linalg.eigh(covariance[np.ix_(used, used)])
    root = turned * np.sqrt(np.clip(spread, 0, None))
    values = np.linalg.eigvalsh(root.conj().T @ (weights.ravel()[used, None] * root))
    top = values.max()
    mu = -values[values < top] / top
    sums = [n_summed * np.sum((mu / (1 + mu)) ** i) for i in range(n_summed)]
    terms = [np.exp(-n_summed * np.sum(np.log1p(mu)))]
    for j in range(1, n_summed):
        terms.append(sum(sums[i] * terms[j - i] for i in range(1, j + 1)) / j)
    return sum(terms)


CASES = [
    ("rectangular", 2200, "rectangular", 128),
    ("hann", 2200, "hann", 128),
    ("rectangular", 4096, "rectangular", 256),
    ("hann", 4096, "hann", 128),
    ("blackman", 2200, "hamming", 131),
]


@pytest.mark.parametrize("n_summed", [1, 2, 8])
@pytest.mark.parametrize("place", [0, 5, 14])
@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_factor_gives_its_probability_by_the_eigenvalues_of_the_ring(case, place, n_summed):
    window, n_bins, doppler_window, n_velocity_bins = case
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
        doppler_transform=Transform(window=doppler_window, n_points=128, n_bins=n_velocity_bins),
    )
    ring = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    box = ring.noise_box(noise, place)

    factor = correlated_factor(1e-6, box, n_summed=n_summed)

    found = by_eigenvalues(box, factor / box.n_training, n_summed)
    # Eigenvalues of a matrix of 645 rows that is nearly singular when padded.
    assert found == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("place", [0, 5, 14])
@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_mean_of_the_ring_varies_as_that_of_its_independent_cells(case, place):
    window, n_bins, doppler_window, n_velocity_bins = case
    noise = MapNoise(
        range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
        doppler_transform=Transform(window=doppler_window, n_points=128, n_bins=n_velocity_bins),
    )
    ring = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    box = ring.noise_box(noise, place)

    trains = np.ones((len(box.range_covariance), len(box.velocity_covariance)))
    trains[box.guard_range, box.guard_velocity] = 0
    # Of powers with a mean of 1: |rho|^2 is their covariance.
    covariance = abs(np.kron(box.range_covariance, box.velocity_covariance)) ** 2
    variance = trains.ravel() @ covariance @ trains.ravel() / trains.sum() ** 2
    assert box.n_independent == pytest.approx(1 / variance, rel=1e-12)


def hann_box(n_range, n_velocity):
    """Cells of noise under Hann windows, those about the cell under test all training."""
    along = [
        Transform(window="hann", n_points=4096, n_bins=4096).noise_correlation(n)
        for n in (n_range, n_velocity)
    ]
    middle = (n_range // 2, n_velocity // 2)
    guard = [slice(cell, cell + 1) for cell in middle]
    return CorrelatedWindow(
        range_covariance=along[0],
        velocity_covariance=along[1],
        guard_range=guard[0],
        guard_velocity=guard[1],
        cell_under_test=middle,
    )


def test_hann_windows_leave_a_cell_in_1_944_independent_along_an_axis_and_in_3_78_along_two():
    # 1 + 2 (4 / 9 + 1 / 36) along an axis; cells at the ends and about the cell under test
    # have fewer neighbours, one in a thousand here.
    for box in (hann_box(2000, 1), hann_box(1, 2000)):
        assert box.n_training / box.n_independent == pytest.approx(1.944, rel=2e-3)
    box = hann_box(600, 600)
    assert box.n_training / box.n_independent == pytest.approx(3.78, rel=2e-3)


def test_the_approximate_law_of_independent_cells_is_close_to_the_exact_one():
    ring = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    for window, n_bins, n_velocity_bins, within in (
        ("hann", 2200, 128, 5e-4),
        ("hann", 4096, 128, 2e-3),
        ("rectangular", 4096, 256, 5e-3),
    ):
        noise = MapNoise(
            range_transform=Transform(window=window, n_points=2200, n_bins=n_bins),
            doppler_transform=Transform(window=window, n_points=128, n_bins=n_velocity_bins),
        )
        box = ring.noise_box(noise, 14)
        n_training = round(box.n_independent)
        assert cell_averaging_factor(1e-6, n_training=n_training) == pytest.approx(
            correlated_factor(1e-6, box), rel=within
        )


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("range_covariance", np.ones((29, 28))),
        ("velocity_covariance", np.ones(25)),
        ("guard_range", slice(-1, 20)),
        ("guard_range", slice(10, 30)),
        ("guard_range", slice(20, 10)),
        ("guard_velocity", slice(None, 17)),
        ("guard_velocity", slice(8, 17, 2)),
        ("under_test", (9, 12)),
        ("under_test", (14, 17)),
        ("under_test", (14, 12.5)),
    ],
    ids=str,
)
def test_a_box_that_does_not_hold_its_guard_and_its_cell_under_test_is_refused(name, wrong):
    box = CorrelatedWindow(
        range_covariance=np.eye(29),
        velocity_covariance=np.eye(25),
        guard_range=slice(10, 19),
        guard_velocity=slice(8, 17),
        cell_under_test=(14, 12),
    )
    with pytest.raises(InvalidSetting, match=rf"^Box\.{name}"):
        replace(box, **{name: wrong})


def test_the_ring_of_the_reference_has_644_cells():
    ring = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    noise = MapNoise(
        range_transform=Transform(window="rectangular", n_points=2200, n_bins=2200),
        doppler_transform=Transform(window="rectangular", n_points=128, n_bins=128),
    )
    assert ring.noise_box(noise, 14).n_training == 644
    assert ring.noise_box(noise, 14).n_independent == pytest.approx(644, rel=1e-12)
    assert cell_averaging_factor(1e-6, n_training=644) == pytest.approx(13.965, abs=5e-4)


def test_independent_cells_are_a_case_of_the_correlated_law():
    ring = TrainingWindow(n_training=Cells(range=3, velocity=2), n_guard=Cells(range=1, velocity=1))
    noise = MapNoise(
        range_transform=Transform(window="rectangular", n_points=64, n_bins=64),
        doppler_transform=Transform(window="rectangular", n_points=32, n_bins=32),
    )
    box = ring.noise_box(noise, 4)
    for n_summed in (1, 3):
        exact = cell_averaging_factor(1e-4, n_training=box.n_training, n_summed=n_summed)
        found = correlated_factor(1e-4, box, n_summed=n_summed)
        assert found == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("n_training", [1, 16, 644, 10_000])
@pytest.mark.parametrize("n_summed", [1, 2, 16])
@pytest.mark.parametrize("pfa", [1e-12, 1e-6, 0.5])
def test_the_independent_law_holds_in_forty_digits(n_training, n_summed, pfa):
    factor = cell_averaging_factor(pfa, n_training=n_training, n_summed=n_summed)
    mp.dps = 40
    a, shape = mpf(factor) / n_training, n_training * n_summed
    found = sum(binomial(shape + j - 1, j) * a**j / (1 + a) ** (shape + j) for j in range(n_summed))
    assert float(found) == pytest.approx(pfa, rel=1e-9)


def test_hann_windows_make_the_independent_factor_alarm_half_again_as_often():
    noise = MapNoise(
        range_transform=Transform(window="hann", n_points=2200, n_bins=2200),
        doppler_transform=Transform(window="hann", n_points=128, n_bins=128),
    )
    ring = TrainingWindow(
        n_training=Cells(range=10, velocity=8), n_guard=Cells(range=4, velocity=4)
    )
    box = ring.noise_box(noise, 14)
    naive = cell_averaging_factor(1e-6, n_training=box.n_training)

    def excess(log_pfa):
        return correlated_factor(np.exp(log_pfa), box) - naive

    # A simulation of 8.4e8 such cells elsewhere measured 1.48e-6 with a standard error of
    # 0.04e-6; four of them.
    found = np.exp(brentq(excess, np.log(1e-7), np.log(1e-5)))
    assert found == pytest.approx(1.48e-6, abs=0.16e-6)
