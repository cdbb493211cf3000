// What the page knows, in one place, and what follows when it changes.

import { airframeTable, hasSize, newVehicle, vehicleOf } from "./airframe.js";
import { Refused } from "./engine.js";
import { filesOf, inFlu, newForm } from "./form.js";

const KEPT = "rotorfit drawing";

export const state = {
  engine: null,
  options: null,
  files: [], // FILE of the protocol; `busy` while it is read
  form: newForm(),
  vehicle: newVehicle(),
  view: { turn: 0, mode: "reverse", picked: null, massUnits: {} },
  said: null, // what of the vehicle came from a log, in words
  problems: [],
  judged: null, // the form that the problems are of
  text: null, // the experiment file of the form, null where something is wrong with it
  running: null, // {step, share} of what takes its time
  refusal: null,
  outcome: null,
  plan: null,
  exports: {}, // the chosen target: what is missing, assumed, noted
  reportAddress: null,
  loopAddress: null,
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
  const filled = { ...(form.configuration ? newForm() : state.form), ...inFlu(form) };
  state.vehicle = vehicle ?? (hasAirframe(filled) ? vehicleOf(filled.airframe, state.vehicle.unit) : newVehicle());
  setForm(filled);
}

const hasAirframe = ({ airframe }) => Boolean(airframe?.rotors || airframe?.layout);

/** Ask, once for all changes of a moment, what is wrong with the experiment. */
export function describeSoon() {
  clearTimeout(describing);
  describing = setTimeout(describe, 250);
}

/** Wait until the engine knows the experiment as it is now. */
export async function described() {
  if (describing === null) return;
  clearTimeout(describing);
  await describe();
}

export async function describe() {
  describing = null;
  const { form } = state;
  const answer = await asked("describe", { form });
  if (answer && form === state.form) set({ problems: answer.problems, text: answer.text, judged: form });
}

/** Ask the engine; a refusal is shown in one line, and the answer is null. */
export async function asked(name, argument, options) {
  try {
    return await state.engine.call(name, argument, options);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    const words = error.stopped ? "Stopped: what was there before is still there." : error.message;
    set({ refusal: words, problems: error.problems.length ? error.problems : state.problems });
    return null;
  }
}

/** Ask for what takes its time, with its progress on the page. */
export async function askedLong(name, argument, step) {
  const since = Date.now();
  set({ running: { step, share: null, since }, refusal: null });
  const progress = (met) => set({ running: { ...met, since } });
  try {
    return await asked(name, argument, { progress });
  } finally {
    set({ running: null });
  }
}

/** The address of the page about the rate loops; null where the log does not show them. */
export const loopPage = async (outcome) => (outcome?.loop?.page ? state.engine.open("loop") : null);

/** Take up what was there before a reload. */
export async function restore() {
  const { files, form, outcome, running } = await state.engine.call("restore", {});
  const kept = read();
  state.files = files;
  state.outcome = outcome;
  state.loopAddress = await loopPage(outcome);
  if (kept) Object.assign(state, { view: { ...state.view, ...kept.view, picked: null }, said: kept.said });
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
  const { vehicle, view, said } = state;
  try {
    sessionStorage.setItem(KEPT, JSON.stringify({ vehicle, view, said }));
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
