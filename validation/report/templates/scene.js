"use strict";
// The scenes from above, and the bar that plays them: follow the car or see the whole road, drag to pan, zoom.
(() => {
  const pairs = flat => Array.from({ length: flat.length / 2 }, (_, i) => flat.slice(2 * i, 2 * i + 2)); // x, y
  const drawn = points => points.length ? "M" + points.join(" ") : "";
  const minus = words => words.replace("-", "\u2212");
  const signed = (value, digits) => minus((value >= 0 ? "+" : "") + value.toFixed(digits));
  const turned = ([x, y], angle) => [x * Math.cos(angle) + y * Math.sin(angle), y * Math.cos(angle) - x * Math.sin(angle)];
  const layers = ["surface", "corridor", "left", "middle", "right", "planned", "boxes"];

  class Scene {
    constructor(figure) {
      const run = this.run = JSON.parse(figure.querySelector("script").textContent);
      this.svg = element("svg", { class: "view", role: "img", "aria-label": "The road from above, with cars, corridor and prediction" });
      this.paths = Object.fromEntries([...layers, "predicted"].map(name => [name, element("path", { class: name })]));
      this.cars = run.cars.map(car => {
        const own = { driven: element("path", { class: "driven", d: drawn(car.driven) }), body: element("path", { class: "car", d: drawn(car.outline.concat(car.outline.slice(0, 2))) + "Z" }) };
        for (const part of Object.values(own)) part.style.setProperty("--car", car.colour);
        return own;
      });
      this.group = element("g", {}, ...layers.map(name => this.paths[name]), ...this.cars.map(car => car.driven), ...this.cars.map(car => car.body), this.paths.predicted);
      this.bar = element("g", { class: "scale" }, element("path"), element("text", { "text-anchor": "middle" }));
      this.svg.append(this.group, this.bar);
      this.prepare();
      this.words = element(run.cars.length > 1 ? "div" : "p", { class: "words" });
      this.tools = this.buttons();
      const place = element("div", { class: "stage" }, this.svg, this.tools);
      figure.querySelector(".keys").before(place, this.words);
      figure.classList.toggle("many", run.cars.length > 1);
      this.listen();
      clock.follow(moment => this.show(moment ?? run.start));
      new ResizeObserver(() => this.show(this.moment)).observe(this.svg);
    }

    prepare() {
      const { left, middle, right } = this.run.road, edge = pairs(left).concat(pairs(right));
      this.paths.surface.setAttribute("d", drawn(left.concat(pairs(right).reverse().flat())) + "Z");
      for (const name of ["left", "middle", "right"]) this.paths[name].setAttribute("d", drawn(this.run.road[name]));
      // The road's longer side lies along the page's.
      const mean = [0, 1].map(k => edge.reduce((sum, one) => sum + one[k], 0) / edge.length);
      let xx = 0, xy = 0, yy = 0;
      for (const [x, y] of edge) { xx += (x - mean[0]) ** 2; xy += (x - mean[0]) * (y - mean[1]); yy += (y - mean[1]) ** 2; }
      this.angle = 0.5 * Math.atan2(2 * xy, xx - yy);
      const points = pairs(middle), ends = [points[0], points.at(-1)].map(one => turned(one, this.angle)[0]);
      if (ends[1] < ends[0]) this.angle += Math.PI; // and one drives to the right
      const seen = edge.map(one => turned(one, this.angle));
      const [xs, ys] = [0, 1].map(k => seen.map(one => one[k]));
      const least = values => values.reduce((a, b) => Math.min(a, b)), most = values => values.reduce((a, b) => Math.max(a, b));
      this.whole = { x: [least(xs) - 3, most(xs) + 3], y: [least(ys) - 3, most(ys) + 3] };
      this.line = points.map(one => turned(one, this.angle));
      this.way = [0];
      this.line.forEach(([x, y], i) => { if (i) this.way.push(this.way[i - 1] + Math.hypot(x - this.line[i - 1][0], y - this.line[i - 1][1])); });
      this.group.setAttribute("transform", `scale(1 -1) rotate(${-this.angle * 180 / Math.PI})`);
      this.near = null; // what is looked at: centre and metres across, null follows the car
      this.span = null;
    }

    buttons() {
      const button = (words, title, call) => { const made = element("button", { type: "button", title }, words); made.addEventListener("click", call); return made; };
      this.follow = button("Follow", "Stay with the car", () => { this.near = this.span = null; this.show(this.moment); });
      this.all = button("Whole road", "See all of it", () => { const { x, y } = this.whole; this.near = [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2]; this.span = Infinity; this.show(this.moment); });
      return element("div", { class: "tools" }, this.follow, this.all, button("+", "Zoom in", () => this.zoom(0.7)), button("\u2212", "Zoom out", () => this.zoom(1 / 0.7)));
    }

    size() {
      const width = this.svg.clientWidth, { x, y } = this.whole;
      const shape = (y[1] - y[0]) / (x[1] - x[0]);
      const height = Math.round(Math.max(width > 600 ? 250 : 210, Math.min(width > 600 ? 480 : 380, width * shape)));
      this.svg.style.height = `${height}px`;
      const fits = Math.max(x[1] - x[0], (y[1] - y[0]) * width / height);
      return { width, height, fits, across: Math.min(this.span ?? (width > 600 ? 72 : 40), fits) };
    }

    at(moment) { // frame that holds, and the share of the way to the next one
      const { times } = this.run;
      let low = 0, high = times.length - 1;
      while (low < high) { const middle = (low + high + 1) >> 1; if (times[middle] <= moment + 1e-9) low = middle; else high = middle - 1; }
      const next = Math.min(low + 1, times.length - 1), gap = times[next] - times[low];
      return { k: low, next, share: gap > 0 ? Math.min(1, (moment - times[low]) / gap) : 0 };
    }

    show(moment) {
      if (!this.svg.clientWidth) return;
      this.moment = moment;
      const { run } = this, { k, next, share } = this.at(moment), mid = column => column[k] + share * (column[next] - column[k]);
      if (run.plans.length && this.frame !== k)
        for (const name of ["corridor", "planned", "predicted"]) this.paths[name].setAttribute("d", drawn(run.plans[k][name]));
      this.frame = k;
      const box = every => every.length === 1 ? every[0] : every[k].map((value, i) => value + share * (every[next][i] - value));
      this.paths.boxes.setAttribute("d", run.obstacles.map(every => drawn(box(every)) + "Z").join(""));
      run.cars.forEach((car, i) => this.cars[i].body.setAttribute("transform", `translate(${mid(car.x)} ${mid(car.y)}) rotate(${mid(car.yaw) * 180 / Math.PI})`));
      const [lead] = run.cars, { width, height, fits, across } = this.size();
      const tall = across * height / width, centre = this.near ?? this.ahead(turned([mid(lead.x), mid(lead.y)], this.angle), across, tall);
      this.looked = { centre, across, tall, width };
      this.svg.setAttribute("viewBox", `${centre[0] - across / 2} ${-centre[1] - tall / 2} ${across} ${tall}`);
      this.follow.setAttribute("aria-pressed", String(!this.near));
      this.all.setAttribute("aria-pressed", String(!!this.near && across >= fits));
      this.ruler(centre, across, tall, width);
      this.speak(moment, k, mid);
    }

    ahead([x, y], across, tall) { // a point of the road before the car; the car stays well within the frame
      const { line, way } = this, far = ([px, py]) => (px - x) ** 2 + (py - y) ** 2;
      let near = 0;
      line.forEach((one, i) => { if (far(one) < far(line[near])) near = i; });
      let to = near;
      while (to < line.length - 1 && way[to] < way[near] + 0.27 * across) to++;
      const bounded = (value, most) => Math.max(-most, Math.min(most, value)), past = 0.27 * across - (way[to] - way[near]);
      const road = line[near], goal = line[to];
      return [x + bounded(goal[0] - road[0] + Math.max(0, past), 0.27 * across), road[1] + bounded(goal[1] - road[1], 0.2 * tall)];
    }

    ruler(centre, across, tall, width) {
      const metre = across / width, length = [1, 2, 5, 10, 20, 50, 100, 200].find(one => one / metre > 50) || 500;
      const x = centre[0] + across / 2 - 12 * metre, y = -centre[1] + tall / 2 - 12 * metre;
      this.bar.firstChild.setAttribute("d", `M${x - length} ${y - 4 * metre}v${4 * metre}h${length}v${-4 * metre}`);
      const text = this.bar.lastChild;
      text.textContent = `${length} m`;
      text.setAttribute("font-size", 12 * metre);
      text.setAttribute("x", x - length / 2); text.setAttribute("y", y - 7 * metre);
    }

    speak(moment, k, mid) {
      const rows = this.run.cars.map(car => {
        const gap = car.gap ? `clearance ${minus(mid(car.gap).toFixed(2))} m` : "no obstacle";
        return [`${mid(car.speed).toFixed(1)} m/s`, `steering ${signed(mid(car.steering), 2)}°`, `a_y ${signed(mid(car.lateral), 2)} m/s²`, gap, car.status[k]];
      });
      const span = (text, colour = null) => { const made = element("span", {}, text); if (colour) { made.className = "name"; made.style.setProperty("--car", colour); } return made; };
      if (rows.length === 1) return this.words.replaceChildren(span(`${moment.toFixed(2)} s`), ...rows[0].map(words => span(words)));
      this.words.replaceChildren(...rows.map((row, i) => element("p", { class: "words" }, span(this.run.cars[i].name, this.run.cars[i].colour), ...row.map(words => span(words)))));
    }

    zoom(factor, at = null) {
      const { centre, across, tall } = this.looked, { fits } = this.size();
      const to = Math.max(6, Math.min(fits, across * factor)), by = to / across;
      if (this.near || at) {
        const [px, py] = at ?? centre;
        this.near = [px + (centre[0] - px) * by, py + (centre[1] - py) * by];
      }
      this.span = to;
      this.show(this.moment);
    }

    listen() {
      const { svg } = this, fingers = new Map();
      const spot = event => {
        const box = svg.getBoundingClientRect(), { centre, across, tall, width } = this.looked, metre = across / width;
        return [centre[0] - across / 2 + (event.clientX - box.left) * metre, centre[1] + tall / 2 - (event.clientY - box.top) * metre];
      };
      svg.addEventListener("pointerdown", event => { fingers.set(event.pointerId, [event.clientX, event.clientY]); if (event.pointerType !== "touch") svg.setPointerCapture(event.pointerId); });
      svg.addEventListener("pointermove", event => {
        const was = fingers.get(event.pointerId);
        if (!was) return;
        const now = [event.clientX, event.clientY], metre = this.looked.across / this.looked.width;
        const other = [...fingers].find(([id]) => id !== event.pointerId);
        fingers.set(event.pointerId, now);
        if (other) return this.zoom(Math.hypot(was[0] - other[1][0], was[1] - other[1][1]) / Math.max(8, Math.hypot(now[0] - other[1][0], now[1] - other[1][1])));
        if (Math.hypot(now[0] - was[0], now[1] - was[1]) < 0.5) return;
        const { centre } = this.looked;
        this.near = [centre[0] - (now[0] - was[0]) * metre, centre[1] + (now[1] - was[1]) * metre];
        this.span = this.looked.across;
        this.show(this.moment);
      });
      for (const kind of ["pointerup", "pointercancel"]) svg.addEventListener(kind, event => fingers.delete(event.pointerId));
      svg.addEventListener("dblclick", () => this.follow.click());
      svg.addEventListener("wheel", event => {
        if (!event.ctrlKey && !event.metaKey) return; // the page scrolls
        event.preventDefault();
        this.zoom(Math.exp(0.004 * event.deltaY), this.near ? spot(event) : null);
      }, { passive: false });
    }
  }

  const scenes = [...document.querySelectorAll("figure.scene")].map(figure => new Scene(figure));
  if (!scenes.length) return;

  // The bar: one for the page.
  const first = Math.min(...scenes.map(one => one.run.times[0])), last = Math.max(...scenes.map(one => one.run.times.at(-1)));
  const play = element("button", { id: "play", type: "button" }, "Play");
  const slider = element("input", { id: "time", type: "range", min: first, max: last, step: 0.01, "aria-label": "Time" });
  const now = element("output", { id: "now" });
  const pace = element("select", { id: "pace", "aria-label": "Pace" }, ...[["1", "1×"], ["0.25", "¼×"], ["2", "2×"]].map(([value, words]) => element("option", { value }, words)));
  document.body.append(element("div", { class: "controls" }, play, slider, now, pace));

  let since = null; // when the clock was 0 while it plays
  function stop() { since = null; play.textContent = "Play"; }
  function begin() { since = performance.now() - 1000 * (clock.moment - first) / pace.value; play.textContent = "Pause"; requestAnimationFrame(tick); }
  function tick(time) {
    if (since === null) return;
    const moment = first + Math.max(0, time - since) / 1000 * pace.value;
    clock.set(Math.min(moment, last));
    if (moment >= last) stop(); else requestAnimationFrame(tick);
  }
  play.addEventListener("click", () => {
    if (since !== null) return stop();
    if (clock.moment >= last - 0.005) clock.set(first);
    begin();
  });
  pace.addEventListener("change", () => { if (since !== null) begin(); });
  slider.addEventListener("input", () => { stop(); clock.set(+slider.value); });
  addEventListener("keydown", event => {
    if (event.key !== " " || /BUTTON|INPUT|SELECT|A/.test(event.target.tagName)) return;
    event.preventDefault();
    play.click();
  });
  clock.follow(moment => {
    if (moment === null) return;
    slider.value = moment;
    now.textContent = `${moment.toFixed(2)} s`;
    slider.setAttribute("aria-valuetext", now.textContent);
  });
  clock.set(scenes[0].run.start);
})();
