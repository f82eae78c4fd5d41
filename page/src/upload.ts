// A recording that is dropped anywhere, or chosen: sent in pieces, screened by the server, then opened.
import { allowed, attempt, post, say, send } from "./api";
import { refreshRecordings } from "./data";
import { made, put, size } from "./dom";
import { select } from "./state";

const file = made("input", { type: "file", id: "file", accept: ".mcap,.bag,.db3,.csv,.gz", tabIndex: -1, "aria-label": "Recording to send", className: "hidden" });
const words = made("span"), share = made("progress", { max: 1, value: 0, "aria-label": "Sent so far" });
const cancel = made("button", { type: "button", className: "plain" }, "Cancel");
export const progress = made("p", { id: "upload", className: "upload", role: "status", hidden: true }, words, share, cancel);
export const zone = made("button", { type: "button", id: "drop", className: "drop" }, "Drop a bag, MCAP or CSV");
const veil = made("div", { id: "veil", hidden: true }, made("p", {}, "Drop it: it is sent in pieces, screened and shown"));
const AT_ONCE = 2; // pieces: one is sent while the server writes the one before
let request: AbortController | null = null;

export const chooseFile = () => {
  if (!allowed()) throw new Error("Sending a recording needs the address with the token that 'twin workbench' printed.");
  file.click();
};

async function upload(one: File): Promise<void> {
  if (!allowed()) throw new Error("Sending a recording needs the address with the token that 'twin workbench' printed.");
  if (request) throw new Error("One file after the other: another one is on its way.");
  request = new AbortController();
  progress.hidden = false;
  let id = "";
  try {
    const begun = await post("/api/upload/begin", { name: one.name, bytes: one.size });
    ({ id } = begun);
    const { signal } = request, flying: Promise<unknown>[] = [];
    for (let at = 0; at < one.size; at += begun.piece_bytes) {
      const body = await one.slice(at, at + begun.piece_bytes).arrayBuffer(); // read while others are on their way
      if (flying.length >= AT_ONCE) await flying.shift();
      put(words, `${one.name}: ${size(at)} of ${size(one.size)} `);
      share.value = at / one.size;
      const sent = send(`/api/upload/piece?${new URLSearchParams({ id, offset: String(at) })}`, body, signal);
      sent.catch(() => undefined); // it is said where it is waited for
      flying.push(sent);
    }
    await Promise.all(flying);
    put(words, `${one.name} has arrived and is being read `);
    share.value = 1;
    const found = await post("/api/upload/end", { id });
    id = "";
    await refreshRecordings();
    select({ source: found.id, step: "data" });
    say(`${found.name} was read and is open.`, "note");
  } catch (error) {
    if (id) await post("/api/upload/cancel", { id }).catch(() => undefined);
    if ((error as Error).name !== "AbortError") throw error;
  } finally {
    request = null;
    progress.hidden = true;
  }
}

export function start(): void {
  document.body.append(file, veil);
  zone.addEventListener("click", () => { attempt(chooseFile); });
  cancel.addEventListener("click", () => request?.abort());
  file.addEventListener("change", () => {
    const [one] = file.files ?? [];
    file.value = "";
    if (one) attempt(() => upload(one));
  });
  let inside = 0;
  const files = (event: DragEvent) => event.dataTransfer?.types.includes("Files");
  addEventListener("dragenter", (event) => { if (files(event)) { inside += 1; veil.hidden = false; } });
  addEventListener("dragleave", (event) => { if (files(event) && --inside <= 0) { inside = 0; veil.hidden = true; } });
  addEventListener("dragover", (event) => { if (files(event)) event.preventDefault(); });
  addEventListener("drop", (event) => {
    if (!files(event)) return;
    event.preventDefault();
    inside = 0;
    veil.hidden = true;
    const [one] = event.dataTransfer!.files;
    if (one) attempt(() => upload(one));
  });
}
