"""Index of tests: `tests/index.txt` lists the test files of every source file.

python tests/test_index.py        writes it anew
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import dechirp
from dechirp.generators.base import Generator
from dechirp.radar.devices.base import Device
from dechirp.recordings.writers.base import Writer
from dechirp.traffic.base import TrafficFormat
from dechirp.witnesses.base import Witness
from families.test_members import FAMILIES
from nightly import nightly
from test_api import NAMESPACES, ROOT_NAMES, namespace_names
from test_layers import FILES, ROOT, find_nodes, imported_files, iter_imports

TESTS = Path(__file__).parent
INDEX = TESTS / "index.txt"
SOURCES = frozenset(FILES)
INDEXED_FAMILIES = [
    *FAMILIES,
    Device,
    Generator,
    TrafficFormat,
    Writer,
]  # tests name the kinds of members
MAX_LISTED = 6  # of 40 and more for widely used files: those with the most references
HEADER = """\
# Test files of each source file: those that refer to it most often, at most six.
# "through x": no test refers to the file itself; the tests of x, which imports it, follow.
# Written by: python tests/test_index.py
"""


def module_file(module: str) -> Path | None:
    """Return the source file of a module, None for packages and other libraries."""
    path = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
    return path if path.is_file() and module.startswith("dechirp.") else None


@cache
def package_files(name: str) -> frozenset[Path]:
    """Return the files that the package of an imported name imports, such as those of lessons."""
    init = ROOT.parent.joinpath(*name.split(".")[:-1], "__init__.py")
    return imported_files(init) if init in SOURCES else frozenset()


@cache
def command_files() -> dict[str, Path]:
    """Return the file of each command by its name."""
    return {path.stem.replace("_", "-"): path for path in FILES if path.parent.name == "commands"}


def command_of_arguments(items: Sequence[ast.expr]) -> Path | None:
    """Return the file of a command that starts a list of arguments, after `dechirp` if it does."""
    words = [item.value if isinstance(item, ast.Constant) else None for item in items[:2]]
    name = words[-1] if words[:1] == ["dechirp"] else words[0] if words else None
    return command_files().get(name) if isinstance(name, str) else None


@cache
def files_by_kind() -> dict[str, list[Path]]:
    """Return the files of family members by their kinds and suffixes."""
    files: dict[str, list[Path]] = {}
    for base in INDEXED_FAMILIES:
        for kind, member in base.members().items():
            for word in (kind, *getattr(member, "suffixes", ())):
                files.setdefault(word, []).extend(filter(None, [module_file(member.__module__)]))
    return files


@cache
def witness_files() -> list[Path | None]:
    """Return the files of all witnesses: their test takes every member and names no kind."""
    return [module_file(member.__module__) for member in Witness.members().values()]


@cache
def public_owner(*names: str) -> Path | None:
    """Return the file that defines `dechirp.name` or `dechirp.namespace.name`, if it is public."""
    if len(names) > 1 and names[0] in NAMESPACES:
        return module_file(namespace_names(names[0]).get(names[1], ""))
    if names and names[0] in ROOT_NAMES:
        return module_file(getattr(dechirp, names[0]).__module__)
    return None


def attribute_names(node: ast.Attribute) -> tuple[str, ...]:
    """Return the names after `dc` in `dc.cfar.CellAveraging`, and none for other objects."""
    names: list[str] = []
    value: ast.expr = node
    while isinstance(value, ast.Attribute):
        names.insert(0, value.attr)
        value = value.value
    is_package = isinstance(value, ast.Name) and value.id in {"dc", "dechirp"}
    return tuple(names[:2]) if is_package else ()


def iter_references(test_file: Path) -> Iterator[Path]:
    """Yield the source file of every import and every public name in a test file."""
    types = (ast.ImportFrom, ast.Import, ast.Attribute, ast.Constant, ast.Call, ast.List, ast.Tuple)
    for node in find_nodes(test_file, *types):
        owners: list[Path | None] = []
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dechirp"):
            imported = [alias.name for alias in node.names]
            owners = [module_file(f"{node.module}.{name}") for name in imported]
            owners += [public_owner(*f"{node.module}.{name}".split(".")[1:]) for name in imported]
            owners += [module_file(str(node.module))] * any(owner is None for owner in owners)
        elif isinstance(node, ast.Import):
            owners = [module_file(alias.name) for alias in node.names]
        elif isinstance(node, ast.Attribute):
            names = attribute_names(node)
            owners = [public_owner(*names), public_owner(*names[:1])]
            if ast.unparse(node) == "Witness.members":
                owners += witness_files()
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = [node.value, *re.findall(r"\bkind: ([a-z0-9-]+)", node.value)]
            owners = [file for word in words for file in files_by_kind().get(word, ())]
        elif isinstance(node, ast.Call):
            owners = [command_of_arguments(node.args)]
        elif isinstance(node, ast.List | ast.Tuple):
            owners = [command_of_arguments(node.elts)]
        yield from filter(None, owners)


def list_tests_by_source() -> dict[Path, list[Path]]:
    """Return the test files that refer to each source file, most references first."""
    counts: dict[Path, Counter[Path]] = {path: Counter() for path in FILES}
    for test_file in sorted(set(TESTS.rglob("test_*.py")) - {Path(__file__)}):
        for source in iter_references(test_file):
            if source in counts:
                counts[source][test_file] += 1
    return {source: [test for test, _ in count.most_common()] for source, count in counts.items()}


def index_lines() -> list[str]:
    """Return one line for each source file: its tests, or the tested file that imports it."""
    tests = list_tests_by_source()
    importers: dict[Path, list[Path]] = {path: [] for path in FILES}
    for path in FILES:
        packages = {file for _, name in iter_imports(path) for file in package_files(name)}
        for imported in (imported_files(path) | packages) & SOURCES:
            importers[imported].append(path)
    lines = []
    for source in FILES:
        if source.name == "__init__.py":
            continue
        tested = nearest_tested_file(source, importers, tests)
        through = "" if tested == source else f"through {tested.relative_to(ROOT)}: "
        listed = " ".join(str(test.relative_to(TESTS)) for test in tests[tested][:MAX_LISTED])
        lines.append(f"{source.relative_to(ROOT)}: {through}{listed or 'NO TEST'}")
    return lines


def nearest_tested_file(
    source: Path, importers: dict[Path, list[Path]], tests: dict[Path, list[Path]]
) -> Path:
    """Return the file itself if it has tests, or else the nearest file that imports it and has."""
    level, seen = [source], {source}
    while level:
        for path in level:
            if tests[path]:
                return path
        level = [up for path in level for up in importers[path] if up not in seen]
        seen.update(level)
    return source


@nightly
def test_index_lists_tests_of_every_source_file():
    lines = index_lines()
    assert INDEX.read_text(encoding="utf-8") == HEADER + "\n".join(lines) + "\n", (
        "run python tests/test_index.py"
    )
    assert [line for line in lines if "NO TEST" in line] == []


def test_every_test_file_has_its_own_name():
    # Files of one name in two folders are one module to pytest.
    names = Counter(file.name for file in TESTS.rglob("test_*.py"))
    assert [name for name, n in names.items() if n > 1] == []


if __name__ == "__main__":
    INDEX.write_text(HEADER + "\n".join(index_lines()) + "\n", encoding="utf-8")
    print(INDEX)
