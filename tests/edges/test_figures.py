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
from dechirp.process.angle_maps import angle_spectrum, range_azimuth_map
from dechirp.process.cfar.base import Cells, Ring
from dechirp.process.spectrogram import spectrogram as spectrogram_of
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
    frames,
    heat,
    operating,
    range_doppler,
    rates,
    recorded,
    scene,
    spectrogram,
    study,
    tracks,
    tuned,
    twin,
    waveform,
    window,
)
from dechirp.report.figures.ground import Seen
from dechirp.report.figures.style import WIDTH_IN, png, svg
from dechirp.scene.folding import Place
from radars import of_eight_receivers

UNIT = re.compile(
    r"(^|, |\n)(10\S+ )?(m|m/s|s|ms|µs|MHz|GHz|dB|dBm|dBFS|dBsm|°|√W|full scale)(?![\w/])"
)
# Of axes without a unit: what is counted, and shares of one.
WITHOUT = re.compile(r"\b(cells|candidate|number of|share|probability|window)\b")

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
    seen = Seen(
        range_m=found.range.values,
        azimuth_rad=found.azimuth.values,
        elevation_rad=np.zeros(found.sizes["detection"]),
        range_std_m=found.range_std.values,
        azimuth_std_rad=found.azimuth_std.values,
        is_sure=np.ones(found.sizes["detection"], bool),
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
            found=Place(found.range.values, found.velocity.values),
            truth=Place(np.array([30.6, 20.6]), np.array([-8.0, 6.0])),
        ),
        seen=seen,
        towards=directions.Towards(np.array([0.2]), np.array([0.0])),
    )


LINE = study.Line(name="", x=N, value=N / 6, low=N / 7, high=N / 5.5, theory=N / 6)
RCS, SHARE = study.Axis(words="RCS of car, dBsm"), study.Axis(words="detection probability")
ERROR = study.Axis(words="range RMSE, m")
CURVE = {"name": "chain", "over": "ratio in each sample, dB", "x": N, "hits": N, "trials": N + 1}
CURVE |= {"theory_x": N, "theory": N / 6}
OPERATING = operating.Operating(
    name="", false_alarm=N / 1e6, detection=N / 6, low=N / 7, high=N / 5.5,
    theory_false_alarm=N / 1e6, theory=N / 6,
)  # fmt: skip
DECIDED = detections.Decided(title="a", over=np.eye(5) > 0, range_m=N, velocity_m_per_s=N)
CUT = detections.Line(title="a", range_m=N, power_db=N, threshold_db=N)
TRACK = tracks.Line(
    number=3,
    way_m=np.stack([10 * N, N], axis=-1),
    is_confirmed=N > 2,
    velocity_m_per_s=np.array([10.0, 1.0]),
    covariance_m2=np.eye(2),
)
AROUND = tracks.Ground(
    found_m=np.stack([10 * N, N], axis=-1), is_static=N > 3, paths_m=np.empty((0, 1, 2))
)
TRIED = {
    label: {"value": 1e-3, "low": 5e-4, "high": 2e-3}
    for label in ("detection_probability", "false_alarm_probability")
}
SEARCH = {
    "aim": {
        "score": "detection_probability",
        "unit": None,
        "towards": "most",
        "limits": [
            {"score": "false_alarm_probability", "unit": None, "at_most": 1e-3, "at_least": None}
        ],
    },
    "trials": [{"number": 0, "admitted": True, "scores": TRIED}],
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
    "beat.signal": lambda on, of: beat.signal(on, of.cube, doppler_frequency_hz=100.0),
    "beat.signal real": lambda on, of: beat.signal(on, of.cube.real.assign_attrs(of.cube.attrs)),
    "beat.whole_signal": lambda on, of: beat.whole_signal(on, of.cube),
    "beat.spectrum": lambda on, of: beat.spectrum(
        on, of.cube, RADAR.frame.chirp, of.chain, truth_m=np.array([20.0])
    ),
    "birds_eye.from_above": lambda on, of: birds_eye.from_above(on, of.seen),
    "cfar.cut": lambda on, of: cfar.cut(
        on, of.result.power, of.result.threshold, of.chain.cfar,
        along="range", cell=(32, 40), units="full scale",
    ),
    "curves.detection": lambda on, _: curves.detection(
        on, [CURVE], confidence=0.95, gap=curves.Gap(low_db=2, high_db=4, share=0.5)
    ),
    "curves.resolution": lambda on, _: curves.resolution(
        on, [CURVE | {"over": "separation, m"}], confidence=0.95, required=0.9
    ),
    "data_set.places": lambda on, _: data_set.places(on, {"car": (N, N), "bus": (N, 2 * N)}),
    "data_set.spread": lambda on, _: data_set.spread(
        on, {"car": N, "bus": 2 * N}, words="ratio of target to noise, dB", of="targets"
    ),
    "detections.maps": lambda on, _: detections.maps(
        on, [[DECIDED, DECIDED]], target=Place(np.array(3.0), np.array(3.0)), reach=(2, 2)
    ),
    "detections.thresholds": lambda on, _: detections.thresholds(
        on, [CUT, CUT], around_m=3, reach_m=2
    ),
    "detectors.beside_each_other": lambda on, _: detectors.beside_each_other(on),
    "diagrams.data_flow": lambda on, _: diagrams.data_flow(on),
    "diagrams.demodulator": lambda on, _: diagrams.demodulator(on),
    "directions.range_azimuth": lambda on, of: directions.range_azimuth(
        on,
        directions.RangeAzimuth(
            power=range_azimuth_map(of.cube.isel(frame=0), RADAR, of.chain),
            units="sqrt(W)",
            found=(of.found.azimuth.values, of.found.range.values),
        ),
    ),
    "directions.spectrum": lambda on, of: directions.spectrum(
        on,
        angle_spectrum(of.cube.isel(frame=0), RADAR, of.found, 0, of.chain),
        found=of.towards,
        truth=of.towards,
    ),
    "directions.spectrum over both": lambda on, of: directions.spectrum(
        on,
        xr.DataArray(
            np.ones((5, 5)),
            dims=("elevation", "azimuth"),
            coords={"elevation": N / 9 - 0.3, "azimuth": N / 9 - 0.3},
        ),
        found=of.towards,
    ),
    "frames.over_time": lambda on, of: frames.over_time(
        on, of.found, variable="velocity", truth=(N, N[None])
    ),
    "range_doppler.whole": lambda on, of: range_doppler.whole(on, of.marked),
    "range_doppler.whole_over_noise": lambda on, of: range_doppler.whole_over_noise(
        on, of.marked, highest_db=60.0
    ),
    "range_doppler.close_up": lambda on, of: range_doppler.close_up(on, of.marked, cell=(32, 40)),
    "rates.over_design": lambda on, _: rates.over_design(
        on, [rates.Rates(name="mean", checks=[RATE]), rates.Rates(name="rank", checks=[RATE])]
    ),
    "recorded.first_map": lambda on, of: recorded.first_map(on, of.result.power, units="sqrt(W)"),
    "recorded.first_map of one chirp": lambda on, of: recorded.first_map(
        on, of.result.power.isel(velocity=[0]), units="full scale"
    ),
    "recorded.points_from_above": lambda on, _: recorded.points_from_above(on, POINTS),
    "scene.from_above": lambda on, of: scene.from_above(
        on, of.result.scenario.scene, detected_m=[12.0], seen=of.seen
    ),
    "spectrogram.over_time": lambda on, of: spectrogram.over_time(
        on, spectrogram_of(of.cube, RADAR, n_window=16)
    ),
    "study.over": lambda on, _: study.over(on, [LINE], x=RCS, y=SHARE, is_ratio=True, limits=[0.5]),
    "study.scattered": lambda on, _: study.scattered(on, [LINE], x=RCS, y=ERROR, is_ratio=False),
    "study.columns": lambda on, _: study.columns(
        on, [LINE], [f"window {n}" for n in N], x=study.Axis(words="range window"), y=SHARE,
        is_ratio=True,
    ),
    "heat.heat": lambda on, _: heat.heat(
        on, N, N, np.outer(N, N) / 30, axes_words=(RCS, ERROR), words=SHARE.words, is_ratio=True
    ),
    "operating.operating": lambda on, _: operating.operating(
        on, [OPERATING], x="false alarm probability", y=SHARE.words
    ),
    "tracks.from_above": lambda on, _: tracks.from_above(on, [TRACK], AROUND),
    "tuned.traded": lambda on, _: tuned.traded(on, SEARCH),
    "tuned.traded without a limit": lambda on, _: tuned.traded(
        on, SEARCH | {"aim": SEARCH["aim"] | {"limits": []}}
    ),
    "twin.cut": lambda on, of: twin.cut(
        on, of.result.power, of.result.power, along="velocity", cell=(32, 40), units="sqrt(W)"
    ),
    "twin.noise": lambda on, _: twin.noise(
        on, [{"range_m": n, "recorded_db": -n, "twin_db": None} for n in N], unit="dBm"
    ),
    "twin.apart": lambda on, _: twin.apart(on, [PEAK, PEAK | {"judged": False}], within_db=1.0),
    "waveform.frequencies": lambda on, _: waveform.frequencies(
        on, start_frequency_hz=77e9, bandwidth_hz=150e6, chirp_duration_s=7.3e-6,
        delay_s=0.33e-6, beat_frequency_hz=6.8e6,
    ),
    "waveform.spectrogram": lambda on, _: waveform.spectrogram(
        on, TONE, TONE, 10e6, slope_hz_per_s=1e12, highest_beat_hz=3e6
    ),
    "window.cells": lambda on, _: window.cells(
        on, Ring(n_training=Cells(range=4, velocity=2), n_guard=Cells(range=1, velocity=1)),
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
    axes = range_doppler.whole(figure.subplots(), known.marked)

    assert figure.get_layout_engine() is None
    assert axes.spines["top"].get_visible()
    assert all("pyplot" not in path.read_text() for path in Path(figures.__path__[0]).iterdir()
               if path.suffix == ".py")  # fmt: skip


def test_a_page_tells_those_who_cannot_see_what_all_panels_show(known):
    drawn = svg(lambda figure: beat.whole_signal(figure, known.cube))

    assert drawn.startswith('<svg viewBox="0 0 ')
    said = re.search(r'aria-label="([^"]*)"', drawn)[1]
    assert said.split("; ") == [
        f"Beat signal of the first chirp over time, {part} part" for part in ("real", "imaginary")
    ]


def test_rows_of_a_legend_make_a_figure_of_a_page_higher_not_its_axes_lower():
    many = [study.Line(**vars(LINE) | {"name": f"ordered statistic {n}"}) for n in range(6)]

    def drawn(lines):
        return svg(
            lambda figure: study.over(figure.subplots(), lines, x=RCS, y=SHARE, is_ratio=True)
        )

    def height(page):
        return float(re.search(r'viewBox="0 0 [\d.]+ ([\d.]+)"', page)[1]) / 72

    assert height(drawn(many[:1])) == pytest.approx(3.2, abs=0.01)
    assert 3.4 < height(drawn(many)) < 4.2


def test_a_picture_is_as_wide_as_the_figure_and_says_what_it_shows(known):
    made = png(lambda figure: recorded.first_map(figure.subplots(), known.result.power,
                                                 units="sqrt(W)"), title="a")  # fmt: skip
    assert made.startswith(b"\x89PNG")
    assert int.from_bytes(made[16:20]) == round(300 * WIDTH_IN)
    assert b"Range-Doppler map" in made
