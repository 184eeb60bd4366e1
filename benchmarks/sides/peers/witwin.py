"""witwin-radar: detectors, Capon and MUSIC on tensors."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sides.job_types import Inputs, Timed
from sides.spectra import directions

REQUIRES = ("witwin-radar==0.4.1",)


def cell_averaging(x: Inputs) -> Timed:
    from witwin.radar.processing.detection import ca_cfar

    return build_mask_call(ca_cfar, x)


def ordered_statistic(x: Inputs) -> Timed:
    from witwin.radar.processing.detection import os_cfar

    return build_mask_call(os_cfar, x)


def build_mask_call(detector: Callable[..., Any], x: Inputs) -> Timed:
    import torch

    settings = {
        "guard_cells": tuple(x["n_guard"].tolist()),
        "training_cells": tuple(x["n_training"].tolist()),
        "pfa": float(x["false_alarm_probability"]),
    }
    maps = torch.from_numpy(x["power"])
    return lambda: np.concatenate(
        [detector(power[None], **settings).mask.numpy() for power in maps]
    )


def capon(x: Inputs) -> Timed:
    import torch
    from witwin.radar.processing.angle import mvdr_weights

    n_elements = x["snapshots"].shape[1]
    snapshots = torch.from_numpy(x["snapshots"])
    steering = torch.from_numpy(x["steering"].T.copy())
    load = float(x["load"]) * torch.eye(n_elements)

    def azimuths() -> np.ndarray:
        covariance = snapshots[:, :, None] * snapshots.conj()[:, None, :] + load
        weights = mvdr_weights(covariance, steering, diagonal_loading=0.0)
        spectra = (weights.conj() * (covariance @ weights)).sum(dim=1).real
        return directions(spectra.numpy(), x["sines"])

    return azimuths


def music(x: Inputs) -> Timed:
    import torch
    from witwin.radar.processing.angle import ArrayGeometry, music_spectrum

    n_elements = x["snapshots"].shape[1]
    array = ArrayGeometry.from_offsets(
        [(0.0, 0.0, 0.0)],
        [(float(k), 0.0, 0.0) for k in range(n_elements)],
        element_spacing_m=0.5,
        wavelength_m=1.0,
        phase_sign=1,
        device="cpu",
    )
    # witwin uses the opposite sign of the phase along the array.
    snapshots = torch.from_numpy(x["snapshots"].conj())[:, None, :, None]
    azimuth_rad = torch.arcsin(torch.from_numpy(x["sines"].astype(np.float32)))

    def azimuths() -> np.ndarray:
        spectra = music_spectrum(
            snapshots,
            array,
            elevation_rad=torch.zeros(1),
            azimuth_rad=azimuth_rad,
            num_signals=1,
            spatial_smooth=0,
        )
        return directions(abs(spectra[:, 0]).numpy(), x["sines"])

    return azimuths
