"""Settings of the tracker."""

from typing import Literal, get_args

import numpy as np
from scipy.special import bdtrc

from dechirp.core.checks import count, listed, not_negative, positive, probability, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.tracking.false_alarms import FalseAlarms

Filter = Literal["extended", "unscented"]
Association = Literal["nearest", "joint"]

_LEAST_CHANCE = 0.01


@value
class Tracker:
    """How detections become tracks, in the order in which it acts.

    Targets go straight on with a velocity that white acceleration changes. There is at most
    one detection of a target in a frame: cluster first, where there are more.
    """

    filter: Filter = "unscented"
    """Kalman filter of azimuth, range and velocity: extended, by slopes; unscented, by sigma
    points, which is as sure as it may be from the first frames on."""
    association: Association = "joint"
    """Which detection is whose. Nearest: the likeliest assignment of all (GNN). Joint: every
    detection in the gate, by its probability (JPDA)."""
    process_noise_m2_per_s3: float = 1.0
    """Spectral density of the acceleration along x and along y: velocities change by its root
    in a second."""
    speed_std_m_per_s: float = 15.0
    """Of velocities across the line of sight when a track starts, and along where not told."""
    target_size_m: float = 0.0
    """Standard deviation of where on a target its echo comes from, added to the errors of range
    and across."""
    gate_probability: float = 0.999
    """How many of a target's detections the gate about its prediction lets in."""
    detection_probability: float = 0.9
    """Of a target, in each frame."""
    false_alarms: FalseAlarms = FalseAlarms()
    confirm_after: tuple[int, int] = (3, 5)
    """Detections that confirm a track, and the frames, from its first, in which they must come;
    else it is dropped."""
    drop_after: int = 5
    """Frames in a row without a detection that end a confirmed track."""

    def __post_init__(self) -> None:
        for name, choices in (("filter", get_args(Filter)), ("association", get_args(Association))):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"Tracker.{name}",
                    got=repr(getattr(self, name)),
                    need=f"one of {', '.join(choices)}",
                    fix="Choose one.",
                )
        # From a drifting buoy to a missile; from a snail to a meteor.
        positive(self, "process_noise_m2_per_s3", at_least=1e-9, at_most=1e9)
        positive(self, "speed_std_m_per_s", at_least=1e-6, at_most=1e5)
        not_negative(self, "target_size_m", at_most=1e4)
        probability("Tracker.gate_probability", self.gate_probability)
        probability("Tracker.detection_probability", self.detection_probability)
        if not isinstance(self.false_alarms, FalseAlarms):
            raise InvalidSetting(
                "Tracker.false_alarms",
                got=repr(self.false_alarms),
                need="a FalseAlarms",
                fix="Write FalseAlarms(per_frame=10), or leave it out.",
            )
        count(self, "drop_after", at_most=100_000)
        self._check_confirmation()

    def _check_confirmation(self) -> None:
        both = listed(self.confirm_after) or ()
        if len(both) != 2:
            raise InvalidSetting(
                "Tracker.confirm_after",
                got=self.confirm_after,
                need="two counts: detections, and the frames for them",
                fix="Write (3, 5) for three in five frames.",
            )
        for place, one in enumerate(both):
            whole(f"Tracker.confirm_after.{place}", one, at_least=1, at_most=100_000)
        object.__setattr__(self, "confirm_after", both)
        hits, frames = both
        if hits > frames:
            raise InvalidSetting(
                "Tracker.confirm_after",
                got=f"{hits} detections in {frames} frames",
                need="at most a detection in each frame, or no track is ever confirmed",
                fix=f"Ask for at most {frames} detections, or give it {hits} frames.",
            )
        # The first detection starts the track; the others are a binomial number.
        chance = bdtrc(hits - 2, frames - 1, self.hit_probability)
        if chance < _LEAST_CHANCE:
            raise InvalidSetting(
                "Tracker.confirm_after",
                got=f"{hits} detections in {frames} frames, where a target is detected and gated"
                f" with probability {self.hit_probability:.3g}: a chance of {chance:.2g}",
                need=f"what at least {_LEAST_CHANCE:.0%} of targets reach",
                fix="Ask for fewer detections, or give them more frames.",
            )

    @property
    def hit_probability(self) -> float:
        """That a target is detected, and its detection in the gate of its track."""
        return self.detection_probability * self.gate_probability

    def must_confirm_within(self, n_frames: int) -> None:
        """Raise `InvalidSetting` where a run has too few frames to confirm any track."""
        hits, _ = self.confirm_after
        if n_frames < hits:
            raise InvalidSetting(
                "Tracker.confirm_after",
                got=f"{hits} detections, in a run of {n_frames} frames",
                need="at most one for each frame of the run, or no track is ever confirmed",
                fix="Give it more frames, or ask for fewer detections.",
            )

    def must_outweigh_false_alarms(self, errors: np.ndarray) -> None:
        """Raise `InvalidSetting` where false alarms are so dense that a miss is always likelier.

        `errors` are the standard deviations of a usual detection: rad, m, m/s. Even where it is
        predicted without any error, and found just there, its likelihood is P_D / (density
        (2 pi)^(3/2) product of errors) times that of a false alarm; below 1 - P_D P_G it never
        counts as detected.
        """
        spread = (2 * np.pi) ** 1.5 * float(np.prod(errors))
        density = self.false_alarms.density_per_m_rad_m_per_s
        if self.detection_probability / (density * spread) <= 1 - self.hit_probability:
            raise InvalidSetting(
                "Tracker.false_alarms",
                got=f"so dense that {density * spread:.3g} fall where one target may be found",
                need=f"below {self.detection_probability / (1 - self.hit_probability):.3g}, or no"
                " track is ever confirmed",
                fix="Raise the threshold of the detector, or correct the number and the extents.",
            )
