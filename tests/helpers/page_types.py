"""Types of the page's modules, made from the records that the console sends.

``python tests/helpers/page_types.py > gcs/console/page_types.d.ts``

It reads the text of the records, so that the types keep the names of aliases and the descriptions of fields.
Arrays of shown records are points.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SCHEMA = "gcs.console.view.page_records"
ROOT = Path(__file__).resolve().parents[2]
TARGET = ROOT / "gcs/console/page_types.d.ts"
HEAD = """\
// What the server sends to the page's modules. Only the type checker reads this file; it is not shipped.
// Generated: change gcs/console/view/page_records.py or gcs/model, then run
//   python tests/helpers/page_types.py > gcs/console/page_types.d.ts
// Positions are east and north in metres. A number that is not known is null.
"""
SIMPLE = {
    "int": "number",
    "float": "number",
    "str": "string",
    "bool": "boolean",
    "None": "null",
    "FloatArray": "Point[]",
}


@cache
def module(name: str) -> ast.Module:
    path = ROOT / name.replace(".", "/")
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text(encoding="utf-8"))


def definition(where: str, name: str) -> tuple[str, ast.ClassDef | ast.AnnAssign, str]:
    """Return the module, the statement and the description of a class or alias that a module knows."""
    body = module(where).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.ClassDef) and node.name == name:
            return where, node, ast.get_docstring(node) or ""
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == name:
            return where, node, text_of(after)
        if isinstance(node, ast.ImportFrom) and any(one.name == name for one in node.names):
            assert node.module is not None
            return definition(node.module, name)
    raise LookupError(f"{where}: {name}")


def text_of(node: ast.stmt | None) -> str:
    """Return the text of a statement that is a text; empty for another one."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return " ".join(str(node.value.value).split())
    return ""


def comment(text: str, indent: str = "") -> str:
    text = " ".join(re.sub(r"\bNone\b", "null", text.split("\n\n")[0]).split())
    return f"{indent}/** {text[:1].upper()}{text[1:]} */\n" if text else ""


class Types:
    """Collects the declarations of types, and of those that they need."""

    def __init__(self) -> None:
        self.declared: dict[str, str] = {}
        self.origins: dict[str, str] = {}

    def add(self, where: str, name: str) -> str:
        where, node, text = definition(where, name)
        assert self.origins.setdefault(name, where) == where, f"two types have the name {name}"
        if name not in self.declared:
            self.declared[name] = ""  # keeps its place
            body = self.interface(where, node) if isinstance(node, ast.ClassDef) else self.alias(where, node)
            self.declared[name] = comment(text) + body
        return name

    def alias(self, where: str, node: ast.AnnAssign) -> str:
        assert isinstance(node.target, ast.Name)
        assert node.value is not None
        return f"export type {node.target.id} = {self.type(where, node.value)};\n"

    def interface(self, where: str, node: ast.ClassDef) -> str:
        bases = [
            self.add(where, one.id) for one in node.bases if isinstance(one, ast.Name) and one.id != "Struct"
        ]
        extends = f" extends {', '.join(bases)}" if bases else ""
        return f"export interface {node.name}{extends} {{\n{''.join(self.fields(where, node))}}}\n"

    def fields(self, where: str, node: ast.ClassDef) -> Iterator[str]:
        for keyword in node.keywords:
            if keyword.arg == "tag":
                yield f"  type: {self.literal(keyword.value)};\n"
        for field, after in zip(node.body, [*node.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                parts = list(self.parts(where, field.annotation))
                known = [one for one in parts if one != "UnsetType"]
                name = field.target.id.rstrip("_") + ("?" if len(known) < len(parts) else "")
                text = text_of(after)
                if text.startswith("(k,)"):  # of an array: one number each
                    known = ["number[]" if one == "Point[]" else one for one in known]
                yield f"{comment(text, '  ')}  {name}: {' | '.join(known)};\n"

    def type(self, where: str, node: ast.expr) -> str:
        return " | ".join(self.parts(where, node))

    def parts(self, where: str, node: ast.expr) -> Iterator[str]:
        """Yield the types of a union."""
        match node:
            case ast.BinOp(left=left, right=right):
                yield from self.parts(where, left)
                yield from self.parts(where, right)
            case ast.Constant(value=None):
                yield "null"
            case ast.Name(id=name):
                yield name if name == "UnsetType" else SIMPLE.get(name) or self.add(where, name)
            case ast.Subscript(value=ast.Name(id="Literal"), slice=ast.Tuple(elts=values)):
                yield from map(self.literal, values)
            case ast.Subscript(value=ast.Name(id="list"), slice=item):
                yield self.array(where, item)
            case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=[item, ast.Constant()])):
                yield self.array(where, item)
            case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=items)):
                yield f"[{', '.join(self.type(where, one) for one in items)}]"
            case ast.Subscript(value=ast.Name(id="dict"), slice=ast.Tuple(elts=[key, value])):
                keys, values = self.type(where, key), self.type(where, value)
                is_open = keys in ("string", "number")
                yield f"Record<string, {values}>" if is_open else f"Partial<Record<{keys}, {values}>>"
            case _:
                raise TypeError(ast.unparse(node))

    def array(self, where: str, item: ast.expr) -> str:
        parts = list(self.parts(where, item))
        return f"{parts[0]}[]" if len(parts) == 1 else f"({' | '.join(parts)})[]"

    @staticmethod
    def literal(node: ast.expr) -> str:
        return json.dumps(ast.literal_eval(node))


def page_types() -> str:
    """Return the text of the file."""
    types = Types()
    for node in module(SCHEMA).body:
        if isinstance(node, ast.ClassDef):
            types.add(SCHEMA, node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            types.add(SCHEMA, node.target.id)
    return "\n".join([HEAD, *types.declared.values()])


if __name__ == "__main__":
    print(page_types(), end="")
