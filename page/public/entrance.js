// Somebody from another machine: the token behind the # of the address opens the page, once for this browser.
const given = /^#(?:token|look)=([\w-]+)$/.exec(location.hash);
if (given) {
  const response = await fetch("/api/enter", { method: "POST", headers: { "X-Twin-Token": given[1] } });
  if (response.ok) location.reload(); // page.js keeps the token to work
  else document.getElementById("said").textContent = "This token is not, or no longer, that of this workbench: it has a new one at every start.";
}
