"""Draw the rules of an upload as they stand in docs/missions.md.

    python tests/helpers/upload_diagram.py

prints both diagrams. Left out are rules that stay in their stage, orders, and most overrides: the page tells
them below.
"""

from gcs.mavlink.mission.upload_rules import LIST_RULES, MISSION_RULES
from gcs.mavlink.mission.upload_stages import Choice, Event, Stage

ORDERS = (Event.ABANDON, Event.STOP, Event.YIELD, Event.REBOOT, Event.RESTART)
NAMES = {Stage.NEW: "[*]", Stage.DONE: "[*]"}


def is_drawn(rule):
    is_order = rule.event in ORDERS or (rule.event is Event.OVERRIDE and rule.target is not Stage.DIAGNOSE)
    return rule.target is not None and not is_order


def text_of(rules):
    """Return the label of an arrow: its events, each with its guards unless one of its rules has none."""
    always = {rule.event for rule in rules if rule.guard is None}
    words = {}
    for rule in rules:
        guard = "" if rule.event in always else f"[{rule.guard.__name__.replace('_', ' ')}]"
        words[f"{rule.event or ''} {guard}".strip() or "else"] = None
    return " / ".join(words)


def diagram(table):
    """Return the lines of a Mermaid diagram."""
    arrows = {}
    for source in (*Stage, *Choice):
        for (start, _), rules in table.items():
            for rule in rules if start is source else ():
                if is_drawn(rule):
                    arrows.setdefault((source, rule.target), []).append(rule)
    choices = [choice for choice in Choice if any(choice in ends for ends in arrows)]
    lines = ["stateDiagram-v2", *(f"    state {choice} <<choice>>" for choice in choices)]
    for (source, target), rules in arrows.items():
        lines.append(f"    {NAMES.get(source, source)} --> {NAMES.get(target, target)} : {text_of(rules)}")
    return lines


if __name__ == "__main__":
    for one in (MISSION_RULES, LIST_RULES):
        print("\n".join(diagram(one.table)), end="\n\n")
