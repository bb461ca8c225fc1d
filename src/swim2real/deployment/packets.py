"""Packets of Dynamixel's protocol 2.0: byte stuffing, CRC-16, and finding them in a stream of bytes.

For the emulator. The program itself speaks through the maker's library, so each side checks the other.
Source: ROBOTIS e-Manual, Protocol 2.0 and CRC calculation.
"""

from __future__ import annotations

from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
PING, READ, WRITE, REBOOT, STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
_LONGEST = 1024  # bytes after the header's length field; longer ones are noise


@dataclass(frozen=True)
class Packet:
    """An instruction as received. `intact` says whether its CRC was right."""

    id: int
    instruction: int
    parameters: bytes
    intact: bool = True


def crc16(data: bytes) -> int:
    """CRC-16/BUYPASS: polynomial 0x8005, start 0, no reflection."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


def build(device: int, instruction: int, parameters: bytes = b"") -> bytes:
    """The bytes of a packet. A status packet's first parameter is its error."""
    body = bytes([instruction]) + parameters
    stuffed = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    packet = HEADER + bytes([device]) + (len(stuffed) + 2).to_bytes(2, "little") + stuffed
    return packet + crc16(packet).to_bytes(2, "little")


class Parser:
    """Takes bytes as they come and gives the packets in them; what isn't a packet is passed over."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now."""
        self._waiting += data
        packets: list[Packet] = []
        while True:
            start = self._waiting.find(HEADER)
            if start < 0:
                del self._waiting[: max(0, len(self._waiting) - len(HEADER) + 1)]
                return packets
            del self._waiting[:start]
            if len(self._waiting) < 7:
                return packets
            length = int.from_bytes(self._waiting[5:7], "little")
            if not 3 <= length <= _LONGEST:
                del self._waiting[:1]
                continue
            if len(self._waiting) < 7 + length:
                return packets
            whole = bytes(self._waiting[: 7 + length])
            del self._waiting[: 7 + length]
            body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            intact = crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
            packets.append(Packet(whole[4], body[0], body[1:], intact))
