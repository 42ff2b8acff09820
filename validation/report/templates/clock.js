"use strict";
// What all parts of a page share: the moment that is looked at, and the stretch of time that is shown.
const clock = (() => {
  const followers = [];
  let moment = null, shown = null, asked = false;
  function tell() {
    asked = false;
    for (const follow of followers) follow(moment, shown);
  }
  function later() { // once a picture, however often it is moved
    if (!asked) { asked = true; requestAnimationFrame(tell); }
  }
  return {
    follow(call) { followers.push(call); later(); },
    get moment() { return moment; },
    set(time) { moment = time; later(); },
    show(range) { shown = range; later(); },
  };
})();

document.documentElement.classList.add("live");

function element(name, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "line", "rect", "circle", "text", "a", "clipPath"].includes(name);
  const made = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const number = (value, step) => {
  const digits = Math.max(0, Math.min(6, Math.ceil(-Math.log10(step))));
  return value.toFixed(digits).replace("-", "\u2212");
};
