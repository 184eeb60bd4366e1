"""Small radars and scenes that differ in what a law of the whole chain must not care about."""

import numpy as np
from hypothesis import strategies as st

import dechirp as dc
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.tdm import Tdm

HALF_WAVE_M = 1.94e-3
CODES = [None, Tdm(order=(1, 0)), Bpm(order=(0, 1)), Ddma(order=(0, 1), n_sub_bands=3)]
WINDOWS = ["rectangular", "hann", "blackman-harris", "chebyshev-60"]


def small(sampling="complex", code=None, *, n_samples=96, n_chirps=32, n_rx=3) -> dc.Radar:
    """77 GHz, 0.78 m a bin, arrays in the middle of which is the origin."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=30e-6,
        sample_rate_hz=10e6,
        n_samples=n_samples,
        sampling=sampling,
    )
    n_tx = 1 if code is None else code.n_tx
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp, n_chirps=n_chirps, interval_s=35e-6, multiplexing=code, period_s=0.02
        ),
        array=dc.Array(tx_m=in_a_row(n_tx, n_rx * HALF_WAVE_M), rx_m=in_a_row(n_rx, HALF_WAVE_M)),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def in_a_row(n: int, apart_m: float) -> list[tuple[float, float, float]]:
    """Places from right to left, the origin in their middle."""
    return [(0.0, apart_m * (k - (n - 1) / 2), 0.0) for k in range(n)]


def chain(window="hann", **changed) -> dc.Chain:
    """A detector whose ring fits into the maps of these radars, 15 dB over the noise."""
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=4, velocity=3),
        n_guard=dc.Cells(range=3, velocity=3),
        offset=30.0,
    )
    return dc.Chain(**{"range_window": window, "doppler_window": window, "cfar": cfar} | changed)


radars = st.builds(
    small, sampling=st.sampled_from(["complex", "real"]), code=st.sampled_from(CODES)
)


@st.composite
def targets(draw, radar: dc.Radar, n_most: int = 3) -> list[dc.Target]:
    """Targets within what the radar tells, ahead of it."""
    made = []
    for _ in range(draw(st.integers(1, n_most))):
        range_m = draw(st.floats(0.15, 0.85)) * radar.frame.chirp.max_range_m
        azimuth = draw(st.floats(-0.6, 0.6))
        away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        speed = draw(st.floats(-0.4, 0.4)) * radar.frame.max_velocity_m_per_s
        made.append(
            dc.Target(
                position_m=tuple(range_m * away),
                velocity_m_per_s=tuple(speed * away),
                rcs_m2=draw(st.floats(1.0, 30.0)),
            )
        )
    return made


def scenes(n_most: int = 3) -> st.SearchStrategy[tuple[dc.Radar, dc.Scene]]:
    """A radar, and a scene that it sees."""
    return radars.flatmap(
        lambda radar: st.tuples(
            st.just(radar), targets(radar, n_most).map(lambda made: dc.Scene(targets=made))
        )
    )


def echoes(scene: dc.Scene, radar: dc.Radar, **settings) -> np.ndarray:
    """Samples of the echoes alone, (frame, chirp, rx, sample), in double precision."""
    return dc.simulate(scene, radar, impairments=(), dtype=np.complex128, **settings).values
