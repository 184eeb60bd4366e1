"""Figure docs/figures/detectors.png: thresholds of all detectors on one range profile.

python docs/figures/detectors.py
"""

from pathlib import Path

from dechirp.report.figures.detectors import draw_detector_comparison, figure_height_in
from dechirp.report.figures.style import render_png

if __name__ == "__main__":
    Path(__file__).with_suffix(".png").write_bytes(
        render_png(draw_detector_comparison, height_in=figure_height_in())
    )
