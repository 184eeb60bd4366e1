"""Trial context of a scenario: the truth, radar and chain that all of its trials share."""

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.trial import TrialContext
from dechirp.experiments.link_budget import added_noise_power_w
from dechirp.experiments.scenario import Scenario
from dechirp.scene.truth import truth
from dechirp.simulation.impairments.noise import ThermalNoise, WhiteNoise


def build_trial_context(scenario: Scenario) -> TrialContext:
    """Compute the truth of a scenario and fit its chain to its radar.

    Raises
    ------
    InvalidSetting
        If the scenario is a recording: its truth is unknown, and it has one trial only.
    """
    if scenario.scene is None or scenario.radar is None:
        raise InvalidSetting(
            "scenario",
            value="a recording, or traffic",
            expected="a scene that can be simulated again and again",
            fix="give a scene, or take `dechirp tune`, which takes recordings",
        )
    noise_w = added_noise_power_w(scenario, scenario.radar)
    scene_truth = truth(
        scenario.scene, scenario.radar, n_frames=scenario.n_frames, noise_power_w=noise_w
    )
    is_white = all(
        isinstance(impairment, ThermalNoise | WhiteNoise) for impairment in scenario.impairments
    )
    return TrialContext(
        scene=scenario.scene,
        radar=scenario.radar,
        chain=scenario.chain.fit_to_radar(scenario.radar),
        truth=scene_truth,
        noise_power_w=noise_w if is_white else np.nan,
        times_s=scene_truth.time.values,
    )
