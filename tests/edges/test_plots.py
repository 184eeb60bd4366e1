"""Plots of arrays and results: the figures of the report, on axes of the user."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

import dechirp as dc
from dechirp.report import plots
from dechirp.report.page import render_report
from nightly import nightly

mpl.use("agg")
HARDWARE = dc.Hardware(transmit_power_w=0.01, antenna_gain=10.0, noise_factor=15.0)
CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=20e12,
    ramp_duration_s=15e-6,
    sample_rate_hz=5e6,
    n_samples=64,
    sampling="complex",
)
RADAR = dc.Radar(
    frame=dc.Frame(chirp=CHIRP, n_chirps=32, interval_s=20e-6, period_s=20e-3),
    array=dc.Array(rx_m=[(0, 1.9e-3 * n, 0) for n in range(4)]),
    hardware=HARDWARE,
)
SCENE = dc.Scene(
    targets=[
        dc.Target(name="car", position_m=(20, 4, 0), velocity_m_per_s=(10, 0, 0), rcs_m2=10),
        dc.Target(name="post", position_m=(12, -3, 0), rcs_m2=3),
    ]
)
CHAIN = dc.Chain(angle=dc.angle.Fft())
CUBE = dc.simulate(SCENE, RADAR, impairments=[dc.impairments.ThermalNoise()], seed=1)
POWER = dc.power_map(CUBE.isel(frame=0), RADAR, CHAIN)
DETECTIONS = dc.detect(CUBE, RADAR, CHAIN)


@pytest.fixture
def axes():
    return Figure().subplots()


def labels(axes):
    return axes.get_xlabel(), axes.get_ylabel()


def points_of(axes, name):
    """Return the points (x, y) of the line whose label starts with a name."""
    (line,) = [line for line in axes.get_lines() if str(line.get_label()).startswith(name)]
    return np.transpose(line.get_data())


def test_map_circles_detections_and_keeps_levels(axes):
    assert POWER.dechirp.plot(ax=axes, detections=DETECTIONS) is axes
    assert labels(axes) == ("Range (m)", "Velocity (m/s, receding positive)")
    (image,) = axes.get_images()
    assert image.get_array().max() == pytest.approx(POWER.dechirp.db().max().item(), abs=1e-3)
    circles = points_of(axes, "detection")
    expected = np.transpose([DETECTIONS.range, DETECTIONS.velocity])
    np.testing.assert_allclose(np.sort(circles, axis=0), np.sort(expected, axis=0))


def test_profile_spectrogram_and_angle_maps_have_their_axes():
    profile = POWER.isel(velocity=16).drop_vars("velocity")
    strongest = DETECTIONS.isel(detection=[int(DETECTIONS.snr.values.argmax())])
    arrays = {
        ("Range (m)", "Power (dBm)"): profile,
        ("Azimuth (°, left positive)", "Range (m)"): dc.range_azimuth_map(
            CUBE.isel(frame=0), RADAR, CHAIN
        ),
    }
    for expected, power in arrays.items():
        axes = Figure().subplots()
        assert power.dechirp.plot(axes) is axes
        assert labels(axes) == expected
    axes = Figure().subplots()
    marked = arrays[("Azimuth (°, left positive)", "Range (m)")].dechirp.plot(
        axes, detections=strongest
    )
    np.testing.assert_allclose(
        points_of(marked, "detection"), [[np.sin(strongest.azimuth.item()), strongest.range.item()]]
    )


def test_detections_are_drawn_from_above(axes):
    assert DETECTIONS.dechirp.plot(ax=axes) is axes
    x, y = (DETECTIONS.range * f(DETECTIONS.azimuth) for f in (np.cos, np.sin))
    places = points_of(axes, "detection")
    np.testing.assert_allclose(np.sort(places, axis=0), np.sort(np.transpose([y, x]), axis=0))


def test_detections_without_azimuth_are_drawn_over_time(axes):
    unlocated = DETECTIONS.assign(azimuth=DETECTIONS.azimuth * np.nan)
    assert unlocated.dechirp.plot(axes).get_ylabel() == "Range (m)"


def test_truth_separates_targets_at_rest(axes):
    dc.truth(SCENE, RADAR).dechirp.plot(axes)
    np.testing.assert_allclose(points_of(axes, "at rest"), [[-3, 12]], atol=1e-6)
    np.testing.assert_allclose(points_of(axes, "moving"), [[4, 20]], atol=0.01)


def test_tables_without_rows_are_drawn_as_empty_axes_with_a_title():
    clusters = DETECTIONS.isel(detection=[]).rename(detection="cluster")
    tentative = make_tracks(["tentative"] * 3)
    for table, title in (
        (DETECTIONS.isel(detection=[]), "No detections"),
        (clusters, "No clusters"),
        (dc.truth(SCENE, RADAR).isel(target=[]), "No targets"),
        (tentative, "No confirmed tracks"),
        (tentative.isel(track=[]), "No confirmed tracks"),
    ):
        axes = Figure().subplots()
        assert table.dechirp.plot(axes) is axes
        assert axes.get_title() == title
        assert not axes.has_data()


def test_tracks_are_drawn_with_their_numbers(axes):
    make_tracks(["tentative", "confirmed", "confirmed"]).dechirp.plot(axes)
    assert "7" in {text.get_text() for text in axes.texts}


def make_tracks(statuses):
    """Return the track 7 in three frames."""
    state = ("x", "y", "vx", "vy")
    covariance = np.broadcast_to(0.01 * np.eye(4), (1, 3, 4, 4))
    return xr.Dataset(
        {
            **{
                name: (("track", "frame"), [values])
                for name, values in zip(
                    state, ([10.0, 11, 12], [2.0, 2, 2], [10.0] * 3, [0.0] * 3), strict=True
                )
            },
            "status": (("track", "frame"), [statuses]),
            "covariance": (("track", "frame", "state", "other_state"), covariance),
        },
        {
            "track": [7],
            "state": list(state),
            "other_state": list(state),
            "time": ("frame", [0, 1, 2]),
        },
    )


@nightly
def test_result_plots_first_figure_of_its_page():
    scenario = dc.Scenario(name="two targets", radar=RADAR, scene=SCENE, chain=CHAIN, seed=2)
    result = dc.run(scenario)
    axes = result.plot(ax=Figure().subplots())
    page = render_report(result, yaml="")
    assert page.index('aria-label="') == page.index(f'aria-label="{axes.get_label()}')
    for target in SCENE.targets:
        assert any(target.name in text.get_text() for text in axes.texts)


@pytest.mark.parametrize(
    "samples", [CUBE, CUBE.isel(frame=0, chirp=0, rx=0), CUBE.isel(frame=0).real, CUBE[0, 0, 0]]
)
def test_samples_are_drawn_over_the_time_of_the_first_chirp(axes, samples):
    assert samples.dechirp.plot(ax=axes) is axes
    assert labels(axes)[0] == "Time since ramp start (\u00b5s)"
    (line,) = axes.get_lines()
    time_us, level = line.get_data()
    np.testing.assert_allclose(time_us, CUBE.sample.values * 1e6)
    expected = CUBE.values[0, 0, 0].real
    np.testing.assert_allclose(level / abs(level).max(), expected / abs(expected).max(), rtol=1e-5)


def test_chirp_and_receiver_of_samples_can_be_selected(axes):
    CUBE.isel(chirp=slice(3, None), rx=2).dechirp.plot(ax=axes)
    level = axes.get_lines()[0].get_ydata()
    expected = CUBE.values[0, 3, 2].real
    np.testing.assert_allclose(level / abs(level).max(), expected / abs(expected).max(), rtol=1e-5)


def test_plot_without_axes_takes_the_current_ones():
    current = plt.figure().subplots()
    try:
        assert POWER.dechirp.plot() is current
    finally:
        plt.close("all")
    assert mpl.rcParams["font.size"] == mpl.rcParamsDefault["font.size"]


def draw(array, **arguments):
    return array.dechirp.plot(Figure().subplots(), **arguments)


NAN_RANGE = {"range": POWER.range * np.nan}


@pytest.mark.parametrize(
    ("plot", "message"),
    [
        (lambda: POWER.dechirp.plot("axes"), "^ax: a str"),
        (lambda: draw(POWER, unknown=1), r"plot\.unknown: unknown argument"),
        (lambda: draw(DETECTIONS, unknown=1), r"plot\.unknown: unknown argument"),
        (lambda: draw(POWER.expand_dims("frame")), "over frame"),
        (lambda: draw(POWER.isel(range=[])), r"an array \(32, 0\); expected at least 1 cell;"),
        (lambda: draw(POWER[0, :1]), "expected at least 2 cells;"),
        (lambda: draw(POWER.copy(data=POWER * np.nan)), "2048 powers that are not finite"),
        (lambda: draw(POWER[0].copy(data=POWER[0] * np.inf)), "64 powers that are not finite"),
        (lambda: draw(POWER.copy(data=POWER.dechirp.db())), "of 0 or more, not decibels"),
        (lambda: draw(POWER.assign_coords(NAN_RANGE)), "values of range that are not finite"),
        (lambda: draw(POWER, detections="x"), "^detections: 'x'; expected Dataset or None"),
        (lambda: draw(POWER, detections=xr.Dataset()), "detections: .* without range, velocity"),
        (lambda: draw(POWER[0], detections=DETECTIONS), "detections: .* leave detections out"),
        (lambda: draw(CUBE * np.nan), r"an array \(1, 32, 4, 64\) over frame, .*dc.simulate"),
        (lambda: draw(CUBE.isel(sample=[])), "expected finite samples over the times sample"),
        (lambda: draw(CUBE.drop_vars("sample")), "over the times sample"),
        (lambda: draw(CUBE.expand_dims("trial")), "an array .* over trial, .*isel"),
        (lambda: draw(CUBE, detections=DETECTIONS), "detections: .* leave detections out"),
        (lambda: draw(DETECTIONS.drop_vars("snr")), "a dataset without snr"),
        (lambda: draw(DETECTIONS * np.nan), "without a detection to draw"),
        (lambda: plots.plot_table(DETECTIONS, None, dim="frame"), "ego motion"),
    ],
)
def test_what_has_no_figure_is_named(plot, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        plot()


def test_cells_left_out_of_a_map_are_not_drawn(axes):
    (image,) = draw(POWER.where(POWER.mean() < POWER)).get_images()
    assert np.isfinite(image.get_array()).sum() == (POWER.mean() < POWER).sum()
