"""Headline, cards and tables of detections and targets."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import (
    SHOWN_COLUMNS,
    DetectionColumn,
    decimals_of_estimates,
    rows_to_show,
    shown_columns,
    standard_error_column,
)
from dechirp.core.text import (
    EN_DASH,
    decimals_for_std,
    format_fixed,
    format_probability,
    format_with_std,
    ratio_db,
)
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.run import leakage_in_recording
from dechirp.report.labels import axis_label
from dechirp.report.page_context import PageContext
from dechirp.scene.rcs import target_cross_sections_m2
from dechirp.scene.shadowing import SHADOWED_LOSS

_SIGMA = "\N{GREEK SMALL LETTER SIGMA}"


@frozen_dataclass
class Card:
    """Value of the strongest detection, shown as a card."""

    name: str
    number: str
    std: str = ""
    unit: str
    small_print: str


def format_headline(context: PageContext) -> str:
    """Describe the detections in one line."""
    n = context.strongest.sizes["detection"]
    if n == 0:
        return "Nothing detected"
    first = context.strongest.isel(detection=0)
    range_text, velocity_text = (
        format_fixed(float(first[name]), min(decimals_for_std(float(first[f"{name}_std"])), 2))
        for name in ("range", "velocity")
    )
    place = f"{range_text} m, {velocity_text} m/s"
    if n == 1:
        return f"Target at {place}"
    frame_text = "" if context.result.n_frames == 1 else f" in {context.result.n_frames} frames"
    return f"{n} detections{frame_text}, the strongest at {place}"


def describe_source_and_size(context: PageContext) -> str:
    """Describe the source and the size of the recording."""
    sizes, recording = context.first_frame.sizes, context.result.scenario.recording
    source = "Simulated" if recording is None else f"Recorded in {Path(recording.path).name}"
    return (
        f"{source}: {_format_count_with_noun(context.result.n_frames, 'frame')} of"
        f" {_format_count_with_noun(sizes['chirp'], 'chirp')}, {sizes['sample']} samples each,"
        f" {_format_count_with_noun(sizes['rx'], 'receiver')}."
    )


def build_strongest_detection_cards(context: PageContext) -> list[Card]:
    """Return the cards of the strongest detection; empty without detections."""
    if context.strongest.sizes["detection"] == 0:
        return []
    snr = format_fixed(ratio_db(float(context.strongest.snr[0])), 1)
    return [
        _strongest_detection_estimate_card(context, "range", "m"),
        _strongest_detection_estimate_card(context, "velocity", "m/s"),
        *(
            _strongest_detection_estimate_card(context, name, "°")
            for name in names_of_estimated_angles(context)
        ),
        Card(name="signal to noise", number=snr, unit="dB", small_print="after integration"),
        *_threshold_margin_cards(context),
    ]


def detection_table_rows(context: PageContext, max_rows: int) -> list[dict[str, str]]:
    """Return the rows of the detection table, strongest first, at most `max_rows`."""
    truth, matched = context.result.truth, context.matched
    frame = context.result.radar.for_frame(0).frame
    indices = rows_to_show(
        context.strongest,
        max_rows,
        range_cell_m=frame.chirp.range_resolution_m,
        velocity_cell_m_per_s=frame.velocity_resolution_m_per_s,
        is_leakage=leakage_in_recording(context.result, context.strongest),
    )
    shown = context.strongest.isel(detection=indices)
    columns = [column for column in SHOWN_COLUMNS if column.name in shown]
    decimals = decimals_of_estimates(
        shown,
        range_cell_m=frame.chirp.range_resolution_m,
        velocity_cell_m_per_s=frame.velocity_resolution_m_per_s,
    )
    estimates = {
        column.name: _format_estimates(shown, column, decimals.get(column.name, 0))
        for column in columns
    }
    rows = []
    for place, index in enumerate(indices.tolist()):
        detection = context.strongest.isel(detection=index)
        row = {
            "frame": str(int(detection.frame)),
            "time": format_fixed(float(detection.time) * 1e3, 3),
            **{name: texts[place] for name, texts in estimates.items()},
        }
        if truth is not None and matched is not None:
            target = int(matched.target[index])
            row["target"] = str(truth.target.values[target]) if target >= 0 else EN_DASH
            row["range_error"] = _format_error_with_sigma_ratio(
                matched.range_error_m[index], detection.range_std, decimals["range"]
            )
            row["velocity_error"] = _format_error_with_sigma_ratio(
                matched.velocity_error_m_per_s[index],
                detection.velocity_std,
                decimals["velocity"],
            )
            for name, error_rad in (
                ("azimuth", matched.azimuth_error_rad[index]),
                ("elevation", matched.elevation_error_rad[index]),
            ):
                std = detection[f"{name}_std"] * math.degrees(1)
                row[f"{name}_error"] = _format_error_with_sigma_ratio(
                    math.degrees(error_rad), std, decimals[name]
                )
        rows.append(row)
    return rows


def table_columns_of_estimates(context: PageContext) -> list[tuple[str, str, str]]:
    """Return heading, key and class of the columns of estimates; angles and motion if known."""
    return [
        (axis_label(column.heading, column.shown_unit_symbol), column.name, "num")
        for column in shown_columns(context.strongest)
    ]


def names_of_estimated_angles(context: PageContext) -> list[str]:
    """Return the angles that any detection has."""
    return [
        name
        for name in ("azimuth", "elevation")
        if np.isfinite(context.strongest[name].values).any()
    ]


def names_of_estimates_with_errors(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the estimates that have errors; detections of bodies have none."""
    names = ("range", "velocity", "azimuth", "elevation")
    return [
        name for name in names if any(row.get(f"{name}_error", EN_DASH) != EN_DASH for row in rows)
    ]


def target_table_rows(context: PageContext) -> list[dict[str, str]]:
    """Return the true values of all targets in the first frame, and their detection."""
    truth, matched, scene = context.result.truth, context.matched, context.result.scenario.scene
    if truth is None or matched is None or scene is None:
        return []
    hits = _indices_of_detected_targets(context, context.result.first_frame)
    wavelength_m = context.result.radar.frame.chirp.wavelength_m
    rcs_m2 = target_cross_sections_m2(scene, truth.time.values[:1], wavelength_m)[0]
    rows = []
    for index, name in enumerate(scene.names):
        target_truth = truth.isel(target=index, frame=0)
        rows.append(
            {
                "name": name,
                "rcs": format_fixed(ratio_db(float(rcs_m2[index])), 1),
                "range": format_fixed(float(target_truth.range), 2),
                "velocity": format_fixed(float(target_truth.velocity), 2),
                "azimuth": format_fixed(math.degrees(float(target_truth.azimuth)), 1),
                "snr": format_fixed(ratio_db(float(target_truth.snr)), 1)
                if target_truth.snr > 0
                else EN_DASH,
                "detected": "yes" if index in hits else _describe_miss(target_truth),
            }
        )
    return rows


def _describe_miss(target_truth: xr.Dataset) -> str:
    """Return no, with the shadow loss of a target behind other bodies."""
    loss = float(target_truth.get("shadow_loss", 1.0))
    return f"no, shadowed by {format_fixed(ratio_db(loss), 0)} dB" if loss > SHADOWED_LOSS else "no"


def describe_number_of_detected_targets(context: PageContext) -> str:
    """Describe how many targets were detected, in the first frame and in all."""
    truth = context.result.truth
    if truth is None or context.matched is None:
        return ""
    n, numbers = truth.sizes["target"], truth.frame.values.tolist()
    n_first = len(_indices_of_detected_targets(context, context.result.first_frame))
    n_detected = f"{n_first} of {_format_count_with_noun(n, 'target')}"
    if len(numbers) == 1:
        return f"Detected: {n_detected}."
    n_all = sum(len(_indices_of_detected_targets(context, number)) for number in numbers)
    n_possible = f"{n_all} of {n * len(numbers)}"
    return f"Detected: {n_detected}; in all frames {n_possible}, each counted in each frame."


def _indices_of_detected_targets(context: PageContext, frame: int) -> set[int]:
    """Return the targets that were detected in a frame."""
    assert context.matched is not None
    return set(context.matched.target[context.strongest.frame.values == frame].tolist()) - {-1}


def _strongest_detection_estimate_card(context: PageContext, name: str, unit: str) -> Card:
    first, error = context.strongest.isel(detection=0), math.nan
    scale = math.degrees(1) if unit == "°" else 1.0
    if context.matched is not None:
        errors = {
            "range": context.matched.range_error_m,
            "velocity": context.matched.velocity_error_m_per_s,
            "azimuth": context.matched.azimuth_error_rad,
            "elevation": context.matched.elevation_error_rad,
        }
        error = float(errors[name][0]) * scale
    std = first[f"{name}_std"] * scale
    decimals = decimals_for_std(float(std))
    number, _, spread = format_with_std(float(first[name]) * scale, float(std), decimals).partition(
        " "
    )
    unit_after = f"\N{NO-BREAK SPACE}{unit}"
    small_print = (
        f"error {_format_error_with_sigma_ratio(error, std, decimals, unit_after)}"
        if math.isfinite(error)
        else ""
    )
    return Card(name=name, number=number, std=spread, unit=unit, small_print=small_print)


def _threshold_margin_cards(context: PageContext) -> list[Card]:
    """Return the card of peak over threshold, if the strongest detection is on the map."""
    power, threshold = (
        context.value_at_strongest_cell(context.result.power),
        context.value_at_strongest_cell(context.result.threshold),
    )
    in_map = int(context.strongest.frame[0]) == context.result.first_frame
    if not (in_map and power > 0 and 0 < threshold < math.inf):
        return []
    probability = context.result.scenario.chain.cfar.false_alarm_probability
    note = (
        ""
        if probability is None
        else f"set for {format_probability(probability)} false alarms a cell"
    )
    margin_db = format_fixed(ratio_db(power / threshold), 1)
    return [Card(name="over the threshold", number=margin_db, unit="dB", small_print=note)]


def _format_estimates(detections: xr.Dataset, column: DetectionColumn, decimals: int) -> list[str]:
    """Write a column of the table of detections, with standard errors where there are some."""
    estimates = column.to_shown_unit(detections[column.name].values)
    std = standard_error_column(column)
    if std is None:
        return column.format_shown_values(estimates)
    stds = std.to_shown_unit(detections[std.name].values)
    return [
        format_with_std(estimate, error, decimals)
        if math.isfinite(estimate) or column.shown_unit != "deg"
        else EN_DASH
        for estimate, error in zip(estimates.tolist(), stds.tolist(), strict=True)
    ]


def _format_error_with_sigma_ratio(
    error: float, std: xr.DataArray, decimals: int, unit: str = ""
) -> str:
    """Format an error and its ratio to the standard error."""
    if not math.isfinite(error):
        return EN_DASH
    text = format_fixed(error, decimals, sign=True) + unit
    if not float(std) > 0:
        return text
    return f"{text} ({format_fixed(abs(error) / float(std), 1)}\N{NO-BREAK SPACE}{_SIGMA})"


def _format_count_with_noun(n: int, thing: str) -> str:
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"
