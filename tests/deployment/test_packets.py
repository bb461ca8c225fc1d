"""Packets against the manual's examples and against the maker's library."""

import dynamixel_sdk
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swim2real.deployment.packets import HEADER, PING, READ, STATUS, WRITE, Parser, build, crc16


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
    assert build(1, instruction, bytes.fromhex(parameters)) == bytes.fromhex(packet)


@given(st.binary(min_size=1, max_size=60))
def test_the_crc_is_that_of_the_makers_library(data):
    theirs = dynamixel_sdk.Protocol2PacketHandler().updateCRC(0, list(data), len(data))
    assert crc16(data) == theirs


stuffed = st.lists(st.sampled_from([b"\xff\xff\xfd", b"\xff", b"\xfd", b"\x00", b"\x41"]), max_size=12).map(b"".join)


@given(stuffed, st.binary(max_size=8), st.integers(1, 9))
def test_a_packet_survives_noise_before_it_and_arriving_in_pieces(parameters, noise, size):
    noise = noise.replace(b"\xff", b"")
    stream = noise + build(7, WRITE, parameters) + build(7, PING)
    parser = Parser()
    found = [packet for k in range(0, len(stream), size) for packet in parser.feed(stream[k : k + size])]
    assert [(p.id, p.instruction, p.parameters, p.intact) for p in found] == [
        (7, WRITE, parameters, True),
        (7, PING, b"", True),
    ]


@given(stuffed)
def test_no_header_is_left_within_a_packet(parameters):
    assert build(1, WRITE, parameters).count(HEADER[:3] + b"\x00") == 1


def test_a_damaged_packet_is_known_and_an_impossible_length_passed_over():
    whole = build(1, WRITE, b"\x40\x00\x01")
    damaged = whole[:-3] + bytes([whole[-3] ^ 1]) + whole[-2:]
    impossible = HEADER + b"\x01\xff\xff"
    found = Parser().feed(damaged + impossible + build(1, PING))
    assert [(p.instruction, p.intact) for p in found] == [(WRITE, False), (PING, True)]
