// Start of the console: the parts of the page, and what connects them.

/**
 * @import { Comparison } from "./compare.js"
 * @import { Actions } from "./keyboard.js"
 */

import { Alarms } from "./alarms_panel.js";
import { Charts } from "./charts_panel.js";
import { showKeys } from "./dialogs.js";
import { part } from "./dom.js";
import { showLog } from "./event_log.js";
import { Feed } from "./feed.js";
import { Freshness, showOld } from "./freshness.js";
import { showHeader } from "./header.js";
import { Profile } from "./height_profile.js";
import { KEYS, listenToKeys } from "./keyboard.js";
import { SwarmMap } from "./map.js";
import { Orders } from "./order_sending.js";
import { Panels } from "./panels.js";
import { Plan } from "./proposed_plan.js";
import { Replay } from "./replay_bar.js";
import { Marks } from "./run_marks.js";
import { Selection } from "./selection.js";
import { TargetOrders } from "./target_orders.js";
import { showTargets } from "./targets_panel.js";
import { Theme } from "./theme.js";
import { Detail } from "./vehicle_details.js";
import { Commands } from "./vehicle_orders.js";
import { showVehicles } from "./vehicle_table.js";
import { Zones } from "./zone_dialog.js";

const parent = /** @type {Window & { comparison?: Comparison }} */ (window.parent);
const { comparison } = parent; // of two recordings: each page is in a frame
const PAN_PX = 60;

const feed = new Feed();
feed.connect(); // its first data comes after all below is built
const theme = new Theme();
const selection = new Selection();
const orders = new Orders(feed);
const map = new SwarmMap(part("map"), feed, selection, theme);
const zones = new Zones(map, feed, orders);
const panels = new Panels(part("panel"));
const freshness = new Freshness(feed);
const alarms = new Alarms(part("alarms"), feed, panels);
const commands = new Commands(part("commands"), feed, selection, orders, () => zones.open());
const targetOrders = new TargetOrders(part("target-orders"), feed, selection, orders, commands);
const plan = new Plan(part("plan"), feed, orders, commands);
const marks = new Marks(feed);
const replay = comparison?.replay ?? new Replay(part("replay"), feed, marks, theme);
const charts = new Charts(part("charts"), feed, marks, selection, theme, panels, (at) => replay.seek(at));

const help = () => showKeys(KEYS);
new Detail(part("detail"), feed, selection, map, panels);
new Profile(part("profile"), feed, selection, map, panels, theme);
showHeader(part("head"), feed, theme, freshness, help);
showOld(part("map"), freshness);
showVehicles(part("vehicles"), feed, selection);
showTargets(part("targets"), feed, map, selection, zones);
showLog(part("log"), feed);

const { motion } = map;

/**
 * @param {number} dx
 * @param {number} dy
 */
const pan = (dx, dy) => () => motion.pan(dx, dy);

/**
 * @param {() => void} action
 * @param {() => void} live
 */
const inReplay = (action, live) => () => (replay.isShown ? action() : live());

/** @type {Actions} */
const actions = {
  space: () => commands.give("hold"),
  "shift+space": () => commands.holdAll(),
  r: () => commands.give("resume"),
  b: () => commands.give("return"),
  a: () => commands.give("arm"),
  d: () => commands.give("disarm"),
  c: () => plan.focus("confirm"),
  x: () => plan.focus("reject"),
  k: () => alarms.acknowledgeWorst(),
  n: () => {
    if (commands.mayOperate) zones.open();
  },
  z: () => motion.fitSwarm(),
  0: () => motion.fitArea(),
  f: () => motion.toggleFollow(),
  l: () => map.toggleLayers(),
  g: () => panels.toggle("charts"),
  h: () => panels.toggle("profile"),
  w: () => charts.zoom(),
  m: () => map.measure(),
  p: inReplay(
    () => replay.toggle(),
    () => targetOrders.pin(),
  ),
  t: () => targetOrders.selectNext(1),
  "shift+t": () => targetOrders.selectNext(-1),
  i: () => targetOrders.toggleIgnored(),
  ",": inReplay(
    () => replay.jump(-1),
    () => targetOrders.changePriority(-1),
  ),
  ".": inReplay(
    () => replay.jump(1),
    () => targetOrders.changePriority(1),
  ),
  u: () => targetOrders.unpin(),
  v: () => panels.toggle("detail"),
  "+": () => motion.zoom(1.4),
  "-": () => motion.zoom(1 / 1.4),
  home: () => replay.seek(0),
  end: () => replay.seek(replay.duration),
  "shift+arrowleft": inReplay(() => replay.step(-30), pan(PAN_PX, 0)),
  "shift+arrowright": inReplay(() => replay.step(30), pan(-PAN_PX, 0)),
  arrowleft: inReplay(() => replay.step(-5), pan(PAN_PX, 0)),
  arrowright: inReplay(() => replay.step(5), pan(-PAN_PX, 0)),
  arrowup: pan(0, PAN_PX),
  arrowdown: pan(0, -PAN_PX),
  "?": help,
  escape: () => {
    if (!map.escape()) selection.clear();
  },
};

listenToKeys(actions, feed, selection);
document.documentElement.classList.toggle("framed", comparison !== undefined);
comparison?.add(window.frameElement, { feed, map, marks, selection, actions });
