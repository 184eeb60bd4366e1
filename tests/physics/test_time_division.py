"""Transmitters that take turns: what is sampled, and what is found in it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.core.units import to_decibels
from dechirp.experiments.link_budget import link_budget
from dechirp.processing.spectrum import Transform, range_profiles
from dechirp.processing.virtual_array import split_slots
from dechirp.radar.estimation_bounds import crlb_standard_errors
from noise import alarms, noisy


def taking_turns(radar, *order, n_chirps=None):
    """The radar with transmitters two wavelengths apart, sending in that order."""
    tx_m = [(0, 0.0078 * k, 0) for k in range(len(order))]
    frame = replace(
        radar.frame,
        n_chirps=n_chirps or radar.frame.n_chirps,
        multiplexing=dc.multiplexing.Tdm(order=order),
    )
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def alone(radar, transmitter):
    """The radar with one of its transmitters, which sends as often as it does in its turn."""
    frame = replace(radar.frame, interval_s=radar.frame.repetition_s, multiplexing=None)
    array = replace(radar.array, tx_m=[radar.array.tx_m[transmitter]])
    return replace(radar, frame=frame, array=array)


def of(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


CROSSING = dc.Target(position_m=(20, 8, 1), velocity_m_per_s=(-3, 7, 0), rcs_m2=10)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("order", [(0, 1), (2, 0, 1)], ids=str)
def test_each_slot_holds_what_its_transmitter_alone_would_give(radar, order, sampling):
    radar = of(taking_turns(radar, *order, n_chirps=16), sampling)
    options = {"impairments": (), "dtype": np.complex128}
    cube = dc.simulate(dc.Scene(targets=[CROSSING]), radar, **options)

    assert cube.sizes["chirp"] == 16 * len(order)
    for slot, transmitter in enumerate(order):
        late_s = slot * radar.frame.interval_s
        later = replace(CROSSING, position_m=tuple(CROSSING.position_at_m(late_s)))
        one = dc.simulate(dc.Scene(targets=[later]), alone(radar, transmitter), **options)
        own = cube.isel(chirp=cube.transmitter.values == transmitter)
        # Positions are rounded at 20 m in double precision, 1e-11 rad of phase.
        np.testing.assert_allclose(own, one, rtol=0, atol=1e-9 * abs(one.values).max())
        np.testing.assert_allclose(own.chirp - late_s, one.chirp, atol=1e-15)


def test_chirps_say_which_transmitter_sent_them(radar):
    cube = dc.simulate(dc.Scene(), taking_turns(radar, 2, 0, 1, n_chirps=2))

    assert cube.transmitter.dims == ("chirp",)
    assert cube.transmitter.values.tolist() == [2, 0, 1, 2, 0, 1]
    assert cube.chirp.values == pytest.approx(35e-6 * np.arange(6))
    assert not dc.simulate(dc.Scene(), radar).transmitter.any()


@pytest.mark.parametrize("order", [(0, 1), (1, 0), (0, 1, 2), (2, 0, 1)], ids=str)
@pytest.mark.parametrize("share", [0.9, -0.4])
def test_a_moving_target_is_found_at_its_range_and_velocity(radar, order, share):
    radar = taking_turns(radar, *order, n_chirps=64)
    limit = radar.frame.chirp.wavelength_m / (4 * len(order) * 35e-6)
    assert radar.frame.max_velocity_m_per_s == pytest.approx(limit)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(share * limit, 0, 0), rcs_m2=10)
    scene = dc.Scene(targets=[target])
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    found = dc.detect(dc.simulate(scene, radar, seed=7), radar)

    assert found.sizes["detection"] == 1
    # Five standard errors, 0.4 mm and 0.7 mm/s each, and the paths from the other elements,
    # which are longer by y^2 / 2R at the most, 6 um.
    for name in ("range", "velocity"):
        allowed = 5 * found[f"{name}_std"].item() + 6e-6
        assert found[name].item() == pytest.approx(truth[name].item(), abs=allowed)
    # The noise level comes from 320 cells that a Hann window correlates: 0.2 dB.
    assert to_decibels(found.snr.item()) == pytest.approx(to_decibels(truth.snr.item()), abs=1)
    assert found.time.item() == truth.time.item() == radar.frame.mid_frame_s


def test_a_target_faster_than_the_turns_allow_folds_on_the_map_and_is_unfolded(radar):
    radar = taking_turns(radar, 0, 1)
    # 16 m/s are unambiguous for one transmitter, up to 27.7 m/s, but not for two.
    target = dc.Target(name="car", position_m=(20, 0, 0), velocity_m_per_s=(16, 0, 0), rcs_m2=10)
    folded = 16 - 2 * radar.frame.max_velocity_m_per_s
    told = f"car.velocity.*is aliased to 20.* m at {folded:.1f}.*up to 27.* detections are unfolded"
    with pytest.warns(dc.PhysicsWarning, match=told):
        cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=2)
    power = dc.power_map(cube.isel(frame=0), radar, dc.Chain())
    peak = power.stack(cell=("velocity", "range")).idxmax().item()
    found = dc.detect(cube, radar)

    assert peak[0] == pytest.approx(folded, abs=radar.frame.velocity_resolution_m_per_s)
    assert found.ambiguity_number.item() == 1
    assert found.ambiguity_confidence.item() > 0.9999
    # Its standard error is below 1 mm/s; velocities fold at the wavelength of the echo.
    assert found.velocity.item() == pytest.approx(16, abs=0.01)
    # The coupling of a whole span of velocities, 0.11 m, went the right way.
    true_m = dc.truth(dc.Scene(targets=[target]), radar).range.item()
    assert found.range.item() == pytest.approx(true_m, abs=5 * found.range_std.item() + 1e-4)


@pytest.mark.parametrize("order", [(0, 1), (2, 0, 1)], ids=str)
def test_the_map_is_the_mean_of_the_maps_of_each_transmitter(radar, order):
    radar, chain = taking_turns(radar, *order, n_chirps=32), dc.Chain()
    scene = dc.Scene(targets=[CROSSING])
    cube = dc.simulate(scene, radar, seed=3).isel(frame=0)

    whole = dc.power_map(cube, radar, chain)
    each = [
        dc.power_map(cube.isel(chirp=cube.transmitter.values == k), alone(radar, k), chain)
        for k in range(len(order))
    ]

    np.testing.assert_allclose(whole, sum(each) / len(order), rtol=1e-5)
    np.testing.assert_allclose(whole.velocity, each[0].velocity)


def test_errors_reach_the_bounds_of_all_transmitters_together(radar):
    chirp = replace(radar.frame.chirp, n_samples=64)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    radar = taking_turns(radar, 1, 0, n_chirps=32)
    target = dc.Target(position_m=(13.37, 0, 0), velocity_m_per_s=(-7.3, 0, 0))
    scene = dc.Scene(targets=[target])
    clean, truth = dc.simulate(scene, radar, impairments=()), dc.truth(scene, radar)
    ranges, velocities = crlb_standard_errors(
        radar.frame, snr=0.1 * chirp.n_samples * 32 * radar.n_channels
    )
    rng = np.random.default_rng(4)
    small = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=8, velocity=6),
        false_alarm_probability=1e-6,
    )
    errors = []
    for _ in range(400):
        found = dc.detect(noisy(clean, -10, rng), radar, dc.Chain(cfar=small)).isel(detection=0)
        errors.append(
            (
                (found.range.item() - truth.range.item()) / ranges,
                (found.velocity.item() - truth.velocity.item()) / velocities,
            )
        )

    # The mean of 400 squares of unit normal numbers: 7 % each; five of them.
    assert np.mean(np.square(errors), axis=0) == pytest.approx(1, abs=0.35)


def test_false_alarms_of_two_transmitters_and_two_receivers_come_as_designed(radar):
    chirp = replace(radar.frame.chirp, n_samples=64)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    radar = taking_turns(radar, 1, 0, n_chirps=64)
    assert radar.n_channels == 4
    hits, trials = alarms(radar, np.random.default_rng(5), n_frames=400)

    # Independent cells: binomial, but for the training cells that neighbours share. Those
    # make thresholds scatter by 2 % together, alarms by 18 %, 0.6 of them at a time: 2 % more
    # variance. So outside this interval, of 1e-7 for exact binomial counts, once in 1e6.
    low, high = binom.interval(1 - 1e-7, trials, 1e-3)
    assert low <= hits <= high


def test_the_link_budget_counts_every_channel(radar):
    radar = taking_turns(radar, 0, 1)
    target = dc.Target(position_m=(20, 0, 0), velocity_m_per_s=(5, 0, 0), rcs_m2=1)
    scenario = dc.Scenario(radar=radar, scene=dc.Scene(targets=[target]))
    levels = {line.name: line.level_db for line in link_budget(scenario, radar)}

    assert radar.integration_gain == 256 * 128 * 2 * 2
    assert levels["integration"] == pytest.approx(to_decibels(256 * 128 * 4))
    assert levels["channels"] == pytest.approx(to_decibels(1 / 4))
    chain, clean = scenario.chain, dc.simulate(scenario.scene, radar, impairments=())
    noise = dc.simulate(dc.Scene(), radar, seed=6)
    echo_w = dc.power_map(clean.isel(frame=0), radar, chain).max().item()
    noise_w = dc.power_map(noise.isel(frame=0), radar, chain).mean().item()
    # Mean of 32,768 cells of four channels: 0.02 dB for a Hann window.
    assert levels["SNR in the map"] == pytest.approx(to_decibels(echo_w / noise_w), abs=0.1)


def test_channels_are_ordered_by_slot_and_then_by_receiver(radar):
    frame = taking_turns(radar, 2, 0, 1, n_chirps=4).frame
    tag = np.array([2, 0, 1] * 4)[:, None] * 10 + np.arange(2)
    samples = np.broadcast_to(tag[..., None], (12, 2, 5)).copy()

    parted = split_slots(samples, frame)

    assert parted.shape == (4, 6, 5)
    assert parted[3, :, 4].tolist() == [20, 21, 0, 1, 10, 11]


def test_no_sample_is_copied_where_the_order_is_that_of_the_array(radar):
    for order in ((0,), (0, 1, 2), (1, 0)):
        frame = taking_turns(radar, *order, n_chirps=4).frame
        samples = np.zeros((4 * len(order), 2, 8), np.complex64)

        assert np.shares_memory(split_slots(samples, frame), samples)


def test_range_profiles_keep_the_transmitter_of_each_chirp(radar):
    cube = dc.simulate(dc.Scene(targets=[CROSSING]), taking_turns(radar, 1, 0, n_chirps=4))
    transform = Transform(window="hann", n_points=256, n_bins=256)

    profiles = range_profiles(cube, radar.frame.chirp, transform)

    assert profiles.sizes["chirp"] == 8
    assert profiles.transmitter.equals(cube.transmitter)


def test_a_cube_with_the_chirps_of_one_transmitter_alone_is_refused(radar):
    cube = dc.simulate(dc.Scene(), radar)

    with pytest.raises(dc.InvalidSetting, match="128 along chirp; expected 256"):
        dc.detect(cube, taking_turns(radar, 0, 1))
