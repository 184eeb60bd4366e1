"""Table of the detections of a frame, strongest first."""

from collections.abc import Iterator

import numpy as np
from bokeh.models import UIElement

from dechirp.core.detection_columns import (
    BY_NAME,
    SHOWN_COLUMNS,
    decimals_of_estimates,
    standard_error_column,
)
from dechirp.core.display import format_count_with_noun
from dechirp.core.text import EN_DASH, format_std
from dechirp.evaluation.association import GATE_CELLS, Associator
from dechirp.radar.resolution_cells import to_resolution_cells
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.map_markers import (
    detection_map_positions_and_azimuths,
    detection_order_by_snr,
)
from dechirp.studio.views.table_tile import MAX_ROWS, Heading, TableTile, row_at_cursor


def _column_headings() -> Iterator[tuple[str, Heading]]:
    for column in SHOWN_COLUMNS:
        title, std = column.heading_with_unit, standard_error_column(column)
        decimals = None if column.is_flag else column.decimals
        yield column.name, Heading(title, decimals, 75 if len(title) > 12 else 60)
        if std is not None:
            yield std.name, Heading(f"± {column.shown_unit_symbol}", width=52)


_HEADINGS = {**dict(_column_headings()), "target": Heading("target", width=90)}
_HIDDEN_IF_UNKNOWN = tuple(
    name for name in _HEADINGS if name in BY_NAME and BY_NAME[name].is_hidden_if_unknown
)
_FLAGS = {column.name for column in SHOWN_COLUMNS if column.is_flag}
_NO_TARGET = "none"
_ALIASED = " (aliased)"


class DetectionsView(View):
    """Estimates with standard errors and targets; selecting a row moves the cursor."""

    name = "detections"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.table = TableTile(self.name, _HEADINGS, on_pick=session.move_cursor)

    @property
    def root_element(self) -> UIElement:
        return self.table.root_element

    def show_frame(self, frame_state: FrameState) -> None:
        targets = self._nearest_target_names(frame_state)
        is_aliased = np.isin(targets, _names_of_targets_aliased_in_range(frame_state))
        columns = shown_detection_columns(frame_state)
        map_positions, _ = detection_map_positions_and_azimuths(frame_state)
        cursors = [Cursor(*map(float, place)) for place in zip(*map_positions, strict=True)]
        visible = {
            key: bool(np.isfinite(column).any())
            for key, column in columns.items()
            if key in _HIDDEN_IF_UNKNOWN
        }
        frame = frame_state.radar.for_frame(0).frame
        decimals = decimals_of_estimates(
            frame_state.detections,
            range_cell_m=frame.chirp.range_resolution_m,
            velocity_cell_m_per_s=frame.velocity_resolution_m_per_s,
        )
        for name, n_decimals in decimals.items():
            stds = columns[f"{name}_std"]
            texts = [format_std(std, n_decimals) for std in stds.tolist()]
            columns[f"{name}_std"] = np.array(texts, dtype=object)
        for name in _FLAGS & columns.keys():
            columns[name] = np.array(BY_NAME[name].format_shown_values(columns[name]), dtype=object)
        columns["target"] = np.where(is_aliased, targets + _ALIASED, targets)
        self.table.set_column_visibility(visible | {"target": frame_state.truth is not None})
        self.table.show_rows(
            _detections_title(targets, is_aliased, frame_state),
            columns,
            cursors=cursors,
            selected=row_at_cursor(map_positions, frame_state),
            decimals=decimals,
        )

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _nearest_target_names(self, frame_state: FrameState) -> np.ndarray:
        """Return the target name of each detection, strongest first."""
        scenario, truth = self.session.scenario, frame_state.truth
        order = detection_order_by_snr(frame_state)
        if truth is None or scenario.radar is None:
            return np.full(order.size, EN_DASH, dtype=object)
        variables = frame_state.detections.variables
        columns = {str(name): column.values for name, column in variables.items()}
        associator = Associator(truth, scenario.radar, frame_state.scene)
        target = associator.nearest_target_indices(columns)[order]
        names = np.array([*truth.target.values.tolist(), _NO_TARGET], dtype=object)
        return np.asarray(names[target])


def shown_detection_columns(frame_state: FrameState) -> dict[str, np.ndarray]:
    """Return the columns of the detections, strongest first: angles in degrees, SNR in dB."""
    # As variables: labelled access to twenty columns takes 0.3 ms.
    columns, order = frame_state.detections.variables, detection_order_by_snr(frame_state)
    return {
        key: BY_NAME[key].to_shown_unit(columns[key].values[order])
        for key in _HEADINGS
        if key in columns and key in BY_NAME
    }


def _names_of_targets_aliased_in_range(frame_state: FrameState) -> list[str]:
    """Return the targets whose echoes appear two cells or more from their true range."""
    truth, radar = frame_state.truth, frame_state.radar
    if truth is None:
        return []
    range_m, velocity = (truth.variables[name].values.ravel() for name in ("range", "velocity"))
    apparent_m = alias_range_velocity(RangeVelocity(range_m, velocity), radar).range_m
    ranges_m = np.stack([range_m, apparent_m])
    at_rest, unknown = np.zeros(ranges_m.shape), np.full(ranges_m.shape, np.nan)
    true_cells, apparent_cells = to_resolution_cells(ranges_m, at_rest, unknown, unknown, radar)[
        ..., 0
    ]
    is_aliased = abs(apparent_cells - true_cells) > GATE_CELLS
    return list(truth.variables["target"].values[is_aliased].astype(str))


def _detections_title(
    target_names: np.ndarray, is_aliased: np.ndarray, frame_state: FrameState
) -> str:
    """Return the numbers of detections and of targets found at their true range as a title."""
    n = target_names.size
    title = "Nothing detected" if n == 0 else format_count_with_noun(n, "detection")
    if n > MAX_ROWS:
        title = f"The strongest {MAX_ROWS} of {title}"
    if frame_state.truth is None:
        return title
    names = frame_state.truth.target.values.tolist()
    n_found = len(set(target_names[~is_aliased].tolist()) & set(names))
    if names:
        title += f": {n_found} of {format_count_with_noun(len(names), 'target')} found"
        title += " at the true range" if n_found else ""
    if is_aliased.any():
        title += f", {is_aliased.sum()} aliased to a wrong range"
    return f"{title}, {int(np.sum(target_names == _NO_TARGET))} of no target" if n else title
