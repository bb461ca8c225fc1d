"""The whole job: checks a table of commands and its motors, prepares it, and sends it or prints what would be sent."""

from __future__ import annotations

import json
import math
import signal
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TextIO

from motorline.commands import FISH, RATE, XW540_T140, CommandTable, MotorLimits, is_speed, read_table
from motorline.control_table import MotorError
from motorline.motors import APPROACH, Identity, Motors
from motorline.motors_file import MotorSettings, fish_motor, read_motors
from motorline.schedule import ON_TIME, real_time_priority
from motorline.sending import SendingResult, check_time, open_log, send
from swimbase.errors import ArgumentError
from swimbase.escaping import visible

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # SIGHUP: the connection to the robot is lost


@dataclass(frozen=True)
class DeployOptions:
    """Options of a deployment: the table, and the way it is sent.

    Attributes:
        motors: Motors file: id and limits of each column's motor. Without it, one XW540-T140-R follows velocity_rad_s.
        port: Serial port of the U2D2, such as /dev/ttyUSB0.
        id: Id of the single motor; by default 1.
        baud: The motors' baud rate; by default 57600, as they are sold.
        dry_run: Print what would be sent and when, as CSV, instead of sending it; needs no motor.
        log: CSV file to write: what was sent and read, with times.
        repeat: Number of times to send the table.
        ramp: Acceleration of the ramps from and to rest [rad/s²]; they add rows only where the table doesn't rest.
        approach: Speed from the present angles to those of the first row [rad/s].
        max_speed: Refuse faster commands of the single motor [rad/s]; by default 7.29, its limit as sold.
        max_acceleration: Refuse steeper changes between two commands of the single motor [rad/s²]; by default 100.
        clip: Limit commands instead of refusing them.
        json: Print the result as JSON.
        quiet: Print nothing but errors.
    """

    motors: Path | None = None
    port: str | None = None
    id: int | None = None
    baud: int = 57600
    dry_run: bool = False
    log: Path | None = None
    repeat: int = 1
    ramp: float = 20.0
    approach: float = APPROACH
    max_speed: float | None = None
    max_acceleration: float | None = None
    clip: bool = False
    json: bool = False
    quiet: bool = False


def deploy(commands: Path, /, options: DeployOptions) -> int:
    """Send commands to motors at 50 Hz: to the fish's, or to several Dynamixel X motors on one bus.

    Reads a table with a column per actuator (time_s,velocity_rad_s for the fish) and 50 rows per second from 0 s on;
    writes a log. Checks table and motors first, ramps speeds from and to rest, moves to the first angles slowly, and
    doesn't ask for confirmation: the motors turn at once. Ctrl-C, an error or the end of the program stop the motors;
    if the program dies, their watchdogs do after 0.2 s. Exits with 1 if not all commands were sent.

    Args:
        commands: Table of commands.
        options: What is sent, and how.
    """
    if (options.port is None) == (not options.dry_run):
        raise ArgumentError("give either --port (as /dev/ttyUSB0) or --dry-run")
    if options.dry_run and options.log:
        raise ArgumentError(f"--log is {options.log}, and a dry run sends nothing to log; redirect its output instead")
    if options.repeat < 1:
        raise ArgumentError(f"--repeat is {options.repeat}; it must be 1 or above")
    if not (math.isfinite(options.approach) and options.approach > 0):
        raise ArgumentError(f"--approach is {options.approach:g}; it must be finite and above 0, in rad/s")
    table = read_table(commands)
    settings = _settings(commands, options, table)
    table, notes = _prepare(options, table, settings)
    for note in (f"{commands}: {_length(table)} at 50 Hz{_extent(table, settings)}", *notes):
        _say(options, note)
    if options.port is None:
        _print_plan(options, table, settings)
    else:
        _send(options, options.port, table, settings)
    return 0


def _say(options: DeployOptions, text: str) -> None:
    """Prints a sentence for people; in a dry run beside the table."""
    if not (options.quiet or options.json):
        _write(text, sys.stderr if options.dry_run else sys.stdout)


def _write(text: str, file: TextIO | None = None) -> None:
    (file or sys.stdout).write(visible(text) + "\n")


def _settings(commands: Path, options: DeployOptions, table: CommandTable) -> tuple[MotorSettings, ...]:
    """The motors, in the order of the table's columns."""
    if options.motors is not None:
        for name in ("id", "max-speed", "max-acceleration"):
            if (value := getattr(options, name.replace("-", "_"))) is not None:
                raise ArgumentError(f"--{name} is {value:g}, and --motors is given, whose file says it for each motor")
        motors = read_motors(options.motors, table.columns)
    elif table.columns == (FISH,):
        limits = MotorLimits(
            XW540_T140.speed if options.max_speed is None else options.max_speed,
            XW540_T140.acceleration if options.max_acceleration is None else options.max_acceleration,
        )
        motors = (fish_motor(1 if options.id is None else options.id, limits),)
    else:
        raise ArgumentError(
            f"{commands} has the columns {', '.join(table.columns)}; without --motors only {FISH} can be sent: "
            f"write a motors file and give it as --motors"
        )
    check_time(motors, options.baud)
    return motors


def _prepare(
    options: DeployOptions, table: CommandTable, motors: Sequence[MotorSettings]
) -> tuple[CommandTable, list[str]]:
    """The table as it will be sent, and notes on what was changed in it."""
    notes: list[str] = []
    limits = {motor.column: motor.limits for motor in motors}
    table = CommandTable(table.columns, table.rows * options.repeat)
    if options.clip:
        clipped = table.clipped(limits)
        changed = sum(before != after for before, after in zip(table.rows, clipped.rows, strict=True))
        notes.append(f"Clipping changed {changed} commands")
        table = clipped
    table.within(limits)
    ramped = table.ramped(min(options.ramp, *(limit.acceleration for limit in limits.values())))
    if added := len(ramped.rows) - len(table.rows):
        notes.append(f"Ramps from and to rest added {added} commands, {added / RATE:.2f} s")
    return ramped.within(limits), notes


def _length(table: CommandTable) -> str:
    return f"{len(table.rows)} commands, {table.duration:.2f} s"


def _extent(table: CommandTable, motors: Sequence[MotorSettings]) -> str:
    """Range of each motor's commands in the table, beside its limits."""
    lines: list[str] = []
    for motor in motors:
        column, limits = motor.column, motor.limits
        speed = f"fastest {table.speed(column):.2f} rad/s (limit {limits.speed:.2f})"
        if is_speed(column):
            steepest = f"steepest {table.acceleration(column):.1f} rad/s² (limit {limits.acceleration:.0f})"
            lines.append(f"{speed}, {steepest}")
        else:
            angles = f"{min(table.column(column)):.2f} to {max(table.column(column)):.2f} rad"
            lines.append(f"{angles} (limits {limits.lowest:.2f} to {limits.highest:.2f}), {speed}")
    if len(motors) == 1:
        return f"; {lines[0]}"
    return "".join(f"\n{motor.column}: {line}" for motor, line in zip(motors, lines, strict=True))


def _print_plan(options: DeployOptions, table: CommandTable, motors: Sequence[MotorSettings]) -> None:
    """Prints the registers that would be written and when, with the values on the bus."""
    for motor in motors:
        motor.check_speed(table, motor.model.velocity_limit, "as sold, its")
    writes: list[dict[str, object]] = [
        {"time_s": k / RATE, "id": motor.id, "register": str(motor.goal), "value": motor.to_units(value)}
        for k, row in enumerate(table.rows)
        for motor, value in zip(motors, row, strict=True)
    ]
    if options.json:
        _write(json.dumps({"commands": len(table.rows), "seconds": table.duration, "writes": writes}, indent=2))
    elif not options.quiet:
        _write("\n".join(",".join(map(str, cells)) for cells in (writes[0], *(write.values() for write in writes))))
    joints = ", ".join(motor.name for motor in motors if not is_speed(motor.column))
    way = f", after the way of {joints} from the present to the first angles, at {options.approach:g} rad/s at most"
    _say(options, f"Nothing was sent: it would be {_length(table)}, {len(writes)} values{way if joints else ''}")


def _send(options: DeployOptions, port: str, table: CommandTable, settings: Sequence[MotorSettings]) -> None:
    """Sends the table, and prints what the motors are and how it went.

    Raises:
        MotorError: A motor failed, or a signal ended it.
    """
    from motorline.bus import Bus  # which brings the motors' library

    with (
        _noted_signals() as signals, open_log(options.log, settings) if options.log else nullcontext() as log,
        Bus(port, options.baud) as bus, Motors(bus, settings) as motors,
    ):  # fmt: skip
        identities = motors.identify()
        for motor, identity in zip(settings, identities, strict=True):
            _say(options, _describe(motor, identity, port))
        if not signals:
            started = motors.start(table, options.approach)
            if added := len(started.rows) - len(table.rows):
                _say(options, f"The way to the first angles adds {added} commands, {added / RATE:.2f} s")
            table = started
        with real_time_priority() as real_time:
            result = send(motors, table, log, lambda: bool(signals))
    if options.json:
        motor = {motor.name: asdict(identity) for motor, identity in zip(settings, identities, strict=True)}
        about = {"motors": motor} if options.motors else {"motor": asdict(identities[0])}
        _write(json.dumps({**_as_dict(result, table, real_time), **about}, indent=2))
    _say(options, _summary(result, real_time))
    if options.log:
        _say(options, f"Log: {options.log}")
    if not result.complete:
        stopped = f"the motor{'s were' if len(settings) > 1 else ' was'} stopped"
        raise MotorError(f"{signals[0]} after {result.seconds:.2f} s of {table.duration:.2f} s; {stopped}")


@contextmanager
def _noted_signals() -> Generator[list[str]]:
    """Notes the names of signals that come, so that none cuts an exchange with a motor in two."""
    noted: list[str] = []
    known = [signal.Signals[name] for name in _SIGNALS if hasattr(signal, name)]
    before = {number: signal.signal(number, lambda n, _: noted.append(signal.Signals(n).name)) for number in known}
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _describe(motor: MotorSettings, identity: Identity, port: str) -> str:
    reverse = ", counts in reverse (Drive Mode)" if identity.reversed else ""
    return (
        f"M{str(motor)[1:]} on {port}: {identity.model}, firmware {identity.firmware}, {identity.voltage:.1f} V, "
        f"{identity.temperature} °C (limit {identity.temperature_limit}), "
        f"own limit {identity.velocity_limit:.2f} rad/s{reverse}"
    )


def _summary(result: SendingResult, real_time: bool) -> str:
    p = result.punctuality
    text = (
        f"Sent {p.sent} commands, skipped {p.skipped}: {100 * p.on_time_share:.2f} % within {1e3 * ON_TIME:.0f} ms "
        f"of their time, 99th percentile {1e3 * p.percentile_99:.2f} ms, worst {1e3 * p.worst:.2f} ms"
        f"{'' if real_time else ' (without real-time priority)'}; "
        f"{result.unanswered} commands and {result.unread} readings unanswered"
    )
    if result.temperature is not None and result.voltage is not None:
        text += f"; at most {result.temperature} °C, at least {result.voltage:.1f} V"
    return text


def _as_dict(result: SendingResult, table: CommandTable, real_time: bool) -> dict[str, object]:
    figures, lateness = asdict(result), asdict(result.punctuality)
    del figures["punctuality"]
    counts = {name: lateness.pop(name) for name in ("sent", "skipped", "on_time_share")}
    about = {"commands": len(table.rows), "real_time_priority": real_time}
    return {**figures, **counts, **about, "lateness": lateness}
