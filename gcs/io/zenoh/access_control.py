"""Access control on zenoh: what a node with a certificate may do, by its role.

`RIGHTS` is the only table. What it does not name is refused (default deny). Keys follow ``swarm/<mission>/``;
``{name}`` is the node's own name. A certificate's common name is ``<role>.<name>``, such as
``sensor.radar-1``; zenoh compares it exactly, so rules are made for each node of `nodes.toml`.

The node that accepts or opens a connection enforces the rules, both for what comes in and for what goes out.
zenoh tells a sender nothing about a refusal; `may` lets a sender check itself first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, TypeAlias, get_args

import zenoh

Role: TypeAlias = Literal["sensor", "viewer", "operator", "bridge", "command"]
Act: TypeAlias = Literal["put", "subscribe", "query", "answer", "announce", "watch"]
ROLES: Final[tuple[Role, ...]] = get_args(Role)


class Rights(NamedTuple):
    """Keys that a role may use, each as zenoh's key expressions."""

    put: tuple[str, ...] = ()
    subscribe: tuple[str, ...] = ()
    query: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    """Queryables: whose queries it answers."""
    announce: tuple[str, ...] = ()
    """Liveliness tokens of its own."""
    watch: tuple[str, ...] = ()
    """Liveliness tokens of others."""


_SHOWN: Final = (
    "picture/*", "plan", "upload", "agent_status", "notice", "ended", "answer", "status", "proposal", "truth",
)  # fmt: skip
_PAGE: Final = ("console/**",)
_ALL: Final = ("**", "**/@adv/**")
"""Everything of a mission; ``@adv`` has the caches of zenoh's advanced publishers."""

RIGHTS: Final[Mapping[Role, Rights]] = {
    "sensor": Rights(put=("sensor/{name}/scan",)),
    "viewer": Rights(put=("status_request",), subscribe=_SHOWN, query=_PAGE, watch=("command/*",)),
    "operator": Rights(put=("order", "status_request"), subscribe=_SHOWN, query=_PAGE, watch=("command/*",)),
    "bridge": Rights(
        put=("bridge/{name}/up", "bridge/{name}/status"),
        subscribe=("bridge/{name}/down",),
        answer=("bridge/{name}/lease",),
        announce=("bridge/{name}",),
        watch=("command/*",),
    ),
    "command": Rights(_ALL, _ALL, _ALL, _ALL, _ALL, _ALL),
}

_MESSAGES: Final[Mapping[Act, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "put": (("put", "delete"), ()),
    "subscribe": (("declare_subscriber",), ("put", "delete")),
    "query": (("query",), ("reply",)),
    "answer": (("declare_queryable", "reply"), ("query",)),
    "announce": (("liveliness_token",), ("liveliness_query", "declare_liveliness_subscriber")),
    "watch": (("liveliness_query", "declare_liveliness_subscriber"), ("liveliness_token",)),
}
"""zenoh's messages for each act of a node: those that come from it, and those that go to it."""
_PREFIX: Final = "swarm/*/"
_DECLARED: Final = ("declare_subscriber", "declare_queryable")
"""What this side receives and answers: every node may be told, since zenoh sends only what is asked for."""


def common_name(role: Role, name: str) -> str:
    """Return the common name of a node's certificate."""
    return f"{role}.{name}"


def keys_of(role: Role, name: str, act: Act) -> tuple[str, ...]:
    """Return the key expressions on which a node may do something, in every mission."""
    return tuple(_PREFIX + key.format(name=name) for key in getattr(RIGHTS[role], act))


def may(role: Role, name: str, act: Act, key: str) -> bool:
    """Return True if a node may do something on a key, or on all keys of a key expression."""
    wanted = zenoh.KeyExpr(key)
    return any(zenoh.KeyExpr(allowed).includes(wanted) for allowed in keys_of(role, name, act))


def access_control(nodes: Mapping[str, Role]) -> dict[str, object]:
    """Return zenoh's ``access_control`` configuration for nodes by name: no other node may do anything."""
    subjects = [{"id": name, "cert_common_names": [common_name(role, name)]} for name, role in nodes.items()]
    told = _rule("told", _DECLARED, "egress", tuple(_PREFIX + key for key in _ALL))
    rules = [told]
    policies = []
    for name, role in nodes.items():
        own = list(_rules_of(name, role))
        rules += own
        policies.append({"rules": ["told", *(rule["id"] for rule in own)], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules_of(name: str, role: Role) -> list[dict[str, object]]:
    rules = []
    for act, (incoming, outgoing) in _MESSAGES.items():
        keys = keys_of(role, name, act)
        for messages, flow in ((incoming, "ingress"), (outgoing, "egress")):
            if keys and messages:
                rules.append(_rule(f"{name} {act} {flow}", messages, flow, keys))
    return rules


def _rule(rule_id: str, messages: tuple[str, ...], flow: str, keys: tuple[str, ...]) -> dict[str, object]:
    return {
        "id": rule_id,
        "messages": list(messages),
        "flows": [flow],
        "permission": "allow",
        "key_exprs": list(keys),
    }
