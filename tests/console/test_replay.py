"""A researcher could not stop at a moment of a recording, or would see no proposed plan."""

from __future__ import annotations

import asyncio
import json
import urllib.error
import urllib.request
from functools import partial
from pathlib import Path

import pytest
from websockets.sync.client import connect

from gcs.config import parse
from gcs.console.engine.captures import capture
from gcs.console.engine.replay_run import local_source
from gcs.console.server import ConsoleServer
from gcs.console.web.console_access import Access
from gcs.io.recording.index import read_end_t_ns
from gcs.io.recording.reader import read, read_info
from gcs.service.replay import Replay, Window

RECORDING = Path(__file__).parents[1] / "recordings" / "death.mcap"


def post(url, path, body, token=""):
    headers = {"content-type": "application/json", "authorization": f"Bearer {token}"}
    request = urllib.request.Request(url + path, json.dumps(body).encode(), headers)
    try:
        with urllib.request.urlopen(request, timeout=5.0) as reply:
            return reply.status, json.load(reply)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def watched(url, until):
    """Return all sections when a condition holds."""
    found = {}
    with connect(url.replace("http", "ws") + "/feed", compression=None, proxy=None) as page:
        while not until(found):
            found |= json.loads(page.recv(timeout=10.0))
    return found


def replay_of(found):
    return found.get("replay") or {"at_s": 0.0, "paused": False, "ended": False}


def first_status(found):
    return found["vehicles"][0]["status"] if "vehicles" in found else None


@pytest.fixture
def play():
    """Play the recording as if its plans needed approval, while a function watches the console."""

    def run(watch, access=None):
        info = read_info(RECORDING)
        config = parse(info.config_text.replace('retask = "auto"', 'retask = "confirm"'), "test")
        replay = Replay(config, info.run.seed, read(RECORDING), Window())
        replay.playback.stays_at_end = True

        async def play_and_watch():
            stop = asyncio.Event()
            source = local_source(replay, partial(capture, replay.engine), playback=replay.playback)
            server = ConsoleServer(source, access or Access())
            playing = asyncio.create_task(replay.run(stop, 1.0))
            try:
                return await asyncio.to_thread(watch, server.url.rstrip("/"))
            finally:
                stop.set()
                await playing
                server.close()

        return asyncio.run(play_and_watch())

    return run


def test_a_replay_can_be_moved_paused_and_made_faster_but_not_commanded(play):
    def watch(url):
        assert post(url, "/api/replay", {"at_s": 8.0})[0] == 200
        found = watched(url, lambda seen: replay_of(seen)["at_s"] >= 8.0)
        assert replay_of(found)["at_s"] < 10.0
        post(url, "/api/replay", {"paused": True})
        watched(url, lambda seen: replay_of(seen)["paused"])
        code, reply = post(url, "/api/replay", {"at_s": 1.0})
        assert (code, "forward only" in reply["error"]) == (422, True)
        assert post(url, "/api/replay", {"speed": -1.0})[0] == 422
        post(url, "/api/replay", {"paused": False, "speed": 100.0})
        watched(url, lambda seen: replay_of(seen)["ended"] and first_status(seen) == "lost")
        code, reply = post(url, "/api/orders", {"action": "hold", "vehicles": "all"})
        assert (code, "replay" in reply["error"]) == (422, True)

    play(watch)


def test_a_token_to_view_moves_a_replay_and_gives_no_order(play):
    view = "view-0123456789abc"

    def watch(url):
        assert post(url, "/api/replay", {"at_s": 3.0, "paused": True}, view) == (200, {})
        assert post(url, "/api/replay", {"at_s": 3.0}, "wrong")[0] == 401
        code, reply = post(url, "/api/orders", {"action": "hold", "vehicles": "all"}, view)
        assert (code, reply["error"]) == (403, "this token may view only")

    play(watch, Access(operate_token="operate-0123456789", view_token=view))


def test_a_proposed_plan_is_shown_with_what_changes(play):
    def watch(url):
        post(url, "/api/replay", {"at_s": 6.0})
        proposal = watched(url, lambda seen: seen.get("proposal"))["proposal"]
        assert "first plan" in proposal["reason"]
        assert [route["vehicle"] for route in proposal["routes"]] == [1, 2, 3, 4]
        assert all(one["length_m"] > 0 and one["arrival_s"] > 0 for one in proposal["figures"])

    play(watch)


def test_the_length_of_a_recording_is_known_before_it_is_played():
    assert read_end_t_ns(RECORDING) == max(record.t_ns for record in read(RECORDING))
