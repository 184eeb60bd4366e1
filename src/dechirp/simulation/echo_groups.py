"""Echo groups of a frame: scatterers on polynomial paths, and the chirps that illuminate them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dechirp.radar.budget import unit_echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.fluctuation import draw_fluctuation_factors
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.scene.trajectories import fit_polynomial_paths
from dechirp.simulation.kernels.base import Scatterers, Transmission


class SampleWindow(NamedTuple):
    """Sampling times of one frame, wider than the kept window if a stage needs margins."""

    frame_index: int
    frame_start_s: float
    """Start of the frame, since time zero."""
    chirp_starts_s: np.ndarray
    """(n_chirps,): start of each ramp, since the start of the frame."""
    first_sample_s: float
    """Time of the first sample, since the start of a ramp."""
    n_times: int
    rate_hz: float

    @property
    def times_s(self) -> np.ndarray:
        """Return the times of all samples, since the start of a ramp, (n_times,)."""
        return self.first_sample_s + np.arange(self.n_times) / self.rate_hz

    def select_chirps(self, chirps: slice) -> "SampleWindow":
        """Return the window of some of the chirps."""
        return self._replace(chirp_starts_s=self.chirp_starts_s[chirps])

    def widen(self, n_before: int, n_after: int) -> "SampleWindow":
        """Return the window with more samples before and after."""
        first_s = self.first_sample_s - n_before / self.rate_hz
        return self._replace(first_sample_s=first_s, n_times=n_before + self.n_times + n_after)


def frame_sampling_times(radar: Radar, frame_index: int) -> SampleWindow:
    """Return the sampling times of the kept samples of a frame."""
    frame, chirp = radar.frame, radar.frame.chirp
    starts_s = frame.for_frame(frame_index).chirp_starts_s
    return SampleWindow(
        frame_index, frame.frame_start_s(frame_index), starts_s, chirp.adc_start_s, chirp.n_samples,
        chirp.sample_rate_hz,
    )  # fmt: skip


class EchoGroup(NamedTuple):
    """Scatterers with polynomial paths over a run of chirps that share one ramp."""

    chirps: slice
    """Chirps of the frame, in the order sent; with a step if other ramps lie between."""
    scatterers: Scatterers
    transmission: Transmission
    targets: np.ndarray | None = None
    """(n_scatterers,): target of each scatterer; none: scatterers of no target, such as rain."""

    def select(self, selected: np.ndarray) -> "EchoGroup":
        """Return the group of some scatterers."""
        return self._replace(
            scatterers=self.scatterers.select(selected),
            targets=None if self.targets is None else self.targets[selected],
        )

    def scale_amplitudes(self, factor: float | np.ndarray) -> "EchoGroup":
        """Return the group with amplitudes multiplied by a factor, a number or (n_scatterers,)."""
        amplitudes = factor * self.scatterers.amplitudes
        return self._replace(scatterers=self.scatterers._replace(amplitudes=amplitudes))


def direct_echo_groups(
    scene: Scene,
    radar: Radar,
    frame_index: int,
    rng: np.random.Generator,
    *,
    include_zero_gain: bool = False,
) -> Iterator[EchoGroup]:
    """Yield the echo groups of one frame, over the direct paths and all chirps.

    `include_zero_gain` also yields scatterers towards which a pattern has no gain; reflected paths
    may still reach them.
    """
    start_s, radar = radar.frame.frame_start_s(frame_index), radar.for_frame(frame_index)
    frame = radar.frame
    mid_s = start_s + frame.mid_frame_s
    per_frame, per_chirp = draw_fluctuation_factors(scene, frame.n_chirps_total, rng)
    positions_m = scene.scatterer_positions_m([mid_s])
    rcs_m2 = scatterer_cross_sections_m2(scene, mid_s, frame.chirp.wavelength_m)
    scatterers_all = Scatterers(
        positions_m,
        unit_echo_amplitude(radar) * np.sqrt(rcs_m2 * per_frame),
        *tx_and_rx_amplitude_gains(positions_m[0], radar),
    )
    is_included = scatterers_all.amplitudes > 0
    if not include_zero_gain:
        is_included &= scatterers_all.tx_gains.max(axis=0) * scatterers_all.rx_gains.max(axis=0) > 0
    for path in fit_polynomial_paths(scene, frame, start_s, is_included):
        is_fitted = is_included[path.scatterers]
        indices, chirps = path.scatterers[is_fitted], path.chirps
        factors = None if per_chirp is None else np.sqrt(per_chirp[chirps][:, indices])
        scatterers = scatterers_all.select(indices)._replace(
            path_m=path.path_m[:, is_fitted], chirp_factors=factors
        )
        if indices.size:
            targets = scene.target_index_of_scatterer[indices]
            yield from echo_groups_of_equal_ramps(chirps, scatterers, path.mid_s, radar, targets)


def echo_groups_of_equal_ramps(
    chirps: slice,
    scatterers: Scatterers,
    mid_s: float,
    radar: Radar,
    targets: np.ndarray | None = None,
) -> Iterator[EchoGroup]:
    """Split a run of chirps into one group per ramp; `mid_s` is its middle in the frame."""
    frame, chirp = radar.frame, radar.frame.chirp
    starts_s, weights = frame.chirp_starts_s - mid_s, frame.chirp_weights()
    n_ramps = 1 if frame.has_identical_ramps else frame.n_slots
    for first in range(chirps.start, min(chirps.start + n_ramps, chirps.stop)):
        ramp_chirps = slice(first, chirps.stop, n_ramps if n_ramps > 1 else None)
        ramp = frame.ramps[first % n_ramps]
        factors = scatterers.chirp_factors
        if factors is not None:
            factors = factors[first - chirps.start :: n_ramps]
        transmission = Transmission(
            starts_s[ramp_chirps],
            weights[ramp_chirps],
            np.array(radar.array.tx_m),
            np.array(radar.array.rx_m),
            chirp.start_frequency_hz + ramp.shift_hz,
            chirp.slope_hz_per_s * ramp.sign,
            chirp.adc_start_s,
            chirp.sample_rate_hz,
        )
        ramp_scatterers = scatterers._replace(chirp_factors=factors)
        yield EchoGroup(ramp_chirps, ramp_scatterers, transmission, targets)


def tx_and_rx_amplitude_gains(
    positions_m: np.ndarray, radar: Radar
) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitude gains of all transmitters and receivers towards each scatterer."""
    hardware = radar.require_hardware()

    def side_gains(antennas_m: tuple[tuple[float, float, float], ...], side: str) -> np.ndarray:
        gain = getattr(hardware, f"{side}_gain")
        if getattr(hardware, f"{side}_pattern") is None:
            return np.full((len(antennas_m), len(positions_m)), np.sqrt(gain()))
        all_gains = np.empty((len(antennas_m), len(positions_m)))
        for row, antenna_m in zip(all_gains, antennas_m, strict=True):
            x, y, z = (positions_m - np.array(antenna_m)).T
            row[:] = np.sqrt(gain(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))))
        return all_gains

    return side_gains(radar.array.tx_m, "tx"), side_gains(radar.array.rx_m, "rx")
