"""The base of every section of the configuration."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
WORD = r"^[A-Za-z0-9_+-]+$"
Word = Annotated[str, Field(pattern=WORD)]  # names one of several kinds
Port = Annotated[int, Field(ge=0, le=65535)]
Triple = tuple[Finite, Finite, Finite]
Six = tuple[Finite, Finite, Finite, Finite, Finite, Finite]


class Section(BaseModel):
    """A part of the configuration: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _what_yaml_takes_for_something_else(cls, value: Any, info: ValidationInfo) -> Any:
        """`yes` is no number, and 0123 no text: YAML has read it as 83 by now."""
        assert info.field_name is not None
        kind = cls.model_fields[info.field_name].annotation
        if isinstance(value, bool) and kind in (int, float):
            raise ValueError("must be a number")
        if kind is str and isinstance(value, int | float | date):
            raise ValueError("must be text: write it in quotes")
        return value
