"""How a record's type becomes its form in the log."""

from __future__ import annotations

import sys
import typing
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np
import pytest

from tams_app.recording.codec import Codec
from tams_app.records import Record
from tams_app.records.record import TimeNs

pytestmark = pytest.mark.untimed

if sys.version_info >= (3, 12):
    Scalar = TypeVar("Scalar", bound=np.generic)
    # As numpy 2.5 names its arrays: a `type` statement, with and without a parameter.
    Array = typing.TypeAliasType(
        "Array", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,)
    )
    Numbers = typing.TypeAliasType("Numbers", Array[np.float64])

    @dataclass(frozen=True, slots=True)
    class Measured(Record):
        t_ns: TimeNs
        of_one_kind: Annotated[Array[np.float64], "numbers"]
        named: Annotated[Numbers, "numbers"]
        if_any: Annotated[Numbers | None, "numbers, or none"] = None


@pytest.mark.skipif(sys.version_info < (3, 12), reason="Python 3.12 brought `type` statements")
def test_a_field_whose_type_is_an_alias_is_recorded_as_what_that_stands_for() -> None:
    codec = Codec(Measured)
    record = Measured(7, np.array([1.0, 2.0]), np.array([3.0]), np.array([4.0, np.nan]))
    back = codec.decode(codec.encode(record))
    for name in ("of_one_kind", "named", "if_any"):
        np.testing.assert_array_equal(getattr(back, name), getattr(record, name))
    assert codec.decode(codec.encode(Measured(7, record.named, record.named))).if_any is None
