"use strict";
// An embedded report follows the theme that the site's button chooses. From disk, frames cannot read each other.
(() => {
  const frames = document.querySelectorAll("iframe.report");
  const tell = (frame) => frame.contentWindow.postMessage({ theme: document.body.dataset.theme }, "*");
  for (const frame of frames) frame.addEventListener("load", () => tell(frame));
  new MutationObserver(() => frames.forEach(tell)).observe(document.body, { attributeFilter: ["data-theme"] });
  frames.forEach(tell);
})();
