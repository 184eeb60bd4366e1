"""Layers of the package: a file imports only lower layers, and imports have no cycle."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import dechirp

# Folders joined by | do not import each other. In particular, processing imports neither the scene
# nor the simulator: a chain with access to the truth would measure nothing.
ORDER = (
    "core",
    "theory",
    "radar",
    "processing|scene",
    "tracking|simulation",
    "evaluation",
    "config",
    "recordings|traffic",
    "results",
    "generators",
    "experiments",
    "report",
    "certificate|witnesses",
    "studio",
    "cli",
)

POSITION = {name: place for place, names in enumerate(ORDER) for name in names.split("|")}

# Libraries of one purpose, and the folders that may import them. Physics needs none of them.
ONLY_IN = {
    "pydantic": {"config"},
    "pydantic_core": {"config"},
    "ruamel": {"config"},
    "pint": {"config"},
    "zarr": {"recordings", "results"},
    "h5py": {"recordings"},
    "mcap": {"core", "recordings"},
    "rosbags": {"recordings"},
    "soundfile": {"recordings"},
    "sigmf": {"recordings"},
    "jsonschema": {"recordings"},
    "lz4": {"core", "recordings"},
    "zstandard": {"core", "recordings"},
    "matplotlib": {"report", "certificate"},
    "jinja2": {"report", "certificate", "generators"},
    "markupsafe": {"report", "certificate"},
    "stonesoup": {"tracking"},
    "cantools": {"results"},
    "can": {"results"},
    "osi3": {"results", "traffic"},
    "google": {"results", "traffic"},
    "duckdb": {"core", "results"},
    "optuna": {"experiments"},
    "dask": {"experiments"},
    "distributed": {"experiments"},
    "dask_jobqueue": {"experiments"},
    "loky": {"experiments"},
    "cloudpickle": {"experiments"},
    "trimesh": {"scene"},
    "weasyprint": {"report"},
    "bokeh": {"studio"},
    "tornado": {"studio"},
    "cyclopts": {"cli"},
    "pythonfmu": {"cli"},
    "rich": {"cli"},
}

ROOT = Path(dechirp.__file__).parent
# `__main__`, and the public names, which no layer imports.
ROOT_FILES = set(ROOT.glob("*.py"))
FILES = sorted(set(ROOT.rglob("*.py")) - ROOT_FILES)


@cache
def parse_file(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def walk_file(path: Path) -> tuple[ast.AST, ...]:
    """Return all nodes of a file but for contexts of names; `ast.walk` takes twice as long."""
    nodes: list[ast.AST] = [parse_file(path)]
    for node in nodes:  # grows
        for name in node._fields:
            value = getattr(node, name, None)
            for child in value if isinstance(value, list) else (value,):
                if isinstance(child, ast.AST) and not isinstance(child, ast.expr_context):
                    nodes.append(child)
    return tuple(nodes)


@cache
def nodes_by_type(path: Path) -> dict[type[ast.AST], list[ast.AST]]:
    nodes: dict[type[ast.AST], list[ast.AST]] = {}
    for node in walk_file(path):
        nodes.setdefault(type(node), []).append(node)
    return nodes


def find_nodes(path: Path, *types: type[ast.AST]) -> Iterator[ast.AST]:
    """Yield the nodes of a file that have one of the types."""
    for node_type in types:
        yield from nodes_by_type(path).get(node_type, ())


def iter_imports(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and full name of every import of a file, at any level."""
    for node in find_nodes(path, ast.ImportFrom, ast.Import, ast.Call):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute"
            for alias in node.names:
                yield node.lineno, f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_from_extra":
            name = getattr(node.args[1], "value", None)  # as of ("io", "mcap.writer")
            yield from [(node.lineno, name)] if isinstance(name, str) else ()


def find_layer_violations(path: Path) -> Iterator[str]:
    layer = path.relative_to(ROOT).parts[0]
    for line, name in iter_imports(path):
        package, _, rest = name.partition(".")
        imported_layer = rest.partition(".")[0]
        place = f"{path.relative_to(ROOT)}:{line}"
        if package == "dechirp" and imported_layer:
            if imported_layer not in POSITION:
                yield f"{place}: {name} is for users"
            elif imported_layer != layer and POSITION[imported_layer] >= POSITION[layer]:
                yield f"{place}: {layer} imports {imported_layer}"
        elif package == "dechirp":
            if layer not in {"cli", "generators"}:  # both write the version
                yield f"{place}: only the edges import the whole package"
        elif layer not in ONLY_IN.get(package, {layer}):
            yield f"{place}: {layer} imports {package}"


def test_files_import_only_lower_layers():
    assert [text for path in FILES for text in find_layer_violations(path)] == []


@cache
def imported_files(path: Path) -> frozenset[Path]:
    """Return the package files that a file imports, lazily and for type checkers included."""
    names = {
        name
        for node in find_nodes(path, ast.ImportFrom)
        for name in (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names))
        if name.startswith("dechirp.")
    }
    files = {ROOT.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names}
    return frozenset(file for file in files if file.is_file())


def test_imports_have_no_cycle():
    remaining = {path: imported_files(path) for path in FILES}
    while ends := {path for path, into in remaining.items() if not into & remaining.keys()}:
        remaining = {path: into for path, into in remaining.items() if path not in ends}

    # The remaining files are part of a cycle or import one.
    assert sorted(str(path.relative_to(ROOT)) for path in remaining) == []


def test_every_folder_has_a_layer():
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == set(POSITION)
