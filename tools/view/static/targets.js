// A marker for every target, and a gizmo to drag those that may be moved.

import {
  Group,
  Mesh,
  MeshBasicMaterial,
  OctahedronGeometry,
  Quaternion,
  TransformControls,
  Vector3,
} from "./vendor.js";
import { AXES, ORANGE, PURPLE } from "./colours.js";
import { gripped, moved } from "./grip.js";
import { triad } from "./overlays.js";
import { at, write } from "./panels.js";
import { Posture } from "./posture.js";
import { discard } from "./robot.js";

const LEAST_MS = 1000 / 30; // between two targets that are sent

/** What can be dragged of each kind of target, and its numbers as a marker that is there. */
const KINDS = {
  frame_position: { modes: ["translate"], of: ({ position: p }) => [p.x, p.y, p.z] },
  frame_orientation: { modes: ["rotate"], of: ({ quaternion: q }) => [q.x, q.y, q.z, q.w] },
};
KINDS.com = KINDS.frame_position;
KINDS.frame_pose = {
  modes: ["translate", "rotate"],
  of: (marker) => [...KINDS.frame_position.of(marker), ...KINDS.frame_orientation.of(marker)],
};

const isPosture = ({ kind, joints }) => kind === "posture" && Boolean(joints?.length);

export const canMove = (told) => told.kind in KINDS || isPosture(told);

/** Whether axes of its own show how it is turned. */
const turns = ({ kind }) => Boolean(KINDS[kind]?.modes.includes("rotate"));

/** One target: its marker follows the frames, or the hand that drags it. */
class Target {
  constructor(told, robot, stage, size, hand) {
    Object.assign(this, { name: told.name, kind: KINDS[told.kind], known: false, dragged: false });
    this.link = robot.link(told.frame);
    this.reference = robot.link(told.reference) ?? stage.scene; // whose axes the numbers are in
    this.marker = new Group();
    const gem = new Mesh(
      new OctahedronGeometry(size / 5),
      new MeshBasicMaterial({ color: PURPLE, wireframe: true, depthTest: false, transparent: true }),
    );
    gem.renderOrder = 5;
    this.marker.add(gem);
    if (turns(told)) this.marker.add(triad(1.5 * size, { dashed: true }));
    this.marker.visible = false;
    this.reference.add(this.marker);
    this.gizmos = this.kind.modes.map((mode) => {
      const gizmo = new TransformControls(stage.camera, stage.canvas);
      gizmo.setMode(mode);
      gizmo.setColors(...AXES, ORANGE);
      gizmo.setSize(mode === "rotate" ? 1.25 : 0.75); // rings outside the arrows: a press hits one of them
      gizmo.showXYZE = gizmo.showE = false; // rings about x, y and z are enough
      gizmo.attach(this.marker);
      gizmo.addEventListener("change", () => stage.change());
      gizmo.addEventListener("dragging-changed", ({ value }) => hand.grip(this, gizmo, value));
      gizmo.addEventListener("objectChange", () => hand.pull(this));
      stage.scene.add(gizmo.getHelper());
      return gizmo;
    });
  }

  /** Where it is from now on counts from here. */
  grip(asked) {
    this.start = gripped(this.kind.of(this.marker), asked, this.kind.modes[0] === "translate" ? 3 : 0);
  }

  get values() {
    return moved(this.kind.of(this.marker), this.start);
  }

  /** @param {number[]|null} values */
  move(values) {
    this.known = Boolean(values);
    this.marker.visible = this.known;
    if (!values || this.dragged) return;
    if (this.kind.modes[0] === "translate") this.marker.position.fromArray(values);
    else if (this.link) this.reference.worldToLocal(this.link.getWorldPosition(this.marker.position));
    if (this.kind.modes.includes("rotate")) this.marker.quaternion.fromArray(values.slice(-4));
  }

  /** Turns three numbers in the axes of the world, or of the tool, into those of the reference. */
  turn(three, tool) {
    const vector = new Vector3(...three);
    if (tool && this.link) vector.applyQuaternion(this.link.getWorldQuaternion(new Quaternion()));
    return vector.applyQuaternion(this.reference.getWorldQuaternion(new Quaternion()).invert()).toArray();
  }

  arm(on) {
    for (const gizmo of this.gizmos) {
      gizmo.enabled = on && this.known;
      gizmo.getHelper().visible = gizmo.enabled;
    }
  }

  remove() {
    for (const gizmo of this.gizmos) {
      gizmo.getHelper().removeFromParent();
      gizmo.dispose();
    }
    discard(this.marker);
  }
}

export class Targets {
  /**
   * @param {import("./scene.js").Stage} stage
   * @param {import("./connection.js").Connection} connection
   */
  constructor(stage, connection) {
    Object.assign(this, { stage, connection, all: [], asked: {}, dragged: null, armed: false, axes: "world" });
    const letGo = () => this.letGo();
    addEventListener("blur", letGo);
    document.addEventListener("visibilitychange", letGo);
    stage.canvas.addEventListener("pointercancel", letGo);
    stage.canvas.addEventListener("lostpointercapture", letGo);
  }

  /**
   * @param {object[]} targets of `hello` or `changed`
   * @param {import("./robot.js").Robot} robot
   * @param {object[]} joints of `hello`
   */
  set(targets, robot, joints) {
    this.letGo();
    for (const target of this.all) target?.remove();
    const size = 0.12 * this.stage.span;
    this.all = targets.map((told) => {
      if (isPosture(told)) return new Posture(told, joints, this);
      return canMove(told) ? new Target(told, robot, this.stage, size, this) : null;
    });
    at("turned-key").hidden = !targets.some(turns);
    this.space(this.axes);
    this.arm(this.armed);
  }

  /** @param {object} frame */
  move(frame) {
    this.asked = frame.asked ?? {};
    const changed = this.all.map((target, i) => {
      const was = target?.known;
      target?.move(frame.targets?.[i] ?? null);
      return target && was !== target.known;
    });
    if (changed.includes(true) && !this.dragged) this.arm(this.armed);
  }

  /** Shows the handles, or takes them away. */
  arm(on) {
    this.armed = on;
    if (!on) this.letGo();
    for (const target of this.all) target?.arm(on);
    this.#explain();
    at("move").hidden = !on || !at("postures").childElementCount;
    this.stage.change();
  }

  /** @param {"world"|"local"} axes that the handles are along */
  space(axes) {
    this.axes = axes;
    this.#explain();
    for (const target of this.all) target?.gizmos.forEach((gizmo) => gizmo.setSpace(axes));
  }

  /** In the legend: what the handles that are shown are along. */
  #explain() {
    at("handles-key").hidden = !this.armed || !this.all.some((target) => target?.gizmos.length);
    write(at("handles-text"), `handles: ${this.axes === "world" ? "world" : "target"} axes`);
  }

  /** A gizmo is gripped or let go: one at a time, and the camera stands still meanwhile. */
  grip(target, gizmo, on) {
    if (on === Boolean(this.dragged)) return;
    this.stage.orbit.enabled = !on;
    target.dragged = on;
    for (const each of this.all) {
      each?.gizmos.forEach((other) => other !== gizmo && (other.enabled = !on && each.known && this.armed));
    }
    if (on) {
      target.grip(this.asked[target.name]);
      this.dragged = { target, gizmo };
      this.sent_ms = -Infinity;
      this.late = false;
    } else {
      this.#flush();
      this.dragged = null;
      this.connection.act({ verb: "drop" });
    }
  }

  /** At most 30 a second; what comes sooner is sent with the next one, or when let go. */
  pull(target) {
    if (!this.dragged) return;
    this.late = true;
    const wait = this.sent_ms + LEAST_MS - performance.now();
    if (wait <= 0) this.#flush();
    else this.timer ??= setTimeout(() => this.dragged?.target === target && this.#flush(), wait);
  }

  #flush() {
    clearTimeout(this.timer);
    this.timer = undefined;
    if (!this.late) return;
    this.late = false;
    this.sent_ms = performance.now();
    const { name, values } = this.dragged.target;
    this.connection.act({ verb: "target", name, values });
  }

  /** Whatever takes the hand away, also what the browser does not call a pointer's end. */
  letGo() {
    this.dragged?.gizmo.pointerUp(null);
  }

  /** @returns {Target|undefined} */
  find(name) {
    return this.all.find((each) => each?.name === name);
  }

  /** For tests: the pixels of a gizmo's centre, and of its handle along x. */
  gizmo(name) {
    const at = this.find(name).marker.getWorldPosition(new Vector3());
    const { x, y, z } = at;
    const away = this.stage.camera.position.distanceTo(at);
    const unit = (away * 1.9 * Math.tan((this.stage.camera.fov * Math.PI) / 360) * 0.85) / 4;
    return { centre: this.stage.pixel([x, y, z]), handle: this.stage.pixel([x + 0.45 * unit, y, z]) };
  }
}
