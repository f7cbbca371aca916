"""`gcs order`: orders to a running service, and how long each waits for its answers.

Exit codes: 0 done for all vehicles; 1 refused, failed or unanswered for at least one, or no service answers;
2 a mistake in the arguments. `gcs status` has the same.
"""

from __future__ import annotations

import json
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NamedTuple, TypeAlias

import typer
from rich.console import Console

from gcs.cli.arguments import (
    YES_HELP,
    JsonOption,
    MissionOption,
    VehicleOption,
    YesOption,
    ZenohOption,
    ZenohTlsOption,
    command_app,
    confirm_or_abort,
    parse_vehicle,
    vehicles_text,
)
from gcs.cli.errors import print_error
from gcs.errors import GcsError
from gcs.io.terminal import console_for

if TYPE_CHECKING:
    from gcs.io.zenoh.order_messages import AreaMessage, OrderMessage
    from gcs.model import Action, OrderAnswer, Proposal

app = command_app("""Give orders to a running service (`gcs run` or `gcs demo`).

    A service on this machine is found without further options. The command waits until each vehicle reports
    that it carries out the order.""")


def _target(name: str) -> str:
    from gcs.model import target_name, target_of

    try:
        return target_name(target_of(name))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


VehiclesArgument = Annotated[
    list[int] | None,
    typer.Argument(
        parser=parse_vehicle, metavar="[ID]...", help="System ids, as --vehicle.", show_default=False
    ),
]
AllOption = Annotated[bool, typer.Option("--all", help="All vehicles of the mission.")]
TimeoutOption = Annotated[float, typer.Option(min=1.0, help="Timeout in seconds.")]
TargetArgument = Annotated[
    str, typer.Argument(help="Name of the target, as shown: T0.1.", metavar="TARGET", callback=_target)
]
PlanArgument = Annotated[int, typer.Argument(min=1, help="Number of the proposed plan.", metavar="PLAN")]


class _Service(NamedTuple):
    """Service of an order, and the output."""

    mission: str | None
    zenoh: str | None
    zenoh_tls: Path | None
    timeout_s: float
    as_json: bool


class _Outcome(NamedTuple):
    """Answers to an order, the error text and the exit code."""

    answers: list[OrderAnswer]
    problem: str
    code: int


VehicleAction: TypeAlias = Literal["hold", "resume", "return", "arm", "disarm", "ready"]

_SUMMARIES: Final[dict[VehicleAction, str]] = {
    "hold": "Loiter here, and take no tasks until resumed.",
    "resume": "Continue the mission where it is still valid, and take tasks again.",
    "return": "Return to launch (RTL), and take no tasks until resumed.",
    "arm": "Arm. Propellers may turn. Asks for confirmation; nothing else in this project arms a vehicle.",
    "disarm": "Disarm. Asks for confirmation; refused for a vehicle that may be in the air.",
    "ready": "Say that a vehicle that landed or came down can fly again. Asks for confirmation.",
}
_QUESTIONS: Final[dict[VehicleAction, str]] = {"ready": "declare ready to fly"}
_CONFIRMED: Final = ("arm", "disarm", "ready")


def _add_vehicle_order(action: VehicleAction, summary: str) -> None:
    is_confirmed = action in _CONFIRMED

    @app.command(action, help=summary)
    def order(
        vehicles: VehiclesArgument = None,
        vehicle: VehicleOption = None,
        all_vehicles: AllOption = False,
        yes: bool = typer.Option(False, "--yes", hidden=not is_confirmed, help=YES_HELP),
        mission: MissionOption = None,
        zenoh: ZenohOption = None,
        zenoh_tls: ZenohTlsOption = None,
        timeout: TimeoutOption = 60.0,
        as_json: JsonOption = False,
    ) -> None:
        named = [*(vehicles or ()), *(vehicle or ())]
        if bool(named) == all_vehicles:
            raise typer.BadParameter(f"name the vehicles, such as: gcs order {action} 2 3 (or --all)")
        if is_confirmed and not yes:
            whom = "all vehicles" if all_vehicles else vehicles_text(named)
            confirm_or_abort(f"{_QUESTIONS.get(action, action)} {whom}")
        _send(action, named or "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json))


for _action, _summary in _SUMMARIES.items():
    _add_vehicle_order(_action, _summary)


@app.command(name="plan")
def show_plan(
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Print the proposed plan: routes, reason, lengths, times, separation, clearance and age."""
    _send("plan", "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json))


@app.command()
def confirm(
    plan: Annotated[
        int | None,
        typer.Argument(
            min=1,
            help="Number of the proposed plan.  [default: print it and confirm what was printed]",
            metavar="[PLAN]",
        ),
    ] = None,
    vehicle: VehicleOption = None,
    yes: YesOption = False,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 330.0,
    as_json: JsonOption = False,
) -> None:
    """Confirm the proposed plan, for all or for some vehicles (`planning.retask = "confirm"`).

    Without a number it prints the plan, asks, and confirms what it printed. Routes start where the vehicles
    are at that time. If the plan has changed since, the order is refused.
    """
    service = _Service(mission, zenoh, zenoh_tls, timeout, as_json)
    printed = None
    if plan is None:
        printed = _print_proposal(service)
        plan = printed.plan_id
        if sys.stdin.isatty() and not yes:
            suffix = f" for {vehicles_text(vehicle)}" if vehicle else ""
            confirm_or_abort(f"confirm plan {plan}{suffix}")
    _send("confirm", vehicle or "all", service, plan_id=plan, printed=printed)


@app.command()
def reject(
    plan: PlanArgument,
    vehicle: VehicleOption = None,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Reject the proposed plan. It is not proposed again until the situation changes."""
    _send("reject", vehicle or "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json), plan_id=plan)


@app.command(name="no-fly-zone")
def no_fly_zone(
    name: Annotated[str, typer.Argument(help="Name of the zone. A zone with this name is replaced.")],
    circle: Annotated[
        str | None, typer.Option(metavar="EAST,NORTH,RADIUS", help="Centre and radius in metres.")
    ] = None,
    polygon: Annotated[
        str | None,
        typer.Option(metavar='"EAST,NORTH EAST,NORTH ..."', help="Corners in metres, three or more."),
    ] = None,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Positions are LATITUDE,LONGITUDE in degrees.")
    ] = False,
    height: Annotated[
        float | None, typer.Option(metavar="METRES", help="From the ground up to this height above it.")
    ] = None,
    floor: Annotated[float | None, typer.Option(metavar="METRES", help="Above --reference.")] = None,
    ceiling: Annotated[float | None, typer.Option(metavar="METRES", help="Above --reference.")] = None,
    reference: Annotated[
        str | None,
        typer.Option(metavar="home|msl|ground", help="What --floor and --ceiling are above."),
    ] = None,
    open_zone: Annotated[bool, typer.Option("--open", help="Remove the zone with this name.")] = False,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Add a no-fly zone, and plan new routes around it at once.

    Without heights it reaches from the ground to the sky.
    Example: `gcs order no-fly-zone fire --circle 900,640,120 --ceiling 300 --reference msl`
    """
    if sum((circle is not None, polygon is not None, open_zone)) != 1:
        raise typer.BadParameter("expected one of --circle, --polygon and --open")
    zone = _zone(name, circle, polygon, "wgs84" if degrees else "local", (height, floor, ceiling, reference))
    _send("no-fly-zone", "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json), no_fly_zone=zone)


_TARGET_SUMMARIES: Final[dict[Literal["ignore", "attend"], str]] = {
    "ignore": "Fly to this target no more: a false track, for example. Vehicles on their way are re-tasked.",
    "attend": "Make an ignored target a target again.",
}


def _add_target_order(action: Literal["ignore", "attend"], summary: str) -> None:
    @app.command(action, help=summary)
    def order(
        target: TargetArgument,
        mission: MissionOption = None,
        zenoh: ZenohOption = None,
        zenoh_tls: ZenohTlsOption = None,
        timeout: TimeoutOption = 60.0,
        as_json: JsonOption = False,
    ) -> None:
        _send(action, "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json), target=target)


for _target_action, _target_summary in _TARGET_SUMMARIES.items():
    _add_target_order(_target_action, _target_summary)


@app.command()
def priority(
    target: TargetArgument,
    value: Annotated[int, typer.Argument(min=0, max=9, help="Higher is served first.", metavar="0-9")],
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Set the priority of a target. With too few vehicles, targets of higher priority get them."""
    _send(
        "priority",
        "all",
        _Service(mission, zenoh, zenoh_tls, timeout, as_json),
        target=target,
        priority=value,
    )


@app.command()
def pin(
    target: TargetArgument,
    vehicles: Annotated[list[int], typer.Argument(parser=parse_vehicle, metavar="ID...", help="System ids.")],
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Have vehicles fly to this target, if it needs an agent and a path leads there.

    Example: `gcs order pin T0.2 3`
    """
    _send("pin", vehicles, _Service(mission, zenoh, zenoh_tls, timeout, as_json), target=target)


@app.command()
def unpin(
    vehicles: VehiclesArgument = None,
    all_vehicles: AllOption = False,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Let pinned vehicles fly to any target again."""
    if bool(vehicles) == all_vehicles:
        raise typer.BadParameter("name the vehicles, such as: gcs order unpin 3 (or --all)")
    _send("unpin", vehicles or "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json))


@app.command(name="continue")
def continue_mission(
    vehicles: VehiclesArgument = None,
    vehicle: VehicleOption = None,
    mission: MissionOption = None,
    zenoh: ZenohOption = None,
    zenoh_tls: ZenohTlsOption = None,
    timeout: TimeoutOption = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Continue a mission that has ended: send agents to targets that need one.

    Agents that have reached their targets are free for others; with ids only these.
    """
    named = [*(vehicles or ()), *(vehicle or ())]
    _send("continue", named or "all", _Service(mission, zenoh, zenoh_tls, timeout, as_json))


def _zone(
    name: str,
    circle: str | None,
    polygon: str | None,
    frame: Literal["local", "wgs84"],
    heights: tuple[float | None, float | None, float | None, str | None],
) -> AreaMessage:
    from msgspec.structs import replace

    from gcs.io.zenoh.order_messages import AreaMessage
    from gcs.model import vertical_limits

    try:
        limits = vertical_limits(*heights)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    zone = AreaMessage(
        name=name,
        frame=frame,
        floor_m=limits.floor_m,
        ceiling_m=limits.ceiling_m,
        reference=None if limits.are_open else limits.reference,
    )
    if circle is not None:
        a, b, radius_m = _numbers(circle, 3, "--circle")
        return replace(zone, circle=(a, b, radius_m))
    corners = [_numbers(corner, 2, "--polygon") for corner in (polygon or "").split()]
    return replace(zone, polygon=[(a, b) for a, b in corners])


def _numbers(text: str, count: int, option: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise typer.BadParameter(f"expected {count} numbers with commas, got {text!r}", param_hint=option)
    return numbers


def _print_proposal(service: _Service) -> Proposal:
    """Print the proposed plan and return it; exit when there is none."""
    outcome = _print_answers(_order("plan", "all"), service)
    proposal = next((one.proposal for one in outcome.answers if one.proposal is not None), None)
    if proposal is not None:
        return proposal
    if service.as_json:
        _print_result("plan", "", outcome)
    raise typer.Exit(outcome.code or 1)


def _send(
    action: Action,
    vehicles: list[int] | Literal["all"],
    service: _Service,
    *,
    printed: Proposal | None = None,
    **more: Any,
) -> None:
    order = _order(action, vehicles, **more)
    outcome = _print_answers(order, service)
    if service.as_json:
        _print_result(action, order.order_id, outcome, printed)
    raise typer.Exit(outcome.code)


def _order(action: Action, vehicles: list[int] | Literal["all"], **more: Any) -> OrderMessage:
    """Return the message of an order; `more` are further fields of `OrderMessage`."""
    from gcs.io.zenoh.order_client import sender_name
    from gcs.io.zenoh.order_messages import OrderMessage

    return OrderMessage(
        order_id=f"{action}-{secrets.token_hex(6)}",
        action=action,
        vehicles=vehicles,
        **more,
        origin=sender_name(),
    )


def _print_answers(order: OrderMessage, service: _Service) -> _Outcome:
    """Send an order and print its answers."""
    answers: list[OrderAnswer] = []
    try:
        _collect(order, service, console_for(stderr=service.as_json), answers)
    except GcsError as error:
        return _Outcome(answers, str(error), print_error(error))
    is_done = all(answer.state in ("accepted", "done") for answer in answers)
    return _Outcome(answers, "", 0 if is_done else 1)


def _print_result(action: str, order_id: str, outcome: _Outcome, printed: Proposal | None = None) -> None:
    """Print the last line of --json: one JSON object."""
    rows = [{"vehicle": a.vehicle, "state": a.state, "detail": a.detail} for a in outcome.answers]
    result: dict[str, object] = {"order_id": order_id, "action": action, "ok": outcome.code == 0}
    result |= {"problem": outcome.problem, "answers": rows}
    shown = next((a.proposal for a in outcome.answers if a.proposal is not None), printed)
    if shown is not None:
        from gcs.io.record_json import encode

        result["proposal"] = json.loads(encode(shown))
    print(json.dumps(result), flush=True)  # noqa: T201  the output of --json


def _collect(order: OrderMessage, service: _Service, console: Console, answers: list[OrderAnswer]) -> None:
    from gcs.io.zenoh.discovery import choose_service
    from gcs.io.zenoh.order_client import send_order
    from gcs.report.operator_lines import answer_notice, proposal_title, route_lines

    timeout_s = service.timeout_s
    address = choose_service(service.mission, service.zenoh, service.zenoh_tls)
    for answer in send_order(address, order, min(timeout_s, 5.0), timeout_s):
        answers.append(answer)
        notice = answer_notice(answer)
        text = notice.line
        level = notice.level
        if answer.proposal is not None:
            text = "\n  ".join([proposal_title(answer.proposal), *route_lines(answer.proposal)])
        style = {"info": "", "warning": "yellow", "alarm": "bold red"}[level]
        console.print(text, style=style, highlight=False, soft_wrap=True, markup=False)
