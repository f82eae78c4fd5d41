// What runs on the server - a check, a diagnosis, an addition, a ladder - followed in every browser that looks.
import { facts, post, read } from "./api";
import { mark } from "./data";
import { selection } from "./state";

export const KINDS = ["check", "diagnose", "propose", "add", "ladder"] as const;
export type Kind = (typeof KINDS)[number];
export interface Job {
  kind: Kind; status: "none" | "running" | "done" | "failed" | "stopped"; number: number; lines: string[]; count: number;
  limit_s: number | null; about: Record<string, string>; error: string | null; seconds: number; result: any;
}
const NAMES = { check: "The check", diagnose: "The diagnosis", propose: "The search for a law", add: "The addition", ladder: "The ladder" };
const AGAIN_MS = 400, IDLE_MS = 3000;

export const jobs: Partial<Record<Kind, Job>> = {};
let timer = 0, looked = false;

export const running = () => KINDS.map((kind) => jobs[kind]).find((one) => one?.status === "running");
export const latest = () => KINDS.map((kind) => jobs[kind]).reduce<Job | undefined>((best, one) => ((one?.number ?? 0) > (best?.number ?? 0) ? one : best), undefined);
// The last of a kind that is about what is selected.
export const ofSelection = (kind: Kind) => {
  const job = jobs[kind];
  return job && job.about.recording_id === selection.source ? job : undefined;
};

export async function begin(kind: Kind, more: object = {}): Promise<void> {
  if (selection.source === "live") throw new Error("Choose a recording first.");
  await post(`/api/job/${kind}`, { recording: selection.source, version: selection.version, holdout: selection.holdout, ...more });
  await look();
  clearTimeout(timer);
  timer = window.setTimeout(follow, AGAIN_MS);
}

export const words = (job: Job): string => {
  const about = `${NAMES[job.kind]} of ${job.about.recording}${job.about.effect ? `, ${job.about.effect} at ${job.about.joint},` : ""}`;
  return {
    none: "", running: `${about} runs since ${job.seconds.toFixed(0)} s.`, done: `${about} has ended after ${job.seconds.toFixed(0)} s.`,
    failed: `${about} failed: ${job.error}`, stopped: `${about} was stopped before anything was tested.`,
  }[job.status];
};

async function look(): Promise<boolean> {
  for (const kind of KINDS) {
    const before = jobs[kind];
    const found = await read(`/api/job?${new URLSearchParams({ kind, after: String(before?.count ?? 0) })}`);
    if (found.status === "none") continue;
    if (before && found.number !== before.number) {
      jobs[kind] = undefined; // another one: all that it said
      return look();
    }
    const news = found.status !== before?.status || found.lines.length || found.status === "running";
    jobs[kind] = { ...found, kind, lines: [...(before?.lines ?? []), ...found.lines] };
    if (!news) continue;
    if (looked && found.status !== before?.status && found.result) dispatchEvent(new CustomEvent("job-ended", { detail: kind }));
    dispatchEvent(new Event("job"));
  }
  looked = true;
  const last = latest();
  if (last) mark("job", `${last.kind} ${last.status}`);
  return last?.status === "running";
}

async function follow(): Promise<void> {
  let wait = IDLE_MS;
  try {
    if (await look()) wait = AGAIN_MS;
  } catch { /* the bar says that the server is away */ }
  clearTimeout(timer);
  timer = window.setTimeout(follow, wait);
}

export function start(): void { if (facts.own) follow(); }
