"""Figures on axes of a user's own: each says what is there, in which units, and takes no more."""

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
    waveform,
)
from dechirp.report.figures.style import WIDTH_IN, render_png, render_svg
from dechirp.report.figures.top_view import GroundDetections
from dechirp.scene.aliasing import RangeVelocity
from radars import of_eight_receivers

UNIT = re.compile(
    r"\((10\S+ )?(m|m/s|s|ms|µs|MHz|GHz|dB|dBm|dBFS|dBsm|°|√W|full scale|cells)(, [^)]*)?\)"
)
# Axes without a unit: counts and proportions.
WITHOUT = re.compile(r"\b(candidate|number of|proportion|probability|window|rate)\b", re.IGNORECASE)

RADAR = of_eight_receivers()
TARGETS = (
    dc.Target(name="left", position_m=(30, 6, 0), velocity_m_per_s=(-8, 0, 0)),
    dc.Target(name="right", position_m=(20, -5, 0), velocity_m_per_s=(6, 1, 0)),
)
N = np.arange(1.0, 6.0)


@pytest.fixture(scope="module")
def known() -> SimpleNamespace:
    """A run, and what figures of it need."""
    result = dc.run(dc.Scenario(radar=RADAR, scene=dc.Scene(targets=TARGETS)))
    found, cube = result.detections, result.cube
    seen = GroundDetections(
        range_m=found.range.values,
        azimuth_rad=found.azimuth.values,
        elevation_rad=np.zeros(found.sizes["detection"]),
        range_std_m=found.range_std.values,
        azimuth_std_rad=found.azimuth_std.values,
        is_unambiguous=np.ones(found.sizes["detection"], bool),
        field_of_view_rad=1.0,
    )
    return SimpleNamespace(
        result=result,
        cube=cube,
        found=found,
        chain=result.scenario.chain,
        marked=range_doppler.MarkedMap(
            power=result.power,
            units="sqrt(W)",
            detections=RangeVelocity(found.range.values, found.velocity.values),
            truth=RangeVelocity(np.array([30.6, 20.6]), np.array([-8.0, 6.0])),
        ),
        seen=seen,
        towards=directions.Directions(np.array([0.2]), np.array([0.0])),
    )


LINE = study.ScoreLine(name="", x=N, value=N / 6, low=N / 7, high=N / 5.5, theory=N / 6)
RCS, SHARE = (
    study.AxisLabel(text="RCS of car (dBsm)"),
    study.AxisLabel(text="Detection probability"),
)
ERROR = study.AxisLabel(text="Range RMSE (m)")
CURVE = {"name": "chain", "x_label": "SNR per sample (dB)", "x": N, "hits": N, "trials": N + 1}
CURVE |= {"theory_x": N, "theory": N / 6}
OPERATING = roc.RocCurve(
    name="", false_alarm=N / 1e6, detection=N / 6, low=N / 7, high=N / 5.5,
    theory_false_alarm=N / 1e6, theory=N / 6,
)  # fmt: skip
DECIDED = detections.DetectionMask(
    title="a", is_detected=np.eye(5) > 0, range_m=N, velocity_m_per_s=N
)
CUT = detections.ThresholdLine(title="a", range_m=N, power_db=N, threshold_db=N)
TRACK = tracks.TrackLine(
    number=3,
    positions_m=np.stack([10 * N, N], axis=-1),
    is_confirmed=N > 2,
    velocity_m_per_s=np.array([10.0, 1.0]),
    covariance_m2=np.eye(2),
)
AROUND = tracks.TrackBackground(
    detections_m=np.stack([10 * N, N], axis=-1), is_static=N > 3, paths_m=np.empty((0, 1, 2))
)
TRIED = {
    label: {"value": 1e-3, "low": 5e-4, "high": 2e-3}
    for label in ("detection_probability", "false_alarm_probability")
}
SEARCH = {
    "objective": {
        "score": "detection_probability",
        "unit": None,
        "direction": "maximise",
        "limits": [
            {"score": "false_alarm_probability", "unit": None, "at_most": 1e-3, "at_least": None}
        ],
    },
    "candidates": [{"number": 0, "admitted": True, "scores": TRIED}],
    "default": {"scores": TRIED, "number": 0},
    "best": None,
}
PEAK = {"snr_db": 20.0, "power_difference_db": 0.3, "power_std_db": 0.1, "judged": True}
POINTS = xr.Dataset(
    {
        name: ("detection", N / scale)
        for name, scale in (("range", 1), ("azimuth", 9), ("elevation", 9), ("velocity", 1))
    }
)
RATE = {
    "name": "hann",
    "measured": 1.01,
    "interval": [0.97, 1.05],
    "required": {"at_least": 0.8, "at_most": 1.25},
}
TONE = np.exp(2j * np.pi * 0.1 * np.arange(256))

# Of each figure function how it is called, on axes or on a figure; after a space, a variant.
MAKERS: dict[str, Callable[..., Axes | list[Axes]]] = {
    "beat.draw_signal": lambda on, of: beat.draw_signal(on, of.cube, doppler_frequency_hz=100.0),
    "beat.draw_signal"
    " real": lambda on, of: beat.draw_signal(on, of.cube.real.assign_attrs(of.cube.attrs)),
    "beat.draw_signal_parts": lambda on, of: beat.draw_signal_parts(on, of.cube),
    "beat.draw_spectrum": lambda on, of: beat.draw_spectrum(
        on, of.cube, RADAR.frame.chirp, of.chain, truth_m=np.array([20.0])
    ),
    "birds_eye.draw_detections_from_above": lambda on, of: (
        birds_eye.draw_detections_from_above(on, of.seen)
    ),
    "cfar.draw_cut": lambda on, of: cfar.draw_cut(
        on, of.result.power, of.result.threshold, of.chain.cfar,
        along="range", cell=(32, 40), units="full scale",
    ),
    "curves.draw_detection_curves": lambda on, _: curves.draw_detection_curves(
        on, [CURVE], confidence=0.95, gap=curves.SnrGap(low_db=2, high_db=4, probability=0.5)
    ),
    "curves.draw_resolution_curves": lambda on, _: curves.draw_resolution_curves(
        on, [CURVE | {"x_label": "Separation (m)"}], confidence=0.95, required=0.9
    ),
    "data_set.draw_targets": lambda on, _: (
        data_set.draw_targets(on, {"car": (N, N), "bus": (N, 2 * N)})
    ),
    "data_set.draw_histogram": lambda on, _: data_set.draw_histogram(
        on, {"car": N, "bus": 2 * N}, label="SNR (dB)", counted_things="targets"
    ),
    "detections.draw_detection_maps": lambda on, _: detections.draw_detection_maps(
        on, [[DECIDED, DECIDED]], target=RangeVelocity(np.array(3.0), np.array(3.0)), reach=(2, 2)
    ),
    "detections.draw_thresholds": lambda on, _: detections.draw_thresholds(
        on, [CUT, CUT], around_m=3, reach_m=2
    ),
    "detectors.draw_detector_comparison": lambda on, _: detectors.draw_detector_comparison(on),
    "diagrams.draw_data_flow": lambda on, _: diagrams.draw_data_flow(on),
    "diagrams.draw_demodulator": lambda on, _: diagrams.draw_demodulator(on),
    "directions.draw_range_azimuth": lambda on, of: directions.draw_range_azimuth(
        on,
        directions.RangeAzimuthMap(
            power=range_azimuth_map(of.cube.isel(frame=0), RADAR, of.chain),
            units="sqrt(W)",
            detections=(of.found.azimuth.values, of.found.range.values),
        ),
    ),
    "directions.draw_angle_spectrum": lambda on, of: directions.draw_angle_spectrum(
        on,
        angle_spectrum(of.cube.isel(frame=0), RADAR, of.found, 0, of.chain),
        estimates=of.towards,
        truth=of.towards,
    ),
    "directions.draw_angle_spectrum over both": lambda on, of: directions.draw_angle_spectrum(
        on,
        xr.DataArray(
            np.ones((5, 5)),
            dims=("elevation", "azimuth"),
            coords={"elevation": N / 9 - 0.3, "azimuth": N / 9 - 0.3},
        ),
        estimates=of.towards,
    ),
    "frames.draw_estimates_over_time": lambda on, of: frames.draw_estimates_over_time(
        on, of.found, variable="velocity", truth=(N, N[None])
    ),
    "range_doppler.draw_map": lambda on, of: range_doppler.draw_map(on, of.marked),
    "range_doppler.draw_map_over_noise": lambda on, of: range_doppler.draw_map_over_noise(
        on, of.marked, highest_db=60.0
    ),
    "range_doppler.draw_close_up": lambda on, of: (
        range_doppler.draw_close_up(on, of.marked, cell=(32, 40))
    ),
    "false_alarm_rates.draw_alarm_ratios": lambda on, _: false_alarm_rates.draw_alarm_ratios(
        on,
        [
            false_alarm_rates.DetectorRates(name="mean", checks=[RATE]),
            false_alarm_rates.DetectorRates(name="rank", checks=[RATE]),
        ],
    ),
    "recording.draw_first_map": lambda on, of: (
        recording.draw_first_map(on, of.result.power, units="sqrt(W)")
    ),
    "recording.draw_first_map of one chirp": lambda on, of: recording.draw_first_map(
        on, of.result.power.isel(velocity=[0]), units="full scale"
    ),
    "recording.draw_points_from_above": lambda on, _: recording.draw_points_from_above(on, POINTS),
    "scene.draw_scene": lambda on, of: scene.draw_scene(
        on, of.result.scenario.scene, detected_m=[12.0], detections=of.seen
    ),
    "spectrogram.draw_spectrogram": lambda on, of: spectrogram.draw_spectrogram(
        on, spectrogram_of(of.cube, RADAR, n_window=16)
    ),
    "study.draw_lines": lambda on, _: (
        study.draw_lines(on, [LINE], x=RCS, y=SHARE, is_ratio=True, limits=[0.5])
    ),
    "study.draw_scatter": lambda on, _: (
        study.draw_scatter(on, [LINE], x=RCS, y=ERROR, is_ratio=False)
    ),
    "study.draw_bars": lambda on, _: study.draw_bars(
        on, [LINE], [f"window {n}" for n in N], x=study.AxisLabel(text="Range window"), y=SHARE,
        is_ratio=True,
    ),
    "heatmap.draw_heatmap": lambda on, _: heatmap.draw_heatmap(
        on, N, N, np.outer(N, N) / 30, axis_labels=(RCS, ERROR), label=SHARE.text, is_ratio=True
    ),
    "roc.draw_roc": lambda on, _: roc.draw_roc(
        on, [OPERATING], x="False-alarm probability", y=SHARE.text
    ),
    "tracks.draw_tracks": lambda on, _: tracks.draw_tracks(on, [TRACK], AROUND),
    "tune.draw_tradeoff": lambda on, _: tune.draw_tradeoff(on, SEARCH),
    "tune.draw_tradeoff without a limit": lambda on, _: tune.draw_tradeoff(
        on, SEARCH | {"objective": SEARCH["objective"] | {"limits": []}}
    ),
    "twin.draw_cut": lambda on, of: twin.draw_cut(
        on, of.result.power, of.result.power, along="velocity", cell=(32, 40), units="sqrt(W)"
    ),
    "twin.draw_noise": lambda on, _: twin.draw_noise(
        on, [{"range_m": n, "recorded_db": -n, "twin_db": None} for n in N], unit="dBm"
    ),
    "twin.draw_differences": lambda on, _: (
        twin.draw_differences(on, [PEAK, PEAK | {"judged": False}], within_db=1.0)
    ),
    "waveform.draw_frequencies": lambda on, _: waveform.draw_frequencies(
        on, start_frequency_hz=77e9, bandwidth_hz=150e6, chirp_duration_s=7.3e-6,
        delay_s=0.33e-6, beat_frequency_hz=6.8e6,
    ),
    "waveform.draw_spectrograms": lambda on, _: waveform.draw_spectrograms(
        on, TONE, TONE, 10e6, slope_hz_per_s=1e12, highest_beat_hz=3e6
    ),
    "training_window.draw_training_window": lambda on, _: training_window.draw_training_window(
        on,
        TrainingWindow(
            n_training=Cells(range=4, velocity=2), n_guard=Cells(range=1, velocity=1)
        ),
        n_training=50,
    ),
}  # fmt: skip


def drawing_functions() -> Iterator[tuple[str, Callable[..., object]]]:
    """All public functions of the folder that are given axes or a figure."""
    for module in pkgutil.iter_modules(figures.__path__, f"{figures.__name__}."):
        made = importlib.import_module(module.name)
        for name, function in inspect.getmembers(made, inspect.isfunction):
            if function.__module__ != module.name or name.startswith("_"):
                continue
            first = next(iter(inspect.signature(function).parameters.values()), None)
            if first is not None and first.annotation in (Axes, FigureBase):
                yield f"{module.name.rpartition('.')[2]}.{name}", function


def test_every_figure_takes_axes_and_returns_them_and_is_tried_here():
    made = dict(drawing_functions())
    returned = {name: inspect.signature(of).return_annotation for name, of in made.items()}
    figures_ = {name for name, of in returned.items() if of in (Axes, list[Axes])}

    assert {name.split()[0] for name in MAKERS} == figures_
    # What returns no axes is a part of figures, and lies with its like.
    modules = {name.split(".")[0] for name in figures_}
    assert {name for name in made if name.split(".")[0] in modules} == figures_


@pytest.mark.parametrize("name", MAKERS)
def test_a_figure_on_axes_of_a_user_says_what_is_there_and_leaves_the_rest(name, known):
    function = dict(drawing_functions())[name.split()[0]]
    first = next(iter(inspect.signature(function).parameters.values()))
    figure = Figure(figsize=(13, 5), dpi=50, layout="constrained")
    if first.annotation is Axes:
        given, beside = figure.subplots(1, 2)
        made = [MAKERS[name](given, known)]
        assert made == [given]
        assert not beside.has_data() and not figure.legends
    else:
        given, beside = figure.subfigures(1, 2)
        made = MAKERS[name](given, known)
        assert made and all(axes.figure is given for axes in made)
        assert not beside.axes

    figure.canvas.draw()
    assert figure.get_size_inches().tolist() == [13, 5]
    assert all(axes.has_data() or axes.patches for axes in made)
    assert all(axes.get_label() for axes in made)
    for words in labels(given.figure if first.annotation is Axes else given, beside):
        assert UNIT.search(words) or WITHOUT.search(words), words


def labels(figure: FigureBase, but: Axes | FigureBase) -> Iterator[str]:
    """Words of all axes at which numbers are written, colour bars too."""
    for axes in figure.axes:
        if axes is but or not axes.axison:
            continue
        shared = {"x": figure.get_supxlabel(), "y": figure.get_supylabel()}
        for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
            ticks = axis.get_ticklabels()
            if any(tick.get_visible() and tick.get_text() for tick in ticks):
                yield axis.label.get_text() or shared[name]


def test_a_figure_without_a_layout_looks_as_its_owner_wants_and_no_pyplot_is_touched(known):
    figure = Figure()
    axes = range_doppler.draw_map(figure.subplots(), known.marked)

    assert figure.get_layout_engine() is None
    assert axes.spines["top"].get_visible()
    assert all("pyplot" not in path.read_text() for path in Path(figures.__path__[0]).iterdir()
               if path.suffix == ".py")  # fmt: skip


def test_a_page_tells_those_who_cannot_see_what_all_panels_show(known):
    drawn = render_svg(lambda figure: beat.draw_signal_parts(figure, known.cube))

    assert drawn.startswith('<svg viewBox="0 0 ')
    said = re.search(r'aria-label="([^"]*)"', drawn)[1]
    assert said.split("; ") == [
        f"Beat signal of the first chirp over time, {part} part" for part in ("real", "imaginary")
    ]


def test_rows_of_a_legend_make_a_figure_of_a_page_higher_not_its_axes_lower():
    many = [study.ScoreLine(**vars(LINE) | {"name": f"ordered statistic {n}"}) for n in range(6)]

    def drawn(lines):
        return render_svg(
            lambda figure: study.draw_lines(figure.subplots(), lines, x=RCS, y=SHARE, is_ratio=True)
        )

    def height(page):
        return float(re.search(r'viewBox="0 0 [\d.]+ ([\d.]+)"', page)[1]) / 72

    assert height(drawn(many[:1])) == pytest.approx(3.2, abs=0.01)
    assert 3.4 < height(drawn(many)) < 4.2


def test_a_picture_is_as_wide_as_the_figure_and_says_what_it_shows(known):
    made = render_png(lambda figure: recording.draw_first_map(figure.subplots(), known.result.power,
                                                 units="sqrt(W)"), title="a")  # fmt: skip
    assert made.startswith(b"\x89PNG")
    assert int.from_bytes(made[16:20]) == round(300 * WIDTH_IN)
    assert b"Range-Doppler map" in made
