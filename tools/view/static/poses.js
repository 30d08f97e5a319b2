// Poses in numbers: where each target's point is now, and where it should go, which can be entered.

import { at, make, write } from "./panels.js";

const DEG = 180 / Math.PI;
const AXES = ["x", "y", "z", "roll", "pitch", "yaw"];

/** Of these six, those that a kind of target has. */
const PARTS = { com: [0, 3], frame_position: [0, 3], frame_orientation: [3, 6], frame_pose: [0, 6] };

/** Roll, pitch and yaw about the fixed axes x, y, z [deg], as in a URDF, of a quaternion x y z w. */
export function rollPitchYaw([x, y, z, w]) {
  const sine = Math.max(-1, Math.min(1, 2 * (w * y - z * x)));
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * DEG,
    Math.asin(sine) * DEG,
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * DEG,
  ];
}

/** The quaternion x y z w of roll, pitch and yaw [deg]. */
export function quaternion([roll, pitch, yaw]) {
  const [cr, cp, cy] = [roll, pitch, yaw].map((each) => Math.cos(each / DEG / 2));
  const [sr, sp, sy] = [roll, pitch, yaw].map((each) => Math.sin(each / DEG / 2));
  return [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy];
}

/** Numbers of a target as people read them: m and degrees. */
function readable([from, to], values) {
  return [...(from < 3 ? values.slice(0, 3) : []), ...(to > 3 ? rollPitchYaw(values.slice(-4)) : [])];
}

const decimals = (i) => (i < 3 ? 4 : 2);

/** One pose: its numbers now and, of a target that can move, a field for each. */
class Pose {
  /**
   * @param {string} name
   * @param {string} reference in whose axes the numbers are
   * @param {number[]} parts as in PARTS
   * @param {((values: number[]) => void)|null} send
   */
  constructor(name, reference, parts, send) {
    Object.assign(this, { name, parts, known: false, values: null, asked: "", editing: false });
    const places = AXES.map((_, i) => i).slice(...parts);
    this.now = places.map(() => make("output", { textContent: "–" }));
    this.fields = !send ? [] : places.map((i) => {
      const field = make("input", { type: "number", step: i < 3 ? 0.001 : 1, disabled: true });
      field.setAttribute("aria-label", `Target ${name} ${AXES[i]}`);
      field.addEventListener("input", () => (this.editing = true));
      return field;
    });
    const title = (text, scope) => make("th", { textContent: text, scope });
    const head = make("tr", {}, make("td"), title("now", "col"), ...(send ? [title("target", "col")] : []));
    const rows = places.map((axis, i) => {
      const cells = [this.now[i], ...this.fields.slice(i, i + 1)].map((each) => make("td", {}, each));
      return make("tr", {}, title(`${AXES[axis]} [${axis < 3 ? "m" : "deg"}]`, "row"), ...cells);
    });
    this.buttons = [];
    if (send) {
      const go = make("button", { type: "button", textContent: "Move to target", disabled: true });
      const copy = make("button", { type: "button", textContent: "Copy current", disabled: true });
      copy.addEventListener("click", () => this.copy());
      go.addEventListener("click", () => this.#send(send));
      for (const field of this.fields) field.addEventListener("keydown", (event) => event.key === "Enter" && go.click());
      this.buttons = [go, copy];
    }
    const caption = make("caption", {}, name, make("small", { textContent: ` in ${reference}` }));
    this.box = make("div", { className: "pose", role: "group", ariaLabel: name }, make("table", {}, caption, head, ...rows));
    if (send) this.box.append(make("p", { className: "actions" }, ...this.buttons));
  }

  /**
   * @param {number[]|null} values where the point is
   * @param {number[]} [asked] where the target was sent last from a page of this server
   */
  show(values, asked) {
    if (!values) return;
    this.values = readable(this.parts, values);
    const from = this.parts[0];
    this.now.forEach((each, i) => write(each, this.values[i].toFixed(decimals(i + from))));
    if (!this.known) this.#enter(this.values);
    this.known = true;
    if (!asked || this.editing || String(asked) === this.asked) return;
    this.asked = String(asked);
    this.#enter(readable(this.parts, asked));
  }

  /** Puts the pose of now into the fields. */
  copy() {
    if (!this.values) return; // not known yet
    this.editing = true;
    this.#enter(this.values);
  }

  #enter(values) {
    const from = this.parts[0];
    this.fields.forEach((field, i) => (field.value = values[i].toFixed(decimals(i + from))));
  }

  arm(on) {
    if (!on) Object.assign(this, { known: false, asked: "", editing: false });
    for (const each of [...this.fields, ...this.buttons]) each.disabled = !on;
  }

  #send(send) {
    const numbers = this.fields.map((field) => field.valueAsNumber);
    if (numbers.some(Number.isNaN)) return; // an empty field
    const [from, to] = this.parts;
    send([...(from < 3 ? numbers.slice(0, 3) : []), ...(to > 3 ? quaternion(numbers.slice(-3)) : [])]);
  }
}

/** Of each target that has a pose; of a controller without one, of the points of its tasks. */
export class Poses {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {() => boolean} isFree whether nothing else moves a target
   * @param {(error: string|null) => void} answered
   */
  constructor(connection, isFree, answered) {
    Object.assign(this, { connection, isFree, answered, all: [], armed: false, ofTasks: true });
  }

  #send(name, values) {
    if (!this.isFree()) return this.answered("another target is being moved");
    this.connection.act({ verb: "place", name, values }, (error) => {
      if (error === null) for (const each of this.all) if (each?.name === name) each.editing = false;
      this.answered(error);
    });
  }

  /**
   * @param {object[]} targets of `hello` or `changed`
   * @param {object} frame the newest
   */
  set(targets, frame) {
    this.ofTasks = !targets.some(({ kind }) => kind in PARTS);
    this.all = this.ofTasks
      ? frame.frames.map(({ name }) => new Pose(name, "the world", PARTS.frame_pose, null))
      : targets.map(({ name, kind, reference }) => {
          if (!(kind in PARTS)) return null;
          const send = (values) => this.#send(name, values);
          return new Pose(name, reference ?? "the world", PARTS[kind], send);
        });
    at("poses").replaceChildren(...this.all.filter(Boolean).map(({ box }) => box));
    at("pose").hidden = this.all.every((each) => !each);
    this.arm(this.armed);
  }

  /** @param {object} frame */
  show(frame) {
    const values = this.ofTasks ? frame.frames.map(({ pose }) => pose) : (frame.targets ?? []);
    this.all.forEach((each, i) => each?.show(values[i] ?? null, frame.asked?.[each.name]));
  }

  /** Whether a pose can be entered. */
  arm(on) {
    this.armed = on;
    for (const each of this.all) each?.arm(on);
  }
}
