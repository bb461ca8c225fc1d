"""The motor through the maker's library, against the emulated one."""

import importlib
import re
import sys
import time

import pytest

from swim2real.deployment import FISH, XW540_T140, CommandTable, MotorError, fish_motor
from swim2real.deployment import control_table as ct
from swim2real.deployment.bus import Bus
from swim2real.deployment.control_table import NoAnswerError
from swim2real.deployment.emulated_motor import PING, WRITE, EmulatedMotor
from swim2real.deployment.emulator import Emulator
from swim2real.deployment.motors import Motors
from swim2real.errors import ArgumentError, MissingExtraError

TABLE = CommandTable.of({FISH: [0.0, 2.0, 4.0]})


@pytest.fixture
def emulated():
    with Emulator() as emulator:
        yield emulator


def goals(emulator) -> list[int]:
    """The goal velocities it was sent."""
    return [
        int.from_bytes(packet.parameters[2:], "little", signed=True)
        for _, packet in emulator.packets
        if packet.instruction == WRITE and packet.parameters[:2] == bytes([104, 0])
    ]


def test_registers_of_every_size_and_sign(emulated):
    with Bus(emulated.port) as bus:
        assert bus.ping(1) == 1180
        for register, value in ((ct.TORQUE_ENABLE, 1), (ct.GOAL_VELOCITY, -304), (ct.PROFILE_ACCELERATION, 32_767)):
            bus.write(1, register, value)
            assert bus.read(1, register) == value
        block = bus.read_block(1, ct.MODEL_REGISTER, ct.SHUTDOWN)
        assert (block[ct.VELOCITY_LIMIT], block[ct.MODEL_REGISTER]) == (304, 1180)


def test_a_value_that_looks_like_a_header_arrives(emulated):
    value = int.from_bytes(b"\xff\xff\xfd\x00", "little")
    goal = ct.Register("goal", 104, 4, 0)
    with Bus(emulated.port) as bus, pytest.raises(MotorError, match="beyond the motor's own limit"):
        bus.write(1, goal, value)
    assert goals(emulated) == [value]


@pytest.mark.parametrize(
    ("register", "value", "reason"),
    [
        (ct.OPERATING_MODE, 99, "the value is outside the register's range"),
        (ct.GOAL_VELOCITY, 400, "the value is beyond the motor's own limit"),
        (ct.PRESENT_VELOCITY, 1, "the register can't be written now (read-only, or locked while torque is on)"),
    ],
)
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
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        motor.start(TABLE)
        assert emulated.motor.get(ct.OPERATING_MODE) == ct.VELOCITY_MODE
        assert emulated.motor.get(ct.BUS_WATCHDOG) == 10
        (sent,) = motor.command((4.0,))
        assert sent == pytest.approx(4.0, abs=ct.VELOCITY_UNIT / 2)
        time.sleep(0.1)
        reading = motor.each[0].read()
        assert reading.velocity == pytest.approx(sent, abs=0.01)
        assert reading.temperature is None
        time.sleep(0.02)
        whole = motor.each[0].read(whole=True)
        assert whole.position > reading.position > 0
        assert (whole.voltage, whole.temperature) == (12.0, 30)
    assert emulated.velocity() == 0
    assert goals(emulated)[-1] == 0
    assert emulated.motor.get(ct.TORQUE_ENABLE) == emulated.motor.get(ct.BUS_WATCHDOG) == 0


def test_it_is_no_steeper_than_the_limit(emulated):
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        motor.start(TABLE)
        steepness = emulated.motor.get(ct.PROFILE_ACCELERATION) * ct.ACCELERATION_UNIT
    assert XW540_T140.acceleration <= steepness < XW540_T140.acceleration + ct.ACCELERATION_UNIT


def test_whatever_happens_it_stops(emulated):
    def swim():
        with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
            motor.identify()
            motor.start(TABLE)
            motor.command((4.0,))
            time.sleep(0.05)
            assert emulated.velocity() > 1
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        swim()
    assert emulated.velocity() == 0
    assert emulated.motor.get(ct.TORQUE_ENABLE) == 0


def test_eeprom_isnt_worn_by_setting_a_mode_that_is_set(emulated):
    emulated.motor.set(ct.OPERATING_MODE, ct.VELOCITY_MODE)
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        motor.start(TABLE)
    written = [p.parameters[0] for _, p in emulated.packets if p.instruction == WRITE]
    assert ct.OPERATING_MODE.address not in written


@pytest.mark.parametrize("level", [0, 1])
def test_a_motor_that_was_told_to_keep_silent_is_made_to_answer(level):
    motor = EmulatedMotor()
    motor.set(ct.STATUS_RETURN_LEVEL, level)
    with Emulator(motor) as emulator, Bus(emulator.port) as bus, Motors(bus, [fish_motor()]) as driver:
        driver.identify()
        driver.start(TABLE)
        driver.command((1.0,))


def test_a_motor_whose_watchdog_had_tripped_is_started(emulated):
    emulated.motor.set(ct.BUS_WATCHDOG, ct.WATCHDOG_TRIPPED)
    emulated.motor.set(ct.TORQUE_ENABLE, 1)
    emulated.motor.set(ct.GOAL_VELOCITY, 200)
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        motor.start(TABLE)
        time.sleep(0.05)
        assert emulated.velocity() == 0  # nothing is left of the old goal
        motor.command((1.0,))


def test_another_model_is_left_alone():
    with Emulator(EmulatedMotor(model=ct.model_named("XL430-W250"))) as emulator:
        with (
            Bus(emulator.port) as bus,
            pytest.raises(MotorError, match=r"has model number 1060 \(XL430-W250\), not 1180 \(XW540-T140-R\)"),
            Motors(bus, [fish_motor()]) as motor,
        ):
            motor.identify()
        assert {packet.instruction for _, packet in emulator.packets} == {PING}


def test_a_motor_that_hung_in_an_error_says_which():
    hot = EmulatedMotor()
    hot.set(ct.HARDWARE_ERROR, 0x24)
    with (
        Emulator(hot) as emulator,
        Bus(emulator.port) as bus,
        pytest.raises(
            MotorError, match=r"motor 1 reports overheating, overload \(Hardware Error Status \(70\) is 36\)"
        ),
        Motors(bus, [fish_motor()]) as motor,
    ):
        motor.identify()


def test_a_time_based_profile_is_refused():
    motor = EmulatedMotor()
    motor.set(ct.DRIVE_MODE, ct.TIME_BASED_PROFILE)
    with (
        Emulator(motor) as emulator,
        Bus(emulator.port) as bus,
        pytest.raises(MotorError, match="Drive Mode 4, with a time-based profile; switch it"),
        Motors(bus, [fish_motor()]) as driver,
    ):
        driver.identify()


def test_the_motors_own_limit_is_respected(emulated):
    emulated.motor.set(ct.VELOCITY_LIMIT, 100)
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        with pytest.raises(
            MotorError, match=r"asks motor 1 for 4 rad/s; its own Velocity Limit \(44\) is 100, 2\.4 rad"
        ):
            motor.start(TABLE)
        assert emulated.motor.get(ct.TORQUE_ENABLE) == 0


def test_after_a_halt_the_watchdog_is_named(emulated):
    with Bus(emulated.port) as bus, Motors(bus, [fish_motor()]) as motor:
        motor.identify()
        motor.start(TABLE)
        motor.command((4.0,))
        time.sleep(0.35)
        assert emulated.velocity() == 0
        with pytest.raises(MotorError, match=r"watchdog of motor 1 has stopped it: for 0\.2 s no packet came"):
            motor.command((4.0,))
    assert emulated.motor.get(ct.TORQUE_ENABLE) == 0


@pytest.mark.slow
def test_nobody_at_that_id(emulated):
    with (
        Bus(emulated.port) as bus,
        pytest.raises(NoAnswerError, match=r"motor 2 on .* didn't answer a ping at 57600"),
    ):
        bus.ping(2)


def test_a_line_that_takes_too_long_is_no_lost_port(emulated):
    with Bus(emulated.port) as bus:
        line = bus._port.ser
        line.write_timeout = 1e-9  # as after a halt of the whole program
        with pytest.raises(NoAnswerError, match="didn't answer a ping"):
            bus.ping(1)
        line.write_timeout = 1.0
        assert bus.ping(1) == 1180


def test_arguments_are_checked(emulated):
    with pytest.raises(ArgumentError, match="id is 253; ids are 0 to 252"):
        fish_motor(253)
    with pytest.raises(ArgumentError, match="9600 baud can't be used for 50"):
        Bus(emulated.port, 9600)


def test_ports_that_cant_be_opened(tmp_path, emulated):
    (tmp_path / "file").write_text("")
    for name, reason in ((str(tmp_path / "none"), "No such file"), (str(tmp_path / "file"), "")):
        with pytest.raises(MotorError, match=f"{re.escape(name)} can't be opened .*{reason}.* is the U2D2 plugged in"):
            Bus(name)
    with Bus(emulated.port), pytest.raises(MotorError, match=r"Resource temporarily unavailable.*nobody else using it"):
        Bus(emulated.port)


def test_without_the_makers_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "dynamixel_sdk", None)
    monkeypatch.delitem(sys.modules, "swim2real.deployment.bus")
    with pytest.raises(MissingExtraError, match="pip install dynamixel-sdk"):
        importlib.import_module("swim2real.deployment.bus")
