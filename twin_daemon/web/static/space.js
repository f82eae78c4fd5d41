// Both hands in space as lines, measured and twin over each other. Drag or use the arrow keys to turn them.
import { dark, element, facts, milli } from "./page.js";

const STEPS_MRAD = [2, 10, 50], WORDS = ["below 2 mrad", "2 to 10 mrad", "10 to 50 mrad", "50 mrad or more"];
const COLOURS = { light: ["#2b8a3e", "#e67700", "#d9480f", "#a61e4d"], dark: ["#69db7c", "#ffd43b", "#ff922b", "#faa2c1"] };
const WIDTHS = [3, 4, 6, 8];
let turn = 0.5, tilt = 0.25, last = null;

export function start() {
  const canvas = element("space");
  let from = null;
  canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY, turn, tilt]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    if (!from || !event.buttons) return;
    turn = from[2] + (event.clientX - from[0]) / 150;
    tilt = from[3] + (event.clientY - from[1]) / 150;
    if (last) draw(...last);
  });
  canvas.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (!moves) return;
    event.preventDefault();
    turn += moves[0];
    tilt += moves[1];
    if (last) draw(...last);
  });
}

const step = (residual) => (residual === null ? 0 : STEPS_MRAD.filter((limit) => 1e3 * Math.abs(residual) >= limit).length);

// `hands`: points of the measured and of the twin's hand (m); `residuals` by joint (rad).
export function draw(hands, residuals) {
  last = [hands, residuals];
  const canvas = element("space"), ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d"), colours = COLOURS[dark.matches ? "dark" : "light"];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.lineCap = "round";
  const used = [...new Set(facts.bones.flatMap((bone) => [bone.start, bone.end]))];
  const middle = [0, 1, 2].map((axis) => used.reduce((sum, point) => sum + hands[0][point][axis], 0) / used.length);
  const reach = Math.max(...used.map((point) => Math.hypot(...hands[0][point].map((value, axis) => value - middle[axis]))), 0.05);
  const scale = (0.45 * Math.min(width, height)) / reach;
  const at = (point) => {
    const [x, y, z] = point.map((value, axis) => value - middle[axis]);
    const right = x * Math.cos(turn) + y * Math.sin(turn), depth = -x * Math.sin(turn) + y * Math.cos(turn);
    return [width / 2 + scale * right, height / 2 - scale * (z * Math.cos(tilt) + depth * Math.sin(tilt))];
  };
  const line = (hand, bone) => { pen.beginPath(); pen.moveTo(...at(hand[bone.start])); pen.lineTo(...at(hand[bone.end])); pen.stroke(); };
  const style = getComputedStyle(document.documentElement);
  let worst = { residual: 0, name: "" };
  for (const bone of facts.bones) {
    const turned = bone.joints.map((joint) => [Math.abs(residuals[joint] ?? 0), facts.joints[joint]]).sort((a, b) => b[0] - a[0])[0] ?? [0, ""];
    if (turned[0] > worst.residual) worst = { residual: turned[0], name: turned[1] };
    const level = step(turned[0]);
    pen.setLineDash([]);
    pen.strokeStyle = colours[level];
    pen.lineWidth = WIDTHS[level];
    line(hands[0], bone);
  }
  pen.strokeStyle = style.getPropertyValue("--ink").trim();
  pen.lineWidth = 1.5;
  pen.setLineDash([4, 4]);
  for (const bone of facts.bones) line(hands[1], bone);
  element("space-words").textContent = worst.name ? `Largest now: ${worst.name}, ${milli(worst.residual)} mrad (${WORDS[step(worst.residual)]}).` : "No residual is known yet.";
}
