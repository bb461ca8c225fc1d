"""What isn't a motor's answer: it is told in a sentence, in bounded time, and the motor is stopped."""

import contextlib
import math
import os
import random
import resource
import threading
import time
import tty

import pytest

from swim2real.deployment import FISH, CommandTable, MotorError, fish_motor
from swim2real.deployment import control_table as ct
from swim2real.deployment.bus import Bus
from swim2real.deployment.commands import Limits
from swim2real.deployment.emulated_motor import READ, STATUS, EmulatedMotor, PacketParser, build_packet
from swim2real.deployment.emulator import Emulator, Fault
from swim2real.deployment.motors import Motors
from swim2real.deployment.motors_file import MotorSettings
from swim2real.deployment.sending import send

TABLE = CommandTable.of({FISH: [2.0] * 100})
MIDDLE = 30  # packets; it takes about 15 to start
KINDS = ("echo", "half", "flood", "chatter")
ENDLESS = "got bytes without end that aren't the answer; is another program or device talking on /dev/pts/"
SENTENCES = {"echo": "got a damaged answer", "half": "got a damaged answer", "flood": ENDLESS, "chatter": ENDLESS}


def swim(*faults):
    """Sends a table to a motor with these faults; the emulator, the error and the seconds that it took to come."""
    with Emulator(faults=faults) as emulator:
        begun = time.monotonic()
        try:
            with Bus(emulator.port) as bus, Motors(bus, [fish_motor()]) as motors:
                motors.identify()
                motors.start(TABLE)
                send(motors, TABLE)
        except MotorError as error:
            seconds = time.monotonic() - begun
            deadline = begun + 30
            while emulator.velocity() and time.monotonic() < deadline:
                time.sleep(0.02)
            return emulator, str(error), seconds
    raise AssertionError("it was sent")


@pytest.mark.parametrize(
    "kind", [KINDS[2], *(pytest.param(kind, marks=pytest.mark.slow) for kind in (*KINDS[:2], *KINDS[3:]))]
)
def test_from_the_beginning(kind):
    emulator, said, seconds = swim(Fault(kind))
    assert SENTENCES[kind] in said
    assert "\n" not in said
    assert seconds < 15
    assert emulator.motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.parametrize(
    "kind", [KINDS[2], *(pytest.param(kind, marks=pytest.mark.slow) for kind in (*KINDS[:2], *KINDS[3:]))]
)
def test_in_the_middle_the_motor_is_stopped(kind):
    emulator, said, seconds = swim(Fault(kind, MIDDLE))
    assert "10 commands in a row without an answer: motor 1 on" in said or "watchdog" in said
    assert seconds < 20
    assert emulator.velocity() == 0
    assert emulator.motor.get(ct.TORQUE_ENABLE) == 0 or emulator.motor.watchdog_tripped


class Stranger:
    """A port behind which somebody answers whatever is sent, by a function of the bytes."""

    def __init__(self, answer):
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port, self._answer = os.ttyname(self._theirs), answer
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        os.close(self._theirs)
        self._thread.join(5)
        os.close(self._ours)

    def _serve(self):
        while True:
            try:
                asked = os.read(self._ours, 4096)
                os.write(self._ours, self._answer(asked))
            except OSError:
                return


@pytest.mark.parametrize("count", [10, pytest.param(300, marks=pytest.mark.slow)])
def test_whatever_is_answered_is_a_value_or_a_sentence(count):
    """Packets with right checksums and any id, error and length; random bytes, headers, cut and doubled packets."""
    rng = random.Random(count)

    def answer(asked):
        content = rng.choice((b"\0", b"\0", rng.randbytes(1))) + rng.randbytes(rng.choice((0, 3, 19, 4, 64, 300)))
        packet = build_packet(rng.choice((1, 1, 1, 2, 254)), rng.choice((STATUS, STATUS, 2, 0)), content)
        match rng.randrange(8):
            case 0:
                return rng.randbytes(rng.randrange(2000))
            case 1:
                return packet[: rng.randrange(len(packet) + 1)]
            case 2:
                return packet * rng.randrange(1, 9)
            case 3:
                return b"\xff\xff\xfd\x00\x01" + rng.randbytes(2) + b"\x55" + rng.randbytes(20)
            case 4:
                return asked
            case _:
                return packet

    ended = {"a value": 0, "a sentence": 0}
    with Stranger(answer) as stranger, Bus(stranger.port, 1_000_000) as bus:
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
    assert sum(ended.values()) == count
    assert min(ended.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.2, 1.0])
@pytest.mark.parametrize("column", [FISH, "tail_rad"])
def test_registers_with_any_content_are_sent_to_or_refused_in_a_sentence(column, share):
    """Ten swims with a motor that turns as told, but bytes of a share of its registers' values are others."""
    rng = random.Random(f"{column} {share}")
    angle = MotorSettings("tail_rad", 1, Limits(6.0, 100.0, -1.0, 1.0), ct.XW540, 1, math.pi)
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
        with Stranger(answer) as stranger, contextlib.suppress(MotorError):
            settings = [fish_motor() if column == FISH else angle]
            with Bus(stranger.port, 1_000_000) as bus, Motors(bus, settings) as motors:
                motors.identify()
                send(motors, motors.start(table))
        assert time.monotonic() - begun < 60
        assert motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.slow
def test_a_flood_takes_no_memory():
    with Emulator(faults=[Fault("flood")]) as emulator, Bus(emulator.port) as bus:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(MotorError, match="bytes without end"):
            bus.ping(1)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB
