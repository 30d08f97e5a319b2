"""What a service tells Prometheus, asked as Prometheus does."""

from __future__ import annotations

from http.client import HTTPConnection, HTTPException
from typing import Final

PATIENCE_S = 2.0
LABELS = {"side", "robot"}
FAILURES: Final = (OSError, HTTPException, ValueError)
"""What a scrape may raise."""


def scrape(host: str, port: int) -> dict[str, float]:
    """Every figure that has no labels but side and robot, by its name without `hoap3_`.

    Raises:
        OSError, HTTPException, ValueError: nothing answers, or not as it should.
    """
    from prometheus_client.parser import text_string_to_metric_families

    connection = HTTPConnection(host, port, timeout=PATIENCE_S)
    try:
        connection.request("GET", "/metrics")
        answer = connection.getresponse()
        if answer.status != 200:
            raise HTTPException(f"status {answer.status}")
        text = answer.read().decode()
    finally:
        connection.close()
    return {
        sample.name.removeprefix("hoap3_"): float(sample.value)
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.labels.keys() == LABELS
    }
