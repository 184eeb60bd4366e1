"""What the settings mean: the docstrings under the fields."""

import ast
import inspect
import textwrap
from dataclasses import fields
from typing import Any


def field_help(cls: type[Any]) -> dict[str, str]:
    """Find the text under each field of a value class, on one line; empty where none is."""
    body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for statement, after in zip(body.body, [*body.body[1:], ast.Pass()], strict=True):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            match after:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    found[statement.target.id] = " ".join(text.split())
    return {field.name: found.get(field.name, "") for field in fields(cls)}
