"""Preconditions of scores."""

from dechirp.core.errors import InvalidSetting
from dechirp.evaluation.trial import TrialContext


def check_scene_has_targets(context: TrialContext, score_label: str) -> None:
    """Raise `InvalidSetting` if the scene has no targets."""
    if not context.target_names:
        raise InvalidSetting(
            "scores",
            value=f"{score_label}, in a scene without targets",
            expected="at least one target",
            fix=f"add a target to the scene, or leave out {score_label}",
        )


def check_chain_computes_clusters(context: TrialContext, score_label: str) -> None:
    """Raise `InvalidSetting` if the chain computes no clusters."""
    if context.chain.cluster is None:
        raise InvalidSetting(
            "scores",
            value=f"{score_label}, with a chain without clusters",
            expected="a chain with chain.cluster",
            fix=f"set chain.cluster, or leave out {score_label}",
        )


def check_no_triangular_ramps(context: TrialContext, score_label: str) -> None:
    """Raise `InvalidSetting` for triangles, whose detections need the maps of both ramps."""
    if context.radar.frame.has_falling_ramps:
        raise InvalidSetting(
            "scores",
            value=f"{score_label}, with rising and falling ramps",
            expected="rising ramps only, since a triangle needs both ramps for a detection",
            fix=f"use another modulation, or leave out {score_label}",
        )
