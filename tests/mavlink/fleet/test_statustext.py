"""A pilot would read a third of the reason why a vehicle does not fly."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.statustext import TextChunks

LONG = "Mission rejected: landing required, but there is no landing item in the mission that was uploaded"


def pieces(text, number):
    parts = [text[at : at + 50] for at in range(0, len(text) + 1, 50)]
    return [
        dialect.MAVLink_statustext_message(4, part.encode(), number, seq) for seq, part in enumerate(parts)
    ]


def add_chunk(messages):
    chunks = TextChunks()
    return [text for message in messages for text in chunks.add_chunk(message)]


def test_a_long_text_is_one_whole_notice():
    assert add_chunk([*pieces(LONG, 3), *pieces("short", 0)]) == [LONG, "short"]
    assert add_chunk(pieces("x" * 100, 4)) == ["x" * 100]
    assert add_chunk(pieces("Takeoff detected\t", 0)) == ["Takeoff detected"]


def test_a_text_with_a_lost_piece_is_shown_with_a_gap():
    first, second = pieces(LONG, 3)
    assert add_chunk([second]) == ["[...]" + LONG[50:]]
    assert add_chunk([first, *pieces("next", 0)]) == [LONG[:50] + "[...]", "next"]
    assert add_chunk([first, first, second]) == [LONG]
