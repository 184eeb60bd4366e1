"""A tile with a title of two lines and two figures, of which a switch shows one."""

from collections.abc import Callable

from bokeh.layouts import column, row
from bokeh.models import Div, RadioButtonGroup, UIElement
from bokeh.plotting import figure


class Switched:
    """Title and switch over the figure that is chosen; figures by the words of the switch."""

    def __init__(
        self, name: str, figures: dict[str, figure], *, on_switch: Callable[[], None]
    ) -> None:
        self._figures, self._on_switch = figures, on_switch
        self.title, self.note = (
            Div(
                text="",
                sizing_mode="stretch_width",
                margin=0,
                styles={"padding": padding},
                css_classes=["line"],
            )
            for padding in ("6px 0 0 8px", "0 0 0 8px")
        )
        self.note.styles = {**self.note.styles, "font-size": "10px", "color": "var(--muted)"}
        self.switch = RadioButtonGroup(labels=list(figures), active=0, margin=(3, 4, 0, 4))
        self.switch.on_change("active", self._turn)
        head = row(self.title, self.switch, sizing_mode="stretch_width", margin=0)
        self.root: UIElement = column(head, self.note, *figures.values(), name=name, margin=0)
        self.root.sizing_mode = "stretch_both"
        for made in figures.values():
            made.title.visible = False
        self._choose()

    @property
    def chosen(self) -> str:
        """What the switch says."""
        names, at = list(self._figures), self.switch.active
        return names[at] if at in range(len(names)) else names[0]  # a browser may say anything

    def say(self, title: str, note: str) -> None:
        """Say what is seen, and in a smaller line what its marks mean, with numbers."""
        self.title.text, self.note.text = f"<b>{title}</b>", note

    def _turn(self, attr: str, old: int, new: int) -> None:
        self._choose()
        self._on_switch()

    def _choose(self) -> None:
        for words, made in self._figures.items():
            made.visible = words == self.chosen


def coloured(words: str, role: str) -> str:
    """Words in a colour of the theme."""
    return f"<span style='color: var(--{role})'>{words}</span>"
