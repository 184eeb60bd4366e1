"""The architecture as a test: a file imports only what stands before it."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import dechirp

# Names joined by | do not know each other. Above all, processing knows neither the scene nor
# the simulator: a chain that could look up the truth measures nothing.
ORDER = (
    "core",
    "theory",
    "radar",
    "processing|scene",
    "tracking|simulation",
    "evaluation",
    "config",
    "recordings",
    "results",
    "experiments",
    "report",
    "certificate",
    "studio",
    "cli",
)

POSITION = {name: place for place, names in enumerate(ORDER) for name in names.split("|")}

# Libraries for one purpose, and the folders that have it. Physics needs none of them.
ONLY_IN = {
    "pydantic": {"config"},
    "pydantic_core": {"config"},
    "ruamel": {"config"},
    "pint": {"config"},
    "zarr": {"recordings", "results"},
    "h5py": {"recordings"},
    "mcap": {"recordings"},
    "rosbags": {"recordings"},
    "matplotlib": {"report", "certificate"},
    "jinja2": {"report", "certificate"},
    "markupsafe": {"report", "certificate"},
    "stonesoup": {"tracking"},
    "cantools": {"results"},
    "can": {"results"},
    "osi3": {"results"},
    "google": {"results"},
    "duckdb": {"core", "results"},
    "optuna": {"experiments"},
    "dask": {"experiments"},
    "distributed": {"experiments"},
    "dask_jobqueue": {"experiments"},
    "loky": {"experiments"},
    "cloudpickle": {"experiments"},
    "trimesh": {"scene"},
    "typst": {"report"},
    "bokeh": {"studio"},
    "tornado": {"studio"},
    "cyclopts": {"cli"},
    "rich": {"cli"},
}

ROOT = Path(dechirp.__file__).parent
TOP = {ROOT / "__init__.py", ROOT / "__main__.py"}
FILES = sorted(set(ROOT.rglob("*.py")) - TOP)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and full name of everything that a file imports, wherever in it."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute"
            for alias in node.names:
                yield node.lineno, f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_optional":
            name = getattr(node.args[0], "value", None)  # as of import_optional("mcap.writer")
            yield from [(node.lineno, name)] if isinstance(name, str) else ()


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_file_imports_only_what_stands_before_it(path):
    here = path.relative_to(ROOT).parts[0]
    for line, name in imports(path):
        package, _, rest = name.partition(".")
        there = rest.partition(".")[0]
        if package == "dechirp" and there:
            assert there == here or POSITION[there] < POSITION[here], (
                f"line {line}: {here} imports {there}"
            )
        elif package == "dechirp":
            assert here == "cli", f"line {line}: only the edges import the whole package"
        else:
            assert here in ONLY_IN.get(package, {here}), f"line {line}: {here} imports {package}"


def runs_into(path: Path) -> set[Path]:
    """Files of the package that one imports: at once, later, or for type checkers alone."""
    names = {
        name
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ImportFrom)
        for name in (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names))
        if name.startswith("dechirp.")
    }
    files = {ROOT.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names}
    return {file for file in files if file.is_file()}


def test_no_file_imports_itself_by_way_of_others():
    left = {path: runs_into(path) for path in FILES}
    while ends := {path for path, into in left.items() if not into & left.keys()}:
        left = {path: into for path, into in left.items() if path not in ends}

    # What is left is in a circle, or leads into one.
    assert sorted(str(path.relative_to(ROOT)) for path in left) == []


def test_every_folder_has_a_place_in_the_order():
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == set(POSITION)
