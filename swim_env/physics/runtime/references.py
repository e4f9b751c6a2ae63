"""Named tuples of arrays and numbers that kernels read where they lie, by one address.

By value, what a large kernel takes of a body's work space is some sixty arrays, hundreds of
addresses and sizes: handing them over takes time at every call, and half the time to compile. A
`Reference` is the address of a vector of words instead, which holds them once and for all.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core import config as numba_config
from numba.core.datamodel import models
from numba.core.types.containers import BaseNamedTuple
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

Words = NDArray[np.int64]

_WORD = 8


class Reference(types.Type):
    """Numba's type of the address of a named tuple's words; its fields are attributes."""

    def __init__(self, views: Any) -> None:
        self.views = views
        self._hash: int | None = None
        super().__init__(f"Reference[{views.instance_class.__name__}]")

    @property
    def key(self) -> Any:
        """What makes two references the same type."""
        return self.views

    def __hash__(self) -> int:
        # Every call asks for it, and it is made of sixty types.
        if self._hash is None:
            self._hash = hash(self.views)
        return self._hash

    def __getstate__(self) -> dict[str, Any]:
        # Hashes of strings differ from process to process.
        return {**self.__dict__, "_hash": None}


register_model(Reference)(models.OpaqueModel)


class Referenced:
    """A named tuple and its words, which kernels that Python calls take by reference.

    Parameters
    ----------
    views : NamedTuple
        Of numbers, flags, contiguous arrays, and named tuples of them. Kernels see what is written
        to the arrays later.
    sample : NamedTuple, optional
        That of the `reader` that takes the words. A TypeError says that a field has another type,
        whose words would be taken for something else.
    """

    def __init__(self, views: Any, sample: Any = None) -> None:
        if sample is not None and numba.typeof(views) != numba.typeof(sample):
            raise TypeError(f"kernels read {numba.typeof(sample)}, not {numba.typeof(views)}")
        self.views = views
        self.words = words_of(views)
        self.address = self.words.ctypes.data
        self._kind: Any = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.views, name)

    def kind(self) -> Any:
        """Return numba's type; every call asks for it, and finding it takes half a millisecond."""
        if self._kind is None:
            self._kind = type_of(self.views)
        return self._kind

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy has arrays of its own.
        return Referenced, (self.views,)


def type_of(argument: object) -> Any:
    """Return numba's type of an argument; kernels get named tuples by reference."""
    found = numba.typeof(argument)
    return Reference(found) if isinstance(found, BaseNamedTuple) else found


def words_of(views: Any) -> Words:
    """Return what a kernel reads of a named tuple, whose arrays must be kept.

    An array is its address and its shape, and anything else one word.
    """
    return np.array([word for value in views for word in _words(value)], dtype=np.int64)


def _words(value: Any) -> Iterator[int]:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError(f"an array of shape {value.shape} is not contiguous")
        yield value.__array_interface__["data"][0]
        yield from value.shape
    elif isinstance(value, tuple):
        for one in value:
            yield from _words(one)
    elif isinstance(value, float):
        yield int(np.float64(value).view(np.int64))
    else:
        yield int(value)


def reader(sample: Callable[[], Any]) -> Callable[[Words], Any]:
    """Return a function for kernels that takes words and returns the reference to them.

    The words are those of a named tuple with fields of the same types as a sample's, which is made
    when a kernel is compiled; they do not change while it runs.
    """
    if numba_config.DISABLE_JIT:

        def rebuild(words: Words) -> Any:
            return _rebuilt(sample(), iter(words.tolist()))

        return rebuild

    @intrinsic
    def read(typingctx, words):  # type: ignore[no-untyped-def]
        kind = type_of(sample())

        def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            return builder.bitcast(array.data, context.get_value_type(kind))

        return kind(words), codegen

    found: Callable[[Words], Any] = read
    return found


def _same(views: Any) -> Any:
    return views


@intrinsic
def _by_value(typingctx, reference):  # type: ignore[no-untyped-def]
    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        kind, address = signature.args[0], arguments[0]
        fields = [
            _read_attribute(context, builder, kind, address, name) for name in kind.views.fields
        ]
        return context.make_tuple(builder, kind.views, fields)

    return reference.views(reference), codegen


#: Returns the named tuple that a reference refers to, which has no named tuples in it; for kernels
#: of rows, whose promise that arrays are separate covers those that they are given by value.
by_value: Callable[[Any], Any] = _same if numba_config.DISABLE_JIT else _by_value


def _rebuilt(sample: Any, words: Iterator[int]) -> Any:
    """Return the value of the sample's kind that these words describe."""
    if isinstance(sample, tuple):
        fields = [_rebuilt(one, words) for one in sample]
        return type(sample)(*fields)
    if isinstance(sample, np.ndarray):
        address = next(words)
        shape = [next(words) for _ in sample.shape]
        size = math.prod(shape)
        if size == 0:
            return np.zeros(shape, sample.dtype)
        memory: Any = (ctypes.c_byte * (size * sample.itemsize)).from_address(address)
        return np.frombuffer(memory, sample.dtype).reshape(shape)
    word = next(words)
    if isinstance(sample, float):
        return float(np.int64(word).view(np.float64))
    return type(sample)(word)


def _count(kind: Any) -> int:
    """Return the number of words of a type."""
    if isinstance(kind, BaseNamedTuple):
        return sum(map(_count, kind.types))
    return 1 + kind.ndim if isinstance(kind, types.Array) else 1


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = Reference

    def generic_resolve(self, reference: Reference, name: str) -> Any:
        if name not in reference.views.fields:
            return None
        found = reference.views.types[reference.views.fields.index(name)]
        return Reference(found) if isinstance(found, BaseNamedTuple) else found


@lower_getattr_generic(Reference)
def _read_attribute(context: Any, builder: Any, kind: Reference, address: Any, name: str) -> Any:
    index = kind.views.fields.index(name)
    first = sum(map(_count, kind.views.types[:index]))
    found = kind.views.types[index]
    integer = ir.IntType(64)

    def word(place: int, of: Any) -> Any:
        pointer = builder.gep(address, [ir.Constant(integer, _WORD * (first + place))])
        loaded = builder.load(builder.bitcast(pointer, of.as_pointer()), align=_WORD)
        # What a kernel writes is not here: what was read once need not be read again.
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if isinstance(found, BaseNamedTuple):
        return builder.gep(address, [ir.Constant(integer, _WORD * first)])
    if isinstance(found, types.Array):
        size = context.get_abi_sizeof(context.get_data_type(found.dtype))
        data = word(0, context.get_data_type(found.dtype).as_pointer())
        shape = [word(1 + axis, integer) for axis in range(found.ndim)]
        strides = [ir.Constant(integer, size)]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length, flags=["nsw"]))
        array = context.make_array(found)(context, builder)
        populate_array(array, data, shape, strides, size, meminfo=None)
        return array._getvalue()
    if found is types.boolean:
        return cgutils.is_not_null(builder, word(0, integer))
    return word(0, context.get_value_type(found))


@typeof_impl.register(Referenced)
def _typeof(value: Referenced, context: Any) -> Any:
    return value.kind()


@unbox(Reference)
def _unbox(kind: Reference, value: Any, c: Any) -> Any:
    found = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_voidptr(found)
    c.pyapi.decref(found)
    return NativeValue(address, is_error=c.pyapi.c_api_error())
