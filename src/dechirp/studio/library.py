"""Scan of the studio folders for recordings, radar settings and scenarios.

Names are relative to the given folder; the browser receives no path above it.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Literal

from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import read_settings_text
from dechirp.config.yaml_tree import replace_repeated_labels_by_index
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.findings import Finding
from dechirp.experiments.inspection import inspect
from dechirp.experiments.scenario import (
    RecordingSource,
    Scenario,
    check_tracks_and_ego_motion_possible,
)
from dechirp.processing.chain import Chain, n_searched_range_rows
from dechirp.radar.radar import Radar
from dechirp.recordings.recognise import recognise_formats
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.read import holds_settings
from dechirp.studio.folders import MAX_DEPTH, MAX_NAMES, is_file_or_folder_inside, is_tree_inside
from dechirp.studio.option_hints import translate_error_fixes_to_page, translate_finding_to_page
from dechirp.studio.scenario_edits import PageLimits, check_settings_within_limits, parse_scenario

MAX_SCANNED = 500
"""Largest number of scanned files and folders; recognising one takes 5 ms."""
MAX_INSPECTED_FRAMES = 8
"""Number of inspected frames of a recording."""

_SUFFIXES = (".yaml", ".yml")

ItemKind = Literal["recording", "settings", "scenario"]


@dataclass(frozen=True)
class LibraryItem:
    """File or folder that can be opened, or that contains settings."""

    kind: ItemKind
    name: str
    """Path relative to the given folder."""
    path: Path
    formats: tuple[str, ...] = ()
    """Possible formats of a recording: one, or several for raw samples."""
    n_bytes: int = 0
    """Size of a file; 0 for a folder."""


@dataclass(frozen=True)
class InspectedRecording:
    """Result of the inspection of a recording."""

    n_frames: int | None
    """None if it cannot be played; the findings state why."""
    n_inspected: int
    findings: tuple[Finding, ...]


class FolderScan:
    """Incremental scan of the folders.

    Hidden names, links that leave the folders, and entries that are neither file nor folder are
    skipped. Only the first `MAX_SCANNED` entries are scanned, folder by folder in order of names.
    """

    def __init__(self, limits: PageLimits) -> None:
        self.items: list[LibraryItem] = []
        self.n_scanned = 0
        self.is_done = False
        self._work = islice(_iter_items_of_folders(limits), MAX_SCANNED)

    def scan_for(self, duration_s: float) -> None:
        """Scan for a duration, and until the end of the current file."""
        until_s = perf_counter() + duration_s
        for item in self._work:
            self.n_scanned += 1
            if item is not None:
                self.items.append(item)
            if perf_counter() >= until_s:
                return
        self.is_done = True


def inspect_first_frames(
    item: LibraryItem, radar_settings: LibraryItem | None, limits: PageLimits
) -> InspectedRecording:
    """Inspect the first frames of a recording; errors are returned as findings."""
    try:
        radar = None if radar_settings is None else _allowed_path_or_raise(radar_settings, limits)
        path = _allowed_path_or_raise(item, limits)
        recording = open_recording(path, radar=radar)
        recording.check_has_samples()
        check_settings_within_limits({"radar": recording.radar}, limits)
        n_inspected = min(recording.n_frames, MAX_INSPECTED_FRAMES)
        findings = inspect(path, radar=radar, frames=(0, n_inspected)).findings
        n_frames = recording.n_frames
    except DechirpError as error:
        n_frames, n_inspected = None, 0
        findings = tuple(Finding.from_mistake(entry, level="error") for entry in error.mistakes)
    return InspectedRecording(
        n_frames,
        n_inspected,
        tuple(_adapt_fix_and_hide_folders(entry, limits) for entry in findings),
    )


def open_item_as_scenario(
    scenario: Scenario, item: LibraryItem, radar_settings: LibraryItem | None, limits: PageLimits
) -> Scenario:
    """Open an item: a scenario file, or a recording.

    After a scene, a recording has the default chain, as in `dechirp run FILE`, with the clusters
    and the tracker of the scene. After a recording it keeps the chain, but training cells that do
    not fit into its map are replaced by the default ones, which adapt. A tracker that the
    recording does not support is removed.

    Raises
    ------
    DechirpError
        If it cannot be read, exceeds the limits or is no longer in the folders.
    """
    path = _allowed_path_or_raise(item, limits)
    if item.kind == "scenario":
        file_limits = replace(limits, folders=(path.parent, *limits.folders))
        return parse_scenario(read_settings_text(path), file_limits)
    settings_path = (
        None if radar_settings is None else str(_allowed_path_or_raise(radar_settings, limits))
    )
    source = RecordingSource(path=str(path), settings_path=settings_path)
    with translate_error_fixes_to_page():
        recording = open_recording(path, radar=settings_path)
    opened_scenario = replace(
        scenario,
        name=path.stem,
        scene=None,
        radar=None,
        recording=source,
        chain=(
            replace(Chain(), cluster=scenario.chain.cluster)
            if scenario.recording is None
            else _chain_for_recording(scenario.chain, recording.radar)
        ),
    )
    try:
        check_tracks_and_ego_motion_possible(opened_scenario, recording.radar)
    except InvalidSetting:  # no azimuth resolution
        opened_scenario = replace(
            opened_scenario, tracker=None, group_tracker=None, ego_motion=None
        )
    return parse_scenario(dump_yaml(opened_scenario), limits)


def _chain_for_recording(chain: Chain, radar: Radar) -> Chain:
    """Return the chain, with default training cells if its own do not fit into the map."""
    fitted = chain.fit_to_radar(radar)
    n_range = n_searched_range_rows(radar.frame.chirp, chain.range_transform(radar.frame.chirp))
    n_velocity = chain.doppler_transform(radar.frame).n_bins
    try:
        fitted.cfar.training_window.check_map_size(n_velocity, n_range)
    except InvalidSetting:
        default = Chain().cfar
        cfar = replace(chain.cfar, n_training=default.n_training, n_guard=default.n_guard)
        return replace(chain, cfar=cfar)
    return chain


def _iter_items_of_folders(limits: PageLimits) -> Iterator[LibraryItem | None]:
    visited = {folder.resolve() for folder in limits.folders}
    labels = replace_repeated_labels_by_index(folder.name for folder in limits.folders)
    for folder, label in zip(limits.folders, labels, strict=True):
        prefix = f"{label}/" if len(labels) > 1 else ""
        yield from _iter_items_of_folder(folder.resolve(), prefix, MAX_DEPTH, visited, limits)


def _iter_items_of_folder(
    folder: Path, name_prefix: str, depth: int, visited_paths: set[Path], limits: PageLimits
) -> Iterator[LibraryItem | None]:
    try:
        with os.scandir(folder) as entries:
            entry_by_name = {entry.name: entry for entry in islice(entries, MAX_NAMES)}
    except OSError:  # not readable
        return
    for name in sorted(entry_by_name):
        if name.startswith("."):
            continue
        path = (
            (folder / name).resolve()
            if is_file_or_folder_inside(entry_by_name[name], limits.folders)
            else None
        )
        if path is None or path in visited_paths:
            yield None
            continue
        visited_paths.add(path)
        item = _recognise_item(path, f"{name_prefix}{name}", limits)
        yield item
        if item is None and depth and path.is_dir():
            yield from _iter_items_of_folder(
                path, f"{name_prefix}{name}/", depth - 1, visited_paths, limits
            )


def _recognise_item(path: Path, name: str, limits: PageLimits) -> LibraryItem | None:
    if not is_tree_inside(path, limits.folders):
        return None
    n_bytes = path.stat().st_size if path.is_file() else 0
    if path.is_file() and _is_scenario_file(path, limits):
        return LibraryItem("scenario", name, path, n_bytes=n_bytes)
    if path.is_file() and holds_settings(path):
        return LibraryItem("settings", name, path, n_bytes=n_bytes)
    try:
        return LibraryItem("recording", name, path, recognise_formats(path), n_bytes)
    except DechirpError:
        return None


def _is_scenario_file(path: Path, limits: PageLimits) -> bool:
    if path.suffix.lower() not in _SUFFIXES or path.stat().st_size > limits.max_text_length:
        return False
    try:
        text = read_settings_text(path)
    except DechirpError:
        return False
    return any(line.startswith(("scene:", "recording:")) for line in text.splitlines())


def _allowed_path_or_raise(item: LibraryItem, limits: PageLimits) -> Path:
    """Return the path of an item, if it is still allowed as at the scan."""
    if not is_tree_inside(item.path, limits.folders):
        raise InvalidSetting(
            "recording.path",
            value=f"{item.name}, which does not exist or is outside the folders",
            expected="a file or folder in the folders of the studio",
            fix="scan the folders again",
        )
    return item.path


def _adapt_fix_and_hide_folders(finding: Finding, limits: PageLimits) -> Finding:
    """Return a finding without folder paths, with a fix that the page offers."""
    finding = translate_finding_to_page(finding)
    parts = {name: getattr(finding, name) for name in ("value", "expected", "fix")}
    for folder in limits.folders:
        parts = {name: text.replace(f"{folder}/", "") for name, text in parts.items()}
    return replace(finding, **parts)
