"""Line and table views: beat signal, cuts, micro-Doppler, detections and tracks."""

from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.models import Image

from dechirp.core.text import decimals_for_std, format_fixed
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels, to_decibels
from dechirp.processing.range_doppler_map import threshold_map
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, range_doppler_map_position
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.frame_state import FrameState
from dechirp.studio.scenario_edits import PageLimits, apply_overrides, parse_scenario
from dechirp.studio.session import Session
from dechirp.studio.theme import DARK, LIGHT
from dechirp.studio.views.beat import BeatView
from dechirp.studio.views.detections import DetectionsView
from dechirp.studio.views.figure_style import SPAN_DB
from dechirp.studio.views.micro_doppler import MicroDopplerView
from dechirp.studio.views.table_tile import MAX_ROWS
from dechirp.studio.views.threshold_cuts import ThresholdCutView
from dechirp.studio.views.tracks import TracksView
from html_tree import parse_html
from nightly import nightly

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


def build_session(*options: str) -> Session:
    """Build a page session without a browser."""
    return Session(
        Document(), None, apply_overrides(parse_scenario(SETTINGS, LIMITS), options, LIMITS), LIMITS
    )


def show_step(view, *, step: int = 0, cursor: Cursor | None = None) -> FrameState:
    """Show one step in a view, after all earlier steps; return its frame state."""
    player = FramePlayer(view.session.scenario)
    for earlier_step in range(step):
        player.process_frame_at_step(earlier_step, cursor)
    view.session.frame_state = player.process_frame_at_step(step, cursor)
    view.show_frame(view.session.frame_state)
    view.update_caption(view.session.frame_state)
    return view.session.frame_state


def get_line_data(figure, name: str) -> dict[str, np.ndarray]:
    return figure.select_one({"name": name}).data_source.data


def select_figure(view, label: str) -> None:
    view.tile.switch.active = view.tile.switch.labels.index(label)


def get_row(table: dict[str, np.ndarray], number: int) -> dict[str, object]:
    return {key: column[number] for key, column in table.items()}


def test_beat_spectrum_peaks_at_beat_frequency_of_target():
    view = BeatView(build_session("scene.targets.1.rcs=-50 dBsm"))
    select_figure(view, "Spectrum")
    chirp = show_step(view).radar.frame.chirp

    spectrum = get_line_data(view.spectrum.figure, "mean")

    beat_mhz = 2 * chirp.slope_hz_per_s * 30 / SPEED_OF_LIGHT / 1e6
    bin_mhz = chirp.sample_rate_hz / chirp.n_samples / 1e6
    assert spectrum["x"][spectrum["y"].argmax()] == pytest.approx(beat_mhz, abs=bin_mhz / 2)
    assert view.caption.title == "Strongest: 3 MHz, 30 m"
    # The upper axis is in range.
    metres, mhz = view.spectrum.figure.extra_x_ranges["metres"], view.spectrum.figure.x_range
    assert metres.end / mhz.end == pytest.approx(30 / beat_mhz)


def test_range_profile_of_triangular_ramps_has_no_image():
    frame_state = show_step(
        BeatView(
            build_session("radar.frame.modulation.kind=triangular", "scene.targets.1.rcs=-50 dBsm")
        )
    )

    profile, range_m = frame_state.beat_and_spectrum.profile, frame_state.beat_and_spectrum.range_m
    assert range_m[profile.argmax()] == pytest.approx(30, abs=0.5)
    image_m = range_m[-1] + range_m[1] - 30  # image of the post in a falling ramp alone
    assert profile[abs(range_m - image_m) < 2].max() < 0.03 * profile.max()


def test_beat_signal_shows_samples_of_first_receiver_and_chirp():
    view = BeatView(build_session())
    frame_state = show_step(view)

    real, imaginary = (get_line_data(view.signal.figure, name) for name in ("real", "imaginary"))

    chirp_samples = frame_state.samples.isel(chirp=0, rx=0)
    unit = view.signal.figure.yaxis[0].axis_label
    assert unit == "Amplitude (10⁻⁶ √W)"
    np.testing.assert_allclose(
        real["y"] + 1j * imaginary["y"], chirp_samples.values * 1e6, rtol=1e-5
    )
    chirp = frame_state.radar.frame.chirp
    times_us = (chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz) * 1e6
    np.testing.assert_allclose(real["x"], times_us, rtol=1e-6)


def test_switch_shows_other_figure_of_same_frame_immediately():
    session = build_session()
    beat, cut = BeatView(session), ThresholdCutView(session)
    show_step(beat)

    for view, label, figure in (
        (beat, "Spectrum", beat.spectrum.figure),
        (cut, "Velocity", cut.drawings["velocity"].figure),
    ):
        assert not figure.visible
        select_figure(view, label)
        assert figure.visible
        assert (
            max(len(renderer.data_source.data.get("y", ())) for renderer in figure.renderers) == 64
        )


def test_real_sampling_has_no_quadrature_line():
    view = BeatView(build_session("radar.frame.chirp.sampling=real"))
    show_step(view)

    assert get_line_data(view.signal.figure, "real")["y"].size
    assert not len(get_line_data(view.signal.figure, "imaginary")["y"])


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("label", "axis"), [("Range", "range"), ("Velocity", "velocity")])
def test_cut_equals_row_or_column_of_map_and_threshold(label, axis, sampling):
    view = ThresholdCutView(build_session(f"radar.frame.chirp.sampling={sampling}"))
    select_figure(view, label)
    frame_state = show_step(view)

    figure = view.drawings[axis].figure
    threshold = threshold_map(frame_state.power, frame_state.radar, frame_state.chain)
    other_axis, cursor_position = {
        "range": ("velocity", frame_state.cursor.velocity_m_per_s),
        "velocity": ("range", frame_state.cursor.range_m),
    }[axis]
    for name, values in (("power", frame_state.power), ("threshold", threshold)):
        cut = values.sel({other_axis: cursor_position}, method="nearest")
        expected_dbm = np.where(np.isfinite(cut), to_decibels(cut.values) + 30, np.nan)
        drawn_line = get_line_data(figure, name)
        np.testing.assert_allclose(drawn_line["x"], cut[axis].values, rtol=1e-6)
        np.testing.assert_allclose(drawn_line["y"], expected_dbm, rtol=1e-5)


def test_cut_title_gives_margin_to_threshold():
    view = ThresholdCutView(build_session())
    frame_state = show_step(view)

    cell = {"range": frame_state.cursor.range_m, "velocity": frame_state.cursor.velocity_m_per_s}
    power = frame_state.power.sel(cell, method="nearest")
    threshold = threshold_map(frame_state.power, frame_state.radar, frame_state.chain).sel(
        cell, method="nearest"
    )
    margin_db = float(to_decibels(power / threshold))

    assert margin_db > 0
    assert view.caption.title == f"{margin_db:.1f} dB over the threshold"
    show_step(view, cursor=Cursor(range_m=20.0, velocity_m_per_s=12.0))
    assert view.caption.title.endswith(" dB under the threshold")


def test_threshold_is_shown_below_echoes_that_fill_the_cut():
    view = ThresholdCutView(build_session())
    frame_state = show_step(view)
    over_range, over_velocity = frame_state.cuts_through_cursor
    strong = np.full_like(over_range.power, 1e-9)  # 50 dB over a threshold along velocity
    frame_state.__dict__["cuts_through_cursor"] = (
        over_range._replace(power=strong, threshold=1e-5 * strong),
        over_velocity,
    )
    view.show_frame(frame_state)

    figure = view.drawings["range"].figure
    threshold_dbm = get_line_data(figure, "threshold")["y"]
    assert figure.y_range.start < np.nanmin(threshold_dbm) < figure.y_range.end


def test_shaded_spans_match_training_and_guard_cells():
    view = ThresholdCutView(
        build_session("chain.cfar.n_training.range=6", "chain.cfar.n_guard.range=2")
    )
    frame_state = show_step(view)

    figure = view.drawings["range"].figure
    training, guard = (get_line_data(figure, name) for name in ("training", "guard"))
    cell_m = frame_state.radar.frame.chirp.range_resolution_m

    np.testing.assert_allclose((training["right"] - training["left"]) / cell_m, [6, 6], rtol=1e-3)
    np.testing.assert_allclose((guard["right"] - guard["left"]) / cell_m, [5], rtol=1e-3)
    assert guard["left"][0] < frame_state.cursor.range_m < guard["right"][0]


def test_tap_on_line_moves_cursor_along_its_axis_only():
    session = build_session()
    beat, cut = BeatView(session), ThresholdCutView(session)
    frame_state = show_step(cut)
    select_figure(beat, "Spectrum")
    chirp = frame_state.radar.frame.chirp

    for figure, x, expected in (
        (beat.spectrum.figure, chirp.beat_frequency_hz(20) / 1e6, {"range_m": 20}),
        (cut.drawings["range"].figure, 17, {"range_m": 17}),
    ):
        figure._trigger_event(Tap(figure, sx=0, sy=0, x=x, y=0))
        assert session.cursor == pytest.approx(frame_state.cursor._replace(**expected))
    select_figure(cut, "Velocity")
    figure = cut.drawings["velocity"].figure
    figure._trigger_event(Tap(figure, sx=0, sy=0, x=-3, y=0))
    assert session.cursor == pytest.approx(frame_state.cursor._replace(velocity_m_per_s=-3))


def test_lines_use_theme_colours():
    view = ThresholdCutView(build_session())
    for theme in (LIGHT, DARK):
        view.apply_theme(theme)
        figure = view.drawings["range"].figure
        assert figure.select_one({"name": "power"}).glyph.line_color == theme.echo
        assert figure.select_one({"name": "threshold"}).glyph.line_color == theme.threshold
        assert figure.outline_line_color == theme.rule


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


def test_spectrogram_of_walking_body_has_its_mean_velocity():
    view = MicroDopplerView(Session(Document(), None, parse_scenario(WALKING, LIMITS), LIMITS))
    frame_state = show_step(view, step=13)

    (image,) = view.image.data["image"]
    (glyph,) = (
        renderer.glyph for renderer in view.figure.renderers if isinstance(renderer.glyph, Image)
    )
    height = glyph.dh / image.shape[0]
    velocities_m_per_s = glyph.y + height * (np.arange(image.shape[0]) + 0.5)
    levels_db = (image / 255 - 1) * SPAN_DB
    powers = np.where(levels_db > -25, from_decibels(levels_db), 0.0)  # excludes noise
    mean_m_per_s = velocities_m_per_s @ powers.sum(axis=1) / powers.sum()

    assert image.dtype == np.uint8
    assert image.shape[1] == 14
    # Limbs oscillate around the velocity of the trunk.
    assert mean_m_per_s == pytest.approx(1.4, abs=0.25)
    assert glyph.x + glyph.dw == pytest.approx(
        frame_state.time_s + frame_state.radar.frame.duration_s / 2, abs=1e-3
    )


def test_detection_table_uses_degrees_and_decibels_strongest_first():
    view = DetectionsView(build_session())
    frame_state = show_step(view)
    table, detections = view.table.columns, frame_state.detections

    order = np.argsort(-detections.snr.values)
    for key, expected in {
        "range": detections.range,
        "range_std": detections.range_std,
        "velocity": detections.velocity,
        "velocity_std": detections.velocity_std,
        "azimuth": np.degrees(detections.azimuth),
        "azimuth_std": np.degrees(detections.azimuth_std),
        "snr": to_decibels(detections.snr),
    }.items():
        # Standard errors are texts, rounded to the decimals of the table.
        rounding = 0.0
        if key.endswith("_std"):
            rounding = 0.51 * 10.0 ** -len(table[key][0].partition(".")[2])
        np.testing.assert_allclose(table[key].astype(float), expected.values[order], atol=rounding)
    car = get_row(table, table["target"].tolist().index("car"))
    assert car["range"] == pytest.approx(np.hypot(42, 10), abs=4 * float(car["range_std"]))
    assert car["azimuth"] == pytest.approx(np.degrees(np.arctan2(10, 42)), abs=0.5)
    headings = view.table.shown_headings
    assert headings["azimuth"].title == "Azimuth (°)"
    assert headings["snr"].title == "SNR (dB)"
    for key in ("range", "velocity"):
        # Two digits of a hundredth of a resolution cell, which the smallest error is below.
        cell = np.diff(frame_state.power[key].values[:2]).item()
        assert detections[f"{key}_std"].min() < cell / 100
        n_decimals = decimals_for_std(cell / 100)
        assert {len(text.partition(".")[2]) for text in table[f"{key}_std"]} == {n_decimals}
        assert f"<td>{format_fixed(float(table[key][0]), n_decimals)}</td>" in view.table.table.text


def test_detection_table_writes_motion_in_words():
    view = DetectionsView(build_session())
    frame_state = show_step(view)
    order = np.argsort(frame_state.detections.snr.values)
    motion = np.full(order.size, np.nan)
    motion[order[-1]], motion[order[-2]] = 0.0, 1.0
    detections = frame_state.detections.assign(moving=("detection", motion))
    view.show_frame(replace(frame_state, detections=detections))

    assert view.table.columns["moving"].tolist()[:3] == ["no", "yes", ""][: order.size]
    assert "moving" in view.table.shown_headings


def test_detection_table_title_counts_detected_and_missed_targets():
    view = DetectionsView(build_session("scene.targets.1.rcs=-60 dBsm"))
    show_step(view)

    assert view.table.title.text == (
        "<b>1 detection: 1 of 2 targets found at the true range, 0 of no target</b>"
    )
    assert view.table.columns["target"].tolist() == ["post"]


def test_target_beyond_largest_range_is_aliased_and_not_found():
    largest_m = build_session().scenario.radar.frame.chirp.max_range_m
    beyond = f"[{1.75 * largest_m} m, 0 m, 0 m]"  # appears at 0.75 of it
    view = DetectionsView(
        build_session(f"scene.targets.1.position={beyond}", "scene.targets.1.rcs=30 dBsm")
    )
    table = show_step(view)

    names = view.table.columns["target"].tolist()
    assert "car (aliased)" in names and "post" in names
    aliased = view.table.columns["range"][names.index("car (aliased)")]
    true_m = float(table.truth["range"].sel(target="car").item())
    assert true_m > largest_m > aliased
    title = view.table.title.text
    assert "1 of 2 targets found at the true range, " in title
    assert f"{names.count('car (aliased)')} aliased to a wrong range" in title


def test_detection_table_title_states_that_nothing_is_detected():
    view = DetectionsView(
        build_session("scene.targets.0.rcs=-90 dBsm", "scene.targets.1.rcs=-90 dBsm")
    )
    show_step(view)

    assert view.table.title.text == "<b>Nothing detected: 0 of 2 targets found</b>"


def test_detection_table_of_recording_has_no_target_column():
    view = DetectionsView(build_session())
    frame_state = show_step(view)
    view.show_frame(replace(frame_state, truth=None))

    assert "target" not in view.table.shown_headings
    assert "azimuth" in view.table.shown_headings
    n = frame_state.detections.sizes["detection"]
    assert view.table.title.text == f"<b>{n} detections</b>"


def test_selected_row_moves_cursor_to_its_peak_on_map():
    # Beyond 19 m/s: aliased.
    view = DetectionsView(build_session("scene.targets.1.velocity.0=-32 m/s"))
    frame_state = show_step(view)
    row = view.table.columns["target"].tolist().index("car")

    view.table.picked.row = row

    cursor = view.session.cursor
    car = frame_state.truth.sel(target="car").squeeze()
    expected = range_doppler_map_position(
        alias_range_velocity(
            RangeVelocity(car.range.values, car.velocity.values), frame_state.radar
        ),
        frame_state.radar,
    )
    assert cursor.range_m == pytest.approx(float(expected.range_m), abs=0.5)
    assert cursor.velocity_m_per_s == pytest.approx(float(expected.velocity_m_per_s), abs=0.3)
    assert abs(cursor.velocity_m_per_s) < frame_state.radar.frame.max_velocity_m_per_s


def test_row_at_cursor_is_selected_without_moving_cursor():
    view = DetectionsView(build_session())
    frame_state = show_step(view)

    assert view.table.selected == 0  # default: the strongest
    assert view.session.cursor is None
    show_step(
        view, cursor=Cursor(frame_state.cursor.range_m - 20, frame_state.cursor.velocity_m_per_s)
    )
    assert view.table.selected is None
    assert view.session.cursor is None


@nightly
def test_full_detection_table_shows_strongest_detections():
    view = DetectionsView(build_session("chain.cfar.false_alarm_probability=0.06"))
    frame_state = show_step(view)
    n = frame_state.detections.sizes["detection"]
    assert n > MAX_ROWS

    table = view.table.columns

    assert all(len(column) == MAX_ROWS for column in table.values())
    assert table["snr"][0] == pytest.approx(float(to_decibels(frame_state.detections.snr.max())))
    assert f"The strongest {MAX_ROWS} of {n} detections" in view.table.title.text


def test_track_table_gives_positions_and_velocities():
    view = TracksView(build_session())
    frame_state = show_step(view, step=8)
    table = view.table.columns

    car = get_row(table, int(np.argmin(table["vx"])))
    elapsed_s = frame_state.time_s
    assert car["status"] == "confirmed"
    for key, expected in {"x": 42 - 6 * elapsed_s, "y": 10.0, "vx": -6.0}.items():
        assert car[key] == pytest.approx(expected, abs=4 * float(car[f"{key}_std"]))
    smallest = min(float(np.sqrt(track.covariance[0][0])) for track in frame_state.tracks)
    two_digits = decimals_for_std(smallest)
    assert 0 < smallest < 0.01 and two_digits > 2  # two fixed decimals would show an error of 0
    assert all(len(std.partition(".")[2]) == two_digits for std in table["x_std"])
    assert car["velocity"] == pytest.approx(-6 * np.cos(np.arctan2(10, 42)), abs=0.3)
    assert view.table.title.text == "<b>2 tracks confirmed, 0 tentative</b>"
    post = int(np.argmax(table["vx"]))
    view.table.picked.row = 1 - post
    view.table.picked.row = post
    assert view.session.cursor.range_m == pytest.approx(30, abs=0.5)


def test_track_table_without_tracker_states_reason():
    view = TracksView(build_session("tracker=null"))
    show_step(view)

    assert view.table.title.text == "<b>No tracks: the settings have no tracker (Processing)</b>"
    assert len(view.table.columns["x"]) == 0


def test_table_is_plain_html_with_one_marked_row_and_escaped_names():
    view = DetectionsView(build_session("scene.targets.1.name=<b>car</b>"))
    show_step(view)
    view.table.picked.row = 1
    (table,) = parse_html(view.table.table.text).descendants("table")

    titles = [head.text for head in table.descendants("th")]
    rows = [[cell.text for cell in row.descendants("td")] for row in table.descendants("tr")][1:]
    assert titles == [heading.title for heading in view.table.shown_headings.values()]
    assert {len(row) for row in rows} == {len(titles)}
    assert "<b>car</b>" in {row[titles.index("target")] for row in rows}
    ranges_m = [float(row[titles.index("Range (m)")]) for row in rows]
    np.testing.assert_allclose(ranges_m, view.table.columns["range"], atol=0.005)
    marked = ["aria-current" in row.attributes for row in table.descendants("tr")]
    assert marked == [False, *(row == 1 for row in range(len(rows)))]


def test_standard_error_below_last_digit_is_no_zero():
    session = build_session("impairments=[]")  # noise of rounding only
    view = DetectionsView(session)
    detections = show_step(view).detections.sortby("range")
    post, car = (detections.isel(detection=index) for index in (0, 1))
    assert float(post.range) == pytest.approx(30, abs=1e-6)
    assert 0 < float(post.range_std) < 1e-6
    # The car passes at 1.4 m/s and accelerates by 1.4^2 / 43 m/s^2, which bends its phase by 2e-4
    # rad (-74 dB) within the frame. No echo of constant velocity has that: it counts as another
    # one, at least half of it in phase: an error of 4e-5 m; the actual one is 7e-8 m.
    assert abs(float(car.range) - np.hypot(42, 10)) < 0.01  # mid-frame
    assert 1e-6 < float(car.range_std) < 1e-4
    # The table shows two digits of a hundredth of a cell of 1 m; an error below the last one is
    # written as one of it, not as zero.
    assert set(view.table.columns["range_std"]) == {"<0.001"}
