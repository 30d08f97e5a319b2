"""What a service that cannot start leaves behind: nothing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hoap3.protocol.config.settings import parse
from hoap3.protocol.errors import ConfigError
from hoap3.robot_emulator.config import EmulatorConfig
from hoap3.tools.analysis import result_folder
from hoap3.tools.services import services
from hoap3.tools.services.messages import ServiceConfig


@pytest.mark.slow
@pytest.mark.parametrize("part", ["settled_alone", "observer_for"])
def test_a_service_that_systemd_starts_again_and_again_leaves_no_empty_folders(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {"robot": "ur5", "log": {"directory": str(tmp_path)}}
    config = parse(EmulatorConfig, content, "mine.yaml")

    def refuse(*_: Any, **__: Any) -> Any:
        (folder,) = tmp_path.iterdir()  # it was made
        raise ConfigError("mine.yaml", "link.secure", str(folder), "has expired", "Renew it")

    ended: list[tuple[Any, ...]] = []  # what is done at the end of the process
    at_exit = SimpleNamespace(register=lambda *call: ended.append(call))
    monkeypatch.setattr(result_folder, "atexit", at_exit)
    monkeypatch.setattr(services, part, refuse)
    with pytest.raises(ConfigError):
        services.run_emulator(ServiceConfig(config, "mine.yaml"), lambda: True)
    for call, *arguments in reversed(ended):
        call(*arguments)
    assert list(tmp_path.iterdir()) == []
