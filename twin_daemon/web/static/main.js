// Starts the page: the authorization out of its address, the views and their keys.
import { allowed, element, facts } from "./page.js";
import * as choices from "./choices.js";
import * as compare from "./compare.js";
import * as past from "./history.js";
import * as learn from "./learn.js";
import * as live from "./live.js";

const VIEWS = facts.own ? ["live", "compare", "learn", "history"] : ["live"];
const opened = { live, compare, learn, history: past };

function show() {
  const wanted = location.hash.slice(1).split("/")[0], name = VIEWS.includes(wanted) ? wanted : "live";
  for (const view of VIEWS) element(`view-${view}`).hidden = view !== name;
  for (const link of document.querySelectorAll("#tabs a"))
    if (link.hash === `#${name}`) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current");
  opened[name]?.show?.();
}

addEventListener("hashchange", show);
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest("input, select, textarea")) return;
  const view = VIEWS[Number(event.key) - 1];
  if (view) location.hash = view;
});
element("allowed").textContent = allowed()
  ? "" : "This page only looks: what keeps, adds or promotes needs the address with the token that 'twin workbench' printed.";
for (const view of Object.values(opened)) view.start();
show();
choices.start().then(() => { document.documentElement.dataset.ready = "yes"; });
