"""From robot-side signals to bits per view: phase, weights, budget, allocation."""
