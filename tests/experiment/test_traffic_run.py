"""Runs of a radar in traffic: detections, tracks, scores, files and commands."""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.cli.main import main
from dechirp.evaluation.association import (
    Associator,
    nearest_target_indices,
    scatterer_range_and_range_rate,
    visible_scatterer_mask,
)
from dechirp.evaluation.traffic_scores import (
    demanded_object_mask,
    score_track_consistency,
    score_tracks,
    score_traffic,
)
from dechirp.experiments.traffic_stage import ObjectComparison, TrafficFrames
from dechirp.report.traffic_section import describe_track_scores, traffic_table_rows
from nightly import nightly

# The radar of car 1 sees car 2 pull away and car 4 hidden behind it; 3 is behind the radar.
TRACE = """time,id,class,x,y,heading,length,width,height
0.0,1,car,0,0,0,4.5,1.8,1.5
0.2,1,car,2,0,0,4.5,1.8,1.5
0.4,1,car,4,0,0,4.5,1.8,1.5
0.0,2,car,20,0.5,0,4.5,1.8,1.5
0.2,2,car,22.4,0.5,0,4.5,1.8,1.5
0.4,2,car,24.8,0.5,0,4.5,1.8,1.5
0.0,3,car,-20,3,0,4.5,1.8,1.5
0.2,3,car,-18,3,0,4.5,1.8,1.5
0.4,3,car,-16,3,0,4.5,1.8,1.5
0.0,4,car,36,0.5,0,4.5,1.8,1.5
0.2,4,car,38.4,0.5,0,4.5,1.8,1.5
0.4,4,car,40.8,0.5,0,4.5,1.8,1.5
"""
FAST = ["radar.frame.n_chirps=64"]


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    path = tmp_path_factory.mktemp("traffic") / "trace.csv"
    path.write_text(TRACE, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def result(trace):
    return dc.run(dc.traffic.traffic_scenario(trace, ["traffic.ego=1", *FAST]))


def test_objects_in_view_are_detected_and_tracked(result):
    assert result.n_frames == 10  # every 50 ms in 0.4 s and half a step
    objects = result.traffic
    assert objects["target"].values.tolist() == ["car-2", "car-4"]
    # The rear of car 2 starts 20 - 2 * 2.25 - 2.25 m ahead and recedes at 2 m/s.
    expected_m = 20 - 4.5 + 2 * objects["time"].values
    assert objects["x"].values[0] == pytest.approx(expected_m, abs=1e-6)
    assert objects["vx"].values[0] == pytest.approx(2, abs=1e-6)
    # From 16 to 27 m, car 2 hides all of a car of its width.
    assert objects["visible_share"].values.tolist() == [[1] * 10, [0] * 10]
    assert np.all(objects["n_detections"].values[0] > 0)
    # A range cell is 0.39 m, a velocity cell 0.7 m/s; the SNR of 40 dB leaves hundredths of them.
    # Two reflections in a cell move the direction within the width of the car.
    assert np.nanmedian(objects["position_error"].values[0]) < 0.05
    assert np.nanmax(objects["position_error"].values[0]) < 1.8
    assert np.nanmax(np.abs(objects["velocity_error"].values[0])) < 0.1


def test_detections_belong_to_the_objects_of_the_truth(result):
    traffic = TrafficFrames(result.scenario)
    columns = {str(name): column.values for name, column in result.detections.items()}
    for number in (0, 9):
        of_frame = {name: column[columns["frame"] == number] for name, column in columns.items()}
        scene, radar = traffic.scenes.scene(number), traffic.radar.for_frame(number)
        of_truth = Associator(traffic.truth(number, scene), radar, scene)

        owners = nearest_target_indices(of_frame, scene, radar)

        assert owners.tolist() == of_truth.nearest_target_indices(of_frame).tolist()
        assert np.bincount(owners[owners >= 0], minlength=2).tolist() == (
            result.traffic["n_detections"].values[:, number].tolist()
        )


@nightly
def test_drawn_detections_are_compared_like_those_of_samples(trace):
    scenario = dc.traffic.traffic_scenario(trace, ["traffic.ego=1", *FAST])
    drawn = dc.run(scenario, kind="statistical")
    comparison = ObjectComparison(TrafficFrames(drawn.scenario))

    comparison.add_all_frames(
        {str(name): column.values for name, column in drawn.detections.items()}
    )

    xr.testing.assert_equal(comparison.to_dataset(), drawn.traffic)


def test_scores_leave_out_hidden_objects(result):
    scores = score_traffic(result.traffic, result.tracks)

    assert (scores.n_objects, scores.n_object_frames, scores.detected_share) == (1, 10, 1.0)
    assert (scores.n_identity_switches, scores.n_false_tracks) == (0, 0.0)
    # Two frames before the confirmation count sqrt(5^2 / 2) m each, as a missed target; the point
    # of the outline nearest to the radar is within a car's width of the track afterwards.
    missed_m = 2 * 5 / np.sqrt(2)
    assert missed_m / 10 < scores.gospa_m < (missed_m + 8 * 1.8) / 10
    (row,) = traffic_table_rows(result)
    assert (row["name"], row["detected"], row["switches"]) == ("car-2", "100.0%", "0")


def test_missed_frames_and_lost_tracks_lower_the_scores(result):
    objects = result.traffic.copy(deep=True)
    objects["n_detections"][0, :3] = 0

    scores = score_traffic(objects, result.tracks.isel(track=[]))

    assert scores.detected_share == pytest.approx(0.7)
    assert scores.gospa_m == pytest.approx(5 / np.sqrt(2))


def test_frames_do_not_depend_on_those_before(trace, result):
    scenario = dc.traffic.traffic_scenario(
        trace, ["traffic.ego=1", "traffic.duration=0.16 s", *FAST]
    )

    shorter = dc.run(scenario)

    n = shorter.detections.sizes["detection"]
    assert shorter.n_frames == 4
    assert shorter.detections["range"].values.tolist() == (
        result.detections["range"].values[:n].tolist()
    )


def test_other_mounts_see_other_cars(trace):
    scenario = dc.traffic.traffic_scenario(
        trace, ["traffic.ego=1", "traffic.mount=rear", "traffic.duration=0.16 s", *FAST]
    )

    objects = dc.run(scenario).traffic

    assert objects["target"].values.tolist() == ["car-3"]
    assert objects["y"].values[0] == pytest.approx(-2.1, abs=1e-6)  # 3 - 0.9 m, seen backwards


def run(*words):
    """Run a command that succeeds."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0


@nightly
def test_command_runs_a_trace_and_its_own_scenario_again(trace, tmp_path, capsys):
    options = [f"--set={change}" for change in (*FAST, "traffic.duration=0.16 s")]

    run("run", str(trace), "--ego", "1", "--out", str(tmp_path / "a"), "--json", *options)

    document = json.loads(capsys.readouterr().out)
    assert {row["target"] for row in document["traffic"]} == {"car-2", "car-4"}
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert "GOSPA" in page and "identity switches" in page and "car-2" in page
    assert (tmp_path / "a" / "traffic.csv").read_text().startswith("target,frame,time_s")
    run("run", str(tmp_path / "a" / "scenario.yaml"), "--out", str(tmp_path / "b"), "--json")
    assert json.loads(capsys.readouterr().out)["detections"] == document["detections"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], "traffic.ego: missing, and the file names no host"),
        (["--ego", "1", "--mount", "roof"], "--mount: roof; expected one of front"),
        (["--ego", "one"], "--ego: "),
        (["--ego", "1", "--device", "xwr1843"], "--device: given for traffic"),
        (["--ego", "1", "--frames", "3:3"], "--frames: 3:3"),
        (["--ego", "1", "--frames", "100:112"], "traffic.start_s"),
    ],
)
def test_wrong_options_name_themselves(trace, tmp_path, capsys, options, expected):
    with pytest.raises(SystemExit, match="[12]"):
        main(["run", str(trace), "--out", str(tmp_path / "out"), *options])

    assert expected in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("option", ["--ego", "--set traffic.ego"])
def test_options_of_traffic_name_a_source_that_is_no_traffic(tmp_path, capsys, option):
    other = tmp_path / "other.csv"
    other.write_text("time;id\n", encoding="utf-8")
    for path, expected in (
        (tmp_path / "missing.csv", "missing.csv: recording: no such file; expected a traffic file"),
        (tmp_path, "recording: a folder; expected a traffic file"),
        (other, "other.csv: recording: a CSV without the columns class, x, y,"),
    ):
        values = ["--ego", "1"] if option == "--ego" else ["--set", "traffic.ego=1"]
        with pytest.raises(SystemExit, match="[12]"):
            main(["run", str(path), "--out", str(tmp_path / "out"), *values])
        assert expected in " ".join(capsys.readouterr().err.split())


def test_only_one_source_is_accepted(trace):
    with pytest.raises(dc.InvalidSetting, match="cannot be combined with traffic"):
        dc.Scenario(
            radar=dc.reference().radar,
            scene=dc.Scene(),
            traffic=dc.traffic.traffic_scenario(trace).traffic,
        )


@nightly
@pytest.mark.parametrize(
    ("ego", "kind"),
    [(475, "samples"), *((ego, "statistical") for ego in (405, 451, 468, 475))],
)
def test_recorded_motorway_traffic_is_detected(ego, kind):
    # The requirement: every vehicle in view and not shadowed in 95 % of the frames, to 0.5 m and
    # 0.1 m/s. In four of 718 sightings, only wheels are detected, and no velocity is known.
    folder = os.environ.get("DECHIRP_WITNESS_DATA")
    path = Path(folder or "") / "commonroad_us101" / "USA_US101-4_1_T-1.xml"
    if not (folder and path.is_file()):
        pytest.skip("needs commonroad_us101 of DECHIRP_WITNESS_DATA")

    result = dc.run(dc.traffic.traffic_scenario(path, [f"traffic.ego={ego}"]), kind=kind)

    scores = score_traffic(result.traffic, result.tracks)
    assert ego != 475 or (scores.n_objects, result.n_frames) == (8, 201)
    assert scores.lowest_detected_share >= 0.95
    assert scores.position_rmse_m <= 0.5
    assert scores.velocity_rmse_m_per_s <= 0.1
    assert scores.velocity_known_share >= 0.99


@pytest.mark.parametrize(("share", "is_known"), [(0.0029, False), (0.0031, True)])
def test_wheel_without_its_body_is_detected_but_gives_no_velocity(trace, share, is_known):
    # The body of the vehicle may share its cell with a stronger one. Of 1000 body echoes, 3 are
    # weaker than 0.003 of the mean SNR of the truth.
    traffic = TrafficFrames(dc.traffic.traffic_scenario(trace, ["traffic.ego=1", *FAST]))
    scene, radar = traffic.scenes.scene(0), traffic.radar.for_frame(0)
    middle_s = radar.frame.mid_frame_s
    is_seen = visible_scatterer_mask(scene, middle_s, radar)
    is_seen &= scene.target_index_of_scatterer == scene.names.index("car-2")
    motion = scatterer_range_and_range_rate(scene, [middle_s])
    top = np.argmax(np.where(is_seen, motion.velocity_m_per_s[0], -np.inf))
    snr = traffic.truth(0, scene)["snr"].sel(target="car-2").item()
    columns = {
        "range": motion.range_m[:, top],
        "velocity": motion.velocity_m_per_s[:, top],
        "azimuth": np.array([0.5 / 15]),
        "elevation": np.array([np.nan]),
        "ambiguity_number": np.array([0.0]),
        "snr": np.array([share * snr]),
    }
    comparison = ObjectComparison(traffic)

    comparison.add_frame(0, scene, columns)

    car = comparison.to_dataset().sel(target="car-2").isel(frame=0)
    assert car["n_detections"] == 1 and np.isfinite(car["position_error"])
    assert np.isfinite(car["velocity_error"]) == is_known


def tracks_with_errors(objects, errors, covariance):
    """Return a confirmed track of each object, of the given errors (target, 4) in all frames."""
    states = ["x", "vx", "y", "vy"]
    columns = {
        state: objects[f"centre_{state}" if len(state) == 1 else state].values + error[:, None]
        for state, error in zip(states, errors.T, strict=True)
    }
    shape = columns["x"].shape
    return xr.Dataset(
        {name: (("track", "frame"), column) for name, column in columns.items()}
        | {
            "status": (("track", "frame"), np.full(shape, "confirmed")),
            "covariance": (
                ("track", "frame", "state", "other_state"),
                np.broadcast_to(covariance, (*shape, 4, 4)),
            ),
        },
        coords={"state": states, "other_state": states, "frame": objects["frame"].values},
    )


def scattered_objects(n_objects):
    """Return objects of 4 x 2 m that stand 50 m apart, in three frames."""
    shape = n_objects, 3
    places_m = np.repeat(50.0 * np.arange(n_objects)[:, None], shape[1], axis=1)
    columns = {"x": places_m, "y": 0, "vx": 3, "vy": 1, "centre_x": places_m, "centre_y": 0}
    return xr.Dataset(
        {
            name: (("target", "frame"), np.broadcast_to(np.asarray(column, float), shape))
            for name, column in (columns | {"heading": 0}).items()
        }
        | {"length": ("target", np.full(n_objects, 4.0))}
        | {"width": ("target", np.full(n_objects, 2.0))},
        coords={"target": [f"car-{i}" for i in range(n_objects)], "frame": range(3)},
    )


def test_nees_of_objects_is_squared_error_over_variance_per_axis():
    # Variances 4 and 9 m^2, of which errors of 2 and 1.5 m are 1 and 1/4; 0.25 and 1 m^2/s^2.
    objects = scattered_objects(2)
    errors = np.array([[2.0, 0.5, 1.5, 0], [0, 0, 0, 2.0]])
    tracks = tracks_with_errors(objects, errors, np.diag([4.0, 0.25, 9.0, 1.0]))
    is_demanded = np.array([[True] * 3, [True, False, False]])

    scores = score_track_consistency(objects, is_demanded, tracks)
    without_objects = score_track_consistency(objects, is_demanded & False, tracks)

    # Objects count alike, not frames.
    assert scores.position_nees == pytest.approx((1 + 0.25) / 2 / 2)
    assert scores.velocity_nees == pytest.approx((1 / 2 + 4 / 2) / 2)
    # Quantiles of chi-square of four degrees, over four.
    assert scores.expected_interval == pytest.approx((0.4844 / 4, 11.1433 / 4), rel=1e-4)
    assert scores.n_objects == 2 and without_objects is None


@nightly
def test_right_stated_errors_are_in_the_interval_of_nees_in_95_of_100_runs():
    covariance = np.array([[1, 0.3, 0, 0], [0.3, 0.5, 0, 0], [0, 0, 0.8, 0.1], [0, 0, 0.1, 0.2]])
    objects, rng, n_runs = scattered_objects(5), np.random.default_rng(2), 300
    is_demanded, n_inside = np.ones((5, 3), bool), 0
    for _ in range(n_runs):
        errors = rng.multivariate_normal(np.zeros(4), covariance, size=5)
        scores = score_track_consistency(
            objects, is_demanded, tracks_with_errors(objects, errors, covariance)
        )
        low, high = scores.expected_interval
        n_inside += (low < scores.position_nees < high) + (low < scores.velocity_nees < high)

    # Binomial of 600 runs, of which positions and velocities are correlated at most fully: 5
    # standard deviations of 300 runs are 19.
    assert abs(n_inside / 2 - 0.95 * n_runs) < 19


def azimuth_span(centre_m, size_m, radar_x_m):
    """Return the smallest and the largest azimuth of a rectangle along the axes."""
    azimuths = [
        np.arctan2(centre_m[1] + y * size_m[1] / 2, centre_m[0] + x * size_m[0] / 2 - radar_x_m)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return min(azimuths), max(azimuths)


@nightly
@pytest.mark.parametrize("kind", ["samples", "statistical"])
def test_car_that_passes_behind_a_truck_disappears_and_reappears(tmp_path, kind):
    # The car crosses at 5 m/s, 60 m ahead of the centre of the radar's car. In a frame of 100 ms it
    # moves by 0.5 m, two widths of the diffraction zone, sqrt(lambda d1 d2 / (d1 + d2)) = 0.2 m.
    rows = ["time,id,class,x,y,heading,length,width,height"]
    for step in range(31):
        y_m = -7.5 + 0.5 * step
        rows += [
            f"{step / 10},1,car,0,0,0,4.5,1.8,1.5",
            f"{step / 10},2,truck,24,0,0,10,2.5,4",
            f"{step / 10},3,car,60,{y_m},{np.pi / 2},4.5,1.8,1.5",
        ]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    changes = ["traffic.ego=1", "radar.frame.period=100 ms", *FAST]

    result = dc.run(dc.traffic.traffic_scenario(path, changes), kind=kind)

    car = result.traffic.sel(target="car-3")
    truck = azimuth_span((24, 0), (10, 2.5), radar_x_m=2.25)
    shares = []
    for time_s in car["time"].values:
        # Its heading is y, along which its length is.
        low, high = azimuth_span((60, -7.5 + 5 * time_s), (1.8, 4.5), radar_x_m=2.25)
        hidden = max(min(truck[1], high) - max(truck[0], low), 0)
        shares.append(1 - hidden / (high - low))
    # A ray at each end, every 0.125 of 4.4 degrees.
    assert car["visible_share"].values == pytest.approx(shares, abs=0.06)
    n_hidden = np.isclose(shares, 0).sum()
    assert 4 <= n_hidden < len(shares) / 2
    is_detected = car["n_detections"].values > 0
    for number in range(1, len(shares) - 1):
        around = np.isclose(shares[number - 1 : number + 2], 0)
        if around.all():
            assert not is_detected[number]
        if not around.any():
            assert is_detected[number]
    assert np.all(result.traffic.sel(target="truck-2")["n_detections"] > 0)


POLES = """time,id,class,x,y,heading,length,width,height
0.0,1,car,100,50,0.5,4.5,1.8,1.5
0.4,1,car,100,50,0.5,4.5,1.8,1.5
0.0,8,pole,{0:.4f},{1:.4f},0,0.3,0.3,6
0.0,9,wall,{2:.4f},{3:.4f},2.0708,6,0.2,2
"""


@nightly
@pytest.mark.parametrize("mounts", [["front"], ["front-left", "front-right"]], ids=["one", "two"])
def test_tracks_on_structures_are_no_false_tracks(tmp_path, mounts):
    ahead, aside = np.array([np.cos(0.5), np.sin(0.5)]), np.array([-np.sin(0.5), np.cos(0.5)])
    places_m = [100, 50] + 20 * ahead + 3 * aside, [100, 50] + 40 * ahead
    path = tmp_path / "trace.csv"
    path.write_text(POLES.format(*np.ravel(places_m)), encoding="utf-8")
    radars = ", ".join(f"{{mount: {mount}}}" for mount in mounts)
    scenario = dc.traffic.traffic_scenario(path, ["traffic.ego=1", *FAST, f"radars=[{radars}]"])
    if len(mounts) == 1:
        scenario = replace(scenario, radars=())
        result = dc.run(scenario, kind="statistical")
        objects, is_demanded = result.traffic, demanded_object_mask(result.traffic)
    else:
        with ThreadPoolExecutor(1) as executor:
            result = dc.fusion.run_radars(scenario, kind="statistical", executor=executor)
        objects = result.objects
        is_demanded = objects["in_view"].values

    scores = score_tracks(objects, is_demanded, result.tracks)

    is_confirmed = result.tracks["status"].values == "confirmed"
    assert result.tracks.sizes["track"] >= 2
    assert result.tracks["on_structure"].values[is_confirmed].all()
    assert scores.n_false_tracks == 0 and scores.gospa_m == 0
    assert scores.n_structure_tracks == pytest.approx(is_confirmed.sum(axis=0).mean())
    assert f" {scores.n_structure_tracks:.2f} on structures." in describe_track_scores(scores)
    # Beside the structures they would count.
    moved = result.tracks.assign(on_structure=result.tracks["on_structure"] & False)
    assert score_tracks(objects, is_demanded, moved).n_false_tracks == scores.n_structure_tracks
