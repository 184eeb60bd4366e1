"""Small numbers that tell the health of a frame of samples; `findings` judges them."""

import numpy as np
import scipy.fft
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.process.health.beats import Beats, beats, mean_spectrum
from dechirp.process.health.bursts import bursts
from dechirp.process.health.receiver_order import N_CELLS, line, strongest_cells
from dechirp.process.health.survey import SILENT, Survey, survey
from dechirp.process.health.unlike import unlike
from dechirp.process.health.walks import walk
from dechirp.radar.radar import Radar

_CHANCE = 1e-9  # that noise alone makes a cell of the range-Doppler map stand out


def measure(frame: xr.DataArray, radar: Radar) -> xr.Dataset:
    """Measure one frame, to be concatenated with others along `frame` and judged.

    Parameters
    ----------
    frame : DataArray (frame, chirp, rx, sample), complex64 or float32
        One frame, finite. A coordinate `gap` (frame, chirp) marks chirps to leave out.
    radar : Radar
        Says which chirps have the same transmitter, and where receivers are.

    Returns
    -------
    Dataset
        Over `frame` (of size 1), `rx`, `chirp` and a few small axes; `attrs["units"]` is the
        cube's. About 20 bytes for each chirp and 1 kB for each frame.

    Notes
    -----
    Takes the time of 5 to 10 FFTs of the frame along its samples, 1.5 ms at the least, and a
    few MB of memory; a copy of the frame more if it is not contiguous or has lost chirps.
    """
    cube = frame.transpose(*CUBE_AXES)
    is_complex = np.iscomplexobj(cube.values)
    samples = np.ascontiguousarray(cube.values[0], np.complex64 if is_complex else np.float32)
    n_chirps, n_rx, _ = samples.shape
    lost = np.zeros(n_chirps, bool)
    if "gap" in cube.coords:
        lost = np.asarray(cube["gap"].values, bool).reshape(n_chirps).copy()
    n_parts = 2 if is_complex else 1
    surveyed = survey(samples.view(np.float32), lost, n_parts)
    is_silent = surveyed.largest < SILENT
    scale = 1.0 if is_silent else surveyed.largest
    alive = ~surveyed.constant & (not is_silent)
    kept = samples[~lost] if lost.any() else samples
    n_slots = radar.frame.n_slots
    spectrum = mean_spectrum(samples, lost, scale)
    told = beats(spectrum, alive)
    n_echoes = told.n_echoes
    if n_echoes == 0 and _stands_out_in_velocity(kept, alive, scale):
        n_echoes = 1.0
    of_chirps = bursts(samples, lost, n_slots=n_slots, scale=scale, step=surveyed.step)
    odd = unlike(samples, lost, n_slots=n_slots, scale=scale, step=surveyed.step)
    walks = walk(samples, lost, radar.at(0).frame, scale)  # of intervals in turn, about
    seen, snr = np.zeros((N_CELLS, n_rx), np.complex64), np.zeros(N_CELLS, np.float32)
    if alive.all() and len(radar.array.rx_m) == n_rx and line(radar.array) is not None:
        seen, snr = strongest_cells(samples, lost, spectrum, n_slots=n_slots, scale=scale)
    over = {
        **_of_receivers(surveyed, kept),
        **_of_beats(told, n_echoes, radar),
        "lost": (("chirp",), lost),
        "burst": (("chirp",), of_chirps.excess),
        "burst_share": (("chirp",), of_chirps.share),
        "kurtosis": (("chirp",), of_chirps.kurtosis),
        "unlike": (("chirp",), odd),
        "walk_velocity": ((), walks.velocity_m_per_s),
        "walk_range": ((), walks.range_m),
        "walk_chirps": (("end",), np.array([walks.first, walks.last])),
        "seen": (("cell", "rx"), seen),
        "seen_snr": (("cell",), snr),
    }
    variables = {
        name: (("frame", *dims), np.asarray(values)[None]) for name, (dims, values) in over.items()
    }
    coords = {name: cube.coords[name].variable for name in ("frame",) if name in cube.coords}
    attrs = {"units": cube.attrs.get("units", "full scale"), "is_complex": int(is_complex)}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _of_receivers(surveyed: Survey, kept: np.ndarray) -> dict[str, tuple[tuple[str, ...], object]]:
    return {
        "n_numbers": ((), surveyed.n_numbers),
        "mean": (("rx", "part"), surveyed.mean),
        "power": (("rx", "part"), surveyed.power),
        "level": (("rx", "part", "end", "rank"), surveyed.level),
        "count": (("rx", "part", "end", "rank"), surveyed.count),
        "copy_of": (("rx",), _copies(surveyed, kept)),
    }


def _of_beats(
    told: Beats, n_echoes: float, radar: Radar
) -> dict[str, tuple[tuple[str, ...], object]]:
    n_samples = radar.frame.chirp.n_samples
    return {
        "n_echoes": ((), n_echoes),
        "echo_energy": (("side",), told.echo_energy),
        "mirrored": ((), told.mirrored),
        "image": (("rx",), told.image),
        "image_range": (
            (),
            radar.frame.chirp.range_m(radar.frame.chirp.sample_rate_hz)
            * told.strongest_bin
            / n_samples,
        ),
    }


def _copies(surveyed: Survey, samples: np.ndarray) -> np.ndarray:
    """First receiver with the same samples to the bit, (rx,); -1 if there is none."""
    n_rx = samples.shape[1]
    copies = np.full(n_rx, -1)
    for k in range(1, n_rx):
        if surveyed.constant[k]:
            continue
        for first in range(k):
            same_sums = np.array_equal(surveyed.mean[k], surveyed.mean[first])
            if same_sums and np.array_equal(samples[:, k], samples[:, first]):
                copies[k] = first
                break
    return copies


def _stands_out_in_velocity(samples: np.ndarray, alive: np.ndarray, scale: float) -> bool:
    """Whether integration over chirps shows an echo that the mean spectrum hides.

    The share of the largest of n cells of noise exceeds x with a chance of n (1 - x)^(n - 1)
    at most (Fisher 1929). Without windows, so that cells are independent; the cells of the
    converter's offset are left out.
    """
    for k in np.flatnonzero(alive):
        of_rx = samples[:, k] * np.float32(1 / scale)
        spectrum = scipy.fft.fft(of_rx, axis=1)
        spectrum = spectrum[:, 1 : None if np.iscomplexobj(of_rx) else (of_rx.shape[1] + 1) // 2]
        power = np.abs(scipy.fft.fft(spectrum, axis=0)) ** 2
        total = float(power.sum(dtype=np.float64))
        if power.size < 2 or not total > 0:
            continue
        if power.max() > total * (1 - (_CHANCE / power.size) ** (1 / (power.size - 1))):
            return True
    return False
