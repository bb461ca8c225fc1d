"""Models that read files outside of their folder: told before MuJoCo reads them, however the file is named."""

import ctypes
import os
import pickle
import sys
import time
import zipfile
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

import mujoco
import pytest

from made_robots import DAMPING, RECORDINGS, ROBOT, TETRAHEDRON, made
from swim2real import consent
from swim2real.robots import load_robot
from swim2real.robots.file import read_mjcf
from swim2real.robots.fingerprint import fingerprint
from swim2real.robots.mjcf_files import outside
from swimbase.errors import ConsentError, RobotError

BODY = '<body><geom size="1"/></body>'
PIECE = f"<mujocoinclude>{BODY}</mujocoinclude>"


def meshed(file: str, compiler: str = "") -> str:
    asset = f'<mesh name="t" file="{file}"/>'
    return f'<mujoco>{compiler}<asset>{asset}</asset><worldbody><geom type="mesh" mesh="t"/></worldbody></mujoco>'


def including(file: str) -> str:
    return f'<mujoco><worldbody><include file="{file}"/></worldbody></mujoco>'


@pytest.fixture
def folder(tmp_path) -> Path:
    """Of a model, with files inside and outside."""
    for place in ("t.obj", "elsewhere/t.obj", "model/in/t.obj", "model/t.obj"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text(TETRAHEDRON)
    for place in ("piece.xml", "model/piece.xml", "model/in/piece.xml"):
        (tmp_path / place).write_text(PIECE)
    (tmp_path / "model/in/to.xml").write_text('<mujocoinclude><include file="piece.xml"/></mujocoinclude>')
    (tmp_path / "model/in/out.xml").write_text('<mujocoinclude><include file="../../piece.xml"/></mujocoinclude>')
    (tmp_path / "model/in/child.xml").write_text(meshed("t.obj", f'<compiler meshdir="{tmp_path}/elsewhere"/>'))
    (tmp_path / "model/link.obj").symlink_to(tmp_path / "t.obj")
    (tmp_path / "model/linked").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "model/inner.obj").symlink_to(tmp_path / "model/in/t.obj")
    return tmp_path / "model"


OUTSIDE = {
    "a mesh": meshed("../t.obj"), "on Windows": meshed("..\\t.obj"), "there and back": meshed("in/../../t.obj"),
    "absolute": meshed("FOLDER/t.obj"),
    "absolute below the root": meshed("FOLDER/t.obj", '<compiler meshdir="file:///"/>'),
    "entities": meshed("&#46;&#x2e;/t.obj"), "meshdir": meshed("t.obj", '<compiler meshdir="../elsewhere"/>'),
    "assetdir": meshed("t.obj", '<compiler assetdir="FOLDER/elsewhere"/>'),
    "last part": meshed("/nowhere/t.obj", '<compiler meshdir="../elsewhere" strippath="true"/>'),
    "a link": meshed("link.obj"), "a linked folder": meshed("linked/t.obj"), "an include": including("../piece.xml"),
    "an include on Windows": including("..\\piece.xml"), "an include of an include": including("in/out.xml"),
    "an attached model's": '<mujoco><asset><model name="c" file="in/child.xml"/></asset></mujoco>',
    "a texture": '<mujoco><asset><texture type="2d" file="../t.obj"/></asset></mujoco>',
    "a cube's side": '<mujoco><asset><texture type="cube" fileright="in/t.obj" fileup="../t.obj"/></asset></mujoco>',
    "a height field": '<mujoco><asset><hfield file="../t.obj" size="1 1 1 1"/></asset></mujoco>',
    "a skin": '<mujoco><asset><skin file="../t.obj"/></asset></mujoco>',
    "a flex": '<mujoco><worldbody><flexcomp type="mesh" file="../t.obj"/></worldbody></mujoco>',
    "URDF": '<robot><link><visual><geometry><mesh filename="../t.obj"/></geometry></visual></link></robot>',
    "a device": '<mujoco><asset><hfield file="/dev/zero" size="1 1 1 1"/></asset></mujoco>',
    "an end tag's include": including("../piece.xml").replace("<include", "</include"),
    "an end tag's folder": meshed("t.obj", '</compiler meshdir="../elsewhere"/>'),
    "behind comments": meshed("../t.obj").replace("<asset>", "<!-- a -- b --><!--><asset>--><!-><asset>"),
    "a comment in an attribute": meshed("../t.obj").replace("<mujoco>", '<mujoco model="<!--">'),
    "no space": meshed("../t.obj").replace(" file", "file"),
    "a space before the tag": meshed("../t.obj").replace("<mesh", "< mesh"),
    "an end tag": meshed("../t.obj").replace("<mesh", "</mesh"), "apostrophes": meshed("../t.obj").replace('"', "'"),
    "after a document type": '<?xml version="1.0"?><!DOCTYPE mujoco>' + meshed("../t.obj"),
    "bytes that are no text": meshed("../t.obj") + "\x00\udcff",
}  # fmt: skip
"""The last ones are forms that MuJoCo's parser reads and others may not."""


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_file_outside_is_told_before_it_is_read(folder, name):
    model = folder / "model.xml"
    model.write_bytes(OUTSIDE[name].replace("FOLDER", str(folder.parent)).encode("utf-8", "surrogateescape"))
    with pytest.raises(ConsentError) as caught:
        read_mjcf(model)
    sentence = str(caught.value)
    assert sentence.startswith(f"model '{model}' reads files outside of its folder: '")
    assert "if you trust it, allow it with --allow-outside (in Python: allow_outside=True)" in sentence


OWN = 'file="../t.obj" vertex="0 0 0 1 0 0 0 1 0 0 0 1"'


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux confines a thread")
@pytest.mark.parametrize("text", [
    *(OUTSIDE[name] for name in OUTSIDE if "include" in name or "mesh" in OUTSIDE[name]),
    meshed(f't.obj" {OWN[:-1]}'),
])  # fmt: skip
def test_what_a_scan_overlooked_mujoco_itself_tells_or_cannot_open(folder, text, monkeypatch):
    monkeypatch.setattr("swim2real.robots.file.outside", lambda path, where: None)
    model = folder / "model.xml"
    model.write_bytes(text.replace("FOLDER", str(folder.parent)).encode("utf-8", "surrogateescape"))
    with pytest.raises(RobotError):
        read_mjcf(model)
    assert (folder.parent / "t.obj").read_text() == TETRAHEDRON  # this thread may open everything, before and after


@pytest.mark.parametrize(
    "text",
    [
        meshed("t.obj"), meshed("in/t.obj"), meshed("in\\t.obj"), meshed("t.obj", '<compiler meshdir="in"/>'),
        meshed("in/../t.obj"), meshed("FOLDER/model/t.obj"), meshed("inner.obj"), including("piece.xml"),
        including("in/to.xml"), including("piece.xml").replace("<world", "<!-- <mesh file='../t.obj'/> -- --><world"),
        f"<mujoco><worldbody>{BODY}</worldbody></mujoco>",
    ],
)  # fmt: skip
def test_files_in_the_folder_need_no_consent(folder, text, monkeypatch):
    (folder / "model.xml").write_text(text.replace("FOLDER", str(folder.parent)))
    assert read_mjcf(folder / "model.xml").compile().ngeom == 1
    monkeypatch.chdir(folder / "in")
    assert outside(Path("../model.xml")) is None


QUOTES = ('="{}"', "='{}'", ' = "{}"')
HEADS = ("<{} ", "</{} ") * 6 + (
    "< {} ",
    "<{}\n",
    "<!-- <{} ",
    "<![CDATA[<{} ",
    "<!DOCTYPE a [<!ENTITY b '><{} ",
    "<?{} ",
)
TAILS = ("/>",) * 12 + (">", "/ >", "-->", "]]>", "'>]>", "?>")
MESHES = ("t.obj", "../t.obj", "FOLDER/t.obj", "in/t.obj", "&#46;&#x2e;/t.obj", "&#0000046;./t.obj", "/nowhere/t.obj")
VALUES = {
    "file": MESHES, "filename": MESHES, "strippath": ("true", "false"), "vertex": ("0 0 0 1 0 0 0 1 0 0 0 1",),
    "meshdir": ("in", "..", "../elsewhere", "FOLDER/elsewhere"), "include": ("piece.xml", "../piece.xml", "in/to.xml"),
}  # fmt: skip


def made_at_random(random: Random, folder: str) -> bytes:
    """A model of elements that name files, in forms of all kinds, with some bytes of it changed."""

    def element(tag: str, *keys: str) -> str:
        if random.random() < 0.3:
            return ""
        chosen = [(key, random.choice(VALUES[key])) for key in keys if key == "file" or random.random() < 0.3]
        given = "".join(
            f"{key.replace('include', 'file')}{random.choice(QUOTES).format(value)} " for key, value in chosen
        )
        return random.choice(HEADS).format(tag) + given + random.choice(TAILS)

    mesh, folders = element("mesh", "file", "vertex", "filename"), element("compiler", "meshdir", "strippath")
    inner = element("include", "include")
    text = f"<mujoco>{folders}<asset>{mesh}</asset><worldbody>{BODY}{inner}</worldbody></mujoco>"
    raw = bytearray(text.replace("FOLDER", folder).encode())
    for _ in range(random.choice((0, 0, 0, 1, 3))):
        at = random.randrange(len(raw))
        raw[at : at + random.randint(0, 2)] = random.choice((b"", b"<", b">", b"/", b'"', b" ", b"\0", b"&", b"="))
    return bytes(raw)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is opened")
def test_of_20000_changed_models_none_opens_a_file_outside_that_wasnt_asked_for(folder):
    libc, random, met = ctypes.CDLL(None), Random(0), Counter()
    watch = libc.inotify_init1(os.O_NONBLOCK)
    for place in (folder.parent, folder.parent / "elsewhere"):
        libc.inotify_add_watch(watch, os.fsencode(place), 0x20)  # IN_OPEN
    for _ in range(20_000):
        (folder / "model.xml").write_bytes(made_at_random(random, str(folder.parent)))
        with suppress(RobotError):
            if outside(folder / "model.xml") is None:
                drained(watch)  # what the scan itself has looked at
                try:
                    read_mjcf(folder / "model.xml").compile()
                    met["read"] += 1
                except (RobotError, ValueError):
                    met["refused"] += 1
                opened = drained(watch)
                assert b"t.obj" not in opened, (folder / "model.xml").read_bytes()
                assert b"piece.xml" not in opened, (folder / "model.xml").read_bytes()
            else:
                met["asked"] += 1
    os.close(watch)
    assert min(met["read"], met["refused"], met["asked"]) > 300, met


def drained(watch: int) -> bytes:
    """What a watch has seen since it was last asked, with the files' names in it."""
    try:
        return os.read(watch, 1 << 20)
    except BlockingIOError:
        return b""


def test_what_is_allowed_is_remembered_until_other_files_are_named(folder, monkeypatch):
    place = made(folder, ROBOT, RECORDINGS, DAMPING)
    model = place.with_suffix(".xml")
    inside = model.read_text()
    model.write_text(inside.replace("<worldbody>", '<worldbody><include file="../piece.xml"/>'))
    with pytest.raises(ConsentError, match=r"^robot file '.*/arm\.toml': model '.*/arm\.xml' reads files outside"):
        load_robot(place)
    load_robot(place, allow_outside=True)
    monkeypatch.setattr(consent, "_marks", set())
    load_robot(place)
    fingerprint(place)
    (folder.parent / "other.xml").write_text(PIECE)
    model.write_text(inside.replace("<worldbody>", '<worldbody><include file="../other.xml"/>'))
    with pytest.raises(ConsentError):
        load_robot(place)


def test_an_allowed_file_is_read_by_other_processes(folder, monkeypatch):
    place = made(folder, ROBOT, RECORDINGS, DAMPING)
    model = place.with_suffix(".xml")
    model.write_text(model.read_text().replace("<worldbody>", '<worldbody><include file="../piece.xml"/>'))
    monkeypatch.setenv(consent.FOLDER, os.devnull)
    sent = pickle.dumps(load_robot(place, allow_outside=True))
    monkeypatch.setattr(consent, "_marks", set())
    with pytest.raises(ConsentError):
        load_robot(place)
    assert pickle.loads(sent).build({"damping": 0.1}).compile().nu == 5


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_the_folder_is_refused_and_not_waited_for(folder):
    os.mkfifo(folder / "pipe.obj")
    (folder / "model.xml").write_text(meshed("pipe.obj"))
    with pytest.raises(RobotError, match=r"pipe\.obj' is no plain file"):
        read_mjcf(folder / "model.xml")


def test_an_archive_is_refused(folder):
    with zipfile.ZipFile(folder / "model.mjz", "w") as archive:
        archive.writestr("model.xml", meshed(str(folder.parent / "t.obj")))
    with pytest.raises(RobotError, match="is an archive; unpack it"):
        read_mjcf(folder / "model.mjz")
    (folder / "model.xml").write_text('<mujoco><asset><model name="c" file="model.mjz"/></asset></mujoco>')
    with pytest.raises(RobotError, match="is an archive; unpack it"):
        read_mjcf(folder / "model.xml")


def test_too_many_files_and_places_are_refused(folder):
    for i in range(1001):
        (folder / f"i{i}.xml").write_text(f'<mujocoinclude><include file="i{i + 1}.xml"/></mujocoinclude>')
    with pytest.raises(RobotError, match="made of more than 1,000 MJCF files"):
        read_mjcf(folder / "i0.xml")
    meshes = "".join(f'<mesh file="m{i}"/><compiler meshdir="d{i}"/>' for i in range(2000))
    (folder / "model.xml").write_text(f"<mujoco>{meshes}</mujoco>")
    with pytest.raises(RobotError, match="could lie in 4,002,000 places"):
        read_mjcf(folder / "model.xml")


@pytest.mark.parametrize("piece", ["<", "< ", "<a x=", "<a x='", '<a x="', "<!", "<!--", "<a b", "<a ='", "&#46;"])
def test_a_text_of_one_piece_repeated_is_taken_apart_in_linear_time(folder, piece):
    (folder / "model.xml").write_text("<mujoco>" + piece * 20_000)
    begin = time.perf_counter()
    assert outside(folder / "model.xml") is None
    assert time.perf_counter() - begin < 3


def test_the_forms_of_the_last_cases_are_read_by_mujoco(folder):
    for name in list(OUTSIDE)[-8:]:
        model = folder / "model.xml"
        model.write_bytes(OUTSIDE[name].encode("utf-8", "surrogateescape"))
        assert mujoco.MjSpec.from_file(str(model)).compile().nmesh == 1, name
