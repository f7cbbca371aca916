"""`gcs fence`: upload, show or clear the fence and the rally points of vehicles.

Exit codes: 0 done for all vehicles; 1 failed for at least one; 2 a mistake in the arguments or the mission
file.
"""

from __future__ import annotations

from typing import Literal

from gcs.cli.arguments import (
    ConfigArgument,
    JsonOption,
    LinkOption,
    VehicleOption,
    WaitOption,
    YesOption,
    command_app,
)
from gcs.cli.prepare.vehicle_tasks import exit_with_results, run_tasks

app = command_app("""Upload, show or clear the fence and the rally points of vehicles.

    Nothing else in this project uploads a fence. An upload counts when the download from the vehicle is
    equal. The vehicle's parameters decide whether it obeys its fence: `gcs preflight` shows them.

    Without `--vehicle` a command is for all vehicles of the mission.""")


def _add_change(action: Literal["upload", "clear"], summary: str) -> None:
    @app.command(action, help=summary)
    def change(
        config: ConfigArgument,
        vehicle: VehicleOption = None,
        wait: WaitOption = 60.0,
        link: LinkOption = None,
        yes: YesOption = False,
        as_json: JsonOption = False,
    ) -> None:
        _run(action, config, vehicle, wait, link, yes, as_json)


_add_change(
    "upload", "Upload the fence and the rally points of the mission file, in place of those on the vehicles."
)


@app.command()
def show(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the fence and the rally points on the vehicles."""
    _run("show", config, vehicle, wait, link, True, as_json)


_add_change("clear", "Remove the fence and the rally points from the vehicles.")


def _run(
    action: Literal["upload", "show", "clear"],
    source: str,
    vehicles: list[int] | None,
    wait_s: float,
    link: str | None,
    yes: bool,
    as_json: bool,
) -> None:
    from gcs.io.vehicles.geofence import fence_vehicles

    tasks = run_tasks(
        source,
        vehicles,
        link,
        lambda config, selected: fence_vehicles(config, source, action, selected, wait_s, link),
        writes=action != "show",
        question="" if yes else f"{action} fence and rally points of",
        as_json=as_json,
    )
    rows = [{"vehicle": task.vehicle, "ok": task.ok, "steps": task.rows()} for task in tasks]
    exit_with_results(
        action,
        tasks,
        ["step"],
        lambda task: (((step,), ok, detail) for step, ok, detail in task.rows()),
        {"vehicles": rows},
        as_json=as_json,
    )
