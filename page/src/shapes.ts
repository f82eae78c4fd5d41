// The shapes of a model's geoms, as MuJoCo means their sizes: radius and half length, half sizes, radii.
import * as three from "three";
import { mergeGeometries, mergeVertices } from "three/addons/utils/BufferGeometryUtils.js";

export interface Geom { body: number; shape: string; size: number[]; position: number[]; quaternion: number[]; rgba: number[]; mesh?: number }
export type Point = [body: number, x: number, y: number, z: number]; // m, in the frame of a body
export interface Described { bodies: number; joints: number[][]; geoms: Geom[]; tendons: { name: string; points: Point[] }[]; tips: Record<string, Point>; meshes: Record<string, { points: string; faces: string }> }

// One geometry for each body that has any: what does not move against each other is drawn in one go.
// `fineness` 1 is round on a screen; less has fewer faces.
export function geometries(described: Described, fineness: number): (three.BufferGeometry | null)[] {
  const meshes = new Map(Object.entries(described.meshes).map(([name, mesh]) => [Number(name), meshed(mesh)]));
  const bodies = Array.from({ length: described.bodies }, (): three.BufferGeometry[] => []);
  const place = new three.Matrix4(), one = new three.Vector3(1, 1, 1);
  for (const geom of described.geoms) {
    const [w, x, y, z] = geom.quaternion, shape = geom.mesh === undefined ? shaped(geom, fineness) : meshes.get(geom.mesh)!.clone();
    place.compose(new three.Vector3(...geom.position), new three.Quaternion(x, y, z, w), one);
    shape.deleteAttribute("uv");
    bodies[geom.body].push((shape.index ? shape : mergeVertices(shape)).applyMatrix4(place)); // a corner is computed once, not for each face
  }
  return bodies.map((parts) => (parts.length ? mergeGeometries(parts) : null));
}

function shaped({ shape, size: [a, b, c] }: Geom, fineness: number): three.BufferGeometry {
  const cut = (faces: number) => Math.round(faces * fineness);
  switch (shape) {
    case "sphere": return new three.SphereGeometry(a, cut(16), cut(10));
    case "capsule": return new three.CapsuleGeometry(a, 2 * b, cut(5), cut(14)).rotateX(Math.PI / 2); // along z, as in MJCF
    case "cylinder": return new three.CylinderGeometry(a, a, 2 * b, cut(20)).rotateX(Math.PI / 2);
    case "ellipsoid": return new three.SphereGeometry(1, cut(16), cut(10)).scale(a, b, c);
    default: return new three.BoxGeometry(2 * a, 2 * b, 2 * c);
  }
}

function meshed(mesh: { points: string; faces: string }): three.BufferGeometry {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(decoded(mesh.points)), 3));
  geometry.setIndex(new three.BufferAttribute(new Uint32Array(decoded(mesh.faces)), 1));
  const flat = geometry.toNonIndexed();
  flat.computeVertexNormals();
  return flat;
}

const decoded = (text: string): ArrayBuffer => Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer;
