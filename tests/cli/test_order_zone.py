"""An operator in a terminal would close an area at other heights than he means."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from gcs.cli.fly import order
from gcs.io.zenoh.order_messages import AreaMessage

CIRCLE = ("no-fly-zone", "fire", "--circle", "900,640,120")


@pytest.fixture
def sent(monkeypatch) -> list[AreaMessage]:
    found: list[AreaMessage] = []
    monkeypatch.setattr(order, "_send", lambda *_given, no_fly_zone: found.append(no_fly_zone))
    return found


@pytest.mark.parametrize(
    ("options", "heights"),
    [
        ((), (None, None, None)),
        (("--height", "40"), (None, 40.0, "ground")),
        (("--ceiling", "300", "--reference", "msl"), (None, 300.0, "msl")),
        (("--floor", "100", "--ceiling", "300", "--reference", "home"), (100.0, 300.0, "home")),
    ],
)
def test_a_zone_has_the_heights_of_its_options(sent, options, heights) -> None:
    assert CliRunner().invoke(order.app, [*CIRCLE, *options]).exit_code == 0
    (zone,) = sent
    assert (zone.floor_m, zone.ceiling_m, zone.reference) == heights


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--ceiling", "300"), "reference: is missing"),
        (("--floor", "300", "--ceiling", "100", "--reference", "msl"), "100 m is not above floor_m, 300 m"),
        (("--ceiling", "nan", "--reference", "msl"), "ceiling_m: expected metres, not nan"),
        (("--ceiling", "1e300", "--reference", "msl"), "ceiling_m: expected metres, not 1e+300"),
        (("--ceiling", "-5", "--reference", "ground"), "ceiling_m: -5 m is not above the ground"),
        (("--floor", "-5", "--reference", "ground"), "floor_m: -5 m is below the ground"),
        (
            ("--height", "40", "--ceiling", "60", "--reference", "home"),
            "expected either height_m, or floor_m",
        ),
        (("--ceiling", "high", "--reference", "msl"), "parse string as a number"),
    ],
)
def test_heights_with_a_mistake_are_refused_before_anything_is_sent(sent, options, said) -> None:
    result = CliRunner().invoke(order.app, [*CIRCLE, *options])
    assert result.exit_code == 2
    assert said in re.sub(r"[\s│]+", " ", result.output)
    assert sent == []
