"""The compiler's type for NamedTuples at an address (`Placed`): how it is recognised, how a field is read.

Imported by `basset._compile` once numba is there.
"""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir
from numba.core import cgutils, imputils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, models, register_model, typeof_impl, unbox

from basset._compile import Placed


class Place(types.Type):
    """A NamedTuple at an address: passed as one pointer; fields are read on access."""

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        super().__init__(f"Place.{kind.instance_class.__name__}.{hashlib.sha256(str(kind).encode()).hexdigest()[:16]}")


KNOWN: dict[Any, Place] = {}


@typeof_impl.register(Placed)
def _typeof(value: Placed, context: Any) -> Place:
    found = KNOWN.get(value.kind)
    if found is None:
        found = KNOWN[value.kind] = Place(typeof_impl(value._given, context))
    return found


@register_model(Place)
class PlaceModel(models.OpaqueModel):
    """A pointer."""


@unbox(Place)
def _unbox(kind: Place, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(value, "address")
    found = c.builder.inttoptr(c.pyapi.long_as_longlong(address), cgutils.voidptr_t)
    c.pyapi.decref(address)
    return NativeValue(found)


@infer_getattr
class PlaceAttribute(AttributeTemplate):
    """The type of a field; of a NamedTuple within, its place."""

    key = Place

    def generic_resolve(self, place: Place, name: str) -> Any:  # type: ignore[override]  # numba marks what is to be written so
        if name not in place.kind.fields:
            return None
        found = place.kind[place.kind.fields.index(name)]
        return Place(found) if isinstance(found, types.BaseNamedTuple) else found


@imputils.lower_getattr_generic(Place)
def _field(context: Any, builder: Any, place: Place, value: Any, name: str) -> Any:
    k = place.kind.fields.index(name)
    found = place.kind[k]
    whole = builder.bitcast(value, context.get_value_type(place.kind).as_pointer())
    pointer = builder.gep(whole, [ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), k)], inbounds=True)
    if isinstance(found, types.BaseNamedTuple):
        return builder.bitcast(pointer, cgutils.voidptr_t)
    loaded = builder.load(pointer)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return imputils.impl_ret_borrowed(context, builder, found, loaded)
