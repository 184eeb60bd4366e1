"""There is one version, and every file that says it says the same."""

import re

import dechirp
from release.pinned import PROJECT, ROOT


def test_the_version_is_that_of_the_citation_and_the_newest_of_the_changes():
    assert PROJECT["dynamic"] == ["version"]  # pyproject.toml reads it from the package
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (\S+)$", citation, re.MULTILINE) == [dechirp.__version__]

    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## (.+)$", changes, re.MULTILINE)
    versions = [one for one in headings if one != "Unreleased"]
    newest, _, date = versions[0].partition(", ")
    assert newest == dechirp.__version__
    released = re.findall(r"^date-released: (\S+)$", citation, re.MULTILINE)
    assert date in ("unreleased", *released)
    numbers = [tuple(map(int, one.partition(", ")[0].split("."))) for one in versions]
    assert numbers == sorted(set(numbers), reverse=True)
