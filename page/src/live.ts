// The live stream: what comes some thirty times a second, kept for ten seconds.
import { facts } from "./api";
import { mark } from "./data";

export const SHOWN_S = 10;
const AGAIN_MS = [250, 500, 1000, 2000];

export interface About {
  presence: string; words: string; version: string | null; version_title: string | null; recalibration: string | null; gate: string | null;
  automatic: string | null; drift: string | null; drifting_joints: string[]; rate_hz: number | null; missing: number | null; late: number | null;
  latency_p99_s: number | null; refused: number; errors: number | null; events: { stamp_ns: number; kind: string; text: string }[];
}
type Row = (number | null)[];
export const kept = { t: [] as number[], measured: facts.joints.map((): Row => []), predicted: facts.joints.map((): Row => []) };
export const now = {
  about: null as About | null, rms: facts.joints.map(() => null) as Row, fleet: [] as any[], poses: null as number[][] | null, contacts: null as { measured: number[][]; predicted: number[][] } | null, lost: false,
};

let socket: WebSocket | null = null, failures = 0, space: "" | "poses" | "contacts" = "";

function connect(): void {
  const hand = encodeURIComponent(facts.namespace);
  const asked = space, mine = new WebSocket(`ws://${location.host}/live?hand=${hand}${space ? "&space=1" : ""}${space === "contacts" ? "&contacts=1" : ""}`);
  socket = mine;
  mine.onmessage = (event) => { failures = 0; now.lost = false; take(JSON.parse(event.data)); };
  mine.onopen = () => { if (asked !== space) again(mine); };
  mine.onclose = () => {
    if (socket !== mine) return;
    now.lost = true;
    dispatchEvent(new Event("about"));
    setTimeout(connect, AGAIN_MS[Math.min(failures++, AGAIN_MS.length - 1)]);
  };
}

function take(frame: any): void {
  const lists = [kept.t, ...kept.measured, ...kept.predicted] as Row[];
  if (frame.fresh) for (const list of lists) list.length = 0;
  if (frame.t) {
    kept.t.push(...frame.t);
    frame.measured.forEach((values: Row, joint: number) => kept.measured[joint].push(...values));
    frame.predicted.forEach((values: Row, joint: number) => kept.predicted[joint].push(...values));
    const old = kept.t.findIndex((time) => time > kept.t[kept.t.length - 1] - SHOWN_S);
    if (old > 0) for (const list of lists) list.splice(0, old);
    if (frame.hands) { now.poses = frame.hands; now.contacts = frame.contacts ?? null; }
    mark("points", String(kept.t.length));
    mark("spans", String((kept.t[kept.t.length - 1] ?? 0) - (kept.t[0] ?? 0)));
    dispatchEvent(new Event("samples"));
  }
  if (frame.about) {
    now.about = frame.about;
    now.rms = frame.rms;
    now.fleet = frame.fleet ?? [];
    dispatchEvent(new Event("about"));
  }
}

// The stream carries the poses of both hands only while somebody looks at them.
export function inSpace(wanted: typeof space): void {
  if (wanted === space) return;
  space = wanted;
  if (!socket) return; // it will be asked for at the first connection
  const old = socket;
  if (old.readyState !== WebSocket.CONNECTING) again(old); // else it looks when it is open
}

function again(old: WebSocket): void {
  if (socket !== old) return;
  socket = null;
  old.close();
  connect();
}

export const worstFirst = () => facts.joints.map((_, joint) => joint).sort((a, b) => (now.rms[b] ?? -1) - (now.rms[a] ?? -1));
export const residual = (joint: number, at = kept.t.length - 1): number | null => {
  const one = kept.measured[joint][at] ?? null, other = kept.predicted[joint][at] ?? null;
  return one === null || other === null ? null : one - other;
};
export const start = () => { if (!socket) connect(); };
