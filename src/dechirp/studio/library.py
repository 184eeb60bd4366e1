"""What lies in the folders of the studio: recordings, settings of radars, and scenarios.

Names start at the folder that was given; a browser is told no path above it.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from time import perf_counter
from typing import Literal

from dechirp.config.files import text_in
from dechirp.config.texts import dump
from dechirp.config.tree import distinct
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.findings import Finding
from dechirp.experiment.inspection import inspect
from dechirp.experiment.scenario import Scenario, Source, check_following
from dechirp.formats.recognise import recognised
from dechirp.formats.recording import open as open_recording
from dechirp.formats.settings.read import holds_settings
from dechirp.studio.advice import advised, for_page
from dechirp.studio.folders import DEEPEST, MOST_NAMES, is_plain, stays
from dechirp.studio.settings import Limits, must_be_small, parsed

MOST_LOOKED = 500
"""Files and folders that are looked at; to recognise one takes 5 ms."""
MOST_INSPECTED = 8
"""Frames of a recording that are looked over."""

_SUFFIXES = (".yaml", ".yml")

Kind = Literal["recording", "settings", "scenario"]


@dataclass(frozen=True)
class Item:
    """Something that can be opened, or opens something."""

    kind: Kind
    name: str
    """From the folder on."""
    path: Path
    formats: tuple[str, ...] = ()
    """That a recording may have: one, or several of bare samples."""
    n_bytes: int = 0
    """Of a file; of a folder 0."""


@dataclass(frozen=True)
class LookedOver:
    """What is known of a recording before it is played."""

    n_frames: int | None
    """None where it cannot be played as it is; the findings say why."""
    n_inspected: int
    findings: tuple[Finding, ...]


class Library:
    """What there is to open in the folders, looked through a few files at a time.

    Hidden names, links that lead out of the folders, and all that is neither file nor folder are
    left out. Of more than `MOST_LOOKED` the first are looked at, folder by folder by name.
    """

    def __init__(self, limits: Limits) -> None:
        self.items: list[Item] = []
        self.n_looked = 0
        self.is_done = False
        self._work = islice(_walk(limits), MOST_LOOKED)

    def look(self, within_s: float) -> None:
        """Look on for so long, and to the end of the file that is then under way."""
        until_s = perf_counter() + within_s
        for item in self._work:
            self.n_looked += 1
            if item is not None:
                self.items.append(item)
            if perf_counter() >= until_s:
                return
        self.is_done = True


def looked_over(item: Item, settings: Item | None, limits: Limits) -> LookedOver:
    """What `inspect` says of the first frames of a recording; all that is wrong is a finding."""
    try:
        radar = None if settings is None else _reached(settings, limits)
        path = _reached(item, limits)
        recording = open_recording(path, radar=radar)
        recording.must_hold_samples()
        must_be_small({"radar": recording.radar}, limits)
        n_inspected = min(recording.n_frames, MOST_INSPECTED)
        found = inspect(path, radar=radar, frames=(0, n_inspected)).findings
        n_frames = recording.n_frames
    except DechirpError as error:
        n_frames, n_inspected = None, 0
        found = tuple(Finding.of(one, level="error") for one in error.mistakes)
    return LookedOver(n_frames, n_inspected, tuple(_on_page(one, limits) for one in found))


def opened(scenario: Scenario, item: Item, settings: Item | None, limits: Limits) -> Scenario:
    """Scenario of an item: a recording with the chain of the present one, or what a file says.

    Tracks are told where they can be.

    Raises
    ------
    DechirpError
        If it cannot be read, or is more than the limits, or no longer lies in the folders.
    """
    path = _reached(item, limits)
    if item.kind == "scenario":
        beside = replace(limits, folders=(path.parent, *limits.folders))
        return parsed(text_in(path), beside)
    told = None if settings is None else str(_reached(settings, limits))
    source = Source(path=str(path), settings_path=told)
    made = replace(scenario, name=path.stem, scene=None, radar=None, recording=source)
    with advised():
        recording = open_recording(path, radar=told)
    try:
        check_following(made, recording.radar, recording.n_frames)
    except InvalidSetting:  # its array tells no azimuth, or it is too short
        made = replace(made, tracker=None, ego_motion=None)
    return parsed(dump(made), limits)


def _walk(limits: Limits) -> Iterator[Item | None]:
    seen = {folder.resolve() for folder in limits.folders}
    labels = distinct(folder.name for folder in limits.folders)
    for folder, label in zip(limits.folders, labels, strict=True):
        start = f"{label}/" if len(labels) > 1 else ""
        yield from _inside(folder.resolve(), start, DEEPEST, seen, limits)


def _inside(
    folder: Path, start: str, deeper: int, seen: set[Path], limits: Limits
) -> Iterator[Item | None]:
    try:
        with os.scandir(folder) as entries:
            named = {entry.name: entry for entry in islice(entries, MOST_NAMES)}
    except OSError:  # nobody may read it
        return
    for name in sorted(named):
        if name.startswith("."):
            continue
        path = (folder / name).resolve() if stays(named[name], limits.folders) else None
        if path is None or path in seen:
            yield None
            continue
        seen.add(path)
        item = _item(path, f"{start}{name}", limits)
        yield item
        if item is None and deeper and path.is_dir():
            yield from _inside(path, f"{start}{name}/", deeper - 1, seen, limits)


def _item(path: Path, name: str, limits: Limits) -> Item | None:
    if not is_plain(path, limits.folders):
        return None
    n_bytes = path.stat().st_size if path.is_file() else 0
    if path.is_file() and _holds_scenario(path, limits):
        return Item("scenario", name, path, n_bytes=n_bytes)
    if path.is_file() and holds_settings(path):
        return Item("settings", name, path, n_bytes=n_bytes)
    try:
        return Item("recording", name, path, recognised(path), n_bytes)
    except DechirpError:
        return None


def _holds_scenario(path: Path, limits: Limits) -> bool:
    if path.suffix.lower() not in _SUFFIXES or path.stat().st_size > limits.most_text:
        return False
    try:
        text = text_in(path)
    except DechirpError:
        return False
    return any(line.startswith(("scene:", "recording:")) for line in text.splitlines())


def _reached(item: Item, limits: Limits) -> Path:
    """Path of an item, if it is still what it was when the folders were looked through."""
    if not is_plain(item.path, limits.folders):
        raise InvalidSetting(
            "recording.path",
            got=f"{item.name}, which is not there, or leads out of the folders",
            need="a file or folder in the folders of the studio",
            fix="Look through the folders again.",
        )
    return item.path


def _on_page(finding: Finding, limits: Limits) -> Finding:
    """The same without the paths of the folders, and with what the page has to mend it."""
    finding = replace(finding, fix=for_page(finding.fix))
    said = {name: getattr(finding, name) for name in ("got", "need", "fix")}
    for folder in limits.folders:
        said = {name: words.replace(f"{folder}/", "") for name, words in said.items()}
    return replace(finding, **said)
