"""Which targets a trial found, and by which detections."""

import numpy as np

from dechirp.evaluate.look import Case, Look


def is_found(look: Look, case: Case) -> np.ndarray:
    """Whether each target has a detection in each frame, bool (n_targets, n_frames)."""
    target = look.match.target
    own = target >= 0
    found = np.zeros((len(case.names), len(case.times_s)), dtype=bool)
    found[target[own], _frames(look, case)[own]] = True
    return found


def strongest(look: Look, case: Case) -> np.ndarray:
    """The detection of each target in each frame that it is found in: places in the columns.

    The strongest one, as what follows a detector takes it. The nearest to the truth would
    flatter, since no radar knows which that is; the mean of all would count noise that happens
    to be near.
    """
    target, frame = look.match.target, _frames(look, case)
    # By target, then by frame, the strongest first; sources of one detection keep their order.
    order = np.lexsort((-np.asarray(look.detections["snr"]), frame, target))
    order = order[target[order] >= 0]
    which = target[order] * len(case.times_s) + frame[order]
    is_first = np.diff(which, prepend=-1) != 0
    return np.asarray(order[is_first])


def _frames(look: Look, case: Case) -> np.ndarray:
    """Place of the frame of each detection in the truth."""
    return np.searchsorted(case.truth["frame"].values, look.detections["frame"])
