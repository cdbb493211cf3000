// Logs: dropped, looked at, removed.

import { LAYOUT_WORDS, ORDER_WORDS, relaid, reverseAll, vehicleOf } from "./airframe.js";
import { columnReplies, columnsView, unitReplies } from "./columns.js";
import { h } from "./dom.js";
import { Refused } from "./engine.js";
import { editUse, inFlu, moveUse, removeFile, usesOf, withMap } from "./form.js";
import { asked, askedLong, awaited, changed, describeSoon, described, fill, set, setForm, setVehicle, state } from "./state.js";
import { bytes, seconds } from "./units.js";

const LEVELS = { good: "identified", fair: "weak", poor: "not-identified" };

/** Read files one after another; each shows what it is as soon as it is read. */
export async function addFiles(files) {
  const waiting = [...files].map((file) => ({ name: file.name, bytes: file.size, busy: true, file }));
  set({ files: [...state.files, ...waiting], refusal: null });
  for (const one of waiting) {
    await described(); // a table is read by the columns that a file before it names
    await addFile(one);
  }
}

async function addFile(waiting) {
  const most = state.options.most_bytes;
  if (state.files.reduce((sum, one) => sum + one.bytes, 0) > most) {
    const hint = state.engine.kind === "server" ? ", or start rotorfit app with a larger --limit" : "";
    const words = `${waiting.name}: with it the files hold over ${bytes(most)}; remove others${hint}`;
    return replace(waiting, refused(waiting, new Refused({ refused: words })));
  }
  const progress = ({ step, share }) => {
    Object.assign(waiting, { step, share });
    changed();
  };
  const read = await state.engine.call("add_file", { name: waiting.name }, { bytes: waiting.file, progress })
    .catch((error) => refused(waiting, error));
  if (!state.files.includes(waiting)) return null; // removed while it was read
  replace(waiting, read);
  return read.gone ? null : take(read);
}

/** A file that the engine did not even take stays on the page with its reason. */
function refused({ name, bytes: size }, error) {
  if (!(error instanceof Refused)) throw error;
  return { name, bytes: size, kind: "other", logs: [], words: [error.message], gone: true };
}

function replace(old, file) {
  const files = state.files.filter((one) => one === old || one.name !== file.name);
  set({ files: files.map((one) => (one === old ? file : one)) });
  describeSoon();
}

async function take(file) {
  if (file.form) {
    fill(file.form);
    set({ said: `Filled in from ${file.name}.` });
    await described();
    for (const one of state.files.filter(({ table }) => table)) await lookAgain(one, null);
  } else if (file.findings) useLog(file);
}

/** Which of several logs in a file the findings are of: "2 of 3" is the second. */
const chosenLog = ({ findings }) => (findings ? parseInt(findings.log, 10) : null);

/** A log's findings are there: use it for the first configuration, and take what it tells. */
function useLog(file) {
  if (file.table?.map) setForm(withMap(state.form, file, sharers(file)));
  const entry = { file: file.name, ...(file.logs.length ? { log: chosenLog(file) } : {}) };
  if (!usesOf(state.form, file.name).length && file.findings.verdict.level !== "poor") {
    setForm(moveUse(state.form, null, { configuration: 0, role: "flights", entry }));
    if (file.table?.map) setForm(withMap(state.form, file, sharers(file)));
  }
  if (!state.vehicle.touched) takeGuess(file);
}

/** The other tables of the page: the map that they share is not changed for one of them. */
const sharers = ({ name }) => state.files.filter((one) => one.name !== name && one.table?.map);

/** Read a table by other columns; null: by those of the experiment, else as proposed. */
async function lookAgain(file, columns) {
  if (columns) replace(file, { ...file, table: { ...file.table, replies: columns } });
  const read = await askedLong("look", { name: file.name, columns }, `reading ${file.name}`);
  const old = state.files.find((one) => one.name === file.name);
  if (!read || !old) return;
  replace(old, read);
  if (!read.findings) return;
  useLog(read);
  const { speed } = read.findings.guess;
  if (speed) setForm({ ...state.form, motors: { ...state.form.motors, speed } });
}

/** The columns chosen so far are shown, and kept for the next change, before the engine has read them. */
function replaced(file, rows) {
  const next = { ...file, table: { ...file.table, rows } };
  replace(file, next);
  return next;
}

const fileNamed = (name) => state.files.find((one) => one.name === name);

/** Fill in what the log, or the flight itself, tells of the vehicle, and say so. */
export function takeGuess({ name, findings }) {
  const { guess } = findings;
  if (guess.speed) state.form = { ...state.form, motors: { ...state.form.motors, speed: guess.speed } };
  if (guess.imu) state.form = { ...state.form, airframe: { ...state.form.airframe, imu: { position: guess.imu } } };
  const vehicle = guessedVehicle(guess);
  if (vehicle) setVehicle({ ...vehicle, touched: false });
  set({ said: guessWords(name, findings) });
}

/** The vehicle that a log tells, its size as it was typed; null where the log tells none. */
export function guessedVehicle({ airframe, airframe_is, layout, order, reversed }) {
  if (airframe && airframe_is === "set") return vehicleOf(inFlu({ airframe }).airframe, state.vehicle.unit);
  if (!layout && !order) return null;
  const vehicle = relaid(state.vehicle, layout ?? "quad-x", order);
  return reversed ? reverseAll(vehicle) : vehicle;
}

export function guessWords(name, { guess, rotors }) {
  const speed = { measured: "measured rotor speed", commanded: "motor commands, no measured speed" }[guess.speed];
  const motors = rotors ? `${rotors} motors${speed ? `, ${speed}` : ""}. ` : "";
  const spins = guess.reversed ? ", every spin reversed (props out)" : "";
  let shape = "Nothing in it tells the layout: look at your vehicle.";
  if (guess.airframe && guess.airframe_is === "set") shape = "The places of the motors are those set in the autopilot.";
  else if (guess.borne_out) {
    shape = `In flight each motor turns the vehicle as in ${LAYOUT_WORDS[guess.layout]} with the motor order of `
      + `${ORDER_WORDS[guess.order]}${spins}. Measure its size: no flight tells it.`;
  }
  else if (guess.order) shape = `Such logs usually have the motor order of ${ORDER_WORDS[guess.order]}${guess.layout ? ` (${LAYOUT_WORDS[guess.layout]})` : ""}; compare it with your vehicle.`;
  return `${name}: ${motors}${shape}`;
}

export function logsView() {
  return [
    h("ul", { class: "files" }, state.files.map(fileCard)),
    awaited().map((name) => h("p", { class: "finding weak" },
      h("b", {}, name), " is named by the experiment file: drop it, too.")),
  ];
}

function fileCard(file) {
  return h("li", { class: `file ${file.kind ?? "busy"}`, "data-key": file.name },
    h("div", { class: "file-head" },
      h("h3", {}, file.name),
      h("span", { class: "facts" }, facts(file)),
      h("button", { type: "button", class: "quiet", "data-do": "remove-file", "data-name": file.name,
        "aria-label": `Remove ${file.name}` }, "Remove")),
    file.busy ? reading(file) : fileBody(file));
}

function facts({ findings, bytes: size }) {
  const flown = findings?.airborne.reduce((sum, [start, end]) => sum + end - start, 0);
  return [
    findings?.format,
    findings && `${seconds(findings.seconds)} long`,
    findings && (flown ? `${seconds(flown)} in the air` : "no flight found"),
    bytes(size),
  ].filter(Boolean).join(" · ");
}

function reading({ step, share }) {
  return h("p", { class: "reading" },
    h("progress", { max: 1, value: share ?? null, "aria-label": "Reading" }), step ?? "waits its turn");
}

function fileBody(file) {
  const plain = file.kind === "other" ? "not-identified" : "plain";
  return [
    // What an experiment file names is asked for below, as long as it is not there.
    (file.form ? ["It fills the page."] : file.words).map((words) => h("p", { class: `finding ${plain}`, role: file.kind === "other" ? "alert" : null }, words)),
    file.kind === "result" && h("p", {}, h("button", { type: "button", class: "small", "data-do": "take-law", "data-name": file.name },
      "Take the motors' law and lag from it")),
    file.logs.length ? logChoice(file) : null,
    file.table ? columnsView(file) : null,
    file.findings ? findingsView(file) : null,
  ];
}

/** Some files hold a log for every time that the vehicle was armed. */
function logChoice(file) {
  return h("label", { class: "field" }, "This file holds several logs; use",
    h("select", { "data-change": "choose-log", "data-name": file.name },
      h("option", { value: "", selected: !file.findings }, "choose one"),
      file.logs.map(({ number, words }) =>
        h("option", { value: number, selected: chosenLog(file) === number }, `${number}: ${words}`))));
}

/** The verdict on top, what to know and to change open, the rest folded. */
function findingsView(file) {
  const { verdict, sections } = file.findings;
  const first = sections.filter(({ title }) => ["To know", "Settings to change"].includes(title));
  const rest = sections.filter((one) => !first.includes(one));
  return [
    h("p", { class: `finding ${LEVELS[verdict.level]}` }, h("b", {}, verdict.words)),
    first.map((one) => folded(one, { open: one.title === "To know" })),
    rest.map((one) => folded(one, { open: false })),
    h("p", { class: "links" },
      h("button", { type: "button", class: "link", "data-do": "open-findings", "data-name": file.name },
        "Open the log's own page, with pictures")),
  ];
}

function folded({ title, words }, { open }) {
  return h("details", { class: "section", "data-key": title, open },
    h("summary", {}, `${title} `, h("span", { class: "soft" }, `(${words.length})`)),
    h("ul", {}, words.map((line) => h("li", {}, line))));
}

export const actions = {
  example: async () => {
    const read = await askedLong("example", {}, "flying an example");
    if (!read) return;
    set({ files: [...state.files, ...read.files] });
    fill(read.form);
    set({ said: "A simulated flight: its truth is known, and the page is filled in. Look around, then identify." });
  },
  "remove-file": async ({ name }) => {
    const file = state.files.find((one) => one.name === name);
    set({ files: state.files.filter((one) => one !== file), said: state.said?.startsWith(`${name}:`) ? null : state.said });
    setForm(removeFile(state.form, name));
    if (!file.gone) await asked("remove_file", { name });
  },
  "take-law": ({ name }) => {
    setForm({ ...state.form, motors: { speed: "commanded", result: name } });
    set({ said: `The motors' law and lag are those of ${name}.` });
  },
  "table-column": ({ name, is }, { value }) => {
    const file = fileNamed(name);
    const rows = file.table.rows.map((row) => (row.is === is ? { ...row, column: value || null } : row));
    return lookAgain(replaced(file, rows), columnReplies(file.table, is, value));
  },
  "table-unit": ({ name, channel }, { value }) => value && lookAgain(fileNamed(name), unitReplies(fileNamed(name).table, channel, value)),
  "table-axes": ({ name }, { value }) => lookAgain(fileNamed(name), { ...fileNamed(name).table.replies, axes: value }),
  "table-poles": ({ name }, { value }) => lookAgain(fileNamed(name), { ...fileNamed(name).table.replies, poles: Number(value) || null }),
  "propose-again": ({ name }) => lookAgain(fileNamed(name), {}),
  "open-findings": async ({ name }) =>
    window.open(await state.engine.open("findings", { name }), "_blank", "noopener"),
  "choose-log": async ({ name }, control) => {
    const log = Number(control.value);
    if (!log) return;
    const old = state.files.find((one) => one.name === name);
    const read = await asked("look", { name, log });
    if (!read) return;
    replace(old, read);
    if (read.findings) useLog(read);
    for (const use of usesOf(state.form, name)) setForm(editUse(state.form, use, { log }));
  },
};
