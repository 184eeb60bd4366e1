"""Runs of several radars on one vehicle: poses, clocks, mutual interference, fused tracks."""

import csv
import json
import math
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.compilation_notice import announced_compilation
from dechirp.cli.main import main
from dechirp.cli.several_radars import (
    AnnouncingExecutor,
    run_several_radars,
    write_radars_results,
)
from dechirp.core.compiled_kernels import compilation_listeners
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.evaluation.nees import mean_nees_interval
from dechirp.evaluation.traffic_scores import score_track_consistency
from dechirp.experiments.scenario import RecordingSource, check_single_radar
from dechirp.experiments.single_radars import ego_of_mounted_radar, split_radars
from dechirp.experiments.study.executors import Workers
from dechirp.studio.scenario_edits import PageLimits, check_scenario_within_limits
from nightly import nightly, nightly_except

FAST = ["traffic.ego=1", "radar.frame.n_chirps=32", "traffic.duration=0.2 s"]
PAIR = "radars=[{mount: front-left}, {mount: front-right, start_offset: 20 ms}]"
# Car 1 drives at 10 m/s past car 2, which drives at 12 m/s, 20 m ahead.
TRACE = """time,id,class,x,y,heading,length,width,height
0.0,1,car,100,50,0,4.5,1.8,1.5
0.4,1,car,104,50,0,4.5,1.8,1.5
0.0,2,car,120,50.5,0,4.5,1.8,1.5
0.4,2,car,124.8,50.5,0,4.5,1.8,1.5
"""


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = tmp_path_factory.mktemp("radars") / "trace.csv"
    path.write_text(TRACE, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def radar(trace):
    return dc.traffic.traffic_scenario(trace, FAST).radar


@pytest.fixture(scope="module", params=nightly_except(["statistical"], ["samples", "statistical"]))
def result(request, trace):
    scenario = dc.traffic.traffic_scenario(trace, [*FAST, PAIR])
    with ThreadPoolExecutor(1) as executor:
        return dc.fusion.run_radars(scenario, kind=request.param, executor=executor)


def test_fused_track_follows_object_over_the_ground(result):
    assert list(result.radars) == ["front-left", "front-right"]
    assert result.tracks["radar"].values.tolist() == ["front-left", "front-right"] * 4
    mid_frame_s = result.radars["front-left"].times_s[0]
    assert result.tracks["time"].values[:2] == pytest.approx([mid_frame_s, mid_frame_s + 0.02])
    objects = result.objects
    assert objects["target"].values.tolist() == ["car-2"]
    times_s = objects["time"].values
    assert objects["centre_x"].values[0] == pytest.approx(120 + 12 * times_s, abs=1e-6)
    assert objects["vx"].values[0] == pytest.approx(12, abs=1e-6)
    assert objects["x"].values[0] == pytest.approx(120 - 2.25 + 12 * times_s, abs=1e-6)
    assert objects["in_view"].values.all()
    # Scatterers of the rear are within the car, its clusters within its width.
    (track,) = range(result.tracks.sizes["track"])
    last = result.tracks.isel(track=track, frame=-1)
    assert objects["x"].values[0, -1] - 0.4 < last["x"] < objects["x"].values[0, -1] + 2.25
    assert abs(last["y"] - 50.5) < 0.9 + 0.4
    # A velocity cell of 32 chirps is 1.4 m/s; the radars look at 45 degrees past the car.
    assert last["vx"] == pytest.approx(12, abs=1.4 / 2)


def test_fused_tracks_have_axes_of_the_vehicle_for_its_bus(result):
    ground, on_vehicle = result.tracks, dc.fusion.convert_tracks_to_vehicle_axes(result)
    times_s = ground["time"].values
    assert on_vehicle["x"].values == pytest.approx(
        ground["x"].values - 100 - 10 * times_s, abs=1e-6, nan_ok=True
    )
    assert on_vehicle["y"].values == pytest.approx(ground["y"].values - 50, abs=1e-6, nan_ok=True)
    assert on_vehicle["vx"].values == pytest.approx(ground["vx"].values - 10, abs=1e-6, nan_ok=True)
    covariance = ground["covariance"].values
    assert on_vehicle["covariance"].values == pytest.approx(covariance, abs=1e-9, nan_ok=True)
    with pytest.raises(InvalidSetting, match="add a tracker"):
        dc.fusion.convert_tracks_to_vehicle_axes(replace(result, tracks=None))


def test_axes_of_a_turning_vehicle_turn_with_it(result):
    # A vehicle on a circle, and an object at rest in its axes. The other tracks each differ in one
    # element of the state, so that their differences are the columns of the Jacobian matrix.
    turn_rate, radius_m, place_m, period_s = 0.3, 40.0, np.array([10.0, 3.0]), 0.1
    n_frames, mounting = 5, result.mountings["front-left"]
    times_s = period_s * np.arange(n_frames)
    poses, states = [], []
    for yaw_rad in turn_rate * times_s:
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        axes, turned_axes = np.array([[c, -s], [s, c]]), np.array([[-s, -c], [c, -s]])
        centre_m, velocity = radius_m * np.array([s, 1 - c]), turn_rate * radius_m * axes[:, 0]
        arm_m = np.array(mounting.position_m[:2])
        poses.append(
            dc.fusion.RadarPose(
                position_m=tuple(centre_m + axes @ arm_m),
                yaw_rad=yaw_rad + mounting.yaw_rad,
                velocity_m_per_s=tuple(velocity + turn_rate * turned_axes @ arm_m),
            )
        )
        object_velocity = velocity + turn_rate * turned_axes @ place_m
        states.append([*(centre_m + axes @ place_m), *object_velocity])
    tracks = np.array(states) + np.concatenate([np.zeros((1, 4)), np.eye(4)])[:, None]
    factor = np.random.default_rng(5).normal(size=(5, n_frames, 4, 4))
    covariance = factor @ np.swapaxes(factor, -1, -2)
    names, dims = ["x", "y", "vx", "vy"], ("track", "frame")
    axes = {"state": ["x", "vx", "y", "vy"], "other_state": ["x", "vx", "y", "vy"]}  # of a tracker
    ground = xr.DataArray(covariance, axes, dims=(*dims, *axes))
    dataset = xr.Dataset(
        {name: (dims, tracks[..., index]) for index, name in enumerate(names)}
        | {"covariance": ground},
        coords={
            "time": ("frame", times_s),
            "radar": ("frame", ["front-left"] * n_frames),
            "radar_frame": ("frame", range(n_frames)),
        },
    )
    turning = replace(result, tracks=dataset, poses={"front-left": tuple(poses)})

    on_vehicle = dc.fusion.convert_tracks_to_vehicle_axes(turning)

    state = np.stack([on_vehicle[name].values for name in names], axis=-1)
    for frame in range(n_frames):
        assert state[0, frame] == pytest.approx([*place_m, 0, 0], abs=1e-9)
        jacobian = (state[1:, frame] - state[0, frame]).T
        given, converted = (
            array.isel(frame=frame).sel(state=names, other_state=names).values
            for array in (ground, on_vehicle["covariance"])
        )
        assert converted == pytest.approx(jacobian @ given @ jacobian.T, rel=1e-9)


def test_tracks_at_one_time_are_one_list(result):
    times_s = np.repeat(result.tracks["time"].values[::2], 2)
    both = result.tracks.assign_coords(time=("frame", times_s))
    lists = dc.fusion.convert_tracks_to_vehicle_axes(replace(result, tracks=both))
    assert set(lists["radar"].values.tolist()) == {"front-right"}
    assert lists["time"].values.tolist() == times_s[::2].tolist()


def test_objects_of_each_radar_have_its_own_coordinates(result):
    left = result.radars["front-left"]
    pose = result.poses["front-left"][0]
    assert result.mountings["front-left"].position_m == (2.25, 0.9, 0.5)
    assert pose.position_m == pytest.approx((100 + 2.25 + 10 * left.times_s[0], 50.9), abs=1e-6)
    assert pose.velocity_m_per_s == pytest.approx((10, 0), abs=1e-6)
    # The nearest point of car 2 is straight ahead of the radar's place, which looks left.
    assert left.traffic["azimuth"].values[0] == pytest.approx(-math.pi / 4, abs=1e-6)
    assert left.tracks is None


def test_scenario_of_each_radar_repeats_its_result(request, result):
    own = result.radars["front-right"]
    again = dc.run(own.scenario, kind=request.node.callspec.params["result"])
    assert own.detections["range"].values.tolist() == again.detections["range"].values.tolist()


def test_hand_written_scene_is_seen_from_each_mount(radar):
    target_m = (25.0, 3.0, 0.5)
    scenario = dc.Scenario(
        radars=(
            dc.fusion.MountedRadar(mount="front-left"),
            dc.fusion.MountedRadar(mount="front-right", start_offset_s=0.01),
        ),
        radar=radar,
        scene=dc.Scene(
            targets=(dc.Target(position_m=target_m, rcs_m2=10.0),),
            ego=dc.Ego(position_m=(0.0, 0.0, 0.0), velocity_m_per_s=(5.0, 0.0, 0.0)),
        ),
        n_frames=4,
        tracker=dc.Tracker(),
    )

    with ThreadPoolExecutor(2) as executor:
        result = dc.fusion.run_radars(scenario, executor=executor)

    assert result.objects is None
    for name, yaw, side in (("front-left", 45, 0.9), ("front-right", -45, -0.9)):
        own = result.radars[name]
        offset_s = 0.01 * (name == "front-right")
        x = target_m[0] - 2.25 - 5 * (own.truth["time"].values + offset_s)
        expected = np.hypot(x, target_m[1] - side)
        assert own.truth["range"].values[0] == pytest.approx(expected, abs=1e-6)
        azimuth = np.arctan2(target_m[1] - side, x) - math.radians(yaw)
        assert own.truth["azimuth"].values[0] == pytest.approx(azimuth, abs=1e-6)
    assert result.tracks.sizes["track"] == 1
    last = result.tracks.isel(track=0, frame=-1)
    errors = np.array([last["x"] - 25, last["vx"], last["y"] - 3, last["vy"]])
    # Within five standard errors, and over the ground at rest.
    assert np.all(np.abs(errors) < 5 * np.sqrt(np.diagonal(last["covariance"].values)))


def test_mounted_radar_moves_with_its_turning_vehicle():
    vehicle = dc.Ego(
        position_m=(1.0, 2.0, 0.0),
        yaw_rad=0.3,
        velocity_m_per_s=(8.0, 3.0, 0.0),
        turn_rate_rad_per_s=0.5,
    )
    mounting = dc.Mounting(position_m=(2.0, -0.9, 0.5), yaw_rad=-0.8, pitch_rad=0.1, roll_rad=0.05)

    for time_s in (0.0, 0.7):
        moved = ego_of_mounted_radar(vehicle, mounting, time_s)
        for later_s in (0.0, 0.4):
            times_s = np.array([time_s + later_s])
            axes = vehicle.axes(times_s)[0]
            place_m = np.array(vehicle.position_m) + vehicle.displacements_m(times_s)[0]
            place_m = place_m + axes @ np.array(mounting.position_m)
            own_m = np.array(moved.position_m) + moved.displacements_m(np.array([later_s]))[0]
            assert own_m == pytest.approx(place_m, abs=1e-9)
            on_vehicle = dc.Ego(yaw_rad=-0.8, pitch_rad=0.1, roll_rad=0.05).axes(np.zeros(1))[0]
            own_axes = moved.axes(np.array([later_s]))[0]
            assert own_axes == pytest.approx(axes @ on_vehicle, abs=1e-9)


def pair_scenario(front, **second):
    """Return two forward radars 1 m apart, whose antennas radiate in all directions."""
    hardware = replace(front.hardware, antenna_gain=1.0, tx_pattern=None, rx_pattern=None)
    first = replace(front, hardware=hardware)
    poses = [dc.Mounting(position_m=(2.0, y, 0.5)) for y in (0.5, -0.5)]
    return dc.Scenario(
        radars=(
            dc.fusion.MountedRadar(name="left", pose=poses[0], radar=first),
            dc.fusion.MountedRadar(**{"name": "right", "pose": poses[1], "radar": first} | second),
        ),
        scene=dc.Scene(ego=dc.Ego(velocity_m_per_s=(20.0, 0.0, 0.0))),
    )


def test_radars_in_one_band_interfere_on_the_direct_path(radar):
    scenario = pair_scenario(radar, start_offset_s=1e-3, clock_error=-100e-6)

    singles, findings = split_radars(scenario)

    assert findings == ()
    left = singles["left"].scenario.impairments[0].interferers[0]
    assert (left.name, left.offset_s, left.position_m) == ("right", 1e-3, (0.0, -1.0, 0.0))
    # Its oscillator is slow: lower frequencies, longer intervals.
    chirp = radar.frame.chirp
    assert left.start_frequency_hz == pytest.approx(chirp.start_frequency_hz * (1 - 100e-6))
    assert left.interval_s == pytest.approx(radar.frame.interval_s / (1 - 100e-6), rel=1e-12)
    right = singles["right"].scenario.impairments[0].interferers[0]
    assert (right.offset_s, right.position_m) == (-1e-3, (0.0, 1.0, 0.0))
    # Friis: the power of the direct path, gains of 1, beats of 8 to 12 MHz, in the band of 20.
    own = replace(singles["left"].scenario, impairments=singles["left"].scenario.impairments[:1])
    same_start = replace(own.impairments[0], interferers=(replace(left, offset_s=0.0),))
    cube = dc.simulate(own.scene, own.radar, impairments=(same_start,), seed=1)
    power_w = np.mean(np.abs(cube.values[:, :3]) ** 2)
    expected_w = radar.hardware.transmit_power_w * (chirp.wavelength_m / (4 * math.pi)) ** 2
    assert power_w == pytest.approx(expected_w, rel=0.02)


def test_radars_in_other_bands_do_not_interfere(radar):
    chirp = radar.frame.chirp
    other = replace(
        radar,
        frame=replace(
            radar.frame,
            chirp=replace(chirp, start_frequency_hz=chirp.start_frequency_hz + 2e9),
        ),
        hardware=replace(radar.hardware, antenna_gain=1.0, tx_pattern=None, rx_pattern=None),
    )

    singles, _ = split_radars(pair_scenario(radar, radar=other))

    assert singles["left"].scenario.impairments == pair_scenario(radar).impairments


@pytest.mark.parametrize(
    ("radars", "message"),
    [
        ("[{mount: front-left}, {mount: front-left}]", "radars.1.name.*also that of radar 0"),
        ("[{mount: front}, {name: b, mount: front}]", "radars.1.mount.*within 2 cm"),
        ("[{mount: roof}]", "mount"),
        ("[{pose: {position: [0 m, 0 m, 1 m]}}]", "missing, with a pose"),
        ("[{name: a/b}]", "a folder name"),
        ("[{name: fused}]", "other than fused"),
        ("[{mount: front, start_offset: -1 s}]", "start_offset"),
        ("[{mount: front, clock_error: 0.1}]", "clock_error"),
        ("[{mount: front, clock_error: 5 dB}]", "clock_error.*50 ppm or 50e-6; .*fit: ppm, ppb"),
        ("[{mount: front, radar: missing.yaml}]", "missing.yaml"),
    ],
)
def test_rejects_invalid_radars(trace, radars, message):
    with pytest.raises(DechirpError, match=f"(?s){message}"):
        dc.traffic.traffic_scenario(trace, [*FAST, f"radars={radars}"])


@pytest.mark.parametrize("text", ["50 ppm", "50e-6", "50000 ppb"])
def test_clock_errors_are_parts_per_million_or_bare(trace, text):
    radars = f"radars=[{{mount: front, clock_error: {text}}}]"
    scenario = dc.traffic.traffic_scenario(trace, [*FAST, radars])
    assert scenario.radars[0].clock_error == 50e-6


@pytest.mark.parametrize(
    ("offset", "is_refused"), [("1 s", True), ("0.2 s", True), ("0.1 s", False)]
)
def test_start_offset_is_within_the_duration(trace, offset, is_refused):
    pair = f"radars=[{{mount: front-left}}, {{mount: front-right, start_offset: {offset}}}]"
    scenario = dc.traffic.traffic_scenario(trace, [*FAST, pair])

    if is_refused:
        message = f"^radars.1.start_offset: {offset.replace('0.2 s', '200 ms')}; expected less than"
        with pytest.raises(dc.InvalidSetting, match=message):
            split_radars(scenario)
    else:
        single = split_radars(scenario)[0]["front-right"].scenario
        assert single.traffic.duration_s == pytest.approx(0.1)


def test_rejects_missing_radar_and_recordings(radar):
    mounted = (dc.fusion.MountedRadar(),)
    with pytest.raises(DechirpError, match="radars.0.radar"):
        dc.Scenario(radars=mounted, scene=dc.Scene())
    with pytest.raises(DechirpError, match="given for a recording"):
        dc.Scenario(radars=mounted, radar=radar, recording=RecordingSource(path="capture.bin"))


def test_single_and_several_radars_have_their_own_functions(trace):
    scenario = dc.traffic.traffic_scenario(trace, [*FAST, PAIR])
    with pytest.raises(DechirpError, match="run_radars"):
        dc.run(scenario)
    with pytest.raises(DechirpError, match="run_radars"):
        dc.SensorModel(scenario)
    with pytest.raises(DechirpError, match="run_radars"):
        check_scenario_within_limits(scenario, PageLimits())
    grouped = replace(scenario, tracker=None, group_tracker=dc.group_tracking.GroupTracker())
    with pytest.raises(DechirpError, match="group_tracker: given for several radars"):
        dc.fusion.run_radars(grouped)
    single = replace(scenario, radars=())
    check_single_radar(single)
    with pytest.raises(DechirpError, match="empty"):
        dc.fusion.run_radars(single)
    with pytest.raises(DechirpError, match="in traffic statistical"):
        dc.run(dc.reference(), kind="statistical")


def run_command(*words):
    """Run a command, and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    return ended.value.code


def read_rows(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@nightly
@pytest.mark.parametrize("ego", [405, 451, 468, 475])
def test_stated_errors_of_tracks_in_recorded_traffic_are_honest(ego):
    # One draw of two axes for each of 10 to 15 vehicles; the seed is fixed. Where clusters join
    # vehicles side by side, the velocity on 468 has 2.7, outside the interval of 0.3 to 2.2.
    folder = os.environ.get("DECHIRP_WITNESS_DATA")
    path = Path(folder or "") / "commonroad_us101" / "USA_US101-4_1_T-1.xml"
    if not (folder and path.is_file()):
        pytest.skip("needs commonroad_us101 of DECHIRP_WITNESS_DATA")
    pair = "radars=[{mount: front-left}, {mount: front-right}]"
    scenario = dc.traffic.traffic_scenario(path, [f"traffic.ego={ego}", pair, "seed=1"])

    with ThreadPoolExecutor(1) as executor:
        result = dc.fusion.run_radars(scenario, kind="statistical", executor=executor)

    objects = result.objects.transpose("target", "frame")
    consistency = score_track_consistency(objects, objects["in_view"].values, result.tracks)
    assert consistency.n_objects >= 10
    low, high = mean_nees_interval(2, consistency.n_objects, outside_probability=1e-3)
    assert low / 2 < consistency.position_nees < high / 2
    assert low / 2 < consistency.velocity_nees < high / 2


@nightly
@pytest.mark.parametrize("result", ["statistical"], indirect=True)
def test_later_results_replace_earlier_ones(result, without_figures, tmp_path):
    out = tmp_path / "out"
    documents = [write_radars_results(result, source=None, out=out) for _ in range(2)]
    assert documents[0] == documents[1] == (out / "run.json").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@nightly
def test_command_writes_a_folder_for_each_radar_and_the_fused_tracks(
    trace, without_figures, tmp_path, capsys
):
    out = tmp_path / "out"
    options = ["--ego", "1", "--mount", "front-left", "--mount", "front-right", "--statistical"]
    changes = ["--set=radar.frame.n_chirps=32", "--set=traffic.duration=0.2 s"]

    assert run_command("run", str(trace), *options, *changes, "--out", str(out)) == 0

    screen = capsys.readouterr().out
    assert "front-right: 4 frames" in screen
    assert "mean GOSPA" in screen
    expected_nees = (
        "over 1 object. If the stated errors are right, 95 % of such runs have 0.03 to 3.69"
    )
    document = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert list(document["radars"]) == ["front-left", "front-right"]
    assert document["radars"]["front-right"]["mounting"]["position_m"] == [2.25, -0.9, 0.5]
    assert document["tracks"]
    for rows in (document["traffic"], read_rows(out / "traffic.csv")):
        assert [row["target"] for row in rows] == ["car-2"] * 8
        for row in rows:
            x_m = 120 + 12 * float(row["time_s"])
            assert float(row["centre_x_m"]) == pytest.approx(x_m, abs=1e-6)
            assert float(row["x_m"]) == pytest.approx(x_m - 2.25, abs=1e-6)
            assert float(row["vx_m_per_s"]) == pytest.approx(12, abs=1e-6)
            sides = ("heading_deg", "length_m", "width_m", "in_view")
            assert [float(row[side]) for side in sides] == pytest.approx([0, 4.5, 1.8, 1], abs=1e-6)
    for name in document["radars"]:
        own = json.loads((out / name / "run.json").read_text(encoding="utf-8"))
        assert own["files"]["report.html"] == str(out / name / "report.html")
        assert (out / name / "report.html").is_file()
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'href="front-left/report.html"' in page
    assert expected_nees in page and expected_nees in " ".join(screen.split())
    assert page.count("<svg") == 4  # three frames, and the paths
    # Both radars have this finding, which stands once.
    assert page.count("traffic.velocity: velocities of 2 objects are missing") == 1
    # The scenario beside the results is that of all radars.
    assert len(dc.load(out / "scenario.yaml").radars) == 2


@nightly
def test_command_prints_the_findings_of_all_radars(without_figures, tmp_path, capsys):
    late = tmp_path / "late.csv"  # car 1 appears later; car 3 is on car 2
    overlapping = TRACE + "0.0,3,car,121,50.5,0,4.5,1.8,1.5\n0.4,3,car,125.8,50.5,0,4.5,1.8,1.5\n"
    shifted = overlapping.replace("0.4,1,", "1.4,1,").replace("0.0,1,", "1.0,1,")
    late.write_text(
        shifted + "1.0,2,car,132,50.5,0,4.5,1.8,1.5\n1.4,2,car,136.8,50.5,0,4.5,1.8,1.5\n",
        encoding="utf-8",
    )
    options = ["--ego", "1", "--mount", "front-left", "--mount", "front-right", "--statistical"]
    changes = ["--set=radar.frame.n_chirps=32", "--set=traffic.duration=0.1 s"]

    assert run_command("run", str(late), *options, *changes, "--out", str(tmp_path / "out")) == 0

    screen = capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for text in (
        "warning: traffic.position: objects overlap: 2 and 3 at 0 s",
        "note: traffic.ego: car-1 is present from 1 to 1.4 s, the trace from 0 to 1.4 s",
    ):
        assert screen.count(text) == 1, screen
        assert page.count(text.partition(": ")[2]) == 1


@nightly
def test_command_writes_fused_tracks_for_the_bus_of_the_vehicle(
    trace, without_figures, tmp_path, capsys
):
    log, out = tmp_path / "tracks.asc", tmp_path / "out"
    options = ["--ego", "1", "--mount", "front-left", "--mount", "front-right", "--statistical"]
    changes = ["--set=radar.frame.n_chirps=32", "--set=traffic.duration=0.2 s"]
    words = [*options, *changes, "--objects", str(log), "--out", str(out)]

    assert run_command("run", str(trace), *words) == 0

    assert f"Object list: {log}" in capsys.readouterr().out
    assert json.loads((out / "run.json").read_text(encoding="utf-8"))["files"][log.name] == str(log)
    on_bus = dc.object_lists.read_can_log(log)
    # The list contains tentative tracks too; confirmed ones are those of the table.
    confirmed = [row for row in read_rows(out / "tracks.csv") if row["status"] == "confirmed"]
    objects = on_bus.isel(object=on_bus["status"].values == "confirmed")
    # The radars measure at one time: the last list of each time is on the bus.
    last = {row["time_s"]: row for row in confirmed}
    assert objects.sizes["object"] == len(last) > 0
    for index, row in enumerate(last.values()):
        ego_x_m = 100 + 10 * float(row["time_s"])  # steps of the signals: 0.01
        assert objects["x"].values[index] == pytest.approx(float(row["x_m"]) - ego_x_m, abs=0.0051)
        assert objects["y"].values[index] == pytest.approx(float(row["y_m"]) - 50, abs=0.0051)
        vx = float(row["vx_m_per_s"]) - 10
        assert objects["vx"].values[index] == pytest.approx(vx, abs=0.0051)


def compile_loop():
    for listener in compilation_listeners:
        listener.start_compilation()
        listener.end_compilation()


@pytest.mark.parametrize(("quiet", "n_lines"), [(False, 1), (True, 0)])
def test_one_of_several_processes_announces_its_compilations(
    monkeypatch, capfd, tmp_path, quiet, n_lines
):
    # Calls in a thread have the listeners of this process, those of a worker process its own.
    monkeypatch.setattr("dechirp.cli.compilation_notice.MIN_NOTED_S", 0.0)
    shared = {"quiet": quiet, "marker": tmp_path / "announced"}
    before = list(compilation_listeners)
    with ThreadPoolExecutor(1) as threads, announced_compilation(**shared):
        executor = AnnouncingExecutor(threads, **shared)
        for _ in range(3):
            executor.submit(compile_loop).result()
        compile_loop()
    assert capfd.readouterr().err.count("Compiling loops") == n_lines
    assert compilation_listeners == before


@pytest.mark.parametrize(("quiet", "n_lines"), [(False, 1), (True, 0)])
def test_run_of_several_radars_announces_compilations(
    trace, tmp_path, monkeypatch, capfd, quiet, n_lines
):
    @contextmanager
    def threads():
        with ThreadPoolExecutor(1) as pool:
            yield Workers(pool, lambda: 1)

    def compile_loop_and_stop(*_, **__):
        compile_loop()
        raise InvalidSetting("stop", value="compiled", expected="compiled", fix="none")

    monkeypatch.setattr("dechirp.cli.compilation_notice.MIN_NOTED_S", 0.0)
    monkeypatch.setattr("dechirp.experiments.study.executors.local_workers", threads)
    monkeypatch.setattr("dechirp.experiments.run_radars.run", compile_loop_and_stop)
    scenario = dc.traffic.traffic_scenario(trace, [*FAST, PAIR])

    with pytest.raises(InvalidSetting, match="stop"):
        run_several_radars(
            scenario,
            "statistical",
            source=trace,
            out=tmp_path,
            objects=(),
            coding={},
            as_json=False,
            quiet=quiet,
        )

    assert capfd.readouterr().err.count("Compiling loops") == n_lines


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--mount", "front", "--mount", "front-lef"], "--mount: front-lef"),
        (["--mount", "front", "--mount", "front"], "also that of radar 0"),
        (["--mount", "front", "--mount", "rear", "--idle", "5s"], "--idle: given for several"),
        (["--mount", "front", "--mount", "rear", "--idle", "5s"], "with one --mount"),
        (
            ["--mount=front", "--mount=rear", "--objects=o.csv", "--set=tracker=null"],
            "--objects: given for several radars without a tracker",
        ),
    ],
)
def test_command_refuses_wrong_options(trace, words, message, capsys):
    assert run_command("run", str(trace), "--ego", "1", *words) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_command_names_a_missing_file(tmp_path, capsys):
    words = [str(tmp_path / "none.csv"), "--mount", "front-left", "--mount", "front-right"]
    assert run_command("run", *words) == 2
    assert "none.csv: recording: no such file" in " ".join(capsys.readouterr().err.split())


def test_tracks_of_several_radars_need_frames_of_all_together(radar):
    scene = dc.Scene(targets=(dc.Target(position_m=(20.0, 0, 0), rcs_m2=1.0),))
    pair = (
        dc.fusion.MountedRadar(mount="front-left"),
        dc.fusion.MountedRadar(mount="front-right"),
    )
    settings = {"radar": radar, "scene": scene, "tracker": dc.Tracker()}
    scenario = dc.Scenario(radars=pair, n_frames=2, **settings)
    assert all(single.scenario.n_frames == 2 for single in split_radars(scenario)[0].values())
    too_short = dc.Scenario(radars=pair, n_frames=1, **settings)
    with ThreadPoolExecutor(1) as executor:
        result = dc.fusion.run_radars(too_short, executor=executor)
    (finding,) = [item for item in result.findings if item.setting == "tracker.confirm_after"]
    assert "in a run of 2 frames" in finding.value and "at least 3 frames" in finding.fix


def test_start_offset_with_waypoints_is_refused(radar):
    way = (dc.Waypoint(time_s=1.0, position_m=(30.0, 0.0, 0.0)),)
    scenario = dc.Scenario(
        radars=(dc.fusion.MountedRadar(start_offset_s=0.01),),
        radar=radar,
        scene=dc.Scene(targets=(dc.Target(position_m=(20.0, 0, 0), rcs_m2=1.0, waypoints=way),)),
    )
    with pytest.raises(DechirpError, match="waypoints"):
        split_radars(scenario)
