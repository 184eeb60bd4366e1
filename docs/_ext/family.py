"""Members of a family with their settings, as `dechirp list` has them.

```{family} cfar
```
"""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from dechirp.cli.commands.list import family_base_classes, member_help_and_settings


class Members(SphinxDirective):
    """Directive that lists the members of one family with their settings."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Give a definition list: each kind, what it is, and a table of its settings."""
        shown = nodes.definition_list()
        for kind, member in member_help_and_settings(
            family_base_classes()[self.arguments[0]]
        ).items():
            text = nodes.definition("", nodes.paragraph("", member["help"]))
            if member["settings"]:
                text += _table(member["settings"])
            shown += nodes.definition_list_item(
                "", nodes.term("", "", nodes.literal(kind, kind)), text
            )
        return [shown]


def _table(settings: dict[str, Any]) -> nodes.table:
    group = nodes.tgroup(cols=3)
    for width in (2, 4, 2):
        group += nodes.colspec(colwidth=width)
    group += nodes.thead("", _row("setting", "takes", "default"))
    body = nodes.tbody()
    for name, told in settings.items():
        need = f"{told['expected']}. {told['help']}".strip()
        written = "required" if told["required"] else _written(told["default"])
        body += _row(nodes.literal(name, name), need, written)
    group += body
    return nodes.table("", group)


def _row(*cells: str | nodes.Node) -> nodes.row:
    row = nodes.row()
    for cell in cells:
        inner = nodes.Text(cell) if isinstance(cell, str) else cell
        row += nodes.entry("", nodes.paragraph("", "", inner))
    return row


def _written(default: object) -> str:
    return "null" if default is None else str(default)


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.add_directive("family", Members)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
