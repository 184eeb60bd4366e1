"""The non-uniform kernel against the direct one, and each of its parts against its formula."""

from itertools import pairwise

import numpy as np
import pytest
from beat import LIGHT, plain_sum
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import scatter
from scipy.integrate import quad
from scipy.linalg import hadamard

from dechirp.simulation.kernels import direct, nufft
from dechirp.simulation.kernels.band_interpolation import make_interpolator
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.chebyshev import economise_powers
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
from dechirp.simulation.kernels.taylor import expand_all_blocks as fill_blocks
from dechirp.simulation.kernels.tones import find_largest_errors

# Root mean square error over that of the echoes: what the kernel promises.
PROMISED = 1e-5

WAVEFORMS = {
    # 77 GHz, 150 MHz in 7.3 us.
    "short": (2200, 77e9, 20.4545e12, 0.0, 300e6, 7.3333e-6),
    # 400 MHz in 25.6 us, with some time before the first sample, of which there are 255.
    "middle": (255, 76e9, 15.6e12, 3e-6, 10e6, 36e-6),
    # 4 GHz in 50 us.
    "long": (256, 77e9, 80e12, 0.0, 5.12e6, 60e-6),
    "falling": (300, 24.25e9, -2e12, 5e-6, 5e6, 80e-6),
    # 150 MHz in 0.6 ms: within one chirp near scatterers go by.
    "slow": (240, 24e9, 0.25e12, 0.0, 0.4e6, 1e-3),
}
PLANS = {"chirps": (0, 0), "one run": (1, 4), "two runs": (2, 3), "best": None}


def send(name, n_chirps, *, weights=None, spacing_m=1.9e-3, n_rx=1):
    n_samples, f0, slope, adc_start_s, sample_rate_hz, interval_s = WAVEFORMS[name]
    weights = np.ones((n_chirps, 1), complex) if weights is None else weights
    n_tx = weights.shape[1]
    sent = Transmission(
        starts_s=(np.arange(n_chirps) - n_chirps / 2) * interval_s,
        weights=weights,
        tx_m=np.outer(np.arange(n_tx) * n_rx, [0.1, 1.0, 0.2]) * spacing_m,
        rx_m=np.outer(np.arange(n_rx), [0.1, 0.2, 1.0]) * spacing_m,
        start_frequency_hz=f0,
        slope_hz_per_s=slope,
        adc_start_s=adc_start_s,
        sample_rate_hz=sample_rate_hz,
    )
    return sent, n_samples


def summed(scatterers, sent, n_samples, *, dtype=np.complex64, **options):
    out = np.zeros((len(sent.starts_s), len(sent.rx_m), n_samples), dtype)
    nufft.add_echoes(out, scatterers, sent, **options)
    return out


def error(out, scatterers, sent, n_samples, *, n_chirps=5):
    """Of some chirps, against the direct kernel: root mean square over that of the echoes."""
    last = len(out) - 1
    some = np.unique([last * part // max(n_chirps - 1, 1) for part in range(n_chirps)])
    part = sent._replace(starts_s=sent.starts_s[some], weights=sent.weights[some])
    exact = np.zeros((len(some), *out.shape[1:]), complex)
    direct.add_echoes(exact, scatterers, part)
    assert np.linalg.norm(exact) > 0
    return np.linalg.norm(out[some] - exact) / np.linalg.norm(exact)


@pytest.fixture
def plan(monkeypatch):
    """By which a test says how echoes are summed."""

    def choose(name):
        if PLANS[name] is not None:
            made = nufft.NufftPlan(*PLANS[name])
            monkeypatch.setattr(nufft, "choose_plan", lambda *_: made)

    return choose


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


@pytest.mark.parametrize("how", PLANS)
@pytest.mark.parametrize("case", CASES)
def test_any_motion_equals_the_direct_sum(case, how, plan):
    plan(how)
    waveform, n_chirps, scene = CASES[case]
    rng = np.random.default_rng(sum(map(ord, case)))
    sent, n_samples = send(waveform, n_chirps)
    scatterers = scatter(sent, rng, **scene)
    out = summed(scatterers, sent, n_samples)
    assert error(out, scatterers, sent, n_samples) < PROMISED


@pytest.mark.parametrize("how", PLANS)
@pytest.mark.parametrize("case", ["highway", "full range", "accelerated"])
def test_the_finest_tolerance_is_kept(case, how, plan):
    plan(how)
    waveform, n_chirps, scene = CASES[case]
    rng = np.random.default_rng(1)
    sent, n_samples = send(waveform, n_chirps)
    scatterers = scatter(sent, rng, **scene)
    out = summed(scatterers, sent, n_samples, tolerance=2e-6)
    assert error(out, scatterers, sent, n_samples) < 2e-6


@pytest.mark.parametrize("few", [0, 10**6])
@pytest.mark.parametrize("case", ["highway", "full range", "accelerated"])
def test_scatterers_with_long_series_are_summed_right_few_or_many(case, few, plan, monkeypatch):
    plan("two runs")
    monkeypatch.setattr(nufft, "MAX_LOW_RANK_SCATTERERS", few)
    waveform, n_chirps, scene = CASES[case]
    sent, n_samples = send(waveform, n_chirps)
    scatterers = scatter(sent, np.random.default_rng(2), **scene)
    out = summed(scatterers, sent, n_samples, n_threads=2)
    assert error(out, scatterers, sent, n_samples) < PROMISED


def weights_of(multiplexing, n_chirps, n_tx):
    m = np.arange(n_chirps)
    if multiplexing == "tdm":
        return np.eye(n_tx, dtype=complex)[m % n_tx]
    if multiplexing == "hadamard":
        return hadamard(4)[m % 4, :n_tx].astype(complex)
    # An empty sub-band: phases of a fifth of a turn and its multiples.
    return np.exp(2j * np.pi * np.outer(m, np.arange(n_tx)) / (n_tx + 2))


@pytest.mark.parametrize("how", ["chirps", "two runs"])
@pytest.mark.parametrize("multiplexing", ["tdm", "hadamard", "ddma"])
def test_transmitters_add_up_with_their_weights(multiplexing, how, plan):
    plan(how)
    rng = np.random.default_rng(3)
    weights = weights_of(multiplexing, 60, 3)
    # Elements 2 cm apart: the scene is in their near field.
    sent, n_samples = send("middle", 60, weights=weights, n_rx=2, spacing_m=0.02)
    scatterers = scatter(sent, rng, n=100, ranges_m=(2, 50), speed_m_per_s=20)
    out = summed(scatterers, sent, n_samples)
    assert error(out, scatterers, sent, n_samples, n_chirps=7) < PROMISED


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
def test_random_scenes_are_within_the_tolerance(
    seed, waveform, n_chirps, n, nearest_m, depth, speed_m_per_s, n_terms, array, tolerance
):
    rng = np.random.default_rng(seed)
    weights = np.exp(2j * np.pi * rng.uniform(size=(n_chirps, array[0])))
    sent, n_samples = send(waveform, n_chirps, weights=weights, n_rx=array[1])
    scatterers = scatter(
        sent,
        rng,
        n=n,
        ranges_m=(nearest_m, nearest_m * depth),
        speed_m_per_s=speed_m_per_s,
        n_terms=n_terms,
    )
    out = summed(scatterers, sent, n_samples, dtype=complex, tolerance=tolerance)
    assert error(out, scatterers, sent, n_samples, n_chirps=3) < tolerance


def test_ten_thousand_scatterers_equal_a_plain_sum():
    rng = np.random.default_rng(8)
    sent, n_samples = send("middle", 64)
    scatterers = scatter(sent, rng, n=10_000, ranges_m=(3, 90), speed_m_per_s=40)
    out = summed(scatterers, sent, n_samples)
    some = sent._replace(starts_s=sent.starts_s[[0, 50]], weights=sent.weights[[0, 50]])
    exact, _ = plain_sum(scatterers, some, n_samples)
    assert np.linalg.norm(out[[0, 50]] - exact) < PROMISED * np.linalg.norm(exact)


@pytest.mark.parametrize("how", PLANS)
def test_nothing_depends_on_threads_or_groups_or_order(how, plan, monkeypatch):
    plan(how)
    rng = np.random.default_rng(4)
    sent, n_samples = send("middle", 40, n_rx=3)
    scatterers = scatter(sent, rng, n=700, ranges_m=(3, 60), speed_m_per_s=40)
    one = summed(scatterers, sent, n_samples)
    two = summed(scatterers, sent, n_samples, n_threads=2)
    order = rng.permutation(700)
    turned = Scatterers(
        scatterers.path_m[:, order],
        scatterers.amplitudes[order],
        scatterers.tx_gains[:, order],
        scatterers.rx_gains[:, order],
    )
    other = summed(turned, sent, n_samples)
    monkeypatch.setattr(nufft, "GROUP_SIZE", 150)
    parts = summed(scatterers, sent, n_samples)
    # As many single-precision sums in another order.
    assert np.linalg.norm(two - one) < 1e-6 * np.linalg.norm(one)
    assert np.linalg.norm(other - one) < 1e-6 * np.linalg.norm(one)
    # Groups share their errors out anew.
    assert np.linalg.norm(parts - one) < PROMISED * np.linalg.norm(one)


def test_a_part_of_a_larger_array_is_added_to():
    rng = np.random.default_rng(6)
    sent, n_samples = send("short", 32)
    scatterers = scatter(sent, rng, n=20, ranges_m=(3, 100), speed_m_per_s=40)
    whole = np.ones((64, 2, n_samples), complex)
    part = whole[1::2, 1:]
    nufft.add_echoes(part, scatterers, sent)
    part -= 1
    assert error(part, scatterers, sent, n_samples) < PROMISED
    assert (whole[::2] == 1).all()
    assert (whole[1::2, 0] == 1).all()


def test_nothing_is_added_for_no_scatterers_and_silent_transmitters():
    sent, n_samples = send("middle", 8)
    scatterers = scatter(sent, np.random.default_rng(0), n=3, ranges_m=(3, 9), speed_m_per_s=1)
    none = Scatterers(np.zeros((2, 0, 3)), np.zeros(0), np.zeros((1, 0)), np.zeros((1, 0)))
    assert not summed(none, sent, n_samples).any()
    silent = sent._replace(weights=np.zeros((8, 1), complex))
    assert not summed(scatterers, silent, n_samples).any()


def test_grids_that_would_be_too_large_are_not_made(monkeypatch):
    points = []
    spread = nufft.nufft_by_run.spreading_kernel

    def watched(grid, *given):
        points.append(len(grid) // 2)
        spread(grid, *given)

    monkeypatch.setattr(nufft.nufft_by_run, "spreading_kernel", watched)
    rng = np.random.default_rng(2)
    sent, n_samples = send("middle", 256)
    scatterers = scatter(sent, rng, n=30_000, ranges_m=(30, 80), speed_m_per_s=20)
    summed(scatterers, sent, n_samples)
    largest = max(points)

    monkeypatch.setattr(nufft, "MAX_GRID_POINTS", largest // 2)
    points.clear()
    out = summed(scatterers, sent, n_samples)
    # Eight columns more, for what wraps round.
    assert 0 < max(points) <= 1.03 * (largest // 2)
    assert error(out, scatterers, sent, n_samples) < PROMISED


def view(path_m, *, half_s, one_chirp=False, mid_s=2e-4):
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
def test_a_tone_times_its_series_is_the_echo(one_chirp):
    rng = np.random.default_rng(1)
    path_m = rng.uniform(-1, 1, (4, 70, 3)) * np.array([30, 30, 10, 500])[:, None, None]
    path_m[0, :, 0] += 40
    seen = view(path_m, half_s=1e-5 if one_chirp else 3e-4, one_chirp=one_chirp)
    blocks = np.empty((2, BLOCK))
    fill_blocks(seen, blocks)
    lanes = blocks.reshape(2, -1, LANES).transpose(1, 0, 2).reshape(-1, 2 * LANES)[:, :70]
    strength = lanes[REAL // LANES] + 1j * lanes[IMAG // LANES]
    terms = lanes[SERIES // LANES :].reshape(ORDER - 1, 2, 70)

    for s in (-1.0, -0.3, 0.8):
        t = s * seen.half_s
        at_m = sum(path_m[k] * (seen.mid_s + t) ** k for k in range(4))
        there, back = (np.linalg.norm(at_m - at, axis=1) for at in (seen.tx_m, seen.rx_m))
        tau = (there + back) / LIGHT
        cycles = seen.mid_frequency_hz * tau - seen.slope_hz_per_s / 2 * tau**2
        if one_chirp:
            cycles += seen.slope_hz_per_s * tau * t
        echo = np.exp(2j * np.pi * (cycles % 1)) / (there * back)
        series = 1 + sum((g + 1j * h) * s ** (k + 1) for k, (g, h) in enumerate(terms))
        tone = strength * np.exp(2j * np.pi * lanes[DOPPLER // LANES] * t) * series
        assert np.linalg.norm(tone - echo) < 1e-8 * np.linalg.norm(echo)
    assert not blocks[1, REAL + 6 : REAL + LANES].any()


def test_a_shortened_series_leaves_out_as_much_as_is_said():
    s = (np.arange(9999) + 0.5) / 9999 * 2 - 1
    for n_fields in (1, 3, 6):
        kept, left = economise_powers(n_fields, ORDER)
        for power in range(ORDER):
            off = np.polynomial.Polynomial(kept[:, power])(s) - s**power
            np.testing.assert_allclose(np.sqrt(np.mean(off**2)), left[power], atol=1e-7)


def test_the_hardest_are_few_and_the_rest_is_within_what_is_allowed():
    rng = np.random.default_rng(0)
    errors = rng.exponential(size=1000) ** 6
    allowed = 0.01 * errors.sum()
    hard = find_largest_errors(errors, allowed)
    assert errors[~hard].sum() <= allowed
    # Limits come in steps of 1.4: not many more go than the fewest that do.
    fewest = np.count_nonzero(np.cumsum(np.sort(errors)) > allowed)
    assert hard.sum() <= 1.15 * fewest
    assert not find_largest_errors(errors, errors.sum() * 1.01).any()


@pytest.mark.parametrize("spacing", [1.5, 2.0])
def test_the_transform_of_the_weights_is_their_integral(spacing):
    spread = make_spreading_kernel(spacing)
    polynomials = spread.polynomials.reshape(-1, WIDTH, 2)[:, :, 0].astype(float)

    # Signs alternate from point to point; y is where a value lies between two.
    def weight(z):
        place = (z + 1) / 2 * WIDTH
        a = min(int(place), WIDTH - 1)
        return (-1) ** a * np.polyval(polynomials[:, a], 2 * (place - a) - 1)

    def at(angle):
        # Over z, from point to point, where the polynomials change.
        edges = np.linspace(-1, 1, WIDTH + 1)
        parts = [
            quad(lambda z: weight(z) * np.cos(angle * z * WIDTH / 2), a, b)[0]
            for a, b in pairwise(edges)
        ]
        return sum(parts) * WIDTH / 2

    for angle in (0.0, 0.5, np.pi / spacing):
        np.testing.assert_allclose(at(angle), spread.transform(angle), rtol=1e-6)


@pytest.mark.parametrize("n_samples", [400, 401])
def test_samples_between_known_ones_are_those_of_the_tones(n_samples):
    low, high = -0.02, 0.07
    between = make_interpolator(low, high, n_samples=n_samples, tolerance=2.5e-6)
    assert between.step > 1
    frequencies = np.linspace(low, high, 7)
    first, stop = between.known_range(-(n_samples // 2), n_samples - n_samples // 2)
    known = np.arange(first, stop)[:, None] * between.step
    tones = np.exp(2j * np.pi * (frequencies - between.centre_frequency) * known).T.astype(
        np.complex64
    )
    out = np.zeros((9, n_samples), complex)
    between.interpolate(out, np.arange(1, 8), tones)

    samples = np.arange(n_samples)[:, None] - n_samples // 2
    exact = np.exp(2j * np.pi * frequencies * samples).T
    off = np.sqrt(np.mean(abs(out[1:8] - exact) ** 2))
    assert off < 2.5e-6
    assert not out[[0, 8]].any()
    assert make_interpolator(0, 0.4, n_samples=n_samples, tolerance=2.5e-6) is None


@pytest.mark.parametrize("tolerance", [1e-5, 2e-6])
@pytest.mark.parametrize("n_samples", [1, 2, 3, 5])
@pytest.mark.parametrize("at_rest", [False, True])
def test_few_samples_and_scenes_at_rest_are_within_the_tolerance(tolerance, n_samples, at_rest):
    rng = np.random.default_rng(3)
    sent, _ = send("middle", 8)
    scatterers = scatter(sent, rng, n=70, ranges_m=(3, 90), speed_m_per_s=0 if at_rest else 40)
    out = summed(scatterers, sent, n_samples, dtype=complex, tolerance=tolerance)
    assert error(out, scatterers, sent, n_samples) < tolerance


def test_one_very_hard_scatterer_does_not_hide_those_less_hard():
    # The largest is beyond the range of the steps in which a limit is sought, or endless.
    for largest in (1e9, np.inf, np.nan):
        errors = np.append(np.full(1000, 5e-11), largest)
        hard = find_largest_errors(errors, 8e-12)
        assert hard[-1]
        assert errors[~hard].sum() <= 8e-12


def test_a_scatterer_that_passes_between_two_looks_is_summed_right(plan):
    plan("chirps")
    sent, n_samples = send("middle", 64)
    scatterers = scatter(sent, np.random.default_rng(5), n=3, ranges_m=(3, 30), speed_m_per_s=9)
    # Nearest, 2 cm, at an eighth of the frame: between the first two looks of five.
    nearest_s = sent.starts_s[0] * 0.75
    speed = 0.2 / abs(sent.starts_s[0])
    scatterers.path_m[:, 0] = 0
    scatterers.path_m[0, 0] = [0.02, -speed * nearest_s, 0]
    scatterers.path_m[1, 0] = [0, speed, 0]
    out = summed(scatterers, sent, n_samples, dtype=complex)
    assert error(out, scatterers, sent, n_samples, n_chirps=64) < PROMISED


def test_delays_of_very_many_chirps_are_within_the_tolerance():
    sent, _ = send("middle", 64)
    sent = sent._replace(slope_hz_per_s=300e12, sample_rate_hz=50e6)
    rng = np.random.default_rng(6)
    scatterers = scatter(sent, rng, n=1500, ranges_m=(3e3, 20e3), speed_m_per_s=90)
    out = summed(scatterers, sent, 3, dtype=complex)
    assert error(out, scatterers, sent, 3) < PROMISED


def test_motion_that_bends_within_a_chirp_is_summed_right_where_the_band_is_narrow(plan):
    plan("chirps")
    sent, n_samples = send("slow", 1)
    rng = np.random.default_rng(7)
    # A body of 10 cm whose parts turn back within the chirp: known samples lie far apart.
    scatterers = scatter(sent, rng, n=20, ranges_m=(20, 20), speed_m_per_s=0.3, n_terms=3)
    scatterers.path_m[0] = np.array([20, 0, 0]) + rng.uniform(-0.05, 0.05, (20, 3))
    scatterers.path_m[2] = rng.uniform(-300, 300, (20, 3))
    out = summed(scatterers, sent, n_samples, dtype=complex)
    assert error(out, scatterers, sent, n_samples) < PROMISED


def test_what_comes_straight_to_one_antenna_and_crosses_another_is_summed_right(plan):
    plan("chirps")
    sent, n_samples = send("slow", 8, weights=np.ones((8, 2), complex))
    sent = sent._replace(
        tx_m=np.array([[0.0, 0, 0], [0, 2, 0]]), start_frequency_hz=77e9, slope_hz_per_s=2.5e9
    )
    rng = np.random.default_rng(8)
    scatterers = scatter(sent, rng, n=10, ranges_m=(5, 6), speed_m_per_s=0)
    # On the line through the first transmitter and the receiver, on which it all moves.
    scatterers.path_m[0] = np.outer(rng.uniform(5, 6, 10), [1, 0, 0])
    scatterers.path_m[1] = [200, 0, 0]
    out = summed(scatterers, sent, n_samples, dtype=complex)
    assert error(out, scatterers, sent, n_samples) < PROMISED


def test_a_scatterer_that_passes_one_end_of_a_wide_array_between_two_looks_is_summed_right(plan):
    plan("chirps")
    sent, n_samples = send("middle", 64)
    sent = sent._replace(tx_m=np.array([[0.0, -1, 0]]), rx_m=np.array([[0.0, 1, 0]]))
    scatterers = scatter(sent, np.random.default_rng(5), n=3, ranges_m=(3, 30), speed_m_per_s=9)
    # Nearest, 2 cm from the receiver, at an eighth of the frame.
    nearest_s = sent.starts_s[0] * 0.75
    speed = 0.2 / abs(sent.starts_s[0])
    scatterers.path_m[:, 0] = 0
    scatterers.path_m[0, 0] = [0.02, 1 - speed * nearest_s, 0]
    scatterers.path_m[1, 0] = [0, speed, 0]
    out = summed(scatterers, sent, n_samples, dtype=complex)
    assert error(out, scatterers, sent, n_samples, n_chirps=64) < PROMISED
