"""Public addresses of the repository and the guide; absolute links in the README."""

import re

import pytest
from markdown_it import MarkdownIt

from release.pinned_requirements import PROJECT, ROOT

REPOSITORY = PROJECT["urls"]["Source"]
GUIDE = PROJECT["urls"]["Documentation"]
BRANCH_FILES = (
    f"{REPOSITORY}/blob/main/",
    f"{REPOSITORY}/tree/main/",
    REPOSITORY.replace("https://github.com/", "https://raw.githubusercontent.com/") + "/main/",
)
NAMING_FILES = ["README.md", "CITATION.cff", "pyproject.toml", "CONTRIBUTING.md"]
NAMING_FILES += [
    str(path.relative_to(ROOT)) for path in sorted((ROOT / ".github").rglob("*")) if path.is_file()
]


def readme_links() -> list[str]:
    """Return the targets of all links and pictures of the README."""
    tokens = MarkdownIt().enable("table").parse((ROOT / "README.md").read_text(encoding="utf-8"))
    return [
        str(child.attrs.get("href") or child.attrs["src"])
        for token in tokens
        for child in token.children or ()
        if child.type in ("link_open", "image")
    ]


def find_source(link: str) -> tuple[str, str]:
    """Return path and anchor of the file that an address of this project shows."""
    address, _, anchor = link.partition("#")
    for prefix in BRANCH_FILES:
        if address.startswith(prefix):
            return address.removeprefix(prefix), anchor
    page = address.removeprefix(f"{GUIDE}/en/latest/")
    assert page != address, f"{link}: neither of the repository nor of the guide"
    return "docs/" + re.sub(r"\.html$", ".md", page), anchor


def test_every_link_of_readme_is_absolute_and_leads_to_file():
    links = readme_links()
    assert len(links) > 30
    for link in links:
        path, anchor = find_source(link)
        assert (ROOT / path).exists(), link
        if anchor:
            text = (ROOT / path).read_text(encoding="utf-8")
            headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
            anchors = {re.sub(r"[^\w-]+", "-", heading.lower()) for heading in headings}
            assert anchor in anchors, link


@pytest.mark.parametrize("name", NAMING_FILES)
def test_files_name_no_other_address_of_project(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    for address in re.findall(r"https?://[^\s\"')>]*dechirp[^\s\"')>]*", text):
        assert address.startswith((REPOSITORY, GUIDE, BRANCH_FILES[-1])), address


def test_citation_states_repository_and_guide():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'repository-code: "{REPOSITORY}"' in citation
    assert f'url: "{GUIDE}"' in citation
