"use strict";
// Draws the figures one after another, gives them the look of the page (light, dark, print), and moves one cursor
// and one zoom through all figures of a recording.
(() => {
  const LEFT = 64, RIGHT = 16; // the margins of every figure
  const PRINTED_WIDTH = 680; // an A4 page between its margins
  const SAME = "same"; // stands for the times of the first curve
  const inDark = JSON.parse(document.getElementById("colours").textContent);
  const prefersDark = matchMedia("(prefers-color-scheme: dark)");
  const charts = [...document.querySelectorAll("figure.chart")].map((holder) => ({
    holder,
    plot: holder.querySelector(".plot"),
    source: holder.querySelector("script").textContent,
    group: holder.dataset.group,
    kind: holder.dataset.kind,
    curves: null,
  }));
  let printing = false;

  const ARRAYS = { f4: Float32Array, f8: Float64Array, i1: Int8Array, i2: Int16Array, i4: Int32Array, u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };

  function unpacked(value) {
    if (!value || typeof value.bdata !== "string" || value.shape !== undefined) return value;
    const bytes = Uint8Array.from(atob(value.bdata), (sign) => sign.charCodeAt(0));
    return new ARRAYS[value.dtype](bytes.buffer);
  }

  function themed(chart) {
    const dark = prefersDark.matches && !printing;
    const spec = JSON.parse(chart.source, (_, value) => {
      if (dark && typeof value === "string" && Object.hasOwn(inDark, value)) return inDark[value];
      return unpacked(value);
    });
    for (const curve of spec.data) if (curve.x === SAME) curve.x = spec.data[0].x;
    const [ink, grid, zero] = dark ? ["#e9ecef", "#2a3038", "#5c6570"] : ["#1b1f24", "#e3e7eb", "#adb5bd"];
    const layout = spec.layout;
    layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
    layout.font = { color: ink, size: 12 };
    layout.hoverlabel = { bgcolor: dark ? "#1d2126" : "#ffffff", font: { color: ink } };
    layout.width = printing ? PRINTED_WIDTH : undefined;
    layout.autosize = !printing;
    for (const name of Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key))) {
      layout[name] = { gridcolor: grid, zerolinecolor: zero, linecolor: zero, ...layout[name] };
      if (chart.kind === "overlay" && name[0] === "y") layout[name].fixedrange = true;
    }
    return spec;
  }

  function draw(chart) {
    const spec = themed(chart);
    const zoom = chart.curves && chart.group ? chart.plot.layout.xaxis.range : null;
    if (zoom && !printing) spec.layout.xaxis.range = zoom;
    const config = { responsive: true, displayModeBar: false };
    const first = chart.curves === null;
    chart.curves = spec.data;
    Plotly.react(chart.plot, spec.data, spec.layout, config);
    if (!first) return;
    if (chart.kind === "overlay") chart.plot.on("plotly_relayout", (change) => follow(chart, change));
    if (chart.kind === "conditions") chart.plot.on("plotly_click", (event) => fromCell(event.points[0]));
  }

  function drawNext() {
    const next = charts.find((chart) => chart.curves === null);
    if (!next) {
      document.documentElement.dataset.drawn = "all";
      return;
    }
    draw(next);
    setTimeout(drawNext, 0);
  }

  // -- one zoom

  const motions = new Map();
  for (const box of document.querySelectorAll(".motion")) {
    const members = charts.filter((chart) => chart.group === box.dataset.group);
    const whole = JSON.parse(members[0].source).layout.xaxis.range;
    motions.set(box.dataset.group, {
      box, members, whole, range: whole, at: null,
      line: box.querySelector(".cursor"), time: document.getElementById(`time-${box.dataset.group}`),
    });
  }
  let following = false;

  function follow(chart, change) {
    if (following || printing) return;
    const motion = motions.get(chart.group);
    if (change["xaxis.autorange"]) zoomTo(motion, motion.whole);
    else if ("xaxis.range[0]" in change) zoomTo(motion, [change["xaxis.range[0]"], change["xaxis.range[1]"]]);
    else if (change["xaxis.range"]) zoomTo(motion, change["xaxis.range"]);
  }

  function zoomTo(motion, range) {
    const [first, last] = motion.whole;
    const low = Math.max(first, Math.min(range[0], last)), high = Math.min(last, Math.max(range[1], first));
    if (!(high > low)) return;
    motion.range = [low, high];
    following = true;
    const moved = motion.members.filter((member) => member.curves !== null).map((member) =>
      Plotly.relayout(member.plot, { "xaxis.range": [low, high], "xaxis.autorange": false }));
    Promise.all(moved).finally(() => { following = false; });
    showCursor(motion);
  }

  // -- one cursor

  function pixels(motion) {
    const area = motion.members[0].plot.getBoundingClientRect(), box = motion.box.getBoundingClientRect();
    return { start: area.left - box.left + LEFT, span: area.width - LEFT - RIGHT, box };
  }

  function showCursor(motion) {
    const [low, high] = motion.range, hidden = motion.at === null || motion.at < low || motion.at > high;
    motion.line.hidden = hidden;
    motion.time.textContent = motion.at === null ? "no time chosen" : `${motion.at.toFixed(3)} s`;
    if (!hidden) {
      const { start, span } = pixels(motion);
      motion.line.style.left = `${start + (span * (motion.at - low)) / (high - low)}px`;
    }
    for (const member of motion.members) member.holder.querySelector(".readout").textContent = readout(member, motion.at);
  }

  function readout(chart, at) {
    if (at === null || chart.curves === null) return "";
    const said = chart.curves.map((curve) => {
      const value = curve.y[nearest(curve.x, at)];
      if (!Number.isFinite(value)) return `${curve.name}: none`;
      return curve.yaxis === "y2" ? `${curve.name} ${value.toFixed(2)} mrad` : `${curve.name} ${value.toFixed(4)} rad`;
    });
    return said.join(", ");
  }

  function nearest(times, at) {
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] < at) low = middle; else high = middle;
    }
    return at - times[low] < times[high] - at ? low : high;
  }

  function point(motion, at) {
    const [first, last] = motion.whole;
    motion.at = Math.min(last, Math.max(first, at));
    const [low, high] = motion.range;
    if (motion.at < low) zoomTo(motion, [motion.at, motion.at + high - low]);
    else if (motion.at > high) zoomTo(motion, [motion.at - (high - low), motion.at]);
    else showCursor(motion);
  }

  for (const motion of motions.values()) {
    motion.box.addEventListener("pointermove", (event) => {
      const { start, span, box } = pixels(motion), share = (event.clientX - box.left - start) / span;
      if (share >= 0 && share <= 1) point(motion, motion.range[0] + share * (motion.range[1] - motion.range[0]));
    });
    motion.box.addEventListener("keydown", (event) => {
      const [low, high] = motion.range, span = high - low, at = motion.at ?? (low + high) / 2;
      const step = span * (event.shiftKey ? 0.05 : 0.005), near = (width) => [at - width / 2, at + width / 2];
      const keys = {
        ArrowLeft: () => point(motion, at - step), ArrowRight: () => point(motion, at + step),
        Home: () => point(motion, motion.whole[0]), End: () => point(motion, motion.whole[1]),
        "+": () => zoomTo(motion, near(span / 2)), "-": () => zoomTo(motion, near(span * 2)),
        0: () => zoomTo(motion, motion.whole), Escape: () => { motion.at = null; showCursor(motion); },
      };
      if (event.ctrlKey || event.altKey || event.metaKey || !Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  // -- from a condition to the moment where it is worst

  function goTo(number, joint, at) {
    const motion = motions.get(`recording-${number + 1}`);
    const chart = motion?.members.find((member) => member.holder.dataset.joint === joint);
    if (!chart) return;
    const width = Math.min(motion.whole[1] - motion.whole[0], 4);
    zoomTo(motion, [at - width / 2, at + width / 2]);
    point(motion, at);
    chart.holder.scrollIntoView({ block: "center" });
    motion.box.focus({ preventScroll: true });
  }

  function fromCell(cell) {
    const [row, column] = cell.pointIndex ?? cell.pointNumber, moment = cell.data.customdata[row][column];
    const names = JSON.parse(document.getElementById("conditions-joints").textContent);
    if (moment) goTo(moment[0], names[row], moment[1]);
  }

  for (const button of document.querySelectorAll("button[data-moment]"))
    button.addEventListener("click", () => goTo(+button.dataset.recording, button.dataset.joint, +button.dataset.moment));

  // -- light, dark, paper

  prefersDark.addEventListener("change", () => charts.filter((chart) => chart.curves !== null).forEach(draw));
  addEventListener("resize", () => motions.forEach(showCursor));
  addEventListener("beforeprint", () => { printing = true; charts.forEach(draw); });
  addEventListener("afterprint", () => { printing = false; charts.forEach(draw); });
  drawNext();
})();
