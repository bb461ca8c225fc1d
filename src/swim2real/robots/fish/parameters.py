"""The fish's 16 parameters (paper, Table I) with the prior work's published values."""

from swim2real.parameters import Parameter, ParameterSpace

TAIL_SEGMENTS = 5

_FLUID = (
    (
        "blunt_drag",
        0.4,
        "Drag of every part against motion along its broad faces; "
        "more of it slows the fish and loads the beating tail.",
    ),
    (
        "slender_drag",
        7.79,
        "Drag along slender directions, skin-like: more of it slows the fish at all frequencies "
        "and damps the sway of the body.",
    ),
    (
        "angular_drag",
        2.81,
        "Resistance to rotation in water: more of it damps yaw of the head "
        "and the rotation of tail segments and motor arms.",
    ),
    (
        "kutta_lift",
        3.84,
        "Lift of plates at an angle of attack: the tail fin's thrust grows with it, and so do side forces on the body.",
    ),
    ("magnus_lift", 0.27, "Lift of parts that rotate while they translate; a smaller effect on thrust and sway."),
)


def _joint(kind: str, i: int) -> str:
    place = "at the body" if i == 0 else "at the tail fin" if i == TAIL_SEGMENTS - 1 else "along the tail"
    if kind == "stiffness":
        return (
            f"Restoring torque of tail joint {i} ({place}): stiffer bends less, moves the bending to other joints "
            "and shifts the tail's resonance to higher frequencies."
        )
    return (
        f"Torque against the bending speed of tail joint {i} ({place}): small values smooth the beat, "
        "above about 0.2 the joint is locked, most of all at high frequencies."
    )


FISH_SPACE = ParameterSpace(
    (
        *(Parameter(f"fluid_{n}", "-", 0.0, 10.0, m, v, log_offset=0.1) for n, v, m in _FLUID),
        Parameter(
            "motor_arm_length", "m", 0.01, 0.06,
            "Length of the crank arm that pulls the tendons: sets how far the tail bends, "
            "so sideways amplitude and thrust.",
            0.0395,
        ),
        *(
            Parameter(f"hinge_stiffness_{i}", "N·m/rad", 0.1, 5.0, _joint("stiffness", i), 0.65, log_offset=0.02)
            for i in range(TAIL_SEGMENTS)
        ),
        *(
            Parameter(f"hinge_damping_{i}", "N·m·s/rad", 0.0, 2.0, _joint("damping", i), 0.0, log_offset=0.002)
            for i in range(TAIL_SEGMENTS)
        ),
    )
)  # fmt: skip
