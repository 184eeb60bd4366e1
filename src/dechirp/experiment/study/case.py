"""What holds in every trial of a scenario, as its scores are told."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.impairments.white_noise import WhiteNoise
from dechirp.evaluate.look import Case
from dechirp.experiment.link import added_noise_w
from dechirp.experiment.scenario import Scenario
from dechirp.scene.truth import truth


def case_of(scenario: Scenario) -> Case:
    """Truth, radar and fitted chain of a scenario.

    Raises
    ------
    InvalidSetting
        If it is a recording: nobody knows its truth, and it has one trial only.
    """
    if scenario.scene is None or scenario.radar is None:
        raise InvalidSetting(
            "scenario.recording",
            got="a recording",
            need="a scene that can be simulated again and again",
            fix="Give a scene, or take `dechirp tune`, which takes recordings.",
        )
    noise_w = added_noise_w(scenario, scenario.radar)
    known = truth(scenario.scene, scenario.radar, n_frames=scenario.n_frames, noise_power_w=noise_w)
    is_white = all(isinstance(one, ThermalNoise | WhiteNoise) for one in scenario.impairments)
    return Case(
        scene=scenario.scene,
        radar=scenario.radar,
        chain=scenario.chain.fitted(scenario.radar),
        truth=known,
        noise_power_w=noise_w if is_white else np.nan,
        times_s=known.time.values,
    )
