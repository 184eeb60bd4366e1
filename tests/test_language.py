"""Language of the code: names that say what they contain, docstrings that open with a phrase."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from test_layers import FILES, ROOT_FILES, find_nodes

# A participle or a preposition alone names no value: `kept_rows` does, `kept` does not.
VAGUE_NAME = re.compile(
    r"_*(about|above|after|along|asked|at|before|below|beside|between|called|chosen|done|drawn|each"
    r"|every|felt|followed|found|given|here|held|kept|known|left|lost|made|missed|moved|of|one|own"
    r"|put|said|seen|sent|shown|some|taken|there|through|told|tried|under|with|within|without"
    r"|written)_*",
    re.IGNORECASE,
)
MAX_VAGUE_NAMES_PER_1000 = 3
RELATIVE_CLAUSE = re.compile(
    r"(As|How|Of|So|That|The same|Those|What|When|Where|Whether|Which|Who|Whose)\b"
)
DEFINITIONS = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def iter_nodes(*types: type[ast.AST]) -> Iterator[tuple[Path, ast.AST]]:
    for path in [*FILES, *ROOT_FILES]:
        for node in find_nodes(path, *types):
            yield path, node


def test_names_say_what_they_contain():
    vague, vague_definitions, n_names = [], [], 0
    for path, node in iter_nodes(*DEFINITIONS.__args__, ast.arg, ast.Name):
        if isinstance(node, DEFINITIONS):
            name = node.name
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        else:
            continue
        n_names += 1
        if VAGUE_NAME.fullmatch(name):
            vague.append(f"{path}:{node.lineno} {name}")
            vague_definitions += vague[-1:] if isinstance(node, DEFINITIONS) else []

    assert vague_definitions == []
    assert len(vague) <= MAX_VAGUE_NAMES_PER_1000 * n_names / 1000, vague


def test_docstrings_open_with_verb_or_noun_phrase():
    unclear = [
        f"{path}:{getattr(node, 'lineno', 1)} {docstring.splitlines()[0]}"
        for path, node in iter_nodes(ast.Module, *DEFINITIONS.__args__)
        if (docstring := ast.get_docstring(node)) is not None and RELATIVE_CLAUSE.match(docstring)
    ]

    assert unclear == []
