"""Velocity over time."""

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


@pytest.fixture(scope="module")
def slow(radar):
    """1.9 m a range bin, 120 m, velocities up to 6.5 m/s, one receiver, frames without gaps."""
    chirp = replace(
        radar.frame.chirp, slope_hz_per_s=5e12, sample_rate_hz=4e6, n_samples=64, adc_start_s=3e-6
    )
    frame = dc.Frame(chirp=chirp, n_chirps=256, interval_s=150e-6)
    return replace(radar, frame=frame, array=dc.Array())


def noise(radar, n_frames=1, seed=5):
    frame, rng = radar.frame, np.random.default_rng(seed)
    shape = (n_frames, frame.n_chirps_total, radar.array.n_rx, frame.chirp.n_samples)
    samples = rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    return label_cube(samples.astype(np.complex64), radar, units="sqrt(W)")


def going(velocity_m_per_s, **of):
    return dc.Scene(
        targets=[dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0), **of)]
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("range_m", [None, (10, 30)])
@pytest.mark.parametrize("range_window", ["hann", "rectangular"])
def test_a_steady_echo_peaks_at_its_power_wherever_it_is(radar, sampling, range_m, range_window):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    for at_m in (20.0, 20.15):  # on a range row and between two
        scene = dc.Scene(targets=[dc.Target(position_m=(at_m, 0, 0), velocity_m_per_s=(4, 0, 0))])
        cube = dc.simulate(scene, radar, impairments=())
        found = spectrogram(
            cube, radar, range_m=range_m, range_window=range_window, n_velocity_bins=2048
        )

        assert found.dims == ("time", "velocity")
        assert found.sizes["time"] == 1
        assert found.time.item() == pytest.approx(radar.frame.mid_frame_s, rel=1e-12)
        assert found.isel(time=0).idxmax("velocity").item() == pytest.approx(4.0, abs=0.02)
        echo_w = received_power_w(radar, range_m=found.time.item() * 4 + at_m, rcs_m2=1.0)
        # Sidelobes of the rectangular window beyond the interval: 4 %.
        assert found.max().item() == pytest.approx(float(echo_w), rel=0.04)


@pytest.mark.parametrize("n_bins", [64, 200])
def test_power_is_conserved(radar, n_bins):
    cube = noise(radar)
    found = spectrogram(
        cube,
        radar,
        range_m=(0, 1000),
        window="rectangular",
        range_window="rectangular",
        n_window=64,
        hop=64,
        n_velocity_bins=n_bins,
    )

    # Parseval over samples and over the chirps of each window, which are apart.
    mean_w = float(np.mean(abs(cube.values) ** 2))
    assert found.sum("velocity").mean().item() * 64 / n_bins == pytest.approx(mean_w, rel=1e-5)


def test_white_noise_has_the_noise_bandwidth_of_the_windows(radar):
    found = spectrogram(
        noise(radar, n_frames=4),
        radar,
        range_m=(0, 1000),
        window="blackman",
        n_window=64,
        hop=16,
    )
    bandwidth = noise_bandwidth_bins(window_weights("blackman", 64))

    # 4 x 2 x 128 x 256 samples of power 1: 2 % are ten standard errors and more.
    assert found.mean().item() == pytest.approx(bandwidth / 64, rel=0.02)


def test_a_point_that_turns_draws_a_sine(slow):
    rate, radius_m = 2 * np.pi * 4, 0.15
    turn = Rotation(center_m=(0, 0, 0), axis=(0, 0, 1), rate_rad_per_s=rate)
    point = Scatterer(position_m=(radius_m, 0, 0), rcs_m2=1.0, rotation=turn)
    scene = going(1.0, body=Points(scatterers=[point]), heading_rad=0.0)
    cube = dc.simulate(scene, slow, impairments=(), n_frames=10)
    found = spectrogram(cube, slow, n_window=64, hop=16, n_velocity_bins=1024)

    # Within a window of 9.6 ms the velocity curves by a tenth of a bin of the window, 0.2 m/s.
    ridge = found.idxmax("velocity").values
    times_s = found.time.values
    expected = 1.0 - radius_m * rate * np.sin(rate * times_s)
    assert ridge == pytest.approx(expected, abs=0.05)
    assert np.ptp(ridge) / 2 == pytest.approx(radius_m * rate, rel=0.01)


def test_windows_reach_across_frames_that_follow_without_a_gap(slow):
    short = replace(slow, frame=replace(slow.frame, n_chirps=64))
    cube = noise(slow)
    quarters = cube.values.reshape(4, 64, 1, -1)
    parted = label_cube(quarters, short, units="sqrt(W)")

    whole = spectrogram(cube, slow, range_m=(0, 50), n_window=100, hop=30)
    assert whole.sizes["time"] == 6
    found = spectrogram(parted, short, range_m=(0, 50), n_window=100, hop=30)
    xr.testing.assert_allclose(found, whole)


def test_frames_with_gaps_stand_side_by_side(slow):
    apart = replace(slow, frame=replace(slow.frame, period_s=0.1))
    cube = noise(apart, n_frames=3)
    found = spectrogram(cube, apart, range_m=(0, 50), n_window=128, hop=64)

    assert found.sizes["time"] == 9
    alone = [
        spectrogram(cube.isel(frame=[k]), apart, range_m=(0, 50), n_window=128, hop=64)
        for k in range(3)
    ]
    xr.testing.assert_allclose(xr.concat(alone, "time"), found)
    assert np.diff(found.time[::3]) == pytest.approx(np.full(2, 0.1), rel=1e-9)
    with pytest.raises(dc.InvalidSetting, match="n_window: 300; expected .* 2 to 256"):
        spectrogram(cube, apart, n_window=300)


def test_velocities_are_those_of_one_transmitter(radar):
    frame = replace(radar.frame, multiplexing=Tdm(order=(1, 0)))
    radar = replace(radar, frame=frame, array=replace(radar.array, tx_m=[(0, 0, 0), (0, 0.01, 0)]))
    cube = dc.simulate(going(-5.0), radar, impairments=(), n_frames=2)
    found = spectrogram(cube, radar, n_velocity_bins=1024)

    assert found.sizes["time"] == 5  # a hop is a quarter of a frame
    assert found.idxmax("velocity").values == pytest.approx(np.full(5, -5.0), abs=0.02)
    assert found.time.values[0] == pytest.approx(frame.mid_frame_s, rel=1e-12)
    assert found.max().item() == pytest.approx(
        float(received_power_w(radar, range_m=20.0, rcs_m2=1.0)), rel=0.02
    )


def test_a_pedestrian_draws_the_walking_speed_and_the_steps(slow):
    speed = 1.4
    scene = going(speed, body=Pedestrian(speed_m_per_s=speed))
    frequency_hz = np.sqrt(speed / (0.53 * 1.75)) / 1.346
    # Two cycles of the gait, 57 frames.
    n_frames = round(2 / frequency_hz / slow.frame.duration_s)
    cube = dc.simulate(scene, slow, impairments=(), n_frames=n_frames)
    found = spectrogram(cube, slow, range_m=(14, 28), n_window=256, hop=64, n_velocity_bins=512)

    levels_w, velocity = found.values, found.velocity.values
    centre = levels_w @ velocity / levels_w.sum(axis=1)
    # All parts together go at the walking speed in the mean over cycles, the trunk about it.
    assert centre.mean() == pytest.approx(speed, abs=0.1)
    assert found.mean("time").idxmax("velocity").item() == pytest.approx(speed, abs=0.4)
    # The fastest line, 2 to 4 times that: a foot every half cycle.
    fastest = np.array([velocity[row > 3e-3 * row.max()].max() for row in levels_w])
    assert 2 * speed < fastest.max() < 4.1 * speed
    steps = [
        abs(np.exp(-2j * np.pi * k * frequency_hz * found.time.values) @ fastest)
        for k in range(1, 6)
    ]
    assert np.argmax(steps) == 1
    # The foot on the ground stands, or slides by half a metre a second.
    slowest = np.array([velocity[row > 3e-3 * row.max()].min() for row in levels_w])
    assert np.median(slowest) == pytest.approx(0, abs=0.4)


def test_a_bicyclist_draws_wheels_up_to_twice_the_speed_and_pedals_about_it(slow):
    speed = 2.5
    body = Bicyclist(speed_m_per_s=speed, development_m=2.5)
    cube = dc.simulate(going(speed, body=body), slow, impairments=(), n_frames=26)
    found = spectrogram(cube, slow, range_m=(10, 30), n_window=256, hop=128, n_velocity_bins=512)

    velocity = found.velocity.values
    mean_w = found.mean("time")
    outside = (velocity < -0.2) | (velocity > 2 * speed + 0.2)
    # A window has 0.05 m/s a bin; what is left are its sidelobes and those of the range.
    assert mean_w.values[outside].sum() < 1e-3 * mean_w.sum().item()
    near_top = (velocity > 2 * speed - 0.3) & ~outside
    near_ground = (velocity < 0.3) & ~outside
    assert min(mean_w.values[near_top].max(), mean_w.values[near_ground].max()) > 100 * np.max(
        mean_w.values[outside]
    )
    # Both pedals pass the top in a turn: the power a foot's speed above comes twice a turn.
    foot = 2 * np.pi * body.cadence_hz * 0.097 * 1.75
    band = (velocity > speed + 0.7 * foot) & (velocity < speed + 1.05 * foot)
    comes_w = found.values[:, band].sum(axis=1)
    turns = [
        abs(np.exp(-2j * np.pi * k * body.cadence_hz * found.time.values) @ comes_w)
        for k in range(1, 6)
    ]
    assert np.argmax(turns) == 1


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"range_m": (200, 300)}, r"range_m: \(200, 300\); .* from 0 to 118"),
        ({"range_m": (30, 10)}, r"range_m: \(30, 10\)"),
        ({"range_m": 20}, "range_m: 20"),
        ({"range_m": (np.nan, 10)}, "range_m: nan"),
        ({"n_window": 1}, "n_window: 1"),
        ({"n_window": 64.5}, "n_window: 64.5"),
        ({"hop": 0}, "hop: 0"),
        ({"n_velocity_bins": 100}, "n_velocity_bins: 100; expected .* from 256"),
        ({"window": "han"}, "window: han"),
    ],
)
def test_what_does_not_fit_is_refused(slow, asked, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        spectrogram(noise(slow), slow, **asked)


def test_a_cube_of_another_radar_is_refused(slow, radar):
    cube = noise(slow)
    for wrong, message in (
        (cube.isel(sample=slice(9)), "cube: .*'sample': 9"),
        (cube.isel(frame=0), "cube: .*; expected frames"),
        (cube.isel(frame=slice(0)), "cube: {"),
        (cube.real, "cube: .* of type float32; expected .* complex"),
        (cube * np.nan, "cube: samples that are not finite"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            spectrogram(wrong, slow)


def test_a_figure_has_units_and_leaves_gaps_empty(slow):
    apart = replace(slow, frame=replace(slow.frame, period_s=0.1))
    for radar, n_images in ((slow, 1), (apart, 3)):
        cube = noise(radar, n_frames=3)
        power = spectrogram(cube, radar, n_window=64)
        axes = draw_spectrogram(Figure().subplots(), power, fastest_m_per_s=3.0)
        assert axes.get_xlabel() == "Time (s)"
        assert axes.get_ylabel() == "Velocity (m/s)"
        assert axes.figure.axes[1].get_ylabel() == "Power (dBm)"
        assert len(axes.images) == n_images
    uncalibrated = spectrogram(cube.assign_attrs(units="full scale"), radar)
    axes = draw_spectrogram(Figure().subplots(), uncalibrated)
    assert axes.figure.axes[1].get_ylabel() == "Power (dBFS)"


@pytest.mark.parametrize(
    ("changes", "chosen", "says"),
    [
        ({"interval_s": (150e-6, 160e-6)}, {"frame": slice(0, None, 2)}, "radar.for_frame\\(0\\)"),
        (
            {"modulation": dc.modulations.Triangular()},
            {"chirp": slice(None, None, 2)},
            "with_rising_ramps_only",
        ),
    ],
)
def test_one_kind_of_frames_and_ramps_is_asked_for_and_what_is_said_to_do_does(
    slow, changes, chosen, says
):
    radar = replace(slow, frame=replace(slow.frame, n_chirps=128, **changes))
    cube = dc.simulate(going(2.0, rcs_m2=10), radar, n_frames=4, impairments=())
    with pytest.raises(dc.InvalidSetting, match=says):
        spectrogram(cube, radar)

    one = radar.with_rising_ramps_only() if radar.frame.has_falling_ramps else radar.for_frame(0)
    found = spectrogram(cube.isel(chosen), one, n_velocity_bins=1024)
    # Half a bin of 128 chirps, 0.05 m/s and less.
    assert found.idxmax("velocity").values == pytest.approx(2.0, abs=0.05)
