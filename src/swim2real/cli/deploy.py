"""`deploy`: needs nothing heavy, since it runs on the small computer in the fish."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Generator
from dataclasses import asdict

from swim2real.cli.deployment_arguments import Deploy
from swim2real.deployment.bus import Bus
from swim2real.deployment.commands import XW540_T140, CommandTable, Limits, read_table
from swim2real.deployment.control_table import MODEL, MotorError
from swim2real.deployment.motor import Identity, Motor
from swim2real.deployment.schedule import ON_TIME, real_time_priority
from swim2real.deployment.sending import SendingResult, log_file, send
from swim2real.errors import ArgumentError
from swim2real.interruption import Interruption

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # SIGHUP: the connection to the fish is lost


def deploy(a: Deploy) -> int:
    """Sends a table to the motor; 1 when it was interrupted."""
    if (a.port is None) == (not a.dry_run):
        raise ArgumentError("give either --port (as /dev/ttyUSB0) or --dry-run")
    if a.repeat < 1:
        raise ArgumentError(f"--repeat is {a.repeat}; it must be 1 or above")
    limits = Limits(
        XW540_T140.speed if a.max_speed is None else a.max_speed,
        XW540_T140.acceleration if a.max_acceleration is None else a.max_acceleration,
    )
    table, notes = _prepare(a, limits)
    show = _print_nothing if a.quiet or a.json else print
    show(
        f"{a.commands}: {len(table.times)} commands, {table.duration:.2f} s at 50 Hz; "
        f"fastest {table.speed:.2f} rad/s (limit {limits.speed:.2f}), "
        f"steepest {table.acceleration:.1f} rad/s² (limit {limits.acceleration:.0f})"
    )
    for note in notes:
        show(note)
    with (
        Interruption(_SIGNALS, raise_second=False) as interruption,
        log_file(a.log) as log,
        _port(a) as port,
        Bus(port, a.id, a.baud) as bus,
    ):
        with Motor(bus) as motor:
            identity = motor.identify()
            show(_describe(identity, a, port))
            if not interruption:
                motor.start(table, limits)
            with real_time_priority() as real_time:
                result = send(motor, bus, table, log, lambda: bool(interruption))
        name = interruption.name
    if a.json:
        print(json.dumps(_as_dict(result, identity, table, real_time, a), indent=2))
    show(_summary(result, real_time))
    if a.log:
        show(f"Log: {a.log}")
    if not result.complete:
        at = f"after {result.seconds:.2f} s of {table.duration:.2f} s"
        print(f"swim2real: {name or 'interruption'} {at}; the motor was stopped", file=sys.stderr)
    return 0 if result.complete else 1


def _print_nothing(*_: object) -> None:
    pass


def _prepare(a: Deploy, limits: Limits) -> tuple[CommandTable, list[str]]:
    """The table as it will be sent, and notes on what was changed in it."""
    notes: list[str] = []
    table = read_table(a.commands).repeated(a.repeat)
    if a.clip:
        clipped = table.clipped(limits)
        changed = sum(before != after for before, after in zip(table.velocities, clipped.velocities, strict=True))
        notes.append(f"Clipping changed {changed} commands")
        table = clipped
    table.within(limits)
    ramped = table.ramped(min(a.ramp, limits.acceleration))
    if added := len(ramped.times) - len(table.times):
        notes.append(f"Ramps from and to rest added {added} commands, {added / 50:.2f} s")
    return ramped.within(limits), notes


@contextlib.contextmanager
def _port(a: Deploy) -> Generator[str]:
    """The port's name; for a dry run that of an emulated motor, which runs as a program of its own."""
    if a.port is not None:
        yield a.port
        return
    with subprocess.Popen(
        [sys.executable, "-m", "swim2real.deployment.emulator", str(a.baud), str(a.id)],
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


def _describe(identity: Identity, a: Deploy, port: str) -> str:
    reverse = ", counts in reverse (Drive Mode)" if identity.reversed else ""
    return (
        f"{'Emulated motor' if a.dry_run else 'Motor'} {a.id} on {port}: {MODEL}, firmware {identity.firmware}, "
        f"{identity.voltage:.1f} V, {identity.temperature} °C (limit {identity.temperature_limit}), "
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
    result: SendingResult, identity: Identity, table: CommandTable, real_time: bool, a: Deploy
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
        "emulated": a.dry_run,
        "motor": asdict(identity),
    }  # fmt: skip
