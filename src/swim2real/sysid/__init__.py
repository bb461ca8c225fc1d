"""MuJoCo's own identification toolbox: its least squares, and parameters and trials as its objects and files."""

from swim2real.sysid.files import load, read_values, save
from swim2real.sysid.least_squares import least_squares
from swim2real.sysid.problem import SysidProblem, to_sysid

__all__ = ["SysidProblem", "least_squares", "load", "read_values", "save", "to_sysid"]
