"""Decodes a stream and leaves broken pictures out."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.stream import VideoStream


@dataclass(frozen=True)
class Picture:
    """A decoded picture.

    Attributes:
        stored: As it is stored: not turned, in the camera's colors.
        stamp: In units of the stream's time base; None where the file has none.
        intact: Whether no picture since the last key frame is broken.
        lost: Pictures without a stamp that were left out just before.
    """

    stored: VideoFrame
    stamp: int | None
    intact: bool
    lost: int


class Decoder:
    """Decodes one stream from its beginning to its end.

    What is broken shows in two ways: the decoder conceals a hole in a picture and says so, or a packet never becomes a
    picture. The decoder may work ahead in several threads, so the stamps tell which packets those are.

    Attributes:
        left_out: Stamps of the pictures that are left out.
        unstamped: Pictures without a stamp that are left out.
        hidden: Packets that aren't for showing, as the file says.
        failure: Why reading stopped before the end; empty where it didn't.
    """

    def __init__(self, container: InputContainer, stream: VideoStream) -> None:
        self._container = container
        self._stream = stream
        # AVI has no time stamps, and what FFmpeg makes up for frames that are stored out of order is wrong
        self._stamped = not (container.format.name == "avi" and stream.codec_context.has_b_frames)
        self._waiting: dict[int, None] = {}  # stamps of packets that haven't become pictures
        self._intact = True
        self._lost = 0
        self.left_out: dict[int, None] = {}
        self.unstamped = 0
        self.hidden = 0
        self.failure = ""

    def pictures(self) -> Generator[Picture]:
        """All that is fit to be seen, in the order of showing."""
        for packet in self._packets():
            for stored in self._decode(packet):
                stamp = stored.pts if self._stamped else None
                self._settle(stamp)
                if stored.is_corrupt:
                    self._leave_out(stamp)
                    continue
                self._intact = self._intact or stored.key_frame
                lost, self._lost = self._lost, 0
                yield Picture(stored, stamp, self._intact, lost)
        for stamp in self._waiting:
            self._leave_out(stamp)

    def _packets(self) -> Iterator[Packet[VideoStream]]:
        from av.error import FFmpegError

        try:
            yield from self._container.demux(self._stream)
        except FFmpegError as error:
            self.failure = f"reading stopped before the end ({error.strerror})"

    def _decode(self, packet: Packet[VideoStream]) -> list[VideoFrame]:
        from av.error import FFmpegError

        if packet.is_discard:
            self.hidden += 1
        elif packet.size and packet.pts is not None and self._stamped:
            self._waiting[packet.pts] = None
        if packet.is_corrupt:  # cut off; the decoder's complaint about it could cost whole pictures
            if packet.pts is None or not self._stamped:
                self._leave_out(None)
            return []
        try:
            return packet.decode()
        except FFmpegError:
            if not self._stamped or packet.pts is None:
                self._leave_out(None)
            return []

    def _settle(self, stamp: int | None) -> None:
        """A picture has come out: those that should have come before it are lost."""
        if stamp is None:
            self._waiting.clear()
            return
        self._waiting.pop(stamp, None)
        self.left_out.pop(stamp, None)
        for late in [other for other in self._waiting if other < stamp]:
            del self._waiting[late]
            self._leave_out(late)

    def _leave_out(self, stamp: int | None) -> None:
        self._intact = False
        if stamp is None:
            self._lost += 1
            self.unstamped += 1
        else:
            self.left_out[stamp] = None
