"""Package hygiene: fast start, module docstrings, and declared libraries."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path

import dechirp
from dechirp.results.results import FILES as RESULT_FILES
from test_layers import FILES, ONLY_IN, ROOT, ROOT_FILES, iter_imports, parse_file

PYPROJECT = ROOT.parents[1] / "pyproject.toml"

# Libraries that another one imports: optuna ranks settings by a random forest, trimesh traces rays.
INDIRECT_LIBRARIES = {"scikit-learn": "optuna", "embreex": "trimesh"}

# Import names that differ from the names of the distributions.
IMPORT_NAMES = {
    "ruamel-yaml": "ruamel",
    "python-can": "can",
    "osi-python": "osi3",
    "protobuf": "google",
    "lazy-loader": "lazy_loader",
}

# Libraries that a declared one determines: pydantic pins its core to one version, and the extra
# distributed of dask is declared.
DETERMINED_LIBRARIES = {"pydantic_core": "pydantic", "distributed": "dask"}


def test_module_docstring_starts_with_one_sentence():
    docstrings = {path: ast.get_docstring(parse_file(path)) for path in [*FILES, *ROOT_FILES]}

    # The first line is one sentence; details follow after an empty line.
    unclear = [
        path
        for path, text in docstrings.items()
        if not re.match(r"\S.{0,98}\.(\n\n|$)", text or "")
    ]
    assert [str(path.relative_to(ROOT)) for path in unclear] == []


def test_settings_in_messages_belong_to_existing_classes():
    classes = {
        node.name
        for path in FILES
        for node in ast.walk(parse_file(path))
        if isinstance(node, ast.ClassDef)
    }
    owners = {
        (str(path.relative_to(ROOT)), owner)
        for path in FILES
        for owner in re.findall(r'"([A-Z][a-z]\w+)\.[a-z_{]', path.read_text(encoding="utf-8"))
    }

    # Thumbs.db is a file of a file manager, Data4Demo.mat that of a witness.
    files = {"Thumbs", "Data4Demo"}
    assert {owner for _, owner in owners if owner not in classes} <= files, owners


def declared_libraries() -> dict[str, list[str]]:
    """Return the libraries that users can install, by extra; `core` for those without extra."""
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    requirements = {"core": project["dependencies"], **extras}
    del requirements["all"]
    return {
        name: [library_name(requirement) for requirement in entries]
        for name, entries in requirements.items()
    }


def library_name(requirement: str) -> str:
    """Return the name in a requirement, without extra, version and marker."""
    return re.split(r"[\s\[<>=!~;]", requirement)[0].lower().replace(".", "-").replace("_", "-")


def import_name(library: str) -> str:
    return IMPORT_NAMES.get(library, library.replace("-", "_"))


@cache
def imported_libraries() -> dict[str, set[Path]]:
    """Return the files that import each library, at any level."""
    files_by_library: dict[str, set[Path]] = {}
    for path in [*FILES, *ROOT_FILES]:
        for _, name in iter_imports(path):
            files_by_library.setdefault(name.partition(".")[0], set()).add(path)
    return {
        name: paths
        for name, paths in files_by_library.items()
        if name != "dechirp" and name not in sys.stdlib_module_names
    }


def test_every_declared_library_is_imported():
    declared = {library for libraries in declared_libraries().values() for library in libraries}
    unused = {library for library in declared if import_name(library) not in imported_libraries()}

    assert unused == set(INDIRECT_LIBRARIES)
    assert set(INDIRECT_LIBRARIES.values()) <= declared


def test_every_imported_library_is_declared():
    declared = {
        import_name(library) for libraries in declared_libraries().values() for library in libraries
    }

    assert set(imported_libraries()) - declared == set(DETERMINED_LIBRARIES)
    assert set(DETERMINED_LIBRARIES.values()) <= declared


def test_library_of_extra_is_imported_only_in_its_folders():
    declared = declared_libraries()
    core = {import_name(library) for library in declared.pop("core")}
    optional = {import_name(library) for libraries in declared.values() for library in libraries}

    # test_layers checks the folders of ONLY_IN.
    assert (optional - core) & set(imported_libraries()) <= set(ONLY_IN)


COLD_START_SCRIPT = """
import sys

optional, other = (set(names.split()) for names in sys.argv[1:])


def loaded():
    return {name.partition(".")[0] for name in sys.modules}


import dechirp

assert loaded() & (optional | other) == {"lazy_loader"}, loaded() & (optional | other)

from dechirp.cli.main import main


def status(*words):
    try:
        main(words)
    except SystemExit as end:
        return end.code


assert status("--help") == 0
first = {"cyclopts", "lazy_loader", "rich"}
assert loaded() & (optional | other) == first, loaded() & (optional | other)

# None in place of a library: it is not installed.
sys.modules.update(dict.fromkeys(optional))
assert status("run") == 0
# Together 0.25 s of CPU time, which no step of this run needs, and 30 s to compile. The oldest
# xarray imports pint where it is installed.
from importlib.metadata import version

unused = {"scipy.optimize", "numba"} | (set() if version("xarray") < "2026" else {"pint"})
assert not unused & sys.modules.keys(), unused & sys.modules.keys()
"""


def test_start_loads_few_libraries_and_first_run_finds_car_without_extras(tmp_path):
    declared = declared_libraries()
    core_libraries = {import_name(library) for library in declared.pop("core")}
    optional = {import_name(library) for libraries in declared.values() for library in libraries}
    optional |= {"sklearn", "distributed", "sphinx", "pytest"} - {"scikit_learn"}

    process = subprocess.run(
        [sys.executable, "-c", COLD_START_SCRIPT, " ".join(optional), " ".join(core_libraries)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )

    assert (process.returncode, process.stderr) == (0, "")
    output = process.stdout
    assert "50.0" in output and "10.0" in output and "dechirp-run/report.html" in output
    assert {file.name for file in (tmp_path / "dechirp-run").iterdir()} == set(RESULT_FILES)
    assert dechirp.__version__ in metadata.version("dechirp")
