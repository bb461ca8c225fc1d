"""`deploy`: needs nothing heavy, since it runs on the small computer in the fish."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Generator
from dataclasses import asdict, dataclass
from pathlib import Path

from swim2real.cli.options import Positional
from swim2real.deployment.commands import XW540_T140, CommandTable, Limits, read_table
from swim2real.deployment.control_table import MODEL, MotorError
from swim2real.deployment.motor import Identity, Motor
from swim2real.deployment.schedule import ON_TIME, real_time_priority
from swim2real.deployment.sending import SendingResult, log_file, send
from swim2real.errors import ArgumentError
from swim2real.interruption import Interruption

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # SIGHUP: the connection to the fish is lost


@dataclass(frozen=True)
class DeployOptions:
    """What is sent, and how."""

    commands: Positional[Path]
    """Table of commands."""
    port: str | None = None
    """Serial port of the U2D2, as /dev/ttyUSB0."""
    id: int = 1
    """The motor's id."""
    baud: int = 57600
    """The motor's baud rate; 57600 as it is sold."""
    dry_run: bool = False
    """Send to an emulated motor instead of a real one."""
    log: Path | None = None
    """CSV file to write: what was sent when, what was read back when."""
    repeat: int = 1
    """Times to send the table, one after the other."""
    ramp: float = 20.0
    """Acceleration of the ramps from and to rest [rad/s²]; they add rows only where the table doesn't rest."""
    max_speed: float | None = None
    """Refuse faster commands [rad/s]; by default 7.29, the motor's own limit as it is sold."""
    max_acceleration: float | None = None
    """Refuse steeper changes from one command to the next [rad/s²]; by default 100."""
    clip: bool = False
    """Cut commands off at the limits instead of refusing them."""
    json: bool = False
    """Print what was done as JSON."""
    quiet: bool = False
    """Print nothing but errors."""


def deploy(options: DeployOptions) -> int:
    """Send motor commands to the fish's motor, a Dynamixel XW540-T140-R, at 50 Hz.

    Reads a table with the header time_s,velocity_rad_s and 50 rows a second from 0 s on; writes a log. Checks table and
    motor first, ramps from and to rest, and asks nothing: the motor turns at once. Takes as long as the table. Ctrl-C,
    an error or the end of this program stop the motor (without the program its watchdog does, after 0.2 s). Exits with
    1 when not all commands were sent.

    Args:
        options: What is sent, and how.
    """
    if (options.port is None) == (not options.dry_run):
        raise ArgumentError("give either --port (as /dev/ttyUSB0) or --dry-run")
    if options.repeat < 1:
        raise ArgumentError(f"--repeat is {options.repeat}; it must be 1 or above")
    from swim2real.deployment.bus import Bus  # which brings the motor's library

    limits = Limits(
        XW540_T140.speed if options.max_speed is None else options.max_speed,
        XW540_T140.acceleration if options.max_acceleration is None else options.max_acceleration,
    )
    table, notes = _prepare(options, limits)
    show = _print_nothing if options.quiet or options.json else print
    show(
        f"{options.commands}: {len(table.times)} commands, {table.duration:.2f} s at 50 Hz; "
        f"fastest {table.speed:.2f} rad/s (limit {limits.speed:.2f}), "
        f"steepest {table.acceleration:.1f} rad/s² (limit {limits.acceleration:.0f})"
    )
    for note in notes:
        show(note)
    with (
        Interruption(_SIGNALS, raise_second=False) as interruption,
        log_file(options.log) as log,
        _port(options) as port,
        Bus(port, options.id, options.baud) as bus,
    ):
        with Motor(bus) as motor:
            identity = motor.identify()
            show(_describe(identity, options, port))
            if not interruption:
                motor.start(table, limits)
            with real_time_priority() as real_time:
                result = send(motor, bus, table, log, lambda: bool(interruption))
        name = interruption.name
    if options.json:
        print(json.dumps(_as_dict(result, identity, table, real_time, options), indent=2))
    show(_summary(result, real_time))
    if options.log:
        show(f"Log: {options.log}")
    if not result.complete:
        at = f"after {result.seconds:.2f} s of {table.duration:.2f} s"
        print(f"swim2real: {name or 'interruption'} {at}; the motor was stopped", file=sys.stderr)
    return 0 if result.complete else 1


def _print_nothing(*_: object) -> None:
    pass


def _prepare(options: DeployOptions, limits: Limits) -> tuple[CommandTable, list[str]]:
    """The table as it will be sent, and notes on what was changed in it."""
    notes: list[str] = []
    table = read_table(options.commands).repeated(options.repeat)
    if options.clip:
        clipped = table.clipped(limits)
        changed = sum(before != after for before, after in zip(table.velocities, clipped.velocities, strict=True))
        notes.append(f"Clipping changed {changed} commands")
        table = clipped
    table.within(limits)
    ramped = table.ramped(min(options.ramp, limits.acceleration))
    if added := len(ramped.times) - len(table.times):
        notes.append(f"Ramps from and to rest added {added} commands, {added / 50:.2f} s")
    return ramped.within(limits), notes


@contextlib.contextmanager
def _port(options: DeployOptions) -> Generator[str]:
    """The port's name; for a dry run that of an emulated motor, which runs as a program of its own."""
    if options.port is not None:
        yield options.port
        return
    with subprocess.Popen(
        [sys.executable, "-m", "swim2real.deployment.emulator", str(options.baud), str(options.id)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    ) as emulator:  # fmt: skip
        stdin, stdout = emulator.stdin, emulator.stdout
        name = stdout.readline().strip() if stdin and stdout else ""
        if not name:
            raise MotorError("the emulated motor didn't start; --port reaches a real one")
        try:
            yield name
        finally:
            if stdin:
                stdin.close()  # which ends it


def _describe(identity: Identity, options: DeployOptions, port: str) -> str:
    reverse = ", counts in reverse (Drive Mode)" if identity.reversed else ""
    return (
        f"{'Emulated motor' if options.dry_run else 'Motor'} {options.id} on {port}: {MODEL}, "
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


def _as_dict(
    result: SendingResult, identity: Identity, table: CommandTable, real_time: bool, options: DeployOptions
) -> dict[str, object]:
    return {
        "complete": result.complete,
        "seconds": result.seconds,
        "commands": len(table.times),
        "sent": result.punctuality.sent,
        "skipped": result.punctuality.skipped,
        "on_time_share": result.punctuality.on_time_share,
        "lateness": {
            "median": result.punctuality.median,
            "percentile_99": result.punctuality.percentile_99,
            "worst": result.punctuality.worst,
        },
        "unanswered": result.unanswered,
        "unread": result.unread,
        "real_time_priority": real_time,
        "emulated": options.dry_run,
        "motor": asdict(identity),
    }  # fmt: skip
