"""Pages of the API: a page for each folder that names of `dechirp.__all__` come from.

What a page is called, what it says first and which names it has is read from the package: a
folder's docstring, and where each name is loaded from. They are written to `docs/api`.
"""

import importlib
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon.docstring import GoogleDocstring

import dechirp
from dechirp.config.fields import settings
from dechirp.core.families import Family

_ORDER = (
    "radar",
    "scene",
    "echoes",
    "process",
    "tracking",
    "evaluate",
    "experiment",
    "formats",
    "live",
    "objects",
    "store",
    "exchange",
)
"""Folders in the order in which one meets them; others come after."""
_MEMBERS = """
   :members:
   :undoc-members:
   :inherited-members: Family, Exception, object"""


def by_folder() -> dict[str, list[str]]:
    """Names by the folder that they come from, `process.angle` and so on."""
    found: dict[str, list[str]] = {}
    for name in dechirp.__all__:
        module = getattr(dechirp, name).__module__
        found.setdefault(module.removeprefix("dechirp.").rpartition(".")[0], []).append(name)
    return dict(sorted(found.items(), key=lambda item: _place(item[0])))


def _place(folder: str) -> tuple[int, str]:
    top = folder.partition(".")[0]
    return (_ORDER.index(top) if top in _ORDER else len(_ORDER)), folder


def _page(folder: str, names: list[str], below: list[str]) -> str:
    title = folder.rpartition(".")[2].replace("_", " ").capitalize()
    about = importlib.import_module(f"dechirp.{folder}").__doc__ or ""
    about = about.strip().partition("\n\n")[0]
    lines = [title, "=" * len(title), "", about, ""]
    if below:
        lines += [".. toctree::", "   :maxdepth: 1", ""]
        lines += [f"   {one}" for one in below] + [""]
    lines += [".. currentmodule:: dechirp", "", ".. autosummary::", "   :nosignatures:", ""]
    lines += [f"   {name}" for name in names] + [""]
    for name in names:
        is_class = isinstance(getattr(dechirp, name), type)
        lines += [name, "-" * len(name), ""]
        lines += [f".. auto{'class' if is_class else 'function'}:: {name}"]
        lines += _members(getattr(dechirp, name)) if is_class else []
        lines += [""]
    return "\n".join(lines)


def _members(cls: type) -> list[str]:
    """Ask for the fields, and the methods that its family does not ask of every member."""
    asked = [
        name
        for base in cls.__mro__[1:]
        if issubclass(cls, Family) and issubclass(base, Family)
        for name, thing in vars(base).items()
        if callable(getattr(thing, "__func__", thing)) or name == "group"
    ]
    hidden = [f"   :exclude-members: {', '.join(sorted(set(asked)))}"] if asked else []
    return [*_MEMBERS.splitlines()[1:], *hidden]


def _write(app: Sphinx) -> None:
    """Write the pages, those alone that changed: the others are not read again."""
    if not any(one.startswith(("api", "**")) for one in app.config.include_patterns):
        return
    here = Path(app.srcdir) / "api"
    here.mkdir(exist_ok=True)
    folders = by_folder()
    tops = list(dict.fromkeys(folder.partition(".")[0] for folder in folders))
    pages = {
        folder: _page(folder, names, [one for one in folders if one.startswith(folder + ".")])
        for folder, names in folders.items()
    }
    pages["index"] = _index(folders, tops)
    for file in here.glob("*.rst"):
        if file.stem not in pages:
            file.unlink()
    for name, text in pages.items():
        file = here / f"{name}.rst"
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _index(folders: dict[str, list[str]], tops: list[str]) -> str:
    lines = ["API", "===", "", f"The {len(dechirp.__all__)} names of ``import dechirp as dc``, by"]
    lines += ["the folder that they come from. Fields carry their SI unit in the name; settings"]
    lines += ["files use the name without it. All names are in the :ref:`index <genindex>`.", ""]
    lines += [".. toctree::", "   :hidden:", "", *(f"   {top}" for top in tops), ""]
    lines += [".. list-table::", "   :widths: 25 75", ""]
    for folder, names in folders.items():
        linked = ", ".join(f":py:obj:`~dechirp.{name}`" for name in names)
        lines += [f"   * - :doc:`{folder}`", f"     - {linked}"]
    return "\n".join([*lines, ""])


def _short(
    app: Sphinx, what: str, name: str, thing: Any, _: Any, signature: str, result: str
) -> tuple[str, str] | None:
    """Leave types and defaults of a value class to its fields, which follow."""
    if what != "class" or not is_dataclass(thing):
        return None
    required = {one.field for one in settings(thing).values() if one.required}
    names = [one.name if one.name in required else f"{one.name}=..." for one in fields(thing)]
    return (f"(*, {', '.join(names)})" if names else "()"), ""


@cache
def _units(owner: type) -> dict[str, tuple[str, str | None]]:
    return {one.field: (key, one.slot.unit) for key, one in settings(owner).items()}


def _unit(app: Sphinx, what: str, name: str, thing: Any, _: Any, lines: list[str]) -> None:
    """Say the unit of a field, and what settings files call it."""
    owner, _, field = name.rpartition(".")
    owner_class = getattr(dechirp, owner.removeprefix("dechirp."), None)
    if what != "attribute" or not is_dataclass(owner_class):
        return
    key, unit = _units(owner_class).get(field, (field, None))
    if unit is not None:
        while lines and not lines[-1]:
            lines.pop()
        said = lines.pop() + " " if lines else ""
        lines += [f"{said}In {unit}; ``{key}`` in settings files.", ""]


def _alias(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.Element
) -> nodes.Element | None:
    """Lead from `dechirp.radar.radar.Radar`, as a signature has it, to `dechirp.Radar`."""
    target = node.get("reftarget", "")
    name = target.rpartition(".")[2]
    if node.get("refdomain") != "py" or name not in dechirp.__all__:
        return None
    return env.domains.python_domain.resolve_xref(
        env, node["refdoc"], app.builder, "obj", f"dechirp.{name}", node, shown
    )


def _plain_words(_: Sphinx, tree: nodes.document) -> None:
    """Take the link off a word such as `path` where a docstring has it for a type."""
    for link in list(tree.findall(pending_xref)):
        word = link["reftarget"]
        if link.hasattr("refspecific") and "." not in word and word not in dechirp.__all__:
            link.replace_self(link.children)


def _words(docstring: Any) -> list[str]:
    """Lines of an attribute's docstring: napoleon takes what stands before a colon for its type."""
    return list(type(docstring)(docstring._consume_to_end(), docstring._config).lines())


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the pages before they are read."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("builder-inited", _write)
    app.connect("autodoc-process-signature", _short)
    app.connect("autodoc-process-docstring", _unit)
    app.connect("doctree-read", _plain_words)
    app.connect("missing-reference", _alias)
    GoogleDocstring._parse_attribute_docstring = _words  # there is no setting for it
    return {"parallel_read_safe": True, "parallel_write_safe": True}
