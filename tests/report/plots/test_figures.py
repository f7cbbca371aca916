"""The picture of a run shows what happened, for whatever there is of a run."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Cause,
    Kind,
    Picture,
    Plan,
    Route,
    Scan,
    Sensor,
    Tick,
    Track,
    Truth,
    TruthObject,
    UploadReport,
    read_only,
)
from gcs.report.plots.figures import draw_run
from gcs.report.plots.maps import Ground
from gcs.report.plots.style import TRIGGERS
from gcs.report.run.timeline import gather

T0 = 1_767_225_600 * NS_PER_S
SENSOR = Sensor("radar", 0.98, 5e-6, read_only(np.eye(2) * 10), (0.0, 0.0, 2000.0, 1000.0))


def at(t_s: float) -> int:
    return T0 + round(t_s * NS_PER_S)


def picture(t_s: float, kind: Kind, point: Sequence[float], existence: float) -> Picture:
    track = Track((0, 0), read_only([*point, 0.0, 0.0]), read_only(np.eye(4)), existence, existence > 0.5)
    return Picture(at(t_s), at(t_s), kind, (track,), read_only([0.0, 1.0]))


def a_run(agents: int = 2) -> list[object]:
    """Agents fly east at 100 m/s; the second dies at 6 s; one target stands still."""
    values: list[object] = []
    for second in range(11):
        east = 100.0 * second
        values.append(Tick(at(second)))
        things = [
            TruthObject("agents", n, east, 100.0 * n, n != 2 or second < 6) for n in range(1, agents + 1)
        ]
        values.append(Truth(at(second), (*things, TruthObject("targets", 0, 1500.0, 300.0, True))))
        z_m = read_only([[east + 2.0, 100.0], [1500.0, 303.0], [20.0, 900.0]])
        values.append(Scan(at(second) + 9, at(second), SENSOR, z_m))
        values.append(picture(second, "agents", [east + 1.0, 100.0], 0.9))
        values.append(picture(second, "targets", [1500.0, 300.0], 0.9 if second else 0.1))
    route = Route(1, (0, 0), read_only([[1500.0, 300.0]]), 1500.0)
    stale = Route(2, (0, 1), read_only([[1500.0, 300.0]]), 1500.0)
    values.append(Plan(at(2.5), at(2.0), (route, stale), (), (), "first plan", (1,)))
    values.append(UploadReport(at(3.0), 1, 1, 2, True, "verified", 0.2, 0))
    values.append(AgentStatus(at(7.5), 2, "lost"))
    values.append(AgentStatus(at(10.0), 1, "arrived", (0, 0)))
    return values


def test_the_timeline_equals_the_events() -> None:
    timeline = gather(a_run())
    assert timeline.duration_s == 10.0
    assert timeline.area_m == (0.0, 0.0, 2000.0, 1000.0)
    first, second = timeline.paths["agents"][1], timeline.paths["agents"][2]
    assert (first.is_lost, second.is_lost) == (False, True)
    assert second.points_m[-1].tolist() == [500.0, 200.0]
    assert timeline.statuses == ((2, 7.5, "lost"), (1, 10.0, "arrived"))
    assert [(t_s, report.vehicle, report.ok) for t_s, report in timeline.uploads] == [(3.0, 1, True)]


def test_only_a_new_route_is_drawn_and_it_begins_at_the_agent() -> None:
    ((vehicle, t_s, points),) = gather(a_run()).routes
    assert (vehicle, t_s) == (1, 2.5)
    assert points.tolist() == [[250.0, 100.0], [1500.0, 300.0]]


def test_detections_near_no_track_are_clutter() -> None:
    assert gather(a_run()).clutter_m.tolist() == [[20.0, 900.0]] * 11


def test_doubtful_tracks_are_not_drawn_as_estimates() -> None:
    assert [len(e.points_m) for e in gather(a_run()).estimates["targets"]] == [0] + [1] * 10


def pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return imread(path)


@pytest.mark.parametrize("agents", [2, 15])
def test_a_run_is_drawn_with_its_obstacles(tmp_path: Path, agents: int) -> None:
    plain, full = tmp_path / "plain.png", tmp_path / "full.png"
    draw_run(a_run(agents), plain)
    obstacles_m = np.array([[600.0, 600.0], [640.0, 600.0]])
    draw_run(iter(a_run(agents)), full, Ground(obstacles_m, 40.0), "demo, seed 1")
    image = pixels(full)
    assert image.shape[1] > 1500
    assert image.std() > 0.05
    dark = [(pixels(path)[..., :3].max(axis=-1) < 0.2).sum() for path in (plain, full)]
    assert dark[1] > dark[0] + 500


@pytest.mark.parametrize(
    "leave_out",
    [(), (Truth,), (Scan,), (Picture,), (Truth, Scan, Picture), (Truth, Picture, Scan, Tick), (object,)],
)
def test_a_run_is_drawn_from_whatever_there_is(tmp_path: Path, leave_out: tuple[type, ...]) -> None:
    draw_run([value for value in a_run() if not isinstance(value, leave_out)], tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_command_that_draws_nothing_does_not_wait_for_matplotlib() -> None:
    check = "import sys, gcs.report.plots.figures; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-P", "-c", check], check=True, cwd=Path(__file__).parents[3])


def test_every_trigger_of_plans_has_a_row_of_its_own_colour() -> None:
    assert set(TRIGGERS) == {*get_args(Cause)}
    assert len(set(TRIGGERS.values())) == len(TRIGGERS)
