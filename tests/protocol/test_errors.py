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
    assert str(error) == (
        "no controller is called 'qp21'. Did you mean 'qp12'? Known: pinv, qp12. Or name a file."
    )
    assert str(UnknownNameError("robot", "x", [])) == "no robot is called 'x'. Known: none."


def test_an_unknown_frame_carries_the_frames_of_the_robot():
    error = FrameNotFoundError("r_sol", "hoap3", ["r_sole", "base"])
    assert (error.frame, error.known) == ("r_sol", ["base", "r_sole"])
    assert "Did you mean 'r_sole'?" in str(error)
    assert "Did you mean" not in str(FrameNotFoundError("zzz", "hoap3", ["base"]))


def test_a_holder_of_authority_is_named():
    error = AuthorityError("hoap3", "alice")
    assert error.holder == "alice"
    assert "'hoap3' follows 'alice' already" in str(error)
    unseen = AuthorityError("hoap3", None)
    assert unseen.holder is None
    assert "robot 'hoap3' does not see" in str(unseen)


def test_a_setting_is_named_by_file_key_and_value():
    error = ConfigError("a.yaml", "x.y", 5, "is odd", "Write an even number")
    assert str(error) == "a.yaml: x.y: is odd (found 5). Write an even number"
    assert (
        str(ConfigError("a.yaml", "", None, "is empty", "Fill it")) == "a.yaml: is empty. Fill it"
    )
