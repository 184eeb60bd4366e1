"""Tile with several figures, of which a switch shows one."""

from collections.abc import Callable

from bokeh.layouts import column
from bokeh.models import RadioButtonGroup, UIElement
from bokeh.plotting import figure


class ToggleTile:
    """Switch and the active figure; figures by switch label."""

    def __init__(
        self, name: str, figures: dict[str, figure], *, on_switch: Callable[[], None]
    ) -> None:
        self._figures, self._on_switch = figures, on_switch
        self.switch = RadioButtonGroup(labels=list(figures), active=0, margin=0)
        self.switch.on_change("active", self._show_active_and_notify)
        self.root_element: UIElement = column(*figures.values(), name=name, margin=0)
        self.root_element.sizing_mode = "stretch_both"
        self._show_active_figure()

    @property
    def active_label(self) -> str:
        """Label of the active figure."""
        names, index = list(self._figures), self.switch.active
        # A browser may send anything.
        return names[index] if index in range(len(names)) else names[0]

    def _show_active_and_notify(self, attr: str, old: int, new: int) -> None:
        self._show_active_figure()
        self._on_switch()

    def _show_active_figure(self) -> None:
        for label, tile_figure in self._figures.items():
            tile_figure.visible = label == self.active_label


def coloured_html(text: str, colour_role: str) -> str:
    """Return text in a colour of the theme as HTML."""
    return f"<span style='color: var(--{colour_role})'>{text}</span>"
