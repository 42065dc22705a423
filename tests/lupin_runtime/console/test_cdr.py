"""For every installed type, the decoded values equal those of the message."""

from __future__ import annotations

import random
from typing import Any

import cbor2
import numpy as np
import orjson
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Bool, Float64MultiArray, String

from lupin_runtime.console.cdr import Format, MalformedMessage, decoder
from lupin_runtime.console.encoding import to_json
from tests.support.random_messages import expected, installed_classes, random_message


def untagged(value: Any) -> Any:
    """Convert the typed arrays in decoded CBOR to lists."""
    if isinstance(value, cbor2.CBORTag):
        kinds = {69: "<u2", 70: "<u4", 71: "<u8", 72: "i1", 77: "<i2", 78: "<i4", 79: "<i8", 85: "<f4", 86: "<f8"}
        return np.frombuffer(value.value, kinds[value.tag]).tolist()
    if isinstance(value, dict):
        return {key: untagged(item) for key, item in value.items()}
    return [untagged(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("seed", range(4))
def test_every_installed_type_is_decoded_exactly(seed: int) -> None:
    rng = random.Random(seed)
    classes = installed_classes()
    assert len(classes) > 300
    for message_class in classes:
        message = random_message(message_class, rng)
        data = serialize_message(message)
        assert orjson.loads(to_json(decoder(message_class, Format.JSON)(data))) == expected(message, Format.JSON), message_class
        as_cbor = cbor2.loads(cbor2.dumps(decoder(message_class, Format.CBOR)(data)))
        assert untagged(as_cbor) == expected(message, Format.CBOR), message_class


def test_big_endian_messages_are_decoded() -> None:
    data = b"\x00\x00\x00\x00" + (3).to_bytes(4, "big") + b"ab\x00"
    assert decoder(String, Format.JSON)(data) == {"data": "ab"}


def test_nan_and_infinities_are_null_in_json() -> None:
    message = Float64MultiArray(data=[1.0, float("nan"), float("inf"), float("-inf")])
    text = to_json(decoder(Float64MultiArray, Format.JSON)(serialize_message(message)))
    assert orjson.loads(text)["data"] == [1.0, None, None, None]


@pytest.mark.parametrize("message_class", [String, Bool, Float64MultiArray])
def test_truncated_or_foreign_data_is_refused_or_harmless(message_class: Any) -> None:
    rng = random.Random(5)
    whole = serialize_message(random_message(Float64MultiArray, rng))
    samples = [whole[:length] for length in range(len(whole))] + [rng.randbytes(rng.randrange(4, 60)) for _ in range(3000)]
    for data in samples:
        try:
            values = decoder(message_class, Format.JSON)(data)
        except MalformedMessage:
            continue
        assert set(values) == set(message_class.get_fields_and_field_types())


def test_wrong_sequence_length_is_refused_at_once() -> None:
    data = b"\x00\x01\x00\x00" + (0xFFFFFFFF).to_bytes(4, "little") + bytes(20)
    with pytest.raises(MalformedMessage, match="4294967295"):
        decoder(Float64MultiArray, Format.JSON)(data)
