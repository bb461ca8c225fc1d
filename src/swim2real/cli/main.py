"""Parses the command line, runs a command, and turns errors into sentences and exit codes."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from typing import Any

import tyro

from swim2real import __version__
from swim2real.cli import arguments as args
from swim2real.errors import Swim2RealError

CORE = ("av", "filelock", "jinja2", "matplotlib", "mujoco", "numba", "numpy", "PIL", "pooch", "pydantic", "scipy")


def main(argv: Sequence[str] | None = None) -> None:
    """Runs a command and exits: 0 done, 1 the work failed (with a sentence), 2 wrong arguments."""
    words = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    if words == ["--version"]:
        print(f"swim2real {__version__}")
        sys.exit(0)
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, format="%(levelname)s: %(message)s")
    logging.getLogger("numba").setLevel(logging.WARNING)  # a compiler's diary
    # before NumPy is imported: matrices are small, and threads of linear algebra would only wait for one another
    for library in ("OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    try:
        code = _run(_parsed(words))
        sys.stdout.flush()
    except Swim2RealError as error:
        if debug:
            raise
        print(f"swim2real: {error}", file=sys.stderr)
        code = error.exit_code
    except KeyboardInterrupt:
        print("swim2real: interrupted", file=sys.stderr)
        code = 1
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:
        if debug:
            raise
        print(f"swim2real: {error.strerror or error}: {error.filename or ''}".rstrip(": "), file=sys.stderr)
        code = 1
    except Exception as error:  # a fault of ours, which is no reason to frighten anybody
        if debug:
            raise
        what = f"unexpected {type(error).__name__}: {error}; --debug shows where"
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] in CORE:
            what = f"{error.name} isn't installed; install it with: pip install swim2real"
        print(f"swim2real: {what}", file=sys.stderr)
        code = 1
    sys.exit(code)


def _parsed(words: list[str]) -> args.Command:
    command: Any = tyro.cli(
        args.Command,  # pyright: ignore[reportArgumentType]
        prog="swim2real",
        description="From videos of a swimming robot to a calibrated MuJoCo simulator. --debug shows tracebacks.",
        args=words,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
    return command


def _run(command: args.Command) -> int:
    # each command's module brings what it needs, so that the others stay quick
    match command:
        case args.Calibrate():
            from swim2real.cli.calibrate import calibrate

            return calibrate(command)
        case args.Check():
            from swim2real.cli.check import check

            return check(command)
        case args.Compare():
            from swim2real.cli.compare import compare

            return compare(command)
        case args.Demo():
            from swim2real.cli.demo import demo

            return demo(command)
        case args.Deploy():
            from swim2real.cli.deploy import deploy

            return deploy(command)
        case args.Ensemble():
            from swim2real.cli.ensemble import ensemble

            return ensemble(command)
        case args.Identify():
            from swim2real.cli.identify import identify

            return identify(command)
        case args.Init():
            from swim2real.cli.init import init

            return init(command)
        case args.Evaluate():
            from swim2real.cli.evaluate import evaluate

            return evaluate(command)
        case args.ExportCommands():
            from swim2real.cli.rollout import export_commands

            return export_commands(command)
        case args.ExportModel():
            from swim2real.cli.export_model import export_model

            return export_model(command)
        case args.ExportSysid():
            from swim2real.cli.sysid import export_sysid

            return export_sysid(command)
        case args.ImportSysid():
            from swim2real.cli.sysid import import_sysid

            return import_sysid(command)
        case args.Rollout():
            from swim2real.cli.rollout import rollout

            return rollout(command)
        case args.Train():
            from swim2real.cli.train import train

            return train(command)
        case args.Overlay():
            from swim2real.cli.overlay import overlay

            return overlay(command)
        case args.Quality():
            from swim2real.cli.quality import quality

            return quality(command)
        case args.Simulate():
            from swim2real.cli.simulate import simulate

            return simulate(command)
        case args.Track():
            from swim2real.cli.track import track

            return track(command)
        case args.Pick():
            from swim2real.cli.pick import pick

            return pick(command)
        case args.ImportTracks():
            from swim2real.cli.import_tracks import import_tracks

            return import_tracks(command)
        case args.Report():
            from swim2real.cli.files import report

            return report(command)
        case args.Fetch():
            from swim2real.cli.files import fetch

            return fetch(command)
