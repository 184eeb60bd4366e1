"""Settings of the processing chain, from the samples of a frame to its detections."""

from dataclasses import replace
from functools import lru_cache
from typing import get_args

from dechirp.core.checks import count, instances
from dechirp.core.displayed import Displayed, told
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.angle.aperture import FieldOfView
from dechirp.process.angle.base import DirectionEstimator
from dechirp.process.angle.fft import Fft
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.cluster import Dbscan
from dechirp.process.mitigation.base import Mitigation
from dechirp.process.range_walk import RangeWalk
from dechirp.process.sources import tells_directions
from dechirp.process.spectrum import (
    Transform,
    independent_rows,
)
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window


@value
class Chain(Displayed):
    """Settings of the chain, in the order in which they act."""

    mitigation: tuple[Mitigation, ...] = ()
    """What is taken out of the samples before all else, in this order."""
    range_window: Window = "hann"
    n_range_bins: int | None = None
    """Points of the range transform, zero-padded above n_samples; none: n_samples. Real
    sampling keeps the half of them that is not a mirror image."""
    doppler_window: Window = "hann"
    n_velocity_bins: int | None = None
    """Points of the Doppler transform, zero-padded above n_chirps; none: n_chirps."""
    range_walk: RangeWalk | None = None
    """How targets that cross range cells within a frame are kept in one, where v M T of the
    largest velocity exceeds half a cell; none: not at all. Segmented leaves lobes 75 dB below a
    target, keystone none."""
    cfar: Cfar = Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)
    angle: DirectionEstimator | None = Fft()
    """How directions are estimated; none: not at all. The default is left out where the array
    tells none."""
    field_of_view: FieldOfView = FieldOfView()
    """Directions that are looked in; without an estimator, for the folds of velocities alone."""
    cluster: Dbscan | None = None
    """How detections become clusters, of one object each; none: they are left as they are."""

    def __post_init__(self) -> None:
        fix = "Write [MeanSubtraction()], with both brackets, even for one alone."
        methods = instances(
            "Chain.mitigation",
            self.mitigation,
            Mitigation,  # type: ignore[type-abstract]
            fix=fix,
        )
        object.__setattr__(self, "mitigation", methods)
        for name in ("n_range_bins", "n_velocity_bins"):
            if getattr(self, name) is not None:
                count(self, name, at_least=2)
        for name, choices in (
            ("range_window", get_args(Window)),
            ("doppler_window", get_args(Window)),
            ("range_walk", (*get_args(RangeWalk), None)),
        ):
            if getattr(self, name) not in choices:
                raise InvalidSetting(
                    f"Chain.{name}",
                    got=getattr(self, name),
                    need=" or ".join("none" if one is None else one for one in choices),
                    fix="Choose one of them.",
                )
        if not isinstance(self.angle, DirectionEstimator | None):
            raise InvalidSetting(
                "Chain.angle",
                got=self.angle,
                need="a member of the family, or none",
                fix="Give Fft(), or leave it out for the default.",
            )
        if not isinstance(self.cluster, Dbscan | None):
            raise InvalidSetting(
                "Chain.cluster",
                got=self.cluster,
                need="a Dbscan, or none",
                fix="Give Dbscan(), or leave it out.",
            )
        if not isinstance(self.cfar, Cfar):
            raise InvalidSetting(
                "Chain.cfar", got=self.cfar, need="a Cfar", fix="Leave it out for the default."
            )

    def over_range(self, chirp: Chirp) -> Transform:
        """The range transform for a chirp."""
        n_bins = chirp.n_samples if self.n_range_bins is None else self.n_range_bins
        return _transform(self.range_window, chirp.n_samples, n_bins)

    def over_velocity(self, frame: Frame) -> Transform:
        """The Doppler transform for a frame."""
        n_bins = frame.n_chirps if self.n_velocity_bins is None else self.n_velocity_bins
        return _transform(self.doppler_window, frame.n_chirps, n_bins)

    def fitted(self, radar: Radar) -> "Chain":
        """The same, without defaults that a radar has no room for.

        Fewer training cells where the default ones do not fit into the map, and no direction
        estimator instead of the default one where the array tells no direction.
        """
        n_rows = searched_rows(radar.frame.chirp, self.over_range(radar.frame.chirp))
        cfar = self.cfar.fitted(self.over_velocity(radar.frame).n_bins, n_rows)
        no_angle = self.angle is not None and self.angle == Fft() and not tells_directions(radar)
        if cfar is self.cfar and not no_angle:
            return self
        return replace(self, angle=None if no_angle else self.angle, cfar=cfar)

    def noise(self, radar: Radar) -> Noise:
        """What white noise looks like in the map of a radar."""
        return Noise(
            over_range=self.over_range(radar.frame.chirp),
            over_velocity=self.over_velocity(radar.frame),
            n_channels=radar.n_summed,
        )

    def _line(self) -> str:
        windows = dict.fromkeys((self.range_window, self.doppler_window))
        parts = [f"{told(self.mitigation)} taken out"] if self.mitigation else []
        parts += [f"{' and '.join(windows)} windows", self.cfar.estimator.kind()]
        rate = self.cfar.false_alarm_probability
        parts[-1] += "" if rate is None else f" at {told(rate, 'probability')}"
        parts.append("no directions" if self.angle is None else f"directions by {told(self.angle)}")
        parts += ["clusters"] if self.cluster is not None else []
        return ", ".join(parts)


@lru_cache(maxsize=64)
def _transform(window: Window, n_points: int, n_bins: int) -> Transform:
    """Kept, for what a transform knows of its window to be found once."""
    return Transform(window=window, n_points=n_points, n_bins=n_bins)


def searched_rows(chirp: Chirp, over_range: Transform) -> int:
    """Range rows of a map in which targets are looked for."""
    if chirp.sampling == "complex":
        return over_range.n_bins
    n_rows = over_range.n_bins // 2 + 1
    # In a large map the few rows that the noise law leaves out make no odds, and finding them
    # takes the square of their number.
    if n_rows > 2048:
        return n_rows
    rows = independent_rows(chirp, over_range)
    return rows.stop - rows.start
