"""Where what reflects is drawn: on the map, and in bodies of many scatterers."""

import numpy as np

from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies, wrapped
from dechirp.scene.scene import Scene


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: coupling put back, velocities folded."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = frequencies(place, radar)
    doppler_hz = wrapped(doppler_hz, 1 / radar.frame.repetition_s)
    return Place(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def in_bodies(scene: Scene, at_most: int, among: np.ndarray | None = None) -> np.ndarray:
    """Scatterers of bodies, places in the list, so many at most, spread over all.

    `among`: whether each may be one of them, (n_scatterers,); all without it.
    """
    has_body = np.array([target.body is not None for target in scene.targets], dtype=bool)
    chosen = has_body[scene.owners]
    places = np.flatnonzero(chosen if among is None else chosen & among)
    return places[:: -(-len(places) // at_most) or 1]
