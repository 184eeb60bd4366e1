"""The scene: targets seen from the radar, and the truth about them."""

from collections.abc import Iterable, Iterator

import numpy as np
import xarray as xr

from dechirp.core.checks import Vector, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.radar.budget import noise_power_w as thermal_noise_w
from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies, seen
from dechirp.scene.target import Target, slow_vector


@value
class Ego:
    """The radar's own motion."""

    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        slow_vector(self, "velocity_m_per_s")


@value
class Scene:
    """Point targets in the coordinates of the radar at time zero."""

    targets: tuple[Target, ...] = ()
    ego: Ego = Ego()

    def __post_init__(self) -> None:
        targets = tuple(self.targets) if isinstance(self.targets, Iterable) else (None,)
        if not all(isinstance(target, Target) for target in targets):
            raise InvalidSetting(
                "Scene.targets",
                got=self.targets,
                need="a list of targets",
                fix="Write targets=[Target(...)], also for one alone.",
            )
        object.__setattr__(self, "targets", targets)
        names = self.names
        for name in names:
            if names.count(name) > 1:
                raise InvalidSetting(
                    "Scene.targets",
                    got=f"{names.count(name)} targets named {name}",
                    need="a name for each target alone",
                    fix="Rename one of them.",
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each target, given or from its place: target-1, target-2 ..."""
        return tuple(
            target.name or f"target-{number}" for number, target in enumerate(self.targets, 1)
        )

    def target(self, name: str | None) -> Target:
        """The target of that name; without a name, the only one there is."""
        if name is None and len(self.targets) == 1:
            return self.targets[0]
        if name not in self.names:
            raise InvalidSetting(
                "target",
                got=name or "not given",
                need=f"one of {', '.join(self.names) or 'no targets: the scene is empty'}",
                fix="Name the target that is meant.",
            )
        return self.targets[self.names.index(name)]

    def positions_m(self, time_s: float) -> np.ndarray:
        """Positions of the targets relative to the radar at a time, (n_targets, 3)."""
        ego_m = time_s * np.asarray(self.ego.velocity_m_per_s)
        positions = [target.position_at_m(time_s) - ego_m for target in self.targets]
        for name, position_m in zip(self.names, positions, strict=True):
            if np.linalg.norm(position_m) < 1e-6:  # nearer, its power overflows
                raise InvalidSetting(
                    f"scene.targets.{name}.position",
                    got=f"on the radar after {time_s:.4g} s",
                    need="away from it: the echo would be infinite",
                    fix="Move the target.",
                )
        return np.array(positions).reshape(-1, 3)

    def velocities_m_per_s(self) -> np.ndarray:
        """Velocities of the targets relative to the radar, (n_targets, 3)."""
        velocities = np.array([target.velocity_m_per_s for target in self.targets]).reshape(-1, 3)
        return velocities - np.asarray(self.ego.velocity_m_per_s)


def truth(
    scene: Scene, radar: Radar, *, n_frames: int = 1, noise_power_w: float | None = None
) -> xr.Dataset:
    """What a perfect radar would report, in the words of detections.

    `noise_power_w` is the noise in one sample; thermal noise of the hardware without it.

    Returns
    -------
    Dataset over (target, frame)
        `time` (s) of mid-frame, mid-window; `range` (m), `velocity` (m/s), `azimuth`,
        `elevation` (rad) at that instant, seen from the origin of the array; `snr` after
        integration over samples, chirps and channels, where the hardware is known.

    Raises
    ------
    InvalidSetting
        If a target sits on the radar, or `n_frames` is no count of frames.
    """
    whole("n_frames", n_frames, at_least=1, at_most=1_000_000)
    known = _places(scene, radar, np.arange(n_frames))
    if radar.hardware is None:
        return known
    rcs_m2 = np.array([[target.rcs_m2] for target in scene.targets]).reshape(-1, 1)
    noise_w = thermal_noise_w(radar) if noise_power_w is None else noise_power_w
    echo_w = received_power_w(radar, range_m=known.range.values, rcs_m2=rcs_m2)
    with np.errstate(divide="ignore"):  # without noise it is infinite
        snr = echo_w / noise_w * radar.integration_gain
    return known.assign(snr=(("target", "frame"), snr, {"units": "1"}))


def surprises(scene: Scene, radar: Radar, *, n_frames: int = 1) -> list[Finding]:
    """Targets that fold in range or velocity, or whose echo comes after the first sample.

    Told once, of the first frame or else of the last: on a straight line, range and speed
    along the line of sight are largest at the ends.
    """
    known = _places(scene, radar, np.unique([0, n_frames - 1]))
    found: list[Finding] = []
    for name in scene.names:
        told: dict[tuple[str, str], Finding] = {}
        for frame in known.frame.values:
            here = known.sel(target=[name], frame=[frame])
            when = "" if n_frames == 1 else f" in frame {frame}"
            for finding in (*_folds(here, radar, when), *_late(here, radar, when)):
                told.setdefault((finding.setting, finding.need), finding)
        found += told.values()
    return found


def _places(scene: Scene, radar: Radar, frames: np.ndarray) -> xr.Dataset:
    """Where the targets are in the middle of some frames, over (target, frame)."""
    times_s = np.array([radar.frame.start_s(i) + radar.frame.mid_frame_s for i in frames])
    positions_m = np.stack([scene.positions_m(time) for time in times_s], axis=1)
    x, y, z = np.moveaxis(positions_m, -1, 0)
    range_m = np.sqrt(x**2 + y**2 + z**2)
    along = np.einsum("tfi,ti->tf", positions_m, scene.velocities_m_per_s())
    over = ("target", "frame")
    return xr.Dataset(
        {
            "range": (over, range_m, {"units": "m"}),
            "velocity": (over, along / range_m, {"units": "m/s"}),
            "azimuth": (over, np.arctan2(y, x), {"units": "rad"}),
            "elevation": (over, np.arctan2(z, np.hypot(x, y)), {"units": "rad"}),
        },
        coords={
            "target": ("target", list(scene.names)),
            "frame": ("frame", frames),
            "time": ("frame", times_s, {"units": "s"}),
        },
    )


def _folds(here: xr.Dataset, radar: Radar, when: str) -> Iterator[Finding]:
    """What folds of one target in one frame."""
    frame, chirp = radar.frame, radar.frame.chirp
    setting = f"scene.targets.{here.target.item()}"
    there, found = Place(here.range.values, here.velocity.values), seen(here, radar)
    got = f"{_said(there)}{when} folds to {_said(found)}"
    echo = frequencies(there, radar)
    if frame.n_chirps > 1 and not -0.5 <= echo.doppler_hz.item() * frame.repetition_s < 0.5:
        max_velocity = frame.max_velocity_m_per_s
        yield Finding(
            level="warning",
            setting=f"{setting}.velocity",
            got=got,
            need=f"between -{max_velocity:.4g} and {max_velocity:.4g} m/s to be unambiguous",
            fix="Shorten the interval between chirps, or read the folded velocity.",
        )
    if not 0 <= echo.beat_hz.item() < chirp.max_beat_frequency_hz:
        yield Finding(
            level="warning",
            setting=f"{setting}.position",
            got=got,
            need=f"between 0 and {chirp.max_range_m:.4g} m, range-Doppler coupling included, to"
            " be unambiguous",
            fix="Sample faster or lower the slope, or read the folded range.",
        )


def _said(place: Place) -> str:
    range_m, velocity = place.range_m.item(), place.velocity_m_per_s.item()
    return f"{range_m:.4g} m" + ("" if np.isnan(velocity) else f" at {velocity:.4g} m/s")


def _late(here: xr.Dataset, radar: Radar, when: str) -> Iterator[Finding]:
    """Whether the echo of one target in one frame comes after the first sample."""
    chirp = radar.frame.chirp
    delay_s = 2 * here.range.item() / SPEED_OF_LIGHT
    if delay_s <= chirp.adc_start_s:
        return
    late = int(np.ceil((delay_s - chirp.adc_start_s) * chirp.sample_rate_hz))
    missed = f"the first {late} samples" if late < chirp.n_samples else "all of it"
    yield Finding(
        level="warning",
        setting=f"scene.targets.{here.target.item()}.position",
        got=f"echo arrives {delay_s * 1e6:.4g} us after ramp start{when}, sampling begins at"
        f" {chirp.adc_start_s * 1e6:.4g} us",
        need="a delay of at most adc_start for every sample to hold the echo",
        fix=f"Start sampling later. A real radar would miss {missed}, the simulation does not.",
    )
