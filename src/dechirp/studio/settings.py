"""Texts of the page to a scenario: the grammar of settings files, within what a page may ask for.

A page may name files of the folders that were given to the studio, and no others; what a file
leads to by links counts as where it ends. All of that is known before a file is opened, and
before anything is computed whose size the settings say.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from dechirp.config import within
from dechirp.config.fields import Slot
from dechirp.config.files import in_order, text_in, value_of
from dechirp.config.mistakes import Spot, refused
from dechirp.config.models import Context
from dechirp.config.overrides import given, override
from dechirp.config.shown import shown
from dechirp.config.texts import dump
from dechirp.config.tree import read_tree
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting, Mistake
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Impairment
from dechirp.experiment.scenario import READERS, Scenario
from dechirp.experiment.study.variants import must_be_apart
from dechirp.process.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.scene.bodies.mesh import Mesh
from dechirp.scene.scene import Scene
from dechirp.studio.folders import is_inside, is_plain

_FILE = "settings"
"""What messages call the text of the page."""
_SIZED = ("n_frames", "radar", "scene", "impairments", "chain")
"""Settings of a scenario that say how much work it is."""


@value
class Limits:
    """What one page may ask of the machine, and which files it may name."""

    folders: tuple[Path, ...] = ()
    """Files in them may be named in settings, and opened as recordings."""
    most_text: int = 2**16
    """Characters of settings."""
    most_samples: int = 2**22
    """In a frame; cells of a map, too."""
    most_targets: int = 100
    most_scatterers: int = 20_000
    most_rays: int = 20_000_000
    """Of all meshes, for a frame from a direction of its own: some 25 s."""
    most_frames: int = 2000
    frame_s: float = 1 / 30
    """Shortest time from one frame to the next."""


def parsed(text: str, limits: Limits) -> Scenario:
    """Scenario of the text of a file; relative paths in it start at the first folder.

    Raises
    ------
    DechirpError
        With every mistake, with line and column; with the files that may not be named; with
        what is more than the limits, before it is begun.
    """
    _must_be_short("the settings", text, limits)
    return _read(text, (), limits)


def changed(scenario: Scenario, options: Iterable[str], limits: Limits) -> Scenario:
    """Scenario with some settings changed, each as PATH=VALUE, together.

    Raises
    ------
    DechirpError
        As `parsed`, with the paths of settings alone.
    """
    options = tuple(options)
    for option in options:
        _must_be_short(shown(option.partition("=")[0]), option, limits)
    try:
        return _in_place(scenario, options, limits)
    except DechirpError:
        pass  # once more as text, for the words of what is wrong: 50 ms instead of 1
    try:
        return _read(dump(scenario), options, limits)
    except InvalidFile as error:
        raise InvalidFile(*map(_without_place, error.mistakes)) from None


def checked(scenario: Scenario, limits: Limits) -> Scenario:
    """Give the same scenario, or raise `InvalidSetting` if it is more than the limits."""
    must_be_small({name: getattr(scenario, name) for name in _SIZED}, limits)
    return scenario


def must_be_small(parts: Mapping[str, Any], limits: Limits) -> None:
    """Raise `InvalidSetting` where parts of a scenario, by name, are more than the limits."""
    radar: Radar | None = parts.get("radar")
    scene: Scene | None = parts.get("scene")
    chain: Chain = parts.get("chain") or Chain()
    impairments: tuple[Impairment, ...] = parts.get("impairments") or ()
    sizes = [("n_frames", parts.get("n_frames") or 1, limits.most_frames, "frames")]
    n_range, n_velocity = chain.n_range_bins or 1, chain.n_velocity_bins or 1
    if radar is not None:
        chirp, frame = radar.frame.chirp, radar.frame
        n_samples = chirp.n_samples * frame.n_sent * radar.array.n_rx
        sizes += [("radar.frame", n_samples, limits.most_samples, "samples")]
        n_range = chain.n_range_bins or chirp.n_samples
        n_velocity = chain.n_velocity_bins or frame.n_chirps
    sizes += [("chain", n_range * n_velocity, limits.most_samples, "cells of the map")]
    if scene is not None:
        bodies = [target.body for target in scene.targets]
        n_scatterers = sum(1 if body is None else body.n_scatterers() for body in bodies)
        sizes += [
            ("scene.targets", len(bodies), limits.most_targets, "targets"),
            ("scene.targets", n_scatterers, limits.most_scatterers, "scatterers"),
        ]
        if radar is not None:
            meshes = [body for body in bodies if isinstance(body, Mesh)]
            n_rays = sum(mesh.n_rays(radar.frame.chirp.wavelength_m) for mesh in meshes)
            sizes += [("scene.targets", n_rays, limits.most_rays, "rays onto meshes")]
    added = sum(
        getattr(one, field.name)
        for one in impairments
        for field in fields(one)  # type: ignore[arg-type]  # members are values
        if field.name == "n_scatterers"
    )
    sizes += [("impairments", added, limits.most_scatterers, "scatterers")]
    for setting, n, most, words in sizes:
        if n > most:
            raise InvalidSetting(
                setting,
                got=f"{n:,} {words}",
                need=f"at most {most:,} on this page",
                fix="Take fewer, or save the settings and run them on the command line.",
            )


def _must_be_short(setting: str, text: str, limits: Limits) -> None:
    if len(text) > limits.most_text:
        raise InvalidSetting(
            setting,
            got=f"a text of {len(text):,} characters",
            need=f"at most {limits.most_text:,}",
            fix="Run what is larger on the command line.",
        )


def _read(text: str, options: Iterable[str], limits: Limits) -> Scenario:
    context = _context(limits)
    spot = Spot("", read_tree(text, _FILE), Slot(Scenario))
    _must_be_inside(spot, context, limits)
    for option in options:
        spot = replace(spot, node=override(spot, option, context))
        _must_be_inside(spot, context, limits)  # before the next option looks into a file
    parts = {}
    for name in _SIZED:
        part = spot.step(name)
        with suppress(DechirpError):  # told below with all others, and nothing comes of it
            parts[name] = value_of(part, context) if part else None
    try:
        must_be_small(parts, limits)
    except InvalidSetting as error:
        raise InvalidFile(*refused(error, spot)) from None
    made: Scenario = value_of(spot, context)
    return made


def _in_place(scenario: Scenario, options: Iterable[str], limits: Limits) -> Scenario:
    context = _context(limits)
    asked = [(within.way_to(scenario, path), node) for path, node in map(given, options)]
    must_be_apart(way for way, _ in asked)
    below: dict[str, dict[within.Steps, Any]] = {}
    for way, node in asked:
        _must_be_inside(Spot(way.path, node, way.leaf), context, limits)
        first, *rest = way.steps
        steps, made = tuple(rest), within.read_at(scenario, way, node, context)
        if steps in below.setdefault(str(first), {}):
            raise InvalidFile  # two settings of what is none as yet: as text
        below[str(first)][steps] = made
    parts = {name: within.changed(getattr(scenario, name), of) for name, of in below.items()}
    must_be_small({name: getattr(scenario, name) for name in _SIZED} | parts, limits)
    return within.changed(scenario, {(name,): part for name, part in parts.items()})


def _context(limits: Limits) -> Context:
    return Context(base=limits.folders[0].absolute() if limits.folders else Path(), readers=READERS)


def _must_be_inside(spot: Spot, context: Context, limits: Limits) -> None:
    wrong = [*_outside(spot, context, limits)]
    if wrong:
        raise InvalidFile(*in_order(wrong))


def _outside(spot: Spot, context: Context, limits: Limits) -> Iterator[Mistake]:
    """Mistakes of the files that settings name, and those that files among them name."""
    for steps, path in within.files_in(spot, context):
        named = spot
        for step in steps:
            named = named.step(step) or named
        text = str(named.node.content)
        if "://" in text or _leads_out(Path(path), limits.folders):
            folders = ", ".join(folder.name for folder in limits.folders) or "none was given"
            yield named.place.mistake(
                named.setting,
                got=shown(text),
                need=f"a file in the folders of the studio: {folders}",
                fix="Start the studio with the folder that holds it.",
            )
        elif Radar in named.slot.choices or named.slot.field == "settings_path":
            beside = replace(context, base=Path(path).parent)
            try:
                tree = read_tree(text_in(Path(path)), path)
            except InvalidFile:
                continue  # not YAML: a vendor's, which names no file outside its folder
            yield from _outside(Spot("", tree, Slot(Radar)), beside, limits)


def _leads_out(path: Path, folders: Iterable[Path]) -> bool:
    """Whether it may not be opened; what is not there is told by who would read it."""
    is_there = True
    with suppress(OSError):  # a name longer than any
        is_there = path.exists()
    return not is_inside(path, folders) or (is_there and not is_plain(path, folders))


def _without_place(mistake: Mistake) -> Mistake:
    """Leave out where in a text it is that nobody has seen."""
    if mistake.file in (_FILE, "--set"):
        return replace(mistake, file=None, line=None, column=None)
    return mistake
