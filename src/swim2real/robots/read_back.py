"""Parameters read back from the compiled model at both bounds, and the settings that undo them.

A number has arrived where that of its element changes by as much; or any, where the model has none of this name. The
mass or density of a geom is in its body: mass, moments and inertia about the body's origin must be linear in it. Which
of the model's own settings undoes a number is found by trying: the one without which it arrives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from swim2real.parameters import Parameter
from swim2real.robots.compiled import REFUSALS
from swim2real.robots.robot import Robot
from swim2real.robots.targets import Selection
from swimbase.arrays import Array
from swimbase.errors import RobotError

_FACTORS = (1.0, -1.0, np.pi / 180)  # by which a number is written: as it is, against its sign by a servo, in degrees
_EXACT, _LINEAR = 1e-9, 1e-4  # relative
_ROUNDING = 1e-12  # m and m², of a body's moments by its mass
_FAR = 1000.0  # times the way between the bounds, from the lower one: so far a geom's mass counts in proportion
_IN_BODY = ("mass", "density")  # of geoms
_MASS, _MOMENTS, _INERTIA = slice(0, 1), slice(1, 4), slice(4, 13)


def check_targets(robot: Robot) -> None:
    """Refuses a robot with a parameter that doesn't change what it says.

    Raises:
        RobotError: There is one; the message names what undoes it.
    """
    for parameter in robot.space:
        if said := undone(robot, parameter):
            raise RobotError(f"robot '{robot.name}': {said}")


def undone(robot: Robot, parameter: Parameter) -> str | None:
    """Number that the compiled model has otherwise than a parameter writes it, in a sentence with the cause; else None.

    Nothing is said of what doesn't compile, changes nothing, or is transformed without a setting of the model.
    """
    for target in robot.targets.get(parameter.name, ()):
        place = _Place(robot, parameter, target.selection)
        for number in map(int, np.flatnonzero(place.change)):
            if place.arrives(number) is not False:
                continue
            said = f"{parameter.name}: the compiled model doesn't have what it writes to {target.line}, since "
            if causes := place.causes(number):
                return f"{said}{causes}; take that out of the model"
            if place.massive and place.moves(number):
                return f"{said}the mass or inertia of the body is limited or rescaled; look for that in the model"
    return None


@dataclass(frozen=True)
class _Setting:
    """Setting other than MuJoCo's default, in one of the `_owners` of a number."""

    owner: int
    who: str
    name: str
    value: Any
    usual: Any

    def __str__(self) -> str:
        if self.name == "explicitinertial":
            return f"{self.who} has an <inertial>"
        named = (
            getattr(self.value, "name", str(self.value)).rpartition("_")[2].lower()
        )  # such as mjBIAS_AFFINE, or True
        numbers = isinstance(self.value, float | np.ndarray)
        text = " ".join(f"{number:g}" for number in np.ravel(self.value)) if numbers else named
        return f'{self.who} has {self.name}="{text}"'


class _Place:
    """The numbers to which one line writes.

    Attributes:
        massive: Whether they are masses or densities of geoms.
        change: Of each number, from one bound to the other, so that their sum is positive. Shape (N,).
    """

    def __init__(self, robot: Robot, parameter: Parameter, selection: Selection) -> None:
        self._robot, self._selection = robot, selection
        self.massive = selection.kind == "geom" and selection.attribute in _IN_BODY
        ends: list[Array] = []
        for bound in (parameter.lower, parameter.upper):
            spec = robot.build({**robot.space.published, parameter.name: bound})
            ends.append(np.array([numbers.read(index) for numbers, index in selection.numbers(spec)]))
        self._start, end = sorted(ends, key=np.nansum)
        self.change = np.nan_to_num(end - self._start)
        self._states: dict[tuple[float, int | None, tuple[str, ...]], list[Array] | None] = {}

    def arrives(self, number: int, without: Sequence[_Setting] = ()) -> bool | None:
        """True if the model has a number as written, without some settings; None if it doesn't compile."""
        shares = (0.0, 1.0, _FAR) if self.massive else (0.0, 1.0)
        states = [self._state(share, number, without) for share in shares]
        if any(state is None for state in states):
            return None
        start, end, *others = (state[number] for state in states if state is not None)
        change, written = end - start, self.change[number]
        if not self.massive:
            exact = _EXACT * max(abs(self._start[number]), abs(self._start[number] + written))
            return any(bool((np.abs(change - factor * written) <= exact).any()) for factor in _FACTORS)
        far = others[0] - start
        for part in (_MASS, _MOMENTS, _INERTIA):
            near = _LINEAR * float(np.abs(far[part]).max()) + _ROUNDING * others[0][0]
            if not np.allclose(_FAR * change[part], far[part], rtol=0, atol=near):
                return False
        if self._selection.attribute == "density":
            return bool(change[0])
        bodies = [state[-1] for state in states[0] or ()]
        in_all = sum(self.change[i] for i, body in enumerate(bodies) if body == bodies[number])
        return bool(abs(change[0] - in_all) <= _LINEAR * abs(in_all))

    def moves(self, number: int) -> bool:
        """True if a number changes anything of its element or body."""
        start, end = (self._state(share, number) for share in (0.0, 1.0))
        return start is not None and end is not None and not np.array_equal(start[number], end[number], equal_nan=True)

    def causes(self, number: int) -> str:
        """The settings without which a number arrives, or can't be at its bounds; empty where that isn't found."""
        settings = list(self._settings(number))
        if alone := [setting for setting in settings if self.arrives(number, [setting])]:
            return " or ".join(map(str, alone))
        found = [setting for setting in settings if setting.owner == 0]
        if refused := [setting for setting in found if self.arrives(number, [setting]) is None]:
            return " or ".join(map(str, refused))
        if not self.arrives(number, found):
            return ""
        for setting in tuple(found):
            fewer = [other for other in found if other is not setting]
            found = fewer if self.arrives(number, fewer) else found
        return " and ".join(map(str, found))

    def _state(self, share: float, number: int, without: Sequence[_Setting] = ()) -> list[Array] | None:
        """Values of the compiled model at each number, that far between the bounds; None if it doesn't compile."""
        key = (share, number if without else None, tuple(map(str, without)))
        if key not in self._states:
            self._states[key] = self._made(*key[:2], without)
        return self._states[key]

    def _made(self, share: float, number: int | None, without: Sequence[_Setting]) -> list[Array] | None:
        spec = self._robot.build(self._robot.space.published)
        elements = [element for _, element in self._selection.elements(spec)]
        for setting in without:
            setattr(_owners(spec, elements[number or 0])[setting.owner], setting.name, setting.usual)
        written = zip(self._selection.numbers(spec), self._start + share * self.change, strict=True)
        for (numbers, index), value in written:
            numbers.write(index, value)
        try:
            model = spec.compile()
        except REFUSALS:
            return None
        return [_in_body(model, one) if self.massive else self._row(model, one) for one in elements]

    def _row(self, model: mujoco.MjModel, element: Any) -> Array:
        """The numbers of an element, or of the option, of the attribute's name; all where there are none of it."""
        kind = self._selection.kind
        row = model.opt if kind == "option" else getattr(model, kind)(element.id)
        found = {name: np.asarray(getattr(row, name)) for name in dir(row) if not name.startswith("_")}
        for name in dir(model):
            if name.startswith(f"{kind}_") and len(array := getattr(model, name)) == getattr(model, f"n{kind}"):
                found[name.removeprefix(f"{kind}_")] = array[element.id]
        numbers = {name: np.ravel(array).astype(float) for name, array in found.items() if array.dtype.kind == "f"}
        return numbers.get(self._selection.attribute, np.concatenate(list(numbers.values())))

    def _settings(self, number: int) -> Iterator[_Setting]:
        """Settings other than MuJoCo's defaults, of the compiler, a number's element and its body."""
        spec, plain, kind = self._robot.build(self._robot.space.published), mujoco.MjSpec(), self._selection.kind
        element, body = self._selection.elements(spec)[number][1], plain.worldbody.add_body()
        add = getattr(body if hasattr(body, f"add_{kind}") else plain, f"add_{kind}", lambda: spec.option)
        carrier = f"body '{getattr(element, 'parent', body).name}'"
        names = ("the model's compiler", self._selection.label(element), carrier)
        owners = zip(names, _owners(spec, element), (plain.compiler, add(), body), strict=False)
        for owner, (who, one, other) in enumerate(owners):
            for name in dir(one):
                here: Any = None if name.startswith("_") or name in ("id", "signature") else getattr(one, name)
                if isinstance(here, int | float | np.ndarray) or hasattr(here, "__members__"):
                    there = getattr(other, name)
                    if not np.array_equal(np.asarray(here, float), np.asarray(there, float), equal_nan=True):
                        yield _Setting(owner, who, name, *(np.array(x) if np.ndim(x) else x for x in (here, there)))


def _owners(spec: mujoco.MjSpec, element: Any) -> list[Any]:
    """Owners of settings that may undo a number: the compiler, the number's element, and the body of a geom."""
    return [spec.compiler, element, *([element.parent] if isinstance(element, mujoco.MjsGeom) else [])]


def _in_body(model: mujoco.MjModel, geom: Any) -> Array:
    """Mass, moments and inertia of a geom's body about its origin, and the body's number. Shape (14,)."""
    body = int(model.geom_bodyid[geom.id] if geom.id >= 0 else geom.parent.id)
    mass, center, turn = float(model.body_mass[body]), model.body_ipos[body], np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    inertia += mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.concatenate([[mass], mass * center, inertia.ravel(), [body]])
