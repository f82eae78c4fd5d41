// What all views share: elements, requests, and saying what went wrong. Names from data become text nodes, never markup.
const TOKEN = "twin-workbench-token";

// The token comes behind the # of the address, which no browser sends, and stays in this tab over a reload.
const given = /^#token=([\w-]+)$/.exec(location.hash);
if (given) {
  sessionStorage.setItem(TOKEN, given[1]);
  history.replaceState(null, "", location.pathname + location.search);
}

if (location.hash.startsWith("#look=")) history.replaceState(null, "", location.pathname + location.search);

export const facts = JSON.parse(document.getElementById("facts").textContent);
export const element = (id) => document.getElementById(id);
export const allowed = () => sessionStorage.getItem(TOKEN) !== null;

// made("td", { className: "n" }, "text", child, ...)
export function made(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties))
    if (name.includes("-") || name === "role" || name === "scope") node.setAttribute(name, value); else node[name] = value;
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export const row = (head, ...cells) => made("tr", {}, made("th", { scope: "row" }, head),
  ...cells.map((cell) => (cell instanceof Node ? made("td", {}, cell) : made("td", { className: "n" }, cell))));

let said = 0; // how often something was said

export function say(text, kind = "error") {
  said += 1;
  const box = element("said");
  box.classList.toggle("note", kind === "note");
  box.firstElementChild.textContent = text;
  box.hidden = false;
}
element("said").querySelector("button").addEventListener("click", () => { element("said").hidden = true; });

async function answered(path, options) {
  let response;
  try {
    response = await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error; // the page itself took the question back
    throw new Error("The workbench's server does not answer. Is 'twin workbench' still running? Try again.");
  }
  if (response.ok) return response;
  let why = `The server answered ${response.status}.`;
  try { why = (await response.json()).error ?? why; } catch { /* the number says it */ }
  throw new Error(why);
}

export const read = async (path, signal) => (await answered(path, { signal })).json();
export async function post(path, body = {}) {
  const headers = { "Content-Type": "application/json" };
  if (allowed()) headers["X-Twin-Token"] = sessionStorage.getItem(TOKEN);
  return (await answered(path, { method: "POST", headers, body: JSON.stringify(body) })).json();
}

// Does what was asked for and says what went wrong; an error of before is not one of what has gone well since.
export async function attempt(action) {
  const before = said;
  try {
    await action();
    if (said === before) element("said").hidden = true;
  } catch (error) { say(error.message); }
}

// A button that works until its answer is there, and says what went wrong.
export function works(button, action) {
  button.addEventListener("click", async () => {
    button.disabled = true;
    await attempt(action);
    button.disabled = false;
  });
}

export const needsAuthorization = (...buttons) => {
  for (const button of buttons) {
    if (!allowed()) { button.disabled = true; button.title = "Needs the address with the token"; }
  }
};

export const number = (value, digits = 3) => (value === null || value === undefined || !Number.isFinite(value)
  ? "unknown" : Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5 || value === 0 ? String(+value.toPrecision(digits)) : value.toExponential(digits - 1));
export const milli = (value, digits = 3) => (value === null || value === undefined ? "unknown" : number(1e3 * value, digits));
export const dark = matchMedia("(prefers-color-scheme: dark)");
