"""Terminal output of a run: tables of detections and tracks, with the truth if known."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from rich.cells import cell_len
from rich.table import Table

from dechirp.cli.console import new_table
from dechirp.core.detection_columns import (
    SHOWN_COLUMNS,
    decimals_of_estimates,
    rows_to_show,
    shown_columns,
    standard_error_column,
)
from dechirp.core.display import format_count_with_noun
from dechirp.core.text import EN_DASH, format_fixed, format_with_std, join_names
from dechirp.evaluation.association import associate_detections
from dechirp.experiments.run import Result, leakage_in_recording
from dechirp.report import objects_section

# Columns dropped first on a narrow terminal: true values before measured ones.
_FIRST_DROPPED = (
    *("true elevation", "true azimuth", "true velocity", "true range"),
    *("moving", "SNR", "elevation", "azimuth", "frame"),
)


def strongest_detections_table(result: Result, *, at_most: int, width: int) -> Table:
    """Return a table of the strongest detections, with the columns that fit the width."""
    frame = result.radar.for_frame(0).frame
    rows = rows_to_show(
        result.detections,
        at_most,
        range_cell_m=frame.chirp.range_resolution_m,
        velocity_cell_m_per_s=frame.velocity_resolution_m_per_s,
        is_leakage=leakage_in_recording(result, result.detections),
    )
    n_all, n_shown = result.detections.sizes["detection"], rows.size
    strongest = result.detections.isel(detection=rows)
    title = format_count_with_noun(n_all, "detection")
    if n_shown < n_all:
        n_moving = int(np.sum(strongest.moving.values == 1)) if "moving" in strongest else 0
        title += f"; {n_shown} shown"
        if 0 < n_moving < n_shown:
            moving = f"{n_moving} that move{'s' if n_moving == 1 else ''}"
            title += f", {moving} and {format_count_with_noun(n_shown - n_moving, 'other')}"
        title += ": the strongest of each place (complete list: detections.csv)"
    columns = _detection_table_cells(result, strongest)
    if _table_width(columns) > width:
        columns = _detection_table_cells(result, strongest, is_rounded=True)
        if len(set(columns.get("moving", ()))) == 1:
            del columns["moving"]
    # In a selection from many frames, which echoes move says more than the frame.
    left_out = []
    for name in ("frame", *_FIRST_DROPPED) if n_shown < n_all else _FIRST_DROPPED:
        if _table_width(columns) > width and columns.pop(name, None) is not None:
            left_out.append(name)
    if left_out:
        title += f"; not shown in a width of {width} characters: {join_names(left_out)}"
    if EN_DASH in columns.get("moving", ()):
        title += f"; {EN_DASH} under Moving: the motion is uncertain"
    table = new_table(title, number_columns=[_shown_column_heading(name) for name in columns])
    for cells in zip(*columns.values(), strict=True):
        table.add_row(*cells)
    return table


_TITLES = {column.heading: column.heading_with_unit for column in SHOWN_COLUMNS}


def _shown_column_heading(name: str) -> str:
    return "true" if name.startswith("true ") else _TITLES.get(name, name)


def _table_width(columns: dict[str, list[str]]) -> int:
    cells = ([_shown_column_heading(name), *column] for name, column in columns.items())
    return sum(2 + max(map(cell_len, column)) for column in cells)  # with two spaces between


def _detection_table_cells(
    result: Result, detections: xr.Dataset, *, is_rounded: bool = False
) -> dict[str, list[str]]:
    """Return the cells of each column, from the left; angles and motion only if any is known.

    Rounded cells have a digit less of the standard errors.
    """
    columns: dict[str, list[str]] = {}
    if result.n_frames > 1:
        columns["frame"] = [str(frame) for frame in detections.frame.values.tolist()]
    target = None if result.truth is None else _matched_target_indices(result, detections)
    frame = result.radar.for_frame(0).frame
    decimals_by_name = decimals_of_estimates(
        detections,
        range_cell_m=frame.chirp.range_resolution_m,
        velocity_cell_m_per_s=frame.velocity_resolution_m_per_s,
        digits=1 if is_rounded else 2,
    )
    for column in shown_columns(detections):
        values = column.to_shown_unit(detections[column.name].values)
        std = standard_error_column(column)
        if std is None:
            columns[column.heading] = column.format_shown_values(values)
            continue
        stds, decimals = (
            std.to_shown_unit(detections[std.name].values),
            decimals_by_name[column.name],
        )
        columns[column.heading] = [
            format_with_std(value, error, decimals) if np.isfinite(value) else EN_DASH
            for value, error in zip(values.tolist(), stds.tolist(), strict=True)
        ]
        if result.truth is not None and target is not None and column.name in result.truth:
            frame_numbers = detections.frame.values
            true = _true_values_of_detections(result.truth[column.name], target, frame_numbers)
            columns[f"true {column.heading}"] = [
                format_fixed(value, decimals) for value in column.to_shown_unit(true).tolist()
            ]
    if result.truth is not None and target is not None:
        names = result.truth.target.values
        columns["target"] = [
            str(names[value]) if value >= 0 else EN_DASH for value in target.tolist()
        ]
    return columns


def _true_values_of_detections(
    truth: xr.DataArray, target_indices: np.ndarray, frame_numbers: np.ndarray
) -> np.ndarray:
    """Return the truth of the target of each detection, NaN for unmatched detections."""
    values = np.full(len(target_indices), np.nan)
    is_matched = target_indices >= 0
    frame_index = truth.indexes["frame"].get_indexer(frame_numbers[is_matched])
    values[is_matched] = truth.transpose("target", "frame").values[
        target_indices[is_matched], frame_index
    ]
    return values


_TRACK_HEADINGS = {
    "number": "track",
    "frames": "frames",
    "x": "x (m)",
    "y": "y (m)",
    "vx": "vx (m/s)",
    "vy": "vy (m/s)",
    "size": "size (m)",
    "target": "target",
}


def track_table_and_object_sentences(
    result: Result, *, at_most: int, width: int
) -> Iterator[Table | str]:
    """Yield a table of tracks and sentences on ego motion, clusters and tracks."""
    tracks = objects_section.track_table_rows(result, at_most)
    if tracks and result.tracks is not None:
        n_all = result.tracks.sizes["track"]
        title = f"{n_all} track{'' if n_all == 1 else 's'}, last state"
        if len(tracks) < n_all:
            title += f": the first {len(tracks)} (complete list: tracks.csv)"
        headings = {name: head for name, head in _TRACK_HEADINGS.items() if name in tracks[0]}
        columns = {head: [row[name] for row in tracks] for name, head in headings.items()}
        if result.truth is None:
            del columns["target"]
        for name in ("frames", "target", "track"):
            if _table_width(columns) > width:
                columns.pop(name, None)
        table = new_table(title, number_columns=columns)
        for cells in zip(*columns.values(), strict=True):
            table.add_row(*cells)
        yield table
    summary = " ".join(
        [
            *objects_section.describe_ego_clusters_and_tracks(result),
            objects_section.describe_number_of_targets_with_tracks(result),
        ]
    ).strip()
    if summary:
        yield summary


def vital_signs_table(vital: xr.Dataset) -> Table:
    """Return a table of the rates of each window, with their confidence intervals."""
    from dechirp.experiments.vital_signs import VITAL_SIGN_HEADINGS, vital_sign_rows

    table = new_table(
        f"Vital signs, {vital.attrs['confidence']:.0%} intervals",
        number_columns=VITAL_SIGN_HEADINGS,
    )
    for row in vital_sign_rows(vital):
        table.add_row(*row)
    return table


def missed_target_lines(result: Result) -> Iterator[str]:
    """Yield a line for each target without a detection in any frame."""
    truth = result.truth
    if truth is None:
        return
    hits = set(_matched_target_indices(result, result.detections).tolist())
    for index, name in enumerate(truth.target.values.tolist()):
        if index not in hits:
            first = truth.isel(target=index, frame=0)
            place = (
                f"{format_fixed(float(first.range), 1)} m,"
                f" {format_fixed(float(first.velocity), 1)} m/s"
            )
            yield f"Not detected: {name}, at {place} in the first frame."


def _matched_target_indices(result: Result, detections: xr.Dataset) -> np.ndarray:
    assert result.truth is not None
    scene = result.scenario.scene
    return associate_detections(detections, result.truth, result.radar, scene).target
