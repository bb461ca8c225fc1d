"""What goes wrong on a bus: each fault from before the start, and in the middle of a swim."""

import io
import time
from itertools import pairwise

import pytest

from swim2real.deployment import FISH, CommandTable, MotorError, fish_motor
from swim2real.deployment import control_table as ct
from swim2real.deployment.bus import Bus
from swim2real.deployment.emulator import Emulator, Fault
from swim2real.deployment.motors import Motors
from swim2real.deployment.sending import send

TABLE = CommandTable.of({FISH: [2.0] * 50})
WATCHDOG = 1.0  # s, so that a busy machine doesn't trip it
MIDDLE = 30  # packets; it takes about 15 to start


def swim(*faults: Fault, table=TABLE, log=None):
    """Sends a table to a motor with these faults; the emulator and what was sent, or the error."""
    with Emulator(faults=faults) as emulator:
        try:
            with Bus(emulator.port) as bus, Motors(bus, [fish_motor()], WATCHDOG) as motors:
                motors.identify()
                motors.start(table)
                return emulator, send(motors, table, log)
        except MotorError as error:
            time.sleep(WATCHDOG + 0.3 if "was lost" in str(error) else 0.2)
            emulator.velocity()
            return emulator, error


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        pytest.param(
            "silent", "didn't answer a ping at 57600 baud; check power, cable, id and baud rate", marks=pytest.mark.slow
        ),
        ("bad-crc", "a ping got a damaged answer; check cable, ground and baud rate"),
        pytest.param("garbage", "a ping got a damaged answer", marks=pytest.mark.slow),
        ("unplugged", "was lost while a ping"),
        ("overheated", "motor 1 reports overheating (Hardware Error Status (70) is 4)"),
    ],
)
def test_from_the_beginning(kind, sentence):
    emulator, error = swim(Fault(kind))
    assert sentence in str(error)
    assert emulator.velocity() == 0


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        pytest.param("silent", "10 commands in a row without an answer: motor 1 on", marks=pytest.mark.slow),
        ("bad-crc", "10 commands in a row without an answer: motor 1 on"),
        pytest.param("garbage", "got a damaged answer", marks=pytest.mark.slow),
        pytest.param("unplugged", "serial port /dev/pts/", marks=pytest.mark.slow),
        ("overheated", "motor 1 reports overheating"),
    ],
)
def test_in_the_middle(kind, sentence):
    emulator, error = swim(Fault(kind, MIDDLE))
    assert sentence in str(error)
    assert emulator.velocity() == 0
    if kind != "unplugged":
        assert emulator.motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.slow
def test_unplugged_the_watchdog_stops_it():
    emulator, error = swim(Fault("unplugged", MIDDLE))
    assert "is the cable still in? Without packets a motor's watchdog stops it" in str(error)
    assert emulator.motor.watchdog_tripped


@pytest.mark.slow
def test_the_watchdog_stays_on_while_nobody_knows_whether_the_torque_is_off():
    emulator, _ = swim(Fault("silent", MIDDLE))
    assert emulator.motor.get(ct.GOAL_VELOCITY) == emulator.motor.get(ct.TORQUE_ENABLE) == 0
    assert emulator.motor.get(ct.BUS_WATCHDOG) > 0


@pytest.mark.parametrize(
    "kind", ["silent", "garbage", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("bad-crc", "slow"))]
)
def test_one_bad_answer_is_counted_and_the_swim_goes_on(kind):
    emulator, sent = swim(Fault(kind, MIDDLE, 1))
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert sent.unanswered + sent.unread >= 1
    assert emulator.motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.slow
def test_noise_before_answers_is_passed_over():
    _, sent = swim(Fault("noise-before"))
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert sent.punctuality.sent + sent.punctuality.skipped == len(TABLE.rows)


def test_while_starting_a_lost_answer_is_asked_for_again():
    for first in (0, 3, 7, 11):
        _, sent = swim(Fault("silent", first, 1), table=CommandTable.of({FISH: [0.5]}))
        assert not isinstance(sent, MotorError), (first, sent)
        assert sent.complete


@pytest.mark.slow
def test_late_answers_dont_pile_up():
    """Answers 30 ms late: commands are skipped, and never sent closer together than half a period."""
    log = io.StringIO()
    _, sent = swim(Fault("slow", MIDDLE, 6, delay=0.03), table=CommandTable.of({FISH: [1.0] * 40}), log=log)
    assert not isinstance(sent, MotorError), sent
    assert sent.punctuality.skipped > 0
    times = [float(line.split(",")[1]) for line in log.getvalue().splitlines()]
    assert min(b - a for a, b in pairwise(times)) > 0.0095
