"""The channels for viewers of a session, derived from the records that its log keeps.

Foxglove's own messages beside ours: log lines, the arm and its surroundings, pictures as they were
shown, the rates of each second; in the log's file and, if asked for, live over a WebSocket.
"""

from tams_app.telemetry.scene import Scene
from tams_app.telemetry.telemetry import Telemetry

__all__ = ["Scene", "Telemetry"]
