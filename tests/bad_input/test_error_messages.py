"""Every class of error says where, what was got, what is needed and how to mend it.

The classes are found by walking the package. Each has cases here that make it happen through what
a user calls; a class that somebody adds has none, and fails.
"""

import ast
import builtins
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

import dechirp
import dechirp as dc
from bad_input.entries import must_say_all
from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import check_free_memory

SRC = Path(dechirp.__file__).parent


def _chirp(**changed: object) -> dc.Chirp:
    told = {
        "start_frequency_hz": 77e9,
        "slope_hz_per_s": 30e12,
        "ramp_duration_s": 30e-6,
        "sample_rate_hz": 10e6,
        "n_samples": 64,
        "sampling": "complex",
    }
    return dc.Chirp(**(told | changed))


def _study(folder: Path) -> None:
    (folder / "study.sqlite").write_bytes(b"something else")
    from dechirp.experiments.study.ledger_reader import LedgerReader

    LedgerReader.open_existing(folder)


def _huge_cube(_: Path) -> None:
    check_free_memory("the cube", needed_bytes=1e18, fix="take fewer chirps")


def _far_target(_: Path) -> None:
    parts = dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0)
    frame = dc.Frame(chirp=_chirp(), n_chirps=16, interval_s=40e-6)
    radar = dc.Radar(frame=frame, hardware=parts)
    scene = dc.Scene(targets=[dc.Target(position_m=(900, 0, 0), rcs_m2=10)])
    dc.simulate(scene, radar, seed=1)


CASES: tuple[tuple[str, Callable[[Path], object], str, str, str, str], ...] = (
    (
        "InvalidSetting",
        lambda _: _chirp(ramp_duration_s=9.9999999e-6, sample_rate_hz=6.3e6),
        "Chirp.ramp_duration_s",
        "9.9999999e-06 s",
        "at least 1e-05 s, the time of the last sample",
        "lengthen the ramp",
    ),
    (
        "InvalidSetting",
        lambda _: _chirp(n_samples=True),
        "Chirp.n_samples",
        "True",
        "a whole number from 2 to",
        "give a whole number",
    ),
    (
        "InvalidFile",
        lambda folder: dc.load(_written(folder, "sed: 1\n")),
        "scenario.yaml:1:1: sed: ",
        "not a known name",
        "one of name, seed, n_frames",
        "did you mean seed?",
    ),
    (
        "InvalidFile",
        lambda folder: dc.load(_written(folder, "channelCfg 1 5 0\n", "x.cfg")),
        "x.cfg: the file: ",
        "settings of a radar, as its vendor writes them",
        "a scenario: YAML",
        "dechirp.open(RECORDING, radar=FILE)",
    ),
    (
        "RecordingError",
        lambda folder: dc.open(_written(folder, "", "empty.bin")),
        "empty.bin: recording: ",
        "an empty file (0 bytes)",
        "a recording",
        "copy it again",
    ),
    (
        "RecordingError",
        lambda folder: dc.object_lists.read_objects(
            _written(folder, "a text, and no log\n", "log.asc")
        ),
        "log.asc: recording: ",
        "it has no readable frame",
        "a complete log",
        "or give a valid file",
    ),
    (
        "NotEnoughMemory",
        _huge_cube,
        "the cube",
        "9.31e+08 GiB of memory",
        "GiB, the free memory",
        "take fewer chirps",
    ),
    (
        "DechirpError",
        _study,
        "study.sqlite",
        "no database",
        "the record of a study, or absent",
        "name another folder with --out",
    ),
    (
        "ReferencedFileError",  # told as an InvalidFile of the file that is named
        lambda folder: dc.load(
            _written(folder, f"radar: {_written(folder, 'frame: 3', 'radar.yaml').name}\n")
        ),
        "radar.yaml:1:8: frame: ",
        "3",
        "a mapping of",
        "write its settings below it",
    ),
    (
        "PhysicsWarning",
        _far_target,
        "scene.targets",
        "",
        "",
        "",
    ),
)
"""Class, what makes it happen, and parts of its text: where, got, need, fix."""

OF_OTHERS = {
    "UnknownElementError": "for who adds to the template of reports: a test of the PDF reads it",
    "_ConfirmationFailed": "of a candidate, whose mistakes become warnings where it is caught",
    "_NotACodeError": "caught in the file that raises it",
    "WorkerStopped": "ends a loop, and reaches nobody",
}
"""Classes that are no message to a user."""


def _written(folder: Path, text: str, name: str = "scenario.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


@cache
def _source() -> dict[str, str]:
    """Text of every file of the package."""
    files = sorted(SRC.rglob("*.py"))
    return {str(file.relative_to(SRC)): file.read_text(encoding="utf-8") for file in files}


def _classes() -> set[str]:
    """Names of every exception and warning that the package defines."""
    defined = re.compile(r"^class (\w+)\(([^)]*)\):", re.MULTILINE)
    bases = {
        name: set(re.findall(r"\w+", of))
        for t in _source().values()
        for name, of in defined.findall(t)
    }
    known = {
        n
        for n, one in vars(builtins).items()
        if isinstance(one, type) and issubclass(one, BaseException)
    }
    made: set[str] = set()
    while more := {name for name, of in bases.items() if of & (known | made)} - made:
        made |= more
    return made


def test_every_class_of_error_has_a_case_that_makes_it_happen():
    named = {name for name, *_ in CASES} | set(OF_OTHERS)
    assert _classes() == named


@pytest.mark.parametrize(("name", "make", "where", "value", "expected", "fix"), CASES)
def test_an_error_says_where_and_what_and_how_to_mend_it(
    name, make, where, value, expected, fix, tmp_path
):
    if name == "PhysicsWarning":
        with pytest.warns(PhysicsWarning) as heard:
            make(tmp_path)
        (said,) = heard[0].message.args
        assert isinstance(said, Finding)
        assert all((said.setting, said.value, said.expected, said.fix))
        assert str(said) == str(heard[0].message)
        return
    with pytest.raises(DechirpError) as caught:
        make(tmp_path)
    error_class = "InvalidFile" if name == "ReferencedFileError" else name
    assert type(caught.value).__name__ == error_class
    must_say_all(caught.value)
    one = caught.value.mistakes[0]
    assert where in str(one).partition("; expected ")[0]
    rest = str(one).partition(f"{one.setting}: ")[2]
    assert value in rest and expected in one.expected and fix in one.fix
    assert rest.endswith(f"; expected {one.expected}; {one.fix}")


def test_what_cannot_be_printed_is_told_all_the_same():
    with pytest.raises(DechirpError) as caught:
        dc.reference(["name.\x1b[2J=\n"])
    assert str(caught.value).isprintable()
    with pytest.raises(DechirpError) as caught:
        dc.open("no\x1b[2J\n.bin")
    assert str(caught.value).isprintable() and "\\x1b" in str(caught.value)


# Every place that raises


def _calls() -> Iterator[tuple[str, ast.Call]]:
    for name, text in _source().items():
        if "fix=" in text:
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call):
                    yield f"{name}:{node.lineno}", node


def _texts(node: ast.expr) -> Iterator[str]:
    """Texts that an expression may be, where they can be read off."""
    match node:
        case ast.Constant(value=str() as text):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(p.value if isinstance(p, ast.Constant) else "…" for p in parts)
        case ast.IfExp(body=one, orelse=other):
            yield from _texts(one)
            yield from _texts(other)


def test_every_message_of_the_package_has_one_form():
    """Check the form `SETTING: VALUE; expected EXPECTED; FIX` of all messages in the source."""
    wrong, n_read = [], 0
    for place, call in _calls():
        given = {word.arg: word.value for word in call.keywords}
        if not {"value", "expected", "fix"} <= set(given):
            continue
        for part in ("value", "expected", "fix"):
            for text in _texts(given[part]):
                n_read += 1
                ends_badly = re.search(r"(?<!\.)[.,;:]$", text)
                is_sentence = part == "fix" and re.match(r"[A-Z][a-z]+ ", text)
                twice = part == "expected" and re.match(r"(must|is|should|expected) ", text)
                if not text.strip() or ends_badly or is_sentence or twice or "  " in text:
                    wrong.append(f"{place}: {part}={text!r}")
    assert not wrong, "\n".join(wrong)
    assert n_read > 1000


def test_what_is_raised_by_name_is_an_error_of_the_package_or_of_python():
    """Of Python: for who misuses an interface, or within a file that catches it again."""
    raised = {
        name for text in _source().values() for name in re.findall(r"\n +raise ([A-Z]\w+)", text)
    }
    assert raised - _classes() <= {
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
        "SystemExit",
        "TypeError",
        "ValueError",
    }
