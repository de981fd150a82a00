"""What every section of the configuration is made of."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Port = Annotated[int, Field(ge=0, le=65535)]
Triple = tuple[Finite, Finite, Finite]
Six = tuple[Finite, Finite, Finite, Finite, Finite, Finite]


class Section(BaseModel):
    """A part of the configuration: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _what_yaml_takes_for_something_else(cls, data: Any) -> Any:
        """`yes` is no number, and 0123 no text: YAML has read it as 83 by now."""
        for name, value in data.items() if isinstance(data, dict) else ():
            field = cls.model_fields.get(name)
            kind = None if field is None else field.annotation
            if isinstance(value, bool) and kind in (int, float):
                raise ValueError(f"{name} must be a number, not {str(value).lower()}")
            if kind is str and isinstance(value, int | float | date):
                raise ValueError(f"{name} must be text: write it in quotes")
        return data
