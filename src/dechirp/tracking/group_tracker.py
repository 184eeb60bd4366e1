"""Settings of the group tracker."""

from dechirp.core.checks import (
    check_integer_fields,
    check_non_negative_fields,
    check_positive_fields,
    check_probability,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.tracking.tracker import check_confirmation_counts


@frozen_dataclass
class GroupTracker:
    """Settings of a tracker of extended objects, each seen as a group of points.

    An object moves straight on, turns, or accelerates and brakes: three motion models that
    interact. Its points scatter about its centre, as far as its estimated extent. The defaults
    suit people; for cars, set `size_std_m`.
    """

    size_std_m: float = 0.3
    """Expected standard deviation of points about the centre of an object, along x and along y: a
    quarter of the width of an ellipse that is filled evenly, so 0.3 for people and 0.8 for cars.
    It decides which points start a track; the extent is estimated from there."""
    velocity_spread_m_per_s: float = 0.5
    """Expected standard deviation of the range rates of an object about those of a rigid one:
    swinging limbs, turning wheels. It is estimated for each object, too."""
    process_noise_m2_per_s3: float = 0.1
    """Spectral density of the acceleration in straight motion and in turns."""
    manoeuvre_noise_m2_per_s3: float = 10.0
    """Spectral density of the acceleration of objects that start, brake or swerve."""
    turn_rate_std_rad_per_s: float = 0.5
    """Standard deviation of the turn rates of objects that turn."""
    model_time_s: float = 3.0
    """Mean time for which an object keeps to one motion model."""
    speed_std_m_per_s: float = 5.0
    """Standard deviation of unknown velocities when a track starts."""
    range_std_m: float = 0.05
    """Standard error of the range of points without `range_std`."""
    azimuth_std_rad: float = 0.02
    """Standard error of the azimuth of points without `azimuth_std`."""
    velocity_std_m_per_s: float = 0.1
    """Standard error of the velocity of points without `velocity_std`."""
    gate_probability: float = 0.99
    """Probability that a point of an object is within the gate of its track."""
    min_points: int = 4
    """Neighbouring points without a track that start one."""
    confirm_after: tuple[int, int] = (3, 5)
    """Frames with points that confirm a track, and the number of frames from its first within
    which they must occur; otherwise the track is dropped."""
    drop_after: int = 10
    """Consecutive frames without points that end the track of a moving object."""
    hold_time_s: float = 60.0
    """Time for which an object that stopped keeps its track without points: radars that remove
    static echoes lose it until it moves again."""
    still_speed_m_per_s: float = 0.4
    """Speed below which an object without points is held, as standing still."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "size_std_m", at_least=1e-3, at_most=1e3)
        check_positive_fields(self, "range_std_m", at_least=1e-6, at_most=1e4)
        check_positive_fields(self, "azimuth_std_rad", at_least=1e-6, at_most=1.0)
        check_positive_fields(
            self, "velocity_std_m_per_s", "velocity_spread_m_per_s", at_least=1e-6, at_most=1e4
        )
        check_positive_fields(
            self,
            *("process_noise_m2_per_s3", "manoeuvre_noise_m2_per_s3"),
            at_least=1e-9,
            at_most=1e9,
        )
        check_positive_fields(self, "turn_rate_std_rad_per_s", at_least=1e-6, at_most=10.0)
        check_positive_fields(self, "model_time_s", at_least=1e-3, at_most=1e6)
        check_positive_fields(self, "speed_std_m_per_s", at_least=1e-3, at_most=1e4)
        check_non_negative_fields(self, "hold_time_s", at_most=1e9)
        check_non_negative_fields(self, "still_speed_m_per_s", at_most=1e4)
        check_probability("GroupTracker.gate_probability", self.gate_probability)
        check_integer_fields(self, "min_points", "drop_after", at_most=100_000)
        counts = check_confirmation_counts("GroupTracker.confirm_after", self.confirm_after)
        object.__setattr__(self, "confirm_after", counts)
        if self.manoeuvre_noise_m2_per_s3 < self.process_noise_m2_per_s3:
            raise InvalidSetting(
                "GroupTracker.manoeuvre_noise_m2_per_s3",
                value=self.manoeuvre_noise_m2_per_s3,
                expected=f"at least process_noise_m2_per_s3, {self.process_noise_m2_per_s3:g}",
                fix="give the larger density to manoeuvres",
            )
