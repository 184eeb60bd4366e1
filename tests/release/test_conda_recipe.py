"""Recipe of the conda package: version, requirements and facts equal those of pyproject.toml."""

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from ruamel.yaml import YAML

import dechirp
from release.pinned_requirements import BUILD_REQUIREMENTS, PROJECT, ROOT

RECIPE = YAML(typ="safe").load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))

# conda-forge splits matplotlib: its package of the same name adds Qt.
CONDA_NAMES = {"matplotlib": "matplotlib-base"}


def read_conda_requirements(part: str) -> dict[str, str]:
    """Return the version constraint of each conda package by its name."""
    lines = (str(line).partition(" ") for line in RECIPE["requirements"][part])
    python_min = RECIPE["context"]["python_min"]
    return {name: limit.replace("${{ python_min }}", python_min) for name, _, limit in lines}


def translate_requirements(lines: list[str]) -> dict[str, str]:
    """Return the version constraint of each requirement by its name on conda-forge."""
    requirements = map(Requirement, lines)
    return {CONDA_NAMES.get(line.name, line.name): str(line.specifier) for line in requirements}


def test_recipe_has_requirements_of_pyproject():
    python = SpecifierSet(PROJECT["requires-python"])
    assert read_conda_requirements("run") == {
        "python": str(python),
        **translate_requirements(PROJECT["dependencies"]),
    }
    assert read_conda_requirements("host") == {
        "python": f"{str(python).removeprefix('>=')}.*",
        "pip": "",
        **translate_requirements(BUILD_REQUIREMENTS),
    }


def test_recipe_has_version_command_and_facts_of_pyproject():
    assert RECIPE["context"]["version"] == dechirp.__version__
    (command,) = RECIPE["build"]["python"]["entry_points"]
    assert dict([command.split(" = ")]) == PROJECT["scripts"]
    about, urls = RECIPE["about"], PROJECT["urls"]
    assert about["summary"] == PROJECT["description"]
    assert about["license"] == PROJECT["license"]
    assert [about["license_file"]] == PROJECT["license-files"]
    assert about["homepage"] == urls["Homepage"]
    assert about["repository"] == urls["Source"]
    assert about["documentation"] == urls["Documentation"]
