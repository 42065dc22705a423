"""What a client's outbox keeps, in which order, and what a slow client loses."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.outbox import MAX_BYTES, MAX_SAMPLE_BYTES, Frame, Outbox


def taken(outbox: Outbox) -> list[Frame]:
    frames = []
    while (frame := outbox.take()) is not None:
        frames.append(frame)
    return frames


def test_newest_samples_are_kept_and_state_is_never_dropped() -> None:
    outbox = Outbox()
    for number in range(100):
        outbox.put(Frame(f"scan {number}".encode(), stream="/scan", depth=2))
        outbox.put(Frame(f"state {number}".encode()))
    sent = [frame.data.decode() for frame in taken(outbox)]
    assert [text for text in sent if text.startswith("scan")] == ["scan 98", "scan 99"]
    assert [text for text in sent if text.startswith("state")] == [f"state {number}" for number in range(100)]
    assert outbox.dropped == 98


def test_memory_for_client_that_never_reads_is_bounded() -> None:
    outbox = Outbox()
    for number in range(3000):
        outbox.put(Frame(bytes(100_000), stream=f"/image{number % 40}", depth=1000))
    assert outbox.waiting_bytes <= MAX_SAMPLE_BYTES
    assert not outbox.overflowed
    while not outbox.overflowed:
        outbox.put(Frame(bytes(1_000_000)))
    assert outbox.waiting_bytes <= MAX_BYTES + MAX_SAMPLE_BYTES + 1_000_000


def test_sample_larger_than_the_limit_is_sent_alone() -> None:
    outbox = Outbox()
    for _ in range(3):
        outbox.put(Frame(bytes(2 * MAX_SAMPLE_BYTES), stream="/points"))
    assert len(taken(outbox)) == 1


_FRAMES = st.builds(
    Frame,
    st.binary(max_size=20),
    stream=st.sampled_from(["", "/a", "/b"]),
    depth=st.integers(0, 3),
)


@given(st.lists(st.one_of(_FRAMES, st.none()), max_size=60))
def test_frames_keep_their_order_and_the_counts_agree(actions: list[Frame | None]) -> None:
    outbox, put, sent = Outbox(), [], []
    for action in actions:
        if action is None:
            frame = outbox.take()
            sent += [frame] if frame is not None else []
        else:
            put.append(action)
            outbox.put(action)
    sent += taken(outbox)
    remaining = iter(put)
    assert all(any(frame is each for each in remaining) for frame in sent)  # in order
    assert [frame for frame in sent if not frame.stream] == [frame for frame in put if not frame.stream]
    assert len(put) - len(sent) == outbox.dropped
    assert outbox.waiting_bytes == len(outbox) == 0
