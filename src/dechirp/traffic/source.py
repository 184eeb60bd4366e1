"""Traffic file of a scenario, with the vehicle and the pose of the radar."""

from typing import get_args

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.traffic.frame_scenes import FrameScenes
from dechirp.traffic.mounting import Mounting, MountName
from dechirp.traffic.traffic import open_traffic


@frozen_dataclass
class TrafficSource:
    """Traffic file whose objects the radar observes, from one of the vehicles in it."""

    path: str
    ego: int | None = None
    """Id of the vehicle that carries the radar; None: the host of the file."""
    mount: MountName = "front"
    """Place on the outline of the vehicle, 0.5 m above the ground, looking outwards."""
    pose: Mounting | None = None
    """Pose of the radar on the vehicle, in place of `mount`."""
    start_s: float = 0.0
    """Start of the first frame, after the first step of the file."""
    duration_s: float | None = None
    """Duration of all frames; None: as long as the vehicle is present."""

    def __post_init__(self) -> None:
        if self.mount not in get_args(MountName):
            raise InvalidSetting(
                "TrafficSource.mount",
                value=repr(self.mount),
                expected=f"one of {', '.join(get_args(MountName))}",
                fix="choose one, or give a pose",
            )
        check_non_negative_fields(self, "start_s")
        if self.duration_s is not None:
            check_positive_fields(self, "duration_s")

    def open_scenes(self, radar: Radar) -> FrameScenes:
        """Open the file and return the scenes of a radar.

        Raises
        ------
        DechirpError
            As `open_traffic` and `FrameScenes`.
        """
        return FrameScenes(
            open_traffic(self.path),
            radar,
            ego=self.ego,
            mount=self.pose or self.mount,
            start_s=self.start_s,
            duration_s=self.duration_s,
        )
