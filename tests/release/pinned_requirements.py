"""Readers of the pinned requirements and of pyproject.toml."""

import re
import tomllib
from functools import cache
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
_PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = _PYPROJECT["project"]
BUILD_REQUIREMENTS: list[str] = _PYPROJECT["build-system"]["requires"]
GROUPS: dict[str, list[str]] = _PYPROJECT["dependency-groups"]


def read_requirements(name: str) -> str:
    return (ROOT / "requirements" / name).read_text(encoding="utf-8")


@cache
def read_pins(name: str) -> list[tuple[Requirement, list[str]]]:
    """Read each pin with its hashes."""
    entry = r"^([A-Za-z0-9][^\\\n]*?) \\\n((?: +--hash=\S+(?: \\)?\n)+)"
    return [
        (Requirement(pin), re.findall(r"--hash=(\S+)", hashes))
        for pin, hashes in re.findall(entry, read_requirements(name), re.MULTILINE)
    ]
