"""The fish in numbers: lengths [m], masses [kg], densities [kg/m³]; x from head to tail, z up.

Facts of the robot's hardware and of the published simulator of it (prior work [michelis2026simple]).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WATER_DENSITY = 1000.0
WATER_VISCOSITY = 0.0013  # Pa·s
ACRYLIC = 1180.0
PLA = 1250.0

ROOT_ANCHOR = (0.02456792, 0.0, 0.00080073)
MOTOR_X = 0.1655
BODY_END_X = 0.278
PLATE_HALF_LENGTH = 0.0075
JOINT_LIMIT = np.deg2rad(80.0)
TENDON_STIFFNESS = 20000.0  # N/m
TENDON_DAMPING = 10.0  # N·s/m
MOTOR_GAIN = 100.0  # N·m·s/rad
MOTOR_SPEED_LIMIT = 10 * np.pi  # rad/s


@dataclass(frozen=True)
class Segment:
    """One tail segment: gap in front, then half heights and sideways positions of its parts [m]."""

    gap: float
    front_height: float
    plate_height: float
    arm_width: float
    arm_y: float
    tendon_y: float
    rear_height: float
    marker_x: float


SEGMENTS = (
    Segment(0.014, 0.0375, 0.0500, 0.02425, 0.02575, 0.045, 0.0350, 0.0145),
    Segment(0.015, 0.0350, 0.0475, 0.01925, 0.02075, 0.035, 0.0325, 0.0150),
    Segment(0.017, 0.0325, 0.0450, 0.01425, 0.01575, 0.025, 0.0300, 0.0160),
    Segment(0.014, 0.0300, 0.0425, 0.00925, 0.01075, 0.015, 0.0275, 0.0145),
    Segment(0.006, 0.0275, 0.0400, 0.00425, 0.00575, 0.005, 0.0000, 0.0105),
)
FIN_GAP = 0.010  # behind the last segment
SEGMENT_LENGTH = 2 * PLATE_HALF_LENGTH
GAPS = (*(s.gap for s in SEGMENTS), FIN_GAP)
# each hinge sits in the middle of its gap
HINGE_X = tuple(float(BODY_END_X + sum(GAPS[:i]) + i * SEGMENT_LENGTH + GAPS[i] / 2) for i in range(len(SEGMENTS)))

# Side views (height, leading edge, trailing edge) in the frame of their body; enough points for smooth edges.
TAIL_FIN_OUTLINE = np.array(
    [
        [0.000000, 0.021554, 0.063595],
        [0.005000, 0.022406, 0.064055],
        [0.010000, 0.023340, 0.064757],
        [0.015000, 0.024359, 0.065728],
        [0.020000, 0.025464, 0.066940],
        [0.025000, 0.026657, 0.068360],
        [0.030000, 0.027941, 0.069930],
        [0.035000, 0.029331, 0.071574],
        [0.040000, 0.030824, 0.073222],
        [0.045000, 0.032419, 0.074812],
        [0.050000, 0.034144, 0.076301],
        [0.055000, 0.035987, 0.077656],
        [0.060000, 0.037981, 0.078845],
        [0.065000, 0.040128, 0.079835],
        [0.070000, 0.042456, 0.080611],
        [0.075000, 0.045000, 0.081139],
        [0.080000, 0.047809, 0.081370],
        [0.085000, 0.050950, 0.081215],
        [0.090000, 0.054578, 0.080544],
        [0.092500, 0.056665, 0.079928],
        [0.095000, 0.059016, 0.079035],
        [0.097000, 0.061201, 0.078011],
        [0.098500, 0.063141, 0.076947],
        [0.099500, 0.064677, 0.075976],
        [0.100500, 0.066630, 0.074606],
        [0.101200, 0.068723, 0.072917],
        [0.101475, 0.070853, 0.070895],
    ]
)
DORSAL_FIN_OUTLINE = np.array(
    [
        [0.040000, 0.200000, 0.260000],
        [0.042500, 0.200031, 0.260670],
        [0.045000, 0.200151, 0.261340],
        [0.047500, 0.200380, 0.262010],
        [0.050000, 0.200704, 0.262679],
        [0.052500, 0.201145, 0.263349],
        [0.055000, 0.201700, 0.264019],
        [0.057500, 0.202373, 0.264689],
        [0.060000, 0.203164, 0.265359],
        [0.062500, 0.204072, 0.266029],
        [0.065000, 0.205093, 0.266699],
        [0.067500, 0.206230, 0.267369],
        [0.070000, 0.207472, 0.268038],
        [0.072500, 0.208817, 0.268708],
        [0.075000, 0.210257, 0.269378],
        [0.077500, 0.211786, 0.270048],
        [0.080000, 0.213400, 0.270718],
        [0.082500, 0.215094, 0.271388],
        [0.085000, 0.216859, 0.272058],
        [0.087500, 0.218691, 0.272728],
        [0.090000, 0.220593, 0.273397],
        [0.092500, 0.222562, 0.274067],
        [0.095000, 0.224593, 0.274737],
        [0.097500, 0.226693, 0.275407],
        [0.100000, 0.228869, 0.276077],
        [0.102500, 0.231128, 0.276747],
        [0.105000, 0.233486, 0.277417],
        [0.107500, 0.235965, 0.278086],
        [0.110000, 0.238607, 0.278756],
        [0.112500, 0.241445, 0.279426],
        [0.115000, 0.244527, 0.280096],
        [0.117500, 0.247875, 0.280766],
        [0.120000, 0.251479, 0.281436],
        [0.122500, 0.255336, 0.282106],
        [0.125000, 0.259463, 0.282776],
        [0.127500, 0.263906, 0.283445],
        [0.130000, 0.268813, 0.284115],
        [0.132500, 0.274565, 0.284785],
        [0.135000, 0.285451, 0.285455],
    ]
)
TAIL_FIN_THICKNESS = 0.002
DORSAL_FIN_THICKNESS = 0.003


def extrude(outline: NDArray[np.float64], thickness: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A plate with a given side view.

    Args:
        outline: Height, leading x and trailing x [m]. Shape (N, 3), heights rising.
        thickness: Along y [m].

    Returns:
        Vertices, shape (4 N, 3) [m], and triangles, shape (8 N - 4, 3), a closed surface with outward normals.
    """
    z, lead, trail = outline.T
    half = np.full_like(z, thickness / 2)
    corners = [(lead, -half), (trail, -half), (trail, half), (lead, half)]  # a ring per height, seen from above
    vertices = np.stack([np.stack([x, y, z], axis=1) for x, y in corners], axis=1).reshape(-1, 3)
    rings = 4 * np.arange(len(z) - 1)[:, None]
    sides = [
        rings + np.array(triangle)
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0))
        for triangle in ([i, j, j + 4], [i, j + 4, i + 4])
    ]
    top = 4 * (len(z) - 1)
    caps = np.array([[0, 2, 1], [0, 3, 2], [top, top + 1, top + 2], [top, top + 2, top + 3]])
    return vertices, np.concatenate([*sides, caps]).astype(np.int64)


def mirrored(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """The outline with its mirror image below z = 0; its first height must be 0."""
    return np.concatenate([outline[:0:-1] * [-1, 1, 1], outline])
