"""Figures on axes of the user: labels, units, layout, text alternatives and export."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

import dechirp as dc
from dechirp.processing.angle_maps import angle_spectrum, range_azimuth_map
from dechirp.processing.cfar.base import Cells, TrainingWindow
from dechirp.processing.spectrogram import spectrogram as spectrogram_of
from dechirp.report import figures
from dechirp.report.figures import (
    beat,
    birds_eye,
    cfar,
    curves,
    data_set,
    detections,
    detectors,
    diagrams,
    directions,
    false_alarm_rates,
    frames,
    heatmap,
    range_doppler,
    recording,
    roc,
    scene,
    spectrogram,
    study,
    tracks,
    training_window,
    tune,
    twin,
    vital_signs,
    waveform,
)
from dechirp.report.figures.common import range_axis_end_m
from dechirp.report.figures.style import WIDTH_IN, render_png, render_svg
from dechirp.report.figures.top_view import GroundDetections
from dechirp.scene.aliasing import RangeVelocity
from nightly import nightly, nightly_except
from radars import eight_receiver_radar

UNIT = re.compile(
    r"\((10\S+ )?(m|mm|m/s|s|ms|1/min|rad|µs|MHz|GHz|dB|dBm|dBFS|dBsm|°|√W|full scale|cells)"
    r"(, [^)]*)?\)"
)
# Labels without a unit: counts and proportions.
UNITLESS_LABEL = re.compile(
    r"\b(candidate|number of|proportion|probability|window|rate)\b", re.IGNORECASE
)

RADAR = eight_receiver_radar()
TARGETS = (
    dc.Target(name="left", position_m=(30, 6, 0), velocity_m_per_s=(-8, 0, 0)),
    dc.Target(name="right", position_m=(20, -5, 0), velocity_m_per_s=(6, 1, 0)),
)
N = np.arange(1.0, 6.0)


@pytest.fixture(scope="module")
def example() -> SimpleNamespace:
    """A run, and the inputs of its figures."""
    result = dc.run(dc.Scenario(radar=RADAR, scene=dc.Scene(targets=TARGETS)))
    peaks, cube = result.detections, result.cube
    ground_detections = GroundDetections(
        range_m=peaks.range.values,
        azimuth_rad=peaks.azimuth.values,
        elevation_rad=np.zeros(peaks.sizes["detection"]),
        range_std_m=peaks.range_std.values,
        azimuth_std_rad=peaks.azimuth_std.values,
        is_unambiguous=np.ones(peaks.sizes["detection"], bool),
        field_of_view_rad=1.0,
    )
    return SimpleNamespace(
        result=result,
        cube=cube,
        peaks=peaks,
        chain=result.scenario.chain,
        marked_map=range_doppler.MarkedMap(
            power=result.power,
            units="W**0.5",
            detections=RangeVelocity(peaks.range.values, peaks.velocity.values),
            truth=RangeVelocity(np.array([30.6, 20.6]), np.array([-8.0, 6.0])),
        ),
        ground=ground_detections,
        direction=directions.Directions(np.array([0.2]), np.array([0.0])),
    )


SCORE_LINE = study.ScoreLine(name="", x=N, value=N / 6, low=N / 7, high=N / 5.5, theory=N / 6)
RCS_LABEL, PD_LABEL = (
    study.AxisLabel(text="RCS of car (dBsm)"),
    study.AxisLabel(text="Detection probability"),
)
RMSE_LABEL = study.AxisLabel(text="Range RMSE (m)")
DETECTION_CURVE = {
    "name": "chain",
    "x_label": "SNR per sample (dB)",
    "x": N,
    "hits": N,
    "trials": N + 1,
}
DETECTION_CURVE |= {"theory_x": N, "theory": N / 6}
ROC_CURVE = roc.RocCurve(
    name="", false_alarm=N / 1e6, detection=N / 6, low=N / 7, high=N / 5.5,
    theory_false_alarm=N / 1e6, theory=N / 6,
)  # fmt: skip
DETECTION_MASK = detections.DetectionMask(
    title="a", is_detected=np.eye(5) > 0, range_m=N, velocity_m_per_s=N
)
THRESHOLD_LINE = detections.ThresholdLine(title="a", range_m=N, power_db=N, threshold_db=N)
TRACK_LINE = tracks.TrackLine(
    number=3,
    positions_m=np.stack([10 * N, N], axis=-1),
    is_confirmed=N > 2,
    velocity_m_per_s=np.array([10.0, 1.0]),
    covariance_m2=np.eye(2),
)
BACKGROUND = tracks.TrackBackground(
    detections_m=np.stack([10 * N, N], axis=-1), is_static=N > 3, paths_m=np.empty((0, 1, 2))
)
CANDIDATE_SCORES = {
    label: {"value": 1e-3, "low": 5e-4, "high": 2e-3}
    for label in ("detection_probability", "false_alarm_probability")
}
TUNE_DOCUMENT = {
    "objective": {
        "score": "detection_probability",
        "unit": None,
        "direction": "maximise",
        "limits": [
            {"score": "false_alarm_probability", "unit": None, "at_most": 1e-3, "at_least": None}
        ],
    },
    "candidates": [{"number": 0, "admitted": True, "scores": CANDIDATE_SCORES}],
    "default": {"scores": CANDIDATE_SCORES, "number": 0},
    "best": None,
}
PEAK = {"snr_db": 20.0, "power_difference_db": 0.3, "power_std_db": 0.1, "judged": True}
POINTS = xr.Dataset(
    {
        name: ("detection", N / scale)
        for name, scale in (("range", 1), ("azimuth", 9), ("elevation", 9), ("velocity", 1))
    }
)
ALARM_CHECK = {
    "name": "hann",
    "measured": 1.01,
    "interval": [0.97, 1.05],
    "required": {"at_least": 0.8, "at_most": 1.25},
}
TONE = np.exp(2j * np.pi * 0.1 * np.arange(256))

# One call of each figure function, on axes or a figure; the name of a variant follows a space.
CHEST_M = xr.DataArray(1e-3 * np.sin(N), dims="time", coords={"time": 0.1 * N})
CHEST_RATES = xr.Dataset(
    {
        f"{sign}_rate{end}": ("window", [rate + shift_hz, np.nan])
        for sign, rate in (("breathing", 0.3), ("heart", 1.1))
        for end, shift_hz in (("", 0.0), ("_low", -0.01), ("_high", 0.01))
    },
    attrs={"confidence": 0.95},
)
DRAW_CALLS: dict[str, Callable[..., Axes | list[Axes]]] = {
    "beat.draw_first_chirp_signal": lambda area, run: (
        beat.draw_first_chirp_signal(area, run.cube, doppler_frequency_hz=100.0)
    ),
    "beat.draw_first_chirp_signal real": lambda area, run: beat.draw_first_chirp_signal(
        area, run.cube.real.assign_attrs(run.cube.attrs)
    ),
    "beat.draw_first_chirp_signal_parts": lambda area, run: (
        beat.draw_first_chirp_signal_parts(area, run.cube)
    ),
    "beat.draw_beat_spectrum_over_range": lambda area, run: beat.draw_beat_spectrum_over_range(
        area, run.cube, RADAR.frame.chirp, run.chain, truth_m=np.array([20.0])
    ),
    "birds_eye.draw_detections_from_above": lambda area, run: (
        birds_eye.draw_detections_from_above(area, run.ground)
    ),
    "cfar.draw_threshold_cut": lambda area, run: cfar.draw_threshold_cut(
        area, run.result.power, run.result.threshold, run.chain.cfar,
        along="range", cell=(32, 40), units="1",
    ),
    "curves.draw_detection_curves": lambda area, _: curves.draw_detection_curves(
        area, [DETECTION_CURVE], confidence=0.95,
        gap=curves.SnrGap(low_db=2, high_db=4, probability=0.5),
    ),
    "curves.draw_resolution_curves": lambda area, _: curves.draw_resolution_curves(
        area, [DETECTION_CURVE | {"x_label": "Separation (m)"}], confidence=0.95, required=0.9
    ),
    "data_set.draw_target_velocity_over_range": lambda area, _: (
        data_set.draw_target_velocity_over_range(area, {"car": (N, N), "bus": (N, 2 * N)})
    ),
    "data_set.draw_histogram": lambda area, _: data_set.draw_histogram(
        area, {"car": N, "bus": 2 * N}, label="SNR (dB)", counted_things="targets"
    ),
    "detections.draw_detection_maps": lambda area, _: detections.draw_detection_maps(
        area, [[DETECTION_MASK, DETECTION_MASK]],
        target=RangeVelocity(np.array(3.0), np.array(3.0)), half_widths=(2, 2),
    ),
    "detections.draw_power_and_threshold_lines": lambda area, _: (
        detections.draw_power_and_threshold_lines(
            area, [THRESHOLD_LINE, THRESHOLD_LINE], around_m=3, reach_m=2
        )
    ),
    "detectors.draw_detector_comparison": lambda area, _: detectors.draw_detector_comparison(area),
    "diagrams.draw_data_flow": lambda area, _: diagrams.draw_data_flow(area),
    "diagrams.draw_demodulator": lambda area, _: diagrams.draw_demodulator(area),
    "directions.draw_range_azimuth_map": lambda area, run: directions.draw_range_azimuth_map(
        area,
        directions.RangeAzimuthMap(
            power=range_azimuth_map(run.cube.isel(frame=0), RADAR, run.chain),
            units="W**0.5",
            detections=(run.peaks.azimuth.values, run.peaks.range.values),
        ),
    ),
    "directions.draw_angle_spectrum": lambda area, run: directions.draw_angle_spectrum(
        area,
        angle_spectrum(run.cube.isel(frame=0), RADAR, run.peaks, 0, run.chain),
        estimates=run.direction,
        truth=run.direction,
    ),
    "directions.draw_angle_spectrum 2-D": lambda area, run: directions.draw_angle_spectrum(
        area,
        xr.DataArray(
            np.ones((5, 5)),
            dims=("elevation", "azimuth"),
            coords={"elevation": N / 9 - 0.3, "azimuth": N / 9 - 0.3},
        ),
        estimates=run.direction,
    ),
    "frames.draw_estimates_over_time": lambda area, run: frames.draw_estimates_over_time(
        area, run.peaks, variable="velocity", truth=(N, N[None])
    ),
    "vital_signs.draw_vital_signs": lambda figure, _: vital_signs.draw_vital_signs(
        figure, CHEST_M, CHEST_M.rename(time="frequency"), CHEST_RATES
    ),
    "vital_signs.draw_displacement": lambda area, _: vital_signs.draw_displacement(area, CHEST_M),
    "range_doppler.draw_map": lambda area, run: range_doppler.draw_map(area, run.marked_map),
    "range_doppler.draw_map_over_noise": lambda area, run: range_doppler.draw_map_over_noise(
        area, run.marked_map, highest_db=60.0
    ),
    "range_doppler.draw_close_up": lambda area, run: (
        range_doppler.draw_close_up(area, run.marked_map, cell=(32, 40))
    ),
    "false_alarm_rates.draw_false_alarm_ratios":
        lambda area, _: false_alarm_rates.draw_false_alarm_ratios(
        area,
        [
            false_alarm_rates.DetectorRates(name="mean", checks=[ALARM_CHECK]),
            false_alarm_rates.DetectorRates(name="rank", checks=[ALARM_CHECK]),
        ],
    ),
    "recording.draw_map_or_range_profile": lambda area, run: (
        recording.draw_map_or_range_profile(area, run.result.power, units="W**0.5")
    ),
    "recording.draw_map_or_range_profile of one chirp":
        lambda area, run: recording.draw_map_or_range_profile(
        area, run.result.power.isel(velocity=[0]), units="1"
    ),
    "recording.draw_points_from_above": lambda area, _: (
        recording.draw_points_from_above(area, POINTS)
    ),
    "scene.draw_scene": lambda area, run: scene.draw_scene(
        area, run.result.scenario.scene, detected_m=[12.0], detections=run.ground
    ),
    "spectrogram.draw_spectrogram": lambda area, run: spectrogram.draw_spectrogram(
        area, spectrogram_of(run.cube, RADAR, n_window=16)
    ),
    "study.draw_score_lines": lambda area, _: (
        study.draw_score_lines(
            area, [SCORE_LINE], x=RCS_LABEL, y=PD_LABEL, is_ratio=True, limits=[0.5]
        )
    ),
    "study.draw_score_scatter": lambda area, _: (
        study.draw_score_scatter(area, [SCORE_LINE], x=RCS_LABEL, y=RMSE_LABEL, is_ratio=False)
    ),
    "study.draw_score_bars": lambda area, _: study.draw_score_bars(
        area, [SCORE_LINE], [f"window {n}" for n in N], x=study.AxisLabel(text="Range window"),
        y=PD_LABEL, is_ratio=True,
    ),
    "heatmap.draw_heatmap": lambda area, _: heatmap.draw_heatmap(
        area, N, N, np.outer(N, N) / 30, axis_labels=(RCS_LABEL, RMSE_LABEL), label=PD_LABEL.text,
        is_ratio=True,
    ),
    "roc.draw_roc": lambda area, _: roc.draw_roc(
        area, [ROC_CURVE], x="False-alarm probability", y=PD_LABEL.text
    ),
    "tracks.draw_tracks": lambda area, _: tracks.draw_tracks(area, [TRACK_LINE], BACKGROUND),
    "tune.draw_candidate_scores_over_limited_score":
        lambda area, _: tune.draw_candidate_scores_over_limited_score(area, TUNE_DOCUMENT),
    "tune.draw_candidate_scores_over_limited_score without a limit":
        lambda area, _: tune.draw_candidate_scores_over_limited_score(
        area, TUNE_DOCUMENT | {"objective": TUNE_DOCUMENT["objective"] | {"limits": []}}
    ),
    "twin.draw_recorded_and_twin_cut": lambda area, run: twin.draw_recorded_and_twin_cut(
        area, run.result.power, run.result.power, along="velocity", cell=(32, 40), units="W**0.5"
    ),
    "twin.draw_noise_levels_over_range": lambda area, _: twin.draw_noise_levels_over_range(
        area, [{"range_m": n, "recorded_db": -n, "twin_db": None} for n in N], unit="dBm"
    ),
    "twin.draw_peak_power_differences": lambda area, _: (
        twin.draw_peak_power_differences(area, [PEAK, PEAK | {"judged": False}], tolerance_db=1.0)
    ),
    "waveform.draw_ramp_frequencies": lambda area, _: waveform.draw_ramp_frequencies(
        area, start_frequency_hz=77e9, bandwidth_hz=150e6, chirp_duration_s=7.3e-6,
        delay_s=0.33e-6, beat_frequency_hz=6.8e6,
    ),
    "waveform.draw_ramp_and_beat_spectrograms":
        lambda area, _: waveform.draw_ramp_and_beat_spectrograms(
        area, TONE, TONE, 10e6, slope_hz_per_s=1e12, highest_beat_hz=3e6
    ),
    "training_window.draw_training_window": lambda area, _: training_window.draw_training_window(
        area,
        TrainingWindow(
            n_training=Cells(range=4, velocity=2), n_guard=Cells(range=1, velocity=1)
        ),
        n_training=50,
    ),
}  # fmt: skip


def iter_drawing_functions() -> Iterator[tuple[str, Callable[..., object]]]:
    """Yield all public functions of the package that take axes or a figure."""
    for module in pkgutil.iter_modules(figures.__path__, f"{figures.__name__}."):
        figure_module = importlib.import_module(module.name)
        for name, function in inspect.getmembers(figure_module, inspect.isfunction):
            if function.__module__ != module.name or name.startswith("_"):
                continue
            first = next(iter(inspect.signature(function).parameters.values()), None)
            if first is not None and first.annotation in (Axes, FigureBase):
                yield f"{module.name.rpartition('.')[2]}.{name}", function


def test_every_figure_function_returns_axes_and_is_tested_here():
    functions = dict(iter_drawing_functions())
    return_types = {
        name: inspect.signature(function).return_annotation for name, function in functions.items()
    }
    figure_names = {
        name for name, annotation in return_types.items() if annotation in (Axes, list[Axes])
    }

    assert {name.split()[0] for name in DRAW_CALLS} == figure_names
    # Functions that return no axes are parts of figures, in modules of their own.
    modules = {name.split(".")[0] for name in figure_names}
    assert {name for name in functions if name.split(".")[0] in modules} == figure_names


@pytest.mark.parametrize("name", nightly_except(15, DRAW_CALLS))
def test_figure_labels_its_axes_with_units_and_leaves_others_untouched(name, example):
    function = dict(iter_drawing_functions())[name.split()[0]]
    first = next(iter(inspect.signature(function).parameters.values()))
    figure = Figure(figsize=(13, 5), dpi=50, layout="constrained")
    if first.annotation is Axes:
        area, neighbour = figure.subplots(1, 2)
        drawn_axes = [DRAW_CALLS[name](area, example)]
        assert drawn_axes == [area]
        assert not neighbour.has_data() and not figure.legends
    else:
        area, neighbour = figure.subfigures(1, 2)
        drawn_axes = DRAW_CALLS[name](area, example)
        assert drawn_axes and all(axes.figure is area for axes in drawn_axes)
        assert not neighbour.axes

    figure.canvas.draw()
    assert figure.get_size_inches().tolist() == [13, 5]
    assert all(axes.has_data() or axes.patches for axes in drawn_axes)
    assert all(axes.get_label() for axes in drawn_axes)
    for label in iter_axis_labels(area.figure if first.annotation is Axes else area, neighbour):
        assert UNIT.search(label) or UNITLESS_LABEL.search(label), label


def iter_axis_labels(figure: FigureBase, excluded: Axes | FigureBase) -> Iterator[str]:
    """Yield labels of all axes with tick labels, including colour bars."""
    for axes in figure.axes:
        if axes is excluded or not axes.axison:
            continue
        shared_labels = {"x": figure.get_supxlabel(), "y": figure.get_supylabel()}
        for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
            ticks = axis.get_ticklabels()
            if any(tick.get_visible() and tick.get_text() for tick in ticks):
                yield axis.label.get_text() or shared_labels[name]


@pytest.mark.parametrize(
    ("ranges_m", "full_m", "end_m"),
    [
        ([30.0, np.nan], 2200.0, 100.0),
        ([50.0, 3.0], 2200.0, 100.0),
        ([51.0], 2200.0, 200.0),
        ([150.0], 250.0, 250.0),
        ([0.4], 9.0, 1.0),
        ([], 2200.0, 2200.0),
        ([-0.1], 9.0, 9.0),
    ],
)
def test_range_axis_ends_at_round_number_from_twice_farthest_range(ranges_m, full_m, end_m):
    assert range_axis_end_m(np.array(ranges_m), full_m) == pytest.approx(end_m, rel=1e-12)


def test_threshold_and_weak_echoes_are_shown_below_echoes_that_fill_the_axis(example):
    power = example.result.power.copy(data=np.full(example.result.power.shape, 1e-9))
    axes = cfar.draw_threshold_cut(
        Figure().subplots(), power, 1e-3 * power, example.chain.cfar,
        along="range", cell=(32, 40), units="1",
    )  # fmt: skip
    assert axes.get_ylim()[0] < -120  # the threshold

    # One of 64 chirps has a signal: the mean lies 18 dB below it.
    cube = example.cube.copy()
    cube.values[:, 1:] = 0
    axes = beat.draw_beat_spectrum_over_range(
        Figure().subplots(), cube, RADAR.frame.chirp, example.chain
    )
    mean = axes.lines[1].get_ydata()
    assert np.quantile(mean, 0.05) > axes.get_ylim()[0]


def test_figure_without_layout_keeps_user_style_and_avoids_pyplot(example):
    figure = Figure()
    axes = range_doppler.draw_map(figure.subplots(), example.marked_map)

    assert figure.get_layout_engine() is None
    assert axes.spines["top"].get_visible()
    assert all("pyplot" not in path.read_text() for path in Path(figures.__path__[0]).iterdir()
               if path.suffix == ".py")  # fmt: skip


def test_svg_aria_label_describes_all_panels(example):
    svg = render_svg(lambda figure: beat.draw_first_chirp_signal_parts(figure, example.cube))

    assert svg.startswith('<svg viewBox="0 0 ')
    aria_label = re.search(r'aria-label="([^"]*)"', svg)[1]
    assert aria_label.split("; ") == [
        f"Beat signal of the first chirp over time, {part} part" for part in ("real", "imaginary")
    ]


@nightly
def test_legend_rows_enlarge_figure_instead_of_shrinking_axes():
    score_lines = [
        study.ScoreLine(**vars(SCORE_LINE) | {"name": f"ordered statistic {n}"}) for n in range(6)
    ]

    def render_lines(lines):
        return render_svg(
            lambda figure: study.draw_score_lines(
                figure.subplots(), lines, x=RCS_LABEL, y=PD_LABEL, is_ratio=True
            )
        )

    def measure_height_in(svg):
        return float(re.search(r'viewBox="0 0 [\d.]+ ([\d.]+)"', svg)[1]) / 72

    assert measure_height_in(render_lines(score_lines[:1])) == pytest.approx(3.2, abs=0.01)
    assert 3.4 < measure_height_in(render_lines(score_lines)) < 4.2


def test_png_has_figure_width_and_title(example):
    png = render_png(
        lambda figure: recording.draw_map_or_range_profile(
            figure.subplots(), example.result.power, units="W**0.5"
        ),
        title="a",
    )
    assert png.startswith(b"\x89PNG")
    assert int.from_bytes(png[16:20]) == round(300 * WIDTH_IN)
    assert b"Range-Doppler map" in png
