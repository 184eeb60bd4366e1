"""Completeness of the architecture page: folders and files of the package."""

import re
from pathlib import Path

from test_layers import ROOT

TOP = ROOT.parents[1]
PAGE = (TOP / "docs" / "architecture.md").read_text(encoding="utf-8")


def documented_tree() -> dict[str, list[str]]:
    """Return the files that the page lists in each folder; none for a folder in one line."""
    block = PAGE.partition("## Files")[2].split("```")[1]
    files_by_folder: dict[str, list[str]] = {}
    for line in block.splitlines()[1:]:
        names, _, _ = line.strip().partition("  ")
        if line.startswith(" "):
            files_by_folder[list(files_by_folder)[-1]] += names.split()
        else:
            files_by_folder[names] = []
    return files_by_folder


def python_folders(below: Path) -> set[str]:
    """Return the folders that contain Python files."""
    return {
        f"{path.parent.relative_to(below)}/"
        for path in below.rglob("*.py")
        if not re.search(r"_built?\b|__pycache__", str(path.relative_to(below)))
    } - {"./"}


def test_page_lists_every_package_folder_once():
    assert sorted(documented_tree()) == sorted(python_folders(ROOT))


def test_page_lists_exactly_the_existing_files():
    for folder, listed_files in documented_tree().items():
        # The page lists only the shared files of a family, not its members.
        is_family = re.search(rf"^{folder} +a family", PAGE, re.MULTILINE)
        existing_files = {path.stem for path in (ROOT / folder).glob("*.py")} - {"__init__"}

        assert len(listed_files) == len(set(listed_files)), folder
        assert set(listed_files) <= existing_files, folder
        assert not listed_files or is_family or set(listed_files) == existing_files, folder


def test_page_lists_folders_of_tests_and_tools():
    listed_folders = set(re.findall(r"`((?:tests|benchmarks|fuzz|docs|examples)[\w/]*)`", PAGE))
    existing_folders = {
        f"{top}/{folder.partition('/')[0]}"
        for top in ("tests", "benchmarks", "fuzz")
        for folder in python_folders(TOP / top)
    }

    assert existing_folders <= listed_folders
    assert [name for name in listed_folders if not (TOP / name).is_dir()] == []


def test_files_mentioned_in_text_exist():
    stems = {path.stem for path in ROOT.rglob("*.*")}
    for name in re.findall(r"`([\w/.]+\.(?:py|html|css|js|dbc|yaml))`", PAGE):
        tops = (TOP, ROOT, *(path for path in ROOT.iterdir() if path.is_dir()))
        assert any((top / name).exists() for top in tops) or name.partition(".")[0] in stems, name
