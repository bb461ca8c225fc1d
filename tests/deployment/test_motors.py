"""Several motors on one bus, through the maker's library, against emulated ones: two follow angles, one a speed."""

import csv
import io
import math
import time

import pytest

from swim2real.deployment import CommandTable, Limits, MotorError, MotorSettings
from swim2real.deployment import control_table as ct
from swim2real.deployment.bus import Bus
from swim2real.deployment.emulated_motor import BROADCAST, PING, SYNC_WRITE, WRITE, EmulatedMotor
from swim2real.deployment.emulator import Emulator, Fault
from swim2real.deployment.motors import Motors
from swim2real.deployment.sending import check_time, log_header, send
from swim2real.errors import ArgumentError

XL430 = ct.model_named("XL430-W250")
assert XL430
LIMITS = Limits(4.0, 100.0, -1.0, 1.0)
SETTINGS = (
    MotorSettings("head_rad", 2, LIMITS, XL430, zero=math.pi),
    MotorSettings("tail_rad", 7, LIMITS, XL430, direction=-1, zero=2.0),
    MotorSettings("wheel_rad_s", 5, Limits(5.0, 100.0)),
)
WATCHDOG = 1.0  # s, so that a busy machine doesn't trip it
MIDDLE = 100  # packets; it takes about 60 to start


def table(seconds=0.6):
    k = range(round(50 * seconds))
    angles = [0.3 * math.sin(2 * math.pi * i / 50) for i in k]
    return CommandTable.of({"head_rad": angles, "tail_rad": [-a for a in angles], "wheel_rad_s": [2.0] * len(k)})


def emulated(*faults, baud=None) -> Emulator:
    return Emulator(
        EmulatedMotor(2, XL430, angle=math.pi - 0.1), EmulatedMotor(7, XL430, angle=2.0), EmulatedMotor(5),
        faults=faults, baud=baud,
    )  # fmt: skip


def swim(*faults, log=None, commands=None, **options):
    """Sends a table to motors with these faults; the emulator and what was sent, or the error."""
    with emulated(*faults, **options) as emulator:
        try:
            with Bus(emulator.port) as bus, Motors(bus, SETTINGS, WATCHDOG) as motors:
                motors.identify()
                started = motors.start((commands or table()).ramped(50.0), approach=2.0)
                return emulator, send(motors, started, log)
        except MotorError as error:
            emulator.velocity()
            return emulator, error


def refusal(bus, commands=None) -> str:
    """Why motors aren't started."""

    def start():
        with Motors(bus, SETTINGS) as motors:
            motors.identify()
            motors.start(commands or table().ramped(50.0))

    with pytest.raises(MotorError) as refused:
        start()
    return str(refused.value)


def off(emulator) -> bool:
    return not any(motor.get(ct.TORQUE_ENABLE) for motor in emulator.motors)


@pytest.fixture(scope="module")
def swum():
    log = io.StringIO()
    return *swim(log=log), list(csv.reader(log.getvalue().splitlines()))


def test_mixed_modes_follow_the_table_and_all_are_stopped(swum):
    emulator, sent, rows = swum
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert (sent.temperature, sent.voltage) == (30, 12.0)
    assert off(emulator)
    assert emulator.velocity() == 0
    head, tail, wheel = emulator.motors
    end = table().rows[-1]
    assert [m.get(ct.OPERATING_MODE) for m in emulator.motors] == [3, 3, 1]
    assert head.angle == pytest.approx(math.pi + end[0], abs=0.01)
    assert tail.angle == pytest.approx(2.0 - end[1], abs=0.01)
    assert 0.7 < wheel.angle < 1.6
    header = log_header(SETTINGS)
    assert header[2:7] == ("command_head_rad", "command_tail_rad", "command_wheel_rad_s", "motor", "answered")
    assert {len(row) for row in rows} == {len(header)}
    asked = [dict(zip(header, row, strict=True)) for row in rows if row[5]]
    assert {row["motor"] for row in asked} == {"head", "tail", "wheel"}
    late = [row for row in asked if row["motor"] == "tail" and row["position_rad"] and float(row["due_s"]) > 0.5]
    assert all(abs(float(row["position_rad"]) - float(row["command_tail_rad"])) < 0.1 for row in late)
    assert float(rows[0][2]) == pytest.approx(-0.1, abs=0.002)  # where the head was


def test_a_row_is_one_packet_a_mode_and_nobody_confirms_it(swum):
    emulator, sent, _ = swum
    together = [packet for _, packet in emulator.packets if packet.id == BROADCAST]
    assert {packet.instruction for packet in together} == {SYNC_WRITE}
    assert all(len(packet.parameters) in (4 + 5, 4 + 10, 4 + 6) for packet in together)
    assert len(together) >= 2 * sent.punctuality.sent
    assert not [p for _, p in emulator.packets if p.instruction == WRITE and p.parameters[:1] == b"\x68" and p.id != 5]


def test_no_motor_is_faster_or_steeper_than_its_limits():
    with emulated() as emulator, Bus(emulator.port) as bus, Motors(bus, SETTINGS) as motors:
        motors.identify()
        motors.start(table().ramped(50.0))
        for settings, motor in zip(SETTINGS[:2], emulator.motors[:2], strict=True):
            assert motor.get(ct.TORQUE_ENABLE)
            assert motor.get(ct.GOAL_POSITION) == motor.get(ct.PRESENT_POSITION)  # they hold where they are
            speed = motor.get(ct.PROFILE_VELOCITY) * ct.VELOCITY_UNIT
            assert settings.limits.speed <= speed < settings.limits.speed + ct.VELOCITY_UNIT
            assert motor.get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT == pytest.approx(100, abs=0.4)


def test_one_alone_confirms_its_angles():
    with emulated() as emulator, Bus(emulator.port) as bus, Motors(bus, SETTINGS[:1]) as motors:
        motors.identify()
        started = motors.start(CommandTable.of({"head_rad": [0.1]}))
        assert len(started.rows) == 21 + 1  # 0.2012 rad at 0.5 rad/s, since the encoder rounds down
        assert motors.command((0.1,)) == pytest.approx((0.1,), abs=0.001)
        assert emulator.packets[-1][1].instruction == WRITE
        time.sleep(0.15)
        assert motors.each[0].read().position == pytest.approx(0.1, abs=0.005)


def test_an_overheated_one_stops_all():
    emulator, error = swim(Fault("overheated", MIDDLE, device=7))
    assert "motor tail (id 7) reports overheating (Hardware Error Status (70) is 4)" in str(error)
    assert off(emulator)
    assert emulator.velocity() == 0


@pytest.mark.slow
def test_one_that_is_dead_stops_the_others_at_once():
    emulator, error = swim(Fault("silent", MIDDLE, device=7), commands=table(3.0))
    assert "motor tail (id 7): 4 readings in a row without an answer: motor 7 on" in str(error)
    assert off(emulator)  # it hears what it doesn't answer
    times = [at for at, packet in emulator.packets if packet.id == BROADCAST]
    zero = next(at for at, p in emulator.packets if p.instruction == SYNC_WRITE and p.parameters[4:] == b"\x05\0\0\0\0")
    assert times[-1] > zero
    dead = [at for at, packet in emulator.packets if packet.id == 7 and at > zero]
    assert dead[0] > zero  # speed 0 goes out before anybody asks the dead one again


@pytest.mark.slow
def test_one_that_never_answered():
    emulator, error = swim(Fault("silent", device=7))
    assert "motor 7 on" in str(error)
    assert "didn't answer a ping" in str(error)
    assert not any(p.instruction == WRITE and p.parameters[:3] == b"\x40\0\1" for _, p in emulator.packets)  # no torque


def test_one_missing_answer_is_counted_and_the_swim_goes_on():
    emulator, sent = swim(Fault("silent", MIDDLE, 1), Fault("bad-crc", MIDDLE + 8, 1))
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert off(emulator)


def test_halted_the_watchdogs_are_named():
    with emulated() as emulator, Bus(emulator.port) as bus:

        def halted():
            halt = iter([0.0] * 10 + [0.4])
            with Motors(bus, SETTINGS, 0.2) as motors:
                motors.identify()
                started = motors.start(table(2.0).ramped(50.0), approach=2.0)
                send(motors, started, stop=lambda: bool(time.sleep(next(halt, 0.0))))

        with pytest.raises(MotorError, match=r"the watchdog of motor \w+ \(id \d\) has stopped it: for 0\.2 s no"):
            halted()
        assert off(emulator)


def test_the_time_of_a_slow_line_is_enough_for_three():
    emulator, sent = swim(baud=57_600)
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert sent.unread <= 3
    assert off(emulator)


def test_more_motors_than_the_line_has_time_for():
    motors = [MotorSettings(f"m{k}_rad", k, LIMITS, zero=math.pi) for k in range(6)]
    check_time(motors[:5], 57_600)
    check_time(motors * 8, 1_000_000)
    with pytest.raises(ArgumentError, match=r"at 57600 baud a command to 6 motors and a reading of one take 19\.3 ms"):
        check_time(motors, 57_600)


@pytest.mark.parametrize(
    ("register", "value", "sentence"),
    [
        (ct.MAX_POSITION, 2100, "the table asks motor head (id 2) for 0.2994 rad; its own Min and Max Position"),
        (ct.VELOCITY_LIMIT, 50, "the table asks motor head (id 2) for 1.88 rad/s; its own Velocity Limit (44) is 50"),
        (ct.FIRMWARE, 37, "motor head (id 2) has firmware 37, without the watchdog that stops it"),
        (ct.HOMING_OFFSET, 100, "motor head (id 2) has Homing Offset (20) 100; it must be 0"),
    ],
)
def test_a_motor_with_other_limits_of_its_own(register, value, sentence):
    with emulated() as emulator, Bus(emulator.port) as bus:
        emulator.motor.set(register, value)
        assert sentence in refusal(bus)
        assert off(emulator)


def test_a_motor_that_stands_beyond_its_own_limits():
    with emulated() as emulator, Bus(emulator.port) as bus:
        emulator.motor.set(ct.MIN_POSITION, 2020)
        sentence = refusal(bus, CommandTable.of({"head_rad": [0.0], "tail_rad": [0.0], "wheel_rad_s": [0.0]}))
        assert "motor head (id 2) is at -0.1012 rad; its own Min and Max Position Limit (52, 48) allow" in sentence
        assert "turn it there by hand" in sentence


def test_another_model_among_them_is_left_alone():
    with Emulator(EmulatedMotor(2, XL430), EmulatedMotor(7), EmulatedMotor(5)) as emulator, Bus(emulator.port) as bus:
        assert "has model number 1180 (XW540-T140-R), not 1060 (XL430-W250)" in refusal(bus)
        assert {packet.instruction for _, packet in emulator.packets if packet.id == 7} == {PING}
