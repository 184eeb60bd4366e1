"""The object list: geometry, its errors, who comes first, and what is no list."""

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.results.object_lists.list_columns import COLUMNS, MEASURED, check_object_list
from dechirp.results.object_lists.object_list import object_list
from dechirp.results.object_lists.priority import keep_most_important, priority_ranks
from objects_made import objects_at, one


def detections(n: int = 1, **columns) -> xr.Dataset:
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


def tracks() -> xr.Dataset:
    """Two tracks over three frames; nobody is there in the second one."""
    status = np.array([["tentative", "", "confirmed"], ["", "", "tentative"]])
    place = np.where(status == "", np.nan, 1.0)
    covariance = np.full((2, 3, 4, 4), np.nan)
    covariance[status != ""] = np.diag([0.04, 0.25, 0.09, 0.16])
    return xr.Dataset(
        {
            "x": (("track", "frame"), place * [[30, 0, 28], [0, 0, 60]]),
            "y": (("track", "frame"), place * [[-2, 0, -2], [0, 0, 4]]),
            "vx": (("track", "frame"), place * -20.0),
            "vy": (("track", "frame"), place * 0.5),
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


def test_a_detection_is_where_its_range_and_angles_say():
    found = object_list(detections())

    level = 50 * np.cos(0.1)
    assert found.x.item() == pytest.approx(level * np.cos(0.3))
    assert found.y.item() == pytest.approx(level * np.sin(0.3))
    assert found.z.item() == pytest.approx(50 * np.sin(0.1))
    towards = np.array([found.x, found.y, found.z]).ravel() / 50
    assert found.vx.item() == pytest.approx(-5 * towards[0])
    assert found.vy.item() == pytest.approx(-5 * towards[1])
    assert np.isnan(found.vx_std) and np.isnan(found.vy_std)


def test_errors_of_places_are_those_of_drawn_ranges_and_angles():
    n = 40_000
    rng = np.random.default_rng(1)
    drawn = detections(
        n,
        range=rng.normal(50, 0.05, n),
        azimuth=rng.normal(0.3, 0.01, n),
        elevation=rng.normal(0.1, 0.02, n),
    )

    many, single = object_list(drawn), object_list(detections())

    # A standard deviation of 40,000 draws has a relative error of 0.0035; 5 of them. What is
    # left out beyond first order is 1e-4.
    assert float(single.x_std.item()) == pytest.approx(many.x.std().item(), rel=0.018)
    assert float(single.y_std.item()) == pytest.approx(many.y.std().item(), rel=0.018)


@pytest.mark.parametrize(("untold", "none"), [("azimuth", {"y", "y_std"}), ("elevation", {"z"})])
def test_an_angle_that_is_not_told_leaves_its_coordinate_open(untold, none):
    found = object_list(detections(**{untold: np.nan, f"{untold}_std": np.nan}))

    level = object_list(detections(**{untold: 0.0, f"{untold}_std": 0.0}))
    for name in ("x", "y", "z", "x_std", "y_std"):
        if name in none:
            assert np.isnan(found[name].item())
        else:
            assert found[name].item() == pytest.approx(level[name].item())


def test_detections_without_direction_are_said_to_be_nowhere():
    with pytest.warns(dc.PhysicsWarning, match="2 of 2 detections without azimuth"):
        found = object_list(detections(2, azimuth=np.nan, elevation=np.nan))

    assert np.isnan([found.x, found.y, found.z]).all()
    assert found.snr.values.tolist() == [100.0, 100.0]


def test_tracks_are_listed_where_they_are_and_frames_without_any_too():
    found = object_list(tracks())

    assert found.number.values.tolist() == [7, 7, 9]
    assert found.frame.values.tolist() == [10, 12, 12]
    assert found.status.values.tolist() == ["tentative", "confirmed", "tentative"]
    np.testing.assert_allclose(found.x_std, 0.2)
    np.testing.assert_allclose(found.y_std, 0.3)
    np.testing.assert_allclose(found.vx_std, 0.5)
    np.testing.assert_allclose(found.vy_std, 0.4)
    assert found.cycle_frame.values.tolist() == [10, 11, 12]
    assert found.cycle_time.values.tolist() == [0.5, 0.55, 0.6]


def test_clusters_have_extents_along_and_across_the_line_of_sight():
    clusters = detections(2, range=[50.0, 20.0]).rename(detection="cluster")
    clusters = clusters.assign(
        range_extent=("cluster", [4.0, 1.0]), azimuth_extent=("cluster", [0.04, np.nan])
    )

    found = object_list(clusters)

    by_number = found.isel(object=np.argsort(found.number.values))
    assert by_number.length.values.tolist() == [4.0, 1.0]
    assert by_number.width.values[0] == pytest.approx(2.0)
    assert np.isnan(by_number.width.values[1])


def test_frames_without_detections_are_lists_where_their_times_are_known():
    found = object_list(detections(frame=1, time=0.06), [0.01, 0.06, 0.11])

    assert found.cycle_frame.values.tolist() == [0, 1, 2]
    later = object_list(detections(frame=5, time=0.06), [0.01, 0.06, 0.11], first=4)
    assert later.cycle_frame.values.tolist() == [4, 5, 6]
    assert object_list(detections(0)).sizes == {"object": 0, "cycle": 0}


def test_the_most_important_object_is_believed_and_soon_here():
    rows = {
        # status, x, y, vx: seconds to the radar at its closing speed, or at 1 m/s
        "far and fast": ("confirmed", 200.0, 0.0, -40.0),  # 5 s
        "near and at rest": ("confirmed", 3.0, 0.0, 0.0),  # 3 s
        "near and receding": ("confirmed", 8.0, 0.0, 10.0),  # 8 s
        "crossing": ("confirmed", 0.0, 20.0, -30.0),  # 20 s: it does not close in
        "tentative and near": ("tentative", 1.0, 0.0, -5.0),
        "detection and near": ("detection", 1.0, 0.0, -5.0),
        "detection of no place": ("detection", np.nan, np.nan, -5.0),
    }
    found = xr.concat(
        [one(status=s, x=x, y=y, vx=vx) for s, x, y, vx in rows.values()],
        dim="object",
        data_vars="minimal",
    )

    assert priority_ranks(found).tolist() == [1, 0, 2, 3, 4, 5, 6]


def test_a_list_is_cut_by_priority_and_says_what_it_leaves_out():
    found = objects_at(9, 2, 5)

    with pytest.warns(dc.PhysicsWarning, match="8 objects left out of 2 lists") as said:
        kept = keep_most_important(found, 3, reason="there is no room", fix="Make some.")

    assert np.bincount(kept.frame).tolist() == [3, 2, 3]
    rank = priority_ranks(found)
    assert (rank[np.isin(np.arange(16), _places(found, kept))] < 3).all()
    finding = said[0].message.args[0]
    nearest = np.hypot(found.x, found.y).values[rank >= 3]
    assert f"the nearest at {np.nanmin(nearest):.4g} m" in finding.value


def _places(found: xr.Dataset, kept: xr.Dataset) -> list[int]:
    rows = list(zip(found.frame.values, found.number.values, strict=True))
    return [rows.index(row) for row in zip(kept.frame.values, kept.number.values, strict=True)]


def test_rows_of_frames_in_any_order_become_a_list():
    found = objects_at(2, 3)

    again = check_object_list(found.isel(object=[4, 0, 2, 1, 3]))

    assert again.frame.values.tolist() == [0, 0, 1, 1, 1]
    assert again.number.values.tolist() == [0, 1, 2, 0, 1]


WRONG_FOUND = {
    "nothing": None,
    "a list": [1, 2],
    "an array": xr.DataArray([1.0]),
    "other axes": xr.Dataset({"x": ("point", [1.0])}),
    "no columns": xr.Dataset(coords={"detection": [0]}),
    "half of a frame": detections(frame=0.5),
    "a frame before the first": detections(frame=-1),
    "times that differ within a frame": detections(2, time=[0.0, 0.1]),
    "time going backwards": detections(2, frame=[0, 1], time=[0.1, 0.0]),
    "a time that is none": detections(time=np.nan),
    "an infinite range": detections(range=np.inf),
    "a negative ratio": detections(snr=-1.0),
    "texts": detections(range="far"),
    "tracks without status": tracks().drop_vars("status"),
    "tracks whose time stands still": tracks().assign_coords(time=("frame", [0.5, 0.5, 0.6])),
}


@pytest.mark.parametrize("found", WRONG_FOUND.values(), ids=WRONG_FOUND)
def test_what_gives_no_list_is_refused(found):
    with pytest.raises(InvalidSetting):
        object_list(found)


@pytest.mark.parametrize("times", [[0.0], ["now"], [0.0, np.nan], [0.1, 0.0]])
def test_times_that_are_not_those_of_the_frames_are_refused(times):
    with pytest.raises(InvalidSetting):
        object_list(detections(frame=1, time=0.1), times)


WRONG_LISTS = {
    "nothing": None,
    "no columns": xr.Dataset(),
    "one column missing": objects_at(2).drop_vars("vx"),
    "another axis": objects_at(2).assign(vx=("row", [1.0, 2.0])),
    "cycles over another axis": objects_at(2).assign(cycle_time=("row", [1.0, 2.0])),
    "an unknown status": one(status="coasting"),
    "no status": one(status=""),
    "an infinite place": one(x=np.inf),
    "a negative error": one(x_std=-0.1),
    "a complex place": one(x=1j),
    "half a number": one(number=0.5),
    "a frame without a time": objects_at(2, 3).isel(cycle=[0]),
    "frames in no order": objects_at(2, 3).isel(cycle=[1, 0]),
}


@pytest.mark.parametrize("objects", WRONG_LISTS.values(), ids=WRONG_LISTS)
def test_what_is_no_list_is_refused_by_name(objects):
    with pytest.raises(InvalidSetting, match=r"objects.*: .*; expected"):
        check_object_list(objects)


def test_every_column_has_a_unit():
    found = objects_at(1)
    assert {name: found[name].attrs["units"] for name in COLUMNS} == COLUMNS
    assert set(MEASURED) < set(COLUMNS)
