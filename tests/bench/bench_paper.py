"""Draw the paper's figures 3 to 9 and check its claims.

    python tests/bench/bench_paper.py [-o FOLDER]

`sim_vehicles` flies the paper's four missions on virtual time with fixed seeds. Figures and claims come from
the recordings.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec
from paper_claims import (
    FIGURE_3,
    FIGURES_4_5,
    FIGURES_6_7,
    FIGURES_8_9,
    Claim,
    Runs,
    claims,
    markdown,
)
from paper_measures import Flown
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from gcs.cli.analyse.report_material import read_material
from gcs.cli.analyse.run_file import RunFile
from gcs.cli.fly.simulate import sim_vehicles_command
from gcs.config import load, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.errors import SimulationError
from gcs.report.html_page import Page, Picture, Section, save_figure, save_page
from gcs.report.plots.maps import Ground, tracker_figure, truth_figure
from gcs.report.run.evaluation import Summary
from gcs.report.run.tables import Table

SEEDS: Final = {FIGURE_3: 1, FIGURES_4_5: 1, FIGURES_6_7: 4, FIGURES_8_9: 4}
"""With random losses: the first seed with one loss, as in the paper's figures."""
SWARM: Final = "swarm-50"
_FASTER: Final = "prescribed-1hz"
_PERIOD: Final = re.compile(r"(\[planning\]\n(?:(?!\[).*\n)*?period_s = )[0-9.]+")
_TITLES: Final = {
    FIGURE_3: "Figure 3: everything known, dense obstacles",
    FIGURES_4_5: "Figures 4 and 5: hand-placed obstacles, prescribed targets",
    FIGURES_6_7: "Figures 6 and 7: random obstacles",
    FIGURES_8_9: "Figures 8 and 9: random obstacles, targets at random",
}
_NUMBERS: Final = {FIGURES_4_5: (4, 5), FIGURES_6_7: (6, 7), FIGURES_8_9: (8, 9)}


def run_paper(out: Path, console: Console) -> tuple[Claim, ...]:
    """Fly the missions, draw the figures, check the claims and return them.

    Raises
    ------
    GcsError
        When a run fails or something cannot be written.
    """
    (out / "recordings").mkdir(parents=True, exist_ok=True)
    runs, sections = _fly_missions(out, console)
    found = claims(runs)
    page = Page(
        title="The paper, claim by claim",
        subtitle="Hill, Thomas & Larson, Autonomous Situational Awareness for Robotic Swarms in High-Risk "
        "Environments: its missions, flown again",
        lead="Each mission is one run with a fixed seed. All numbers were computed from these runs when this "
        "page was made.",
        sections=(Section("Claims", "", (), (_table(found),)), *sections),
        footer="Made by tests/bench/bench_paper.py. The recordings are next to it: gcs report, "
        "gcs replay --verify and gcs info read them.",
    )
    save_page(page, out / "index.html")
    (out / "claims.md").write_text(markdown(found), encoding="utf-8")
    console.print(str(out / "index.html"), highlight=False, markup=False, soft_wrap=True)
    for claim in found:
        console.print(f"  {claim.verdict:17} {claim.where}: {claim.says}", highlight=False, soft_wrap=True)
    return found


def _fly_missions(out: Path, console: Console) -> tuple[Runs, list[Section]]:
    flown: dict[str, Flown] = {}
    sections: list[Section] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=len(SEEDS) + 2)
        for name, seed in SEEDS.items():
            progress.update(task, description=name)
            flown[name] = _fly(name, seed, out / "recordings" / name)
            sections.append(Section(_TITLES[name], _text(flown[name]), _figures(name, flown[name], out)))
            progress.advance(task)
        progress.update(task, description=_FASTER)
        text, _ = read_text(FIGURES_4_5)
        mission = out / "recordings" / f"{_FASTER}.toml"
        mission.write_text(_PERIOD.sub(r"\g<1>1.0", text, count=1), encoding="utf-8")
        faster = _fly(str(mission), SEEDS[FIGURES_4_5], out / "recordings" / _FASTER)
        progress.advance(task)
        progress.update(task, description=SWARM)
        swarm = _simulated(SWARM, 1, None)
        progress.advance(task)
    return Runs(flown, faster, swarm), sections


def _fly(scenario: str, seed: int, folder: Path) -> Flown:
    """Fly a mission and read its recording back."""
    for old in folder.glob("*"):  # Of an earlier page.
        old.unlink()
    simulated = _simulated(scenario, seed, folder)
    material = read_material(RunFile(folder), None, Console(quiet=True), timing=False)
    assert material.summary is not None
    summary = replace(material.summary, scan_ms_p99=simulated.scan_ms_p99, plan_ms_p99=simulated.plan_ms_p99)
    return Flown(material.timeline, summary, mission_grid(load(scenario), seed))


def _simulated(scenario: str, seed: int, folder: Path | None) -> Summary:
    """Fly a mission in its own process; return its summary."""
    options = {"scenario": scenario, "seed": seed, "as_json": True}
    options |= {} if folder is None else {"out": str(folder)}
    command = sim_vehicles_command("simulate", options)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.strip().splitlines()
    if done.returncode not in (0, 1) or not lines:
        raise SimulationError(f"{scenario} could not be flown: {done.stderr.strip()[-500:]}")
    summary: dict[str, Any] = json.loads(lines[-1])
    not_printed = {"retask_list": (), "loss_delays_s": (), "losses": 0, "false_losses": 0}
    return msgspec.convert({**summary, **not_printed}, Summary)


def _figures(name: str, flown: Flown, out: Path) -> tuple[Picture, ...]:
    timeline, grid = flown.timeline, flown.grid
    ground = Ground.of(grid)
    if name == FIGURE_3:
        figure = truth_figure(timeline, ground, {}, estimates=False)
        return (save_figure(figure, out, "fig3", "Four agents and four targets in dense obstacles."),)
    truth, output = _NUMBERS[name]
    return (
        save_figure(
            truth_figure(timeline, ground, {}, estimates=False), out, f"fig{truth}",
            f"Figure {truth}: ground truth in the middle and at the end of the mission.",
        ),
        save_figure(
            tracker_figure(timeline, ground), out, f"fig{output}",
            f"Figure {output}: output of both GLMB filters, and the clutter in grey.",
        ),
    )  # fmt: skip


def _text(flown: Flown) -> str:
    summary = flown.summary
    return f"{summary.scenario}, seed {summary.seed}: {summary.reason}, after {summary.duration_s:.0f} s."


def _table(found: tuple[Claim, ...]) -> Table:
    columns = ("in the paper", "it says", "seen here", "rule", "verdict")
    rows = tuple((c.where, c.says, c.seen, c.rule, c.verdict) for c in found)
    return Table("What the paper says, and what is seen here", columns, rows, frozenset(columns))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=Path("paper-report"), help="folder of the page")
    run_paper(parser.parse_args().out, Console())


if __name__ == "__main__":
    main()
