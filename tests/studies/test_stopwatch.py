import time

import pytest

from hlp.studies.stopwatch import PartClock


def spin(seconds):
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        pass


def test_time_is_charged_to_the_part_that_was_entered_last():
    clock = PartClock()
    clock.start()
    begun = time.perf_counter()
    clock.enter("idle")
    time.sleep(0.05)
    clock.enter("busy")
    spin(0.03)
    clock.enter("idle")
    time.sleep(0.05)
    spent = clock.stop()
    whole = time.perf_counter() - begun
    assert spent["idle"].wall >= 0.1 and spent["idle"].cpu < 0.03
    assert spent["busy"].wall >= spent["busy"].cpu - 1e-3 and spent["busy"].cpu >= 0.03
    assert sum(each.wall for each in spent.values()) == pytest.approx(whole, abs=2e-3)


def test_time_before_the_first_part_and_after_the_stop_is_nobodys():
    clock = PartClock()
    clock.start()
    time.sleep(0.02)
    clock.enter("a")
    first = clock.stop()
    time.sleep(0.02)
    assert first["a"].wall < 0.02
    assert clock.stop() == first
    clock.start()
    assert clock.stop() == {}
