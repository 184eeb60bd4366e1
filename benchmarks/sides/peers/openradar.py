"""OpenRadar (mmwave): maps, beams, Capon and DCA1000 samples; it declares no requirements."""

import numpy as np

from sides.job_types import Inputs, Timed
from sides.spectra import directions

REQUIRES = ("openradar==1.0.1", "numpy", "scipy", "scikit-learn", "matplotlib")


def power_map(x: Inputs) -> Timed:
    from mmwave.dsp import doppler_processing, range_processing
    from mmwave.dsp.utils import Window

    samples = x["samples"]
    n_zeros = int(x["n_bins"]) - samples.shape[1]

    def power() -> np.ndarray:
        # OpenRadar applies a window to the whole input, so window and zero padding come first.
        tapered = samples * np.hanning(samples.shape[1]).astype(np.float32)
        padded = np.pad(tapered, ((0, 0), (0, n_zeros)))[:, None]
        ranges = range_processing(padded)
        logarithm, _ = doppler_processing(
            ranges, num_tx_antennas=1, interleaved=False, window_type_2d=Window.HANNING
        )
        return np.fft.fftshift(np.exp2(2 * logarithm), axes=1).T

    return power


def bartlett(x: Inputs) -> Timed:
    from mmwave.dsp import aoa_bartlett

    return lambda: aoa_bartlett(x["steering"], x["snapshots"].T, axis=0).T


def capon(x: Inputs) -> Timed:
    """Build the Capon call with diagonal loading; the covariance of one snapshot is singular."""
    from mmwave.dsp import aoa_capon

    n_elements = x["snapshots"].shape[1]
    load = np.sqrt(x["load"]) * np.eye(n_elements, dtype=np.complex64)

    def azimuths() -> np.ndarray:
        spectra = [
            aoa_capon(np.column_stack([snapshot, load]), x["steering"], magnitude=True)[0]
            for snapshot in x["snapshots"]
        ]
        return directions(np.array(spectra), x["sines"])

    return azimuths


def decode(x: Inputs) -> Timed:
    from mmwave.dataloader import DCA1000

    return lambda: DCA1000.organize(x["codes"], *x["shape"].tolist())
