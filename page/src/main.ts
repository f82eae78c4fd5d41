// Puts the page together: the bar, the path, left and right, the panels, the timeline.
import "uplot/dist/uPlot.min.css";
import "dockview-core/dist/styles/dockview.css";
import "./style.css";
import { banner, facts } from "./api";
import * as bar from "./bar";
import * as data from "./data";
import * as dependence from "./dependence";
import { made, shareNames } from "./dom";
import * as effects from "./effects";
import * as fall from "./fall";
import * as fields from "./fields";
import * as fleet from "./fleet";
import * as hand from "./hand";
import * as history_ from "./history";
import * as inspector from "./inspector";
import * as jobs from "./jobs";
import * as layout from "./layout";
import * as live from "./live";
import * as palette from "./palette";
import * as path from "./path";
import * as plots from "./plots";
import * as sources from "./sources";
import { STEPS, select, showTheme } from "./state";
import * as strips from "./strips";
import * as tables from "./tables";
import * as timeline from "./timeline";
import * as upload from "./upload";

shareNames(facts.joints);
showTheme();
const work = made("div", { id: "work" }, sources.aside, layout.main, facts.own ? inspector.aside : null);
document.body.append(made("a", { className: "skip", href: "#main" }, "Skip to the content"), bar.header, bar.strips,
  ...(facts.fleet ? [fleet.nav] : []), ...(facts.own ? [path.nav] : []), banner, work, timeline.footer);
document.querySelector(".skip")!.addEventListener("click", (event) => { event.preventDefault(); layout.main.focus(); });
addEventListener("wide", () => work.replaceChildren(sources.aside, layout.main, ...(facts.own ? [inspector.aside] : [])));

const own: layout.Panel[] = [
  { id: "dependence", title: "What the error depends on", element: dependence.panel }, { id: "tables", title: "Where it fails", element: tables.panel },
  { id: "fall", title: "Error, held-out motion", element: fall.panel }, { id: "history", title: "History", element: history_.panel }, { id: "effects", title: "Effects", element: effects.panel },
];
const centre: layout.Panel[] = [
  { id: "plots", title: "Over time", element: plots.panel }, { id: "strips", title: "All joints, live", element: strips.panel },
  ...(facts.scene ? [{ id: "hand", title: "Hand", element: hand.panel }] : []), ...(facts.own ? own : []), { id: "events", title: "Events", element: strips.eventsPanel },
];
const beside: layout.Panel[] = [...(facts.own ? [{ id: "inspector", title: "Inspector", element: inspector.aside }] : []), { id: "sidebar", title: "Sources and joints", element: sources.aside }];

for (const part of [bar, sources, upload, strips, timeline]) part.start();
if (facts.fleet) fleet.start();
if (facts.own) for (const part of [fields, path, inspector, tables, dependence, fall, history_, effects]) part.start();
layout.start(centre, beside);
plots.start();
if (facts.scene) hand.start();
palette.start();

const KEYS: Record<string, () => void> = {
  h: strips.toggle, s: () => layout.show("hand"), j: () => document.getElementById("joint-search")?.focus(), " ": timeline.playPause, "?": palette.open,
};
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || (event.target as Element).closest("input, select, textarea, dialog, button, summary")) return;
  const step = STEPS[Number(event.key) - 1];
  if (step && facts.own) select({ step });
  else if (Object.hasOwn(KEYS, event.key) && !(event.key === " " && (event.target as Element).closest("[tabindex]"))) { event.preventDefault(); KEYS[event.key](); }
});
live.start();
jobs.start();
data.start().then(() => data.mark("ready", "yes"));
