"""Section of the page on directions."""

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.text import decimals_for_std, format_fixed
from dechirp.processing.angle.base import SpectralEstimator
from dechirp.processing.angle_maps import angle_spectrum, range_azimuth_map
from dechirp.report.figures import birds_eye, directions, top_view
from dechirp.report.figures.directions import Directions
from dechirp.report.figures.style import TALL_IN, FigureWithCaption, render_svg
from dechirp.report.page_context import PageContext


def first_frame_detections_with_azimuth(context: PageContext) -> top_view.GroundDetections | None:
    """Return the detections of the first frame that have an azimuth; None without any."""
    detections = context.first_frame_detections
    detections = detections.isel(detection=np.flatnonzero(np.isfinite(detections.azimuth.values)))
    if not detections.sizes["detection"]:
        return None
    radar = context.result.radar.for_frame(context.result.first_frame)
    is_unambiguous = np.isfinite(detections.ambiguity_number.values) | (len(radar.array.tx_m) == 1)
    field_of_view = context.result.scenario.chain.field_of_view
    return ground_detections(
        detections, is_unambiguous=is_unambiguous, field_of_view_rad=field_of_view.azimuth_rad
    )


def ground_detections(
    detections: xr.Dataset, *, is_unambiguous: np.ndarray, field_of_view_rad: float
) -> top_view.GroundDetections:
    """Return detections or clusters with an azimuth for a top view."""
    return top_view.GroundDetections(
        range_m=detections.range.values,
        azimuth_rad=detections.azimuth.values,
        elevation_rad=np.nan_to_num(detections.elevation.values),
        range_std_m=detections.range_std.values,
        azimuth_std_rad=detections.azimuth_std.values,
        is_unambiguous=is_unambiguous,
        field_of_view_rad=field_of_view_rad,
    )


def draw_direction_figures(context: PageContext) -> list[FigureWithCaption]:
    """Draw the maps and spectra over direction, and for a recording the top view."""
    on_ground, figures = first_frame_detections_with_azimuth(context), []
    if context.result.scenario.scene is None and on_ground is not None:
        figures.append(
            FigureWithCaption(
                figure=render_svg(
                    lambda figure: birds_eye.draw_detections_from_above(
                        figure.subplots(), on_ground
                    ),
                    height_in=TALL_IN,
                ),
                title="Top view.",
                caption="Detections of the first frame with error ellipses. They are long across"
                " the"
                " line of sight, because angles are less accurate than ranges.",
            )
        )
    if on_ground is not None:
        figures.append(
            FigureWithCaption(
                figure=_draw_range_azimuth_map(context),
                title="Range-azimuth map.",
                caption="Power of a beam in the first frame, maximum over velocity. A target is as"
                " wide as the beam; ripples beside it are sidelobes of the array.",
            )
        )
    if _detections_with_direction_mask(context.first_frame_detections).any():
        figures.append(_draw_angle_spectrum(context))
    return figures


def _detections_with_direction_mask(detections: xr.Dataset) -> np.ndarray:
    """Return the mask of detections with an azimuth or elevation."""
    return np.isfinite(detections.azimuth.values) | np.isfinite(detections.elevation.values)


def _draw_range_azimuth_map(context: PageContext) -> Markup:
    result, detections = context.result, context.first_frame_detections
    radar, truth = result.radar.for_frame(result.first_frame), None
    power = range_azimuth_map(context.first_frame.isel(frame=0), radar, result.scenario.chain)
    if context.point_target_map_positions is not None and result.truth is not None:
        azimuth = result.truth.azimuth.transpose("target", "frame").values[
            context.point_target_mask, 0
        ]
        truth = (azimuth, context.point_target_map_positions.range_m)
    has_azimuth = np.isfinite(detections.azimuth.values)
    marked = directions.RangeAzimuthMap(
        power=power,
        units=context.units,
        detections=(detections.azimuth.values[has_azimuth], context.peaks.range_m[has_azimuth]),
        truth=truth,
    )
    return render_svg(
        lambda figure: directions.draw_range_azimuth_map(figure.subplots(), marked),
        height_in=TALL_IN,
    )


def _draw_angle_spectrum(context: PageContext) -> FigureWithCaption:
    """Draw the angle spectrum of the strongest detection that has a direction."""
    result, detections, chain = (
        context.result,
        context.first_frame_detections,
        context.result.scenario.chain,
    )
    index = int(_detections_with_direction_mask(detections).argmax())
    detection = detections.isel(detection=index)
    radar = result.radar.for_frame(result.first_frame)
    power = angle_spectrum(context.first_frame.isel(frame=0), radar, detections, index, chain)
    is_same_cell = (detections.range.values == float(detection.range)) & (
        detections.velocity.values == float(detection.velocity)
    )
    is_same_cell |= (detections.range.values == float(detection.range)) & np.isnan(
        detections.velocity.values
    )
    decimals = min(decimals_for_std(float(detection.range_std)), 2)
    range_text = f"{format_fixed(float(detection.range), decimals)} m"
    method_text = (
        f"kind: {power.estimator}" if isinstance(chain.angle, SpectralEstimator) else "beams"
    )
    return FigureWithCaption(
        figure=render_svg(
            lambda figure: directions.draw_angle_spectrum(
                figure.subplots(),
                power,
                estimates=_select_directions(detections, np.flatnonzero(is_same_cell)),
                truth=_true_directions_of_matched_targets(context, is_same_cell),
            ),
            height_in=TALL_IN,
        ),
        title="Angle spectrum.",
        caption=f"spectrum over directions of the detection at {range_text} ({method_text}). Where"
        " it has other"
        " hills nearly as high, the array takes directions for each other.",
    )


def _select_directions(detections: xr.Dataset, indices: np.ndarray) -> Directions:
    return Directions(
        np.nan_to_num(detections.azimuth.values[indices]),
        np.nan_to_num(detections.elevation.values[indices]),
    )


def _true_directions_of_matched_targets(
    context: PageContext, is_same_cell: np.ndarray
) -> Directions | None:
    """Return the true directions of the targets of these detections, without bodies."""
    truth, matched = context.result.truth, context.matched
    if truth is None or matched is None:
        return None
    in_first = np.flatnonzero(context.strongest.frame.values == context.result.first_frame)
    targets = np.unique(matched.target[in_first[is_same_cell]])
    points = [target for target in targets if target >= 0 and context.point_target_mask[target]]
    first = truth.isel(frame=0)
    return Directions(first.azimuth.values[points], first.elevation.values[points])
