"""What lines and tables hold is the physics of the moment; a row that is picked is looked at."""

from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.models import Image

from dechirp.core.units import SPEED_OF_LIGHT, from_decibels, to_decibels
from dechirp.processing.range_doppler_map import threshold_map
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, range_doppler_map_position
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.frame_state import FrameState
from dechirp.studio.scenario_edits import PageLimits, apply_options, parse_scenario
from dechirp.studio.session import Session
from dechirp.studio.theme import DARK, LIGHT
from dechirp.studio.views.beat import BeatView
from dechirp.studio.views.detections import DetectionsView
from dechirp.studio.views.figure_style import SPAN_DB
from dechirp.studio.views.micro_doppler import MicroDopplerView
from dechirp.studio.views.table_tile import MAX_ROWS
from dechirp.studio.views.threshold_cuts import ThresholdCutView
from dechirp.studio.views.tracks import TracksView

# Cells of 1 m and 0.61 m/s, to 64 m and 19 m/s; a beam of 13 degrees.
SETTINGS = """
name: post-and-car
seed: 5
n_frames: 20
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 15 MHz/us, adc_start: 1 us, ramp_duration: 11 us,
            sample_rate: 6.4 MHz, n_samples: 64, sampling: complex}
    n_chirps: 64
    interval: 50 us
    period: 50 ms
  array:
    rx: [[0, 0, 0], [0, 1.94 mm, 0], [0, 3.88 mm, 0], [0, 5.82 mm, 0],
         [0, 7.76 mm, 0], [0, 9.7 mm, 0], [0, 11.64 mm, 0], [0, 13.58 mm, 0]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 12 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: post, position: [30 m, 0, 0], rcs: 15 dBsm}
    - {name: car, position: [42 m, 10 m, 0], velocity: [-6 m/s, 0, 0], rcs: 15 dBsm}
tracker: {}
"""
LIMITS = PageLimits()


def session_of(*options: str) -> Session:
    """A page without a browser."""
    return Session(
        Document(), None, apply_options(parse_scenario(SETTINGS, LIMITS), options, LIMITS), LIMITS
    )


def shown(view, *, step: int = 0, cursor: Cursor | None = None) -> FrameState:
    """A moment after all steps before it, as the view was shown it."""
    player = FramePlayer(view.session.scenario)
    for earlier in range(step):
        player.frame_at(earlier, cursor)
    view.session.frame_state = player.frame_at(step, cursor)
    view.show_frame(view.session.frame_state)
    view.update_caption(view.session.frame_state)
    return view.session.frame_state


def line(figure, name: str) -> dict[str, np.ndarray]:
    return figure.select_one({"name": name}).data_source.data


def switched_to(view, words: str) -> None:
    view.tile.switch.active = view.tile.switch.labels.index(words)


def row_of(table: dict[str, np.ndarray], number: int) -> dict[str, object]:
    return {key: column[number] for key, column in table.items()}


def test_the_beat_spectrum_peaks_at_two_slopes_times_range_over_c():
    view = BeatView(session_of("scene.targets.1.rcs=-50 dBsm"))
    switched_to(view, "Spectrum")
    chirp = shown(view).radar.frame.chirp

    spectrum = line(view.spectrum.figure, "mean")

    beat_mhz = 2 * chirp.slope_hz_per_s * 30 / SPEED_OF_LIGHT / 1e6
    bin_mhz = chirp.sample_rate_hz / chirp.n_samples / 1e6
    assert spectrum["x"][spectrum["y"].argmax()] == pytest.approx(beat_mhz, abs=bin_mhz / 2)
    assert view.tile.title.text == "<b>Strongest: 3 MHz, 30 m</b>"
    # The upper scale tells the range of each frequency.
    metres, mhz = view.spectrum.figure.extra_x_ranges["metres"], view.spectrum.figure.x_range
    assert metres.end / mhz.end == pytest.approx(30 / beat_mhz)


def test_the_profile_has_no_image_where_ramps_rise_and_fall():
    moment = shown(
        BeatView(
            session_of("radar.frame.modulation.kind=triangular", "scene.targets.1.rcs=-50 dBsm")
        )
    )

    profile, range_m = moment.beat.profile, moment.beat.range_m
    assert range_m[profile.argmax()] == pytest.approx(30, abs=0.5)
    image_m = range_m[-1] + range_m[1] - 30  # where a falling ramp alone would show the post
    assert profile[abs(range_m - image_m) < 2].max() < 0.03 * profile.max()


def test_the_beat_signal_is_what_the_first_receiver_samples_of_the_first_chirp():
    view = BeatView(session_of())
    moment = shown(view)

    real, imaginary = (line(view.signal.figure, name) for name in ("real", "imaginary"))

    first = moment.samples.isel(chirp=0, rx=0)
    unit = view.signal.figure.yaxis[0].axis_label
    assert unit == "amplitude, 10⁻⁶ √W"
    np.testing.assert_allclose(real["y"] + 1j * imaginary["y"], first.values * 1e6, rtol=1e-5)
    chirp = moment.radar.frame.chirp
    at_us = (chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz) * 1e6
    np.testing.assert_allclose(real["x"], at_us, rtol=1e-6)


def test_a_switch_shows_the_other_figure_of_the_same_moment_at_once():
    session = session_of()
    beat, cut = BeatView(session), ThresholdCutView(session)
    shown(beat)

    for view, words, figure in (
        (beat, "Spectrum", beat.spectrum.figure),
        (cut, "Velocity", cut.drawings["velocity"].figure),
    ):
        assert not figure.visible
        switched_to(view, words)
        assert figure.visible
        assert max(len(one.data_source.data.get("y", ())) for one in figure.renderers) == 64


def test_a_real_mixer_has_no_quadrature():
    view = BeatView(session_of("radar.frame.chirp.sampling=real"))
    shown(view)

    assert line(view.signal.figure, "real")["y"].size
    assert not len(line(view.signal.figure, "imaginary")["y"])


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("words", "along"), [("Range", "range"), ("Velocity", "velocity")])
def test_the_cut_is_a_line_of_the_map_and_of_its_threshold(words, along, sampling):
    view = ThresholdCutView(session_of(f"radar.frame.chirp.sampling={sampling}"))
    switched_to(view, words)
    moment = shown(view)

    figure = view.drawings[along].figure
    threshold = threshold_map(moment.power, moment.radar, moment.chain)
    across, at = {
        "range": ("velocity", moment.cursor.velocity_m_per_s),
        "velocity": ("range", moment.cursor.range_m),
    }[along]
    for name, of in (("power", moment.power), ("threshold", threshold)):
        through = of.sel({across: at}, method="nearest")
        expected_dbm = np.where(np.isfinite(through), to_decibels(through.values) + 30, np.nan)
        drawn = line(figure, name)
        np.testing.assert_allclose(drawn["x"], through[along].values, rtol=1e-6)
        np.testing.assert_allclose(drawn["y"], expected_dbm, rtol=1e-5)


def test_the_title_of_the_cut_tells_how_far_the_cell_is_over_the_threshold():
    view = ThresholdCutView(session_of())
    moment = shown(view)

    at = {"range": moment.cursor.range_m, "velocity": moment.cursor.velocity_m_per_s}
    power = moment.power.sel(at, method="nearest")
    threshold = threshold_map(moment.power, moment.radar, moment.chain).sel(at, method="nearest")
    over_db = float(to_decibels(power / threshold))

    assert over_db > 0
    assert view.tile.title.text == f"<b>{over_db:.1f} dB over the threshold</b>"
    shown(view, cursor=Cursor(range_m=20.0, velocity_m_per_s=12.0))
    assert view.tile.title.text.endswith(" dB under the threshold</b>")


def test_cells_beside_the_cursor_are_shaded_as_many_as_train():
    view = ThresholdCutView(
        session_of("chain.cfar.n_training.range=6", "chain.cfar.n_guard.range=2")
    )
    moment = shown(view)

    figure = view.drawings["range"].figure
    training, guard = (line(figure, name) for name in ("training", "guard"))
    cell_m = moment.radar.frame.chirp.range_resolution_m

    np.testing.assert_allclose((training["right"] - training["left"]) / cell_m, [6, 6], rtol=1e-3)
    np.testing.assert_allclose((guard["right"] - guard["left"]) / cell_m, [5], rtol=1e-3)
    assert guard["left"][0] < moment.cursor.range_m < guard["right"][0]


def test_a_tap_on_a_line_moves_the_cursor_along_its_axis_alone():
    session = session_of()
    beat, cut = BeatView(session), ThresholdCutView(session)
    moment = shown(cut)
    switched_to(beat, "Spectrum")
    chirp = moment.radar.frame.chirp

    for figure, x, expected in (
        (beat.spectrum.figure, chirp.beat_frequency_hz(20) / 1e6, {"range_m": 20}),
        (cut.drawings["range"].figure, 17, {"range_m": 17}),
    ):
        figure._trigger_event(Tap(figure, sx=0, sy=0, x=x, y=0))
        assert session.cursor == pytest.approx(moment.cursor._replace(**expected))
    switched_to(cut, "Velocity")
    figure = cut.drawings["velocity"].figure
    figure._trigger_event(Tap(figure, sx=0, sy=0, x=-3, y=0))
    assert session.cursor == pytest.approx(moment.cursor._replace(velocity_m_per_s=-3))


def test_lines_take_the_colours_of_the_theme():
    view = ThresholdCutView(session_of())
    for theme in (LIGHT, DARK):
        view.apply_theme(theme)
        figure = view.drawings["range"].figure
        assert figure.select_one({"name": "power"}).glyph.line_color == theme.echo
        assert figure.select_one({"name": "threshold"}).glyph.line_color == theme.threshold
        assert figure.background_fill_color == theme.tile


WALKING = """
name: walking
seed: 1
n_frames: 14
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 20 MHz/us, adc_start: 4 us, ramp_duration: 30 us,
            sample_rate: 5 MHz, n_samples: 64, sampling: complex}
    n_chirps: 256
    interval: 150 us
  array: {rx: [[0, 0, 0]]}
  hardware: {transmit_power: 12 dBm, antenna_gain: 12 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: walker, position: [8 m, 0, -0.6 m], velocity: [1.4 m/s, 0, 0],
       body: {kind: pedestrian, speed: 1.4 m/s}}
"""


def test_the_spectrogram_of_a_walking_body_has_its_velocity():
    view = MicroDopplerView(Session(Document(), None, parse_scenario(WALKING, LIMITS), LIMITS))
    moment = shown(view, step=13)

    (image,) = view.image.data["image"]
    (glyph,) = (one.glyph for one in view.figure.renderers if isinstance(one.glyph, Image))
    height = glyph.dh / image.shape[0]
    middle_m_per_s = glyph.y + height * (np.arange(image.shape[0]) + 0.5)
    below_db = (image / 255 - 1) * SPAN_DB
    powers = np.where(below_db > -25, from_decibels(below_db), 0.0)  # over all noise
    mean_m_per_s = middle_m_per_s @ powers.sum(axis=1) / powers.sum()

    assert image.dtype == np.uint8
    assert image.shape[1] == 14
    # Limbs swing about the velocity of the trunk.
    assert mean_m_per_s == pytest.approx(1.4, abs=0.25)
    assert glyph.x + glyph.dw == pytest.approx(
        moment.time_s + moment.radar.frame.duration_s / 2, abs=1e-3
    )


def test_the_table_of_detections_tells_degrees_and_decibels_strongest_first():
    view = DetectionsView(session_of())
    moment = shown(view)
    table, found = view.table.source.data, moment.detections

    order = np.argsort(-found.snr.values)
    for key, expected in {
        "range": found.range,
        "range_std": found.range_std,
        "velocity": found.velocity,
        "velocity_std": found.velocity_std,
        "azimuth": np.degrees(found.azimuth),
        "azimuth_std": np.degrees(found.azimuth_std),
        "snr": to_decibels(found.snr),
    }.items():
        np.testing.assert_allclose(table[key], expected.values[order])
    car = row_of(table, table["target"].tolist().index("car"))
    assert car["range"] == pytest.approx(np.hypot(42, 10), abs=4 * car["range_std"])
    assert car["azimuth"] == pytest.approx(np.degrees(np.arctan2(10, 42)), abs=0.5)
    heads = {one.field: one.title for one in view.table.table.columns}
    assert heads["azimuth"] == "azimuth, °"
    assert heads["snr"] == "SNR (dB)"


def test_the_title_of_the_table_counts_what_is_found_and_what_is_not():
    view = DetectionsView(session_of("scene.targets.1.rcs=-60 dBsm"))
    shown(view)

    assert view.table.title.text == "<b>1 detection: 1 of 2 targets found, 0 of no target</b>"
    assert view.table.source.data["target"].tolist() == ["post"]


def test_where_nothing_is_detected_the_title_says_so():
    view = DetectionsView(
        session_of("scene.targets.0.rcs=-90 dBsm", "scene.targets.1.rcs=-90 dBsm")
    )
    shown(view)

    assert view.table.title.text == "<b>Nothing detected: 0 of 2 targets found</b>"


def test_nobody_knows_whose_the_detections_of_a_recording_are():
    view = DetectionsView(session_of())
    known = shown(view)
    view.show_frame(replace(known, truth=None))

    visible = {one.field: one.visible for one in view.table.table.columns}
    assert not visible["target"]
    assert visible["azimuth"]
    n = known.detections.sizes["detection"]
    assert view.table.title.text == f"<b>{n} detections</b>"


def test_a_row_that_is_picked_moves_the_cursor_to_its_peak_on_the_map():
    view = DetectionsView(session_of("scene.targets.1.velocity.0=-32 m/s"))  # beyond 19 m/s: folded
    moment = shown(view)
    row = view.table.source.data["target"].tolist().index("car")

    view.table.source.selected.indices = [row]

    cursor = view.session.cursor
    car = moment.truth.sel(target="car").squeeze()
    seen = range_doppler_map_position(
        alias_range_velocity(RangeVelocity(car.range.values, car.velocity.values), moment.radar),
        moment.radar,
    )
    assert cursor.range_m == pytest.approx(float(seen.range_m), abs=0.5)
    assert cursor.velocity_m_per_s == pytest.approx(float(seen.velocity_m_per_s), abs=0.3)
    assert abs(cursor.velocity_m_per_s) < moment.radar.frame.max_velocity_m_per_s


def test_the_row_at_the_cursor_is_marked_and_marking_it_does_not_move_the_cursor():
    view = DetectionsView(session_of())
    moment = shown(view)

    assert view.table.source.selected.indices == [0]  # it starts at the strongest
    assert view.session.cursor is None
    shown(view, cursor=Cursor(moment.cursor.range_m - 20, moment.cursor.velocity_m_per_s))
    assert view.table.source.selected.indices == []
    assert view.session.cursor is None


def test_of_more_detections_than_fit_the_strongest_are_shown():
    view = DetectionsView(session_of("chain.cfar.false_alarm_probability=0.1"))
    moment = shown(view)
    n = moment.detections.sizes["detection"]
    assert n > MAX_ROWS

    table = view.table.source.data

    assert all(len(column) == MAX_ROWS for column in table.values())
    assert table["snr"][0] == pytest.approx(float(to_decibels(moment.detections.snr.max())))
    assert f"The strongest {MAX_ROWS} of {n} detections" in view.table.title.text


def test_the_table_of_tracks_tells_where_targets_are_and_where_they_go():
    view = TracksView(session_of())
    moment = shown(view, step=8)
    table = view.table.source.data

    car = row_of(table, int(np.argmin(table["vx"])))
    gone_s = moment.time_s
    assert car["status"] == "confirmed"
    for key, expected in {"x": 42 - 6 * gone_s, "y": 10.0, "vx": -6.0}.items():
        assert car[key] == pytest.approx(expected, abs=4 * car[f"{key}_std"])
    assert car["velocity"] == pytest.approx(-6 * np.cos(np.arctan2(10, 42)), abs=0.3)
    assert view.table.title.text == "<b>2 tracks confirmed, 0 tentative</b>"
    post = int(np.argmax(table["vx"]))
    view.table.source.selected.indices = [1 - post]
    view.table.source.selected.indices = [post]
    assert view.session.cursor.range_m == pytest.approx(30, abs=0.5)


def test_without_a_tracker_the_table_says_why_it_is_empty():
    view = TracksView(session_of("tracker=null"))
    shown(view)

    assert view.table.title.text == "<b>No tracks: the settings have no tracker (Processing)</b>"
    assert len(view.table.source.data["x"]) == 0
