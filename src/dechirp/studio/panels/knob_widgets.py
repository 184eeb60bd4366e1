"""Widgets of knobs: input fields that change settings and show mistakes below them."""

import re
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from typing import Generic, TypeVar

from bokeh.models import Checkbox, Column, Div, Select, TextInput, UIElement

from dechirp.core.errors import Mistake
from dechirp.experiments.scenario import Scenario
from dechirp.studio.option_hints import translate_error_fixes_to_page
from dechirp.studio.panels.fold import Fold
from dechirp.studio.panels.knobs import (
    NONE,
    Knob,
    empty_knobs_of_required_settings,
    family_of_setting,
    kind_as_yaml_mapping,
    overrides_for_knob_text,
    setting_knobs,
    setting_or_parent_value,
)
from dechirp.studio.scenario_edits import apply_overrides
from dechirp.studio.session import Session

T = TypeVar("T")
ChangeSetting = Callable[[str, str], None]


class KnobWidget:
    """Widget of one knob: a text or a choice. Enter or leaving applies it; Escape restores it.

    page.js handles Escape with the text in the tags of the widget.

    Parameters
    ----------
    knob : Knob
        Knob to show.
    on_typed : function
        Called with the path and the typed text.
    on_mark : function
        Called when its validity may have changed.
    """

    def __init__(self, knob: Knob, on_typed: ChangeSetting, on_mark: Callable[[], None]) -> None:
        self._entry, self._on_typed, self._on_mark = knob, on_typed, on_mark
        self._is_pending = self._has_value = False
        self.is_wrong = False
        """True while a mistake is shown below it."""
        self._widget: Checkbox | Select | TextInput
        if knob.is_on_off_switch:
            self._widget = Checkbox()
        else:
            self._widget = Select() if knob.choices else TextInput()
        self._messages = Div(visible=False, sizing_mode="stretch_width", render_as_text=True)
        self._messages.css_classes = ["wrong"]
        self._root = Column(
            children=[self._widget, self._messages], sizing_mode="stretch_width", spacing=0
        )
        self._widget.sizing_mode = "stretch_width"
        name = "active" if knob.is_on_off_switch else "value"
        self._widget.on_change(
            name, lambda attr, old, new: self._submit_changed_text(self.current_text)
        )
        self.show_knob(knob)

    @property
    def root_element(self) -> UIElement:
        """Widget with the messages below it."""
        return self._root

    @property
    def current_text(self) -> str:
        """Current text, applied or not."""
        if isinstance(self._widget, Checkbox):
            return self._entry.choices[int(self._widget.active)][0]
        return str(self._widget.value)

    @property
    def is_switched_on(self) -> bool:
        """True for a switch that is on."""
        return isinstance(self._widget, Checkbox) and bool(self._widget.active)

    @property
    def shows_current_setting(self) -> bool:
        """True if the text is the current setting."""
        return self._has_value and self.current_text == self._entry.text and not self.is_wrong

    def show_knob(self, knob: Knob) -> None:
        """Show the current setting and clear messages; keep a refused text, to be tried again."""
        has_refused_text = self.is_wrong and self.current_text != self._entry.text
        if knob == self._entry and (self.shows_current_setting or has_refused_text):
            return
        self._entry = knob
        self._is_pending, self._has_value = False, True
        widget = self._widget
        widget.update(
            tags=[knob.text],
            html_attributes={
                "title": knob.help,
                "aria-description": knob.help,
                "data-setting": knob.path,
                "data-model": widget.id,
            },
            margin=(2, 0, 2, 12 * knob.depth),
        )
        if isinstance(widget, Checkbox):
            widget.update(label=knob.label, active=knob.text != knob.choices[0][0])
        elif isinstance(widget, Select):
            widget.update(title=knob.label, options=list(knob.choices), value=knob.text)
        else:
            widget.update(title=knob.label, placeholder=knob.placeholder, value=knob.text)
        self._display_mistakes(())

    def show_own_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show mistakes that concern this setting or result from the text typed here."""
        own_mistakes = tuple(
            mistake
            for mistake in mistakes
            if self._is_pending or mistake.setting == self._entry.path
        )
        if own_mistakes:
            self._display_mistakes(own_mistakes)
            self._is_pending = False  # later mistakes have other causes

    def _submit_changed_text(self, text: str) -> None:
        text = with_unit_of_level(text, self._entry.text)
        if text == self._entry.text:
            self._restore_own_text()
            if self.is_wrong:
                self._on_typed(self._entry.path, text)  # the refused text is not tried again
            self._display_mistakes(())  # restored
        else:
            self._is_pending = True
            self._on_typed(self._entry.path, text)

    def _restore_own_text(self) -> None:
        """Show the setting with its unit if the same number was typed without."""
        if isinstance(self._widget, TextInput):
            self._widget.value = self._entry.text

    def _display_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        self.is_wrong = bool(mistakes)
        self._widget.css_classes = ["field", "wrong"] if mistakes else ["field"]
        self._messages.text = "\n".join(
            _mistake_text(mistake, self._entry.path) for mistake in mistakes
        )
        self._messages.visible = bool(mistakes)
        self._on_mark()


_LEVEL = re.compile(r"[-+]?[\d.]+(?:e[-+]?\d+)? (dB\w*)", re.IGNORECASE)
_BARE_NUMBER = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?\s*", re.IGNORECASE)


def with_unit_of_level(text: str, shown_text: str) -> str:
    """Return a typed number with the unit of the shown level, such as dB or dBm.

    Settings files read a bare number as a ratio or in watts, but the field shows decibels.
    """
    level = _LEVEL.fullmatch(shown_text)
    return f"{text.strip()} {level[1]}" if level and _BARE_NUMBER.fullmatch(text) else text


def make_setting_changer(session: Session) -> ChangeSetting:
    """Return the function that applies texts of knobs to the settings of a page."""

    def change(path: str, text: str) -> None:
        def edit(scenario: Scenario) -> Scenario:
            with translate_error_fixes_to_page():
                return apply_overrides(
                    scenario, overrides_for_knob_text(scenario, path, text), session.limits
                )

        session.queue_edit(path, edit, retry=True)

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
        Called with path and text of what is changed, see `setting_knobs.overrides_for_knob_text`.
    group : function of a path
        Function that returns the heading under which a knob is folded; empty for none. Of the
        headings in `open_groups` the knobs are shown at first.
    """

    def __init__(
        self,
        whole: T,
        paths: Callable[[T], Iterable[str]],
        change: ChangeSetting,
        *,
        group: Callable[[str], str] = lambda _: "",
        open_groups: Container[str] = (),
    ) -> None:
        self._whole, self._paths, self._change_setting = whole, paths, change
        self._group, self._open_groups = group, open_groups
        self._folds: dict[str, Fold] = {}
        self._drafts: dict[str, str] = {}
        """Kinds by path whose required settings are not typed yet."""
        self._fields: dict[tuple[str, bool], KnobWidget] = {}
        self.on_marks: list[Callable[[], None]] = []
        """Called when the validity of a knob may have changed."""
        self._parts: list[tuple[str, object]] = []
        self._root = Column(sizing_mode="stretch_width", spacing=0)
        self.show_settings_of(whole)

    @property
    def root_element(self) -> UIElement:
        return self._root

    @property
    def has_wrong_text(self) -> bool:
        """True if a typed text is invalid."""
        return any(field.is_wrong for field in self._fields.values())

    def show_settings_of(self, root_value: T) -> None:
        """Show the current settings."""
        parts = [
            (path, setting_or_parent_value(root_value, path)) for path in self._paths(root_value)
        ]
        # A dragged target changes other settings thirty times a second.
        alike = [path for path, _ in parts] == [path for path, _ in self._parts] and all(
            new is old for (_, new), (_, old) in zip(parts, self._parts, strict=True)
        )
        self._whole, self._parts = root_value, parts
        if alike and all(field.shows_current_setting for field in self._fields.values()):
            return
        self._drafts.clear()
        self._rebuild_widgets()

    def show_mistakes(self, mistakes: tuple[Mistake, ...]) -> None:
        """Show each mistake at its knob."""
        for field in self._fields.values():
            field.show_own_mistakes(mistakes)

    def _rebuild_widgets(self) -> None:
        knobs = [
            self._knob_with_draft_kind(knob)
            for path in self._paths(self._whole)
            for knob in self._knobs_of_setting(path)
        ]
        widgets = {}
        for entry in knobs:
            key = (entry.path, bool(entry.choices))
            widgets[key] = self._fields.get(key) or KnobWidget(
                entry, self._submit_or_draft_text, self._notify_validity_listeners
            )
            widgets[key].show_knob(entry)
        self._fields = widgets
        self._show_in_groups([(self._group(path), field) for (path, _), field in widgets.items()])

    def _show_in_groups(self, fields: Sequence[tuple[str, KnobWidget]]) -> None:
        groups: dict[str, list[KnobWidget]] = {}
        for title, field in fields:
            groups.setdefault(title, []).append(field)
        children: list[UIElement] = [field.root_element for field in groups.pop("", [])]
        for title, members in groups.items():
            if title not in self._folds:
                self._folds[title] = Fold(title, is_open=title in self._open_groups)
            n_on = sum(field.is_switched_on for field in members)
            self._folds[title].set_title(f"{title}: {n_on} on" if n_on else title)
            self._folds[title].set_children([field.root_element for field in members])
            children.append(self._folds[title].root_element)
        if self._root.children != children:
            self._root.children = children

    def _notify_validity_listeners(self) -> None:
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
                family = family_of_setting(self._whole, entry.path)
                assert family is not None
                yield from empty_knobs_of_required_settings(
                    family, self._drafts[entry.path], entry.path
                )

    def _knob_with_draft_kind(self, knob: Knob) -> Knob:
        kind = self._drafts.get(knob.path)
        return knob if kind is None else replace(knob, text=kind_as_yaml_mapping(kind))

    def _submit_or_draft_text(self, path: str, text: str) -> None:
        parent_path = path.rpartition(".")[0]
        if parent_path in self._drafts:
            self._submit_draft_if_complete(parent_path)
            return
        family = family_of_setting(self._whole, path) if text.startswith("{kind: ") else None
        kind = text.removeprefix("{kind: ").removesuffix("}")
        if family is not None and empty_knobs_of_required_settings(family, kind, path):
            self._drafts[path] = kind
            self._rebuild_widgets()
            return
        self._drafts.pop(path, None)
        self._change_setting(path, text)

    def _submit_draft_if_complete(self, path: str) -> None:
        """Submit a drafted member once all required settings are typed."""
        family = family_of_setting(self._whole, path)
        assert family is not None
        kind = self._drafts[path]
        required_knobs = empty_knobs_of_required_settings(family, kind, path)
        texts = [
            self._fields[knob.path, bool(knob.choices)].current_text for knob in required_knobs
        ]
        if all(knob not in ("", NONE) for knob in texts):
            names = [knob.path.rpartition(".")[2] for knob in required_knobs]
            members = ", ".join(f"{name}: {knob}" for name, knob in zip(names, texts, strict=True))
            self._change_setting(path, f"{{kind: {kind}, {members}}}")


def _mistake_text(mistake: Mistake, path: str) -> str:
    prefix = "" if mistake.setting == path else f"{mistake.setting}: "
    return f"{prefix}{mistake.value}; expected {mistake.expected}; {mistake.fix}"
