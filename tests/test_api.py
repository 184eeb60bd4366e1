"""Public interface: `tests/api.txt` and the stub files of namespaces agree with the package.

python tests/test_api.py        writes both anew
"""

import ast
import difflib
import importlib
import importlib.util
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

import dechirp
from dechirp.core.argument_types import _unpack_options
from dechirp.core.families import Family
from nightly import nightly
from test_layers import ROOT, parse_file

API_TEXT = Path(__file__).with_name("api.txt")
NAMESPACES = tuple(
    sorted(name for name in dechirp.__all__ if isinstance(getattr(dechirp, name), ModuleType))
)
ROOT_NAMES = tuple(name for name in dechirp.__all__ if name not in NAMESPACES)


@cache
def definitions(module: str) -> dict[str, ast.stmt]:
    """Return the definitions of a module by name."""
    file = importlib.import_module(module).__file__
    return {name: node for node in parse_file(Path(str(file))).body for name in defined_names(node)}


def defined_names(node: ast.stmt) -> list[str]:
    """Return the names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.AnnAssign):
        return [ast.unparse(node.target)]
    return list(map(ast.unparse, node.targets)) if isinstance(node, ast.Assign) else []


def signature(node: ast.stmt) -> str:
    """Write a definition on one line, the same under every version of Python."""
    if isinstance(node, ast.FunctionDef):
        returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        return f"{node.name}({ast.unparse(node.args)}){returns}"
    return ast.unparse(node)


def describe_name(name: str, module: str) -> Iterator[str]:
    """Yield lines about a name: its signature, and the public members that a class adds."""
    thing = getattr(importlib.import_module(module), name, importlib)
    if isinstance(thing, ModuleType):
        yield f"module {name}"
    elif not isinstance(thing, type):
        owner = module if name in definitions(module) else thing.__module__
        yield signature(definitions(owner)[name])
    else:
        bases = [base.__name__ for base in thing.__bases__ if base is not object]
        yield f"class {name}({', '.join(bases)})"
        node = definitions(thing.__module__)[thing.__name__]
        assert isinstance(node, ast.ClassDef)
        for member in node.body:
            decorators = [f"@{ast.unparse(d)} " for d in getattr(member, "decorator_list", ())]
            if any(not name.startswith("_") for name in defined_names(member)):
                yield f"    {''.join(decorators)}{signature(member)}"


def namespace_names(namespace: str) -> dict[str, str]:
    """Map the names of a namespace to the modules that define them."""
    module = importlib.import_module(f"dechirp.{namespace}")
    return {name: getattr(module, name).__module__ for name in module.__all__}


def api() -> str:
    """Describe the public interface: root names, namespaces, then their base classes."""
    root = {(getattr(dechirp, name).__module__, name) for name in ROOT_NAMES}
    grouped = {
        namespace: [(owner, name) for name, owner in sorted(namespace_names(namespace).items())]
        for namespace in NAMESPACES
    }
    listed = root | {entry for entries in grouped.values() for entry in entries}
    further = set()
    for module, name in listed:
        thing = getattr(importlib.import_module(module), name, None)
        for base in getattr(thing, "__mro__", ()):
            if base.__module__.startswith("dechirp."):
                further.add((base.__module__, base.__name__))
    lines = ["# import dechirp"]
    for module, name in sorted(root, key=lambda entry: entry[::-1]):
        lines += describe_name(name, module)
    for namespace, entries in sorted(grouped.items()):
        lines += ["", f"# dechirp.{namespace}"]
        for module, name in entries:
            lines += describe_name(name, module)
    for module in sorted({module for module, _ in further - listed}):
        lines += ["", f"# base classes in {module}"]
        for name in sorted(name for owner, name in further - listed if owner == module):
            lines += describe_name(name, module)
    return "\n".join(lines) + "\n"


def stubs() -> dict[Path, str]:
    """Write the stub files of the namespaces."""
    texts = {}
    for namespace in NAMESPACES:
        file = Path(str(importlib.import_module(f"dechirp.{namespace}").__file__))
        texts[file.with_suffix(".pyi")] = sorted(
            f"from {owner} import {name} as {name}"
            for name, owner in namespace_names(namespace).items()
        )
    return {
        path: "\n".join(["# Written by tests/test_api.py.", "", *lines, ""])
        for path, lines in texts.items()
    }


def test_public_interface_is_recorded_in_api_text():
    recorded = API_TEXT.read_text(encoding="utf-8").splitlines()
    changes = list(
        difflib.unified_diff(recorded, api().splitlines(), "api.txt", "src", lineterm="")
    )

    assert not changes, "\n".join([*changes, "if intended: python tests/test_api.py"])


def undescribed_arguments(function: object) -> list[str]:
    """Return the arguments that the section of parameters does not have."""
    section = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")[2]
    described = {
        name.strip(" *")
        for names in re.findall(r"^(\*{0,2}\w[\w, *]*)(?: :|$)", section, re.MULTILINE)
        for name in names.split(",")
    }
    return [
        name
        for name in _unpack_options(inspect.signature(function)).parameters
        if name not in described
    ]


@pytest.mark.parametrize("namespace", NAMESPACES)
def test_docstrings_of_functions_describe_each_argument(namespace):
    module = importlib.import_module(f"dechirp.{namespace}")
    functions = {name: getattr(module, name) for name in module.__all__}
    undescribed = {
        name: missing
        for name, function in functions.items()
        if inspect.isfunction(function) and (missing := undescribed_arguments(function))
    }

    assert not undescribed


def test_stub_files_agree_with_the_package():
    stub_texts = {path: path.read_text(encoding="utf-8") for path in ROOT.rglob("*.pyi")}
    del stub_texts[ROOT / "__init__.pyi"]  # from which lazy_loader takes the names

    assert stub_texts == stubs(), "run python tests/test_api.py"


def test_root_names_are_few_and_no_modules():
    assert len(dechirp.__all__) == len(set(dechirp.__all__))
    assert len(ROOT_NAMES) <= 70
    for name in ROOT_NAMES:
        assert importlib.util.find_spec(f"dechirp.{name}") is None


def test_root_names_are_members_of_no_namespace():
    members = {name for namespace in NAMESPACES for name in getattr(dechirp, namespace).__all__}
    assert not members & set(ROOT_NAMES)
    # Nor once they are loaded; `slow_time` is a function of the namespace with its name.
    assert {name for name in members if hasattr(dechirp, name)} <= set(NAMESPACES)


def test_dir_shows_root_names_and_namespaces():
    assert set(dir(dechirp)) == {*ROOT_NAMES, *NAMESPACES, "__version__"}


def test_root_stub_names_the_defining_modules():
    for node in parse_file(ROOT / "__init__.pyi").body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                owner = f"dechirp.{node.module}"
                assert getattr(dechirp, alias.name).__module__ == owner
                assert alias.asname == alias.name  # type checkers export it


@pytest.mark.parametrize("namespace", NAMESPACES)
def test_namespace_shows_and_resolves_its_names(namespace):
    module = importlib.import_module(f"dechirp.{namespace}")
    names = namespace_names(namespace)

    assert names
    assert getattr(dechirp, namespace) is module
    assert set(names) <= set(dir(module))
    for name, owner in names.items():
        assert getattr(module, name) is getattr(importlib.import_module(owner), name)


@pytest.mark.parametrize("namespace", [name for name in NAMESPACES if name != "extensions"])
def test_namespace_of_a_family_shows_every_member(namespace):
    # A namespace of functions may offer one of a family's folder, such as `write_c`.
    names = namespace_names(namespace)
    shown = [getattr(importlib.import_module(owner), name) for name, owner in names.items()]
    classes = [thing for thing in shown if isinstance(thing, type)]
    packages = {parent_package(thing) for thing in classes if issubclass(thing, Family)}
    bases = [cls for cls in Family.__subclasses__() if parent_package(cls) in packages]
    members = {
        member.__name__
        for base in bases
        for member in base.members().values()
        if parent_package(member) in packages
    }

    assert members <= set(dir(getattr(dechirp, namespace)))


def parent_package(cls: type) -> str:
    return cls.__module__.rpartition(".")[0]


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("dechirp", "No dechirp attribute Sweep"),
        ("dechirp.cfar", "module 'dechirp.cfar' has no attribute 'Sweep'"),
        ("dechirp.theory", "module 'dechirp.theory' has no attribute 'Sweep'"),
    ],
)
def test_unknown_name_is_an_attribute_error(module, message):
    with pytest.raises(AttributeError, match=message):
        getattr(importlib.import_module(module), "Sweep")  # noqa: B009


USER_SCRIPT = """
import dechirp as dc
from dechirp.cfar import CellAveraging

radar = dc.design(max_range_m=200, range_resolution_m=1, max_velocity_m_per_s=100).radar
scene = dc.Scene(targets=(dc.Target(position_m=(50, 0, 0), rcs_m2=10),))
reveal_type(dc.simulate(scene, radar, seed=1))
reveal_type(CellAveraging())
reveal_type(dc.theory.detection_probability(20.0, 1e-6))
reveal_type(dc.scores.RangeRmse())
reveal_type(dc.track_metrics.gospa)
dc.cfar.Sweep
"""


@nightly
def test_type_checker_resolves_names_of_the_package(tmp_path):
    script = tmp_path / "user.py"
    script.write_text(USER_SCRIPT, encoding="utf-8")

    process = subprocess.run(
        [sys.executable, "-m", "mypy", str(script)],
        cwd=ROOT.parents[1],
        capture_output=True,
        text=True,
        check=False,
    )

    output = "\n".join(line for line in process.stdout.splitlines() if "user.py" in line)
    revealed = re.findall(r'Revealed type is "(.*)"', output)
    assert revealed[0] == "xarray.core.dataarray.DataArray"
    assert revealed[1] == "dechirp.processing.cfar.cell_averaging.CellAveraging"
    assert revealed[2].startswith("numpy.ndarray")
    assert revealed[3].endswith(".RangeRmse")
    assert revealed[4].endswith(".Gospa]")
    assert re.findall(r"error: (.*)", output) == ['Module has no attribute "Sweep"  [attr-defined]']


if __name__ == "__main__":
    for path, text in {API_TEXT: api(), **stubs()}.items():
        path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path}\n")
