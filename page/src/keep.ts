// Saving the last minutes of the live hand as a recording.
import { facts, needsAuthorization, post, say, works } from "./api";
import { made } from "./dom";

export function keepButton(look = "", id = ""): HTMLButtonElement {
  return works(needsAuthorization(made("button", { type: "button", className: look, id }, "Keep the last minutes")), async () => {
    const answer = await post("/api/keep", { hand: facts.namespace });
    say(answer.kept ? `Kept ${answer.seconds.toFixed(0)} s as ${answer.path} on the daemon's machine. If that is this one, it is in the list of sources.`
      : `Nothing was kept: ${answer.why}`, answer.kept ? "note" : "error");
    dispatchEvent(new Event("recordings-changed"));
  });
}
