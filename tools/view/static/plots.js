// Curves, one chart a group: of a running robot the last seconds, of a log the whole with a line at now.

import { uPlot } from "./vendor.js";
import { CURVES, DASHES, ofPage, readable } from "./colours.js";
import { make, write } from "./panels.js";

const WINDOW_S = 10;
const HEIGHT = 104; // px
const SMALLEST = 1e-20; // that a logarithmic axis shows: below some 1e-25 uPlot looks for its ticks for seconds
const TITLES = { "V rate": "dV/dt", rtt: "Answers, as seen here" }; // of groups; else their names
const EACH_MS = 100; // between two redraws: text and curves ten times a second are enough

/** A number in at most seven characters. */
export function short(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(1);
  return String(Number(value.toPrecision(3)));
}

/** Bounds of an axis: round ones, and some where there is one value alone, or none. */
function bounds(logarithmic, least, greatest) {
  if (logarithmic) {
    const [low, high] = least === null ? [1e-3, 1] : [least, greatest].map((each) => Math.max(each, SMALLEST));
    return uPlot.rangeLog(low, high, 10, true);
  }
  if (least === null) return [-1, 1];
  if (least < greatest) return uPlot.rangeNum(least, greatest, 0.1, true);
  const around = Math.abs(least) > 1e-9 ? Math.abs(least) / 2 : 1;
  return [least - around, least + around];
}

/** Of a logarithmic axis the decades, or each second, third, … where there are many. */
function decades(splits) {
  const found = splits.map((each) => Math.log10(each)).filter((each) => Math.abs(each - Math.round(each)) < 1e-6);
  const step = Math.ceil(found.length / 4);
  const shown = new Set(found.map(Math.round).filter((each) => each % step === 0));
  return splits.map((each) => {
    const power = Math.log10(each);
    return Math.abs(power - Math.round(power)) < 1e-6 && shown.has(Math.round(power)) ? each : null;
  });
}

/** One chart: its head with a mark, a name and the newest value of each curve, and the curves. */
class Chart {
  /**
   * @param {string} group
   * @param {object[]} curves of `hello.plots`
   * @param {object|null} log
   * @param {(at_s: number) => void} seek
   */
  constructor(group, curves, log, seek) {
    Object.assign(this, { curves, log, now: log?.from_s ?? 0, hovered: null });
    this.times = [];
    this.values = curves.map(() => []);
    this.newest = curves.map(() => null); // also what a logarithmic axis cannot show
    this.numbers = curves.map(() => make("output", { textContent: "–" }));
    this.box = make("div", { className: "chart" });
    this.figure = make("figure", { className: "card" }, this.#head(group), this.box);
    this.figure.dataset.group = group;
    this.box.setAttribute("role", "img");
    this.box.setAttribute("aria-label", `${group}: ${curves.map(({ label }) => label).join(", ")}`);
    this.plot = new uPlot(this.#options(curves.some((curve) => curve.log)), this.#data(), this.box);
    if (log) {
      this.plot.over.style.cursor = "pointer";
      this.plot.over.addEventListener("click", ({ offsetX }) => seek(this.plot.posToVal(offsetX, "x")));
    }
    new ResizeObserver(() => this.#fit()).observe(this.box);
    if (log) this.learn(log);
  }

  /** @param {object} log the same, of which more is known; a chart that will have no curve is not shown */
  learn(log) {
    this.log = log;
    const empty = this.curves.every(({ key }) => !log.overview?.[key]?.length);
    this.figure.hidden = empty && log.done !== false;
    if (!this.figure.hidden) this.plot.setData(this.#data());
  }

  /** Name and unit; of several curves the mark, name and newest number of each, too. */
  #head(group) {
    const [{ label, unit }] = this.curves;
    const alone = this.curves.length === 1;
    const name = alone ? label : (TITLES[group] ?? group.charAt(0).toUpperCase() + group.slice(1));
    const title = make("h2", { textContent: name, title: name }, make("small", { textContent: unit ? ` [${unit}]` : "" }));
    if (alone) return make("figcaption", {}, title, this.numbers[0]);
    const legend = this.curves.map((curve, i) => this.#legend(curve, i, unit));
    return make("figcaption", {}, title, make("ul", { className: "curves" }, ...legend));
  }

  #legend({ label, unit, dashed }, i, common) {
    const mark = make("i", { className: `line dash${this.#dash(dashed, i)}` });
    mark.style.color = `var(--curve${i % CURVES.length})`;
    const name = make("span", { textContent: unit === common || !unit ? label : `${label} [${unit}]`, title: label });
    return make("li", {}, mark, name, this.numbers[i]);
  }

  #dash(dashed, i) {
    return dashed ? 2 : i % DASHES.length;
  }

  #options(logarithmic) {
    const axis = {
      stroke: () => ofPage("soft"),
      grid: { stroke: () => ofPage("rule"), width: 1 },
      ticks: { show: false },
      font: "11px system-ui, sans-serif",
      gap: 4,
    };
    const filter = logarithmic ? (_, splits) => decades(splits) : (_, splits) => splits;
    const curve = (i) => ({
      stroke: () => readable(CURVES[i % CURVES.length]),
      width: 1.75,
      dash: DASHES[this.#dash(this.curves[i].dashed, i)],
      points: { show: false },
    });
    const series = this.curves.flatMap((_, i) => (this.log ? [curve(i), curve(i)] : [curve(i)]));
    const bands = this.log
      ? this.curves.map((_, i) => ({
          series: [2 * i + 1, 2 * i + 2], // from the greatest to the least of each bin
          fill: () => `${readable(CURVES[i % CURVES.length])}44`,
        }))
      : [];
    return {
      width: this.box.clientWidth || 380,
      height: HEIGHT,
      padding: [8, 8, 0, 0],
      legend: { show: false },
      cursor: { y: false, drag: { x: false, y: false }, points: { size: 5 } },
      scales: {
        x: { time: false, range: () => this.#range() },
        y: { distr: logarithmic ? 3 : 1, range: (_, least, greatest) => bounds(logarithmic, least, greatest) },
      },
      axes: [
        { ...axis, size: 22, space: 60 },
        {
          ...axis,
          size: 50,
          space: 24,
          filter,
          grid: { ...axis.grid, filter },
          values: (_, all) => all.map((each) => (each === null ? "" : short(each).replace(".0e", "e"))),
        },
      ],
      series: [{}, ...series],
      bands,
      hooks: { draw: [() => this.#line()], setCursor: [({ cursor }) => this.#hover(cursor.idx)] },
    };
  }

  #range() {
    return this.log ? [this.log.from_s, this.log.to_s] : [this.now - WINDOW_S, this.now];
  }

  /** Of a log: what the whole looks like, bin by bin. */
  #data() {
    if (!this.log) return [this.times, ...this.values];
    const rows = this.curves.map(({ key }) => this.log.overview?.[key] ?? []);
    const column = (table, i) => table.map((row) => row[i]);
    return uPlot.join(rows.map((table) => [column(table, 0), column(table, 2), column(table, 1)]));
  }

  /** Of a log: where its time stands. */
  #line() {
    if (!this.log) return;
    const { ctx, bbox } = this.plot;
    const x = this.plot.valToPos(this.now, "x", true);
    ctx.save();
    ctx.fillStyle = ofPage("ink");
    ctx.fillRect(x - devicePixelRatio / 2, bbox.top, devicePixelRatio, bbox.height);
    ctx.restore();
  }

  #hover(index) {
    this.hovered = this.log ? null : (index ?? null);
    this.#write();
  }

  #write() {
    const { hovered, newest, values } = this;
    this.numbers.forEach((number, i) => write(number, short(hovered === null ? newest[i] : values[i][hovered])));
  }

  push(time_s, values) {
    if (time_s < this.now || this.log) this.#clear(); // of a log only the numbers are new
    this.now = time_s;
    this.times.push(time_s);
    this.curves.forEach(({ key, log }, i) => {
      const value = values[key] ?? null;
      this.newest[i] = value;
      this.values[i].push(log && value <= 0 ? null : value);
    });
    while (this.times[0] < time_s - WINDOW_S) {
      this.times.shift();
      for (const each of this.values) each.shift();
    }
  }

  #clear() {
    this.times.length = 0;
    for (const each of this.values) each.length = 0;
  }

  draw() {
    if (this.log) this.plot.redraw(false, false);
    else this.plot.setData([this.times, ...this.values]);
    this.#write();
  }

  #fit() {
    if (this.box.clientWidth) this.plot.setSize({ width: this.box.clientWidth, height: HEIGHT });
  }
}

export class Plots {
  /**
   * @param {HTMLElement} box
   * @param {HTMLElement} folded for the plots of certificates
   * @param {object} hello
   * @param {(at_s: number) => void} seek
   */
  constructor(box, folded, { plots, log }, seek) {
    const groups = [...Map.groupBy(plots, ({ group }) => group)];
    const charts = (some) => some.map(([group, curves]) => new Chart(group, curves, log, seek));
    const [shown, others] = [false, true].map((certificate) =>
      charts(groups.filter(([, [curve]]) => Boolean(curve.certificate) === certificate)),
    );
    this.drawn_ms = -Infinity;
    this.charts = [...shown, ...others];
    box.replaceChildren(...shown.map(({ figure }) => figure));
    folded.replaceChildren(...others.map(({ figure }) => figure));
  }

  /** @param {object} log of which more is known */
  learn(log) {
    for (const chart of this.charts) chart.learn(log);
  }

  /** In the colours of the scheme that holds now. */
  repaint() {
    for (const chart of this.charts) chart.plot.redraw(false, true);
  }

  /** @param {object} frame */
  push({ time_s, at_s = time_s, values }) {
    for (const chart of this.charts) chart.push(at_s, values);
    const now = performance.now();
    if (now - this.drawn_ms < EACH_MS) return;
    this.drawn_ms = now;
    for (const chart of this.charts) chart.draw();
  }
}
