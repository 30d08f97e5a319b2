// Driving a target by gamepad, keyboard or the pad of the page, while a dead-man button is held.

import { Vector3 } from "./vendor.js";
import { at, ignoreRestingTouch, make, write } from "./panels.js";

const FULL = { linear: 0.25, angular: 1.0 }; // m/s and rad/s at 100 %
const EACH_MS = 1000 / 30;
const DEAD_ZONE = 0.12; // of a stick, which seldom comes back to 0

/** Which of vx, vy, vz, wx, wy, wz a key asks for, and which way. */
const KEYS = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyR: [2, 1], KeyF: [2, -1],
  KeyU: [3, 1], KeyO: [3, -1], KeyI: [4, 1], KeyK: [4, -1], KeyJ: [5, 1], KeyL: [5, -1],
};
const ARROWS = { "+x": "KeyW", "−x": "KeyS", "+y": "KeyA", "−y": "KeyD", "+z": "KeyR", "−z": "KeyF" };
const TURNS = { "↺ x": "KeyU", "↻ x": "KeyO", "↺ y": "KeyI", "↻ y": "KeyK", "↺ z": "KeyJ", "↻ z": "KeyL" };
const DEAD_MEN = new Set(["ShiftLeft", "ShiftRight", "dead-man"]);

/** Of the six, those that a kind of target takes. */
const TAKES = { frame_position: [0, 3], com: [0, 3], frame_pose: [0, 6], frame_orientation: [3, 6] };

/** A stick past its dead zone, gentle near the middle. */
function stick(value) {
  const past = Math.max(0, Math.abs(value) - DEAD_ZONE) / (1 - DEAD_ZONE);
  return Math.sign(value) * past ** 2;
}

const NOTHING = { held: false, stop: false, asked: [0, 0, 0, 0, 0, 0] };

/** Those that are there: off loopback, without TLS, browsers have no gamepads at all. */
function pads() {
  return [...(navigator.getGamepads?.() ?? [])].filter((each) => each?.connected);
}

/** A gamepad of the "standard" layout of the Gamepad API. */
function readPad({ axes, buttons }) {
  const pressed = (i) => buttons[i]?.value ?? 0;
  return {
    held: pressed(4) > 0.5, // LB
    stop: pressed(1) > 0.5, // B
    asked: [
      -stick(axes[1]), -stick(axes[0]), pressed(7) - pressed(6),
      pressed(15) - pressed(14), stick(axes[3] ?? 0), -stick(axes[2] ?? 0),
    ],
  };
}

export class Teleop {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {{stop: () => void, driving: (on: boolean) => void, turn: (name: string, three: number[], tool: boolean) => number[]}} page
   */
  constructor(connection, page) {
    Object.assign(this, { connection, page, armed: false, watching: false, driving: false, mustRelease: false });
    this.stopping = false; // whether B is held, which asks once
    this.held = new Set(); // keys, and buttons of the page
    addEventListener("keydown", (event) => this.#key(event));
    addEventListener("keyup", ({ code }) => this.held.delete(code));
    addEventListener("blur", () => this.letGo());
    document.addEventListener("visibilitychange", () => this.letGo());
    addEventListener("gamepaddisconnected", () => this.letGo());
    addEventListener("gamepadconnected", () => this.#poll());
    ignoreRestingTouch(at("drive-speed"));
    for (const each of ["drive-speed", "drive-target"]) at(each).addEventListener("input", () => this.#speed());
    this.#holds(at("dead-man"), "dead-man");
    this.buttons = Object.entries({ ...ARROWS, ...TURNS }).map(([label, code]) => {
      const button = make("button", { type: "button", textContent: label, disabled: true });
      if (label in TURNS) button.setAttribute("aria-label", `Rotate ${label}`);
      this.#holds(button, code);
      at("arrows").append(button);
      return { button, axis: KEYS[code][0] };
    });
    this.#speed();
  }

  /** @param {object[]} targets those that can be driven are offered */
  set(targets) {
    this.targets = targets.filter(({ kind }) => kind in TAKES);
    const chosen = at("drive-target").value;
    at("drive-target").replaceChildren(
      ...this.targets.map(({ name }) => make("option", { value: name, textContent: name, selected: name === chosen })),
    );
    at("drive").hidden = this.targets.length === 0;
    this.#speed();
  }

  /** Whether this page may stop the robot: then B of a gamepad does, whoever steers. */
  watch(on) {
    this.watching = on;
    if (on) this.#poll();
  }

  /** Whether this page may drive. */
  arm(on) {
    this.armed = on;
    for (const button of at("drive").querySelectorAll("button")) button.disabled = !on;
    if (!on) this.letGo();
    else this.#poll();
  }

  /** At once, and a button that is still held must be let go before it counts again. */
  letGo() {
    this.held.clear();
    this.mustRelease = true;
    if (!this.driving) return;
    this.driving = false;
    this.connection.act({ verb: "drop" });
    this.#tell();
  }

  get #tool() {
    return at("drive-frame").value === "tool";
  }

  get #scale() {
    return at("drive-speed").valueAsNumber / 100;
  }

  get #target() {
    return this.targets?.find(({ name }) => name === at("drive-target").value);
  }

  /** In the units of what the chosen target takes. */
  #speed() {
    const [from, to] = TAKES[this.#target?.kind] ?? [0, 6];
    const linear = from < 3 ? [`${(FULL.linear * this.#scale).toFixed(2)} m/s`] : [];
    const angular = to > 3 ? [`${(FULL.angular * this.#scale).toFixed(2)} rad/s`] : [];
    write(at("drive-speed-text"), [...linear, ...angular].join(", "));
    for (const { button, axis } of this.buttons) button.hidden = axis < from || axis >= to;
  }

  #tell() {
    at("dead-man").classList.toggle("held", this.driving);
    this.page.driving(this.driving);
  }

  #key(event) {
    if (!this.armed || event.ctrlKey || event.altKey || event.metaKey) return;
    if (!(event.code in KEYS) && !DEAD_MEN.has(event.code)) return;
    if (event.code in KEYS && event.shiftKey) event.preventDefault(); // not a letter to a list
    if (event.repeat) return; // held since before the page let go
    this.held.add(event.code);
    this.#poll();
  }

  #holds(button, code) {
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      this.held.add(code);
      this.#poll();
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      button.addEventListener(end, () => this.held.delete(code));
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault()); // a long touch
  }

  /** Looks some 30 times a second while there is something to look at, however slowly pictures come. */
  #poll() {
    if (this.polling) return;
    this.polling = true;
    setTimeout(() => {
      this.polling = false;
      const [pad] = pads();
      write(at("pad-name"), pad ? pad.id.slice(0, 40) : "no gamepad");
      const read = pad ? readPad(pad) : NOTHING;
      this.#stop(read);
      this.#drive(read);
      if ((this.watching && pad) || (this.armed && (this.held.size > 0 || this.driving))) this.#poll();
    }, EACH_MS);
  }

  #stop({ stop }) {
    const now = stop && this.watching;
    if (now && !this.stopping) this.page.stop();
    this.stopping = now;
  }

  #drive({ held: padHeld, asked }) {
    const held = padHeld || [...this.held].some((code) => DEAD_MEN.has(code));
    if (!padHeld) this.mustRelease = false;
    else if (!this.armed) this.mustRelease = true; // held since before
    const target = this.#target;
    if (!this.armed || !held || !target || (padHeld && this.mustRelease) || !document.hasFocus()) {
      if (this.driving) this.letGo();
      return;
    }
    const six = [...asked];
    for (const code of this.held) if (KEYS[code]) six[KEYS[code][0]] += KEYS[code][1];
    if (!this.driving && six.every((each) => each === 0)) return; // Shift alone drives nothing
    if (!this.driving) {
      this.driving = true;
      this.#tell();
    }
    this.connection.act({ verb: "velocity", name: target.name, values: this.#velocity(six, target) });
  }

  /** In the axes of the target's numbers, in m/s and rad/s. */
  #velocity(six, { name, kind }) {
    const part = (from, full) => {
      const three = new Vector3(...six.slice(from, from + 3)).clampLength(0, 1).multiplyScalar(full * this.#scale);
      return this.page.turn(name, three.toArray(), this.#tool);
    };
    return [...part(0, FULL.linear), ...part(3, FULL.angular)].slice(...TAKES[kind]);
  }
}
