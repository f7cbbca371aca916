"""Kill -9 of command at random moments: how long it takes until its standby commands, by stage.

``python tests/bench/bench_take_over.py [--kills 100] [--speed 1] [--seed 1] [--json FILE]`` flies
`deterministic` with a command and a standby that are supervised: each kill makes the standby command, and the
killed node its standby. Times in seconds from the kill until the new node has the lease of the bridge, until
its first datagram to a vehicle that is no heartbeat, until all missions are read back, and until the killed
node follows as standby. ``--sitl arduplane=PATH`` (or ``px4=PATH``) does it above real firmware. Below the
table: vehicles that were sent a mission again that they had taken, or told to fly one that was not read back.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from helpers.chaos_checks import repeated_missions, unverified_missions
from helpers.heartbeat_tap import HeartbeatTap
from helpers.processes import Run, bridges, free_port, node_of
from rich.console import Console
from rich.table import Table

from gcs.io.recording.reader import read
from gcs.model import NS_PER_S, Notice, NoticeCode, Resumed

FLIGHT_S = 80.0
"""In flight time: then missions end."""
_START_S = 120.0
_POLL_S = 0.005
STAGES = ("lease", "first datagram", "missions read back", "next standby", "longest gap of heartbeats")


def fly(
    folder: Path, kills: int, speed: float, rng: np.random.Generator, sitl: str
) -> tuple[list[dict[str, float]], list[str]]:
    """Kill command as often as a flight allows; return the times of each kill, and what was wrong."""
    relay = free_port()
    tap = HeartbeatTap(relay, free_port())
    run = Run(folder, speed, relay, sitl=sitl, port=tap.service)
    assert run.world.stdout is not None
    threading.Thread(target=lambda: [None for _ in run.world.stdout], daemon=True).start()
    text = run.file.read_text().replace("[links]", f'[links]\nstandby = "{run.standby}"', 1)
    run.file.write_text(text)
    runtime = {"XDG_RUNTIME_DIR": str(folder)}
    found = []
    try:
        nodes = {"one": run.serve("one", runtime)}
        run.until("one", lambda said: said.count("verified by read-back") >= 4, _START_S)
        begin_s = time.monotonic()
        nodes["two"] = run.serve("two", runtime, ("--role", "standby"))
        run.until("two", lambda said: "follows it" in said, _START_S)
        commands, follows = "one", "two"
        while len(found) < kills and (time.monotonic() - begin_s) * speed < FLIGHT_S:
            time.sleep(float(rng.uniform(0.5, 1.5)))
            before = run.printed(follows).count("takes over")
            again = run.printed(commands).count("follows it")
            node = node_of(nodes[commands])
            unix_s = time.time()
            killed_s = time.monotonic()
            node.kill()
            while run.printed(follows).count("takes over") == before:
                assert time.monotonic() < killed_s + 30.0, run.printed(follows)[-500:]
                time.sleep(_POLL_S)
            one = {"unix_s": unix_s, "lease": time.monotonic() - killed_s}
            one["load"] = os.getloadavg()[0]
            run.until(commands, lambda said: said.count("follows it") > again, _START_S)  # noqa: B023
            one["next standby"] = time.monotonic() - killed_s
            sent_s = [sent.unix_s for sent in list(tap.sent) if not sent.is_up and sent.unix_s > unix_s + 0.2]
            one["first datagram"] = min(sent_s, default=np.nan) - unix_s
            one["longest gap of heartbeats"] = max(tap.gaps_s(killed_s, time.monotonic()))
            found.append(one)
            commands, follows = follows, commands
    finally:
        run.end()
        tap.end()
        for bridge in bridges(folder):
            bridge.kill()
    epoch_ns = int(run.clock[1].partition(",")[0]) if run.clock else 0
    note_read_back(folder, found, epoch_ns, speed)
    sent = sorted(tap.sent)
    return found, [*repeated_missions(sent), *unverified_missions(sent)]


def note_read_back(folder: Path, found: list[dict[str, float]], epoch_ns: int, speed: float) -> None:
    """Add the time at which all missions were read back after each kill, from the recordings."""
    verified_s = []
    for recording in folder.iterdir():
        if not (recording / "run.mcap").exists():
            continue
        times = []
        resumed = False
        with suppress(Exception):
            for record in read(recording, only={Notice, Resumed}):
                resumed = resumed or isinstance(record.value, Resumed)
                if isinstance(record.value, Notice) and record.value.code is NoticeCode.ONBOARD_VERIFIED:
                    times.append((epoch_ns + (record.t_ns - epoch_ns) / speed) / NS_PER_S)
        if resumed and len(times) >= 4:
            verified_s.append(times[3])
    for one in found:
        later = [at_s - one["unix_s"] for at_s in verified_s if at_s > one["unix_s"]]
        one["missions read back"] = min(later, default=np.nan)


def table_of(found: list[dict[str, float]]) -> Table:
    """Return the quantiles of each stage."""
    loads = [one["load"] for one in found]
    title = f"{len(found)} kills, load average {min(loads):.1f} to {max(loads):.1f}"
    table = Table("from the kill, s", "median", "99 %", "most", title=title)
    for stage in STAGES:
        values = np.array([one[stage] for one in found])
        table.add_row(stage, *(f"{np.nanquantile(values, q):.2f}" for q in (0.5, 0.99, 1.0)))
    return table


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sitl", default="", help="arduplane=PATH or px4=PATH; default simulated vehicles")
    parser.add_argument("--json", type=Path, help="file to which each kill is added as a line")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    found = []
    wrong = []
    while len(found) < options.kills:
        with tempfile.TemporaryDirectory(prefix="take-over-") as folder:
            new, problems = fly(Path(folder), options.kills - len(found), options.speed, rng, options.sitl)
        found += new
        wrong += problems
        if options.json is not None:
            with options.json.open("a") as file:
                file.writelines(json.dumps(one) + "\n" for one in new)
    Console(width=100).print(table_of(found))
    print("\n".join(wrong) or "each mission was sent once, and read back before it was flown")


if __name__ == "__main__":
    main()
