// Sliders for a target that is joint positions: there is no one place of it where a handle could stand.

import { gripped, moved } from "./grip.js";
import { at, ignoreRestingTouch, make, write } from "./panels.js";

const ENDS = ["pointerup", "pointercancel", "keyup", "blur"];

/** A posture target; to the hand it is what a target with a marker is. */
export class Posture {
  gizmos = [];
  known = false;
  dragged = false;

  /**
   * @param {object} told the target, as of `hello` or `changed`
   * @param {{name, lower, upper, unit}[]} joints of the robot
   * @param {import("./targets.js").Targets} hand
   */
  constructor(told, joints, hand) {
    this.name = told.name;
    const grip = { pointerUp: () => this.dragged && hand.grip(this, grip, false) };
    this.rows = told.joints.map((place) => {
      const { name, lower, upper, unit } = joints[place];
      const turns = lower === null || upper === null; // without limits: half a turn either way
      const input = make("input", { type: "range", disabled: true });
      const shown = make("output");
      input.step = "any"; // one is moved, and the others stay exactly where they are
      if (!turns) [input.min, input.max] = [lower, upper];
      const show = () => write(shown, `${input.valueAsNumber.toFixed(2)} ${unit}`);
      ignoreRestingTouch(input);
      input.addEventListener("input", () => {
        show();
        hand.grip(this, grip, true);
        hand.pull(this);
      });
      for (const end of ENDS) input.addEventListener(end, grip.pointerUp);
      const row = make("label", { className: "setting" }, make("span", { textContent: name }), input, shown);
      return { row, input, show, turns };
    });
    at("postures").append(...this.rows.map(({ row }) => row));
  }

  /** Where it is from now on counts from here. */
  grip(asked) {
    this.start = gripped(this.shown, asked);
  }

  get values() {
    const now = this.rows.map(({ input }) => input.valueAsNumber);
    return moved(now, this.start);
  }

  /** @param {number[]|null} values */
  move(values) {
    this.known = Boolean(values);
    if (!values || this.dragged) return;
    this.shown = values;
    this.rows.forEach(({ input, show, turns }, i) => {
      if (turns) [input.min, input.max] = [values[i] - Math.PI, values[i] + Math.PI];
      input.value = values[i];
      show();
    });
  }

  arm(on) {
    for (const { input } of this.rows) input.disabled = !(on && this.known);
  }

  remove() {
    for (const { row } of this.rows) row.remove();
  }
}
