"""What a user is told of targets that fold or echo late, and scenes that cannot be."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.scene.folding import seen
from dechirp.scene.scene import surprises


def ahead(range_m, velocity_m_per_s=0.0, name="car"):
    """A scene of one target straight ahead that recedes."""
    target = dc.Target(
        name=name, position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0)
    )
    return dc.Scene(targets=[target])


def sampled(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def early(radar):
    """The radar with sampling from 4.8 us on: no echo from within 700 m comes late."""
    chirp = replace(radar.frame.chirp, adc_start_s=4.8e-6, ramp_duration_s=32e-6)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


# 75 m (37.5 m real) and 27.7 m/s are unambiguous, and the coupling is 3.9 mm for each m/s.
FOLDING = [
    ("complex", 30.0, 40.0, ["velocity"]),
    ("complex", 90.0, -3.0, ["position"]),
    ("complex", 74.94, 20.0, ["position"]),
    ("complex", 90.0, 40.0, ["velocity", "position"]),
    ("real", 30.0, -40.0, ["velocity"]),
    ("real", 45.0, 40.0, ["velocity", "position"]),
    ("real", 45.0, 5.0, ["position"]),
    ("real", 45.0, -20.0, ["position"]),
    ("real", 100.0, 5.0, ["position"]),
]


@pytest.mark.parametrize(("sampling", "range_m", "velocity", "limits"), FOLDING)
def test_a_target_that_folds_is_detected_where_the_warning_says(
    radar, sampling, range_m, velocity, limits
):
    radar, scene = sampled(radar, sampling), ahead(range_m, velocity)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        cube = dc.simulate(scene, radar, impairments=[dc.WhiteNoise(snr=1.0)])
    place = seen(dc.truth(scene, radar), radar)
    told = surprises(scene, radar)

    found = dc.detect(cube, radar).sortby("snr").isel(detection=-1)
    # Standard errors are 0.6 mm and 1 mm/s. A range moves by 1 % of a cell in the frame.
    assert float(found.range) == pytest.approx(place.range_m.item(), abs=5e-3)
    assert float(found.velocity) == pytest.approx(place.velocity_m_per_s.item(), abs=1e-2)
    assert [finding.setting for finding in told] == [f"scene.targets.car.{x}" for x in limits]
    where = f"folds to {place.range_m.item():.4g} m at {place.velocity_m_per_s.item():.4g} m/s"
    assert all(finding.got.endswith(where) for finding in told)


def test_the_mirror_half_of_a_real_spectrum_turns_the_sign_of_the_velocity(radar):
    radar = sampled(radar, "real")
    slow, fast = (seen(dc.truth(ahead(45.0, v), radar), radar) for v in (5.0, 40.0))

    # 45 m is 37.5 m and 7.5 m: its mirror lies 7.5 m below 37.5 m, to a centimetre or so.
    assert slow.range_m.item() == pytest.approx(30.0, abs=0.1)
    assert slow.velocity_m_per_s.item() == pytest.approx(-5.0, abs=1e-3)
    # 40 m/s turned to -40 m/s, and 55.4 m/s added.
    folded = 2 * radar.frame.max_velocity_m_per_s - 40.0
    assert fast.velocity_m_per_s.item() == pytest.approx(folded, abs=5e-3)


def test_the_range_of_a_fold_is_free_of_coupling(radar):
    chirp = radar.frame.chirp
    folded = seen(dc.truth(ahead(90.0, 20.0), radar), radar)

    # Half a frame at 20 m/s, 2.24 ms of it, moves it on by 45 mm.
    on_m = 20.0 * radar.frame.mid_frame_s
    assert folded.range_m.item() == pytest.approx(90.0 + on_m - chirp.max_range_m, abs=1e-6)


def test_a_target_within_the_limits_is_seen_where_it_is(radar):
    for sampling in ("complex", "real"):
        known = dc.truth(ahead(30.0, -20.0), sampled(radar, sampling))
        place = seen(known, sampled(radar, sampling))

        assert place.range_m.item() == pytest.approx(known.range.item(), rel=1e-12)
        assert place.velocity_m_per_s.item() == pytest.approx(known.velocity.item(), rel=1e-12)
    assert surprises(ahead(30.0, -20.0), early(radar)) == []


def test_a_target_that_folds_in_the_last_frame_only_is_announced(radar):
    radar = replace(early(radar), frame=replace(early(radar).frame, period_s=0.05))
    # At 20 m/s, 70 m become 79 m in 0.45 s: beyond 74.9 m.
    scene = ahead(70.0, 20.0)

    assert surprises(scene, radar) == []
    (finding,) = surprises(scene, radar, n_frames=10)
    assert finding.setting == "scene.targets.car.position"
    assert "at 20 m/s in frame 9 folds to 4." in finding.got
    with pytest.warns(dc.PhysicsWarning, match="in frame 9 folds to 4."):
        dc.simulate(scene, radar, impairments=(), n_frames=10)


def test_a_target_that_folds_in_every_frame_is_announced_once(radar):
    (finding,) = surprises(ahead(90.0, -1.0), early(radar), n_frames=5)

    assert "in frame 0" in finding.got


def test_an_echo_that_comes_late_in_the_last_frame_only_is_announced(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    # Sampling begins after 2 us, the delay of 299.8 m.
    echo = [f for f in surprises(ahead(290.0, 20.0), radar, n_frames=2) if "echo" in f.got]

    assert [finding.got.split(",")[0] for finding in echo] == [
        "echo arrives 2.068 us after ramp start in frame 1"
    ]


@pytest.mark.parametrize("position_m", [(1e200, 0, 0), (0, -2e9, 0)])
def test_a_target_beyond_the_moon_is_refused(position_m):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.position_m .*from -1e\+09 to 1e\+09"):
        dc.Target(position_m=position_m)


@pytest.mark.parametrize("rcs_m2", [1e-13, 1e13])
def test_a_cross_section_of_no_thing_is_refused(rcs_m2):
    with pytest.raises(dc.InvalidSetting, match=r"from 1e-12 to 1e\+12\. Check the unit"):
        dc.Target(position_m=(1, 0, 0), rcs_m2=rcs_m2)


def test_neither_target_nor_radar_may_come_near_the_speed_of_light():
    for make in (lambda v: dc.Target(position_m=(1, 0, 0), velocity_m_per_s=v), _ego):
        with pytest.raises(dc.InvalidSetting, match="a thousandth of that of light"):
            make((3e5, 0, 0))
        with pytest.raises(dc.InvalidSetting, match=r"velocity_m_per_s is 1e\+200 m/s"):
            make((1e200, 0, 0))


def _ego(velocity_m_per_s):
    return dc.Ego(velocity_m_per_s=velocity_m_per_s)


def test_a_target_nearer_than_a_micrometre_is_on_the_radar(radar):
    # The square of 1e-200 m is zero: its power would be infinite.
    with pytest.raises(dc.InvalidSetting, match="on the radar"):
        dc.truth(ahead(1e-200), radar)


@pytest.mark.parametrize("name", [3, "", b"car"])
def test_a_name_that_is_no_text_is_refused(name):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.name"):
        dc.Target(name=name, position_m=(1, 0, 0))


@pytest.mark.parametrize("targets", [dc.Target(position_m=(1, 0, 0)), None, [(1, 0, 0)], "car"])
def test_targets_of_a_scene_are_a_list_of_targets(targets):
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.targets.*a list of targets"):
        dc.Scene(targets=targets)


def test_a_scene_takes_any_collection_of_targets():
    targets = [dc.Target(position_m=(x, 0, 0)) for x in (1, 2)]

    assert dc.Scene(targets=iter(targets)).targets == tuple(targets)


@pytest.mark.parametrize("n_frames", [0, -1, 1.5, np.nan])
def test_the_truth_about_no_count_of_frames_is_refused(radar, n_frames):
    with pytest.raises(dc.InvalidSetting, match=r"n_frames is .*a whole number from 1"):
        dc.truth(ahead(10.0), radar, n_frames=n_frames)
