"""An operator would not see what was ordered about targets."""

from __future__ import annotations

from dataclasses import replace

from cli.test_status_tables import CALM, TARGET

from gcs.console.rows import targets
from gcs.model import SwarmStatus


def test_a_target_tells_that_it_is_ignored_ranked_and_who_is_pinned_to_it() -> None:
    agents = (replace(CALM, pinned=TARGET.label), replace(CALM, vehicle=2))
    found = (replace(TARGET, priority=5), replace(TARGET, label=(3, 2), is_ignored=True))
    ranked, ignored = targets(SwarmStatus(0, "", agents, found, (), None, False))
    assert (ranked["priority"], ranked["pinned"], ranked["ignored"]) == (5, ["1"], False)
    assert (ignored["priority"], ignored["pinned"], ignored["ignored"]) == (None, [], True)
