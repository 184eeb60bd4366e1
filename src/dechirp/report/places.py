"""Where what reflects is drawn: in bodies of many scatterers."""

import numpy as np

from dechirp.scene.scene import Scene


def in_bodies(scene: Scene, at_most: int, among: np.ndarray | None = None) -> np.ndarray:
    """Scatterers of bodies, places in the list, so many at most, spread over all.

    `among`: whether each may be one of them, (n_scatterers,); all without it.
    """
    has_body = np.array([target.body is not None for target in scene.targets], dtype=bool)
    chosen = has_body[scene.owners]
    places = np.flatnonzero(chosen if among is None else chosen & among)
    return places[:: -(-len(places) // at_most) or 1]
