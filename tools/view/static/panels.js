// What the page says in words: state, verdicts, joints, settings, events, configuration.

/** @returns {HTMLElement} */
export const at = (id) => document.getElementById(id);

/** Makes an element with properties and children. */
export function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Writes only what has changed: untouched text needs no layout. */
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

const MODES = { idle: "● idle", active: "▶ active", stopping: "◆ stopping", stopped: "■ stopped" };
const OPERATORS = { me: "this page", other: "another client", none: "none" };

/** The line of the state. */
export function showState(frame) {
  const reason = frame.stop_reason ? `: ${frame.stop_reason}` : "";
  write(at("mode"), (MODES[frame.mode] ?? frame.mode) + reason);
  at("mode").dataset.mode = frame.mode;
  at("mode").title = at("mode").textContent;
  write(at("tick"), frame.tick.toLocaleString("en"));
  write(at("time"), `${frame.time_s.toFixed(2)} s`);
  write(at("holder"), frame.holder || "none");
  at("holder").title = frame.holder || "";
  write(at("operator"), OPERATORS[frame.operator] ?? "none");
}

const VERDICTS = { deadlines: "Deadlines", task: "Task", limits_and_balance: "Limits and balance" };
const SIGNS = { pass: "✓", warn: "!", fail: "✕" };

/**
 * @param {Record<string, {verdict: string, words: string}>} verdicts
 * @param {boolean} stands whether the robot has balance to keep
 */
export function showVerdicts(verdicts = {}, stands = true) {
  const list = at("verdicts");
  for (const [key, title] of Object.entries(VERDICTS)) {
    const name = stands ? title : title.replace(" and balance", "");
    const { verdict = "not judged", words = "" } = verdicts[key] ?? {};
    let row = list.querySelector(`[data-of="${key}"]`);
    if (!row) {
      row = make("li", {}, make("i"), make("b", { textContent: name }), make("span"), make("small"));
      row.dataset.of = key;
      row.firstChild.setAttribute("aria-hidden", "true");
      list.append(row);
    }
    const [sign, , word, why] = row.children;
    sign.className = `sign ${SIGNS[verdict] ? verdict : "none"}`;
    write(sign, SIGNS[verdict] ?? "–");
    write(word, verdict);
    write(why, words);
  }
}

const NEAR_LIMIT = 0.03; // of the range

/** Bars of the joints: position in its range, speed and effort; a sign where one is near a limit. */
export class Joints {
  /** @param {{name, lower, upper, velocity, effort, unit}[]} joints */
  constructor(joints) {
    this.rows = joints.map(({ name, lower, upper, velocity, effort, unit }) => {
      const turns = lower === null || upper === null; // without limits: where in a turn it is
      const dot = make("i");
      const value = make("output");
      const rates = make("output", { className: "rates" });
      const bar = make("span", { className: turns ? "bar turns" : "bar" }, dot);
      bar.title = turns ? "no limits" : `${lower.toFixed(2)} to ${upper.toFixed(2)} ${unit}`;
      const row = make("li", {}, make("b", { textContent: name, title: name }), value, bar, rates);
      const range = { lower: turns ? -Math.PI : lower, upper: turns ? Math.PI : upper };
      return { row, dot, value, rates, unit, turns, velocity, effort, ...range };
    });
    at("joints").replaceChildren(...this.rows.map(({ row }) => row));
  }

  /** @param {{q: number[], dq: number[], tau: number[]}} frame */
  show({ q, dq, tau }) {
    this.hasForces ||= tau.some((each) => each); // a plant without forces sends zeros
    const shown = (value, digits) => (value === null ? "–" : value.toFixed(digits));
    this.rows.forEach(({ row, dot, value, rates, unit, turns, lower, upper, velocity, effort }, i) => {
      const angle = turns ? Math.atan2(Math.sin(q[i]), Math.cos(q[i])) : q[i];
      const share = Math.min(1, Math.max(0, (angle - lower) / (upper - lower)));
      const used = [Math.abs(dq[i]) / velocity, effort === null ? 0 : Math.abs(tau[i] ?? 0) / effort];
      const near = (!turns && Math.min(share, 1 - share) < NEAR_LIMIT) || Math.max(...used) > 1 - NEAR_LIMIT;
      dot.style.left = `${(100 * share).toFixed(2)}%`;
      row.classList.toggle("near", near);
      write(value, `${near ? "▲ " : ""}${q[i].toFixed(2)} ${unit}`);
      const torque = this.hasForces ? ` · ${shown(tau[i], 1)} ${unit === "m" ? "N" : "N m"}` : "";
      write(rates, `${shown(dq[i], 2)} ${unit}/s${torque}`);
    });
  }
}

const ALONG_PX = 8; // by which a finger moves a slider

/** Ignores a touch on a slider until it moves along it: scrolling must not command the robot. */
export function ignoreRestingTouch(slider) {
  let before = null; // the value to restore
  let start = 0; // where the finger came down
  slider.addEventListener("pointerdown", ({ pointerType, clientX }) => {
    before = pointerType === "touch" ? slider.value : null;
    start = clientX;
  });
  slider.addEventListener("pointermove", ({ clientX }) => {
    if (Math.abs(clientX - start) > ALONG_PX) before = null;
  });
  slider.addEventListener("keydown", () => (before = null));
  // after the events of this touch
  for (const kind of ["pointerup", "pointercancel"]) slider.addEventListener(kind, () => setTimeout(() => (before = null)));
  for (const kind of ["input", "change"]) {
    slider.addEventListener(kind, (event) => {
      if (before === null) return;
      event.stopImmediatePropagation();
      slider.value = before;
    });
  }
}

const STEPS = 200;
const OVER_S = 0.5;

/** What can change while the controller runs: sliders, sent when let go. */
export class Sliders {
  /** @param {import("./connection.js").Connection} connection */
  constructor(connection) {
    this.connection = connection;
    this.made = "";
  }

  /** @param {{key, label, lower, upper, value, unit}[]} changeable */
  set(changeable) {
    const made = JSON.stringify(changeable.map(({ value, ...rest }) => [rest, typeof value]));
    if (made !== this.made) {
      this.made = made;
      this.all = changeable.map((each) => (typeof each.value === "number" ? this.#number(each) : this.#text(each)));
      at("sliders").replaceChildren(...this.all.map(({ row }) => row));
      at("change").hidden = changeable.length === 0;
      this.enable(this.on);
    }
    changeable.forEach(({ value }, i) => this.all[i].take(value));
  }

  /** What is no number is only shown. */
  #text({ key, label }) {
    const shown = make("output");
    const told = make("small", { className: "told", textContent: key });
    const row = make("div", { className: "setting" }, make("span", { textContent: label }), shown, told);
    return { row, take: (value) => write(shown, typeof value === "string" ? value : JSON.stringify(value)) };
  }

  /** A slider between bounds; a field to type in where one of them is missing. */
  #number({ key, label, lower, upper, unit }) {
    const bounded = typeof lower === "number" && typeof upper === "number" && upper > lower;
    const input = make("input", { type: bounded ? "range" : "number" });
    if (typeof lower === "number") input.min = lower;
    if (typeof upper === "number") input.max = upper;
    input.step = bounded ? (upper - lower) / STEPS : "any";
    const shown = make("output");
    const told = make("small", { className: "told", textContent: key });
    let now; // as the controller has it, which may be between two steps of the slider
    let held = false;
    const show = (number) => write(shown, `${Number(number.toPrecision(3))}${unit ? ` ${unit}` : ""}`);
    const take = (value) => {
      now = value;
      if (held) return;
      input.value = value;
      show(value);
    };
    if (bounded) ignoreRestingTouch(input);
    input.addEventListener("input", () => {
      held = true;
      if (!Number.isNaN(input.valueAsNumber)) show(input.valueAsNumber);
    });
    input.addEventListener("pointerup", () => (held = false)); // also where it was put back
    input.addEventListener("change", () => {
      held = false;
      const asked = input.valueAsNumber;
      if (Number.isNaN(asked)) return take(now); // an empty field
      write(told, `${key}: asked …`);
      this.connection.act({ verb: "change", what: { [key]: asked }, over_s: OVER_S }, (error) => {
        write(told, `${key}: ${error ?? "changed"}`);
        take(error === null ? asked : now);
      });
    });
    return { row: make("label", { className: "setting" }, make("span", { textContent: label }), input, shown, told), take };
  }

  /** Only who knows the token changes anything. */
  enable(on) {
    this.on = Boolean(on);
    for (const input of at("sliders").querySelectorAll("input")) input.disabled = !this.on;
  }
}

const MOST_EVENTS = 200;
const EVENT_SIGNS = { error: "✕", warning: "!", warn: "!", info: "·" };

/** @param {{at_s?: number|null, label: string, severity?: string}} event newest on top */
export function addEvent({ at_s, label, severity = "info" }) {
  const sign = make("i", { className: `sign ${severity}`, textContent: EVENT_SIGNS[severity] ?? "·" });
  const when = make("time", { textContent: at_s == null ? "–" : `${at_s.toFixed(2)} s` });
  at("events").prepend(make("li", {}, sign, when, make("span", { textContent: label })));
  while (at("events").childElementCount > MOST_EVENTS) at("events").lastChild.remove();
}
