"""Prometheus would get no metrics without a console, or more than metrics."""

import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gcs.console.web.prometheus import metrics_text


@contextmanager
def metrics_of(endpoint: str) -> Iterator[str]:
    command = [sys.executable, "-P", "-m", "gcs", "metrics", "--zenoh", endpoint, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            name, _, url = process.stdout.readline().partition(": ")
            assert name == "metrics"
            yield url.strip()
        finally:
            process.terminate()


def test_a_service_without_a_console_has_the_metrics_of_one(fly):
    with fly() as flight:
        names = {line.split("{")[0].split()[0] for line in text_of(flight.url + "/metrics") if line[0] != "#"}
        flight.console.close()
        with metrics_of(flight.endpoint) as url:
            assert url.endswith("/metrics")
            lines = text_of(url)
            assert 'swarm_gcs_vehicle_armed{vehicle="3"} 0' in lines
            assert "swarm_gcs_service_up 1" in lines
            assert not [line for line in lines if line.endswith(" -0")]
            assert {line.split("{")[0].split()[0] for line in lines if line[0] != "#"} == names
            for path in ("", "api/status", "api/orders", "feed"):
                with pytest.raises(urllib.error.HTTPError, match="404"):
                    text_of(url.removesuffix("metrics") + path)


def test_a_service_that_does_not_answer_is_told() -> None:
    assert "swarm_gcs_service_up 0" in metrics_text(None, 0).splitlines()


def text_of(url: str) -> list[str]:
    with urllib.request.urlopen(url, timeout=10.0) as reply:
        return reply.read().decode().splitlines()
