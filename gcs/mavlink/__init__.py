"""MAVLink without I/O: bytes and times in, bytes and notices out. For readers who know pymavlink.

In reading order:

=================================  ======================================================================
`frames.codec`                     frame layout, `scan` (parse_buffer), `Encoder` (pack), `target_of`
`frames.stream`                    frames out of a TCP or serial byte stream
`frames.signing`                   MAVLink 2 message signing: keys, checks, time stamps
`frames.fast_scan`                 `scan` compiled; `fast_verify` and `batches` build on it
`fleet.fleet`                      all vehicles: datagrams in; `Send`, `Notice`, vehicle states out
`fleet.address_learning`           where a vehicle is heard, and when it has moved
`fleet.records`                    the state of one vehicle and of all links, as plain records
`fleet.vehicle`                    one vehicle: position, mode, home, health (mavutil's `messages`)
`fleet.checks.link_timeouts`       when a silent vehicle is stale, and when its link is down
`fleet.stream_requests`            SET_MESSAGE_INTERVAL and REQUEST_MESSAGE, repeated
`fleet.mode_authority`             control authority: our mode, or an operator's override
`fleet.checks.position_checks`     which GLOBAL_POSITION_INT reports to believe
`fleet.fast_telemetry`             routine telemetry, compiled, on the table in `fleet.telemetry_table`
`services.command_sender`          COMMAND_LONG, set_mode, and their repetition
`services.parameter_protocol`      PARAM_REQUEST_READ and PARAM_SET (ParameterReader, ParameterSetter)
`services.retry`                   RetryPolicy, RetryTimer: repetition of a request
`services.retransmission_timeout`  RttEstimator: when to send again, by the round trip
`mission.items`                    MISSION_ITEM_INT as a record
`mission.item_builder`             a mission as the items of a firmware
`mission.item_transfer`            MissionDownload, MissionUpload: the transfers of the mission protocol
`mission.upload_rules`             what follows on what in an upload: the table that drives it
`mission.upload_limits`            timeouts and bounds of an upload
`mission.uploads`                  a mission uploaded, verified, selected and started; a fence or rally points
`autopilots.profile`               profile of each autopilot: modes, formats, limits
`autopilots.preflight_parameters`  parameters that the preflight check reads, and their ranges
`router.router`                    routes between vehicles and other ground stations
=================================  ======================================================================
"""
