"""`swim2real deploy` as a program: what it prints, refuses, logs; and how its end stops the motor."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import swim2real
from swim2real.deployment import RATE, control_table, write_table
from swim2real.deployment.emulator import Emulator, Fault
from swim2real.deployment.sending import LOG_HEADER

SOURCE = str(Path(swim2real.__file__).parents[1])


def start(*words) -> subprocess.Popen:
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import swim2real.__main__"
    return subprocess.Popen(
        [sys.executable, "-c", code, "deploy", *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
        env={**os.environ, "PYTHONPATH": SOURCE, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip


def run(*words) -> tuple[int, str, str]:
    program = start(*words)
    out, err = program.communicate(timeout=60)
    return program.returncode, out, err


@pytest.fixture
def table(tmp_path):
    def write(speeds):
        path = tmp_path / "commands.csv"
        write_table(path, [k / RATE for k in range(len(speeds))], speeds)
        return path

    return write


@pytest.fixture
def swimming(table):
    """A program that sends for 20 s, once the motor turns."""

    with Emulator() as emulator:
        program = start(table([3.0] * 1000), "--port", emulator.port)
        give_up = time.monotonic() + 30
        while emulator.velocity() < 2.5 and time.monotonic() < give_up:
            time.sleep(0.02)
        assert emulator.velocity() > 2.5
        yield emulator, program
        program.kill()
        program.communicate()


def test_a_dry_run(table, tmp_path):
    log = tmp_path / "log.csv"
    path = table([2.0] * 20)
    code, out, err = run(path, "--dry-run", "--log", log, "--repeat", 2)
    assert (code, err) == (0, "")
    assert "50 commands, 1.00 s at 50 Hz; fastest 2.00 rad/s (limit 7.29), steepest 20.0 rad/s² (limit 100)" in out
    assert "Ramps from and to rest added 10 commands, 0.20 s" in out
    assert "Emulated motor 1 on /dev/pts/" in out
    assert "XW540-T140-R, firmware 45, 12.0 V, 30 °C (limit 80), own limit 7.29 rad/s" in out
    assert "of their time, 99th percentile" in out
    with log.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == LOG_HEADER
    sent = [row for row in rows if row["answered"] == "1"]
    assert [float(row["due_s"]) for row in rows] == sorted({float(row["due_s"]) for row in rows})
    assert all(float(row["sent_s"]) >= float(row["due_s"]) for row in rows)
    assert max(float(row["command_rad_s"]) for row in sent) == pytest.approx(2.0, abs=0.012)
    read = [row for row in rows if row["velocity_rad_s"]]
    assert max(float(row["velocity_rad_s"]) for row in read) == pytest.approx(2.0, abs=0.03)
    assert (read[0]["voltage_v"], read[0]["temperature_c"]) == ("12.0", "30")


def test_json(table):
    code, out, err = run(table([0.0, 1.0, 0.0]), "--dry-run", "--json", "--id", 3)
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert found["complete"]
    assert found["emulated"]
    assert found["commands"] == found["sent"] + found["skipped"] == 3
    assert found["motor"]["velocity_limit"] == pytest.approx(7.29, abs=0.01)


@pytest.mark.parametrize(
    ("speeds", "words", "code", "sentence"),
    [
        ([0.0], [], 2, "give either --port (as /dev/ttyUSB0) or --dry-run"),
        ([0.0], ["--dry-run", "--port", "x"], 2, "give either --port"),
        ([0.0], ["--dry-run", "--repeat", "0"], 2, "--repeat is 0; it must be 1 or above"),
        ([0.0], ["--dry-run", "--baud", "1200"], 2, "1200 baud can't be used"),
        ([0.0, 8.0], ["--dry-run"], 2, "the command at 0.02 s is 8 rad/s; the limit is 7.29 rad/s"),
        ([0.0, 2.5], ["--dry-run"], 2, "125 rad/s²; the limit is 100 rad/s²"),
        ([3.0, 2.0], ["--dry-run", "--max-speed", "2.5"], 2, "the command at 0.00 s is 3 rad/s; the limit is 2.5"),
        ([0.0], ["--port", "/dev/none"], 1, "serial port /dev/none can't be opened (No such file or directory)"),
        ([0.0], ["--dry-run", "--log", "/none/log.csv"], 2, "log '/none/log.csv' can't be written: No such file"),
    ],
)
def test_refusals(table, speeds, words, code, sentence):
    found, _, err = run(table(speeds), *words)
    assert found == code
    assert err.startswith("swim2real: ")
    assert sentence in err
    assert len(err.splitlines()) == 1


def test_clipping_must_be_asked_for(table):
    code, out, err = run(table([0.0, 9.0, 0.0]), "--dry-run", "--clip")
    assert (code, err) == (0, "")
    assert "Clipping changed 1 commands" in out


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_stop_the_motor(swimming, name):
    emulator, program = swimming
    program.send_signal(getattr(signal, name))
    out, err = program.communicate(timeout=20)
    assert program.returncode == 1
    assert f"swim2real: {name} after" in err
    assert "the motor was stopped" in err
    assert "Sent" in out
    assert emulator.velocity() == 0
    assert emulator.motor.get(control_table.TORQUE_ENABLE) == 0
    assert not emulator.motor.watchdog_tripped  # it was told to stop, and didn't have to find out


def test_killed_the_watchdog_stops_the_motor(swimming):
    emulator, program = swimming
    program.kill()
    killed = time.monotonic()
    while emulator.velocity() > 0 and time.monotonic() < killed + 10:
        time.sleep(0.01)
    assert emulator.velocity() == 0
    assert emulator.motor.watchdog_tripped


def test_halted_and_continued_it_says_what_happened(swimming):
    emulator, program = swimming
    program.send_signal(signal.SIGSTOP)
    time.sleep(0.5)
    assert emulator.velocity() == 0
    program.send_signal(signal.SIGCONT)
    _, err = program.communicate(timeout=20)
    assert program.returncode == 1
    assert "the motor's watchdog has stopped it" in err
    assert emulator.velocity() == 0


def test_an_error_in_the_middle_is_one_sentence_and_the_log_is_there(table, tmp_path):
    log = tmp_path / "log.csv"
    with Emulator(faults=[Fault("overheated", 60)]) as emulator:
        code, _, err = run(table([3.0] * 200), "--port", emulator.port, "--log", log, "--quiet")
        assert code == 1
        assert len(err.splitlines()) == 1
        assert "the motor reports overheating" in err
        assert emulator.velocity() == 0
    assert len(log.read_text().splitlines()) > 10
