"""What keys of a scene file are made of: kinds of values, and the tables that hold them."""

import math
import os
import re
from contextvars import ContextVar
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

sealed: ContextVar[bool] = ContextVar("sealed", default=False)
"""Whether scenes that are made may read no other file: those that come out of a checkpoint or a recording."""
HUGE = 1e12  # 32 bits hold the square of a number, and the products made of it


def key(default: Any, text: str, unit: str = "", **limits: Any) -> Any:
    """A key of a scene table: default (... = it must be given), one line of help, unit, limits as pydantic names them."""
    return Field(default, description=text, json_schema_extra={"unit": unit}, **limits)


def _not_huge(value: Any) -> Any:
    if isinstance(value, int | float) and HUGE < abs(value) < math.inf:
        raise ValueError(f"must lie within ±{HUGE:g}")
    return value


def _as_range(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value, value)
    if isinstance(value, list | tuple) and len(value) == 2:
        return value
    raise ValueError("must be a number, or [low, high]")


def _as_angle(value: Any) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if number or value == "random":
        return value
    raise ValueError('must be a number in radians, or "random"')


def _as_name(value: Any) -> Any:
    if isinstance(value, str) and re.fullmatch(r"[\w-]{0,40}", value):
        return value
    raise ValueError("must be a word of letters, digits, _ and -, at most 40 of them")


Number = Annotated[float, Field(strict=True, allow_inf_nan=False), BeforeValidator(_not_huge)]
Whole = Annotated[int, Field(strict=True)]
Switch = Annotated[bool, Field(strict=True)]
Vector = tuple[Number, Number]
Box = tuple[Number, Number, Number, Number]
Range = Annotated[Vector, BeforeValidator(_as_range)]
Name = Annotated[str, BeforeValidator(_as_name)]
Angle = Annotated[float | str, BeforeValidator(_as_angle)]
Edge = Literal["wall", "open", "periodic"]
Numeric = Literal["speed", "energy", "force", "pressure", "stress", "deviator", "rotation", "order", "temperature", "moisture"]
OfWater = Literal["saturation", "water pressure", "water speed"]
Color = Literal["kind", Numeric, OfWater, "photoelastic"]


def plain(value: Any) -> Any:
    """A value as a scene file could hold it: without NumPy's numbers and arrays, and paths. Tables in lists see to themselves."""
    kind = type(value)
    if kind in (float, int, str, bool):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if kind is list or kind is tuple:
        return value if set(map(type, value)) <= {float, int, str, bool} else list(map(plain, value))
    if kind is dict:
        return {key: plain(part) for key, part in value.items()}
    return value


class Table(BaseModel):
    """A table of a scene file: unknown keys are errors, and it does not change once made."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, data: Any) -> Any:
        return {key: plain(value) for key, value in data.items()} if isinstance(data, dict) else data
