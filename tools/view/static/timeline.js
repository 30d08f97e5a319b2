// Of a log: its time, played or pulled, and ways to what is worth seeing.

import { at, make, write } from "./panels.js";

const SEEK_MS = 40; // between two times that are asked for while the slider is pulled

export class Timeline {
  /**
   * @param {{from_s, to_s, events, worst}} log
   * @param {import("./connection.js").Connection} connection
   */
  constructor(log, connection) {
    Object.assign(this, { log, connection, playing: false, pulled: false, asked_ms: 0 });
    at("timeline").hidden = false;
    Object.assign(at("at"), { min: log.from_s, max: log.to_s, step: (log.to_s - log.from_s) / 10000, value: log.from_s });
    at("at").oninput = () => this.#pull();
    at("at").onchange = () => {
      this.pulled = false;
      this.seek(at("at").valueAsNumber);
    };
    at("play").onclick = () => this.play(!this.playing);
    at("speed").onchange = () => this.playing && this.play(true);
    at("jump").onchange = ({ target }) => {
      if (target.value !== "") this.seek(Number(target.value));
      target.value = "";
    };
    this.learn(log);
  }

  /** @param {object} log the same, of which more is known: where one can go */
  learn(log) {
    this.log = log;
    const { worst = [], events = [] } = log;
    const known = JSON.stringify([worst, events]);
    if (known === this.known) return; // else a list that is open would be closed
    this.known = known;
    const first = at("jump").firstElementChild;
    at("jump").replaceChildren(first, ...this.#jumps("Worst ticks", worst), ...this.#jumps("Events", events));
  }

  #jumps(label, all) {
    if (!all.length) return [];
    const options = all.map(({ at_s, label: name }) =>
      make("option", { value: at_s, textContent: `${at_s.toFixed(2)} s · ${name}` }),
    );
    return [make("optgroup", { label }, ...options)];
  }

  #pull() {
    this.pulled = true;
    this.#write(at("at").valueAsNumber);
    if (performance.now() - this.asked_ms < SEEK_MS) return;
    this.seek(at("at").valueAsNumber);
  }

  seek(at_s) {
    this.asked_ms = performance.now();
    this.connection.seek(Math.min(this.log.to_s, Math.max(this.log.from_s, at_s)));
  }

  play(on) {
    this.#button(on);
    this.connection.play(on ? Number(at("speed").value) : 0);
  }

  #button(playing) {
    this.playing = playing;
    write(at("play"), playing ? "❚❚" : "▶");
    at("play").setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  #write(time_s) {
    write(at("at-text"), `${time_s.toFixed(3)} s`);
  }

  /** @param {object} frame */
  show({ time_s, at_s = time_s, playing }) {
    if (this.pulled) return;
    at("at").value = at_s;
    this.#write(at_s);
    const on = playing ?? (this.playing && at_s < this.log.to_s); // it stops at its end
    if (on !== this.playing) this.#button(on);
  }
}
