"""The relay's reports as bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.relay_wire import BatchDecoder, RelayStatistics, encode_batch

pytestmark = pytest.mark.waiting

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
counts = st.integers(0, 2**63)
statistics = st.builds(RelayStatistics, *[counts] * 9)
batches = st.lists(st.tuples(st.lists(records, max_size=4), statistics), max_size=4)


@given(batches, st.integers(1, 60))
def test_what_was_encoded_is_read_back_however_the_bytes_arrive(sent, piece):
    stream = b"".join(encode_batch(VIEWS, *batch) for batch in sent)
    decoder = BatchDecoder(VIEWS)
    received = []
    for start in range(0, len(stream), piece):
        received += decoder.feed(stream[start : start + piece])
    assert received == sent


def test_a_batch_cut_short_is_not_handed_out():
    decoder = BatchDecoder(VIEWS)
    whole = encode_batch(VIEWS, [], RelayStatistics(sent=5))
    assert decoder.feed(whole[:-1]) == []
    assert decoder.feed(whole[-1:]) == [([], RelayStatistics(sent=5))]
