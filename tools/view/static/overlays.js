// What is drawn around the robot: balance, forces, frames of tasks, shapes of constraints.
// Each has a shape of its own, explained in the key beside the picture.

import {
  ArrowHelper,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CylinderGeometry,
  DoubleSide,
  Group,
  LineBasicMaterial,
  LineLoop,
  Mesh,
  MeshBasicMaterial,
  RingGeometry,
  SphereGeometry,
  Vector3,
} from "./vendor.js";
import { AXES, GREEN, ORANGE, PURPLE, RED } from "./colours.js";
import { place, shapeOf } from "./robot.js";

const ABOVE_GROUND = 0.002; // m, so that the grid does not flicker through

/** Seen through the robot's body: what is of interest is inside it. */
const inFront = (color, more = {}) =>
  new MeshBasicMaterial({ color, depthTest: false, transparent: true, ...more });

function flat(color, opacity) {
  return new MeshBasicMaterial({ color, transparent: true, opacity, side: DoubleSide, depthWrite: false });
}

const DASHES = 5; // of a dashed bar
const PALE = 0.5; // opacity of the axes of the robot's own frames, beside handles and targets

/** Three thin bars along x, y and z; dashed or paler ones tell several triads apart. */
export function triad(length, { dashed = false, opacity = 1 } = {}) {
  const axes = new Group();
  const count = dashed ? DASHES : 1;
  const dash = length / (2 * count - 1); // and gaps as long
  AXES.forEach((color, axis) => {
    for (let i = 0; i < count; i += 1) {
      const bar = new Mesh(new CylinderGeometry(length / 28, length / 28, dash, 8), inFront(color, { opacity }));
      bar.geometry.translate(0, (2 * i + 0.5) * dash, 0); // three.js has cylinders along y
      if (axis === 0) bar.rotation.z = -Math.PI / 2;
      if (axis === 2) bar.rotation.x = Math.PI / 2;
      bar.renderOrder = 2;
      axes.add(bar);
    }
  });
  return axes;
}

/** A sphere at the CoM, and a ring with a stick where it stands above the ground. */
class CentreOfMass extends Group {
  constructor(span) {
    super();
    const r = 0.018 * span;
    this.ball = new Mesh(new SphereGeometry(r, 20, 14), inFront(ORANGE));
    this.stick = new Mesh(new CylinderGeometry(r / 6, r / 6, 1, 6), inFront(ORANGE, { opacity: 0.7 }));
    this.stick.geometry.translate(0, 0.5, 0).rotateX(Math.PI / 2);
    this.ring = new Mesh(new RingGeometry(r * 0.75, r * 1.1, 28), inFront(ORANGE));
    this.ball.renderOrder = this.stick.renderOrder = this.ring.renderOrder = 3;
    this.add(this.ball, this.stick, this.ring);
  }

  move([x, y, z]) {
    this.ball.position.set(x, y, z);
    this.stick.position.set(x, y, 0);
    this.stick.scale.set(1, 1, z || 1e-9);
    this.ring.position.set(x, y, ABOVE_GROUND);
  }
}

/** A cross on the ground. */
function cross(span) {
  const mark = new Group();
  for (const angle of [Math.PI / 4, -Math.PI / 4]) {
    const bar = new Mesh(new BoxGeometry(0.07 * span, 0.01 * span, 0.001 * span), inFront(PURPLE));
    bar.rotation.z = angle;
    bar.renderOrder = 4;
    mark.add(bar);
  }
  return mark;
}

/** A convex polygon, filled, with its outline. */
class Polygon extends Group {
  constructor(color) {
    super();
    this.area = new Mesh(new BufferGeometry(), flat(color, 0.3));
    this.outline = new LineLoop(this.area.geometry, new LineBasicMaterial({ color }));
    this.area.renderOrder = this.outline.renderOrder = 1;
    this.add(this.area, this.outline);
  }

  /** @param {number[][]} corners of two or three coordinates */
  shape(corners) {
    const points = corners.flatMap(([x, y, z = ABOVE_GROUND]) => [x, y, z]);
    const fan = [];
    for (let i = 2; i < corners.length; i += 1) fan.push(0, i - 1, i);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    const outline = geometry.clone();
    geometry.setIndex(fan);
    this.area.geometry.dispose();
    this.outline.geometry.dispose();
    this.area.geometry = geometry;
    this.outline.geometry = outline;
  }
}

export class Overlays extends Group {
  /**
   * @param {object} hello
   * @param {import("./robot.js").Robot} robot on whose links soles and some constraints are
   * @param {number} span length of the robot's diagonal [m], which markers are sized by
   */
  constructor(hello, robot, span) {
    super();
    this.span = span;
    this.com = new CentreOfMass(span);
    this.zmp = cross(span);
    this.polygon = new Polygon(GREEN);
    this.frames = new Map();
    this.arrows = [];
    this.strongest = 0; // N, of all that was seen: its arrow is a third of the robot long
    this.add(this.com, this.zmp, this.polygon);
    robot.links[0]?.add(triad(0.08 * span)); // the base
    for (const { link: name, polygon } of hello.soles ?? []) {
      const sole = new Polygon(ORANGE);
      sole.shape(polygon);
      robot.link(name)?.add(sole);
    }
    for (const shape of hello.constraints ?? []) {
      (robot.link(shape.link) ?? this).add(shapeOf(shape, Math.min(shape.color[3], 0.3)));
    }
  }

  /** @param {object} frame */
  move(frame) {
    this.#show(this.com, frame.com, (at) => this.com.move(at));
    this.#show(this.zmp, frame.zmp, ([x, y]) => this.zmp.position.set(x, y, ABOVE_GROUND));
    this.#show(this.polygon, frame.polygon?.length > 2 && frame.polygon, (all) => this.polygon.shape(all));
    this.#forces(frame.contacts ?? []);
    const seen = new Set();
    for (const { name, pose } of frame.frames ?? []) {
      if (!this.frames.has(name)) {
        this.frames.set(name, triad(0.16 * this.span, { opacity: PALE }));
        this.add(this.frames.get(name));
      }
      place(this.frames.get(name), pose);
      seen.add(name);
    }
    for (const [name, axes] of this.frames) axes.visible = seen.has(name);
  }

  #show(object, value, move) {
    object.visible = Boolean(value);
    if (value) move(value);
  }

  #forces(contacts) {
    while (this.arrows.length < contacts.length) {
      const arrow = new ArrowHelper(new Vector3(0, 0, 1), new Vector3(), 1, RED);
      for (const part of [arrow.line, arrow.cone]) {
        Object.assign(part.material, { depthTest: false, transparent: true }); // it stands in a leg
        part.renderOrder = 4;
      }
      this.arrows.push(arrow);
      this.add(arrow);
    }
    const norms = contacts.map(({ force }) => Math.hypot(...force));
    this.strongest = Math.max(this.strongest, ...norms);
    this.arrows.forEach((arrow, i) => {
      arrow.visible = norms[i] > 1e-3 * this.strongest;
      if (!arrow.visible) return;
      const length = (0.33 * this.span * norms[i]) / this.strongest;
      arrow.position.set(...contacts[i].at);
      arrow.setDirection(new Vector3(...contacts[i].force).normalize());
      arrow.setLength(length, Math.min(0.05 * this.span, 0.4 * length), Math.min(0.03 * this.span, 0.25 * length));
    });
  }
}
