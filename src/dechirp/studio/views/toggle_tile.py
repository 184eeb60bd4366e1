"""Tile with a two-line title and several figures, of which a switch shows one."""

from collections.abc import Callable

from bokeh.layouts import column, row
from bokeh.models import Div, RadioButtonGroup, UIElement
from bokeh.plotting import figure


class ToggleTile:
    """Title and switch above the active figure; figures by switch label."""

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
        self.switch.on_change("active", self._show_active_and_notify)
        head = row(self.title, self.switch, sizing_mode="stretch_width", margin=0)
        self.root_element: UIElement = column(
            head, self.note, *figures.values(), name=name, margin=0
        )
        self.root_element.sizing_mode = "stretch_both"
        for tile_figure in figures.values():
            tile_figure.title.visible = False
        self._show_active_figure()

    @property
    def active_label(self) -> str:
        """Label of the active figure."""
        names, index = list(self._figures), self.switch.active
        # A browser may send anything.
        return names[index] if index in range(len(names)) else names[0]

    def set_caption(self, title: str, note: str) -> None:
        """Set the title and a smaller line below it."""
        self.title.text, self.note.text = f"<b>{title}</b>", note

    def _show_active_and_notify(self, attr: str, old: int, new: int) -> None:
        self._show_active_figure()
        self._on_switch()

    def _show_active_figure(self) -> None:
        for label, tile_figure in self._figures.items():
            tile_figure.visible = label == self.active_label


def coloured_html(text: str, colour_role: str) -> str:
    """Return text in a colour of the theme as HTML."""
    return f"<span style='color: var(--{colour_role})'>{text}</span>"
