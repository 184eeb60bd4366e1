"""Object list: geometry, standard errors, priority, and invalid lists."""

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.results.object_lists.list_columns import COLUMNS, MEASURED, check_object_list
from dechirp.results.object_lists.object_list import object_list
from dechirp.results.object_lists.priority import keep_most_important, priority_ranks
from sample_object_lists import random_object_list, single_object_list


def make_detections(n: int = 1, **columns) -> xr.Dataset:
    row = {
        "frame": 0,
        "time": 0.01,
        "range": 50.0,
        "velocity": -5.0,
        "azimuth": 0.3,
        "elevation": 0.1,
        "snr": 100.0,
        "range_std": 0.05,
        "velocity_std": 0.02,
        "azimuth_std": 0.01,
        "elevation_std": 0.02,
    } | columns
    return xr.Dataset({name: ("detection", np.resize(cell, n)) for name, cell in row.items()})


def make_tracks() -> xr.Dataset:
    """Return two tracks over three frames, with no object in the second frame."""
    status = np.array([["tentative", "", "confirmed"], ["", "", "tentative"]])
    presence = np.where(status == "", np.nan, 1.0)
    covariance = np.full((2, 3, 4, 4), np.nan)
    covariance[status != ""] = np.diag([0.04, 0.25, 0.09, 0.16])
    return xr.Dataset(
        {
            "x": (("track", "frame"), presence * [[30, 0, 28], [0, 0, 60]]),
            "y": (("track", "frame"), presence * [[-2, 0, -2], [0, 0, 4]]),
            "vx": (("track", "frame"), presence * -20.0),
            "vy": (("track", "frame"), presence * 0.5),
            "status": (("track", "frame"), status),
            "covariance": (("track", "frame", "state", "state_too"), covariance),
        },
        coords={
            "track": [7, 9],
            "frame": [10, 11, 12],
            "time": ("frame", [0.5, 0.55, 0.6]),
            "state": ["x", "vx", "y", "vy"],
        },
    )


def test_detection_position_follows_range_and_angles():
    objects = object_list(make_detections())

    level = 50 * np.cos(0.1)
    assert objects.x.item() == pytest.approx(level * np.cos(0.3))
    assert objects.y.item() == pytest.approx(level * np.sin(0.3))
    assert objects.z.item() == pytest.approx(50 * np.sin(0.1))
    direction = np.array([objects.x, objects.y, objects.z]).ravel() / 50
    assert objects.vx.item() == pytest.approx(-5 * direction[0])
    assert objects.vy.item() == pytest.approx(-5 * direction[1])
    assert np.isnan(objects.vx_std) and np.isnan(objects.vy_std)


def test_position_errors_match_random_ranges_and_angles():
    n = 40_000
    rng = np.random.default_rng(1)
    random_detections = make_detections(
        n,
        range=rng.normal(50, 0.05, n),
        azimuth=rng.normal(0.3, 0.01, n),
        elevation=rng.normal(0.1, 0.02, n),
    )

    many_objects, single_object = object_list(random_detections), object_list(make_detections())

    # A standard deviation of 40,000 draws has a relative error of 0.0035; the limit is 5 of
    # them. Terms beyond first order are 1e-4.
    assert float(single_object.x_std.item()) == pytest.approx(
        many_objects.x.std().item(), rel=0.018
    )
    assert float(single_object.y_std.item()) == pytest.approx(
        many_objects.y.std().item(), rel=0.018
    )


@pytest.mark.parametrize(
    ("unknown_angle", "unknown_columns"), [("azimuth", {"y", "y_std"}), ("elevation", {"z"})]
)
def test_unknown_angle_leaves_coordinate_unknown(unknown_angle, unknown_columns):
    objects = object_list(
        make_detections(**{unknown_angle: np.nan, f"{unknown_angle}_std": np.nan})
    )

    reference = object_list(make_detections(**{unknown_angle: 0.0, f"{unknown_angle}_std": 0.0}))
    for name in ("x", "y", "z", "x_std", "y_std"):
        if name in unknown_columns:
            assert np.isnan(objects[name].item())
        else:
            assert objects[name].item() == pytest.approx(reference[name].item())


def test_detections_without_direction_warn_and_have_no_position():
    with pytest.warns(dc.PhysicsWarning, match="2 of 2 detections without azimuth"):
        objects = object_list(make_detections(2, azimuth=np.nan, elevation=np.nan))

    assert np.isnan([objects.x, objects.y, objects.z]).all()
    assert objects.snr.values.tolist() == [100.0, 100.0]


def test_tracks_become_objects_and_empty_frames_are_kept():
    objects = object_list(make_tracks())

    assert objects.number.values.tolist() == [7, 7, 9]
    assert objects.frame.values.tolist() == [10, 12, 12]
    assert objects.status.values.tolist() == ["tentative", "confirmed", "tentative"]
    np.testing.assert_allclose(objects.x_std, 0.2)
    np.testing.assert_allclose(objects.y_std, 0.3)
    np.testing.assert_allclose(objects.vx_std, 0.5)
    np.testing.assert_allclose(objects.vy_std, 0.4)
    assert objects.cycle_frame.values.tolist() == [10, 11, 12]
    assert objects.cycle_time.values.tolist() == [0.5, 0.55, 0.6]


def test_clusters_have_length_and_width_from_extents():
    clusters = make_detections(2, range=[50.0, 20.0]).rename(detection="cluster")
    clusters = clusters.assign(
        range_extent=("cluster", [4.0, 1.0]), azimuth_extent=("cluster", [0.04, np.nan])
    )

    objects = object_list(clusters)

    by_number = objects.isel(object=np.argsort(objects.number.values))
    assert by_number.length.values.tolist() == [4.0, 1.0]
    assert by_number.width.values[0] == pytest.approx(2.0)
    assert np.isnan(by_number.width.values[1])


def test_frames_without_detections_are_empty_lists_with_known_times():
    objects = object_list(make_detections(frame=1, time=0.06), [0.01, 0.06, 0.11])

    assert objects.cycle_frame.values.tolist() == [0, 1, 2]
    later = object_list(make_detections(frame=5, time=0.06), [0.01, 0.06, 0.11], first=4)
    assert later.cycle_frame.values.tolist() == [4, 5, 6]
    assert object_list(make_detections(0)).sizes == {"object": 0, "cycle": 0}


def test_priority_prefers_confirmed_objects_with_short_arrival_time():
    rows = {
        # status, x, y, vx: seconds to the radar at its closing speed, or at 1 m/s
        "far and fast": ("confirmed", 200.0, 0.0, -40.0),  # 5 s
        "near and at rest": ("confirmed", 3.0, 0.0, 0.0),  # 3 s
        "near and receding": ("confirmed", 8.0, 0.0, 10.0),  # 8 s
        "crossing": ("confirmed", 0.0, 20.0, -30.0),  # 20 s: it does not close in
        "tentative and near": ("tentative", 1.0, 0.0, -5.0),
        "detection and near": ("detection", 1.0, 0.0, -5.0),
        "detection without position": ("detection", np.nan, np.nan, -5.0),
    }
    objects = xr.concat(
        [single_object_list(status=s, x=x, y=y, vx=vx) for s, x, y, vx in rows.values()],
        dim="object",
        data_vars="minimal",
    )

    assert priority_ranks(objects).tolist() == [1, 0, 2, 3, 4, 5, 6]


def test_priority_of_places_beyond_all_scales_does_not_overflow():
    objects = xr.concat(
        [single_object_list(x=1e200, vx=-1.0), single_object_list(x=1e200, vx=-1e200)],
        dim="object",
        data_vars="minimal",
    )

    assert priority_ranks(objects).tolist() == [1, 0]


def test_truncation_follows_priority_and_reports_dropped_objects():
    objects = random_object_list(9, 2, 5)

    with pytest.warns(dc.PhysicsWarning, match="8 objects left out of 2 lists") as warnings:
        short_list = keep_most_important(objects, 3, reason="there is no room", fix="Make some.")

    assert np.bincount(short_list.frame).tolist() == [3, 2, 3]
    rank = priority_ranks(objects)
    assert (rank[np.isin(np.arange(16), _find_rows(objects, short_list))] < 3).all()
    finding = warnings[0].message.args[0]
    nearest = np.hypot(objects.x, objects.y).values[rank >= 3]
    assert f"the nearest at {np.nanmin(nearest):.4g} m" in finding.value


def _find_rows(objects: xr.Dataset, short_list: xr.Dataset) -> list[int]:
    rows = list(zip(objects.frame.values, objects.number.values, strict=True))
    return [
        rows.index(row)
        for row in zip(short_list.frame.values, short_list.number.values, strict=True)
    ]


def test_rows_are_sorted_by_frame():
    objects = random_object_list(2, 3)

    result = check_object_list(objects.isel(object=[4, 0, 2, 1, 3]))

    assert result.frame.values.tolist() == [0, 0, 1, 1, 1]
    assert result.number.values.tolist() == [0, 1, 2, 0, 1]


INVALID_DATASETS = {
    "nothing": None,
    "a list": [1, 2],
    "an array": xr.DataArray([1.0]),
    "other axes": xr.Dataset({"x": ("point", [1.0])}),
    "no columns": xr.Dataset(coords={"detection": [0]}),
    "fractional frame": make_detections(frame=0.5),
    "negative frame": make_detections(frame=-1),
    "different times in one frame": make_detections(2, time=[0.0, 0.1]),
    "time going backwards": make_detections(2, frame=[0, 1], time=[0.1, 0.0]),
    "nan time": make_detections(time=np.nan),
    "an infinite range": make_detections(range=np.inf),
    "a negative ratio": make_detections(snr=-1.0),
    "text range": make_detections(range="far"),
    "tracks without status": make_tracks().drop_vars("status"),
    "tracks with repeated time": make_tracks().assign_coords(time=("frame", [0.5, 0.5, 0.6])),
}


@pytest.mark.parametrize("dataset", INVALID_DATASETS.values(), ids=INVALID_DATASETS)
def test_rejects_invalid_detections_and_tracks(dataset):
    with pytest.raises(InvalidSetting):
        object_list(dataset)


@pytest.mark.parametrize("times", [[0.0], ["now"], [0.0, np.nan], [0.1, 0.0]])
def test_rejects_times_that_do_not_match_frames(times):
    with pytest.raises(InvalidSetting):
        object_list(make_detections(frame=1, time=0.1), times)


INVALID_LISTS = {
    "nothing": None,
    "no columns": xr.Dataset(),
    "one column missing": random_object_list(2).drop_vars("vx"),
    "another axis": random_object_list(2).assign(vx=("row", [1.0, 2.0])),
    "cycles over another axis": random_object_list(2).assign(cycle_time=("row", [1.0, 2.0])),
    "an unknown status": single_object_list(status="coasting"),
    "no status": single_object_list(status=""),
    "an infinite place": single_object_list(x=np.inf),
    "a negative error": single_object_list(x_std=-0.1),
    "a complex place": single_object_list(x=1j),
    "fractional number": single_object_list(number=0.5),
    "a frame without a time": random_object_list(2, 3).isel(cycle=[0]),
    "unordered frames": random_object_list(2, 3).isel(cycle=[1, 0]),
}


@pytest.mark.parametrize("objects", INVALID_LISTS.values(), ids=INVALID_LISTS)
def test_rejects_invalid_object_lists_with_name(objects):
    with pytest.raises(InvalidSetting, match=r"objects.*: .*; expected"):
        check_object_list(objects)


def test_every_column_has_unit():
    objects = random_object_list(1)
    assert {name: objects[name].attrs["units"] for name in COLUMNS} == COLUMNS
    assert set(MEASURED) < set(COLUMNS)
