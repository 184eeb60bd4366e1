"""Model order: number of sources by MDL and AIC, from one snapshot and from many."""

import numpy as np
import pytest

from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.covariance import Smoothing, array_smoothing_windows
from dechirp.processing.angle.esprit import Esprit
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.angle.model_order import estimate_n_sources
from dechirp.processing.angle.music import Music
from dechirp.processing.angle.root_music import RootMusic
from snapshots import (
    HALF_POWER_WIDTH,
    random_azimuth_pairs,
    random_phasors,
    simulate_snapshots,
    uniform_linear_array,
)

N_TRIALS = 2000
NOISE = 0.01


def simulate_sources(array, count, n, rng, n_snapshots=1, noise=NOISE):
    """Simulate one source, or two a beamwidth apart, of random phase."""
    length = np.ptp(array.positions[:, 1]) + 0.5
    azimuth = random_azimuth_pairs(array, HALF_POWER_WIDTH / length, n, rng)[:, :count]
    return simulate_snapshots(
        array, random_phasors((n, count, n_snapshots), rng), noise, rng, azimuth
    )


@pytest.mark.parametrize("criterion", ["mdl", "aic"])
@pytest.mark.parametrize("n_elements", [8, 12])
@pytest.mark.parametrize("count", [1, 2])
def test_model_order_of_one_snapshot_matches_number_of_sources(count, n_elements, criterion):
    array = uniform_linear_array(n_elements)
    x = simulate_sources(array, count, N_TRIALS, np.random.default_rng(721), noise=NOISE)
    directions = estimate_n_sources(x, array, np.full(N_TRIALS, NOISE), criterion)
    # Noise alone exceeds the penalty in less than one trial in a hundred.
    assert np.mean(directions == count) > 0.98


def test_three_sources_are_counted_in_uncorrelated_snapshots():
    # Uneven array: one window. Case of Wax and Kailath: independent snapshots.
    array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1, 4.4, 5])[:, None] * [0, 1, 0])
    rng = np.random.default_rng(722)
    azimuth = np.tile([-0.5, 0.0, 0.4], (N_TRIALS, 1))
    x = simulate_snapshots(
        array, rng.normal(size=(N_TRIALS, 3, 50, 2)) @ [1, 1j], 0.1, rng, azimuth
    )
    assert np.mean(estimate_n_sources(x, array, np.full(N_TRIALS, 0.1), "mdl") == 3) > 0.99
    assert np.mean(estimate_n_sources(x, array, np.full(N_TRIALS, 0.1), "aic") == 3) > 0.95


def test_overlapping_windows_have_stated_number_of_independent_snapshots():
    # Mean power over all windows has the variance of n_independent independent numbers.
    array, rng = uniform_linear_array(12), np.random.default_rng(723)
    windows = array_smoothing_windows(array, Smoothing())
    x = simulate_snapshots(array, np.zeros((20_000, 1, 1)), 1.0, rng, np.zeros((20_000, 1)))
    power = np.mean(np.abs(windows.window_data_matrices(x)) ** 2, axis=(1, 2))
    # The variance of 20,000 powers has a standard error of 1.2 %.
    assert 1 / np.var(power) == pytest.approx(windows.n_independent_values_per_snapshot, rel=0.08)
    # 1 2 3 4 5 5 5 5 4 3 2 1: 40^2 / 160.
    assert windows.n_independent_values_per_snapshot == pytest.approx(10)


def test_noise_and_single_uneven_snapshot_give_order_one():
    rng = np.random.default_rng(724)
    noise = simulate_snapshots(
        uniform_linear_array(8), np.zeros((N_TRIALS, 1, 1)), NOISE, rng, np.zeros((N_TRIALS, 1))
    )
    assert (
        np.mean(
            estimate_n_sources(noise, uniform_linear_array(8), np.full(N_TRIALS, NOISE), "mdl") == 1
        )
        > 0.98
    )
    uneven_array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1])[:, None] * [0, 1, 0])
    x = simulate_sources(uneven_array, 2, 10, rng)
    assert np.all(estimate_n_sources(x, uneven_array, np.full(10, NOISE), "mdl") == 1)


@pytest.mark.parametrize("member", [Capon, Esprit, MaximumLikelihood, Music, RootMusic])
def test_each_method_finds_correct_number_of_directions(member):
    rng, array = np.random.default_rng(725), uniform_linear_array(12)
    x = np.concatenate([simulate_sources(array, count, 300, rng) for count in (1, 2)])
    directions = member(n_sources="mdl").find_directions(x, array, np.full(600, NOISE))
    counts = np.sum(np.isfinite(directions.azimuth_rad), axis=1)
    assert np.array_equal(counts, np.sum(np.isfinite(directions.azimuth_std_rad), axis=1))
    assert np.mean(counts[:300] == 1) > 0.85
    assert np.mean(counts[300:] == 2) > 0.95


def test_false_second_source_rate_is_below_beam_bound():
    # Noise has some 2 n independent beams of exponential power: the false rate is at most
    # 2 n exp(-penalty), with a penalty of 5/2 ln n for MDL.
    array, rng = uniform_linear_array(12), np.random.default_rng(726)
    x = simulate_sources(array, 1, N_TRIALS, rng)
    directions = MaximumLikelihood(n_sources="mdl").find_directions(
        x, array, np.full(N_TRIALS, NOISE)
    )
    share = np.mean(np.isfinite(directions.azimuth_rad[:, 1]))
    assert 0 < share < 24 * 12**-2.5 + 5 * np.sqrt(0.05 / N_TRIALS)
    directions = MaximumLikelihood(n_sources="aic").find_directions(
        x, array, np.full(N_TRIALS, NOISE)
    )
    # AIC: a penalty of 3 for 2 n beams.
    assert np.mean(np.isfinite(directions.azimuth_rad[:, 1])) > 0.3


def test_rounding_without_noise_adds_no_source():
    array, rng = uniform_linear_array(12), np.random.default_rng(727)
    x = simulate_sources(array, 2, 20, rng, noise=0.0).astype(np.complex64)
    for member in (Esprit, MaximumLikelihood):
        directions = member(n_sources="mdl").find_directions(x, array, np.zeros(20))
        assert np.all(np.sum(np.isfinite(directions.azimuth_rad), axis=1) == 2)
