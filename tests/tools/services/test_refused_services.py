"""What a service that cannot start leaves behind: nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.services import services


@pytest.mark.parametrize("part", ["settled_alone", "observer_for"])
def test_a_service_that_systemd_starts_again_and_again_leaves_no_empty_folders(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {"robot": "ur5", "log": {"directory": str(tmp_path)}}
    config = parse(EmulatorConfig, content, "mine.yaml")

    def refuse(*_: Any, **__: Any) -> Any:
        (folder,) = tmp_path.iterdir()  # it was made
        raise ConfigError("mine.yaml", "link.secure", str(folder), "has expired", "Renew it")

    monkeypatch.setattr(services, part, refuse)
    with pytest.raises(ConfigError):
        services.run_emulator(
            config,
            "mine.yaml",
            lockstep=False,
            duration=0.1,
            out=None,
            status_fd=None,
            should_stop=lambda: True,
        )
    assert list(tmp_path.iterdir()) == []
