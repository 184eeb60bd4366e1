"""The scene: targets seen from the radar, and the truth about them."""

import numpy as np
import xarray as xr

from dechirp.core.checks import Vector, vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.radar.budget import noise_power_w as thermal_noise_w
from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.target import Target


@value
class Ego:
    """The radar's own motion."""

    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        vector(self, "velocity_m_per_s")


@value
class Scene:
    """Point targets in the coordinates of the radar at time zero."""

    targets: tuple[Target, ...] = ()
    ego: Ego = Ego()

    def __post_init__(self) -> None:
        object.__setattr__(self, "targets", tuple(self.targets))
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
            if not position_m.any():
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
        integration over samples, chirps and receivers, where the hardware is known.
    """
    frame = radar.frame
    times_s = np.array([frame.start_s(index) + frame.mid_frame_s for index in range(n_frames)])
    positions_m = np.stack([scene.positions_m(time) for time in times_s], axis=1)
    x, y, z = np.moveaxis(positions_m, -1, 0)
    range_m = np.sqrt(x**2 + y**2 + z**2)
    along = np.einsum("tfi,ti->tf", positions_m, scene.velocities_m_per_s())
    over = ("target", "frame")
    known = {
        "range": (over, range_m, {"units": "m"}),
        "velocity": (over, along / range_m, {"units": "m/s"}),
        "azimuth": (over, np.arctan2(y, x), {"units": "rad"}),
        "elevation": (over, np.arctan2(z, np.hypot(x, y)), {"units": "rad"}),
    }
    if radar.hardware is not None:
        rcs_m2 = np.array([[target.rcs_m2] for target in scene.targets]).reshape(-1, 1)
        noise_w = thermal_noise_w(radar) if noise_power_w is None else noise_power_w
        echo_w = received_power_w(radar, range_m=range_m, rcs_m2=rcs_m2)
        with np.errstate(divide="ignore"):  # without noise it is infinite
            known["snr"] = (over, echo_w / noise_w * radar.integration_gain, {"units": "1"})
    return xr.Dataset(
        known,
        coords={
            "target": ("target", list(scene.names)),
            "frame": ("frame", np.arange(n_frames)),
            "time": ("frame", times_s, {"units": "s"}),
        },
    )


def surprises(scene: Scene, radar: Radar) -> list[Finding]:
    """Targets that fold in range or velocity, or whose echo comes after the first sample."""
    known = truth(scene, radar).isel(frame=0)
    found = []
    for name, range_m, velocity in zip(
        scene.names, known.range.values, known.velocity.values, strict=True
    ):
        setting = f"scene.targets.{name}"
        found += _folds(setting, float(range_m), float(velocity), radar)
        found += _late(setting, float(range_m), radar)
    return found


def _folds(setting: str, range_m: float, velocity: float, radar: Radar) -> list[Finding]:
    chirp, max_velocity = radar.frame.chirp, radar.frame.max_velocity_m_per_s
    found = []
    if not -max_velocity <= velocity < max_velocity:
        folded = (velocity + max_velocity) % (2 * max_velocity) - max_velocity
        shift_m = chirp.range_doppler_coupling_m(velocity - folded)
        found.append(
            Finding(
                level="warning",
                setting=f"{setting}.velocity",
                got=f"{velocity:.4g} m/s folds to {folded:.4g} m/s, and moves the range that is"
                f" found by {shift_m:+.3g} m",
                need=f"between -{max_velocity:.4g} and {max_velocity:.4g} m/s to be unambiguous",
                fix="Shorten the interval between chirps, or read the folded velocity.",
            )
        )
    beat_range_m = range_m + chirp.range_doppler_coupling_m(velocity)
    if not 0 <= beat_range_m < chirp.max_range_m:
        span_m = chirp.range_m(chirp.sample_rate_hz)
        folded_m = beat_range_m % span_m
        if chirp.sampling == "real":
            folded_m = min(folded_m, span_m - folded_m)
        found.append(
            Finding(
                level="warning",
                setting=f"{setting}.position",
                got=f"range {range_m:.4g} m folds to {folded_m:.4g} m",
                need=f"below {chirp.max_range_m:.4g} m to be unambiguous",
                fix="Sample faster or lower the slope, or read the folded range.",
            )
        )
    return found


def _late(setting: str, range_m: float, radar: Radar) -> list[Finding]:
    chirp = radar.frame.chirp
    delay_s = 2 * range_m / SPEED_OF_LIGHT
    if delay_s <= chirp.adc_start_s:
        return []
    late = int(np.ceil((delay_s - chirp.adc_start_s) * chirp.sample_rate_hz))
    missed = f"the first {late} samples" if late < chirp.n_samples else "all of it"
    return [
        Finding(
            level="warning",
            setting=f"{setting}.position",
            got=f"echo arrives {delay_s * 1e6:.4g} us after ramp start, sampling begins at"
            f" {chirp.adc_start_s * 1e6:.4g} us",
            need="a delay of at most adc_start for every sample to hold the echo",
            fix=f"Start sampling later. A real radar would miss {missed}, the simulation does not.",
        )
    ]
