"""Scenario: all settings of one experiment, as its settings file contains them."""

import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from importlib import resources
from itertools import combinations
from pathlib import Path
from typing import ClassVar, Literal, get_args

import numpy as np

from dechirp.config import loading
from dechirp.config.overrides import parse_override
from dechirp.config.validation import Readers
from dechirp.config.yaml_tree import YamlNode, parse_yaml
from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_instances, check_integer_fields
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake
from dechirp.core.findings import PhysicsWarning
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.mounted_radar import MountedRadar
from dechirp.processing.angle.fft import Fft
from dechirp.processing.chain import Chain, n_searched_range_rows
from dechirp.processing.chain_fitting import ChosenSettingName
from dechirp.processing.direction_finding import checked_direction_aperture
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.recordings.settings.read import holds_settings, read_radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.scene.validity import check_scene_echoes_finite
from dechirp.simulation.engine import Engine
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.stages import sort_into_stages
from dechirp.tracking.ego import EgoMotion
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.tracker import Tracker
from dechirp.traffic.source import TrafficSource

READERS: Readers = {Radar: read_radar, Calibration: read_calibration}
"""Readers of values that a scenario may give as the name of a file."""

_MIN_RADAR_DISTANCE_M = 0.02  # housings are larger

_WITH_ARTICLES = {"recording": "a recording", "traffic": "traffic"}
_OBJECT_STAGES = {"ego_motion": EgoMotion, "tracker": Tracker, "group_tracker": GroupTracker}

_PATHS_OF_CHOSEN_SETTINGS: dict[ChosenSettingName, tuple[str, ...]] = {
    "mitigation": ("chain.mitigation",),
    "cfar": ("chain.cfar.n_training", "chain.cfar.n_guard"),
    "moving_targets": ("chain.moving_targets",),
    "max_range": ("chain.max_range",),
    "image_rejection": ("chain.image_rejection",),
    "angle": ("chain.angle",),
}


@frozen_dataclass
class RecordingSource:
    """Recording of a scenario, and metadata missing in its file."""

    path: str
    device: str | None = None
    """Chip or board of the radar, such as xwr1843; it determines the antenna positions."""
    format: str | None = None
    """Name of its format; None: recognised by its content."""
    axes: tuple[str, ...] | None = None
    """Names of its axes in order: frame, chirp, tx, rx, element, sample, iq."""
    encoding: str | None = None
    """Encoding of its numbers, such as uint16-wrapped."""
    iq: Literal["iq", "qi"] | None = None
    """Whether the in-phase part comes first."""
    settings_path: str | None = None
    """File with the radar settings and the sample layout: YAML, or the vendor's own; None: the
    recording itself, or its sidecar. With a radar in the scenario, the layout alone."""
    calibration: Calibration | None = None
    """Replaces the calibration of the radar's array; in files also the name of its file."""
    frames: tuple[int, int] | None = None
    """First frame, and the one after the last; None: all."""
    fit_chain: bool = True
    """Whether settings of the chain are chosen to fit the samples."""
    kept_settings: tuple[ChosenSettingName, ...] = ()
    """Settings of the chain that stay as they are, with their defaults too: those of settings files
    and `--set`, and after a run all."""
    repair_faults: bool = True
    """Whether receivers without a signal of their own are left out, lost and outlier chirps are
    interpolated, and a repair of bursts may be chosen; otherwise samples stay as recorded."""

    def __post_init__(self) -> None:
        if self.frames is not None and not 0 <= self.frames[0] < self.frames[1]:
            raise InvalidSetting(
                "RecordingSource.frames",
                value=f"{self.frames[0]} to {self.frames[1]}",
                expected="the first frame, counted from 0, and a later one to stop before",
                fix="give 0 and 10 for the first ten frames",
            )

    @property
    def may_choose_mitigation(self) -> bool:
        """True if a mitigation of interference bursts may be added to the chain."""
        return self.fit_chain and "mitigation" not in self.kept_settings


@frozen_dataclass
class Scenario:
    """One experiment on a simulated scene, in traffic, or on a recording."""

    _file_reader: ClassVar[str] = "dechirp.load"

    name: str = "scenario"
    seed: int = 0
    n_frames: int = 1
    """Frames to simulate."""
    radar: Radar | None = None
    """In files also the name of a settings file. Optional if the recording, or a
    file beside it, contains it."""
    radars: tuple[MountedRadar, ...] = ()
    """Several radars on one vehicle, each with its mounting; none: `radar` alone. In a scene its
    `ego` is then the centre of the vehicle, on the ground."""
    scene: Scene | None = None
    recording: RecordingSource | None = None
    """Replaces a scene."""
    traffic: TrafficSource | None = None
    """Traffic file, in place of a scene: each frame has a scene of its own."""
    engine: Engine = Engine()
    """Method that sums the echoes of a scene."""
    impairments: tuple[Impairment, ...] = (ThermalNoise(),)
    """Hardware and propagation effects on simulated echoes, in this order."""
    chain: Chain = Chain()
    ego_motion: EgoMotion | None = None
    """Estimates the ego motion and excludes static detections from tracking; None: off."""
    tracker: Tracker | None = None
    """Tracks detections, or clusters if there are any; None: off."""
    group_tracker: GroupTracker | None = None
    """Tracks people and cars as groups of detections, in place of `tracker`; None: off."""

    def __post_init__(self) -> None:
        fix = "Write [ThermalNoise()], with both brackets, even for one alone."
        impairments = check_instances("Scenario.impairments", self.impairments, Impairment, fix=fix)
        object.__setattr__(self, "impairments", impairments)
        check_integer_fields(self, "seed", at_least=0, at_most=2**63 - 1)
        check_integer_fields(self, "n_frames", at_most=1_000_000)
        self._check_single_source()
        for name, kind in _OBJECT_STAGES.items():
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Scenario.{name}",
                    value=getattr(self, name),
                    expected=f"settings of the kind {kind.__name__}, or none",
                    fix=f"give {kind.__name__}(), or leave it out",
                )
        if self.tracker is not None and self.group_tracker is not None:
            raise InvalidSetting(
                "Scenario.group_tracker",
                value="given beside tracker",
                expected="one of them: groups of detections, or single detections and clusters",
                fix="set tracker to null to follow groups, or group_tracker to null",
            )
        if self.radars:
            self._check_radars()
            return
        if self.recording is None and self.radar is None:
            raise InvalidSetting(
                "Scenario.radar",
                value="missing",
                expected="the radar that observes the scene",
                fix="add radar: its settings, or the name of their file",
            )
        if self.scene is not None and self.radar is not None:
            self._check_scene_and_impairments(self.scene, self.radar)
        if self.traffic is not None and self.radar is not None:
            with prefix_setting_of_errors("radar.hardware", instead_of="Radar.hardware"):
                self.radar.require_hardware()
        if self.radar is not None:
            # Readers join single chirps to frames, which are checked when the recording is opened.
            if self.recording is None or self.radar.frame.n_chirps_total > 1:
                check_chain_fits_radar(self.chain, self.radar)
            check_tracks_and_ego_motion_possible(self, self.radar)

    def _check_radars(self) -> None:
        """Check names and places of several radars, and the scenario of each."""
        fix = "give a list of radars, each with its mount"
        radars = check_instances("Scenario.radars", self.radars, MountedRadar, fix=fix)
        object.__setattr__(self, "radars", radars)
        if self.recording is not None:
            raise InvalidSetting(
                "Scenario.radars",
                value="given for a recording",
                expected="a scene or traffic, whose radars are simulated",
                fix="process the recording of each radar, then fuse their detections with"
                " dechirp.fusion.fuse_detections",
            )
        for (first, one), (second, other) in combinations(enumerate(radars), 2):
            if one.label == other.label:
                raise InvalidSetting(
                    f"Scenario.radars.{second}.name",
                    value=f"{other.label}, also that of radar {first}",
                    expected="a name of its own for each radar",
                    fix="give one of them a name",
                )
            places_m = [radar.mounting_on(4.0, 2.0).position_m for radar in (one, other)]
            if math.dist(*places_m) < _MIN_RADAR_DISTANCE_M:
                raise InvalidSetting(
                    f"Scenario.radars.{second}.{'mount' if other.pose is None else 'pose'}",
                    value=f"within {100 * _MIN_RADAR_DISTANCE_M:g} cm of radar {one.label}",
                    expected="a place of its own for each radar",
                    fix="move one of them",
                )
        for number, mounted in enumerate(radars):
            if mounted.radar is None and self.radar is None:
                raise InvalidSetting(
                    f"Scenario.radars.{number}.radar",
                    value="missing, and the radar of the scenario as well",
                    expected="a radar for each mounting",
                    fix="add radar: its settings, or the name of their file",
                )
            # Raises if it is invalid. Tracks are those of all radars, in the frames of all.
            single = replace(
                self,
                radars=(),
                radar=mounted.radar or self.radar,
                tracker=None,
                group_tracker=None,
            )
            assert single.radar is not None
            check_tracks_and_ego_motion_possible(self, single.radar)

    @property
    def has_tracker(self) -> bool:
        """True if targets, or groups of detections, are tracked."""
        return self.tracker is not None or self.group_tracker is not None

    @property
    def n_simulated_samples(self) -> float:
        """Number of samples in all frames; infinite for files, which must be opened first."""
        if self.scene is None:
            return math.inf
        if self.radars:
            return sum(
                replace(self, radars=(), radar=mounted.radar or self.radar).n_simulated_samples
                for mounted in self.radars
            )
        if self.radar is None:
            return math.inf
        return self.n_frames * self.radar.n_samples_per_frame

    def _check_single_source(self) -> None:
        """Raise `InvalidSetting` unless there is one of scene, recording and traffic."""
        sources = [
            name for name in ("scene", "recording", "traffic") if getattr(self, name) is not None
        ]
        if len(sources) == 1:
            return
        raise InvalidSetting(
            f"Scenario.{sources[0] if sources else 'scene'}",
            value=f"cannot be combined with {_WITH_ARTICLES[sources[1]]}"
            if sources
            else "missing, and recording as well",
            expected="a scene to simulate, or a recording, or a traffic file",
            fix="remove one of them" if sources else "add a scene, a recording or traffic",
        )

    def _check_scene_and_impairments(self, scene: Scene, radar: Radar) -> None:
        if radar.hardware is None and scene == Scene():
            return  # settings of a radar and its chain alone, as `dechirp generate` writes them
        with prefix_setting_of_errors("radar.hardware", instead_of="Radar.hardware"):
            radar.require_hardware()
        check_scene_echoes_finite(scene, radar, n_frames=self.n_frames)
        truth(scene, radar)  # raises for a body whose origin is the radar
        kinds = [impairment.kind() for impairment in self.impairments]
        for index, impairment in enumerate(self.impairments):
            label = kinds[index] if kinds.count(kinds[index]) == 1 else str(index)
            with prefix_setting_of_errors(f"impairments.{label}."), warnings.catch_warnings():
                warnings.simplefilter("ignore", PhysicsWarning)  # reported by the run
                for stage in sort_into_stages([impairment], radar).impairments:
                    stage.check(scene, radar)


def check_single_radar(scenario: Scenario) -> None:
    """Raise `InvalidSetting` if a scenario has a list of radars."""
    if scenario.radars:
        raise InvalidSetting(
            "scenario.radars",
            value=f"{len(scenario.radars)} radars",
            expected="a single radar: results of several have another form",
            fix="call dechirp.fusion.run_radars or dechirp run, which writes a scenario.yaml for"
            " each radar alone; open one of these in the studio, or pack it as an FMU",
        )


def check_chain_fits_radar(chain: Chain, radar: Radar) -> None:
    """Raise `InvalidSetting`, with the path of the setting, unless the chain fits the radar.

    Transforms need a bin for each sample and chirp, explicit training windows must fit into the
    map, and a direction estimator needs a suitable array.
    """
    for method in chain.mitigation:
        path = f"chain.mitigation.{method.kind()}"
        with (
            prefix_setting_of_errors("radar.frame", instead_of="Frame"),
            prefix_setting_of_errors(path, instead_of=type(method).__name__),
        ):
            method.check_frame_suits_method(radar.frame)
    with prefix_setting_of_errors("chain.n_range_bins", instead_of="Transform.n_bins"):
        over_range = chain.range_transform(radar.frame.chirp)
    with prefix_setting_of_errors("chain.n_velocity_bins", instead_of="Transform.n_bins"):
        over_velocity = chain.doppler_transform(radar.frame)
    n_rows = n_searched_range_rows(radar.frame.chirp, over_range)
    with prefix_setting_of_errors("chain.cfar", instead_of="Cfar"):
        chain.cfar.fit_to_map(over_velocity.n_bins, n_rows).training_window.check_map_size(
            over_velocity.n_bins, n_rows
        )
    angle = chain.fit_to_radar(radar).angle
    if angle is not None:
        aperture = checked_direction_aperture(radar, chain.field_of_view)
        if angle != Fft():  # accepts any array; others are tested with a zero snapshot
            snapshots = np.zeros((1, 1, aperture.n_elements), complex)
            with (
                prefix_setting_of_errors("chain", instead_of="Chain"),
                prefix_setting_of_errors("chain.angle", instead_of=type(angle).__name__),
            ):
                angle.find_directions(snapshots, aperture, np.zeros(1))


def check_tracks_and_ego_motion_possible(scenario: Scenario, radar: Radar) -> None:
    """Raise `InvalidSetting` if tracks or ego motion are requested but impossible.

    They need azimuths, and the vertical velocity elevations.
    """
    if scenario.chain.fit_to_radar(radar).angle is not None:
        _check_vertical_velocity_possible(scenario, radar)
        return
    for name in _OBJECT_STAGES:
        if getattr(scenario, name) is not None:
            raise InvalidSetting(
                name,
                value="enabled for detections without directions",
                expected="an array that resolves azimuth, and a direction estimator",
                fix=f"set chain.angle and give the radar more elements, or set {name} to null",
            )


def _check_vertical_velocity_possible(scenario: Scenario, radar: Radar) -> None:
    """Raise `InvalidSetting` if the vertical velocity needs elevations that are not measured."""
    if scenario.ego_motion is None or not scenario.ego_motion.with_vertical:
        return
    aperture = checked_direction_aperture(radar, scenario.chain.field_of_view)
    if not aperture.resolves_azimuth_and_elevation[1]:
        raise InvalidSetting(
            "ego_motion.with_vertical",
            value="true for an array that measures no elevation",
            expected="true only if the elements of the array have different heights",
            fix="set it to false, or give the radar elements at other heights",
        )


@contextmanager
def prefix_setting_of_errors(path: str, *, instead_of: str = "") -> Iterator[None]:
    """Prefix the settings of errors in the block with their path in the scenario."""
    try:
        yield
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if not mistake.setting.startswith(instead_of):
            raise
        path += mistake.setting.removeprefix(instead_of)
        raise InvalidSetting(
            path, value=mistake.value, expected=mistake.expected, fix=mistake.fix
        ) from None


@check_argument_types
def load(path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Load a scenario from a YAML file.

    Parameters
    ----------
    path : path
        The settings file; paths of other files in it are relative to its folder.
    overrides : sequence of str
        `PATH=VALUE` texts that replace settings, as `radar.frame.n_chirps=64`.

    Raises
    ------
    InvalidFile
        With every mistake of the file at once, each with its line and column.
    """
    path = Path(path)
    vendors = path.suffix.lower() not in (".yaml", ".yml")
    if vendors and (path.suffix.lower() == ".cfg" or holds_settings(path)):
        raise InvalidFile(
            Mistake(
                setting="the file",
                value="settings of a radar, as its vendor writes them",
                expected="a scenario: YAML",
                fix="open a recording with it: dechirp.open(RECORDING, radar=FILE); or write a"
                " scenario with radar: FILE",
                file=str(path),
            )
        )
    try:
        scenario = loading.read_settings(path, Scenario, overrides=overrides, readers=READERS)
    except InvalidFile:
        _check_no_other_kind_of_file(path)
        raise
    if scenario.recording is None:
        return scenario
    tree = parse_yaml(loading.read_settings_text(path), str(path))
    return keep_given_chain_settings(scenario, overrides, tree)


def _check_no_other_kind_of_file(path: Path) -> None:
    """Raise `InvalidFile` for a radar, a study, a search or a tracking trial, not a scenario."""
    content = parse_yaml(loading.read_settings_text(path), str(path)).content
    radar_settings, settings = ({field.name for field in fields(cls)} for cls in (Radar, Scenario))
    if not (isinstance(content, Mapping) and content):
        return
    names = content.keys()
    if names <= radar_settings - settings:
        kind = f"settings of a radar: {', '.join(content)}"
        fix = (
            f"open a recording with it: dechirp.open(RECORDING, radar={str(path)!r});"
            f" or write a scenario with radar: {path.name}"
        )
    elif names >= {"scenario", "vary"}:
        kind, fix = "a study", f"run it: dechirp study {path}"
    elif names >= {"scenarios", "search"}:
        kind, fix = "a search for settings", f"run it: dechirp tune {path}"
    elif names >= {"scene", "false_alarms", "acquired_within"}:
        kind = "a trial of the tracker with random detections, without a radar"
        fix = "run it: python benchmarks/tracks.py, in the source tree of dechirp"
    else:
        return
    raise InvalidFile(
        Mistake(setting="the file", value=kind, expected="a scenario", fix=fix, file=str(path))
    )


def keep_given_chain_settings(
    scenario: Scenario, overrides: Iterable[str], tree: YamlNode | None = None
) -> Scenario:
    """Return the scenario of a recording with the settings of its chain that were given kept.

    Given are those in `overrides`, PATH=VALUE, and in the tree of its file. Files that this package
    wrote contain every setting, and name those to keep.
    """
    source = scenario.recording
    if source is None:
        return scenario
    given = [parse_override(override) for override in overrides]
    if tree is not None and not _contains_setting(tree, "recording.kept_settings"):
        given.append(("", tree))
    kept = {
        name
        for name, paths in _PATHS_OF_CHOSEN_SETTINGS.items()
        for path in paths
        for start, node in given
        if _is_given(path, start, node)
    }
    names = tuple(
        name for name in get_args(ChosenSettingName) if name in kept.union(source.kept_settings)
    )
    return replace(scenario, recording=replace(source, kept_settings=names))


def _is_given(path: str, start: str, node: YamlNode) -> bool:
    """Return whether the node at the path `start` sets a setting, a part of it, or all around."""
    if f"{start}.".startswith(f"{path}."):
        return True
    prefix = f"{start}." if start else ""
    return path.startswith(prefix) and _contains_setting(node, path.removeprefix(prefix))


def _contains_setting(node: YamlNode, path: str) -> bool:
    """Return whether a tree contains a setting."""
    for name in path.split("."):
        if not isinstance(node.content, dict) or name not in node.content:
            return False
        node = node.content[name]
    return True


@check_argument_types
def reference(overrides: Sequence[str] = ()) -> Scenario:
    """Load the reference scenario: a car at 50 m, receding at 10 m/s, in front of 77 GHz."""
    with resources.as_file(resources.files("dechirp.experiments") / "reference.yaml") as path:
        return load(path, overrides)


@check_argument_types
def traffic_scenario(path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario of a front radar in the traffic of a file.

    The radar is that of `traffic.yaml` beside this module: 76.5 GHz, 3 x 4 antennas, 100 m.
    `PATH=VALUE` texts override settings: `traffic.ego=12` names the vehicle with the radar,
    `traffic.mount=rear` the place on it, `radar=FILE` another radar.

    Parameters
    ----------
    path : path
        File with the traffic.
    overrides : sequence of str
        Settings that replace those of the scenario, `PATH=VALUE`.
    """
    traffic = f"traffic={{path: {json.dumps(str(Path(path).absolute()), ensure_ascii=False)}}}"
    with resources.as_file(resources.files("dechirp.experiments") / "traffic.yaml") as settings:
        return load(settings, [traffic, *overrides])
