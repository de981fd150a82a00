"""The controller in the hand of an operator at another computer."""
