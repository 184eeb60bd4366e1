"""What the checks install is pinned, by hashes, and is what pyproject.toml asks for."""

import re
from itertools import product

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release.pinned import PROJECT, pins, text_of

PINNED = {"all.txt": ["all"], "ci.txt": ["dev", "docs"]}
PLACES = [
    {"python_version": ".".join(full.split(".")[:2]), "python_full_version": full, **system}
    for full, system in product(
        ("3.11.9", "3.12.8", "3.13.1"),
        (
            {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64"},
            {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "aarch64"},
            {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64"},
            {"sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64"},
        ),
    )
]


def holds(requirement: Requirement, place: dict[str, str]) -> bool:
    cpython = {"implementation_name": "cpython", "platform_python_implementation": "CPython"}
    return requirement.marker is None or requirement.marker.evaluate({**cpython, **place})


def asked_for(extras: list[str]) -> list[Requirement]:
    """What the package and some of its extras ask for, with extras that stand for others."""
    lines = list(PROJECT["dependencies"])
    left, seen = list(extras), set()
    while left:
        if (extra := left.pop()) in seen:
            continue
        seen.add(extra)
        for line in PROJECT["optional-dependencies"][extra]:
            wanted = Requirement(line)
            if wanted.name == PROJECT["name"]:
                left += wanted.extras
            else:
                lines.append(line)
    return [Requirement(line) for line in lines]


@pytest.mark.parametrize("name", PINNED)
def test_every_file_has_a_hash_and_no_line_says_where_from(name):
    lines = text_of(name).splitlines()
    of_pins = [line for line in lines if line and not line.startswith(("#", " "))]
    assert len(of_pins) == len(pins(name))
    for pin, hashes in pins(name):
        assert re.fullmatch(r"==[\w.!+]+", str(pin.specifier)), pin
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", one) for one in hashes), pin
    assert not re.search(r"://|index-url|find-links|trusted-host| @ ", text_of(name))


@pytest.mark.parametrize("name", PINNED)
@pytest.mark.parametrize("place", PLACES, ids=lambda place: "-".join(place.values()))
def test_each_dependency_has_one_pin_that_it_allows_wherever_it_is_installed(name, place):
    found: dict[str, list[str]] = {}
    for pin, _ in pins(name):
        if holds(pin, place):
            (version,) = pin.specifier
            found.setdefault(canonicalize_name(pin.name), []).append(version.version)
    assert {each: versions for each, versions in found.items() if len(versions) > 1} == {}

    for wanted in asked_for(PINNED[name]):
        if holds(wanted, place):
            (version,) = found.get(canonicalize_name(wanted.name), [None])
            assert version, f"{wanted.name} has no pin: bash .ci/lock"
            assert wanted.specifier.contains(version, prereleases=True), f"{wanted}: {version}"


def test_what_users_install_is_pinned_as_the_checks_have_it():
    of_users, of_checks = (
        {f"{pin.name}{pin.specifier}" for pin, _ in pins(name)} for name in PINNED
    )
    assert of_users <= of_checks


def test_every_dependency_has_an_oldest_version():
    extras = [name for name in PROJECT["optional-dependencies"] if name != "all"]
    unbounded = [str(one) for one in asked_for(extras) if ">=" not in str(one.specifier)]
    assert unbounded == []
