"""Sources of the guide: one list, of which pages cite by key.

    {cite}`rohling` leads to Rohling 1983 in the list that the directive `sources` prints.

The list is `certificate/paper.py`, what the reference report cites, and `docs/sources.txt`: one
line for each source, where sphinxcontrib-bibtex needs six to ten, and the report a second list.
"""

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective, SphinxRole

from dechirp.certificate.paper import REFERENCES

_PAGE = "guide/bibliography"
_AUTHOR = re.compile(r"\b(?:[A-Z]\.[ -]?)+(?:McK\. )?((?:Van )?[A-Z][\w'-]+)")
_YEAR = re.compile(r"\b(?:19|20)\d\d\b")


def read() -> dict[str, str]:
    """Return the sources by key, with en dashes in page numbers."""
    lines = (Path(__file__).parents[1] / "sources.txt").read_text(encoding="utf-8").splitlines()
    guide_sources = dict(line.split(": ", 1) for line in lines if line and not line.startswith("#"))
    if twice := sorted(set(guide_sources) & set(REFERENCES)):
        raise ExtensionError(
            f"docs/sources.txt: {', '.join(twice)}: in certificate/paper.py already"
        )
    return {
        key: re.sub(r"(pp\. \d+)-", "\\1\N{EN DASH}", text)
        for key, text in {**REFERENCES, **guide_sources}.items()
    }


def surnames(text: str) -> list[str]:
    """Return the surnames of the authors; empty if the author is an institution."""
    return _AUTHOR.findall(text)


def label(text: str) -> str:
    """Return author and year in the form that a page cites."""
    names, year = surnames(text), _YEAR.findall(text)[-1]
    if not names:
        return text.partition(",")[0].removeprefix("Recommendation ")
    if len(names) > 2 or "et al." in text:
        return f"{names[0]} et al. {year}"
    return f"{' and '.join(names)} {year}"


class Sources(SphinxDirective):
    """The sources of one subject, whose keys are its content, by author."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the list, with a link target for each source."""
        sources, listed = read(), nodes.bullet_list(classes=["sources"])
        for key in sorted(" ".join(self.content).split(), key=lambda key: _order(sources[key])):
            item = nodes.list_item("", nodes.paragraph(sources[key], sources[key]), ids=[_id(key)])
            listed += item
        return [listed]


class Cite(SphinxRole):
    """Role `cite`: author and year of a source, linked to it; several keys separated by commas."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Return a link for each key."""
        sources, links = read(), []
        for key in (part.strip() for part in self.text.split(",")):
            if key not in sources:
                raise ExtensionError(
                    f"{self.get_location()}: no source {key!r} in docs/sources.txt"
                )
            links += [nodes.Text("; ")] if links else []
            up = "../" * self.env.docname.count("/")
            address = f"{up}{_PAGE}.html#{_id(key)}"
            links.append(nodes.reference("", label(sources[key]), refuri=address, internal=True))
        return links, []


def _order(text: str) -> tuple[str, str]:
    return (surnames(text) or [text])[0], _YEAR.findall(text)[-1]


def _id(key: str) -> str:
    return f"source-{key}"


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx both."""
    app.add_directive("sources", Sources)
    app.add_role("cite", Cite())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
