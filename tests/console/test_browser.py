"""An operator with a real browser would not see the swarm, or could not act at once."""

from __future__ import annotations

import json
import re
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import GCS
from playwright.sync_api import WebSocketRoute, expect

from gcs.config import read_text


def test_space_holds_after_a_layer_was_chosen_and_escape_closes_the_layers_first(fly, launch, page):
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        first, third = (page.locator(f'tr[data-id="{vehicle}"]') for vehicle in (1, 3))
        for row in (first, third):
            expect(row.locator(".c-armed")).to_have_text("armed")
        trails = page.get_by_label("Trails")
        page.keyboard.press("1")
        page.get_by_role("button", name="Layers").click()
        trails.click()
        page.keyboard.press("Space")
        expect(first.locator(".c-authority")).to_have_text("held")
        expect(trails).not_to_be_checked()
        page.keyboard.press("Escape")
        expect(trails).to_be_hidden()
        expect(first).to_have_attribute("aria-selected", "true")
        page.keyboard.press("l")
        page.keyboard.press("Space")  # with the focus in the list
        expect(page.get_by_label("Terrain: hill")).not_to_be_checked()
        page.keyboard.press("3")
        page.keyboard.press("Space")
        expect(third.locator(".c-authority")).to_have_text("held")


def test_an_operator_watches_holds_and_gets_the_connection_back(fly, launch, page):
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("dialog", lambda dialog: errors.append(dialog.message))
    with fly() as flight:
        vehicles = launch(flight)
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        row = page.locator('tr[data-id="1"]')
        expect(row.locator(".c-armed")).to_have_text("armed")

        hostile = "<img src=x onerror=alert(1)>"
        vehicles.say(2, hostile)
        expect(page.locator("#log .panel").first).to_contain_text(hostile)
        page.get_by_role("tab", name="Warnings").click()
        expect(page.get_by_role("tabpanel", name="Warnings")).to_contain_text(hostile)
        expect(page.locator("#log li.info:visible")).to_have_count(0)
        page.locator('#alarms [data-name="more"]').click()
        alarm = page.locator("#alarm-list li.alarm", has_text=hostile)  # newer alarms may be above it
        expect(alarm).to_have_count(1)
        assert page.locator("img").count() == 0
        with page.expect_popup() as opened:
            alarm.get_by_role("link").click()
        expect(opened.value.locator(":target")).to_contain_text("autopilot-alarm")
        opened.value.close()
        alarm.get_by_role("button").click()
        expect(alarm).to_have_count(0)

        page.locator("#tab-targets").click()
        page.keyboard.press("1")
        expect(row).to_have_attribute("aria-selected", "true")
        expect(page.locator("#detail")).to_contain_text("authority")
        page.keyboard.press("Space")
        expect(row.locator(".c-authority")).to_have_text("held")
        expect(page.locator("#commands .result")).to_have_text("hold: 1 done: LOITER, armed")

        expect(page.locator("#detail dd").first).to_contain_text("held by order")

        expect(page.locator("#targets h2")).to_have_text("Targets: 0, no scan yet")
        page.keyboard.press("a")
        expect(page.locator("dialog")).to_contain_text("Propellers may turn")
        page.keyboard.press("Escape")

        flight.console.close()
        expect(page.locator("#head")).to_contain_text("what you see is old")
        page.keyboard.press("Shift+Space")
        expect(page.locator("#commands .result")).to_contain_text("NOT sent")
        flight.restart_console()
        expect(page.locator("#head")).not_to_contain_text("what you see is old")
        expect(row.locator(".c-authority")).to_have_text("held")
    assert errors == []


@pytest.fixture
def demo(tmp_path: Path):
    """Fly a demo whose plans need approval, and in which no agent is lost; return the console's address."""
    text = read_text("prescribed")[0].replace('retask = "auto"', 'retask = "confirm"')
    text = text.replace("[{ system_id = 2, at_s = 50.0 }]", "[]")
    mission = tmp_path / "mission.toml"
    mission.write_text(text)
    command = [*GCS, "demo", str(mission), "--pack", "4", "--headless", "--out", str(tmp_path / "run")]
    with (tmp_path / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as process:
        try:
            until_s, found = time.monotonic() + 90.0, None
            while found is None and time.monotonic() < until_s:
                time.sleep(0.2)
                found = re.search(r"console: (\S+)", (tmp_path / "log").read_text())
            assert found is not None
            yield found[1]
        finally:
            process.terminate()


@pytest.mark.timeout(300)
def test_every_action_of_the_page_has_its_effect_in_the_vehicles(demo, page):
    result = page.locator("#commands .result")
    page.goto(demo)
    confirm = page.locator("#plan button.main")
    expect(confirm).to_be_visible()
    expect(confirm).to_be_enabled()
    page.locator("#plan input").nth(1).uncheck()
    expect(confirm).to_have_text("Confirm plan 1 for 1, 3, 4")
    page.keyboard.press("c")
    page.keyboard.press("Enter")
    for vehicle, target in ((1, r"T0\.\d"), (2, r"T0\.\d\?"), (3, r"T0\.\d"), (4, r"T0\.\d")):
        cell = page.locator(f'tr[data-id="{vehicle}"] .c-target')
        expect(cell).to_have_text(re.compile(f"^{target}$"))
    expect(confirm).to_have_text(re.compile("for none"))

    page.keyboard.press("x")
    page.keyboard.press("Enter")
    expect(result).to_contain_text("rejected for agent 2")

    row = page.locator('tr[data-id="3"]')
    row.click()
    page.keyboard.press("Space")
    expect(row.locator(".c-mode")).to_have_text("LOITER")
    expect(result).to_contain_text("hold: 3 done")
    page.keyboard.press("r")
    expect(result).to_contain_text("resume: 3 done")
    page.keyboard.press("b")
    page.get_by_role("button", name="Return 3").last.click()
    expect(row.locator(".c-mode")).to_have_text("RTL")
    expect(row.locator(".c-authority")).to_have_text("returning")

    page.keyboard.press("t")
    target = page.locator('#targets tr[aria-selected="true"]')
    page.keyboard.press(".")
    expect(target).to_contain_text("priority 1")
    page.keyboard.press("p")
    expect(target).to_contain_text("priority 1, pinned 3")
    page.keyboard.press("u")
    expect(target).not_to_contain_text("pinned")
    page.get_by_label("Priority").focus()  # as after a choice
    page.keyboard.press("i")
    expect(target).to_contain_text("ignored, priority 1")
    page.keyboard.press("i")
    expect(target).not_to_contain_text("ignored")
    page.keyboard.press("Space")
    expect(row.locator(".c-authority")).to_have_text("held")

    page.keyboard.press("n")
    page.get_by_role("button", name="Draw a circle").click()
    box = page.locator("#map canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30.0, y, steps=3)
    page.mouse.up()
    page.get_by_role("button", name="Close this area").click()
    expect(result).to_contain_text("zone-1 closed")
    page.locator("#tab-targets").click()
    page.get_by_role("button", name="Edit zone-1").click()
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 20.0, steps=3)
    page.mouse.up()
    page.keyboard.press("Enter")
    expect(result).to_contain_text("zone-1 closed")
    page.get_by_role("button", name="Open zone-1").click()
    expect(result).to_contain_text("zone-1 opened")

    page.keyboard.press("Shift+Space")
    for vehicle in (1, 2, 3, 4):
        expect(page.locator(f'tr[data-id="{vehicle}"] .c-authority')).to_have_text("held")

    for action, answer in (
        ("arm", "is armed"),
        ("disarm", "is in the air"),
        ("ready", "has neither landed nor come down"),
    ):
        page.locator(f'[data-action="{action}"]').click()
        page.get_by_role("dialog").locator(".danger").click()
        expect(result).to_contain_text(f"{action}: 3 refused: {answer}")
    given = {"hold", "resume", "return", "arm", "disarm", "ready", "zone", "hold-all"}
    buttons = page.locator("[data-action]").evaluate_all("all => all.map(one => one.dataset.action)")
    assert set(buttons) == given | {"continue"}


def test_the_mission_that_has_ended_is_continued(fly, page):
    """The page is told of an end, the service not: it answers that there is none."""

    def with_end(socket: WebSocketRoute) -> None:
        server = socket.connect_to_server()
        server.on_message(lambda data: socket.send(told(json.loads(data))))

    def told(message: dict[str, Any]) -> bytes:
        if "head" in message:
            message["head"]["ended"] = True
        return json.dumps(message).encode()

    page.route_web_socket("**/feed", with_end)
    with fly() as flight:
        page.goto(flight.url)
        page.get_by_role("button", name="Continue mission").click()
        result = page.locator("#commands .result")
        expect(result).to_have_text("continue: refused: the mission has not ended")
