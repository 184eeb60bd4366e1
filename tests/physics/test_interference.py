"""Other radars in the receivers: their power, their ghosts, their bursts, their silence."""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.simulation import simulate
from dechirp.simulation.echo_groups import sample_window
from dechirp.simulation.impairments.interference import Interference, Interferer
from dechirp.simulation.impairments.radome import Radome

NOTHING = dc.Scene()


def like_the_victim(**fields):
    """An interferer with the ramps of the victim, 40 m ahead."""
    given = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 20e12,
        "ramp_duration_s": 30e-6,
        "interval_s": 35e-6,
        "coherent": True,
        "transmit_power_w": 0.01,
        "antenna_gain": 4.0,
        "position_m": (40.0, 0.0, 0.0),
    }
    return Interferer(**(given | fields))


def crossing(slope_hz_per_s, at_s=15e-6, **fields):
    """Ramps of another slope that cross those of the victim at a time."""
    start_hz = 77e9 + (20e12 - slope_hz_per_s) * at_s
    return like_the_victim(start_frequency_hz=start_hz, slope_hz_per_s=slope_hz_per_s, **fields)


def friis_w(radar, interferer, range_m):
    """One way, in free space (Friis 1946)."""
    gains = interferer.antenna_gain * radar.hardware.antenna_gain
    spread = (radar.frame.chirp.wavelength_m / (4 * math.pi * range_m)) ** 2
    return interferer.transmit_power_w * gains * spread


def real(radar):
    return replace(
        radar, frame=replace(radar.frame, chirp=replace(radar.frame.chirp, sampling="real"))
    )


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("range_m", [5.0, 40.0, 250.0])
def test_interference_comes_one_way_by_friis(radar, sampling, range_m):
    radar = radar if sampling == "complex" else real(radar)
    # Sent early, so that the beat lies at 2.5 MHz: in the middle of the band, or of its half.
    early_s = range_m / SPEED_OF_LIGHT - 2.5e6 / 20e12
    other = like_the_victim(position_m=(range_m, 0, 0), offset_s=-early_s)
    cube = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[other])])
    found_w = float(np.mean(abs(cube) ** 2))
    assert 10 * math.log10(found_w / friis_w(radar, other, range_m)) == pytest.approx(0, abs=0.05)


def test_patterns_of_both_radars_count(radar):
    beam = CosinePattern(azimuth_beamwidth_rad=0.5, elevation_beamwidth_rad=0.2)
    hardware = replace(radar.hardware, rx_pattern=beam)
    seen = replace(radar, hardware=hardware)
    # 10 degrees to the left of the victim, and looking 8 degrees past it on its right.
    azimuth_rad, aside_rad = math.radians(10), math.radians(8)
    place_m = (60 * math.cos(azimuth_rad), 60 * math.sin(azimuth_rad), 0.0)
    plain = like_the_victim(position_m=place_m)
    looking = replace(
        plain, antenna_gain=None, pattern=beam, heading_rad=azimuth_rad - math.pi + aside_rad
    )
    powers_w = [
        float(
            np.mean(abs(dc.simulate(NOTHING, a, impairments=[Interference(interferers=[b])])) ** 2)
        )
        for a, b in ((radar, plain), (seen, looking))
    ]
    expected = beam.gain_towards(azimuth_rad, 0) / 10.0 * beam.gain_towards(-aside_rad, 0) / 4.0
    assert powers_w[1] / powers_w[0] == pytest.approx(float(expected), rel=1e-3)


def test_an_interferer_looks_where_it_goes(radar):
    beam = CosinePattern(azimuth_beamwidth_rad=0.5, elevation_beamwidth_rad=0.2)
    other = like_the_victim(antenna_gain=None, pattern=beam)
    coming, going = (
        Interference(interferers=[replace(other, velocity_m_per_s=(speed, 0, 0))])
        for speed in (-20.0, 20.0)
    )
    assert (dc.simulate(NOTHING, radar, impairments=[going]) == 0).all()
    assert float(abs(dc.simulate(NOTHING, radar, impairments=[coming])).min()) > 0


def test_parallel_slopes_make_a_ghost_at_half_of_the_delay(radar):
    # 40 m away and 100 ns late; approaching at 8 m/s: half of that one way.
    other = like_the_victim(offset_s=100e-9, velocity_m_per_s=(-8, 0, 0), transmit_power_w=1e-4)
    impairments = [Interference(interferers=[other]), dc.impairments.ThermalNoise()]
    found = dc.detect(dc.simulate(NOTHING, radar, impairments=impairments, seed=1), radar)
    assert found.sizes["detection"] == 1
    way_m = 40 - 8 * radar.frame.mid_frame_s
    assert found.range.item() == pytest.approx((way_m + SPEED_OF_LIGHT * 100e-9) / 2, abs=0.01)
    assert found.velocity.item() == pytest.approx(-4.0, abs=0.01)


def test_a_clock_that_drifts_gives_the_ghost_a_velocity(radar):
    # Each ramp 0.5 ps later than the one before: c 0.5 ps / 2 in 35 us, 2.14 m/s.
    other = like_the_victim(interval_s=35e-6 + 0.5e-12, transmit_power_w=1e-4)
    impairments = [Interference(interferers=[other]), dc.impairments.ThermalNoise()]
    found = dc.detect(dc.simulate(NOTHING, radar, impairments=impairments, seed=1), radar)
    drift = SPEED_OF_LIGHT * 0.5e-12 / 2 / 35e-6
    assert found.sizes["detection"] == 1
    assert found.velocity.item() == pytest.approx(drift, abs=0.01)
    # The chain takes the velocity for motion within the ramp as well: 0.8 cm of coupling.
    assert found.range.item() == pytest.approx(20.0, abs=0.02)


def test_the_ghost_stands_where_the_interferer_is_seen(radar):
    azimuth_rad = math.radians(20)
    place_m = (60 * math.cos(azimuth_rad), 60 * math.sin(azimuth_rad), 0.0)
    other = like_the_victim(position_m=place_m)
    cube = dc.simulate(
        NOTHING, radar, impairments=[Interference(interferers=[other])], dtype=np.complex128
    ).values[0]
    turn_rad = np.angle((cube[:, 1] * cube[:, 0].conj()).sum())
    # The second receiver lies 1.9 mm to the left, nearer: the delay is shorter.
    expected = -2 * math.pi * 1.9e-3 * math.sin(azimuth_rad) / radar.frame.chirp.wavelength_m
    assert turn_rad == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("slope_hz_per_s", [19e12, 21e12, 17e12, 24e12, 15e12])
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_crossing_slopes_make_a_burst_of_the_passband_over_their_difference(
    radar, slope_hz_per_s, sampling
):
    radar = radar if sampling == "complex" else real(radar)
    impairment = Interference(interferers=[crossing(slope_hz_per_s)])
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment.add_signals(
        samples, sample_window(radar, 0), NOTHING, radar, np.random.default_rng(0)
    )
    power = abs(samples[:, 0]) ** 2
    # 0 to 10 MHz, or plus and minus 5 MHz.
    expected = 10e6 / abs(20e12 - slope_hz_per_s) * 10e6
    is_on = power > power.max() / 2
    assert np.all(abs(is_on.sum(axis=1) - expected) <= 1)
    # One run of samples, about where the beat is in the middle of the passband.
    assert np.all(abs(np.diff(is_on.astype(int), axis=1)).sum(axis=1) == 2)
    middle_hz = 5e6 if sampling == "complex" else 0.0
    delay_s = 40 / SPEED_OF_LIGHT
    at_s = 15e-6 + (middle_hz - slope_hz_per_s * delay_s) / (20e12 - slope_hz_per_s)
    middles = (is_on * np.arange(256)).sum(axis=1) / is_on.sum(axis=1)
    assert middles == pytest.approx((at_s - 2e-6) * 10e6, abs=1)


def brute_force(radar, other, scene, filter_order, *, chirp_index, receiver, over):
    """Sampled `over` times as fast, so that no beat aliases, and low-passed in one piece."""
    chirp, pad = radar.frame.chirp, 128
    n = np.arange(-pad * over, (chirp.n_samples + pad) * over)
    t = chirp.adc_start_s + n / (over * chirp.sample_rate_hz)
    start_s = chirp_index * radar.frame.interval_s
    mover = dc.Target(position_m=other.position_m, velocity_m_per_s=other.velocity_m_per_s)
    at_m = dc.Scene(targets=[mover], ego=scene.ego).positions_m(start_s + t)[:, 0]
    length_m = np.linalg.norm(at_m - radar.array.rx_m[receiver], axis=-1)
    since_s = t - length_m / SPEED_OF_LIGHT + (start_s - other.offset_s)
    u = since_s - np.floor(since_s / other.interval_s) * other.interval_s
    cycles = chirp.start_frequency_hz * t + chirp.slope_hz_per_s * t**2 / 2
    cycles -= other.start_frequency_hz * u + other.slope_hz_per_s * u**2 / 2
    gain = other.transmit_power_w * other.antenna_gain * radar.hardware.antenna_gain
    size = np.sqrt(gain) * chirp.wavelength_m / (4 * np.pi * length_m)
    wave = np.where(u < other.ramp_duration_s, size, 0) * np.exp(2j * np.pi * cycles)
    beat_hz = np.fft.fftfreq(len(t), 1 / (over * chirp.sample_rate_hz))
    half_hz = chirp.sample_rate_hz / 2
    x = (beat_hz - (half_hz if chirp.sampling == "complex" else 0)) / half_hz
    passed = np.fft.ifft(np.fft.fft(wave) / np.sqrt(1 + x ** (2 * filter_order)))
    return passed[pad * over : -pad * over : over]


@pytest.mark.parametrize("slope_hz_per_s", [19e12, 20.5e12])
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_a_burst_has_the_shape_of_one_that_is_sampled_fast_and_low_passed(
    radar, slope_hz_per_s, sampling
):
    radar = radar if sampling == "complex" else real(radar)
    other = crossing(slope_hz_per_s, velocity_m_per_s=(-10, 3, 1), position_m=(40, 5, 1))
    moving = dc.Scene(ego=dc.Ego(velocity_m_per_s=(15, 0, 0), turn_rate_rad_per_s=0.4))
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment = Interference(interferers=[other], filter_order=6)
    impairment.add_signals(
        samples, sample_window(radar, 0), moving, radar, np.random.default_rng(0)
    )
    for chirp_index, receiver in ((0, 1), (77, 0)):
        expected = brute_force(
            radar, other, moving, 6, chirp_index=chirp_index, receiver=receiver, over=16
        )
        found = samples[chirp_index, receiver]
        error = np.sum(abs(found - expected) ** 2) / np.sum(abs(expected) ** 2)
        # The filter rings where the beat goes through its edges: 1.6 % of 100 samples.
        assert math.sqrt(error) < 0.02


def test_a_ghost_equals_the_brute_force_sample_by_sample(radar):
    # In the middle of the band from the first sample to the last, the filter takes nothing.
    other = like_the_victim(offset_s=120e-9, velocity_m_per_s=(-30, 3, 1))
    moving = dc.Scene(ego=dc.Ego(velocity_m_per_s=(15, 0, 0), turn_rate_rad_per_s=0.4))
    samples = np.zeros((128, 2, 256), np.complex128)
    impairment = Interference(interferers=[other])
    impairment.add_signals(
        samples, sample_window(radar, 0), moving, radar, np.random.default_rng(0)
    )
    for m in (1, 100):
        expected = brute_force(radar, other, moving, 8, chirp_index=m, receiver=1, over=8)
        inside = slice(20, 236)
        # Where the ramp begins and ends, far outside, the filter of the other rings: 1e-4.
        error = abs(samples[m, 1] - expected)[inside].max() / abs(expected).max()
        assert error < 1e-3


def test_a_tone_and_a_down_ramp_are_heard_as_they_cross(radar):
    for slope_hz_per_s in (0.0, -20e12):
        impairment = Interference(interferers=[crossing(slope_hz_per_s)])
        samples = np.zeros((128, 2, 256), np.complex128)
        impairment.add_signals(
            samples, sample_window(radar, 0), NOTHING, radar, np.random.default_rng(0)
        )
        energy = (abs(samples[:, 0]) ** 2).sum(axis=1)
        # As many samples as the passage takes, 5 and 2.5, within the one that they may miss.
        each_w = friis_w(radar, crossing(0.0), 40.0)
        n_samples = 10e6 / (20e12 - slope_hz_per_s) * 10e6
        assert energy / each_w == pytest.approx(n_samples, abs=1)


def test_it_is_heard_only_while_it_sends(radar):
    # Four ramps in every eight intervals, from the fifth on.
    other = like_the_victim(n_chirps=4, period_s=8 * 35e-6, offset_s=4 * 35e-6)
    cube = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[other])])
    heard = (abs(cube.values[0, :, 0]) > 0).all(axis=1)
    assert heard.tolist() == [m % 8 >= 4 for m in range(128)]
    once = replace(other, period_s=None)
    cube = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[once])])
    heard = (abs(cube.values[0, :, 0]) > 0).any(axis=1)
    assert heard.tolist() == [4 <= m < 8 for m in range(128)]


def test_it_goes_on_in_later_frames(radar):
    # Frames of 128 intervals follow without a gap: the ghost stays in phase with itself.
    other = like_the_victim()
    impairments = [Interference(interferers=[other])]
    cube = dc.simulate(NOTHING, radar, impairments=impairments, n_frames=3, dtype=np.complex128)
    assert abs(cube[2] - cube[1]).max() < 1e-4 * abs(cube[1]).max()


def test_a_long_ramp_goes_on_through_many_chirps_of_the_victim(radar):
    # 1 GHz in 5 ms: it passes the band in each ramp of the victim, a little higher each time.
    slow = like_the_victim(
        start_frequency_hz=76.8e9, slope_hz_per_s=0.2e12, ramp_duration_s=5e-3, interval_s=5e-3
    )
    cube = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[slow])]).values[
        0, :, 0
    ]
    peaks = abs(cube).argmax(axis=1)
    heard = abs(cube).max(axis=1) > 0
    # From 77.04 GHz, where samples begin, to 77.55 GHz.
    assert 70 < heard.sum() < 128
    assert np.all(np.diff(peaks[heard]) >= -6)


def test_phases_are_drawn_for_each_ramp_unless_it_is_coherent(radar):
    def phases_rad(seed, **fields):
        interference = Interference(interferers=[like_the_victim(**fields)])
        cube = dc.simulate(NOTHING, radar, impairments=[interference], seed=seed)
        return np.angle(cube.values[0, :, 0, 128])

    assert abs(np.exp(1j * phases_rad(1)).mean()) == pytest.approx(1, abs=1e-6)
    drawn = phases_rad(1, coherent=False)
    # The mean of 128 random phasors: Rayleigh, above 0.3 once in 1e5.
    assert abs(np.exp(1j * drawn).mean()) < 0.3
    assert (drawn == phases_rad(1, coherent=False)).all()
    assert (drawn != phases_rad(2, coherent=False)).any()


def test_several_interferers_add_up(radar):
    one, two = crossing(18e12, name="one"), crossing(23e12, name="two", position_m=(30, -20, 0))
    alone = [
        dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[other])])
        for other in (one, two)
    ]
    both = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[one, two])])
    assert abs(both - alone[0] - alone[1]).max() < 1e-6 * abs(both).max()


def test_chirps_are_the_same_however_they_are_taken_apart(radar):
    impairment = Interference(interferers=[crossing(18.7e12, interval_s=34.3e-6)])
    whole, pieces = np.zeros((2, 128, 2, 256), np.complex128)
    impairment.add_signals(whole, sample_window(radar, 1), NOTHING, radar, np.random.default_rng(0))
    for rows in (slice(0, 50), slice(50, 51), slice(51, 128)):
        part = sample_window(radar, 1).select_chirps(rows)
        impairment.add_signals(pieces[rows], part, NOTHING, radar, np.random.default_rng(0))
    assert abs(whole).max() > 0
    # Ramps that begin 9 ms after time zero: roundings turn them by 1e-7.
    assert abs(whole - pieces).max() < 1e-6 * abs(whole).max()
    wider = np.zeros((128, 2, 300), np.complex128)
    impairment.add_signals(
        wider, sample_window(radar, 1).widen(4, 40), NOTHING, radar, np.random.default_rng(0)
    )
    assert abs(whole - wider[..., 4:260]).max() < 1e-6 * abs(whole).max()


def test_a_ramp_has_one_drawn_phase_however_the_chirps_are_taken_apart(radar, monkeypatch):
    # A tone through all chirps: their echoes are summed some at a time where phases are turned.
    tone = crossing(0.0, coherent=False, ramp_duration_s=20e-3, interval_s=20e-3, offset_s=-1e-3)
    impairments = [dc.impairments.SlopeDrift(relative_drift=1e-6), Interference(interferers=[tone])]
    whole = dc.simulate(NOTHING, radar, impairments=impairments, seed=5)
    monkeypatch.setattr(simulate, "_COPY_BLOCK_SAMPLES", 9 * 2 * 256)
    pieces = dc.simulate(NOTHING, radar, impairments=impairments, seed=5)
    assert abs(whole).max() > 0
    assert abs(whole - pieces).max() < 1e-6 * abs(whole).max()


def test_ramps_that_do_not_fit_into_memory_are_refused(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=1e3, ramp_duration_s=1e6)
    slow = replace(radar, frame=replace(radar.frame, chirp=chirp, interval_s=1e6))
    fast = {"slope_hz_per_s": 0.0, "ramp_duration_s": 1e-7, "interval_s": 1e-7}
    with pytest.raises(dc.NotEnoughMemory, match="interference: .* GiB of memory"):
        dc.simulate(
            NOTHING, slow, impairments=[Interference(interferers=[like_the_victim(**fast)])]
        )
    few = Interference(interferers=[like_the_victim(**fast, n_chirps=300, period_s=1e5)])
    assert abs(dc.simulate(NOTHING, slow, impairments=[few])).max() > 0


def test_a_radome_weakens_interference_once_and_leakage_after_it_not_at_all(radar):
    other, radome = Interference(interferers=[like_the_victim()]), Radome(loss=4.0)
    plain = dc.simulate(NOTHING, radar, impairments=[other])
    behind = dc.simulate(NOTHING, radar, impairments=[other, radome])
    inside = dc.simulate(NOTHING, radar, impairments=[radome, other])
    ratio = float(np.mean(abs(behind) ** 2) / np.mean(abs(plain) ** 2))
    # Half of the loss of both ways: 3 dB of 6.
    assert ratio == pytest.approx(0.5, rel=1e-5)
    assert (inside == plain).all()


def test_an_interferer_that_is_never_in_the_band_is_told_of(radar):
    below = like_the_victim(start_frequency_hz=76e9, name="truck")
    with pytest.warns(dc.PhysicsWarning, match=r"interferers.truck: sends from 76 to 76.6 GHz"):
        cube = dc.simulate(NOTHING, radar, impairments=[Interference(interferers=[below])])
    assert (cube == 0).all()
    with pytest.warns(dc.PhysicsWarning, match=r"interferers.interferer-2: sends from 78"):
        above = like_the_victim(start_frequency_hz=78e9)
        Interference(interferers=[like_the_victim(), above]).check(NOTHING, radar)


def test_an_interferer_on_the_radar_is_refused(radar):
    with pytest.raises(
        dc.InvalidSetting,
        match=r"interferers.car.position: at the position of"
        r" the radar",
    ):
        here = like_the_victim(position_m=(0, 0, 0), name="car")
        Interference(interferers=[here]).check(NOTHING, radar)


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
        ({"period_s": 1e-3}, "n_chirps: none, with a period"),
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
def test_an_interferer_that_cannot_be_is_refused(fields, setting):
    with pytest.raises(dc.InvalidSetting, match=f"Interferer.{setting}"):
        like_the_victim(**fields)


@pytest.mark.parametrize(
    ("fields", "setting"),
    [
        ({"interferers": []}, "interferers"),
        ({"interferers": like_the_victim()}, "interferers"),
        ({"interferers": [like_the_victim(name="a")] * 2}, "2 interferers named a"),
        ({"interferers": [like_the_victim()], "filter_order": 0}, "filter_order"),
        ({"interferers": [like_the_victim()], "filter_corner": 0.0}, "filter_corner"),
    ],
)
def test_interference_that_cannot_be_is_refused(fields, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        Interference(**fields)
