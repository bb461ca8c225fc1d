"""Methods against methods: many runs under one budget, and who wins, by how much, and how surely."""

from swim2real.comparison.compare import ComparisonProgress, JobReport, compare
from swim2real.comparison.plan import MethodVariant, Plan, default_methods, make_plan, method_variant, read_plan
from swim2real.comparison.results import ComparisonResults, RunResult, load_results, read_results, write_results

__all__ = [
    "ComparisonProgress", "ComparisonResults", "JobReport", "MethodVariant", "Plan", "RunResult", "compare",
    "default_methods", "load_results", "make_plan", "method_variant", "read_plan", "read_results", "write_results",
]  # fmt: skip
