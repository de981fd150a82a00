"""The plain frozen records that flow between the packages.

Units inside TAMS: metres, radians, seconds; `*_ns` are integer nanoseconds of one monotonic clock,
taken where the thing happened; `*_kbps` are kbit/s of IP datagram bytes (RTP packet + 28).
Vectors are float64 arrays of shape (3,), joints of shape (6,); what a tick computes with is plain
floats (`Floats3`).
"""

from tams_app.records.arm import Activity as Activity
from tams_app.records.arm import ArmFault as ArmFault
from tams_app.records.arm import ArmKinematics as ArmKinematics
from tams_app.records.arm import ArmState as ArmState
from tams_app.records.arm import CommandLink as CommandLink
from tams_app.records.arm import LinkFault as LinkFault
from tams_app.records.arm import MountPrediction as MountPrediction
from tams_app.records.arm import ServoMode as ServoMode
from tams_app.records.figure import FAR_PX as FAR_PX
from tams_app.records.figure import NO_DISTORTION as NO_DISTORTION
from tams_app.records.figure import ArmFigure as ArmFigure
from tams_app.records.figure import Lens as Lens
from tams_app.records.figure import Solid as Solid
from tams_app.records.figure import SolidKind as SolidKind
from tams_app.records.figure import focal_length_px as focal_length_px
from tams_app.records.frames import CameraRates as CameraRates
from tams_app.records.frames import DroppedFrame as DroppedFrame
from tams_app.records.frames import EncodedFrame as EncodedFrame
from tams_app.records.frames import Frame as Frame
from tams_app.records.frames import FrameQuality as FrameQuality
from tams_app.records.frames import Image as Image
from tams_app.records.frames import ShownFrame as ShownFrame
from tams_app.records.frames import SteeredBy as SteeredBy
from tams_app.records.frames import TaskRegion as TaskRegion
from tams_app.records.hand import ControllerSample as ControllerSample
from tams_app.records.hand import ControllerStatus as ControllerStatus
from tams_app.records.hand import Haptic as Haptic
from tams_app.records.hand import Presses as Presses
from tams_app.records.log import LATE_NS as LATE_NS
from tams_app.records.log import Episode as Episode
from tams_app.records.log import EpisodeRequest as EpisodeRequest
from tams_app.records.log import HandHeard as HandHeard
from tams_app.records.log import LinkHealth as LinkHealth
from tams_app.records.log import Note as Note
from tams_app.records.log import OperatorGlance as OperatorGlance
from tams_app.records.log import Outcome as Outcome
from tams_app.records.log import Placed as Placed
from tams_app.records.log import SceneTruth as SceneTruth
from tams_app.records.log import StateHeard as StateHeard
from tams_app.records.log import StopRecord as StopRecord
from tams_app.records.log import SystemSample as SystemSample
from tams_app.records.log import TakeNote as TakeNote
from tams_app.records.log import Tick as Tick
from tams_app.records.log import TickInputs as TickInputs
from tams_app.records.policy import IP_UDP_HEADER_BYTES as IP_UDP_HEADER_BYTES
from tams_app.records.policy import Allocation as Allocation
from tams_app.records.policy import LinkCapacity as LinkCapacity
from tams_app.records.policy import PacketArrival as PacketArrival
from tams_app.records.policy import PacketFate as PacketFate
from tams_app.records.policy import PacketKind as PacketKind
from tams_app.records.policy import PacketRecord as PacketRecord
from tams_app.records.policy import Phase as Phase
from tams_app.records.policy import PhaseChange as PhaseChange
from tams_app.records.policy import PinnedView as PinnedView
from tams_app.records.policy import PolicyInputs as PolicyInputs
from tams_app.records.policy import Reception as Reception
from tams_app.records.policy import UplinkReport as UplinkReport
from tams_app.records.policy import UplinkSummary as UplinkSummary
from tams_app.records.record import CaptureNs as CaptureNs
from tams_app.records.record import FrameIndex as FrameIndex
from tams_app.records.record import Newest as Newest
from tams_app.records.record import Pose as Pose
from tams_app.records.record import Record as Record
from tams_app.records.record import TimeNs as TimeNs
from tams_app.records.record import Twist as Twist
from tams_app.records.record import Vector as Vector
from tams_app.records.record import ViewName as ViewName
from tams_app.records.state import LINK_LOST as LINK_LOST
from tams_app.records.state import EpisodesState as EpisodesState
from tams_app.records.state import EpisodeState as EpisodeState
from tams_app.records.state import LatencyState as LatencyState
from tams_app.records.state import SessionState as SessionState
from tams_app.records.state import ViewState as ViewState
from tams_app.records.state import Whole as Whole
from tams_app.records.state import without_figures as without_figures
