"""The tables [[checks]]: what a scene must show when it is simulated, as numbers."""

from typing import Annotated, Any, Self

from pydantic import BeforeValidator, model_validator

from taichi_sand.errors import Wrong
from taichi_sand.scene.kinds import Number, Table, key


def _as_moment(value: Any) -> Any:
    if isinstance(value, str) or (isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < float("inf")):
        return value
    raise ValueError('must be a time in seconds, or "end", or the name of an event')


Moment = Annotated[float | str, BeforeValidator(_as_moment)]


class Check(Table):
    """A number that must lie in a range at some time; `taichi-sand check` says whether it does."""

    observable: str = key(..., "number of the report (of a vector, with _x or _y behind its name), or a measurement by name", min_length=1)
    low: Number | None = key(None, "least that it may be, in its own unit")
    high: Number | None = key(None, "most that it may be, in its own unit")
    at: Moment = key("end", 'when: a time, the name of an event, or "end", which is `duration`', "s")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.low is None and self.high is None:
            raise Wrong("", " needs `low` or `high`")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise Wrong("high", f" = {self.high:g} must be at least `low` = {self.low:g}")
        return self
