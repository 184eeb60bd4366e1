"""Version number in the package, CITATION.cff and CHANGELOG.md."""

import re

import dechirp
from release.pinned_requirements import PROJECT, ROOT


def test_version_matches_citation_and_newest_change():
    assert PROJECT["dynamic"] == ["version"]  # pyproject.toml reads it from the package
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (\S+)$", citation, re.MULTILINE) == [dechirp.__version__]

    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", changes, re.MULTILINE)
    versions = [heading for heading in headings if heading != "Unreleased"]
    newest, _, date = versions[0].partition(", ")
    assert newest == dechirp.__version__
    released = re.findall(r"^date-released: (\S+)$", citation, re.MULTILINE)
    assert date in ("unreleased", *released)
    numbers = [tuple(map(int, heading.partition(", ")[0].split("."))) for heading in versions]
    assert numbers == sorted(set(numbers), reverse=True)
