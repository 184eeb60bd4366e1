"""Figures, a file a subject: functions that draw on matplotlib axes and return them.

What takes `axes` draws on those of any figure, under the settings of its owner: colours of data
are the package's, letters and frames the owner's. What takes `figure` fills a `Figure` or
`SubFigure` with panels. The label of the axes, `axes.get_label()`, tells those who cannot see
what is there. Legends stand above the axes: `layout="constrained"` gives them room, and a title
goes above all, as `figure.suptitle`.

`style` makes SVG and PNG of them for pages; `parts` and `ground` hold what figures share.
"""
