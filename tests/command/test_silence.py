"""An operator would wait for nothing: whoever does not speak is named, once, and so is the end of it."""

from staging import at

from gcs.command.silence import Silence


def told(silence: Silence, until_s: float, scans: tuple[float, ...] = ()) -> list[tuple[float, str, str]]:
    """Run ticks, with scans in between; return what is said and when."""
    said = []
    for k in range(int(until_s * 2) + 1):
        t_s = 0.5 * k
        notices = silence.poll(at(t_s)) + (silence.scan(at(t_s)) if t_s in scans else [])
        said += [(t_s, notice.level, notice.text) for notice in notices]
    return said


def test_a_sensor_that_never_comes_is_an_alarm_and_its_first_scan_the_all_clear() -> None:
    said = told(Silence([1], lambda _: True), 30.0, scans=(20.0, 21.0))
    assert [(t_s, level) for t_s, level, _ in said] == [(5.0, "alarm"), (20.0, "info"), (26.0, "alarm")]
    assert said[1][2] == "scans come again after 20 s"


def test_a_sensor_that_keeps_coming_is_not_spoken_of() -> None:
    assert told(Silence([1], lambda _: True), 20.0, scans=tuple(float(s) for s in range(21))) == []


def test_vehicles_that_were_never_heard_are_named_once() -> None:
    scans = tuple(float(s) for s in range(41))
    ((t_s, level, text),) = told(Silence([1, 2, 3], lambda vehicle: vehicle == 2), 40.0, scans)
    assert (t_s, level) == (10.0, "warning")
    assert text.startswith("agents 1, 3 not heard yet")
