"""Topics of a recording: one for each kind of record.

A new kind of event or effect gets its topic here; its fields are those of its class in `gcs.model`.
"""

from __future__ import annotations

from typing import Final, TypeAlias

from gcs.model import (
    AgentStatus,
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    LaggedPicture,
    LinkNews,
    MissionEnded,
    Notice,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Resumed,
    Scan,
    Send,
    Snapshot,
    SwarmStatus,
    Tick,
    Truth,
    UploadReport,
)

Recordable: TypeAlias = Event | Effect | Truth | Snapshot

TOPICS: Final[dict[type, str]] = {
    Datagram: "/event/datagram",
    Scan: "/event/scan",
    Tick: "/event/tick",
    BadInput: "/event/bad_input",
    LinkNews: "/event/link",
    ClockStep: "/event/clock_step",
    Order: "/event/order",
    Resumed: "/event/resumed",
    Send: "/effect/send",
    Picture: "/effect/picture",
    LaggedPicture: "/effect/lagged_picture",
    Plan: "/effect/plan",
    UploadReport: "/effect/upload",
    Notice: "/effect/notice",
    AgentStatus: "/effect/agent_status",
    MissionEnded: "/effect/ended",
    OrderAnswer: "/effect/answer",
    SwarmStatus: "/effect/status",
    Proposal: "/effect/proposal",
    Truth: "/truth",
    Snapshot: "/snapshot",
}
"""Topic of each record in a recording; pictures have one for each kind, below theirs."""


def topic_of(record: Recordable) -> str:
    """Return the topic of a record in a recording."""
    topic = TOPICS[type(record)]
    return f"{topic}/{record.kind}" if isinstance(record, Picture) else topic
