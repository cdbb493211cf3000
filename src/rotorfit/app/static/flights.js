// Weigh it, name its configurations, and say which flight is of which.

import { h } from "./dom.js";
import { addConfiguration, editUse, moveUse, removeConfiguration, renameConfiguration, usesOf, withConfiguration,
  withPayload } from "./form.js";
import { logs, set, setForm, state } from "./state.js";
import { LENGTHS, MASSES, shown, typed } from "./units.js";

const [LIGHTEST, HEAVIEST] = [0.012, 100];

export function flightsView() {
  const { configuration } = state.form;
  return [
    h("div", { class: "configurations" }, configuration.map((one, i) => configurationCard(one, i))),
    h("div", { class: "deeds" }, h("button", { type: "button", "data-do": "add-configuration" }, "Add a configuration"),
      h("span", { class: "hint" }, "The same vehicle with something hung on: drag torque, yaw inertia and the height of the centre of mass get sharper.")),
    usesTable(),
  ];
}

function configurationCard(one, i) {
  const several = state.form.configuration.length > 1;
  return h("fieldset", { class: "card", "data-key": `configuration-${i}` },
    h("legend", {}, `Configuration ${one.name}`),
    several && h("label", { class: "field" }, "Name",
      h("input", { id: `name-${i}`, value: one.name, maxlength: 40, autocomplete: "off", "data-change": "name", "data-i": i })),
    massField(one, i),
    several ? payloadFields(one, i) : null,
    several && h("p", {}, h("button", { type: "button", class: "quiet", "data-do": "remove-configuration", "data-i": i },
      `Remove configuration ${one.name}`)));
}

function massField({ mass, name }, i) {
  const unknown = mass === "unknown";
  const unit = state.view.massUnits[i] ?? "g";
  return [
    h("label", { class: "field", for: `mass-${i}` }, "Mass as it flies, with battery",
      h("span", { class: "with-unit" },
        h("input", { id: `mass-${i}`, inputmode: "decimal", autocomplete: "off", disabled: unknown, "data-change": "mass", "data-i": i,
          value: unknown ? "" : shown(mass, MASSES[unit]), "aria-describedby": `mass-check-${i}`,
          "aria-invalid": mass && massDoubt(mass) ? "true" : null }),
        h("select", { id: `mass-unit-${i}`, "aria-label": `Unit of the mass of configuration ${name}`, "data-change": "mass-unit", "data-i": i },
          Object.keys(MASSES).map((word) => h("option", { value: word, selected: word === unit }, word))))),
    h("p", { class: massDoubt(mass) ? "finding weak" : "hint", id: `mass-check-${i}` }, massWords(mass, unit),
      otherUnit(mass, unit) && h("button", { type: "button", class: "small", "data-do": "other-unit", "data-i": i },
        `It is ${shown(mass, MASSES[unit])} ${otherUnit(mass, unit)}`)),
    state.form.configuration.length === 1 && h("label", { class: "choice" },
      h("input", { type: "checkbox", id: "unweighed", checked: unknown, "data-change": "unweighed", "data-i": i }),
      "I cannot weigh it: tell everything per kilogram"),
  ];
}

const massDoubt = (mass) => typeof mass === "number" && !(mass >= LIGHTEST && mass <= HEAVIEST);

/** The unit that was meant, where the digits are a multirotor's mass only in that one. */
function otherUnit(mass, unit) {
  const other = unit === "g" ? "kg" : "g";
  return massDoubt(mass) && !massDoubt((mass / MASSES[unit]) * MASSES[other]) ? other : null;
}

function massWords(mass, unit) {
  if (mass === "unknown") return "Forces and inertia are told per kilogram.";
  if (mass === undefined) return "Put it on a scale as it flies: every force scales with this number.";
  if (Number.isNaN(mass)) return "This is no number: type digits, such as 428.";
  const other = unit === "g" ? `${shown(mass)} kg` : `${shown(mass, MASSES.g)} g`;
  return massDoubt(mass) ? `That is ${other}: is the unit right? ` : `That is ${other}.`;
}

/** What it carries beyond another configuration; weighed and measured, it sharpens the estimate. */
function payloadFields(one, i) {
  const bare = state.form.configuration.filter((other, k) => k !== i && !other.payload_of);
  if (!bare.length) return null;
  const carried = one.payload ?? [];
  const { unit } = state.vehicle;
  return h("div", { class: "payload" },
    carried.length ? h("label", { class: "field" }, "Carries beyond configuration",
      h("select", { id: `beyond-${i}`, "data-change": "beyond", "data-i": i },
        bare.map(({ name }) => h("option", { value: name, selected: name === one.payload_of }, name)))) : null,
    carried.map((item, k) => h("div", { class: "item", role: "group", "aria-label": `Payload ${k + 1}` },
      itemField("mass [g]", shown(item.mass, MASSES.g), { i, k, axis: "mass" }),
      ["forward", "left", "up"].map((words, axis) =>
        itemField(`${words} [${unit}]`, shown(item.position[axis], LENGTHS[unit]), { i, k, axis })),
      h("button", { type: "button", class: "quiet", "data-do": "remove-item", "data-i": i, "data-k": k,
        "aria-label": `Remove payload ${k + 1}` }, "Remove"))),
    h("button", { type: "button", class: "small", "data-do": "add-item", "data-i": i },
      carried.length ? "Add another piece" : `Say what ${one.name} carries`),
    carried.length ? h("p", { class: "hint" }, "Places are measured from the centre of the motors to the middle of the piece.") : null);
}

function itemField(words, value, { i, k, axis }) {
  return h("label", { class: "field narrow" }, words,
    h("input", { id: `item-${i}-${k}-${axis}`, inputmode: "decimal", autocomplete: "off", value,
      "data-change": "item", "data-i": i, "data-k": k, "data-axis": axis }));
}

function usesTable() {
  const usable = logs().filter((log) => log.findings?.usable && !isRecording(log));
  if (!usable.length) return null;
  return h("div", { id: "uses", tabindex: -1 },
    h("h3", {}, "Which flight is for what"),
    h("p", { class: "hint" }, "A flight kept apart is not used for the fit: the result is tried on it."),
    h("ul", { class: "uses" }, usable.map((log) => logUses(log))));
}

function logUses({ name }) {
  const uses = usesOf(state.form, name);
  return h("li", { "data-key": name }, h("h4", {}, name),
    (uses.length ? uses : [null]).map((use, nth) => useRow(name, use, nth)),
    uses.length ? h("button", { type: "button", class: "small", "data-do": "add-part", "data-name": name },
      "Use another part of this log, too") : null);
}

function useRow(name, use, nth) {
  const at = { "data-name": name, "data-nth": nth };
  const chosen = use ? `${use.configuration} ${use.role}` : "";
  const choices = state.form.configuration.flatMap((one, i) => [
    [`${i} flights`, `${one.name}: fit`], [`${i} validation`, `${one.name}: kept apart, to validate`]]);
  const time = (end, words) => h("label", { class: "field narrow" }, `${words} [s]`,
    h("input", { id: `${end}-${name}-${nth}`, inputmode: "decimal", autocomplete: "off", placeholder: "found",
      value: shown(use.entry[end]), "data-change": "part", "data-end": end, ...at }));
  return h("div", { class: "use" },
    h("label", { class: "field" }, "Use it for",
      h("select", { id: `use-${name}-${nth}`, "data-change": "use", ...at },
        [["", "nothing"], ...choices].map(([value, words]) => h("option", { value, selected: value === chosen }, words)))),
    use && time("start", "from"), use && time("end", "to"), use && recordingField(use, at));
}

/** Position and attitude without a gyro: a motion-capture file. */
const isRecording = ({ findings }) => {
  const names = findings?.channels.map((channel) => channel.name) ?? [];
  return names.includes("position") && !names.includes("gyro");
};

/** The motion-capture file of the same flight, where one was dropped. */
function recordingField({ entry }, at) {
  const names = logs().filter(isRecording).map(({ name }) => name);
  const chosen = entry.mocap?.file ?? entry.mocap ?? "";
  return names.length ? h("label", { class: "field" }, "with motion capture",
    h("select", { id: `mocap-${at["data-name"]}-${at["data-nth"]}`, "data-change": "mocap", ...at },
      ["", ...names].map((name) => h("option", { value: name, selected: name === chosen }, name || "none")))) : null;
}

const change = (i, what) => setForm(withConfiguration(state.form, Number(i), what));
const payloadOf = (i) => state.form.configuration[i].payload ?? [];
const useOf = ({ name, nth }) => usesOf(state.form, name)[Number(nth)];

export const actions = {
  name: ({ i }, { value }) => value.trim() && setForm(renameConfiguration(state.form, Number(i), value.trim())),
  mass: ({ i }, { value }) => change(i, { mass: typed(value, MASSES[state.view.massUnits[i] ?? "g"]) }),
  "mass-unit": ({ i }, { value }) => {
    // The digits stay as they were typed; only what they mean changes.
    const { mass } = state.form.configuration[i];
    const before = MASSES[state.view.massUnits[i] ?? "g"];
    set({ view: { ...state.view, massUnits: { ...state.view.massUnits, [i]: value } } });
    if (typeof mass === "number") change(i, { mass: typed(shown(mass, before), MASSES[value]) });
  },
  "other-unit": ({ i }) => actions["mass-unit"]({ i }, { value: state.view.massUnits[i] === "kg" ? "g" : "kg" }),
  unweighed: ({ i }, { checked }) => change(i, { mass: checked ? "unknown" : null }),
  "add-configuration": () => setForm(addConfiguration(state.form)),
  "remove-configuration": ({ i }) => setForm(removeConfiguration(state.form, Number(i))),
  beyond: ({ i }, { value }) => change(i, { payload_of: value }),
  "add-item": ({ i }) => setForm(withPayload(state.form, Number(i), [...payloadOf(i), { mass: null, position: [0, 0, 0] }])),
  "remove-item": ({ i, k }) => setForm(withPayload(state.form, Number(i), payloadOf(i).filter((_, n) => n !== Number(k)))),
  item: ({ i, k, axis }, { value }) => setForm(withPayload(state.form, Number(i), payloadOf(i).map((item, n) =>
    n !== Number(k) ? item : edited(item, axis, value)))),
  use: ({ name, nth }, { value }) => {
    const [configuration, role] = value.split(" ");
    const to = value ? { configuration: Number(configuration), role } : null;
    const use = useOf({ name, nth });
    setForm(moveUse(state.form, use, to && !use ? { ...to, entry: { file: name } } : to));
  },
  "add-part": ({ name }) => {
    const { configuration, entry } = useOf({ name, nth: 0 });
    setForm(moveUse(state.form, null, { configuration, role: "validation", entry: { ...entry, start: undefined, end: undefined } }));
  },
  mocap: (at, { value }) => setForm(editUse(state.form, useOf(at), { mocap: value ? { file: value } : null })),
  part: ({ name, nth, end }, { value }) => setForm(editUse(state.form, useOf({ name, nth }), { [end]: typed(value) })),
};

function edited(item, axis, value) {
  if (axis === "mass") return { ...item, mass: typed(value, MASSES.g) };
  const length = typed(value, LENGTHS[state.vehicle.unit]) ?? 0;
  return { ...item, position: item.position.map((old, n) => (n === Number(axis) ? length : old)) };
}
