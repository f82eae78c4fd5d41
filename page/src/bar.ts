// The one bar: which robot, how it is, what is in use, and the stop.
import { allowed, facts, needsAuthorization, post, say, works } from "./api";
import { icon, made, milli, number, put } from "./dom";
import { keepButton } from "./keep";
import { now } from "./live";
import { setTheme, theme, type Theme } from "./state";
import moon from "lucide-static/icons/sun-moon.svg?raw";
import search from "lucide-static/icons/search.svg?raw";

const LOOKS: Record<string, string> = { following: "good", no_commands: "odd", waiting: "odd" };
const presence = made("b", { id: "presence", className: "word" }, "connecting"), words = made("span", { id: "words", className: "hidden" }, "The page connects to its server.");
const about = made("ul", { id: "about" });
const label = facts.driver_stop ? `Stop ${facts.fleet ? facts.namespace : "the hand"}` : `Latch the gate${facts.fleet ? ` of ${facts.namespace}` : ""}`;
const stop = made("button", { type: "button", id: "stop", className: "danger", title: facts.driver_stop ? "Latches the gate, and stops the hand's driver" : "This hand's description names no stop of its driver: commands of somebody else go on." }, label);
const palette = made("button", { type: "button", id: "palette-open", className: "plain", title: "All commands (Ctrl-K)" }, icon(search), made("kbd", {}, "Ctrl K"));
const themes = made("button", { type: "button", id: "theme", className: "plain" }, icon(moon), made("span", { className: "hidden" }, "Light or dark"));
const reason = made("input", { id: "release-reason", maxLength: 400, size: 18, placeholder: "Reason", "aria-label": "Reason of the release" });
const release = made("button", { type: "button", id: "release" }, "Release the gate");
const name = made("input", { id: "release-name", maxLength: 64, size: 10, autocomplete: "username" }), key = made("input", { id: "release-key", type: "password", maxLength: 128, size: 20, autocomplete: "off" });
const releaseBox = made("div", { id: "release-box", className: "strip", hidden: true }, made("b", {}, "The gate is latched."), reason, release,
  made("details", {}, made("summary", {}, "In my own name"), made("label", {}, "Name ", name), made("label", {}, " Key ", key)));
const automaticWords = made("strong", { id: "automatic-words" }), cancel = made("button", { type: "button", id: "cancel" }, "Cancel it");
const automatic = made("div", { id: "automatic", className: "strip danger", role: "alert", hidden: true }, automaticWords, cancel);
const away = made("div", { id: "away", className: "strip", role: "status", hidden: true });
const reading = made("div", { id: "allowed", className: "strip soft" }, "This page only looks: what keeps, adds or promotes needs the address with the token that 'twin workbench' printed.");
reading.hidden = allowed();

export const header = made("header", { id: "bar" }, made("h1", {}, facts.namespace), presence, words, about, made("span", { className: "gap" }), palette, themes, keepButton("", "keep"), stop);
export const strips = made("div", { className: "strips-above" }, automatic, releaseBox, away, reading);

function show(): void {
  const known = now.about;
  const word = now.lost ? "lost" : known?.presence ?? "connecting", look = now.lost ? "bad" : LOOKS[word] ?? "bad";
  put(presence, word.replace("_", " "));
  presence.className = `word ${known || now.lost ? look : ""}`;
  const told = now.lost ? "The workbench's server is away. What is shown is from before; this page tries again by itself." : known?.words ?? "The page connects to its server.";
  put(words, told);
  presence.title = told;
  put(away, told);
  away.hidden = word === "following" || (!known && !now.lost);
  if (!known) return;
  automatic.hidden = !known.automatic;
  put(automaticWords, known.automatic ?? "");
  releaseBox.hidden = known.gate !== "stopped";
  const version = known.version ? `${known.version.slice(0, 12)}${known.version_title && known.version !== "nominal" ? ` ${known.version_title}` : ""}` : "unknown";
  const said: Record<string, string> = {
    version, rate: known.rate_hz ? `${number(known.rate_hz, 3)} Hz` : "unknown", p99: known.latency_p99_s ? `${milli(known.latency_p99_s, 2)} ms` : "unknown",
    drift: known.drift ? known.drift + (known.drifting_joints.length ? `: ${known.drifting_joints.join(", ")}` : "") : "unknown",
    gate: (known.gate ?? "none").replaceAll("_", " "), "next check": known.recalibration ?? "unknown",
  };
  const troubles = { missing: known.missing, late: known.late, refused: known.refused, errors: known.errors };
  for (const [what, count] of Object.entries(troubles)) if (count) said[what] = String(count);
  about.replaceChildren(...Object.entries(said).map(([what, value]) => made("li", { className: what.replace(" ", "-"), title: `${what} ${value}` }, `${what} `, made("b", {}, value))));
}

export const THEMES: Theme[] = ["system", "light", "dark"];
export function nextTheme(): void {
  const to = THEMES[(THEMES.indexOf(theme()) + 1) % THEMES.length];
  setTheme(to);
  themes.title = `Colours: ${to}`;
}

export function start(): void {
  works(stop, async () => {
    const answer = await post("/api/stop", { hand: facts.namespace, reason: "the stop of the workbench" });
    say(`${answer.words}.`, answer.safe ? "note" : "error");
  });
  works(cancel, async () => {
    const answer = await post("/api/cancel", { hand: facts.namespace, reason: "the page of the workbench" });
    say(`${answer.why}.`, "note");
  });
  works(needsAuthorization(release), async () => {
    const body = { hand: facts.namespace, reason: reason.value, name: name.value, key: key.value };
    key.value = ""; // it is for one request, and kept nowhere
    const answer = await post("/api/release", body);
    say(answer.accepted ? "Released; not armed." : `Not released: ${answer.why}. ${answer.allowed ?? ""}`, answer.accepted ? "note" : "error");
    if (answer.accepted) reason.value = "";
  });
  themes.title = `Colours: ${theme()}`;
  themes.addEventListener("click", nextTheme);
  addEventListener("about", show);
}
