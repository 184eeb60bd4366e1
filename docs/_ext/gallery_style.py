"""Matplotlib style of the gallery figures."""

from typing import Any

import matplotlib.pyplot as plt
from cycler import cycler

_STYLE: dict[Any, Any] = {
    "figure.figsize": (7.2, 4.0),
    "figure.constrained_layout.use": True,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": "medium",
    "axes.formatter.useoffset": False,
    "figure.titlesize": "medium",
    "grid.color": "#e9edf0",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    # Okabe and Ito's, darkened for thin lines: distinguishable for colour-blind readers.
    "axes.prop_cycle": cycler(color=["#0868ac", "#c8500a", "#00795a", "#8a4f9e", "#66727f"]),
}


def reset(gallery_conf: dict[str, Any], script: str) -> None:
    """Set the style before each script, as sphinx-gallery requires."""
    plt.rcdefaults()
    plt.rcParams.update(_STYLE)
