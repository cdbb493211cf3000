// What came out: parameters with intervals and verdicts, the report, the next flight, the exports.

import { download, h, save } from "./dom.js";
import { Refused } from "./engine.js";
import { askedLong, set, state } from "./state.js";
import { seconds, short } from "./units.js";

export function outcomeView() {
  const { outcome } = state;
  if (!outcome) return h("p", { class: "hint" }, "Parameters, report and exports appear here.");
  return [
    h("p", { class: "lead" }, `${outcome.name}: from ${seconds(outcome.seconds)} in the air.`),
    counts(outcome),
    inShort(outcome),
    remarks("To know", outcome.doubts),
    outcome.tables.filter((one) => !ofEquations(one)).map(table),
    budgets(outcome),
    validation(outcome),
    outcome.tables.filter(ofEquations).map((one) => folded(one.title, table(one))),
    folded("What the verdicts mean", meanings(outcome)),
    folded("What no flight tells: see that it is right", list(outcome.hangs_on)),
    tuned(outcome),
    nextFlight(outcome),
    report(),
    downloads(outcome),
  ];
}

const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
const raised = (digits) => [...digits].map((one) => RAISED[one]).join("");

/** Text of a terminal as in print: ±, powers of ten and of units. */
const typeset = (words) => words.replace(/\+- ?/g, "± ")
  .replace(/\b1e(-?\d+)\b/g, (_, power) => `10${raised(power)}`)
  .replace(/\^(-?\d+)/g, (_, power) => raised(power));

const list = (lines) => h("ul", {}, lines.map((line) => h("li", {}, typeset(line))));

const folded = (title, ...content) => h("details", { class: "section", "data-key": title }, h("summary", {}, title), content);

/** First moments and biases: for those who want the equations, folded. */
const ofEquations = ({ title }) => title.includes(": as the equations");

const verdict = (word, partner) => word
  ? h("span", { class: `verdict ${word}` }, word, partner && h("span", { class: "partner" }, ` with ${partner}`))
  : h("span", { class: "verdict derived" }, "derived");

function counts({ counts: all }) {
  return h("p", { class: "counts" }, all.map(({ verdict: word, count, meaning }) =>
    h("span", { class: "count", title: meaning }, h("b", {}, String(count)), verdict(word))));
}

function inShort({ summary, in_short: doubts, next_step: next }) {
  return [
    summary.map(({ title, lines }) => [
      title && h("h3", {}, title),
      h("table", { class: "pilot" }, h("tbody", {}, lines.map(line))),
    ]),
    h("ul", { class: "findings" }, doubts.map((words) => h("li", { class: "finding doubtful" }, typeset(words))),
      next && h("li", { class: "finding plain" }, h("b", {}, "Next"), ` ${typeset(next)}`)),
  ];
}

function line({ title, parts, remark }) {
  return h("tr", {}, h("th", { scope: "row" }, typeset(title)), h("td", {},
    parts.map(({ words, shown, verdict: word }, i) => [
      i ? ", " : "", words && `${words} `, h("b", {}, shown), word && [" ", verdict(word)]]),
    remark && `${parts.length ? ", " : ""}${typeset(remark)}`));
}

function remarks(title, lines) {
  return lines.length
    ? h("aside", { class: "doubts", "aria-label": title }, h("h3", {}, title), list(lines)) : null;
}

function table({ title, explanation, rows, notes }) {
  return h("div", { class: "parameter-table" },
    h("h3", {}, title), h("p", { class: "explanation" }, explanation),
    h("table", { class: "parameters" },
      h("thead", {}, h("tr", {}, ["Parameter", "Value ± half of its 95 % interval", "Unit"].map((words) =>
        h("th", { scope: "col" }, words)), h("th", { scope: "col" }, h("span", { class: "hidden" }, "Interval")), h("th", { scope: "col" }, "Verdict"))),
      h("tbody", {}, rows.map(row))),
    notes.length ? h("ul", { class: "notes" }, notes.map(note)) : null);
}

function row(one) {
  const { name, title, shown, value, unit, note: mark } = one;
  return h("tr", { "data-name": name, "data-value": value === null ? null : String(value) },
    h("th", { scope: "row" }, title, h("code", {}, name)),
    h("td", { class: "number", title: value === null ? null : String(value) }, shown || "–"),
    h("td", { class: "unit" }, unit),
    h("td", { class: "bar" }, bar(one)),
    h("td", { class: "judged" }, verdict(one.verdict, one.partner), mark ? h("sup", {}, mark) : null));
}

/** The interval drawn as the report draws it: a thin line at zero, a bar, a dot at the value. */
function bar({ value, interval, ends, verdict: word }) {
  if (value === null || !ends) return null;
  const place = (x) => (5 + ((x - ends[0]) / (ends[1] - ends[0])) * 122).toFixed(2);
  const [low, high] = (interval ?? [value, value]).map(place);
  return h("svg", { class: `interval ${word || "plain"}`, viewBox: "0 0 132 18", "aria-hidden": "true" },
    h("path", { class: "track", d: "M5 9H127" }),
    h("path", { class: "zero", d: `M${place(0)} 1V17` }),
    h("rect", { class: "span", x: low, y: 5, width: Math.max(1, high - low), height: 8, rx: 2 }),
    h("circle", { class: "value", cx: place(value), cy: 9, r: 3 }));
}

const LEAST_SHARE = 0.01;

/** Where the intervals come from: shares of each squared half-width side by side, largest first. */
function budgets({ budgets: all, tables }) {
  const parts = new Map((all ?? []).map((one) => [one.name, one.parts]));
  const rows = tables.filter((one) => !ofEquations(one)).flatMap((one) => one.rows)
    .filter((one) => parts.get(one.full_name)?.length);
  return rows.length ? folded("Where the intervals come from",
    h("p", { class: "explanation" }, "Each bar is one interval, parted by what makes it up; the colour says what shrinks a part: ",
      ["fly", "measure", "declare", "log", "repair", "none"].map((one) => [h("span", { class: `term remedy-${one}` }, REMEDIES[one]), " "])),
    h("table", { class: "budgets" }, h("tbody", {}, rows.map((one) => budget(one, parts.get(one.full_name)))))) : null;
}

const REMEDIES = { fly: "a flight", measure: "a ruler or a scale", declare: "the motors' law", log: "a log setting", repair: "the vehicle", none: "nothing" };

function budget({ title, full_name: name }, parts) {
  let left = 0;
  const rects = parts.map(({ share, remedy, words }) => {
    const x = left;
    left += 260 * Math.max(share, 0);
    return h("rect", { class: `term remedy-${remedy}`, x: x.toFixed(2), y: 1, width: (left - x).toFixed(2), height: 14 }, h("title", {}, words));
  });
  const shown = parts.filter(({ share }) => share >= LEAST_SHARE);
  return h("tr", { "data-budget": name }, h("th", { scope: "row" }, title, h("code", {}, name)),
    h("td", {}, h("svg", { class: "budget", viewBox: "0 0 260 16", "aria-hidden": "true" }, rects),
      shown.map(({ words, remedy }, i) => [i ? ", " : "", h("span", { class: `term remedy-${remedy}` }, words)])),
    h("td", { class: "advice" }, parts[0].action));
}

function note({ mark, names, reason, advice }) {
  return h("li", {}, h("sup", {}, mark), " ",
    h("span", { class: "names" }, names.map((name, i) => [i ? ", " : "", h("code", {}, name)])),
    reason && `: ${typeset(reason)}.`, advice && [" ", h("span", { class: "advice" }, typeset(advice))]);
}

function meanings({ tables }) {
  const met = new Set(tables.flatMap(({ rows }) => rows.map((one) => one.verdict)));
  return h("dl", { class: "legend" }, Object.entries(state.options.meanings)
    .filter(([word]) => met.has(word))
    .map(([word, words]) => h("div", {}, h("dt", {}, verdict(word)), h("dd", {}, typeset(words)))));
}

function validation({ validation: flights, validation_predicted_well: worth }) {
  if (!flights.length) return null;
  const axes = Object.keys(flights[0].errors);
  return [
    h("h3", {}, "Flights kept apart"),
    h("p", { class: "explanation" }, `How far the model is off on flights that it has not seen. ${typeset(worth)}`),
    h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Flights kept apart" },
      h("table", { class: "plain" },
        h("thead", {}, h("tr", {}, ["Flight", "Configuration", ...axes].map((words) => h("th", { scope: "col" }, words)))),
        h("tbody", {}, flights.map(({ flight, configuration, errors }) => h("tr", {},
          h("th", { scope: "row" }, flight), h("td", {}, configuration),
          axes.map((axis) => h("td", {}, typeof errors[axis] === "number" ? `${short(100 * errors[axis])} %` : "–"))))))),
  ];
}

function tuned({ loop }) {
  if (!loop) return null;
  const { loopAddress } = state;
  return [
    h("h3", {}, "Is it tuned well?"),
    loop.page
      ? [
        h("p", { class: "explanation" }, `How far the rate loops of ${loop.flight} are from oscillating.`),
        list(loop.words),
        h("div", { class: "deeds" },
          h("button", { type: "button", "data-do": "open-document", "data-name": "loop" }, "Open margins and pictures in a tab")),
        loopAddress && h("iframe", { class: "report", sandbox: "allow-scripts", title: "Margins of the rate loops", "data-key": "loop", src: loopAddress }),
      ]
      : h("p", {}, loop.words.map((words) => `Not judged: ${words}`)),
  ];
}

function report() {
  const { reportAddress } = state;
  return [
    h("h3", {}, "The report"),
    h("p", {}, "A page of its own, to keep and to send: the vehicle to scale, the fit over time, every setting."),
    h("div", { class: "deeds" },
      h("button", { type: "button", "data-do": "show-report", "aria-pressed": String(Boolean(reportAddress)) }, "Show it here"),
      h("button", { type: "button", "data-do": "open-document", "data-name": "report" }, "Open it in a tab")),
    reportAddress && h("iframe", { class: "report", sandbox: "allow-scripts", title: "Report", "data-key": "report", src: reportAddress }),
  ];
}

function nextFlight({ advice }) {
  const { plan } = state;
  return [
    h("h3", {}, "What to fly next"),
    advice.length ? list(advice) : h("p", {}, "Every number is known well: nothing needs to be flown again."),
    h("div", { class: "deeds" },
      h("button", { type: "button", "data-do": "plan" }, "Plan the next flight"),
      plan && h("button", { type: "button", "data-do": "open-document", "data-name": "card" }, "Open the card in a tab, to print")),
    plan && [
      h("iframe", { class: "report", sandbox: "allow-scripts", title: "The next flight", "data-key": "card", src: plan.address }),
      folded("The same in text, with what every flight would tell", h("pre", { tabindex: 0, role: "region", "aria-label": "Plan" }, plan.text)),
    ],
  ];
}

function downloads({ configurations }) {
  const { exports, options } = state;
  const target = options.targets.find((one) => one.target === exports.target) ?? options.targets[0];
  return [
    h("h3", {}, "Take it along"),
    h("div", { class: "deeds" }, [["result", "Result (JSON)"], ["report", "Report (HTML)"], ["experiment", "Experiment file (TOML)"]]
      .map(([name, words]) => h("button", { type: "button", "data-do": "save-document", "data-name": name }, words))),
    h("form", { class: "export card", "data-key": "export", "data-submit": "export" },
      h("label", { class: "field", for: "target" }, "For another tool",
        h("select", { id: "target", "data-change": "target" }, options.targets.map((one) =>
          h("option", { value: one.target, selected: one === target }, `${one.title} (${one.target})`)))),
      configurations.length > 1 && h("label", { class: "field", for: "of" }, "Configuration",
        h("select", { id: "of", "data-change": "of" }, configurations.map((name) =>
          h("option", { value: name, selected: name === exports.of }, name)))),
      (exports.missing ?? []).map(assumption),
      h("button", { type: "submit", id: "export" }, `Download ${target.title}`),
      exports.refusal && h("p", { class: "finding not-identified", role: "alert" }, exports.refusal),
      (exports.notes ?? []).length ? h("div", { class: "notes" }, `In ${exports.file}:`, list(exports.notes)) : null),
  ];
}

/** The flights do not give it: the person may, and the file says that it was assumed. */
function assumption({ name, unit }) {
  return h("label", { class: "field", for: `assume-${name}` }, `${name} is not known from these flights; assume [${unit}]`,
    h("input", { id: `assume-${name}`, name, inputmode: "decimal", autocomplete: "off", required: true,
      value: state.exports.assume?.[name] ?? "" }));
}

const setExports = (change) => set({ exports: { ...state.exports, ...change } });

const FILES = { result: "result.json", report: "report.html", experiment: "experiment.toml" };

export const actions = {
  "show-report": async () => set({ reportAddress: state.reportAddress ? null : await state.engine.open("report") }),
  "open-document": async ({ name }) => window.open(await state.engine.open(name), "_blank", "noopener"),
  "save-document": async ({ name }) => {
    save(FILES[name], await state.engine.open(name));
  },
  plan: async () => {
    const plan = await askedLong("plan", { accuracy: 5 }, "planning the next flight");
    if (plan) set({ plan: { ...plan, address: await state.engine.open("card") } });
  },
  target: (_, { value }) => set({ exports: { target: value, of: state.exports.of } }),
  of: (_, { value }) => setExports({ of: value, missing: null, notes: null, refusal: null }),
  export: async (_, form) => {
    const { options, exports, outcome } = state;
    const assume = Object.fromEntries([...new FormData(form)].map(([name, text]) => [name, Number(text.replace(",", "."))]));
    const target = exports.target ?? options.targets[0].target;
    try {
      const made = await state.engine.call("export",
        { target, configuration: exports.of ?? outcome.configurations[0] ?? null, assume, project: false });
      setExports({ file: made.name, notes: made.notes, refusal: null, assume });
      download(made.name, made.text ?? Uint8Array.from(atob(made.base64), (c) => c.charCodeAt(0)));
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      setExports({ refusal: error.message, missing: error.missing.length ? error.missing : exports.missing, notes: null, assume });
    }
  },
};
