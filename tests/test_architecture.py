"""The page on the architecture names what there is, and nothing else."""

import re
from pathlib import Path

from test_layers import ROOT

TOP = ROOT.parents[1]
PAGE = (TOP / "docs" / "architecture.md").read_text(encoding="utf-8")


def tree() -> dict[str, list[str]]:
    """Files that the page names in each folder; none where one line tells of all."""
    block = PAGE.partition("## Files, one idea each")[2].split("```")[1]
    found: dict[str, list[str]] = {}
    for line in block.splitlines()[1:]:
        names, _, _ = line.strip().partition("  ")
        if line.startswith(" "):
            found[list(found)[-1]] += names.split()
        else:
            found[names] = []
    return found


def folders(below: Path) -> set[str]:
    """Folders with Python files in them."""
    return {
        f"{path.parent.relative_to(below)}/"
        for path in below.rglob("*.py")
        if not re.search(r"_built?\b|__pycache__", str(path.relative_to(below)))
    } - {"./"}


def test_every_folder_of_the_package_is_on_the_page_in_one_place():
    assert sorted(tree()) == sorted(folders(ROOT))


def test_every_file_that_the_page_names_exists_and_all_that_exist_are_named():
    for folder, named in tree().items():
        # A family is a file a member: those alone are named that all members use.
        is_family = re.search(rf"^{folder} +a family", PAGE, re.MULTILINE)
        there = {path.stem for path in (ROOT / folder).glob("*.py")} - {"__init__"}

        assert len(named) == len(set(named)), folder
        assert set(named) <= there, folder
        assert not named or is_family or set(named) == there, folder


def test_every_folder_beside_the_package_is_on_the_page():
    told = set(re.findall(r"`((?:tests|benchmarks|fuzz|docs|examples)[\w/]*)`", PAGE))
    there = {
        f"{top}/{folder.partition('/')[0]}"
        for top in ("tests", "benchmarks", "fuzz")
        for folder in folders(TOP / top)
    }

    assert there <= told
    assert [name for name in told if not (TOP / name).is_dir()] == []


def test_every_file_that_stands_in_the_text_exists():
    stems = {path.stem for path in ROOT.rglob("*.*")}
    for name in re.findall(r"`([\w/.]+\.(?:py|html|css|js|dbc|yaml))`", PAGE):
        tops = (TOP, ROOT, *(path for path in ROOT.iterdir() if path.is_dir()))
        assert any((top / name).exists() for top in tops) or name.partition(".")[0] in stems, name
