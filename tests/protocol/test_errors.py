"""One tree of errors, each of which says what to do."""

from __future__ import annotations

from hoap3.protocol.errors import (
    AuthorityError,
    ConfigError,
    FrameNotFoundError,
    UnknownNameError,
    UsageError,
)


def test_an_unknown_name_carries_the_nearest_and_all_known_ones():
    error = UnknownNameError("controller", "qp21", ["pinv", "qp12"], " Or name a file.")
    assert isinstance(error, UsageError)
    assert (error.kind, error.name, error.known) == ("controller", "qp21", ["pinv", "qp12"])
    assert error.nearest == "qp12"
    assert all(name in str(error) for name in ("'qp21'", "'qp12'", "pinv, qp12"))
    assert "'x'" in str(UnknownNameError("robot", "x", []))


def test_an_unknown_frame_carries_the_frames_of_the_robot():
    error = FrameNotFoundError("r_sol", "hoap3", ["r_sole", "base"])
    assert (error.frame, error.known) == ("r_sol", ["base", "r_sole"])
    assert "'r_sole'" in str(error)


def test_a_holder_of_authority_is_named():
    error = AuthorityError("hoap3", "alice")
    assert error.holder == "alice"
    assert "'hoap3'" in str(error)
    assert "'alice'" in str(error)
    assert AuthorityError("hoap3", None).holder is None


def test_a_setting_is_named_by_file_key_and_value():
    error = ConfigError("a.yaml", "x.y", 5, "is odd", "Write an even number")
    assert str(error).startswith("a.yaml: x.y: ")
    assert "5" in str(error)
    assert str(ConfigError("a.yaml", "", None, "is empty", "Fill it")).startswith("a.yaml: is")
