"""API pages: a page for each folder that defines public names, written to `docs/api`.

Public names are those of `dechirp.__all__` and of the namespaces, such as `cfar.CellAveraging`.
The title and introduction of a page come from the folder's docstring.
"""

import importlib
import inspect
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon.docstring import GoogleDocstring

import dechirp
from dechirp.config.fields import list_settings
from dechirp.core.families import Family

_ORDER = (
    "radar",
    "scene",
    "simulation",
    "recordings",
    "processing",
    "tracking",
    "evaluation",
    "experiments",
    "results",
    "theory",
)
"""Top folders in reading order; others follow."""
_MEMBERS = """
   :members:
   :undoc-members:
   :inherited-members: Family, Exception, int, object"""


def _load(name: str) -> Any:
    """Return the object of a public name such as `cfar.CellAveraging`."""
    return attrgetter(name)(dechirp)


@cache
def namespaces() -> list[str]:
    """Return the names of the modules that group public names, such as `cfar`."""
    return [name for name in dechirp.__all__ if isinstance(_load(name), ModuleType)]


@cache
def public_names() -> dict[str, str]:
    """Map each public name to the folder of its module, `processing.angle` and so on."""
    spaces = namespaces()
    members = (f"{space}.{name}" for space in spaces for name in _load(space).__all__)
    names = (*(name for name in dechirp.__all__ if name not in spaces), *members)
    folders = {name: _load(name).__module__.removeprefix("dechirp.") for name in names}
    return {name: module.rpartition(".")[0] or module for name, module in folders.items()}


@cache
def _unique_names() -> dict[str, str]:
    """Map the last part of public names to the first name, if all of them name one object."""
    names: dict[str, list[str]] = {}
    for name in public_names():
        names.setdefault(name.rpartition(".")[2], []).append(name)
    return {
        last: same[0]
        for last, same in names.items()
        if all(_load(name) is _load(same[0]) for name in same)
    }


def names_by_folder() -> dict[str, list[str]]:
    """Group the public names by folder."""
    folders: dict[str, list[str]] = {}
    for name, folder in public_names().items():
        folders.setdefault(folder, []).append(name)
    return dict(sorted(folders.items(), key=lambda item: _sort_key(item[0])))


def _sort_key(folder: str) -> tuple[int, str]:
    top = folder.partition(".")[0]
    return (_ORDER.index(top) if top in _ORDER else len(_ORDER)), folder


def _write_page(folder: str, names: list[str], subfolders: list[str]) -> str:
    title = folder.rpartition(".")[2].replace("_", " ").capitalize()
    introduction = importlib.import_module(f"dechirp.{folder}").__doc__ or ""
    introduction = introduction.strip().partition("\n\n")[0]
    lines = [title, "=" * len(title), "", introduction, ""]
    if subfolders:
        lines += [".. toctree::", "   :maxdepth: 1", ""]
        lines += [f"   {subfolder}" for subfolder in subfolders] + [""]
    lines += [".. currentmodule:: dechirp", "", ".. autosummary::", "   :nosignatures:", ""]
    lines += [f"   {name}" for name in names] + [""]
    for name in names:
        thing = _load(name)
        directive = "autofunction" if inspect.isroutine(thing) else "autoclass"
        lines += [name, "-" * len(name), "", f".. {directive}:: dechirp.{name}"]
        lines += _member_options(thing) if isinstance(thing, type) else []
        lines += [""]
    return "\n".join(lines)


def _member_options(cls: type) -> list[str]:
    """Show the fields and methods of a class, but not those that its family requires."""
    required = [
        name
        for base in cls.__mro__[1:]
        if issubclass(cls, Family) and issubclass(base, Family)
        for name, thing in vars(base).items()
        if callable(getattr(thing, "__func__", thing)) or name == "group"
    ]
    hidden = [f"   :exclude-members: {', '.join(sorted(set(required)))}"] if required else []
    return [*_MEMBERS.splitlines()[1:], *hidden]


def _write_pages(app: Sphinx) -> None:
    """Write the pages that changed, so that Sphinx does not read the others again."""
    if not any(pattern.startswith(("api", "**")) for pattern in app.config.include_patterns):
        return
    target = Path(app.srcdir) / "api"
    target.mkdir(exist_ok=True)
    folders = names_by_folder()
    tops = list(dict.fromkeys(folder.partition(".")[0] for folder in folders))
    for top in tops:
        folders.setdefault(top, [])
    pages = {
        folder: _write_page(
            folder, names, [inner for inner in folders if inner.startswith(folder + ".")]
        )
        for folder, names in folders.items()
    }
    pages["index"] = _write_index(folders, tops)
    for file in target.glob("*.rst"):
        if file.stem not in pages:
            file.unlink()
    for name, text in pages.items():
        file = target / f"{name}.rst"
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def _write_index(folders: dict[str, list[str]], tops: list[str]) -> str:
    lines = ["API", "===", "", "The names of ``import dechirp as dc`` and"]
    lines += [f"the members of its {len(namespaces())} namespaces, by the folder that"]
    lines += ["defines them. Fields carry their SI unit in the name; settings files use the name"]
    lines += ["without it. All names are in the :ref:`index <genindex>`.", ""]
    lines += [".. toctree::", "   :hidden:", "", *(f"   {top}" for top in tops), ""]
    lines += [".. list-table::", "   :widths: 25 75", ""]
    for folder, names in folders.items():
        if names:
            links = ", ".join(f":py:obj:`~dechirp.{name}`" for name in names)
            lines += [f"   * - :doc:`{folder}`", f"     - {links}"]
    return "\n".join([*lines, ""])


def _shorten_signature(
    app: Sphinx, what: str, name: str, thing: Any, _: Any, signature: str, result: str
) -> tuple[str, str] | None:
    """Omit types and defaults of a value class, whose fields follow."""
    if what != "class" or not is_dataclass(thing):
        return None
    settings = list_settings(thing).values()
    required = {setting.field for setting in settings if setting.is_required}
    names = [
        field.name if field.name in required else f"{field.name}=..." for field in fields(thing)
    ]
    return (f"(*, {', '.join(names)})" if names else "()"), ""


@cache
def _field_units(owner: type) -> dict[str, tuple[str, str | None]]:
    settings = list_settings(owner).items()
    return {setting.field: (key, setting.value_type.unit) for key, setting in settings}


def _add_unit(app: Sphinx, what: str, name: str, thing: Any, _: Any, lines: list[str]) -> None:
    """Append the unit of a field and its name in settings files."""
    owner, _, field = name.rpartition(".")
    owner = owner.removeprefix("dechirp.")
    if what != "attribute" or owner not in public_names() or not is_dataclass(_load(owner)):
        return
    key, unit = _field_units(_load(owner)).get(field, (field, None))
    if unit is not None:
        while lines and not lines[-1]:
            lines.pop()
        sentence = lines.pop() + " " if lines else ""
        lines += [f"{sentence}In {unit}; ``{key}`` in settings files.", ""]


def _resolve_public_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element
) -> nodes.Element | None:
    """Resolve `dechirp.radar.radar.Radar` and `CellAveraging` to their public names."""
    target = node.get("reftarget", "")
    name = _unique_names().get(target.rpartition(".")[2])
    if node.get("refdomain") != "py" or name is None:
        return None
    return env.domains.python_domain.resolve_xref(
        env, node["refdoc"], app.builder, "obj", f"dechirp.{name}", node, content
    )


def _unlink_plain_words(_: Sphinx, tree: nodes.document) -> None:
    """Remove the link of a word such as `path` that stands for a type in a docstring."""
    for link in list(tree.findall(pending_xref)):
        word = link["reftarget"]
        if link.hasattr("refspecific") and "." not in word and word not in _unique_names():
            link.replace_self(link.children)


def _parse_attribute(docstring: Any) -> list[str]:
    """Return the lines of an attribute's docstring; napoleon would read a type before a colon."""
    return list(type(docstring)(docstring._consume_to_end(), docstring._config).lines())


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension, which writes the pages before Sphinx reads them."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("builder-inited", _write_pages)
    app.connect("autodoc-process-signature", _shorten_signature)
    app.connect("autodoc-process-docstring", _add_unit)
    app.connect("doctree-read", _unlink_plain_words)
    app.connect("missing-reference", _resolve_public_name)
    GoogleDocstring._parse_attribute_docstring = _parse_attribute  # napoleon has no setting
    return {"parallel_read_safe": True, "parallel_write_safe": True}
