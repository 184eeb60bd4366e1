"""DC offset of each receiver, from self-mixing and amplifier offsets."""

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class DcOffset(Receiver):
    """Constant of equal power and individual phase in each receiver, at range 0 and velocity 0.

    Complex samples: sqrt(P) exp(i phase). Real samples: sqrt(2 P) cos(phase), like an echo.
    """

    power_w: float
    """Power of the constant, referred to the antenna like that of an echo."""
    phases_rad: tuple[float, ...] | None = None
    """Phase of each receiver; none: drawn uniformly."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "power_w", at_most=1e3)
        if self.phases_rad is not None:
            phases_rad = check_numbers("DcOffset.phases_rad", self.phases_rad)
            object.__setattr__(self, "phases_rad", phases_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless the number of phases equals that of receivers."""
        check_one_per_receiver("phases", self.phases_rad, radar)

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        n_rx = samples.shape[2]
        phases = rng.uniform(0, 2 * np.pi, n_rx) if self.phases_rad is None else self.phases_rad
        offsets = np.sqrt(self.power_w) * np.exp(1j * np.asarray(phases))
        if not np.iscomplexobj(samples):
            offsets = np.sqrt(2) * offsets.real
        samples += offsets.astype(samples.dtype)[:, None]


def check_one_per_receiver(setting: str, numbers: tuple[float, ...] | None, radar: Radar) -> None:
    """Raise `InvalidSetting` unless `numbers` is None or has one entry per receiver."""
    n_rx = radar.array.n_rx
    if numbers is not None and len(numbers) != n_rx:
        raise InvalidSetting(
            setting,
            value=f"{len(numbers)} values",
            expected=f"{n_rx} values, one for each receiver of radar.array.rx",
            fix="give one value for each receiver, in their order",
        )
