"""Wrong values of each argument of all public callables: a result, or an error of the package."""

import dataclasses
import enum
import inspect
import types
import typing

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from bad_input.entries import check_error_is_complete
from bad_input.test_array_arguments import VALID_ARGUMENTS
from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import plain_twins_for_small_work
from nightly import nightly_except
from radars import street_radar
from test_api import NAMESPACES

SPACES = ("dechirp", *NAMESPACES)
# With valid arguments they run for minutes, or wait for packets.
WITHOUT_END = {"verify", "listen"}
WRONG_VALUES = [
    *[None, "text", -1, 2.5, np.nan, [], {}, (1, "text"), np.zeros(3), object()],
    *[xr.Dataset({"x": ("x", [1.0])}), xr.DataArray(["text"])],
]


def public_callables(namespace):
    """Return the public functions and classes of a namespace by name, exceptions excluded."""
    space = dc if namespace == "dechirp" else getattr(dc, namespace)
    members = {name: getattr(space, name) for name in space.__all__}
    return {
        name: member
        for name, member in members.items()
        if callable(member)
        and name not in WITHOUT_END
        and not (inspect.isclass(member) and issubclass(member, Exception | enum.Enum))
        and not inspect.isabstract(member)
    }


@pytest.fixture(scope="module")
def samples():
    """Return a value of each class that arguments are annotated with."""
    radar = street_radar(n_samples=32, n_chirps=8)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0))])
    with plain_twins_for_small_work(0):
        cube = dc.simulate(scene, radar)
        detections = dc.detect(cube, radar)
    values = [radar, radar.frame, radar.frame.chirp, radar.array, radar.hardware, scene]
    values += [cube, detections, dc.Scenario(scene=scene, radar=radar), "x"]
    return {int: 1, float: 1.0} | {type(value): value for value in values}


def valid_arguments(name, member, samples):
    """Return a value for each required argument, right in its type where samples have one."""
    if name in VALID_ARGUMENTS:
        return VALID_ARGUMENTS[name]
    is_plain_class = inspect.isclass(member) and not dataclasses.is_dataclass(member)
    owner = getattr(member, "function", member.__init__ if is_plain_class else member)
    hints = typing.get_type_hints(owner)
    return {
        parameter.name: sample_of_annotation(hints.get(parameter.name), samples)
        for parameter in named_parameters(member)
        if parameter.default is parameter.empty
    }


def sample_of_annotation(hint, samples):
    origin, members = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return members[0]
    if origin is tuple:
        return tuple(
            sample_of_annotation(member, samples) for member in members if member is not Ellipsis
        )
    choices = members if origin in (typing.Union, types.UnionType) else (hint,)
    return next((samples[c] for c in choices if inspect.isclass(c) and c in samples), None)


def named_parameters(member):
    parameters = inspect.signature(member).parameters.values()
    return [p for p in parameters if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("namespace", nightly_except(10, SPACES))
def test_wrong_arguments_raise_no_foreign_error(namespace, samples, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    foreign = []
    for name, member in public_callables(namespace).items():
        valid = valid_arguments(f"{namespace}.{name}", member, samples)
        alternatives = [dict.fromkeys(valid, wrong) for wrong in WRONG_VALUES if valid]
        alternatives += [
            {**valid, parameter.name: wrong}
            for parameter in named_parameters(member)
            for wrong in WRONG_VALUES
            if wrong is not parameter.default
        ]
        for arguments in alternatives:
            try:
                with plain_twins_for_small_work(0):
                    member(**arguments)
            except dc.DechirpError as error:
                check_error_is_complete(error)
            except Exception as error:
                foreign.append(f"{name}({arguments}): {error!r}")

    assert foreign == []


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dc.run("s.yaml"), r"^scenario: 's.yaml'; .*; read a file with dechirp.load\('s"),
        (lambda: dc.detect("a.bin", dc.reference().radar), r"^cube: 'a.bin'; expected DataArray"),
        (lambda: dc.write("a.bin", "b.npz"), r"^recording: .*dechirp.open\('a.bin'\)$"),
        (lambda: dc.run_study("s.yaml", "out"), r"^study: .*dechirp.load_study\('s.yaml'\)$"),
        (lambda: dc.run_tune("t.yaml", "out"), r"^tune: .*dechirp.load_tune\('t.yaml'\)$"),
        (
            lambda: dc.cfar.cfar_threshold(np.ones(30), n_training="8", n_guard=1, pfa=1e-3),
            r"^n_training: '8'; expected a whole number",
        ),
        (
            lambda: dc.slow_time.frame_means(xr.DataArray(np.zeros(3), dims="time")),
            r"^trace: an array over time; expected .* with the coordinate frame; pass what",
        ),
        (lambda: dc.theory.calibrate_factor(1), r"^statistic: missing; "),
        (
            lambda: dc.object_lists.StatusSignal(signal="S", confirmed="x"),
            r"^StatusSignal\.confirmed: 'x'; expected a list, each a whole number; ",
        ),
        (
            lambda: dc.studies.RandomSetting(
                path="seed", distribution="uniform", first=None, second=2
            ),
            r"^RandomSetting\.first: None; expected a number; see help\(RandomSetting\)",
        ),
        (
            lambda: dc.studies.SweptSetting(path="seed", texts=3),
            r"^SweptSetting\.texts: 3; expected a list, each a text; ",
        ),
        (
            lambda: dc.extensions.parse_radar("radar.yaml", object()),
            r"^radar_settings: Object of type object is not JSON",
        ),
        (
            lambda: dc.extensions.scaled_window_means(power=np.ones((4, 4))),
            r"^scaled_window_means\.factors: missing; ",
        ),
    ],
)
def test_wrong_argument_is_named_with_its_value(call, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        call()


def test_error_of_a_right_call_stays_as_it_is():
    def statistic(powers):
        raise TypeError("from the function of the caller")

    window = dc.theory.CorrelatedWindow(
        range_covariance=np.eye(5),
        velocity_covariance=np.eye(5),
        guard_range=slice(1, 4),
        guard_velocity=slice(1, 4),
        cell_under_test=(2, 2),
    )
    with pytest.raises(TypeError, match="from the function of the caller"):
        dc.theory.calibrate_factor(1e-2, statistic, window)


def test_error_of_a_function_of_any_value_stays_as_it_is():
    @check_argument_types
    def fail(value: typing.Any) -> None:
        raise ValueError("from the function itself")

    with pytest.raises(ValueError, match="from the function itself"):
        fail(1)
