// The library of effects: each with its drawing, what it does to a motion, and the way to add it by hand.
import { attempt, needsAuthorization, read, works } from "./api";
import { effect, hear, known } from "./data";
import { drawing } from "./drawings";
import { made, put } from "./dom";
import { begin } from "./jobs";
import { lines } from "./sketch";
import { on, select, selection } from "./state";
import * as trial from "./trial";

const choice = made("select", { id: "effect" }), place = made("select", { id: "place" }), add = needsAuthorization(made("button", { type: "button", id: "add", className: "primary" }, "Add and refit"));
const picture = made("div", { id: "effect-picture" }), text = made("p", { id: "effect-text" }), words = made("p", { id: "effect-words", className: "soft" }), chart = made("div", { id: "effect-figure" });
const gallery = made("div", { id: "gallery", className: "gallery" });
export const panel = made("div", { className: "panel effects" },
  made("p", { className: "controls" }, made("label", {}, "Effect ", choice), made("label", {}, " at ", place), add), trial.box, picture, text, words, chart,
  made("h3", {}, "All effects"), gallery);
let pictured = "";

function explain(): void {
  const one = effect(choice.value);
  if (!one) return;
  picture.replaceChildren(drawing(one.key, one.title));
  put(text, `${one.title} (acts on: ${one.acts_on}). ${one.story.what} ${one.story.shows} Likely cause: ${one.story.cause} What to do: ${one.story.remedy}`);
  for (const card of gallery.children) card.setAttribute("aria-pressed", String((card as HTMLElement).dataset.key === one.key));
  attempt(sketched);
  byHand();
}

const byHand = () => { if (panel.offsetParent !== null && choice.value) attempt(() => trial.choose(choice.value, place.value)); };

// The twin with and without the effect, under the same commands; computed only while somebody looks.
async function sketched(): Promise<void> {
  if (panel.offsetParent === null || !known.effects.length) return;
  const wanted = new URLSearchParams({ effect: choice.value, place: place.value }).toString();
  if (wanted === pictured) return;
  pictured = wanted;
  chart.replaceChildren();
  put(words, "The twin is being rolled out ...");
  try {
    const found = await read(`/api/effect?${wanted}`);
    if (pictured !== wanted) return;
    put(words, found.words);
    const off = found.with_effect.map((value: number, at: number) => 1e3 * (value - found.without[at]));
    chart.append(lines("The motion", found.time_s, [["commanded", "command", found.commanded], ["without it", "ink", found.without], ["with it", "twin", found.with_effect]], "rad"),
      lines("The difference", found.time_s, [["with it, less without", "twin", off]], "mrad"));
  } catch (error) {
    if (pictured === wanted) put(words, (error as Error).message);
  }
}

function fill(): void {
  choice.replaceChildren(...known.effects.map((one) => made("option", {}, one.key)));
  place.replaceChildren(...known.places.map((name) => made("option", {}, name)));
  gallery.replaceChildren(...known.effects.map((one) => {
    const card = made("button", { type: "button", className: "effect", "data-key": one.key }, made("span", {}, one.key.replaceAll("_", " ")));
    card.prepend(drawing(one.key, one.title));
    card.addEventListener("click", () => { choice.value = one.key; explain(); panel.scrollTop = 0; });
    return card;
  }));
  if (known.places.includes(selection.joint)) place.value = selection.joint;
  explain();
}

export function start(): void {
  choice.addEventListener("change", explain);
  place.addEventListener("change", () => { attempt(sketched); byHand(); });
  works(add, async () => {
    await begin("add", { effect: choice.value, joint: place.value });
    select({ step: "add" });
  });
  trial.start();
  hear(["effects"], fill);
  hear(["opened"], byHand);
  on(["version"], byHand);
  on(["joint"], () => { if (known.places.includes(selection.joint) && panel.offsetParent === null) { place.value = selection.joint; explain(); } });
  new ResizeObserver(() => { attempt(sketched); byHand(); }).observe(panel);
}
