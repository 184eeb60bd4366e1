"""Language of the code: names that say what they contain, docstrings that open with a phrase."""

import ast
import re
from collections.abc import Iterator

from test_layers import FILES, ROOT_FILES, walk_file

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


def iter_nodes() -> Iterator[tuple[str, ast.AST]]:
    for path in [*FILES, *ROOT_FILES]:
        for node in walk_file(path):
            yield f"{path}:{getattr(node, 'lineno', 1)}", node


def test_names_say_what_they_contain():
    vague, vague_definitions, n_names = [], [], 0
    for place, node in iter_nodes():
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
            vague.append(f"{place} {name}")
            vague_definitions += [f"{place} {name}"] if isinstance(node, DEFINITIONS) else []

    assert vague_definitions == []
    assert len(vague) <= MAX_VAGUE_NAMES_PER_1000 * n_names / 1000, vague


def test_docstrings_open_with_verb_or_noun_phrase():
    unclear = [
        f"{place} {docstring.splitlines()[0]}"
        for place, node in iter_nodes()
        if isinstance(node, ast.Module | DEFINITIONS)
        and (docstring := ast.get_docstring(node)) is not None
        and RELATIVE_CLAUSE.match(docstring)
    ]

    assert unclear == []
