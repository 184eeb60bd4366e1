"""Received echoes of every scatterer in every frame, before any random draw.

With the two-way delay tau, the phase at mid-window is 2 pi (f tau - S tau^2 / 2),
so the amplitudes of all channels follow from tau at mid-frame, including the near field, and those
of scatterers of one cell add up as they do in samples. Within a frame a scatterer has one range,
one velocity and one acceleration.
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.experiments.statistical.axis_statistics import (
    frequency_drift_amplitude_gain,
    range_walk_amplitude_gain,
)
from dechirp.processing.chain import Chain
from dechirp.processing.mitigation.noise_loss import MIN_NOISE_GAIN
from dechirp.processing.range_doppler_map import residual_noise_gain
from dechirp.radar.budget import unit_echo_amplitude
from dechirp.radar.radar import Radar
from dechirp.scene.aliasing import RangeVelocity, beat_and_doppler_frequencies
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.scene import Scene
from dechirp.scene.shadowing import scatterer_shadow_gains
from dechirp.simulation.echo_groups import (
    echo_groups_of_equal_ramps,
    frame_sampling_times,
    tx_and_rx_amplitude_gains,
)
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.fog_attenuation import FogAttenuation
from dechirp.simulation.impairments.gas_attenuation import GasAttenuation
from dechirp.simulation.impairments.rain_attenuation import RainAttenuation
from dechirp.simulation.kernels.base import Scatterers

ATTENUATIONS = (RainAttenuation, FogAttenuation, GasAttenuation)
"""Impairments of the propagation paths that only attenuate echoes."""


class ReceivedEchoes(NamedTuple):
    """Echoes of each frame and scatterer, (n_frames, n_scatterers, ...)."""

    velocity: np.ndarray
    """Bin of the Doppler transform, from the first one, modulo their number."""
    row: np.ndarray
    """Bin of the range transform; for real samples, mirrored echoes are mirrored."""
    amplitude: np.ndarray
    """(..., n_channels) complex64: |.|^2 is the ratio after integration over the samples of one
    channel, of the mean cross section; constant except for `scene.fluctuation`."""
    in_cells: np.ndarray
    """Amplitude in the cells of the map, relative to a target at rest."""


def compute_received_echoes(
    scene: Scene,
    radar: Radar,
    chain: Chain,
    attenuations: tuple[Propagation, ...],
    times_s: np.ndarray,
    noise_power_w: float,
) -> ReceivedEchoes:
    """Compute the echoes at mid-frame of each time; `attenuations` must be in `ATTENUATIONS`."""
    frame, chirp = radar.frame, radar.frame.chirp
    step_s = frame.duration_s / 4
    moments_s = np.add.outer([-step_s, 0.0, step_s], times_s).ravel()
    before_m, at_m, after_m = np.split(scene.scatterer_positions_m(moments_s), 3)
    middle_m = (np.mean(radar.array.tx_m, axis=0) + np.mean(radar.array.rx_m, axis=0)) / 2
    range_m = np.linalg.norm(at_m - middle_m, axis=-1)
    ends_m = [np.linalg.norm(item - middle_m, axis=-1) for item in (before_m, after_m)]
    velocity = (ends_m[1] - ends_m[0]) / (2 * step_s)
    acceleration = (ends_m[0] + ends_m[1] - 2 * range_m) / step_s**2

    tone = beat_and_doppler_frequencies(RangeVelocity(range_m, velocity), radar)
    beat_hz, doppler_hz = tone.beat_hz % chirp.sample_rate_hz, tone.doppler_hz
    amplitude = _echo_amplitudes_per_channel(scene, radar, attenuations, times_s, at_m, doppler_hz)
    amplitude *= np.sqrt(frame.n_chirps * chirp.n_samples / noise_power_w)
    if chirp.sampling == "real":
        # A real tone has half of its power at the negative frequency.
        amplitude *= np.sqrt(0.5)
        mirrored = beat_hz > chirp.sample_rate_hz / 2
        beat_hz = np.where(mirrored, chirp.sample_rate_hz - beat_hz, beat_hz)
        doppler_hz = np.where(mirrored, -doppler_hz, doppler_hz)
        amplitude = np.where(mirrored[..., None], amplitude.conj(), amplitude)

    over_range, over_velocity = chain.range_transform(chirp), chain.doppler_transform(frame)
    row = beat_hz / chirp.sample_rate_hz * over_range.n_bins
    middle = over_velocity.n_bins // 2
    bins = (doppler_hz * frame.repetition_s * over_velocity.n_bins + middle) % over_velocity.n_bins

    drift = 2 * acceleration / chirp.wavelength_m * frame.duration_s**2
    amplitude *= frequency_drift_amplitude_gain(np.ones(frame.n_chirps), drift)[..., None]
    in_cells = frequency_drift_amplitude_gain(
        over_velocity.weights, drift
    ) / frequency_drift_amplitude_gain(np.ones(frame.n_chirps), drift)
    if chain.range_walk is None:
        walk = velocity * frame.duration_s / chirp.range_resolution_m
        in_cells *= range_walk_amplitude_gain(over_velocity.weights, over_range.weights, walk)
    if (residual := residual_noise_gain(radar, chain)) is not None:
        passed = np.prod(
            [item.doppler_power_gain(doppler_hz, frame) for item in chain.mitigation], axis=0
        )
        cell = np.rint(bins).astype(int) % over_velocity.n_bins
        cell_residual = residual[cell, np.minimum(np.rint(row).astype(int), residual.shape[1] - 1)]
        in_cells *= np.sqrt(passed / np.maximum(cell_residual, MIN_NOISE_GAIN))
    return ReceivedEchoes(bins, row, amplitude.astype(np.complex64), in_cells)


def _echo_amplitudes_per_channel(
    scene: Scene,
    radar: Radar,
    attenuations: tuple[Propagation, ...],
    times_s: np.ndarray,
    positions_m: np.ndarray,
    doppler_hz: np.ndarray,
) -> np.ndarray:
    """Compute the amplitudes of every channel, (n_frames, n_scatterers, n_channels), sqrt(W)."""
    frame, chirp, array = radar.frame, radar.frame.chirp, radar.array
    shape = positions_m.shape[:2]
    wavelength_m = chirp.wavelength_m
    if scene.aspect_dependent_targets.size:
        rcs_m2 = np.array(
            [scatterer_cross_sections_m2(scene, item, wavelength_m) for item in times_s]
        )
    else:
        rcs_m2 = np.broadcast_to(
            scatterer_cross_sections_m2(scene, times_s[0], wavelength_m), shape
        )
    if scene.has_shadows:
        rcs_m2 = rcs_m2 * [scatterer_shadow_gains(scene, item, wavelength_m) for item in times_s]
    flat_m = positions_m.reshape(-1, 3)
    tx_gain, rx_gain = tx_and_rx_amplitude_gains(flat_m, radar)
    attenuation = np.ones(len(flat_m))
    if attenuations:
        scatterers = Scatterers(flat_m[None], attenuation, tx_gain, rx_gain)
        parts = list(
            echo_groups_of_equal_ramps(
                slice(0, frame.n_chirps_total), scatterers, frame.mid_frame_s, radar
            )
        )[:1]
        for item in attenuations:
            parts = item.transform_echoes(
                parts, frame_sampling_times(radar, 0), scene, radar, np.random.default_rng(0)
            )
        attenuation = parts[0].scatterers.amplitudes
    path_lengths_m = [
        np.linalg.norm(flat_m[:, None] - np.array(antennas_m), axis=-1)
        for antennas_m in (array.tx_m, array.rx_m)
    ]
    # Single precision has a phase error of 0.01 rad at 1,000 cycles: the mean path is removed
    # first, and its phase computed in double precision.
    delay_s = sum(path_m.mean(axis=1) for path_m in path_lengths_m) / SPEED_OF_LIGHT
    middle_hz = chirp.mean_sampled_frequency_hz - chirp.slope_hz_per_s * delay_s
    cycles = chirp.mean_sampled_frequency_hz * delay_s - chirp.slope_hz_per_s / 2 * delay_s**2
    common = unit_echo_amplitude(radar) * np.sqrt(rcs_m2.ravel()) * attenuation
    common = common * np.exp(2j * np.pi * (cycles % 1.0))
    tx_factors, rx_factors = (
        gain.T / path_m * np.exp(
            2j * np.pi / SPEED_OF_LIGHT * middle_hz[:, None]
            * (path_m - path_m.mean(axis=1, keepdims=True))
        )
        for gain, path_m in zip((tx_gain, rx_gain), path_lengths_m, strict=True)
    )  # fmt: skip
    slot_offsets_s = frame.doppler_phase_times_s - frame.doppler_phase_times_s.mean()
    by_slot = np.exp(2j * np.pi * doppler_hz.reshape(-1, 1) * slot_offsets_s) * (
        tx_factors @ np.array(frame.weights).T
    )
    channels = (common[:, None] * by_slot)[:, :, None] * rx_factors[:, None]
    return channels.reshape(*shape, radar.n_summed_maps)
