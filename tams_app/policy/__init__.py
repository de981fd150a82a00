"""From robot-side signals to a target per view: phase, weights, budget, allocation."""
