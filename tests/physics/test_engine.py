"""One cube, whichever kernel sums it: tolerances, threads, late echoes, patterns, fluctuation."""

from dataclasses import replace

import numba
import numpy as np
import pytest

import dechirp as dc
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.simulation.simulate import plan_kernels

KERNELS = ("direct", "low-rank", "nufft")


def clean(scene, radar, **kwargs):
    return dc.simulate(scene, radar, impairments=(), **kwargs).values


def error(value, exact):
    """Root mean square of the difference over that of the echoes."""
    return np.linalg.norm(value - exact) / np.linalg.norm(exact)


def crowd(n, seed, **kwargs):
    """Targets all over the field of view of the radar of these tests, up to 40 m/s fast."""
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


# Some of 40 m/s and 1 m fold or come early; the kernels do not mind.
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("n", [1, 7, 60])
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_sums_the_same_echoes(radar, kernel, n):
    scene = crowd(n, seed=n)
    exact = clean(scene, radar, dtype=np.complex128)
    assert error(clean(scene, radar, engine=dc.Engine(kernel=kernel)), exact) < 1e-5


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_adds_up_transmitters_that_send_together(radar, kernel):
    array = replace(radar.array, tx_m=[(0, 0.0078 * k, 0.001 * k) for k in range(3)])
    frame = replace(
        radar.frame, multiplexing=dc.multiplexing.Ddma(order=(1, 0, 2), n_sub_bands=4), n_chirps=8
    )
    radar, scene = replace(radar, frame=frame, array=array), crowd(20, seed=3)

    exact = clean(scene, radar, dtype=np.complex128)
    assert error(clean(scene, radar, engine=dc.Engine(kernel=kernel)), exact) < 1e-5
    # Each transmitter alone, with its own weight: superposition.
    total = 0
    for k, weights in enumerate(frame.chirp_weights().T):
        alone = replace(
            radar,
            frame=replace(frame, multiplexing=None, n_chirps=frame.n_chirps_total),
            array=replace(array, tx_m=array.tx_m[k : k + 1]),
        )
        total = total + weights[:, None, None] * clean(scene, alone, dtype=np.complex128)
    np.testing.assert_allclose(exact, total, atol=1e-9 * abs(exact).max())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_nothing_depends_on_the_number_of_threads(radar, kernel, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    scene, engine = crowd(50, seed=5), dc.Engine(kernel=kernel)
    many = clean(scene, radar, engine=engine)
    n_threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = clean(scene, radar, engine=engine)
    finally:
        numba.set_num_threads(n_threads)
    assert error(many, one) < 1e-5


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_a_frame_alone_is_the_same_as_in_a_row(radar):
    later = replace(radar.frame, period_s=0.02)
    scene = crowd(5, seed=6)
    both = clean(scene, replace(radar, frame=later), n_frames=2, dtype=np.complex128)
    moved = dc.Scene(
        targets=[
            replace(t, position_m=np.add(t.position_m, np.multiply(0.02, t.velocity_m_per_s)))
            for t in scene.targets
        ]
    )
    second = clean(moved, radar, dtype=np.complex128)
    # The position is rounded to 1e-14 m, 5e-11 of a turn.
    np.testing.assert_allclose(both[1], second[0], atol=1e-9 * abs(second).max())


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_finer_tolerances_are_kept(radar):
    scene = crowd(40, seed=7)
    exact = clean(scene, radar, dtype=np.complex128)
    for kernel, tolerance in (("low-rank", 1e-6), ("nufft", 2e-6)):
        engine = dc.Engine(kernel=kernel, tolerance=tolerance)
        assert error(clean(scene, radar, engine=engine, dtype=np.complex128), exact) < tolerance


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_the_power_of_an_echo_is_that_of_the_radar_equation(radar):
    hardware = dc.Hardware(
        transmit_power_w=0.01,
        tx_pattern=dc.patterns.CosinePattern(
            azimuth_beamwidth_rad=0.6, elevation_beamwidth_rad=0.2, beam_azimuth_rad=0.1
        ),
        antenna_gain=20.0,
        noise_factor=10.0,
        loss=1.3,
    )
    radar = replace(radar, hardware=hardware)
    azimuth, elevation, range_m = 0.3, 0.05, 30.0
    at_m = range_m * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    target = dc.Target(position_m=at_m, rcs_m2=2.0)
    echo_w = np.mean(abs(clean(dc.Scene(targets=[target]), radar)) ** 2)

    wavelength_m = radar.frame.chirp.wavelength_m
    gain = hardware.tx_pattern.gain_towards(azimuth, elevation) * 20.0
    expected_w = 0.01 * gain * wavelength_m**2 * 2.0 / ((4 * np.pi) ** 3 * range_m**4 * 1.3)
    # 0.01 dB is the promise; the array is 1 cm wide, seen from 30 m: 0.003 dB.
    assert 10 * np.log10(echo_w / expected_w) == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize(
    ("case", "looks"),
    [("swerling-1", 1), ("swerling-2", 64), ("swerling-3", 1), ("swerling-4", 64)],
)
def test_echoes_fluctuate_from_frame_to_frame_or_from_chirp_to_chirp(radar, case, looks):
    radar = replace(radar, frame=replace(radar.frame, n_chirps=64))
    target = dc.Target(position_m=(20, 0, 0), rcs_m2=1.0)
    steady_w = np.mean(abs(clean(dc.Scene(targets=[target]), radar)) ** 2)
    scene = dc.Scene(targets=[replace(target, fluctuation=case)])
    cube = clean(scene, radar, n_frames=4, seed=8)
    ratio = np.mean(abs(cube) ** 2, axis=(2, 3)) / steady_w  # (frame, chirp)

    within = np.ptp(ratio, axis=1) / ratio.mean(axis=1)
    assert (within < 1e-3).all() if looks == 1 else (within > 0.5).all()
    assert np.ptp(ratio.mean(axis=1)) > 1e-3


def late_scene(radar):
    """A target whose echo comes between two samples, 5.4 samples after the ramp begins."""
    chirp = radar.frame.chirp
    delay_s = chirp.adc_start_s + 5.4 / chirp.sample_rate_hz
    return dc.Scene(targets=[dc.Target(position_m=(delay_s * 299792458.0 / 2, 0, 0))])


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_an_echo_begins_when_it_arrives_if_asked(radar):
    scene = late_scene(radar)
    held = clean(scene, radar)
    onset = clean(scene, radar, engine=dc.Engine(late="onset"))
    first = radar.array.rx_m.index((0.0, 0.0, 0.0)) if (0.0, 0.0, 0.0) in radar.array.rx_m else 0
    assert (onset[0, :, first, :6] == 0).all()
    np.testing.assert_allclose(onset[..., 7:], held[..., 7:], rtol=1e-4)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_the_tail_of_an_echo_is_heard_in_the_next_chirp_alone(radar):
    # Ramps back to back, so that echoes are in the air when the next ramp begins.
    chirp = radar.frame.chirp
    frame = replace(radar.frame, interval_s=chirp.ramp_duration_s, n_chirps=4)
    radar = replace(radar, frame=frame)
    scene = late_scene(radar)
    onset = clean(scene, radar, engine=dc.Engine(late="onset"))
    tail = clean(scene, radar, engine=dc.Engine(late="tail"))

    differs = abs(tail - onset).max(axis=(2, 3))[0] > 0
    assert differs.tolist() == [False, True, True, True]
    assert (tail[0, :, :, 8:] == onset[0, :, :, 8:]).all()
    # It is as strong as the echo itself.
    np.testing.assert_allclose(abs(tail[0, 1, 0, :5]), abs(onset[0, 1, 0, 8]), rtol=1e-3)


@frozen_dataclass
class Broken(Body):
    """A body that forgets where it is."""

    def offsets_m(self, times_s):
        return np.full((len(times_s), 2, 3), np.nan)

    def cross_sections_m2(self):
        return np.ones(2)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_numbers_that_are_none_reach_no_kernel(radar):
    scene = dc.Scene(targets=[dc.Target(name="ghost", position_m=(20, 0, 0), body=Broken())])
    with pytest.raises(dc.InvalidSetting, match="ghost"):
        clean(scene, radar)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"kernel": "fastest"}, "Engine.kernel"),
        ({"late": "never"}, "Engine.late"),
        ({"kernel": np.array(["direct", "low-rank"])}, "Engine.kernel"),
        ({"tolerance": 0.0}, "Engine.tolerance"),
        ({"tolerance": float("nan")}, "Engine.tolerance"),
        ({"kernel": "nufft", "tolerance": 1e-8}, "Engine.tolerance"),
    ],
)
def test_an_engine_says_what_it_cannot(settings, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        dc.Engine(**settings)


def test_the_nonuniform_kernel_refuses_what_varies_from_chirp_to_chirp(radar):
    target = dc.Target(position_m=(20, 0, 0), fluctuation="swerling-2")
    with pytest.raises(dc.InvalidSetting, match="fluctuate"):
        clean(dc.Scene(targets=[target]), radar, engine=dc.Engine(kernel="nufft"))


def test_a_scene_that_does_not_fit_is_refused_before_it_is_simulated(radar):
    frame = replace(radar.frame, n_chirps=2_000_000)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    with pytest.raises(dc.NotEnoughMemory, match="simulation"):
        clean(scene, replace(radar, frame=frame))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_the_model_of_costs_takes_the_cheapest_kernel_and_is_overruled(radar):
    (one,) = plan_kernels(crowd(1, seed=9), radar)
    assert one.kernel == one.costs_s.cheapest
    assert one.chirps == slice(0, radar.frame.n_chirps_total)
    assert one.n_scatterers == 1
    many = crowd(2000, seed=10)
    (planned,) = plan_kernels(many, radar)
    assert planned.kernel == "nufft"
    assert dc.simulate(many, radar).attrs["kernels"] == "nufft"
    (told,) = plan_kernels(many, radar, engine=dc.Engine(kernel="direct"))
    assert told.kernel == "direct"
    (double,) = plan_kernels(many, radar, dtype=np.complex128)
    assert double.kernel == "direct"


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_the_model_of_costs_knows_what_the_product_leaves_to_the_direct_kernel(radar):
    few = crowd(60, seed=11)
    (quick,) = plan_kernels(few, radar)
    assert quick.kernel == "low-rank"
    # Chirps of 6.4 ms, in which some pass by a fifth of their range.
    chirp = replace(
        radar.frame.chirp, slope_hz_per_s=20e9, ramp_duration_s=8e-3, sample_rate_hz=40e3
    )
    frame = replace(radar.frame, chirp=chirp, interval_s=9e-3, n_chirps=8)
    slow = plan_kernels(few, replace(radar, frame=frame))
    assert {one.kernel for one in slow} == {"nufft"}
    assert all(one.costs_s.low_rank > one.costs_s.direct / 2 for one in slow)
