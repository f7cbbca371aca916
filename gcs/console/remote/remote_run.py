"""Run in another process, for its console: a service over zenoh."""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Final

from gcs.console.remote.messages import DetailRequest, decode_detail, decode_news, encode_request
from gcs.console.source import Source, UnknownVehicleError
from gcs.console.view.capture import Capture
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import VehicleDetail
from gcs.errors import LinkError, NoAnswerError, WireError
from gcs.io.event_loop import on_loop
from gcs.io.zenoh.key_expressions import console_feed_key, console_vehicle_key, mission_of, order_key
from gcs.io.zenoh.session import ZenohSession

_ANSWER_S: Final = 1.0
_RETRY_S: Final = 0.1


class RemoteRun:
    """News, details and orders of a service."""

    def __init__(self, bus: ZenohSession, mission: str) -> None:
        self._bus = bus
        self._mission = mission
        self._capture: Capture | None = None
        """The last one."""

    async def pull(self, request: NewsRequest) -> News | None:
        """Return what is new; None if the service does not answer."""
        answers = await _ask(self._bus, console_feed_key(self._mission), encode_request(request))
        for payload in answers.values():
            with contextlib.suppress(WireError):  # not a service, or of another version
                news = decode_news(payload, self._capture)
                self._capture = news.capture or (None if news.begins_anew else self._capture)
                return news
        return None

    async def detail(self, vehicle: int, verified: tuple[int, int]) -> VehicleDetail | None:
        """Return the details of a vehicle; None if the service does not answer.

        Raises
        ------
        UnknownVehicleError
            When the mission has no such vehicle.
        """
        key = console_vehicle_key(self._mission, vehicle)
        for payload in (await _ask(self._bus, key, encode_request(DetailRequest(verified)))).values():
            with contextlib.suppress(WireError):
                found = decode_detail(payload)
                if found is None:
                    raise UnknownVehicleError
                return found
        return None

    def submit(self, payload: bytes) -> None:
        """Send an order.

        Raises
        ------
        LinkError
            When no service is there.
        """
        key = order_key(self._mission)
        if not self._bus.is_subscribed(key):
            raise LinkError(self._bus.endpoint, "the service is gone")
        self._bus.publish(key, payload)


async def find_run(
    bus: ZenohSession, mission: str | None, within_s: float, mission_file: str | None = None
) -> Source:
    """Return the run of the service that answers, of one mission or of any.

    Parameters
    ----------
    within_s : float
        Time in which it answers.
    mission_file : str, optional
        Its mission file, if `gcs preflight` can check its vehicles from here.

    Raises
    ------
    LinkError
        When several services answer.
    NoAnswerError
        When none answers.
    """
    until_s = time.monotonic() + within_s
    while True:
        answers = await _ask(bus, console_feed_key(mission or "*"), encode_request(NewsRequest()))
        names = sorted(mission_of(key) for key in answers)
        if len(names) > 1:
            raise LinkError(
                bus.endpoint, f"several services answer here ({', '.join(names)}): choose by --mission"
            )
        for payload in answers.values():
            with contextlib.suppress(WireError):
                info = decode_news(payload, None).mission
                if info is not None:
                    run = RemoteRun(bus, names[0])
                    return Source(info, run.pull, run.detail, run.submit, mission_file=mission_file)
        if time.monotonic() > until_s:
            what = "no service" if mission is None else f"no service of the mission {mission}"
            raise NoAnswerError(bus.endpoint, f"{what} answers here: is it running, and of this version?")
        await asyncio.sleep(_RETRY_S)


async def _ask(bus: ZenohSession, key: str, payload: bytes) -> dict[str, bytes]:
    """Return the answers by their keys; none if no service answers in time."""
    loop = asyncio.get_running_loop()
    answers = dict[str, bytes]()
    ended = asyncio.Event()

    def answered(key: str, payload: bytes) -> None:
        answers[key] = payload

    try:
        bus.ask(key, payload, _ANSWER_S, answered, lambda: on_loop(loop, ended.set))
    except LinkError:  # the session is closed: the console ends
        return {}
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(ended.wait(), 2.0 * _ANSWER_S)
    return dict(answers)
