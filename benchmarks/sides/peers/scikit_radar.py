"""scikit-radar: echoes with constant range within a chirp and simultaneous transmitters."""

import numpy as np

from sides.job_types import Inputs, Timed

REQUIRES = ("scikit-radar==0.0.2",)


def echoes(x: Inputs) -> Timed:
    from skradar import FMCWRadar, Scene, Target

    n_tx, n_chirps = len(x["tx_m"]), len(x["starts_s"]) // len(x["tx_m"])
    n_samples, rate_hz = int(x["n_samples"]), float(x["sample_rate_hz"])
    duration_s = (n_samples - 1) / rate_hz
    bandwidth_hz = float(x["slope_hz_per_s"]) * duration_s
    first_s = float(x["starts_s"][0] + x["adc_start_s"])
    radar = FMCWRadar(
        B=bandwidth_hz,
        fc=float(x["start_frequency_hz"] + x["slope_hz_per_s"] * x["adc_start_s"]),
        N_f=n_samples,
        N_s=n_chirps,
        T_f=1 / rate_hz,
        T_s=float(x["starts_s"][n_tx] - x["starts_s"][0]),
        if_real=False,
        tx_pos=x["tx_m"].T,
        rx_pos=x["rx_m"].T,
        name="radar",
        pos=np.zeros((3, 1)),
    )
    position, velocity = x["path_m"][0] + first_s * x["path_m"][1], x["path_m"][1]
    targets = [
        Target(
            rcs=float(amplitude) ** 2,
            name=f"target {i}",
            pos=position[i][:, None],
            vel=velocity[i][:, None],
        )
        for i, amplitude in enumerate(x["amplitudes"])
    ]
    Scene([radar], targets)

    def samples() -> np.ndarray:
        radar.sim_chirps()
        # From (tx, rx, chirp, sample) to TDM order.
        by_chirp = np.moveaxis(radar.s_if, 2, 0)
        return by_chirp.reshape(n_chirps * n_tx, len(x["rx_m"]), n_samples)

    return samples
