"""`[LABEL=]CONTROLLER[@KEY=VALUE,…]` is read as it is meant, or refused with one clear error."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hoap3.protocol.errors import ConfigError, UnknownNameError, UsageError
from hoap3.tools.analysis.compare.candidates import read_candidates, split

NAMES = st.sampled_from(["qp12", "pinv", "a.b:Class", "./dir/x=1.yaml", "me@home.yaml", "../@.yml"])
KEYS = st.from_regex(r"[a-z_][a-z0-9_]{0,5}(\.[a-z]{1,4})?", fullmatch=True)
VALUES = st.one_of(
    st.integers().map(str),
    st.lists(st.integers(), max_size=4).map(str),
    st.sampled_from(["'a,b'", "{a: [1, 2], b: 3}", "one", '"]"', "a=b", ""]),
)


@given(
    label=st.none() | st.from_regex(r"[\w-]{1,8}", fullmatch=True),
    name=NAMES,
    settings=st.lists(st.tuples(KEYS, VALUES), max_size=4),
)
def test_what_is_put_together_is_taken_apart_again(label, name, settings):
    sets = [f"{key}={value}" for key, value in settings]
    words = f"{label}={name}" if label is not None else name
    words += f"@{','.join(sets)}" if sets else ""
    assert split(words) == (label, name, sets)


def parameters(*words):
    return [each.config.parameters for each in read_candidates(words)]


def test_settings_change_the_config_as_set_does():
    first, second = parameters("qp12@gamma=0.1,psi_scale=one,target_m=[0.01, 0.02, 0.3]", "qp12")
    assert first["gamma"] == 0.1
    assert first["psi_scale"] == "one"
    assert first["target_m"] == [0.01, 0.02, 0.3]
    assert second["gamma"] == 0.5
    assert {**first, "gamma": 0, "psi_scale": 0, "target_m": 0} == {
        **second,
        "gamma": 0,
        "psi_scale": 0,
        "target_m": 0,
    }


def test_a_file_of_the_users_own_is_taken_too(tmp_path):
    file = tmp_path / "my@own.yaml"
    file.write_text("controller: qp12\nparameters: {gamma: 0.25}\n", encoding="utf-8")
    first, second = read_candidates([str(file), f"{file}@gamma=0.75"])
    assert (first.label, second.label) == ("my@own", "my@own@gamma=0.75")
    assert first.parameters["gamma"] == 0.25
    assert second.parameters["gamma"] == 0.75
    assert second.parameters["u_max_rad_s"] == 0.6  # a default, which is a parameter like others


def test_a_bare_name_and_a_dotted_path_are_taken_too():
    path = "hoap3.remote_controller.controllers.qp12.qp12:Qp12Controller"
    first, second = read_candidates([f"mine={path}@gamma=1", path])
    assert (first.label, second.label) == ("mine", path)
    assert first.config.controller == second.config.controller == path


def test_equal_labels_are_told_apart():
    words = ["qp12", "pinv", "qp12", "a=pinv", "a=qp12", "qp12"]
    labels = [each.label for each in read_candidates(words)]
    assert labels == ["qp12", "pinv", "qp12#2", "a", "a#2", "qp12#3"]


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ("qp12@gamma=2", "parameters.gamma"),
        ("qp12@gama=0.1", "parameters.gama"),
        ("qp12@gamma=[", "parameters.gamma"),
        ("qp12@gamma.a=1", "parameters.gamma.a"),
        ("qp12@gamma=.nan", "parameters.gamma"),
        ("qp12@gamma=0.1,", ""),
        ("qp12@target_m=1,2,3", "2"),
        ("qp12@gamma", ""),
        ("qp12@", ""),
        ("@gamma=1", ""),
        ("a=", ""),
        ("", ""),
    ],
)
def test_wrong_words_are_refused_by_place(words, key):
    with pytest.raises(ConfigError) as caught:
        read_candidates(["pinv", words])
    assert (caught.value.file, caught.value.key) == (words, key)


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UnknownNameError) as caught:
        read_candidates(["qp12", "pimv@law=plain"])
    assert caught.value.nearest == "pinv"


@pytest.mark.parametrize("words", [[], ["qp12"]])
def test_one_alone_is_nothing_to_compare(words):
    with pytest.raises(UsageError):
        read_candidates(words)
