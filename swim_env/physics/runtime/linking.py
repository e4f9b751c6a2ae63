"""Kernels that others call at an address, without taking their code into themselves."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.binding
import numba
import numpy as np
from llvmlite.ir import GlobalVariable
from numba.core import config as numba_config
from numba.core import types
from numba.extending import lower_builtin, type_callable

from swim_env.physics.runtime.compile import kernel
from swim_env.physics.runtime.references import type_of

Function = TypeVar("Function", bound=Callable[..., Any])


class Linked:
    """A kernel that others call at an address, without taking its code into themselves.

    Code is optimised again wherever it goes, which for large kernels would take most of the time to
    compile. They cannot raise exceptions, and loading has to come before any call.

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

    def declare(self, *arguments: object) -> None:
        """Say that it is called with arguments like these, named tuples by reference."""
        self.signature = tuple(map(type_of, arguments))

    def load(self) -> None:
        """Compile it as declared, or take it from the cache, and let others call it."""
        assert self.signature is not None, self.name
        self.compiled.compile(self._returned(*self.signature))
        code = self.compiled.overloads[self.signature]
        self._address[0] = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)

    def check_call(self) -> None:
        """Refuse a call from Python that would jump to nowhere (RuntimeError)."""
        if self.compiled.targetoptions.get("no_cpython_wrapper"):
            raise RuntimeError(f"{self.name} is compiled for other kernels to call, not for Python")
        if self._address[0] == 0:
            raise RuntimeError(
                f"{self.name} was called before it was loaded; call load_model of "
                "swim_env.physics.loading first, or load_spatial_kernels of "
                "swim_env.physics.spatial.loading"
            )

    def type_of_call(self, arguments: tuple[Any, ...]) -> Any:
        """Return numba's signature of a call with arguments of these types."""
        if self.signature not in (None, arguments):
            raise TypeError(f"{self.name} is called with {arguments}, not {self.signature}")
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

    What it returns is annotated: int, float, bool, None or a tuple of them.
    """
    if numba_config.DISABLE_JIT:
        return compiled

    linked = Linked(compiled)

    @functools.wraps(linked.compiled.py_func)
    def call(*arguments: Any) -> Any:
        linked.check_call()
        return compiled(*arguments)

    found: Any = call
    found.linked = linked

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
