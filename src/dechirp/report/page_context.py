"""Context of the report: a result with sorted detections and their targets."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.association import (
    Association,
    associate_detections,
    scatterer_range_and_range_rate,
    visible_scatterer_mask,
)
from dechirp.radar.radar import Radar
from dechirp.report.figures.common import choose_body_scatterer_indices, range_axis_end_m
from dechirp.scene import aliasing
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position

if TYPE_CHECKING:
    from dechirp.experiments.run import Result

_MAX_SCATTERERS = 600  # limits the size of the page


@frozen_dataclass
class PageContext:
    """Result with sorted detections, matched targets and positions on the map."""

    result: "Result"
    first_frame: xr.DataArray
    """Cube of the first frame."""
    strongest: xr.Dataset
    """All detections, strongest first."""
    matched: Association | None
    """Association with targets, in the same order; None without the truth."""
    strongest_cell: tuple[int, int]
    """Map cell (velocity, range) of the strongest detection, or else of the map maximum."""
    peaks: RangeVelocity
    """Map positions of the detections of the first frame."""
    apparent_truth: RangeVelocity | None
    """Apparent truth, (target, frame): aliased unless the ambiguity is resolved."""

    @property
    def units(self) -> str:
        """Units of the samples."""
        return str(self.first_frame.attrs["units"])

    def value_at_strongest_cell(self, of_map: xr.DataArray) -> float:
        """Return the value of a map at the strongest cell."""
        row, column = self.strongest_cell
        return float(of_map.isel(velocity=row, range=column))

    @property
    def range_axis_end_m(self) -> float:
        """End of the range axis of figures: beyond all detections, and targets of the scene."""
        positions = (self.peaks, self.point_target_map_positions, self.scatterer_map_positions)
        ranges_m = [place.range_m for place in positions if place is not None]
        return range_axis_end_m(np.concatenate(ranges_m), float(self.result.power.range.max()))

    @property
    def first_frame_detections(self) -> xr.Dataset:
        """Detections of the first frame, strongest first."""
        of_first = self.strongest.frame.values == self.result.first_frame
        return self.strongest.isel(detection=np.flatnonzero(of_first))

    @property
    def point_target_mask(self) -> np.ndarray:
        """Mask of the targets that are points, not bodies, (n_targets,)."""
        scene = self.result.scenario.scene
        targets = () if scene is None else scene.targets
        return np.array([target.body is None for target in targets], dtype=bool)

    @property
    def point_target_map_positions(self) -> RangeVelocity | None:
        """True positions of point targets on the map of the first frame."""
        if self.apparent_truth is None:
            return None
        first = RangeVelocity(
            *(values[self.point_target_mask, 0] for values in self.apparent_truth)
        )
        return range_doppler_map_position(
            first, self.result.radar.for_frame(self.result.first_frame)
        )

    @property
    def scatterer_map_positions(self) -> RangeVelocity | None:
        """True positions of visible scatterers of bodies on the map of the first frame.

        Large numbers of scatterers are thinned.
        """
        scene, truth = self.result.scenario.scene, self.result.truth
        if scene is None or truth is None:
            return None
        motion = scatterer_range_and_range_rate(scene, truth.time.values[:1])
        is_visible = visible_scatterer_mask(scene, float(truth.time[0]), self.result.radar)
        indices = choose_body_scatterer_indices(scene, _MAX_SCATTERERS, is_visible)
        radar = self.result.radar.for_frame(self.result.first_frame)
        apparent = aliasing.alias_range_velocity(
            RangeVelocity(*(values[0, indices] for values in motion)), radar
        )
        return range_doppler_map_position(apparent, radar)


def sort_match_and_locate_detections(result: "Result") -> PageContext:
    """Sort the detections, match them with targets, and locate them on the map."""
    order = np.argsort(-result.detections.snr.values, kind="stable")
    strongest = result.detections.isel(detection=order)
    first_frame_detections = strongest.isel(
        detection=np.flatnonzero(strongest.frame.values == result.first_frame)
    )
    estimates = RangeVelocity(
        first_frame_detections.range.values, first_frame_detections.velocity.values
    )
    peaks = range_doppler_map_position(estimates, result.radar.for_frame(result.first_frame))
    matched = apparent_truth = None
    if result.truth is not None:
        matched = associate_detections(strongest, result.truth, result.radar, result.scenario.scene)
        apparent_truth = _truth_aliased_unless_resolved(
            result.truth, result.radar, strongest.ambiguity_number.values, matched
        )
    return PageContext(
        result=result,
        first_frame=next(iter(result.frames())),
        strongest=strongest,
        matched=matched,
        strongest_cell=_map_cell_of_strongest_peak(result.power, peaks),
        peaks=peaks,
        apparent_truth=apparent_truth,
    )


def _truth_aliased_unless_resolved(
    truth: xr.Dataset, radar: Radar, ambiguity_numbers: np.ndarray, matched: Association
) -> RangeVelocity:
    """Return the truth as reported: unaliased if most detections resolve the ambiguity."""
    n_ambiguities = radar.frame.n_resolvable_ambiguities if radar.frame.n_intervals == 1 else None
    is_matched, n_targets = matched.target >= 0, truth.sizes["target"]
    n_detections = np.bincount(matched.target[is_matched], minlength=n_targets)
    n_resolved = np.bincount(
        matched.target[is_matched], np.isfinite(ambiguity_numbers[is_matched]), minlength=n_targets
    )
    is_resolved = (2 * n_resolved > n_detections)[:, None]
    aliased, resolved = (
        aliasing.apparent_range_and_velocity(truth, radar),
        aliasing.apparent_range_and_velocity(truth, radar, n_resolved_spans=n_ambiguities),
    )
    return RangeVelocity(
        *(np.where(is_resolved, *both) for both in zip(resolved, aliased, strict=True))
    )


def _map_cell_of_strongest_peak(power: xr.DataArray, peaks: RangeVelocity) -> tuple[int, int]:
    """Return the cell (velocity, range) of the strongest detection, or of the map maximum."""
    labelled = power.transpose("velocity", "range")
    around = [slice(None), slice(None)]
    if peaks.range_m.size:
        # With noise, a neighbour may exceed the nearest cell.
        row = int(abs(labelled.velocity.values - peaks.velocity_m_per_s[0]).argmin())
        column = int(abs(labelled.range.values - peaks.range_m[0]).argmin())
        around = [slice(max(cell - 1, 0), cell + 2) for cell in (row, column)]
    neighbourhood = labelled.values[tuple(around)]
    up, right = divmod(int(neighbourhood.argmax()), neighbourhood.shape[1])
    return (around[0].start or 0) + up, (around[1].start or 0) + right
