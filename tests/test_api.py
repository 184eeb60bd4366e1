"""What users call and set, kept as a text: who changes it changes `tests/api.txt`, too.

python tests/test_api.py        writes the text anew
"""

import ast
import difflib
import importlib
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import dechirp
from test_layers import ROOT, parsed

KEPT = Path(__file__).with_name("api.txt")
DOCS = ROOT.parents[1] / "docs"
EXAMPLES = ROOT.parents[1] / "examples"


@cache
def tree(module: str) -> dict[str, ast.stmt]:
    """Definitions of a module by name."""
    file = importlib.import_module(module).__file__
    return {name: node for node in parsed(Path(str(file))).body for name in names(node)}


def names(node: ast.stmt) -> list[str]:
    """Names that a statement gives a meaning to."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.AnnAssign):
        return [ast.unparse(node.target)]
    return list(map(ast.unparse, node.targets)) if isinstance(node, ast.Assign) else []


def signature(node: ast.stmt) -> str:
    """A definition in one line, as it is written: the same under every Python."""
    if isinstance(node, ast.FunctionDef):
        returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        return f"{node.name}({ast.unparse(node.args)}){returns}"
    return ast.unparse(node)


def told(name: str, module: str) -> Iterator[str]:
    """Lines on a name: how it is called, or what a class has beside what its bases give it."""
    thing = getattr(importlib.import_module(module), name, importlib)
    if isinstance(thing, ModuleType):
        yield f"module {name}"
    elif not isinstance(thing, type):
        yield signature(tree(module if name in tree(module) else thing.__module__)[name])
    else:
        bases = [base.__name__ for base in thing.__bases__ if base is not object]
        yield f"class {name}({', '.join(bases)})"
        node = tree(thing.__module__)[thing.__name__]
        assert isinstance(node, ast.ClassDef)
        for one in node.body:
            kinds = [f"@{ast.unparse(kind)} " for kind in getattr(one, "decorator_list", ())]
            if any(not known.startswith("_") for known in names(one)):
                yield f"    {''.join(kinds)}{signature(one)}"


def shown() -> set[tuple[str, str]]:
    """Modules and names that pages of the guide and examples import."""
    pages = [*DOCS.glob("*.md"), *DOCS.glob("guide/*.md"), *DOCS.glob("gallery/*/*.py")]
    imported = re.compile(r"^from (dechirp\.\S+) import (\([^)]*\)|[^(\n]*)$", re.MULTILINE)
    return {
        (module, name)
        for page in [*pages, *EXAMPLES.rglob("*.py")]
        for module, listed in imported.findall(page.read_text(encoding="utf-8"))
        for name in re.findall(r"\w+", re.sub(r"#.*| as \w+", "", listed))
    }


def api() -> str:
    """The whole text: names of the package, then those of its modules that users meet."""
    own = {(f"dechirp.{dechirp._MODULE[name]}", name) for name in dechirp.__all__}
    beyond = shown() - own
    for module, name in own | beyond:
        thing = getattr(importlib.import_module(module), name, None)
        for base in getattr(thing, "__mro__", ()):
            if base.__module__.startswith("dechirp."):
                beyond.add((base.__module__, base.__name__))
    lines = ["# import dechirp"]
    for module, name in sorted(own, key=lambda one: one[::-1]):
        lines += told(name, module)
    for module in sorted({module for module, _ in beyond - own}):
        lines += ["", f"# from {module} import"]
        for name in sorted(name for of, name in beyond - own if of == module):
            lines += told(name, module)
    return "\n".join(lines) + "\n"


def test_what_users_call_is_what_was_promised():
    kept = KEPT.read_text(encoding="utf-8").splitlines()
    changed = list(difflib.unified_diff(kept, api().splitlines(), "promised", "made", lineterm=""))

    assert not changed, "\n".join([*changed, "if meant: python tests/test_api.py"])


if __name__ == "__main__":
    sys.stdout.write(f"{KEPT}: {KEPT.write_text(api(), encoding='utf-8')} characters\n")
