"""Addresses of vehicles: where a vehicle is heard, and when it has moved.

The one rule for the fleet, which sends missions and commands, and for the router, which forwards the frames
of other ground stations. Each applies it to its own record: the fleet to recorded datagrams, the router
before they are queued.

* The address is learned from a HEARTBEAT, of component 1 from its autopilot's or its HIGH_LATENCY2, and kept
  while the component is heard there. Other addresses that use its id are refused: a second path, or an
  impostor.
* After a timeout the component may appear elsewhere.
* A component that was heard by HIGH_LATENCY2 alone moves at once to where its heartbeats are heard: its
  radio is back.
* On a second link of the mission file it takes over after a shorter timeout (`SWITCH_AFTER_NS`).
* Where signatures are checked, it moves at once to where its heartbeats are signed later: the frames from the
  address before are a replay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.mavlink.fleet.checks.link_timeouts import LOST_AFTER_NS
from gcs.mavlink.fleet.heartbeat import is_from_autopilot, is_heartbeat
from gcs.mavlink.fleet.high_latency import is_high_latency
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.fleet.standby_link import SWITCH_AFTER_NS
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Frame
from gcs.mavlink.frames.signing import MIN_SIGNED_LATER_NS, signed_t_ns

Move: TypeAlias = Literal["appeared", "signed later", "heard elsewhere", "no heartbeat"]
"""What a frame from another address than the known one means. With the first two, it is the address now."""


@dataclass(slots=True)
class Contact:
    """Where a component is heard.

    Attributes
    ----------
    address : Address
    heard_t_ns : int
        Time of its last frame.
    signed_lead_ns : int or None
        `signed_lead_ns` of the heartbeat that set the address.
    is_slow : bool
        True if HIGH_LATENCY2 set the address, and no heartbeat came since.
    """

    address: Address
    heard_t_ns: int
    signed_lead_ns: int | None
    is_slow: bool = False

    def has_timed_out(self, t_ns: int) -> bool:
        """Return True if the component may have moved, or be gone."""
        return t_ns - self.heard_t_ns > LOST_AFTER_NS

    def is_silent(self, t_ns: int) -> bool:
        """Return True if a second link of the component may take over."""
        return t_ns - self.heard_t_ns > SWITCH_AFTER_NS


def move_of(
    frame: Frame, t_ns: int, known: Contact | None, *, is_keyed: bool, is_second_path: bool = False
) -> Move:
    """Return what a frame from an address that is not the known one means.

    Parameters
    ----------
    known : Contact or None
        Where the component was heard last; None: nowhere.
    is_keyed : bool
        True if the frame's signature was checked.
    is_second_path : bool
        True if the component may be heard at both addresses (`gcs.mavlink.fleet.standby_link`). A heartbeat
        takes over from a signed one only if it is signed.
    """
    is_proof = names_autopilot(frame) and (
        frame.component_id != AUTOPILOT_COMPONENT_ID or is_from_autopilot(frame.message())
    )
    has_radio_again = known is not None and known.is_slow and is_heartbeat(frame)
    if known is None or known.has_timed_out(t_ns) or has_radio_again:
        return "appeared" if is_proof else "no heartbeat"
    if (
        is_second_path
        and known.is_silent(t_ns)
        and is_heartbeat(frame)
        and is_proof
        and has_equal_proof(frame, known)
    ):
        return "appeared"
    lead_ns = signed_lead_ns(frame, t_ns)
    before_ns = known.signed_lead_ns
    is_later = lead_ns is not None and before_ns is not None and lead_ns - before_ns > MIN_SIGNED_LATER_NS
    return "signed later" if is_proof and is_keyed and is_later else "heard elsewhere"


def has_equal_proof(frame: Frame, known: Contact) -> bool:
    """Return True if a frame is signed, or the heartbeat that set the address was not."""
    return frame.signed or known.signed_lead_ns is None


def names_autopilot(frame: Frame) -> bool:
    """Return True if a frame names the type of its autopilot."""
    return is_heartbeat(frame) or is_high_latency(frame)


def signed_lead_ns(frame: Frame, t_ns: int) -> int | None:
    """Return the signing time of a frame that is heard at `t_ns`, less `t_ns`; None if unsigned."""
    signed_ns = signed_t_ns(frame)
    return None if signed_ns is None else signed_ns - t_ns
