"""Draws docs/figures/detectors.png: thresholds of all detectors on one range profile.

python docs/figures/detectors.py
"""

from pathlib import Path

from dechirp.report.figures.detectors import beside_each_other, height_in
from dechirp.report.figures.style import png

if __name__ == "__main__":
    Path(__file__).with_suffix(".png").write_bytes(png(beside_each_other, height_in=height_in()))
