"""An operator would look for a service that runs: the console's certificate was that of a viewer."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from gcs.console.web.order_requests import OrderDesk, RefusedOrderError
from gcs.errors import LinkError


def test_a_console_with_the_certificate_of_a_viewer_says_why_its_orders_are_not_sent() -> None:
    def submit(payload: bytes) -> None:
        raise LinkError("tls/10.0.0.5:7447", "viewer.vic may not publish on `order`: its role is viewer")

    mission = SimpleNamespace(origin_deg=(33.2, -87.6), origin_alt_m=70.0)
    desk = OrderDesk(cast("Any", SimpleNamespace(is_lost=False, mission=mission)), submit)
    with pytest.raises(RefusedOrderError, match="its role is viewer; the order was NOT sent"):
        desk.place(b'{"action": "hold", "vehicles": [1]}', "10.0.0.9")
