"""Echoes of a twin: one point for each peak, and leakage between the antennas."""

from dataclasses import dataclass, replace

import numpy as np

from dechirp.radar.budget import received_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.impairments.leakage import Leakage

_MIN_RCS_M2, _MAX_RCS_M2 = 1e-12, 1e12  # limits of a target
_MIN_RANGE_M = 1e-4


@dataclass(frozen=True)
class PointEchoes:
    """Points at mid-frame, each array (n,)."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    power_w: np.ndarray
    """Power of the echo in one receiver."""
    is_leakage: np.ndarray
    """Whether it is leakage, at rest: a path between the antennas, not a target."""
    is_peak: np.ndarray
    """Whether it represents a peak; else a second point beside one, for an extended body."""
    map_cell: np.ndarray
    """(n, 2), velocity and range: cell of the map in which it has the recorded power."""

    def __len__(self) -> int:
        return len(self.range_m)

    def select_points(self, *indices: int) -> "PointEchoes":
        """Return the points with these indices."""
        return PointEchoes(
            **{name: values[np.array(indices, dtype=int)] for name, values in vars(self).items()}
        )

    def concatenate(self, others: "PointEchoes") -> "PointEchoes":
        """Return the points of both."""
        return PointEchoes(
            **{
                name: np.concatenate([values, getattr(others, name)])
                for name, values in vars(self).items()
            }
        )

    def shift_in_range_and_velocity(
        self, *, range_m: np.ndarray, velocity_m_per_s: np.ndarray
    ) -> "PointEchoes":
        """Return the points of equal power, farther away and faster; leakage stays at rest."""
        return replace(
            self,
            range_m=np.maximum(self.range_m + range_m, _MIN_RANGE_M),
            velocity_m_per_s=self.velocity_m_per_s + np.where(self.is_leakage, 0, velocity_m_per_s),
        )

    def targets_as_scene(self, radar: Radar) -> Scene:
        """Return the targets among them at time zero; strongest first, numbered."""
        unit_w = received_power_w(
            radar,
            range_m=self.range_m,
            rcs_m2=1.0,
            azimuth_rad=self.azimuth_rad,
            elevation_rad=self.elevation_rad,
        )
        rcs_m2 = np.clip(self.power_w / unit_w, _MIN_RCS_M2, _MAX_RCS_M2)
        horizontal = np.cos(self.elevation_rad)
        direction = (
            horizontal * np.cos(self.azimuth_rad),
            horizontal * np.sin(self.azimuth_rad),
            np.sin(self.elevation_rad),
        )
        velocity_m_per_s = self.velocity_m_per_s[:, None] * np.stack(direction, axis=-1)
        position_m = self.range_m[:, None] * np.stack(direction, axis=-1)
        position_m = position_m - velocity_m_per_s * radar.frame.mid_frame_s
        targets = [
            Target(
                name=f"peak-{index + 1}" if self.is_peak[index] else f"beside-{index + 1}",
                position_m=tuple(position_m[index].tolist()),
                velocity_m_per_s=tuple(velocity_m_per_s[index].tolist()),
                rcs_m2=float(rcs_m2[index]),
            )
            for index in np.flatnonzero(~self.is_leakage)
        ]
        return Scene(targets=tuple(targets))

    def leakage_impairments(self, radar: Radar) -> tuple[Leakage, ...]:
        """Return the leakage among them."""
        transmit_power_w = radar.require_hardware().transmit_power_w
        return tuple(
            Leakage(
                isolation=max(transmit_power_w / float(self.power_w[index]), 1.0),
                extra_length_m=2 * float(self.range_m[index]),
            )
            for index in np.flatnonzero(self.is_leakage)
        )
