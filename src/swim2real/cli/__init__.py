"""The command line: the only room that prints."""

from swim2real.cli.main import main

__all__ = ["main"]
