"""Motors on a bus, through the maker's library, against emulated ones: the fish's, and two angles beside a speed."""

import csv
import importlib
import math
import re
import sys
import time
from pathlib import Path

import pytest

import motorline
from emulator import BROADCAST, PING, SYNC_WRITE, WRITE, EmulatedMotor, Emulator
from faulty_motors import Fault, FaultyEmulator
from motorline import FISH, XW540_T140, CommandTable, MotorError, MotorLimits, MotorSettings, fish_motor
from motorline import control_table as ct
from motorline.bus import Bus
from motorline.control_table import NoAnswerError
from motorline.motors import Motors
from motorline.sending import check_time, open_log, send
from swimbase.errors import ArgumentError, MissingExtraError

TABLE = CommandTable.of({FISH: [0.0, 2.0, 4.0]})
XL430 = ct.MODELS["XL430-W250"]
LIMITS = MotorLimits(4.0, 100.0, -1.0, 1.0)
THREE = (
    MotorSettings("head_rad", 2, LIMITS, XL430, zero=math.pi),
    MotorSettings("tail_rad", 7, LIMITS, XL430, direction=-1, zero=2.0),
    MotorSettings("wheel_rad_s", 5, MotorLimits(5.0, 100.0)),
)
MIDDLE = 100  # packets; it takes about 60 to start


@pytest.fixture
def emulated():
    with Emulator() as emulator:
        yield emulator


def three(*faults, baud=None) -> Emulator:
    return FaultyEmulator(
        EmulatedMotor(2, XL430, angle=math.pi - 0.1), EmulatedMotor(7, XL430, angle=2.0), EmulatedMotor(5),
        faults=faults, baud=baud,
    )  # fmt: skip


def commands(seconds=0.6):
    """A table for the three."""
    angles = [0.3 * math.sin(2 * math.pi * i / 50) for i in range(round(50 * seconds))]
    speeds = [2.0] * len(angles)
    return CommandTable.of({"head_rad": angles, "tail_rad": [-a for a in angles], "wheel_rad_s": speeds}).ramped(50.0)


def start(bus, settings=None, table=None, then=lambda motors, table: None, watchdog=0.2, approach=0.5):
    """Identifies motors, starts them, and stops them after what is to be done then, whose result is returned."""
    with Motors(bus, settings or [fish_motor()], watchdog) as motors:
        motors.identify()
        return then(motors, motors.start(table or TABLE, approach))


def swim(*faults, log=None, table=None, baud=None):
    """Sends a table to the three with these faults; the emulator, and what was sent or the error."""
    with three(*faults, baud=baud) as emulator:
        try:
            with Bus(emulator.port) as bus:  # a watchdog of 1 s, so that a busy machine doesn't trip it
                send_it = lambda motors, started: send(motors, started, log)  # noqa: E731
                return emulator, start(bus, THREE, table or commands(), send_it, 1.0, approach=2.0)
        except MotorError as error:
            assert emulator.stopped()
            return emulator, error


def off(emulator) -> bool:
    return not any(motor.get(ct.TORQUE_ENABLE) for motor in emulator.motors)


def test_registers_of_every_size_and_values_like_a_header_arrive(emulated):
    with Bus(emulated.port) as bus:
        assert bus.ping(1) == 1180
        for register, value in ((ct.TORQUE_ENABLE, 1), (ct.GOAL_VELOCITY, -304), (ct.PROFILE_ACCELERATION, 32_767)):
            bus.write(1, register, value)
            assert bus.read(1, register) == value
        block = bus.read_block(1, ct.MODEL_REGISTER, ct.SHUTDOWN)
        assert (block[ct.VELOCITY_LIMIT], block[ct.MODEL_REGISTER]) == (304, 1180)
    value = int.from_bytes(b"\xff\xff\xfd\x00", "little")
    with Bus(emulated.port) as bus, pytest.raises(MotorError, match="beyond the motor's own limit"):
        bus.write(1, ct.Register("goal", 104, 4), value)
    assert emulated.packets[-1][1].parameters == b"\x68\x00\xff\xff\xfd\x00"


@pytest.mark.parametrize(("register", "value", "reason"), [
    (ct.OPERATING_MODE, 99, "the value is outside the register's range"),
    (ct.GOAL_VELOCITY, 400, "the value is beyond the motor's own limit"),
    (ct.PRESENT_VELOCITY, 1, "the register can't be written now (read-only, or locked while torque is on)"),
])  # fmt: skip
def test_a_refusal_is_a_sentence(emulated, register, value, reason):
    sentence = f"motor 1 on {emulated.port} refused writing {value} to {register}: {reason}"
    with Bus(emulated.port) as bus, pytest.raises(MotorError, match=re.escape(sentence)):
        bus.write(1, register, value)


def test_identity():
    motor = EmulatedMotor(device=7)
    motor.set(ct.DRIVE_MODE, ct.REVERSE)
    motor.set(ct.VELOCITY_LIMIT, 200)
    with Emulator(motor) as emulator, Bus(emulator.port, 1_000_000) as bus, Motors(bus, [fish_motor(7)]) as driver:
        (identity,) = driver.identify()
    assert identity.velocity_limit == pytest.approx(4.796, abs=0.001)
    assert (identity.voltage, identity.temperature, identity.temperature_limit) == (12.0, 30, 80)
    assert identity.reversed


def test_it_is_started_commanded_read_and_stopped(emulated):
    def then(motors, table):
        assert emulated.motor.get(ct.OPERATING_MODE) == ct.VELOCITY_MODE
        assert emulated.motor.get(ct.BUS_WATCHDOG) == 10
        steepness = emulated.motor.get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT
        assert XW540_T140.acceleration <= steepness < XW540_T140.acceleration + ct.ACCELERATION_UNIT
        (sent,) = motors.command((4.0,))
        assert sent == pytest.approx(4.0, abs=ct.VELOCITY_UNIT / 2)
        time.sleep(0.1)
        reading = motors.each[0].read()
        assert reading.velocity == pytest.approx(sent, abs=0.01)
        assert reading.temperature is None
        time.sleep(0.02)
        whole = motors.each[0].read(whole=True)
        assert whole.position > reading.position > 0
        assert (whole.voltage, whole.temperature) == (12.0, 30)

    with Bus(emulated.port) as bus:
        start(bus, then=then)
    assert emulated.velocity() == 0
    assert emulated.motor.get(ct.TORQUE_ENABLE) == emulated.motor.get(ct.BUS_WATCHDOG) == 0
    written = [packet.parameters for _, packet in emulated.packets if packet.instruction == WRITE]
    assert [p for p in written if p[0] == ct.GOAL_VELOCITY.address][-1][2:] == bytes(4)


def test_whatever_happens_it_stops(emulated):
    def then(motors, table):
        motors.command((4.0,))
        time.sleep(0.05)
        assert emulated.velocity() > 1
        raise ZeroDivisionError

    with Bus(emulated.port) as bus, pytest.raises(ZeroDivisionError):
        start(bus, then=then)
    assert emulated.velocity() == 0
    assert off(emulated)


def test_eeprom_isnt_worn_by_setting_a_mode_that_is_set(emulated):
    emulated.motor.set(ct.OPERATING_MODE, ct.VELOCITY_MODE)
    with Bus(emulated.port) as bus:
        start(bus)
    written = [p.parameters[0] for _, p in emulated.packets if p.instruction == WRITE]
    assert ct.OPERATING_MODE.address not in written


@pytest.mark.parametrize("level", [0, 1])
def test_a_motor_that_was_set_to_keep_silent_is_made_to_answer(emulated, level):
    emulated.motor.set(ct.STATUS_RETURN_LEVEL, level)
    with Bus(emulated.port) as bus:
        start(bus, then=lambda motors, table: motors.command((1.0,)))


def test_a_motor_whose_watchdog_had_tripped_is_started(emulated):
    emulated.motor.set(ct.BUS_WATCHDOG, ct.WATCHDOG_TRIPPED)
    emulated.motor.set(ct.TORQUE_ENABLE, 1)
    emulated.motor.set(ct.GOAL_VELOCITY, 200)

    def then(motors, table):
        time.sleep(0.05)
        assert emulated.velocity() == 0  # nothing is left of the old goal
        motors.command((1.0,))

    with Bus(emulated.port) as bus:
        start(bus, then=then)


@pytest.mark.parametrize(("register", "value", "sentence"), [
    (ct.MAX_POSITION, 2100, "the table asks motor head (id 2) for 0.2994 rad; its own Min and Max Position"),
    (ct.MIN_POSITION, 2020, "motor head (id 2) is at -0.1012 rad; its own Min and Max Position Limit (52, 48)"),
    (ct.VELOCITY_LIMIT, 50, "the table asks motor head (id 2) for 1.88 rad/s; its own Velocity Limit (44) is 50"),
    (ct.FIRMWARE, 37, "motor head (id 2) has firmware 37, without the watchdog that stops it"),
    (ct.HOMING_OFFSET, 100, "motor head (id 2) has Homing Offset (20) 100; it must be 0"),
    (ct.HARDWARE_ERROR, 0x24, "reports overheating, overload (Hardware Error Status (70) is 36)"),
    (ct.DRIVE_MODE, ct.TIME_BASED_PROFILE, "Drive Mode 4, with a time-based profile; switch it"),
    (ct.MODEL_REGISTER, 1020, "has model number 1020 (XM430-W350), not 1060 (XL430-W250)"),
])  # fmt: skip
def test_motors_that_cant_be_started(register, value, sentence):
    table = CommandTable.of({name: [0.0] for name in commands().columns}) if register is ct.MIN_POSITION else commands()
    with three() as emulator, Bus(emulator.port) as bus:
        emulator.motor.set(register, value)
        with pytest.raises(MotorError, match=re.escape(sentence)):
            start(bus, THREE, table)
        assert off(emulator)
        sent = {packet.instruction for _, packet in emulator.packets if packet.id == 2}
        assert (sent == {PING}) == (register is ct.MODEL_REGISTER)  # another model is left alone


def test_after_a_halt_the_watchdog_is_named(emulated):
    def then(motors, table):
        motors.command((4.0,))
        time.sleep(0.35)
        assert emulated.velocity() == 0
        motors.command((4.0,))

    with (
        Bus(emulated.port) as bus,
        pytest.raises(MotorError, match=r"watchdog of motor 1 has stopped it: for 0\.2 s no packet came"),
    ):
        start(bus, then=then)
    assert off(emulated)


def test_halted_the_watchdogs_of_several_are_named():
    halt = iter([0.0] * 10 + [0.4])

    def then(motors, table):
        send(motors, table, stop=lambda: bool(time.sleep(next(halt, 0.0))))

    with three() as emulator, Bus(emulator.port) as bus:
        with pytest.raises(MotorError, match=r"the watchdog of motor \w+ \(id \d\) has stopped it: for 0\.2 s no"):
            start(bus, THREE, commands(2.0), then, approach=2.0)
        assert off(emulator)


@pytest.mark.slow
def test_nobody_at_that_id(emulated):
    with Bus(emulated.port) as bus, pytest.raises(NoAnswerError, match=r"motor 2 on .* didn't answer a ping at 57600"):
        bus.ping(2)


def test_a_line_that_takes_too_long_is_no_lost_port(emulated):
    with Bus(emulated.port) as bus:
        line = bus._port.ser
        line.write_timeout = 1e-9  # as after a halt of the whole program
        with pytest.raises(NoAnswerError, match="didn't answer a ping"):
            bus.ping(1)
        line.write_timeout = 1.0
        assert bus.ping(1) == 1180


def test_ports_and_arguments_that_cant_be_used(tmp_path, emulated, monkeypatch):
    with pytest.raises(ArgumentError, match="id is 253; ids are 0 to 252"):
        fish_motor(253)
    with pytest.raises(ArgumentError, match="9600 baud can't be used for 50"):
        Bus(emulated.port, 9600)
    (tmp_path / "file").write_text("")
    for name, reason in ((str(tmp_path / "none"), "No such file"), (str(tmp_path / "file"), "")):
        with pytest.raises(MotorError, match=f"{re.escape(name)} can't be opened .*{reason}.* is the U2D2 plugged in"):
            Bus(name)
    with Bus(emulated.port), pytest.raises(MotorError, match=r"Resource temporarily unavailable.*nobody else using it"):
        Bus(emulated.port)
    monkeypatch.setitem(sys.modules, "dynamixel_sdk", None)
    monkeypatch.delitem(sys.modules, "motorline.bus")
    with pytest.raises(MissingExtraError, match="pip install dynamixel-sdk"):
        importlib.import_module("motorline.bus")


def test_mixed_modes_follow_the_table_and_all_are_stopped(tmp_path):
    with open_log(tmp_path / "log.csv", THREE) as log:
        emulator, sent = swim(log=log)
    header, *rows = csv.reader((tmp_path / "log.csv").read_text().splitlines())
    assert not isinstance(sent, MotorError), sent
    assert sent.complete
    assert (sent.temperature, sent.voltage) == (30, 12.0)
    assert off(emulator)
    assert emulator.velocity() == 0
    head, tail, wheel = emulator.motors
    end = commands().rows[-1]
    assert [m.get(ct.OPERATING_MODE) for m in emulator.motors] == [3, 3, 1]
    assert head.angle == pytest.approx(math.pi + end[0], abs=0.01)
    assert tail.angle == pytest.approx(2.0 - end[1], abs=0.01)
    assert 0.7 < wheel.angle < 2.5  # later where the machine is busy
    assert header[2:7] == ["command_head_rad", "command_tail_rad", "command_wheel_rad_s", "motor", "answered"]
    assert {len(row) for row in rows} == {len(header)}
    asked = [dict(zip(header, row, strict=True)) for row in rows if row[5]]
    assert {row["motor"] for row in asked} == {"head", "tail", "wheel"}
    late = [row for row in asked if row["motor"] == "tail" and row["position_rad"] and float(row["due_s"]) > 0.5]
    assert all(abs(float(row["position_rad"]) - float(row["command_tail_rad"])) < 0.1 for row in late)
    assert float(rows[0][2]) == pytest.approx(-0.1, abs=0.002)  # where the head was
    # a row is one packet a mode, and nobody confirms it
    together = [packet for _, packet in emulator.packets if packet.id == BROADCAST]
    assert {packet.instruction for packet in together} == {SYNC_WRITE}
    assert all(len(packet.parameters) in (4 + 5, 4 + 10, 4 + 6) for packet in together)
    assert len(together) >= 2 * sent.punctuality.sent
    assert not [p for _, p in emulator.packets if p.instruction == WRITE and p.parameters[:1] == b"\x68" and p.id != 5]


def test_no_motor_is_faster_or_steeper_than_its_limits():
    def then(motors, table):
        for settings, motor in zip(THREE[:2], emulator.motors[:2], strict=True):
            assert motor.get(ct.TORQUE_ENABLE)
            assert motor.get(ct.GOAL_POSITION) == motor.get(ct.PRESENT_POSITION)  # they hold where they are
            speed = motor.get(ct.PROFILE_VELOCITY) * ct.VELOCITY_UNIT
            assert settings.limits.speed <= speed < settings.limits.speed + ct.VELOCITY_UNIT
            assert motor.get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT == pytest.approx(100, abs=0.4)

    with three() as emulator, Bus(emulator.port) as bus:
        start(bus, THREE, commands(), then)


def test_one_alone_confirms_its_angles():
    def then(motors, table):
        assert len(table.rows) == 21 + 1  # 0.2012 rad at 0.5 rad/s, since the encoder rounds down
        assert motors.command((0.1,)) == pytest.approx((0.1,), abs=0.001)
        assert emulator.packets[-1][1].instruction == WRITE
        time.sleep(0.15)
        assert motors.each[0].read().position == pytest.approx(0.1, abs=0.005)

    with three() as emulator, Bus(emulator.port) as bus:
        start(bus, THREE[:1], CommandTable.of({"head_rad": [0.1]}), then)


def test_an_overheated_one_stops_all():
    emulator, error = swim(Fault("overheated", MIDDLE, device=7))
    assert "motor tail (id 7) reports overheating (Hardware Error Status (70) is 4)" in str(error)
    assert off(emulator)


@pytest.mark.slow
def test_one_that_is_dead_stops_the_others_at_once():
    emulator, error = swim(Fault("silent", MIDDLE, device=7), table=commands(3.0))
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
    assert "didn't answer a ping" in str(error)
    assert not any(p.instruction == WRITE and p.parameters[:3] == b"\x40\0\1" for _, p in emulator.packets)  # no torque


@pytest.mark.parametrize(
    ("faults", "baud"), [((Fault("silent", MIDDLE, 1), Fault("bad-crc", MIDDLE + 8, 1)), None), ((), 57_600)]
)
def test_missing_answers_are_counted_and_a_slow_line_is_enough_for_three(faults, baud):
    emulator, sent = swim(*faults, baud=baud)
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


def test_the_example_of_the_readme_is_right(emulated):
    text = (Path(motorline.__file__).parent / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(example.replace("/dev/ttyUSB0", emulated.port), names)
    assert names["result"].complete
    assert emulated.motor.angle == pytest.approx(2.0 * 2 + 2.0 * 0.1, abs=0.1)  # two seconds, and ramps of 0.1 s
    assert off(emulated)
