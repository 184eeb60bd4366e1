"""Simulated beat signals: phase to 50 digits, power, noise, sampling, findings and arguments."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest

import dechirp as dc


def exact_beat_sample(radar, target, rx_m, m, n, tx_m=(0, 0, 0)):
    """Compute one sample of the m-th transmitted chirp to 50 digits."""
    with mpmath.workdps(50):
        chirp, c = radar.frame.chirp, mpmath.mpf(299792458)
        t = mpmath.mpf(chirp.adc_start_s) + mpmath.mpf(n) / mpmath.mpf(chirp.sample_rate_hz)
        slow_time_s = m * mpmath.mpf(radar.frame.interval_s) + t
        position_m = [
            mpmath.mpf(p) + mpmath.mpf(v) * slow_time_s
            for p, v in zip(target.position_m, target.velocity_m_per_s, strict=True)
        ]
        outbound_m, return_m = (
            mpmath.sqrt(
                sum((x - mpmath.mpf(a)) ** 2 for x, a in zip(position_m, antenna_m, strict=True))
            )
            for antenna_m in (tx_m, rx_m)
        )
        tau = (outbound_m + return_m) / c
        f0, s = mpmath.mpf(chirp.start_frequency_hz), mpmath.mpf(chirp.slope_hz_per_s)
        cycles = f0 * tau + s * tau * t - s * tau**2 / 2
        h = radar.hardware
        wavelength = c / (
            f0
            + s
            * (
                mpmath.mpf(chirp.adc_start_s)
                + chirp.n_samples / mpmath.mpf(chirp.sample_rate_hz) / 2
            )
        )
        power = h.transmit_power_w * (h.antenna_gain * wavelength) ** 2 * target.rcs_m2
        power /= (4 * mpmath.pi) ** 3 * (outbound_m * return_m) ** 2 * h.loss
        return complex(mpmath.sqrt(power) * mpmath.expjpi(2 * (cycles - mpmath.floor(cycles))))


TARGETS = [
    dc.Target(name="ahead", position_m=(50, 0, 0), velocity_m_per_s=(10, 0, 0), rcs_m2=10),
    dc.Target(name="crossing", position_m=(20, 8, 1), velocity_m_per_s=(-3, 25, 0), rcs_m2=0.3),
    dc.Target(name="near", position_m=(0.8, -0.4, 0.1), velocity_m_per_s=(1, 0, -2), rcs_m2=0.01),
]


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
@pytest.mark.parametrize("adc_start_s", [0.0, 3e-6])
def test_beat_signal_equals_fifty_digit_reference(radar, target, adc_start_s):
    chirp = replace(radar.frame.chirp, adc_start_s=adc_start_s)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, impairments=(), dtype=np.complex128)

    rng = np.random.default_rng(7)
    for m, n in [
        (0, 0),
        (127, 255),
        *zip(rng.integers(128, size=20), rng.integers(256, size=20), strict=True),
    ]:
        for k, rx_m in enumerate(radar.array.rx_m):
            exact = exact_beat_sample(radar, target, rx_m, int(m), int(n))
            assert abs(cube.values[0, m, k, n] - exact) <= 1e-9 * abs(exact)


def test_reference_beat_signal_equals_fifty_digit_reference(reference):
    cube = dc.simulate(reference.scene, reference.radar, impairments=(), dtype=np.complex128)
    for m, n in [(0, 0), (5, 1234), (64, 1100), (127, 2199)]:
        exact = exact_beat_sample(reference.radar, reference.scene.targets[0], (0, 0, 0), m, n)
        assert abs(cube.values[0, m, 0, n] - exact) <= 1e-9 * abs(exact)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("target", TARGETS[1:], ids=lambda target: target.name)
def test_tdm_beat_signal_equals_fifty_digit_reference(radar, target, sampling):
    order, tx_m = (2, 0, 1), [(0, 0, 0), (0, 0.0078, 0), (0, 0.0156, -0.002)]
    chirp = replace(radar.frame.chirp, sampling=sampling)
    frame = replace(
        radar.frame, chirp=chirp, n_chirps=9, multiplexing=dc.multiplexing.Tdm(order=order)
    )
    radar = replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, impairments=(), dtype=np.complex128)

    for m, n in enumerate(range(0, 27 * 9, 9)):
        for k, rx_m in enumerate(radar.array.rx_m):
            exact = exact_beat_sample(radar, target, rx_m, m, n, tx_m[order[m % 3]])
            expected = exact if sampling == "complex" else np.sqrt(2) * exact.real
            assert abs(cube.values[0, m, k, n] - expected) <= 1e-9 * abs(exact)


def test_single_precision_equals_rounded_double_precision(radar):
    scene = dc.Scene(targets=TARGETS[:2])
    double = dc.simulate(scene, radar, impairments=(), dtype=np.complex128)
    single = dc.simulate(scene, radar, impairments=(), engine=dc.Engine(kernel="direct"))

    assert single.dtype == np.complex64
    # Half a unit in the last place for each part, and for the sum of two targets.
    np.testing.assert_allclose(single, double, rtol=0, atol=2e-7 * abs(double.values).max())


def test_echoes_of_several_targets_superpose(radar):
    single_echoes = [
        dc.simulate(dc.Scene(targets=[target]), radar, impairments=(), dtype=np.complex128)
        for target in TARGETS[:2]
    ]
    combined = dc.simulate(
        dc.Scene(targets=TARGETS[:2]), radar, impairments=(), dtype=np.complex128
    )

    np.testing.assert_allclose(
        combined, single_echoes[0] + single_echoes[1], atol=1e-12 * abs(combined.values).max()
    )


def test_ego_motion_equals_reversed_target_motion(radar):
    ego_scene = dc.Scene(
        targets=[dc.Target(position_m=(30, 2, 0))], ego=dc.Ego(velocity_m_per_s=(7, 0, 0))
    )
    target_scene = dc.Scene(targets=[dc.Target(position_m=(30, 2, 0), velocity_m_per_s=(-7, 0, 0))])

    np.testing.assert_array_equal(
        dc.simulate(ego_scene, radar, impairments=()),
        dc.simulate(target_scene, radar, impairments=()),
    )


def test_second_frame_equals_first_frame_of_moved_scene(radar):
    period_s = 0.05
    radar = replace(radar, frame=replace(radar.frame, period_s=period_s))
    target = dc.Target(position_m=(40, 1, 0), velocity_m_per_s=(-6, 1, 0))
    moved_target = replace(target, position_m=(40 - 6 * period_s, 1 + period_s, 0))

    two_frames = dc.simulate(
        dc.Scene(targets=[target]), radar, impairments=(), n_frames=2, dtype=np.complex128
    )
    expected = dc.simulate(
        dc.Scene(targets=[moved_target]), radar, impairments=(), dtype=np.complex128
    )

    # Positions at 40 m are rounded in double precision, 2e-11 rad of phase.
    np.testing.assert_allclose(two_frames[1], expected[0], atol=1e-9 * abs(expected.values).max())


def test_received_power_follows_radar_equation(reference, clean):
    expected_w = 0.0158489319 * 100**2 * reference.radar.frame.chirp.wavelength_m**2 * 10
    expected_w /= (4 * np.pi) ** 3 * 50**4
    # The range increases by 9 mm over the frame: 0.0016 dB about its middle.
    assert float((abs(clean) ** 2).mean()) == pytest.approx(expected_w, rel=1e-3)


def test_real_mixer_keeps_mean_power(radar):
    real_radar = replace(
        radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, sampling="real"))
    )
    scene = dc.Scene(targets=TARGETS[1:2])
    complex_cube = dc.simulate(scene, radar, impairments=())
    real_cube = dc.simulate(scene, real_radar, impairments=())

    assert real_cube.dtype == np.float32
    np.testing.assert_allclose(
        real_cube, np.sqrt(2) * complex_cube.real, atol=1e-6 * abs(complex_cube.values).max()
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_thermal_noise_power_equals_k_t_f_fs(radar, sampling):
    radar = replace(
        radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, sampling=sampling))
    )
    cube = dc.simulate(dc.Scene(), radar, n_frames=4, seed=3).values

    power_w = float(np.mean(abs(cube.astype(complex)) ** 2))
    expected_w = 1.380649e-23 * 290 * 16.0 * 10e6
    # 5 standard errors: the relative deviation of one power is 1 for complex and sqrt(2) for real
    # samples.
    tolerance = 5 * (1 if sampling == "complex" else np.sqrt(2)) / np.sqrt(cube.size)
    assert power_w == pytest.approx(expected_w, rel=tolerance)


def test_white_noise_has_specified_ratio_to_target(radar):
    scene = dc.Scene(targets=TARGETS[:2])
    noise = dc.impairments.WhiteNoise(snr=0.05, target="crossing")
    noisy_cube = dc.simulate(scene, radar, impairments=[noise], seed=4)
    clean_cube = dc.simulate(scene, radar, impairments=())
    crossing = dc.simulate(dc.Scene(targets=TARGETS[1:2]), radar, impairments=())

    noise_w = float(np.mean(abs(noisy_cube - clean_cube) ** 2))
    echo_w = float(np.mean(abs(crossing) ** 2))
    # The noise power has 5 standard errors of 2 % in total; the echo fades by 0.1 % as the target
    # moves.
    assert echo_w / noise_w == pytest.approx(0.05, rel=0.025)


def test_noise_is_white_and_circular(radar):
    cube = dc.simulate(dc.Scene(), radar, n_frames=2, seed=5).values.ravel().astype(complex)
    cube /= np.sqrt(np.mean(abs(cube) ** 2))

    # Each mean of products of independent unit phasors has a standard error 1 / sqrt(n).
    five_sigma = 5 / np.sqrt(cube.size)
    assert abs(np.mean(cube)) < five_sigma
    assert abs(np.mean(cube**2)) < five_sigma * np.sqrt(2)
    for lag in (1, 2, 128, 256):
        assert abs(np.mean(cube[lag:] * cube[:-lag].conj())) < five_sigma


def test_seed_determines_cube(radar):
    scene = dc.Scene(targets=TARGETS[1:])
    first = dc.simulate(scene, radar, seed=11)

    assert first.identical(dc.simulate(scene, radar, seed=11))
    assert first.identical(dc.simulate(scene, radar, seed=np.random.default_rng(11)))
    assert not first.equals(dc.simulate(scene, radar, seed=12))


def test_warns_of_aliased_target_with_its_apparent_position(radar):
    limit = radar.frame.max_velocity_m_per_s
    fast = dc.Target(name="fast", position_m=(30, 0, 0), velocity_m_per_s=(limit + 2, 0, 0))
    message = f"fast.velocity.*is aliased to 30.* m at {2 - limit:.1f}"
    with pytest.warns(dc.PhysicsWarning, match=message):
        cube = dc.simulate(
            dc.Scene(targets=[fast]), radar, impairments=[dc.impairments.WhiteNoise(snr=0.1)]
        )
    detections = dc.detect(cube, radar)
    # The standard error is 3 mm/s; the aliased velocity is exact to the range-Doppler coupling.
    assert float(detections.velocity[0]) == pytest.approx(2 - limit, abs=0.1)

    far = dc.Target(name="far", position_m=(radar.frame.chirp.max_range_m + 10, 0, 0))
    with pytest.warns(dc.PhysicsWarning, match="far.position.*is aliased to 10 m at 0 m/s"):
        cube = dc.simulate(
            dc.Scene(targets=[far]), radar, impairments=[dc.impairments.WhiteNoise(snr=0.1)]
        )
    assert float(dc.detect(cube, radar).range[0]) == pytest.approx(10, abs=0.1)


def test_rejects_target_at_radar_position(radar):
    with pytest.raises(dc.InvalidSetting, match="targets.target-1.position: at the radar"):
        dc.simulate(dc.Scene(targets=[dc.Target(position_m=(0, 0, 0))]), radar)


def test_rejects_cube_larger_than_memory(radar):
    with pytest.raises(dc.NotEnoughMemory, match=r"simulation: 1\.46e\+03 GiB of memory"):
        dc.simulate(dc.Scene(), radar, n_frames=1_000_000)


def test_rejects_noise_relative_to_unknown_target(radar):
    scene = dc.Scene(targets=TARGETS[:1])
    with pytest.raises(dc.InvalidSetting, match="target: bus; expected one of ahead"):
        dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=1.0, target="bus")])


def test_impairment_error_starts_with_its_kind(radar):
    with pytest.raises(dc.InvalidSetting, match=r"^if-filter\.high_pass: 20 MHz"):
        dc.simulate(dc.Scene(), radar, impairments=[dc.impairments.IfFilter(high_pass_hz=20e6)])


@pytest.mark.parametrize("invalid_value", [0.0, "loud", [1.0]])
def test_rejects_invalid_snr(invalid_value):
    with pytest.raises(dc.InvalidSetting, match=r"WhiteNoise\.snr"):
        dc.impairments.WhiteNoise(snr=invalid_value)


@pytest.mark.parametrize(
    ("argument", "invalid_value"),
    [
        *[("impairments", value) for value in (dc.impairments.ThermalNoise(), "thermal-noise", 3)],
        *[("n_frames", value) for value in (-1, 0, 1.5, True, "2")],
        *[("seed", value) for value in (-1, "a", 1.5, True, None)],
        *[("dtype", value) for value in (np.float32, int, "apples", None, dc)],
    ],
)
def test_rejects_invalid_argument_by_name(radar, argument, invalid_value):
    with pytest.raises(dc.InvalidSetting, match=f"^{argument}: .*; expected "):
        dc.simulate(dc.Scene(), radar, **{argument: invalid_value})


def test_equivalent_seeds_and_dtypes_yield_same_cube(radar):
    cube = dc.simulate(dc.Scene(), radar, seed=3)

    for kind in (np.complex64, np.dtype("complex64"), "complex64"):
        assert cube.identical(dc.simulate(dc.Scene(), radar, seed=np.int32(3), dtype=kind))
    assert dc.simulate(dc.Scene(), radar, dtype=complex).dtype == np.complex128
