"""Folds: groups of widgets below a heading that opens and closes them."""

from bokeh.models import Column, Toggle, UIElement


class Fold:
    """Heading with a body that it shows or hides."""

    def __init__(self, title: str, *, is_open: bool = False) -> None:
        self._title = title
        self._heading = Toggle(
            active=is_open, sizing_mode="stretch_width", margin=(4, 0, 2, 0), css_classes=["fold"]
        )
        self._body = Column(sizing_mode="stretch_width", spacing=0, visible=is_open)
        self._heading.on_change("active", lambda attr, old, new: self._show_or_hide(bool(new)))
        self.root_element = Column(
            children=[self._heading, self._body], sizing_mode="stretch_width", spacing=0
        )
        self._label()

    def set_title(self, title: str) -> None:
        """Set the heading."""
        if title != self._title:
            self._title = title
            self._label()

    def set_children(self, children: list[UIElement]) -> None:
        """Replace the widgets of the body."""
        if self._body.children != children:
            self._body.children = children

    def open(self) -> None:
        """Show the body."""
        self._heading.active = True

    def _show_or_hide(self, is_open: bool) -> None:
        self._body.visible = is_open
        self._label()

    def _label(self) -> None:
        self._heading.label = f"{'▾' if self._heading.active else '▸'} {self._title}"
