"""Methods of calibration, an entry each: settings, their help, comparisons and charts follow from it.

The command line reads the entries before it imports what a command works with, so this module needs the standard
library alone, and an entry names the function that makes its optimizer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

_MADE = "swim2real.pipeline.methods:"


@dataclass(frozen=True)
class Method:
    """A method of calibration.

    Attributes:
        help: Explanation in a few words.
        make: Function that makes its optimizer of a `Start`, as module:name.
        advised: Whether an advisor proposes.
        staged: Whether it needs a robot that has a plan of stages.
        planned_by_budget: Whether a run can't go on with another budget.
        cost: Duration of an evaluation relative to a random search's, with what the method itself takes.
        by_default: Whether a comparison has it where no methods are named.
    """

    help: str
    make: str
    advised: bool = False
    staged: bool = False
    planned_by_budget: bool = False
    cost: float = 1.0
    by_default: bool = True


METHODS = {
    "line-search": Method(
        "an advisor's proposals with backtracking; the default with --advisor", f"{_MADE}line_search",
        advised=True,
    ),
    "proposal-search": Method(
        "the advisor is asked again after each step that fails, and may name steps and alternatives",
        f"{_MADE}proposal_search", advised=True, by_default=False,
    ),
    "random": Method("points anywhere within the bounds", f"{_MADE}random_search"),
    "cma-es": Method("pycma", f"{_MADE}cma_es"),
    "bayesopt": Method("scikit-optimize", f"{_MADE}bayesopt", cost=3.0),
    "least-squares": Method("Levenberg-Marquardt with finite differences", f"{_MADE}least_squares"),
    "multi-start": Method(
        "least squares from several starts, first on the shape of the motion; the default otherwise",
        f"{_MADE}multi_start", by_default=False,
    ),
    "mujoco-sysid": Method("the least squares of MuJoCo's own toolbox", f"{_MADE}mujoco_sysid", by_default=False),
    "staged": Method(
        "the prior work's manual stages", f"{_MADE}staged", staged=True, planned_by_budget=True, cost=2.0
    ),
}  # fmt: skip
ABLATION = "no-line-search"  # line-search with a single step, in comparisons
ADVISED = tuple(name for name, method in METHODS.items() if method.advised)

if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[tuple(METHODS)]  # by which pydantic and tyro know what is allowed
