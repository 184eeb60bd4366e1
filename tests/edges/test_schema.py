"""The JSON Schema of settings files says what reading them says."""

import copy
import json
import random
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings, read_settings
from dechirp.config.yaml_tree import Plain, parse_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import READERS
from dechirp.experiments.study.dumping import dump_study

EXAMPLES = Path(dc.__file__).parents[2] / "examples"
KINDS = ["scenario", "study", "tune", "radar", "requirements"]
REQUIREMENTS = "{max_range: 200 m, range_resolution: 1 m, max_velocity: 100 m/s, carrier: 77 GHz}"


def kind_of(path: Path) -> str:
    if path.parent.name == "studies":
        return "study"
    return {"tune": "tune", "radar": "radar"}.get(path.stem, "scenario")


FILES = {
    str(path.relative_to(EXAMPLES)): kind_of(path)
    for path in sorted(EXAMPLES.rglob("*.yaml"))
    # One of the tracker alone, which no command reads; one of a package that is not installed.
    if path.stem not in ("crossing-tracks", "spur")
}


@cache
def checker(kind: str) -> Draft202012Validator:
    """What `dechirp schema` prints, checked and ready."""
    import contextlib
    import io

    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit) as ended:
        main(["schema", kind])
    assert ended.value.code == 0
    schema = json.loads(printed.getvalue())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def plain(text: str) -> Plain:
    return parse_yaml(text, "").plain_data


def wrong(kind: str, content: Plain) -> str:
    """The first thing that the schema finds wrong; empty without."""
    return next((error.message for error in checker(kind).iter_errors(content)), "")


@pytest.mark.parametrize("name", FILES)
def test_every_example_is_as_its_schema_says(name):
    assert wrong(FILES[name], plain((EXAMPLES / name).read_text(encoding="utf-8"))) == ""


@pytest.mark.parametrize("name", [name for name, kind in FILES.items() if kind == "scenario"])
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_scenario_as_run_is_as_the_schema_says(name):
    assert wrong("scenario", plain(dump(dc.load(EXAMPLES / name)))) == ""


@pytest.mark.parametrize("name", [name for name, kind in FILES.items() if kind == "study"])
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_study_as_run_is_as_the_schema_says(name):
    assert wrong("study", plain(dump_study(dc.load_study(EXAMPLES / name)))) == ""


def test_the_reference_and_a_design_are_as_their_schemas_say():
    assert wrong("scenario", plain(dump(dc.reference()))) == ""
    assert wrong("requirements", plain(REQUIREMENTS)) == ""


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("n_chirps: ", "n_chrips: "),
        ("start_frequency: 77 GHz", "start_frequency: 77"),
        ("start_frequency: 77 GHz", "start_frequency: 77 m"),
        ("start_frequency: 77 GHz", "start_frequency: 77 Ghz"),
        ("kind: thermal-noise", "kind: thermal-nose"),
        ("sampling: complex", "sampling: quadrature"),
        ("n_frames: 20", "n_frames: 2.5"),
        ("[60 m, 3 m, 0 m]", "[60 m, 3 m]"),
        ("rcs: 10 dBsm", "rcs: 10 dB"),
    ],
)
def test_what_is_misspelt_or_lacks_its_unit_is_refused(before, after):
    text = (EXAMPLES / "overtaking-car.yaml").read_text(encoding="utf-8")
    assert before in text
    mended = text.replace(before, after, 1)

    assert wrong("scenario", plain(mended))
    with pytest.raises(DechirpError):
        parse_settings(mended, dc.Scenario, readers=READERS)


@pytest.mark.parametrize(
    "text",
    ["77 GHz", "77GHz", "+7.7e10 Hz", ".077 THz", "76 MS/ms", "'0'", "0", "7.7e7 m/mm/s/h", "1/s"],
)
def test_a_schema_takes_quantities_as_reading_does(text):
    file = f"{{max_range: 200 m, range_resolution: 1 m, max_velocity: 100 m/s, carrier: {text}}}"
    told = []
    try:
        parse_settings(file, dc.Requirements)
    except DechirpError as error:
        told = [
            one for one in error.mistakes if "a frequency" in one.expected
        ]  # not a matter of size
    # Of three units in a row the schema leaves it to reading whether they fit.
    assert bool(wrong("requirements", plain(file))) == bool(told) or text.count("/") > 1


@pytest.mark.parametrize(
    "name",
    [
        "overtaking-car.yaml",
        "interference.yaml",
        "rain.yaml",
        "studies/detection-range.yaml",
        "studies/data-set.yaml",
        "tune.yaml",
        "radar.yaml",
    ],
)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_what_the_schema_refuses_reading_refuses(name, tmp_path):
    folder = tmp_path / "examples"
    shutil.copytree(EXAMPLES, folder)
    content = plain((EXAMPLES / name).read_text(encoding="utf-8"))
    kind = FILES[name]
    rng = random.Random(name)
    every = list(spoilt(content))
    drawn = rng.sample(every, min(len(every), 40))
    refused = [one for one in drawn if wrong(kind, one)]
    assert len(refused) > len(drawn) / 4  # or the schema says little

    for one in refused:
        (folder / name).write_text(json.dumps(one), encoding="utf-8")
        with pytest.raises(DechirpError):
            opened(folder / name, kind)


def opened(path: Path, kind: str) -> object:
    """Read a file as its command does."""
    match kind:
        case "study":
            return dc.load_study(path)
        case "tune":
            return dc.load_tune(path)
        case "radar":
            return read_settings(path, dc.Radar, readers=READERS)
    return dc.load(path)


def spoilt(whole: Plain) -> Iterator[Plain]:
    """The same settings, each time with one of them otherwise."""
    for path in paths(whole):
        for change in (_misspelt, _left_out, _bare, lambda _: None, lambda _: True, lambda _: []):
            made = copy.deepcopy(whole)
            *before, last = path
            at = made
            for step in before:
                at = at[step]
            if change is _misspelt and isinstance(last, str):
                at[f"{last}x"] = at.pop(last)
            elif change is _left_out:
                del at[last]
            elif change is not _misspelt:
                at[last] = change(at[last])
            if made != whole:
                yield made


def _misspelt(one: Plain) -> Plain:
    return one


def _left_out(one: Plain) -> Plain:
    return one


def _bare(one: Plain) -> Plain:
    """A quantity without its unit, a name in upper case."""
    if not isinstance(one, str):
        return one
    number = one.partition(" ")[0]
    return plain(number) if number != one else one.upper()


def paths(content: Plain, before: tuple = ()) -> Iterator[tuple]:
    """Where each setting stands."""
    keys = content if isinstance(content, dict) else range(len(content))
    for key in keys:
        yield (*before, key)
        if isinstance(content[key], dict | list):
            yield from paths(content[key], (*before, key))
