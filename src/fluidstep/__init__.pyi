from .batch import Batch as Batch
from .engine import UnsupportedModelError as UnsupportedModelError
from .step import FastStep as FastStep
from .step import Steps as Steps
from .step import disagreement as disagreement
