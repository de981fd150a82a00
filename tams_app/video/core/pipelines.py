"""The launch descriptions of the video chains, in pieces.

`encoder_chain` and `decoder_chain` are the paper's chains without their ends. Live, `VideoSender`
and `VideoReceiver` put an appsrc or appsink and an rtpsession around them, between the network's
ends. Settings and their reasons: FINDINGS 2 and 3.
"""

from __future__ import annotations

from tams_app.config import VideoConfig
from tams_app.units import NS_PER_MS
from tams_app.video.core.codecs import DECODER_LAUNCH, encoder_launch
from tams_app.video.core.packets import (
    MEDIA_PAYLOAD_TYPE,
    PADDING_PAYLOAD_TYPE,
    PARITY_PAYLOAD_TYPE,
    REPAIR_PAYLOAD_TYPE,
    TRANSPORT_SEQUENCE_BYTES,
    TRANSPORT_SEQUENCE_URI,
    media_ssrc,
    repair_ssrc,
)
from tams_app.video.core.rate_control import X264_FPS
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.sender import StreamSettings

RTCP_CAPS = "application/x-rtcp"
# To a payloader: write the extension. To a receiving session: report on what has it, after the last
# packet of each frame. Reports in steps of 25 to 50 ms would leave the end of a frame, in which a
# queue shows, until the next frame comes.
_TRANSPORT_SEQUENCE = f"extmap-1={TRANSPORT_SEQUENCE_URI}"
# AVPF (RFC 4585) lets NACK and PLI leave early, but only one in each regular interval, which is
# 5 % of the session's bandwidth: estimated from one view it is so long that NACKs came 400 ms late.
SESSION_BANDWIDTH_BPS = 10_000_000
RECEIVER_REPORTS_NS = 20 * NS_PER_MS
# Nothing a sender reports is urgent, and it shares the uplink: at 20 ms it took 70 kbit/s a view.
SENDER_REPORTS_NS = 500 * NS_PER_MS
_SESSION = f"rtpsession name=session rtp-profile=avpf bandwidth={SESSION_BANDWIDTH_BPS}"
RECEIVING_SESSION = f"{_SESSION} rtcp-min-interval={RECEIVER_REPORTS_NS}"
SENDING_SESSION = f"{_SESSION} rtcp-min-interval={SENDER_REPORTS_NS} update-ntp64-header-ext=false"
RTX_HISTORY_MS = 1000
RTX_PAYLOAD_TYPES = f"application/x-rtp-pt-map,{MEDIA_PAYLOAD_TYPE}=(uint){REPAIR_PAYLOAD_TYPE};"
# The last media packets, and every parity packet: nothing of Python runs for a media packet.
RECENT_SINK = "appsink name=recent async=false sync=false max-buffers=256 drop=true"
_ENCODINGS = {
    REPAIR_PAYLOAD_TYPE: "RTX",
    PARITY_PAYLOAD_TYPE: "PARITY",
    PADDING_PAYLOAD_TYPE: "PADDING",
}
_PACED = "! queue name=paced max-size-buffers=0 max-size-bytes=0 max-size-time=0 "
PARITY_SINK = (
    "appsink name=parity async=false sync=false emit-signals=true max-buffers=64 drop=true"
)
# Without async=false a live appsink never leaves PAUSED.
SHOWN_FRAMES = (
    "appsink name=frames async=false sync=false emit-signals=true max-buffers=4 drop=true"
)


def raw_caps(config: VideoConfig) -> str:
    """Caps of raw frames, at the rate that x264 is to take them for.

    GStreamer would take 720 rows or more for BT.709; `codecs` has one matrix.
    """
    return (
        f"video/x-raw,format=I420,colorimetry=bt601,width={config.width},height={config.height},"
        f"framerate={X264_FPS}/1"
    )


def received_caps(feedback: bool) -> str:
    """Caps of what a receiving session gets; `feedback`: it is to report when each packet came."""
    extension = f",{_TRANSPORT_SEQUENCE},rtcp-fb-transport-cc=true" if feedback else ""
    return rtp_caps() + extension


def rtp_caps(payload_type: int = MEDIA_PAYLOAD_TYPE) -> str:
    """Caps of the RTP stream with `payload_type`, asking for NACK and PLI."""
    common = f"application/x-rtp,media=video,clock-rate=90000,payload={payload_type}"
    encoding = _ENCODINGS.get(payload_type, "H264,rtcp-fb-nack=true,rtcp-fb-nack-pli=true")
    return f"{common},encoding-name={encoding}"


def rtx_ssrcs(config: VideoConfig, view: str) -> str:
    """The structure that maps a view's media SSRC to its repair SSRC."""
    media, repair = media_ssrc(config, view), repair_ssrc(config, view)
    return f"application/x-rtp-ssrc-map,{media}=(uint){repair};"


def encoder_chain(
    stream: StreamSettings, encoder_kbps: int, feedback: bool = False, paced: bool = False
) -> str:
    """I420 frames in, RTP packets out; with `feedback` they are numbered for the receiver's.

    `paced`: they wait in the queue of that name, as lists: what sets the numbers' caps takes a list
    apart, and Python would be called for each packet.
    """
    config, ssrc = stream.config, media_ssrc(stream.config, stream.view)
    extension = f"! application/x-rtp,{_TRANSPORT_SEQUENCE} " if feedback else ""
    # the payloader does not count what an extension takes
    mtu_bytes = config.mtu_bytes - feedback * TRANSPORT_SEQUENCE_BYTES
    return (
        f"{encoder_launch(config, encoder_kbps)} ! h264parse "
        f"! rtph264pay name=payloader pt={MEDIA_PAYLOAD_TYPE} ssrc={ssrc} "
        f"mtu={mtu_bytes} config-interval=-1 aggregate-mode=zero-latency "
        f"timestamp-offset=0 seqnum-offset=0 {_PACED if paced else ''}{extension}"
    )


def decoder_chain(rule: RepairRule) -> str:
    """RTP packets in, I420 frames out.

    mode=none keeps PTS an exact linear function of the RTP timestamp (see frame_identity); its
    deadlines then count from running time 0 unless `ts-offset` is set to the first arrival.
    rtx-next-seqnum=false: else a packet not yet sent is asked for, and given up when `latency` is
    less than a frame. rtx-delay=0: the link does not reorder, so a gap is a loss.
    """
    return (
        f"rtpjitterbuffer name=jitterbuffer mode=none latency={rule.latency_ms} do-lost=true "
        f"do-retransmission={'true' if rule.rtx else 'false'} rtx-next-seqnum=false rtx-delay=0 "
        f'! rtpptdemux name=ptdemux ignored-payload-types="<{REPAIR_PAYLOAD_TYPE}>" '
        f"! rtph264depay name=depayloader request-keyframe=true ! h264parse ! {DECODER_LAUNCH}"
    )
