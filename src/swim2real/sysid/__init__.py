"""MuJoCo's own identification toolbox: its least squares, and parameters and trials as its objects and files."""

from swim2real.sysid.problem import SysidProblem, load, read_values, save, to_sysid
from swim2real.sysid.toolbox import least_squares

__all__ = ["SysidProblem", "least_squares", "load", "read_values", "save", "to_sysid"]
