"""Methods against methods: many runs under one budget, and who wins, by how much, and how surely."""

from swim2real.comparison.compare import ComparisonProgress, compare
from swim2real.comparison.contestants import Contestant, contestant, contestants, table_methods
from swim2real.comparison.jobs import JobReport
from swim2real.comparison.plan import Job, Plan, make_plan, read_plan
from swim2real.comparison.results import (
    ComparisonResults,
    RunResult,
    StepRound,
    VlmUsage,
    load_results,
    read_results,
    write_results,
)

__all__ = [
    "ComparisonProgress",
    "ComparisonResults",
    "Contestant",
    "Job",
    "JobReport",
    "Plan",
    "RunResult",
    "StepRound",
    "VlmUsage",
    "compare",
    "contestant",
    "contestants",
    "load_results",
    "make_plan",
    "read_plan",
    "read_results",
    "table_methods",
    "write_results",
]
