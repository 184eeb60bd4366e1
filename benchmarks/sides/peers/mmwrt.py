"""mmWrt: echoes of equal amplitude at one antenna."""

from collections.abc import Callable

import numpy as np

from sides.job_types import Inputs, Timed

REQUIRES = ("mmWrt==0.0.14", "tqdm")


def echoes(x: Inputs) -> Timed:
    from mmWrt.Raytracing import rt_points
    from mmWrt.Scene import Radar, Receiver, Scatterer, Transmitter

    if len(x["tx_m"]) > 1:
        raise NotImplementedError("this adapter supports one antenna only")
    n_samples, rate_hz = int(x["n_samples"]), float(x["sample_rate_hz"])
    interval_s = float(x["starts_s"][1] - x["starts_s"][0])
    radar = Radar(
        transmitter=Transmitter(
            chirp_start_freq=float(x["start_frequency_hz"]),
            chirp_slope=float(x["slope_hz_per_s"]),
            chirp_end_time=n_samples / rate_hz,
            chirp_period=interval_s,
            chirp_count=len(x["starts_s"]),
        ),
        receiver=Receiver(
            adc_sample_rate=rate_hz,
            adc_sample_count=n_samples,
            adc_sample_count_max=2 * n_samples,
            adc_sample_rate_max=2 * rate_hz,
        ),
    )
    first_s = float(x["starts_s"][0])
    # mmWrt uses c = 3e8 m/s; scaled positions give the same delays.
    paths = np.swapaxes(x["path_m"], 0, 1) * (3e8 / 299_792_458.0)
    scatterers = [
        Scatterer(
            **{
                f"{axis}t": build_linear_path(p + first_s * v, v)
                for axis, p, v in zip("xyz", *path, strict=True)
            }
        )
        for path in paths
    ]

    def samples() -> np.ndarray:
        cube = rt_points([radar], scatterers, radar, datatype=np.complex64, compute=True)
        return cube["adc_cube"].reshape(len(x["starts_s"]), 1, n_samples)

    return samples


def build_linear_path(start_m: float, velocity: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: start_m + velocity * t
