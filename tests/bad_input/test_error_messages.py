"""Error messages of every exception class: setting, value, expectation and fix.

The classes are collected from the source. Each needs a case here that raises it through the public
interface; a new class without a case fails.
"""

import ast
import builtins
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
import zarr

import dechirp
import dechirp as dc
from bad_input.entries import RADAR_YAML, check_error_is_complete
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import check_free_memory

SRC = Path(dechirp.__file__).parent


def _make_chirp(**changes: object) -> dc.Chirp:
    settings = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 30e12,
        "ramp_duration_s": 30e-6,
        "sample_rate_hz": 10e6,
        "n_samples": 64,
        "sampling": "complex",
    }
    return dc.Chirp(**(settings | changes))


def _open_foreign_study(folder: Path) -> None:
    (folder / "study.sqlite").write_bytes(b"something else")
    from dechirp.experiments.study.ledger_reader import LedgerReader

    LedgerReader.open_read_only(folder)


def _request_huge_cube(_: Path) -> None:
    check_free_memory("the cube", needed_bytes=1e18, fix="take fewer chirps")


def _simulate_far_target(_: Path) -> None:
    parts = dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0)
    frame = dc.Frame(chirp=_make_chirp(), n_chirps=16, interval_s=40e-6)
    radar = dc.Radar(frame=frame, hardware=parts)
    scene = dc.Scene(targets=[dc.Target(position_m=(900, 0, 0), rcs_m2=10)])
    dc.simulate(scene, radar, seed=1)


def _open_cut_traffic(folder: Path) -> None:
    path = folder / "traffic.csv"
    path.write_text("time,id,class,x,y,heading,length,width,height\n0.1,3,ca")
    dc.open_traffic(path)


CASES: tuple[tuple[str, Callable[[Path], object], str, str, str, str], ...] = (
    (
        "CutTrafficError",
        _open_cut_traffic,
        "traffic.csv",
        "line 2 (id 3, time 0.1), which has no line end",
        "complete rows",
        "complete the last row",
    ),
    (
        "InvalidSetting",
        lambda _: _make_chirp(ramp_duration_s=9.9999999e-6, sample_rate_hz=6.3e6),
        "Chirp.ramp_duration_s",
        "9.9999999 us",
        "at least 10 us, the time of the last sample",
        "lengthen the ramp",
    ),
    (
        "InvalidSetting",
        lambda _: _make_chirp(n_samples=True),
        "Chirp.n_samples",
        "True",
        "a whole number from 2 to",
        "give a whole number",
    ),
    (
        "InvalidFile",
        lambda folder: dc.load(_write_text(folder, "sed: 1\n")),
        "scenario.yaml:1:1: sed: ",
        "unknown setting",
        "one of name, seed, n_frames",
        "did you mean seed?",
    ),
    (
        "InvalidFile",
        lambda folder: dc.load(_write_text(folder, "channelCfg 1 5 0\n", "x.cfg")),
        "x.cfg: the file: ",
        "settings of a radar, as its vendor writes them",
        "a scenario: YAML",
        "dechirp.open(RECORDING, radar=FILE)",
    ),
    (
        "RecordingError",
        lambda folder: dc.open(_write_text(folder, "", "empty.bin")),
        "empty.bin: recording: ",
        "an empty file (0 bytes)",
        "a recording",
        "copy it again",
    ),
    (
        "RecordingError",
        lambda folder: dc.object_lists.read_objects(
            _write_text(folder, "a text, and no log\n", "log.asc")
        ),
        "log.asc: recording: ",
        "it has no readable frame",
        "a complete log",
        "or give a valid file",
    ),
    (
        "NotEnoughMemory",
        _request_huge_cube,
        "the cube",
        "9.31e+08 GiB of memory",
        "GiB, the free memory",
        "take fewer chirps",
    ),
    (
        "DechirpError",
        _open_foreign_study,
        "study.sqlite",
        "no database",
        "the record of a study, or no file",
        "name another folder with --out",
    ),
    (
        "ReferencedFileError",  # reported as an InvalidFile of the named file
        lambda folder: dc.load(
            _write_text(folder, f"radar: {_write_text(folder, 'frame: 3', 'radar.yaml').name}\n")
        ),
        "radar.yaml:1:8: frame: ",
        "3",
        "a mapping of",
        "write its settings below it",
    ),
    (
        "PhysicsWarning",
        _simulate_far_target,
        "scene.targets",
        "",
        "",
        "",
    ),
)
"""Class, trigger, and parts of its message: location, value, expectation, fix."""

INTERNAL_CLASSES = {
    "_ConfirmationFailed": "caught for a candidate, whose mistakes become warnings",
    "_NotACodeError": "caught in the module that raises it",
    "WorkerStopped": "ends a loop, never reaches a user",
    "_SettingsChanged": "ends a loop of the studio in the module that raises it",
}
"""Classes that never reach a user, with the reason."""


def _write_text(folder: Path, text: str, name: str = "scenario.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


@cache
def _read_sources() -> dict[str, str]:
    """Read the text of every file of the package."""
    files = sorted(SRC.rglob("*.py"))
    return {str(file.relative_to(SRC)): file.read_text(encoding="utf-8") for file in files}


def _list_error_classes() -> set[str]:
    """List the names of all exceptions and warnings that the package defines."""
    defined = re.compile(r"^class (\w+)\(([^)]*)\):", re.MULTILINE)
    bases = {
        name: set(re.findall(r"\w+", base_names))
        for t in _read_sources().values()
        for name, base_names in defined.findall(t)
    }
    builtin_exceptions = {
        name
        for name, value in vars(builtins).items()
        if isinstance(value, type) and issubclass(value, BaseException)
    }
    error_classes: set[str] = set()
    while (
        subclasses := {
            name
            for name, base_names in bases.items()
            if base_names & (builtin_exceptions | error_classes)
        }
        - error_classes
    ):
        error_classes |= subclasses
    return error_classes


def test_every_error_class_has_case():
    known_classes = {name for name, *_ in CASES} | set(INTERNAL_CLASSES)
    assert _list_error_classes() == known_classes


@pytest.mark.parametrize(("name", "trigger", "location", "value", "expected", "fix"), CASES)
def test_error_gives_location_value_expectation_and_fix(
    name, trigger, location, value, expected, fix, tmp_path
):
    if name == "PhysicsWarning":
        with pytest.warns(PhysicsWarning) as warnings:
            trigger(tmp_path)
        (finding,) = warnings[0].message.args
        assert isinstance(finding, Finding)
        assert all((finding.setting, finding.value, finding.expected, finding.fix))
        assert str(finding) == str(warnings[0].message)
        return
    with pytest.raises(DechirpError) as caught:
        trigger(tmp_path)
    error_class = "InvalidFile" if name == "ReferencedFileError" else name
    assert type(caught.value).__name__ == error_class
    check_error_is_complete(caught.value)
    mistake = caught.value.mistakes[0]
    assert location in str(mistake).partition("; expected ")[0]
    message = str(mistake).partition(f"{mistake.setting}: ")[2]
    assert value in message and expected in mistake.expected and fix in mistake.fix
    assert message.endswith(f"; expected {mistake.expected}; {mistake.fix}")


def test_unprintable_characters_are_escaped_in_messages():
    with pytest.raises(DechirpError) as caught:
        dc.reference(["name.\x1b[2J=\n"])
    assert str(caught.value).isprintable()
    with pytest.raises(DechirpError) as caught:
        dc.open("no\x1b[2J\n.bin")
    assert str(caught.value).isprintable() and "\\x1b" in str(caught.value)


def test_long_foreign_texts_are_shortened_in_the_middle(tmp_path):
    # A codec name of 5,000 characters was once quoted whole.
    array = zarr.create_array(tmp_path / "x.zarr", shape=(2, 2), dtype="float32")
    array[:] = 1
    file = tmp_path / "x.zarr" / "zarr.json"
    metadata = json.loads(file.read_text())
    metadata["codecs"] = [{"name": f"first{'x' * 5000}last"}]
    file.write_text(json.dumps(metadata))
    with pytest.raises(RecordingError) as caught:
        dc.open(tmp_path / "x.zarr", radar=_write_text(tmp_path, RADAR_YAML, "radar.yaml"))
    (mistake,) = caught.value.mistakes
    assert "codec firstxxx" in mistake.value and mistake.value.endswith("xlast")
    assert "xxx ... xxx" in mistake.value and len(mistake.value) == 300
    assert str(file.parent) in str(caught.value) and len(str(caught.value)) < 1000


@pytest.mark.parametrize(("part", "limit"), [("value", 300), ("expected", 1000), ("fix", 1000)])
def test_parts_of_messages_are_shortened_once(part, limit):
    texts = {"value": "1", "expected": "at least 2", "fix": "raise it"} | {part: "ab" * limit}
    (mistake,) = dc.InvalidSetting("Chirp.n_samples", **texts).mistakes
    shortened = getattr(mistake, part)
    assert len(shortened) == limit and " ... " in shortened
    assert replace(mistake, file="radar.yaml").value == mistake.value  # not shortened again


# Messages in the source


def _iter_calls_with_fix() -> Iterator[tuple[str, ast.Call]]:
    for name, text in _read_sources().items():
        if "fix=" in text:
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call):
                    yield f"{name}:{node.lineno}", node


def _iter_possible_texts(node: ast.expr) -> Iterator[str]:
    """Iterate over the texts that an expression can evaluate to, if literal."""
    match node:
        case ast.Constant(value=str() as text):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(p.value if isinstance(p, ast.Constant) else "…" for p in parts)
        case ast.IfExp(body=body, orelse=alternative):
            yield from _iter_possible_texts(body)
            yield from _iter_possible_texts(alternative)


def test_all_messages_have_same_form():
    """Check the form `SETTING: VALUE; expected EXPECTED; FIX` of all messages in the source."""
    violations, n_read = [], 0
    for place, call in _iter_calls_with_fix():
        arguments = {keyword.arg: keyword.value for keyword in call.keywords}
        if not {"value", "expected", "fix"} <= set(arguments):
            continue
        for part in ("value", "expected", "fix"):
            for text in _iter_possible_texts(arguments[part]):
                n_read += 1
                ends_badly = re.search(r"(?<!\.)[.,;:]$", text)
                is_sentence = part == "fix" and re.match(r"[A-Z][a-z]+ ", text)
                repeats_keyword = part == "expected" and re.match(
                    r"(must|is|should|expected) ", text
                )
                if not text.strip() or ends_badly or is_sentence or repeats_keyword or "  " in text:
                    violations.append(f"{place}: {part}={text!r}")
    assert not violations, "\n".join(violations)
    assert n_read > 1000


def test_raised_classes_are_package_errors_or_builtins():
    """Allow built-in exceptions for misuse of an interface, or if caught in the same file."""
    raised = {
        name
        for text in _read_sources().values()
        for name in re.findall(r"\n +raise ([A-Z]\w+)", text)
    }
    assert raised - _list_error_classes() <= {
        "AttributeError",
        "BrokenPipeError",
        "EOFError",
        "FileNotFoundError",
        "IsADirectoryError",
        "KeyError",
        "KeyboardInterrupt",
        "NotImplementedError",
        "OSError",
        "PydanticCustomError",
        "RuntimeError",  # ends a compilation when the studio ends: no page is left to read it
        "SystemExit",
        "TypeError",
        "ValueError",
    }
