"""MUSIC, Root-MUSIC, ESPRIT and Capon: errors, resolution, arrays and rejected settings."""

import numpy as np
import pytest

from dechirp import InvalidSetting
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.covariance import Smoothing, array_smoothing_windows
from dechirp.processing.angle.esprit import Esprit
from dechirp.processing.angle.music import Music
from dechirp.processing.angle.root_music import RootMusic
from dechirp.theory.bounds import crlb_angle
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
ALL_METHODS = [Capon, Esprit, Music, RootMusic]
LINE_METHODS = [Esprit, RootMusic]


def noise_powers(n):
    return np.full(n, NOISE_POWER)


# The mean of n squared standard normal numbers stays within 5 sqrt(2 / n) of 1 with probability 1 -
# 6e-7.
MEAN_SQUARE = 5 * np.sqrt(2 / N_TRIALS)


@pytest.mark.parametrize("n_elements", [8, 12])
@pytest.mark.parametrize("method", nightly_except(2, ALL_METHODS))
def test_single_source_is_close_to_crlb_with_correct_standard_error(method, n_elements):
    rng = np.random.default_rng(701)
    array = uniform_linear_array(n_elements)
    azimuth = rng.uniform(-0.8, 0.8, size=(N_TRIALS, 1))
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 1, 1), rng), NOISE_POWER, rng, azimuth)
    estimates = method().find_directions(x, array, noise_powers(N_TRIALS))

    error = estimates.azimuth_rad - azimuth
    bound = crlb_angle(
        snr=1 / NOISE_POWER, positions_m=array.positions[:, 1], wavelength_m=1.0, angle_rad=azimuth
    )
    ratio = np.sqrt(np.mean((error / bound) ** 2))
    print(f"{method.kind()}, {n_elements} elements: {ratio:.3f} times the bound")
    assert 1 - MEAN_SQUARE / 2 < ratio < 1.3  # two-thirds subarrays; the limit for ESPRIT is 1.7
    assert np.mean((error / estimates.azimuth_std_rad) ** 2) == pytest.approx(1, abs=MEAN_SQUARE)
    # The maximum-likelihood power includes the noise of 1.5 numbers.
    assert np.mean(estimates.power) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("n_elements", [8, 12])
@pytest.mark.parametrize("method", nightly_except(1, ALL_METHODS))
def test_resolves_sources_one_beamwidth_apart_in_one_snapshot(method, n_elements):
    rng = np.random.default_rng(702)
    array = uniform_linear_array(n_elements)
    spacing = HALF_POWER_WIDTH / (n_elements / 2)
    azimuth = random_azimuth_pairs(array, spacing, N_TRIALS, rng)
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 2, 1), rng), NOISE_POWER, rng, azimuth)
    estimates = method(n_sources=2).find_directions(x, array, noise_powers(N_TRIALS))

    order = np.argsort(estimates.azimuth_rad, axis=1)
    azimuth_estimates = np.take_along_axis(estimates.azimuth_rad, order, axis=1)
    std = np.take_along_axis(estimates.azimuth_std_rad, order, axis=1)
    resolved = np.all(np.abs(np.sin(azimuth_estimates) - np.sin(azimuth)) < spacing / 2, axis=1)
    print(f"{method.kind()}, {n_elements} elements: {np.mean(resolved):.4f} resolved")
    assert np.mean(resolved) > 0.99  # measured: 0.999
    normalised_square = np.mean(((azimuth_estimates - azimuth) / std)[resolved] ** 2)
    # First-order perturbation theory omits the loading of Capon and merged beams.
    assert normalised_square == pytest.approx(1, abs=0.25 if method is Capon else 0.15)


@pytest.mark.parametrize("method", LINE_METHODS)
def test_noise_free_linear_array_finds_maximum_number_of_sources(method):
    array = uniform_linear_array(12)
    azimuth = np.arcsin([[-0.7, -0.3, 0.0, 0.25, 0.6]])
    amplitudes = np.array([1, 0.5, 1j, -0.3, 0.8])[None, :, None]
    x = simulate_snapshots(array, amplitudes, 0.0, np.random.default_rng(0), azimuth)
    estimates = method(n_sources=5).find_directions(x, array, np.array([1e-12]))
    # Roots of the null spectrum are double, which halves the number of digits.
    assert np.sort(estimates.azimuth_rad) == pytest.approx(azimuth, abs=1e-6)
    assert estimates.power[0] == pytest.approx([1, 1, 0.64, 0.25, 0.09], rel=1e-5)


@pytest.mark.parametrize("method", LINE_METHODS)
def test_vertical_array_estimates_elevation_only(method):
    column = Aperture(positions=np.arange(8)[:, None] * [0, 0, 0.5])
    rng = np.random.default_rng(703)
    elevation = np.array([[0.2], [-0.4]])
    x = simulate_snapshots(
        column, random_phasors((2, 1, 1), rng), 1e-6, rng, 0 * elevation, elevation
    )
    estimates = method().find_directions(x, column, np.full(2, 1e-6))
    assert estimates.elevation_rad == pytest.approx(elevation, abs=1e-3)
    assert np.isnan(estimates.azimuth_rad).all() and np.isnan(estimates.azimuth_std_rad).all()


@pytest.mark.parametrize("method", LINE_METHODS)
def test_two_row_array_estimates_azimuth_with_its_longest_row(method):
    # Eight elements in a line and four half a wavelength above: the usual 3 x 4 array of a chip.
    row = [(0, column / 2, 0) for column in range(8)]
    array = Aperture(positions=np.array(row + [(0, column / 2 + 1, 0.5) for column in range(4)]))
    rng = np.random.default_rng(704)
    azimuth = np.full((N_TRIALS, 1), 0.3)
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 1, 1), rng), NOISE_POWER, rng, azimuth)
    estimates = method().find_directions(x, array, noise_powers(N_TRIALS))
    normalised_square = np.mean(((estimates.azimuth_rad - 0.3) / estimates.azimuth_std_rad) ** 2)
    assert normalised_square == pytest.approx(1, abs=MEAN_SQUARE)
    assert np.isnan(estimates.elevation_rad).all()


@pytest.mark.parametrize("method", LINE_METHODS)
def test_row_of_planar_array_biases_azimuth_of_high_targets_and_warns(method):
    # A line resolves the cone angle only: arcsin(cos 30 sin 60) = 48.6 degrees, 11.4 less than 60.
    array, estimator = rectangular_array(8, 3), method()
    elevation, azimuth = np.pi / 6, np.pi / 3
    x = array.steering_vectors(azimuth, elevation)[None, None]
    estimates = estimator.find_directions(x, array, np.array([1e-9]))
    bias_deg = np.degrees(azimuth - estimates.azimuth_rad[0, 0])
    assert bias_deg == pytest.approx(11.41, abs=0.01)
    assert np.isnan(estimates.elevation_rad).all()
    (finding,) = estimator.array_ambiguity_findings(array)
    assert finding.level == "warning" and finding.setting == "chain.angle.kind"
    assert "azimuth 60 and elevation 30 deg by 11 deg" in finding.value


@pytest.mark.parametrize("method", LINE_METHODS)
def test_column_of_planar_array_estimates_elevation_at_any_azimuth(method):
    array, estimator = rectangular_array(3, 8), method()
    x = array.steering_vectors(0.7, 0.4)[None, None]
    estimates = estimator.find_directions(x, array, np.array([1e-9]))
    assert estimates.elevation_rad[0, 0] == pytest.approx(0.4, abs=1e-6)
    (finding,) = estimator.array_ambiguity_findings(array)
    assert "does not resolve azimuth" in finding.value
    assert (
        Music().array_ambiguity_findings(array) == []
        and estimator.array_ambiguity_findings(uniform_linear_array(8)) == []
    )


@pytest.mark.parametrize("size", [3, 8, 40])
def test_phase_factors_are_null_spectrum_roots_nearest_to_unit_circle(size):
    rng = np.random.default_rng(711)
    basis = np.linalg.qr(rng.normal(size=(5, size, 2)) + 1j * rng.normal(size=(5, size, 2)))[0]
    phase_factors = RootMusic().candidate_phase_factors(basis)
    for signal_basis, roots in zip(basis, phase_factors, strict=True):
        noise_projector = np.eye(size) - signal_basis @ signal_basis.conj().T
        coefficients = [np.trace(noise_projector, offset=d) for d in range(size - 1, -size, -1)]
        expected = np.roots(coefficients)
        expected = expected[np.argsort(-np.abs(expected))][size - 1 :]  # inner root of each pair
        assert np.abs(roots) == pytest.approx(np.abs(expected), abs=1e-8)
        distance = np.abs(roots[:, None] - expected).min(axis=1)
        assert distance.max() < 1e-8


def test_roots_at_origin_do_not_stop_root_search():
    # The basis has few nonzero rows: most coefficients are 0, and the corresponding roots are at
    # the origin.
    rng = np.random.default_rng(712)
    for size in range(2, 14):
        for n_nonzero in range(1, size):
            basis = np.zeros((20, size, 1), complex)
            nonzero_rows = [rng.choice(size, n_nonzero, replace=False) for _ in basis]
            for signal_basis, rows in zip(basis, nonzero_rows, strict=True):
                signal_basis[rows, 0] = rng.normal(size=n_nonzero) + 1j * rng.normal(size=n_nonzero)
            basis /= np.linalg.norm(basis, axis=1, keepdims=True)
            phase_factors = RootMusic().candidate_phase_factors(basis)
            assert np.isfinite(phase_factors).all() and (np.abs(phase_factors) < 1).all()


@pytest.mark.parametrize("method", ALL_METHODS)
def test_coincident_elements_are_averaged_with_correct_noise(method):
    # Three elements of two transmitters with five receivers each coincide.
    array = Aperture(positions=np.array([0, 1, 2, 3, 4, 2, 3, 4, 5, 6])[:, None] * [0, 0.5, 0])
    rng = np.random.default_rng(705)
    azimuth = rng.uniform(-0.8, 0.8, size=(N_TRIALS, 1))
    x = simulate_snapshots(array, random_phasors((N_TRIALS, 1, 1), rng), NOISE_POWER, rng, azimuth)
    estimates = method().find_directions(x, array, noise_powers(N_TRIALS))
    normalised_square = np.mean(
        ((estimates.azimuth_rad - azimuth) / estimates.azimuth_std_rad) ** 2
    )
    assert normalised_square == pytest.approx(1, abs=MEAN_SQUARE)


@pytest.mark.parametrize("method", [Capon, Music])
def test_rectangular_array_resolves_two_sources_in_both_angles(method):
    n = 200
    rng = np.random.default_rng(706)
    array = rectangular_array(8, 6)
    azimuth, elevation = np.tile([-0.15, 0.2], (n, 1)), np.tile([0.2, -0.15], (n, 1))
    x = simulate_snapshots(
        array, random_phasors((n, 2, 1), rng), NOISE_POWER, rng, azimuth, elevation
    )
    estimates = method(n_sources=2).find_directions(x, array, noise_powers(n))
    order = np.argsort(estimates.azimuth_rad, axis=1)
    for name, truth in (("azimuth", azimuth), ("elevation", elevation)):
        angle, std = (
            np.take_along_axis(getattr(estimates, f"{name}_{suffix}"), order, axis=1)
            for suffix in ("rad", "std_rad")
        )
        # 5 sqrt(2 / 400) for 400 errors, and a tenth for terms beyond first order.
        assert np.mean(((angle - truth) / std) ** 2) == pytest.approx(1, abs=0.45)


def test_incoherent_sources_need_no_spatial_smoothing():
    # The spacing is nonuniform, so snapshots replace spatial smoothing.
    array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1, 4.4])[:, None] * [0, 1, 0])
    rng = np.random.default_rng(707)
    azimuth = np.tile([-0.2, 0.25], (200, 1))
    x = simulate_snapshots(array, random_phasors((200, 2, 8), rng), NOISE_POWER, rng, azimuth)
    estimates = Music(n_sources=2).find_directions(x, array, noise_powers(200))
    error = (np.sort(estimates.azimuth_rad) - azimuth) / estimates.azimuth_std_rad.mean()
    assert np.abs(error).max() < 6


def test_spectra_equal_their_definitions():
    array, rng = uniform_linear_array(9), np.random.default_rng(708)
    x = simulate_snapshots(
        array,
        random_phasors((3, 2, 1), rng),
        NOISE_POWER,
        rng,
        random_azimuth_pairs(array, 0.5, 3, rng),
    )
    subarrays = array_smoothing_windows(array, Smoothing())
    data = subarrays.window_data_matrices(x)
    covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
    steering = array.steering_vectors(np.linspace(-1.2, 1.2, 101))
    subarray_steering = steering[:, subarrays.first_window_element_indices]

    capon = Capon(loading=1.0)
    inverse = np.linalg.inv(covariance + NOISE_POWER * np.eye(subarrays.n_window_points))
    expected = (
        1 / np.einsum("mi,nij,mj->nm", subarray_steering.conj(), inverse, subarray_steering).real
    )
    spectrum = capon.spectrum_at(capon.precompute_for_spectrum(x, array, noise_powers(3)), steering)
    assert spectrum == pytest.approx(expected, rel=1e-4)  # single precision

    music = Music(n_sources=2)
    noise = np.linalg.eigh(covariance)[1][:, :, :-2]
    distance = (
        np.sum(np.abs(subarray_steering.conj() @ noise) ** 2, axis=2) / subarrays.n_window_points
    )
    spectrum = music.spectrum_at(music.precompute_for_spectrum(x, array, noise_powers(3)), steering)
    assert 1 / spectrum == pytest.approx(distance, rel=1e-9, abs=1e-13)


NONUNIFORM_ARRAY = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.1, 4.4])[:, None] * [0, 1, 0])


@pytest.mark.parametrize(
    "array",
    [uniform_linear_array(9), uniform_linear_array(64), rectangular_array(5, 4), NONUNIFORM_ARRAY],
    ids=["9", "64", "plane", "nonuniform"],
)
def test_capon_grid_spectrum_equals_direct_evaluation_at_high_snr(array):
    # Two sources are 50 dB above the noise: the spectrum is a millionth of its terms.
    rng = np.random.default_rng(712)
    x = simulate_snapshots(
        array, random_phasors((2, 2, 1), rng), 1e-5, rng, np.array([[-0.3, 0.4]])
    )
    subarrays, capon = array_smoothing_windows(array, Smoothing()), Capon(loading=1.0)
    data = subarrays.window_data_matrices(x.astype(np.complex64).astype(complex))
    covariance = data @ np.swapaxes(data, 1, 2).conj() / data.shape[2]
    power = np.trace(covariance, axis1=1, axis2=2).real / subarrays.n_window_points
    loading = np.maximum(1e-5, 1e-5 * power)[:, None, None]
    inverse = np.linalg.inv(covariance + loading * np.eye(subarrays.n_window_points))
    grid = array.direction_grid
    steering = array.steering_vectors(grid.azimuth_rad, grid.elevation_rad[:, None])
    subarray_steering = steering.reshape(-1, array.n_elements)[
        :, subarrays.first_window_element_indices
    ]
    expected = (
        1 / np.einsum("mi,nij,mj->nm", subarray_steering.conj(), inverse, subarray_steering).real
    )
    spectrum = capon.spectrum(x, array, np.full(2, 1e-5)).reshape(2, -1)
    # Single-precision covariance of 64 elements at 50 dB is rounded by 1e-7.
    assert spectrum == pytest.approx(expected, rel=0.03)


def test_iterative_subspace_of_long_array_agrees_with_eigendecomposition():
    array, rng = uniform_linear_array(96), np.random.default_rng(709)
    azimuth = random_azimuth_pairs(array, HALF_POWER_WIDTH / 48, 20, rng)
    x = simulate_snapshots(array, random_phasors((20, 2, 1), rng), NOISE_POWER, rng, azimuth)
    long_window_azimuth, short_window_azimuth = (
        np.sort(Esprit(n_sources=2, smoothing=Smoothing(share=share)).find_directions(
            x, array, noise_powers(20)).azimuth_rad)
        for share in (2 / 3, 1 / 3)
    )  # fmt: skip
    # Subarrays of 32 elements use the full eigendecomposition; both results are close to the truth.
    assert np.abs(long_window_azimuth - azimuth).max() < 0.1 * HALF_POWER_WIDTH / 48 / np.cos(0.7)
    assert np.abs(short_window_azimuth - azimuth).max() < 0.25 * HALF_POWER_WIDTH / 48 / np.cos(0.7)


def test_nonfinite_snapshots_yield_nan_and_leave_others_unchanged():
    array, rng = uniform_linear_array(8), np.random.default_rng(710)
    azimuth = np.full((3, 1), 0.1)
    x = simulate_snapshots(array, random_phasors((3, 1, 1), rng), 1e-6, rng, azimuth)
    x[1, 0, 2] = np.nan
    for method in ALL_METHODS:
        estimates = method().find_directions(x, array, np.full(3, 1e-6))
        assert estimates.azimuth_rad[[0, 2]] == pytest.approx(0.1, abs=1e-3)
        assert (
            np.isnan(estimates.azimuth_rad[1]).all()
            and np.isnan(estimates.azimuth_std_rad[1]).all()
        )


@pytest.mark.parametrize("method", LINE_METHODS)
def test_line_methods_reject_nonuniform_array(method):
    nonuniform_array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2, 3.4])[:, None] * [0, 1, 0])
    with pytest.raises(InvalidSetting, match=r"uniform line.*use maximum-likelihood"):
        method().find_directions(np.ones((1, 1, 5), complex), nonuniform_array, np.ones(1))


def test_rejects_more_sources_than_subarrays_resolve():
    snapshot = np.ones((1, 1, 8), complex)
    with pytest.raises(InvalidSetting, match=r"n_sources: 5; expected at most 4"):
        Esprit(n_sources=5).find_directions(snapshot, uniform_linear_array(8), np.ones(1))
    with pytest.raises(InvalidSetting, match=r"at most 4"):
        Music(n_sources=5).find_directions(snapshot, uniform_linear_array(8), np.ones(1))
    nonuniform_array = Aperture(positions=np.array([0, 0.5, 1.3, 2.2])[:, None] * [0, 1, 0])
    with pytest.raises(InvalidSetting, match=r"at most 1.*use maximum-likelihood"):
        Music(n_sources=2).find_directions(snapshot[..., :4], nonuniform_array, np.ones(1))
    for share in (0, 1.5, np.nan):
        with pytest.raises(InvalidSetting, match="Smoothing.share"):
            Smoothing(share=share)
    with pytest.raises(InvalidSetting, match="Capon.loading"):
        Capon(loading=0)
