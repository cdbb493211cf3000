// The experiment as JSON (the form of the engine's protocol): what the page changes in it.
// Every function returns a new form; nothing that an experiment file said is lost.

export function newForm() {
  return { name: "my multirotor", airframe: {}, motors: { speed: "measured" },
    configuration: [{ name: "A", flights: [], validation: [] }] };
}

/** The form with every vector forward, left, up: files may have them forward, right, down. */
export function inFlu(form) {
  if (form.airframe?.axes !== "FRD") return form;
  const { axes, ...airframe } = form.airframe;
  const turned = ([x, y, z]) => [x, -y + 0, -z + 0];
  const placed = (one) => ({ ...one, position: turned(one.position), ...(one.axis ? { axis: turned(one.axis) } : {}) });
  if (airframe.rotors) airframe.rotors = airframe.rotors.map(placed);
  if (airframe.imu) airframe.imu = placed(airframe.imu);
  const configuration = form.configuration?.map((one) =>
    (one.payload ? { ...one, payload: one.payload.map(placed) } : one));
  return { ...form, airframe, ...(configuration ? { configuration } : {}) };
}

/** The same with one configuration changed. */
export function withConfiguration(form, index, change) {
  return { ...form, configuration: form.configuration.map((one, i) =>
    i === index ? without({ ...one, ...change }) : one) };
}

/** Leave out what was emptied, so that the engine sees a key only where it says something. */
function without(table) {
  return Object.fromEntries(Object.entries(table).filter(([, value]) => value !== null));
}

/** One more configuration, named by the next letter, for flights with something hung on. */
export function addConfiguration(form) {
  const taken = form.configuration.map((one) => one.name);
  const name = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((letter) => !taken.includes(letter));
  return { ...form, configuration: [...form.configuration,
    { name: name ?? `${taken.length + 1}`, flights: [], validation: [] }] };
}

/** Without a configuration: its flights are no longer used, and nothing is carried beyond it. */
export function removeConfiguration(form, index) {
  const { name } = form.configuration[index];
  return { ...form, configuration: form.configuration.filter((_, i) => i !== index).map((one) =>
    one.payload_of === name ? without({ ...one, payload_of: null, payload: null }) : one) };
}

export function renameConfiguration(form, index, name) {
  const before = form.configuration[index].name;
  const named = withConfiguration(form, index, { name });
  return { ...named, configuration: named.configuration.map((one) =>
    one.payload_of === before ? { ...one, payload_of: name } : one) };
}

/** What a configuration carries beyond another; none at all where the list is empty. */
export function withPayload(form, index, payload) {
  const bare = form.configuration.find((one, i) => i !== index && !one.payload_of);
  const payload_of = payload.length ? form.configuration[index].payload_of ?? bare?.name : null;
  return withConfiguration(form, index, { payload: payload.length ? payload : null, payload_of });
}

/** Every use of a file: in which configuration, for the fit or kept apart. */
export function usesOf(form, file) {
  return form.configuration.flatMap((one, configuration) =>
    ["flights", "validation"].flatMap((role) =>
      (one[role] ?? []).flatMap((entry, index) =>
        entryFile(entry) === file ? [{ configuration, role, index, entry: plain(entry) }] : [])));
}

const plain = (entry) => (typeof entry === "string" ? { file: entry } : entry);
const entryFile = (entry) => plain(entry).file;

/** Files that the form names. */
export function filesOf(form) {
  const all = form.configuration.flatMap((one) => [...(one.flights ?? []), ...(one.validation ?? [])]);
  return [...new Set(all.map(entryFile))];
}

/** Put one use of a file elsewhere; `to` is null where the file is not used there any more. */
export function moveUse(form, use, to) {
  const rest = use ? dropUse(form, use) : form;
  if (!to) return rest;
  const list = rest.configuration[to.configuration][to.role] ?? [];
  return withConfiguration(rest, to.configuration, { [to.role]: [...list, to.entry ?? use.entry] });
}

function dropUse(form, { configuration, role, index }) {
  const list = form.configuration[configuration][role];
  return withConfiguration(form, configuration, { [role]: list.filter((_, i) => i !== index) });
}

/** Change a use in its place: start, end, log. */
export function editUse(form, { configuration, role, index }, change) {
  const list = form.configuration[configuration][role].map((entry, i) =>
    i === index ? without({ ...plain(entry), ...change }) : entry);
  return withConfiguration(form, configuration, { [role]: list });
}

/**
 * The columns of a table: in the one [table] of the experiment, unless another table shares that and this one
 * has another map; then with its own flights.
 */
export function withMap(form, { name, table }, sharers) {
  const { map, poles } = table;
  const same = (other) => JSON.stringify(other) === JSON.stringify(map);
  const own = !same(form.table) && sharers.some((one) => JSON.stringify(one.table.map) === JSON.stringify(form.table));
  const change = own ? { columns: map.columns, axes: map.axes } : { columns: null, axes: null };
  const motors = poles ? { ...form.motors, poles } : form.motors;
  return usesOf(form, name).reduce((found, use) => editUse(found, use, change), own ? { ...form, motors } : { ...form, motors, table: map });
}

export function removeFile(form, file) {
  const keep = (list) => (list ?? []).filter((entry) => entryFile(entry) !== file);
  return { ...form, configuration: form.configuration.map((one) =>
    ({ ...one, flights: keep(one.flights), validation: keep(one.validation) })) };
}

/** What must still be said before anything can be identified: words, and where to say it. */
export function missing(form, { sized, files }) {
  const found = [];
  if (!files.length) found.push({ words: "Drop a flight log.", at: "files" });
  if (!sized) found.push({ words: "Measure the vehicle: type the distance on the drawing.", at: "size-0" });
  form.configuration.forEach((one, i) => {
    if (!one.mass) found.push({ words: `Weigh configuration ${one.name}.`, at: `mass-${i}` });
    if (files.length && !(one.flights ?? []).length) {
      found.push({ words: `Say which flight is of configuration ${one.name}.`, at: "uses" });
    }
  });
  return found;
}
