"""Self-contained HTML report on a run of the processing chain."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.axes import Axes

from dechirp.core.text import format_with_si_prefix
from dechirp.evaluation.association import scatterer_range_and_range_rate
from dechirp.processing.range_doppler_map import power_map
from dechirp.processing.spectrogram import spectrogram
from dechirp.report import (
    detections_section,
    directions_section,
    objects_section,
    traffic_section,
)
from dechirp.report.figures import (
    bars,
    beat,
    cfar,
    frames,
    range_doppler,
    scene,
    tracks,
    vital_signs,
)
from dechirp.report.figures import spectrogram as over
from dechirp.report.figures.common import MapAxis
from dechirp.report.figures.style import TALL_IN, render_svg
from dechirp.report.page_context import PageContext, sort_match_and_locate_detections
from dechirp.report.settings_summary import format_settings_by_group
from dechirp.report.template import load_template
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, range_doppler_map_position
from dechirp.scene.scene import Scene

if TYPE_CHECKING:
    from dechirp.experiments.run import Result

_MAX_ROWS = 50
# Spectrogram windows: limbs have a constant speed for about 20 ms; a figure shows 400 columns.
_WINDOW_S, _MAX_WINDOWS = 20e-3, 400
# A spectrogram needs at least this number of chirps.
_MIN_WINDOW_CHIRPS = 16
# Largest number of frames in which positions of bodies are evaluated.
_MAX_SAMPLED_FRAMES = 33


def render_report(result: "Result", *, yaml: str) -> str:
    """Return the HTML of the report; equal results give equal pages.

    Parameters
    ----------
    result : Result
        Result of a run. Scene, truth and link budget are shown if available. Of a recording, only
        the first frame is decoded.
    yaml : str
        Scenario of the run, for reproduction.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    context = sort_match_and_locate_detections(result)
    rows = detections_section.detection_table_rows(context, _MAX_ROWS)
    return load_template("page.html").render(
        scenario=result.scenario,
        headline=detections_section.format_headline(context),
        lead=detections_section.describe_source_and_size(context),
        cards=detections_section.build_strongest_detection_cards(context),
        rows=rows,
        columns=detections_section.table_columns_of_estimates(context),
        angles=detections_section.names_of_estimated_angles(context),
        errors=detections_section.names_of_estimates_with_errors(rows),
        n_more=context.strongest.sizes["detection"] - len(rows),
        n_frames=result.n_frames,
        has_truth=result.truth is not None,
        n_in_map=context.peaks.range_m.size,
        is_complex=np.iscomplexobj(context.first_frame),
        figures=_draw_report_figures(context),
        panels=directions_section.draw_direction_figures(context),
        has_bodies=context.scatterer_map_positions is not None
        and context.scatterer_map_positions.range_m.size > 0,
        targets=detections_section.target_table_rows(context),
        targets_found=detections_section.describe_number_of_detected_targets(context),
        traffic=traffic_section.describe_traffic_scores(result),
        traffic_columns=traffic_section.TRAFFIC_COLUMNS,
        traffic_rows=traffic_section.traffic_table_rows(result),
        objects=objects_section.describe_ego_clusters_and_tracks(result),
        tracks=objects_section.track_table_rows(result, _MAX_ROWS),
        tracks_found=objects_section.describe_number_of_targets_with_tracks(result),
        most_drawn=objects_section.MAX_TRACKS,
        n_tracks=0 if result.tracks is None else result.tracks.sizes["track"],
        vital_signs=_vital_sign_rows(result.vital_signs),
        budget=bars.link_budget_bars(result.budget or ()),
        settings=format_settings_by_group(result),
        findings=result.findings,
        timing=bars.timing_bars(result.timing_s),
        total=format_with_si_prefix(sum(result.timing_s.values()), "s", 3),
        yaml=yaml,
    )


def draw_first_figure(axes: Axes, result: "Result") -> Axes:
    """Draw the displacement of a chest, if any, else the scene, the tracks or the first chirp."""
    if result.displacement is not None:
        return vital_signs.draw_displacement(axes, result.displacement)
    context = sort_match_and_locate_detections(result)
    if result.scenario.scene is not None:
        return _draw_scene_from_above(axes, context, result.scenario.scene)
    if result.tracks is not None and result.tracks.sizes["track"]:
        return tracks.draw_tracks(
            axes,
            objects_section.longest_track_lines(result.tracks),
            objects_section.detections_and_true_paths(context),
        )
    return beat.draw_first_chirp_signal(
        axes, _same_slot_chirps(context), doppler_frequency_hz=_strongest_doppler_hz(context)
    )


def _same_slot_chirps(context: PageContext) -> xr.DataArray:
    """Return chirps of one slot: slots differ in phase (TDM) or in beat frequency (ramps)."""
    n_slots = context.result.radar.frame.n_slots
    return context.first_frame.isel(chirp=slice(None, None, n_slots))


def _strongest_doppler_hz(context: PageContext) -> float | None:
    """Return the Doppler frequency of the strongest detection of complex samples, if any."""
    if not context.peaks.range_m.size or not np.iscomplexobj(context.first_frame):
        return None
    radar = context.result.radar.for_frame(context.result.first_frame)
    return 2 * float(context.peaks.velocity_m_per_s[0]) / radar.frame.chirp.wavelength_m


def _draw_report_figures(context: PageContext) -> dict[str, Markup]:
    result, expected = context.result, context.point_target_map_positions
    radar, chain = result.radar.for_frame(result.first_frame), result.scenario.chain
    same_slot_chirps = _same_slot_chirps(context)
    truth_m = [
        place.range_m for place in (expected, context.scatterer_map_positions) if place is not None
    ]
    marked_map = range_doppler.MarkedMap(
        power=result.power,
        units=context.units,
        detections=context.peaks,
        truth=expected,
        scatterers=context.scatterer_map_positions,
    )

    def draw_spectrum(end_m: float | None) -> Markup:
        return render_svg(
            lambda figure: beat.draw_beat_spectrum_over_range(
                figure.subplots(),
                same_slot_chirps,
                radar.frame.chirp,
                chain,
                truth_m=np.concatenate([[], *truth_m]),
                end_m=end_m,
            )
        )

    def draw_map(end_m: float | None) -> Markup:
        return render_svg(
            lambda figure: range_doppler.draw_map(figure.subplots(), marked_map, end_m=end_m),
            height_in=TALL_IN,
        )

    end_m = context.range_axis_end_m
    figures = {
        "signal": render_svg(
            lambda figure: beat.draw_first_chirp_signal_parts(
                figure, same_slot_chirps, doppler_frequency_hz=_strongest_doppler_hz(context)
            )
        ),
        "spectrum": draw_spectrum(end_m),
        "map": draw_map(end_m),
        "close_up": render_svg(
            lambda figure: range_doppler.draw_close_up(
                figure.subplots(), marked_map, cell=context.strongest_cell
            ),
            height_in=TALL_IN,
        ),
        "cut_range": _draw_threshold_cut(context, "range"),
        "cut_velocity": _draw_threshold_cut(context, "velocity"),
    }
    if end_m < float(result.power.range.max()):
        figures |= {"whole_spectrum": draw_spectrum(None), "whole_map": draw_map(None)}
    if chain.moving_targets is not None:
        figures["moving_map"] = _draw_map_of_moving_targets(context, marked_map)
    if result.scenario.scene is not None:
        figures["scene"] = _draw_scene(context, result.scenario.scene)
    from_above = traffic_section.draw_traffic_from_above(result)
    if from_above is not None:
        figures["traffic"] = from_above
    if result.vital_signs is not None and result.displacement is not None:
        figures["vital_signs"] = _draw_vital_signs(result.vital_signs, result.displacement)
    longest_tracks = objects_section.draw_longest_tracks(context)
    if longest_tracks is not None:
        figures["tracks"] = longest_tracks
    moving_m = _nonrigid_body_range_interval_m(context)
    if moving_m is not None:
        figures["spectrogram"] = _draw_spectrogram(result, moving_m)
    if result.n_frames > 1 and context.strongest.sizes["detection"]:
        figures["range_over_time"] = _draw_estimates_over_time(context, "range")
        figures["velocity_over_time"] = _draw_estimates_over_time(context, "velocity")
    return figures


def _vital_sign_rows(vital: xr.Dataset | None) -> list[tuple[str, ...]]:
    if vital is None:
        return []
    from dechirp.experiments.vital_signs import vital_sign_rows  # takes 0.04 s

    return vital_sign_rows(vital)


def _draw_vital_signs(vital: xr.Dataset, displacement: xr.DataArray) -> Markup:
    from dechirp.processing.slow_time import displacement_spectrum  # takes 0.03 s

    spectrum = displacement_spectrum(displacement)
    return render_svg(
        lambda figure: vital_signs.draw_vital_signs(figure, displacement, spectrum, vital),
        height_in=TALL_IN,
    )


def _draw_map_of_moving_targets(
    context: PageContext, all_echoes: range_doppler.MarkedMap
) -> Markup:
    """Draw the map without static echoes, with the moving detections and its own colour scale.

    The scale of the map with all echoes would hide targets far below the static ones.
    """
    result, is_moving = context.result, context.first_frame_detections.moving.values == 1
    moving_map = replace(
        all_echoes,
        power=power_map(
            context.first_frame.isel(frame=0),
            result.radar.for_frame(result.first_frame),
            result.scenario.chain.moving_target_chain(),
        ),
        detections=RangeVelocity(*(values[is_moving] for values in context.peaks)),
    )
    return render_svg(
        lambda figure: range_doppler.draw_map(
            figure.subplots(), moving_map, end_m=context.range_axis_end_m
        ),
        height_in=TALL_IN,
    )


def _draw_scene(context: PageContext, scene_: Scene) -> Markup:
    return render_svg(
        lambda figure: _draw_scene_from_above(figure.subplots(), context, scene_),
        height_in=scene.figure_height_in(scene_),
    )


def _draw_scene_from_above(axes: Axes, context: PageContext, scene_: Scene) -> Axes:
    detections = context.first_frame_detections
    has_no_azimuth = np.isnan(detections.azimuth.values)
    return scene.draw_scene(
        axes,
        scene_,
        time_s=context.result.radar.for_frame(context.result.first_frame).frame.mid_frame_s,
        detected_m=detections.range.values[has_no_azimuth].tolist(),
        detections=directions_section.first_frame_detections_with_azimuth(context),
    )


def _nonrigid_body_range_interval_m(context: PageContext) -> tuple[float, float] | None:
    """Return the range interval of bodies with moving parts on the map; None without any."""
    scene_, truth, radar = context.result.scenario.scene, context.result.truth, context.result.radar
    if scene_ is None or truth is None or radar.frame.n_chirps < _MIN_WINDOW_CHIRPS:
        return None
    if radar.frame.n_intervals > 1 or radar.frame.has_falling_ramps:
        return None  # a spectrogram needs one chirp interval and one kind of ramp
    moves = [target.body is not None and not target.body.is_rigid for target in scene_.targets]
    is_moving = np.array(moves, dtype=bool)[scene_.target_index_of_scatterer]
    if not is_moving.any():
        return None
    times_s = truth.time.values[:: -(-truth.sizes["frame"] // _MAX_SAMPLED_FRAMES)]
    motion = RangeVelocity(
        *(values[:, is_moving] for values in scatterer_range_and_range_rate(scene_, times_s))
    )
    ranges_m = range_doppler_map_position(alias_range_velocity(motion, radar), radar).range_m
    margin_m = 2 * radar.frame.chirp.range_resolution_m  # for peaks widened by windows
    return float(ranges_m.min()) - margin_m, float(ranges_m.max()) + margin_m


def _draw_spectrogram(result: "Result", range_m: tuple[float, float]) -> Markup:
    frame = result.radar.frame
    n_window = min(max(round(_WINDOW_S / frame.repetition_s), _MIN_WINDOW_CHIRPS), frame.n_chirps)
    hop = max(n_window // 4, frame.n_chirps * result.n_frames // _MAX_WINDOWS)
    chain = result.scenario.chain
    power = spectrogram(
        result.cube,
        result.radar,
        range_m=range_m,
        range_window=chain.range_window,
        n_window=n_window,
        hop=hop,
        n_velocity_bins=2 * n_window,
    )
    return render_svg(lambda figure: over.draw_spectrogram(figure.subplots(), power))


def _draw_threshold_cut(context: PageContext, axis: MapAxis) -> Markup:
    result = context.result
    return render_svg(
        lambda figure: cfar.draw_threshold_cut(
            figure.subplots(),
            result.power,
            result.threshold,
            result.scenario.chain.cfar,
            along=axis,
            cell=context.strongest_cell,
            units=context.units,
        )
    )


def _draw_estimates_over_time(context: PageContext, variable: MapAxis) -> Markup:
    lines = None
    if context.result.truth is not None and context.apparent_truth is not None:
        estimates = (
            context.apparent_truth.range_m
            if variable == "range"
            else context.apparent_truth.velocity_m_per_s
        )
        lines = (context.result.truth.time.values, estimates)
    return render_svg(
        lambda figure: frames.draw_estimates_over_time(
            figure.subplots(), context.strongest, variable=variable, truth=lines
        )
    )
