"""Small radars for tests, quick to simulate and to process."""

import dechirp as dc

REFERENCE_FRAME = dc.Frame(
    chirp=dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=150e6 / (22e-6 / 3),
        ramp_duration_s=22e-6 / 3,
        sample_rate_hz=300e6,
        n_samples=2200,
        sampling="complex",
    ),
    n_chirps=128,
    interval_s=22e-6 / 3,
)
"""The waveform of the reference report: 150 MHz in 7.3 us, to 1.1 km and 133 m/s."""

SHORT_CHIRP = dc.Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    adc_start_s=2e-6,
    ramp_duration_s=12e-6,
    sample_rate_hz=10e6,
    n_samples=80,
    sampling="complex",
)
"""240 MHz in 8 us, with time before the first sample and after the last."""


def street_radar(
    *, n_samples: int, n_chirps: int, n_rx: int = 2, sampling: str = "complex", **frame: float
) -> dc.Radar:
    """Return a 77 GHz radar to 75 m and 27 m/s, with receivers half a wavelength apart."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=n_chirps, **({"interval_s": 35e-6} | frame)),
        array=dc.Array(rx_m=[(0, 1.9e-3 * k, 0) for k in range(n_rx)]),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def eight_receiver_radar(period_s: float | None = None) -> dc.Radar:
    """Return a 77 GHz radar with cells of 0.6 m and 1.5 m/s and a uniform linear array."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        ramp_duration_s=20e-6,
        sample_rate_hz=10e6,
        n_samples=128,
        sampling="complex",
    )
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=64, interval_s=20e-6, period_s=period_s),
        array=dc.Array(rx_m=[(0, k * 0.00193, 0) for k in range(8)]),
        hardware=dc.Hardware(transmit_power_w=0.01, antenna_gain=100.0, noise_factor=10.0),
    )
