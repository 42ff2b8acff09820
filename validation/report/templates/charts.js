"use strict";
// Draws the charts of every figure from the numbers beside its picture (chart_data.py), to hover, zoom, pan and switch.
(() => {
  const RIGHT = 10, TOP = 8, BOTTOM = 34;
  let clips = 0;

  function ticks(axis, low, high, room) {
    if (axis.ticks) return axis.ticks.filter(([at]) => at >= low && at <= high);
    if (axis.log) {
      const found = [];
      for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++)
        for (const one of high / low > 100 ? [1] : [1, 2, 5]) found.push(one * 10 ** power);
      return found.filter(at => at >= low * 0.999 && at <= high * 1.001).map(at => [at, String(+at.toPrecision(3))]);
    }
    const rough = (high - low) / Math.max(2, room), power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(one => one * power).find(one => one >= rough), found = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push([i * step, number(i * step, step)]);
    return found;
  }

  // Index of the last value of a rising column that is not above x.
  function before(column, x) {
    let low = 0, high = column.length - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (column[middle] <= x) low = middle; else high = middle - 1; }
    return low;
  }
  const rises = column => column.every((x, i) => x !== null && (i === 0 || x >= column[i - 1]));
  const unit = words => (/\[([^\]]*)\]\s*$/.exec(words) || ["", ""])[1];

  class Chart {
    constructor(data, columns) {
      this.data = data;
      this.home = { x: ordered(data.x.limits), y: ordered(data.y.limits) };
      this.view = { x: this.home.x.slice(), y: this.home.y.slice() };
      this.flipped = { x: data.x.limits[0] > data.x.limits[1], y: data.y.limits[0] > data.y.limits[1] };
      this.left = Math.max(46, ...(data.y.ticks || []).map(([, words]) => Math.min(130, 10 + 6 * words.length))); // room for words
      this.hidden = new Set();
      this.curves = data.series.filter(one => one.kind === "line" && one.width > 0 && rises(one.x) && one.x.length > 1);
      this.clip = `clip${clips++}`;
      this.svg = element("svg", { tabindex: 0, role: "img", "aria-label": data.title });
      this.back = element("button", { type: "button", class: "back", hidden: "" }, "Reset zoom");
      this.values = new Map();
      this.said = element("span", { class: "said" });
      this.legend = element("div", { class: "legend" }, ...this.switches(), this.said);
      const named = data.title.includes(data.y.label) ? data.title : [data.title, data.y.label].filter(Boolean).join(" · ");
      this.box = element("section", { class: "chart" }, element("header", {}, element("h4", {}, named), this.legend, this.back), this.svg);
      this.back.addEventListener("click", () => this.reset());
      this.listen();
      new ResizeObserver(() => this.draw()).observe(this.svg);
      if (data.time) clock.follow((moment, shown) => this.followed(moment, shown));
    }

    switches() {
      const names = [...new Set(this.data.series.filter(one => one.name).map(one => one.name))];
      return names.map(name => {
        const first = this.data.series.find(one => one.name === name), value = element("output");
        const button = element("button", { type: "button", "aria-pressed": "true", class: `key ${first.kind}` }, element("i"), name, value);
        const colour = first.kind === "areas" ? (first.shapes[0].fill || first.shapes[0].edge)[0] : [first.colour].flat()[0];
        button.style.setProperty("--key", colour);
        if (first.dashes) button.classList.add("dashed");
        this.values.set(name, value);
        button.addEventListener("click", () => {
          const off = !this.hidden.delete(name);
          if (off) this.hidden.add(name);
          button.setAttribute("aria-pressed", String(!off));
          this.draw();
        });
        return button;
      });
    }

    place(which, value) {
      const [low, high] = this.view[which], log = this.data[which].log;
      let share = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
      if (this.flipped[which]) share = 1 - share;
      return which === "x" ? this.left + share * this.wide : TOP + (1 - share) * this.high;
    }
    value(which, at) {
      let share = which === "x" ? (at - this.left) / this.wide : 1 - (at - TOP) / this.high;
      if (this.flipped[which]) share = 1 - share;
      const [low, high] = this.view[which];
      return this.data[which].log ? low * (high / low) ** share : low + share * (high - low);
    }

    draw() {
      const width = this.svg.clientWidth;
      if (!width) return;
      const height = Math.round(Math.max(170, Math.min(460, width * this.data.ratio + TOP + BOTTOM)));
      this.wide = width - this.left - RIGHT; this.high = height - TOP - BOTTOM;
      this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this.svg.style.height = `${height}px`;
      if (this.data.equal) this.even();
      const marks = element("g", { "clip-path": `url(#${this.clip})` });
      for (const one of this.data.series) if (!this.hidden.has(one.name)) this.mark(marks, one);
      this.cursor = element("line", { class: "cursor", y1: TOP, y2: TOP + this.high, visibility: "hidden" });
      this.dots = element("g");
      this.svg.replaceChildren(
        element("clipPath", { id: this.clip }, element("rect", { x: this.left, y: TOP - 1, width: this.wide, height: this.high + 2 })),
        element("g", { class: "axes" }, ...this.axes()), marks, this.cursor, this.dots);
      if (this.data.time) this.followed(clock.moment);
    }

    even() { // one metre is as long both ways: the wider of both spans gives way
      const span = which => this.view[which][1] - this.view[which][0];
      const scale = Math.max(span("x") / this.wide, span("y") / this.high);
      for (const [which, room] of [["x", this.wide], ["y", this.high]]) {
        const middle = (this.view[which][0] + this.view[which][1]) / 2;
        this.view[which] = [middle - scale * room / 2, middle + scale * room / 2];
      }
    }

    axes() {
      const { wide, high } = this, parts = [];
      for (const [at, words] of ticks(this.data.x, ...this.view.x, wide / 75)) {
        const x = this.place("x", at);
        parts.push(element("line", { x1: x, x2: x, y1: TOP, y2: TOP + high }), element("text", { x, y: TOP + high + 14, "text-anchor": "middle" }, words));
      }
      for (const [at, words] of ticks(this.data.y, ...this.view.y, high / 32)) {
        const y = this.place("y", at);
        parts.push(element("line", { x1: this.left, x2: this.left + wide, y1: y, y2: y }), element("text", { x: this.left - 5, y: y + 3.5, "text-anchor": "end" }, words.length > 20 ? words.slice(0, 19) + "…" : words));
      }
      parts.push(element("text", { x: this.left + wide / 2, y: TOP + high + 29, "text-anchor": "middle", class: "label" }, this.data.x.label));
      return parts;
    }

    mark(marks, one) {
      const x = at => this.place("x", at).toFixed(1), y = at => this.place("y", at).toFixed(1);
      const stroke = { stroke: one.colour, "stroke-width": one.width, "stroke-dasharray": one.dashes || null, "stroke-opacity": one.alpha ?? null, fill: "none" };
      if (one.kind === "upright") marks.append(element("line", { ...stroke, x1: x(one.at), x2: x(one.at), y1: TOP, y2: TOP + this.high }));
      else if (one.kind === "level") marks.append(element("line", { ...stroke, x1: this.left, x2: this.left + this.wide, y1: y(one.at), y2: y(one.at) }));
      else if (one.kind === "line") this.line(marks, one, x, y, stroke);
      else if (one.kind === "points") this.points(marks, one, x, y);
      else if (one.kind === "areas") for (const shape of one.shapes) {
        const ring = flat => { let d = ""; for (let i = 0; i < flat.length; i += 2) d += `${i ? "L" : "M"}${x(flat[i])} ${y(flat[i + 1])}`; return d + "Z"; };
        const [fill, thick] = shape.fill || ["none", 1], [edge, line] = shape.edge || ["none", 1];
        marks.append(element("path", { d: shape.rings.map(ring).join(""), fill, "fill-opacity": thick, stroke: edge, "stroke-opacity": line, "fill-rule": "evenodd" }));
      } else if (one.kind === "words") {
        const ends = +x(one.x) + 5.6 * one.text.length > this.left + this.wide; // or it would be cut
        const anchor = ends ? "end" : { left: "start", center: "middle", right: "end" }[one.align];
        marks.append(element("text", { x: ends ? this.left + this.wide - 3 : x(one.x), y: this.place("y", one.y) - one.lift + 4, "text-anchor": anchor }, one.text));
      }
    }

    line(marks, one, x, y, stroke) {
      let d = "", dots = "", broken = true;
      one.x.forEach((at, i) => {
        if (at === null || one.y[i] === null) { broken = true; return; }
        const px = x(at), py = y(one.y[i]);
        if (one.width > 0) d += broken ? `M${px} ${py}` : one.steps ? `H${px}V${py}` : `L${px} ${py}`;
        if (one.marks) dots += `M${px} ${py}h0`;
        broken = false;
      });
      if (d) marks.append(element("path", { ...stroke, d, "stroke-linejoin": "round" }));
      if (dots) marks.append(element("path", { ...stroke, d: dots, "stroke-dasharray": null, "stroke-width": 2 * one.marks, "stroke-linecap": "round" }));
    }

    points(marks, one, x, y) {
      const r = Math.max(one.size, 2.2);
      one.x.forEach((at, i) => {
        if (at === null || one.y[i] === null) return;
        const px = +x(at), py = +y(one.y[i]), colour = Array.isArray(one.colour) ? one.colour[i] : one.colour;
        const spot = one.crossed
          ? element("path", { d: `M${px - r} ${py - r}l${2 * r} ${2 * r}m0 ${-2 * r}l${-2 * r} ${2 * r}`, stroke: colour, "stroke-width": 1.8, fill: "none" })
          : element("circle", { cx: px, cy: py, r, fill: colour, "fill-opacity": one.alpha ?? 1 });
        marks.append(one.urls ? element("a", { href: one.urls[i] }, spot, element("circle", { cx: px, cy: py, r: 7, fill: "transparent" })) : spot);
      });
    }

    // Values at a moment, or where the pointer is: beside the names in the legend, and dots on the lines.
    read(at) {
      const dots = [];
      for (const output of this.values.values()) output.textContent = "";
      const inside = at !== null && at >= this.view.x[0] && at <= this.view.x[1];
      this.cursor.setAttribute("visibility", inside ? "visible" : "hidden");
      let said = "";
      if (inside) {
        const px = this.place("x", at), step = (this.view.y[1] - this.view.y[0]) / 1000;
        this.cursor.setAttribute("x1", px); this.cursor.setAttribute("x2", px);
        for (const one of this.curves) {
          if (this.hidden.has(one.name) || at < one.x[0] || at > one.x.at(-1) + 1e-9) continue;
          const i = before(one.x, at), j = Math.min(i + 1, one.x.length - 1);
          if (one.y[i] === null || one.y[j] === null) continue;
          const share = one.steps || one.x[j] === one.x[i] ? 0 : (at - one.x[i]) / (one.x[j] - one.x[i]);
          const value = one.y[i] + share * (one.y[j] - one.y[i]), words = number(value, step * 2);
          if (!one.name) { if (!this.curves.some(other => other.name)) said = said ? said : words; }
          else if (!this.values.get(one.name).textContent) this.values.get(one.name).textContent = words;
          if (!one.dashes) dots.push(element("circle", { cx: px, cy: this.place("y", value), r: 3.2, fill: one.colour }));
        }
      }
      this.said.textContent = said ? `${said} ${unit(this.data.title)}` : "";
      this.dots.replaceChildren(...dots);
    }

    followed(moment, shown) {
      if (shown !== undefined && String(shown) !== String(this.shown ?? null)) {
        this.shown = shown;
        this.view.x = shown ? shown.slice() : this.home.x.slice();
        this.zoomed();
        return;
      }
      if (this.cursor) this.read(moment);
    }

    zoomed() {
      this.back.hidden = ["x", "y"].every(which => String(this.view[which]) === String(this.home[which]));
      this.draw();
    }
    reset() {
      this.view = { x: this.home.x.slice(), y: this.home.y.slice() };
      if (this.data.time) clock.show(null);
      this.zoomed();
    }
    look(x, y) { // new limits; those of time are everybody's
      if (!(x[1] > x[0]) || (y && !(y[1] > y[0]))) return;
      if (y) this.view.y = y;
      if (this.data.time) { clock.show(x); if (y) this.zoomed(); } else { this.view.x = x; this.zoomed(); }
    }
    scaled(which, at, factor) { // limits about a value that stays where it is
      const [low, high] = this.view[which];
      if (this.data[which].log) return [at * (low / at) ** factor, at * (high / at) ** factor];
      return [at + (low - at) * factor, at + (high - at) * factor];
    }
    moved(which, from, to, limits) {
      const [low, high] = limits;
      if (this.data[which].log) { const by = from / to; return [low * by, high * by]; }
      return [low + from - to, high + from - to];
    }

    nearest(px, py) {
      let best = null, least = 18;
      for (const one of this.data.series) {
        if (this.hidden.has(one.name)) continue;
        const marked = one.kind === "points" || (one.kind === "line" && !this.curves.includes(one));
        if (marked) one.x.forEach((at, i) => {
          if (at === null || one.y[i] === null) return;
          const far = Math.hypot(this.place("x", at) - px, this.place("y", one.y[i]) - py);
          if (far < least) { least = far; best = { one, i, x: at, y: one.y[i] }; }
        });
      }
      return best;
    }

    point(px, py) { // what is under the pointer
      const at = this.value("x", px);
      if (this.data.time) return clock.set(Math.max(this.home.x[0], Math.min(this.home.x[1], at)));
      this.read(this.curves.length ? at : null);
      const found = this.nearest(px, py);
      const fine = which => (this.view[which][1] - this.view[which][0]) / 500;
      const said = [];
      const word = (axis, value, which) => axis.ticks ? (axis.ticks.find(([place]) => place === value) || ["", number(value, fine(which))])[1] : number(value, fine(which));
      if (found) {
        said.push(`${word(this.data.x, found.x, "x")} / ${word(this.data.y, found.y, "y")}`);
        if (found.one.urls) said.unshift(found.one.urls[found.i].replace("#row-", "row "));
        this.dots.replaceChildren(element("circle", { cx: this.place("x", found.x), cy: this.place("y", found.y), r: 6, class: "ring" }));
      } else said.push(`${number(at, fine("x"))} ${unit(this.data.x.label)}`, this.curves.length ? "" : number(this.value("y", py), fine("y")));
      this.said.textContent = [this.said.textContent, ...said].filter(Boolean).join(" · ");
    }

    listen() {
      const { svg } = this, fingers = new Map();
      let began = null, frame = null;
      const spot = event => { const box = svg.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
      svg.addEventListener("pointerdown", event => {
        if (event.button !== 0) return;
        fingers.set(event.pointerId, spot(event));
        if (event.pointerType === "touch") { if (fingers.size < 2) this.point(...spot(event)); return; }
        began = { at: spot(event), pan: event.shiftKey, view: { x: this.view.x.slice(), y: this.view.y.slice() } };
      });
      svg.addEventListener("pointermove", event => {
        const [px, py] = spot(event);
        if (fingers.size === 2 && fingers.has(event.pointerId)) return this.pinch(fingers, event.pointerId, [px, py]);
        if (!began) return this.cursor && this.point(px, py);
        if (Math.hypot(px - began.at[0], py - began.at[1]) < 5) return;
        if (!svg.hasPointerCapture(event.pointerId)) svg.setPointerCapture(event.pointerId);
        if (began.pan) {
          const by = which => [this.value(which, began.at[+(which === "y")]), this.value(which, [px, py][+(which === "y")])];
          return this.look(this.moved("x", ...by("x"), this.view.x), this.moved("y", ...by("y"), this.view.y)), began.at = [px, py];
        }
        if (!frame) svg.append(frame = element("rect", { class: "frame" }));
        const tall = Math.abs(py - began.at[1]) > 25, y = tall ? [began.at[1], py] : [TOP, TOP + this.high];
        const x = [began.at[0], px];
        for (const [key, value] of Object.entries({ x: Math.min(...x), y: Math.min(...y), width: Math.abs(x[1] - x[0]), height: Math.abs(y[1] - y[0]) })) frame.setAttribute(key, value);
        frame.chosen = { x: x.map(at => this.value("x", at)), y: tall ? y.map(at => this.value("y", at)) : null };
      });
      const end = event => {
        fingers.delete(event.pointerId);
        if (frame) {
          const { x, y } = frame.chosen;
          frame.remove();
          if (event.type === "pointerup") this.look(ordered(x), y && ordered(y));
        }
        began = frame = null;
      };
      svg.addEventListener("pointerup", end);
      svg.addEventListener("pointercancel", end);
      svg.addEventListener("pointerleave", () => { if (!this.data.time && !began && this.cursor) this.read(null); });
      svg.addEventListener("dblclick", () => this.reset());
      svg.addEventListener("wheel", event => {
        if (!event.ctrlKey && !event.metaKey) return; // the page scrolls
        event.preventDefault();
        const [px, py] = spot(event), factor = Math.exp(0.004 * event.deltaY);
        this.look(this.scaled("x", this.value("x", px), factor), event.shiftKey || this.data.equal ? this.scaled("y", this.value("y", py), factor) : null);
      }, { passive: false });
      svg.addEventListener("keydown", event => {
        const middle = (this.view.x[0] + this.view.x[1]) / 2, shift = 0.15 * (this.view.x[1] - this.view.x[0]);
        if (event.key === "+" || event.key === "=") this.look(this.scaled("x", middle, 0.7), null);
        else if (event.key === "-") this.look(this.scaled("x", middle, 1 / 0.7), null);
        else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
          const by = event.key === "ArrowLeft" ? -shift : shift;
          this.look([this.view.x[0] + by, this.view.x[1] + by], null);
        } else if (event.key === "Escape" || event.key === "0") this.reset();
        else return;
        event.preventDefault();
      });
    }

    pinch(fingers, id, now) {
      const [other] = [...fingers].filter(([key]) => key !== id).map(([, at]) => at), was = fingers.get(id);
      const factor = Math.max(Math.abs(was[0] - other[0]), 8) / Math.max(Math.abs(now[0] - other[0]), 8);
      fingers.set(id, now);
      this.look(this.scaled("x", this.value("x", (now[0] + other[0]) / 2), factor), null);
    }
  }

  function ordered(limits) { return limits[0] <= limits[1] ? limits.slice() : [limits[1], limits[0]]; }

  function shades({ label, steps, stops }) {
    const strip = element("i"), parts = stops.map(([, colour], i) => steps ? `${colour} ${100 * i / stops.length}% ${100 * (i + 1) / stops.length}%` : colour);
    strip.style.background = `linear-gradient(to right, ${parts.join(", ")})`;
    const words = steps ? stops.map(([low]) => element("span", {}, low)) : [stops[0], stops.at(-1)].map(([value]) => element("span", {}, value));
    return element("div", { class: "shades" }, label, element("div", {}, strip, element("div", {}, ...words)));
  }

  for (const figure of document.querySelectorAll("figure.plot")) {
    const source = figure.querySelector("script");
    if (!source) continue;
    const data = JSON.parse(source.textContent), place = figure.querySelector(".charts");
    if (data.title) place.before(element("h4", { class: "title" }, data.title));
    place.style.setProperty("--columns", data.columns);
    place.append(...data.charts.map(one => new Chart(one, data.columns).box));
    place.after(...data.shades.map(shades));
    figure.classList.add("drawn");
  }
})();
