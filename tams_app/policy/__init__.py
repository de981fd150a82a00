"""From robot-side signals to a target per view: phase, weights, budget, allocation."""

from tams_app.policy.allocation import STRATEGIES, Strategy, allocate, make_strategy
from tams_app.policy.budget import Budget
from tams_app.policy.engine import Policy
from tams_app.policy.phases import PhaseDecision, PhaseParameters, PhaseTracker, infer_phase
from tams_app.policy.weights import WeightMatrix

__all__ = [
    "STRATEGIES",
    "Budget",
    "PhaseDecision",
    "PhaseParameters",
    "PhaseTracker",
    "Policy",
    "Strategy",
    "WeightMatrix",
    "allocate",
    "infer_phase",
    "make_strategy",
]
