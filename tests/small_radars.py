"""Small radars and random scenes for properties that hold for every chain."""

import numpy as np
from hypothesis import strategies as st

import dechirp as dc
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.tdm import Tdm

HALF_WAVELENGTH_M = 1.94e-3
CODES = [None, Tdm(order=(1, 0)), Bpm(order=(0, 1)), Ddma(order=(0, 1), n_sub_bands=3)]
WINDOWS = ["rectangular", "hann", "blackman-harris", "chebyshev-60"]


def small_radar(sampling="complex", code=None, *, n_samples=96, n_chirps=32, n_rx=3) -> dc.Radar:
    """Return a 77 GHz radar with 0.78 m a bin and arrays centred at the origin."""
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
        array=dc.Array(
            tx_m=row_positions_m(n_tx, n_rx * HALF_WAVELENGTH_M),
            rx_m=row_positions_m(n_rx, HALF_WAVELENGTH_M),
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def row_positions_m(n: int, spacing_m: float) -> list[tuple[float, float, float]]:
    """Return positions in a row from right to left, centred at the origin."""
    return [(0.0, spacing_m * (k - (n - 1) / 2), 0.0) for k in range(n)]


def small_chain(window="hann", **changes) -> dc.Chain:
    """Return a chain with a training window that fits these maps, 15 dB above the noise."""
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=4, velocity=3),
        n_guard=dc.Cells(range=3, velocity=3),
        offset=30.0,
    )
    return dc.Chain(**{"range_window": window, "doppler_window": window, "cfar": cfar} | changes)


radar_strategy = st.builds(
    small_radar, sampling=st.sampled_from(["complex", "real"]), code=st.sampled_from(CODES)
)


@st.composite
def draw_targets(draw, radar: dc.Radar, max_targets: int = 3) -> list[dc.Target]:
    """Draw targets ahead of the radar, within its unambiguous ranges and velocities."""
    drawn_targets = []
    for _ in range(draw(st.integers(1, max_targets))):
        range_m = draw(st.floats(0.15, 0.85)) * radar.frame.chirp.max_range_m
        azimuth = draw(st.floats(-0.6, 0.6))
        direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        speed = draw(st.floats(-0.4, 0.4)) * radar.frame.max_velocity_m_per_s
        drawn_targets.append(
            dc.Target(
                position_m=tuple(range_m * direction),
                velocity_m_per_s=tuple(speed * direction),
                rcs_m2=draw(st.floats(1.0, 30.0)),
            )
        )
    return drawn_targets


def scene_strategy(max_targets: int = 3) -> st.SearchStrategy[tuple[dc.Radar, dc.Scene]]:
    """Return a strategy of a radar and a scene within its unambiguous region."""
    return radar_strategy.flatmap(
        lambda radar: st.tuples(
            st.just(radar),
            draw_targets(radar, max_targets).map(lambda drawn: dc.Scene(targets=drawn)),
        )
    )


def simulate_echoes(scene: dc.Scene, radar: dc.Radar, **settings) -> np.ndarray:
    """Simulate echoes without impairments, (frame, chirp, rx, sample), in double precision."""
    return dc.simulate(scene, radar, impairments=(), dtype=np.complex128, **settings).values
