"""Measures how punctual commands at 50 Hz are: 60 s against the emulated motor, with and without real-time priority.

The emulated motor is a program of its own that takes the time of a 57,600 baud line to answer. Prints a table, and the
machine's load, which matters. Run with the package and its extra `deploy` installed: `python benchmarks/schedule.py`.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from math import pi, sin
from pathlib import Path

from motorline import FISH, RATE, XW540_T140, CommandTable, fish_motor
from motorline.bus import Bus
from motorline.motors import Motors
from motorline.schedule import real_time_priority
from motorline.sending import SendingResult, send

EMULATOR = Path(__file__).resolve().parents[1] / "tests" / "emulator.py"


@contextlib.contextmanager
def emulated_motor(baud: int) -> Iterator[str]:
    words = [sys.executable, str(EMULATOR), str(baud)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as program:
        yield program.stdout.readline().strip()
        program.stdin.close()


def measure(seconds: float, baud: int, real_time: bool) -> tuple[SendingResult, bool]:
    # a beat of 0.8 Hz on top of 4 rad/s
    speeds = [4 + 2 * sin(2 * pi * 0.8 * k / RATE) for k in range(round(seconds * RATE))]
    table = CommandTable.of({FISH: speeds}).ramped(20.0).within({FISH: XW540_T140})
    with emulated_motor(baud) as port, Bus(port, baud) as bus, Motors(bus, [fish_motor()]) as motors:
        motors.identify()
        motors.start(table)
        with real_time_priority() if real_time else contextlib.nullcontext(False) as granted:
            return send(motors, table), granted


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--baud", type=int, default=57_600)
    a = parser.parse_args()
    print(f"{os.cpu_count()} cores; load before {os.getloadavg()[0]:.1f}")
    print("| priority | sent | skipped | within 2 ms | median ms | 99th percentile ms | worst ms | unanswered |")
    print("|---|---|---|---|---|---|---|---|")
    for real_time in (True, False):
        sent, granted = measure(a.seconds, a.baud, real_time)
        p = sent.punctuality
        print(
            f"| {'real-time' if granted else 'normal'} | {p.sent} | {p.skipped} | {100 * p.on_time_share:.2f} % | "
            f"{1e3 * p.median:.3f} | {1e3 * p.percentile_99:.3f} | {1e3 * p.worst:.3f} | "
            f"{sent.unanswered + sent.unread} |"
        )
    print(f"load after {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
