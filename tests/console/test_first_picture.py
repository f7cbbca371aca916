"""An operator who opens the console would wait for its first picture."""

from __future__ import annotations

import asyncio
import re
import threading
import time
from dataclasses import replace

from playwright.sync_api import expect

from gcs.console.web.static_files import script


def test_a_browser_needs_two_more_requests_whose_answers_it_keeps(fly):
    with fly() as flight:
        body = flight.request("/")[1].decode()
        loaded = re.findall(r'<(?:script|link rel="stylesheet").*?(?:src|href)="([^"]+)"', body)
        assert len(loaded) == 2
        for path in loaded:
            code, content, headers = flight.request(path)
            assert (code, "immutable" in headers["cache-control"]) == (200, True)
            assert not re.search(rb"^(import|export)\b", content, re.MULTILINE)
        assert flight.request(loaded[0].rpartition("/")[0] + "/web_routes.py")[0] == 404
        assert flight.request("/")[2]["cache-control"] == "no-cache"


def test_modules_keep_their_own_names_in_the_script():
    modules = {
        "main.js": 'import { twice as double, STEP } from "./a.js";\nimport * as b from "./b.js";\n'
        "const own = 1;\nconsole.log(double(STEP) + b.half(own));\n",
        "a.js": "const own = 2;\nexport const STEP = 3;\n"
        "/** @param {number} x */\nexport function twice(x) { return own * x; }\n",
        "b.js": 'import {\n  twice,\n} from "./a.js";\n/** @type {One} */ (own);\nexport class Box {}\n'
        "export const half = (x) => twice(x) / 4;\n",
    }
    text = script(modules).decode()
    assert text.index("// a.js") < text.index("// b.js") < text.index("// main.js")
    assert text.count("// a.js") == 1
    assert 'const { twice: double, STEP } = modules["a.js"];' in text
    assert 'modules["b.js"] = { Box, half };' in text
    assert "@param" not in text
    assert '{\n  twice,\n} = modules["a.js"];\n/** @type {One} */ (own);\n' in text


def test_the_first_picture_is_made_while_the_browser_loads_the_page(fly, launch):
    with fly() as flight:
        launch(flight)
        flight.request("/")
        until_s = time.monotonic() + 10.0
        while b'"vehicles"' not in flight.console.runs[0].board.world.snapshot():
            assert time.monotonic() < until_s
            time.sleep(0.01)


def test_a_console_that_is_opened_again_loads_nothing_but_the_page(fly, page):
    with fly() as flight:
        sizes = "performance.getEntriesByType('resource').map((one) => [one.name, one.transferSize])"
        for _ in range(2):
            page.goto(flight.url)
            expect(page.locator("#vehicles tbody tr")).to_have_count(4)
            loaded = [name for name, size in page.evaluate(sizes) if size and "/api/" not in name]
        assert loaded == []


def test_pages_that_open_at_once_cost_the_service_one_look_at_its_state(fly, monkeypatch):
    with fly() as flight:
        (run,) = flight.console.runs
        pull, may_ask, wants = run._source.pull, threading.Event(), []

        async def held(request):
            wants.append(request.is_urgent)
            await asyncio.to_thread(may_ask.wait)
            return await pull(request)

        monkeypatch.setattr(run, "_source", replace(run._source, pull=held))
        for _ in range(100):
            flight.request("/")
        may_ask.set()
        asked = len(wants)
        while len(wants) < asked + 3:  # those of the page, which is open for two seconds
            time.sleep(0.01)
        assert 1 <= sum(wants) <= 2, "one for the first page, one for those that came while it was answered"
