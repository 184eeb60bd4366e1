"""Settings of the processing chain, from the samples of a frame to its detections."""

from dataclasses import replace
from functools import lru_cache
from typing import get_args

from dechirp.core.checks import check_instances, check_integer_fields, check_positive_fields
from dechirp.core.display import Displayable, format_setting_value
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.aperture import FieldOfView
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.angle.fft import Fft
from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.cluster import Dbscan
from dechirp.processing.direction_finding import can_resolve_directions
from dechirp.processing.mitigation.base import Mitigation
from dechirp.processing.moving_targets import MovingTargetMap
from dechirp.processing.range_walk import RangeWalk
from dechirp.processing.spectrum import Transform, rows_with_circular_noise
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window, check_window_name


@frozen_dataclass
class Chain(Displayable):
    """Settings of the chain, in the order in which they act."""

    mitigation: tuple[Mitigation, ...] = ()
    """Methods that repair or filter the samples first, in this order."""
    range_window: Window = "hann"
    n_range_bins: int | None = None
    """Points of the range transform, zero-padded above n_samples; n_samples if None. Real
    sampling keeps the half that is not a mirror image."""
    doppler_window: Window = "hann"
    n_velocity_bins: int | None = None
    """Points of the Doppler transform, zero-padded above n_chirps; n_chirps if None."""
    range_walk: RangeWalk | None = None
    """Correction of range walk, for frames in which v M T of the largest velocity exceeds half a
    range cell; None for no correction. Segmented leaves lobes 75 dB below a target, keystone
    none."""
    cfar: Cfar = Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)
    moving_targets: MovingTargetMap | None = None
    """Additional map without static echoes, in which moving targets are sought; None for no such
    map."""
    max_range_m: float | None = None
    """Largest range of detections, which leaves out those below zero range too; None for all."""
    image_rejection: float | None = None
    """Least ratio of an echo to its I/Q image, at the negative beat and Doppler frequencies, of a
    complex mixer with unequal branches: peaks weaker than the mirrored cell by this ratio are
    left out. None for all."""
    angle: DirectionEstimator | None = Fft()
    """Direction estimator; None for no directions. The default is dropped if the array resolves
    no direction."""
    field_of_view: FieldOfView = FieldOfView()
    """Directions that are searched; without an estimator only to resolve velocity ambiguity."""
    cluster: Dbscan | None = None
    """Clustering of detections into objects; None for no clusters."""

    def __post_init__(self) -> None:
        fix = "write [MeanSubtraction()], a list even for one method"
        methods = check_instances(
            "Chain.mitigation",
            self.mitigation,
            Mitigation,  # type: ignore[type-abstract]
            fix=fix,
        )
        object.__setattr__(self, "mitigation", methods)
        for name in ("n_range_bins", "n_velocity_bins"):
            if getattr(self, name) is not None:
                check_integer_fields(self, name, at_least=2)
        for name in ("range_window", "doppler_window"):
            check_window_name(f"Chain.{name}", getattr(self, name))
        if self.range_walk not in (*get_args(RangeWalk), None):
            raise InvalidSetting(
                "Chain.range_walk",
                value=self.range_walk,
                expected=" or ".join((*get_args(RangeWalk), "none")),
                fix="choose one of them",
            )
        if self.max_range_m is not None:
            check_positive_fields(self, "max_range_m")
        if self.image_rejection is not None:
            check_positive_fields(self, "image_rejection", at_most=1e30)
            if self.image_rejection <= 1:
                raise InvalidSetting(
                    "Chain.image_rejection",
                    value=f"{self.image_rejection:.4g}",
                    expected="more than 1 (0 dB): an image is weaker than its echo",
                    fix="write an image of -20 dB as 20 dB, or leave it out",
                )
        if not isinstance(self.moving_targets, MovingTargetMap | None):
            raise InvalidSetting(
                "Chain.moving_targets",
                value=self.moving_targets,
                expected="a MovingTargetMap, or none",
                fix="give MovingTargetMap(), or leave it out",
            )
        if not isinstance(self.angle, DirectionEstimator | None):
            raise InvalidSetting(
                "Chain.angle",
                value=self.angle,
                expected="a member of the family, or none",
                fix="give Fft(), or leave it out for the default",
            )
        if not isinstance(self.cluster, Dbscan | None):
            raise InvalidSetting(
                "Chain.cluster",
                value=self.cluster,
                expected="a Dbscan, or none",
                fix="give Dbscan(), or leave it out",
            )
        if not isinstance(self.cfar, Cfar):
            raise InvalidSetting(
                "Chain.cfar", value=self.cfar, expected="a Cfar", fix="leave it out for the default"
            )

    def range_transform(self, chirp: Chirp) -> Transform:
        """Return the range transform of a chirp."""
        n_bins = chirp.n_samples if self.n_range_bins is None else self.n_range_bins
        return _make_cached_transform(self.range_window, chirp.n_samples, n_bins)

    def doppler_transform(self, frame: Frame) -> Transform:
        """Return the Doppler transform of a frame."""
        n_bins = frame.n_chirps if self.n_velocity_bins is None else self.n_velocity_bins
        return _make_cached_transform(self.doppler_window, frame.n_chirps, n_bins)

    def fit_to_radar(self, radar: Radar) -> "Chain":
        """Return the chain with defaults that fit the radar.

        Fewer training cells where the default ones do not fit into the map, and no direction
        estimator instead of the default one where the array resolves no direction.
        """
        n_rows = n_searched_range_rows(radar.frame.chirp, self.range_transform(radar.frame.chirp))
        n_velocity_bins = self.doppler_transform(radar.frame).n_bins
        cfar = self.cfar.fit_to_map(n_velocity_bins, n_rows)
        moving = self.moving_targets
        if moving is not None:
            moving = moving.fit_to_map(n_velocity_bins, n_rows)
        no_angle = (
            self.angle is not None and self.angle == Fft() and not can_resolve_directions(radar)
        )
        if cfar is self.cfar and moving is self.moving_targets and not no_angle:
            return self
        angle = None if no_angle else self.angle
        return replace(self, angle=angle, cfar=cfar, moving_targets=moving)

    def moving_target_chain(self) -> "Chain":
        """Return the chain that computes the map of moving targets."""
        assert self.moving_targets is not None
        return replace(
            self,
            mitigation=(*self.mitigation, self.moving_targets.filter),
            cfar=self.moving_targets.cfar,
            moving_targets=None,
        )

    def map_noise_statistics(self, radar: Radar) -> MapNoise:
        """Return the statistics of white noise in the map of a radar."""
        return MapNoise(
            range_transform=self.range_transform(radar.frame.chirp),
            doppler_transform=self.doppler_transform(radar.frame),
            n_channels=radar.n_summed_maps,
        )

    def _display_line(self) -> str:
        windows = dict.fromkeys((self.range_window, self.doppler_window))
        parts = [f"{format_setting_value(self.mitigation)} applied"] if self.mitigation else []
        parts += [f"{' and '.join(windows)} windows", self.cfar.estimator.kind()]
        rate = self.cfar.false_alarm_probability
        parts[-1] += "" if rate is None else f" at {format_setting_value(rate, 'probability')}"
        parts.append(
            "no directions"
            if self.angle is None
            else f"directions by {format_setting_value(self.angle)}"
        )
        parts += ["moving targets apart"] if self.moving_targets is not None else []
        parts += ["clusters"] if self.cluster is not None else []
        return ", ".join(parts)


@lru_cache(maxsize=64)
def _make_cached_transform(window: Window, n_points: int, n_bins: int) -> Transform:
    """Return a cached transform, which computes the properties of its window once."""
    return Transform(window=window, n_points=n_points, n_bins=n_bins)


def n_searched_range_rows(chirp: Chirp, range_transform: Transform) -> int:
    """Return the number of range rows that are searched for targets."""
    if chirp.sampling == "complex":
        return range_transform.n_bins
    n_rows = range_transform.n_bins // 2 + 1
    # In a large map the few excluded rows make no difference, and finding them
    # takes the square of their number.
    if n_rows > 2048:
        return n_rows
    rows = rows_with_circular_noise(chirp, range_transform)
    return rows.stop - rows.start
