"""Phase noise: its mask, its skirts on echoes, and what the delay takes away."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.simulation.echo_groups import SampleWindow, sample_window
from dechirp.simulation.impairments.phase_noise import PhaseNoise

# As of a 77 GHz synthesiser, flat in the loop and falling outside it.
MASK = PhaseNoise(
    offset_hz=(1e4, 1e5, 1e6, 3e6, 5e6), level_per_hz=(1e-8, 10**-8.5, 10**-9.2, 1e-11, 10**-11.5)
)


def many(radar, n_chirps):
    """The same radar with so many chirps and one receiver."""
    return replace(
        radar, frame=replace(radar.frame, n_chirps=n_chirps), array=dc.Array(rx_m=[(0, 0, 0)])
    )


def still(*ranges_m):
    return dc.Scene(targets=[dc.Target(name=str(r), position_m=(r, 0, 0)) for r in ranges_m])


def density(samples, rate_hz):
    """Frequencies and two-sided power density, averaged over chirps, from Hann windows."""
    taper = np.hanning(samples.shape[-1] + 1)[:-1]
    power = np.mean(abs(np.fft.fft(samples * taper)) ** 2, axis=0) / (rate_hz * np.sum(taper**2))
    return np.fft.fftfreq(samples.shape[-1], 1 / rate_hz), power


def third_octaves(offset_hz, lowest_hz, highest_hz):
    """Places of the offsets within each third of an octave that has some."""
    edges = np.arange(np.log2(lowest_hz), np.log2(highest_hz), 1 / 3)
    for low, high in zip(2 ** edges[:-1], 2 ** edges[1:], strict=True):
        inside = np.flatnonzero((offset_hz >= low) & (offset_hz < high))
        if inside.size:
            yield inside


def test_the_phase_has_twice_the_mask_as_its_one_sided_density():
    rate_hz = 10e6
    long = SampleWindow(0, 0.0, np.zeros(1), 0.0, 2**20, rate_hz)
    phase_rad = MASK.phase_error_rad(long, None, np.random.default_rng(1)).reshape(-1, 2048)

    frequency_hz, power = density(phase_rad, rate_hz)

    kept = frequency_hz > 20e3
    for band in third_octaves(frequency_hz * kept, 40e3, 4.8e6):
        expected = MASK.interpolate_mask(frequency_hz[band]).mean()
        # 512 pieces and more: 0.2 dB. The window widens what falls steeply a little.
        assert to_decibels(power[band].mean() / expected) == pytest.approx(0, abs=0.6)


@pytest.mark.parametrize("range_m", [8.0, 30.0, 70.0])
def test_skirts_are_the_mask_times_what_the_delay_leaves(radar, range_m):
    radar, scene = many(radar, 1500), still(range_m)
    cube = dc.simulate(scene, radar, impairments=[MASK], seed=3).values[0, :, 0]
    clean = dc.simulate(scene, radar, impairments=()).values[0, :, 0]

    frequency_hz, power = density(cube / clean - 1, radar.frame.chirp.sample_rate_hz)

    delay_s = 2 * range_m / SPEED_OF_LIGHT
    compared = 0
    for side in (1, -1):
        left = 4 * np.sin(np.pi * frequency_hz * delay_s) ** 2
        for band in third_octaves(side * frequency_hz, 120e3, 4.9e6):
            if (left[band] > 0.1).all():
                level = MASK.interpolate_mask(abs(frequency_hz[band]))
                # 1500 chirps: 0.11 dB for a single bin.
                over_db = to_decibels(power[band].mean() / np.mean(level * left[band]))
                assert over_db == pytest.approx(0, abs=0.5)
                compared += 1
    assert compared >= 6


def test_two_targets_have_skirts_of_their_own_delays(radar):
    # The near one is 40 dB stronger: its skirt is what is seen beside it.
    radar, scene = many(radar, 1500), still(6.0, 60.0)
    cube = dc.simulate(scene, radar, impairments=[MASK], seed=3).values[0, :, 0]
    clean = dc.simulate(scene, radar, impairments=()).values[0, :, 0]
    alone = dc.simulate(still(6.0), radar, impairments=()).values[0, :, 0]

    frequency_hz, power = density((cube - clean) / alone, radar.frame.chirp.sample_rate_hz)

    left = 4 * np.sin(np.pi * frequency_hz * 12 / SPEED_OF_LIGHT) ** 2
    for side in (1, -1):
        for band in third_octaves(side * frequency_hz, 1.3e6, 4.9e6):
            level = MASK.interpolate_mask(abs(frequency_hz[band]))
            over_db = to_decibels(power[band].mean() / np.mean(level * left[band]))
            assert over_db == pytest.approx(0, abs=0.5)


def test_receivers_and_targets_share_one_process(radar):
    # Half a wavelength apart; the targets at one range in two directions.
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


def test_the_process_goes_on_from_chirp_to_chirp(radar):
    frame = radar.frame
    pause = round((frame.interval_s - frame.chirp.adc_start_s) * frame.chirp.sample_rate_hz)
    longer = sample_window(radar, 0).widen(0, pause)

    phase_rad = MASK.phase_error_rad(longer, radar, np.random.default_rng(0))

    step = round(frame.interval_s * frame.chirp.sample_rate_hz)
    shared = longer.n_times - step
    assert shared > 0
    np.testing.assert_array_equal(phase_rad[:-1, step:], phase_rad[1:, :shared])


def test_frames_have_noise_of_their_own(radar):
    cube = dc.simulate(still(30.0), radar, impairments=[MASK], n_frames=2, seed=1).values[:, :, 0]
    clean = dc.simulate(still(30.0), radar, impairments=(), n_frames=2).values[:, :, 0]

    first, second = (cube / clean - 1).reshape(2, -1)

    alike = abs(np.vdot(first, second)) / np.linalg.norm(first) / np.linalg.norm(second)
    assert alike < 0.02


def test_slow_noise_cancels(radar):
    # 0.1 rad within 10 kHz, of which 0.3 us leave 2e-3 of it at the most.
    slow = PhaseNoise(offset_hz=(1e3, 1e4, 1e5), level_per_hz=(1e-6, 1e-6, 1e-12))
    delay_s = 90 / SPEED_OF_LIGHT
    long = SampleWindow(0, 0.0, np.zeros(1), 0.0, 2**16, 10e6)
    whole_rad = slow.phase_error_rad(long, radar, np.random.default_rng(0)).std()

    cube = dc.simulate(still(45.0), many(radar, 512), impairments=[slow], dtype=np.complex128)
    clean = dc.simulate(still(45.0), many(radar, 512), impairments=(), dtype=np.complex128)

    left_rad = float(abs(cube / clean - 1).values.std())
    assert whole_rad > 0.1
    assert left_rad < 0.01
    measured_rad = float(np.sqrt(np.mean(abs(cube / clean - 1).values ** 2)))
    assert measured_rad == pytest.approx(slow.residual_rms_rad(delay_s, 5e6), rel=0.1)


def test_leakage_keeps_no_noise(radar):
    # 3 cm: 0.2 ns leave 6e-3 of what is at 5 MHz.
    near = dc.simulate(still(0.03), radar, impairments=[MASK], dtype=np.complex128)
    clean = dc.simulate(still(0.03), radar, impairments=(), dtype=np.complex128)

    left_db = to_decibels(float(np.mean(abs(near / clean - 1).values ** 2)))
    far_rad = MASK.residual_rms_rad(60 / SPEED_OF_LIGHT, 5e6)
    assert left_db < 2 * to_decibels(far_rad) - 40


def test_levels_lie_on_straight_lines_of_decibels_over_log_frequency():
    mask = PhaseNoise(offset_hz=(1e5, 1e7), level_per_hz=(1e-8, 1e-12))

    levels = mask.interpolate_mask(np.array([1e3, 1e5, 1e6, 1e7, 1e9]))

    np.testing.assert_allclose(levels, [1e-8, 1e-8, 1e-10, 1e-12, 1e-12])


@pytest.mark.parametrize(
    ("field", "wrong", "message"),
    [
        ("offset_hz", (1e6, 1e5), r"offset_hz.1: 100000 Hz, after 1e\+06 Hz"),
        ("offset_hz", (1e5, 1e5), r"offset_hz.1: 100000 Hz, after"),
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
def test_what_is_no_mask_is_refused(field, wrong, message):
    given = {"offset_hz": (1e5, 1e6), "level_per_hz": (1e-8, 1e-10), field: wrong}
    with pytest.raises(InvalidSetting, match=message):
        PhaseNoise(**given)


def test_a_mask_beyond_the_samples_warns(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"phase-noise.offset: from 2e\+07 Hz on"):
        PhaseNoise(offset_hz=(2e7,), level_per_hz=(1e-12,)).check(still(30.0), radar)


def test_noise_that_leaves_no_echo_warns(radar):
    with pytest.warns(dc.PhysicsWarning, match=r"phase-noise.level: phase noise of .* rad rms"):
        PhaseNoise(offset_hz=(1e6,), level_per_hz=(1e-6,)).check(still(30.0), radar)
