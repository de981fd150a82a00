"""The relay's reports as bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.live.reporting_helper import decoded, line_of

pytestmark = pytest.mark.waiting

RECORD = PacketRecord("eih", PacketKind.MEDIA, 1, 100, 1, 2, 3, PacketFate.DELIVERED)
VIEWS = ("eih", "gt", "gs")
times = st.integers(0, 2**63)

records = st.builds(
    PacketRecord,
    view=st.sampled_from(VIEWS),
    kind=st.sampled_from(list(PacketKind)),
    sequence=st.integers(0, 65_535),
    size_bytes=st.integers(28, 65_535),
    entered_ns=times,
    departed_ns=times,
    delivered_ns=times,
    fate=st.sampled_from(list(PacketFate)),
    rtp_timestamp=st.integers(0, 2**32 - 1),
)
reports = st.lists(records, max_size=4)


@given(st.lists(reports, max_size=4), st.integers(1, 60))
def test_what_was_sent_is_read_back_however_the_bytes_arrive(sent, length):
    stream = b"".join(map(line_of, sent))
    pieces = [stream[start : start + length] for start in range(0, len(stream), length)]
    assert list(decoded(pieces, list[PacketRecord])) == sent


def test_a_report_cut_short_is_not_handed_out():
    line = line_of([RECORD])
    assert list(decoded([line[:-1]], list[PacketRecord])) == []
