"""Directive `command` of the guide: order of blocks, shown lines and exit status."""

import subprocess
import sys
from pathlib import Path

import pytest

from nightly import nightly

pytest.importorskip("sphinxcontrib.programoutput")
pytest.importorskip("myst_nb")
EXTENSIONS = Path(__file__).parents[2] / "docs" / "_ext"
HEADER = "---\nfile_format: mystnb\nkernelspec: {name: python3}\n---\n# Page\n\n"


@pytest.fixture
def build(tmp_path):
    """Return a function that builds a page and returns its text and the warnings."""

    def build_page(content: str) -> tuple[str, str]:
        conf = [
            f"import sys; sys.path.insert(0, {str(EXTENSIONS)!r})",
            "extensions = ['myst_nb', 'command']",
            "nb_execution_mode = 'inline'",
            "nb_execution_in_temp = True",
        ]
        (tmp_path / "conf.py").write_text("\n".join(conf), encoding="utf-8")
        (tmp_path / "index.md").write_text(HEADER + content, encoding="utf-8")
        command = [sys.executable, "-m", "sphinx", "-q", "-b", "text", ".", "out"]
        process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return (tmp_path / "out" / "index.txt").read_text(encoding="utf-8"), process.stderr

    return build_page


@nightly
def test_commands_and_cells_run_in_order_in_one_folder(build):
    text, warnings = build(
        "```{command}\necho one > lines.txt\n```\n\n"
        "```{code-cell} python\n"
        "with open('lines.txt', 'a') as file:\n    file.write('two\\n')\n```\n\n"
        "```{command}\n:ran: echo three >> lines.txt; cat lines.txt\nexample\n```\n\n"
        "```{command}\n:ellipsis: 0, -1\ncat lines.txt\n```\n"
    )

    assert not warnings
    blocks = [block.split() for block in text.split("\n\n")]
    assert blocks[-4:] == [
        ["example"],
        ["one", "two", "three"],
        ["cat", "lines.txt"],
        ["...", "three"],
    ]


@nightly
def test_unexpected_exit_status_is_reported_with_command_and_page(build):
    _, warnings = build(
        "```{command}\n:returncode: 2\nexit 2\n```\n\n```{command}\necho lost\nfalse | true\n```\n"
    )

    (warning,) = warnings.strip().splitlines()
    for part in ("Unexpected return code 1", "echo lost", "/index"):
        assert part in warning
