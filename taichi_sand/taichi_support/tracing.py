"""Makes Taichi read kernels in half the time: a warm start is mostly that.

For every expression Taichi 1.7 wraps the lines of its source to a text for error messages, and for every call of a `ti.func` it looks up
the source of that anew, and breaks its lines where they are longer than 9999. None of it has to do with what is compiled.
"""

import inspect
import textwrap
from types import CodeType, SimpleNamespace
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

from taichi_sand.taichi_support.host_access import PLAIN

sources: dict[CodeType, tuple[list[str], int]] = {}
"""Lines of functions, and the number of their first; by code, as functions themselves may hold on to fields."""


def where(self: Any, node: Any) -> str:
    """In place of `ASTTransformerContext.get_pos_info`: file, line and function, and the first line of the source, marked."""
    line = self.src[node.lineno - 1]
    start = self.indent + node.col_offset
    end = self.indent + node.end_col_offset if node.end_lineno == node.lineno else len(line)
    place = f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:'
    return f"{place}\n{line}\n{' ' * start}{'^' * (end - start)}\n"


def lines_of(function: Any) -> tuple[list[str], int]:
    """In place of `inspect.getsourcelines`, for functions."""
    code = inspect.unwrap(function).__code__
    if code not in sources:
        sources[code] = original(function)
    lines, first = sources[code]
    return list(lines), first


def unbroken(line: str, **_: int) -> str:
    """In place of `textwrap.fill`, for a line of source."""
    return line.expandtabs(4).rstrip()


original = kernel_impl.getsourcelines


def trace_quickly() -> None:
    """Puts these in the place of Taichi's own, for all kernels compiled from now on in this process, unless PLAIN."""
    if PLAIN:
        return
    kernel_impl.getsourcelines = lines_of
    kernel_impl.textwrap = SimpleNamespace(fill=unbroken, dedent=textwrap.dedent)
    ASTTransformerContext.get_pos_info = where
