"""One decorator for every compiled kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba import types
from numba.core import config as numba_config
from numba.core.compiler import Compiler
from numba.extending import intrinsic, register_jitable

from swim_env.physics.runtime.cache import ForgivingCache, cache_folder

Function = TypeVar("Function", bound=Callable[..., Any])


class _SeparateArrays(Compiler):  # type: ignore[misc]
    """Tells the compiler that no array which a kernel writes overlaps another of its arguments.

    Otherwise a loop over rows is preceded by comparisons of all their addresses, which take as long
    as the loop.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


def _compile(function: Function, **options: Any) -> Function:
    # The folder is set only while the decorator runs: other packages keep their own cache.
    before = numba_config.CACHE_DIR
    numba_config.CACHE_DIR = str(cache_folder())
    try:
        compiled: Function = numba.njit(
            cache=True,
            nogil=True,
            error_model="numpy",
            boundscheck=False,
            # Every slice of an array would count its references, atomically: a third of the time.
            # Nothing is allocated in a kernel, and callers keep the arrays they hand over.
            _nrt=False,
            no_cfunc_wrapper=True,  # kernels are not called from C, and the wrappers cost a fifth
            **options,
        )(function)
    finally:
        numba_config.CACHE_DIR = before
    # With NUMBA_DISABLE_JIT it is the Python function.
    if hasattr(compiled, "_cache"):
        compiled._cache = ForgivingCache(compiled._cache)
    return compiled


def kernel(function: Function) -> Function:
    """Compile a kernel for other kernels to call.

    Products may be fused with sums and rounded once; all else is strict. Everything that decides on
    finiteness, convergence or the sign of a mass uses this one. Python cannot call it: what turns
    Python's objects into numbers takes a tenth of the time to compile.
    """
    return _compile(function, fastmath={"contract"}, no_cpython_wrapper=True)


def entry_kernel(function: Function) -> Function:
    """Compile a kernel, strict like `kernel`, that Python calls."""
    return _compile(function, fastmath={"contract"})


def inlined(function: Function) -> Function:
    """Compile a kernel that is inlined at its one call.

    Code is optimised again at every level of calls, with everything that is called from there; this
    takes a level out.
    """
    return _compile(function, fastmath={"contract"}, inline="always", no_cpython_wrapper=True)


def embedded(function: Function) -> Function:
    """Compile a kernel that becomes part of its callers, which then hand over no arguments."""
    return _compile(function, fastmath={"contract"}, no_cpython_wrapper=True, forceinline=True)


def shared(function: Function) -> Function:
    """Let Python call a function as it is, and kernels compile it into themselves.

    For small functions that both need.
    """
    wrapped: Function = register_jitable(function)
    return wrapped


_COMPILED = not numba_config.DISABLE_JIT  # debuggers and coverage run kernels as Python


@intrinsic
def _use_widest_registers(typingctx):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        # llvmlite knows no attributes with a value, but writes what is in the set.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.none(), codegen


@register_jitable(inline="always")
def use_widest_registers() -> None:
    """Let the loops of a kernel run on the widest vector registers of the processor.

    By default the compiler uses half of them where their use once slowed processors down. Loops
    with much arithmetic a number take a quarter less with all of them; others gain nothing.
    """
    if _COMPILED:
        _use_widest_registers()


def row_kernel(function: Function) -> Function:
    """Compile a kernel, strict like `kernel`, that writes no array which overlaps another."""
    return _compile(
        function,
        fastmath={"contract"},
        no_cpython_wrapper=True,
        forceinline=True,
        pipeline_class=_SeparateArrays,
    )


def vector_kernel(function: Function) -> Function:
    """Compile a kernel whose sums may be reordered so that they run on vector registers.

    NaN and infinity keep their meaning: only contraction, reassociation, reciprocals and the
    sign of zero are given up. It writes no array that overlaps another of its arguments.
    """
    # A call, and looking into the arrays that it hands over, would take as long as a short row.
    return _compile(
        function,
        fastmath={"contract", "reassoc", "arcp", "nsz"},
        no_cpython_wrapper=True,
        forceinline=True,
        pipeline_class=_SeparateArrays,
    )
