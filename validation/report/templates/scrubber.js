"use strict";
(() => {
  const run = JSON.parse(document.getElementById("run").textContent);
  const scene = document.getElementById("scene"), slider = document.getElementById("time");
  const words = document.getElementById("words"), play = document.getElementById("play");
  const path = (name, points) => scene.querySelector("." + name).setAttribute("d", points.length ? "M" + points.join(" ") : "");
  const pairs = flat => Array.from({ length: flat.length / 2 }, (_, i) => flat.slice(2 * i, 2 * i + 2)); // x, y
  const { left, middle, right } = run.road;
  path("surface", left.concat(pairs(right).reverse().flat()));
  for (const [name, line] of [["left", left], ["middle", middle], ["right", right], ["driven", run.driven]]) path(name, line);
  path("car", run.car.concat(run.car.slice(0, 2)));

  function show(index) {
    const frame = run.frames[index], [x, y, yaw] = frame.pose;
    for (const name of ["corridor", "planned", "predicted"]) path(name, frame[name]);
    scene.querySelector(".boxes").setAttribute("d", frame.boxes.map(box => "M" + box.join(" ") + "Z").join(""));
    scene.querySelector(".car").setAttribute("transform", `translate(${x} ${y}) rotate(${yaw * 180 / Math.PI})`);
    const wide = scene.clientWidth > 600, width = wide ? 72 : 44, height = wide ? 20 : 24; // in metres
    const ahead = 0.25 * width, centre = [x + ahead * Math.cos(yaw), y + ahead * Math.sin(yaw)];
    scene.setAttribute("viewBox", `${centre[0] - width / 2} ${-centre[1] - height / 2} ${width} ${height}`);
    words.replaceChildren(...frame.words.map(text => Object.assign(document.createElement("span"), { textContent: text })));
    slider.setAttribute("aria-valuetext", frame.words[0]);
  }

  let since = null; // when frame 0 would have been shown, while it plays
  function stop() { since = null; play.textContent = "Play"; }
  function tick(now) {
    if (since === null) return;
    const index = run.frames.findIndex(frame => frame.t >= (now - since) / 1000);
    slider.value = index < 0 ? run.frames.length - 1 : index;
    show(+slider.value);
    if (index < 0) stop(); else requestAnimationFrame(tick);
  }
  play.addEventListener("click", () => {
    if (since !== null) return stop();
    if (+slider.value === run.frames.length - 1) slider.value = 0;
    since = performance.now() - 1000 * run.frames[+slider.value].t;
    play.textContent = "Pause";
    requestAnimationFrame(tick);
  });
  slider.addEventListener("input", () => { stop(); show(+slider.value); });
  addEventListener("resize", () => show(+slider.value));
  slider.max = run.frames.length - 1;
  slider.value = run.start;
  show(run.start);
})();
