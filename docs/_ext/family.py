"""Directive `family`: members of a family with their settings, as `dechirp list` prints them.

```{family} cfar
```
"""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from dechirp.cli.commands.list import family_base_classes, help_and_settings_by_kind


class Members(SphinxDirective):
    """Directive that lists the members of one family with their settings."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return a definition list: each kind with its description and a table of its settings."""
        items = nodes.definition_list()
        for kind, member in help_and_settings_by_kind(
            family_base_classes()[self.arguments[0]]
        ).items():
            text = nodes.definition("", nodes.paragraph("", member["help"]))
            if member["settings"]:
                text += _table(member["settings"])
            items += nodes.definition_list_item(
                "", nodes.term("", "", nodes.literal(kind, kind)), text
            )
        return [items]


def _table(settings: dict[str, Any]) -> nodes.table:
    group = nodes.tgroup(cols=3)
    for width in (2, 4, 2):
        group += nodes.colspec(colwidth=width)
    group += nodes.thead("", _row("setting", "takes", "default"))
    body = nodes.tbody()
    for name, setting in settings.items():
        expected = f"{setting['expected']}. {setting['help']}".strip()
        default_text = "required" if setting["required"] else _format_default(setting["default"])
        body += _row(nodes.literal(name, name), expected, default_text)
    group += body
    return nodes.table("", group)


def _row(*cells: str | nodes.Node) -> nodes.row:
    row = nodes.row()
    for cell in cells:
        inner = nodes.Text(cell) if isinstance(cell, str) else cell
        row += nodes.entry("", nodes.paragraph("", "", inner))
    return row


def _format_default(default: object) -> str:
    return "null" if default is None else str(default)


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.add_directive("family", Members)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
