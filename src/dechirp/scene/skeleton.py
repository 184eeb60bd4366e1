"""Skeleton of a person: joints, and fifteen segments of scatterers between them."""

from enum import IntEnum

import numpy as np

# Lengths over the height of the body: R. Drillis, R. Contini, Body segment parameters, New York
# University report 1166.03, 1966, as in D. A. Winter, Biomechanics and Motor Control of Human
# Movement, 2009, chapter 4. From the sole to the crown they add up to 1.
ANKLE, SHANK, THIGH, TRUNK, NECK_AND_HEAD = 0.039, 0.246, 0.245, 0.288, 0.182
UPPER_ARM, FOREARM, HAND, FOOT = 0.186, 0.146, 0.108, 0.152
HALF_HIPS, HALF_SHOULDERS = 0.191 / 2, 0.259 / 2
HIP_HEIGHT = ANKLE + SHANK + THIGH

HEEL_SHARE = 0.25
"""Share of the foot behind the ankle: the heel."""


class Joint(IntEnum):
    """Joints between the segments of a body, in the order of joint arrays."""

    PELVIS = 0
    NECK = 1
    CROWN = 2
    LEFT_SHOULDER = 3
    LEFT_ELBOW = 4
    LEFT_WRIST = 5
    LEFT_FINGERS = 6
    RIGHT_SHOULDER = 7
    RIGHT_ELBOW = 8
    RIGHT_WRIST = 9
    RIGHT_FINGERS = 10
    LEFT_HIP = 11
    LEFT_KNEE = 12
    LEFT_ANKLE = 13
    LEFT_HEEL = 14
    LEFT_TOE = 15
    RIGHT_HIP = 16
    RIGHT_KNEE = 17
    RIGHT_ANKLE = 18
    RIGHT_HEEL = 19
    RIGHT_TOE = 20


ARMS = slice(Joint.LEFT_SHOULDER, Joint.RIGHT_SHOULDER), slice(Joint.RIGHT_SHOULDER, Joint.LEFT_HIP)
"""Shoulder, elbow, wrist and fingers of the left arm, and of the right."""
LEGS = slice(Joint.LEFT_HIP, Joint.RIGHT_HIP), slice(Joint.RIGHT_HIP, Joint.RIGHT_TOE + 1)
"""Hip, knee, ankle, heel and toe of the left leg, and of the right."""

# From joint to joint, relative positions along the segment, and its share of the cross section:
# that of the skin, in C. C. Lund, N. C. Browder, The estimation of areas of burns, 1944. The trunk
# is halved.
_TRUNK_SEGMENTS = (
    (Joint.NECK, Joint.CROWN, (0.64,), 0.09),
    (Joint.PELVIS, Joint.NECK, (0.6, 0.9), 0.08),
    (Joint.LEFT_SHOULDER, Joint.RIGHT_SHOULDER, (0.1, 0.9), 0.08),
    (Joint.PELVIS, Joint.NECK, (0.1, 0.35), 0.08),
    (Joint.LEFT_HIP, Joint.RIGHT_HIP, (0.0, 1.0), 0.08),
)
_LIMB_SEGMENTS = (
    ("SHOULDER", "ELBOW", (0.25, 0.75), 0.04),
    ("ELBOW", "WRIST", (0.25, 0.75), 0.03),
    ("WRIST", "FINGERS", (0.5,), 0.025),
    ("HIP", "KNEE", (1 / 6, 0.5, 5 / 6), 0.095),
    ("KNEE", "ANKLE", (1 / 6, 0.5, 5 / 6), 0.07),
    ("HEEL", "TOE", (0.1, 0.4), 0.035),
)
_SEGMENTS = _TRUNK_SEGMENTS + tuple(
    (Joint[f"{side}_{start}"], Joint[f"{side}_{end}"], along, share)
    for side in ("LEFT", "RIGHT")
    for start, end, along, share in _LIMB_SEGMENTS
)

RCS_SHARES = np.concatenate(
    [np.full(len(along), share / len(along)) for _, _, along, share in _SEGMENTS]
)
"""Share of each scatterer in the cross section of the body, (n_scatterers,)."""

SEGMENT_JOINTS = np.concatenate(
    [np.full((len(along), 2), (start, end)) for start, end, along, _ in _SEGMENTS]
)
"""Joints at the ends of the segment of each scatterer, (n_scatterers, 2)."""


def scatterer_positions_on_segments_m(joints_m: np.ndarray) -> np.ndarray:
    """Return the positions of the scatterers on their segments, (n_times, n_scatterers, 3).

    `joints_m` is (n_times, n_joints, 3), in the order of `Joint`.
    """
    start_m, end_m = joints_m[:, SEGMENT_JOINTS[:, 0]], joints_m[:, SEGMENT_JOINTS[:, 1]]
    return start_m + _SEGMENT_POSITIONS[:, None] * (end_m - start_m)


_SEGMENT_POSITIONS = np.concatenate([along for _, _, along, _ in _SEGMENTS])
RCS_SHARES.flags.writeable = SEGMENT_JOINTS.flags.writeable = _SEGMENT_POSITIONS.flags.writeable = (
    False
)
