"""One decorator for every compiled kernel."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.binding
import numba
import numpy as np
from llvmlite.ir import GlobalVariable
from numba.core import config as numba_config
from numba.core import types
from numba.extending import lower_builtin, register_jitable, type_callable

from swim_env.physics.runtime.cache import ForgivingCache, cache_folder

Function = TypeVar("Function", bound=Callable[..., Any])


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

    For what measures sizes and lays out work space: without reference counts a kernel cannot hand
    arrays that it made out of others to Python.
    """
    wrapped: Function = register_jitable(function)
    return wrapped


def vector_kernel(function: Function) -> Function:
    """Compile a kernel whose sums may be reordered so that they run on vector registers.

    NaN and infinity keep their meaning: only contraction, reassociation, reciprocals and the
    sign of zero are given up.
    """
    # A call, and looking into the arrays that it hands over, would take as long as a short row.
    return _compile(
        function,
        fastmath={"contract", "reassoc", "arcp", "nsz"},
        no_cpython_wrapper=True,
        forceinline=True,
    )


class Linked:
    """A kernel that others call at an address, without taking its code into themselves.

    Code is optimised again wherever it goes, which for large kernels would take most of the time to
    compile; and one that a scene never calls need not be there.

    Attributes
    ----------
    compiled : Dispatcher
        The kernel itself.
    name : str
        Of the kernel.
    signature : tuple of types or None
        Those of the arguments with which it is called.
    """

    def __init__(self, compiled: Any) -> None:
        self.compiled = compiled
        self.signature: tuple[Any, ...] | None = None
        function = compiled.py_func
        self.name = f"{function.__module__}.{function.__name__}"
        self._address = np.zeros(1, dtype=np.uintp)
        llvmlite.binding.add_symbol(self.name, self._address.ctypes.data)
        self._returned = _numba_type(function.__annotations__["return"])

    @property
    def is_loaded(self) -> bool:
        """Whether there is something at the address."""
        return bool(self._address[0])

    def declare(self, *arguments: object) -> None:
        """Say that it is called with arguments like these."""
        self.signature = tuple(map(numba.typeof, arguments))

    def load(self) -> None:
        """Compile it as declared, or take it from the cache, and let others call it."""
        self.compiled.compile(self.signature)
        code = self.compiled.overloads[self.signature]
        assert code.signature.return_type == self._returned, (self.name, code.signature)
        self._address[0] = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)

    def type_of_call(self, arguments: tuple[Any, ...]) -> Any:
        """Return numba's signature of a call with arguments of these types."""
        if self.signature is not None:
            assert arguments == self.signature, (self.name, arguments, self.signature)
        return numba.core.typing.signature(self._returned, *arguments)

    def write_call(self, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Write the call at the address."""
        convention = context.call_conv
        kind = convention.get_function_type(signature.return_type, signature.args).as_pointer()
        module = builder.module
        where = module.globals.get(self.name) or GlobalVariable(module, kind, self.name)
        function = builder.load(where)
        _, value = convention.call_function(
            builder, function, signature.return_type, signature.args, arguments
        )
        return value


def link(compiled: Function) -> Function:
    """Return a kernel that others call at an address; see `Linked`, its attribute `linked`.

    What it returns is annotated: int, float or None.
    """
    if numba_config.DISABLE_JIT:
        return compiled

    def call(*arguments: Any) -> Any:
        return compiled(*arguments)

    found: Any = call
    found.linked = linked = Linked(compiled)

    @type_callable(call)
    def _type(context: Any) -> Any:
        def signature_of(*arguments: Any) -> Any:
            return linked.type_of_call(arguments)

        signature_of.pysig = inspect.signature(linked.compiled.py_func)  # type: ignore[attr-defined]
        return signature_of

    lower_builtin(call, types.misc.VarArg(types.Any))(linked.write_call)
    return found  # type: ignore[no-any-return]


def linked_kernel(function: Function) -> Function:
    """Compile a kernel for others to call at an address."""
    return link(kernel(function))


def _numba_type(annotation: str) -> Any:
    """Return numba's type of an annotation: int, float, bool, None or a tuple of them."""
    kinds = {"int": types.int64, "float": types.float64, "bool": types.boolean, "None": types.none}
    parts = annotation.removeprefix("tuple[").removesuffix("]").split(", ")
    found = [kinds[part] for part in parts]
    return found[0] if len(found) == 1 else types.containers.Tuple(found)
