"""Every licence of what is installed with the package is known, and that of few is not plain."""

import re
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release.pinned import PROJECT, ROOT

EXTRAS = PROJECT["optional-dependencies"]
# They ask for their text to be passed on, and for nothing that code which imports them must do.
PLAIN = {
    *("0BSD", "BSD", "BSD License", "BSD-2-Clause", "BSD-3-Clause", "BSD 3-Clause"),
    *("3-Clause BSD License", "3-clause BSD", "ISC license", "ISC License", "Zlib", "CC0-1.0"),
    *("MIT", "MIT License", "MIT license", "MIT-CMU"),
    *("PSF-2.0", "PSFL", "Python Software Foundation License"),
    *("Apache-2.0", "Apache 2.0", "Apache License 2.0", "Apache Software License"),
    "LLVM-exception",
}
# By names of the packages; of the others that they come with, `docs/supply.md` has the reasons.
PAGE = (ROOT / "docs" / "supply.md").read_text(encoding="utf-8")
TOLD = {
    name: (says, extra)
    for name, says, extra in re.findall(r"^\| ([\w-]+) \| (.+?) \| `(\w+)` \|", PAGE, re.MULTILINE)
}


def installed_with(lines: Iterable[str]) -> Iterator[Distribution]:
    """All that requirements lead to on this machine, once for each set of extras."""
    left, seen = [(Requirement(line), [""]) for line in lines], set()
    while left:
        wanted, extras = left.pop()
        marker = wanted.marker
        if marker and not any(marker.evaluate({"extra": extra}) for extra in extras):
            continue
        name = canonicalize_name(wanted.name)
        if (key := (name, *sorted(wanted.extras))) in seen:
            continue
        seen.add(key)
        if name == PROJECT["name"]:
            left += [(Requirement(one), [""]) for extra in wanted.extras for one in EXTRAS[extra]]
            continue
        found = distribution(name)
        left += [(Requirement(one), ["", *wanted.extras]) for one in found.requires or []]
        yield found


def says(found: Distribution) -> str:
    """What a package says of its licence, the most exact first."""
    about = found.metadata
    named = [line for line in about.get_all("Classifier") or [] if line.startswith("License :: ")]
    of_names = [re.sub(r" \(.*\)$", "", line.rpartition(" :: ")[2]) for line in named]
    text = (about.get("License") or "").strip()
    plain = text if "\n" not in text and text != "UNKNOWN" else ""
    return about.get("License-Expression") or plain or " AND ".join(of_names) or "its text"


@cache
def licences(extra: str | None) -> dict[str, str]:
    """What each package says that comes with the package and an extra."""
    lines = PROJECT["dependencies"] if extra is None else EXTRAS[extra]
    return {canonicalize_name(one.name): says(one) for one in installed_with(lines)}


def is_plain(said: str) -> bool:
    return all(part in PLAIN for part in re.split(r" AND | OR | WITH |[()]", said) if part)


def test_what_everyone_installs_is_under_plain_licences():
    assert {name: said for name, said in licences(None).items() if not is_plain(said)} == {}
    assert len(licences(None)) > len(PROJECT["dependencies"])


@pytest.mark.parametrize("extra", EXTRAS)
def test_what_is_not_plain_stands_in_the_table_with_its_reason(extra):
    try:
        found = licences(extra)
    except PackageNotFoundError as error:
        pytest.skip(f"{error} is not installed")
    other = {name: said for name, said in found.items() if not is_plain(said)}
    assert other == {name: TOLD.get(name, [None])[0] for name in other}


def test_no_row_of_the_table_is_about_what_is_not_there():
    for name, (_, extra) in TOLD.items():
        try:
            assert name in licences(extra), (name, extra)
        except PackageNotFoundError:
            continue
