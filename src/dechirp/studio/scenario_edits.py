"""Edits of the scenario by texts of the page, within the limits of a page.

Texts follow the grammar of settings files. A page may only name files inside the folders of the
studio, with links resolved. Files and sizes are checked before a file is opened and before anything
is computed.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from dechirp.config import setting_paths
from dechirp.config.dumping import dump_yaml
from dechirp.config.error_messages import SettingNode, locate_mistakes_in_file
from dechirp.config.fields import ValueType
from dechirp.config.loading import (
    read_settings_text,
    sort_and_deduplicate_mistakes,
    validate_and_build_value,
)
from dechirp.config.overrides import apply_override, parse_override
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.errors import (
    DechirpError,
    InvalidFile,
    InvalidSetting,
    Mistake,
    quote_for_message,
)
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.scenario import (
    READERS,
    Scenario,
    check_single_radar,
    keep_given_chain_settings,
)
from dechirp.experiments.study.variants import check_settings_do_not_overlap
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.scene.bodies.mesh import Mesh
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.base import Impairment
from dechirp.studio.folders import is_tree_inside, resolves_inside

_FILE = "settings"
"""Name of the text of the page in messages."""
_SIZE_SETTINGS = ("n_frames", "radar", "scene", "impairments", "chain")
"""Settings of a scenario that determine the amount of work."""


@frozen_dataclass
class PageLimits:
    """Limits of one page on computation and files."""

    folders: tuple[Path, ...] = ()
    """Folders whose files may be named in settings and opened as recordings."""
    max_text_length: int = 2**16
    """Characters of a settings text."""
    max_samples: int = 2**22
    """Samples of a frame; also cells of a map."""
    max_targets: int = 100
    max_scatterers: int = 20_000
    max_rays: int = 20_000_000
    """Rays onto all meshes for one frame; takes about 25 s."""
    max_frames: int = 2000
    min_frame_interval_s: float = 1 / 30
    """Shortest time between frames."""


def parse_scenario(text: str, limits: PageLimits) -> Scenario:
    """Parse the text of a scenario file; relative paths start at the first folder.

    Raises
    ------
    DechirpError
        With every mistake and its line and column, with forbidden files, or with exceeded limits,
        before anything is computed.
    """
    _check_text_length("the settings", text, limits)
    return _parse_with_overrides(text, (), limits)


def apply_overrides(scenario: Scenario, overrides: Iterable[str], limits: PageLimits) -> Scenario:
    """Return the scenario with several settings changed, each as PATH=VALUE.

    Raises
    ------
    DechirpError
        As `parse_scenario`, with paths of settings only.
    """
    overrides = tuple(overrides)
    for option in overrides:
        _check_text_length(quote_for_message(option.partition("=")[0]), option, limits)
    try:
        changed = _apply_overrides_without_reparsing(scenario, overrides, limits)
        return keep_given_chain_settings(changed, overrides)
    except DechirpError:
        pass  # parse as text for a complete error message: 50 ms instead of 1 ms
    try:
        return _parse_with_overrides(dump_yaml(scenario), overrides, limits)
    except InvalidFile as error:
        raise InvalidFile(*map(_without_generated_location, error.mistakes)) from None


def check_scenario_within_limits(scenario: Scenario, limits: PageLimits) -> Scenario:
    """Return the scenario, or raise `InvalidSetting` for several radars or exceeded limits."""
    check_single_radar(scenario)
    check_settings_within_limits({name: getattr(scenario, name) for name in _SIZE_SETTINGS}, limits)
    return scenario


def check_settings_within_limits(settings_by_name: Mapping[str, Any], limits: PageLimits) -> None:
    """Raise `InvalidSetting` if parts of a scenario, by name, exceed the limits."""
    radar: Radar | None = settings_by_name.get("radar")
    scene: Scene | None = settings_by_name.get("scene")
    chain: Chain = settings_by_name.get("chain") or Chain()
    impairments: tuple[Impairment, ...] = settings_by_name.get("impairments") or ()
    sizes = [("n_frames", settings_by_name.get("n_frames") or 1, limits.max_frames, "frames")]
    n_range, n_velocity = chain.n_range_bins or 1, chain.n_velocity_bins or 1
    if radar is not None:
        chirp, frame = radar.frame.chirp, radar.frame
        n_samples = chirp.n_samples * frame.n_chirps_total * radar.array.n_rx
        sizes += [("radar.frame", n_samples, limits.max_samples, "samples")]
        n_range = chain.n_range_bins or chirp.n_samples
        n_velocity = chain.n_velocity_bins or frame.n_chirps
    sizes += [("chain", n_range * n_velocity, limits.max_samples, "cells of the map")]
    if scene is not None:
        bodies = [target.body for target in scene.targets]
        n_scatterers = sum(1 if body is None else body.n_scatterers() for body in bodies)
        sizes += [
            ("scene.targets", len(bodies), limits.max_targets, "targets"),
            ("scene.targets", n_scatterers, limits.max_scatterers, "scatterers"),
        ]
        if radar is not None:
            meshes = [body for body in bodies if isinstance(body, Mesh)]
            n_rays = sum(
                mesh.max_rays_per_direction(radar.frame.chirp.wavelength_m) for mesh in meshes
            )
            sizes += [("scene.targets", n_rays, limits.max_rays, "rays onto meshes")]
    n_added_scatterers = sum(
        getattr(impairment, field.name)
        for impairment in impairments
        for field in fields(impairment)  # type: ignore[arg-type]  # members are values
        if field.name == "n_scatterers"
    )
    sizes += [("impairments", n_added_scatterers, limits.max_scatterers, "scatterers")]
    for setting, n, limit, noun in sizes:
        if n > limit:
            raise InvalidSetting(
                setting,
                value=f"{n:,} {noun}",
                expected=f"at most {limit:,} on this page",
                fix="use fewer, or save the settings and run them on the command line",
            )


def _check_text_length(setting: str, text: str, limits: PageLimits) -> None:
    if len(text) > limits.max_text_length:
        raise InvalidSetting(
            setting,
            value=f"text of {len(text):,} characters",
            expected=f"at most {limits.max_text_length:,}",
            fix="run larger settings on the command line",
        )


def _parse_with_overrides(text: str, overrides: Iterable[str], limits: PageLimits) -> Scenario:
    context, overrides = _validation_context(limits), tuple(overrides)
    tree = parse_yaml(text, _FILE)
    node = SettingNode("", tree, ValueType(Scenario))
    _check_no_forbidden_files(node, context, limits)
    for option in overrides:
        node = replace(node, node=apply_override(node, option, context))
        _check_no_forbidden_files(node, context, limits)  # before the next option reads a file
    parts = {}
    for name in _SIZE_SETTINGS:
        part = node.child(name)
        with suppress(DechirpError):  # reported below with all others
            parts[name] = validate_and_build_value(part, context) if part else None
    try:
        check_settings_within_limits(parts, limits)
    except InvalidSetting as error:
        raise InvalidFile(*locate_mistakes_in_file(error, node)) from None
    scenario: Scenario = validate_and_build_value(node, context)
    return keep_given_chain_settings(scenario, overrides, tree)


def _apply_overrides_without_reparsing(
    scenario: Scenario, overrides: Iterable[str], limits: PageLimits
) -> Scenario:
    context = _validation_context(limits)
    changes = [
        (setting_paths.find_setting(scenario, path), node)
        for path, node in map(parse_override, overrides)
    ]
    check_settings_do_not_overlap(path for path, _ in changes)
    changes_by_part: dict[str, dict[setting_paths.Steps, Any]] = {}
    for path, node in changes:
        _check_no_forbidden_files(
            SettingNode(path.path, node, path.leaf_value_type), context, limits
        )
        first, *rest = path.steps
        steps, new_value = (
            tuple(rest),
            setting_paths.build_value_with_replaced_setting(scenario, path, node, context),
        )
        if steps in changes_by_part.setdefault(str(first), {}):
            raise InvalidFile  # two settings of a missing value: parse as text
        changes_by_part[str(first)][steps] = new_value
    parts = {
        name: setting_paths.replace_settings(getattr(scenario, name), part_changes)
        for name, part_changes in changes_by_part.items()
    }
    check_settings_within_limits(
        {name: getattr(scenario, name) for name in _SIZE_SETTINGS} | parts, limits
    )
    return setting_paths.replace_settings(scenario, {(name,): part for name, part in parts.items()})


def _validation_context(limits: PageLimits) -> ValidationContext:
    return ValidationContext(
        folder=limits.folders[0].absolute() if limits.folders else Path(), readers=READERS
    )


def _check_no_forbidden_files(
    node: SettingNode, context: ValidationContext, limits: PageLimits
) -> None:
    mistakes = [*_iter_forbidden_file_mistakes(node, context, limits)]
    if mistakes:
        raise InvalidFile(*sort_and_deduplicate_mistakes(mistakes))


def _iter_forbidden_file_mistakes(
    node: SettingNode, context: ValidationContext, limits: PageLimits
) -> Iterator[Mistake]:
    """Yield mistakes for forbidden files named in settings, and in settings files they name."""
    for steps, path in setting_paths.iter_referenced_files(node, context):
        file_node = node
        for step in steps:
            file_node = file_node.child(step) or file_node
        text = str(file_node.node.content)
        if "://" in text or _is_forbidden_path(Path(path), limits.folders):
            folders = ", ".join(folder.name for folder in limits.folders) or "none was given"
            yield file_node.location.create_mistake(
                file_node.name_in_messages,
                value=quote_for_message(text),
                expected=f"a file in the folders of the studio: {folders}",
                fix="start the studio with the folder that contains it",
            )
        elif (
            Radar in file_node.value_type.types_without_none
            or file_node.value_type.field == "settings_path"
        ):
            file_context = replace(context, folder=Path(path).parent)
            try:
                tree = parse_yaml(read_settings_text(Path(path)), path)
            except InvalidFile:
                continue  # a vendor's file, which names no file outside its folder
            yield from _iter_forbidden_file_mistakes(
                SettingNode("", tree, ValueType(Radar)), file_context, limits
            )


def _is_forbidden_path(path: Path, folders: Iterable[Path]) -> bool:
    """Return True if a path must not be opened; missing files are reported by their reader."""
    exists = True
    with suppress(OSError):  # name too long
        exists = path.exists()
    return not resolves_inside(path, folders) or (exists and not is_tree_inside(path, folders))


def _without_generated_location(mistake: Mistake) -> Mistake:
    """Remove the location of a mistake in generated text."""
    if mistake.file in (_FILE, "--set"):
        return replace(mistake, file=None, line=None, column=None)
    return mistake
