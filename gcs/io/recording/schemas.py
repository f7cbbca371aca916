"""JSON Schemas of the records, in the dialect that Foxglove and Lichtblick read from an MCAP.

Their reader (``parseJsonSchema``) accepts objects whose properties are booleans, numbers, strings (base64 for
bytes), objects, and lists of these. It refuses the whole channel because of ``$ref``, ``null`` or a list of
lists. So an optional field has the schema of its type, and a field of several types has none. Lists of lists
(covariances, detections) are left out of the schema; viewers show them all the same.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

_SIMPLE: dict[type, dict[str, str]] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    str: {"type": "string"},
    bytes: {"type": "string", "contentEncoding": "base64"},
}
_VECTORS = frozenset({"mean", "cardinality"})
"""Array fields of one dimension."""


def json_schema(record_type: type) -> bytes:
    """Return the schema of a record of `gcs.model`."""
    return msgspec.json.encode(_object(record_type))


def _object(record_type: type) -> dict[str, Any]:
    properties = {name: _property(name, hint) for name, hint in get_type_hints(record_type).items()}
    return {
        "type": "object",
        "title": record_type.__name__,
        "description": (record_type.__doc__ or "").strip().splitlines()[0],
        "properties": {name: schema for name, schema in properties.items() if schema is not None},
    }


def _property(name: str, hint: Any) -> dict[str, Any] | None:
    """Return the schema of a field; None if the dialect cannot express it."""
    if hint in _SIMPLE:
        return dict(_SIMPLE[hint])
    origin = get_origin(hint)
    arguments = get_args(hint)
    if origin is None and isinstance(hint, type):
        return {"type": "string"} if issubclass(hint, StrEnum) else _object(hint)
    if origin is Mapping:
        return None
    if origin is Literal:
        return {"type": "string", "enum": list(arguments)}
    if origin in (Union, types.UnionType):
        types_of_value = [argument for argument in arguments if argument is not type(None)]
        return _property(name, types_of_value[0]) if len(types_of_value) == 1 else None
    if origin is np.ndarray:
        return {"type": "array", "items": {"type": "number"}} if name in _VECTORS else None
    if origin is tuple:
        items = _property(name, arguments[0])
        return {"type": "array", "items": items} if items is not None and items["type"] != "array" else None
    raise TypeError(f"{name}: no schema for {hint}")
