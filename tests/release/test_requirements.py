"""Pinned requirements of CI: hashes, and agreement with pyproject.toml."""

import re
from collections.abc import Iterable
from itertools import product

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release.pinned_requirements import GROUPS, PROJECT, ROOT, read_pins, read_requirements

PINNED_GROUPS = {"all.txt": [], "ci.txt": ["dev", "docs"]}
PLATFORMS = [
    {"python_version": ".".join(full.split(".")[:2]), "python_full_version": full, **system}
    for full, system in product(
        ("3.11.9", "3.12.8", "3.13.1", "3.14.0"),
        (
            {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64"},
            {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "aarch64"},
            {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64"},
            {"sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64"},
        ),
    )
]


def is_applicable(requirement: Requirement, platform: dict[str, str]) -> bool:
    cpython = {"implementation_name": "cpython", "platform_python_implementation": "CPython"}
    return requirement.marker is None or requirement.marker.evaluate({**cpython, **platform})


def collect_requirements(groups: Iterable[str]) -> list[Requirement]:
    """Collect the requirements of the package, of its extras, and of dependency groups."""
    extras = [lines for name, lines in PROJECT["optional-dependencies"].items() if name != "all"]
    sources = [PROJECT["dependencies"], *extras, *(GROUPS[name] for name in groups)]
    return [Requirement(line) for lines in sources for line in lines]


@pytest.mark.parametrize("name", PINNED_GROUPS)
def test_every_pin_has_hashes_and_no_source_url(name):
    lines = read_requirements(name).splitlines()
    pin_lines = [line for line in lines if line and not line.startswith(("#", " "))]
    assert len(pin_lines) == len(read_pins(name))
    for pin, hashes in read_pins(name):
        assert re.fullmatch(r"==[\w.!+]+", str(pin.specifier)), pin
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", digest) for digest in hashes), pin
    assert not re.search(r"://|index-url|find-links|trusted-host| @ ", read_requirements(name))


@pytest.mark.parametrize("name", PINNED_GROUPS)
@pytest.mark.parametrize("platform", PLATFORMS, ids=lambda place: "-".join(place.values()))
def test_each_dependency_has_one_valid_pin_per_platform(name, platform):
    pinned_versions: dict[str, list[str]] = {}
    for pin, _ in read_pins(name):
        if is_applicable(pin, platform):
            (version,) = pin.specifier
            pinned_versions.setdefault(canonicalize_name(pin.name), []).append(version.version)
    assert {
        package: versions for package, versions in pinned_versions.items() if len(versions) > 1
    } == {}

    for requirement in collect_requirements(PINNED_GROUPS[name]):
        if is_applicable(requirement, platform):
            (version,) = pinned_versions.get(canonicalize_name(requirement.name), [None])
            assert version, f"{requirement.name} has no pin: bash .ci/lock"
            assert requirement.specifier.contains(version, prereleases=True), (
                f"{requirement}: {version}"
            )


def test_user_pins_are_among_ci_pins():
    user_pins, ci_pins = (
        {f"{pin.name}{pin.specifier}" for pin, _ in read_pins(name)} for name in PINNED_GROUPS
    )
    assert user_pins <= ci_pins


def test_every_dependency_has_lower_bound():
    unbounded = [
        str(requirement)
        for requirement in collect_requirements(GROUPS)
        if ">=" not in str(requirement.specifier)
    ]
    assert unbounded == []


def test_extra_all_names_all_others():
    extras = dict(PROJECT["optional-dependencies"])
    (line,) = extras.pop("all")
    assert Requirement(line).extras == extras.keys()


def test_groups_are_not_published_as_extras():
    assert GROUPS.keys() == {"dev", "docs", "fuzz", "release"}
    assert not GROUPS.keys() & PROJECT["optional-dependencies"].keys()


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_shown_commands_install_existing_groups_with_new_pip(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    groups = re.findall(r"--group (\w+)", text)
    extras = re.findall(r'install -e "\.\[(\w+)\]"', text)
    assert "dev" in groups and set(groups) <= GROUPS.keys()
    assert extras and set(extras) <= PROJECT["optional-dependencies"].keys()
    # pip 23, which comes with Python 3.11, has no --group.
    assert text.index("python -m pip install --upgrade pip\n") < text.index("--group")


def test_ci_tests_both_versions_of_bokeh():
    """Python 3.11 has the oldest version that is allowed, later ones the newest."""
    versions = {
        next(iter(pin.specifier)).version.rpartition(".")[0]
        for pin, _ in read_pins("ci.txt")
        if canonicalize_name(pin.name) == "bokeh"
        and any(is_applicable(pin, platform) for platform in PLATFORMS)
    }
    workflow = (ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8")

    assert versions == {"3.9", "3.10"}
    assert all(f'python: "{version}"' in workflow for version in ("3.11", "3.12", "3.14"))
