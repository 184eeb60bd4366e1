"""Phase noise: mask, skirts of echoes, cancellation by delay and rejected masks."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.simulation.echo_groups import SampleWindow, frame_sampling_times
from dechirp.simulation.impairments.phase_noise import PhaseNoise
from nightly import nightly, nightly_except

# A typical 77 GHz synthesiser, flat within the loop bandwidth and falling outside.
MASK = PhaseNoise(
    offset_hz=(1e4, 1e5, 1e6, 3e6, 5e6), level_per_hz=(1e-8, 10**-8.5, 10**-9.2, 1e-11, 10**-11.5)
)


def replace_chirp_count(radar, n_chirps):
    """Return the radar with another number of chirps and one receiver."""
    return replace(
        radar, frame=replace(radar.frame, n_chirps=n_chirps), array=dc.Array(rx_m=[(0, 0, 0)])
    )


def make_static_scene(*ranges_m):
    return dc.Scene(targets=[dc.Target(name=str(r), position_m=(r, 0, 0)) for r in ranges_m])


def estimate_density(samples, rate_hz):
    """Return frequencies and two-sided power density, averaged over chirps with Hann windows."""
    window = np.hanning(samples.shape[-1] + 1)[:-1]
    power = np.mean(abs(np.fft.fft(samples * window)) ** 2, axis=0) / (rate_hz * np.sum(window**2))
    return np.fft.fftfreq(samples.shape[-1], 1 / rate_hz), power


def iterate_third_octaves(offset_hz, lowest_hz, highest_hz):
    """Yield the indices of offsets in each third of an octave that contains some."""
    edges = np.arange(np.log2(lowest_hz), np.log2(highest_hz), 1 / 3)
    for low, high in zip(2 ** edges[:-1], 2 ** edges[1:], strict=True):
        indices = np.flatnonzero((offset_hz >= low) & (offset_hz < high))
        if indices.size:
            yield indices


def test_one_sided_phase_density_is_twice_the_mask():
    rate_hz = 10e6
    window = SampleWindow(0, 0.0, np.zeros(1), 0.0, 2**20, rate_hz)
    phase_rad = MASK.phase_error_rad(window, None, np.random.default_rng(1)).reshape(-1, 2048)

    frequency_hz, power = estimate_density(phase_rad, rate_hz)

    is_included = frequency_hz > 20e3
    for band in iterate_third_octaves(frequency_hz * is_included, 40e3, 4.8e6):
        expected = MASK.interpolate_mask(frequency_hz[band]).mean()
        # At least 512 segments: 0.2 dB. The window widens steep slopes slightly.
        assert to_decibels(power[band].mean() / expected) == pytest.approx(0, abs=0.6)


@pytest.mark.parametrize("range_m", nightly_except(1, [8.0, 30.0, 70.0]))
def test_echo_skirts_follow_mask_and_delay_factor(radar, range_m):
    radar, scene = replace_chirp_count(radar, 1500), make_static_scene(range_m)
    cube = dc.simulate(scene, radar, impairments=[MASK], seed=3).values[0, :, 0]
    clean = dc.simulate(scene, radar, impairments=()).values[0, :, 0]

    frequency_hz, power = estimate_density(cube / clean - 1, radar.frame.chirp.sample_rate_hz)

    delay_s = 2 * range_m / SPEED_OF_LIGHT
    chirp, n_bands = radar.frame.chirp, 0
    for side in (1, -1):
        delay_factor = 4 * np.sin(np.pi * frequency_hz * delay_s) ** 2
        for band in iterate_third_octaves(side * frequency_hz, 120e3, 4.9e6):
            beats_hz = chirp.beat_frequency_hz(range_m) + frequency_hz[band]
            is_passed = beats_hz.min() > 50e3 and beats_hz.max() < chirp.sample_rate_hz - 50e3
            if is_passed and (delay_factor[band] > 0.1).all():
                level = MASK.interpolate_mask(abs(frequency_hz[band]))
                # 1500 chirps have a standard error of 0.11 dB for a single bin.
                over_db = to_decibels(power[band].mean() / np.mean(level * delay_factor[band]))
                assert over_db == pytest.approx(0, abs=0.5)
                n_bands += 1
    assert n_bands >= 5


def passed_band_starts_hz(echo_hz, chirp):
    """Return the lower end of the band that passes for the echo, and for its image of real samples.

    Complex samples pass beats from 0 to the sample rate, real ones up to half of it on either side.
    An echo within a cell of an end moves the band by whole cells, until a whole cell is beside it.
    """
    bin_hz = chirp.sample_rate_hz / chirp.n_samples
    start_hz = 0.0 if chirp.sampling == "complex" else -chirp.sample_rate_hz / 2
    # An echo a whole cell from an end does not move the band: 1e-6 cells for rounding.
    start_hz = min(start_hz, np.floor(echo_hz / bin_hz - 1 + 1e-6) * bin_hz)
    highest_hz = np.ceil(echo_hz / bin_hz + 1 - 1e-6) * bin_hz
    start_hz = max(start_hz, highest_hz - chirp.sample_rate_hz)
    return start_hz, -start_hz - chirp.sample_rate_hz


def expected_periodogram(skirt_per_hz, start_hz, chirp, n_fine=32):
    """Integrate a density over the passed band, weighted by the Hann window about each cell."""
    n, bin_hz = chirp.n_samples, chirp.sample_rate_hz / chirp.n_samples
    window = np.hanning(n + 1)[:-1]
    power = np.zeros(n)
    for fraction in (np.arange(n_fine) + 0.5) / n_fine:
        bins = start_hz / bin_hz + fraction + np.arange(n)
        shift = bins[0] % 1
        lobe = abs(np.fft.fft(window * np.exp(2j * np.pi * shift * np.arange(n) / n))) ** 2
        density = np.roll(skirt_per_hz(bins * bin_hz), round(bins[0] - shift))
        power += np.fft.ifft(np.fft.fft(lobe) * np.fft.fft(density)).real
    return power / (n_fine * n * np.sum(window**2))


def whole_map_skirts(scene, radar, mask):
    """Return the noise of an echo at each beat frequency over its power in 1 Hz, and theory."""
    # Rounding of single precision is above the weakest skirts.
    cube, clean = (
        dc.simulate(scene, radar, impairments=stages, seed=3, dtype=np.complex128).values[0, :, 0]
        for stages in ([mask], [])
    )
    chirp = radar.frame.chirp
    n, rate_hz = chirp.n_samples, chirp.sample_rate_hz
    window = np.hanning(n + 1)[:-1]
    window /= np.sqrt(rate_hz * np.sum(window**2) * np.mean(abs(clean) ** 2))
    measured = np.mean(abs(np.fft.fft((cube - clean) * window)) ** 2, axis=0)
    echo_hz = chirp.beat_frequency_hz(scene.targets[0].position_m[0])
    delay_s = echo_hz / chirp.slope_hz_per_s
    images_hz = (echo_hz,) if chirp.sampling == "complex" else (echo_hz, -echo_hz)
    theory = np.zeros(n)
    for image_hz, start_hz in zip(images_hz, passed_band_starts_hz(echo_hz, chirp), strict=False):

        def skirt_per_hz(beat_hz, image_hz=image_hz):
            offset_hz = abs(beat_hz - image_hz)
            delay_factor = 4 * np.sin(np.pi * offset_hz * delay_s) ** 2
            return delay_factor * mask.interpolate_mask(np.maximum(offset_hz, 1.0))

        theory += expected_periodogram(skirt_per_hz, start_hz, chirp) / len(images_hz)
    n_cells = len(chirp.range_bins_m())
    return measured[:n_cells], theory[:n_cells]


def cells_apart_from_echo(echo_cell, n_cells, n_apart=2.5):
    """Return whether each cell is apart from the echo, around the ends of the map."""
    distance = np.arange(n_cells) - echo_cell
    return abs((distance + n_cells / 2) % n_cells - n_cells / 2) > n_apart


def make_whole_map_radar(sampling, n_chirps=2000):
    """Return a radar with cells of 0.59 m."""
    chirp = dc.Chirp(
        start_frequency_hz=76.5e9, slope_hz_per_s=20e12, adc_start_s=2e-6, ramp_duration_s=16e-6,
        sample_rate_hz=20e6, n_samples=256, sampling=sampling,
    )  # fmt: skip
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=n_chirps, interval_s=20e-6),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=100.0, noise_factor=16.0),
    )


# 0.59 m in a cell: 256 cells for complex samples, 128 for real ones.
@pytest.mark.parametrize(
    ("sampling", "cell"),
    nightly_except(
        1,
        [
            ("complex", 253.6),
            ("real", 103),
            ("complex", 255.6),
            ("complex", 34.2),
            ("complex", 5.0),
            ("complex", 0.5),
            ("complex", 1.7),
            ("complex", 128),
            ("complex", 222),
            ("complex", 243),
            ("complex", 247.6),
            ("complex", 250.3),
            ("complex", 254.8),
            ("complex", 255.0),
            ("complex", 255.9),
            ("real", 5.0),
            ("real", 124),
            ("real", 126.5),
        ],
    ),
)
def test_skirt_follows_theory_in_every_cell(sampling, cell):
    # Quiet oscillators: products of the noise with itself are 60 dB below it.
    masks = (
        PhaseNoise(
            offset_hz=(1e5, 1e6, 1e7, 1e8),
            level_per_hz=(10**-9.5, 10**-11.5, 10**-13.5, 10**-15.5),
        ),
        PhaseNoise(
            offset_hz=(1e5, 5e5, 1e6, 2e6, 1e7, 1e8),
            level_per_hz=(1e-14, 1e-13, 1e-15, 1e-17, 1e-19, 1e-20),
        ),
    )
    radar = make_whole_map_radar(sampling, n_chirps=4000)
    range_m = cell * float(radar.frame.chirp.range_bins_m()[1])
    for mask in masks:
        measured, theory = whole_map_skirts(make_static_scene(range_m), radar, mask)

        excess_db = to_decibels(measured / theory)
        # 4000 chirps have a standard error of 0.07 dB; steep noise beside an echo is up to 0.2 dB
        # off at the ends of the band.
        assert abs(excess_db[cells_apart_from_echo(cell, len(excess_db))]).max() < 0.5


@nightly
@pytest.mark.parametrize("range_m", [75, 130])
def test_single_cells_of_steep_skirt_scatter_by_number_of_chirps_alone(range_m):
    # 40 to 50 dB a decade from 100 kHz on.
    mask = PhaseNoise(
        offset_hz=(1e4, 1e5, 1e6, 1e7, 1e8), level_per_hz=(1e-6, 1e-8, 1e-12, 1e-17, 1e-22)
    )
    radar = make_whole_map_radar("complex")

    measured, theory = whole_map_skirts(make_static_scene(range_m), radar, mask)

    excess_db = to_decibels(measured / theory)
    echo_cell = radar.frame.chirp.beat_frequency_hz(range_m) / 20e6 * 256
    excess_db = excess_db[cells_apart_from_echo(echo_cell, 256, n_apart=3.5)]
    # Means of 2000 exponentials scatter by 1 / sqrt(2000), 0.097 dB; neighbours are correlated,
    # so of 245 cells 160 are independent: 6 % of the standard deviation, 0.008 dB of the mean.
    assert excess_db.std() == pytest.approx(0.097, rel=0.3)
    assert abs(excess_db.mean()) < 0.04
    assert abs(excess_db).max() < 0.6


def test_skirts_of_two_targets_follow_their_own_delays(radar):
    # The near target is 40 dB stronger: its skirt dominates.
    radar, scene = replace_chirp_count(radar, 1500), make_static_scene(6.0, 60.0)
    cube = dc.simulate(scene, radar, impairments=[MASK], seed=3).values[0, :, 0]
    clean = dc.simulate(scene, radar, impairments=()).values[0, :, 0]
    near_echo = dc.simulate(make_static_scene(6.0), radar, impairments=()).values[0, :, 0]

    frequency_hz, power = estimate_density(
        (cube - clean) / near_echo, radar.frame.chirp.sample_rate_hz
    )

    delay_factor = 4 * np.sin(np.pi * frequency_hz * 12 / SPEED_OF_LIGHT) ** 2
    # Below the near echo, 0.8 MHz is the end of the passed band.
    for band in iterate_third_octaves(frequency_hz, 1.3e6, 4.9e6):
        level = MASK.interpolate_mask(abs(frequency_hz[band]))
        over_db = to_decibels(power[band].mean() / np.mean(level * delay_factor[band]))
        assert over_db == pytest.approx(0, abs=0.5)


def test_receivers_and_targets_share_one_phase_noise_process(radar):
    # Receivers are half a wavelength apart; targets are at one range in two directions.
    scene = dc.Scene(
        targets=[
            dc.Target(name="left", position_m=(30, 3, 0)),
            dc.Target(name="right", position_m=(30, -3, 0)),
        ]
    )
    cube = dc.simulate(scene, radar, impairments=[MASK], seed=5, dtype=np.complex128).values
    clean = dc.simulate(scene, radar, impairments=(), dtype=np.complex128).values

    first, second = np.moveaxis(cube / clean, 2, 0)

    # Delays differ by picoseconds.
    assert abs(first - 1).max() > 1e-3
    np.testing.assert_allclose(first, second, atol=1e-4 * abs(first - 1).max())


def test_phase_noise_is_continuous_between_chirps(radar):
    frame = radar.frame
    pause = round((frame.interval_s - frame.chirp.adc_start_s) * frame.chirp.sample_rate_hz)
    extended_window = frame_sampling_times(radar, 0).widen(0, pause)

    phase_rad = MASK.phase_error_rad(extended_window, radar, np.random.default_rng(0))

    step = round(frame.interval_s * frame.chirp.sample_rate_hz)
    n_shared = extended_window.n_times - step
    assert n_shared > 0
    np.testing.assert_array_equal(phase_rad[:-1, step:], phase_rad[1:, :n_shared])


def test_phase_noise_is_independent_between_frames(radar):
    cube = dc.simulate(
        make_static_scene(30.0), radar, impairments=[MASK], n_frames=2, seed=1
    ).values[:, :, 0]
    clean = dc.simulate(make_static_scene(30.0), radar, impairments=(), n_frames=2).values[:, :, 0]

    first, second = (cube / clean - 1).reshape(2, -1)

    correlation = abs(np.vdot(first, second)) / np.linalg.norm(first) / np.linalg.norm(second)
    assert correlation < 0.02


def test_low_offset_noise_cancels_in_echo(radar):
    # 0.1 rad within 10 kHz; a delay of 0.3 us reduces it to at most 2e-3 of that.
    low_offset_noise = PhaseNoise(offset_hz=(1e3, 1e4, 1e5), level_per_hz=(1e-6, 1e-6, 1e-12))
    delay_s = 90 / SPEED_OF_LIGHT
    window = SampleWindow(0, 0.0, np.zeros(1), 0.0, 2**16, 10e6)
    total_rad = low_offset_noise.phase_error_rad(window, radar, np.random.default_rng(0)).std()

    cube = dc.simulate(
        make_static_scene(45.0),
        replace_chirp_count(radar, 512),
        impairments=[low_offset_noise],
        dtype=np.complex128,
    )
    clean = dc.simulate(
        make_static_scene(45.0),
        replace_chirp_count(radar, 512),
        impairments=(),
        dtype=np.complex128,
    )

    residual_rad = float(abs(cube / clean - 1).values.std())
    assert total_rad > 0.1
    assert residual_rad < 0.01
    measured_rad = float(np.sqrt(np.mean(abs(cube / clean - 1).values ** 2)))
    assert measured_rad == pytest.approx(low_offset_noise.residual_rms_rad(delay_s, 5e6), rel=0.1)


def test_phase_noise_cancels_in_leakage(radar):
    # A range of 3 cm, 0.2 ns, reduces noise at 5 MHz to 6e-3.
    leakage = dc.simulate(make_static_scene(0.03), radar, impairments=[MASK], dtype=np.complex128)
    clean = dc.simulate(make_static_scene(0.03), radar, impairments=(), dtype=np.complex128)

    residual_db = to_decibels(float(np.mean(abs(leakage / clean - 1).values ** 2)))
    far_rad = MASK.residual_rms_rad(60 / SPEED_OF_LIGHT, 5e6)
    assert residual_db < 2 * to_decibels(far_rad) - 40


def test_mask_is_linear_in_decibels_over_log_frequency():
    mask = PhaseNoise(offset_hz=(1e5, 1e7), level_per_hz=(1e-8, 1e-12))

    levels = mask.interpolate_mask(np.array([1e3, 1e5, 1e6, 1e7, 1e9]))

    np.testing.assert_allclose(levels, [1e-8, 1e-8, 1e-10, 1e-12, 1e-12])


@pytest.mark.parametrize(
    ("field", "invalid_value", "message"),
    [
        ("offset_hz", (1e6, 1e5), r"offset_hz.1: 100 kHz, after 1 MHz"),
        ("offset_hz", (1e5, 1e5), r"offset_hz.1: 100 kHz, after"),
        ("offset_hz", (0.0, 1e5), r"offset_hz.0"),
        ("offset_hz", (1e5, np.nan), r"offset_hz.1"),
        ("offset_hz", (), r"offset_hz"),
        ("offset_hz", (1e5,), r"level_per_hz: 2 levels; expected 1"),
        ("level_per_hz", (1e-8, np.nan), r"level_per_hz.1"),
        ("level_per_hz", (-80.0, -90.0), r"level_per_hz.0"),
        ("level_per_hz", (1e8, 1e9), r"level_per_hz.0"),
        ("level_per_hz", 1e-8, r"level_per_hz"),
    ],
)
def test_rejects_invalid_mask(field, invalid_value, message):
    settings = {"offset_hz": (1e5, 1e6), "level_per_hz": (1e-8, 1e-10), field: invalid_value}
    with pytest.raises(InvalidSetting, match=message):
        PhaseNoise(**settings)


def test_warns_of_mask_above_sample_bandwidth(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"phase-noise.offset: from 20 MHz on"):
        PhaseNoise(offset_hz=(2e7,), level_per_hz=(1e-12,)).check(make_static_scene(30.0), radar)


def test_warns_of_phase_noise_that_destroys_echo(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"phase-noise.level: phase noise of .* rad rms"):
        PhaseNoise(offset_hz=(1e6,), level_per_hz=(1e-6,)).check(make_static_scene(30.0), radar)
