"""The page of messages in the documentation, made from the records that are published.

``python tests/helpers/messages_page.py > docs/messages.md``

Keys come from `gcs.io.zenoh.key_expressions`, paths of the console from its description, types from the
records, and what a field means from the texts in their source.
"""

from __future__ import annotations

import ast
import enum
import inspect
import re
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, get_args, get_origin

import msgspec
import numpy as np

from gcs.console.view import page_records
from gcs.console.web.openapi import description
from gcs.console.web.playback_control import PlaybackRequest
from gcs.io.zenoh.key_expressions import KEYS
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.io.zenoh.scans import PolarScanMessage, ScanMessage
from gcs.model import Level, Notice, SwarmStatus

RECEIVED: tuple[type, ...] = (ScanMessage, PolarScanMessage, OrderMessage)
FEED = get_args(page_records.FeedMessage)
CONSOLE = {**vars(page_records), "OrderMessage": OrderMessage, "PlaybackRequest": PlaybackRequest}
CONSOLE["SwarmStatus"] = SwarmStatus

PAGE = """\
# Messages

What programs get from central command and send to it: on zenoh, and from the console's server. This
page is made from the records of the software. All payloads are JSON (RFC 8259, UTF-8). In every
record

- `t_ns` and other times that end with `_ns` are nanoseconds since 1970, by the run's clock;
- positions are metres east and north of the mission's origin, angles radians clockwise from north;
- a height is above what its name says: `msl` mean sea level, `rel` home, `agl` the ground;
- a target and its track have a label of two integers: `[12, 3]` is shown as T12.3;
- a field in *italics* may be left out by a sender.

Other fields may be added: ignore those that you do not know. [Sensors](sensors.md) and
[orders](orders.md) have examples. [Keys on zenoh](zenoh.md) says where each record is published.

## Paths of the console

The server of the [console](console.md) answers over HTTP. `/api/openapi.json` describes it for
programs.

| request | answer | records |
|---|---|---|
{paths}

`/feed` is a WebSocket: a [RoleMessage](#rolemessage), a [SnapshotMessage](#snapshotmessage) with all
sections, then an [UpdateMessage](#updatemessage) with those that have changed.

## Records

{records}"""

SIMPLE = {
    int: "integer",
    float: "number",
    str: "text",
    bool: "true or false",
    types.NoneType: "null",
    Any: "any",
}
LIMITS = {"ge": "from {:g}", "gt": "above {:g}", "le": "to {:g}", "lt": "below {:g}"}


class Field(NamedTuple):
    """A field of a record, as it is sent."""

    name: str
    kind: Any
    text: str
    has_default: bool = False


def is_record(kind: Any) -> bool:
    return hasattr(kind, "__struct_fields__") or hasattr(kind, "__dataclass_fields__")


def words(kind: Any) -> str:
    """Return a type in words, with links to records."""
    origin, arguments = get_origin(kind), get_args(kind)
    if kind in SIMPLE:
        return SIMPLE[kind]
    if is_record(kind):
        return link(kind)
    if origin is typing.Annotated:
        return " ".join([words(arguments[0]), *(word for one in arguments[1:] for word in limits(one))])
    if origin is Literal:
        return " or ".join(f'`"{one}"`' for one in arguments)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(words(one) for one in arguments if one is not msgspec.UnsetType)
    if origin is np.ndarray:
        return "array of numbers"
    if origin is list or (origin is tuple and arguments[-1] is ...):
        return f"list of {words(arguments[0])}"
    if origin is tuple:
        return f"[{', '.join(words(one) for one in arguments)}]"
    if origin in (dict, Mapping):
        return f"object: {words(arguments[0])} to {words(arguments[1])}"
    if issubclass(kind, enum.Enum):
        return "text, a code of [alarms](alarms.md)"
    raise TypeError(kind)


def limits(meta: msgspec.Meta) -> Iterator[str]:
    for name, text in LIMITS.items():
        if (value := getattr(meta, name)) is not None:
            yield text.format(value)
    if meta.max_length is not None:
        yield f"({meta.max_length} at most)"
    if meta.pattern is not None:
        yield f"`{meta.pattern}`"


def link(record: type) -> str:
    return f"[{record.__name__}](#{record.__name__.lower()})"


def parts(kind: Any) -> Iterator[type]:
    """Yield the records that a type has."""
    if is_record(kind):
        yield kind
    for one in get_args(kind):
        yield from parts(one)


def fields(record: type) -> list[Field]:
    """Return the fields of a record, those of the record that it extends first."""
    hints = typing.get_type_hints(record, include_extras=True)
    names = getattr(record, "__struct_fields__", None) or tuple(record.__dataclass_fields__)  # type: ignore[attr-defined]
    sent = getattr(record, "__struct_encode_fields__", names)
    empty = inspect.Parameter.empty
    defaults = {name: one.default is not empty for name, one in inspect.signature(record).parameters.items()}
    known = texts(record)
    found = [
        Field(shown, hints[name], known.get(name, ""), defaults[name])
        for name, shown in zip(names, sent, strict=True)
    ]
    if record is Notice:  # `gcs.io.record_json.encode_shown`
        found += [Field("level", Level, ""), Field("text", str, "Text with the subject before it.")]
    return found


def texts(record: type) -> dict[str, str]:
    """Return the text below each field in the source of a record and of those that it extends."""
    found = {}
    for base in record.__mro__:
        if is_record(base) and base.__module__.startswith("gcs."):
            (node,) = ast.parse(inspect.getsource(base)).body
            assert isinstance(node, ast.ClassDef)
            for field, after in zip(node.body, node.body[1:], strict=False):
                if isinstance(field, ast.AnnAssign) and isinstance(after, ast.Expr):
                    found[ast.unparse(field.target)] = ast.literal_eval(after.value)
    return found


def sentence(text: str | None) -> str:
    text = " ".join((text or "").split("\n\n")[0].replace("``", "`").split())
    text = re.sub(r"\bNone\b", "null", text)
    return text[:1].upper() + text[1:]


def section(record: type) -> str:
    lines = [f"### {record.__name__}", "", sentence(inspect.getdoc(record)), ""]
    config = getattr(record, "__struct_config__", None)
    if config and config.array_like:
        lines += ["It is sent as a list of its fields, in this order.", ""]
    lines += ["| field | type | meaning |", "|---|---|---|"]
    if config and config.tag:
        lines.append(f'| `{config.tag_field}` | `"{config.tag}"` |  |')
    for one in fields(record):
        name = f"*`{one.name}`*" if one.has_default else f"`{one.name}`"
        lines.append(f"| {name} | {words(one.kind)} | {sentence(one.text)} |")
    return "\n".join([*lines, ""])


def reachable(roots: list[type]) -> list[type]:
    """Return records, each followed by those that it has."""
    found: list[type] = []
    waiting = list(roots)
    while waiting:
        record = waiting.pop(0)
        if record not in found:
            found.append(record)
            waiting = [part for one in fields(record) for part in parts(one.kind)] + waiting
    return found


def named_in(what: object) -> list[type]:
    """Return the records that a part of the console's description names."""
    names = re.findall(r"schemas/(\w+)'", str(what))
    return [CONSOLE[name] for name in dict.fromkeys(names) if name in CONSOLE]


def messages_page() -> str:
    """Return the page as Markdown."""
    paths = []
    for path, methods in description()["paths"].items():
        for method in ("get", "post"):
            if what := methods.get(method):
                ok = next(iter(what["responses"].values()))
                records = ", ".join(link(one) for one in named_in([what.get("requestBody"), ok]))
                answer = what.get("summary") or ok["description"]
                paths.append(f"| `{method.upper()} {path}` | {answer} | {records} |")
    published = [key.record for key in KEYS if key.record is not None]
    roots = [*published, *RECEIVED, *named_in(description()["paths"]), *FEED]
    return PAGE.format(paths="\n".join(paths), records="\n".join(map(section, reachable(roots))))


if __name__ == "__main__":
    print(messages_page(), end="")
