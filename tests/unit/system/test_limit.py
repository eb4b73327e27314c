"""A function of another library has a limited time, in any thread."""

import _thread
import threading
import time

import pytest

from unilateral.system.limit import OutOfTime, run_with_limit


def endless(started):
    started.append(threading.current_thread())
    while True:
        time.sleep(1e-3)


def wait_for_end(threads):
    """Whether the threads end, which they are given ten seconds for."""
    for thread in threads:
        thread.join(10)
    return threads and not any(thread.is_alive() for thread in threads)


def test_what_a_function_returns_or_raises_is_handed_on():
    assert run_with_limit(lambda: 3, 10) == 3
    assert run_with_limit(lambda: None, 10) is None
    with pytest.raises(SystemExit, match="7"):
        run_with_limit(lambda: exit(7), 10)


@pytest.mark.parametrize("in_a_thread", [False, True])
def test_what_does_not_end_is_ended(in_a_thread):
    started = []
    calls = []

    def wait():
        try:
            run_with_limit(lambda: endless(started), 0.05)
        except OutOfTime:
            calls.append("given up")

    if in_a_thread:
        waiting = threading.Thread(target=wait)
        waiting.start()
        waiting.join(10)
    else:
        wait()
    assert calls == ["given up"]
    assert wait_for_end(started)


def test_an_interrupt_is_heard_meanwhile():
    started = []
    threading.Timer(0.1, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        run_with_limit(lambda: endless(started), 60)
    assert wait_for_end(started)
