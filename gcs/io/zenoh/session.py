"""zenoh (https://zenoh.io) sessions: peers with explicit TCP endpoints, no router, no multicast.

One side of a mission listens, all others connect to it. Two peers that only connect do not reach each other.
A peer that connects keeps trying, so that the listener may start later or restart.

Messages are reliable with congestion control BLOCK: zenoh's default drops messages on a saturated link, and a
dropped scan would look like missed detections. A connected peer that no longer reads blocks `publish` once
for 5 s, when the buffers are full, until zenoh closes it.
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Literal, Self

import zenoh

from gcs.errors import LinkError

_RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}


class ZenohSession:
    """One zenoh session.

    Parameters
    ----------
    listen, connect : str
        One of them, or both: endpoints such as ``tcp/127.0.0.1:7447``.

    Raises
    ------
    LinkError
        When the endpoint is invalid, or cannot be listened on. A missing listener is no error.
    """

    def __init__(self, *, listen: str | None = None, connect: str | None = None) -> None:
        self.endpoint = connect or listen or ""
        if not self.endpoint:
            raise ValueError("a session listens or connects")
        try:
            self._session = zenoh.open(_config(listen, connect))
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, _what_to_do(error, listening=listen is not None)) from None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._subscribers: list[zenoh.Subscriber[None]] = []
        self._queryables: list[zenoh.Queryable[None]] = []

    def publish(self, key: str, payload: bytes) -> None:
        """Publish to the present subscribers, if any.

        Raises
        ------
        LinkError
            When the key is malformed or the session is closed.
        """
        try:
            self._publisher(key).put(payload)
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, f"cannot publish on `{key}`: {_first_sentence(error)}") from None

    def is_subscribed(self, key: str) -> bool:
        """Return True if somebody subscribes to a key.

        Raises
        ------
        LinkError
            When the key is malformed or the session is closed.
        """
        try:
            status: Any = self._publisher(key).matching_status  # an object; zenoh's types say bool
            return bool(status.matching)
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, f"cannot publish on `{key}`: {_first_sentence(error)}") from None

    def _publisher(self, key: str) -> zenoh.Publisher:
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                encoding=zenoh.Encoding.APPLICATION_JSON,
            )
            self._publishers[key] = publisher
        return publisher

    def subscribe(self, key_expr: str, callback: Callable[[str, bytes], None]) -> None:
        """Call `callback(key, payload)` for each message on matching keys, on a thread of zenoh.

        Raises
        ------
        LinkError
            When the key expression is malformed or the session is closed.
        """

        def handle(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.payload.to_bytes())

        try:
            self._subscribers.append(self._session.declare_subscriber(key_expr, handle))
        except zenoh.ZError as error:
            raise LinkError(
                self.endpoint, f"cannot subscribe to `{key_expr}`: {_first_sentence(error)}"
            ) from None

    def answer(self, key_expr: str, callback: Callable[[str, bytes, Callable[[bytes], None]], None]) -> None:
        """Call `callback(key, payload, reply)` for each query of `ask`, on a thread of zenoh.

        `reply` may be called later, by any thread that may wait: a peer that asks and does not read blocks it
        as it blocks `publish`.

        Raises
        ------
        LinkError
            When the key expression is malformed or the session is closed.
        """

        def handle(query: zenoh.Query) -> None:
            asked = str(query.key_expr)
            key = asked if "*" in key_expr else key_expr

            def reply(payload: bytes) -> None:
                with contextlib.suppress(zenoh.ZError), query:  # the peer has gone
                    query.reply(key, payload)

            callback(asked, b"" if query.payload is None else query.payload.to_bytes(), reply)

        try:
            self._queryables.append(self._session.declare_queryable(key_expr, handle))
        except zenoh.ZError as error:
            problem = f"cannot answer on `{key_expr}`: {_first_sentence(error)}"
            raise LinkError(self.endpoint, problem) from None

    def ask(
        self,
        key_expr: str,
        payload: bytes,
        within_s: float,
        answered: Callable[[str, bytes], None],
        ended: Callable[[], None],
    ) -> None:
        """Ask those who answer on matching keys: call `answered(key, payload)` for each, then `ended()`.

        Both are called on threads of zenoh. Without a peer that answers it ends at once, else after all have
        answered, `within_s` at the latest.

        Raises
        ------
        LinkError
            When the key expression is malformed or the session is closed.
        """

        def handle(reply: zenoh.Reply) -> None:
            if (sample := reply.ok) is not None:
                answered(str(sample.key_expr), sample.payload.to_bytes())

        try:
            self._session.get(
                key_expr,
                zenoh.handlers.Callback(handle, ended),
                congestion_control=zenoh.CongestionControl.BLOCK,  # of the answers, too
                consolidation=zenoh.ConsolidationMode.NONE,
                payload=payload,
                timeout=within_s,
            )
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, f"cannot ask on `{key_expr}`: {_first_sentence(error)}") from None

    def close(self) -> None:
        """End the session; published messages were handed to the system."""
        self._session.close()  # type: ignore[no-untyped-call]  # zenoh leaves its return type out

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@contextlib.contextmanager
def service_bus(role: Literal["listen", "connect"], endpoint: str) -> Iterator[tuple[ZenohSession, str]]:
    """Open a service's session; yield it, and the endpoint for orders.

    A service that connects to a sensor's endpoint also listens at its own endpoint on this machine, since two
    peers that only connect do not reach each other.

    Raises
    ------
    LinkError
        As `ZenohSession`.
    """
    own_endpoint = endpoint if role == "listen" else free_endpoint()
    with ZenohSession(listen=own_endpoint, connect=None if role == "listen" else endpoint) as bus:
        yield bus, own_endpoint


def free_endpoint() -> str:
    """Return a free TCP endpoint on this machine; zenoh does not report the port that it got for port 0."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _config(listen: str | None, connect: str | None) -> zenoh.Config:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,  # Endpoints are explicit only.
        "listen/endpoints": [listen] if listen else [],
        "listen/exit_on_failure": True,
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": _RETRY,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _what_to_do(error: zenoh.ZError, *, listening: bool) -> str:
    text = str(error)
    if "in use" in text:
        return "another process listens here already; end it, or choose another port in links.zenoh"
    advice = "cannot listen here" if listening else "cannot be used"
    return f"{advice} ({_first_sentence(error)}); expected something like tcp/127.0.0.1:7447"


def _first_sentence(error: zenoh.ZError) -> str:
    """Return zenoh's message without its source position."""
    return str(error).split(" at /", 1)[0]
