"""Orders on zenoh, as an operator's program publishes them (``docs/orders.md``).

Unlike the record `Order`, a message may give areas in degrees, and always names its vehicles: a list of
system ids, or ``all``. The receiver adds sender and time. Unknown fields are refused: a misspelt key may
change an order's meaning.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from gcs.errors import WireError
from gcs.geo import LocalFrame, corner_error
from gcs.io.record_json import decode_json
from gcs.model import Action, LimitReference, NoFlyZone, Order, target_of, vertical_limits

_NAME = r"^[A-Za-z0-9_.-]{1,64}$"
_FOR_VEHICLES: Final = frozenset({"hold", "resume", "return", "arm", "disarm", "ready", "pin", "unpin"})
_FOR_PLANS: Final = frozenset({"confirm", "reject"})
_FOR_TARGETS: Final = frozenset({"ignore", "attend", "priority", "pin"})
_MAX_EXTENT_M = 1e6
MAX_ORDER_BYTES: Final = 32 * 1024

_Part = Annotated[int, Meta(ge=0, lt=10**9)]
_Number = Annotated[float, Meta(ge=-1e7, le=1e7)]


class AreaMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A no-fly zone. Positions are (east_m, north_m), or (lat_deg, lon_deg) in the frame ``wgs84``."""

    name: Annotated[str, Meta(pattern=_NAME)]
    frame: Literal["local", "wgs84"] = "local"
    circle: tuple[_Number, _Number, Annotated[float, Meta(gt=0.0, le=1e6)]] | None = None
    """Centre, and radius in metres."""
    polygon: Annotated[list[tuple[_Number, _Number]], Meta(max_length=200)] = []
    height_m: float | None = None
    """From the ground up to this height above it."""
    floor_m: float | None = None
    ceiling_m: float | None = None
    reference: LimitReference | None = None
    """What floor and ceiling are above; without heights a zone reaches from the ground to the sky."""


class OrderMessage(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """An order as an operator's program publishes it."""

    order_id: Annotated[str, Meta(pattern=_NAME)]
    """Unique per order, chosen by the sender: a repeated order is carried out once."""
    action: Action
    vehicles: (
        Annotated[list[Annotated[int, Meta(ge=1, le=0xFFFF)]], Meta(min_length=1, max_length=1000)]
        | Literal["all"]
        | None
    ) = None
    plan_id: Annotated[int, Meta(ge=1, le=2**53)] | None = None
    no_fly_zone: AreaMessage | None = None
    target: Annotated[str, Meta(pattern=r"^T?\d{1,9}\.\d{1,9}$")] | tuple[_Part, _Part] | None = None
    """Target as it is shown, T12.3, or as in records, [12, 3]."""
    priority: Annotated[int, Meta(ge=0, le=9)] | None = None
    origin: Annotated[str, Meta(max_length=200)] = ""


_decoder = msgspec.json.Decoder(OrderMessage)


def encode_order(message: OrderMessage) -> bytes:
    """Return an order as JSON."""
    return msgspec.json.encode(message)


def decode_order(key: str, payload: bytes, t_ns: int, frame: LocalFrame) -> Order:
    """Return the order of a payload, after all checks.

    Raises
    ------
    WireError
        The payload does not have the form of ``docs/orders.md``.
    """
    if len(payload) > MAX_ORDER_BYTES:
        raise WireError(
            key, f"{len(payload)} bytes are more than the {MAX_ORDER_BYTES} that an order may have"
        )
    message = decode_json(key, payload, _decoder)
    action = message.action
    if action in _FOR_VEHICLES and message.vehicles is None:
        raise WireError(key, f'vehicles: say for whom, a list of system ids or "all", to {action}')
    if action in _FOR_PLANS and message.plan_id is None:
        raise WireError(key, f"plan_id: say which plan to {action}")
    if (action == "no-fly-zone") != (message.no_fly_zone is not None):
        raise WireError(key, "no_fly_zone: goes with the action no-fly-zone, and with no other")
    if (action in _FOR_TARGETS) != (message.target is not None):
        raise WireError(key, f"target: goes with {', '.join(sorted(_FOR_TARGETS))}, and with no other")
    if (action == "priority") != (message.priority is not None):
        raise WireError(key, "priority: goes with the action priority, and with no other")
    some = isinstance(message.vehicles, list)
    return Order(
        t_ns=t_ns,
        order_id=message.order_id,
        action=action,
        vehicles=tuple(sorted(set(message.vehicles or ()))) if some else None,  # type: ignore[arg-type]
        plan_id=message.plan_id if action in _FOR_PLANS else None,
        no_fly_zone=_area(key, message.no_fly_zone, frame) if message.no_fly_zone is not None else None,
        origin=message.origin,
        target=target_of(message.target) if isinstance(message.target, str) else message.target,
        priority=message.priority,
    )


def _area(key: str, area: AreaMessage, frame: LocalFrame) -> NoFlyZone:
    if area.circle is not None and area.polygon:
        raise WireError(key, "no_fly_zone: a circle or a polygon, not both")
    if area.polygon and (error := corner_error(area.polygon)):
        raise WireError(key, f"no_fly_zone.polygon: {error}")
    disc_m = None
    if area.circle is not None:
        disc_m = (*_place(key, area, area.circle[0], area.circle[1], frame), area.circle[2])
    try:
        limits = vertical_limits(area.height_m, area.floor_m, area.ceiling_m, area.reference)
    except ValueError as error:
        raise WireError(key, f"no_fly_zone.{error}") from None
    polygon_m = tuple(_place(key, area, a, b, frame) for a, b in area.polygon)
    return NoFlyZone(area.name, disc_m, polygon_m, limits)


def _place(key: str, area: AreaMessage, a: float, b: float, frame: LocalFrame) -> tuple[float, float]:
    if area.frame == "local":
        return a, b
    if not (-90.0 <= a <= 90.0 and -180.0 <= b <= 180.0):
        raise WireError(key, f"no_fly_zone: expected (lat_deg, lon_deg), got ({a}, {b})")
    place = frame.to_local(a, b)
    if not math.hypot(*place) <= _MAX_EXTENT_M:
        raise WireError(
            key, f"no_fly_zone: ({a}, {b}) lies {math.hypot(*place) / 1e3:.0f} km from the mission"
        )
    return place
