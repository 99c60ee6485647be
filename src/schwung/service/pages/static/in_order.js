// What is entered before the page is connected arrives in the order in which it was entered.
//
// Until then NiceGUI lets every event ask for itself, every 10 ms, whether it may go (`delayed_emitter` in its nicegui.js): whoever
// asks first goes first, so that a press could overtake the number that it was about, and half a number the whole one. Here they
// wait in a row. Where NiceGUI calls these things otherwise, nothing is changed.
(() => {
  "use strict";
  const later = window.setTimeout.bind(window), waiting = [];
  let connected = window.did_handshake;
  window.setTimeout = (call, ...rest) => {
    if (connected !== false || typeof call !== "function" || call.name !== "delayed_emitter") return later(call, ...rest);
    waiting.push(call);
    return 0;
  };
  Object.defineProperty(window, "did_handshake", {
    configurable: true,
    get: () => connected,
    set: (now) => {
      connected = now;
      if (now) waiting.splice(0).forEach((call) => call());
    },
  });
})();
