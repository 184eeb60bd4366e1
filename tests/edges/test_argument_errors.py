"""Wrong arguments of public functions: one error of the package, which names the argument."""

import inspect

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from radars import street_radar

FUNCTIONS = {
    name: getattr(dc, name) for name in dc.__all__ if inspect.isfunction(getattr(dc, name))
}
WRONG_VALUES = [3, None, np.zeros(3), xr.DataArray(np.zeros(3)), xr.Dataset(), object()]


def required_arguments(function):
    return [
        parameter.name
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty and parameter.kind != parameter.VAR_KEYWORD
    ]


@pytest.mark.parametrize(
    "name", [name for name, function in FUNCTIONS.items() if required_arguments(function)]
)
def test_wrong_and_missing_arguments_are_named(name):
    arguments = required_arguments(FUNCTIONS[name])
    with pytest.raises(InvalidSetting, match=rf"^{arguments[0]}: missing.*dechirp\.{name}\b"):
        FUNCTIONS[name]()

    for value in WRONG_VALUES:
        with pytest.raises(InvalidSetting) as caught:
            FUNCTIONS[name](**dict.fromkeys(arguments, value))
        assert caught.value.mistakes[0].setting in arguments, value


@pytest.fixture(scope="module")
def cube():
    radar = street_radar(n_samples=64, n_chirps=16)
    return dc.simulate(dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))]), radar)


@pytest.mark.parametrize("name", ["power_map", "range_azimuth_map", "angle_spectrum"])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda cube: xr.concat([cube, cube], "frame"),
            r"cube: 2 frames; expected one frame.*isel",
        ),
        (lambda cube: cube[:0], r"cube: 0 frames; expected one frame.*pass a cube that has frames"),
        (lambda cube: cube[0, :8], r"cube: 8 along chirp; expected 16"),
        (lambda cube: cube[0].real, r"cube: samples of type float32; expected complex"),
        (lambda cube: cube[0].rename(rx="receiver"), r"cube: an array over chirp, receiver"),
    ],
    ids=["frames", "no frame", "chirps", "real", "axes"],
)
def test_frame_that_radar_cannot_have_taken_is_refused(cube, name, change, message):
    radar = street_radar(n_samples=64, n_chirps=16)
    others = {"chain": dc.Chain()}
    if name == "angle_spectrum":
        others |= {"detections": dc.detect(cube, radar), "index": 0}

    with pytest.raises(InvalidSetting, match=message):
        FUNCTIONS[name](change(cube), radar, **others)


def test_frame_axis_of_length_one_is_accepted_by_all_functions_of_frames(cube):
    radar = street_radar(n_samples=64, n_chirps=16)
    detections = dc.detect(cube, radar)
    for compute in (
        lambda frame: dc.power_map(frame, radar),
        lambda frame: dc.range_azimuth_map(frame, radar),
        lambda frame: dc.angle_spectrum(frame, radar, detections, 0),
    ):
        xr.testing.assert_identical(compute(cube), compute(cube[0]))

    with pytest.raises(InvalidSetting, match=r'cube: one frame, over.*; .*expand_dims\("frame"\)'):
        dc.detect(cube[0], radar)
    kept, added = cube.isel(frame=[0]), cube[0].expand_dims("frame")
    xr.testing.assert_identical(dc.detect(kept, radar), detections)
    xr.testing.assert_identical(dc.detect(added, radar), detections)


def test_real_radar_refuses_complex_cube(cube):
    with pytest.raises(InvalidSetting, match="cube: samples of type complex64; expected real"):
        dc.detect(cube, street_radar(n_samples=64, n_chirps=16, sampling="real"))


@pytest.mark.parametrize("index", [-1, 1000, 0.5])
def test_index_of_no_detection_is_refused(cube, index):
    radar = street_radar(n_samples=64, n_chirps=16)
    with pytest.raises(InvalidSetting, match="index: "):
        dc.angle_spectrum(cube[0], radar, dc.detect(cube, radar), index)


def test_warnings_point_to_the_line_of_the_caller():
    radar = street_radar(n_samples=64, n_chirps=16)
    scene = dc.Scene(targets=[dc.Target(position_m=(90, 0, 0), rcs_m2=1e4)])  # 75 m are unambiguous
    with pytest.warns(dc.PhysicsWarning, match="aliased") as warnings:
        dc.simulate(scene, radar)

    assert {warning.filename for warning in warnings} == {__file__}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": "abc"}, "frames: 'abc'; expected two whole numbers"),
        ({"frames": 3}, "frames: 3; expected two whole numbers"),
        ({"frames": (1,)}, "frames"),
        ({"frames": (0.5, 2)}, "frames"),
        ({"axes": 3}, "axes: 3; expected names"),
        ({"axes": [1, 2]}, "axes"),
    ],
)
def test_wrong_frames_and_axes_of_recordings_are_named(tmp_path, options, message):
    np.save(tmp_path / "a.npy", np.zeros((2, 16, 1, 64), np.complex64))
    for read in (dc.open, dc.inspect):
        with pytest.raises(InvalidSetting, match=message):
            read(tmp_path / "a.npy", radar=street_radar(n_samples=64, n_chirps=16), **options)


def test_maps_and_detections_of_other_kinds_are_named(cube):
    radar = street_radar(n_samples=64, n_chirps=16)
    with pytest.raises(InvalidSetting, match="power: an array over frame, chirp, rx, sample"):
        dc.threshold_map(cube, radar, dc.Chain())
    detections = dc.detect(cube, radar).drop_vars("range")
    with pytest.raises(InvalidSetting, match="range"):
        dc.angle_spectrum(cube[0], radar, detections, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_sample_that_is_not_finite_is_refused_by_maps_and_detections(value):
    radar = street_radar(n_samples=32, n_chirps=8)
    cube = dc.simulate(dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))]), radar)
    detections = dc.detect(cube, radar)
    cube[0, 3, 1, 7] = value

    for compute in (
        lambda: dc.power_map(cube, radar),
        lambda: dc.range_azimuth_map(cube, radar),
        lambda: dc.angle_spectrum(cube, radar, detections, 0),
        lambda: dc.detect(cube, radar),
    ):
        with pytest.raises(InvalidSetting, match="^cube: samples that are not finite"):
            compute()
