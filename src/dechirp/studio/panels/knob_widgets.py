"""Widgets of knobs: input fields that change settings and show mistakes below them."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Generic, TypeVar

from bokeh.models import Checkbox, Column, Div, Select, TextInput, UIElement

from dechirp.core.errors import Mistake
from dechirp.experiments.scenario import Scenario
from dechirp.studio.panels.knobs import (
    NONE,
    Knob,
    kind_text,
    override_options,
    required_member_knobs,
    setting_family,
    setting_knobs,
    setting_value,
)
from dechirp.studio.scenario_edits import apply_options
from dechirp.studio.session import Session

T = TypeVar("T")
ChangeSetting = Callable[[str, str], None]


class KnobWidget:
    """Widget of one knob: a text or a choice. Enter or leaving applies it; Escape restores it.

    page.js handles Escape with the text in the tags of the widget.

    Parameters
    ----------
    entry : Entry
        Knob to show.
    typed : function
        Called with the path and the typed text.
    marked : function
        Called when its validity may have changed.
    """

    def __init__(self, knob: Knob, on_typed: ChangeSetting, on_mark: Callable[[], None]) -> None:
        self._entry, self._on_typed, self._on_mark = knob, on_typed, on_mark
        self._is_pending = self._has_value = False
        self.is_wrong = False
        """True while a mistake is shown below it."""
        self._widget: Checkbox | Select | TextInput
        if knob.is_switch:
            self._widget = Checkbox()
        else:
            self._widget = Select() if knob.choices else TextInput()
        self._messages = Div(visible=False, sizing_mode="stretch_width", render_as_text=True)
        self._messages.css_classes = ["wrong"]
        self._root = Column(
            children=[self._widget, self._messages], sizing_mode="stretch_width", spacing=0
        )
        self._widget.sizing_mode = "stretch_width"
        name = "active" if knob.is_switch else "value"
        self._widget.on_change(name, lambda attr, old, new: self._on_change(self.text))
        self.show(knob)

    @property
    def root(self) -> UIElement:
        """Widget with the messages below it."""
        return self._root

    @property
    def text(self) -> str:
        """Current text, applied or not."""
        if isinstance(self._widget, Checkbox):
            return self._entry.choices[int(self._widget.active)][0]
        return str(self._widget.value)

    @property
    def is_current(self) -> bool:
        """True if the text is the current setting."""
        return self._has_value and self.text == self._entry.text and not self.is_wrong

    def show(self, entry: Knob) -> None:
        """Show the current setting and clear messages."""
        if entry == self._entry and self.is_current:
            return
        self._entry = entry
        self._is_pending, self._has_value = False, True
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
            widget.update(title=entry.label, placeholder=entry.placeholder, value=entry.text)
        self._show_messages(())

    def show_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show mistakes that concern this setting or result from the text typed here."""
        own_mistakes = tuple(
            one for one in mistakes if self._is_pending or one.setting == self._entry.path
        )
        if own_mistakes:
            self._show_messages(own_mistakes)
            self._is_pending = False  # later mistakes have other causes

    def _on_change(self, text: str) -> None:
        if text == self._entry.text:
            self._show_messages(())  # restored
        else:
            self._is_pending = True
            self._on_typed(self._entry.path, text)

    def _show_messages(self, mistakes: tuple[Mistake, ...]) -> None:
        self.is_wrong = bool(mistakes)
        self._widget.css_classes = ["field", "wrong"] if mistakes else ["field"]
        self._messages.text = "\n".join(_mistake_text(one, self._entry.path) for one in mistakes)
        self._messages.visible = bool(mistakes)
        self._on_mark()


def setting_changer(session: Session) -> ChangeSetting:
    """Return the function that applies texts of knobs to the settings of a page."""

    def change(path: str, text: str) -> None:
        def edit(scenario: Scenario) -> Scenario:
            return apply_options(scenario, override_options(scenario, path, text), session.limits)

        session.queue_edit(path, edit)

    return change


class KnobForm(Generic[T]):
    """Knobs of some settings of a value, with all nested settings.

    A member with required settings is submitted once all of them are typed.

    Parameters
    ----------
    whole : value
        Value with the settings.
    paths : function of the value
        Function that returns the paths of the settings.
    change : function
        Called with path and text of what is changed, see `setting_knobs.override_options`.
    """

    def __init__(
        self, whole: T, paths: Callable[[T], Iterable[str]], change: ChangeSetting
    ) -> None:
        self._whole, self._paths, self._change_setting = whole, paths, change
        self._drafts: dict[str, str] = {}
        """Kinds by path whose required settings are not typed yet."""
        self._fields: dict[tuple[str, bool], KnobWidget] = {}
        self.on_marks: list[Callable[[], None]] = []
        """Called when the validity of a knob may have changed."""
        self._parts: list[tuple[str, object]] = []
        self._root = Column(sizing_mode="stretch_width", spacing=0)
        self.show(whole)

    @property
    def root(self) -> UIElement:
        return self._root

    @property
    def is_wrong(self) -> bool:
        """True if a typed text is invalid."""
        return any(field.is_wrong for field in self._fields.values())

    def show(self, whole: T) -> None:
        """Show the current settings."""
        parts = [(path, setting_value(whole, path)) for path in self._paths(whole)]
        # A dragged target changes other settings thirty times a second.
        alike = [path for path, _ in parts] == [path for path, _ in self._parts] and all(
            new is old for (_, new), (_, old) in zip(parts, self._parts, strict=True)
        )
        self._whole, self._parts = whole, parts
        if alike and all(field.is_current for field in self._fields.values()):
            return
        self._drafts.clear()
        self._rebuild()

    def show_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show each mistake at its knob."""
        for field in self._fields.values():
            field.show_mistakes(mistakes)

    def _rebuild(self) -> None:
        knobs = [
            self._with_draft_kind(knob)
            for path in self._paths(self._whole)
            for knob in self._knobs_of_setting(path)
        ]
        widgets = {}
        for entry in knobs:
            key = (entry.path, bool(entry.choices))
            widgets[key] = self._fields.get(key) or KnobWidget(
                entry, self._on_typed, self._notify_marks
            )
            widgets[key].show(entry)
        self._fields = widgets
        children = [field.root for field in widgets.values()]
        if self._root.children != children:
            self._root.children = children

    def _notify_marks(self) -> None:
        for listener in self.on_marks:
            listener()

    def _knobs_of_setting(self, path: str) -> Iterable[Knob]:
        """Yield the knobs of a setting; a drafted kind replaces the member that it leaves."""
        knobs = tuple(setting_knobs(self._whole, path))
        for entry in knobs:
            if any(entry.path.startswith(f"{draft_path}.") for draft_path in self._drafts):
                continue
            yield entry
            if entry.path in self._drafts:
                family = setting_family(self._whole, entry.path)
                assert family is not None
                yield from required_member_knobs(family, self._drafts[entry.path], entry.path)

    def _with_draft_kind(self, entry: Knob) -> Knob:
        kind = self._drafts.get(entry.path)
        return entry if kind is None else replace(entry, text=kind_text(kind))

    def _on_typed(self, path: str, text: str) -> None:
        parent_path = path.rpartition(".")[0]
        if parent_path in self._drafts:
            self._submit_draft(parent_path)
            return
        family = setting_family(self._whole, path) if text.startswith("{kind: ") else None
        kind = text.removeprefix("{kind: ").removesuffix("}")
        if family is not None and required_member_knobs(family, kind, path):
            self._drafts[path] = kind
            self._rebuild()
            return
        self._drafts.pop(path, None)
        self._change_setting(path, text)

    def _submit_draft(self, path: str) -> None:
        """Submit a drafted member once all required settings are typed."""
        family = setting_family(self._whole, path)
        assert family is not None
        kind = self._drafts[path]
        required_knobs = required_member_knobs(family, kind, path)
        texts = [self._fields[knob.path, bool(knob.choices)].text for knob in required_knobs]
        if all(knob not in ("", NONE) for knob in texts):
            names = [knob.path.rpartition(".")[2] for knob in required_knobs]
            members = ", ".join(f"{name}: {knob}" for name, knob in zip(names, texts, strict=True))
            self._change_setting(path, f"{{kind: {kind}, {members}}}")


def _mistake_text(mistake: Mistake, path: str) -> str:
    prefix = "" if mistake.setting == path else f"{mistake.setting}: "
    return f"{prefix}{mistake.value}; expected {mistake.expected}; {mistake.fix}"
