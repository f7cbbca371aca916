"""zenoh (https://zenoh.io) sessions: peers with explicit TCP endpoints, no router, no multicast.

One side of a mission listens, all others connect to it. Two peers that only connect do not reach each other.
A peer that connects keeps trying, so that the listener may start later or restart.

Messages are reliable with congestion control BLOCK: zenoh's default drops messages on a saturated link, and a
dropped scan would look like missed detections. A connected peer that no longer reads blocks `publish` once
for 5 s, when the buffers are full, until zenoh closes it.

With a folder of a certificate (`gcs.io.zenoh.certificates`) a session uses mutual TLS: both sides need a
certificate of one certificate authority. A command node also enforces the roles of
`gcs.io.zenoh.access_control`. A link that is up stays up when a certificate expires: nothing is cut in
flight.
"""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Literal, Self

import zenoh

from gcs.errors import LinkError
from gcs.io.zenoh.access_control import Act, access_control, common_name, may
from gcs.safe_text import printable

if TYPE_CHECKING:
    from gcs.io.zenoh.certificates import Node

_RETRY: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}


class ZenohSession:
    """One zenoh session.

    Parameters
    ----------
    listen, connect : str
        One of them, or both: endpoints such as ``tcp/127.0.0.1:7447``, or ``tls/10.0.0.5:7447`` with `tls`.
        `connect` may name several, with commas between.
    tls : Path
        Folder with the certificate of this node.

    Raises
    ------
    LinkError
        When the endpoint is invalid, or cannot be listened on. A missing listener is no error.
    ConfigError
        When the certificate is unusable.
    """

    def __init__(
        self, *, listen: str | None = None, connect: str | None = None, tls: Path | None = None
    ) -> None:
        self.endpoint = connect or listen or ""
        if not self.endpoint:
            raise ValueError("a session listens or connects")
        check_transport([*_endpoints(listen), *_endpoints(connect)], tls)
        self.node = None if tls is None else _read_node(tls)
        """Own certificate; None without TLS."""
        config = _config(listen, connect)
        if self.node is not None:
            config |= _tls_config(self.node, listens=listen is not None)
        try:
            self._session = zenoh.open(_zenoh_config(config))
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, _what_to_do(error, listening=listen is not None)) from None
        self._listens = listen is not None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._subscribers: list[zenoh.Subscriber[None]] = []
        self._queryables: list[zenoh.Queryable[None]] = []
        self._watcher: zenoh.LinkEventsListener[None] | None = None

    def publish(self, key: str, payload: bytes) -> None:
        """Publish to the present subscribers, if any.

        Raises
        ------
        LinkError
            When the key is malformed, the role of this node has no right to it, or the session is closed.
        """
        with self._link_errors("publish on", key):
            self._publisher(key).put(payload)

    def is_subscribed(self, key: str) -> bool:
        """Return True if a key has a subscriber.

        Raises
        ------
        LinkError
            When the key is malformed or the session is closed.
        """
        with self._link_errors("publish on", key):
            status: Any = self._publisher(key).matching_status  # an object; zenoh's types say bool
            return bool(status.matching)

    def _publisher(self, key: str) -> zenoh.Publisher:
        publisher = self._publishers.get(key)
        if publisher is None:
            self._check_right("put", "publish on", key)
            publisher = self._session.declare_publisher(
                key,
                congestion_control=zenoh.CongestionControl.BLOCK,
                encoding=zenoh.Encoding.APPLICATION_JSON,
            )
            self._publishers[key] = publisher
        return publisher

    def subscribe(self, key_expr: str, callback: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Call `callback(key, payload)` for each message on matching keys, on a thread of zenoh.

        Return a function that ends this, and raises nothing: a node that takes over goes on.

        Raises
        ------
        LinkError
            When the key expression is malformed, the role of this node has no right to it, or the session is
            closed.
        """

        def handle(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.payload.to_bytes())

        with self._link_errors("subscribe to", key_expr):
            self._check_right("subscribe", "subscribe to", key_expr)
            subscriber = self._session.declare_subscriber(key_expr, handle)
        self._subscribers.append(subscriber)

        def end() -> None:
            self._subscribers.remove(subscriber)
            with contextlib.suppress(zenoh.ZError):  # it has ended with the other side
                subscriber.undeclare()  # type: ignore[no-untyped-call]  # as `close`

        return end

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

        with self._link_errors("answer on", key_expr):
            self._check_right("answer", "answer on", key_expr)
            self._queryables.append(self._session.declare_queryable(key_expr, handle))

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

        with self._link_errors("ask on", key_expr):
            self._check_right("query", "ask on", key_expr)
            self._session.get(
                key_expr,
                zenoh.handlers.Callback(handle, ended),
                congestion_control=zenoh.CongestionControl.BLOCK,  # of the answers, too
                consolidation=zenoh.ConsolidationMode.NONE,
                payload=payload,
                timeout=within_s,
            )

    def watch_nodes(self, callback: Callable[[str], None]) -> None:
        """Call `callback(common name)`, on a thread of zenoh, when a node without rights connects.

        Once for each name, and only on a command node: others do not know the nodes.
        """
        if self.node is None or (nodes := self.node.access(listens=self._listens)) is None:
            return
        known = {common_name(role, name) for name, role in nodes.items()}

        def handle(event: zenoh.LinkEvent) -> None:
            name = event.link.auth_identifier or ""
            if event.kind == zenoh.SampleKind.PUT and name not in known:
                known.add(name)
                callback(printable(name))

        self._watcher = self._session.info.declare_link_events_listener(handle, history=True)

    def names_connected(self) -> list[str]:
        """Return the common names of connected nodes; "" for one without a certificate."""
        return [link.auth_identifier or "" for link in self._session.info.links()]

    def why_unanswered(self) -> str:
        """Return the likely cause when nothing answers at the endpoint to which this session connects.

        This tries the connection once more, for up to three seconds.
        """
        names = self.names_connected()
        if names and self.node is not None:
            own = self.node.common_name
            return f"{names[0]} is connected and does not answer: is {own} in its nodes.toml?"
        if names or self.node is None:
            return "is it running?"
        from gcs.io.zenoh.handshake import tls_problem

        return tls_problem(self.endpoint, self.node.folder) or "is it running?"

    @contextlib.contextmanager
    def _link_errors(self, verb: str, key: str) -> Iterator[None]:
        """Raise zenoh's errors as `LinkError`."""
        try:
            yield
        except zenoh.ZError as error:
            raise LinkError(self.endpoint, f"cannot {verb} `{key}`: {_first_sentence(error)}") from None

    def _check_right(self, act: Act, verb: str, key: str) -> None:
        """Refuse what the other side would drop without a word."""
        node = self.node
        if node is not None and not may(node.role, node.name, act, key):
            problem = f"{node.common_name} may not {verb} `{key}`: its role is {node.role} (docs/security.md)"
            raise LinkError(self.endpoint, problem)

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
def service_bus(
    role: Literal["listen", "connect"], endpoint: str, tls: Path | None = None
) -> Iterator[tuple[ZenohSession, str]]:
    """Open a service's session; yield it, and the endpoint for orders.

    A service that connects to a sensor's endpoint also listens at its own endpoint on this machine, since two
    peers that only connect do not reach each other.

    Raises
    ------
    LinkError
        As `ZenohSession`.
    """
    own_endpoint = endpoint if role == "listen" else free_endpoint("tcp" if tls is None else "tls")
    with ZenohSession(listen=own_endpoint, connect=None if role == "listen" else endpoint, tls=tls) as bus:
        yield bus, from_this_machine(own_endpoint)


def free_endpoint(protocol: Literal["tcp", "tls"] = "tcp") -> str:
    """Return a free endpoint on this machine; zenoh does not report the port that it got for port 0."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


def from_this_machine(endpoint: str) -> str:
    """Return the endpoint at which a listener on all addresses is reached: certificates name no 0.0.0.0."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def _endpoints(text: str | None) -> list[str]:
    return text.split(",") if text else []


def check_transport(endpoints: Iterable[str], tls: Path | None) -> None:
    """Check that TLS endpoints come with a certificate, and only those.

    Raises
    ------
    LinkError
        They do not.
    """
    for endpoint in endpoints:
        is_tls = endpoint.startswith("tls/")
        if is_tls and tls is None:
            problem = "needs a certificate: --zenoh-tls FOLDER, or links.zenoh_tls in a mission file"
            raise LinkError(endpoint, problem)
        if tls is not None and not is_tls and not endpoint.startswith("unixsock-stream/"):
            raise LinkError(endpoint, f"would not use the certificate in {tls}; expected tls/HOST:PORT")


def _read_node(folder: Path) -> Node:
    from gcs.io.zenoh.certificates import read_node

    return read_node(folder)


def _tls_config(node: Node, *, listens: bool) -> dict[str, object]:
    certificate = str(node.folder / "node.pem")
    key = str(node.folder / "node.key")
    tls = {
        "root_ca_certificate": str(node.folder / "ca.pem"),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": False,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
    }
    nodes = node.access(listens=listens)
    config: dict[str, object] = {"transport/link/tls": tls}
    if nodes is not None:
        config["access_control"] = access_control(nodes)
    return config


def _config(listen: str | None, connect: str | None) -> dict[str, object]:
    return {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,  # Endpoints are explicit only.
        "listen/endpoints": [listen] if listen else [],
        "listen/exit_on_failure": True,
        "connect/endpoints": _endpoints(connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": _RETRY,
        # Without space in /dev/shm zenoh panics in `put`; a killed process leaves 16 MB there.
        "transport/shared_memory/enabled": False,
    }


def _zenoh_config(settings: dict[str, object]) -> zenoh.Config:
    config = zenoh.Config()
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
