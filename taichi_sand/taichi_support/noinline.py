"""Functions of kernels that are compiled each by itself and called, where `ti.func` is copied into whoever calls it.

Taichi 1.7 takes time as the square of the length of what it compiles in one piece. Its own `ti.real_func` does this, but puts the
statements of a `ti.func` that is called there into the kernel, and keeps what it has compiled when Taichi is started anew: both crash.
And it files a kernel under its text and those of the functions that it calls, in the order in which these happen to lie in memory: one
start in three then finds its kernels filed under another order, and compiles them again.
"""

import ctypes
import functools
import zlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from taichi.lang import impl
from taichi.lang.ast import transform_tree
from taichi.lang.kernel_impl import Func, _get_tree_and_ctx, _ti_core

from taichi_sand.taichi_support.host_access import CPUS

SHEETS = 2048
"""Empty functions made at a time, 10 ms; a structure of a simulation writes some ten to thirty."""
FIRST_KEY = 1 << 20
"""Above the numbers that Taichi gives its own."""
HELD_AT = 2 * ctypes.sizeof(ctypes.c_void_p)
"""Where a Python object of pybind11 keeps the address of what it stands for: behind its own header."""


class Written:
    """The functions of one Taichi: which have been started, and empty ones to write more into, in the order of their addresses."""

    def __init__(self) -> None:
        self.started: set[NotInlined] = set()
        self.empty: list[Any] = []
        self.made = 0

    def take(self, name: str) -> Any:
        """An empty function. Where it lies among all depends on its name, not on when it is asked for."""
        if not any(self.empty):
            create, keys = impl.get_runtime().prog.create_function, range(self.made, self.made + SHEETS)
            self.empty = sorted((create(_ti_core.FunctionKey("noinline", FIRST_KEY + key, 0)) for key in keys), key=address)
            self.made += SHEETS
        first = zlib.crc32(name.encode()) % SHEETS
        place = next(k % SHEETS for k in range(first, first + SHEETS) if self.empty[k % SHEETS])
        found, self.empty[place] = self.empty[place], None
        return found


def address(function: Any) -> int:
    """Where a function of Taichi lies in memory."""
    return ctypes.c_void_p.from_address(id(function) + HELD_AT).value or 0


def written() -> Written:
    """The functions of the Taichi that runs."""
    return vars(impl.get_runtime()).setdefault("not_inlined", Written())  # Taichi has another runtime when it is started afresh


class NotInlined(Func):
    """Such a function, once for each set of templates."""

    def __init__(self, function: Callable) -> None:
        super().__init__(function, is_real_function=True)

    def __call__(self, *args: Any) -> Any:
        started = written().started
        if self not in started:
            started.add(self)
            self.compiled, self.taichi_functions, self.mapper.mapping = {}, {}, {}
        return super().__call__(*args)

    def do_compile(self, key: Any, args: Any, arg_features: Any) -> None:
        """As in Taichi, but all that is called goes into this function too."""
        tree, context = _get_tree_and_ctx(self, is_kernel=False, args=args, arg_features=arg_features, is_real_function=True)
        runtime = impl.get_runtime()
        made = written().take(f"{self.func.__module__}.{self.func.__qualname__}")

        def body() -> None:
            outer, kernel = runtime.compiling_callable, runtime.current_kernel
            runtime.compiling_callable = made
            runtime.current_kernel = SimpleNamespace(ast_builder=made.ast_builder, autodiff_mode=kernel.autodiff_mode)
            try:
                context.ast_builder = made.ast_builder()
                transform_tree(tree, context)
            finally:
                runtime.compiling_callable, runtime.current_kernel = outer, kernel

        self.taichi_functions[key.instance_id] = made
        self.compiled[key.instance_id] = body
        try:
            made.set_function_body(body)
        except BaseException:  # half a function is never called: who tries again gets another one
            del self.compiled[key.instance_id]
            self.mapper.mapping[object()] = self.mapper.mapping.pop(arg_features)
            raise


def noinline(function: Callable) -> Callable:
    """Decorator in place of `ti.func`. All parameters are annotated; what returns a number says of which type. On a GPU, where not all
    backends know functions, it is copied like others.
    """
    func, copied = NotInlined(function), Func(function)

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        return (func if impl.current_cfg().arch in CPUS else copied)(*args)

    call._is_taichi_function = True  # type: ignore[attr-defined]
    call.func = func  # type: ignore[attr-defined]  # Taichi asks it whether it prints
    return call
