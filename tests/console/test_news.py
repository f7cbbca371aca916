"""A console that asks late, or again, would miss what happened, or would delay the service."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.config import load as load_config
from gcs.console.engine.captures import capture, mission_info
from gcs.console.engine.replay_run import feed_of
from gcs.console.remote.messages import NewsEncoder, decode_news, decode_request, encode_request
from gcs.console.view import feed as feed_module
from gcs.console.view.feed import Feed
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import RunInfo
from gcs.console.view.page_state import World
from gcs.console.view.run_marks import History
from gcs.errors import WireError
from gcs.model import NS_PER_S, NoFlyZone, Notice, NoticeCode, Order, Tick
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load


class Reader:
    """A console: it asks, and shows what it gets."""

    def __init__(self, *, is_watched: bool = False) -> None:
        self.request, self.world = NewsRequest(is_watched=is_watched), None
        self.news: News | None = None

    def take(self, news: News) -> None:
        if self.world is None:
            assert news.mission is not None
            self.world = World(news.mission, History(is_recorded=False))
        self.world.update(news)
        captured = news.capture.number if news.capture is not None else self.request.capture
        self.request = NewsRequest(news.run, news.cursor, captured, self.request.is_watched)
        self.news = news

    @property
    def snapshot(self) -> dict[str, Any]:
        assert self.world is not None
        found: dict[str, Any] = json.loads(self.world.snapshot())
        return found


def feed_with(notices: int) -> Feed:
    config = load_config("prescribed")
    feed = Feed(mission_info(config, RunInfo()), lambda _: pytest.fail("captured"), lambda: ())
    feed.event(Tick(NS_PER_S))
    add(feed, notices)
    return feed


def add(feed: Feed, notices: int) -> None:
    for number in range(notices):
        feed.effect(NS_PER_S, Notice(NS_PER_S + number, NoticeCode.ALL_HEARD))


def test_a_console_over_zenoh_shows_what_one_in_the_process_shows(monkeypatch):
    monkeypatch.setattr(feed_module, "_CAPTURE_S", 0.0)
    zone = NoFlyZone("fire", (700.0, 500.0, 60.0))
    order = Order(START_T_NS + 9 * NS_PER_S, "one", "no-fly-zone", (), no_fly_zone=zone)
    run = VirtualRun(
        load("prescribed"),
        1,
        lambda event: feed.event(event),
        lambda t_ns, effect: feed.effect(t_ns, effect),
        orders=[order],
    )
    displayed = SimpleNamespace(config=run.engine.config, engine=run.engine, sinks=[])
    feed = feed_of(displayed, RunInfo(), lambda t_ns: capture(run.engine, t_ns), None)
    near, far = Reader(is_watched=True), Reader(is_watched=True)
    encoder, payloads = NewsEncoder(), []
    for step in range(1, 61):
        run.run(0.25 * step)
        near.take(feed.pull(near.request))
        payload = encoder.encode(feed.pull(far.request), far.request.capture)
        payloads.append(payload)
        far.take(decode_news(payload, far.world and far.world.capture))
    assert {"log", "trails", "targets_tracks", "routes", "map", "zones", "head"} <= near.snapshot.keys()
    assert near.snapshot["zones"][0]["name"] == "fire"
    for name, shown in near.snapshot.items():
        assert far.snapshot[name] == shown, name
    with_map = [number for number, payload in enumerate(payloads) if b"blocked" in payload]
    assert len(with_map) == 2, "at first, and when the zone was closed"


def test_a_late_console_gets_everything_in_pieces_and_in_order():
    feed, reader, times = feed_with(1700), Reader(), []
    while reader.news is None or reader.news.has_more:
        reader.take(feed.pull(reader.request))
        assert len(reader.news.effects) <= 500
        times += [effect.t_ns for _, effect in reader.news.effects]
        add(feed, 1)
    assert times[:1700] == [NS_PER_S + number for number in range(1700)]


def test_a_console_that_missed_more_than_is_kept_begins_anew():
    feed, reader = feed_with(10), Reader()
    reader.take(feed.pull(reader.request))
    add(feed, 4000)
    assert not feed.pull(reader.request).begins_anew
    add(feed, 4000)
    news = feed.pull(reader.request)
    assert news.begins_anew
    assert news.mission is not None
    reader.take(news)
    assert not feed.pull(reader.request).begins_anew


def test_another_run_begins_anew_whatever_the_console_knows():
    first, second, reader = feed_with(10), feed_with(3), Reader()
    reader.take(first.pull(reader.request))
    news = second.pull(reader.request)
    assert news.begins_anew
    assert len(news.effects) == 3


@given(st.binary(max_size=300))
def test_bytes_of_others_are_refused_as_such(payload: bytes):
    for decode in (decode_request, lambda data: decode_news(data, None)):
        try:
            decode(payload)
        except WireError:
            continue


def test_a_request_is_read_as_it_was_written():
    request = NewsRequest("run", 7, 3, is_watched=True, is_urgent=True)
    assert decode_request(encode_request(request)) == request
    with pytest.raises(WireError):
        decode_request(b"\x81\xa3run\xa1x" + bytes(5000))
