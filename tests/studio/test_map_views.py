"""Map views and scene view: levels, positions, cursor, tracks, and dragging of targets."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, PointEvent, Tap

from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.experiments.scenario import Scenario
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene as Targets
from dechirp.scene.target import Target
from dechirp.scene.waypoints import Waypoint
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_player import FramePlayer
from dechirp.studio.frame_state import FrameState
from dechirp.studio.scenario_edits import PageLimits, apply_overrides, parse_scenario
from dechirp.studio.theme import LIGHT
from dechirp.studio.views.figure_style import SPAN_DB, join_lines_with_gaps, power_to_image_levels
from dechirp.studio.views.range_azimuth import RangeAzimuthView
from dechirp.studio.views.range_doppler import RangeDopplerView
from dechirp.studio.views.scene import SceneView, format_position_setting, position_at_time_zero_m
from dechirp.studio.views.tracks import TrackTails
from dechirp.tracking.online import Track
from nightly import nightly

LIMITS = PageLimits()
# Cells of 1 m and 1.2 m/s, to 64 m and 19 m/s; a beam of 13 degrees.
SETTINGS = """
name: one-car
seed: 5
n_frames: 20
radar:
  frame:
    chirp: {start_frequency: 77 GHz, slope: 15 MHz/us, ramp_duration: 11 us, sample_rate: 6.4 MHz,
            n_samples: 64, sampling: complex}
    n_chirps: 32
    interval: 50 us
    period: 50 ms
  array:
    rx: [[0, 0, 0], [0, 1.94 mm, 0], [0, 3.88 mm, 0], [0, 5.82 mm, 0],
         [0, 7.76 mm, 0], [0, 9.7 mm, 0], [0, 11.64 mm, 0], [0, 13.58 mm, 0]]
  hardware: {transmit_power: 12 dBm, antenna_gain: 12 dBi, noise_factor: 12 dB}
scene:
  targets:
    - {name: car, position: [30 m, 12 m, 0 m], velocity: [-6 m/s, 0, 0], rcs: 15 dBsm}
chain: {field_of_view: {azimuth: 60 deg}}
"""


@dataclass
class Page:
    """Session without a browser that records the requests of views."""

    scenario: Scenario
    frame_state: FrameState | None = None
    cursors: list[Cursor | None] = field(default_factory=list)
    changes: list[str] = field(default_factory=list)
    error_messages: list[str] = field(default_factory=list)
    on_settings: list = field(default_factory=list)
    on_mistakes: list = field(default_factory=list)

    def move_cursor(self, cursor):
        self.cursors.append(cursor)

    def change_setting(self, path, text):
        self.changes.append(f"{path}={text}")
        self.scenario = apply_overrides(self.scenario, self.changes[-1:], LIMITS)

    def queue_edit(self, key, edit):
        try:
            self.scenario = edit(self.scenario)
        except DechirpError as error:
            self.error_messages.append(str(error))

    def show(self, view, step=0):
        self.frame_state = FramePlayer(self.scenario).process_frame_at_step(step, None)
        view.show_frame(self.frame_state)
        view.update_caption(self.frame_state)
        return self.frame_state


@pytest.fixture
def page():
    return Page(parse_scenario(SETTINGS, LIMITS))


def send_event(view, kind: type[PointEvent], x: float, y: float) -> None:
    view.root_element._trigger_event(kind(view.root_element, sx=0, sy=0, x=x, y=y))


def locate_brightest_pixel(view) -> tuple[float, float, float, float]:
    """Return x and y of the brightest pixel in figure coordinates, and its width and height."""
    (image,) = view.image.data["image"]
    glyph = view.figure.renderers[0].glyph
    row, column = np.unravel_index(image.argmax(), image.shape)
    width, height = glyph.dw / image.shape[1], glyph.dh / image.shape[0]
    return glyph.x + (column + 0.5) * width, glyph.y + (row + 0.5) * height, width, height


def select_brackets(view, *, turned):
    """Return the columns of brackets around detections, or of the turned ones around targets."""
    columns = view.marks.data
    rows = (columns["angle"] != 0) == turned
    return {name: column[rows] for name, column in columns.items()}


# Levels of powers.


def test_levels_are_linear_in_decibels_over_span():
    power = 10.0 ** (-np.array([0, SPAN_DB / 2, SPAN_DB, 2 * SPAN_DB]) / 10)
    assert power_to_image_levels(3e-12 * power, 3e-12).tolist() == [255, 127, 0, 0]
    assert power_to_image_levels(power, 1.0, 2 * SPAN_DB).tolist() == [255, 191, 127, 0]


def test_zero_power_is_dark_and_infinite_power_is_bright():
    power = np.array([0.0, np.inf, np.nan, 1e-300, 1e30])
    assert power_to_image_levels(power, 1.0).tolist() == [0, 255, 0, 0, 255]
    assert power_to_image_levels(np.zeros(3), 0.0).tolist() == [0, 0, 0]


# Maps.


def test_brightest_pixel_lies_at_target_range_and_velocity(page):
    view = RangeDopplerView(page)
    truth = page.show(view).truth
    x, y, width, height = locate_brightest_pixel(view)
    assert abs(x - truth.range.item()) <= width
    assert abs(y - truth.velocity.item()) <= height
    detections, targets = (select_brackets(view, turned=turned) for turned in (False, True))
    assert targets["x"] == pytest.approx([truth.range.item()], abs=width)
    assert detections["y"] == pytest.approx([truth.velocity.item()], abs=0.1 * height)


@pytest.mark.parametrize(
    ("n_detections", "n_shown", "width"), [(0, 0, 28), (40, 40, 28), (41, 41, 16), (201, 200, 16)]
)
def test_many_brackets_are_small_and_at_most_200(page, n_detections, n_shown, width):
    view = RangeDopplerView(page)
    places = np.append(np.arange(float(n_detections)), np.nan)
    one_target = np.array([5.0]), np.array([2.0])
    view.draw_marks((places, places / 10), one_target)
    at_detections = select_brackets(view, turned=False)
    assert at_detections["x"].tolist() == list(range(n_shown))
    assert at_detections["y"] == pytest.approx(np.arange(n_shown) / 10)
    assert select_brackets(view, turned=True)["x"].tolist() == [5.0]
    assert {marks.glyph.width for marks in view._marks} == {width}
    # Two feet, the gap above, the right bracket, the gap below, and the rest of the left one.
    glyph = view._marks[0].glyph
    foot, gap, right, gap_below, left, none = glyph.line_dash
    assert foot + gap + right + gap_below + left == 2 * (glyph.width + glyph.height)
    assert (gap, right, none) == (gap_below, left + foot, 0)
    view.draw_marks((np.empty(0), np.empty(0)), one_target)
    assert {marks.glyph.width for marks in view._marks} == {28}


def test_target_left_of_radar_is_on_left_of_azimuth_map(page):
    view = RangeAzimuthView(page)
    truth = page.show(view).truth
    x, y, _, height = locate_brightest_pixel(view)
    azimuth_deg = math.degrees(truth.azimuth.item())
    assert azimuth_deg > 20
    assert abs(x - azimuth_deg) < 2  # an eighth of a beam
    assert abs(y - truth.range.item()) <= height
    for turned in (False, True):
        assert select_brackets(view, turned=turned)["x"] == pytest.approx([azimuth_deg], abs=0.5)
    # The axis falls from left to right.
    assert view.figure.x_range.start > azimuth_deg > view.figure.x_range.end
    assert f"{azimuth_deg:.1f}° left" in view.caption.title


def test_level_on_colour_bar_equals_power_in_dbm(page):
    view = RangeDopplerView(page)
    power = page.show(view).power.values
    (image,), bar = view.image.data["image"], view._colour_bar
    low, high = bar.color_mapper.low, bar.color_mapper.high
    read_dbm = low + image / 255 * (high - low)
    true_dbm = np.clip(to_decibels(power) + 30, low, high)
    assert abs(read_dbm - true_dbm).max() <= (high - low) / 255
    assert power.max() <= 10 ** ((high - 30) / 10)
    assert "dBm" in bar.title


@pytest.mark.parametrize("noise_factor", ["2 dB", "12 dB", "40 dB"])
def test_noise_alone_stays_in_lower_half_of_colours(page, noise_factor):
    page.scenario = replace(page.scenario, scene=Targets())
    page.change_setting("radar.hardware.noise_factor", noise_factor)
    view = RangeDopplerView(page)
    page.show(view)
    (image,) = view.image.data["image"]
    # Exponential powers of 8 receivers: of 2,048 cells the strongest is within 7 dB of the median.
    assert image.max() < 128
    assert np.median(image) > 0  # and is not cut off


@nightly
def test_large_map_is_reduced_and_keeps_its_peak(page):
    page.scenario = apply_overrides(
        page.scenario, ["chain.n_range_bins=2048", "chain.n_velocity_bins=512"], LIMITS
    )
    view = RangeDopplerView(page)
    truth = page.show(view).truth
    (image,) = view.image.data["image"]
    assert image.nbytes < 100 * 1024
    x, y, width, height = locate_brightest_pixel(view)
    assert abs(x - truth.range.item()) <= 1 + width
    assert abs(y - truth.velocity.item()) <= 0.6 + height


def test_single_element_array_shows_no_azimuth_map(page):
    view = RangeAzimuthView(page)
    page.show(view)
    page.scenario = apply_overrides(page.scenario, ["radar.array.rx=[[0, 0, 0]]"], LIMITS)
    page.show(view)
    assert "no azimuth" in view.caption.title
    assert not view.image.data["image"][0].any() and not len(view.marks.data["x"])


def test_all_views_show_and_move_cursor(page):
    views = RangeDopplerView(page), RangeAzimuthView(page), SceneView(page)
    page.frame_state = FramePlayer(page.scenario).process_frame_at_step(0, Cursor(20.0, 3.0))
    for view in views:
        view.show_frame(page.frame_state)
    range_doppler_view, range_azimuth_view, scene_view = views
    assert (
        range_doppler_view._vertical_line.location,
        range_doppler_view._horizontal_line.location,
    ) == (
        20.0,
        3.0,
    )
    assert range_azimuth_view._horizontal_line.location == 20.0
    arc = scene_view.top_view.cursor.data_source.data
    assert np.hypot(arc["x"], arc["y"]) == pytest.approx(20.0)
    send_event(range_doppler_view, Tap, 41.0, -5.0)
    send_event(range_azimuth_view, Pan, 10.0, 25.0)
    send_event(scene_view, Tap, -9.0, 12.0)
    assert page.cursors == [Cursor(41.0, -5.0), Cursor(25.0, 3.0), Cursor(15.0, 3.0)]
    for view in views:
        send_event(view, DoubleTap, 1.0, 1.0)
    assert page.cursors[3:] == [None] * 3


def test_tap_on_target_moves_cursor_to_its_peak(page):
    view = SceneView(page)
    truth = page.show(view).truth
    send_event(view, Tap, 12.5, 29.0)
    assert page.cursors[0].velocity_m_per_s == pytest.approx(truth.velocity.item(), abs=0.1)
    assert page.cursors[0].range_m == pytest.approx(truth.range.item(), abs=0.1)


# Scene view.


def test_markers_lie_at_target_position_at_mid_frame(page):
    view = SceneView(page)
    frame_state = page.show(view, step=10)
    forward_m = 30 - 6 * frame_state.time_s
    for markers in (view.top_view.targets, view.top_view.detections):
        data = markers.data_source.data
        assert data["x"] == pytest.approx([12], abs=0.2)
        assert data["y"] == pytest.approx([forward_m], abs=0.2)
    arrow = view.top_view._arrows.source.data
    assert arrow["to_x"] == pytest.approx(arrow["x"])
    assert arrow["to_y"][0] < arrow["y"][0]  # approaching
    assert "1 target, 1 detection" in view.caption.title


@pytest.mark.parametrize(("speed", "has_arrow"), [("1e-14 m/s", False), ("0.01 m/s", True)])
def test_targets_that_stand_but_for_rounding_errors_have_no_arrow(page, speed, has_arrow):
    change = f"scene.targets.car.velocity=[{speed}, 0, 0]"
    page.scenario = apply_overrides(page.scenario, [change], LIMITS)
    view = SceneView(page)
    page.show(view)
    assert ("→ in" in view.caption.note) == has_arrow


def test_detections_without_directions_are_arcs_at_their_range(page):
    page.scenario = apply_overrides(page.scenario, ["radar.array.rx=[[0, 0, 0]]"], LIMITS)
    view = SceneView(page)
    frame_state = page.show(view)
    arc = view.top_view.errors.data_source.data
    radius_m = np.hypot(arc["x"], arc["y"])[:-1]  # the last point is a gap
    assert radius_m == pytest.approx(frame_state.detections.range.item(), abs=1e-3)
    assert np.degrees(np.arctan2(arc["x"], arc["y"])[:-1]).max() == pytest.approx(60)


def test_recording_shows_no_targets(page):
    view = SceneView(page)
    frame_state = page.show(view)
    unknown = replace(frame_state, truth=None)
    view.show_frame(unknown)
    view.update_caption(unknown)
    assert not len(view.top_view.targets.data_source.data["x"])
    assert "target" not in view.caption.title and "1 detection" in view.caption.title


def test_errors_of_echoes_without_noise_are_not_magnified(page):
    frame_state = page.show(SceneView(page))
    assert frame_state.detections.sizes["detection"] > 0
    tiny = {f"{name}_std": ("detection", [1e-9]) for name in ("range", "azimuth")}
    frame_state = replace(frame_state, detections=frame_state.detections.assign(tiny))
    view = SceneView(page)
    view.show_frame(frame_state)
    assert len(view.top_view.errors.data_source.data["x"]) == 0
    view.update_caption(frame_state)
    assert "detected" in view.caption.note and "errors" not in view.caption.note


def test_scale_changes_only_when_target_leaves_view(page):
    view = SceneView(page)
    page.show(view)
    initial_range_m = view.top_view.max_range_m
    page.scenario = apply_overrides(
        page.scenario, ["scene.targets.car.position=[50 m, 12 m, 0 m]"], LIMITS
    )
    page.show(view)
    assert view.top_view.max_range_m == initial_range_m > 50
    page.scenario = apply_overrides(
        page.scenario, ["scene.targets.car.position=[90 m, 12 m, 0 m]"], LIMITS
    )
    page.show(view)
    assert view.top_view.max_range_m > 90


def make_track(x: float, y: float) -> Track:
    covariance = tuple(map(tuple, np.eye(4)))
    return Track(number=0, state=(x, 0.0, y, 0.0), covariance=covariance, status="confirmed", age=0)


@pytest.mark.parametrize("restart_step", [0, 2, 3])  # rewind, other settings while paused, played
def test_track_tail_grows_with_steps_until_tracker_restarts(page, restart_step):
    frame_state, tails = page.show(SceneView(page)), TrackTails()

    def add_track(step: int, x: float, n_frames_since_start: int) -> None:
        tails.add_tracks_of_frame(
            replace(
                frame_state,
                step=step,
                tracks=(make_track(x, 4.0),),
                history=frame_state.history * n_frames_since_start,
            )
        )

    for step, x in ((0, 30.0), (1, 29.0), (2, 28.0), (2, 27.5)):
        add_track(step, x, step + 1)
    (line,) = tails.track_lines_m
    assert line.tolist() == [[4, 30], [4, 29], [4, 27.5]]

    add_track(restart_step, 50.0, 1)  # another target, which the new tracker gives the same number

    assert [line.tolist() for line in tails.track_lines_m] == [[[4, 50]]]


def test_joined_lines_are_separated_by_gaps():
    first_line, second_line = np.arange(4.0).reshape(2, 2), np.arange(6.0).reshape(3, 2)
    points = join_lines_with_gaps([first_line, second_line])
    assert np.flatnonzero(np.isnan(points[:, 0])).tolist() == [2, 6]
    assert (points[3:6] == second_line).all() and join_lines_with_gaps([]).shape == (0, 2)


# Dragging.


def test_drag_moves_initial_position_by_its_offset(page):
    view = SceneView(page)
    frame_state = page.show(view, step=10)
    forward_m = 30 - 6 * frame_state.time_s  # position at mid-frame
    send_event(view, PanStart, 12.0, forward_m)
    send_event(view, Pan, 12.0 - 5, forward_m + 8)
    send_event(view, PanEnd, 12.0 - 5, forward_m + 8)
    assert page.scenario.scene.find_target("car").position_m == pytest.approx((38, 7, 0), abs=1e-4)
    assert page.changes[0] == "scene.targets.car.position=[38.0000 m, 7.0000 m, 0.0000 m]"
    # The new position is drawn before and after the next frame arrives.
    for _ in range(2):
        data = view.top_view.targets.data_source.data
        assert (data["x"][0], data["y"][0]) == pytest.approx((7, forward_m + 8), abs=1e-3)
        page.show(view, step=10)


def test_drag_starting_away_from_targets_moves_none(page):
    view = SceneView(page)
    page.show(view)
    for kind in (PanStart, Pan, PanEnd):
        send_event(view, kind, -20.0, 10.0)
    assert not page.changes


@pytest.mark.parametrize("time_s", [0.0, 0.7])
def test_initial_position_places_target_for_radar_on_arc(time_s):
    ego = Ego(
        position_m=(3.0, -2.0, 0.6),
        yaw_rad=0.3,
        pitch_rad=0.05,
        velocity_m_per_s=(9.0, 2.0, 0.0),
        turn_rate_rad_per_s=0.4,
    )
    car = Target(
        name="car",
        position_m=(40.0, 5.0, 1.0),
        velocity_m_per_s=(-7.0, 3.0, 0.0),
        acceleration_m_per_s2=(1.0, -2.0, 0.0),
    )
    original_scene = Targets(targets=(car,), ego=ego)
    start = position_at_time_zero_m(original_scene, "car", (25.0, -6.0), time_s)
    edited_scene = Targets(targets=(replace(car, position_m=start),), ego=ego)
    _, _, height_m = original_scene.target_positions_m([time_s])[0, 0]
    assert edited_scene.target_positions_m([time_s])[0, 0] == pytest.approx((25.0, -6.0, height_m))


def test_dragging_target_on_waypoints_gives_error_message(page):
    walker = Target(
        name="walker",
        position_m=(20.0, 0.0, 0.0),
        waypoints=(Waypoint(time_s=1.0, position_m=(20.0, 3.0, 0.0)),),
    )
    page.scenario = replace(page.scenario, scene=Targets(targets=(walker,)))
    with pytest.raises(InvalidSetting, match="waypoints"):
        position_at_time_zero_m(page.scenario.scene, "walker", (10.0, 0.0), 0.0)
    view = SceneView(page)
    page.show(view)
    send_event(view, PanStart, 0.0, 20.0)
    send_event(view, Pan, 5.0, 22.0)
    assert not page.changes
    (message,) = page.error_messages
    assert "scene.targets.walker.position" in message and "waypoints" in message


def test_unnamed_target_can_be_dragged(page):
    unnamed_target = Target(position_m=(25.0, -4.0, 0.0))
    car = page.scenario.scene.targets[0]
    page.scenario = replace(page.scenario, scene=Targets(targets=(car, unnamed_target)))
    view = SceneView(page)
    page.show(view)
    send_event(view, PanStart, -4.0, 25.0)
    send_event(view, Pan, -6.0, 20.0)
    assert page.scenario.scene.targets[1].position_m == pytest.approx((20, -6, 0))
    assert page.scenario.scene.targets[0] == car


def test_refused_drag_restores_drawn_position(page):
    view = SceneView(page)
    page.show(view)
    send_event(view, PanStart, 12.0, 30.0)
    send_event(view, Pan, 2.0, 30.0)
    for report in page.on_mistakes:
        report(("a mistake",))
    assert view.top_view.targets.data_source.data["x"] == pytest.approx([12.0], abs=1e-3)


def test_formatted_position_is_valid_setting():
    scenario = parse_scenario(SETTINGS, LIMITS)
    text = format_position_setting((1.25, -0.0301, 1234.5))
    edited_scenario = apply_overrides(scenario, [f"scene.targets.car.position={text}"], LIMITS)
    assert edited_scenario.scene.find_target("car").position_m == (1.25, -0.0301, 1234.5)


def test_views_use_theme_colours(page):
    for view in (RangeDopplerView(page), RangeAzimuthView(page), SceneView(page)):
        view.apply_theme(LIGHT)
        assert view.root_element.outline_line_color == LIGHT.rule
