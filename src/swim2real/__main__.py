"""`python -m swim2real`."""

from swim2real.cli import main

main()
