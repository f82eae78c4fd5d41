// What can be drawn beside both hands: tendons, contacts, and the path of a fingertip.
import * as three from "three";
import { failed, facts, read } from "./api";
import { about, known } from "./data";
import { made } from "./dom";
import type { Described, Point } from "./shapes";
import { colour, live, select, selection } from "./state";

interface Path { measured: number[][]; predicted: number[][] | null; pending: boolean }
interface Contacts { measured: number[][]; predicted: number[][] | null }
const box = (id: string, text: string) => { const input = made("input", { type: "checkbox", id }); return { input, label: made("label", {}, input, ` ${text}`) }; };
const tendons = box("space-tendons", "tendons"), contacts = box("space-contacts", "contacts"), path = box("space-path", "path of the fingertip");
export const controls = made("p", { className: "controls tuning" }, tendons.label, contacts.label, path.label);
const LIVE_POINTS = 200, RADIUS_M = 0.0025, MOST_CONTACTS = 64;

let group: three.Group | null = null, described: Described | null = null, redraw = () => undefined as void, pathOf = "", contactsOf = "", asking = false;
let bodies: three.Group[][] = [], trail: three.Vector3[][] = [[], []], points: Contacts | null = null, lines: three.Vector3[][] = [[], []];

export function place(scene: three.Scene, hands: three.Group[][], now: Described, draw: () => void): void {
  group?.removeFromParent();
  group = new three.Group();
  scene.add(group);
  [bodies, described, redraw] = [hands, now, draw];
  [pathOf, contactsOf, trail, lines, points] = ["", "", [[], []], [[], []], null];
  tendons.label.hidden = !now.tendons.length;
  tendons.input.disabled = !now.tendons.length;
}

function inWorld(hand: number, [body, x, y, z]: Point): three.Vector3 {
  const found = bodies[hand][body];
  found.updateMatrix(); // bodies stand in the world, not in each other
  return new three.Vector3(x, y, z).applyMatrix4(found.matrix);
}

function curve(at: three.Vector3[], name: string): three.Line {
  return new three.Line(new three.BufferGeometry().setFromPoints(at), new three.LineBasicMaterial({ color: new three.Color(colour(name)), depthTest: false, transparent: true }));
}

// After both hands have moved: what hangs on them is drawn anew.
export function moved(at: number | null): void {
  if (!group || !described) return;
  for (const old of [...group.children] as (three.Line | three.Mesh)[]) { old.geometry.dispose(); (old.material as three.Material).dispose(); old.removeFromParent(); }
  if (tendons.input.checked) bodies.forEach((_, hand) => described!.tendons.forEach((one) => group!.add(curve(one.points.map((point) => inWorld(hand, point)), hand ? "accent" : "odd"))));
  if (path.input.checked) followed(at);
  if (contacts.input.checked) touched(at);
  document.documentElement.dataset.overlays = String(group.children.length);
}

function followed(at: number | null): void {
  const tip = described!.tips[selection.joint];
  if (!tip) return;
  if (live()) {
    trail.forEach((one, hand) => { one.push(inWorld(hand, tip)); while (one.length > LIVE_POINTS) one.shift(); });
    trail.forEach((one, hand) => group!.add(curve(one, hand ? "accent" : "ink")));
    return;
  }
  const [from, to] = selection.range ?? [0, known.opened?.seconds ?? 0], wanted = about({ joint: selection.joint, from, to }).toString();
  if (pathOf !== wanted) {
    pathOf = wanted;
    read<Path>(`/api/path?${wanted}`).then((found) => {
      if (pathOf !== wanted) return;
      lines = [found.measured, found.predicted ?? []].map((one) => one.map(([x, y, z]) => new three.Vector3(x, y, z)));
      if (found.pending) pathOf = "";
      moved(at);
      redraw();
    }, failed);
  }
  lines.forEach((one, hand) => { if (one.length) group!.add(curve(one, hand ? "accent" : "ink")); });
}

function touched(at: number | null): void {
  const wanted = live() ? "" : about({ at: at ?? 0 }).toString();
  if (wanted && contactsOf !== wanted && !asking) {
    asking = true;
    contactsOf = wanted;
    read<Contacts>(`/api/contacts?${wanted}`).then((found) => { points = found; asking = false; moved(at); redraw(); }, (error) => { asking = false; failed(error); });
  }
  const ball = new three.SphereGeometry(RADIUS_M, 8, 6);
  [points?.measured ?? [], points?.predicted ?? []].forEach((one, hand) => one.slice(0, MOST_CONTACTS).forEach(([x, y, z]) => {
    const found = new three.Mesh(ball, new three.MeshBasicMaterial({ color: new three.Color(colour(hand ? "accent" : "bad")), depthTest: false, transparent: true }));
    found.position.set(x, y, z);
    group!.add(found);
  }));
}

// The stream says where the live hands touch something, while somebody asks for it.
export const wantsContacts = () => contacts.input.checked;
export function heard(found: Contacts | null): void { points = found; }

export function start(again: () => void): void {
  for (const { input } of [tendons, contacts, path]) input.addEventListener("change", () => { trail = [[], []]; points = null; contactsOf = ""; again(); });
  path.input.addEventListener("change", () => { if (path.input.checked && !selection.joint) select({ joint: facts.joints[0] }); });
}
