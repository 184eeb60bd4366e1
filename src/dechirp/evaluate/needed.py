"""What a score needs of a case, refused where it is not there."""

from dechirp.core.errors import InvalidSetting
from dechirp.evaluate.look import Case


def must_have_targets(case: Case, label: str) -> None:
    """Raise `InvalidSetting` where the scene is empty: there is nothing to find."""
    if not case.names:
        raise InvalidSetting(
            "scores",
            got=f"{label}, in a scene without targets",
            need="at least one target for it",
            fix=f"Add a target to the scene, or leave out {label}.",
        )


def must_cluster(case: Case, label: str) -> None:
    """Raise `InvalidSetting` where the chain makes no clusters."""
    if case.chain.cluster is None:
        raise InvalidSetting(
            "scores",
            got=f"{label}, of a chain that makes no clusters",
            need="chain.cluster for it",
            fix=f"Set chain.cluster, or leave out {label}.",
        )


def must_rise(case: Case, label: str) -> None:
    """Raise `InvalidSetting` of triangles: the map of either side alone is no detection."""
    if case.radar.frame.falls:
        raise InvalidSetting(
            "scores",
            got=f"{label}, of ramps that rise and fall",
            need="ramps that all rise: the beats of both sides make one detection",
            fix=f"Take another modulation, or leave out {label}.",
        )
