"""Phase monopulse: closed form, equivalent baselines, ambiguity and standard errors."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.angle.aperture import Aperture, FieldOfView
from dechirp.processing.angle.monopulse import Monopulse, displaced_element_pairs_per_angle
from dechirp.theory.bounds import crlb_angle


def linear_positions(y):
    y = np.asarray(y, float)
    return np.stack([0 * y, y, 0 * y], axis=1)


def draw_noise(shape, rng):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def estimate_trials(aperture, n, rng, *, max_angles=(1.1, 0.4)):
    truth = [
        rng.uniform(-limit, limit, n) * is_resolved
        for limit, is_resolved in zip(
            max_angles, aperture.resolves_azimuth_and_elevation, strict=True
        )
    ]
    x = 10 * aperture.steering_vectors(*truth) + draw_noise((n, aperture.n_elements), rng)
    return truth, Monopulse().find_directions(x[:, None], aperture, np.ones(n))


def test_two_elements_yield_arcsine_of_phase_difference():
    aperture = Aperture(linear_positions([0, 0.45]))
    for phase in (-2.0, -0.3, 0.0, 1.1):
        # The left element is nearer to a target on the left: its phase lags.
        x = np.array([[[1.0, np.exp(-1j * phase)]]])
        estimates = Monopulse().find_directions(x, aperture, np.full(1, 1e-4))
        assert estimates.azimuth_rad[0, 0] == pytest.approx(np.arcsin(phase / (2 * np.pi * 0.45)))


@pytest.mark.parametrize(
    ("y", "equivalent_spacing"),
    [
        ([0, 0.5], 0.5),
        # The noise of all elements but the end ones cancels.
        (np.arange(8) / 2, 3.5),
        # Two chains of pairs half a wavelength apart: 7 pairs with 4 end elements.
        (np.arange(9) / 4, 7 * 0.5 / np.sqrt(2)),
        # Two pairs without a common element.
        ([0, 0.5, 3.0, 3.5], 0.5 * np.sqrt(2)),
    ],
)
def test_linear_array_error_equals_bound_of_equivalent_element_pair(y, equivalent_spacing):
    aperture, n = Aperture(linear_positions(y)), 2000
    (azimuth, _), estimates = estimate_trials(aperture, n, np.random.default_rng(91))
    error = estimates.azimuth_rad[:, 0] - azimuth
    bound = crlb_angle(
        snr=100, positions_m=[0, equivalent_spacing], wavelength_m=1.0, angle_rad=azimuth
    )
    # The standard error of the ratio over 2,000 trials is 0.016.
    assert np.sqrt(np.mean((error / bound) ** 2)) == pytest.approx(1, abs=0.1)
    assert 0.85 < np.mean((error / estimates.azimuth_std_rad[:, 0]) ** 2) < 1.15


@pytest.mark.parametrize("is_sparse", [False, True])
def test_planar_array_estimates_both_angles_with_correct_standard_errors(is_sparse):
    grid = np.array([(0, y / 2, z / 2) for y in range(5) for z in range(4)])
    elements = [0, 1, 2, 4, 5, 7, 9, 10, 11, 13, 15, 19] if is_sparse else slice(None)
    aperture, n = Aperture(grid[elements], FieldOfView(elevation_rad=1.0)), 2000
    truth, estimates = estimate_trials(aperture, n, np.random.default_rng(92))
    for axis in (0, 1):
        error = (estimates[axis][:, 0] - truth[axis]) / estimates[axis + 2][:, 0]
        assert 0.85 < np.mean(error**2) < 1.15


def test_sparse_plane_with_oblique_pairs_estimates_both_angles():
    aperture = Aperture(np.array([(0, 0, 0), (0, 0.3, 0.2), (0, -0.2, 0.35)]))
    (azimuth, elevation), estimates = estimate_trials(
        aperture, 2000, np.random.default_rng(93), max_angles=(0.6, 0.2)
    )
    for truth, angles, std in (
        (azimuth, estimates.azimuth_rad, estimates.azimuth_std_rad),
        (elevation, estimates.elevation_rad, estimates.elevation_std_rad),
    ):
        assert 0.85 < np.mean(((angles[:, 0] - truth) / std[:, 0]) ** 2) < 1.15
    first, second = (pairs.displacement for pairs in displaced_element_pairs_per_angle(aperture))
    assert abs(first[0] * second[1] - first[1] * second[0]) > 0.05


def test_full_array_resolves_phase_ambiguity_of_wide_spacing():
    aperture = Aperture(linear_positions([0, 0.8, 1.6, 2.7]))
    (azimuth, _), estimates = estimate_trials(aperture, 2000, np.random.default_rng(94))
    assert np.all(abs(estimates.azimuth_rad[:, 0] - azimuth) < 7 * estimates.azimuth_std_rad[:, 0])


def test_rejects_several_sources():
    for n_sources in (2, "mdl"):
        with pytest.raises(dc.InvalidSetting, match="n_sources"):
            Monopulse(n_sources=n_sources)


def test_rejects_array_without_coplanar_pairs():
    aperture = Aperture(np.array([(0, 0, 0), (0.1, 0.5, 0), (0.2, 1.0, 0)]))
    with pytest.raises(dc.InvalidSetting, match="bartlett"):
        Monopulse().find_directions(np.ones((1, 1, 3)), aperture, np.ones(1))
