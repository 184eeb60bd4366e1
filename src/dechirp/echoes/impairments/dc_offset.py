"""A constant in all samples of a receiver: self-mixing, and offsets of its amplifiers."""

import numpy as np

from dechirp.core.checks import not_negative, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class DcOffset(Receiver):
    """A constant of one power and another phase in each receiver, at range 0 and velocity 0.

    Complex samples: sqrt(P) exp(i phase). Real ones: sqrt(2 P) cos(phase), as of an echo.
    """

    power_w: float
    """Power of the constant, referred to the antenna as that of an echo."""
    phases_rad: tuple[float, ...] | None = None
    """Of each receiver; none: drawn, all as likely."""

    def __post_init__(self) -> None:
        not_negative(self, "power_w", at_most=1e3)
        if self.phases_rad is not None:
            phases_rad = series("DcOffset.phases_rad", self.phases_rad)
            object.__setattr__(self, "phases_rad", phases_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless there is a phase for each receiver."""
        must_be_for_each_receiver("phases", self.phases_rad, radar)

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the constants."""
        n_rx = samples.shape[2]
        phases = rng.uniform(0, 2 * np.pi, n_rx) if self.phases_rad is None else self.phases_rad
        offsets = np.sqrt(self.power_w) * np.exp(1j * np.asarray(phases))
        if not np.iscomplexobj(samples):
            offsets = np.sqrt(2) * offsets.real
        samples += offsets.astype(samples.dtype)[:, None]


def must_be_for_each_receiver(
    setting: str, numbers: tuple[float, ...] | None, radar: Radar
) -> None:
    """Raise `InvalidSetting` unless nothing is given, or one number for each receiver."""
    n_rx = radar.array.n_rx
    if numbers is not None and len(numbers) != n_rx:
        raise InvalidSetting(
            setting,
            got=f"of {len(numbers)} receivers",
            need=f"of {n_rx}, as radar.array.rx has",
            fix="Give one for each receiver, in their order.",
        )
