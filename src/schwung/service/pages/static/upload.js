// Files from this computer to the service: forms of the class sw-upload are sent to /api/imports, and the run that comes of
// it is shown. Works by keyboard, needs no framework. What goes wrong is said in the form, in one sentence.
(() => {
  "use strict";

  const KEPT_MS = 200;

  /** The answer of the API, or an error with its sentence. */
  async function asked(url, options) {
    let answer;
    try {
      answer = await fetch(url, { credentials: "same-origin", ...options });
    } catch {
      throw new Error("The service does not answer, or the file is too large. Is it running?");
    }
    const told = await answer.json().catch(() => ({}));
    if (!answer.ok) throw new Error(told.detail || answer.status + " " + answer.statusText);
    return told;
  }

  /** A file that others need, e.g. an EDS: kept, and its id. */
  async function kept(file, what) {
    const body = new FormData();
    body.append("what", what);
    body.append("file", file);
    let run = await asked("/api/imports", { method: "POST", body });
    while (run.state === "queued" || run.state === "running") {
      await new Promise((resolve) => setTimeout(resolve, KEPT_MS));
      run = await asked("/api/runs/" + run.id);
    }
    if (run.state !== "done") throw new Error((run.error && run.error.text) || "It could not be kept.");
    return run.result.file_id;
  }

  const value = (form, name) => (form.elements[name] ? form.elements[name].value.trim() : "");
  const file = (form, name) => (form.elements[name] && form.elements[name].files[0]) || null;

  async function send(form) {
    const what = value(form, "what"), body = new FormData(), options = {};
    if (what === "can_log") {
      if (file(form, "eds")) body.append("eds_file_id", await kept(file(form, "eds"), "eds"));
      else if (file(form, "dbc")) body.append("dbc_file_id", await kept(file(form, "dbc"), "dbc"));
      if (file(form, "eds") && value(form, "node")) options.node = Number(value(form, "node"));
      if (!file(form, "eds")) body.append("guess", "true");
    }
    if (what === "recording") body.append("guess", "true");
    body.append("what", what);
    body.append("options", JSON.stringify(options));
    for (const name of ["machine_id", "drive_id"]) if (value(form, name)) body.append(name, value(form, name));
    body.append("file", file(form, "file"));
    return asked("/api/imports", { method: "POST", body });
  }

  const formOf = (e) => (e.target instanceof Element ? e.target.closest("form.sw-upload") : null);

  document.addEventListener("change", (e) => {
    const form = formOf(e);
    if (form && e.target.name === "what") form.dataset.what = e.target.value;
  });
  document.addEventListener("submit", async (e) => {
    const form = formOf(e);
    if (!form) return;
    e.preventDefault();
    const button = form.querySelector("button"), said = form.querySelector(".said");
    if (button.getAttribute("aria-disabled") === "true") return;
    button.setAttribute("aria-disabled", "true");
    said.className = "said muted";
    said.textContent = "Sending …";
    try {
      location.href = "/run/" + (await send(form)).id;
    } catch (error) {
      said.className = "said sw-problem";
      said.textContent = error.message;
      button.removeAttribute("aria-disabled");
    }
  });
})();
