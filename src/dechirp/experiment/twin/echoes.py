"""What a twin sends back: a point for each peak, and what never left the radar as leakage."""

from dataclasses import dataclass, replace

import numpy as np

from dechirp.echoes.impairments.leakage import Leakage
from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

_LEAST_RCS_M2, _MOST_RCS_M2 = 1e-12, 1e12  # as a target takes them
_NEAREST_M = 1e-4


@dataclass(frozen=True)
class Echoes:
    """Points at mid-frame, each array (n,)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    power_w: np.ndarray
    """Of the echo in one receiver."""
    leaks: np.ndarray
    """Whether it is leakage, at rest: a way between the antennas and no target."""
    is_peak: np.ndarray
    """Whether it stands for a peak; else beside one, for what one point alone cannot give."""
    cell: np.ndarray
    """(n, 2), velocity and range: of the map, where it is asked for the recorded power."""

    def __len__(self) -> int:
        return len(self.range_m)

    def only(self, *places: int) -> "Echoes":
        """Some of them."""
        return Echoes(**{name: of[np.array(places, dtype=int)] for name, of in vars(self).items()})

    def beside(self, others: "Echoes") -> "Echoes":
        """All of both."""
        return Echoes(
            **{name: np.concatenate([of, getattr(others, name)]) for name, of in vars(self).items()}
        )

    def moved(self, *, range_m: np.ndarray, velocity_m_per_s: np.ndarray) -> "Echoes":
        """The same of the same power, farther away and faster; leakage stays at rest."""
        return replace(
            self,
            range_m=np.maximum(self.range_m + range_m, _NEAREST_M),
            velocity_m_per_s=self.velocity_m_per_s + np.where(self.leaks, 0, velocity_m_per_s),
        )

    def scene(self, radar: Radar) -> Scene:
        """The targets among them, as they are at time zero; strongest first, by number."""
        unit_w = received_power_w(
            radar,
            range_m=self.range_m,
            rcs_m2=1.0,
            azimuth_rad=self.azimuth_rad,
            elevation_rad=self.elevation_rad,
        )
        rcs_m2 = np.clip(self.power_w / unit_w, _LEAST_RCS_M2, _MOST_RCS_M2)
        level = np.cos(self.elevation_rad)
        ahead = (
            level * np.cos(self.azimuth_rad),
            level * np.sin(self.azimuth_rad),
            np.sin(self.elevation_rad),
        )
        velocity_m_per_s = self.velocity_m_per_s[:, None] * np.stack(ahead, axis=-1)
        position_m = self.range_m[:, None] * np.stack(ahead, axis=-1)
        position_m = position_m - velocity_m_per_s * radar.frame.mid_frame_s
        targets = [
            Target(
                name=f"peak-{place + 1}" if self.is_peak[place] else f"beside-{place + 1}",
                position_m=tuple(position_m[place].tolist()),
                velocity_m_per_s=tuple(velocity_m_per_s[place].tolist()),
                rcs_m2=float(rcs_m2[place]),
            )
            for place in np.flatnonzero(~self.leaks)
        ]
        return Scene(targets=tuple(targets))

    def leakage(self, radar: Radar) -> tuple[Leakage, ...]:
        """The leakage among them."""
        sent_w = radar.known_hardware().transmit_power_w
        return tuple(
            Leakage(
                isolation=max(sent_w / float(self.power_w[place]), 1.0),
                extra_length_m=2 * float(self.range_m[place]),
            )
            for place in np.flatnonzero(self.leaks)
        )
