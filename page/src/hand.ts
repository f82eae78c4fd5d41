// Both hands in space: the measured one solid, its links coloured by residual, the predicted one translucent.
import CameraControls from "camera-controls";
import * as three from "three";
import { bytes, facts, failed, read } from "./api";
import { about, hear, known, mark } from "./data";
import { made, milli, put, short } from "./dom";
import { inSpace, kept, now, residual } from "./live";
import { valueAt } from "./moments";
import * as overlays from "./overlays";
import { geometries, type Described } from "./shapes";
import { colour, live, on, onTheme, select, selection } from "./state";

CameraControls.install({ THREE: three });
const STEPS_MRAD = [2, 10, 50], WORDS = ["below 2 mrad", "2 to 10 mrad", "10 to 50 mrad", "50 mrad or more"];
const CHUNK_S = 2, RATE = 30, MOST_CHUNKS = 8, WORDS_EVERY_MS = 250;

const words = made("p", { id: "space-words", className: "hint" }, "No residual is known yet.");
const canvas = made("canvas", { id: "space", tabIndex: 0, role: "img", "aria-label": "The measured hand, its links coloured by the residual of the joints that turn them, and the predicted hand, translucent. Arrow keys turn them, plus and minus zoom, 0 shows all." });
const holder = made("div", { className: "space" }, canvas);
const key = made("ul", { className: "key", "aria-label": "Key" },
  made("li", {}, made("i", { className: "solid" }), "measured"), made("li", {}, made("i", { className: "ghost" }), "predicted"),
  made("li", {}, made("i", { className: "worst" }), "large residual"));
export const panel = made("div", { className: "panel hand" }, key, overlays.controls, holder, words);

interface Stage {
  renderer: three.WebGLRenderer; scene: three.Scene; camera: three.PerspectiveCamera; controls: CameraControls; hands: three.Group[][];
  meshes: three.Mesh[]; wanted: boolean; placed: boolean; version: string; described: Described;
}
let fineness = 1, faces = 1, byCard = true, unable = false, stage: Stage | null = null, residuals: (number | null)[] = [], frames = 0, saidAt = 0, loading = "";

async function build(): Promise<void> {
  const version = facts.own ? selection.version || "nominal" : "nominal";
  if (!facts.scene || unable || loading === version || stage?.version === version) return;
  loading = version;
  const described = await read<Described>(`/api/scene?${new URLSearchParams({ version })}`);
  if (loading !== version) return;
  loading = "";
  if (stage) { populate(stage, described, version); return; }
  const drawing = drawsInSpace();
  if (!drawing) {
    unable = true;
    put(words, "This browser draws nothing in space (no WebGL); everything else works without it.");
    return;
  }
  byCard = drawing === "card";
  if (!byCard) faces = 0.5;
  const renderer = new three.WebGLRenderer({ canvas, antialias: byCard, alpha: true, powerPreference: "low-power" });
  const scene = new three.Scene(), camera = new three.PerspectiveCamera(32, 1, 0.01, 20);
  camera.up.set(0, 0, 1);
  scene.add(new three.HemisphereLight(0xffffff, 0x667788, 1.6));
  const sun = new three.DirectionalLight(0xffffff, 1.8);
  sun.position.set(0.4, -0.8, 1);
  scene.add(sun);
  const controls = new CameraControls(camera, canvas);
  controls.dollyToCursor = true;
  controls.smoothTime = 0.08;
  controls.draggingSmoothTime = 0.03;
  stage = { renderer, scene, camera, controls, hands: [], meshes: [], wanted: true, placed: false, version: "", described };
  controls.addEventListener("update", () => { stage!.wanted = true; });
  new ResizeObserver(fit).observe(holder);
  populate(stage, described, version);
  requestAnimationFrame(tick);
}

// Whether there is no graphics card: then fewer points and faces are drawn, and edges are left as they are.
function drawsInSpace(): "card" | "software" | null {
  const probe = document.createElement("canvas").getContext("webgl2");
  if (!probe) return null;
  const told = probe.getExtension("WEBGL_debug_renderer_info"); // Firefox tells it without, and warns of this
  const name = told ? String(probe.getParameter(told.UNMASKED_RENDERER_WEBGL)) : "";
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name) ? "software" : "card";
}

function populate(on_: Stage, described: Described, version: string): void {
  for (const group of on_.hands.flat()) on_.scene.remove(group);
  for (const { geometry } of on_.meshes) geometry.dispose(); // both hands have the same ones
  Object.assign(on_, { meshes: [], version, described });
  const shapes = geometries(described, faces);
  on_.hands = [false, true].map((ghost) => {
    const bodies = Array.from({ length: described.bodies }, () => new three.Group());
    shapes.forEach((shape, body) => {
      if (!shape) return;
      const mesh = new three.Mesh(shape, material(ghost));
      mesh.userData.body = body;
      mesh.renderOrder = ghost ? 1 : 0;
      bodies[body].add(mesh);
      if (!ghost) on_.meshes.push(mesh);
    });
    on_.scene.add(...bodies);
    return bodies;
  });
  overlays.place(on_.scene, on_.hands, described, () => { on_.wanted = true; });
  paint();
  if (live() && now.poses) pose(now.poses);
  follow();
}

const material = (ghost: boolean) => new three.MeshLambertMaterial(ghost
  ? { transparent: true, opacity: 0.4, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 3, polygonOffsetUnits: 3 } : {});

const step = (value: number | null) => (value === null ? 0 : STEPS_MRAD.filter((limit) => 1e3 * Math.abs(value) >= limit).length);

function paint(): void {
  if (!stage) return;
  const base = new three.Color(colour("link")), bad = new three.Color(colour("bad")), ghost = new three.Color(colour("accent"));
  let worst = { residual: 0, name: "" };
  const shares = stage.described.joints.map((columns) => {
    const found = columns.map((joint) => [Math.abs(residuals[joint] ?? 0), facts.joints[joint]] as const).sort((a, b) => b[0] - a[0])[0];
    if (!found) return 0;
    if (found[0] > worst.residual) worst = { residual: found[0], name: found[1] };
    return [0, 0.25, 0.6, 1][step(found[0])];
  });
  const chosen = facts.joints.indexOf(selection.joint);
  stage.hands.forEach((bodies, hand) => bodies.forEach((group, body) => {
    for (const mesh of group.children as three.Mesh[]) {
      const look = mesh.material as three.MeshLambertMaterial;
      look.color.copy(hand ? ghost : base);
      if (!hand) look.color.lerp(bad, shares[body]);
      look.emissive.copy(ghost).multiplyScalar(!hand && stage!.described.joints[body].includes(chosen) ? 0.25 : 0);
    }
  }));
  stage.wanted = true;
  if (live() && performance.now() - saidAt < WORDS_EVERY_MS) return; // nobody reads thirty sentences a second
  saidAt = performance.now();
  put(words, worst.name ? `Largest now: ${short(worst.name)}, ${milli(worst.residual)} mrad (${WORDS[step(worst.residual)]}).` : "No residual is known yet.");
}

function pose(both: ArrayLike<number>[]): void {
  if (!stage) return;
  stage.hands.forEach((bodies, hand) => {
    const values = both[hand] ?? both[0];
    bodies.forEach((group, body) => {
      const at = 7 * body;
      if (at + 6 >= values.length) return;
      group.position.set(values[at], values[at + 1], values[at + 2]);
      group.quaternion.set(values[at + 4], values[at + 5], values[at + 6], values[at + 3]);
    });
  });
  overlays.moved(selection.at);
  stage.wanted = true;
  if (!stage.placed) { stage.placed = true; frame(false); }
}

function frame(smooth = true): void {
  if (!stage) return;
  const box = new three.Box3();
  const hand = new Set<number>(stage.described.joints.flatMap((columns, body) => (columns.length ? [body] : [])));
  stage.scene.updateMatrixWorld(true);
  for (const mesh of stage.meshes) if (hand.has(mesh.userData.body)) box.expandByObject(mesh);
  if (box.isEmpty()) return;
  const middle = box.getCenter(new three.Vector3()), reach = Math.max(box.getSize(new three.Vector3()).length(), 0.05);
  void stage.controls.setLookAt(middle.x + 0.35 * reach, middle.y - 1.7 * reach, middle.z + 0.25 * reach, middle.x, middle.y, middle.z, smooth);
}

function fit(): void {
  if (!stage) return;
  const { clientWidth: width, clientHeight: height } = holder;
  if (!width || !height) return;
  stage.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) * fineness);
  stage.renderer.setSize(width, height, false);
  stage.camera.aspect = width / height;
  stage.camera.updateProjectionMatrix();
  stage.wanted = true;
}

let before = 0, drawnAt = 0, slow = 0;
const counted: number[] = [];
function tick(at: number): void {
  requestAnimationFrame(tick);
  if (!stage || holder.offsetParent === null) return;
  const moved = stage.controls.update(Math.min((at - before) / 1e3, 0.1));
  before = at;
  if (!moved && !stage.wanted) return;
  stage.wanted = false;
  // a machine that does not keep up draws fewer points rather than fewer moments; without a card, vertices are what takes long
  slow = at - drawnAt < 400 ? 0.9 * slow + 0.1 * (at - drawnAt) : slow;
  drawnAt = at;
  if (slow > 45 && (byCard ? fineness > 0.5 : faces > 0.4)) {
    slow = 32;
    if (byCard) { fineness = Math.max(0.5, 0.8 * fineness); fit(); }
    else { faces = 0.4; populate(stage, stage.described, stage.version); }
    stage.wanted = false;
  }
  stage.renderer.render(stage.scene, stage.camera);
  frames += 1;
  mark("spaceFrames", String(frames));
  counted.push(at);
  while (counted[0] < at - 1000) counted.shift();
  mark("spaceRate", String(counted.length)); // frames in the last second
  mark("turned", stage.controls.azimuthAngle.toFixed(3));
}

// -- what is shown: the live stream, or the moment of the recording

const chunks = new Map<string, Promise<{ values: Float32Array; bodies: number; predicted: boolean }>>();

function chunk(number: number, version: string): Promise<{ values: Float32Array; bodies: number; predicted: boolean }> {
  const name = `${selection.source} ${version} ${selection.onset} ${selection.lag} ${number}`, found = chunks.get(name);
  if (found) return found;
  const from = number * CHUNK_S;
  const asked = bytes(`/api/poses?${about({ from, to: from + CHUNK_S - 1 / RATE, frames: CHUNK_S * RATE }, version)}`).then(async (answer) => {
    const predicted = answer.headers.get("X-Predicted") === "yes";
    if (!predicted) { chunks.delete(name); setTimeout(follow, 600); }
    return { values: new Float32Array(await answer.arrayBuffer()), bodies: Number(answer.headers.get("X-Bodies")), predicted };
  });
  asked.catch(() => chunks.delete(name));
  chunks.set(name, asked);
  if (chunks.size > MOST_CHUNKS) chunks.delete(chunks.keys().next().value!);
  return asked;
}

function follow(): void {
  const open = panel.isConnected && holder.offsetParent !== null;
  inSpace(open && live() && facts.scene ? (overlays.wantsContacts() ? "contacts" : "poses") : "");
  if (!open) return;
  build().catch(failed);
  if (!stage || live() || !known.opened) return;
  const at = selection.at ?? 0, number = Math.floor(at / CHUNK_S), version = stage.version;
  chunk(number, version).then(({ values, bodies }) => {
    if (live() || selection.at !== null && Math.floor(selection.at / CHUNK_S) !== number) return;
    const row = Math.min(Math.max(Math.round((at - number * CHUNK_S) * RATE), 0), CHUNK_S * RATE - 1), step_ = 7 * bodies;
    pose([values.subarray(2 * row * step_, (2 * row + 1) * step_), values.subarray((2 * row + 1) * step_, (2 * row + 2) * step_)]);
  }).catch(failed);
  const { overview } = known;
  residuals = facts.joints.map((name) => { const one = overview?.joints.find((joint) => joint.name === name); return one ? 1e-3 * (valueAt(one.spark, at, overview!.seconds) ?? 0) : null; });
  paint();
}

function picked(event: PointerEvent): void {
  if (!stage) return;
  const box = canvas.getBoundingClientRect(), ray = new three.Raycaster();
  ray.setFromCamera(new three.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height), stage.camera);
  const hit = ray.intersectObjects(stage.meshes)[0];
  const columns = hit ? stage.described.joints[hit.object.userData.body] : [];
  const worst = [...columns].sort((a, b) => Math.abs(residuals[b] ?? 0) - Math.abs(residuals[a] ?? 0))[0];
  if (worst !== undefined) select({ joint: facts.joints[worst] });
}

export function start(): void {
  panel.dataset.ready = "yes";
  overlays.start(follow);
  let down: [number, number] = [0, 0];
  canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => { if (Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) picked(event); });
  canvas.addEventListener("keydown", (event) => {
    const turns: Record<string, [number, number]> = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15] };
    if (Object.hasOwn(turns, event.key)) void stage?.controls.rotate(...turns[event.key], true);
    else if (event.key === "+" || event.key === "-") void stage?.controls.dolly(event.key === "+" ? 0.1 : -0.1, true);
    else if (event.key === "0") frame();
    else return;
    event.preventDefault();
  });
  new ResizeObserver(follow).observe(holder);
  on(["at", "source", "version", "onset", "lag", "range"], follow);
  on(["joint"], () => { paint(); if (!live()) follow(); });
  hear(["opened", "overview"], () => { chunks.clear(); follow(); });
  onTheme(paint);
  addEventListener("samples", () => {
    if (!live() || !now.poses || !stage || holder.offsetParent === null) return;
    residuals = facts.joints.map((_, joint) => residual(joint, kept.t.length - 1));
    overlays.heard(now.contacts);
    pose(now.poses);
    paint();
  });
}
