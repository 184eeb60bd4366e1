"""Colours of the studio: contrast, and distance for readers without one kind of cones."""

from itertools import combinations

import numpy as np
import pytest

from dechirp.studio.theme import DARK, LIGHT

# Machado, Oliveira and Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009), severity 1.
VISION = {
    "trichromat": np.eye(3),
    "protanope": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranope": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
# sRGB to CIE XYZ, IEC 61966-2-1, with the white point D65.
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
WHITE = TO_XYZ.sum(axis=1)


def to_linear_rgb(colour: str) -> np.ndarray:
    parts = np.array([int(colour[start : start + 2], 16) for start in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def to_lab(linear_rgb: np.ndarray) -> np.ndarray:
    """Return CIELAB: a difference of 2.3 is just noticeable."""
    ratios = TO_XYZ @ np.clip(linear_rgb, 0, 1) / WHITE
    x, y, z = np.where(ratios > 216 / 24389, np.cbrt(ratios), (24389 / 27 * ratios + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def contrast(first: str, second: str) -> float:
    """Return the contrast of WCAG 2.2."""
    darker, brighter = sorted(float(TO_XYZ[1] @ to_linear_rgb(c)) for c in (first, second))
    return (brighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.shade)
@pytest.mark.parametrize("vision", VISION)
def test_marks_differ_by_ten_just_noticeable_steps(theme, vision):
    colours = {
        role: to_lab(VISION[vision] @ to_linear_rgb(getattr(theme, role)))
        for role in ("echo", "truth", "threshold", "track")
    }
    for first, second in combinations(colours, 2):
        assert np.linalg.norm(colours[first] - colours[second]) > 23, (first, second)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=lambda theme: theme.shade)
def test_text_and_edges_have_the_contrast_of_wcag(theme):
    for role in ("ink", "muted", "echo", "truth", "threshold", "track"):
        assert contrast(getattr(theme, role), theme.tile) >= 4.5, role
    for surface in (theme.tile, theme.ground):
        assert contrast(theme.ink, surface) >= 4.5 and contrast(theme.muted, surface) >= 4.5
        assert contrast(theme.edge, surface) >= 3
