// The engine in a web worker: Python from Pyodide, rotorfit beside it, the calls of protocol.md by message.

let bridge = null;
let before = Promise.resolve();

self.onmessage = ({ data }) => {
  before = before.then(() => answered(data));
};

async function answered({ id, name, argument, buffer }) {
  const progress = (step, share) =>
    self.postMessage({ id, progress: { step, share: share ?? null } });
  let answer;
  try {
    answer = name === "start" ? await start(argument, progress) : called(name, argument, progress, buffer);
  } catch (error) {
    answer = { refused: `internal error (${lastLine(error)}); please report it with the log` };
  }
  self.postMessage({ id, answer });
}

// `pyodide`: the folder of its files; `packages`: of its distribution; `archives`: ours, unpacked beside them.
async function start({ pyodide: folder, packages, archives }, progress) {
  if (folder === null) {
    return { refused: "this site was built without Pyodide: install rotorfit and run rotorfit app" };
  }
  const base = new URL(folder, self.location.href).href;
  progress("loading Python", null);
  self.importScripts(`${base}pyodide.js`);
  const pyodide = await self.loadPyodide({ indexURL: base });
  for (const [i, name] of packages.entries()) {
    progress(`loading ${name}`, i / packages.length);
    await pyodide.loadPackage(name, { messageCallback: () => {} });
  }
  for (const archive of archives) {
    progress("loading rotorfit", null);
    const bytes = await (await fetch(archive)).arrayBuffer();
    const place = pyodide.runPython("import sysconfig; sysconfig.get_paths()['purelib']");
    pyodide.unpackArchive(bytes, "zip", { extractDir: place });
  }
  pyodide.runPython("import importlib; importlib.invalidate_caches()");
  progress("starting", null);
  bridge = pyodide.pyimport("rotorfit.app.in_browser");
  return {};
}

function called(name, argument, progress, buffer) {
  const sent = buffer === undefined ? undefined : new Uint8Array(buffer);
  return JSON.parse(bridge.call(name, JSON.stringify(argument), progress, sent));
}

function lastLine(error) {
  return String(error.message ?? error).trim().split("\n").at(-1);
}
