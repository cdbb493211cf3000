// Identify: what is still missing, progress, Stop.

import { hasSize } from "./airframe.js";
import { download, h } from "./dom.js";
import { missing } from "./form.js";
import { asked, askedLong, describe, logs, loopPage, set, state } from "./state.js";
import { seconds } from "./units.js";

export function identifyView() {
  const lacking = lacks();
  const problems = lacking.length || state.judged !== state.form ? [] : state.problems;
  return [
    lacking.length ? h("div", { class: "todo" }, h("p", {}, "Still to do:"),
      h("ul", {}, lacking.map(({ words, at }) => h("li", {},
        h("button", { type: "button", class: "link", "data-do": "go", "data-at": at }, words))))) : null,
    problems.map(({ words }) => h("p", { class: "finding weak" }, words)),
    h("div", { class: "deeds", "data-key": "deeds" },
      h("button", { type: "button", class: "primary", id: "identify", "data-do": "identify",
        "aria-disabled": String(Boolean(lacking.length || state.running)) }, "Identify"),
      h("button", { type: "button", "data-do": "save-experiment", "aria-disabled": String(Boolean(lacking.length || problems.length)) },
        "Download the experiment file")),
    state.refusal && h("p", { class: "finding not-identified", role: "alert", id: "refusal" }, state.refusal),
    stale() && h("p", { class: "finding weak" }, "The page has changed since the result below: identify again."),
  ];
}

const usable = () => logs().filter(({ findings }) => findings?.usable);

const lacks = () => missing(state.form, { sized: hasSize(state.vehicle), files: usable() });

/** Which steps are done: ticked in the list of steps. */
export const done = () => {
  const open = lacks().map(({ at }) => at);
  return {
    logs: usable().length > 0,
    vehicle: hasSize(state.vehicle),
    flights: !open.some((at) => at === "uses" || at.startsWith("mass-")),
    identification: Boolean(state.outcome) && !stale(),
  };
};

/** The experiment is another one than that of the result. */
const stale = () => state.outcome && state.text && state.text !== state.outcome.experiment;

/** What takes its time, at the foot of the window wherever one is on the page. */
export function runningView() {
  if (!state.running) return null;
  const { step, share, since } = state.running;
  return h("div", { class: "running" },
    h("progress", { max: 1, value: share, "aria-label": "Progress" }),
    h("span", { class: "step" }, `${step}${share === null ? "" : ` (${Math.round(100 * share)} %)`}`),
    h("span", { class: "elapsed" }, since ? seconds((Date.now() - since) / 1e3) : ""),
    h("button", { type: "button", id: "stop", "data-do": "stop" }, "Stop"));
}

async function outcomeOf(call, argument) {
  const outcome = await askedLong(call, argument, "waits its turn");
  if (!outcome) return;
  const loopAddress = await loopPage(outcome);
  set({ outcome, loopAddress, plan: null, exports: {}, reportAddress: null });
  describe();
  setTimeout(() => actions.go({ at: "outcome" }), 50);
}

/** Take part again in what runs since before a reload. */
export const follow = () => outcomeOf("follow", {});

export const actions = {
  identify: () => {
    const [first] = lacks();
    if (first) return actions.go({ at: first.at });
    return state.running ? null : outcomeOf("identify", { form: state.form });
  },
  stop: async () => {
    document.getElementById("identify").focus({ preventScroll: true }); // the button goes away
    await state.engine.stop();
  },
  go: ({ at }) => {
    const there = document.getElementById(at);
    there?.focus({ preventScroll: true });
    there?.scrollIntoView({ block: at === "outcome" ? "start" : "center", behavior: "smooth" });
  },
  "save-experiment": async () => {
    const answer = await asked("describe", { form: state.form });
    if (answer?.text) download("experiment.toml", answer.text, "application/toml");
    else if (answer) set({ problems: answer.problems });
  },
};
