// The 3-D picture: camera, light, ground. It is drawn anew only when something in it has changed.

import {
  AmbientLight,
  Box3,
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  OrbitControls,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "./vendor.js";
import { eachScheme, ofPage } from "./colours.js";

const FROM = new Vector3(1, -0.8, 0.4).normalize(); // the camera stands in front, to the right
const GROUND_CELLS = 20;

export class Stage {
  /** @param {HTMLElement} box that the picture fills */
  constructor(box) {
    this.box = box;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.renderer = new WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "The robot in 3-D; arrows move the view, with Ctrl they turn it");
    this.canvas.addEventListener("dragstart", (event) => event.preventDefault()); // of what was selected: it ends ours
    box.append(this.canvas);

    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(2, -3, 5);
    this.sky = new HemisphereLight(0xffffff, 0x777777, 1.3);
    this.sky.position.set(0, 0, 1);
    this.scene.add(sun, this.sky, new AmbientLight(0xffffff, 0.4));

    this.orbit = new OrbitControls(this.camera, this.canvas);
    this.orbit.listenToKeyEvents(this.canvas);
    this.orbit.addEventListener("change", () => this.change());
    this.waiting = false;
    this.onDrawn = () => {};
    new ResizeObserver(() => this.#resize()).observe(box);
    this.span = 1;
    eachScheme(() => this.#paint());
  }

  /** Something in the picture has changed: draw it with the next frame of the browser. */
  change() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.renderer.render(this.scene, this.camera);
      this.onDrawn();
    });
  }

  /** Looks at a whole robot, with a ground as large as it asks for. */
  frame(robot) {
    robot.updateMatrixWorld(true);
    const box = new Box3().setFromObject(robot);
    for (const { position } of robot.links) box.expandByPoint(position); // meshes may still be on their way
    const centre = box.getCenter(new Vector3());
    this.span = Math.max(0.1, box.getSize(new Vector3()).length());
    const narrow = Math.min(1, this.camera.aspect);
    const distance = (0.62 * this.span) / Math.sin((this.camera.fov * Math.PI) / 360) / narrow;
    this.camera.position.copy(FROM).multiplyScalar(distance).add(centre);
    this.camera.near = distance / 100;
    this.camera.far = distance * 100;
    this.camera.updateProjectionMatrix();
    this.orbit.target.copy(centre);
    this.orbit.update();
    this.#paint();
  }

  /** Where a point of the world is on the page [px of the window]. */
  pixel(point) {
    const seen = new Vector3(...point).project(this.camera);
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    return [left + ((seen.x + 1) / 2) * width, top + ((1 - seen.y) / 2) * height];
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.change();
  }

  /** In the colours of the page; cells of a decimetre for a small robot, of half a metre for a tall one. */
  #paint() {
    this.scene.background = new Color(ofPage("scene"));
    if (this.grid) {
      this.scene.remove(this.grid);
      this.grid.dispose();
    }
    const cell = this.span < 1.2 ? 0.1 : 0.5;
    this.grid = new GridHelper(GROUND_CELLS * cell, GROUND_CELLS, ofPage("grid-axis"), ofPage("grid"));
    this.grid.rotateX(Math.PI / 2); // three.js has the ground at y = 0
    this.scene.add(this.grid);
    this.change();
  }
}
