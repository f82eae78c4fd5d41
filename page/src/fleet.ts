// The hands of the network: each with its state, and the way to its page.
import { facts } from "./api";
import { made, milli, put } from "./dom";
import { now } from "./live";

const LOOKS: Record<string, string> = { following: "good", no_commands: "odd", waiting: "odd" };
const shown = new Map<string, { item: HTMLElement; lamp: HTMLElement; words: HTMLElement }>();
const list = made("ul", { id: "hands" }, made("li", { className: "soft" }, "No hand has been seen on the network yet."));
const others = facts.own ? `Recordings and versions are those of ${facts.kept_of} on this machine; they change no hand elsewhere.`
  : `Only the live view is shown: this workbench has the recordings and versions of ${facts.kept_of}.`;
export const nav = made("nav", { id: "fleet", "aria-label": "Hands", title: others }, list, made("span", { className: "soft tiny" }, others));

function show(): void {
  const hands = now.fleet;
  if (!hands.length) return;
  // opened before any hand was seen: the first that is there
  if (!location.search && !hands.some((one) => one.namespace === facts.namespace)) location.search = `?hand=${encodeURIComponent(hands[0].namespace)}`;
  if (!shown.size) list.replaceChildren();
  for (const [name, { item }] of shown) if (!hands.some((one) => one.namespace === name)) { item.remove(); shown.delete(name); }
  hands.forEach((hand, place) => {
    if (!shown.has(hand.namespace)) shown.set(hand.namespace, line(hand.namespace));
    const { item, lamp, words } = shown.get(hand.namespace)!;
    const worst = hand.worst_joint && hand.status !== "away" ? `worst ${hand.worst_joint}, rms ${milli(hand.worst_rmse_rad)} mrad` : "";
    const drift = hand.drifting_joints.length ? `drifting: ${hand.drifting_joints.join(", ")}` : "";
    put(lamp, hand.status.replace("_", " "));
    lamp.className = `word ${LOOKS[hand.status] ?? "bad"}`;
    put(words, [worst, drift].filter(Boolean).join("; "));
    if (list.children[place] !== item) list.insertBefore(item, list.children[place] ?? null);
  });
}

function line(namespace: string) {
  const lamp = made("span"), words = made("span", { className: "soft" });
  const link = made("a", { href: `/?hand=${encodeURIComponent(namespace)}` }, namespace);
  if (namespace === facts.namespace) link.setAttribute("aria-current", "page");
  return { item: made("li", {}, lamp, " ", link, " ", words), lamp, words };
}

export const start = () => { addEventListener("about", show); };
