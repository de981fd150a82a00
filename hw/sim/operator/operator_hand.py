"""How the rig's operator knows his hand to stand to the arm."""

from __future__ import annotations

from tams_app.config import Config, HandConfig


def operator_hand(config: Config) -> HandConfig:
    """What a simulated hand moves by: the rig's true frame, whatever teleoperation maps by."""
    if config.rig.hand_rotation is None:
        return config.hand
    return config.hand.model_copy(update={"rotation": config.rig.hand_rotation})
