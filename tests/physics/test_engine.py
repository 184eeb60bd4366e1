"""Simulation kernels: equal cubes, tolerances, threads, late echoes, fluctuation and cost model."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.threads import limit_threads
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.simulation.echo_groups import direct_echo_groups
from dechirp.simulation.kernels.selection import choose_kernel_and_predict_times

KERNELS = ("direct", "low-rank", "nufft")


def simulate_clean(scene, radar, **kwargs):
    return dc.simulate(scene, radar, impairments=(), **kwargs).values


def relative_error(value, exact):
    """Return the rms difference relative to the rms of the echoes."""
    return np.linalg.norm(value - exact) / np.linalg.norm(exact)


def make_crowd(n, seed, **kwargs):
    """Return a scene of random targets in the field of view, at up to 40 m/s."""
    rng = np.random.default_rng(seed)
    range_m, azimuth = rng.uniform(1.0, 60.0, n), rng.uniform(-1.2, 1.2, n)
    return dc.Scene(
        targets=[
            dc.Target(
                position_m=(r * np.cos(a), r * np.sin(a), z),
                velocity_m_per_s=velocity,
                rcs_m2=rcs,
                **kwargs,
            )
            for r, a, z, velocity, rcs in zip(
                range_m,
                azimuth,
                rng.uniform(-1, 2, n),
                rng.uniform(-40, 40, (n, 3)) * [1, 0.5, 0.02],
                rng.exponential(size=n) + 1e-3,
                strict=True,
            )
        ],
    )


# Some targets at 40 m/s or 1 m are aliased or arrive early; kernels are not affected.
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("n", [1, 7, 60])
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_yields_same_echoes(radar, kernel, n):
    scene = make_crowd(n, seed=n)
    exact = simulate_clean(scene, radar, dtype=np.complex128)
    assert (
        relative_error(simulate_clean(scene, radar, engine=dc.Engine(kernel=kernel)), exact) < 1e-5
    )


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_superposes_simultaneous_transmitters(radar, kernel):
    array = replace(radar.array, tx_m=[(0, 0.0078 * k, 0.001 * k) for k in range(3)])
    frame = replace(
        radar.frame, multiplexing=dc.multiplexing.Ddma(order=(1, 0, 2), n_sub_bands=4), n_chirps=8
    )
    radar, scene = replace(radar, frame=frame, array=array), make_crowd(20, seed=3)

    exact = simulate_clean(scene, radar, dtype=np.complex128)
    assert (
        relative_error(simulate_clean(scene, radar, engine=dc.Engine(kernel=kernel)), exact) < 1e-5
    )
    # The expected cube superposes single transmitters with their weights.
    total = 0
    for k, weights in enumerate(frame.chirp_weights().T):
        single_transmitter_radar = replace(
            radar,
            frame=replace(frame, multiplexing=None, n_chirps=frame.n_chirps_total),
            array=replace(array, tx_m=array.tx_m[k : k + 1]),
        )
        total = total + weights[:, None, None] * simulate_clean(
            scene, single_transmitter_radar, dtype=np.complex128
        )
    np.testing.assert_allclose(exact, total, atol=1e-9 * abs(exact).max())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_number_of_threads_does_not_change_echoes(radar, kernel, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    scene, engine = make_crowd(50, seed=5), dc.Engine(kernel=kernel)
    parallel = simulate_clean(scene, radar, engine=engine)
    with limit_threads(1):
        serial = simulate_clean(scene, radar, engine=engine)
    assert relative_error(parallel, serial) < 1e-5


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_second_frame_equals_single_frame_of_moved_scene(radar):
    periodic_frame = replace(radar.frame, period_s=0.02)
    scene = make_crowd(5, seed=6)
    two_frames = simulate_clean(
        scene, replace(radar, frame=periodic_frame), n_frames=2, dtype=np.complex128
    )
    moved_scene = dc.Scene(
        targets=[
            replace(t, position_m=np.add(t.position_m, np.multiply(0.02, t.velocity_m_per_s)))
            for t in scene.targets
        ]
    )
    second = simulate_clean(moved_scene, radar, dtype=np.complex128)
    # Positions are rounded to 1e-14 m, 5e-11 cycles.
    np.testing.assert_allclose(two_frames[1], second[0], atol=1e-9 * abs(second).max())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_kernel_error_stays_below_tolerance(radar):
    scene = make_crowd(40, seed=7)
    exact = simulate_clean(scene, radar, dtype=np.complex128)
    for kernel, tolerance in (("low-rank", 1e-6), ("nufft", 2e-6)):
        engine = dc.Engine(kernel=kernel, tolerance=tolerance)
        assert (
            relative_error(simulate_clean(scene, radar, engine=engine, dtype=np.complex128), exact)
            < tolerance
        )


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_echo_power_follows_radar_equation(radar):
    hardware = dc.Hardware(
        transmit_power_w=0.01,
        tx_pattern=dc.patterns.Cosine(
            azimuth_beamwidth_rad=0.6, elevation_beamwidth_rad=0.2, beam_azimuth_rad=0.1
        ),
        antenna_gain=20.0,
        noise_factor=10.0,
        loss=1.3,
    )
    radar = replace(radar, hardware=hardware)
    azimuth, elevation, range_m = 0.3, 0.05, 30.0
    position_m = range_m * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    target = dc.Target(position_m=position_m, rcs_m2=2.0)
    echo_w = np.mean(abs(simulate_clean(dc.Scene(targets=[target]), radar)) ** 2)

    wavelength_m = radar.frame.chirp.wavelength_m
    gain = hardware.tx_pattern.gain_towards(azimuth, elevation) * 20.0
    expected_w = 0.01 * gain * wavelength_m**2 * 2.0 / ((4 * np.pi) ** 3 * range_m**4 * 1.3)
    # The documented accuracy is 0.01 dB; the array width of 1 cm adds 0.003 dB at 30 m.
    assert 10 * np.log10(echo_w / expected_w) == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(
    ("case", "n_draws"),
    [("swerling-1", 1), ("swerling-2", 64), ("swerling-3", 1), ("swerling-4", 64)],
)
def test_echoes_fluctuate_by_frame_or_by_chirp(radar, case, n_draws):
    radar = replace(radar, frame=replace(radar.frame, n_chirps=64))
    target = dc.Target(position_m=(20, 0, 0), rcs_m2=1.0)
    steady_w = np.mean(abs(simulate_clean(dc.Scene(targets=[target]), radar)) ** 2)
    scene = dc.Scene(targets=[replace(target, fluctuation=case)])
    cube = simulate_clean(scene, radar, n_frames=4, seed=8)
    ratio = np.mean(abs(cube) ** 2, axis=(2, 3)) / steady_w  # (frame, chirp)

    relative_spread = np.ptp(ratio, axis=1) / ratio.mean(axis=1)
    assert (relative_spread < 1e-3).all() if n_draws == 1 else (relative_spread > 0.5).all()
    assert np.ptp(ratio.mean(axis=1)) > 1e-3


def make_late_scene(radar):
    """Return a scene whose echo arrives between two samples, 5.4 samples after the ramp start."""
    chirp = radar.frame.chirp
    delay_s = chirp.adc_start_s + 5.4 / chirp.sample_rate_hz
    return dc.Scene(targets=[dc.Target(position_m=(delay_s * 299792458.0 / 2, 0, 0))])


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_onset_mode_starts_echo_at_its_arrival(radar):
    scene = make_late_scene(radar)
    default = simulate_clean(scene, radar)
    onset = simulate_clean(scene, radar, engine=dc.Engine(late="onset"))
    reference_rx = (
        radar.array.rx_m.index((0.0, 0.0, 0.0)) if (0.0, 0.0, 0.0) in radar.array.rx_m else 0
    )
    assert (onset[0, :, reference_rx, :6] == 0).all()
    np.testing.assert_allclose(onset[..., 7:], default[..., 7:], rtol=1e-4)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_tail_mode_adds_previous_echo_to_next_chirp(radar):
    # Ramps follow without a pause, so echoes last into the next ramp.
    chirp = radar.frame.chirp
    frame = replace(radar.frame, interval_s=chirp.ramp_duration_s, n_chirps=4)
    radar = replace(radar, frame=frame)
    scene = make_late_scene(radar)
    onset = simulate_clean(scene, radar, engine=dc.Engine(late="onset"))
    tail = simulate_clean(scene, radar, engine=dc.Engine(late="tail"))

    differs = abs(tail - onset).max(axis=(2, 3))[0] > 0
    assert differs.tolist() == [False, True, True, True]
    assert (tail[0, :, :, 8:] == onset[0, :, :, 8:]).all()
    # The tail is as strong as the echo.
    np.testing.assert_allclose(abs(tail[0, 1, 0, :5]), abs(onset[0, 1, 0, 8]), rtol=1e-3)


@frozen_dataclass
class NonfiniteBody(Body):
    """Represent a body with non-finite positions."""

    def scatterer_offsets_m(self, times_s):
        return np.full((len(times_s), 2, 3), np.nan)

    def cross_sections_m2(self):
        return np.ones(2)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_rejects_body_with_nonfinite_positions(radar):
    scene = dc.Scene(targets=[dc.Target(name="ghost", position_m=(20, 0, 0), body=NonfiniteBody())])
    with pytest.raises(dc.InvalidSetting, match="ghost"):
        simulate_clean(scene, radar)


@pytest.mark.parametrize(
    ("settings", "setting"),
    [
        ({"kernel": "fastest"}, "Engine.kernel"),
        ({"late": "never"}, "Engine.late"),
        ({"kernel": np.array(["direct", "low-rank"])}, "Engine.kernel"),
        ({"tolerance": 0.0}, "Engine.tolerance"),
        ({"tolerance": float("nan")}, "Engine.tolerance"),
        ({"kernel": "nufft", "tolerance": 1e-8}, "Engine.tolerance"),
    ],
)
def test_rejects_invalid_engine(settings, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        dc.Engine(**settings)


def test_nufft_kernel_rejects_fluctuation_by_chirp(radar):
    target = dc.Target(position_m=(20, 0, 0), fluctuation="swerling-2")
    with pytest.raises(dc.InvalidSetting, match="fluctuate"):
        simulate_clean(dc.Scene(targets=[target]), radar, engine=dc.Engine(kernel="nufft"))


def test_rejects_simulation_larger_than_memory(radar):
    frame = replace(radar.frame, n_chirps=2_000_000)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    with pytest.raises(dc.NotEnoughMemory, match="simulation"):
        simulate_clean(scene, replace(radar, frame=frame))


def chosen_kernels_and_times(scene, radar, kernel="auto", dtype=np.complex64):
    """Return the kernel of each run of chirps of the first frame, and the times of all kernels."""
    return [
        choose_kernel_and_predict_times(
            (len(group.transmission.starts_s), radar.array.n_rx, radar.frame.chirp.n_samples),
            group.scatterers,
            group.transmission,
            dc.Engine(kernel=kernel),
            np.dtype(dtype),
        )
        for group in direct_echo_groups(scene, radar, 0, np.random.default_rng(0))
    ]


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_cost_model_selects_cheapest_kernel_unless_overridden(radar):
    ((kernel, costs_s),) = chosen_kernels_and_times(make_crowd(1, seed=9), radar)
    assert kernel == costs_s.cheapest_kernel
    crowd = make_crowd(2000, seed=10)
    ((kernel, _),) = chosen_kernels_and_times(crowd, radar)
    assert kernel == "nufft"
    assert dc.simulate(crowd, radar).attrs["kernels"] == "nufft"
    ((kernel, _),) = chosen_kernels_and_times(crowd, radar, kernel="direct")
    assert kernel == "direct"
    ((kernel, _),) = chosen_kernels_and_times(crowd, radar, dtype=np.complex128)
    assert kernel == "direct"


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_cost_model_includes_direct_share_of_low_rank_kernel(radar):
    scene = make_crowd(60, seed=11)
    ((kernel, _),) = chosen_kernels_and_times(scene, radar)
    assert kernel == "low-rank"
    # Some targets move by a fifth of their range within a chirp of 6.4 ms.
    chirp = replace(
        radar.frame.chirp, slope_hz_per_s=20e9, ramp_duration_s=8e-3, sample_rate_hz=40e3
    )
    frame = replace(radar.frame, chirp=chirp, interval_s=9e-3, n_chirps=8)
    slow_chirp_runs = chosen_kernels_and_times(scene, replace(radar, frame=frame))
    assert {kernel for kernel, _ in slow_chirp_runs} == {"nufft"}
    assert all(costs_s.low_rank > costs_s.direct / 2 for _, costs_s in slow_chirp_runs)
