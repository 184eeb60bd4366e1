"""Settings of one of several radars of a scenario: its mounting and its clock."""

from typing import get_args

from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.traffic.mounting import Mounting, MountName, mounting_on_vehicle


@frozen_dataclass
class MountedRadar:
    """One of several radars on a vehicle, with its mounting and its clock."""

    name: str | None = None
    """Name of the radar in results, a folder name; none: that of its mount."""
    mount: MountName = "front"
    """Place on the outline of the vehicle, 0.5 m above the ground, looking outwards."""
    pose: Mounting | None = None
    """Pose of the radar on the vehicle, in place of `mount`; needs a name."""
    radar: Radar | None = None
    """None: the radar of the scenario."""
    start_offset_s: float = 0.0
    """Start of its first frame after that of the run."""
    clock_error: float = 0.0
    """Relative frequency error of its oscillator, positive if fast. It shifts its chirps against
    those of the other radars; that on its own measurements, below 0.1 %, is left out."""

    def __post_init__(self) -> None:
        if self.mount not in get_args(MountName):
            raise InvalidSetting(
                "MountedRadar.mount",
                value=repr(self.mount),
                expected=f"one of {', '.join(get_args(MountName))}",
                fix="choose one, or give a pose",
            )
        if not isinstance(self.pose, Mounting | None):
            raise InvalidSetting(
                "MountedRadar.pose",
                value=self.pose,
                expected="a Mounting",
                fix="give its position and yaw, or a mount",
            )
        name = self.name or (None if self.pose is not None else self.mount)
        is_folder_name = isinstance(name, str) and not set(name) & set('/\\:*?"<>|')
        if not is_folder_name or name in (".", "..", "fused") or name != str(name).strip():
            raise InvalidSetting(
                "MountedRadar.name",
                value="missing, with a pose" if name is None else repr(name),
                expected="a folder name, other than fused",
                fix="give each radar a short name, such as front-left",
            )
        check_number("MountedRadar.start_offset_s", self.start_offset_s, at_least=0, at_most=1e3)
        check_number("MountedRadar.clock_error", self.clock_error, at_least=-1e-3, at_most=1e-3)

    @property
    def label(self) -> str:
        """Return the name of the radar, given or that of its mount."""
        return self.name or self.mount

    def mounting_on(self, length_m: float, width_m: float) -> Mounting:
        """Return the pose of the radar on a vehicle."""
        return self.pose or mounting_on_vehicle(self.mount, length_m, width_m)
