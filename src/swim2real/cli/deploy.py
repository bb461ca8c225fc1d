"""`deploy`: needs nothing heavy, since it runs on the small computer in the robot."""

from __future__ import annotations

import contextlib
import math
import subprocess
import sys
from collections.abc import Generator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tyro.conf import Positional

from motorline.commands import FISH, XW540_T140, CommandTable, MotorLimits, is_speed, read_table
from motorline.control_table import MotorError
from motorline.motors import APPROACH, Identity, Motors
from motorline.motors_file import MotorSettings, fish_motor, read_motors
from motorline.schedule import ON_TIME, real_time_priority
from motorline.sending import SendingResult, check_time, log_file, log_header, send
from swim2real.cli.terminal import say, say_json, tell
from swim2real.interruption import Interruption
from swimbase.errors import ArgumentError

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # SIGHUP: the connection to the fish is lost


@dataclass(frozen=True)
class _DeployOptions:
    """What is sent, and how."""

    commands: Positional[Path]
    """Table of commands."""
    motors: Path | None = None
    """Motors file: id and limits of each column's motor. Without it, one XW540-T140-R follows velocity_rad_s."""
    port: str | None = None
    """Serial port of the U2D2, such as /dev/ttyUSB0."""
    id: int | None = None
    """Id of the single motor; by default 1."""
    baud: int = 57600
    """The motors' baud rate; by default 57600, as they are sold."""
    dry_run: bool = False
    """Send to emulated motors instead of real ones."""
    log: Path | None = None
    """CSV file to write: what was sent and read, with times."""
    repeat: int = 1
    """Number of times to send the table."""
    ramp: float = 20.0
    """Acceleration of the ramps from and to rest [rad/s²]; they add rows only where the table doesn't rest."""
    approach: float = APPROACH
    """Speed from the present angles to those of the first row [rad/s]."""
    max_speed: float | None = None
    """Refuse faster commands of the single motor [rad/s]; by default 7.29, its limit as sold."""
    max_acceleration: float | None = None
    """Refuse steeper changes between two commands of the single motor [rad/s²]; by default 100."""
    clip: bool = False
    """Limit commands instead of refusing them."""
    json: bool = False
    """Print the result as JSON."""
    quiet: bool = False
    """Print nothing but errors."""


def deploy(options: _DeployOptions) -> int:
    """Send commands to motors at 50 Hz: to the fish's, or to several Dynamixel X motors on one bus.

    Reads a table with a column per actuator (time_s,velocity_rad_s for the fish) and 50 rows per second from 0 s on;
    writes a log. Checks table and motors first, ramps speeds from and to rest, moves to the first angles slowly, and
    doesn't ask for confirmation: the motors turn at once. Ctrl-C, an error or the end of the program stop the motors;
    if the program dies, their watchdogs do after 0.2 s. Exits with 1 if not all commands were sent.

    Args:
        options: What is sent, and how.
    """
    if (options.port is None) == (not options.dry_run):
        raise ArgumentError("give either --port (as /dev/ttyUSB0) or --dry-run")
    if options.repeat < 1:
        raise ArgumentError(f"--repeat is {options.repeat}; it must be 1 or above")
    if not (math.isfinite(options.approach) and options.approach > 0):
        raise ArgumentError(f"--approach is {options.approach:g}; it must be finite and above 0, in rad/s")
    from motorline.bus import Bus  # which brings the motors' library

    table = read_table(options.commands)
    settings = _settings(options, table)
    table, notes = _prepare(options, table, settings)
    show = (lambda text: None) if options.quiet or options.json else say
    show(f"{options.commands}: {len(table.rows)} commands, {table.duration:.2f} s at 50 Hz{_extent(table, settings)}")
    for note in notes:
        show(note)
    with (
        Interruption(_SIGNALS, raise_second=False) as interruption,
        log_file(options.log, log_header(settings)) as log,
        _port(options, settings) as port,
        Bus(port, options.baud) as bus,
    ):
        with Motors(bus, settings) as motors:
            identities = motors.identify()
            for motor, identity in zip(settings, identities, strict=True):
                show(_describe(motor, identity, options, port))
            if not interruption:
                started = motors.start(table, options.approach)
                if added := len(started.rows) - len(table.rows):
                    show(f"The way to the first angles adds {added} commands, {added / 50:.2f} s")
                table = started
            with real_time_priority() as real_time:
                result = send(motors, table, log, lambda: bool(interruption))
        name = interruption.name
    if options.json:
        motor = {motor.name: asdict(identity) for motor, identity in zip(settings, identities, strict=True)}
        about = {"motors": motor} if options.motors else {"motor": asdict(identities[0])}
        say_json({**_as_dict(result, table, real_time, options), **about})
    show(_summary(result, real_time))
    if options.log:
        show(f"Log: {options.log}")
    if not result.complete:
        at = f"after {result.seconds:.2f} s of {table.duration:.2f} s"
        stopped = "the motor was stopped" if len(settings) == 1 else "the motors were stopped"
        tell(f"{name or 'interruption'} {at}; {stopped}")
    return 0 if result.complete else 1


def _settings(options: _DeployOptions, table: CommandTable) -> tuple[MotorSettings, ...]:
    """The motors, in the order of the table's columns."""
    if options.motors is not None:
        for name, value in (
            ("--id", options.id), ("--max-speed", options.max_speed), ("--max-acceleration", options.max_acceleration),
        ):  # fmt: skip
            if value is not None:
                raise ArgumentError(f"{name} is {value:g}, and --motors is given, whose file says it for each motor")
        motors = read_motors(options.motors, table.columns)
    elif table.columns == (FISH,):
        limits = MotorLimits(
            XW540_T140.speed if options.max_speed is None else options.max_speed,
            XW540_T140.acceleration if options.max_acceleration is None else options.max_acceleration,
        )
        motors = (fish_motor(1 if options.id is None else options.id, limits),)
    else:
        raise ArgumentError(
            f"{options.commands} has the columns {', '.join(table.columns)}; without --motors only {FISH} can be sent: "
            f"write a motors file and give it as --motors"
        )
    check_time(motors, options.baud)
    return motors


def _prepare(
    options: _DeployOptions, table: CommandTable, motors: Sequence[MotorSettings]
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
        notes.append(f"Ramps from and to rest added {added} commands, {added / 50:.2f} s")
    return ramped.within(limits), notes


def _extent(table: CommandTable, motors: Sequence[MotorSettings]) -> str:
    """What the table asks of each motor, and what it may."""
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


@contextlib.contextmanager
def _port(options: _DeployOptions, motors: Sequence[MotorSettings]) -> Generator[str]:
    """The port's name; for a dry run that of emulated motors, which run as a program of its own."""
    if options.port is not None:
        yield options.port
        return
    words = [f"{motor.id}:{motor.model.name}" for motor in motors]
    with subprocess.Popen(
        [sys.executable, "-m", "emulator", str(options.baud), *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    ) as emulator:  # fmt: skip
        stdin, stdout = emulator.stdin, emulator.stdout
        name = stdout.readline().strip() if stdin and stdout else ""
        if not name:
            raise MotorError("the emulated motors didn't start; --port reaches real ones")
        try:
            yield name
        finally:
            if stdin:
                stdin.close()  # which ends it


def _describe(motor: MotorSettings, identity: Identity, options: _DeployOptions, port: str) -> str:
    reverse = ", counts in reverse (Drive Mode)" if identity.reversed else ""
    name = str(motor) if not options.dry_run else f"emulated {motor}"
    return (
        f"{name[0].upper()}{name[1:]} on {port}: {identity.model}, "
        f"firmware {identity.firmware}, {identity.voltage:.1f} V, "
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


def _as_dict(result: SendingResult, table: CommandTable, real_time: bool, options: _DeployOptions) -> dict[str, object]:
    p = result.punctuality
    return {
        "complete": result.complete, "seconds": result.seconds, "commands": len(table.rows), "sent": p.sent,
        "skipped": p.skipped, "on_time_share": p.on_time_share,
        "lateness": {"median": p.median, "percentile_99": p.percentile_99, "worst": p.worst},
        "unanswered": result.unanswered, "unread": result.unread, "real_time_priority": real_time,
        "emulated": options.dry_run,
    }  # fmt: skip
