(function () {
"use strict";
// Zoom, pan, reading and switching of the charts. The page is complete without it: every chart is
// drawn already; this redraws it for the part of its axis that is asked for.

function buffer(text) {
  return Uint8Array.from(atob(text), function (c) { return c.charCodeAt(0); }).buffer;
}

function decoded(packed) {
  return Float32Array.from(new Int16Array(buffer(packed.data)), function (i) {
    return packed.low + (i + 32768) * packed.step;
  });
}

function niceStep(span, count) {
  const raw = span / count, power = Math.pow(10, Math.floor(Math.log10(raw)));
  return power * [1, 2, 4, 5, 10].find(function (f) { return raw <= f * power * (1 + 1e-9); });
}

function minus(text) { return text.replace(/-/g, "\u2212"); }

function tickLabel(value, step) {
  const text = value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return minus(Number(text) === 0 ? text.replace("-", "") : text);
}

function ticks(low, high, count) {
  const step = niceStep(high - low, count), out = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) {
    out.push({ value: i * step, label: tickLabel(i * step, step) });
  }
  return out.length > 1 || count > 20 ? out : ticks(low, high, 2 * count);
}

function powerLabel(factor, power) {
  if (power >= -3 && power <= 3) { return String(Number((factor * Math.pow(10, power)).toPrecision(1))); }
  const digits = String(power).replace(/[-0-9]/g, function (c) { return c === "-" ? "\u207b" : "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"[Number(c)]; });
  return factor === 1 ? "10" + digits : factor + "\u00b710" + digits;
}

function logTicks(low, high, factors) {
  const out = [];
  for (let power = Math.floor(low); power <= Math.ceil(high); power += 1) {
    factors.forEach(function (factor) {
      const value = power + Math.log10(factor);
      if (value >= low && value <= high) { out.push({ value: value, label: powerLabel(factor, power) }); }
    });
  }
  return out;
}

// First index whose time is not before t.
function indexOf(time, t) {
  let low = 0, high = time.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (time[middle] < t) { low = middle + 1; } else { high = middle; }
  }
  return low;
}

function extent(curves, from, to) {
  let low = Infinity, high = -Infinity;
  curves.forEach(function (curve) {
    const first = indexOf(curve.time, from), last = indexOf(curve.time, to + 1e-6);
    for (let i = first; i < last; i += 1) {
      if (curve.values[i] < low) { low = curve.values[i]; }
      if (curve.values[i] > high) { high = curve.values[i]; }
    }
  });
  if (low > high) { return [0, 1]; }
  const room = 0.06 * (high - low) || 0.5;
  return [low - room, high + room];
}

// Extremes per pixel column, or every sample where there are few.
function pathOf(curve, from, to, place, width) {
  const time = curve.time, values = curve.values, gap = curve.gap, parts = [];
  // One sample more on either side: curves run to the edge.
  const start = Math.max(0, indexOf(time, from) - 1), end = Math.min(time.length, indexOf(time, to + 1e-6) + 1);
  const few = end - start <= 2 * width;
  function point(k) { return place.x(time[k]).toFixed(1) + " " + place.y(values[k]).toFixed(1); }
  let i = start;
  while (i < end) {
    const x = place.x(time[i]);
    let stop = i + 1, low = i, high = i;
    while (!few && stop < end && place.x(time[stop]) - x < 1 && time[stop] - time[stop - 1] <= gap) {
      if (values[stop] < values[low]) { low = stop; }
      if (values[stop] > values[high]) { high = stop; }
      stop += 1;
    }
    const fresh = i === start || time[i] - time[i - 1] > gap;
    const first = Math.min(low, high), second = Math.max(low, high);
    parts.push((fresh ? "M" : "L") + point(first));
    if (second !== first) { parts.push("L" + point(second)); }
    i = stop;
  }
  return parts.join("");
}

function Plot(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  const clocks = data.clocks.map(function (c) { return { time: new Float32Array(buffer(c.time)), gap: c.gap }; });
  this.figure = figure;
  this.svg = figure.querySelector("svg.chart");
  this.axis = data.axis;
  this.series = {};
  for (const key of Object.keys(data.series)) {
    const packed = data.series[key], clock = clocks[packed.clock];
    this.series[key] = { time: clock.time, gap: clock.gap, values: decoded(packed), name: packed.name, style: packed.style, off: false };
  }
  this.left = Number(this.svg.dataset.left);
  this.right = Number(this.svg.dataset.right);
  this.height = this.svg.viewBox.baseVal.height;
  this.whole = data.axis.ends;
  this.view = this.whole.slice();
  this.panels = Array.from(this.svg.querySelectorAll(".panel"));
  this.overlay = this.make("g", { class: "overlay", "aria-hidden": "true" });
  this.svg.appendChild(this.overlay);
  this.listen();
  this.resize();
}

Plot.prototype.make = function (name, attributes, text) {
  const element = document.createElementNS(this.svg.namespaceURI, name);
  for (const key of Object.keys(attributes)) { element.setAttribute(key, attributes[key]); }
  if (text !== undefined) { element.textContent = text; }
  return element;
};

// One unit of the drawing is one pixel of the page, so that words keep their size on a phone.
Plot.prototype.resize = function (fixed) {
  const box = this.figure.querySelector(".canvas").clientWidth;
  const width = fixed || Math.max(300, Math.min(1400, box));
  if (width === this.width || !box) { return; }
  this.width = width;
  this.plotWidth = width - this.left - this.right;
  this.svg.setAttribute("viewBox", "0 0 " + width + " " + this.height);
  const self = this;
  this.svg.querySelectorAll(".frame, .clip").forEach(function (frame) {
    frame.setAttribute("width", self.plotWidth);
  });
  this.svg.querySelectorAll(".panel-error").forEach(function (words) {
    words.setAttribute("x", width - self.right);
  });
  this.svg.querySelector(".axis-name").setAttribute("x", (width + this.left - this.right) / 2);
  this.draw();
};

Plot.prototype.draw = function () {
  const self = this, t0 = this.view[0], t1 = this.view[1], scale = this.plotWidth / (t1 - t0);
  function x(t) { return (t - t0) * scale; }
  this.panels.forEach(function (panel) {
    self.drawCurves(panel, x);
    panel.querySelectorAll(".span").forEach(function (span) {
      const a = Math.max(x(Number(span.dataset.from)), -5), b = Math.min(x(Number(span.dataset.to)), self.plotWidth + 5);
      const box = span.querySelector("rect");
      span.style.display = b < 0 || a > self.plotWidth ? "none" : "";
      box.setAttribute("x", a);
      box.setAttribute("width", Math.max(b - a, 1.5));
    });
    self.drawLines(panel, x);
  });
  const axis = this.svg.querySelector(".x-axis"), marks = axis.querySelector(".x-ticks");
  const wanted = this.width > 600 ? 8 : 4, few = this.plotWidth / (t1 - t0) < 120;
  marks.replaceChildren();
  (this.axis.log ? logTicks(t0, t1, few ? [1] : [1, 2, 5]) : ticks(t0, t1, wanted)).forEach(function (tick) {
    const place = { class: "tick middle", x: self.left + x(tick.value), y: axis.dataset.top };
    marks.append(self.make("text", place, tick.label));
  });
};

Plot.prototype.drawCurves = function (panel, x) {
  if (panel.dataset.scale === "strips") { return; }
  const self = this, log = panel.dataset.scale === "log";
  const top = Number(panel.dataset.top), height = Number(panel.dataset.height);
  const curves = Array.from(panel.querySelectorAll(".curve"));
  const shown = curves.map(function (c) { return self.series[c.dataset.key]; }).filter(function (s) { return !s.off; });
  const fixed = panel.dataset.low !== undefined;
  const span = fixed ? [Number(panel.dataset.low), Number(panel.dataset.high)] : extent(shown, this.view[0], this.view[1]);
  const place = { x: x, y: function (v) { return (span[1] - v) / (span[1] - span[0]) * height; } };
  curves.forEach(function (curve) {
    const series = self.series[curve.dataset.key];
    curve.setAttribute("d", series.off ? "" : pathOf(series, self.view[0], self.view[1], place, self.plotWidth));
  });
  const marks = panel.querySelector(".y-ticks");
  marks.replaceChildren();
  const few = Math.floor(span[1]) - Math.ceil(span[0]) < 1;
  (log ? logTicks(span[0], span[1], few ? [1, 2, 5] : [1]) : ticks(span[0], span[1], Number(panel.dataset.count))).forEach(function (tick) {
    const y = top + place.y(tick.value), end = self.width - self.right;
    marks.append(
      self.make("path", { class: "grid", d: "M" + self.left + " " + y + "H" + end }),
      self.make("text", { class: "tick right", x: self.left - 7, y: y + 4 }, tick.label)
    );
  });
};

// Lines stand where they belong, their words in rows that do not overlap.
Plot.prototype.drawLines = function (panel, x) {
  const self = this, free = [];
  panel.querySelectorAll(".line").forEach(function (line) {
    const at = x(Number(line.dataset.at)), path = line.querySelector("path"), words = line.querySelector("text");
    // A stretch that begins before the view is named at its edge as long as it is in it.
    const span = path ? null : Array.from(panel.querySelectorAll(".span")).find(function (s) { return s.dataset.from === line.dataset.at; });
    const end = span ? x(Number(span.dataset.to)) : at;
    line.style.display = end < 0 || at > self.plotWidth ? "none" : "";
    if (line.style.display) { return; }
    if (path) { path.setAttribute("d", "M" + at + " 0V" + panel.dataset.height); }
    const wide = words.getComputedTextLength() + 10;
    const left = Math.max(0, Math.min(at, self.plotWidth - wide));
    let row = free.findIndex(function (taken) { return taken <= left; });
    if (row < 0) { row = free.length; }
    free[row] = left + wide;
    words.setAttribute("x", left + 4);
    words.setAttribute("y", 13 + 14 * row);
  });
};

Plot.prototype.show = function (from, to) {
  const whole = this.whole;
  const span = Math.min(Math.max(to - from, this.axis.least), whole[1] - whole[0]);
  const start = Math.min(Math.max((from + to - span) / 2, whole[0]), whole[1] - span);
  this.view = [start, start + span];
  this.draw();
};

Plot.prototype.zoom = function (factor) {
  const middle = (this.view[0] + this.view[1]) / 2, half = (this.view[1] - this.view[0]) / 2 * factor;
  this.show(middle - half, middle + half);
};

Plot.prototype.pan = function (share) {
  const step = share * (this.view[1] - this.view[0]);
  this.show(this.view[0] + step, this.view[1] + step);
};

Plot.prototype.act = function (what) {
  switch (what) {
    case "in": this.zoom(0.5); break;
    case "out": this.zoom(2); break;
    case "left": this.pan(-0.25); break;
    case "right": this.pan(0.25); break;
    case "reset": this.show(this.whole[0], this.whole[1]); break;
    default: return false;
  }
  return true;
};

Plot.prototype.timeAt = function (event) {
  const box = this.svg.getBoundingClientRect();
  const x = (event.clientX - box.left) / box.width * this.width - this.left;
  const share = Math.min(Math.max(x / this.plotWidth, 0), 1);
  return this.view[0] + share * (this.view[1] - this.view[0]);
};

Plot.prototype.placeOf = function (t) {
  return this.left + (t - this.view[0]) / (this.view[1] - this.view[0]) * this.plotWidth;
};

Plot.prototype.mark = function (start, end) {
  const a = this.placeOf(Math.min(start, end)), b = this.placeOf(Math.max(start, end));
  const box = { class: "selection", x: a, y: 0, width: b - a, height: this.height - 36 };
  this.overlay.replaceChildren(this.make("rect", box));
};

// The value of a curve at t, null in its gaps.
function valueAt(series, t) {
  const time = series.time, after = indexOf(time, t);
  const before = Math.max(after - 1, 0), i = after >= time.length || t - time[before] < time[after] - t ? before : after;
  return time.length && Math.abs(time[i] - t) <= series.gap ? series.values[i] : null;
}

function shortNumber(value) {
  const size = Math.abs(value);
  if (size >= 9.95e4 || (size > 0 && size < 1e-3)) { return minus(value.toExponential(1)); }
  return minus(size >= 100 ? value.toFixed(0) : String(Number(value.toPrecision(2))));
}

Plot.prototype.read = function (t) {
  const x = this.placeOf(t), self = this, spoken = [];
  const line = { class: "cursor", d: "M" + x + " 0V" + (this.height - 36) };
  this.overlay.replaceChildren(this.make("path", line));
  this.panels.forEach(function (panel) {
    const log = panel.dataset.scale === "log";
    const top = Number(panel.dataset.top), strips = panel.dataset.scale === "strips";
    const words = self.make("text", { class: "values halo right", x: self.width - self.right, y: strips ? top - 8 : top + 14 });
    panel.dataset.values.split("|").forEach(function (key) {
      const series = self.series[key], value = series && !series.off ? valueAt(series, t) : null;
      if (value === null || !series.name) { return; }
      const said = series.name + " " + shortNumber(log ? Math.pow(10, value) : value);
      words.append(self.make("tspan", { class: series.style, dx: words.childNodes.length ? 9 : 0 }, said));
      if (key.slice(-6) === " error") { spoken.push(key.slice(0, -6) + " " + minus(value.toPrecision(2))); }
    });
    self.overlay.append(words);
    const title = panel.querySelector(".panel-title"), note = panel.querySelector(".panel-error");
    const taken = title ? title.getComputedTextLength() + words.getComputedTextLength() + 16 : Infinity;
    if (!note && taken < self.plotWidth) { words.setAttribute("y", top - 8); }
  });
  const at = this.axis.log ? shortNumber(Math.pow(10, t)) : t.toFixed(this.axis.unit === "s" ? 2 : 1);
  this.figure.querySelector(".readout").textContent =
    minus(at) + " " + this.axis.unit + (spoken.length ? ", error: " + spoken.join(", ") : "");
};

Plot.prototype.listen = function () {
  const self = this, svg = this.svg;
  const keys = { "+": "in", "=": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", "0": "reset", Escape: "reset" };
  let drag = null;
  svg.setAttribute("tabindex", "0");
  svg.addEventListener("keydown", function (event) {
    if (!event.ctrlKey && !event.metaKey && self.act(keys[event.key])) { event.preventDefault(); }
  });
  svg.addEventListener("pointerdown", function (event) {
    if (event.button !== 0) { return; }
    drag = { from: self.timeAt(event), x: event.clientX, view: self.view.slice(), pan: event.shiftKey };
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", function (event) {
    if (!drag) { self.read(self.timeAt(event)); return; }
    if (!drag.pan) { self.mark(drag.from, self.timeAt(event)); return; }
    const moved = (event.clientX - drag.x) / svg.getBoundingClientRect().width * self.width / self.plotWidth;
    const shift = moved * (drag.view[1] - drag.view[0]);
    self.show(drag.view[0] - shift, drag.view[1] - shift);
  });
  svg.addEventListener("pointerup", function (event) {
    const done = drag;
    drag = null;
    self.overlay.replaceChildren();
    if (done && !done.pan && Math.abs(event.clientX - done.x) > 5) {
      const to = self.timeAt(event);
      self.show(Math.min(done.from, to), Math.max(done.from, to));
    } else if (done && !done.pan) { self.read(done.from); }
  });
  svg.addEventListener("pointercancel", function () { drag = null; self.overlay.replaceChildren(); });
  svg.addEventListener("pointerleave", function () {
    if (!drag) { self.overlay.replaceChildren(); self.figure.querySelector(".readout").textContent = ""; }
  });
  svg.addEventListener("dblclick", function () { self.act("reset"); });
  this.figure.querySelectorAll(".tools button").forEach(function (button) {
    button.addEventListener("click", function () { self.act(button.dataset.do); });
  });
  this.figure.querySelectorAll(".switch").forEach(function (button) {
    button.disabled = false;
    button.addEventListener("click", function () { self.turn(button); });
  });
  this.figure.querySelectorAll(".tools, .hint").forEach(function (part) { part.hidden = false; });
};

Plot.prototype.turn = function (button) {
  const off = button.getAttribute("aria-pressed") === "true", self = this;
  button.setAttribute("aria-pressed", String(!off));
  button.dataset.keys.split("|").forEach(function (key) { self.series[key].off = off; });
  this.draw();
};

const plots = Array.from(document.querySelectorAll("figure.plot")).filter(function (figure) {
  return figure.querySelector("svg.chart") && figure.querySelector("script");
}).map(function (figure) { return new Plot(figure); });
window.addEventListener("resize", function () { plots.forEach(function (plot) { plot.resize(); }); });
window.addEventListener("beforeprint", function () { plots.forEach(function (plot) { plot.resize(700); }); });
window.addEventListener("afterprint", function () { plots.forEach(function (plot) { plot.resize(); }); });
}());
