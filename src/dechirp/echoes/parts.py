"""What is summed for a frame: scatterers on polynomial paths, and what is sent at them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dechirp.echoes.kernels import choice
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.fluctuation import power_factors
from dechirp.scene.paths import paths
from dechirp.scene.rcs import cross_sections_m2
from dechirp.scene.scene import Scene


class Window(NamedTuple):
    """When samples of one frame are taken: more than are kept, where a stage needs them."""

    frame: int
    start_s: float
    """Of the frame, since time zero."""
    starts_s: np.ndarray
    """(n_chirps,): start of each ramp, since the start of the frame."""
    first_s: float
    """First sample, since the start of a ramp."""
    n_times: int
    rate_hz: float

    @property
    def times_s(self) -> np.ndarray:
        """All samples, since the start of a ramp, (n_times,)."""
        return self.first_s + np.arange(self.n_times) / self.rate_hz

    def of(self, chirps: slice) -> "Window":
        """The same for some of the chirps."""
        return self._replace(starts_s=self.starts_s[chirps])

    def wider(self, before: int, after: int) -> "Window":
        """The same with more samples."""
        first_s = self.first_s - before / self.rate_hz
        return self._replace(first_s=first_s, n_times=before + self.n_times + after)


def window(radar: Radar, index: int) -> Window:
    """The samples of a frame that are kept."""
    frame, chirp = radar.frame, radar.frame.chirp
    starts_s = frame.at(index).chirps_s
    return Window(
        index, frame.start_s(index), starts_s, chirp.adc_start_s, chirp.n_samples,
        chirp.sample_rate_hz,
    )  # fmt: skip


class Part(NamedTuple):
    """Scatterers whose paths are polynomials during a run of chirps, all with one ramp."""

    chirps: slice
    """Of the frame, in the order sent; a step where ramps of other kinds lie between."""
    scatterers: Scatterers
    sent: Sent

    def weaker(self, factor: float | np.ndarray) -> "Part":
        """The same with amplitudes times a factor, (n_scatterers,) or one."""
        amplitudes = factor * self.scatterers.amplitudes
        return self._replace(scatterers=self.scatterers._replace(amplitudes=amplitudes))


def direct_parts(
    scene: Scene, radar: Radar, index: int, rng: np.random.Generator, *, unseen: bool = False
) -> Iterator[Part]:
    """What is to be summed for one frame; all chirps, as they are sent.

    `unseen`: with what antennas do not see straight; by another way they may.
    """
    start_s, radar = radar.frame.start_s(index), radar.at(index)
    frame = radar.frame
    mid_s = start_s + frame.mid_frame_s
    per_frame, per_chirp = power_factors(scene, frame.n_sent, rng)
    positions_m = scene.positions_m([mid_s])
    rcs_m2 = cross_sections_m2(scene, mid_s, frame.chirp.wavelength_m)
    every = Scatterers(
        positions_m,
        echo_amplitude(radar) * np.sqrt(rcs_m2 * per_frame),
        *gains(positions_m[0], radar),
    )
    seen = every.amplitudes > 0
    if not unseen:
        seen &= every.tx_gains.max(axis=0) * every.rx_gains.max(axis=0) > 0
    for path in paths(scene, frame, start_s, seen):
        kept = seen[path.scatterers]
        own, chirps = path.scatterers[kept], path.chirps
        factors = None if per_chirp is None else np.sqrt(per_chirp[chirps][:, own])
        scatterers = choice.some(every, own)._replace(
            path_m=path.path_m[:, kept], chirp_factors=factors
        )
        if own.size:
            yield from run_parts(chirps, scatterers, path.mid_s, radar)


def run_parts(chirps: slice, scatterers: Scatterers, mid_s: float, radar: Radar) -> Iterator[Part]:
    """A run of chirps, one part for each kind of ramp; `mid_s`: its middle, in the frame."""
    frame, chirp = radar.frame, radar.frame.chirp
    starts_s, weights = frame.chirps_s - mid_s, frame.sent_weights()
    n_kinds = 1 if frame.ramps_are_alike else frame.n_slots
    for first in range(chirps.start, min(chirps.start + n_kinds, chirps.stop)):
        own = slice(first, chirps.stop, n_kinds if n_kinds > 1 else None)
        ramp = frame.ramps[first % n_kinds]
        factors = scatterers.chirp_factors
        if factors is not None:
            factors = factors[first - chirps.start :: n_kinds]
        sent = Sent(
            starts_s[own],
            weights[own],
            np.array(radar.array.tx_m),
            np.array(radar.array.rx_m),
            chirp.start_frequency_hz + ramp.shift_hz,
            chirp.slope_hz_per_s * ramp.sign,
            chirp.adc_start_s,
            chirp.sample_rate_hz,
        )
        yield Part(own, scatterers._replace(chirp_factors=factors), sent)


def gains(positions_m: np.ndarray, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude gains of every transmitter and receiver towards each scatterer."""
    hardware = radar.known_hardware()

    def towards(antennas_m: tuple[tuple[float, float, float], ...], which: str) -> np.ndarray:
        gain = getattr(hardware, f"{which}_gain")
        if getattr(hardware, f"{which}_pattern") is None:
            return np.full((len(antennas_m), len(positions_m)), np.sqrt(gain()))
        towards_all = np.empty((len(antennas_m), len(positions_m)))
        for row, antenna_m in zip(towards_all, antennas_m, strict=True):
            x, y, z = (positions_m - np.array(antenna_m)).T
            row[:] = np.sqrt(gain(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))))
        return towards_all

    return towards(radar.array.tx_m, "tx"), towards(radar.array.rx_m, "rx")
