"""Poses from markers: what a camera sees of a model in a pose, and the pose whose markers are where they were seen."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from swimbase.arrays import Array, Mask


@dataclass(frozen=True)
class _View:
    """Markers and equality constraints in one pose.

    Attributes:
        markers: Positions in the plane [m]. Shape (M, 2).
        slopes: Derivatives of the markers by the joints' velocities [m/rad or 1]. Shape (M, 2, nv).
        gaps: Violation of each equality constraint [m or rad]. Shape (E,).
        gap_slopes: Derivatives of the gaps. Shape (E, nv).
    """

    markers: Array
    slopes: Array
    gaps: Array
    gap_slopes: Array


class MarkerView:
    """Looks at one model. It has a state of its own, so it is for one thread."""

    def __init__(self, model: mujoco.MjModel, count: int, plane: tuple[int, int]) -> None:
        """Takes the model's last sensors for its markers.

        Args:
            model: Compiled model; its last sensors are one `framepos` a marker.
            count: Number of markers, M.
            plane: Axes of the world that the camera sees.
        """
        self._model, self._data, self._plane = model, mujoco.MjData(model), list(plane)
        last = range(model.nsensor - count, model.nsensor)
        self._objects = [(int(model.sensor_objtype[i]), int(model.sensor_objid[i])) for i in last]

    def at(self, qpos: Array) -> _View:
        """Sees the markers in a pose. Shape (nq,)."""
        model, data = self._model, self._data
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        slopes = np.zeros((len(self._objects), 3, model.nv))
        places: list[Array] = []
        for rows, one in zip(slopes, self._objects, strict=True):
            point, body = self._place(*one)
            mujoco.mj_jac(model, data, rows, None, point, body)
            places.append(point.copy())
        gaps = slice(0, data.ne)
        return _View(
            np.array(places).reshape(-1, 3)[:, self._plane],
            slopes[:, self._plane],
            data.efc_pos[gaps].copy(),
            self._rows()[gaps],
        )

    def _rows(self) -> Array:
        """Jacobian of the constraints. Shape (nefc, nv)."""
        model, data = self._model, self._data
        rows = np.zeros((data.nefc, model.nv))
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        else:
            rows[:] = data.efc_J.reshape(rows.shape)
        return rows

    def _place(self, kind: int, index: int) -> tuple[Array, int]:
        """Position and body of an object."""
        model, data = self._model, self._data
        match mujoco.mjtObj(kind):
            case mujoco.mjtObj.mjOBJ_SITE:
                return data.site_xpos[index], int(model.site_bodyid[index])
            case mujoco.mjtObj.mjOBJ_GEOM:
                return data.geom_xpos[index], int(model.geom_bodyid[index])
            case mujoco.mjtObj.mjOBJ_BODY:
                return data.xipos[index], index
            case _:
                return data.xpos[index], index


SCALAR = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))  # joints of one coordinate
_PULL = 1e-6  # toward the model's own pose, relative to the markers' pull: for what they don't show
_GAP_WEIGHT = 10.0  # of equality constraints, relative to markers
_TIED = 1e-6  # of the largest, from which on a constraint ties joints
_ITERATIONS = 60
_STILL = 1e-7  # rad or m: a step that is no step
_STARTS = 8
_BETTER = 0.5  # of the error, for another start to be taken


@dataclass(frozen=True)
class Pose:
    """A pose and how far its markers are from those that were wanted, root mean square [m]."""

    qpos: Array
    error: float


class PoseFit:
    """Fits poses of one model to its markers; for one thread."""

    def __init__(self, model: mujoco.MjModel, count: int, plane: tuple[int, int]) -> None:
        """Takes the arguments of `MarkerView`."""
        self._model, self._view = model, MarkerView(model, count, plane)
        self._lower, self._upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self._address = np.full(model.nv, -1)  # of the only coordinate of a scalar joint's degree of freedom
        for j in range(model.njnt):
            if int(model.jnt_type[j]) in SCALAR:
                address = model.jnt_qposadr[j]
                self._address[model.jnt_dofadr[j]] = address
                if model.jnt_limited[j]:
                    self._lower[address], self._upper[address] = model.jnt_range[j]

    def pose(self, wanted: Array, known: Mask, guess: Array) -> Pose:
        """The pose from a guess on; what the markers don't show stays as in the model, within the joints' limits.

        Args:
            wanted: Where the markers are [m]. Shape (M, 2).
            known: Which of them were seen. Shape (M,).
            guess: Pose to begin with. Shape (nq,).
        """
        qpos, view = guess, self._view.at(guess)
        pull = _PULL * max(float(np.square(view.slopes[known]).sum()) / max(self._model.nv, 1), 1e-12)
        residual, slopes = self._problem(qpos, view, wanted, known, pull)
        damping = 1e-3
        for _ in range(_ITERATIONS):
            step = self._step(qpos, residual, slopes, damping)
            moved = self.moved(qpos, step)
            moved_view = self._view.at(moved)
            problem = self._problem(moved, moved_view, wanted, known, pull)
            if problem[0] @ problem[0] < residual @ residual:
                qpos, view, (residual, slopes) = moved, moved_view, problem
                damping = max(damping / 10, 1e-9)
            else:
                damping *= 10
            if np.abs(step).max(initial=0.0) < _STILL:
                break
        missed = (wanted - view.markers)[known]
        return Pose(qpos, float(np.sqrt(np.square(missed).sum(axis=1).mean())))

    def velocities(self, qpos: Array, wanted: Array, known: Mask) -> Array:
        """Joint velocities that move the markers as wanted [m/s]; 0 what they don't show. Shapes as for `pose`."""
        view = self._view.at(qpos)
        rows = np.concatenate([view.slopes[known].reshape(-1, self._model.nv), _GAP_WEIGHT * view.gap_slopes])
        target = np.concatenate([wanted[known].ravel(), np.zeros(len(view.gaps))])
        return np.asarray(np.linalg.lstsq(rows, target, rcond=np.sqrt(_PULL))[0], dtype=float)

    def motion(self, qpos: Array, qvel: Array) -> tuple[Array, Array]:
        """Markers and their velocities [m, m/s]. Each of shape (M, 2)."""
        view = self._view.at(qpos)
        return view.markers, view.slopes @ qvel

    def moved(self, qpos: Array, step: Array) -> Array:
        """The pose that is a step of the joints' velocities farther, within the joints' limits. Shape (nv,)."""
        moved = qpos.copy()
        mujoco.mj_integratePos(self._model, moved, step, 1.0)
        return np.clip(moved, self._lower, self._upper)

    def free(self, qpos: Array) -> Array:
        """Directions that equality constraints leave to the joints in a pose. Shape (nv, at most nv)."""
        slopes = self._view.at(qpos).gap_slopes
        if not len(slopes):
            return np.eye(self._model.nv)
        _, sizes, rows = np.linalg.svd(slopes)
        return rows[int((sizes > _TIED * sizes.max(initial=0.0)).sum()) :].T

    def first(self, wanted: Array, known: Mask) -> Pose:
        """The pose from the model's own on, or from one at random where that fits much better."""
        best = self.pose(wanted, known, self._model.qpos0.copy())
        rng = np.random.default_rng(0)
        spread = float(np.linalg.norm(np.ptp(wanted[known], axis=0)))
        for _ in range(_STARTS):
            if best.error < 0.01 * spread:
                break
            step = rng.uniform(-np.pi, np.pi, self._model.nv)
            other = self.pose(wanted, known, self.moved(self._model.qpos0, step))
            if other.error < _BETTER * best.error:
                best = other
        return best

    def _problem(self, qpos: Array, view: _View, wanted: Array, known: Mask, pull: float) -> tuple[Array, Array]:
        """Residual, and its slopes: misses of markers, gaps of constraints, the way from the model's pose."""
        away = np.zeros(self._model.nv)
        mujoco.mj_differentiatePos(self._model, away, 1.0, self._model.qpos0, qpos)
        missed = (view.markers - wanted)[known].ravel()
        residual = np.concatenate([missed, _GAP_WEIGHT * view.gaps, np.sqrt(pull) * away])
        slopes = (
            view.slopes[known].reshape(-1, self._model.nv), _GAP_WEIGHT * view.gap_slopes,
            np.sqrt(pull) * np.eye(self._model.nv),
        )  # fmt: skip
        return residual, np.concatenate(slopes)

    def _step(self, qpos: Array, residual: Array, slopes: Array, damping: float) -> Array:
        """Levenberg's and Marquardt's, without joints that are at a limit and would go beyond it."""
        normal, gradient = slopes.T @ slopes, slopes.T @ residual
        normal += damping * np.diag(np.diag(normal))
        scalar = np.flatnonzero(self._address >= 0)
        at = self._address[scalar]
        free = np.ones(len(gradient), dtype=bool)
        free[scalar] = ~(
            ((qpos[at] <= self._lower[at]) & (gradient[scalar] > 0))
            | ((qpos[at] >= self._upper[at]) & (gradient[scalar] < 0))
        )
        step = np.zeros(len(gradient))
        step[free] = -np.linalg.solve(normal[np.ix_(free, free)], gradient[free])
        return step
