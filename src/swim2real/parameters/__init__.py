"""The simulator parameters that are calibrated: bounds, units, meaning, the unit cube, and their file."""

from swim2real.parameters.file import ParametersFile, read_parameters, robot_of, write_parameters
from swim2real.parameters.space import Parameter, ParameterSpace, Values

__all__ = [
    "Parameter", "ParameterSpace", "ParametersFile", "Values", "read_parameters", "robot_of", "write_parameters",
]  # fmt: skip
