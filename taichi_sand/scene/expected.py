"""The tables [[checks]]: what a scene must show when it is simulated, as numbers."""

from typing import Annotated, Any, Literal, Self

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
    over: Number = key(0.0, "how long before `at` it is followed, at 100 moments; 0 = it is looked at then alone", "s", ge=0)
    take: Literal["mean", "least", "most"] = key("mean", "what of the values over that time must lie in the range: mean, least or most")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.take != "mean" and not self.over:
            raise Wrong("take", f' = "{self.take}" needs a time `over` which the number is followed')
        if self.low is None and self.high is None:
            raise Wrong("", " needs `low` or `high`")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise Wrong("high", f" = {self.high:g} must be at least `low` = {self.low:g}")
        return self
