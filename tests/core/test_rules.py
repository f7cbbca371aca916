"""A snapshot that lacks a field, or a stage that is changed from elsewhere, would go on with another flight.

The rules of `gcs.core.state` that its source code shows:

* A class has at most seven collaborators. A collaborator is a parameter of its constructor, or a field of its
  dataclass, that is a callable or an object of ours. Records of the state and values do not count: they are
  data (`gcs.core.state`, the modules of state in each
  package (`STATE`), `gcs.model`, `gcs.config`, `gcs.geo`, `gcs.endpoints`).
* Only the modules of a package write its records. Others read them, or call a method of the record.
* Only records change: no other class has an attribute that is assigned, or a container that is changed, after
  its construction.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.recorded_state import CACHES

ROOT = Path(__file__).parents[2]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): ast.parse(path.read_text())
    for path in sorted((ROOT / "gcs" / "core").rglob("*.py"))
}
MAX_COLLABORATORS = 7
VALUES = ("gcs.model", "gcs.config", "gcs.geo", "gcs.endpoints", "gcs.core.state")
STATE = re.compile(r"(gcs\.[\w.]+)\.(?:lease_messages|\w+_state)")
"""Modules of the records of a package: `gcs.core.state`, `gcs.core.tasking.tasking_state`."""
MUTATORS = frozenset(
    {"add", "append", "clear", "discard", "extend", "insert", "pop", "remove", "setdefault", "update"}
)
EXCEPTED_WRITERS = {"gcs.core.restart"}
"""It changes the state as a whole, between two events."""
CHANGING = CACHES | {
    "gcs.core.snapshot.PeriodicSnapshots._due_t_ns",
    "gcs.core.engine.Engine.stages",
    "gcs.core.engine.Engine.state",
}
"""Attributes that may change outside the records: caches, the period of the recorder's snapshots, and the
state as a whole."""


def imports_of(tree: ast.Module) -> dict[str, str]:
    """Return the module of each name that a module imports."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {name.asname or name.name: node.module or "" for node in nodes for name in node.names}


def classes_of(tree: ast.Module) -> list[ast.ClassDef]:
    return [node for node in tree.body if isinstance(node, ast.ClassDef)]


def methods_of(kind: ast.ClassDef) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in kind.body if isinstance(node, ast.FunctionDef)}


def names_in(node: ast.AST | None) -> set[str]:
    return set() if node is None else {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def is_dataclass(kind: ast.ClassDef) -> bool:
    return any("dataclass" in names_in(one) for one in kind.decorator_list)


# ---------------------------------------------------------------- collaborators


def is_value(module: str) -> bool:
    return STATE.fullmatch(module) is not None or any(
        module == one or module.startswith(f"{one}.") for one in VALUES
    )


def collaborators(kind: ast.ClassDef, module: str, tree: ast.Module) -> list[str]:
    """Return the collaborators of a class."""
    origins = {one.name: module for one in classes_of(tree)} | imports_of(tree)
    init = methods_of(kind).get("__init__")
    if init is not None:
        of = {one.arg: one.annotation for one in (*init.args.args, *init.args.kwonlyargs)}
    else:
        fields = [node for node in kind.body if isinstance(node, ast.AnnAssign)]
        of = {one.target.id: one.annotation for one in fields if isinstance(one.target, ast.Name)}
    return [
        name
        for name, annotation in of.items()
        for used in [names_in(annotation)]
        if "Callable" in used
        or any(origins.get(one, "").startswith("gcs.") and not is_value(origins[one]) for one in used)
    ]


def test_no_class_has_more_than_seven_collaborators() -> None:
    counts = {
        f"{module}.{kind.name}": found
        for module, tree in MODULES.items()
        for kind in classes_of(tree)
        if len(found := collaborators(kind, module, tree)) > MAX_COLLABORATORS
    }
    assert counts == {}


# ---------------------------------------------------------------- writers of records


def package_of(module: str) -> str:
    """Return the package of a module of state; the module itself if it has none."""
    match = STATE.fullmatch(module)
    return module if match is None else match[1]


def owners() -> dict[str, str]:
    """Return the package that owns each field of `Agent` and `State`."""
    tree = MODULES["gcs.core.state"]
    modules = imports_of(tree)
    return {
        node.target.id: package_of(modules[node.annotation.id])
        for kind in classes_of(tree)
        for node in kind.body
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and isinstance(node.annotation, ast.Name)
        and node.annotation.id in modules
    }


OWNERS = owners()


class Writes:
    """Writes of one module to records of other packages: by field, by alias and by annotated parameter."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self.module = module
        self.records = {
            name: package_of(origin) for name, origin in imports_of(tree).items() if STATE.fullmatch(origin)
        }
        self.found: list[str] = []
        for node in tree.body:
            if isinstance(node, ast.FunctionDef):
                self.visit(node, {})
            elif isinstance(node, ast.ClassDef):
                attributes: dict[str, str] = {}
                for method in sorted(methods_of(node).values(), key=lambda one: one.name != "__init__"):
                    self.visit(method, attributes)

    def owner(self, node: ast.AST, known: dict[str, str]) -> str | None:
        """Return the package that owns the record, or the part of one, that an expression yields."""
        match node:
            case ast.Name():
                return known.get(node.id)
            case ast.Attribute(value=ast.Name(id="self")):
                return known.get(f"self.{node.attr}")
            case ast.Attribute():
                return self.owner(node.value, known) or OWNERS.get(node.attr)
            case ast.Subscript():
                return self.owner(node.value, known)
            case ast.Call(func=ast.Attribute(attr="get" | "pop" | "setdefault")):
                return self.owner(node.func.value, known)  # type: ignore[attr-defined]
        return None

    def visit(self, function: ast.FunctionDef, attributes: dict[str, str]) -> None:
        known = dict(attributes)
        for argument in (*function.args.args, *function.args.kwonlyargs):
            for name in names_in(argument.annotation) & self.records.keys():
                known[argument.arg] = self.records[name]
        statements = [node for node in ast.walk(function) if hasattr(node, "lineno")]
        for node in sorted(statements, key=lambda one: (one.lineno, one.col_offset)):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    for one, value in pairs(target, node.value):
                        self.write(one, known)
                        owner = self.owner(value, known)
                        if owner is not None and (name := alias(one)):
                            known[name] = owner
            elif isinstance(node, ast.AugAssign):
                self.write(node.target, known)
            elif isinstance(node, ast.Delete):
                for target in node.targets:
                    self.write(target, known)
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                is_container = isinstance(node.func.value, ast.Attribute | ast.Subscript)
                if node.func.attr in MUTATORS and is_container:
                    self.note(node.func, self.owner(node.func.value, known))
        attributes |= {name: owner for name, owner in known.items() if name.startswith("self.")}

    def write(self, target: ast.AST, known: dict[str, str]) -> None:
        if isinstance(target, ast.Attribute | ast.Subscript) and not alias(target):
            self.note(target, self.owner(target.value, known))

    def note(self, node: ast.expr, owner: str | None) -> None:
        if owner is not None and not self.module.startswith(f"{owner}."):
            self.found.append(f"{self.module}:{node.lineno} {ast.unparse(node)}")


def pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield each target of an assignment with its value."""
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for one, other in zip(target.elts, value.elts, strict=True):
            yield from pairs(one, other)
    elif isinstance(target, ast.Tuple):
        for one in target.elts:
            yield one, value
    else:
        yield target, value


def alias(target: ast.expr) -> str:
    """Return the local name, or the attribute of `self`, that an assignment sets; else empty."""
    match target:
        case ast.Name():
            return target.id
        case ast.Attribute(value=ast.Name(id="self")):
            return f"self.{target.attr}"
    return ""


def test_only_its_own_package_writes_a_record() -> None:
    found = [
        write
        for module, tree in MODULES.items()
        if module not in EXCEPTED_WRITERS
        for write in Writes(module, tree).found
    ]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "self._agents[1].tasking.onboard = None",
        "tasking, n = agents[1].tasking, 0; tasking.retry.failures = n",
        "agent.perception.association.label, n = None, 0",
        "self._state.queue[1] = None",
        "del self._state.queue[1]",
        "agent.tasking.boots += 1",
        "one.retry.failures = 0",
        "self._state.queue.pop(1)",
    ],
)
def test_a_write_from_elsewhere_is_found(line: str) -> None:
    text = "from gcs.core.tasking.tasking_state import AgentTasking, TaskingState\n"
    text += "class A:\n    def __init__(self, state: TaskingState): self._state = state\n"
    text += f"    def f(self, one: AgentTasking): {line}\n"
    assert len(Writes("gcs.core.replanning.a", ast.parse(text)).found) == 1
    ours = "perception" if "perception" in line else "tasking"
    assert Writes(f"gcs.core.{ours}.a", ast.parse(text)).found == []


# ---------------------------------------------------------------- attributes that change


def changed_attributes(kind: ast.ClassDef) -> set[str]:
    """Return the attributes that methods of a class assign, and its own containers that they change."""
    containers, assigned, mutated = set[str](), set[str](), set[str]()
    for name, method in methods_of(kind).items():
        for node in ast.walk(method):
            match node:
                case ast.Assign(targets=targets):
                    written = [one for target in targets for one in pairs(target, node.value)]
                case ast.AnnAssign(target=target, value=ast.expr()) | ast.AugAssign(target=target):
                    written = [(target, node.value)]  # type: ignore[list-item]
                case ast.Call(func=ast.Attribute(attr=attr, value=changed)) if attr in MUTATORS:
                    mutated.add(alias(changed))
                    continue
                case _:
                    continue
            for one, value in written:
                if isinstance(one, ast.Subscript):
                    mutated.add(alias(one.value))
                elif name != "__init__":
                    assigned.add(alias(one))
                elif isinstance(value, ast.Dict | ast.DictComp | ast.List | ast.ListComp | ast.Set):
                    containers.add(alias(one))
    changing = assigned | containers & mutated
    return {one.removeprefix("self.") for one in changing if one.startswith("self.")}


def test_only_records_change() -> None:
    found = {
        f"{module}.{kind.name}.{name}"
        for module, tree in MODULES.items()
        for kind in classes_of(tree)
        if not is_dataclass(kind)
        for name in changed_attributes(kind)
    }
    assert found <= CHANGING, sorted(found - CHANGING)


def test_a_container_by_vehicle_in_a_stage_is_found() -> None:
    text = "class A:\n    def __init__(self): self._b = {}\n    def f(self, v): self._b[v] = 1"
    assert changed_attributes(classes_of(ast.parse(text))[0]) == {"_b"}
