"""Simulation kernel by non-uniform FFT against the direct kernel, and its parts."""

from itertools import pairwise

import numpy as np
import pytest
from beat_signal import SPEED_OF_LIGHT, sum_echoes_plainly
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import make_scatterers
from scipy.integrate import quad
from scipy.linalg import hadamard

from dechirp.simulation.kernels import direct, nufft
from dechirp.simulation.kernels.band_interpolation import make_sparsest_interpolator
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.chebyshev import economised_monomials_and_rms_errors
from dechirp.simulation.kernels.gridding import make_spreading_kernel
from dechirp.simulation.kernels.simd import WIDTH
from dechirp.simulation.kernels.taylor import (
    BLOCK,
    DOPPLER,
    IMAG,
    LANES,
    ORDER,
    REAL,
    SERIES,
    AntennaPairView,
)
from dechirp.simulation.kernels.taylor import fill_tone_blocks as fill_blocks
from dechirp.simulation.kernels.tones import mask_scatterers_with_largest_errors
from nightly import nightly, nightly_except

# Specified RMS error of the kernel relative to the echoes.
MAX_RELATIVE_ERROR = 1e-5

WAVEFORMS = {
    # 77 GHz, 150 MHz in 7.3 us.
    "short": (2200, 77e9, 20.4545e12, 0.0, 300e6, 7.3333e-6),
    # 400 MHz in 25.6 us, 255 samples, with some time before the first one.
    "middle": (255, 76e9, 15.6e12, 3e-6, 10e6, 36e-6),
    # 4 GHz in 50 us.
    "long": (256, 77e9, 80e12, 0.0, 5.12e6, 60e-6),
    "falling": (300, 24.25e9, -2e12, 5e-6, 5e6, 80e-6),
    # 150 MHz in 0.6 ms: near scatterers pass by within one chirp.
    "slow": (240, 24e9, 0.25e12, 0.0, 0.4e6, 1e-3),
}
PLANS = {"chirps": (0, 0), "one run": (1, 4), "two runs": (2, 3), "best": None}


def make_transmission(name, n_chirps, *, weights=None, spacing_m=1.9e-3, n_rx=1):
    n_samples, f0, slope, adc_start_s, sample_rate_hz, interval_s = WAVEFORMS[name]
    weights = np.ones((n_chirps, 1), complex) if weights is None else weights
    n_tx = weights.shape[1]
    transmission = Transmission(
        starts_s=(np.arange(n_chirps) - n_chirps / 2) * interval_s,
        weights=weights,
        tx_m=np.outer(np.arange(n_tx) * n_rx, [0.1, 1.0, 0.2]) * spacing_m,
        rx_m=np.outer(np.arange(n_rx), [0.1, 0.2, 1.0]) * spacing_m,
        start_frequency_hz=f0,
        slope_hz_per_s=slope,
        adc_start_s=adc_start_s,
        sample_rate_hz=sample_rate_hz,
    )
    return transmission, n_samples


def simulate_echoes(scatterers, transmission, n_samples, *, dtype=np.complex64, **options):
    echoes = np.zeros((len(transmission.starts_s), len(transmission.rx_m), n_samples), dtype)
    nufft.add_echoes(echoes, scatterers, transmission, **options)
    return echoes


def compute_error(out, scatterers, transmission, n_samples, *, n_chirps=5):
    """Compute the RMS error of some chirps against the direct kernel, relative to the echoes."""
    last_chirp = len(out) - 1
    chirps = np.unique(
        [
            last_chirp * chirp_transmission // max(n_chirps - 1, 1)
            for chirp_transmission in range(n_chirps)
        ]
    )
    chirp_transmission = transmission._replace(
        starts_s=transmission.starts_s[chirps], weights=transmission.weights[chirps]
    )
    exact = np.zeros((len(chirps), *out.shape[1:]), complex)
    direct.add_echoes(exact, scatterers, chirp_transmission)
    assert np.linalg.norm(exact) > 0
    return np.linalg.norm(out[chirps] - exact) / np.linalg.norm(exact)


@pytest.fixture
def choose_plan(monkeypatch):
    """Return a function that fixes the summation plan by name."""

    def choose_named_plan(name):
        if PLANS[name] is not None:
            plan = nufft.NufftPlan(*PLANS[name])
            monkeypatch.setattr(nufft, "choose_run_and_field_counts", lambda *_: plan)

    return choose_named_plan


CASES = {
    "highway": ("short", 128, {"n": 300, "ranges_m": (3, 200), "speed_m_per_s": 40}),
    "full range": ("short", 64, {"n": 200, "ranges_m": (3, 2190), "speed_m_per_s": 80}),
    "beyond it": ("middle", 64, {"n": 50, "ranges_m": (90, 300), "speed_m_per_s": 30}),
    "fast and long": ("long", 512, {"n": 40, "ranges_m": (1, 9), "speed_m_per_s": 40}),
    "near": ("middle", 64, {"n": 30, "ranges_m": (0.5, 2), "speed_m_per_s": 5}),
    "accelerated": (
        "middle",
        64,
        {"n": 70, "ranges_m": (3, 60), "speed_m_per_s": 40, "n_terms": 3},
    ),
    "of six terms": (
        "middle",
        64,
        {"n": 70, "ranges_m": (9, 60), "speed_m_per_s": 9, "n_terms": 6},
    ),
    "falling": ("falling", 64, {"n": 70, "ranges_m": (5, 100), "speed_m_per_s": 60}),
    "passing by": ("slow", 48, {"n": 60, "ranges_m": (0.3, 9), "speed_m_per_s": 60}),
    "at rest": ("middle", 64, {"n": 65, "ranges_m": (5, 100), "speed_m_per_s": 0}),
    "one": ("middle", 64, {"n": 1, "ranges_m": (20, 20), "speed_m_per_s": 30}),
}


@pytest.mark.parametrize("plan_name", nightly_except(("best", "two runs"), PLANS))
@pytest.mark.parametrize("case", CASES)
def test_any_motion_matches_direct_sum(case, plan_name, choose_plan):
    choose_plan(plan_name)
    waveform, n_chirps, scene = CASES[case]
    rng = np.random.default_rng(sum(map(ord, case)))
    transmission, n_samples = make_transmission(waveform, n_chirps)
    scatterers = make_scatterers(transmission, rng, **scene)
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    assert compute_error(echoes, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR


@pytest.mark.parametrize("plan_name", PLANS)
@pytest.mark.parametrize("case", ["highway", "full range", "accelerated"])
def test_finest_tolerance_is_met(case, plan_name, choose_plan):
    choose_plan(plan_name)
    waveform, n_chirps, scene = CASES[case]
    rng = np.random.default_rng(1)
    transmission, n_samples = make_transmission(waveform, n_chirps)
    scatterers = make_scatterers(transmission, rng, **scene)
    echoes = simulate_echoes(scatterers, transmission, n_samples, tolerance=2e-6)
    assert compute_error(echoes, scatterers, transmission, n_samples) < 2e-6


@pytest.mark.parametrize("max_low_rank_scatterers", [0, 10**6])
@pytest.mark.parametrize("case", ["highway", "full range", "accelerated"])
def test_scatterers_with_long_series_meet_tolerance_few_or_many(
    case, max_low_rank_scatterers, choose_plan, monkeypatch
):
    choose_plan("two runs")
    monkeypatch.setattr(nufft, "MAX_LOW_RANK_SCATTERERS", max_low_rank_scatterers)
    waveform, n_chirps, scene = CASES[case]
    transmission, n_samples = make_transmission(waveform, n_chirps)
    scatterers = make_scatterers(transmission, np.random.default_rng(2), **scene)
    echoes = simulate_echoes(scatterers, transmission, n_samples, n_threads=2)
    assert compute_error(echoes, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR


def make_weights(multiplexing, n_chirps, n_tx):
    m = np.arange(n_chirps)
    if multiplexing == "tdm":
        return np.eye(n_tx, dtype=complex)[m % n_tx]
    if multiplexing == "hadamard":
        return hadamard(4)[m % 4, :n_tx].astype(complex)
    # Phases are multiples of a fifth of a cycle, so that sub-bands stay empty.
    return np.exp(2j * np.pi * np.outer(m, np.arange(n_tx)) / (n_tx + 2))


@pytest.mark.parametrize("plan_name", ["chirps", "two runs"])
@pytest.mark.parametrize("multiplexing", ["tdm", "hadamard", "ddma"])
def test_transmitters_are_summed_with_their_weights(multiplexing, plan_name, choose_plan):
    choose_plan(plan_name)
    rng = np.random.default_rng(3)
    weights = make_weights(multiplexing, 60, 3)
    # Elements 2 cm apart: the scene is in their near field.
    transmission, n_samples = make_transmission(
        "middle", 60, weights=weights, n_rx=2, spacing_m=0.02
    )
    scatterers = make_scatterers(transmission, rng, n=100, ranges_m=(2, 50), speed_m_per_s=20)
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    assert (
        compute_error(echoes, scatterers, transmission, n_samples, n_chirps=7) < MAX_RELATIVE_ERROR
    )


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    waveform=st.sampled_from(sorted(WAVEFORMS)),
    n_chirps=st.sampled_from([1, 2, 7, 48]),
    n=st.sampled_from([1, 5, 64, 500, 3000]),
    nearest_m=st.floats(0.7, 30),
    depth=st.floats(1, 40),
    speed_m_per_s=st.floats(0, 90),
    n_terms=st.integers(2, 4),
    array=st.sampled_from([(1, 1), (2, 2)]),
    tolerance=st.sampled_from([1e-5, 2e-6]),
)
def test_random_scenes_meet_tolerance(
    seed, waveform, n_chirps, n, nearest_m, depth, speed_m_per_s, n_terms, array, tolerance
):
    rng = np.random.default_rng(seed)
    weights = np.exp(2j * np.pi * rng.uniform(size=(n_chirps, array[0])))
    transmission, n_samples = make_transmission(waveform, n_chirps, weights=weights, n_rx=array[1])
    scatterers = make_scatterers(
        transmission,
        rng,
        n=n,
        ranges_m=(nearest_m, nearest_m * depth),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
    )
    echoes = simulate_echoes(
        scatterers, transmission, n_samples, dtype=complex, tolerance=tolerance
    )
    assert compute_error(echoes, scatterers, transmission, n_samples, n_chirps=3) < tolerance


@nightly
def test_many_scatterers_match_plain_sum():
    rng = np.random.default_rng(8)
    transmission, n_samples = make_transmission("middle", 64)
    scatterers = make_scatterers(transmission, rng, n=10_000, ranges_m=(3, 90), speed_m_per_s=40)
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    chirp_transmission = transmission._replace(
        starts_s=transmission.starts_s[[0, 50]], weights=transmission.weights[[0, 50]]
    )
    exact, _ = sum_echoes_plainly(scatterers, chirp_transmission, n_samples)
    assert np.linalg.norm(echoes[[0, 50]] - exact) < MAX_RELATIVE_ERROR * np.linalg.norm(exact)


@pytest.mark.parametrize("plan_name", nightly_except(("best",), PLANS))
def test_echoes_do_not_depend_on_threads_groups_or_order(plan_name, choose_plan, monkeypatch):
    choose_plan(plan_name)
    rng = np.random.default_rng(4)
    transmission, n_samples = make_transmission("middle", 40, n_rx=3)
    scatterers = make_scatterers(transmission, rng, n=700, ranges_m=(3, 60), speed_m_per_s=40)
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    threaded_echoes = simulate_echoes(scatterers, transmission, n_samples, n_threads=2)
    order = rng.permutation(700)
    permuted_scatterers = Scatterers(
        scatterers.path_m[:, order],
        scatterers.amplitudes[order],
        scatterers.tx_gains[:, order],
        scatterers.rx_gains[:, order],
    )
    permuted_echoes = simulate_echoes(permuted_scatterers, transmission, n_samples)
    monkeypatch.setattr(nufft, "GROUP_SIZE", 150)
    grouped_echoes = simulate_echoes(scatterers, transmission, n_samples)
    # Single-precision sums have another order.
    assert np.linalg.norm(threaded_echoes - echoes) < 1e-6 * np.linalg.norm(echoes)
    assert np.linalg.norm(permuted_echoes - echoes) < 1e-6 * np.linalg.norm(echoes)
    # Groups distribute their errors differently.
    assert np.linalg.norm(grouped_echoes - echoes) < MAX_RELATIVE_ERROR * np.linalg.norm(echoes)


def test_echoes_can_be_added_to_view_of_larger_array():
    rng = np.random.default_rng(6)
    transmission, n_samples = make_transmission("short", 32)
    scatterers = make_scatterers(transmission, rng, n=20, ranges_m=(3, 100), speed_m_per_s=40)
    samples = np.ones((64, 2, n_samples), complex)
    samples_view = samples[1::2, 1:]
    nufft.add_echoes(samples_view, scatterers, transmission)
    samples_view -= 1
    assert compute_error(samples_view, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR
    assert (samples[::2] == 1).all()
    assert (samples[1::2, 0] == 1).all()


def test_no_scatterers_and_silent_transmitters_add_nothing():
    transmission, n_samples = make_transmission("middle", 8)
    scatterers = make_scatterers(
        transmission, np.random.default_rng(0), n=3, ranges_m=(3, 9), speed_m_per_s=1
    )
    no_scatterers = Scatterers(np.zeros((2, 0, 3)), np.zeros(0), np.zeros((1, 0)), np.zeros((1, 0)))
    assert not simulate_echoes(no_scatterers, transmission, n_samples).any()
    silent_transmission = transmission._replace(weights=np.zeros((8, 1), complex))
    assert not simulate_echoes(scatterers, silent_transmission, n_samples).any()


def test_grid_size_is_limited(monkeypatch):
    grid_sizes = []
    spread = nufft.nufft_by_run.spread_tones_onto_grid

    def count_and_spread(grid, *arguments):
        grid_sizes.append(len(grid) // 2)
        spread(grid, *arguments)

    monkeypatch.setattr(nufft.nufft_by_run, "spread_tones_onto_grid", count_and_spread)
    rng = np.random.default_rng(2)
    transmission, n_samples = make_transmission("middle", 256)
    scatterers = make_scatterers(transmission, rng, n=30_000, ranges_m=(30, 80), speed_m_per_s=20)
    simulate_echoes(scatterers, transmission, n_samples)
    largest = max(grid_sizes)

    monkeypatch.setattr(nufft, "MAX_GRID_POINTS", largest // 2)
    grid_sizes.clear()
    echoes = simulate_echoes(scatterers, transmission, n_samples)
    # Eight more columns hold the cyclic extension.
    assert 0 < max(grid_sizes) <= 1.03 * (largest // 2)
    assert compute_error(echoes, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR


def make_view(path_m, *, half_s, one_chirp=False, mid_s=2e-4):
    return AntennaPairView(
        np.ascontiguousarray(path_m.transpose(0, 2, 1)),
        np.ones(path_m.shape[1]),
        np.array([0.0, 0.01, 0.0]),
        np.array([0.0, -0.02, 0.01]),
        mid_s,
        half_s,
        77.1e9,
        20e12,
        one_chirp,
    )


@pytest.mark.parametrize("one_chirp", [False, True])
def test_tone_times_its_series_equals_echo(one_chirp):
    rng = np.random.default_rng(1)
    path_m = rng.uniform(-1, 1, (4, 70, 3)) * np.array([30, 30, 10, 500])[:, None, None]
    path_m[0, :, 0] += 40
    view = make_view(path_m, half_s=1e-5 if one_chirp else 3e-4, one_chirp=one_chirp)
    blocks = np.empty((2, BLOCK))
    fill_blocks(view, blocks)
    lanes = blocks.reshape(2, -1, LANES).transpose(1, 0, 2).reshape(-1, 2 * LANES)[:, :70]
    strength = lanes[REAL // LANES] + 1j * lanes[IMAG // LANES]
    terms = lanes[SERIES // LANES :].reshape(ORDER - 1, 2, 70)

    for s in (-1.0, -0.3, 0.8):
        t = s * view.half_s
        position_m = sum(path_m[k] * (view.mid_s + t) ** k for k in range(4))
        tx_distance_m, rx_distance_m = (
            np.linalg.norm(position_m - antenna_m, axis=1) for antenna_m in (view.tx_m, view.rx_m)
        )
        tau = (tx_distance_m + rx_distance_m) / SPEED_OF_LIGHT
        cycles = view.mid_frequency_hz * tau - view.slope_hz_per_s / 2 * tau**2
        if one_chirp:
            cycles += view.slope_hz_per_s * tau * t
        echo = np.exp(2j * np.pi * (cycles % 1)) / (tx_distance_m * rx_distance_m)
        series = 1 + sum((g + 1j * h) * s ** (k + 1) for k, (g, h) in enumerate(terms))
        tone = strength * np.exp(2j * np.pi * lanes[DOPPLER // LANES] * t) * series
        assert np.linalg.norm(tone - echo) < 1e-8 * np.linalg.norm(echo)
    assert not blocks[1, REAL + 6 : REAL + LANES].any()


def test_economised_series_has_stated_errors():
    s = (np.arange(9999) + 0.5) / 9999 * 2 - 1
    for n_fields in (1, 3, 6):
        coefficients, stated_errors = economised_monomials_and_rms_errors(n_fields, ORDER)
        for power in range(ORDER):
            error = np.polynomial.Polynomial(coefficients[:, power])(s) - s**power
            np.testing.assert_allclose(np.sqrt(np.mean(error**2)), stated_errors[power], atol=1e-7)


def test_largest_errors_are_few_and_remainder_is_within_allowance():
    rng = np.random.default_rng(0)
    errors = rng.exponential(size=1000) ** 6
    allowed = 0.01 * errors.sum()
    is_large = mask_scatterers_with_largest_errors(errors, allowed)
    assert errors[~is_large].sum() <= allowed
    # Limits have steps of 1.4, so the selection is slightly larger than the minimum.
    fewest = np.count_nonzero(np.cumsum(np.sort(errors)) > allowed)
    assert is_large.sum() <= 1.15 * fewest
    assert not mask_scatterers_with_largest_errors(errors, errors.sum() * 1.01).any()


@pytest.mark.parametrize("spacing", [1.5, 2.0])
def test_transform_of_spreading_weights_equals_their_integral(spacing):
    kernel = make_spreading_kernel(spacing)
    polynomials = kernel.polynomials.reshape(-1, WIDTH, 2)[:, :, 0].astype(float)

    # Signs alternate from point to point.
    def weight(z):
        position = (z + 1) / 2 * WIDTH
        a = min(int(position), WIDTH - 1)
        return (-1) ** a * np.polyval(polynomials[:, a], 2 * (position - a) - 1)

    def integrate(angle):
        # Integration over z from point to point, where the polynomials change.
        edges = np.linspace(-1, 1, WIDTH + 1)
        parts = [
            quad(lambda z: weight(z) * np.cos(angle * z * WIDTH / 2), a, b)[0]
            for a, b in pairwise(edges)
        ]
        return sum(parts) * WIDTH / 2

    for angle in (0.0, 0.5, np.pi / spacing):
        np.testing.assert_allclose(integrate(angle), kernel.fourier_transform(angle), rtol=1e-6)


@pytest.mark.parametrize("n_samples", [400, 401])
def test_interpolated_samples_match_tones(n_samples):
    low, high = -0.02, 0.07
    interpolator = make_sparsest_interpolator(low, high, n_samples=n_samples, tolerance=2.5e-6)
    assert interpolator.step > 1
    frequencies = np.linspace(low, high, 7)
    first, stop = interpolator.required_known_sample_range(
        -(n_samples // 2), n_samples - n_samples // 2
    )
    known_samples = np.arange(first, stop)[:, None] * interpolator.step
    tones = np.exp(
        2j * np.pi * (frequencies - interpolator.centre_frequency) * known_samples
    ).T.astype(np.complex64)
    echoes = np.zeros((9, n_samples), complex)
    interpolator.add_interpolated(echoes, np.arange(1, 8), tones)

    samples = np.arange(n_samples)[:, None] - n_samples // 2
    exact = np.exp(2j * np.pi * frequencies * samples).T
    error = np.sqrt(np.mean(abs(echoes[1:8] - exact) ** 2))
    assert error < 2.5e-6
    assert not echoes[[0, 8]].any()
    assert make_sparsest_interpolator(0, 0.4, n_samples=n_samples, tolerance=2.5e-6) is None


@pytest.mark.parametrize("tolerance", [1e-5, 2e-6])
@pytest.mark.parametrize("n_samples", [1, 2, 3, 5])
@pytest.mark.parametrize("is_static", [False, True])
def test_few_samples_and_static_scenes_meet_tolerance(tolerance, n_samples, is_static):
    rng = np.random.default_rng(3)
    transmission, _ = make_transmission("middle", 8)
    scatterers = make_scatterers(
        transmission, rng, n=70, ranges_m=(3, 90), speed_m_per_s=0 if is_static else 40
    )
    echoes = simulate_echoes(
        scatterers, transmission, n_samples, dtype=complex, tolerance=tolerance
    )
    assert compute_error(echoes, scatterers, transmission, n_samples) < tolerance


def test_one_huge_error_does_not_hide_smaller_ones():
    # The largest error is beyond the range of the limit search, or not finite.
    for largest in (1e9, np.inf, np.nan):
        errors = np.append(np.full(1000, 5e-11), largest)
        is_large = mask_scatterers_with_largest_errors(errors, 8e-12)
        assert is_large[-1]
        assert errors[~is_large].sum() <= 8e-12


def test_scatterer_passing_between_two_support_points_meets_tolerance(choose_plan):
    choose_plan("chirps")
    transmission, n_samples = make_transmission("middle", 64)
    scatterers = make_scatterers(
        transmission, np.random.default_rng(5), n=3, ranges_m=(3, 30), speed_m_per_s=9
    )
    # Closest approach, 2 cm, at an eighth of the frame: between the first two support points of
    # five.
    nearest_s = transmission.starts_s[0] * 0.75
    speed = 0.2 / abs(transmission.starts_s[0])
    scatterers.path_m[:, 0] = 0
    scatterers.path_m[0, 0] = [0.02, -speed * nearest_s, 0]
    scatterers.path_m[1, 0] = [0, speed, 0]
    echoes = simulate_echoes(scatterers, transmission, n_samples, dtype=complex)
    assert (
        compute_error(echoes, scatterers, transmission, n_samples, n_chirps=64) < MAX_RELATIVE_ERROR
    )


def test_delays_of_very_many_chirps_meet_tolerance():
    transmission, _ = make_transmission("middle", 64)
    transmission = transmission._replace(slope_hz_per_s=300e12, sample_rate_hz=50e6)
    rng = np.random.default_rng(6)
    scatterers = make_scatterers(transmission, rng, n=1500, ranges_m=(3e3, 20e3), speed_m_per_s=90)
    echoes = simulate_echoes(scatterers, transmission, 3, dtype=complex)
    assert compute_error(echoes, scatterers, transmission, 3) < MAX_RELATIVE_ERROR


def test_curved_motion_within_chirp_meets_tolerance_in_narrow_band(choose_plan):
    choose_plan("chirps")
    transmission, n_samples = make_transmission("slow", 1)
    rng = np.random.default_rng(7)
    # Parts of a 10 cm body reverse within the chirp; support samples are far apart.
    scatterers = make_scatterers(
        transmission, rng, n=20, ranges_m=(20, 20), speed_m_per_s=0.3, n_terms=3
    )
    scatterers.path_m[0] = np.array([20, 0, 0]) + rng.uniform(-0.05, 0.05, (20, 3))
    scatterers.path_m[2] = rng.uniform(-300, 300, (20, 3))
    echoes = simulate_echoes(scatterers, transmission, n_samples, dtype=complex)
    assert compute_error(echoes, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR


def test_radial_motion_to_one_antenna_and_crossing_to_another_meets_tolerance(choose_plan):
    choose_plan("chirps")
    transmission, n_samples = make_transmission("slow", 8, weights=np.ones((8, 2), complex))
    transmission = transmission._replace(
        tx_m=np.array([[0.0, 0, 0], [0, 2, 0]]), start_frequency_hz=77e9, slope_hz_per_s=2.5e9
    )
    rng = np.random.default_rng(8)
    scatterers = make_scatterers(transmission, rng, n=10, ranges_m=(5, 6), speed_m_per_s=0)
    # All scatterers move on the line through the first transmitter and the receiver.
    scatterers.path_m[0] = np.outer(rng.uniform(5, 6, 10), [1, 0, 0])
    scatterers.path_m[1] = [200, 0, 0]
    echoes = simulate_echoes(scatterers, transmission, n_samples, dtype=complex)
    assert compute_error(echoes, scatterers, transmission, n_samples) < MAX_RELATIVE_ERROR


def test_scatterer_passing_one_end_of_wide_array_meets_tolerance(choose_plan):
    choose_plan("chirps")
    transmission, n_samples = make_transmission("middle", 64)
    transmission = transmission._replace(
        tx_m=np.array([[0.0, -1, 0]]), rx_m=np.array([[0.0, 1, 0]])
    )
    scatterers = make_scatterers(
        transmission, np.random.default_rng(5), n=3, ranges_m=(3, 30), speed_m_per_s=9
    )
    # Closest approach, 2 cm from the receiver, at an eighth of the frame.
    nearest_s = transmission.starts_s[0] * 0.75
    speed = 0.2 / abs(transmission.starts_s[0])
    scatterers.path_m[:, 0] = 0
    scatterers.path_m[0, 0] = [0.02, 1 - speed * nearest_s, 0]
    scatterers.path_m[1, 0] = [0, speed, 0]
    echoes = simulate_echoes(scatterers, transmission, n_samples, dtype=complex)
    assert (
        compute_error(echoes, scatterers, transmission, n_samples, n_chirps=64) < MAX_RELATIVE_ERROR
    )
