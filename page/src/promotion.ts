// Putting a version to use and taking it back, each with a reason.
import { needsAuthorization, post, say, works } from "./api";
import { known } from "./data";
import { icon, made } from "./dom";
import { select, selection } from "./state";
import download from "lucide-static/icons/download.svg?raw";

const changed = () => dispatchEvent(new Event("versions-changed"));

// Asks for a reason in a dialog of the page; null where somebody thinks again.
export function reasonFor(title: string, words: string, needed: boolean): Promise<string | null> {
  const reason = made("input", { id: "reason", maxLength: 400, required: needed, autocomplete: "off" });
  const dialog = made("dialog", { "aria-label": title }, made("form", { method: "dialog" }, made("h2", {}, title), words ? made("p", {}, words) : null,
    made("label", { className: "field" }, made("span", {}, needed ? "Reason" : "Reason (optional)"), reason),
    made("p", { className: "controls" }, made("button", { value: "yes", className: "primary", id: "reason-yes" }, title), made("button", { type: "button", id: "reason-no" }, "Cancel"))));
  document.body.append(dialog);
  dialog.querySelector("#reason-no")!.addEventListener("click", () => dialog.close("no"));
  dialog.showModal();
  return new Promise((done) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      done(dialog.returnValue === "yes" && (!needed || reason.value.trim()) ? reason.value.trim() : null);
    });
  });
}

export function promoting(id: string, text = "Promote", primary = false): HTMLButtonElement {
  const button = needsAuthorization(made("button", { type: "button", className: primary ? "primary" : "", "data-promote": id }, text));
  return works(button, async () => {
    const worse = known.versions.find((one) => one.id === id)?.worse;
    const reason = await reasonFor("Promote", worse ? `It is worse than the version in use: ${worse}. Promote it all the same? Then say why.` : `Version ${id.slice(0, 12)} is then in use.`, Boolean(worse));
    if (reason === null) return;
    const before = known.aliases.current;
    const answer = await post("/api/versions/promote", { version: id, ...(reason ? { reason } : {}), ...(worse ? { force: true } : {}) });
    say(`Version ${answer.current.slice(0, 12)} (${answer.title}) is in use now; a running daemon takes it up within a second or two.`, "note");
    // what was shown as the version in use is shown as that, beside the one before
    if (selection.version === before) select({ version: answer.current, others: [before, ...selection.others].filter((one) => one !== answer.current).slice(0, 2) });
    changed();
  });
}

export function rollback(): HTMLButtonElement {
  const button = needsAuthorization(made("button", { type: "button", className: "rollback" }, "Roll back to the previous version"));
  return works(button, async () => {
    const reason = await reasonFor("Roll back", "The version that was in use before is then in use again.", false);
    if (reason === null) return;
    const answer = await post("/api/versions/rollback", { reason });
    say(`Version ${answer.current.slice(0, 12)} (${answer.title}) is in use again.`, "note");
    changed();
  });
}

export const exporting = (id: string) => made("a", { className: "button", href: `/api/versions/export?version=${encodeURIComponent(id)}`, download: "" }, icon(download), "MJCF");
