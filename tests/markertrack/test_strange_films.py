"""Films from strangers: what would lead FFmpeg to other files or addresses, is endless, or is larger than any film."""

import os
import socket
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import av
import numpy as np
import pytest
from clips import clip, error, picture, raw
from PIL import Image

from markertrack.video import VideoReader, decoding, first_frame, reader
from swimbase.errors import VideoError

SECONDS = 20.0  # that any of these may take


@pytest.fixture
def server():
    """A server that notes the path of every request."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *words):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        threading.Thread(target=running.serve_forever, args=(0.01,), daemon=True).start()
        yield f"127.0.0.1:{running.server_address[1]}", asked
        running.shutdown()


def _refused(path, message=None):
    began = time.monotonic()
    with pytest.raises(VideoError, match=message) as caught:
        first_frame(path)
    assert time.monotonic() - began < SECONDS
    assert "\n" not in str(caught.value)
    return str(caught.value)


PLAYLISTS = {
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\n{url}\n#EXT-X-ENDLIST\n",
    "hls-key": '#EXTM3U\n#EXT-X-KEY:METHOD=AES-128,URI="{url}"\n#EXTINF:5,\n{film}\n#EXT-X-ENDLIST\n',
    "hls-film": "#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\n{film}\n#EXT-X-ENDLIST\n",
    "ffconcat": "ffconcat version 1.0\nfile '{url}'\n",
    "ffconcat-film": "ffconcat version 1.0\nfile '{film}'\nfile '/etc/passwd'\n",
    "dash": '<?xml version="1.0"?>\n<MPD type="static" profiles="urn:mpeg:dash:profile:isoff-live:2011"><Period>'
    '<AdaptationSet mimeType="video/mp4"><Representation id="1"><BaseURL>{url}</BaseURL></Representation>'
    "</AdaptationSet></Period></MPD>\n",
    "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=-\nc=IN IP4 127.0.0.1\nt=0 0\nm=video {port} RTP/AVP 96\n"
    "a=rtpmap:96 H264/90000\n",
    "imf": '<?xml version="1.0"?>\n<CompositionPlaylist xmlns="http://www.smpte-ra.org/schemas/2067-3/2013">'
    "<Id>{url}</Id></CompositionPlaylist>\n",
    "subtitles": "# VobSub index file, v7 (do not modify this line!)\nsize: 720x576\nid: en, index: 0\n"
    "timestamp: 00:00:00:000, filepos: 000000000\n",
    "ass": "[Script Info]\nScriptType: v4.00+\n[Events]\nDialogue: 0,0:00:00.00,0:00:05.00,Default,,0,0,0,,{url}\n",
}


@pytest.mark.parametrize("name", ["swim.mp4", "swim.m3u8", "swim.ffconcat", "swim.mpd", "swim.mkv", "swim.idx"])
def test_playlists_are_not_followed(tmp_path, server, name):
    """Whatever a file is called, what it holds decides: none of these opens a file or asks a server."""
    address, asked = server
    film = clip(tmp_path / "real.mp4", 3)
    (tmp_path / "swim.sub").write_bytes(film.read_bytes())
    for text in PLAYLISTS.values():
        filled = text.format(url=f"http://{address}/stolen", film=film, port=address.partition(":")[2])
        (tmp_path / name).write_text(filled)
        _refused(tmp_path / name, "is not a video")
    assert asked == []


@pytest.mark.parametrize(
    "name",
    ["http://{address}/swim.mp4", "rtsp://{address}/swim", "concat:real.mp4|real.mp4", "pipe:0", "file:real.mp4",
     "tcp://{address}", "subfile,,start,0,end,0,,:real.mp4", "data:video/mp4;base64,AAAA", "lavfi:testsrc", "cache:http://{address}/a",
     "crypto:real.mp4", "async:http://{address}/b"],
)  # fmt: skip
def test_protocols_are_names_of_files(tmp_path, server, monkeypatch, name):
    address, asked = server
    monkeypatch.chdir(tmp_path)
    clip(tmp_path / "real.mp4", 3)
    _refused(name.format(address=address), "no video '.*'; check the path")
    assert asked == []


def test_a_picture_is_one_picture(tmp_path):
    """Its name is no pattern of other names, which lie beside it."""
    for name in ("a%d.png", "a1.png", "a2.png", "b*.jpg", "b1.jpg", "c.tiff", "d.bmp"):
        Image.fromarray(picture(0)).save(tmp_path / name)
    for name in ("a%d.png", "b*.jpg", "c.tiff", "d.bmp"):
        assert error(first_frame(tmp_path / name).image, picture(0)) < 3
        with pytest.raises(VideoError, match="has one frame only; for a film of single pictures give their folder"):
            VideoReader(tmp_path / name, fps=60)


def test_references_of_quicktime_are_not_followed(tmp_path):
    """A track may lie in another file, which the film names; FFmpeg finds it there when it is allowed to."""
    other = clip(tmp_path / "other.mov", 5)
    film = tmp_path / "swim.mov"
    data = other.read_bytes()
    box = data.index(b"url ", data.index(b"dref")) - 4
    name = str(other).encode()
    path = len(name).to_bytes(2, "big") + name + b"\0" * (len(name) % 2)
    alias = (
        b"alis" + bytes(4 + 10 + 1 + 27 + 12 + 1 + 63 + 16) + b"\0\1\0\1" + bytes(16) + b"\0\2" + path + b"\xff\xff\0\0"
    )
    moved = _grown(data, box, 12, (4 + len(alias)).to_bytes(4, "big") + alias)
    film.write_bytes(moved[: moved.index(b"mdat") + 4])
    with av.open(str(film), options={"enable_drefs": "1"}) as followed:
        assert len(list(followed.decode(video=0))) == 5
    _refused(film, "not one frame")


def _grown(data, place, length, entry):
    """A file with a box in place of another one, and the sizes of the boxes around it to fit."""
    more, grown = len(entry) - length, bytearray(data)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"dinf", b"dref"):
        at = data.rindex(name, 0, place) - 4
        grown[at : at + 4] = (int.from_bytes(data[at : at + 4], "big") + more).to_bytes(4, "big")
    return bytes(grown[:place]) + entry + bytes(grown[place + length :])


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    for name, target in (("zero.mp4", "/dev/zero"), ("null.mp4", "/dev/null"), ("terminal.mp4", "/dev/tty")):
        (tmp_path / name).symlink_to(target)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket.mp4"))
        for name in ("pipe.mp4", "zero.mp4", "null.mp4", "terminal.mp4", "socket.mp4"):
            _refused(tmp_path / name, "is a device, a pipe or a socket; give the path of a video file")
    (tmp_path / "round.mp4").symlink_to(tmp_path / "round.mp4")
    _refused(tmp_path / "round.mp4", "check the path")
    (tmp_path / "link.mp4").symlink_to(clip(tmp_path / "swim.mp4", 3))
    assert first_frame(tmp_path / "link.mp4").image.shape == (96, 160, 3)


@pytest.mark.parametrize(("width", "height"), [(65500, 65500), (16384, 8192), (60000, 1000)])
def test_pictures_larger_than_any_camera_s_are_refused(tmp_path, width, height):
    """A small file whose pictures say that they are large."""
    film = raw(tmp_path / "swim.avi", "mjpeg", 3, "yuvj420p", colors=5)
    size, claimed = _size(160, 96), _size(width, height)
    film.write_bytes(film.read_bytes().replace(size, claimed))
    _refused(film, "not one frame .* its pictures have more than 40 million pixels")
    Image.new("1", (9000, 5000)).save(tmp_path / "large.png")
    _refused(tmp_path / "large.png", "its pictures have more than 40 million pixels")


def _size(width, height):
    """As a JPEG's header has it."""
    return height.to_bytes(2, "big") + width.to_bytes(2, "big")


def test_many_streams_are_refused(tmp_path):
    with av.open(str(tmp_path / "swim.mkv"), "w") as film:
        streams = [film.add_stream("mjpeg", rate=30) for _ in range(decoding.MOST_STREAMS + 20)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 64, 64, "yuvj420p"
        for stream in streams:
            frame = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), format="rgb24")
            film.mux(stream.encode(frame))
    _refused(tmp_path / "swim.mkv", "has more than 32 streams")


@pytest.fixture
def hasty(monkeypatch):
    """Half a second for the first picture, so that a test needn't wait."""
    monkeypatch.setattr(decoding, "FIRST_PICTURE", 0.3)
    monkeypatch.setattr(reader, "FIRST_PICTURE", 0.3)
    monkeypatch.setattr(reader, "SLACK", 0.3)


@pytest.mark.parametrize(("name", "head"), [("swim.ts", 188 * 3), ("swim.h264", 60), ("swim.avi", 2000)])
def test_an_endless_file_is_told(tmp_path, hasty, name, head):
    """The beginning of a film, then a terabyte of nothing, which takes no place on the disk."""
    encoder, pixels, colors = ("mjpeg", "yuvj420p", 5) if name.endswith("avi") else ("libx264", "yuv420p", 1)
    film = raw(tmp_path / name, encoder, 3, pixels, colors=colors)
    os.truncate(film, head)
    os.truncate(film, 10**12)
    _refused(film, "came within|not one frame|can read|no video in it")


def test_a_film_of_tiny_boxes_is_told(tmp_path):
    film = tmp_path / "swim.mp4"
    film.write_bytes((8).to_bytes(4, "big") + b"ftyp" + ((8).to_bytes(4, "big") + b"free") * 2_000_000)
    _refused(film)


def test_a_disk_that_hangs_is_told(tmp_path, hasty, monkeypatch):
    """The system doesn't come back, as of a network drive that is gone; the thread is left to itself."""
    monkeypatch.setattr(reader, "Decoder", lambda *arguments: time.sleep(3.0))
    _refused(clip(tmp_path / "swim.mp4", 3), "no picture of '.*' came within 0.3 s")


@pytest.mark.parametrize("count", [20, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_films_are_read_or_refused(tmp_path, count):
    """Bits flipped, pieces cut out, doubled, or of another place: pictures with notes, or a sentence."""
    films = [clip(tmp_path / name, 6).read_bytes() for name in ("swim.mp4", "swim.mov")]
    films += [raw(tmp_path / name, "libx264", 6).read_bytes() for name in ("swim.ts", "swim.mkv")]
    films += [raw(tmp_path / "swim.avi", "mjpeg", 6, "yuvj420p", colors=5).read_bytes()]
    random = np.random.default_rng(0)
    read = refused = 0
    for number in range(count):
        data = bytearray(films[number % len(films)])
        for _ in range(random.integers(1, 9)):
            place, length = int(random.integers(len(data))), int(random.integers(1, 200))
            match random.integers(5):
                case 0:
                    data[place] ^= 1 << int(random.integers(8))
                case 1:
                    data[place : place + 4] = random.bytes(4)
                case 2:
                    del data[place : place + length]
                case 3:
                    data[place:place] = data[place : place + length]
                case _:
                    data[place : place + 4] = b"\xff\xff\xff\xff"
        path = tmp_path / "damaged"
        path.write_bytes(data)
        began = time.monotonic()
        try:
            with VideoReader(path) as film:
                assert all(frame.image.size for frame in film)
                assert all(isinstance(note, str) for note in film.notes)
                read += 1
        except VideoError:
            refused += 1
        assert time.monotonic() - began < SECONDS
    assert read
    assert refused
