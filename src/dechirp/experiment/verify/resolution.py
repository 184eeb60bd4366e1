"""The claim on two targets: how near they may come and still be two."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.units import decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.experiment.verify.claim import Claim, share
from dechirp.experiment.verify.looks import named, radar, white_noise
from dechirp.experiment.verify.trials import Job, trials_for_probability
from dechirp.process.chain import Chain
from dechirp.process.detect import detect
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.theory.windows import Window

INTEGRATED_SNR = 1000.0
"""Of each target, after integration: 30 dB."""
LEAST_SHARE = 0.9
APART_BINS: dict[Window, float] = {"rectangular": 1.5, "hann": 2.25}
"""Widths of a range bin between the targets at which both must be found 9 times in 10."""
CURVE_BINS = (0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5)
N_CURVE = 60
N_DECIDE = max(500, trials_for_probability(0.99, at_least=LEAST_SHARE))
"""Trials at the separation that decides; 99 in 100 or more are found."""
N_CHIRPS = 32
"""A quarter of the reference frame: range resolution does not depend on it, time does."""
PADDING = 2
"""Range bins for each sample: two targets 1.5 bins apart are not two maxima on whole bins."""


def jobs(n_trials: int) -> dict[str, Job]:
    """Trials at the separations that decide, and along the curve."""
    made = {}
    for window, apart_bins in APART_BINS.items():
        for name, separations, n in (
            (f"two targets, {window}", (apart_bins,), max(n_trials, N_DECIDE)),
            (f"two targets, {window}, curve", CURVE_BINS, N_CURVE * len(CURVE_BINS)),
        ):
            told = {"window": window, "separations": separations}
            made[name] = Job(work=two_targets, n_trials=n, told=told, n_each=40)
    return made


@cache
def short_radar() -> Radar:
    """The reference radar with fewer chirps."""
    return replace(radar(), frame=replace(radar().frame, n_chirps=N_CHIRPS))


def two_targets(
    rng: np.random.Generator, n_trials: int, *, window: Window, separations: tuple[float, ...]
) -> np.ndarray:
    """Separation in range bins, and whether both targets were found, (n_trials, 2).

    Equal targets at one random velocity, at random places of the bins, the second moved by up
    to half a wavelength, a whole turn of phase. Found means that each has a detection of its
    own, nearer to it than half the way to the other and within a resolution cell of velocity,
    and that there is no third within three bins of either.
    """
    frame = short_radar().frame
    cell_m = frame.chirp.range_resolution_m
    chain = Chain(
        range_window=window,
        doppler_window=window,
        n_range_bins=PADDING * frame.chirp.n_samples,
    )
    amplitude = np.float32(np.sqrt(INTEGRATED_SNR / short_radar().integration_gain))
    out = np.empty((n_trials, 2))
    for trial in range(n_trials):
        apart = separations[trial % len(separations)]
        near_m = cell_m * (50 + rng.random())
        turn_m = frame.chirp.wavelength_m / 2 * rng.random()
        velocity = 20.0 * (rng.random() - 0.5)
        both = [
            Target(
                name=name,
                position_m=(at_m, 0.0, 0.0),
                velocity_m_per_s=(velocity, 0.0, 0.0),
                rcs_m2=(at_m / 50) ** 4,  # echoes of equal power
            )
            for name, at_m in (("near", near_m), ("far", near_m + apart * cell_m + turn_m))
        ]
        scene = Scene(targets=tuple(both))
        echoes = clean_echoes(scene, short_radar(), dtype=np.dtype(np.complex64))
        samples = (amplitude / np.float32(_unit_amplitude())) * echoes.values
        samples += white_noise(rng, samples.shape)
        found = detect(xr.DataArray(samples, dims=CUBE_AXES), short_radar(), chain)
        known = truth(scene, short_radar()).isel(frame=0)
        off_m = abs(found.range.values[:, None] - known.range.values)
        off_m_per_s = abs(found.velocity.values[:, None] - known.velocity.values)
        own = off_m < apart * cell_m / 2
        own &= off_m_per_s < frame.velocity_resolution_m_per_s
        n_near = np.count_nonzero((off_m < 3 * cell_m).any(axis=1))
        out[trial] = apart, own.any(axis=0).all() and n_near == 2
    return out


@cache
def _unit_amplitude() -> float:
    """Amplitude of one echo of such a target."""
    scene = Scene(targets=(Target(position_m=(50.0, 0.0, 0.0), rcs_m2=1.0),))
    return float(abs(clean_echoes(scene, short_radar()).values[0, 0, 0, 0]))


def claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """The claim of this file."""
    checks = tuple(
        replace(
            share(
                f"both found, {named(window)}, {apart_bins:g} bins apart",
                results[f"two targets, {window}"][:, 1],
                at_least=LEAST_SHARE,
            ),
            published="1 m" if window == "rectangular" else None,
        )
        for window, apart_bins in APART_BINS.items()
    )
    return (
        Claim(
            id="two_targets_resolved",
            claim="Two equal targets a bin and a half apart are found as two, under Hann windows"
            " two and a quarter.",
            checks=checks,
            note=f"{float(decibels(INTEGRATED_SNR)):.0f} dB each after integration over {N_CHIRPS}"
            " chirps, zero-padded twice. The report's"
            f" 1 m is the width of a range bin, at which both are found in {_at_a_bin(results)}.",
        ),
    )


def _at_a_bin(results: Mapping[str, np.ndarray]) -> str:
    """How often both are found where the report says."""
    shares = []
    for window in APART_BINS:
        curve = results[f"two targets, {window}, curve"]
        shares.append(f"{curve[curve[:, 0] == 1.0, 1].mean():.0%} of trials under {named(window)}")
    return ", ".join(shares)
