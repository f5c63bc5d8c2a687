"""Fields read and written where they lie in memory: the same numbers as by Taichi's own kernels."""

from collections.abc import Iterator

import numpy as np
import pytest
import taichi as ti
from helpers import fresh_taichi

from taichi_sand.taichi_support import field_pool, host_access, runtime


class User:
    """Somebody who starts Taichi."""


@pytest.fixture(scope="module", autouse=True)
def nothing_left() -> Iterator[None]:
    """Fields of a test, which kernels hold, would keep Taichi from being started afresh."""
    yield
    ti.reset()


@pytest.fixture
def user() -> User:
    fresh_taichi()
    one = User()
    runtime.start(one, "cpu", 1, 32)
    return one


MAKES = {
    "f32": lambda: field_pool.scalars(ti.f32, 5),
    "f64, two axes": lambda: field_pool.scalars(ti.f64, (3, 4)),
    "one i32": lambda: field_pool.scalars(ti.i32, ()),
    "u8": lambda: field_pool.scalars(ti.u8, 7),
    "u64": lambda: field_pool.scalars(ti.u64, 2),
    "vectors": lambda: field_pool.vectors(3, ti.f32, 5),
    "vectors apart": lambda: field_pool.vectors(2, ti.f64, (4, 3), layout=ti.Layout.SOA),
}
OTHERS = {
    "matrices": lambda: host_access.adopt(ti.Matrix.field(2, 2, ti.f32, 3)),
    "columns first": lambda: host_access.adopt(ti.field(ti.i32, (3, 4), order="ji")),
}


def counted(field: ti.Field) -> np.ndarray:
    """An array for a field, all its numbers different."""
    shape = field.to_numpy().shape
    return (np.arange(np.prod(shape, dtype=int)) + 1).reshape(shape).astype(field.to_numpy().dtype)


def own(field: ti.Field) -> np.ndarray:
    """What Taichi's own kernel reads."""
    return super(host_access.Direct, field).to_numpy()


@pytest.mark.parametrize("name", [*MAKES, *OTHERS])
def test_as_taichi_does(name: str, user: User) -> None:
    """Arrays in and out, between two neighbours that stay as they are."""
    before, field, after = field_pool.scalars(ti.f32, 4), {**MAKES, **OTHERS}[name](), field_pool.scalars(ti.f32, 4)
    assert (own(field) == 0).all() and host_access.plain(host_access.members_of(field)[0]) == (name != "columns first")
    values = counted(field)
    field.from_numpy(values)
    assert (own(field) == values).all() and (field.to_numpy() == values).all() and field.to_numpy().dtype == own(field).dtype
    field.to_numpy()[...] = 0  # a copy
    assert (own(field) == values).all()
    field.fill(7)
    assert (own(field) == 7).all()
    assert not own(before).any() and not own(after).any()


@pytest.mark.parametrize("name", MAKES)
def test_one_number_at_a_time(name: str, user: User) -> None:
    """By row, as kernels see it."""
    field = MAKES[name]()
    values = counted(field)
    rows = list(np.ndindex(*field.shape))
    for row in rows:
        field[row if row else None] = values[row]
    assert (own(field) == values).all()
    read = [field[row if row else None] for row in rows]
    assert (np.array([one.to_list() if hasattr(one, "to_list") else one for one in read]).reshape(values.shape) == values).all()
    assert isinstance(read[0], int | float | ti.Matrix | ti.Vector)


def test_rows_of_structs(user: User) -> None:
    """Members are read and written in the field, one by one or together, and what is none is refused."""
    kind = ti.types.struct(count=ti.i32, length=ti.f64, place=ti.types.vector(2, ti.f32))
    field = field_pool.record(kind)
    row = field[None]
    row.count, row.place = 3, [0.5, -2.0]
    assert field.count[None] == 3 and list(own(field.place)) == [0.5, -2.0] and list(row.place) == [0.5, -2.0]
    field[None] = {"length": 1e-3, "count": -7}
    assert (row.count, row.length, row.place[1]) == (-7, 1e-3, -2.0)
    field[None] = kind(count=1, length=2.0, place=[3.0, 4.0])
    assert (row.count, row.length, list(row.place)) == (1, 2.0, [3.0, 4.0])
    with pytest.raises(AttributeError, match="no member 'width'"):
        row.width = 1
    with pytest.raises(AttributeError, match="no member 'width'"):
        row.width  # noqa: B018


def test_beyond_the_end(user: User) -> None:
    with pytest.raises(IndexError):
        field_pool.scalars(ti.f32, 3)[3]


def test_members_of_a_struct(user: User) -> None:
    """What a kernel writes is read, and the other way round."""
    kind = ti.types.struct(a=ti.f32, b=ti.types.vector(2, ti.f64), c=ti.i32)
    field = field_pool.record(kind)

    @ti.kernel
    def double():
        field[None].a, field[None].b, field[None].c = 2 * field[None].a, 2 * field[None].b, 2 * field[None].c

    field[None].a, field[None].b, field[None].c = 0.1, [1.5, -2.5], -3
    double()
    assert field[None].a == pytest.approx(0.2, rel=1e-7) and field[None].b.to_list() == [3.0, -5.0] and field[None].c == -6
    assert field.to_numpy()["b"].tolist() == [3.0, -5.0]


def test_fields_made_later_and_after_a_fresh_start(user: User) -> None:
    """They lie elsewhere."""
    for _ in range(2):
        one = field_pool.scalars(ti.i32, 3)
        one.fill(1)
        two = field_pool.scalars(ti.i32, 3)
        two.fill(2)
        assert own(one).tolist() == [1, 1, 1] and own(two).tolist() == [2, 2, 2]
        runtime.abandon()
        runtime.start(user, "cpu", 1, 32)


def test_what_does_not_fit(user: User) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        field_pool.scalars(ti.f32, 3).from_numpy(np.zeros(4, np.float32))


def test_nothing_is_compiled_but_where_they_lie(user: User) -> None:
    """One kernel for all fields that are made before the first is used."""
    made = [make() for make in MAKES.values()]
    start = runtime.compiled()
    for field in made:
        field.from_numpy(field.to_numpy())
        field.fill(0)
    assert runtime.compiled() == start + 1
