"""Starts kernels in a fifth of the time, where they have been started with such arguments before.

Taichi 1.7 looks at every argument anew each time, by way of types that it makes for that: some 20 microseconds an array, where what
starts the kernel takes four. Here what it found is kept by what it goes by. Whatever is not plain goes Taichi's way.
"""

import ctypes
from typing import Any

import numpy as np
from taichi.lang import impl
from taichi.lang.kernel_impl import Kernel, template
from taichi.lang.matrix import MatrixType
from taichi.types import primitive_types
from taichi.types.ndarray_type import NdarrayType

from taichi_sand.taichi_support.host_access import CPUS

HEAD = object.__basicsize__
"""An array of NumPy begins with the head of all objects, and then where its numbers lie."""
TEMPLATE, ARRAY, ROWS, WHOLE, REAL, OTHER = range(6)
"""Kinds of parameters; ROWS are arrays of vectors."""


def read_address(array: np.ndarray) -> int:
    """Where the numbers of an array lie: what `array.ctypes.data` says, in a twentieth of the time."""
    return ctypes.c_void_p.from_address(id(array) + HEAD).value or 0


_probe = np.zeros(3)
address = read_address if read_address(_probe) == _probe.ctypes.data else lambda array: array.ctypes.data


def kind_of(annotation: Any) -> int:
    """Of which kind a parameter is."""
    if isinstance(annotation, template) or annotation is template:
        return TEMPLATE
    if isinstance(annotation, NdarrayType):
        return ROWS if isinstance(annotation.dtype, MatrixType) else ARRAY
    if id(annotation) in primitive_types.real_type_ids:
        return REAL
    return WHOLE if annotation in (primitive_types.i32, primitive_types.i64) else OTHER


class Known:
    """What is known of a kernel."""

    def __init__(self, kernel: Kernel) -> None:
        self.of = kernel.compiled_kernels  # another dictionary after Taichi was started anew
        self.kinds = [kind_of(argument.annotation) for argument in kernel.arguments]
        self.widths = [argument.annotation.dtype.ndim if k == ROWS else 0 for argument, k in zip(kernel.arguments, self.kinds)]
        plain = OTHER not in self.kinds and kernel.return_type is None and not kernel.has_print and impl.current_cfg().arch in CPUS
        self.plain = plain and all(width in (0, 1) for width in self.widths)
        self.found: dict[tuple, tuple[Any, Any]] = {}

    def key(self, args: tuple) -> tuple | None:
        """What it depends on how a kernel is compiled; None if these arguments go Taichi's way."""
        if len(args) != len(self.kinds):
            return None
        key: list[Any] = []
        for kind, arg in zip(self.kinds, args, strict=True):
            if kind == TEMPLATE:
                key.append(arg)
            elif kind in (ARRAY, ROWS):
                if type(arg) is not np.ndarray or not arg.flags.c_contiguous:
                    return None
                key += [arg.dtype, arg.shape[-1] if kind == ROWS else arg.ndim]
            elif not isinstance(arg, int | float | np.integer | np.floating) or (kind == WHOLE and isinstance(arg, float | np.floating)):
                return None
        return tuple(key)


def start(kernel: Kernel, args: tuple) -> bool:
    """Starts a kernel if it has been compiled for such arguments; whether it has."""
    known = vars(kernel).get("known")
    if known is None or known.of is not kernel.compiled_kernels:
        return False
    try:
        ready = known.found.get(known.key(args)) if known.plain else None
    except TypeError:  # something that cannot be looked up by
        return False
    if ready is None:
        return False
    made, code = ready
    context, place = made.make_launch_context(), 0
    for kind, arg in zip(known.kinds, args, strict=True):
        if kind == TEMPLATE:
            continue
        if kind in (ARRAY, ROWS):
            shape = arg.shape[:-1] if kind == ROWS else arg.shape
            context.set_arg_external_array_with_shape((place,), address(arg), arg.nbytes, shape, 0)
        elif kind == WHOLE:
            context.set_arg_int((place,), int(arg))
        else:
            context.set_arg_float((place,), float(arg))
        place += 1
    impl.get_runtime().prog.launch_kernel(code, context)
    return True


def remember(kernel: Kernel, args: tuple) -> None:
    """Keeps what was found for these arguments, after the kernel has been started in Taichi's way."""
    known = vars(kernel).get("known")
    if known is None or known.of is not kernel.compiled_kernels:
        known = kernel.known = Known(kernel)  # type: ignore[attr-defined]
    try:
        key = known.key(args) if known.plain else None
        if key is None or key in known.found:
            return
    except TypeError:
        return
    number, _ = kernel.mapper.lookup(args)
    made, program = kernel.compiled_kernels[(kernel.func, number, kernel.autodiff_mode)], impl.get_runtime().prog
    known.found[key] = made, program.compile_kernel(program.config(), program.get_device_caps(), made)
