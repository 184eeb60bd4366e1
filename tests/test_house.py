"""What the house keeps: a cheap start, one line for every file, no library without a use."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path

import dechirp
from test_layers import FILES, ROOT, TOP, imports, parsed

PYPROJECT = ROOT.parents[1] / "pyproject.toml"

# Used by way of another: of optuna, which weighs settings by a forest; of trimesh, whose rays
# it traces.
BY_ANOTHER = {"scikit-learn": "optuna", "embreex": "trimesh"}

# Names of the libraries themselves, where they differ from what pip calls them.
TO_IMPORT = {"ruamel-yaml": "ruamel", "python-can": "can", "osi-python": "osi3"}


def test_every_file_says_in_one_line_what_it_is_for():
    told = {path: ast.get_docstring(parsed(path)) for path in [*FILES, *TOP]}

    # One sentence in a line of its own, and then what else there is to say.
    unclear = [
        path for path, text in told.items() if not re.match(r"\S.{0,98}\.(\n\n|$)", text or "")
    ]
    assert [str(path.relative_to(ROOT)) for path in unclear] == []


def test_settings_in_messages_belong_to_existing_classes():
    classes = {
        node.name
        for path in FILES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ClassDef)
    }
    owners = {
        (str(path.relative_to(ROOT)), owner)
        for path in FILES
        for owner in re.findall(r'"([A-Z][a-z]\w+)\.[a-z_{]', path.read_text(encoding="utf-8"))
    }

    # Thumbs.db is a file of a file manager.
    assert {owner for _, owner in owners if owner not in classes} <= {"Thumbs"}, owners


def declared() -> dict[str, list[str]]:
    """Libraries that a user may install with the package, by extra; `core` are all others'."""
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    ours = {name for name in extras if name not in {"all", "dev", "docs", "fuzz", "release"}}
    asked = {"core": project["dependencies"], **{name: extras[name] for name in ours}}
    return {name: [canonical(one) for one in of] for name, of in asked.items()}


def canonical(requirement: str) -> str:
    """What is required, without extra, version and marker."""
    return re.split(r"[\s\[<>=!~;]", requirement)[0].lower().replace(".", "-").replace("_", "-")


def to_import(library: str) -> str:
    return TO_IMPORT.get(library, library.replace("-", "_"))


@cache
def used() -> dict[str, set[Path]]:
    """Files by the library that they import, wherever in them."""
    found: dict[str, set[Path]] = {}
    for path in FILES:
        for _, name in imports(path):
            found.setdefault(name.partition(".")[0], set()).add(path)
    return {
        name: paths
        for name, paths in found.items()
        if name != "dechirp" and name not in sys.stdlib_module_names
    }


def test_every_library_that_is_asked_for_is_used():
    asked = {library for libraries in declared().values() for library in libraries}
    idle = {library for library in asked if to_import(library) not in used()}

    assert idle == set(BY_ANOTHER)
    assert set(BY_ANOTHER.values()) <= asked


def test_every_library_that_is_used_is_asked_for():
    asked = {to_import(library) for libraries in declared().values() for library in libraries}
    # Those that come with one that is asked for, and that its users meet.
    brought = {
        "pydantic_core": "pydantic",
        "llvmlite": "numba",
        "markupsafe": "jinja2",
        "pandas": "xarray",
        "numcodecs": "zarr",
        "distributed": "dask",
        "google": "osi-python",
        "zstandard": "mcap",
        "lz4": "mcap",
    }

    assert set(used()) - asked == set(brought)
    for name, by in brought.items():
        needs = {canonical(one) for one in metadata.requires(by) or ()}
        assert {"google": "protobuf"}.get(name, name).replace("_", "-") in needs, f"{by}: {name}"


COLD = """
import sys

optional, other = (set(names.split()) for names in sys.argv[1:])


def loaded():
    return {name.partition(".")[0] for name in sys.modules}


import dechirp

assert not loaded() & (optional | other), loaded() & (optional | other)

from dechirp.cli.main import main


def status(*words):
    try:
        main(words)
    except SystemExit as end:
        return end.code


assert status("--help") == 0
assert loaded() & (optional | other) == {"cyclopts", "rich"}, loaded() & (optional | other)

# None in place of a library: it is not installed.
sys.modules.update(dict.fromkeys(optional))
assert status("run", "--quiet", "--set", "radar.frame.n_chirps=32") == 0
"""


def test_a_start_loads_little_and_a_run_needs_no_extra(tmp_path):
    asked = declared()
    other = {to_import(library) for library in asked.pop("core")}
    optional = {to_import(library) for libraries in asked.values() for library in libraries}
    optional |= {"sklearn", "distributed", "sphinx", "pytest"} - {"scikit_learn"}

    done = subprocess.run(
        [sys.executable, "-c", COLD, " ".join(optional), " ".join(other)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )

    assert done.returncode == 0, done.stderr
    assert (tmp_path / "dechirp-run" / "report.html").is_file()
    assert dechirp.__version__ in metadata.version("dechirp")
