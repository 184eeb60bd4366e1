"""JSON Schema of settings files: agreement with the reader."""

import copy
import json
import random
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings, read_settings
from dechirp.config.yaml_tree import Plain, parse_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import READERS
from dechirp.experiments.study.dumping import dump_study_as_yaml
from nightly import nightly, nightly_except

if TYPE_CHECKING:
    from jsonschema import Draft202012Validator

EXAMPLES = Path(dc.__file__).parents[2] / "examples"
KINDS = ["scenario", "study", "tune", "radar", "requirements"]
REQUIREMENTS = "{max_range: 200 m, range_resolution: 1 m, max_velocity: 100 m/s, carrier: 77 GHz}"


def detect_kind(path: Path) -> str:
    if path.parent.name == "studies":
        return "study"
    return {"tune": "tune", "radar": "radar"}.get(path.stem, "scenario")


FILES = {
    str(path.relative_to(EXAMPLES)): detect_kind(path)
    for path in sorted(EXAMPLES.rglob("*.yaml"))
    # `crossing-tracks` is read by no command; `spur` needs a package that is not installed.
    if path.stem not in ("crossing-tracks", "spur")
}


@cache
def make_validator(kind: str) -> "Draft202012Validator":
    """Return a validator of the schema that `dechirp schema` prints."""
    import contextlib
    import io

    from jsonschema import Draft202012Validator  # takes 1.7 s, which collection need not

    output = io.StringIO()
    with contextlib.redirect_stdout(output), pytest.raises(SystemExit) as exit_info:
        main(["schema", kind])
    assert exit_info.value.code == 0
    schema = json.loads(output.getvalue())
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def parse_plain(text: str) -> Plain:
    return parse_yaml(text, "").plain_data


def find_schema_error(kind: str, content: Plain) -> str:
    """Return the first error of the schema, or an empty text."""
    return next((error.message for error in make_validator(kind).iter_errors(content)), "")


@pytest.mark.parametrize("name", nightly_except(6, FILES))
def test_every_example_matches_schema(name):
    assert (
        find_schema_error(FILES[name], parse_plain((EXAMPLES / name).read_text(encoding="utf-8")))
        == ""
    )


@pytest.mark.parametrize(
    "name", nightly_except(4, [name for name, kind in FILES.items() if kind == "scenario"])
)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_dumped_scenario_matches_schema(name):
    assert find_schema_error("scenario", parse_plain(dump_yaml(dc.load(EXAMPLES / name)))) == ""


@nightly
@pytest.mark.parametrize("name", [name for name, kind in FILES.items() if kind == "study"])
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_every_dumped_study_matches_schema(name):
    assert (
        find_schema_error("study", parse_plain(dump_study_as_yaml(dc.load_study(EXAMPLES / name))))
        == ""
    )


def test_reference_and_requirements_match_schemas():
    assert find_schema_error("scenario", parse_plain(dump_yaml(dc.reference()))) == ""
    assert find_schema_error("requirements", parse_plain(REQUIREMENTS)) == ""


@pytest.mark.parametrize(
    ("original", "replacement"),
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
def test_schema_and_reader_reject_misspelt_names_and_missing_units(original, replacement):
    text = (EXAMPLES / "overtaking-car.yaml").read_text(encoding="utf-8")
    assert original in text
    changed_text = text.replace(original, replacement, 1)

    assert find_schema_error("scenario", parse_plain(changed_text))
    with pytest.raises(DechirpError):
        parse_settings(changed_text, dc.Scenario, readers=READERS)


@pytest.mark.parametrize(
    "text",
    ["77 GHz", "77GHz", "+7.7e10 Hz", ".077 THz", "76 MS/ms", "'0'", "0", "7.7e7 m/mm/s/h", "1/s"],
)
def test_schema_accepts_same_quantities_as_reader(text):
    settings_text = (
        f"{{max_range: 200 m, range_resolution: 1 m, max_velocity: 100 m/s, carrier: {text}}}"
    )
    unit_errors = []
    try:
        parse_settings(settings_text, dc.Requirements)
    except DechirpError as error:
        # Size limits are not in the schema.
        unit_errors = [mistake for mistake in error.mistakes if "a frequency" in mistake.expected]
    # The schema does not check chains of three units; the reader does.
    assert (
        bool(find_schema_error("requirements", parse_plain(settings_text))) == bool(unit_errors)
        or text.count("/") > 1
    )


@pytest.mark.parametrize(
    "name",
    nightly_except(
        ("rain.yaml", "radar.yaml"),
        [
            "overtaking-car.yaml",
            "interference.yaml",
            "rain.yaml",
            "studies/detection-range.yaml",
            "studies/data-set.yaml",
            "tune.yaml",
            "radar.yaml",
        ],
    ),
)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_reader_rejects_settings_that_schema_rejects(name, tmp_path):
    folder = tmp_path / "examples"
    shutil.copytree(EXAMPLES, folder)
    content = parse_plain((EXAMPLES / name).read_text(encoding="utf-8"))
    kind = FILES[name]
    rng = random.Random(name)
    variants = list(iter_invalid_variants(content))
    sample = rng.sample(variants, min(len(variants), 40))
    invalid_settings = [settings for settings in sample if find_schema_error(kind, settings)]
    assert len(invalid_settings) > len(sample) / 4  # a weak schema would reject fewer

    for settings in invalid_settings:
        (folder / name).write_text(json.dumps(settings), encoding="utf-8")
        with pytest.raises(DechirpError):
            read_as_command(folder / name, kind)


def read_as_command(path: Path, kind: str) -> object:
    """Read a file as its command does."""
    match kind:
        case "study":
            return dc.load_study(path)
        case "tune":
            return dc.load_tune(path)
        case "radar":
            return read_settings(path, dc.Radar, readers=READERS)
    return dc.load(path)


def iter_invalid_variants(settings: Plain) -> Iterator[Plain]:
    """Yield the settings, each time with one of them changed."""
    for path in iter_setting_paths(settings):
        for change in (
            _misspell,
            _leave_out,
            _strip_unit,
            lambda _: None,
            lambda _: True,
            lambda _: [],
        ):
            variant = copy.deepcopy(settings)
            *keys, last_key = path
            parent = variant
            for key in keys:
                parent = parent[key]
            if change is _misspell and isinstance(last_key, str):
                parent[f"{last_key}x"] = parent.pop(last_key)
            elif change is _leave_out:
                del parent[last_key]
            elif change is not _misspell:
                parent[last_key] = change(parent[last_key])
            if variant != settings:
                yield variant


def _misspell(value: Plain) -> Plain:
    return value


def _leave_out(value: Plain) -> Plain:
    return value


def _strip_unit(value: Plain) -> Plain:
    """Return a quantity without its unit, or a name in upper case."""
    if not isinstance(value, str):
        return value
    number = value.partition(" ")[0]
    return parse_plain(number) if number != value else value.upper()


def iter_setting_paths(content: Plain, parent: tuple = ()) -> Iterator[tuple]:
    """Yield the path of each setting."""
    keys = content if isinstance(content, dict) else range(len(content))
    for key in keys:
        yield (*parent, key)
        if isinstance(content[key], dict | list):
            yield from iter_setting_paths(content[key], (*parent, key))
