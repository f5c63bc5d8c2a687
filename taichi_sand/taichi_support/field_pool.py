"""Fields that a simulation takes over from one that is gone, and with them the kernels compiled for them.

Taichi frees no field before it is started afresh, and compiles every kernel anew for other fields: a second or two a simulation. Here
the fields of a simulation that nobody holds any more are kept together, and lent to the next one that asks for just the same. What it
makes of them is `same` as before, so that nothing is compiled. (Single fields are not lent: how they lie in memory decides how LLVM
orders sums, and so the last bits.)
"""

import dataclasses
import gc
import math
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import taichi as ti
from taichi.lang._ndarray import Ndarray
from taichi.lang._texture import Texture
from taichi.lang.field import Field

from taichi_sand.errors import SandError
from taichi_sand.files.memory import available
from taichi_sand.taichi_support.host_access import Column, adopt, clear

BYTES = 4
"""Of a number, at least."""


class UnfitError(Exception):
    """A field set has not the field that is asked for."""


class FieldSet:
    """Fields that were made together."""

    def __init__(self) -> None:
        self.requests: list[tuple] = []  # what each was asked for as
        self.fields: list[Any] = []
        self.whole = False  # all have been made
        self.taken = 0

    def take(self, request: tuple, make: Callable[[], Any]) -> Any:
        """The next field, full of zeros."""
        if not self.whole:
            self.requests.append(request)
            self.fields.append(make())
            return self.fields[-1]
        if self.taken == len(self.fields) or self.requests[self.taken] != request:
            raise UnfitError
        self.taken += 1
        clear(self.fields[self.taken - 1])
        return self.fields[self.taken - 1]

    def close(self) -> None:
        """All have been asked for."""
        if self.whole and self.taken < len(self.fields):
            raise UnfitError
        self.whole = True


class FieldPool:
    """What has been made since Taichi was started."""

    def __init__(self) -> None:
        self.numbers = 0  # that all fields hold
        self.sets: list[FieldSet] = []  # that nobody uses
        self.open: FieldSet | None = None  # that is being taken from; None: what is asked for is for good
        self.things: dict[Any, Any] = {}  # what `same` has seen
        self.known = {id(thing): weakref.ref(thing) for thing in in_python()}  # fields that are no more, and ours

    def take(self, request: tuple, make: Callable[[], Any], numbers: int) -> Any:
        """A field full of zeros."""

        def count_and_make() -> Any:
            spend(numbers)
            self.numbers += numbers
            field = adopt(make())
            for part in parts_of(field):
                self.known[id(part)] = weakref.ref(part)
            return field

        return self.open.take(request, count_and_make) if self.open else count_and_make()

    def borrow(self, field_set: FieldSet, lay: Callable[[], None]) -> bool:
        """Calls `lay` with this field set; whether that fitted."""
        self.open, field_set.taken = field_set, 0
        try:
            lay()
            field_set.close()
        except UnfitError:
            return False
        finally:
            self.open = None
        return True

    def idle(self) -> int:
        """Numbers in fields that nobody uses."""
        return sum(math.prod(field.shape) * getattr(field, "n", 1) for field_set in self.sets for field in field_set.fields)


def in_python() -> list[Any]:
    """All that Python holds of fields and arrays of Taichi, somebody else's too."""
    return [thing for thing in gc.get_objects() if issubclass(type(thing), (Field, Ndarray, Texture)) and type(thing) is not Column]


def parts_of(field: Any) -> list[Any]:
    """A field, the members of a struct, and what Taichi makes beside them for derivatives."""
    beside = [one for one in (field.grad, field.dual, *getattr(field, "field_dict", {}).values()) if one is not None]
    return [field, *(part for one in beside for part in parts_of(one))]


def others() -> bool:
    """Whether somebody else has fields or arrays in the Taichi that runs."""
    gc.collect()
    return any(id(thing) not in pool.known or pool.known[id(thing)]() is not thing for thing in in_python())


left: ContextVar[float] = ContextVar("left", default=math.inf)
"""Numbers that may still be made room for."""
LARGE = 10_000_000
"""Numbers of a field from which on it is looked whether there is memory for them."""


def spend(numbers: int) -> None:
    """SandError if there is no room for so many numbers more."""
    left.set(left.get() - numbers)
    if left.get() < 0:
        raise SandError("its tables have no room for what its scene needs")
    if numbers > LARGE and BYTES * numbers > available():
        need, free = (f"{value / 2**30:.1f} GB" for value in (BYTES * numbers, available()))
        raise SandError(
            f"this scene needs a table of {need}, and {free} of memory are free; it takes fewer grains, or such as differ less in size"
        )


@contextmanager
def at_most(numbers: float) -> Iterator[None]:
    """Around the making of a simulation that may take so many numbers."""
    token = left.set(numbers)
    try:
        yield
    finally:
        left.reset(token)


pool = FieldPool()


def start_afresh() -> None:
    """Taichi has been started anew: all fields are gone."""
    global pool
    pool = FieldPool()


def borrow(owner: Any, lay: Callable[[], None], keep: bool) -> Callable[[], Any]:
    """Calls `lay`, which asks for fields, until there are some of the kind it wants; they are `owner`'s until it is gone, or what this
    returns is called.

    `lay` may be called more than once. Unless `keep`, what is made is not lent again.
    """
    fitting = next(
        (field_set for field_set in reversed(pool.sets.copy()) if pool.borrow(field_set, lay)), None
    )  # the last is the likeliest
    if fitting:
        pool.sets.remove(fitting)
    else:
        fitting = FieldSet()
        pool.borrow(fitting, lay)
    back = weakref.finalize(owner, pool.sets.append if keep else list, fitting)  # type: ignore[arg-type]
    back.atexit = False
    return back


def scalars(kind: Any, shape: Any) -> Any:
    """A field of numbers of type `kind`."""
    shape = shape if isinstance(shape, tuple) else (shape,)
    return pool.take(("scalars", str(kind), shape), lambda: ti.field(kind, shape), math.prod(shape))


def vectors(width: int, kind: Any, shape: Any, layout: Any = ti.Layout.AOS) -> Any:
    """A field of vectors of `width` numbers, unless said otherwise one beside the other: what is used together lies together (of 2-vectors
    a sixth faster than apart, measured).
    """
    shape = shape if isinstance(shape, tuple) else (shape,)
    request = ("vectors", width, str(kind), shape, layout.name)
    return pool.take(request, lambda: ti.Vector.field(width, kind, shape, layout=layout), width * math.prod(shape))


def record(struct: Any) -> Any:
    """A 0-D field of type `struct`."""
    members = ((name, str(getattr(kind, "dtype", kind)), getattr(kind, "n", 1)) for name, kind in struct.members.items())
    return pool.take(("record", *members), lambda: struct.field(shape=()), len(struct.members))


def same(thing: Any) -> Any:
    """The first one of those made so far that hold all the same: kernels know things by identity, and are compiled for each.

    Things are frozen dataclasses and tuples of fields, numbers, names, functions, and of the like; anything else is only itself.
    """
    return pool.things.setdefault(mark(thing), thing)


def mark(thing: Any) -> Any:
    """What two things have in common that are the same for a kernel."""
    if isinstance(thing, (str, int, float, complex, type(None))):
        return type(thing).__name__, repr(thing)
    if isinstance(thing, tuple):
        return type(thing).__name__, getattr(thing, "_fields", ()), tuple(mark(part) for part in thing)
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type) and type(thing).__dataclass_params__.frozen:
        return id(type(thing)), tuple((name, mark(part)) for name, part in vars(thing).items())
    if isinstance(thing, type(ti.f32)):
        return "kind", str(thing)
    return "one", id(thing)
