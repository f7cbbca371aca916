"""An operator would not see in time which agent needs attention."""

import io

from msgspec.structs import replace
from rich.console import Console

from gcs.cli.status_tables import status_tables
from gcs.model import AgentRecord, SensorRecord, SwarmStatus, TargetRecord

CALM = AgentRecord(
    vehicle=1,
    status="active",
    authority="ours",
    reason="",
    heard_age_s=0.1,
    loss=0.012,
    mode="AUTO",
    armed=True,
    battery_percent=88,
    fix_type=3,
    position_m=(100.0, 200.0),
    alt_rel_m=90.2,
    ground_speed_m_s=15.1,
    is_position_doubted=False,
    track=(0, 0),
    existence=0.99,
    layer=0,
    target=(3, 1),
    to_go_m=640.0,
    eta_s=42.4,
    upload="",
    has_failed=False,
    is_verified=True,
    phase="landing",
)
TARGET = TargetRecord((3, 1), 0.98, (700.0, 300.0), 2.0, agents=(1,), reached_by=(4,))


def printed(*agents: AgentRecord, plan_id: int | None = None) -> list[str]:
    status = SwarmStatus(0, "x", agents, (TARGET,), (SensorRecord("radar", None, 3),), plan_id, False)
    console = Console(width=170, file=io.StringIO())
    console.print(*status_tables(status, "site"), sep="\n")
    return [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]


def row(lines: list[str], first: str) -> str:
    return next(line for line in lines if line.split()[:1] == [first])


def test_an_agent_is_one_row_with_units_in_the_head() -> None:
    lines = printed(CALM, plan_id=7)
    assert (
        lines[0]
        == "site: agents 1 active, 0 arrived, 0 lost; 1 targets; terrain flat; plan 7 waits: gcs order plan"
    )
    assert row(lines, "1").split() == [
        *(
            "1",
            "active",
            "landing",
            "ours",
            "AUTO",
            "armed",
            "90",
            "-",
            "15.1",
            "88",
            "%",
            "3D",
            "0.1",
            "s",
            "1.2",
            "%",
        ),
        *("T3.1", "640", "42", "verified"),
    ]
    assert row(lines, "T3.1").split() == ["T3.1", "0.98", "700", "300", "2.0", "1", "4"]
    assert row(lines, "radar").split() == ["radar", "never", "3"]


def test_agents_that_need_attention_come_first() -> None:
    agents = [
        CALM,
        replace(CALM, vehicle=2, status="arrived"),
        replace(CALM, vehicle=3, heard_age_s=4.0, is_late=True),
        replace(CALM, vehicle=4, authority="overridden", reason="is in FBWA and left alone"),
        replace(CALM, vehicle=5, status="lost", track=None),
        replace(CALM, vehicle=6, is_position_doubted=True),
    ]
    lines = printed(*agents)
    first = [line.split()[0] for line in lines if line.strip()[:1].isdigit()]
    assert first == ["6", "5", "4", "3", "1", "2"]
    assert "is in FBWA and left alone" in row(lines, "4")
    assert "position doubted" in row(lines, "6")


def test_a_proposed_target_is_marked() -> None:
    lines = printed(replace(CALM, target=None, proposed_target=(3, 1), heard_age_s=None, upload="waiting"))
    assert "T3.1?" in row(lines, "1")
    assert "never" in row(lines, "1")
    assert "upload: waiting" in row(lines, "1")


def test_what_was_ordered_about_targets_is_shown() -> None:
    pinned = replace(CALM, pinned=(3, 2))
    targets = (
        replace(TARGET, is_ignored=True),
        replace(TARGET, label=(3, 2), priority=5, pinned=(1,)),
    )
    status = SwarmStatus(0, "x", (pinned,), targets, (), None, False)
    console = Console(width=170, file=io.StringIO())
    console.print(*status_tables(status, "site"), sep="\n")
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]  # type: ignore[attr-defined]
    assert row(lines, "T3.1").endswith("ignored")
    assert row(lines, "T3.2").endswith("priority 5, pinned 1")
    assert "T3.1 (pin T3.2)" in row(lines, "1")
