// The vehicle on a drawing: layout, size, order and spins of the motors.

import { extent, LAYOUT_WORDS, layoutNames, ORDER_WORDS, ordersOf, relaid, reverse, reverseAll, rotorCount, rotorsOf, seatWords, swap }
  from "./airframe.js";
import { h } from "./dom.js";
import { vehicleDrawing } from "./drawing.js";
import { guessedVehicle, guessWords, takeGuess } from "./logs.js";
import { logs, set, setForm, setVehicle, state } from "./state.js";
import { LENGTHS, shown, typed } from "./units.js";

const [SMALLEST, LARGEST] = [0.015, 10];

export function vehicleView() {
  const { vehicle } = state;
  return [
    state.said && h("p", { class: "finding identified", id: "said" }, state.said),
    offers(),
    h("div", { class: "vehicle-parts", "data-key": "parts" },
      h("div", { class: "draw" }, vehicleDrawing(vehicle, state.view), drawingTools(), drawingHint()),
      h("div", { class: "fields" },
        h("label", { class: "field", for: "name" }, "Its name, for the report",
          h("input", { id: "name", value: state.form.name, maxlength: 80, autocomplete: "off", "data-change": "title" })),
        vehicle.listed ? listedFields(vehicle) : [layoutFields(vehicle), sizeFields(vehicle)],
        speedField(), imuFields(), places())),
  ];
}

/** What a log tells that the drawing does not show, to be taken by a click. */
function offers() {
  const shown = JSON.stringify(rotorsOf(state.vehicle));
  return logs().filter(({ findings }) => findings && tells(findings.guess) !== shown)
    .map(({ name, findings }) => h("p", { class: "finding plain offer" }, guessWords(name, findings), " ",
      h("button", { type: "button", class: "small", "data-do": "take-guess", "data-name": name }, "Take it")));
}

/** The rotors that a log is sure of: borne out by the flight, or set in the autopilot. */
function tells(guess) {
  const sure = guess.borne_out || guess.airframe_is === "set";
  return JSON.stringify(rotorsOf((sure && guessedVehicle(guess)) || state.vehicle));
}

function drawingTools() {
  const { mode } = state.view;
  const choice = (value, words) => h("button", { type: "button", "data-do": "mode", "data-mode": value,
    "aria-pressed": String(mode === value) }, words);
  return h("div", { class: "tools" },
    h("div", { role: "group", "aria-label": "What a click on a motor does", class: "segmented" },
      choice("reverse", "Reverse a spin"), choice("swap", "Swap two numbers")),
    h("button", { type: "button", "data-do": "reverse-all" }, "Reverse all spins"),
    h("button", { type: "button", "data-do": "turn", "data-by": -45, "aria-label": "Turn the drawing to the left" }, "↺"),
    h("button", { type: "button", "data-do": "turn", "data-by": 45, "aria-label": "Turn the drawing to the right" }, "↻"));
}

function drawingHint() {
  const { mode, picked } = state.view;
  const words = mode === "reverse" ? "Seen from above. Click a motor to reverse its spin."
    : picked === null ? "Click the two motors whose numbers are to be swapped."
      : `Motor ${picked + 1}: now click the motor that it swaps its number with.`;
  return h("p", { class: "hint" }, words);
}

function layoutFields({ layout, order }) {
  const count = motorsOfLogs();
  const fitting = layoutNames().filter((name) => !count || rotorCount(name) === count || name === layout);
  return [
    h("label", { class: "field", for: "layout" }, "Layout",
      select("layout", fitting.map((name) => [name, LAYOUT_WORDS[name] ?? name]), layout)),
    h("label", { class: "field", for: "order" }, "Motor order of",
      select("order", ordersOf(layout).map((name) => [name, ORDER_WORDS[name] ?? name]), order)),
    count && count !== rotorCount(layout)
      ? h("p", { class: "finding not-identified" }, `The log has ${count} motors, this layout ${rotorCount(layout)}: choose another one.`)
      : null,
  ];
}

const motorsOfLogs = () => logs().map(({ findings }) => findings?.rotors).find(Boolean) ?? null;

function select(id, choices, chosen) {
  return h("select", { id, "data-change": id },
    choices.map(([value, words]) => h("option", { value, selected: value === chosen }, words)));
}

function sizeFields({ measure, arm, spacing, unit }) {
  const factor = LENGTHS[unit];
  const radio = (value, words) => h("label", { class: "choice" },
    h("input", { type: "radio", name: "measure", value, checked: measure === value, "data-change": "measure" }), words);
  const length = (i, words, value) => h("label", { class: "field", for: `size-${i}` }, words,
    h("span", { class: "with-unit" },
      h("input", { id: `size-${i}`, inputmode: "decimal", autocomplete: "off", value: shown(value, factor),
        "data-change": "size", "data-axis": i, "aria-describedby": "size-hint",
        "aria-invalid": doubtful(value) ? "true" : null }),
      i === 0 ? select("unit", Object.keys(LENGTHS).map((name) => [name, name]), unit) : h("span", { class: "unit" }, unit)));
  return h("fieldset", {},
    h("legend", {}, "Size"),
    h("div", { class: "choices" }, radio("arm", "One arm"), radio("spacing", "Two distances")),
    measure === "arm"
      ? length(0, "From the centre to a motor axis", arm)
      : [length(0, "Front to back, between motor axes", spacing[0]), length(1, "Left to right, between motor axes", spacing[1])],
    h("p", { class: "hint", id: "size-hint" }, measure === "arm"
      ? "Measure from one motor axis to the opposite one, across the centre, and take half."
      : "Lay the ruler from motor axis to motor axis, as the lines on the drawing show."),
    sizeDoubt(measure === "arm" ? [arm] : spacing));
}

const doubtful = (value) => value !== null && !(value >= SMALLEST && value <= LARGEST);

function sizeDoubt(values) {
  const odd = values.find(doubtful);
  if (odd === undefined) return null;
  const words = Number.isNaN(odd) ? "This is no number: type digits, such as 127."
    : `${shown(odd)} m is no size of a multirotor: see whether the unit is right.`;
  return h("p", { class: "finding not-identified", role: "alert" }, words);
}

/** Rotors from a file or from the autopilot's parameters: their places are as they came. */
function listedFields() {
  return [
    h("p", {}, "Each motor has a place of its own. The drawing reverses spins and swaps numbers; the places are below."),
    h("p", {}, h("button", { type: "button", "data-do": "relay" }, "Choose a layout instead")),
  ];
}

function speedField() {
  const { speed = "measured" } = state.form.motors ?? {};
  return h("label", { class: "field", for: "speed" }, "Rotor speed in the log",
    select("speed", [["measured", "measured (ESC telemetry, bidirectional DShot)"], ["commanded", "only motor commands"]], speed));
}

/** Where the flight controller is; without it the accelerometer is the origin. */
function imuFields() {
  const place = state.form.airframe.imu?.position ?? [null, null, null];
  const { unit } = state.vehicle;
  return h("details", { class: "section" },
    h("summary", {}, "Where the flight controller is ", h("span", { class: "soft" }, "(optional)")),
    h("p", { class: "hint" }, "From the centre of the motors to the flight controller's IMU. Without it the centre of mass is told from the IMU."),
    h("div", { class: "three" }, ["forward", "left", "up"].map((words, axis) =>
      h("label", { class: "field" }, `${words} [${unit}]`,
        h("input", { id: `imu-${axis}`, inputmode: "decimal", autocomplete: "off", value: shown(place[axis], LENGTHS[unit]),
          "data-change": "imu", "data-axis": axis })))));
}

/** The same in a table: what a file would say. */
function places() {
  const { vehicle } = state;
  const rotors = rotorsOf(vehicle);
  const size = Math.max(extent(rotors, 0), extent(rotors, 1)) / 2;
  const sized = vehicle.listed || (vehicle.measure === "arm" ? vehicle.arm : vehicle.spacing.every(Boolean));
  const number = (x) => (sized ? shown(Number(x.toFixed(6)), LENGTHS[vehicle.unit]) : "?");
  return h("details", { class: "section" },
    h("summary", {}, "The motors in a table"),
    h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "The motors in a table" },
      h("table", { class: "plain" },
        h("thead", {}, h("tr", {}, ["Motor", "Seat", `Forward [${vehicle.unit}]`, `Left [${vehicle.unit}]`, "Spin"].map((words) =>
          h("th", { scope: "col" }, words)))),
        h("tbody", {}, rotors.map(({ position, spin }, i) => h("tr", {},
          h("th", { scope: "row" }, String(i + 1)), h("td", {}, seatWords(position, size)),
          h("td", {}, number(position[0])), h("td", {}, number(position[1])), h("td", {}, spin)))))));
}

const setView = (change) => set({ view: { ...state.view, ...change } });
const setSize = (change) => setVehicle({ ...state.vehicle, ...change, touched: true });

export const actions = {
  title: (_, { value }) => setForm({ ...state.form, name: value.trim() || "my multirotor" }),
  motor: ({ motor }) => {
    const { mode, picked } = state.view;
    const one = Number(motor);
    if (mode === "reverse") return setVehicle(reverse(state.vehicle, one));
    if (picked === null) return setView({ picked: one });
    setView({ picked: null });
    return picked === one ? null : setVehicle(swap(state.vehicle, picked, one));
  },
  mode: ({ mode }) => setView({ mode, picked: null }),
  turn: ({ by }) => setView({ turn: (state.view.turn + Number(by) + 360) % 360 }),
  "reverse-all": () => setVehicle(reverseAll(state.vehicle)),
  relay: () => setVehicle(relaid(state.vehicle, "quad-x", "betaflight")),
  "take-guess": ({ name }) => takeGuess(logs().find((log) => log.name === name)),
  layout: (_, { value }) => setVehicle(relaid(state.vehicle, value, state.vehicle.order)),
  order: (_, { value }) => setVehicle(relaid(state.vehicle, state.vehicle.layout, value)),
  measure: (_, { value }) => setSize({ measure: value }),
  unit: (_, { value }) => setSize({ unit: value }),
  size: ({ axis }, { value }) => {
    const length = typed(value, LENGTHS[state.vehicle.unit]);
    if (state.vehicle.measure === "arm") return setSize({ arm: length });
    return setSize({ spacing: state.vehicle.spacing.map((old, i) => (i === Number(axis) ? length : old)) });
  },
  speed: (_, { value }) => setForm({ ...state.form, motors: { ...state.form.motors, speed: value } }),
  imu: ({ axis }, { value }) => {
    const position = (state.form.airframe.imu?.position ?? [0, 0, 0]).map((old, i) =>
      i === Number(axis) ? typed(value, LENGTHS[state.vehicle.unit]) ?? 0 : old);
    setForm({ ...state.form, airframe: { ...state.form.airframe, imu: { ...state.form.airframe.imu, position } } });
  },
};
