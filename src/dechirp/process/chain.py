"""The processing chain, from the samples of a frame to its detections."""

from dataclasses import replace
from typing import get_args

import numpy as np
import xarray as xr

from dechirp.core.checks import count
from dechirp.core.conventions import CUBE_AXES, axis
from dechirp.core.errors import InvalidSetting
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.estimates import between_bins, estimates, noise_about
from dechirp.process.peaks import peaks
from dechirp.process.refine import refine
from dechirp.process.spectrum import (
    Transform,
    independent_rows,
    mean_power,
    noise_gain,
    range_doppler,
)
from dechirp.process.virtual import channels
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.windows import Window


@value
class Chain:
    """Settings of the chain, in the order in which they act."""

    range_window: Window = "hann"
    n_range_bins: int | None = None
    """Points of the range transform, zero-padded above n_samples; none: n_samples. Real
    sampling keeps the half of them that is not a mirror image."""
    doppler_window: Window = "hann"
    n_velocity_bins: int | None = None
    """Points of the Doppler transform, zero-padded above n_chirps; none: n_chirps."""
    cfar: Cfar = Cfar(estimator=CellAveraging(), false_alarm_probability=1e-6)
    angle: None = None
    """Direction estimator: none is available yet."""
    cluster: None = None
    """Clustering: none is available yet."""

    def __post_init__(self) -> None:
        for name in ("n_range_bins", "n_velocity_bins"):
            if getattr(self, name) is not None:
                count(self, name, at_least=2)
        for name in ("range_window", "doppler_window"):
            if getattr(self, name) not in get_args(Window):
                raise InvalidSetting(
                    f"Chain.{name}",
                    got=getattr(self, name),
                    need=" or ".join(get_args(Window)),
                    fix="Choose one of them.",
                )
        if not isinstance(self.cfar, Cfar):
            raise InvalidSetting(
                "Chain.cfar", got=self.cfar, need="a Cfar", fix="Leave it out for the default."
            )

    def over_range(self, chirp: Chirp) -> Transform:
        """The range transform for a chirp."""
        n_bins = chirp.n_samples if self.n_range_bins is None else self.n_range_bins
        return Transform(window=self.range_window, n_points=chirp.n_samples, n_bins=n_bins)

    def over_velocity(self, frame: Frame) -> Transform:
        """The Doppler transform for a frame."""
        n_bins = frame.n_chirps if self.n_velocity_bins is None else self.n_velocity_bins
        return Transform(window=self.doppler_window, n_points=frame.n_chirps, n_bins=n_bins)

    def fitted(self, radar: Radar) -> "Chain":
        """The same, with fewer training cells where the default ones have no room in the map."""
        n_rows = searched_rows(radar.frame.chirp, self.over_range(radar.frame.chirp))
        return replace(self, cfar=self.cfar.fitted(self.over_velocity(radar.frame).n_bins, n_rows))

    def noise(self, radar: Radar) -> Noise:
        """What white noise looks like in the map of a radar."""
        return Noise(
            over_range=self.over_range(radar.frame.chirp),
            over_velocity=self.over_velocity(radar.frame),
            n_channels=radar.n_summed,
        )


def power_map(cube: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Range-Doppler map of one frame, (chirp, rx, sample), to (velocity, range).

    Mean power over the channels, see `channels`; a tone on a bin keeps its power.
    """
    noise = chain.noise(radar)
    samples = cube.transpose("chirp", "rx", "sample").values
    units = "W" if cube.attrs.get("units") == "sqrt(W)" else "full scale squared"
    return xr.DataArray(
        _power(channels(samples, radar.frame), radar, noise),
        dims=("velocity", "range"),
        coords={
            "velocity": axis(
                "velocity", radar.frame.velocity_bins_m_per_s(noise.over_velocity.n_bins)
            ),
            "range": axis("range", radar.frame.chirp.range_bins_m(noise.over_range.n_bins)),
        },
        attrs={"units": units, "long_name": "power"},
    )


def threshold_map(power: xr.DataArray, radar: Radar, chain: Chain) -> xr.DataArray:
    """Threshold of each cell of a map; infinite in rows where no false-alarm law holds.

    Those are the rows about DC and about half the sample rate of real sampling, see
    `process.spectrum.independent_rows`; they are not training cells either.
    """
    labelled = power.transpose("velocity", "range")
    threshold = _threshold(labelled.values, radar, chain)
    return labelled.copy(data=threshold).assign_attrs(long_name="threshold")


def detect(cube: xr.DataArray, radar: Radar, chain: Chain | None = None) -> xr.Dataset:
    """Detections in each frame of a cube, simulated or recorded.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        complex for complex sampling, real for real, processed in single precision; any
        order of axes.
    radar : Radar
        The waveform and the receivers that the cube was taken with.
    chain : Chain, optional
        Windows, bins and detector; Hann windows and a 2-D cell-averaging CFAR at 1e-6
        without it. The default training cells become fewer where the map is small.

    Returns
    -------
    Dataset over `detection`
        frame
            Index of the frame in the cube.
        time : s
            Mid-frame, mid-window: the instant to which the estimates refer.
        range : m, velocity : m/s
            Receding positive; refined on unwindowed samples, range-Doppler coupling removed.
            A frame of one chirp tells no velocity: NaN, and the range of a target at rest.
        snr : ratio
            After integration over all samples, chirps and channels, without the window's
            loss: what the standard errors rest on. Noise from the corners of the training
            ring, which the sidelobes of the target do not reach; a ring of few cells (2 x 2
            on each side) makes it half a dB too high in the mean.
        range_std : m, velocity_std : m/s
            Standard errors, from the Cramer-Rao bound at that ratio.

    Raises
    ------
    InvalidSetting
        If the cube is not that radar's, holds samples that are not finite, or the training
        cells do not fit into the map.
    NotEnoughMemory
        If the map would not fit.

    Warns
    -----
    PhysicsWarning
        If a frame has more than 2,000 peaks: the strongest are kept.
    """
    chain = (chain or Chain()).fitted(radar)
    _must_be_of(cube, radar)
    starts_s = (
        cube.coords["frame"].values
        if "frame" in cube.coords
        else [radar.frame.start_s(index) for index in range(cube.sizes["frame"])]
    )
    samples = cube.variable.transpose(*CUBE_AXES).values
    kind = np.complex64 if radar.frame.chirp.sampling == "complex" else np.float32
    columns = [
        _detect_frame(
            channels(np.ascontiguousarray(samples[i], kind), radar.frame),
            radar,
            chain,
            i,
            float(start_s),
        )
        for i, start_s in enumerate(starts_s)
    ]
    merged = {name: np.concatenate([c[name] for c in columns]) for name in _UNITS}
    return xr.Dataset(
        {name: ("detection", merged[name], {"units": units}) for name, units in _UNITS.items()}
    )


_UNITS = {
    "frame": "1",
    "time": "s",
    "range": "m",
    "velocity": "m/s",
    "snr": "1",
    "range_std": "m",
    "velocity_std": "m/s",
}


def _detect_frame(
    samples: np.ndarray, radar: Radar, chain: Chain, index: int, start_s: float
) -> dict[str, np.ndarray]:
    """Columns of the detections in one frame, (chirp, channel, sample)."""
    frame, noise = radar.frame, chain.noise(radar)
    power = _power(samples, radar, noise)
    _must_be_finite(power)
    found = peaks(power, _threshold(power, radar, chain), noise)
    slow, fast = between_bins(power, found, noise)
    cell_noise = noise_about(power, found, chain.cfar.ring, noise.n_channels)
    sample_noise = cell_noise / noise_gain(noise.over_range, noise.over_velocity, frame.chirp)
    sample_noise = np.maximum(sample_noise, np.finfo(np.float32).tiny)
    tones = refine(samples, slow, fast, sample_noise)
    snr = np.maximum(tones.energy / sample_noise - noise.n_channels, 1e-3)
    return {
        "frame": np.full(len(found), index),
        "time": np.full(len(found), start_s + frame.mid_frame_s),
        **estimates(tones, snr, frame),
    }


def _power(samples: np.ndarray, radar: Radar, noise: Noise) -> np.ndarray:
    """Range-Doppler map of one frame, (chirp, channel, sample) to (velocity, range)."""
    cells = noise.over_range.n_bins * noise.over_velocity.n_bins
    must_fit(
        "range-Doppler map",
        needed_bytes=cells * (8.0 * noise.n_channels + 3 * 4.0),  # spectrum, power, threshold
        fix="Take fewer range or velocity bins.",
    )
    sampling = radar.frame.chirp.sampling
    return mean_power(range_doppler(samples, sampling, noise.over_range, noise.over_velocity))


def _threshold(power: np.ndarray, radar: Radar, chain: Chain) -> np.ndarray:
    """Threshold of each cell, infinite outside the rows that are searched."""
    noise = chain.noise(radar)
    rows = independent_rows(radar.frame.chirp, noise.over_range)
    if rows == slice(0, power.shape[1]):
        return chain.cfar.threshold(power, noise)
    threshold = np.full_like(power, np.inf)
    threshold[:, rows] = chain.cfar.threshold(np.ascontiguousarray(power[:, rows]), noise)
    return threshold


def searched_rows(chirp: Chirp, over_range: Transform) -> int:
    """Range rows of a map in which targets are looked for."""
    if chirp.sampling == "complex":
        return over_range.n_bins
    n_rows = over_range.n_bins // 2 + 1
    # In a large map the few rows that the noise law leaves out make no odds, and finding them
    # takes the square of their number.
    if n_rows > 2048:
        return n_rows
    rows = independent_rows(chirp, over_range)
    return rows.stop - rows.start


def _must_be_of(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the cube could be that radar's."""
    chirp = radar.frame.chirp
    if set(cube.dims) != set(CUBE_AXES):
        raise InvalidSetting(
            "cube",
            got=f"an array over {', '.join(map(str, cube.dims))}",
            need=f"over {', '.join(CUBE_AXES)}",
            fix="Name the axes so, and give missing ones length 1 with expand_dims.",
        )
    asked = {"chirp": radar.frame.n_sent, "rx": radar.array.n_rx, "sample": chirp.n_samples}
    for name, size in asked.items():
        if cube.sizes[name] != size:
            raise InvalidSetting(
                "cube",
                got=f"{cube.sizes[name]} along {name}",
                need=f"{size}, as the radar has",
                fix="Give the radar that the cube was taken with.",
            )
    if np.iscomplexobj(cube) != (chirp.sampling == "complex"):
        raise InvalidSetting(
            "cube",
            got=f"samples of type {cube.dtype}",
            need=f"{chirp.sampling} samples, as the chirp says",
            fix="Set the chirp's sampling to what the converter takes.",
        )


def _must_be_finite(power: np.ndarray) -> None:
    # One sample that is not finite reaches every cell, so one cell tells.
    if not np.isfinite(power[0, 0]):
        raise InvalidSetting(
            "cube",
            got="samples that are not finite (NaN or infinite)",
            need="finite samples throughout",
            fix="Find what wrote them, or replace them by zeros.",
        )
