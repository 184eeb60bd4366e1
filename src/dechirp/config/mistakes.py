"""What the checks found, in words: where in the file, what was got, what is needed, the cure."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Literal, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from dechirp.config.fields import Setting, Slot, is_family, key_of, settings, words
from dechirp.config.models import ElsewhereError
from dechirp.config.nearest import OR_NONE, did_you_mean, nearest
from dechirp.config.shown import shown
from dechirp.config.tree import Node, Place, dotted
from dechirp.core.errors import InvalidSetting, Mistake


@dataclass(frozen=True)
class Spot:
    """A setting: its path, what is written there, and what may be."""

    path: str
    node: Node
    slot: Slot

    @property
    def place(self) -> Place:
        """Where messages point: at the name of what takes many lines."""
        wide = isinstance(self.node.content, dict | list)
        return self.node.named_at if wide else self.node.place

    @property
    def setting(self) -> str:
        """What messages call it."""
        return self.path or "the file"

    def settings(self) -> dict[str, Setting]:
        """List what a mapping here may set."""
        cls = self.slot.value_class(self.node)
        return settings(cls) if cls else {}

    def step(self, key: str | int) -> "Spot | None":
        """Go to the setting of that name or index within this one, if it is written."""
        content = self.node.content
        if isinstance(content, dict) and key in content:
            known = self.settings().get(str(key))
            slot = known.slot if known else Slot(object)
            return Spot(dotted(self.path, str(key)), content[str(key)], slot)
        if isinstance(content, list) and isinstance(key, int) and key < len(content):
            path = dotted(self.path, self.node.labels[key])
            return Spot(path, content[key], self.slot.member())
        return None


def mistakes(
    error: ValidationError, spot: Spot, *, read_from_path: Collection[type]
) -> list[Mistake]:
    """Mistakes in a tree that was checked against a value class.

    Parameters
    ----------
    error : ValidationError
        What pydantic found; its own words do not reach the user.
    spot : Spot
        The whole tree.
    read_from_path : collection of types
        Those for which the path of a file may stand.
    """
    found: dict[Mistake, None] = {}  # a list that is too short by two is one mistake
    for detail in error.errors(include_url=False):
        at, about = spot, spot
        for key in detail["loc"]:
            # What is not written belongs to the spot about it; so do the names that pydantic
            # gives to the types of a union.
            at, about = at.step(key) or at, at
        found.update(dict.fromkeys(_explained(detail, at, about, read_from_path)))
    return list(found)


def _explained(
    detail: ErrorDetails, at: Spot, about: Spot, read_from_path: Collection[type]
) -> Iterator[Mistake]:
    last = detail["loc"][-1] if detail["loc"] else None
    if detail["type"] == "value_error":
        yield from refused(detail["ctx"]["error"], at)
    elif detail["type"] == "extra_forbidden":
        yield _unknown(at, about)
    elif detail["type"] == "missing" and isinstance(last, str):
        yield from _missing(last, at, read_from_path)
    elif detail["type"] == "kind" and isinstance(at.node.content, dict):
        yield _wrong_kind(at)
    else:
        yield at.place.mistake(
            at.setting,
            got=at.node.shown,
            need=words(at.slot, read_from_path=read_from_path),
            fix=_cure(at),
        )


def refused(error: Exception, at: Spot) -> Iterator[Mistake]:
    """Say what a value has against its fields, or a quantity against its text."""
    if not isinstance(error, InvalidSetting | ElsewhereError):
        raise error  # nobody's mistake but ours
    for mistake in error.mistakes:
        if mistake.file is not None:
            yield mistake
            continue
        spot, path = at, at.path
        cls = at.slot.value_class(at.node)
        owner, *names = mistake.setting.split(".")
        if cls is not None and owner in settings(cls):
            names = [owner, *names]  # the path of a setting, rather than Class.field
        elif cls is None or owner != cls.__name__:
            names = []
        for name in names:
            cls = spot.slot.value_class(spot.node)
            key = key_of(cls, name) if cls else name
            labels = spot.node.labels
            step = spot.step(labels.index(key) if key in labels else key)
            spot, path = step or spot, dotted(path, key)
        written = spot.path == path and not isinstance(spot.node.content, dict | list)
        # Who wrote -1 MHz would not know -1000000.0 again.
        plain = mistake.setting == "quantity" or (names and _is_number(mistake.got))
        yield spot.place.mistake(
            path or "the file",
            got=spot.node.shown if written and plain else mistake.got,
            need=mistake.need,
            fix=mistake.fix,
        )


def _unknown(at: Spot, about: Spot) -> Mistake:
    names = about.settings()
    return at.node.named_at.mistake(
        at.setting,
        got="not a known name",
        need=f"one of {', '.join(names)}" if names else "left out: there are no settings here",
        fix=did_you_mean(at.path.rpartition(".")[2], names, OR_NONE),
    )


def _missing(key: str, about: Spot, read_from_path: Collection[type]) -> Iterator[Mistake]:
    known = about.settings()
    assert isinstance(about.node.content, dict)
    misspelt = (name for name in about.node.content if name not in known)
    if key in (nearest(name, known) for name in misspelt):
        return  # the misspelt name is the mistake
    yield about.place.mistake(
        dotted(about.path, key),
        got="missing",
        need=f"given: {words(known[key].slot, read_from_path=read_from_path)}",
        fix=f"Add {key}.",
    )


def _wrong_kind(at: Spot) -> Mistake:
    families = [choice for choice in at.slot.choices if is_family(choice)]
    kinds = [kind for family in families for kind in family.members()]
    kind = at.step("kind")
    place, got = (kind.place, kind.node.shown) if kind else (at.place, "missing")
    missing = {name: why for one in families for name, why in one.missing_guests().items()}
    if kind and kind.node.text in missing:
        return place.mistake(
            dotted(at.path, "kind"),
            got=f"{got}, which cannot be loaded ({missing[kind.node.text]})",
            need=f"one of {', '.join(kinds)}, or a package that can be loaded",
            fix="Mend or remove the package that has it.",
        )
    return place.mistake(
        dotted(at.path, "kind"),
        got=got,
        need=f"one of {', '.join(kinds)}",
        fix=did_you_mean(got, kinds),
    )


def _cure(at: Spot) -> str:
    hint = at.slot.choices[0]
    if get_origin(hint) is Literal:
        return did_you_mean(at.node.text, map(str, get_args(hint)))
    if get_origin(hint) is tuple:
        return "Write all of them in brackets, with commas between."
    if is_family(hint):
        return (
            f"Write {{kind: {nearest(at.node.text, hint.members()) or 'NAME'}}}, and its settings."
        )
    if hint is str and not isinstance(at.node.content, dict | list | None):
        return f"Put it in quotes: '{shown(at.node.text)}'."
    cures = {
        int: "Write digits alone, as 128: no quotes, no point and no unit.",
        float: "Write one number.",
        bool: "Write true or false, without quotes.",
        str: "Write a text.",
    }
    return cures.get(hint, "Write its settings below it, indented, as NAME: VALUE.")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
