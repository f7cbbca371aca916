"""Connection strings as other programs write them are understood; others are refused with the right form."""

import pytest

from gcs.endpoints import parse_endpoint
from gcs.errors import LinkError


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550"),
        ("udpin://0.0.0.0:14550", "udpin:0.0.0.0:14550"),
        ("udp:127.0.0.1:14550", "udpin:127.0.0.1:14550"),
        ("udp://:14540", "udpin:0.0.0.0:14540"),
        ("udpout:192.168.1.5:14550", "udpout:192.168.1.5:14550"),
        ("udpout://ground.local:14550", "udpout:ground.local:14550"),
        ("tcp:127.0.0.1:5760", "tcp:127.0.0.1:5760"),
        ("tcpout://127.0.0.1:5760", "tcp:127.0.0.1:5760"),
        ("tcpin:0.0.0.0:5760", "tcpin:0.0.0.0:5760"),
        ("/dev/ttyUSB0,57600", "serial:/dev/ttyUSB0:57600"),
        ("/dev/ttyACM0", "serial:/dev/ttyACM0:57600"),
        ("serial:/dev/ttyUSB0:115200", "serial:/dev/ttyUSB0:115200"),
        ("serial:///dev/serial/by-id/usb-x_y-if00:921600", "serial:/dev/serial/by-id/usb-x_y-if00:921600"),
    ],
)
def test_spellings_of_other_programs_mean_the_same_endpoint(text: str, canonical: str) -> None:
    assert str(parse_endpoint(text)) == canonical
    assert parse_endpoint(canonical) == parse_endpoint(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "udpin:HOST:PORT"),
        ("14550", "udpin:HOST:PORT"),
        ("127.0.0.1:14550", "udpin:HOST:PORT"),
        ("http://127.0.0.1:14550", "udpin:HOST:PORT"),
        ("udpin:0.0.0.0", "udpin:HOST:PORT"),
        ("udpin:0.0.0.0:99999", "65535"),
        ("udpout::14550", "a host and a port"),
        ("tcp:127.0.0.1:0", "a host and a port"),
        ("udpin:[::1]:14550", "IPv4 or a name"),
        ("serial:ttyUSB0:57600", "serial:/dev/DEVICE:BAUD"),
        ("/dev/ttyUSB0,fast", "serial:/dev/DEVICE:BAUD"),
        ("/dev/ttyUSB0:0", "above 0"),
    ],
)
def test_a_wrong_endpoint_is_refused_with_the_right_form(text: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        parse_endpoint(text)
    assert caught.value.endpoint == text
    assert words in str(caught.value)
