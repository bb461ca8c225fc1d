"""The fluid's forces, and what the velocities do to them, as the matrix that the engine's implicit integrators need.

In those integrators almost all time goes into the velocity derivative of the fluid forces: the engine forms a product
over all degrees of freedom for every geom. Here the 6x6 derivatives of the geoms are summed per body, then from the
leaves of the kinematic tree to its root, all about the tree's center of mass, where the engine's spatial velocities
and motion axes are given, too. Each pair of degrees of freedom, one above the other in the tree, then needs one
product. Integrator `implicit` also has the derivative of the bias forces, which goes the same way.

The formulas are those of the engine's two fluid models (MuJoCo documentation, "Fluid forces"), in closed form. The
ellipsoid model has drag of blunt and slender bodies, Kutta and Magnus lift, added mass, and drag against turning. A
body without an ellipsoid has drag on the box that has its mass and inertia.

A derivative B is kept as 36 numbers, four blocks of 3x3 one after another: torque by angular velocity (TT), torque by
linear velocity (TL), force by angular velocity (LT) and force by linear velocity (LL).
"""

# ruff: noqa: N803, N806 (matrices are capitals)

from __future__ import annotations

import math
from typing import NamedTuple

from fluidstep.engine import Array, EngineState, borrowing
from fluidstep.plan import (
    ABC,
    BOX,
    DRAG,
    DRAG_BLUNT,
    DRAG_LIN,
    DRAG_SLENDER,
    INERTIA,
    LIFT,
    MAGNUS,
    MASS,
    POS,
    ROT,
    SPIN,
    SPIN_LIN,
    TURNED,
    Plan,
    Water,
)


class Scratch(NamedTuple):
    """Room to work in.

    Attributes:
        B: Derivative of the forces by velocity of each body, then of each subtree. Shape (bodies, 36).
        W: Torque and force of the fluid, likewise. Shape (bodies, 6).
        inertia: Spatial inertias of the subtrees, as the engine's `cinert`. Shape (bodies, 10).
        change: What a velocity adds to the accelerations below it. Shape (nv, 6).
        A: Mass matrix minus timestep times derivative. Shape (nv, nv).
        derivatives: Of a geom, of a body's sum, and turned. Shape (3, 36).
        wrenches: Of a geom and of a body's sum, then two momenta. Shape (4, 6).
        vectors: Over degrees of freedom. Shape (2, nv).
    """

    B: Array
    W: Array
    inertia: Array
    change: Array
    A: Array
    derivatives: Array
    wrenches: Array
    vectors: Array


@borrowing
def add_fluid(plan: Plan, water: Water, state: EngineState, scratch: Scratch) -> None:
    """Adds the fluid's forces to the passive ones, and writes -timestep times its derivative to A, and the bias's."""
    scratch.A[:] = 0.0
    _sum_bodies(plan, water, state, scratch)
    _sum_subtrees(plan, state, scratch)
    _project(plan, state, scratch)


@borrowing
def _sum_bodies(plan: Plan, water: Water, state: EngineState, scratch: Scratch) -> None:
    """Derivative and force of each body's geoms, about the center of mass of its tree."""
    B, W = scratch.B, scratch.W
    local, sum_B, turned = scratch.derivatives[0], scratch.derivatives[1], scratch.derivatives[2]
    F, sum_W = scratch.wrenches[0], scratch.wrenches[1]
    B[:] = 0.0
    W[:] = 0.0
    for body in range(1, len(plan.body_first)):
        first, last = plan.body_first[body], plan.body_last[body]
        if first == last:
            continue
        R = state.xmat[body]
        com = state.subtree_com[plan.body_root[body]]
        rx, ry, rz = state.xpos[body, 0] - com[0], state.xpos[body, 1] - com[1], state.xpos[body, 2] - com[2]
        cvel = state.cvel[body]
        w0, w1, w2 = cvel[0], cvel[1], cvel[2]
        v0 = cvel[3] + w1 * rz - w2 * ry - water.wind[0]
        v1 = cvel[4] + w2 * rx - w0 * rz - water.wind[1]
        v2 = cvel[5] + w0 * ry - w1 * rx - water.wind[2]
        bw0 = R[0] * w0 + R[3] * w1 + R[6] * w2
        bw1 = R[1] * w0 + R[4] * w1 + R[7] * w2
        bw2 = R[2] * w0 + R[5] * w1 + R[8] * w2
        bv0 = R[0] * v0 + R[3] * v1 + R[6] * v2
        bv1 = R[1] * v0 + R[4] * v1 + R[7] * v2
        bv2 = R[2] * v0 + R[5] * v1 + R[8] * v2
        sum_B[:] = 0.0
        sum_W[:] = 0.0
        for geom in range(first, last):
            g = water.geoms[geom]
            x, y, z = g[POS], g[POS + 1], g[POS + 2]
            u0 = bv0 + bw1 * z - bw2 * y
            u1 = bv1 + bw2 * x - bw0 * z
            u2 = bv2 + bw0 * y - bw1 * x
            if g[TURNED] == 0.0:
                _geom_fluid(g, water.density, plan.floor, bw0, bw1, bw2, u0, u1, u2, local, F)
            else:
                Q = g[ROT : ROT + 9]
                _geom_fluid(
                    g, water.density, plan.floor,
                    Q[0] * bw0 + Q[3] * bw1 + Q[6] * bw2,
                    Q[1] * bw0 + Q[4] * bw1 + Q[7] * bw2,
                    Q[2] * bw0 + Q[5] * bw1 + Q[8] * bw2,
                    Q[0] * u0 + Q[3] * u1 + Q[6] * u2,
                    Q[1] * u0 + Q[4] * u1 + Q[7] * u2,
                    Q[2] * u0 + Q[5] * u1 + Q[8] * u2,
                    local, F,
                )  # fmt: skip
                turned[:] = 0.0
                for k in range(4):
                    _turn(Q, local[9 * k : 9 * k + 9], turned[9 * k : 9 * k + 9])
                for k in range(36):
                    local[k] = turned[k]
                t0, t1, t2, f0, f1, f2 = F[0], F[1], F[2], F[3], F[4], F[5]
                for k in range(3):
                    F[k] = Q[3 * k] * t0 + Q[3 * k + 1] * t1 + Q[3 * k + 2] * t2
                    F[3 + k] = Q[3 * k] * f0 + Q[3 * k + 1] * f1 + Q[3 * k + 2] * f2
            _shift(local, x, y, z)
            for k in range(36):
                sum_B[k] += local[k]
            sum_W[0] += F[0] + y * F[5] - z * F[4]
            sum_W[1] += F[1] + z * F[3] - x * F[5]
            sum_W[2] += F[2] + x * F[4] - y * F[3]
            for k in range(3, 6):
                sum_W[k] += F[k]
        out = B[body]
        for k in range(4):
            _turn(R, sum_B[9 * k : 9 * k + 9], out[9 * k : 9 * k + 9])
        _shift(out, rx, ry, rz)
        wrench = W[body]
        for k in range(3):
            wrench[k] = R[3 * k] * sum_W[0] + R[3 * k + 1] * sum_W[1] + R[3 * k + 2] * sum_W[2]
            wrench[3 + k] = R[3 * k] * sum_W[3] + R[3 * k + 1] * sum_W[4] + R[3 * k + 2] * sum_W[5]
        wrench[0] += ry * wrench[5] - rz * wrench[4]
        wrench[1] += rz * wrench[3] - rx * wrench[5]
        wrench[2] += rx * wrench[4] - ry * wrench[3]


@borrowing
def _sum_subtrees(plan: Plan, state: EngineState, scratch: Scratch) -> None:
    """Adds the bodies' bias, sums from the leaves to the root, and takes the symmetric part where that is asked."""
    B, W, inertia = scratch.B, scratch.W, scratch.inertia
    bodies = len(plan.body_first)
    if not plan.symmetric:
        for body in range(1, bodies):
            _add_bias(state.cinert[body], state.cvel[body], B[body])
            for k in range(10):
                inertia[body, k] = state.cinert[body, k]
    for body in range(bodies - 1, 0, -1):
        parent = plan.body_parent[body]
        if parent > 0:
            for k in range(36):
                B[parent, k] += B[body, k]
            if not plan.symmetric:
                for k in range(10):
                    inertia[parent, k] += inertia[body, k]
            for k in range(6):
                W[parent, k] += W[body, k]
    if plan.symmetric:
        for body in range(1, bodies):
            out = B[body]
            for i in range(3):
                for j in range(3):
                    for block, mirror in ((0, 0), (27, 27), (9, 18)):
                        mean = 0.5 * (out[block + 3 * i + j] + out[mirror + 3 * j + i])
                        out[block + 3 * i + j] = mean
                        out[mirror + 3 * j + i] = mean


@borrowing
def _project(plan: Plan, state: EngineState, scratch: Scratch) -> None:
    """Onto the degrees of freedom: forces, and A between each and those above it in the tree."""
    B, W, inertia, change, A = scratch.B, scratch.W, scratch.inertia, scratch.change, scratch.A
    h = plan.timestep
    full = not plan.symmetric
    pull, push = scratch.wrenches[2], scratch.wrenches[3]
    for dof in range(len(plan.dof_body)):
        body = plan.dof_body[dof]
        b, c = B[body], state.cdof[dof]
        c0, c1, c2, c3, c4, c5 = c[0], c[1], c[2], c[3], c[4], c[5]
        # B c, for what this velocity does to the forces above, and B^T c, for what those above do to its force
        r0 = b[0] * c0 + b[1] * c1 + b[2] * c2 + b[9] * c3 + b[10] * c4 + b[11] * c5
        r1 = b[3] * c0 + b[4] * c1 + b[5] * c2 + b[12] * c3 + b[13] * c4 + b[14] * c5
        r2 = b[6] * c0 + b[7] * c1 + b[8] * c2 + b[15] * c3 + b[16] * c4 + b[17] * c5
        r3 = b[18] * c0 + b[19] * c1 + b[20] * c2 + b[27] * c3 + b[28] * c4 + b[29] * c5
        r4 = b[21] * c0 + b[22] * c1 + b[23] * c2 + b[30] * c3 + b[31] * c4 + b[32] * c5
        r5 = b[24] * c0 + b[25] * c1 + b[26] * c2 + b[33] * c3 + b[34] * c4 + b[35] * c5
        l0 = b[0] * c0 + b[3] * c1 + b[6] * c2 + b[18] * c3 + b[21] * c4 + b[24] * c5
        l1 = b[1] * c0 + b[4] * c1 + b[7] * c2 + b[19] * c3 + b[22] * c4 + b[25] * c5
        l2 = b[2] * c0 + b[5] * c1 + b[8] * c2 + b[20] * c3 + b[23] * c4 + b[26] * c5
        l3 = b[9] * c0 + b[12] * c1 + b[15] * c2 + b[27] * c3 + b[30] * c4 + b[33] * c5
        l4 = b[10] * c0 + b[13] * c1 + b[16] * c2 + b[28] * c3 + b[31] * c4 + b[34] * c5
        l5 = b[11] * c0 + b[14] * c1 + b[17] * c2 + b[29] * c3 + b[32] * c4 + b[35] * c5
        if full:  # the rest of the bias: inertia times the change of the accelerations
            _change(plan, state, dof, change[dof])
            _momentum(inertia[body], c, pull)
            _momentum(inertia[body], change[dof], push)
            r0 -= push[0]
            r1 -= push[1]
            r2 -= push[2]
            r3 -= push[3]
            r4 -= push[4]
            r5 -= push[5]
        w = W[body]
        force = c0 * w[0] + c1 * w[1] + c2 * w[2] + c3 * w[3] + c4 * w[4] + c5 * w[5]
        state.qfrc_fluid[dof] += force
        state.qfrc_passive[dof] += force
        A[dof, dof] -= h * (c0 * r0 + c1 * r1 + c2 * r2 + c3 * r3 + c4 * r4 + c5 * r5)
        other = plan.dof_parent[dof]
        while other >= 0:
            o = state.cdof[other]
            up = o[0] * r0 + o[1] * r1 + o[2] * r2 + o[3] * r3 + o[4] * r4 + o[5] * r5
            down = o[0] * l0 + o[1] * l1 + o[2] * l2 + o[3] * l3 + o[4] * l4 + o[5] * l5
            if full:
                e = change[other]
                down -= e[0] * pull[0] + e[1] * pull[1] + e[2] * pull[2]
                down -= e[3] * pull[3] + e[4] * pull[4] + e[5] * pull[5]
            A[other, dof] -= h * up
            A[dof, other] -= h * down
            other = plan.dof_parent[other]


@borrowing
def _add_bias(i: Array, v: Array, B: Array) -> None:
    """B -= derivative by velocity of a body's bias force, V x* (I V), minus I (V x .); about the tree's center."""
    h0, h1, h2, m = i[6], i[7], i[8], i[9]
    w0, w1, w2, v0, v1, v2 = v[0], v[1], v[2], v[3], v[4], v[5]
    L0 = i[0] * w0 + i[3] * w1 + i[4] * w2 + h1 * v2 - h2 * v1
    L1 = i[3] * w0 + i[1] * w1 + i[5] * w2 + h2 * v0 - h0 * v2
    L2 = i[4] * w0 + i[5] * w1 + i[2] * w2 + h0 * v1 - h1 * v0
    p0 = 2.0 * (m * v0 - h1 * w2 + h2 * w1)
    p1 = 2.0 * (m * v1 - h2 * w0 + h0 * w2)
    p2 = 2.0 * (m * v2 - h0 * w1 + h1 * w0)
    B[19] -= p2
    B[20] += p1
    B[21] += p2
    B[23] -= p0
    B[24] -= p1
    B[25] += p0
    s01 = w1 * i[5] - w2 * i[1]
    s02 = w1 * i[2] - w2 * i[5]
    s10 = w2 * i[0] - w0 * i[4]
    s12 = w2 * i[4] - w0 * i[2]
    s20 = w0 * i[3] - w1 * i[0]
    s21 = w0 * i[1] - w1 * i[3]
    d = 2.0 * (h0 * v0 + h1 * v1 + h2 * v2)
    B[0] -= 2.0 * (w1 * i[4] - w2 * i[3] - h0 * v0) + d
    B[4] -= 2.0 * (w2 * i[3] - w0 * i[5] - h1 * v1) + d
    B[8] -= 2.0 * (w0 * i[5] - w1 * i[4] - h2 * v2) + d
    t = s01 + s10 - h0 * v1 - h1 * v0
    B[1] -= t + L2
    B[3] -= t - L2
    t = s02 + s20 - h0 * v2 - h2 * v0
    B[2] -= t - L1
    B[6] -= t + L1
    t = s12 + s21 - h1 * v2 - h2 * v1
    B[5] -= t + L0
    B[7] -= t - L0


@borrowing
def _momentum(i: Array, v: Array, out: Array) -> None:
    """Writes I v to out, for the 10 numbers of a spatial inertia."""
    h0, h1, h2 = i[6], i[7], i[8]
    out[0] = i[0] * v[0] + i[3] * v[1] + i[4] * v[2] + h1 * v[5] - h2 * v[4]
    out[1] = i[3] * v[0] + i[1] * v[1] + i[5] * v[2] + h2 * v[3] - h0 * v[5]
    out[2] = i[4] * v[0] + i[5] * v[1] + i[2] * v[2] + h0 * v[4] - h1 * v[3]
    out[3] = i[9] * v[3] - h1 * v[2] + h2 * v[1]
    out[4] = i[9] * v[4] - h2 * v[0] + h0 * v[2]
    out[5] = i[9] * v[5] - h0 * v[1] + h1 * v[0]


@borrowing
def _change(plan: Plan, state: EngineState, dof: int, out: Array) -> None:
    """Change of the accelerations with a velocity beyond it, but for the part that grows with their velocity."""
    dot = state.cdof_dot[dof]
    if plan.dof_last[dof] < 0:  # hinges and slides
        for k in range(6):
            out[k] = 2.0 * dot[k]
        return
    parent = plan.body_parent[plan.dof_body[dof]]
    w0, w1, w2 = state.cvel[parent, 0], state.cvel[parent, 1], state.cvel[parent, 2]
    v0, v1, v2 = state.cvel[parent, 3], state.cvel[parent, 4], state.cvel[parent, 5]
    for k in range(plan.body_dof[plan.dof_body[dof]], plan.dof_last[dof] + 1):
        q, c = state.qvel[k], state.cdof[k]
        w0 += q * c[0]
        w1 += q * c[1]
        w2 += q * c[2]
        v0 += q * c[3]
        v1 += q * c[4]
        v2 += q * c[5]
    c = state.cdof[dof]
    out[0] = dot[0] + w1 * c[2] - w2 * c[1]
    out[1] = dot[1] + w2 * c[0] - w0 * c[2]
    out[2] = dot[2] + w0 * c[1] - w1 * c[0]
    out[3] = dot[3] + w1 * c[5] - w2 * c[4] + v1 * c[2] - v2 * c[1]
    out[4] = dot[4] + w2 * c[3] - w0 * c[5] + v2 * c[0] - v0 * c[2]
    out[5] = dot[5] + w0 * c[4] - w1 * c[3] + v0 * c[1] - v1 * c[0]


@borrowing
def _geom_fluid(
    g: Array, density: float, floor: float,
    wx: float, wy: float, wz: float, x: float, y: float, z: float, B: Array, F: Array,
) -> None:  # fmt: skip
    """Fluid force of one geom or inertia box and its derivative by velocity, in its own frame.

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
    if g[BOX] != 0.0:
        _box_fluid(g, (wx, wy, wz), (x, y, z), B, F)
        return
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


@borrowing
def _box_fluid(g: Array, w: tuple[float, float, float], v: tuple[float, float, float], B: Array, F: Array) -> None:
    """The same of an inertia box: drag along and about each of its axes."""
    B[:] = 0.0
    for k in range(3):
        torque, force = g[SPIN + k] * abs(w[k]), g[DRAG + k] * abs(v[k])
        B[4 * k] = -g[SPIN_LIN] - 2.0 * torque
        B[27 + 4 * k] = -g[DRAG_LIN] - 2.0 * force
        F[k] = -(g[SPIN_LIN] + torque) * w[k]
        F[3 + k] = -(g[DRAG_LIN] + force) * v[k]


@borrowing
def _turn(R: Array, A: Array, out: Array) -> None:
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


@borrowing
def _shift(B: Array, x: float, y: float, z: float) -> None:
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
