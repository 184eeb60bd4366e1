"""A scenario: everything that makes one experiment, as a settings file holds it."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np

from dechirp.config import files
from dechirp.config.models import Readers
from dechirp.core.checks import count, instances
from dechirp.core.errors import InvalidFile, InvalidSetting, Mistake
from dechirp.core.findings import PhysicsWarning
from dechirp.core.values import value
from dechirp.echoes.engine import Engine
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.stages import by_stage
from dechirp.formats.settings.calibration import read_calibration
from dechirp.formats.settings.read import holds_settings, read_radar
from dechirp.process.angle.fft import Fft
from dechirp.process.chain import Chain, searched_rows
from dechirp.process.sources import aperture_of
from dechirp.radar.calibration import Calibration
from dechirp.radar.radar import Radar
from dechirp.scene.possible import must_be_possible
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.tracking.ego import EgoMotion
from dechirp.tracking.tracker import Tracker

READERS: Readers = {Radar: read_radar, Calibration: read_calibration}
"""How to read what a scenario may name the file of, instead of holding it."""


@value
class Source:
    """A recording, and what its file does not say about itself."""

    path: str
    device: str | None = None
    """Chip or board of the radar, such as xwr1843: where its antennas are."""
    format: str | None = None
    """Its kind in the family of formats; none: recognised by its content."""
    axes: tuple[str, ...] | None = None
    """Names of its axes in order: frame, chirp, tx, rx, element, sample, iq."""
    encoding: str | None = None
    """How its numbers are meant, such as uint16-wrapped."""
    iq: Literal["iq", "qi"] | None = None
    """Whether the in-phase part comes first."""
    settings_path: str | None = None
    """File that says what the radar sent and how samples lie: YAML, or the vendor's own; none:
    the recording itself, or a file beside it. With a radar in the scenario, the latter alone."""
    calibration: Calibration | None = None
    """Of its array, in place of the radar's; in files also the name of one that `dechirp
    calibrate` wrote."""
    frames: tuple[int, int] | None = None
    """First frame, and the one after the last; none: all."""

    def __post_init__(self) -> None:
        if self.frames is not None and not 0 <= self.frames[0] < self.frames[1]:
            raise InvalidSetting(
                "Source.frames",
                got=f"{self.frames[0]} to {self.frames[1]}",
                need="the first frame, counted from 0, and a later one to stop before",
                fix="Give 0 and 10 for the first ten frames.",
            )


@value
class Scenario:
    """One experiment on a simulated scene, or on a recording."""

    name: str = "scenario"
    seed: int = 0
    n_frames: int = 1
    """Frames to simulate."""
    radar: Radar | None = None
    """In files also the name of a settings file. May be left out where the recording, or a
    file beside it, has it."""
    scene: Scene | None = None
    recording: Source | None = None
    """Instead of a scene."""
    engine: Engine = Engine()
    """How the echoes of a scene are summed."""
    impairments: tuple[Impairment, ...] = (ThermalNoise(),)
    """What hardware does to simulated echoes, in this order."""
    chain: Chain = Chain()
    ego_motion: EgoMotion | None = None
    """How the radar's own motion is found from its detections, and with it what stands still,
    which is not tracked; none: it is not."""
    tracker: Tracker | None = None
    """How detections, or clusters where there are any, become tracks; none: they do not."""

    def __post_init__(self) -> None:
        fix = "Write [ThermalNoise()], with both brackets, even for one alone."
        impairments = instances("Scenario.impairments", self.impairments, Impairment, fix=fix)
        object.__setattr__(self, "impairments", impairments)
        count(self, "seed", at_least=0, at_most=2**63 - 1)
        count(self, "n_frames", at_most=1_000_000)
        if (self.scene is None) == (self.recording is None):
            raise InvalidSetting(
                "Scenario.scene",
                got="absent, and no recording either"
                if self.scene is None
                else "beside a recording",
                need="a scene to simulate, or a recording: one of the two",
                fix="Take one out, or give one.",
            )
        if self.scene is not None and self.radar is None:
            raise InvalidSetting(
                "Scenario.radar",
                got="absent",
                need="given, to simulate a scene",
                fix="Describe it, or name a file that does.",
            )
        if self.scene is not None and self.radar is not None:
            self._check_scene(self.scene, self.radar)
        for name, kind in (("ego_motion", EgoMotion), ("tracker", Tracker)):
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Scenario.{name}",
                    got=getattr(self, name),
                    need=f"settings of the kind {kind.__name__}, or none",
                    fix=f"Give {kind.__name__}(), or leave it out.",
                )
        if self.radar is not None:
            check_chain(self.chain, self.radar)
            check_following(self, self.radar, None if self.scene is None else self.n_frames)

    def _check_scene(self, scene: Scene, radar: Radar) -> None:
        with called("radar.hardware", instead_of="Radar.hardware"):
            radar.known_hardware()
        must_be_possible(scene, radar, n_frames=self.n_frames)
        truth(scene, radar)  # refuses a body whose origin is the radar
        kinds = [impairment.kind() for impairment in self.impairments]
        for index, impairment in enumerate(self.impairments):
            label = kinds[index] if kinds.count(kinds[index]) == 1 else str(index)
            with called(f"impairments.{label}."), warnings.catch_warnings():
                warnings.simplefilter("ignore", PhysicsWarning)  # findings of the run
                for one in by_stage([impairment], radar).all:
                    one.check(scene, radar)


def check_chain(chain: Chain, radar: Radar) -> None:
    """Raise `InvalidSetting`, with the path of the setting, unless the maps of a radar can be made.

    There must be a bin for each sample and chirp, room for training cells that were set, and
    directions to tell if an estimator was, by elements that will do for it.
    """
    for method in chain.mitigation:
        path = f"chain.mitigation.{method.kind()}"
        with (
            called("radar.frame", instead_of="Frame"),
            called(path, instead_of=type(method).__name__),
        ):
            method.must_fit(radar.frame)
    with called("chain.n_range_bins", instead_of="Transform.n_bins"):
        over_range = chain.over_range(radar.frame.chirp)
    with called("chain.n_velocity_bins", instead_of="Transform.n_bins"):
        over_velocity = chain.over_velocity(radar.frame)
    n_rows = searched_rows(radar.frame.chirp, over_range)
    with called("chain.cfar", instead_of="Cfar"):
        chain.cfar.fitted(over_velocity.n_bins, n_rows).ring.fits(over_velocity.n_bins, n_rows)
    angle = chain.fitted(radar).angle
    if angle is not None:
        seen = aperture_of(radar, chain.field_of_view)
        if angle != Fft():  # which takes any array; another is asked about a snapshot of zeros
            heard = np.zeros((1, 1, seen.n_elements), complex)
            with (
                called("chain", instead_of="Chain"),
                called("chain.angle", instead_of=type(angle).__name__),
            ):
                angle.directions(heard, seen, np.zeros(1))


def check_following(scenario: Scenario, radar: Radar, n_frames: int | None) -> None:
    """Raise `InvalidSetting` where tracks or own motion are asked for and can never be told.

    Of detections without azimuth, or in too few frames to confirm a track; `n_frames` is None
    where that is not known yet.
    """
    if scenario.tracker is not None and n_frames is not None:
        with called("tracker", instead_of="Tracker"):
            scenario.tracker.must_confirm_within(n_frames)
    if scenario.chain.fitted(radar).angle is not None:
        return
    for name in ("ego_motion", "tracker"):
        if getattr(scenario, name) is not None:
            raise InvalidSetting(
                name,
                got="asked for, of detections without directions",
                need="an array that tells azimuth, and a direction estimator",
                fix=f"Set chain.angle and give the radar more elements, or set {name} to null.",
            )


@contextmanager
def called(path: str, *, instead_of: str = "") -> Iterator[None]:
    """Call a setting, or what lies in it, as this scenario does: by its path."""
    try:
        yield
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if not mistake.setting.startswith(instead_of):
            raise
        path += mistake.setting.removeprefix(instead_of)
        raise InvalidSetting(path, got=mistake.got, need=mistake.need, fix=mistake.fix) from None


def load(path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Scenario from a YAML file, with settings replaced by `PATH=VALUE` texts.

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
                got="settings of a radar, as its vendor writes them",
                need="a scenario: YAML",
                fix="Open a recording with it: dechirp.open(RECORDING, radar=FILE); or write a"
                " scenario with radar: FILE.",
                file=str(path),
            )
        )
    return files.read(path, Scenario, overrides=overrides, readers=READERS)


def reference(overrides: Sequence[str] = ()) -> Scenario:
    """The reference scenario: a car at 50 m, receding at 10 m/s, in front of 77 GHz."""
    with resources.as_file(resources.files("dechirp.experiment") / "reference.yaml") as path:
        return load(path, overrides)
