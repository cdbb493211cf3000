(function () {
"use strict";
// Zoom and pan of the wrench figures. The page is complete without it: every figure is drawn
// already; this redraws its curves and ticks for the part of the flight that is asked for.

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

function tickLabel(value, step) {
  const text = value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "\u2212");
}

function ticks(low, high, count) {
  const step = niceStep(high - low, count), out = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) {
    out.push({ value: i * step, label: tickLabel(i * step, step) });
  }
  return out.length > 1 || count > 20 ? out : ticks(low, high, 2 * count);
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
  curves.forEach(function (values) {
    for (let i = from; i < to; i += 1) {
      if (values[i] < low) { low = values[i]; }
      if (values[i] > high) { high = values[i]; }
    }
  });
  if (low > high) { return [0, 1]; }
  const room = 0.06 * (high - low) || 0.5;
  return [low - room, high + room];
}

// Extremes per pixel column, or every sample where there are few.
function pathOf(time, values, range, place, gap, width) {
  const few = range.to - range.from <= 2 * width, parts = [];
  function point(k) { return place.x(time[k]).toFixed(1) + " " + place.y(values[k]).toFixed(1); }
  let i = range.from;
  while (i < range.to) {
    const x = place.x(time[i]);
    let stop = i + 1, low = i, high = i;
    while (!few && stop < range.to && place.x(time[stop]) - x < 1 && time[stop] - time[stop - 1] <= gap) {
      if (values[stop] < values[low]) { low = stop; }
      if (values[stop] > values[high]) { high = stop; }
      stop += 1;
    }
    const fresh = i === range.from || time[i] - time[i - 1] > gap;
    const first = Math.min(low, high), second = Math.max(low, high);
    parts.push((fresh ? "M" : "L") + point(first));
    if (second !== first) { parts.push("L" + point(second)); }
    i = stop;
  }
  return parts.join("");
}

function Plot(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  this.figure = figure;
  this.svg = figure.querySelector("svg.wrench");
  this.time = new Float32Array(buffer(data.time));
  this.gap = data.gap;
  this.series = {};
  for (const key of Object.keys(data.series)) { this.series[key] = decoded(data.series[key]); }
  this.left = Number(this.svg.dataset.left);
  this.right = Number(this.svg.dataset.right);
  this.height = this.svg.viewBox.baseVal.height;
  this.whole = [this.time[0], this.time[this.time.length - 1]];
  this.view = this.whole.slice();
  this.panels = Array.from(this.svg.querySelectorAll(".panel"));
  this.overlay = this.make("g", {});
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
  if (width === this.width) { return; }
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
  const first = indexOf(this.time, t0), last = indexOf(this.time, t1 + 1e-6);
  // One sample more on either side: curves run to the edge.
  const range = { from: Math.max(0, first - 1), to: Math.min(this.time.length, last + 1) };
  this.panels.forEach(function (panel) {
    const top = Number(panel.dataset.top), height = Number(panel.dataset.height);
    const curves = Array.from(panel.querySelectorAll(".curve"));
    const span = extent(curves.map(function (c) { return self.series[c.dataset.key]; }), first, last);
    const place = {
      x: function (t) { return (t - t0) * scale; },
      y: function (v) { return (span[1] - v) / (span[1] - span[0]) * height; }
    };
    curves.forEach(function (curve) {
      const values = self.series[curve.dataset.key];
      curve.setAttribute("d", pathOf(self.time, values, range, place, self.gap, self.plotWidth));
    });
    const marks = panel.querySelector(".y-ticks");
    marks.replaceChildren();
    ticks(span[0], span[1], Number(panel.dataset.count)).forEach(function (tick) {
      const y = top + place.y(tick.value), end = self.width - self.right;
      marks.append(
        self.make("path", { class: "grid", d: "M" + self.left + " " + y + "H" + end }),
        self.make("text", { class: "tick right", x: self.left - 7, y: y + 4 }, tick.label)
      );
    });
  });
  const axis = this.svg.querySelector(".x-axis"), marks = axis.querySelector(".x-ticks");
  marks.replaceChildren();
  ticks(t0, t1, this.width > 600 ? 8 : 4).forEach(function (tick) {
    const x = self.left + (tick.value - t0) * scale;
    marks.append(self.make("text", { class: "tick middle", x: x, y: axis.dataset.top }, tick.label));
  });
};

Plot.prototype.show = function (from, to) {
  const least = 0.02, whole = this.whole;
  let span = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
  let start = Math.min(Math.max((from + to - span) / 2, whole[0]), whole[1] - span);
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

Plot.prototype.read = function (t) {
  const x = this.placeOf(t), i = Math.min(indexOf(this.time, t), this.time.length - 1), self = this;
  const line = { class: "cursor", d: "M" + x + " 0V" + (this.height - 36) };
  this.overlay.replaceChildren(this.make("path", line));
  const words = ["Fz", "Mx", "My", "Mz"].filter(function (name) {
    return self.series[name + " error"];
  }).map(function (name) {
    return name + " " + self.series[name + " error"][i].toPrecision(2);
  });
  this.figure.querySelector(".readout").textContent =
    (t.toFixed(2) + " s, error: " + words.join(", ")).replace(/-/g, "\u2212");
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
    }
  });
  svg.addEventListener("pointercancel", function () { drag = null; self.overlay.replaceChildren(); });
  svg.addEventListener("pointerleave", function () {
    if (!drag) { self.overlay.replaceChildren(); self.figure.querySelector(".readout").textContent = ""; }
  });
  svg.addEventListener("dblclick", function () { self.act("reset"); });
  this.figure.querySelectorAll("button").forEach(function (button) {
    button.addEventListener("click", function () { self.act(button.dataset.do); });
  });
  this.figure.querySelectorAll(".tools, .hint").forEach(function (part) { part.hidden = false; });
};

const plots = Array.from(document.querySelectorAll("figure.plot")).map(function (figure) {
  return new Plot(figure);
}).filter(Boolean);
window.addEventListener("resize", function () { plots.forEach(function (plot) { plot.resize(); }); });
window.addEventListener("beforeprint", function () { plots.forEach(function (plot) { plot.resize(700); }); });
window.addEventListener("afterprint", function () { plots.forEach(function (plot) { plot.resize(); }); });
}());
