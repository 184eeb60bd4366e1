"""Settings of the command line, `--set PATH=VALUE`, put into the tree of a file."""

from dataclasses import replace

from dechirp.config.mistakes import Spot
from dechirp.config.models import Context
from dechirp.config.nearest import did_you_mean
from dechirp.config.shown import shown
from dechirp.config.texts import dump
from dechirp.config.tree import Node, Place, dotted, read_tree
from dechirp.core.errors import InvalidFile

_OPTION = Place("--set")


def override(spot: Spot, text: str, context: Context) -> Node:
    """Change one setting of a tree; `text` is PATH=VALUE, VALUE as in a file.

    A mapping on the way that is not written starts as its default; a value that is given
    as the path of a file is read, to be changed. Another kind starts from its own defaults:
    settings of the one before go with it.

    Raises
    ------
    InvalidFile
        If the text is not of that form or the path leads nowhere; its `file` is `--set`.
    """
    path, made = given(text)
    return placed(spot, path.split("."), made, context)


def given(text: str) -> tuple[str, Node]:
    """Path and value of PATH=VALUE.

    Raises
    ------
    InvalidFile
        If the text is not of that form.
    """
    path, equals, written = text.partition("=")
    if not (path.strip() and equals):
        raise InvalidFile(
            _OPTION.mistake(
                "--set",
                got=shown(text) if text else "empty",
                need="PATH=VALUE",
                fix="Write --set radar.frame.n_chirps=64, for instance.",
            )
        )
    path = path.strip()
    try:
        return path, _moved(read_tree(written, "--set"), _OPTION)
    except InvalidFile as error:
        mistakes = (replace(m, setting=path, line=None, column=None) for m in error.mistakes)
        raise InvalidFile(*mistakes) from None


def placed(spot: Spot, names: list[str], made: Node, context: Context) -> Node:
    """Replace what lies at the names below a spot, and give the node of the spot.

    Raises
    ------
    InvalidFile
        If they lead nowhere.
    """
    if not names:
        return made
    name, *rest = names
    node = _opened(spot, context)
    spot = replace(spot, node=node)
    if isinstance(node.content, list):
        index = _index(spot, name)
        inner = Spot(dotted(spot.path, name), node.content[index], spot.slot.member())
        members = list(node.content)
        members[index] = placed(inner, rest, made, context)
        return replace(node, content=members)
    if not isinstance(node.content, dict):
        raise InvalidFile(
            _OPTION.mistake(
                dotted(spot.path, name),
                got=f"inside {spot.setting}, which is {node.shown}",
                need="inside a mapping or a list",
                fix=f"Set {spot.setting} itself.",
            )
        )
    known = spot.settings().get(name)
    if known and rest:
        start = node.content.get(name)
        if start is None or start.content is None:
            start = _from_default(known.default)
        inner = Spot(dotted(spot.path, name), start, known.slot)
        made = placed(inner, rest, made, context)
    before = node.content.get(name)
    if name == "kind" and before is not None and before.content != made.content:
        return replace(node, content={name: made})
    # A name that is not known is kept as it is, and refused with those of the file.
    return replace(node, content={**node.content, name: made})


def _opened(spot: Spot, context: Context) -> Node:
    """Give the node, or where it is the path of a file, what stands in that file."""
    path = spot.node.content
    for cls in spot.slot.choices if isinstance(path, str) else ():
        if cls in context.readers:
            file = context.base / str(path)
            return _moved(read_tree(dump(context.readers[cls](file)), ""), Place(str(file)))
    return spot.node


def _from_default(default: object) -> Node:
    if default is None:
        return Node({}, _OPTION, _OPTION)
    return _moved(read_tree(dump(default), ""), _OPTION)


def _moved(node: Node, place: Place) -> Node:
    """Put all of a tree at one place."""
    content = node.content
    if isinstance(content, dict):
        content = {name: _moved(child, place) for name, child in content.items()}
    elif isinstance(content, list):
        content = [_moved(child, place) for child in content]
    again = tuple((name, place) for name, _ in node.repeated)
    return replace(node, content=content, place=place, named_at=place, repeated=again)


def _index(spot: Spot, name: str) -> int:
    """Index of a member of a list, by its label or its index."""
    labels = spot.node.labels
    if name in labels:
        return labels.index(name)
    if name.isdecimal() and len(name) < 10 and int(name) < len(labels):
        return int(name)
    raise InvalidFile(
        _OPTION.mistake(
            dotted(spot.path, name),
            got="not in the list",
            need=f"one of {', '.join(labels)}" if labels else "left out: the list is empty",
            fix=did_you_mean(name, labels),
        )
    )
