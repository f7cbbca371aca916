"""A researcher could not see what differs between two flights at the same mission time."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
from playwright.sync_api import Page, expect
from rich.console import Console
from typer.testing import CliRunner
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gcs.cli import app
from gcs.cli.analyse.compare import linked_replays
from gcs.cli.analyse.playback import ReplayOptions
from gcs.cli.analyse.run_file import RunFile
from gcs.cli.replay_console import replay_source
from gcs.console.server import ConsoleServer
from gcs.console.view.page_records import Figures
from gcs.console.web.console_access import Access
from gcs.io.recording.reader import read_info
from gcs.model import Effect, Event
from gcs.service.replay import Replay, Window

RECORDINGS = Path(__file__).parents[1] / "recordings"
DEATH, RADARS = RunFile(RECORDINGS / "death.mcap"), RunFile(RECORDINGS / "radars.mcap")
OPERATE, VIEW = "operate-0123456789", "view-0123456789abc"


def replays_of(*files: RunFile) -> list[Replay]:
    first, other = (ReplayOptions(file, None, Window(), False, False, False) for file in files)
    return linked_replays((first, other), Console(quiet=True))


@contextmanager
def compared(access: Access, *files: RunFile) -> Iterator[ConsoleServer]:
    """Serve two replays, paused at their starts."""
    started, running = threading.Event(), list[Any]()

    async def play() -> None:
        replays, stop = replays_of(*files), asyncio.Event()
        for replay in replays:
            replay.playback.is_paused = True
        first, other = map(replay_source, replays, files)
        server = ConsoleServer(first, access, None, other)
        running.append((server, partial(asyncio.get_running_loop().call_soon_threadsafe, stop.set)))
        started.set()
        await asyncio.gather(*(replay.run(stop, 1.0) for replay in replays))
        server.close()

    thread = threading.Thread(target=lambda: asyncio.run(play()))
    thread.start()
    assert started.wait(10.0)
    server, end = running[0]
    yield server
    end()
    thread.join(10.0)


@pytest.fixture
def console() -> Iterator[ConsoleServer]:
    with compared(Access(port=0), DEATH, RADARS) as server:
        yield server


def opened(page: Page, url: str) -> None:
    """Open the comparison; wait until both recordings are shown."""
    page.goto(url)
    expect(page.locator('#figures [role="cell"]').nth(2)).to_have_text("0")


def views(page: Page) -> list[list[float]]:
    """Return the place and scale of both maps."""
    found = "comparison.panes.map(({parts: {map: {view}}}) => [view.east, view.north, view.scale])"
    return page.evaluate(found)


@pytest.mark.real_time
def test_one_time_line_moves_both_and_the_shorter_recording_stays_at_its_end(console, page):
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    opened(page, console.url)
    at, frames = page.locator("#replay .at"), [page.frame_locator("iframe").nth(index) for index in (0, 1)]
    titles = page.locator(".pane h2")
    expect(titles.nth(0)).to_have_text(f"A{DEATH.path}")
    expect(at).to_have_text("0:00 / 0:30")

    def elapsed(*shown: str) -> None:
        for frame, text in zip(frames, shown, strict=True):
            expect(frame.locator("#head .item", has_text="elapsed")).to_contain_text(text)

    for _ in range(2):
        page.keyboard.press("ArrowRight")
    expect(at).to_have_text("0:10 / 0:30")
    elapsed("0:10", "0:10")
    expect(titles.nth(1)).to_have_text(f"B{RADARS.path}")
    page.keyboard.press("End")
    elapsed("0:30", "0:15")
    expect(titles.nth(1)).to_have_text(f"B{RADARS.path}ended at 0:15")
    lost = page.locator('#figures [role="row"]', has_text="lost").get_by_role("cell")
    expect(lost).to_have_text(["1", "0", "−1"])
    frames[1].locator("#map canvas").click(position={"x": 300, "y": 200})
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    elapsed("0:05", "0:05")
    expect(titles.nth(1)).to_have_text(f"B{RADARS.path}")
    expect(lost).to_have_text(["0", "0", "0"])

    page.keyboard.press("ArrowRight")
    page.locator("#replay select").select_option("50")
    page.keyboard.press("p")
    expect(titles.nth(1)).to_contain_text("ended at 0:15")
    assert errors == []


@pytest.mark.real_time
def test_maps_are_linked_until_they_are_unlinked(console, page):
    opened(page, console.url)
    first, other = views(page)
    assert first == other
    page.keyboard.press("+")
    assert views(page)[0][2] > first[2]
    box = page.locator("iframe").nth(1).bounding_box()
    page.mouse.move(box["x"] + 300, box["y"] + 250)
    page.mouse.down()
    page.mouse.move(box["x"] + 380, box["y"] + 200, steps=4)
    page.mouse.up()
    moved, other = views(page)
    assert moved[:2] != first[:2]
    assert moved == pytest.approx(other)
    page.get_by_role("button", name="Link maps").click()
    page.keyboard.press("-")
    assert views(page)[1] == other
    assert views(page)[0] != pytest.approx(moved)


@pytest.mark.real_time
def test_the_comparison_has_no_violation_that_axe_finds_and_fits_a_phone(console, page, problems):
    opened(page, console.url)
    page.keyboard.press("End")
    expect(page.locator(".pane h2").nth(1)).to_contain_text("ended")
    assert problems(page) == []
    page.get_by_role("button", name="Theme").first.click()
    theme = page.locator("html").get_attribute("data-theme")
    expect(page.frame_locator("iframe").nth(1).locator("html")).to_have_attribute("data-theme", theme)
    page.set_viewport_size({"width": 400, "height": 850})
    assert problems(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    tops = [page.locator("iframe").nth(index).bounding_box()["y"] for index in (0, 1)]
    assert tops[1] > tops[0]


def test_the_second_recording_is_guarded_as_the_first():
    with compared(Access(port=0, operate_token=OPERATE, view_token=VIEW), DEATH, RADARS) as server:

        def code(path: str, token: str = "", body: object = None, **headers: str) -> int:
            given = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"} | headers
            data = None if body is None else json.dumps(body).encode()
            try:
                request = urllib.request.Request(server.url.rstrip("/") + path, data, given)
                return urllib.request.urlopen(request, timeout=5.0).status
            except urllib.error.HTTPError as error:
                return error.code

        for path in ("/b/", "/b/api/status", "/b/api/marks", "/b/api/charts", "/compare.js"):
            assert code(path) == 401
            assert code(path, VIEW) == 200
        order = {"action": "hold", "vehicles": "all"}
        assert code("/b/api/orders", VIEW, order) == 403
        assert code("/b/api/replay", VIEW, {"paused": True}) == 200
        assert code("/b/api/orders", OPERATE, order) == 422  # a replay takes none
        assert code("/b/api/replay", "wrong", {"paused": True}) == 401
        assert code("/b/api/replay", OPERATE, {"at_s": 5.0}, Origin="https://evil.example") == 403
        assert code("/b/login", OPERATE) == 404
        address = server.url.replace("http", "ws") + "b/feed"
        with pytest.raises(InvalidStatus):
            connect(address, compression=None, proxy=None)
        bearer = {"Authorization": f"Bearer {VIEW}"}
        with connect(address, compression=None, proxy=None, additional_headers=bearer) as feed:
            assert json.loads(feed.recv(timeout=2.0)) == {"type": "role", "role": "view"}


def test_a_flight_is_compared_with_its_replay_under_other_settings(tmp_path):
    text = read_info(DEATH.path).config_text
    config = tmp_path / "other.toml"
    config.write_text(text.replace("accel_psd_m2_s3 = 16.0", "accel_psd_m2_s3 = 0.5"))
    other = RunFile(DEATH.path, str(config))
    with compared(Access(port=0), other, DEATH) as server:

        def figures_at(at_s: float) -> list[Figures]:
            server.runs[0].playback.carry_out(json.dumps({"at_s": at_s}).encode())
            until_s = time.monotonic() + 10.0
            while time.monotonic() < until_s:
                time.sleep(0.05)
                states = [run.playback.state() for run in server.runs]
                found = [run.history.figures(at_s) for run in server.runs]
                is_there = (
                    all(abs(one.at_s - at_s) < 0.2 for one in states) and not server.runs[0].playback.is_moved
                )
                if is_there and all(None not in msgspec.structs.astuple(one) for one in found):
                    return found
            raise AssertionError(found)

        address = server.url.replace("http", "ws")
        with (
            connect(address + "feed", compression=None, proxy=None),
            connect(address + "b/feed", compression=None, proxy=None),
        ):
            late = figures_at(28.0)
            early = figures_at(9.0)
            assert early[0].ospa_agents_m != early[1].ospa_agents_m
            assert figures_at(28.0) == late
        marks = server.runs[0].history.marks()
        assert len(set(marks)) == len(marks) > 1


def test_both_are_played_at_the_same_time_however_fast():
    replays, apart_s = replays_of(DEATH, RADARS), list[float]()

    class Apart:
        """Sink that notes at each event how far the times of the two recordings are apart."""

        def event(self, _event: Event) -> None:
            if not any(one.playback.has_ended for one in replays):
                apart_s.append(abs(replays[0].playback.at_s - replays[1].playback.at_s))

        def effect(self, t_ns: int, effect: Effect) -> None:
            pass

    async def play() -> None:
        stop = asyncio.Event()
        runs = [asyncio.create_task(one.run(stop, math.inf)) for one in replays]
        while not all(one.playback.has_ended for one in replays):
            await asyncio.sleep(0.01)
        stop.set()
        await asyncio.gather(*runs)

    for one in replays:
        one.sinks.append(Apart())
    asyncio.run(play())
    assert len(apart_s) > 100
    assert max(apart_s) < 0.5
    assert [round(one.duration_s) for one in replays] == [30, 15]


@pytest.mark.real_time
def test_the_command_serves_both_until_it_is_interrupted():
    command = [
        sys.executable,
        "-P",
        "-m",
        "gcs",
        "replay",
        DEATH.path,
        "--compare",
        RADARS.path,
        "--from",
        "5",
    ]
    process = subprocess.Popen([*command, "--console", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = next(line for line in process.stdout if line.startswith("console: ")).split()[1]
        with urllib.request.urlopen(url, timeout=5.0) as reply:
            assert b"Comparison" in reply.read()
        for path, vehicles in (("api/status", 4), ("b/api/status", 4)):
            with urllib.request.urlopen(url + path, timeout=5.0) as reply:
                assert len(json.load(reply)["agents"]) == vehicles
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 130
    finally:
        process.kill()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ([DEATH.path, "--compare", "missing.mcap"], "missing.mcap"),
        ([DEATH.path, "--compare", __file__], "test_comparison.py"),
        ([DEATH.path, "--compare", RADARS.path, "--verify"], "leave out --verify, --headless and --json"),
        ([DEATH.path, "--compare", RADARS.path, "--headless"], "leave out --verify, --headless and --json"),
        ([DEATH.path, "--compare", RADARS.path, "--json"], "leave out --verify, --headless and --json"),
        ([DEATH.path, "--compare", RADARS.path, "--console", "off"], "leave out --console off"),
    ],
)
def test_what_cannot_be_compared_is_explained(arguments, problem):
    result = CliRunner().invoke(app, ["replay", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 2
    assert problem in " ".join(result.output.split())
    if "compare" not in problem:
        alone = CliRunner().invoke(app, ["replay", str(arguments[2])], catch_exceptions=False)
        assert len(arguments) > 3 or alone.output == result.output
