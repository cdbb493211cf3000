// The page: draws what is known, hands every click and change to the section that it is of.

import { setLayouts } from "./airframe.js";
import { h, morph } from "./dom.js";
import { connect, Refused } from "./engine.js";
import * as flights from "./flights.js";
import * as identify from "./identify.js";
import * as logs from "./logs.js";
import * as outcome from "./outcome.js";
import { changed, drawWith, restore, state } from "./state.js";
import * as vehicle from "./vehicle.js";

const views = { logs: logs.logsView, vehicle: vehicle.vehicleView, flights: flights.flightsView,
  identify: identify.identifyView, running: identify.runningView, outcome: outcome.outcomeView };
const actions = { ...logs.actions, ...vehicle.actions, ...flights.actions, ...identify.actions, ...outcome.actions };

function draw() {
  const section = document.activeElement?.closest("section");
  for (const [name, view] of Object.entries(views)) {
    morph(document.getElementById(`${name}-view`), h("div", {}, view()));
  }
  // The button that was pressed may be gone: whoever has no mouse goes on where it was.
  if (section && document.activeElement === document.body) section.focus({ preventScroll: true });
  for (const [name, ready] of Object.entries(identify.done())) {
    document.querySelector(`nav a[href="#${name}"]`).classList.toggle("done", ready);
  }
  announce();
}

let told = "";

/** Say to screen readers what changed by itself; a share of progress only in words. */
function announce() {
  const reading = state.files.find((file) => file.busy);
  const words = state.running?.step ?? (reading ? `reading ${reading.name}` : state.outcome ? "The result is there." : "");
  if (words !== told) document.getElementById("told").textContent = told = words;
}

/** One listener a kind: elements say by data-do, data-change and data-submit what they are for. */
function listen() {
  document.addEventListener("click", (event) => act(event, "do"));
  document.addEventListener("change", (event) => act(event, "change"));
  document.addEventListener("submit", (event) => {
    event.preventDefault();
    act(event, "submit");
  });
  document.addEventListener("keydown", (event) => {
    // Motors of the drawing are buttons, but SVG does not know what Enter does to those.
    if (event.target.closest?.("svg [data-do]") && ["Enter", " "].includes(event.key)) {
      event.preventDefault();
      act(event, "do");
    }
  });
}

function act(event, kind) {
  const element = event.target.closest?.(`[data-${kind}]`);
  if (element) actions[element.dataset[kind]]?.(element.dataset, element);
}

/** Files may be dropped anywhere on the page. */
function listenToDrops() {
  const zone = document.getElementById("drop");
  const over = (event, here) => {
    if (![...event.dataTransfer.types].includes("Files")) return;
    event.preventDefault();
    zone.classList.toggle("over", here);
  };
  document.addEventListener("dragover", (event) => over(event, true));
  document.addEventListener("dragleave", (event) => over(event, Boolean(event.relatedTarget)));
  document.addEventListener("drop", (event) => {
    over(event, false);
    logs.addFiles(event.dataTransfer.files);
  });
  const chooser = document.getElementById("files");
  chooser.addEventListener("change", async () => {
    const files = [...chooser.files];
    chooser.value = "";
    await logs.addFiles(files);
  });
}

async function start() {
  state.engine = await connect(loading);
  state.engine.lost = fail;
  state.options = await state.engine.call("options", {});
  setLayouts(state.options.layouts);
  drawWith(draw);
  listen();
  listenToDrops();
  const running = await restore();
  setInterval(() => state.running && changed(), 1000); // the seconds that it takes go on
  document.documentElement.dataset.ready = "";
  if (running) await identify.follow();
}

/** The engine in the browser takes its time to come. */
function loading(step, share) {
  const [bar, words] = document.getElementById("loading").children;
  words.textContent = step;
  if (share !== null) bar.value = share;
}

function fail(words) {
  document.getElementById("failed").textContent = words;
}

start().catch((error) => {
  document.getElementById("loading").remove();
  if (error instanceof Refused) return fail(error.message);
  fail(`The page cannot start: ${error.message}. Load it again.`);
  throw error;
});
