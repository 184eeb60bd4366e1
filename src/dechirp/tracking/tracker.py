"""Settings of the tracker."""

import warnings
from typing import Literal, get_args

import numpy as np
import scipy

from dechirp.core.checks import (
    as_tuple_or_none,
    check_integer,
    check_integer_fields,
    check_non_negative_fields,
    check_numbers,
    check_positive_fields,
    check_probability,
)
from dechirp.core.display import format_count_with_noun
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.values import frozen_dataclass
from dechirp.tracking.false_alarms import FalseAlarms

Filter = Literal["extended", "unscented"]
Association = Literal["nearest", "joint"]

_MIN_CONFIRMATION_PROBABILITY = 0.01


@frozen_dataclass
class Tracker:
    """Settings of a tracker, in the order of its steps.

    Targets move at a velocity that white acceleration changes. A target has at most one detection
    per frame: cluster extended targets first. Where clusters split targets, `min_separation_m`
    prevents a second track.
    """

    filter: Filter = "unscented"
    """Kalman filter of azimuth, range and velocity: extended (linearised), or unscented (sigma
    points), which is consistent from the first frames on."""
    association: Association = "joint"
    """Association of detections with tracks. Nearest: the likeliest assignment (GNN). Joint: all
    detections in the gate, weighted by probability (JPDA)."""
    process_noise_m2_per_s3: float = 1.0
    """Spectral density of the acceleration along x and along y: the standard deviation of a
    velocity grows to its root in a second."""
    speed_std_m_per_s: float = 15.0
    """Standard deviation of unknown velocities when a track starts: across the line of sight, and
    along it without a rate."""
    target_size_m: float = 0.0
    """Distance by which the echo of a body is nearer than its centre, in the mean, and its standard
    deviation, along and across the line of sight; 0 for points. The extents of clusters add to it.
    Tracks then follow the centre, with an error that includes this offset, which stays for seconds
    and does not average out."""
    min_separation_m: tuple[float, float] = (0.0, 0.0)
    """Semi-axes, along and across the direction of motion, of an ellipse about each confirmed
    track: a detection within it starts no track, and a second track within it is not confirmed.
    Along, the length of targets that have several detections or clusters in a frame; across, less
    than the distance of neighbours. If the direction is unknown, a disc. 0, 0 switches it off."""
    gate_probability: float = 0.999
    """Probability that a detection of a target is within the gate of its track."""
    detection_probability: float = 0.9
    """Detection probability of a target, per frame."""
    false_alarms: FalseAlarms = FalseAlarms()
    confirm_after: tuple[int, int] = (3, 5)
    """Detections that confirm a track, and the number of frames from its first within which they
    must occur; otherwise the track is dropped."""
    drop_after: int = 5
    """Consecutive frames without a detection that end a confirmed track."""

    def __post_init__(self) -> None:
        for name, choices in (("filter", get_args(Filter)), ("association", get_args(Association))):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"Tracker.{name}",
                    value=repr(getattr(self, name)),
                    expected=f"one of {', '.join(choices)}",
                    fix="choose one",
                )
        # From a drifting buoy to a missile; from a snail to a meteor.
        check_positive_fields(self, "process_noise_m2_per_s3", at_least=1e-9, at_most=1e9)
        check_positive_fields(self, "speed_std_m_per_s", at_least=1e-6, at_most=1e5)
        check_non_negative_fields(self, "target_size_m", at_most=1e4)
        self._check_min_separation()
        check_probability("Tracker.gate_probability", self.gate_probability)
        check_probability("Tracker.detection_probability", self.detection_probability)
        if not isinstance(self.false_alarms, FalseAlarms):
            raise InvalidSetting(
                "Tracker.false_alarms",
                value=repr(self.false_alarms),
                expected="a FalseAlarms",
                fix="write FalseAlarms(per_frame=10), or leave it out",
            )
        check_integer_fields(self, "drop_after", at_most=100_000)
        self._check_confirm_after()

    def _check_min_separation(self) -> None:
        where = "Tracker.min_separation_m"
        axes_m = check_numbers(where, self.min_separation_m, at_least=0.0, at_most=1e4)
        if len(axes_m) != 2 or (0.0 in axes_m and any(axes_m)):
            raise InvalidSetting(
                where,
                value=self.min_separation_m,
                expected="two distances, along and across the direction of motion; both 0 for none",
                fix="write (7, 3) for vehicles, or the same distance twice for a disc",
            )
        object.__setattr__(self, "min_separation_m", axes_m)

    def _check_confirm_after(self) -> None:
        counts = check_confirmation_counts("Tracker.confirm_after", self.confirm_after)
        object.__setattr__(self, "confirm_after", counts)
        hits, frames = counts
        # The first detection starts the track; the others are a binomial number.
        chance = scipy.special.bdtrc(hits - 2, frames - 1, self.hit_probability)
        if chance < _MIN_CONFIRMATION_PROBABILITY:
            raise InvalidSetting(
                "Tracker.confirm_after",
                value=f"{hits} detections in {frames} frames, where a target is detected and gated"
                f" with probability {self.hit_probability:.3g}: a chance of {chance:.2g}",
                expected=f"a probability of confirmation of {_MIN_CONFIRMATION_PROBABILITY:.0%} or"
                " more",
                fix="require fewer detections, or allow more frames",
            )

    @property
    def hit_probability(self) -> float:
        """Probability that a target is detected within the gate of its track."""
        return self.detection_probability * self.gate_probability

    def check_false_alarm_density(self, measurement_errors: np.ndarray) -> None:
        """Raise `InvalidSetting` if false alarms are so dense that a miss is always likelier.

        `measurement_errors` are the standard deviations of a typical detection: rad, m, m/s. Even
        if it is predicted without error and has no residual, its likelihood is P_D / (density
        (2 pi)^(3/2) product of errors) times that of a false alarm; below 1 - P_D P_G it never
        counts as detected.
        """
        spread = (2 * np.pi) ** 1.5 * float(np.prod(measurement_errors))
        density = self.false_alarms.density_per_m_rad_m_per_s
        if self.detection_probability / (density * spread) <= 1 - self.hit_probability:
            raise InvalidSetting(
                "Tracker.false_alarms",
                value=f"a density of {density * spread:.3g} within the errors of a target",
                expected=f"below {self.detection_probability / (1 - self.hit_probability):.3g},"
                " or no track is ever confirmed",
                fix="raise the threshold of the detector, or correct the number and the extents",
            )


def warn_of_too_few_frames(setting: str, confirm_after: tuple[int, int], n_frames: int) -> None:
    """Warn if a run has too few frames to confirm any track."""
    hits, _ = confirm_after
    if n_frames < hits:
        finding = Finding(
            level="warning",
            setting=f"{setting}.confirm_after",
            value=f"{hits} detections, in a run of {format_count_with_noun(n_frames, 'frame')}:"
            " no track is confirmed",
            expected="at most one for each frame of the run",
            fix=f"process at least {hits} frames, or require fewer detections, such as"
            f" [{n_frames}, {max(n_frames, 2)}]",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)


def check_confirmation_counts(setting: str, value: object) -> tuple[int, int]:
    """Return the counts that confirm a track: frames with detections, and frames in all."""
    counts = as_tuple_or_none(value) or ()
    if len(counts) != 2:
        raise InvalidSetting(
            setting,
            value=value,
            expected="two counts: detections, and the frames for them",
            fix="write (3, 5) for three in five frames",
        )
    for place, count in enumerate(counts):
        check_integer(f"{setting}.{place}", count, at_least=1, at_most=100_000)
    hits, frames = counts
    if hits > frames:
        raise InvalidSetting(
            setting,
            value=f"{hits} detections in {frames} frames",
            expected="at most a detection in each frame, or no track is ever confirmed",
            fix=f"require at most {frames} detections, or allow {hits} frames",
        )
    return hits, frames
