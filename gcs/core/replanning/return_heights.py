"""Which vehicles fly home at one height, as far as their parameters were heard.

Nothing is asked of a vehicle in flight for this. Parameters pass here when `gcs preflight`, `gcs param` or
another ground station asks for them through the service; a rally point of the mission file is known anyway.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from typing import Final

from gcs.config import Config
from gcs.core.preflight.return_height import Return, meeting, return_of
from gcs.mavlink.autopilots.base import is_on_ground
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.parameters import decode_value

_NAMES: Final = frozenset({"RTL_ALTITUDE", "ALT_HOLD_RTL", "RTL_RETURN_ALT"})


class Returns:
    """The return heights of vehicles, as they were heard.

    Parameters
    ----------
    config : Config
        The mission: its rally points, and what lies between its altitude layers.
    fleet : Fleet
        Firmwares of vehicles, and which of them stand on the ground.
    """

    def __init__(self, config: Config, fleet: Fleet) -> None:
        self._fleet, self._step_m = fleet, config.mission.layer_step_m
        self._rally_m = [float(point.alt_rel_m) for point in config.rally]
        self._values: defaultdict[int, dict[str, float]] = defaultdict(dict)

    def receive(self, vehicle: int, message: Message) -> None:
        """Take a vehicle's message: what it says of a parameter that sets its return height."""
        if message.get_type() == "PARAM_VALUE" and message.param_id in _NAMES:
            self._values[vehicle][message.param_id] = decode_value(message, self._fleet.is_atomic(vehicle))

    def meeting(self, vehicles: Collection[int]) -> str:
        """Say which of some vehicles would return nearer to each other's height than a layer; else empty."""
        near = meeting([one for v in sorted(vehicles) if (one := self._of(v)) is not None], self._step_m)
        if not near:
            return ""
        named = ", ".join(one.words for one in near)
        return (
            f"agents {named} return less than {self._step_m:g} m apart in height: hold one until the other "
            "is down, or watch them"
        )

    def _of(self, vehicle: int) -> Return | None:
        profile = self._fleet.profile(vehicle)
        if profile is None or is_on_ground(self._fleet.state(vehicle), self._fleet.home(vehicle)):
            return None
        return return_of(vehicle, profile, self._values[vehicle], self._rally_m)
