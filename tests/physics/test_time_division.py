"""Time-division multiplexing (TDM): samples, velocities, maps and detection."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.experiments.link_budget import link_budget_of_first_target
from dechirp.processing.chain_findings import chain_findings
from dechirp.processing.spectrum import Transform, range_profiles
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from nightly import nightly
from noise_cubes import add_noise, count_false_alarms


def apply_tdm(radar, *order, n_chirps=None):
    """Build the radar with transmitters two wavelengths apart under TDM in that order."""
    tx_m = [(0, 0.0078 * k, 0) for k in range(len(order))]
    frame = replace(
        radar.frame,
        n_chirps=n_chirps or radar.frame.n_chirps,
        multiplexing=dc.multiplexing.Tdm(order=order),
    )
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def select_transmitter(radar, transmitter):
    """Reduce the radar to one transmitter, with the same repetition interval as under TDM."""
    frame = replace(radar.frame, interval_s=radar.frame.repetition_s, multiplexing=None)
    array = replace(radar.array, tx_m=[radar.array.tx_m[transmitter]])
    return replace(radar, frame=frame, array=array)


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


CROSSING_TARGET = dc.Target(position_m=(20, 8, 1), velocity_m_per_s=(-3, 7, 0), rcs_m2=10)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("order", [(0, 1), (2, 0, 1)], ids=str)
def test_each_tdm_slot_equals_single_transmitter_simulation(radar, order, sampling):
    radar = set_sampling(apply_tdm(radar, *order, n_chirps=16), sampling)
    options = {"impairments": (), "dtype": np.complex128}
    cube = dc.simulate(dc.Scene(targets=[CROSSING_TARGET]), radar, **options)

    assert cube.sizes["chirp"] == 16 * len(order)
    for slot, transmitter in enumerate(order):
        slot_delay_s = slot * radar.frame.interval_s
        shifted_target = replace(
            CROSSING_TARGET, position_m=tuple(CROSSING_TARGET.position_at_m(slot_delay_s))
        )
        expected = dc.simulate(
            dc.Scene(targets=[shifted_target]), select_transmitter(radar, transmitter), **options
        )
        slot_cube = cube.isel(chirp=cube.transmitter.values == transmitter)
        # Rounding of 20 m in double precision: 1e-11 rad of phase.
        np.testing.assert_allclose(
            slot_cube, expected, rtol=0, atol=1e-9 * abs(expected.values).max()
        )
        np.testing.assert_allclose(slot_cube.chirp - slot_delay_s, expected.chirp, atol=1e-15)


def test_chirps_are_labelled_with_their_transmitter(radar):
    cube = dc.simulate(dc.Scene(), apply_tdm(radar, 2, 0, 1, n_chirps=2))

    assert cube.transmitter.dims == ("chirp",)
    assert cube.transmitter.values.tolist() == [2, 0, 1, 2, 0, 1]
    assert cube.chirp.values == pytest.approx(35e-6 * np.arange(6))
    assert not dc.simulate(dc.Scene(), radar).transmitter.any()


@pytest.mark.parametrize("order", [(0, 1), (1, 0), (0, 1, 2), (2, 0, 1)], ids=str)
@pytest.mark.parametrize("share", [0.9, -0.4])
def test_moving_target_is_detected_at_its_range_and_velocity(radar, order, share):
    radar = apply_tdm(radar, *order, n_chirps=64)
    limit = radar.frame.chirp.wavelength_m / (4 * len(order) * 35e-6)
    assert radar.frame.max_velocity_m_per_s == pytest.approx(limit)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(share * limit, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    detections = dc.detect(dc.simulate(scene, radar, seed=7), radar)

    assert detections.sizes["detection"] == 1
    # Five standard errors, 0.4 mm and 0.7 mm/s each, plus the longer paths of other elements, at
    # most y^2 / 2R = 6 um.
    for name in ("range", "velocity"):
        tolerance = 5 * detections[f"{name}_std"].item() + 6e-6
        assert detections[name].item() == pytest.approx(truth[name].item(), abs=tolerance)
    # The noise level is estimated from 320 cells correlated by a Hann window: 0.2 dB.
    assert to_decibels(detections.snr.item()) == pytest.approx(to_decibels(truth.snr.item()), abs=1)
    assert detections.time.item() == truth.time.item() == radar.frame.mid_frame_s


def test_aliased_tdm_velocity_is_resolved(radar):
    radar = apply_tdm(radar, 0, 1)
    # 16 m/s are unambiguous for one transmitter, up to 27.7 m/s, but not for two.
    target = dc.Target(name="car", position_m=(20, 0, 0), velocity_m_per_s=(16, 0, 0), rcs_m2=10)
    alias = 16 - 2 * radar.frame.max_velocity_m_per_s
    message = f"car.velocity.*is aliased to 20.* m at {alias:.1f}.*resolve velocities up to 27"
    with pytest.warns(dc.PhysicsWarning, match=message):
        cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=2)
    power = dc.power_map(cube.isel(frame=0), radar, dc.Chain())
    peak = power.stack(cell=("velocity", "range")).idxmax().item()
    detections = dc.detect(cube, radar)

    assert peak[0] == pytest.approx(alias, abs=radar.frame.velocity_resolution_m_per_s)
    assert detections.ambiguity_number.item() == 1
    assert detections.ambiguity_confidence.item() > 0.9999
    # Standard error below 1 mm/s; the ambiguity span depends on the wavelength of the echo.
    assert detections.velocity.item() == pytest.approx(16, abs=0.01)
    # Range-Doppler coupling of one velocity span, 0.11 m, is corrected with the right sign.
    true_m = dc.truth(dc.Scene(targets=[target]), radar).range.item()
    assert detections.range.item() == pytest.approx(
        true_m, abs=5 * detections.range_std.item() + 1e-4
    )


@pytest.mark.parametrize("order", [(0, 1), (2, 0, 1)], ids=str)
def test_power_map_is_mean_over_transmitters(radar, order):
    radar, chain = apply_tdm(radar, *order, n_chirps=32), dc.Chain()
    scene = dc.Scene(targets=[CROSSING_TARGET])
    cube = dc.simulate(scene, radar, seed=3).isel(frame=0)

    power = dc.power_map(cube, radar, chain)
    single_powers = [
        dc.power_map(
            cube.isel(chirp=cube.transmitter.values == k), select_transmitter(radar, k), chain
        )
        for k in range(len(order))
    ]

    np.testing.assert_allclose(power, sum(single_powers) / len(order), rtol=1e-5)
    np.testing.assert_allclose(power.velocity, single_powers[0].velocity)


@nightly
def test_errors_reach_bounds_of_all_transmitters(radar):
    chirp = replace(radar.frame.chirp, n_samples=64)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    radar = apply_tdm(radar, 1, 0, n_chirps=32)
    target = dc.Target(position_m=(13.37, 0, 0), velocity_m_per_s=(-7.3, 0, 0))
    scene = dc.Scene(targets=[target])
    clean, truth = dc.simulate(scene, radar, impairments=()), dc.truth(scene, radar)
    range_std, velocity_std = range_and_velocity_crlb_std(
        radar.frame, snr=0.1 * chirp.n_samples * 32 * radar.n_channels
    )
    rng = np.random.default_rng(4)
    small_cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=8, velocity=6),
        false_alarm_probability=1e-6,
    )
    errors = []
    for _ in range(200):
        detection = dc.detect(add_noise(clean, -10, rng), radar, dc.Chain(cfar=small_cfar)).isel(
            detection=0
        )
        errors.append(
            (
                (detection.range.item() - truth.range.item()) / range_std,
                (detection.velocity.item() - truth.velocity.item()) / velocity_std,
            )
        )

    # Mean of 200 squares of unit normal numbers: five standard errors of 10 %.
    assert np.mean(np.square(errors), axis=0) == pytest.approx(1, abs=0.5)


@nightly
def test_false_alarm_rate_of_four_channels_matches_design(radar):
    chirp = replace(radar.frame.chirp, n_samples=64)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    radar = apply_tdm(radar, 1, 0, n_chirps=64)
    assert radar.n_channels == 4
    hits, trials = count_false_alarms(radar, np.random.default_rng(5), n_frames=400)

    # Independent cells: binomial, except for training cells shared by neighbours. Shared cells
    # vary thresholds jointly by 2 %, alarms by 18 %, 0.6 alarms at a time: 2 % more variance. The
    # count leaves this interval, 1e-7 for exact binomial counts, once in 1e6.
    low, high = binom.interval(1 - 1e-7, trials, 1e-3)
    assert low <= hits <= high


def test_link_budget_includes_every_channel(radar):
    radar = apply_tdm(radar, 0, 1)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(5, 0, 0), rcs_m2=1)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[target]))
    levels = {line.name: line.level_db for line in link_budget_of_first_target(scenario, radar)}

    assert radar.integration_gain == 256 * 128 * 2 * 2
    assert levels["integration"] == pytest.approx(to_decibels(256 * 128 * 4))
    assert levels["channels"] == pytest.approx(to_decibels(1 / 4))
    chain, clean = scenario.chain, dc.simulate(scenario.scene, radar, impairments=())
    noise = dc.simulate(dc.Scene(), radar, seed=6)
    echo_w = dc.power_map(clean.isel(frame=0), radar, chain).max().item()
    noise_w = dc.power_map(noise.isel(frame=0), radar, chain).mean().item()
    # Mean of 32,768 cells of four channels: 0.02 dB for a Hann window.
    assert levels["SNR in the map"] == pytest.approx(to_decibels(echo_w / noise_w), abs=0.1)


def test_channels_are_ordered_by_slot_then_receiver(radar):
    frame = apply_tdm(radar, 2, 0, 1, n_chirps=4).frame
    tag = np.array([2, 0, 1] * 4)[:, None] * 10 + np.arange(2)
    samples = np.broadcast_to(tag[..., None], (12, 2, 5)).copy()

    channels = split_chirps_into_slots(samples, frame)

    assert channels.shape == (4, 6, 5)
    assert channels[3, :, 4].tolist() == [20, 21, 0, 1, 10, 11]


def test_split_slots_returns_view(radar):
    for order in ((0,), (0, 1, 2), (1, 0)):
        frame = apply_tdm(radar, *order, n_chirps=4).frame
        samples = np.zeros((4 * len(order), 2, 8), np.complex64)

        assert np.shares_memory(split_chirps_into_slots(samples, frame), samples)


def test_range_profiles_keep_transmitter_labels(radar):
    cube = dc.simulate(dc.Scene(targets=[CROSSING_TARGET]), apply_tdm(radar, 1, 0, n_chirps=4))
    transform = Transform(window="hann", n_points=256, n_bins=256)

    profiles = range_profiles(cube, radar.frame.chirp, transform)

    assert profiles.sizes["chirp"] == 8
    assert profiles.transmitter.equals(cube.transmitter)


def test_rejects_cube_with_chirps_of_one_transmitter(radar):
    cube = dc.simulate(dc.Scene(), radar)

    with pytest.raises(dc.InvalidSetting, match="128 along chirp; expected 256"):
        dc.detect(cube, apply_tdm(radar, 0, 1))


def test_one_round_gives_directions_of_static_targets_and_a_finding_on_motion(radar):
    radar = apply_tdm(radar, 0, 1, 2, n_chirps=1)
    chain = dc.Chain().fit_to_radar(radar)
    azimuth_rad = np.radians(25)
    position_m = (20 * np.cos(azimuth_rad), 20 * np.sin(azimuth_rad), 0)
    target = dc.Target(position_m=position_m, rcs_m2=10)

    clean = dc.simulate(dc.Scene(targets=[target]), radar, impairments=())
    rng = np.random.default_rng(7)
    errors = []
    for _ in range(200):
        found = dc.detect(add_noise(clean, 10, rng), radar, chain).isel(detection=0)
        errors.append((found.azimuth.item() - azimuth_rad) / found.azimuth_std.item())

    # The mean of 200 squares varies by 10 %; five of them, and 10 % by the noise estimate.
    assert np.mean(np.square(errors)) == pytest.approx(1, abs=0.6)
    (finding,) = (f for f in chain_findings(radar, chain) if f.setting == "radar.frame.n_chirps")
    # 4 pi v t / lambda over the two intervals between three slots, at 1 m/s.
    turn_deg = np.degrees(4 * np.pi * 2 * radar.frame.interval_s / radar.frame.chirp.wavelength_m)
    assert f"{turn_deg:.3g} degrees" in finding.value and finding.level == "warning"
    two_rounds = apply_tdm(radar, 0, 1, 2, n_chirps=2)
    assert not [f for f in chain_findings(two_rounds, chain) if f.setting == "radar.frame.n_chirps"]
