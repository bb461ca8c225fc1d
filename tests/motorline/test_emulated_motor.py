"""The emulated motor against the manual: packets, rules of writing, errors, watchdog, how it turns.

Its clock is the test's, and its packets are checked against the maker's library.
"""

import math

import dynamixel_sdk
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulator import (
    HEADER,
    PING,
    READ,
    STATUS,
    WRITE,
    EmulatedMotor,
    Packet,
    PacketParser,
    build_packet,
    crc16,
)
from motorline import control_table as ct


class Bench:
    """A motor and its clock."""

    def __init__(self) -> None:
        self.now = 100.0
        self.motor = EmulatedMotor(clock=lambda: self.now)

    def ask(self, instruction, parameters=b"", intact=True):
        answer = self.motor.answer(Packet(1, instruction, parameters, intact))
        if answer is None:
            return None
        (status,) = PacketParser().feed(answer)
        return status.parameters[0], status.parameters[1:]

    def write(self, register, value, size=None):
        data = value.to_bytes(size or register.size, "little", signed=value < 0)
        status = self.ask(WRITE, register.address.to_bytes(2, "little") + data)
        return None if status is None else status[0]

    def read(self, register):
        error, data = self.ask(READ, register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little"))
        assert error == 0
        return int.from_bytes(data, "little", signed=register.signed)

    def turning(self, goal, acceleration=0, watchdog=0):
        self.write(ct.OPERATING_MODE, ct.VELOCITY_MODE)
        self.write(ct.PROFILE_ACCELERATION, acceleration)
        self.write(ct.BUS_WATCHDOG, watchdog)
        assert self.write(ct.TORQUE_ENABLE, 1) == 0
        return self.write(ct.GOAL_VELOCITY, goal)

    def going(self, goal, speed=0, acceleration=0):
        """In position mode."""
        self.write(ct.PROFILE_VELOCITY, speed)
        self.write(ct.PROFILE_ACCELERATION, acceleration)
        assert self.write(ct.TORQUE_ENABLE, 1) == 0
        return self.write(ct.GOAL_POSITION, goal)


@pytest.fixture
def bench():
    return Bench()


@pytest.mark.parametrize(("register", "value", "size", "error"), [
    (ct.OPERATING_MODE, 17, None, ct.RANGE_ERROR),
    (ct.GOAL_VELOCITY, 305, None, ct.LIMIT_ERROR),
    (ct.GOAL_VELOCITY, -305, None, ct.LIMIT_ERROR),
    (ct.GOAL_VELOCITY, -304, None, 0),
    (ct.GOAL_VELOCITY, 1, 2, ct.LENGTH_ERROR),
    (ct.PRESENT_VELOCITY, 1, None, ct.ACCESS_ERROR),
    (ct.Register("between registers", 105, 1), 1, None, ct.ACCESS_ERROR),
    (ct.BUS_WATCHDOG, 128, None, ct.RANGE_ERROR),
    (ct.PROFILE_VELOCITY, 305, None, ct.LIMIT_ERROR),
])  # fmt: skip
def test_what_it_refuses(bench, register, value, size, error):
    before = bytes(bench.motor._table)
    assert bench.write(register, value, size) == error
    assert (bytes(bench.motor._table) != before) == (error == 0)


def test_eeprom_is_locked_while_torque_is_on_and_a_change_of_mode_resets_the_profile(bench):
    bench.write(ct.PROFILE_ACCELERATION, 50)
    assert bench.write(ct.TORQUE_ENABLE, 1) == 0
    assert bench.write(ct.OPERATING_MODE, 1) == ct.ACCESS_ERROR
    assert bench.read(ct.PROFILE_ACCELERATION) == 50
    assert bench.write(ct.TORQUE_ENABLE, 0) == 0
    assert bench.write(ct.OPERATING_MODE, 1) == 0
    assert bench.read(ct.PROFILE_ACCELERATION) == 0


def test_it_turns_at_the_goal_with_the_acceleration_it_was_given_and_runs_out_without_torque(bench):
    bench.turning(200, acceleration=40)
    steepness, goal = 40 * ct.ACCELERATION_UNIT, 200 * ct.VELOCITY_UNIT
    bench.now += 0.1
    assert bench.motor.velocity == pytest.approx(steepness * 0.1)
    assert bench.motor.angle == pytest.approx(steepness * 0.1**2 / 2)
    bench.now += 10.0
    assert bench.motor.velocity == pytest.approx(goal)
    ramp = goal / steepness
    assert bench.motor.angle == pytest.approx(goal * ramp / 2 + goal * (10.1 - ramp))
    assert bench.read(ct.PRESENT_VELOCITY) == 200
    assert bench.read(ct.PRESENT_POSITION) == pytest.approx(bench.motor.angle / ct.POSITION_UNIT, abs=1)
    bench.write(ct.TORQUE_ENABLE, 0)
    bench.now += 1
    assert bench.motor.velocity == 0


def test_it_goes_to_an_angle_with_the_speed_and_the_acceleration_of_its_profile(bench):
    bench.going(2048, speed=100, acceleration=20)
    fastest, steepness = 100 * ct.VELOCITY_UNIT, 20 * ct.ACCELERATION_UNIT
    bench.now += 0.1
    assert bench.motor.velocity == pytest.approx(0.1 * steepness)
    bench.now += 0.5
    assert bench.motor.velocity == pytest.approx(fastest)
    bench.now += math.pi / fastest + fastest / steepness - 0.6 - 0.1
    assert bench.motor.velocity == pytest.approx(0.1 * steepness)
    bench.now += 0.11
    assert (bench.motor.velocity, bench.read(ct.PRESENT_POSITION)) == (0, 2048)


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 4095), st.floats(0.01, 0.5)), min_size=1, max_size=5), st.booleans())
def test_the_place_where_it_looks_doesnt_matter(goals, angles):
    often, once = Bench(), Bench()
    for goal, seconds in goals:
        for one, looks in ((often, 7), (once, 1)):
            if angles:
                one.going(goal, speed=200, acceleration=50)
            else:
                one.write(ct.TORQUE_ENABLE, 0)
                one.turning(goal % 300, acceleration=20)
            for _ in range(looks):
                one.now += seconds / looks
                assert abs(one.motor.velocity) <= (200 if angles else 300) * ct.VELOCITY_UNIT * (1 + 1e-9)
    assert often.motor.angle == pytest.approx(once.motor.angle, abs=1e-6)
    often.now += 10
    assert not angles or often.motor.angle == pytest.approx(goals[-1][0] * ct.POSITION_UNIT)


def test_the_watchdog_stops_it_as_in_the_manuals_example(bench):
    bench.turning(50, watchdog=100)
    bench.now += 1.99
    assert bench.motor.velocity > 0
    assert not bench.motor.watchdog_tripped
    bench.now += 0.5
    assert bench.motor.velocity == 0
    assert bench.motor.watchdog_tripped
    assert bench.write(ct.GOAL_VELOCITY, 150) == ct.RANGE_ERROR
    assert bench.write(ct.BUS_WATCHDOG, 0) == 0
    assert bench.write(ct.GOAL_VELOCITY, 150) == 0
    bench.now += 1
    assert bench.motor.velocity == pytest.approx(150 * ct.VELOCITY_UNIT)


@pytest.mark.parametrize(
    ("packet", "instruction", "parameters"),
    [  # e-Manual, Protocol 2.0: ping, read of 132, write of 512 to 116, and the status of the read
        ("fffffd00 01 0300 01 194e", PING, ""),
        ("fffffd00 01 0700 02 84000400 1d15", READ, "84000400"),
        ("fffffd00 01 0900 03 7400 00020000 ca89", WRITE, "740000020000"),
        ("fffffd00 01 0800 55 00 a6000000 8cc0", STATUS, "00a6000000"),
    ],
)
def test_the_manuals_examples(packet, instruction, parameters):
    assert build_packet(1, instruction, bytes.fromhex(parameters)) == bytes.fromhex(packet)


stuffed = st.lists(st.sampled_from([b"\xff\xff\xfd", b"\xff", b"\xfd", b"\x00", b"\x41"]), max_size=12).map(b"".join)


@settings(max_examples=25)
@given(stuffed, st.binary(min_size=1, max_size=8), st.integers(1, 9))
def test_packets_survive_noise_and_arriving_in_pieces(parameters, noise, size):
    theirs = dynamixel_sdk.Protocol2PacketHandler().updateCRC(0, list(parameters + noise), len(parameters + noise))
    assert crc16(parameters + noise) == theirs
    packet = build_packet(7, WRITE, parameters)
    assert packet.count(HEADER) == 1
    stream = noise.replace(b"\xff", b"") + packet + build_packet(7, PING)
    parser = PacketParser()
    received = [packet for k in range(0, len(stream), size) for packet in parser.feed(stream[k : k + size])]
    assert received == [Packet(7, WRITE, parameters), Packet(7, PING, b"")]


def test_a_damaged_packet_is_known_and_an_impossible_length_passed_over():
    whole = build_packet(1, WRITE, b"\x40\x00\x01")
    damaged = whole[:-3] + bytes([whole[-3] ^ 1]) + whole[-2:]
    impossible = HEADER + b"\x01\xff\xff"
    received = PacketParser().feed(damaged + impossible + build_packet(1, PING))
    assert [(p.instruction, p.intact) for p in received] == [(WRITE, False), (PING, True)]
