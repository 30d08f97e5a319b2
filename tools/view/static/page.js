// The page: takes what the server sends to those who show it, and what the hand asks for to the server.

import { Connection } from "./connection.js";
import { BLUE, eachScheme } from "./colours.js";
import { Overlays } from "./overlays.js";
import { addEvent, at, Joints, showState, showVerdicts, Sliders, write } from "./panels.js";
import { Plots } from "./plots.js";
import { Poses } from "./poses.js";
import { discard, Robot } from "./robot.js";
import { Stage } from "./scene.js";
import { canMove, Targets } from "./targets.js";
import { Teleop } from "./teleop.js";
import { Timeline } from "./timeline.js";

const OLD_MS = 500; // a picture of a running robot that is older than this says so …
const OLD_FRAMES = 5; // … or than so many frames of a slow robot, which sends one State of 16
const SAMPLED = 16;
const TROUBLE_MS = 10000; // how long the note says what went wrong
const TEXT_MS = 100; // between two changes of the text
const MOST_DRAWN = 4096;

let robot, ghost, overlays, joints, plots, timeline;
let known = false; // whether the robot is the one that was shown before
let steering = false; // whether this page is the operator
let releasing = false; // whether it has asked not to be
let cameAt_ms = 0; // when the last frame came
let wrote_ms = 0;
let undrawn = null; // the frame that the next picture shows first
let trouble = { words: "", until_ms: 0 }; // what was refused, or ended, last

const stage = new Stage(at("stage"));
const connection = new Connection(location.hash.slice(1));
const targets = new Targets(stage, connection);
const sliders = new Sliders(connection);
const poses = new Poses(connection, () => page.acting === null, answered);
const teleop = new Teleop(connection, {
  stop: () => stop(),
  driving: (on) => targets.arm(steering && !on),
  turn: (name, three, tool) => targets.find(name)?.turn(three, tool) ?? three,
});

/** What tests look at. */
const page = (window.hoap3 = {
  drawn: [],
  hello: null,
  frame: null,
  told: null,
  get tick() {
    return this.drawn.at(-1)?.tick;
  },
  get poses() {
    return robot?.drawn() ?? {};
  },
  get ghost() {
    return ghost?.drawn() ?? {};
  },
  get proved() {
    return connection.proved;
  },
  get acting() {
    return targets.dragged ? "drag" : teleop.driving ? "drive" : null;
  },
  gizmo: (name) => targets.gizmo(name),
});

stage.onDrawn = () => {
  if (!undrawn) return;
  const { tick, stamp_ns } = undrawn;
  undrawn = null;
  page.drawn.push({ tick, stamp_ns, shown_ms: performance.timeOrigin + performance.now() });
  if (page.drawn.length > MOST_DRAWN) page.drawn.shift();
};

/** Everything anew: the page was just opened, or the server is another one. */
function greet(hello) {
  known = JSON.stringify(page.hello?.links) === JSON.stringify(hello.links);
  page.hello = hello;
  page.frame = null;
  cameAt_ms = performance.now(); // a robot that says nothing from now on is told, too
  steering = false;
  for (const old of [robot, ghost, overlays]) if (old) discard(old);
  overlays = undefined;
  const loaded = () => stage.change();
  robot = new Robot(hello.links, loaded);
  ghost = hello.log?.second || hello.second ? new Robot(hello.links, loaded, BLUE) : undefined;
  stage.scene.add(robot);
  if (ghost) stage.scene.add(ghost);
  at("ghost-key").hidden = !ghost;
  write(at("robot"), hello.robot);
  document.title = `${hello.robot} · hoap3 view`;
  write(at("config"), hello.config ?? "");
  joints = new Joints(hello.joints);
  if (hello.log) at("events").replaceChildren();
  for (const note of hello.notes ?? []) addEvent({ label: note });
  for (const event of hello.log?.events ?? []) addEvent(event);
  timeline = hello.log ? new Timeline(hello.log, connection) : undefined;
  plots = new Plots(at("plots"), at("certificate-plots"), hello, (at_s) => timeline?.seek(at_s));
  for (const each of at("key").querySelectorAll("[data-of]")) each.hidden = true;
  at("buttons").hidden = at("drive").hidden = Boolean(hello.log);
  for (const fact of ["holder", "operator"]) at(fact).parentElement.hidden = Boolean(hello.log);
  take({ changeable: [], targets: [], ...hello });
  say();
}

/** More of a log is known: one pass through the file goes on while it is shown. */
function learn({ log }) {
  const { hello } = page;
  if (!hello?.log) return;
  for (const event of log.events.slice(hello.log.events.length)) addEvent(event);
  hello.log = { ...hello.log, ...log };
  timeline.learn(hello.log);
  plots.learn(hello.log);
  say();
}

/** Something happened; what whoever steers here must know stands in the note, too. */
function happened(event) {
  addEvent(event);
  if (event.at_s == null && event.severity !== "info") complain(event.label);
}

/** What can be changed and dragged, at the start or when the controller's answer differs. */
function take({ changeable, targets: told }) {
  if (changeable) sliders.set(changeable);
  if (!told) return;
  page.targets = told;
  if (overlays) place(told); // else with the first frame: only then its size is known
  teleop.set(page.hello.log ? [] : told);
}

/** Handles and fields for these targets. */
function place(told) {
  targets.set(told, robot, page.hello.joints);
  poses.set(page.hello.log ? [] : told, page.frame);
}

/** Lists in the legend what this robot has shown so far. */
function explain(frame) {
  for (const each of at("key").querySelectorAll("[data-of][hidden]")) {
    const value = frame[each.dataset.of];
    if (Array.isArray(value) ? value.some((one) => one !== null) : value) each.hidden = false;
  }
}

function show(frame) {
  page.frame = frame;
  cameAt_ms = performance.now();
  robot.move(frame.poses);
  if (ghost && frame.ghost) ghost.move(frame.ghost);
  if (!overlays) {
    if (!known) stage.frame(robot); // else whoever looks has chosen from where
    overlays = new Overlays(page.hello, robot, stage.span);
    stage.scene.add(overlays);
    place(page.targets);
  }
  overlays.move(frame);
  targets.move(frame);
  plots.push(frame);
  timeline?.show(frame);
  undrawn = frame;
  stage.change();
  allow();
  if (cameAt_ms - wrote_ms < TEXT_MS && page.hello.live) return;
  wrote_ms = cameAt_ms;
  showState(frame);
  showVerdicts(frame.verdicts, page.hello.stands);
  joints.show(frame);
  poses.show(frame);
  explain(frame);
}

/** Buttons, handles and sliders: as much as this page may do now. */
function allow() {
  const live = connection.proved && !page.hello?.log;
  const now = live && page.frame?.operator === "me";
  at("steer").disabled = !live || (!now && !page.targets?.some(canMove));
  if (live !== page.allowed) {
    page.allowed = live;
    at("stop").disabled = Boolean(page.hello?.log);
    at("stop").classList.toggle("muted", !live);
    sliders.enable(live);
    teleop.watch(live);
  }
  const movable = now && page.frame?.mode === "active";
  if (movable !== poses.armed) poses.arm(movable);
  at("recover").disabled = !live || page.frame?.mode !== "stopped";
  if (now === steering) return;
  steering = now;
  const told = trouble.words && performance.now() < trouble.until_ms; // mostly the reason
  if (!now && !releasing && connection.proved && !told) complain("This page is no longer the operator.");
  releasing = false;
  connection.beat(now);
  write(at("steer"), now ? "Release" : "Steer");
  at("steer").setAttribute("aria-pressed", String(now));
  targets.arm(now);
  teleop.arm(now);
  say();
}

/** Says for a while what was refused or ended; null: nothing was. */
function complain(words) {
  trouble = { words: words ?? "", until_ms: performance.now() + TROUBLE_MS };
  say();
}

/** The line below the buttons: why this page only looks, or what was refused. */
function say() {
  const { hello } = page;
  const bad = trouble.words && performance.now() < trouble.until_ms;
  let words = "";
  if (!hello) words = "";
  else if (hello.log?.done === false) words = "Reading the log: curves, events and worst ticks are not complete yet.";
  else if (bad) words = trouble.words;
  else if (hello.log) words = "This is a log.";
  else if (!connection.proved) words = readOnly();
  else if (page.frame?.mode === "stopped") words = "The robot is stopped. Press Recover before you move it.";
  else if (steering) words = "You are the operator: drag a handle or a slider, enter a pose, or hold to drive.";
  else if (page.targets?.some(canMove)) words = "Press Steer to move the robot's targets.";
  else if (page.targets?.length) words = "These targets have no handle: send them from a program, see `hoap3 help live`.";
  else if (page.frame?.holder) words = "This controller has no live target: see `hoap3 help live`.";
  else words = "No controller commands the robot.";
  write(at("note"), words);
  at("note").title = words;
  at("note").classList.toggle("refused", Boolean(bad) && words === trouble.words);
}

/** Why this page cannot command the robot, and what to do. */
function readOnly() {
  if (!page.hello?.writes) return "Read-only: hoap3 view was started without commands.";
  if (!connection.token) return "Read-only: the address has no token. Open the address that hoap3 view printed.";
  if (page.refused) return "Read-only: the token in the address is wrong. Open the address that hoap3 view printed.";
  const open = connection.socket.readyState === WebSocket.OPEN;
  return open ? "Checking the token." : "No connection to the server of this page.";
}

/** The banner over the picture: how old it is when none comes. */
function warn() {
  say();
  const age_ms = performance.now() - cameAt_ms;
  const closed = connection.socket.readyState !== WebSocket.OPEN;
  const each_ms = 1000 * SAMPLED * (page.hello?.period_s ?? 0);
  const old = page.hello?.live && age_ms > Math.max(OLD_MS, OLD_FRAMES * each_ms);
  at("banner").hidden = !closed && !old;
  if (at("banner").hidden) return;
  const [why, age] = at("banner").children;
  write(why, closed ? "No connection; trying again." : "No frames come.");
  write(age, page.frame ? `The picture is ${(age_ms / 1000).toFixed(1)} s old.` : "");
}

function ask(verb) {
  connection.act({ verb }, answered);
}

/** Stops the robot; a page that cannot explains why, and what can. */
function stop() {
  if (connection.proved) ask("stop");
  else complain(`Not stopped. ${readOnly()} Or run: hoap3 stop ${page.hello?.robot ?? ""}`);
}

function answered(error) {
  complain(error === null ? null : `Refused: ${error}`);
}

let pressed; // the pointer that has pressed Stop
at("stop").addEventListener("pointerdown", ({ pointerId }) => {
  pressed = pointerId;
  stop();
});
// Keys and screen readers click without a pointer; a tap that ends a scroll presses without a click.
at("stop").addEventListener("click", ({ pointerId }) => pointerId !== pressed && stop());
at("recover").addEventListener("click", () => ask("recover"));
at("steer").addEventListener("click", () => {
  if (steering) {
    releasing = true;
    return connection.act({ verb: "release" }, (error) => {
      if (error !== null) releasing = false;
      answered(error);
    });
  }
  connection.beat(true); // from now on: the answer may take longer than silence is borne
  connection.act({ verb: "acquire" }, (error) => {
    if (error !== null) connection.beat(false);
    answered(error);
  });
});
at("drive-frame").addEventListener("change", ({ target }) => targets.space(target.value === "world" ? "world" : "local"));
// Stop before anything else that these keys mean, wherever the focus is.
for (const kind of ["keydown", "keyup"]) {
  const stops = (event) => {
    if (at("stop").disabled || (event.code !== "Escape" && event.code !== "Space")) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (kind === "keydown" && !event.repeat) stop();
  };
  addEventListener(kind, stops, { capture: true });
}

const takers = {
  hello: greet,
  frame: show,
  event: happened,
  log: learn,
  changed: take,
  proved: ({ ok }) => {
    page.refused = !ok;
    allow();
    say();
  },
  told: (told) => {
    page.told = told;
    take(told.now ?? {});
  },
  closed: () => {
    allow();
    say();
  },
};
for (const [kind, taker] of Object.entries(takers)) {
  connection.addEventListener(kind, ({ detail }) => taker(detail));
}
eachScheme(() => plots?.repaint());
setInterval(warn, 200);
