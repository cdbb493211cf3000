// What the page knows, in one place, and what follows when it changes.

import { airframeTable, hasSize, newVehicle, vehicleOf } from "./airframe.js";
import { Refused } from "./engine.js";
import { filesOf, newForm } from "./form.js";

const KEPT = "rotorfit page";

export const state = {
  engine: null,
  options: null,
  files: [], // FILE of the protocol; `busy` while it is read
  form: newForm(),
  vehicle: newVehicle(),
  view: { turn: 0, mode: "reverse", picked: null, massUnits: {} },
  said: null, // what of the vehicle came from a log, in words
  problems: [],
  running: null, // {step, share} of what takes its time
  refusal: null,
  outcome: null,
  identified: null, // the form that the outcome is of
  plan: null,
  exports: {}, // by target: what is missing, assumed, noted
};

let drawAll = () => {};
let drawing = null;
let describing = null;

/** Have `draw` called after changes, once for all changes of a moment. */
export function drawWith(draw) {
  drawAll = draw;
}

export function changed() {
  drawing ??= setTimeout(() => {
    drawing = null;
    drawAll();
    keep();
  });
}

export function set(change) {
  Object.assign(state, change);
  changed();
}

/** The person changed the experiment: the engine checks and keeps it. */
export function setForm(form) {
  state.form = form;
  describeSoon();
  changed();
}

export function setVehicle(vehicle) {
  state.vehicle = vehicle;
  setForm({ ...state.form, airframe: { ...restOf(state.form.airframe), ...table(vehicle) } });
}

/** Where a length is not typed yet, the key is left out. */
function table(vehicle) {
  if (hasSize(vehicle)) return airframeTable(vehicle);
  return { layout: vehicle.layout, order: vehicle.order };
}

function restOf({ layout, order, arm, spacing, rotors, ...rest }) {
  return rest;
}

/** A form from a file or from before a reload. */
export function fill(form, vehicle = null) {
  const filled = { ...newForm(), ...form };
  if (!form.configuration?.length) filled.configuration = state.form.configuration;
  state.vehicle = vehicle ?? (hasAirframe(filled) ? vehicleOf(filled.airframe, state.vehicle.unit) : newVehicle());
  setForm(filled);
}

const hasAirframe = ({ airframe }) => Boolean(airframe?.rotors || airframe?.layout);

function describeSoon() {
  clearTimeout(describing);
  describing = setTimeout(describe, 250);
}

async function describe() {
  if (state.running) return;
  const { form } = state;
  const answer = await asked("describe", { form });
  if (answer && form === state.form) set({ problems: answer.problems });
}

/** Ask the engine; a refusal is shown in one line, and the answer is null. */
export async function asked(name, argument, options) {
  try {
    return await state.engine.call(name, argument, options);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    set({ refusal: error.message, problems: error.problems ?? state.problems });
    return null;
  }
}

/** Ask for what takes its time, with its progress on the page. */
export async function askedLong(name, argument, step) {
  set({ running: { step, share: null, since: Date.now() }, refusal: null });
  const since = Date.now();
  const progress = (met) => set({ running: { ...met, since } });
  try {
    return await asked(name, argument, { progress });
  } finally {
    set({ running: null });
  }
}

/** Take up what was there before a reload. */
export async function restore() {
  const { files, form, outcome, running } = await state.engine.call("restore", {});
  const kept = read();
  state.files = files;
  state.outcome = outcome;
  if (kept) Object.assign(state, { view: { ...state.view, ...kept.view, picked: null }, said: kept.said });
  state.identified = kept?.identified ?? null;
  if (form) fill(form, sameVehicle(kept?.vehicle, form.airframe));
  changed();
  return running;
}

/** The kept drawing, with its units and clicks, where it says what the form says. */
function sameVehicle(vehicle, airframe) {
  if (!vehicle) return null;
  const told = Object.entries(table(vehicle));
  return told.every(([key, value]) => JSON.stringify(airframe[key]) === JSON.stringify(value))
    ? vehicle : null;
}

/** Units, the turned drawing and clicks are the page's own: the browser keeps them. */
function keep() {
  const { vehicle, view, said, identified } = state;
  try {
    sessionStorage.setItem(KEPT, JSON.stringify({ vehicle, view, said, identified }));
  } catch {
    // Without storage the page works all the same.
  }
}

function read() {
  try {
    return JSON.parse(sessionStorage.getItem(KEPT));
  } catch {
    return null;
  }
}

export const logs = () => state.files.filter((file) => file.kind === "log");

/** Files that the experiment names and nobody has dropped yet. */
export const awaited = () => {
  const there = state.files.map((file) => file.name);
  return filesOf(state.form).filter((name) => !there.includes(name));
};
