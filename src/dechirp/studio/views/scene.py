"""Top view of the scene: x forward is up, y left is left; targets can be dragged."""

from functools import partial
from typing import NamedTuple

import numpy as np
from bokeh.events import DoubleTap, Pan, PanEnd, PanStart, Tap
from bokeh.models import UIElement

from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting, Mistake
from dechirp.core.text import TIMES_SIGN, format_number
from dechirp.experiments.scenario import Scenario
from dechirp.report.figures.common import choose_body_scatterer_indices
from dechirp.report.figures.top_view import (
    GroundDetections,
    ellipse_magnification,
    round_down_to_1_2_5,
)
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position
from dechirp.scene.rotations import from_local_axes, to_local_axes
from dechirp.scene.scene import Scene
from dechirp.scene.scene import Scene as Targets
from dechirp.studio.browser_events import register_position_callback
from dechirp.studio.cursor import Cursor, map_velocities_and_ranges
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.figure_style import join_lines_with_gaps
from dechirp.studio.views.ground import TopView, arc_positions_m, move_marks
from dechirp.studio.views.map_markers import (
    detections_with_azimuth,
    ranges_of_detections_without_azimuth,
)
from dechirp.studio.views.tracks import TrackTails


def position_at_time_zero_m(
    scene: Scene, target_name: str, position_m: tuple[float, float], time_s: float
) -> tuple[float, float, float]:
    """Return the position at time zero of a target that is at a given position later.

    Parameters
    ----------
    position_m : (2,)
        x and y at that time in coordinates of the radar; the height above the radar is kept.
    time_s : float
        Time of the shown frame.

    Raises
    ------
    InvalidSetting
        If the target has waypoints: moving only the first one would bend its trajectory.
    """
    target = scene.find_target(target_name)
    if target.waypoints:
        raise InvalidSetting(
            f"scene.targets.{target_name}.position",
            value="dragged, of a target with waypoints",
            expected="a target with constant velocity",
            fix="change its waypoints in the settings file, or remove them",
        )
    at_s = np.array([time_s])
    axes = scene.ego.axes(at_s)
    from_radar_m = scene.target_offsets_from_radar_m(
        at_s, np.array([scene.names.index(target_name)])
    )
    old_m = to_local_axes(axes, from_radar_m)
    new_m = np.array([[[*position_m, old_m[0, 0, 2]]]])
    displacement_m = from_local_axes(axes, new_m - old_m)[0, 0]
    x, y, z = (np.array(target.position_m) + displacement_m).tolist()
    return x, y, z


def format_position_setting(position_m: tuple[float, float, float]) -> str:
    """Format a position for settings, to a tenth of a millimetre."""
    return f"[{', '.join(f'{coordinate:.4f} m' for coordinate in position_m)}]"


_MAX_POINTS = 400


class TargetPositions(NamedTuple):
    """Positions and velocities of targets at one time, in coordinates of the radar."""

    names: tuple[str, ...]
    positions_m: np.ndarray
    """(n_targets, 2)"""
    velocities_m_per_s: np.ndarray
    """(n_targets, 2), over ground."""
    scatterers_m: np.ndarray
    """(n, 2): scatterers that outline the bodies; a subset if there are many."""


def target_positions_and_velocities(scene: Scene, time_s: float) -> TargetPositions:
    """Return positions and velocities of targets, and scatterers of bodies."""
    at_s = np.array([time_s])
    radar_velocity = to_local_axes(
        scene.ego.axes(at_s), scene.ego.velocities_m_per_s(at_s)[:, None]
    )
    bodies = choose_body_scatterer_indices(scene, _MAX_POINTS)
    return TargetPositions(
        names=scene.names,
        positions_m=scene.target_positions_m(at_s)[0, :, :2],
        velocities_m_per_s=(scene.target_velocities_m_per_s(at_s) + radar_velocity)[0, :, :2],
        scatterers_m=scene.scatterer_positions_m(at_s)[0, bodies, :2]
        if len(bodies)
        else np.empty((0, 2)),
    )


_MAX_ELLIPSES, _MAX_ARCS = 60, 20
_MAX_LARGE_MARKS = 15  # detections drawn large
_MAX_MAGNIFICATION = 1000.0  # of errors: without noise, they are a billionth of a metre
_ELLIPSE_SCALE = 0.3  # of the widest error ellipse, drawn larger than in reports
_ARROW_LENGTH = 0.25  # of the largest range: arrow length of the fastest target
_SLOWEST_ARROW_M_PER_S = 1e-3  # slower targets stand: rounding errors of traffic are 1e-14


class SceneView(View):
    """Targets, detections and tracks around the radar; a tap moves the cursor."""

    name = "scene"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.top_view = TopView(self.name)
        self._positions = target_positions_and_velocities(Targets(), 0.0)
        self._tails = TrackTails()
        self._fitted: tuple[float, float] | None = None
        """Range span and field of view that the figure was fitted to."""
        self._error_magnification: float | None = None
        """Magnification of the error ellipses; None: not chosen yet, 0: none are drawn."""
        self._dragged: tuple[str, tuple[float, float]] | None = None
        """Name of the dragged target with its x and y."""
        self._is_released = False
        self._legend = ""
        """Legend of the marks that were drawn last."""
        for event, handler in (
            (PanStart, self._start_dragging_target),
            (Pan, self._drag_target_to),
            (PanEnd, self._drag_target_to),
            (Tap, self._move_cursor),
        ):
            register_position_callback(self.top_view.figure, event, handler)
        self.top_view.figure.on_event(PanEnd, lambda _: self._release_target())
        self.top_view.figure.on_event(DoubleTap, lambda _: session.move_cursor(None))
        session.on_settings.append(self._end_released_drag)
        session.on_mistakes.append(self._cancel_drag_after_mistakes)

    @property
    def root_element(self) -> UIElement:
        return self.top_view.figure

    def apply_theme(self, theme: Theme) -> None:
        self.top_view.apply_theme(theme)

    def show_frame(self, frame_state: FrameState) -> None:
        truth = frame_state.truth
        scene, time_s = Targets(), frame_state.time_s
        if truth is not None and frame_state.scene is not None:
            scene, time_s = frame_state.scene, float(truth["time"].values[0])
        self._positions = target_positions_and_velocities(scene, time_s)
        self._fit_range_to_targets(frame_state)
        marks = [
            self._draw_targets(),
            self._draw_detections(frame_state),
            self._draw_tracks(frame_state),
        ]
        self._legend = "   ".join(mark for mark in marks if mark)
        half_rad = frame_state.chain.field_of_view.azimuth_rad
        move_marks(self.top_view.cursor, arc_positions_m(frame_state.cursor.range_m, half_rad))

    def update_caption(self, frame_state: FrameState) -> None:
        parts = (
            []
            if frame_state.truth is None
            else [format_count_with_noun(len(self._positions.names), "target")]
        )
        parts.append(format_count_with_noun(frame_state.detections.sizes["detection"], "detection"))
        if frame_state.tracks:
            parts.append(format_count_with_noun(len(frame_state.tracks), "track"))
        self.caption.update(title=f"From above: {', '.join(parts)}", note=self._legend)

    def _fit_range_to_targets(self, frame_state: FrameState) -> None:
        """Fit all targets and detections into the figure; keep it until more space is needed."""
        ranges_m = frame_state.detections.variables["range"].values
        if frame_state.truth is not None:
            ranges_m = np.hypot(*self._positions.positions_m.T)
        farthest_m = float(ranges_m.max(initial=0.0))
        span_m = float(map_velocities_and_ranges(frame_state.power)[1][-1])
        fitted = span_m, frame_state.chain.field_of_view.azimuth_rad
        fits = fitted == self._fitted and farthest_m <= self.top_view.max_range_m
        if fits or self._dragged is not None:
            return
        self._fitted, self._error_magnification = fitted, None
        new_range_m = max(min(2 * farthest_m or span_m, span_m), 1.15 * farthest_m)
        self.top_view.set_max_range_and_field_of_view(
            new_range_m, frame_state.chain.field_of_view.azimuth_rad
        )

    def _draw_targets(self) -> str:
        targets, reach_m = self._positions, self.top_view.max_range_m
        positions_m = targets.positions_m.copy()
        if self._dragged is not None and self._dragged[0] in targets.names:
            positions_m[targets.names.index(self._dragged[0])] = self._dragged[1]
        fastest = float(np.hypot(*targets.velocities_m_per_s.T).max(initial=0.0))
        arrow_time_s = (
            round_down_to_1_2_5(_ARROW_LENGTH * reach_m / fastest)
            if fastest >= _SLOWEST_ARROW_M_PER_S
            else 0.0
        )
        ends_m = positions_m + arrow_time_s * targets.velocities_m_per_s
        self.top_view.draw_targets_with_arrows(targets.names, positions_m[:, ::-1], ends_m[:, ::-1])
        move_marks(self.top_view.scatterers, targets.scatterers_m[:, ::-1])
        if not targets.names:
            return ""
        legend = "● true (drag to move)"
        return f"{legend}, → in {format_number(arrow_time_s)} s" if arrow_time_s else legend

    def _draw_detections(self, frame_state: FrameState) -> str:
        detections, other_ranges_m = (
            detections_with_azimuth(frame_state),
            ranges_of_detections_without_azimuth(frame_state),
        )
        move_marks(self.top_view.detections, detections.positions_m[:, ::-1])
        self.top_view.detections.glyph.size = (
            13 if len(detections.range_m) <= _MAX_LARGE_MARKS else 7
        )
        if self._error_magnification is None and len(detections.range_m):
            self._error_magnification = _visible_error_magnification(
                detections, self.top_view.max_range_m
            )
        lines = []
        if self._error_magnification:
            ellipses_m = (
                detections.positions_m[:, :, None]
                + self._error_magnification * detections.error_ellipses_m()
            )
            lines = [line[::-1].T for line in ellipses_m[:_MAX_ELLIPSES]]
        half_rad = frame_state.chain.field_of_view.azimuth_rad
        arcs = [arc_positions_m(range_m, half_rad) for range_m in other_ranges_m[:_MAX_ARCS]]
        move_marks(self.top_view.errors, join_lines_with_gaps([*lines, *arcs]))
        if self._error_magnification and lines:
            return f"○ detected, errors {TIMES_SIGN}{format_number(self._error_magnification)}"
        if arcs:
            return "arcs: detected, no direction"
        return "○ detected" if len(detections.range_m) else ""

    def _draw_tracks(self, frame_state: FrameState) -> str:
        self._tails.add_tracks_of_frame(frame_state)
        ends = [(track.state[2], track.state[0]) for track in frame_state.tracks]
        move_marks(self.top_view.tracks, np.array(ends).reshape(-1, 2))
        move_marks(self.top_view.tails, join_lines_with_gaps(self._tails.track_lines_m))
        return "◇ track" if ends else ""

    # Cursor and dragging.

    def _index_of_target_near(self, x: float, y: float) -> int | None:
        """Return the index of the target near a position, None without one."""
        distance_m = np.hypot(*(self._positions.positions_m - (y, x)).T)
        if not distance_m.size or distance_m.min() > self.top_view.pick_distance_m:
            return None
        return int(distance_m.argmin())

    def _move_cursor(self, x: float, y: float) -> None:
        frame_state, target = self.session.frame_state, self._index_of_target_near(x, y)
        if frame_state is None:
            return
        cursor = Cursor(float(np.hypot(x, y)), frame_state.cursor.velocity_m_per_s)
        if target is not None and frame_state.truth is not None:
            coordinates = (
                frame_state.truth[column].values.ravel()[target] for column in ("range", "velocity")
            )
            cursor = Cursor(
                *map(
                    float,
                    range_doppler_map_position(RangeVelocity(*coordinates), frame_state.radar),
                )
            )
        self.session.move_cursor(cursor)

    def _start_dragging_target(self, x: float, y: float) -> None:
        target = self._index_of_target_near(x, y)
        if target is not None:
            self._dragged, self._is_released = (self._positions.names[target], (y, x)), False

    def _drag_target_to(self, x: float, y: float) -> None:
        frame_state, scene = self.session.frame_state, self.session.scenario.scene
        if self._dragged is None or self._is_released or frame_state is None or scene is None:
            return
        name, _ = self._dragged
        if name not in scene.names:  # removed meanwhile
            self._dragged = None
            return
        path = f"scene.targets.{target_name_or_index_in_path(scene, name)}.position"
        try:
            position_m = position_at_time_zero_m(scene, name, (y, x), frame_state.time_s)
        except InvalidSetting as error:
            self._dragged = None
            self.session.queue_edit(path, partial(_raise_error, error))
            return
        self._dragged = name, (y, x)
        self._draw_targets()
        self.session.change_setting(path, format_position_setting(position_m))

    def _release_target(self) -> None:
        self._is_released = True

    def _end_released_drag(self, _: Scenario) -> None:
        """Reset the magnification and end a released drag after a change of settings."""
        self._error_magnification = None
        if self._is_released:
            self._dragged = None

    def _cancel_drag_after_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        if mistakes and self._dragged is not None:
            self._dragged = None
            self._draw_targets()


def _visible_error_magnification(detections: GroundDetections, max_range_m: float) -> float:
    """Return the magnification that makes error ellipses visible; 0 if it would be too large."""
    max_error_m = float(np.nanmax(detections.range_m * detections.azimuth_std_rad))
    magnification = ellipse_magnification(max_error_m * _ELLIPSE_SCALE, 2 * max_range_m)
    return magnification if magnification <= _MAX_MAGNIFICATION else 0.0


def target_name_or_index_in_path(scene: Targets, name: str) -> str:
    """Return the name of a target in a setting path: its name or its index."""
    index = scene.names.index(name)
    own_name = scene.targets[index].name
    return str(index) if own_name is None or "." in own_name else own_name


def _raise_error(error: InvalidSetting, _: Scenario) -> Scenario:
    raise error
