"""Claim on the resolution of two targets in range."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr

from dechirp.certificate.claim import Claim, proportion_check
from dechirp.certificate.reference_trials import complex_white_noise, reference_radar, window_label
from dechirp.certificate.trials import Job, count_trials_to_prove_probability
from dechirp.core.conventions import CUBE_AXES
from dechirp.core.units import to_decibels
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.simulation.simulate import simulate_ideal_echoes
from dechirp.theory.windows import Window

INTEGRATED_SNR = 1000.0
"""SNR of each target after integration, 30 dB."""
MIN_RESOLVED_PROPORTION = 0.9
REQUIRED_SEPARATION_BINS: dict[Window, float] = {"rectangular": 1.5, "hann": 2.25}
"""Separation in range bins at which both targets must be detected in 90 % of the trials."""
CURVE_SEPARATIONS_BINS = (0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5)
N_CURVE_TRIALS = 60
N_DECISION_TRIALS = max(
    500, count_trials_to_prove_probability(0.99, at_least=MIN_RESOLVED_PROPORTION)
)
"""Trials at the required separation; both targets are detected in at least 99 % of them."""
N_CHIRPS = 32
"""Number of chirps, a quarter of the reference frame: it affects only the computing time."""
PADDING_FACTOR = 2
"""Zero-padding factor of the range transform.

Without zero padding, targets separated by 1.5 bins may not form two local maxima.
"""


def resolution_trial_jobs(min_trials: int) -> dict[str, Job]:
    """Return the jobs at the required separations and along the curves."""
    jobs = {}
    for window, separation_bins in REQUIRED_SEPARATION_BINS.items():
        for name, separations, n_job_trials in (
            (f"two targets, {window}", (separation_bins,), max(min_trials, N_DECISION_TRIALS)),
            (
                f"two targets, {window}, curve",
                CURVE_SEPARATIONS_BINS,
                N_CURVE_TRIALS * len(CURVE_SEPARATIONS_BINS),
            ),
        ):
            arguments = {"window": window, "separations_bins": separations}
            jobs[name] = Job(
                work=run_resolution_trials,
                n_trials=n_job_trials,
                arguments=arguments,
                block_size=40,
            )
    return jobs


@cache
def reference_radar_with_fewer_chirps() -> Radar:
    """Return the reference radar with fewer chirps."""
    return replace(reference_radar(), frame=replace(reference_radar().frame, n_chirps=N_CHIRPS))


def run_resolution_trials(
    rng: np.random.Generator, n_trials: int, *, window: Window, separations_bins: tuple[float, ...]
) -> np.ndarray:
    """Simulate two equal targets; columns (n_trials, 2): separation in bins, both detected.

    The targets have the same random velocity and a random position relative to the bins. The second
    is shifted by up to half a wavelength, a full turn of phase. Both count as detected if each has
    a detection nearer than half the separation and within one velocity resolution cell, and if
    there is no third detection within three bins of either.
    """
    frame = reference_radar_with_fewer_chirps().frame
    cell_m = frame.chirp.range_resolution_m
    chain = Chain(
        range_window=window,
        doppler_window=window,
        n_range_bins=PADDING_FACTOR * frame.chirp.n_samples,
    )
    amplitude = np.float32(
        np.sqrt(INTEGRATED_SNR / reference_radar_with_fewer_chirps().integration_gain)
    )
    trials = np.empty((n_trials, 2))
    for trial in range(n_trials):
        separation = separations_bins[trial % len(separations_bins)]
        near_m = cell_m * (50 + rng.random())
        phase_shift_m = frame.chirp.wavelength_m / 2 * rng.random()
        velocity = 20.0 * (rng.random() - 0.5)
        targets = [
            Target(
                name=name,
                position_m=(range_m, 0.0, 0.0),
                velocity_m_per_s=(velocity, 0.0, 0.0),
                rcs_m2=(range_m / 50) ** 4,  # echoes of equal power
            )
            for name, range_m in (
                ("near", near_m),
                ("far", near_m + separation * cell_m + phase_shift_m),
            )
        ]
        scene = Scene(targets=tuple(targets))
        echoes = simulate_ideal_echoes(
            scene, reference_radar_with_fewer_chirps(), dtype=np.dtype(np.complex64)
        )
        samples = (amplitude / np.float32(_echo_amplitude_at_50_m())) * echoes.values
        samples += complex_white_noise(rng, samples.shape)
        detections = detect(
            xr.DataArray(samples, dims=CUBE_AXES), reference_radar_with_fewer_chirps(), chain
        )
        truth_values = truth(scene, reference_radar_with_fewer_chirps()).isel(frame=0)
        range_error_m = abs(detections.range.values[:, None] - truth_values.range.values)
        velocity_error_m_per_s = abs(
            detections.velocity.values[:, None] - truth_values.velocity.values
        )
        is_match = range_error_m < separation * cell_m / 2
        is_match &= velocity_error_m_per_s < frame.velocity_resolution_m_per_s
        n_near = np.count_nonzero((range_error_m < 3 * cell_m).any(axis=1))
        trials[trial] = separation, is_match.any(axis=0).all() and n_near == 2
    return trials


@cache
def _echo_amplitude_at_50_m() -> float:
    """Return the amplitude of the echo of one such target."""
    scene = Scene(targets=(Target(position_m=(50.0, 0.0, 0.0), rcs_m2=1.0),))
    return float(
        abs(simulate_ideal_echoes(scene, reference_radar_with_fewer_chirps()).values[0, 0, 0, 0])
    )


def evaluate_claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """Return the claim on resolution."""
    checks = tuple(
        replace(
            proportion_check(
                f"both detected, {window_label(window)}, separation {separation_bins:g} bins",
                results[f"two targets, {window}"][:, 1],
                at_least=MIN_RESOLVED_PROPORTION,
            ),
            published="1 m" if window == "rectangular" else None,
        )
        for window, separation_bins in REQUIRED_SEPARATION_BINS.items()
    )
    return (
        Claim(
            id="two_targets_resolved",
            claim="Two equal targets are resolved at a separation of 1.5 range bins, with Hann"
            " windows of 2.25 bins.",
            checks=checks,
            note=f"SNR of each target {float(to_decibels(INTEGRATED_SNR)):.0f} dB after integration"
            f" over {N_CHIRPS} chirps, range transform zero-padded by a factor of {PADDING_FACTOR}."
            " The report's 1 m is the width of a range bin; at this separation both are detected"
            f" in {_format_detection_rates_at_one_bin_separation(results)}.",
        ),
    )


def _format_detection_rates_at_one_bin_separation(results: Mapping[str, np.ndarray]) -> str:
    """Write how often both targets are detected at a separation of one range bin."""
    proportions = []
    for window in REQUIRED_SEPARATION_BINS:
        curve = results[f"two targets, {window}, curve"]
        proportions.append(
            f"{curve[curve[:, 0] == 1.0, 1].mean():.0%} of trials with {window_label(window)}"
        )
    return ", ".join(proportions)
