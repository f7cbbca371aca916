"""A researcher could not go back in a recording, or would see what belongs to another time."""

from __future__ import annotations

import asyncio
import json
import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, get_args

import pytest
from playwright.sync_api import expect
from websockets.sync.client import connect

from gcs.config import parse
from gcs.console.engine.captures import capture
from gcs.console.engine.replay_run import local_source
from gcs.console.server import ConsoleServer
from gcs.console.view.run_marks import MARKED, Mark, mark_of
from gcs.console.web.console_access import Access
from gcs.io.recording.index import read_end_t_ns, read_indexed, snapshot_places
from gcs.io.recording.reader import read, read_info
from gcs.model import NS_PER_S, Event, Snapshot
from gcs.service.replay import Replay, Window
from sim_vehicles.campaign.simulate import fly
from sim_vehicles.world.scenario import load

DURATION_S = 60.0
"""Agent 2 crashes at 50 s."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    fly(load("prescribed"), 1, folder, duration_s=DURATION_S)
    return folder


def replay_of(recording: Path) -> Replay:
    info, places = read_info(recording), snapshot_places(recording)
    only = get_args(Event)

    def records_from(t_ns: int) -> Any:
        before = [place for place in places if place.t_ns < t_ns]
        if before:
            return read(recording, only=only, start=before[-1])
        return read(recording, only=(*only, Snapshot))

    config, start_t_ns = parse(info.config_text, "test"), next(read(recording, only=only)).t_ns
    replay = Replay(config, info.run.seed, read(recording, only=only), Window(), start_t_ns, records_from)
    replay.playback.stays_at_end = True
    replay.playback.duration_s = (read_end_t_ns(recording) - start_t_ns) / NS_PER_S
    return replay


@pytest.fixture
def console(recording) -> Iterator[ConsoleServer]:
    """Play the recording, paused at its start, with a console."""
    started, running = threading.Event(), list[Any]()

    async def play() -> None:
        replay, stop = replay_of(recording), asyncio.Event()
        replay.playback.is_paused = True
        source = local_source(
            replay,
            partial(capture, replay.engine),
            playback=replay.playback,
            on_restart=replay.on_restart,
            recording=recording,
            start_t_ns=replay.start_t_ns,
        )
        server = ConsoleServer(source, Access(port=0))
        running.append((server, partial(asyncio.get_running_loop().call_soon_threadsafe, stop.set)))
        started.set()
        await replay.run(stop, 1.5)
        server.close()

    thread = threading.Thread(target=lambda: asyncio.run(play()))
    thread.start()
    assert started.wait(10.0)
    server, end = running[0]
    yield server
    end()
    thread.join(10.0)


def wait_for(condition: Callable[[], object]) -> None:
    until_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.02)


def marks_of(console: ConsoleServer) -> list[Mark]:
    """Return all marks, which are read after the first picture."""
    history = console.runs[0].history
    wait_for(lambda: history.is_complete)
    return history.marks()


def test_marks_are_those_of_the_whole_recording(recording):
    every = [record.payload for record in read(recording, only=MARKED)]
    assert [record.payload for record in read_indexed(recording, MARKED)] == every
    kinds = {mark.kind for record in read(recording, only=MARKED) if (mark := mark_of(0.0, record.value))}
    assert {"plan", "lost", "alarm"} <= kinds


def test_going_back_shows_the_run_as_it_was(console):
    def go(page, at_s):
        """Go to a time; return the snapshot that the page gets."""
        console.runs[0].playback.carry_out(json.dumps({"at_s": at_s}).encode())
        while True:
            message = json.loads(page.recv(timeout=5.0))
            if (
                message["type"] == "snapshot"
                and "head" in message
                and abs(message["head"]["elapsed_s"] - at_s) < 1.0
            ):
                return message

    with connect(console.url.replace("http", "ws") + "feed", compression=None, proxy=None) as page:
        console.runs[0].playback.carry_out(b'{"at_s": 1.0}')
        assert any(mark.kind == "lost" for mark in marks_of(console))
        late = go(page, 58.0)
        assert [one["status"] for one in late["vehicles"]].count("lost") == 1
        assert any("agent 2: lost" in entry["text"] for entry in late["log"])
        for one in late["vehicles"]:
            assert math.dist(late["trails"][str(one["vehicle"])][-1][:2], one["position_m"]) < 100.0
        early = go(page, 31.0)
        assert {one["status"] for one in early["vehicles"]} == {"active"}
        assert max(entry["t_s"] for entry in early["log"]) <= 31.0
        assert any(entry["text"].startswith("plan: first plan") for entry in early["log"])
        assert all(len(points) < 12 for points in early["trails"].values())
        first = go(page, 2.0)
        assert max(entry["t_s"] for entry in first["log"]) <= 2.0
        assert go(page, 58.0)["vehicles"] == late["vehicles"]


@pytest.mark.real_time
def test_a_recording_is_scrubbed_with_keys_and_pointer(console, page):
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(console.url)
    at = page.locator("#replay .at")
    expect(at).to_have_text("0:00 / 1:00")
    expect(page.get_by_label("Speed")).to_have_value("1.5")
    for key, shown in [
        ("ArrowRight", "0:05"),
        ("Shift+ArrowRight", "0:35"),
        ("ArrowLeft", "0:30"),
        ("End", "1:00"),
        ("Home", "0:00"),
    ]:
        page.keyboard.press(key)
        expect(at).to_have_text(f"{shown} / 1:00")
    marks = page.locator("#replay .marks")
    lost = next(mark.t_s for mark in marks_of(console) if mark.kind == "lost")
    box = marks.bounding_box()
    marks.click(position={"x": 8 + (box["width"] - 16) * lost / 60.05, "y": 6})
    elapsed = page.locator("#head .item", has_text="elapsed")
    expect(elapsed).to_contain_text(re.compile("0:5[23]"))
    page.keyboard.press(".")
    page.get_by_label("Speed").focus()  # as after a choice
    page.keyboard.press("p")
    expect(page.locator("tr.gone")).to_have_count(1)
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    expect(page.locator("tr.gone")).to_have_count(0)

    page.keyboard.press("p")
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("g")
    objects = page.locator("#charts figure", has_text="Number of objects")
    expect(objects.locator(".values")).to_contain_text("agents, true 4.0")
    expect(page.locator("#charts figure", has_text="OSPA").locator("b")).to_have_count(2)
    expect(page.locator("#charts figure", has_text="Battery").locator("b")).to_have_count(4)
    chart, area = objects.locator("> canvas"), page.locator("#map").bounding_box()
    box = chart.bounding_box()
    assert area["x"] + area["width"] <= box["x"]
    chart.click(position={"x": 40 + (box["width"] - 66) * 57 / 60.05, "y": 40})
    expect(elapsed).to_contain_text("0:57")
    expect(objects.locator(".values")).to_contain_text("agents, true 3.0")

    whole = page.get_by_role("button", name="Whole run")
    ends = [{"x": 40 + (box["width"] - 66) * at_s / 60.05, "y": 40} for at_s in (20, 40)]
    chart.drag_to(chart, source_position=ends[0], target_position=ends[1])
    expect(whole).to_be_visible()
    expect(elapsed).to_contain_text("0:57")
    page.locator("#charts figure", has_text="OSPA").locator("> canvas").click(position={"x": 41, "y": 40})
    expect(elapsed).to_contain_text(re.compile("0:2[01]"))
    page.keyboard.press("w")
    expect(whole).to_be_hidden()
    page.keyboard.press("g")
    expect(page.locator("#vehicles")).to_be_visible()
    assert errors == []
