"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const DASHES = ["", "7 4", "7 3 1.5 3", "2 2.5"];
  const LEFT = 58, RIGHT = 10, TOP = 8, BOTTOM = 40, HEIGHT = 230;

  const svg = (name, attributes, parent, text) => {
    const element = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    if (parent) parent.append(element);
    return element;
  };
  const html = (name, properties, parent) => {
    const element = Object.assign(document.createElement(name), properties);
    if (parent) parent.append(element);
    return element;
  };
  // The first agent is drawn in the palette's last colour; as many agents as there may be, all differ.
  const look = (k, colours = 7) => ({
    stroke: `var(--c${(k + colours - 1) % colours})`,
    "stroke-dasharray": DASHES[(k + Math.floor(k / 28)) % 4],
  });
  const written = (value) => {
    if (value === 0) return "0";
    const size = Math.abs(value);
    const text = size >= 1e5 || size < 1e-3 ? value.toExponential(2) : value.toPrecision(4);
    return text.includes(".") ? text.replace(/\.?0+(e|$)/, "$1") : text;
  };

  const steps = (low, high, count) => {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    return found;
  };
  const ticks = (low, high, log, count) => {
    if (!log) return steps(low, high, count);
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++)
      for (const factor of [1, 2, 5]) {
        const value = factor * 10 ** power;
        if (value >= low * 0.999 && value <= high * 1.001) found.push(value);
      }
    if (found.length < 3) return steps(low, high, count);
    const decades = found.filter((value) => Math.abs(Math.log10(value) % 1) < 1e-9);
    if (found.length > 2 * count && decades.length >= 2)
      return decades.filter((_, k) => k % Math.ceil(decades.length / count) === 0);
    return found;
  };
  const scale = (low, high, log, from, to) => {
    const f = log ? Math.log : (value) => value, a = f(low), b = f(high) - a || 1;
    const there = (value) => from + ((f(value) - a) / b) * (to - from);
    const inverse = (pixel) => {
      const value = a + ((pixel - from) / (to - from)) * b;
      return log ? Math.exp(value) : value;
    };
    return { there, inverse };
  };

  class Panel {
    constructor(data, labels, group, parent) {
      Object.assign(this, { data, labels, group });
      this.zoom = null;
      this.box = html("div", { className: "panel" }, parent);
      if (data.title) html("div", { className: "title", textContent: data.title }, this.box);
      this.reset = html("button", { type: "button", textContent: "whole range", hidden: true }, this.box);
      this.reset.onclick = () => group.zoomTo(this, null);
      this.readout = html("output", {}, this.box);
      const told = `${data.y_label} over ${data.x_label}`;
      this.chart = svg("svg", { class: "chart", height: HEIGHT, tabindex: 0, role: "img", "aria-label": told }, this.box);
      this.listen();
      new ResizeObserver(() => this.draw()).observe(this.box);
    }
    get shown() {
      return this.data.curves.map((_, k) => k).filter((k) => this.group.visible[k] && this.data.curves[k].length);
    }
    draw() {
      const { data, chart } = this, width = this.box.clientWidth;
      if (!width) return;
      const [first, last] = this.zoom || [data.x[0], data.x[data.x.length - 1]];
      const inside = data.x.map((x, i) => i).filter((i) => data.x[i] >= first && data.x[i] <= last);
      const values = this.shown.flatMap((k) => inside.map((i) => data.curves[k][i]));
      const finite = values.filter((value) => value !== null && (!data.y_log || value > 0));
      let low = Math.min(...finite), high = Math.max(...finite);
      if (!finite.length) [low, high] = [data.y_log ? 0.1 : 0, 1];
      const room = data.y_log ? (high / low) ** 0.04 || 1.1 : 0.05 * (high - low) || Math.abs(high) || 1;
      [low, high] = data.y_log ? [low / Math.max(room, 1.02), high * Math.max(room, 1.02)] : [low - room, high + room];
      this.x = scale(first, last, data.x_log, LEFT, width - RIGHT);
      this.y = scale(low, high, data.y_log, HEIGHT - BOTTOM, TOP);
      chart.replaceChildren();
      chart.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
      const bottom = HEIGHT - BOTTOM;
      for (const value of ticks(first, last, data.x_log, Math.max(3, Math.min(8, width / 90)))) {
        const x = this.x.there(value);
        svg("line", { class: "grid", x1: x, x2: x, y1: TOP, y2: bottom }, chart);
        svg("text", { x, y: bottom + 16, "text-anchor": "middle" }, chart, written(value));
      }
      for (const value of ticks(low, high, data.y_log, 5)) {
        const y = this.y.there(value);
        svg("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y, y2: y }, chart);
        svg("text", { x: LEFT - 6, y: y + 4, "text-anchor": "end" }, chart, written(value));
      }
      svg("text", { x: (LEFT + width - RIGHT) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, chart, data.x_label);
      const middle = (TOP + bottom) / 2;
      svg("text", { x: 12, y: middle, "text-anchor": "middle", transform: `rotate(-90 12 ${middle})` }, chart, data.y_label);
      const clip = `clip${Panel.count++}`;
      svg("rect", { x: LEFT, y: 0, width: width - LEFT - RIGHT, height: bottom }, svg("clipPath", { id: clip }, chart));
      const plot = svg("g", { "clip-path": `url(#${clip})` }, chart);
      // The first of the labels, an agent, is drawn last, on top of the others.
      for (const k of [...this.shown].reverse())
        svg("path", { class: "curve", "data-series": k, d: this.path(data.curves[k]), ...look(k) }, plot);
      this.hair = svg("line", { class: "hair", y1: TOP, y2: bottom, visibility: "hidden" }, chart);
      this.cursor = svg("line", { class: "hair", y1: TOP, y2: bottom, visibility: "hidden" }, chart);
      this.chosen = svg("rect", { class: "chosen", y: TOP, height: bottom - TOP, width: 0 }, chart);
      if (this.time !== undefined) this.mark(this.time);
      this.reset.hidden = !this.zoom;
    }
    path(curve) {
      const { data } = this, out = [];
      let drawing = false;
      curve.forEach((value, i) => {
        if (value === null || (data.y_log && value <= 0)) { drawing = false; return; }
        const x = this.x.there(data.x[i]).toFixed(1), y = this.y.there(value).toFixed(1);
        if (drawing && data.held) out.push(`V${y}H${x}`);
        else out.push(`${drawing ? "L" : "M"}${x} ${y}`);
        drawing = true;
      });
      return out.join("");
    }
    nearest(pixel) {
      let best = 0;
      this.data.x.forEach((x, i) => {
        if (Math.abs(this.x.there(x) - pixel) < Math.abs(this.x.there(this.data.x[best]) - pixel)) best = i;
      });
      return best;
    }
    read(i) {
      const { data } = this, x = this.x.there(data.x[i]);
      this.at = i;
      this.hair.setAttribute("x1", x);
      this.hair.setAttribute("x2", x);
      this.hair.setAttribute("visibility", "visible");
      this.readout.replaceChildren(html("b", { textContent: `${data.x_label}: ${written(data.x[i])}` }));
      for (const k of this.shown) {
        const value = data.curves[k][i];
        html("div", { textContent: `${this.labels[k]}: ${value === null ? "ended" : written(value)}` }, this.readout);
      }
      const right = x < this.box.clientWidth / 2;
      this.readout.style.left = right ? `${x + 10}px` : "auto";
      this.readout.style.right = right ? "auto" : `${this.box.clientWidth - x + 10}px`;
    }
    leave() {
      this.hair.setAttribute("visibility", "hidden");
      this.readout.replaceChildren();
    }
    mark(time) {
      this.time = time;
      if (!this.x) return;
      this.cursor.setAttribute("visibility", "visible");
      for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, this.x.there(time));
    }
    listen() {
      const { chart } = this;
      let from = null;
      const at = (event) => event.clientX - chart.getBoundingClientRect().left;
      chart.addEventListener("pointerdown", (event) => {
        from = at(event);
        chart.setPointerCapture(event.pointerId);
      });
      chart.addEventListener("pointermove", (event) => {
        this.read(this.nearest(at(event)));
        if (from === null) return;
        this.chosen.setAttribute("x", Math.min(from, at(event)));
        this.chosen.setAttribute("width", Math.abs(at(event) - from));
      });
      chart.addEventListener("pointerup", (event) => {
        const ends = [from, at(event)].sort((a, b) => a - b).map((pixel) => this.nearest(pixel));
        from = null;
        this.chosen.setAttribute("width", 0);
        if (ends[1] - ends[0] > 1) this.group.zoomTo(this, ends.map((i) => this.data.x[i]));
      });
      chart.addEventListener("pointercancel", () => { from = null; this.chosen.setAttribute("width", 0); });
      chart.addEventListener("pointerleave", () => this.leave());
      chart.addEventListener("blur", () => this.leave());
      chart.addEventListener("dblclick", () => this.group.zoomTo(this, null));
      chart.addEventListener("keydown", (event) => {
        const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (!by) return;
        event.preventDefault();
        this.read(Math.min(Math.max((this.at ?? -1) + by, 0), this.data.x.length - 1));
      });
    }
  }
  Panel.count = 0;

  class Group {
    constructor(data, labels, figure) {
      this.data = data;
      this.visible = labels.map(() => true);
      const legend = html("div", { className: "legend" }, figure);
      labels.forEach((label, k) => {
        const button = html("button", { type: "button" }, legend);
        button.setAttribute("aria-pressed", "true");
        const sample = svg("svg", { width: 28, height: 10, "aria-hidden": "true" }, button);
        svg("line", { class: "curve", x1: 0, x2: 28, y1: 5, y2: 5, ...look(k) }, sample);
        html("span", { textContent: label }, button);
        button.onclick = () => {
          this.visible[k] = !this.visible[k];
          button.setAttribute("aria-pressed", String(this.visible[k]));
          for (const panel of this.panels) panel.draw();
        };
      });
      const box = html("div", { className: data.linked ? "panels linked" : "panels" }, figure);
      this.panels = data.panels.map((panel) => new Panel(panel, labels, this, box));
    }
    zoomTo(panel, range) {
      for (const one of this.data.linked ? this.panels : [panel]) {
        one.zoom = range;
        one.draw();
      }
    }
  }

  // Two carriages in the same episode: what the response's panels show over time.
  class Animation {
    constructor(task, response, figure) {
      Object.assign(this, { task, response });
      this.time = task.groups[0].panels[0].x;
      const [x1, stroke] = task.groups[0].panels.map((panel) => panel.curves);
      const most = (curves) => Math.max(1e-9, ...curves.flat().map((value) => Math.abs(value ?? 0)));
      Object.assign(this, { x1, stroke, far: most(x1), wide: most(stroke) });
      const controls = html("div", { className: "controls" }, figure);
      this.button = html("button", { type: "button", textContent: "Play" }, controls);
      this.slider = html("input", { type: "range", min: 0, max: this.time.length - 1, value: 0 }, controls);
      this.slider.setAttribute("aria-label", "time in the episode");
      this.clock = html("span", {}, controls);
      this.speed = html("select", { ariaLabel: "speed" }, controls);
      for (const [text, value] of [["1/10 speed", 0.1], ["1/4 speed", 0.25], ["real time", 1]])
        html("option", { textContent: text, value }, this.speed);
      this.speed.value = "0.25";
      const rows = Math.min(2, task.labels.length);
      this.choices = Array.from({ length: rows }, (_, row) => {
        const select = html("select", { ariaLabel: `controller ${row + 1}` }, controls);
        task.labels.forEach((label, k) => html("option", { textContent: label, value: k }, select));
        select.value = row ? Math.min(Math.max(task.agents, 1), task.labels.length - 1) : 0;
        select.onchange = () => this.draw();
        return select;
      });
      this.box = svg("svg", { role: "img", "aria-label": "motion of two carriages in the same episode" }, figure);
      this.note = html("p", { className: "note" }, figure);
      this.button.onclick = () => this.play(!this.playing);
      this.slider.oninput = () => { this.play(false); this.draw(); };
      new ResizeObserver(() => this.draw()).observe(figure);
    }
    play(on) {
      this.playing = on;
      this.button.textContent = on ? "Pause" : "Play";
      if (!on) return;
      const end = this.time[this.time.length - 1], step = this.time[1] - this.time[0];
      let now = this.time[this.slider.value], before = null;
      if (now >= end) now = 0;
      const frame = (stamp) => {
        if (!this.playing) return;
        if (before !== null) now += ((stamp - before) / 1e3) * this.speed.value;
        before = stamp;
        this.slider.value = Math.min(Math.round(now / step), this.time.length - 1);
        this.draw();
        if (now >= end) this.play(false);
        else requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    }
    draw() {
      const width = this.box.clientWidth;
      if (!width) return;
      const i = Number(this.slider.value), row = 92, radius = 11, rows = this.choices.length;
      this.box.setAttribute("viewBox", `0 0 ${width} ${row * rows}`);
      this.box.setAttribute("height", row * rows);
      this.box.replaceChildren();
      // One scale for all lengths: mm to pixels.
      const perMm = (width - 60 - 2 * radius) / (2 * this.far + 2 * this.wide) / 1.15;
      const half = this.wide * perMm + radius + 8, rest = 44 + this.far * perMm + half;
      this.choices.forEach((choice, number) => this.carriage(Number(choice.value), number * row, { i, perMm, half, rest, radius, width }));
      this.clock.textContent = `t = ${this.time[i].toFixed(2)} s`;
      this.note.textContent = `Lengths are drawn to one scale: 10 mm are ${(10 * perMm).toFixed(0)} pixels. The dashed line is the carriage's equilibrium.`;
      for (const panel of this.response.panels) panel.mark(this.time[i]);
    }
    carriage(k, top, { i, perMm, half, rest, radius, width }) {
      const box = this.box, floor = top + 78, roof = floor - 30;
      const x1 = this.x1[k][i], stroke = this.stroke[k][i], ended = x1 === null;
      svg("line", { class: "wall", x1: 6, x2: 6, y1: top + 24, y2: floor }, box);
      svg("line", { class: "wall", x1: 6, x2: width - 6, y1: floor, y2: floor }, box);
      svg("line", { class: "rest", x1: rest, x2: rest, y1: top + 20, y2: floor }, box);
      svg("text", { x: 12, y: top + 16 }, box, this.task.labels[k] + (ended ? " (ended)" : ""));
      if (ended) return;
      const middle = rest + x1 * perMm, left = middle - half, ball = middle + stroke * perMm;
      svg("path", { class: "spring", d: zigzag(6, left, roof + 15, 8) }, box);
      svg("rect", { class: "body", x: left, y: roof, width: 2 * half, height: 26, rx: 3 }, box);
      if (this.task.springs)
        for (const [a, b] of [[left, ball - radius], [ball + radius, middle + half]])
          svg("path", { class: "spring", d: zigzag(a, b, roof - radius, 5) }, box);
      svg("circle", { cx: ball, cy: roof - radius, r: radius, fill: look(k).stroke }, box);
      svg("line", { class: "wall", x1: middle, x2: middle, y1: roof, y2: roof + 8 }, box);
    }
  }
  const zigzag = (from, to, y, height) => {
    const points = [`M${from} ${y}`];
    for (let k = 1; k < 12; k++) points.push(`L${from + ((to - from) * k) / 12} ${y + (k % 2 ? height : -height) * 0.8}`);
    return `${points.join("")}L${to} ${y}`;
  };

  const theme = document.getElementById("theme");
  theme.onclick = () => {
    const root = document.documentElement, dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const now = root.dataset.theme || (dark ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
  };

  const tasks = JSON.parse(document.getElementById("data").textContent);
  document.querySelectorAll("section.task").forEach((section) => {
    const task = tasks[section.dataset.task];
    const groups = [...section.querySelectorAll("figure.group")].map(
      (figure) => new Group(task.groups[figure.dataset.group], task.labels, figure));
    new Animation(task, groups[0], section.querySelector("figure.animation"));
  });
})();
