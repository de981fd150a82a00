"""What really is, for the trial's rules and the scripted operator: never for the application."""

from __future__ import annotations

from hw.sim.world.world_memory import RigPace, WorldReader
from tams_app.records import SceneTruth


class TruthReader:
    """Reads the rig's world under `memory_name`; DeviceError when the rig never started."""

    def __init__(self, memory_name: str) -> None:
        self._reader = WorldReader(memory_name)

    def read(self) -> SceneTruth | None:
        """Where things are, stamped with the simulated instant; None before the first cycle."""
        snapshot = self._reader.read()
        return snapshot.truth if snapshot else None

    def pace(self) -> RigPace | None:
        """How well the rig keeps up with the wall clock; for the log."""
        snapshot = self._reader.read()
        return snapshot.pace if snapshot else None

    def close(self) -> None:
        self._reader.close()
