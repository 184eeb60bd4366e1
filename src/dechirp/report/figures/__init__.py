"""Figures: functions that draw on matplotlib axes and return them, one module per subject.

Functions with the argument `axes` draw on the axes of any figure. Data colours are those of the
package; fonts and frames follow the rcParams of the caller. Functions with the argument `figure`
fill a `Figure` or `SubFigure` with panels. The label of the axes, `axes.get_label()`, is the
alternative text of the figure. Legends lie above the axes and need `layout="constrained"`; a title
is set with
`figure.suptitle`.

`style` renders figures to SVG and PNG for pages; `common` and `top_view` hold shared elements.
"""
