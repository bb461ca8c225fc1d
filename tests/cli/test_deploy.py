"""`swim2real deploy`: what it prints, refuses, logs; and how its end stops the motor."""

import csv
import math
import os
import signal
import threading
import time
from contextlib import contextmanager

import pytest
from program import process

from emulator import SYNC_WRITE, WRITE, EmulatedMotor, Emulator
from faulty_motors import Fault, FaultyEmulator
from motorline import FISH, CommandTable, control_table, write_table

MOTORS = """
[head]
id = 2
model = "XL430-W250"
lowest = -1
highest = 1
[wheel]
id = 3
direction = -1
"""


@pytest.fixture
def table(tmp_path):
    def write(speeds):
        write_table(tmp_path / "commands.csv", CommandTable.of({FISH: speeds}))
        return tmp_path / "commands.csv"

    return write


@pytest.fixture
def motors(tmp_path):
    """A table for two motors and their file."""
    (tmp_path / "motors.toml").write_text(MOTORS)

    def write(rows=30, **columns):
        table = columns or {"head_rad": [0.2] * rows, "wheel_rad_s": [3.0] * rows}
        write_table(tmp_path / "commands.csv", CommandTable.of(table))
        return tmp_path / "commands.csv", "--baud", 1_000_000, "--motors", tmp_path / "motors.toml"

    return write


def wait_until_it_turns(emulator):
    give_up = time.monotonic() + 30
    while abs(emulator.velocity()) < 2.5 and time.monotonic() < give_up:
        time.sleep(0.02)
    assert abs(emulator.velocity()) > 2.5


def stands_still(emulator):
    give_up = time.monotonic() + 10
    while emulator.velocity() != 0 and time.monotonic() < give_up:
        time.sleep(0.01)
    return emulator.velocity() == 0


@contextmanager
def swimming(path):
    """A motor, and a program of its own that sends it commands, once the motor turns."""
    with Emulator() as emulator:
        program = process("deploy", path, "--port", emulator.port)
        try:
            wait_until_it_turns(emulator)
            yield emulator, program
        finally:
            program.kill()
            program.communicate()


def goals(emulator, device):
    """The values that were sent to a motor's goal, by a packet of its own or one for several."""
    for _, packet in emulator.packets:
        address, content = packet.parameters[:1], packet.parameters[2:]
        if packet.instruction == SYNC_WRITE:
            shares = {content[k]: content[k + 1 : k + 5] for k in range(2, len(content), 5)}
        else:
            shares = {packet.id: content} if packet.instruction == WRITE else {}
        if address in (b"h", b"t") and device in shares:  # Goal Velocity (104), Goal Position (116)
            yield int.from_bytes(shares[device], "little", signed=True)


def test_what_a_dry_run_prints_is_what_is_sent(program, table, tmp_path):
    log, words = tmp_path / "log.csv", ["deploy", table([2.0] * 20), "--repeat", 2]
    program(*words, "--dry-run").done()
    summary = "50 commands, 1.00 s at 50 Hz; fastest 2.00 rad/s (limit 7.29), steepest 20.0 rad/s² (limit 100)"
    assert summary in program.err
    assert "Ramps from and to rest added 10 commands, 0.20 s" in program.err
    assert "Nothing was sent: it would be 50 commands, 1.00 s, 50 values\n" in program.err
    plan = list(csv.DictReader(program.out.splitlines()))
    assert {(row["id"], row["register"]) for row in plan} == {("1", "Goal Velocity (104)")}
    value = {float(row["time_s"]): int(row["value"]) for row in plan}
    assert list(value) == [k / 50 for k in range(50)]
    with Emulator() as emulator:
        out = program(*words, "--port", emulator.port, "--log", log).done().out
    assert summary in out
    assert f"Motor 1 on {emulator.port}: XW540-T140-R, firmware 45, 12.0 V, 30 °C (limit 80), own limit 7.29" in out
    assert "of their time, 99th percentile" in out
    rows = list(csv.DictReader(log.read_text().splitlines()))
    sent = [value[float(row["due_s"])] for row in rows]  # but for those that a busy machine skips
    assert list(goals(emulator, 1))[1 : len(sent) + 1] == sent  # after the goal that means rest
    assert all(float(row["sent_s"]) >= float(row["due_s"]) for row in rows)
    assert max(float(row["command_rad_s"]) for row in rows) == pytest.approx(2.0, abs=0.012)
    read = [row for row in rows if row["velocity_rad_s"]]
    assert max(float(row["velocity_rad_s"]) for row in read) == pytest.approx(2.0, abs=0.03)
    assert (read[0]["voltage_v"], read[0]["temperature_c"]) == ("12.0", "30")
    program("deploy", table([0.0, 9.0, 0.0]), "--dry-run", "--clip").done()
    assert "Clipping changed 1 commands" in program.err


def test_what_a_dry_run_with_a_motors_file_prints_is_what_is_sent(program, motors, tmp_path):
    log = tmp_path / "log.csv"
    program("deploy", *motors(), "--dry-run").done()
    summary = "46 commands, 0.92 s at 50 Hz\nhead_rad: 0.20 to 0.20 rad (limits -1.00 to 1.00), fastest 0.00 rad/s"
    assert summary in program.err
    assert "wheel_rad_s: fastest 3.00 rad/s (limit 7.29), steepest 18.8 rad/s² (limit 100)" in program.err
    assert "92 values, after the way of head from the present to the first angles, at 0.5" in program.err
    value = {
        (float(row["time_s"]), row["id"], row["register"]): int(row["value"])
        for row in csv.DictReader(program.out.splitlines())
    }
    assert len(value) == 2 * 46
    head = EmulatedMotor(2, control_table.MODELS["XL430-W250"], angle=math.pi)
    with Emulator(head, EmulatedMotor(3)) as emulator:
        out = program("deploy", *motors(), "--port", emulator.port, "--approach", 2, "--log", log).done().out
    assert summary in out
    assert "Motor head (id 2) on /dev/pts/" in out
    assert "XL430-W250, firmware 45, 12.0 V, 30 °C (limit 72), own limit 6.35 rad/s" in out
    assert "The way to the first angles adds 5 commands, 0.10 s" in out
    rows = list(csv.DictReader(log.read_text().splitlines()))
    assert list(rows[0])[:6] == ["due_s", "sent_s", "command_head_rad", "command_wheel_rad_s", "motor", "answered"]
    due = [round(float(row["due_s"]) - 0.1, 2) for row in rows if float(row["due_s"]) > 0.09]
    before = 1 + len(rows) - len(due)  # the goal that means rest, and the way to the first angles
    for device, register in ((2, "Goal Position (116)"), (3, "Goal Velocity (104)")):
        sent = [value[time, str(device), register] for time in due]
        assert list(goals(emulator, device))[before : before + len(sent)] == sent
    wheel = [float(row["velocity_rad_s"]) for row in rows if row["motor"] == "wheel" and row["velocity_rad_s"]]
    assert max(wheel) == pytest.approx(3.0, abs=0.03)
    angles = [float(row["position_rad"]) for row in rows if row["motor"] == "head" and row["position_rad"]]
    assert angles[-1] == pytest.approx(0.2, abs=0.01)


def test_json(program, table, motors):
    words = ["deploy", table([0.0, 1.0, 0.0]), "--json", "--id", 3]
    plan = program(*words, "--dry-run").done().json
    assert (plan["commands"], plan["seconds"], program.err) == (3, 0.06, "")
    assert plan["writes"][1] == {"time_s": 0.02, "id": 3, "register": "Goal Velocity (104)", "value": 42}
    with Emulator(EmulatedMotor(3)) as emulator:
        figures = program(*words, "--port", emulator.port).done().json
    assert figures["complete"]
    assert figures["commands"] == figures["sent"] + figures["skipped"] == 3
    assert figures["motor"]["velocity_limit"] == pytest.approx(7.29, abs=0.01)
    head = EmulatedMotor(2, control_table.MODELS["XL430-W250"], angle=math.pi)
    with Emulator(head, EmulatedMotor(3)) as emulator:
        figures = program("deploy", *motors(5), "--port", emulator.port, "--json").done().json
    assert figures["motors"]["head"]["model"] == "XL430-W250"


@pytest.mark.parametrize(("speeds", "words", "code", "sentence"), [
    ([0.0], [], 2, "give either --port (as /dev/ttyUSB0) or --dry-run"),
    ([0.0], ["--dry-run", "--port", "x"], 2, "give either --port"),
    ([0.0], ["--dry-run", "--repeat", "0"], 2, "--repeat is 0; it must be 1 or above"),
    ([0.0], ["--dry-run", "--baud", "1200"], 2, "1200 baud can't be used"),
    ([0.0, 8.0], ["--dry-run"], 2, "the command at 0.02 s is 8 rad/s; the limits are -7.29 to 7.29 rad/s"),
    ([3.0, 2.0], ["--dry-run", "--max-speed", "2.5"], 2, "at 0.00 s is 3 rad/s; the limits are -2.5 to 2.5 rad/s"),
    ([0.0], ["--port", "/dev/none"], 1, "serial port /dev/none can't be opened (No such file or directory)"),
    ([0.0], ["--port", "x", "--log", "/none/log.csv"], 2, "can't write log '/none/log.csv': No such file"),
    ([0.0], ["--dry-run", "--log", "log.csv"], 2, "--log is log.csv, and a dry run sends nothing to log"),
    ([7.8] * 9, ["--dry-run", "--max-speed", "9"], 1,
     "the table asks motor 1 for 7.8 rad/s; as sold, its Velocity Limit (44) is 304, 7.29 rad/s"),
])  # fmt: skip
def test_refusals(program, table, speeds, words, code, sentence):
    assert sentence in program("deploy", table(speeds), *words, "--quiet").sentence(code)


@pytest.mark.parametrize(("columns", "words", "sentence"), [
    ({}, ["--id", "1"], "--id is 1, and --motors is given, whose file says it for each motor"),
    ({}, ["--approach", "0"], "--approach is 0; it must be finite and above 0, in rad/s"),
    ({"head_rad": [1.1], "wheel_rad_s": [0]}, [], "head_rad: the command at 0.00 s is 1.1 rad; the limits are -1"),
    ({"head_rad": [0.0], "winch_m": [0.1]}, [], "the column winch_m is in m; a motor takes speeds in rad/s"),
])  # fmt: skip
def test_refusals_with_a_motors_file(program, motors, columns, words, sentence):
    assert sentence in program("deploy", *motors(**columns), *words, "--dry-run", "--quiet").sentence(2)
    said = program("deploy", motors()[0], "--dry-run", "--quiet").sentence(2)
    assert "has the columns head_rad, wheel_rad_s; without --motors only velocity_rad_s can be sent" in said


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGINT of several"])
def test_signals_stop_the_motors(program, table, motors, name):
    name, _, several = name.partition(" ")
    head = EmulatedMotor(2, control_table.MODELS["XL430-W250"], angle=3.0)
    with Emulator(*([head, EmulatedMotor(3)] if several else [])) as emulator:

        def send_signal():
            wait_until_it_turns(emulator)
            os.kill(os.getpid(), getattr(signal, name))

        sender = threading.Thread(target=send_signal)
        sender.start()
        program("deploy", *(motors(1000) if several else [table([3.0] * 1000)]), "--port", emulator.port)
        sender.join()
        assert program.code == 1
        assert f"swim2real: {name} after" in program.err
        assert ("the motors were stopped" if several else "the motor was stopped") in program.err
        assert "Sent" in program.out
        assert stands_still(emulator)
        assert not any(motor.get(control_table.TORQUE_ENABLE) for motor in emulator.motors)
        assert not any(motor.watchdog_tripped for motor in emulator.motors)  # a command stopped them


def test_killed_the_watchdog_stops_the_motor(table):
    with swimming(table([3.0] * 1000)) as (emulator, program):
        program.kill()
        assert stands_still(emulator)
        assert emulator.motor.watchdog_tripped


@pytest.mark.slow
def test_halted_and_continued_it_says_what_happened(table):
    with swimming(table([3.0] * 1000)) as (emulator, program):
        program.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        assert stands_still(emulator)
        program.send_signal(signal.SIGCONT)
        _, err = program.communicate(timeout=20)
        assert program.returncode == 1
        assert "the watchdog of motor 1 has stopped it" in err
        assert stands_still(emulator)


def test_an_error_in_the_middle_is_one_sentence_and_the_log_is_there(program, table, tmp_path):
    log = tmp_path / "log.csv"
    with FaultyEmulator(faults=[Fault("overheated", 60)]) as emulator:
        program("deploy", table([3.0] * 200), "--port", emulator.port, "--log", log, "--quiet")
        assert "motor 1 reports overheating" in program.sentence(1)
        assert stands_still(emulator)
    assert len(log.read_text().splitlines()) > 10
