"""Logs that the tests of the report share, each made once."""

from __future__ import annotations

import pytest
from report_logs import lockstep_run, story_run


@pytest.fixture(scope="session")
def lockstep(tmp_path_factory):
    """Folder of a short run of HOAP-3 in lockstep, and its summary."""
    return lockstep_run(tmp_path_factory.mktemp("lockstep"))


@pytest.fixture(scope="session")
def story(tmp_path_factory):
    """Folder of a made-up run in real time with misses and stalls, and the story itself."""
    return story_run(tmp_path_factory.mktemp("story"))
