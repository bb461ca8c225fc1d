"""Motors as known before they are reached: column, id, model, direction and limits; and the file that lists them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from motorline import control_table as ct
from motorline.commands import ACCELERATION, FISH, XW540_T140, CommandTable, MotorLimits, is_speed, split_column
from motorline.control_table import MODELS, POSITION_UNIT, XW540, Model, MotorError, Register
from swimbase.errors import ArgumentError
from swimbase.parsing import from_toml
from swimbase.store import MOST_TEXT, read_bytes

_KEYS = ("id", "model", "direction", "zero", "lowest", "highest", "speed", "acceleration")
_ANGLE_KEYS = ("zero", "lowest", "highest")
_RANGE = "a motor that follows an angle needs its range"
_MIDDLE = math.pi  # rad, of a motor's turn
_LAST = 4095 * POSITION_UNIT  # rad, the end of its turn


@dataclass(frozen=True)
class MotorSettings:
    """A motor and the column of the table that it follows.

    Attributes:
        column: Name of the column: `NAME_rad_s` for the speed of the motor, `NAME_rad` for its angle.
        id: Id on the bus.
        limits: MotorLimits of the column.
        model: Model.
        direction: 1 where the motor counts as the column does, -1 where it counts the other way.
        zero: Angle of the motor at an angle of 0 in the column [rad]; 0 for a speed.
    """

    column: str
    id: int
    limits: MotorLimits
    model: Model = XW540
    direction: int = 1
    zero: float = 0.0

    def __post_init__(self) -> None:
        _check_unit(self.column)
        if not 0 <= self.id <= 252:
            raise ArgumentError(f"id is {self.id}; ids are 0 to 252")
        if self.direction not in (1, -1):
            raise ArgumentError(f"direction is {self.direction}; it must be 1 or -1")
        if is_speed(self.column):
            return
        for name, angle in (("lowest", self.limits.lowest), ("highest", self.limits.highest)):
            at = self.zero + self.direction * angle
            if not 0 <= at <= _LAST:
                raise ArgumentError(
                    f"{name} is {angle:g} rad, where the motor would be at {at:.4g} rad; its angles go from 0 to "
                    f"{_LAST:.4g} rad, one turn: change {name}, or zero (here {self.zero:.4g} rad)"
                )

    @property
    def name(self) -> str:
        """The actuator's name in the column."""
        return split_column(self.column)[0]

    @property
    def goal(self) -> Register:
        """The register that commands are written to."""
        return ct.GOAL_VELOCITY if is_speed(self.column) else ct.GOAL_POSITION

    def to_units(self, value: float) -> int:
        """A command [rad/s or rad] in the motor's units: 0.229 rev/min or 1/4096 turn, rounded."""
        return round((self.zero + self.direction * value) / self.goal.unit)

    def from_units(self, units: int) -> float:
        """The command [rad/s or rad] that the motor's units stand for."""
        return self.direction * (units * self.goal.unit - self.zero)

    def check_speed(self, table: CommandTable, limit: int, whose: str = "its own") -> None:
        """Refuses a table that is faster than a Velocity Limit (44).

        Args:
            table: Commands, with this motor's column.
            limit: Velocity Limit [0.229 rev/min].
            whose: What the message says before the limit's name.

        Raises:
            MotorError: The table asks for more.
        """
        fastest = table.speed(self.column)
        if round(fastest / ct.VELOCITY_UNIT) > limit:
            raise MotorError(
                f"the table asks {self} for {fastest:.3g} rad/s; {whose} Velocity Limit (44) is {limit}, "
                f"{limit * ct.VELOCITY_UNIT:.3g} rad/s: make the table slower, or raise the motor's limit with "
                f"Dynamixel Wizard"
            )

    def __str__(self) -> str:
        return f"motor {self.id}" if self.column == FISH else f"motor {self.name} (id {self.id})"


def fish_motor(device: int = 1, limits: MotorLimits = XW540_T140) -> MotorSettings:
    """The fish's motor."""
    return MotorSettings(FISH, device, limits)


def _check_unit(column: str) -> None:
    """Refuses a column that no motor can follow.

    Raises:
        ArgumentError: Its unit is neither rad/s nor rad.
    """
    unit = split_column(column)[1]
    if unit not in ("rad_s", "rad"):
        raise ArgumentError(
            f"the column {column} is in {unit.replace('_', '/')}; a motor takes speeds in rad/s (NAME_rad_s) and "
            f"angles in rad (NAME_rad): convert the column, or leave it out"
        )


def read_motors(path: str | Path, columns: Sequence[str]) -> tuple[MotorSettings, ...]:
    """Reads a motors file: TOML with a table a motor, which has the name of the motor's column without its unit.

    Args:
        path: The file.
        columns: Columns of the table of commands.

    Returns:
        The motors in the order of the columns.

    Raises:
        ArgumentError: The file can't be read, doesn't fit the columns or has a wrong value.
    """
    file = Path(path)
    try:
        entries = from_toml(read_bytes(file, MOST_TEXT))
    except OSError as error:
        raise ArgumentError(f"motors file '{file}' can't be read: {error.strerror or error}") from error
    except ValueError as error:
        raise ArgumentError(f"motors file '{file}' is not TOML: {error}") from error
    by_name: dict[str, str] = {}
    for column in columns:
        _check_unit(column)
        name = split_column(column)[0]
        if name in by_name:
            raise ArgumentError(
                f"the columns {by_name[name]} and {column} are of one motor; a motor follows one column"
            )
        if name not in entries:
            raise ArgumentError(f"{file.name}: the column {column} has no motor; add [{name}] with its id")
        by_name[name] = column
    if unknown := next((name for name in entries if name not in by_name), None):
        raise ArgumentError(
            f"{file.name}: motor {unknown} has no column in the table, which has {', '.join(columns)}; "
            f"remove the motor, or add {unknown}_rad or {unknown}_rad_s to the table"
        )
    motors = tuple(_motor(file.name, name, column, entries[name]) for name, column in by_name.items())
    for one, other in combinations(motors, 2):
        if one.id == other.id:
            raise ArgumentError(
                f"{file.name}: motors {one.name} and {other.name} both have id {one.id}; each needs its own "
                f"(Dynamixel Wizard sets it)"
            )
    return motors


def _motor(file: str, name: str, column: str, entry: object) -> MotorSettings:
    """The motor that an entry of the file describes."""
    where = f"{file}, motor {name}"
    if not isinstance(entry, Mapping):
        raise ArgumentError(f"{where} is {entry!r}; it must be a table, [{name}] with id and limits below it")
    values: Mapping[str, Any] = entry
    if unknown := next((key for key in values if key not in _KEYS), None):
        raise ArgumentError(f"{where}: there is no key {unknown}; known are {', '.join(_KEYS)}")
    angle = not is_speed(column)
    if wrong := next((key for key in _ANGLE_KEYS if key in values and not angle), None):
        raise ArgumentError(f"{where}: {wrong} is for an angle, and the column {column} is a speed; remove {wrong}")
    for key, why in (("id", "it is how the motor is reached"), ("lowest", _RANGE), ("highest", _RANGE)):
        if key not in values and (angle or key == "id"):
            raise ArgumentError(f"{where}: {key} is missing; {why}")
    for key, value in values.items():
        if key in ("id", "direction") and type(value) is not int:
            raise ArgumentError(f"{where}: {key} is {value!r}; it must be a whole number")
        number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if key != "model" and not number:
            raise ArgumentError(f"{where}: {key} is {value!r}; it must be a finite number")
    model = MODELS.get(str(values.get("model", XW540.name)))
    if model is None:
        raise ArgumentError(f"{where}: model is {values['model']!r}; it must be one of {', '.join(MODELS)}")
    defaults = {"speed": model.speed, "acceleration": ACCELERATION, "lowest": -math.inf, "highest": math.inf}
    try:
        limits = MotorLimits(**{key: float(values.get(key, default)) for key, default in defaults.items()})
        zero = float(values.get("zero", _MIDDLE)) if angle else 0.0
        return MotorSettings(column, values["id"], limits, model, values.get("direction", 1), zero)
    except ArgumentError as error:
        raise ArgumentError(f"{where}: {error}") from None
