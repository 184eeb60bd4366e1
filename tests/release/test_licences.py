"""Licences of installed packages: permissive, or documented in docs/supply.md."""

import re
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release.pinned_requirements import GROUPS, PROJECT, ROOT

EXTRAS = {**PROJECT["optional-dependencies"], **GROUPS}
"""Requirements by the name of their extra or dependency group."""
# These licences require their text in copies, and nothing of code that imports the package.
PERMISSIVE = {
    *("0BSD", "BSD", "BSD License", "BSD-2-Clause", "BSD-3-Clause", "BSD 3-Clause"),
    *("3-Clause BSD License", "3-clause BSD", "ISC license", "ISC License", "Zlib", "CC0-1.0"),
    *("MIT", "MIT License", "MIT license", "MIT-0", "MIT-CMU"),
    *("PSF-2.0", "PSFL", "Python Software Foundation License"),
    *("Apache-2.0", "Apache 2.0", "Apache License 2.0", "Apache Software License"),
    "LLVM-exception",
}
# Licence and extra or group by package name; `docs/supply.md` gives the reasons.
PAGE = (ROOT / "docs" / "supply.md").read_text(encoding="utf-8")
DOCUMENTED_LICENCES = {
    name: (licence, extra)
    for name, licence, extra in re.findall(
        r"^\| ([\w-]+) \| (.+?) \| `(\w+)` \|", PAGE, re.MULTILINE
    )
}


def iter_required_packages(lines: Iterable[str]) -> Iterator[Distribution]:
    """Iterate over all installed dependencies of requirements, once per set of extras."""
    pending, visited = [(Requirement(line), [""]) for line in lines], set()
    while pending:
        requirement, extras = pending.pop()
        marker = requirement.marker
        if marker and not any(marker.evaluate({"extra": extra}) for extra in extras):
            continue
        name = canonicalize_name(requirement.name)
        if (key := (name, *sorted(requirement.extras))) in visited:
            continue
        visited.add(key)
        if name == PROJECT["name"]:
            pending += [
                (Requirement(dependency), [""])
                for extra in requirement.extras
                for dependency in EXTRAS[extra]
            ]
            continue
        package = distribution(name)
        pending += [
            (Requirement(dependency), ["", *requirement.extras])
            for dependency in package.requires or []
        ]
        yield package


def read_licence(package: Distribution) -> str:
    """Read the licence from metadata: expression, text, or classifiers, in this order."""
    metadata = package.metadata
    classifiers = [
        line for line in metadata.get_all("Classifier") or [] if line.startswith("License :: ")
    ]
    classifier_names = [re.sub(r" \(.*\)$", "", line.rpartition(" :: ")[2]) for line in classifiers]
    text = (metadata.get("License") or "").strip()
    single_line = text if "\n" not in text and text != "UNKNOWN" else ""
    return (
        metadata.get("License-Expression")
        or single_line
        or " AND ".join(classifier_names)
        or "its text"
    )


@cache
def collect_licences(extra: str | None) -> dict[str, str]:
    """Collect the licences of all packages that an extra or group installs, by package name."""
    lines = PROJECT["dependencies"] if extra is None else EXTRAS[extra]
    return {
        canonicalize_name(package.name): read_licence(package)
        for package in iter_required_packages(lines)
    }


def is_permissive(licence: str) -> bool:
    return all(part in PERMISSIVE for part in re.split(r" AND | OR | WITH |[()]", licence) if part)


def test_core_dependencies_have_permissive_licences():
    assert {
        name: licence
        for name, licence in collect_licences(None).items()
        if not is_permissive(licence)
    } == {}
    assert len(collect_licences(None)) > len(PROJECT["dependencies"])


@pytest.mark.parametrize("extra", EXTRAS)
def test_non_permissive_licences_are_documented(extra):
    try:
        licences_by_name = collect_licences(extra)
    except PackageNotFoundError as error:
        pytest.skip(f"{error}: install {extra}")
    restrictive = {
        name: licence for name, licence in licences_by_name.items() if not is_permissive(licence)
    }
    assert restrictive == {name: DOCUMENTED_LICENCES.get(name, [None])[0] for name in restrictive}


def test_documented_licences_belong_to_dependencies():
    for name, (_, extra) in DOCUMENTED_LICENCES.items():
        try:
            assert name in collect_licences(extra), (name, extra)
        except PackageNotFoundError:
            continue
