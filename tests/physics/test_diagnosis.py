"""Well-known mistakes in arrays of other programs: diagnosis of wrong and of right arrays."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.diagnosis.noise_law import measure_noise_scale
from dechirp.processing.diagnosis.threshold_factor import false_alarm_probability
from dechirp.theory.windows import window_weights
from foreign_arrays import (
    RIGHT,
    WRONG,
    amplitude_as_power,
    amplitude_decibels,
    beat_samples,
    both_halves_of_real_samples,
    exchanged_axes_of_equal_length,
    exchanged_map,
    fast_scene,
    missing_fftshift,
    missing_window,
    phase_of_frequency_times_time,
    random_map,
    random_radar,
    random_scene,
    range_axis_to_half_the_sample_rate,
    right_map,
    swapped_samples,
    target_of,
)
from nightly import nightly

SEED = 9000  # thresholds were chosen on scenes with seeds below 1000


def test_mistakes_are_found_and_right_arrays_have_none():
    wrong = [make(np.random.default_rng(SEED + n)) for n, make in enumerate(WRONG)]
    missed = [case.kind for case in wrong if case.settings() != {case.expected}]
    assert len(wrong) >= 20
    assert len(missed) <= len(wrong) // 10, missed
    right = [
        make(np.random.default_rng(SEED + 100 * repeat + n))
        for n, make in enumerate(RIGHT)
        for repeat in range(2)
    ]
    assert len(right) >= 20
    assert [case.kind for case in right if case.settings()] == []


@nightly
def test_no_mistake_gets_a_wrong_diagnosis():
    for n, make in enumerate(WRONG):
        case = make(np.random.default_rng(SEED + 200 + n))
        assert case.settings() <= {case.expected}, case.kind


@pytest.mark.parametrize(
    ("make", "seed"),
    [
        # 32 rows, crowded: main lobes of strong echoes show the length of the FFT.
        (range_axis_to_half_the_sample_rate, 5_001_000),
        (range_axis_to_half_the_sample_rate, 5_002_000),
        # 107 independent cells of noise, with the number of averaged powers.
        (amplitude_as_power, 5_001_021),
        (amplitude_as_power, 5_002_021),
        # Windowed: lobes and mirrored lobes looked like sidelobes of a rectangular window.
        (both_halves_of_real_samples, 5_000_006),
        # Sidelobes of crowded echoes interfere: narrow main lobes show the missing window.
        *((missing_window, 9_200_000 + n) for n in (0, 1, 6, 8)),
    ],
)
def test_small_and_crowded_maps_have_their_mistake_alone(make, seed):
    case = make(np.random.default_rng(seed))
    assert case.settings() == {case.expected}


@nightly
def test_right_arrays_of_many_scenes_have_no_mistake():
    cases = [make(np.random.default_rng(7_000_000 + n)) for n in range(8) for make in RIGHT]
    assert [case.kind for case in cases if case.settings()] == []


def test_evidence_is_a_number_and_correction_names_the_code():
    for make, evidence, correction in (
        (amplitude_decibels, "spread by 0.5 times", "20 log10"),
        (missing_fftshift, "probability of chance", "fftshift(X, axes=0)"),
        (swapped_samples, "% of their energy", "exchange I and Q"),
    ):
        case = make(np.random.default_rng(3))
        (finding,) = case.function(*case.arguments, **case.options).findings
        assert evidence in finding.value
        assert correction in finding.fix
        assert finding.level == "warning"


def test_map_without_static_echoes_and_radar_tells_no_shift_sign_or_step():
    rng = np.random.default_rng(5)
    noise = rng.exponential(1.0, (32, 64))
    noise[11, 20] = 1e4
    diagnosis = dc.diagnosis.diagnose_map(noise, np.arange(64) * 0.5, np.arange(-16, 16) * 0.1)
    assert not diagnosis.findings
    assert {note.setting for note in diagnosis.undetermined} == {
        "axes",
        "range_m.scale",
        "velocity_m_per_s.scale",
        "fftshift",
        "velocity_m_per_s.sign",
    }
    assert all(note.value.startswith("cannot be told: ") for note in diagnosis.undetermined)


def test_known_target_tells_order_of_iq_of_a_single_echo():
    radar = random_radar(np.random.default_rng(7), sampling="complex")
    chirp = radar.frame.chirp
    target = {"target_range_m": 0.3 * chirp.max_range_m, "target_velocity_m_per_s": 0.0}
    beat = np.exp(2j * np.pi * 0.3 * np.arange(chirp.n_samples))
    rng = np.random.default_rng(8)
    noise = rng.standard_normal((2, radar.frame.n_chirps, chirp.n_samples))
    samples = beat + noise[0] + 1j * noise[1]
    for array, expected in ((samples, set()), (samples.conj(), {"iq"})):
        diagnosis = dc.diagnosis.diagnose_samples(array, radar, **target)
        assert {finding.setting for finding in diagnosis.findings} == expected
    alone = dc.diagnosis.diagnose_samples(samples.conj(), radar)
    assert not alone.findings
    assert "iq" in {note.setting for note in alone.undetermined}


def test_known_target_tells_order_of_iq_of_a_map_without_radar():
    # Six echoes (range cell, velocity cell, amplitude), Hann windows, 64 chirps of 128 samples.
    echoes = [(17, 0, 1.0), (29, 0, 0.6), (25, 6, 0.7), (44, 0, 0.4), (51, -9, 0.3), (60, 0, 0.2)]
    chirp, sample = np.arange(64)[:, None], np.arange(128)
    beat = sum(a * np.exp(2j * np.pi * (k * sample / 128 + n * chirp / 64)) for k, n, a in echoes)
    noise = np.random.default_rng(21).standard_normal((2, 64, 128))
    samples = (beat + 0.02 * (noise[0] + 1j * noise[1])) * np.outer(np.hanning(64), np.hanning(128))
    axes = 0.5 * np.arange(128), 0.25 * np.arange(-32, 32)
    target = {"target_range_m": 12.5, "target_velocity_m_per_s": 1.5}
    for array, cells, expected in (
        (samples, 128, set()),
        (samples.conj(), 128, {"iq"}),
        (samples.conj(), 110, set()),  # a cropped axis: no echo fits
    ):
        power = abs(np.fft.fftshift(np.fft.fft2(array), axes=0)) ** 2
        diagnosis = dc.diagnosis.diagnose_map(power[:, :cells], axes[0][:cells], axes[1], **target)
        assert {finding.setting for finding in diagnosis.findings} == expected


@pytest.mark.parametrize("velocity_cell", [7, -9])
@pytest.mark.parametrize("padding", [1, 2])
def test_known_moving_target_tells_reversed_ranges_from_swapped_parts(velocity_cell, padding):
    radar = random_radar(np.random.default_rng(7), sampling="complex")
    frame, chirp = radar.frame, radar.frame.chirp
    n_chirps, n_samples = frame.n_chirps, chirp.n_samples
    n_bins = padding * n_samples
    ranges_m, velocities = chirp.range_bins_m(n_bins), frame.velocity_bins_m_per_s(n_chirps)
    rows, columns = np.arange(n_chirps)[:, None], np.arange(n_samples)
    # Static echoes that weaken with R^-4 and a target, in cells of 1 / n of the span.
    echoes = [(0.06, 0, 3.0), (0.1, 0, 1.0), (0.15, 0, 0.5), (0.22, 0, 0.2), (0.28, 0, 0.12)]
    target = (round(0.18 * n_samples) / n_samples, velocity_cell, 1.0)
    noise = np.random.default_rng(8).standard_normal((2, n_chirps, n_samples))
    samples = 0.05 * (noise[0] + 1j * noise[1]) + sum(
        level * np.exp(2j * np.pi * (share * columns + cell * rows / n_chirps))
        for share, cell, level in (*echoes, target)
    )
    hann = [np.hanning(size + 1)[:-1] for size in (n_chirps, n_samples)]
    windowed = samples * np.outer(*hann)

    def power(array):
        return abs(np.fft.fftshift(np.fft.fft2(array, (n_chirps, n_bins)), axes=0)) ** 2

    known = {
        "target_range_m": target[0] * chirp.max_range_m,
        "target_velocity_m_per_s": float(velocities[n_chirps // 2 + velocity_cell]),
    }
    for values, expected in (
        (power(windowed), set()),
        (power(windowed.conj()), {"iq"}),
        (power(windowed)[:, ::-1], {"range_m.mirror"}),
    ):
        arguments = values, ranges_m, velocities
        diagnosis = dc.diagnosis.diagnose_map(*arguments, radar=radar, **known)
        assert {finding.setting for finding in diagnosis.findings} == expected
        for finding in dc.diagnosis.diagnose_map(*arguments, radar=radar).findings:
            assert finding.setting == "iq"
            assert "reversed the ranges alone" in finding.fix


@pytest.mark.parametrize("n_channels", [1, 4])
@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_noise_shows_the_scale_of_its_decibels(n_channels, factor):
    rng = np.random.default_rng(11)
    power = rng.gamma(n_channels, size=(128, 256)) ** factor
    assert measure_noise_scale(power, n_channels).factor == factor


def test_threshold_probability_is_that_of_drawn_noise():
    # 4 summed pulses in the cell and in each of 12 training cells; 2e5 draws of 1 in 100.
    rng = np.random.default_rng(12)
    cell = rng.gamma(4, size=200_000)
    training = rng.gamma(4 * 12, size=200_000) / 12
    factor = 2.6
    expected = false_alarm_probability(factor, 12, 4)
    rate = np.mean(cell > factor * training)
    assert abs(rate - expected) < 5 * np.sqrt(expected / cell.size)
    # One pulse: (1 + factor / N)^-N (Finn and Johnson 1968).
    assert false_alarm_probability(13.8, 16, 1) == pytest.approx((1 + 13.8 / 16) ** -16)


def test_threshold_of_a_window_over_range_alone_is_recognised():
    power = np.random.default_rng(5).exponential(size=(32, 256))
    ways = np.r_[np.ones(8), np.zeros(5), np.ones(8)] / 16
    mean = np.apply_along_axis(np.convolve, 1, power, ways, "same")
    for factor, settings in ((-np.log(1e-4), ["threshold"]), (16 * (1e4 ** (1 / 16) - 1), [])):
        diagnosis = dc.diagnosis.diagnose_threshold(factor * mean, power, 8, 2, 1e-4)
        assert [finding.setting for finding in diagnosis.findings] == settings
        assert not diagnosis.undetermined


def test_known_target_at_half_its_range_is_a_wrong_axis():
    """An axis up to fs / 2 in place of fs halves all ranges; a phase f(t) t doubles them."""
    profile = np.random.default_rng(2).exponential(size=256)
    profile[80] += 1e4
    axis_m = 0.1 * np.arange(256)
    for scale, setting in ((0.5, "range_m.scale"), (2.0, "samples.phase")):
        diagnosis = dc.diagnosis.diagnose_map(profile, scale * axis_m, target_range_m=8.0)
        assert [finding.setting for finding in diagnosis.findings] == [setting]


# A Hann window whose ends are zero has sidelobes 31 dB below the echo, on a grid of its length too.
def test_sidelobes_of_a_window_with_zero_ends_are_no_narrow_lobes():
    radar = random_radar(np.random.default_rng(7), sampling="complex")
    n_chirps, n_samples = radar.frame.n_chirps, radar.frame.chirp.n_samples
    chirps, samples = np.arange(n_chirps)[:, None], np.arange(n_samples)
    noise = np.random.default_rng(8).standard_normal((2, n_chirps, n_samples))
    beat = 0.05 * (noise[0] + 1j * noise[1])
    levels = {0.06: 3.0, 0.1: 1.0, 0.15: 0.5, 0.22: 0.2, 0.28: 0.12}
    for cycles_per_sample, level in levels.items():
        beat += level * np.exp(2j * np.pi * cycles_per_sample * samples)
    beat += np.exp(2j * np.pi * (0.1797 * samples + 7 / n_chirps * chirps))
    windowed = beat * np.outer(np.hanning(n_chirps), np.hanning(n_samples))
    power = abs(np.fft.fftshift(np.fft.fft2(windowed, (n_chirps, 2 * n_samples)), axes=0)) ** 2

    diagnosis = dc.diagnosis.diagnose_map(
        power,
        radar.frame.chirp.range_bins_m(2 * n_samples),
        radar.frame.velocity_bins_m_per_s(n_chirps),
        radar=radar,
    )

    assert diagnosis.findings == ()


# Its main lobe is the narrowest of usual windows: on the grid, both neighbours have 0.585 of the
# amplitude of the peak together, those of a Hamming window 0.852.
def test_main_lobes_of_a_taylor_window_are_those_of_a_window():
    n_chirps, n_samples = 100, 300
    chirp, sample = np.arange(n_chirps)[:, None], np.arange(n_samples)
    noise = np.random.default_rng(8).standard_normal((2, n_chirps, n_samples))
    beat = noise[0] + 1j * noise[1]
    for index in range(8):  # near the middles of cells, 40 to 60 dB over the noise of the map
        cell, row = 17.1 + 15 * index, 8.1 + 11 * index
        phase = cell * sample / n_samples + row * chirp / n_chirps
        beat += 3 * 10 ** (-index / 10) * np.exp(2j * np.pi * phase)
    window = np.outer(window_weights("taylor-30", n_chirps), window_weights("taylor-30", n_samples))
    spectrum = np.fft.fft2(beat * window)

    diagnosis = dc.diagnosis.diagnose_map(
        abs(np.fft.fftshift(spectrum, axes=0)) ** 2,
        np.arange(n_samples) * 0.2,
        np.arange(-n_chirps // 2, n_chirps // 2) * 0.1,
    )

    assert "window" not in {finding.setting for finding in diagnosis.findings}


def test_own_simulator_and_maps_carry_no_mistake():
    rng = np.random.default_rng(13)
    radar, foreign = fast_scene(rng)
    targets = [
        dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=1e3)
        for range_m, velocity in zip(foreign.range_m, foreign.velocity_m_per_s, strict=True)
    ]
    hardware = dc.Hardware(transmit_power_w=0.1, antenna_gain=30.0, noise_factor=10.0)
    radar = dc.Radar(frame=radar.frame, array=radar.array, hardware=hardware)
    cube = dc.simulate(dc.Scene(targets=targets), radar, seed=3).isel(frame=0)
    samples = cube.transpose("rx", "chirp", "sample").values
    by_samples = dc.diagnosis.diagnose_samples(samples, radar, **target_of(foreign))
    power = dc.power_map(cube, radar)
    by_map = dc.diagnosis.diagnose_map(
        power.values, power["range"].values, power["velocity"].values, radar=radar, n_summed=1
    )
    assert by_samples.findings == by_map.findings == ()


def test_descending_axes_and_transposed_maps():
    rng = np.random.default_rng(14)
    radar, _, made = random_map(rng)
    arrays = made.power[::-1], made.range_m, made.velocity_m_per_s[::-1]
    assert not dc.diagnosis.diagnose_map(*arrays, radar=radar).findings
    diagnosis = dc.diagnosis.diagnose_map(made.power.T, made.range_m, made.velocity_m_per_s)
    assert [finding.setting for finding in diagnosis.findings] == ["axes"]


def test_exchanged_axes_of_a_square_map_are_told_by_a_known_target():
    axes = 0.5 * np.arange(128), 0.25 * (np.arange(128) - 64)
    hann = np.outer([0.25, 1, 0.25], [0.25, 1, 0.25])  # powers beside the peak of a Hann window
    for seed in range(10):
        rng = np.random.default_rng(seed)
        power = rng.exponential(size=(128, 128))
        row, column = rng.integers(8, 120, 2)
        power[row - 1 : row + 2, column - 1 : column + 2] += 1e4 * hann
        target = {"target_range_m": axes[0][column], "target_velocity_m_per_s": axes[1][row]}
        assert not dc.diagnosis.diagnose_map(power, *axes, **target).findings
        (finding,) = dc.diagnosis.diagnose_map(power.T, *axes, **target).findings
        assert (finding.setting, finding.fix) == ("axes", "transpose the map")


@pytest.mark.parametrize(
    ("make", "seed"), [(exchanged_axes_of_equal_length, 880_017), (exchanged_map, 880_059)]
)
def test_order_of_axes_without_static_echoes_is_listed_and_never_mistaken(make, seed):
    """Either had no note on the axes, or a finding that the exchange explains as well."""
    wrong = make(np.random.default_rng(seed))
    diagnosis = wrong.function(*wrong.arguments, **wrong.options)
    assert diagnosis.findings == ()
    assert "axes" in {note.setting for note in diagnosis.undetermined}


@pytest.mark.parametrize("power", [np.ones((16, 32)), np.eye(16, 32)[:, ::-1]])
def test_maps_without_noise_have_no_mistake(power):
    diagnosis = dc.diagnosis.diagnose_map(power, np.arange(32), np.arange(16) - 8)
    assert diagnosis.findings == ()


@nightly
def test_target_at_a_place_of_chance_is_not_told():
    # 60 equal echoes over 32 x 64 cells: one of them fits one of the mistakes.
    rng = np.random.default_rng(17)
    power = rng.exponential(size=(32, 64))
    power[rng.integers(0, 32, 60), rng.integers(0, 64, 60)] = 1e4
    for n in range(40):
        target = {"target_range_m": rng.uniform(5, 60), "target_velocity_m_per_s": 3.0 + n % 9}
        axes = np.arange(64), np.arange(32) - 16
        assert not dc.diagnosis.diagnose_map(power, *axes, **target).findings


def invalid_calls():
    """Return calls with one wrong argument, and the setting that the error names."""
    case = right_map(np.random.default_rng(15))
    power, range_m, velocity = case.arguments
    power = np.ones_like(power) + np.random.default_rng(16).exponential(size=power.shape)
    radar = case.options["radar"]
    bad = power.copy()
    bad[3, 4] = np.nan
    map_of, samples_of = dc.diagnosis.diagnose_map, dc.diagnosis.diagnose_samples
    threshold_of = dc.diagnosis.diagnose_threshold
    shape = (radar.frame.n_chirps, radar.frame.chirp.n_samples)
    number = 1j if radar.frame.chirp.sampling == "complex" else 1.0
    return {
        "NaN in the map": (lambda: map_of(bad, range_m, velocity), "values"),
        "empty map": (lambda: map_of([], range_m), "values"),
        "zeros": (lambda: map_of(0 * power, range_m, velocity), "values"),
        "silent samples": (lambda: samples_of(0 * number * np.ones(shape), radar), "samples"),
        "negative power": (lambda: map_of(-power, range_m, velocity), "values"),
        "axis of another length": (lambda: map_of(power[:, :-3], range_m, velocity), "values"),
        "map without velocities": (lambda: map_of(power, range_m), "values"),
        "unequal steps": (lambda: map_of(power, range_m**2, velocity), "range_m"),
        "constant axis": (lambda: map_of(power, 0 * range_m, velocity), "range_m"),
        "unknown scale": (lambda: map_of(power, range_m, velocity, scale="dB"), "scale"),
        "no channels": (lambda: map_of(power, range_m, velocity, n_summed=0), "n_summed"),
        "velocity only": (
            lambda: map_of(power, range_m, velocity, target_velocity_m_per_s=1.0),
            "target_range_m",
        ),
        "three dimensions": (lambda: map_of(power[None], range_m, velocity), "values"),
        "text": (lambda: samples_of("beat", radar), "samples"),
        "other chirps": (lambda: samples_of(number * np.ones((7, 40)), radar), "samples"),
        "other sampling": (
            lambda: samples_of(np.ones(shape) * (1.0 if number == 1j else 1j), radar),
            "samples",
        ),
        "infinite": (lambda: samples_of(np.full(shape, np.inf * number), radar), "samples"),
        "other threshold": (lambda: threshold_of(power[1:], power, 4, 1, 1e-4), "threshold"),
        "wide window": (lambda: threshold_of(power, power, 4000, 1, 1e-4), "n_training.velocity"),
        "no training": (lambda: threshold_of(power, power, 0, 1, 1e-4), "n_training"),
        "certain alarm": (lambda: threshold_of(power, power, 4, 1, 1.0), "pfa"),
        "pair for a profile": (
            lambda: threshold_of(power[0], power[0], (1, 4), 1, 1e-4),
            "n_training",
        ),
    }


@pytest.mark.parametrize("name", sorted(invalid_calls()))
def test_invalid_arguments_are_named(name):
    call, setting = invalid_calls()[name]
    with pytest.raises(dc.InvalidSetting) as caught:
        call()
    (mistake,) = caught.value.mistakes
    assert mistake.setting == setting


def test_axis_of_another_length_is_shown_beside_the_size_of_the_map():
    with pytest.raises(dc.InvalidSetting, match=r"\(10,\), for a map of 64 x 256"):
        dc.diagnosis.diagnose_map(np.ones((64, 256)), np.arange(10.0), np.arange(64.0))


def test_order_of_iq_is_not_told_by_levels_that_do_not_fall():
    radar = random_radar(np.random.default_rng(7), sampling="complex")
    shape = radar.frame.n_chirps, radar.frame.chirp.n_samples
    rng = np.random.default_rng(8)
    sample = np.arange(shape[1])
    noise = 0.02 * (rng.standard_normal((2, *shape)).T @ np.array([1, 1j])).T
    level = [0.1, 0.17, 0.26, 0.38, 0.55, 0.63, 0.72, 0.85]
    echoes = sum(np.exp(2j * np.pi * (beat * sample + rng.uniform())) for beat in level)
    for samples in (noise + echoes, noise + echoes.imag + 1j * echoes.real, noise):
        diagnosis = dc.diagnosis.diagnose_samples(samples, radar)
        assert "iq" not in {finding.setting for finding in diagnosis.findings}
        assert "iq" in {note.setting for note in diagnosis.undetermined}


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("share", [0.3, 0.45, 0.55, 0.7, 0.9])
def test_ranges_that_a_wrong_phase_doubles_beyond_the_span_are_aliased(share, sampling):
    """At half of the span, complex samples show the target where a second fftshift puts it."""
    rng = np.random.default_rng(11)
    radar = random_radar(rng, sampling=sampling, n_samples=256)
    scene = random_scene(rng, radar, n_static=0, n_moving=1)
    for exact_share, expected in ((share, "samples.phase"), (0.5, None)):
        scene.range_m[:] = exact_share * radar.frame.chirp.max_range_m
        samples = beat_samples(rng, radar, scene, phase=phase_of_frequency_times_time)
        diagnosis = dc.diagnosis.diagnose_samples(samples, radar, **target_of(scene))
        settings = {finding.setting for finding in diagnosis.findings}
        assert settings <= {"samples.phase"}
        if expected is not None:
            assert settings == {expected}


def test_swapped_parts_show_in_levels_of_echoes_over_the_whole_range():
    """Echoes at 0.05 to 0.85 of the range: of eight, half lie in each half of the spectrum."""
    radar = random_radar(np.random.default_rng(7), sampling="complex")
    shape = radar.frame.n_chirps, radar.frame.chirp.n_samples
    rng = np.random.default_rng(8)
    sample = np.arange(shape[1])
    samples = 0.02 * (rng.standard_normal((2, *shape)).T @ np.array([1, 1j])).T
    for beat in (0.1, 0.17, 0.26, 0.38, 0.55, 0.63, 0.72, 0.85):
        amplitude = rng.uniform(0.6, 1.6) * (0.1 / beat) ** 2
        samples = samples + amplitude * np.exp(2j * np.pi * (beat * sample + rng.uniform()))
    swapped = samples.imag + 1j * samples.real
    assert not dc.diagnosis.diagnose_samples(samples, radar).findings
    findings = dc.diagnosis.diagnose_samples(swapped, radar).findings
    assert [finding.setting for finding in findings] == ["iq"]
