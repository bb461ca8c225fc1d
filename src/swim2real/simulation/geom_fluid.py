"""The fluid force of one ellipsoid geom and its derivative by velocity, and moving such derivatives about.

The formulas are those of the engine's ellipsoid fluid model (MuJoCo documentation, "Ellipsoid-based fluid model"), in
closed form: drag of blunt and slender bodies, Kutta and Magnus lift, added mass, and drag against turning.

A derivative B is kept as 36 numbers, four blocks of 3x3 one after another: torque by angular velocity (TT), torque by
linear velocity (TL), force by angular velocity (LT) and force by linear velocity (LL).
"""

# ruff: noqa: N803, N806 (matrices are capitals)

from __future__ import annotations

import math

from swim2real.simulation.fast_plan import (
    ABC,
    DRAG_BLUNT,
    DRAG_LIN,
    DRAG_SLENDER,
    INERTIA,
    LIFT,
    MAGNUS,
    MASS,
    SPIN,
    SPIN_LIN,
    Array,
    compiled,
)  # fmt: skip


@compiled
def geom_fluid(
    g: Array, density: float, floor: float,
    wx: float, wy: float, wz: float, x: float, y: float, z: float, B: Array, F: Array,
) -> None:  # fmt: skip
    """Fluid force of one geom and its derivative by velocity, in the geom's frame.

    Args:
        g: Constants of the geom. Shape (COLUMNS,).
        density: Density of the fluid [kg/m³].
        floor: Smallest denominator.
        wx: Angular velocity about x [rad/s].
        wy: Angular velocity about y [rad/s].
        wz: Angular velocity about z [rad/s].
        x: Velocity relative to the fluid along x [m/s].
        y: Velocity relative to the fluid along y [m/s].
        z: Velocity relative to the fluid along z [m/s].
        B: Derivative, written. Shape (36,).
        F: Torque [N·m] and force [N], written. Shape (6,).
    """
    a, b, c = g[ABC], g[ABC + 1], g[ABC + 2]
    xx, yy, zz = x * x, y * y, z * z
    S = xx + yy + zz
    speed = math.sqrt(S)
    N = a * xx + b * yy + c * zz
    Q = a * a * xx + b * b * yy + c * c * zz
    inv_speed = 1.0 / max(floor, speed)

    # drag: -v (linear + density |v| (slender area + (blunt - slender) projected area))
    root = math.sqrt(Q * N)
    per_n = 1.0 / N
    area = math.pi * (root * per_n if floor < N else math.sqrt(Q / floor))
    d_area = math.pi / max(floor, N * root)
    cd = g[DRAG_BLUNT]
    quad = density * (g[DRAG_SLENDER] + cd * area)
    slope = density * speed * cd * d_area
    gx = slope * a * x * (b * yy * (a - b) + c * zz * (a - c))
    gy = slope * b * y * (a * xx * (b - a) + c * zz * (b - c))
    gz = slope * c * z * (a * xx * (c - a) + b * yy * (c - b))
    k = quad * inv_speed
    diagonal = -k * S - g[DRAG_LIN]

    # lift: -coefficient sqrt(N / (Q S)) (x fx, y fy, z fz)
    fx = yy * (a - b) + zz * (a - c)
    fy = xx * (b - a) + zz * (b - c)
    fz = xx * (c - a) + yy * (c - b)
    lift = g[LIFT] * density / max(floor, root * speed)
    n_q, n_s = N / max(floor, Q), N / max(floor, S)
    ix = lift * (a * a * n_q - a + n_s)
    iy = lift * (b * b * n_q - b + n_s)
    iz = lift * (c * c * n_q - c + n_s)
    two = 2.0 * lift * N

    # added mass and magnus lift: (m v) x w + mu w x v
    m0, m1, m2 = g[MASS], g[MASS + 1], g[MASS + 2]
    mu = g[MAGNUS]
    B[27] = diagonal + x * (-k * x - gx + fx * ix * x) - lift * fx * N
    B[28] = x * (-k * y - gy + (two * (b - a) + fx * iy) * y) - wz * (mu - m1)
    B[29] = x * (-k * z - gz + (two * (c - a) + fx * iz) * z) + wy * (mu - m2)
    B[30] = y * (-k * x - gx + (two * (a - b) + fy * ix) * x) + wz * (mu - m0)
    B[31] = diagonal + y * (-k * y - gy + fy * iy * y) - lift * fy * N
    B[32] = y * (-k * z - gz + (two * (c - b) + fy * iz) * z) - wx * (mu - m2)
    B[33] = z * (-k * x - gx + (two * (a - c) + fz * ix) * x) - wy * (mu - m0)
    B[34] = z * (-k * y - gy + (two * (b - c) + fz * iy) * y) + wx * (mu - m1)
    B[35] = diagonal + z * (-k * z - gz + fz * iz * z) - lift * fz * N
    q0, q1, q2 = (m0 - mu) * x, (m1 - mu) * y, (m2 - mu) * z
    B[18], B[19], B[20] = 0.0, -q2, q1
    B[21], B[22], B[23] = q2, 0.0, -q0
    B[24], B[25], B[26] = -q1, q0, 0.0
    # torque of added mass: (m v) x v + (i w) x w
    B[9], B[10], B[11] = 0.0, z * (m1 - m2), y * (m1 - m2)
    B[12], B[13], B[14] = z * (m2 - m0), 0.0, x * (m2 - m0)
    B[15], B[16], B[17] = y * (m0 - m1), x * (m0 - m1), 0.0
    # torque of drag: -w (linear + density |s w|)
    i0, i1, i2 = g[INERTIA], g[INERTIA + 1], g[INERTIA + 2]
    s0, s1, s2 = g[SPIN], g[SPIN + 1], g[SPIN + 2]
    px, py, pz = wx * s0, wy * s1, wz * s2
    P = px * px + py * py + pz * pz
    spin = math.sqrt(P)
    r = density / max(floor, spin)
    ax, ay, az = r * px * s0, r * py * s1, r * pz * s2
    turning = -r * P - g[SPIN_LIN]
    B[0] = turning - wx * ax
    B[1] = -wx * ay + wz * (i1 - i2)
    B[2] = -wx * az + wy * (i1 - i2)
    B[3] = -wy * ax + wz * (i2 - i0)
    B[4] = turning - wy * ay
    B[5] = -wy * az + wx * (i2 - i0)
    B[6] = -wz * ax + wy * (i0 - i1)
    B[7] = -wz * ay + wx * (i0 - i1)
    B[8] = turning - wz * az

    up = g[LIFT] / math.pi * density * N / max(floor, speed * Q) * area
    drag = g[DRAG_LIN] + speed * quad
    torque = g[SPIN_LIN] + density * spin
    F[0] = -wx * torque + (i1 - i2) * wy * wz + (m1 - m2) * y * z
    F[1] = -wy * torque + (i2 - i0) * wz * wx + (m2 - m0) * z * x
    F[2] = -wz * torque + (i0 - i1) * wx * wy + (m0 - m1) * x * y
    F[3] = -x * (drag + up * fx) + q1 * wz - q2 * wy
    F[4] = -y * (drag + up * fy) + q2 * wx - q0 * wz
    F[5] = -z * (drag + up * fz) + q0 * wy - q1 * wx


@compiled
def turn(R: Array, A: Array, out: Array) -> None:
    """Adds R A R^T to out, for the 3x3 A given as 9 numbers."""
    for j in range(3):
        t0 = R[0] * A[j] + R[1] * A[3 + j] + R[2] * A[6 + j]
        t1 = R[3] * A[j] + R[4] * A[3 + j] + R[5] * A[6 + j]
        t2 = R[6] * A[j] + R[7] * A[3 + j] + R[8] * A[6 + j]
        for k in range(3):
            r = R[3 * k + j]
            out[k] += t0 * r
            out[3 + k] += t1 * r
            out[6 + k] += t2 * r


@compiled
def shift(B: Array, x: float, y: float, z: float) -> None:
    """Moves a derivative to the origin, from a point at (x, y, z)."""
    TT, TL, LT, LL = B[0:9], B[9:18], B[18:27], B[27:36]
    for i in range(3):  # LT -= LL P, with P the cross product matrix of the point
        l0, l1, l2 = LL[3 * i], LL[3 * i + 1], LL[3 * i + 2]
        LT[3 * i] -= l1 * z - l2 * y
        LT[3 * i + 1] -= l2 * x - l0 * z
        LT[3 * i + 2] -= l0 * y - l1 * x
    for j in range(3):  # TT += P LT
        l0, l1, l2 = LT[j], LT[3 + j], LT[6 + j]
        TT[j] += y * l2 - z * l1
        TT[3 + j] += z * l0 - x * l2
        TT[6 + j] += x * l1 - y * l0
    for i in range(3):  # TT -= TL P
        l0, l1, l2 = TL[3 * i], TL[3 * i + 1], TL[3 * i + 2]
        TT[3 * i] -= l1 * z - l2 * y
        TT[3 * i + 1] -= l2 * x - l0 * z
        TT[3 * i + 2] -= l0 * y - l1 * x
    for j in range(3):  # TL += P LL
        l0, l1, l2 = LL[j], LL[3 + j], LL[6 + j]
        TL[j] += y * l2 - z * l1
        TL[3 + j] += z * l0 - x * l2
        TL[6 + j] += x * l1 - y * l0
