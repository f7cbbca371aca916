/**
 * What the server sends to the page. This is the one place where the page's modules know its records:
 * `gcs/console/view` and `gcs/console/web` make them. Only the type checker reads this file; it is not shipped.
 *
 * Positions are east and north in metres, times are seconds since the start of the run. A number that is not
 * known is null.
 */

export type Point = [east: number, north: number];
export type ObjectKind = "agents" | "targets";

// The feed. A snapshot has all sections that there are; an update has those that have changed.

export type FeedMessage = RoleMessage | SectionsMessage;

export interface RoleMessage {
  type: "role";
  role: Role;
}

export type Role = "view" | "operate";

export interface SectionsMessage extends Partial<Sections> {
  type: "snapshot" | "update";
}

export interface Sections {
  mission: Mission;
  replay: ReplayState | null;
  head: Head;
  vehicles: Vehicle[];
  targets: Target[];
  proposal: Proposal | null;
  map: ObstacleMap;
  zones: Zone[];
  routes: Route[];
  agents_tracks: Tracks;
  targets_tracks: Tracks;
  fields_of_view: Record<string, FieldOfView>;
  /** New scans; not in a snapshot. */
  scans: Scan[];
  /** New entries; in a snapshot the last ones. */
  log: LogEntry[];
  answers: Answer[];
  /** Places of each vehicle, null for a gap; only in a snapshot. */
  trails: Record<string, Trail>;
}

export type Trail = (Point | null)[];

export interface Mission {
  name: string;
  size_m: Point;
  origin_deg: [lat: number, lon: number];
  origin_alt_m: number;
  loiter_radii_m: Record<string, number>;
  homes: Point[];
  rally: Point[];
  fence: { stay_in: boolean; ring: Point[] }[];
  kind: "live" | "replay";
  speed: number;
  /** Differs for each run that is shown. */
  begun: string;
  preflight: boolean;
  tiles: { min_zoom: number; max_zoom: number; attribution: string } | null;
  /** File that is replayed. */
  title: string;
}

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
  figures?: Figures;
}

export interface Figures {
  retasks: number | null;
  failed_uploads: number | null;
  ospa_agents_m: number | null;
  ospa_targets_m: number | null;
}

export interface Head {
  t_ms: number;
  elapsed_s: number;
  ended: boolean;
  sensors: SensorState[];
  /** Null in a replay. */
  service: ServiceState | null;
}

export interface SensorState {
  name: string;
  /** Null: no scan yet. */
  age_s: number | null;
  state: "" | "late" | "silent";
}

export interface ServiceState {
  lag_s: number;
  dropped: number;
  recording: boolean;
  used_mb: number | null;
  free_mb: number | null;
  low: boolean;
  stations: string[];
}

export interface Vehicle {
  id: number;
  name: string;
  status: "active" | "arrived" | "lost" | "down";
  authority: string;
  problems: string[];
  reason: string;
  mode: string;
  armed: boolean;
  at: Point | null;
  course: number | null;
  alt_m: number | null;
  layer: number;
  speed_m_s: number | null;
  battery: number | null;
  battery_low: boolean;
  fix: number | null;
  /** Null: never heard. */
  heard_s: number | null;
  late: boolean;
  loss: number;
  doubted: boolean;
  target: string | null;
  proposed: string | null;
  pinned: string | null;
  /** Points of its route that it has passed. */
  passed: number;
  eta_s: number | null;
  /** Stage of its upload; empty for none. */
  upload: string;
  failed: boolean;
  verified: boolean;
  lost_at: Point | null;
}

export interface Target {
  name: string;
  existence: number;
  at: Point;
  speed_m_s: number;
  agents: string[];
  reached_by: string[];
  ignored: boolean;
  /** Null: that of the mission file. */
  priority: number | null;
  pinned: string[];
}

export interface Route {
  id: number;
  target: string;
  points: Point[];
  length_m: number;
  /** Centre of the loiter at its end, if that is elsewhere. */
  wait: Point | null;
}

export interface Proposal {
  id: number;
  reason: string;
  age_s: number;
  routes: ProposedRoute[];
}

/** Figures are missing while they are not computed. */
export interface ProposedRoute extends Route {
  name: string;
  shown_length_m?: number | null;
  arrival_s?: number | null;
  /** Null: it flies alone. */
  separation_m?: number | null;
  clearance_m?: number | null;
  short?: boolean;
}

export interface ObstacleMap {
  /** Centre of the first cell. */
  origin_m: Point;
  spacing_m: number;
  shape: [rows: number, columns: number];
  /** One bit for each cell, row by row from the south, in base64. */
  blocked: string;
}

export type Disc = [east: number, north: number, radius: number];

/** A disc, or a polygon. */
export type Zone = { name: string; disc: Disc; polygon: [] } | { name: string; disc: null; polygon: Point[] };

/** Columns of one value for each track. */
export interface Tracks {
  names: string[];
  /** East, north, and their rates. */
  means: [east: number, north: number, east_m_s: number, north_m_s: number][];
  covs: Covariance[];
  existence: number[];
  estimated: boolean[];
}

export type Covariance = [east_east: number, east_north: number, north_north: number];

export interface Scan {
  sensor: string;
  /** East and north in turns. */
  z: number[];
}

export type FieldOfView = { box: [west: number, south: number, east: number, north: number] } | Sector;

export interface Sector {
  box?: undefined;
  at: Point;
  range_m: [near: number, far: number];
  /** Clockwise from north. */
  bearing_rad: [centre: number, half: number];
}

export type Level = "alarm" | "warning" | "info";

export interface LogEntry {
  /** Counts up. */
  n: number;
  t_s: number;
  level: Level;
  text: string;
  /** Kind of its effect, or of its mark. */
  kind: string;
  /** Code of its notice: an entry of the page of alarms. */
  code: string;
  /** Identity of the condition that it tells of. */
  key: string;
  /** Conditions that it ends. */
  ends: string[];
  vehicle: number | null;
}

export interface Answer {
  order_id: string;
  t_s: number;
  action: string;
  state: string;
  detail: string;
  /** Null: about the whole order. */
  vehicle: string | null;
  /** Vehicles whose answers are awaited. */
  waiting: string[];
}

// api/vehicles/{name}

export interface VehicleDetail {
  id: number;
  name: string;
  t_s: number;
  /** The one that prevails first. */
  claims: { authority: string; reason: string; since_s: number }[];
  link: {
    state: string;
    address: string | null;
    signed: boolean;
    frames: number;
    lost: number;
    conflicts: number;
    autopilot: string;
    reboots: number;
  };
  mission: OnboardMission | null;
  upload: { stage: string; since_s: number | null; failures: number; pause_s: number };
  pinned: string | null;
  return: { height: string; problem: string };
  takeoff_problem: string;
  position: { doubted: boolean; cusum: number; alarm_cusum: number; refused: Record<string, number> };
}

export interface OnboardMission {
  target: string;
  items: MissionItem[];
  /** Item with the first point of the route. */
  first: number;
  current: number | null;
  verified_s: number | null;
  inconsistent: boolean;
  audited: boolean;
}

export interface MissionItem {
  seq: number;
  command: string;
  at: Point | null;
  alt_m: number | null;
}

// api/marks

export interface MarksReply {
  complete: boolean;
  marks: Mark[];
}

export interface Mark {
  t_s: number;
  kind: MarkKind;
  text: string;
}

export type MarkKind = "lost" | "down" | "arrived" | "plan" | "upload" | "alarm" | "order" | "ended";

// api/charts

/** Values by bin, null for empty bins. */
export interface ChartData {
  width_s: number;
  bins: number;
  objects: Partial<Record<ObjectKind, Series>>;
  spread: Partial<Record<ObjectKind, Series>>;
  true: Partial<Record<ObjectKind, Series>>;
  ospa: Partial<Record<ObjectKind, Series>>;
  existence: Record<ObjectKind, Record<string, Series>>;
  rate: Record<string, Series>;
  loss: Record<string, Series>;
  battery: Record<string, Series>;
  work: Partial<Record<"scan" | "plan", Series>>;
  complete: boolean;
}

export type Series = (number | null)[];

// api/preflight

export interface PreflightReply {
  possible: boolean;
  running: boolean;
  result: PreflightResult | null;
}

export type PreflightResult =
  | { at_ms: number; error: string }
  | { at_ms: number; error?: undefined; refused: number; warnings: number; checks: Check[] };

export interface Check {
  /** Null: of the mission. */
  vehicle: number | null;
  name: string;
  level: "ok" | "warning" | "refused";
  value: string;
  wanted: string;
  remedy: string;
}

// Replies to orders and requests

export interface OrderReply {
  order_id: string;
}

export interface ErrorReply {
  error: string;
}
