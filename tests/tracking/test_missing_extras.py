"""Somebody imports what needs an extra that is not installed, and reads how to install it."""

import importlib
import sys

import pytest


def test_the_adapter_without_stone_soup_says_what_to_install(monkeypatch):
    monkeypatch.delitem(sys.modules, "gcs.tracking.stonesoup_adapter", raising=False)
    monkeypatch.setitem(sys.modules, "stonesoup.base", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'swarm-gcs\[stonesoup\]'"):
        importlib.import_module("gcs.tracking.stonesoup_adapter")
