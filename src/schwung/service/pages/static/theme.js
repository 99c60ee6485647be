// Light or dark: what the reader chose here, otherwise what the system says. Runs before anything is painted.
(() => {
  "use strict";
  const system = matchMedia("(prefers-color-scheme: dark)");
  const kept = () => { try { return localStorage.getItem("schwung-theme"); } catch { return null; } };
  function apply() {
    const dark = kept() ? kept() === "dark" : system.matches;
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    if (document.body) document.body.classList.toggle("body--dark", dark);
    if (window.Quasar && window.Quasar.Dark) window.Quasar.Dark.set(dark);
    document.dispatchEvent(new CustomEvent("schwung-theme", { detail: dark ? "dark" : "light" }));
  }
  system.addEventListener("change", apply);
  document.addEventListener("DOMContentLoaded", apply);
  window.addEventListener("load", apply);
  apply();
  window.Schwung = Object.assign(window.Schwung || {}, {
    turnTheme() {
      const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
      try { localStorage.setItem("schwung-theme", next); } catch { /* a private window: for this page only */ }
      if (kept() !== next) { document.documentElement.dataset.theme = next; return; }
      apply();
    },
  });
})();
