"""Description of the interface for programs (OpenAPI 3.1), made from the records that it carries."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from gcs.io.zenoh.order_messages import OrderMessage
from gcs.model import OrderAnswer, Proposal, SwarmStatus

_REFERENCE = "#/components/schemas/{name}"


def description() -> dict[str, Any]:
    """Return the OpenAPI document."""
    records = [OrderMessage, OrderAnswer, SwarmStatus, Proposal]
    (order, answer, status, proposal), components = msgspec.json.schema_components(
        records, schema_hook=_array, ref_template=_REFERENCE
    )
    answers = _object(
        order_id={"type": "string"}, complete={"type": "boolean"}, answers={"type": "array", "items": answer}
    )
    plan = _object(routes={"type": "array"}, proposal={"anyOf": [proposal, {"type": "null"}]})
    waits = {"name": "wait_s", "in": "query", "schema": {"type": "number", "maximum": 60}}
    placed = {
        "summary": "Give an order; order_id and origin are filled in",
        "parameters": [waits],
        "requestBody": {"required": True, "content": {"application/json": {"schema": order}}},
        "responses": {
            "200": _response("answers until now", answers),
            "202": _response("passed on, not answered yet", answers),
            "403": {"description": "the token may view only"},
            "422": {"description": "the order has a mistake"},
        },
    }
    name = {"name": "name", "in": "path", "required": True, "schema": {"type": "string"}}
    order_id = {"name": "order_id", "in": "path", "required": True, "schema": {"type": "string"}}
    return {
        "openapi": "3.1.0",
        "info": {"title": "swarm-gcs", "version": "1"},
        "paths": {
            "/api/status": {"get": _get("Agents, targets and sensors", status)},
            "/api/plan": {"get": _get("Routes that are flown, and the plan that waits", plan)},
            "/api/vehicles/{name}": {
                "get": _get("Record of a vehicle, with its onboard mission", {}) | {"parameters": [name]}
            },
            "/api/orders": {"post": placed},
            "/api/orders/{order_id}": {
                "get": _get("Answers to an order", answers) | {"parameters": [order_id]}
            },
            "/api/preflight": {
                "get": _get("Last result of gcs preflight", {}),
                "post": _get("Run gcs preflight beside the service", {}),
            },
            "/metrics": {"get": {"summary": "Prometheus", "responses": {"200": {"description": "text"}}}},
        },
        "components": {
            "schemas": components,
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{}, {"token": []}],
    }


def _array(kind: type) -> dict[str, Any]:
    if kind is np.ndarray or getattr(kind, "__origin__", None) is np.ndarray:
        return {"type": "array"}
    raise NotImplementedError(kind)


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _response(text: str, schema: Any) -> dict[str, Any]:
    return {"description": text, "content": {"application/json": {"schema": schema}}}


def _get(summary: str, schema: Any) -> dict[str, Any]:
    return {"summary": summary, "responses": {"200": _response(summary, schema)}}
