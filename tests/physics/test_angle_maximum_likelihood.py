"""Maximum likelihood: the Cramer-Rao bound for one source and for two, on arrays of any shape."""

import numpy as np
import pytest

from dechirp import InvalidSetting
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.theory.bounds import angle_std_rad
from dechirp.theory.direction_bounds import direction_std_rad
from looks import HALF_POWER, line, pair, rectangle, snapshots, turns

N = 2500
NOISE = 0.01  # 20 dB below each source, in one element
# A mean of n squares of standard normal numbers stays within 5 sqrt(2 / n) of 1 but for 6e-7.
MEAN_SQUARE = 5 * np.sqrt(2 / N)
SPARSE = Aperture(
    positions=np.array(
        [
            *[(0, 0, 0), (0, 0.5, 0), (0, 1.6, 0.2), (0.1, 2.4, 1.1), (0, 3.3, 0.6)],
            *[(0, 3.9, 1.9), (0, 0.3, 1.5), (0.05, 1.9, 2.2), (0, 2.9, 0.1), (0, 0.9, 0.8)],
        ]
    )
)


@pytest.mark.parametrize("n_elements", [8, 12])
def test_one_source_reaches_the_bound(n_elements):
    rng = np.random.default_rng(711)
    array = line(n_elements)
    azimuth = rng.uniform(-0.9, 0.9, size=(N, 1))
    x = snapshots(array, turns((N, 1, 1), rng), NOISE, rng, azimuth)
    found = MaximumLikelihood().find_directions(x, array, np.full(N, NOISE))

    error = found.azimuth_rad - azimuth
    bound = angle_std_rad(
        snr=1 / NOISE, positions_m=array.positions[:, 1], wavelength_m=1.0, angle_rad=azimuth
    )
    ratio = np.sqrt(np.mean((error / bound) ** 2))
    print(f"maximum-likelihood, {n_elements} elements: {ratio:.3f} times the bound")
    assert ratio == pytest.approx(1, abs=MEAN_SQUARE / 2)
    assert np.mean((error / found.azimuth_std_rad) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)


@pytest.mark.parametrize("n_elements", [8, 12])
def test_two_sources_a_beamwidth_apart_reach_the_bound_of_two_whatever_their_phases(n_elements):
    rng = np.random.default_rng(712)
    array, apart = line(n_elements), HALF_POWER / (n_elements / 2)
    azimuth, amplitudes = pair(array, apart, N, rng), turns((N, 2, 1), rng)
    x = snapshots(array, amplitudes, NOISE, rng, azimuth)
    found = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(N, NOISE))

    order = np.argsort(found.azimuth_rad, axis=1)
    error = np.take_along_axis(found.azimuth_rad, order, axis=1) - azimuth
    std = np.take_along_axis(found.azimuth_std_rad, order, axis=1)
    bound = [
        direction_std_rad(
            positions=array.positions, azimuth_rad=one, amplitudes=both, noise_power=NOISE
        )[:, 0]
        for one, both in zip(azimuth[:500], amplitudes[:500], strict=True)
    ]
    resolved = np.all(np.abs(np.sin(azimuth + error) - np.sin(azimuth)) < apart / 2, axis=1)
    print(f"maximum-likelihood, {n_elements} elements: {np.mean(resolved):.4f} resolved")
    assert np.mean(resolved) > 0.999  # the bound is a tenth of what parts them, or less
    # The errors of a pair are correlated: as one number at worst.
    assert np.mean((error / std) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)
    assert np.mean((error[:500] / bound) ** 2) == pytest.approx(1, abs=5 * np.sqrt(2 / 500))


def test_half_a_beamwidth_is_resolved_at_40_db():
    rng = np.random.default_rng(713)
    array, apart = line(12), HALF_POWER / 12
    azimuth = pair(array, apart, N, rng)
    x = snapshots(array, turns((N, 2, 1), rng), 1e-4, rng, azimuth)
    found = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(N, 1e-4))
    error = np.sin(np.sort(found.azimuth_rad, axis=1)) - np.sin(azimuth)
    assert np.mean(np.all(np.abs(error) < apart / 2, axis=1)) > 0.99


@pytest.mark.parametrize("array", [rectangle(4, 3), SPARSE], ids=["rectangle", "anywhere"])
def test_azimuth_and_elevation_reach_their_bounds_on_arrays_of_any_shape(array):
    rng = np.random.default_rng(714)
    azimuth, elevation = rng.uniform(-0.7, 0.7, (N, 1)), rng.uniform(-0.4, 0.4, (N, 1))
    x = snapshots(array, turns((N, 1, 1), rng), NOISE, rng, azimuth, elevation)
    found = MaximumLikelihood().find_directions(x, array, np.full(N, NOISE))
    for angle, std, truth in (
        (found.azimuth_rad, found.azimuth_std_rad, azimuth),
        (found.elevation_rad, found.elevation_std_rad, elevation),
    ):
        assert np.mean(((angle - truth) / std) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)


def test_two_sources_are_parted_in_azimuth_and_elevation_on_any_array():
    n = 400
    rng = np.random.default_rng(715)
    azimuth, elevation = np.tile([-0.15, 0.2], (n, 1)), np.tile([0.2, -0.2], (n, 1))
    x = snapshots(SPARSE, turns((n, 2, 1), rng), NOISE, rng, azimuth, elevation)
    found = MaximumLikelihood(n_sources=2).find_directions(x, SPARSE, np.full(n, NOISE))
    order = np.argsort(found.azimuth_rad, axis=1)
    for name, truth in (("azimuth", azimuth), ("elevation", elevation)):
        angle, std = (
            np.take_along_axis(getattr(found, f"{name}_{what}"), order, axis=1)
            for what in ("rad", "std_rad")
        )
        square = np.mean(((angle - truth) / std) ** 2)
        assert square == pytest.approx(1, abs=5 * np.sqrt(2 / n))


def test_a_weak_source_beside_a_strong_one_is_found_without_its_pull():
    # 20 dB below, 1.5 beams away: in the sidelobes of the other.
    rng = np.random.default_rng(716)
    array = line(12)
    azimuth = np.tile([0.1, 0.1 + 1.5 / 6], (N, 1))
    amplitudes = turns((N, 2, 1), rng) * [[1.0], [0.1]]
    x = snapshots(array, amplitudes, 1e-4, rng, azimuth)
    found = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(N, 1e-4))
    error = (found.azimuth_rad - azimuth) / found.azimuth_std_rad
    assert np.mean(error**2) == pytest.approx(1, abs=MEAN_SQUARE)
    assert np.mean(found.power, axis=0) == pytest.approx([1, 0.01], rel=0.02)


def test_looks_add_up():
    rng = np.random.default_rng(717)
    array = line(8)
    azimuth = np.full((N, 1), 0.2)
    one, four = (
        MaximumLikelihood().find_directions(
            snapshots(array, turns((N, 1, n_looks), rng), NOISE, rng, azimuth),
            array,
            np.full(N, NOISE),
        )
        for n_looks in (1, 4)
    )
    assert np.mean(four.azimuth_std_rad) == pytest.approx(
        np.mean(one.azimuth_std_rad) / 2, rel=0.01
    )
    square = np.mean(((four.azimuth_rad - 0.2) / four.azimuth_std_rad) ** 2)
    assert square == pytest.approx(1, abs=MEAN_SQUARE)


def test_more_than_two_sources_are_refused_with_what_to_take():
    with pytest.raises(InvalidSetting, match=r"1 or 2.*iterative-adaptive"):
        MaximumLikelihood(n_sources=3)


def test_two_sources_have_more_unknowns_than_three_elements_have_numbers():
    rng = np.random.default_rng(719)
    x = snapshots(line(3), turns((5, 2, 1), rng), 1e-4, rng, np.tile([-0.3, 0.4], (5, 1)))
    with pytest.raises(InvalidSetting, match=r"2 at 3 virtual elements.*4 elements or more"):
        MaximumLikelihood(n_sources=2).find_directions(x, line(3), np.full(5, 1e-4))
    found = MaximumLikelihood(n_sources="mdl").find_directions(x, line(3), np.full(5, 1e-4))
    assert found.azimuth_rad.shape == (5, 1)


def test_snapshots_that_are_not_finite_have_no_direction_and_spoil_no_other():
    rng = np.random.default_rng(718)
    array, azimuth = line(8), np.tile([-0.1, 0.3], (3, 1))
    x = snapshots(array, turns((3, 2, 1), rng), 1e-6, rng, azimuth)
    x[1, 0, 2] = np.inf
    found = MaximumLikelihood(n_sources=2).find_directions(x, array, np.full(3, 1e-6))
    assert np.sort(found.azimuth_rad[[0, 2]]) == pytest.approx(azimuth[:2], abs=2e-3)
    assert np.isnan(found.azimuth_rad[1]).all()
