// The compare view: one recording, one or two versions, charts that share cursor and zoom.
import { refresh } from "./choices.js";
import { CONFIG, look, show as figure, themed } from "./figures.js";
import { attempt, dark, element, made, milli, number, read, row, say, works } from "./page.js";

const LEFT = 64, RIGHT = 16, SHOWN = 4, AGAIN_MS = 400;
const COLOURS = { measured: "#1b1f24", twins: ["#d9480f", "#0b7285"], residual: ["#1971c2", "#c2255c"], command: "#868e96" };
let opened = null, shown = [], range = null, at = null, curves = {}, asking = null, later = 0, generation = 0, following = false;
const plots = new Map(); // by joint

const versions = () => [...new Set([element("version-a").value, element("version-b").value].filter(Boolean))];
const onset = () => (element("onset").value ? [["onset_s", element("onset").value]] : []);
const query = (more) => new URLSearchParams([["recording", element("recording").value], ...versions().map((one) => ["version", one]), ...onset(), ...more]);

export function start() {
  element("recording").addEventListener("change", () => { element("onset").value = ""; });
  for (const id of ["recording", "version-a", "version-b", "onset"]) element(id).addEventListener("change", () => attempt(open));
  element("lag").addEventListener("change", () => attempt(window_));
  element("state-joint").addEventListener("change", () => attempt(state));
  works(element("again"), refresh);
  element("joined").addEventListener("keydown", keys);
  element("joined").addEventListener("pointermove", pointed);
  dark.addEventListener("change", () => { for (const joint of plots.keys()) draw(joint); });
  addEventListener("resize", cursor);
}

const failed = (error) => say(error.message);

export async function open() {
  const mine = ++generation, began = performance.now();
  element("compared").hidden = true;
  if (!element("recording").value) { element("opened").textContent = ""; return; }
  element("opened").textContent = "Reading the recording ...";
  try {
    opened = await read(`/api/recording?${query([])}`);
  } catch (error) {
    element("opened").textContent = error.message;
    throw error;
  }
  if (mine !== generation) return;
  range = [0, opened.seconds];
  element("onset-label").hidden = opened.commands_recorded;
  at = null;
  const moving = opened.joints.filter((joint) => joint.moves).map((joint) => joint.name);
  choose(moving.length ? moving.slice(0, SHOWN) : opened.joints.slice(0, SHOWN).map((joint) => joint.name));
  element("compared").hidden = false;
  element("errors").replaceChildren(...moving.map((name) => row(name, "", "", "", "", "", "", pick(name))));
  element("worst").replaceChildren();
  element("heat").replaceChildren();
  element("state").replaceChildren();
  await window_();
  element("opened").textContent = `${opened.name}: ${number(opened.seconds, 4)} s, ${opened.samples} samples at ${number(opened.rate_hz, 4)} Hz, `
    + `${moving.length === 1 ? "1 joint moves" : `${moving.length} joints move`}. ${opened.commands_recorded ? "Commands recorded." : "No commands recorded: the onset is estimated."} ${opened.notes.join(" ")} `
    + `Shown after ${((performance.now() - began) / 1e3).toFixed(1)} s.`;
  document.documentElement.dataset.opened = element("recording").value;
  await errors(mine);
}

const pick = (name) => {
  const box = made("input", { type: "checkbox", checked: shown.includes(name), "aria-label": `chart of ${name}` });
  box.addEventListener("change", () => {
    choose(box.checked ? [...shown, name] : shown.filter((one) => one !== name));
    window_().catch(failed);
  });
  return box;
};

function choose(names) {
  shown = names;
  for (const [joint, plot] of plots) { Plotly.purge(plot.holder); plot.figure.remove(); plots.delete(joint); }
  for (const name of names) {
    const holder = made("div", { className: "plot", role: "img", "aria-label": `${name}: measured, twin and command over time, the residual below` });
    const readout = made("span", { className: "readout" });
    const box = made("figure", {}, made("figcaption", {}, made("h4", {}, name), readout), holder);
    plots.set(name, { holder, readout, figure: box, ready: false });
    element("joined").append(box);
  }
}

// The range on the screen, asked for anew at each zoom: every sample where they are few enough. The newest request
// is the one that counts; one that it overtook ends quietly, whoever waits for it.
async function window_() {
  const mine = generation, request = new AbortController();
  asking?.abort();
  clearTimeout(later);
  asking = request;
  const wanted = query([["from", range[0]], ["to", range[1]], ["lag_ms", element("lag").value || "0"], ...shown.map((name) => ["joint", name])]);
  const found = await read(`/api/window?${wanted}`, request.signal).catch((error) => { if (request === asking) throw error; });
  if (mine !== generation || request !== asking) return;
  curves = found.curves;
  await Promise.all(shown.map(draw));
  element("reduced").textContent = found.exact ? "Every sample is drawn."
    : `Reduced: of ${found.samples} samples each chart has the extremes of every stretch.`;
  cursor();
  if (found.pending.length) {
    element("reduced").textContent += " The twin is being rolled out under the recorded commands ...";
    later = setTimeout(() => { if (mine === generation) window_().catch(failed); }, AGAIN_MS);
  } else document.documentElement.dataset.compared = versions().join(" ");
}

async function draw(joint) {
  const plot = plots.get(joint), curve = curves[joint];
  if (!plot || !curve) return;
  const line = (name, y, color, dash, yaxis = "y") => ({ x: curve.t, y, name, mode: "lines", yaxis, line: { color, width: 1.4, dash } });
  const data = [];
  if (curve.command.some((value) => value !== null)) data.push(line("command", curve.command, COLOURS.command, "dot"));
  data.push(line("measured", curve.measured, COLOURS.measured, "solid"));
  versions().forEach((version, index) => {
    const twin = curve.twins[version], dash = index ? "dash" : "solid";
    if (!twin) return;
    data.push(line(`twin ${version.slice(0, 12)}`, twin, COLOURS.twins[index], dash));
    data.push(line(`residual ${version.slice(0, 12)}`, twin.map((value, k) => (value === null || curve.measured[k] === null ? null : 1e3 * (curve.measured[k] - value))), COLOURS.residual[index], dash, "y2"));
  });
  const layout = look({
    margin: { l: LEFT, r: RIGHT, t: 8, b: 40 }, showlegend: false, hovermode: false, height: 300,
    xaxis: { title: { text: "time since the first sample (s)" }, anchor: "y2", range: [...range] },
    yaxis: { title: { text: "rad" }, domain: [0.4, 1], fixedrange: true },
    yaxis2: { title: { text: "residual (mrad)" }, domain: [0, 0.32], fixedrange: true, zeroline: true },
  });
  following = true;
  await Plotly.react(plot.holder, themed(data), layout, CONFIG);
  following = false;
  if (plot.ready) return;
  plot.ready = true;
  plot.holder.on("plotly_relayout", (change) => {
    if (following) return;
    if (change["xaxis.autorange"]) zoom([0, opened.seconds]);
    else if ("xaxis.range[0]" in change) zoom([change["xaxis.range[0]"], change["xaxis.range[1]"]]);
  });
}

function zoom([from, to]) {
  const low = Math.max(0, Math.min(from, opened.seconds)), high = Math.min(opened.seconds, Math.max(to, 0));
  if (!(high > low)) return;
  range = [low, high];
  return window_().catch(failed);
}

// -- one cursor

function cursor() {
  const line = element("joined").querySelector(".cursor"), first = plots.values().next().value;
  const hidden = at === null || !first || at < range[0] || at > range[1];
  line.hidden = hidden;
  element("cursor-at").textContent = at === null ? "no time chosen" : `${at.toFixed(4)} s`;
  if (!hidden) {
    const area = first.holder.getBoundingClientRect(), box = element("joined").getBoundingClientRect();
    line.style.left = `${area.left - box.left + LEFT + ((area.width - LEFT - RIGHT) * (at - range[0])) / (range[1] - range[0])}px`;
  }
  for (const [joint, plot] of plots) plot.readout.textContent = readout(curves[joint]);
}

function readout(curve) {
  if (at === null || !curve?.t.length) return "";
  let low = 0, high = curve.t.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (curve.t[middle] < at) low = middle; else high = middle; }
  const near = at - curve.t[low] < curve.t[high] - at ? low : high, rad = (value) => (value === null ? "none" : `${value.toFixed(4)} rad`);
  return [`measured ${rad(curve.measured[near])}`, ...versions().filter((version) => curve.twins[version]).map((version) =>
    `twin ${version.slice(0, 12)} ${rad(curve.twins[version][near])}`)].join(", ");
}

function pointed(event) {
  const first = plots.values().next().value;
  if (!first || !opened) return;
  const area = first.holder.getBoundingClientRect(), share = (event.clientX - area.left - LEFT) / (area.width - LEFT - RIGHT);
  if (share >= 0 && share <= 1) { at = range[0] + share * (range[1] - range[0]); cursor(); }
}

function keys(event) {
  if (event.ctrlKey || event.altKey || event.metaKey || !opened) return;
  const span = range[1] - range[0], step = span * (event.shiftKey ? 0.05 : 0.005), here = at ?? (range[0] + range[1]) / 2;
  const move = (to) => { at = Math.min(opened.seconds, Math.max(0, to)); cursor(); };
  const actions = {
    ArrowLeft: () => move(here - step), ArrowRight: () => move(here + step), "+": () => zoom([here - span / 4, here + span / 4]),
    "-": () => zoom([here - span, here + span]), 0: () => zoom([0, opened.seconds]), Escape: () => { at = null; cursor(); },
  };
  if (!Object.hasOwn(actions, event.key)) return;
  event.preventDefault();
  actions[event.key]();
}

// -- errors, and where it fails

async function asked(path, mine) {
  for (;;) {
    const found = await read(path);
    if (mine !== generation) return null;
    if (!found.pending) return found;
    await new Promise((done) => { setTimeout(done, AGAIN_MS); });
  }
}

async function errors(mine) {
  const [first, second] = versions(), base = [["recording", element("recording").value], ...onset()];
  const of = (version) => asked(`/api/errors?${new URLSearchParams([...base, ["version", version]])}`, mine);
  element("errors-caption").textContent = "Errors are being computed ...";
  const found = await of(first), other = second && found ? await of(second) : null;
  if (!found || mine !== generation) return;
  const names = Object.keys(found.joints);
  element("errors-caption").textContent = found.mse_rad2 === null ? "No joint moves by more than 0.05 rad: there is nothing to compare."
    : `${milli(Math.sqrt(found.mse_rad2))} mrad rms over ${names.length === 1 ? "the joint that moves" : `the ${names.length} joints that move`}`
      + `${other ? ` (second version: ${milli(Math.sqrt(other.mse_rad2))} mrad)` : ""}; the sensors' noise is ${milli(Math.sqrt(found.noise_floor_rad2), 2)} mrad`
      + `${found.onset_estimated ? `; the onset of the commands is estimated at ${number(found.onset_s, 4)} s` : ""}`;
  element("other-head").hidden = !other;
  const worstFirst = names.slice(0, SHOWN);
  if (shown.join() !== worstFirst.join()) { choose(worstFirst); await window_(); }
  element("errors").replaceChildren(...names.map((name) => {
    const error = found.joints[name], cells = [milli(error.rmse_rad), milli(error.max_abs_rad), milli(error.bias_rad), milli(error.lag_s), milli(Math.sqrt(error.noise_rad2), 2)];
    const line = row(name, ...cells, other ? milli(other.joints[name]?.rmse_rad) : "", pick(name));
    line.children[6].hidden = !other;
    return line;
  }));
  element("worst").replaceChildren(...found.worst.map((one) => {
    const button = made("button", { type: "button" }, "show");
    button.addEventListener("click", () => moment(one.joint, one.worst_s).catch(failed));
    const cells = row(one.joint, one.condition, milli(one.rmse_rad), milli(one.bias_rad), made("span", {}, `${one.worst_s.toFixed(3)} s `, button));
    return cells;
  }));
  element("state-joint").replaceChildren(...names.map((name) => made("option", {}, name)));
  if (found.heat) {
    const holder = made("div");
    element("heat").replaceChildren(holder);
    await figure(holder, found.heat);
    holder.on("plotly_click", (event) => {
      const [line, column] = event.points[0].pointIndex ?? event.points[0].pointNumber, cell = event.points[0].data.customdata[line][column];
      if (cell) moment(found.heat_joints[line], cell[1]).catch(failed);
    });
    await state();
  }
  document.documentElement.dataset.judged = versions().join(" ");
}

async function moment(joint, time) {
  if (!shown.includes(joint)) choose([joint, ...shown]);
  const width = Math.min(opened.seconds, 4);
  at = time;
  await zoom([time - width / 2, time + width / 2]);
  plots.get(joint).figure.scrollIntoView({ block: "center" });
  element("joined").focus({ preventScroll: true });
}

async function state() {
  const joint = element("state-joint").value;
  if (!joint) return;
  const found = await asked(`/api/residual-over-state?${new URLSearchParams([["recording", element("recording").value], ["version", versions()[0]], ["joint", joint], ...onset()])}`, generation);
  if (!found) return;
  const holder = made("div");
  element("state").replaceChildren(holder);
  await figure(holder, found.figure);
}
