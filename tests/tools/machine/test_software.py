"""What of the present software differs from that of a log."""

from __future__ import annotations

from hoap3.tools.machine.machine import differences, in_words, software


def test_the_same_software_differs_in_nothing():
    assert differences(software()) == {}
    assert in_words({}) == ""


def test_a_log_without_a_hash_of_our_code_is_not_taken_for_the_same():
    now = software()
    logged = {name: version for name, version in now.items() if name != "source"}
    ((name, (_, present)),) = differences(logged).items()
    assert (name, present) == ("source", now["source"])


def test_our_own_code_is_told_from_packages():
    now = software()
    words = in_words(differences({**now, "source": "0123456789ab", "numpy": "1.0"}))
    for part in ("numpy 1.0", now["numpy"], "0123456789ab"):
        assert part in words
