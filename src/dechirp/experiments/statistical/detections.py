"""Detections from sampled peaks, by the steps that process the peaks of a map."""

import numpy as np

from dechirp.experiments.statistical.peak_sampling import SampledPeaks
from dechirp.processing.chain import Chain
from dechirp.processing.frame import build_detection_columns, find_directions
from dechirp.processing.refine import RefinedPeaks, Tones
from dechirp.processing.velocity_ambiguity.resolve import resolve_velocity_ambiguity
from dechirp.radar.radar import Radar


def detections_from_sampled_peaks(
    peaks: SampledPeaks, radar: Radar, chain: Chain
) -> dict[str, np.ndarray]:
    """Return columns as those of `processing.detect.detect` without time; `frame` as sampled."""
    energy = np.sum(np.abs(peaks.amplitude) ** 2, axis=1, dtype=float)
    tones = Tones(
        slow=peaks.slow - 2 * np.pi * _zero_velocity_bin_as_fraction(chain, radar),
        fast=peaks.fast,
        energy=energy,
        amplitude=peaks.amplitude,
    )
    snr = np.maximum(energy / peaks.noise - radar.n_summed_maps, 1e-3)
    refined_peaks = RefinedPeaks(tones, snr, amplitude_noise=peaks.noise)
    resolved = resolve_velocity_ambiguity([refined_peaks], radar, chain.field_of_view)
    sources = find_directions(resolved, radar, chain)
    return {
        "frame": peaks.frame[sources.detection],
        **build_detection_columns(resolved, sources, radar),
    }


def _zero_velocity_bin_as_fraction(chain: Chain, radar: Radar) -> float:
    """Return the bin of zero velocity over the number of bins."""
    n_bins = chain.doppler_transform(radar.frame).n_bins
    return (n_bins // 2) / n_bins
