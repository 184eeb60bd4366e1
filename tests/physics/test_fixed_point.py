"""The chain in whole numbers: what rounding costs, what overflows, and what is still detected."""

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
from dechirp.processing.fixed_point.coefficients import log2_table
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
from noise import noise_cube

NO_SCALING = WordLengths(scaling="none")
HALVING = WordLengths(scaling="halving")


def tones(cycles: np.ndarray, n: int, bits: int, rng: np.random.Generator) -> np.ndarray:
    """Tones of full scale, (n_tones, n, 2), of so many cycles a transform and any phase."""
    phase = 2 * np.pi * (cycles[:, None] * np.arange(n) / n + rng.uniform(size=(len(cycles), 1)))
    parts = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.rint((2 ** (bits - 1) - 1) * parts).astype(int)


def corners(n_blocks: int, n: int, bits: int, rng: np.random.Generator) -> np.ndarray:
    """Words that are nothing but the largest and the least."""
    half = 2 ** (bits - 1)
    return rng.choice([-half, half - 1], size=(n_blocks, n, 2))


# --- What rounding costs -----------------------------------------------------------------------


@pytest.mark.parametrize("signal", ["on bins", "between bins", "real", "noise"])
def test_a_16_bit_transform_of_256_points_keeps_60_db_at_full_scale(signal):
    rng = np.random.default_rng(1)
    if signal == "noise":
        points = make_full_scale_signal("noise", 500, 256, 16, rng)
    else:
        cycles = np.arange(256.0) if signal == "on bins" else rng.uniform(0, 256, 2000)
        points = tones(cycles, 256, 16, rng)
        points[..., 1] *= signal != "real"

    found = fft(points, 16, WordLengths())

    assert signal_to_quantisation_noise(points, found).min() > 1e6
    assert not found.overflows.any()


# Errors are independent from number to number: of 400 x n of them the mean square has a standard
# error of 1 / sqrt(400 n), 0.6 % at 64 points. The law is 1 to 7 % too large under block scaling,
# as more numbers are even than odd after a halving.
@pytest.mark.parametrize("scaling", ["block", "halving"])
@pytest.mark.parametrize("bits", [12, 16, 22])
@pytest.mark.parametrize("n", [64, 256, 1024])
def test_the_noise_of_rounding_white_noise_is_that_of_theory(n, bits, scaling):
    words = WordLengths(scaling=scaling, twiddle_bits=bits)
    measured = signal_to_quantisation_noise_over_bits(
        (bits,), n_points=n, words=words, n_trials=400, seed=n + bits
    )

    one = measured.sel(bits=bits, signal="noise")
    assert 0.96 < float(one.measured / one.predicted) < 1.12


# The noise of a tone varies by half of it from tone to tone: 1,500 of them have a standard error
# of 1.3 %, and 8 % is 6 of them.
@pytest.mark.parametrize("bits", [12, 16, 22])
def test_the_noise_of_rounding_tones_is_that_of_theory_in_the_mean(bits):
    one = signal_to_quantisation_noise_over_bits((bits,), n_trials=1500, seed=bits).sel(
        signal="tone"
    )

    assert 0.92 < one.measured.item() / one.predicted.item() < 1.17


# Exponents are 8 or 9 from tone to tone: noise counts in the scale of the samples, as NumPy
# sees it, not in last bits, where tones of larger exponents count a quarter. 1.5 dB apart.
def test_the_mean_noise_of_tones_is_that_of_the_samples():
    n = 1500
    points = make_full_scale_signal("tone", n, 256, 16, np.random.default_rng(7))
    found = fft(points, 16, WordLengths())
    exact = np.fft.fft(points @ [1, 1j])
    words = np.ldexp(found.points, found.shifts.sum(axis=-1)[:, None, None]) @ [1, 1j]
    ratio = np.sum(abs(exact) ** 2) / np.sum(abs(words - exact) ** 2)

    one = signal_to_quantisation_noise_over_bits((16,), n_trials=n, seed=8).sel(
        bits=16, signal="tone"
    )

    assert one.measured.item() == pytest.approx(ratio, rel=0.11)  # 6 times 1.3 %, of both


def test_the_noise_of_halving_at_every_stage_is_a_geometric_sum():
    # 8 stages; the first two round halves alone (1/8), of the others 2 / 2^(j-1) of the turns
    # are quarter turns: each stage's noise is halved by each one after it.
    shares = np.array([1, 1, 1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64])
    sums = sum(2 * (q / 8 + (1 - q) / 12) / 2 ** (7 - j) for j, q in enumerate(shares))

    exact = WordLengths(scaling="halving", twiddle_bits=24)
    law = predict_quantisation_noise(np.ones(8), np.array(0.0), exact)

    assert law == pytest.approx(sums, rel=1e-12)
    points = make_full_scale_signal("noise", 400, 256, 16, np.random.default_rng(2))
    found = fft(points, 16, exact)
    error = found.points @ [1, 1j] - np.fft.fft(points @ [1, 1j]) / 256
    assert np.mean(abs(error) ** 2) == pytest.approx(sums, rel=0.03)


# 100 trials of noise: 0.6 % or 0.03 dB at each end.
def test_each_bit_adds_6_02_db():
    over_bits = (
        signal_to_quantisation_noise_over_bits((12, 22), seed=3).sel(signal="noise").measured
    )

    assert to_decibels(over_bits[1] / over_bits[0]) / 10 == pytest.approx(6.02, abs=0.02)


def test_block_scaling_keeps_weak_signals_that_halving_loses():
    weak = make_full_scale_signal("tone", 200, 256, 16, np.random.default_rng(4)) // 100

    block, halving = (
        signal_to_quantisation_noise(weak, fft(weak, 16, words))
        for words in (WordLengths(), HALVING)
    )

    # Halving costs the 40 dB; blocks are shifted 6 or 7 bits fewer, as far as there is noise.
    assert to_decibels(np.median(block / halving)) > 30
    assert to_decibels(block.min()) > 60


def test_truncation_moves_numbers_by_half_a_word_and_convergent_rounding_by_none():
    points = make_full_scale_signal("noise", 400, 256, 16, np.random.default_rng(5))
    exact = np.fft.fft(points @ [1, 1j])

    def mean_error(rounding):
        found = fft(points, 16, WordLengths(rounding=rounding, scaling="halving"))
        return np.mean(found.points @ [1, 1j] - exact / 256)

    # After the last stage -1/2, but for the bin of quarter turns, beside what came before.
    # 102,400 numbers of 0.7 words: 0.002 standard error.
    assert abs(mean_error("convergent")) < 0.015
    assert mean_error("truncate").real < -0.4
    assert mean_error("truncate").imag < -0.4


# --- What overflows ----------------------------------------------------------------------------


@given(
    bits=st.integers(4, 24),
    twiddle_bits=st.integers(4, 24),
    stages=st.integers(0, 7),
    seed=st.integers(0, 2**31),
)
def test_nothing_overflows_under_block_scaling(bits, twiddle_bits, stages, seed):
    points = corners(8, 2**stages, bits, np.random.default_rng(seed))

    found = fft(points, bits, WordLengths(twiddle_bits=twiddle_bits))

    assert not found.overflows.any()
    assert found.shifts.max(initial=0) <= 2


def test_tones_of_full_scale_overflow_without_scaling_and_not_by_halving():
    points = make_full_scale_signal("tone", 100, 256, 16, np.random.default_rng(6))

    assert fft(points, 16, NO_SCALING).overflows.all()  # every stage doubles the tone
    assert not fft(points, 16, HALVING).overflows.any()


def test_halving_overflows_where_both_parts_are_of_full_scale():
    # |a + W b| / 2 has parts up to (1 + sqrt 2) / 2 where a and b have parts up to 1.
    assert fft(corners(50, 64, 16, np.random.default_rng(7)), 16, HALVING).overflows.any()


def test_a_chain_counts_its_overflows_and_block_scaling_has_none(radar, clean_frame):
    for scaling, overflows in (("block", False), ("none", True)):
        found = fixed_point_map(clean_frame, radar, words=WordLengths(scaling=scaling))
        assert bool(found.overflows.any()) == overflows
        by_name = found.overflows.sel(stage=[f"range_fft {j}" for j in range(8)])
        assert bool(by_name.any()) == overflows


# --- Logarithms --------------------------------------------------------------------------------


@pytest.mark.parametrize(("table_bits", "fraction_bits"), [(1, 4), (4, 6), (8, 8), (12, 10)])
def test_logarithms_are_within_their_bound_and_reach_it(table_bits, fraction_bits):
    words = WordLengths(log_table_bits=table_bits, log_fraction_bits=fraction_bits)
    powers = np.concatenate([np.arange(1, 2**15), 2 ** np.arange(48), 2 ** np.arange(1, 49) - 1])

    table = log2_table(table_bits, fraction_bits)
    found = log2_of_powers(powers[None], table, table_bits, fraction_bits)[0]

    error = abs(found / 2**fraction_bits - np.log2(powers.astype(float)))
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


def with_noise(frame: xr.DataArray, snr_db: float, seed: int) -> xr.DataArray:
    made = frame.copy()
    power_w = float(np.mean(abs(frame.values) ** 2)) / 10 ** (snr_db / 10)
    add_white_noise(made.values, power_w, np.random.default_rng(seed))
    return made


def at(chain: dc.Chain, pfa: float) -> dc.Chain:
    return replace(chain, cfar=replace(chain.cfar, false_alarm_probability=pfa))


@pytest.fixture(scope="module")
def scenario() -> dc.Scenario:
    return dc.reference(["chain.n_range_bins=4096"])


@pytest.fixture(scope="module")
def frame(clean) -> xr.DataArray:
    return with_noise(clean.isel(frame=0), -10.0, seed=2)


def test_16_bits_find_in_the_reference_scenario_what_floating_point_finds(scenario, frame):
    radar, chain = scenario.radar, scenario.chain
    power, found = dc.power_map(frame, radar, chain), fixed_point_map(frame, radar, chain)
    threshold = dc.threshold_map(power, radar, chain)

    assert (found.detected.values == (power.values > threshold.values)).all()
    cells = find_peaks(power.values, threshold.values, chain.map_noise(radar))
    same = find_peaks(
        found.power.values.astype(float),
        found.threshold.values.astype(float),
        chain.map_noise(radar),
    )
    assert len(cells) == 1
    assert (cells == same).all()
    assert abs(found.range[cells[0, 1]].item() - 50) < 0.54


def test_cells_that_words_turn_over_are_next_to_their_threshold(scenario, frame):
    # Of 524,288 cells at 1e-2, 5,200 are over it, and as many within 1 dB of it. Noise 76 dB over
    # what rounding adds moves the power of a cell by 0.003 dB, two bits less by four times that.
    radar, chain = scenario.radar, at(scenario.chain, 1e-2)
    over_bits = compare_detections_over_bits(frame, radar, chain, (12, 14, 16))

    assert (over_bits.n_float > 4000).all()
    assert over_bits.n_only_one.values[-1] < 30
    assert (over_bits.farthest_db.values < [0.2, 0.05, 0.0125]).all()
    assert abs(over_bits.floor - 1).max() < 2e-3


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("window", ["hann", "rectangular"])
def test_powers_in_words_are_those_of_the_float_map(radar, clean_frame, sampling, window):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    samples = clean_frame if sampling == "complex" else clean_frame.real
    chain = dc.Chain(range_window=window, doppler_window=window, n_range_bins=512)

    found, power = fixed_point_map(samples, radar, chain), dc.power_map(samples, radar, chain)

    strong = power.values > power.values.max() / 1e4
    ratio = (found.power.values * found.power.attrs["scale"])[strong] / power.values[strong]
    assert abs(to_decibels(ratio)).max() < 0.05
    assert np.argmax(found.power.values) == np.argmax(power.values)
    assert found.range.equals(power.range)
    assert found.velocity.equals(power.velocity)
    log2 = found.log_power.values / 2 ** found.log_power.attrs["fraction_bits"]
    assert abs(log2[strong] - np.log2(found.power.values[strong])).max() < max_log2_error(
        WordLengths()
    )


def test_codes_of_a_converter_are_taken_as_they_are(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 0, 0), rcs_m2=10)])
    converter = dc.impairments.Quantisation(bits=12, full_scale_w=1e-9)
    cube = dc.simulate(scene, radar, seed=1, impairments=(dc.impairments.ThermalNoise(), converter))
    words = WordLengths(sample_bits=12)

    from_codes = fixed_point_map(extract_adc_codes(cube).isel(frame=0), radar, words=words)
    from_cube = fixed_point_map(cube.isel(frame=0), radar, words=words)

    assert from_codes.equals(from_cube)
    assert from_codes.power.attrs == from_cube.power.attrs


def test_time_slots_are_channels_as_in_the_float_chain(radar):
    frame = replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)), n_chirps=64)
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)])
    radar = replace(radar, frame=frame, array=array)
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 3, 0), rcs_m2=10)])
    cube = dc.simulate(scene, radar, seed=3).isel(frame=0)

    found, power = fixed_point_map(cube, radar), dc.power_map(cube, radar, dc.Chain())

    result = compare_detections(
        found, power, dc.threshold_map(power, radar, dc.Chain().fit_to_radar(radar))
    )
    assert found.sizes["channel"] == 4
    assert result.n_float > 5
    assert result.n_only_one == 0
    assert abs(result.floor - 1) < 1e-3


# --- False alarms over word lengths ------------------------------------------------------------


def test_noise_alone_gives_its_false_alarms_down_to_8_bits(radar):
    # 32,768 cells at 1e-2 in each of 6 maps: 1,966 alarms in clusters of 4 at the most, so 4.5 %
    # standard error of the rate. Word for word most alarms are those of floating point.
    rng = np.random.default_rng(8)
    chain = at(dc.Chain(), 1e-2)
    frames = [noise_cube(radar, rng).isel(frame=0) for _ in range(6)]
    over_bits = sum(
        compare_detections_over_bits(frame, radar, chain, (8, 10, 16)) for frame in frames
    )

    rate = over_bits.n_fixed / (6 * 128 * 256)
    assert ((rate > 0.73e-2) & (rate < 1.27e-2)).all()
    assert abs(over_bits.n_fixed / over_bits.n_float - 1).max() < 0.1
    assert over_bits.n_only_one.sel(bits=16) <= 0.01 * over_bits.n_float.sel(bits=16)


def test_truncation_draws_a_line_at_zero_velocity(radar):
    frame = noise_cube(radar, np.random.default_rng(9)).isel(frame=0)

    def at_rest(rounding):
        words = WordLengths(range_bits=6, doppler_bits=12, rounding=rounding)
        found = fixed_point_map(frame, radar, at(dc.Chain(), 1e-3), words)
        return found.detected.sel(velocity=0, method="nearest").mean().item()

    # Every row of every chirp is half a word too low, and 128 chirps add up.
    assert at_rest("truncate") > 0.4
    assert at_rest("convergent") < 0.02


def test_words_too_short_for_a_strong_echo_make_alarms_of_the_noise_beside_it(radar):
    # 50 dB over the noise of a sample, 95 dB in the map; a tone turns at its beat and Doppler
    # frequency, between bins. 10 bits hold 60 dB: noise is below their last bit.
    chirps, samples = np.arange(128)[:, None, None], np.arange(256)
    tone = np.exp(2j * np.pi * (60.3 * samples / 256 + 20.4 * chirps / 128))
    noise = noise_cube(radar, np.random.default_rng(10)).isel(frame=0)
    frame = (noise + 10 ** (50 / 20) * tone).astype(np.complex64)

    over_bits = compare_detections_over_bits(frame, radar, at(dc.Chain(), 1e-3), (10, 20))

    assert over_bits.n_fixed.sel(bits=10) > 5 * over_bits.n_float.sel(bits=10)
    assert over_bits.n_only_one.sel(bits=20) <= 2
    assert over_bits.floor.sel(bits=20) == pytest.approx(1, abs=0.01)


# --- What is refused ---------------------------------------------------------------------------


def test_lengths_that_are_no_power_of_two_are_refused_with_the_next_one(reference, clean):
    with pytest.raises(dc.InvalidSetting, match="set n_range_bins to 4096"):
        fixed_point_map(clean.isel(frame=0), reference.radar, reference.chain)
    with pytest.raises(dc.InvalidSetting, match="pad them with zeros"):
        fft(np.zeros((3, 12, 2), int), 16, WordLengths())


def test_transforms_are_padded_where_nothing_else_was_asked_for(reference, radar):
    assert pad_to_powers_of_two(reference.chain, reference.radar) == replace(
        reference.chain, n_range_bins=4096
    )
    assert pad_to_powers_of_two(dc.Chain(), radar) == dc.Chain()
    asked = dc.Chain(n_range_bins=300)
    assert pad_to_powers_of_two(asked, radar) == asked


@pytest.mark.parametrize(
    ("chain", "match"),
    [
        (dc.Chain(n_velocity_bins=200), "set n_velocity_bins to 128"),
        (dc.Chain(range_walk="keystone"), "range_walk"),
        (
            dc.Chain(cfar=dc.Cfar(estimator=dc.cfar.OrderedStatistic(), offset=10.0)),
            "ordered-statistic; expected cell-averaging",
        ),
    ],
)
def test_what_whole_numbers_have_not_is_refused(radar, clean_frame, chain, match):
    with pytest.raises(dc.InvalidSetting, match=match):
        fixed_point_map(clean_frame, radar, chain)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ({"range_bits": 3}, "range_bits: 3"),
        ({"sample_bits": 16.0}, "sample_bits"),
        ({"power_bits": 49}, "at most|to 48"),
        ({"scaling": "always"}, "block or halving or none"),
        ({"rounding": None}, "convergent or half-up or truncate"),
    ],
)
def test_words_that_no_machine_has_are_refused(words, match):
    with pytest.raises(dc.InvalidSetting, match=match):
        WordLengths(**words)


def test_sums_that_63_bits_do_not_hold_are_refused(radar, clean_frame):
    wide = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=600, velocity=50),
        n_guard=dc.Cells(range=1, velocity=1),
        offset=10.0,
    )
    with pytest.raises(dc.InvalidSetting, match="power_bits: 48; expected at most 46"):
        fixed_point_map(clean_frame, radar, dc.Chain(n_range_bins=2048, cfar=wide))


@pytest.mark.parametrize("shift", [0, 4, 24, 31, 32, 40])
def test_thresholds_are_whole_products_and_never_wrap(shift):
    power = np.random.default_rng(shift).integers(0, 2**48, size=(4, 7))
    factors = np.full(7, 2**24 - 1)

    starts = np.clip(np.arange(7) - 1, 0, 4)
    found = cell_averaging_thresholds(power, factors, shift, starts, (1, 0, 0, 0))

    beside = [[k for k in range(first, first + 3) if k != j] for j, first in enumerate(starts)]
    sums = [[sum(int(row[k]) for k in places) for places in beside] for row in power]
    assert found.tolist() == [
        [min(total * (2**24 - 1) >> shift, 2**62) for total in row] for row in sums
    ]


def test_a_factor_larger_than_its_word_is_refused(radar, clean_frame):
    few = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=1, velocity=0),
        n_guard=dc.Cells(range=0, velocity=0),
        offset=1e4,
    )
    with pytest.raises(dc.InvalidSetting, match="factor_bits: 8; expected at least 13"):
        fixed_point_map(clean_frame, radar, dc.Chain(cfar=few), WordLengths(factor_bits=8))


def test_cubes_that_are_not_one_frame_of_the_radar_are_refused(radar, clean_frame):
    broken = clean_frame.copy()
    broken[3, 0, 5] = np.nan
    for cube, match in (
        (clean_frame.expand_dims("frame"), "one frame"),
        (clean_frame.isel(rx=[0]), "one frame"),
        (clean_frame.real, "complex samples"),
        (broken, "not finite"),
        (clean_frame.assign_attrs(scale=1e-12), "enough bits"),
    ):
        with pytest.raises(dc.InvalidSetting, match=match):
            fixed_point_map(cube, radar)


def test_points_that_are_no_words_are_refused():
    for points in (np.zeros((8, 2)), np.full((8, 2), 2**15), np.zeros((2, 8), int)):
        with pytest.raises(dc.InvalidSetting, match="integers"):
            fft(points, 16, WordLengths())


def test_tables_over_no_words_at_all_are_refused(radar, clean_frame):
    for wrong in ({"bits": ()}, {"n_points": 0}, {"n_points": 100}, {"n_trials": 0}):
        with pytest.raises(dc.InvalidSetting):
            signal_to_quantisation_noise_over_bits(**{"bits": (16,), **wrong})
    with pytest.raises(dc.InvalidSetting, match="number of bits"):
        compare_detections_over_bits(clean_frame, radar, dc.Chain(), ())


def test_the_law_of_noise_is_refused_for_roundings_it_does_not_know():
    with pytest.raises(dc.InvalidSetting, match="convergent"):
        predict_quantisation_noise(np.zeros((1, 4)), np.ones(1), WordLengths(rounding="truncate"))


def test_no_samples_at_all_are_no_detection(radar, clean_frame):
    found = fixed_point_map(clean_frame * 0, radar)

    assert not found.power.any()
    assert not found.detected.any()
    assert not found.log_power.any()
