"""Text from outside on the terminal: no color, no moved cursor, no turned text, no markup; and one way to get there."""

import io
import json
import logging
import re
from pathlib import Path

import pytest

import swim2real
from swim2real.advisor import AdvisorEvent
from swim2real.advisor.vlm.transcript import Totals
from swim2real.calibration import Progress
from swim2real.cli import main, progress, tables, terminal
from swim2real.cli.tables import PlainConsole
from swimbase.escaping import visible

ATTACKS = {
    "clears the screen": "\x1b[2J\x1b[H", "sets the title": "\x1b]0;owned\x07", "colors": "\x1b[31m", "C1": "\x9b31m",
    "link": "\x1b]8;;http://x\x1b\\click\x1b]8;;\x1b\\", "overwrites": "good\rbad\b\b",
    "right to left": "\u202egpj.exe",
    "isolates": "\u2066a\u2069", "zero width": "a\u200bb", "no Unicode": "a\udcffb", "tag": "\U000e0041",
    "rich": "[red]red[/red] [/] [link=http://x]y[/link] :skull: [bold", "format": "{task.description} {0!r}",
}  # fmt: skip
ALL = " ".join(ATTACKS.values())


def check(shown: str, attack: str) -> None:
    """What is shown commands no terminal, and has the attack in characters that are seen."""
    assert [character for character in shown if not (character.isprintable() or character in "\n\t")] == []
    assert visible(attack) in shown


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS.keys())
def test_lines_are_only_text(attack: str, capsys: pytest.CaptureFixture[str]) -> None:
    terminal.say(attack)
    terminal.tell(attack)
    terminal.say_json({attack: attack})
    out, err = capsys.readouterr()
    check(out, attack)
    check(err, attack)
    assert json.loads(out[out.index("{\n") :]) == {attack: attack}
    record = logging.LogRecord("swim2real", logging.WARNING, "x.py", 1, "%s", (attack,), None)
    check(terminal.LogLine().format(record), attack)


@pytest.mark.parametrize("attack", ATTACKS.values(), ids=ATTACKS.keys())
def test_tables_are_only_text(attack: str, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(tables, "console", PlainConsole(file=out, width=400))
    tables.table(attack, ("trial", attack), [(attack, attack)])
    tables.by_marker(attack, (attack,), ("trial",), (), [((attack,), (0.1,), ())], tables.millimeters)
    check(out.getvalue(), attack)
    assert out.getvalue().count(visible(attack)) == 7


@pytest.mark.parametrize("on_a_terminal", [False, True])
def test_progress_and_words_of_an_advisor_are_only_text(on_a_terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    console = PlainConsole(file=out, width=400, force_terminal=on_a_terminal, color_system=None)
    monkeypatch.setattr(progress, "progress_console", lambda: console)
    with progress.run_shown(10, quiet=False) as callbacks:
        for kind in ("asks", "warning"):
            callbacks.advisor(AdvisorEvent(kind, 1, ALL, Totals()))
        callbacks.progress(Progress(1, 10, 0.1, 0.1, {"source": ALL}, True, 1.0, False))
    shown = out.getvalue()
    assert "[red]red[/red] [/] [link=http://x]y[/link] :skull: [bold {task.description} {0!r}" in shown
    for attack in ("\x1b[2J\x1b[H", "\x1b]0;", "\x9b", "\u202e", "\u2066", "\u200b", "\udcff", "\b", "\x07"):
        assert attack not in shown
    assert "\\u202egpj.exe" in shown


def test_an_error_that_names_a_file_and_a_warning_of_a_library_are_only_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in ("a\x1b[2Jb\u202ec", "[/red]", "a\udcffb"):
        with pytest.raises(SystemExit) as end:
            main(["report", str(tmp_path / place)])
        assert end.value.code == 1
        check(capsys.readouterr().err, place)
    check(terminal.warning_line(f"Glyph {ALL}", UserWarning, "x.py", 1), ALL)


def test_nothing_else_prints() -> None:
    package = Path(swim2real.__file__).parent
    for path in package.rglob("*.py"):
        name, text = path.relative_to(package).as_posix(), path.read_text("utf-8")
        assert name == "cli/terminal.py" or not re.search(r"(?<![\w.])print\(", text), name
        assert not re.search(r"\bConsole\(", text), name
