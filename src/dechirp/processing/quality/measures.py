"""Quality measures of a frame of samples; `findings` evaluates them."""

import numpy as np
import scipy
import xarray as xr

from dechirp.core.conventions import CUBE_AXES, axis_coordinate, labelled_variable
from dechirp.processing.quality.beat_spectrum import (
    mean_spectrum_and_mirror_products,
    measure_echoes_and_mirror_images,
)
from dechirp.processing.quality.interference_bursts import measure_bursts
from dechirp.processing.quality.outlier_chirps import measure_outlier_chirp_excess
from dechirp.processing.quality.receiver_order import (
    N_CELLS,
    find_receiver_order_on_line,
    strongest_echo_snapshots_and_snr,
)
from dechirp.processing.quality.sample_statistics import (
    SILENT,
    SampleStatistics,
    compute_sample_statistics,
)
from dechirp.processing.quality.synchronous_interference import find_ghost_track
from dechirp.processing.scaling import to_single_precision
from dechirp.radar.radar import Radar

_MAX_SPECTRUM_FRAMES = 512  # frames in which spectra are measured
_FALSE_ALARM_PROBABILITY = 1e-9  # false-alarm probability of a range-Doppler map of noise

# Interval of chirps beyond which bursts are not measured: in 5 ms a person walks by a wavelength of
# 60 GHz, and a car by half a range cell of 0.2 m.
_MAX_REPETITION_S = 5e-3


class QualityMeasurer:
    """Measurer of the frames of one radar: measures each, and joins the measures.

    Samples, bursts and outlier chirps are measured in every frame, spectra in at most 512 frames at
    equal distances: images, ghosts and orders of receivers persist over many frames.
    """

    def __init__(self, radar: Radar, *, n_frames: int = 1) -> None:
        self._radar = radar
        self._spectrum_step = -(-n_frames // _MAX_SPECTRUM_FRAMES)
        # Approximate for lists of intervals.
        self._frame = radar.for_frame(0).frame
        self._has_receiver_line = find_receiver_order_on_line(radar.array) is not None
        self._frames: list[dict[str, np.ndarray]] = []
        self._starts_s: list[float] = []
        self._is_complex = radar.frame.chirp.sampling == "complex"

    @property
    def n_frames(self) -> int:
        """Number of measured frames."""
        return len(self._starts_s)

    def add_frame(
        self, samples: np.ndarray, is_lost: np.ndarray | None, start_s: float
    ) -> dict[str, np.ndarray]:
        """Measure the samples (chirp, rx, sample) of one frame, which start at a time.

        Returns the measures, without the axis `frame`. `is_lost` (chirp,) marks chirps to leave
        out; None for none.
        """
        self._is_complex = np.iscomplexobj(samples)
        samples = to_single_precision(samples, is_complex=self._is_complex)
        if is_lost is None:
            is_lost = np.zeros(len(samples), bool)
        measures = self._measure(samples, is_lost)
        self._frames.append(measures)
        self._starts_s.append(start_s)
        return measures

    def add_cube(self, frame: xr.DataArray) -> None:
        """Measure one frame, (frame, chirp, rx, sample), with or without the coordinate `gap`."""
        cube = frame.variable.transpose(*CUBE_AXES)
        is_lost = None
        if "gap" in frame.coords:
            is_lost = np.array(frame["gap"].values, bool).reshape(cube.sizes["chirp"])
        start_s = (
            float(frame.coords["frame"].values[0])
            if "frame" in frame.coords
            else self._radar.frame.frame_start_s(self.n_frames)
        )
        self.add_frame(cube.values[0], is_lost, start_s)

    def joined_measures(self, units: str) -> xr.Dataset:
        """Return the measures of all frames, of samples in `units`, see `measure_frame_quality`."""
        variables = {
            name: labelled_variable(
                ("frame", *dims), np.stack([frame[name] for frame in self._frames]), {}
            )
            for name, dims in _DIMS.items()
        }
        coords = {"frame": axis_coordinate("frame", np.array(self._starts_s))}
        attrs = {"units": units, "is_complex": int(self._is_complex)}
        return xr.Dataset(variables, coords=coords, attrs=attrs)

    def _measure(self, samples: np.ndarray, is_lost: np.ndarray) -> dict[str, np.ndarray]:
        n_slots, n_rx = self._radar.frame.n_slots, samples.shape[1]
        statistics = compute_sample_statistics(
            samples.view(np.float32), is_lost, 2 if self._is_complex else 1
        )
        is_silent = statistics.largest_part_magnitude < SILENT
        scale = 1.0 if is_silent else statistics.largest_part_magnitude
        is_alive = ~statistics.constant_receiver_mask & (not is_silent)
        kept_samples = samples[~is_lost] if is_lost.any() else samples
        # Chirps far apart see different scenes, so that no background is common to them.
        is_slow = self._radar.frame.repetition_s > _MAX_REPETITION_S
        bursts = measure_bursts(
            samples,
            np.ones_like(is_lost) if is_slow else is_lost,
            n_slots=n_slots,
            largest_value=scale,
            adc_step=statistics.step,
        )
        outlier_excess = measure_outlier_chirp_excess(
            samples, is_lost, n_slots=n_slots, largest_value=scale, adc_step=statistics.step
        )
        spectral = _unmeasured_spectra(n_rx)
        if self.n_frames % self._spectrum_step == 0:
            spectral = self._measure_spectra(samples, is_lost, is_alive, scale)
        return {
            "n_numbers": np.asarray(statistics.n_numbers),
            "mean": statistics.mean,
            "power": statistics.power,
            "level": statistics.level,
            "count": statistics.count,
            "copy_of": _first_receiver_with_same_samples(statistics, kept_samples),
            "lost": is_lost,
            "burst": bursts.excess,
            "burst_share": bursts.share,
            "kurtosis": bursts.kurtosis,
            "unlike": outlier_excess,
            **spectral,
        }

    def _measure_spectra(
        self, samples: np.ndarray, is_lost: np.ndarray, is_alive: np.ndarray, scale: float
    ) -> dict[str, np.ndarray]:
        """Return the measures of the beat spectra of one frame."""
        radar, n_slots, n_rx = self._radar, self._radar.frame.n_slots, samples.shape[1]
        spectrum = mean_spectrum_and_mirror_products(samples, is_lost, scale)
        sides = measure_echoes_and_mirror_images(spectrum, is_alive)
        n_echoes = sides.n_echoes
        if n_echoes == 0 and _has_doppler_peak(samples[~is_lost], is_alive, scale):
            n_echoes = 1.0
        ghost = find_ghost_track(samples, is_lost, self._frame, scale)
        chirp = radar.frame.chirp
        image_range_m = chirp.range_m(chirp.sample_rate_hz) * sides.strongest_bin / chirp.n_samples
        measures = _unmeasured_spectra(n_rx) | {
            "n_echoes": np.asarray(n_echoes),
            "echo_energy": sides.echo_energy,
            "mirrored": np.asarray(sides.mirror_similarity),
            "image": sides.image_level,
            "image_range": np.asarray(image_range_m),
            "walk_velocity": np.asarray(ghost.velocity_m_per_s),
            "walk_range": np.asarray(ghost.range_m),
            "walk_chirps": np.array([ghost.first_chirp, ghost.last_chirp]),
        }
        if self._has_receiver_line and is_alive.all() and radar.array.n_rx == n_rx:
            measures["seen"], measures["seen_snr"] = strongest_echo_snapshots_and_snr(
                samples, is_lost, spectrum, n_slots=n_slots, largest_value=scale
            )
        return measures


def _unmeasured_spectra(n_rx: int) -> dict[str, np.ndarray]:
    """Return the measures of spectra of a frame in which they were not measured."""
    nan = np.asarray(np.nan)
    return {
        "n_echoes": nan,
        "echo_energy": np.zeros(2),
        "mirrored": nan,
        "image": np.full(n_rx, np.nan),
        "image_range": nan,
        "walk_velocity": nan,
        "walk_range": nan,
        "walk_chirps": np.array([-1, -1]),
        "seen": np.zeros((N_CELLS, n_rx), np.complex64),
        "seen_snr": np.zeros(N_CELLS, np.float32),
    }


_DIMS: dict[str, tuple[str, ...]] = {
    "n_numbers": (),
    "mean": ("rx", "part"),
    "power": ("rx", "part"),
    "level": ("rx", "part", "end", "rank"),
    "count": ("rx", "part", "end", "rank"),
    "copy_of": ("rx",),
    "n_echoes": (),
    "echo_energy": ("side",),
    "mirrored": (),
    "image": ("rx",),
    "image_range": (),
    "lost": ("chirp",),
    "burst": ("chirp",),
    "burst_share": ("chirp",),
    "kurtosis": ("chirp",),
    "unlike": ("chirp",),
    "walk_velocity": (),
    "walk_range": (),
    "walk_chirps": ("end",),
    "seen": ("cell", "rx"),
    "seen_snr": ("cell",),
}
"""Axes of each measure beside `frame`."""


def measure_frame_quality(frame: xr.DataArray, radar: Radar) -> xr.Dataset:
    """Measure the quality of one frame; `QualityMeasurer` measures and joins several.

    Parameters
    ----------
    frame : DataArray (frame, chirp, rx, sample), complex64 or float32
        One frame, finite. A coordinate `gap` (frame, chirp) marks chirps to leave out.
    radar : Radar
        Determines the transmitter of each chirp, and the receiver positions.

    Returns
    -------
    Dataset
        Over `frame` (of size 1), `rx`, `chirp` and a few small axes; `attrs["units"]` is the
        cube's. About 20 bytes for each chirp and 1 kB for each frame.

    Notes
    -----
    It takes the time of 5 to 10 FFTs of the frame along its samples, at least 1 ms, and a few MB
    of memory, plus a copy of the frame if it is not contiguous or has lost chirps.
    """
    measurer = QualityMeasurer(radar)
    measurer.add_cube(frame)
    measures = measurer.joined_measures(frame.attrs.get("units", "1"))
    return measures if "frame" in frame.coords else measures.drop_vars("frame")


def _first_receiver_with_same_samples(
    statistics: SampleStatistics, samples: np.ndarray
) -> np.ndarray:
    """Return the first receiver with bit-identical samples, (rx,); -1 if there is none."""
    n_rx = samples.shape[1]
    copies = np.full(n_rx, -1)
    for k in range(1, n_rx):
        if statistics.constant_receiver_mask[k]:
            continue
        for first in range(k):
            same_sums = np.array_equal(statistics.mean[k], statistics.mean[first])
            if same_sums and np.array_equal(samples[:, k], samples[:, first]):
                copies[k] = first
                break
    return copies


def _has_doppler_peak(samples: np.ndarray, is_alive: np.ndarray, largest_value: float) -> bool:
    """Test if integration over chirps reveals an echo that the mean spectrum hides.

    The share of the largest of n cells of noise exceeds x with a probability of at most n (1 -
    x)^(n - 1) (Fisher 1929). Without windows, so that cells are independent; the cells of the ADC
    offset are left out.
    """
    for k in np.flatnonzero(is_alive):
        receiver_samples = samples[:, k] * np.float32(1 / largest_value)
        spectrum = scipy.fft.fft(receiver_samples, axis=1)
        spectrum = spectrum[
            :,
            1 : None if np.iscomplexobj(receiver_samples) else (receiver_samples.shape[1] + 1) // 2,
        ]
        power = np.abs(scipy.fft.fft(spectrum, axis=0)) ** 2
        total = float(power.sum(dtype=np.float64))
        if power.size < 2 or not total > 0:
            continue
        if power.max() > total * (
            1 - (_FALSE_ALARM_PROBABILITY / power.size) ** (1 / (power.size - 1))
        ):
            return True
    return False
