"""Scene: targets, radar motion, and scatterer positions relative to the radar."""

from collections import Counter
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import check_instances
from dechirp.core.display import (
    Displayable,
    Table,
    format_count_with_noun,
    settings_display_table,
    truncated_display_table,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import AspectBody, Body
from dechirp.scene.ego import Ego
from dechirp.scene.rotations import from_local_axes, rotation_about_z, to_local_axes
from dechirp.scene.target import Fluctuation, Target


class ParabolicPaths(NamedTuple):
    """Scatterers on parabolas or straight lines, relative to a radar that does not turn."""

    scatterers: np.ndarray
    """(n,), indices into the list of all scatterers."""
    coefficients_m: np.ndarray
    """(2 or 3, n, 3): the position in radar coordinates is the sum of coefficients_m[k] t^k."""


class BlockingBoxes(NamedTuple):
    """Boxes of the bodies that shadow other targets."""

    targets: np.ndarray
    """(n,), indices of the targets."""
    boxes_m: np.ndarray
    """(n, low and high, 3), see `Body.blocking_box_m`."""
    clearances_m: np.ndarray
    """(n,), see `Body.ground_clearance_m`."""


class _TargetMotions(NamedTuple):
    """Motion of the targets, each (n_targets, 3): fields of the targets as arrays."""

    start_m: np.ndarray
    """Position relative to the radar at time zero, which preserves the digits of short paths."""
    velocity_m_per_s: np.ndarray
    acceleration_m_per_s2: np.ndarray


@frozen_dataclass
class Scene(Displayable):
    """Targets, and the motion of the radar.

    Scatterers are numbered consecutively: those of the first target, a point or a body of many,
    then those of the next.
    """

    targets: tuple[Target, ...] = ()
    ego: Ego = Ego()
    shadowing: bool = True
    """Let bodies with a size shadow other targets, by diffraction at their edges."""

    def __post_init__(self) -> None:
        fix = "write targets=[Target(...)], also for a single one"
        targets = check_instances("Scene.targets", self.targets, Target, fix=fix)
        object.__setattr__(self, "targets", targets)
        if not isinstance(self.ego, Ego):
            raise InvalidSetting(
                "Scene.ego",
                value=self.ego,
                expected="an Ego",
                fix="write ego=Ego(velocity_m_per_s=(10, 0, 0)), or leave it out",
            )
        if not isinstance(self.shadowing, bool):
            raise InvalidSetting(
                "Scene.shadowing",
                value=self.shadowing,
                expected="true or false",
                fix="choose one",
            )
        for name, count in Counter(self.names).items():
            if count > 1:
                raise InvalidSetting(
                    "Scene.targets",
                    value=f"{count} targets named {name}",
                    expected="a unique name for each target",
                    fix="rename one of them",
                )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the name of each target, given or by position: target-1, target-2 ..."""
        return tuple(
            target.name or f"target-{number}" for number, target in enumerate(self.targets, 1)
        )

    def find_target(self, name: str | None) -> Target:
        """Return the target of a name, or the only target if the name is None."""
        if name is None and len(self.targets) == 1:
            return self.targets[0]
        if name not in self.names:
            raise InvalidSetting(
                "target",
                value=name or "missing",
                expected=f"one of {', '.join(self.names) or 'no targets: the scene is empty'}",
                fix="give the name of a target",
            )
        return self.targets[self.names.index(name)]

    @property
    def n_scatterers(self) -> int:
        """Return the number of scatterers of all targets."""
        return len(self.target_index_of_scatterer)

    @cached_property
    def target_index_of_scatterer(self) -> np.ndarray:
        """Return the target of each scatterer, its index, (n_scatterers,)."""
        return _make_read_only(np.repeat(np.arange(len(self.targets)), self._scatterer_counts))

    @cached_property
    def fixed_scatterer_rcs_m2(self) -> np.ndarray:
        """Return the mean cross section of each scatterer, (n,); 0 if aspect-dependent."""
        target_m2 = [target.rcs_m2 if target.rcs_table is None else 0.0 for target in self.targets]
        cross_sections_m2 = np.repeat(np.array(target_m2), self._scatterer_counts)
        stops = np.cumsum(self._scatterer_counts)
        for target_index in np.flatnonzero(self._body_target_mask).tolist():
            body_scatterers = slice(
                stops[target_index] - self._scatterer_counts[target_index], stops[target_index]
            )
            cross_sections_m2[body_scatterers] = self._target_body(target_index).cross_sections_m2()
        invalid = np.flatnonzero(~(np.isfinite(cross_sections_m2) & (cross_sections_m2 >= 0)))
        if invalid.size:
            raise InvalidSetting(
                f"scene.targets.{self.names[self.target_index_of_scatterer[invalid[0]]]}.body",
                value=f"a body with a cross section of {cross_sections_m2[invalid[0]]:g} m^2",
                expected="finite cross sections of 0 or more",
                fix="correct cross_sections_m2 of the body",
            )
        return _make_read_only(cross_sections_m2)

    @cached_property
    def aspect_dependent_targets(self) -> np.ndarray:
        """Return the indices of targets whose cross section depends on aspect."""
        is_aspect_dependent = [
            t.rcs_table is not None or isinstance(t.body, AspectBody) for t in self.targets
        ]
        return _make_read_only(np.flatnonzero(is_aspect_dependent))

    @cached_property
    def blocking_boxes(self) -> BlockingBoxes:
        """Return the boxes of the bodies that shadow; none without shadowing."""
        targets, boxes_m, clearances_m = [], [], []
        for index, target in enumerate(self.targets if self.shadowing else ()):
            box_m = None if target.body is None else target.body.blocking_box_m
            if box_m is not None:
                assert target.body is not None
                _check_blocking_box(box_m, self.names[index])
                targets.append(index)
                boxes_m.append(box_m)
                clearances_m.append(target.body.ground_clearance_m)
        return BlockingBoxes(
            _make_read_only(np.array(targets, dtype=int)),
            _make_read_only(np.array(boxes_m, dtype=float).reshape(-1, 2, 3)),
            _make_read_only(np.array(clearances_m, dtype=float)),
        )

    @property
    def has_shadows(self) -> bool:
        """Return whether a body may shadow another target."""
        return bool(self.blocking_boxes.targets.size) and len(self.targets) > 1

    @cached_property
    def fluctuating_scatterers_by_model(self) -> dict[Fluctuation, np.ndarray]:
        """Return the scatterers of each kind of fluctuation, without steady ones."""
        kinds = np.array([target.fluctuation for target in self.targets], dtype=str)
        kinds = kinds[self.target_index_of_scatterer]
        scatterers = {kind: np.flatnonzero(kinds == kind) for kind in get_args(Fluctuation)[1:]}
        return {
            kind: _make_read_only(indices) for kind, indices in scatterers.items() if indices.size
        }

    @cached_property
    def accelerating_target_mask(self) -> np.ndarray:
        """Return whether each target has a constant acceleration, (n_targets,)."""
        return _make_read_only((self._target_motions.acceleration_m_per_s2 != 0).any(axis=1))

    @property
    def has_uniform_motion(self) -> bool:
        """Return whether all targets and the radar move on straight lines at constant speed."""
        return not (self.non_polynomial_scatterers.size or self.accelerating_target_mask.any())

    @cached_property
    def parabolic_paths(self) -> ParabolicPaths:
        """Return the scatterers whose paths are parabolas, which excludes a car's wheels."""
        targets = np.flatnonzero(self._parabolic_target_mask)
        scatterers = np.flatnonzero(self._parabolic_target_mask[self.target_index_of_scatterer])
        motions, time_zero_s = self._target_motions, np.zeros(1)
        axes = self.ego.axes(time_zero_s)
        slopes = [motions.velocity_m_per_s[targets] - np.array(self.ego.velocity_m_per_s)]
        if self.accelerating_target_mask[targets].any():
            slopes.append(motions.acceleration_m_per_s2[targets] / 2)
        terms_m = [self.scatterer_positions_m(time_zero_s, targets)[0]]
        for slope in slopes:
            rotated = to_local_axes(axes, slope[None])[0]
            terms_m.append(np.repeat(rotated, self._scatterer_counts[targets], axis=0))
        return ParabolicPaths(_make_read_only(scatterers), _make_read_only(np.array(terms_m)))

    @cached_property
    def non_polynomial_scatterers(self) -> np.ndarray:
        """Return the indices of scatterers whose paths are not parabolas."""
        return _make_read_only(
            np.flatnonzero(~self._parabolic_target_mask[self.target_index_of_scatterer])
        )

    def scatterer_positions_m(
        self, times_s: ArrayLike, targets: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the positions of scatterers, in the coordinates of the radar at each time.

        Parameters
        ----------
        times_s : array (n_times,), s
            Since the start of the first frame.
        targets : array of int, optional
            Indices of the targets; default: all.

        Returns
        -------
        array (n_times, n_scatterers, 3), m
            Exact to some roundings of the largest coordinate.
        """
        times_s = np.asarray(times_s, dtype=float)
        indices = np.arange(len(self.targets)) if targets is None else targets
        counts = self._scatterer_counts[indices]
        positions_m = np.repeat(self.target_offsets_from_radar_m(times_s, indices), counts, axis=1)
        stops = np.cumsum(counts)
        for column in np.flatnonzero(self._body_target_mask[indices]):
            body_scatterers = slice(stops[column] - counts[column], stops[column])
            positions_m[:, body_scatterers] += self._body_scatterer_offsets_m(
                int(indices[column]), times_s
            )
        return to_local_axes(self.ego.axes(times_s), positions_m)

    def scatterer_positions_at_m(self, time_s: float) -> np.ndarray:
        """Return the positions of scatterers at one time, (n_scatterers, 3), see `latest_value`."""
        return self.latest_value(
            "positions", (time_s,), lambda: self.scatterer_positions_m([time_s])[0]
        )

    def target_positions_m(self, times_s: ArrayLike) -> np.ndarray:
        """Return the positions of the targets, of bodies their origins, (n_times, n_targets, 3).

        In the coordinates of the radar at each time.
        """
        return to_local_axes(
            self.ego.axes(np.asarray(times_s, dtype=float)),
            self.target_offsets_from_radar_m(times_s),
        )

    def target_velocities_m_per_s(self, times_s: ArrayLike) -> np.ndarray:
        """Return the velocities of the targets minus that of the radar, (n_times, n_targets, 3).

        Along the axes of the radar, whose rotation is not included: the component along the line of
        sight is the rate of change of range.
        """
        times_s = np.asarray(times_s, dtype=float)
        motions = self._target_motions
        velocity_changes = times_s[:, None, None] * motions.acceleration_m_per_s2
        velocities = motions.velocity_m_per_s + velocity_changes
        for target_index in self._waypoint_target_indices:
            velocities[:, target_index] = self.targets[target_index].velocities_at_m_per_s(times_s)
        velocities -= self.ego.velocities_m_per_s(times_s)[:, None]
        return to_local_axes(self.ego.axes(times_s), velocities)

    def target_offsets_from_radar_m(
        self, times_s: ArrayLike, targets: np.ndarray | None = None
    ) -> np.ndarray:
        """Return vectors from the radar to targets, in scene axes, (n_times, n_targets, 3).

        `targets` are the indices of the targets; default: all.
        """
        times_s = np.asarray(times_s, dtype=float)
        indices = np.arange(len(self.targets)) if targets is None else targets
        motions, t = self._target_motions, times_s[:, None, None]
        positions_m = motions.start_m[indices] + t * motions.velocity_m_per_s[indices]
        if self.accelerating_target_mask[indices].any():
            positions_m += t**2 / 2 * motions.acceleration_m_per_s2[indices]
        for column in np.flatnonzero(np.isin(indices, self._waypoint_target_indices)):
            # Velocity and acceleration of such targets are zero.
            positions_m[:, column] += self.targets[indices[column]].displacements_m(times_s)
        return positions_m - self.ego.displacements_m(times_s)[:, None]

    def latest_value(
        self, name: str, arguments: tuple[float, ...], compute: Callable[[], np.ndarray]
    ) -> np.ndarray:
        """Return a function of this scene, computed once for successive calls with equal arguments.

        Simulation, truth and comparison of a frame need the same positions, cross sections and
        shadows.
        """
        latest = self._latest_values.get(name)
        if latest is None or latest[0] != arguments:
            latest = self._latest_values[name] = arguments, _make_read_only(compute())
        return latest[1]

    @cached_property
    def _latest_values(self) -> dict[str, tuple[tuple[float, ...], np.ndarray]]:
        return {}

    def _display_line(self) -> str:
        shown_names = self.names if len(self.names) <= 4 else (*self.names[:3], "...")
        names_text = f": {', '.join(shown_names)}" if shown_names else ""
        motion_text = ", a radar that moves" if any(self.ego.velocity_m_per_s) else ""
        return f"{format_count_with_noun(len(self.targets), 'target')}{names_text}{motion_text}"

    def _display_tables(self) -> Iterable[Table]:
        rows = (
            (name, *target._display_position_velocity_reflection())
            for name, target in zip(self.names, self.targets, strict=True)
        )
        header = ("name", "position", "velocity", "reflects")
        yield truncated_display_table("Targets", rows, len(self.targets), header)
        if self.ego != Ego():
            yield settings_display_table(self.ego, "The radar's own motion")

    def _target_body(self, target_index: int) -> Body:
        body = self.targets[target_index].body
        assert body is not None
        return body

    def _body_scatterer_offsets_m(self, target_index: int, times_s: np.ndarray) -> np.ndarray:
        """Return vectors from a target to its scatterers, (n_times, n, 3), axes of the scene."""
        offsets_m = self._target_body(target_index).scatterer_offsets_m(times_s)
        shape = (len(times_s), int(self._scatterer_counts[target_index]), 3)
        if offsets_m.shape != shape or not np.isfinite(offsets_m).all():
            raise InvalidSetting(
                f"scene.targets.{self.names[target_index]}.body",
                value="a body with positions that are not finite"
                if offsets_m.shape == shape
                else f"a body with positions of the shape {offsets_m.shape}",
                expected=f"finite positions of the shape {shape}",
                fix="correct scatterer_offsets_m of the body",
            )
        return from_local_axes(
            rotation_about_z(self.targets[target_index].headings_at_rad(times_s)), offsets_m
        )

    @cached_property
    def _target_motions(self) -> _TargetMotions:
        fields = ("position_m", "velocity_m_per_s", "acceleration_m_per_s2")
        start_m, *rates = (
            np.array([getattr(target, field) for target in self.targets]).reshape(-1, 3)
            for field in fields
        )
        return _TargetMotions(start_m - np.array(self.ego.position_m), *rates)

    @cached_property
    def _waypoint_target_indices(self) -> np.ndarray:
        """Return the indices of the targets with waypoints."""
        return np.flatnonzero([bool(target.waypoints) for target in self.targets])

    @cached_property
    def _parabolic_target_mask(self) -> np.ndarray:
        """Return whether each target follows a parabola relative to the radar, (n_targets,)."""
        is_parabolic = np.array([target.has_parabolic_path for target in self.targets], dtype=bool)
        return is_parabolic & (not self.ego.is_turning)

    @cached_property
    def _body_target_mask(self) -> np.ndarray:
        return np.array([target.body is not None for target in self.targets], dtype=bool)

    @cached_property
    def _scatterer_counts(self) -> np.ndarray:
        """Return the number of scatterers of each target."""
        counts = np.ones(len(self.targets), dtype=int)
        for target_index in np.flatnonzero(self._body_target_mask).tolist():
            counts[target_index] = self._target_body(target_index).n_scatterers()
            if not counts[target_index]:
                raise InvalidSetting(
                    f"scene.targets.{self.names[target_index]}.body",
                    value="a body without scatterers",
                    expected="at least one scatterer",
                    fix="remove the target, or correct n_scatterers of the body",
                )
        return counts


def _check_blocking_box(box_m: np.ndarray, name: str) -> None:
    is_valid = np.shape(box_m) == (2, 3) and not np.isnan(box_m).any()
    if not (is_valid and np.isfinite(box_m[:, :2]).all() and (box_m[0] <= box_m[1]).all()):
        raise InvalidSetting(
            f"scene.targets.{name}.body",
            value=f"a body with a blocking box of {np.array(box_m).tolist()}",
            expected="its low and high corners, (2, 3), finite except for the lowest height",
            fix="correct blocking_box_m of the body",
        )


def _make_read_only(array: np.ndarray) -> np.ndarray:
    """Return an array of a frozen object as read-only."""
    array.flags.writeable = False
    return array
