// The vehicle from above: motors to click, their spins, and the line along which to measure.

import { extent, rotorsOf, seatWords } from "./airframe.js";
import { h } from "./dom.js";
import { LENGTHS, shown } from "./units.js";

const SIZE = 440;
const MIDDLE = SIZE / 2;
const REACH = 128; // px from the centre to the farthest motor

/** The drawing; `turn` [deg] is how far the paper is turned, clockwise. */
export function vehicleDrawing(vehicle, { turn, picked, mode }) {
  const rotors = rotorsOf(vehicle);
  const size = Math.max(...rotors.map(({ position: [x, y] }) => Math.hypot(x, y)));
  const place = placer(turn, REACH / (size || 1));
  const radius = discRadius(rotors, place);
  return h("svg", { class: "vehicle", viewBox: `0 0 ${SIZE} ${SIZE}`, role: "group",
    "aria-label": `${rotors.length} motors seen from above` },
    rotors.map((rotor) => arm(place, rotor)),
    front(turn),
    stacks(rotors).map((members) => {
      const r = members.length > 1 ? 0.52 * radius : radius;
      return members.map((i, depth) => motor(rotors[i], i, {
        at: outward(place(rotors[i].position), 1.65 * depth * r), radius: r, size, mode, picked: picked === i }));
    }),
    measures(vehicle, rotors, place, (radius + 16) / (REACH / size)));
}

/** From metres, x forward and y left, to the paper: front is up before it is turned. */
function placer(turn, scale) {
  const c = Math.cos((turn * Math.PI) / 180);
  const s = Math.sin((turn * Math.PI) / 180);
  return ([x, y]) => {
    const [right, up] = [-y * scale, x * scale];
    return [MIDDLE + c * right + s * up, MIDDLE + s * right - c * up];
  };
}

function discRadius(rotors, place) {
  const places = rotors.map((rotor) => place(rotor.position));
  const apart = places.flatMap(([x, y], i) =>
    places.slice(i + 1).map(([a, b]) => Math.hypot(a - x, b - y)));
  return Math.min(62, 0.42 * Math.min(...apart.filter((d) => d > 1)));
}

/** Motors that share a place, one above the other. */
function stacks(rotors) {
  const found = new Map();
  rotors.forEach(({ position: [x, y] }, i) => {
    const key = `${x.toFixed(4)} ${y.toFixed(4)}`;
    found.set(key, [...(found.get(key) ?? []), i]);
  });
  return [...found.values()];
}

/** Of two that share a place the lower one is drawn farther out, so that both can be clicked. */
function outward([x, y], distance) {
  const length = Math.hypot(x - MIDDLE, y - MIDDLE) || 1;
  return [x + (distance * (x - MIDDLE)) / length, y + (distance * (y - MIDDLE)) / length];
}

function front(turn) {
  const angle = (turn * Math.PI) / 180;
  const [x, y] = [MIDDLE + 22 * Math.sin(angle), MIDDLE - 22 * Math.cos(angle)];
  const nose = [[0, -60], [-13, -41], [13, -41]].map(([dx, dy]) => `${MIDDLE + dx},${MIDDLE + dy}`).join(" ");
  return h("g", { class: "front" },
    h("g", { transform: `rotate(${turn} ${MIDDLE} ${MIDDLE})` },
      h("rect", { class: "hull", x: MIDDLE - 26, y: MIDDLE - 38, width: 52, height: 76, rx: 14 }),
      h("polygon", { points: nose })),
    h("text", { class: "middle", x, y: y + 4 }, "front"));
}

function arm(place, { position }) {
  const [x, y] = place(position);
  return h("path", { class: "arm", d: `M${MIDDLE} ${MIDDLE}L${x.toFixed(1)} ${y.toFixed(1)}` });
}

function motor(rotor, i, { at: [x, y], radius, size, mode, picked }) {
  const where = seatWords(rotor.position, size);
  const turning = rotor.spin === "ccw" ? "counterclockwise" : "clockwise";
  const deed = mode === "swap" ? "swap its number" : "reverse its spin";
  return h("g", { class: `rotor ${rotor.spin}${picked ? " picked" : ""}`, id: `motor-${i + 1}`,
    role: "button", tabindex: 0, "data-do": "motor", "data-motor": i,
    "aria-pressed": mode === "swap" ? String(picked) : null,
    "aria-label": `Motor ${i + 1}, ${where}, turns ${turning}: ${deed}` },
    h("circle", { class: "disc", cx: x, cy: y, r: radius }),
    spinArrow(x, y, radius * 0.8, rotor.spin),
    h("text", { class: "rotor-number middle", x, y: y + 4 }, String(i + 1)),
    h("text", { class: "rotor-spin middle", x, y: y + 19 }, rotor.spin));
}

/** An arc of 250 degrees with a head; seen from above, as the report draws it. */
function spinArrow(x, y, r, spin) {
  const sign = spin === "ccw" ? 1 : -1;
  const [a, b] = [sign * 0.25 * Math.PI, sign * (0.25 + 250 / 180) * Math.PI];
  const at = (angle, distance) => [x + distance * Math.cos(angle), y - distance * Math.sin(angle)];
  const [[x0, y0], [x1, y1]] = [at(a, r), at(b, r)];
  const ahead = b + (sign * Math.PI) / 2;
  const head = [[9, ahead], [5, b], [-5, b]].map(([d, angle]) =>
    `${(x1 + d * Math.cos(angle)).toFixed(1)},${(y1 - d * Math.sin(angle)).toFixed(1)}`);
  const sweep = spin === "ccw" ? 0 : 1;
  const d = `M${x0.toFixed(1)} ${y0.toFixed(1)}A${r} ${r} 0 1 ${sweep} ${x1.toFixed(1)} ${y1.toFixed(1)}`;
  return h("g", { class: "spin" },
    h("path", { class: "arc", d }), h("polygon", { class: "head", points: head.join(" ") }));
}

/** Lines where the ruler lies: from the centre to a motor axis, or `beside` the motors [m]. */
function measures(vehicle, rotors, place, beside) {
  if (vehicle.listed) return [];
  const words = (value) => (value > 0 ? `${shown(value, LENGTHS[vehicle.unit])} ${vehicle.unit}` : "?");
  if (vehicle.measure === "arm") {
    const rear = rotors.reduce((a, b) => (b.position[0] < a.position[0] ? b : a));
    return [ruler(place([0, 0]), place(rear.position), `arm ${words(vehicle.arm)}`)];
  }
  const [long, wide] = [extent(rotors, 0) / 2, extent(rotors, 1) / 2];
  const [a, b] = vehicle.spacing.map(words);
  return [
    ruler(place([-long - beside, wide]), place([-long - beside, -wide]), `left to right ${b}`),
    ruler(place([long, wide + beside]), place([-long, wide + beside]), `front to back ${a}`),
  ];
}

function ruler([x0, y0], [x1, y1], words) {
  const length = Math.hypot(x1 - x0, y1 - y0) || 1;
  const [nx, ny] = [(5 * (y1 - y0)) / length, (5 * (x0 - x1)) / length];
  const tick = (x, y) => `M${(x - nx).toFixed(1)} ${(y - ny).toFixed(1)}L${(x + nx).toFixed(1)} ${(y + ny).toFixed(1)}`;
  let angle = (Math.atan2(y1 - y0, x1 - x0) * 180) / Math.PI;
  if (angle > 90 || angle <= -90) angle += 180;
  const [mx, my] = [(x0 + x1) / 2, (y0 + y1) / 2];
  const turned = (angle * Math.PI) / 180;
  const below = (MIDDLE - mx) * Math.sin(turned) + (my - MIDDLE) * Math.cos(turned) > 1;
  return h("g", { class: "ruler" },
    h("path", { d: `${tick(x0, y0)}M${x0.toFixed(1)} ${y0.toFixed(1)}L${x1.toFixed(1)} ${y1.toFixed(1)}${tick(x1, y1)}` }),
    h("text", { class: "middle", x: mx, y: my + (below ? 16 : -6), transform: `rotate(${angle.toFixed(1)} ${mx.toFixed(1)} ${my.toFixed(1)})` }, words));
}
