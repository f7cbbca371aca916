"""Conversion of plain data to tables, with mistakes in the words of TOML."""

from __future__ import annotations

import re
import types
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import msgspec

from gcs.allowed_words import with_allowed_words
from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode

T = TypeVar("T")

_WORDS = {
    "object": "a table",
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
}
"""Type names of msgspec, in the words of TOML."""
_RENAMED = {
    "accel_std_m_s2": "accel_psd_m2_s3",
    "acceleration": "piecewise_accel_std_m_s2",
    "dead_existence": "lost_existence",
    "lane_step_m": "layer_step_m",
    "lanes": "layers",
    "most_probability": "max_probability",
}
"""New names of renamed keys."""
_WHERE = re.compile(r"^(?P<problem>.*?)(?: - at `(?P<path>[^`]*)`)?$", re.DOTALL)


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A TOML table: unknown keys are mistakes."""


def convert(raw: object, to: type[T], source: str, prefix: str = "") -> T:
    """Validate plain data against a table type.

    Raises
    ------
    ConfigError
        With all mistakes: the dotted key and the expected value of each.
    """
    try:
        return msgspec.convert(raw, to)
    except RecursionError:
        raise ConfigError(source, prefix, MistakeCode.INVALID_FILE, "is nested too deeply") from None
    except msgspec.ValidationError:
        found = [ConfigError(source, *mistake) for mistake in _mistakes(raw, to, prefix)]
        raise ConfigError.of_all(found) from None


def _mistakes(raw: Any, to: Any, key: str) -> Iterator[tuple[str, MistakeCode, str]]:
    """Yield the dotted key, the kind and the description of each mistake; of a table, field by field."""
    to = _without_none(to)
    if isinstance(to, type) and issubclass(to, msgspec.Struct) and isinstance(raw, dict):
        fields = {field.encode_name: field for field in msgspec.structs.fields(to)}
        found = []
        if to.__struct_config__.forbid_unknown_fields:
            found += [
                (key, MistakeCode.UNKNOWN_KEY, _unknown(str(name), list(fields)))
                for name in raw
                if name not in fields
            ]
        found += [
            (key, MistakeCode.MISSING_KEY, f"the key `{name}` is missing here")
            for name, field in fields.items()
            if field.required and name not in raw
        ]
        for name, field in fields.items():
            if name in raw:
                found += _mistakes(raw[name], field.type, f"{key}.{name}" if key else name)
    elif isinstance(raw, list) and get_origin(rows := _bare(to)) is list:
        found = [
            mistake
            for index, row in enumerate(raw)
            for mistake in _mistakes(row, get_args(rows)[0], f"{key}[{index}]")
        ]
    elif isinstance(raw, dict) and get_origin(named := _bare(to)) is dict:
        found = [
            mistake
            for name, row in raw.items()
            for mistake in _mistakes(row, get_args(named)[1], f"{key}.{name}")
        ]
    else:
        found = []
    yield from found
    if found:
        return
    try:
        msgspec.convert(raw, to)
    except msgspec.ValidationError as error:
        match = _WHERE.match(str(error))
        assert match is not None
        path = (match["path"] or "$").removeprefix("$")
        problem = _plain(with_allowed_words(match["problem"], to, path))
        yield (key + path).removeprefix("."), _kind(raw, to), problem


def _kind(raw: Any, to: Any) -> MistakeCode:
    """Return the kind of the mistake of a value that has no fields."""
    without_limits = _without_limits(to)
    for kind, code in (
        (without_limits, MistakeCode.OUT_OF_RANGE),
        (_with_any_word(without_limits), MistakeCode.UNKNOWN_NAME),
    ):
        try:
            msgspec.convert(raw, kind)
        except msgspec.ValidationError:
            continue
        return MistakeCode.WRONG_TYPE if isinstance(raw, str) and code is MistakeCode.OUT_OF_RANGE else code
    return MistakeCode.WRONG_TYPE


def _without_limits(kind: Any) -> Any:
    """Return a type without its ranges, lengths and patterns."""
    if get_origin(kind) is Annotated:
        return _without_limits(get_args(kind)[0])
    return _rebuilt(kind, _without_limits)


def _with_any_word(kind: Any) -> Any:
    """Return a type that takes any text where it takes certain words."""
    return str if get_origin(kind) is Literal else _rebuilt(kind, _with_any_word)


def _rebuilt(kind: Any, change: Callable[[Any], Any]) -> Any:
    """Return a type with its parts changed."""
    origin = get_origin(kind)
    if origin is None or origin is Literal:
        return kind
    parts = tuple(part if part is ... else change(part) for part in get_args(kind))
    return Union[parts] if origin in (Union, types.UnionType) else origin[parts]  # noqa: UP007  made here


def _bare(to: Any) -> Any:
    return get_args(to)[0] if get_origin(to) is Annotated else to


def _without_none(to: Any) -> Any:
    """Return the type of an optional value: TOML has no null."""
    if get_origin(to) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(to) if kind is not type(None)]
        return kinds[0] if len(kinds) == 1 else to
    return to


def _unknown(name: str, known: list[str]) -> str:
    """Return the error of an unknown key, with a suggestion."""
    near = [_RENAMED[name]] if _RENAMED.get(name) in known else get_close_matches(name, known, 1)
    hint = f"did you mean `{near[0]}`?" if near else "misspelt, or in the wrong table?"
    if name == "accel_std_m_s2" and near == ["accel_psd_m2_s3"]:
        hint = "did you mean `accel_psd_m2_s3`? Its value is the square of the former one"
        if "piecewise_accel_std_m_s2" in known:
            hint += '; with acceleration = "piecewise", did you mean `piecewise_accel_std_m_s2`?'
    return f"unknown key `{name}`: {hint}"


def _plain(problem: str) -> str:
    """Return an error of msgspec in the words of TOML."""
    problem = re.sub(r"Object missing required field `(\w+)`", r"the key `\1` is missing here", problem)
    problem = re.sub(
        r"Object contains unknown field `(\w+)`",
        r"unknown key `\1`: misspelt, or in the wrong table?",
        problem,
    )
    problem = problem.replace(" | null`", "`")  # TOML has no null
    for word, plain in _WORDS.items():
        problem = problem.replace(f"`{word}`", plain)
    return problem.replace("Expected", "expected")
