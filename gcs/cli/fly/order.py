"""`gcs order`: an operator's word to a running service.

Exit codes: 0 done for all, 1 refused, failed or unanswered for somebody, 2 a mistake in the arguments.
"""

from __future__ import annotations

import getpass
import json
import os
import secrets
import socket
import sys
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

import typer
from rich.console import Console

from gcs.cli.errors import complain
from gcs.cli.vehicle_names import names, vehicle_named
from gcs.errors import GcsError, LinkError
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.io.zenoh.orders import AreaMessage, OrderMessage
    from gcs.model import OrderAnswer, Proposal

app = typer.Typer(
    help="""Orders to a running service (`gcs run`, `gcs demo`): to vehicles, about plans, about the map.

    It is found by itself when it runs on this machine. The command waits until each vehicle itself shows that
    the order was carried out.""",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


VehicleOption = Annotated[
    list[int] | None,
    typer.Option(
        "--vehicle",
        "-v",
        parser=vehicle_named,
        metavar="ID",
        help="System id of a vehicle, with its network as 2:17 when that is not 0; repeat it for more.",
    ),
]
VehiclesArgument = Annotated[
    list[int] | None,
    typer.Argument(
        parser=vehicle_named, metavar="[ID]...", help="The same as --vehicle, for each.", show_default=False
    ),
]
AllOption = Annotated[bool, typer.Option("--all", help="All vehicles of the mission.")]
MissionOption = Annotated[
    str | None,
    typer.Option(help="Name of the mission that the service flies.  [default: the one that runs here]"),
]
ZenohOption = Annotated[
    str | None,
    typer.Option(help="Where the service is, such as tcp/10.0.0.5:7447.  [default: on this machine]"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="End with one JSON object on its own line.")]
TimeoutOption = Annotated[float, typer.Option(min=1.0, help="Seconds to wait until all is done.")]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask.")]
PlanArgument = Annotated[int, typer.Argument(min=1, help="Number of the plan that is shown.", metavar="PLAN")]


VehicleAction: TypeAlias = Literal["hold", "resume", "return", "arm", "disarm"]

_AT_ONCE: Final[dict[VehicleAction, str]] = {
    "hold": "Loiter where it is, and get no task until it is resumed.",
    "resume": "Go on with its mission where that still makes sense, and be there for tasks again.",
    "return": "Return to launch (RTL), and get no task until it is resumed.",
}
_ASKED: Final[dict[VehicleAction, str]] = {
    "arm": "Arm. Propellers may turn: it asks first. Nothing else in this project arms a vehicle.",
    "disarm": "Disarm; refused for a vehicle that may be in the air.",
}


def _add_at_once(action: VehicleAction, what: str) -> None:
    @app.command(action, help=what)
    def order(
        vehicles: VehiclesArgument = None,
        vehicle: VehicleOption = None,
        everybody: AllOption = False,
        mission: MissionOption = None,
        zenoh: ZenohOption = None,
        timeout: TimeoutOption = 60.0,
        as_json: JsonOption = False,
    ) -> None:
        _to_vehicles(
            action, [*(vehicles or ()), *(vehicle or ())], everybody, mission, zenoh, timeout, as_json
        )


def _add_asked(action: VehicleAction, what: str) -> None:
    @app.command(action, help=what)
    def order(
        vehicles: VehiclesArgument = None,
        vehicle: VehicleOption = None,
        everybody: AllOption = False,
        yes: YesOption = False,
        mission: MissionOption = None,
        zenoh: ZenohOption = None,
        timeout: TimeoutOption = 60.0,
        as_json: JsonOption = False,
    ) -> None:
        _to_vehicles(
            action,
            [*(vehicles or ()), *(vehicle or ())],
            everybody,
            mission,
            zenoh,
            timeout,
            as_json,
            ask=not yes,
        )


for _action, _what in _AT_ONCE.items():
    _add_at_once(_action, _what)
for _action, _what in _ASKED.items():
    _add_asked(_action, _what)


@app.command(name="plan")
def show_plan(
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Print the plan that waits: who flies where and why, lengths, times, separation, clearance, age."""
    _give("plan", "all", mission, zenoh, timeout, as_json)


@app.command()
def confirm(
    plan: Annotated[
        int | None,
        typer.Argument(
            min=1,
            help="Number of the plan that is shown.  [default: the one that is printed]",
            metavar="[PLAN]",
        ),
    ] = None,
    vehicle: VehicleOption = None,
    yes: YesOption = False,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    timeout: TimeoutOption = 330.0,
    as_json: JsonOption = False,
) -> None:
    """Let a plan that waits be flown, whole or for some vehicles (`planning.retask = "confirm"`).

    Without a number it prints the plan and confirms what it printed; at a terminal it asks first.
    Routes begin where the vehicles are by then. A plan that is another one by then is refused.
    """
    printed = None
    if plan is None:
        printed = _printed(mission, zenoh, timeout, as_json)
        plan = printed.plan_id
        if sys.stdin.isatty() and not yes:
            whom = f" for {names(vehicle)}" if vehicle else ""
            typer.confirm(f"confirm plan {plan}{whom}?", abort=True, err=True)
    _give("confirm", vehicle or "all", mission, zenoh, timeout, as_json, plan_id=plan, printed=printed)


@app.command()
def reject(
    plan: PlanArgument,
    vehicle: VehicleOption = None,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Refuse a plan that waits; it is not proposed again before something changes."""
    _give("reject", vehicle or "all", mission, zenoh, timeout, as_json, plan_id=plan)


@app.command(name="keep-out")
def keep_out(
    name: Annotated[str, typer.Argument(help="What the area is called; one of that name is replaced.")],
    circle: Annotated[
        str | None, typer.Option(metavar="EAST,NORTH,RADIUS", help="Centre and radius in metres.")
    ] = None,
    polygon: Annotated[
        str | None, typer.Option(metavar='"EAST,NORTH EAST,NORTH ..."', help="Three corners or more.")
    ] = None,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Places are LATITUDE,LONGITUDE in degrees.")
    ] = False,
    open_again: Annotated[bool, typer.Option("--open", help="Open the area of this name again.")] = False,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Close an area: routes are planned around it at once.

    Example: `gcs order keep-out fire --circle 900,640,120`
    """
    if sum((circle is not None, polygon is not None, open_again)) != 1:
        raise typer.BadParameter("expected one of --circle, --polygon and --open")
    area = _area(name, circle, polygon, "wgs84" if degrees else "local")
    _give("keep-out", "all", mission, zenoh, timeout, as_json, keep_out=area)


def _area(
    name: str, circle: str | None, polygon: str | None, frame: Literal["local", "wgs84"]
) -> AreaMessage:
    from gcs.io.zenoh.orders import AreaMessage

    if circle is not None:
        a, b, radius_m = _numbers(circle, 3, "--circle")
        return AreaMessage(name=name, frame=frame, circle=(a, b, radius_m))
    corners = [_numbers(corner, 2, "--polygon") for corner in (polygon or "").split()]
    return AreaMessage(name=name, frame=frame, polygon=[(a, b) for a, b in corners])


def _numbers(text: str, count: int, option: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise typer.BadParameter(f"expected {count} numbers with commas, got {text!r}", param_hint=option)
    return numbers


def _to_vehicles(
    action: VehicleAction,
    vehicles: list[int],
    everybody: bool,
    mission: str | None,
    zenoh: str | None,
    timeout_s: float,
    as_json: bool,
    *,
    ask: bool = False,
) -> None:
    if bool(vehicles) == everybody:
        raise typer.BadParameter(f"say for whom, such as: gcs order {action} 2 3 (or --all)")
    if ask:
        whom = "all vehicles" if everybody else names(vehicles)
        if not sys.stdin.isatty():
            raise typer.BadParameter(f"to {action} {whom} without somebody to ask, say --yes")
        typer.confirm(f"{action} {whom}?", abort=True, err=True)
    _give(action, vehicles or "all", mission, zenoh, timeout_s, as_json)


def _printed(mission: str | None, zenoh: str | None, timeout_s: float, as_json: bool) -> Proposal:
    """Print the plan that waits and return it. Without one the command ends here, with exit code 1."""
    answers, problem = _ask(_order("plan", "all"), mission, zenoh, timeout_s, as_json)
    proposal = next((answer.proposal for answer in answers if answer.proposal is not None), None)
    if proposal is not None:
        return proposal
    if as_json:
        _print_result("plan", "", answers, problem)
    raise typer.Exit(1)


def _give(
    action: VehicleAction | Literal["plan", "confirm", "reject", "keep-out"],
    vehicles: list[int] | Literal["all"],
    mission: str | None,
    zenoh: str | None,
    timeout_s: float,
    as_json: bool,
    *,
    plan_id: int | None = None,
    keep_out: AreaMessage | None = None,
    printed: Proposal | None = None,
) -> None:
    order = _order(action, vehicles, plan_id, keep_out)
    answers, problem = _ask(order, mission, zenoh, timeout_s, as_json)
    ok = _is_ok(answers, problem)
    if as_json:
        _print_result(action, order.order_id, answers, problem, printed)
    raise typer.Exit(0 if ok else 1)


def _order(
    action: VehicleAction | Literal["plan", "confirm", "reject", "keep-out"],
    vehicles: list[int] | Literal["all"],
    plan_id: int | None = None,
    keep_out: AreaMessage | None = None,
) -> OrderMessage:
    from gcs.io.zenoh.orders import OrderMessage

    return OrderMessage(
        order_id=f"{action}-{secrets.token_hex(6)}",
        action=action,
        vehicles=vehicles,
        plan_id=plan_id,
        keep_out=keep_out,
        origin=f"{_user()}@{socket.gethostname()}, process {os.getpid()}",
    )


def _ask(
    order: OrderMessage, mission: str | None, zenoh: str | None, timeout_s: float, as_json: bool
) -> tuple[list[OrderAnswer], str]:
    """Give an order and print its answers; return them, and what went wrong on the way."""
    answers: list[OrderAnswer] = []
    try:
        _collect(order, mission, zenoh, timeout_s, console_for(stderr=as_json), answers)
    except GcsError as error:
        complain(error)
        return answers, str(error)
    return answers, ""


def _is_ok(answers: list[OrderAnswer], problem: str) -> bool:
    return not problem and all(answer.state in ("accepted", "done") for answer in answers)


def _print_result(
    action: str, order_id: str, answers: list[OrderAnswer], problem: str, printed: Proposal | None = None
) -> None:
    """Print the promised last line: one JSON object."""
    rows = [{"vehicle": a.vehicle, "state": a.state, "detail": a.detail} for a in answers]
    result: dict[str, object] = {"order_id": order_id, "action": action, "ok": _is_ok(answers, problem)}
    result |= {"problem": problem, "answers": rows}
    shown = next((a.proposal for a in answers if a.proposal is not None), printed)
    if shown is not None:
        from gcs.io.zenoh.messages import encode

        result["proposal"] = json.loads(encode(shown))
    print(json.dumps(result), flush=True)  # noqa: T201  the promised last line


def _collect(
    order: OrderMessage,
    mission: str | None,
    zenoh: str | None,
    timeout_s: float,
    console: Console,
    answers: list[OrderAnswer],
) -> None:
    from gcs.cli.lines import answer_line
    from gcs.cli.proposal import proposal_title, route_lines
    from gcs.io.zenoh.discovery import the_service
    from gcs.io.zenoh.order_client import give

    if zenoh is None:
        service = the_service(mission)
        mission, zenoh = service.mission, service.zenoh
    elif mission is None:
        raise LinkError(zenoh, "say with --mission which mission its service flies")
    for answer in give(zenoh, mission, order, min(timeout_s, 5.0), timeout_s):
        answers.append(answer)
        text, level = answer_line(answer)
        if answer.proposal is not None:
            text = "\n  ".join([proposal_title(answer.proposal), *route_lines(answer.proposal)])
        style = {"info": "", "warning": "yellow", "alarm": "bold red"}[level]
        console.print(text, style=style, highlight=False, soft_wrap=True, markup=False)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())
