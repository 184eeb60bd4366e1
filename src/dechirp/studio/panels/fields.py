"""Knobs on the page: what is typed goes to a setting, and what is wrong with it stands below."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Generic, TypeVar

from bokeh.models import Checkbox, Column, Div, Select, TextInput, UIElement

from dechirp.core.errors import Mistake
from dechirp.experiment.scenario import Scenario
from dechirp.studio.panels.entries import (
    NONE,
    Entry,
    chosen,
    entries,
    family_of,
    of_member,
    options,
    value_at,
)
from dechirp.studio.session import Session
from dechirp.studio.settings import changed

T = TypeVar("T")
Change = Callable[[str, str], None]


class Field:
    """One knob: a text or a choice. Enter or leaving it applies; Escape puts back what holds.

    page.js answers Escape, with the text that it finds in the tags of the widget.

    Parameters
    ----------
    entry : Entry
        What it shows.
    typed : function
        Called with path and text of what is typed.
    marked : function
        Called when it may have become wrong, or right again.
    """

    def __init__(self, entry: Entry, typed: Change, marked: Callable[[], None]) -> None:
        self._entry, self._typed, self._marked = entry, typed, marked
        self._asked = self._shown = False
        self.is_wrong = False
        """Whether what is wrong with it stands below it."""
        self._widget: Checkbox | Select | TextInput
        if entry.is_switch:
            self._widget = Checkbox()
        else:
            self._widget = Select() if entry.choices else TextInput()
        self._words = Div(visible=False, sizing_mode="stretch_width", render_as_text=True)
        self._words.css_classes = ["wrong"]
        self._root = Column(
            children=[self._widget, self._words], sizing_mode="stretch_width", spacing=0
        )
        self._widget.sizing_mode = "stretch_width"
        name = "active" if entry.is_switch else "value"
        self._widget.on_change(name, lambda attr, old, new: self._take(self.text))
        self.show(entry)

    @property
    def root(self) -> UIElement:
        """The knob, with the words below it."""
        return self._root

    @property
    def text(self) -> str:
        """What is in it now, applied or not."""
        if isinstance(self._widget, Checkbox):
            return self._entry.choices[int(self._widget.active)][0]
        return str(self._widget.value)

    @property
    def holds(self) -> bool:
        """Whether what is in it holds."""
        return self._shown and self.text == self._entry.text and not self.is_wrong

    def show(self, entry: Entry) -> None:
        """Show what holds; what was wrong is forgotten."""
        if entry == self._entry and self.holds:
            return
        self._entry = entry
        self._asked, self._shown = False, True
        widget = self._widget
        widget.update(
            tags=[entry.text],
            html_attributes={
                "title": entry.help,
                "aria-description": entry.help,
                "data-setting": entry.path,
                "data-model": widget.id,
            },
            margin=(2, 0, 2, 12 * entry.depth),
        )
        if isinstance(widget, Checkbox):
            widget.update(label=entry.label, active=entry.text != entry.choices[0][0])
        elif isinstance(widget, Select):
            widget.update(title=entry.label, options=list(entry.choices), value=entry.text)
        else:
            widget.update(title=entry.label, placeholder=entry.need, value=entry.text)
        self._mark(())

    def tell(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show what is wrong, if that is about this setting, or came of what was typed here."""
        own = tuple(one for one in mistakes if self._asked or one.setting == self._entry.path)
        if own:
            self._mark(own)
            self._asked = False  # what goes wrong later came of something else

    def _take(self, text: str) -> None:
        if text == self._entry.text:
            self._mark(())  # put back
        else:
            self._asked = True
            self._typed(self._entry.path, text)

    def _mark(self, mistakes: tuple[Mistake, ...]) -> None:
        self.is_wrong = bool(mistakes)
        self._widget.css_classes = ["field", "wrong"] if mistakes else ["field"]
        self._words.text = "\n".join(_words(one, self._entry.path) for one in mistakes)
        self._words.visible = bool(mistakes)
        self._marked()


def changer(session: Session) -> Change:
    """What puts texts of knobs into the settings of a page."""

    def change(path: str, text: str) -> None:
        def made(scenario: Scenario) -> Scenario:
            return changed(scenario, options(scenario, path, text), session.limits)

        session.edit(path, made)

    return change


class Form(Generic[T]):
    """The knobs of some settings of a value, with all that lies below them.

    A member of a family that cannot be without some settings is asked for once they are typed.

    Parameters
    ----------
    whole : value
        That has the settings.
    paths : function of the value
        The settings.
    change : function
        Called with path and text of what is changed, see `entries.options`.
    """

    def __init__(self, whole: T, paths: Callable[[T], Iterable[str]], change: Change) -> None:
        self._whole, self._paths, self._change = whole, paths, change
        self._drafts: dict[str, str] = {}
        """Kinds by path that wait for their settings."""
        self._fields: dict[tuple[str, bool], Field] = {}
        self.on_marks: list[Callable[[], None]] = []
        """Called when a knob may have become wrong, or right again."""
        self._parts: list[tuple[str, object]] = []
        self._root = Column(sizing_mode="stretch_width", spacing=0)
        self.show(whole)

    @property
    def root(self) -> UIElement:
        """The knobs, one below the other."""
        return self._root

    @property
    def is_wrong(self) -> bool:
        """Whether something that is typed in it does not hold."""
        return any(field.is_wrong for field in self._fields.values())

    def show(self, whole: T) -> None:
        """Show what holds."""
        parts = [(path, value_at(whole, path)) for path in self._paths(whole)]
        # Thirty times a second something else may be turned, a target that is dragged.
        alike = [path for path, _ in parts] == [path for path, _ in self._parts] and all(
            new is old for (_, new), (_, old) in zip(parts, self._parts, strict=True)
        )
        self._whole, self._parts = whole, parts
        if alike and all(field.holds for field in self._fields.values()):
            return
        self._drafts.clear()
        self._draw()

    def tell(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show what is wrong where it is."""
        for field in self._fields.values():
            field.tell(mistakes)

    def _draw(self) -> None:
        found = [self._drafted(one) for path in self._paths(self._whole) for one in self._of(path)]
        kept = {}
        for entry in found:
            key = (entry.path, bool(entry.choices))
            kept[key] = self._fields.get(key) or Field(entry, self._typed, self._mark)
            kept[key].show(entry)
        self._fields = kept
        children = [field.root for field in kept.values()]
        if self._root.children != children:
            self._root.children = children

    def _mark(self) -> None:
        for heard in self.on_marks:
            heard()

    def _of(self, path: str) -> Iterable[Entry]:
        """Knobs of a setting; instead of those of a member that is being left, the next one's."""
        own = tuple(entries(self._whole, path))
        for entry in own:
            if any(entry.path.startswith(f"{left}.") for left in self._drafts):
                continue
            yield entry
            if entry.path in self._drafts:
                family = family_of(self._whole, entry.path)
                assert family is not None
                yield from of_member(family, self._drafts[entry.path], entry.path)

    def _drafted(self, entry: Entry) -> Entry:
        kind = self._drafts.get(entry.path)
        return entry if kind is None else replace(entry, text=chosen(kind))

    def _typed(self, path: str, text: str) -> None:
        above = path.rpartition(".")[0]
        if above in self._drafts:
            self._finish(above)
            return
        family = family_of(self._whole, path) if text.startswith("{kind: ") else None
        kind = text.removeprefix("{kind: ").removesuffix("}")
        if family is not None and of_member(family, kind, path):
            self._drafts[path] = kind
            self._draw()
            return
        self._drafts.pop(path, None)
        self._change(path, text)

    def _finish(self, path: str) -> None:
        """Ask for a member once all that it needs is typed."""
        family = family_of(self._whole, path)
        assert family is not None
        kind = self._drafts[path]
        needed = of_member(family, kind, path)
        typed = [self._fields[one.path, bool(one.choices)].text for one in needed]
        if all(one not in ("", NONE) for one in typed):
            names = [one.path.rpartition(".")[2] for one in needed]
            members = ", ".join(f"{name}: {one}" for name, one in zip(names, typed, strict=True))
            self._change(path, f"{{kind: {kind}, {members}}}")


def _words(mistake: Mistake, path: str) -> str:
    about = "" if mistake.setting == path else f"{mistake.setting}: "
    return f"{about}{mistake.got}; needs {mistake.need}. {mistake.fix}"
