// A robot as its description says: one group a link, moved by the poses of a frame.

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  Color,
  CylinderGeometry,
  DoubleSide,
  FrontSide,
  Group,
  Mesh,
  MeshLambertMaterial,
  PlaneGeometry,
  SphereGeometry,
  SRGBColorSpace,
} from "./vendor.js";

/** Moves an object to [x, y, z, qx, qy, qz, qw]. */
export function place(object, pose) {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
}

/** Takes an object out of the picture, and what it holds out of the graphics memory. */
export function discard(object) {
  object.removeFromParent();
  object.traverse(({ geometry, material }) => {
    geometry?.dispose();
    material?.dispose?.();
  });
}

const SHAPES = {
  box: ([x, y, z]) => new BoxGeometry(x, y, z),
  sphere: ([r]) => new SphereGeometry(r, 24, 16),
  // three.js has these along y, URDF along z
  cylinder: ([r, length]) => new CylinderGeometry(r, r, length, 28).rotateX(Math.PI / 2),
  capsule: ([r, length]) => new CapsuleGeometry(r, length, 8, 24).rotateX(Math.PI / 2),
  plane: ([width, height]) => new PlaneGeometry(width, height),
};

const meshes = new Map(); // address → promise of a geometry: links share what is the same

/** Little endian: n, m, n vertices of 3 float32, m triangles of 3 uint32. */
async function fetchMesh(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address}: ${answer.status}`);
  const bytes = await answer.arrayBuffer();
  const [n, m] = new Uint32Array(bytes, 0, 2);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(bytes, 8, 3 * n), 3));
  geometry.setIndex(new BufferAttribute(new Uint32Array(bytes, 8 + 12 * n, 3 * m), 1));
  geometry.computeVertexNormals();
  return geometry;
}

function meshOf(address) {
  if (!meshes.has(address)) meshes.set(address, fetchMesh(address));
  return meshes.get(address);
}

/**
 * @param {{shape, size, origin, color, mesh?}} visual
 * @param {number} [opacity] of what is seen through
 * @param {() => void} [loaded] called when a mesh has come
 */
export function shapeOf(visual, opacity = visual.color[3], loaded = () => {}) {
  const [r, g, b] = visual.color;
  const material = new MeshLambertMaterial({
    color: new Color().setRGB(r, g, b, SRGBColorSpace),
    transparent: opacity < 1,
    opacity,
    depthWrite: opacity >= 1,
    flatShading: visual.shape === "mesh",
    side: opacity < 1 || visual.shape === "mesh" ? DoubleSide : FrontSide,
  });
  const mesh = new Mesh(new BufferGeometry(), material);
  place(mesh, visual.origin);
  if (visual.shape === "mesh") {
    mesh.scale.set(...(visual.size?.length === 3 ? visual.size : [1, 1, 1]));
    meshOf(visual.mesh).then((geometry) => {
      mesh.geometry = geometry;
      loaded();
    }, console.error);
  } else {
    mesh.geometry = SHAPES[visual.shape](visual.size);
  }
  return mesh;
}

export class Robot extends Group {
  /**
   * @param {{name: string, visuals: object[]}[]} links
   * @param {() => void} loaded
   * @param {string} [ghost] colour of one that is seen through
   */
  constructor(links, loaded, ghost) {
    super();
    this.links = links.map(({ name, visuals }) => {
      const link = new Group();
      link.name = name;
      for (const visual of visuals) {
        const shape = shapeOf(visual, ghost ? 0.28 : undefined, loaded);
        if (ghost) shape.material.color.set(ghost);
        link.add(shape);
      }
      this.add(link);
      return link;
    });
  }

  /** @param {number[][]} poses in the order of the links */
  move(poses) {
    poses.forEach((pose, i) => place(this.links[i], pose));
  }

  /** @returns {Group|undefined} */
  link(name) {
    return this.links.find((link) => link.name === name);
  }

  /** Of each link the 16 numbers, column by column, that the last picture was drawn with. */
  drawn() {
    return Object.fromEntries(this.links.map((link) => [link.name, [...link.matrixWorld.elements]]));
  }
}
