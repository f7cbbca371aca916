// What the server sends to the page's modules. Only the type checker reads this file; it is not shipped.
// Generated: change gcs/console/view/page_records.py or gcs/model, then run
//   python tests/helpers/page_types.py > gcs/console/page_types.d.ts
// Positions are east and north in metres. A number that is not known is null.

/** East and north. */
export type Point = [number, number];

/** East-east, east-north and north-north, in square metres. */
export type Covariance = [number, number, number];

/** East, north, and height above mean sea level. */
export type TrailPoint = [number, number, number];

/** Places of a vehicle; null where it was not heard between two of them. */
export type Trail = (TrailPoint | null)[];

/** Late estimates of a track, one a scan; null where it was not estimated between two of them. */
export type LatePath = (Point | null)[];

/** Values by bin; null for empty bins. */
export type Series = (number | null)[];

export type Role = "view" | "operate";

export type MarkKind = "lost" | "down" | "arrived" | "plan" | "upload" | "alarm" | "order" | "ended";

export type Work = "scan" | "plan";

/** An area of the fence. */
export interface FenceArea {
  stay_in: boolean;
  /** Its corners, in order. */
  ring: Point[];
}

/** Map tiles that are drawn below the map. */
export interface TilesInfo {
  min_zoom: number;
  max_zoom: number;
  attribution: string;
}

/** Origin of what is shown: a live service, or a replay. */
export interface RunInfo {
  kind: "live" | "replay";
  /** Speed of the run's clock, as a multiple of real time. */
  speed: number;
  /** Differs for each run that is shown. */
  begun: string;
  /** True if its vehicles can be checked. */
  preflight: boolean;
  tiles: TilesInfo | null;
  /** File that is replayed. */
  title: string;
}

/** Ground of a mission over terrain, and its flight band. */
export interface ElevationMap {
  /** South-western node. */
  origin_m: Point;
  spacing_m: number;
  /** Rows and columns. */
  shape: [number, number];
  lowest_msl_m: number;
  step_m: number;
  /** Steps of each node above the lowest one, row by row from the south: 16 bits, little-endian, base64. */
  heights: string;
  min_agl_m: number;
  max_agl_m: number;
}

/** Parts of the mission that do not change in a run. */
export interface MissionInfo extends RunInfo {
  name: string;
  /** Extent of the map. */
  size_m: Point;
  /** Latitude and longitude of the origin of positions. */
  origin_deg: [number, number];
  /** Its height above sea level. */
  origin_alt_m: number;
  /** Elevation model and flight band in words, or "flat". */
  terrain: string;
  /** Null: the ground is flat. */
  elevation: ElevationMap | null;
  /** Height of each altitude layer above home, over flat ground. */
  layers_rel_m: number[];
  /** Loiter radius of each vehicle. */
  loiter_radii_m: Record<string, number>;
  homes: Point[];
  rally: Point[];
  fence: FenceArea[];
  /** Number of scans by which `late` is late; 0: there are no late estimates. */
  lag_scans: number;
}

/** Figures by which two runs are compared; null: not known, or not read from the recording yet. */
export interface Figures {
  /** Re-tasks until now. */
  retasks: number | null;
  /** Failed uploads until now. */
  failed_uploads: number | null;
  /** OSPA of the agents at the last scan. */
  ospa_agents_m: number | null;
  ospa_targets_m: number | null;
}

/** Position and speed of a replay. */
export interface ReplayState {
  paused: boolean;
  ended: boolean;
  /** Null: as fast as it can. */
  speed: number | null;
  at_s: number;
  /** True if it can go back. */
  back: boolean;
  duration_s: number | null;
  /** Only in a comparison. */
  figures: Figures | null;
}

/** State of the service around the engine. */
export interface ServiceState {
  /** Run time that the newest tick waited before it was processed. */
  lag_s: number;
  /** Events that found the queue of the service full. */
  dropped: number;
  is_recording: boolean;
  /** Space of the recording; null if it is not known. */
  space: DiskSpace | null;
  /** Other ground stations: address, and system and component ids. */
  stations: string[];
}

/** Space of a recording, as last checked. */
export interface DiskSpace {
  /** All parts together. */
  used_bytes: number;
  /** Left on the disk. */
  free_bytes: number;
  /** True while the alarm about low disk space is raised. */
  is_low: boolean;
}

/** Time of the run, its sensors and its service. */
export interface Head {
  /** Milliseconds since 1970. */
  t_ms: number;
  elapsed_s: number;
  /** True after the end of the mission. */
  ended: boolean;
  sensors: SensorRecord[];
  /** Null in a replay. */
  service: ServiceState | null;
}

/** One sensor. */
export interface SensorRecord {
  name: string;
  /** Time since its last processed scan; null: no scan was processed. */
  scan_age_s: number | null;
  /** Scans refused since then. */
  refused: number;
  state: SensorState;
}

/** Empty if scans come in time; `silent` while the alarm about that is raised. */
export type SensorState = "" | "late" | "silent";

/** Blocked cells of the map. */
export interface ObstacleMap {
  /** Centre of the first cell. */
  origin_m: Point;
  spacing_m: number;
  /** Rows and columns. */
  shape: [number, number];
  /** One bit for each cell, row by row from the south, in base64. */
  blocked: string;
  /** The same for cells that are blocked below the altitude layers only; empty if there are none. */
  below: string;
}

/** Tracks of one kind: columns of one value for each. */
export interface Tracks {
  names: string[];
  /** East, north, and their rates. */
  means: [number, number, number, number][];
  /** Covariance of each position. */
  covs: Covariance[];
  /** Existence probabilities. */
  existence: number[];
  estimated: boolean[];
}

/** Field of view of a sensor: a sector around it, or a box. */
export interface FieldOfView {
  /** West, south, east and north. */
  box_m: [number, number, number, number];
  /** Null: the box. */
  polar: Polar | null;
}

/** Model of a range/bearing sensor. Bearings are clockwise from north; clutter is uniform in both. */
export interface Polar {
  /** Position of the sensor. */
  east_m: number;
  north_m: number;
  range_std_m: number;
  bearing_std_rad: number;
  /** Minimum and maximum range. */
  range_m: [number, number];
  /** Centre and half width of the sector; a half width of pi is all around. */
  bearing_rad: [number, number];
  /** Clutter intensity in range x bearing. */
  clutter_per_m_rad: number;
  /** True if its ranges are slant ranges, which the terrain projects to the ground plane. */
  is_slant: boolean;
}

/** Line of the log. */
export interface LogEntry {
  /** Number; later entries have higher ones. */
  n: number;
  t_s: number;
  level: Level;
  text: string;
  /** Kind of its effect, or of its mark. */
  kind: string;
  /** Code of its notice: an entry of the page of alarms; empty for an order. */
  code: string;
  /** Identity of the condition that it tells of. */
  key: string;
  /** Conditions that it ends. */
  ends: string[];
  vehicle: number | null;
}

export type Level = "info" | "warning" | "alarm";

/** First message of the feed: what its page may do. */
export interface RoleMessage {
  type: "role";
  role: Role;
}

/** Sections of the page's data. */
export interface Sections {
  mission?: MissionInfo;
  /** Milliseconds since 1970 at which the service was last heard; null while it answers. */
  lost?: number | null;
  /** Null for a live run. */
  replay?: ReplayState | null;
  head?: Head;
  /** Those that need attention first. */
  vehicles?: AgentRecord[];
  targets?: TargetRecord[];
  /** The plan that waits for approval. */
  proposal?: Proposal | null;
  map?: ObstacleMap;
  zones?: NoFlyZone[];
  routes?: Route[];
  agents_tracks?: Tracks;
  targets_tracks?: Tracks;
  /** Field of view of each sensor. */
  fields_of_view?: Record<string, FieldOfView>;
  /** New scans; not in a snapshot. East and north of the detections of each in turns. */
  scans?: number[][];
  /** New entries; in a snapshot the last ones. */
  log?: LogEntry[];
  /** New answers to orders; in a snapshot the last ones. */
  answers?: OrderAnswer[];
  /** Places of each vehicle; only in a snapshot. */
  trails?: Record<string, Trail>;
  /** New estimates of each track some scans late; in a snapshot the last ones. */
  late?: Record<string, LatePath>;
}

/** One agent. */
export interface AgentRecord {
  vehicle: number;
  status: "active" | "arrived" | "lost" | "down";
  authority: AuthorityWord;
  /** Why it is not ours, in words; empty if it is. */
  reason: string;
  /** Time since its last frame; null: never heard. */
  heard_age_s: number | null;
  /** True if it was not heard for some time, or never. */
  is_late: boolean;
  /** Fraction of its frames that did not arrive. */
  loss: number;
  mode: string;
  armed: boolean;
  battery_percent: number | null;
  /** True if its charge is known and below the limit of its alarm. */
  is_battery_low: boolean;
  /** GPS_FIX_TYPE. */
  fix_type: number | null;
  /** Reported position; null before its first one. */
  position_m: [number, number] | null;
  /** Reported course over ground, clockwise from north. */
  course_rad: number | null;
  /** Reported height above its home. */
  alt_rel_m: number | null;
  /** Reported height above mean sea level. */
  alt_msl_m: number | null;
  /** Height above the ground below it, by the elevation model; null without one. */
  agl_m: number | null;
  ground_speed_m_s: number | null;
  /** True if an integrity warning about its reports is open. */
  is_position_doubted: boolean;
  /** Position at which it was last seen, if it is lost or down. */
  lost_at_m: [number, number] | null;
  /** Label of its track. */
  track: Label | null;
  /** Existence probability of its track; 0 without one. */
  existence: number;
  /** Altitude layer of its route. */
  layer: number;
  /** Target that it flies to, or that it reached. */
  target: Label | null;
  /** Length of the rest of its climb and route. */
  to_go_m: number | null;
  /** Flight time of the rest of its route, at its ground speed; on the ground that of take-off and route. */
  eta_s: number | null;
  /** Stage of its upload: empty for none, else such as "waiting" or "read-back". */
  upload: string;
  /** True if its last upload failed. */
  has_failed: boolean;
  /** True if its onboard mission is known, and read back equal. */
  is_verified: boolean;
  phase: FlightPhaseWord;
  /** Health problems that the operator was notified of, in words. */
  problems: string[];
  /** Number of points of its route that it has passed. */
  points_passed: number;
  /** Target of the route that waits for approval. */
  proposed_target: Label | null;
  /** Target that it is to fly to, by order. */
  pinned: Label | null;
}

/** Authority over a vehicle, for operators; see `Authority`. */
export type AuthorityWord = "ours" | "held" | "returning" | "overridden" | "landing" | "other station" | "unverified" | "grounded" | "rejecting" | "unsupported" | "landed" | "down";

/** Identity of a track: (scan count at its birth, index within that scan); ordered. */
export type Label = [number, number];

/** Flight phase of a vehicle, for operators. */
export type FlightPhaseWord = "unknown" | "on the ground" | "taking off" | "en route" | "at its target" | "returning" | "landing" | "landed" | "down";

/** One confirmed target. */
export interface TargetRecord {
  label: Label;
  /** Existence probability of its track. */
  existence: number;
  position_m: [number, number];
  speed_m_s: number;
  /** Agents on their way to it. */
  agents: number[];
  reached_by: number[];
  /** True if no vehicle flies to it, by order. */
  is_ignored: boolean;
  /** Priority by order; null: that of the mission file. */
  priority: number | null;
  /** Vehicles that are to fly to it, by order. */
  pinned: number[];
}

/** A plan that waits for approval; without routes: no plan waits. */
export interface Proposal {
  t_ns: number;
  /** Number of the plan; a higher one replaces this proposal. */
  plan_id: number;
  /** Routes that wait for approval, ordered by vehicle. */
  routes: Route[];
  reason: string;
  /** Time at which the number was first shown. */
  shown_t_ns: number;
  /** Figures of `routes`, in the same order. */
  figures: RouteFigures[];
}

/** Route of one vehicle to one target. */
export interface Route {
  vehicle: number;
  target: Label;
  /** (k, 2) east/north, without the vehicle's position, with the target's. */
  points_m: Point[];
  /** Length from the vehicle's position along the points. */
  length_m: number;
  /** Altitude layer; 0 is the lowest (`gcs.planning.layer_assignment`). */
  layer: number;
  /** Centre of the loiter circle that follows, east/north; null: the last point. */
  wait_m: [number, number] | null;
  /** (k,) height above mean sea level of each of `flown_m`; null: that of the layer, above home. */
  heights_msl_m: number[] | null;
  /** Index of the point where it meets its target; -1: the last one. */
  target_point: number;
}

/** Figures of a proposed route, flown from the current position of its vehicle. */
export interface RouteFigures {
  vehicle: number;
  /** Length of the route, with the climb of a vehicle on the ground. */
  length_m: number;
  /** Length when the plan was first shown under its number. */
  shown_length_m: number;
  /** Time to the target from now, or from the start of the take-off. */
  arrival_s: number;
  /** Minimum planned distance to vehicles of its altitude layer; null: there are none. */
  separation_m: number | null;
  /** Minimum distance to obstacles in the air, with the loiter circle, at most the required clearance; null: none is required. */
  clearance_m: number | null;
  /** True if the route stops short of the target. */
  is_short: boolean;
}

/** A no-fly zone: a disc or a polygon in the mission's local frame. */
export interface NoFlyZone {
  name: string;
  /** East, north, radius. */
  disc_m: [number, number, number] | null;
  /** East and north of at least three corners, in order. */
  polygon_m: [number, number][];
  limits: VerticalLimits;
}

/** Floor and ceiling of an area; without both it reaches from the ground to the sky. */
export interface VerticalLimits {
  /** Null: down to the ground. */
  floor_m: number | null;
  /** Null: up to the sky. */
  ceiling_m: number | null;
  reference: LimitReference;
}

/** What the limits are above: home, mean sea level, or the ground below. */
export type LimitReference = "home" | "msl" | "ground";

/** Reply to a command: first whether it is accepted, then the result for each vehicle. */
export interface OrderAnswer {
  t_ns: number;
  order_id: string;
  action: Action;
  /** "accepted": in progress; "done": the vehicle confirms it; "refused": nothing was sent; "failed". */
  state: AnswerState;
  detail: string;
  /** Null: the reply is about the whole command. */
  vehicle: number | null;
  /** Vehicles whose result is outstanding. */
  waiting: number[];
  /** The plan that waits, for the command `plan`. */
  proposal: Proposal | null;
}

export type Action = "hold" | "resume" | "return" | "arm" | "disarm" | "ready" | "plan" | "confirm" | "reject" | "no-fly-zone" | "ignore" | "attend" | "priority" | "pin" | "unpin" | "continue" | "status";

export type AnswerState = "accepted" | "done" | "refused" | "failed";

/** Message of the feed with all sections that there are. */
export interface SnapshotMessage extends Sections {
  type: "snapshot";
}

/** Message of the feed with the sections that have changed. */
export interface UpdateMessage extends Sections {
  type: "update";
}

export type FeedMessage = RoleMessage | SnapshotMessage | UpdateMessage;

/** Authority that holds a vehicle. */
export interface ClaimDetail {
  authority: string;
  reason: string;
  /** Time since its begin. */
  since_s: number | null;
}

/** Link of a vehicle. */
export interface LinkDetail {
  state: string;
  /** Null: never heard. */
  address: string | null;
  signed: boolean;
  /** Frames that have arrived. */
  frames: number;
  /** Frames that have not arrived. */
  lost: number;
  /** Frames that used its id from another address. */
  conflicts: number;
  /** Name of the firmware; empty if it is not known. */
  autopilot: string;
  reboots: number;
}

/** Item of an onboard mission. */
export interface MissionItem {
  seq: number;
  command: string;
  /** Null: it has no place. */
  at: Point | null;
  alt_m: number | null;
  /** What `alt_m` is above: home, or mean sea level (routes over terrain, an ArduPlane's home). */
  reference: "home" | "msl";
}

/** Onboard mission of a vehicle, by the last read-back. */
export interface MissionDetail {
  target: Label;
  items: MissionItem[];
  /** Item with the first point of the route. */
  first: number;
  /** Current item; null while the vehicle still counts items of the mission before. */
  current: number | null;
  /** Time since it was verified; null if that was before a restart, or never. */
  verified_s: number | null;
  inconsistent: boolean;
  /** True while it is downloaded and compared. */
  audited: boolean;
}

/** Upload to a vehicle. */
export interface UploadDetail {
  /** Time since it began; null without one. */
  since_s: number | null;
  /** Failed uploads in a row. */
  failures: number;
  /** Time until the next attempt; 0 if none waits. */
  pause_s: number;
}

/** Return to launch of a vehicle. */
export interface ReturnDetail {
  /** In words; empty if its parameters were not heard. */
  height: string;
  problem: string;
}

/** Position-integrity monitor of a vehicle. */
export interface PositionDetail {
  cusum: number;
  /** CUSUM from which its reports are doubted. */
  alarm_cusum: number;
  /** Refused position reports, by reason. */
  refused: Record<string, number>;
}

/** Everything of one vehicle's record. */
export interface VehicleDetail {
  /** Seconds since 1970, by the run's clock. */
  t_s: number;
  agent: AgentRecord;
  /** The one that prevails first. */
  claims: ClaimDetail[];
  link: LinkDetail;
  /** Null: its onboard mission is not known. */
  mission: MissionDetail | null;
  upload: UploadDetail;
  return: ReturnDetail;
  /** Why its take-off is not clear; empty if it is. */
  takeoff_problem: string;
  position: PositionDetail;
}

/** One event of the run. */
export interface Mark {
  t_s: number;
  kind: MarkKind;
  text: string;
  /** Code of its notice; empty for an order. */
  code: string;
  /** Identity of the condition that it tells of. */
  key: string;
}

/** Events of the run. */
export interface MarksReply {
  /** True if no more will come: a recording was read to its end. */
  complete: boolean;
  marks: Mark[];
}

/** Series of the charts, in bins of equal width from the start of the run. */
export interface ChartsReply {
  /** Width of a bin. */
  width_s: number;
  bins: number;
  /** Mean number of objects. */
  objects: Partial<Record<Kind, Series>>;
  /** Its standard deviation. */
  spread: Partial<Record<Kind, Series>>;
  /** True number of objects. */
  true: Partial<Record<Kind, Series>>;
  ospa: Partial<Record<Kind, Series>>;
  /** Existence probability of each track. */
  existence: Partial<Record<Kind, Record<string, Series>>>;
  /** Messages of each vehicle per second. */
  rate: Record<string, Series>;
  /** Messages of each vehicle that were lost, in percent. */
  loss: Record<string, Series>;
  /** Charge of each vehicle, in percent. */
  battery: Record<string, Series>;
  /** Longest computing times, in milliseconds. */
  work: Partial<Record<Work, Series>>;
  /** True if a recording was read to its end. */
  complete: boolean;
}

export type Kind = "agents" | "targets";

/** Routes that are flown, and the plan that waits for approval. */
export interface PlanReply {
  routes: Route[];
  proposal: Proposal | null;
}

/** Answers to an order until now. */
export interface OrderReply {
  order_id: string;
  /** True if no more answers will come. */
  complete: boolean;
  answers: OrderAnswer[];
}

/** Result of `gcs preflight`, or why there is none. */
export interface PreflightRun extends PreflightResult {
  /** Begin of the checks, in milliseconds since 1970. */
  at_ms: number;
  error: string;
}

/** Result of all checks, as `gcs preflight --json` prints it. */
export interface PreflightResult {
  mission: string;
  /** True if nothing is refused. */
  ok: boolean;
  /** Number of refused checks. */
  refused: number;
  warnings: number;
  checks: CheckRow[];
}

/** Finding of a check in words: a row of the table. */
export interface CheckRow {
  /** Null: the mission. */
  vehicle: number | null;
  /** Stable identity of the finding. */
  code: string;
  name: string;
  level: CheckLevel;
  value: string;
  wanted: string;
  /** What to do, unless it is ok. */
  remedy: string;
  /** Parameters of the code. */
  parameters: Record<string, Parameter>;
}

/** Refused: do not fly. */
export type CheckLevel = "ok" | "warning" | "refused";

export type Parameter = number | number | string | number[];

/** Last result of `gcs preflight`. */
export interface PreflightReply {
  possible: boolean;
  running: boolean;
  result: PreflightRun | null;
}

/** Why a request was refused. */
export interface ErrorReply {
  error: string;
}
