"""A setting laid over a mission file changes that key and nothing else, or says why it cannot."""

import msgspec
import pytest

from gcs.config import parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.errors import ConfigError

TEXT, SOURCE = read_text("prescribed")


def test_changes_the_key_and_keeps_the_rest_with_its_comments():
    changed = override_keys(TEXT, ["planning.switch_gain_m=75.5"], SOURCE)

    assert parse(changed, SOURCE).planning.switch_gain_m == 75.5
    before, after = (msgspec.toml.decode(text) for text in (TEXT, changed))
    before["planning"]["switch_gain_m"] = 75.5
    assert after == before
    assert changed.count("#") == TEXT.count("#")


def test_reaches_rows_of_a_list_and_makes_tables_that_are_not_there():
    changed = override_keys(
        'name = "x"\n[[agents]]\neast_m = 1.0\n', ["agents[0].east_m=2", "a.b.c=true"], "x"
    )

    assert msgspec.toml.decode(changed) == {"name": "x", "agents": [{"east_m": 2}], "a": {"b": {"c": True}}}


def test_a_value_that_is_not_toml_is_a_string():
    assert msgspec.toml.decode(override_keys("", ["planning.shape=pulled"], "x")) == {
        "planning": {"shape": "pulled"}
    }


@pytest.mark.parametrize(
    ("setting", "error"),
    [
        ("planning.period_s", "KEY=VALUE"),
        ("=3", "KEY=VALUE"),
        ("a..b=3", "KEY=VALUE"),
        ("agents[9].east_m=3", "agents[9].east_m"),
        ("name.x=3", "name.x"),
    ],
)
def test_a_setting_that_cannot_be_laid_is_named(setting: str, error: str):
    with pytest.raises(ConfigError, match=error.replace("[", r"\[")):
        override_keys(TEXT, [setting], SOURCE)


def test_an_unknown_key_is_caught_by_validation():
    with pytest.raises(ConfigError, match="swich_gain_m"):
        parse(override_keys(TEXT, ["planning.swich_gain_m=1"], SOURCE), SOURCE)
