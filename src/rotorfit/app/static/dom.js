// Elements from data, and a page that follows them without losing focus or what is being typed.

const SVG = "http://www.w3.org/2000/svg";
const DRAWN = new Set(["svg", "g", "path", "circle", "rect", "text", "polygon", "line", "title"]);

/** An element with attributes (null and false leave one out) and children (null is no child). */
export function h(name, attributes = {}, ...children) {
  const element = DRAWN.has(name)
    ? document.createElementNS(SVG, name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(key, value === true ? "" : String(value));
    }
  }
  for (const child of children.flat(Infinity)) {
    if (child !== null && child !== undefined && child !== false) element.append(child);
  }
  return element;
}

/**
 * Make `old` hold what `wanted` holds. What is there already stays, with its focus: an element with an
 * id or a data-key wherever it stands, another one where it is of the same kind.
 */
export function morph(old, wanted) {
  let at = old.firstChild;
  for (const node of [...wanted.childNodes]) {
    const met = matching(at, node);
    if (!met) {
      old.insertBefore(node, at);
      continue;
    }
    while (at !== met) at = removed(at);
    at = met.nextSibling;
    if (met.nodeType === Node.TEXT_NODE) setText(met, node);
    else morphElement(met, node);
  }
  while (at) at = removed(at);
}

function matching(at, node) {
  const key = keyOf(node);
  if (!key) return at && !keyOf(at) && at.nodeName === node.nodeName ? at : null;
  let met = at;
  while (met && keyOf(met) !== key) met = met.nextSibling;
  return met;
}

const keyOf = (node) => node.id || node.dataset?.key;

function removed(node) {
  const next = node.nextSibling;
  node.remove();
  return next;
}

function setText(met, node) {
  if (met.data !== node.data) met.data = node.data;
}

function morphElement(met, node) {
  for (const { name } of [...met.attributes]) {
    // Whether a list is folded out is the reader's own affair.
    if (!node.hasAttribute(name) && !(met.nodeName === "DETAILS" && name === "open")) {
      met.removeAttribute(name);
    }
  }
  for (const { name, value } of node.attributes) {
    if (met.getAttribute(name) !== value) met.setAttribute(name, value);
  }
  morph(met, node);
  setControl(met, node);
}

/** What a field shows is no attribute; a field that is being typed in is left alone. */
function setControl(met, node) {
  if (met === document.activeElement && met.matches("input:not([type=checkbox], [type=radio])")) {
    return;
  }
  if (met.matches("input[type=checkbox], input[type=radio]")) met.checked = node.checked;
  else if (met.matches("input:not([type=file]), select")) {
    if (met.value !== node.value) met.value = node.value;
  }
}

/** Give a file to the person at the screen. */
export function download(name, content, kind = "application/octet-stream") {
  const address = URL.createObjectURL(new Blob([content], { type: kind }));
  save(name, address);
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** The same for what has an address of its own. */
export function save(name, address) {
  h("a", { href: address, download: name }).click();
}
