// One clear drawing for each effect: a mechanism between motor and joint, or the law as a curve.
import { drawn } from "./dom";

type Part = SVGElement;
const line = (d: string, look = "part") => drawn("path", { d, class: look });
const text = (x: number, y: number, words: string, look = "words", anchor = "middle") => drawn("text", { x, y, class: look, "text-anchor": anchor }, words);
const box = (x: number, words: string, width = 62): Part[] => [drawn("rect", { x, y: 24, width, height: 36, rx: 3, class: "part" }), text(x + width / 2, 46, words)];
const chain = (...middle: Part[]): Part[] => [...box(8, "motor"), ...box(230, "joint"), ...middle];
const link = (from: number, to: number, look = "part") => line(`M${from} 42H${to}`, look);
const spring = (from: number, to: number, y: number, look = "good") => {
  const turns = 8, step = (to - from) / turns;
  return line(`M${from} ${y}${Array.from({ length: turns }, (_, n) => `L${from + step * (n + 0.5)} ${y + (n % 2 ? 8 : -8)}`).join("")}L${to} ${y}`, look);
};
const ground = (x: number, y: number) => line(`M${x - 14} ${y}H${x + 14}M${x - 10} ${y}l-5 7M${x - 2} ${y}l-5 7M${x + 6} ${y}l-5 7M${x + 14} ${y}l-5 7`);

// A law over an axis: zero in the middle; what the model has dashed, what is there solid.
function law(across: string, up: string, model: string, there: string): Part[] {
  return [line("M30 46H282M156 6V80", "axis"), line(model, "model"), line(there, "good"), text(278, 60, across, "words", "end"), text(162, 14, up, "words", "start")];
}
const over = (seconds: string, model: string, there: string): Part[] => [
  line("M30 76H282M30 6V76", "axis"), line(model, "model"), line(there, "good"), text(278, 70, seconds, "words", "end")];
const arm = (more: Part[]): Part[] => [line("M60 66L60 48"), ground(60, 66), drawn("circle", { cx: 60, cy: 44, r: 7, class: "part" }), line("M67 42L206 24", "thick"), ...more];

const DRAWINGS: Record<string, () => Part[]> = {
  backlash: () => chain(link(70, 112), line("M112 24V60", "thick"), line("M112 42H136M192 42H206", "bad dashed"), line("M140 30V54H188V30", "good"), line("M206 24V60", "thick"), link(206, 230), text(160, 76, "play", "words bad")),
  tendon_elasticity: () => chain(link(70, 92), spring(92, 208, 42), link(208, 230), text(150, 74, "the tendon gives way")),
  hysteresis: () => law("position", "pull", "M40 46H272", "M60 70C150 66 200 60 250 18C160 22 110 30 60 70Z"),
  coulomb_friction: () => law("velocity", "friction", "M40 54H156V38H272", "M40 70H156V22H272"),
  viscous_friction: () => law("velocity", "friction", "M40 56L272 36", "M40 78L272 14"),
  stribeck_friction: () => law("velocity", "friction", "M40 56H156V36H272", "M40 60C110 60 148 62 156 80V12C164 30 202 32 272 32"),
  load_friction: () => law("load", "friction", "M40 40H272", "M40 12L156 38L272 12"),
  coupling: () => [...box(8, "motor"), link(70, 120), line("M120 42L170 18H230M120 42L170 66H230", "good"), drawn("rect", { x: 230, y: 6, width: 62, height: 26, rx: 3, class: "part" }), drawn("rect", { x: 230, y: 54, width: 62, height: 26, rx: 3, class: "part" }), text(261, 23, "J2"), text(261, 71, "J1"), text(196, 46, "60 : 40", "words bad")],
  spring: () => chain(link(70, 230), line("M261 60v4", "good"), line("M246 64l6-4 8 8 8-8 8 8-8 4", "good"), ground(261, 74), text(150, 66, "a pull towards one angle")),
  nonlinear_spring: () => law("position", "torque", "M40 62L272 30", "M60 80C80 52 120 46 156 46S232 40 252 10"),
  joint_stop: () => arm([line("M206 24L230 52", "bad dashed"), line("M238 8V62", "good"), line("M238 14l8-6M238 28l8-6M238 42l8-6M238 56l8-6", "good"), spring(216, 238, 38), text(190, 76, "it meets the stop early")]),
  armature: () => [...box(8, "motor"), ...box(230, "joint"), link(70, 230), drawn("ellipse", { cx: 120, cy: 42, rx: 12, ry: 30, class: "good fill" }), text(178, 70, "more to turn")],
  payload: () => arm([drawn("rect", { x: 192, y: 24, width: 30, height: 26, rx: 3, class: "good fill" }), line("M207 54V76M201 70l6 8 6-8", "bad"), text(232, 42, "load", "words", "start")]),
  gravity_tilt: () => [line("M70 74L190 74", "axis"), line("M100 74L140 14", "thick"), line("M100 74V14", "model"), line("M100 26A48 48 0 0 1 126 34", "good"), line("M220 14V64M214 56l6 10 6-10", "bad"), text(232, 44, "gravity", "words", "start")],
  actuator_gain: () => law("error of the angle", "torque", "M50 76L262 16", "M50 62L262 30"),
  dead_zone: () => law("error of the angle", "torque", "M50 76L262 16", "M50 68L116 46H196L262 24"),
  actuator_saturation: () => law("error of the angle", "torque", "M50 80L262 12", "M50 62H104L208 30H262"),
  actuator_lag: () => over("time", "M40 66H90V20H270", "M40 66H90C104 34 140 22 270 20"),
  rate_limit: () => over("time", "M40 66H90V20H270", "M40 66H90L210 20H270"),
  command_delay: () => over("time", "M40 66H90V20H270", "M40 66H140V20H270"),
  torque_ripple: () => law("angle", "torque", "M40 46H272", "M40 46C52 20 64 20 76 46S100 72 112 46S136 20 148 46S172 72 184 46S208 20 220 46S244 72 256 46L272 46"),
  sensor_offset: () => law("angle", "reading", "M60 78L252 14", "M60 62L252 -2"),
  sensor_gain: () => law("angle", "reading", "M60 68L252 24", "M60 80L252 12"),
};

export function drawing(key: string, title: string): SVGElement {
  const parts = (DRAWINGS[key] ?? (() => chain(link(70, 230), text(150, 34, "?", "words bad"))))();
  return drawn("svg", { viewBox: "0 0 300 86", class: "drawing", role: "img", "aria-label": `Drawing: ${title}`, "data-effect": key }, ...parts);
}

export const isDrawn = (key: string) => Object.hasOwn(DRAWINGS, key);
