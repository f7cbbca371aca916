"""An operator would lose the aircraft to a service that tasks a vehicle under another controller."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import pytest

from gcs.model.authority import DERIVED, SUSPENSIONS, TRANSITIONS, Authority, Claims, Control, ControlEvent

A, E = Authority, ControlEvent
CLAIMS = [authority for authority in Authority if authority is not A.OURS and authority not in DERIVED]
SETS = [frozenset(found) for size in (0, 1, 2, 3) for found in combinations(CLAIMS, size)]
"""All sets of up to three claims, also those that cannot occur together."""
ORDERS = {E.HOLD, E.RETURN, E.RESUME}
each_event = pytest.mark.parametrize("event", ControlEvent)


def after(claims: frozenset[Authority], event: ControlEvent) -> Control:
    recorded = Claims()
    for claim in claims:
        recorded.begin(claim, 1, "x")
    recorded.apply(event, 2, "x")
    return Control(recorded.begun)


def enders(claim: Authority) -> set[ControlEvent]:
    return set(TRANSITIONS[claim][1])


def test_every_claim_is_recorded_or_derived() -> None:
    assert list(TRANSITIONS) == CLAIMS
    assert not TRANSITIONS.keys() & DERIVED.keys()
    assert len({begins for begins, _ in TRANSITIONS.values()}) == len(CLAIMS)
    for begins, ends in TRANSITIONS.values():
        assert ends
        assert begins not in ends


@each_event
def test_every_event_does_in_every_state_what_the_table_says(event: ControlEvent) -> None:
    begun = {claim for claim, (begins, _) in TRANSITIONS.items() if event is begins}
    ended = {claim for claim, (_, ends) in TRANSITIONS.items() if event in ends}
    for claims in SETS:
        control, wanted = after(claims, event), (claims - ended) | begun
        assert control.claims.keys() == wanted
        assert control.authority == max(wanted, default=A.OURS)
        assert control.is_ours == (wanted <= {A.REJECTING})
        assert bool(control.reason) == bool(wanted)


def test_only_an_order_ends_a_hold_or_a_return() -> None:
    """An audit that finds another mission keeps the vehicle suspended, for that reason."""
    for claim in (A.HELD, A.RETURNING, A.OTHER_MISSION):
        for event in enders(claim) - ORDERS:
            assert event is E.AUDIT_DIFFERENT
            assert after(frozenset({claim}), event).suspension == "found"
    assert enders(A.OTHER_MISSION) == ORDERS
    for claims in SETS:
        for event in ControlEvent:
            if claims & SUSPENSIONS.keys() and event is not E.RESUME:
                assert after(claims, event).suspension is not None


def test_a_pilot_keeps_the_vehicle_until_auto_our_own_loiter_or_an_order_to_resume() -> None:
    explained = {E.WAITING_SEEN, E.MISSION_COMPLETE, E.NO_MISSION_SEEN}
    assert enders(A.OVERRIDDEN) == {E.AUTO_SEEN, E.RESUME} | explained


def test_the_mission_of_another_station_stays_until_ours_is_verified_or_an_order_to_resume() -> None:
    assert enders(A.OTHER_STATION) == {E.UPLOAD_VERIFIED, E.RESUME}


def test_an_unanswered_audit_ends_by_its_answer_or_an_order_to_resume() -> None:
    answers = {E.AUDIT_EQUAL, E.AUDIT_DIFFERENT, E.MISSION_LOST}
    assert enders(A.UNVERIFIED) == {*answers, E.RESUME}


@pytest.mark.parametrize("event", [E.REBOOT, E.AGENT_LOST])
def test_a_reboot_or_a_loss_gives_nothing_back(event: ControlEvent) -> None:
    assert all(after(claims, event).claims.keys() == claims for claims in SETS)


def test_at_most_one_suspension_lasts() -> None:
    for claims in SETS:
        if len(claims & SUSPENSIONS.keys()) <= 1:
            for event in ControlEvent:
                assert len(after(claims, event).claims.keys() & SUSPENSIONS.keys()) <= 1


def test_a_claim_that_goes_on_keeps_its_time_and_another_mode_begins_anew() -> None:
    claims = Claims()
    for t_ns, mode in ((1, "RTL"), (2, "RTL"), (3, "FBWA")):
        claims.apply(E.MODE_CHOSEN, t_ns, mode)
    assert claims.since_t_ns(A.OVERRIDDEN) == 3
    assert Control(claims.begun).reason == "is in FBWA and left alone"
    claims.apply(E.HOLD, 4)
    claims.apply(E.HOLD, 5)
    assert claims.since_t_ns(A.HELD) == 4
    assert Control(claims.begun).reason == "is held by order"


def test_the_table_in_the_documentation_is_the_table_of_the_service() -> None:
    text = (Path(__file__).parents[2] / "docs" / "orders.md").read_text(encoding="utf-8")
    recorded = text.split("ends with\n")[1].split("```")[0].splitlines()
    wanted = []
    for claim in CLAIMS:
        begins, ends = TRANSITIONS[claim]
        wanted.append([claim.word, begins.value, ", ".join(event.value for event in ends)])
    assert [re.split(" {2,}", row) for row in recorded] == wanted
    derived = text.split("holds while\n")[1].split("```")[0].splitlines()
    assert [re.split(" {2,}", row) for row in derived] == [[c.word, while_] for c, while_ in DERIVED.items()]
