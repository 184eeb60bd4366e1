"""Spectrogram: Doppler velocity over time."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import dechirp as dc
from dechirp.processing.spectrogram import spectrogram
from dechirp.radar.budget import received_power_w
from dechirp.radar.cube import label_cube
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.report.figures.spectrogram import draw_spectrogram
from dechirp.scene.bodies.bicyclist import Bicyclist
from dechirp.scene.bodies.pedestrian import Pedestrian
from dechirp.scene.bodies.points import Points, Rotation, Scatterer
from dechirp.theory.windows import noise_bandwidth_bins, window_weights
from nightly import nightly


@pytest.fixture(scope="module")
def slow_radar(radar):
    """Radar with range bins of 1.9 m, 120 m, 6.5 m/s, one receiver, contiguous frames."""
    chirp = replace(
        radar.frame.chirp, slope_hz_per_s=5e12, sample_rate_hz=4e6, n_samples=64, adc_start_s=3e-6
    )
    frame = dc.Frame(chirp=chirp, n_chirps=256, interval_s=150e-6)
    return replace(radar, frame=frame, array=dc.Array())


def simulate_noise(radar, n_frames=1, seed=5):
    frame, rng = radar.frame, np.random.default_rng(seed)
    shape = (n_frames, frame.n_chirps_total, radar.array.n_rx, frame.chirp.n_samples)
    samples = rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    return label_cube(samples.astype(np.complex64), radar, units="W**0.5")


def build_moving_scene(velocity_m_per_s, **settings):
    return dc.Scene(
        targets=[
            dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), **settings)
        ]
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("range_m", [None, (10, 30)])
@pytest.mark.parametrize("range_window", ["hann", "rectangular"])
def test_steady_echo_peaks_at_its_power(radar, sampling, range_m, range_window):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    for position_m in (20.0, 20.15):  # on a range bin and between two bins
        scene = dc.Scene(
            targets=[dc.Target(position_m=(position_m, 0, 0), velocity_m_per_s=(4, 0, 0))]
        )
        cube = dc.simulate(scene, radar, impairments=())
        power = spectrogram(
            cube, radar, range_m=range_m, range_window=range_window, n_velocity_bins=2048
        )

        assert power.dims == ("time", "velocity")
        assert power.sizes["time"] == 1
        assert power.time.item() == pytest.approx(radar.frame.mid_frame_s, rel=1e-12)
        assert power.isel(time=0).idxmax("velocity").item() == pytest.approx(4.0, abs=0.02)
        echo_w = received_power_w(radar, range_m=power.time.item() * 4 + position_m, rcs_m2=1.0)
        # Sidelobes of the rectangular window beyond the interval: 4 %.
        assert power.max().item() == pytest.approx(float(echo_w), rel=0.04)


@pytest.mark.parametrize("n_bins", [64, 200])
def test_spectrogram_conserves_power(radar, n_bins):
    cube = simulate_noise(radar)
    power = spectrogram(
        cube,
        radar,
        range_m=(0, 1000),
        window="rectangular",
        range_window="rectangular",
        n_window=64,
        hop=64,
        n_velocity_bins=n_bins,
    )

    # Parseval over samples and over the chirps of each window; windows do not overlap.
    mean_w = float(np.mean(abs(cube.values) ** 2))
    assert power.sum("velocity").mean().item() * 64 / n_bins == pytest.approx(mean_w, rel=1e-5)


def test_white_noise_level_follows_window_noise_bandwidth(radar):
    power = spectrogram(
        simulate_noise(radar, n_frames=4),
        radar,
        range_m=(0, 1000),
        window="blackman",
        n_window=64,
        hop=16,
    )
    bandwidth = noise_bandwidth_bins(window_weights("blackman", 64))

    # 4 x 2 x 128 x 256 samples of power 1: 2 % is more than ten standard errors.
    assert power.mean().item() == pytest.approx(bandwidth / 64, rel=0.02)


def test_rotating_point_gives_sinusoidal_velocity(slow_radar):
    rate, radius_m = 2 * np.pi * 4, 0.15
    turn = Rotation(center_m=(0, 0, 0), axis=(0, 0, 1), rate_rad_per_s=rate)
    point = Scatterer(position_m=(radius_m, 0, 0), rcs_m2=1.0, rotation=turn)
    scene = build_moving_scene(1.0, body=Points(scatterers=[point]), heading_rad=0.0)
    cube = dc.simulate(scene, slow_radar, impairments=(), n_frames=10)
    power = spectrogram(cube, slow_radar, n_window=64, hop=16, n_velocity_bins=1024)

    # Curvature of the velocity within a window of 9.6 ms: a tenth of a window bin, 0.2 m/s.
    ridge = power.idxmax("velocity").values
    times_s = power.time.values
    expected = 1.0 - radius_m * rate * np.sin(rate * times_s)
    assert ridge == pytest.approx(expected, abs=0.05)
    assert np.ptp(ridge) / 2 == pytest.approx(radius_m * rate, rel=0.01)


def test_windows_span_contiguous_frames(slow_radar):
    short_radar = replace(slow_radar, frame=replace(slow_radar.frame, n_chirps=64))
    cube = simulate_noise(slow_radar)
    quarters = cube.values.reshape(4, 64, 1, -1)
    short_frames = label_cube(quarters, short_radar, units="W**0.5")

    expected = spectrogram(cube, slow_radar, range_m=(0, 50), n_window=100, hop=30)
    assert expected.sizes["time"] == 6
    power = spectrogram(short_frames, short_radar, range_m=(0, 50), n_window=100, hop=30)
    xr.testing.assert_allclose(power, expected)


def test_frames_with_gaps_are_processed_separately(slow_radar):
    gap_radar = replace(slow_radar, frame=replace(slow_radar.frame, period_s=0.1))
    cube = simulate_noise(gap_radar, n_frames=3)
    power = spectrogram(cube, gap_radar, range_m=(0, 50), n_window=128, hop=64)

    assert power.sizes["time"] == 9
    single_frames = [
        spectrogram(cube.isel(frame=[k]), gap_radar, range_m=(0, 50), n_window=128, hop=64)
        for k in range(3)
    ]
    xr.testing.assert_allclose(xr.concat(single_frames, "time"), power)
    assert np.diff(power.time[::3]) == pytest.approx(np.full(2, 0.1), rel=1e-9)
    with pytest.raises(dc.InvalidSetting, match="n_window: 300; expected .* 2 to 256"):
        spectrogram(cube, gap_radar, n_window=300)


def test_tdm_velocities_are_those_of_one_transmitter(radar):
    frame = replace(radar.frame, multiplexing=Tdm(order=(1, 0)))
    radar = replace(radar, frame=frame, array=replace(radar.array, tx_m=[(0, 0, 0), (0, 0.01, 0)]))
    cube = dc.simulate(build_moving_scene(-5.0), radar, impairments=(), n_frames=2)
    power = spectrogram(cube, radar, n_velocity_bins=1024)

    assert power.sizes["time"] == 5  # a hop is a quarter of a frame
    assert power.idxmax("velocity").values == pytest.approx(np.full(5, -5.0), abs=0.02)
    assert power.time.values[0] == pytest.approx(frame.mid_frame_s, rel=1e-12)
    assert power.max().item() == pytest.approx(
        float(received_power_w(radar, range_m=20.0, rcs_m2=1.0)), rel=0.02
    )


@nightly
def test_pedestrian_shows_walking_speed_and_steps(slow_radar):
    speed = 1.4
    scene = build_moving_scene(speed, body=Pedestrian(speed_m_per_s=speed))
    frequency_hz = np.sqrt(speed / (0.53 * 1.75)) / 1.346
    # Two cycles of the gait, 57 frames.
    n_frames = round(2 / frequency_hz / slow_radar.frame.duration_s)
    cube = dc.simulate(scene, slow_radar, impairments=(), n_frames=n_frames)
    power = spectrogram(
        cube, slow_radar, range_m=(14, 28), n_window=256, hop=64, n_velocity_bins=512
    )

    levels_w, velocity = power.values, power.velocity.values
    centre = levels_w @ velocity / levels_w.sum(axis=1)
    # The power-weighted velocity averages to the walking speed; the trunk varies around it.
    assert centre.mean() == pytest.approx(speed, abs=0.1)
    assert power.mean("time").idxmax("velocity").item() == pytest.approx(speed, abs=0.4)
    # Fastest component: 2 to 4 times the walking speed, one foot every half cycle.
    fastest = np.array([velocity[row > 3e-3 * row.max()].max() for row in levels_w])
    assert 2 * speed < fastest.max() < 4.1 * speed
    harmonics = [
        abs(np.exp(-2j * np.pi * k * frequency_hz * power.time.values) @ fastest)
        for k in range(1, 6)
    ]
    assert np.argmax(harmonics) == 1
    # The foot on the ground is at rest, or slides at up to 0.5 m/s.
    slowest = np.array([velocity[row > 3e-3 * row.max()].min() for row in levels_w])
    assert np.median(slowest) == pytest.approx(0, abs=0.4)


@nightly
def test_bicyclist_shows_wheels_up_to_twice_speed_and_pedals(slow_radar):
    speed = 2.5
    body = Bicyclist(speed_m_per_s=speed, development_m=2.5)
    cube = dc.simulate(
        build_moving_scene(speed, body=body), slow_radar, impairments=(), n_frames=26
    )
    power = spectrogram(
        cube, slow_radar, range_m=(10, 30), n_window=256, hop=128, n_velocity_bins=512
    )

    velocity = power.velocity.values
    mean_w = power.mean("time")
    is_outside = (velocity < -0.2) | (velocity > 2 * speed + 0.2)
    # Bins of 0.05 m/s; the residue consists of velocity and range sidelobes.
    assert mean_w.values[is_outside].sum() < 1e-3 * mean_w.sum().item()
    is_near_top = (velocity > 2 * speed - 0.3) & ~is_outside
    is_near_ground = (velocity < 0.3) & ~is_outside
    assert min(
        mean_w.values[is_near_top].max(), mean_w.values[is_near_ground].max()
    ) > 100 * np.max(mean_w.values[is_outside])
    # Two pedals pass the top per revolution: power at pedal speed occurs twice per revolution.
    pedal_speed = 2 * np.pi * body.cadence_hz * 0.097 * 1.75
    band = (velocity > speed + 0.7 * pedal_speed) & (velocity < speed + 1.05 * pedal_speed)
    pedal_w = power.values[:, band].sum(axis=1)
    harmonics = [
        abs(np.exp(-2j * np.pi * k * body.cadence_hz * power.time.values) @ pedal_w)
        for k in range(1, 6)
    ]
    assert np.argmax(harmonics) == 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"range_m": (200, 300)}, r"range_m: \(200, 300\); .* from 0 to 118"),
        ({"range_m": (30, 10)}, r"range_m: \(30, 10\)"),
        ({"range_m": 20}, "range_m: 20"),
        ({"range_m": (np.nan, 10)}, "range_m: nan"),
        ({"n_window": 1}, "n_window: 1"),
        ({"n_window": 64.5}, "n_window: 64.5"),
        ({"hop": 0}, "hop: 0"),
        ({"n_velocity_bins": 100}, "n_velocity_bins: 100; expected .* from 256"),
        ({"window": "hanner"}, "window: .hanner"),
    ],
)
def test_rejects_invalid_settings(slow_radar, settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        spectrogram(simulate_noise(slow_radar), slow_radar, **settings)


def test_rejects_cube_of_another_radar(slow_radar, radar):
    cube = simulate_noise(slow_radar)
    for invalid_cube, message in (
        (cube.isel(sample=slice(9)), "cube: .*'sample': 9"),
        (cube.isel(frame=0), "cube: .*; expected frames"),
        (cube.isel(frame=slice(0)), "cube: {"),
        (cube.real, "cube: .* of type float32; expected .* complex"),
        (cube * np.nan, "cube: samples that are not finite"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            spectrogram(invalid_cube, slow_radar)


def test_figure_has_units_and_leaves_gaps_empty(slow_radar):
    gap_radar = replace(slow_radar, frame=replace(slow_radar.frame, period_s=0.1))
    for radar, n_images in ((slow_radar, 1), (gap_radar, 3)):
        cube = simulate_noise(radar, n_frames=3)
        power = spectrogram(cube, radar, n_window=64)
        axes = draw_spectrogram(Figure().subplots(), power, fastest_m_per_s=3.0)
        assert axes.get_xlabel() == "Time (s)"
        assert axes.get_ylabel() == "Velocity (m/s, receding positive)"
        assert axes.figure.axes[1].get_ylabel() == "Power (dBm)"
        assert len(axes.images) == n_images
    uncalibrated = spectrogram(cube.assign_attrs(units="1"), radar)
    axes = draw_spectrogram(Figure().subplots(), uncalibrated)
    assert axes.figure.axes[1].get_ylabel() == "Power (dBFS)"


@pytest.mark.parametrize(
    ("changes", "selection", "message"),
    [
        ({"interval_s": (150e-6, 160e-6)}, {"frame": slice(0, None, 2)}, "radar.for_frame\\(0\\)"),
        (
            {"modulation": dc.modulations.Triangular()},
            {"chirp": slice(None, None, 2)},
            "with_rising_ramps_only",
        ),
    ],
)
def test_rejects_mixed_frames_and_suggested_selection_works(
    slow_radar, changes, selection, message
):
    radar = replace(slow_radar, frame=replace(slow_radar.frame, n_chirps=128, **changes))
    cube = dc.simulate(build_moving_scene(2.0, rcs_m2=10), radar, n_frames=4, impairments=())
    with pytest.raises(dc.InvalidSetting, match=message):
        spectrogram(cube, radar)

    uniform_radar = (
        radar.with_rising_ramps_only() if radar.frame.has_falling_ramps else radar.for_frame(0)
    )
    power = spectrogram(cube.isel(selection), uniform_radar, n_velocity_bins=1024)
    # Half a bin of 128 chirps, 0.05 m/s and less.
    assert power.idxmax("velocity").values == pytest.approx(2.0, abs=0.05)
