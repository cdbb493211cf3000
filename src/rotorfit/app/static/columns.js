// The columns of a table with names of its own: proposed, seen by three of their values, changed by hand.

import { h } from "./dom.js";

const AXES = { FLU: "forward, left, up (z up)", FRD: "forward, right, down (z down)" };

const UNIT_WORDS = { 1: "of full, 0 to 1", "%": "% of full", us: "us (pulse width)", counts: "counts (8 to 16 bits)" };
const unitWords = (unit) => UNIT_WORDS[unit] ?? unit;

/** The map of a table's columns, open as long as somebody should look at it. */
export function columnsView(file) {
  const { table } = file;
  const known = table.map && !table.doubts.length && !table.unused.length && table.reasons.length === 1;
  return h("details", { class: "section columns", "data-key": "columns", open: !known },
    h("summary", {}, "Columns of the table ", h("span", { class: "soft" }, state(table))),
    table.refused && h("p", { class: "finding not-identified", role: "alert" }, table.refused),
    table.questions.map((question) => questionView(file, question)),
    table.asks_poles ? polesView(file) : null,
    table.doubts.map((words) => h("p", { class: "finding weak" }, `Check: ${words}`)),
    table.reasons.length ? h("ul", {}, table.reasons.map((words) => h("li", {}, words))) : null,
    table.axes && axesView(file),
    h("div", { class: "scroll" }, rowsView(file)),
    table.unused.length ? h("p", { class: "hint" }, `Not used: ${few(table.unused)}`) : null,
    h("p", {}, h("button", { type: "button", class: "small", "data-do": "propose-again", "data-name": file.name },
      "Back to what rotorfit proposes")));
}

const few = (names) => names.slice(0, 12).join(", ") + (names.length > 12 ? ` and ${names.length - 12} more` : "");

function state({ map, refused, questions, rows }) {
  if (refused) return "(name what is missing)";
  if (questions.length) return `(${questions.length} to answer)`;
  return map ? `(${rows.length}: compare them)` : "(one to answer)";
}

function questionView(file, { channel, words, choices }) {
  return h("label", { class: "field" }, `${words}: neither names nor values tell`,
    h("select", { id: `unit-of-${channel}`, "data-change": "table-unit", "data-name": file.name, "data-channel": channel },
      h("option", { value: "", selected: true }, "choose"),
      choices.map((unit) => h("option", { value: unit }, unitWords(unit)))));
}

function polesView(file) {
  return h("label", { class: "field" }, "Magnets of a motor's bell, for erpm (often 14)",
    h("input", { id: "poles", inputmode: "numeric", autocomplete: "off", value: file.table.poles ?? "",
      "data-change": "table-poles", "data-name": file.name }));
}

function axesView(file) {
  return h("label", { class: "field" }, "Axes of the body",
    h("select", { id: "table-axes", "data-change": "table-axes", "data-name": file.name },
      Object.entries(AXES).map(([value, words]) =>
        h("option", { value, selected: value === file.table.axes }, `${value}: ${words}`))));
}

function rowsView(file) {
  return h("table", { class: "mapped" },
    h("thead", {}, h("tr", {}, ["What", "Column", "Unit", "First, middle, last row"].map((words) => h("th", { scope: "col" }, words)))),
    h("tbody", {}, file.table.rows.map((row) => rowView(file, row))));
}

function rowView(file, row) {
  const { is, title, unit, scale, range, preview } = row;
  const more = [scale !== 1 && `times ${Number(scale.toPrecision(6))}`, range && `${range[0]} to ${range[1]} is stop to full`];
  return h("tr", { "data-key": `row-${is}`, "data-is": is },
    h("th", { scope: "row" }, title, " ", h("code", {}, is)),
    h("td", {}, columnSelect(file, row)),
    h("td", {}, row.units.length > 1 ? unitSelect(file, row) : row.units.length ? unitWords(unit) : null,
      more.filter(Boolean).map((words) => h("span", { class: "hint" }, ` ${words}`))),
    h("td", { class: "preview" }, preview.map((value) => h("span", {}, value))));
}

function columnSelect(file, { is, title, column, optional }) {
  return h("select", { id: `column-${is}`, "aria-label": `Column of ${title}`, "data-change": "table-column",
    "data-name": file.name, "data-is": is },
    (optional || !column) && h("option", { value: "", selected: !column }, column ? "leave out" : "choose"),
    file.table.names.map((name) => h("option", { value: name, selected: name === column }, name)));
}

function unitSelect(file, { is, title, channel, unit, units }) {
  return h("select", { id: `unit-${is}`, "aria-label": `Unit of ${title}`, "data-change": "table-unit",
    "data-name": file.name, "data-channel": channel },
    !unit && h("option", { value: "", selected: true }, "by its values"),
    units.map((one) => h("option", { value: one, selected: one === unit }, unitWords(one))));
}

/** What the engine is to be asked when a column is named: its whole channel, in the unit shown. */
export function columnReplies({ rows, replies }, is, column) {
  const { channel, unit } = rows.find((row) => row.is === is);
  const own = rows.filter((row) => row.channel === channel);
  const kept = Object.fromEntries(Object.entries(replies.named).filter(([name]) => !own.some((row) => row.is === name)));
  if (!column) return { ...replies, named: { ...kept, [is]: "" } };
  const named = Object.fromEntries(own.map((row) => [row.is, row.is === is ? column : row.column]).filter(([, name]) => name));
  const stated = ["rotor", "command"].includes(channel) ? "motors" : channel;
  const units = unit && own[0].units.length > 1 ? { ...replies.units, [stated]: unit } : replies.units;
  return { ...replies, named: { ...kept, ...named }, units };
}

export const unitReplies = ({ replies }, channel, unit) => ({ ...replies, units: { ...replies.units, [channel]: unit } });
