"""A loop that waits is woken when nothing comes, and only then."""

from __future__ import annotations

import threading

from loopback import PATIENCE_S

from hoap3.remote_controller.silence import SilenceWatch

SOON_S = 0.02


def test_a_silent_loop_is_woken_and_told():
    woken = threading.Event()
    with SilenceWatch(lambda: 5, woken.set, SOON_S) as watch:
        assert woken.wait(PATIENCE_S)
        assert watch.silent()
        woken.clear()
        assert woken.wait(PATIENCE_S)  # and again, if it waits on


def test_progress_after_the_waking_is_no_silence():
    woken, count = threading.Event(), [5]
    with SilenceWatch(lambda: count[0], woken.set, SOON_S) as watch:
        assert woken.wait(PATIENCE_S)
        count[0] += 1
        assert not watch.silent()


def test_a_loop_that_was_busy_itself_begins_again():
    woken = threading.Event()
    with SilenceWatch(lambda: 5, woken.set, PATIENCE_S) as watch:
        watch._silent_at = 5
        watch.reset()
        assert not watch.silent()


def test_progress_keeps_it_quiet():
    looks, woken = threading.Semaphore(0), threading.Event()
    counter = iter(range(1_000_000))

    def progress() -> int:
        looks.release()
        return next(counter)

    with SilenceWatch(progress, woken.set, SOON_S):
        for _ in range(10):
            assert looks.acquire(timeout=PATIENCE_S)
        assert not woken.is_set()


def test_its_thread_ends_with_it():
    before = threading.active_count()
    with SilenceWatch(lambda: 0, lambda: None, PATIENCE_S):
        assert threading.active_count() == before + 1
    assert threading.active_count() == before
