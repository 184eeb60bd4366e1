"""What the maps and the view from above hold is the physics of the moment; drags move targets."""

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
from dechirp.studio.scenario_edits import PageLimits, apply_options, parse_scenario
from dechirp.studio.theme import LIGHT
from dechirp.studio.views.figure_style import SPAN_DB, join_lines, power_to_levels
from dechirp.studio.views.range_azimuth import RangeAzimuthView
from dechirp.studio.views.range_doppler import RangeDopplerView
from dechirp.studio.views.scene import SceneView, format_position, initial_position_m
from dechirp.studio.views.tracks import TrackTails
from dechirp.tracking.online import Track

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
    """A session without a browser: it keeps what views ask for."""

    scenario: Scenario
    frame_state: FrameState | None = None
    pointed: list[Cursor | None] = field(default_factory=list)
    changes: list[str] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)
    on_settings: list = field(default_factory=list)
    on_mistakes: list = field(default_factory=list)

    def move_cursor(self, cursor):
        self.pointed.append(cursor)

    def change_setting(self, path, text):
        self.changes.append(f"{path}={text}")
        self.scenario = apply_options(self.scenario, self.changes[-1:], LIMITS)

    def queue_edit(self, key, made):
        try:
            self.scenario = made(self.scenario)
        except DechirpError as error:
            self.trouble.append(str(error))

    def shown(self, view, step=0):
        self.frame_state = FramePlayer(self.scenario).frame_at(step, None)
        view.show_frame(self.frame_state)
        view.update_caption(self.frame_state)
        return self.frame_state


@pytest.fixture
def page():
    return Page(parse_scenario(SETTINGS, LIMITS))


def touch(view, kind: type[PointEvent], x: float, y: float) -> None:
    view.root._trigger_event(kind(view.root, sx=0, sy=0, x=x, y=y))


def brightest(view) -> tuple[float, float, float, float]:
    """x and y of the brightest pixel as the figure draws it, and its width and height."""
    (image,) = view.image.data["image"]
    glyph = view.figure.renderers[0].glyph
    row, column = np.unravel_index(image.argmax(), image.shape)
    width, height = glyph.dw / image.shape[1], glyph.dh / image.shape[0]
    return glyph.x + (column + 0.5) * width, glyph.y + (row + 0.5) * height, width, height


# Powers as levels.


def test_levels_fall_evenly_in_decibels_from_the_top_to_the_end_of_the_span():
    power = 10.0 ** (-np.array([0, SPAN_DB / 2, SPAN_DB, 2 * SPAN_DB]) / 10)
    assert power_to_levels(3e-12 * power, 3e-12).tolist() == [255, 127, 0, 0]
    assert power_to_levels(power, 1.0, 2 * SPAN_DB).tolist() == [255, 191, 127, 0]


def test_no_power_is_dark_and_infinite_power_is_bright():
    power = np.array([0.0, np.inf, np.nan, 1e-300, 1e30])
    assert power_to_levels(power, 1.0).tolist() == [0, 255, 0, 0, 255]
    assert power_to_levels(np.zeros(3), 0.0).tolist() == [0, 0, 0]


# Maps.


def test_the_brightest_pixel_lies_at_the_range_and_the_velocity_of_the_target(page):
    view = RangeDopplerView(page)
    truth = page.shown(view).truth
    x, y, width, height = brightest(view)
    assert abs(x - truth.range.item()) <= width
    assert abs(y - truth.velocity.item()) <= height
    assert view.truth.data["x"] == pytest.approx([truth.range.item()], abs=width)
    assert view.detections.data["y"] == pytest.approx([truth.velocity.item()], abs=0.1 * height)


def test_what_is_on_the_left_of_the_radar_is_on_the_left_of_the_azimuth_map(page):
    view = RangeAzimuthView(page)
    truth = page.shown(view).truth
    x, y, _, height = brightest(view)
    azimuth_deg = math.degrees(truth.azimuth.item())
    assert azimuth_deg > 20
    assert abs(x - azimuth_deg) < 2  # an eighth of a beam
    assert abs(y - truth.range.item()) <= height
    assert view.detections.data["x"] == pytest.approx([azimuth_deg], abs=0.5)
    # The axis falls from left to right.
    assert view.figure.x_range.start > azimuth_deg > view.figure.x_range.end
    assert f"{azimuth_deg:.1f}° left" in view.figure.title.text


def test_a_level_read_off_the_colour_bar_is_the_power_in_dbm(page):
    view = RangeDopplerView(page)
    power = page.shown(view).power.values
    (image,), bar = view.image.data["image"], view._bar
    low, high = bar.color_mapper.low, bar.color_mapper.high
    read_dbm = low + image / 255 * (high - low)
    true_dbm = np.clip(to_decibels(power) + 30, low, high)
    assert abs(read_dbm - true_dbm).max() <= (high - low) / 255
    assert power.max() <= 10 ** ((high - 30) / 10)
    assert "dBm" in bar.title


def test_a_large_map_is_sent_small_and_keeps_its_peak(page):
    page.scenario = apply_options(
        page.scenario, ["chain.n_range_bins=2048", "chain.n_velocity_bins=512"], LIMITS
    )
    view = RangeDopplerView(page)
    truth = page.shown(view).truth
    (image,) = view.image.data["image"]
    assert image.nbytes < 100 * 1024
    x, y, width, height = brightest(view)
    assert abs(x - truth.range.item()) <= 1 + width
    assert abs(y - truth.velocity.item()) <= 0.6 + height


def test_an_array_in_one_place_says_that_it_tells_no_azimuth(page):
    view = RangeAzimuthView(page)
    page.shown(view)
    page.scenario = apply_options(page.scenario, ["radar.array.rx=[[0, 0, 0]]"], LIMITS)
    page.shown(view)
    assert "no azimuth" in view.figure.title.text
    assert not view.image.data["image"][0].any() and not len(view.detections.data["x"])


def test_all_three_show_the_cursor_and_each_can_put_it(page):
    views = RangeDopplerView(page), RangeAzimuthView(page), SceneView(page)
    page.frame_state = FramePlayer(page.scenario).frame_at(0, Cursor(20.0, 3.0))
    for view in views:
        view.show_frame(page.frame_state)
    over_doppler, over_azimuth, above = views
    assert (over_doppler._vertical_line.location, over_doppler._horizontal_line.location) == (
        20.0,
        3.0,
    )
    assert over_azimuth._horizontal_line.location == 20.0
    arc = above.top_view.cursor.data_source.data
    assert np.hypot(arc["x"], arc["y"]) == pytest.approx(20.0)
    touch(over_doppler, Tap, 41.0, -5.0)
    touch(over_azimuth, Pan, 10.0, 25.0)
    touch(above, Tap, -9.0, 12.0)
    assert page.pointed == [Cursor(41.0, -5.0), Cursor(25.0, 3.0), Cursor(15.0, 3.0)]
    for view in views:
        touch(view, DoubleTap, 1.0, 1.0)
    assert page.pointed[3:] == [None] * 3


def test_a_tap_on_a_target_puts_the_cursor_on_its_peak(page):
    view = SceneView(page)
    truth = page.shown(view).truth
    touch(view, Tap, 12.5, 29.0)
    assert page.pointed[0].velocity_m_per_s == pytest.approx(truth.velocity.item(), abs=0.1)
    assert page.pointed[0].range_m == pytest.approx(truth.range.item(), abs=0.1)


# From above.


def test_target_and_detection_stand_where_the_target_is_in_the_middle_of_the_frame(page):
    view = SceneView(page)
    moment = page.shown(view, step=10)
    forward_m = 30 - 6 * moment.time_s
    for drawn in (view.top_view.targets, view.top_view.detections):
        data = drawn.data_source.data
        assert data["x"] == pytest.approx([12], abs=0.2)
        assert data["y"] == pytest.approx([forward_m], abs=0.2)
    arrow = view.top_view._arrows.source.data
    assert arrow["to_x"] == pytest.approx(arrow["x"])
    assert arrow["to_y"][0] < arrow["y"][0]  # it comes nearer
    assert "1 target, 1 detected" in view.root.title.text


def test_detections_without_directions_are_arcs_at_their_ranges(page):
    page.scenario = apply_options(page.scenario, ["radar.array.rx=[[0, 0, 0]]"], LIMITS)
    view = SceneView(page)
    moment = page.shown(view)
    arc = view.top_view.errors.data_source.data
    radius_m = np.hypot(arc["x"], arc["y"])[:-1]  # the last is a gap
    assert radius_m == pytest.approx(moment.detections.range.item(), abs=1e-3)
    assert np.degrees(np.arctan2(arc["x"], arc["y"])[:-1]).max() == pytest.approx(60)


def test_a_recording_shows_no_targets(page):
    view = SceneView(page)
    moment = page.shown(view)
    unknown = replace(moment, truth=None)
    view.show_frame(unknown)
    view.update_caption(unknown)
    assert not len(view.top_view.targets.data_source.data["x"])
    assert "target" not in view.root.title.text and "1 detected" in view.root.title.text


def test_the_scale_stays_when_a_target_moves_within_the_picture(page):
    view = SceneView(page)
    page.shown(view)
    before_m = view.top_view.max_range_m
    page.scenario = apply_options(
        page.scenario, ["scene.targets.car.position=[50 m, 12 m, 0 m]"], LIMITS
    )
    page.shown(view)
    assert view.top_view.max_range_m == before_m > 50
    page.scenario = apply_options(
        page.scenario, ["scene.targets.car.position=[90 m, 12 m, 0 m]"], LIMITS
    )
    page.shown(view)
    assert view.top_view.max_range_m > 90


def track(x: float, y: float) -> Track:
    still = tuple(map(tuple, np.eye(4)))
    return Track(number=0, state=(x, 0.0, y, 0.0), covariance=still, status="confirmed", age=0)


def test_the_tail_of_a_track_grows_by_a_step_and_begins_anew_with_a_rewind(page):
    moment, tails = page.shown(SceneView(page)), TrackTails()
    for step, x in ((0, 30.0), (1, 29.0), (2, 28.0), (2, 27.5)):
        tails.add_frame(replace(moment, step=step, tracks=(track(x, 4.0),)))
    (line,) = tails.lines_m
    assert line.tolist() == [[4, 30], [4, 29], [4, 27.5]]
    tails.add_frame(replace(moment, step=0, tracks=(track(30.0, 4.0),)))
    assert len(tails.lines_m[0]) == 1


def test_lines_are_sent_as_one_with_gaps():
    one, other = np.arange(4.0).reshape(2, 2), np.arange(6.0).reshape(3, 2)
    sent = join_lines([one, other])
    assert np.flatnonzero(np.isnan(sent[:, 0])).tolist() == [2, 6]
    assert (sent[3:6] == other).all() and join_lines([]).shape == (0, 2)


# Dragging.


def test_a_drag_by_an_offset_moves_the_start_of_the_target_by_it(page):
    view = SceneView(page)
    moment = page.shown(view, step=10)
    forward_m = 30 - 6 * moment.time_s  # where it is seen
    touch(view, PanStart, 12.0, forward_m)
    touch(view, Pan, 12.0 - 5, forward_m + 8)
    touch(view, PanEnd, 12.0 - 5, forward_m + 8)
    assert page.scenario.scene.find_target("car").position_m == pytest.approx((38, 7, 0), abs=1e-4)
    assert page.changes[0] == "scene.targets.car.position=[38.0000 m, 7.0000 m, 0.0000 m]"
    # It is drawn there before the next moment comes, and then too.
    for _ in range(2):
        data = view.top_view.targets.data_source.data
        assert (data["x"][0], data["y"][0]) == pytest.approx((7, forward_m + 8), abs=1e-3)
        page.shown(view, step=10)


def test_a_drag_that_begins_where_no_target_is_moves_none(page):
    view = SceneView(page)
    page.shown(view)
    for kind in (PanStart, Pan, PanEnd):
        touch(view, kind, -20.0, 10.0)
    assert not page.changes


@pytest.mark.parametrize("time_s", [0.0, 0.7])
def test_a_target_is_where_it_was_put_also_for_a_radar_that_drives_along_an_arc(time_s):
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
    before = Targets(targets=(car,), ego=ego)
    start = initial_position_m(before, "car", (25.0, -6.0), time_s)
    after = Targets(targets=(replace(car, position_m=start),), ego=ego)
    _, _, height_m = before.target_positions_m([time_s])[0, 0]
    assert after.target_positions_m([time_s])[0, 0] == pytest.approx((25.0, -6.0, height_m))


def test_a_target_on_waypoints_is_not_dragged_and_the_page_says_why(page):
    walker = Target(
        name="walker",
        position_m=(20.0, 0.0, 0.0),
        waypoints=(Waypoint(time_s=1.0, position_m=(20.0, 3.0, 0.0)),),
    )
    page.scenario = replace(page.scenario, scene=Targets(targets=(walker,)))
    with pytest.raises(InvalidSetting, match="waypoints"):
        initial_position_m(page.scenario.scene, "walker", (10.0, 0.0), 0.0)
    view = SceneView(page)
    page.shown(view)
    touch(view, PanStart, 0.0, 20.0)
    touch(view, Pan, 5.0, 22.0)
    assert not page.changes
    (told,) = page.trouble
    assert "scene.targets.walker.position" in told and "waypoints" in told


def test_targets_without_names_are_dragged_by_their_places(page):
    nameless = Target(position_m=(25.0, -4.0, 0.0))
    car = page.scenario.scene.targets[0]
    page.scenario = replace(page.scenario, scene=Targets(targets=(car, nameless)))
    view = SceneView(page)
    page.shown(view)
    touch(view, PanStart, -4.0, 25.0)
    touch(view, Pan, -6.0, 20.0)
    assert page.scenario.scene.targets[1].position_m == pytest.approx((20, -6, 0))
    assert page.scenario.scene.targets[0] == car


def test_what_a_drag_asked_for_is_let_go_when_it_is_refused(page):
    view = SceneView(page)
    page.shown(view)
    touch(view, PanStart, 12.0, 30.0)
    touch(view, Pan, 2.0, 30.0)
    for told in page.on_mistakes:
        told(("a mistake",))
    assert view.top_view.targets.data_source.data["x"] == pytest.approx([12.0], abs=1e-3)


def test_positions_are_written_as_settings_read_them():
    scenario = parse_scenario(SETTINGS, LIMITS)
    text = format_position((1.25, -0.0301, 1234.5))
    moved = apply_options(scenario, [f"scene.targets.car.position={text}"], LIMITS)
    assert moved.scene.find_target("car").position_m == (1.25, -0.0301, 1234.5)


def test_each_view_takes_the_colours_of_a_theme(page):
    for view in (RangeDopplerView(page), RangeAzimuthView(page), SceneView(page)):
        view.apply_theme(LIGHT)
        assert view.root.title.text_color == LIGHT.ink
        assert view.root.border_fill_color == LIGHT.tile
