// The engine behind the page: a server on this computer, or a web worker that runs the package here.
// Both answer the calls of protocol.md in the same way.

export class Refused extends Error {
  // One line for the user; of some calls also what is wrong where, and what is missing.
  constructor(answer) {
    super(answer.refused);
    this.name = "Refused";
    this.problems = answer.problems ?? [];
    this.missing = answer.missing ?? [];
    this.stopped = answer.stopped === true;
  }
}

export async function connect(told = () => {}) {
  const { engine, ...where } = await (await fetch("engine.json")).json();
  return engine === "worker" ? startWorker(where, told) : openServer();
}

function checked(answer) {
  if (answer.refused !== undefined) throw new Refused(answer);
  return answer;
}

// The server on this computer.

const KEY = "rotorfit page";

class Server {
  kind = "server";
  lost = () => {};
  #page;
  #open = true;

  constructor(page) {
    this.#page = page;
    this.#stay();
  }

  async call(name, argument = {}, { progress = () => {}, bytes } = {}) {
    const address = this.#address(name);
    const answer =
      name === "add_file"
        ? await this.#send(`${address}?name=${encodeURIComponent(argument.name)}`, bytes, progress)
        : await this.#send(address, JSON.stringify(argument), progress);
    return checked(answer);
  }

  async stop() {
    await this.#send(this.#address("stop"), "{}", () => {});
  }

  async open(kind, { name } = {}) {
    const query = name === undefined ? "" : `?name=${encodeURIComponent(name)}`;
    return this.#address(`document/${kind}${query}`);
  }

  #address(rest) {
    return `page/${this.#page}/${rest}`;
  }

  async #send(address, body, progress) {
    const reply = await fetch(address, { method: "POST", body }).catch(() => null);
    if (reply === null) {
      return { refused: "the server does not answer: has rotorfit app been ended? Start it again" };
    }
    if (!reply.headers.get("content-type")?.includes("ndjson")) return reply.json();
    return lastLine(reply.body, progress);
  }

  // The server keeps what the page did for as long as this request is open.
  async #stay() {
    while (this.#open) {
      const reply = await fetch(this.#address("present")).catch(() => null);
      if (reply?.ok) {
        await reply.body.pipeTo(new WritableStream()).catch(() => {});
        await after(500);
        continue;
      }
      this.#open = false;
      this.lost("The server has ended: start rotorfit app again.");
    }
  }
}

async function openServer() {
  const page = sessionStorage.getItem(KEY);
  const reply = await fetch("open", { method: "POST", body: JSON.stringify({ page }) });
  const answer = checked(await reply.json());
  sessionStorage.setItem(KEY, answer.page);
  return new Server(answer.page);
}

// Progress comes line by line, the answer last.
async function lastLine(body, progress) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  let answer = { refused: "the server has ended before it was done: start rotorfit app again" };
  for (;;) {
    const { value, done } = await reader.read().catch(() => ({ done: true }));
    if (done) return answer;
    const lines = (text + value).split("\n");
    text = lines.pop();
    for (const line of lines) {
      const said = JSON.parse(line);
      if (said.answer === undefined) progress(said.progress);
      else answer = said.answer;
    }
  }
}

function after(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

// The package in the browser itself.

class InBrowser {
  kind = "worker";
  lost = () => {};
  #where;
  #told;
  #worker;
  #calls = new Map();
  #files = new Map();
  #next = 0;

  constructor(where, told) {
    this.#where = where;
    this.#told = told;
  }

  async start() {
    this.#worker = new Worker("worker.js");
    this.#worker.onmessage = ({ data }) => this.#heard(data);
    this.#worker.onerror = (error) => this.#endAll({ refused: `the engine has ended: ${error.message}` });
    await this.#ask("start", this.#where, { progress: ({ step, share }) => this.#told(step, share) });
    return this;
  }

  async call(name, argument = {}, { progress = () => {}, bytes } = {}) {
    const buffer = bytes === undefined ? undefined : await bytes.arrayBuffer();
    const answer = await this.#ask(name, argument, { progress, buffer });
    if (name === "add_file") this.#files.set(answer.name, bytes);
    if (name === "remove_file") this.#files.delete(argument.name);
    return answer;
  }

  // Python in a worker listens to nobody while it works: a new one takes its place, with the same files.
  async stop() {
    this.#worker.terminate();
    this.#endAll({ refused: "stopped", stopped: true });
    await this.start();
    const files = [...this.#files];
    this.#files.clear();
    for (const [name, bytes] of files) await this.call("add_file", { name }, { bytes });
  }

  async open(kind, { name } = {}) {
    const { text, type } = await this.#ask("document", { kind, name });
    return URL.createObjectURL(new Blob([text], { type }));
  }

  #ask(name, argument, { progress = () => {}, buffer } = {}) {
    const id = this.#next++;
    return new Promise((resolve, reject) => {
      this.#calls.set(id, { resolve, reject, progress });
      this.#worker.postMessage({ id, name, argument, buffer }, buffer ? [buffer] : []);
    });
  }

  #heard({ id, progress, answer }) {
    const call = this.#calls.get(id);
    if (progress !== undefined) call?.progress(progress);
    if (answer !== undefined) this.#end(id, answer);
  }

  #end(id, answer) {
    const call = this.#calls.get(id);
    this.#calls.delete(id);
    if (answer.refused === undefined) call?.resolve(answer);
    else call?.reject(new Refused(answer));
  }

  #endAll(answer) {
    for (const id of [...this.#calls.keys()]) this.#end(id, answer);
  }
}

async function startWorker(where, told) {
  return new InBrowser(where, told).start();
}
