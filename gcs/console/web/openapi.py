"""Description of what the console serves (OpenAPI 3.1), made from the records that it carries."""

from __future__ import annotations

from typing import Any, Final

import msgspec
import numpy as np

from gcs.console.view.page_records import (
    ChartsReply,
    ErrorReply,
    FeedMessage,
    MarksReply,
    OrderReply,
    PlanReply,
    PreflightReply,
    VehicleDetail,
)
from gcs.console.web.playback_control import PlaybackRequest
from gcs.core.preflight.check_codes import CheckCode
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.model import NoticeCode, SwarmStatus

_REFERENCE: Final = "#/components/schemas/{name}"
_RECORDS: Final = (
    OrderMessage,
    PlaybackRequest,
    SwarmStatus,
    PlanReply,
    VehicleDetail,
    OrderReply,
    PreflightReply,
    MarksReply,
    ChartsReply,
    FeedMessage,
    ErrorReply,
)


def description() -> dict[str, Any]:
    """Return the OpenAPI document."""
    schemas, components = msgspec.json.schema_components(
        _RECORDS, schema_hook=_points, ref_template=_REFERENCE
    )
    for record, codes in (
        ("LogEntry", ["", *NoticeCode]),
        ("Mark", ["", *NoticeCode]),
        ("CheckRow", [*CheckCode]),
    ):
        components[record]["properties"]["code"]["enum"] = codes
    order, playback, status, plan, vehicle, answers, preflight, marks, charts, feed, error = schemas
    waits = {"name": "wait_s", "in": "query", "schema": {"type": "number", "maximum": 60}}
    after = {"name": "after", "in": "query", "schema": {"type": "integer", "minimum": 0}}
    placed = {
        "summary": "Give an order; order_id and origin are filled in",
        "parameters": [waits],
        "requestBody": _body(order),
        "responses": {
            "200": _response("answers until now", answers),
            "202": _response("passed on, not answered yet", answers),
            "403": {"description": "the token may view only"},
            "422": _response("the order has a mistake", error),
        },
    }
    moved = {
        "summary": "Play, pause or move a replay; a token to view is enough",
        "requestBody": _body(playback),
        "responses": {
            "200": {"description": "done"},
            "422": _response("the run is live, or the request has a mistake", error),
        },
    }
    token = {"type": "object", "properties": {"token": {"type": "string"}}}
    logged_in = {
        "summary": "Keep a token in a cookie",
        "requestBody": _body(token),
        "responses": {"200": {"description": "done"}, "401": _response("the token is not known", error)},
    }
    updates = {
        "summary": "WebSocket: the role, a snapshot of all sections, then updates, as JSON",
        "responses": {"101": _response("WebSocket", feed)},
    }
    return {
        "openapi": "3.1.0",
        "info": {"title": "swarm-gcs", "version": "1"},
        "paths": {
            "/api/status": {"get": _get("Agents, targets and sensors", status)},
            "/api/plan": {"get": _get("Routes that are flown, and the plan that waits", plan)},
            "/api/vehicles/{name}": {
                "get": _get("Record of a vehicle, with its onboard mission", vehicle) | _in_path("name")
            },
            "/api/orders": {"post": placed},
            "/api/orders/{order_id}": {"get": _get("Answers to an order", answers) | _in_path("order_id")},
            "/api/preflight": {
                "get": _get("Last result of gcs preflight", preflight),
                "post": _get("Run gcs preflight beside the service", preflight),
            },
            "/api/replay": {"post": moved},
            "/api/marks": {
                "get": _get("Losses, arrivals, plans, failed uploads, alarms and orders of the run", marks)
                | {"parameters": [after]}
            },
            "/api/charts": {"get": _get("Series of the charts, in bins of equal width from 0 s", charts)},
            "/api/openapi.json": {"get": _get("This description", {})},
            "/feed": {"get": updates},
            "/tiles/{zoom}/{column}/{row}": {
                "get": _read("Map tile, rows from the north", "image; 204: none there")
                | _in_path("zoom", "column", "row", kind="integer")
            },
            "/metrics": {"get": _read("Prometheus", "text")},
            "/": {"get": _read("The console", "page")},
            "/login": {"get": _read("Form that asks for a token", "page"), "post": logged_in},
            "/alarms": {"get": _read("What alarms mean and what to do", "page")},
        },
        "components": {
            "schemas": components,
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{}, {"token": []}],
    }


def _points(kind: type) -> dict[str, Any]:
    """Return the schema of an array: in the records of the console, these are points."""
    if kind is np.ndarray or getattr(kind, "__origin__", None) is np.ndarray:
        pair = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
        return {"type": "array", "items": pair}
    raise NotImplementedError(kind)


def _body(schema: Any) -> dict[str, Any]:
    return {"required": True, "content": {"application/json": {"schema": schema}}}


def _in_path(*names: str, kind: str = "string") -> dict[str, Any]:
    return {
        "parameters": [
            {"name": name, "in": "path", "required": True, "schema": {"type": kind}} for name in names
        ]
    }


def _read(summary: str, content: str) -> dict[str, Any]:
    return {"summary": summary, "responses": {"200": {"description": content}}}


def _response(text: str, schema: Any) -> dict[str, Any]:
    return {"description": text, "content": {"application/json": {"schema": schema}}}


def _get(summary: str, schema: Any) -> dict[str, Any]:
    return {"summary": summary, "responses": {"200": _response(summary, schema)}}
