"""Quality measures of a frame of samples; `findings` evaluates them."""

import numpy as np
import scipy.fft
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.processing.quality.beat_spectrum import (
    SpectrumSides,
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
from dechirp.radar.radar import Radar

_FALSE_ALARM_PROBABILITY = 1e-9  # false-alarm probability of a range-Doppler map of noise


def measure_frame_quality(frame: xr.DataArray, radar: Radar) -> xr.Dataset:
    """Measure the quality of one frame; concatenate results along `frame` for evaluation.

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
    It takes the time of 5 to 10 FFTs of the frame along its samples, at least 1.5 ms, and a few MB
    of memory, plus a copy of the frame if it is not contiguous or has lost chirps.
    """
    cube = frame.transpose(*CUBE_AXES)
    is_complex = np.iscomplexobj(cube.values)
    samples = np.ascontiguousarray(cube.values[0], np.complex64 if is_complex else np.float32)
    n_chirps, n_rx, _ = samples.shape
    is_lost = np.zeros(n_chirps, bool)
    if "gap" in cube.coords:
        is_lost = np.asarray(cube["gap"].values, bool).reshape(n_chirps).copy()
    n_parts = 2 if is_complex else 1
    statistics = compute_sample_statistics(samples.view(np.float32), is_lost, n_parts)
    is_silent = statistics.largest_part_magnitude < SILENT
    scale = 1.0 if is_silent else statistics.largest_part_magnitude
    is_alive = ~statistics.constant_receiver_mask & (not is_silent)
    kept_samples = samples[~is_lost] if is_lost.any() else samples
    n_slots = radar.frame.n_slots
    spectrum = mean_spectrum_and_mirror_products(samples, is_lost, scale)
    sides = measure_echoes_and_mirror_images(spectrum, is_alive)
    n_echoes = sides.n_echoes
    if n_echoes == 0 and _has_doppler_peak(kept_samples, is_alive, scale):
        n_echoes = 1.0
    bursts = measure_bursts(
        samples, is_lost, n_slots=n_slots, largest_value=scale, adc_step=statistics.step
    )
    outlier_excess = measure_outlier_chirp_excess(
        samples, is_lost, n_slots=n_slots, largest_value=scale, adc_step=statistics.step
    )
    # Approximate for lists of intervals.
    ghost = find_ghost_track(samples, is_lost, radar.for_frame(0).frame, scale)
    cells, snr = np.zeros((N_CELLS, n_rx), np.complex64), np.zeros(N_CELLS, np.float32)
    if (
        is_alive.all()
        and len(radar.array.rx_m) == n_rx
        and find_receiver_order_on_line(radar.array) is not None
    ):
        cells, snr = strongest_echo_snapshots_and_snr(
            samples, is_lost, spectrum, n_slots=n_slots, largest_value=scale
        )
    measures = {
        **_receiver_statistics_as_variables(statistics, kept_samples),
        **_beat_spectrum_measures_as_variables(sides, n_echoes, radar),
        "lost": (("chirp",), is_lost),
        "burst": (("chirp",), bursts.excess),
        "burst_share": (("chirp",), bursts.share),
        "kurtosis": (("chirp",), bursts.kurtosis),
        "unlike": (("chirp",), outlier_excess),
        "walk_velocity": ((), ghost.velocity_m_per_s),
        "walk_range": ((), ghost.range_m),
        "walk_chirps": (("end",), np.array([ghost.first_chirp, ghost.last_chirp])),
        "seen": (("cell", "rx"), cells),
        "seen_snr": (("cell",), snr),
    }
    variables = {
        name: (("frame", *dims), np.asarray(values)[None])
        for name, (dims, values) in measures.items()
    }
    coords = {name: cube.coords[name].variable for name in ("frame",) if name in cube.coords}
    attrs = {"units": cube.attrs.get("units", "full scale"), "is_complex": int(is_complex)}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _receiver_statistics_as_variables(
    statistics: SampleStatistics, samples: np.ndarray
) -> dict[str, tuple[tuple[str, ...], object]]:
    return {
        "n_numbers": ((), statistics.n_numbers),
        "mean": (("rx", "part"), statistics.mean),
        "power": (("rx", "part"), statistics.power),
        "level": (("rx", "part", "end", "rank"), statistics.level),
        "count": (("rx", "part", "end", "rank"), statistics.count),
        "copy_of": (("rx",), _first_receiver_with_same_samples(statistics, samples)),
    }


def _beat_spectrum_measures_as_variables(
    sides: SpectrumSides, n_echoes: float, radar: Radar
) -> dict[str, tuple[tuple[str, ...], object]]:
    n_samples = radar.frame.chirp.n_samples
    return {
        "n_echoes": ((), n_echoes),
        "echo_energy": (("side",), sides.echo_energy),
        "mirrored": ((), sides.mirror_similarity),
        "image": (("rx",), sides.image_level),
        "image_range": (
            (),
            radar.frame.chirp.range_m(radar.frame.chirp.sample_rate_hz)
            * sides.strongest_bin
            / n_samples,
        ),
    }


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
