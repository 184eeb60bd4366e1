r"""What reaches the receivers from every scatterer in every frame, before anything is drawn.

With the delay tau of a way there and back, the phase at mid-window is 2 pi (f tau - S tau^2 / 2),
so with tau at mid-frame the amplitudes of all channels follow, the near field included, and those
of scatterers of one cell add up as they do in samples. Within a frame a scatterer has one range,
one velocity and one acceleration.
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.impairments.fog import Fog
from dechirp.echoes.impairments.gas import Gas
from dechirp.echoes.impairments.rain import Rain
from dechirp.echoes.kernels.base import Scatterers
from dechirp.echoes.parts import gains, run_parts, window
from dechirp.experiment.statistical.axis_law import walked, worn
from dechirp.process.chain import Chain
from dechirp.process.maps import left_by
from dechirp.process.mitigation.noise import LEAST
from dechirp.radar.budget import echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies
from dechirp.scene.rcs import cross_sections_m2
from dechirp.scene.scene import Scene

WEAKENS = (Rain, Fog, Gas)
"""Impairments of the paths that do no more than weaken echoes."""


class Arrivals(NamedTuple):
    """Of each frame and scatterer, (n_frames, n_scatterers, ...)."""

    velocity: np.ndarray
    """In bins of the Doppler transform, from the first one, within them."""
    row: np.ndarray
    """In bins of the range transform; of real samples, those of a mirrored echo mirrored."""
    amplitude: np.ndarray
    """(..., n_channels) complex64: |.|^2 is the ratio after integration over the samples of one
    channel, of the mean cross section; steady but for `scene.fluctuation`."""
    in_cells: np.ndarray
    """Amplitude in the cells of the map, over that for a target at rest."""


def arrivals(
    scene: Scene,
    radar: Radar,
    chain: Chain,
    paths: tuple[Propagation, ...],
    times_s: np.ndarray,
    noise_power_w: float,
) -> Arrivals:
    """Echoes at mid-frame of each of the times; `paths` of the kinds of `WEAKENS`."""
    frame, chirp = radar.frame, radar.frame.chirp
    step_s = frame.duration_s / 4
    before_m, at_m, after_m = (scene.positions_m(times_s + by) for by in (-step_s, 0.0, step_s))
    middle_m = (np.mean(radar.array.tx_m, axis=0) + np.mean(radar.array.rx_m, axis=0)) / 2
    range_m = np.linalg.norm(at_m - middle_m, axis=-1)
    ends_m = [np.linalg.norm(one - middle_m, axis=-1) for one in (before_m, after_m)]
    velocity = (ends_m[1] - ends_m[0]) / (2 * step_s)
    acceleration = (ends_m[0] + ends_m[1] - 2 * range_m) / step_s**2

    at = frequencies(Place(range_m, velocity), radar)
    beat_hz, doppler_hz = at.beat_hz % chirp.sample_rate_hz, at.doppler_hz
    amplitude = _amplitudes(scene, radar, paths, times_s, at_m, doppler_hz)
    amplitude *= np.sqrt(frame.n_chirps * chirp.n_samples / noise_power_w)
    if chirp.sampling == "real":
        # Half of the power of a real tone is at its negative frequency.
        amplitude *= np.sqrt(0.5)
        mirrored = beat_hz > chirp.sample_rate_hz / 2
        beat_hz = np.where(mirrored, chirp.sample_rate_hz - beat_hz, beat_hz)
        doppler_hz = np.where(mirrored, -doppler_hz, doppler_hz)
        amplitude = np.where(mirrored[..., None], amplitude.conj(), amplitude)

    over_range, over_velocity = chain.over_range(chirp), chain.over_velocity(frame)
    row = beat_hz / chirp.sample_rate_hz * over_range.n_bins
    middle = over_velocity.n_bins // 2
    bins = (doppler_hz * frame.repetition_s * over_velocity.n_bins + middle) % over_velocity.n_bins

    drift = 2 * acceleration / chirp.wavelength_m * frame.duration_s**2
    amplitude *= worn(np.ones(frame.n_chirps), drift)[..., None]
    in_cells = worn(over_velocity.weights, drift) / worn(np.ones(frame.n_chirps), drift)
    if chain.range_walk is None:
        walk = velocity * frame.duration_s / chirp.range_resolution_m
        in_cells *= walked(over_velocity.weights, over_range.weights, walk)
    if (left := left_by(radar, chain)) is not None:
        passed = np.prod([one.passed(doppler_hz, frame) for one in chain.mitigation], axis=0)
        cell = np.rint(bins).astype(int) % over_velocity.n_bins
        own = left[cell, np.minimum(np.rint(row).astype(int), left.shape[1] - 1)]
        in_cells *= np.sqrt(passed / np.maximum(own, LEAST))
    return Arrivals(bins, row, amplitude.astype(np.complex64), in_cells)


def _amplitudes(
    scene: Scene,
    radar: Radar,
    paths: tuple[Propagation, ...],
    times_s: np.ndarray,
    at_m: np.ndarray,
    doppler_hz: np.ndarray,
) -> np.ndarray:
    """Of every channel, (n_frames, n_scatterers, n_channels), sqrt(W)."""
    frame, chirp, array = radar.frame, radar.frame.chirp, radar.array
    shape = at_m.shape[:2]
    wavelength_m = chirp.wavelength_m
    if scene.over_aspect.size:
        rcs_m2 = np.array([cross_sections_m2(scene, one, wavelength_m) for one in times_s])
    else:
        rcs_m2 = np.broadcast_to(cross_sections_m2(scene, times_s[0], wavelength_m), shape)
    flat_m = at_m.reshape(-1, 3)
    tx_gain, rx_gain = gains(flat_m, radar)
    weakened = np.ones(len(flat_m))
    if paths:
        scatterers = Scatterers(flat_m[None], weakened, tx_gain, rx_gain)
        parts = list(run_parts(slice(0, frame.n_sent), scatterers, frame.mid_frame_s, radar))[:1]
        for one in paths:
            parts = one.parts(parts, window(radar, 0), scene, radar, np.random.default_rng(0))
        weakened = parts[0].scatterers.amplitudes
    ways_m = [
        np.linalg.norm(flat_m[:, None] - np.array(antennas_m), axis=-1)
        for antennas_m in (array.tx_m, array.rx_m)
    ]
    # The phase in single precision would be 0.01 rad off at 1,000 turns: the way from the middle
    # is taken out first, and its own phase found in double.
    delay_s = sum(way_m.mean(axis=1) for way_m in ways_m) / SPEED_OF_LIGHT
    middle_hz = chirp.mean_sampled_frequency_hz - chirp.slope_hz_per_s * delay_s
    turn = chirp.mean_sampled_frequency_hz * delay_s - chirp.slope_hz_per_s / 2 * delay_s**2
    common = echo_amplitude(radar) * np.sqrt(rcs_m2.ravel()) * weakened
    common = common * np.exp(2j * np.pi * (turn % 1.0))
    sent, heard = (
        gain.T / way_m * np.exp(
            2j * np.pi / SPEED_OF_LIGHT * middle_hz[:, None]
            * (way_m - way_m.mean(axis=1, keepdims=True))
        )
        for gain, way_m in zip((tx_gain, rx_gain), ways_m, strict=True)
    )  # fmt: skip
    late_s = frame.turning_s - frame.turning_s.mean()
    by_slot = np.exp(2j * np.pi * doppler_hz.reshape(-1, 1) * late_s) * (
        sent @ np.array(frame.weights).T
    )
    channels = (common[:, None] * by_slot)[:, :, None] * heard[:, None]
    return channels.reshape(*shape, radar.n_summed)
