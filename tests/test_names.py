"""What a name from outside may be, and that text from outside can't command a terminal or Markdown."""

import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swimbase.errors import Swim2RealError
from swimbase.escaping import plain_markdown, visible
from swimbase.names import LONGEST, composed, file_key, file_name_fault, label_fault, quoted
from swimbase.store import write_text

ORDINARY = (
    "f1_50", "pool 3, slow", "v1.2.3", "Flösselhecht", "übung 7", "-5 deg", "+10°",
    "50 % duty (left)", "ロボット", "été #2",
    "M'0", "a&b", "$x$", "Recording at 9.41.00\u202fAM", "🐟", "x" * LONGEST,
)  # fmt: skip
NO_FILES = (
    "../x", "..", ".", "a/b", "a\\b", "/etc/x", "C:x", "a:b", "x.", "x ", " x", ".hidden", "nul", "CON", "com1", "LPT9",
    "aux.table", "nul .a", "COM¹", "a\uff0fb", "a\uff3cb",
    "\uff0e\uff0e\uff0fx", "a<b", "a|b", "a?b", "a*b", 'a"b', "é" * 101,
)  # fmt: skip
NO_NAMES = (
    "", " ", "\u3000", "x" * (LONGEST + 1), "a\0b", "a\nb", "a\tb", "a\x1b[2Jb", "a\x9bb", "a\u202eb", "a\u2066b",
    "a\u200bb",
    "a\u200fb", "\ufeffa", "a\u2028b", "a\udcffb", "a\U000e0041b", "a\u00adb",
)  # fmt: skip


@pytest.mark.parametrize("name", ORDINARY)
def test_ordinary_names_are_names_of_files_in_either_form(name: str) -> None:
    assert file_name_fault(name) is None
    assert file_name_fault(unicodedata.normalize("NFD", name)) is None
    assert label_fault(name) is None


@pytest.mark.parametrize("name", [*NO_FILES, *NO_NAMES])
def test_what_leaves_a_folder_or_isnt_seen_is_no_name_of_a_file(name: str) -> None:
    fault = file_name_fault(name)
    assert fault is not None
    assert fault.isprintable()
    assert "must" in fault


@pytest.mark.parametrize("name", ["walker/left_foot", "N·m·s/rad", "m/s", "quat[0]", "a<b", "v²"])
def test_labels_may_have_signs_that_files_have_not(name: str) -> None:
    assert label_fault(name) is None


@pytest.mark.parametrize("name", NO_NAMES)
def test_a_label_is_a_line_of_characters_that_are_seen(name: str) -> None:
    assert label_fault(name) is not None


@given(st.text(max_size=300))
def test_a_name_of_a_file_stays_in_its_folder(name: str) -> None:
    if file_name_fault(name) is None:
        for form in ("NFC", "NFD", "NFKC"):
            told = unicodedata.normalize(form, name)
            assert not set(told) & set('<>:"/\\|?*\0\n')
            assert told not in (".", "..", "")
        assert len(composed(name).encode()) <= LONGEST


@given(st.text(st.characters(), max_size=100))
def test_text_is_shown_without_characters_that_arent_seen(text: str) -> None:
    shown = visible(text)
    for character in shown:
        assert character in "\n\t" or unicodedata.category(character)[0] != "C"
        assert unicodedata.category(character) not in ("Zl", "Zp")
    shown.encode()  # no lone surrogate is left
    assert visible(shown) == shown


def test_codes_say_what_was_there_and_names_that_a_system_takes_for_one_have_one_key() -> None:
    assert visible("a\x1b[31mb\x9b\u202e\U000e0041\udcff") == "a\\x1b[31mb\\x9b\\u202e\\U000e0041\\udcff"
    assert visible("two\nlines\tand été 日本") == "two\nlines\tand été 日本"
    assert quoted("a\nb\x1b") == "'a\\nb\\x1b'"
    assert len(quoted("x" * 1000)) < 70
    assert file_key("Übung") == file_key(unicodedata.normalize("NFD", "übung"))
    assert file_key("a") != file_key("b")


def test_markdown_finds_no_html_link_or_picture() -> None:
    hostile = "<img src=x> </b> <!-- <?x ![p](http://x/p.png) [a][b]\n[b]: http://x"
    told = plain_markdown(hostile)
    assert told == "&lt;img src=x> &lt;/b> &lt;!-- &lt;?x ![p]\\(http://x/p.png) [a][b]\n\\[b]: http://x"
    plain = "5 < 7, [1.0, 2.0] N·m, gyro[1]: off by 3 (rad/s)\n- M[0] (mm)"
    assert plain_markdown(plain) == plain


def test_a_link_that_came_with_a_folder_isnt_written_through(tmp_path: Path) -> None:
    outside, folder = tmp_path / "outside.txt", tmp_path / "run"
    outside.write_text("mine")
    folder.mkdir()
    (folder / "report.html.part").symlink_to(outside)
    (folder / "tables.md").symlink_to(outside)
    for name in ("report.html", "tables.md"):
        write_text(folder / name, "theirs")
        assert not (folder / name).is_symlink()
        assert (folder / name).read_text() == "theirs"
    assert outside.read_text() == "mine"


def test_a_sentence_cuts_off_what_a_file_makes_too_long():
    assert (
        str(Swim2RealError(f"robot '{'x' * 20_000}' is unknown; give another"))
        == f"robot '{'x' * 399}… is unknown; give another"
    )
