"""Optimizers behind one ask/tell contract. They see the unit cube and losses, and know no physics."""

from swim2real.optimizers.advisor import (
    Advice,
    Advisor,
    Measurement,
    Proposal,
    Round,
    ScriptedAdvisor,
    Situation,
    Step,
    recorded_advice,
)
from swim2real.optimizers.bayesopt import BayesianOptimization
from swim2real.optimizers.cma_es import CmaEs
from swim2real.optimizers.contract import Candidate, Evaluation, Optimizer, RandomSearch, Sequel, first_point, streams
from swim2real.optimizers.least_squares import LeastSquares
from swim2real.optimizers.line_search import BacktrackingLineSearch, ProposalSearch
from swim2real.optimizers.multi_start import MultiStart
from swim2real.optimizers.staged import Stage, Staged

__all__ = [
    "Advice", "Advisor", "BacktrackingLineSearch", "BayesianOptimization", "Candidate", "CmaEs", "Evaluation",
    "LeastSquares", "Measurement", "MultiStart", "Optimizer", "Proposal", "ProposalSearch", "RandomSearch", "Round",
    "ScriptedAdvisor", "Sequel", "Situation", "Stage", "Staged", "Step", "first_point", "recorded_advice", "streams",
]  # fmt: skip
