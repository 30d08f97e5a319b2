"""docs/troubleshooting.md knows every reason that the code gives."""

from __future__ import annotations

from pages import table

from hoap3.protocol.messages import Event
from hoap3.robot_emulator.setpoint_validator import REJECTION_KINDS

PAGE = "troubleshooting.md"


def test_every_kind_of_rejection_is_explained_under_its_number():
    rows = table(PAGE, "Setpoints are rejected")
    listed = {int(row["number"]): row["kind"].strip("`") for row in rows}
    assert listed == dict(enumerate(REJECTION_KINDS))


def test_every_reason_of_a_stop_is_explained():
    rows = table(PAGE, "Safe stop")
    listed = {word.strip(" `") for row in rows for word in next(iter(row.values())).split(",")}
    reasons = {name for name in Event.schema.constants if name.startswith("REASON_")}
    assert listed == {name.removeprefix("REASON_").lower().replace("_", " ") for name in reasons}
