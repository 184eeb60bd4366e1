"""Maximum-likelihood direction finding: Cramer-Rao bound for one and two sources on any array."""

import numpy as np
import pytest

from dechirp import InvalidSetting
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.theory.bounds import crlb_angle
from dechirp.theory.direction_bounds import direction_std_rad
from nightly import nightly_except
from snapshots import (
    HALF_POWER_WIDTH,
    random_azimuth_pairs,
    random_phasors,
    rectangular_array,
    simulate_snapshots,
    uniform_linear_array,
)

N_TRIALS = 2500
NOISE_POWER = 0.01  # 20 dB below each source, in one element
# The mean of n squared standard normal numbers stays within 5 sqrt(2 / n) of 1 with probability 1 -
# 6e-7.
MEAN_SQUARE = 5 * np.sqrt(2 / N_TRIALS)
SPARSE_ARRAY = Aperture(
    positions=np.array(
        [
            *[(0, 0, 0), (0, 0.5, 0), (0, 1.6, 0.2), (0.1, 2.4, 1.1), (0, 3.3, 0.6)],
            *[(0, 3.9, 1.9), (0, 0.3, 1.5), (0.05, 1.9, 2.2), (0, 2.9, 0.1), (0, 0.9, 0.8)],
        ]
    )
)


@pytest.mark.parametrize("n_elements", [8, 12])
def test_single_source_reaches_crlb(n_elements):
    rng = np.random.default_rng(711)
    array = uniform_linear_array(n_elements)
    azimuth = rng.uniform(-0.9, 0.9, size=(N_TRIALS, 1))
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 1, 1), rng), NOISE_POWER, rng, azimuth)
    estimates = MaximumLikelihood().find_directions(x, array, np.full(N_TRIALS, NOISE_POWER))

    error = estimates.azimuth_rad - azimuth
    bound = crlb_angle(
        snr=1 / NOISE_POWER, positions_m=array.positions[:, 1], wavelength_m=1.0, angle_rad=azimuth
    )
    ratio = np.sqrt(np.mean((error / bound) ** 2))
    print(f"maximum-likelihood, {n_elements} elements: {ratio:.3f} times the bound")
    assert ratio == pytest.approx(1, abs=MEAN_SQUARE / 2)
    assert np.mean((error / estimates.azimuth_std_rad) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)


@pytest.mark.parametrize("n_elements", nightly_except(1, [8, 12]))
def test_two_sources_one_beamwidth_apart_reach_crlb_at_any_phase(n_elements):
    rng = np.random.default_rng(712)
    array, spacing = uniform_linear_array(n_elements), HALF_POWER_WIDTH / (n_elements / 2)
    azimuth, amplitudes = (
        random_azimuth_pairs(array, spacing, N_TRIALS, rng),
        random_phasors((N_TRIALS, 2, 1), rng),
    )
    x = simulate_snapshots(array, amplitudes, NOISE_POWER, rng, azimuth)
    estimates = MaximumLikelihood(n_sources=2).find_directions(
        x, array, np.full(N_TRIALS, NOISE_POWER)
    )

    order = np.argsort(estimates.azimuth_rad, axis=1)
    error = np.take_along_axis(estimates.azimuth_rad, order, axis=1) - azimuth
    std = np.take_along_axis(estimates.azimuth_std_rad, order, axis=1)
    bound = [
        direction_std_rad(
            positions=array.positions,
            azimuth_rad=source_azimuths,
            amplitudes=source_amplitudes,
            noise_power=NOISE_POWER,
        )[:, 0]
        for source_azimuths, source_amplitudes in zip(azimuth[:500], amplitudes[:500], strict=True)
    ]
    resolved = np.all(np.abs(np.sin(azimuth + error) - np.sin(azimuth)) < spacing / 2, axis=1)
    print(f"maximum-likelihood, {n_elements} elements: {np.mean(resolved):.4f} resolved")
    assert np.mean(resolved) > 0.999  # the bound is at most a tenth of the separation
    # The errors of a pair are correlated, in the worst case like a single number.
    assert np.mean((error / std) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)
    assert np.mean((error[:500] / bound) ** 2) == pytest.approx(1, abs=5 * np.sqrt(2 / 500))


def test_resolves_half_a_beamwidth_at_40_db():
    rng = np.random.default_rng(713)
    array, spacing = uniform_linear_array(12), HALF_POWER_WIDTH / 12
    azimuth = random_azimuth_pairs(array, spacing, N_TRIALS, rng)
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 2, 1), rng), 1e-4, rng, azimuth)
    estimates = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(N_TRIALS, 1e-4))
    error = np.sin(np.sort(estimates.azimuth_rad, axis=1)) - np.sin(azimuth)
    assert np.mean(np.all(np.abs(error) < spacing / 2, axis=1)) > 0.99


@pytest.mark.parametrize(
    "array", [rectangular_array(4, 3), SPARSE_ARRAY], ids=["rectangle", "sparse"]
)
def test_azimuth_and_elevation_reach_crlb_on_any_array(array):
    rng = np.random.default_rng(714)
    azimuth, elevation = (
        rng.uniform(-0.7, 0.7, (N_TRIALS, 1)),
        rng.uniform(-0.4, 0.4, (N_TRIALS, 1)),
    )
    x = simulate_snapshots(
        array, random_phasors((N_TRIALS, 1, 1), rng), NOISE_POWER, rng, azimuth, elevation
    )
    estimates = MaximumLikelihood().find_directions(x, array, np.full(N_TRIALS, NOISE_POWER))
    for angle, std, truth in (
        (estimates.azimuth_rad, estimates.azimuth_std_rad, azimuth),
        (estimates.elevation_rad, estimates.elevation_std_rad, elevation),
    ):
        assert np.mean(((angle - truth) / std) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)


def test_resolves_two_sources_in_both_angles_on_sparse_array():
    n = 400
    rng = np.random.default_rng(715)
    azimuth, elevation = np.tile([-0.15, 0.2], (n, 1)), np.tile([0.2, -0.2], (n, 1))
    x = simulate_snapshots(
        SPARSE_ARRAY, random_phasors((n, 2, 1), rng), NOISE_POWER, rng, azimuth, elevation
    )
    estimates = MaximumLikelihood(n_sources=2).find_directions(
        x, SPARSE_ARRAY, np.full(n, NOISE_POWER)
    )
    order = np.argsort(estimates.azimuth_rad, axis=1)
    for name, truth in (("azimuth", azimuth), ("elevation", elevation)):
        angle, std = (
            np.take_along_axis(getattr(estimates, f"{name}_{suffix}"), order, axis=1)
            for suffix in ("rad", "std_rad")
        )
        normalised_square = np.mean(((angle - truth) / std) ** 2)
        assert normalised_square == pytest.approx(1, abs=5 * np.sqrt(2 / n))


def test_weak_source_next_to_strong_source_is_unbiased():
    # The weak source is 20 dB below the strong one and 1.5 beamwidths away: within its sidelobes.
    rng = np.random.default_rng(716)
    array = uniform_linear_array(12)
    azimuth = np.tile([0.1, 0.1 + 1.5 / 6], (N_TRIALS, 1))
    amplitudes = random_phasors((N_TRIALS, 2, 1), rng) * [[1.0], [0.1]]
    x = simulate_snapshots(array, amplitudes, 1e-4, rng, azimuth)
    estimates = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(N_TRIALS, 1e-4))
    error = (estimates.azimuth_rad - azimuth) / estimates.azimuth_std_rad
    assert np.mean(error**2) == pytest.approx(1, abs=MEAN_SQUARE)
    assert np.mean(estimates.power, axis=0) == pytest.approx([1, 0.01], rel=0.02)


def test_snapshots_are_integrated():
    rng = np.random.default_rng(717)
    array = uniform_linear_array(8)
    azimuth = np.full((N_TRIALS, 1), 0.2)
    single_snapshot, four_snapshots = (
        MaximumLikelihood().find_directions(
            simulate_snapshots(
                array, random_phasors((N_TRIALS, 1, n_snapshots), rng), NOISE_POWER, rng, azimuth
            ),
            array,
            np.full(N_TRIALS, NOISE_POWER),
        )
        for n_snapshots in (1, 4)
    )
    assert np.mean(four_snapshots.azimuth_std_rad) == pytest.approx(
        np.mean(single_snapshot.azimuth_std_rad) / 2, rel=0.01
    )
    normalised_square = np.mean(
        ((four_snapshots.azimuth_rad - 0.2) / four_snapshots.azimuth_std_rad) ** 2
    )
    assert normalised_square == pytest.approx(1, abs=MEAN_SQUARE)


def test_rejects_more_than_two_sources_and_suggests_alternative():
    with pytest.raises(InvalidSetting, match=r"1 or 2.*iterative-adaptive"):
        MaximumLikelihood(n_sources=3)


def test_rejects_two_sources_on_three_elements():
    rng = np.random.default_rng(719)
    x = simulate_snapshots(
        uniform_linear_array(3),
        random_phasors((5, 2, 1), rng),
        1e-4,
        rng,
        np.tile([-0.3, 0.4], (5, 1)),
    )
    with pytest.raises(InvalidSetting, match=r"2 at 3 virtual elements.*4 elements or more"):
        MaximumLikelihood(n_sources=2).find_directions(x, uniform_linear_array(3), np.full(5, 1e-4))
    estimates = MaximumLikelihood(n_sources="mdl").find_directions(
        x, uniform_linear_array(3), np.full(5, 1e-4)
    )
    assert estimates.azimuth_rad.shape == (5, 1)


def test_nonfinite_snapshots_yield_nan_and_leave_others_unchanged():
    rng = np.random.default_rng(718)
    array, azimuth = uniform_linear_array(8), np.tile([-0.1, 0.3], (3, 1))
    x = simulate_snapshots(array, random_phasors((3, 2, 1), rng), 1e-6, rng, azimuth)
    x[1, 0, 2] = np.inf
    estimates = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(3, 1e-6))
    assert np.sort(estimates.azimuth_rad[[0, 2]]) == pytest.approx(azimuth[:2], abs=2e-3)
    assert np.isnan(estimates.azimuth_rad[1]).all()
