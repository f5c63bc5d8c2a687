"""Lets Python read and write our fields of a CPU where they lie in memory; those of others stay as Taichi made them.

Taichi 1.7 compiles kernels for that: one for every member of a struct that is read, and others for every field that is copied to or from
NumPy. That took a third of the time of a start, and most of the memory that a simulation in a window holds. What does not lie in the
memory of a CPU as a plain table (on a GPU, or sparse) goes Taichi's way.
"""

import ctypes
import math
import os
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang import impl, util
from taichi.lang.field import Field, ScalarField, SNodeHostAccessor
from taichi.lang.matrix import MatrixField
from taichi.lang.struct import Struct, StructField

PLAIN = os.environ.get("TAICHI_SAND_PLAIN", "0") not in ("", "0")
"""Whether Taichi is to be left as it is, in this and in taichi_support.tracing: slower to start, to the same bits."""
CPUS = (ti.x64, ti.arm64)
DENSE, ROOT = (getattr(ti._lib.core.SNodeType, name) for name in ("dense", "root"))


@ti.kernel
def find(found: ti.types.ndarray(ti.u64, 1), field: ti.template(), place: ti.template()):
    """Where a number of a field lies in memory."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        found[0] = ti.get_addr(field, place)


def plain(member: ScalarField) -> bool:
    """Whether the numbers of a field lie in the memory of a CPU, cell after cell."""
    cells, axes = member._snode.ptr.parent, range(len(member.shape))
    ordered = list(member._snode.ptr.get_physical_index_position())[: len(axes)] == list(axes)
    return impl.current_cfg().arch in CPUS and cells.type == DENSE and cells.parent.type == ROOT and ordered


def start_of(member: ScalarField) -> int:
    """Address of the cells that a plain field is in, all members of a vector or of a struct beside one another."""
    impl.get_runtime().materialize()  # before that all fields seem to be in the first tree
    known = vars(impl.get_runtime()).setdefault("addresses", {})  # of trees; Taichi has another runtime when it is started afresh
    place = member._snode.ptr
    tree, cells = place.get_snode_tree_id(), place.parent
    if tree not in known:
        found = np.zeros(1, np.uint64)
        find(found, member, (0,) * len(member.shape))
        known[tree] = int(found[0]) - place.offset_bytes_in_parent_cell - cells.offset_bytes_in_parent_cell
    return known[tree] + cells.offset_bytes_in_parent_cell


def view(member: ScalarField) -> np.ndarray:
    """The numbers of a plain field themselves, not a copy, in the shape of the field."""
    start, place, shape = start_of(member), member._snode.ptr, tuple(member.shape)
    size = place.parent.cell_size_bytes
    strides = tuple(size * math.prod(shape[axis + 1 :]) for axis in range(len(shape)))
    kind = np.dtype(util.to_numpy_type(member.dtype)).str
    data = (start + place.offset_bytes_in_parent_cell, False)
    table = {"shape": shape, "typestr": kind, "data": data, "strides": strides, "version": 3}
    return np.asarray(SimpleNamespace(__array_interface__=table))


class Column(ScalarField):
    """One number a row of a field, as we look at it."""


def members_of(field: Any) -> list[Column]:
    """The columns of a field."""
    return [Column(member) for member in field._get_field_members()]


def clear(field: Any) -> None:
    """Fills a plain field, or all members of a struct, with zeros."""
    if PLAIN:
        field.fill(0)
        return
    for member in {one._snode.ptr.parent.id: one for one in members_of(field)}.values():
        ctypes.memset(start_of(member), 0, math.prod(member.shape) * member._snode.ptr.parent.cell_size_bytes)


def reader(field: Any) -> Callable[[], np.ndarray]:
    """A function that gives the numbers of a field of numbers or vectors, (rows,) or (rows, n): where they lie, if the field is plain,
    and not to be changed or kept; else a copy.
    """
    members = members_of(field)
    step = np.dtype(util.to_numpy_type(members[0].dtype)).itemsize
    if PLAIN or not all(map(plain, members)):
        return field.to_numpy
    starts = [start_of(one) + one._snode.ptr.offset_bytes_in_parent_cell for one in members]
    if len(members) == 1 or starts != [starts[0] + k * step for k in range(len(members))]:
        views = [view(one) for one in members]
        return (lambda: views[0]) if isinstance(field, ScalarField) else (lambda: np.stack(views, axis=-1))
    first = view(members[0])
    whole = np.lib.stride_tricks.as_strided(first, (*first.shape, len(members)), (*first.strides, step), writeable=False)
    return lambda: whole


class Accessor:
    """In place of `SNodeHostAccessor`: how `field[row]` reads and writes one number."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers

    def getter(self, *key: int) -> Any:
        return self.numbers[key[: self.numbers.ndim]].item()

    def setter(self, value: Any, *key: int) -> None:
        self.numbers[key[: self.numbers.ndim]] = value


class Direct(Field):
    """What a field of ours does in its own way."""

    ndim: int
    n: int

    def _initialize_host_accessors(self) -> None:
        if not self.host_accessors:
            impl.get_runtime().materialize()
            members = members_of(self)
            self.host_accessors = [Accessor(view(one)) if plain(one) else SNodeHostAccessor(one._snode.ptr) for one in members]

    def to_numpy(self, *given: Any, **named: Any) -> np.ndarray:
        members = members_of(self)
        if given or named or not plain(members[0]) or getattr(self, "ndim", 1) != 1:
            return super().to_numpy(*given, **named)
        if isinstance(self, ScalarField):
            return view(members[0]).copy()
        return np.stack([view(member) for member in members], axis=-1)

    def from_numpy(self, values: np.ndarray) -> None:
        members, width = members_of(self), (() if isinstance(self, ScalarField) else (self.n,))
        if not plain(members[0]) or getattr(self, "ndim", 1) != 1:
            super().from_numpy(values)
            return
        if values.shape != (*self.shape, *width):
            raise ValueError(f"an array of shape {values.shape} does not fit a field of shape {(*self.shape, *width)}")
        for k, member in enumerate(members):
            view(member)[...] = values[..., k] if width else values

    def fill(self, value: Any) -> None:
        """With one number for all, where they lie."""
        members = members_of(self)
        if not impl.inside_kernel() and np.isscalar(value) and plain(members[0]):
            for member in members:
                view(member)[...] = value
        else:
            super().fill(value)


class DirectScalars(Direct, ScalarField):
    """A field of numbers."""

    def __getitem__(self, key: Any) -> Any:
        """One number, in a tenth of the time that Taichi takes to look at `key`."""
        accessors = self.host_accessors
        if accessors and type(accessors[0]) is Accessor:
            return accessors[0].numbers[() if key is None else key].item()
        return super().__getitem__(key)


class DirectVectors(Direct, MatrixField):
    """A field of vectors, or matrices."""


class Row:
    """A row of a field of structs: its members are read and written in the field."""

    def __init__(self, field: StructField, key: Any) -> None:
        vars(self).update(_field=field, _key=key)

    def __getattr__(self, name: str) -> Any:
        member = vars(self)["_field"].field_dict.get(name)
        if member is None:
            raise AttributeError(f"a row of a field has no member {name!r}")
        return member[vars(self)["_key"]]

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self._field.field_dict:
            raise AttributeError(f"a row of a field has no member {name!r}")
        self._field.field_dict[name][self._key] = value


class DirectStructs(StructField):
    """A field of structs: Taichi makes a struct of all members, and functions to set each, to read one of them (0.2 ms for the pace)."""

    def __getitem__(self, key: Any) -> Row:
        return Row(self, key)

    def __setitem__(self, key: Any, values: Any) -> None:
        row = self[key]
        for name, value in (values.to_dict() if isinstance(values, Struct) else values).items():
            setattr(row, name, value)


def adopt(field: Any) -> Any:
    """This field, of a struct all its members, read and written directly from now on, unless PLAIN."""
    if isinstance(field, StructField):
        for member in field._members:
            adopt(member)
        if not PLAIN:
            field.__class__ = DirectStructs
    elif not PLAIN:
        field.__class__ = DirectScalars if isinstance(field, ScalarField) else DirectVectors
    return field
