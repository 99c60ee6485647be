// STOP: works without anything else of this page. It waits for no framework, no socket and no answer.
//
// The button stands in the page as plain HTML. A press posts to the service's stop endpoint at once, with keepalive so
// that it leaves even when the page is being closed, to the application and to STOP's own listener; where both fail the
// browser's beacon takes their place.
(() => {
  "use strict";

  const button = document.getElementById("stop"), word = document.getElementById("stop-word");
  if (!button) return;
  const UNANSWERED_MS = 1000, urls = ["/api/stop"];
  if (button.dataset.port) urls.unshift(location.protocol + "//" + location.host.replace(/:\d+$/, "") + ":" + button.dataset.port + "/stop");

  function say(text, tone) {
    word.textContent = text;
    word.dataset.tone = tone;
  }

  /** One request; resolves with the answer. Both listeners are asked, whoever answers first has stopped. No header of ours:
      the browser would ask for leave before it posts to STOP's own port. */
  function post(url) {
    return fetch(url, { method: "POST", keepalive: true, cache: "no-store", credentials: "include" })
      .then((answer) => (answer.ok ? answer.json().catch(() => ({})) : Promise.reject(new Error(answer.status + " " + answer.statusText))));
  }

  let presses = 0;
  function stop() {
    const press = ++presses, began = performance.now();
    document.documentElement.dataset.stopping = "yes";
    say("Stop sent …", "sent");
    const late = setTimeout(() => { if (press === presses) say("No answer yet. Use the emergency stop.", "failed"); }, UNANSWERED_MS);
    const asked = urls.map(post);
    Promise.any(asked).then((answer) => {
      clearTimeout(late);
      if (press !== presses) return;
      const took = Math.round(performance.now() - began);
      say("Stopped · answered in " + took + " ms", "done");
      document.documentElement.dataset.stopping = "";
      window.dispatchEvent(new CustomEvent("schwung-stopped", { detail: { took, answer } }));
    }, (errors) => {
      clearTimeout(late);
      let sent = false;
      try { sent = urls.map((url) => navigator.sendBeacon(url)).some(Boolean); } catch { sent = false; }
      if (press !== presses) return;
      const why = (errors.errors && errors.errors[0] && errors.errors[0].message) || "the service does not answer";
      say("Not confirmed (" + why + (sent ? "; sent once more" : "") + "). Use the emergency stop.", "failed");
    });
  }

  button.addEventListener("pointerdown", (e) => { if (e.button === 0) stop(); }); // not "click": that waits for the finger to leave
  button.addEventListener("keydown", (e) => { if (e.key === "Enter" || e.key === " ") { e.preventDefault(); stop(); } });
  button.addEventListener("click", (e) => { if (e.detail === 0) stop(); }); // assistive technology clicks without a pointer
  window.addEventListener("keydown", (e) => {
    if (e.repeat || e.ctrlKey || e.altKey || e.metaKey) return;
    const writing = e.target instanceof Element && e.target.closest("input, textarea, select, [contenteditable]");
    if (e.key === "Escape" || ((e.key === "s" || e.key === "S") && !writing)) { e.preventDefault(); stop(); }
  }, true);
})();
