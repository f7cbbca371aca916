"""Client of orders: sends one on zenoh, and waits for its answers (``docs/orders.md``).

An order is repeated until it is answered, since the connection may come up late. The service carries out each
order id once.
"""

from __future__ import annotations

import getpass
import os
import queue
import secrets
import socket
import time
from collections.abc import Iterator

from gcs.errors import NoAnswerError, WireError
from gcs.io.record_json import decode
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import answer_key, order_key, status_key, status_request_key
from gcs.io.zenoh.order_messages import OrderMessage, encode_order
from gcs.io.zenoh.session import ZenohSession
from gcs.model import OrderAnswer, SwarmStatus

_REPEAT_S = 0.5


def sender_name() -> str:
    """Return the name of this program among the senders of orders: each has a queue of its own."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = str(os.getuid())
    return f"{user}@{socket.gethostname()}, process {os.getpid()}"


def send_order(
    address: ServiceAddress, order: OrderMessage, answer_s: float, end_s: float
) -> Iterator[OrderAnswer]:
    """Send an order to a running service; yield its answers until the last.

    Parameters
    ----------
    answer_s
        Timeout of the first answer.
    end_s
        Timeout of the last answer.

    Raises
    ------
    NoAnswerError
        There is no answer, or the last answers do not come in time.
    LinkError, ConfigError
        The certificate gives no right to order, or is unusable.
    """
    endpoint = address.zenoh
    mission = address.mission
    tls = address.tls
    answers: queue.Queue[OrderAnswer] = queue.Queue()

    def heard(key: str, payload: bytes) -> None:
        try:
            answer = decode(key, payload, OrderAnswer)
        except WireError:
            return
        if answer.order_id == order.order_id:
            answers.put(answer)

    began_s = time.monotonic()
    answered = False
    with ZenohSession(connect=endpoint, tls=tls) as bus:
        bus.subscribe(answer_key(mission), heard)
        while True:
            waited_s = time.monotonic() - began_s
            if not answered:
                if waited_s > answer_s:
                    raise _no_answer(bus, mission)
                bus.publish(order_key(mission), encode_order(order))
            elif waited_s > end_s:
                raise NoAnswerError(
                    endpoint, f"no further answer within {end_s:g} s; the order is still being tried"
                )
            try:
                answer = answers.get(timeout=_REPEAT_S)
            except queue.Empty:
                continue
            answered = True
            yield answer
            if not answer.waiting:
                return


def _no_answer(bus: ZenohSession, mission: str) -> NoAnswerError:
    problem = f"no service of the mission {mission} answers here: {bus.why_unanswered()}"
    return NoAnswerError(bus.endpoint, problem)


def request_status(address: ServiceAddress, timeout_s: float) -> SwarmStatus:
    """Return the status of a running service.

    Raises
    ------
    NoAnswerError
        There is no answer in time.
    LinkError, ConfigError
        The certificate gives no right to ask, or is unusable.
    """
    endpoint = address.zenoh
    mission = address.mission
    tls = address.tls
    order_id = f"status-{secrets.token_hex(6)}"
    replies: queue.Queue[SwarmStatus] = queue.Queue()
    problem = ""

    def heard(key: str, payload: bytes) -> None:
        nonlocal problem
        try:
            if key == status_key(mission):
                reply = decode(key, payload, SwarmStatus)
                if reply.order_id.startswith(order_id):
                    replies.put(reply)
            elif (answer := decode(key, payload, OrderAnswer)).order_id.startswith(order_id):
                problem = answer.detail
        except WireError:
            return

    began_s = time.monotonic()
    number = 0
    with ZenohSession(connect=endpoint, tls=tls) as bus:
        bus.subscribe(status_key(mission), heard)
        bus.subscribe(answer_key(mission), heard)
        while time.monotonic() - began_s < timeout_s:
            number += 1
            message = OrderMessage(order_id=f"{order_id}-{number}", action="status", origin=sender_name())
            bus.publish(status_request_key(mission), encode_order(message))
            try:
                return replies.get(timeout=_REPEAT_S)
            except queue.Empty:
                continue
        raise NoAnswerError(endpoint, problem) if problem else _no_answer(bus, mission)
