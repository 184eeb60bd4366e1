"""Unknown, superfluous and missing arguments of public functions and classes."""

import dataclasses
import inspect
import re

import pytest

import dechirp as dc
from bad_input.entries import check_error_is_complete
from dechirp.core.values import frozen_dataclass
from test_api import NAMESPACES

# Closed forms and base classes are plain: Python's own TypeError names their arguments.
PLAIN = ("theory", "link_budget", "windows", "extensions")
SPACES = [dc, *(getattr(dc, name) for name in NAMESPACES if name not in PLAIN)]
CALLABLES = {
    f"{space.__name__}.{name}": member
    for space in SPACES
    for name in space.__all__
    if callable(member := getattr(space, name))
    # Exceptions and results are not called by users.
    and not (inspect.isclass(member) and issubclass(member, Exception | tuple))
    # Python's own error of a class without arguments says so.
    and getattr(member, "__init__", None) is not object.__init__
}


@pytest.mark.parametrize("name", CALLABLES)
def test_unknown_argument_is_named(name):
    with pytest.raises(
        dc.InvalidSetting, match=r"\.unknown_argument: unknown argument; "
    ) as caught:
        CALLABLES[name](unknown_argument=1)
    check_error_is_complete(caught.value)


@pytest.mark.parametrize("namespace", [dc, *(getattr(dc, name) for name in NAMESPACES)])
def test_docstring_names_each_of_several_arguments(namespace):
    undocumented = []
    for name in namespace.__all__:
        function = getattr(namespace, name)
        if not inspect.isroutine(function):
            continue
        parameters = [p.name for p in inspect.signature(function).parameters.values() if p.kind < 4]
        words = set(re.findall(r"\w+", inspect.getdoc(function)))
        if len(parameters) > 1 and (missing := set(parameters) - words):
            undocumented.append((name, missing))
    assert undocumented == []


@pytest.mark.parametrize("namespace", [dc.theory, dc.link_budget, dc.windows, dc.cfar, dc.angle])
def test_signatures_are_visible_and_python_names_unknown_and_missing_arguments(namespace):
    functions = [getattr(namespace, name) for name in namespace.__all__]
    for function in filter(inspect.isfunction, functions):
        parameters = inspect.signature(function).parameters
        assert not {"args", "kwargs"} & parameters.keys()
        with pytest.raises((TypeError, dc.InvalidSetting), match="unknown_argument"):
            function(unknown_argument=1)
        required = [p.name for p in parameters.values() if p.default is p.empty and p.kind != 4]
        if required:
            with pytest.raises((TypeError, dc.InvalidSetting), match=required[0]):
                function()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: dc.Chirp(slope=3),
            r"Chirp\.slope: unknown argument; expected one of start_frequency_hz, slope_hz_per_s",
        ),
        (
            lambda: dc.Cells(range=1),
            r"Cells\.velocity: missing; .* write Cells\(velocity=",
        ),
        (lambda: dc.Cells(1, 2), r"Cells: 2 given without a name; expected at most 0"),
        (
            lambda: dataclasses.replace(dc.Dbscan(), min_detection=2),
            r"Dbscan\.min_detection: .*; did you mean min_detections\?",
        ),
        (lambda: dc.detect(1, 2, 3, 4), r"detect: 4 given without a name; expected at most"),
        (lambda: dc.detect(1, cube=2), r"detect\.cube: two values"),
    ],
)
def test_wrong_call_is_explained(call, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        call()


def test_error_within_constructor_is_not_hidden():
    @frozen_dataclass
    class Value:
        x: float

        def __post_init__(self):
            raise TypeError("from the class itself")

    with pytest.raises(TypeError, match="from the class itself"):
        Value(x=1.0)


@pytest.mark.parametrize(
    ("call", "setting"),
    [
        (lambda: dc.Radar(frame=None), r"Radar\.frame: None; expected a Frame"),
        (lambda: dc.Radar(frame=dc.reference().radar.frame, array=1), r"Radar\.array: 1"),
        (lambda: dc.Radar(frame=dc.reference().radar.frame, hardware=[]), r"Radar\.hardware"),
        (lambda: dc.Frame(chirp=1, n_chirps=8, interval_s=1e-4), r"Frame\.chirp: 1"),
        (lambda: dc.Study(scenario=[], scores=()), r"Study\.scenario: \[\]"),
    ],
)
def test_value_of_another_class_is_named(call, setting):
    with pytest.raises(dc.InvalidSetting, match=setting):
        call()
