"""xwr: range-Doppler maps with FFTW, cell-averaging CFAR by convolution."""

from typing import Any

import numpy as np

from sides.job_types import Inputs, Timed

REQUIRES = ("xwr==0.5.1",)


def power_map(x: Inputs) -> Timed:
    from xwr.rsp.numpy import AWR1843Boost

    samples, n_bins = x["samples"][None, :, None, None, :], int(x["n_bins"])
    rsp = AWR1843Boost(window=True, size={"range": n_bins})

    def power() -> np.ndarray:
        spectrum = rsp.doppler_range(samples)[0, :, 0, 0]
        return spectrum.real**2 + spectrum.imag**2

    return power


def build_detector(x: Inputs, factor: np.ndarray) -> Any:
    from xwr.rsp.numpy import CACFAR

    (train_v, train_r), (guard_v, guard_r) = x["n_training"].tolist(), x["n_guard"].tolist()
    return CACFAR(
        guard=(guard_r, guard_v),
        train=(train_r, train_v),
        snr_thresh=float(factor),
        discard_range=(0, 0),
    )


def cell_averaging(x: Inputs) -> Timed:
    # xwr expects amplitudes and adds 1 to each power; a noise power of 1e6 makes this negligible.
    amplitudes = 1e3 * np.sqrt(x["power"])[:, :, None, None, :]
    cfar = build_detector(x, x["mean_factor"])
    return lambda: np.swapaxes(cfar(amplitudes).mask, 1, 2)


def frame(x: Inputs) -> Timed:
    from xwr.rsp.numpy import AWR1843Boost

    n_tx, n_rx, n_chirps, n_samples = x["sizes"].tolist()
    samples = x["samples"].reshape(1, n_chirps, n_tx, n_rx, n_samples)
    rsp, cfar = AWR1843Boost(window=True), build_detector(x, x["mean_factor"])

    def mask() -> np.ndarray:
        return cfar(abs(rsp.doppler_range(samples))).mask[0].T

    return mask
