"""Fixed-point chain: quantisation noise, overflows, logarithms, detections and settings."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.units import to_decibels
from dechirp.processing.fixed_point.cfar import cell_averaging_thresholds
from dechirp.processing.fixed_point.chain import fixed_point_map, log2_of_powers, max_log2_error
from dechirp.processing.fixed_point.coefficients import integer_log2_table
from dechirp.processing.fixed_point.comparison import (
    compare_detections,
    compare_detections_over_bits,
)
from dechirp.processing.fixed_point.fft import fft
from dechirp.processing.fixed_point.lookup_tables import pad_to_powers_of_two
from dechirp.processing.fixed_point.quantisation_noise import (
    make_full_scale_signal,
    predict_quantisation_noise,
    signal_to_quantisation_noise,
    signal_to_quantisation_noise_over_bits,
)
from dechirp.processing.fixed_point.word_lengths import WordLengths
from dechirp.processing.peaks import find_peaks
from dechirp.simulation.adc_codes import extract_adc_codes
from nightly import nightly, nightly_except
from noise_cubes import simulate_noise_cube

NO_SCALING = WordLengths(scaling="none")
HALVING = WordLengths(scaling="halving")


def make_tones(cycles: np.ndarray, n: int, bits: int, rng: np.random.Generator) -> np.ndarray:
    """Return full-scale tones of random phase, (n_tones, n, 2), by cycles per transform."""
    phase = 2 * np.pi * (cycles[:, None] * np.arange(n) / n + rng.uniform(size=(len(cycles), 1)))
    parts = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.rint((2 ** (bits - 1) - 1) * parts).astype(int)


def draw_extreme_words(n_blocks: int, n: int, bits: int, rng: np.random.Generator) -> np.ndarray:
    """Draw words that are either the largest or the smallest."""
    half = 2 ** (bits - 1)
    return rng.choice([-half, half - 1], size=(n_blocks, n, 2))


# --- Quantisation noise ------------------------------------------------------------------------


@pytest.mark.parametrize("signal", ["on bins", "between bins", "real", "noise"])
def test_16_bit_fft_of_256_points_keeps_60_db_at_full_scale(signal):
    rng = np.random.default_rng(1)
    if signal == "noise":
        points = make_full_scale_signal("noise", 500, 256, 16, rng)
    else:
        cycles = np.arange(256.0) if signal == "on bins" else rng.uniform(0, 256, 2000)
        points = make_tones(cycles, 256, 16, rng)
        points[..., 1] *= signal != "real"

    result = fft(points, 16, WordLengths())

    assert signal_to_quantisation_noise(points, result).min() > 1e6
    assert not result.overflows.any()


# Errors of different numbers are independent: the mean square of 400 x n has a standard error of 1
# / sqrt(400 n), 0.6 % at 64 points.
@pytest.mark.parametrize("scaling", ["block", "halving"])
@pytest.mark.parametrize("bits", nightly_except(1, [12, 16, 22]))
@pytest.mark.parametrize("n", nightly_except([64, 512], [64, 128, 256, 512, 1024]))
def test_quantisation_noise_of_white_noise_matches_theory(n, bits, scaling):
    words = WordLengths(scaling=scaling, twiddle_bits=bits)
    measured = signal_to_quantisation_noise_over_bits(
        (bits,), n_points=n, words=words, n_trials=400, seed=n + bits
    )

    ratios = measured.sel(bits=bits, signal="noise")
    assert float(ratios.measured / ratios.predicted) == pytest.approx(1, abs=0.025)


# The noise of a tone has a standard deviation of a sixth: 0.4 % for the mean of 1,500.
@pytest.mark.parametrize("bits", nightly_except(1, [12, 16, 22]))
def test_mean_quantisation_noise_of_tones_matches_theory(bits):
    ratios = signal_to_quantisation_noise_over_bits((bits,), n_trials=1500, seed=bits).sel(
        signal="tone"
    )

    assert ratios.measured.item() / ratios.predicted.item() == pytest.approx(1, abs=0.03)


# Exponents of tones are 8 or 9: noise refers to the scale of the samples, as in NumPy, not to last
# bits, where tones with larger exponents count a quarter. The difference is 1.5 dB.
def test_mean_quantisation_noise_of_tones_uses_scale_of_samples():
    n = 1500
    points = make_full_scale_signal("tone", n, 256, 16, np.random.default_rng(7))
    result = fft(points, 16, WordLengths())
    exact = np.fft.fft(points @ [1, 1j])
    words = np.ldexp(result.points, result.shifts.sum(axis=-1)[:, None, None]) @ [1, 1j]
    ratio = np.sum(abs(exact) ** 2) / np.sum(abs(words - exact) ** 2)

    ratios = signal_to_quantisation_noise_over_bits((16,), n_trials=n, seed=8).sel(
        bits=16, signal="tone"
    )

    assert ratios.measured.item() == pytest.approx(ratio, rel=0.11)  # 6 times 1.3 %, for both


def test_quantisation_noise_of_halving_follows_parities():
    # First stages of the four pairs round halves: 1/4 for an odd sum. In the second ones, as many
    # of 256, 64, 16 and 4 points are quarter turns as here; the others have products (1/12).
    total, odd = 0.0, 1 / 2
    for share in (1, 68 / 256, 1, 20 / 64, 1, 8 / 16, 1, 1):
        odd_sums = 2 * odd * (1 - odd)
        total = total / 2 + 2 * (share * odd_sums / 4 + (1 - share) / 12)
        odd = share * (1 - odd_sums) / 2 + (1 - share) / 2

    exact = WordLengths(scaling="halving", twiddle_bits=24)
    law = predict_quantisation_noise(np.ones(8), np.array(0.0), exact)

    assert law == pytest.approx(total, rel=1e-12)
    points = make_full_scale_signal("noise", 400, 256, 16, np.random.default_rng(2))
    result = fft(points, 16, exact)
    error = result.points @ [1, 1j] - np.fft.fft(points @ [1, 1j]) / 256
    assert np.mean(abs(error) ** 2) == pytest.approx(total, rel=0.01)


# 100 trials of noise have a standard error of 0.6 % or 0.03 dB at each end.
def test_each_bit_adds_6_02_db():
    ratios = signal_to_quantisation_noise_over_bits((12, 22), seed=3).sel(signal="noise").measured

    assert to_decibels(ratios[1] / ratios[0]) / 10 == pytest.approx(6.02, abs=0.02)


def test_block_scaling_keeps_weak_signals_better_than_halving():
    weak_tones = make_full_scale_signal("tone", 200, 256, 16, np.random.default_rng(4)) // 100

    block_snr, halving_snr = (
        signal_to_quantisation_noise(weak_tones, fft(weak_tones, 16, words))
        for words in (WordLengths(), HALVING)
    )

    # Halving loses the 40 dB; block scaling shifts 6 or 7 bits less, as far as the noise allows.
    assert to_decibels(np.median(block_snr / halving_snr)) > 30
    assert to_decibels(block_snr.min()) > 60


def test_truncation_is_biased_by_half_a_bit_and_convergent_rounding_is_not():
    points = make_full_scale_signal("noise", 400, 256, 16, np.random.default_rng(5))
    exact = np.fft.fft(points @ [1, 1j])

    def mean_error(rounding):
        result = fft(points, 16, WordLengths(rounding=rounding, scaling="halving"))
        return np.mean(result.points @ [1, 1j] - exact / 256)

    # The last stage adds -1/2, except in the bin of quarter turns, to the bias of earlier stages.
    # 102,400 numbers of 0.7 words: 0.002 standard error.
    assert abs(mean_error("convergent")) < 0.015
    assert mean_error("truncate").real < -0.4
    assert mean_error("truncate").imag < -0.4


# --- Overflows ---------------------------------------------------------------------------------


@given(
    bits=st.integers(4, 24),
    twiddle_bits=st.integers(4, 24),
    stages=st.integers(0, 7),
    seed=st.integers(0, 2**31),
)
def test_block_scaling_never_overflows(bits, twiddle_bits, stages, seed):
    points = draw_extreme_words(8, 2**stages, bits, np.random.default_rng(seed))

    result = fft(points, bits, WordLengths(twiddle_bits=twiddle_bits))

    assert not result.overflows.any()
    assert result.shifts.max(initial=0) <= 2


def test_full_scale_tones_overflow_without_scaling_and_not_with_halving():
    points = make_full_scale_signal("tone", 100, 256, 16, np.random.default_rng(6))

    assert fft(points, 16, NO_SCALING).overflows.all()  # every stage doubles the tone
    assert not fft(points, 16, HALVING).overflows.any()


def test_halving_overflows_if_both_parts_are_at_full_scale():
    # |W (a + b)| / 2 has parts up to sqrt 2 if a and b have parts up to 1.
    assert fft(
        draw_extreme_words(50, 64, 16, np.random.default_rng(7)), 16, HALVING
    ).overflows.any()


def test_chain_counts_overflows_by_stage(radar, clean_frame):
    for scaling, overflows in (("block", False), ("none", True)):
        result = fixed_point_map(clean_frame, radar, words=WordLengths(scaling=scaling))
        assert bool(result.overflows.any()) == overflows
        by_name = result.overflows.sel(stage=[f"range_fft {j}" for j in range(8)])
        assert bool(by_name.any()) == overflows


# --- Logarithms --------------------------------------------------------------------------------


@pytest.mark.parametrize(("table_bits", "fraction_bits"), [(1, 4), (4, 6), (8, 8), (12, 10)])
def test_logarithm_error_stays_within_and_near_its_bound(table_bits, fraction_bits):
    words = WordLengths(log_table_bits=table_bits, log_fraction_bits=fraction_bits)
    powers = np.concatenate([np.arange(1, 2**15), 2 ** np.arange(48), 2 ** np.arange(1, 49) - 1])

    table = integer_log2_table(table_bits, fraction_bits)
    result = log2_of_powers(powers[None], table, table_bits, fraction_bits)[0]

    error = abs(result / 2**fraction_bits - np.log2(powers.astype(float)))
    assert 0.5 * max_log2_error(words) < error.max() <= max_log2_error(words)
    assert log2_of_powers(np.zeros((1, 1), int), table, table_bits, fraction_bits) == 0


# --- The chain against floating point ----------------------------------------------------------


@pytest.fixture(scope="module")
def clean_frame(radar) -> xr.DataArray:
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(30, 0, 0), velocity_m_per_s=(8, 0, 0), rcs_m2=10),
            dc.Target(position_m=(45, 5, 0), velocity_m_per_s=(-11, 0, 0), rcs_m2=1),
        ]
    )
    return dc.simulate(scene, radar, impairments=()).isel(frame=0)


def add_noise(frame: xr.DataArray, snr_db: float, seed: int) -> xr.DataArray:
    noisy_frame = frame.copy()
    power_w = float(np.mean(abs(frame.values) ** 2)) / 10 ** (snr_db / 10)
    add_white_noise(noisy_frame.values, power_w, np.random.default_rng(seed))
    return noisy_frame


def replace_false_alarm_probability(chain: dc.Chain, pfa: float) -> dc.Chain:
    return replace(chain, cfar=replace(chain.cfar, false_alarm_probability=pfa))


@pytest.fixture(scope="module")
def scenario() -> dc.Scenario:
    return dc.reference(["chain.n_range_bins=4096"])


@pytest.fixture(scope="module")
def frame(clean) -> xr.DataArray:
    return add_noise(clean.isel(frame=0), -10.0, seed=2)


def test_16_bit_chain_reproduces_floating_point_detections_of_reference(scenario, frame):
    radar, chain = scenario.radar, scenario.chain
    power, result = dc.power_map(frame, radar, chain), fixed_point_map(frame, radar, chain)
    threshold = dc.threshold_map(power, radar, chain)

    assert (result.detected.values == (power.values > threshold.values)).all()
    cells = find_peaks(power.values, threshold.values, chain.map_noise_statistics(radar))
    fixed_cells = find_peaks(
        result.power.values.astype(float),
        result.threshold.values.astype(float),
        chain.map_noise_statistics(radar),
    )
    assert len(cells) == 1
    assert (cells == fixed_cells).all()
    assert abs(result.range[cells[0, 1]].item() - 50) < 0.54


@nightly
def test_differing_cells_are_close_to_threshold(scenario, frame):
    # 5,200 of 524,288 cells exceed the threshold at 1e-2, and as many are within 1 dB of it. Noise
    # 76 dB above the rounding error changes cell powers by 0.003 dB, four times that with two bits
    # less. Rows of the echo at 50 m have larger exponents and errors.
    radar, chain = scenario.radar, replace_false_alarm_probability(scenario.chain, 1e-2)
    noise_rows = {"range": slice(110, None)}
    power = dc.power_map(frame, radar, chain)
    threshold = dc.threshold_map(power, radar, chain)
    for bits, farthest_db in ((12, 0.2), (14, 0.05), (16, 0.0125)):
        names = ("sample_bits", "window_bits", "twiddle_bits", "range_bits", "doppler_bits")
        words = WordLengths(**dict.fromkeys(names, bits))
        result = fixed_point_map(frame, radar, chain, words)
        agreement = compare_detections(
            *(array.isel(noise_rows) for array in (result, power, threshold))
        )
        assert agreement.n_float > 4000
        assert agreement.farthest_db < farthest_db
        assert abs(agreement.floor - 1) < 2e-3
    assert agreement.n_only_one < 30


@nightly
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("window", ["hann", "rectangular"])
def test_fixed_point_power_equals_floating_point_power(radar, clean_frame, sampling, window):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    samples = clean_frame if sampling == "complex" else clean_frame.real
    chain = dc.Chain(range_window=window, doppler_window=window, n_range_bins=512)

    result, power = fixed_point_map(samples, radar, chain), dc.power_map(samples, radar, chain)

    strong = power.values > power.values.max() / 1e4
    ratio = (result.power.values * result.power.attrs["scale"])[strong] / power.values[strong]
    assert abs(to_decibels(ratio)).max() < 0.05
    assert np.argmax(result.power.values) == np.argmax(power.values)
    assert result.range.equals(power.range)
    assert result.velocity.equals(power.velocity)
    log2 = result.log_power.values / 2 ** result.log_power.attrs["fraction_bits"]
    assert abs(log2[strong] - np.log2(result.power.values[strong])).max() < max_log2_error(
        WordLengths()
    )


def test_adc_codes_are_used_unchanged(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 0, 0), rcs_m2=10)])
    converter = dc.impairments.Quantisation(bits=12, full_scale_w=1e-9)
    cube = dc.simulate(scene, radar, seed=1, impairments=(dc.impairments.ThermalNoise(), converter))
    words = WordLengths(sample_bits=12)

    from_codes = fixed_point_map(extract_adc_codes(cube).isel(frame=0), radar, words=words)
    from_cube = fixed_point_map(cube.isel(frame=0), radar, words=words)

    assert from_codes.equals(from_cube)
    assert from_codes.power.attrs == from_cube.power.attrs


def test_tdm_slots_are_channels_as_in_floating_point_chain(radar):
    frame = replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)), n_chirps=64)
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)])
    radar = replace(radar, frame=frame, array=array)
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 3, 0), rcs_m2=10)])
    cube = dc.simulate(scene, radar, seed=3).isel(frame=0)

    result, power = fixed_point_map(cube, radar), dc.power_map(cube, radar, dc.Chain())

    agreement = compare_detections(
        result, power, dc.threshold_map(power, radar, dc.Chain().fit_to_radar(radar))
    )
    assert result.sizes["channel"] == 4
    assert agreement.n_float > 5
    assert agreement.n_only_one == 0
    assert abs(agreement.floor - 1) < 1e-3


# --- False alarms over word lengths ------------------------------------------------------------


@nightly
def test_false_alarm_rate_of_noise_holds_down_to_8_bits(radar):
    # 32,768 cells at 1e-2 in each of 6 maps yield 1,966 alarms in clusters of at most 4, so the
    # standard error of the rate is 4.5 %. Most alarms are those of floating point.
    rng = np.random.default_rng(8)
    chain = replace_false_alarm_probability(dc.Chain(), 1e-2)
    frames = [simulate_noise_cube(radar, rng).isel(frame=0) for _ in range(6)]
    over_bits = sum(
        compare_detections_over_bits(frame, radar, chain, (8, 10, 16)) for frame in frames
    )

    rate = over_bits.n_fixed / (6 * 128 * 256)
    assert ((rate > 0.73e-2) & (rate < 1.27e-2)).all()
    assert abs(over_bits.n_fixed / over_bits.n_float - 1).max() < 0.1
    assert over_bits.n_only_one.sel(bits=16) <= 0.01 * over_bits.n_float.sel(bits=16)


@nightly
def test_truncation_causes_false_alarms_at_zero_velocity(radar):
    frame = simulate_noise_cube(radar, np.random.default_rng(9)).isel(frame=0)

    def static_alarm_rate(rounding, scaling):
        words = WordLengths(range_bits=6, doppler_bits=12, rounding=rounding, scaling=scaling)
        result = fixed_point_map(
            frame, radar, replace_false_alarm_probability(dc.Chain(), 1e-3), words
        )
        return result.detected.sel(velocity=0, method="nearest").mean().item()

    # A last stage that shifts lowers every range bin of every chirp by a quarter of a bit, the
    # stages before it by more; 128 chirps accumulate. Block scaling shifts less: the biases of
    # early stages meet in few bins.
    assert static_alarm_rate("truncate", "halving") > 0.9
    assert static_alarm_rate("convergent", "halving") < 0.03
    assert static_alarm_rate("truncate", "block") > 0.1
    assert static_alarm_rate("convergent", "block") < 0.005


@nightly
def test_short_words_cause_false_alarms_next_to_strong_echo(radar):
    # The echo is 50 dB above the noise of a sample, 95 dB in the map, and between bins on both
    # axes. 10 bits span 60 dB: noise is below their last bit.
    chirps, samples = np.arange(128)[:, None, None], np.arange(256)
    tone = np.exp(2j * np.pi * (60.3 * samples / 256 + 20.4 * chirps / 128))
    noise = simulate_noise_cube(radar, np.random.default_rng(10)).isel(frame=0)
    frame = (noise + 10 ** (50 / 20) * tone).astype(np.complex64)

    over_bits = compare_detections_over_bits(
        frame, radar, replace_false_alarm_probability(dc.Chain(), 1e-3), (10, 20)
    )

    assert over_bits.n_fixed.sel(bits=10) > 5 * over_bits.n_float.sel(bits=10)
    assert over_bits.n_only_one.sel(bits=20) <= 2
    assert over_bits.floor.sel(bits=20) == pytest.approx(1, abs=0.01)


# --- Rejected settings -------------------------------------------------------------------------


def test_rejects_fft_length_other_than_power_of_two(reference, clean):
    with pytest.raises(dc.InvalidSetting, match="set n_range_bins to 4096"):
        fixed_point_map(clean.isel(frame=0), reference.radar, reference.chain)
    with pytest.raises(dc.InvalidSetting, match="pad them with zeros"):
        fft(np.zeros((3, 12, 2), int), 16, WordLengths())


def test_padding_keeps_explicit_number_of_bins(reference, radar):
    assert pad_to_powers_of_two(reference.chain, reference.radar) == replace(
        reference.chain, n_range_bins=4096
    )
    assert pad_to_powers_of_two(dc.Chain(), radar) == dc.Chain()
    padded_chain = dc.Chain(n_range_bins=300)
    assert pad_to_powers_of_two(padded_chain, radar) == padded_chain


@pytest.mark.parametrize(
    ("chain", "message"),
    [
        (dc.Chain(n_velocity_bins=200), "set n_velocity_bins to 256"),
        (dc.Chain(range_walk="keystone"), "range_walk"),
        (
            dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.OrderedStatistic(), offset=10.0)),
            "ordered-statistic; expected cell-averaging",
        ),
    ],
)
def test_rejects_settings_without_fixed_point_implementation(radar, clean_frame, chain, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        fixed_point_map(clean_frame, radar, chain)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"range_bits": 3}, "range_bits: 3"),
        ({"sample_bits": 16.0}, "sample_bits"),
        ({"power_bits": 49}, "at most|to 48"),
        ({"scaling": "always"}, "block or halving or none"),
        ({"rounding": None}, "convergent or half-up or truncate"),
    ],
)
def test_rejects_invalid_word_lengths(words, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        WordLengths(**words)


def test_rejects_cfar_sums_above_63_bits(radar, clean_frame):
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=600, velocity=50),
        n_guard=dc.Cells(range=1, velocity=1),
        offset=10.0,
    )
    with pytest.raises(dc.InvalidSetting, match="power_bits: 48; expected at most 46"):
        fixed_point_map(clean_frame, radar, dc.Chain(n_range_bins=2048, cfar=cfar))


@pytest.mark.parametrize("shift", [0, 4, 24, 31, 32, 40])
def test_thresholds_are_saturated_integer_products(shift):
    power = np.random.default_rng(shift).integers(0, 2**48, size=(4, 7))
    factors = np.full(7, 2**24 - 1)

    starts = np.clip(np.arange(7) - 1, 0, 4)
    result = cell_averaging_thresholds(power, factors, shift, starts, (1, 0, 0, 0))

    training_columns = [
        [k for k in range(first, first + 3) if k != j] for j, first in enumerate(starts)
    ]
    sums = [[sum(int(row[k]) for k in places) for places in training_columns] for row in power]
    assert result.tolist() == [
        [min(total * (2**24 - 1) >> shift, 2**62) for total in row] for row in sums
    ]


def test_rejects_threshold_factor_larger_than_its_word(radar, clean_frame):
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=1, velocity=0),
        n_guard=dc.Cells(range=0, velocity=0),
        offset=1e4,
    )
    with pytest.raises(dc.InvalidSetting, match="factor_bits: 8; expected at least 13"):
        fixed_point_map(clean_frame, radar, dc.Chain(cfar=cfar), WordLengths(factor_bits=8))


def test_rejects_cube_other_than_one_frame_of_radar(radar, clean_frame):
    broken = clean_frame.copy()
    broken[3, 0, 5] = np.nan
    for cube, message in (
        (clean_frame.expand_dims("frame"), "one frame"),
        (clean_frame.isel(rx=[0]), "one frame"),
        (clean_frame.real, "complex samples"),
        (broken, "not finite"),
        (clean_frame.assign_attrs(scale=1e-12), "enough bits"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            fixed_point_map(cube, radar)


def test_rejects_points_other_than_integer_words():
    for points in (np.zeros((8, 2)), np.full((8, 2), 2**15), np.zeros((2, 8), int)):
        with pytest.raises(dc.InvalidSetting, match="integers"):
            fft(points, 16, WordLengths())


def test_rejects_empty_sweep_over_word_lengths(radar, clean_frame):
    for settings in ({"bits": ()}, {"n_points": 0}, {"n_points": 100}, {"n_trials": 0}):
        with pytest.raises(dc.InvalidSetting):
            signal_to_quantisation_noise_over_bits(**{"bits": (16,), **settings})
    with pytest.raises(dc.InvalidSetting, match="number of bits"):
        compare_detections_over_bits(clean_frame, radar, dc.Chain(), ())


def test_noise_prediction_rejects_truncation():
    with pytest.raises(dc.InvalidSetting, match="convergent"):
        predict_quantisation_noise(np.zeros((1, 4)), np.ones(1), WordLengths(rounding="truncate"))


def test_zero_samples_yield_no_detection(radar, clean_frame):
    result = fixed_point_map(clean_frame * 0, radar)

    assert not result.power.any()
    assert not result.detected.any()
    assert not result.log_power.any()
