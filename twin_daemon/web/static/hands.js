// The hands of the network: each with its state, and the way to its page.
import { element, facts, made, milli } from "./page.js";

const LOOKS = { following: "good", no_commands: "odd", waiting: "odd" };
const shown = new Map(); // by namespace

export function show(hands) {
  if (!hands.length) return;
  // opened before any hand was seen: the first that is there
  if (!location.search && !hands.some((one) => one.namespace === facts.namespace)) location.search = `?hand=${encodeURIComponent(hands[0].namespace)}`;
  const list = element("hands");
  if (!shown.size) list.replaceChildren();
  for (const [name, { item }] of shown) if (!hands.some((one) => one.namespace === name)) { item.remove(); shown.delete(name); }
  hands.forEach((hand, place) => {
    if (!shown.has(hand.namespace)) shown.set(hand.namespace, line(hand.namespace));
    const { item, lamp, words } = shown.get(hand.namespace);
    const worst = hand.worst_joint && hand.status !== "away" ? `worst ${hand.worst_joint}, rms ${milli(hand.worst_rmse_rad)} mrad` : "";
    const drift = hand.drifting_joints.length ? `drifting: ${hand.drifting_joints.join(", ")}` : "";
    put(lamp, hand.status.replace("_", " "));
    lamp.className = `word ${LOOKS[hand.status] ?? "bad"}`;
    put(words, [worst, drift].filter(Boolean).join("; "));
    if (list.children[place] !== item) list.insertBefore(item, list.children[place] ?? null);
  });
}

function line(namespace) {
  const lamp = made("span"), words = made("span", { className: "soft" });
  const link = made("a", { href: `/?hand=${encodeURIComponent(namespace)}` }, namespace);
  if (namespace === facts.namespace) link.setAttribute("aria-current", "page");
  return { item: made("li", {}, lamp, link, " ", words), lamp, words };
}

function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
