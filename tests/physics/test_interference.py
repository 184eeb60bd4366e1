"""Interference of other radars: power, ghosts, bursts, timing, phases and rejected settings."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.patterns.cosine import Cosine
from dechirp.simulation import simulate
from dechirp.simulation.echo_groups import frame_sampling_times
from dechirp.simulation.impairments.interference import Interference, Interferer
from dechirp.simulation.impairments.radome import Radome

EMPTY_SCENE = dc.Scene()


def make_interferer(**fields):
    """Return an interferer with the ramps of the victim, 40 m ahead."""
    defaults = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 20e12,
        "ramp_duration_s": 30e-6,
        "interval_s": 35e-6,
        "coherent": True,
        "transmit_power_w": 0.01,
        "antenna_gain": 4.0,
        "position_m": (40.0, 0.0, 0.0),
    }
    return Interferer(**(defaults | fields))


def make_crossing_interferer(slope_hz_per_s, crossing_s=15e-6, **fields):
    """Return an interferer whose ramps have another slope and cross those of the victim."""
    start_hz = 77e9 + (20e12 - slope_hz_per_s) * crossing_s
    return make_interferer(start_frequency_hz=start_hz, slope_hz_per_s=slope_hz_per_s, **fields)


def friis_power_w(radar, interferer, range_m):
    """Return the one-way received power in free space (Friis 1946)."""
    gains = interferer.antenna_gain * radar.hardware.antenna_gain
    spread = (radar.frame.chirp.wavelength_m / (4 * math.pi * range_m)) ** 2
    return interferer.transmit_power_w * gains * spread


def replace_with_real_sampling(radar):
    return replace(
        radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, sampling="real"))
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("range_m", [5.0, 40.0, 250.0])
def test_interference_power_follows_friis_equation(radar, sampling, range_m):
    radar = radar if sampling == "complex" else replace_with_real_sampling(radar)
    # Early transmission places the beat at 2.5 MHz: in the middle of the band, or of its half.
    lead_s = range_m / SPEED_OF_LIGHT - 2.5e6 / 20e12
    interferer = make_interferer(position_m=(range_m, 0, 0), offset_s=-lead_s)
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=[Interference(interferers=[interferer])])
    power_w = float(np.mean(abs(cube) ** 2))
    assert 10 * math.log10(power_w / friis_power_w(radar, interferer, range_m)) == pytest.approx(
        0, abs=0.05
    )


def test_interference_power_includes_both_antenna_patterns(radar):
    beam = Cosine(azimuth_beamwidth_rad=0.5, elevation_beamwidth_rad=0.2)
    hardware = replace(radar.hardware, rx_pattern=beam)
    directional_radar = replace(radar, hardware=hardware)
    # The interferer is 10 degrees to the left of the victim, and its beam points 8 degrees past the
    # victim on the right.
    azimuth_rad, aside_rad = math.radians(10), math.radians(8)
    position_m = (60 * math.cos(azimuth_rad), 60 * math.sin(azimuth_rad), 0.0)
    isotropic_interferer = make_interferer(position_m=position_m)
    directional_interferer = replace(
        isotropic_interferer,
        antenna_gain=None,
        pattern=beam,
        heading_rad=azimuth_rad - math.pi + aside_rad,
    )
    powers_w = [
        float(
            np.mean(
                abs(
                    dc.simulate(
                        EMPTY_SCENE, victim, impairments=[Interference(interferers=[interferer])]
                    )
                )
                ** 2
            )
        )
        for victim, interferer in (
            (radar, isotropic_interferer),
            (directional_radar, directional_interferer),
        )
    ]
    expected = beam.gain_towards(azimuth_rad, 0) / 10.0 * beam.gain_towards(-aside_rad, 0) / 4.0
    assert powers_w[1] / powers_w[0] == pytest.approx(float(expected), rel=1e-3)


def test_interferer_beam_points_along_its_velocity(radar):
    beam = Cosine(azimuth_beamwidth_rad=0.5, elevation_beamwidth_rad=0.2)
    interferer = make_interferer(antenna_gain=None, pattern=beam)
    approaching, receding = (
        Interference(interferers=[replace(interferer, velocity_m_per_s=(speed, 0, 0))])
        for speed in (-20.0, 20.0)
    )
    assert (dc.simulate(EMPTY_SCENE, radar, impairments=[receding]) == 0).all()
    assert float(abs(dc.simulate(EMPTY_SCENE, radar, impairments=[approaching])).min()) > 0


def test_equal_slopes_cause_ghost_at_half_the_delay(radar):
    # The interferer is 40 m away, 100 ns late and approaches at 8 m/s: half of that one way.
    interferer = make_interferer(
        offset_s=100e-9, velocity_m_per_s=(-8, 0, 0), transmit_power_w=1e-4
    )
    impairments = [Interference(interferers=[interferer]), dc.impairments.ThermalNoise()]
    detections = dc.detect(dc.simulate(EMPTY_SCENE, radar, impairments=impairments, seed=1), radar)
    assert detections.sizes["detection"] == 1
    path_m = 40 - 8 * radar.frame.mid_frame_s
    assert detections.range.item() == pytest.approx(
        (path_m + SPEED_OF_LIGHT * 100e-9) / 2, abs=0.01
    )
    assert detections.velocity.item() == pytest.approx(-4.0, abs=0.01)


def test_clock_drift_adds_velocity_to_ghost(radar):
    # Each ramp is delayed by 0.5 ps: c 0.5 ps / 2 in 35 us, 2.14 m/s.
    interferer = make_interferer(interval_s=35e-6 + 0.5e-12, transmit_power_w=1e-4)
    impairments = [Interference(interferers=[interferer]), dc.impairments.ThermalNoise()]
    detections = dc.detect(dc.simulate(EMPTY_SCENE, radar, impairments=impairments, seed=1), radar)
    drift = SPEED_OF_LIGHT * 0.5e-12 / 2 / 35e-6
    assert detections.sizes["detection"] == 1
    assert detections.velocity.item() == pytest.approx(drift, abs=0.01)
    # The chain assumes motion within the ramp too: 0.8 cm of coupling.
    assert detections.range.item() == pytest.approx(20.0, abs=0.02)


def test_ghost_appears_in_direction_of_interferer(radar):
    azimuth_rad = math.radians(20)
    position_m = (60 * math.cos(azimuth_rad), 60 * math.sin(azimuth_rad), 0.0)
    interferer = make_interferer(position_m=position_m)
    cube = dc.simulate(
        EMPTY_SCENE,
        radar,
        impairments=[Interference(interferers=[interferer])],
        dtype=np.complex128,
    ).values[0]
    phase_step_rad = np.angle((cube[:, 1] * cube[:, 0].conj()).sum())
    # The second receiver is 1.9 mm to the left and nearer: the delay is shorter.
    expected = -2 * math.pi * 1.9e-3 * math.sin(azimuth_rad) / radar.frame.chirp.wavelength_m
    assert phase_step_rad == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("slope_hz_per_s", [19e12, 21e12, 17e12, 24e12, 15e12])
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_crossing_slopes_cause_burst_of_expected_duration(radar, slope_hz_per_s, sampling):
    radar = radar if sampling == "complex" else replace_with_real_sampling(radar)
    impairment = Interference(interferers=[make_crossing_interferer(slope_hz_per_s)])
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment.add_signals(
        samples, frame_sampling_times(radar, 0), EMPTY_SCENE, radar, np.random.default_rng(0)
    )
    power = abs(samples[:, 0]) ** 2
    # The passband is 0 to 10 MHz, or plus and minus 5 MHz.
    expected = 10e6 / abs(20e12 - slope_hz_per_s) * 10e6
    is_on = power > power.max() / 2
    assert np.all(abs(is_on.sum(axis=1) - expected) <= 1)
    # The burst is one run of samples, centred where the beat is in the middle of the passband.
    assert np.all(abs(np.diff(is_on.astype(int), axis=1)).sum(axis=1) == 2)
    middle_hz = 5e6 if sampling == "complex" else 0.0
    delay_s = 40 / SPEED_OF_LIGHT
    expected_s = 15e-6 + (middle_hz - slope_hz_per_s * delay_s) / (20e12 - slope_hz_per_s)
    middles = (is_on * np.arange(256)).sum(axis=1) / is_on.sum(axis=1)
    assert middles == pytest.approx((expected_s - 2e-6) * 10e6, abs=1)


def oversampled_interference(
    radar, interferer, scene, filter_order, *, chirp_index, receiver, oversampling
):
    """Sample `oversampling` times as fast, so that no beat aliases, and filter in one piece."""
    chirp, pad = radar.frame.chirp, 128
    n = np.arange(-pad * oversampling, (chirp.n_samples + pad) * oversampling)
    t = chirp.adc_start_s + n / (oversampling * chirp.sample_rate_hz)
    start_s = chirp_index * radar.frame.interval_s
    mover = dc.Target(
        position_m=interferer.position_m, velocity_m_per_s=interferer.velocity_m_per_s
    )
    positions_m = dc.Scene(targets=[mover], ego=scene.ego).scatterer_positions_m(start_s + t)[:, 0]
    length_m = np.linalg.norm(positions_m - radar.array.rx_m[receiver], axis=-1)
    time_since_start_s = t - length_m / SPEED_OF_LIGHT + (start_s - interferer.offset_s)
    u = (
        time_since_start_s
        - np.floor(time_since_start_s / interferer.interval_s) * interferer.interval_s
    )
    cycles = chirp.start_frequency_hz * t + chirp.slope_hz_per_s * t**2 / 2
    cycles -= interferer.start_frequency_hz * u + interferer.slope_hz_per_s * u**2 / 2
    gain = interferer.transmit_power_w * interferer.antenna_gain * radar.hardware.antenna_gain
    size = np.sqrt(gain) * chirp.wavelength_m / (4 * np.pi * length_m)
    wave = np.where(u < interferer.ramp_duration_s, size, 0) * np.exp(2j * np.pi * cycles)
    beat_hz = np.fft.fftfreq(len(t), 1 / (oversampling * chirp.sample_rate_hz))
    half_hz = chirp.sample_rate_hz / 2
    x = (beat_hz - (half_hz if chirp.sampling == "complex" else 0)) / half_hz
    filtered = np.fft.ifft(np.fft.fft(wave) / np.sqrt(1 + x ** (2 * filter_order)))
    return filtered[pad * oversampling : -pad * oversampling : oversampling]


@pytest.mark.parametrize("slope_hz_per_s", [19e12, 20.5e12])
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_burst_equals_oversampled_and_filtered_reference(radar, slope_hz_per_s, sampling):
    radar = radar if sampling == "complex" else replace_with_real_sampling(radar)
    interferer = make_crossing_interferer(
        slope_hz_per_s, velocity_m_per_s=(-10, 3, 1), position_m=(40, 5, 1)
    )
    moving_scene = dc.Scene(ego=dc.Ego(velocity_m_per_s=(15, 0, 0), turn_rate_rad_per_s=0.4))
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment = Interference(interferers=[interferer], filter_order=6)
    impairment.add_signals(
        samples, frame_sampling_times(radar, 0), moving_scene, radar, np.random.default_rng(0)
    )
    for chirp_index, receiver in ((0, 1), (77, 0)):
        expected = oversampled_interference(
            radar,
            interferer,
            moving_scene,
            6,
            chirp_index=chirp_index,
            receiver=receiver,
            oversampling=16,
        )
        result = samples[chirp_index, receiver]
        error = np.sum(abs(result - expected) ** 2) / np.sum(abs(expected) ** 2)
        # The filter rings where the beat passes its edges: 1.6 % of 100 samples.
        assert math.sqrt(error) < 0.02


def test_ghost_samples_equal_oversampled_reference(radar):
    # The beat stays in the middle of the band, where the filter has no loss.
    interferer = make_interferer(offset_s=120e-9, velocity_m_per_s=(-30, 3, 1))
    moving_scene = dc.Scene(ego=dc.Ego(velocity_m_per_s=(15, 0, 0), turn_rate_rad_per_s=0.4))
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment = Interference(interferers=[interferer])
    impairment.add_signals(
        samples, frame_sampling_times(radar, 0), moving_scene, radar, np.random.default_rng(0)
    )
    for m in (1, 100):
        expected = oversampled_interference(
            radar, interferer, moving_scene, 8, chirp_index=m, receiver=1, oversampling=8
        )
        interior = slice(20, 236)
        # The reference filter rings at the ramp ends, far outside: 1e-4.
        error = abs(samples[m, 1] - expected)[interior].max() / abs(expected).max()
        assert error < 1e-3


def test_tone_and_down_ramp_deliver_energy_while_crossing(radar):
    for slope_hz_per_s in (0.0, -20e12):
        impairment = Interference(interferers=[make_crossing_interferer(slope_hz_per_s)])
        samples = np.zeros((128, 2, 256), np.complex128)
        impairment.add_signals(
            samples, frame_sampling_times(radar, 0), EMPTY_SCENE, radar, np.random.default_rng(0)
        )
        energy = (abs(samples[:, 0]) ** 2).sum(axis=1)
        # The passage takes 5 and 2.5 samples, within one sample.
        sample_power_w = friis_power_w(radar, make_crossing_interferer(0.0), 40.0)
        n_samples = 10e6 / (20e12 - slope_hz_per_s) * 10e6
        assert energy / sample_power_w == pytest.approx(n_samples, abs=1)


def test_interference_is_limited_to_transmit_periods(radar):
    # The interferer sends four ramps in every eight intervals, from the fifth on.
    interferer = make_interferer(n_chirps=4, period_s=8 * 35e-6, offset_s=4 * 35e-6)
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=[Interference(interferers=[interferer])])
    is_received = (abs(cube.values[0, :, 0]) > 0).all(axis=1)
    assert is_received.tolist() == [m % 8 >= 4 for m in range(128)]
    single_burst_interferer = replace(interferer, period_s=None)
    cube = dc.simulate(
        EMPTY_SCENE, radar, impairments=[Interference(interferers=[single_burst_interferer])]
    )
    is_received = (abs(cube.values[0, :, 0]) > 0).any(axis=1)
    assert is_received.tolist() == [4 <= m < 8 for m in range(128)]


def test_interference_continues_in_later_frames(radar):
    # Frames of 128 intervals follow without a gap: the ghost is coherent over frames.
    interferer = make_interferer()
    impairments = [Interference(interferers=[interferer])]
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=impairments, n_frames=3, dtype=np.complex128)
    assert abs(cube[2] - cube[1]).max() < 1e-4 * abs(cube[1]).max()


def test_long_ramp_extends_over_many_chirps_of_victim(radar):
    # The interferer sweeps 1 GHz in 5 ms and crosses the band in each ramp of the victim, a little
    # higher each time.
    interferer = make_interferer(
        start_frequency_hz=76.8e9, slope_hz_per_s=0.2e12, ramp_duration_s=5e-3, interval_s=5e-3
    )
    cube = dc.simulate(
        EMPTY_SCENE, radar, impairments=[Interference(interferers=[interferer])]
    ).values[0, :, 0]
    peaks = abs(cube).argmax(axis=1)
    is_received = abs(cube).max(axis=1) > 0
    # The sampled band is 77.04 GHz to 77.55 GHz.
    assert 70 < is_received.sum() < 128
    assert np.all(np.diff(peaks[is_received]) >= -6)


def test_ramp_phases_are_random_unless_coherent(radar):
    def simulate_phases_rad(seed, **fields):
        interference = Interference(interferers=[make_interferer(**fields)])
        cube = dc.simulate(EMPTY_SCENE, radar, impairments=[interference], seed=seed)
        return np.angle(cube.values[0, :, 0, 128])

    assert abs(np.exp(1j * simulate_phases_rad(1)).mean()) == pytest.approx(1, abs=1e-6)
    random_rad = simulate_phases_rad(1, coherent=False)
    # The mean of 128 random phasors is Rayleigh distributed, above 0.3 once in 1e5.
    assert abs(np.exp(1j * random_rad).mean()) < 0.3
    assert (random_rad == simulate_phases_rad(1, coherent=False)).all()
    assert (random_rad != simulate_phases_rad(2, coherent=False)).any()


def test_several_interferers_superpose(radar):
    first, second = (
        make_crossing_interferer(18e12, name="one"),
        make_crossing_interferer(23e12, name="two", position_m=(30, -20, 0)),
    )
    single_cubes = [
        dc.simulate(EMPTY_SCENE, radar, impairments=[Interference(interferers=[interferer])])
        for interferer in (first, second)
    ]
    combined = dc.simulate(
        EMPTY_SCENE, radar, impairments=[Interference(interferers=[first, second])]
    )
    assert abs(combined - single_cubes[0] - single_cubes[1]).max() < 1e-6 * abs(combined).max()


def test_interference_does_not_depend_on_chirp_blocks(radar):
    impairment = Interference(interferers=[make_crossing_interferer(18.7e12, interval_s=34.3e-6)])
    full, pieces = np.zeros((2, 128, 2, 256), np.complex128)
    impairment.add_signals(
        full, frame_sampling_times(radar, 1), EMPTY_SCENE, radar, np.random.default_rng(0)
    )
    for rows in (slice(0, 50), slice(50, 51), slice(51, 128)):
        window = frame_sampling_times(radar, 1).select_chirps(rows)
        impairment.add_signals(pieces[rows], window, EMPTY_SCENE, radar, np.random.default_rng(0))
    assert abs(full).max() > 0
    # Ramps begin 9 ms after time zero: rounding changes phases by 1e-7.
    assert abs(full - pieces).max() < 1e-6 * abs(full).max()
    wider = np.zeros((128, 2, 300), np.complex128)
    impairment.add_signals(
        wider,
        frame_sampling_times(radar, 1).widen(4, 40),
        EMPTY_SCENE,
        radar,
        np.random.default_rng(0),
    )
    assert abs(full - wider[..., 4:260]).max() < 1e-6 * abs(full).max()


def test_random_ramp_phase_does_not_depend_on_chirp_blocks(radar, monkeypatch):
    # The tone covers all chirps: echoes are summed in blocks where phases are modulated.
    tone = make_crossing_interferer(
        0.0, coherent=False, ramp_duration_s=20e-3, interval_s=20e-3, offset_s=-1e-3
    )
    impairments = [dc.impairments.SlopeDrift(relative_drift=1e-6), Interference(interferers=[tone])]
    full = dc.simulate(EMPTY_SCENE, radar, impairments=impairments, seed=5)
    monkeypatch.setattr(simulate, "_COPY_BLOCK_SAMPLES", 9 * 2 * 256)
    pieces = dc.simulate(EMPTY_SCENE, radar, impairments=impairments, seed=5)
    assert abs(full).max() > 0
    assert abs(full - pieces).max() < 1e-6 * abs(full).max()


def test_rejects_ramps_larger_than_memory(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=1e3, ramp_duration_s=1e6)
    slow_radar = replace(radar, frame=replace(radar.frame, chirp=chirp, interval_s=1e6))
    fast_settings = {"slope_hz_per_s": 0.0, "ramp_duration_s": 1e-7, "interval_s": 1e-7}
    with pytest.raises(dc.NotEnoughMemory, match="interference: .* GiB of memory"):
        dc.simulate(
            EMPTY_SCENE,
            slow_radar,
            impairments=[Interference(interferers=[make_interferer(**fast_settings)])],
        )
    interference = Interference(
        interferers=[make_interferer(**fast_settings, n_chirps=300, period_s=1e5)]
    )
    assert abs(dc.simulate(EMPTY_SCENE, slow_radar, impairments=[interference])).max() > 0


def test_radome_attenuates_preceding_interference_one_way(radar):
    interference, radome = Interference(interferers=[make_interferer()]), Radome(loss=4.0)
    without_radome = dc.simulate(EMPTY_SCENE, radar, impairments=[interference])
    behind_radome = dc.simulate(EMPTY_SCENE, radar, impairments=[interference, radome])
    inside_radome = dc.simulate(EMPTY_SCENE, radar, impairments=[radome, interference])
    ratio = float(np.mean(abs(behind_radome) ** 2) / np.mean(abs(without_radome) ** 2))
    # One way has half of the two-way loss: 3 dB of 6.
    assert ratio == pytest.approx(0.5, rel=1e-5)
    assert (inside_radome == without_radome).all()


def test_warns_of_interferer_outside_band(radar):
    interferer_below = make_interferer(start_frequency_hz=76e9, name="truck")
    with pytest.warns(dc.PhysicsWarning, match=r"interferers.truck: sends from 76 to 76.6 GHz"):
        cube = dc.simulate(
            EMPTY_SCENE, radar, impairments=[Interference(interferers=[interferer_below])]
        )
    assert (cube == 0).all()
    with pytest.warns(dc.PhysicsWarning, match=r"interferers.interferer-2: sends from 78"):
        interferer_above = make_interferer(start_frequency_hz=78e9)
        Interference(interferers=[make_interferer(), interferer_above]).check(EMPTY_SCENE, radar)


def test_rejects_interferer_at_radar_position(radar):
    with pytest.raises(
        dc.InvalidSetting,
        match=r"interferers.car.position: at the position of"
        r" the radar",
    ):
        interferer = make_interferer(position_m=(0, 0, 0), name="car")
        Interference(interferers=[interferer]).check(EMPTY_SCENE, radar)


@pytest.mark.parametrize(
    ("fields", "setting"),
    [
        ({"name": ""}, "name"),
        ({"start_frequency_hz": 77.0}, "start_frequency_hz"),
        ({"slope_hz_per_s": math.nan}, "slope_hz_per_s"),
        ({"slope_hz_per_s": -1e16}, "slope_hz_per_s.* stays above 0 Hz"),
        ({"ramp_duration_s": 0.0}, "ramp_duration_s"),
        ({"interval_s": 20e-6}, "interval_s"),
        ({"n_chirps": 0}, "n_chirps"),
        ({"period_s": 1e-3}, "n_chirps: missing, with a period"),
        ({"period_s": 1e-3, "n_chirps": 128}, "period_s"),
        ({"offset_s": math.inf}, "offset_s"),
        ({"coherent": "no"}, "coherent"),
        ({"transmit_power_w": -1.0}, "transmit_power_w"),
        ({"antenna_gain": None}, "antenna_gain"),
        ({"antenna_gain": 0.0}, "antenna_gain"),
        ({"pattern": 3.0}, "pattern"),
        ({"position_m": (1, 2)}, "position_m"),
        ({"velocity_m_per_s": (1e6, 0, 0)}, "velocity_m_per_s"),
        ({"heading_rad": 180.0}, "heading_rad"),
    ],
)
def test_rejects_invalid_interferer(fields, setting):
    with pytest.raises(dc.InvalidSetting, match=f"Interferer.{setting}"):
        make_interferer(**fields)


@pytest.mark.parametrize(
    ("fields", "setting"),
    [
        ({"interferers": []}, "interferers"),
        ({"interferers": make_interferer()}, "interferers"),
        ({"interferers": [make_interferer(name="a")] * 2}, "2 interferers named a"),
        ({"interferers": [make_interferer()], "filter_order": 0}, "filter_order"),
        ({"interferers": [make_interferer()], "filter_corner": 0.0}, "filter_corner"),
    ],
)
def test_rejects_invalid_interference(fields, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        Interference(**fields)
