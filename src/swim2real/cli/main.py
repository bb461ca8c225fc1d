"""Parses the command line, runs a command, and turns errors into sentences and exit codes."""

from __future__ import annotations

import difflib
import functools
import inspect
import json
import logging
import os
import re
import signal
import sys
import tomllib
import warnings
from collections.abc import Callable, Sequence
from dataclasses import is_dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, cast, get_type_hints

import tyro

from motorline.deploying import deploy
from swim2real import __version__, consent
from swim2real.cli.board import board
from swim2real.cli.calibrate import calibrate, demo
from swim2real.cli.compare import compare
from swim2real.cli.film import cut, export_tracks, fetch, import_tracks, pick, quality, track
from swim2real.cli.first_screen import captured, first_screen
from swim2real.cli.policy import export_commands, export_policy, rollout, train
from swim2real.cli.recording import import_recording
from swim2real.cli.results import evaluate, overlay, report, simulate
from swim2real.cli.robot import check, export_model, init
from swim2real.cli.study import ensemble, identify, next_trial
from swim2real.cli.terminal import LogLine, say, tell, warning_line
from swim2real.cli.ui import ui
from swim2real.cli.view import view
from swimbase.errors import ArgumentError, Swim2RealError
from swimbase.names import quoted
from swimbase.store import reason

Command = Callable[..., int]
# in the order of a user's day; a command imports what it works with when it runs, so that --help is quick
COMMANDS: dict[str, dict[str, Command]] = {
    "A first look": {"demo": demo, "ui": ui},
    "Real trials": {
        "fetch": fetch, "board": board, "pick": pick, "track": track, "import-tracks": import_tracks,
        "import-recording": import_recording, "cut": cut, "quality": quality, "export-tracks": export_tracks,
    },
    "A robot of your own": {"init": init, "check": check},
    "Calibration": {"calibrate": calibrate, "compare": compare},
    "Results": {
        "view": view, "evaluate": evaluate, "overlay": overlay, "simulate": simulate, "report": report,
        "identify": identify, "ensemble": ensemble, "next": next_trial, "export-model": export_model,
    },
    "Policies": {
        "train": train, "rollout": rollout, "export-policy": export_policy, "export-commands": export_commands,
        "deploy": deploy,
    },
}  # fmt: skip
# packages whose absence means that only the command line was installed
CORE = ("av", "filelock", "jinja2", "matplotlib", "mujoco", "numba", "numpy", "PIL", "pooch", "pydantic", "scipy")
RECORDED = (  # of a run's settings.json, what --config takes
    "protocol", "start", "horizon", "pieces", "method", "advisor", "budget", "seed", "finish", "scale", "max_steps",
    "probes", "hold_out", "starts",
)  # fmt: skip
EVERYWHERE = """\
Every command takes --config FILE, a TOML file of its options; --debug, which shows tracebacks; --allow-code, which
permits the Python code that a robot file or a policy names; and --allow-outside, which permits files outside of a
model's folder. Permissions are stored."""


def main(argv: Sequence[str] | None = None) -> None:
    """Runs a command and exits: 0 done, 1 the work failed (with a sentence), 2 wrong arguments."""
    words = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in words
    allowed = [option for option in consent.OPTIONS if option in words]
    words = [word for word in words if word not in ("--debug", *consent.OPTIONS)]
    log = logging.StreamHandler()
    log.setFormatter(LogLine())
    logging.basicConfig(level=logging.WARNING, handlers=[log])
    warnings.formatwarning = warning_line
    logging.getLogger("swim2real").setLevel(logging.DEBUG if debug else logging.WARNING)
    # before NumPy is imported: matrices are small, and threads of linear algebra would only wait for one another
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # keep third-party pydantic plugins from altering validation
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        with consent.allowing(allowed):
            code = parsed(words)()
        sys.stdout.flush()
    except Swim2RealError as error:
        if debug:
            raise
        tell(str(error))
        code = error.exit_code
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever presses it again gets the same end
        tell("interrupted")
        code = 1
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:
        if debug:
            raise
        tell(f"{reason(error)}: {error.filename or ''}".rstrip(": "))
        code = 1
    except Exception as error:  # a fault of ours, which is no reason to frighten anybody
        if debug:
            raise
        what = f"unexpected {type(error).__name__}: {error}; --debug shows where"
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] in CORE:
            what = f"{error.name} isn't installed; install it with: pip install swim2real"
        elif strange := _unreadable():
            what = f"the entry points of the installed package {strange} can't be read, by which libraries find theirs"
            what += f" ({type(error).__name__}: {error}); install it anew or remove it"
        tell(what)
        code = 1
    sys.exit(code)


def _unreadable() -> str:
    """An installed package whose entry points can't be read, which breaks any library that asks for some; or none."""
    for package in metadata.distributions():
        try:
            _ = package.entry_points
        except Exception:
            return quoted(Path(str(getattr(package, "_path", "?"))).stem)
    return ""


def parsed(words: list[str]) -> Callable[[], int]:
    """A command with its arguments, ready to run.

    Raises:
        ArgumentError: There is no such command, or a setting is outside what is allowed.
        SystemExit: The arguments can't be read, or help was asked for.
    """
    commands = {name: command for group in COMMANDS.values() for name, command in group.items()}
    name, rest = (words[0], words[1:]) if words else ("--help", [])
    if name == "--version":
        return lambda: say(f"swim2real {__version__}") or 0
    if name in ("-h", "--help"):
        return lambda: say(overview()) or (0 if words else 2)
    if name not in commands:
        begun = [command for command in commands if len(name) > 2 and command.startswith(name)]
        near = begun or difflib.get_close_matches(name.lower().replace("_", "-"), commands, n=1)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else "."
        raise ArgumentError(f"there is no command '{name}'{hint} There are {', '.join(commands)}")
    flags = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone)

    def read(given: Sequence[str]) -> Any:
        return tyro.cli(_deferred(commands[name]), prog=f"swim2real {name}", args=given, config=flags)

    if "--config" in rest:
        rest = configured(rest)
    if "--help-all" in rest:
        return lambda: say(f"{captured(lambda: read(['--help']))}{EVERYWHERE}") or 0
    if {"-h", "--help"} & set(rest):
        return lambda: say(first_screen(name, captured(lambda: read(["--help"])))) or 0
    return read(rest)


def configured(words: Sequence[str]) -> list[str]:
    """The words of a command, with those of its file of options in place of --config FILE; words given win.

    The file is TOML or JSON, an option a key, such as a run's settings.json; null leaves an option as it is.

    Raises:
        ArgumentError: There is no such file, it can't be read, or an option's value is no value of an option.
    """
    at = words.index("--config")
    if at + 1 == len(words):
        raise ArgumentError("--config has no value; give a file of options, such as run.toml")
    path, rest = Path(words[at + 1]), [*words[:at], *words[at + 2 :]]
    try:
        text = path.read_text(encoding="utf-8")
        content: Any = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, ValueError) as error:
        raise ArgumentError(f"--config is '{path}', which can't be read as TOML or JSON: {error}") from error
    if path.suffix == ".json":  # what is on record of a run, beside what decides it
        content = {key: value for key, value in content.items() if key in RECORDED}
    given = {word.partition("=")[0] for word in rest}
    added = list[str]()
    for key, value in content.items():
        option = f"--{key.replace('_', '-')}"
        if option in given or value is None or value is False or value == []:
            continue
        if isinstance(value, dict):
            raise ArgumentError(f"'{path}' has a table '{key}'; write its options without a table")
        values = cast("list[object]", value) if isinstance(value, list) else [] if value is True else [value]
        added += [option, *map(str, values)]
    return [*rest, *added]


def overview() -> str:
    """All commands, a line each."""
    width = max(len(name) for group in COMMANDS.values() for name in group)
    lines = [
        "usage: swim2real COMMAND [OPTIONS]",
        "",
        "From videos of a swimming robot to a calibrated MuJoCo simulator.",
        "",
        "Start here: swim2real demo. Then, with films of your own: pick, track, calibrate, view. With a model of",
        "your own, begin with init and check.",
    ]
    for title, group in COMMANDS.items():
        lines += ["", f"{title}:"]
        for name, command in group.items():
            lines.append(f"  {name:<{width}}  {(command.__doc__ or '').strip().splitlines()[0]}")
    ends = (
        "swim2real COMMAND --help explains a command, --help-all all of its options.",
        "--version prints the version.",
        EVERYWHERE,
    )
    return "\n".join([*lines, "", *ends])


def _deferred(command: Command) -> Callable[..., Callable[[], int]]:
    """The command as a function of the same arguments that doesn't run yet: its errors aren't those of parsing."""

    @functools.wraps(command)
    def prepared(*arguments: Any, **named: Any) -> Callable[[], int]:
        return functools.partial(command, *arguments, **named)

    _flow(command)
    return prepared


def _flow(described: Any) -> None:
    """Joins the lines of each argument's description, so that they wrap where the terminal does; its settings' too."""
    described.__doc__ = re.sub(r"\n {8,}(?=\S)", " ", inspect.cleandoc(described.__doc__ or ""))
    for kind in get_type_hints(described).values():
        for part in filter(is_dataclass, getattr(kind, "__mro__", ())):
            _flow(part)
