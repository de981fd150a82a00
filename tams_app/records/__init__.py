"""The plain frozen records that flow between the packages.

Units inside TAMS: metres, radians, seconds; `*_ns` are integer nanoseconds of one monotonic clock,
taken where the thing happened; `*_kbps` are kbit/s of IP datagram bytes (RTP packet + 28).
Vectors are float64 arrays of shape (3,), joints of shape (6,); what a tick computes with is plain
floats (`Floats3`).
"""

from tams_app.records.arm import (
    Activity,
    ArmFault,
    ArmState,
    CommandLink,
    LinkFault,
    MountPrediction,
    ServoMode,
)
from tams_app.records.episode import Episode, EpisodeRequest
from tams_app.records.figure import (
    NO_DISTORTION,
    ArmFigure,
    Lens,
    Solid,
    SolidKind,
    focal_length_px,
)
from tams_app.records.frames import (
    CameraRates,
    DroppedFrame,
    EncodedFrame,
    Frame,
    FrameQuality,
    Image,
    ShownFrame,
    SteeredBy,
    TaskRegion,
)
from tams_app.records.geometry import (
    Pose,
    Twist,
    Vector,
)
from tams_app.records.hand import (
    ControllerSample,
    ControllerStatus,
    Haptic,
    Presses,
)
from tams_app.records.link import (
    HandHeard,
    LinkHealth,
    StateHeard,
)
from tams_app.records.log import (
    LATE_NS,
    Note,
    StopRecord,
    SystemSample,
    Tick,
    TickInputs,
)
from tams_app.records.policy import (
    Allocation,
    Phase,
    PhaseChange,
    PinnedView,
)
from tams_app.records.record import CaptureNs, FrameIndex, Record, TimeNs, ViewName
from tams_app.records.state import (
    LINK_LOST,
    EpisodesState,
    EpisodeState,
    LatencyState,
    SessionState,
    ViewState,
    Whole,
    without_figures,
)
from tams_app.records.trial import (
    OperatorGlance,
    Outcome,
    SceneTruth,
)
from tams_app.records.uplink import (
    IP_UDP_HEADER_BYTES,
    LinkCapacity,
    PacketArrival,
    PacketFate,
    PacketKind,
    PacketRecord,
    PolicyInputs,
    Reception,
    UplinkReport,
    UplinkSummary,
)

__all__ = [
    "IP_UDP_HEADER_BYTES",
    "LATE_NS",
    "LINK_LOST",
    "NO_DISTORTION",
    "Activity",
    "Allocation",
    "ArmFault",
    "ArmFigure",
    "ArmState",
    "CameraRates",
    "CaptureNs",
    "CommandLink",
    "ControllerSample",
    "ControllerStatus",
    "DroppedFrame",
    "EncodedFrame",
    "Episode",
    "EpisodeRequest",
    "EpisodeState",
    "EpisodesState",
    "Frame",
    "FrameIndex",
    "FrameQuality",
    "HandHeard",
    "Haptic",
    "Image",
    "LatencyState",
    "Lens",
    "LinkCapacity",
    "LinkFault",
    "LinkHealth",
    "MountPrediction",
    "Note",
    "OperatorGlance",
    "Outcome",
    "PacketArrival",
    "PacketFate",
    "PacketKind",
    "PacketRecord",
    "Phase",
    "PhaseChange",
    "PinnedView",
    "PolicyInputs",
    "Pose",
    "Presses",
    "Reception",
    "Record",
    "SceneTruth",
    "ServoMode",
    "SessionState",
    "ShownFrame",
    "Solid",
    "SolidKind",
    "StateHeard",
    "SteeredBy",
    "StopRecord",
    "SystemSample",
    "TaskRegion",
    "Tick",
    "TickInputs",
    "TimeNs",
    "Twist",
    "UplinkReport",
    "UplinkSummary",
    "Vector",
    "ViewName",
    "ViewState",
    "Whole",
    "focal_length_px",
    "without_figures",
]
