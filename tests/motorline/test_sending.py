"""What goes wrong on a bus, from before the start and in the middle of a swim, and what isn't a motor's answer.

It ends in a sentence, in bounded time, and the motor is stopped.
"""

import contextlib
import io
import math
import os
import random
import resource
import threading
import time
import tty
from itertools import pairwise

import pytest

from emulator import READ, STATUS, EmulatedMotor, PacketParser, build_packet
from faulty_motors import Fault, FaultyEmulator
from motorline import FISH, CommandTable, MotorError, MotorLimits, MotorSettings, fish_motor
from motorline import control_table as ct
from motorline.bus import Bus
from motorline.motors import Motors
from motorline.sending import send

TABLE = CommandTable.of({FISH: [2.0] * 50})
WATCHDOG = 1.0  # s, so that a busy machine doesn't trip it
MIDDLE = 30  # packets; it takes about 15 to start
ENDLESS = "got bytes without end that aren't the answer; is another program or device talking on /dev/pts/"
DAMAGED = "got a damaged answer"
UNANSWERED = "10 commands in a row without an answer: motor 1 on"


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def swim(*faults, table=TABLE, log=None):
    """Sends a table to a motor with these faults; the emulator and what was sent, or the error."""
    with FaultyEmulator(faults=faults) as emulator:
        try:
            with Bus(emulator.port) as bus, Motors(bus, [fish_motor()], WATCHDOG) as motors:
                motors.identify()
                motors.start(table)
                return emulator, send(motors, table, log)
        except MotorError as error:
            assert emulator.stopped()
            return emulator, error


@pytest.mark.parametrize(
    ("kind", "first", "sentence"),
    [
        slow("silent", 0, "didn't answer a ping at 57600 baud; check power, cable, id and baud rate"),
        ("bad-crc", 0, "a ping got a damaged answer; check cable, ground and baud rate"),
        slow("garbage", 0, "a ping got a damaged answer"),
        ("unplugged", 0, "was lost while a ping"),
        ("overheated", 0, "motor 1 reports overheating (Hardware Error Status (70) is 4)"),
        slow("echo", 0, DAMAGED),
        slow("half", 0, DAMAGED),
        ("flood", 0, ENDLESS),
        slow("chatter", 0, ENDLESS),
        slow("silent", MIDDLE, UNANSWERED),
        ("bad-crc", MIDDLE, UNANSWERED),
        slow("garbage", MIDDLE, DAMAGED),
        slow("unplugged", MIDDLE, "is the cable still in? Without packets a motor's watchdog stops it"),
        ("overheated", MIDDLE, "motor 1 reports overheating"),
        ("overloaded", MIDDLE, "motor 1 reports overload (Hardware Error Status (70) is 32)"),
        slow("echo", MIDDLE, UNANSWERED),
        slow("half", MIDDLE, UNANSWERED),
        ("flood", MIDDLE, ""),  # unanswered, or the watchdog
        slow("chatter", MIDDLE, ""),
    ],
)
def test_faults_that_stop_it(kind, first, sentence):
    begun = time.monotonic()
    emulator, error = swim(Fault(kind, first))
    assert isinstance(error, MotorError)
    assert sentence in str(error)
    assert "\n" not in str(error)
    assert time.monotonic() - begun < 20
    assert emulator.motor.get(ct.TORQUE_ENABLE) == 0 or emulator.motor.watchdog_tripped
    if kind == "silent" and first:  # the watchdog stays on while nobody knows whether the torque is off
        assert emulator.motor.get(ct.GOAL_VELOCITY) == emulator.motor.get(ct.TORQUE_ENABLE) == 0
        assert emulator.motor.get(ct.BUS_WATCHDOG) > 0


@pytest.mark.parametrize("kind", ["silent", "garbage", slow("bad-crc"), slow("slow")])
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


@pytest.mark.parametrize("first", [0, 3, 7, 11])
def test_while_starting_a_lost_answer_is_asked_for_again(first):
    _, sent = swim(Fault("silent", first, 1), table=CommandTable.of({FISH: [0.5]}))
    assert not isinstance(sent, MotorError), sent
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


@contextlib.contextmanager
def stranger(answer):
    """The name of a port behind which somebody answers whatever is sent, by a function of the bytes."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)

    def serve():
        with contextlib.suppress(OSError):
            while True:
                os.write(ours, answer(os.read(ours, 4096)))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield os.ttyname(theirs)
    os.close(theirs)
    thread.join(5)
    os.close(ours)


@pytest.mark.parametrize("count", [10, slow(300)])
def test_whatever_is_answered_is_a_value_or_a_sentence(count):
    """Packets with right checksums and any id, error and length; random bytes, headers, cut and doubled packets."""
    rng = random.Random(count)

    def answer(asked):
        content = rng.choice((b"\0", b"\0", rng.randbytes(1))) + rng.randbytes(rng.choice((0, 3, 19, 4, 64, 300)))
        packet = build_packet(rng.choice((1, 1, 1, 2, 254)), rng.choice((STATUS, STATUS, 2, 0)), content)
        others = {
            0: rng.randbytes(rng.randrange(2000)), 1: packet[: rng.randrange(len(packet) + 1)], 4: asked,
            2: packet * rng.randrange(1, 9),
            3: b"\xff\xff\xfd\x00\x01" + rng.randbytes(2) + b"\x55" + rng.randbytes(20),
        }  # fmt: skip
        return others.get(rng.randrange(8), packet)

    ended = {"a value": 0, "a sentence": 0}
    with stranger(answer) as port, Bus(port, 1_000_000) as bus:
        for i in range(count):
            begun = time.monotonic()
            try:
                if i % 3 == 0:
                    bus.ping(1)
                elif i % 3 == 1:
                    bus.read_block(1, ct.PRESENT_VELOCITY, ct.PRESENT_TEMPERATURE)
                else:
                    bus.write(1, ct.GOAL_VELOCITY, 0, attempts=2)
                ended["a value"] += 1
            except MotorError:
                ended["a sentence"] += 1
            assert time.monotonic() - begun < 20
    assert min(ended.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.2, 1.0])
@pytest.mark.parametrize("column", [FISH, "tail_rad"])
def test_registers_with_any_content_are_sent_to_or_refused_in_a_sentence(column, share):
    """Ten swims with a motor that turns as commanded, but bytes of a share of its registers' values are others."""
    rng = random.Random(f"{column} {share}")
    angle = MotorSettings("tail_rad", 1, MotorLimits(6.0, 100.0, -1.0, 1.0), ct.XW540, 1, math.pi)
    table = CommandTable.of({column: [0.0, 0.02, 0.03, 0.02, 0.0]})
    for _ in range(10):
        motor, parser = EmulatedMotor(angle=math.pi), PacketParser()

        def answer(asked, motor=motor, parser=parser):
            out = b""
            for packet in parser.feed(asked):
                status = motor.answer(packet) or b""
                if packet.instruction == READ and rng.random() < share:
                    values = bytearray(motor.answer(packet)[9:-2])
                    for _ in range(rng.randint(1, 4)):
                        values[rng.randrange(len(values))] = rng.choice((0, 255, 127, 128, rng.randrange(256)))
                    status = build_packet(1, STATUS, b"\0" + values)
                out += status
            return out

        begun = time.monotonic()
        with (
            stranger(answer) as port, contextlib.suppress(MotorError), Bus(port, 1_000_000) as bus,
            Motors(bus, [fish_motor() if column == FISH else angle]) as motors,
        ):  # fmt: skip
            motors.identify()
            send(motors, motors.start(table))
        assert time.monotonic() - begun < 60
        assert motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.slow
def test_a_flood_takes_no_memory():
    with FaultyEmulator(faults=[Fault("flood")]) as emulator, Bus(emulator.port) as bus:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(MotorError, match="bytes without end"):
            bus.ping(1)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB
